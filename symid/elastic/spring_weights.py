"""The numbers of one spring while it is fitted, and the spring they stand for.

SpringWeights -> Elasticity, and back.

    tau_J = v + sum_j (c_j - 1) ramp_j(v),  v = sum_i k_i E_i[phi]

Supported: stops and knees.
Not supported: cubic springs, damping.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = [
    "LEAST_KNEE",
    "LEAST_SLOPE",
    "SpringWeights",
    "build_elasticity",
    "find_local_slopes",
    "find_ramps",
    "hold_knees",
    "read_weights",
]

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


def find_ramps(inner: FloatArray, weights: SpringWeights) -> FloatArray:
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


def find_local_slopes(inner: FloatArray, weights: SpringWeights) -> FloatArray:
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
        knees = sorted((knee for knee in spring.knees if knee.threshold * side > 0.0), key=_find_size)
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


def _find_size(knee: Knee) -> float:
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
