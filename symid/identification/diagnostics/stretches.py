"""Choice of a candidate on held-out blocks, until its last users have the judge."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray


class HeldOutChoice(NamedTuple):
    """Indices of the best candidate and of the one taken; z (c,) of all candidates, in standard errors."""

    best: int
    taken: int
    behind: FloatArray


def choose_held_out(losses: FloatArray, costs: Sequence[float], margin: float = 1.0) -> HeldOutChoice:
    """Return the candidate of least cost among those within `margin` standard errors of the best.

    `losses` (c, blocks) are those of every candidate on every held-out block, two blocks or more; of equal
    `costs` (c,), such as the number of unknowns, the smaller loss decides.
    """
    totals = losses.sum(axis=1)
    best = int(np.argmin(totals))
    behind = measure_behind(losses, best)
    close = np.flatnonzero(behind <= margin).tolist()
    taken = min(close, key=lambda index: (costs[index], totals[index]))
    return HeldOutChoice(best, taken, behind)


def measure_behind(losses: FloatArray, best: int) -> FloatArray:
    """Return z (c,) of losses (c, blocks) against candidate `best`: 0 where no worse, inf where always."""
    differences = losses - losses[best]
    means = differences.mean(axis=1)
    errors = differences.std(axis=1, ddof=1) / np.sqrt(losses.shape[1])
    behind: FloatArray = np.where(means > 0.0, np.inf, 0.0)
    np.divide(means, errors, out=behind, where=(means > 0.0) & (errors > 0.0))
    return behind
