"""The spring that explains a filtered joint torque: weights, then places of stops and knees, then fewer.

Torsion and filtered torque of one joint -> SpringData, SpringWeights.

    v = sum_i k_i E_i[phi] (E_0 = phi),  tau_J = sum_j c_j ramp_j(v)
    min |F[tau_J] - target|,  k >= 0, c >= c0
    d tau_J / d r_i = -S'(v) k_i D_i,  D_i = d P_i / d r_i = -1, +1 since the play touched phi - r, phi + r
    d tau_J / d R_j = (c_j-1 - c_j) where v is beyond R_j

ramp_j is the part of v between two knees and c_j the slope there, one around v = 0, which fixes the
scale. Plays run on the torsion as it is, and the filter F comes last. With k >= 0 and c > 0 the spring is
passive and its torque rises with the torsion. On a grid, stops are found by non-negative least squares,
knees by Gauss-Newton. A grid puts two stops around each slip that the spring has, and leaves the smallest
ones out; so from its solution all parameters are fitted together, positions included, by projected
Levenberg-Marquardt, in which no position moves past its neighbour or beyond what was seen. Then stops and
knees are left out one by one, the least certain first, while the cost rises no more than noise lets it
(Bayesian information criterion).

Supported: several recordings; a plain Prandtl-Ishlinskii spring (no knees), which is a convex problem.
Not supported: cubic springs, damping, an offset of the torsion; adding stops or knees to those of the
start.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.identification.elastic.regression import filter_smooth
from symid.identification.hysteresis import (
    LEAST_KNEE,
    LEAST_SLOPE,
    SpringWeights,
    compute_local_slopes,
    compute_ramps,
    hold_knees,
)
from symid.joint_models import compute_stop_basis

_HALVINGS = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringData:
    """What does not change while the spring of one joint is fitted.

    Plays run at full rate; what follows needs fewer samples, those at which rows are and as many before them.

    Args:
        torsions: (N,) rad or m of every recording, at full rate.
        keeps: samples of each that rows belong to.
        thresholds: (m,) rad or m, of the grid; basis: (N', m + 1) for them, phi and the stops, thinned.
        filtered: (M, m + 1), F[basis] at the rows, all recordings stacked.
        rate: of the filter in rad/s.
        periods: s, of the recordings at full rate.
    """

    torsions: tuple[FloatArray, ...]
    keeps: tuple[slice, ...]
    thresholds: FloatArray
    basis: tuple[FloatArray, ...]
    filtered: FloatArray
    rate: float
    periods: tuple[float, ...]

    def find_basis(self, weights: SpringWeights) -> tuple[FloatArray, ...]:
        """Return phi and the stops of other thresholds, thinned, for every recording."""
        if weights.thresholds is self.thresholds:
            return self.basis
        return tuple(
            thin_samples(compute_stop_basis(phi, weights.thresholds), keep)
            for phi, keep in zip(self.torsions, self.keeps, strict=True)
        )


def prepare_spring_data(
    torsions: Sequence[FloatArray],
    keeps: Sequence[slice],
    thresholds: FloatArray,
    rate: float,
    periods: Sequence[float],
) -> SpringData:
    """Return the stop basis of one joint over all recordings, also filtered.

    Args:
        torsions: (N,) of every recording, unfiltered by F.
        keeps: samples of the rows of each.
        thresholds: (m,) of the stops.
        rate: lambda in rad/s.
        periods: s.
    """
    basis = tuple(
        thin_samples(compute_stop_basis(phi, thresholds), keep)
        for phi, keep in zip(torsions, keeps, strict=True)
    )
    data = SpringData(
        torsions=tuple(torsions),
        keeps=tuple(keeps),
        thresholds=thresholds,
        basis=basis,
        filtered=np.zeros((0, 0)),
        rate=rate,
        periods=tuple(periods),
    )
    return replace(data, filtered=filter_parts(data, basis))


def rebuild_spring_data(data: SpringData, weights: SpringWeights) -> SpringData:
    """Return the data with the thresholds of `weights` as their grid, so that their basis is at hand."""
    if weights.thresholds is data.thresholds:
        return data
    return prepare_spring_data(data.torsions, data.keeps, weights.thresholds, data.rate, data.periods)


def thin_samples(values: FloatArray, keep: slice) -> FloatArray:
    """Return the samples of `values` (N, ...) on the grid of `keep`, also those before its start."""
    return values[keep.start % keep.step :: keep.step]


def filter_parts(data: SpringData, parts: Sequence[FloatArray]) -> FloatArray:
    """Return F[parts] at the rows (M, k), of thinned columns (N', k) for every recording."""
    rows = [
        filter_smooth(part, data.rate, period * keep.step)[keep.start // keep.step :]
        for part, keep, period in zip(parts, data.keeps, data.periods, strict=True)
    ]
    return np.concatenate(rows)


def fit_stops(data: SpringData, target: FloatArray) -> SpringWeights:
    """Return non-negative stiffnesses of spring and stops (no knees) for `target` = F[tau_J] (M,)."""
    none = np.zeros(0)
    return SpringWeights(
        thresholds=data.thresholds,
        stiffness=solve_non_negative(data.filtered, target),
        below=none,
        above=none,
        below_slopes=none,
        above_slopes=none,
    )


def build_knee_grid(data: SpringData, stiffness: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return knee torques below and above zero, from zero outwards: (j - 1/2) / count max(-v or v).

    None lies nearer to zero than `hold_knees` allows.
    """
    inner = [part @ stiffness for part in data.basis]
    steps = (np.arange(count) + 0.5) / max(count, 1)
    low = max(0.0, -min(float(v.min()) for v in inner))
    high = max(0.0, *(float(v.max()) for v in inner))
    below, above = (-steps * low if low else np.zeros(0)), (steps * high if high else np.zeros(0))
    return hold_knees(below, low), hold_knees(above, high)


def fit_spring(
    data: SpringData,
    target: FloatArray,
    start: SpringWeights,
    *,
    tolerance: float = 1e-6,
    iterations: int = 12,
) -> SpringWeights:
    """Return stiffnesses and slopes by a projected Gauss-Newton method from `start`; positions stay.

    Each step is a non-negative least-squares problem in all parameters; it is halved while the cost rises.

    Args:
        data: of the joint.
        target: F[tau_J] (M,), N m.
        start: where to begin.
        tolerance: relative fall of the cost that ends the iteration.
        iterations: at most.
    """
    if not start.knees and start.thresholds is data.thresholds:
        return fit_stops(data, target)
    best, cost = start, float(np.sum((target - compute_filtered_torque(data, start)) ** 2))
    for _ in range(iterations):
        jacobian, value = _linearise(data, best)
        packed = best.pack()
        floor = np.concatenate([np.zeros(len(best.stiffness)), np.full(best.knees, LEAST_SLOPE)])
        right = target - value + jacobian @ (packed - floor)
        goal = floor + solve_non_negative(jacobian, right)
        trial, reached, fraction = best, np.inf, 1.0
        for _ in range(_HALVINGS):
            trial = best.unpack(packed + fraction * (goal - packed))
            reached = float(np.sum((target - compute_filtered_torque(data, trial)) ** 2))
            if reached <= cost:
                break
            fraction /= 2.0
        else:
            return best
        fall = (cost - reached) / max(cost, 1e-300)
        best, cost = trial, reached
        if fall < tolerance:
            break
    return best


def compute_filtered_torque(data: SpringData, weights: SpringWeights) -> FloatArray:
    """Return F[tau_J] (M,) of a spring at the rows of `data`."""
    if weights.thresholds is data.thresholds and not weights.knees:
        result: FloatArray = data.filtered @ weights.stiffness
        return result
    torques = []
    for basis in data.find_basis(weights):
        inner = basis @ weights.stiffness
        torques.append(inner + compute_ramps(inner, weights) @ (weights.slopes - 1.0))
    return filter_parts(data, torques)


def _linearise(data: SpringData, weights: SpringWeights) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of F[tau_J] by stiffnesses and slopes (M, m + 1 + knees), and F[tau_J] (M,)."""
    parts = []
    for basis in data.find_basis(weights):
        inner = basis @ weights.stiffness
        ramps = compute_ramps(inner, weights)
        torque = inner + ramps @ (weights.slopes - 1.0)
        parts.append(np.column_stack([basis * compute_local_slopes(inner, weights)[:, None], ramps, torque]))
    filtered = filter_parts(data, parts)
    return filtered[:, :-1], filtered[:, -1]


def solve_non_negative(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return argmin |matrix x - right|, x >= 0, with columns scaled to length one; empty columns get zero."""
    from scipy.optimize import nnls

    count = matrix.shape[1]
    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([matrix, right]), mode="r"))
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 1e-12 * max(float(lengths.max(initial=0.0)), 1e-300), lengths, np.inf)
    solution: FloatArray = nnls(triangle[:, :count] / scales, triangle[:, count])[0] / scales
    return solution


_STEPS = 20
_TRIES = 5
_PATIENCE = 4
_FAR = 2.0
_STEP = 0.4
"""Of the gap to its neighbour that a position may move at once."""
_FALL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringPoint:
    """A spring, its stop basis along every torsion as it is (N, m + 1), and its cost."""

    weights: SpringWeights
    bases: tuple[FloatArray, ...]
    cost: float


def evaluate_spring(data: SpringData, target: FloatArray, weights: SpringWeights) -> SpringPoint:
    """Return a spring, its knees held away from zero, with its stop basis and cost |target - F[tau_J]|^2."""
    bases = tuple(compute_stop_basis(phi, weights.thresholds) for phi in data.torsions)
    if weights.knees:
        _, lowest, highest = _measure_edges(bases, weights)
        below, above = hold_knees(weights.below, lowest), hold_knees(weights.above, highest)
        weights = replace(weights, below=below, above=above)
    torques = []
    for basis, keep in zip(bases, data.keeps, strict=True):
        inner = thin_samples(basis, keep) @ weights.stiffness
        torques.append(inner + compute_ramps(inner, weights) @ (weights.slopes - 1.0))
    errors = target - filter_parts(data, torques)
    return SpringPoint(weights=weights, bases=bases, cost=float(errors @ errors))


def optimise_spring(
    data: SpringData,
    target: FloatArray,
    start: SpringWeights,
    tolerance: float = _FALL,
    goal: float | None = None,
) -> tuple[SpringWeights, float]:
    """Return the best spring from `start` with as many stops and knees, and its cost.

    With a `goal` for the cost the first spring that reaches it is enough, and one far from it is given up.
    """
    point, damping = evaluate_spring(data, target, start), 1e-4
    for count in range(_STEPS):
        if goal is not None and (point.cost <= goal or (count >= _PATIENCE and point.cost > _FAR * goal)):
            break
        jacobian, value = _linearise_places(data, point)
        low, high = _compute_limits(point.weights, *measure_reach(point))
        # Columns without effect get no step, not a huge one.
        lengths = np.linalg.norm(jacobian, axis=0)
        idle = lengths <= 1e-9 * np.linalg.norm(value)
        low, high, lengths = np.where(idle, 0.0, low), np.where(idle, 0.0, high), np.where(idle, 1.0, lengths)
        scaled: FloatArray = np.asarray(
            np.linalg.qr(np.column_stack([jacobian / lengths, target - value]), mode="r")
        )
        fall = 0.0
        for _ in range(_TRIES):
            move = _solve_damped(scaled, low * lengths, high * lengths, damping) / lengths
            trial = evaluate_spring(data, target, _move(point.weights, move))
            if trial.cost < point.cost:
                fall = (point.cost - trial.cost) / point.cost
                point, damping = trial, damping / 10.0
                break
            damping *= 10.0
        if fall < tolerance:
            break
    return point.weights, point.cost


def _solve_damped(scaled: FloatArray, low: FloatArray, high: FloatArray, damping: float) -> FloatArray:
    """Return the bounded step; bounds that meet are held a hair apart, as the solver asks."""
    from scipy.optimize import lsq_linear

    count = scaled.shape[1] - 1
    matrix = np.vstack([scaled[:count, :count], np.sqrt(damping) * np.eye(count)])
    right = np.concatenate([scaled[:count, count], np.zeros(count)])
    low = np.minimum(low, 0.0)
    low -= 1e-9 * (1.0 + np.abs(low))
    high = np.maximum(high, 0.0)
    high = np.where(np.isfinite(high), high + 1e-9 * (1.0 + np.abs(high)), high)
    answer: FloatArray = lsq_linear(matrix, right, bounds=(low, high), method="bvls").x
    return answer


def measure_reach(point: SpringPoint) -> tuple[float, float, float]:
    """Return the largest torsion, and the largest -v and v: beyond them a position has no effect."""
    return _measure_edges(point.bases, point.weights)


def _measure_edges(bases: Sequence[FloatArray], weights: SpringWeights) -> tuple[float, float, float]:
    inner = [basis @ weights.stiffness for basis in bases]
    torsion = max(float(np.abs(basis[:, 0]).max()) for basis in bases)
    return torsion, max(-float(v.min()) for v in inner), max(float(v.max()) for v in inner)


def _compute_limits(
    weights: SpringWeights, torsion: float, lowest: float, highest: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far each parameter may move down and up: stiffnesses, slopes, thresholds, knees."""
    down, up = (
        [-weights.stiffness, LEAST_SLOPE - weights.slopes],
        [np.full(len(weights.stiffness) + weights.knees, np.inf)],
    )
    sides = (
        (weights.thresholds, 0.0, torsion, 1),
        (-weights.below, LEAST_KNEE * lowest, lowest, -1),
        (weights.above, LEAST_KNEE * highest, highest, 1),
    )
    for places, least, edge, sign in sides:
        gaps = np.diff(np.concatenate([[min([least, *places[:1]])], places, [max([edge, *places[-1:]])]]))
        lower, higher = -_STEP * gaps[:-1], _STEP * gaps[1:]
        down.append(lower if sign > 0 else -higher)
        up.append(higher if sign > 0 else -lower)
    return np.concatenate(down), np.concatenate(up)


def _move(weights: SpringWeights, move: FloatArray) -> SpringWeights:
    stiff, knees, stops = len(weights.stiffness), weights.knees, len(weights.thresholds)
    changed = weights.unpack(weights.pack() + move[: stiff + knees])
    at = stiff + knees
    below = at + stops + len(weights.below)
    return replace(
        changed,
        stiffness=np.maximum(changed.stiffness, 0.0),
        thresholds=weights.thresholds + move[at : at + stops],
        below=weights.below + move[at + stops : below],
        above=weights.above + move[below:],
    )


def _linearise_places(data: SpringData, point: SpringPoint) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of F[tau_J] by all parameters, and F[tau_J] (M,)."""
    weights, parts = point.weights, []
    for whole, keep in zip(point.bases, data.keeps, strict=True):
        slips = thin_samples(compute_slips(whole, weights.thresholds), keep)
        parts.append(compute_spring_slopes(thin_samples(whole, keep), slips, weights))
    filtered = filter_parts(data, parts)
    return filtered[:, :-1], filtered[:, -1]


def compute_spring_slopes(basis: FloatArray, slips: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return the derivatives of tau_J by stiffnesses, slopes, thresholds and knees, and tau_J: (N, k + 1).

    Args:
        basis: (N, m + 1) torsion and stops.
        slips: (N, m) of `compute_slips`.
        weights: of the spring.
    """
    inner = basis @ weights.stiffness
    local = compute_local_slopes(inner, weights)[:, None]
    ramps = compute_ramps(inner, weights)
    torque = inner + ramps @ (weights.slopes - 1.0)
    columns = [basis * local, ramps, slips * weights.stiffness[1:] * local]
    return np.column_stack([*columns, _compute_knee_columns(inner, weights), torque])


def compute_slips(basis: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return d E_i / d r_i (N, m): the side on which each stop slipped last, 0 before it ever did."""
    stops = basis[:, 1:]
    slack = 1e-9 * thresholds
    side = np.where(stops >= thresholds - slack, 1.0, np.where(stops <= slack - thresholds, -1.0, 0.0))
    last = np.maximum.accumulate(np.where(side != 0.0, np.arange(len(stops))[:, None], 0), axis=0)
    return np.take_along_axis(side, last, axis=0)


def _compute_knee_columns(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    columns = np.empty((len(inner), weights.knees))
    before = np.concatenate([[1.0], weights.below_slopes[:-1]]) if len(weights.below) else np.zeros(0)
    above = np.concatenate([[1.0], weights.above_slopes[:-1]]) if len(weights.above) else np.zeros(0)
    for place, torque in enumerate(weights.below):
        columns[:, place] = (before[place] - weights.below_slopes[place]) * (inner < torque)
    for place, torque in enumerate(weights.above):
        change = above[place] - weights.above_slopes[place]
        columns[:, len(weights.below) + place] = change * (inner > torque)
    return columns


_NEAR = 1e-6
_ROW_RATE = 125.0
"""Hz, while stops and knees are left out one by one."""
_FINE_RATE = 500.0
_EXACT = 1e-3
"""Of the torque; a residual below it is no reason for another stop or knee."""
_EDGE = 0.95
"""Of the torques seen; a knee further out shapes a few samples only."""
_CLOSE = 0.1
"""Of the torques seen; a pair of knees within may be no more than the scale of the weights."""
_DENSE = 12
_RATIO = 0.7
"""Of a threshold of the dense grid to the next one."""


def refine_spring(data: SpringData, target: FloatArray, start: SpringWeights) -> SpringWeights:
    """Return the spring of fewest stops and knees at their best places, `start` where that is no better.

    Args:
        data: of the joint.
        target: F[tau_J] (M,), N m.
        start: a spring on the grid.
    """
    grid_cost = _compute_cost(data, target, start)
    thinned, coarse = _thin_data(data, target, _ROW_RATE)
    best, cost = optimise_spring(thinned, coarse, _leave_out_idle(_start_dense(thinned, coarse, start)))
    allowed = 1.0 + 2.0 * np.log(_count_independent(data, target)) / _count_independent(data, target)
    enough = (_EXACT * float(np.linalg.norm(coarse))) ** 2
    found = True
    while found:
        found = False
        for fewer in _list_simpler(thinned, best):
            goal = max(cost * allowed, enough)
            trial, reached = optimise_spring(thinned, coarse, fewer, goal=goal)
            if reached <= goal:
                best, cost, found = trial, min(reached, cost), True
                break
    best = follow_spring(data, target, _leave_out_unreached(data, target, best))
    reached = _compute_cost(data, target, best)
    return best if reached <= max(grid_cost * allowed, (_EXACT * np.linalg.norm(target)) ** 2) else start


def follow_spring(
    data: SpringData, target: FloatArray, start: SpringWeights, *, tolerance: float = 1e-4
) -> SpringWeights:
    """Return the best spring near `start`, with as many stops and knees, positions included.

    Args:
        data: of the joint.
        target: F[tau_J] (M,), N m.
        start: where to begin.
        tolerance: relative fall of the cost that ends the iteration.
    """
    thinned, coarse = _thin_data(data, target, _FINE_RATE)
    return optimise_spring(thinned, coarse, start, tolerance)[0]


def _thin_data(data: SpringData, target: FloatArray, rate: float) -> tuple[SpringData, FloatArray]:
    """Return about `rate` rows a second, with plays that see twice as many samples: enough to find places."""
    torsions, keeps, periods, parts, at = [], [], [], [], 0
    for phi, keep, period in zip(data.torsions, data.keeps, data.periods, strict=True):
        rows = len(thin_samples(phi, keep)) - keep.start // keep.step
        every = max(1, int(1.0 / (rate * period * keep.step) + 1e-9))
        stride = keep.step * (every // 2 if every % 2 == 0 else 1)
        first = keep.start % stride
        torsions.append(np.ascontiguousarray(phi[first::stride]))
        keeps.append(slice((keep.start - first) // stride, None, every * keep.step // stride))
        parts.append(target[at : at + rows : every])
        periods.append(period * stride)
        at += rows
    thinned = replace(data, torsions=tuple(torsions), keeps=tuple(keeps), periods=tuple(periods))
    return thinned, np.concatenate(parts)


def _start_dense(data: SpringData, target: FloatArray, start: SpringWeights) -> SpringWeights:
    """Return a spring with stops on a geometric grid: small slips are as many as large ones.

    A start without stops was asked for, and has none here either.
    """
    if not len(start.thresholds):
        return start
    reach = max(float(np.abs(phi).max()) for phi in data.torsions)
    grid = reach * _RATIO ** np.arange(_DENSE, 0, -1.0)
    spread = replace(
        start, thresholds=grid, stiffness=np.concatenate([start.stiffness[:1], np.zeros(_DENSE)])
    )
    return fit_spring(rebuild_spring_data(data, spread), target, spread, iterations=4)


def _leave_out_unreached(data: SpringData, target: FloatArray, weights: SpringWeights) -> SpringWeights:
    """Return the spring without knees at the edge of the torques seen: they tell nothing, and extrapolate."""
    _, lowest, highest = measure_reach(evaluate_spring(data, target, weights))
    below, above = -weights.below < _EDGE * lowest, weights.above < _EDGE * highest
    return replace(
        weights,
        below=weights.below[below],
        below_slopes=weights.below_slopes[below],
        above=weights.above[above],
        above_slopes=weights.above_slopes[above],
    )


def _count_independent(data: SpringData, target: FloatArray) -> float:
    """Return how many independent rows there are: the filter passes noise up to rate / 2."""
    span = len(target) * float(np.mean([p * k.step for p, k in zip(data.periods, data.keeps, strict=True)]))
    return max(20.0, min(float(len(target)), span * data.rate / 2.0))


def _compute_cost(data: SpringData, target: FloatArray, weights: SpringWeights) -> float:
    return float(np.sum((target - compute_filtered_torque(data, weights)) ** 2))


def _leave_out_idle(weights: SpringWeights) -> SpringWeights:
    """Return the spring without stops of no stiffness and knees that change nothing."""
    busy = weights.stiffness[1:] > _NEAR * np.sum(weights.stiffness)
    result = replace(
        weights,
        thresholds=weights.thresholds[busy],
        stiffness=np.concatenate([weights.stiffness[:1], weights.stiffness[1:][busy]]),
    )
    for side in ("below", "above"):
        slopes = getattr(weights, f"{side}_slopes")
        bends = np.abs(np.diff(np.concatenate([[1.0], slopes]))) > _NEAR
        result = replace(result, **{side: getattr(weights, side)[bends], f"{side}_slopes": slopes[bends]})
    return result


def _list_simpler(data: SpringData, weights: SpringWeights) -> Iterator[SpringWeights]:
    """Yield springs with one stop or knee less, the least effective first."""
    options: list[tuple[float, SpringWeights]] = []
    reach = max(float(np.abs(phi).max()) for phi in data.torsions)
    for place in range(len(weights.thresholds)):
        keep = np.arange(len(weights.thresholds)) != place
        loss = weights.stiffness[1 + place] * min(weights.thresholds[place], reach)
        stiffness = np.delete(weights.stiffness, 1 + place)
        thresholds = weights.thresholds[keep]
        if place:
            # Merged with its lower neighbour, at the mean of both.
            pair = weights.stiffness[place : 2 + place]
            merged = float(pair @ weights.thresholds[place - 1 : place + 1] / max(np.sum(pair), 1e-300))
            stiff = stiffness.copy()
            stiff[place] = np.sum(pair)
            gap = weights.thresholds[place] - weights.thresholds[place - 1]
            moved = thresholds.copy()
            moved[place - 1] = merged
            options.append((float(np.min(pair)) * gap, replace(weights, thresholds=moved, stiffness=stiff)))
        options.append((float(loss), replace(weights, thresholds=thresholds, stiffness=stiffness)))
    for side in ("below", "above"):
        torques, slopes = getattr(weights, side), getattr(weights, f"{side}_slopes")
        changes = np.diff(np.concatenate([[1.0], slopes]))
        for place, torque in enumerate(torques):
            keep = np.arange(len(torques)) != place
            loss = abs(changes[place]) * abs(torque) * 0.1
            options.append(
                (float(loss), replace(weights, **{side: torques[keep], f"{side}_slopes": slopes[keep]}))
            )
    options += _list_rescaled(data, weights)
    options.sort(key=lambda option: option[0])
    for _, simpler in options[:3]:
        yield simpler


def _list_rescaled(data: SpringData, weights: SpringWeights) -> list[tuple[float, SpringWeights]]:
    """Return the spring without its innermost knees, one on each side, where both lie near zero torque.

    The slope beyond them is then the one at zero, and scales all weights; left out one by one, the other knee
    would stand in the way.
    """
    if not (len(weights.below) and len(weights.above)):
        return []
    inner = [basis @ weights.stiffness for basis in data.find_basis(weights)]
    lowest, highest = max(-float(v.min()) for v in inner), max(float(v.max()) for v in inner)
    if -weights.below[0] > _CLOSE * lowest or weights.above[0] > _CLOSE * highest:
        return []
    slope = float(weights.below_slopes[0] + weights.above_slopes[0]) / 2.0
    scaled = replace(
        weights,
        stiffness=weights.stiffness * slope,
        below=weights.below[1:] * slope,
        above=weights.above[1:] * slope,
        below_slopes=weights.below_slopes[1:] / slope,
        above_slopes=weights.above_slopes[1:] / slope,
    )
    loss = abs(slope - 1.0) * max(-weights.below[0], weights.above[0]) * 0.1
    return [(float(loss), scaled)]
