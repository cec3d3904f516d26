"""Values of a robot's parameters, vector by vector, in the order of its generated functions.

Input: names, values, units. Output: `ValueRow`, `ValueVector`, `RobotValues`; `c_values` and `json_values`
write them.

Supported: base parameters, friction, rotors of elastic joints, springs. A value that nobody knows is None.
"""

from dataclasses import dataclass

__all__ = ["RobotValues", "ValueRow", "ValueVector"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueRow:
    """A parameter: its value in SI units, what it groups, and where it was identified as what, how surely."""

    name: str
    value: float | None
    unit: str
    expression: str = ""
    identified: float | None = None
    std: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueVector:
    """One argument of generated functions: its name there, in words what it is, its entries in order."""

    name: str
    title: str
    rows: tuple[ValueRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotValues:
    """All vectors of a robot, `signature` that of its model, `prefix` how names of its C library begin."""

    robot: str
    prefix: str
    signature: str
    vectors: tuple[ValueVector, ...]
