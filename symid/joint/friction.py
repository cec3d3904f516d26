"""Joint friction as robot files name it: the models, their parameters and columns.

Input: a joint velocity in any carrier of friction laws. Output: one column per parameter; the friction
torque is their sum, positive against positive velocity.

Supported: viscous and Coulomb, with offset, asymmetric; curved models, whose shape values are constants of
the robot; sign(0) = 0, or tanh(v / v0) in place of the sign.
Not supported: friction that depends on load or position; with a memory.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from symid.joint.friction_columns import SmoothedFriction, find_asymmetric, find_coulomb_viscous
from symid.joint.friction_law import FrictionCarrier, LawColumns
from symid.joint.friction_laws import (
    FRICTION_LAWS,
    build_asymmetric_stribeck,
    build_improved,
    build_stribeck,
    with_offset,
)
from symid.robot.description import CurvedFriction, FrictionKind, FrictionValues, Robot

__all__ = [
    "FRICTION_MODELS",
    "FrictionModel",
    "find_friction",
    "find_friction_columns",
    "list_friction_parameters",
]

V = TypeVar("V")
_FALL = "Fe exp(-|dq/vs|^gamma)"
Kind = FrictionKind | CurvedFriction


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionModel:
    """A friction model of robot files.

    Args:
        kind: its name. parameters: theirs (see `notation`), one a column.
        build: from the exponent gamma, where the model has one, the columns of its law.
        shape: names of the constants of the robot, gamma last where the model has one.
        own: parameters whose columns are no sum of v, |v|, sign(v) and one.
    """

    kind: Kind
    parameters: tuple[str, ...]
    build: Callable[[float], LawColumns]  # type: ignore[type-arg]
    formula: str
    shape: tuple[str, ...] = ()
    own: tuple[str, ...] = ()

    def find_columns(
        self, carrier: FrictionCarrier[V], velocity: V, shape: tuple[float, ...] = ()
    ) -> tuple[V, ...]:
        """Return one column per parameter at `velocity`, for the values of `shape`."""
        named = dict(zip(self.shape, shape, strict=True))
        exponent = named.pop("gamma", 2.0)
        values = [carrier.scale(value, carrier.one) for value in named.values()]
        return self.build(exponent)(carrier, {"velocity": velocity}, values)


def find_friction_columns(
    friction: FrictionValues, algebra: FrictionCarrier[V], velocity: V
) -> tuple[V, ...]:
    """Return one column per parameter of a joint's friction model, at `velocity` (rad/s or m/s)."""
    model = FRICTION_MODELS[friction.kind]
    if friction.smoothing > 0.0:
        return model.find_columns(SmoothedFriction(algebra, friction.smoothing), velocity, friction.shape)
    return model.find_columns(algebra, velocity, friction.shape)


def _find_nothing(_carrier: FrictionCarrier[V], _inputs: Mapping[str, V], _shape: object) -> tuple[V, ...]:
    return ()


def _list_linear() -> tuple[FrictionModel, ...]:
    return (
        FrictionModel(
            kind=FrictionKind.NONE,
            parameters=(),
            build=lambda _gamma: _find_nothing,
            formula="0",
        ),
        FrictionModel(
            kind=FrictionKind.VISCOUS_COULOMB,
            parameters=("Fv", "Fc"),
            build=lambda _gamma: find_coulomb_viscous,
            formula="Fv dq + Fc sign(dq)",
        ),
        FrictionModel(
            kind=FrictionKind.VISCOUS_COULOMB_OFFSET,
            parameters=("Fv", "Fc", "offset"),
            build=lambda _gamma: FRICTION_LAWS["coulomb-viscous-offset"].columns,
            formula="Fv dq + Fc sign(dq) + offset",
        ),
        FrictionModel(
            kind=FrictionKind.ASYMMETRIC,
            parameters=("Fvp", "Fcp", "Fvn", "Fcn"),
            build=lambda _gamma: find_asymmetric,
            formula="Fvp dq + Fcp for dq > 0, Fvn dq - Fcn for dq < 0",
        ),
    )


def _list_curved() -> tuple[FrictionModel, ...]:
    return (
        FrictionModel(
            kind=CurvedFriction.STRIBECK,
            parameters=("Fv", "Fc", "Fe"),
            build=lambda gamma: build_stribeck(exponent=gamma).columns,
            formula=f"Fv dq + [Fc + {_FALL}] sign(dq)",
            shape=("vs", "gamma"),
            own=("Fe",),
        ),
        FrictionModel(
            kind=CurvedFriction.STRIBECK_OFFSET,
            parameters=("Fv", "Fc", "Fe", "offset"),
            build=lambda gamma: with_offset(build_stribeck(exponent=gamma)).columns,
            formula=f"Fv dq + [Fc + {_FALL}] sign(dq) + offset",
            shape=("vs", "gamma"),
            own=("Fe",),
        ),
        FrictionModel(
            kind=CurvedFriction.IMPROVED_STRIBECK,
            parameters=("Fv", "Fc", "Fe", "Fp"),
            build=lambda gamma: build_improved(exponent=gamma).columns,
            formula="Fv dq + [Fc + Fe exp(-(max(|dq|, dq0)/vs)^gamma)] clip(dq/dq0, -1, 1) + Fp",
            shape=("vs", "dq0", "gamma"),
            own=("Fc", "Fe"),
        ),
        FrictionModel(
            kind=CurvedFriction.ASYMMETRIC_STRIBECK,
            parameters=("Fvp", "Fcp", "Fvn", "Fcn", "Fe"),
            build=lambda gamma: build_asymmetric_stribeck(exponent=gamma).columns,
            formula=f"Fvp dq + Fcp for dq > 0, Fvn dq - Fcn for dq < 0, + {_FALL} sign(dq)",
            shape=("vs", "gamma"),
            own=("Fe",),
        ),
    )


def _list_other_curved() -> tuple[FrictionModel, ...]:
    return (
        FrictionModel(
            kind=CurvedFriction.CUBIC,
            parameters=("Fv", "Fc", "Fvq", "Fvc"),
            build=lambda _gamma: FRICTION_LAWS["cubic"].columns,
            formula="Fv dq + Fc sign(dq) + Fvq |dq| dq + Fvc dq^3",
            own=("Fvq", "Fvc"),
        ),
        FrictionModel(
            kind=CurvedFriction.STRIBECK_CUBIC,
            parameters=("Fv", "Fc", "Fe", "Fvq", "Fvc"),
            build=lambda gamma: build_stribeck(exponent=gamma, orders=(2, 3)).columns,
            formula=f"Fv dq + [Fc + {_FALL}] sign(dq) + Fvq |dq| dq + Fvc dq^3",
            shape=("vs", "gamma"),
            own=("Fe", "Fvq", "Fvc"),
        ),
        FrictionModel(
            kind=CurvedFriction.POWER_LAW,
            parameters=("Fc", "Fd"),
            build=lambda _gamma: FRICTION_LAWS["power-law"].columns,
            formula="[Fc + Fd |dq|^delta] sign(dq)",
            shape=("delta",),
            own=("Fd",),
        ),
        FrictionModel(
            kind=CurvedFriction.MAKKAR,
            parameters=("Fm", "Fc", "Fv"),
            build=lambda _gamma: FRICTION_LAWS["makkar"].columns,
            formula="Fm [tanh(g2 dq) - tanh(g3 dq)] + Fc tanh(g5 dq) + Fv dq",
            shape=("g2", "g3", "g5"),
            own=("Fm", "Fc"),
        ),
    )


FRICTION_MODELS: dict[Kind, FrictionModel] = {
    model.kind: model for model in (*_list_linear(), *_list_curved(), *_list_other_curved())
}


def find_friction(robot: Robot, index: int) -> FrictionValues:
    """Return the friction of a joint, or of a coupling (numbered behind the joints)."""
    return (
        robot.joints[index].friction if index < robot.size else robot.couplings[index - robot.size].friction
    )


def list_friction_parameters(robot: Robot) -> tuple[tuple[int, str], ...]:
    """Return the labels of all friction parameters: joints first, then couplings."""
    indices = range(robot.size + len(robot.couplings))
    return tuple(
        (index, name)
        for index in indices
        for name in FRICTION_MODELS[find_friction(robot, index).kind].parameters
    )
