"""Equations condensed: what least squares needs of millions of rows, in one triangle a group.

Input: rows, all at once or block by block. Output: `Condensed`, `CondensedSolution`.

    [A_g y_g] = Q_g F_g,  so that  |A_g x - y_g| = |F_g [x; -1]|  for every x

By Householder transformations, block after block: the factor so far is put on top of the next block
and factorised again. The normal equations, which square the condition number, are never formed.

Supported: any number of rows; columns that are zero in a group cost nothing.
Not supported: losses other than squares, and residuals row by row: both need the rows.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.rows.rows import Rows

__all__ = [
    "BLOCK",
    "Condensed",
    "CondensedSolution",
    "condense_rows",
    "condense_weighted",
    "extend_triangle",
    "find_square_sums",
    "solve_condensed",
    "stack_condensed",
]

BLOCK = 4096
"""Rows that are factorised at once: a block and its factor stay in the cache of a core."""
_KNOWN: WeakKeyDictionary[Rows, "Condensed"] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Condensed:
    """The triangles of groups of rows.

    Args:
        factors: (g, p + 1, p + 1) upper triangles F of [A y], rows scaled by the root of their weight.
        counts: (g,) rows of each group.
        independent: rows of independent noise that the rows are worth, as a fraction of them.
    """

    factors: FloatArray
    counts: NDArray[np.intp]
    independent: float = 1.0

    @property
    def parameters(self) -> int:
        """Return the number p of parameters."""
        return int(self.factors.shape[2]) - 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CondensedSolution:
    """The least-squares solution of condensed rows.

    Args:
        values: (p,); root: (p, r) such that the covariance is the noise's variance times root root'.
        square: sum of the weighted squares that remain.
        condition: of the column-scaled matrix, weighted.
    """

    values: FloatArray
    root: FloatArray
    square: float
    condition: float


def extend_triangle(triangle: FloatArray, blocks: Iterable[FloatArray]) -> FloatArray:
    """Return the triangle (k, k) of all rows that it stands for and those of `blocks` (m, k).

    Columns without any entry are left out of the work. The input is not changed.
    """
    size = triangle.shape[1]
    upper = triangle[triangle.any(axis=1)]
    for block in blocks:
        live = block.any(axis=0) | upper.any(axis=0)
        stacked = np.vstack([upper[:, live], block[:, live]])
        reduced = np.linalg.qr(stacked, mode="r")
        upper = np.zeros((len(reduced), size))
        upper[:, live] = reduced
    full = np.zeros((size, size))
    full[: len(upper)] = upper
    return full


def condense_rows(rows: Rows) -> Condensed:
    """Return the triangles of the rows' groups; the same rows are factorised once."""
    found = _KNOWN.get(rows)
    if found is None:
        found = _KNOWN[rows] = condense_weighted(rows, rows.weight)
    return found


def condense_weighted(rows: Rows, weight: FloatArray) -> Condensed:
    """Return the triangles of the groups with `weight` (m,) in place of the rows' own; 0 leaves a row out."""
    groups, size = len(rows.group_names), rows.matrix.shape[1] + 1
    factors = np.zeros((groups, size, size))
    counts = np.zeros(groups, dtype=np.intp)
    root = None if np.all(weight == 1.0) else np.sqrt(weight)
    for index in range(groups):
        members = _find_members(rows, index)
        part = None if root is None else root[members]
        counts[index] = len(rows.values[members]) if part is None else np.count_nonzero(part)
        factors[index] = extend_triangle(factors[index], _cut_blocks(rows, members, part))
    return Condensed(factors=freeze(factors), counts=counts, independent=rows.independent)


def _find_members(rows: Rows, index: int) -> slice | NDArray[np.intp]:
    """Return where the rows of a group stand: a slice where they stand together, so that none is copied."""
    members = np.flatnonzero(rows.group == index)
    if len(members) and members[-1] - members[0] + 1 == len(members):
        return slice(int(members[0]), int(members[-1]) + 1)
    return members


def _cut_blocks(
    rows: Rows, members: slice | NDArray[np.intp], root: FloatArray | None
) -> Iterable[FloatArray]:
    matrix, values = rows.matrix[members], rows.values[members]
    for start in range(0, len(values), BLOCK):
        part = slice(start, start + BLOCK)
        block = np.column_stack([matrix[part], values[part]])
        yield block if root is None else block * root[part, None]


def stack_condensed(condensed: Condensed, weights: FloatArray) -> FloatArray:
    """Return one triangle (p + 1, p + 1) of all groups, group g times weights[g]."""
    whole = (condensed.factors * np.asarray(weights)[:, None, None]).reshape(-1, condensed.factors.shape[2])
    return extend_triangle(np.zeros((0, whole.shape[1])), [whole])


def find_square_sums(condensed: Condensed, values: FloatArray) -> FloatArray:
    """Return |A_g x - y_g|^2 of every group for parameters x (p,): (g,), in the rows' units."""
    errors = condensed.factors @ np.append(values, -1.0)
    sums: FloatArray = np.sum(errors**2, axis=1)
    return sums


def solve_condensed(condensed: Condensed, basis: FloatArray, weights: FloatArray) -> CondensedSolution:
    """Return the least-squares solution in the span of `basis`.

    Args:
        condensed: the equations.
        basis: (p, r) directions that the rows see.
        weights: (g,) what residuals of each group are multiplied by.
    """
    triangle = stack_condensed(condensed, weights)
    count = int(basis.shape[1])
    matrix, target = triangle[:, :-1], triangle[:, -1]
    factor: FloatArray = np.asarray(np.linalg.qr(np.column_stack([matrix @ basis, target]), mode="r"))
    left, singular, right = np.linalg.svd(factor[:count, :count])
    values: FloatArray = basis @ (right.T @ ((left.T @ factor[:count, count]) / singular))
    return CondensedSolution(
        values=values,
        root=basis @ (right.T / singular),
        square=float(np.sum((matrix @ values - target) ** 2)),
        condition=_find_condition(matrix[:, basis.any(axis=1)], count),
    )


def _find_condition(matrix: FloatArray, count: int) -> float:
    """Return the ratio of the first to the last of `count` singular values, columns scaled to length one."""
    lengths = np.linalg.norm(matrix, axis=0)
    singular = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0), compute_uv=False)
    return float(singular[0] / singular[count - 1])
