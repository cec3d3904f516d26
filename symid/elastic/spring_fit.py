"""The spring that explains a filtered joint torque: stops by least squares, knees by Gauss-Newton.

Torsion and filtered torque of one joint -> SpringWeights -> Elasticity.

    v = sum_i k_i E_i[phi] (E_0 = phi),  tau_J = sum_j c_j ramp_j(v)
    min |F[tau_J] - target|,  k >= 0, c >= c0

ramp_j is the part of v between two knees and c_j the slope there, one around v = 0, which fixes the scale.
The plays run on the torsion as it is, and the filter F comes last: a filter before them would be wrong.
With k >= 0 and c > 0 the spring is passive and its torque rises with the torsion.

Supported: several recordings; a plain Prandtl-Ishlinskii spring (no knees), which is a convex problem.
Not supported: cubic springs, damping, an offset of the torsion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.filtered import filter_smooth
from symid.elastic.spring_weights import (
    LEAST_SLOPE,
    SpringWeights,
    find_local_slopes,
    find_ramps,
    hold_knees,
)
from symid.joint.plays import find_stop_basis

__all__ = [
    "SpringData",
    "filter_parts",
    "find_filtered_torque",
    "find_knee_grid",
    "fit_spring",
    "fit_stops",
    "prepare_spring_data",
    "settle_spring_data",
    "solve_non_negative",
    "thin",
]

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
            thin(find_stop_basis(phi, weights.thresholds), keep)
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
        thin(find_stop_basis(phi, thresholds), keep) for phi, keep in zip(torsions, keeps, strict=True)
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


def settle_spring_data(data: SpringData, weights: SpringWeights) -> SpringData:
    """Return the data with the thresholds of `weights` as their grid, so that their basis is at hand."""
    if weights.thresholds is data.thresholds:
        return data
    return prepare_spring_data(data.torsions, data.keeps, weights.thresholds, data.rate, data.periods)


def thin(values: FloatArray, keep: slice) -> FloatArray:
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


def find_knee_grid(data: SpringData, stiffness: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
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
    best, cost = start, float(np.sum((target - find_filtered_torque(data, start)) ** 2))
    for _ in range(iterations):
        jacobian, value = _linearise(data, best)
        packed = best.pack()
        floor = np.concatenate([np.zeros(len(best.stiffness)), np.full(best.knees, LEAST_SLOPE)])
        right = target - value + jacobian @ (packed - floor)
        goal = floor + solve_non_negative(jacobian, right)
        trial, reached, fraction = best, np.inf, 1.0
        for _ in range(_HALVINGS):
            trial = best.unpack(packed + fraction * (goal - packed))
            reached = float(np.sum((target - find_filtered_torque(data, trial)) ** 2))
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


def find_filtered_torque(data: SpringData, weights: SpringWeights) -> FloatArray:
    """Return F[tau_J] (M,) of a spring at the rows of `data`."""
    if weights.thresholds is data.thresholds and not weights.knees:
        result: FloatArray = data.filtered @ weights.stiffness
        return result
    torques = []
    for basis in data.find_basis(weights):
        inner = basis @ weights.stiffness
        torques.append(inner + find_ramps(inner, weights) @ (weights.slopes - 1.0))
    return filter_parts(data, torques)


def _linearise(data: SpringData, weights: SpringWeights) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of F[tau_J] by stiffnesses and slopes (M, m + 1 + knees), and F[tau_J] (M,)."""
    parts = []
    for basis in data.find_basis(weights):
        inner = basis @ weights.stiffness
        ramps = find_ramps(inner, weights)
        torque = inner + ramps @ (weights.slopes - 1.0)
        parts.append(np.column_stack([basis * find_local_slopes(inner, weights)[:, None], ramps, torque]))
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
