"""What every trajectory is to those who follow it, and one that is given by samples.

Input: times, positions, velocities, accelerations. Output: `SampledMotion`, the polynomial of fifth degree
between neighbouring samples that has their states: q, dq, ddq are continuous and exact at the samples.

    q(t) = sum_k H_k(s) h^k q_left^(k) + H_k(1 - s) (-h)^k q_right^(k),   s = (t - t_left) / h,  k = 0, 1, 2

Supported: samples at any increasing times. Not supported: times outside them; the ends are held.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from symid.arrays import FloatArray, freeze

__all__ = ["Motion", "SampledMotion", "build_part", "build_scaled_samples"]

# H_0, H_1, H_2: coefficients of s^0 to s^5; each has one derivative at s = 0 and none at s = 1.
_SHAPES = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
    ]
)


class Motion(Protocol):
    """A trajectory of all joints, however it is given."""

    @property
    def size(self) -> int:
        """Return the number of joints."""
        ...

    @property
    def duration(self) -> float:
        """Return how long it is meant to run, s."""
        ...

    @property
    def source(self) -> str:
        """Return where it comes from, in words."""
        ...

    def evaluate(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq, ddq, each (N, n) in rad or m, /s, /s^2, at `times` (N,) in s."""
        ...

    def evaluate_derivatives(self, times: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Return q and its time derivatives up to `order`, each (N, n)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMotion:
    """A motion given by its states.

    Args:
        time: (N,) s, from zero, increasing. position, velocity, acceleration: (N, n) rad or m, /s, /s^2.
        source: where it comes from, in words.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    source: str

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "position", "velocity", "acceleration"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

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
        """Return q and its time derivatives up to `order`, each (N, n) in rad or m, /s, /s^2 and so on.

        From the third on they jump at the samples. Before the first sample and after the last one the state
        of that sample is given.

        Args:
            times: (N,) s.
            order: of the highest derivative, 0 or more.
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
                near, far = _evaluate(k, derivative, s), _evaluate(k, derivative, 1.0 - s)
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


def _evaluate(k: int, derivative: int, s: FloatArray) -> FloatArray:
    """Return the derivative of H_k by s."""
    shape = np.polynomial.Polynomial(_SHAPES[k])
    result: FloatArray = (shape.deriv(derivative) if derivative else shape)(s)
    return result * np.ones_like(s)


def build_scaled_samples(motion: SampledMotion, scale: float) -> SampledMotion:
    """Return `motion` with all gaps to its first pose times `scale`."""
    if scale == 1.0:
        return motion
    first = motion.position[0]
    return replace(
        motion,
        position=first + scale * (motion.position - first),
        velocity=scale * motion.velocity,
        acceleration=scale * motion.acceleration,
        source=f"{motion.source}, amplitudes times {scale:g}",
    )


def build_part(motion: SampledMotion, duration: float) -> SampledMotion:
    """Return the beginning of `motion`, up to the first sample not before `duration` in s."""
    count = max(2, int(np.searchsorted(motion.time, duration * (1.0 - 1e-12))) + 1)
    return replace(
        motion,
        time=motion.time[:count],
        position=motion.position[:count],
        velocity=motion.velocity[:count],
        acceleration=motion.acceleration[:count],
    )
