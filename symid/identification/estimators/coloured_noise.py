"""Covariance of an estimate for residuals that are correlated in time and between joints.

Rows, residuals, influence of the rows on the parameters -> covariance.

    x - x_true = L sum_i g_i e_i,     cov x = L [integral of G(f)^H S(f) G(f) df] L'

G is the Fourier transform of the scores g (weighted columns, or instruments) of every joint along a log, S
the spectral density of the weighted residuals e of all joints, from their cross periodograms through a lag
window of Parzen (Priestley 1981, 6.2.3). A fit takes power out of its residuals where its columns have
theirs: with h_j(f) = |Q_j(f)|^2 / N, Q orthonormal columns of the fit, the periodogram of joint j is divided
by 1 - h_j(f), as HC2 divides squares of residuals by 1 - h_i (MacKinnon and White 1985).

Supported: rows at even times with some left out; several logs; least squares and instruments.
Not supported: noise whose size follows the motion, as errors of the model do (a jackknife holds for them).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.identification.regression import Rows, compute_inverse_root

_LAG = 0.1
"""Of a log: longest lag of the window, which resolves the spectrum to ten periods a log."""
_MOST_LEVERAGE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Influence:
    """How rows act on an estimate: x - x_true = left @ scores' e for weighted residuals e.

    Args:
        left: (p, r); scores: (m, r); frame: (m, r) orthonormal columns that the fit takes from residuals.
        residuals: (m,) weighted.
    """

    left: FloatArray
    scores: FloatArray
    frame: FloatArray
    residuals: FloatArray


def measure_influence(rows: Rows, basis: FloatArray, weights: FloatArray, residuals: FloatArray) -> Influence:
    """Return how rows act on a least-squares fit in the directions `basis` (p, r).

    `weights` (m,) are what the rows were multiplied by, `residuals` (m,) y - A x.
    """
    scores = (rows.matrix @ basis) * weights[:, None]
    root = compute_inverse_root(scores)
    return Influence(
        left=basis @ root @ root.T, scores=scores, frame=scores @ root, residuals=residuals * weights
    )


def _list_grids(rows: Rows) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], int]]:
    """Yield the rows of every log, their places in time, and the number of places."""
    for run in np.unique(rows.run):
        own = np.flatnonzero(rows.run == run)
        time = np.unique(rows.time[own])
        step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        places = np.round((rows.time[own] - time[0]) / step).astype(np.intp)
        yield own, places, int(places.max()) + 1


def compute_coloured_covariance(rows: Rows, influence: Influence) -> FloatArray:
    """Return the covariance (p, p) of an estimate from torque rows (m of them, at even times)."""
    groups, rank = len(rows.group_names), influence.scores.shape[1]
    total = np.zeros((rank, rank))
    for own, places, count in _list_grids(rows):
        size = 2 * count
        table = np.zeros((count, groups, 2 * rank + 2))
        table[places, rows.group[own], :rank] = influence.scores[own]
        table[places, rows.group[own], rank:-2] = influence.frame[own]
        table[places, rows.group[own], -2] = influence.residuals[own]
        table[places, rows.group[own], -1] = 1.0
        waves = np.fft.rfft(table, n=size, axis=0)
        scores, frame, errors = waves[..., :rank], waves[..., rank:-2], waves[..., -2]
        there = np.maximum(table[..., -1].sum(axis=0), 1.0)
        leverage = np.sum(np.abs(frame) ** 2, axis=2) / there
        errors = errors / np.sqrt(1.0 - np.minimum(leverage, _MOST_LEVERAGE))
        density = _smooth(errors, waves[..., -1], size, count)
        # Every frequency but the first and the last stands for its negative too.
        double = np.full(len(density), 2.0)
        double[[0, -1]] = 1.0
        part = np.einsum(
            "fjr,fjk,fks->rs", scores.conj() * double[:, None, None], density, scores, optimize=True
        )
        total += part.real / size
    return np.asarray(influence.left @ total @ influence.left.T)


def _smooth(errors: FloatArray, masks: NDArray[np.complex128], size: int, count: int) -> FloatArray:
    """Return the density (F, n, n) of errors (F, n), normed so that white noise of variance one has one.

    `masks` (F, n) are the transforms of what says where a joint has a row: a lag is divided by its pairs.
    """
    longest = max(2, round(_LAG * count))
    distance = np.minimum(np.arange(size), size - np.arange(size))
    lag = distance / longest
    near, far = 1.0 - 6.0 * lag**2 + 6.0 * lag**3, 2.0 * (1.0 - lag) ** 3
    window = np.where(lag <= 0.5, near, np.where(lag <= 1.0, far, 0.0))
    window = window * np.maximum(1.0 - distance / count, 0.0)
    groups = errors.shape[1]
    density = np.zeros((len(errors), groups, groups), dtype=complex)
    for j in range(groups):
        for k in range(j, groups):
            pairs = np.fft.irfft(masks[:, j] * masks[:, k].conj(), n=size)
            covariance = np.fft.irfft(errors[:, j] * errors[:, k].conj(), n=size) / np.maximum(pairs, 1.0)
            wave = np.fft.rfft(covariance * window)
            density[:, j, k] = wave
            density[:, k, j] = wave.conj()
    # Where many rows are missing, a density may come out negative.
    sizes, vectors = np.linalg.eigh(density)
    if np.all(sizes >= 0.0):
        return density
    return np.asarray((vectors * np.maximum(sizes, 0.0)[:, None]) @ vectors.conj().swapaxes(1, 2))
