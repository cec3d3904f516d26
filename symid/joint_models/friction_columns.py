"""The columns of the static friction laws: what each linear parameter is multiplied by, over any carrier.

Carrier, inputs of a law by name, its shape values -> one column per linear parameter.

    g(v) = fC + (fS - fC) exp(-|v / vs|^gamma) + fV |v|

Positive friction opposes positive velocity; sign(0) = 0. The Gaussian Stribeck term (Armstrong-Helouvry,
Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138) has derivatives by the Stribeck velocity vs, too.

Supported: every law of `friction_catalogue`; for the derivatives by vs an exponent of two only.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

from symid.joint_models.carriers import Carrier, smooth

V = TypeVar("V")
Inputs = Mapping[str, V]
Values = Sequence[V]
Columns = tuple[V, ...]
_GAUSSIAN = 2.0


def _compute_gaussian_decay(carrier: Carrier[V], velocity: V, speed: V) -> V:
    ratio = carrier.div(velocity, speed)
    return carrier.exp(carrier.scale(-1.0, carrier.mul(ratio, ratio)))


def compute_stribeck_derivatives(
    carrier: Carrier[V], velocity: V, speed: V, smoothing: float = 0.0
) -> tuple[V, V, V]:
    """Return g(v) = exp(-(v / vs)^2) sign(v) and its first and second derivative by vs.

    dg/dvs = 2 v^2 / vs^3 g, d2g/dvs2 = (4 v^4 / vs^6 - 6 v^2 / vs^4) g.

    `velocity` is that of the motor, `speed` vs > 0, `smoothing` v0 of tanh(v / v0) in place of the sign, 0
    for the sign; rad/s or m/s each.
    """
    signed = smooth(carrier, smoothing) if smoothing > 0.0 else carrier
    shape = carrier.mul(_compute_gaussian_decay(carrier, velocity, speed), signed.sign(velocity))
    ratio = carrier.div(velocity, speed)
    square = carrier.mul(ratio, ratio)
    first = carrier.div(carrier.mul(carrier.scale(2.0, square), shape), speed)
    bend = carrier.add(carrier.scale(4.0, carrier.mul(square, square)), carrier.scale(-6.0, square))
    second = carrier.div(carrier.mul(bend, shape), carrier.mul(speed, speed))
    return shape, first, second


def _compute_decay(
    carrier: Carrier[V], size: V, shape: Values[V], exponent: float | None, *, is_positive: bool = False
) -> V:
    """Return exp(-|size / vs|^gamma): vs is first in `shape`, gamma last where `exponent` is None."""
    if exponent == _GAUSSIAN:
        return _compute_gaussian_decay(carrier, size, shape[0])
    ratio = carrier.div(size, shape[0])
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
    velocity, one = inputs["velocity"], carrier.one
    size = carrier.absolute(velocity) if "Fvp" in names or orders or "Fd" in names else velocity
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
    powers = [velocity]
    for _ in range(max(orders.values(), default=1) - 1):
        powers.append(carrier.mul(size, powers[-1]))
    known |= {name: powers[order - 1] for name, order in orders.items()}
    if "Fd" in names:
        known["Fd"] = carrier.mul(carrier.power(size, shape[0]), sign)
    if "Fvt" in names:
        warmer = carrier.sub(inputs["temperature"], carrier.scale(REFERENCE_TEMPERATURE, one))
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
