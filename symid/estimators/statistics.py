"""Norms, scatter and covariance of a least-squares fit.

Input: residuals and the matrix fitted. Output: covariance, `Residual` records.

Supported: white noise, of one variance or, for the robust covariance, of one a row.
Not supported: noise that is correlated in time; filters that pass more than the decimation
keeps make standard deviations too small.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.estimators.estimate import Residual
from symid.rows.rows import Rows

__all__ = [
    "find_group_scatter",
    "find_inverse_root",
    "find_residuals",
    "find_robust_covariance",
]


def find_robust_covariance(basis: FloatArray, design: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the covariance of x = B z where every row has a variance of its own: (p, p).

    B (F'F)^-1 F' diag(e_i^2 / (1 - h_i)^2) F (F'F)^-1 B', h_i the leverage of row i: the
    estimator HC3 of MacKinnon and White (1985).

    Args:
        basis: B (p, r).
        design: F = A B (m, r), of full column rank.
        errors: e (m,).
    """
    root = find_inverse_root(design)
    orthonormal = design @ root
    leverage = np.minimum(np.sum(orthonormal**2, axis=1), 1.0 - 1e-9)
    weighted = orthonormal * (errors / (1.0 - leverage))[:, None]
    left = basis @ root
    covariance: FloatArray = left @ (weighted.T @ weighted) @ left.T
    return covariance


def find_inverse_root(design: FloatArray) -> FloatArray:
    """Return V S^-1 of the singular value decomposition, so that its square is (F'F)^-1."""
    _, singular, directions = np.linalg.svd(np.linalg.qr(design, mode="r"), full_matrices=False)
    root: FloatArray = directions.T / singular
    return root


def find_group_scatter(rows: Rows, residuals: FloatArray, fitted: int) -> FloatArray:
    """Return |e_j| / sqrt(m_j - fitted) of every group: (g,); `fitted` parameters were fitted.

    A group with no more rows than that is divided by its number of rows; without rows it is 0.
    """
    scatter = np.zeros(len(rows.group_names))
    for index in range(len(scatter)):
        part = residuals[rows.group == index]
        freedom = len(part) - fitted if len(part) > fitted else len(part)
        scatter[index] = np.linalg.norm(part) / np.sqrt(max(freedom, 1))
    return scatter


def find_residuals(rows: Rows, residuals: FloatArray, fitted: int) -> tuple[Residual, ...]:
    """Return norm, relative norm and scatter of every group that has rows."""
    scatter = find_group_scatter(rows, residuals, fitted)
    entries = []
    for index, name in enumerate(rows.group_names):
        mask = rows.group == index
        if not mask.any():
            continue
        norm = float(np.linalg.norm(residuals[mask]))
        whole = float(np.linalg.norm(rows.values[mask]))
        entries.append(
            Residual(
                joint=name,
                norm=norm,
                relative_percent=100.0 * norm / whole if whole else float("inf"),
                std=float(scatter[index]),
                samples=int(mask.sum()),
                unit=rows.group_units[index],
            )
        )
    return tuple(entries)
