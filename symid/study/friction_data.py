"""Friction torques of a known law along cosines, with noise: what the tables of friction are made from.

Input: a law, its parameters, a motion, a generator. Output: `FrictionSamples`.

    v_k = -V sin(2 pi (k + 1/2) / N)

Half a step off the grid no sample stands still: there a law without a zone would have no torque at all.

Supported: white noise; motions in one direction (half a period) or in both.
Not supported: noise of the velocity, which all estimators take as known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.friction.samples import FrictionSamples
from symid.joint.friction_law import find_torque
from symid.joint.friction_laws import get_law

__all__ = ["Scene", "build_half_cosine", "build_scene", "build_whole_cosines", "draw_samples"]

_PERIOD = 1.0
"""Of a cosine in s; friction without a memory does not depend on it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """A joint whose friction is known, in motion.

    Args:
        joint: its name; law: the name of its friction law.
        physical: true parameters, in the order of the law's.
        velocity: (N,) rad/s.
        torque: (N,) N m, of the law, without noise.
        noise: standard deviation, N m.
    """

    joint: str
    law: str
    physical: tuple[float, ...]
    velocity: FloatArray
    torque: FloatArray
    noise: float

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("velocity", "torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_half_cosine(peak: float, samples: int) -> FloatArray:
    """Return velocities (N,) of half a period in the positive direction, `peak` in rad/s."""
    return peak * np.sin(np.pi * (np.arange(samples) + 0.5) / samples)


def build_whole_cosines(peaks: Sequence[float], samples: int) -> FloatArray:
    """Return velocities of one period of each cosine, one after the other: (len(peaks) N,) in rad/s."""
    wave = -np.sin(2.0 * np.pi * (np.arange(samples) + 0.5) / samples)
    return np.concatenate([peak * wave for peak in peaks])


def build_scene(joint: str, law: str, physical: Sequence[float], velocity: FloatArray, noise: float) -> Scene:
    """Return the scene; arguments as its fields.

    Raises:
        UsageError: there is no such law.
    """
    known = get_law(law)
    linear, shape = known.from_physical(physical)
    return Scene(
        joint=joint,
        law=law,
        physical=tuple(physical),
        velocity=velocity,
        torque=find_torque(known, {"velocity": velocity}, linear, shape),
        noise=noise,
    )


def draw_samples(scene: Scene, generator: np.random.Generator) -> FrictionSamples:
    """Return the scene with noise."""
    count = len(scene.velocity)
    return FrictionSamples(
        joint=scene.joint,
        time=_PERIOD * (np.arange(count) + 0.5) / count,
        velocity=scene.velocity,
        torque=scene.torque + scene.noise * generator.standard_normal(count),
        extra=np.zeros((count, 0)),
    )
