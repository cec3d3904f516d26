"""Least squares on logs that are too long for memory, with all that a fit in memory says.

Input: a maker of rows, recordings. Output: `FittedRows`, as of rows in memory.

    first pass    matrices are condensed block by block (`long_rows`), weights and parameters found
    second pass   residuals, from the torque that the parameters foretell

Supported: `ols` and `wls` on torque and momentum rows.
Not supported: estimators that ask for every row of the matrix.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.data.recording import Recording
from symid.errors import IdentifiabilityError, Notice
from symid.estimators.condensed_fit import find_weights
from symid.estimators.regression import Fit
from symid.residuals.doubts import find_block_deviations, warn_of_pattern
from symid.residuals.drift import LogFit, warn_of_drift
from symid.rows.condensation import (
    Condensed,
    CondensedSolution,
    find_square_sums,
    solve_condensed,
)
from symid.rows.identifiability import Identifiability, RankRule, check_share, judge_condensed
from symid.rows.long_rows import (
    LONG_KINDS,
    LongRows,
    RowMaker,
    condense_recordings,
    predict_rows,
)
from symid.rows.rows import Rows

__all__ = ["LONG_ESTIMATORS", "FittedRows", "find_long_covariance", "fit_long", "fit_run", "is_long"]

LONG_ESTIMATORS = ("ols", "wls")


class FittedRows(NamedTuple):
    """Equations, what they can tell, and their fit; notices on patterns of the residual and on drift."""

    rows: Rows
    seen: Identifiability
    fit: Fit
    pattern: tuple[Notice, ...]
    drift: tuple[Notice, ...]


def is_long(maker: RowMaker, recordings: Sequence[Recording], estimator: str, largest: float) -> bool:
    """Return whether the equations take more than `largest` bytes, and can be fitted block by block."""
    if maker.kind not in LONG_KINDS or estimator not in LONG_ESTIMATORS:
        return False
    card = maker.library.card
    width = 8.0 * card.size * (len(card.beta) + len(card.friction) + 1)
    if maker.kind == "torque":
        count = sum(len(entry.time) for entry in recordings) / maker.processing.decimation.factor
    else:
        length = maker.window * (1.0 - maker.overlap)
        count = sum(len(entry.time) * entry.period for entry in recordings) / length
    return count * width > largest


def fit_long(
    maker: RowMaker,
    recordings: Sequence[Recording],
    estimator: str,
    *,
    rule: RankRule,
    weights: Sequence[float] | None = None,
) -> FittedRows | None:
    """Return the fit of recordings whose matrix is never in memory; None where a joint has too few equations.

    Args:
        maker: of equations.
        recordings: all of one robot.
        estimator: one of `LONG_ESTIMATORS`.
        rule: when a parameter counts as not seen.
        weights: what the squares of each recording's residuals count for; one if None.

    Raises:
        LogError, UsageError: as for `prepare_rows`.
        IdentifiabilityError: nothing can be learnt.
    """
    long = condense_recordings(maker, recordings, weights)
    if long is None:
        return None
    rows, condensed, freedom = long.outline, long.condense(), maker.processing.noise_freedom
    seen = judge_condensed(condensed, rows.kind, rows.names, rule)
    check_share(seen, rows.names, rule.least, rows.notices)
    used = _count_used(int(seen.basis.shape[1]), freedom)
    groups = np.ones(len(condensed.counts))
    if estimator == "wls":
        groups = find_weights(condensed, seen.basis, used)
    found = solve_condensed(condensed, seen.basis, groups)
    residuals = rows.values - predict_rows(maker, recordings, rows, found.values)
    factors = groups[rows.group] * np.sqrt(rows.weight)
    fit = Fit(
        values=found.values,
        covariance=_find_covariance(condensed, found, groups, freedom),
        residuals=residuals,
        spent=used,
        condition=found.condition,
        weights=factors,
    )
    return FittedRows(
        rows=rows,
        seen=seen,
        fit=fit,
        pattern=_warn_of_pattern(long, fit, seen, groups),
        drift=warn_of_drift(
            rows,
            fit,
            [entry.source for entry in recordings],
            freedom,
            fit_log=lambda run, weights: fit_run(long, run, weights, freedom),
        ),
    )


def find_long_covariance(long: LongRows, groups: FloatArray, freedom: str) -> FloatArray:
    """Return the covariance (p, p) of the weighted fit, as `fit_weighted` has it.

    Args:
        long: the equations of all runs.
        groups: weights (g,) of the joints.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.

    Raises:
        IdentifiabilityError: nothing can be learnt.
    """
    condensed = long.condense()
    seen = judge_condensed(condensed, long.outline.kind, long.outline.names)
    return _find_covariance(condensed, solve_condensed(condensed, seen.basis, groups), groups, freedom)


def _count_used(rank: int, freedom: str) -> int:
    return 1 if freedom == "one" else rank


def _find_covariance(
    condensed: Condensed, found: CondensedSolution, groups: FloatArray, freedom: str
) -> FloatArray:
    independent = condensed.independent if freedom == "band" else 1.0
    square = float(find_square_sums(condensed, found.values) @ groups**2)
    used = _count_used(int(found.root.shape[1]), freedom)
    variance = square / (independent * int(condensed.counts.sum()) - used)
    covariance: FloatArray = variance * (found.root @ found.root.T)
    return covariance


def _fit_sketch(sketch: Rows, values: FloatArray, groups: FloatArray, seen: Identifiability) -> Fit:
    """Return a fit to a sketch that has the scores of all blocks."""
    return Fit(
        values=values,
        covariance=np.zeros((len(values), len(values))),
        residuals=sketch.values - sketch.matrix @ values,
        spent=int(seen.basis.shape[1]),
        condition=1.0,
        weights=groups[sketch.group],
    )


def _warn_of_pattern(
    long: LongRows, fit: Fit, seen: Identifiability, groups: FloatArray
) -> tuple[Notice, ...]:
    sketch = long.sketch()
    blocks = _fit_sketch(sketch, fit.values, groups, seen)
    return warn_of_pattern(sketch, replace(blocks, covariance=fit.covariance), seen)


def fit_run(long: LongRows, run: int, groups: FloatArray, freedom: str) -> LogFit | None:
    """Return what one run tells alone, as `drift` has it of rows in memory; None where that is nothing.

    Args:
        long: the equations of all runs.
        run: number of the run.
        groups: weights (g,) of the joints.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    condensed = long.condense(run)
    try:
        seen = judge_condensed(condensed, long.outline.kind, long.outline.names)
    except IdentifiabilityError:
        return None
    found = solve_condensed(condensed, seen.basis, groups)
    stated = np.sqrt(np.maximum(np.diag(_find_covariance(condensed, found, groups, freedom)), 0.0))
    sketch = long.sketch(run)
    blocks = find_block_deviations(sketch, _fit_sketch(sketch, found.values, groups, seen), seen)
    return LogFit(found.values, np.maximum(stated, blocks), seen)
