"""From a recording to a log file that `read_recording` reads without a `[log]` map, or from raw columns.

Input: `Recording` and the robot, or `RawLog`. Output: a .npz or .csv file, written whole or not at all.

Supported: time, position, torque, and velocity, second encoder and the controller's reference where there are
such, in SI units with the units stated.
Not supported: extras; they belong to the file they were read from.
"""

import csv
import io
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np

from symid.arrays import FloatArray
from symid.data.npz_file import UNITS
from symid.data.recording import Recording
from symid.data.table import RawLog
from symid.errors import Notice, OutputError
from symid.notation import find_unit
from symid.paths import check_suffix
from symid.robot.description import JointKind, Robot

__all__ = ["write_log", "write_recording"]

_LIKE = {"link_position": "q", "q_ref": "q", "dq_ref": "dq", "tau_ff": "tau"}
"""Columns that have the units of others."""
_MODE = 0o644
"""Rights of a log, less those that the user's umask withholds; temporary files have fewer."""


def write_recording(recording: Recording, path: Path, robot: Robot) -> Path:
    """Write the recording to `path` (.npz or .csv), in place of an older file; return the path.

    Raises:
        OutputError: the suffix is another one, or the folder cannot be written.
    """
    writers = {".npz": _write_npz, ".csv": _write_csv}
    writer = writers[check_suffix(path, "a log", writers)]
    return _write_whole(path, lambda stream: writer(stream, recording, robot))


def write_log(raw: RawLog, path: Path) -> Path:
    """Write columns as they were logged, with their names and units, to `path` (.npz or .csv).

    Raises:
        OutputError: the suffix is another one, a column does not fit into a line of a .csv, or the folder
            cannot be written.
    """
    writers = {".npz": _write_raw_npz, ".csv": _write_raw_csv}
    writer = writers[check_suffix(path, "a log", writers)]
    shapes = {values.shape for values in raw.columns.values()}
    if writer is _write_raw_csv and (len(shapes) > 1 or any(len(shape) > 1 for shape in shapes)):
        text = "a .csv holds columns of one number a sample; this log has arrays or columns of other lengths"
        raise OutputError(Notice(code="output.no-table", text=f"{text}: write it as .npz", file=str(path)))
    return _write_whole(path, lambda stream: writer(stream, raw))


def _write_whole(path: Path, write: Callable[[IO[bytes]], None]) -> Path:
    """Write the file whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                write(stream)
            Path(temporary).chmod(_MODE & ~_read_umask())
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        text = f"the log cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.unwritable", text=text, file=str(path))) from error
    return path


def _read_umask() -> int:
    """Return the rights that this process withholds; they can only be read by setting them."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _list_quantities(recording: Recording) -> list[tuple[str, FloatArray]]:
    found = [("q", recording.position), ("tau", recording.torque)]
    if recording.velocity is not None:
        found.insert(1, ("dq", recording.velocity))
    if recording.motor_position is not None:
        found.append(("theta", recording.motor_position))
    for name, values in (
        ("link_position", recording.link_position),
        ("q_ref", recording.reference),
        ("dq_ref", recording.reference_velocity),
        ("tau_ff", recording.feedforward),
    ):
        if values is not None:
            found.append((name, values))
    return found


def _find_units(name: str, robot: Robot) -> tuple[str, ...]:
    name = _LIKE.get(name, name)
    return tuple(find_unit(name, prismatic=joint.kind is JointKind.PRISMATIC) for joint in robot.axes)


def _write_npz(stream: IO[bytes], recording: Recording, robot: Robot) -> None:
    arrays: dict[str, np.ndarray] = {"t": recording.time}
    headings = ["t [s]"]
    for name, values in _list_quantities(recording):
        arrays[name] = values
        units = set(_find_units(name, robot))
        headings.append(f"{name} [{units.pop() if len(units) == 1 else 'SI'}]")
    arrays[UNITS] = np.array(headings)
    # Arrays go one by one: savez dates its members, and the same recording must give the same bytes.
    _write_archive(stream, arrays)


def _write_raw_npz(stream: IO[bytes], raw: RawLog) -> None:
    arrays: dict[str, np.ndarray] = dict(raw.columns)
    if raw.units:
        arrays[UNITS] = np.array([f"{name} [{unit}]" for name, unit in raw.units.items()])
    _write_archive(stream, arrays)


def _write_raw_csv(stream: IO[bytes], raw: RawLog) -> None:
    headings = [f"{name} [{raw.units[name]}]" if name in raw.units else name for name in raw.columns]
    _write_table(stream, headings, np.stack(list(raw.columns.values()), axis=1))


def _write_archive(stream: IO[bytes], arrays: dict[str, np.ndarray]) -> None:
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.ascontiguousarray(values), allow_pickle=False)


def _write_csv(stream: IO[bytes], recording: Recording, robot: Robot) -> None:
    headings, columns = ["t [s]"], [recording.time[:, None]]
    for name, values in _list_quantities(recording):
        units = _find_units(name, robot)
        headings += [f"{name}{number} [{unit}]" for number, unit in enumerate(units, 1)]
        columns.append(values)
    _write_table(stream, headings, np.hstack(columns))


def _write_table(stream: IO[bytes], headings: list[str], values: FloatArray) -> None:
    with io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True) as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(headings)
        writer.writerows([repr(value) for value in row] for row in values.tolist())
