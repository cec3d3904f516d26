"""One descent from one trajectory: Ipopt, with the limits that matter there.

Input: a problem, unknowns, a criterion. Output: `Descent`: unknowns that are better and keep the limits at
the points of the problem, or those it started from.

Of torque, torsion and space only what is near its limit is watched; what the result breaks is watched as
well, and the descent goes on from there.

Supported: starts that break limits: the result then counts as better as soon as it keeps them.
Not supported: a search beyond the next optimum; see `optimise`.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.excitation.criteria import Criterion
from symid.excitation.ipopt import IpoptOptions, SmoothProblem, run_ipopt
from symid.excitation.problem import ExcitationProblem, Mask

__all__ = ["Descent", "find_descent"]

_NEAR = 0.75
"""Part of a limit from which on it is watched."""
_ROUNDS = 5
"""Of watching more; in the last one everything is watched."""
_SLACK = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Descent:
    """Where a descent ended: unknowns (n r,), criterion, Ipopt's iterations and status, limits kept?"""

    unknowns: FloatArray
    value: float
    iterations: int
    status: str
    feasible: bool


def find_descent(
    problem: ExcitationProblem,
    start: FloatArray,
    criterion: Criterion,
    options: IpoptOptions,
    tightening: FloatArray,
) -> Descent:
    """Return the descent from `start` (n r,).

    Args:
        problem: functions and limits.
        start: where to begin.
        criterion: what is minimised.
        options: of each run of Ipopt.
        tightening: (v,) taken off the limits of torque, torsion and space.
    """
    evaluator = _Evaluator(problem, criterion)
    state_limits = 1.0 - tightening
    unknowns, iterations, status = start, 0, ""
    watched = np.zeros((problem.points, len(tightening)), dtype=bool)
    if len(tightening):
        watched = problem.find_state_use(start) > _NEAR * state_limits
    for round_ in range(_ROUNDS):
        ending = run_ipopt(_build_functions(problem, evaluator, tightening, watched), unknowns, options)
        iterations, status = iterations + ending.iterations, ending.status
        if not np.all(np.isfinite(ending.unknowns)):
            break
        unknowns = ending.unknowns
        if not len(tightening):
            break
        use = problem.find_state_use(unknowns)
        if not np.any((use > state_limits + _SLACK) & ~watched):
            break
        watched |= (use > _NEAR * state_limits) | (round_ == _ROUNDS - 2)
    was, here = evaluator.evaluate(start)[0], evaluator.evaluate(unknowns)[0]
    before, after = (_is_feasible(problem, z, state_limits) for z in (start, unknowns))
    better = (after and not before) or (after == before and here < was)
    return Descent(
        unknowns=unknowns if better else start,
        value=here if better else was,
        iterations=iterations,
        status=status,
        feasible=after if better else before,
    )


@final
class _Evaluator:
    """Value and gradient; the last point is kept, as the solver asks for it twice."""

    def __init__(self, problem: ExcitationProblem, criterion: Criterion) -> None:
        self.problem, self.criterion = problem, criterion
        self.key, self.kept = b"", (0.0, np.zeros(0))

    def evaluate(self, z: FloatArray) -> tuple[float, FloatArray]:
        if z.tobytes() != self.key:
            self.kept, self.key = self.problem.find_value(z, self.criterion), z.tobytes()
        return self.kept


def _build_functions(
    problem: ExcitationProblem, evaluator: _Evaluator, tightening: FloatArray, watched: Mask
) -> SmoothProblem:
    lower, upper = problem.find_bounds(tightening, watched)
    return SmoothProblem(
        value=lambda z: evaluator.evaluate(z)[0],
        gradient=lambda z: evaluator.evaluate(z)[1],
        constraints=lambda z: problem.find_constraints(z, watched),
        jacobian=lambda z: problem.find_jacobian(z, watched),
        pattern=problem.find_pattern(watched),
        lower=lower,
        upper=upper,
    )


def _is_feasible(problem: ExcitationProblem, z: FloatArray, state_limits: FloatArray) -> bool:
    linear = np.abs(problem.rows @ z + problem.constants)
    if np.any(linear > 1.0 + _SLACK):
        return False
    return not len(state_limits) or not np.any(problem.find_state_use(z) > state_limits + _SLACK)
