"""Reference trajectories as sums of sines, with exact derivatives; finite Fourier series that meet demands.

Amplitudes, frequencies, phases, or limits and a random generator -> Trajectory, which starts at rest:

    q_j(t) = c_j + r(t) (1 - k_j t) sum_i a_ij sin(w_ij t + p_ij),  r = 10 s^3 - 15 s^4 + 6 s^5

Harmonics, period, demands on the start -> SeriesSpace, whose unknowns z are free numbers of order one:

    q_j(t) = c_j + sum_k (A_jk sin k w t + B_jk cos k w t),  w = 2 pi / period,  k = 1..h
    x_j = (c_j, A_j1..A_jh, B_j1..B_jh) = offset_j + map_j z_j

Supported: random series within limits, the trajectories of the papers (Zhang et al. 2023).
Not supported: harmonics that differ from joint to joint; point-to-point motions.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, UsageError
from symid.excitation.limits import get_motion_limits
from symid.options import ExciteOptions
from symid.robot import Robot

_LIMIT_SHARE = 0.9
"""Share of a limit that a random trajectory uses."""


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

    def evaluate(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq, ddq, each (N, n) in rad or m, /s, /s^2, at `times` (N,) in s; exact derivatives."""
        q, dq, ddq = self.evaluate_derivatives(times, 2)
        return q, dq, ddq

    def evaluate_derivatives(self, times: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Return q and its exact derivatives up to `order`, (N, n) rad or m, /s, ..., at `times` (N,) s."""
        t = np.asarray(times, dtype=np.float64)[:, None]
        angle = self.frequency * t[:, :, None] + self.phase
        # The derivative of order k of a sine: a quarter turn each.
        sine, cosine = _compute_sines(angle)
        turns = (sine, cosine, -sine, -cosine)
        waves = [(self.amplitude * self.frequency**k * turns[k % 4]).sum(axis=2) for k in range(order + 1)]
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
    *,
    sines: FloatArray,
    cosines: FloatArray,
    base_frequency: float,
    centre: FloatArray,
    duration: float,
    ramp: float = 2.0,
) -> Trajectory:
    """Return c_j + r(t) sum_i (A_ij sin(i w t) + B_ij cos(i w t)), w = 2 pi base_frequency.

    `sines` A and `cosines` B (n, h), `centre` c (n,) in rad or m; `base_frequency` in Hz; times in s.
    """
    harmonic = 2.0 * np.pi * base_frequency * np.arange(1, sines.shape[1] + 1)
    return Trajectory(
        centre=centre,
        amplitude=np.hypot(sines, cosines),
        frequency=np.broadcast_to(harmonic, sines.shape),
        phase=np.arctan2(cosines, sines),
        decay=np.zeros(len(centre)),
        ramp=ramp,
        duration=duration,
        source=f"finite Fourier series, {sines.shape[1]} harmonics of {base_frequency:g} Hz",
    )


def build_random_fourier(
    robot: Robot, rng: np.random.Generator, options: FourierOptions | None = None
) -> Trajectory:
    """Return a random Fourier series as large as the robot's limits allow, on 50 points per shortest period.

    Limits of position and velocity are those of the robot file, others those of `ExciteOptions`.
    """
    options = options or FourierOptions()
    shape = (robot.freedom, options.harmonics)
    # Amplitudes fall with the harmonic, so that no single one uses up the acceleration.
    weight = 1.0 / np.arange(1, options.harmonics + 1)
    draft = build_fourier(
        sines=rng.normal(size=shape) * weight,
        cosines=rng.normal(size=shape) * weight,
        base_frequency=options.base_frequency,
        centre=np.zeros(robot.freedom),
        duration=options.duration,
        ramp=options.ramp,
    )
    usual = ExciteOptions()
    limits = get_motion_limits(robot, usual)
    steps = math.ceil(50 * options.duration * options.harmonics * options.base_frequency) + 2
    states = draft.evaluate(np.linspace(0.0, options.duration, steps))
    peaks = np.array([np.abs(state).max(axis=0) for state in states])
    bounds = np.array([limits.half, limits.velocity, np.full(robot.freedom, usual.acceleration)])
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

    @property
    def shape(self) -> tuple[int, int]:
        """Return (n, r): joints, unknowns of one."""
        return len(self.maps), len(self.maps[0, 0])

    def compute_coefficients(self, unknowns: FloatArray) -> FloatArray:
        """Return x (n, 2h + 1), rad or m, of unknowns (n, r)."""
        coefficients: FloatArray = self.offset + np.einsum("jcr,jr->jc", self.maps, unknowns)
        return coefficients

    def compute_states(self, unknowns: FloatArray, basis: FloatArray) -> FloatArray:
        """Return derivatives (orders, N, n) of the series of unknowns (n, r) on a basis of `build_basis`."""
        states: FloatArray = basis @ self.compute_coefficients(unknowns).T
        return states

    def compute_unknowns(self, coefficients: FloatArray) -> FloatArray:
        """Return the unknowns (n, r) whose series is nearest to coefficients (n, 2h + 1), rad or m."""
        gaps = coefficients - self.offset
        found = [np.linalg.lstsq(part, gap, rcond=None)[0] for part, gap in zip(self.maps, gaps, strict=True)]
        return np.array(found, dtype=np.float64)

    def build_trajectory(self, unknowns: FloatArray, source: str) -> Trajectory:
        """Return the series of unknowns (n, r) as a trajectory."""
        x, h = self.compute_coefficients(unknowns), self.harmonics
        series = build_fourier(
            sines=x[:, 1 : h + 1],
            cosines=x[:, h + 1 :],
            base_frequency=1.0 / self.period,
            centre=x[:, 0],
            duration=self.period,
            ramp=0.0,
        )
        return replace(series, source=source)


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
    """Return sine and cosine of angles of any shape.

    One by one, by the C library: NumPy's differ in the last bit from one processor to another, which sticking
    joints and encoders make visible in a simulated log.
    """
    flat = angle.ravel().tolist()
    found = np.array([list(map(math.sin, flat)), list(map(math.cos, flat))])
    return found[0].reshape(angle.shape), found[1].reshape(angle.shape)


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
