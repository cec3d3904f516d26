"""The two positions of each joint in a recording: which is whose, and the link's at another time.

Input: `Recording`. Output: `Encoders`; arrays.

Supported: recordings whose position is that of the motors or of the links; joints without a second encoder.
Not supported: recordings of one position a joint.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.data.recording import Recording
from symid.errors import LogError, Notice

__all__ = ["Encoders", "find_encoders", "shift_channel", "split_blocks"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Encoders:
    """Positions theta of motors and q of links, (N, n) each, and where there is a link encoder, (n,)."""

    theta: FloatArray
    q: FloatArray
    present: NDArray[np.bool_]


def find_encoders(recording: Recording) -> Encoders:
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
