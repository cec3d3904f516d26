"""Joint friction that is linear in its parameters, one definition per model.

Input: a joint velocity in any carrier that has a sign function. Output: one column per
parameter; the friction torque is their sum, positive against positive velocity.

Supported: viscous and Coulomb, with offset, asymmetric; sign(0) = 0, or tanh(v / v0) in place of the sign.
Not supported: models with nonlinear parameters, such as Stribeck.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from symid.robot.description import FrictionKind, FrictionValues, Robot

__all__ = [
    "FRICTION_MODELS",
    "FrictionAlgebra",
    "FrictionModel",
    "SmoothAlgebra",
    "find_friction",
    "find_friction_columns",
    "list_friction_parameters",
]

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


class SmoothAlgebra(FrictionAlgebra[V], Protocol[V]):
    """What a friction column whose dry friction is smoothed may use besides."""

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""

    def tanh(self, value: V) -> V:
        """Return the hyperbolic tangent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionModel:
    """A friction model: the names of its parameters (see `notation`) and their columns."""

    kind: FrictionKind
    parameters: tuple[str, ...]
    columns: Callable[[FrictionAlgebra[V], V], tuple[V, ...]]
    formula: str


@dataclass(frozen=True, slots=True)
class _Smoothed(Generic[V]):
    """A carrier in which sign(v) is tanh(v / v0): dry friction that changes its sign over a speed v0."""

    carrier: SmoothAlgebra[V]
    speed: float

    @property
    def one(self) -> V:
        return self.carrier.one

    def add(self, left: V, right: V) -> V:
        return self.carrier.add(left, right)

    def sub(self, left: V, right: V) -> V:
        return self.carrier.sub(left, right)

    def half(self, value: V) -> V:
        return self.carrier.half(value)

    def sign(self, value: V) -> V:
        return self.carrier.tanh(self.carrier.scale(1.0 / self.speed, value))

    def absolute(self, value: V) -> V:
        return self.carrier.absolute(value)


def find_friction_columns(friction: FrictionValues, algebra: SmoothAlgebra[V], velocity: V) -> tuple[V, ...]:
    """Return one column per parameter of a joint's friction model, at `velocity` (rad/s or m/s)."""
    model = FRICTION_MODELS[friction.kind]
    if friction.smoothing > 0.0:
        return model.columns(_Smoothed(algebra, friction.smoothing), velocity)
    return model.columns(algebra, velocity)


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
