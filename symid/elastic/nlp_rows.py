"""Rows of the hysteresis-plus-friction problem: what is linear is worked out once, the rest step by step.

ElasticProblem -> NlpRecording, one a recording, each with its row blocks.

    energy            y - dynamics chi - sum_i (work of spring i) = 0           one row a window
    motor, link       filtered or integrated over windows ("momentum"):
        motor         y - [IA, f] columns - tau_J part = 0
        link          tau_J part - dp/dt - dL/dq parts beta = 0

A block says: values - matrix chi - sign (springs k + knees) - Stribeck = 0; `sums` adds steps up to its rows.

Supported: energy, filtered and momentum rows, in any combination.
Not supported: joint damping; friction on the link side.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.filtered import filter_smooth
from symid.elastic.nlp_sums import FilterSums, StepSums, WindowSums
from symid.elastic.problem import ElasticProblem
from symid.elastic.signals import ElasticSignals
from symid.joint.plays import find_stop_basis, find_work_columns

__all__ = ["NLP_ROWS", "NlpRecording", "RowBlock", "SpringColumns", "build_nlp_recording", "move_stops"]

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
    bases = tuple(find_stop_basis(phi[:, joint], grid) for joint, grid in enumerate(thresholds))
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
            basis[:, stops] = find_stop_basis(phi[:, joint], grid)[:, 1:]
            bases[joint] = basis
            works[joint] = np.diff(find_work_columns(phi[:, joint], grid)[ends], axis=0)[:, 1:]

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
            columns=np.diff(find_work_columns(phi[:, joint], grid)[rows.ends], axis=0),
            sums=_find_window_sums(rows.ends, np.diff(phi[:, joint])),
        )
        for joint, grid in enumerate(part.thresholds)
    )
    return RowBlock(
        name="energy",
        matrix=rows.design,
        values=rows.supplied,
        sign=1.0,
        springs=springs,
        friction=tuple((joint, _find_window_sums(rows.ends, turn[:, joint])) for joint in range(part.size)),
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
    sums = _find_window_sums(ends, np.full(len(signals.time) - 1, signals.period))

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


def _find_window_sums(ends: slice, weights: FloatArray) -> WindowSums:
    count = (ends.stop - 1 - ends.start) // ends.step
    return WindowSums(first=ends.start, length=ends.step, count=count, weights=weights)
