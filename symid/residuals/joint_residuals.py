"""What a model leaves of the torque of each joint, with all that it may follow.

Input: parameters, the library of their model, recordings. Output: `JointResidual` of each joint that moves.

Supported: logs of any length: the equations of one joint are in memory at a time, and where they take too
much of it only one in some of them.
Not supported: residuals of momentum rows; whatever the fit, those of torque rows are looked at.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.functions import JointCard
from symid.codegen.library import Library
from symid.data.recording import Recording, Signals
from symid.data.signals import decimate_blocks, decimate_columns, prepare_signals
from symid.residuals.residual_families import Motion
from symid.robot.log_map import Decimation, Processing
from symid.rows.cutoff import choose_filters
from symid.rows.identifiability import find_resting_joints, settle_joints
from symid.rows.row_parts import evaluate_columns, evaluate_torques
from symid.rows.unloading import take_load_off

__all__ = ["BLOCKS", "LARGEST", "JointResidual", "find_joint_residuals"]

BLOCKS = 8
"""Stretches of time that are held out in turn."""
LARGEST = 2e8
"""Bytes of a joint's equations that are held in memory."""
_TINY = 1e-300


class _Thinning(NamedTuple):
    """How columns become fewer rows: decimated, and one in `step` of the rows taken."""

    decimation: Decimation
    step: int

    def apply(self, columns: Sequence[FloatArray]) -> FloatArray:
        """Return columns (N,), one after the other: (M, k)."""
        if not columns:
            return np.empty((0, 0))
        return np.column_stack(
            [decimate_columns(column, self.decimation)[:: self.step] for column in columns]
        )


class _Log(NamedTuple):
    """Signals, the torque foretold at every sample (N, n), and what the squares of residuals count for."""

    library: Library
    signals: Signals
    predicted: FloatArray
    weight: float

    def tabulate(self, joint: int, thinning: _Thinning) -> FloatArray:
        """Return [Y | Yf] of a joint and its torque: (M, p + 1)."""

        def evaluate(part: slice) -> FloatArray:
            columns = evaluate_columns(self.library, self.signals, part)[:, joint]
            return np.column_stack([columns, self.signals.tau[part, joint]])

        blocks = decimate_blocks(evaluate, len(self.signals.time), thinning.decimation)
        return np.vstack([rows[-part.start % thinning.step :: thinning.step] for part, rows in blocks])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointResidual:
    """What is left of one joint.

    Args:
        error: (m,) torque that is left, weighed; plain: (m,) not weighed.
        roots: (m,) of the weights, of mean square one.
        span: (m, r) orthonormal basis of the model's columns, weighed.
        blocks: (m,) stretch of time of each row, `BLOCKS` of them.
        motions: of the logs, at full rate; thinning: what made rows of them.
    """

    error: FloatArray
    plain: FloatArray
    roots: FloatArray
    span: FloatArray
    blocks: NDArray[np.intp]
    motions: tuple[Motion, ...]
    thinning: _Thinning

    def thin_out(self, build: Callable[[Motion], list[FloatArray]]) -> FloatArray:
        """Return functions of the motions as rows (m, k), not weighed."""
        return np.vstack([self.thinning.apply(build(motion)) for motion in self.motions])


def find_joint_residuals(
    values: FloatArray,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    weights: Sequence[float] | None = None,
    largest: float = LARGEST,
) -> Iterator[tuple[JointCard, JointResidual]]:
    """Yield every joint that moves in one of the logs, with what is left of its torque.

    Args:
        values: (p,) base parameters and friction, in the order of the library's card.
        library: the functions of the robot.
        recordings: logs, of the fit or held out.
        processing: filter and decimation.
        weights: what the squares of each log's residuals count for; one if None.
        largest: bytes of a joint's equations.
    """
    processing = choose_filters(processing, recordings).processing
    rows = sum(len(entry.time) for entry in recordings) / processing.decimation.factor
    step = max(1, math.ceil(8.0 * rows * (len(values) + 1) / largest))
    thinning = _Thinning(processing.decimation, step)
    logs = []
    for recording, weight in zip(recordings, weights or [1.0] * len(recordings), strict=True):
        resting = find_resting_joints(recording)
        signals = settle_joints(prepare_signals(recording, processing), resting)
        signals = take_load_off(library, signals, recording)
        logs.append(
            (_Log(library, signals, evaluate_torques(library, signals, values), weight), set(resting))
        )
    for joint, card in enumerate(library.card.joints):
        moving = [log for log, resting in logs if joint not in resting]
        if moving:
            yield card, _find_residual(values, moving, joint, thinning)


def _find_residual(
    values: FloatArray, logs: Sequence[_Log], joint: int, thinning: _Thinning
) -> JointResidual:
    parts = [log.tabulate(joint, thinning) for log in logs]
    roots = _find_roots([log.weight for log in logs], [len(part) for part in parts])
    plain = np.concatenate([part[:, -1] - part[:, :-1] @ values for part in parts])
    table = np.vstack(parts) * roots[:, None]
    error = plain * roots
    # What rounding leaves has no structure.
    if float(error @ error) <= 1e-20 * float(table[:, -1] @ table[:, -1]):
        error = np.zeros_like(error)
    return JointResidual(
        error=error,
        plain=plain,
        roots=roots,
        span=_find_span(table[:, :-1]),
        blocks=_number_blocks([len(part) for part in parts]),
        motions=tuple(Motion(signals=log.signals, predicted=log.predicted, joint=joint) for log in logs),
        thinning=thinning,
    )


def _find_roots(weights: Sequence[float], lengths: Sequence[int]) -> FloatArray:
    """Return the roots of the logs' weights, row by row, scaled so that their mean square is one."""
    weight = np.repeat(np.asarray(weights, dtype=float), lengths)
    roots: FloatArray = np.sqrt(weight / weight.mean())
    return roots


def _find_span(model: FloatArray) -> FloatArray:
    """Return an orthonormal basis (m, r) of the columns."""
    lengths = np.linalg.norm(model, axis=0)
    alive = lengths > 1e-12 * max(lengths.max(initial=0.0), _TINY)
    left, singular, _ = np.linalg.svd(model[:, alive] / lengths[alive], full_matrices=False)
    return np.asarray(left[:, singular > 1e-9 * max(singular.max(initial=0.0), _TINY)])


def _number_blocks(lengths: Sequence[int]) -> NDArray[np.intp]:
    """Return the block of each row, the logs cut alike, so that each block holds a part of every log."""
    return np.concatenate([np.arange(length) * BLOCKS // length for length in lengths])
