"""The step of an encoder, as its log shows it.

Input: positions of one joint. Output: the step, 0 where the log shows none.

Supported: positions that are whole multiples of a step but for rounding, with or without a zero offset.
Not supported: interpolated positions, whose step cannot be seen.
"""

import numpy as np

from symid.arrays import FloatArray

__all__ = ["find_step"]

_SAMPLES = 200_000
_TOLERANCE = 0.02
"""Of a step: how far from a whole number of steps a difference may be."""
_SMALLEST = 1e-7
"""Of the range: a step below is the rounding of the file."""
_LARGEST = 200.0
"""Steps a difference may count: beyond, rounding of the log hides whether it is a whole number."""


def find_step(position: FloatArray) -> float:
    """Return the step (rad or m) of which all differences between samples are multiples; 0 if there is none.

    Args:
        position: (N,) rad or m.
    """
    differences = np.abs(np.diff(position[:_SAMPLES]))
    floor = 64.0 * np.finfo(float).eps * float(np.max(np.abs(position), initial=0.0))
    differences = differences[differences > floor]
    if len(differences) < 3:
        return 0.0
    step = float(np.min(differences))
    near = differences[differences < _LARGEST * step]
    # The smallest difference carries rounding of the log: an average over many steps carries less.
    counts = np.round(near / step)
    step = float(near @ counts / (counts @ counts))
    counts = differences / step
    off = np.abs(counts - np.round(counts)) * np.minimum(1.0, _LARGEST / np.maximum(counts, 1.0))
    visible = step > _SMALLEST * float(np.ptp(position))
    return step if visible and float(np.quantile(off, 0.99)) < _TOLERANCE else 0.0
