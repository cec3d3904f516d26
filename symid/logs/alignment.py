"""Alignment of motor and link encoders: the delay between their channels, and the zero of each run.

Recordings with both encoders, columns that the torsion may follow -> Alignment; recordings with the link
channel moved onto the motor's clock and zero.

The link channel holds q(t - delay) - offset, so that theta minus it is

    delay dq + offset + torsion,  torsion = columns @ weights.

Torques of a rigid body are even under reversal of time, dq is odd: the delay is not mistaken for torsion.
What is odd besides, dry friction and hysteresis, needs columns of its own. The fit is repeated with the
channel really shifted until the delay no longer changes.

Supported: positions of the motors or of the links, the other side as the second encoder; a delay of any
fraction of a sample, of either sign, shared by all joints and runs; an offset for each joint and run,
where no constant torsion that the columns allow looks the same; standard deviations by leaving out blocks
of time (the jackknife), which holds for errors that are correlated within a block; joints without a link
encoder.
Not supported: recordings of one position a joint; delays that change, or differ from joint to joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import LogError, Notice
from symid.logs.recording import Recording, cut_recording
from symid.logs.signals import describe_uneven, differentiate, low_pass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Encoders:
    """Positions theta of motors and q of links, (N, n) each, and where there is a link encoder, (n,)."""

    theta: FloatArray
    q: FloatArray
    present: NDArray[np.bool_]


def get_encoders(recording: Recording) -> Encoders:
    """Return motor and link positions; a link channel that is constant or a copy is no encoder.

    Raises:
        LogError: the recording has one position only.
    """
    if recording.motor_position is not None:
        theta, q = recording.motor_position, recording.position
    elif recording.link_position is not None:
        theta, q = recording.position, recording.link_position
    else:
        text = "the log has one position a joint: without a second encoder there is nothing to align"
        raise LogError(Notice(code="log.one-encoder", text=text, file=recording.source))
    present = (np.ptp(q, axis=0) > 0.0) & np.any(theta != q, axis=0) & (np.ptp(theta, axis=0) > 0.0)
    return Encoders(theta=theta, q=q, present=present)


def shift_channel(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Return `values` (N, n) at time + delay (s), by cubic splines; beyond the ends they stay."""
    if delay == 0.0:
        return values
    from scipy.interpolate import CubicSpline

    moved: FloatArray = CubicSpline(time, values, axis=0)(np.clip(time + delay, time[0], time[-1]))
    return moved


def split_blocks(samples: int, period: float, edge: float, block: float) -> tuple[slice, ...]:
    """Return blocks of equal length, about `block` s, of a run without `edge` s at either end."""
    first = int(np.ceil(edge / period))
    count = max(2, round((samples - 2 * first) * period / block))
    bounds = np.linspace(first, samples - first, count + 1).astype(int).tolist()
    return tuple(slice(low, high) for low, high in pairwise(bounds))


_CUTOFF = 25.0
"""Hz; above what robots move at."""
_LEAST_RATIO = 10.0
_ORDER = 4
_EDGE = 0.5
"""Seconds at each end that a filtered signal is not trusted for."""
_BLOCK = 1.0
"""Seconds of a block: longer than the residual remembers."""
_ROUNDS = 12
_CONVERGED = 1e-4
"""Of a sample period: a shift this small ends the search."""
_LARGEST = 0.1
"""Seconds; a larger delay is no delay between channels of one controller."""
_RESTING = 0.02
"""Rad or m, well above the torsion of a joint that rests."""
_SIGNIFICANT = 5.0
"""Standard deviations from which on a delay or an offset counts as there."""
_SMALLEST = 1e-6
"""Seconds; joints move by less than a step of their encoders in it."""
_INDEPENDENT_PART = 0.02
"""Of an offset's column, the part that no other column explains; with less it cannot be told from them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment(FrozenArrays):
    """What moves the link channel onto the motor's clock and zero.

    Args:
        delay: s by which the link channel lags; `delay_std` its standard deviation.
        delays, delay_stds: (n,) of each joint alone; NaN where there is no link encoder.
        offsets, offset_stds: (runs, n) rad or m to be added to the link channel; NaN likewise, and where a
            constant torsion looks like an offset.
        explained: (n,) part of the variance of theta - q, offsets apart, that the delay alone explains.
        residual: (n,) root mean square of what delay, offsets and columns leave, rad or m.
        present: (n,) joints with a link encoder.
        sources: the recordings, in the order of the runs.
    """

    delay: float
    delay_std: float
    delays: FloatArray
    delay_stds: FloatArray
    offsets: FloatArray
    offset_stds: FloatArray
    explained: FloatArray
    residual: FloatArray
    present: NDArray[np.bool_]
    sources: tuple[str, ...]

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Return which joints (n,) have a link encoder, but in some run an offset that cannot be told."""
        result: NDArray[np.bool_] = self.present & np.isnan(self.offsets).any(axis=0)
        return result

    @property
    def late(self) -> bool:
        """Return whether there is a delay, of either sign, beyond doubt and of a size that matters."""
        return abs(self.delay) > max(_SIGNIFICANT * self.delay_std, _SMALLEST)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _JointAlignment:
    """Delay and offsets (1 + runs,) of one joint, their deviations, and the delay without each block.

    Offsets that cannot be told from the columns are NaN.
    """

    values: FloatArray
    stds: FloatArray
    replicates: FloatArray
    explained: float
    residual: float


def estimate_alignment(
    recordings: Sequence[Recording], columns: Sequence[FloatArray], *, block: float = _BLOCK
) -> Alignment:
    """Return delay and offsets.

    Args:
        recordings: of one robot, evenly sampled, at one rate.
        columns: for each recording (N, n, k), what the torsion of each joint may follow: its joint torque,
            the plays of it, the direction of motion; not multiples of its velocity.
        block: length of the blocks of the jackknife in s.

    Raises:
        LogError: a recording lacks an encoder, is uneven or too short; no joint has a link encoder or moves;
            the delay is beyond what is searched.
    """
    pairs = [get_encoders(recording) for recording in recordings]
    present = np.logical_and.reduce([pair.present for pair in pairs])
    _check_recordings(recordings, present)
    first = fits = _fit_joints(recordings, pairs, columns, 0.0, block)
    delay = step = _average_delay(first)
    for _ in range(_ROUNDS):
        if abs(step) < _CONVERGED * recordings[0].period:
            break
        fits = _fit_joints(recordings, pairs, columns, delay, block)
        step = _average_delay(fits)
        delay = float(np.clip(delay + step, -_LARGEST, _LARGEST))
    sources = tuple(recording.source for recording in recordings)
    found = _assemble(fits, delay - step, first, present, sources)
    # Slow logs may leave the delay so vague that the search wanders off; then none counts as there. A delay
    # of a good part of a period may lead the search to a wrong one, which explains little.
    beyond = max(abs(delay), abs(found.delay)) >= _LARGEST
    gaps = [np.std(pair.theta - pair.q, axis=0) for pair in pairs]
    lost = _compute_largest_shift(recordings, pairs) < (np.max(gaps, axis=0) if beyond else found.residual)
    if (beyond and found.late) or np.any(lost & present):
        text = (
            f"the delay between motor and link encoders is beyond the {1e3 * _LARGEST:g} ms that are "
            "searched, or these are not two encoders of the same joints in the same order: check the "
            "columns, and bring both channels onto one clock before"
        )
        files = [recording.source for recording in recordings]
        raise LogError(*(Notice(code="log.delay-beyond", text=text, file=file) for file in files))
    return found


def _check_recordings(recordings: Sequence[Recording], present: NDArray[np.bool_]) -> None:
    uneven = (describe_uneven(recording.time, file=recording.source) for recording in recordings)
    mistakes = [notice for notice in uneven if notice is not None]
    least = 2.0 * _EDGE + 4.0 * _BLOCK
    for recording in recordings:
        span = recording.time[-1] - recording.time[0]
        if span < least:
            text = f"{span:.3g} s are too short to find a delay: {least:g} s are needed"
            mistakes.append(Notice(code="log.short-alignment", text=text, file=recording.source))
    if not present.any():
        text = "no joint has both encoders in all logs and moves: neither delay nor torsion can be told"
        mistakes.append(Notice(code="log.no-link-encoder", text=text, file=recordings[0].source))
    if mistakes:
        raise LogError(*mistakes)


def _compute_largest_shift(recordings: Sequence[Recording], pairs: Sequence[Encoders]) -> FloatArray:
    """Return half of what the largest delay makes of the speeds of the joints (n,), rad or m, and some more.

    Joints that rest while others move have torsion and no speed.
    """
    speeds = [
        np.sqrt(np.mean((np.diff(pair.theta, axis=0) / recording.period) ** 2, axis=0))
        for recording, pair in zip(recordings, pairs, strict=True)
    ]
    most: FloatArray = _RESTING + 0.5 * _LARGEST * np.max(speeds, axis=0)
    return most


def _fit_joints(
    recordings: Sequence[Recording],
    pairs: Sequence[Encoders],
    columns: Sequence[FloatArray],
    delay: float,
    block: float,
) -> dict[int, _JointAlignment]:
    """Return the fit of every joint with a link encoder, the channel shifted by `delay` before."""
    present = np.logical_and.reduce([pair.present for pair in pairs])
    parts: dict[int, list[FloatArray]] = {int(joint): [] for joint in np.flatnonzero(present)}
    for run, (recording, pair) in enumerate(zip(recordings, pairs, strict=True)):
        period = recording.period
        cutoff = min(_CUTOFF, 1.0 / (_LEAST_RATIO * period))
        shifted = shift_channel(recording.time, pair.q, delay)
        theta, q = (
            low_pass(values, period=period, cutoff=cutoff, order=_ORDER) for values in (pair.theta, shifted)
        )
        speed, gap = differentiate(theta, period), theta - q
        zero = np.zeros((len(gap), len(recordings)))
        zero[:, run] = 1.0
        for joint, found in parts.items():
            design = np.column_stack([speed[:, joint], zero, columns[run][:, joint], gap[:, joint]])
            found += [design[rows] for rows in split_blocks(len(gap), period, _EDGE + abs(delay), block)]
    return {joint: _fit_blocks(found, len(recordings)) for joint, found in parts.items()}


def _fit_blocks(blocks: list[FloatArray], runs: int) -> _JointAlignment:
    """Return delay and offsets by least squares over all blocks, and their scatter without each block."""
    grams = np.array([part.T @ part for part in blocks])
    whole = grams.sum(axis=0)
    values = _solve(whole)
    replicates = np.array([_solve(whole - gram)[: runs + 1] for gram in grams])
    head = [*range(runs + 1), -1]
    offsets = _compute_residual_square(whole[np.ix_(head[1:], head[1:])])
    delayed = _compute_residual_square(whole[np.ix_(head, head)])
    samples = sum(map(len, blocks))
    seen = np.array([True, *(_is_independent(whole, 1 + run) for run in range(runs))])
    return _JointAlignment(
        values=np.where(seen, values[: runs + 1], np.nan),
        stds=np.where(seen, _compute_jackknife_std(replicates), np.nan),
        replicates=replicates[:, 0],
        explained=1.0 - delayed / max(offsets, 1e-300),
        residual=float(np.sqrt(max(_compute_residual_square(whole), 0.0) / samples)),
    )


def _solve(gram: FloatArray) -> FloatArray:
    """Return the least-squares solution of [A | y] from its Gram matrix, of least norm in scaled columns."""
    inner, right = gram[:-1, :-1], gram[:-1, -1]
    lengths = np.sqrt(np.diag(inner))
    scales = np.where(lengths > 0.0, lengths, 1.0)
    scaled = np.linalg.lstsq(inner / np.outer(scales, scales), right / scales, rcond=1e-12)[0]
    values: FloatArray = scaled / scales
    return values


def _is_independent(gram: FloatArray, column: int) -> bool:
    """Return whether a column of A says something that its others do not, from the Gram matrix of [A | y]."""
    order = [*(other for other in range(len(gram) - 1) if other != column), column]
    left = _compute_residual_square(gram[np.ix_(order, order)])
    return left > _INDEPENDENT_PART**2 * float(gram[column, column])


def _compute_residual_square(gram: FloatArray) -> float:
    """Return |y - A x|^2 of the least-squares solution, from the Gram matrix of [A | y]."""
    left = np.append(_solve(gram), -1.0)
    return float(left @ gram @ left)


def _compute_jackknife_std(replicates: FloatArray) -> FloatArray:
    """Return the standard deviations that values without each of n blocks (n, ...) stand for."""
    n = len(replicates)
    spread = replicates - replicates.mean(axis=0)
    stds: FloatArray = np.sqrt((n - 1) / n * np.sum(spread**2, axis=0))
    return stds


def _compute_joint_weights(fits: dict[int, _JointAlignment]) -> FloatArray:
    variances = np.array([max(float(fit.stds[0]), 1e-12) ** 2 for fit in fits.values()])
    weights: FloatArray = (1.0 / variances) / np.sum(1.0 / variances)
    return weights


def _average_delay(fits: dict[int, _JointAlignment]) -> float:
    return float(_compute_joint_weights(fits) @ [fit.values[0] for fit in fits.values()])


def _assemble(
    fits: dict[int, _JointAlignment],
    before: float,
    first: dict[int, _JointAlignment],
    present: NDArray[np.bool_],
    sources: tuple[str, ...],
) -> Alignment:
    """Return the product; `before` is the shift that the last fits were made with."""
    joints = list(fits)
    delays, stds, explained, residual = (np.full(len(present), np.nan) for _ in range(4))
    offsets, offset_stds = (np.full((len(sources), len(present)), np.nan) for _ in range(2))
    delay = before + _average_delay(fits)
    for joint, fit in fits.items():
        delays[joint], stds[joint] = before + fit.values[0], fit.stds[0]
        offsets[:, joint], offset_stds[:, joint] = fit.values[1:], fit.stds[1:]
        explained[joint], residual[joint] = first[joint].explained, fit.residual
    replicates = np.stack([fit.replicates for fit in fits.values()], axis=1) @ _compute_joint_weights(fits)
    # Joints that disagree by more than their own deviations say that these are too small (Birge 1932).
    excess = float(np.sum(((delays - delay) / np.maximum(stds, 1e-12))[joints] ** 2))
    return Alignment(
        delay=delay,
        delay_std=float(_compute_jackknife_std(replicates))
        * max(1.0, excess / max(1, len(joints) - 1)) ** 0.5,
        delays=delays,
        delay_stds=stds,
        offsets=offsets,
        offset_stds=offset_stds,
        explained=explained,
        residual=residual,
        present=present,
        sources=sources,
    )


def keep_significant(alignment: Alignment) -> Alignment | None:
    """Return the alignment with what may as well be zero put to zero; None if nothing is left.

    A delay or offset counts from five standard deviations on: moving a channel by what it does not lag would
    spoil a good recording.
    """
    delay = alignment.delay if alignment.late else 0.0
    sure = np.abs(alignment.offsets) > _SIGNIFICANT * alignment.offset_stds
    offsets = np.where(np.isnan(alignment.offsets), np.nan, np.where(sure, alignment.offsets, 0.0))
    if delay == 0.0 and not sure.any():
        return None
    return replace(alignment, delay=delay, offsets=offsets)


def shift_link_channel(recording: Recording, alignment: Alignment, *, run: int) -> Recording:
    """Return the recording with its link channel shifted by `delay`, the offset of run `run` added.

    No sample is cut off; those that the shifted channel does not reach repeat its end. Joints without a link
    encoder stay as they are, and so do zeros that cannot be told.
    """
    pair, delay = get_encoders(recording), alignment.delay
    moved = shift_channel(recording.time, pair.q, delay) + np.nan_to_num(alignment.offsets[run], nan=0.0)
    moved = np.where(alignment.present, moved, pair.q)
    if recording.motor_position is None:
        return replace(recording, link_position=moved)
    velocity = recording.velocity
    if velocity is not None:
        velocity = shift_channel(recording.time, velocity, delay)
    return replace(recording, position=moved, velocity=velocity)


def align(recording: Recording, alignment: Alignment, *, run: int) -> Recording:
    """Return the recording with its link channel on the motor's clock and zero, and a notice that says so.

    The channel is moved as by `shift_link_channel`; samples that it does not reach are cut off.
    """
    delay = alignment.delay
    lost = int(np.ceil(abs(delay) / recording.period - 1e-9))
    kept = slice(0, len(recording.time) - lost) if delay >= 0.0 else slice(lost, None)
    moved = cut_recording(shift_link_channel(recording, alignment, run=run), kept)
    notice = Notice(code="log.aligned", text=_describe_shift(alignment, run, lost), file=recording.source)
    return replace(moved, notices=(*recording.notices, notice))


def _describe_shift(alignment: Alignment, run: int, lost: int) -> str:
    """Return what was done to the link channel; a delay of no significance is not spoken of."""
    parts = []
    if alignment.late:
        side = "later" if alignment.delay > 0.0 else "earlier"
        parts.append(
            f"by {1e3 * abs(alignment.delay):.4g} ms "
            f"(standard deviation {1e3 * alignment.delay_std:.2g} ms), which they "
            f"are {side} than the motor encoders"
        )
    largest = float(np.max(np.abs(np.nan_to_num(alignment.offsets[run], nan=0.0))))
    if largest:
        parts.append(f"by zero offsets of up to {largest:.3g}")
    text = f"the link encoders were moved {', and '.join(parts)}" if parts else "the link encoders stay"
    if not lost:
        return text
    return f"{text}; {lost} samples at the {'end' if alignment.delay > 0.0 else 'beginning'} were cut off"
