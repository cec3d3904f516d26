"""Identification of rigid robots: recordings to parameters with their uncertainty, and what speaks for them.

    Recording -> FitPlan -> Rows -> Identifiability -> RegressionFit -> Evidence -> Estimate

Logs that are too long for memory are condensed part by part; triangles give their residuals, too.
Standard deviations hold for residuals that are correlated in time and between joints; an estimator other
than ols, wls and instruments keeps its own, times what correlation adds to those of wls.

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; `ols` and
`wls` on torque and momentum rows that do not fit into memory.
Not supported: recordings with delays or offsets of their own; other estimators beyond memory; errors of a
friction law where slow rows contradict it, in logs beyond memory.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification import diagnostics, estimators, judge, regression
from symid.identification.judge import numerics
from symid.identification.rigid.evidence import collect_evidence
from symid.identification.rigid.friction_choice import measure_law_errors
from symid.identification.rigid.plan import FILTERED_INSTRUMENTAL, FitPlan, list_unknown, plan_fit
from symid.joint_models import NO_FRICTION
from symid.logs import Recording, choose_processing, mask_states
from symid.notation import MOUNTING
from symid.robot import Processing, Robot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedRows:
    """Equations of a fit, what is identifiable from them, the fit, and notices on correlated residuals.

    `samples` of the equations, which a long log does not keep; `residual` what the fit leaves of them, and
    `every` of all, slow ones too.
    """

    rows: regression.Rows
    identifiability: regression.Identifiability
    fit: estimators.RegressionFit
    pattern: tuple[Notice, ...] = ()
    samples: int
    residual: tuple[estimators.Residual, ...]
    every: tuple[estimators.Residual, ...]


def identify_parameters(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rows: str = "torque",
    estimator: str | None = None,
    window: float | None = None,
    overlap: float = 0.0,
    rule: regression.RankRule | None = None,
    options: Mapping[str, Any] | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    largest: float = numerics.LARGEST,
    plan: FitPlan | None = None,
    robot: Robot | None = None,
) -> estimators.Estimate:
    """Return the parameters of the library's model that explain the recordings best.

    Args:
        library: the robot's functions.
        recordings: at least one, all of one robot.
        processing: filter, cut ends and decimation; what it leaves open is chosen, see `plan_fit`.
        rows: one of `ROW_KINDS`.
        estimator: one of `ESTIMATORS`, or "filtered-instrumental"; None to choose it.
        window: s, length of the windows of momentum, filtered and energy rows; None for the default.
        overlap: part of a window that the next one shares, of momentum and energy rows.
        rule: when a parameter counts as not identifiable.
        options: of the estimator, see `ESTIMATORS`.
        weights: of each recording's squared residuals; one if None.
        echo: further settings to keep with the result, such as the log's columns.
        plan: settings and estimator, where they were chosen before.
        robot: behind the library, for causes that need its geometry; None without.
        largest: bytes; torque and momentum rows that take more are fitted by `ols` and `wls` block by block.
    """
    notices = list_unknown("rows", rows, regression.ROW_KINDS)
    if estimator is not None:
        notices += list_unknown("estimator", estimator, (*estimators.ESTIMATORS, FILTERED_INSTRUMENTAL))
    if not recordings:
        notices.append(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if notices:
        raise UsageError(*notices)
    # As many rows as can be chosen at most.
    thinned = choose_processing(processing, recordings[0].period, regression.condensing.ROW_RATE)
    builder = regression.RowBuilder(rows, library, thinned, window or regression.WINDOW, overlap)
    long = is_long(builder, recordings, estimator or "wls", largest)
    plan = plan or plan_fit(library, recordings, processing, rows=rows, estimator=estimator, long=long)
    used, rule = plan.processing, rule or regression.RankRule()
    chosen = plan.study is not None and bool(processing.left_open)
    window = window or regression.choose_window(rows, used, recordings[0].period, chosen=chosen)
    builder = regression.RowBuilder(rows, library, used, window, overlap)
    recordings = [replace(recording, bad=mask_states(recording, used)) for recording in recordings]
    fitted = None
    if is_long(builder, recordings, plan.estimator, largest):
        fitted = fit_long(builder, recordings, plan.estimator, rule=rule, weights=weights)
    condensed = fitted is not None
    if fitted is None:
        fit = partial(fit_in_memory, builder, recordings, rule=rule, options=options, weights=weights)
        try:
            fitted = fit(plan)
        except IdentifiabilityError:
            if estimator is not None or plan.estimator != FILTERED_INSTRUMENTAL:
                raise
            # Instruments that were chosen fail where a joint is explained to the last bit.
            usual = "wls" if library.card.size > 1 else "ols"
            text = f"the instruments do not determine all parameters, so that the estimator is {usual} "
            text += "instead"
            note = Notice(code="identify.automatic", text=text)
            used = replace(used, instrument_cutoff=None)
            plan = replace(plan, processing=used, estimator=usual, notices=(*plan.notices, note))
            fitted = fit(plan)
    law_notices: tuple[Notice, ...] = ()
    if chosen and "standstill" in processing.left_open and not condensed:
        slow = [used.get_standstill(joint) > 0.0 for joint in range(library.card.size)]
        errors, law_notices = measure_law_errors(library, recordings, used, slow, fitted.fit.values)
        wider = fitted.fit.covariance + errors.T @ errors
        fitted = replace(fitted, fit=replace(fitted.fit, covariance=wider))
    settings = {**(echo or {}), "processing": asdict(used), "sample_period": recordings[0].period}
    windowed = rows not in {"torque", "power"}
    further = {
        "chosen": list(processing.left_open),
        "fit": dict(fitted.fit.report),
        "weights": list(weights or ()),
        "window": window if windowed else 0.0,
        "overlap": overlap if windowed else 0.0,
    }
    settings |= {key: entry for key, entry in further.items() if entry}
    estimate = build_estimate(
        library.card,
        fitted.rows,
        fitted.identifiability,
        fitted.fit,
        estimator=plan.estimator,
        recordings=recordings,
        settings=settings,
    )
    estimate = replace(estimate, samples=fitted.samples, residual=fitted.residual)
    notices = [*plan.notices, *law_notices, *estimate.notices, *fitted.pattern]
    if not chosen:
        notices += diagnostics.warn_of_processing(used, recordings)
    if not processing.automatic:
        notices += diagnostics.warn_of_moving_ends(used, recordings)
    evidence, residual = None, estimate.residual
    if plan.study is not None:
        evidence = collect_evidence(
            library,
            plan.study,
            fitted.fit.values,
            fitted.fit.covariance,
            whole=not fitted.identifiability.refused,
            robot=robot,
            transmission=recordings[0].transmission,
        )
        notices += [diagnostics.describe_proportion(*pair) for pair in evidence.in_proportion]
    elif not fitted.identifiability.refused:
        notices += diagnostics.warn_of_mass_matrix(library, fitted.fit.values, recordings)
    if rows not in regression.SCALAR_KINDS:
        # The residuals of all rows, slow ones too, with the scatter of those in the fit.
        scatter = {entry.joint: entry.std for entry in residual}
        residual = tuple(replace(entry, std=scatter.get(entry.joint, entry.std)) for entry in fitted.every)
    choice = plan.study.choice if plan.study is not None and chosen else None
    return replace(estimate, choice=choice, evidence=evidence, residual=residual, notices=tuple(notices))


def fit_in_memory(
    builder: regression.RowBuilder,
    recordings: Sequence[Recording],
    plan: FitPlan,
    *,
    rule: regression.RankRule,
    options: Mapping[str, Any] | None = None,
    weights: Sequence[float] | None = None,
) -> FittedRows:
    """Return the fit of recordings whose equations are all in memory; `weights` as for `stack_rows`."""
    used = plan.processing
    moving = builder._replace(processing=replace(used, standstill=None))
    whole = regression.stack_rows(list(map(moving.prepare, recordings)), weights)
    instruments, speed = None, whole.velocity
    if plan.estimator == FILTERED_INSTRUMENTAL:
        settings = replace(moving.processing, filter_cutoff=used.instrument_cutoff)
        smooth = moving._replace(processing=settings)
        instruments = regression.stack_rows(list(map(smooth.prepare, recordings)), weights)
        speed = instruments.velocity
    elif plan.scoring and builder.kind not in regression.SCALAR_KINDS:
        cutoff = min(plan.scoring, used.filter_cutoff or plan.scoring)
        smooth = moving._replace(processing=replace(moving.processing, filter_cutoff=cutoff))
        speed = smooth.list_speeds(recordings)
    kept, slow = regression.mask_fast(whole, speed, used, margin=plan.margin)
    if plan.scoring and builder.kind not in regression.SCALAR_KINDS:
        card = builder.library.card
        trembling = regression.mask_trembling(recordings, [joint.position_unit for joint in card.joints])
        rest, told = mask_resting_rows(card, whole, speed, plan.scoring, trembling)
        kept, slow = kept & ~rest, (*slow, *told)
    built = replace(regression.select_rows(whole, kept), notices=(*whole.notices, *slow))
    freedom = used.noise_freedom
    if instruments is None:
        identifiability = regression.analyse_identifiability(built, rule)
        fit = estimators.ESTIMATORS[plan.estimator](built, identifiability, freedom, **(options or {}))
        influence = estimators.measure_influence(built, identifiability.basis, fit.weights, fit.residuals)
    else:
        instruments = regression.select_rows(instruments, kept)
        found = estimators.fit_instruments(built, instruments, rule, freedom, simulated=False)
        fit, identifiability = found.fit, found.identifiability
        influence = estimators.Influence(
            left=found.gain, scores=found.frame, frame=found.frame, residuals=fit.residuals * fit.weights
        )
    every = estimators.compute_residuals(whole, whole.values - whole.matrix @ fit.values, 0)
    # Spectra of all equations follow, which take their memory.
    del whole, instruments
    pattern: tuple[Notice, ...] = ()
    if builder.kind in regression.SCALAR_KINDS or freedom != "band":
        pattern = diagnostics.warn_of_correlated_residuals(built, fit, identifiability)
    elif plan.estimator in {"ols", "wls", FILTERED_INSTRUMENTAL}:
        # The jackknife holds for errors of the model, which follow the motion; from some blocks it is
        # uncertain, so that the larger one counts.
        covariance = estimators.compute_coloured_covariance(built, influence)
        if plan.study is not None:
            variances = np.diag(covariance)
            wider = np.maximum(variances, judge.compute_variance(plan.study.fit.changes))
            factor = np.sqrt(np.divide(wider, variances, out=np.ones_like(wider), where=variances > 0.0))
            covariance = np.asarray(covariance * factor * factor[:, None])
        fit = replace(fit, covariance=covariance)
    else:
        # Other estimators keep their covariance, each deviation times what colour adds to that of wls.
        plain = estimators.fit_wls(built, identifiability)
        influence = estimators.measure_influence(built, identifiability.basis, plain.weights, plain.residuals)
        coloured = np.diag(estimators.compute_coloured_covariance(built, influence))
        white = np.diag(plain.covariance)
        ratio = np.divide(coloured, white, out=np.ones_like(white), where=white > 0.0)
        ratio = np.sqrt(np.maximum(ratio, 1.0))
        fit = replace(fit, covariance=np.asarray(fit.covariance * ratio * ratio[:, None]))
    return FittedRows(
        rows=built,
        identifiability=identifiability,
        fit=fit,
        pattern=pattern,
        samples=len(built.values),
        residual=estimators.compute_residuals(built, fit.residuals, fit.spent),
        every=every,
    )


def mask_resting_rows(
    card: ModelCard, rows: regression.Rows, speed: FloatArray, scoring: float, trembling: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], tuple[Notice, ...]]:
    """Return the rows (m,) at which a joint with friction rests, by its smooth speed (m,), and notices.

    Those that are `trembling` (n,) rest throughout.
    """
    rest, notices = np.zeros(len(speed), dtype=np.bool_), []
    for group in np.unique(rows.group).tolist():
        own = rows.group == group
        if card.joints[group].friction == NO_FRICTION:
            continue
        top = np.inf if trembling[group] else float(np.abs(speed[own]).max())
        for run in np.unique(rows.run[own]).tolist():
            part = np.flatnonzero(own & (rows.run == run))
            period = float(np.median(np.diff(rows.time[part]))) if len(part) > 1 else 1.0
            length = max(2, round(1.0 / (scoring * period)))
            rest[part] = regression.mask_rest(speed[part], top, length)
        if rest[own].any():
            text = f"joint {rows.group_names[group]!r}: at {int(rest[own].sum())} of {int(own.sum())} "
            text += "samples it rests, where stiction holds any torque; they were left out of the fit"
            notices.append(Notice(code="identify.slow-rows", text=text))
    return rest, tuple(notices)


def is_long(
    builder: regression.RowBuilder, recordings: Sequence[Recording], estimator: str, largest: float
) -> bool:
    """Return whether the equations take more than `largest` bytes, and can be fitted block by block."""
    if builder.kind not in regression.LONG_KINDS or estimator not in {"ols", "wls"}:
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
    builder: regression.RowBuilder,
    recordings: Sequence[Recording],
    estimator: str,
    *,
    rule: regression.RankRule,
    weights: Sequence[float] | None = None,
) -> FittedRows | None:
    """Return the fit of recordings whose matrix is never in memory; None where a joint has too few rows."""
    long = regression.condense_recordings(builder, recordings, weights)
    if long is None:
        return None
    rows, condensed, freedom = long.rows, long.condense(), builder.processing.noise_freedom
    identifiability = regression.analyse_condensed(condensed, rows.kind, rows.names, rule)
    regression.check_identifiable_share(identifiability, rows.names, rule.least, rows.notices)
    plain = None if estimator == "wls" else np.ones(len(condensed.counts))
    fit = estimators.fit_condensed(condensed, identifiability.basis, plain, freedom)
    sketch = long.sketch()
    left = sketch.values - sketch.matrix @ fit.values
    blocks = replace(fit, residuals=left, weights=fit.weights[sketch.group])
    residuals = partial(estimators.condense_residuals, rows, values=fit.values)
    unweighed = long.condense(weighed=False)
    return FittedRows(
        rows=rows,
        identifiability=identifiability,
        fit=fit,
        pattern=diagnostics.warn_of_correlated_residuals(sketch, blocks, identifiability),
        samples=int(long.counts.sum()),
        residual=residuals([unweighed], spent=fit.spent),
        every=residuals([unweighed, long.slow], spent=0.0),
    )


def build_estimate(
    card: ModelCard,
    rows: regression.Rows,
    identifiability: regression.Identifiability,
    fit: estimators.RegressionFit,
    *,
    estimator: str,
    recordings: Sequence[Recording],
    settings: Mapping[str, object],
) -> estimators.Estimate:
    """Return the estimate of fitted equations of the model of `card`, without warnings about the fit.

    `settings` are kept as JSON would give them back, so that a stored result equals its origin.
    """
    identifiable = np.flatnonzero(identifiability.identifiable)
    # Refused parameters that act together with others have a value in the fit, those without effect do not.
    acting = np.flatnonzero(identifiability.basis.any(axis=1) & ~identifiability.identifiable)
    cards, values = card.fitted, fit.values.copy()
    # Shape values are fitted as a change of those that the fit began with.
    values[len(values) - len(card.searched) :] += [entry.value or 0.0 for entry in card.searched]
    covariance = fit.covariance[np.ix_(identifiable, identifiable)]
    known = [replace(cards[k], value=None) if cards[k] in card.searched else cards[k] for k in identifiable]
    parameters = estimators.list_parameters(known, values[identifiable], covariance)
    return estimators.Estimate(
        robot=card.robot,
        signature=card.signature,
        rows=rows.kind,
        estimator=estimator,
        friction=tuple(joint.friction for joint in card.joints),
        parameters=parameters,
        residual=estimators.compute_residuals(rows, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=estimators.Outcome.SOME_REFUSED if identifiability.refused else estimators.Outcome.SOLVED,
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
            # Gravity has parts that are near zero, and zeros are.
            *diagnostics.warn_of_poorly_identifiable(
                [entry for entry, one in zip(parameters, known, strict=True) if one.reason != MOUNTING]
            ),
        ),
    )
