"""The problem of an exciting trajectory: what is minimised, under which limits, and how near a motion comes.

Robot, ExciteOptions -> ExcitationProblem, functions of the unknowns z of a `SeriesSpace` with exact first
derivatives. Unknowns -> one Margin a limit and the stated figures, on a far finer grid.

    minimise f(G(z)),  G = A'A / N   over N equal steps of the period
    subject to  -1 <= R z + c <= 1   (position, velocity, acceleration, jerk)
                v(states(z)) <= 1 - tightening   (torque, torsion, workspace)

A trigonometric polynomial p of degree h at M > 2 h steps has max |p(t)| <= max |p(t_i)| / cos(pi h / M)
(Ehlich and Zeller 1964), and max |dp/dt| <= h w max |p| (Bernstein): the first makes limits hold between
grid points, the second finds limits that can never be reached. The search uses a coarse grid and friction
with a slope.

Observation: A (m, b) at the states of N samples, one row a torque, one column a parameter, and
sum_ij L_ij dA_ij/dstates for any L. G = A'A -> condition number, information, criterion f and S = df/dG.
With d = sqrt(diag G) and C = G / (d d'), the Gram matrix of columns scaled to length one:

    condition   cond = sqrt(lmax(C) / lmin(C)), at most log(b) / p below its smooth stand-in in log:
                f = (log sum l^p + log sum l^-p) / (2 p) >= log cond
    d-optimal   f = -log det(G) / (2 b): minus the mean logarithm of a parameter's information

S is symmetric, and df = sum (2 A S) dA. Criteria of designs: Swevers et al. 1997.

Supported: what `limits` supports; of elastic robots the links; full column rank.
Not supported: second derivatives; what a controller adds to the motion; rotors of elastic joints; matrices of
less rank, whose criterion is infinite.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from symid import codegen
from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.excitation.limits import (
    InPlaceFunction,
    MotionLimits,
    StateLimits,
    StateValues,
    build_state_limits,
    compute_coefficient_scales,
    get_motion_limits,
    smooth_friction,
)
from symid.excitation.trajectories import SeriesSpace, build_grid_basis, build_series_space
from symid.ipopt import Constraints
from symid.joint_models import NO_FRICTION
from symid.options import ExciteOptions
from symid.robot import Robot, refuse_passive_joints
from symid.serialization import HIDDEN

_GRAM_SAMPLES = 20
"""Samples of the observation matrix per harmonic: sums equal integrals over the period to 1e-6."""
_FIGURE_SAMPLES = 400
"""The same for the figures and margins that are stated."""
_FINE, _COARSE = 20, 8
"""Grid points per harmonic: limits of motion lose 1.2 and 7.6 % between them."""
_ROUNDING = 1e-6
"""By which a limit may be exceeded, relative or in m."""
SPACE = "space"
_CLEARANCES: Mapping[str, Callable[[float, float], float]] = {
    "out": lambda value, radius: (math.sqrt(2.0 - value) - 1.0) * radius,
    "in": lambda value, radius: (1.0 - math.sqrt(value)) * radius,
    "plane": lambda value, _: 1.0 - value,
}
_ORDERS = ("position", "velocity", "acceleration", "jerk")
_FLOOR = 1e-13
"""Least eigenvalue of a scaled Gram matrix that is not rounding."""


@final
class Observation:
    """The columns of a robot at a fixed number of samples, its friction as it is, evaluated in place.

    `weights` (n,) multiply the rows of each joint: one over the standard deviation of its torque. Symbolic
    lengths must have values.
    """

    def __init__(self, robot: Robot, samples: int, weights: FloatArray) -> None:
        """Derive the functions and allocate their memory."""
        import casadi as ca

        frictions = [*(joint.friction for joint in robot.joints), *(one.friction for one in robot.couplings)]
        has_friction = any(friction.law != NO_FRICTION for friction in frictions)
        wanted = ("torque_regressor", "friction_regressor") if has_friction else ("torque_regressor",)
        made = codegen.build_functions(robot, names=wanted)
        found = {spec.name: entry for spec, entry in zip(made.card.functions, made.functions, strict=True)}
        states = [ca.SX.sym(name, robot.freedom) for name in ("q", "dq", "ddq")]
        blocks = [found["torque_regressor"](*states)]
        self.names = tuple(entry.name for entry in made.card.beta)
        if has_friction:
            read = found["friction_regressor"].n_in()
            blocks.append(found["friction_regressor"](states[1], *states[: read - 1]))
            self.names += tuple(entry.name for entry in made.card.friction)
        # Columns of a sample, states (3n) -> (n b), row after row; their slope: states, (n b) -> (3n).
        every, flat = ca.vertcat(*states), ca.densify(ca.vec(ca.horzcat(*blocks).T))
        factors = ca.SX.sym("L", flat.numel())
        matrix = ca.Function("matrix", [every], [flat])
        gradient = ca.densify(ca.gradient(ca.dot(factors, flat), every))
        slope = ca.Function("slope", [every, factors], [gradient])
        self.samples, self.weights = samples, freeze(weights)
        state, block = (3 * len(weights),), (len(weights), len(self.names))
        self._states = np.zeros((samples, *state))
        self._matrix = InPlaceFunction(matrix, samples, (state,), block)
        self._slope = InPlaceFunction(slope, samples, (state, block), state)

    def compute_matrix(self, states: FloatArray) -> FloatArray:
        """Return A (N n, b) at states (3, N, n): q, dq, ddq."""
        self._states = np.concatenate(states, axis=1)
        weighted: FloatArray = self._matrix(self._states) * self.weights[:, None]
        return weighted.reshape(-1, len(self.names))

    def compute_slope(self, factors: FloatArray) -> FloatArray:
        """Return sum_ij L_ij dA_ij/dstates as (3, N, n) at the states of the last matrix, for L (N n, b)."""
        weighted = factors.reshape(self.samples, -1, len(self.names)) * self.weights[:, None]
        slope = self._slope(self._states, weighted)
        return slope.reshape(self.samples, 3, -1).transpose(1, 0, 2).copy()


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """What is minimised: "d-optimal", or "condition" with its power p and weight of the information."""

    name: str = "condition"
    power: float = 8.0
    weight: float = 0.0


def scale_gram(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return G (b, b) of columns scaled to length one, and their lengths (b,)."""
    lengths = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    return gram / np.outer(lengths, lengths), lengths


def compute_condition(gram: FloatArray) -> float:
    """Return the condition number of the columns scaled to length one, of G (b, b); inf for less rank."""
    values = np.linalg.eigvalsh(scale_gram(gram)[0])
    return float(np.sqrt(values[-1] / values[0])) if values[0] > _FLOOR * values[-1] else math.inf


def compute_information(gram: FloatArray) -> float:
    """Return log det(G) / (2 b) of G (b, b), the mean logarithm of information; -inf for less rank."""
    sign, value = np.linalg.slogdet(gram)
    return float(value) / (2.0 * len(gram)) if sign > 0 else -math.inf


def compute_criterion(gram: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
    """Return f and S = df/dG (b, b), symmetric, for G (b, b)."""
    scaled, lengths = scale_gram(gram)
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, _FLOOR * values[-1])
    size = 2.0 * len(gram)
    by_lengths = np.outer(lengths, lengths)
    information = float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(lengths))) / size
    slope = -((vectors / values) @ vectors.T) / by_lengths / size
    if criterion.name == "d-optimal":
        return -information, slope
    # The smooth stand-in for log cond, of powers of ratios, so that none overflows.
    power = criterion.power
    up, down = (values / values[-1]) ** power, (values[0] / values) ** power
    value = float((np.log(values[-1] / values[0]) + (np.log(up.sum()) + np.log(down.sum())) / power) / 2.0)
    slopes = 0.5 * (up / up.sum() - down / down.sum()) / values
    partial = (vectors * slopes) @ vectors.T
    by_gram = partial / by_lengths
    by_gram[np.diag_indices_from(by_gram)] -= (partial * scaled).sum(axis=1) / lengths**2
    return value - criterion.weight * information, by_gram + criterion.weight * slope


def build_limit_rows(space: SeriesSpace, limits: MotionLimits, density: int) -> tuple[FloatArray, FloatArray]:
    """Return R (m, n r), c (m,): |R z + c| <= 1 keeps all limits; `density` >= 3 points a harmonic."""
    points = density * space.harmonics
    sure = limits.share * math.cos(math.pi * space.harmonics / points)
    basis = build_grid_basis(space, points, 4)
    fastest = 2.0 * math.pi * space.harmonics / space.period
    blocks, constants = [], []
    for joint in range(space.size):
        offset = space.offset[joint].copy()
        offset[0] -= limits.centre[joint]
        # Orders of derivative whose limit does not follow from that of a lower one.
        kept, reach = [], math.inf
        for order, bound in enumerate((limits.share * limits.bounds[:, joint]).tolist()):
            if bound < reach:
                kept.append(order)
                reach = bound
            reach *= fastest
        full = basis[kept] / (sure * limits.bounds[kept, joint])[:, None, None]
        blocks.append(np.concatenate(full @ space.maps[joint]))
        constants.append(np.ravel(full @ offset))
    rows = np.zeros((sum(map(len, blocks)), sum(block.shape[1] for block in blocks)))
    row, column = 0, 0
    for block in blocks:
        height, width = block.shape
        rows[row : row + height, column : column + width] = block
        row, column = row + height, column + width
    return rows, np.concatenate(constants)


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
        """Lay out samples, rows and memory; limits are evaluated `density` times per harmonic."""
        self.space, self.limits, self.observation = space, limits, observation
        self.state_limits = state_limits
        self.basis = build_grid_basis(space, observation.samples, 3)
        checks = density * space.harmonics
        self._check_basis = build_grid_basis(space, checks, 3)
        self._values = StateValues(state_limits, checks, space.size)
        self.rows, self.constants = build_limit_rows(space, limits, density)

    def build_coarse(self) -> "ExcitationProblem":
        """Return the same problem with limits on a coarse grid, which is quicker and no less strict."""
        return ExcitationProblem(self.space, self.limits, self.observation, self.state_limits, _COARSE)

    def build_stated(self, robot: Robot) -> "ExcitationProblem":
        """Return the problem for the stated figures: many samples, friction as in the robot file."""
        samples = _FIGURE_SAMPLES * self.space.harmonics
        observation = Observation(robot, samples, self.observation.weights)
        return ExcitationProblem(self.space, self.limits, observation, self.state_limits, _COARSE)

    def compute_gram(self, unknowns: FloatArray) -> FloatArray:
        """Return G (b, b) of z (n r,)."""
        matrix = self.observation.compute_matrix(self.space.compute_states(unknowns, self.basis))
        return np.asarray(matrix.T @ matrix / self.observation.samples)

    def compute_value(self, unknowns: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
        """Return f and its gradient (n r,)."""
        matrix = self.observation.compute_matrix(self.space.compute_states(unknowns, self.basis))
        samples = self.observation.samples
        value, slope = compute_criterion(matrix.T @ matrix / samples, criterion)
        # The observation has the states already.
        by_state = self.observation.compute_slope((2.0 / samples) * matrix @ slope)
        by_coefficient = np.einsum("kic,kij->jc", self.basis, by_state, optimize=True)
        return value, np.einsum("jc,jcr->jr", by_coefficient, self.space.maps).ravel()

    def build_constraints(self, tightening: FloatArray, watched: NDArray[np.bool_]) -> Constraints:
        """Return the linear constraints, then those of v that are watched, (points, v).

        The latter are tightened by `tightening` (v,).
        """
        point, kind = np.nonzero(watched)

        def compute_values(unknowns: FloatArray) -> FloatArray:
            linear: FloatArray = self.rows @ unknowns + self.constants
            if not len(kind):
                return linear
            values = self._values.compute_values(self.space.compute_states(unknowns, self._check_basis))
            return np.append(linear, values[watched])

        def compute_jacobian(unknowns: FloatArray) -> FloatArray:
            if not len(kind):
                return self.rows
            slopes = self._values.compute_slopes(self.space.compute_states(unknowns, self._check_basis))
            by_coefficient = np.einsum("ekj,kec->ejc", slopes[watched], self._check_basis[:, point])
            by_unknown = np.einsum("ejc,jcr->ejr", by_coefficient, self.space.maps)
            return np.concatenate([self.rows, by_unknown.reshape(len(point), -1)])

        linear, upper = np.ones(len(self.rows)), 1.0 - tightening[kind]
        return Constraints(
            value=compute_values,
            jacobian=compute_jacobian,
            pattern=np.concatenate([self.rows != 0.0, np.ones((len(kind), self.rows.shape[1]), dtype=bool)]),
            lower=np.concatenate([-linear, np.where(self._values.both[kind], -upper, -np.inf)]),
            upper=np.concatenate([linear, upper]),
        )

    def compute_state_use(self, unknowns: FloatArray) -> FloatArray:
        """Return v (points, v) of torque, torsion and space, as `StateValues.compute_use` does."""
        return self._values.compute_use(self.space.compute_states(unknowns, self._check_basis))

    def compute_state_excess(self, unknowns: FloatArray) -> FloatArray:
        """Return by how much each v (v,) exceeds its limit at the worst point; negative within."""
        return np.asarray(self.compute_state_use(unknowns).max(axis=0) - 1.0)


def build_problem(robot: Robot, options: ExciteOptions) -> ExcitationProblem:
    """Return the problem of a robot, or raise a UsageError or RobotError if options or values do not fit."""
    refuse_passive_joints(robot, "they follow no trajectory; move the others, and record what they do")
    limits, weights = get_motion_limits(robot, options), np.ones(robot.freedom)
    if options.deviations is not None:
        given = options.deviations
        if len(given) != robot.freedom or not all(0.0 < value < np.inf for value in given):
            text = f"deviations: expected {robot.freedom} positive numbers, one a joint, got {list(given)}"
            raise UsageError(Notice(code="usage.excitation", text=text))
        weights = 1.0 / np.array(given)
    if options.start is not None and len(options.start) == robot.freedom:
        outside = np.abs(np.array(options.start) - limits.centre) > limits.share * limits.half
        if np.any(outside):
            which = ", ".join(str(place + 1) for place in np.flatnonzero(outside))
            text = f"the start is outside {limits.share:.0%} of the position limits of joint {which}"
            raise UsageError(Notice(code="usage.excitation", text=text))
    scales = compute_coefficient_scales(limits, options.harmonics, options.period)
    space = build_series_space(options, limits.centre, scales)
    state_limits = build_state_limits(robot, limits, options)
    observation = Observation(smooth_friction(robot), _GRAM_SAMPLES * options.harmonics, weights)
    return ExcitationProblem(space, limits, observation, state_limits)


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One limit: of what, of which joint or place, largest value, limit (SI), and the share that is allowed.

    Of positions the value is the distance from the middle of the range; of space the clearance in m, whose
    limit is zero.
    """

    kind: str
    name: str
    value: float
    limit: float
    allowed: float = field(metadata=HIDDEN)

    @property
    def share(self) -> float | None:
        """Return the part of the limit that is used; None for space."""
        return None if self.kind == SPACE else self.value / self.limit

    @property
    def excess(self) -> float:
        """Return by what part of the limit, or by how many metres, the allowed share is exceeded."""
        return -self.value if self.share is None else self.share / self.allowed - 1.0

    @property
    def kept(self) -> bool:
        """Return whether the limit is kept, up to the rounding of a solver."""
        return self.excess <= _ROUNDING


def compute_margins(
    problem: ExcitationProblem, names: tuple[str, ...], unknowns: FloatArray
) -> tuple[tuple[Margin, ...], FloatArray]:
    """Return all limits, joints in the order of `names`, at unknowns (n r,), and the largest v (v,)."""
    limits, space, entries = problem.limits, problem.space, problem.state_limits.entries
    basis = build_grid_basis(space, _FIGURE_SAMPLES * space.harmonics, 4)
    states = space.compute_states(unknowns, basis)
    gaps = np.abs(states - np.array([limits.centre, *np.zeros((3, len(names)))])[:, None, :])
    margins = [
        Margin(kind=kind, name=name, value=float(peak), limit=float(bound), allowed=limits.share)
        for kind, row, bounds in zip(_ORDERS, gaps.max(axis=1), limits.bounds, strict=True)
        for name, peak, bound in zip(names, row, bounds, strict=True)
        if math.isfinite(bound)
    ]
    values = StateValues(problem.state_limits, states.shape[1], space.size)
    peaks: FloatArray = values.compute_use(states[:3]).max(axis=0)
    for entry, peak in zip(entries, peaks.tolist(), strict=True):
        if entry.both:
            full, value, share = entry.limit / limits.share, peak * entry.limit, limits.share
            margins.append(Margin(kind=entry.kind, name=entry.name, value=value, limit=full, allowed=share))
        else:
            left = _CLEARANCES[entry.kind](peak, entry.limit)
            margins.append(Margin(kind=SPACE, name=entry.name, value=left, limit=0.0, allowed=1.0))
    return tuple(margins), peaks
