"""Matrices of transmissions in which a motor moves more than one joint.

Input: the rows of a matrix T, angles of the motors = T (angles of the joints). Output: its condition.

Supported: matrices of any units: rows and columns are scaled to one before.
"""

from collections.abc import Sequence
from fractions import Fraction

__all__ = ["Matrix", "find_condition"]

Matrix = tuple[tuple[float, ...], ...]


def find_condition(rows: Matrix) -> float | None:
    """Return |T| |T^-1| (row sums) of the matrix, rows and then columns scaled to one; None if singular."""
    largest = [max(map(abs, row)) for row in rows]
    if not all(largest):
        return None
    scaled = [[entry / size for entry in row] for row, size in zip(rows, largest, strict=True)]
    sizes = [max(map(abs, column)) for column in zip(*scaled, strict=True)]
    if not all(sizes):
        return None
    scaled = [[entry / size for entry, size in zip(row, sizes, strict=True)] for row in scaled]
    inverse = _invert([[Fraction(entry) for entry in row] for row in scaled])
    if inverse is None:
        return None
    return _find_row_sum(scaled) * _find_row_sum([[float(entry) for entry in row] for row in inverse])


def _find_row_sum(rows: Sequence[Sequence[float]]) -> float:
    return max(sum(map(abs, row)) for row in rows)


def _invert(rows: list[list[Fraction]]) -> list[list[Fraction]] | None:
    """Return the inverse by exact elimination, None if there is none."""
    size = len(rows)
    whole = [[*row, *(Fraction(int(i == k)) for k in range(size))] for i, row in enumerate(rows)]
    for step in range(size):
        pivot = next((row for row in range(step, size) if whole[row][step]), None)
        if pivot is None:
            return None
        whole[step], whole[pivot] = whole[pivot], whole[step]
        whole[step] = [entry / whole[step][step] for entry in whole[step]]
        for row in range(size):
            factor = whole[row][step]
            if row != step and factor:
                whole[row] = [
                    entry - factor * other for entry, other in zip(whole[row], whole[step], strict=True)
                ]
    return [row[size:] for row in whole]
