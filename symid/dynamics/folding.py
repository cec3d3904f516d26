"""From the joints to the coordinates: joints that follow another one act on its coordinate.

Input: what the recursion gives for every joint of the tree. Output: the same for every coordinate.

With the speeds of the joints dq_joint = G dq, torques, momenta and dL/dq fold as G' tau, matrices as
G' M G, Jacobians as J G. Without followers G is the unit matrix and nothing changes.

Supported: everything that has an entry a joint.
"""

from collections.abc import Sequence
from fractions import Fraction

from symid.algebra.scalar import Algebra, T
from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = ["fold_matrix", "fold_rows", "fold_vector"]


def fold_vector(robot: Robot, algebra: Algebra[T], values: Sequence[T]) -> tuple[T, ...]:
    """Return the value of every coordinate: the sum over its joints of multiplier * value."""
    result = [algebra.zero] * robot.freedom
    for value, row in zip(values, robot.transmission, strict=False):  # couplings have no entry here
        for position, factor in row:
            share = value if factor == Fraction(1) else algebra.mul(algebra.constant(Exact.of(factor)), value)
            result[position] = algebra.add(result[position], share)
    return tuple(result)


def fold_rows(robot: Robot, algebra: Algebra[T], rows: Sequence[Sequence[T]]) -> tuple[tuple[T, ...], ...]:
    """Return every row with an entry a coordinate instead of one a joint."""
    return tuple(fold_vector(robot, algebra, row) for row in rows)


def fold_matrix(
    robot: Robot, algebra: Algebra[T], matrix: Sequence[Sequence[T]]
) -> tuple[tuple[T, ...], ...]:
    """Return G' M G of a matrix with a row and a column a joint."""
    half = fold_rows(robot, algebra, matrix)
    columns = fold_rows(robot, algebra, tuple(zip(*half, strict=True)))
    return tuple(zip(*columns, strict=True))
