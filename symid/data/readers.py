"""From a log file to a recording, in SI units, on the joint side.

Input: a path, the robot whose `[log]` map says which column is what. Output: `Recording`.

    file -> raw columns (by suffix) -> quantities -> checked -> Recording

Supported: .mat, .npz, .csv and .txt with a heading line, .h5 and .hdf5 where h5py is installed.
Not supported: Parquet, rosbags.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray
from symid.data.csv_file import read_csv
from symid.data.findings import Findings
from symid.data.hdf5_file import read_hdf5
from symid.data.mat_file import read_mat
from symid.data.npz_file import read_npz
from symid.data.presets import apply_preset
from symid.data.quantities import CONTROL, find_quantity, find_time
from symid.data.recording import Recording
from symid.data.signals import describe_too_short, describe_uneven, find_least_samples, settle_processing
from symid.data.table import RawLog, refuse_file
from symid.errors import LogError
from symid.robot.description import Robot
from symid.robot.log_map import Processing

__all__ = ["READERS", "read_raw", "read_recording"]

READERS: dict[str, Callable[[Path], RawLog]] = {
    ".mat": read_mat,
    ".npz": read_npz,
    ".csv": read_csv,
    ".txt": read_csv,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
}
"""Which reader a suffix gets."""

_ENCODERS = ("motor_position", "link_position")

_LARGEST = 1e100
"""Of what a sensor can have measured; squares of larger values overflow."""


def read_recording(path: Path, robot: Robot, *, uneven: bool = False) -> Recording:
    """Return the recording in the log at `path`, as the robot's `[log]` map reads it.

    Args:
        path: a file with one of the suffixes of `READERS`.
        robot: its `[log]` map says which column is what.
        uneven: whether times may be uneven, repeat or run backwards, for those that look at them.

    Raises:
        LogError: the file cannot be read, or its columns cannot be used; all that is wrong is said.
    """
    raw = read_raw(path)
    findings = Findings(file=str(path))
    robot = apply_preset(raw, robot, findings)
    time, used = find_time(raw, robot, findings)
    samples = None if time is None else len(time)
    values: dict[str, FloatArray | None] = {}
    columns: dict[str, tuple[str, ...]] = {}
    for name in ("position", "velocity", "torque", *_ENCODERS, *CONTROL):
        values[name], columns[name] = find_quantity(raw, robot, name, samples, findings)
    if values["position"] is None:
        _explain_side(columns, findings)
    # A velocity stops nothing: no stage uses it. What a controller was asked to do, few stages.
    needed = (column for name in ("position", "torque", *_ENCODERS) for column in columns[name])
    _check_numbers(raw, (*used, *needed), findings)
    _check_encoders(columns, findings)
    if time is not None and not uneven:
        _check_time(time, robot.processing, findings)
    position, torque = values["position"], values["torque"]
    # What is missing is among the mistakes.
    if findings.mistakes or time is None or position is None or torque is None:
        raise LogError(*findings.mistakes)
    known = {*used, *(name for names in columns.values() for name in names)}
    unused = tuple(name for name in raw.columns if name not in known)
    _remark_unused((*unused, *raw.others), columns["velocity"], findings)
    return Recording(
        time=time,
        position=position,
        velocity=values["velocity"],
        motor_position=values["motor_position"],
        link_position=values["link_position"],
        reference=values["reference"],
        reference_velocity=values["reference_velocity"],
        feedforward=values["feedforward"],
        torque=torque,
        source=str(path),
        notices=tuple(findings.remarks),
        extras={name: raw.columns[name] for name in unused},
    )


def _explain_side(columns: dict[str, tuple[str, ...]], findings: Findings) -> None:
    """Say what the one position of a log is good for, where it has that of one side alone."""
    motor, link = (columns[name] for name in _ENCODERS)
    if motor and not link:
        text = (
            f"the log has the positions of the motors ({', '.join(motor)}) and none of the links: name these "
            "columns in [log.position], for what the motor side alone can tell"
        )
        findings.refuse("log.one-side", text)
    if link and not motor:
        text = (
            f"the log has the positions of the links ({', '.join(link)}) and none of the motors, with which "
            "friction and rotors of elastic joints turn: add those of the motors; where joints are rigid, "
            "name these columns in [log.position]"
        )
        findings.refuse("log.one-side", text)


def _check_encoders(columns: dict[str, tuple[str, ...]], findings: Findings) -> None:
    """Refuse a log whose positions have two second encoders, or one that is the first one again."""
    motor, link = (columns[name] for name in _ENCODERS)
    if motor and link:
        text = (
            f"the log has motor positions ({', '.join(motor)}) and link positions ({', '.join(link)}) "
            f"besides its positions ({', '.join(columns['position'])}), which must be one of the two: "
            "name the columns of the links in [log.position] and those of the motors in "
            "[log.motor_position], or those of the motors in [log.position] and those of the links in "
            "[log.link_position]; rename what is left over"
        )
        findings.refuse("log.two-encoders", text)
    for name in _ENCODERS:
        if columns[name] and columns[name] == columns["position"]:
            text = f"{name} and position are the same columns ({', '.join(columns[name])})"
            remedy = (
                "name the columns of the motors in [log.position]; where joints are rigid, leave it out"
                if name == "link_position"
                else "leave it out"
            )
            findings.refuse("log.same-encoder", f"{text}: one encoder tells no torsion; {remedy}")


def _remark_unused(names: tuple[str, ...], velocity: tuple[str, ...], findings: Findings) -> None:
    parts = [f"columns that were not used: {', '.join(names)}"] if names else []
    if velocity:
        text = "velocity was read but is not used: velocities come from the filtered position"
        parts.append(f"{text} (columns {', '.join(velocity)})")
    if parts:
        findings.remark("log.unused-columns", "; ".join(parts))


def read_raw(path: Path) -> RawLog:
    """Return the columns of the log at `path` as they stand in it.

    Raises:
        LogError: the file cannot be read.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        found = f"{path.suffix!r}" if path.suffix else "no suffix"
        raise refuse_file(str(path), f"a log must be one of {known}, got {found}", "log.unknown-suffix")
    if not path.exists():
        raise refuse_file(str(path), "there is no such file", "log.no-such-file")
    if not path.is_file():
        raise refuse_file(str(path), "this is a folder, not a log", "log.unreadable")
    try:
        return reader(path)
    except PermissionError as error:
        raise refuse_file(str(path), "the file may not be read (no permission)") from error


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
                f"{name!r} holds {len(bad)} values that are no numbers (NaN, infinite, beyond {_LARGEST:g}); "
                f"the first at {place}"
            )
            findings.refuse("log.not-finite", f"{text}, counted from 0; cut or repair the log there")


def _check_time(time: FloatArray, processing: Processing, findings: Findings) -> None:
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        at = int(back[0])
        text = (
            f"time must grow: sample {at + 1} (counted from 0) is at {time[at + 1]:.9g} s, the one before it"
        )
        more = f"; {len(back)} steps are like that" if len(back) > 1 else ""
        findings.refuse("log.time-order", f"{text} at {time[at]:.9g} s{more}")
    elif len(steps) and np.all(np.isfinite(steps)):
        uneven = describe_uneven(time, file=findings.file)
        if uneven is not None:
            findings.mistakes.append(uneven)
    span = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if span > 0.0 and np.isfinite(span):
        processing = settle_processing(processing, span / (len(time) - 1))
    if len(time) < find_least_samples(processing):
        findings.mistakes.append(describe_too_short(len(time), processing, file=findings.file))
