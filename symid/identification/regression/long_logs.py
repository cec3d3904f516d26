"""Equations of logs that are too long for memory: the matrix is condensed as it is made, and never kept.

Library, recordings, processing -> LongRows -> Condensed.

    outline     values, times, velocities, weights of all equations, without the matrix
    segments    stretches of time of one joint in one run: the triangle of [A y]

Fits, standard deviations and warnings are computed from the triangles; residuals take another pass.
Segments begin wherever a block of `compute_block_deviations` or a run begins.

Supported: torque and momentum rows, with 100 equations or more of every joint.
Not supported: power and energy rows, whose covariance needs every row.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification.regression.equations import (
    Rows,
    assemble_rows,
    count_pieces,
    cut_matrix,
    evaluate_torques,
    outline_part,
    stack_rows,
)
from symid.identification.regression.identifiability import BLOCK, Condensed, extend_triangle
from symid.identification.regression.preparation import leave_out_rows, prepare_rows, prepare_states
from symid.logs import Recording, Signals, decimate
from symid.robot import Processing

LONG_KINDS = ("torque", "momentum")
_BLOCKS = 100
"""Blocks of a joint's equations, as many as `compute_block_deviations` has."""


class StatesKeeper:
    """Prepares the states of recordings, and keeps those of the last one: passes over a log share them."""

    def __init__(self) -> None:
        """Keep nothing yet."""
        self._last: tuple[tuple[Library, Recording, Processing], Signals] | None = None

    def prepare(self, library: Library, recording: Recording, processing: Processing) -> Signals:
        """Return the states as `prepare_states`, which reads no standstill speed."""
        processing = replace(processing, standstill=None)
        if self._last is not None:
            (own, log, settings), signals = self._last
            if own is library and log is recording and settings == processing:
                return signals
        # Before others are made: two logs need not be in memory.
        self._last = None
        signals = prepare_states(library, recording, processing)
        self._last = (library, recording, processing), signals
        return signals


class RowBuilder(NamedTuple):
    """How recordings become equations; `window` in s and `overlap` are of momentum rows.

    `keeper` has the states that it prepared last; None to prepare them for every pass.
    """

    kind: str
    library: Library
    processing: Processing
    window: float
    overlap: float
    keeper: StatesKeeper | None = None

    def prepare_states(self, recording: Recording) -> Signals:
        """Return the filtered states of a recording."""
        prepare = prepare_states if self.keeper is None else self.keeper.prepare
        return prepare(self.library, recording, self.processing)

    def prepare(self, recording: Recording) -> Rows:
        """Return the equations of a recording."""
        return prepare_rows(
            self.kind, self.library, recording, self.processing, window=self.window, overlap=self.overlap
        )

    def outline(self, recording: Recording) -> Rows:
        """Return the equations of a recording with their places in time (m, 1), from zero, as matrix."""
        card, signals = self.library.card, self.prepare_states(recording)
        part = outline_part(self.kind, signals, self.processing, self.window, count_pieces(self.overlap))
        places = np.arange(len(part.values), dtype=np.float64)
        part = part._replace(matrix=np.tile(places[:, None, None], (1, card.size, 1)))
        return leave_out_rows(assemble_rows(self.kind, card, part), self.library, recording, self.processing)

    def cut(self, recording: Recording) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the matrix (k, n, p) of a recording's equations by stretches of time, and their places."""
        signals, pieces = self.prepare_states(recording), count_pieces(self.overlap)
        return cut_matrix(
            self.kind, self.library, signals, self.processing, window=self.window, pieces=pieces
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LongRows:
    """Equations without their matrix.

    Args:
        outline: in place of the matrix the places in time (m, 1).
        triangles: (s, p + 1, p + 1) of [A y] of segments, not weighed; starts: (s + 1,) their first rows.
    """

    outline: Rows
    triangles: FloatArray
    starts: NDArray[np.intp]

    def condense(self) -> Condensed:
        """Return the condensed equations of all runs, weighed."""
        groups, size = len(self.outline.group_names), self.triangles.shape[1]
        factors, counts = np.zeros((groups, size, size)), np.zeros(groups, dtype=np.intp)
        for group in range(groups):
            members = self.outline.group == group
            factors[group] = self._join(members[self.starts[:-1]])
            counts[group] = members.sum()
        return Condensed(factors=factors, counts=counts, independent=self.outline.independent)

    def sketch(self) -> Rows:
        """Return p + 1 equations for each of 100 blocks of time of every joint, with the block's squares.

        A'A and A'y of every block are those of its equations, so `compute_block_deviations` gives the same.
        """
        outline, first, size = self.outline, self.starts[:-1], self.triangles.shape[1]
        parts, groups = [], []
        for group in np.unique(outline.group):
            members = outline.group == group
            for block in np.array_split(np.flatnonzero(members), _BLOCKS):
                inside = members[first] & (first >= block[0]) & (first <= block[-1])
                parts.append(self._join(inside))
                groups.append(group)
        table, count = np.vstack(parts), len(parts) * size
        return replace(
            outline,
            matrix=table[:, :-1],
            values=table[:, -1],
            group=np.repeat(groups, size),
            time=np.zeros(count),
            velocity=np.zeros(count),
            run=np.zeros(count, dtype=np.intp),
            weight=np.ones(count),
        )

    def _join(self, inside: NDArray[np.bool_]) -> FloatArray:
        size = self.triangles.shape[1]
        roots = np.sqrt(self.outline.weight[self.starts[:-1][inside]])
        stacked = (self.triangles[inside] * roots[:, None, None]).reshape(-1, size)
        blocks = (stacked[start : start + BLOCK] for start in range(0, len(stacked), BLOCK))
        return extend_triangle(np.zeros((0, size)), blocks)


def condense_recordings(
    maker: RowBuilder, recordings: Sequence[Recording], weights: Sequence[float] | None
) -> LongRows | None:
    """Return the condensed equations of recordings; None where a joint has too few of them for blocks.

    `weights` as for `stack_rows`; errors as for `prepare_rows`.
    """
    outline = stack_rows([maker.outline(entry) for entry in recordings], weights)
    # Where segments begin, and the end.
    begins = {len(outline.values)}
    for group in np.unique(outline.group):
        members = np.flatnonzero(outline.group == group)
        if len(members) < _BLOCKS:
            return None
        begins |= {int(block[0]) for block in np.array_split(members, _BLOCKS)}
        _, firsts = np.unique(outline.run[members], return_index=True)
        begins |= {*members[firsts].tolist()}
    starts = np.array(sorted(begins), dtype=np.intp)
    size = len(outline.names) + 1
    triangles = np.zeros((len(starts) - 1, size, size))
    for run, recording in enumerate(recordings):
        mine, joints = outline.run == run, range(maker.library.card.size)
        own = [np.flatnonzero(mine & (outline.group == joint)) for joint in joints]
        times = [outline.matrix[places, 0].astype(np.intp) for places in own]
        for part, matrix in maker.cut(recording):
            for joint, (places, time) in enumerate(zip(own, times, strict=True)):
                low, high = np.searchsorted(time, [part.start, part.stop])
                if high > low:
                    chosen = places[low:high]
                    columns = matrix[time[low:high] - part.start, joint]
                    _extend(triangles, starts, chosen, np.column_stack([columns, outline.values[chosen]]))
    return LongRows(outline=outline, triangles=triangles, starts=starts)


def _extend(
    triangles: FloatArray, starts: NDArray[np.intp], places: NDArray[np.intp], table: FloatArray
) -> None:
    """Add equations [A y] (k, p + 1) at neighbouring places to the triangles of their segments."""
    owner = np.searchsorted(starts, places, side="right") - 1
    for segment in range(int(owner[0]), int(owner[-1]) + 1):
        low, high = np.searchsorted(owner, [segment, segment + 1])
        blocks = (table[start : min(start + BLOCK, high)] for start in range(low, high, BLOCK))
        triangles[segment] = extend_triangle(triangles[segment], blocks)


def predict_outlines(
    maker: RowBuilder, recordings: Sequence[Recording], outlines: Sequence[Rows], values: FloatArray
) -> list[FloatArray]:
    """Return what parameters (p,) predict of the equations (m,) of each outline, by another pass for all."""
    predicted = [np.empty(len(outline.values)) for outline in outlines]
    for run, recording in enumerate(recordings):
        if maker.kind == "torque":
            torques = evaluate_torques(maker.library, maker.prepare_states(recording), values)
            whole = decimate(torques, maker.processing.decimation)
        else:
            whole = np.concatenate([matrix @ values for _, matrix in maker.cut(recording)])
        for outline, found in zip(outlines, predicted, strict=True):
            own = outline.run == run
            found[own] = whole[outline.matrix[own, 0].astype(np.intp), outline.group[own]]
    return predicted
