"""All finite Fourier series of one robot that meet what is asked of their ends, and their states.

Harmonics, period, demands on the start -> SeriesSpace, whose unknowns z are free numbers of order one;
states of a series at any times, linear in z.

    q_j(t) = c_j + sum_k (A_jk sin k w t + B_jk cos k w t),  w = 2 pi / period,  k = 1..h
    x_j = (c_j, A_j1..A_jh, B_j1..B_jh) = offset_j + map_j z_j

The columns of map_j span the series that start and end at rest (dq = ddq = 0) and, where a start is
given, have q = 0 there; the series is periodic, so that what holds at its start holds at its end.

Supported: any number of harmonics and joints. Not supported: harmonics that differ from joint to joint.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, UsageError
from symid.excitation.trajectories import Trajectory, build_fourier


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesOptions:
    """The family of series.

    Args:
        harmonics: h of each joint.
        period: s; the length of the trajectory.
        rest: whether it starts and ends with neither velocity nor acceleration.
        start: (n,) rad or m, the pose in which it starts and ends; None for any.
    """

    harmonics: int = 5
    period: float = 10.0
    rest: bool = True
    start: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeriesSpace(FrozenArrays):
    """The series that meet all demands, as an affine space.

    Args:
        maps: (n, 2h + 1, r), rad or m per unknown. offset: (n, 2h + 1), rad or m.
        harmonics: h. period: s.
    """

    maps: FloatArray
    offset: FloatArray
    harmonics: int
    period: float

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.maps)

    @property
    def shape(self) -> tuple[int, int]:
        """Return how unknowns are arranged: joints, unknowns of one."""
        return len(self.maps), len(self.maps[0, 0])

    def find_coefficients(self, unknowns: FloatArray) -> FloatArray:
        """Return x (n, 2h + 1), rad or m, of unknowns (n, r)."""
        coefficients: FloatArray = self.offset + np.einsum("jcr,jr->jc", self.maps, unknowns)
        return coefficients

    def find_states(self, unknowns: FloatArray, basis: FloatArray) -> FloatArray:
        """Return derivatives (orders, N, n) of the series of unknowns (n, r) on a basis of `build_basis`."""
        states: FloatArray = basis @ self.find_coefficients(unknowns).T
        return states

    def find_unknowns(self, coefficients: FloatArray) -> FloatArray:
        """Return the unknowns (n, r) whose series is next to coefficients (n, 2h + 1), rad or m."""
        gaps = coefficients - self.offset
        found = [np.linalg.lstsq(part, gap, rcond=None)[0] for part, gap in zip(self.maps, gaps, strict=True)]
        unknowns: FloatArray = np.array(found, dtype=np.float64)
        return unknowns

    def build_trajectory(self, unknowns: FloatArray, source: str) -> Trajectory:
        """Return the series of unknowns (n, r); `source` says in words where it comes from."""
        x, h = self.find_coefficients(unknowns), self.harmonics
        series = build_fourier(
            sines=x[:, 1 : h + 1],
            cosines=x[:, h + 1 :],
            base_frequency=1.0 / self.period,
            centre=x[:, 0],
            duration=self.period,
            ramp=0.0,
        )
        return replace(series, source=source)


def build_basis(harmonics: int, period: float, times: FloatArray, orders: int) -> FloatArray:
    """Return the derivatives of order 0 to `orders` - 1 of 1, sin k w t, cos k w t: (orders, N, 2h + 1).

    Args:
        harmonics: h.
        period: s.
        times: (N,) s.
        orders: how many derivatives, q itself counted.
    """
    speed = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    angle = np.asarray(times, dtype=np.float64)[:, None] * speed
    basis = np.zeros((orders, len(angle), 2 * harmonics + 1))
    basis[0, :, 0] = 1.0
    for order in range(orders):
        turned, factor = angle + 0.5 * np.pi * order, speed**order
        basis[order, :, 1 : harmonics + 1] = factor * np.sin(turned)
        basis[order, :, harmonics + 1 :] = factor * np.cos(turned)
    return basis


def build_grid_basis(space: SeriesSpace, count: int, orders: int) -> FloatArray:
    """Return the basis (orders, count, 2h + 1) at so many equal steps of a period."""
    times: FloatArray = np.arange(count, dtype=np.float64) * (space.period / count)
    return build_basis(space.harmonics, space.period, times, orders)


def build_series_space(options: SeriesOptions, centre: FloatArray, scales: FloatArray) -> SeriesSpace:
    """Return the space of the series that meet the options.

    Args:
        options: the family.
        centre: (n,) rad or m, of the series with all unknowns zero, where no start is given.
        scales: (n, 2h + 1) rad or m, the size that each coefficient may have.

    Raises:
        UsageError: the options leave no motion, or are out of range.
    """
    _check_options(options, len(centre))
    # Velocity and acceleration at the start, by w and w^2, and position: (m, 2h + 1).
    basis = build_basis(options.harmonics, 2.0 * np.pi, np.zeros(1), 3)[:, 0]
    kept = ([1, 2] if options.rest else []) + ([0] if options.start is not None else [])
    # Sines and cosines of multiples of a right angle are not quite what they are.
    demands = np.round(basis[kept], 9)
    maps, offsets = [], []
    for joint, scale in enumerate(scales):
        rows = demands * scale
        # The last columns of the full orthogonal factor are what the demands do not see.
        full = np.linalg.qr(rows.T, mode="complete")[0]
        maps.append(scale[:, None] * full[:, len(demands) :])
        offset = np.zeros(len(scale))
        offset[0] = centre[joint]
        if options.start is not None:
            wanted = np.zeros(len(demands))
            wanted[-1] = options.start[joint]
            offset += scale * np.linalg.lstsq(rows, wanted - demands @ offset, rcond=None)[0]
        offsets.append(offset)
    return SeriesSpace(
        maps=np.array(maps),
        offset=np.array(offsets),
        harmonics=options.harmonics,
        period=options.period,
    )


def _check_options(options: SeriesOptions, size: int) -> None:
    problems = []
    least = 2 if options.rest else 1
    if options.harmonics < least:
        problems.append(
            f"{options.harmonics} harmonics leave no motion; at least {least} are needed"
            + (" to start and end at rest" if options.rest else "")
        )
    if not 0.0 < options.period < np.inf:
        problems.append(f"the period must be positive and finite, got {options.period:g} s")
    if options.start is not None and len(options.start) != size:
        problems.append(f"the start has {len(options.start)} positions, the robot {size} joints")
    if options.start is not None and not np.all(np.isfinite(options.start)):
        problems.append("the start holds a position that is not finite")
    if problems:
        raise UsageError(*(Notice(code="usage.excitation", text=text) for text in problems))
