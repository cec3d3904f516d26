# ruff: noqa: D102 - methods that `ElementFamily` describes

"""Families of elements: for given shape values the output is linear in coefficients.

    y = sum_j c_j Phi_j(x; s)       s: thresholds, lengths, exponents;  c: stiffnesses and forces

Path, shape values -> columns Phi (N, m), bounds of c for a passive element, and the `Elasticity` that they
make. Each family says where a search of its shape may begin. The fit adds what any element may have: a gap
before it, a spring that relaxes beside it, viscous and cubic parts, an offset.

Supported: thresholds on a grid that the search does not move (Prandtl-Ishlinskii, relays); up to five shape
values that it does.
Not supported: several branches of one kind.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import final

import numpy as np
from numpy.typing import NDArray

from symid import joint_models
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import run_compiled_branch
from symid.identification.judge import POLICY, numerics

GRID = 16
"""Thresholds, relays and places of a grid."""
STARTS = 4
"""Values of a kind where a search may begin; and searches, from the best of all."""
SAMPLES = 2000
"""Of a search; more would only slow it down."""
EXACT = 1e-3
"""Of an output: elements are not followed more exactly between samples, so that less proves nothing."""


def list_lengths(x: FloatArray, reach: float, count: int) -> FloatArray:
    """Return lengths (count,), even in their logarithm: from the mean step of samples (N,) to a reach."""
    # Samples at rest have no step, and no reach.
    step = max(float(np.mean(np.abs(np.diff(x)))), numerics.EXACT * reach, numerics.TINY)
    return np.asarray(np.geomspace(step, max(reach, step), count, endpoint=False))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementPath(FrozenArrays):
    """An input as fits see it.

    Args:
        position: (N,) rad or m; velocity: (N,) rad/s or m/s; period: (N,) of the steps, s.
        start: what the element remembers before the first sample.
        begins: first samples of recordings that stand one after the other, each from `start`; none of one.
    """

    position: FloatArray
    velocity: FloatArray
    period: FloatArray
    start: joint_models.Start = "zero"
    begins: tuple[int, ...] = ()

    def split(self) -> "list[ElementPath]":
        """Return the path of every recording."""
        columns = (np.split(part, self.begins[1:]) for part in (self.position, self.velocity, self.period))
        parts = zip(*columns, strict=True)
        return [ElementPath(position=x, velocity=v, period=h, start=self.start) for x, v, h in parts]

    @property
    def reach(self) -> float:
        """Return half the range of the input."""
        return 0.5 * float(np.ptp(self.position))

    @property
    def speed(self) -> float:
        """Return the largest speed of the input; one where it is at rest."""
        return float(np.max(np.abs(self.velocity))) or 1.0

    def list_lengths(self, count: int) -> FloatArray:
        """Return lengths (count,), even in their logarithm, from the mean step to below the reach."""
        return list_lengths(self.position, self.reach, count)

    @property
    def origin(self) -> tuple[float, float]:
        """Return where the element was before, and on which side of its loop: 1 below, -1 above, 0 virgin."""
        begin = 0.0 if self.start == "zero" else float(self.position[0])
        return begin, {"below": 1.0, "above": -1.0}.get(self.start, 0.0)

    def compute_plays(self, radii: FloatArray) -> FloatArray:
        """Return plays (N, m) of the input for thresholds (m,)."""
        begin, side = self.origin
        if self.begins[1:]:
            return np.concatenate([part.compute_plays(radii) for part in self.split()])
        return joint_models.compute_plays(self.position, radii, begin - side * radii)

    def trace(self, branch: joint_models.Branch) -> FloatArray:
        """Return the states (N, n) of a branch after every sample."""
        if self.begins[1:]:
            return np.concatenate([part.trace(branch) for part in self.split()])
        begin, side = self.origin
        states = branch.start(joint_models.build_float_carrier(), begin, side)
        path = (self.position, np.diff(self.position, prepend=begin), self.velocity, self.period)
        return joint_models.trace_branch(branch, path, states, run_compiled_branch)[0][1:]


Limits = tuple[FloatArray, FloatArray]
"""Least and largest coefficients (m,)."""


class ElementFamily(ABC):
    """A family of elements."""

    name: str
    needs_time: bool = False
    has_offset: bool = True
    """Whether the fit adds a constant; not where the columns hold one."""
    searched: bool = True
    """Whether the shape is improved by a search."""
    falling: bool = False
    """Whether slip springs have a level that falls with the speed."""
    signed: tuple[bool, ...] = ()
    """Of each value of the shape, whether it may be negative; none may where nothing is said."""
    brakes: bool = False
    """Whether all coefficients but the first, a spring, must brake even where the element may be active."""

    @abstractmethod
    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        """Return shapes where a search may begin."""

    @abstractmethod
    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return the columns (N, m)."""

    def list_limits(self, count: int, *, passive: bool) -> Limits:
        """Return the bounds of the coefficients: none, or zero from below where passive."""
        low = np.full(count, -np.inf)
        if passive or self.brakes:
            low[0 if passive else 1 :] = 0.0
        return low, np.full(count, np.inf)

    @abstractmethod
    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        """Return the element, without the columns that the fit adds."""

    def list_penalties(self, count: int) -> FloatArray:
        """Return rows (k, m) whose products with the coefficients are held small, of m = `count`."""
        return np.empty((0, count))

    def describe(self) -> tuple[str, ...]:
        """Return what distinguishes this form of the model from its others."""
        return ()


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Stops(ElementFamily):
    """Prandtl-Ishlinskii, stops of either sign: on a grid, or where a search puts them; none is a spring.

    With `far`, rad or m, the spring is stiffer on one side of zero, and holds up to there.
    """

    count: int
    name: str = "prandtl-ishlinskii"
    searched: bool = False
    far: float | None = None

    def describe(self) -> tuple[str, ...]:
        place = "from the data" if self.searched else "on a grid"
        return (f"{self.count} thresholds {place}" if self.count else "no memory",)

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        if not self.searched:
            return [path.list_lengths(self.count)]
        return [np.array(some) for some in combinations(path.list_lengths(2 * STARTS).tolist(), self.count)]

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        x = path.position[:, None]
        # Both sides together are the linear spring.
        springs = [np.maximum(x, 0.0), np.minimum(x, 0.0)] if self.far else [x]
        return np.hstack([*springs, x - path.compute_plays(shape)])

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        springs, weights = np.split(coefficients, [2 if self.far else 1])
        joined = [(r, float(np.sum(weights[shape == r]))) for r in np.unique(shape).tolist()]
        stops = tuple(joint_models.Stop(threshold=r, stiffness=k) for r, k in joined if k != 0.0)
        spring = joint_models.Elasticity(stiffness=float(springs.min()), stops=stops)
        if not self.far:
            return spring
        up, down = (self.far * (springs - springs.min())).tolist()
        places, forces = (-self.far, 0.0, self.far), (-down, 0.0, up)
        return replace(spring, branches=(joint_models.SlipSpring(deflections=places, forces=forces),))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class NonlinearStops(ElementFamily):
    """Slip springs of thresholds r_i and piecewise linear forces at relative places; falls with the speed."""

    places: tuple[float, ...]
    count: int
    falling: bool = False
    needs_time: bool = False
    name: str = "nonlinear-stops"
    has_offset: bool = False

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        # Falls that hardly matter at the largest speed.
        tail = [POLICY.relevance / path.speed] * 2 if self.falling else []
        return [np.append(some, tail) for some in Stops(count=self.count, searched=True).list_starts(path)]

    def describe(self) -> tuple[str, ...]:
        form = f"{'one' if self.count == 1 else 'two'} of {len(self.places)} places"
        return (form, "falling with the speed") if self.falling else (form,)

    def _split(self, shape: FloatArray) -> tuple[FloatArray, tuple[float, float]]:
        falls = (float(shape[-2]), float(shape[-1])) if self.falling else (0.0, 0.0)
        return shape[: self.count], falls

    @property
    def _free(self) -> NDArray[np.bool_]:
        """Return which places (count, l) have a force: at rest a second spring has none."""
        free = np.ones((self.count, len(self.places)), dtype=bool)
        free[1:, len(self.places) // 2] = False
        return free

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return x, then hats over the deflection of every slip spring."""
        radii, falls = self._split(shape)
        columns, places = [path.position], np.array(self.places)
        for radius, free in zip(radii.tolist(), self._free, strict=True):
            slider = joint_models.SlipSpring(deflections=(-radius, radius), forces=(0.0, 0.0), falls=falls)
            bend = (path.position - path.trace(slider)[:, 0]) / radius
            columns += [np.interp(bend, places, unit) for unit in np.eye(len(places))[free]]
        return np.column_stack(columns)

    def list_limits(self, count: int, *, passive: bool) -> Limits:
        """Return bounds of k0 and of the forces: those at the ends brake, with falls all do."""
        low, high = ElementFamily.list_limits(self, count, passive=False)
        if passive:
            places = np.broadcast_to(self.places, self._free.shape)[self._free]
            bound = (np.abs(places) == 1.0) | self.falling
            low[0], low[1:][bound & (places >= 0.0)], high[1:][bound & (places <= 0.0)] = 0.0, 0.0, 0.0
        # What must be zero has bounds as narrow as the solver takes them.
        return low, np.where(low == high, numerics.TINY, high)

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        radii, falls = self._split(shape)
        forces = np.zeros(self._free.shape)
        forces[self._free] = coefficients[1:]
        branches = []
        for radius, own in zip(radii, forces, strict=True):
            bends = tuple((radius * np.array(self.places)).tolist())
            branches.append(
                joint_models.SlipSpring(deflections=bends, forces=tuple(own.tolist()), falls=falls)
            )
        return joint_models.Elasticity(stiffness=float(coefficients[0]), branches=tuple(branches))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class RelayGrid(ElementFamily):
    """Krasnosel'skii-Pokrovskii relays on a grid of `count` places over the range of the input."""

    count: int
    low: float
    step: float
    name: str = "krasnoselskii-pokrovskii"
    searched: bool = False

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        del path
        return [np.zeros(0)]

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return ramps, and for every relay its middle ramp less its state."""
        del shape
        relays = self._build(np.zeros(self.count * (self.count + 1) // 2))
        z = (path.position[:, None] - self.low) / self.step
        middles = np.clip(z - 0.5 * np.array(relays.pairs).sum(axis=1), 0.0, 1.0)
        return np.hstack([np.clip(z - np.arange(self.count), 0.0, 1.0), middles - path.trace(relays)])

    def list_limits(self, count: int, *, passive: bool) -> Limits:
        """Return bounds: relays brake."""
        low, high = ElementFamily.list_limits(self, count, passive=False)
        if passive:
            low[self.count :] = 0.0
        return low, high

    def list_penalties(self, count: int) -> FloatArray:
        """Return second differences over the grid: few relays are seen alone, neighbours are alike."""
        pairs = [(i, j) for i in range(self.count) for j in range(i)]
        places = {pair: self.count + k for k, pair in enumerate(pairs)}
        middles = [(k - 1, k, k + 1) for k in range(1, self.count - 1)]
        for i, j in pairs:
            rows = (((i - 1, j), (i + 1, j)), ((i, j - 1), (i, j + 1)))
            middles += [(places[a], places[i, j], places[b]) for a, b in rows if a in places and b in places]
        penalties = np.zeros((len(middles), count))
        for row, (before, middle, after) in zip(penalties, middles, strict=True):
            row[[before, middle, after]] = 1.0, -2.0, 1.0
        return _SMOOTH * float(np.sqrt(self.count)) * penalties

    def describe(self) -> tuple[str, ...]:
        return (f"{self.count} places",)

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        del shape
        return joint_models.Elasticity(stiffness=0.0, branches=(self._build(coefficients),))

    def _build(self, coefficients: FloatArray) -> joint_models.Relays:
        ramps, weights = np.split(np.asarray(coefficients, dtype=np.float64), [self.count])
        values = {"ramps": tuple(ramps.tolist()), "weights": tuple(weights.tolist())}
        return joint_models.Relays(low=self.low, step=self.step, **values)


_SMOOTH = 0.01
"""Of relays: the fit is about the same for a tenth and for ten times as much."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class BoucWenFamily(ElementFamily):
    """Bouc-Wen with a linear spring: length, sharpness less one, loop less one half; two for asymmetry."""

    asymmetric: bool = False
    name: str = "bouc-wen"
    signed: tuple[bool, ...] = (False, False, False, True, True)

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        """Return lengths up to the reach, of loops as round and as wide as those of Dahl."""
        skew = [0.0, 0.0] if self.asymmetric else []
        return [np.array([length, 0.5, 0.5, *skew]) for length in path.list_lengths(STARTS)]

    def describe(self) -> tuple[str, ...]:
        return ("asymmetric",) if self.asymmetric else ()

    def _build_unit(self, shape: FloatArray, level: float) -> joint_models.BoucWen:
        skew, lean = np.tanh(shape[3:5]).tolist() if self.asymmetric else (0.0, 0.0)
        return joint_models.BoucWen(
            level=level,
            length=float(shape[0]),
            sharpness=1.0 + float(shape[1]),
            loop=0.5 + float(shape[2]),
            skew=0.99 * skew,
            lean=0.99 * lean * 2.0 * float(shape[2]),
        )

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return x and u."""
        return np.column_stack([path.position, path.trace(self._build_unit(shape, 1.0))])

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        branch = self._build_unit(shape, float(coefficients[1]))
        return joint_models.Elasticity(stiffness=float(coefficients[0]), branches=(branch,))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class BristleFamily(ElementFamily):
    """Dahl, LuGre or generalised Maxwell-slip with a linear spring.

    Shape: bending Fc / sigma0 (not of Maxwell-slip, whose elements stand on a grid); where the level falls
    with the speed also Fe / Fc and vs.
    """

    law: str
    name: str
    needs_time: bool = False
    grid: tuple[float, ...] = ()
    brakes: bool = True

    @property
    def searched(self) -> bool:  # type: ignore[override]
        return self.needs_time or not self.grid

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        """Return bendings up to the reach, with Stribeck velocities up to the largest speed."""
        lengths = path.list_lengths(STARTS).tolist()
        bends = [[]] if self.grid else [[length] for length in lengths]
        falls = [[0.5, path.speed * length / path.reach] for length in lengths] if self.needs_time else [[]]
        return [np.array([*bend, *fall]) for bend, fall in product(bends, falls)]

    def describe(self) -> tuple[str, ...]:
        return ("falling with the speed",) if self.needs_time and self.grid else ()

    def _list_level(self, shape: FloatArray, force: float) -> dict[str, float]:
        if not self.needs_time:
            return {"Fc": force}
        return {"Fc": force, "Fe": float(shape[-2]) * force, "vs": float(shape[-1]), "gamma": 2.0}

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return x and the forces of bristles of unit level; of LuGre also those of their damping."""
        # The level (N,) of unit dry friction.
        height = np.ones(len(path.position))
        if self.needs_time:
            height += float(shape[-2]) * np.exp(-((path.velocity / shape[-1]) ** 2))
        if not self.grid:
            values = {**self._list_level(shape, 1.0), "sigma0": 1.0 / float(shape[0])}
            states = path.trace(joint_models.BristleBranch(law=self.law, values=tuple(values.items())))[:, 0]
            columns = [path.position, states / shape[0]]
            if self.law == "lugre":
                columns.append(path.velocity - np.abs(path.velocity) * columns[1] / height)
            return np.column_stack(columns)
        (begin, side), x, grid = path.origin, path.position[:, None], np.array(self.grid)
        radii = grid * height[:, None]
        # Bounds that move with the speed: elements are held within them, as generated code does.
        turns = None if self.needs_time else joint_models.find_turns(path.position)
        clamped = joint_models.compute_clamps(x - radii, x + radii, begin - grid * side, turns)
        return np.hstack([x, x - clamped])

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        spring, elements = joint_models.Elasticity(stiffness=float(coefficients[0])), {}
        force = max(float(coefficients[1]), numerics.TINY)
        if self.grid:
            kept = [(r, float(k)) for r, k in zip(self.grid, coefficients[1:], strict=True) if k > 0.0]
            force = sum(r * k for r, k in kept)
            if not force:
                return spring
            # Stiffnesses first, then shares: as bristles of robot files.
            elements = {f"stiffness{number}": k for number, (_, k) in enumerate(kept, start=1)}
            elements |= {f"share{number}": r * k / force for number, (r, k) in enumerate(kept, start=1)}
        else:
            elements["sigma0"] = force / float(shape[0])
            if self.law == "lugre":
                elements["sigma1"] = float(coefficients[2])
        values = tuple((self._list_level(shape, force) | elements).items())
        return replace(spring, branches=(joint_models.BristleBranch(law=self.law, values=values),))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class AttractedFamily(ElementFamily):
    """Maxwell-slip elements on a grid, attracted to their level: excess plus one, speed, attraction."""

    grid: tuple[float, ...]
    name: str = "maxwell-slip"
    needs_time: bool = True
    brakes: bool = True

    def describe(self) -> tuple[str, ...]:
        return ("attracted to its level",)

    def list_starts(self, path: ElementPath) -> list[FloatArray]:
        """Return speeds up to the largest, and attractions over ways up to the reach."""
        pairs = product(path.list_lengths(STARTS).tolist(), repeat=2)
        return [np.array([1.5, path.speed * length / path.reach, path.speed / way]) for length, way in pairs]

    def _build_branch(self, shape: FloatArray, stiffnesses: FloatArray) -> joint_models.AttractedSlip:
        kept = stiffnesses > 0.0
        return joint_models.AttractedSlip(
            thresholds=tuple(np.array(self.grid)[kept].tolist()),
            stiffnesses=tuple(stiffnesses[kept].tolist()),
            excess=float(shape[0]) - 1.0,
            speed=float(shape[1]),
            attraction=float(shape[2]),
        )

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return x and the bendings."""
        states = path.trace(self._build_branch(shape, np.ones(len(self.grid))))
        return np.column_stack([path.position, states[:, : len(self.grid)]])

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        kept = np.any(coefficients[1:] > 0.0)
        branches = (self._build_branch(shape, coefficients[1:]),) if kept else ()
        return joint_models.Elasticity(stiffness=float(coefficients[0]), branches=branches)


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class ElementForm:
    """A family with what any element may have: an offset, and parts by name.

    Half a gap and a time (`ADDED`) are values of the shape, behind those of the family. What is behind a gap
    sees its play alone.
    """

    family: ElementFamily
    parts: tuple[str, ...] = ()

    @property
    def added(self) -> tuple[str, ...]:
        """Return the parts that have a value in the shape."""
        return tuple(part for part in self.parts if part in ADDED)

    @property
    def _columns(self) -> tuple[str, ...]:
        """Return what has a column behind those of the family."""
        return (*(part for part in self.parts if part != "backlash"), *["offset"] * self.family.has_offset)

    def describe(self) -> str:
        """Return what distinguishes the form, in words."""
        return ", ".join((*self.family.describe(), *self.parts))

    def _split(self, shape: FloatArray) -> tuple[FloatArray, dict[str, float]]:
        own, values = np.split(shape, [len(shape) - len(self.added)])
        return own, dict(zip(self.added, values.tolist(), strict=True))

    def count_searched(self, shape: FloatArray) -> int:
        """Return how many values of a shape, the last ones, a search moves."""
        return len(shape) if self.family.searched else len(self.added)

    def move(self, shape: FloatArray, moves: FloatArray) -> FloatArray:
        """Return a shape whose searched values were moved: in their logarithm, but for those of any sign."""
        signs = self.family.signed[: len(shape) - len(self.added)]
        signed = np.pad(np.array(signs, dtype=bool), (0, len(shape) - len(signs)))
        moves = np.append(np.zeros(len(shape) - len(moves)), moves)
        return np.where(signed, shape + moves, shape * np.exp(moves))

    def compute_columns(self, path: ElementPath, shape: FloatArray) -> FloatArray:
        """Return the columns (N, m)."""
        own, values = self._split(shape)
        if "backlash" in values:
            path = replace(path, position=path.compute_plays(np.array([values["backlash"]]))[:, 0])
        further = {"viscous": path.velocity, "cubic": path.position**3, "offset": np.ones(len(path.position))}
        if "relaxation" in values:
            spring = joint_models.Relaxation(stiffness=1.0, time=values["relaxation"])
            further["relaxation"] = path.trace(spring)[:, 0]
        columns = [further[name] for name in self._columns]
        return np.column_stack([self.family.compute_columns(path, own), *columns])

    def list_limits(self, count: int, *, passive: bool) -> Limits:
        """Return the bounds of the coefficients (m,); what relaxes is a spring."""
        further = self._columns
        low, high = self.family.list_limits(count - len(further), passive=passive)
        bound = [name == "relaxation" or (passive and name != "offset") for name in further]
        return np.append(low, np.where(bound, 0.0, -np.inf)), np.append(high, np.full(len(further), np.inf))

    def build(self, shape: FloatArray, coefficients: FloatArray) -> joint_models.Elasticity:
        """Return the element."""
        (own, values), count = self._split(shape), len(coefficients) - len(self._columns)
        further = dict(zip(self._columns, coefficients[count:].tolist(), strict=True))
        found, spring = self.family.build(own, coefficients[:count]), further.get("relaxation", 0.0)
        branches = found.branches
        if spring > 0.0:
            branches += (joint_models.Relaxation(stiffness=spring, time=values["relaxation"]),)
        names = {"damping": "viscous", "cubic": "cubic", "offset": "offset"}
        numbers = {field: further.get(name, 0.0) for field, name in names.items()}
        return replace(found, branches=branches, backlash=values.get("backlash", 0.0), **numbers)


ADDED = ("backlash", "relaxation")


def list_families(name: str, path: ElementPath, *, timed: bool) -> tuple[ElementFamily, ...]:
    """Return the forms of a model to try on a path; those that need time only where it is known."""
    grid = tuple(path.list_lengths(GRID).tolist())
    places = tuple(np.linspace(-1.0, 1.0, GRID + 1).tolist())
    low, step = float(path.position.min()), 2.0 * path.reach / GRID
    # A branch that must not slip: its threshold is far beyond the path.
    far = float(np.max(np.abs(path.position))) / POLICY.relevance
    forms: dict[str, tuple[ElementFamily, ...]] = {
        "prandtl-ishlinskii": (*(Stops(count=n, searched=True) for n in (0, 2, 3)), Stops(count=GRID)),
        "nonlinear-stops": (
            NonlinearStops(places=places, count=1),
            NonlinearStops(places=places, count=1, falling=True, needs_time=True),
            NonlinearStops(places=places, count=2),
        ),
        "sided": (
            *(Stops(count=count, name="sided", searched=count > 0, far=far) for count in (0, 2)),
            Stops(count=GRID, name="sided", far=far),
        ),
        "krasnoselskii-pokrovskii": (RelayGrid(count=GRID, low=low, step=step),),
        "bouc-wen": (BoucWenFamily(), BoucWenFamily(asymmetric=True)),
        "dahl": (BristleFamily(law="dahl", name="dahl"),),
        "lugre": (BristleFamily(law="lugre", name="lugre", needs_time=True),),
        "maxwell-slip": (
            BristleFamily(law="maxwell-slip", name="maxwell-slip", grid=grid),
            BristleFamily(law="generalised-maxwell-slip", name="maxwell-slip", needs_time=True, grid=grid),
            AttractedFamily(grid=grid),
        ),
    }
    return tuple(family for family in forms.get(name, ()) if timed or not family.needs_time)
