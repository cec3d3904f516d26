"""The table of symbols (ASCII, LaTeX, SI unit, meaning) and the closed table of units of files and logs.

Units of symbols are written for a revolute joint; `get_unit` gives those of a prismatic one too. A unit's
name -> its dimension in words and its factor to SI.

Supported: the listed units; a product may be written with a space, `*` or a middle dot.
Not supported: arithmetic on units, prefixes on names that are not listed.
"""

import difflib
import math
from dataclasses import dataclass

INERTIAL = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""Standard parameters of a link, about the link frame's origin, in this order."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """A quantity: its letter in code and in print, and its SI units."""

    name: str
    latex: str
    unit: str
    unit_prismatic: str
    meaning: str


SYMBOLS: tuple[Symbol, ...] = (
    Symbol("t", "t", "s", "s", "time"),
    Symbol("q", "q", "rad", "m", "link coordinate"),
    Symbol("dq", r"\dot q", "rad/s", "m/s", "link velocity"),
    Symbol("ddq", r"\ddot q", "rad/s^2", "m/s^2", "link acceleration"),
    Symbol("theta", r"\theta", "rad", "m", "motor coordinate on the joint side"),
    Symbol("dtheta", r"\dot\theta", "rad/s", "m/s", "motor velocity on the joint side"),
    Symbol("phi", r"\varphi", "rad", "m", "torsion theta - q"),
    Symbol("tau", r"\tau", "N m", "N", "joint torque (force, if prismatic)"),
    Symbol("tau_m", r"\tau_m", "N m", "N", "motor torque on the joint side"),
    Symbol("pi", r"\pi", "mixed", "mixed", "standard inertial parameters"),
    Symbol("beta", r"\beta", "mixed", "mixed", "base inertial parameters"),
    Symbol("h", "h", "mixed", "mixed", "energy regressor"),
    Symbol("Yp", "Y_p", "mixed", "mixed", "momentum regressor"),
    Symbol("Y", "Y", "mixed", "mixed", "torque regressor"),
    Symbol("XX", "XX", "kg m^2", "kg m^2", "inertia about x, link frame's origin"),
    Symbol("XY", "XY", "kg m^2", "kg m^2", "entry xy of the inertia tensor"),
    Symbol("XZ", "XZ", "kg m^2", "kg m^2", "entry xz of the inertia tensor"),
    Symbol("YY", "YY", "kg m^2", "kg m^2", "inertia about y, link frame's origin"),
    Symbol("YZ", "YZ", "kg m^2", "kg m^2", "entry yz of the inertia tensor"),
    Symbol("ZZ", "ZZ", "kg m^2", "kg m^2", "inertia about z, link frame's origin"),
    Symbol("MX", "MX", "kg m", "kg m", "first moment along x"),
    Symbol("MY", "MY", "kg m", "kg m", "first moment along y"),
    Symbol("MZ", "MZ", "kg m", "kg m", "first moment along z"),
    Symbol("M", "M", "kg", "kg", "mass"),
    Symbol("IA", "I_a", "kg m^2", "kg", "reflected rotor inertia"),
    Symbol("KS", "K_s", "N m/rad", "N/m", "stiffness of a spring at the joint"),
    Symbol("KR", "K_r", "N m", "N", "torque of the spring at q = 0: minus stiffness times rest position"),
    Symbol("k0", "k_0", "N m/rad", "N/m", "stiffness of an elastic joint when all its stops slip"),
    Symbol("kc", "k_c", "N m/rad^3", "N/m^3", "cubic stiffness of an elastic joint"),
    Symbol("k", "k", "N m/rad", "N/m", "stiffness of a stop"),
    Symbol("r", "r", "rad", "m", "torsion at which a stop slips"),
    Symbol("s", "s", "1", "1", "slope that a knee adds to the outer function"),
    Symbol("R", "R", "N m", "N", "torque at which a knee begins"),
    Symbol("P", "P", "rad", "m", "play of a torsion"),
    Symbol("Q", "Q", "N m", "N", "play of the inverse, of a torque"),
    Symbol("tau_J", r"\tau_J", "N m", "N", "torque of an elastic joint's spring"),
    Symbol("Fv", "F_v", "N m s/rad", "N s/m", "viscous friction"),
    Symbol("Fc", "F_c", "N m", "N", "Coulomb friction"),
    Symbol("offset", r"\tau_0", "N m", "N", "constant torque: drive offset, asymmetry"),
    Symbol("Fvp", "F_v^+", "N m s/rad", "N s/m", "viscous friction, positive velocity"),
    Symbol("Fcp", "F_c^+", "N m", "N", "Coulomb friction, positive velocity"),
    Symbol("Fvn", "F_v^-", "N m s/rad", "N s/m", "viscous friction, negative velocity"),
    Symbol("Fcn", "F_c^-", "N m", "N", "Coulomb friction, negative velocity"),
    Symbol("Fe", "F_e", "N m", "N", "static friction beyond Coulomb friction"),
    Symbol("Fp", "F_p", "N m", "N", "constant torque of the improved Stribeck model"),
    Symbol("Fvq", "F_{vq}", "N m s^2/rad^2", "N s^2/m^2", "friction with the square of the speed"),
    Symbol("Fvc", "F_{vc}", "N m s^3/rad^3", "N s^3/m^3", "friction with the cube of the speed"),
    Symbol("Fd", r"F_\delta", "N m", "N", "friction with a power of the speed, at 1 rad/s or 1 m/s"),
    Symbol("Fm", "F_m", "N m", "N", "rise of dry friction before it falls again"),
)

_BY_NAME = {symbol.name: symbol for symbol in SYMBOLS}


def get_unit(name: str, *, prismatic: bool = False) -> str:
    """Return the SI unit of the symbol `name` at a revolute or prismatic joint.

    Raises:
        KeyError: there is no such symbol in the table.
    """
    symbol = _BY_NAME[name]
    return symbol.unit_prismatic if prismatic else symbol.unit


_TURN = 2 * math.pi
_DEGREE = math.pi / 180

UNITS: dict[str, tuple[str, float]] = {
    # `SI` stands for rad or m, N m or N, whichever the joint has.
    "SI": ("SI", 1.0),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "min": ("time", 60.0),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", _DEGREE),
    "rev": ("angle", _TURN),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "rad/s": ("angular velocity", 1.0),
    "mrad/s": ("angular velocity", 1e-3),
    "deg/s": ("angular velocity", _DEGREE),
    "rev/s": ("angular velocity", _TURN),
    "rpm": ("angular velocity", _TURN / 60),
    "rev/min": ("angular velocity", _TURN / 60),
    "m/s": ("velocity", 1.0),
    "cm/s": ("velocity", 1e-2),
    "mm/s": ("velocity", 1e-3),
    "rad/s^2": ("angular acceleration", 1.0),
    "deg/s^2": ("angular acceleration", _DEGREE),
    "m/s^2": ("acceleration", 1.0),
    "mm/s^2": ("acceleration", 1e-3),
    "N m": ("torque", 1.0),
    "Nm": ("torque", 1.0),
    "mN m": ("torque", 1e-3),
    "mNm": ("torque", 1e-3),
    "N cm": ("torque", 1e-2),
    "Ncm": ("torque", 1e-2),
    "kN m": ("torque", 1e3),
    "kNm": ("torque", 1e3),
    "N": ("force", 1.0),
    "mN": ("force", 1e-3),
    "kN": ("force", 1e3),
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
    "1": ("number", 1.0),
    "count": ("number", 1.0),
    "%": ("number", 1e-2),
    "kg": ("mass", 1.0),
    "g": ("mass", 1e-3),
    "kg m^2": ("inertia", 1.0),
    "kg cm^2": ("inertia", 1e-4),
    "g cm^2": ("inertia", 1e-7),
    "kg m": ("first moment", 1.0),
    "Hz": ("frequency", 1.0),
    "kHz": ("frequency", 1e3),
    "N m/A": ("torque constant", 1.0),
    "Nm/A": ("torque constant", 1.0),
    "N m s/rad": ("viscous friction", 1.0),
    "N s/m": ("viscous friction", 1.0),
}


def _normalise_unit(name: str) -> str:
    return " ".join(name.replace("**", "^").replace("*", " ").replace("\N{MIDDLE DOT}", " ").split())


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
