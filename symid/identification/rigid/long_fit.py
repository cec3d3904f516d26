"""Fits of logs that are too long for memory: condensed block by block, residuals by a second pass.

RowBuilder, recordings, estimator -> `FittedRows`.

Supported: `ols` and `wls` on torque and momentum rows. Not supported: other estimators and rows.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice
from symid.identification.diagnostics import (
    warn_of_correlated_residuals,
)
from symid.identification.estimators import RegressionFit, fit_condensed
from symid.identification.regression import (
    LONG_KINDS,
    Identifiability,
    LongRows,
    RankRule,
    RowBuilder,
    Rows,
    StatesKeeper,
    analyse_condensed,
    check_identifiable_share,
    condense_recordings,
    mask_fast,
    predict_outlines,
    stack_rows,
)
from symid.logs import Recording


class FittedRows(NamedTuple):
    """Equations, what is identifiable from them, and their fit; notices on correlated residuals.

    `left` are all rows of a long log, slow ones too, and what the fit leaves of them; None in memory.
    """

    rows: Rows
    identifiability: Identifiability
    fit: RegressionFit
    pattern: tuple[Notice, ...] = ()
    left: tuple[Rows, FloatArray] | None = None


def is_long(builder: RowBuilder, recordings: Sequence[Recording], estimator: str, largest: float) -> bool:
    """Return whether the equations take more than `largest` bytes, and can be fitted block by block."""
    if builder.kind not in LONG_KINDS or estimator not in {"ols", "wls"}:
        return False
    card = builder.library.card
    width = 8.0 * card.size * (len(card.fitted) + 1)
    if builder.kind == "torque":
        count = sum(len(entry.time) for entry in recordings) / builder.processing.decimation.factor
    else:
        length = builder.window * (1.0 - builder.overlap)
        count = sum(len(entry.time) * entry.period for entry in recordings) / length
    return count * width > largest


def fit_long(
    builder: RowBuilder,
    recordings: Sequence[Recording],
    estimator: str,
    *,
    rule: RankRule,
    weights: Sequence[float] | None = None,
) -> FittedRows | None:
    """Return the fit of recordings whose matrix is never in memory; None where a joint has too few equations.

    `weights` are those of each recording's squared residuals; one if None.

    Raises:
        LogError, UsageError: as for `prepare_rows`.
        IdentifiabilityError: no parameter is identifiable.
    """
    builder = builder._replace(keeper=StatesKeeper())
    long = condense_recordings(builder, recordings, weights)
    if long is None:
        return None
    every = builder._replace(processing=replace(builder.processing, standstill=None))
    whole = stack_rows([every.outline(entry) for entry in recordings], weights)
    _, slow = mask_fast(whole, whole.velocity, builder.processing)
    rows = replace(long.outline, notices=(*whole.notices, *slow))
    condensed, freedom = long.condense(), builder.processing.noise_freedom
    identifiability = analyse_condensed(condensed, rows.kind, rows.names, rule)
    check_identifiable_share(identifiability, rows.names, rule.least, rows.notices)
    plain = None if estimator == "wls" else np.ones(len(condensed.counts))
    found = fit_condensed(condensed, identifiability.basis, plain, freedom)
    predicted, every_row = predict_outlines(every, recordings, (rows, whole), found.values)
    fit = RegressionFit(
        values=found.values,
        covariance=found.covariance,
        residuals=rows.values - predicted,
        spent=found.spent,
        condition=found.condition,
        weights=found.weights[rows.group] * np.sqrt(rows.weight),
    )
    sketch = long.sketch()
    blocks = _fit_sketch(sketch, fit.values, found.weights, identifiability)
    blocks = replace(blocks, covariance=fit.covariance)
    return FittedRows(
        rows=rows,
        identifiability=identifiability,
        fit=fit,
        pattern=warn_of_correlated_residuals(sketch, blocks, identifiability),
        left=(whole, whole.values - every_row),
    )


def compute_long_covariance(long: LongRows, groups: FloatArray, freedom: str) -> FloatArray:
    """Return the covariance (p, p) of the fit to all runs with weights (g,) of the joints, as `fit_weighted`.

    Raises:
        IdentifiabilityError: no parameter is identifiable.
    """
    condensed = long.condense()
    identifiability = analyse_condensed(condensed, long.outline.kind, long.outline.names)
    return fit_condensed(condensed, identifiability.basis, groups, freedom).covariance


def _fit_sketch(
    sketch: Rows, values: FloatArray, groups: FloatArray, identifiability: Identifiability
) -> RegressionFit:
    """Return a fit to a sketch that has the scores of all blocks."""
    return RegressionFit(
        values=values,
        covariance=np.zeros((len(values), len(values))),
        residuals=sketch.values - sketch.matrix @ values,
        spent=int(identifiability.basis.shape[1]),
        condition=1.0,
        weights=groups[sketch.group],
    )
