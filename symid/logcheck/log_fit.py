"""A quick fit of a log: the equations at some thousand samples, for a look at the log before identification.

Input: a library, an even recording. Output: `LogFit`: rows of every joint, in blocks of consecutive samples.

    Recording -> Signals -> states and torque decimated alike -> blocks -> regressor rows

States pass the decimation instead of columns, which is quick, and true but for dry friction at a reversal.

Supported: rigid joints, with friction that is linear in its parameters.
Not supported: elastic joints.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.encoders import shift_channel
from symid.data.filters import decimate
from symid.data.recording import Recording
from symid.data.signals import prepare_signals
from symid.errors import IdentifiabilityError, Notice
from symid.robot.log_map import Processing
from symid.rows.cutoff import choose_filters
from symid.rows.identifiability import find_resting_joints, settle_joints
from symid.rows.unloading import find_load_torque

__all__ = ["LogFit", "evaluate_rows", "prepare_log_fit", "shift_torque", "solve_rows"]

_BLOCKS = 20
_BLOCK = 200
"""Samples of a block: with twenty blocks some thousand samples, enough for a look."""
_SMALL = 1e-7
_SLOW = 0.02
"""Of the root mean square of a joint's speed: below, dry friction may hold it."""
_NEAR = 3
"""Samples on either side of a reversal, where decimation has smeared what friction does."""
_MOST = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogFit:
    """Equations of a log at blocks of consecutive samples.

    Args:
        q, dq, ddq, tau: (N, n) decimated states and torques of the blocks, one after the other.
        rows: (N, n, p) regressor, friction included.
        keep: (N, n) 1, or 0 where a joint with friction hardly moves: what holds it there is no function of
            its speed.
        blocks: slices of the N samples, each of consecutive ones.
        names: of the p parameters; `inertial` the number of those that are none of friction.
        moving: joints that move in the log.
        period: of the N samples in s; `rate` the log's own period in s.
        recording, processing: what it was made from.
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    rows: FloatArray
    keep: FloatArray
    blocks: tuple[slice, ...]
    names: tuple[str, ...]
    inertial: int
    moving: tuple[int, ...]
    period: float
    recording: Recording
    processing: Processing


def prepare_log_fit(library: Library, recording: Recording, processing: Processing) -> LogFit:
    """Return the equations of a recording; cut-off and decimation that are not stated are chosen.

    Raises:
        IdentifiabilityError: no joint moves.
        LogError: the recording is uneven or too short for the settings.
    """
    processing = choose_filters(replace(processing, automatic=True), [recording]).processing
    resting = find_resting_joints(recording)
    moving = tuple(joint for joint in range(library.card.size) if joint not in resting)
    if not moving:
        text = (
            "no joint moves in this log beyond the noise of its encoder: nothing can be learnt from it; "
            "record one in which every joint accelerates and turns both ways"
        )
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text, file=recording.source))
    signals = settle_joints(prepare_signals(recording, processing), resting)
    load = find_load_torque(library, signals, recording)
    if load is not None:
        torque = recording.torque.copy()
        torque[processing.drop_first : processing.drop_first + len(load)] -= load
        recording, signals = replace(recording, torque=torque), replace(signals, tau=signals.tau - load)
    columns = np.hstack([signals.q, signals.dq, signals.ddq, signals.tau])
    thin = _thin_out(columns, processing)
    blocks = _choose_blocks(len(thin))
    kept = np.vstack([thin[block] for block in blocks])
    q, dq, ddq, tau = (np.ascontiguousarray(part) for part in np.split(kept, 4, axis=1))
    bounds = np.cumsum([0, *(block.stop - block.start for block in blocks)])
    card = library.card
    return LogFit(
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        rows=evaluate_rows(library, q, dq, ddq),
        keep=_find_kept(library, dq, processing.standstill),
        blocks=tuple(slice(int(low), int(high)) for low, high in pairwise(bounds)),
        names=tuple(entry.name for entry in (*card.beta, *card.friction)),
        inertial=len(card.beta),
        moving=moving,
        period=signals.period * processing.decimation.factor,
        recording=recording,
        processing=processing,
    )


def _thin_out(values: FloatArray, processing: Processing) -> FloatArray:
    """Return the decimated columns of `values` (N, k), constants kept as they are.

    A Chebyshev filter of even order passes a constant with its ripple: harmless where all columns of a model
    pass it, not where states do.
    """
    thin = decimate(np.column_stack([values, np.ones(len(values))]), processing.decimation)
    return np.ascontiguousarray(thin[:, :-1] / thin[:, -1:])


def _find_kept(library: Library, dq: FloatArray, standstill: float) -> FloatArray:
    slow = np.maximum(standstill, _SLOW * np.sqrt(np.mean(dq**2, axis=0)))
    braked = np.array([joint.friction != "none" for joint in library.card.joints])
    held = (np.abs(dq) < slow) & braked
    # A change of sign counts even where no sample falls on it.
    held[1:] |= (dq[1:] * dq[:-1] < 0.0) & braked
    near = held.copy()
    for step in range(1, _NEAR + 1):
        near[step:] |= held[:-step]
        near[:-step] |= held[step:]
    # A joint that is slow throughout would not be looked at.
    return np.where(near & (np.mean(near, axis=0) < _MOST), 0.0, 1.0)


def _choose_blocks(count: int) -> list[slice]:
    """Return blocks of the samples: all of them, or pieces at even distances."""
    number = max(2, min(_BLOCKS, count // 10))
    bounds = np.linspace(0, count, number + 1).astype(int).tolist()
    return [slice(low, min(high, low + _BLOCK)) for low, high in pairwise(bounds)]


def evaluate_rows(library: Library, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """Return the regressor of the torques, friction included, at states (N, n): (N, n, p)."""
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    if not library.card.friction:
        return rigid
    (friction,) = library.evaluate("friction_regressor", dq)
    return np.concatenate([rigid, friction], axis=2)


def shift_torque(fit: LogFit, delay: float) -> FloatArray:
    """Return the torques (N, n) of the fit's samples with the torque channel moved ahead by `delay` s."""
    recording = fit.recording
    moved = shift_channel(recording.time, recording.torque, delay)
    signals = prepare_signals(replace(recording, torque=moved), fit.processing)
    thin = _thin_out(signals.tau, fit.processing)
    return np.vstack([thin[block] for block in _choose_blocks(len(thin))])


def solve_rows(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least-squares solution (p,) of least norm in columns of length one."""
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    solution = np.linalg.lstsq(matrix * scales, values, rcond=_SMALL)[0]
    return np.asarray(solution * scales, dtype=np.float64)
