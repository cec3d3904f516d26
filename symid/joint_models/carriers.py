# ruff: noqa: D102 - operations are named as what they are

"""Kinds of numbers that joint models are evaluated on: one protocol, and its carriers.

A friction law or a spring is written once over a `Carrier`; what the carrier is decides whether floats,
arrays, formulas or code come out. `Dual` numbers are arrays with their derivatives by s variables, exact
after every operation, one-sided at kinks (zero velocity, the edge of a zone).

Supported: floats, fractions, mpmath, arrays, expressions of SymPy and CasADi; dual numbers over arrays.
Not supported: second derivatives.
"""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray

V = TypeVar("V")


class Carrier(Protocol[V]):
    """What joint models may use of their numbers; powers have a base >= 0 and an exponent > 0."""

    @property
    def zero(self) -> V: ...
    @property
    def one(self) -> V: ...
    def add(self, left: V, right: V, /) -> V: ...
    def sub(self, left: V, right: V, /) -> V: ...
    def mul(self, left: V, right: V, /) -> V: ...
    def div(self, left: V, right: V, /) -> V: ...
    def scale(self, factor: float, value: V, /) -> V: ...
    def exp(self, value: V, /) -> V: ...
    def tanh(self, value: V, /) -> V: ...
    def sin(self, value: V, /) -> V: ...
    def cos(self, value: V, /) -> V: ...
    def sign(self, value: V, /) -> V: ...
    def absolute(self, value: V, /) -> V: ...
    def maximum(self, left: V, right: V, /) -> V: ...
    def minimum(self, left: V, right: V, /) -> V: ...
    def power(self, base: V, exponent: V, /) -> V: ...


def _refuse(*_values: object) -> Any:  # noqa: ANN401 - in place of any function
    message = "this carrier has no such function"
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


def _read_functions(module: Any) -> dict[str, Any]:  # noqa: ANN401 - numpy, sympy or casadi
    return {name: getattr(module, name) for name in ("exp", "tanh", "sin", "cos", "sign")}


def build_numpy_carrier() -> OperatorCarrier[FloatArray]:
    """Return the carrier of NumPy arrays, which may have any shapes that broadcast."""
    return OperatorCarrier(
        zero=np.zeros(()),
        one=np.ones(()),
        absolute=np.abs,
        maximum=np.maximum,
        minimum=np.minimum,
        power=np.power,
        **_read_functions(np),
    )


def build_symbol_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of SymPy expressions."""
    import sympy

    return OperatorCarrier(
        zero=sympy.Integer(0),
        one=sympy.Integer(1),
        absolute=sympy.Abs,
        maximum=sympy.Max,
        minimum=sympy.Min,
        **_read_functions(sympy),
    )


_TINY = 1e-100


def build_casadi_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of CasADi expressions."""
    import casadi

    return OperatorCarrier(
        zero=casadi.SX(0.0),
        one=casadi.SX(1.0),
        absolute=casadi.fabs,
        maximum=casadi.fmax,
        minimum=casadi.fmin,
        # At zero, derivatives would hold its logarithm and negative powers, although they vanish.
        power=lambda base, exponent: casadi.fmax(base, _TINY) ** exponent,
        **_read_functions(casadi),
    )


@dataclass(frozen=True, slots=True)
class Dual:
    """A value (N,) or scalar and its derivatives, one a variable."""

    value: FloatArray
    rates: tuple[FloatArray, ...]

    def __add__(self, other: "Dual") -> "Dual":
        pairs = zip(self.rates, other.rates, strict=True)
        return Dual(self.value + other.value, tuple(a + b for a, b in pairs))

    def __sub__(self, other: "Dual") -> "Dual":
        pairs = zip(self.rates, other.rates, strict=True)
        return Dual(self.value - other.value, tuple(a - b for a, b in pairs))

    def __mul__(self, other: "Dual") -> "Dual":
        pairs = zip(self.rates, other.rates, strict=True)
        rates = tuple(a * other.value + self.value * b for a, b in pairs)
        return Dual(self.value * other.value, rates)

    def __truediv__(self, other: "Dual") -> "Dual":
        value = self.value / other.value
        pairs = zip(self.rates, other.rates, strict=True)
        return Dual(value, tuple((a - value * b) / other.value for a, b in pairs))

    def __abs__(self) -> "Dual":
        return self.apply(np.abs(self.value), np.sign(self.value))

    def __pow__(self, other: "Dual") -> "Dual":
        # The derivative by a base of 0 may be infinite (exponent below one); no torque depends on it.
        result, positive = np.power(self.value, other.value), self.value > 0.0
        safe = np.where(positive, self.value, 1.0)
        by_base = np.where(positive, other.value * result / safe, 0.0)
        by_exponent = np.where(positive, result * np.log(safe), 0.0)
        pairs = zip(self.rates, other.rates, strict=True)
        return Dual(result, tuple(by_base * a + by_exponent * b for a, b in pairs))

    def apply(self, result: FloatArray, slope: FloatArray | float) -> "Dual":
        """Return the function of this number that has this value and slope (chain rule)."""
        return Dual(result, tuple(slope * rate for rate in self.rates))

    def choose(self, other: "Dual", condition: NDArray[np.bool_]) -> "Dual":
        """Return this number where the condition holds, the other one elsewhere."""
        pairs = zip(self.rates, other.rates, strict=True)
        rates = tuple(np.where(condition, a, b) for a, b in pairs)
        return Dual(np.where(condition, self.value, other.value), rates)


def lift_dual(value: FloatArray | float, size: int, own: int | None = None) -> Dual:
    """Return a number that depends on none of `size` variables, or is the variable number `own`."""
    return Dual(np.asarray(value, dtype=np.float64), tuple(np.array(float(k == own)) for k in range(size)))


def build_dual_carrier(size: int) -> OperatorCarrier[Dual]:
    """Return the carrier of dual numbers of `size` variables."""

    def tanh(value: Dual) -> Dual:
        result = np.tanh(value.value)
        return value.apply(result, 1.0 - result * result)

    return OperatorCarrier(
        zero=lift_dual(0.0, size),
        one=lift_dual(1.0, size),
        scale=lambda factor, x: x.apply(factor * x.value, factor),
        exp=lambda x: x.apply(np.exp(x.value), np.exp(x.value)),
        tanh=tanh,
        sin=lambda x: x.apply(np.sin(x.value), np.cos(x.value)),
        cos=lambda x: x.apply(np.cos(x.value), -np.sin(x.value)),
        sign=lambda x: lift_dual(np.sign(x.value), size),
        maximum=lambda x, y: x.choose(y, x.value > y.value),
        minimum=lambda x, y: x.choose(y, x.value < y.value),
    )
