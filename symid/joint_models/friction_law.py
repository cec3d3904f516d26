"""What a static friction law is: columns, linear in most parameters, written once over any carrier.

Velocity of a joint, for some laws its load and position -> one column per linear parameter. The friction
torque is their weighted sum, positive against positive velocity.

    tau_f(v) = sum_k c_k Phi_k(v; s)      c: linear parameters, s: shape values (at most three)

Floats, NumPy arrays, SymPy, CasADi and mpmath numbers, dual numbers (derivatives), LaTeX and C code all
come from the one function `FrictionLaw.columns`: what is printed is what is computed, and no term is
rearranged.

Supported: laws without a state, smoothed ones too.
Not supported: laws with a state, such as Dahl and LuGre (`dynamic_friction`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.joint_models.carriers import Carrier, DualFriction, build_dual_variables, build_numpy_carrier

V = TypeVar("V")


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


_UNITS = {
    "stiffness": ("N m/rad", "N/m"),
    "level": ("N m", "N"),
    "viscous": ("N m s/rad", "N s/m"),
    "speed": ("rad/s", "m/s"),
    "slope": ("s/rad", "s/m"),
    "number": ("1", "1"),
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
    """Return a parameter of a kind: "stiffness", "level", "viscous", "speed", "slope" or "number".

    `allowed` says whether the lower bound itself is.
    """
    unit, unit_prismatic = _UNITS[kind]
    return LawParameter(
        name=name,
        latex=latex,
        unit=unit,
        unit_prismatic=unit_prismatic,
        meaning=meaning,
        lower=lower,
        upper=upper,
        start=start,
        lower_is_allowed=allowed,
    )


LawColumns = Callable[[Carrier[V], Mapping[str, V], Sequence[V]], tuple[V, ...]]


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
        return write_law_latex(self)

    def is_passive(self, linear: Sequence[float], shape: Sequence[float]) -> bool | None:
        """Return True if it surely never pushes, False if a motion is known that it pushes, else None."""
        values = self.to_physical(linear, shape)
        if self.resistive({p.name: value for p, value in zip(self.physical, values, strict=True)}):
            return True
        inputs = _build_probe(self)
        power = inputs["velocity"] * compute_friction_torque(self, inputs, linear, shape)
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


def compute_columns(law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]) -> FloatArray:
    """Return the columns (N, p) at inputs (N,) each, for shape values (s,)."""
    lifted = [np.float64(value) for value in shape]
    columns = law.columns(build_numpy_carrier(), inputs, lifted)
    result = np.empty((_count_samples(law, inputs), len(law.linear)))
    for k, column in enumerate(columns):
        result[:, k] = column
    return result


def compute_friction_torque(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], linear: Sequence[float], shape: Sequence[float]
) -> FloatArray:
    """Return the friction torque (N,) in N m or N, at inputs (N,) each; linear (p,), shape (s,)."""
    result: FloatArray = compute_columns(law, inputs, shape) @ np.asarray(linear, dtype=np.float64)
    return result


def compute_column_derivatives(
    law: FrictionLaw, inputs: Mapping[str, FloatArray], shape: Sequence[float]
) -> FloatArray:
    """Return the derivatives (N, p, s) of the columns by the shape values, exact."""
    size = len(law.shape)
    carrier = DualFriction(size=size)
    lifted = {name: carrier.lift(values) for name, values in inputs.items()}
    columns = law.columns(carrier, lifted, build_dual_variables(shape))
    result = np.zeros((_count_samples(law, inputs), len(law.linear), size))
    for k, column in enumerate(columns):
        for j, rate in enumerate(column.rates):
            result[:, k, j] = rate
    return result


def _count_samples(law: FrictionLaw, inputs: Mapping[str, FloatArray]) -> int:
    return len(inputs[law.inputs[0]])


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


def write_law_latex(law: FrictionLaw) -> str:
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
