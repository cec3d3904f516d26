"""Identification: recordings to parameters with their uncertainty.

Input: a library of generated robot functions, recordings, settings. Output: `Estimate`.

    Recording -> Signals -> Rows -> Identifiability -> Fit -> Estimate

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; recordings
whose rows do not go into memory.
Not supported: recordings with delays or zero offsets of their own.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate, Outcome, ParameterEstimate
from symid.estimators.estimators import ESTIMATORS, EstimatorOptions, fit_rows
from symid.estimators.regression import Fit
from symid.estimators.statistics import find_residuals
from symid.identification.fitted_processing import describe_processing
from symid.identification.long_fit import FittedRows, fit_long, is_long
from symid.residuals.doubts import (
    warn_of_mass_matrix,
    warn_of_pattern,
    warn_of_processing,
    warn_of_vague,
)
from symid.residuals.drift import warn_of_drift
from symid.residuals.moving_ends import warn_of_moving_ends
from symid.residuals.sticking import warn_of_sticking
from symid.residuals.structure import warn_of_structure
from symid.robot.log_map import Processing
from symid.rows.cutoff import choose_filters, choose_window
from symid.rows.identifiability import Identifiability, RankRule, find_identifiability
from symid.rows.long_rows import RowMaker
from symid.rows.rows import ROW_KINDS, Rows, stack_rows

__all__ = ["LARGEST", "identify_parameters"]

LARGEST = 2e8
"""Bytes of equations that are held in memory."""


def identify_parameters(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rows: str = "torque",
    estimator: str = "ols",
    window: float | None = None,
    overlap: float = 0.0,
    rule: RankRule | None = None,
    options: EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    largest: float = LARGEST,
) -> Estimate:
    """Return the parameters of the library's model that explain the recordings best.

    Args:
        library: the robot's functions; its model card names the parameters.
        recordings: at least one, all of one robot.
        processing: filter, cut ends and decimation.
        rows: one of `ROW_KINDS`.
        estimator: one of `ESTIMATORS`.
        window: length of the windows of momentum, filtered and energy rows in s; None for what
            `choose_window` chooses.
        overlap: part of a window that the next one shares, of momentum and energy rows.
        rule: when a parameter counts as not seen.
        options: of the estimator.
        weights: what the squares of each recording's residuals count for; one if None.
        echo: further settings to keep with the result, such as the log's columns.
        largest: bytes; torque and momentum rows that take more are fitted by `ols` and `wls` block by block.

    Raises:
        UsageError: there is no such kind of rows or estimator, or no recording.
        LogError: a recording does not fit the robot.
        IdentifiabilityError: nothing can be learnt.
    """
    _check_call(recordings, rows, estimator)
    filters = choose_filters(processing, recordings)
    if window is None:
        window = choose_window(rows, filters.processing, recordings[0].period)
    maker = RowMaker(rows, library, filters.processing, window, overlap)
    found = _fit(maker, recordings, estimator, rule=rule, options=options, weights=weights, largest=largest)
    settings = {
        **(echo or {}),
        **describe_processing(processing, filters.processing, recordings),
        **_tell(found.fit, weights),
        **_tell_windows(maker),
    }
    doubts = _find_doubts(maker, recordings, found, weights)
    estimate = _build_estimate(library.card, found, estimator, settings)
    return replace(
        estimate,
        sources=tuple(recording.source for recording in recordings),
        notices=(*filters.notices, *estimate.notices, *doubts),
    )


def _build_estimate(
    card: ModelCard, found: FittedRows, estimator: str, settings: Mapping[str, object]
) -> Estimate:
    fit, seen, rows = found.fit, found.seen, found.rows
    parameters = _list_parameters(card.beta + card.friction, fit, seen)
    return Estimate(
        robot=card.robot,
        signature=card.signature,
        rows=rows.kind,
        estimator=estimator,
        friction=tuple(joint.friction for joint in card.joints),
        parameters=parameters,
        residual=find_residuals(rows, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=Outcome.SOME_REFUSED if seen.refused else Outcome.SOLVED,
        samples=len(rows.values),
        sources=(),
        settings=_echo(settings),
        refused=seen.refused,
        unresolved=_list_unresolved(rows, fit, seen),
        covariance=_cut_covariance(fit, seen),
        notices=(*rows.notices, *seen.notices, *fit.notices, *warn_of_vague(parameters)),
    )


def _fit(
    maker: RowMaker,
    recordings: Sequence[Recording],
    estimator: str,
    *,
    rule: RankRule | None,
    options: EstimatorOptions | None,
    weights: Sequence[float] | None,
    largest: float,
) -> FittedRows:
    """Return equations and fit: block by block where the equations do not go into memory."""
    if is_long(maker, recordings, estimator, largest):
        found = fit_long(maker, recordings, estimator, rule=rule or RankRule(), weights=weights)
        if found is not None:
            return found
    stacked = stack_rows([maker.prepare(entry) for entry in recordings], weights)
    seen, freedom = find_identifiability(stacked, rule), maker.processing.noise_freedom
    fit = fit_rows(estimator, stacked, seen, freedom, options)
    return FittedRows(
        rows=stacked,
        seen=seen,
        fit=fit,
        pattern=warn_of_pattern(stacked, fit, seen),
        drift=warn_of_drift(stacked, fit, [entry.source for entry in recordings], freedom),
    )


def _find_doubts(
    maker: RowMaker, recordings: Sequence[Recording], found: FittedRows, weights: Sequence[float] | None
) -> tuple[Notice, ...]:
    """Return what speaks against the fit."""
    library, values = maker.library, found.fit.values
    structure: tuple[Notice, ...] = ()
    if found.pattern:
        structure = warn_of_structure(values, library, recordings, maker.processing, weights)
    return (
        *warn_of_processing(maker.processing, recordings),
        *warn_of_moving_ends(maker.processing, recordings),
        *found.pattern,
        *structure,
        *warn_of_sticking(found.rows, found.fit, library),
        *found.drift,
        *(() if found.seen.refused else warn_of_mass_matrix(library, values, recordings)),
    )


def _tell_windows(maker: RowMaker) -> Mapping[str, object]:
    """Return what a result says of the windows."""
    if maker.kind in {"torque", "power"}:
        return {}
    shared: dict[str, object] = {"overlap": maker.overlap} if maker.overlap else {}
    return {"window": maker.window, **shared}


def _tell(fit: Fit, weights: Sequence[float] | None) -> Mapping[str, object]:
    """Return what the estimator chose or paid, and the weights of the recordings, if any."""
    told: dict[str, object] = {"fit": dict(fit.report)} if fit.report else {}
    return told if weights is None else {**told, "weights": list(weights)}


def _echo(settings: Mapping[str, object]) -> Mapping[str, object]:
    """Return the settings as JSON would give them back, so that a stored result equals its origin."""
    plain: dict[str, object] = json.loads(json.dumps(settings))
    return plain


def _check_call(recordings: Sequence[Recording], rows: str, estimator: str) -> None:
    problems = []
    if rows not in ROW_KINDS:
        text = f"rows {rows!r}: there is no such kind; allowed are {', '.join(ROW_KINDS)}"
        problems.append(Notice(code="usage.unknown-rows", text=text))
    if estimator not in ESTIMATORS:
        text = f"estimator {estimator!r}: there is no such estimator; allowed are {', '.join(ESTIMATORS)}"
        problems.append(Notice(code="usage.unknown-estimator", text=text))
    if not recordings:
        problems.append(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if problems:
        raise UsageError(*problems)


def _list_parameters(
    cards: tuple[ParameterCard, ...], fit: Fit, seen: Identifiability
) -> tuple[ParameterEstimate, ...]:
    deviations = np.sqrt(np.diag(fit.covariance))
    return tuple(
        ParameterEstimate(
            name=card.name,
            value=float(fit.values[index]),
            std=float(deviations[index]),
            unit=card.unit,
            expression=card.expression,
            reason=card.reason,
            truth=card.value,
        )
        for index, card in enumerate(cards)
        if seen.learnable[index]
    )


def _list_unresolved(rows: Rows, fit: Fit, seen: Identifiability) -> tuple[tuple[str, float], ...]:
    """Return the values of refused parameters that act together with others, not of those without effect."""
    acting = seen.basis.any(axis=1) & ~seen.learnable
    return tuple((rows.names[k], float(fit.values[k])) for k in np.flatnonzero(acting))


def _cut_covariance(fit: Fit, seen: Identifiability) -> tuple[tuple[float, ...], ...]:
    kept = fit.covariance[np.ix_(seen.learnable, seen.learnable)]
    return tuple(tuple(map(float, row)) for row in kept)
