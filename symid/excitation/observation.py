"""The observation matrix A of a motion and the criteria of design of it, with exact derivatives.

Robot -> Observation: A (m, b) at the states of N samples, one row a torque, one column a parameter, and
sum_ij L_ij dA_ij/dstates for any L. G = A'A -> condition number, information, criterion f and S = df/dG.
With d = sqrt(diag G) and C = G / (d d'), the Gram matrix of columns scaled to length one:

    condition   cond = sqrt(lmax(C) / lmin(C)), at most log(b) / p below its smooth stand-in in log:
                f = (log sum l^p + log sum l^-p) / (2 p) >= log cond
    d-optimal   f = -log det(G) / (2 b): minus the mean logarithm of a parameter's information

S is symmetric, and df = sum (2 A S) dA. Criteria of designs: Swevers et al. 1997.

Supported: rigid and elastic robots (of the latter the links); full column rank.
Not supported: rotors of elastic joints; matrices of less rank, whose criterion is infinite.
"""

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.joint_models import NO_FRICTION, FrictionValues, get_friction_law, name_values
from symid.robot import (
    Robot,
)

_SMOOTHING = 0.02
"""Width of the sign change of friction for the optimiser, relative to the velocity limit."""
_SLOW = 0.02
"""The same for joints without a velocity limit, rad/s or m/s."""


def smooth_friction(robot: Robot) -> Robot:
    """Return the robot with friction that has a slope everywhere."""

    def smooth(friction: FrictionValues, velocity: float | None) -> FrictionValues:
        law = get_friction_law(friction)
        if law is not None and {"load", "temperature"} & set(law.inputs):
            # Neither is known before the robot moves; what the motion must show of them is less.
            named = name_values(friction)
            values = tuple(named.get(name, 0.0) for name in ("Fv", "Fc", "offset")) if named else None
            friction = FrictionValues(
                law="coulomb-viscous-offset", values=values, smoothing=friction.smoothing
            )
        if friction.law == NO_FRICTION or friction.smoothing > 0.0:
            return friction
        return replace(friction, smoothing=_SLOW if velocity is None else _SMOOTHING * velocity)

    joints = tuple(
        replace(joint, friction=smooth(joint.friction, joint.limits.velocity)) for joint in robot.joints
    )
    couplings = tuple(replace(entry, friction=smooth(entry.friction, None)) for entry in robot.couplings)
    return replace(robot, joints=joints, couplings=couplings)


def _build_columns(robot: Robot) -> tuple[tuple[str, ...], Any, Any]:
    """Return the names of the b parameters, and CasADi functions of one sample's states (3n).

    They are the columns, states -> (n b), row after row, and their slope: states, (n b) -> (3n).
    """
    import casadi as ca

    from symid.codegen import build_functions

    frictions = [*(joint.friction for joint in robot.joints), *(one.friction for one in robot.couplings)]
    has_friction = any(friction.law != NO_FRICTION for friction in frictions)
    wanted = ("torque_regressor", "friction_regressor") if has_friction else ("torque_regressor",)
    made = build_functions(robot, names=wanted)
    found = {spec.name: entry for spec, entry in zip(made.card.functions, made.functions, strict=True)}
    states = [ca.SX.sym(name, robot.freedom) for name in ("q", "dq", "ddq")]
    blocks = [found["torque_regressor"](*states)]
    names = tuple(entry.name for entry in made.card.beta)
    if has_friction:
        read = found["friction_regressor"].n_in()
        blocks.append(found["friction_regressor"](states[1], *states[: read - 1]))
        names += tuple(entry.name for entry in made.card.friction)
    state, flat = ca.vertcat(*states), ca.densify(ca.vec(ca.horzcat(*blocks).T))
    factors = ca.SX.sym("L", flat.numel())
    slope = ca.densify(ca.gradient(ca.dot(factors, flat), state))
    return names, ca.Function("matrix", [state], [flat]), ca.Function("slope", [state, factors], [slope])


@final
class Observation:
    """The columns of a robot at a fixed number of samples, its friction as it is, evaluated in place.

    `weights` (n,) multiply the rows of each joint: one over the standard deviation of its torque. Symbolic
    lengths must have values.
    """

    def __init__(self, robot: Robot, samples: int, weights: FloatArray) -> None:
        """Derive the functions and allocate their memory."""
        self.names, matrix, slope = _build_columns(robot)
        self.samples, self.weights = samples, freeze(weights)
        state, block = (3 * len(weights),), (len(weights), len(self.names))
        self._states = np.zeros((samples, *state))
        self._matrix = InPlaceFunction(matrix, samples, (state,), block)
        self._slope = InPlaceFunction(slope, samples, (state, block), state)

    def compute_matrix(self, states: FloatArray) -> FloatArray:
        """Return A (N n, b) at states (3, N, n): q, dq, ddq."""
        self._states = np.concatenate(list(states), axis=1)
        weighted: FloatArray = self._matrix(self._states) * self.weights[:, None]
        return weighted.reshape(-1, len(self.names))

    def compute_slope(self, factors: FloatArray) -> FloatArray:
        """Return sum_ij L_ij dA_ij/dstates as (3, N, n) at the states of the last matrix, for L (N n, b)."""
        weighted = factors.reshape(self.samples, -1, len(self.names)) * self.weights[:, None]
        slope = self._slope(self._states, weighted)
        return slope.reshape(self.samples, 3, -1).transpose(1, 0, 2).copy()


Shape = tuple[int, ...]


@final
class InPlaceFunction:
    """A CasADi function at N samples that reads and writes its own memory."""

    def __init__(self, function: Any, samples: int, inputs: tuple[Shape, ...], output: Shape) -> None:  # noqa: ANN401  of casadi
        """Allocate arrays of these shapes for each sample."""
        self._inputs = [np.zeros((samples, *shape)) for shape in inputs]
        self._output = np.zeros((samples, *output))
        # The buffer must live as long as its call.
        self._buffer, self._call = function.map(samples).buffer()
        for place, memory in enumerate(self._inputs):
            self._buffer.set_arg(place, memory.data)
        self._buffer.set_res(0, self._output.data)

    def __call__(self, *values: FloatArray) -> FloatArray:
        """Return the output, which the next call overwrites."""
        for memory, value in zip(self._inputs, values, strict=True):
            memory[...] = value
        self._call()
        return self._output


CRITERIA = ("condition", "d-optimal")
_FLOOR = 1e-13
"""Least eigenvalue of a scaled Gram matrix that is not rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """What is minimised: one of `CRITERIA`; power p and weight of the information belong to "condition"."""

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
    if not values[0] > _FLOOR * values[-1]:
        return float("inf")
    return float(np.sqrt(values[-1] / values[0]))


def compute_information(gram: FloatArray) -> float:
    """Return log det(G) / (2 b) of G (b, b), the mean logarithm of information; -inf for less rank."""
    sign, value = np.linalg.slogdet(gram)
    return float(value) / (2.0 * len(gram)) if sign > 0 else -float("inf")


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
