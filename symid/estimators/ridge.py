"""Ridge regression: least squares that stays near what was known before.

Input: rows and what they can tell, a prior. Output: `Fit`.

    ridge   min sum_j |A_j x - y_j|^2 / sigma_j^2 + w sum_k ((x_k - x0_k) / d_k)^2

with sigma_j as for wls. This is the most probable x where noise and prior are normal and the deviations of
the prior are d / sqrt(w); the covariance is that of x then, (A' S^-1 A + w D^-2)^-1. By default w is chosen
by cross validation: the rows of each run are cut into contiguous blocks, each is foretold by the others, and
the w that foretells best is taken.

Supported: priors of some parameters; directions that the log does not see, which then come from the prior.
Not supported: a weight for every parameter: their deviations are that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.estimators.prior import Prior
from symid.estimators.regression import Fit, find_group_weights, fit_ols
from symid.rows.condensation import (
    Condensed,
    condense_rows,
    condense_weighted,
    extend_triangle,
    find_square_sums,
    stack_condensed,
)
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["WEIGHTS", "fit_ridge"]

WEIGHTS = tuple(float(10.0 ** (0.5 * k)) for k in range(-12, 13))
"""Weights of the prior that are tried, and none at all."""
_BLOCKS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pull:
    """The prior as rows: (x - x0) / d for the parameters that have a finite deviation."""

    values: FloatArray
    inverse: FloatArray

    def build_rows(self, weight: float) -> FloatArray:
        """Return [D | D x0] (q, p + 1), times the root of the weight."""
        kept = self.inverse > 0.0
        diagonal = np.diag(self.inverse)[kept]
        rows: FloatArray = np.sqrt(weight) * np.column_stack([diagonal, (self.inverse * self.values)[kept]])
        return rows


def fit_ridge(
    rows: Rows,
    seen: Identifiability,
    freedom: str = "band",
    *,
    prior: Prior,
    weight: float | None = None,
) -> Fit:
    """Return the fit near a prior.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        prior: what was known before.
        weight: of the prior, not negative; None to choose it by cross validation.
    """
    first = fit_ols(rows, seen, freedom)
    independent = rows.independent if freedom == "band" else 1.0
    # Rows behind a filter count for as many as they are worth, next to the prior.
    inverse_scatter = find_group_weights(rows, seen, freedom) * np.sqrt(independent)
    centre, deviations = prior.arrange(rows.names)
    pull = _Pull(values=centre, inverse=1.0 / deviations)
    scores: dict[float, float] = {}
    if weight is None:
        scores = _score_weights(rows, pull, inverse_scatter)
        weight = min(scores, key=lambda entry: scores[entry])
    triangle = stack_condensed(condense_rows(rows), inverse_scatter)
    values, root = _solve(triangle, pull, weight)
    residuals = rows.values - rows.matrix @ values
    weights = inverse_scatter[rows.group] * np.sqrt(rows.weight)
    return Fit(
        values=values,
        covariance=root @ root.T,
        residuals=residuals,
        spent=first.spent,
        condition=first.condition,
        weights=weights,
        report={
            "prior": prior.source,
            "prior_weight": weight,
            "prior_weight_chosen": bool(scores),
            "foretold_percent": _describe_scores(rows, scores, inverse_scatter),
        },
    )


def _solve(triangle: FloatArray, pull: _Pull, weight: float) -> tuple[FloatArray, FloatArray]:
    """Return x (p,) and the root (p, p) of (A'A + w D^2)^+; directions that nothing tells stay at zero."""
    parts = [triangle, pull.build_rows(weight)] if weight > 0.0 else [triangle]
    whole = extend_triangle(np.zeros((0, triangle.shape[1])), [np.vstack(parts)])
    matrix, target = whole[:, :-1], whole[:, -1]
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    left, singular, right = np.linalg.svd(matrix * scales, full_matrices=False)
    told = singular > 1e-9 * singular[0]
    root = scales[:, None] * (right[told].T / singular[told])
    return root @ (left[:, told].T @ target), root


def _score_weights(rows: Rows, pull: _Pull, inverse_scatter: FloatArray) -> dict[float, float]:
    """Return the weighted squares of blocks foretold by the others, for every weight."""
    block = _cut_runs(rows)
    parts = [condense_weighted(rows, rows.weight * (block == k)) for k in range(_BLOCKS)]
    triangles = [stack_condensed(part, inverse_scatter) for part in parts]
    size = triangles[0].shape[1]
    scores = dict.fromkeys((0.0, *WEIGHTS), 0.0)
    for k, held_out in enumerate(parts):
        others = np.vstack([triangle for j, triangle in enumerate(triangles) if j != k])
        train = extend_triangle(np.zeros((0, size)), [others])
        for weight in scores:
            values, _ = _solve(train, pull, weight)
            scores[weight] += _measure(held_out, values, inverse_scatter)
    return scores


def _measure(part: Condensed, values: FloatArray, inverse_scatter: FloatArray) -> float:
    return float(find_square_sums(part, values) @ inverse_scatter**2)


def _cut_runs(rows: Rows) -> NDArray[np.intp]:
    """Return in which of the blocks a row is: equal spans of time of its run, in order."""
    block = np.zeros(len(rows.values), dtype=np.intp)
    for run in np.unique(rows.run):
        members = rows.run == run
        time = rows.time[members]
        first, span = float(time.min()), float(np.ptp(time)) or 1.0
        block[members] = np.minimum((_BLOCKS * (time - first) / span).astype(np.intp), _BLOCKS - 1)
    return block


def _describe_scores(
    rows: Rows, scores: dict[float, float], inverse_scatter: FloatArray
) -> list[tuple[float, float]]:
    """Return (weight, what is left of the weighted torque of the foretold blocks in percent)."""
    whole = float(np.sum((rows.values * inverse_scatter[rows.group]) ** 2 * rows.weight))
    return [(weight, 100.0 * float(np.sqrt(score / whole))) for weight, score in scores.items()]
