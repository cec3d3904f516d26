"""Which method the data support: how well each foretells torques that its dynamics have not seen.

Candidates -> scores -> the best.

The yardstick is common to all and needs no spring: the sum of motor and link equations in a band (`band`), in
units of its noise. Each recording is cut into blocks of time; every fold leaves some of them out, the
dynamics are fitted to the rest, springs held as they are, and foretell the torques left out.

    score = mean of ((tau - Y chi) / sigma)^2 over all rows, each foretold by a fit without it

Noise blurs scores, most where motions tell a parameter badly. Of the methods whose score is not clearly above
the least one (two standard errors of the difference, found from blocks of time), the one with the smallest
standard deviations is taken.

The springs have seen all torques: a score speaks of dynamics. Those of the one-shot problem are moved by what
linear least squares with its springs make of the rows left out (`methods`).

Supported: methods whose dynamics are linear least squares once springs are known, and the one-shot problem.
Not supported: a choice among springs; those of the chosen method are taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.elastic.band import BandRows

__all__ = ["FOLDS", "Candidate", "Score", "choose_candidate", "find_folds"]

_BLOCKS = 8
_FINE = 50
_CLEAR = 2.0
FOLDS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A method to choose from.

    Args:
        name: of the method.
        refit: gives chi (p + n + pf,) fitted without the rows of one fold.
        spread: the largest relative standard deviation that it states.
    """

    name: str
    refit: Callable[[int], FloatArray]
    spread: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """The prediction error of a method in units of the noise; 1 is what noise alone would leave.

    `doubt` is the standard error of its distance from the least error, `spread` that of the candidate.
    """

    name: str
    error: float
    doubt: float
    spread: float

    def is_close(self, least: float) -> bool:
        """Return whether the error is not clearly above the least one."""
        return self.error - least <= _CLEAR * self.doubt


def find_folds(time: FloatArray) -> NDArray[np.intp]:
    """Return the fold (m,) of rows at `time` (m,), from 0 to 1 within their recording."""
    blocks = np.minimum((np.asarray(time) * _BLOCKS).astype(np.intp), _BLOCKS - 1)
    folds: NDArray[np.intp] = blocks % FOLDS
    return folds


def choose_candidate(
    candidates: Sequence[Candidate], rows: BandRows, scatter: FloatArray
) -> tuple[str, tuple[Score, ...]]:
    """Return the name of the best candidate, and all scores.

    Args:
        candidates: at least one, fitted without a fold on demand.
        rows: the common yardstick.
        scatter: (g,) of its groups, N m or N.
    """
    losses = np.stack([_find_losses(candidate, rows, scatter) for candidate in candidates])
    least = int(np.argmin(losses.mean(axis=1)))
    blocks = rows.group * _FINE + np.minimum((rows.time * _FINE).astype(np.intp), _FINE - 1)
    scores = tuple(
        Score(
            name=candidate.name,
            error=float(loss.mean()),
            doubt=float(np.linalg.norm(np.bincount(blocks, loss - losses[least])) / len(loss)),
            spread=candidate.spread,
        )
        for candidate, loss in zip(candidates, losses, strict=True)
    )
    close = [score for score in scores if score.is_close(scores[least].error)]
    return min(close, key=lambda score: score.spread).name, scores


def _find_losses(candidate: Candidate, rows: BandRows, scatter: FloatArray) -> FloatArray:
    """Return the squared prediction error of every row (m,) in units of the noise."""
    folds = find_folds(rows.time)
    losses = np.empty(len(rows.torque))
    for fold in range(FOLDS):
        held = folds == fold
        errors = rows.torque[held] - rows.design[held] @ candidate.refit(fold)
        losses[held] = (errors / scatter[rows.group[held]]) ** 2
    return losses
