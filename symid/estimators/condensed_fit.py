"""Ordinary and weighted least squares on condensed rows, as `regression` has them on rows.

Input: condensed rows, directions seen. Output: `CondensedFit`; residuals row by row are not kept.

Supported: torque, momentum and filtered rows of any number.
Not supported: rows of all joints together, whose covariance needs every residual.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.rows.condensation import Condensed, find_square_sums, solve_condensed

__all__ = ["CondensedFit", "find_weights", "fit_condensed", "settle_weights"]

_ROUNDS = 30
_SETTLED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CondensedFit:
    """A fit without its residuals.

    Args:
        values: (p,) parameters; covariance: (p, p).
        squares: (g,) sum of squared residuals of every group, in the rows' units.
        weights: (g,) what residuals of every group were multiplied by.
        variance: of the weighted noise; condition: of the column-scaled, weighted matrix.
    """

    values: FloatArray
    covariance: FloatArray
    squares: FloatArray
    weights: FloatArray
    variance: float
    condition: float


def find_weights(condensed: Condensed, basis: FloatArray, used: int) -> FloatArray:
    """Return the inverse scatter (g,) of every group's residuals in the fit that has these weights.

    From the ordinary fit on, until nothing changes: there a quiet joint shows the errors that the noise of
    loud ones makes, and its weight comes out too small.

    Args:
        condensed: the equations.
        basis: (p, r) directions that they see.
        used: parameters that the scatter of a group is corrected for, where it has more rows than that.
    """
    return settle_weights(condensed, lambda weights: solve_condensed(condensed, basis, weights).values, used)


def settle_weights(condensed: Condensed, solve: Callable[[FloatArray], FloatArray], used: int) -> FloatArray:
    """Return weights (g,) as `find_weights` does, of any estimator.

    Args:
        condensed: the equations that leave residuals.
        solve: from weights (g,) to parameters (p,).
        used: as in `find_weights`.
    """
    counts = condensed.counts
    divisor = np.where(counts > used, counts - used, np.maximum(counts, 1))
    # A joint that is explained to the last bit must not outweigh all others by 1e16.
    floor = 1e-9 * np.linalg.norm(condensed.factors[:, :, -1]) / np.sqrt(counts.sum())
    weights = np.ones(len(counts))
    for _ in range(_ROUNDS):
        values = solve(weights)
        scatter = np.maximum(np.sqrt(find_square_sums(condensed, values) / divisor), floor)
        before, weights = weights, 1.0 / scatter
        if np.abs(weights / before - 1.0).max() < _SETTLED:
            break
    return weights


def fit_condensed(
    condensed: Condensed, basis: FloatArray, *, weighted: bool = True, freedom: str = "band"
) -> CondensedFit:
    """Return the weighted or the ordinary fit of condensed rows.

    Args:
        condensed: the equations.
        basis: (p, r) directions that they see.
        weighted: whether groups count by the inverse of their scatter, see `find_weights`.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    used = 1 if freedom == "one" else int(basis.shape[1])
    weights = find_weights(condensed, basis, used) if weighted else np.ones(len(condensed.counts))
    found = solve_condensed(condensed, basis, weights)
    squares = find_square_sums(condensed, found.values)
    independent = condensed.independent if freedom == "band" else 1.0
    variance = float(squares @ weights**2) / (independent * int(condensed.counts.sum()) - used)
    return CondensedFit(
        values=found.values,
        covariance=variance * (found.root @ found.root.T),
        squares=squares,
        weights=weights,
        variance=variance,
        condition=found.condition,
    )
