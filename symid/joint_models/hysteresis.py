"""Springs with hysteresis over any carrier: play, stop, dead zone, one step of the spring and its inverse.

    play       P_r = max(x - r, min(x + r, P_r before))          stop   E_r = x - P_r
    spring     v = k0 phi + k3 phi^3 + sum_i k_i E_i[phi]        tau = S(v)
    dead zone  S(v) = v + sum_j s_j max(v - R_j, 0), R_j > 0, + sum_j s_j min(v - R_j, 0), R_j < 0

Modified Prandtl-Ishlinskii model (Kuhnen, European Journal of Control 9 (2003) 407-418). A step is exact for
any length, as long as the input is monotone within it; `prandtl_ishlinskii` takes whole recordings.
Maxwell-slip (Iwan) elements are converted to `Elasticity`, whose numbers are those of a spring between motor
and link: tau_J = S(v) + D dphi, phi = theta - q. With
k_i >= 0 it is passive; its outer function has slope one at v = 0, so that v is in N m.

Supported: any number of stops and knees; the inverse of the spring with its knees; catalogue values of
harmonic drives (slope K1 up to torque T1, K2 up to T2, K3 beyond, wave generator blocked) as knees.
Not supported: the inverse of a cubic spring; elements in series with a damper.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate
from typing import Generic, TypeVar

from symid.joint_models.branches import Branch, add_all, clamp, refuse_element
from symid.joint_models.carriers import Carrier
from symid.serialization import Finite


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Stop:
    """A spring behind dry friction: it slips where its own torsion reaches `threshold` (rad or m).

    `stiffness` in N m/rad or N/m; None where it is to be identified.
    """

    threshold: Finite
    stiffness: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Knee:
    """A change of slope of the outer function: `slope` is added beyond the torque `threshold` (N m or N).

    A positive threshold acts above it, a negative one below it.
    """

    threshold: Finite
    slope: Finite


@dataclass(frozen=True, slots=True, kw_only=True)
class Elasticity:
    """The elastic element of a joint.

    Args:
        stiffness: k0, N m/rad or N/m: what is left when all stops slip; None where unknown.
        damping: D, N m s/rad or N s/m.
        cubic: k3, N m/rad^3 or N/m^3.
        stops: thresholds increasing.
        knees: thresholds increasing, negative ones first.
        branches: further ones in parallel, outside the outer function.
        backlash: half the gap at the input, rad or m: all that follows sees the input's play.
        offset: N m or N.
    """

    stiffness: float | None = None
    damping: float = 0.0
    cubic: float = 0.0
    stops: tuple[Stop, ...] = ()
    knees: tuple[Knee, ...] = ()
    branches: tuple[Branch, ...] = ()
    backlash: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Raise a RobotError for thresholds that do not increase or are zero, or an outer function's fall."""
        stops = [stop.threshold for stop in self.stops]
        knees = [knee.threshold for knee in self.knees]
        mistakes = []
        if any(not threshold > 0 for threshold in stops) or stops != sorted(set(stops)):
            mistakes.append("the thresholds of stops must be positive and increase, each once")
        if any(not threshold for threshold in knees) or knees != sorted(set(knees)):
            mistakes.append("the thresholds of knees must differ from 0 and increase, each once")
        slopes = {1.0: 1.0, -1.0: 1.0}
        for knee in sorted(self.knees, key=lambda knee: (knee.threshold < 0, abs(knee.threshold))):
            side = math.copysign(1.0, knee.threshold)
            slopes[side] += knee.slope
            if not slopes[side] > 0:
                text = f"beyond {knee.threshold:g} the outer function's slope is {slopes[side]:g}"
                mistakes.append(f"{text}; it must be positive")
        if not self.backlash >= 0.0:
            mistakes.append(f"the backlash is {self.backlash:g}; it must not be negative")
        refuse_element(mistakes)

    @property
    def is_plain(self) -> bool:
        """Return whether it has neither branches nor backlash nor offset."""
        return not (self.branches or self.backlash or self.offset)

    @property
    def initial_stiffness(self) -> float | None:
        """Return the stiffness right after a reversal, k0 + sum k_i; None where a part is unknown."""
        parts = [self.stiffness, *(stop.stiffness for stop in self.stops)]
        return None if None in parts else math.fsum(part or 0.0 for part in parts)


def compute_catalogue_knees(stiffnesses: Sequence[float], torques: Sequence[float]) -> tuple[Knee, ...]:
    """Return the knees that make a spring K1 one of K2 beyond T1 and K3 beyond T2, on both sides.

    The outer function's argument is K1 phi: the second knee stands where it is T1 + (T2 - T1) K1 / K2.
    `stiffnesses` are K1, K2, K3 in N m/rad, `torques` T1 and T2 in N m.

    Raises:
        RobotError: a value is not positive, or the torques do not increase.
    """
    mistakes = [] if all(value > 0 for value in stiffnesses) else ["K1, K2 and K3 must be positive"]
    mistakes += [] if 0 < torques[0] < torques[1] else ["T1 and T2 must be positive and increase"]
    refuse_element(mistakes)
    first, second, third = stiffnesses
    far = torques[0] + (torques[1] - torques[0]) * first / second
    pairs = ((torques[0], (second - first) / first), (far, (third - second) / first))
    sides = (-1.0, 1.0)
    found = (Knee(threshold=s * place, slope=slope) for place, slope in pairs for s in sides if slope)
    return tuple(sorted(found))


V = TypeVar("V")
Terms = tuple[tuple[V, V], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpringTerms(Generic[V]):
    """The numbers of an elastic joint in a carrier: k0; k3 or None; stops and knees as pairs.

    `stops` have threshold r_i (increasing) and stiffness k_i, `above` threshold R_j > 0 and slope s_j of
    knees, outwards, `below` the same for R_j < 0.
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


def compute_play(algebra: Carrier[V], value: V, threshold: V, memory: V) -> V:
    """Return the play after the input has gone to `value`: P = max(x - r, min(x + r, P before))."""
    return clamp(algebra, memory, algebra.sub(value, threshold), algebra.add(value, threshold))


def compute_outer_function(algebra: Carrier[V], value: V, above: Terms[V], below: Terms[V]) -> V:
    """Return S(v) = v + sum_j s_j S_j(v) with one-sided dead zones S_j."""
    result = value
    for terms, limit in ((above, algebra.maximum), (below, algebra.minimum)):
        for threshold, slope in terms:
            dead = limit(algebra.sub(value, threshold), algebra.zero)
            result = algebra.add(result, algebra.mul(slope, dead))
    return result


def _halve_square(algebra: Carrier[V], value: V) -> V:
    return algebra.scale(0.5, algebra.mul(value, value))


def compute_outer_integral(algebra: Carrier[V], value: V, above: Terms[V], below: Terms[V]) -> V:
    """Return G(v), the integral of S from 0 to v."""
    result = _halve_square(algebra, value)
    for terms, limit in ((above, algebra.maximum), (below, algebra.minimum)):
        for threshold, slope in terms:
            beyond = _halve_square(algebra, limit(algebra.sub(value, threshold), algebra.zero))
            result = algebra.add(result, algebra.mul(slope, beyond))
    return result


def compute_stored(algebra: Carrier[V], spring: SpringTerms[V], torsion: V, plays: Sequence[V]) -> V | None:
    """Return the energy that a spring stores, J, from any level; None for a cubic one with knees.

    U = sum_i w'_i [G(P'_i + r'_i) + G(P'_i - r'_i)] / 2 with P'_i = W_i P_i - sum_j>i k_j P_j; without knees
    k0 phi^2 / 2 + k3 phi^4 / 4 + sum_i k_i E_i^2 / 2, zero at rest.
    """
    if not (spring.above or spring.below):
        parts = [algebra.mul(spring.stiffness, _halve_square(algebra, torsion))]
        if spring.cubic is not None:
            quartic = _halve_square(algebra, algebra.mul(torsion, torsion))
            parts.append(algebra.scale(0.5, algebra.mul(spring.cubic, quartic)))
        for (_, stiffness), play in zip(spring.stops, plays, strict=True):
            parts.append(algebra.mul(stiffness, _halve_square(algebra, algebra.sub(torsion, play))))
        return add_all(algebra, parts)
    if spring.cubic is not None:
        return None
    inverse, _, _ = invert_spring(algebra, spring)
    slope, rest, images = spring.stiffness, algebra.zero, []
    for (_, stiffness), play in zip(reversed(spring.stops), reversed(plays), strict=True):
        images.append(algebra.sub(algebra.mul(slope, play), rest))
        rest = algebra.add(rest, algebra.mul(stiffness, play))
        slope = algebra.add(slope, stiffness)

    def integrate(value: V) -> V:
        return compute_outer_integral(algebra, value, spring.above, spring.below)

    total = algebra.mul(inverse.weights[0], integrate(algebra.sub(algebra.mul(slope, torsion), rest)))
    pieces = zip(inverse.weights[1:], inverse.thresholds, reversed(images), strict=True)
    for weight, radius, image in pieces:
        ends = [integrate(algebra.add(image, radius)), integrate(algebra.sub(image, radius))]
        total = algebra.add(total, algebra.mul(weight, algebra.scale(0.5, add_all(algebra, ends))))
    return total


def advance_spring(
    algebra: Carrier[V], spring: SpringTerms[V], torsion: V, memory: Sequence[V]
) -> tuple[V, tuple[V, ...]]:
    """Return the torque after the torsion phi (rad, m) has gone to `torsion`, and the plays there.

    `memory` has the plays before, rad or m, one a stop.
    """
    inner, plays = algebra.mul(spring.stiffness, torsion), []
    if spring.cubic is not None:
        cube = algebra.mul(algebra.mul(torsion, torsion), torsion)
        inner = algebra.add(inner, algebra.mul(spring.cubic, cube))
    for (threshold, stiffness), before in zip(spring.stops, memory, strict=True):
        plays.append(compute_play(algebra, torsion, threshold, before))
        inner = algebra.add(inner, algebra.mul(stiffness, algebra.sub(torsion, plays[-1])))
    return compute_outer_function(algebra, inner, spring.above, spring.below), tuple(plays)


def advance_inverse_spring(
    algebra: Carrier[V], inverse: tuple[Plays[V], Terms[V], Terms[V]], torque: V, memory: Sequence[V]
) -> tuple[V, tuple[V, ...]]:
    """Return the torsion after the torque (N m, N; no damping) has gone to `torque`, and the plays there.

    `inverse` comes from `invert_spring`; `memory` has the plays of the inverse before, N m or N, one a stop.
    """
    plays, above, below = inverse
    value, after = compute_outer_function(algebra, torque, above, below), []
    result = algebra.mul(plays.weights[0], value)
    for threshold, weight, before in zip(plays.thresholds, plays.weights[1:], memory, strict=True):
        after.append(compute_play(algebra, value, threshold, before))
        result = algebra.add(result, algebra.mul(weight, after[-1]))
    return result, tuple(after)


def invert_spring(algebra: Carrier[V], spring: SpringTerms[V]) -> tuple[Plays[V], Terms[V], Terms[V]]:
    """Return the inverse of a spring: its plays, and the slopes of its outer function above and below.

    The outer function of the inverse comes first and has slope one at zero; then the plays:
    phi = w'_0 v + sum_i w'_i P'_i[v] with v = S^-1(tau). The cubic part must be absent.
    """
    above, below = (invert_pieces(algebra, algebra.one, side) for side in (spring.above, spring.below))
    return invert_plays(algebra, gather_plays(algebra, spring)), above, below


def gather_plays(algebra: Carrier[V], spring: SpringTerms[V]) -> Plays[V]:
    """Return the plays of a spring: w_0 = k0 + sum k_i, w_i = -k_i."""
    first = reduce(algebra.add, (stiffness for _, stiffness in spring.stops), spring.stiffness)
    weights = (first, *(algebra.sub(algebra.zero, stiffness) for _, stiffness in spring.stops))
    return Plays(weights=weights, thresholds=tuple(threshold for threshold, _ in spring.stops))


def invert_pieces(algebra: Carrier[V], slope: V, terms: Terms[V]) -> Terms[V]:
    """Return the pieces of the inverse of a piecewise linear function that begins with `slope`.

    A_j = A_{j-1} + s_j,  R'_j = sum_{i <= j} A_{i-1} (R_i - R_{i-1}),  s'_j = -s_j / (A_j A_{j-1}).
    """
    before, image = algebra.zero, algebra.zero
    result = []
    for threshold, added in terms:
        image = algebra.add(image, algebra.mul(slope, algebra.sub(threshold, before)))
        after = algebra.add(slope, added)
        change = algebra.div(algebra.sub(algebra.zero, added), algebra.mul(after, slope))
        result.append((image, change))
        before, slope = threshold, after
    return tuple(result)


def invert_plays(algebra: Carrier[V], plays: Plays[V]) -> Plays[V]:
    """Return the inverse of a sum of plays that rises, itself a sum of plays."""
    terms = tuple(zip(plays.thresholds, plays.weights[1:], strict=True))
    pieces = invert_pieces(algebra, plays.weights[0], terms)
    weights = (algebra.div(algebra.one, plays.weights[0]), *(change for _, change in pieces))
    return Plays(weights=weights, thresholds=tuple(image for image, _ in pieces))


def invert_plays_memory(algebra: Carrier[V], plays: Plays[V], memory: Sequence[V]) -> tuple[V, ...]:
    """Return the memory of the inverse, P'_i = W_i P_i + sum_{j > i} w_j P_j."""
    slopes = list(accumulate(plays.weights, algebra.add))[1:]
    rest, result = algebra.zero, []
    for slope, weight, play in reversed(list(zip(slopes, plays.weights[1:], memory, strict=True))):
        result.append(algebra.add(algebra.mul(slope, play), rest))
        rest = algebra.add(rest, algebra.mul(weight, play))
    return tuple(reversed(result))


@dataclass(frozen=True, slots=True, kw_only=True)
class MaxwellElement:
    """A spring (N m/rad or N/m) in series with dry friction that holds up to `force` (N m or N)."""

    stiffness: float
    force: float


def convert_maxwell_elements(elements: Sequence[MaxwellElement]) -> tuple[Stop, ...]:
    """Return the stops that are these elements, thresholds increasing; equal thresholds are one stop.

    A RobotError for a stiffness or force that is not positive.
    """
    stiffness: dict[float, float] = {}
    for element in elements:
        text = f"stiffness {element.stiffness:g}, force {element.force:g}: both must be positive"
        refuse_element([] if element.stiffness > 0 and element.force > 0 else [text])
        threshold = element.force / element.stiffness
        stiffness[threshold] = stiffness.get(threshold, 0.0) + element.stiffness
    return tuple(Stop(threshold=key, stiffness=value) for key, value in sorted(stiffness.items()))
