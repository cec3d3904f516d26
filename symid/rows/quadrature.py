"""Integrals over windows of a sampled signal.

Input: samples on a uniform grid. Output: one integral a window.

Supported: consecutive windows of an even number of intervals that share their ends.
Not supported: samples at uneven times; windows that overlap.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError

__all__ = ["Windows", "find_windows", "integrate_windows"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Consecutive windows: `count` of them, `intervals` sample periods each, `period` in s."""

    count: int
    intervals: int
    period: float

    @property
    def ends(self) -> slice:
        """Return the samples at which windows begin and end, `count + 1` of them."""
        return slice(0, self.count * self.intervals + 1, self.intervals)


def find_windows(samples: int, period: float, length: float, pieces: int = 1) -> Windows:
    """Return the windows of about `length / pieces` s that fit into so many samples, `period` s apart.

    The number of intervals is the even one next to `length / pieces / period`, for Simpson's rule.

    Raises:
        UsageError: a window is shorter than two sample periods or longer than the log.
    """
    step = length / pieces
    intervals = 2 * round(step / (2.0 * period)) if step > 0.0 else 0
    count = (samples - 1) // intervals if intervals else 0
    if count < 1:
        begun = f", each begun {step:g} s after the last, as the overlap asks, and this" if pieces > 1 else ""
        text = (
            f"window of {length:g} s{begun or ':'} must be at least two sample periods ({2 * period:g} s) "
            f"and at most the log without its cut ends ({(samples - 1) * period:g} s)"
            f"{'; ask for longer windows, or for less overlap' if pieces > 1 else ''}"
        )
        raise UsageError(Notice(code="usage.window", text=text))
    return Windows(count=count, intervals=intervals, period=period)


def integrate_windows(values: FloatArray, windows: Windows) -> FloatArray:
    """Return the integral of `values` (N, ...) over every window: (count, ...).

    Composite Simpson's rule, h/3 (y0 + 4 y1 + 2 y2 + ... + 4 y[w-1] + yw), of fourth order.
    Both sides of a row pass through the same rule, so what jumps between samples, as dry
    friction does, costs no accuracy: its error is the same on both sides.
    """
    w, count = windows.intervals, windows.count
    weights = np.full(w, 2.0)
    weights[1::2] = 4.0
    weights[0] = 1.0
    inner = values[: count * w].reshape(count, w, *values.shape[1:])
    last = values[windows.ends][1:]
    total: FloatArray = np.tensordot(inner, weights, axes=(1, 0)) + last
    return total * (windows.period / 3.0)
