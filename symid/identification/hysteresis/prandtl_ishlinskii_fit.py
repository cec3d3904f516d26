"""A Prandtl-Ishlinskii element: its numbers while it is fitted, and Kuhnen's convex fit to input and output.

SpringWeights -> Elasticity, and back; torsion and torque -> KuhnenFit.

    tau_J = v + sum_j (c_j - 1) ramp_j(v),   v = k0 phi + sum_i k_i E_i[phi]     stops E_i, knees in v
    e = v(phi) - S'(tau),   S'(tau) = tau + sum_j w'_j S_rj(tau)                 error model of the fit

S' is the inverse of the outer function tau = S(v), with knees at given torques; e is linear in all
weights. The slope of S' at zero torque is one, which fixes the scale, so knees keep away from there. In
slopes c'_j beyond the knees and in sums of plays, v = sum_i W_i (P_i - P_i+1), the inequalities W_i >=
least and c'_j >= least are bounds, and the fit is least squares with bounds. A passive spring bounds the
stops: k0 >= least, k_i >= 0 (Kuhnen, European Journal of Control 9 (2003) 407-418).

Supported: stops and knees; weights of both signs, or passive springs; any signed knees.
Not supported: cubic springs, damping; large noise in the torque, which enters the columns of S' and
biases the slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.joint_models import compute_stop_basis
from symid.robot import Elasticity, Knee, Stop

LEAST_KNEE = 0.03
"""Of the largest torque on its side: a knee nearer to zero would undo the slope of one there, which fixes the
scale of the weights: stops and slopes could then be scaled against each other at will."""
_LEAST_GAP = 0.1
"""Of that place, between knees that are held there."""

LEAST_SLOPE = 0.05
"""Of the outer function, so that it can be inverted."""
_NEAR = 1e-9
_RISE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringWeights:
    """Parameters of one spring.

    Args:
        thresholds: (m,) of the stops, rad or m; stiffness: (m + 1,) k_0 .. k_m >= 0.
        below, above: knee torques, from zero outwards, N m; slopes beyond each of them.
    """

    thresholds: FloatArray
    stiffness: FloatArray
    below: FloatArray
    above: FloatArray
    below_slopes: FloatArray
    above_slopes: FloatArray

    @property
    def knees(self) -> int:
        """Return the number of knees."""
        return len(self.below) + len(self.above)

    @property
    def slopes(self) -> FloatArray:
        """Return the slopes beyond the knees below zero, then above it."""
        return np.concatenate([self.below_slopes, self.above_slopes])

    def pack(self) -> FloatArray:
        """Return stiffnesses and slopes as one vector."""
        return np.concatenate([self.stiffness, self.slopes])

    def unpack(self, packed: FloatArray) -> "SpringWeights":
        """Return this spring with other stiffnesses and slopes."""
        stiff, below = len(self.stiffness), len(self.below)
        return replace(
            self,
            stiffness=packed[:stiff],
            below_slopes=packed[stiff : stiff + below],
            above_slopes=packed[stiff + below :],
        )


def compute_ramps(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return the parts of v (N,) that lie beyond each knee and before the next one: (N, knees)."""
    columns = np.empty((len(inner), weights.knees))
    index = 0
    for torques in (weights.below, weights.above):
        for place, torque in enumerate(torques):
            further = torques[place + 1] if place + 1 < len(torques) else np.copysign(np.inf, torque)
            np.clip(inner, min(torque, further), max(torque, further), out=columns[:, index])
            columns[:, index] -= torque
            index += 1
    return columns


def compute_local_slopes(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return S'(v) (N,)."""
    edges = np.concatenate([weights.below[::-1], weights.above])
    slopes = np.concatenate([weights.below_slopes[::-1], [1.0], weights.above_slopes])
    local: FloatArray = slopes[np.searchsorted(edges, inner)]
    return local


def hold_knees(torques: FloatArray, largest: float) -> FloatArray:
    """Return knee torques of one side, from zero outwards (l,), none nearer to zero than is allowed.

    Args:
        torques: of one sign.
        largest: the largest |v| on that side.
    """
    least = LEAST_KNEE * largest * (1.0 + _LEAST_GAP * np.arange(len(torques)))
    held: FloatArray = np.sign(torques) * np.maximum(np.abs(torques), least)
    return held


def read_weights(spring: Elasticity) -> SpringWeights:
    """Return the numbers of a spring that has all its values, but for a cubic part and damping."""
    sides = []
    for side in (-1.0, 1.0):
        knees = sorted((knee for knee in spring.knees if knee.threshold * side > 0.0), key=_get_size)
        slopes = 1.0 + np.cumsum([knee.slope for knee in knees])
        sides.append((np.array([knee.threshold for knee in knees]), slopes))
    return SpringWeights(
        thresholds=np.array([stop.threshold for stop in spring.stops]),
        stiffness=np.array([spring.stiffness or 0.0, *(stop.stiffness or 0.0 for stop in spring.stops)]),
        below=sides[0][0],
        above=sides[1][0],
        below_slopes=sides[0][1],
        above_slopes=sides[1][1],
    )


def _get_size(knee: Knee) -> float:
    return abs(knee.threshold)


def build_elasticity(weights: SpringWeights) -> Elasticity:
    """Return the spring as a record, without stops of no stiffness and knees that change no slope."""
    whole = float(np.sum(weights.stiffness))
    stops = tuple(
        Stop(threshold=float(radius), stiffness=float(value))
        for radius, value in zip(weights.thresholds, weights.stiffness[1:], strict=True)
        if value > _NEAR * whole
    )
    knees = []
    for torques, slopes in ((weights.below, weights.below_slopes), (weights.above, weights.above_slopes)):
        changes = np.diff(np.concatenate([[1.0], slopes]))
        knees += [
            Knee(threshold=float(torque), slope=float(change))
            for torque, change in zip(torques, changes, strict=True)
            if abs(change) > _NEAR
        ]
    # A spring that does not rise once all stops slip has no inverse.
    rest = max(float(weights.stiffness[0]), _RISE * whole)
    return Elasticity(stiffness=rest, stops=stops, knees=tuple(sorted(knees)))


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
    _check_record(torsion, torque, radii, outer)
    basis = compute_stop_basis(torsion, radii)
    change = np.eye(len(radii) + 1) if passive else _build_play_sums(len(radii) + 1)
    below = np.sort(outer[outer < 0.0])[::-1]
    above = np.sort(outer[outer > 0.0])
    ramps, middle = _split_torque(torque, below, above)
    matrix = np.hstack([basis @ change, -ramps])
    whole = float(np.abs(torque).max() / max(np.abs(torsion).max(), 1e-300))
    low = np.full(matrix.shape[1], least)
    low[: len(radii) + 1] = least * whole
    if passive:
        low[1 : len(radii) + 1] = 0.0
    solution = _solve_bounded(matrix, middle, low)
    weights = change @ solution[: len(radii) + 1]
    slopes = 1.0 / solution[len(radii) + 1 :]
    inner = _compute_inner_knees(below, above, solution[len(radii) + 1 :])
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
        active=_list_active_bounds(solution, low, radii, (below, above), passive=passive),
    )


def _build_play_sums(count: int) -> FloatArray:
    """Return the stop weights (count, count) that each of W_0 .. W_m alone stands for.

    W_i is the slope after stops 1 .. i slip: k0 = W_m, k_i = W_i-1 - W_i.
    """
    change = np.zeros((count, count))
    change[0, -1] = 1.0
    for stop in range(1, count):
        change[stop, stop - 1] = 1.0
        change[stop, stop] = -1.0
    return change


def _split_torque(torque: FloatArray, below: FloatArray, above: FloatArray) -> tuple[FloatArray, FloatArray]:
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


def _solve_bounded(matrix: FloatArray, right: FloatArray, low: FloatArray) -> FloatArray:
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


def _compute_inner_knees(below: FloatArray, above: FloatArray, slopes: FloatArray) -> FloatArray:
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


def _list_active_bounds(
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


def _check_record(torsion: FloatArray, torque: FloatArray, radii: FloatArray, knees: FloatArray) -> None:
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
