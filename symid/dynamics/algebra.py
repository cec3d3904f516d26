# ruff: noqa: D102 - operations are named as what they are

"""The scalar algebra that the recursion is written over, with vectors, matrices and the state on top.

Numbers of one carrier (exact polynomials, code expressions, floats) -> `Algebra`, the few operations that
dynamics needs; `RobotState`, the coordinates; vectors (x, y, z) and matrices as tuples of scalars.

A carrier handles signs, zeros and ones itself, so that the recursion need not know them.
"""

import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

from symid.robot import Exact, Robot

T = TypeVar("T")
Vector = tuple[T, T, T]
Matrix = tuple[tuple[T, T, T], tuple[T, T, T], tuple[T, T, T]]
Label = tuple[int, str]
"""A parameter: the index of its joint, or coupling behind the joints, and its name."""


def transpose(matrix: Matrix[T]) -> Matrix[T]:
    """Return the transposed matrix."""
    a, b, c = matrix
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


class Algebra(Protocol[T]):
    """The operations of a carrier: of scalars, its own; of vectors and matrices, the same for all.

    Constants are exact numbers or symbolic lengths.
    """

    @property
    def zero(self) -> T: ...
    @property
    def one(self) -> T: ...
    def constant(self, value: Exact, /) -> T: ...
    def add(self, left: T, right: T, /) -> T: ...
    def sub(self, left: T, right: T, /) -> T: ...
    def mul(self, left: T, right: T, /) -> T: ...
    def neg(self, value: T, /) -> T: ...
    def half(self, value: T, /) -> T: ...

    def sum_values(self, values: Iterable[T]) -> T:
        """Return the sum of `values`, from left to right."""
        result = self.zero
        for value in values:
            result = self.add(result, value)
        return result

    def add_vectors(self, first: Vector[T], *others: Vector[T]) -> Vector[T]:
        """Return the sum, from left to right."""
        x, y, z = first
        for a, b, c in others:
            x, y, z = self.add(x, a), self.add(y, b), self.add(z, c)
        return x, y, z

    def scale_vector(self, factor: T, vector: Vector[T]) -> Vector[T]:
        """Return factor * vector."""
        return (self.mul(factor, vector[0]), self.mul(factor, vector[1]), self.mul(factor, vector[2]))

    def dot(self, left: Vector[T], right: Vector[T]) -> T:
        """Return the scalar product."""
        x, y, z = map(self.mul, left, right)
        return self.add(self.add(x, y), z)

    def cross(self, left: Vector[T], right: Vector[T]) -> Vector[T]:
        """Return left x right."""
        a, b = left, right
        mul, minus = self.mul, self.sub
        return (
            minus(mul(a[1], b[2]), mul(a[2], b[1])),
            minus(mul(a[2], b[0]), mul(a[0], b[2])),
            minus(mul(a[0], b[1]), mul(a[1], b[0])),
        )

    def apply_matrix(self, matrix: Matrix[T], vector: Vector[T]) -> Vector[T]:
        """Return matrix * vector."""
        return self.dot(matrix[0], vector), self.dot(matrix[1], vector), self.dot(matrix[2], vector)

    def multiply_matrices(self, left: Matrix[T], right: Matrix[T]) -> Matrix[T]:
        """Return left * right."""
        x, y, z = transpose(right)
        apply = self.apply_matrix
        return transpose((apply(left, x), apply(left, y), apply(left, z)))


class OperatorAlgebra(Algebra[Any]):
    """The operations of a carrier whose numbers have the usual operators."""

    add: Any = staticmethod(operator.add)
    sub: Any = staticmethod(operator.sub)
    mul: Any = staticmethod(operator.mul)
    neg: Any = staticmethod(operator.neg)


@dataclass(frozen=True, slots=True)
class FloatAlgebra(OperatorAlgebra):
    """Doubles, or arrays of them, many states at once; `symbols` has the values of symbolic lengths in m."""

    symbols: Mapping[str, float] = field(default_factory=dict)
    zero, one = 0.0, 1.0

    def constant(self, value: Exact) -> float:
        return value.to_float(self.symbols)

    def half(self, value: Any) -> Any:  # noqa: ANN401 - a double or an array
        return 0.5 * value


@dataclass(frozen=True, slots=True)
class RobotState(Generic[T]):
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


def spread_coordinates(robot: Robot, algebra: Algebra[T], values: Sequence[T]) -> tuple[T, ...]:
    """Return the value of every joint, and then every coupling, from the `values` of the coordinates."""
    return tuple(
        algebra.sum_values(algebra.mul(algebra.constant(Exact.of(factor)), values[k]) for k, factor in row)
        for row in robot.transmission
    )


def build_state(robot: Robot, algebra: Algebra[T], values: Mapping[str, T]) -> RobotState[T]:
    """Return the state of the joints from {s1: .., c1: .., q1: .., dq1: .., ddq1: ..}; missing ones are zero.

    Joints that follow another have their own s and c, or q, with s^2 + c^2 = 1; their rates follow.
    """

    def take(prefix: str, joints: Iterable[int]) -> tuple[T, ...]:
        return tuple(values.get(f"{prefix}{joint + 1}", algebra.zero) for joint in joints)

    sine, cosine, position = (take(prefix, range(robot.size)) for prefix in ("s", "c", "q"))
    velocity, acceleration = (
        spread_coordinates(robot, algebra, take(prefix, robot.coordinates))[: robot.size]
        for prefix in ("dq", "ddq")
    )
    return RobotState(sine, cosine, position, velocity, acceleration)
