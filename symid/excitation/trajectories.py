"""Motions: sums of sines with exact derivatives, samples, by name or from a file; series that meet demands.

Amplitudes, frequencies, phases, or limits and a random generator -> Trajectory, which starts at rest:

    q_j(t) = c_j + r(t) (1 - k_j t) sum_i a_ij sin(w_ij t + p_ij),  r = 10 s^3 - 15 s^4 + 6 s^5

Harmonics, period, demands on the start -> SeriesSpace, whose unknowns z are free numbers of order one:

    q_j(t) = c_j + sum_k (A_jk sin k w t + B_jk cos k w t),  w = 2 pi / period,  k = 1..h
    x_j = (c_j, A_j1..A_jh, B_j1..B_jh) = offset_j + map_j z_j

Robot, a name ("fourier", "ta", "tb", "tc"), path of a file, or motion -> ReferenceMotion. Motion, rate -> CSV
file with the columns t, q1.., dq1.., ddq1.. and their units, below remarks that begin with #. Samples ->
SampledMotion, polynomials of fifth degree between samples, with q, dq, ddq continuous and exact at them:

    q(t) = sum_k H_k(s) h^k q_left^(k) + H_k(1 - s) (-h)^k q_right^(k),   s = (t - t_left) / h,  k = 0, 1, 2

Supported: random series within limits, the trajectories of the papers (Zhang et al. 2023); samples at any
increasing times; file columns in any unit, in any order; files without dq and ddq, whose samples must then be
close enough for a spline of fifth degree.
Not supported: harmonics that differ from joint to joint; point-to-point motions, waypoints; times outside the
samples, where the ends are held.
"""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.environment import check_suffix, write_file
from symid.errors import LogError, Notice, UsageError
from symid.excitation.limits import get_motion_limits
from symid.logs import RawLog, read_csv
from symid.notation import get_unit, get_unit_factor
from symid.options import ExciteOptions
from symid.robot import JointKind, Robot

_LIMIT_SHARE = 0.9
"""Share of a limit that a random trajectory uses."""
TRAJECTORY_NAMES, _TA_JOINTS = ("fourier", "ta", "tb", "tc"), 2
_QUANTITIES = ("q", "dq", "ddq")
_FEWEST = 8
"""Fewest samples of a trajectory in a file."""
_BLOCK = 4096
"""Samples of a motion that are computed at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory(FrozenArrays):
    """A sum of sines per joint under a linear decay, ramped in from rest.

    Args:
        centre: (n,) rad or m. decay: (n,) 1/s, k_j above.
        amplitude: (n, h) rad or m. frequency: (n, h) rad/s. phase: (n, h) rad.
        ramp: s; 0 for none. duration: s, how long it is meant to run.
        source: its name in messages.
    """

    centre: FloatArray
    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray
    decay: FloatArray
    ramp: float
    duration: float
    source: str

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.centre)

    def evaluate(self, times: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return exact q, dq, ddq, or more, up to `order`: (N, n) rad or m, /s, ..., at `times` (N,) s."""
        if len(times) > _BLOCK:
            # What one sample takes on the way is many times what it gives.
            blocks = (times[start : start + _BLOCK] for start in range(0, len(times), _BLOCK))
            pieces = (self.evaluate(block, order) for block in blocks)
            return tuple(map(np.concatenate, zip(*pieces, strict=True)))
        t = np.asarray(times, dtype=np.float64)[:, None]
        angle = self.frequency * t[:, :, None] + self.phase
        # The derivative of order k of a sine: a quarter turn each.
        sine, cosine = _compute_sines(angle)
        turns, signs = (sine, cosine), (1.0, 1.0, -1.0, -1.0)
        waves = [
            (signs[k % 4] * self.amplitude * self.frequency**k * turns[k % 2]).sum(axis=2)
            for k in range(order + 1)
        ]
        envelope = 1.0 - self.decay * t
        inner = [
            envelope * wave - k * self.decay * waves[k - 1] if k else envelope * wave
            for k, wave in enumerate(waves)
        ]
        ramp = self.ramp
        if ramp <= 0.0:
            ramps = [np.ones_like(t), *(np.zeros_like(t) for _ in range(order))]
        else:
            s, inside = np.clip(t / ramp, 0.0, 1.0), (t >= 0.0) & (t < ramp)
            # Factors that vanish at the ends leave no rounding there.
            values = [
                s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
                30.0 * s**2 * (1.0 - s) ** 2,
                60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
                np.where(inside, 60.0 - 360.0 * s + 360.0 * s**2, 0.0),
                np.where(inside, 720.0 * s - 360.0, 0.0),
                np.where(inside, 720.0, 0.0),
            ]
            values += [np.zeros_like(t) for _ in range(order - 5)]
            ramps = [value / ramp**k for k, value in enumerate(values[: order + 1])]
        found = [
            sum((math.comb(k, j) * ramps[j] * inner[k - j] for j in range(k + 1)), np.zeros_like(inner[k]))
            for k in range(order + 1)
        ]
        return (self.centre + found[0], *found[1:])


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierOptions:
    """How a random trajectory is made: harmonics of each joint, base frequency in Hz, times in s."""

    harmonics: int = 5
    base_frequency: float = 0.1
    duration: float = 20.0
    ramp: float = 2.0


def build_fourier(
    coefficients: FloatArray, base_frequency: float, *, duration: float, ramp: float = 2.0
) -> Trajectory:
    """Return c_j + r(t) sum_i (A_ij sin(i w t) + B_ij cos(i w t)), w = 2 pi base_frequency (Hz); times in s.

    `coefficients` (n, 2h + 1) in rad or m are c, then h of A and h of B.
    """
    count = coefficients.shape[1] // 2
    centre, sines, cosines = np.split(coefficients, [1, count + 1], axis=1)
    harmonic = 2.0 * np.pi * base_frequency * np.arange(1, count + 1)
    return Trajectory(
        centre=centre[:, 0],
        amplitude=np.hypot(sines, cosines),
        frequency=np.broadcast_to(harmonic, sines.shape),
        phase=np.arctan2(cosines, sines),
        decay=np.zeros(len(centre)),
        ramp=ramp,
        duration=duration,
        source=f"finite Fourier series, {count} harmonics of {base_frequency:g} Hz",
    )


def build_random_fourier(
    robot: Robot, rng: np.random.Generator, options: FourierOptions | None = None
) -> Trajectory:
    """Return a random Fourier series as large as the robot's limits allow, on 50 points per shortest period.

    Limits of position and velocity are those of the robot file, others those of `ExciteOptions`.
    """
    options = options or FourierOptions()
    # Amplitudes fall with the harmonic, so that no single one uses up the acceleration.
    weight = 1.0 / np.arange(1, options.harmonics + 1)
    waves = [rng.normal(size=(robot.freedom, options.harmonics)) * weight for _ in range(2)]
    coefficients = np.hstack([np.zeros((robot.freedom, 1)), *waves])
    draft = build_fourier(coefficients, options.base_frequency, duration=options.duration, ramp=options.ramp)
    usual = ExciteOptions()
    limits = get_motion_limits(robot, usual)
    steps = math.ceil(50 * options.duration * options.harmonics * options.base_frequency) + 2
    states = draft.evaluate(np.linspace(0.0, options.duration, steps))
    peaks = np.array([np.abs(state).max(axis=0) for state in states])
    bounds = np.vstack([limits.bounds[:2], np.full(robot.freedom, usual.acceleration)])
    scale = _LIMIT_SHARE * np.min(bounds / np.maximum(peaks, np.finfo(np.float64).tiny), axis=0)
    return replace(
        draft,
        centre=limits.centre,
        amplitude=draft.amplitude * scale[:, None],
        source=f"random {draft.source}, scaled to the limits",
    )


def build_ta(*, ramp: float = 2.0, duration: float = 20.0) -> Trajectory:
    """Return the exciting trajectory of two joints together, exact after the ramp.

    q_1 = pi/60 (sin 2 pi t + sin(pi t + pi/6) + sin(0.4 pi t + pi/4)),
    q_2 = pi/60 (sin 0.4 pi t + sin(2 pi t + pi/5) + sin(pi t + pi/2)).
    """
    pi = math.pi
    return Trajectory(
        centre=np.zeros(2),
        amplitude=np.full((2, 3), pi / 60.0),
        frequency=np.array([[2.0, 1.0, 0.4], [0.4, 2.0, 1.0]]) * pi,
        phase=np.array([[0.0, pi / 6.0, pi / 4.0], [0.0, pi / 5.0, pi / 2.0]]),
        decay=np.zeros(2),
        ramp=ramp,
        duration=duration,
        source="TA: exciting trajectory of two elastic joints, Zhang et al. 2023",
    )


def build_tb(joint: int, *, size: int = 2, ramp: float = 2.0, duration: float = 50.0) -> Trajectory:
    """Return the decaying trajectory that moves one joint at a time, exact after the ramp.

    q_j = pi/2 (1 - 0.02 t) sin(0.2 pi t - 1.5 pi) at `joint` (from 0, else a UsageError), zero at the others.
    """
    if not 0 <= joint < size:
        text = f"there is no joint {joint + 1}; the robot has {size}"
        raise UsageError(Notice(code="usage.unknown-joint", text=text))
    amplitude = np.zeros((size, 1))
    amplitude[joint] = math.pi / 2.0
    return Trajectory(
        centre=np.zeros(size),
        amplitude=amplitude,
        frequency=np.full((size, 1), 0.2 * math.pi),
        phase=np.full((size, 1), -1.5 * math.pi),
        decay=np.full(size, 0.02),
        ramp=ramp,
        duration=duration,
        source=f"TB: decaying sine of joint {joint + 1}, Zhang et al. 2023",
    )


def build_tc(*, size: int = 2, ramp: float = 2.0, duration: float = 20.0) -> Trajectory:
    """Return the trajectory for the validation of models, exact after the ramp.

    q_j = 0.4 sum_k a_k sin(2 pi f_k t + k + j - 1) rad: f = 0.15, 0.45, 0.9 Hz, a = 1, 1/2, 1/4, k = 0, 1, 2.
    """
    return Trajectory(
        centre=np.zeros(size),
        amplitude=np.broadcast_to(0.4 * np.array([1.0, 0.5, 0.25]), (size, 3)),
        frequency=np.broadcast_to(2.0 * math.pi * np.array([0.15, 0.45, 0.9]), (size, 3)),
        phase=np.arange(size)[:, None] + np.array([0.0, 1.0, 2.0]),
        decay=np.zeros(size),
        ramp=ramp,
        duration=duration,
        source="TC: three sines of every joint, for validation",
    )


def scale_trajectory(trajectory: Trajectory, scale: float) -> Trajectory:
    """Return `trajectory` with amplitudes times `scale`, which is positive and finite."""
    if scale == 1.0:
        return trajectory
    source = f"{trajectory.source}, amplitudes times {scale:g}"
    return replace(trajectory, amplitude=scale * trajectory.amplitude, source=source)


# H_0, H_1, H_2: coefficients of s^0 to s^5; each has one derivative at s = 0 and none at s = 1.
_HERMITE = np.array(
    [[1.0, 0.0, 0.0, -10.0, 15.0, -6.0], [0.0, 1.0, 0.0, -6.0, 8.0, -3.0], [0.0, 0.0, 0.5, -1.5, 1.5, -0.5]]
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

    def evaluate(self, times: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return q, dq, ddq, or derivatives up to `order`, (N, n) in rad or m, /s, ..., at `times` (N,) in s.

        From the third on they jump at the samples. Beyond the ends the first or last state is held.
        """
        t = np.clip(np.asarray(times, dtype=np.float64), self.time[0], self.time[-1])
        left = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        h = self.time[left + 1] - self.time[left]
        s = (t - self.time[left]) / h
        found = []
        for derivative in range(order + 1):
            total = np.zeros((len(t), self.size))
            for k, values in enumerate((self.position, self.velocity, self.acceleration)):
                shape = np.polynomial.Polynomial(_HERMITE[k]).deriv(derivative)
                near, far, factor = shape(s), shape(1.0 - s), h ** (k - derivative)
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
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(start, position, k=5)
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
        length = {} if duration is None else {"duration": duration}
        if given == "fourier":
            options = None if duration is None else FourierOptions(duration=duration)
            named = build_random_fourier(robot, rng, options)
        elif given == "tb":
            named = build_tb(joint - 1, size=robot.freedom, **length)
        elif given == "tc":
            named = build_tc(size=robot.freedom, **length)
        elif robot.freedom == _TA_JOINTS:
            named = build_ta(**length)
        else:
            text = f"trajectory ta moves {_TA_JOINTS} joints, {robot.name} has {robot.freedom}; use fourier"
            raise UsageError(Notice(code="usage.trajectory", text=text))
        return scale_trajectory(named, scale)
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeriesSpace(FrozenArrays):
    """The series that meet all demands, as an affine space.

    Args:
        maps: (n, 2h + 1, r), rad or m per unknown. offset: (n, 2h + 1), rad or m.
        harmonics: h. period: s.
    """

    maps: FloatArray
    offset: FloatArray
    harmonics: int
    period: float

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.maps)

    def compute_coefficients(self, unknowns: FloatArray) -> FloatArray:
        """Return x (n, 2h + 1), rad or m, of unknowns (n r,)."""
        by_joint = unknowns.reshape(self.size, -1)
        return np.asarray(self.offset + np.einsum("jcr,jr->jc", self.maps, by_joint))

    def compute_states(self, unknowns: FloatArray, basis: FloatArray) -> FloatArray:
        """Return derivatives (orders, N, n) of the series of unknowns (n r,) on a basis of `build_basis`."""
        return np.asarray(basis @ self.compute_coefficients(unknowns).T)

    def compute_unknowns(self, coefficients: FloatArray) -> FloatArray:
        """Return the unknowns (n r,) whose series is nearest to coefficients (n, 2h + 1), rad or m."""
        pairs = zip(self.maps, coefficients - self.offset, strict=True)
        return np.concatenate([np.linalg.lstsq(part, gap, rcond=None)[0] for part, gap in pairs])


def build_basis(harmonics: int, period: float, times: FloatArray, orders: int) -> FloatArray:
    """Return `orders` derivatives of 1, sin k w t, cos k w t at `times` (N,) in s: (orders, N, 2h + 1)."""
    speed = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    angle = np.asarray(times, dtype=np.float64)[:, None] * speed
    basis = np.zeros((orders, len(angle), 2 * harmonics + 1))
    basis[0, :, 0] = 1.0
    for order in range(orders):
        turned, factor = angle + 0.5 * np.pi * order, speed**order
        sine, cosine = _compute_sines(turned)
        basis[order, :, 1 : harmonics + 1] = factor * sine
        basis[order, :, harmonics + 1 :] = factor * cosine
    return basis


def _compute_sines(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine of angles of any shape, one by one, by the C library.

    NumPy's differ in the last bit from one processor to another, which sticking joints and encoders make
    visible in a simulated log.
    """
    flat = angle.ravel().tolist()
    sine, cosine = (np.fromiter(map(turn, flat), np.float64, len(flat)) for turn in (math.sin, math.cos))
    return sine.reshape(angle.shape), cosine.reshape(angle.shape)


def build_grid_basis(space: SeriesSpace, count: int, orders: int) -> FloatArray:
    """Return the basis (orders, count, 2h + 1) at `count` equal steps of a period."""
    times: FloatArray = np.arange(count, dtype=np.float64) * (space.period / count)
    return build_basis(space.harmonics, space.period, times, orders)


def build_series_space(options: ExciteOptions, centre: FloatArray, scales: FloatArray) -> SeriesSpace:
    """Return the space of the series that meet the options.

    `centre` (n,) of the series with all unknowns zero, `scales` (n, 2h + 1) of the coefficients, rad or m.
    """
    size, problems = len(centre), []
    if options.harmonics < 2 and not options.moving:
        problems.append(f"harmonics: must be at least 2 to start and end at rest, got {options.harmonics}")
    if options.start is not None and len(options.start) != size:
        problems.append(f"the start has {len(options.start)} positions, the robot {size} joints")
    if options.start is not None and not np.all(np.isfinite(options.start)):
        problems.append("the start has a position that is not finite")
    if problems:
        raise UsageError(*(Notice(code="usage.excitation", text=text) for text in problems))
    # Velocity and acceleration at the start, by w and w^2, and position: (m, 2h + 1).
    basis = build_basis(options.harmonics, 2.0 * np.pi, np.zeros(1), 3)[:, 0]
    kept = ([] if options.moving else [1, 2]) + ([0] if options.start is not None else [])
    # Sines and cosines of multiples of a right angle are not quite what they are.
    demands = np.round(basis[kept], 9)
    maps, offsets = [], []
    for joint, scale in enumerate(scales):
        rows = demands * scale
        # The last columns of the full orthogonal factor span the null space of the demands.
        full = np.linalg.qr(rows.T, mode="complete")[0]
        maps.append(scale[:, None] * full[:, len(demands) :])
        offset = np.zeros(len(scale))
        offset[0] = centre[joint]
        if options.start is not None:
            wanted = np.zeros(len(demands))
            wanted[-1] = options.start[joint]
            offset += scale * np.linalg.lstsq(rows, wanted - demands @ offset, rcond=None)[0]
        offsets.append(offset)
    return SeriesSpace(
        maps=np.array(maps), offset=np.array(offsets), harmonics=options.harmonics, period=options.period
    )
