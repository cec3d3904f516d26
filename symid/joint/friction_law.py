"""What a static friction law is: columns that are linear in most parameters, written once over any carrier.

Input: a joint's velocity and, for some laws, its load and position. Output: one column per linear parameter;
the friction torque is their sum, weighted, positive against positive velocity.

    tau_f(v) = sum_k c_k Phi_k(v; s)      c: linear parameters, s: shape values (at most three)

Floats, NumPy arrays, SymPy, CasADi and mpmath numbers, dual numbers (derivatives), text (LaTeX) and C code
all come from the one function `FrictionLaw.columns`.

Supported: laws without a memory. Not supported: laws with a state (Dahl, LuGre: `friction_dynamic`).
"""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.joint.friction_dual import DualFriction, build_variables
from symid.joint.operators import Operators

__all__ = [
    "FrictionCarrier",
    "FrictionLaw",
    "LawParameter",
    "OperatorFriction",
    "build_float_carrier",
    "build_numpy_carrier",
    "find_column_rates",
    "find_columns",
    "find_torque",
]

V = TypeVar("V")


class FrictionCarrier(Protocol[V]):
    """What a friction law may use of its numbers."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorFriction(Operators[V]):
    """A carrier whose numbers have the operators + - * / and **; the other functions are given."""

    zero: V
    one: V
    exp: Callable[[V], V]
    tanh: Callable[[V], V]
    sin: Callable[[V], V]
    cos: Callable[[V], V]
    sign: Callable[[V], V]
    absolute: Callable[[V], V]
    maximum: Callable[[V, V], V]
    minimum: Callable[[V, V], V]
    power: Callable[[V, V], V] = operator.pow


def _find_sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


def build_float_carrier() -> OperatorFriction[float]:
    """Return the carrier of Python floats."""
    return OperatorFriction(
        zero=0.0,
        one=1.0,
        exp=math.exp,
        tanh=math.tanh,
        sin=math.sin,
        cos=math.cos,
        sign=_find_sign,
        absolute=abs,
        maximum=max,
        minimum=min,
        power=math.pow,
    )


def build_numpy_carrier() -> OperatorFriction[FloatArray]:
    """Return the carrier of NumPy arrays, which may have any shapes that broadcast."""
    return OperatorFriction(
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LawParameter:
    """A parameter: name, LaTeX, SI units, meaning, the values that it may take, a typical value.

    `lower` and `upper` are physical bounds (may be infinite); whether `lower` itself is allowed says
    `lower_is_allowed`. `start` is where a search may begin, None where the data must say.
    """

    name: str
    latex: str
    unit: str
    unit_prismatic: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    start: float | None = None
    lower_is_allowed: bool = True


LawColumns = Callable[[FrictionCarrier[V], Mapping[str, V], Sequence[V]], tuple[V, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionLaw:
    """A static friction law.

    Args:
        name: under which `get_law` finds it.
        linear: parameters that the torque is linear in, in the order of the columns.
        shape: parameters inside the columns, at most three.
        inputs: of the columns: "velocity", and "load" (N m, N) or "position" (rad, m).
        columns: (carrier, inputs, shape values) -> one column per linear parameter.
        physical: the same number of parameters in all, under the names that papers print.
        mixing: physical = mixing [linear, shape], an integer matrix whose inverse has integers too.
        formula: in words and letters, in the physical parameters.
        source: who gave the law.
        smoothness: a sentence on its continuity in velocity and shape.
        passivity: a sentence: when it can never push.
        resistive: from the physical values by name, whether friction surely never pushes; sufficient.
        smoothing: speed v0 over which dry friction changes its sign, 0 for the sign itself.
    """

    name: str
    linear: tuple[LawParameter, ...]
    shape: tuple[LawParameter, ...]
    inputs: tuple[str, ...]
    columns: LawColumns  # type: ignore[type-arg]
    physical: tuple[LawParameter, ...]
    mixing: tuple[tuple[int, ...], ...]
    formula: str
    source: str
    smoothness: str
    passivity: str
    resistive: Callable[[Mapping[str, float]], bool]
    smoothing: float = 0.0

    def to_physical(self, linear: Sequence[float], shape: Sequence[float]) -> tuple[float, ...]:
        """Return the values in the order of `physical`; a linear map, whose matrix is `mixing`."""
        values = [*linear, *shape]
        return tuple(
            float(math.fsum(factor * value for factor, value in zip(row, values, strict=True) if factor))
            for row in self.mixing
        )

    def from_physical(self, physical: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return (linear, shape) from values in the order of `physical`."""
        values = [
            float(math.fsum(factor * value for factor, value in zip(row, physical, strict=True) if factor))
            for row in self.unmixing
        ]
        return tuple(values[: len(self.linear)]), tuple(values[len(self.linear) :])

    @property
    def unmixing(self) -> tuple[tuple[int, ...], ...]:
        """Return the inverse of `mixing`."""
        inverse = np.rint(np.linalg.inv(np.array(self.mixing, dtype=np.float64)))
        return tuple(tuple(int(entry) for entry in row) for row in inverse)

    @property
    def latex(self) -> str:
        """Return the law in LaTeX, written by the columns themselves."""
        from symid.joint.friction_text import write_latex

        return write_latex(self)

    def is_passive(self, linear: Sequence[float], shape: Sequence[float]) -> bool | None:
        """Return True if it surely never pushes, False if a motion is known that it pushes, else None."""
        values = self.to_physical(linear, shape)
        if self.resistive({p.name: value for p, value in zip(self.physical, values, strict=True)}):
            return True
        inputs = _build_probe(self)
        power = inputs["velocity"] * find_torque(self, inputs, linear, shape)
        return False if np.any(power < 0.0) else None


def _build_probe(law: FrictionLaw) -> dict[str, FloatArray]:
    """Return motions over all that may matter: speeds of 18 decades, loads, positions of a turn."""
    speeds = np.logspace(-12.0, 6.0, 361)
    axes = {"velocity": np.concatenate([-speeds[::-1], speeds])}
    if "load" in law.inputs:
        axes["load"] = np.array([0.0, 1.0, -1.0, 1e3, 1e6])
    if "position" in law.inputs:
        axes["position"] = np.linspace(0.0, 2.0 * np.pi, 181)
    grids = np.meshgrid(*axes.values(), indexing="ij")
    return {name: grid.ravel() for name, grid in zip(axes, grids, strict=True)}


def find_columns(law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]) -> FloatArray:
    """Return the columns (N, p) at inputs (N,) each, for shape values (s,)."""
    lifted = [np.float64(value) for value in shape]
    columns = law.columns(build_numpy_carrier(), inputs, lifted)
    result = np.empty((_count(law, inputs), len(law.linear)))
    for k, column in enumerate(columns):
        result[:, k] = column
    return result


def find_torque(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], linear: Sequence[float], shape: Sequence[float]
) -> FloatArray:
    """Return the friction torque (N,) in N m or N, at inputs (N,) each; linear (p,), shape (s,)."""
    result: FloatArray = find_columns(law, inputs, shape) @ np.asarray(linear, dtype=np.float64)
    return result


def find_column_rates(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]
) -> FloatArray:
    """Return the derivatives (N, p, s) of the columns by the shape values, exact."""
    size = len(law.shape)
    carrier = DualFriction(size=size)
    lifted = {name: carrier.lift(values) for name, values in inputs.items()}
    columns = law.columns(carrier, lifted, build_variables(shape))
    result = np.zeros((_count(law, inputs), len(law.linear), size))
    for k, column in enumerate(columns):
        for j, rate in enumerate(column.rates):
            result[:, k, j] = rate
    return result


def _count(law: FrictionLaw, inputs: Mapping[str, FloatArray]) -> int:
    return len(inputs[law.inputs[0]])
