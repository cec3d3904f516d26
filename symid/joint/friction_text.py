"""Friction laws in LaTeX: text as a carrier, so that what is printed is what is computed.

Input: a law. Output: LaTeX of its torque in the physical parameters.

Supported: every static law, smoothed ones too.
Not supported: rearrangement; terms stand as they are computed.
"""

from dataclasses import dataclass

from symid.joint.friction_law import FrictionLaw

__all__ = ["LatexCarrier", "Phrase", "write_latex"]

_SUM, _PRODUCT, _ATOM = range(3)

_INPUTS = {"velocity": r"\dot q", "load": r"\tau_l", "position": "q"}


@dataclass(frozen=True, slots=True)
class Phrase:
    """A piece of LaTeX and how tightly it holds together: sum, product or atom."""

    text: str
    rank: int = _ATOM

    def wrap(self, rank: int) -> str:
        """Return the text, in parentheses where it holds less tightly than `rank`."""
        return self.text if self.rank >= rank else rf"\left({self.text}\right)"


@dataclass(frozen=True, slots=True)
class LatexCarrier:
    """LaTeX as the carrier of friction laws."""

    @property
    def zero(self) -> Phrase:
        """Return zero."""
        return Phrase("0")

    @property
    def one(self) -> Phrase:
        """Return one."""
        return Phrase("1")

    def add(self, left: Phrase, right: Phrase) -> Phrase:
        """Return left + right."""
        joint = " - " if right.text.startswith("-") else " + "
        return Phrase(left.text + joint + right.text.removeprefix("-"), _SUM)

    def sub(self, left: Phrase, right: Phrase) -> Phrase:
        """Return left - right."""
        return Phrase(f"{left.text} - {right.wrap(_PRODUCT)}", _SUM)

    def mul(self, left: Phrase, right: Phrase) -> Phrase:
        """Return left * right, a power where both are the same."""
        if left.text == "1":
            return right
        if right.text == "1":
            return left
        if left == right:
            return Phrase(f"{left.wrap(_ATOM)}^2", _PRODUCT)
        return Phrase(rf"{left.wrap(_PRODUCT)} \, {right.wrap(_PRODUCT)}", _PRODUCT)

    def div(self, left: Phrase, right: Phrase) -> Phrase:
        """Return left / right."""
        return Phrase(rf"\frac{{{left.text}}}{{{right.text}}}", _PRODUCT)

    def scale(self, factor: float, value: Phrase) -> Phrase:
        """Return factor * value."""
        if factor == 1.0:
            return value
        if factor == -1.0:
            return Phrase(f"-{value.wrap(_PRODUCT)}", _SUM)
        number = r"\tfrac{1}{2}" if factor == 0.5 else f"{factor:.12g}"
        if value.text == "1":
            return Phrase(number)
        return Phrase(rf"{number} \, {value.wrap(_PRODUCT)}", _PRODUCT)

    def exp(self, value: Phrase) -> Phrase:
        """Return the exponential."""
        return Phrase(f"e^{{{value.text}}}", _PRODUCT)

    def tanh(self, value: Phrase) -> Phrase:
        """Return the hyperbolic tangent."""
        return Phrase(rf"\tanh\left({value.text}\right)")

    def sin(self, value: Phrase) -> Phrase:
        """Return the sine."""
        return Phrase(rf"\sin\left({value.text}\right)")

    def cos(self, value: Phrase) -> Phrase:
        """Return the cosine."""
        return Phrase(rf"\cos\left({value.text}\right)")

    def sign(self, value: Phrase) -> Phrase:
        """Return the sign."""
        return Phrase(rf"\operatorname{{sgn}}\left({value.text}\right)")

    def absolute(self, value: Phrase) -> Phrase:
        """Return |value|."""
        return Phrase(rf"\left|{value.text}\right|")

    def maximum(self, left: Phrase, right: Phrase) -> Phrase:
        """Return the greater of two."""
        return Phrase(rf"\max\left({left.text},\, {right.text}\right)")

    def minimum(self, left: Phrase, right: Phrase) -> Phrase:
        """Return the smaller of two."""
        return Phrase(rf"\min\left({left.text},\, {right.text}\right)")

    def power(self, base: Phrase, exponent: Phrase) -> Phrase:
        """Return base^exponent."""
        return Phrase(f"{base.wrap(_ATOM)}^{{{exponent.text}}}", _PRODUCT)


def write_latex(law: FrictionLaw) -> str:
    """Return the law as an equation for tau_f in its physical parameters."""
    carrier = LatexCarrier()
    inputs = {name: Phrase(_INPUTS[name]) for name in law.inputs}
    shape = [Phrase(parameter.latex) for parameter in law.shape]
    total: Phrase | None = None
    for row, column in zip(law.unmixing, law.columns(carrier, inputs, shape), strict=False):
        coefficient = _write_coefficient(law, row)
        term = carrier.mul(coefficient, column)
        total = term if total is None else carrier.add(total, term)
    return rf"\tau_f = {total.text if total else '0'}"


def _write_coefficient(law: FrictionLaw, row: tuple[int, ...]) -> Phrase:
    """Return a linear parameter as a sum of physical ones, those that are added first."""
    pairs = [(factor, parameter.latex) for factor, parameter in zip(row, law.physical, strict=True) if factor]
    pairs.sort(key=lambda pair: -pair[0])
    text = " ".join(f"{'+' if factor > 0 else '-'} {latex}" for factor, latex in pairs).removeprefix("+ ")
    return Phrase(text, _ATOM if len(pairs) == 1 else _SUM)
