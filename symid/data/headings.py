"""What the heading of a column says: quantity, joint, unit.

Input: `RawLog`, the joints that have a coordinate. Output: a `Heading` for each column.

    "waist angle [deg]", "waist_angle_deg", "WaistAngle (deg)" -> position of the joint waist, in deg

Words are what stands between signs, digits and a change to capitals; case does not matter. One word names the
quantity, or else the unit does; words such as "actual" say nothing; what is left must be the name of a joint,
a number, or nothing.

Supported: the words of the tables below.
Not supported: anything else is no quantity, and nobody guesses one.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from symid.data.table import RawLog
from symid.robot.description import Joint
from symid.units import UNITS, find_unit_factor

__all__ = ["DIMENSIONS", "Heading", "read_headings"]

_WORDS = {
    "time": ("t", "time", "timestamp", "stamp", "clock"),
    "position": ("q", "pos", "position", "angle"),
    "velocity": ("dq", "qdot", "vel", "velocity", "speed"),
    "torque": ("tau", "torque", "trq", "effort", "force", "current", "cur", "curr", "i"),
}
_CURRENTS = frozenset({"current", "cur", "curr", "i"})
_SILENT = frozenset({"joint", "axis", "actual", "act", "measured", "meas", "value"})
_WANTED = frozenset(
    {
        "target",
        "cmd",
        "command",
        "commanded",
        "desired",
        "des",
        "ref",
        "reference",
        "setpoint",
        "goal",
        "wanted",
    }
)
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_]+")
_PARENTHESES = re.compile(r"(.*\S)\s*\(([^()]+)\)")

DIMENSIONS = {
    "time": ("time",),
    "position": ("angle", "length"),
    "velocity": ("angular velocity", "velocity"),
    "torque": ("torque", "force", "current"),
}
"""Dimensions of the units that columns of a quantity may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """What a column is called, and what that says.

    Args:
        column: its name in the log.
        quantity: "time", "position", "velocity", "torque", or "" where nothing says it.
        words: what is left of the name; that of a joint, a number, or nothing.
        unit: as stated, None where it is not.
        wanted: whether it holds what was asked for, not what was measured.
        size: number of columns, where it is an array.
    """

    column: str
    quantity: str
    words: tuple[str, ...] = ()
    unit: str | None = None
    wanted: bool = False
    size: int = 1

    @property
    def number(self) -> int | None:
        """Return the number that is left of the name, if nothing else is."""
        return int(self.words[0]) if len(self.words) == 1 and self.words[0].isdecimal() else None

    def names(self, joint: Joint) -> bool:
        """Return whether what is left of the name is the name of `joint`."""
        return bool(self.words) and self.words == _drop_silent(_list_words(joint.name))


def read_headings(raw: RawLog, joints: Sequence[Joint]) -> tuple[Heading, ...]:
    """Return what the headings of all columns say, in the order of the log."""
    own = {word for joint in joints for word in _drop_silent(_list_words(joint.name))}
    return tuple(_read_heading(raw, column, own) for column in raw.columns)


def _read_heading(raw: RawLog, column: str, own: set[str]) -> Heading:
    """Return what a heading says; words of joints' names are theirs, whatever else they could mean."""
    name, unit = _split_unit(column, raw.units.get(column), own)
    words = _list_words(name)
    said = [word for word in words if word not in own and _find_quantity(word)]
    quantities = {_find_quantity(word) for word in said}
    of_unit = _find_quantity_of_unit(unit)
    quantity = quantities.pop() if len(quantities) == 1 else "" if quantities else of_unit
    # A current is that of a motor by nature; a position or torque of a motor is not that of the joint.
    silent = {"motor"} if _CURRENTS & set(said) or (not said and _is_current(unit)) else set()
    left = tuple(word for word in words if word not in said and word not in silent)
    array = raw.columns[column]
    return Heading(
        column=column,
        quantity=quantity,
        words=_drop_silent(tuple(word for word in left if word not in _WANTED or word in own)),
        unit=unit,
        wanted=bool((_WANTED - own) & set(left)),
        size=array.shape[1] if array.ndim > 1 else 1,
    )


def _split_unit(column: str, stated: str | None, own: set[str]) -> tuple[str, str | None]:
    """Return name and unit: in brackets, else in parentheses, else behind the last underscore.

    Of a joint A, tau_A is the torque, and no current in ampere.
    """
    if stated is not None:
        return column, stated
    match = _PARENTHESES.fullmatch(column)
    if match:
        return match[1], match[2].strip()
    name, sign, unit = column.rpartition("_")
    # q_1 is the joint 1, no number without a unit.
    stands = unit in UNITS and not unit.isdecimal() and unit.lower() not in own
    return (name, unit) if sign and name and stands else (column, None)


def _list_words(name: str) -> tuple[str, ...]:
    return tuple(word.lower() for word in _SPLIT.findall(name))


def _drop_silent(words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(str(int(word)) if word.isdecimal() else word for word in words if word not in _SILENT)


def _find_quantity(word: str) -> str:
    return next((quantity for quantity, words in _WORDS.items() if word in words), "")


def _find_quantity_of_unit(unit: str | None) -> str:
    """Return the only quantity that a unit can be of."""
    try:
        dimension = find_unit_factor(unit or "")[0]
    except KeyError:
        return ""
    return next((quantity for quantity, known in DIMENSIONS.items() if dimension in known), "")


def _is_current(unit: str | None) -> bool:
    return unit in UNITS and UNITS[unit or ""][0] == "current"
