"""Trajectories as text files: what a controller is fed with, and `symid simulate` follows.

Input: a trajectory, a rate. Output: a CSV file with the columns t, q1.., dq1.., ddq1.. and their units, under
lines that begin with # and say what it is; and the motion that such a file holds.

Supported: columns in any unit of the table, in any order; files without dq and ddq, whose samples must then
be close enough for a spline of fifth degree.
Not supported: waypoints, which state no motion between them.
"""

import csv
import io
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray
from symid.data.csv_file import read_csv
from symid.data.table import RawLog
from symid.errors import LogError, Notice, OutputError
from symid.excitation.motion import Motion, SampledMotion
from symid.notation import find_unit
from symid.paths import check_suffix
from symid.robot.description import JointKind, Robot
from symid.units import find_unit_factor

__all__ = ["read_trajectory", "write_trajectory"]

_QUANTITIES = ("q", "dq", "ddq")
_FEWEST = 8
"""Samples below which a file is a list of waypoints."""
_MODE = 0o644


def write_trajectory(
    motion: Motion, path: Path, robot: Robot, *, rate: float, periods: int = 1, remarks: Sequence[str] = ()
) -> int:
    """Write the states of a motion, its last one included, and return the number of samples.

    Args:
        motion: periodic, where it is to run more than once.
        path: replaced as a whole, or left as it is.
        robot: names and kinds of the joints.
        rate: samples a second, Hz.
        periods: how often it runs.
        remarks: lines for people, written first.

    Raises:
        OutputError: it is no .csv, or cannot be written.
    """
    check_suffix(path, "a trajectory", (".csv",))
    count = round(motion.duration * rate)
    times = np.arange(count * periods + 1) / rate
    # The same samples in every period, bit by bit.
    phases = (np.arange(count * periods + 1) % count) / rate
    if periods == 1:
        phases = times
    table = np.hstack([times[:, None], *motion.evaluate(phases)])
    headings = ["t [s]"]
    for name in _QUANTITIES:
        units = (find_unit(name, prismatic=joint.kind is JointKind.PRISMATIC) for joint in robot.axes)
        headings += [f"{name}{number} [{unit}]" for number, unit in enumerate(units, 1)]
    text = io.StringIO()
    text.writelines(f"# {' '.join(remark.split())}\n" for remark in remarks)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows([repr(value) for value in row] for row in table.tolist())
    _replace(path, text.getvalue())
    return len(times)


def _replace(path: Path, text: str) -> None:
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="") as stream:
                stream.write(text)
            Path(temporary).chmod(_MODE & ~_read_umask())
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        text = f"the trajectory cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.unwritable", text=text, file=str(path))) from error


def _read_umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def read_trajectory(path: Path, robot: Robot) -> SampledMotion:
    """Return the motion that the file at `path` holds, its times from zero.

    Raises:
        LogError: with what is wrong with the file.
    """
    raw = read_csv(path)
    problems: list[str] = []
    time = _read_column(raw, "t", robot, problems)
    stated = {name: _read_quantity(raw, name, robot, problems) for name in _QUANTITIES}
    if stated["q"] is None and not problems:
        problems.append(f"columns q1 to q{robot.freedom} are needed, one a joint, and t")
    if time is not None and not problems:
        problems += _find_time_problems(time)
    position, velocity, acceleration = stated["q"], stated["dq"], stated["ddq"]
    if time is None or position is None or problems:
        notices = (Notice(code="excitation.trajectory", text=text, file=str(path)) for text in problems)
        raise LogError(*notices)
    start = time - time[0]
    if velocity is None or acceleration is None:
        velocity, acceleration = _differentiate(start, position)
    return SampledMotion(
        time=start,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        source=f"trajectory {path.name}",
    )


def _find_time_problems(time: FloatArray) -> list[str]:
    if len(time) < _FEWEST:
        return [f"{len(time)} samples are no trajectory; at least {_FEWEST} are needed"]
    steps = np.diff(time)
    if not np.all(steps > 0.0):
        return [f"the time does not increase after sample {int(np.argmin(steps > 0.0)) + 1}"]
    return []


def _read_quantity(raw: RawLog, name: str, robot: Robot, problems: list[str]) -> FloatArray | None:
    """Return all columns of a quantity (N, n), None where the file has none of them."""
    names = [f"{name}{number}" for number in range(1, robot.freedom + 1)]
    more = f"{name}{robot.freedom + 1}"
    if more in raw.columns:
        problems.append(f"column {more}: the robot has {robot.freedom} joints")
        return None
    if not any(column in raw.columns for column in names):
        return None
    columns = [_read_column(raw, column, robot, problems) for column in names]
    return (
        np.column_stack([column for column in columns if column is not None])
        if all(column is not None for column in columns)
        else None
    )


def _read_column(raw: RawLog, name: str, robot: Robot, problems: list[str]) -> FloatArray | None:
    """Return a column in SI units."""
    if name not in raw.columns:
        problems.append(f"column {name} is missing; there are {', '.join(raw.columns)}")
        return None
    kind = name.rstrip("0123456789")
    number = name[len(kind) :]
    prismatic = bool(number) and robot.axes[int(number) - 1].kind is JointKind.PRISMATIC
    standard = find_unit(kind, prismatic=prismatic)
    unit = raw.units.get(name, standard)
    try:
        dimension, factor = find_unit_factor(unit)
    except KeyError:
        problems.append(f"column {name}: no such unit as {unit!r}; write it in {standard}")
        return None
    if unit != "SI" and dimension != find_unit_factor(standard)[0]:
        problems.append(f"column {name}: {unit} is no unit of {find_unit_factor(standard)[0]}")
        return None
    values = raw.columns[name]
    if not np.all(np.isfinite(values)):
        problems.append(f"column {name}: sample {int(np.argmin(np.isfinite(values))) + 1} is missing")
        return None
    return factor * values


def _differentiate(time: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return velocity and acceleration of the spline of fifth degree through the positions."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(time, position, k=5)
    return np.asarray(spline(time, 1), dtype=np.float64), np.asarray(spline(time, 2), dtype=np.float64)
