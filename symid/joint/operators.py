"""The four rules of arithmetic of a carrier whose numbers have the operators + - * /.

Input: numbers of one kind. Output: numbers of that kind. Carriers of joint models add functions.

Supported: floats, fractions, mpmath, arrays, expressions of SymPy and CasADi.
Not supported: numbers without operators, such as values of generated code; they are carriers of their own.
"""

import operator
from typing import Generic, TypeVar

__all__ = ["Operators"]

V = TypeVar("V")


class Operators(Generic[V]):
    """Sum, difference, product, quotient and multiple by the numbers' own operators."""

    __slots__ = ()

    def add(self, left: V, right: V) -> V:
        """Return left + right."""
        result: V = operator.add(left, right)
        return result

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""
        result: V = operator.sub(left, right)
        return result

    def mul(self, left: V, right: V) -> V:
        """Return left * right."""
        result: V = operator.mul(left, right)
        return result

    def div(self, left: V, right: V) -> V:
        """Return left / right."""
        result: V = operator.truediv(left, right)
        return result

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""
        result: V = operator.mul(factor, value)
        return result
