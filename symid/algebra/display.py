"""The display carrier: exact polynomials as text and LaTeX for people.

Input: polynomials of the exact algebra. Output: sums with the letters of `notation`, long ones cut
with the number of terms that are not shown, never silently.
"""

import re

from sympy import Symbol, latex
from sympy.polys.rings import PolyElement

__all__ = ["write_latex", "write_text"]

_LETTERS = {"ddq": r"\ddot q", "dq": r"\dot q", "q": "q", "s": "s", "c": "c"}
_COORDINATE = re.compile(r"^(ddq|dq|q|s|c)(\d+)$")


def _cut(value: PolyElement, most: int) -> tuple[PolyElement, int]:
    """Return the leading `most` terms and the number of terms left out."""
    terms = value.terms()
    left_out = max(0, len(terms) - most)
    return value.ring.from_dict(dict(terms[:most])), left_out


def write_text(value: PolyElement, *, most: int = 12) -> str:
    """Return `value` as a plain sum; at most `most` terms, then how many more there are."""
    shown, left_out = _cut(value, most)
    text = str(shown.as_expr()).replace("**", "^")
    return f"{text} + ({left_out} more terms)" if left_out else text


def write_latex(value: PolyElement, *, most: int = 12) -> str:
    """Return `value` in LaTeX; at most `most` terms, then how many more there are."""
    shown, left_out = _cut(value, most)
    names: dict[Symbol, str] = {}
    for symbol in value.ring.symbols:
        if match := _COORDINATE.match(str(symbol)):
            names[symbol] = f"{_LETTERS[match[1]]}_{{{match[2]}}}"
    text = str(latex(shown.as_expr(), symbol_names=names))
    return rf"{text} + (\text{{{left_out} more terms}})" if left_out else text
