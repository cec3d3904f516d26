"""Damped Gauss-Newton steps in the shape of a friction law, with Kaufman's Jacobian.

Projector, Projection -> Projection, which carries a shape of less objective, and whether the steps converged.

    d = argmin |r + F d|^2 + lambda |D d|^2,   D the lengths of F's columns

Levenberg, Quart. Appl. Math. 2 (1944) 164-168; Marquardt, J. SIAM 11 (1963) 431-441. Lambda follows the
curvature that the last step found: with one shape value the next step is that of the secant.

Supported: bounds, coordinates that stay. Not supported: optima in a kink of the objective.
"""

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.friction.projection import Projection, Projector

__all__ = ["IntArray", "descend"]

IntArray = NDArray[np.int64]
_DAMPING = 1e-3
_MOST_WANTED = 10.0
_MOST_FAILED = 100.0
"""Damping at most after a step that made J greater, unless it was greater before."""
_RESOLVED = 1e-15
"""Part of J by which a step must promise to make it less: rounding hides what is smaller."""
_ROUNDING = 1e-11
"""Part of J below which a change of J says nothing of its curvature."""
_POOR = 0.25
"""Of the promised gain: a step in several directions that gives more is not too long in most of them."""
_LONGEST = 1.5
"""Step in a logarithm at most."""


def descend(
    projector: Projector,
    state: Projection,
    free: IntArray,
    *,
    tolerance: float,
    steps: int,
    history: list[float],
    patience: int = 60,
    box: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[Projection, bool]:
    """Return the end of damped Gauss-Newton steps in the coordinates `free`, and whether it converged.

    `patience` is how many steps in a row may fail, `box` where z may go, if not all of the search's.
    """
    problem = projector.problem
    low, high = box or (problem.encode(problem.low), problem.encode(problem.high))
    damping, failed = _DAMPING, 0
    jacobian, fresh = projector.find_jacobian(state), False
    for _ in range(steps):
        if projector.exhausted or failed >= patience:
            return state, False
        if fresh:
            jacobian = projector.find_jacobian(state)
        fresh = False
        slope = jacobian.T @ state.residual
        held = ((state.z <= low) & (slope > 0.0)) | ((state.z >= high) & (slope < 0.0))
        moving = free[~held[free]]
        step = np.zeros(len(low))
        if len(moving):
            step[moving] = _solve_damped(jacobian[:, moving], state.residual, damping)
            projector.solves += 1
        step *= min(1.0, _LONGEST / max(float(np.max(np.abs(step))), 1e-300))
        trial_z = np.clip(state.z + step, low, high)
        step = trial_z - state.z
        bend = jacobian @ step
        promised = -float((2.0 * state.residual + bend) @ bend)
        unseen = damping <= _MOST_WANTED and promised <= _RESOLVED * state.objective
        if unseen or float(np.max(np.abs(step), initial=0.0)) <= tolerance:
            return state, True
        trial = projector.project(trial_z)
        wanted = _find_damping(jacobian, state, trial)
        if trial.objective < state.objective:
            damping = max(0.1 * damping, min(wanted, _MOST_WANTED), 1e-12)
            state, fresh, failed = trial, True, 0
            history.append(min(history[-1], state.objective))
        else:
            damping = max(damping * (10.0 if damping > 1e-6 else 1e3), min(wanted, _MOST_FAILED))
            failed += 1
    return state, False


def _find_damping(jacobian: FloatArray, state: Projection, trial: Projection) -> float:
    """Return the damping that makes the model of J as curved as J was along the last step.

    J(d) = J + 2 r'F d + (1 + c) |F d|^2 is solved for c. The damping is c |F d|^2 / |D d|^2: with one shape
    value, the next step is that of the secant. Without it, steps that all go too far close in on the optimum
    from both sides as slowly as c tells, although each of them makes J less.
    """
    step = trial.z - state.z
    bend = jacobian @ step
    curved, length = float(bend @ bend), float(np.sum((np.linalg.norm(jacobian, axis=0) * step) ** 2))
    if curved <= _ROUNDING * state.objective or length == 0.0:
        return 0.0
    slope = 2.0 * float(state.residual @ bend)
    gain = trial.objective - state.objective
    if np.count_nonzero(step) > 1 and gain < _POOR * (slope + curved):
        return 0.0
    return max(gain - slope - curved, 0.0) / length


def _solve_damped(jacobian: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
    """Return argmin |r + J d|^2 + damping |D d|^2, D the lengths of J's columns, by QR."""
    lengths = np.linalg.norm(jacobian, axis=0)
    lengths[lengths == 0.0] = 1.0
    scaled = np.vstack([jacobian / lengths, np.sqrt(damping) * np.eye(len(lengths))])
    right = np.concatenate([-residual, np.zeros(len(lengths))])
    step: FloatArray = np.linalg.lstsq(scaled, right, rcond=1e-13)[0] / lengths
    return step
