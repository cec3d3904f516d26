"""Columns to quantities: found by name, in SI units, on the joint side.

RawLog, the robot's LogMap -> arrays (N, n); a remark on every conversion, all mistakes at once.

    columns -> one column a joint -> SI (unit) -> quantity (factor) -> joint side (gear or matrix) -> zero

Supported: one column a joint, or one array with a column a joint; without a map the names t, q, dq, tau
(arrays) or q1, q2 ... and time, position, velocity, torque, and theta, motor_position or link_position
for the second encoder of each joint; the closed table of units; factors; logs of the motor side, by gear
ratios or by the matrix of a coupled transmission; motor currents by their torque constants.
Not supported: transmissions that depend on the position; a unit for each joint (give factors and the unit
"SI").
"""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.logs.files import RawLog
from symid.notation import get_unit_factor, suggest_units
from symid.robot import JOINT_DIMENSIONS, Joint, LogQuantity, Robot, TransmissionMatrix, compute_condition


@final
@dataclass(slots=True, kw_only=True)
class Findings:
    """Mistakes and remarks on the log `file`; it fills while the log is read, and no longer."""

    file: str
    mistakes: list[Notice] = field(default_factory=list)
    remarks: list[Notice] = field(default_factory=list)

    def refuse(self, code: str, text: str) -> None:
        """Note a mistake."""
        self.mistakes.append(Notice(code=code, text=text, file=self.file))

    def remark(self, code: str, text: str) -> None:
        """Note something that the reader should know."""
        self.remarks.append(Notice(code=code, text=text, file=self.file))


_TORQUES = ("torque", "feedforward")
# A factor may have any of these on the raw side: encoder counts, sensor and command voltages.
_CONVERTIBLE = ("number", "voltage", "current")


def choose_unit(
    raw: RawLog, names: tuple[str, ...], asked: LogQuantity | None, standard: str, findings: Findings
) -> str:
    """Return the unit of the robot file, else that of the log, else SI; say where the two differ."""
    stated = {raw.units[name] for name in names if name in raw.units}
    if asked is None:
        unknown = {unit for unit in stated if not _get_factor_or_zero(unit)}
        if unknown:
            # A unit that does not exist is told as such, not as one that differs from its neighbours'.
            return min(unknown)
        silent = tuple(name for name in names if name not in raw.units)
        if stated and silent:
            neighbours = ", ".join(sorted(stated))
            text = f"no unit is stated for {join_names(silent)}, but for its neighbours ({neighbours})"
            findings.refuse("log.mixed-units", f"{text}; state the unit of every column, or of none (SI)")
        if len(stated) > 1 and standard == "SI":
            # Revolute and prismatic joints side by side; each must then be in SI units.
            stated = stated if any(_get_factor_or_zero(unit) != 1.0 for unit in stated) else set()
        if len(stated) > 1:
            units = ", ".join(sorted(stated))
            findings.refuse(
                "log.mixed-units", f"{join_names(names)} are in different units: {units}; use one for all"
            )
        return min(stated, default=standard)
    for unit in sorted(stated - {asked.unit}):
        _compare_units(unit, asked.unit, names, findings)
    return asked.unit


def _compare_units(unit: str, asked: str, names: tuple[str, ...], findings: Findings) -> None:
    """Say where the unit that the log states is not the one that the robot file asks for."""
    text = f"{join_names(names)}: the log says {unit!r}, the robot file {asked!r}"
    try:
        there, wanted = get_unit_factor(unit), get_unit_factor(asked)
    except KeyError:
        findings.remark("log.unit-differs", f"{text}; the robot file was followed")
        return
    if "SI" in (there[0], wanted[0]) or there == wanted:
        return
    if there[0] != wanted[0]:
        text = f"{text}: {there[0]} is not {wanted[0]}; correct the unit in one of them"
        findings.refuse("log.unit-differs", text)
    else:
        findings.remark("log.unit-differs", f"{text}; the robot file was followed")


def _get_factor_or_zero(unit: str) -> float:
    try:
        return get_unit_factor(unit)[1]
    except KeyError:
        return 0.0


def look_up_unit(unit: str, name: str, findings: Findings) -> tuple[str, float] | None:
    """Return dimension and factor to SI of a unit; None, and a mistake noted, if there is no such unit."""
    try:
        return get_unit_factor(unit)
    except KeyError:
        near = suggest_units(unit)
        hint = (
            f"did you mean {' or '.join(map(repr, near))}?"
            if near
            else "leave it out if the column is in SI units"
        )
        findings.refuse("log.unknown-unit", f"{name}: there is no unit {unit!r}; {hint}")
        return None


def compute_scale(
    name: str,
    unit: str,
    asked: LogQuantity | None,
    joints: tuple[Joint, ...],
    findings: Findings,
    *,
    coupled: bool = False,
) -> FloatArray | None:
    """Return what each joint's column is multiplied by, (n,).

    Gear ratios of a motor-side quantity are in it unless it is `coupled`: a transmission matrix then
    follows, whose entries may turn the angles of motors into lengths.
    """
    found = look_up_unit(unit, name, findings)
    if found is None:
        return None
    dimension, to_si = found
    factor = asked.factor if asked else (1.0,)
    wanted = JOINT_DIMENSIONS[name]
    for joint in joints:
        if dimension in ("SI", wanted[joint.kind]) or any(value != 1.0 for value in factor):
            continue
        if coupled and dimension in wanted.values():
            continue
        # A robot file that names such a unit was asked for its factor, which may well be 1.
        if asked is None or dimension not in _CONVERTIBLE:
            needs = ", for which a factor is needed" if dimension in _CONVERTIBLE else ""
            text = f"{name} is in {unit!r}, a unit of {dimension}{needs}"
            findings.refuse("log.wrong-unit", f"{text}; joint {joint.name!r} needs {wanted[joint.kind]}")
            return None
    if len(factor) not in (1, len(joints)):
        findings.refuse("log.factor-count", f"{name}: {len(factor)} factors for {len(joints)} joints")
        return None
    geared = is_motor_side(asked) and not coupled
    gear = np.array([joint.drive.gear for joint in joints]) if geared else np.ones(len(joints))
    turned = gear if name in _TORQUES else 1.0 / gear
    return np.broadcast_to(np.array(factor), (len(joints),)) * to_si * turned


def is_motor_side(asked: LogQuantity | None) -> bool:
    """Return whether the robot file says that the quantity is logged at the motor."""
    return asked is not None and asked.side == "motor"


def is_other_dimension(name: str, unit: str, joints: tuple[Joint, ...]) -> bool:
    """Return whether `unit` is none of the quantity, as a voltage is none of torque."""
    wanted = {JOINT_DIMENSIONS[name][joint.kind] for joint in joints}
    return get_unit_factor(unit)[0] not in {"SI", *wanted}


def apply_transmission(name: str, values: FloatArray, matrix: TransmissionMatrix) -> FloatArray:
    """Return what the motors do (N, n) as what the joints do: T^-1 for motions, T' for torques."""
    rows = np.array(matrix)
    turned: FloatArray = values @ rows if name in _TORQUES else np.linalg.solve(rows, values.T).T
    return np.ascontiguousarray(turned)


def describe_scale(
    name: str,
    unit: str,
    scale: FloatArray,
    asked: LogQuantity | None,
    joints: tuple[Joint, ...],
    *,
    matrix: TransmissionMatrix | None = None,
) -> str:
    """Return in words what was done to the columns, and where that comes from."""
    text = f"in {unit} was multiplied by {_list_values(scale)}"
    if matrix is not None:
        what = "the transpose" if name in _TORQUES else "the inverse"
        condition = compute_condition(matrix) or np.inf
        text += f" and {what} of the transmission matrix (motor side; its condition is {condition:.3g})"
    elif is_motor_side(asked):
        text += f" (motor side, gear included: {_list_gears(joints)})"
    else:
        text += _explain_currents(name, unit, scale, joints)
    offset = np.array(asked.offset if asked else (0.0,))
    return f"{text}; {_list_values(offset)} was added" if offset.any() else text


def _explain_currents(name: str, unit: str, scale: FloatArray, joints: tuple[Joint, ...]) -> str:
    constants = np.array([joint.drive.torque_constant or 0.0 for joint in joints])
    gears = np.array([joint.drive.gear for joint in joints])
    dimension, to_si = get_unit_factor(unit)
    known = name in _TORQUES and dimension == "current"
    if not known or not np.allclose(scale, to_si * gears * constants, 1e-12, 0):
        return ""
    return f" (torque constant {_list_values(constants)} N m/A times gear {_list_gears(joints)})"


def _list_gears(joints: tuple[Joint, ...]) -> str:
    return _list_values(np.array([joint.drive.gear for joint in joints]))


def _list_values(values: FloatArray) -> str:
    """Return the values, or the one value that all joints share."""
    shown = values if np.any(values != values[0]) else values[:1]
    return ", ".join(f"{value:.10g}" for value in shown)


def join_names(names: tuple[str, ...]) -> str:
    """Return the names in quotes, with commas between."""
    return ", ".join(map(repr, names))


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

CONTROL_QUANTITIES = ("reference", "reference_velocity", "feedforward")
"""Quantities of the controller, which a log need not have even where the robot file names their columns."""

OPTIONAL_QUANTITIES = ("velocity", "motor_position", "link_position", *CONTROL_QUANTITIES)
"""Quantities that a log need not have, unless the robot file names their columns."""


def extract_time(raw: RawLog, robot: Robot, findings: Findings) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return time (N,) in s, None if it is not there, and the names of the columns used."""
    asked = robot.log.time
    names = asked.columns if asked else _choose_default_names(raw, "time")
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


def extract_quantity(
    raw: RawLog, robot: Robot, name: str, samples: int | None, findings: Findings
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return the quantity `name` (N, n) in SI units on the joint side, and the columns used.

    None if there is no such column (a mistake, except for an optional quantity that no map asks for, and
    for those of the controller), or if it cannot be converted. `samples` is the length of the time column,
    where that is known.
    """
    asked: LogQuantity | None = getattr(robot.log, name)
    names = asked.columns if asked else _choose_default_names(raw, name)
    if name in OPTIONAL_QUANTITIES and asked is None and not _are_unclaimed(raw, robot, names):
        return None, ()
    if asked is None and not _check_joint_numbers(raw, robot, name, names, findings):
        return None, names
    lacking = [column for column in names if column not in raw.columns]
    if name in CONTROL_QUANTITIES and lacking:
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
    scale = compute_scale(name, unit, asked, robot.axes, findings, coupled=matrix is not None)
    if scale is None:
        return None, names
    offset = np.array(asked.offset if asked else (0.0,))
    moved = is_motor_side(asked) or bool(np.any(offset))
    if np.any(scale != 1.0) or moved or is_other_dimension(name, unit, robot.axes):
        text = describe_scale(name, unit, scale, asked, robot.axes, matrix=matrix)
        findings.remark("log.converted", f"{name}: {join_names(names)} {text}")
    values = array * scale
    if matrix is not None:
        values = apply_transmission(name, values, matrix)
    return (values + offset if offset.any() else values), names


def _choose_default_names(raw: RawLog, name: str) -> tuple[str, ...]:
    """Return the names under which the quantity is there; the first default name if it is not."""
    for stem in DEFAULT_NAMES[name]:
        if stem in raw.columns:
            return (stem,)
        numbered = (re.fullmatch(rf"{stem}_?(\d+)", column) for column in raw.columns)
        found = sorted((int(match[1]), match[0]) for match in numbered if match)
        if found and name != "time":
            return tuple(column for _, column in found)
    return (DEFAULT_NAMES[name][0],)


def _are_unclaimed(raw: RawLog, robot: Robot, names: tuple[str, ...]) -> bool:
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
    first = [] if robot.log.position else _list_numbers(_choose_default_names(raw, "position"))
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
    return f"{quantity}: {describe_missing_column(name, raw.columns)}"


def describe_missing_column(name: str, known: Iterable[str]) -> str:
    """Return in words that a log has no column of this name, and which it has."""
    names = tuple(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    return f"there is no column {name!r}; {hint}the log has {join_names(names) or 'no columns'}"


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
