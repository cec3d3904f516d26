"""Tables of numbers as lines of C.

Input: numbers. Output: lines of literals that read back as the same numbers.
"""

from collections.abc import Sequence

from symid.codegen.printing import find_literal

__all__ = ["write_lines"]

_PER_LINE = 5


def write_lines(values: Sequence[float], real: str) -> tuple[str, ...]:
    """Return an initialiser's lines; without values it holds a zero, as an empty one is no C."""
    literals = [find_literal(value, real) for value in values] or [find_literal(0.0, real)]
    starts = range(0, len(literals), _PER_LINE)
    return tuple(", ".join(literals[k : k + _PER_LINE]) + "," for k in starts)
