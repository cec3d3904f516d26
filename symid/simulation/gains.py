"""PD gains for the motors of an elastic robot.

Input: masses, rotor inertias, a bandwidth, the control period. Output: Kp and Kd per joint.

    J = mean of 1 / ((M + B)^-1)_jj,   Kd = 2 w J, at most a share of B / T,   Kp = Kd^2 / (4 J)

A torque that is held for T damps a motor of inertia B only while Kd T / B < 2; springs leave the motor alone
with it at high frequency. Kp follows Kd, so that the loop stays critically damped.

Supported: motor-side loops with the motor's speed. Not supported: loops on link encoders.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from symid.arrays import FloatArray

__all__ = ["SHIPPED_GAINS", "Gains", "find_gains"]

_DAMPING_SHARE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """Kp `stiffness` (N m/rad or N/m) and Kd `damping` (N m s/rad or N s/m) of each joint."""

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


SHIPPED_GAINS: Mapping[str, Gains] = MappingProxyType(
    {"two_link_elastic": Gains(stiffness=(4000.0, 1500.0), damping=(120.0, 40.0))}
)
"""Gains that go with the values of a shipped robot; by the name of the robot."""


def find_gains(mass: FloatArray, rotor: FloatArray, bandwidth: float, period: float) -> Gains:
    """Return gains with which every joint is critically damped.

    Args:
        mass: (K, n, n) kg m^2, at poses along the way.
        rotor: (n,) kg m^2.
        bandwidth: Hz.
        period: of the control loop, s.
    """
    whole = mass + np.diag(rotor)
    inertia = np.mean(1.0 / np.diagonal(np.linalg.inv(whole), axis1=1, axis2=2), axis=0)
    damping = np.minimum(4.0 * np.pi * bandwidth * inertia, _DAMPING_SHARE * rotor / period)
    stiffness = damping**2 / (4.0 * inertia)
    return Gains(stiffness=tuple(stiffness.tolist()), damping=tuple(damping.tolist()))
