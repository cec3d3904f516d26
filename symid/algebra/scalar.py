"""The scalar algebra that the recursion is written over, and the state it starts from.

Input: numbers of one carrier (exact polynomials, code expressions, floats).
Output: `Algebra`, the few operations the dynamics needs, and `State`, the coordinates.

A carrier supplies add, mul, neg and constants; signs, zeros and ones are handled by the
carrier itself, so that the recursion need not know them.
"""

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, Protocol, TypeVar

from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = ["Algebra", "OperatorAlgebra", "State", "T", "spread_coordinates"]

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
    """The state of a robot in one carrier, one entry a joint, those that follow another included.

    Args:
        sine, cosine: of the joint angle; not used at prismatic joints.
        position: joint coordinate; at revolute joints used by springs only.
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


def spread_coordinates(robot: Robot, algebra: Algebra[T], values: Sequence[T]) -> tuple[T, ...]:
    """Return the value of every joint, and then every coupling, from those of the coordinates.

    Args:
        robot: the robot.
        algebra: the carrier.
        values: positions, velocities or accelerations of the coordinates.
    """
    result = []
    for row in robot.transmission:
        total = algebra.zero
        for position, factor in row:
            share = values[position]
            if factor != Fraction(1):
                share = algebra.mul(algebra.constant(Exact.of(factor)), share)
            total = algebra.add(total, share)
        result.append(total)
    return tuple(result)
