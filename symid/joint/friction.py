"""Joint friction that is linear in its parameters, one definition per model.

Input: a joint velocity in any carrier that has a sign function. Output: one column per
parameter; the friction torque is their sum, positive against positive velocity.

Supported: viscous and Coulomb, with offset, asymmetric. sign(0) = 0.
Not supported: models with nonlinear parameters, such as Stribeck.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from symid.robot.description import FrictionKind, FrictionValues, Robot

__all__ = ["FRICTION_MODELS", "FrictionAlgebra", "FrictionModel", "find_friction", "list_friction_parameters"]

V = TypeVar("V")


class FrictionAlgebra(Protocol[V]):
    """What a friction column may use of its carrier."""

    @property
    def one(self) -> V:
        """Return the number one."""

    def add(self, left: V, right: V) -> V:
        """Return left + right."""

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""

    def half(self, value: V) -> V:
        """Return value / 2."""

    def sign(self, value: V) -> V:
        """Return -1, 0 or 1."""

    def absolute(self, value: V) -> V:
        """Return |value|."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionModel:
    """A friction model: the names of its parameters (see `notation`) and their columns."""

    kind: FrictionKind
    parameters: tuple[str, ...]
    columns: Callable[[FrictionAlgebra[V], V], tuple[V, ...]]
    formula: str


def _viscous_coulomb(algebra: FrictionAlgebra[V], velocity: V) -> tuple[V, ...]:
    return velocity, algebra.sign(velocity)


def _with_offset(algebra: FrictionAlgebra[V], velocity: V) -> tuple[V, ...]:
    return velocity, algebra.sign(velocity), algebra.one


def _asymmetric(algebra: FrictionAlgebra[V], velocity: V) -> tuple[V, ...]:
    size, sign = algebra.absolute(velocity), algebra.sign(velocity)
    # sign^2 is |sign|: one away from standstill, zero at it.
    moving = algebra.absolute(sign)
    return (
        algebra.half(algebra.add(velocity, size)),
        algebra.half(algebra.add(sign, moving)),
        algebra.half(algebra.sub(velocity, size)),
        algebra.half(algebra.sub(sign, moving)),
    )


FRICTION_MODELS: dict[FrictionKind, FrictionModel] = {
    model.kind: model
    for model in (
        FrictionModel(
            kind=FrictionKind.NONE,
            parameters=(),
            columns=lambda _algebra, _velocity: (),
            formula="0",
        ),
        FrictionModel(
            kind=FrictionKind.VISCOUS_COULOMB,
            parameters=("Fv", "Fc"),
            columns=_viscous_coulomb,
            formula="Fv dq + Fc sign(dq)",
        ),
        FrictionModel(
            kind=FrictionKind.VISCOUS_COULOMB_OFFSET,
            parameters=("Fv", "Fc", "offset"),
            columns=_with_offset,
            formula="Fv dq + Fc sign(dq) + offset",
        ),
        FrictionModel(
            kind=FrictionKind.ASYMMETRIC,
            parameters=("Fvp", "Fcp", "Fvn", "Fcn"),
            columns=_asymmetric,
            formula="Fvp dq + Fcp for dq > 0, Fvn dq - Fcn for dq < 0",
        ),
    )
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
