"""Reference trajectories with exact derivatives, starting at rest.

Input: amplitudes, frequencies, phases, or limits and a random generator.
Output: `Trajectory`; `evaluate` gives q, dq, ddq at any times.

    q_j(t) = c_j + r(t) (1 - k_j t) sum_i a_ij sin(w_ij t + p_ij)

with the ramp r(t) = 10 s^3 - 15 s^4 + 6 s^5, s = min(t / ramp, 1): value, slope and curvature are
zero at t = 0, so every trajectory starts at c_j at rest.

Supported: finite Fourier series, random ones within limits, the trajectories of the papers.
Not supported: trajectories optimised for information, point-to-point motions.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.robot.description import Joint, JointKind, Robot

__all__ = [
    "FourierOptions",
    "Trajectory",
    "build_fourier",
    "build_random_fourier",
    "build_ta",
    "build_tb",
]

_TA_DURATION = 20.0
_TB_DURATION = 50.0
_NO_WEAR = 0.9
"""Share of a limit that a random trajectory uses."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
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

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("centre", "amplitude", "frequency", "phase", "decay"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.centre)

    def evaluate(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq, ddq, each (N, n) in rad or m, /s, /s^2, at `times` (N,) in s; exact derivatives."""
        t = np.asarray(times, dtype=np.float64)[:, None]
        # Product rule with three factors: ramp r, decay e, sum of sines f.
        ramp, ramp1, ramp2 = _evaluate_ramp(t, self.ramp)
        envelope, envelope1 = 1.0 - self.decay * t, -self.decay
        wave, wave1, wave2 = _evaluate_sines(self, t)
        inner = envelope * wave
        inner1 = envelope1 * wave + envelope * wave1
        inner2 = 2.0 * envelope1 * wave1 + envelope * wave2
        q = self.centre + ramp * inner
        dq = ramp1 * inner + ramp * inner1
        ddq = ramp2 * inner + 2.0 * ramp1 * inner1 + ramp * inner2
        return q, dq, ddq


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierOptions:
    """How a random trajectory is made.

    `sweep` (rad or m, either side of the centre), `speed` and `acceleration` hold for joints whose
    robot file states no limit; `base_frequency` in Hz.
    """

    harmonics: int = 5
    base_frequency: float = 0.1
    duration: float = 20.0
    ramp: float = 2.0
    sweep: float = 1.0
    speed: float = 2.0
    acceleration: float = 10.0


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

    Positions, velocities and accelerations are looked at on a grid of 50 points per shortest period.
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
    bounds = [_find_bounds(joint, options) for joint in robot.axes]
    scale = _find_scale(draft, np.array([bound[1:] for bound in bounds]), options)
    return Trajectory(
        centre=np.array([bound[0] for bound in bounds]),
        amplitude=draft.amplitude * scale[:, None],
        frequency=draft.frequency,
        phase=draft.phase,
        decay=draft.decay,
        ramp=draft.ramp,
        duration=draft.duration,
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


def _evaluate_ramp(t: FloatArray, ramp: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    if ramp <= 0.0:
        return np.ones_like(t), np.zeros_like(t), np.zeros_like(t)
    s = np.clip(t / ramp, 0.0, 1.0)
    value = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    slope = 30.0 * s**2 * (1.0 - s) ** 2 / ramp
    curvature = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / ramp**2
    return value, slope, curvature


def _evaluate_sines(trajectory: Trajectory, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    a, w = trajectory.amplitude, trajectory.frequency
    angle = w * t[:, :, None] + trajectory.phase
    sine, cosine = np.sin(angle), np.cos(angle)
    return (a * sine).sum(axis=2), (a * w * cosine).sum(axis=2), -(a * w**2 * sine).sum(axis=2)


def _find_bounds(joint: Joint, options: FourierOptions) -> tuple[float, float, float, float]:
    """Return centre, sweep, speed and acceleration that a joint may use."""
    limits = joint.limits
    centre, sweep = 0.0, options.sweep
    if limits.position is not None:
        low, high = limits.position
        centre, sweep = 0.5 * (low + high), 0.5 * (high - low)
        if joint.kind is JointKind.REVOLUTE:
            # A cable-bound axis may turn several times; an experiment need not.
            sweep = min(sweep, math.pi)
    speed = options.speed if limits.velocity is None else limits.velocity
    return centre, sweep, speed, options.acceleration


def _find_scale(draft: Trajectory, bounds: FloatArray, options: FourierOptions) -> FloatArray:
    steps = math.ceil(50 * options.duration * options.harmonics * options.base_frequency) + 2
    states = draft.evaluate(np.linspace(0.0, options.duration, steps))
    peaks = np.stack([np.abs(state).max(axis=0) for state in states], axis=1)
    scale: FloatArray = _NO_WEAR * np.min(bounds / np.maximum(peaks, np.finfo(np.float64).tiny), axis=1)
    return scale
