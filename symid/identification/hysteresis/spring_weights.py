"""A Prandtl-Ishlinskii element with outer function while it is fitted: weights, thresholds, knees, slopes.

    tau_J = v + sum_j (c_j - 1) ramp_j(v),   v = k0 phi + sum_i k_i E_i[phi]     stops E_i, knees in v

The outer function has slope one at zero, which fixes the scale of the weights.
Not supported: cubic springs, damping, branches.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.joint_models import Elasticity, Knee, Stop

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
