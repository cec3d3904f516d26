"""Kinds of numbers that joint models are evaluated on: one protocol, and its carriers.

Numbers of one kind -> numbers of the same kind. A friction law or a spring is written once over a `Carrier`;
what the carrier is decides whether floats, arrays, formulas or code come out. `OperatorCarrier` serves
numbers with + - * / of their own, the other functions are given. `DualFriction` takes arrays together with
their derivatives by s variables and gives both after every operation, exactly; at kinks (zero velocity, the
edge of a zone) it takes the derivative from one side.

Supported: floats, fractions, mpmath, arrays, expressions of SymPy and CasADi; dual numbers over arrays.
Elsewhere: LaTeX (`friction_law`), values of generated code (`codegen`).
Not supported: second derivatives.
"""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray

V = TypeVar("V")


class Carrier(Protocol[V]):
    """What joint models may use of their numbers."""

    @property
    def zero(self) -> V:
        """Return zero."""

    @property
    def one(self) -> V:
        """Return one."""

    def add(self, left: V, right: V) -> V:
        """Return left + right."""

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""

    def mul(self, left: V, right: V) -> V:
        """Return left * right."""

    def div(self, left: V, right: V) -> V:
        """Return left / right."""

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""

    def exp(self, value: V) -> V:
        """Return the exponential."""

    def tanh(self, value: V) -> V:
        """Return the hyperbolic tangent."""

    def sin(self, value: V) -> V:
        """Return the sine."""

    def cos(self, value: V) -> V:
        """Return the cosine."""

    def sign(self, value: V) -> V:
        """Return -1, 0 or 1."""

    def absolute(self, value: V) -> V:
        """Return |value|."""

    def maximum(self, left: V, right: V) -> V:
        """Return the greater of two."""

    def minimum(self, left: V, right: V) -> V:
        """Return the smaller of two."""

    def power(self, base: V, exponent: V) -> V:
        """Return base^exponent for base >= 0, exponent > 0."""


def _refuse(*_values: object) -> Any:  # noqa: ANN401 - stands for any function of a carrier
    message = "these numbers have no such function"
    raise TypeError(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorCarrier(Generic[V]):
    """A carrier as functions; those not given are the numbers' own operators, or are refused."""

    zero: V
    one: V
    add: Callable[[V, V], V] = operator.add
    sub: Callable[[V, V], V] = operator.sub
    mul: Callable[[V, V], V] = operator.mul
    div: Callable[[V, V], V] = operator.truediv
    scale: Callable[[float, V], V] = operator.mul
    exp: Callable[[V], V] = _refuse
    tanh: Callable[[V], V] = _refuse
    sin: Callable[[V], V] = _refuse
    cos: Callable[[V], V] = _refuse
    sign: Callable[[V], V] = _refuse
    absolute: Callable[[V], V] = abs  # type: ignore[assignment]  # of numbers that have it
    maximum: Callable[[V, V], V] = _refuse
    minimum: Callable[[V, V], V] = _refuse
    power: Callable[[V, V], V] = operator.pow


def smooth(carrier: Carrier[V], speed: float) -> OperatorCarrier[V]:
    """Return a carrier in which sign(v) is tanh(v / speed): dry friction changes its sign over a speed."""
    members = {field.name: getattr(carrier, field.name) for field in fields(OperatorCarrier)}
    members["sign"] = lambda value: carrier.tanh(carrier.scale(1.0 / speed, value))
    return OperatorCarrier(**members)


def build_float_carrier() -> OperatorCarrier[float]:
    """Return the carrier of Python floats."""
    return OperatorCarrier(
        zero=0.0,
        one=1.0,
        exp=math.exp,
        tanh=math.tanh,
        sin=math.sin,
        cos=math.cos,
        sign=lambda value: math.copysign(1.0, value) if value else 0.0,
        maximum=max,
        minimum=min,
        power=math.pow,
    )


def build_numpy_carrier() -> OperatorCarrier[FloatArray]:
    """Return the carrier of NumPy arrays, which may have any shapes that broadcast."""
    return OperatorCarrier(
        zero=np.zeros(()),
        one=np.ones(()),
        exp=np.exp,
        tanh=np.tanh,
        sin=np.sin,
        cos=np.cos,
        sign=np.sign,
        absolute=np.abs,
        maximum=np.maximum,
        minimum=np.minimum,
        power=np.power,
    )


def build_symbol_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of SymPy expressions."""
    import sympy

    return OperatorCarrier(
        zero=sympy.Integer(0),
        one=sympy.Integer(1),
        exp=sympy.exp,
        tanh=sympy.tanh,
        sin=sympy.sin,
        cos=sympy.cos,
        sign=sympy.sign,
        absolute=sympy.Abs,
        maximum=sympy.Max,
        minimum=sympy.Min,
    )


_TINY = 1e-100


def build_casadi_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of CasADi expressions."""
    import casadi

    return OperatorCarrier(
        zero=casadi.SX(0.0),
        one=casadi.SX(1.0),
        exp=casadi.exp,
        tanh=casadi.tanh,
        sin=casadi.sin,
        cos=casadi.cos,
        sign=casadi.sign,
        absolute=casadi.fabs,
        maximum=casadi.fmax,
        minimum=casadi.fmin,
        # At zero, derivatives would hold its logarithm and negative powers, although they vanish.
        power=lambda base, exponent: casadi.fmax(base, _TINY) ** exponent,
    )


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
