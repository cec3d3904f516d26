"""From a log file to a recording.

Path, Robot (its `[log]` map says which column is what) -> Recording.

    file -> raw columns (by suffix) -> preset names -> quantities in SI units -> checked -> Recording

Supported: the suffixes of `READERS`; presets, the column names of rostopic, bagpy and PlotJuggler ("ros"),
ur_rtde, libfranka and symid, with joints in the order of the robot file, PlotJuggler's by name.
Not supported: Parquet, rosbags; JointState messages whose order of joints changes within a log.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.errors import LogError
from symid.logs.columns import Findings, extract_quantity, extract_time, get_torque_transmission
from symid.logs.files import RawLog, build_file_error, read_csv, read_hdf5, read_mat, read_npz
from symid.logs.recording import OPTIONAL_CHANNELS, Recording
from symid.logs.signals import choose_processing, compute_least_samples, describe_too_short, describe_uneven
from symid.robot import Joint, LogQuantity, Processing, Robot, compute_current_factor

_TIMES = {
    "ros": {"%time": "ns", "Time": "s", "__time": "s", "time": "s"},
    "ur-rtde": {"timestamp": "s"},
    "franka": {"time": "ms", "duration": "ms"},
}
"""Names and units of the time of each program."""
_LAYOUTS: dict[str, dict[str, tuple[str, ...]]] = {
    "ros": {
        "position": ("field.position{k}", "position_{k}", "*/{joint}/position", "{joint}_position"),
        "velocity": ("field.velocity{k}", "velocity_{k}", "*/{joint}/velocity", "{joint}_velocity"),
        "torque": ("field.effort{k}", "effort_{k}", "*/{joint}/effort", "{joint}_effort"),
    },
    "ur-rtde": {
        "position": ("actual_q_{k}",),
        "velocity": ("actual_qd_{k}",),
        "torque": ("actual_current_{k}",),
    },
    "franka": {
        "position": ("state.q[{k}]", "q[{k}]"),
        "velocity": ("state.dq[{k}]", "dq[{k}]"),
        "torque": ("state.tau_J[{k}]", "tau_J[{k}]"),
    },
}
"""Names of its other columns: `{k}` counts from 0, `{joint}` is the joint's name, * any topic."""


def apply_preset(raw: RawLog, robot: Robot, findings: Findings) -> Robot:
    """Return the robot with the columns of its preset in the `[log]` map; as it is where it has none."""
    log, preset = robot.log, robot.log.preset or ""
    if preset not in _LAYOUTS:
        return robot
    time = next((name for name in _TIMES[preset] if name in raw.columns), None)
    if log.time is None and time is not None:
        log = replace(log, time=LogQuantity(columns=(time,), unit=_TIMES[preset][time]))
    found: dict[str, Any] = {}
    for name, patterns in _LAYOUTS[preset].items():
        columns = _match_columns(raw, patterns, robot.axes)
        if getattr(log, name) is not None or (columns is None and name == "velocity"):
            continue
        if columns is None:
            wanted = " or ".join(", ".join(_list_names(entry, robot.axes)[:2]) for entry in patterns)
            text = f"{name}: preset {preset!r} needs {wanted} ... of every joint, which the log lacks"
            findings.refuse("log.preset", f"{text}; name the columns in [log.{name}]")
        elif name == "torque" and preset == "ur-rtde":
            found[name] = _convert_currents(columns, "A", robot, findings)
        else:
            found[name] = LogQuantity(columns=columns, unit="SI")
    return replace(robot, log=replace(log, **found))


def _list_names(pattern: str, joints: Sequence[Joint]) -> tuple[str, ...]:
    return tuple(pattern.format(k=index, joint=joint.name) for index, joint in enumerate(joints))


def _match_columns(raw: RawLog, patterns: tuple[str, ...], joints: Sequence[Joint]) -> tuple[str, ...] | None:
    """Return the columns of the first pattern that has one for every joint."""
    for pattern in patterns:
        names = _list_names(pattern, joints)
        if pattern.startswith("*"):
            hits = [[name for name in raw.columns if name.endswith(ending[1:])] for ending in names]
            names = tuple(hit[0] if len(hit) == 1 else "" for hit in hits)
        if all(name in raw.columns for name in names):
            return names
    return None


def _convert_currents(columns: tuple[str, ...], unit: str, robot: Robot, findings: Findings) -> LogQuantity:
    """Return the quantity for motor currents, by the torque constants of the robot file."""
    lacking = [joint.name for joint in robot.axes if joint.drive.torque_constant is None]
    if lacking:
        text = (
            f"torque: {columns[0]!r} ... are motor currents, but joint {lacking[0]!r} has no torque_constant "
            "(N m/A) in its drive; add it, and the gear ratio"
        )
        findings.refuse("log.no-torque-constant", text)
    coupled = robot.log.transmission is not None
    factor = compute_current_factor(robot.axes, coupled=coupled) or (1.0,)
    return LogQuantity(columns=columns, unit=unit, factor=factor, side="motor" if coupled else "joint")


READERS: dict[str, Callable[[Path], RawLog]] = {
    ".mat": read_mat,
    ".npz": read_npz,
    ".csv": read_csv,
    ".txt": read_csv,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
}
"""Readers by suffix."""

_ENCODERS = ("motor_position", "link_position")
_GAPLESS = ("position", "torque", *_ENCODERS, "load", "temperature")

_LARGEST = 1e100
"""Largest value of a sensor; squares of larger ones overflow."""


def read_recording(path: Path, robot: Robot, *, uneven: bool = False, raw: RawLog | None = None) -> Recording:
    """Return the recording in a log, or raise a LogError with all mistakes.

    `robot`: its `[log]` map says which column is what; `uneven`: whether times may be uneven, repeat or run
    backwards; `raw`: the columns of the file, where they were read before.
    """
    raw = raw or read_raw(path)
    findings = Findings(file=str(path))
    robot = apply_preset(raw, robot, findings)
    time, used = extract_time(raw, robot, findings)
    samples = None if time is None else len(time)
    values: dict[str, FloatArray | None] = {}
    columns: dict[str, tuple[str, ...]] = {}
    for name in ("position", "torque", *OPTIONAL_CHANNELS):
        values[name], columns[name] = extract_quantity(raw, robot, name, samples, findings)
    # Holes in a velocity or an acceleration are accepted, states then come from the position; so are those
    # of a controller's channels.
    needed = (column for name in _GAPLESS for column in columns[name])
    _check_numbers(raw, (*used, *needed), findings)
    _check_encoders(columns, findings, no_position=values["position"] is None)
    if time is not None and not uneven:
        _check_time(time, robot.processing, findings)
    position, torque = values["position"], values["torque"]
    if findings.mistakes or time is None or position is None or torque is None:
        raise LogError(*findings.mistakes)
    known = {*used, *(name for names in columns.values() for name in names)}
    unused = tuple(name for name in raw.columns if name not in known)
    left_out = ", ".join((*unused, *raw.others))
    parts = [f"columns that were not used: {left_out}"] if left_out else []
    for name in ("velocity", "acceleration"):
        if columns[name]:
            text = f"{name} was read; it is used where it predicts better than the filtered position"
            parts.append(f"{text} (columns {', '.join(columns[name])})")
    if parts:
        findings.remark("log.unused-columns", "; ".join(parts))
    channels: dict[str, Any] = {name: values[name] for name in OPTIONAL_CHANNELS}
    return Recording(
        time=time,
        position=position,
        torque=torque,
        **channels,
        source=str(path),
        notices=tuple(findings.remarks),
        extras={name: raw.columns[name] for name in unused},
        transmission=get_torque_transmission(robot),
    )


def _check_encoders(columns: dict[str, tuple[str, ...]], findings: Findings, *, no_position: bool) -> None:
    """Refuse second encoders without a first one, of both sides, or equal to the first one."""
    motor, link = (columns[name] for name in _ENCODERS)
    if no_position and motor and not link:
        text = (
            f"the log has motor positions ({', '.join(motor)}) but no link positions; name these columns in "
            "[log.position] to identify what the motor side alone shows"
        )
        findings.refuse("log.one-side", text)
    if no_position and link and not motor:
        text = (
            f"the log has link positions ({', '.join(link)}) but no motor positions, on which friction and "
            "rotors of elastic joints depend; add them, or, where joints are rigid, name these columns in "
            "[log.position]"
        )
        findings.refuse("log.one-side", text)
    if motor and link:
        text = (
            f"the log has motor positions ({', '.join(motor)}) and link positions ({', '.join(link)}) "
            f"besides its positions ({', '.join(columns['position'])}); name the link columns in "
            "[log.position] and the motor columns in [log.motor_position], or the motor columns in "
            "[log.position] and the link columns in [log.link_position], and rename the third"
        )
        findings.refuse("log.two-encoders", text)
    for name in _ENCODERS:
        if columns[name] and columns[name] == columns["position"]:
            shown = ", ".join(columns[name])
            text = f"{name} and position are the same columns ({shown}), torsion is unknown"
            remedy = "leave it out"
            if name == "link_position":
                remedy = "name the motor columns in [log.position]; where joints are rigid, leave it out"
            findings.refuse("log.same-encoder", f"{text}; {remedy}")


def read_raw(path: Path) -> RawLog:
    """Return the columns of the log at `path` as they stand in it, or raise a LogError."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        found = repr(path.suffix) if path.suffix else "no suffix"
        text = f"a log must be one of {', '.join(READERS)}, got {found}"
        raise build_file_error(path, text, "log.unknown-suffix")
    if not path.exists():
        raise build_file_error(path, "there is no such file", "log.no-such-file")
    if not path.is_file():
        raise build_file_error(path, "this is a folder, not a log", "log.unreadable")
    try:
        return reader(path)
    except PermissionError as error:
        raise build_file_error(path, "the file may not be read (no permission)", "log.unreadable") from error


def _check_numbers(raw: RawLog, used: tuple[str, ...], findings: Findings) -> None:
    for name in dict.fromkeys(used):
        column = raw.columns.get(name)
        if column is None:
            continue
        bad = np.argwhere(~(np.abs(np.atleast_1d(column)) <= _LARGEST))
        if len(bad):
            first = int(bad[0, 0])
            place = f"sample {first}" + (f", column {int(bad[0, 1])}" if bad.shape[1] > 1 else "")
            text = (
                f"{name!r} has {len(bad)} values that are not finite numbers (NaN, infinite, beyond "
                f"{_LARGEST:g}), the first at {place} (counted from 0); cut or repair the log there"
            )
            findings.refuse("log.not-finite", text)


def _check_time(time: FloatArray, processing: Processing, findings: Findings) -> None:
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        at = int(back[0])
        text = (
            f"time must increase: sample {at + 1} (counted from 0) is at {time[at + 1]:.9g} s, the one "
            f"before at {time[at]:.9g} s"
        )
        findings.refuse("log.time-order", f"{text}; {len(back)} such steps" if len(back) > 1 else text)
    elif len(steps) and np.all(np.isfinite(steps)):
        uneven = describe_uneven(time, file=findings.file)
        if uneven is not None:
            findings.mistakes.append(uneven)
    span = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if span > 0.0 and np.isfinite(span):
        processing = choose_processing(processing, span / (len(time) - 1))
    if len(time) < compute_least_samples(processing):
        findings.mistakes.append(describe_too_short(len(time), processing, file=findings.file))
