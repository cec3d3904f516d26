"""The noise of the torque, from what differs between the periods of a periodic motion.

Input: recordings of a motion that repeats, its period. Output: the covariance of the noise between joints.

    S = 1 / ((P - 1) N) sum over p, t of e_p(t) e_p(t)',   e_p = tau_p - mean over p of tau_p

over P periods of N samples. What repeats is the motion's and the model's; what does not is noise (Schoukens
and Pintelon 2012). So this noise knows nothing of what the model misses, as the residual of a fit does.

Supported: any number of whole periods from two on; periods that are no whole number of samples.
Not supported: motions that drift, warm up or start: cut these off (drop_first).
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.robot.log_map import Processing

__all__ = ["find_period_noise"]

_LOUD = 0.5
"""Part of the torque's own deviation from which on noise means that the period is wrong."""


def find_period_noise(
    recordings: Sequence[Recording], processing: Processing, periods: Sequence[float]
) -> FloatArray:
    """Return the covariance (n, n) of the torque's noise, N m or N each.

    Args:
        recordings: at least one.
        processing: its cut ends are left out.
        periods: in s, one for all recordings or one for each.

    Raises:
        UsageError: a log holds less than two periods, the number of periods does not fit that of the logs, or
            the torque does not repeat.
    """
    if len(periods) not in {1, len(recordings)}:
        text = f"{len(periods)} periods for {len(recordings)} logs: give one for all, or one for each"
        raise UsageError(Notice(code="usage.period", text=text))
    each = list(periods) * len(recordings) if len(periods) == 1 else list(periods)
    size = recordings[0].torque.shape[1]
    total, freedom = np.zeros((size, size)), 0
    for recording, period in zip(recordings, each, strict=True):
        repeated = _fold(recording, processing, period)
        errors = (repeated - repeated.mean(axis=0)).reshape(-1, size)
        total += errors.T @ errors
        freedom += (repeated.shape[0] - 1) * repeated.shape[1]
    covariance: FloatArray = total / freedom
    _check_noise(recordings, covariance)
    return covariance


def _fold(recording: Recording, processing: Processing, period: float) -> FloatArray:
    """Return the torque of every whole period (P, N, n), on one grid of times."""
    kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
    time, torque = recording.time[kept], recording.torque[kept]
    span = float(time[-1] - time[0]) + recording.period if len(time) > 1 else 0.0
    count = int(span / period + 1e-6)
    samples = round(period / recording.period)
    if count < 2 or samples < 2:
        text = (
            f"a period of {period:g} s occurs {count} times in the {span:g} s of this log that are kept; "
            "noise shows from two periods on"
        )
        raise UsageError(Notice(code="usage.period", text=text, file=recording.source))
    grid = time[0] + period * (np.arange(count)[:, None] + np.arange(samples) / samples)
    columns = [np.interp(grid, time, column) for column in torque.T]
    return np.stack(columns, axis=2)


def _check_noise(recordings: Sequence[Recording], covariance: FloatArray) -> None:
    torque = np.vstack([recording.torque for recording in recordings])
    share = np.sqrt(np.diag(covariance)) / np.maximum(torque.std(axis=0), np.finfo(float).tiny)
    if np.any(share > _LOUD):
        worst = int(np.argmax(share))
        percent = 100.0 * float(share[worst])
        text = (
            f"the torque of joint {worst + 1} differs between periods by {percent:.3g} % of its deviation; "
            "it does not repeat with this period; check the period, or cut off the start"
        )
        raise UsageError(Notice(code="usage.period", text=text, file=recordings[0].source))
