"""Stribeck friction: dry friction that falls while motion begins, as a Gaussian of the velocity.

Input: a velocity in any carrier with products, quotients, exponential and sign. Output: the torque that
stands on top of viscous and Coulomb friction, positive against positive velocity, and its derivatives.

    F(v) = Fs g(v),   g(v) = exp(-(v / vs)^2) sign(v)
    dg/dvs = 2 v^2 / vs^3 g,   d2g/dvs2 = (4 v^4 / vs^6 - 6 v^2 / vs^4) g

Fs is what friction is more at the start of motion than the Coulomb friction Fc, so that Fc + Fs is the static
friction; vs is the Stribeck velocity. Gaussian form: Armstrong-Helouvry, Dupont and Canudas de Wit,
Automatica 30 (1994) 1083-1138. sign(0) = 0; with a smoothing speed v0 > 0 the sign is tanh(v / v0).

Supported: floats, arrays, SymPy, CasADi: any carrier whose functions are given (`StribeckCarrier`).
Not supported: an exponent other than two; friction that depends on the direction.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from symid.joint.operators import Operators

__all__ = [
    "STRIBECK_PARAMETERS",
    "FallAlgebra",
    "StribeckAlgebra",
    "StribeckCarrier",
    "StribeckParameter",
    "find_gaussian_fall",
    "find_stribeck",
    "find_stribeck_rates",
    "find_stribeck_shape",
]

V = TypeVar("V")


@dataclass(frozen=True, slots=True, kw_only=True)
class StribeckParameter:
    """A parameter of the model: name, LaTeX, SI units, meaning, and the values that it may take."""

    name: str
    latex: str
    unit: str
    unit_prismatic: str
    meaning: str
    lower: float
    lower_is_allowed: bool


STRIBECK_PARAMETERS = (
    StribeckParameter(
        name="Fs",
        latex="F_s",
        unit="N m",
        unit_prismatic="N",
        meaning="static friction beyond Coulomb friction",
        lower=0.0,
        lower_is_allowed=True,
    ),
    StribeckParameter(
        name="vs",
        latex="v_s",
        unit="rad/s",
        unit_prismatic="m/s",
        meaning="Stribeck velocity",
        lower=0.0,
        lower_is_allowed=False,
    ),
)


class FallAlgebra(Protocol[V]):
    """What the fall of dry friction uses of a carrier."""

    def mul(self, left: V, right: V) -> V:
        """Return left * right."""

    def div(self, left: V, right: V) -> V:
        """Return left / right."""

    def scale(self, factor: float, value: V) -> V:
        """Return factor * value."""

    def exp(self, value: V) -> V:
        """Return the exponential."""


class StribeckAlgebra(FallAlgebra[V], Protocol[V]):
    """What the model uses of a carrier."""

    def add(self, left: V, right: V) -> V:
        """Return left + right."""

    def sign(self, value: V) -> V:
        """Return -1, 0 or 1."""

    def tanh(self, value: V) -> V:
        """Return the hyperbolic tangent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StribeckCarrier(Operators[V]):
    """A carrier whose numbers have the usual operators; its functions are given.

    `math.exp`, `math.tanh` serve floats, those of NumPy arrays, those of SymPy and CasADi expressions.
    """

    exp: Callable[[V], V]
    sign: Callable[[V], V]
    tanh: Callable[[V], V]


def find_gaussian_fall(algebra: FallAlgebra[V], velocity: V, speed: V) -> V:
    """Return exp(-(v / vs)^2), speed vs > 0."""
    ratio = algebra.div(velocity, speed)
    return algebra.exp(algebra.scale(-1.0, algebra.mul(ratio, ratio)))


def find_stribeck_shape(algebra: StribeckAlgebra[V], velocity: V, speed: V, smoothing: float = 0.0) -> V:
    """Return g(v), the friction for Fs = 1.

    Args:
        algebra: of the carrier.
        velocity: of the motor, rad/s or m/s.
        speed: vs > 0, rad/s or m/s.
        smoothing: v0 in rad/s or m/s; 0 for the plain sign.
    """
    fall = find_gaussian_fall(algebra, velocity, speed)
    if smoothing > 0.0:
        return algebra.mul(fall, algebra.tanh(algebra.scale(1.0 / smoothing, velocity)))
    return algebra.mul(fall, algebra.sign(velocity))


def find_stribeck(algebra: StribeckAlgebra[V], velocity: V, excess: V, speed: V, smoothing: float = 0.0) -> V:
    """Return Fs g(v), N m or N; `excess` Fs >= 0, the rest as in `find_stribeck_shape`."""
    return algebra.mul(excess, find_stribeck_shape(algebra, velocity, speed, smoothing))


def find_stribeck_rates(
    algebra: StribeckAlgebra[V], velocity: V, speed: V, smoothing: float = 0.0
) -> tuple[V, V, V]:
    """Return g, dg/dvs and d2g/dvs2."""
    shape = find_stribeck_shape(algebra, velocity, speed, smoothing)
    ratio = algebra.div(velocity, speed)
    square = algebra.mul(ratio, ratio)
    first = algebra.div(algebra.mul(algebra.scale(2.0, square), shape), speed)
    bend = algebra.add(algebra.scale(4.0, algebra.mul(square, square)), algebra.scale(-6.0, square))
    second = algebra.div(algebra.mul(bend, shape), algebra.mul(speed, speed))
    return shape, first, second
