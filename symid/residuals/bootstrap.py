"""Deviations without assumptions on the noise: the block bootstrap.

Input: rows, their fit, what they can tell, a generator of random numbers. Output: `Bootstrap`.

Each log is cut into blocks of time; all joints of a block stay together. As many blocks as there are, drawn
with replacement, make a new log, and its fit another set of parameters (Kuensch 1989). What they scatter is
the deviation, whatever pattern the residual keeps within a block.

Supported: any number of logs; the weights are those of the fit.
Not supported: patterns longer than a block.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.estimators.regression import Fit
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["Bootstrap", "cut_blocks", "find_bootstrap"]

BLOCKS = 40
REPLICATES = 200
_SEEN = 1e-10
"""Singular value relative to the largest below which a drawn log does not tell a direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bootstrap:
    """What parameters scatter when blocks of the logs are drawn anew.

    Args:
        names: of the parameters with a value of their own.
        deviations: (k,) standard deviations; low, high: (k,) ends of the middle 95 %.
        blocks: of time; replicates: logs drawn.
    """

    names: tuple[str, ...]
    deviations: FloatArray
    low: FloatArray
    high: FloatArray
    blocks: int
    replicates: int

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("deviations", "low", "high"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def cut_blocks(rows: Rows, blocks: int) -> tuple[np.ndarray[tuple[int], np.dtype[np.intp]], int]:
    """Return the number of the block of each row (m,), and how many blocks there are.

    Blocks are stretches of time of equal length within a log; longer logs have more of them.
    """
    spans = [(float(rows.time[part].min()), float(rows.time[part].max())) for part in _list_runs(rows)]
    whole = sum(high - low for low, high in spans) or 1.0
    number = np.zeros(len(rows.values), dtype=np.intp)
    count = 0
    for part, (low, high) in zip(_list_runs(rows), spans, strict=True):
        pieces = max(1, round(blocks * (high - low) / whole))
        place = (rows.time[part] - low) / ((high - low) or 1.0) * pieces
        number[part] = count + np.minimum(place.astype(np.intp), pieces - 1)
        count += pieces
    return number, count


def _list_runs(rows: Rows) -> list[np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    return [rows.run == run for run in np.unique(rows.run)]


def find_bootstrap(
    rows: Rows,
    fit: Fit,
    seen: Identifiability,
    generator: np.random.Generator,
    *,
    blocks: int = BLOCKS,
    replicates: int = REPLICATES,
) -> Bootstrap:
    """Return the scatter of the parameters over logs drawn from blocks of the logs.

    Args:
        rows: the equations of the fit.
        fit: its result.
        seen: what the rows can tell.
        generator: of random numbers.
        blocks: of time, in all logs together.
        replicates: logs to draw.
    """
    number, count = cut_blocks(rows, blocks)
    stacked = np.column_stack([rows.matrix @ seen.basis, rows.values]) * fit.weights[:, None]
    factors = [np.linalg.qr(stacked[number == block], mode="r") for block in range(count)]
    drawn = np.empty((replicates, len(rows.names)))
    for index in range(replicates):
        times = np.bincount(generator.integers(count, size=count), minlength=count)
        parts = [np.sqrt(times[block]) * factors[block] for block in np.flatnonzero(times)]
        triangle: FloatArray = np.asarray(np.linalg.qr(np.vstack(parts), mode="r"))
        drawn[index] = seen.basis @ np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=_SEEN)[0]
    kept = drawn[:, seen.learnable]
    low, high = np.percentile(kept, [2.5, 97.5], axis=0)
    return Bootstrap(
        names=tuple(np.array(rows.names)[seen.learnable].tolist()),
        deviations=kept.std(axis=0, ddof=1),
        low=low,
        high=high,
        blocks=count,
        replicates=replicates,
    )
