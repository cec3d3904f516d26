"""Alignment of motor and link encoders: the delay between their channels, and the zero of each run.

Recordings with both encoders, columns that the torsion may follow -> Alignment; recordings with the link
channel, q(t - delay) - offset, moved onto the motor's clock and zero.

    theta - link = delay dq + offset + torsion,  torsion = columns @ weights

Torques of a rigid body are even under reversal of time, dq is odd: the delay is not mistaken for torsion. Dry
friction and hysteresis are odd too and need columns. The fit is repeated until the delay converges.

Supported: one delay of either sign for all joints and runs; an offset for each joint and run, where no
constant torsion of the columns looks the same; standard deviations by the jackknife over blocks of time.
Not supported: delays that change, or differ from joint to joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FloatMatrix, FrozenArrays
from symid.errors import LogError, Notice
from symid.logs.recording import Recording, add_notice, cut_recording, spread_bad
from symid.logs.signals import describe_uneven, differentiate, low_pass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Encoders:
    """Positions theta of motors and q of links, (N, n) each, and where there is a link encoder, (n,)."""

    theta: FloatArray
    q: FloatArray
    present: NDArray[np.bool_]


def get_encoders(recording: Recording) -> Encoders:
    """Return motor and link positions (LogError: only one); constant or copied link channels are none."""
    if recording.motor_position is not None:
        theta, q = recording.motor_position, recording.position
    elif recording.link_position is not None:
        theta, q = recording.position, recording.link_position
    else:
        text = "the log has one position a joint; alignment needs a second encoder"
        raise LogError(Notice(code="log.one-encoder", text=text, file=recording.source))
    present = (np.ptp(q, axis=0) > 0.0) & np.any(theta != q, axis=0) & (np.ptp(theta, axis=0) > 0.0)
    return Encoders(theta=theta, q=q, present=present)


def shift_channel(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Return `values` (N, n) at time + delay (s), by cubic splines; beyond the ends they stay."""
    if delay == 0.0:
        return values
    spline = scipy.interpolate.CubicSpline(time, values, axis=0)
    return np.asarray(spline(np.clip(time + delay, time[0], time[-1])))


def split_blocks(samples: int, period: float, edge: float, block: float) -> tuple[slice, ...]:
    """Return blocks of equal length, about `block` s, of a run without `edge` s at either end."""
    first = int(np.ceil(edge / period))
    count = max(2, round((samples - 2 * first) * period / block))
    bounds = np.linspace(first, samples - first, count + 1).astype(int).tolist()
    return tuple(slice(low, high) for low, high in pairwise(bounds))


_CUTOFF = 25.0
"""Hz; above the frequencies of robot motion."""
_LEAST_RATIO = 10.0
_ORDER = 4
_EDGE = 0.5
"""Seconds at each end of a filtered signal that are not used."""
_BLOCK = 1.0
"""Seconds of a block: longer than the correlation of the residual."""
_ROUNDS = 12
_CONVERGED = 1e-4
"""Relative to a sample period: a smaller shift ends the search."""
_LARGEST = 0.1
"""Largest delay in s."""
_RESTING = 0.02
"""Rad or m, well above the torsion of a joint that rests."""
_SIGNIFICANT = 5.0
"""Standard deviations from which on a delay or an offset is significant."""
_SMALLEST = 1e-6
"""Smallest significant delay in s; joints move by less than an encoder step in it."""
_INDEPENDENT_PART = 0.02
"""Least share of an offset's column that no other column explains, for the offset to be identifiable."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment(FrozenArrays):
    """Delay and offsets of the link channel against the motor channel.

    Args:
        delay: s by which the link channel lags; `delay_std` its standard deviation.
        delays, delay_stds: (n,) of each joint alone; NaN where there is no link encoder.
        offsets, offset_stds: (runs, n) rad or m to be added to the link channel; NaN likewise, and where an
            offset is not identifiable.
        explained: (n,) share of the variance of theta - q, without offsets, that the delay alone explains.
        residual: (n,) RMS residual of delay, offsets and columns, rad or m.
        present: (n,) joints with a link encoder.
        sources: the recordings, in the order of the runs.
    """

    delay: float
    delay_std: float
    delays: FloatArray
    delay_stds: FloatArray
    offsets: FloatMatrix
    offset_stds: FloatMatrix
    explained: FloatArray
    residual: FloatArray
    present: NDArray[np.bool_]
    sources: tuple[str, ...]

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Return which joints (n,) have a link encoder, but in some run an unidentifiable offset."""
        return np.asarray(self.present & np.isnan(self.offsets).any(axis=0))

    @property
    def late(self) -> bool:
        """Return whether the delay, of either sign, is significant."""
        return abs(self.delay) > max(_SIGNIFICANT * self.delay_std, _SMALLEST)


def estimate_alignment(recordings: Sequence[Recording], columns: Sequence[FloatArray]) -> Alignment:
    """Return delay and offsets of recordings of one robot, evenly sampled, at one rate, or raise why not.

    `columns` (N, n, k) of each recording are regressors of the torsion of each joint: its torque, the plays
    of it, the direction of motion; not multiples of its velocity.
    """
    pairs = [get_encoders(recording) for recording in recordings]
    present = np.logical_and.reduce([pair.present for pair in pairs])
    uneven = (describe_uneven(recording.time, file=recording.source) for recording in recordings)
    mistakes = [notice for notice in uneven if notice is not None]
    least = 2.0 * _EDGE + 4.0 * _BLOCK
    for recording in recordings:
        span = recording.time[-1] - recording.time[0]
        if span < least:
            text = f"{span:.3g} s are too short to estimate a delay; at least {least:g} s are needed"
            mistakes.append(Notice(code="log.short-alignment", text=text, file=recording.source))
    if not present.any():
        text = "no joint moves and has both encoders in all logs: delay and torsion are not identifiable"
        mistakes.append(Notice(code="log.no-link-encoder", text=text, file=recordings[0].source))
    if mistakes:
        raise LogError(*mistakes)
    first, step = _fit_joints(recordings, pairs, columns, 0.0)
    found, delay = first, step
    for _ in range(_ROUNDS):
        if abs(step) < _CONVERGED * recordings[0].period:
            break
        found, step = _fit_joints(recordings, pairs, columns, delay)
        delay = float(np.clip(delay + step, -_LARGEST, _LARGEST))
    found = replace(found, explained=first.explained)
    # In slow logs the delay may be so uncertain that the search diverges; then it is not significant. A delay
    # of a good part of a period may lead the search to a wrong one, which explains little.
    beyond = max(abs(delay), abs(found.delay)) >= _LARGEST
    gaps = [np.std(pair.theta - pair.q, axis=0) for pair in pairs]
    # Half of what the largest delay makes of the speeds; joints that rest have torsion and no speed.
    speeds = [
        np.sqrt(np.mean((np.diff(pair.theta, axis=0) / recording.period) ** 2, axis=0))
        for recording, pair in zip(recordings, pairs, strict=True)
    ]
    largest = _RESTING + 0.5 * _LARGEST * np.max(speeds, axis=0)
    lost = largest < (np.max(gaps, axis=0) if beyond else found.residual)
    if (beyond and found.late) or np.any(lost & present):
        text = f"the delay between motor and link encoders exceeds {1e3 * _LARGEST:g} ms, or they are not of "
        text += "the same joints in the same order; check the columns, and bring both channels onto one clock"
        files = [recording.source for recording in recordings]
        raise LogError(*(Notice(code="log.delay-beyond", text=text, file=file) for file in files))
    return found


def _fit_joints(
    recordings: Sequence[Recording], pairs: Sequence[Encoders], columns: Sequence[FloatArray], shift: float
) -> tuple[Alignment, float]:
    """Return the alignment, fitted after a `shift` of the link channel, and the delay beyond that shift."""
    present = np.logical_and.reduce([pair.present for pair in pairs])
    parts: dict[int, list[FloatArray]] = {int(joint): [] for joint in np.flatnonzero(present)}
    for run, (recording, pair) in enumerate(zip(recordings, pairs, strict=True)):
        period = recording.period
        cutoff = min(_CUTOFF, 1.0 / (_LEAST_RATIO * period))
        pairing = (pair.theta, shift_channel(recording.time, pair.q, shift))
        theta, q = (low_pass(part, period=period, cutoff=cutoff, order=_ORDER) for part in pairing)
        speed, gap = differentiate(theta, period), theta - q
        zero = np.zeros((len(gap), len(recordings)))
        zero[:, run] = 1.0
        for joint, found in parts.items():
            design = np.column_stack([speed[:, joint], zero, columns[run][:, joint], gap[:, joint]])
            found += [design[rows] for rows in split_blocks(len(gap), period, _EDGE + abs(shift), _BLOCK)]
    # Of each joint: delay and offsets, NaN if unidentifiable, their standard deviations, the delay without
    # each block, the explained share of the variance, the RMS residual.
    fits = []
    head = [*range(len(recordings) + 1), -1]
    for blocks in parts.values():
        grams = np.array([block_rows.T @ block_rows for block_rows in blocks])
        whole = grams.sum(axis=0)
        without = np.array([_solve(whole - gram)[: len(head) - 1] for gram in grams])
        still = _compute_residual_square(whole[np.ix_(head[1:], head[1:])])
        delayed = _compute_residual_square(whole[np.ix_(head, head)])
        identifiable = [True]
        for column in head[1:-1]:
            order = [*(other for other in range(len(whole) - 1) if other != column), column]
            left = _compute_residual_square(whole[np.ix_(order, order)])
            identifiable.append(left > _INDEPENDENT_PART**2 * float(whole[column, column]))
        rest = max(_compute_residual_square(whole), 0.0) / sum(map(len, blocks))
        fits.append(
            (
                np.where(identifiable, _solve(whole)[: len(head) - 1], np.nan),
                np.where(identifiable, _compute_jackknife_std(without), np.nan),
                without[:, 0],
                1.0 - delayed / max(still, 1e-300),
                float(np.sqrt(rest)),
            )
        )
    values, stds, replicates, explained, residual = (np.array(part) for part in zip(*fits, strict=True))
    spread = np.maximum(stds[:, 0], 1e-12)
    weights = (1.0 / spread**2) / np.sum(1.0 / spread**2)
    step = float(weights @ values[:, 0])
    # Deviations are too small where joints disagree by more than them (Birge 1932).
    excess = float(np.sum(((values[:, 0] - step) / spread) ** 2)) / max(1, len(parts) - 1)

    def fill(part: FloatArray) -> FloatArray:
        filled = np.full((len(present), *part.shape[1:]), np.nan)
        filled[list(parts)] = part
        return filled.T

    scatter = float(_compute_jackknife_std(np.ascontiguousarray(replicates.T) @ weights))
    alignment = Alignment(
        delay=shift + step,
        delay_std=scatter * max(1.0, excess) ** 0.5,
        delays=fill(shift + values[:, 0]),
        delay_stds=fill(stds[:, 0]),
        offsets=fill(values[:, 1:]),
        offset_stds=fill(stds[:, 1:]),
        explained=fill(explained),
        residual=fill(residual),
        present=present,
        sources=tuple(recording.source for recording in recordings),
    )
    return alignment, step


def _solve(gram: FloatArray) -> FloatArray:
    """Return the least-squares solution of [A | y] from its Gram matrix, of least norm in scaled columns."""
    inner, right = gram[:-1, :-1], gram[:-1, -1]
    lengths = np.sqrt(np.diag(inner))
    scales = np.where(lengths > 0.0, lengths, 1.0)
    scaled = np.linalg.lstsq(inner / np.outer(scales, scales), right / scales, rcond=1e-12)[0]
    return np.asarray(scaled / scales)


def _compute_residual_square(gram: FloatArray) -> float:
    """Return |y - A x|^2 of the least-squares solution, from the Gram matrix of [A | y]."""
    left = np.append(_solve(gram), -1.0)
    return float(left @ gram @ left)


def _compute_jackknife_std(replicates: FloatArray) -> FloatArray:
    """Return the jackknife standard deviations of values without each of n blocks (n, ...)."""
    n = len(replicates)
    spread = replicates - replicates.mean(axis=0)
    return np.asarray(np.sqrt((n - 1) / n * np.sum(spread**2, axis=0)))


def keep_significant(alignment: Alignment) -> Alignment | None:
    """Return the alignment without insignificant delay and offsets; None if nothing is left."""
    delay = alignment.delay if alignment.late else 0.0
    sure = np.abs(alignment.offsets) > _SIGNIFICANT * alignment.offset_stds
    offsets = np.where(np.isnan(alignment.offsets), np.nan, np.where(sure, alignment.offsets, 0.0))
    if delay == 0.0 and not sure.any():
        return None
    return replace(alignment, delay=delay, offsets=offsets)


def shift_link_channel(recording: Recording, alignment: Alignment, *, run: int) -> Recording:
    """Return the recording with its link channel shifted by `delay`, the offset of run `run` added.

    Samples beyond the ends repeat them. Joints without link encoder, and unidentifiable offsets, stay.
    """
    pair, delay = get_encoders(recording), alignment.delay
    moved = shift_channel(recording.time, pair.q, delay) + np.nan_to_num(alignment.offsets[run], nan=0.0)
    moved = np.where(alignment.present, moved, pair.q)
    if recording.motor_position is None:
        return replace(recording, link_position=moved)
    velocity, acceleration = (
        None if values is None else shift_channel(recording.time, values, delay)
        for values in (recording.velocity, recording.acceleration)
    )
    return replace(recording, position=moved, velocity=velocity, acceleration=acceleration)


def align(recording: Recording, alignment: Alignment, *, run: int) -> Recording:
    """Return the recording with its link channel on the motor's clock and zero, with a notice.

    The channel is moved as by `shift_link_channel`; samples that it does not reach are cut off.
    """
    delay = alignment.delay
    lost = int(np.ceil(abs(delay) / recording.period - 1e-9))
    kept = slice(0, len(recording.time) - lost) if delay >= 0.0 else slice(lost, None)
    shifted = shift_link_channel(recording, alignment, run=run)
    if recording.bad is not None:
        shifted = replace(shifted, bad=spread_bad(recording.bad, lost))
    moved = cut_recording(shifted, kept)
    parts = []
    if alignment.late:
        side = "later" if alignment.delay > 0.0 else "earlier"
        size = f"{1e3 * abs(delay):.4g} ms (standard deviation {1e3 * alignment.delay_std:.2g} ms)"
        parts.append(f"by {size}, as they are {side} than the motor encoders")
    largest = float(np.max(np.abs(np.nan_to_num(alignment.offsets[run], nan=0.0))))
    if largest:
        parts.append(f"by zero offsets of up to {largest:.3g}")
    text = f"the link encoders were moved {', and '.join(parts)}" if parts else "the link encoders were kept"
    if lost:
        text += f"; {lost} samples at the {'end' if alignment.delay > 0.0 else 'beginning'} were cut off"
    return add_notice(moved, "log.aligned", text)
