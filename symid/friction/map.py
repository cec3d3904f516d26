"""The velocity-torque map: friction torque against velocity, as measured, in intervals of velocity.

Input: `FrictionSamples`, what multiplies the columns beside friction. Output: `VelocityMap`.

Intervals hold equal numbers of rows, direction by direction, so that they are dense where the joint often was
and sparse where it hardly was.

Supported: a thinned cloud of single rows besides, for figures.
Not supported: maps over load or position.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.friction.reduction import find_rows
from symid.friction.samples import FrictionSamples

__all__ = ["VelocityMap", "find_velocity_map"]

INTERVALS = 20
"""Of each direction, at most."""
LEAST_ROWS = 5
"""Of an interval."""
CLOUD = 600
"""Rows of the cloud, at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VelocityMap:
    """Friction torque in intervals of velocity.

    Args:
        velocity: (B,) mean of each interval, rad/s or m/s, rising. torque: (B,) mean, N m or N.
        spread: (B,) standard deviation of the rows. count: (B,) rows.
        cloud_velocity, cloud_torque: (C,) single rows, evenly over time.
        slowest: speed of the slowest row of all, rad/s or m/s.
    """

    velocity: FloatArray
    torque: FloatArray
    spread: FloatArray
    count: FloatArray
    cloud_velocity: FloatArray
    cloud_torque: FloatArray
    slowest: float = 0.0

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("velocity", "torque", "spread", "count", "cloud_velocity", "cloud_torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_velocity_map(
    samples: FrictionSamples, other: FloatArray | tuple[float, ...] = (), *, intervals: int = INTERVALS
) -> VelocityMap:
    """Return the map of what is left of the torque without its rigid part.

    Args:
        samples: of one joint.
        other: (k,) what multiplies the columns beside friction.
        intervals: of each direction, at most.
    """
    rows = find_rows(samples)
    torque = rows.torque - rows.extra @ np.asarray(other, dtype=np.float64)
    parts: list[tuple[float, float, float, float]] = []
    for direction in (-1.0, 1.0):
        index = np.flatnonzero(direction * rows.velocity > 0.0)
        order = index[np.argsort(rows.velocity[index], kind="stable")]
        count = min(intervals, len(order) // LEAST_ROWS)
        for group in np.array_split(order, count) if count else ():
            values = torque[group]
            parts.append(
                (
                    float(np.mean(rows.velocity[group])),
                    float(np.mean(values)),
                    float(np.std(values)),
                    float(len(group)),
                )
            )
    table = np.array(parts).reshape(-1, 4)
    kept = np.unique(np.linspace(0, len(torque) - 1, min(CLOUD, len(torque))).astype(int))
    return VelocityMap(
        velocity=table[:, 0],
        torque=table[:, 1],
        spread=table[:, 2],
        count=table[:, 3],
        cloud_velocity=rows.velocity[kept],
        cloud_torque=torque[kept],
        slowest=float(np.min(np.abs(rows.velocity), initial=np.inf)),
    )
