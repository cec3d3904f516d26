"""The unknowns of the hysteresis-plus-friction problem: names, places, bounds, and what they mean.

Model card, grids, NlpOptions -> NlpLayout; values -> parameters and springs.

    x = [beta, IA, friction | Fs_i, vs_i | k0 .. km of joint 1, .. | slopes c of joint 1, ..]

The slope of the outer function is one at v = 0, which fixes the scale of the weights, and c_j beyond its j-th
knee on each side, so that knee j adds c_j - c_j-1: rising and passive means c_j > 0 and k_i >= 0.

Supported: knees on both sides with slopes of their own, or odd springs whose sides share them.
Not supported: bounds on base parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard
from symid.elastic.consistency import find_lower_bounds
from symid.elastic.nlp_options import NlpOptions
from symid.joint.stribeck import STRIBECK_PARAMETERS
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = ["NlpLayout", "SpringGrid", "SpringLayout", "build_layout", "build_spring", "flatten_slopes"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringLayout:
    """One joint's spring among the unknowns.

    Args:
        weights: places of k0 .. km; slopes: places of the slopes.
        thresholds: (m,) of the stops; knees: signed torques.
        slots: for each knee, the entry of `changes` that it belongs to.
        changes: (entries, slopes), differences: change of slope = changes @ c + offset.
        offset: (entries,).
    """

    weights: slice
    slopes: slice
    thresholds: FloatArray
    knees: tuple[float, ...]
    slots: tuple[int, ...]
    changes: FloatArray
    offset: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpLayout:
    """Places, names and bounds of all unknowns.

    Args:
        names: of the unknowns.
        lower, upper: (x,) bounds in SI units.
        dynamics: places of chi; excess, speed: places of Fs and vs, empty without Stribeck friction.
        springs: one a joint.
    """

    names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    dynamics: slice
    excess: slice
    speed: slice
    springs: tuple[SpringLayout, ...]

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return len(self.names)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringGrid:
    """What is fixed of one joint's spring.

    Args:
        thresholds: (m,) of the stops, rad or m; knees: signed torques, N m or N.
        stiffness: of a linear spring in its place, N m/rad or N/m; weights are bounded by a multiple.
        reach: largest torsion; a stop that never slips is one with k0, and its weight is fixed at zero.
    """

    thresholds: FloatArray
    knees: tuple[float, ...]
    stiffness: float
    reach: float


def build_layout(card: ModelCard, grids: Sequence[SpringGrid], options: NlpOptions) -> NlpLayout:
    """Return the unknowns.

    Args:
        card: names of the dynamic parameters.
        grids: one a joint.
        options: bounds, Stribeck friction, odd springs.
    """
    joints = range(1, card.size + 1)
    # A joint whose file states no rotor has one nevertheless, and it is found.
    rotors = [f"IA{joint}" for joint in joints]
    names = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    lower = [find_lower_bounds(card)]
    upper = [np.full(len(names), np.inf)]
    dynamics = slice(0, len(names))
    excess = speed = slice(len(names), len(names))
    if options.stribeck:
        excess = slice(len(names), len(names) + card.size)
        speed = slice(excess.stop, excess.stop + card.size)
        names += [f"{parameter.name}{joint}" for parameter in STRIBECK_PARAMETERS for joint in joints]
        lower += [np.zeros(card.size), np.full(card.size, options.speeds[0])]
        upper += [np.full(card.size, np.inf), np.full(card.size, options.speeds[1])]
    springs = []
    for joint, grid in zip(joints, grids, strict=True):
        tied = _tie_knees(grid.knees, odd=options.odd)
        springs.append(_place_spring(grid, tied, len(names)))
        names += [f"k{stop} of joint {joint}" for stop in range(len(grid.thresholds) + 1)]
        names += [f"slope beyond {place} of joint {joint}" for place in tied.names]
        least, limit = (factor * grid.stiffness for factor in (options.least_stiffness, options.weight_limit))
        count = len(tied.names)
        lower += [np.array([least]), np.zeros(len(grid.thresholds)), np.full(count, options.slopes[0])]
        upper += [np.array([limit]), np.where(grid.thresholds < grid.reach, limit, 0.0)]
        upper += [np.full(count, options.slopes[1])]
    return NlpLayout(
        names=tuple(names),
        lower=freeze(np.concatenate(lower)),
        upper=freeze(np.concatenate(upper)),
        dynamics=dynamics,
        excess=excess,
        speed=speed,
        springs=tuple(springs),
    )


def flatten_slopes(layout: NlpLayout, x: FloatArray, undetermined: Sequence[str]) -> FloatArray:
    """Return x (x,) with the slopes of that name as the ones before them: knees that no torque reaches."""
    flat = np.array(x)
    for spring in layout.springs:
        for entry, place in enumerate(range(spring.slopes.start, spring.slopes.stop)):
            if layout.names[place] in undetermined:
                before = np.flatnonzero(spring.changes[entry] < 0.0)
                flat[place] = flat[spring.slopes.start + before[0]] if before.size else 1.0
    return flat


def build_spring(spring: SpringLayout, values: FloatArray, least: float) -> Elasticity:
    """Return the spring of the unknowns `values` (x,); weights up to `least` N m/rad are zero."""
    weights = values[spring.weights]
    changes = spring.changes @ values[spring.slopes] + spring.offset
    knees = [
        Knee(threshold=torque, slope=float(changes[slot]))
        for torque, slot in sorted(zip(spring.knees, spring.slots, strict=True))
        if changes[slot]
    ]
    return Elasticity(
        stiffness=float(weights[0]),
        stops=tuple(
            Stop(threshold=float(threshold), stiffness=float(weight))
            for threshold, weight in zip(spring.thresholds, weights[1:], strict=True)
            if weight > least
        ),
        knees=tuple(knees),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _TiedKnees:
    """Names of the slopes; changes of slope = changes @ slopes + offset; the entry of each knee."""

    names: tuple[str, ...]
    changes: FloatArray
    offset: FloatArray
    slots: tuple[int, ...]


def _place_spring(grid: SpringGrid, tied: _TiedKnees, first: int) -> SpringLayout:
    weights = slice(first, first + len(grid.thresholds) + 1)
    return SpringLayout(
        weights=weights,
        slopes=slice(weights.stop, weights.stop + len(tied.names)),
        thresholds=freeze(grid.thresholds),
        knees=grid.knees,
        slots=tied.slots,
        changes=tied.changes,
        offset=tied.offset,
    )


def _tie_knees(knees: tuple[float, ...], *, odd: bool) -> _TiedKnees:
    """Return how slopes make the knees; on each side from zero outwards."""
    if odd:
        sides = [sorted({abs(knee) for knee in knees})]
    else:
        sides = [sorted((knee for knee in knees if knee * side > 0), key=abs) for side in (-1.0, 1.0)]
    order = [knee for side in sides for knee in side]
    changes = np.eye(len(order))
    offset = np.zeros(len(order))
    start = 0
    for side in sides:
        for place in range(start, start + len(side)):
            if place == start:
                offset[place] = -1.0
            else:
                changes[place, place - 1] = -1.0
        start += len(side)
    sign = "+-" if odd else ""
    return _TiedKnees(
        names=tuple(f"{sign}{knee:.6g}" for knee in order),
        changes=freeze(changes),
        offset=freeze(offset),
        slots=tuple(order.index(abs(knee) if odd else knee) for knee in knees),
    )
