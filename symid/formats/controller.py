"""The controller of a robot file: the `[controller]` table, in both directions.

Input: the table of a robot file. Output: `Controller`; and back to a plain table.

Supported: a number for each joint, or one for all.
Not supported: gains that change with the position.
"""

from collections.abc import Sequence
from decimal import Decimal
from typing import Any

from symid.formats.section import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    explain_number,
    find_element,
    read_choice,
    read_number,
    read_table,
    to_decimal,
)
from symid.robot.controller import Controller
from symid.robot.description import Joint, JointKind

__all__ = ["list_controller", "read_controller"]

_KEYS = ("stiffness", "damping", "velocity", "velocity_source", "velocity_filter", "offset", "torque")
_CHOICES = {
    "velocity": ("error", "measured"),
    "velocity_source": ("difference", "sensor"),
    "torque": ("command", "average"),
}
_NONE, _LOG = "none", "log"
_UNITS = {
    "stiffness": {JointKind.REVOLUTE: "N*m/rad", JointKind.PRISMATIC: "N/m"},
    "damping": {JointKind.REVOLUTE: "N*m*s/rad", JointKind.PRISMATIC: "N*s/m"},
    "offset": {JointKind.REVOLUTE: "N*m", JointKind.PRISMATIC: "N"},
}


def read_controller(root: Section, joints: Sequence[Joint]) -> Controller | None:
    """Return the `[controller]` table for a robot with these joints; None where there is none."""
    joints = [joint for joint in joints if joint.mimic is None]
    table = read_table(root, "controller", _KEYS)
    if table is None:
        return None
    for key in ("stiffness", "damping"):
        if key not in table.values:
            text = f"missing; write {key} = [...], one number for each joint, on the joint side"
            table.refuse_key("robot.missing-key", key, text)
    chosen = {key: read_choice(table, key, allowed) for key, allowed in _CHOICES.items()}
    cutoff = None
    if table.values.get("velocity_filter") != _NONE:
        cutoff = read_number(table, "velocity_filter", "Hz", POSITIVE)
    known = table.values.get("offset", _LOG) != _LOG
    return Controller(
        stiffness=_read_each(table, "stiffness", joints, NOT_NEGATIVE),
        damping=_read_each(table, "damping", joints, NOT_NEGATIVE),
        velocity=chosen["velocity"] or "error",
        velocity_source=chosen["velocity_source"] or "difference",
        velocity_filter=None if cutoff is None else float(cutoff),
        offset=_read_each(table, "offset", joints, ANY) if known else None,
        torque=chosen["torque"] or "command",
    )


def list_controller(controller: Controller) -> dict[str, Any]:
    """Return the controller as a table that `read_controller` reads back."""
    cutoff, offset = controller.velocity_filter, controller.offset
    return {
        "stiffness": _list_exactly(controller.stiffness),
        "damping": _list_exactly(controller.damping),
        "velocity": controller.velocity,
        "velocity_source": controller.velocity_source,
        "velocity_filter": _NONE if cutoff is None else Decimal(repr(cutoff)),
        "offset": _LOG if offset is None else _list_exactly(offset),
        "torque": controller.torque,
    }


def _list_exactly(numbers: Sequence[float]) -> list[Decimal]:
    return [Decimal(repr(number)) for number in numbers]


def _read_each(table: Section, key: str, joints: Sequence[Joint], allowed: Range) -> tuple[float, ...]:
    """Return a number for each joint, zeros where they are wrong."""
    value: Any = table.values.get(key)
    nothing = (0.0,) * len(joints)
    if value is None:
        return nothing
    listed = value if isinstance(value, list) else [value]
    if len(listed) not in (1, len(joints)):
        text = f"{len(listed)} numbers for {len(joints)} joints; give one for each joint, or one for all"
        table.refuse("robot.column-count", key, text)
        return nothing
    units = [_UNITS[key][joint.kind] for joint in joints]
    if len(listed) < len(joints) and len(set(units)) > 1:
        text = "one number for joints that turn and joints that slide; give one for each joint"
        table.refuse("robot.column-count", key, text)
    numbers = [_read_one(table, key, index, allowed, unit) for index, unit in enumerate(units[: len(listed)])]
    return tuple(numbers) if len(numbers) == len(joints) else tuple(numbers) * len(joints)


def _read_one(table: Section, key: str, index: int, allowed: Range, unit: str) -> float:
    """Return the number at `index` of the list at `key`, or the one that stands for all joints."""
    inner = (index,) if isinstance(table.values[key], list) else ()
    value = find_element(table, key, *inner)
    number = to_decimal(value)
    if number is None:
        extra = f' or "{_LOG}"' if key == "offset" else ""
        got = f"got {table.show(key, *inner)}{explain_number(value, unit)}"
        text = f"expected a number in {unit}{extra}, {got}"
        table.refuse("robot.wrong-type", key, text, *inner)
    elif number not in allowed:
        text = f"must be {allowed} {unit}, got {table.show(key, *inner)}"
        table.refuse("robot.out-of-range", key, text, *inner)
    return 0.0 if number is None else float(number)
