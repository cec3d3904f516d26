"""How much a trajectory tells: numbers of its observation matrix, smooth, with exact derivatives.

Input: the observation matrix A (m, b), one row a torque, one column a parameter. Output: condition number,
criterion and its derivative by every entry of A.

With G = A'A, d = sqrt(diag G) and C = G / (d d'), the Gram matrix of the columns scaled to length one:

    condition   cond = sqrt(lmax(C) / lmin(C))
                smooth stand-in  f = (log sum l^p + log sum l^-p) / (2 p) >= log cond,
                at most log(b) / p above it
    d-optimal   f = -log det(G) / (2 b): minus the mean logarithm of a parameter's information

The derivative of f(G) is a symmetric S, and df = sum (2 A S) dA. Criteria of designs: Swevers et al. 1997.

Supported: full column rank. Not supported: matrices of less rank, whose criterion is infinite.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray

__all__ = ["CRITERIA", "Criterion", "find_condition", "find_criterion", "find_information"]

CRITERIA = ("condition", "d-optimal")
_FLOOR = 1e-13
"""Least eigenvalue of a scaled Gram matrix that is not rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """What is minimised: one of `CRITERIA`; power p and weight of the information belong to "condition"."""

    name: str = "condition"
    power: float = 8.0
    weight: float = 0.0


def _scale(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    lengths = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    return gram / np.outer(lengths, lengths), lengths


def find_condition(gram: FloatArray) -> float:
    """Return the condition number of the columns scaled to length one, of G (b, b); inf for less rank."""
    values = np.linalg.eigvalsh(_scale(gram)[0])
    if not values[0] > _FLOOR * values[-1]:
        return float("inf")
    return float(np.sqrt(values[-1] / values[0]))


def find_information(gram: FloatArray) -> float:
    """Return log det(G) / (2 b) of G (b, b), the mean logarithm of information; -inf for less rank."""
    sign, value = np.linalg.slogdet(gram)
    return float(value) / (2.0 * len(gram)) if sign > 0 else -float("inf")


def find_criterion(gram: FloatArray, criterion: Criterion) -> tuple[float, FloatArray]:
    """Return f and S = df/dG (b, b), symmetric, for G (b, b)."""
    scaled, lengths = _scale(gram)
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, _FLOOR * values[-1])
    size = 2.0 * len(gram)
    by_lengths = np.outer(lengths, lengths)
    information = float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(lengths))) / size
    slope = -((vectors / values) @ vectors.T) / by_lengths / size
    if criterion.name == "d-optimal":
        return -information, slope
    value, partial = _find_condition_criterion(values, vectors, criterion.power)
    by_gram = partial / by_lengths
    by_gram[np.diag_indices_from(by_gram)] -= (partial * scaled).sum(axis=1) / lengths**2
    return value - criterion.weight * information, by_gram + criterion.weight * slope


def _find_condition_criterion(
    values: FloatArray, vectors: FloatArray, power: float
) -> tuple[float, FloatArray]:
    """Return the smooth stand-in for log cond, and its derivative by C, from eigenvalues and -vectors."""
    # Powers of ratios, so that none overflows.
    up, down = (values / values[-1]) ** power, (values[0] / values) ** power
    value = (np.log(values[-1] / values[0]) + (np.log(up.sum()) + np.log(down.sum())) / power) / 2.0
    slopes = 0.5 * (up / up.sum() - down / down.sum()) / values
    return float(value), (vectors * slopes) @ vectors.T
