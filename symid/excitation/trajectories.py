"""Reference trajectories as sums of sines, with exact derivatives, starting at rest.

Amplitudes, frequencies, phases, or limits and a random generator -> Trajectory; `evaluate` gives q, dq,
ddq at any times, `evaluate_derivatives` as many as wanted.

    q_j(t) = c_j + r(t) (1 - k_j t) sum_i a_ij sin(w_ij t + p_ij)

with the ramp r(t) = 10 s^3 - 15 s^4 + 6 s^5, s = min(t / ramp, 1): value, slope and curvature are zero at
t = 0, so every trajectory starts at c_j at rest. Its third derivative jumps at both ends of the ramp.

Supported: finite Fourier series, random ones within limits, the trajectories of the papers (Zhang et al.
2023), at any scale.
Not supported: trajectories optimised for information (see `optimise`), point-to-point motions.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, UsageError
from symid.excitation.limits import LimitOptions, get_motion_limits
from symid.robot import Robot

_TA_DURATION = 20.0
_TB_DURATION = 50.0
_TC_DURATION = 20.0
_LIMIT_SHARE = 0.9
"""Share of a limit that a random trajectory uses."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory(FrozenArrays):
    """A sum of sines per joint under a linear decay, ramped in from rest.

    Args:
        centre: (n,) rad or m. decay: (n,) 1/s, k_j above.
        amplitude: (n, h) rad or m. frequency: (n, h) rad/s. phase: (n, h) rad.
        ramp: s; 0 for none. duration: s, how long it is meant to run.
        source: where it comes from, in words.
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
        """Return q and its time derivatives up to `order`, each (N, n) in rad or m, /s, /s^2 and so on.

        Exact, by the product rule for ramp, decay and sum of sines. From the third on they jump where the
        ramp begins and ends.

        Args:
            times: (N,) s.
            order: of the highest derivative, 0 or more.
        """
        t = np.asarray(times, dtype=np.float64)[:, None]
        waves = [_evaluate_sines(self, t, k) for k in range(order + 1)]
        envelope = 1.0 - self.decay * t
        inner = [
            envelope * wave - k * self.decay * waves[k - 1] if k else envelope * wave
            for k, wave in enumerate(waves)
        ]
        ramps = _evaluate_ramp(t, self.ramp, order)
        found = [
            sum((math.comb(k, j) * ramps[j] * inner[k - j] for j in range(k + 1)), np.zeros_like(inner[k]))
            for k in range(order + 1)
        ]
        return (self.centre + found[0], *found[1:])


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierOptions:
    """How a random trajectory is made.

    Args:
        harmonics: of each joint.
        base_frequency: Hz.
        duration, ramp: s.
    """

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

    Args:
        sines: A (n, h), rad or m.
        cosines: B (n, h), rad or m.
        base_frequency: Hz.
        centre: c (n,), rad or m.
        duration: s.
        ramp: s.

    Raises:
        UsageError: the shapes do not fit.
    """
    sines, cosines, centre = np.atleast_2d(sines), np.atleast_2d(cosines), np.atleast_1d(centre)
    if sines.shape != cosines.shape or len(sines) != len(centre):
        text = (
            f"sines {sines.shape}, cosines {cosines.shape} and centre {centre.shape} do not belong together"
        )
        raise UsageError(Notice(code="usage.trajectory-shape", text=text))
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
    """Return a random Fourier series that keeps the robot's limits, as large as they allow.

    Positions, velocities and accelerations are looked at on a grid of 50 points per shortest period. What the
    robot file states of position and velocity holds; other limits are those of `LimitOptions`.
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
    limits, fallback = get_motion_limits(robot), LimitOptions()
    steps = math.ceil(50 * options.duration * options.harmonics * options.base_frequency) + 2
    states = draft.evaluate(np.linspace(0.0, options.duration, steps))
    peaks = np.array([np.abs(state).max(axis=0) for state in states])
    bounds = np.array([limits.half, limits.velocity, np.full(robot.freedom, fallback.acceleration)])
    scale = _LIMIT_SHARE * np.min(bounds / np.maximum(peaks, np.finfo(np.float64).tiny), axis=0)
    return replace(
        draft,
        centre=limits.centre,
        amplitude=draft.amplitude * scale[:, None],
        source=f"random {draft.source}, scaled to the limits",
    )


def build_ta(*, ramp: float = 2.0, duration: float = _TA_DURATION) -> Trajectory:
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


def build_tb(joint: int, *, size: int = 2, ramp: float = 2.0, duration: float = _TB_DURATION) -> Trajectory:
    """Return the decaying trajectory that moves one joint at a time, exact after the ramp.

    q_j = pi/2 (1 - 0.02 t) sin(0.2 pi t - 1.5 pi) at `joint` (from 0), zero at the others.

    Raises:
        UsageError: there is no such joint.
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


def build_tc(*, size: int = 2, ramp: float = 2.0, duration: float = _TC_DURATION) -> Trajectory:
    """Return the trajectory on which models are tried that were identified on others, exact after the ramp.

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
    """Return `trajectory` with amplitudes times `scale` about the same centre.

    Raises:
        UsageError: the scale is not positive and finite.
    """
    if not 0.0 < scale < math.inf:
        text = f"the scale of a trajectory must be positive and finite, got {scale:g}"
        raise UsageError(Notice(code="usage.trajectory-scale", text=text))
    if scale == 1.0:
        return trajectory
    source = f"{trajectory.source}, amplitudes times {scale:g}"
    return replace(trajectory, amplitude=scale * trajectory.amplitude, source=source)


def _evaluate_ramp(t: FloatArray, ramp: float, order: int) -> list[FloatArray]:
    """Return the ramp and its derivatives; after its end, and where there is none, it is one."""
    if ramp <= 0.0:
        return [np.ones_like(t), *(np.zeros_like(t) for _ in range(order))]
    s, inside = np.clip(t / ramp, 0.0, 1.0), (t >= 0.0) & (t < ramp)
    # Written in factors that vanish at the ends, the first three have no rounding there.
    values = [
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
        np.where(inside, 60.0 - 360.0 * s + 360.0 * s**2, 0.0),
        np.where(inside, 720.0 * s - 360.0, 0.0),
        np.where(inside, 720.0, 0.0),
    ]
    values += [np.zeros_like(t) for _ in range(order - 5)]
    return [value / ramp**k for k, value in enumerate(values[: order + 1])]


def _evaluate_sines(trajectory: Trajectory, t: FloatArray, order: int) -> FloatArray:
    """Return the derivative of the sum of sines of this order."""
    a, w = trajectory.amplitude, trajectory.frequency
    angle = w * t[:, :, None] + trajectory.phase
    wave = np.cos(angle) if order % 2 else np.sin(angle)
    sign = -1.0 if order % 4 in {2, 3} else 1.0
    total: FloatArray = (sign * a * w**order * wave).sum(axis=2)
    return total
