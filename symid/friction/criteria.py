"""Information criteria of a least-squares fit: what a parameter more must gain to be worth it.

    AICc = M ln(J / M) + 2 k + 2 k (k + 1) / (M - k - 1)      Hurvich and Tsai, Biometrika 76 (1989) 297-307
    BIC  = M ln(J / M) + k ln M                               Schwarz, Ann. Statist. 6 (1978) 461-464

M rows, k unknowns with the noise's variance as one of them; a common constant is left out.

Supported: white noise. Not supported: rows that are filtered so hard that they repeat each other.
"""

import math

__all__ = ["find_aicc", "find_bic"]


def find_aicc(objective: float, rows: int, unknowns: int, floor: float = 0.0) -> float:
    """Return AICc; infinite where there are too few rows.

    Args:
        objective: J, (N m)^2 or N^2.
        rows: M.
        unknowns: that were fitted, without the variance.
        floor: the least J that is more than rounding.
    """
    count = unknowns + 1
    if rows - count - 1 <= 0:
        return math.inf
    return _find_likelihood(objective, rows, floor) + 2.0 * count * rows / (rows - count - 1)


def find_bic(objective: float, rows: int, unknowns: int, floor: float = 0.0) -> float:
    """Return BIC; arguments as for `find_aicc`."""
    return _find_likelihood(objective, rows, floor) + (unknowns + 1) * math.log(rows)


def _find_likelihood(objective: float, rows: int, floor: float) -> float:
    return rows * math.log(max(objective, floor, 1e-300) / rows)
