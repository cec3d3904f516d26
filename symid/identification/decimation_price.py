"""What decimation costs or gains: stated deviations, and what is left of held-out stretches of time.

Input: a maker of torque rows, recordings, weights of joints. Output: `DecimationPrice`.

The same logs are fitted twice: to the rows that decimation keeps, and to every sample. Stated deviations of
both suppose white noise. Which fit is the better one, held-out data say: each fifth of the time is foretold
by fits to the others, and what both leave of its decimated rows is compared.

Supported: any number of logs, of any length.
Not supported: kinds of rows that are not decimated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.data.recording import Recording
from symid.identification.long_fit import find_long_covariance
from symid.robot.log_map import Decimation
from symid.rows.identifiability import Identifiability
from symid.rows.long_rows import LongRows, RowMaker, condense_recordings

__all__ = ["DecimationPrice", "find_decimation_price"]

_FOLDS = 5
_SEEN = 1e-10
"""Singular value relative to the largest below which the other folds do not tell a direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecimationPrice:
    """In percent, by how much the fit to decimated rows is above that to every sample.

    `deviations` is the median of stated deviations, `held_out` the weighted residual of what was held out.
    """

    deviations: float
    held_out: float


def find_decimation_price(
    maker: RowMaker,
    recordings: Sequence[Recording],
    seen: Identifiability,
    groups: FloatArray,
    weights: Sequence[float] | None = None,
) -> DecimationPrice | None:
    """Return the price of decimation; None where there is none, or too few rows to tell.

    Args:
        maker: of torque rows; its processing says how they are decimated.
        recordings: of the fit.
        seen: what they can tell.
        groups: weights (g,) of the joints.
        weights: what the squares of each recording's residuals count for; one if None.
    """
    if maker.kind != "torque" or maker.processing.decimation.factor == 1:
        return None
    every = maker._replace(processing=replace(maker.processing, decimation=Decimation()))
    some, full = (condense_recordings(entry, recordings, weights) for entry in (maker, every))
    if some is None or full is None:
        return None
    freedom = maker.processing.noise_freedom
    ours, theirs = (
        np.sqrt(np.maximum(np.diag(find_long_covariance(entry, groups, freedom)), 0.0))
        for entry in (some, full)
    )
    both = (ours > 0.0) & (theirs > 0.0)
    if not both.any():
        return None
    return DecimationPrice(
        deviations=100.0 * (float(np.median(ours[both] / theirs[both])) - 1.0),
        held_out=_compare(some, full, seen, groups),
    )


def _compare(some: LongRows, full: LongRows, seen: Identifiability, groups: FloatArray) -> float:
    """Return by how much more the fit to some of the rows leaves of held-out ones of them, in percent."""
    judged, number = _weigh(some, seen, groups)
    others, place = _weigh(full, seen, groups)
    left = np.zeros(2)
    for fold in range(_FOLDS):
        held = judged[number == fold]
        for index, table in enumerate((judged[number != fold], others[place != fold])):
            values = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=_SEEN)[0]
            left[index] += float(np.sum((held[:, -1] - held[:, :-1] @ values) ** 2))
    return 100.0 * (float(np.sqrt(left[0] / left[1])) - 1.0) if left[1] else 0.0


def _weigh(long: LongRows, seen: Identifiability, groups: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return weighted rows [A B, y] with the squares of all equations, and the fifth of time of each."""
    sketch, fold = long.sketch(), np.zeros(0, dtype=np.intp)
    for group in np.unique(sketch.group):
        count = int(np.sum(sketch.group == group))
        fold = np.concatenate([fold, np.arange(count) * _FOLDS // count])
    table = np.column_stack([sketch.matrix @ seen.basis, sketch.values]) * groups[sketch.group][:, None]
    return table, fold
