"""The scalar algebra that the recursion is written over, and the state it starts from.

Input: numbers of one carrier (exact polynomials, code expressions, floats).
Output: `Algebra`, the few operations the dynamics needs, and `State`, the coordinates.

A carrier supplies add, mul, neg and constants; signs, zeros and ones are handled by the
carrier itself, so that the recursion need not know them.
"""

import operator
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from symid.robot.geometry import Exact

__all__ = ["Algebra", "OperatorAlgebra", "State", "T"]

T = TypeVar("T")


class Algebra(Protocol[T]):
    """The operations of a carrier of scalars."""

    @property
    def zero(self) -> T:
        """Return the number zero."""

    @property
    def one(self) -> T:
        """Return the number one."""

    def constant(self, value: Exact) -> T:
        """Return an exact number, or a symbolic length, in this carrier."""

    def add(self, left: T, right: T) -> T:
        """Return left + right."""

    def sub(self, left: T, right: T) -> T:
        """Return left - right."""

    def mul(self, left: T, right: T) -> T:
        """Return left * right in normal form."""

    def neg(self, value: T) -> T:
        """Return -value."""

    def half(self, value: T) -> T:
        """Return value / 2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class State(Generic[T]):
    """The coordinates of a robot in one carrier, one entry a joint.

    Args:
        sine, cosine: of the joint angle; not used at prismatic joints.
        position: joint coordinate; not used at revolute joints.
        velocity: dq; acceleration: ddq.
    """

    sine: tuple[T, ...]
    cosine: tuple[T, ...]
    position: tuple[T, ...]
    velocity: tuple[T, ...]
    acceleration: tuple[T, ...]


class OperatorAlgebra(Generic[T]):
    """The operations of a carrier whose numbers have the usual operators."""

    def add(self, left: T, right: T) -> T:
        """Return left + right."""
        result: T = operator.add(left, right)
        return result

    def sub(self, left: T, right: T) -> T:
        """Return left - right."""
        result: T = operator.sub(left, right)
        return result

    def mul(self, left: T, right: T) -> T:
        """Return left * right."""
        result: T = operator.mul(left, right)
        return result

    def neg(self, value: T) -> T:
        """Return -value."""
        result: T = operator.neg(value)  # type: ignore[arg-type]  # T has operators here
        return result
