"""Uneven logs made even: what is kept, and the values between samples.

Input: times of a log, its columns. Output: `Resampling`; a `Recording`; a `RawLog` with the columns, names
and units of the old one, so that the same robot file reads it.

    repeated and returning samples left out -> cut at long gaps, the longest piece kept -> even grid

Between samples every channel is interpolated by the same monotone cubics (Fritsch and Carlson 1980), which
add no overshoot.

Supported: gaps of up to ten periods, which are bridged; columns with a value a sample, others are copied.
Not supported: several pieces at once: cut the log into files.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.data.findings import Findings
from symid.data.presets import apply_preset
from symid.data.quantities import find_time
from symid.data.recording import OPTIONAL_CHANNELS, Recording
from symid.data.signals import describe_uneven
from symid.data.table import RawLog
from symid.errors import LogError, Notice
from symid.robot.description import Robot

__all__ = [
    "Resampling",
    "describe_resampling",
    "find_resampling",
    "make_even",
    "resample_log",
    "resample_recording",
]

_BRIDGED = 10.0
_FEWEST = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resampling:
    """Which samples are used, and the even times that take their place.

    Args:
        kept: (K,) indices of samples; before: (K,) their times in s; after: (M,) the even times in s.
        samples: number of samples of the log; dropped: those with times that repeat or return.
        bridged: gaps that were interpolated over; cut: samples of other pieces, left out.
    """

    kept: NDArray[np.intp]
    before: FloatArray
    after: FloatArray
    samples: int
    dropped: int
    bridged: int
    cut: int

    def move(self, values: FloatArray) -> FloatArray:
        """Return `values` (N, ...) of the log's samples at the even times."""
        from scipy.interpolate import PchipInterpolator

        moved: FloatArray = PchipInterpolator(self.before, values[self.kept], axis=0)(self.after)
        return np.ascontiguousarray(moved)


def find_resampling(time: FloatArray, file: str = "") -> Resampling:
    """Return how to make a log with these times (N,) in s even.

    Raises:
        LogError: fewer than four samples are left.
    """
    onward = np.flatnonzero(np.append(True, time[1:] > np.maximum.accumulate(time)[:-1])[: len(time)])
    steps = np.diff(time[onward])
    if len(onward) < _FEWEST:
        text = f"only {len(onward)} of {len(time)} samples have a time of their own: nothing can be resampled"
        raise LogError(Notice(code="log.time-order", text=f"{text}; check the time column", file=file))
    period = float(np.median(steps))
    pieces = np.split(onward, np.flatnonzero(steps > _BRIDGED * period) + 1)
    kept = max(pieces, key=len)
    if len(kept) < _FEWEST:
        text = f"the longest piece without a gap has {len(kept)} samples, {_FEWEST} are needed at least"
        raise LogError(Notice(code="log.gap", text=text, file=file))
    before = time[kept]
    count = max(2, round(float(before[-1] - before[0]) / period))
    inner = np.diff(before)
    return Resampling(
        kept=kept,
        before=before,
        after=np.linspace(before[0], before[-1], count + 1),
        samples=len(time),
        dropped=len(time) - len(onward),
        bridged=int(np.sum(inner > 1.5 * period)),
        cut=len(onward) - len(kept),
    )


def describe_resampling(plan: Resampling, file: str = "") -> Notice:
    """Return in words what resampling did."""
    count = len(plan.after)
    step = float(plan.after[1] - plan.after[0])
    parts = [f"{plan.samples} samples became {count} at every {step:.6g} s"]
    if plan.dropped:
        parts.append(f"{plan.dropped} with times that repeat or return were left out")
    if plan.bridged:
        parts.append(f"{plan.bridged} gaps of up to {_BRIDGED:g} periods were interpolated over")
    if plan.cut:
        span = f"{plan.before[0]:.6g} s to {plan.before[-1]:.6g} s"
        parts.append(f"{plan.cut} on the far side of longer gaps were left out: {span} is the longest piece")
    return Notice(code="log.resampled", text="; ".join(parts), file=file)


def resample_recording(recording: Recording, plan: Resampling) -> Recording:
    """Return the recording at even times, with a notice that says what was done."""

    def move(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else plan.move(values)

    channels: dict[str, Any] = {name: move(getattr(recording, name)) for name in OPTIONAL_CHANNELS}
    return replace(
        recording,
        time=plan.after,
        position=plan.move(recording.position),
        torque=plan.move(recording.torque),
        **channels,
        notices=(*recording.notices, describe_resampling(plan, recording.source)),
        extras={},
    )


def resample_log(raw: RawLog, robot: Robot, file: str = "") -> tuple[RawLog, Notice]:
    """Return the columns of a log at even times, and what was done.

    Args:
        raw: the columns as logged.
        robot: its `[log]` map says which column is the time, and its unit.
        file: where the log was read.

    Raises:
        LogError: there is no usable time column.
    """
    findings = Findings(file=file)
    time, names = find_time(raw, apply_preset(raw, robot, findings), findings)
    if time is None or not np.all(np.isfinite(time)):
        findings.refuse("log.not-finite", "the time column holds values that are no numbers")
        raise LogError(*findings.mistakes)
    plan = find_resampling(time, file)
    stamps = raw.columns[names[0]]
    factor = float(np.ptp(stamps) / np.ptp(time))
    columns = {
        name: plan.move(values) if len(np.atleast_1d(values)) == plan.samples else values
        for name, values in raw.columns.items()
    }
    return replace(raw, columns={**columns, names[0]: plan.after * factor}), describe_resampling(plan, file)


def make_even(recording: Recording) -> Recording:
    """Return the recording as it is where filters may take it as even, else resampled, with a notice.

    Raises:
        LogError: too few samples are left.
    """
    steps = np.diff(recording.time)
    if len(steps) and np.all(steps > 0.0) and describe_uneven(recording.time) is None:
        return recording
    return resample_recording(recording, find_resampling(recording.time, recording.source))
