"""Kuhnen's identification of a hysteresis from its input and output: one convex problem.

Torsion and torque -> KuhnenFit.

    error model   e = v(phi) - S'(tau),  v = k0 phi + sum_i k_i E_i[phi]
    outer         S'(tau) = tau + sum_j w'_j S_rj(tau)

S' is the inverse of the outer function, tau = S(v), with knees at given torques. e is linear in all weights.
The slope of S' at zero torque is one, which fixes the scale: knees keep away from there. In slopes c'_j
beyond the knees, and in sums of plays, v = sum_i W_i (P_i - P_i+1), both blocks of inequalities, W_i >= least
and c'_j >= least, are bounds: the program is least squares with bounds. Passive springs bound the stops:
k0 >= least, k_i >= 0.
(Kuhnen, European Journal of Control 9 (2003) 407-418.)

Supported: weights of both signs, or passive springs; any signed knees.
Not supported: large noise in the torque: it enters the columns of S', and biases the slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.spring_weights import LEAST_KNEE
from symid.errors import Notice, UsageError
from symid.joint.plays import find_stop_basis
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = ["KuhnenFit", "fit_kuhnen"]


@dataclass(frozen=True, slots=True, kw_only=True)
class KuhnenFit:
    """A spring found from its torsion and torque.

    Args:
        elasticity: the spring, knees in torque before them; stops may be negative unless passive.
        residual: root mean square of e, N m or N.
        active: names of the inequalities that hold with equality.
    """

    elasticity: Elasticity
    residual: float
    active: tuple[str, ...]


def fit_kuhnen(
    torsion: FloatArray,
    torque: FloatArray,
    thresholds: Sequence[float],
    knees: Sequence[float] = (),
    *,
    passive: bool = True,
    least: float = 1e-3,
) -> KuhnenFit:
    """Return the spring of least error between its torsion and torque, from virgin memory.

    Args:
        torsion: (N,) rad or m.
        torque: (N,) N m or N.
        thresholds: of the stops, rad or m, positive and increasing.
        knees: torques beyond which the slope changes, signed, N m or N.
        passive: whether stops must not be negative, else only slopes must be positive.
        least: slopes of v, relative to that of the whole record, and of S' are not less.

    Raises:
        UsageError: thresholds or knees are no grid, a knee is near zero torque, or there are too few samples.
    """
    radii, outer = np.asarray(thresholds, dtype=np.float64), np.asarray(knees, dtype=np.float64)
    _check(torsion, torque, radii, outer)
    basis = find_stop_basis(torsion, radii)
    change = np.eye(len(radii) + 1) if passive else _find_play_sums(len(radii) + 1)
    below = np.sort(outer[outer < 0.0])[::-1]
    above = np.sort(outer[outer > 0.0])
    ramps, middle = _find_ramps(torque, below, above)
    matrix = np.hstack([basis @ change, -ramps])
    whole = float(np.abs(torque).max() / max(np.abs(torsion).max(), 1e-300))
    low = np.full(matrix.shape[1], least)
    low[: len(radii) + 1] = least * whole
    if passive:
        low[1 : len(radii) + 1] = 0.0
    solution = _solve(matrix, middle, low)
    weights = change @ solution[: len(radii) + 1]
    slopes = 1.0 / solution[len(radii) + 1 :]
    inner = _find_inner_knees(below, above, solution[len(radii) + 1 :])
    return KuhnenFit(
        elasticity=Elasticity(
            stiffness=float(weights[0]),
            stops=tuple(
                Stop(threshold=float(radius), stiffness=float(weight))
                for radius, weight in zip(radii, weights[1:], strict=True)
                if weight
            ),
            knees=_build_knees(inner, slopes, len(below)),
        ),
        residual=float(np.sqrt(np.mean((matrix @ solution - middle) ** 2))),
        active=_list_active(solution, low, radii, (below, above), passive=passive),
    )


def _find_play_sums(count: int) -> FloatArray:
    """Return the stop weights (count, count) that each of W_0 .. W_m alone stands for.

    W_i is the slope after stops 1 .. i slip: k0 = W_m, k_i = W_i-1 - W_i.
    """
    change = np.zeros((count, count))
    change[0, -1] = 1.0
    for stop in range(1, count):
        change[stop, stop - 1] = 1.0
        change[stop, stop] = -1.0
    return change


def _find_ramps(torque: FloatArray, below: FloatArray, above: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the parts of the torque from each knee to the next (N, knees), and the one around zero (N,)."""
    columns = []
    for side, knees in ((-1.0, below), (1.0, above)):
        ends = np.append(np.abs(knees), np.inf)[1:]
        size = side * torque
        columns += [
            side * np.clip(size - start, 0.0, end - start)
            for start, end in zip(np.abs(knees), ends, strict=True)
        ]
    low = below[0] if len(below) else -np.inf
    high = above[0] if len(above) else np.inf
    ramps = np.column_stack(columns) if columns else np.zeros((len(torque), 0))
    return ramps, np.clip(torque, low, high)


def _solve(matrix: FloatArray, right: FloatArray, low: FloatArray) -> FloatArray:
    """Return argmin |matrix x - right|, x >= low, with columns scaled to length one."""
    from scipy.optimize import lsq_linear

    count = matrix.shape[1]
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, lengths, 1.0)
    triangle = np.linalg.qr(np.column_stack([matrix / scales, right]), mode="r")
    factor: FloatArray = np.asarray(triangle)
    answer = lsq_linear(
        factor[:, :count], factor[:, count], bounds=(low * scales, np.inf), method="bvls", tol=1e-14
    )
    solution: FloatArray = np.maximum(answer.x / scales, low)
    return solution


def _find_inner_knees(below: FloatArray, above: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the knees in v = S'(tau): below, then above, from zero outwards."""
    result = []
    start = 0
    for knees in (below, above):
        beyond = np.concatenate([[1.0], slopes[start : start + max(len(knees) - 1, 0)]])
        steps = np.diff(np.concatenate([[0.0], knees]))
        result.append(np.cumsum(beyond[: len(knees)] * steps))
        start += len(knees)
    return np.concatenate(result)


def _build_knees(inner: FloatArray, slopes: FloatArray, below: int) -> tuple[Knee, ...]:
    knees = []
    for part in (slice(0, below), slice(below, None)):
        changes = np.diff(np.concatenate([[1.0], slopes[part]]))
        knees += [
            Knee(threshold=float(knee), slope=float(change))
            for knee, change in zip(inner[part], changes, strict=True)
            if change
        ]
    return tuple(sorted(knees))


def _list_active(
    solution: FloatArray,
    low: FloatArray,
    radii: FloatArray,
    knees: tuple[FloatArray, FloatArray],
    *,
    passive: bool,
) -> tuple[str, ...]:
    names = ["stiffness", *(f"stop at {radius:.6g}" for radius in radii)]
    if not passive:
        names = ["slope at reversal", *(f"slope past the stop at {radius:.6g}" for radius in radii)]
    names += [f"slope beyond {knee:.6g}" for side in knees for knee in side]
    return tuple(names[place] for place in np.flatnonzero(solution <= low))


def _check(torsion: FloatArray, torque: FloatArray, radii: FloatArray, knees: FloatArray) -> None:
    """Refuse what is no record or no grid.

    Raises:
        UsageError: with all that is wrong.
    """
    mistakes = []
    count = len(radii) + 1 + len(knees)
    if torsion.ndim != 1 or torsion.shape != torque.shape or len(torsion) < count:
        text = (
            f"torsion {torsion.shape} and torque {torque.shape}: must be two equal columns of {count} samples"
        )
        mistakes.append(f"{text} at least")
    if not (np.all(np.isfinite(torsion)) and np.all(np.isfinite(torque))):
        mistakes.append("torsion and torque: all samples must be finite numbers")
    if np.any(radii <= 0.0) or np.any(np.diff(radii) <= 0.0):
        mistakes.append(f"thresholds {radii.tolist()}: must be positive and increase, each once")
    if not mistakes and np.any(radii >= np.abs(torsion).max()):
        text = f"the largest torsion is {np.abs(torsion).max():.6g}"
        mistakes.append(f"thresholds {radii.tolist()}: {text}; a stop beyond it never slips")
    if not mistakes and not np.all((knees > torque.min()) & (knees < torque.max())):
        text = f"torques reach from {torque.min():.6g} to {torque.max():.6g}"
        mistakes.append(f"knees {knees.tolist()}: {text}; nothing is known beyond")
    near = [float(knee) for knee in knees if knee and abs(knee) < LEAST_KNEE * np.max(np.sign(knee) * torque)]
    if not mistakes and near:
        text = f"must be {LEAST_KNEE:.0%} of the largest torque on their side at least"
        mistakes.append(f"knees {near}: {text}; nearer to zero the slope of one there fixes no scale")
    if np.any(knees == 0.0) or np.any(np.diff(knees) <= 0.0):
        mistakes.append(f"knees {knees.tolist()}: must differ from 0 and increase, each once")
    if mistakes:
        raise UsageError(*(Notice(code="usage.kuhnen-grid", text=text) for text in mistakes))
