"""Joint friction as Zhang, Hu and Zou (2021) print it, and synthetic data with their parameters.

    v_k = -V sin(2 pi (k + 1/2) / N)

Half a step off the grid no sample stands still: there a law without a zone would have no torque at all.

Zhang Tie, Hu Liangliang, Zou Yanbiao, "Identification of improved friction model for robot based on hybrid
genetic algorithm", J. Zhejiang Univ. (Eng. Sci.) 55(5) (2021) 801-809,
doi 10.3785/j.issn.1008-973X.2021.05.001.

Supported: the numbers of their Tables 1, 3 and 4; a second published truth; white noise of the torque.
Not supported: their recordings, which are not public.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.identification.friction import FrictionSamples
from symid.joint_models import compute_friction_torque, get_law


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedMethod:
    """A row of Table 1: fC, fS in N m, vs in rad/s, fV in N m s/rad, sum of squared errors in (N m)^2."""

    method: str
    values: tuple[float, ...]
    objective: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedJoint:
    """Parameters of a joint, in the order of the law's `physical`, SI units."""

    joint: str
    law: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedSums:
    """A row of Table 4.

    Args:
        joint: its number.
        sums: of squared errors by Coulomb + viscous, original Stribeck, improved Stribeck, (N m)^2.
        printed: how much less the improved law leaves than the two others, in percent.
        noise: standard deviation, N m, set here so that the gain over Coulomb + viscous comes out as printed.
    """

    joint: str
    sums: tuple[float, float, float]
    printed: tuple[float, float]
    noise: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A motion in one direction: half a period of a cosine, its peak in rad/s, so many samples."""

    peak: float
    samples: int


TABLE_1 = (
    PublishedMethod(method="LS", values=(10.76, 19.66, 0.0385, 24.03), objective=251.0),
    PublishedMethod(method="GA", values=(10.75, 19.73, 0.0384, 24.05), objective=252.0),
    PublishedMethod(method="hybrid GA", values=(10.76, 19.68, 0.0385, 24.04), objective=251.0),
)
TRUTH_1 = TABLE_1[-1]
SWEEPS = (Sweep(peak=0.5, samples=500), Sweep(peak=0.1, samples=500), Sweep(peak=0.3, samples=1000))
"""Of protocol S1; the paper says neither peak nor samples. The first one is shown in full."""

_IMPROVED = "improved-stribeck"
TABLE_3 = (
    # fC, fS, vs, fV, fP, dq0; the exponent is 2 in all rows.
    PublishedJoint(joint="1", law=_IMPROVED, values=(11.64, 23.19, 0.02767, 27.88, 0.47, 0.010)),
    PublishedJoint(joint="2", law=_IMPROVED, values=(39.93, 73.24, 0.01292, 89.24, -3.34, 0.005)),
    PublishedJoint(joint="3", law=_IMPROVED, values=(38.53, 53.78, 0.01557, 89.49, -4.74, 0.010)),
)
RECOVERY_NOISE = (1.0, 5.0, 2.0)
"""Of protocol S2, joint by joint, N m."""
RECOVERY_PEAKS = (0.1, 1.0)
"""Of its two cosines, rad/s."""

TABLE_4 = (
    PublishedSums(joint="1", sums=(629.0, 537.0, 449.0), printed=(28.6, 16.3), noise=3.84),
    PublishedSums(joint="2", sums=(26873.0, 25076.0, 22103.0), printed=(17.7, 11.8), noise=13.57),
    PublishedSums(joint="3", sums=(5881.0, 4725.0, 3909.0), printed=(33.6, 17.3), noise=9.53),
)

RV_2SQ = (
    # Mitsubishi RV-2SQ: fC, fS, vs, fV; the exponent is part of the law.
    PublishedJoint(joint="RV-2SQ 1", law="stribeck-2.09", values=(2.8503, 4.78, 0.025, 4.7618)),
    PublishedJoint(joint="RV-2SQ 2", law="stribeck-2.78", values=(7.7407, 7.97, 0.05, 13.4593)),
    PublishedJoint(joint="RV-2SQ 3", law="stribeck-2.72", values=(3.3459, 5.81, 0.05, 4.1019)),
    PublishedJoint(joint="RV-2SQ 4", law="stribeck-1.6", values=(1.6581, 2.15, 0.05, 1.3165)),
)
"""A second truth with published values."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionScene(FrozenArrays):
    """A joint whose friction is known, in motion.

    Args:
        joint: its name; law: the name of its friction law.
        physical: true parameters, in the order of the law's.
        velocity: (N,) rad/s.
        noise: standard deviation, N m.
    """

    joint: str
    law: str
    physical: tuple[float, ...]
    velocity: FloatArray
    noise: float

    @property
    def torque(self) -> FloatArray:
        """Return the torque (N,) of the law, N m, without noise."""
        law = get_law(self.law)
        linear, shape = law.from_physical(self.physical)
        return compute_friction_torque(law, {"velocity": self.velocity}, linear, shape)


def build_half_cosine(peak: float, samples: int) -> FloatArray:
    """Return velocities (N,) of half a period in the positive direction, `peak` in rad/s."""
    return peak * np.sin(np.pi * (np.arange(samples) + 0.5) / samples)


def build_whole_cosines(peaks: Sequence[float], samples: int) -> FloatArray:
    """Return velocities of one period of each cosine, one after the other: (len(peaks) N,) in rad/s."""
    wave = -np.sin(2.0 * np.pi * (np.arange(samples) + 0.5) / samples)
    return np.concatenate([peak * wave for peak in peaks])


def draw_samples(scene: FrictionScene, generator: np.random.Generator) -> FrictionSamples:
    """Return the scene with noise."""
    count = len(scene.velocity)
    return FrictionSamples(
        joint=scene.joint,
        # One period in 1 s; friction without a memory does not depend on it.
        time=(np.arange(count) + 0.5) / count,
        velocity=scene.velocity,
        torque=scene.torque + scene.noise * generator.standard_normal(count),
        extra=np.zeros((count, 0)),
    )
