"""One quantity of the `[log]` table: its columns, unit, factor, side and zero.

Input: the table of a quantity such as `[log.position]`. Output: `LogQuantity`.

Supported: one column per joint, one array for all joints; units of the closed table; motor currents by
their torque constants; a zero for each joint.
Not supported: a unit for each joint (give a factor for each joint instead).
"""

from collections.abc import Sequence
from typing import Any

from symid.formats.constants import read_constant
from symid.formats.section import Section, read_choice, read_table, read_text, to_decimal
from symid.robot.description import Joint, JointKind
from symid.robot.log_map import LogQuantity
from symid.units import find_unit_factor, nearest_units

__all__ = ["read_quantity", "read_unit"]

_POSITIONS = ("position", "motor_position", "link_position", "reference")

_NATURAL = {
    "position": {JointKind.REVOLUTE: "angle", JointKind.PRISMATIC: "length"},
    "velocity": {JointKind.REVOLUTE: "angular velocity", JointKind.PRISMATIC: "velocity"},
    "torque": {JointKind.REVOLUTE: "torque", JointKind.PRISMATIC: "force"},
}
# Quantities that are read like another one.
_LIKE = {
    "motor_position": "position",
    "link_position": "position",
    "reference": "position",
    "reference_velocity": "velocity",
    "feedforward": "torque",
}
_NATURAL |= {name: _NATURAL[other] for name, other in _LIKE.items()}
# What a factor may turn into the quantity: encoder counts, sensor voltages, motor angles of a spindle.
_CONVERTIBLE = {
    "position": ("angle", "length", "voltage", "number"),
    "velocity": ("angular velocity", "velocity", "voltage", "number"),
    "torque": ("torque", "force", "voltage", "current", "number"),
}
_CONVERTIBLE |= {name: _CONVERTIBLE[other] for name, other in _LIKE.items()}
_TURNED = {name: ("SI", *kinds.values()) for name, kinds in _NATURAL.items()}


def read_quantity(
    table: Section, name: str, joints: Sequence[Joint], *, coupled: bool = False
) -> LogQuantity | None:
    """Return the quantity `name` of the `[log]` table; None where it is absent.

    Args:
        table: the `[log]` table.
        name: "position", "velocity", "torque", "motor_position", "link_position", "reference",
            "reference_velocity" or "feedforward".
        joints: those that have a coordinate of their own.
        coupled: whether the log has a transmission matrix, in place of gear ratios.
    """
    allowed = ("columns", "unit", "factor", "side", *(("offset",) if name in _POSITIONS else ()))
    section = read_table(table, name, allowed)
    if section is None:
        return None
    columns = _read_columns(section, len(joints))
    natural = _find_natural_unit(name, joints)
    unit = read_unit(section, natural)
    factor = _read_factor(section, len(joints))
    side = read_choice(section, "side", ("joint", "motor")) or "joint"
    # A transmission may turn angles of motors into lengths: its entries have units of their own.
    if unit and not (coupled and side == "motor" and find_unit_factor(unit)[0] in _TURNED[name]):
        factor = _check_unit(section, name, unit, factor, joints, coupled=coupled)
    if unit and find_unit_factor(unit)[0] == "current" and "factor" not in section.values:
        # Torque constants and gear ratios bring a current to the joint side, constants alone to the motor's.
        side = "motor" if coupled else "joint"
    return LogQuantity(
        columns=columns,
        unit=unit or natural,
        factor=factor or (1.0,),
        side=side,
        offset=_read_offset(section, len(joints)) or (0.0,),
    )


def _find_natural_unit(name: str, joints: Sequence[Joint]) -> str:
    """Return the SI unit of a quantity, for messages; "SI" where joints differ."""
    units = {
        "angle": "rad",
        "length": "m",
        "angular velocity": "rad/s",
        "velocity": "m/s",
        "torque": "N m",
        "force": "N",
    }
    found = {units[_NATURAL[name][joint.kind]] for joint in joints}
    return found.pop() if len(found) == 1 else "SI"


def _read_columns(section: Section, size: int) -> tuple[str, ...]:
    value: Any = section.values.get("columns")
    if value is None:
        text = 'missing; write columns = ["q1", "q2"], one for each joint, or columns = ["q"], an array'
        section.refuse_key("robot.missing-key", "columns", text)
        return ()
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        section.refuse(
            "robot.wrong-type", "columns", f"expected a list of texts, got {section.show('columns')}"
        )
        return ()
    if len(names) not in (1, size):
        text = (
            f"{len(names)} columns for {size} joints; give one for each joint, or one array with all of them"
        )
        section.refuse("robot.column-count", "columns", text)
    return tuple(names)


def read_unit(section: Section, natural: str) -> str | None:
    """Return the unit that the table states; `natural` is the one to write, for messages."""
    if "unit" not in section.values:
        section.refuse_key(
            "robot.missing-key", "unit", f'missing; units are never guessed: write unit = "{natural}"'
        )
    unit = read_text(section, "unit")
    if unit is None:
        return None
    try:
        find_unit_factor(unit)
    except KeyError:
        near = nearest_units(unit)
        hint = f"did you mean {' or '.join(near)}?" if near else f'write the unit as in unit = "{natural}"'
        section.refuse("robot.unknown-unit", "unit", f"there is no unit {section.show('unit')}; {hint}")
        return None
    return unit


def _read_factor(section: Section, size: int) -> tuple[float, ...] | None:
    value: Any = section.values.get("factor")
    if value is None:
        return None
    listed = value if isinstance(value, list) else [value]
    if len(listed) not in (1, size):
        text = f"{len(listed)} factors for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", "factor", text)
        return None
    numbers = [to_decimal(element) for element in listed]
    if not all(numbers):
        found = section.show("factor")
        section.refuse("robot.wrong-type", "factor", f"expected numbers other than 0, got {found}")
        return None
    return tuple(float(number) for number in numbers if number is not None)


def _read_offset(section: Section, size: int) -> tuple[float, ...] | None:
    value: Any = section.values.get("offset")
    if value is None:
        return None
    if not isinstance(value, list):
        one = read_constant(section, "offset", "rad or m")
        return None if one is None else (one,)
    if len(value) not in (1, size):
        text = f"{len(value)} offsets for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", "offset", text)
        return None
    found = [read_constant(section, "offset", "rad or m", index) for index in range(len(value))]
    good = tuple(number for number in found if number is not None)
    return good if len(good) == len(found) else None


def _check_unit(
    section: Section,
    name: str,
    unit: str,
    factor: tuple[float, ...] | None,
    joints: Sequence[Joint],
    *,
    coupled: bool,
) -> tuple[float, ...] | None:
    """Return the factor that goes with the unit, made of torque constants for a motor current."""
    dimension = find_unit_factor(unit)[0]
    natural = {_NATURAL[name][joint.kind] for joint in joints}
    if dimension == "SI" or natural == {dimension} or not joints:
        return factor
    if dimension not in _CONVERTIBLE[name]:
        wanted = " or ".join(sorted(natural))
        section.refuse("robot.wrong-unit", "unit", f"expected a unit of {wanted}, got {section.show('unit')}")
        return factor
    if "factor" in section.values:
        return factor
    constants = [joint.drive.torque_constant for joint in joints]
    if dimension == "current" and all(constants):
        return tuple(
            (1.0 if coupled else joint.drive.gear) * (joint.drive.torque_constant or 0.0) for joint in joints
        )
    target = _find_natural_unit(name, joints)
    text = f"{section.show('unit')} needs a factor that turns it into {target}, such as factor = 1.5"
    if dimension == "current":
        text += ", or give every joint a drive with torque_constant"
    section.refuse("robot.missing-factor", "unit", text)
    return factor
