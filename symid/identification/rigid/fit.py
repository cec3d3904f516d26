"""Identification of rigid robots: recordings to parameters with their uncertainty, and what speaks for them.

    Recording -> FitPlan -> Rows -> Identifiability -> RegressionFit -> Evidence -> Estimate

Logs that are too long for memory are condensed block by block, and a second pass finds their residuals.
Standard deviations hold for residuals that are correlated in time and between joints; an estimator other
than ols, wls and instruments keeps its own, times what correlation adds to those of wls.

What speaks for a fit is what it predicts of held-out rows, in percent of each joint's torque:

    r = y - A x_(-s),    100 |L r| / |L y|

x_(-s) are the parameters without the stretch (or, of several logs, without the log) of the row; L is a
zero-phase Butterworth low-pass of order 4 at the scoring band. Every row counts; those in motion, at reversal
and at rest count apart as well.

A fit is suspicious where much is left unexplained, or a value is impossible: a negative friction or rotor
inertia, or a mass matrix that is not positive definite, by more than four deviations and two percent of a
joint's torque. Then single mistakes of the log are tried (`find_cause`).

Terms that the model lacks are added to one joint j in fact, and kept where held-out rows are better:

    min |L' (A x + C c - y)|_W     with all parameters free, without each stretch in turn
    gain = 1 - |L' (y_j - A_j x - C c)|^2 / |L' (y_j - A_j x_0)|^2     on stretches left out, x_0 without C

C are functions of the motion of joint j (`FAMILIES`). L' is a low-pass at twice the scoring band, ten Hz at
least: beyond, the noise of accelerations makes a residual that looks like a term of other joints. A term
counts where its gain exceeds five percent of the joint's squares, and is sure by four standard errors (see
`measure_gain`).

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; `ols` and
`wls` on torque and momentum rows that do not fit into memory; evidence from rows of single joints at even
times.
Not supported: recordings with delays or offsets of their own; other estimators beyond memory; evidence from
power and energy rows; two missing terms at once; terms of several joints.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification import diagnostics, estimators, regression
from symid.identification.rigid.plan import FILTERED_INSTRUMENTAL, FitPlan, list_unknown, plan_fit
from symid.identification.rigid.settings_choice import ROW_RATE
from symid.joint_models import is_braking
from symid.logs import Recording, choose_processing, mask_states
from symid.robot import Processing

_LEAST_GAIN = 0.05
_SURE, _SURE_OF_LARGE = 4.0, 2.5
"""Standard errors by which a term helps, and deviations beyond which an impossible value is no chance."""
_LARGE = 0.4
"""Gain from which fewer standard errors are enough: chance gains little."""
_TINY = 1e-300
_FRICTION = ("velocity", "slow motion", "load")
"""Families that another friction law would have."""
_BAND, _LEAST_BAND = 2.0, 10.0
"""Times the scoring band, and Hz at least, up to which terms are looked for."""
_RATE = 4.0
"""Times that band: rate of the rows that are kept."""


def list_missing_terms(  # noqa: PLR0917 - what was fitted, and how
    library: Library,
    recordings: Sequence[Recording],
    plan: FitPlan,
    rows: regression.Rows,
    weights: FloatArray,
    values: FloatArray,
    scoring: float,
) -> tuple[estimators.ModelTerm, ...]:
    """Return the terms that help, the largest gain first, one a joint.

    `weights` (g,) are those of the squared residuals of each joint, `values` (p,) those of the fit, `scoring`
    the band in Hz.
    """
    band = max(_BAND * scoring, _LEAST_BAND)
    predicted = rows.matrix @ values
    # The motion of every joint at its rows, one entry for each log that has rows of it, with the same terms
    # in all logs: a joint at rest in one of them has zeros there. Of the rows some are kept, by the band.
    motions: dict[int, list[diagnostics.JointMotion]] = {
        group: [] for group in np.unique(rows.group).tolist()
    }
    resting = set.intersection(*(set(regression.list_resting_joints(entry)) for entry in recordings))
    thin = np.zeros(len(rows.values), dtype=np.bool_)
    for run in np.unique(rows.run).tolist():
        signals = regression.prepare_states(library, recordings[run], plan.processing)
        for group, parts in motions.items():
            own = np.flatnonzero((rows.run == run) & (rows.group == group))
            if not len(own):
                continue
            period = float(np.median(np.diff(rows.time[own]))) if len(own) > 1 else np.nan
            if len(own) > 1:
                thin[own[:: max(1, math.floor(1.0 / (_RATE * band * period)))]] = True
            places = np.searchsorted(signals.time, rows.time[own] - 0.5 * signals.period)
            states = (rows.time[own], signals.q[places], signals.dq[places], signals.ddq[places])
            parts.append(diagnostics.pick_motion(states, group, predicted[own], period, resting))
    table = diagnostics.smooth_rows(rows, np.column_stack([rows.matrix, rows.values]), band)
    smooth = regression.select_rows(replace(rows, matrix=table[:, :-1], values=table[:, -1]), thin)
    stretches = diagnostics.fit_stretches(smooth, None, np.ones(len(smooth.values), dtype=np.bool_), weights)
    found = []
    for group in np.unique(rows.group).tolist():
        whole = np.flatnonzero(rows.group == group)
        own = np.flatnonzero(smooth.group == group)
        best: estimators.ModelTerm | None = None
        for name, family in diagnostics.FAMILIES.items():
            if name == diagnostics.OTHER_VALUES or (plan.laws_chosen and name in _FRICTION):
                continue
            built = list(map(family.build, motions[group]))
            if not built[0]:
                continue
            columns = np.vstack(list(map(np.column_stack, built)))
            columns = diagnostics.smooth_rows(regression.select_rows(rows, whole), columns, band)[thin[whole]]
            size = np.sqrt(np.mean(columns**2, axis=0))
            columns = columns[:, size > _TINY] / size[size > _TINY]
            gain, errors = diagnostics.measure_gain(stretches, smooth, own, columns)
            sure = errors > (_SURE if gain < _LARGE else _SURE_OF_LARGE)
            if gain > _LEAST_GAIN and sure and (best is None or 100.0 * gain > best.gain):
                best = estimators.ModelTerm(
                    joint=rows.group_names[group], term=name, gain=100.0 * gain, errors=errors
                )
        if best is not None:
            found.append(best)
    return tuple(sorted(found, key=lambda entry: -entry.gain))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedRows:
    """Equations of a fit, what is identifiable from them, the fit, and notices on correlated residuals.

    Args:
        whole: all m rows, slow ones too; residuals: (m,) what the fit leaves of them.
        speed: (m,) of smooth positions, rad/s or m/s; kept: (m,) whether the fit has a row.
        smooth: `whole` along the states of the instruments, None where there are none.
        stretches: fits without each stretch, None where rows do not go into memory.
    """

    rows: regression.Rows
    identifiability: regression.Identifiability
    fit: estimators.RegressionFit
    pattern: tuple[Notice, ...] = ()
    whole: regression.Rows
    residuals: FloatArray
    speed: FloatArray
    kept: NDArray[np.bool_]
    smooth: regression.Rows | None = None
    stretches: diagnostics.Stretches | None = None


def list_joint_evidence(
    fitted: FittedRows, stretches: diagnostics.Stretches, scoring: float
) -> tuple[estimators.JointEvidence, ...]:
    """Return what is left unexplained of every joint within the `scoring` band in Hz."""
    rows = fitted.whole
    errors = rows.values - stretches.predict(rows)
    # Near rest, noise turns the sign of a velocity: that is no friction of another kind.
    slow = errors if fitted.smooth is None else rows.values - stretches.predict(fitted.smooth)
    table = diagnostics.smooth_rows(
        rows, np.column_stack([rows.values, errors, fitted.residuals, slow]), scoring
    )
    inner = diagnostics.mask_inner(rows)
    found = []
    for group in np.unique(rows.group):
        own = rows.group == group
        counted, phases = own & inner, np.full(len(own), -1)
        phases[own] = estimators.find_phases(rows.time[own], fitted.speed[own], rows.run[own])
        torque = float(np.sqrt(np.mean(table[counted, 0] ** 2))) if counted.any() else 0.0

        def share(column: int, mask: NDArray[np.bool_], torque: float = torque) -> float:
            if not torque or not mask.any():
                return float("inf")
            return 100.0 * float(np.sqrt(np.mean(table[mask, column] ** 2))) / torque

        found.append(
            estimators.JointEvidence(
                joint=rows.group_names[group],
                fitted=share(2, counted & fitted.kept),
                held_out=share(1, counted),
                moving=share(1, counted & (phases == 0)),
                reversing=share(3, counted & (phases == 1)),
                resting=share(3, counted & (phases == 2)),
                share=float(np.mean(~fitted.kept[own])),
                torque=torque,
            )
        )
    return tuple(found)


_MATTERS = 0.02
"""Of the root mean square of a joint's torque: an impossible value that does less is no mistake."""
_SUSPICIOUS = 30.0
"""Percent of held-out torque left unexplained, from which causes are looked for."""
_HELPS = 0.7
"""Times the held-out residual: what must be left at most with a mistake undone."""
_POSES = 60


def collect_evidence(
    library: Library,
    recordings: Sequence[Recording],
    plan: FitPlan,
    fitted: FittedRows,
    stretches: diagnostics.Stretches,
) -> estimators.Evidence:
    """Return the evidence for a fit in memory."""
    values, choice = fitted.fit.values, plan.choice
    scoring = choice.scoring if choice is not None else diagnostics.measure_scoring_band(recordings)
    logs = diagnostics.build_quick_logs(library, recordings, plan.processing, scoring)
    quick = diagnostics.fit_quick(logs)
    names = [joint.name for joint in library.card.joints]
    found = estimators.Evidence(
        joints=list_joint_evidence(fitted, stretches, scoring),
        scoring=scoring,
        stretches=len(stretches.logs),
        logs=len(stretches.logwise),
        movement=choice.chosen.movement if choice is not None else 0.0,
        impossible=list_impossible(library, recordings, plan.processing, fitted),
        in_proportion=tuple(
            (names[j], names[k]) for j, k in diagnostics.list_proportions(logs.dq, quick.moving)
        ),
    )
    if fitted.whole.kind == "torque" and found.unexplained <= _SUSPICIOUS:
        call = library, recordings, plan, fitted.whole, stretches.weights, values, scoring
        found = replace(found, missing=list_missing_terms(*call))
    # A quick fit may itself be poor: undoing a mistake must leave less than the fit does.
    left = {entry.joint: entry.held_out for entry in found.joints}
    held_out = np.array([left.get(names[joint], np.inf) for joint in quick.moving])
    most, impossible = _HELPS * found.unexplained, bool(found.impossible)
    cause = diagnostics.find_cause(logs, quick, most, cures=impossible, held_out=held_out)
    if not (np.isfinite(cause.percent) or found.unexplained > _SUSPICIOUS or impossible):
        return found
    return replace(
        found,
        code=cause.code,
        cause=cause.cause,
        remedy=cause.remedy,
        cured=cause.percent,
        effect=cause.effect,
    )


def warn_of_evidence(evidence: estimators.Evidence) -> tuple[Notice, ...]:
    """Return warnings of missing terms, and of joints that move in proportion."""
    found = [
        diagnostics.build_warning(
            "identify.structure",
            joint=term.joint,
            term=term.term,
            gain=term.gain,
            advice=diagnostics.FAMILIES[term.term].advice[:1].upper()
            + diagnostics.FAMILIES[term.term].advice[1:],
        )
        for term in evidence.missing
    ]
    found += [diagnostics.describe_proportion(*pair) for pair in evidence.in_proportion]
    return tuple(found)


def list_impossible(
    library: Library, recordings: Sequence[Recording], processing: Processing, fitted: FittedRows
) -> tuple[str, ...]:
    """Return in words what no robot can have; mass matrices count where no parameter is refused."""
    card, rows, fit = library.card, fitted.rows, fitted.fit
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found = []
    sizes = np.zeros(len(rows.names))
    for group in np.unique(rows.group):
        own = rows.group == group
        torque = float(np.sqrt(np.mean(rows.values[own] ** 2))) or 1.0
        part = np.sqrt(np.mean((rows.matrix[own] * fit.values) ** 2, axis=0)) / torque
        sizes = np.maximum(sizes, part)
    for place, entry in enumerate((*card.beta, *card.friction)):
        friction = place >= len(card.beta) and is_braking(entry.name)
        rotor = place < len(card.beta) and entry.name.startswith("IA")
        surely = fit.values[place] < -_SURE * deviations[place] and sizes[place] > _MATTERS
        if (friction or rotor) and deviations[place] > 0.0 and surely:
            what = "friction drives the joint" if friction else "a rotor has a negative inertia"
            found.append(f"{entry.name} = {fit.values[place]:.3g} {entry.unit}: {what}")
    if fitted.identifiability.refused:
        return tuple(found)
    # At how many poses the mass matrix is surely not positive definite; it counts where that matters.
    positions = np.vstack([recording.position for recording in recordings])
    places = np.linspace(0, len(positions) - 1, _POSES).astype(int)
    count = len(card.beta)
    mass, least, vectors = _analyse_mass(library, positions[places], fit.values[:count])
    weakest = vectors[:, :, 0]
    row = np.einsum("ti,tijk,tj->tk", weakest, mass, weakest)
    variances = np.einsum("tk,kl,tl->t", row, fit.covariance[:count, :count], row)
    bad = int(np.sum(least[:, 0] < -_SURE * np.sqrt(np.maximum(variances, 0.0))))
    # The largest part of a joint's torque, in root mean squares, that negative inertia takes.
    most = 0.0
    for recording in recordings if bad else ():
        signals = regression.prepare_states(library, recording, processing)
        places = np.linspace(0, len(signals.time) - 1, _POSES).astype(int)
        _, least, vectors = _analyse_mass(library, signals.q[places], fit.values[:count])
        negative = np.minimum(least, 0.0)
        torques = np.einsum("tij,tj,tkj,tk->ti", vectors, negative, vectors, signals.ddq[places])
        part, all_torque = (np.sqrt(np.mean(entry**2, axis=0)) for entry in (torques, signals.tau))
        most = max(most, float(np.max(part / np.where(all_torque > 0.0, all_torque, np.inf))))
    if most > _MATTERS:
        found.append(f"the mass matrix is not positive definite at {bad} of {_POSES} poses of the logs")
    return tuple(found)


def _analyse_mass(
    library: Library, poses: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return dM/dbeta (t, n, n, p) at poses (t, n), and eigenvalues (t, n) and vectors (t, n, n) of M."""
    # (t, i, j, k): row i of column j of M at pose t.
    mass = np.stack(list(diagnostics.evaluate_inertia_columns(library, np.ascontiguousarray(poses))), axis=2)
    matrices = mass @ values
    least, vectors = np.linalg.eigh((matrices + matrices.swapaxes(1, 2)) / 2.0)
    return mass, least, vectors


LARGEST = 2e8
"""Bytes of equations that are held in memory."""


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
    options: estimators.EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    largest: float = LARGEST,
    plan: FitPlan | None = None,
) -> estimators.Estimate:
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
    notices = list_unknown("rows", rows, regression.ROW_KINDS)
    if estimator is not None:
        notices += list_unknown("estimator", estimator, (*estimators.ESTIMATORS, FILTERED_INSTRUMENTAL))
    if not recordings:
        notices.append(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if notices:
        raise UsageError(*notices)
    # As many rows as can be chosen at most.
    thinned = choose_processing(processing, recordings[0].period, ROW_RATE)
    builder = regression.RowBuilder(rows, library, thinned, window or regression.WINDOW, overlap)
    long = is_long(builder, recordings, estimator or "wls", largest)
    plan = plan or plan_fit(library, recordings, processing, rows=rows, estimator=estimator, long=long)
    used, rule = plan.processing, rule or regression.RankRule()
    chosen = plan.choice is not None
    window = window or regression.choose_window(rows, used, recordings[0].period, chosen=chosen)
    builder = regression.RowBuilder(rows, library, used, window, overlap)
    recordings = [replace(recording, bad=mask_states(recording, used)) for recording in recordings]
    fitted = None
    if is_long(builder, recordings, plan.estimator, largest):
        fitted = fit_long(builder, recordings, plan.estimator, rule=rule, weights=weights)
    if fitted is None:
        fit = partial(fit_in_memory, builder, recordings, rule=rule, options=options, weights=weights)
        try:
            fitted = fit(plan)
        except IdentifiabilityError:
            if estimator is not None or plan.estimator != FILTERED_INSTRUMENTAL:
                raise
            # Instruments that were chosen fail where a joint is explained to the last bit.
            usual = "wls" if library.card.size > 1 else "ols"
            text = (
                f"the instruments do not determine all parameters, so that the estimator is {usual} instead"
            )
            note = Notice(code="identify.automatic", text=text)
            used = replace(used, instrument_cutoff=None)
            plan = replace(plan, processing=used, estimator=usual, notices=(*plan.notices, note))
            fitted = fit(plan)
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
    estimate = build_estimate(
        library.card,
        fitted.rows,
        fitted.identifiability,
        fitted.fit,
        estimator=plan.estimator,
        recordings=recordings,
        settings=settings,
    )
    notices = [*plan.notices, *estimate.notices, *fitted.pattern]
    if plan.choice is None:
        notices += diagnostics.warn_of_processing(used, recordings)
    if not processing.automatic:
        notices += diagnostics.warn_of_moving_ends(used, recordings)
    evidence, residual = None, estimate.residual
    if fitted.stretches is not None and rows not in regression.SCALAR_KINDS:
        evidence = collect_evidence(library, recordings, plan, fitted, fitted.stretches)
        notices += warn_of_evidence(evidence)
    elif not fitted.identifiability.refused:
        notices += diagnostics.warn_of_mass_matrix(library, fitted.fit.values, recordings)
    if rows not in regression.SCALAR_KINDS:
        # The residuals of all rows, slow ones too, with the scatter of those in the fit.
        scatter = {entry.joint: entry.std for entry in residual}
        whole = estimators.compute_residuals(fitted.whole, fitted.residuals, 0)
        residual = tuple(replace(entry, std=scatter.get(entry.joint, entry.std)) for entry in whole)
    return replace(estimate, choice=plan.choice, evidence=evidence, residual=residual, notices=tuple(notices))


def fit_in_memory(
    builder: regression.RowBuilder,
    recordings: Sequence[Recording],
    plan: FitPlan,
    *,
    rule: regression.RankRule,
    options: estimators.EstimatorOptions | None = None,
    weights: Sequence[float] | None = None,
) -> FittedRows:
    """Return the fit of recordings whose equations are all in memory; `weights` as for `stack_rows`.

    Raises:
        LogError, UsageError: as for `prepare_rows`.
        IdentifiabilityError: no parameter is identifiable.
    """
    used = plan.processing
    moving = builder._replace(processing=replace(used, standstill=None))
    whole = regression.stack_rows(list(map(moving.prepare, recordings)), weights)
    instruments, speed = None, whole.velocity
    if plan.estimator == FILTERED_INSTRUMENTAL:
        settings = replace(moving.processing, filter_cutoff=used.instrument_cutoff)
        smooth = moving._replace(processing=settings)
        instruments = regression.stack_rows(list(map(smooth.prepare, recordings)), weights)
        speed = instruments.velocity
    elif plan.choice is not None and builder.kind not in regression.SCALAR_KINDS:
        cutoff = min(plan.choice.scoring, used.filter_cutoff or plan.choice.scoring)
        smooth = moving._replace(processing=replace(moving.processing, filter_cutoff=cutoff))
        speed = regression.stack_rows(list(map(smooth.outline, recordings))).velocity
    kept, slow = regression.mask_fast(whole, speed, used, margin=plan.margin)
    built = replace(regression.select_rows(whole, kept), notices=(*whole.notices, *slow))
    freedom = used.noise_freedom
    if instruments is None:
        identifiability = regression.analyse_identifiability(built, rule)
        fit = estimators.fit_rows(plan.estimator, built, identifiability, freedom, options)
        influence = estimators.measure_influence(built, identifiability.basis, fit.weights, fit.residuals)
    else:
        found = estimators.fit_instruments(
            built, regression.select_rows(instruments, kept), rule, freedom, simulated=False
        )
        fit, identifiability = found.fit, found.identifiability
        influence = estimators.Influence(
            left=found.gain, scores=found.frame, frame=found.frame, residuals=fit.residuals * fit.weights
        )
    # What the squared residuals of each joint count for in the fit.
    squares = np.ones(len(built.group_names))
    for group in np.unique(built.group):
        own = built.group == group
        squares[group] = np.median(fit.weights[own] ** 2 / built.weight[own])
    stretches = diagnostics.fit_stretches(whole, instruments, kept, squares)
    pattern: tuple[Notice, ...] = ()
    if builder.kind in regression.SCALAR_KINDS or freedom != "band":
        pattern = diagnostics.warn_of_correlated_residuals(built, fit, identifiability)
    elif plan.estimator in {"ols", "wls", FILTERED_INSTRUMENTAL}:
        # The jackknife holds for errors of the model, which follow the motion, but from a few stretches it
        # is uncertain by half: a third of it, where that is larger, lets intervals of right models cover
        # 92 to 98 %.
        covariance = estimators.compute_coloured_covariance(built, influence)
        variances = np.diag(covariance)
        known, safe = variances > 0.0, np.where(variances > 0.0, variances, 1.0)
        ratio = np.where(known, diagnostics.compute_jackknife(stretches.folds) / safe, 1.0)
        factor = np.sqrt(np.maximum(1.0, (2.0 + ratio) / 3.0))
        fit = replace(fit, covariance=np.asarray(covariance * factor * factor[:, None]))
    else:
        # Other estimators keep their covariance, each deviation times what colour adds to that of wls.
        plain = estimators.fit_weighted(
            built, identifiability, estimators.estimate_group_weights(built, identifiability)
        )
        influence = estimators.measure_influence(built, identifiability.basis, plain.weights, plain.residuals)
        coloured, white = (
            np.diag(estimators.compute_coloured_covariance(built, influence)),
            np.diag(plain.covariance),
        )
        ratio = np.where(white > 0.0, coloured / np.where(white > 0.0, white, 1.0), 1.0)
        ratio = np.sqrt(np.maximum(ratio, 1.0))
        fit = replace(fit, covariance=np.asarray(fit.covariance * ratio * ratio[:, None]))
    return FittedRows(
        rows=built,
        identifiability=identifiability,
        fit=fit,
        pattern=pattern,
        whole=whole,
        residuals=whole.values - whole.matrix @ fit.values,
        speed=speed,
        kept=kept,
        smooth=instruments,
        stretches=stretches,
    )


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
    """Return the fit of recordings whose matrix is never in memory; None where a joint has too few equations.

    `weights` are those of each recording's squared residuals; one if None.

    Raises:
        LogError, UsageError: as for `prepare_rows`.
        IdentifiabilityError: no parameter is identifiable.
    """
    builder = builder._replace(keeper=regression.StatesKeeper())
    long = regression.condense_recordings(builder, recordings, weights)
    if long is None:
        return None
    every = builder._replace(processing=replace(builder.processing, standstill=None))
    whole = regression.stack_rows(list(map(every.outline, recordings)), weights)
    kept, slow = regression.mask_fast(whole, whole.velocity, builder.processing)
    rows = replace(long.outline, notices=(*whole.notices, *slow))
    condensed, freedom = long.condense(), builder.processing.noise_freedom
    identifiability = regression.analyse_condensed(condensed, rows.kind, rows.names, rule)
    regression.check_identifiable_share(identifiability, rows.names, rule.least, rows.notices)
    plain = None if estimator == "wls" else np.ones(len(condensed.counts))
    found = estimators.fit_condensed(condensed, identifiability.basis, plain, freedom)
    predicted, every_row = regression.predict_outlines(every, recordings, (rows, whole), found.values)
    groups, sketch = found.weights, long.sketch()
    factors = groups[rows.group] * np.sqrt(rows.weight)
    fit = replace(found, residuals=rows.values - predicted, weights=factors)
    left = sketch.values - sketch.matrix @ found.values
    blocks = replace(found, residuals=left, weights=groups[sketch.group])
    return FittedRows(
        rows=rows,
        identifiability=identifiability,
        fit=fit,
        pattern=diagnostics.warn_of_correlated_residuals(sketch, blocks, identifiability),
        whole=whole,
        residuals=whole.values - every_row,
        speed=whole.velocity,
        kept=kept,
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
            *diagnostics.warn_of_poorly_identifiable(parameters),
        ),
    )
