"""The columns of the static friction laws: what each linear parameter is multiplied by, over any carrier.

Carrier, inputs of a law by name, its shape values -> one column per linear parameter.

    g(v) = fC + (fS - fC) exp(-|v / vs|^gamma) + fV |v|

Positive friction opposes positive velocity; sign(0) = 0. The Gaussian Stribeck term (Armstrong-Helouvry,
Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138) has derivatives by the Stribeck velocity vs, too.

Supported: every law of `friction_catalogue`; for the derivatives by vs an exponent of two only.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from symid.joint_models.carriers import Carrier, smooth

V = TypeVar("V")
Inputs = Mapping[str, V]
Values = Sequence[V]
Columns = tuple[V, ...]
Orders = tuple[int, ...]
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


def compute_coulomb_columns(carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V]) -> Columns[V]:
    """Return sign(v)."""
    return (carrier.sign(inputs["velocity"]),)


def compute_asymmetric_columns(carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V]) -> Columns[V]:
    """Return velocity and sign of forward motion, then of backward motion; zero in the other one."""
    velocity = inputs["velocity"]
    size, sign = carrier.absolute(velocity), carrier.sign(velocity)
    # sign^2 is |sign|: one away from standstill, zero at it.
    pairs = ((velocity, size), (sign, carrier.absolute(sign)))
    halves = [change(*pair) for change in (carrier.add, carrier.sub) for pair in pairs]
    return tuple(carrier.scale(0.5, half) for half in halves)


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


def _compute_powers(carrier: Carrier[V], velocity: V, orders: Orders) -> Columns[V]:
    """Return |v|^(k-1) v for each order k, by products."""
    size, powers = carrier.absolute(velocity), [velocity]
    for _ in range(max(orders, default=1) - 1):
        powers.append(carrier.mul(size, powers[-1]))
    return tuple(powers[order - 1] for order in orders)


def compute_stribeck_columns(
    carrier: Carrier[V], inputs: Inputs[V], shape: Values[V], *, exponent: float | None, orders: Orders = ()
) -> Columns[V]:
    """Return v, sign(v), exp(-|v / vs|^gamma) sign(v), |v|^(k-1) v for further orders k."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    fall = _compute_decay(carrier, velocity, shape, exponent)
    return velocity, sign, carrier.mul(fall, sign), *_compute_powers(carrier, velocity, orders)


def compute_polynomial_columns(
    carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V], *, orders: Orders = ()
) -> Columns[V]:
    """Return v, sign(v), |v|^(k-1) v for further orders k."""
    velocity = inputs["velocity"]
    return velocity, carrier.sign(velocity), *_compute_powers(carrier, velocity, orders)


def compute_lorentzian_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return v, sign(v), sign(v) / (1 + (v / vs)^2)."""
    velocity = inputs["velocity"]
    sign, ratio = carrier.sign(velocity), carrier.div(velocity, shape[0])
    return velocity, sign, carrier.div(sign, carrier.add(carrier.one, carrier.mul(ratio, ratio)))


def compute_asymmetric_stribeck_columns(
    carrier: Carrier[V], inputs: Inputs[V], shape: Values[V], *, exponent: float | None, bumps: int
) -> Columns[V]:
    """Return the asymmetric columns, and the fall by sign: one for both directions, or one for each."""
    halves = compute_asymmetric_columns(carrier, inputs, shape)
    fall = _compute_decay(carrier, inputs["velocity"], shape, exponent)
    if bumps == 1:
        return *halves, carrier.mul(fall, carrier.sign(inputs["velocity"]))
    forward, backward = carrier.mul(fall, halves[1]), carrier.mul(fall, halves[3])
    return *halves[:2], forward, *halves[2:], backward


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
    columns = compute_stribeck_columns(carrier, {"velocity": velocity}, shape, exponent=exponent)
    return *columns, carrier.one


def compute_power_law_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return sign(v), |v|^delta sign(v)."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    return sign, carrier.mul(carrier.power(carrier.absolute(velocity), shape[0]), sign)


def compute_makkar_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return tanh(g2 v) - tanh(g3 v), tanh(g5 v), v."""
    velocity = inputs["velocity"]
    rise, fall, dry = (carrier.tanh(carrier.mul(slope, velocity)) for slope in shape)
    return carrier.sub(rise, fall), dry, velocity


def compute_load_dependent_columns(
    carrier: Carrier[V], inputs: Inputs[V], shape: Values[V], *, exponent: float | None, falls: bool
) -> Columns[V]:
    """Return v, sign(v), |load| sign(v), and the fall times both signs where friction `falls`."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    loaded = carrier.mul(carrier.absolute(inputs["load"]), sign)
    if not falls:
        return velocity, sign, loaded
    fall = _compute_decay(carrier, velocity, shape, exponent)
    return velocity, sign, loaded, carrier.mul(fall, sign), carrier.mul(fall, loaded)


def compute_position_dependent_columns(
    carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V], *, orders: Orders, gear: float, dry: bool
) -> Columns[V]:
    """Return v, sign(v), and cos, sin of k gear q for each order k, times sign(v) where friction is `dry`."""
    velocity, position = inputs["velocity"], inputs["position"]
    sign = carrier.sign(velocity)
    columns = [velocity, sign]
    for order in orders:
        angle = carrier.scale(order * gear, position)
        waves = (carrier.cos(angle), carrier.sin(angle))
        columns += [carrier.mul(wave, sign) if dry else wave for wave in waves]
    return tuple(columns)


REFERENCE_TEMPERATURE = 40.0
"""In degC: what friction at other temperatures is compared with."""


def compute_temperature_columns(carrier: Carrier[V], inputs: Inputs[V], _shape: Values[V]) -> Columns[V]:
    """Return v, sign(v), and both times T - T0."""
    velocity = inputs["velocity"]
    warmer = carrier.sub(inputs["temperature"], carrier.scale(REFERENCE_TEMPERATURE, carrier.one))
    sign = carrier.sign(velocity)
    return velocity, sign, carrier.mul(warmer, velocity), carrier.mul(warmer, sign)


def compute_thermal_viscous_columns(carrier: Carrier[V], inputs: Inputs[V], shape: Values[V]) -> Columns[V]:
    """Return v, sign(v), exp(-T / TV) v."""
    velocity = inputs["velocity"]
    cold = carrier.exp(carrier.scale(-1.0, carrier.div(inputs["temperature"], shape[0])))
    return velocity, carrier.sign(velocity), carrier.mul(cold, velocity)
