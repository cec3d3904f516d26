"""Linear least squares: ordinary, and weighted by the scatter of each joint.

Input: rows and what they can tell. Output: `Fit`.

    ols   min |A x - y|^2
    wls   min sum_j |A_j x - y_j|^2 / sigma_j^2, sigma_j = |e_j| / sqrt(m_j - p) from the residuals e of ols

By QR of A B, where the columns of B are the directions that the rows see, scaled so that the
columns of A have length one. The covariance is s^2 (A'A)^-1 with s^2 = |e|^2 / (b m - p) of the
weighted rows, b the part of them that is independent behind the decimation filter. The noise of
an energy row grows with the speed in its window, so there the covariance is the one that holds
for unequal noise.

Supported: rank-deficient rows: directions that are not seen stay at zero.
Not supported: robust losses, priors, constraints.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.identification.identifiability import Identifiability, find_spectrum
from symid.identification.rows import Rows
from symid.identification.statistics import find_covariance, find_group_scatter, find_robust_covariance

__all__ = ["ESTIMATORS", "Estimator", "Fit", "fit_ols", "fit_wls"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A least-squares fit.

    Args:
        values: (p,) parameters; covariance: (p, p).
        residuals: (m,) y - A x, in the rows' units, whatever the weights.
        spent: degrees of freedom taken from the rows for the noise.
        condition: of the column-scaled matrix, weighted where the fit is.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    spent: int
    condition: float

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("values", "covariance", "residuals"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def fit_ols(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the ordinary least-squares fit of `rows`.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    return _fit_weighted(rows, seen, np.ones(len(rows.values)), freedom)


def fit_wls(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the fit with rows weighted by the inverse scatter of their joint, iterated once.

    Arguments as for `fit_ols`.
    """
    first = fit_ols(rows, seen, freedom)
    scatter = find_group_scatter(rows, first.residuals, first.spent)
    # A joint that is explained to the last bit must not outweigh all others by 1e16.
    floor = 1e-9 * np.linalg.norm(rows.values) / np.sqrt(len(rows.values))
    weights = 1.0 / np.maximum(scatter, floor)
    return _fit_weighted(rows, seen, weights[rows.group], freedom)


def _fit_weighted(rows: Rows, seen: Identifiability, weights: FloatArray, freedom: str) -> Fit:
    matrix = rows.matrix * weights[:, None]
    # Columns: the regressor in the directions seen, then the right-hand side.
    stacked = np.column_stack([matrix @ seen.basis, rows.values * weights])
    factor: FloatArray = np.asarray(np.linalg.qr(stacked, mode="r"))
    count = int(seen.basis.shape[1])
    left, singular, right = np.linalg.svd(factor[:count, :count])
    inner = right.T @ ((left.T @ factor[:count, count]) / singular)
    values: FloatArray = seen.basis @ inner
    residuals = rows.values - rows.matrix @ values
    weighted, used = residuals * weights, 1 if freedom == "one" else count
    independent = rows.independent if freedom == "band" else 1.0
    spectrum = find_spectrum(matrix[:, seen.basis.any(axis=1)]).singular
    return Fit(
        values=values,
        covariance=find_robust_covariance(seen.basis, stacked[:, :count], weighted)
        if rows.kind == "energy"
        else find_covariance(seen.basis, stacked[:, :count], weighted, independent * len(weighted) - used),
        residuals=residuals,
        spent=used,
        condition=float(spectrum[0] / spectrum[count - 1]),
    )


class Estimator(Protocol):
    """How equations become parameters."""

    def __call__(self, rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
        """Return the fit of `rows`."""


ESTIMATORS: dict[str, Estimator] = {"ols": fit_ols, "wls": fit_wls}
