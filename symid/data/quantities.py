"""From raw columns to a quantity per joint: found by name, in SI units, on the joint side.

Input: `RawLog`, the robot's `LogMap`. Output: arrays (N, n); remarks on every conversion.

    columns -> one column a joint -> SI (unit) -> quantity (factor) -> joint side (gear or matrix) -> zero

Supported: one column a joint, or one array with a column a joint; without a map, the names
t, q, dq, tau (arrays) or q1, q2 ... and time, position, velocity, torque, and theta, motor_position or
link_position for the second encoder of each joint; motors that move several joints.
Not supported: transmissions that depend on the position.
"""

import difflib
import re

import numpy as np

from symid.arrays import FloatArray
from symid.data.findings import Findings
from symid.data.scales import (
    choose_unit,
    describe_scale,
    find_scale,
    is_motor_side,
    is_other_dimension,
    join_names,
    look_up_unit,
    turn_motors,
)
from symid.data.table import RawLog
from symid.robot.description import Robot
from symid.robot.log_map import LogQuantity

__all__ = ["CONTROL", "DEFAULT_NAMES", "OPTIONAL", "find_quantity", "find_time"]

DEFAULT_NAMES = {
    "time": ("t", "time"),
    "position": ("q", "position"),
    "velocity": ("dq", "velocity"),
    "torque": ("tau", "torque"),
    "motor_position": ("theta", "motor_position"),
    "link_position": ("link_position",),
    "reference": ("q_ref", "reference"),
    "reference_velocity": ("dq_ref", "reference_velocity"),
    "feedforward": ("tau_ff", "feedforward"),
}
"""Names under which a quantity is looked up where the robot file says nothing."""

CONTROL = ("reference", "reference_velocity", "feedforward")
"""Quantities of the controller, which a log need not have even where the robot file names their columns."""

OPTIONAL = ("velocity", "motor_position", "link_position", *CONTROL)
"""Quantities that a log need not have, unless the robot file names their columns."""


def find_time(raw: RawLog, robot: Robot, findings: Findings) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return time (N,) in s, None if it is not there, and the names of the columns used."""
    asked = robot.log.time
    names = asked.columns if asked else _find_default_names(raw, "time")
    array = _stack_columns(raw, names, "time", findings, asked=asked is not None)
    if array is None:
        return None, names
    unit = choose_unit(raw, names, asked, "s", findings)
    found = look_up_unit(unit, "time", findings)
    if found is None:
        return None, names
    if found[0] not in ("time", "SI"):
        findings.refuse(
            "log.wrong-unit", f"time is in {unit!r}, which is a unit of {found[0]}; use s, ms or us"
        )
        return None, names
    if array.shape[1] != 1:
        findings.refuse("log.time-columns", f"time has {array.shape[1]} columns, it must have one")
        return None, names
    factor = found[1] * (asked.factor[0] if asked else 1.0)
    if factor != 1.0:
        findings.remark("log.converted", f"time: column {names[0]!r} in {unit} was multiplied by {factor:g}")
    return array[:, 0] * factor, names


def find_quantity(
    raw: RawLog, robot: Robot, name: str, samples: int | None, findings: Findings
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return the quantity `name` (N, n) in SI units on the joint side, and the columns used.

    None if there is no such column (a mistake, except for an optional quantity that no map asks for, and
    for those of the controller), or if it cannot be converted. `samples` is the length of the time column,
    where that is known.
    """
    asked: LogQuantity | None = getattr(robot.log, name)
    names = asked.columns if asked else _find_default_names(raw, name)
    if name in OPTIONAL and asked is None and not _is_free(raw, robot, names):
        return None, ()
    if asked is None and not _check_joint_numbers(raw, robot, name, names, findings):
        return None, names
    lacking = [column for column in names if column not in raw.columns]
    if name in CONTROL and lacking:
        text = f"{_describe_missing(raw, lacking[0], name)}; only output error needs it"
        findings.remark("log.no-reference", text)
        return None, ()
    array = _stack_columns(raw, names, name, findings, asked=asked is not None)
    if array is not None:
        array = _orient(array, samples, name, names, findings)
    if array is None:
        return None, names
    if array.shape[1] != robot.freedom:
        text = f"{name} has {array.shape[1]} columns ({join_names(names)}), the robot {robot.freedom} joints"
        findings.refuse("log.joint-count", text)
        return None, names
    unit = choose_unit(raw, names, asked, "SI", findings)
    matrix = robot.log.transmission if is_motor_side(asked) else None
    scale = find_scale(name, unit, asked, robot.axes, findings, coupled=matrix is not None)
    if scale is None:
        return None, names
    offset = np.array(asked.offset if asked else (0.0,))
    moved = is_motor_side(asked) or bool(np.any(offset))
    if np.any(scale != 1.0) or moved or is_other_dimension(name, unit, robot.axes):
        text = describe_scale(name, unit, scale, asked, robot.axes, matrix=matrix)
        findings.remark("log.converted", f"{name}: {join_names(names)} {text}")
    values = array * scale
    if matrix is not None:
        values = turn_motors(name, values, matrix)
    return (values + offset if offset.any() else values), names


def _find_default_names(raw: RawLog, name: str) -> tuple[str, ...]:
    """Return the names under which the quantity is there; the first default name if it is not."""
    for stem in DEFAULT_NAMES[name]:
        if stem in raw.columns:
            return (stem,)
        numbered = (re.fullmatch(rf"{stem}_?(\d+)", column) for column in raw.columns)
        found = sorted((int(match[1]), match[0]) for match in numbered if match)
        if found and name != "time":
            return tuple(column for _, column in found)
    return (DEFAULT_NAMES[name][0],)


def _is_free(raw: RawLog, robot: Robot, names: tuple[str, ...]) -> bool:
    """Return whether the columns are there, and the robot file reads none of them as something else."""
    log = robot.log
    quantities: list[LogQuantity | None] = [getattr(log, name) for name in DEFAULT_NAMES]
    claimed = {column for entry in quantities if entry is not None for column in entry.columns}
    return all(column in raw.columns and column not in claimed for column in names)


def _list_numbers(names: tuple[str, ...]) -> list[int]:
    """Return the numbers at the end of names such as q1, q2; none of names without a number."""
    matches = [re.fullmatch(r"[a-z]+_?(\d+)", name) for name in names]
    return [int(match[1]) for match in matches if match]


def _check_joint_numbers(
    raw: RawLog, robot: Robot, name: str, names: tuple[str, ...], findings: Findings
) -> bool:
    """Say whether numbered columns count the joints from 0 or 1 without a gap, and as positions do."""
    numbers = _list_numbers(names)
    if not numbers:
        return True
    remedy = f"say in [log.{name}] which column belongs to which joint"
    if numbers[0] > 1 or numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        text = f"{name}: {join_names(names)} do not count the joints as 1, 2 ... or 0, 1 ...; {remedy}"
        findings.refuse("log.joint-numbers", text)
        return False
    first = [] if robot.log.position else _list_numbers(_find_default_names(raw, "position"))
    if first and first[0] in (0, 1) and first[0] != numbers[0]:
        text = (
            f"{name} is numbered from {numbers[0]} ({join_names(names)}), position from {first[0]}; {remedy}"
        )
        findings.refuse("log.joint-numbers", text)
        return False
    return True


def _stack_columns(
    raw: RawLog, names: tuple[str, ...], quantity: str, findings: Findings, *, asked: bool
) -> FloatArray | None:
    missing = [name for name in names if name not in raw.columns]
    for name in missing:
        text = _describe_missing(raw, name, quantity)
        findings.refuse("log.missing-column", text if asked else f"{text}; {_describe_default(quantity)}")
    if missing:
        return None
    parts = [np.atleast_1d(raw.columns[name]) for name in names]
    if len(parts) == 1:
        return parts[0][:, None] if parts[0].ndim == 1 else parts[0]
    lengths = {name: len(part) for name, part in zip(names, parts, strict=True)}
    if len(set(lengths.values())) > 1 or any(part.ndim > 1 for part in parts):
        shapes = ", ".join(f"{name} {part.shape}" for name, part in zip(names, parts, strict=True))
        findings.refuse("log.unequal-length", f"the columns of {quantity} differ in shape: {shapes}")
        return None
    return np.stack(parts, axis=1)


def _describe_missing(raw: RawLog, name: str, quantity: str) -> str:
    if name in raw.others:
        return f"{quantity}: {name!r} is in the log, but it is not a column of real numbers"
    near = difflib.get_close_matches(name, raw.columns, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    there = join_names(tuple(raw.columns)) or "no columns"
    return f"{quantity}: there is no column {name!r}; {hint}the log has {there}"


def _describe_default(quantity: str) -> str:
    """Return the names that are looked up without a map, and how to name another column."""
    stems = DEFAULT_NAMES[quantity]
    if quantity == "time":
        return (
            f"without [log.time] it is looked up as {' or '.join(stems)}; else use --set log.time.column=NAME"
        )
    known = " or ".join(f"{stem} or {stem}1, {stem}2 ..." for stem in stems)
    return (
        f"without [log.{quantity}] it is looked up as {known}; else use "
        f"--set log.{quantity}.columns=NAME,NAME --set log.{quantity}.unit=UNIT"
    )


def _orient(
    array: FloatArray, samples: int | None, name: str, names: tuple[str, ...], findings: Findings
) -> FloatArray | None:
    if samples is None or len(array) == samples:
        return array
    if array.shape[1] == samples:
        findings.remark("log.transposed", f"{name}: {join_names(names)} has a row a joint and was transposed")
        return array.T
    text = f"{name} ({join_names(names)}) has {len(array)} samples, time has {samples}"
    findings.refuse("log.unequal-length", text)
    return None
