"""Thresholds and knees off their grid: fewer stops and knees, each where the data put it.

SpringData, target, SpringWeights on a grid -> SpringWeights.

A grid puts two stops around each slip that the spring has, and leaves the smallest ones out. From its
solution all parameters are fitted together, positions included (`spring_descent`).
Then stops and knees are left out one by one, the least certain first, while the cost rises no more than noise
lets it (the Bayesian information criterion).

Supported: what `spring_fit` supports.
Not supported: adding stops or knees to those of the start.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.spring_descent import find_point, find_reach, optimise_spring
from symid.elastic.spring_fit import (
    SpringData,
    find_filtered_torque,
    fit_spring,
    settle_spring_data,
    thin,
)
from symid.elastic.spring_weights import SpringWeights

__all__ = ["follow_spring", "refine_spring"]

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
    grid_cost = _find_cost(data, target, start)
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
    return optimise_spring(thinned, coarse, start, tolerance)[0]


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
    return fit_spring(settle_spring_data(data, spread), target, spread, iterations=4)


def _leave_out_unreached(data: SpringData, target: FloatArray, weights: SpringWeights) -> SpringWeights:
    """Return the spring without knees at the edge of the torques seen: they tell nothing, and extrapolate."""
    _, lowest, highest = find_reach(find_point(data, target, weights))
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
