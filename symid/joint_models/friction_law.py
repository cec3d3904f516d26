"""What a static friction law is: columns, linear in most parameters, written once over any carrier.

    tau_f(v) = sum_k c_k Phi_k(v; s)      c: linear parameters, s: shape values (at most three)

Velocity of a joint, for some laws its load and position -> one column Phi_k per linear parameter; positive
torque opposes positive velocity, sign(0) = 0. Numbers, derivatives, LaTeX and C code all come from
`FrictionLaw.columns`. The Gaussian Stribeck term (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica
30 (1994) 1083-1138) has derivatives by the Stribeck velocity vs, too.

Supported: laws without a state, smoothed ones too; of laws with a state the curve of steady sliding.
Not supported: the state itself, such as the bristles of Dahl and LuGre (`dynamic_friction`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.joint_models import carriers
from symid.joint_models.carriers import Carrier

V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class LawParameter:
    """A parameter of a law.

    Args:
        name, latex, unit, unit_prismatic, meaning: the units are SI.
        lower, upper: physical bounds, may be infinite.
        lower_is_allowed: whether the lower bound itself is.
    """

    name: str
    latex: str
    unit: str
    unit_prismatic: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
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
    *,
    allowed: bool = True,
) -> LawParameter:
    """Return a parameter whose units are those of `kind`; `allowed`: whether the lower bound itself is."""
    return LawParameter(name, latex, *_UNITS[kind], meaning, lower, upper, allowed)


LawColumns = Callable[[Carrier[V], Mapping[str, V], Sequence[V]], tuple[V, ...]]


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

    def unmix(self, algebra: Carrier[V], physical: Sequence[V]) -> list[V]:
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


Inputs = Mapping[str, V]
Values = Sequence[V]
Columns = tuple[V, ...]
_GAUSSIAN = 2.0


def compute_stribeck_derivatives(
    carrier: Carrier[V], velocity: V, speed: V, smoothing: float = 0.0
) -> tuple[V, V, V]:
    """Return g(v) = exp(-(v / vs)^2) sign(v) and its first and second derivative by vs.

    dg/dvs = 2 v^2 / vs^3 g, d2g/dvs2 = (4 v^4 / vs^6 - 6 v^2 / vs^4) g.

    `velocity` is that of the motor, `speed` vs > 0, `smoothing` v0 of tanh(v / v0) in place of the sign, 0
    for the sign; rad/s or m/s each.
    """
    signed = carriers.smooth(carrier, smoothing) if smoothing > 0.0 else carrier
    ratio = carrier.div(velocity, speed)
    square = carrier.mul(ratio, ratio)
    shape = carrier.mul(carrier.exp(carrier.scale(-1.0, square)), signed.sign(velocity))
    first = carrier.div(carrier.mul(carrier.scale(2.0, square), shape), speed)
    bend = carrier.add(carrier.scale(4.0, carrier.mul(square, square)), carrier.scale(-6.0, square))
    second = carrier.div(carrier.mul(bend, shape), carrier.mul(speed, speed))
    return shape, first, second


def _compute_decay(
    carrier: Carrier[V], size: V, shape: Values[V], exponent: float | None, *, is_positive: bool = False
) -> V:
    """Return exp(-|size / vs|^gamma): vs is first in `shape`, gamma last where `exponent` is None."""
    ratio = carrier.div(size, shape[0])
    if exponent == _GAUSSIAN:
        return carrier.exp(carrier.scale(-1.0, carrier.mul(ratio, ratio)))
    power = ratio if is_positive else carrier.absolute(ratio)
    if exponent != 1.0:
        gamma = shape[-1] if exponent is None else carrier.scale(exponent, carrier.one)
        power = carrier.power(power, gamma)
    return carrier.exp(carrier.scale(-1.0, power))


REFERENCE_TEMPERATURE = 40.0
"""In degC: what friction at other temperatures is compared with."""
_FALLS = {"Fe": "Fc", "Fep": "Fcp", "Fen": "Fcn", "Fle": "Fl"}
"""Parameters of what falls with the speed, and of what it is like at rest."""


def compute_named_columns(
    carrier: Carrier[V],
    inputs: Inputs[V],
    shape: Values[V],
    *,
    names: Sequence[str],
    exponent: float | None = None,
    orders: Mapping[str, int] = MappingProxyType({}),
) -> Columns[V]:
    """Return the columns of linear parameters, which have the same name in all laws.

    Fv v, Fc sign(v), Fe exp(-|v / vs|^gamma) sign(v), Fd |v|^delta sign(v), those of `orders` k |v|^(k-1) v;
    Fvp, Fcp, Fep in forward motion, Fvn, Fcn, Fen in backward motion; Fl, Fle as Fc, Fe times |load|; Fvt,
    Fct as Fv, Fc times T - T0, Fvl exp(-T / TV) v.
    """
    velocity = inputs["velocity"]
    size = carrier.absolute(velocity) if "Fvp" in names else velocity
    sign = carrier.sign(velocity)
    known = {"Fv": velocity, "Fc": sign}
    if "Fvp" in names:
        # sign^2 is |sign|: one away from standstill, zero at it.
        pairs = ((velocity, size), (sign, carrier.absolute(sign)))
        halves = [change(*pair) for change in (carrier.add, carrier.sub) for pair in pairs]
        sides = (carrier.scale(0.5, half) for half in halves)
        known |= dict(zip(("Fvp", "Fcp", "Fvn", "Fcn"), sides, strict=True))
    if "Fl" in names:
        known["Fl"] = carrier.mul(carrier.absolute(inputs["load"]), sign)
    if not _FALLS.keys().isdisjoint(names):
        fall = _compute_decay(carrier, velocity, shape, exponent)
        known |= {name: carrier.mul(fall, known[rest]) for name, rest in _FALLS.items() if name in names}
    size, powers = carrier.absolute(velocity) if orders or "Fd" in names else size, [velocity]
    for _ in range(max(orders.values(), default=1) - 1):
        powers.append(carrier.mul(size, powers[-1]))
    known |= {name: powers[order - 1] for name, order in orders.items()}
    if "Fd" in names:
        known["Fd"] = carrier.mul(carrier.power(size, shape[0]), sign)
    if "Fvt" in names:
        warmer = carrier.sub(inputs["temperature"], carrier.scale(REFERENCE_TEMPERATURE, carrier.one))
        known |= {"Fvt": carrier.mul(warmer, velocity), "Fct": carrier.mul(warmer, sign)}
    if "Fvl" in names:
        cold = carrier.exp(carrier.scale(-1.0, carrier.div(inputs["temperature"], shape[0])))
        known["Fvl"] = carrier.mul(cold, velocity)
    return tuple(known[name] for name in names)


def compute_lorentzian_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return v, sign(v), sign(v) / (1 + (v / vs)^2)."""
    velocity = inputs["velocity"]
    sign, ratio = carrier.sign(velocity), carrier.div(velocity, shape[0])
    return velocity, sign, carrier.div(sign, carrier.add(carrier.one, carrier.mul(ratio, ratio)))


def compute_improved_columns(
    carrier: Carrier[V], inputs: Inputs[V], shape: Values[V], *, exponent: float | None, bias_everywhere: bool
) -> Columns[V]:
    """Return v, s, s exp(-(max(|v|, dq0) / vs)^gamma), and the bias; s = clip(v / dq0, -1, 1).

    Within |v| < dq0 friction is a straight line; the bias is constant, or falls to zero at dq0.
    """
    velocity, edge, one = inputs["velocity"], shape[1], carrier.one
    size = carrier.absolute(velocity)
    ratio = carrier.div(velocity, edge)
    clipped = carrier.maximum(carrier.scale(-1.0, one), carrier.minimum(one, ratio))
    outside = carrier.maximum(size, edge)
    fall = _compute_decay(carrier, outside, shape, exponent, is_positive=True)
    bias = one
    if not bias_everywhere:
        bias = carrier.maximum(carrier.zero, carrier.sub(one, carrier.div(size, edge)))
    return velocity, clipped, carrier.mul(fall, clipped), bias


def compute_shifted_columns(
    carrier: Carrier[V], inputs: Inputs[V], shape: Values[V], *, exponent: float | None, shifted: bool
) -> Columns[V]:
    """Return the Stribeck columns and the bias one; at the velocity v - dq0 where `shifted`."""
    velocity = inputs["velocity"]
    velocity = carrier.sub(velocity, shape[1]) if shifted else velocity
    inputs, names = {"velocity": velocity}, ("Fv", "Fc", "Fe")
    return *compute_named_columns(carrier, inputs, shape, names=names, exponent=exponent), carrier.one


def compute_makkar_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return tanh(g2 v) - tanh(g3 v), tanh(g5 v), v."""
    velocity = inputs["velocity"]
    rise, fall, dry = (carrier.tanh(carrier.mul(slope, velocity)) for slope in shape)
    return carrier.sub(rise, fall), dry, velocity


def compute_position_dependent_columns(
    carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V], *, turns: Sequence[float], dry: bool
) -> Columns[V]:
    """Return v, sign(v), and cos, sin of k q for k in `turns`, times sign(v) where friction is `dry`."""
    velocity, position = inputs["velocity"], inputs["position"]
    sign = carrier.sign(velocity)
    columns = [velocity, sign]
    for turn in turns:
        angle = carrier.scale(turn, position)
        waves = (carrier.cos(angle), carrier.sin(angle))
        columns += [carrier.mul(wave, sign) if dry else wave for wave in waves]
    return tuple(columns)


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
    law: FrictionLaw,
    inputs: Mapping[str, FloatArray],
    linear: Sequence[float] | FloatArray,
    shape: Sequence[float] | FloatArray,
) -> FloatArray:
    """Return the derivatives (N, p + s) of the torque by linear (p,) and shape values (s,)."""
    values = [float(value) for value in shape]
    rates = np.einsum("nps,p->ns", compute_column_derivatives(law, inputs, values), np.array(linear))
    return np.hstack([compute_columns(law, inputs, values), rates])
