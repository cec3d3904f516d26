"""Identification of rigid robots: recordings to parameters with their uncertainty.

Library, recordings, settings -> `Estimate`;  options of the call, robot -> `EstimatorOptions`.

    Recording -> Signals -> Rows -> Identifiability -> RegressionFit -> Estimate

Logs that are too long for memory take two passes: matrices are condensed block by block for weights and
parameters, and the predicted torque gives the residuals.

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; `ols` and
`wls` on torque and momentum rows that do not fit into memory.
Not supported: recordings with delays or offsets of their own; other estimators beyond memory.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.diagnostics import (
    SingleLogFit,
    analyse_structure,
    compute_block_deviations,
    warn_of_correlated_residuals,
    warn_of_drift,
    warn_of_mass_matrix,
    warn_of_moving_ends,
    warn_of_poorly_identifiable,
    warn_of_processing,
    warn_of_stiction,
    warn_of_structure,
)
from symid.identification.estimators import (
    ESTIMATORS,
    Estimate,
    EstimatorOptions,
    Outcome,
    RegressionFit,
    build_bodies,
    build_prior_of_card,
    build_prior_of_estimate,
    compute_residuals,
    estimate_period_noise,
    fit_condensed,
    fit_rows,
    list_parameters,
)
from symid.identification.regression import (
    LONG_KINDS,
    ROW_KINDS,
    Identifiability,
    LongRows,
    RankRule,
    RowBuilder,
    Rows,
    analyse_condensed,
    analyse_identifiability,
    check_identifiable_share,
    choose_filters,
    choose_window,
    condense_recordings,
    predict_rows,
    stack_rows,
)
from symid.logs import Recording
from symid.robot import Processing, Robot, suggest_names


class FittedRows(NamedTuple):
    """Equations, what is identifiable from them, and their fit; notices on correlated residuals and drift."""

    rows: Rows
    identifiability: Identifiability
    fit: RegressionFit
    pattern: tuple[Notice, ...] = ()
    drift: tuple[Notice, ...] = ()


def is_long(builder: RowBuilder, recordings: Sequence[Recording], estimator: str, largest: float) -> bool:
    """Return whether the equations take more than `largest` bytes, and can be fitted block by block."""
    if builder.kind not in LONG_KINDS or estimator not in {"ols", "wls"}:
        return False
    card = builder.library.card
    width = 8.0 * card.size * (len(card.beta) + len(card.friction) + 1)
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
    long = condense_recordings(builder, recordings, weights)
    if long is None:
        return None
    rows, condensed, freedom = long.outline, long.condense(), builder.processing.noise_freedom
    identifiability = analyse_condensed(condensed, rows.kind, rows.names, rule)
    check_identifiable_share(identifiability, rows.names, rule.least, rows.notices)
    plain = None if estimator == "wls" else np.ones(len(condensed.counts))
    found = fit_condensed(condensed, identifiability.basis, plain, freedom)
    fit = RegressionFit(
        values=found.values,
        covariance=found.covariance,
        residuals=rows.values - predict_rows(builder, recordings, rows, found.values),
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
        drift=warn_of_drift(
            rows,
            fit,
            [entry.source for entry in recordings],
            freedom,
            fit_log=lambda run, groups: fit_run(long, run, groups, freedom),
        ),
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


def fit_run(long: LongRows, run: int, groups: FloatArray, freedom: str) -> SingleLogFit | None:
    """Return the fit to one run alone with weights (g,) of the joints; None if nothing is identifiable."""
    condensed = long.condense(run)
    try:
        identifiability = analyse_condensed(condensed, long.outline.kind, long.outline.names)
    except IdentifiabilityError:
        return None
    found = fit_condensed(condensed, identifiability.basis, groups, freedom)
    stated = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    sketch = long.sketch(run)
    fit = _fit_sketch(sketch, found.values, groups, identifiability)
    deviations = np.maximum(stated, compute_block_deviations(sketch, fit, identifiability))
    return SingleLogFit(found.values, deviations, identifiability)


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
        window: s, length of the windows of momentum, filtered and energy rows; None for the default.
        overlap: part of a window that the next one shares, of momentum and energy rows.
        rule: when a parameter counts as not identifiable.
        options: of the estimator.
        weights: of each recording's squared residuals; one if None.
        echo: further settings to keep with the result, such as the log's columns.
        largest: bytes; torque and momentum rows that take more are fitted by `ols` and `wls` block by block.

    Raises:
        UsageError: there is no such kind of rows or estimator, or no recording.
        LogError: a recording does not fit the robot.
        IdentifiabilityError: no parameter is identifiable.
    """
    notices = [
        *_list_unknown("rows", rows, ROW_KINDS),
        *_list_unknown("estimator", estimator, tuple(ESTIMATORS)),
    ]
    if not recordings:
        notices.append(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if notices:
        raise UsageError(*notices)
    filters = choose_filters(processing, recordings)
    used = filters.processing
    if window is None:
        window = choose_window(rows, used, recordings[0].period)
    builder = RowBuilder(rows, library, used, window, overlap)
    rule = rule or RankRule()
    fitted = None
    if is_long(builder, recordings, estimator, largest):
        fitted = fit_long(builder, recordings, estimator, rule=rule, weights=weights)
    if fitted is None:
        built = stack_rows([builder.prepare(entry) for entry in recordings], weights)
        identifiability = analyse_identifiability(built, rule)
        fit = fit_rows(estimator, built, identifiability, used.noise_freedom, options)
        pattern = warn_of_correlated_residuals(built, fit, identifiability)
        drift = warn_of_drift(built, fit, [entry.source for entry in recordings], used.noise_freedom)
        fitted = FittedRows(built, identifiability, fit, pattern, drift)
    windowed = rows not in {"torque", "power"}
    settings = {
        **(echo or {}),
        "processing": asdict(used),
        "sample_period": recordings[0].period,
        **({"chosen": list(processing.left_open)} if processing.left_open else {}),
        **({"fit": dict(fitted.fit.report)} if fitted.fit.report else {}),
        **({} if weights is None else {"weights": list(weights)}),
        **({"window": window} if windowed else {}),
        **({"overlap": overlap} if overlap and windowed else {}),
    }
    estimate = build_estimate(library.card, fitted, estimator, recordings, settings)
    values = fitted.fit.values
    impossible = () if fitted.identifiability.refused else warn_of_mass_matrix(library, values, recordings)
    warnings = [*warn_of_processing(used, recordings), *warn_of_moving_ends(used, recordings)]
    warnings += fitted.pattern
    if fitted.pattern:
        warnings += warn_of_structure(analyse_structure(values, library, recordings, used, weights=weights))
    warnings += (*warn_of_stiction(fitted.rows, fitted.fit, library), *fitted.drift, *impossible)
    return replace(estimate, notices=(*filters.notices, *estimate.notices, *warnings))


def build_estimate(
    card: ModelCard,
    fitted: FittedRows,
    estimator: str,
    recordings: Sequence[Recording],
    settings: Mapping[str, object],
) -> Estimate:
    """Return the estimate of fitted equations of the model of `card`, without warnings about the fit.

    `settings` are kept as JSON would give them back, so that a stored result equals its origin.
    """
    fit, identifiability, rows = fitted.fit, fitted.identifiability, fitted.rows
    identifiable = np.flatnonzero(identifiability.identifiable)
    # Refused parameters that act together with others have a value in the fit, those without effect do not.
    acting = np.flatnonzero(identifiability.basis.any(axis=1) & ~identifiability.identifiable)
    cards = card.beta + card.friction
    covariance = fit.covariance[np.ix_(identifiable, identifiable)]
    parameters = list_parameters([cards[k] for k in identifiable], fit.values[identifiable], covariance)
    return Estimate(
        robot=card.robot,
        signature=card.signature,
        rows=rows.kind,
        estimator=estimator,
        friction=tuple(joint.friction for joint in card.joints),
        parameters=parameters,
        residual=compute_residuals(rows, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=Outcome.SOME_REFUSED if identifiability.refused else Outcome.SOLVED,
        samples=len(rows.values),
        sources=tuple(recording.source for recording in recordings),
        settings=json.loads(json.dumps(settings)),
        refused=identifiability.refused,
        unresolved=tuple((rows.names[k], float(fit.values[k])) for k in acting),
        covariance=tuple(map(tuple, covariance.tolist())),
        notices=(
            *rows.notices,
            *identifiability.notices,
            *fit.notices,
            *warn_of_poorly_identifiable(parameters),
        ),
    )


def _list_unknown(what: str, name: str, allowed: Sequence[str], more: str = "") -> list[Notice]:
    """Return a notice where `name` is not allowed."""
    if name in allowed:
        return []
    hint = suggest_names(name, allowed)
    text = f"unknown {what} {name!r}: {f'{hint} ' if hint else ''}allowed are {', '.join(allowed)}{more}"
    return [Notice(code=f"usage.unknown-{what}", text=text)]


OUTPUT_ERROR, INSTRUMENTAL = "output-error", "instrumental"
SIMULATING = (OUTPUT_ERROR, INSTRUMENTAL)
"""Estimators that simulate the robot, see `closed_loop_estimate`."""
_WINDOWED = ("momentum", "filtered", "energy")
_OVERLAPPING = ("momentum", "energy")
_DEVIATION = 20.0
PRIOR_OF_ROBOT = "robot"
"""The prior that stands in the robot file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidOptions:
    """Options of rows and estimators; None, or nothing, where not given.

    Args:
        rows: how measurements become equations; torque by default.
        estimator: how equations become parameters; ols by default.
        window: s, the length of a momentum, filtered or energy row.
        overlap: part of a window that the next one shares.
        period: s, of the motion, once or once a log: noise is what differs between periods (gls).
        prior: an estimate, its file, or "robot" for the robot file's values (ridge).
        prior_deviation: percent of the robot file's values, or a factor on an estimate's deviations.
        prior_weight: 1 to take the stated deviations, 0 for no prior; None to choose it by cross validation.
        start: an estimate, or its file, that a simulating estimator begins with.
        partial: whether to fit what is identifiable where that is less than three quarters.
    """

    rows: str | None = None
    estimator: str | None = None
    window: float | None = None
    overlap: float | None = None
    period: tuple[float, ...] = ()
    prior: Estimate | Path | str | None = None
    prior_deviation: float | None = None
    prior_weight: float | None = None
    start: Estimate | Path | None = None
    partial: bool = False

    def list_given(self) -> tuple[str, ...]:
        """Return the options that were given, as the command line calls them, the windows' length apart."""
        order = ("rows", "estimator", "period", "overlap")
        names = dict.fromkeys((*order, *(entry.name for entry in fields(self) if entry.name != "window")))
        given = (name for name in names if getattr(self, name) not in (None, (), False))
        return tuple(f"--{name.replace('_', '-')}" for name in given)


def check_estimator(rows: str, estimator: str | None) -> None:
    """Refuse an estimator that no rows of a rigid robot know.

    Raises:
        UsageError: there is no such estimator; those of friction laws are others.
    """
    if estimator is None:
        return
    more = f" with {rows} rows; those of friction laws go with --rows friction"
    notices = _list_unknown("estimator", estimator, (*ESTIMATORS, *SIMULATING), more)
    if notices:
        raise UsageError(*notices)


def check_rigid_options(rows: str, estimator: str, options: RigidOptions) -> None:
    """Refuse options that rows or estimator do not use.

    Raises:
        UsageError: an option belongs to other rows or to another estimator, or is out of range.
    """
    ridge = (estimator == "ridge", "--estimator ridge")
    wanted = {
        "window": (rows in _WINDOWED, f"--rows {', '.join(_WINDOWED)}"),
        "overlap": (rows in _OVERLAPPING, f"--rows {' and '.join(_OVERLAPPING)}"),
        "period": (estimator == "gls", "--estimator gls and --rows friction"),
        **dict.fromkeys(("prior", "prior_deviation", "prior_weight"), ridge),
        "start": (estimator in SIMULATING, f"--estimator {' and '.join(SIMULATING)}"),
    }
    found = [
        ("mixed-options", f"--{name.replace('_', '-')} belongs to {owner}; leave it out, or choose these")
        for name, (fits, owner) in wanted.items()
        if getattr(options, name) not in (None, ()) and not fits
    ]
    deviation, weight = options.prior_deviation, options.prior_weight
    if deviation is not None and not 0.0 < deviation < math.inf:
        found.append(("prior", f"prior deviation {deviation:g}: must be a positive number"))
    if weight is not None and not 0.0 <= weight < math.inf:
        found.append(("prior", f"prior weight {weight:g}: must be 0 or a positive number"))
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} needs torque rows; leave --rows {rows} out"
        found.append(("mixed-options", text))
    if found:
        raise UsageError(*(Notice(code=f"usage.{code}", text=text) for code, text in found))


def build_estimator_options(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    estimator: str,
    options: RigidOptions,
    *,
    prior: Estimate | None = None,
) -> EstimatorOptions:
    """Return the options of an estimator; `prior` is of the same model, None for values of the robot file.

    Raises:
        UsageError: there is no prior, or the motion does not repeat.
    """
    if estimator == "ridge":
        deviation = options.prior_deviation
        known = (
            build_prior_of_card(library.card, (deviation or _DEVIATION) / 100.0)
            if prior is None
            else build_prior_of_estimate(prior, deviation or 1.0)
        )
        return EstimatorOptions(prior=known, prior_weight=options.prior_weight)
    if estimator == "consistent":
        return EstimatorOptions(bodies=build_bodies(robot))
    if estimator == "gls" and options.period:
        return EstimatorOptions(noise=estimate_period_noise(recordings, robot.processing, options.period))
    return EstimatorOptions()
