"""The table of symbols (ASCII, LaTeX, SI unit, meaning) and the closed table of units of files and logs.

Units of symbols are written for a revolute joint; `get_unit` gives those of a prismatic one too.

Supported: the listed units; a product may be written with a space, `*` or a middle dot.
Not supported: arithmetic on units, prefixes on names that are not listed.
"""

import difflib
import math
import re
from dataclasses import dataclass

INERTIAL = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""Standard parameters of a link, about the link frame's origin, in this order."""

GRAVITY_SYMBOLS = ("g_x", "g_y", "g_z")
"""Gravity in the base frame where it is to be found, m/s^2."""
MOUNTING = "how the robot is mounted"
"""Why gravity and zeros of encoders are parameters of a fit."""

HYSTERESIS_MODELS = (
    *("prandtl-ishlinskii", "modified-prandtl-ishlinskii", "nonlinear-stops", "krasnoselskii-pokrovskii"),
    *("sided", "bouc-wen", "dahl", "lugre", "maxwell-slip"),
)
"""Names of models of elements with hysteresis."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """A quantity: its letter in code and in print, and its SI unit at a revolute joint."""

    name: str
    latex: str
    unit: str
    meaning: str


SYMBOLS: tuple[Symbol, ...] = (
    Symbol("t", "t", "s", "time"),
    Symbol("q", "q", "rad", "link coordinate"),
    Symbol("dq", r"\dot q", "rad/s", "link velocity"),
    Symbol("ddq", r"\ddot q", "rad/s^2", "link acceleration"),
    Symbol("theta", r"\theta", "rad", "motor coordinate on the joint side"),
    Symbol("dtheta", r"\dot\theta", "rad/s", "motor velocity on the joint side"),
    Symbol("phi", r"\varphi", "rad", "torsion theta - q"),
    Symbol("tau", r"\tau", "N m", "joint torque (force, if prismatic)"),
    Symbol("tau_m", r"\tau_m", "N m", "motor torque on the joint side"),
    Symbol("pi", r"\pi", "mixed", "standard inertial parameters"),
    Symbol("beta", r"\beta", "mixed", "base inertial parameters"),
    Symbol("h", "h", "mixed", "energy regressor"),
    Symbol("Yp", "Y_p", "mixed", "momentum regressor"),
    Symbol("Y", "Y", "mixed", "torque regressor"),
    Symbol("XX", "XX", "kg m^2", "inertia about x, link frame's origin"),
    Symbol("XY", "XY", "kg m^2", "entry xy of the inertia tensor"),
    Symbol("XZ", "XZ", "kg m^2", "entry xz of the inertia tensor"),
    Symbol("YY", "YY", "kg m^2", "inertia about y, link frame's origin"),
    Symbol("YZ", "YZ", "kg m^2", "entry yz of the inertia tensor"),
    Symbol("ZZ", "ZZ", "kg m^2", "inertia about z, link frame's origin"),
    Symbol("MX", "MX", "kg m", "first moment along x"),
    Symbol("MY", "MY", "kg m", "first moment along y"),
    Symbol("MZ", "MZ", "kg m", "first moment along z"),
    Symbol("M", "M", "kg", "mass"),
    Symbol("IA", "I_a", "kg m^2", "reflected rotor inertia"),
    Symbol("KS", "K_s", "N m/rad", "stiffness of a spring at the joint"),
    Symbol("KR", "K_r", "N m", "torque of the spring at q = 0: minus stiffness times rest position"),
    Symbol("k0", "k_0", "N m/rad", "stiffness of an elastic joint when all its stops slip"),
    Symbol("kc", "k_c", "N m/rad^3", "cubic stiffness of an elastic joint"),
    Symbol("k", "k", "N m/rad", "stiffness of a stop"),
    Symbol("r", "r", "rad", "torsion at which a stop slips"),
    Symbol("s", "s", "1", "slope that a knee adds to the outer function"),
    Symbol("R", "R", "N m", "torque at which a knee begins"),
    Symbol("z", "z", "rad", "deflection of a bristle, or of an element of friction"),
    Symbol("way", r"\Delta q", "rad", "displacement of a joint in a step"),
    Symbol("P", "P", "rad", "play of a torsion"),
    Symbol("Q", "Q", "N m", "play of the inverse, of a torque"),
    Symbol("tau_J", r"\tau_J", "N m", "torque of an elastic joint's spring"),
    Symbol("Fv", "F_v", "N m s/rad", "viscous friction"),
    Symbol("Fc", "F_c", "N m", "Coulomb friction"),
    Symbol("offset", r"\tau_0", "N m", "constant torque: drive offset, asymmetry"),
    Symbol("Fvp", "F_v^+", "N m s/rad", "viscous friction, positive velocity"),
    Symbol("Fcp", "F_c^+", "N m", "Coulomb friction, positive velocity"),
    Symbol("Fvn", "F_v^-", "N m s/rad", "viscous friction, negative velocity"),
    Symbol("Fcn", "F_c^-", "N m", "Coulomb friction, negative velocity"),
    Symbol("Fe", "F_e", "N m", "static friction beyond Coulomb friction"),
    Symbol("Fp", "F_p", "N m", "constant torque of the improved Stribeck model"),
    Symbol("Fvq", "F_{vq}", "N m s^2/rad^2", "friction with the square of the speed"),
    Symbol("Fvc", "F_{vc}", "N m s^3/rad^3", "friction with the cube of the speed"),
    Symbol("Fd", r"F_\delta", "N m", "friction with a power of the speed, at 1 rad/s or 1 m/s"),
    Symbol("Fm", "F_m", "N m", "rise of dry friction before it falls again"),
)

_BY_NAME = {symbol.name: symbol for symbol in SYMBOLS}


def join_name(letters: str, end: str | int) -> str:
    """Return the name of a parameter: letters and the joint's number, apart where the letters end in one."""
    return f"{letters}{'_' if letters[-1].isdigit() else ''}{end}"


def adapt_unit(unit: str, *, prismatic: bool) -> str:
    """Return the unit of a revolute joint, or the same of a prismatic one: N for N m, m for rad."""
    return unit.replace("N*m", "N").replace("N m", "N").replace("rad", "m") if prismatic else unit


def get_unit(name: str, *, prismatic: bool = False) -> str:
    """Return the SI unit of the symbol `name` at a revolute or prismatic joint.

    Raises:
        KeyError: there is no such symbol in the table.
    """
    if prismatic and name == "IA":
        return "kg"
    return adapt_unit(_BY_NAME[name].unit, prismatic=prismatic)


_TURN = 2 * math.pi
_DEGREE = math.pi / 180
_A_MINUTE = dict.fromkeys(("rpm", "rev/min", "U/min", "1/min", "min^-1"), _TURN / 60)
_MOMENTS = (("N", "m", 1.0), ("mN", "m", 1e-3), ("N", "cm", 1e-2), ("kN", "m", 1e3))
_FACTORS = {
    # `SI` stands for rad or m, N m or N, whichever the joint has.
    "SI": {"SI": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": _DEGREE, "rev": _TURN},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "angular velocity": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "rev/s": _TURN, **_A_MINUTE},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "angular acceleration": {"rad/s^2": 1.0, "deg/s^2": _DEGREE},
    "acceleration": {"m/s^2": 1.0, "mm/s^2": 1e-3},
    "torque": {f"{one}{gap}{m}": x for one, m, x in _MOMENTS for gap in (" ", "")},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "number": {"1": 1.0, "count": 1.0, "%": 1e-2},
    "mass": {"kg": 1.0, "g": 1e-3},
    "inertia": {"kg m^2": 1.0, "kg cm^2": 1e-4, "g cm^2": 1e-7},
    "first moment": {"kg m": 1.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "torque constant": {"N m/A": 1.0, "Nm/A": 1.0},
    "viscous friction": {"N m s/rad": 1.0, "N s/m": 1.0},
    "temperature": {"degC": 1.0},
}
UNITS: dict[str, tuple[str, float]] = {
    unit: (dimension, factor) for dimension, units in _FACTORS.items() for unit, factor in units.items()
}
"""Dimension and factor to SI of each unit."""


_LIKE = (
    *(("**", "^"), ("*", " "), ("\N{MIDDLE DOT}", " "), ("\N{DOT OPERATOR}", " ")),
    ("\N{SUPERSCRIPT TWO}", "^2"),
    *(("\N{DEGREE SIGN}", "deg"), ("\N{MASCULINE ORDINAL INDICATOR}", "deg")),
    *(("\N{MICRO SIGN}", "u"), ("\N{GREEK SMALL LETTER MU}", "u")),
)
"""Other signs for the same."""
_WORDS = {
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    "msec": "ms",
    "usec": "us",
    "nsec": "ns",
    **dict.fromkeys(("degree", "degrees"), "deg"),
    **dict.fromkeys(("radian", "radians"), "rad"),
}
"""Other words for the same."""
_IN_CAPITALS = {
    unit.upper(): unit for unit in UNITS if unit not in {"mN", "mN m", "mNm", "mA", "mV", "mrad", "mrad/s"}
}
"""Units by their names in capitals, without those in which M could be mega."""


def _normalise_unit(name: str) -> str:
    for sign, plain in _LIKE:
        name = name.replace(sign, plain)
    parts = re.split(r"([ /])", " ".join(name.split()))
    name = "".join(_WORDS.get(part.lower(), part) for part in parts)
    return name if name in UNITS or not name[:1].isupper() else _IN_CAPITALS.get(name.upper(), name)


def get_unit_factor(name: str) -> tuple[str, float]:
    """Return the dimension of the unit `name` and the factor that turns its numbers into SI.

    Raises:
        KeyError: there is no such unit in the table.
    """
    return UNITS[_normalise_unit(name)]


def suggest_units(name: str) -> tuple[str, ...]:
    """Return up to three units whose names are most like `name`, the likeliest first."""
    wanted = _normalise_unit(name)
    by_case = [unit for unit in UNITS if unit.lower() == wanted.lower()]
    near = difflib.get_close_matches(wanted, UNITS, n=3, cutoff=0.5)
    return tuple(dict.fromkeys([*by_case, *near]))[:3]
