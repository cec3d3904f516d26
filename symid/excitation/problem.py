"""The problem of an exciting trajectory: what is minimised, under which limits, and how near a motion comes.

Robot, ProblemOptions -> ExcitationProblem, functions of the unknowns z of a `SeriesSpace` with exact
first derivatives. Unknowns -> one Margin a limit and the stated figures, both on a grid far finer than
that of the search.

    minimise f(G(z)),  G = A'A / N   over N equal steps of the period
    subject to  -1 <= R z + c <= 1   (position, velocity, acceleration, jerk)
                v(states(z)) <= 1 - tightening   (torque, torsion, workspace)

A trigonometric polynomial p of degree h sampled at M > 2 h equal steps of its period satisfies

    max_t |p(t)| <= max_i |p(t_i)| / cos(pi h / M)

(Ehlich and Zeller 1964), and max |dp/dt| <= h w max |p| (Bernstein). The first makes limits on the grid
hold between its points; the second finds the limits that can never be reached, whose rows are left out.

A has sines and cosines of several times the highest harmonic: with 20 samples per harmonic, sums over the
samples agree with integrals over the period to 1e-6. The search looks at a coarse grid and at friction
with a slope; its figures compare series. Those that are stated come from the fine grid, with friction as
in the robot file.

Supported: what `limits` supports.
Not supported: second derivatives; what a controller adds to the motion.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.excitation.fourier import SeriesOptions, SeriesSpace, build_grid_basis, build_series_space
from symid.excitation.limits import (
    LimitOptions,
    MotionLimits,
    StateLimitOptions,
    StateLimits,
    StateValues,
    build_state_limits,
    compute_coefficient_scales,
    get_motion_limits,
)
from symid.excitation.observation import (
    Criterion,
    Observation,
    build_columns,
    compute_condition,
    compute_criterion,
    compute_information,
    smooth_friction,
)
from symid.ipopt import Constraints
from symid.robot import Robot

_GRAM_SAMPLES = 20
"""Samples of the observation matrix per harmonic."""
_FIGURE_SAMPLES = 400
"""The same for the figures that are stated."""
_FINE, _COARSE = 20, 8
"""Grid points per harmonic: limits of motion lose 1.2 and 7.6 % between them."""


Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
"""Which v are watched: (points, v)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProblemOptions:
    """What is asked for; `deviations` (n,) are those of the torques, N m or N, None for equal ones."""

    series: SeriesOptions = field(default_factory=SeriesOptions)
    limits: LimitOptions = field(default_factory=LimitOptions)
    loads: StateLimitOptions = field(default_factory=StateLimitOptions)
    deviations: tuple[float, ...] | None = None


def build_limit_rows(space: SeriesSpace, limits: MotionLimits, density: int) -> tuple[FloatArray, FloatArray]:
    """Return rows R (m, n r), constants c (m,): a series with |R z + c| <= 1 keeps its limits at all times.

    Args:
        space: of the series.
        limits: of the joints.
        density: grid points per harmonic, 3 at least; with 20 of them the limits lose 1.2 % between.
    """
    points = density * space.harmonics
    sure = limits.share * math.cos(math.pi * space.harmonics / points)
    basis = build_grid_basis(space, points, 4)
    fastest = 2.0 * math.pi * space.harmonics / space.period
    rows, constants = [], []
    for joint in range(space.size):
        offset = space.offset[joint].copy()
        offset[0] -= limits.centre[joint]
        kept = _list_active_orders(limits.share * limits.bounds[:, joint], fastest)
        bounds = sure * limits.bounds[kept, joint]
        full = basis[kept] / bounds[:, None, None]
        block = np.zeros((full.shape[0] * full.shape[1], *space.shape))
        block[:, joint] = (full @ space.maps[joint]).reshape(len(block), -1)
        rows.append(block.reshape(len(block), -1))
        constants.append((full @ offset).reshape(-1))
    return np.concatenate(rows), np.concatenate(constants)


def _list_active_orders(bounds: FloatArray, fastest: float) -> list[int]:
    """Return the orders of derivative whose limit does not follow from that of a lower one."""
    kept, reach = [], math.inf
    for order, bound in enumerate(bounds.tolist()):
        if bound < reach:
            kept.append(order)
            reach = bound
        reach *= fastest
    return kept


@final
class ExcitationProblem:
    """Functions of the unknowns z (n r,), flat."""

    def __init__(
        self,
        space: SeriesSpace,
        limits: MotionLimits,
        observation: Observation,
        state_limits: StateLimits,
        density: int = _FINE,
    ) -> None:
        """Lay out samples, rows and memory; limits are looked at `density` times per harmonic."""
        self.space, self.limits, self.observation = space, limits, observation
        self.state_limits = state_limits
        self.basis = build_grid_basis(space, observation.samples, 3)
        checks = density * space.harmonics
        self._check_basis = build_grid_basis(space, checks, 3)
        self._values = StateValues(state_limits, checks, space.size)
        self.rows, self.constants = build_limit_rows(space, limits, density)
        self._both = np.array(state_limits.both, dtype=bool)

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return self.space.shape[0] * self.space.shape[1]

    def build_coarse(self) -> "ExcitationProblem":
        """Return the same problem with limits on a coarse grid: quicker, and within the same limits."""
        return ExcitationProblem(self.space, self.limits, self.observation, self.state_limits, _COARSE)

    def build_stated(self, robot: Robot) -> "ExcitationProblem":
        """Return the problem whose figures are those to state: many samples, friction as the robot's is."""
        samples = _FIGURE_SAMPLES * self.space.harmonics
        observation = Observation(build_columns(robot), samples, self.observation.weights)
        return ExcitationProblem(self.space, self.limits, observation, self.state_limits, _COARSE)

    def find_gram(self, unknowns: FloatArray) -> FloatArray:
        """Return G (b, b) of z (n r,)."""
        matrix = self.observation.find_matrix(self._find_states(unknowns, self.basis))
        gram: FloatArray = matrix.T @ matrix / self.observation.samples
        return gram

    def find_condition(self, unknowns: FloatArray) -> float:
        """Return the condition number of the columns scaled to length one."""
        return compute_condition(self.find_gram(unknowns))

    def find_information(self, unknowns: FloatArray) -> float:
        """Return the mean logarithm of a parameter's information."""
        return compute_information(self.find_gram(unknowns))

    def find_value(self, unknowns: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
        """Return f and its gradient (n r,)."""
        matrix = self.observation.find_matrix(self._find_states(unknowns, self.basis))
        samples = self.observation.samples
        value, slope = compute_criterion(matrix.T @ matrix / samples, criterion)
        # The states stand in the observation already; the sweep needs the factors alone.
        by_state = self.observation.find_slope((2.0 / samples) * matrix @ slope)
        by_coefficient = np.einsum("kic,kij->jc", self.basis, by_state, optimize=True)
        return value, np.einsum("jc,jcr->jr", by_coefficient, self.space.maps).ravel()

    @property
    def points(self) -> int:
        """Return at how many points of the period v is limited."""
        return self._values.samples

    def build_constraints(self, tightening: FloatArray, watched: Mask) -> Constraints:
        """Return the linear constraints, then the watched ones of v, tightened by `tightening` (v,)."""
        point, kind = np.nonzero(watched)

        def find_values(unknowns: FloatArray) -> FloatArray:
            linear: FloatArray = self.rows @ unknowns + self.constants
            return (
                np.concatenate([linear, self.find_state_values(unknowns)[watched]]) if len(kind) else linear
            )

        def find_jacobian(unknowns: FloatArray) -> FloatArray:
            if not len(kind):
                return self.rows
            slopes = self._values.find_slopes(self._find_states(unknowns, self._check_basis))
            by_coefficient = np.einsum("ekj,kec->ejc", slopes[watched], self._check_basis[:, point])
            by_unknown = np.einsum("ejc,jcr->ejr", by_coefficient, self.space.maps)
            return np.concatenate([self.rows, by_unknown.reshape(-1, self.size)])

        linear, upper = np.ones(len(self.rows)), 1.0 - tightening[kind]
        return Constraints(
            value=find_values,
            jacobian=find_jacobian,
            pattern=np.concatenate([self.rows != 0.0, np.ones((len(kind), self.size), dtype=bool)]),
            lower=np.concatenate([-linear, np.where(self._both[kind], -upper, -np.inf)]),
            upper=np.concatenate([linear, upper]),
        )

    def find_state_values(self, unknowns: FloatArray) -> FloatArray:
        """Return v (points, v) of torque, torsion and space."""
        return self._values.find_values(self._find_states(unknowns, self._check_basis))

    def find_state_use(self, unknowns: FloatArray) -> FloatArray:
        """Return v (points, v), its size where both signs are limited; one is the limit."""
        values = self.find_state_values(unknowns)
        return np.where(self._both, np.abs(values), values)

    def find_state_excess(self, unknowns: FloatArray) -> FloatArray:
        """Return by how much each v (v,) exceeds its limit at the worst point; negative within."""
        if not self.state_limits.names:
            return np.zeros(0)
        excess: FloatArray = self.find_state_use(unknowns).max(axis=0) - 1.0
        return excess

    def _find_states(self, unknowns: FloatArray, basis: FloatArray) -> FloatArray:
        return self.space.find_states(unknowns.reshape(self.space.shape), basis)


def build_problem(robot: Robot, options: ProblemOptions | None = None) -> ExcitationProblem:
    """Return the problem of a robot.

    Raises:
        UsageError: options that do not fit the robot.
        RobotError: a length, or a value that a limit needs, is not stated.
    """
    options = options or ProblemOptions()
    weights = _compute_row_weights(robot, options.deviations)
    limits = get_motion_limits(robot, options.limits)
    series = options.series
    _check_start(series, limits)
    scales = compute_coefficient_scales(limits, series.harmonics, series.period)
    space = build_series_space(series, limits.centre, scales)
    observation = Observation(
        build_columns(smooth_friction(robot)), _GRAM_SAMPLES * series.harmonics, weights
    )
    return ExcitationProblem(space, limits, observation, build_state_limits(robot, limits, options.loads))


def _compute_row_weights(robot: Robot, deviations: tuple[float, ...] | None) -> FloatArray:
    if deviations is None:
        return np.ones(robot.freedom)
    if len(deviations) != robot.freedom or not all(0.0 < value < np.inf for value in deviations):
        text = f"deviations: expected {robot.freedom} positive numbers, one a joint, got {len(deviations)}"
        raise UsageError(Notice(code="usage.excitation", text=text))
    return 1.0 / np.array(deviations)


def _check_start(series: SeriesOptions, limits: MotionLimits) -> None:
    if series.start is None or len(series.start) != len(limits.centre):
        return
    outside = np.abs(np.array(series.start) - limits.centre) > limits.share * limits.half
    if np.any(outside):
        which = ", ".join(str(place + 1) for place in np.flatnonzero(outside))
        text = f"the start is outside the limits of joint {which}, of which {limits.share:.0%} are used"
        raise UsageError(Notice(code="usage.excitation", text=text))


_POINTS = 400
"""Points per harmonic."""
_ROUNDING = 1e-6
SPACE = "space"
_CLEARANCES: Mapping[str, Callable[[float, float], float]] = {
    "out": lambda value, radius: (math.sqrt(2.0 - value) - 1.0) * radius,
    "in": lambda value, radius: (1.0 - math.sqrt(value)) * radius,
    "plane": lambda value, _: 1.0 - value,
}
_ORDERS = ("position", "velocity", "acceleration", "jerk")


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One limit: of what, of which joint or place, largest value, limit (SI), and the share that is granted.

    Of positions the value is the distance from the middle of the range; of space it is the clearance that is
    left, m, whose limit is zero.
    """

    kind: str
    name: str
    value: float
    limit: float
    allowed: float

    @property
    def share(self) -> float | None:
        """Return the part of the limit that is used; None for space."""
        return None if self.kind == SPACE else self.value / self.limit

    @property
    def excess(self) -> float:
        """Return by what part of the limit, or by how many metres, more is used than was granted."""
        return -self.value if self.share is None else self.share / self.allowed - 1.0

    @property
    def kept(self) -> bool:
        """Return whether no more is used than was granted, up to the rounding of a solver."""
        return self.excess <= _ROUNDING


def compute_margins(
    problem: ExcitationProblem, names: tuple[str, ...], unknowns: FloatArray
) -> tuple[Margin, ...]:
    """Return all limits, joints in the order of `names`, at unknowns (n r,)."""
    limits, states = problem.limits, _compute_fine_states(problem, unknowns)
    gaps = np.abs(states - np.array([limits.centre, *np.zeros((3, len(names)))])[:, None, :])
    peaks = gaps.max(axis=1)
    motion = [
        Margin(kind=kind, name=name, value=float(peak), limit=float(bound), allowed=limits.share)
        for kind, row, bounds in zip(_ORDERS, peaks, limits.bounds, strict=True)
        for name, peak, bound in zip(names, row, bounds, strict=True)
        if math.isfinite(bound)
    ]
    return (*motion, *_compute_state_margins(problem, _compute_peaks(problem, states)))


def compute_overshoot(problem: ExcitationProblem, unknowns: FloatArray) -> FloatArray:
    """Return by how much each v (v,) of torque, torsion and space exceeds one; negative within."""
    overshoot: FloatArray = _compute_peaks(problem, _compute_fine_states(problem, unknowns)) - 1.0
    return overshoot


def _compute_fine_states(problem: ExcitationProblem, unknowns: FloatArray) -> FloatArray:
    space = problem.space
    basis = build_grid_basis(space, _POINTS * space.harmonics, 4)
    return space.find_states(unknowns.reshape(space.shape), basis)


def _compute_peaks(problem: ExcitationProblem, states: FloatArray) -> FloatArray:
    """Return the largest v (v,) over the states (4, N, n)."""
    found = problem.state_limits
    if not found.names:
        return np.zeros(0)
    values = StateValues(found, states.shape[1], problem.space.size).find_values(states[:3])
    peaks: FloatArray = np.where(found.both, np.abs(values), values).max(axis=0)
    return peaks


def _compute_state_margins(problem: ExcitationProblem, peaks: FloatArray) -> list[Margin]:
    found, share = problem.state_limits, problem.limits.share
    margins = []
    for name, kind, limit, peak in zip(found.names, found.kinds, found.limits, peaks.tolist(), strict=True):
        if kind in _CLEARANCES:
            left = _CLEARANCES[kind](peak, limit)
            margins.append(Margin(kind=SPACE, name=name, value=left, limit=0.0, allowed=1.0))
        else:
            margins.append(
                Margin(kind=kind, name=name, value=peak * limit, limit=limit / share, allowed=share)
            )
    return margins
