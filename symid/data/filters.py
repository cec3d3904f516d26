"""Filters without phase, central differences, decimation: the same for every column.

Input: arrays with time along the first axis. Output: arrays of the same form.

Supported: uniform sampling; Butterworth low-pass forward and backward, Chebyshev I decimation
forward and backward. Ends are continued by odd reflection over 3 (order) samples. Filters run
as second-order sections: high orders at low cut-offs keep their gain.
Not supported: uneven sampling, online filtering.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.errors import LogError, Notice
from symid.robot.log_map import Decimation, Processing

__all__ = ["decimate", "differentiate", "find_noise_band", "find_pad_length", "low_pass"]

_FREQUENCIES = 8192


def find_pad_length(order: int) -> int:
    """Return the number of samples by which each end is continued; a signal must be longer."""
    return 3 * order


def low_pass(values: FloatArray, *, period: float, cutoff: float, order: int) -> FloatArray:
    """Return `values` (N, ...) through a Butterworth filter, forward and backward.

    The order is that of one pass; the gain at `cutoff` is 1/2 after both.

    Args:
        values: (N, ...), any unit.
        period: sample period in s.
        cutoff: of one pass, in Hz.
        order: of one pass.

    Raises:
        LogError: the cut-off is not below half the sample rate, or there are too few samples.
    """
    nyquist = 0.5 / period
    if not 0.0 < cutoff < nyquist:
        raise LogError(
            Notice(
                code="log.filter-cutoff",
                text=f"a filter cut-off of {cutoff:g} Hz does not fit a log sampled every {period:g} s: "
                f"it must lie between 0 and {nyquist:g} Hz",
            )
        )
    from scipy.signal import butter

    sections = butter(order, cutoff / nyquist, output="sos")
    return _filter_both_ways(sections, values, order)


def differentiate(values: FloatArray, period: float) -> FloatArray:
    """Return the time derivative of `values` (N, ...): central differences, one-sided at the ends.

    dx[k] = (x[k+1] - x[k-1]) / (2 T); `period` T in s.
    """
    slope: FloatArray = np.gradient(values, period, axis=0)
    return slope


def decimate(values: FloatArray, decimation: Decimation) -> FloatArray:
    """Return every `factor`-th sample of `values` (N, ...) after a zero-phase Chebyshev I low-pass.

    Kept are ceil(N / r) samples that end with the last one: counted from one, the first is
    r - (r ceil(N / r) - N), as in MATLAB's `decimate`.

    Raises:
        LogError: there are too few samples for the filter.
    """
    factor = decimation.factor
    if factor == 1:
        return values.copy()
    from scipy.signal import cheby1

    edge = decimation.band / factor
    sections = cheby1(decimation.order, decimation.ripple_db, edge, output="sos")
    smooth = _filter_both_ways(sections, values, decimation.order)
    kept = -(-len(values) // factor)
    first = factor - (factor * kept - len(values)) - 1
    return np.ascontiguousarray(smooth[first::factor])


def find_noise_band(processing: Processing, period: float) -> float:
    """Return the part of the band, after decimation, that white noise of the torque still fills.

    m decimated samples of such noise hold as much information on slow parameters as m b independent
    ones: b is the mean of |H|^4 over the new band relative to |H(0)|^4 (both passes of each filter).

    Args:
        processing: decimation, and the low-pass if the torque passes it.
        period: sample period in s, before decimation.
    """
    decimation = processing.decimation
    from scipy.signal import butter, cheby1, sosfreqz

    # The pass band after decimation always holds many frequencies.
    count = _FREQUENCIES * max(1, decimation.factor // 10)
    gain = np.ones(count)
    if decimation.factor > 1:
        edge = decimation.band / decimation.factor
        sections = cheby1(decimation.order, decimation.ripple_db, edge, output="sos")
        gain *= np.abs(sosfreqz(sections, worN=count)[1]) ** 4
    if processing.filter_torque and processing.filter_cutoff is not None:
        sections = butter(processing.filter_order, processing.filter_cutoff * 2.0 * period, output="sos")
        gain *= np.abs(sosfreqz(sections, worN=count)[1]) ** 4
    return min(1.0, decimation.factor * float(np.mean(gain) / gain[0]))


def _filter_both_ways(sections: FloatArray, values: FloatArray, order: int) -> FloatArray:
    pad = find_pad_length(order)
    if len(values) <= pad:
        raise LogError(
            Notice(
                code="log.too-short",
                text=f"{len(values)} samples are left to filter; order {order} needs more than {pad}",
            )
        )
    from scipy.signal import sosfiltfilt

    result: FloatArray = sosfiltfilt(sections, values, axis=0, padtype="odd", padlen=pad)
    return np.ascontiguousarray(result)
