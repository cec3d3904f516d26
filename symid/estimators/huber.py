"""Robust regression: outliers count linearly.

Input: rows and what they can tell. Output: `Fit`.

    huber   min sum rho(e_i / s_i),  rho(u) = u^2 / 2 for |u| <= k, else k |u| - k^2 / 2,  k = 1.345

(Huber 1964), by least squares with weights min(1, k / |u|), iterated. s_i is the scatter of the joint: 1.4826
times the median of |e|, what it is for normal noise. With normal noise it is 95 % efficient.
The covariance is V (F'F)^-1, F the rows over s_i, with (Huber 1981, 7.6), psi(u) = u min(1, k / |u|),

    V = K^2 [sum psi^2 / (b m - p)] / (mean psi')^2,    K = 1 + p (1 - mean psi') / (m mean psi')

Supported: outliers in the torque, contacts that last a small part of the log.
Not supported: leverage: rows whose states are wrong.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.estimators.regression import Fit, fit_ols
from symid.rows.condensation import condense_rows, condense_weighted, solve_condensed
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["fit_huber"]

_BEND = 1.345
_NORMAL = 1.4826
_LIMIT = 100
_FOLLOWED = 10
"""Iterations in which the scatter follows the residuals; held afterwards, the sum of losses only falls."""
_SETTLED = 1e-6
"""Change of the parameters, in standard deviations, below which the iteration ends."""


def fit_huber(rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
    """Return the robust fit; arguments as for `fit_ols`."""
    first = fit_ols(rows, seen, freedom)
    values, residuals, spent = first.values, first.residuals, first.spent
    scale, change, steps = _find_scale(rows, residuals), np.inf, 0
    while steps < _LIMIT and change > _SETTLED:
        scale = _find_scale(rows, residuals) if steps < _FOLLOWED else scale
        weight = _find_weights(residuals, scale[rows.group]) * rows.weight
        found = solve_condensed(condense_weighted(rows, weight), seen.basis, 1.0 / scale)
        size = np.sqrt(np.maximum(np.sum(found.root**2, axis=1), np.finfo(float).tiny))
        change = float(np.abs((found.values - values) / size).max())
        values, steps = found.values, steps + 1
        residuals = rows.values - rows.matrix @ values
    plain = solve_condensed(condense_rows(rows), seen.basis, 1.0 / scale)
    ratios = residuals / scale[rows.group]
    return Fit(
        values=values,
        covariance=_find_variance(rows, ratios, spent, freedom) * (plain.root @ plain.root.T),
        residuals=residuals,
        spent=spent,
        condition=plain.condition,
        weights=np.sqrt(_find_weights(ratios, np.ones(len(ratios))) * rows.weight) / scale[rows.group],
        notices=() if change <= _SETTLED else (_say_unsettled(change),),
        report={"outliers_percent": 100.0 * float(np.mean(np.abs(ratios) > _BEND)), "iterations": steps},
    )


def _find_scale(rows: Rows, residuals: FloatArray) -> FloatArray:
    """Return the scatter (g,) of each group that outliers do not move; never quite zero."""
    floor = 1e-9 * float(np.linalg.norm(rows.values)) / np.sqrt(len(rows.values))
    scale = np.full(len(rows.group_names), floor)
    for index in np.unique(rows.group):
        middle = float(np.median(np.abs(residuals[rows.group == index])))
        scale[index] = max(_NORMAL * middle, floor)
    return scale


def _find_weights(residuals: FloatArray, scale: FloatArray) -> FloatArray:
    weights: FloatArray = _BEND / np.maximum(np.abs(residuals) / scale, _BEND)
    return weights


def _find_variance(rows: Rows, ratios: FloatArray, spent: int, freedom: str) -> float:
    count = len(ratios)
    independent = rows.independent if freedom == "band" else 1.0
    psi = np.clip(ratios, -_BEND, _BEND)
    inner = float(np.mean(np.abs(ratios) <= _BEND))
    stretch = 1.0 + spent * (1.0 - inner) / (independent * count * inner)
    return stretch**2 * float(psi**2 @ rows.weight) / (independent * count - spent) / inner**2


def _say_unsettled(change: float) -> Notice:
    text = (
        f"the robust fit still moved by {change:.2g} standard deviations after {_LIMIT} iterations: a joint "
        "whose residual jumps between two levels is no joint with outliers; look at the residual plots"
    )
    return Notice(code="identify.huber-unsettled", text=text)
