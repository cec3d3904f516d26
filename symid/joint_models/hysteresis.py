"""Springs with hysteresis over any carrier: play, stop, dead zone, one step of the spring and its inverse.

Numbers of any carrier with products, quotients, maxima and minima -> torque or torsion, and the plays after
the step.

    play       P_r = max(x - r, min(x + r, P_r before))          stop   E_r = x - P_r
    spring     v = k0 phi + k3 phi^3 + sum_i k_i E_i[phi]        tau = S(v)
    dead zone  S(v) = v + sum_j s_j max(v - R_j, 0), R_j > 0, + sum_j s_j min(v - R_j, 0), R_j < 0

A step is exact for any length, as long as the input is monotone within it. Floats, fractions, mpmath,
SymPy, CasADi and the values of generated code are carriers; `prandtl_ishlinskii` has the same for whole
recordings.
Equations: Kuhnen, European Journal of Control 9 (2003) 407-418, modified Prandtl-Ishlinskii model.

The same spring as other papers write it, from and to `Elasticity`:

    scale      (k, s, R) with outer slope a at zero is (a k, s / a, a R) with slope one
    Maxwell    a spring k behind dry friction f is a stop of threshold f / k, stiffness k (Maxwell-slip, Iwan)

Supported: any number of stops and knees; the inverse of the spring with its knees; any positive outer
slope.
Not supported: the inverse of a cubic spring; elements in series with a damper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from symid.errors import Notice, RobotError
from symid.joint_models.carriers import Carrier
from symid.robot import Elasticity, Knee, Stop

V = TypeVar("V")


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


def compute_play(algebra: Carrier[V], value: V, threshold: V, memory: V) -> V:
    """Return the play of `threshold` after the input has gone to `value`, from `memory`.

    P = max(x - r, min(x + r, P before)).
    """
    lower = algebra.sub(value, threshold)
    upper = algebra.add(value, threshold)
    return algebra.maximum(lower, algebra.minimum(upper, memory))


def compute_outer_function(algebra: Carrier[V], value: V, above: Terms[V], below: Terms[V]) -> V:
    """Return S(v) = v + sum_j s_j S_j(v) with one-sided dead zones S_j."""
    result = value
    for threshold, slope in above:
        dead = algebra.maximum(algebra.sub(value, threshold), algebra.zero)
        result = algebra.add(result, algebra.mul(slope, dead))
    for threshold, slope in below:
        dead = algebra.minimum(algebra.sub(value, threshold), algebra.zero)
        result = algebra.add(result, algebra.mul(slope, dead))
    return result


def compute_spring_torque(algebra: Carrier[V], spring: SpringTerms[V], torsion: V, plays: Sequence[V]) -> V:
    """Return tau = S(k0 phi + k3 phi^3 + sum_i k_i (phi - P_i)) for plays that are known."""
    linear = algebra.mul(spring.stiffness, torsion)
    if spring.cubic is not None:
        square = algebra.mul(torsion, torsion)
        linear = algebra.add(linear, algebra.mul(spring.cubic, algebra.mul(square, torsion)))
    for (_, stiffness), play in zip(spring.stops, plays, strict=True):
        linear = algebra.add(linear, algebra.mul(stiffness, algebra.sub(torsion, play)))
    return compute_outer_function(algebra, linear, spring.above, spring.below)


def advance_spring(
    algebra: Carrier[V], spring: SpringTerms[V], torsion: V, memory: Sequence[V]
) -> tuple[V, tuple[V, ...]]:
    """Return the torque after the torsion has gone to `torsion`, and the plays there.

    Args:
        algebra: the carrier.
        spring: numbers of the joint.
        torsion: phi, rad or m.
        memory: plays before, rad or m, one a stop.
    """
    pairs = zip(spring.stops, memory, strict=True)
    plays = tuple(compute_play(algebra, torsion, threshold, before) for (threshold, _), before in pairs)
    return compute_spring_torque(algebra, spring, torsion, plays), plays


def advance_inverse_spring(
    algebra: Carrier[V],
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
    value = compute_outer_function(algebra, torque, above, below)
    pairs = zip(plays.thresholds, memory, strict=True)
    after = tuple(compute_play(algebra, value, threshold, before) for threshold, before in pairs)
    result = algebra.mul(plays.weights[0], value)
    for weight, play in zip(plays.weights[1:], after, strict=True):
        result = algebra.add(result, algebra.mul(weight, play))
    return result, after


def invert_spring(algebra: Carrier[V], spring: SpringTerms[V]) -> tuple[Plays[V], Terms[V], Terms[V]]:
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


def invert_plays(algebra: Carrier[V], plays: Plays[V]) -> Plays[V]:
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


def invert_plays_memory(algebra: Carrier[V], plays: Plays[V], memory: Sequence[V]) -> tuple[V, ...]:
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


def invert_outer_terms(algebra: Carrier[V], terms: Terms[V]) -> Terms[V]:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class MaxwellElement:
    """A spring (N m/rad or N/m) in series with dry friction that holds up to `force` (N m or N)."""

    stiffness: float
    force: float


def convert_to_normal_form(elasticity: Elasticity, outer_slope: float) -> Elasticity:
    """Return the spring with outer slope one that gives the same torque.

    Args:
        elasticity: stiffnesses and knees as they stand beside an outer function of slope `outer_slope` at
            zero: tau = outer_slope v + sum_j s_j S_j(v).
        outer_slope: positive.

    Raises:
        RobotError: the slope is not positive, or the result is no elasticity.
    """
    if not outer_slope > 0:
        text = f"the outer function's slope at zero is {outer_slope:g}; it must be positive"
        raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
    knees = elasticity.knees
    return Elasticity(
        stiffness=_scale(elasticity.stiffness, outer_slope),
        damping=elasticity.damping,
        cubic=elasticity.cubic * outer_slope,
        stops=tuple(
            Stop(threshold=stop.threshold, stiffness=_scale(stop.stiffness, outer_slope))
            for stop in elasticity.stops
        ),
        knees=tuple(
            Knee(threshold=knee.threshold * outer_slope, slope=knee.slope / outer_slope) for knee in knees
        ),
    )


def _scale(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def convert_maxwell_elements(elements: Sequence[MaxwellElement]) -> tuple[Stop, ...]:
    """Return the stops that are these elements, thresholds increasing; equal thresholds are one stop.

    Raises:
        RobotError: a stiffness or force is not positive.
    """
    stiffness: dict[float, float] = {}
    for element in elements:
        if not (element.stiffness > 0 and element.force > 0):
            text = f"stiffness {element.stiffness:g}, force {element.force:g}: both must be positive"
            raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
        threshold = element.force / element.stiffness
        stiffness[threshold] = stiffness.get(threshold, 0.0) + element.stiffness
    return tuple(Stop(threshold=key, stiffness=value) for key, value in sorted(stiffness.items()))


def list_maxwell_elements(elasticity: Elasticity) -> tuple[MaxwellElement, ...]:
    """Return the stops of an elasticity as springs behind dry friction, those of no stiffness left out."""
    return tuple(
        MaxwellElement(stiffness=stop.stiffness, force=stop.stiffness * stop.threshold)
        for stop in elasticity.stops
        if stop.stiffness
    )
