"""Generalised least squares: joints whose noise hangs together.

Input: rows and what they can tell, the covariance of the noise between joints where it is known.
Output: `Fit`.

    gls   min sum_t e_t' S^-1 e_t,  e_t = A_t x - y_t the residuals of all joints at one time,

S (g, g) from the residuals of wls, iterated once, or given. Rows of one time are those of one run whose
times are equal; where some joints have no row there (standstill), the part of S of the others counts.

Supported: torque, momentum and filtered rows.
Not supported: noise that hangs together in time; rows of all joints together (there wls is the same).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.estimators.regression import Fit, fit_weighted, fit_wls
from symid.estimators.statistics import find_group_scatter
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["find_noise_covariance", "fit_gls", "whiten_rows"]

_LEAST = 1e-6
"""Eigenvalue of a correlation matrix below which it is moved towards the unit matrix."""


def fit_gls(rows: Rows, seen: Identifiability, freedom: str = "band", noise: FloatArray | None = None) -> Fit:
    """Return the fit with rows weighted by the covariance of their noise between joints.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        noise: (g, g) covariance of the noise of one row of every group, up to a factor; None to estimate it.
    """
    first = fit_wls(rows, seen, freedom)
    if len(rows.group_names) == 1:
        return replace(first, report={"noise_correlation": 0.0})
    known = find_noise_covariance(rows, first) if noise is None else np.asarray(noise, dtype=np.float64)
    whitened = whiten_rows(rows, known)
    found = fit_weighted(whitened, seen, np.ones(len(rows.group_names)), freedom)
    size = np.sqrt(np.diag(known))
    correlation = known / np.outer(size, size)
    return Fit(
        values=found.values,
        covariance=found.covariance,
        residuals=rows.values - rows.matrix @ found.values,
        spent=found.spent,
        condition=found.condition,
        weights=(1.0 / size)[rows.group] * np.sqrt(rows.weight),
        report={"noise_correlation": float(np.abs(correlation - np.eye(len(size))).max())},
    )


def find_noise_covariance(rows: Rows, fit: Fit) -> FloatArray:
    """Return the covariance (g, g) of residuals of different groups at the same time.

    From the times at which two groups both have rows. These differ from pair to pair; a matrix that is not
    positive definite for that reason is moved towards its diagonal until it is.
    """
    table = _arrange(rows)
    scatter = find_group_scatter(rows, fit.residuals * np.sqrt(rows.weight), fit.spent)
    scatter = np.maximum(scatter, 1e-9 * np.linalg.norm(rows.values) / np.sqrt(len(rows.values)))
    scaled = fit.residuals / scatter[rows.group] * np.sqrt(rows.weight)
    errors = np.where(table >= 0, scaled[table], 0.0)
    there = (table >= 0).astype(np.float64)
    pairs = there.T @ there
    correlation = (errors.T @ errors) / np.maximum(pairs, 1.0)
    size = np.sqrt(np.maximum(np.diag(correlation), np.finfo(float).tiny))
    correlation = correlation / np.outer(size, size)
    np.fill_diagonal(correlation, 1.0)
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < _LEAST:
        share = (_LEAST - least) / (1.0 - least)
        correlation = (1.0 - share) * correlation + share * np.eye(len(size))
    spread = size * scatter
    covariance: FloatArray = correlation * np.outer(spread, spread)
    return covariance


def whiten_rows(rows: Rows, noise: FloatArray) -> Rows:
    """Return the rows of every time multiplied by L^-1, S = L L': their noise is white then.

    Args:
        rows: the equations.
        noise: S (g, g).
    """
    table = _arrange(rows)
    matrix, values = rows.matrix.copy(), rows.values.copy()
    patterns, kind = np.unique(table >= 0, axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        groups = np.flatnonzero(pattern)
        places = table[kind.ravel() == index][:, groups]
        lower = np.linalg.cholesky(noise[np.ix_(groups, groups)])
        inverse = np.linalg.inv(lower)
        values[places] = rows.values[places] @ inverse.T
        # Row by row of L^-1, so that no second copy of all equations is made.
        for k in range(len(groups)):
            total = inverse[k, k] * rows.matrix[places[:, k]]
            for i in range(k):
                if inverse[k, i]:
                    total += inverse[k, i] * rows.matrix[places[:, i]]
            matrix[places[:, k]] = total
    return replace(rows, matrix=matrix, values=values)


def _arrange(rows: Rows) -> NDArray[np.intp]:
    """Return the place (T, g) of every group's row at every time of every run, -1 where there is none."""
    order = np.lexsort((rows.time, rows.run))
    fresh = np.ones(len(order), dtype=bool)
    fresh[1:] = (np.diff(rows.run[order]) != 0) | (np.diff(rows.time[order]) != 0.0)
    instant = np.empty(len(order), dtype=np.intp)
    instant[order] = np.cumsum(fresh) - 1
    table = np.full((int(fresh.sum()), len(rows.group_names)), -1, dtype=np.intp)
    table[instant, rows.group] = np.arange(len(order))
    return table
