"""The closed table of units that robot files and logs may name.

Input: the name of a unit. Output: its dimension in words, and its factor to SI.

Supported: the names below; a product may be written with a space, `*` or a middle dot.
Not supported: arithmetic on units, prefixes on names that are not listed.
"""

import difflib
import math

__all__ = ["UNITS", "find_unit_factor", "nearest_units"]

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


def _normalise(name: str) -> str:
    return " ".join(name.replace("**", "^").replace("*", " ").replace("\N{MIDDLE DOT}", " ").split())


def find_unit_factor(name: str) -> tuple[str, float]:
    """Return the dimension of the unit `name` and the factor that turns its numbers into SI.

    Raises:
        KeyError: there is no such unit in the table.
    """
    return UNITS[_normalise(name)]


def nearest_units(name: str) -> tuple[str, ...]:
    """Return up to three units whose names are most like `name`, the likeliest first."""
    wanted = _normalise(name)
    by_case = [unit for unit in UNITS if unit.lower() == wanted.lower()]
    near = difflib.get_close_matches(wanted, UNITS, n=3, cutoff=0.5)
    return tuple(dict.fromkeys([*by_case, *near]))[:3]
