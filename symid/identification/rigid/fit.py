"""Identification of rigid robots: recordings to parameters with their uncertainty.

Library, recordings, settings -> `Estimate`.

    Recording -> FitPlan -> Rows -> Identifiability -> RegressionFit -> Evidence -> Estimate

Logs that are too long for memory are condensed block by block, and a second pass finds their residuals.
Standard deviations hold for residuals that are correlated in time and between joints; an estimator other
than ols, wls and instruments keeps its own, times what correlation adds to those of wls.

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; `ols` and
`wls` on torque and momentum rows that do not fit into memory.
Not supported: recordings with delays or offsets of their own; other estimators beyond memory.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.diagnostics import (
    Stretches,
    compute_jackknife,
    fit_stretches,
    warn_of_correlated_residuals,
    warn_of_mass_matrix,
    warn_of_missing,
    warn_of_moving_ends,
    warn_of_poorly_identifiable,
    warn_of_processing,
)
from symid.identification.estimators import (
    ESTIMATORS,
    Estimate,
    EstimatorOptions,
    Influence,
    Outcome,
    RegressionFit,
    Residual,
    compute_coloured_covariance,
    compute_residuals,
    estimate_group_weights,
    fit_condensed,
    fit_instruments,
    fit_rows,
    fit_weighted,
    list_parameters,
    measure_influence,
)
from symid.identification.regression import (
    LONG_KINDS,
    ROW_KINDS,
    SCALAR_KINDS,
    WINDOW,
    Identifiability,
    LongRows,
    RankRule,
    RowBuilder,
    Rows,
    StatesKeeper,
    analyse_condensed,
    analyse_identifiability,
    check_identifiable_share,
    choose_window,
    condense_recordings,
    mask_fast,
    predict_outlines,
    select_rows,
    stack_rows,
)
from symid.identification.rigid.evidence import FittedRows, JudgedRows, collect_evidence, describe_motion
from symid.identification.rigid.plan import (
    FILTERED_INSTRUMENTAL,
    FitBasis,
    FitPlan,
    drop_instruments,
    list_unknown,
    plan_fit,
)
from symid.identification.rigid.settings_choice import ROW_RATE
from symid.logs import Recording, choose_processing
from symid.robot import Processing

LARGEST = 2e8
"""Bytes of equations that are held in memory."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FullFit:
    """A fit, all rows whether it has them or not, fits without each stretch, rows of the instruments."""

    fitted: FittedRows
    judged: JudgedRows
    stretches: Stretches
    instruments: Rows | None = None


def identify_parameters(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rows: str = "torque",
    estimator: str | None = None,
    window: float | None = None,
    overlap: float = 0.0,
    rule: RankRule | None = None,
    options: EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    largest: float = LARGEST,
    plan: FitPlan | None = None,
) -> Estimate:
    """Return the parameters of the library's model that explain the recordings best.

    Args:
        library: the robot's functions; its model card names the parameters.
        recordings: at least one, all of one robot.
        processing: filter, cut ends and decimation; what it leaves open is chosen, see `plan_fit`.
        rows: one of `ROW_KINDS`.
        estimator: one of `ESTIMATORS`, or "filtered-instrumental"; None to choose it.
        window: s, length of the windows of momentum, filtered and energy rows; None for the default.
        overlap: part of a window that the next one shares, of momentum and energy rows.
        rule: when a parameter counts as not identifiable.
        options: of the estimator.
        weights: of each recording's squared residuals; one if None.
        echo: further settings to keep with the result, such as the log's columns.
        plan: settings and estimator, where they were chosen before.
        largest: bytes; torque and momentum rows that take more are fitted by `ols` and `wls` block by block.

    Raises:
        UsageError: there is no such kind of rows or estimator, or no recording.
        LogError: a recording does not fit the robot.
        IdentifiabilityError: no parameter is identifiable.
    """
    _check_call(rows, estimator, recordings)
    # As many rows as can be chosen at most.
    thinned = choose_processing(processing, recordings[0].period, ROW_RATE)
    usual = RowBuilder(rows, library, thinned, window or WINDOW, overlap)
    long = is_long(usual, recordings, estimator or "wls", largest)
    plan = plan or plan_fit(library, recordings, processing, rows=rows, estimator=estimator, long=long)
    used, rule = plan.processing, rule or RankRule()
    chosen = plan.choice is not None
    window = window or choose_window(rows, used, recordings[0].period, chosen=chosen)
    builder = RowBuilder(rows, library, used, window, overlap)
    full, fitted = None, None
    if is_long(builder, recordings, plan.estimator, largest):
        fitted = fit_long(builder, recordings, plan.estimator, rule=rule, weights=weights)
    if fitted is None:
        try:
            full = fit_in_memory(builder, recordings, plan, rule=rule, options=options, weights=weights)
        except IdentifiabilityError:
            if estimator is not None or plan.estimator != FILTERED_INSTRUMENTAL:
                raise
            # Instruments that were chosen fail where a joint is explained to the last bit.
            plan = drop_instruments(plan, library)
            used, builder = plan.processing, builder._replace(processing=plan.processing)
            full = fit_in_memory(builder, recordings, plan, rule=rule, options=options, weights=weights)
        fitted = full.fitted
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
    estimate = build_estimate(library.card, fitted, plan.estimator, recordings, settings)
    notices = [*plan.notices, *estimate.notices, *fitted.pattern]
    if plan.choice is None:
        notices += warn_of_processing(used, recordings)
    if not processing.automatic:
        notices += warn_of_moving_ends(used, recordings)
    if full is None or rows in SCALAR_KINDS:
        if not fitted.identifiability.refused:
            notices += warn_of_mass_matrix(library, fitted.fit.values, recordings)
        residual = _measure_all(fitted.left, estimate)
        return replace(estimate, choice=plan.choice, residual=residual, notices=tuple(notices))
    basis = FitBasis(library, recordings, plan, full.instruments)
    evidence = collect_evidence(basis, full.judged, fitted, full.stretches)
    return replace(
        estimate,
        choice=plan.choice,
        evidence=evidence,
        residual=_measure_all((full.judged.rows, full.judged.residuals), estimate),
        notices=(*notices, *warn_of_missing(evidence), *describe_motion(evidence)),
    )


def _check_call(rows: str, estimator: str | None, recordings: Sequence[Recording]) -> None:
    """Refuse unknown rows and estimators, and no recording."""
    notices = list_unknown("rows", rows, ROW_KINDS)
    if estimator is not None:
        notices += list_unknown("estimator", estimator, (*ESTIMATORS, FILTERED_INSTRUMENTAL))
    if not recordings:
        notices.append(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if notices:
        raise UsageError(*notices)


def _measure_all(left: tuple[Rows, FloatArray] | None, estimate: Estimate) -> tuple[Residual, ...]:
    """Return the residuals of all rows, slow ones too, with the scatter of those in the fit."""
    if left is None:
        return estimate.residual
    scatter = {entry.joint: entry.std for entry in estimate.residual}
    whole = compute_residuals(*left, 0)
    return tuple(replace(entry, std=scatter.get(entry.joint, entry.std)) for entry in whole)


def fit_in_memory(
    builder: RowBuilder,
    recordings: Sequence[Recording],
    plan: FitPlan,
    *,
    rule: RankRule,
    options: EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
) -> FullFit:
    """Return the fit of recordings whose equations are all in memory; `weights` as for `stack_rows`.

    Raises:
        LogError, UsageError: as for `prepare_rows`.
        IdentifiabilityError: no parameter is identifiable.
    """
    used = plan.processing
    moving = builder._replace(processing=replace(used, standstill=None))
    whole = stack_rows([moving.prepare(entry) for entry in recordings], weights)
    instruments, speed = None, whole.velocity
    if plan.estimator == FILTERED_INSTRUMENTAL:
        settings = replace(moving.processing, filter_cutoff=used.instrument_cutoff)
        smooth = moving._replace(processing=settings)
        instruments = stack_rows([smooth.prepare(entry) for entry in recordings], weights)
        speed = instruments.velocity
    elif plan.choice is not None and builder.kind not in SCALAR_KINDS:
        cutoff = min(plan.choice.scoring, used.filter_cutoff or plan.choice.scoring)
        smooth = moving._replace(processing=replace(moving.processing, filter_cutoff=cutoff))
        speed = stack_rows([smooth.outline(entry) for entry in recordings]).velocity
    kept, slow = mask_fast(whole, speed, used, margin=plan.margin)
    built = replace(select_rows(whole, kept), notices=(*whole.notices, *slow))
    freedom = used.noise_freedom
    if instruments is None:
        identifiability = analyse_identifiability(built, rule)
        fit = fit_rows(plan.estimator, built, identifiability, freedom, options)
        influence = measure_influence(built, identifiability.basis, fit.weights, fit.residuals)
    else:
        found = fit_instruments(built, select_rows(instruments, kept), rule, freedom, simulated=False)
        fit, identifiability = found.fit, found.identifiability
        influence = Influence(
            left=found.gain, scores=found.frame, frame=found.frame, residuals=fit.residuals * fit.weights
        )
    pattern: tuple[Notice, ...] = ()
    stretches = fit_stretches(whole, instruments, kept, _average_weights(built, fit))
    if builder.kind not in SCALAR_KINDS and freedom == "band":
        covariance = compute_coloured_covariance(built, influence)
        covariance = _widen(covariance, compute_jackknife(stretches.folds))
        fit = replace(fit, covariance=_colour(plan.estimator, built, identifiability, fit, covariance))
    else:
        pattern = warn_of_correlated_residuals(built, fit, identifiability)
    fitted = FittedRows(built, identifiability, fit, pattern)
    residuals = whole.values - whole.matrix @ fit.values
    judged = JudgedRows(rows=whole, speed=speed, kept=kept, residuals=residuals, smooth=instruments)
    return FullFit(fitted=fitted, judged=judged, stretches=stretches, instruments=instruments)


def _average_weights(rows: Rows, fit: RegressionFit) -> FloatArray:
    """Return what the squared residuals of each joint count for in a fit: (g,)."""
    found = np.ones(len(rows.group_names))
    for group in np.unique(rows.group):
        own = rows.group == group
        found[group] = np.median(fit.weights[own] ** 2 / rows.weight[own])
    return found


def _widen(covariance: FloatArray, jackknife: FloatArray) -> FloatArray:
    """Return a covariance (p, p) with a third of each variance from the jackknife (p,), where that is larger.

    The jackknife holds for errors of the model, which follow the motion, but from a few stretches it is
    uncertain by half: a third of it lets intervals of right models cover 92 to 98 %.
    """
    own = np.diag(covariance)
    known = own > 0.0
    ratio = np.where(known, jackknife / np.where(known, own, 1.0), 1.0)
    factor = np.sqrt(np.maximum(1.0, (2.0 + ratio) / 3.0))
    return np.asarray(covariance * factor * factor[:, None])


def _colour(
    estimator: str,
    rows: Rows,
    identifiability: Identifiability,
    fit: RegressionFit,
    covariance: FloatArray,
) -> FloatArray:
    """Return the covariance (p, p) of a fit for coloured residuals; `covariance` is that of its influence.

    Estimators other than least squares keep theirs, each deviation times what colour adds to that of wls.
    """
    if estimator in {"ols", "wls", FILTERED_INSTRUMENTAL}:
        return covariance
    plain = fit_weighted(rows, identifiability, estimate_group_weights(rows, identifiability))
    influence = measure_influence(rows, identifiability.basis, plain.weights, plain.residuals)
    coloured = np.diag(compute_coloured_covariance(rows, influence))
    white = np.diag(plain.covariance)
    ratio = np.sqrt(np.maximum(np.where(white > 0.0, coloured / np.where(white > 0.0, white, 1.0), 1.0), 1.0))
    return np.asarray(fit.covariance * ratio * ratio[:, None])


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
    cards, values = card.fitted, fit.values.copy()
    # Shape values are fitted as a change of those that the fit began with.
    values[len(values) - len(card.searched) :] += [entry.value or 0.0 for entry in card.searched]
    covariance = fit.covariance[np.ix_(identifiable, identifiable)]
    known = [replace(cards[k], value=None) if cards[k] in card.searched else cards[k] for k in identifiable]
    parameters = list_parameters(known, values[identifiable], covariance)
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
