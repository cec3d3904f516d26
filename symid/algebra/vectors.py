"""Vectors, rotations and symmetric matrices over any scalar algebra.

Input and output: tuples of scalars. A vector is (x, y, z); a matrix a tuple of three rows.
"""

from collections.abc import Sequence

from symid.algebra.scalar import Algebra, T

__all__ = [
    "Matrix",
    "Vector",
    "add",
    "cross",
    "dot",
    "multiply",
    "multiply_matrices",
    "scale",
    "sub",
    "total",
    "transpose",
]

Vector = tuple[T, T, T]
Matrix = tuple[tuple[T, T, T], tuple[T, T, T], tuple[T, T, T]]


def total(algebra: Algebra[T], values: Sequence[T]) -> T:
    """Return the sum of `values`, from left to right."""
    result = algebra.zero
    for value in values:
        result = algebra.add(result, value)
    return result


def add(algebra: Algebra[T], left: Vector[T], right: Vector[T]) -> Vector[T]:
    """Return left + right."""
    return (algebra.add(left[0], right[0]), algebra.add(left[1], right[1]), algebra.add(left[2], right[2]))


def sub(algebra: Algebra[T], left: Vector[T], right: Vector[T]) -> Vector[T]:
    """Return left - right."""
    return (algebra.sub(left[0], right[0]), algebra.sub(left[1], right[1]), algebra.sub(left[2], right[2]))


def scale(algebra: Algebra[T], factor: T, vector: Vector[T]) -> Vector[T]:
    """Return factor * vector."""
    return (algebra.mul(factor, vector[0]), algebra.mul(factor, vector[1]), algebra.mul(factor, vector[2]))


def dot(algebra: Algebra[T], left: Vector[T], right: Vector[T]) -> T:
    """Return the scalar product."""
    return total(algebra, [algebra.mul(a, b) for a, b in zip(left, right, strict=True)])


def cross(algebra: Algebra[T], left: Vector[T], right: Vector[T]) -> Vector[T]:
    """Return left x right."""
    a, b = left, right
    mul, minus = algebra.mul, algebra.sub
    return (
        minus(mul(a[1], b[2]), mul(a[2], b[1])),
        minus(mul(a[2], b[0]), mul(a[0], b[2])),
        minus(mul(a[0], b[1]), mul(a[1], b[0])),
    )


def transpose(matrix: Matrix[T]) -> Matrix[T]:
    """Return the transposed matrix."""
    a, b, c = matrix
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


def multiply(algebra: Algebra[T], matrix: Matrix[T], vector: Vector[T]) -> Vector[T]:
    """Return matrix * vector."""
    x, y, z = (dot(algebra, row, vector) for row in matrix)
    return (x, y, z)


def multiply_matrices(algebra: Algebra[T], left: Matrix[T], right: Matrix[T]) -> Matrix[T]:
    """Return left * right."""
    columns = [multiply(algebra, left, column) for column in transpose(right)]
    return transpose((columns[0], columns[1], columns[2]))
