"""Time stamps of a log: rate, jitter, gaps, repeated and returning times; uneven logs resampled.

Times (N,) -> LogTiming, notices. Recording or RawLog -> the same at even times, with its column names and
units.

    repeated and returning samples left out -> cut at long gaps, the longest piece kept -> even grid

Channels are interpolated by monotone cubics (Fritsch and Carlson 1980), which add no overshoot.

Supported: any finite times; gaps of up to ten periods, which are bridged; columns with a value a sample,
others are copied.
Not supported: clocks that drift against the robot's; several pieces at once.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.errors import LogError, Notice
from symid.logs.columns import Findings, extract_time
from symid.logs.files import RawLog
from symid.logs.reader import prepare_columns
from symid.logs.recording import Recording, add_notice, change_channels, spread_bad
from symid.robot import Robot

_REMARKED_JITTER = 0.05
"""Least deviation of a step, relative to the period, that is reported."""
_GAP = 1.5
_REMEDY = "`symid check ROBOT LOG --resample FILE` writes an evenly sampled copy"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogTiming:
    """How a log was sampled.

    Args:
        samples: number of samples; duration: s, from the first to the last.
        period: median of the positive steps in s; 0 if there are none.
        jitter, largest: RMS and largest of the steps' deviations from it, relative, without gaps.
        repeated, backward: numbers of samples at the time of the one before, and before it.
        gaps: (start, end) in s of steps longer than 1.5 periods; missing: samples that would fill them.
        first_fault: index of the first sample that repeats or returns, -1 for none.
    """

    samples: int
    duration: float
    period: float
    jitter: float
    largest: float
    repeated: int
    backward: int
    gaps: tuple[tuple[float, float], ...]
    missing: int
    first_fault: int = -1

    @property
    def even(self) -> bool:
        """Return whether all steps are nearly equal."""
        return not (self.repeated or self.backward or self.gaps) and self.largest <= _REMARKED_JITTER


def measure_timing(time: FloatArray) -> LogTiming:
    """Return the timing of times (N,) in s."""
    steps = np.diff(time)
    onward = steps[steps > 0.0]
    period = float(np.median(onward)) if len(onward) else 0.0
    long = np.flatnonzero(steps > _GAP * period) if period else np.zeros(0, dtype=int)
    usual = onward[onward <= _GAP * period] / period - 1.0 if period else np.zeros(0)
    faults = np.flatnonzero(steps <= 0.0)
    return LogTiming(
        samples=len(time),
        duration=float(np.ptp(time)) if len(time) else 0.0,
        period=period,
        jitter=float(np.sqrt(np.mean(usual**2))) if len(usual) else 0.0,
        largest=float(np.max(np.abs(usual))) if len(usual) else 0.0,
        repeated=int(np.sum(steps == 0.0)),
        backward=int(np.sum(steps < 0.0)),
        gaps=tuple((float(time[at]), float(time[at + 1])) for at in long),
        missing=int(np.sum(np.round(steps[long] / period) - 1.0)) if period else 0,
        first_fault=int(faults[0]) + 1 if len(faults) else -1,
    )


def describe_timing(time: FloatArray, file: str = "") -> tuple[Notice, ...]:
    """Return notices on repeated, returning, missing and uneven times (N,) in s."""
    timing = measure_timing(time)
    found = []
    if timing.backward:
        text = f"{timing.backward} samples have an earlier time than the one before, the first faulty one is "
        text += f"sample {timing.first_fault} (counted from 0): a clock was set, or files were joined"
        found.append(("log.time-order", f"{text}; {_REMEDY} without them, or cut the log there"))
    if timing.repeated:
        text = f"{timing.repeated} samples have the time of the one before (the first: {timing.first_fault})"
        found.append(("log.repeated-times", f"{text}: a message was logged twice; {_REMEDY} without them"))
    if timing.gaps:
        start, end = timing.gaps[0]
        text = f"{len(timing.gaps)} gaps, {timing.missing} samples of {timing.samples + timing.missing} are "
        text += f"missing; the first gap is from {start:.6g} s to {end:.6g} s"
        found.append(("log.gap", f"{text}; log at a lower rate or with a higher priority; {_REMEDY}"))
    if timing.largest > _REMARKED_JITTER:
        text = f"time steps differ by up to {100 * timing.largest:.3g} % from {timing.period:.6g} s (RMS "
        text += f"{100 * timing.jitter:.3g} %); filters assume even sampling"
        found.append(("log.jitter", f"{text}; {_REMEDY}"))
    return tuple(Notice(code=code, text=text, file=file) for code, text in found)


_BRIDGED = 10.0
_FEWEST = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resampling:
    """The samples that are used, and the even times.

    Args:
        kept: (K,) indices of samples; before: (K,) their times in s; after: (M,) the even times in s.
        notice: says in words what was done.
    """

    kept: NDArray[np.intp]
    before: FloatArray
    after: FloatArray
    notice: Notice

    def move(self, values: FloatArray) -> FloatArray:
        """Return `values` (N, ...) of the log's samples at the even times; beside holes they are holes."""
        if self.after is self.before:
            return values[self.kept]
        return _interpolate(self.before, values[self.kept], self.after)


def _interpolate(before: FloatArray, values: FloatArray, after: FloatArray) -> FloatArray:
    """Return `values` (K, ...) at times `before` (K,) at times `after` (M,); holes stay holes."""
    holes = ~np.isfinite(values)
    spline = scipy.interpolate.PchipInterpolator(before, np.where(holes, 0.0, values), axis=0)
    moved: FloatArray = spline(after)
    if holes.any():
        # A cubic uses two samples on either side.
        wide = spread_bad(holes.reshape(len(before), -1), 2)
        places = np.clip(np.searchsorted(before, after), 0, len(before) - 1)
        moved[wide.reshape(holes.shape)[places]] = np.nan
    return np.ascontiguousarray(moved)


def mask_onward(time: FloatArray) -> NDArray[np.bool_]:
    """Return which times (N,) are later than all before them."""
    return np.append(True, time[1:] > np.maximum.accumulate(time)[:-1])[: len(time)]


def plan_resampling(
    time: FloatArray, file: str = "", used: NDArray[np.intp] | None = None, line: FloatArray | None = None
) -> Resampling:
    """Return how to make times (N,) in s even, or raise a LogError if fewer than four are left.

    `used` (K,) are the samples that count, those with increasing times if None; `line` (K,) their times in s,
    where these are not those of the log.
    """
    onward = np.flatnonzero(mask_onward(time)) if used is None else used
    line = time[onward] if line is None else line
    steps = np.diff(line)
    if len(onward) < _FEWEST:
        text = f"only {len(onward)} of {len(time)} samples have increasing times; check the time column"
        raise LogError(Notice(code="log.time-order", text=text, file=file))
    period = float(np.median(steps))
    pieces = np.split(np.arange(len(onward)), np.flatnonzero(steps > _BRIDGED * period) + 1)
    piece = max(pieces, key=len)
    kept, before = onward[piece], line[piece]
    if len(kept) < _FEWEST:
        text = f"the longest piece without a gap has {len(kept)} samples, at least {_FEWEST} are needed"
        raise LogError(Notice(code="log.gap", text=text, file=file))
    count = max(2, round(float(before[-1] - before[0]) / period)) + 1
    after = np.linspace(before[0], before[-1], count)
    if count == len(before) and np.allclose(after, before, rtol=0.0, atol=1e-6 * period):
        # Rows that are even already stay as they are.
        after = before
    timing = measure_timing(time)
    parts = [
        f"{len(time)} samples became {count} at every {float(after[1] - after[0]):.6g} s",
        f"steps deviated by {100.0 * timing.jitter:.3g} % RMS, but for gaps; longest: {np.max(steps):.6g} s",
    ]
    if lost := int(np.sum(~mask_onward(time))):
        parts.append(f"{lost} with times that repeat or return were left out")
    bridged = int(np.sum(np.diff(before) > _GAP * period))
    if bridged:
        parts.append(f"{bridged} gaps of up to {_BRIDGED:g} periods were interpolated over")
    if cut := len(onward) - len(kept):
        span = f"{before[0]:.6g} s to {before[-1]:.6g} s"
        parts.append(f"{cut} beyond longer gaps were left out: {span} is the longest piece")
    notice = Notice(code="log.resampled", text="; ".join(parts), file=file)
    return Resampling(kept=kept, before=before, after=after, notice=notice)


def resample_recording(recording: Recording, plan: Resampling) -> Recording:
    """Return the recording at even times, with a warning where samples were left out."""
    moved = replace(change_channels(recording, plan.move), time=plan.after, extras={})
    lost = float(np.ptp(recording.time) - np.ptp(plan.after))
    if lost <= _BRIDGED * recording.period:
        return moved
    text = f"{lost:.3g} s of the log are beyond a long gap and were left out: cut the log at its gaps into "
    text += "files, which can be fitted together"
    return add_notice(moved, "log.gap", text)


def resample_log(
    raw: RawLog, robot: Robot, file: str = "", plan: Resampling | None = None
) -> tuple[RawLog, Notice]:
    """Return the columns of a log at even times, and a notice; a LogError if the time cannot be read.

    `plan` says how, where that was chosen from all columns.
    """
    findings = Findings(file=file)
    raw, robot = prepare_columns(raw, robot, findings)
    time, names = extract_time(raw, robot, findings)
    if time is None or not np.all(np.isfinite(time)):
        findings.refuse("log.not-finite", "the time column has values that are not finite")
        raise LogError(*findings.mistakes)
    plan = plan or plan_resampling(time, file)
    factor = float(np.ptp(raw.columns[names[0]]) / np.ptp(time))
    own = {name: part for name, part in raw.columns.items() if len(np.atleast_1d(part)) == len(time)}
    moved = {name: plan.move(part) for name, part in own.items()}
    return replace(raw, columns={**raw.columns, **moved, names[0]: plan.after * factor}), plan.notice
