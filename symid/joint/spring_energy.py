"""Where the work done on a spring with hysteresis goes: energy stored and energy lost.

Input: an elasticity and its torsion, or a compliance model and its torque (N,). Output: energies (N,) in J.
With the inverse phi = sum_i w'_i P'_i[v], tau = S(v) and G the integral of S,

    U = sum_i w'_i [G(P'_i + r'_i) + G(P'_i - r'_i)] / 2
    D = sum_i w'_i int [S(P'_i + r'_i) - S(P'_i - r'_i)] |dP'_i| / 2

The work since the first sample is the change of U, plus D. Without knees U = k0 phi^2 / 2 + sum k_i E_i^2 / 2
and D = sum k_i r_i int |dP_i| (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996). All is exact
for inputs that are monotone between samples.

Supported: springs with stops, with a cubic part or with knees; compliance models.
Not supported: a cubic part together with knees. Other splits of the same work exist; the sum is unique.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.joint.play_model import PlayModel
from symid.joint.plays import find_inverse_plays, find_plays
from symid.joint.spring_numbers import find_outer_integral, find_spring_numbers
from symid.robot.elasticity import Elasticity

__all__ = [
    "find_compliance_dissipation",
    "find_compliance_energy",
    "find_dissipation",
    "find_stored_energy",
]


def find_stored_energy(
    elasticity: Elasticity, phi: FloatArray, memory: FloatArray | None = None
) -> FloatArray:
    """Return the energy (N,) in J that the spring holds along its torsion (N,).

    Raises:
        RobotError: the spring has a cubic part and knees; a stiffness is not known.
    """
    phi = np.asarray(phi, dtype=np.float64)
    spring = find_spring_numbers(elasticity)
    if not elasticity.knees:
        stops = phi[:, None] - find_plays(phi, spring.thresholds, memory)
        linear = 0.5 * spring.stiffness * np.square(phi) + 0.25 * spring.cubic * phi**4
        return linear + 0.5 * np.square(stops) @ spring.weights
    inverse = find_inverse_plays(elasticity, phi, memory)
    upper = find_outer_integral(spring.terms, inverse.plays + inverse.thresholds)
    lower = find_outer_integral(spring.terms, inverse.plays - inverse.thresholds)
    # A virgin spring at rest holds nothing.
    rest = find_outer_integral(spring.terms, inverse.thresholds)
    rest = rest + find_outer_integral(spring.terms, -inverse.thresholds)
    return 0.5 * (upper + lower - rest) @ inverse.weights


def find_dissipation(elasticity: Elasticity, phi: FloatArray, memory: FloatArray | None = None) -> FloatArray:
    """Return the energy (N,) in J lost since the first sample, damping left out; it never decreases.

    Raises:
        RobotError: the spring has a cubic part and knees; a stiffness is not known.
    """
    phi = np.asarray(phi, dtype=np.float64)
    spring = find_spring_numbers(elasticity)
    if not elasticity.knees:
        plays = find_plays(phi, spring.thresholds, memory)
        ways = np.abs(np.diff(plays, axis=0, prepend=plays[:1]))
        return np.cumsum(ways @ (spring.weights * spring.thresholds))
    inverse = find_inverse_plays(elasticity, phi, memory)
    plays, radii = inverse.plays, inverse.thresholds
    gaps = find_outer_integral(spring.terms, plays + radii) - find_outer_integral(spring.terms, plays - radii)
    signs = np.sign(np.diff(plays, axis=0, prepend=plays[:1]))
    steps = np.maximum(0.5 * signs * np.diff(gaps, axis=0, prepend=gaps[:1]), 0.0)
    return np.cumsum(steps @ inverse.weights)


def find_compliance_energy(
    model: PlayModel, torque: FloatArray, memory: FloatArray | None = None
) -> FloatArray:
    """Return the energy (N,) stored where phi = sum_i w_i P_i[tau]: sum_i w_i P_i^2 / 2."""
    plays = _find_all_plays(model, torque, memory)
    return np.asarray(0.5 * np.square(plays) @ np.array(model.weights), dtype=np.float64)


def find_compliance_dissipation(
    model: PlayModel, torque: FloatArray, memory: FloatArray | None = None
) -> FloatArray:
    """Return the energy (N,) lost since the first sample: sum_i w_i r_i int |dP_i|."""
    plays = _find_all_plays(model, torque, memory)
    ways = np.abs(np.diff(plays, axis=0, prepend=plays[:1]))
    losses = np.array(model.weights[1:]) * np.array(model.thresholds)
    return np.asarray(np.cumsum(ways[:, 1:] @ losses), dtype=np.float64)


def _find_all_plays(model: PlayModel, torque: FloatArray, memory: FloatArray | None) -> FloatArray:
    torque = np.asarray(torque, dtype=np.float64)
    return np.column_stack([torque, find_plays(torque, np.array(model.thresholds), memory)])
