"""Columns to quantities: located by name, converted to SI units on the joint side.

RawLog, the robot's LogMap -> arrays (N, n); a remark on every conversion, all mistakes at once.

    columns -> one column a joint -> SI (unit) -> quantity (factor) -> joint side (gear or matrix) -> zero

Supported: one column a joint, or one array with a column a joint; without a map the names of `DEFAULT_NAMES`,
numbered for single joints; logs of the motor side, by gear ratios or by the matrix of a coupled transmission;
motor currents by their torque constants.
Not supported: transmissions that depend on the position; a unit for each joint (give factors and the unit
"SI").
"""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.logs.files import DEFAULT_NAMES, RawLog
from symid.logs.recording import CONTROL_CHANNELS, OPTIONAL_CHANNELS
from symid.notation import get_unit_factor, suggest_units
from symid.robot import JOINT_DIMENSIONS, LogQuantity, Robot, TransmissionMatrix, compute_condition


@final
@dataclass(slots=True, kw_only=True)
class Findings:
    """Mistakes and remarks on the log `file`, collected while it is read."""

    file: str
    mistakes: list[Notice] = field(default_factory=list)
    remarks: list[Notice] = field(default_factory=list)

    def refuse(self, code: str, text: str) -> None:
        """Note a mistake."""
        self.mistakes.append(Notice(code=code, text=text, file=self.file))

    def remark(self, code: str, text: str) -> None:
        """Note a remark."""
        self.remarks.append(Notice(code=code, text=text, file=self.file))


_TORQUES = ("torque", "feedforward", "load")
# A factor may have any of these on the raw side: encoder counts, sensor and command voltages.
_CONVERTIBLE = ("number", "voltage", "current")


def look_up_unit(unit: str) -> tuple[str, float] | None:
    """Return dimension and factor to SI of a unit; None if there is no such unit."""
    try:
        return get_unit_factor(unit)
    except KeyError:
        return None


def choose_unit(
    raw: RawLog, names: tuple[str, ...], mapped: LogQuantity | None, standard: str, findings: Findings
) -> str:
    """Return the unit of the robot file, else that of the log, else SI; report differences."""
    stated = {raw.units[name] for name in names if name in raw.units}
    if mapped is not None:
        wanted = look_up_unit(mapped.unit)
        for unit in sorted(stated - {mapped.unit}):
            text = f"{join_names(names)}: {unit!r} in the log, {mapped.unit!r} in the robot file"
            there = look_up_unit(unit)
            if there and wanted and (there == wanted or "SI" in (there[0], wanted[0])):
                continue
            if there and wanted and there[0] != wanted[0]:
                text = f"{text}: {there[0]} is not {wanted[0]}; correct the unit in one of them"
                findings.refuse("log.unit-differs", text)
            else:
                findings.remark("log.unit-differs", f"{text}; the robot file was followed")
        return mapped.unit
    factors = {unit: look_up_unit(unit) for unit in stated}
    if None in factors.values():
        # Reported as unknown, not as different from its neighbours.
        return min(unit for unit, factor in factors.items() if factor is None)
    silent, listed = [name for name in names if name not in raw.units], ", ".join(sorted(stated))
    if stated and silent:
        text = f"no unit is stated for {join_names(silent)}, but {listed} for its neighbours"
        findings.refuse("log.mixed-units", f"{text}; state the unit of every column, or of none (SI)")
    plain = all(factor[1] == 1.0 for factor in factors.values() if factor)
    if len(stated) > 1 and standard == "SI" and plain:
        # Revolute and prismatic joints side by side, all in SI units.
        return standard
    if len(stated) > 1:
        text = f"{join_names(names)} are in different units: {listed}; use one for all"
        findings.refuse("log.mixed-units", text)
    return min(stated, default=standard)


def _read_unit(unit: str, name: str, findings: Findings) -> tuple[str, float] | None:
    """Return dimension and factor to SI of a unit; None, and a mistake noted, if there is no such unit."""
    found = look_up_unit(unit)
    if found is None:
        near = suggest_units(unit)
        hint = "leave it out if the column is in SI units"
        if near:
            hint = f"did you mean {' or '.join(map(repr, near))}?"
        findings.refuse("log.unknown-unit", f"{name}: unknown unit {unit!r}; {hint}")
    return found


def _compute_scale(
    name: str, unit: str, mapped: LogQuantity | None, robot: Robot, findings: Findings
) -> FloatArray | None:
    """Return the factor (n,) of each joint's column, with the gear of a motor side without a matrix."""
    found = _read_unit(unit, name, findings)
    if found is None:
        return None
    dimension, to_si = found
    factor = mapped.factor if mapped else (1.0,)
    wanted, joints = JOINT_DIMENSIONS[name], robot.axes
    coupled = get_matrix(robot, mapped) is not None
    for joint in joints:
        if dimension in ("SI", wanted[joint.kind]) or any(value != 1.0 for value in factor):
            continue
        if coupled and dimension in wanted.values():
            continue
        # A robot file that names such a unit states its factor, which may be 1.
        if mapped is None or dimension not in _CONVERTIBLE:
            needs = ", for which a factor is needed" if dimension in _CONVERTIBLE else ""
            text = f"{name} is in {unit!r}, a unit of {dimension}{needs}; joint {joint.name!r} needs"
            findings.refuse("log.wrong-unit", f"{text} {wanted[joint.kind]}")
            return None
    if len(factor) not in (1, len(joints)):
        findings.refuse("log.factor-count", f"{name}: {len(factor)} factors for {len(joints)} joints")
        return None
    geared = _is_motor_side(mapped) and not coupled
    gear = np.array([joint.drive.gear for joint in joints]) if geared else np.ones(len(joints))
    turned = gear if name in _TORQUES else 1.0 / gear
    return np.broadcast_to(np.array(factor), (len(joints),)) * to_si * turned


def _is_motor_side(mapped: LogQuantity | None) -> bool:
    """Return whether the robot file states that the quantity is logged at the motor."""
    return mapped is not None and mapped.side == "motor"


def get_matrix(robot: Robot, mapped: LogQuantity | None) -> TransmissionMatrix | None:
    """Return the matrix of a coupled transmission between a quantity's motors and the joints, if any."""
    return robot.log.transmission if _is_motor_side(mapped) else None


def _describe_scale(name: str, unit: str, scale: FloatArray, mapped: LogQuantity | None, robot: Robot) -> str:
    """Return in words what was done to the columns, and where that comes from."""
    text = f"in {unit} was multiplied by {_list_values(scale)}"
    gears = np.array([joint.drive.gear for joint in robot.axes])
    constants = np.array([joint.drive.torque_constant or 0.0 for joint in robot.axes])
    dimension, to_si = get_unit_factor(unit)
    motor_current = name in _TORQUES and dimension == "current"
    matrix = get_matrix(robot, mapped)
    if matrix is not None:
        what = "the transpose" if name in _TORQUES else "the inverse"
        condition = compute_condition(matrix) or np.inf
        text += f" and {what} of the transmission matrix (motor side; condition number {condition:.3g})"
    elif _is_motor_side(mapped):
        known = np.array_equal(np.abs(scale), np.abs(gears))
        text += f" (motor side, gear included{'' if known else f': {_list_values(gears)}'})"
    elif motor_current and np.allclose(scale, to_si * gears * constants, 1e-12, 0):
        text += f" (torque constant {_list_values(constants)} N m/A times gear {_list_values(gears)})"
    offset = mapped.offset if mapped else (0.0,)
    return f"{text}; {_list_values(offset)} was added" if any(offset) else text


def _list_values(values: Sequence[float] | FloatArray) -> str:
    """Return the values, or the one value that all joints share."""
    texts = [f"{value:.7g}" for value in values]
    return texts[0] if all(value == values[0] for value in values) else ", ".join(texts)


def join_names(names: Iterable[str]) -> str:
    """Return the names in quotes, with commas between."""
    return ", ".join(map(repr, names))


def extract_time(raw: RawLog, robot: Robot, findings: Findings) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return time (N,) in s, None if it cannot be read, and the names of the columns used."""
    mapped = robot.log.time
    names = mapped.columns if mapped else choose_default_names(raw, "time")
    array = _stack_columns(raw, names, "time", findings, mapped=mapped is not None)
    if array is None:
        return None, names
    standard = "s"
    if mapped is None and names[0] not in raw.units and array.shape[1] == 1:
        named = _CLOCK.fullmatch(names[0])
        standard = (named and named[1]) or _find_time_unit(array[:, 0], raw, robot, findings)
    unit = choose_unit(raw, names, mapped, standard, findings)
    found = _read_unit(unit, "time", findings)
    if found is None:
        return None, names
    if found[0] not in ("time", "SI"):
        findings.refuse("log.wrong-unit", f"time is in {unit!r}, a unit of {found[0]}; use s, ms or us")
        return None, names
    if array.shape[1] != 1:
        findings.refuse("log.time-columns", f"time has {array.shape[1]} columns, it must have one")
        return None, names
    factor = found[1] * (mapped.factor[0] if mapped else 1.0)
    if factor == 1.0:
        return array[:, 0], names
    findings.remark("log.converted", f"time: column {names[0]!r} in {unit} was multiplied by {factor:g}")
    return array[:, 0] * factor, names


_CLOCK = re.compile(r"__time|.*/time|(?i:t|time|timestamp|stamp|clock)(?:_([mun]?s(?:ec)?))?")
"""Names of a clock: of a bag, of a table that was made of one, of other programs, with the unit behind."""
_PERIODS = (2e-5, 0.5)
"""Sample periods of robots' logs, s: faster than any drive, and too slow for any motion."""
_SPEEDS = (0.02, 30.0)
"""Speeds, rad/s or m/s, of a joint that is moved to be identified: creeping, and faster than any robot."""
_ALIKE = 0.1
"""Part by which the way of a joint and the integral of its velocity may differ."""


def _find_time_unit(time: FloatArray, raw: RawLog, robot: Robot, findings: Findings) -> str:
    """Return the unit of times (N,) that state none: of periods that logs have, that in which joints move.

    A logged velocity decides, else the fastest joint's speed. Where that is not sure, or steps count samples,
    no unit is a mistake.
    """
    steps = np.diff(time[np.isfinite(time)])
    period = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    # Mistakes in them are reported elsewhere.
    position, velocity = (
        extract_quantity(raw, robot, name, len(time), Findings(file=""))[0]
        for name in ("position", "velocity")
    )
    if period * get_unit_factor("ms")[1] < _PERIODS[0] or position is None:
        return "s"
    span = max(1, len(time) // 100)
    whole = np.isfinite(position).all(axis=1) & np.isfinite(time)
    way = np.abs(position[whole][span:] - position[whole][:-span])
    if not len(way) or not way.any():
        return "s"
    speed = float(np.max(np.quantile(way, 0.95, axis=0))) / (span * period)
    units = [unit for unit in ("s", "ms", "us", "ns") if _PERIODS[0] <= period * get_unit_factor(unit)[1]]
    units = [unit for unit in units if unit == "s" or period * get_unit_factor(unit)[1] <= _PERIODS[1]]
    reason = "in it the fastest joint moves at {speed:.3g} rad/s or m/s, one sample every {step:.3g} ms"
    found = [unit for unit in units if _SPEEDS[0] <= speed / get_unit_factor(unit)[1] <= _SPEEDS[1]]
    if velocity is not None and np.isfinite(velocity[whole]).all():
        moved = np.abs(np.diff(position[whole], axis=0)).sum()
        ratio = float(moved / (0.5 * np.abs(velocity[whole][1:] + velocity[whole][:-1]).sum() * period))
        found = [unit for unit in units if abs(ratio / get_unit_factor(unit)[1] - 1.0) < _ALIKE]
        reason = "in it the logged velocity is the rate of the position"
    counter, slow = bool(np.all(steps == 1.0)), period <= _PERIODS[1]
    # Where seconds may be meant they are, unless a velocity says otherwise.
    if found == ["s"] or (slow and ("s" in found or not found)):
        return "s"
    if len(found) != 1 or (velocity is None and (slow or counter)):
        text = f"time has no unit, and its steps are {period:.6g}: state it by --set log.time.unit=ms"
        text = f"{text} (with log.time.column=NAME), or us, ns, s, or in the heading"
        if counter:
            text += "; if it counts samples, give --sample-rate HZ"
        findings.refuse("log.time-unit", text)
        return "s"
    scale = get_unit_factor(found[0])[1]
    reason = reason.format(speed=speed / scale, step=1e3 * period * scale)
    findings.remark("log.time-unit", f"time has no unit, and was taken to be in {found[0]}: {reason}")
    return found[0]


def extract_quantity(
    raw: RawLog, robot: Robot, name: str, samples: int | None, findings: Findings
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return the quantity (N, n) in SI units on the joint side, None if unreadable, and the columns used.

    A missing one is a mistake, unless it is optional and no map names it, or is of the controller.
    """
    mapped: LogQuantity | None = getattr(robot.log, name)
    names = mapped.columns if mapped else choose_default_names(raw, name)
    if mapped is None:
        entries: list[LogQuantity | None] = [getattr(robot.log, other) for other in DEFAULT_NAMES]
        claimed = {column for entry in entries if entry is not None for column in entry.columns}
        free = all(column in raw.columns and column not in claimed for column in names)
        if name in OPTIONAL_CHANNELS and not free:
            return None, ()
        numbers = _list_numbers(names)
        if name in _TORQUES and len(numbers) == len(robot.driven) < robot.freedom:
            # Numbers of joints with a motor: filled up where they are those.
            own = [place + 1 for place in robot.driven]
            numbers = list(range(1, robot.freedom + 1)) if numbers == own else numbers
        first = [] if robot.log.position else _list_numbers(choose_default_names(raw, "position"))
        text = ""
        if numbers and (numbers[0] > 1 or numbers != list(range(numbers[0], numbers[0] + len(numbers)))):
            text = f"{name}: {join_names(names)} are not numbered as 1, 2 ... or 0, 1 ..."
        elif numbers and first and first[0] in (0, 1) and first[0] != numbers[0]:
            text = f"{name} is numbered from {numbers[0]} ({join_names(names)}), position from {first[0]}"
        if text:
            findings.refuse("log.joint-numbers", f"{text}; list the columns in [log.{name}], one a joint")
            return None, names
    lacking = [column for column in names if column not in raw.columns]
    if name in CONTROL_CHANNELS and lacking:
        text = f"{_describe_missing(raw, lacking[0], name)}; log it for output error, which alone needs it"
        findings.remark("log.no-reference", text)
        return None, ()
    array = _stack_columns(raw, names, name, findings, mapped=mapped is not None)
    if array is None:
        return None, names
    if samples is not None and len(array) != samples:
        if array.shape[1] != samples:
            text = f"{name} ({join_names(names)}) has {len(array)} samples, time has {samples}"
            findings.refuse("log.unequal-length", text)
            return None, names
        findings.remark("log.transposed", f"{name}: {join_names(names)} has a row a joint and was transposed")
        array = array.T
    if name in _TORQUES and array.shape[1] == len(robot.driven) < robot.freedom:
        # Joints without a motor need no column.
        whole = np.zeros((len(array), robot.freedom))
        whole[:, list(robot.driven)] = array
        array = whole
    array = np.tile(array, (1, robot.freedom)) if name == "temperature" and array.shape[1] == 1 else array
    if array.shape[1] != robot.freedom:
        text = f"{name} has {array.shape[1]} columns ({join_names(names)}), the robot {robot.freedom} joints"
        findings.refuse("log.joint-count", text)
        return None, names
    unit = choose_unit(raw, names, mapped, "SI", findings)
    matrix, scale = get_matrix(robot, mapped), _compute_scale(name, unit, mapped, robot, findings)
    if scale is None:
        return None, names
    offset = np.array(mapped.offset if mapped else (0.0,))
    usual = {"SI", *(JOINT_DIMENSIONS[name][joint.kind] for joint in robot.axes)}
    moved = _is_motor_side(mapped) or bool(np.any(offset)) or get_unit_factor(unit)[0] not in usual
    if moved or np.any(scale != 1.0):
        text = _describe_scale(name, unit, scale, mapped, robot)
        findings.remark("log.converted", f"{name}: {join_names(names)} {text}")
    values: FloatArray = array * scale if np.any(scale != 1.0) else array
    if matrix is not None:
        # T^-1 for motions, T' for torques.
        rows = np.array(matrix)
        turned = values @ rows if name in _TORQUES else np.linalg.solve(rows, values.T).T
        values = np.ascontiguousarray(turned)
    values = values + offset if offset.any() else values
    return (_clear_passive(values, robot, name, findings) if name == "torque" else values), names


def _clear_passive(values: FloatArray, robot: Robot, name: str, findings: Findings) -> FloatArray:
    """Return torques (N, n) that are 0 where a joint has no motor; a remark where the log has others."""
    passive = list(robot.passive)
    if not passive:
        return values
    logged = [robot.axes[k].name for k in passive if values[:, k].any()]
    if logged:
        text = f"{name}: {join_names(logged)} have no motor (actuated = false), what the log has of them is "
        text += "not"
        findings.remark("log.no-motor", f"{text} used: their torque is 0")
    return np.where(np.isin(np.arange(values.shape[1]), passive), 0.0, values)


def choose_default_names(raw: RawLog, name: str) -> tuple[str, ...]:
    """Return the names under which the quantity is there; the first default name if it is not."""
    for stem in DEFAULT_NAMES[name]:
        if stem in raw.columns:
            return (stem,)
        numbered = (re.fullmatch(rf"{stem}_?(\d+)", column) for column in raw.columns)
        found = sorted((int(match[1]), match[0]) for match in numbered if match)
        if found and name != "time":
            return tuple(column for _, column in found)
    clocks = list(filter(_CLOCK.fullmatch, raw.columns)) if name == "time" else ()
    return (clocks[0] if len(clocks) == 1 else DEFAULT_NAMES[name][0],)


def has_default_columns(raw: RawLog, quantities: Iterable[str]) -> bool:
    """Return whether all the quantities are there under the names that they have without a map."""
    return all(choose_default_names(raw, name)[0] in raw.columns for name in quantities)


def _list_numbers(names: tuple[str, ...]) -> list[int]:
    """Return the numbers at the end of names such as q1, q2; none of names without a number."""
    matches = [re.fullmatch(r"[a-z]+_?(\d+)", name) for name in names]
    return [int(match[1]) for match in matches if match]


def _stack_columns(
    raw: RawLog, names: tuple[str, ...], quantity: str, findings: Findings, *, mapped: bool
) -> FloatArray | None:
    """Return the columns of a quantity (N, k); None, and mistakes noted, where there is no such array."""
    missing = [name for name in names if name not in raw.columns]
    stems, option = DEFAULT_NAMES[quantity], "column=NAME"
    if quantity != "time":
        stems = tuple(f"{stem} or {stem}1, {stem}2 ..." for stem in stems)
        option = f"columns=NAME,NAME --set log.{quantity}.unit=UNIT"
    hint = f"; without [log.{quantity}] it must be named {' or '.join(stems)}; else use --set log.{quantity}."
    for name in missing:
        text = _describe_missing(raw, name, quantity)
        text = text if mapped else f"{text}{hint}{option}"
        remedy = "; a log without times is read by --sample-rate HZ" if quantity == "time" else ""
        findings.refuse("log.missing-column", f"{text}{remedy}")
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
        large = next((entry.text for entry in raw.notices if entry.code == "log.too-large"), "")
        if repr(name) in large:
            return f"{quantity}: {large}"
        return f"{quantity}: column {name!r} of the log does not hold real numbers"
    return f"{quantity}: {describe_missing_column(name, raw.columns)}"


def describe_missing_column(name: str, known: Iterable[str]) -> str:
    """Return in words that a log has no column of this name, and which it has."""
    names = tuple(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    return f"there is no column {name!r}; {hint}the log has {join_names(names) or 'no columns'}"
