"""Rows of the hysteresis-plus-friction problem: what is linear is worked out once, the rest step by step.

ElasticProblem, NlpOptions -> NlpRecording, one a recording, with its row blocks and knees.

    energy            y - dynamics chi - sum_i (work of spring i) = 0           one row a window
    motor, link       filtered or integrated over windows ("momentum"):
        motor         y - [IA, f] columns - tau_J part = 0
        link          tau_J part - dp/dt - dL/dq parts beta = 0
    window sum        y_k = sum_{i in window k} weight_i x_i
    filter sum        y_k = sum_{i < end k} (1 - a) a^(end k - 1 - i) x_i,   a = exp(-rate period)
    knees             v = Phi k,   tau_J = v + sum_j s_j S_j(v)
                      S_j = max(v - R_j, 0) or, for R_j < 0, min(v - R_j, 0)

A block says: values - matrix chi - sign (springs k + knees) - Stribeck = 0; sums add steps between
samples up to rows, and their adjoint leads from rows back to steps. Between samples v is a straight line,
and the mean of S_j over a step is that along it: from p < 0 to q > 0 beyond the knee q w / 2 with w = q /
(q - p), both beyond (p + q) / 2. So it has continuous derivatives in k, and its second derivative is of
rank one, s_j Phi_c Phi_c' / |q - p| at the crossing c.

Supported: energy, filtered and momentum rows in any combination; any signed knees, both sides sharing a
slope too.
Not supported: joint damping; friction on the link side; knees at zero torque; windows that overlap.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.identification.elastic.problem import ElasticProblem
from symid.identification.elastic.regression import ElasticSignals, filter_smooth
from symid.joint_models import compute_stop_basis, compute_work_columns


class StepSums(Protocol):
    """A linear map from steps to rows."""

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        ...

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowSums:
    """Sums over `count` windows of `length` steps from step `first` on, with one weight a step (N - 1,)."""

    first: int
    length: int
    count: int
    weights: FloatArray

    def __post_init__(self) -> None:
        """Copy the weights and make them read-only."""
        object.__setattr__(self, "weights", freeze(self.weights))

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        span = self._span
        blocks = steps[span].reshape(self.count, self.length, -1)
        weights = self.weights[span].reshape(self.count, 1, self.length)
        sums: FloatArray = np.matmul(weights, blocks).reshape(self.count, *steps.shape[1:])
        return sums

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        steps = np.zeros_like(self.weights)
        steps[self._span] = self.weights[self._span] * np.repeat(rows, self.length)
        return steps

    @property
    def _span(self) -> slice:
        return slice(self.first, self.first + self.count * self.length)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterSums:
    """The low-pass from rest over `steps` steps, seen at the samples first, first + length, ...

    Args:
        steps: N - 1; count: rows.
        decay: exp(-rate period).
    """

    steps: int
    first: int
    length: int
    count: int
    decay: float

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        from scipy.signal import lfilter

        flat = steps.reshape(self.steps, -1)
        inflow = np.empty((self.count, flat.shape[1]))
        inflow[0] = self._fade(self.first) @ flat[: self.first]
        last = self.first + (self.count - 1) * self.length
        blocks = flat[self.first : last].reshape(self.count - 1, self.length, flat.shape[1])
        inflow[1:] = np.matmul(self._fade(self.length), blocks)
        rows: FloatArray = lfilter([1.0], [1.0, -(self.decay**self.length)], inflow, axis=0)
        return rows.reshape(self.count, *steps.shape[1:])

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        from scipy.signal import lfilter

        outflow = lfilter([1.0], [1.0, -(self.decay**self.length)], rows[::-1])[::-1]
        steps = np.zeros(self.steps)
        steps[: self.first] = outflow[0] * self._fade(self.first)
        last = self.first + (self.count - 1) * self.length
        steps[self.first : last] = np.outer(outflow[1:], self._fade(self.length)).ravel()
        return steps

    def _fade(self, length: int) -> FloatArray:
        """Return what is left of each of `length` steps at the end of the last."""
        weights: FloatArray = (1.0 - self.decay) * self.decay ** np.arange(
            length - 1, -1, -1, dtype=np.float64
        )
        return weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KneePass:
    """One knee along a recording.

    Args:
        slot: the slope variable that it belongs to.
        side: 1 for a knee above zero torque, -1 below.
        mean: (N - 1,) mean dead zone over each step, N m or N.
        beyond: (N - 1,) 1 where both ends of a step lie beyond the knee, else 0.
        crossings: (c,) steps that cross it.
        start, end: (c,) derivatives of the mean by v at the step's ends.
        place: (c,) where the step crosses, 0 at its start.
        width: (c,) change of v over the step.
    """

    slot: int
    side: float
    mean: FloatArray
    beyond: FloatArray
    crossings: NDArray[np.intp]
    start: FloatArray
    end: FloatArray
    place: FloatArray
    width: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KneeSteps:
    """All knees of one joint along a recording; basis (N, m + 1), its step means (N - 1, m + 1)."""

    basis: FloatArray
    middle: FloatArray
    passes: tuple[KneePass, ...]
    slots: int

    def find_means(self) -> FloatArray:
        """Return the step means (N - 1, slots) of the dead zones, one column a slope variable."""
        means = np.zeros((len(self.middle), self.slots))
        for knee in self.passes:
            means[:, knee.slot] += knee.mean
        return means

    def find_slopes(self, slopes: FloatArray) -> FloatArray:
        """Return the derivatives (N - 1, m + 1) by the weights of sum_j s_j times the step means."""
        share = np.zeros(len(self.middle))
        for knee in self.passes:
            share += slopes[knee.slot] * knee.beyond
        columns = share[:, None] * self.middle
        for knee in self.passes:
            columns[knee.crossings] += slopes[knee.slot] * self._find_edge(knee)
        return columns

    def find_cross(self, multipliers: FloatArray) -> FloatArray:
        """Return sum_i c_i d mean_i / dk (m + 1, slots) for multipliers c (N - 1,) of the steps."""
        cross = np.zeros((self.basis.shape[1], self.slots))
        for knee in self.passes:
            cross[:, knee.slot] += (multipliers * knee.beyond) @ self.middle
            cross[:, knee.slot] += multipliers[knee.crossings] @ self._find_edge(knee)
        return cross

    def find_curvature(self, multipliers: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return sum_i c_i sum_j s_j d2 mean_ij / dk2 (m + 1, m + 1)."""
        total = np.zeros((self.basis.shape[1],) * 2)
        for knee in self.passes:
            at, place = knee.crossings, knee.place[:, None]
            point = (1.0 - place) * self.basis[at] + place * self.basis[at + 1]
            weight = multipliers[at] * knee.side * slopes[knee.slot] / np.abs(knee.width)
            total += point.T @ (weight[:, None] * point)
        return total

    def _find_edge(self, knee: KneePass) -> FloatArray:
        at = knee.crossings
        edge: FloatArray = knee.start[:, None] * self.basis[at] + knee.end[:, None] * self.basis[at + 1]
        return edge


def build_knee_steps(
    basis: FloatArray, middle: FloatArray, weights: FloatArray, knees: Sequence[tuple[float, int]]
) -> KneeSteps:
    """Return the knees of one joint along a recording.

    Args:
        basis: (N, m + 1) torsion and stops.
        middle: (N - 1, m + 1) means over the steps.
        weights: (m + 1,) k0, k_1 .. k_m.
        knees: signed torques, each with its slope variable.
    """
    torque = basis @ weights
    passes = tuple(_build_knee_pass(torque, knee, slot) for knee, slot in knees)
    slots = 1 + max((slot for _, slot in knees), default=-1)
    return KneeSteps(basis=basis, middle=middle, passes=passes, slots=slots)


def _build_knee_pass(torque: FloatArray, knee: float, slot: int) -> KneePass:
    side = 1.0 if knee > 0 else -1.0
    excess = side * (torque - knee)
    out = excess > 0.0
    beyond = (out[:-1] & out[1:]).astype(np.float64)
    mean = beyond * (excess[:-1] + excess[1:]) / 2.0
    at = np.flatnonzero(out[:-1] != out[1:])
    first, last = excess[at], excess[at + 1]
    width = last - first
    farther = np.maximum(first, last)
    part = farther / np.abs(width)
    mean[at] = farther * part / 2.0
    near, far = part * part / 2.0, part - part * part / 2.0
    rises = last > first
    return KneePass(
        slot=slot,
        side=side,
        mean=side * mean,
        beyond=beyond,
        crossings=at,
        start=np.where(rises, near, far),
        end=np.where(rises, far, near),
        place=-first / width,
        width=width,
    )


NLP_ROWS = ("energy", "filtered", "momentum")
_ROW_RATE = 125.0
"""Filtered rows a second in Hz: above it, rows tell nothing new."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringColumns:
    """One joint's spring in the rows of a block.

    Args:
        joint: its index.
        columns: (M, m + 1) exact rows of the spring and its stops without knees.
        sums: adds step means of the knees up to rows.
    """

    joint: int
    columns: FloatArray
    sums: StepSums


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowBlock:
    """Rows of one kind: values - matrix chi - sign tau_J - Stribeck friction = 0.

    Args:
        name: kind and joint, for weights and messages.
        matrix: (M, p + n + pf); values: (M,).
        sign: 1 where the spring's torque stands with the loads, -1 where it drives.
        springs: of the joints that take part.
        friction: joint and sums of a Stribeck friction in these rows.
    """

    name: str
    matrix: FloatArray
    values: FloatArray
    sign: float
    springs: tuple[SpringColumns, ...]
    friction: tuple[tuple[int, StepSums], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpRecording:
    """One recording: its rows, and what knees and Stribeck friction are evaluated on.

    Args:
        bases: per joint (N, m + 1) torsion and stops; middles: per joint (N - 1, m + 1) their step means.
        speed: (N, n) motor velocities, rad/s or m/s.
    """

    blocks: tuple[RowBlock, ...]
    bases: tuple[FloatArray, ...]
    middles: tuple[FloatArray, ...]
    speed: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """One recording of the problem with its stop bases."""

    problem: ElasticProblem
    index: int
    thresholds: tuple[FloatArray, ...]
    bases: tuple[FloatArray, ...]

    @property
    def signals(self) -> ElasticSignals:
        return self.problem.signals[self.index]

    @property
    def size(self) -> int:
        return self.problem.library.card.size


def build_nlp_recording(
    problem: ElasticProblem, index: int, thresholds: Sequence[FloatArray], kinds: Sequence[str]
) -> NlpRecording:
    """Return the rows of one recording.

    Args:
        problem: all recordings.
        index: of the recording.
        thresholds: (m,) of each joint's stops, rad or m.
        kinds: some of `NLP_ROWS`.
    """
    signals = problem.signals[index]
    phi = signals.phi
    bases = tuple(compute_stop_basis(phi[:, joint], grid) for joint, grid in enumerate(thresholds))
    part = _Part(problem=problem, index=index, thresholds=tuple(thresholds), bases=bases)
    blocks: list[RowBlock] = []
    if "energy" in kinds:
        blocks.append(_build_energy_block(part))
    if "filtered" in kinds:
        blocks += _build_filtered_blocks(part)
    if "momentum" in kinds:
        blocks += _build_momentum_blocks(part)
    return NlpRecording(
        blocks=tuple(blocks),
        bases=bases,
        middles=tuple((basis[1:] + basis[:-1]) / 2.0 for basis in bases),
        speed=signals.dtheta,
    )


def move_stops(
    recording: NlpRecording, problem: ElasticProblem, index: int, moves: Sequence[Mapping[int, float]]
) -> NlpRecording:
    """Return energy and momentum rows with some stops elsewhere; all else is what it was.

    Args:
        recording: as it is.
        problem: all recordings.
        index: of the recording.
        moves: for each joint, new thresholds of some stops by their index, rad or m.
    """
    phi, ends = problem.signals[index].phi, problem.energy[index].ends
    bases = list(recording.bases)
    works: dict[int, FloatArray] = {}
    for joint, places in enumerate(moves):
        if places:
            grid = np.array(list(places.values()))
            stops = [1 + place for place in places]
            basis = bases[joint].copy()
            basis[:, stops] = compute_stop_basis(phi[:, joint], grid)[:, 1:]
            bases[joint] = basis
            works[joint] = np.diff(compute_work_columns(phi[:, joint], grid)[ends], axis=0)[:, 1:]

    def move(block: RowBlock, spring: SpringColumns) -> SpringColumns:
        if spring.joint not in works:
            return spring
        stops = [1 + place for place in moves[spring.joint]]
        columns = spring.columns.copy()
        values = bases[spring.joint][:, stops]
        means = spring.sums.add((values[1:] + values[:-1]) / 2.0)
        columns[:, stops] = works[spring.joint] if block.name == "energy" else means
        return replace(spring, columns=columns)

    return replace(
        recording,
        blocks=tuple(
            replace(block, springs=tuple(move(block, spring) for spring in block.springs))
            for block in recording.blocks
        ),
        bases=tuple(bases),
        middles=tuple(
            (basis[1:] + basis[:-1]) / 2.0 if joint in works else recording.middles[joint]
            for joint, basis in enumerate(bases)
        ),
    )


def _build_energy_block(part: _Part) -> RowBlock:
    signals, rows = part.signals, part.problem.energy[part.index]
    phi, turn = signals.phi, np.diff(signals.theta, axis=0)
    springs = tuple(
        SpringColumns(
            joint=joint,
            columns=np.diff(compute_work_columns(phi[:, joint], grid)[rows.ends], axis=0),
            sums=_build_window_sums(rows.ends, np.diff(phi[:, joint])),
        )
        for joint, grid in enumerate(part.thresholds)
    )
    return RowBlock(
        name="energy",
        matrix=rows.design,
        values=rows.supplied,
        sign=1.0,
        springs=springs,
        friction=tuple((joint, _build_window_sums(rows.ends, turn[:, joint])) for joint in range(part.size)),
    )


def _build_filtered_blocks(part: _Part) -> list[RowBlock]:
    signals, rows, rate = part.signals, part.problem.filtered[part.index], part.problem.options.rate
    skip = max(1, int(1.0 / (_ROW_RATE * signals.period * rows.keep.step)))
    keep = slice(rows.keep.start, None, rows.keep.step * skip)
    torque = rows.torque[::skip]
    sums = FilterSums(
        steps=len(signals.time) - 1,
        first=keep.start,
        length=keep.step,
        count=len(torque),
        decay=float(np.exp(-rate * signals.period)),
    )
    columns = [filter_smooth(basis, rate, signals.period)[keep] for basis in part.bases]
    motor, link = rows.motor[::skip], rows.link[::skip]
    return _join_blocks("filtered", (motor, link, torque), columns, sums)


def _build_momentum_blocks(part: _Part) -> list[RowBlock]:
    signals, library, size = part.signals, part.problem.library, part.size
    ends = part.problem.energy[part.index].ends
    sums = _build_window_sums(ends, np.full(len(signals.time) - 1, signals.period))

    def add(values: FloatArray) -> FloatArray:
        return sums.add((values[1:] + values[:-1]) / 2.0)

    (momentum,) = library.evaluate("momentum_regressor", signals.q[ends], signals.dq[ends])
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    link = np.diff(momentum, axis=0) - add(lagrange)
    motor = [np.diff(signals.dtheta[ends], axis=0)[:, :, None] * np.eye(size)]
    if library.card.friction:
        (friction,) = library.evaluate("friction_regressor", signals.dtheta)
        motor.append(add(friction))
    torque = sums.add(signals.tau[:-1]) if signals.hold == "zero" else add(signals.tau)
    columns = [add(basis) for basis in part.bases]
    return _join_blocks("momentum", (np.concatenate(motor, axis=2), link, torque), columns, sums)


def _join_blocks(
    kind: str, sides: tuple[FloatArray, FloatArray, FloatArray], columns: Sequence[FloatArray], sums: StepSums
) -> list[RowBlock]:
    """Return the blocks of the motor (M, n, n + pf) and link (M, n, p) equations, joint by joint.

    Args:
        kind: of the rows.
        sides: motor columns, link columns and torque (M, n).
        columns: per joint, of the spring and its stops.
        sums: of the rows.
    """
    motor, link, torque = sides
    blocks = []
    for joint in range(torque.shape[1]):
        springs = (SpringColumns(joint=joint, columns=columns[joint], sums=sums),)
        still = np.zeros((len(torque), link.shape[2]))
        driven = np.zeros((len(torque), motor.shape[2]))
        blocks.append(
            RowBlock(
                name=f"{kind} motor {joint + 1}",
                matrix=np.hstack([still, motor[:, joint]]),
                values=torque[:, joint],
                sign=1.0,
                springs=springs,
                friction=((joint, sums),),
            )
        )
        blocks.append(
            RowBlock(
                name=f"{kind} link {joint + 1}",
                matrix=np.hstack([link[:, joint], driven]),
                values=np.zeros(len(torque)),
                sign=-1.0,
                springs=springs,
            )
        )
    return blocks


def _build_window_sums(ends: slice, weights: FloatArray) -> WindowSums:
    count = (ends.stop - 1 - ends.start) // ends.step
    return WindowSums(first=ends.start, length=ends.step, count=count, weights=weights)


HESSIANS = ("exact", "gauss-newton")


@dataclass(frozen=True, slots=True, kw_only=True)
class NlpOptions:
    """How the problem is set up and solved.

    Args:
        rows: some of `NLP_ROWS`.
        hessian: one of `HESSIANS`.
        stribeck: whether friction gets Fs exp(-(v / vs)^2) sign(v) on top.
        smoothing: v0 of tanh(v / v0) in place of sign(v) in it, rad/s or m/s; 0 for the sign.
        speeds: least and greatest vs, rad/s or m/s.
        odd: whether springs harden alike on both sides.
        slopes: least and greatest slope of the outer function.
        weight_limit: greatest weight as a multiple of the linear spring; least_stiffness: the least k0.
        rounds: of weighing the rows by their residuals; 0 keeps the weights of the linear springs.
        tolerance: of Ipopt, on the scaled problem.
        iterations: of Ipopt, at most.
    """

    rows: tuple[str, ...] = ("energy", "momentum")
    hessian: str = "exact"
    stribeck: bool = False
    smoothing: float = 0.0
    speeds: tuple[float, float] = (1e-3, 10.0)
    odd: bool = False
    slopes: tuple[float, float] = (0.05, 20.0)
    weight_limit: float = 100.0
    least_stiffness: float = 1e-3
    rounds: int = 2
    tolerance: float = 1e-9
    iterations: int = 200

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [*_list_name_mistakes(self), *_list_number_mistakes(self)]
        if mistakes:
            raise UsageError(*(Notice(code="usage.nlp-option", text=text) for text in mistakes))


def _list_name_mistakes(options: NlpOptions) -> list[str]:
    mistakes = []
    if not options.rows or any(kind not in NLP_ROWS for kind in options.rows):
        mistakes.append(f"rows {options.rows}: must be some of {', '.join(NLP_ROWS)}")
    if len(set(options.rows)) < len(options.rows):
        mistakes.append(f"rows {options.rows}: each kind once")
    if options.hessian not in HESSIANS:
        mistakes.append(f"hessian {options.hessian!r}: allowed are {', '.join(HESSIANS)}")
    return mistakes


def _list_number_mistakes(options: NlpOptions) -> list[str]:
    mistakes = []
    for name in ("speeds", "slopes"):
        low, high = getattr(options, name)
        if not 0.0 < low < high < math.inf:
            mistakes.append(f"{name} ({low:g}, {high:g}): must be positive, the least first")
    low, high = options.slopes
    if not low < 1.0 < high:
        mistakes.append(
            f"slopes ({low:g}, {high:g}): one must lie between them, it is the slope at zero torque"
        )
    mistakes += [
        f"{name} {getattr(options, name):g}: must be a positive number"
        for name in ("weight_limit", "least_stiffness", "tolerance")
        if not 0.0 < getattr(options, name) < math.inf
    ]
    if not 0.0 <= options.smoothing < math.inf:
        mistakes.append(f"smoothing {options.smoothing:g}: must be a speed, or 0")
    for name, least in (("rounds", 0), ("iterations", 1)):
        if getattr(options, name) < least:
            mistakes.append(f"{name} {getattr(options, name)}: must be {least} or more")
    return mistakes
