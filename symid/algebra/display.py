"""The display carrier: exact polynomials as text and LaTeX for people.

Input: polynomials of the exact algebra. Output: sums with the letters of `notation`, long ones cut
with the number of terms that are not shown, never silently.
"""

import re

from sympy import Symbol, latex
from sympy.polys.rings import PolyElement

__all__ = ["write_latex", "write_left", "write_text"]

_LETTERS = {"ddq": r"\ddot q", "dq": r"\dot q", "q": "q", "s": "s", "c": "c"}
_COORDINATE = re.compile(r"^(ddq|dq|q|s|c)(\d+)$")
_SLOPE = re.compile(r"^d(T|V|tau)(\d*)/d(\w+)$")
_VELOCITY = re.compile(r"^([wv])(\d+)([xyz])$")
_PARAMETER = re.compile(r"^([A-Za-z]+)(\d+)$")
_MARKED = str.maketrans({character: rf"\{character}" for character in "_%&#$"})


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


def _write_parameter(name: str) -> str:
    """Return a parameter as SymPy prints it: letters, and the number of its joint below."""
    if match := _PARAMETER.match(name):
        return f"{match[1]}_{{{match[2]}}}"
    return rf"\mathit{{{name.translate(_MARKED)}}}"


def write_left(text: str) -> str:
    """Return the left side of a formula in LaTeX: a slope, a velocity, a parameter, or words."""
    if match := _SLOPE.match(text):
        above = rf"\tau_{{{match[2]}}}" if match[1] == "tau" else match[1]
        return rf"\frac{{\partial {above}}}{{\partial {_write_parameter(match[3])}}}"
    if match := _VELOCITY.match(text):
        letter = r"\omega" if match[1] == "w" else "v"
        return rf"{letter}_{{{match[2]},{match[3]}}}"
    return _write_parameter(text) if text.isidentifier() else rf"\text{{{text.translate(_MARKED)}}}"
