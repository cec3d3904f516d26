"""A Prandtl-Ishlinskii element: its numbers while it is fitted, and Kuhnen's convex fit to input and output.

    tau_J = v + sum_j (c_j - 1) ramp_j(v),   v = k0 phi + sum_i k_i E_i[phi]     stops E_i, knees in v
    e = v(phi) - S'(tau),   S'(tau) = tau + sum_j w'_j S_rj(tau)                 error model of the fit

S' is the inverse of the outer function tau = S(v), with knees at given torques and a slope of one at zero
torque, which fixes the scale. In slopes c'_j beyond the knees and sums of plays, v = sum_i W_i (P_i - P_i+1),
the inequalities W_i >= least, c'_j >= least, for a passive spring k0 >= least, k_i >= 0, are bounds of a
linear least-squares problem (Kuhnen, European Journal of Control 9 (2003) 407-418).
Not supported: cubic springs, damping; large noise in the torque, which enters the columns of S' and
biases the slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.identification.regression import solve_scaled
from symid.joint_models import Elasticity, Knee, Stop, compute_stop_basis

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
    """One spring: `thresholds` (m,) of the stops, rad or m, `stiffness` (m + 1,) k_0 .. k_m >= 0.

    `knees` (l,) are signed torques, N m or N: those below zero, then those above, both from zero outwards;
    `slopes` (l,) are those beyond each of them; the slope around zero torque is one.
    """

    thresholds: FloatArray
    stiffness: FloatArray
    knees: FloatArray
    slopes: FloatArray

    @property
    def below(self) -> int:
        """Return the number of knees below zero torque."""
        return int(np.count_nonzero(self.knees < 0.0))

    @property
    def before(self) -> FloatArray:
        """Return the slopes (l,) before each knee, coming from zero."""
        before = np.ones_like(self.slopes)
        before[1:] = self.slopes[:-1]
        before[self.below : self.below + 1] = 1.0
        return before

    def move(self, step: FloatArray) -> "SpringWeights":
        """Return this spring with a step added to stiffnesses and slopes, none of the former below zero.

        A longer step also moves thresholds and knees.
        """
        weights = len(self.stiffness) + len(self.slopes)
        stiffness, slopes = np.split(step[:weights], [len(self.stiffness)])
        moved = replace(
            self, stiffness=np.maximum(self.stiffness + stiffness, 0.0), slopes=self.slopes + slopes
        )
        if len(step) == weights:
            return moved
        thresholds, knees = np.split(step[weights:], [len(self.thresholds)])
        return replace(moved, thresholds=self.thresholds + thresholds, knees=self.knees + knees)

    def keep_knees(self, kept: NDArray[np.bool_]) -> "SpringWeights":
        """Return this spring with some of its knees (l,) alone."""
        return replace(self, knees=self.knees[kept], slopes=self.slopes[kept])


def compute_ramps(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return the parts of v (N,) that lie beyond each knee and before the next one: (N, knees)."""
    knees = weights.knees
    further = np.copysign(np.inf, knees)
    further[:-1] = np.where(knees[:-1] * knees[1:] > 0.0, knees[1:], further[:-1])
    columns = np.empty((len(inner), len(knees)))
    for column, torque, end in zip(columns.T, knees, further, strict=True):
        np.clip(inner, min(torque, end), max(torque, end), out=column)
    return columns - knees


def compute_outer(basis: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return tau_J (N,) of torsion and stops (N, m + 1)."""
    inner = basis @ weights.stiffness
    return inner + compute_ramps(inner, weights) @ (weights.slopes - 1.0)


def compute_local_slopes(inner: FloatArray, weights: SpringWeights) -> FloatArray:
    """Return S'(v) (N,)."""
    order = np.argsort(weights.knees)
    slopes = np.insert(weights.slopes[order], weights.below, 1.0)
    return slopes[np.searchsorted(weights.knees[order], inner)]


def hold_knees(knees: FloatArray, lowest: float, highest: float) -> FloatArray:
    """Return knee torques (l,) as those of `SpringWeights`, none nearer to zero than is allowed.

    `lowest` is the largest -v, `highest` the largest v, N m or N.
    """
    rank, largest = np.arange(len(knees)), np.where(knees < 0.0, lowest, highest)
    rank = np.where(knees < 0.0, rank, rank - np.count_nonzero(knees < 0.0))
    least = LEAST_KNEE * largest * (1.0 + _LEAST_GAP * rank)
    return np.sign(knees) * np.maximum(np.abs(knees), least)


def build_knee_grid(inner: Sequence[FloatArray], count: int, *, odd: bool = False) -> FloatArray:
    """Return knee torques as those of `SpringWeights`: -+ (j - 1/2) / count max(-v or v), j = 1 .. count.

    None lies nearer to zero than `hold_knees` allows; `inner` is v (N,) of every recording, N m or N. Odd
    grids reach as far on both sides.
    """
    low = max(0.0, -min(float(part.min()) for part in inner))
    high = max(0.0, *(float(part.max()) for part in inner))
    if odd:
        low = high = max(low, high)
    steps = (np.arange(count) + 0.5) / max(count, 1)
    sides = [sign * steps * edge for sign, edge in ((-1.0, low), (1.0, high)) if edge]
    return hold_knees(np.concatenate([np.zeros(0), *sides]), low, high)


def read_weights(spring: Elasticity) -> SpringWeights:
    """Return the numbers of a spring that has all its values, but for a cubic part and damping."""
    sides = [
        sorted((knee for knee in spring.knees if knee.threshold * side > 0.0), key=lambda k: abs(k.threshold))
        for side in (-1.0, 1.0)
    ]
    return SpringWeights(
        thresholds=np.array([stop.threshold for stop in spring.stops]),
        stiffness=np.array([spring.stiffness or 0.0, *(stop.stiffness or 0.0 for stop in spring.stops)]),
        knees=np.array([knee.threshold for side in sides for knee in side]),
        slopes=np.concatenate([1.0 + np.cumsum([knee.slope for knee in side]) for side in sides]),
    )


def build_stops(thresholds: FloatArray, stiffness: FloatArray, least: float) -> tuple[Stop, ...]:
    """Return the stops at (m,) rad or m whose stiffness (m,), N m/rad or N/m, is of a size above `least`."""
    return tuple(
        Stop(threshold=float(radius), stiffness=float(value))
        for radius, value in zip(thresholds, stiffness, strict=True)
        if abs(value) > least
    )


def build_elasticity(weights: SpringWeights) -> Elasticity:
    """Return the spring as a record, without stops of no stiffness and knees that change no slope."""
    whole = float(np.sum(weights.stiffness))
    changes = zip(weights.knees.tolist(), (weights.slopes - weights.before).tolist(), strict=True)
    # Without any stiffness there is no torque, and knees have no effect.
    kept = sorted(pair for pair in changes if whole and abs(pair[1]) > _NEAR)
    return Elasticity(
        # A spring that does not rise once all stops slip has no inverse.
        stiffness=max(float(weights.stiffness[0]), _RISE * whole),
        stops=build_stops(weights.thresholds, weights.stiffness[1:], _NEAR * whole),
        knees=tuple(Knee(threshold=torque, slope=change) for torque, change in kept),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class KuhnenFit:
    """A spring identified from its torsion and torque; its stops may be negative unless passive.

    `residual` is the root mean square of e, N m or N, `active` the inequalities that hold with equality.
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
    stiff = len(radii) + 1
    change = np.eye(stiff)
    names = ["stiffness", *(f"stop at {radius:.6g}" for radius in radii)]
    if not passive:
        # W_i is the slope after stops 1 .. i slip: k0 = W_m, k_i = W_i-1 - W_i.
        change = np.vstack([np.eye(stiff)[-1:], -np.diff(np.eye(stiff), axis=0)])
        names = ["slope at reversal", *(f"slope past the stop at {radius:.6g}" for radius in radii)]
    below, above = outer[outer < 0.0][::-1], outer[outer > 0.0]
    signed, slopes = np.concatenate([below, above]), np.ones(len(outer))
    spring = SpringWeights(thresholds=radii, stiffness=np.zeros(stiff), knees=signed, slopes=slopes)
    names += [f"slope beyond {knee:.6g}" for knee in spring.knees]
    middle = np.clip(torque, max(below, default=-np.inf), min(above, default=np.inf))
    matrix = np.hstack([compute_stop_basis(torsion, radii) @ change, -compute_ramps(torque, spring)])
    low = np.full(matrix.shape[1], least)
    low[:stiff] = least * float(np.abs(torque).max() / max(np.abs(torsion).max(), 1e-300))
    if passive:
        low[1:stiff] = 0.0
    solution = solve_scaled(matrix, middle, low=low)
    # Knees in tau become knees in v = S'(tau), piece by piece of S'.
    inverse = replace(spring, slopes=solution[stiff:])
    sides = (slice(inverse.below), slice(inverse.below, None))
    rises = [inverse.before[side] * np.diff(inverse.knees[side], prepend=0.0) for side in sides]
    places = np.concatenate([np.cumsum(rise) for rise in rises])
    stiffness, slopes = change @ solution[:stiff], 1.0 / solution[stiff:]
    found = replace(spring, stiffness=stiffness, slopes=slopes, knees=places)
    return KuhnenFit(
        elasticity=build_elasticity(found),
        residual=float(np.sqrt(np.mean((matrix @ solution - middle) ** 2))),
        active=tuple(names[place] for place in np.flatnonzero(solution <= low)),
    )


def _check_record(torsion: FloatArray, torque: FloatArray, radii: FloatArray, knees: FloatArray) -> None:
    """Raise UsageError, with all that is wrong, for what is no record or no grid."""
    count = len(radii) + 1 + len(knees)
    mistakes = []
    if torsion.ndim != 1 or torsion.shape != torque.shape or len(torsion) < count:
        shapes = f"torsion {torsion.shape} and torque {torque.shape}"
        mistakes.append(f"{shapes}: must be two equal columns of at least {count} samples")
    if not (np.all(np.isfinite(torsion)) and np.all(np.isfinite(torque))):
        mistakes.append("torsion and torque: all samples must be finite numbers")
    if np.any(radii <= 0.0) or np.any(np.diff(radii) <= 0.0):
        mistakes.append(f"thresholds {radii.tolist()}: must be positive and increase, each once")
    if np.any(knees == 0.0) or np.any(np.diff(knees) <= 0.0):
        mistakes.append(f"knees {knees.tolist()}: must differ from 0 and increase, each once")
    if not mistakes:
        largest, low, high = float(np.abs(torsion).max()), float(torque.min()), float(torque.max())
        near = [float(knee) for knee in knees if abs(knee) < LEAST_KNEE * np.max(np.sign(knee) * torque)]
        if np.any(radii >= largest):
            text = f"must be less than the largest torsion, {largest:.6g}; a stop beyond it never slips"
            mistakes.append(f"thresholds {radii.tolist()}: {text}")
        if not np.all((knees > low) & (knees < high)):
            mistakes.append(f"knees {knees.tolist()}: must lie within the torques, {low:.6g} to {high:.6g}")
        if near:
            text = f"must be at least {LEAST_KNEE:.0%} of the largest torque on their side"
            mistakes.append(f"knees {near}: {text}; nearer to zero the scale of the weights is undetermined")
    if mistakes:
        raise UsageError(*(Notice(code="usage.kuhnen-grid", text=text) for text in mistakes))
