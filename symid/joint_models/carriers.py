# ruff: noqa: D102 - operations are named as what they are

"""Kinds of numbers that joint models are evaluated on: one protocol, and its carriers.

A friction law or a spring is written once over a `Carrier`; what the carrier is decides whether floats,
arrays, formulas or code come out. Complex arrays give derivatives, exact to rounding, one-sided at kinks
(zero velocity, the edge of a zone): Squire and Trapp, SIAM Review 40 (1998) 110-112.

Supported: floats, fractions, mpmath, arrays, complex ones too, expressions of SymPy and CasADi.
Not supported: second derivatives.
"""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

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

    def sign(value: float) -> float:
        return math.copysign(1.0, value) if value else 0.0

    others = {name: getattr(math, name) for name in ("exp", "tanh", "sin", "cos")}
    return OperatorCarrier(zero=0.0, one=1.0, sign=sign, maximum=max, minimum=min, power=math.pow, **others)


_FUNCTIONS = ("exp", "tanh", "sin", "cos", "sign")
_ARRAYS: Mapping[str, Any] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "scale": np.multiply,
}
"""Operators, called on entries of a tuple, write into a large array that nothing else holds; these do not."""


def _read_functions(module: Any, *bounds: str) -> dict[str, Any]:  # noqa: ANN401 - numpy, sympy or casadi
    """Return the functions of a module, `bounds` its names of |x|, the larger and the smaller of two."""
    pairs = zip(("absolute", "maximum", "minimum"), bounds, strict=False)
    names = {name: name for name in _FUNCTIONS} | dict(pairs)
    return {name: getattr(module, own) for name, own in names.items()}


def build_numpy_carrier() -> OperatorCarrier[FloatArray]:
    """Return the carrier of NumPy arrays, which may have any shapes that broadcast."""
    functions = _read_functions(np, "abs", "maximum", "minimum")
    return OperatorCarrier(zero=np.zeros(()), one=np.ones(()), power=np.power, **_ARRAYS, **functions)


def build_symbol_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of SymPy expressions."""
    import sympy

    functions = _read_functions(sympy, "Abs", "Max", "Min")
    return OperatorCarrier(zero=sympy.Integer(0), one=sympy.Integer(1), **functions)


_TINY = 1e-100


def build_casadi_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of CasADi expressions."""
    import casadi

    return OperatorCarrier(
        zero=casadi.SX(0.0),
        one=casadi.SX(1.0),
        # At zero, derivatives would hold its logarithm and negative powers, although they vanish.
        power=lambda base, exponent: casadi.fmax(base, _TINY) ** exponent,
        **_read_functions(casadi, "fabs", "fmax", "fmin"),
    )


def build_complex_carrier() -> OperatorCarrier[Any]:
    """Return the carrier of complex arrays: kinks are those of the real parts, slopes there those of rest."""
    return OperatorCarrier(
        zero=np.zeros(()),
        one=np.ones(()),
        absolute=lambda x: x * np.sign(np.real(x)),
        maximum=lambda x, y: np.where(np.real(x) > np.real(y), x, y),
        minimum=lambda x, y: np.where(np.real(x) < np.real(y), x, y),
        # The derivative by a base of 0 may be infinite (exponent below one); no torque depends on it.
        power=lambda base, exponent: np.power(np.where(np.real(base) == 0.0, _TINY**3, base), exponent),
        **_ARRAYS,
        **_read_functions(np) | {"sign": lambda x: np.sign(np.real(x))},
    )
