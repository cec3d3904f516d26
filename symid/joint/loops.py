"""Closed forms of the loops of a spring with hysteresis: first curve, branches, loss of a cycle.

Input: an elasticity and amplitudes or torsions of any shape. Output: torques, energies. They hold for a
spring that was virgin before, and say the same as `plays` by another way:

    first curve   v(A) = k0 A + sum_i k_i min(r_i, A), odd
    branch        v = v(A) - 2 v((A - phi) / 2)                            (Masing)
    cycle +-A     D = 4 sum_i k_i r_i max(A - r_i, 0)                      without knees

Supported: springs with stops and knees; a cubic part in the curves.
Not supported: the loss of a cycle where there are knees; `spring_energy` has it along any path.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.joint.spring_numbers import SpringNumbers, find_outer_torque, find_spring_numbers
from symid.robot.elasticity import Elasticity

__all__ = ["find_branch", "find_cycle_loss", "find_first_curve"]


def find_first_curve(elasticity: Elasticity, phi: FloatArray) -> FloatArray:
    """Return the torque of a virgin spring that is turned to `phi` without reversal.

    Raises:
        RobotError: a stiffness is not known.
    """
    spring = find_spring_numbers(elasticity)
    phi = np.asarray(phi, dtype=np.float64)
    return find_outer_torque(spring.terms, _find_first(spring, phi) + spring.cubic * phi**3)


def find_branch(elasticity: Elasticity, reversal: float, phi: FloatArray) -> FloatArray:
    """Return the torque on the way back from the first reversal, between it and minus it.

    Args:
        elasticity: the joint.
        reversal: torsion A at which the way of a virgin spring was reversed, rad or m; either sign.
        phi: torsions between A and -A, of any shape.

    Raises:
        RobotError: a stiffness is not known.
    """
    spring = find_spring_numbers(elasticity)
    phi = np.asarray(phi, dtype=np.float64)
    start = _find_first(spring, np.asarray(reversal, dtype=np.float64))
    inner = start - 2.0 * _find_first(spring, 0.5 * (reversal - phi))
    return find_outer_torque(spring.terms, inner + spring.cubic * phi**3)


def find_cycle_loss(elasticity: Elasticity, amplitude: float) -> float:
    """Return the energy in J lost in a cycle between `amplitude` and minus it, knees left out."""
    spring = find_spring_numbers(elasticity)
    slips = np.maximum(abs(amplitude) - spring.thresholds, 0.0)
    return float(4.0 * np.sum(spring.weights * spring.thresholds * slips))


def _find_first(spring: SpringNumbers, phi: FloatArray) -> FloatArray:
    """Return v(phi) without the cubic part."""
    clipped = np.clip(phi[..., None], -spring.thresholds, spring.thresholds)
    return np.asarray(spring.stiffness * phi + clipped @ spring.weights, dtype=np.float64)
