"""Friction laws in LaTeX: the columns of a law, written over a carrier of phrases.

Supported: every static law, and of laws with a state the curve of steady sliding.
Not supported: brackets that a reader could do without, other than those of products and powers.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

from symid.joint_models import FrictionLaw, OperatorCarrier

_SUM, _PRODUCT, _ATOM = range(3)

_INPUTS = {"velocity": r"\dot q", "load": r"\tau_l", "position": "q", "temperature": "T"}


@dataclass(frozen=True, slots=True)
class Phrase:
    """A piece of LaTeX and how tightly it holds together: sum, product or atom."""

    text: str
    rank: int = _ATOM

    def wrap(self, rank: int) -> str:
        """Return the text, in parentheses where it holds less tightly than `rank`."""
        return self.text if self.rank >= rank else rf"\left({self.text}\right)"

    def __add__(self, other: "Phrase") -> "Phrase":
        joint = " - " if other.text.startswith("-") else " + "
        return Phrase(self.text + joint + other.text.removeprefix("-"), _SUM)

    def __sub__(self, other: "Phrase") -> "Phrase":
        return Phrase(f"{self.text} - {other.wrap(_PRODUCT)}", _SUM)

    def __mul__(self, other: "Phrase") -> "Phrase":
        if "1" in {self.text, other.text}:
            return other if self.text == "1" else self
        if self == other:
            return Phrase(f"{self.wrap(_ATOM)}^2", _PRODUCT)
        return Phrase(rf"{self.wrap(_PRODUCT)} \, {other.wrap(_PRODUCT)}", _PRODUCT)

    def __truediv__(self, other: "Phrase") -> "Phrase":
        return Phrase(rf"\frac{{{self.text}}}{{{other.text}}}", _PRODUCT)

    def __abs__(self) -> "Phrase":
        return Phrase(rf"\left|{self.text}\right|")

    def __pow__(self, other: "Phrase") -> "Phrase":
        return Phrase(f"{self.wrap(_ATOM)}^{{{other.text}}}", _PRODUCT)

    def scale(self, factor: float) -> "Phrase":
        """Return a multiple."""
        if factor == 1.0:
            return self
        if factor == -1.0:
            return Phrase(f"-{self.wrap(_PRODUCT)}", _SUM)
        number = r"\tfrac{1}{2}" if factor == 0.5 else f"{factor:.12g}"
        if self.text == "1":
            return Phrase(number)
        return Phrase(rf"{number} \, {self.wrap(_PRODUCT)}", _PRODUCT)


def write_friction(law: FrictionLaw) -> str:
    """Return the torque of a law as a formula of its physical parameters."""

    def name(function: str) -> Callable[..., Phrase]:
        def apply(*values: Phrase) -> Phrase:
            inner = r",\, ".join(value.text for value in values)
            return Phrase(rf"{function}\left({inner}\right)")

        return apply

    carrier = OperatorCarrier(
        zero=Phrase("0"),
        one=Phrase("1"),
        scale=lambda factor, value: value.scale(factor),
        exp=lambda value: Phrase(f"e^{{{value.text}}}", _PRODUCT),
        tanh=name(r"\tanh"),
        sin=name(r"\sin"),
        cos=name(r"\cos"),
        sign=name(r"\operatorname{sgn}"),
        maximum=name(r"\max"),
        minimum=name(r"\min"),
    )
    inputs = {name: Phrase(_INPUTS[name]) for name in law.inputs}
    columns = law.columns(carrier, inputs, [Phrase(parameter.latex) for parameter in law.shape])
    terms = list[Phrase]()
    for row, column in zip(law.unmixing, columns, strict=False):
        # A linear parameter is a sum of physical ones, those that are added first.
        parts = [(factor, p.latex) for factor, p in zip(row, law.physical, strict=True) if factor]
        parts.sort(key=lambda part: -part[0])
        text = " ".join(f"{'+' if factor > 0 else '-'} {latex}" for factor, latex in parts)
        terms.append(Phrase(text.removeprefix("+ "), _ATOM if len(parts) == 1 else _SUM) * column)
    return reduce(Phrase.__add__, terms).text
