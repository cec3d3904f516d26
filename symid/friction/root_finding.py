"""Root-finding least squares: the stationary points of the objective over one shape value.

FrictionProblem -> FrictionSearch.

    h(s) = r(s)' dPhi/ds c(s) = -1/2 dJ/ds = 0,    r = y - Phi c,    c = Phi^+ y

h is scanned at values spaced by equal factors; Brent's method finds the root in every interval where its sign
changes; the root of least J is kept. For Stribeck friction in one direction this is the first row of Table 2
of Zhang, Hu and Zou (2021), as far as its description tells. All of it is variable projection with one
unknown.

Supported: laws with one free shape value, motions in one direction.
Not supported: both directions, more shape values (`variable_projection` does both).
"""

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.friction.doubts import is_one_sided
from symid.friction.estimate import FrictionOutcome
from symid.friction.options import RootFindingOptions
from symid.friction.problem import FrictionProblem
from symid.friction.projection import Projection, Projector
from symid.friction.reduction import find_rows
from symid.friction.search import FrictionSearch

__all__ = ["search_by_roots"]


def search_by_roots(problem: FrictionProblem, options: RootFindingOptions) -> FrictionSearch:
    """Return the stationary point of least objective, or the better end of the scan where there is none.

    Args:
        problem: with one shape value that is not fixed, and one direction of motion.
        options: points of the scan, tolerance.

    Raises:
        UsageError: both directions, or another number of shape values.
    """
    from scipy.optimize import brentq

    place = _find_place(problem)
    projector = Projector(problem, np.iinfo(np.int64).max)
    ends = [problem.encode(values) for values in (problem.low, problem.high)]
    kept: dict[float, tuple[float, Projection]] = {}

    def find_slope(coordinate: float) -> float:
        if coordinate not in kept:
            z = np.array(ends[0])
            z[place] = coordinate
            state = projector.project(z)
            slope = float(-(projector.find_jacobian(state)[:, place] @ state.residual))
            kept[coordinate] = slope, state
        return kept[coordinate][0]

    scan = [float(value) for value in np.linspace(ends[0][place], ends[1][place], options.points)]
    slopes = [find_slope(value) for value in scan]
    history = [min(state.objective for _, state in kept.values())]
    roots: list[FloatArray] = []
    for left, right, before, after in zip(scan[:-1], scan[1:], slopes[:-1], slopes[1:], strict=True):
        if before * after < 0.0:
            root = float(brentq(find_slope, left, right, xtol=options.tolerance, rtol=1e-14))
            find_slope(root)
            roots.append(np.array(root))
            history.append(min(history[-1], kept[root][1].objective))
    best = min((state for _, state in kept.values()), key=lambda state: state.objective)
    found = len(roots) > 0
    return FrictionSearch(
        linear=best.linear,
        shape=best.shape,
        objective=best.objective,
        evaluations=projector.evaluations,
        solves=projector.solves,
        iterations=len(history) - 1,
        history=tuple(history),
        outcome=FrictionOutcome.CONVERGED if found else FrictionOutcome.STALLED,
        ended=f"{len(roots)} roots were found, the best is kept"
        if found
        else "the slope never changes its sign",
        settings=(("points", options.points), ("roots", len(roots))),
    )


def _find_place(problem: FrictionProblem) -> int:
    """Return which shape value is free, the only one."""
    free = np.flatnonzero(problem.is_free)
    mistakes = []
    if len(free) != 1:
        mistakes.append(
            f"root finding needs a law with one shape value to search; {problem.law.name!r} has {len(free)} "
            "here: use the estimator 'varpro'"
        )
    if not is_one_sided(find_rows(problem.samples).velocity):
        mistakes.append(
            "root finding is for motion in one direction, and these samples hold both: "
            "use the estimator 'varpro'"
        )
    if mistakes:
        raise UsageError(*(Notice(code="usage.root-finding", text=text) for text in mistakes))
    return int(free[0])
