"""What a static friction law is: columns, linear in most parameters, written once over any carrier.

    tau_f(v) = sum_k c_k Phi_k(v; s)      c: linear parameters, s: shape values (at most three)

Velocity of a joint, for some laws its load and position -> one column Phi_k per linear parameter; positive
torque opposes positive velocity. Numbers, derivatives, LaTeX and C code all come from `FrictionLaw.columns`.

Supported: laws without a state, smoothed ones too; of laws with a state the curve of steady sliding.
Not supported: the state itself, such as the bristles of Dahl and LuGre (`dynamic_friction`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import NamedTuple, TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.joint_models import carriers

V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class LawParameter:
    """A parameter of a law.

    Args:
        name, latex, unit, unit_prismatic, meaning: the units are SI.
        lower, upper: physical bounds, may be infinite.
        start: where a search may begin; None where the data must say.
        lower_is_allowed: whether the lower bound itself is.
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


_UNITS = {
    "stiffness": ("N m/rad", "N/m"),
    "level": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "speed": ("rad/s", "m/s"),
    "slope": ("s/rad", "s/m"),
    "number": ("1", "1"),
    "level per kelvin": ("N m/K", "N/K"),
    "viscous per kelvin": ("N m s/(rad K)", "N s/(m K)"),
    "kelvin": ("K", "K"),
}


def build_parameter(  # noqa: PLR0917 - one row of a table
    name: str,
    latex: str,
    kind: str,
    meaning: str,
    lower: float = 0.0,
    upper: float = math.inf,
    start: float | None = None,
    *,
    allowed: bool = True,
) -> LawParameter:
    """Return a parameter whose units are those of `kind`; `allowed`: whether the lower bound itself is."""
    return LawParameter(name, latex, *_UNITS[kind], meaning, lower, upper, start, allowed)


LawColumns = Callable[[carriers.Carrier[V], Mapping[str, V], Sequence[V]], tuple[V, ...]]


class Wave(NamedTuple):
    """A parameter whose column is cos(w q), sin(w q) where `sine`; times sign(v) where `dry`."""

    name: str
    frequency: Fraction
    sine: bool
    dry: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionLaw:
    """A static friction law.

    Args:
        name: under which `get_law` finds it.
        linear: parameters that the torque is linear in, in the order of the columns.
        shape: parameters inside the columns, at most three.
        inputs: of the columns: "velocity", and "load" (N m, N), "position" (rad, m) or "temperature" (degC).
        columns: (carrier, inputs, shape values) -> one column per linear parameter.
        own: linear parameters whose column is no sum of v, |v|, sign(v) and one.
        exponent: gamma of its fall; None where it is searched, or there is none.
        waves: the linear parameters whose columns are waves of the position.
        physical: the same number of parameters in all, under the names that papers print.
        mixing: physical = mixing [linear, shape], an integer matrix whose inverse has integers too.
        formula: in words and letters, in the physical parameters.
        source: who gave the law.
        smoothness: a sentence on its continuity in velocity and shape.
        passivity: a sentence: when it is dissipative.
        smoothing: speed v0 over which dry friction changes its sign, 0 for the sign itself.
        memory: parameters of bristles, whose steady torque the columns are; none of a law without a state.
        elements: whether each of those is a list of numbers, one an element.
    """

    name: str
    linear: tuple[LawParameter, ...]
    shape: tuple[LawParameter, ...]
    columns: LawColumns  # type: ignore[type-arg]
    physical: tuple[LawParameter, ...]
    mixing: tuple[tuple[int, ...], ...]
    formula: str
    source: str
    inputs: tuple[str, ...] = ("velocity",)
    own: tuple[str, ...] = ()
    exponent: float | None = None
    waves: tuple["Wave", ...] = ()
    smoothness: str = "Jumps at zero velocity (sign), smooth elsewhere and in all parameters."
    passivity: str = "Dissipative where no coefficient is negative."
    smoothing: float = 0.0
    memory: tuple[LawParameter, ...] = ()
    elements: bool = False

    def to_physical(self, linear: Sequence[float], shape: Sequence[float]) -> tuple[float, ...]:
        """Return the values in the order of `physical`; a linear map, whose matrix is `mixing`."""
        rows = (zip(row, [*linear, *shape], strict=True) for row in self.mixing)
        return tuple(math.fsum(factor * value for factor, value in row if factor) for row in rows)

    def from_physical(self, physical: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return (linear, shape) from values in the order of `physical`."""
        values = self.unmix(carriers.build_float_carrier(), list(map(float, physical)))
        return tuple(values[: len(self.linear)]), tuple(values[len(self.linear) :])

    def unmix(self, algebra: carriers.Carrier[V], physical: Sequence[V]) -> list[V]:
        """Return linear parameters, then shape values, from values in the order of `physical`."""
        found = []
        for row in self.unmixing:
            added, removed = (
                [v for k, v in zip(row, physical, strict=True) if k == sign] for sign in (1, -1)
            )
            found.append(reduce(algebra.sub, removed, reduce(algebra.add, added)))
        return found

    @property
    def unmixing(self) -> tuple[tuple[int, ...], ...]:
        """Return the inverse of `mixing`."""
        inverse = np.rint(np.linalg.inv(np.array(self.mixing, dtype=np.float64))).astype(int)
        return tuple(map(tuple, inverse.tolist()))

    @property
    def latex(self) -> str:
        """Return the law as an equation for tau_f in its physical parameters, written by the columns."""
        carrier = _build_latex_carrier()
        inputs = {name: Phrase(_INPUTS[name]) for name in self.inputs}
        columns = self.columns(carrier, inputs, [Phrase(parameter.latex) for parameter in self.shape])
        terms = []
        for row, column in zip(self.unmixing, columns, strict=False):
            # A linear parameter is a sum of physical ones, those that are added first.
            parts = [(factor, p.latex) for factor, p in zip(row, self.physical, strict=True) if factor]
            parts.sort(key=lambda part: -part[0])
            text = " ".join(f"{'+' if factor > 0 else '-'} {latex}" for factor, latex in parts)
            terms.append(Phrase(text.removeprefix("+ "), _ATOM if len(parts) == 1 else _SUM) * column)
        return rf"\tau_f = {reduce(Phrase.__add__, terms).text}"


NO_FRICTION = "none"
"""In place of the name of a law."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionValues:
    """The friction law of a joint or drive and, where they are known, its numbers.

    Args:
        law: its name in the catalogue, or `NO_FRICTION`.
        values: of the linear parameters, in the law's order; None where they are unknown.
        shape: shape values in the law's order; empty where the law has none, or they are unknown.
        smoothing: the speed v0 (rad/s or m/s) over which dry friction changes its sign, tanh(v / v0) in
            place of sign(v); 0 is the step itself.
        bristles: values of the law's `memory` in its order, those of all elements one list after another;
            empty of a law without a state.
    """

    law: str = NO_FRICTION
    values: tuple[float, ...] | None = None
    shape: tuple[float, ...] = ()
    smoothing: float = 0.0
    bristles: tuple[float, ...] = ()


def compute_columns(law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]) -> FloatArray:
    """Return the columns (N, p) at inputs (N,) each, for shape values (s,)."""
    lifted = [np.float64(value) for value in shape]
    columns = law.columns(carriers.build_numpy_carrier(), inputs, lifted)
    result = np.empty((len(inputs[law.inputs[0]]), len(law.linear)))
    for k, column in enumerate(columns):
        result[:, k] = column
    return result


def compute_friction_torque(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], linear: Sequence[float], shape: Sequence[float]
) -> FloatArray:
    """Return the friction torque (N,) in N m or N, at inputs (N,) each; linear (p,), shape (s,)."""
    return np.asarray(compute_columns(law, inputs, shape) @ np.asarray(linear, dtype=np.float64))


_STEP = 1e-40


def compute_column_derivatives(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]
) -> FloatArray:
    """Return the derivatives (N, p, s) of the columns by the shape values, exact.

    They are imaginary parts over a small imaginary step of each value (Squire and Trapp 1998).
    """
    size, carrier = len(law.shape), carriers.build_complex_carrier()
    result = np.zeros((len(inputs[law.inputs[0]]), len(law.linear), size))
    for j in range(size):
        step, moved = _STEP * (abs(shape[j]) or 1.0), list(map(np.complex128, shape))
        moved[j] += 1j * step
        for k, column in enumerate(law.columns(carrier, inputs, moved)):
            result[:, k, j] = np.imag(column) / step
    return result


def compute_law_sensitivities(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], linear: Sequence[float], shape: Sequence[float]
) -> FloatArray:
    """Return the derivatives (N, p + s) of the torque by linear (p,) and shape values (s,)."""
    rates = compute_column_derivatives(law, inputs, shape)
    return np.hstack([compute_columns(law, inputs, shape), np.einsum("nps,p->ns", rates, np.array(linear))])


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


def _build_latex_carrier() -> carriers.OperatorCarrier[Phrase]:
    def name(function: str) -> Callable[..., Phrase]:
        def apply(*values: Phrase) -> Phrase:
            inner = r",\, ".join(value.text for value in values)
            return Phrase(rf"{function}\left({inner}\right)")

        return apply

    return carriers.OperatorCarrier(
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
