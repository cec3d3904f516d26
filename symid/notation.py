"""The one table of symbols: ASCII name, LaTeX, SI unit, meaning.

Units are written for a revolute joint; `find_unit` gives those of a prismatic one.
"""

from dataclasses import dataclass

__all__ = ["INERTIAL", "SYMBOLS", "Symbol", "find_unit"]

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


def find_unit(name: str, *, prismatic: bool = False) -> str:
    """Return the SI unit of the symbol `name` at a revolute or prismatic joint.

    Raises:
        KeyError: there is no such symbol in the table.
    """
    symbol = _BY_NAME[name]
    return symbol.unit_prismatic if prismatic else symbol.unit
