"""Kinds of numbers that joint models are evaluated on: operators of their own, or dual numbers.

Numbers of one kind -> numbers of the same kind. A friction law or a spring is written once over a carrier;
what the carrier is decides whether floats, arrays, formulas or code come out. `Operators` has the four
rules of arithmetic of numbers with + - * /. `DualFriction` takes arrays together with their derivatives by
s variables and gives both after every operation of a friction law, exactly; at kinks (zero velocity, the
edge of a zone) it takes the derivative from one side.

Supported: floats, fractions, mpmath, arrays, expressions of SymPy and CasADi; dual numbers over arrays.
Not supported: numbers without operators, such as values of generated code, which are carriers of their own;
second derivatives.
"""

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray

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


@dataclass(frozen=True, slots=True)
class Dual:
    """A value (N,) or scalar and its rates, one a variable."""

    value: FloatArray
    rates: tuple[FloatArray, ...]


def build_dual_variables(values: Sequence[float]) -> tuple[Dual, ...]:
    """Return the variables themselves: value k has rate one by variable k and zero by the others."""
    return tuple(
        Dual(np.array(value, dtype=np.float64), tuple(np.array(float(k == j)) for j in range(len(values))))
        for k, value in enumerate(values)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DualFriction:
    """Dual numbers of `size` variables as the carrier of friction laws."""

    size: int

    def lift(self, value: FloatArray | float) -> Dual:
        """Return a value that depends on no variable."""
        return Dual(np.asarray(value, dtype=np.float64), (np.zeros(()),) * self.size)

    @property
    def zero(self) -> Dual:
        """Return zero."""
        return self.lift(0.0)

    @property
    def one(self) -> Dual:
        """Return one."""
        return self.lift(1.0)

    def add(self, left: Dual, right: Dual) -> Dual:
        """Return left + right."""
        pairs = zip(left.rates, right.rates, strict=True)
        return Dual(left.value + right.value, tuple(a + b for a, b in pairs))

    def sub(self, left: Dual, right: Dual) -> Dual:
        """Return left - right."""
        pairs = zip(left.rates, right.rates, strict=True)
        return Dual(left.value - right.value, tuple(a - b for a, b in pairs))

    def mul(self, left: Dual, right: Dual) -> Dual:
        """Return left * right."""
        pairs = zip(left.rates, right.rates, strict=True)
        rates = tuple(a * right.value + left.value * b for a, b in pairs)
        return Dual(left.value * right.value, rates)

    def div(self, left: Dual, right: Dual) -> Dual:
        """Return left / right."""
        value = left.value / right.value
        pairs = zip(left.rates, right.rates, strict=True)
        return Dual(value, tuple((a - value * b) / right.value for a, b in pairs))

    def scale(self, factor: float, value: Dual) -> Dual:
        """Return factor * value."""
        return _apply_chain_rule(value, factor * value.value, np.asarray(factor))

    def exp(self, value: Dual) -> Dual:
        """Return the exponential."""
        result = np.exp(value.value)
        return _apply_chain_rule(value, result, result)

    def tanh(self, value: Dual) -> Dual:
        """Return the hyperbolic tangent."""
        result = np.tanh(value.value)
        return _apply_chain_rule(value, result, 1.0 - result * result)

    def sin(self, value: Dual) -> Dual:
        """Return the sine."""
        return _apply_chain_rule(value, np.sin(value.value), np.cos(value.value))

    def cos(self, value: Dual) -> Dual:
        """Return the cosine."""
        return _apply_chain_rule(value, np.cos(value.value), -np.sin(value.value))

    def sign(self, value: Dual) -> Dual:
        """Return -1, 0 or 1, with no rates."""
        return self.lift(np.sign(value.value))

    def absolute(self, value: Dual) -> Dual:
        """Return |value|."""
        return _apply_chain_rule(value, np.abs(value.value), np.sign(value.value))

    def maximum(self, left: Dual, right: Dual) -> Dual:
        """Return the greater of two; the right one's rates where they are equal."""
        return _choose_dual(left.value > right.value, left, right)

    def minimum(self, left: Dual, right: Dual) -> Dual:
        """Return the smaller of two; the right one's rates where they are equal."""
        return _choose_dual(left.value < right.value, left, right)

    def power(self, base: Dual, exponent: Dual) -> Dual:
        """Return base^exponent for base >= 0 and exponent > 0; at base 0 all rates are zero."""
        result = np.power(base.value, exponent.value)
        # The rate by the base may be infinite at 0 where the exponent is below one: no torque depends on it.
        safe = np.where(base.value > 0.0, base.value, 1.0)
        by_base = np.where(base.value > 0.0, exponent.value * result / safe, 0.0)
        by_exponent = np.where(base.value > 0.0, result * np.log(safe), 0.0)
        pairs = zip(base.rates, exponent.rates, strict=True)
        return Dual(result, tuple(by_base * a + by_exponent * b for a, b in pairs))


def _apply_chain_rule(value: Dual, result: FloatArray, slope: FloatArray) -> Dual:
    return Dual(result, tuple(slope * rate for rate in value.rates))


def _choose_dual(condition: NDArray[np.bool_], left: Dual, right: Dual) -> Dual:
    pairs = zip(left.rates, right.rates, strict=True)
    rates = tuple(np.where(condition, a, b) for a, b in pairs)
    return Dual(np.where(condition, left.value, right.value), rates)
