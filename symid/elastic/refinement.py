"""Thresholds and knees off their grid: fewer stops and knees, each where the data put it.

SpringData, target, SpringWeights on a grid -> SpringWeights.

A grid puts two stops around each slip that the spring has, and leaves the smallest ones out. From its
solution all parameters are fitted together, positions included, by a projected Levenberg-Marquardt method:

    d tau_J / d r_i = -S'(v) k_i D_i,  D_i = d P_i / d r_i = -1, +1 since the play touched phi - r, phi + r
    d tau_J / d R_j = (c_j-1 - c_j) where v is beyond R_j

Then stops and knees are left out one by one, the least certain first, while the cost rises no more than noise
lets it (the Bayesian information criterion).

Supported: what `spring_fit` supports.
Not supported: adding stops or knees to those of the start.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.spring_fit import (
    SpringData,
    filter_parts,
    find_filtered_torque,
    fit_spring,
    settle_spring_data,
    thin,
)
from symid.elastic.spring_weights import LEAST_SLOPE, SpringWeights, find_local_slopes, find_ramps
from symid.joint.plays import find_stop_basis

__all__ = ["follow_spring", "refine_spring"]

_STEPS = 20
_TRIES = 5
_PATIENCE = 4
_FAR = 2.0
_STEP = 0.4
"""Of the gap to its neighbour that a position may move at once."""
_FALL = 1e-3
_NEAR = 1e-6
_ROW_RATE = 125.0
"""Hz, while stops and knees are left out one by one."""
_FINE_RATE = 500.0
_EXACT = 1e-3
"""Of the torque; a residual below it is no reason for another stop or knee."""
_EDGE = 0.95
"""Of the torques seen; a knee further out shapes a few samples only."""
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
    grid_cost = _find_cost(data, target, start)
    thinned, coarse = _thin_data(data, target, _ROW_RATE)
    best, cost = _descend(thinned, coarse, _leave_out_idle(_start_dense(thinned, coarse, start)))
    allowed = 1.0 + 2.0 * np.log(_count_independent(data, target)) / _count_independent(data, target)
    enough = (_EXACT * float(np.linalg.norm(coarse))) ** 2
    found = True
    while found:
        found = False
        for fewer in _list_simpler(thinned, best):
            goal = max(cost * allowed, enough)
            trial, reached = _descend(thinned, coarse, fewer, goal=goal)
            if reached <= goal:
                best, cost, found = trial, min(reached, cost), True
                break
    best = follow_spring(data, target, _leave_out_unreached(data, target, best))
    reached = _find_cost(data, target, best)
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
    return _descend(thinned, coarse, start, tolerance)[0]


def _thin_data(data: SpringData, target: FloatArray, rate: float) -> tuple[SpringData, FloatArray]:
    """Return about `rate` rows a second, with plays that see twice as many samples: enough to find places."""
    torsions, keeps, periods, parts, at = [], [], [], [], 0
    for phi, keep, period in zip(data.torsions, data.keeps, data.periods, strict=True):
        rows = len(thin(phi, keep)) - keep.start // keep.step
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
    """Return a spring with stops on a geometric grid: small slips are as many as large ones."""
    reach = max(float(np.abs(phi).max()) for phi in data.torsions)
    grid = reach * _RATIO ** np.arange(_DENSE, 0, -1.0)
    spread = replace(
        start, thresholds=grid, stiffness=np.concatenate([start.stiffness[:1], np.zeros(_DENSE)])
    )
    return fit_spring(settle_spring_data(data, spread), target, spread, iterations=4)


def _leave_out_unreached(data: SpringData, target: FloatArray, weights: SpringWeights) -> SpringWeights:
    """Return the spring without knees at the edge of the torques seen: they tell nothing, and extrapolate."""
    _, lowest, highest = _find_reach(_evaluate(data, target, weights))
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


def _find_cost(data: SpringData, target: FloatArray, weights: SpringWeights) -> float:
    return float(np.sum((target - find_filtered_torque(data, weights)) ** 2))


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
    options.sort(key=lambda option: option[0])
    for _, simpler in options[:3]:
        yield simpler


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Point:
    """A spring, its stop basis along every torsion as it is (N, m + 1), and its cost."""

    weights: SpringWeights
    bases: tuple[FloatArray, ...]
    cost: float


def _evaluate(data: SpringData, target: FloatArray, weights: SpringWeights) -> _Point:
    bases = tuple(find_stop_basis(phi, weights.thresholds) for phi in data.torsions)
    torques = []
    for basis, keep in zip(bases, data.keeps, strict=True):
        inner = thin(basis, keep) @ weights.stiffness
        torques.append(inner + find_ramps(inner, weights) @ (weights.slopes - 1.0))
    errors = target - filter_parts(data, torques)
    return _Point(weights=weights, bases=bases, cost=float(errors @ errors))


def _descend(
    data: SpringData,
    target: FloatArray,
    start: SpringWeights,
    tolerance: float = _FALL,
    goal: float | None = None,
) -> tuple[SpringWeights, float]:
    """Return the best spring from `start` with as many stops and knees, and its cost.

    With a `goal` for the cost the first spring that reaches it is enough, and one far from it is given up.
    """
    point, damping = _evaluate(data, target, start), 1e-4
    for count in range(_STEPS):
        if goal is not None and (point.cost <= goal or (count >= _PATIENCE and point.cost > _FAR * goal)):
            break
        jacobian, value = _linearise(data, point)
        low, high = _find_limits(point.weights, *_find_reach(point))
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
            trial = _evaluate(data, target, _move(point.weights, move))
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


def _find_reach(point: _Point) -> tuple[float, float, float]:
    """Return the largest torsion, and the largest -v and v: beyond them a position has no effect."""
    inner = [basis @ point.weights.stiffness for basis in point.bases]
    torsion = max(float(np.abs(basis[:, 0]).max()) for basis in point.bases)
    return torsion, max(-float(v.min()) for v in inner), max(float(v.max()) for v in inner)


def _find_limits(
    weights: SpringWeights, torsion: float, lowest: float, highest: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far each parameter may move down and up: stiffnesses, slopes, thresholds, knees."""
    down, up = (
        [-weights.stiffness, LEAST_SLOPE - weights.slopes],
        [np.full(len(weights.stiffness) + weights.knees, np.inf)],
    )
    sides = ((weights.thresholds, torsion, 1), (-weights.below, lowest, -1), (weights.above, highest, 1))
    for places, edge, sign in sides:
        gaps = np.diff(np.concatenate([[0.0], places, [max([edge, *places[-1:]])]]))
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


def _linearise(data: SpringData, point: _Point) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of F[tau_J] by all parameters, and F[tau_J] (M,)."""
    weights, parts = point.weights, []
    for whole, keep in zip(point.bases, data.keeps, strict=True):
        slips = thin(_find_slips(whole, weights.thresholds), keep)
        basis = thin(whole, keep)
        inner = basis @ weights.stiffness
        local = find_local_slopes(inner, weights)[:, None]
        ramps = find_ramps(inner, weights)
        torque = inner + ramps @ (weights.slopes - 1.0)
        columns = [basis * local, ramps, slips * weights.stiffness[1:] * local]
        parts.append(np.column_stack([*columns, _find_knee_columns(inner, weights), torque]))
    filtered = filter_parts(data, parts)
    return filtered[:, :-1], filtered[:, -1]


def _find_slips(basis: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return d E_i / d r_i (N, m): the side on which each stop slipped last, 0 before it ever did."""
    stops = basis[:, 1:]
    slack = 1e-9 * thresholds
    side = np.where(stops >= thresholds - slack, 1.0, np.where(stops <= slack - thresholds, -1.0, 0.0))
    last = np.maximum.accumulate(np.where(side != 0.0, np.arange(len(stops))[:, None], 0), axis=0)
    return np.take_along_axis(side, last, axis=0)


def _find_knee_columns(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    columns = np.empty((len(inner), weights.knees))
    before = np.concatenate([[1.0], weights.below_slopes[:-1]]) if len(weights.below) else np.zeros(0)
    above = np.concatenate([[1.0], weights.above_slopes[:-1]]) if len(weights.above) else np.zeros(0)
    for place, torque in enumerate(weights.below):
        columns[:, place] = (before[place] - weights.below_slopes[place]) * (inner < torque)
    for place, torque in enumerate(weights.above):
        change = above[place] - weights.above_slopes[place]
        columns[:, len(weights.below) + place] = change * (inner > torque)
    return columns
