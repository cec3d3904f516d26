"""Rows, unknowns and cost of the hysteresis-plus-friction problem: exact derivatives, starts, the covariance.

What is linear in the rows is computed once, the rest step by step:

    energy            y - dynamics chi - sum_i (work of spring i) = 0           one row a window
    motor, link       filtered or integrated over windows ("momentum"):
        motor         y - [IA, f] columns - tau_J part = 0
        link          tau_J part - dp/dt - dL/dq parts beta = 0
    window sum        y_k = sum_{i in window k} weight_i x_i
    filter sum        y_k = sum_{i < end k} (1 - a) a^(end k - 1 - i) x_i,   a = exp(-rate period)
    knees             v = Phi k,   tau_J = v + sum_j s_j S_j(v)
                      S_j = max(v - R_j, 0) or, for R_j < 0, min(v - R_j, 0)

Between samples v is a straight line, and the mean of S_j over a step is that along it: from p < 0 to q > 0
beyond the knee q w / 2 with w = q / (q - p), both beyond (p + q) / 2. So it has continuous derivatives in k,
and its second derivative is of rank one, s_j Phi_c Phi_c' / |q - p| at the crossing c.

    x = [beta, IA, friction | Fs_i, vs_i | k0 .. km of joint 1, .. | slopes c of joint 1, ..]
    f(x) = 1 / (2 M) sum_b |r_b(x)|^2 / sigma_b^2,   M rows in all, sigma_b of block b
    covariance  H^-1 (sum_b g_b g_b') H^-1,  H = sum J'J / sigma^2,  g_b = sum of J'r / sigma^2 over stretch b

The slope of the outer function is one at v = 0, which fixes the scale of the weights, and c_j beyond its
j-th knee on each side: rising and passive means c_j > 0 and k_i >= 0. Rows within a stretch of time share the
same noise (Liang and Zeger 1986).

Supported: all kinds of rows in any combination; knees with slopes of their own on both sides, or odd
springs whose sides share them; unknowns at bounds or without effect, which count as known in the covariance.
Not supported: joint damping; friction on the link side; knees at zero torque; windows that overlap; bounds on
base parameters; starts outside the bounds; uncertainty of how many stops and knees.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from symid import joint_models
from symid.arrays import FloatArray, accumulate, freeze
from symid.codegen import ModelCard
from symid.identification.elastic import regression
from symid.identification.elastic.estimate import STRETCHES
from symid.identification.elastic.options import NlpOptions
from symid.identification.hysteresis import build_stops, filter_smooth
from symid.identification.judge import numerics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepSums:
    """A linear map from step means (N - 1, ...) to rows (M, ...), with its adjoint.

    `inflow` (M, N - 1), sparse, is what comes in between two rows; of a row `kept` is left in the next. Rows
    of which nothing is left are windows of equal length, one after the other.
    """

    inflow: scipy.sparse.csr_array
    kept: float

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows of step means."""
        columns = steps.reshape(len(steps), -1)
        if self.kept:
            rows = accumulate(self.inflow @ columns, self.kept)
        else:
            weights, first = self.inflow.data.reshape(self.inflow.shape[0], -1), int(self.inflow.indices[0])
            parts = columns.T[:, first : first + weights.size].reshape(columns.shape[1], *weights.shape)
            rows = np.einsum("ij,kij->ik", weights, parts)
        return rows.reshape(len(rows), *steps.shape[1:])

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        if self.kept:
            rows = accumulate(rows[::-1], self.kept)[::-1]
        return np.asarray(self.inflow.T @ rows)

    def mask(self, counted: NDArray[np.bool_]) -> "StepSums":
        """Return the sums with empty rows where these do not count (M,)."""
        inflow = self.inflow.copy()
        inflow.data *= np.repeat(counted, np.diff(inflow.indptr))
        return StepSums(inflow=inflow, kept=self.kept)


def build_window_sums(ends: slice, weights: FloatArray) -> StepSums:
    """Return sums of steps, each with its weight (N - 1,), over the windows between the samples `ends`."""
    edges = np.arange(ends.start, ends.stop, ends.step)
    steps = np.arange(edges[0], edges[-1])
    parts = weights[steps], steps, edges - edges[0]
    return StepSums(inflow=scipy.sparse.csr_array(parts, shape=(len(edges) - 1, len(weights))), kept=0.0)


def build_filter_sums(keep: slice, steps: int, decay: float) -> StepSums:
    """Return the low-pass from rest over `steps`, at the samples `keep`; `decay` is exp(-rate period)."""
    ends = np.arange(steps + 1)[keep]
    places = np.arange(ends[-1])
    rows = np.searchsorted(ends, places, side="right")
    left = (1.0 - decay) * np.power(decay, ends[rows] - 1.0 - places)
    inflow = scipy.sparse.csr_array((left, (rows, places)), shape=(len(ends), steps))
    return StepSums(inflow=inflow, kept=decay**keep.step)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KneeSteps:
    """All knees of one joint along a recording: step means of their dead zones, one column a slope variable.

    Args:
        basis: (N, m + 1) torsion and stops.
        means: (N - 1, slots) N m or N.
        starts, ends: (N - 1, slots) derivatives of the means by v at the beginning and the end of each step.
        crossings: for each knee its slot, the steps (c,) that cross it, where they do (c,) from 0 to 1, and
            the inverse (c,) of the change of |v| over them, with the sign of the knee's side.
    """

    basis: FloatArray
    means: FloatArray
    starts: FloatArray
    ends: FloatArray
    crossings: tuple[tuple[int, NDArray[np.intp], FloatArray, FloatArray], ...]

    def compute_slopes(self, slopes: FloatArray) -> FloatArray:
        """Return the derivatives (N - 1, m + 1) by the weights of sum_j s_j times the step means."""
        before, after = self.starts @ slopes, self.ends @ slopes
        return before[:, None] * self.basis[:-1] + after[:, None] * self.basis[1:]

    def compute_curvature(self, multipliers: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return sum_i c_i sum_j s_j d2 mean_ij / dk2 (m + 1, m + 1)."""
        total = np.zeros((self.basis.shape[1],) * 2)
        for slot, steps, place, bend in self.crossings:
            point = (1.0 - place)[:, None] * self.basis[steps] + place[:, None] * self.basis[steps + 1]
            total += point.T @ ((multipliers[steps] * bend * slopes[slot])[:, None] * point)
        return total


def build_knee_steps(basis: FloatArray, weights: FloatArray, knees: Sequence[tuple[float, int]]) -> KneeSteps:
    """Return the knees of one joint along a recording: signed torques, each with its slope variable.

    `basis` (N, m + 1) are torsion and stops, `weights` (m + 1,) k0, k_1 .. k_m.
    """
    torque = basis @ weights
    slots = 1 + max((slot for _, slot in knees), default=-1)
    means, starts, ends = np.zeros((3, slots, len(torque) - 1))
    crossings = []
    for knee, slot in knees:
        side = 1.0 if knee > 0 else -1.0
        excess = side * (torque - knee)
        out = excess > 0.0
        mean = regression.average_steps(np.maximum(excess, 0.0))
        begun = (out[:-1] & out[1:]) / 2.0
        ended = begun.copy()
        at = np.flatnonzero(out[:-1] != out[1:])
        first, width = excess[at], excess[at + 1] - excess[at]
        farther = np.maximum(first, excess[at + 1])
        part = farther / np.abs(width)
        mean[at] = farther * part / 2.0
        near, far = part * part / 2.0, part - part * part / 2.0
        begun[at], ended[at] = np.where(width > 0.0, near, far), np.where(width > 0.0, far, near)
        for whole, own in ((means, side * mean), (starts, begun), (ends, ended)):
            whole[slot] += own
        crossings.append((slot, at, -first / width, side / np.abs(width)))
    return KneeSteps(basis=basis, means=means.T, starts=starts.T, ends=ends.T, crossings=tuple(crossings))


_BuildColumns = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringColumns:
    """One joint's spring in the rows of a block.

    Args:
        build: makes exact columns (M, m + 1) of thresholds (m,) and their stop basis (N, m + 1).
        columns: (M, m + 1) of the spring and its stops without knees.
        sums: adds step means of the knees up to rows.
    """

    joint: int
    build: _BuildColumns
    columns: FloatArray
    sums: StepSums


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowBlock:
    """Rows of one kind: values - matrix chi - sign tau_J - Stribeck friction = 0.

    Args:
        matrix: (M, p + n + pf); values: (M,).
        sign: 1 where the spring's torque stands with the loads, -1 where it drives.
        springs: of the joints that take part.
        friction: joint and sums of a Stribeck friction.
        counted: rows that are not empty; None for all.
    """

    matrix: FloatArray
    values: FloatArray
    sign: float
    springs: tuple[SpringColumns, ...]
    friction: tuple[tuple[int, StepSums], ...] = ()
    counted: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpRecording:
    """One recording: its rows, and what knees and Stribeck friction are evaluated on.

    Args:
        bases: per joint (N, m + 1) torsion and stops.
        phi: (N, n) torsions; speed: (N, n) motor velocities, rad/s or m/s.
    """

    blocks: tuple[RowBlock, ...]
    bases: tuple[FloatArray, ...]
    phi: FloatArray
    speed: FloatArray


def build_nlp_recording(
    problem: regression.ElasticProblem, index: int, thresholds: Sequence[FloatArray], kinds: Sequence[str]
) -> NlpRecording:
    """Return the rows of recording `index`: some of `NLP_ROWS`, for thresholds (m,) of each joint."""
    signals, energy, phi = problem.signals[index], problem.energy[index], problem.signals[index].phi
    pairs = zip(phi.T, thresholds, strict=True)
    bases = tuple(joint_models.compute_stop_basis(*pair) for pair in pairs)
    ends, blocks = energy.ends, list[RowBlock]()
    if "energy" in kinds:

        def place(joint: int, torsion: FloatArray) -> SpringColumns:
            def build(grid: FloatArray, _: FloatArray) -> FloatArray:
                return np.diff(joint_models.compute_work_columns(torsion, grid)[ends], axis=0)

            sums, columns = build_window_sums(ends, np.diff(torsion)), build(thresholds[joint], torsion)
            return SpringColumns(joint=joint, build=build, columns=columns, sums=sums)

        turn = np.diff(signals.theta, axis=0)
        block = RowBlock(
            matrix=energy.design,
            values=energy.supplied,
            sign=1.0,
            springs=tuple(place(joint, torsion) for joint, torsion in enumerate(phi.T)),
            friction=tuple((joint, build_window_sums(ends, part)) for joint, part in enumerate(turn.T)),
        )
        blocks.append(block)
    if "filtered" in kinds:
        rows, rate = problem.filtered[index], problem.options.filter_rate
        keep = rows.keep
        passed = build_filter_sums(keep, len(signals.time) - 1, float(np.exp(-rate * signals.period)))
        smooth = partial(filter_smooth, rate=rate, period=signals.period)
        filtered = rows.design, rows.torque, rows.drag
        blocks += _join_blocks(problem, bases, filtered, lambda _, basis: smooth(basis)[keep], passed)
    if "momentum" in kinds:
        sums = build_window_sums(ends, np.full(len(signals.time) - 1, signals.period))

        def add(values: FloatArray) -> FloatArray:
            return sums.add(regression.average_steps(values))

        design = regression.build_equations(problem.library, signals, lambda x: np.diff(x[ends], axis=0), add)
        slides = None
        if np.any(problem.limits):
            # About the middle of a window in which a motor slides from end to end, all of it counts.
            sliding = regression.mark_sliding(signals, ends.step * signals.period, problem.limits)[ends]
            slides = sliding[:-1] & sliding[1:]
        momentum = design, sums.add(signals.step_torque), add(signals.link_drag)
        blocks += _join_blocks(problem, bases, momentum, lambda _, basis: add(basis), sums, slides=slides)
    return NlpRecording(blocks=tuple(blocks), bases=bases, phi=phi, speed=signals.dtheta)


def move_stops(recording: NlpRecording, moves: Sequence[Mapping[int, float]]) -> NlpRecording:
    """Return rows with some stops elsewhere; `moves` has for each joint thresholds by index, rad or m."""
    bases, fresh = list(recording.bases), {}
    for joint, places in enumerate(moves):
        if places:
            grid = np.array(list(places.values()))
            fresh[joint] = grid, joint_models.compute_stop_basis(recording.phi[:, joint], grid)
            bases[joint] = bases[joint].copy(order="K")
            bases[joint][:, [1 + place for place in places]] = fresh[joint][1][:, 1:]

    def move(spring: SpringColumns) -> SpringColumns:
        if spring.joint not in fresh:
            return spring
        columns = spring.columns.copy()
        columns[:, [1 + place for place in moves[spring.joint]]] = spring.build(*fresh[spring.joint])[:, 1:]
        return replace(spring, columns=columns)

    blocks = (replace(block, springs=tuple(map(move, block.springs))) for block in recording.blocks)
    return replace(recording, blocks=tuple(blocks), bases=tuple(bases))


def _join_blocks(
    problem: regression.ElasticProblem,
    bases: Sequence[FloatArray],
    rows: tuple[FloatArray, FloatArray, FloatArray],
    build: _BuildColumns,
    sums: StepSums,
    *,
    slides: NDArray[np.bool_] | None = None,
) -> Iterator[RowBlock]:
    """Yield the blocks of motors, empty without `slides` (M, n), and links; of rigid joints one.

    `rows`: design (M, n, p + n + pf), torque and drag of the links (M, n); `build` and `sums` of springs.
    """
    (design, torque, drag), count = rows, problem.sizes[0]
    for joint, basis in enumerate(bases):
        columns, gives = build(np.zeros(0), basis), problem.gives[joint]
        kept = np.ones(len(torque), dtype=bool) if slides is None else slides[:, joint]
        motor, link = design[:, joint].copy(), design[:, joint].copy()
        motor[:, : count if gives else 0], link[:, count:] = 0.0, 0.0
        own, adds, make = columns, sums, build
        if not np.all(kept):
            own, adds = np.where(kept[:, None], columns, 0.0), sums.mask(kept)

            def make(grid: FloatArray, basis: FloatArray, kept: NDArray[np.bool_] = kept) -> FloatArray:
                return np.where(kept[:, None], build(grid, basis), 0.0)

        motors, links = (
            (SpringColumns(joint=joint, build=how, columns=part, sums=whole),) if gives else ()
            for how, part, whole in ((make, own, adds), (build, columns, sums))
        )
        yield RowBlock(
            matrix=np.where(kept[:, None], motor, 0.0),
            values=np.where(kept, torque[:, joint] - (0.0 if gives else drag[:, joint]), 0.0),
            sign=1.0,
            springs=motors,
            friction=((joint, adds),),
            counted=int(np.count_nonzero(kept)),
        )
        if gives:
            yield RowBlock(matrix=link, values=-drag[:, joint], sign=-1.0, springs=links)


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

    def compute_changes(self, x: FloatArray) -> FloatArray:
        """Return the changes of slope (entries,) of the unknowns x (x,)."""
        return self.changes @ x[self.slopes] + self.offset

    def build_steps(self, basis: FloatArray, x: FloatArray) -> KneeSteps:
        """Return the knees along a recording, `basis` (N, m + 1), of the unknowns x (x,)."""
        return build_knee_steps(basis, x[self.weights], list(zip(self.knees, self.slots, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringGrid:
    """What is fixed of one joint's spring: thresholds (m,) rad or m, signed knee torques N m or N.

    A part of `stiffness`, of a linear spring, is the least k0; weights of stops beyond `reach`, the largest
    torsion, are zero, as they are one with k0.
    """

    thresholds: FloatArray
    knees: tuple[float, ...]
    stiffness: float
    reach: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpLayout:
    """Places, names and bounds of all unknowns.

    Bounds `lower` and `upper` (x,) are in SI units; `dynamics` are the places of chi, `excess` and `speed`
    those of Fs and vs, empty without Stribeck friction.
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

    @classmethod
    def build(
        cls,
        card: ModelCard,
        grids: Sequence[SpringGrid],
        options: NlpOptions,
        known: FloatArray | None = None,
    ) -> "NlpLayout":
        """Return the unknowns: dynamic parameters of the card, perhaps Stribeck friction, a spring a grid.

        Dynamic parameters that are `known` (p + n + pf,), NaN where not, have two equal bounds.
        """
        joints = range(1, card.size + 1)
        names = [entry.name for entry in regression.list_parameter_cards(card)]
        free = np.full(len(names), True) if known is None else np.isnan(known)
        given: ArrayLike = 0.0 if known is None else known
        lower: list[ArrayLike] = [np.where(free, regression.list_lower_bounds(card), given)]
        upper: list[ArrayLike] = [np.where(free, np.inf, lower[0])]
        dynamics = slice(0, len(names))
        size = card.size if options.stribeck else 0
        excess = slice(len(names), len(names) + size)
        speed = slice(excess.stop, excess.stop + size)
        names += [f"{parameter}{joint}" for parameter in ("Fs", "vs") for joint in joints[:size]]
        lower += [np.zeros(size), np.full(size, options.speeds[0])]
        upper += [np.full(size, np.inf), np.full(size, options.speeds[1])]
        springs = []
        for joint, grid in zip(joints, grids, strict=True):
            # Knees of both sides from zero outwards, or of their sizes where both share slopes.
            knees, odd = grid.knees, options.odd
            sides = [sorted({abs(knee) for knee in knees})]
            if not odd:
                sides = [sorted((knee for knee in knees if knee * side > 0), key=abs) for side in (-1.0, 1.0)]
            places = [knee for side in sides for knee in side]
            # A knee changes the slope from that of the knee before it, or from one.
            changes, offset = np.eye(len(places)) - np.eye(len(places), k=-1), np.zeros(len(places))
            for start in {0, len(sides[0])} - {len(places)}:
                changes[start, :start], offset[start] = 0.0, -1.0
            weights = slice(len(names), len(names) + len(grid.thresholds) + 1)
            springs.append(
                SpringLayout(
                    weights=weights,
                    slopes=slice(weights.stop, weights.stop + len(places)),
                    thresholds=freeze(grid.thresholds),
                    knees=knees,
                    slots=tuple(places.index(abs(knee) if odd else knee) for knee in knees),
                    changes=freeze(changes),
                    offset=freeze(offset),
                )
            )
            names += [f"k{stop} of joint {joint}" for stop in range(len(grid.thresholds) + 1)]
            sign = "+-" if odd else ""
            names += [f"slope beyond {sign}{place:.6g} of joint {joint}" for place in places]
            slopes = [np.full(len(places), bound) for bound in options.slopes]
            lower += [[options.least_stiffness * grid.stiffness], np.zeros(len(grid.thresholds)), slopes[0]]
            upper += [[np.inf], np.where(grid.thresholds < grid.reach, np.inf, 0.0), slopes[1]]
        return cls(
            names=tuple(names),
            lower=freeze(np.concatenate(lower)),
            upper=freeze(np.concatenate(upper)),
            dynamics=dynamics,
            excess=excess,
            speed=speed,
            springs=tuple(springs),
        )

    def build_start(self, chi: FloatArray, springs: Sequence[joint_models.Elasticity]) -> FloatArray:
        """Return unknowns (x,) between their bounds: chi (p + n + pf,), springs, no Stribeck friction yet."""
        x = np.zeros(self.size)
        x[self.dynamics] = chi
        x[self.speed] = np.sqrt(self.lower[self.speed] * self.upper[self.speed])
        for place, spring in zip(self.springs, springs, strict=True):
            x[place.weights] = list_weights(spring, place.thresholds)
            slopes = np.zeros(len(place.offset))
            for slot, torque in zip(place.slots, place.knees, strict=True):
                # The slope of the outer function just beyond this knee.
                side = np.sign(torque)
                end = torque * side * (1.0 + 1e-12)
                passed = (knee.slope for knee in spring.knees if 0.0 < knee.threshold * side <= end)
                slopes[slot] = 1.0 + sum(passed)
            x[place.slopes] = slopes
        return np.clip(x, self.lower, self.upper)

    def flatten_slopes(self, x: FloatArray, undetermined: Sequence[str]) -> FloatArray:
        """Return x (x,) with slopes of that name as the ones before them: knees that no torque reaches."""
        flat = np.array(x)
        for spring in self.springs:
            slopes = flat[spring.slopes]
            for entry, name in enumerate(self.names[spring.slopes]):
                if name in undetermined:
                    before = np.flatnonzero(spring.changes[entry] < 0.0)
                    slopes[entry] = slopes[before[0]] if before.size else 1.0
        return flat

    def read_springs(self, x: FloatArray, least: FloatArray) -> tuple[joint_models.Elasticity, ...]:
        """Return the springs of the unknowns x (x,); weights up to `least` (n,) N m/rad are zero."""
        found = []
        for spring, limit in zip(self.springs, least.tolist(), strict=True):
            weights, changes = x[spring.weights], spring.compute_changes(x).tolist()
            knees = sorted(zip(spring.knees, (changes[slot] for slot in spring.slots), strict=True))
            stops = build_stops(spring.thresholds, weights[1:], limit)
            bends = tuple(joint_models.Knee(threshold=torque, slope=bend) for torque, bend in knees if bend)
            found.append(joint_models.Elasticity(stiffness=float(weights[0]), stops=stops, knees=bends))
        return tuple(found)


Places = NDArray[np.intp]
_NUMPY = joint_models.build_numpy_carrier()


class CostState(NamedTuple):
    """What the cost is made of at one x.

    Args:
        residuals: per block (M_b,) in the unit of its rows; places: unknowns that a block depends on.
        jacobians: per block (M_b, places), d r / dx.
        knees: per recording and joint; friction: per recording and joint the step means of g, g', g''.
    """

    residuals: tuple[FloatArray, ...]
    places: tuple[Places, ...]
    jacobians: tuple[FloatArray, ...]
    knees: tuple[tuple[KneeSteps, ...], ...]
    friction: tuple[tuple[FloatArray, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticNlpCost:
    """The cost; `sigmas` holds one scale for each block, in the order of recordings and their blocks."""

    recordings: tuple[NlpRecording, ...]
    layout: NlpLayout
    smoothing: float
    sigmas: tuple[float, ...] = ()

    @property
    def blocks(self) -> tuple[RowBlock, ...]:
        """Return the blocks of all recordings."""
        return tuple(block for part in self.recordings for block in part.blocks)

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return sum(len(block.values) for block in self.blocks)

    def compute_state(self, x: FloatArray) -> CostState:
        """Return residuals and their derivatives at the unknowns x."""
        layout, blocks, knees, friction = self.layout, [], [], []
        for part in self.recordings:
            bases = zip(layout.springs, part.bases, strict=True)
            steps = tuple(spring.build_steps(basis, x) for spring, basis in bases)
            # Step means (N - 1, 3) of g, g' and g'' of every joint with Stribeck friction.
            speeds = zip(part.speed.T, x[layout.speed], strict=False)
            rates = (
                joint_models.compute_stribeck_derivatives(_NUMPY, *pair, self.smoothing) for pair in speeds
            )
            means = tuple(regression.average_steps(np.column_stack(derivatives)) for derivatives in rates)
            pairs = zip(steps, layout.springs, strict=True)
            slopes = [entry.compute_slopes(spring.compute_changes(x)) for entry, spring in pairs]
            for block in part.blocks:
                residual = block.values - block.matrix @ x[layout.dynamics]
                alive = np.flatnonzero(np.any(block.matrix, axis=0))
                own, columns = [alive], [-block.matrix[:, alive]]
                for entry in block.springs:
                    place = layout.springs[entry.joint]
                    torque, slope = entry.columns @ x[place.weights], entry.columns
                    if place.knees:
                        rows = entry.sums.add(steps[entry.joint].means)
                        torque = torque + rows @ place.compute_changes(x)
                        slope = slope + entry.sums.add(slopes[entry.joint])
                        own.append(np.arange(place.slopes.start, place.slopes.stop))
                        columns.append(-block.sign * rows @ place.changes)
                    residual = residual - block.sign * torque
                    own.append(np.arange(place.weights.start, place.weights.stop))
                    columns.append(-block.sign * slope)
                for joint, sums in block.friction if means else ():
                    excess, speed = layout.excess.start + joint, layout.speed.start + joint
                    rows = sums.add(means[joint][:, :2])
                    residual = residual - x[excess] * rows[:, 0]
                    own.append(np.array([excess, speed]))
                    columns.append(-rows * np.array([1.0, x[excess]]))
                blocks.append((residual, np.concatenate(own), np.hstack(columns)))
            knees.append(steps)
            friction.append(means)
        residuals, places, jacobians = zip(*blocks, strict=True)
        return CostState(residuals, places, jacobians, tuple(knees), tuple(friction))

    def compute_spring(self, x: FloatArray, joint: int) -> list[FloatArray]:
        """Return what a joint's spring takes off the residuals (M_b,) of every block at the unknowns x."""
        place, rows = self.layout.springs[joint], []
        for part in self.recordings:
            means = place.build_steps(part.bases[joint], x).means
            for block in part.blocks:
                own = (entry for entry in block.springs if entry.joint == joint)
                knees = ((entry.columns, entry.sums.add(means) @ place.compute_changes(x)) for entry in own)
                parts = [block.sign * (columns @ x[place.weights] + knee) for columns, knee in knees]
                rows.append(sum(parts, np.zeros(len(block.values))))
        return rows

    def compute_value(self, state: CostState) -> float:
        """Return f."""
        parts = zip(state.residuals, self.sigmas, strict=True)
        return sum(float(r @ r) / sigma**2 for r, sigma in parts) / (2.0 * self.rows)

    def compute_gradient(self, state: CostState) -> FloatArray:
        """Return df/dx (x,)."""
        gradient = np.zeros(self.layout.size)
        for r, place, jacobian, sigma in zip(*state[:3], self.sigmas, strict=True):
            gradient[place] += jacobian.T @ r / sigma**2
        return gradient / self.rows

    def compute_gauss_newton(self, state: CostState) -> FloatArray:
        """Return the Hessian (x, x) without second derivatives of the residuals."""
        hessian = np.zeros((self.layout.size,) * 2)
        for _, place, jacobian, sigma in zip(*state[:3], self.sigmas, strict=True):
            hessian[np.ix_(place, place)] += jacobian.T @ jacobian / sigma**2
        return hessian / self.rows

    def compute_hessian(self, state: CostState, x: FloatArray) -> FloatArray:
        """Return the exact Hessian (x, x)."""
        hessian = self.compute_gauss_newton(state)
        pending = zip(state.residuals, self.sigmas, strict=True)
        for part, knees, friction in zip(self.recordings, state.knees, state.friction, strict=True):
            pulls = np.zeros((len(knees), len(part.speed) - 1))
            drags = np.zeros_like(pulls)
            for block in part.blocks:
                residual, sigma = next(pending)
                rows = -residual / (sigma**2 * self.rows)
                for entry in block.springs:
                    if self.layout.springs[entry.joint].knees:
                        pulls[entry.joint] += entry.sums.spread(block.sign * rows)
                for joint, sums in block.friction if friction else ():
                    drags[joint] += sums.spread(rows)
            for spring, steps, pull in zip(self.layout.springs, knees, pulls, strict=True):
                if spring.knees:
                    # Of the means by weights and changes of slope.
                    before, after = pull[:, None] * steps.starts, pull[:, None] * steps.ends
                    cross = (steps.basis[:-1].T @ before + steps.basis[1:].T @ after) @ spring.changes
                    hessian[spring.weights, spring.slopes] += cross
                    hessian[spring.slopes, spring.weights] += cross.T
                    bend = steps.compute_curvature(pull, spring.compute_changes(x))
                    hessian[spring.weights, spring.weights] += bend
            for joint, rates in enumerate(friction):
                excess, speed = self.layout.excess.start + joint, self.layout.speed.start + joint
                mixed = float(drags[joint] @ rates[:, 1])
                hessian[excess, speed] += mixed
                hessian[speed, excess] += mixed
                hessian[speed, speed] += x[excess] * float(drags[joint] @ rates[:, 2])
        return hessian

    def weigh(self, residuals: Sequence[FloatArray], chi: FloatArray) -> "ElasticNlpCost":
        """Return the cost with the rms of these residuals (M_b,) of every block as its scale."""
        pairs = zip(self.blocks, residuals, strict=True)
        counts = [len(residual) if block.counted is None else block.counted for block, residual in pairs]
        roots = np.sqrt(np.maximum(counts, 1))
        sizes = np.array([np.linalg.norm(part) for part in residuals]) / roots
        loads = np.array([np.linalg.norm(block.matrix @ chi) for block in self.blocks]) / roots
        # Rows of a joint at rest hold what filters leave of a constant, down to 1e-160: beside the largest
        # load they are rounding, and must not be weighed up to information.
        sigmas = np.maximum(np.maximum(sizes, numerics.CONVERGED * loads), numerics.RANK * np.max(loads))
        # Without any load all rows are empty and weigh nothing, whatever their scale.
        return replace(self, sigmas=tuple(np.where(sigmas > 0.0, sigmas, 1.0).tolist()))

    def compute_covariance(self, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()) -> FloatArray:
        """Return the covariance (p + n + pf, p + n + pf) of the dynamic parameters at the optimum `x`.

        `places` has, for each stop or knee, the derivative (M_b,) of every block's residuals by its place.
        """
        inverse, scores = self.invert_normal_equations(x, places)
        spread = scores @ inverse[:, self.layout.dynamics]
        return spread.T @ spread

    def invert_normal_equations(
        self, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Return H^-1 (s, s) of unknowns x and places behind them, and scores (stretches, s): J'r / sigma^2.

        H^-1 is zero for what has no effect or stands at a bound. Arguments as those of `compute_covariance`.
        """
        state = self.compute_state(x)
        size = len(x) + len(places)
        curvature, scores = np.zeros((size, size)), np.zeros((len(self.recordings), STRETCHES, size))
        owners = [index for index, part in enumerate(self.recordings) for _ in part.blocks]
        blocks = zip(*state[:3], self.sigmas, strict=True)
        for number, (residual, known, jacobian, sigma) in enumerate(blocks):
            rows = np.zeros((len(residual), size))
            rows[:, known] = jacobian
            for column, slopes in enumerate(places, start=len(x)):
                rows[:, column] = slopes[number]
            curvature += rows.T @ rows / sigma**2
            stretch = (np.arange(len(residual)) * STRETCHES) // len(residual)
            np.add.at(scores[owners[number]], stretch, rows * (residual / sigma**2)[:, None])
        lengths = np.sqrt(np.diag(curvature))
        reach = numerics.CONVERGED * np.maximum(np.abs(x), numerics.EXACT)
        is_free = lengths > 0.0
        is_free[: len(x)] &= (x - self.layout.lower > reach) & (self.layout.upper - x > reach)
        free = np.ix_(is_free, is_free)
        sizes = np.outer(lengths, lengths)[free]
        inverse = np.zeros_like(curvature)
        inverse[free] = np.linalg.pinv(curvature[free] / sizes, rcond=numerics.RANK, hermitian=True) / sizes
        return inverse, scores.reshape(-1, size)


def list_weights(spring: joint_models.Elasticity, thresholds: FloatArray) -> FloatArray:
    """Return k0 .. km (m + 1,) on the thresholds (m,); a linear spring is shared between them."""
    if len(thresholds) and not spring.stops:
        return np.full(len(thresholds) + 1, (spring.initial_stiffness or 0.0) / (len(thresholds) + 1))
    known = {stop.threshold: stop.stiffness or 0.0 for stop in spring.stops}
    return np.array([spring.stiffness or 0.0, *(known.get(value, 0.0) for value in thresholds.tolist())])
