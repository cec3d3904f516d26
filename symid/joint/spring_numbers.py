"""The numbers of an elastic joint as arrays, and as terms of the float carrier.

Input: `Elasticity`. Output: `SpringNumbers`: stop weights, outer function, its inverse and its integral.

Supported: every elasticity whose stiffnesses are known.
Not supported: unknown stiffnesses; they are refused by name.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, RobotError
from symid.joint.hysteresis import OperatorCarrier, SpringTerms, invert_outer_terms
from symid.robot.elasticity import Elasticity

__all__ = [
    "FLOATS",
    "SpringNumbers",
    "find_outer_integral",
    "find_outer_torque",
    "find_spring_numbers",
    "find_spring_terms",
    "invert_outer",
]

FLOATS: OperatorCarrier[float] = OperatorCarrier(zero=0.0, one=1.0, maximum=max, minimum=min)
"""Doubles as a carrier of the hysteresis model."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringNumbers:
    """What the numerical forms of a spring use.

    Args:
        stiffness: k0, N m/rad or N/m.
        cubic: k3, N m/rad^3 or N/m^3.
        thresholds: (m,) r_i, rad or m.
        weights: (m,) k_i, N m/rad or N/m.
        terms: the same for the float carrier, with the knees.
    """

    stiffness: float
    cubic: float
    thresholds: FloatArray
    weights: FloatArray
    terms: SpringTerms[float]


def find_spring_terms(elasticity: Elasticity) -> SpringTerms[float]:
    """Return the numbers of an elasticity for the float carrier.

    Raises:
        RobotError: a stiffness is not known.
    """
    if elasticity.initial_stiffness is None or elasticity.stiffness is None:
        text = "a stiffness is unknown, and torque needs all of them; give it, or identify it first"
        raise RobotError(Notice(code="robot.unknown-stiffness", text=text))
    knees = elasticity.knees
    return SpringTerms(
        stiffness=elasticity.stiffness,
        cubic=elasticity.cubic or None,
        stops=tuple((stop.threshold, stop.stiffness or 0.0) for stop in elasticity.stops),
        above=tuple((knee.threshold, knee.slope) for knee in knees if knee.threshold > 0),
        below=tuple((knee.threshold, knee.slope) for knee in reversed(knees) if knee.threshold < 0),
    )


def find_spring_numbers(elasticity: Elasticity) -> SpringNumbers:
    """Return the numbers of an elasticity as arrays.

    Raises:
        RobotError: a stiffness is not known.
    """
    terms = find_spring_terms(elasticity)
    return SpringNumbers(
        stiffness=terms.stiffness,
        cubic=elasticity.cubic,
        thresholds=freeze([threshold for threshold, _ in terms.stops]),
        weights=freeze([weight for _, weight in terms.stops]),
        terms=terms,
    )


def find_outer_torque(terms: SpringTerms[float], value: FloatArray) -> FloatArray:
    """Return S(v), N m or N, at values v of any shape."""
    return _apply(terms.above, terms.below, value)


def invert_outer(terms: SpringTerms[float], torque: FloatArray) -> FloatArray:
    """Return v with S(v) = torque, N m or N, for torques of any shape."""
    above = invert_outer_terms(FLOATS, terms.above)
    return _apply(above, invert_outer_terms(FLOATS, terms.below), torque)


def find_outer_integral(terms: SpringTerms[float], value: FloatArray) -> FloatArray:
    """Return G(v), the integral of S from 0 to v, at values v of any shape."""
    result = 0.5 * value * value
    for threshold, slope in terms.above:
        result = result + 0.5 * slope * np.square(np.maximum(value - threshold, 0.0))
    for threshold, slope in terms.below:
        result = result + 0.5 * slope * np.square(np.minimum(value - threshold, 0.0))
    return np.asarray(result, dtype=np.float64)


def _apply(
    above: tuple[tuple[float, float], ...], below: tuple[tuple[float, float], ...], value: FloatArray
) -> FloatArray:
    result = np.array(value, dtype=np.float64)
    for threshold, slope in above:
        result += slope * np.maximum(value - threshold, 0.0)
    for threshold, slope in below:
        result += slope * np.minimum(value - threshold, 0.0)
    return result
