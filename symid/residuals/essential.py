"""Essential parameters: what a log needs of a model, and the price of leaving out the rest.

Input: rows, their fit, what they can tell. Output: `Essential`.

Backward elimination: the parameter whose removal costs least, measured by its own noise, goes first, until
the next one stands out of the noise; then the rest is fitted anew. Removing parameter k raises the sum of
weighted squares by x_k^2 / c_kk, c the inverse of F'F, F the weighted matrix of those kept. The idea is that
of Pham and Gautier (1991), who drop by the relative deviation. The noise is that of blocks of consecutive
rows, so that a residual with a pattern does not make every parameter essential.

Supported: any fit by least squares, weighted or not; directions that the log does not tell stay as they are.
Not supported: grouping parameters anew; constraints.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.estimators.regression import Fit
from symid.residuals.doubts import find_block_deviations
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["Dropped", "Essential", "find_essential"]

LEVEL = 2.0
"""Deviations from zero below which a parameter is noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A parameter left out: how many deviations it lay from zero then, and the residual's growth so far."""

    name: str
    ratio: float
    price_percent: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Essential:
    """A model without what the log does not need.

    Args:
        kept: names of the parameters left.
        dropped: the others, in the order they went.
        values: (p,) of all parameters after the last fit, zero where dropped.
        price_percent: by how much the norm of the weighted residual grew.
    """

    kept: tuple[str, ...]
    dropped: tuple[Dropped, ...]
    values: FloatArray
    price_percent: float

    def __post_init__(self) -> None:
        """Copy the array and make it read-only."""
        object.__setattr__(self, "values", freeze(self.values))


def find_essential(
    rows: Rows, fit: Fit, seen: Identifiability, *, level: float = LEVEL, freedom: str = "band"
) -> Essential:
    """Return the model that is left when parameters below `level` deviations are dropped one by one.

    Args:
        rows: the equations of the fit.
        fit: its result; the rows keep its weights.
        seen: what the rows can tell; only parameters with a value of their own are dropped.
        level: in deviations.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    candidates = np.flatnonzero(seen.learnable)
    others = seen.basis[~seen.learnable]
    # Directions that only refused parameters share: they stay, whatever they cost.
    _, singular, right = (
        np.linalg.svd(others, full_matrices=False) if len(others) else (0, np.zeros(0), others)
    )
    rest = others @ right[singular > 1e-9 * max(singular.max(initial=0.0), 1e-300)].T
    mixing = np.zeros((rows.matrix.shape[1], len(candidates) + rest.shape[1]))
    mixing[candidates, np.arange(len(candidates))] = 1.0
    mixing[np.ix_(~seen.learnable, np.arange(len(candidates), mixing.shape[1]))] = rest
    weighted = (rows.matrix * fit.weights[:, None]) @ mixing
    factor: FloatArray = np.asarray(
        np.linalg.qr(np.column_stack([weighted, rows.values * fit.weights]), mode="r")
    )
    inflation = _find_inflation(rows, fit, seen)[candidates]
    independent = rows.independent if freedom == "band" else 1.0
    used = 1 if freedom == "one" else mixing.shape[1]
    left = max(independent * len(rows.values) - used, 1.0)
    kept, dropped, inner, price = _eliminate(factor, inflation, left, level)
    return Essential(
        kept=tuple(rows.names[candidates[k]] for k in kept if k < len(candidates)),
        dropped=tuple(
            Dropped(name=rows.names[candidates[k]], ratio=ratio, price_percent=paid)
            for k, ratio, paid in dropped
        ),
        values=mixing @ inner,
        price_percent=price,
    )


def _find_inflation(rows: Rows, fit: Fit, seen: Identifiability) -> FloatArray:
    """Return how many times larger than stated the deviations (p,) are, at least one."""
    stated = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    blocks = find_block_deviations(rows, fit, seen)
    ratio: FloatArray = np.where(stated > 0.0, blocks / np.where(stated > 0.0, stated, 1.0), 1.0)
    return np.maximum(ratio, 1.0)


def _eliminate(
    factor: FloatArray, inflation: FloatArray, freedom: float, level: float
) -> tuple[list[int], list[tuple[int, float, float]], FloatArray, float]:
    """Return columns kept, (column, deviations, price) of those dropped, values of all, the whole price."""
    matrix, target = factor[:, :-1], factor[:, -1]
    kept = list(range(matrix.shape[1]))
    values, inverse, square = _solve(matrix, target, kept)
    first = max(square, 1e-300)
    dropped: list[tuple[int, float, float]] = []
    while True:
        free = [place for place, column in enumerate(kept) if column < len(inflation)]
        if not free:
            break
        spread = np.sqrt(first / freedom * inverse[free]) * inflation[[kept[place] for place in free]]
        ratios = np.abs(values[free]) / np.maximum(spread, 1e-300)
        least = int(np.argmin(ratios))
        if ratios[least] >= level:
            break
        column = kept.pop(free[least])
        values, inverse, square = _solve(matrix, target, kept)
        dropped.append((column, float(ratios[least]), _find_growth(square, first)))
    inner = np.zeros(matrix.shape[1])
    inner[kept] = values
    return kept, dropped, inner, _find_growth(square, first)


def _find_growth(square: float, first: float) -> float:
    return 100.0 * (float(np.sqrt(max(square, first) / first)) - 1.0)


def _solve(matrix: FloatArray, target: FloatArray, kept: list[int]) -> tuple[FloatArray, FloatArray, float]:
    """Return the least-squares values of some columns, the diagonal of (F'F)^-1, and the sum of squares."""
    if not kept:
        return np.zeros(0), np.zeros(0), float(target @ target)
    part = matrix[:, kept]
    lengths = np.linalg.norm(part, axis=0)
    scales = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    left, singular, right = np.linalg.svd(part * scales, full_matrices=False)
    values = scales * (right.T @ ((left.T @ target) / singular))
    inverse = scales**2 * np.sum((right.T / singular) ** 2, axis=1)
    error = target - part @ values
    return values, inverse, float(error @ error)
