"""Variable projection: the shape of a friction law is searched, all else follows by linear least squares.

FrictionProblem -> FrictionSearch, which carries the shape of the least objective.

    J(s) = |P(s) y|^2,   P = 1 - Phi Phi^+        (what multiplies the columns is Phi^+ y)
    dr/ds ~ -P dPhi/ds c                            (Kaufman's Jacobian; its gradient of J is exact)

Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432; Kaufman, BIT 15 (1975) 49-57. A grid of shapes,
spaced by equal factors, gives the starts; damped Gauss-Newton steps in the logarithms follow the best of
them. A law with a linear zone has an objective with a kink wherever the zone's edge passes a sample; its
optimum may lie in one. Such an edge is set onto the kinks next to it, and beyond them, before the search
ends. Where friction changes its sign at a velocity that is searched, the objective jumps; the intervals
between jumps are then tried, ever closer around the best one.

Supported: up to three shape values, dependent columns (least norm), fixed shape values, any number of columns
beside friction. Not supported: bounds of linear parameters (`nlp`); proof that no better optimum exists.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.friction.estimate import FrictionOutcome
from symid.friction.options import VariableProjectionOptions
from symid.friction.problem import FrictionProblem
from symid.friction.search import FrictionSearch

__all__ = ["Projection", "Projector", "find_grid", "search_by_projection"]

IntArray = NDArray[np.int64]
_DEPENDENT = 1e-11
_VANISHED = 1e-9
_KINKED = frozenset({"dq0"})
"""Shape values with a kink in J at every speed sampled: the edge of the linear zone."""
_JUMPING = frozenset({"dqs"})
"""Shape values at which J jumps whenever they pass a velocity sampled: where friction changes its sign."""
_EXCHANGED = (("g2", "g3"),)
"""Shape values that may be exchanged, as only a sign changes with them: the first is the greater one."""
_NEXT = 1.5
_DAMPING = 1e-3
_VISITS = 2
_CANDIDATES = 8
_DEVIATIONS = 4.0
_ROUNDS = 5
_CLOSER = 0.4
_LONGEST = 1.5
"""Step in a logarithm at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """The linear problem at one shape: J, residual (M,), linear (p,), basis of the columns (M, r)."""

    z: FloatArray
    shape: FloatArray
    objective: float
    residual: FloatArray
    linear: FloatArray
    basis: FloatArray


class Projector:
    """Solves linear problems and counts them."""

    def __init__(self, problem: FrictionProblem, limit: int) -> None:
        """Keep the problem; `limit` is the most that may be solved."""
        self.problem, self.limit, self.solves, self.evaluations = problem, limit, 0, 0

    @property
    def exhausted(self) -> bool:
        """Return whether less is left than one more step with its trial takes."""
        return self.solves + 2 > self.limit

    def project(self, z: FloatArray) -> Projection:
        """Return the least-squares solution at coordinates z (s,), of least norm in scaled columns."""
        self.solves += 1
        self.evaluations += 1
        shape = self.problem.decode(z)
        columns = self.problem.find_columns(shape)
        lengths = np.linalg.norm(columns, axis=0)
        # A column that has all but vanished would get a parameter beyond all numbers.
        gone = lengths <= _VANISHED * max(float(np.max(lengths)), 1e-300)
        columns = np.where(gone, 0.0, columns)
        lengths[gone] = 1.0
        orthonormal, upper = np.linalg.qr(columns / lengths)
        left, singular, right = np.linalg.svd(upper)
        rank = int(np.sum(singular > _DEPENDENT * max(float(singular[0]), 1e-300)))
        basis = orthonormal @ left[:, :rank]
        parts = basis.T @ self.problem.target
        residual = self.problem.target - basis @ parts
        return Projection(
            z=self.problem.encode(shape),
            shape=shape,
            objective=float(residual @ residual),
            residual=residual,
            linear=(right[:rank].T @ (parts / singular[:rank])) / lengths,
            basis=basis,
        )

    def find_jacobian(self, state: Projection) -> FloatArray:
        """Return Kaufman's Jacobian by the coordinates z: (M, s)."""
        rates = self.problem.find_rates(state.shape, state.linear)
        rates = rates * np.where(self.problem.is_logarithmic > 0.0, state.shape, 1.0)
        jacobian: FloatArray = state.basis @ (state.basis.T @ rates) - rates
        return jacobian


def search_by_projection(problem: FrictionProblem, options: VariableProjectionOptions) -> FrictionSearch:
    """Return the shape of the least objective, and its linear parameters.

    Args:
        problem: with at most three shape values that are not fixed.
        options: grid, starts, limits.
    """
    projector = Projector(problem, options.solves)
    states = [projector.project(z) for z in find_grid(problem, options)]
    history = [min(state.objective for state in states)]
    free = np.flatnonzero(problem.is_free)
    if not len(free):
        return _close(projector, states[0], tuple(history), FrictionOutcome.CONVERGED, 0)
    spacing = _find_spacing(problem, options)
    if any(problem.law.shape[place].name in _JUMPING for place in free):
        least = min(states, key=lambda state: state.objective)
        states = [_visit_jumps(projector, least, free, spacing, history)]
    starts = _choose_starts(states, spacing, options)
    ends = [_descend(projector, start, free, tolerance=1e-2, steps=6, history=history) for start in starts]
    best = min((end for end, _ in ends), key=lambda state: state.objective)
    best, done = _descend(projector, best, free, tolerance=options.tolerance, steps=60, history=history)
    if any(problem.law.shape[place].name in _KINKED for place in free):
        best = _visit_kinks(projector, best, free, options.tolerance, history)
    outcome = FrictionOutcome.CONVERGED if done else FrictionOutcome.STALLED
    if projector.exhausted and not done:
        outcome = FrictionOutcome.LIMIT
    return _close(projector, best, tuple(history), outcome, len(history) - 1)


def find_grid(problem: FrictionProblem, options: VariableProjectionOptions) -> list[FloatArray]:
    """Return coordinates of the grid's shapes, in order, (s,) each; one alone where nothing is free."""
    low, high = problem.encode(problem.low), problem.encode(problem.high)
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
    pairs = [(names.index(a), names.index(b)) for a, b in _EXCHANGED if a in names and b in names]
    points = itertools.product(*axes)
    return [np.array(point) for point in points if all(point[a] > point[b] for a, b in pairs)]


def _find_spacing(problem: FrictionProblem, options: VariableProjectionOptions) -> FloatArray:
    """Return the distance of the grid's points in each coordinate: (s,); 1 where there is but one."""
    free = np.flatnonzero(problem.is_free)
    spacing = np.ones(len(problem.low))
    width = problem.encode(problem.high) - problem.encode(problem.low)
    spacing[free] = width[free] / np.array(options.grid[len(free) - 1])
    return spacing


def _choose_starts(
    states: list[Projection], spacing: FloatArray, options: VariableProjectionOptions
) -> list[Projection]:
    """Return the grid's least states, none next to another one chosen; `spacing` (s,) is the grid's."""
    places = [state.z / spacing for state in states]
    order = sorted(range(len(states)), key=lambda index: states[index].objective)
    chosen: list[int] = []
    for index in order:
        apart = [float(np.max(np.abs(places[index] - places[k]))) for k in chosen]
        if all(distance > _NEXT for distance in apart):
            chosen.append(index)
        if len(chosen) == options.starts:
            break
    return [states[index] for index in chosen]


def _descend(
    projector: Projector,
    state: Projection,
    free: IntArray,
    *,
    tolerance: float,
    steps: int,
    history: list[float],
) -> tuple[Projection, bool]:
    """Return the end of damped Gauss-Newton steps in the coordinates `free`, and whether it converged."""
    problem = projector.problem
    low, high = problem.encode(problem.low), problem.encode(problem.high)
    damping = _DAMPING
    jacobian, fresh = projector.find_jacobian(state), False
    for _ in range(steps):
        if projector.exhausted:
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
        if float(np.max(np.abs(trial_z - state.z), initial=0.0)) <= tolerance:
            return state, True
        trial = projector.project(trial_z)
        if trial.objective < state.objective:
            state, fresh, damping = trial, True, max(0.1 * damping, 1e-12)
            history.append(min(history[-1], state.objective))
        else:
            damping *= 10.0 if damping > 1e-6 else 1e3
    return state, False


def _solve_damped(jacobian: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
    """Return argmin |r + J d|^2 + damping |D d|^2, D the lengths of J's columns, by QR."""
    lengths = np.linalg.norm(jacobian, axis=0)
    lengths[lengths == 0.0] = 1.0
    scaled = np.vstack([jacobian / lengths, np.sqrt(damping) * np.eye(len(lengths))])
    right = np.concatenate([-residual, np.zeros(len(lengths))])
    step: FloatArray = np.linalg.lstsq(scaled, right, rcond=1e-13)[0] / lengths
    return step


def _visit_jumps(
    projector: Projector, best: Projection, free: IntArray, spacing: FloatArray, history: list[float]
) -> Projection:
    """Return the end of a search over the intervals between jumps, ever closer around the best one."""
    problem = projector.problem
    place = next(k for k in free if problem.law.shape[k].name in _JUMPING)
    others = free[free != place]
    speeds = np.unique(problem.samples.velocity[problem.samples.velocity > problem.low[place]])
    middles = np.log(0.5 * (speeds[1:] + speeds[:-1]))
    low, high = problem.encode(problem.low), problem.encode(problem.high)
    reach = float(spacing[place])
    for _ in range(_ROUNDS):
        near = np.flatnonzero(np.abs(middles - best.z[place]) <= reach)
        chosen = (
            near[np.unique(np.linspace(0, len(near) - 1, _CANDIDATES).astype(int))] if len(near) else near
        )
        if not len(chosen) or projector.solves + 2 * _CANDIDATES > projector.limit:
            break
        for middle in middles[chosen]:
            z = np.array(best.z)
            z[place] = np.clip(middle, low[place], high[place])
            best = min(best, projector.project(z), key=lambda state: state.objective)
        best, _ = _descend(projector, best, others, tolerance=1e-3, steps=3, history=history)
        reach *= _CLOSER
    return best


def _visit_kinks(
    projector: Projector, best: Projection, free: IntArray, tolerance: float, history: list[float]
) -> Projection:
    """Return the least of the optima in the kinks around `best`, and in the intervals between them."""
    problem = projector.problem
    edge = next(k for k in free if problem.law.shape[k].name in _KINKED)
    others = free[free != edge]
    for _ in range(_VISITS):
        if projector.solves + 2 * _CANDIDATES > projector.limit:
            break
        tried = [projector.project(z) for z in _list_kinks(projector, best, edge, others)]
        tried.sort(key=lambda state: state.objective)
        before = best.objective
        for state in tried[:2]:
            on_kink, _ = _descend(projector, state, others, tolerance=tolerance, steps=4, history=history)
            beyond, _ = _descend(projector, on_kink, free, tolerance=tolerance, steps=6, history=history)
            best = min(best, on_kink, beyond, key=lambda end: end.objective)
        if before - best.objective <= 1e-9 * before:
            break
    history.append(min(history[-1], best.objective))
    return best


def _list_kinks(projector: Projector, state: Projection, edge: int, others: IntArray) -> list[FloatArray]:
    """Return coordinates at kinks some deviations about the edge, the other ones moved along the valley."""
    problem = projector.problem
    jacobian = projector.find_jacobian(state)
    normal = jacobian.T @ jacobian
    slide = np.zeros(len(state.z))
    slide[edge] = 1.0
    left = normal[edge, edge]
    if len(others):
        slide[others] = -np.linalg.lstsq(normal[np.ix_(others, others)], normal[others, edge], rcond=None)[0]
        left = left + normal[edge, others] @ slide[others]
    spread = np.sqrt(state.objective / len(state.residual) / max(float(left), 1e-300))
    low, high = problem.encode(problem.low), problem.encode(problem.high)
    speeds = np.unique(np.abs(problem.samples.velocity))
    kinks = np.log(speeds[speeds > problem.low[edge]])
    near = np.flatnonzero(np.abs(kinks - state.z[edge]) <= _DEVIATIONS * spread)
    place = int(np.searchsorted(kinks, state.z[edge]))
    near = np.union1d(near, [k for k in (place - 1, place) if 0 <= k < len(kinks)]).astype(int)
    if len(near) > _CANDIDATES:
        near = near[np.argsort(np.abs(kinks[near] - state.z[edge]), kind="stable")]
        close, far = near[: _CANDIDATES // 2], near[_CANDIDATES // 2 :]
        thinned = np.linspace(0, len(far) - 1, _CANDIDATES - len(close)).astype(int)
        near = np.concatenate([close, far[thinned]])
    moves = [slide * (kinks[k] - state.z[edge]) for k in near]
    return [np.clip(state.z + move, low, high) for move in moves]


def _close(
    projector: Projector, state: Projection, history: tuple[float, ...], outcome: FrictionOutcome, steps: int
) -> FrictionSearch:
    tolerance = "the relative step in the shape fell below the tolerance"
    reasons = {
        FrictionOutcome.CONVERGED: tolerance if len(history) > 1 else "the law is linear in what is free",
        FrictionOutcome.LIMIT: f"{projector.limit} linear problems were solved",
    }
    return FrictionSearch(
        linear=state.linear,
        shape=state.shape,
        objective=state.objective,
        evaluations=projector.evaluations,
        solves=projector.solves,
        iterations=steps,
        history=history,
        outcome=outcome,
        ended=reasons.get(outcome, "no step made the objective less"),
    )
