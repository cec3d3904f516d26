"""Cosine motions of one joint, the others held: what friction is measured with.

Input: amplitude, angular frequency, centre, number of periods, sample rate. Output: `CosineMotion`, exact
states over whole periods; `Trajectory`, the same motion of one joint of a robot, ramped in from rest.

    q(t) = qc + A cos(w t),  dq = -A w sin(w t),  ddq = -A w^2 cos(w t)

A slow and a fast one belong together: the slow one, its peak about three Stribeck velocities, is where dry
friction shows how it falls; the fast one is where viscous friction shows.

Supported: any number of periods, also none that fits the sample rate; several motions one after the other.
Not supported: motions of several joints at once (see `trajectories`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.excitation.trajectories import Trajectory

__all__ = [
    "FAST_PEAK",
    "SLOW_PEAK",
    "CosineMotion",
    "build_cosine",
    "build_cosine_trajectory",
    "build_peak_cosine",
    "join_motions",
]

SLOW_PEAK = 0.1
"""Peak velocity of a slow cosine in rad/s or m/s, unless another is asked for: three times a common vs."""
FAST_PEAK = 1.0
"""Peak velocity of a fast cosine in rad/s or m/s, unless another is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CosineMotion:
    """States of one joint.

    Args:
        time: (N,) s, from zero in equal steps.
        position, velocity, acceleration: (N,) rad or m, /s, /s^2.
        period: s, of the cosine; 0 where several motions were joined.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    period: float

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "position", "velocity", "acceleration"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_cosine(
    *, amplitude: float, omega: float, centre: float = 0.0, periods: float = 5.0, rate: float = 1000.0
) -> CosineMotion:
    """Return qc + A cos(w t) over `periods` periods, its last sample a step before their end.

    Args:
        amplitude: A > 0 in rad or m.
        omega: w > 0 in rad/s.
        centre: qc in rad or m.
        periods: how many, not necessarily a whole number.
        rate: samples a second in Hz.

    Raises:
        UsageError: a value is not positive and finite, or not one sample fits.
    """
    _check_positive(amplitude=amplitude, omega=omega, periods=periods, rate=rate)
    period = 2.0 * math.pi / omega
    count = round(periods * period * rate)
    if count < 1 or not math.isfinite(centre):
        text = f"{periods:g} periods of {period:.4g} s about {centre:g} hold no sample at {rate:g} Hz"
        raise UsageError(Notice(code="usage.cosine", text=text))
    time = np.arange(count) / rate
    angle = omega * time
    return CosineMotion(
        time=time,
        position=centre + amplitude * np.cos(angle),
        velocity=-amplitude * omega * np.sin(angle),
        acceleration=-amplitude * omega**2 * np.cos(angle),
        period=period,
    )


def build_peak_cosine(
    *, peak: float, amplitude: float, centre: float = 0.0, periods: float = 5.0, samples: int = 1000
) -> CosineMotion:
    """Return the cosine whose velocity reaches `peak` (rad/s or m/s), as `samples` samples in all.

    Raises:
        UsageError: a value is not positive and finite.
    """
    _check_positive(peak=peak, amplitude=amplitude, periods=periods, samples=samples)
    omega = peak / amplitude
    rate = samples * omega / (2.0 * math.pi * periods)
    return build_cosine(amplitude=amplitude, omega=omega, centre=centre, periods=periods, rate=rate)


def join_motions(motions: Sequence[CosineMotion]) -> CosineMotion:
    """Return motions one after the other as one set of samples; the joint jumps between them.

    Raises:
        UsageError: there is none.
    """
    if not motions:
        raise UsageError(Notice(code="usage.cosine", text="no cosine motion was given: name at least one"))
    if len(motions) == 1:
        return motions[0]
    starts, end = [], 0.0
    for motion in motions:
        starts.append(end + motion.time)
        step = motion.time[-1] / max(1, len(motion.time) - 1)
        end = float(starts[-1][-1] + step)
    return CosineMotion(
        time=np.concatenate(starts),
        position=np.concatenate([motion.position for motion in motions]),
        velocity=np.concatenate([motion.velocity for motion in motions]),
        acceleration=np.concatenate([motion.acceleration for motion in motions]),
        period=0.0,
    )


def build_cosine_trajectory(
    *,
    joint: int,
    amplitude: float,
    omega: float,
    pose: Sequence[float],
    periods: float = 5.0,
    ramp: float | None = None,
) -> Trajectory:
    """Return the cosine of one joint of a robot whose others stay at `pose`, exact after the ramp.

    Args:
        joint: which one moves, counted from 0.
        amplitude: A > 0 in rad or m.
        omega: w > 0 in rad/s.
        pose: (n,) rad or m; that of the moving joint is the centre of its motion.
        periods: how many, the ramp not counted.
        ramp: how long the motion takes to reach its amplitude, in s; None for a quarter of a period.

    Raises:
        UsageError: there is no such joint, or a value is not positive and finite.
    """
    _check_positive(amplitude=amplitude, omega=omega, periods=periods)
    centre = np.asarray(pose, dtype=np.float64)
    if not 0 <= joint < len(centre):
        text = f"there is no joint {joint + 1}; the robot has {len(centre)}"
        raise UsageError(Notice(code="usage.unknown-joint", text=text))
    period = 2.0 * math.pi / omega
    ramp = 0.25 * period if ramp is None else ramp
    amplitudes = np.zeros((len(centre), 1))
    amplitudes[joint] = amplitude
    return Trajectory(
        centre=centre,
        amplitude=amplitudes,
        frequency=np.full((len(centre), 1), omega),
        phase=np.full((len(centre), 1), 0.5 * math.pi),
        decay=np.zeros(len(centre)),
        ramp=ramp,
        duration=ramp + periods * period,
        source=f"cosine of joint {joint + 1}, peak velocity {amplitude * omega:.3g}, period {period:.4g} s",
    )


def _check_positive(**values: float) -> None:
    wrong = [f"{name} {value:g}" for name, value in values.items() if not 0.0 < value < math.inf]
    if wrong:
        text = f"a cosine motion needs positive, finite numbers; got {', '.join(wrong)}"
        raise UsageError(Notice(code="usage.cosine", text=text))
