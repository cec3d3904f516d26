"""The observation matrix A of a motion and the criteria of design of it, with exact derivatives.

Robot -> Observation: A (m, b) at the states of N samples, one row a torque, one column a parameter, and
sum_ij L_ij dA_ij/dstates for any L. G = A'A -> condition number, information, criterion f and S = df/dG.

The columns are those that identification has: base parameters, then friction parameters. The derivative
is the reverse sweep of the generated regressor (CasADi), once a sample. Friction that jumps with the sign
of the velocity has no slope there; `smooth_friction` gives it one.

With d = sqrt(diag G) and C = G / (d d'), the Gram matrix of the columns scaled to length one:

    condition   cond = sqrt(lmax(C) / lmin(C))
                smooth stand-in  f = (log sum l^p + log sum l^-p) / (2 p) >= log cond,
                at most log(b) / p above it
    d-optimal   f = -log det(G) / (2 b): minus the mean logarithm of a parameter's information

S is symmetric, and df = sum (2 A S) dA. Criteria of designs: Swevers et al. 1997.

Supported: rigid and elastic robots (of the latter the links); full column rank.
Not supported: rotors of elastic joints, which another equation shows; matrices of less rank, whose
criterion is infinite.
"""

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.robot import FrictionKind, FrictionValues, Robot

_SMOOTHING = 0.02
"""Of the velocity limit: the speed over which friction changes its sign for the optimiser."""
_SLOW = 0.02
"""The same in rad/s or m/s, for joints without a velocity limit."""


def smooth_friction(robot: Robot) -> Robot:
    """Return the robot with friction that has a slope everywhere."""

    def smooth(friction: FrictionValues, velocity: float | None) -> FrictionValues:
        if friction.kind is FrictionKind.NONE or friction.smoothing > 0.0:
            return friction
        return replace(friction, smoothing=_SLOW if velocity is None else _SMOOTHING * velocity)

    joints = tuple(
        replace(joint, friction=smooth(joint.friction, joint.limits.velocity)) for joint in robot.joints
    )
    couplings = tuple(replace(entry, friction=smooth(entry.friction, None)) for entry in robot.couplings)
    return replace(robot, joints=joints, couplings=couplings)


@dataclass(frozen=True, slots=True, kw_only=True)
class RegressorColumns:
    """Names of the parameters, and CasADi functions of one sample's states (3n).

    Args:
        names: b of them.
        matrix: states -> (n b), row after row. slope: states, (n b) -> (3n).
    """

    names: tuple[str, ...]
    matrix: Any
    slope: Any


def build_columns(robot: Robot) -> RegressorColumns:
    """Return the columns of a robot, its friction as it is.

    Raises:
        RobotError: a symbolic length has no value.
    """
    import casadi as ca

    from symid.codegen import build_functions

    kinds = [
        *(joint.friction.kind for joint in robot.joints),
        *(one.friction.kind for one in robot.couplings),
    ]
    has_friction = any(kind is not FrictionKind.NONE for kind in kinds)
    wanted = ("torque_regressor", "friction_regressor") if has_friction else ("torque_regressor",)
    made = build_functions(robot, names=wanted)
    found = {spec.name: entry for spec, entry in zip(made.card.functions, made.functions, strict=True)}
    states = [ca.SX.sym(name, robot.freedom) for name in ("q", "dq", "ddq")]
    blocks = [found["torque_regressor"](*states)]
    names = tuple(entry.name for entry in made.card.beta)
    if has_friction:
        blocks.append(found["friction_regressor"](states[1]))
        names += tuple(entry.name for entry in made.card.friction)
    state, flat = ca.vertcat(*states), ca.densify(ca.vec(ca.horzcat(*blocks).T))
    factors = ca.SX.sym("L", flat.numel())
    slope = ca.densify(ca.gradient(ca.dot(factors, flat), state))
    return RegressorColumns(
        names=names,
        matrix=ca.Function("matrix", [state], [flat]),
        slope=ca.Function("slope", [state, factors], [slope]),
    )


@final
class Observation:
    """The columns at so many samples, evaluated in place.

    `weights` (n,) multiply the rows of each joint: one over the deviation of its torque.
    """

    __slots__ = (
        "_factors",
        "_flat",
        "_run_matrix",
        "_run_slope",
        "_slope",
        "_states",
        "names",
        "samples",
        "weights",
    )

    def __init__(self, columns: RegressorColumns, samples: int, weights: FloatArray) -> None:
        """Make the memory that the functions read and write."""
        size, count = len(weights), len(columns.names)
        self.names, self.samples, self.weights = columns.names, samples, freeze(weights)
        self._states = np.zeros((samples, 3 * size))
        self._flat = np.zeros((samples, size, count))
        self._factors = np.zeros((samples, size, count))
        self._slope = np.zeros((samples, 3 * size))
        self._run_matrix = bind_in_place(columns.matrix.map(samples), (self._states,), self._flat)
        self._run_slope = bind_in_place(
            columns.slope.map(samples), (self._states, self._factors), self._slope
        )

    def find_matrix(self, states: FloatArray) -> FloatArray:
        """Return A (N n, b) at states (3, N, n): q, dq, ddq."""
        self._states[...] = np.concatenate(list(states), axis=1)
        self._run_matrix()
        weighted: FloatArray = self._flat * self.weights[:, None]
        return weighted.reshape(-1, len(self.names))

    def find_slope(self, factors: FloatArray) -> FloatArray:
        """Return sum_ij L_ij dA_ij/dstates as (3, N, n) at the states of the last matrix, for L (N n, b)."""
        self._factors[...] = factors.reshape(self._factors.shape) * self.weights[:, None]
        self._run_slope()
        return self._slope.reshape(self.samples, 3, -1).transpose(1, 0, 2).copy()


def bind_in_place(function: Any, inputs: tuple[FloatArray, ...], output: FloatArray) -> Any:  # noqa: ANN401  of casadi
    """Return a call without arguments that reads `inputs` and writes `output`, all kept in place."""
    buffer, call = function.buffer()
    for place, values in enumerate(inputs):
        buffer.set_arg(place, values.data)
    buffer.set_res(0, output.data)

    def run(keep: Any = buffer) -> None:  # noqa: ANN401, ARG001  the buffer must live as long as its call
        call()

    return run


CRITERIA = ("condition", "d-optimal")
_FLOOR = 1e-13
"""Least eigenvalue of a scaled Gram matrix that is not rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """What is minimised: one of `CRITERIA`; power p and weight of the information belong to "condition"."""

    name: str = "condition"
    power: float = 8.0
    weight: float = 0.0


def _scale_gram(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    lengths = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    return gram / np.outer(lengths, lengths), lengths


def compute_condition(gram: FloatArray) -> float:
    """Return the condition number of the columns scaled to length one, of G (b, b); inf for less rank."""
    values = np.linalg.eigvalsh(_scale_gram(gram)[0])
    if not values[0] > _FLOOR * values[-1]:
        return float("inf")
    return float(np.sqrt(values[-1] / values[0]))


def compute_information(gram: FloatArray) -> float:
    """Return log det(G) / (2 b) of G (b, b), the mean logarithm of information; -inf for less rank."""
    sign, value = np.linalg.slogdet(gram)
    return float(value) / (2.0 * len(gram)) if sign > 0 else -float("inf")


def compute_criterion(gram: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
    """Return f and S = df/dG (b, b), symmetric, for G (b, b)."""
    scaled, lengths = _scale_gram(gram)
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, _FLOOR * values[-1])
    size = 2.0 * len(gram)
    by_lengths = np.outer(lengths, lengths)
    information = float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(lengths))) / size
    slope = -((vectors / values) @ vectors.T) / by_lengths / size
    if criterion.name == "d-optimal":
        return -information, slope
    value, partial = _compute_condition_criterion(values, vectors, criterion.power)
    by_gram = partial / by_lengths
    by_gram[np.diag_indices_from(by_gram)] -= (partial * scaled).sum(axis=1) / lengths**2
    return value - criterion.weight * information, by_gram + criterion.weight * slope


def _compute_condition_criterion(
    values: FloatArray, vectors: FloatArray, power: float
) -> tuple[float, FloatArray]:
    """Return the smooth stand-in for log cond, and its derivative by C, from eigenvalues and -vectors."""
    # Powers of ratios, so that none overflows.
    up, down = (values / values[-1]) ** power, (values[0] / values) ** power
    value = (np.log(values[-1] / values[0]) + (np.log(up.sum()) + np.log(down.sum())) / power) / 2.0
    slopes = 0.5 * (up / up.sum() - down / down.sum()) / values
    return float(value), (vectors * slopes) @ vectors.T
