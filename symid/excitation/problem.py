"""The problem of an exciting trajectory: what is minimised, under which limits, with exact derivatives.

Input: a robot, options. Output: `ExcitationProblem`, functions of the unknowns z of a `SeriesSpace`.

    minimise f(G(z)),  G = A'A / N   over N equal steps of the period
    subject to  -1 <= R z + c <= 1   (position, velocity, acceleration, jerk; `limits`)
                v(states(z)) <= 1 - tightening   (torque, torsion, space; `loads`)

A has sines and cosines of several times the highest harmonic: with 20 samples per harmonic, sums over the
samples agree with integrals over the period to 1e-6.

Supported: what `limits` and `loads` support. Not supported: second derivatives.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.excitation.criteria import Criterion, find_condition, find_criterion, find_information
from symid.excitation.fourier import SeriesOptions, SeriesSpace, build_space, find_grid
from symid.excitation.limits import (
    LimitOptions,
    MotionLimits,
    build_limit_rows,
    find_motion_limits,
    find_scales,
)
from symid.excitation.loads import LoadOptions, StateLimits, StateValues, build_state_limits
from symid.excitation.observation import Observation, build_columns, smooth_friction
from symid.robot.description import Robot

__all__ = ["ExcitationProblem", "Mask", "ProblemOptions", "build_problem"]

_SAMPLES = 20
"""Samples of the observation matrix per harmonic."""
_FINE, _COARSE = 20, 8
"""Grid points per harmonic: limits of motion lose 1.2 and 7.6 % between them."""


Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
"""Which v are watched: (points, v)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProblemOptions:
    """What is asked for; `deviations` (n,) are those of the torques, N m or N, None for equal ones."""

    series: SeriesOptions = field(default_factory=SeriesOptions)
    limits: LimitOptions = field(default_factory=LimitOptions)
    loads: LoadOptions = field(default_factory=LoadOptions)
    deviations: tuple[float, ...] | None = None


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
        self.basis = find_grid(space, observation.samples, 3)
        checks = density * space.harmonics
        self._check_basis = find_grid(space, checks, 3)
        self._values = StateValues(state_limits, checks, space.size)
        found = build_limit_rows(space, limits, density)
        joints, unknowns = space.shape
        self.rows = np.zeros((sum(map(len, found.rows)), joints * unknowns))
        start = 0
        for joint, rows in enumerate(found.rows):
            self.rows[start : start + len(rows), joint * unknowns : (joint + 1) * unknowns] = rows
            start += len(rows)
        self.constants = np.concatenate(found.constants)
        self._both = np.array(state_limits.both, dtype=bool)

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return self.space.shape[0] * self.space.shape[1]

    def build_coarse(self) -> "ExcitationProblem":
        """Return the same problem with limits on a coarse grid: quicker, and within the same limits."""
        return ExcitationProblem(self.space, self.limits, self.observation, self.state_limits, _COARSE)

    def find_gram(self, unknowns: FloatArray) -> FloatArray:
        """Return G (b, b) of z (n r,)."""
        matrix = self.observation.find_matrix(self._find_states(unknowns, self.basis))
        gram: FloatArray = matrix.T @ matrix / self.observation.samples
        return gram

    def find_condition(self, unknowns: FloatArray) -> float:
        """Return the condition number of the columns scaled to length one."""
        return find_condition(self.find_gram(unknowns))

    def find_information(self, unknowns: FloatArray) -> float:
        """Return the mean logarithm of a parameter's information."""
        return find_information(self.find_gram(unknowns))

    def find_value(self, unknowns: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
        """Return f and its gradient (n r,)."""
        matrix = self.observation.find_matrix(self._find_states(unknowns, self.basis))
        samples = self.observation.samples
        value, slope = find_criterion(matrix.T @ matrix / samples, criterion)
        # The states stand in the observation already; the sweep needs the factors alone.
        by_state = self.observation.find_slope((2.0 / samples) * matrix @ slope)
        return value, self._pull(by_state, self.basis)

    @property
    def points(self) -> int:
        """Return at how many points of the period v is limited."""
        return self._values.samples

    def find_constraints(self, unknowns: FloatArray, watched: Mask) -> FloatArray:
        """Return the linear constraints, then the watched ones of v: (m,)."""
        linear: FloatArray = self.rows @ unknowns + self.constants
        return (
            np.concatenate([linear, self.find_state_values(unknowns)[watched]]) if watched.any() else linear
        )

    def find_jacobian(self, unknowns: FloatArray, watched: Mask) -> FloatArray:
        """Return the derivatives (m, n r) of the constraints."""
        if not watched.any():
            return self.rows
        slopes = self._values.find_slopes(self._find_states(unknowns, self._check_basis))
        point = np.nonzero(watched)[0]
        by_coefficient = np.einsum("ekj,kec->ejc", slopes[watched], self._check_basis[:, point])
        by_unknown = np.einsum("ejc,jcr->ejr", by_coefficient, self.space.maps)
        return np.concatenate([self.rows, by_unknown.reshape(-1, self.size)])

    def find_bounds(self, tightening: FloatArray, watched: Mask) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of the constraints; `tightening` (v,) is taken off each v's own."""
        linear, kind = np.ones(len(self.rows)), np.nonzero(watched)[1]
        upper = 1.0 - tightening[kind]
        lower = np.where(self._both[kind], -upper, -np.inf)
        return np.concatenate([-linear, lower]), np.concatenate([linear, upper])

    def find_pattern(self, watched: Mask) -> Mask:
        """Return where the Jacobian may differ from zero."""
        return np.concatenate([self.rows != 0.0, np.ones((int(watched.sum()), self.size), dtype=bool)])

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

    def _pull(self, by_state: FloatArray, basis: FloatArray) -> FloatArray:
        """Return derivatives (n r,) by the unknowns from those by the states (3, N, n)."""
        by_coefficient = np.einsum("kic,kij->jc", basis, by_state, optimize=True)
        by_unknown: FloatArray = np.einsum("jc,jcr->jr", by_coefficient, self.space.maps).ravel()
        return by_unknown


def build_problem(robot: Robot, options: ProblemOptions | None = None) -> ExcitationProblem:
    """Return the problem of a robot.

    Raises:
        UsageError: options that do not fit the robot.
        RobotError: a length, or a value that a limit needs, is not stated.
    """
    options = options or ProblemOptions()
    weights = _find_weights(robot, options.deviations)
    limits = find_motion_limits(robot, options.limits)
    series = options.series
    _check_start(series, limits)
    scales = find_scales(limits, series.harmonics, series.period)
    space = build_space(series, limits.centre, scales)
    observation = Observation(build_columns(smooth_friction(robot)), _SAMPLES * series.harmonics, weights)
    return ExcitationProblem(space, limits, observation, build_state_limits(robot, limits, options.loads))


def _find_weights(robot: Robot, deviations: tuple[float, ...] | None) -> FloatArray:
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
