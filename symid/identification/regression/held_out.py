"""The choice among candidates by how well they predict held-out data.

    z_i = mean_b d_ib / (std_b d_ib / sqrt(blocks)),   d_ib = loss_ib - loss of the best on block b

Of all candidates whose z is within a margin, the one of least cost is taken (one-standard-error rule of
Breiman, Friedman, Olshen and Stone 1984, paired over the blocks).

Supported: any losses that add up over blocks of held-out data, such as squared errors.
Not supported: blocks whose errors depend on each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutChoice:
    """Indices of the best candidate and of the one taken; z (c,) of all candidates, in standard errors."""

    best: int
    taken: int
    behind: FloatArray


def choose_held_out(losses: FloatArray, costs: Sequence[float], margin: float = 1.0) -> HeldOutChoice:
    """Return the candidate of least cost among those within `margin` standard errors of the best.

    Args:
        losses: (c, blocks) of every candidate on every held-out block, two blocks or more.
        costs: one a candidate, such as the number of its unknowns; of equal ones the smaller loss decides.
        margin: in standard errors of the difference.
    """
    totals = losses.sum(axis=1)
    best = int(np.argmin(totals))
    behind = measure_behind(losses, best)
    close = np.flatnonzero(behind <= margin).tolist()
    taken = min(close, key=lambda index: (costs[index], totals[index]))
    return HeldOutChoice(best=best, taken=taken, behind=behind)


def measure_behind(losses: FloatArray, best: int) -> FloatArray:
    """Return z (c,) of losses (c, blocks) against candidate `best`: 0 where no worse, inf where always."""
    differences = losses - losses[best]
    means = differences.mean(axis=1)
    errors = differences.std(axis=1, ddof=1) / np.sqrt(losses.shape[1])
    behind: FloatArray = np.where(means > 0.0, np.inf, 0.0)
    np.divide(means, errors, out=behind, where=(means > 0.0) & (errors > 0.0))
    return behind
