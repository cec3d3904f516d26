"""Springs that lose energy: play, stop, dead zone, one step of the model and of its inverse.

Input: numbers of any carrier that has products, quotients, maxima and minima. Output: torque or torsion, and
the plays after the step.

    play       P_r = max(x - r, min(x + r, P_r before))          stop   E_r = x - P_r
    spring     v = k0 phi + k3 phi^3 + sum_i k_i E_i[phi]        tau = S(v)
    dead zone  S(v) = v + sum_j s_j max(v - R_j, 0), R_j > 0, + sum_j s_j min(v - R_j, 0), R_j < 0

A step is exact however long it is, as long as the input is monotone within it. Floats, fractions, mpmath,
SymPy, CasADi and the values of generated code are carriers; `plays` has the same for many samples at once.
Equations: Kuhnen, European Journal of Control 9 (2003) 407-418, modified Prandtl-Ishlinskii model.

Supported: any number of stops and knees, inverse of the spring with its knees.
Not supported: the inverse of a cubic spring.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from symid.joint.operators import Operators

__all__ = [
    "HysteresisAlgebra",
    "OperatorCarrier",
    "Plays",
    "SpringTerms",
    "find_inverse_step",
    "find_outer",
    "find_play",
    "find_plays_torque",
    "find_step",
    "find_stop",
    "invert_outer_terms",
    "invert_plays",
    "invert_plays_memory",
    "invert_spring",
]

V = TypeVar("V")


class HysteresisAlgebra(Protocol[V]):
    """What these definitions use of a carrier."""

    @property
    def zero(self) -> V:
        """Return the number zero."""

    @property
    def one(self) -> V:
        """Return the number one."""

    def add(self, left: V, right: V) -> V:
        """Return left + right."""

    def sub(self, left: V, right: V) -> V:
        """Return left - right."""

    def mul(self, left: V, right: V) -> V:
        """Return left * right."""

    def div(self, left: V, right: V) -> V:
        """Return left / right."""

    def maximum(self, left: V, right: V) -> V:
        """Return the greater of two."""

    def minimum(self, left: V, right: V) -> V:
        """Return the smaller of two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorCarrier(Operators[V]):
    """A carrier whose numbers have the usual operators; its maximum and minimum are given.

    `max` and `min` serve floats, fractions and mpmath, `numpy.maximum` and `numpy.minimum` arrays,
    `sympy.Max` and `sympy.Min` expressions, `casadi.fmax` and `casadi.fmin` those of CasADi.
    """

    zero: V
    one: V
    maximum: Callable[[V, V], V]
    minimum: Callable[[V, V], V]


Terms = tuple[tuple[V, V], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringTerms(Generic[V]):
    """The numbers of an elastic joint in a carrier.

    Args:
        stiffness: k0.
        cubic: k3; None where there is none.
        stops: threshold r_i and stiffness k_i of each stop, thresholds increasing.
        above: threshold R_j > 0 and slope s_j of each knee, outwards.
        below: the same for R_j < 0, outwards.
    """

    stiffness: V
    cubic: V | None = None
    stops: Terms[V] = ()
    above: Terms[V] = ()
    below: Terms[V] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Plays(Generic[V]):
    """A sum of plays, w0 x + sum_i w_i P_i[x]: weights w0..wm, thresholds r1..rm."""

    weights: tuple[V, ...]
    thresholds: tuple[V, ...]


def find_play(algebra: HysteresisAlgebra[V], value: V, threshold: V, memory: V) -> V:
    """Return the play of `threshold` after the input has gone to `value`, from `memory`.

    P = max(x - r, min(x + r, P before)).
    """
    lower = algebra.sub(value, threshold)
    upper = algebra.add(value, threshold)
    return algebra.maximum(lower, algebra.minimum(upper, memory))


def find_stop(algebra: HysteresisAlgebra[V], value: V, threshold: V, memory: V) -> V:
    """Return the stop of `threshold`: what the play leaves of the input, E = x - P."""
    return algebra.sub(value, find_play(algebra, value, threshold, memory))


def find_outer(algebra: HysteresisAlgebra[V], value: V, above: Terms[V], below: Terms[V]) -> V:
    """Return S(v) = v + sum_j s_j S_j(v) with one-sided dead zones S_j."""
    result = value
    for threshold, slope in above:
        dead = algebra.maximum(algebra.sub(value, threshold), algebra.zero)
        result = algebra.add(result, algebra.mul(slope, dead))
    for threshold, slope in below:
        dead = algebra.minimum(algebra.sub(value, threshold), algebra.zero)
        result = algebra.add(result, algebra.mul(slope, dead))
    return result


def find_plays_torque(
    algebra: HysteresisAlgebra[V], spring: SpringTerms[V], torsion: V, plays: Sequence[V]
) -> V:
    """Return tau = S(k0 phi + k3 phi^3 + sum_i k_i (phi - P_i)) for plays that are known."""
    linear = algebra.mul(spring.stiffness, torsion)
    if spring.cubic is not None:
        square = algebra.mul(torsion, torsion)
        linear = algebra.add(linear, algebra.mul(spring.cubic, algebra.mul(square, torsion)))
    for (_, stiffness), play in zip(spring.stops, plays, strict=True):
        linear = algebra.add(linear, algebra.mul(stiffness, algebra.sub(torsion, play)))
    return find_outer(algebra, linear, spring.above, spring.below)


def find_step(
    algebra: HysteresisAlgebra[V], spring: SpringTerms[V], torsion: V, memory: Sequence[V]
) -> tuple[V, tuple[V, ...]]:
    """Return the torque after the torsion has gone to `torsion`, and the plays there.

    Args:
        algebra: the carrier.
        spring: numbers of the joint.
        torsion: phi, rad or m.
        memory: plays before, rad or m, one a stop.
    """
    pairs = zip(spring.stops, memory, strict=True)
    plays = tuple(find_play(algebra, torsion, threshold, before) for (threshold, _), before in pairs)
    return find_plays_torque(algebra, spring, torsion, plays), plays


def find_inverse_step(
    algebra: HysteresisAlgebra[V],
    inverse: tuple[Plays[V], Terms[V], Terms[V]],
    torque: V,
    memory: Sequence[V],
) -> tuple[V, tuple[V, ...]]:
    """Return the torsion after the torque has gone to `torque`, and the plays of the inverse there.

    Args:
        algebra: the carrier.
        inverse: what `invert_spring` gives.
        torque: tau, N m or N, without damping.
        memory: plays of the inverse before, N m or N, one a stop.
    """
    plays, above, below = inverse
    value = find_outer(algebra, torque, above, below)
    pairs = zip(plays.thresholds, memory, strict=True)
    after = tuple(find_play(algebra, value, threshold, before) for threshold, before in pairs)
    result = algebra.mul(plays.weights[0], value)
    for weight, play in zip(plays.weights[1:], after, strict=True):
        result = algebra.add(result, algebra.mul(weight, play))
    return result, after


def invert_spring(
    algebra: HysteresisAlgebra[V], spring: SpringTerms[V]
) -> tuple[Plays[V], Terms[V], Terms[V]]:
    """Return the inverse of a spring: its plays, and the slopes of its outer function above and below.

    The outer function of the inverse comes first and has slope one at zero; then the plays:
    phi = w'_0 v + sum_i w'_i P'_i[v] with v = S^-1(tau). The cubic part must be absent.
    """
    weights = [spring.stiffness]
    for _, stiffness in spring.stops:
        weights[0] = algebra.add(weights[0], stiffness)
        weights.append(algebra.sub(algebra.zero, stiffness))
    thresholds = tuple(threshold for threshold, _ in spring.stops)
    plays = invert_plays(algebra, Plays(weights=tuple(weights), thresholds=thresholds))
    return plays, invert_outer_terms(algebra, spring.above), invert_outer_terms(algebra, spring.below)


def invert_plays(algebra: HysteresisAlgebra[V], plays: Plays[V]) -> Plays[V]:
    """Return the inverse of a sum of plays, itself a sum of plays.

    w'_0 = 1 / w_0, w'_i = -w_i / (W_i W_{i-1}), r'_i = sum_{j <= i} w_j (r_i - r_j), with the cumulative
    slopes W_i = w_0 + ... + w_i, all positive.
    """
    slope = plays.weights[0]
    weights = [algebra.div(algebra.one, slope)]
    thresholds: list[V] = []
    before, image = algebra.zero, algebra.zero
    for weight, threshold in zip(plays.weights[1:], plays.thresholds, strict=True):
        image = algebra.add(image, algebra.mul(slope, algebra.sub(threshold, before)))
        after = algebra.add(slope, weight)
        weights.append(algebra.div(algebra.sub(algebra.zero, weight), algebra.mul(after, slope)))
        thresholds.append(image)
        before, slope = threshold, after
    return Plays(weights=tuple(weights), thresholds=tuple(thresholds))


def invert_plays_memory(algebra: HysteresisAlgebra[V], plays: Plays[V], memory: Sequence[V]) -> tuple[V, ...]:
    """Return the memory of the inverse, P'_i = W_i P_i + sum_{j > i} w_j P_j."""
    slope = plays.weights[0]
    slopes = []
    for weight in plays.weights[1:]:
        slope = algebra.add(slope, weight)
        slopes.append(slope)
    rest, result = algebra.zero, []
    for slope, weight, play in reversed(list(zip(slopes, plays.weights[1:], memory, strict=True))):
        result.append(algebra.add(algebra.mul(slope, play), rest))
        rest = algebra.add(rest, algebra.mul(weight, play))
    return tuple(reversed(result))


def invert_outer_terms(algebra: HysteresisAlgebra[V], terms: Terms[V]) -> Terms[V]:
    """Return one side of the inverse of an outer function, outwards.

    R'_j = S(R_j), s'_j = -s_j / (A_j A_{j-1}) with the slopes A_j = 1 + s_1 + ... + s_j.
    """
    slope, before, image = algebra.one, algebra.zero, algebra.zero
    result = []
    for threshold, added in terms:
        image = algebra.add(image, algebra.mul(slope, algebra.sub(threshold, before)))
        after = algebra.add(slope, added)
        change = algebra.div(algebra.sub(algebra.zero, added), algebra.mul(after, slope))
        result.append((image, change))
        before, slope = threshold, after
    return tuple(result)
