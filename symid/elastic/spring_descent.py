"""The best spring near another one, positions of stops and knees included: projected Levenberg-Marquardt.

SpringData, target, SpringWeights -> SpringWeights and cost.

    d tau_J / d r_i = -S'(v) k_i D_i,  D_i = d P_i / d r_i = -1, +1 since the play touched phi - r, phi + r
    d tau_J / d R_j = (c_j-1 - c_j) where v is beyond R_j

Stiffnesses stay positive, slopes rise, and no position moves past its neighbour or beyond what was seen.
Knees keep away from zero torque, where they would undo the scale of the weights (`hold_knees`).

Supported: what `spring_fit` supports.
Not supported: another number of stops or knees than that of the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.spring_fit import SpringData, filter_parts, thin
from symid.elastic.spring_weights import (
    LEAST_KNEE,
    LEAST_SLOPE,
    SpringWeights,
    find_local_slopes,
    find_ramps,
    hold_knees,
)
from symid.joint.plays import find_stop_basis

__all__ = [
    "SpringPoint",
    "find_point",
    "find_reach",
    "find_slips",
    "find_spring_slopes",
    "optimise_spring",
]

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


def find_point(data: SpringData, target: FloatArray, weights: SpringWeights) -> SpringPoint:
    """Return a spring, its knees held away from zero, with its stop basis and cost |target - F[tau_J]|^2."""
    bases = tuple(find_stop_basis(phi, weights.thresholds) for phi in data.torsions)
    if weights.knees:
        _, lowest, highest = _find_edges(bases, weights)
        below, above = hold_knees(weights.below, lowest), hold_knees(weights.above, highest)
        weights = replace(weights, below=below, above=above)
    torques = []
    for basis, keep in zip(bases, data.keeps, strict=True):
        inner = thin(basis, keep) @ weights.stiffness
        torques.append(inner + find_ramps(inner, weights) @ (weights.slopes - 1.0))
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
    point, damping = find_point(data, target, start), 1e-4
    for count in range(_STEPS):
        if goal is not None and (point.cost <= goal or (count >= _PATIENCE and point.cost > _FAR * goal)):
            break
        jacobian, value = _linearise(data, point)
        low, high = _find_limits(point.weights, *find_reach(point))
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
            trial = find_point(data, target, _move(point.weights, move))
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


def find_reach(point: SpringPoint) -> tuple[float, float, float]:
    """Return the largest torsion, and the largest -v and v: beyond them a position has no effect."""
    return _find_edges(point.bases, point.weights)


def _find_edges(bases: Sequence[FloatArray], weights: SpringWeights) -> tuple[float, float, float]:
    inner = [basis @ weights.stiffness for basis in bases]
    torsion = max(float(np.abs(basis[:, 0]).max()) for basis in bases)
    return torsion, max(-float(v.min()) for v in inner), max(float(v.max()) for v in inner)


def _find_limits(
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


def _linearise(data: SpringData, point: SpringPoint) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of F[tau_J] by all parameters, and F[tau_J] (M,)."""
    weights, parts = point.weights, []
    for whole, keep in zip(point.bases, data.keeps, strict=True):
        slips = thin(find_slips(whole, weights.thresholds), keep)
        parts.append(find_spring_slopes(thin(whole, keep), slips, weights))
    filtered = filter_parts(data, parts)
    return filtered[:, :-1], filtered[:, -1]


def find_spring_slopes(basis: FloatArray, slips: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return the derivatives of tau_J by stiffnesses, slopes, thresholds and knees, and tau_J: (N, k + 1).

    Args:
        basis: (N, m + 1) torsion and stops.
        slips: (N, m) of `find_slips`.
        weights: of the spring.
    """
    inner = basis @ weights.stiffness
    local = find_local_slopes(inner, weights)[:, None]
    ramps = find_ramps(inner, weights)
    torque = inner + ramps @ (weights.slopes - 1.0)
    columns = [basis * local, ramps, slips * weights.stiffness[1:] * local]
    return np.column_stack([*columns, _find_knee_columns(inner, weights), torque])


def find_slips(basis: FloatArray, thresholds: FloatArray) -> FloatArray:
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
