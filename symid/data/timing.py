"""The time stamps of a log: rate, jitter, gaps, repeated and returning times, said in plain sentences.

Input: the time column as it was logged. Output: `Timing`; notices, each with what to do.

Supported: any finite times.
Not supported: clocks that drift against the robot's.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.data.signals import describe_uneven
from symid.errors import Notice

__all__ = ["Timing", "describe_timing", "find_timing"]

_JITTER = 0.05
"""Of a period: deviations of steps from here on are worth a remark."""
_GAP = 1.5
_REMEDY = "`symid check ROBOT LOG --resample FILE` writes an evenly sampled copy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """How a log was sampled.

    Args:
        samples: number of samples; `duration` in s, from the first to the last.
        period: median of the steps that go on, in s; 0 if none does.
        jitter: root mean square of the steps' deviations from it, relative, gaps apart.
        largest: the largest such deviation, relative.
        repeated, backward: numbers of samples at the time of the one before, and before it.
        gaps: (start, end) in s of steps longer than 1.5 periods; `missing` samples would fill them.
        first_fault: index of the first sample that repeats or returns, -1 if none does.
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
        """Return whether every step goes on by nearly the same."""
        return not (self.repeated or self.backward or self.gaps) and self.largest <= _JITTER


def find_timing(time: FloatArray) -> Timing:
    """Return how a log with these times (N,) in s was sampled."""
    steps = np.diff(time)
    onward = steps[steps > 0.0]
    period = float(np.median(onward)) if len(onward) else 0.0
    long = np.flatnonzero(steps > _GAP * period) if period else np.zeros(0, dtype=int)
    usual = onward[onward <= _GAP * period] / period - 1.0 if period else np.zeros(0)
    faults = np.flatnonzero(steps <= 0.0)
    return Timing(
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
    """Return what is odd about the times (N,) in s of the log `file`."""
    timing = find_timing(time)
    found = []
    if timing.backward:
        text = (
            f"{timing.backward} samples come before the one in front of them, the first of these faults is "
            f"sample {timing.first_fault} (counted from 0): clocks were set, or files were joined"
        )
        found.append(("log.time-order", f"{text}; {_REMEDY} without them, or cut the log there"))
    if timing.repeated:
        text = f"{timing.repeated} samples have the time of the one before (the first: {timing.first_fault})"
        found.append(("log.repeated-times", f"{text}: a message was logged twice; {_REMEDY} without them"))
    if timing.gaps:
        start, end = timing.gaps[0]
        text = (
            f"{len(timing.gaps)} gaps, {timing.missing} samples of {timing.samples + timing.missing} are "
            f"missing; the first lasts from {start:.6g} s to {end:.6g} s"
        )
        found.append(("log.gap", f"{text}; log at a lower rate or with a higher priority; {_REMEDY}"))
    if timing.largest > _JITTER:
        refused = describe_uneven(time) is not None
        text = (
            f"steps of time differ by up to {100 * timing.largest:.3g} % from {timing.period:.6g} s (root "
            f"mean square {100 * timing.jitter:.3g} %); filters assume even sampling"
        )
        remedy = _REMEDY if refused else "these are accepted as even; " + _REMEDY
        found.append(("log.jitter", f"{text}; {remedy}"))
    return tuple(Notice(code=code, text=text, file=file) for code, text in found)
