"""Parameters that trade against each other: correlations, and ellipses of confidence.

Input: a covariance matrix. Output: pairs with their correlation, `Ellipse`.

Supported: any covariance, that of a fit or of a bootstrap.
Not supported: more than two parameters at once; singular values say what many share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray

__all__ = ["Ellipse", "find_correlation_matrix", "find_ellipse", "list_correlated"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipse:
    """Where a pair of values lies with probability `level`, if the noise is normal.

    `centre` is the pair, `axes` the longer and the shorter half axis, `angle` (rad) of the longer one
    from the first parameter's axis.
    """

    centre: tuple[float, float]
    axes: tuple[float, float]
    angle: float
    level: float

    def trace(self, points: int = 181) -> FloatArray:
        """Return the closed outline: (points, 2)."""
        turn = np.linspace(0.0, 2.0 * np.pi, points)
        c, s = np.cos(self.angle), np.sin(self.angle)
        local = np.column_stack([self.axes[0] * np.cos(turn), self.axes[1] * np.sin(turn)])
        outline: FloatArray = np.asarray(self.centre) + local @ np.array([[c, s], [-s, c]])
        return outline


def find_correlation_matrix(covariance: FloatArray) -> FloatArray:
    """Return the correlation coefficients (k, k); 0 with a parameter that has no deviation."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inverse = np.where(deviation > 0.0, 1.0 / np.where(deviation > 0.0, deviation, 1.0), 0.0)
    matrix: FloatArray = np.clip(covariance * inverse[:, None] * inverse, -1.0, 1.0)
    return matrix


def list_correlated(
    covariance: FloatArray, names: Sequence[str], least: float = 0.9
) -> tuple[tuple[str, str, float], ...]:
    """Return (name, name, correlation) of pairs beyond `least` in size, the closest first."""
    matrix = find_correlation_matrix(covariance)
    first, second = np.triu_indices(len(names), 1)
    size = np.abs(matrix[first, second])
    order = np.argsort(-size, kind="stable")
    return tuple(
        (names[first[k]], names[second[k]], float(matrix[first[k], second[k]]))
        for k in order
        if size[k] >= least
    )


def find_ellipse(values: Sequence[float], covariance: FloatArray, level: float = 0.95) -> Ellipse:
    """Return the ellipse of confidence of two parameters.

    (x - v)' C^-1 (x - v) = -2 ln(1 - level), the quantile of chi-squared with two degrees of freedom.

    Args:
        values: v, two numbers.
        covariance: C (2, 2).
        level: probability, between 0 and 1.
    """
    spread, directions = np.linalg.eigh(covariance)
    radius = np.sqrt(-2.0 * np.log1p(-level))
    lengths = radius * np.sqrt(np.maximum(spread, 0.0))
    longer = directions[:, 1]
    return Ellipse(
        centre=(float(values[0]), float(values[1])),
        axes=(float(lengths[1]), float(lengths[0])),
        angle=float(np.arctan2(longer[1], longer[0])),
        level=level,
    )
