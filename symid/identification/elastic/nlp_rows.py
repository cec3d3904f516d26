"""Rows of the hysteresis-plus-friction problem: what is linear is computed once, the rest step by step.

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

Supported: all kinds of rows in any combination; any signed knees, both sides sharing a slope too.
Not supported: joint damping; friction on the link side; knees at zero torque; windows that overlap.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.identification.elastic.regression import (
    ElasticProblem,
    average_steps,
    build_equations,
    mark_sliding,
)
from symid.identification.hysteresis import filter_smooth
from symid.joint_models import compute_stop_basis, compute_work_columns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowSums(FrozenArrays):
    """Sums over `count` windows of `length` steps from step `first` on, with one weight a step (N - 1,)."""

    first: int
    length: int
    count: int
    weights: FloatArray

    @property
    def span(self) -> slice:
        """Return the steps of all windows."""
        return slice(self.first, self.first + self.count * self.length)

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        blocks = steps[self.span].reshape(self.count, self.length, -1)
        weights = self.weights[self.span].reshape(self.count, 1, self.length)
        sums: FloatArray = np.matmul(weights, blocks).reshape(self.count, *steps.shape[1:])
        return sums

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        steps = np.zeros_like(self.weights)
        steps[self.span] = self.weights[self.span] * np.repeat(rows, self.length)
        return steps


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterSums:
    """The low-pass from rest over `steps` = N - 1 steps, at the `count` samples first, first + length, ...

    `decay` is exp(-rate period).
    """

    steps: int
    first: int
    length: int
    count: int
    decay: float

    @property
    def last(self) -> int:
        """Return the sample of the last row."""
        return self.first + (self.count - 1) * self.length

    def add(self, steps: FloatArray) -> FloatArray:
        """Return the rows (M, ...) of step means (N - 1, ...)."""
        from scipy.signal import lfilter

        flat = steps.reshape(self.steps, -1)
        inflow = np.empty((self.count, flat.shape[1]))
        inflow[0] = self._fade(self.first) @ flat[: self.first]
        blocks = flat[self.first : self.last].reshape(self.count - 1, self.length, flat.shape[1])
        inflow[1:] = np.matmul(self._fade(self.length), blocks)
        rows: FloatArray = lfilter([1.0], [1.0, -(self.decay**self.length)], inflow, axis=0)
        return rows.reshape(self.count, *steps.shape[1:])

    def spread(self, rows: FloatArray) -> FloatArray:
        """Return the steps (N - 1,) that the adjoint makes of rows (M,)."""
        from scipy.signal import lfilter

        outflow = lfilter([1.0], [1.0, -(self.decay**self.length)], rows[::-1])[::-1]
        steps = np.zeros(self.steps)
        steps[: self.first] = outflow[0] * self._fade(self.first)
        steps[self.first : self.last] = np.outer(outflow[1:], self._fade(self.length)).ravel()
        return steps

    def _fade(self, length: int) -> FloatArray:
        """Return what is left of each of `length` steps at the end of the last."""
        left: FloatArray = self.decay ** np.arange(length - 1, -1, -1, dtype=np.float64)
        return (1.0 - self.decay) * left


StepSums = WindowSums | FilterSums
"""A linear map from steps to rows, with its adjoint."""


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

    def compute_cross(self, multipliers: FloatArray) -> FloatArray:
        """Return sum_i c_i d mean_i / dk (m + 1, slots) for multipliers c (N - 1,) of the steps."""
        before, after = multipliers[:, None] * self.starts, multipliers[:, None] * self.ends
        return self.basis[:-1].T @ before + self.basis[1:].T @ after

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
    means, starts, ends = np.zeros((3, len(torque) - 1, slots))
    crossings = []
    for knee, slot in knees:
        side = 1.0 if knee > 0 else -1.0
        excess = side * (torque - knee)
        out = excess > 0.0
        beyond = (out[:-1] & out[1:]) / 2.0
        mean = beyond * (excess[:-1] + excess[1:])
        starts[:, slot] += beyond
        ends[:, slot] += beyond
        at = np.flatnonzero(out[:-1] != out[1:])
        first, width = excess[at], excess[at + 1] - excess[at]
        farther = np.maximum(first, excess[at + 1])
        part = farther / np.abs(width)
        mean[at] = farther * part / 2.0
        near, far = part * part / 2.0, part - part * part / 2.0
        starts[at, slot] += np.where(width > 0.0, near, far)
        ends[at, slot] += np.where(width > 0.0, far, near)
        means[:, slot] += side * mean
        crossings.append((slot, at, -first / width, side / np.abs(width)))
    return KneeSteps(basis=basis, means=means, starts=starts, ends=ends, crossings=tuple(crossings))


_ROW_RATE = 125.0
"""Filtered rows a second in Hz: more rows add no information."""
_BuildColumns = Callable[[FloatArray, FloatArray], FloatArray]
_TorqueRows = tuple[FloatArray, FloatArray, FloatArray, _BuildColumns, StepSums]
"""Design (M, n, p + n + pf), torque and drag of the links (M, n), and how springs get there."""


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
    problem: ElasticProblem, index: int, thresholds: Sequence[FloatArray], kinds: Sequence[str]
) -> NlpRecording:
    """Return the rows of recording `index`: some of `NLP_ROWS`, for thresholds (m,) of each joint."""
    signals, energy, phi = problem.signals[index], problem.energy[index], problem.signals[index].phi
    bases = tuple(compute_stop_basis(phi[:, joint], grid) for joint, grid in enumerate(thresholds))
    ends, blocks = energy.ends, list[RowBlock]()
    if "energy" in kinds:

        def place(joint: int, torsion: FloatArray) -> SpringColumns:
            def build(grid: FloatArray, _: FloatArray) -> FloatArray:
                return np.diff(compute_work_columns(torsion, grid)[ends], axis=0)

            sums, columns = _build_window_sums(ends, np.diff(torsion)), build(thresholds[joint], torsion)
            return SpringColumns(joint=joint, build=build, columns=columns, sums=sums)

        turn = np.diff(signals.theta, axis=0)
        block = RowBlock(
            matrix=energy.design,
            values=energy.supplied,
            sign=1.0,
            springs=tuple(place(joint, torsion) for joint, torsion in enumerate(phi.T)),
            friction=tuple((joint, _build_window_sums(ends, part)) for joint, part in enumerate(turn.T)),
        )
        blocks.append(block)
    if "filtered" in kinds:
        rows, rate = problem.filtered[index], problem.options.rate
        skip = max(1, int(1.0 / (_ROW_RATE * signals.period * rows.keep.step)))
        keep = slice(rows.keep.start, None, rows.keep.step * skip)
        torque, decay = rows.torque[::skip], float(np.exp(-rate * signals.period))
        steps, count = len(signals.time) - 1, len(torque)
        passed = FilterSums(steps=steps, first=keep.start, length=keep.step, count=count, decay=decay)

        def pass_basis(_: FloatArray, basis: FloatArray) -> FloatArray:
            return filter_smooth(basis, rate, signals.period)[keep]

        filtered = rows.design[::skip], torque, rows.drag[::skip], pass_basis, passed
        blocks += _join_blocks(problem, bases, filtered)
    if "momentum" in kinds:
        sums = _build_window_sums(ends, np.full(len(signals.time) - 1, signals.period))

        def add(values: FloatArray) -> FloatArray:
            return sums.add(average_steps(values))

        design = build_equations(problem.library, signals, lambda values: np.diff(values[ends], axis=0), add)
        impulse, drag = sums.add(signals.step_torque), add(signals.link_drag)
        slides = None
        if np.any(problem.limits):
            # About the middle of a window in which a motor slides from end to end, all of it counts.
            sliding = mark_sliding(signals, ends.step * signals.period, problem.limits)[ends]
            slides = sliding[:-1] & sliding[1:]
        momentum = design, impulse, drag, lambda _, basis: add(basis), sums
        blocks += _join_blocks(problem, bases, momentum, slides)
    return NlpRecording(blocks=tuple(blocks), bases=bases, phi=phi, speed=signals.dtheta)


def move_stops(recording: NlpRecording, moves: Sequence[Mapping[int, float]]) -> NlpRecording:
    """Return rows with some stops elsewhere; `moves` has for each joint thresholds by index, rad or m."""
    bases, fresh = list(recording.bases), {}
    for joint, places in enumerate(moves):
        if places:
            grid = np.array(list(places.values()))
            fresh[joint] = grid, compute_stop_basis(recording.phi[:, joint], grid)
            bases[joint] = bases[joint].copy()
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
    problem: ElasticProblem,
    bases: Sequence[FloatArray],
    rows: _TorqueRows,
    slides: NDArray[np.bool_] | None = None,
) -> Iterator[RowBlock]:
    """Yield the blocks of motor and link equations, or their sum for rigid joints.

    Motors that do not slide (M, n) have empty rows.
    """
    design, torque, drag, build, sums = rows
    count = problem.sizes[0]
    for joint, basis in enumerate(bases):
        columns = build(np.zeros(0), basis)
        springs: tuple[SpringColumns, ...] = (
            SpringColumns(joint=joint, build=build, columns=columns, sums=sums),
        )
        gives, torques = problem.gives[joint], torque[:, joint]
        motor, link = design[:, joint].copy(), design[:, joint].copy()
        link[:, count:] = 0.0
        if gives:
            motor[:, :count] = 0.0
        else:
            torques, springs = torques - drag[:, joint], ()
        kept = np.ones(len(torque), dtype=bool) if slides is None else slides[:, joint]
        own, adds = springs, sums
        if isinstance(sums, WindowSums) and not np.all(kept):
            weights = sums.weights.copy()
            weights[sums.span] *= np.repeat(kept, sums.length)
            adds = replace(sums, weights=weights)
            masked = np.where(kept[:, None], columns, 0.0)

            def make(grid: FloatArray, basis: FloatArray, kept: NDArray[np.bool_] = kept) -> FloatArray:
                return np.where(kept[:, None], build(grid, basis), 0.0)

            own = (SpringColumns(joint=joint, build=make, columns=masked, sums=adds),) if gives else ()
        yield RowBlock(
            matrix=np.where(kept[:, None], motor, 0.0),
            values=np.where(kept, torques, 0.0),
            sign=1.0,
            springs=own,
            friction=((joint, adds),),
            counted=int(np.count_nonzero(kept)),
        )
        if gives:
            yield RowBlock(matrix=link, values=-drag[:, joint], sign=-1.0, springs=springs)


def _build_window_sums(ends: slice, weights: FloatArray) -> WindowSums:
    count = (ends.stop - 1 - ends.start) // ends.step
    return WindowSums(first=ends.start, length=ends.step, count=count, weights=weights)
