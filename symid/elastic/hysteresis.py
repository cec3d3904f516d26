"""The hysteresis of every joint, given filtered joint torques.

ElasticProblem, torques -> springs.

Supported: thresholds and knees on grids, moved to where the data put them, or given.
Not supported: joints that share a spring.
"""

from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.options import ElasticOptions
from symid.elastic.problem import ElasticProblem
from symid.elastic.refinement import refine_spring
from symid.elastic.spring_fit import SpringData, find_filtered_torque, find_knee_grid, fit_spring, fit_stops
from symid.elastic.spring_weights import SpringWeights

__all__ = ["fit_spring_of", "fit_springs", "join_sides", "start_spring"]


def fit_springs(problem: ElasticProblem, torque: FloatArray) -> tuple[SpringWeights, ...]:
    """Return the springs, one a joint, that explain F[tau_J] best: (M, n) in N m at the filtered rows."""
    return tuple(
        fit_spring_of(problem.options, data, joint, torque[:, joint])
        for joint, data in enumerate(problem.springs)
    )


def fit_spring_of(options: ElasticOptions, data: SpringData, joint: int, target: FloatArray) -> SpringWeights:
    """Return the spring of one joint that explains F[tau_J] (M,) best."""
    weights = fit_spring(data, target, start_spring(options, data, joint, target))
    refine = options.refine and options.thresholds is None
    return refine_spring(data, target, weights) if refine else weights


def start_spring(options: ElasticOptions, data: SpringData, joint: int, target: FloatArray) -> SpringWeights:
    """Return the best spring without knees, with the knees that are to be fitted next.

    Args:
        options: say which knees.
        data: stop basis of the joint.
        joint: its index.
        target: F[tau_J] of the joint (M,), N m.
    """
    weights = fit_stops(data, target)
    if options.knee_torques is not None:
        torques = np.array(options.knee_torques[joint], dtype=np.float64)
        below, above = torques[torques < 0][::-1], torques[torques > 0]
    elif options.knees:
        below, above = find_knee_grid(data, weights.stiffness, options.knees)
    else:
        return weights
    return replace(
        weights,
        below=below,
        above=above,
        below_slopes=np.ones(len(below)),
        above_slopes=np.ones(len(above)),
    )


def join_sides(problem: ElasticProblem, chi: FloatArray) -> FloatArray:
    """Return F[tau_J] (M, n), the mean of motor and link side, each weighted by the inverse of its variance.

    The variances are those about a spring on the grid, so that a side with more noise counts less.

    Args:
        problem: the filtered rows.
        chi: (p + n + pf,) dynamic parameters.
    """
    beta, joints, _ = problem.sizes
    motor = problem.torque - problem.motor @ chi[beta:]
    link = problem.link @ chi[:beta]
    joined = np.empty_like(motor)
    for joint in range(joints):
        data = problem.springs[joint]
        sides = [motor[:, joint], link[:, joint]]
        shared = fit_spring(
            data, (sides[0] + sides[1]) / 2.0, start_spring(problem.options, data, joint, sides[1])
        )
        value = find_filtered_torque(data, shared)
        inverse = [1.0 / max(float(np.mean((side - value) ** 2)), 1e-300) for side in sides]
        joined[:, joint] = (inverse[0] * sides[0] + inverse[1] * sides[1]) / (inverse[0] + inverse[1])
    return joined
