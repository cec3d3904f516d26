"""A whole element: backlash, spring with stops and knees, damping, branches, offset; step, run, inverse.

    u = P_backlash[x],   y = S(k0 u + k3 u^3 + sum_i k_i E_i[u]) + D du/dt + sum of branches of u + offset

`Elasticity` and a way -> output, states and stored energy, over any carrier: what generated code, simulation
and fits run. States: position before, play of the backlash, plays of the stops, states of the branches.

    passive        the work int y dx is at least the change of the stored energy, offset left out
    invertible     y rises with x along every way without reversal, however short: then every y has one x

The inverse is that of plays in closed form where there is one (`invert_hysteresis`), else found step by step:
an interval that holds x is known from the least slope, and closed by regula falsi (Dowell and Jarratt, BIT 11
(1971) 168-174, the variant called Illinois) with every third step a bisection.

Supported: recordings at uneven times; a start from rest, or come from either side.
Not supported: stored energy of a cubic spring together with knees; the inverse through a backlash.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, zip_longest
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, RobotError
from symid.joint_models import branches, carriers, hysteresis as elements, prandtl_ishlinskii as operators

V = TypeVar("V")
Start = Literal["zero", "fresh", "below", "above"]
"""What an element remembers at the first sample: virgin at x = 0 and gone there; virgin there; come there
from below (stops at their upper bound) or from above."""
_SIDES: dict[Start, float] = {"zero": 0.0, "fresh": 0.0, "below": 1.0, "above": -1.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementStep(Generic[V]):
    """What a step leads to: output (N m or N), states, stored energy in J, None where not known."""

    output: V
    states: tuple[V, ...]
    stored: V | None


def _name_branches(elasticity: elements.Elasticity) -> list[tuple[str, branches.Branch]]:
    """Return the branches with the beginnings of their values' names: slip_, slip1_, slip2_, ..."""
    kinds = [branch.kind for branch in elasticity.branches]
    numbers = [kinds[: k + 1].count(kind) if kinds.count(kind) > 1 else "" for k, kind in enumerate(kinds)]
    heads = (f"{kind}{number}_" for kind, number in zip(kinds, numbers, strict=True))
    return list(zip(heads, elasticity.branches, strict=True))


def list_element_values(elasticity: elements.Elasticity) -> dict[str, float]:
    """Return the numbers of an element by name: backlash, k0, kc, D, offset, r1, k1, ..., R1, s1, ...

    Numbers of branches follow; what is zero for want of a part is left out. A RobotError where a stiffness is
    unknown.
    """
    terms = operators.read_spring_terms(elasticity)
    named = {"backlash": elasticity.backlash, "k0": terms.stiffness, "kc": elasticity.cubic}
    named |= {"D": elasticity.damping, "offset": elasticity.offset}
    named = {name: value for name, value in named.items() if value or name == "k0"}
    for k, (threshold, stiffness) in enumerate(terms.stops, start=1):
        named |= {f"r{k}": threshold, f"k{k}": stiffness}
    for k, (place, slope) in enumerate((*terms.above, *terms.below), start=1):
        named |= {f"R{k}": place, f"s{k}": slope}
    if elasticity.knees and not elasticity.cubic:
        # The least value of the formula of its energy, J.
        inverse, _, _ = elements.invert_spring(carriers.build_float_carrier(), terms)
        weights, radii = np.array(inverse.weights[1:]), np.array(inverse.thresholds)
        # S(p + r) + S(p - r) rises with p, and is zero between -r and r.
        low, high, arrays, sides = -radii, radii, carriers.build_numpy_carrier(), (terms.above, terms.below)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            ends = (middle + radii, middle - radii)
            above, under = (elements.compute_outer_function(arrays, end, *sides) for end in ends)
            below = above + under < 0.0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        ends = (low + radii, low - radii)
        above, under = (elements.compute_outer_integral(arrays, end, *sides) for end in ends)
        named["least"] = math.fsum((0.5 * weights * (above + under)).tolist())
    for head, branch in _name_branches(elasticity):
        named |= {head + name: value for name, value in branch.list_values().items()}
    return named


_VALUES = {
    "k": ((-1, 1, 0), "stiffness"),
    "kc": ((-3, 1, 0), "cubic stiffness"),
    "D": ((-1, 1, 1), "damping"),
    "fall_low": ((-1, 0, 1), "fall of the lower slip force with the speed"),
    "fall_high": ((-1, 0, 1), "fall of the upper slip force with the speed"),
    "sigma": ((-1, 1, 0), "stiffness before sliding"),
    "sigma1": ((-1, 1, 1), "damping before sliding"),
    "stiffness": ((-1, 1, 0), "stiffness"),
    "Fv": ((-1, 1, 1), "viscous friction"),
    "speed": ((1, 0, -1), "Stribeck speed"),
    "vs": ((1, 0, -1), "Stribeck speed"),
    "attraction": ((0, 0, -1), "rate at which slip approaches its level"),
    "time": ((0, 0, 1), "relaxation time"),
    "backlash": ((1, 0, 0), "backlash"),
    "r": ((1, 0, 0), "threshold of a stop"),
    "e": ((1, 0, 0), "deflection at a corner of the curve"),
    "low": ((1, 0, 0), "first input of the grid"),
    "step": ((1, 0, 0), "step of the grid"),
    "length": ((1, 0, 0), "input over which the force builds up"),
    "offset": ((0, 1, 0), "offset"),
    "R": ((0, 1, 0), "output at a knee"),
    "f": ((0, 1, 0), "output at a corner of the curve"),
    "d": ((0, 1, 0), "ramp without memory"),
    "c": ((0, 1, 0), "weight of a relay"),
    "level": ((0, 1, 0), "output at which it yields"),
    "Fc": ((0, 1, 0), "Coulomb friction"),
    "Fe": ((0, 1, 0), "static friction beyond Coulomb's"),
    "s": ((0, 0, 0), "change of slope at a knee"),
    "sharpness": ((0, 0, 0), "exponent of the transition"),
    "loop": ((0, 0, 0), "fullness of the loop"),
    "skew": ((0, 0, 0), "asymmetry while loading"),
    "lean": ((0, 0, 0), "asymmetry while unloading"),
    "excess": ((0, 0, 0), "excess of the level at standstill"),
    "share": ((0, 0, 0), "share of the level"),
    "gamma": ((0, 0, 0), "exponent of the Stribeck curve"),
}
"""Powers of the units of the input, the output and s, and meaning, by the beginning of a name."""


def describe_value(name: str) -> tuple[tuple[int, int, int], str]:
    """Return the powers of the units of a value of `list_element_values`, and what it is in words."""
    stems = (name, name.rstrip("0123456789_"))
    known = [key for stem in stems for key in _VALUES if stem == key or stem.endswith(f"_{key}")]
    return _VALUES[max(known, key=len)] if known else ((0, 0, 0), "")


def write_value_unit(name: str, units: tuple[str, str]) -> str:
    """Return the unit of a value of `list_element_values`, from those of input and output; empty for none."""
    powers, _ = describe_value(name)
    ordered = list(zip((powers[1], powers[0], powers[2]), (units[1], units[0], "s"), strict=True))
    above, below = (
        " ".join(
            unit if abs(power) == 1 else f"{unit}^{abs(power)}" for power, unit in ordered if power * sign > 0
        )
        for sign in (1, -1)
    )
    return f"{above or 1}/{below}" if below else above


def needs_time(elasticity: elements.Elasticity) -> bool:
    """Return whether the output depends on how fast the input moves."""
    return elasticity.damping != 0.0 or any(branch.needs_time for branch in elasticity.branches)


def start_element(
    algebra: carriers.Carrier[V], elasticity: elements.Elasticity, position: V, side: float = 0.0
) -> tuple[V, ...]:
    """Return the states where the input is at rest at `position`, rad or m.

    `side` 0: virgin there; 1: come from below, so that all stops are at their upper bound; -1: from above.
    """

    def shift(place: V, distance: float) -> V:
        return algebra.sub(place, algebra.scale(side * distance, algebra.one))

    centre, states = position, [position]
    if elasticity.backlash:
        centre = shift(position, elasticity.backlash)
        states.append(centre)
    states += [shift(centre, stop.threshold) for stop in elasticity.stops]
    for branch in elasticity.branches:
        states += branch.start(algebra, centre, side)
    return tuple(states)


def start_states(elasticity: elements.Elasticity, position: float, side: float = 0.0) -> tuple[float, ...]:
    """Return the states of `start_element` as numbers."""
    return start_element(carriers.build_float_carrier(), elasticity, position, side)


def advance_element(
    algebra: carriers.Carrier[V],
    elasticity: elements.Elasticity,
    values: Mapping[str, V],
    held: tuple[V, V],
    states: Sequence[V],
    *,
    velocity: V | None = None,
    taken: Sequence[branches.BranchStep[V] | None] = (),
) -> ElementStep[V]:
    """Return what an element does when its input has gone to a position, without turning back on the way.

    Args:
        algebra: of the numbers.
        elasticity: its structure.
        values: its numbers, named by `list_element_values`.
        held: position, rad or m, and length of the step, s; the length counts where `needs_time`, > 0.
        states: before, as `start_states` orders them.
        velocity: rad/s or m/s, where it is known better than as way over length of the step.
        taken: steps of the branches that are known already, None for others; none where no branch is known.
    """
    (position, period), at = held, 1
    before, after = states[0], [position]
    if elasticity.backlash:
        low, high = (change(position, values["backlash"]) for change in (algebra.sub, algebra.add))
        before, position = states[1], branches.clamp(algebra, states[1], low, high)
        after.append(position)
        at = 2
    way = algebra.sub(position, before)
    if velocity is None:
        velocity = algebra.div(way, period) if needs_time(elasticity) else algebra.zero
    motion = branches.ElementMotion(position=position, way=way, velocity=velocity, period=period)
    terms = _gather_spring(elasticity, values, algebra)
    count = len(terms.stops)
    force, plays = elements.advance_spring(algebra, terms, position, states[at : at + count])
    stored = elements.compute_stored(algebra, terms, position, plays)
    if stored is not None and "least" in values:
        stored = algebra.sub(stored, values["least"])
    after += plays
    at += count
    forces = [force]
    if elasticity.damping:
        forces.append(algebra.mul(values["D"], velocity))
    for (head, branch), known in zip_longest(_name_branches(elasticity), taken):
        size = branches.count_states(branch)
        own = {name: values[head + name] for name in branch.list_values()}
        step = known or branch.advance(algebra, own, motion, states[at : at + size])
        forces.append(step.force)
        after += step.states
        stored = None if stored is None else algebra.add(stored, step.stored)
        at += size
    if elasticity.offset:
        forces.append(values["offset"])
    return ElementStep(output=branches.add_all(algebra, forces), states=tuple(after), stored=stored)


def _gather_spring(
    elasticity: elements.Elasticity, values: Mapping[str, V], algebra: carriers.Carrier[V]
) -> elements.SpringTerms[V]:
    """Return the numbers of the spring in a carrier; without stiffness, stops and knees it is zero."""
    terms = operators.read_spring_terms(elasticity)
    knees = [(values[f"R{k}"], values[f"s{k}"]) for k in range(1, len(elasticity.knees) + 1)]
    return elements.SpringTerms(
        stiffness=values["k0"] if terms.stiffness else algebra.zero,
        cubic=values["kc"] if elasticity.cubic else None,
        stops=tuple((values[f"r{k}"], values[f"k{k}"]) for k in range(1, len(terms.stops) + 1)),
        above=tuple(knees[: len(terms.above)]),
        below=tuple(knees[len(terms.above) :]),
    )


_HALVINGS = 60


def is_passive_element(elasticity: elements.Elasticity) -> bool:
    """Return whether no motion gets work out of the element beyond what it stores, its offset left out."""
    terms = operators.read_spring_terms(elasticity)
    signs = (terms.stiffness, elasticity.cubic, elasticity.damping, *(k for _, k in terms.stops))
    kept = all(value >= 0.0 for value in signs) and not elasticity.backlash
    return kept and all(branch.passive for branch in elasticity.branches)


def find_least_slope(elasticity: elements.Elasticity) -> float:
    """Return a bound below of dy/dx on ways without reversal, N m/rad or N/m; it may be minus infinity."""
    if elasticity.cubic < 0.0:
        return -math.inf
    terms = operators.read_spring_terms(elasticity)
    least = min(accumulate((k for _, k in reversed(terms.stops)), initial=terms.stiffness))
    sides = (terms.above, terms.below)
    outer = [slope for side in sides for slope in accumulate((s for _, s in side), initial=1.0)]
    spring = least * (min(outer) if least > 0.0 else max(outer))
    return spring + math.fsum(branch.least_slope for branch in elasticity.branches)


def find_most_slope(elasticity: elements.Elasticity) -> float:
    """Return a bound above of dy/dx at a held speed, its cubic part and damping left out, N m/rad or N/m."""
    knees = (math.fsum(k.slope for k in elasticity.knees if k.threshold * side > 0.0) for side in (1, -1))
    slopes = math.fsum(branch.most_slope for branch in elasticity.branches)
    return (elasticity.initial_stiffness or 0.0) * (1.0 + max(0.0, *knees)) + slopes


def describe_inverse(elasticity: elements.Elasticity) -> str:
    """Return why an element has no inverse, in a sentence; empty where it has one."""
    if elasticity.backlash:
        return "within the backlash the output stays while the input moves"
    if elasticity.damping < 0.0:
        return "the viscous damping is negative"
    if any(not math.isfinite(branch.least_slope) for branch in elasticity.branches):
        return "friction that falls with the speed (Stribeck) gives several inputs for one output"
    if elasticity.cubic < 0.0:
        return "the cubic spring softens, so that the output falls at large inputs"
    if not find_least_slope(elasticity) > 0.0:
        return "the output levels off or falls somewhere, so that outputs have many inputs, or none"
    return ""


def has_closed_inverse(elasticity: elements.Elasticity) -> bool:
    """Return whether there is an inverse, of plays and knees alone: `invert_step` gives it."""
    plain = not (elasticity.cubic or elasticity.branches or elasticity.damping)
    return plain and not describe_inverse(elasticity)


def invert_step(
    algebra: carriers.Carrier[V],
    elasticity: elements.Elasticity,
    values: Mapping[str, V],
    output: V,
    states: Sequence[V],
) -> V:
    """Return the input at which an element has an output, where the inverse has a closed form.

    `values` and `states`, before the step, are those of `advance_element`, which then moves the states there.
    """
    terms = _gather_spring(elasticity, values, algebra)
    plays = elements.gather_plays(algebra, terms)
    memory = elements.invert_plays_memory(algebra, plays, states[1:])
    goal = algebra.sub(output, values["offset"]) if elasticity.offset else output
    found, _ = elements.advance_inverse_spring(algebra, elements.invert_spring(algebra, terms), goal, memory)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementRun:
    """What an element does along a recording.

    Args:
        output: (N,) N m or N; stored: (N,) energy in J, NaN where it has no closed form.
        states: after the last sample.
    """

    output: FloatArray
    stored: FloatArray
    states: tuple[float, ...]


SteppedBranch = branches.BoucWen | branches.BristleBranch | branches.AttractedSlip | branches.Relaxation
"""Branches whose states follow from those before, step by step."""
BranchPath = tuple[FloatArray, ...]
"""Input, way to each sample, rad or m, velocity, rad/s or m/s, and length of the step, s, (N,) each."""
BranchRunner = Callable[[SteppedBranch, BranchPath, FloatArray], FloatArray]
"""Returns states (n), force and stored energy of a branch after every sample of a path, (N, n + 2), from the
states before it (n,)."""


def run_element(
    elasticity: elements.Elasticity,
    position: FloatArray,
    time: FloatArray | None = None,
    *,
    start: Start | Sequence[float] = "zero",
    velocity: FloatArray | None = None,
    runner: BranchRunner | None = None,
) -> ElementRun:
    """Return what an element does along a recording whose input does not turn back between samples.

    Args:
        elasticity: of known numbers.
        position: (N,) input, rad or m.
        time: (N,) s, increasing; None where the element does not need it.
        start: what it remembers before the first sample, or its states there.
        velocity: (N,) rad/s or m/s; None where it is the way to each sample over the time that it took.
        runner: steps branches; None for CasADi's virtual machine.

    Raises:
        RobotError: an element that depends on the speed and no time.
    """
    position = np.asarray(position, dtype=np.float64)
    if isinstance(start, str):
        first = float(position[0]) if len(position) and start != "zero" else 0.0
        states = start_states(elasticity, first, _SIDES[start])
    else:
        states = tuple(map(float, start))
    periods = _read_periods(elasticity, len(position), time)
    if velocity is None:
        velocity = np.diff(position, prepend=states[0]) / periods
    # Every state (N + 1,) along the recording, and the steps of branches.
    traces, at = [np.concatenate([states[:1], position])], 1
    if elasticity.backlash:
        gap, memory = np.array([elasticity.backlash]), np.array(states[1:2])
        traces.append(np.concatenate([memory, operators.compute_plays(position, gap, memory)[:, 0]]))
        at = 2
    middle = traces[-1]
    radii = np.array([stop.threshold for stop in elasticity.stops])
    memory = np.array(states[at : at + len(radii)])
    traces += list(np.vstack([memory, operators.compute_plays(middle[1:], radii, memory)]).T)
    at += len(radii)
    path, taken = (middle[1:], np.diff(middle), velocity, periods), []
    for branch in elasticity.branches:
        size = branches.count_states(branch)
        trace, steps = trace_branch(branch, path, states[at : at + size], runner)
        traces += list(trace.T)
        taken.append(steps)
        at += size
    step = advance_element(
        carriers.build_numpy_carrier(),
        elasticity,
        {name: np.asarray(value) for name, value in list_element_values(elasticity).items()},
        (position, periods),
        [trace[:-1] for trace in traces],
        velocity=np.asarray(velocity, dtype=np.float64),
        taken=taken,
    )
    stored = np.full(len(position), np.nan) if step.stored is None else step.stored
    return ElementRun(
        output=freeze(np.broadcast_to(step.output, position.shape)),
        stored=freeze(np.broadcast_to(stored, position.shape)),
        states=tuple(float(trace[-1]) for trace in traces),
    )


def _read_periods(elasticity: elements.Elasticity, count: int, time: FloatArray | None) -> FloatArray:
    """Return the lengths (N,) of the steps, s: the first as the second, as its way is that of the start."""
    if time is None:
        if needs_time(elasticity):
            text = "this element depends on the speed: give the time of the samples"
            raise RobotError(Notice(code="robot.element-time", text=text))
        return np.ones(count)
    steps = np.diff(np.asarray(time, dtype=np.float64))
    return np.concatenate([steps[:1], steps]) if count > 1 else np.ones(count)


def trace_branch(
    branch: branches.Branch, path: BranchPath, states: Sequence[float], runner: BranchRunner | None = None
) -> tuple[FloatArray, branches.BranchStep[FloatArray] | None]:
    """Return states (N + 1, n) of a branch along a path, the first those before it, and what steps led to.

    The latter is None where the states are found without.
    """
    (position, _, velocity, _), memory, steps = path, np.array(states, dtype=np.float64), None
    if isinstance(branch, branches.SlipSpring):
        speed = np.abs(velocity)
        low, high = (-branch.threshold / (1.0 + fall * speed) for fall in branch.falls)
        turns = None if any(branch.falls) else operators.find_turns(position)
        after = operators.compute_clamps((position + high)[:, None], (position - low)[:, None], memory, turns)
    elif isinstance(branch, branches.Relays):
        places = branch.low + branch.step * np.array(branch.pairs, dtype=np.float64).reshape(-1, 2).T
        ramps = [np.clip((position[:, None] - edge) / branch.step, 0.0, 1.0) for edge in places]
        after = operators.compute_clamps(ramps[0], ramps[1], memory, operators.find_turns(position))
    else:
        found = (runner or run_branch)(branch, path, memory)
        after = found[:, :-2]
        steps = branches.BranchStep(force=found[:, -2], states=tuple(after.T), stored=found[:, -1])
    return np.vstack([memory, after]), steps


def run_branch(branch: SteppedBranch, path: BranchPath, states: FloatArray) -> FloatArray:
    """Return what a `BranchRunner` returns, step by step in CasADi's virtual machine."""
    count, values = len(path[0]), list(branch.list_values().values())
    if not count:
        return np.empty((0, len(states) + 2))
    table = np.tile(np.array(values)[:, None], (1, count))
    found = _accumulate(strip_branch(branch), count)(states, np.vstack(path), table)
    return np.hstack([part.full().T for part in found])


@lru_cache(maxsize=32)
def _accumulate(plain: SteppedBranch, count: int) -> Any:  # noqa: ANN401  casadi
    return build_branch_step(plain).mapaccum("branch", count, 1)


def strip_branch(branch: SteppedBranch) -> SteppedBranch:
    """Return a branch of the same structure with numbers that do not matter."""
    match branch:
        case branches.BristleBranch():
            return replace(branch, values=tuple((name, 1.0) for name, _ in branch.values))
        case branches.AttractedSlip():
            places = tuple(float(k) for k in range(1, len(branch.thresholds) + 1))
            return branches.AttractedSlip(
                thresholds=places, stiffnesses=places, excess=0.0, speed=1.0, attraction=1.0
            )
        case branches.BoucWen():
            return branches.BoucWen(level=1.0, length=1.0, loop=1.0, lean=0.5 if branch.lean else 0.0)
        case branches.Relaxation():
            return branches.Relaxation(stiffness=1.0, time=1.0)


def build_branch_step(plain: SteppedBranch) -> Any:  # noqa: ANN401  casadi
    """Return CasADi's function (states, a sample of the path, numbers) -> states after it, (force, energy).

    The numbers, in the order of `list_values`, are inputs: one function serves all branches of a structure.
    """
    import casadi

    names = tuple(plain.list_values())
    states = casadi.SX.sym("states", branches.count_states(plain))
    given, numbers = casadi.SX.sym("motion", 4), casadi.SX.sym("numbers", len(names))
    position, way, velocity, period = casadi.vertsplit(given)
    motion = branches.ElementMotion(position=position, way=way, velocity=velocity, period=period)
    values = dict(zip(names, casadi.vertsplit(numbers), strict=True))
    step = plain.advance(carriers.build_casadi_carrier(), values, motion, casadi.vertsplit(states))
    found = casadi.vertcat(*step.states), casadi.vertcat(step.force, step.stored)
    return casadi.Function("step", [states, given, numbers], found)


_Step = ElementStep[float]
_ROUNDING = 4.0 * 2.0**-52
_MARGIN = 1.0 + 1e-9
_MOST_STEPS = 200


def invert_element(
    elasticity: elements.Elasticity,
    output: FloatArray,
    time: FloatArray | None = None,
    *,
    start: Start | Sequence[float] = "zero",
) -> FloatArray:
    """Return the input (N,), rad or m, at which an element has the output (N,), N m or N.

    Args:
        elasticity: of known numbers.
        output: (N,) N m or N.
        time: (N,) s, increasing, where the element needs it.
        start: as for `run_element`; "fresh", "below" and "above" stand where the first output is.

    Raises:
        RobotError: the element has no inverse (`describe_inverse`), or needs time.
    """
    reason = describe_inverse(elasticity)
    if reason:
        text = f"the element has no inverse: {reason}"
        raise RobotError(Notice(code="robot.no-inverse", text=text))
    output = np.asarray(output, dtype=np.float64)
    algebra, values = carriers.build_float_carrier(), list_element_values(elasticity)
    slope = find_least_slope(elasticity)
    if isinstance(start, str):
        side, first = _SIDES[start], 0.0

        def stand(place: float) -> _Step:
            before = start_states(elasticity, place, side)
            return advance_element(algebra, elasticity, values, (place, 1.0), before)

        # It stands where the first output is with a memory come there.
        if start != "zero" and len(output):
            first = find_input(stand, float(output[0]), 0.0, slope)
        states = start_states(elasticity, first, side)
    else:
        states = tuple(map(float, start))
    periods = _read_periods(elasticity, len(output), time)
    if has_closed_inverse(elasticity):
        return operators.invert_hysteresis(elasticity, output - elasticity.offset, np.array(states[1:]))
    found = np.empty(len(output))
    for k, (goal, period) in enumerate(zip(output.tolist(), periods.tolist(), strict=True)):

        def move(place: float, before: tuple[float, ...] = states, period: float = period) -> _Step:
            return advance_element(algebra, elasticity, values, (place, period), before)

        found[k] = find_input(move, goal, states[0], slope)
        states = move(float(found[k])).states
    return found


def find_input(step: Callable[[float], _Step], goal: float, start: float, slope: float) -> float:
    """Return x with step(x).output = goal, which rises by at least `slope` > 0 a unit of x.

    The search begins at `start`. It ends where the error or the interval is at rounding.
    """
    first = step(start).output
    error = first - goal
    enough = _ROUNDING * max(abs(first), abs(goal))
    if abs(error) <= enough:
        return start
    bound = start - _MARGIN * error / slope
    ends = (bound, step(bound).output - goal), (start, error)
    (low, low_error), (high, high_error) = ends if error > 0.0 else ends[::-1]
    side = 0
    for count in range(_MOST_STEPS):
        middle = high - high_error * (high - low) / (high_error - low_error)
        if count % 3 == 2 or not low < middle < high:
            middle = low + 0.5 * (high - low)
        error = step(middle).output - goal
        if abs(error) <= enough or not low < middle < high:
            return middle
        # An end that stays twice counts half, so that the other one is passed (Illinois).
        if error < 0.0:
            low, low_error, high_error = middle, error, high_error * (0.5 if side < 0 else 1.0)
            side = -1
        else:
            high, high_error, low_error = middle, error, low_error * (0.5 if side > 0 else 1.0)
            side = 1
    return low + 0.5 * (high - low)
