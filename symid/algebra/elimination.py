"""Exact linear algebra over a field: spans and reduced echelon forms of sparse rows.

Input: rows as {column: coefficient}, coefficients in any field with + - * / and truth value.
Output: rows in reduced row echelon form, in the order of their pivots.
"""

from collections.abc import Iterable, Sequence
from typing import Any

__all__ = ["Echelon", "Row", "reduce_rows"]

Row = dict[int, Any]


def _subtract(row: Row, factor: Any, other: Row) -> None:  # noqa: ANN401  a field element has no type of its own
    for column, value in other.items():
        new = row.get(column, 0) - factor * value
        if new:
            row[column] = new
        else:
            row.pop(column, None)


class Echelon:
    """A growing set of independent rows, kept in reduced row echelon form.

    The only mutable object of the derivation: it lives inside one function call.
    """

    __slots__ = ("_by_pivot",)

    def __init__(self) -> None:
        """Start with no row."""
        self._by_pivot: dict[int, Row] = {}

    def insert(self, row: Row) -> bool:
        """Add `row` to the span; return whether it was independent of the rows before."""
        rest = {column: value for column, value in row.items() if value}
        for column in sorted(rest):
            if column in self._by_pivot and column in rest:
                _subtract(rest, rest[column], self._by_pivot[column])
        if not rest:
            return False
        pivot = min(rest)
        lead = rest[pivot]
        rest = {column: value / lead for column, value in rest.items()}
        for other in self._by_pivot.values():
            if pivot in other:
                _subtract(other, other[pivot], rest)
        self._by_pivot[pivot] = rest
        return True

    @property
    def rows(self) -> tuple[Row, ...]:
        """Return the rows, ordered by pivot."""
        return tuple(dict(sorted(self._by_pivot[pivot].items())) for pivot in sorted(self._by_pivot))

    @property
    def pivots(self) -> tuple[int, ...]:
        """Return the pivot columns in ascending order."""
        return tuple(sorted(self._by_pivot))


def reduce_rows(rows: Iterable[Row] | Sequence[Row]) -> Echelon:
    """Return the reduced row echelon form of `rows`."""
    echelon = Echelon()
    for row in rows:
        echelon.insert(row)
    return echelon
