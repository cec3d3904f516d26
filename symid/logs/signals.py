"""Signal processing: from a recording to q, dq, ddq and tau; the same zero-phase filter for every column.

Recording, Processing -> Signals at full rate; matrices of fewer rows, whole or in blocks.

    position low-passed -> velocity, acceleration by central differences -> ends cut -> Signals -> decimation

Low-pass: Butterworth; decimation: Chebyshev I; both forward and backward, as second-order sections, with ends
continued by odd reflection over 3 (order) samples.

Logged velocities and accelerations take the place of differences where `Processing.states` says so, through
the same low-pass.

Supported: uniform sampling, see `describe_uneven`. Not supported: online filtering.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, freeze, measure_top
from symid.errors import LogError, Notice
from symid.logs.recording import Recording, Signals, change_channels
from symid.robot import Decimation, Processing

LongArray = NDArray[np.longdouble]

_FREQUENCIES = 8192
_LEAST_BLOCK, _WHOLE_BLOCK = 128, 64
"""Samples of a block, of a decimation and of other filters: shorter ones have more states, longer ones larger
matrices."""
_RESTING = 1e-8
"""Of its fastest speed, below which a joint rests: what rounding leaves of a still encoder, of which dry
friction would take the sign. Encoders of 20 bits have a hundred times as much."""
_NUMBERS = 2**21
"""Of a piece that is decimated at a time."""
_VANISHED = 1e-19
"""Relative rest of a response that cannot be seen in a double."""
_LONGEST = 65_536
"""Samples of the response of a filter up to which its blocks are built."""
_DEPENDENT = 1e-15
"""Relative length of a column below which it depends on those before it."""


def compute_pad_length(order: int) -> int:
    """Return the number of samples by which each end is continued; signals must be longer."""
    return 3 * order


@dataclass(frozen=True, slots=True, kw_only=True)
class _LowPass:
    """A low-pass of `order` up to `edge`, in parts of half the sample rate; every `factor`-th sample is kept.

    Chebyshev I with `ripple_db` in the pass band, or Butterworth where that is None.
    """

    order: int
    edge: float
    ripple_db: float | None = None
    factor: int = 1


def low_pass(values: FloatArray, *, period: float, cutoff: float, order: int) -> FloatArray:
    """Return `values` (N, ...) through a Butterworth filter, forward and backward.

    `period` in s; `cutoff` in Hz and `order` are those of one pass, with gain 1/2 at `cutoff` after both. A
    LogError refuses a cut-off that is not below half the sample rate, and too few samples.
    """
    nyquist = 0.5 / period
    if not 0.0 < cutoff < nyquist:
        text = f"the filter cut-off must be below {nyquist:g} Hz, half the sample rate, got {cutoff:g} Hz"
        raise LogError(Notice(code="log.filter-cutoff", text=text))
    return _filter_both_ways(_LowPass(order=order, edge=cutoff / nyquist), values)


def differentiate(values: FloatArray, period: float) -> FloatArray:
    """Return the time derivative of `values` (N, ...): central differences, one-sided at the ends.

    dx[k] = (x[k+1] - x[k-1]) / (2 T); `period` T in s.
    """
    return np.asarray(np.gradient(values, period, axis=0))


def differentiate_smooth(values: FloatArray, period: float) -> FloatArray:
    """Return the derivative of `values` (N, ...) that a low-pass has passed: differences of order four.

    dx[k] = (8 x[k+1] - 8 x[k-1] - x[k+2] + x[k-2]) / (12 T), at two samples of each end as `differentiate`;
    `period` T in s. At a tenth of the sample rate it is 0.5 % small, `differentiate` 6 %.
    """
    if len(values) <= 4:
        return differentiate(values, period)
    near, far = values[3:-1] - values[1:-3], values[4:] - values[:-4]
    slope = np.empty(values.shape)
    slope[2:-2] = (8.0 * near - far) / (12.0 * period)
    slope[:2], slope[-2:] = differentiate(values[:3], period)[:2], differentiate(values[-3:], period)[1:]
    return slope


def decimate(values: FloatArray, decimation: Decimation, thin: int = 1) -> FloatArray:
    """Return every `factor`-th sample of `values` (N, ...) after a zero-phase Chebyshev I low-pass.

    ceil(N / r) samples are kept, the last one included, as in MATLAB's `decimate`; a LogError if there are
    too few. A model that is linear in its parameters stays true when its columns and the measurement pass the
    same filter (Gautier 1997). Only the samples kept are computed, see `_FilterBlocks`.

    Of values one in `thin` samples may be all that is given, if they have nothing at frequencies that fold
    into the band: these stand for the others, and the gain at all frequencies below stays as it is.
    """
    if decimation.factor == 1:
        return values.copy()
    return _filter_both_ways(_describe_decimation(decimation), values, thin)


def choose_thinning(processing: Processing, period: float) -> int:
    """Return one sample in how many holds what rows have of smooth functions of the filtered positions."""
    decimation, cutoff = processing.decimation, processing.filter_cutoff
    kind = _describe_decimation(decimation)
    if cutoff is None or _build_blocks(kind) is None:
        return 1
    count = _FREQUENCIES
    gain = _compute_gain(_LowPass(order=processing.filter_order, edge=2.0 * cutoff * period), count) ** 2
    edge, factor = 0.5 * kind.edge, decimation.factor
    steps = (step for step in range(2, factor + 1) if factor % step == 0)
    fits = [step for step in steps if gain[math.floor(2 * count * (1.0 / step - edge))] <= _FOLDED]
    return max(fits, default=1)


_NOTICED = 0.1
"""Part of the samples behind a number, beyond which bad ones are noticed: over a tenth of what a low-pass
averages, a bridge is a percent off what passes it."""


def mask_touched(
    bad: NDArray[np.bool_], first: NDArray[np.intp], stop: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return in which stretches (M,), `first` to before `stop`, bad samples (N, n) are noticed: (M, n)."""
    found, most = np.empty((len(first), bad.shape[1]), dtype=np.bool_), _NOTICED * (stop - first)
    for own, column in zip(found.T, bad.T, strict=True):
        counts = np.append(0, np.cumsum(column))
        own[:] = counts[stop] - counts[first] > most
    return found


def mask_filtered(bad: NDArray[np.bool_], reach: float, step: int = 1) -> NDArray[np.bool_]:
    """Return which filtered samples, one in `step`, the last included, bad ones (N, n) are noticed in.

    `reach` is half a period of the filter's edge, in samples: as far goes the main lobe of an ideal low-pass.
    """
    places = np.arange((len(bad) - 1) % step, len(bad), step)
    wide = math.ceil(reach)
    return mask_touched(bad, np.maximum(places - wide, 0), np.minimum(places + wide + 1, len(bad)))


def mask_decimated(bad: NDArray[np.bool_], decimation: Decimation) -> NDArray[np.bool_]:
    """Return in which of the rows that `decimate` keeps bad samples (N, n) are noticed: (M, n)."""
    factor = decimation.factor
    return mask_filtered(bad, factor / decimation.band if factor > 1 else 0.0, factor)


def mask_states(recording: Recording, processing: Processing) -> NDArray[np.bool_] | None:
    """Return at which samples (N, n) bad ones are noticed in filtered states; None where there are none."""
    if recording.bad is None:
        return None
    cutoffs = [entry for entry in (processing.filter_cutoff, processing.instrument_cutoff) if entry]
    # Without a low-pass accelerations are differences of differences.
    return mask_filtered(recording.bad, 0.5 / (min(cutoffs) * recording.period) if cutoffs else 2.0)


def _describe_decimation(decimation: Decimation) -> _LowPass:
    factor, ripple = decimation.factor, decimation.ripple_db
    return _LowPass(order=decimation.order, edge=decimation.band / factor, ripple_db=ripple, factor=factor)


def _filter_both_ways(kind: _LowPass, values: FloatArray, thin: int = 1) -> FloatArray:
    """Return what a filter keeps of `values` (N, ...), both ways; LogError if there are too few."""
    samples, pad = len(values), compute_pad_length(kind.order)
    if samples <= pad:
        text = f"{samples} samples are left to filter; order {kind.order} needs more than {pad}"
        raise LogError(Notice(code="log.too-short", text=text))
    factor = kind.factor // thin
    kept, blocks = -(-len(values) // factor), _build_blocks(kind, thin)
    if blocks is None:
        # SciPy loads this on first use, which takes longer than most filters run.
        sections = _design_sections(kind).copy()
        smooth = scipy.signal.sosfiltfilt(sections, values, axis=0, padtype="odd", padlen=pad)
        first = factor - (factor * kept - len(values)) - 1
        return np.ascontiguousarray(smooth[first::factor])
    flat = np.asarray(values, dtype=np.float64).reshape(len(values), math.prod(values.shape[1:]))
    rows = np.zeros((kept, flat.shape[1]))
    places = list_live(flat)
    # Fewer of long signals bound the memory.
    width = max(1, _NUMBERS // len(flat))
    for start in range(0, len(places), width):
        own = places[start : start + width]
        # Neighbours need no copy, for a few zeros among them.
        together = 2 * len(own) > own[-1] - own[0]
        part = slice(own[0], own[-1] + 1) if together else own
        rows[:, part] = blocks.pass_columns(flat[:, part], kept)
    return rows.reshape(kept, *values.shape[1:])


def list_live(columns: FloatArray) -> NDArray[np.intp]:
    """Return the places of columns (N, c) with a number other than zero: of a regressor many have none."""
    # No numbers but zeros have a weighted sum that is zero to the last bit.
    return np.flatnonzero(np.sqrt(np.arange(1.0, len(columns) + 1.0)) @ columns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FilterBlocks:
    """A filter both ways by blocks of L samples, of which the last of every r is a row, G a block.

        s_(b+1) = A s_b + B x_b,    y_b = C s_b + D x_b                      forward
        w_(b-1) = A w_b + B J y_b,  rows_b = E J (C w_b + D J y_b)           backward, J turns the time round

    y, which no one needs at full rate, is eliminated: a block costs a product with a matrix of L times
    2 n + G numbers, whatever the number of samples is. The states are coordinates, orthonormal over time, of
    what the past adds to the output, so that rounding does not grow. A column
    depends on its neighbours by rounding alone.

    Args:
        pad: samples by which the ends are continued by reflection.
        inner: (L, 2 n + G) x_b to B x_b, to its part in the step of w, to its part in the rows.
        across: (n, n + G) s_b to its part in the step of w and in the rows; outer: (n, G) w_b to the rows.
        powers: transposes of A, A^2, A^4 and so on, until they have vanished.
        steady: (n,) the state after a long input of one.
        last: (n + pad, n) s and x of the last samples, which are no block, to w before them.
    """

    pad: int
    inner: FloatArray
    across: FloatArray
    outer: FloatArray
    powers: tuple[FloatArray, ...]
    steady: FloatArray
    last: FloatArray

    def pass_columns(self, columns: FloatArray, kept: int) -> FloatArray:
        """Return the rows (kept, c) of `columns` (N, c)."""
        pad, (length, each), states = self.pad, self.inner.shape, len(self.steady)
        width, count = columns.shape[1], -(-(len(columns) + pad) // length)
        lead = count * length - len(columns)
        # The first blocks begin before the samples do.
        early = -(-lead // length)
        first = np.empty((early * length, width))
        first[lead:] = columns[: early * length - lead]
        first[lead - pad : lead] = 2.0 * columns[0] - columns[pad:0:-1]
        # In the steady state of its first value a filter stays there, however long.
        first[: lead - pad] = first[lead - pad]
        beyond = 2.0 * columns[-1] - columns[-2 : -pad - 2 : -1]
        parts = np.empty((count, each, width))
        others = columns[early * length - lead :].reshape(count - early, length, width)
        np.matmul(self.inner.T, first.reshape(early, length, width), out=parts[:early])
        np.matmul(self.inner.T, others, out=parts[early:])
        # A row a state, blocks side by side.
        own, back, direct = np.split(parts.swapaxes(0, 1), [states, 2 * states])
        blocks = np.empty((states, count + 1, width))
        blocks[:, 0] = self.steady[:, None] * first[0]
        blocks[:, 1:] = own
        forward = blocks.reshape(states, -1)
        for place, power in enumerate(self.powers):
            if (gap := 2**place) <= count:
                forward[:, gap * width :] += power.T @ forward[:, : -gap * width]
        later = self.across.T @ forward[:, :-width]
        blocks = later[:states].reshape(back.shape)
        blocks[:, :-1] = blocks[:, 1:] + back[:, 1:]
        blocks[:, -1] = self.last.T @ np.vstack([forward[:, -width:], beyond])
        backward = blocks.reshape(states, -1)
        for place, power in enumerate(self.powers):
            if (gap := 2**place) < count:
                backward[:, : -gap * width] += power.T @ backward[:, gap * width :]
        direct += (later[states:] + self.outer.T @ backward).reshape(direct.shape)
        return parts[:, 2 * states :].reshape(-1, width)[-kept:]


@lru_cache(maxsize=64)
def _build_blocks(kind: _LowPass, thin: int = 1) -> _FilterBlocks | None:
    """Return the blocks of a filter, of one sample in `thin`; None where it remembers too many samples."""
    if thin > 1:
        whole = _build_blocks(kind)
        if whole is None:
            return None
        # Samples that are given count for the others.
        (own, beyond), count = np.split(whole.last, [len(whole.steady)]), whole.pad // thin
        last = np.vstack([own, thin * beyond[thin - 1 :: thin][:count]])
        return replace(whole, pad=count, inner=thin * whole.inner[thin - 1 :: thin], last=last)
    factor, pad = kind.factor, compute_pad_length(kind.order)
    memory = _count_remembered(kind, _VANISHED)
    if memory > _LONGEST:
        return None
    length = factor * -(-(_LEAST_BLOCK if factor > 1 else _WHOLE_BLOCK) // factor)
    most = max(length, pad)
    sections = _design_sections(kind)
    count = memory + most
    size = 2 * len(sections)
    # What each state alone leaves, and the response to a pulse: in extended precision, where there is one, as
    # the filter runs through cancelling states. One sample of all states, and of an input of one behind them.
    ones = np.eye(size, size + 1, dtype=np.longdouble)
    signal = np.zeros(size + 1, dtype=np.longdouble)
    signal[size] = 1.0
    after = np.empty_like(ones)
    for k, (b0, b1, b2, _, a1, a2) in enumerate(sections.astype(np.longdouble)):
        entering, signal = signal, b0 * signal + ones[2 * k]
        after[2 * k] = b1 * entering - a1 * signal + ones[2 * k + 1]
        after[2 * k + 1] = b2 * entering - a2 * signal
    power, entry = after[:, :size], after[:, size]
    free = signal[None, :size]
    while len(free) < count:
        free = np.concatenate([free, free @ power])
        power = power @ power
    states, response = free[:count], np.concatenate([signal[size:], free[: count - 1] @ entry])
    free = _orthonormalise(states)
    step = free[:-1].T @ free[1:]
    # What an input adds to the state, k samples later; what a constant input left.
    entered = [free[:-1].T @ response[1:]]
    for _ in range(most - 1):
        entered.append(step @ entered[-1])
    steady = free.T @ (response.sum() - np.cumsum(response))
    powers = [np.linalg.matrix_power(step, length).T]
    while np.abs(powers[-1]).max() > _VANISHED:
        powers.append(powers[-1] @ powers[-1])
    late, out = np.array(entered, dtype=np.float64).T, free[:most].astype(np.float64)
    # Entry (i, k) is the response i - k samples later.
    lags = np.subtract.outer(np.arange(most), np.arange(most))
    direct = np.where(lags < 0, 0.0, response[np.maximum(lags, 0)].astype(np.float64))
    inside, rows = direct[:length, :length], slice(factor - 1, length, factor)
    ending = np.hstack([out[:pad], direct[:pad, :pad]])
    settled = (np.linalg.matrix_power(step, pad) @ steady).astype(np.float64)
    steps = late[:, :length]
    return _FilterBlocks(
        pad=pad,
        inner=np.vstack([steps[:, ::-1], steps @ inside, inside[:, rows].T @ inside]).T.copy(),
        across=np.vstack([steps @ out[:length], inside[:, rows].T @ out[:length]]).T.copy(),
        outer=out[:length][::-1][rows].T.copy(),
        powers=tuple(power.astype(np.float64) for power in powers),
        steady=steady.astype(np.float64),
        last=(late[:, :pad] @ ending + settled[:, None] * ending[-1]).T.copy(),
    )


def _count_remembered(kind: _LowPass, rest: float) -> int:
    """Return the samples after which a transient of the filter has fallen to a relative `rest`."""
    return math.ceil(math.log(rest) / math.log(float(np.abs(_design_poles(kind)[0]).max())))


def _orthonormalise(columns: LongArray) -> LongArray:
    """Return orthonormal columns that span those given, in their precision; NumPy's own have double."""
    found: list[LongArray] = []
    for column in columns.T[columns.any(axis=0)]:
        rest = column / np.sqrt(column @ column)
        for _ in range(2):  # twice, against rounding
            for direction in found:
                rest = rest - direction * (direction @ rest)
        size = np.sqrt(rest @ rest)
        if size > _DEPENDENT:
            found.append(rest / size)
    return np.stack(found, axis=1)


def compute_noise_bandwidth(processing: Processing, period: float) -> float:
    """Return b: m decimated samples of white torque noise have the information of m b independent ones.

    b is the mean of |H|^4 over the new band relative to |H(0)|^4, of both passes of decimation and, if the
    torque passes it, low-pass. `period` in s, before decimation.
    """
    decimation = processing.decimation
    # The pass band after decimation always holds many frequencies.
    count = _FREQUENCIES * max(1, decimation.factor // 10)
    gain = np.ones(count)
    if decimation.factor > 1:
        gain *= _compute_gain(_describe_decimation(decimation), count) ** 4
    if processing.filter_torque and processing.filter_cutoff is not None:
        edge = processing.filter_cutoff * 2.0 * period
        gain *= _compute_gain(_LowPass(order=processing.filter_order, edge=edge), count) ** 4
    return min(1.0, decimation.factor * float(np.mean(gain) / gain[0]))


def _compute_gain(kind: _LowPass, count: int) -> FloatArray:
    """Return |H| at `count` frequencies from zero to below half the sample rate."""
    delay = np.exp(-1j * np.pi * np.arange(count) / count)
    gain = np.ones(count)
    for b0, b1, b2, _, a1, a2 in _design_sections(kind):
        gain *= np.abs((b0 + delay * (b1 + delay * b2)) / (1.0 + delay * (a1 + delay * a2)))
    return gain


def _design_poles(kind: _LowPass) -> tuple[NDArray[np.complex128], float]:
    """Return the poles of a digital low-pass with all zeros at -1, and the gain that goes with these.

    Poles of the analogue filter, -exp(i t) or -sinh(m + i t), become digital ones by the bilinear transform
    with the edge at its place (Parks and Burrus 1987, sections 7.2 and 7.3).
    """
    order = kind.order
    angles = 0.5j * np.pi * np.arange(1 - order, order, 2) / order
    poles, level = -np.exp(angles), 1.0
    if kind.ripple_db is not None:
        ripple = math.sqrt(10.0 ** (0.1 * kind.ripple_db) - 1.0)
        poles = -np.sinh(math.asinh(1.0 / ripple) / order + angles)
        level = 1.0 if order % 2 else 1.0 / math.sqrt(1.0 + ripple**2)
    poles = math.tan(0.5 * np.pi * kind.edge) * poles
    gain = level * float(np.prod(-poles / (1.0 - poles)).real)
    return (1.0 + poles) / (1.0 - poles), gain


@lru_cache(maxsize=64)
def _design_sections(kind: _LowPass) -> FloatArray:
    """Return second-order sections (k, 6), b0 b1 b2 1 a1 a2, those of the longest memory last."""
    poles, gain = _design_poles(kind)
    upper = sorted(poles[: kind.order // 2], key=abs)
    sections = [[1.0, 2.0, 1.0, 1.0, -2.0 * pole.real, (pole * pole.conjugate()).real] for pole in upper]
    if kind.order % 2:
        sections.insert(0, [1.0, 1.0, 0.0, 1.0, -poles[kind.order // 2].real, 0.0])
    found = np.array(sections)
    found[0, :3] *= gain
    found.setflags(write=False)
    return found


def take_line_off(values: FloatArray) -> FloatArray:
    """Return `values` (N, ...) without the line that fits them best."""
    places = np.arange(len(values)) - 0.5 * (len(values) - 1)
    flat = values.reshape(len(values), -1)
    level, slope = flat.mean(axis=0), places @ flat / max(1.0, float(places @ places))
    return np.asarray(flat - level - places[:, None] * slope).reshape(values.shape)


def estimate_density(values: FloatArray, rate: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (m,) in Hz and one-sided spectral densities (m, n) of `values` (N, n) at `rate` Hz.

    Means over Hann windows of `length` samples, half of which overlap, each without its line (Welch 1967).
    """
    places = np.arange(length)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * places / length)
    starts = range(0, len(values) - length + 1, length - length // 2)
    power = np.zeros((length // 2 + 1, values.shape[1]))
    for start in starts:
        part = take_line_off(values[start : start + length])
        power += np.abs(np.fft.rfft(window[:, None] * part, axis=0)) ** 2
    power[1 : (length + 1) // 2] *= 2.0
    return np.arange(len(power)) * rate / length, power / (len(starts) * rate * np.sum(window**2))


_BLOCK = 16_384
"""Least samples of a block, without those that settle the filter."""
_MEMORY_FLOOR = 1e-14
"""Relative rest of a transient that has settled."""
_FOLDED = 1e-5
"""Largest part of what positions have at a frequency that may fold into the band of rows."""
_ROW_RATE = 100.0
"""Default rate of rows in Hz: more than ten times what robots move at."""
_GAP = 1.5
"""Steps of time above this many median periods are gaps; 1 sample lost makes a step of 2."""
_JITTER = 0.2
"""Root mean square of the steps' deviations above this part of the median period is jitter."""


def prepare_signals(recording: Recording, processing: Processing) -> Signals:
    """Return states and torques, filtered, differentiated, cut (LogError if log and settings do not fit)."""
    check_signals(recording, processing)
    return _derive_signals(recording, processing, recording.period)


def check_signals(recording: Recording, processing: Processing) -> None:
    """Raise a LogError if a log is too short for the settings, or its times are uneven."""
    if len(recording.time) < compute_least_samples(processing):
        raise LogError(describe_too_short(len(recording.time), processing, file=recording.source))
    if (uneven := describe_uneven(recording.time, file=recording.source)) is not None:
        raise LogError(uneven)


def _derive_signals(
    recording: Recording, processing: Processing, period: float, fastest: FloatArray | None = None
) -> Signals:
    """Return the signals of samples `period` s apart; `fastest` (n,) are the log's top speeds."""
    try:
        q = _smooth(recording, "position", processing, period)
        tau = recording.torque
        tau = _smooth(recording, "torque", processing, period) if processing.filter_torque else tau
    except LogError as error:
        raise LogError(*(replace(notice, file=recording.source) for notice in error.notices)) from error
    derive = differentiate if processing.differences == "central" else differentiate_smooth
    dq = derive(q, period)
    if processing.states != "position" and recording.velocity is not None:
        dq = _smooth(recording, "velocity", processing, period)
    ddq = derive(dq, period)
    if processing.states == "acceleration" and recording.acceleration is not None:
        ddq = _smooth(recording, "acceleration", processing, period)
    speed = np.abs(dq)
    dq = np.where(speed < _RESTING * (speed.max(axis=0) if fastest is None else fastest), 0.0, dq)
    kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
    # One after the other, so that no two copies of all are in memory.
    q = freeze(q[kept])
    dq = freeze(dq[kept])
    ddq = freeze(ddq[kept])
    load, temperature, bad = recording.load, recording.temperature, recording.bad
    return Signals(
        time=recording.time[kept],
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau[kept],
        period=period,
        load=None if load is None else _smooth(recording, "load", processing, period)[kept],
        temperature=None if temperature is None else temperature[kept],
        bad=None if bad is None else bad[kept],
    )


def choose_processing(processing: Processing, period: float, row_rate: float = _ROW_RATE) -> Processing:
    """Return the settings with cut-off and decimation chosen for a sample `period` in s, where `automatic`.

    Rows come at `row_rate` in Hz or a little less; the cut-off, to three digits, is five times the band that
    decimation keeps, so that it damps nothing of it, or 0.4 of the sample rate.
    """
    if not processing.automatic:
        return processing
    rate, decimation = 1.0 / period, processing.decimation
    if decimation.factor == 1:
        # Periods have rounding errors.
        decimation = replace(decimation, factor=max(1, math.ceil(rate / row_rate - 1e-6)))
    kept = 0.5 * decimation.band * rate / decimation.factor
    cutoff = processing.filter_cutoff or float(f"{min(5.0 * kept, 0.4 * rate):.3g}")
    return replace(processing, filter_cutoff=cutoff, decimation=decimation, automatic=False)


def decimate_blocks(
    evaluate: Callable[[slice], FloatArray], samples: int, decimation: Decimation, thin: int = 1
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield, block by block, the rows that `decimate` keeps of all samples, and which they are.

    A block is filtered with enough samples before and after it for the filter to settle, so the rows are the
    same up to rounding and only one block is in memory. `evaluate` gives the values (k, ...) of a slice of
    samples, of one in `thin` but for the first and the last block; see `decimate`.
    """
    factor, kind = decimation.factor, _describe_decimation(decimation)
    if factor == 1:
        for start in range(0, samples, _BLOCK):
            part = slice(start, min(samples, start + _BLOCK))
            yield part, evaluate(part)
        return
    # Rows after which the transient of the filter has settled.
    reach = -(-_count_remembered(kind, _MEMORY_FLOOR) // factor) + decimation.order
    # The last row is the last sample, as in `decimate`.
    kept = -(-samples // factor)
    first = samples - 1 - factor * (kept - 1)
    step = max(1, max(_BLOCK, 2 * reach * factor) // factor)
    for start in range(0, kept, step):
        stop = min(kept, start + step)
        last = min(kept, stop + reach)
        begin = max(0, first + factor * (start - reach))
        inner = thin if begin and last < kept else 1
        values = evaluate(slice(begin, first + factor * (last - 1) + 1, inner))
        # One joint at a time: filters copy their input several times.
        parts = np.moveaxis(values, 1, 0) if values.ndim > 2 else [values]
        rows = [decimate(part, decimation, inner) for part in parts]
        away = last - len(rows[0])
        kept_rows = [part[start - away : stop - away] for part in rows]
        block = kept_rows[0] if values.ndim < 3 else np.stack(kept_rows, axis=1)
        del values, parts, rows, kept_rows  # Not held while the block is used.
        yield slice(start, stop), block


def _smooth(recording: Recording, name: str, processing: Processing, period: float) -> FloatArray:
    """Return a channel (N, n) of a log through the low-pass of the positions (LogError if it has holes)."""
    values: FloatArray = getattr(recording, name)
    if not np.all(np.isfinite(values)):
        text = f"{name} has values that are not finite, and processing.states = {processing.states!r} uses "
        text += 'it; state "position", or repair the log'
        raise LogError(Notice(code="log.not-finite", text=text, file=recording.source))
    if processing.filter_cutoff is None:
        return values
    cutoff, order = processing.filter_cutoff, processing.filter_order
    return low_pass(values, period=period, cutoff=cutoff, order=order)


class SignalParts:
    """Signals of a log part by part, never all in memory: those of `prepare_signals`, up to rounding.

    `time` (N,) s, `period` in s and `bad` (N, n) as in `Signals`. What rounding leaves of a joint at rest is
    measured by its fastest speed before the filter. `settle` makes more of a part, with the mean positions of
    the joints that are `resting`.
    """

    def __init__(
        self,
        recording: Recording,
        processing: Processing,
        resting: tuple[int, ...] = (),
        settle: Callable[[Signals, list[float]], Signals] | None = None,
    ) -> None:
        """Take what is of the whole log; a LogError as of `prepare_signals`."""
        check_signals(recording, processing)
        kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
        # Bad samples are those of the whole log.
        self._recording, self._processing = replace(recording, bad=None), processing
        self.period = recording.period
        self.time, self.bad = recording.time[kept], None if recording.bad is None else recording.bad[kept]
        if processing.states == "position" or recording.velocity is None:
            self._fastest = measure_top(recording.position, 2) / (2.0 * self.period)
        else:
            self._fastest = measure_top(recording.velocity)
        self._margin = 4
        if processing.filter_cutoff is not None:
            edge = min(1.0, 2.0 * processing.filter_cutoff * self.period)
            kind = _LowPass(order=processing.filter_order, edge=edge)
            self._margin += _count_remembered(kind, _MEMORY_FLOOR) if edge < 1.0 else 0
        self.resting, self._settle = resting, settle
        held = (replace(recording, position=recording.position[:, [joint]]) for joint in resting)
        self._places = [
            float(np.mean(_smooth(one, "position", processing, self.period)[kept])) for one in held
        ]
        self._last: tuple[int, Signals] | None = None

    def cut(self, part: slice) -> Signals:
        """Return the signals of a part of the samples, one in its step."""
        last = self._last
        if last is None or not last[0] <= part.start <= part.stop <= last[0] + len(last[1].time):
            settings = self._processing
            first, stop = (settings.drop_first + end for end in (part.start, part.stop))
            wide = slice(max(0, first - self._margin), min(len(self._recording.time), stop + self._margin))
            settings = replace(settings, drop_first=first - wide.start, drop_last=wide.stop - stop)
            own = change_channels(self._recording, lambda values: values[wide])
            found = _derive_signals(own, settings, self.period, self._fastest)
            found = found if self._settle is None else self._settle(found, self._places)
            last = self._last = part.start, found
        place, known = last
        return known.cut(slice(part.start - place, part.stop - place, part.step))

    def measure_accelerations(self) -> FloatArray:
        """Return the mean squares (n,) of the accelerations."""
        count = len(self.time)
        starts = range(0, count, _BLOCK)
        parts = (self.cut(slice(start, min(count, start + _BLOCK))).ddq for start in starts)
        return np.asarray(sum(np.sum(part**2, axis=0) for part in parts) / count)


def compute_least_samples(processing: Processing) -> int:
    """Return the least number of samples for these settings."""
    whole = compute_pad_length(processing.filter_order) + 1 if processing.filter_cutoff is not None else 3
    decimation = processing.decimation
    left = compute_pad_length(decimation.order) + 1 if decimation.factor > 1 else 3
    return max(whole, left + processing.drop_first + processing.drop_last)


def describe_too_short(samples: int, processing: Processing, file: str = "") -> Notice:
    """Return the notice on a log with fewer samples than `compute_least_samples`."""
    text = f"the log has {samples} samples; filter, cut ends ({processing.drop_first} first, "
    text += f"{processing.drop_last} last) and decimation need at least {compute_least_samples(processing)}"
    return Notice(code="log.too-short", text=text, file=file)


def describe_uneven(time: FloatArray, file: str = "") -> Notice | None:
    """Return the notice on gaps or jitter of `time` (N,) in s; None if it is even enough for filters."""
    period = float(np.median(np.diff(time), overwrite_input=True))
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > _GAP * period)
    if len(gaps):
        first = int(gaps[0])
        text = f"samples are missing, or time comes in bursts: {len(gaps)} steps exceed {_GAP:g} periods of "
        text += f"{period:.6g} s, the first after sample {first} (counted from 0), from {time[first]:.6g} s "
        text += f"to {time[first + 1]:.6g} s; cut the log there into separate files, or resample it evenly"
        return Notice(code="log.gap", text=text, file=file)
    errors = steps / period
    errors -= 1.0
    scatter = float(np.sqrt(np.mean(np.square(errors, out=errors))))
    if scatter > _JITTER:
        late = np.flatnonzero(np.abs(steps - period) > _JITTER * period)
        first = int(late[0])
        text = f"sampling is uneven: steps scatter by {100 * scatter:.3g} % RMS about {period:.6g} s (limit "
        text += f"{100 * _JITTER:g} %); {len(late)} steps exceed it, the first after sample {first} (counted "
        text += f"from 0), at {time[first]:.6g} s; resample the log evenly"
        return Notice(code="log.jitter", text=text, file=file)
    return None
