"""The observation matrix of a motion, and what its entries say about the states: exact, by CasADi.

Input: a robot. Output: `Observation`: A at the states of N samples, and sum_ij L_ij dA_ij/dstates for any L.

The columns are those that identification has: base parameters, then friction parameters. The derivative is
the reverse sweep of the generated regressor, once a sample. Friction that jumps with the sign of the velocity
has no slope there; `smooth_friction` gives it one.

Supported: rigid and elastic robots (of the latter the links).
Not supported: rotors of elastic joints, which another equation shows.
"""

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.robot.description import FrictionKind, FrictionValues, Robot

__all__ = ["Columns", "Observation", "bind_function", "build_columns", "smooth_friction"]

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
class Columns:
    """Names of the parameters, and CasADi functions of one sample's states (3n).

    Args:
        names: b of them.
        matrix: states -> (n b), row after row. slope: states, (n b) -> (3n).
    """

    names: tuple[str, ...]
    matrix: Any
    slope: Any


def build_columns(robot: Robot) -> Columns:
    """Return the columns of a robot, its friction as it is.

    Raises:
        RobotError: a symbolic length has no value.
    """
    import casadi as ca

    from symid.codegen.casadi_functions import build_functions

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
    return Columns(
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

    def __init__(self, columns: Columns, samples: int, weights: FloatArray) -> None:
        """Make the memory that the functions read and write."""
        size, count = len(weights), len(columns.names)
        self.names, self.samples, self.weights = columns.names, samples, freeze(weights)
        self._states = np.zeros((samples, 3 * size))
        self._flat = np.zeros((samples, size, count))
        self._factors = np.zeros((samples, size, count))
        self._slope = np.zeros((samples, 3 * size))
        self._run_matrix = bind_function(columns.matrix.map(samples), (self._states,), self._flat)
        self._run_slope = bind_function(
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


def bind_function(function: Any, inputs: tuple[FloatArray, ...], output: FloatArray) -> Any:  # noqa: ANN401  of casadi
    """Return a call without arguments that reads `inputs` and writes `output`, all kept in place."""
    buffer, call = function.buffer()
    for place, values in enumerate(inputs):
        buffer.set_arg(place, values.data)
    buffer.set_res(0, output.data)

    def run(keep: Any = buffer) -> None:  # noqa: ANN401, ARG001  the buffer must live as long as its call
        call()

    return run
