# ruff: noqa: D102 - members that all branches share are described here

"""Branches of an element, in parallel with its spring: values, states, one exact step, stored energy.

    slip spring    f(E), E = x - P_r[x], f piecewise linear: a slider behind a spring of any shape
    relays         sum_i d_i ramp_i(x) + sum_i>j c_ij (ramp_ij(x) - s_ij)      Krasnosel'skii and Pokrovskii
    Bouc-Wen       f u, L du/dx = 1 - |u|^n (1 +- skew) while |u| grows, else 1 + |u|^n (2 loop - 1 -+ lean)
    bristles       a friction law with a state: Dahl, LuGre, Maxwell-slip
    attracted      Maxwell-slip elements that reach their level only slowly
    relaxation     df/dt = k dx/dt - f / T: a spring behind a damper

Of a branch, `needs_time` is whether its force depends on the velocity, `passive` whether no motion gives
work. Its slope, N m/rad or N/m, is at most `most_slope` at a held speed, at least `least_slope` over any way
without reversal. `start` gives the states where the input is at rest, come from below (`side` 1), from
above (-1) or virgin (0); `advance` what a step to another position leads to, without turning back. `values`
hold the numbers of `list_values` by name, in a carrier: floats, arrays, CasADi expressions, references of
generated code. Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989); Bouc 1967, Wen 1976, normalised
as by Ikhouane and Rodellar, Systems with Hysteresis (2007).

Supported: any carrier, any length of a step. Exact but for Bouc-Wen, whose error falls with the square of the
step over L (and is zero for n = 1 away from u = 0).
Not supported: Bouc-Wen outside |lean| <= 2 loop - 1, |skew| < 1, n >= 1, where it is not passive or bounded.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate, pairwise
from typing import ClassVar, Generic, TypeVar

from symid.errors import RobotError
from symid.joint_models.carriers import Carrier, build_float_carrier
from symid.joint_models.dynamic_friction import advance_memory, is_passive

V = TypeVar("V")


def refuse_element(mistakes: Sequence[str]) -> None:
    """Raise a RobotError with these sentences, if there are any."""
    RobotError.refuse(mistakes, code="robot.invalid-elasticity")


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementMotion(Generic[V]):
    """A step in a carrier, on which nothing turns back.

    Args:
        position: at its end, rad or m; way: to there from the position before.
        velocity: held on the way, rad/s or m/s; period: s. Only branches with `needs_time` use them.
    """

    position: V
    way: V
    velocity: V
    period: V


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchStep(Generic[V]):
    """What a step leads to: force (N m or N), states after it, stored energy (J)."""

    force: V
    states: tuple[V, ...]
    stored: V


def add_all(algebra: Carrier[V], values: Sequence[V]) -> V:
    """Return the sum of numbers, zero of none."""
    return reduce(algebra.add, values, algebra.zero)


def clamp(algebra: Carrier[V], value: V, low: V, high: V) -> V:
    """Return the value, held between `low` and `high`."""
    return algebra.maximum(low, algebra.minimum(high, value))


def _find_least(pieces: Iterable[tuple[float, float, float]]) -> float:
    """Return the least integral, J, of a force in straight pieces: forces at their ends, length."""
    total, least = 0.0, 0.0
    for force, after, length in pieces:
        if force < 0.0 < after:
            least = min(least, total - 0.5 * force * force * length / (after - force))
        total += 0.5 * (force + after) * length
        least = min(least, total)
    return least


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipSpring:
    """A slider behind a spring of any shape: force f(E), deflection E = x - P[x] between -r and r.

    Where f is flat at zero the spring has a gap (backlash). Iwan's element for f = k E; Prandtl-Ishlinskii
    stops with envelopes, as generalised by Al Janaideh, Rakheja and Su, Mechatronics 19 (2009) 656-670. It
    may slip earlier the faster it moves, at r / (1 + fall |v|), as dry friction that falls with the speed.

    Args:
        deflections: increasing, from -r to r, rad or m.
        forces: f there, N m or N; straight between.
        falls: of the lower and the upper bound, s/rad or s/m, not negative.
    """

    kind: ClassVar[str] = "slip"
    deflections: tuple[float, ...]
    forces: tuple[float, ...]
    falls: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Raise a RobotError for places that do not increase from -r to r, or a count that does not fit."""
        places = list(self.deflections)
        mistakes = []
        if len(places) < 2 or places != sorted(set(places)) or places[0] != -places[-1]:
            mistakes.append("deflections of a slip spring must increase, from minus its largest one to that")
        if len(places) != len(self.forces):
            mistakes.append(f"{len(places)} deflections of a slip spring need {len(places)} forces")
        if not all(map(math.isfinite, (*self.deflections, *self.forces))):
            mistakes.append("numbers of a slip spring must be finite")
        if not min(self.falls) >= 0.0:
            text = "falls of a slip spring must not be negative; viscous damping rises with the speed"
            mistakes.append(text)
        refuse_element(mistakes)

    @property
    def threshold(self) -> float:
        """Return the deflection r at which it slips, rad or m."""
        return self.deflections[-1]

    @property
    def needs_time(self) -> bool:
        return any(self.falls)

    @property
    def passive(self) -> bool:
        """Return whether no motion gives work: it brakes wherever it may slip, on both sides."""
        pairs = zip(self.deflections, self.forces, strict=True)
        if self.needs_time:
            return all(force * place >= 0.0 for place, force in pairs)
        return self.forces[0] <= 0.0 <= self.forces[-1]

    @property
    def _pieces(self) -> list[tuple[float, float, float]]:
        """Return the forces at the ends of every straight piece of f, and its length."""
        pairs = pairwise(zip(self.deflections, self.forces, strict=True))
        return [(force, after, end - start) for (start, force), (end, after) in pairs]

    def _list_slopes(self) -> list[float]:
        return [(after - force) / length for force, after, length in self._pieces]

    @property
    def most_slope(self) -> float:
        return max(0.0, *self._list_slopes())

    @property
    def least_slope(self) -> float:
        """Return the least slope of the force over a way without reversal, N m/rad or N/m.

        Minus infinity where it falls with the speed: over a short period a longer way is a higher speed.
        """
        if self.needs_time:
            return -math.inf
        return min(0.0, *self._list_slopes())

    def list_values(self) -> dict[str, float]:
        """Return the numbers by name: least (of the energy), e1, ... (deflections), f1, ... (forces)."""
        named = {"least": _find_least(self._pieces)}
        if self.needs_time:
            named |= {"fall_low": self.falls[0], "fall_high": self.falls[1]}
        named |= {f"e{k}": value for k, value in enumerate(self.deflections, start=1)}
        return named | {f"f{k}": value for k, value in enumerate(self.forces, start=1)}

    def start(self, algebra: Carrier[V], position: V, side: float) -> tuple[V, ...]:
        """Return the play where the input is at rest; `side` -1 to 1: the deflection over its bound."""
        return (algebra.sub(position, algebra.scale(side * self.threshold, algebra.one)),)

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        count = len(self.deflections)
        places = [values[f"e{k}"] for k in range(1, count + 1)]
        forces = [values[f"f{k}"] for k in range(1, count + 1)]
        low, high = places[0], places[-1]
        if self.needs_time:
            speed = algebra.absolute(motion.velocity)
            slower = [algebra.mul(values[name], speed) for name in ("fall_low", "fall_high")]
            pairs = zip((low, high), slower, strict=True)
            low, high = (algebra.div(bound, algebra.add(algebra.one, part)) for bound, part in pairs)
        least, most = algebra.sub(motion.position, high), algebra.sub(motion.position, low)
        play = clamp(algebra, states[0], least, most)
        # f, and its integral from the first place.
        bend = algebra.sub(motion.position, play)
        force, energy = forces[0], algebra.zero
        for (start, before), (end, after) in pairwise(zip(places, forces, strict=True)):
            gap = algebra.sub(end, start)
            part = clamp(algebra, algebra.sub(bend, start), algebra.zero, gap)
            slope = algebra.div(algebra.sub(after, before), gap)
            half = algebra.scale(0.5, algebra.mul(slope, algebra.mul(part, part)))
            energy = algebra.add(energy, algebra.add(algebra.mul(before, part), half))
            force = algebra.add(force, algebra.mul(slope, part))
        return BranchStep(force=force, states=(play,), stored=algebra.sub(energy, values["least"]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Relays:
    """Relays with ramps on a grid (discrete Preisach), after Krasnosel'skii and Pokrovskii.

    A state s_ij in [0, 1] rises along ramp(x - g_i) and falls along ramp(x - g_j), i > j, with ramp(z) =
    clamp(z / step, 0, 1). Its element c (ramp(x - m) - s_ij), m = (g_i + g_j) / 2, is passive for c >= 0: it
    stores c [R(x - m) - s (x - m) + step s^2 / 2], R the integral of ramp, and loses c (g_i - g_j) / 2 |ds|.

    Args:
        low: first place of the grid g_0, rad or m; step: between places, and length of the ramps.
        ramps: (L,) d_i, forces without memory, N m or N.
        weights: (L (L - 1) / 2,) c_ij, N m or N: (1, 0), (2, 0), (2, 1), (3, 0), ...
    """

    kind: ClassVar[str] = "relays"
    needs_time: ClassVar[bool] = False
    low: float
    step: float
    ramps: tuple[float, ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise a RobotError for a step that is not positive, or a count that does not fit."""
        count = len(self.ramps)
        mistakes = [] if self.step > 0.0 else ["the step of relays must be positive"]
        if len(self.weights) != (needed := count * (count - 1) // 2):
            mistakes.append(f"{count} ramps need {needed} relays, got {len(self.weights)}")
        refuse_element(mistakes)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Return (i, j) of every relay."""
        return tuple((i, j) for i in range(len(self.ramps)) for j in range(i))

    @property
    def passive(self) -> bool:
        """Return whether no loop gives work, and stored energy has a least value."""
        return all(weight >= 0.0 for weight in self.weights) and math.fsum(self.ramps) >= 0.0

    @property
    def most_slope(self) -> float:
        return (max(0.0, *self.ramps) + math.fsum(map(abs, self.weights))) / self.step

    @property
    def least_slope(self) -> float:
        """Return a bound below of the slope over a way without reversal, N m/rad or N/m.

        Exact for c >= 0: least from saturation, from where all relays move.
        """
        count = len(self.ramps)
        slopes = []
        for half in range(2 * count):
            place = half // 2
            rising = [self.ramps[place], self.ramps[place]]
            for pair, weight in zip(self.pairs, self.weights, strict=True):
                middle = weight if sum(pair) <= half <= sum(pair) + 1 else 0.0
                for way, end in enumerate(pair):
                    rising[way] += middle - (weight if end == place else 0.0) * (weight > 0.0)
            slopes += rising
        return min(0.0, *slopes) / self.step

    def list_values(self) -> dict[str, float]:
        """Return the numbers by name: low, step, least (of the energy), d1, ..., c2_1, c3_1, ..."""
        heights = pairwise(accumulate(self.ramps, initial=0.0))
        least = _find_least((force, after, self.step) for force, after in heights)
        named = {"low": self.low, "step": self.step, "least": least}
        named |= {f"d{k}": value for k, value in enumerate(self.ramps, start=1)}
        pairs = zip(self.pairs, self.weights, strict=True)
        return named | {f"c{i + 1}_{j + 1}": value for (i, j), value in pairs}

    def start(self, algebra: Carrier[V], position: V, side: float) -> tuple[V, ...]:
        """Return the states where the input is at rest, come from below (1), above (-1), or virgin (0).

        Virgin is as after cycles that died out there: every relay without force, at its middle ramp.
        """

        def place(number: float) -> V:
            edge = algebra.scale(self.low + number * self.step, algebra.one)
            return _ramp(algebra, algebra.sub(position, edge), algebra.scale(1.0 / self.step, algebra.one))

        return tuple(place(0.5 * (i + j + side * (i - j))) for i, j in self.pairs)

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        step, inverse = values["step"], algebra.div(algebra.one, values["step"])
        z = algebra.sub(motion.position, values["low"])

        def measure(half: int) -> V:
            return algebra.sub(z, algebra.scale(0.5 * half, step))

        heights = [_ramp(algebra, measure(half), inverse) for half in range(2 * len(self.ramps) - 1)]
        forces, energies, after = [], [], []
        for k, height in enumerate(heights[::2]):
            value, distance = values[f"d{k + 1}"], measure(2 * k)
            forces.append(algebra.mul(value, height))
            energies.append(algebra.mul(value, _integrate_ramp(algebra, distance, step, height)))
        for (i, j), before in zip(self.pairs, states, strict=True):
            value = values[f"c{i + 1}_{j + 1}"]
            state = clamp(algebra, before, heights[2 * i], heights[2 * j])
            distance, height = measure(i + j), heights[i + j]
            forces.append(algebra.mul(value, algebra.sub(height, state)))
            bent = algebra.scale(0.5, algebra.mul(step, algebra.mul(state, state)))
            energy = algebra.add(_integrate_ramp(algebra, distance, step, height), bent)
            energies.append(algebra.mul(value, algebra.sub(energy, algebra.mul(state, distance))))
            after.append(state)
        stored = algebra.sub(add_all(algebra, energies), values["least"])
        return BranchStep(force=add_all(algebra, forces), states=tuple(after), stored=stored)


def _ramp(algebra: Carrier[V], distance: V, inverse: V) -> V:
    return clamp(algebra, algebra.mul(distance, inverse), algebra.zero, algebra.one)


def _integrate_ramp(algebra: Carrier[V], distance: V, step: V, height: V) -> V:
    """Return the integral of ramp up to `distance`, where it has the value `height`."""
    beyond = algebra.maximum(algebra.sub(distance, step), algebra.zero)
    return algebra.add(algebra.scale(0.5, algebra.mul(step, algebra.mul(height, height))), beyond)


_SUBSTEPS = 4
_SMALLEST = 1e-30


@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWen:
    """A Bouc-Wen branch: a force `level` u, where u has no unit and stays within bounds near -1 and 1.

    `length` du/dx = 1 - |u|^n (1 + skew) where u > 0 grows, 1 - |u|^n (1 - skew) where u < 0 falls further,
    1 + (2 loop - 1 - lean) |u|^n where u > 0 falls, 1 + (2 loop - 1 + lean) |u|^n where u < 0 rises. Its
    initial stiffness is level / length, its bounds (1 + skew)^(-1/n) and -(1 - skew)^(-1/n). It stores
    level length u^2 / 2.

    Args:
        level: N m or N; length: rad or m.
        sharpness: n; loop: 1/2 for straight unloading, more for fuller loops.
        skew, lean: asymmetry while loading and while unloading.
    """

    kind: ClassVar[str] = "bouc_wen"
    needs_time: ClassVar[bool] = False
    level: float
    length: float
    sharpness: float = 1.0
    loop: float = 0.5
    skew: float = 0.0
    lean: float = 0.0

    def __post_init__(self) -> None:
        """Refuse, by a RobotError, numbers outside the class that `Supported` names."""
        allowed = (
            (math.isfinite(self.level), "level must be a finite number"),
            (self.length > 0, "length must be positive"),
            (self.sharpness >= 1, "sharpness must be at least 1"),
            (self.loop >= 0.5, "loop must be at least 1/2; below it a loop gives work"),
            (abs(self.skew) < 1, "skew must lie between -1 and 1; else one side has no bound"),
            (
                abs(self.lean) <= 2.0 * max(self.loop, 0.5) - 1.0,
                "lean must lie between 1 - 2 loop and 2 loop - 1; beyond, a loop gives work",
            ),
        )
        refuse_element([f"Bouc-Wen: {text}" for kept, text in allowed if not kept])

    @property
    def passive(self) -> bool:
        return self.level >= 0.0

    @property
    def most_slope(self) -> float:
        steepest = 1.0 + (2.0 * self.loop - 1.0 + abs(self.lean)) / (1.0 - abs(self.skew))
        return abs(self.level) * steepest / self.length

    @property
    def least_slope(self) -> float:
        return 0.0 if self.level >= 0.0 else -self.most_slope

    def list_values(self) -> dict[str, float]:
        names = ("level", "length", "sharpness", "loop", "skew", *(["lean"] if self.lean else []))
        return {name: getattr(self, name) for name in names}

    def start(self, algebra: Carrier[V], _position: V, side: float) -> tuple[V, ...]:
        bound = (1.0 + side * self.skew) ** (-1.0 / self.sharpness)
        return (algebra.scale(side * bound, algebra.one),)

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        length, power = values["length"], values["sharpness"]
        sign = algebra.sign(motion.way)
        way = algebra.div(algebra.absolute(motion.way), length)
        before = algebra.mul(sign, states[0])
        # Turned so that the input grows: first |u| falls where u < 0, then u grows towards its bound.
        release = algebra.sub(algebra.one, algebra.scale(2.0, values["loop"]))
        if "lean" in values:
            release = algebra.sub(release, algebra.mul(sign, values["lean"]))
        low = _relax(algebra, -1.0, algebra.minimum(before, algebra.zero), (way, release, power))
        rest = algebra.maximum(low, algebra.zero)
        growth = algebra.add(algebra.one, algebra.mul(sign, values["skew"]))
        high = _relax(algebra, 1.0, algebra.maximum(before, algebra.zero), (rest, growth, power))
        turned = algebra.add(algebra.minimum(low, algebra.zero), high)
        moved = algebra.absolute(sign)
        kept = algebra.mul(algebra.sub(algebra.one, moved), states[0])
        after = algebra.add(kept, algebra.mul(sign, turned))
        energy = algebra.scale(0.5, algebra.mul(length, algebra.mul(after, after)))
        level = values["level"]
        return BranchStep(force=algebra.mul(level, after), states=(after,), stored=algebra.mul(level, energy))


def _relax(algebra: Carrier[V], side: float, value: V, given: tuple[V, V, V]) -> V:
    """Return u after du/dx = 1 - factor |u|^n on one side of zero, one beyond: way, factor, n are given."""
    # Exponential Rosenbrock-Euler steps: exact for n = 1 while u keeps its sign, stable for any way.
    way, factor, power = given
    step = algebra.scale(1.0 / _SUBSTEPS, way)
    least = algebra.scale(_SMALLEST, algebra.one)
    for _ in range(_SUBSTEPS):
        size = algebra.add(algebra.maximum(algebra.scale(side, value), algebra.zero), least)
        height = algebra.power(size, power)
        rate = algebra.sub(algebra.one, algebra.mul(factor, height))
        # The rate falls with u on both sides: what grows slows down, what falls does so less and less.
        fall = algebra.mul(algebra.absolute(factor), algebra.mul(power, algebra.div(height, size)))
        if side < 0.0:
            # What has come beyond zero goes on at rate one; the caller lets it grow from zero again.
            inside = algebra.maximum(algebra.sign(algebra.scale(side, value)), algebra.zero)
            fall = algebra.mul(inside, fall)
        turn = algebra.add(algebra.mul(fall, step), least)
        half = algebra.tanh(algebra.scale(0.5, turn))
        share = algebra.div(algebra.scale(2.0, half), algebra.mul(algebra.add(algebra.one, half), turn))
        value = algebra.add(value, algebra.mul(rate, algebra.mul(step, share)))
    return value


_KEYS = {"dahl": "sigma0", "lugre": "sigma0", "maxwell-slip": "share1", "generalised-maxwell-slip": "share1"}
"""Laws with a state, and a value that each must have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BristleBranch:
    """A friction law with a state as a branch: Dahl, LuGre, Maxwell-slip, generalised Maxwell-slip.

    Args:
        law: its name in the catalogue.
        values: name and number of each: Fc, Fv, Fe, vs, gamma, sigma0, sigma1; stiffness1, share1, ...
    """

    kind: ClassVar[str] = "bristles"
    law: str
    values: tuple[tuple[str, float], ...]

    def __post_init__(self) -> None:
        """Raise a RobotError for a law without a state, values that it lacks, or that are out of bounds."""
        if self.law not in _KEYS:
            refuse_element([f"bristles of law {self.law!r}; known laws: {', '.join(_KEYS)}"])
        given, head = dict(self.values), f"bristles of {self.law}"
        mistakes = [f"{head}: {name} is missing" for name in ("Fc", _KEYS[self.law]) if name not in given]
        bounded = ("sigma0", "stiffness", "share", "Fc", "vs")
        positive = [name for name in given if name.startswith(bounded) and not given[name] > 0.0]
        mistakes += [f"{head}: {name} must be positive" for name in positive]
        if "Fe" in given and not given.get("Fc", 0.0) + given["Fe"] > 0.0:
            mistakes.append(f"{head}: Fc + Fe, the level of break-away, must be positive")
        refuse_element(mistakes)

    @property
    def needs_time(self) -> bool:
        given = dict(self.values)
        return any(given.get(name, 0.0) != 0.0 for name in ("Fv", "Fe", "sigma1"))

    @property
    def count(self) -> int:
        """Return the number of states."""
        return max(1, sum(name.startswith("stiffness") for name, _ in self.values))

    @property
    def passive(self) -> bool:
        """Return whether no motion gives work, as far as it is known."""
        return bool(is_passive(dict(self.values)))

    @property
    def most_slope(self) -> float:
        """Return the slope after a reversal, N m/rad or N/m."""
        given = dict(self.values)
        springs = (value for name, value in given.items() if name.startswith("stiffness"))
        return 2.0 * given["sigma0"] if "sigma0" in given else math.fsum(springs)

    @property
    def least_slope(self) -> float:
        """Return a bound below of the slope over the way for any period; minus infinity where there is none.

        What falls with the speed falls without bound over a short period, unless viscous friction is more.
        """
        given = dict(self.values)
        excess, viscous = given.get("Fe", 0.0), given.get("Fv", 0.0)
        if excess == 0.0 and given.get("sigma1", 0.0) == 0.0:
            return 0.0
        gamma = given.get("gamma", 2.0)
        # |d/dv exp(-(v / vs)^gamma)| is at most this over vs, for gamma >= 1.
        peak = (gamma - 1.0) / gamma
        steepest = gamma * peak**peak * math.exp(-peak) / given["vs"] if excess and gamma >= 1.0 else math.inf
        fall = abs(excess) * steepest if excess else 0.0
        # sigma1 (v - |v| sigma0 z / g) rises with v while |sigma0 z| <= g.
        return 0.0 if viscous >= fall and (excess == 0.0 or given.get("sigma1", 0.0) == 0.0) else -math.inf

    def list_values(self) -> dict[str, float]:
        return {"Fv": 0.0} | dict(self.values)

    def start(self, algebra: Carrier[V], _position: V, side: float) -> tuple[V, ...]:
        """Return the deflections where the input is at rest: `side` -1, 0, 1 times their bounds."""
        given = dict(self.values)
        level = side * (given["Fc"] + given.get("Fe", 0.0))
        numbers = range(1, self.count + 1) if "sigma0" not in given else ()
        bounds = [level * given[f"share{k}"] / given[f"stiffness{k}"] for k in numbers]
        return tuple(algebra.scale(bound, algebra.one) for bound in bounds or [level / given["sigma0"]])

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        force, after = advance_memory(algebra, values, motion.velocity, motion.way, states)
        names = ["sigma0"] if "sigma0" in values else [f"stiffness{k}" for k in range(1, len(states) + 1)]
        pairs = zip(names, after, strict=True)
        energies = [algebra.mul(values[name], algebra.mul(state, state)) for name, state in pairs]
        return BranchStep(force=force, states=after, stored=algebra.scale(0.5, add_all(algebra, energies)))


@dataclass(frozen=True, slots=True, kw_only=True)
class AttractedSlip:
    """Maxwell-slip elements that, once they slip, are attracted to their level, until they turn back.

    z_i is the bending of element i, g(v) = 1 + excess exp(-(v / speed)^2) the level of all. Held,
    dz/dx = 1, until |z| reaches r_i g; then dz/dt = sign(v) attraction (r_i - |z| / g) until v changes its
    sign. Lampaert, Al-Bender and Swevers, IEEE Trans. Control Syst. Technol. 11 (2003) 683-687; exact for a
    held velocity but for the sample in which an element begins to slip.

    Args:
        thresholds: r_i, rad or m, increasing; stiffnesses: k_i, N m/rad or N/m, of the force sum k_i z_i.
        excess: of the level at standstill; speed: rad/s or m/s; attraction: 1/s.
    """

    kind: ClassVar[str] = "attracted"
    needs_time: ClassVar[bool] = True
    passive: ClassVar[bool] = False
    least_slope: ClassVar[float] = -math.inf
    thresholds: tuple[float, ...]
    stiffnesses: tuple[float, ...]
    excess: float
    speed: float
    attraction: float

    def __post_init__(self) -> None:
        """Raise a RobotError for numbers that are not positive, or counts that do not fit."""
        places = list(self.thresholds)
        allowed = (
            (places == sorted(set(places)) and min(places, default=0.0) > 0.0, "thresholds must increase"),
            (len(places) == len(self.stiffnesses), f"{len(places)} thresholds need as many stiffnesses"),
            (self.excess > -1.0, "excess must be more than -1, so that there is a level"),
            (self.speed > 0.0, "speed must be positive"),
            (self.attraction > 0.0, "attraction must be positive"),
        )
        refuse_element([f"attracted slip: {text}" for kept, text in allowed if not kept])

    @property
    def most_slope(self) -> float:
        return math.fsum(map(abs, self.stiffnesses))

    def list_values(self) -> dict[str, float]:
        """Return the numbers by name: excess, speed, attraction, r1, k1, ..."""
        named = {name: getattr(self, name) for name in ("excess", "speed", "attraction")}
        pairs = zip(self.thresholds, self.stiffnesses, strict=True)
        for number, (threshold, stiffness) in enumerate(pairs, start=1):
            named |= {f"r{number}": threshold, f"k{number}": stiffness}
        return named

    def start(self, algebra: Carrier[V], _position: V, side: float) -> tuple[V, ...]:
        """Return bendings, then in which sense each slips; `side` -1, 0, 1 times their bounds, held."""
        level = side * (1.0 + self.excess)
        bends = [algebra.scale(level * threshold, algebra.one) for threshold in self.thresholds]
        return (*bends, *[algebra.zero for _ in bends])

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        count = len(self.thresholds)
        sign = algebra.sign(motion.way)
        moved = algebra.absolute(sign)
        share = algebra.div(motion.velocity, values["speed"])
        bell = algebra.exp(algebra.sub(algebra.zero, algebra.mul(share, share)))
        level = algebra.add(algebra.one, algebra.mul(values["excess"], bell))
        rate = algebra.div(algebra.mul(values["attraction"], motion.period), level)
        kept = algebra.exp(algebra.sub(algebra.zero, rate))
        way = algebra.absolute(motion.way)
        bends, senses, forces, energies = [], [], [], []
        for number in range(1, count + 1):
            before, sense = states[number - 1], states[count + number - 1]
            bound = algebra.mul(values[f"r{number}"], level)
            # Turned so that the input grows.
            bend = algebra.mul(sign, before)
            slips = algebra.maximum(algebra.mul(sign, sense), algebra.zero)
            slipped = algebra.add(bound, algebra.mul(kept, algebra.sub(bend, bound)))
            held = algebra.add(bend, way)
            begins = algebra.maximum(algebra.sign(algebra.sub(held, bound)), algebra.zero)
            held = algebra.minimum(held, algebra.maximum(bound, bend))
            turned = algebra.add(held, algebra.mul(slips, algebra.sub(slipped, held)))
            rest = algebra.sub(algebra.one, moved)
            bends.append(algebra.add(algebra.mul(rest, before), algebra.mul(sign, turned)))
            senses.append(
                algebra.add(algebra.mul(rest, sense), algebra.mul(sign, algebra.maximum(slips, begins)))
            )
            forces.append(algebra.mul(values[f"k{number}"], bends[-1]))
            energies.append(algebra.scale(0.5, algebra.mul(forces[-1], bends[-1])))
        total = add_all(algebra, energies)
        return BranchStep(force=add_all(algebra, forces), states=(*bends, *senses), stored=total)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """A spring behind a damper, df/dt = k dx/dt - f / T, exact for a held velocity; it stores f^2 / (2 k).

    Args:
        stiffness: k, N m/rad or N/m; time: T, s.
    """

    kind: ClassVar[str] = "relaxation"
    needs_time: ClassVar[bool] = True
    passive: ClassVar[bool] = True
    least_slope: ClassVar[float] = 0.0
    stiffness: float
    time: float

    def __post_init__(self) -> None:
        """Raise a RobotError for numbers that are not positive."""
        wrong = [name for name in ("stiffness", "time") if not getattr(self, name) > 0.0]
        refuse_element([f"relaxation: {name} must be positive" for name in wrong])

    @property
    def most_slope(self) -> float:
        return self.stiffness

    def list_values(self) -> dict[str, float]:
        return {"stiffness": self.stiffness, "time": self.time}

    def start(self, algebra: Carrier[V], _position: V, _side: float) -> tuple[V, ...]:
        return (algebra.zero,)

    def advance(
        self, algebra: Carrier[V], values: Mapping[str, V], motion: ElementMotion[V], states: Sequence[V]
    ) -> BranchStep[V]:
        stiffness, time = values["stiffness"], values["time"]
        half = algebra.tanh(algebra.scale(0.5, algebra.div(motion.period, time)))
        gone = algebra.div(algebra.scale(2.0, half), algebra.add(algebra.one, half))
        # The mean velocity, whatever it is at the end; nothing has moved where no time has passed.
        period = algebra.maximum(motion.period, algebra.scale(_SMALLEST, algebra.one))
        goal = algebra.mul(stiffness, algebra.mul(time, algebra.div(motion.way, period)))
        after = algebra.add(states[0], algebra.mul(gone, algebra.sub(goal, states[0])))
        energy = algebra.scale(0.5, algebra.div(algebra.mul(after, after), stiffness))
        return BranchStep(force=after, states=(after,), stored=energy)


Branch = SlipSpring | Relays | BoucWen | BristleBranch | AttractedSlip | Relaxation
"""What an element may have beside its spring."""


def count_states(branch: Branch) -> int:
    """Return the number of states of a branch."""
    return len(branch.start(build_float_carrier(), 0.0, 0.0))
