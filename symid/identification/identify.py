"""Identification: recordings to parameters with their uncertainty.

Input: a library of generated robot functions, recordings, settings. Output: `Estimate`.

    Recording -> Signals -> Rows -> Identifiability -> Fit -> Estimate

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators.
Not supported: recordings with delays or zero offsets of their own.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from symid.codegen.functions import ParameterCard
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.identification.cutoff import choose_filters
from symid.identification.doubts import (
    warn_of_mass_matrix,
    warn_of_pattern,
    warn_of_processing,
)
from symid.identification.drift import warn_of_drift
from symid.identification.estimate import Estimate, Outcome, ParameterEstimate
from symid.identification.estimators import ESTIMATORS, EstimatorOptions, fit_rows
from symid.identification.identifiability import Identifiability, RankRule, find_identifiability
from symid.identification.preparation import prepare_rows
from symid.identification.regression import Fit
from symid.identification.rows import ROW_KINDS, WINDOW, Rows, stack_rows
from symid.identification.statistics import find_residuals
from symid.identification.structure import warn_of_structure
from symid.robot.log_map import Processing

__all__ = ["identify_parameters"]

_VAGUE_PERCENT = 30.0


class _RowOptions(NamedTuple):
    """Kind of rows, with length in s and overlap of their windows."""

    kind: str
    window: float
    overlap: float

    def prepare(self, library: Library, recording: Recording, processing: Processing) -> Rows:
        """Return the equations of a recording."""
        return prepare_rows(
            self.kind, library, recording, processing, window=self.window, overlap=self.overlap
        )

    def tell(self) -> dict[str, object]:
        """Return what a result says of the windows."""
        if self.kind in {"torque", "power"}:
            return {}
        shared: dict[str, object] = {"overlap": self.overlap} if self.overlap else {}
        return {"window": self.window, **shared}


def identify_parameters(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rows: str = "torque",
    estimator: str = "ols",
    window: float = WINDOW,
    overlap: float = 0.0,
    rule: RankRule | None = None,
    options: EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
) -> Estimate:
    """Return the parameters of the library's model that explain the recordings best.

    Args:
        library: the robot's functions; its model card names the parameters.
        recordings: at least one, all of one robot.
        processing: filter, cut ends and decimation.
        rows: one of `ROW_KINDS`.
        estimator: one of `ESTIMATORS`.
        window: length of the windows of momentum, filtered and energy rows in s.
        overlap: part of a window that the next one shares, of momentum and energy rows.
        rule: when a parameter counts as not seen.
        options: of the estimator.
        weights: what the squares of each recording's residuals count for; one if None.
        echo: further settings to keep with the result, such as the log's columns.

    Raises:
        UsageError: there is no such kind of rows or estimator, or no recording.
        LogError: a recording does not fit the robot.
        IdentifiabilityError: nothing can be learnt.
    """
    _check_call(recordings, rows, estimator)
    filters = choose_filters(processing, recordings)
    how = _RowOptions(kind=rows, window=window, overlap=overlap)
    stacked = stack_rows([how.prepare(library, entry, filters.processing) for entry in recordings], weights)
    seen = find_identifiability(stacked, rule)
    fit = fit_rows(estimator, stacked, seen, filters.processing.noise_freedom, options)
    parameters = _list_parameters(library.card.beta + library.card.friction, fit, seen)
    notices = (*filters.notices, *stacked.notices, *seen.notices, *fit.notices, *_warn_of_vague(parameters))
    return Estimate(
        robot=library.card.robot,
        signature=library.card.signature,
        rows=rows,
        estimator=estimator,
        friction=tuple(joint.friction for joint in library.card.joints),
        parameters=parameters,
        residual=find_residuals(stacked, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=Outcome.SOME_REFUSED if seen.refused else Outcome.SOLVED,
        samples=len(stacked.values),
        sources=tuple(recording.source for recording in recordings),
        settings=_echo({**(echo or {}), **_tell(fit, weights, filters.processing), **how.tell()}),
        refused=seen.refused,
        unresolved=_list_unresolved(stacked, fit, seen),
        covariance=_cut_covariance(fit, seen),
        notices=notices + _find_doubts(library, recordings, filters.processing, stacked, fit=fit, seen=seen),
    )


def _find_doubts(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    rows: Rows,
    *,
    fit: Fit,
    seen: Identifiability,
) -> tuple[Notice, ...]:
    """Return what speaks against the fit."""
    pattern = warn_of_pattern(rows, fit, seen)
    return (
        *warn_of_processing(processing, recordings),
        *pattern,
        *(warn_of_structure(fit.values, library, recordings, processing) if pattern else ()),
        *warn_of_drift(rows, fit, [recording.source for recording in recordings]),
        *(() if seen.refused else warn_of_mass_matrix(library, fit.values, recordings)),
    )


def _tell(fit: Fit, weights: Sequence[float] | None, processing: Processing) -> Mapping[str, object]:
    """Return the processing, what the estimator chose or paid, and the weights of the recordings, if any."""
    told: dict[str, object] = {"processing": asdict(processing)}
    told |= {"fit": dict(fit.report)} if fit.report else {}
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


def _warn_of_vague(parameters: tuple[ParameterEstimate, ...]) -> tuple[Notice, ...]:
    vague = [entry.name for entry in parameters if entry.relative_std_percent > _VAGUE_PERCENT]
    if not vague:
        return ()
    text = (
        f"known to no better than {_VAGUE_PERCENT:g} % (one standard deviation): {', '.join(vague)}; "
        "they matter little in this log, or a motion that excites them is missing"
    )
    return (Notice(code="identify.vague", text=text),)
