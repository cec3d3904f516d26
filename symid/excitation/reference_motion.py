"""The motion that an experiment follows: by name, from a file, or from samples; and its file.

Robot, a name ("fourier", "ta", "tb", "tc"), the path of a file, or a motion -> ReferenceMotion. A motion, a
rate -> CSV file with the columns t, q1.., dq1.., ddq1.. and their units, below remarks that begin with #.
Samples -> SampledMotion, polynomials of fifth degree between samples, with q, dq, ddq continuous and exact at
them:

    q(t) = sum_k H_k(s) h^k q_left^(k) + H_k(1 - s) (-h)^k q_right^(k),   s = (t - t_left) / h,  k = 0, 1, 2

Supported: samples at any increasing times; file columns in any unit, in any order; files without dq and ddq,
whose samples must then be close enough for a spline of fifth degree.
Not supported: times outside the samples, where the ends are held; waypoints.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays
from symid.environment import check_suffix, write_file
from symid.errors import LogError, Notice, UsageError
from symid.excitation.trajectories import (
    FourierOptions,
    Trajectory,
    build_random_fourier,
    build_ta,
    build_tb,
    build_tc,
    scale_trajectory,
)
from symid.logs import RawLog, read_csv
from symid.notation import get_unit, get_unit_factor
from symid.robot import JointKind, Robot

# H_0, H_1, H_2: coefficients of s^0 to s^5; each has one derivative at s = 0 and none at s = 1.
_HERMITE = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMotion(FrozenArrays):
    """A motion given by its states.

    Args:
        time: (N,) s, from zero, increasing. position, velocity, acceleration: (N, n) rad or m, /s, /s^2.
        source: its name in messages.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    source: str

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.position[0])

    @property
    def duration(self) -> float:
        """Return the time of the last sample, s."""
        return float(self.time[-1])

    def evaluate(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq, ddq, each (N, n) in rad or m, /s, /s^2, at `times` (N,) in s."""
        q, dq, ddq = self.evaluate_derivatives(times, 2)
        return q, dq, ddq

    def evaluate_derivatives(self, times: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Return q and its time derivatives up to `order`, (N, n) in rad or m, /s, ..., at `times` (N,) in s.

        From the third on they jump at the samples. Beyond the ends the first or last state is held.
        """
        t = np.clip(np.asarray(times, dtype=np.float64), self.time[0], self.time[-1])
        left = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        h = self.time[left + 1] - self.time[left]
        s = (t - self.time[left]) / h
        given = (self.position, self.velocity, self.acceleration)
        found = []
        for derivative in range(order + 1):
            total = np.zeros((len(t), self.size))
            for k, values in enumerate(given):
                near, far = _evaluate_hermite(k, derivative, s), _evaluate_hermite(k, derivative, 1.0 - s)
                factor = h ** (k - derivative)
                sign = -1.0 if (k + derivative) % 2 else 1.0
                if k == 0:
                    # H_0(s) + H_0(1 - s) is one: rounding of a pose must not show in its derivatives.
                    total += (sign * factor * far)[:, None] * (values[left + 1] - values[left])
                    total += 0.0 if derivative else values[left]
                    continue
                total += (factor * near)[:, None] * values[left]
                total += (sign * factor * far)[:, None] * values[left + 1]
            found.append(total)
        return tuple(found)


ReferenceMotion = Trajectory | SampledMotion


def _evaluate_hermite(k: int, derivative: int, s: FloatArray) -> FloatArray:
    """Return the derivative of H_k by s."""
    shape = np.polynomial.Polynomial(_HERMITE[k])
    result: FloatArray = (shape.deriv(derivative) if derivative else shape)(s)
    return result * np.ones_like(s)


_QUANTITIES = ("q", "dq", "ddq")
_FEWEST = 8
"""Fewest samples of a trajectory."""


def write_trajectory(
    motion: ReferenceMotion,
    path: Path,
    robot: Robot,
    *,
    rate: float,
    periods: int = 1,
    remarks: Sequence[str] = (),
) -> int:
    """Write the states of a motion, its last one included, to a .csv, and return the number of samples.

    `rate` in Hz; the motion is periodic where `periods`, the number of runs, is more than one; `remarks` are
    the first lines of the file. An OutputError if it is no .csv, or cannot be written.
    """
    check_suffix(path, "a trajectory", (".csv",))
    count = round(motion.duration * rate)
    steps = np.arange(count * periods + 1)
    times = steps / rate
    # The same samples in every period, bit by bit.
    phases = times if periods == 1 else (steps % count) / rate
    table = np.hstack([times[:, None], *motion.evaluate(phases)])
    headings = ["t [s]"]
    for name in _QUANTITIES:
        units = (get_unit(name, prismatic=joint.kind is JointKind.PRISMATIC) for joint in robot.axes)
        headings += [f"{name}{number} [{unit}]" for number, unit in enumerate(units, 1)]
    text = io.StringIO()
    text.writelines(f"# {' '.join(remark.split())}\n" for remark in remarks)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows([repr(value) for value in row] for row in table.tolist())
    write_file(path, text.getvalue(), what="the trajectory")
    return len(times)


def is_trajectory(path: Path) -> bool:
    """Return whether a file is the .csv of a trajectory: columns t, q1 and so on, and no torque."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    names = [name.split(" ")[0] for name in read_csv(path).columns]
    return names[:2] == ["t", "q1"] and not any(name.startswith("tau") for name in names)


def read_trajectory(path: Path, robot: Robot) -> SampledMotion:
    """Return the motion of a file, its times from zero, or raise a LogError with all mistakes."""
    raw = read_csv(path)
    problems: list[str] = []
    time = _read_column(raw, "t", robot, problems)
    found: dict[str, FloatArray | None] = {}
    for name in _QUANTITIES:
        columns = [f"{name}{number}" for number in range(1, robot.freedom + 1)]
        more = f"{name}{robot.freedom + 1}"
        if more in raw.columns:
            problems.append(f"column {more}: the robot has {robot.freedom} joints")
        given = any(column in raw.columns for column in columns)
        values = [_read_column(raw, column, robot, problems) for column in columns if given]
        known = [value for value in values if value is not None]
        found[name] = np.column_stack(known) if len(known) == robot.freedom else None
    if found["q"] is None and not problems:
        problems.append(f"columns q1 to q{robot.freedom} are needed, one a joint, and t")
    if time is not None and not problems:
        ahead = np.diff(time) > 0.0
        if len(time) < _FEWEST:
            problems.append(f"{len(time)} samples are too few; at least {_FEWEST} are needed")
        elif not np.all(ahead):
            problems.append(f"the time does not increase after sample {int(np.argmin(ahead)) + 1}")
    position, velocity, acceleration = (found[name] for name in _QUANTITIES)
    if time is None or position is None or problems:
        notices = (Notice(code="excitation.trajectory", text=text, file=str(path)) for text in problems)
        raise LogError(*notices)
    start = time - time[0]
    if velocity is None or acceleration is None:
        spline = scipy.interpolate.make_interp_spline(start, position, k=5)
        velocity, acceleration = (np.asarray(spline(start, k), dtype=np.float64) for k in (1, 2))
    return SampledMotion(
        time=start,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        source=f"trajectory {path.name}",
    )


def _read_column(raw: RawLog, name: str, robot: Robot, problems: list[str]) -> FloatArray | None:
    """Return a column in SI units; None, and a problem noted, where it cannot be used."""
    if name not in raw.columns:
        problems.append(f"column {name} is missing; there are {', '.join(raw.columns)}")
        return None
    kind = name.rstrip("0123456789")
    number = name[len(kind) :]
    prismatic = bool(number) and robot.axes[int(number) - 1].kind is JointKind.PRISMATIC
    standard = get_unit(kind, prismatic=prismatic)
    unit = raw.units.get(name, standard)
    try:
        dimension, factor = get_unit_factor(unit)
    except KeyError:
        problems.append(f"column {name}: unknown unit {unit!r}; use {standard}")
        return None
    if unit != "SI" and dimension != get_unit_factor(standard)[0]:
        problems.append(f"column {name}: {unit} is not a unit of {get_unit_factor(standard)[0]}")
        return None
    values = raw.columns[name]
    if not np.all(np.isfinite(values)):
        problems.append(f"column {name}: sample {int(np.argmin(np.isfinite(values))) + 1} is not finite")
        return None
    return factor * values


TRAJECTORY_NAMES = ("fourier", "ta", "tb", "tc")
_TA_JOINTS = 2


def build_motion(
    robot: Robot,
    given: str | Trajectory | SampledMotion,
    rng: np.random.Generator,
    *,
    duration: float | None = None,
    joint: int = 1,
    scale: float = 1.0,
) -> ReferenceMotion:
    """Return the trajectory of a name, or that of a file or of samples, up to `duration` s, None for its own.

    `given` is one of `TRAJECTORY_NAMES`, the path of a file, or a motion; `rng` that of the random series,
    `joint` that which "tb" moves, counted from one, `scale` that of the amplitudes, both positive.

    Raises:
        UsageError: there is no such trajectory, it is for another number of joints, or shorter than a
            duration. LogError: the file is wrong.
    """
    if isinstance(given, str) and given in TRAJECTORY_NAMES:
        return build_trajectory(robot, given, rng, duration=duration, joint=joint, scale=scale)
    if isinstance(given, Trajectory):
        scaled = scale_trajectory(given, scale)
        return scaled if duration is None else replace(scaled, duration=duration)
    if isinstance(given, str) and not Path(given).is_file():
        known = ", ".join(TRAJECTORY_NAMES)
        text = f"--trajectory {given}: expected one of {known} or a file, as symid excite writes it"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    motion = read_trajectory(Path(given), robot) if isinstance(given, str) else given
    if scale != 1.0:
        # All gaps to the first pose times the scale.
        first = motion.position[0]
        motion = replace(
            motion,
            position=first + scale * (motion.position - first),
            velocity=scale * motion.velocity,
            acceleration=scale * motion.acceleration,
            source=f"{motion.source}, amplitudes times {scale:g}",
        )
    if duration is None:
        return motion
    if duration > motion.duration:
        text = f"--duration {duration:g} s: the trajectory ends after {motion.duration:g} s"
        file = given if isinstance(given, str) else ""
        raise UsageError(Notice(code="usage.trajectory", text=text, file=file))
    # Up to the first sample not before the duration.
    count = max(2, int(np.searchsorted(motion.time, duration * (1.0 - 1e-12))) + 1)
    names = ("time", "position", "velocity", "acceleration")
    kept: dict[str, Any] = {name: getattr(motion, name)[:count] for name in names}
    return replace(motion, **kept)


def build_trajectory(
    robot: Robot,
    name: str,
    rng: np.random.Generator,
    *,
    duration: float | None = None,
    joint: int = 1,
    scale: float = 1.0,
) -> Trajectory:
    """Return the trajectory `name`, amplitudes times `scale`; a UsageError if it does not fit the robot."""
    length = {} if duration is None else {"duration": duration}
    if name == "fourier":
        options = FourierOptions() if duration is None else FourierOptions(duration=duration)
        found = build_random_fourier(robot, rng, options)
    elif name == "tb":
        found = build_tb(joint - 1, size=robot.freedom, **length)
    elif name == "tc":
        found = build_tc(size=robot.freedom, **length)
    elif robot.freedom == _TA_JOINTS:
        found = build_ta(**length)
    else:
        text = f"trajectory ta moves {_TA_JOINTS} joints, {robot.name} has {robot.freedom}; use fourier"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return scale_trajectory(found, scale)
