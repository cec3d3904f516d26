"""Linear least squares: ordinary, and weighted by the scatter of each joint.

Input: rows and what they can tell. Output: `Fit`.

    ols   min |A x - y|^2
    wls   min sum_j |A_j x - y_j|^2 / sigma_j^2, sigma_j = |e_j| / sqrt(m_j - p) from its own residuals e

By QR of A B, where the columns of B are the directions that the rows see, scaled so that the
columns of A have length one. The covariance is s^2 (A'A)^-1 with s^2 = |e|^2 / (b m - p) of the
weighted rows, b the part of them that is independent behind the decimation filter. The noise of
an energy or power row grows with the speed in its window, so there the covariance is the one that
holds for unequal noise.

Supported: rank-deficient rows: directions that are not seen stay at zero; runs that count more than others.
Not supported: robust losses, priors, constraints: see `estimators`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.estimators.condensed_fit import find_weights
from symid.estimators.statistics import find_robust_covariance
from symid.rows.condensation import condense_rows, solve_condensed
from symid.rows.identifiability import Identifiability
from symid.rows.rows import SCALAR_KINDS, Rows

__all__ = ["Fit", "find_group_weights", "fit_ols", "fit_weighted", "fit_wls"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A fit of parameters to rows.

    Args:
        values: (p,) parameters; covariance: (p, p).
        residuals: (m,) y - A x, in the rows' units, whatever the weights.
        spent: degrees of freedom taken from the rows for the noise.
        condition: of the column-scaled matrix, weighted where the fit is.
        weights: (m,) what the rows were multiplied by; ones if empty.
        notices: what a reader of the result should know of the fit.
        report: what the estimator chose or paid, by name; plain numbers, texts and lists.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    spent: int
    condition: float
    weights: FloatArray = field(default_factory=lambda: np.empty(0))
    notices: tuple[Notice, ...] = ()
    report: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        if len(self.weights) != len(self.residuals):
            object.__setattr__(self, "weights", np.ones(len(self.residuals)))
        for name in ("values", "covariance", "residuals", "weights"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def fit_ols(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the ordinary least-squares fit of `rows`.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    return fit_weighted(rows, seen, np.ones(len(rows.group_names)), freedom)


def fit_wls(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the fit with rows weighted by the inverse scatter of their joint, until that settles.

    Arguments as for `fit_ols`.
    """
    return fit_weighted(rows, seen, find_group_weights(rows, seen, freedom), freedom)


def find_group_weights(rows: Rows, seen: Identifiability, freedom: str = "band") -> FloatArray:
    """Return the weights (g,) of `fit_wls`, the inverse scatter of every group's residuals."""
    used = 1 if freedom == "one" else int(seen.basis.shape[1])
    return find_weights(condense_rows(rows), seen.basis, used)


def fit_weighted(rows: Rows, seen: Identifiability, weights: FloatArray, freedom: str = "band") -> Fit:
    """Return the fit of `rows` with the residuals of group g multiplied by weights[g]; else as `fit_ols`."""
    found = solve_condensed(condense_rows(rows), seen.basis, weights)
    residuals = rows.values - rows.matrix @ found.values
    factors = weights[rows.group] * np.sqrt(rows.weight)
    weighted = residuals * factors
    used = 1 if freedom == "one" else int(seen.basis.shape[1])
    independent = rows.independent if freedom == "band" else 1.0
    if rows.kind in SCALAR_KINDS:
        design = (rows.matrix * factors[:, None]) @ seen.basis
        covariance = find_robust_covariance(seen.basis, design, weighted) / independent
    else:
        variance = float(weighted @ weighted) / (independent * len(weighted) - used)
        covariance = variance * (found.root @ found.root.T)
    return Fit(
        values=found.values,
        covariance=covariance,
        residuals=residuals,
        spent=used,
        condition=found.condition,
        weights=factors,
    )
