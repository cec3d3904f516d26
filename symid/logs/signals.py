"""Signal processing: from a recording to q, dq, ddq and tau; the same zero-phase filter for every column.

Recording, Processing -> Signals at full rate; matrices of fewer rows, whole or in blocks.

    position low-passed -> velocity, acceleration by central differences -> ends cut -> Signals -> decimation

Low-pass: Butterworth, forward and backward. Decimation: Chebyshev I, forward and backward. Both run as
second-order sections, so that high orders at low cut-offs keep their gain; ends are continued by odd
reflection over 3 (order) samples.

Supported: uniform sampling. A step above 1.5 median periods is a gap; steps that scatter by more than
20 % (root mean square) are jitter; both are refused. Velocities and accelerations come from the filtered
position, so that both pass exactly the filter that the position passed.
Not supported: uneven sampling, online filtering, a logged velocity in place of the differentiated
position.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.errors import LogError, Notice
from symid.logs.recording import Recording, Signals
from symid.robot import Decimation, Processing

_FREQUENCIES = 8192


def compute_pad_length(order: int) -> int:
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
    r - (r ceil(N / r) - N), as in MATLAB's `decimate`. A model that is linear in its parameters stays
    true when its columns and the measurement pass the same filter ("parallel decimation", Gautier 1997).

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


def compute_noise_bandwidth(processing: Processing, period: float) -> float:
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
    pad = compute_pad_length(order)
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


_BLOCK = 16384
"""Samples of a block, besides those that its ends need; more where the filter is long."""
_MEMORY_FLOOR = 1e-17
"""What is left of a filter's answer to where it began, when it has settled."""
_ROW_RATE = 100.0
"""Rows a second, in Hz, where the settings leave it open: ten times what robots move at, and more."""
_GAP = 1.5
"""Steps of time above this many median periods are gaps; 1 sample lost makes a step of 2."""
_JITTER = 0.2
"""Root mean square of the steps' deviations above this part of the median period is jitter."""


def prepare_signals(recording: Recording, processing: Processing) -> Signals:
    """Return states and torques of `recording`, filtered, differentiated and cut.

    Raises:
        LogError: too few samples for these settings, uneven sampling, or a cut-off that the sample
            rate does not carry.
    """
    least = compute_least_samples(processing)
    if len(recording.time) < least:
        raise LogError(describe_too_short(len(recording.time), processing, file=recording.source))
    uneven = describe_uneven(recording.time, file=recording.source)
    if uneven is not None:
        raise LogError(uneven)
    period = recording.period
    try:
        q = _low_pass_if_asked(recording.position, period, processing)
        tau = (
            _low_pass_if_asked(recording.torque, period, processing)
            if processing.filter_torque
            else recording.torque
        )
    except LogError as error:
        raise LogError(*(replace(notice, file=recording.source) for notice in error.notices)) from error
    dq = differentiate(q, period)
    ddq = differentiate(dq, period)
    kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
    return Signals(
        time=recording.time[kept], q=q[kept], dq=dq[kept], ddq=ddq[kept], tau=tau[kept], period=period
    )


def choose_processing(processing: Processing, period: float) -> Processing:
    """Return the settings with cut-off and decimation chosen, where they are left to the sample rate.

    Rows come at 100 Hz or a little less; the position's cut-off lies five times above what decimation
    keeps, or at 0.4 of the sample rate: high enough that it damps nothing that the torque keeps.

    Args:
        processing: as stated; returned as it is unless `automatic`.
        period: sample period in s.
    """
    if not processing.automatic:
        return processing
    rate = 1.0 / period
    decimation = processing.decimation
    if decimation.factor == 1:
        # A hair below a whole number of times is that number: periods carry rounding.
        decimation = replace(decimation, factor=max(1, math.ceil(rate / _ROW_RATE - 1e-6)))
    kept = 0.5 * decimation.band * rate / decimation.factor
    cutoff = processing.filter_cutoff or float(f"{min(5.0 * kept, 0.4 * rate):.3g}")
    return replace(processing, filter_cutoff=cutoff, decimation=decimation, automatic=False)


def decimate_blocks(
    evaluate: Callable[[slice], FloatArray], samples: int, decimation: Decimation
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield, block by block, the rows that `decimate` keeps of all samples, and which they are.

    A block is filtered with so many samples before and after it that the filter has forgotten where it began
    and ended; at the ends of the log nothing differs. So the rows are the same up to rounding, and samples
    never stand in memory but for one block.

    Args:
        evaluate: gives the values (k, ...) of a slice of samples.
        samples: how many there are.
        decimation: of the rows.

    Raises:
        LogError: too few rows for the filter.
    """
    factor = decimation.factor
    if factor == 1:
        for start in range(0, samples, _BLOCK):
            part = slice(start, min(samples, start + _BLOCK))
            yield part, evaluate(part)
        return
    reach = _compute_filter_memory(decimation)
    # Rows are counted from the last one, which is the last sample, as `decimate` counts them.
    kept = -(-samples // factor)
    first = samples - 1 - factor * (kept - 1)
    step = max(1, max(_BLOCK, 2 * reach * factor) // factor)
    for start in range(0, kept, step):
        stop = min(kept, start + step)
        last = min(kept, stop + reach)
        # A stretch that begins within the reach of the log's beginning begins there.
        begin = max(0, first + factor * (start - reach))
        values = evaluate(slice(begin, first + factor * (last - 1) + 1))
        # Filters copy what they filter several times over: one joint at a time is enough.
        parts = [values] if values.ndim < 3 else [values[:, index] for index in range(values.shape[1])]
        rows = [decimate(part, decimation) for part in parts]
        away = last - len(rows[0])
        kept_rows = [part[start - away : stop - away] for part in rows]
        yield slice(start, stop), kept_rows[0] if values.ndim < 3 else np.stack(kept_rows, axis=1)


def _compute_filter_memory(decimation: Decimation) -> int:
    """Return how many rows the filter takes to forget where it began."""
    from scipy.signal import cheby1

    _, poles, _ = cheby1(
        decimation.order, decimation.ripple_db, decimation.band / decimation.factor, output="zpk"
    )
    slowest = float(np.abs(poles).max())
    return math.ceil(math.log(_MEMORY_FLOOR) / math.log(slowest) / decimation.factor) + decimation.order


def compute_least_samples(processing: Processing) -> int:
    """Return how many samples a log needs for these settings, at least."""
    whole = compute_pad_length(processing.filter_order) + 1 if processing.filter_cutoff is not None else 3
    decimation = processing.decimation
    left = compute_pad_length(decimation.order) + 1 if decimation.factor > 1 else 3
    return max(whole, left + processing.drop_first + processing.drop_last)


def describe_too_short(samples: int, processing: Processing, file: str = "") -> Notice:
    """Return the notice on a log with fewer samples than `compute_least_samples`."""
    return Notice(
        code="log.too-short",
        file=file,
        text=f"the log has {samples} samples; filter, cut ends ({processing.drop_first} first, "
        f"{processing.drop_last} last) and decimation need {compute_least_samples(processing)} at least",
    )


def describe_uneven(time: FloatArray, file: str = "") -> Notice | None:
    """Return what is wrong with the sampling of `time` (N,) in s, None where filters may take it as even."""
    steps = np.diff(time)
    period = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * period)
    if len(gaps):
        first = int(gaps[0])
        text = (
            f"samples are missing, or time comes in bursts: {len(gaps)} steps are longer than {_GAP:g} "
            f"periods of {period:.6g} s, the first after sample {first} (counted from 0), "
            f"from {time[first]:.6g} s to {time[first + 1]:.6g} s; "
            "cut the log there and give the pieces as separate files, or resample it evenly"
        )
        return Notice(code="log.gap", text=text, file=file)
    scatter = float(np.sqrt(np.mean((steps / period - 1.0) ** 2)))
    if scatter > _JITTER:
        away = np.flatnonzero(np.abs(steps - period) > _JITTER * period)
        first = int(away[0])
        text = (
            f"time is not sampled evenly: its steps scatter by {100 * scatter:.3g} % (root mean square) "
            f"about {period:.6g} s, {100 * _JITTER:g} % at most are accepted; {len(away)} steps are further "
            f"off, the first after sample {first} (counted from 0), at {time[first]:.6g} s; "
            "resample the log evenly"
        )
        return Notice(code="log.jitter", text=text, file=file)
    return None


def _low_pass_if_asked(values: FloatArray, period: float, processing: Processing) -> FloatArray:
    if processing.filter_cutoff is None:
        return values
    return low_pass(values, period=period, cutoff=processing.filter_cutoff, order=processing.filter_order)
