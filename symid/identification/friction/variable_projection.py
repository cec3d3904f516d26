"""Variable projection: the shape of a friction law is searched, the rest follows by linear least squares.

    d = argmin |r + F d|^2 + lambda |D d|^2,   D the lengths of the columns of Kaufman's Jacobian F
    h(s) = r(s)' dPhi/ds c(s) = -1/2 dJ/ds = 0                           root finding, one shape value

Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432; Kaufman, BIT 15 (1975) 49-57; Levenberg, Quart.
Appl. Math. 2 (1944) 164-168; Marquardt, J. SIAM 11 (1963) 431-441. Damped Gauss-Newton steps in the
logarithms start from a grid of shapes. A linear zone gives J a kink wherever its edge passes a sample: the
edge is set onto the kinks next to it, and beyond them. Where friction changes its sign at a velocity that is
searched, J jumps: the intervals between jumps are tried. Root finding (first row of Table 2 of Zhang, Hu and
Zou (2021)) scans h at values spaced by equal factors and finds each root by Brent's method.

Supported: up to three free shape values, dependent columns; no bounds of linear parameters.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.identification.friction.joint_fit import FrictionSearch, is_one_sided
from symid.identification.friction.problem import (
    FrictionProblem,
    Projection,
    Projector,
    RootFindingOptions,
    VariableProjectionOptions,
)
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending

IntArray = NDArray[np.int64]
_MOST_WANTED = 10.0
_POOR = 0.25
"""Part of the promised gain above which a step in several directions counts as short enough."""


def descend(
    projector: Projector,
    state: Projection,
    free: IntArray,
    *,
    tolerance: float,
    steps: int,
    patience: int = 60,
    box: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[Projection, bool]:
    """Return the end of damped Gauss-Newton steps in the coordinates `free`, and whether it converged.

    `patience` is how many steps in a row may fail, `box` where z may go, if not all of the search's.
    """
    problem = projector.problem
    low, high = box or problem.box
    damping, failed = 1e-3, 0
    jacobian, fresh = projector.compute_jacobian(state), False
    for _ in range(steps):
        if projector.exhausted or failed >= patience:
            return state, False
        if fresh:
            jacobian = projector.compute_jacobian(state)
        fresh = False
        slope = jacobian.T @ state.residual
        held = ((state.z <= low) & (slope > 0.0)) | ((state.z >= high) & (slope < 0.0))
        moving = free[~held[free]]
        step = np.zeros(len(low))
        if len(moving):
            step[moving] = solve_scaled(jacobian[:, moving], -state.residual, rcond=1e-13, damping=damping)
            projector.solves += 1
        step *= min(1.0, 1.5 / max(float(np.max(np.abs(step))), 1e-300))
        trial_z = np.clip(state.z + step, low, high)
        step = trial_z - state.z
        bend = jacobian @ step
        promised = -float((2.0 * state.residual + bend) @ bend)
        # A smaller relative decrease of J is rounding.
        negligible = damping <= _MOST_WANTED and promised <= 1e-15 * state.objective
        if negligible or float(np.max(np.abs(step), initial=0.0)) <= tolerance:
            return state, True
        trial = projector.project(trial_z)
        # The damping that makes the model of J as curved as J was along the step:
        # J(d) = J + 2 r'F d + (1 + c) |F d|^2 is solved for c; the damping is c |F d|^2 / |D d|^2, with one
        # shape value the step of the secant. Without it, steps that are all too long converge slowly.
        step = trial.z - state.z
        bend = jacobian @ step
        curved, wanted = float(bend @ bend), 0.0
        length = float(np.sum((np.linalg.norm(jacobian, axis=0) * step) ** 2))
        if curved > 1e-11 * state.objective and length != 0.0:
            tilt, gain = 2.0 * float(state.residual @ bend), trial.objective - state.objective
            if np.count_nonzero(step) <= 1 or not gain < _POOR * (tilt + curved):
                wanted = max(gain - tilt - curved, 0.0) / length
        if trial.objective < state.objective:
            damping = max(0.1 * damping, min(wanted, _MOST_WANTED), 1e-12)
            state, fresh, failed = trial, True, 0
            projector.record(state)
        else:
            damping = max(damping * (10.0 if damping > 1e-6 else 1e3), min(wanted, 100.0))
            failed += 1
    return state, False


KINKED = frozenset({"dq0"})
"""Shape values with a kink in J at every speed sampled: the edge of the linear zone."""
JUMPING = frozenset({"dqs"})
"""Shape values at which J jumps whenever they pass a velocity sampled: where friction changes its sign."""
_PATIENCE = 3
"""Steps in a row that may fail near a kink."""
_ONE_JUMP = 1e-6
_CANDIDATES = 8
_LINEAR = "the law is linear in what is free"


def search_by_projection(problem: FrictionProblem, options: VariableProjectionOptions) -> FrictionSearch:
    """Return the optimum of a problem with at most three free shape values."""
    projector = Projector(problem, options.solves)
    free = np.flatnonzero(problem.is_free)
    if not len(free):
        best = projector.project(problem.box[0])
        projector.record(best)
        return projector.build_search(best, Ending.CONVERGED, _LINEAR)
    best = _scan_shapes(projector, options, free)
    names, tolerance = {problem.law.shape[place].name for place in free}, options.tolerance
    if not names & (KINKED | JUMPING):
        best, done = descend(projector, best, free, tolerance=tolerance, steps=60)
    else:
        patience = _PATIENCE if names & KINKED else 2 * _PATIENCE
        best, _ = descend(projector, best, free, tolerance=tolerance, steps=10, patience=patience)
        search = _visit_kinks if names & KINKED else _cross_jumps
        best, done = search(projector, best, free, tolerance)
    outcome, ended = Ending.STALLED, "no step made the objective less"
    if done:
        small = "the next step in the shape, or what it promises, fell below the tolerance"
        outcome, ended = Ending.CONVERGED, small if len(projector.history) > 1 else _LINEAR
    elif projector.exhausted:
        outcome, ended = Ending.LIMIT, f"{projector.limit} linear problems were solved"
    return projector.build_search(best, outcome, ended)


def _scan_shapes(projector: Projector, options: VariableProjectionOptions, free: IntArray) -> Projection:
    """Return the least of the ends of short descents from the best points of the grid."""
    problem = projector.problem
    states = [projector.project(z) for z in build_shape_grid(problem, options)]
    projector.record(*states)
    # The distance of the grid's points in each coordinate.
    spacing, (low, high) = np.ones(len(problem.low)), problem.box
    spacing[free] = (high - low)[free] / np.array(options.grid[len(free) - 1])
    if any(problem.law.shape[place].name in JUMPING for place in free):
        least = min(states, key=lambda state: state.objective)
        states = [_visit_jumps(projector, least, free, spacing)]
    starts: list[Projection] = []
    for state in sorted(states, key=lambda state: state.objective):
        # None next to another one chosen.
        apart = [float(np.max(np.abs((state.z - other.z) / spacing))) for other in starts]
        if len(starts) < options.starts and all(distance > 1.5 for distance in apart):
            starts.append(state)
    ends = [descend(projector, start, free, tolerance=1e-2, steps=6) for start in starts]
    return min((end for end, _ in ends), key=lambda state: state.objective)


def build_shape_grid(problem: FrictionProblem, options: VariableProjectionOptions) -> list[FloatArray]:
    """Return coordinates (s,) of the grid's shapes, in order; one alone where nothing is free."""
    low, high = problem.box
    free = np.flatnonzero(problem.is_free)
    if not len(free):
        return [low]
    counts = options.grid[len(free) - 1]
    axes = [[float(value)] for value in low]
    for place, count in zip(free, counts, strict=True):
        # Half a step from the bounds: there a column may vanish.
        steps = (np.arange(count) + 0.5) / count
        axes[place] = [float(value) for value in low[place] + steps * (high[place] - low[place])]
    names = [entry.name for entry in problem.law.shape]
    points = [np.array(point) for point in itertools.product(*axes)]
    if not {"g2", "g3"} <= set(names):
        return points
    # These may be exchanged; bounds around an earlier fit may hold the other order alone.
    return [point for point in points if point[names.index("g2")] > point[names.index("g3")]] or points


def _visit_jumps(projector: Projector, best: Projection, free: IntArray, spacing: FloatArray) -> Projection:
    """Return the end of a search over the intervals between jumps, ever closer around the best one."""
    problem = projector.problem
    place = next(k for k in free if problem.law.shape[k].name in JUMPING)
    others = free[free != place]
    speeds = np.exp(_list_jumps(problem, int(place)))
    middles = np.log(0.5 * (speeds[1:] + speeds[:-1]))
    low, high = problem.box
    reach = float(spacing[place])
    for _ in range(5):
        near = np.flatnonzero(np.abs(middles - best.z[place]) <= reach)
        if not len(near) or projector.solves + 2 * _CANDIDATES > projector.limit:
            break
        chosen = np.unique(np.linspace(0, len(near) - 1, _CANDIDATES).astype(int))
        for middle in middles[near[chosen]]:
            z = np.array(best.z)
            z[place] = np.clip(middle, low[place], high[place])
            best = min(best, projector.project(z), key=lambda state: state.objective)
        best, _ = descend(projector, best, others, tolerance=1e-3, steps=3)
        reach *= 0.4
    return best


def _list_jumps(problem: FrictionProblem, place: int) -> FloatArray:
    """Return coordinates (K,) at which J jumps, rising; speeds that differ by rounding make one jump."""
    speeds = np.unique(problem.samples.velocity[problem.samples.velocity > problem.low[place]])
    jumps = np.log(speeds)
    return np.asarray(jumps[np.diff(jumps, prepend=-np.inf) > _ONE_JUMP])


def _cross_jumps(
    projector: Projector, best: Projection, free: IntArray, tolerance: float
) -> tuple[Projection, bool]:
    """Return the optimum of an interval between jumps that no neighbour reached by its end undercuts."""
    problem = projector.problem
    low, high = problem.box
    place = next(k for k in free if problem.law.shape[k].name in JUMPING)
    jumps = _list_jumps(problem, int(place))
    jumps = jumps[(jumps > low[place] + _ONE_JUMP) & (jumps < high[place])]
    edges = np.concatenate([low[[place]], jumps, high[[place]]])
    while True:
        box = np.array(low), np.array(high)
        above = int(np.clip(np.searchsorted(edges, best.z[place], side="right"), 1, len(edges) - 1))
        inside = 1e-8 * (edges[above] - edges[above - 1])
        box[0][place], box[1][place] = edges[above - 1] + inside, edges[above] - inside
        if not np.array_equal(z := np.clip(best.z, *box), best.z):
            best = min(best, projector.project(z), key=lambda state: state.objective)
        best, done = descend(projector, best, free, tolerance=tolerance, steps=60, box=box)
        # Boxes end 1e-8 of their width before the jump.
        width = 3e-8 * (box[1] - box[0])
        across = np.where(best.z >= box[1], best.z + width, best.z)
        across = np.clip(np.where(best.z <= box[0], best.z - width, across), low, high)
        if not done or projector.exhausted or np.array_equal(across, best.z):
            return best, done
        beyond = projector.project(across)
        if beyond.objective >= best.objective:
            return best, done
        best = beyond


def _visit_kinks(
    projector: Projector, best: Projection, free: IntArray, tolerance: float
) -> tuple[Projection, bool]:
    """Return the least of the optima in the kinks around `best` and between them, and whether it is one."""
    problem = projector.problem
    edge = next(k for k in free if problem.law.shape[k].name in KINKED)
    others = free[free != edge]
    # Solves kept for the smooth rest once the kinks were visited.
    projector.reserve = 12
    for _ in range(2):
        if projector.solves + 2 * _CANDIDATES + projector.reserve > projector.limit:
            break
        tried = [projector.project(z) for z in _list_kinks(projector, best, edge, others)]
        tried.sort(key=lambda state: state.objective)
        before = best.objective
        for state in tried[:2]:
            on_kink, _ = descend(projector, state, others, tolerance=tolerance, steps=4)
            beyond, _ = descend(projector, on_kink, free, tolerance=tolerance, steps=6, patience=_PATIENCE)
            best = min(best, on_kink, beyond, key=lambda end: end.objective)
        if before - best.objective <= 1e-9 * before:
            break
    projector.reserve = 0
    # In a kink the edge stays, and the rest converges; J must then rise on both sides of the edge.
    done = False
    for moving in (others, free, others):
        best, done = descend(projector, best, moving, tolerance=tolerance, steps=20, patience=2 * _PATIENCE)
        gain = max(projector.compute_side_gain(best, edge, side) for side in (1.0, -1.0))
        done = done and gain <= 1e-10 * best.objective
        if done:
            break
    projector.record(best)
    return best, done


def _list_kinks(projector: Projector, state: Projection, edge: int, others: IntArray) -> list[FloatArray]:
    """Return coordinates at kinks some deviations about the edge, the other ones moved along the valley."""
    problem = projector.problem
    jacobian = projector.compute_jacobian(state)
    normal = jacobian.T @ jacobian
    slide = np.zeros(len(state.z))
    slide[edge] = 1.0
    left = normal[edge, edge]
    if len(others):
        slide[others] = -np.linalg.lstsq(normal[np.ix_(others, others)], normal[others, edge], rcond=None)[0]
        left = left + normal[edge, others] @ slide[others]
    spread = np.sqrt(state.objective / len(state.residual) / max(float(left), 1e-300))
    low, high = problem.box
    speeds = np.unique(np.abs(problem.samples.velocity))
    kinks = np.log(speeds[speeds > problem.low[edge]])
    near = np.flatnonzero(np.abs(kinks - state.z[edge]) <= 4.0 * spread)
    place = int(np.searchsorted(kinks, state.z[edge]))
    near = np.union1d(near, [k for k in (place - 1, place) if 0 <= k < len(kinks)]).astype(int)
    if len(near) > _CANDIDATES:
        near = near[np.argsort(np.abs(kinks[near] - state.z[edge]), kind="stable")]
        close, far = near[: _CANDIDATES // 2], near[_CANDIDATES // 2 :]
        thinned = np.linspace(0, len(far) - 1, _CANDIDATES - len(close)).astype(int)
        near = np.concatenate([close, far[thinned]])
    moves = [slide * (kinks[k] - state.z[edge]) for k in near]
    return [np.clip(state.z + move, low, high) for move in moves]


def search_by_roots(problem: FrictionProblem, options: RootFindingOptions) -> FrictionSearch:
    """Return the stationary point of least objective, else the better end of the scan.

    Raises UsageError for motion in both directions, or not exactly one free shape value.
    """
    from scipy.optimize import brentq

    free, mistakes = np.flatnonzero(problem.is_free), []
    if len(free) != 1:
        mistakes.append(f"one free shape value; law {problem.law.name!r} has {len(free)} here")
    if not is_one_sided(problem.samples.build_rows().velocity):
        mistakes.append("motion in one direction; these samples have both")
    if mistakes:
        texts = (f"root finding needs {text}: use the estimator 'varpro'" for text in mistakes)
        raise UsageError(*(Notice(code="usage.root-finding", text=text) for text in texts))
    place = int(free[0])
    projector = Projector(problem, np.iinfo(np.int64).max)
    ends = problem.box
    kept: dict[float, tuple[float, Projection]] = {}

    def compute_slope(coordinate: float) -> float:
        if coordinate not in kept:
            z = np.array(ends[0])
            z[place] = coordinate
            state = projector.project(z)
            slope = float(-(projector.compute_jacobian(state)[:, place] @ state.residual))
            kept[coordinate] = slope, state
        return kept[coordinate][0]

    scan = [float(value) for value in np.linspace(ends[0][place], ends[1][place], options.points)]
    slopes = [compute_slope(value) for value in scan]
    projector.record(*(state for _, state in kept.values()))
    roots = 0
    for left, right, before, after in zip(scan[:-1], scan[1:], slopes[:-1], slopes[1:], strict=True):
        if before * after < 0.0:
            root = float(brentq(compute_slope, left, right, xtol=options.tolerance, rtol=1e-14))
            compute_slope(root)
            roots += 1
            projector.record(kept[root][1])
    best = min((state for _, state in kept.values()), key=lambda state: state.objective)
    ended = f"{roots} roots were found, the best is kept" if roots else "the slope never changes its sign"
    outcome = Ending.CONVERGED if roots else Ending.STALLED
    return projector.build_search(best, outcome, ended, points=options.points, roots=roots)
