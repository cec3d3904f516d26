"""The columns of static friction laws: what each linear parameter is multiplied with, once for all carriers.

Input: a carrier, the inputs of a law by name, its shape values. Output: one column a linear parameter.

    g(v) = fC + (fS - fC) exp(-|v / vs|^gamma) + fV |v|

Positive friction opposes positive velocity. With a smoothing speed v0 the sign is tanh(v / v0).

Supported: everything `symid.joint.friction_laws` lists.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from symid.joint.friction_law import FrictionCarrier, LawColumns
from symid.joint.stribeck import find_gaussian_fall

__all__ = [
    "BasicCarrier",
    "SmoothedFriction",
    "add_constant",
    "find_asymmetric",
    "find_asymmetric_stribeck",
    "find_coulomb",
    "find_coulomb_viscous",
    "find_fall",
    "find_improved",
    "find_load_dependent",
    "find_lorentzian",
    "find_makkar",
    "find_polynomial",
    "find_position_dependent",
    "find_power_law",
    "find_shifted",
    "find_stribeck_law",
    "halve_by_direction",
    "smooth",
]

V = TypeVar("V")

_GAUSSIAN = 2.0


class BasicCarrier(Protocol[V]):
    """What piecewise linear friction uses of its numbers."""

    @property
    def one(self) -> V:
        """Return one."""

    def add(self, left: V, right: V) -> V:
        """Return left + right."""

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""

    def sign(self, value: V) -> V:
        """Return -1, 0 or 1."""

    def absolute(self, value: V) -> V:
        """Return |value|."""


@dataclass(frozen=True, slots=True)
class SmoothedFriction(Generic[V]):
    """A carrier in which sign(v) is tanh(v / v0): dry friction that changes its sign over a speed v0."""

    carrier: FrictionCarrier[V]
    speed: float

    @property
    def zero(self) -> V:
        """Return zero."""
        return self.carrier.zero

    @property
    def one(self) -> V:
        """Return one."""
        return self.carrier.one

    def add(self, left: V, right: V) -> V:
        """Return left + right."""
        return self.carrier.add(left, right)

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""
        return self.carrier.sub(left, right)

    def mul(self, left: V, right: V) -> V:
        """Return left * right."""
        return self.carrier.mul(left, right)

    def div(self, left: V, right: V) -> V:
        """Return left / right."""
        return self.carrier.div(left, right)

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""
        return self.carrier.scale(factor, value)

    def exp(self, value: V) -> V:
        """Return the exponential."""
        return self.carrier.exp(value)

    def tanh(self, value: V) -> V:
        """Return the hyperbolic tangent."""
        return self.carrier.tanh(value)

    def sin(self, value: V) -> V:
        """Return the sine."""
        return self.carrier.sin(value)

    def cos(self, value: V) -> V:
        """Return the cosine."""
        return self.carrier.cos(value)

    def sign(self, value: V) -> V:
        """Return tanh(value / v0)."""
        return self.carrier.tanh(self.carrier.scale(1.0 / self.speed, value))

    def absolute(self, value: V) -> V:
        """Return |value|."""
        return self.carrier.absolute(value)

    def maximum(self, left: V, right: V) -> V:
        """Return the greater of two."""
        return self.carrier.maximum(left, right)

    def minimum(self, left: V, right: V) -> V:
        """Return the smaller of two."""
        return self.carrier.minimum(left, right)

    def power(self, base: V, exponent: V) -> V:
        """Return base^exponent."""
        return self.carrier.power(base, exponent)


Inputs = Mapping[str, V]


def smooth(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    columns: LawColumns[V],
    speed: float,
) -> tuple[V, ...]:
    """Return the columns of a law with tanh(v / speed) in place of the sign."""
    return columns(SmoothedFriction(carrier, speed), inputs, shape)


def add_constant(
    carrier: FrictionCarrier[V], inputs: Inputs[V], shape: Sequence[V], *, columns: LawColumns[V]
) -> tuple[V, ...]:
    """Return the columns of a law and the constant one."""
    return (*columns(carrier, inputs, shape), carrier.one)


def halve_by_direction(carrier: BasicCarrier[V], velocity: V) -> tuple[V, V, V, V]:
    """Return velocity and sign of forward motion, then of backward motion; zero in the other one."""
    size, sign = carrier.absolute(velocity), carrier.sign(velocity)
    # sign^2 is |sign|: one away from standstill, zero at it.
    moving = carrier.absolute(sign)
    return (
        carrier.scale(0.5, carrier.add(velocity, size)),
        carrier.scale(0.5, carrier.add(sign, moving)),
        carrier.scale(0.5, carrier.sub(velocity, size)),
        carrier.scale(0.5, carrier.sub(sign, moving)),
    )


def find_coulomb(carrier: FrictionCarrier[V], inputs: Inputs[V], _shape: Sequence[V]) -> tuple[V, ...]:
    """Return sign(v)."""
    return (carrier.sign(inputs["velocity"]),)


def find_coulomb_viscous(
    carrier: FrictionCarrier[V], inputs: Inputs[V], _shape: Sequence[V]
) -> tuple[V, ...]:
    """Return v, sign(v)."""
    return inputs["velocity"], carrier.sign(inputs["velocity"])


def find_asymmetric(carrier: FrictionCarrier[V], inputs: Inputs[V], _shape: Sequence[V]) -> tuple[V, ...]:
    """Return velocity and sign by direction."""
    return halve_by_direction(carrier, inputs["velocity"])


def find_fall(
    carrier: FrictionCarrier[V], size: V, shape: Sequence[V], exponent: float | None, *, is_positive: bool
) -> V:
    """Return exp(-|size / vs|^gamma), vs the first shape value.

    Args:
        carrier: of the numbers.
        size: a velocity, or its absolute value, which then `is_positive` says.
        shape: vs first; gamma last where `exponent` is None.
        exponent: gamma where it is fixed.
        is_positive: whether size >= 0 is known.
    """
    if exponent == _GAUSSIAN:
        return find_gaussian_fall(carrier, size, shape[0])
    ratio = carrier.div(size, shape[0])
    if not is_positive:
        ratio = carrier.absolute(ratio)
    if exponent == 1.0:
        return carrier.exp(carrier.scale(-1.0, ratio))
    gamma = shape[-1] if exponent is None else carrier.scale(exponent, carrier.one)
    return carrier.exp(carrier.scale(-1.0, carrier.power(ratio, gamma)))


def find_stribeck_law(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    exponent: float | None,
    orders: tuple[int, ...] = (),
) -> tuple[V, ...]:
    """Return v, sign(v), exp(-|v / vs|^gamma) sign(v), |v|^(k-1) v for further orders k."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    fall = find_fall(carrier, velocity, shape, exponent, is_positive=False)
    return velocity, sign, carrier.mul(fall, sign), *_find_powers(carrier, velocity, orders)


def _find_powers(carrier: FrictionCarrier[V], velocity: V, orders: Sequence[int]) -> tuple[V, ...]:
    """Return |v|^(k-1) v for each order k, by products."""
    result, power, size = {1: velocity}, velocity, carrier.absolute(velocity)
    for order in range(2, max(orders, default=1) + 1):
        power = carrier.mul(size, power)
        result[order] = power
    return tuple(result[order] for order in orders)


def find_polynomial(
    carrier: FrictionCarrier[V], inputs: Inputs[V], _shape: Sequence[V], *, orders: tuple[int, ...]
) -> tuple[V, ...]:
    """Return v, sign(v), |v|^(k-1) v for further orders k."""
    velocity = inputs["velocity"]
    return velocity, carrier.sign(velocity), *_find_powers(carrier, velocity, orders)


def find_lorentzian(carrier: FrictionCarrier[V], inputs: Inputs[V], shape: Sequence[V]) -> tuple[V, ...]:
    """Return v, sign(v), sign(v) / (1 + (v / vs)^2)."""
    velocity = inputs["velocity"]
    sign, ratio = carrier.sign(velocity), carrier.div(velocity, shape[0])
    bottom = carrier.add(carrier.one, carrier.mul(ratio, ratio))
    return velocity, sign, carrier.div(sign, bottom)


def find_asymmetric_stribeck(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    exponent: float | None,
    bumps: int,
) -> tuple[V, ...]:
    """Return the asymmetric columns, and the fall by sign: one for both directions, or one for each."""
    halves = halve_by_direction(carrier, inputs["velocity"])
    fall = find_fall(carrier, inputs["velocity"], shape, exponent, is_positive=False)
    if bumps == 1:
        return *halves, carrier.mul(fall, carrier.sign(inputs["velocity"]))
    forward, backward = carrier.mul(fall, halves[1]), carrier.mul(fall, halves[3])
    return *halves[:2], forward, *halves[2:], backward


def find_improved(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    exponent: float | None,
    bias_everywhere: bool,
) -> tuple[V, ...]:
    """Return v, s, s exp(-(max(|v|, dq0) / vs)^gamma), and the bias; s = clip(v / dq0, -1, 1).

    Within |v| < dq0 friction is a straight line; the bias stands everywhere, or falls to zero at dq0.
    """
    velocity, edge = inputs["velocity"], shape[1]
    one = carrier.one
    size = carrier.absolute(velocity)
    ratio = carrier.div(velocity, edge)
    clipped = carrier.maximum(carrier.scale(-1.0, one), carrier.minimum(one, ratio))
    outside = carrier.maximum(size, edge)
    fall = find_fall(carrier, outside, shape, exponent, is_positive=True)
    bias = one
    if not bias_everywhere:
        bias = carrier.maximum(carrier.zero, carrier.sub(one, carrier.div(size, edge)))
    return velocity, clipped, carrier.mul(fall, clipped), bias


def find_shifted(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    exponent: float | None,
    shifted: bool,
) -> tuple[V, ...]:
    """Return the Stribeck columns and the bias one; at the velocity v - dq0 where `shifted`."""
    velocity = inputs["velocity"]
    if shifted:
        velocity = carrier.sub(velocity, shape[1])
    columns = find_stribeck_law(carrier, {"velocity": velocity}, shape, exponent=exponent)
    return *columns, carrier.one


def find_power_law(carrier: FrictionCarrier[V], inputs: Inputs[V], shape: Sequence[V]) -> tuple[V, ...]:
    """Return sign(v), |v|^delta sign(v)."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    return sign, carrier.mul(carrier.power(carrier.absolute(velocity), shape[0]), sign)


def find_makkar(carrier: FrictionCarrier[V], inputs: Inputs[V], shape: Sequence[V]) -> tuple[V, ...]:
    """Return tanh(g2 v) - tanh(g3 v), tanh(g5 v), v."""
    velocity = inputs["velocity"]
    rise, fall, dry = (carrier.tanh(carrier.mul(slope, velocity)) for slope in shape)
    return carrier.sub(rise, fall), dry, velocity


def find_load_dependent(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    shape: Sequence[V],
    *,
    exponent: float | None,
    falls: bool,
) -> tuple[V, ...]:
    """Return v, sign(v), |load| sign(v), and the fall times both signs where friction `falls`."""
    velocity = inputs["velocity"]
    sign = carrier.sign(velocity)
    loaded = carrier.mul(carrier.absolute(inputs["load"]), sign)
    if not falls:
        return velocity, sign, loaded
    fall = find_fall(carrier, velocity, shape, exponent, is_positive=False)
    return velocity, sign, loaded, carrier.mul(fall, sign), carrier.mul(fall, loaded)


def find_position_dependent(
    carrier: FrictionCarrier[V],
    inputs: Inputs[V],
    _shape: Sequence[V],
    *,
    orders: tuple[int, ...],
    gear: float,
    dry: bool,
) -> tuple[V, ...]:
    """Return v, sign(v), and cos, sin of k gear q for each order k, times sign(v) where friction is `dry`."""
    velocity, position = inputs["velocity"], inputs["position"]
    sign = carrier.sign(velocity)
    columns = [velocity, sign]
    for order in orders:
        angle = carrier.scale(order * gear, position)
        waves = (carrier.cos(angle), carrier.sin(angle))
        columns += [carrier.mul(wave, sign) if dry else wave for wave in waves]
    return tuple(columns)
