"""The equations of one recording, kind by kind, before they have names.

Input: a library and signals. Output: `Part`: matrix, values, times, velocities.

    torque    at every sample, decimated:  [Y | Yf] x = tau
    momentum  over windows [a, b]:         [Yp(b) - Yp(a) - int YL | int Yf] x = int tau
    filtered  at the ends of windows:      [F(dYp/dt) - F YL | F Yf] x = F tau,  F = l / (s + l)
    energy    over windows:                [h(b) - h(a) | int dq' Yf] x = int tau' dq
    power     at every sample, decimated:  [dh/dt | dq' Yf] x = tau' dq

The filter of Slotine and Li takes the rate of the momentum without an acceleration: by parts,

    int l exp(-l (t - s)) dYp/ds ds = l [Yp(b) - exp(-l W) Yp(a)] - l int l exp(-l (b - s)) Yp ds

over a window of W, and rows of later windows carry the former on with exp(-l W). In all kinds what is known
at samples enters by Simpson's rule (with the kernel in it for `filtered`), the same on both sides.

Supported: rigid robots, friction that is linear in its parameters; regressors evaluated block by block.
Not supported: elastic joints.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.filters import find_noise_band
from symid.data.recording import Signals
from symid.data.signals import decimate_blocks, decimate_columns
from symid.robot.log_map import Processing
from symid.rows.quadrature import Windows, find_windows, integrate_windows

__all__ = [
    "Part",
    "build_energy_part",
    "build_filtered_part",
    "build_momentum_part",
    "build_power_part",
    "build_torque_part",
    "cut_momentum_matrix",
    "cut_torque_matrix",
    "evaluate_columns",
    "evaluate_torques",
    "outline_momentum_part",
    "outline_torque_part",
]

_SAMPLES = 8192
"""Samples whose regressors are in memory at a time."""
_WINDOWS = 1024
"""Momentum equations of a joint that are in memory at a time."""
_RATE = 2.0
"""Of the filter of `filtered` rows, times the window: rows share 2 % of their noise's variance."""
_SIMPSON_WHITE = 0.5
"""Variance of white noise behind Simpson's rule over three samples."""


class Part(NamedTuple):
    """Equations: matrix (M, n, p), values and velocity (M, n), with one joint for all where they are summed.

    `time` (M,) s; `independent` rows of independent noise that they are worth, as a fraction.
    """

    matrix: FloatArray
    values: FloatArray
    time: FloatArray
    velocity: FloatArray
    independent: float


def build_torque_part(library: Library, signals: Signals, processing: Processing) -> Part:
    """Return torque equations, every column and the torque decimated alike."""
    outline = outline_torque_part(signals, processing)
    parameters = len(library.card.beta) + len(library.card.friction)
    matrix = np.empty((*outline.values.shape, parameters))
    for part, rows in cut_torque_matrix(library, signals, processing):
        matrix[part] = rows
    return outline._replace(matrix=matrix)


def outline_torque_part(signals: Signals, processing: Processing) -> Part:
    """Return torque equations without their matrix."""
    values, velocity = (
        decimate_columns(columns, processing.decimation) for columns in (signals.tau, signals.dq)
    )
    return Part(
        matrix=np.empty((*values.shape, 0)),
        values=values,
        time=_find_kept_times(signals.time, len(values), processing.decimation.factor),
        velocity=velocity,
        independent=find_noise_band(processing, signals.period),
    )


def cut_torque_matrix(
    library: Library, signals: Signals, processing: Processing
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of torque equations block by block, and which rows a block holds."""
    return decimate_blocks(
        lambda part: evaluate_columns(library, signals, part), len(signals.time), processing.decimation
    )


def evaluate_columns(library: Library, signals: Signals, part: slice) -> FloatArray:
    """Return [Y | Yf] at a part of the samples: (N, n, p)."""
    q, dq, ddq = signals.q[part], signals.dq[part], signals.ddq[part]
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    return np.concatenate([rigid, *_evaluate_friction(library, dq)], axis=2)


def evaluate_torques(library: Library, signals: Signals, values: FloatArray) -> FloatArray:
    """Return the torques (N, n) in N m or N that parameters (p,) foretell at every sample, block by block."""
    starts = range(0, len(signals.time), _SAMPLES)
    parts = (evaluate_columns(library, signals, slice(k, k + _SAMPLES)) @ values for k in starts)
    return np.concatenate(list(parts))


def _find_kept_times(time: FloatArray, kept: int, factor: int) -> FloatArray:
    """Return the times of the samples that a decimation by `factor` keeps: the last is among them."""
    first = len(time) - 1 - factor * (kept - 1)
    return time[first::factor]


def build_momentum_part(library: Library, signals: Signals, length: float, pieces: int) -> Part:
    """Return momentum equations over windows of `length` s; each begins a `pieces`th of it after the last."""
    windows = find_windows(len(signals.time), signals.period, length, pieces)
    whole = slice(0, len(signals.time))
    matrix = _merge(_integrate_momentum(library, signals, windows, whole), pieces)
    return outline_momentum_part(signals, length, pieces)._replace(matrix=matrix)


def cut_momentum_matrix(
    library: Library, signals: Signals, length: float, pieces: int
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield the matrix (k, n, p) of momentum equations block by block, and which rows a block holds."""
    windows = find_windows(len(signals.time), signals.period, length, pieces)
    rows, step = windows.count - pieces + 1, max(pieces, _WINDOWS)
    for start in range(0, rows, step):
        stop = min(rows, start + step)
        count = stop - start + pieces - 1
        block = Windows(count=count, intervals=windows.intervals, period=windows.period)
        first = start * windows.intervals
        samples = slice(first, first + count * windows.intervals + 1)
        yield slice(start, stop), _merge(_integrate_momentum(library, signals, block, samples), pieces)


def _integrate_momentum(library: Library, signals: Signals, windows: Windows, samples: slice) -> FloatArray:
    """Return the matrix (M, n, p) of windows that begin with the first of `samples`."""
    q, dq = signals.q[samples], signals.dq[samples]
    (momentum,) = library.evaluate("momentum_regressor", q[windows.ends], dq[windows.ends])

    def evaluate(part: slice) -> FloatArray:
        (lagrange,) = library.evaluate("lagrange_regressor", q[part], dq[part])
        return np.concatenate([-lagrange, *_evaluate_friction(library, dq[part])], axis=2)

    matrix = _integrate_blocks(evaluate, windows, integrate_windows)
    matrix[:, :, : momentum.shape[2]] += np.diff(momentum, axis=0)
    return matrix


def outline_momentum_part(signals: Signals, length: float, pieces: int) -> Part:
    """Return momentum equations without their matrix."""
    windows = find_windows(len(signals.time), signals.period, length, pieces)
    ends, span = windows.ends, windows.intervals * windows.period
    values = _merge(integrate_windows(signals.tau, windows), pieces)
    return Part(
        matrix=np.empty((*values.shape, 0)),
        values=values,
        time=_find_centres(signals.time[ends], pieces),
        velocity=_merge(integrate_windows(signals.dq, windows), pieces) / (span * pieces),
        independent=1.0 / pieces,
    )


def build_energy_part(library: Library, signals: Signals, length: float, pieces: int) -> Part:
    """Return energy equations over windows, as `build_momentum_part`."""
    windows = find_windows(len(signals.time), signals.period, length, pieces)
    ends = windows.ends
    kinetic, potential = library.evaluate("energy_regressor", signals.q[ends], signals.dq[ends])
    columns = [np.diff(kinetic + potential, axis=0)]
    if library.card.friction:
        columns.append(
            _integrate_blocks(
                lambda part: _find_friction_power(library, signals.dq[part]), windows, integrate_windows
            )
        )
    power = np.einsum("ij,ij->i", signals.tau, signals.dq)
    values = _merge(integrate_windows(power, windows), pieces)
    return Part(
        matrix=_merge(np.hstack(columns), pieces)[:, None],
        values=values[:, None],
        time=_find_centres(signals.time[ends], pieces),
        velocity=np.zeros((len(values), 1)),
        independent=1.0 / pieces,
    )


def build_power_part(library: Library, signals: Signals, processing: Processing) -> Part:
    """Return power equations at every sample, averaged over the two periods around it and decimated."""
    span = 2.0 * signals.period

    def evaluate(inner: slice) -> FloatArray:
        part = slice(inner.start, inner.stop + 2)
        q, dq = signals.q[part], signals.dq[part]
        kinetic, potential = library.evaluate("energy_regressor", q, dq)
        energy = kinetic + potential
        columns = [(energy[2:] - energy[:-2]) / span]
        if library.card.friction:
            columns.append(_average(_find_friction_power(library, dq)))
        return np.column_stack([*columns, _average(np.einsum("ij,ij->i", signals.tau[part], dq))])

    blocks = decimate_blocks(evaluate, len(signals.time) - 2, processing.decimation)
    kept = np.vstack([rows for _, rows in blocks])
    factor = processing.decimation.factor
    band = find_noise_band(processing, signals.period)
    return Part(
        matrix=kept[:, None, :-1],
        values=kept[:, -1:],
        time=_find_kept_times(signals.time[1:-1], len(kept), factor),
        velocity=np.zeros((len(kept), 1)),
        independent=band * _SIMPSON_WHITE if factor == 1 else band,
    )


def build_filtered_part(library: Library, signals: Signals, length: float) -> Part:
    """Return filtered equations: one a window of `length` s, the filter's time constant half of it."""
    windows = find_windows(len(signals.time), signals.period, length)
    span = windows.intervals * windows.period
    rate, keep = _RATE / span, float(np.exp(-_RATE))
    weights = _find_kernel_weights(windows, rate)
    ends = windows.ends
    (momentum,) = library.evaluate("momentum_regressor", signals.q[ends], signals.dq[ends])
    inertial = momentum.shape[2]

    def evaluate(part: slice) -> FloatArray:
        q, dq = signals.q[part], signals.dq[part]
        (lagrange,) = library.evaluate("lagrange_regressor", q, dq)
        (inner,) = library.evaluate("momentum_regressor", q, dq)
        return np.concatenate([-lagrange - rate * inner, *_evaluate_friction(library, dq)], axis=2)

    def convolve(values: FloatArray, part: Windows) -> FloatArray:
        return _weigh_windows(values, part, weights)

    matrix = _integrate_blocks(evaluate, windows, convolve)
    matrix[:, :, :inertial] += rate * (momentum[1:] - keep * momentum[:-1])
    return Part(
        matrix=_carry_on(matrix, keep),
        values=_carry_on(convolve(signals.tau, windows), keep),
        time=np.array(signals.time[ends][1:]),
        velocity=_carry_on(convolve(signals.dq, windows), keep),
        independent=(1.0 - keep) / (1.0 + keep),
    )


def _evaluate_friction(library: Library, dq: FloatArray) -> tuple[FloatArray, ...]:
    return library.evaluate("friction_regressor", dq) if library.card.friction else ()


def _find_friction_power(library: Library, dq: FloatArray) -> FloatArray:
    (friction,) = library.evaluate("friction_regressor", dq)
    power: FloatArray = np.einsum("ij,ijk->ik", dq, friction)
    return power


def _average(values: FloatArray) -> FloatArray:
    """Return Simpson's mean over the two periods around every inner sample."""
    mean: FloatArray = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0
    return mean


def _integrate_blocks(
    evaluate: Callable[[slice], FloatArray],
    windows: Windows,
    integrate: Callable[[FloatArray, Windows], FloatArray],
) -> FloatArray:
    """Return the integrals over all windows of what `evaluate` gives at samples, block by block."""
    many = max(1, _SAMPLES // windows.intervals)
    parts = []
    for first in range(0, windows.count, many):
        count = min(many, windows.count - first)
        start = first * windows.intervals
        block = Windows(count=count, intervals=windows.intervals, period=windows.period)
        parts.append(integrate(evaluate(slice(start, start + count * windows.intervals + 1)), block))
    return np.concatenate(parts)


def _merge(values: FloatArray, pieces: int) -> FloatArray:
    """Return sums of `pieces` neighbours (M, ...), one beginning at every entry."""
    count = len(values) - pieces + 1
    total = values[:count].copy()
    for shift in range(1, pieces):
        total += values[shift : shift + count]
    return total


def _find_centres(ends: FloatArray, pieces: int) -> FloatArray:
    centres: FloatArray = (ends[pieces:] + ends[:-pieces]) / 2.0
    return centres


def _find_kernel_weights(windows: Windows, rate: float) -> FloatArray:
    """Return weights (w + 1,) of the samples of a window in int l exp(-l (b - s)) y(s) ds.

    Over every two periods y is the parabola through its samples; the integral of kernel times parabola is
    taken by Gauss's rule, which has all digits of it.
    """
    nodes, shares = np.polynomial.legendre.leggauss(8)
    u = nodes + 1.0
    parabolas = np.array([(u - 1.0) * (u - 2.0) / 2.0, u * (2.0 - u), u * (u - 1.0) / 2.0])
    kernel = rate * np.exp(-rate * windows.period * (2.0 - u))
    three = windows.period * parabolas @ (shares * kernel)
    weights = np.zeros(windows.intervals + 1)
    for first in range(0, windows.intervals, 2):
        left = windows.intervals - first - 2
        weights[first : first + 3] += np.exp(-rate * windows.period * left) * three
    return weights


def _weigh_windows(values: FloatArray, windows: Windows, weights: FloatArray) -> FloatArray:
    """Return the sum of weights (w + 1,) times the samples of every window, whose ends are shared."""
    w, count = windows.intervals, windows.count
    inner = values[: count * w].reshape(count, w, *values.shape[1:])
    total: FloatArray = np.tensordot(inner, weights[:-1], axes=(1, 0))
    whole: FloatArray = total + weights[-1] * values[windows.ends][1:]
    return whole


def _carry_on(steps: FloatArray, keep: float) -> FloatArray:
    """Return F_i = keep F_(i-1) + steps_i, from zero on."""
    total = steps.copy()
    for index in range(1, len(total)):
        total[index] += keep * total[index - 1]
    return total
