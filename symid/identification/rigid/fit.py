"""Identification of rigid robots: recordings to parameters with their uncertainty.

Library, recordings, settings -> `Estimate`;  options of the call, robot -> `EstimatorOptions`.

    Recording -> Signals -> Rows -> Identifiability -> RegressionFit -> Estimate

Logs that are too long for memory take two passes: in the first, matrices are condensed block by block,
weights and parameters found; in the second, residuals from the torque that the parameters predict.

Supported: several recordings at once, of unequal weight; all kinds of rows with all estimators; `ols` and
`wls` on torque and momentum rows that do not go into memory.
Not supported: recordings with delays or zero offsets of their own; other estimators beyond memory.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.identification.diagnostics import (
    SingleLogFit,
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
from symid.identification.rigid.validation import describe_processing
from symid.logs import Recording
from symid.robot import Processing, Robot

LONG_ESTIMATORS = ("ols", "wls")


class FittedRows(NamedTuple):
    """Equations, what they can tell, and their fit; notices on patterns of the residual and on drift."""

    rows: Rows
    seen: Identifiability
    fit: RegressionFit
    pattern: tuple[Notice, ...] = ()
    drift: tuple[Notice, ...] = ()


def is_long(maker: RowBuilder, recordings: Sequence[Recording], estimator: str, largest: float) -> bool:
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
    maker: RowBuilder,
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
    seen = analyse_condensed(condensed, rows.kind, rows.names, rule)
    check_identifiable_share(seen, rows.names, rule.least, rows.notices)
    plain = None if estimator == "wls" else np.ones(len(condensed.counts))
    found = fit_condensed(condensed, seen.basis, plain, freedom)
    groups = found.weights
    fit = RegressionFit(
        values=found.values,
        covariance=found.covariance,
        residuals=rows.values - predict_rows(maker, recordings, rows, found.values),
        spent=found.spent,
        condition=found.condition,
        weights=groups[rows.group] * np.sqrt(rows.weight),
    )
    sketch = long.sketch()
    blocks = _fit_sketch(sketch, fit.values, groups, seen)
    return FittedRows(
        rows=rows,
        seen=seen,
        fit=fit,
        pattern=warn_of_correlated_residuals(sketch, replace(blocks, covariance=fit.covariance), seen),
        drift=warn_of_drift(
            rows,
            fit,
            [entry.source for entry in recordings],
            freedom,
            fit_log=lambda run, weights: fit_run(long, run, weights, freedom),
        ),
    )


def compute_long_covariance(long: LongRows, groups: FloatArray, freedom: str) -> FloatArray:
    """Return the covariance (p, p) of the weighted fit, as `fit_weighted` has it.

    Args:
        long: the equations of all runs.
        groups: weights (g,) of the joints.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.

    Raises:
        IdentifiabilityError: nothing can be learnt.
    """
    condensed = long.condense()
    seen = analyse_condensed(condensed, long.outline.kind, long.outline.names)
    return fit_condensed(condensed, seen.basis, groups, freedom).covariance


def _fit_sketch(sketch: Rows, values: FloatArray, groups: FloatArray, seen: Identifiability) -> RegressionFit:
    """Return a fit to a sketch that has the scores of all blocks."""
    return RegressionFit(
        values=values,
        covariance=np.zeros((len(values), len(values))),
        residuals=sketch.values - sketch.matrix @ values,
        spent=int(seen.basis.shape[1]),
        condition=1.0,
        weights=groups[sketch.group],
    )


def fit_run(long: LongRows, run: int, groups: FloatArray, freedom: str) -> SingleLogFit | None:
    """Return what one run tells alone, as `drift` has it of rows in memory; None where that is nothing.

    Args:
        long: the equations of all runs.
        run: number of the run.
        groups: weights (g,) of the joints.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    condensed = long.condense(run)
    try:
        seen = analyse_condensed(condensed, long.outline.kind, long.outline.names)
    except IdentifiabilityError:
        return None
    found = fit_condensed(condensed, seen.basis, groups, freedom)
    stated = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    sketch = long.sketch(run)
    blocks = compute_block_deviations(sketch, _fit_sketch(sketch, found.values, groups, seen), seen)
    return SingleLogFit(found.values, np.maximum(stated, blocks), seen)


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
    maker = RowBuilder(rows, library, filters.processing, window, overlap)
    found = _fit(maker, recordings, estimator, rule=rule, options=options, weights=weights, largest=largest)
    settings = {
        **(echo or {}),
        **describe_processing(processing, filters.processing, recordings),
        # What the estimator chose or paid.
        **({"fit": dict(found.fit.report)} if found.fit.report else {}),
        **({} if weights is None else {"weights": list(weights)}),
        **({} if rows in {"torque", "power"} else {"window": window}),
        **({"overlap": overlap} if overlap and rows not in {"torque", "power"} else {}),
    }
    estimate = build_estimate(library.card, found, estimator, recordings, settings)
    doubts = _list_fit_warnings(maker, recordings, found, weights)
    return replace(estimate, notices=(*filters.notices, *estimate.notices, *doubts))


def build_estimate(
    card: ModelCard,
    found: FittedRows,
    estimator: str,
    recordings: Sequence[Recording],
    settings: Mapping[str, object],
) -> Estimate:
    """Return the estimate of fitted equations, without what speaks against it.

    Args:
        card: of the model.
        found: equations and fit.
        estimator: its name.
        recordings: the logs.
        settings: kept as JSON would give them back, so that a stored result equals its origin.
    """
    fit, seen, rows = found.fit, found.seen, found.rows
    told = np.flatnonzero(seen.learnable)
    # Refused parameters that act together with others have a value there, those without effect do not.
    acting = np.flatnonzero(seen.basis.any(axis=1) & ~seen.learnable)
    cards = card.beta + card.friction
    covariance = fit.covariance[np.ix_(told, told)]
    parameters = list_parameters([cards[k] for k in told], fit.values[told], covariance)
    return Estimate(
        robot=card.robot,
        signature=card.signature,
        rows=rows.kind,
        estimator=estimator,
        friction=tuple(joint.friction for joint in card.joints),
        parameters=parameters,
        residual=compute_residuals(rows, fit.residuals, fit.spent),
        condition=fit.condition,
        outcome=Outcome.SOME_REFUSED if seen.refused else Outcome.SOLVED,
        samples=len(rows.values),
        sources=tuple(recording.source for recording in recordings),
        settings=json.loads(json.dumps(settings)),
        refused=seen.refused,
        unresolved=tuple((rows.names[k], float(fit.values[k])) for k in acting),
        covariance=tuple(map(tuple, covariance.tolist())),
        notices=(*rows.notices, *seen.notices, *fit.notices, *warn_of_poorly_identifiable(parameters)),
    )


def _fit(
    maker: RowBuilder,
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
    seen, freedom = analyse_identifiability(stacked, rule), maker.processing.noise_freedom
    fit = fit_rows(estimator, stacked, seen, freedom, options)
    return FittedRows(
        rows=stacked,
        seen=seen,
        fit=fit,
        pattern=warn_of_correlated_residuals(stacked, fit, seen),
        drift=warn_of_drift(stacked, fit, [entry.source for entry in recordings], freedom),
    )


def _list_fit_warnings(
    maker: RowBuilder, recordings: Sequence[Recording], found: FittedRows, weights: Sequence[float] | None
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
        *warn_of_stiction(found.rows, found.fit, library),
        *found.drift,
        *(() if found.seen.refused else warn_of_mass_matrix(library, values, recordings)),
    )


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


OUTPUT_ERROR, INSTRUMENTAL = "output-error", "instrumental"
SIMULATING = (OUTPUT_ERROR, INSTRUMENTAL)
"""Estimators that simulate the robot, see `closed_loop_estimate`."""
ESTIMATOR_NAMES = ("ols", "wls", "gls", "huber", "ridge", "consistent", "sequential", *SIMULATING)
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
        prior_weight: 1 to believe the deviations stated, 0 for no prior; None to choose by cross validation.
        start: an estimate, or its file, that a simulating estimator begins with.
        partial: whether to fit what can be told where logs tell less than three quarters.
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
        names = (
            "rows",
            "estimator",
            "period",
            "overlap",
            "prior",
            "prior_deviation",
            "prior_weight",
            "start",
            "partial",
        )
        given = (name for name in names if getattr(self, name) not in (None, (), False))
        return tuple(f"--{name.replace('_', '-')}" for name in given)


def check_estimator(rows: str, estimator: str | None) -> None:
    """Refuse an estimator that no rows of a rigid robot know.

    Raises:
        UsageError: there is no such estimator; those of friction laws are others.
    """
    if estimator not in {None, *ESTIMATOR_NAMES}:
        text = (
            f"estimator {estimator!r}: there is no such estimator of {rows} rows; allowed are "
            f"{', '.join(ESTIMATOR_NAMES)}; those of friction laws go with --rows friction"
        )
        raise UsageError(Notice(code="usage.unknown-estimator", text=text))


def check_rigid_options(rows: str, estimator: str, options: RigidOptions) -> None:
    """Refuse options that rows or estimator do not read.

    Args:
        rows: kind of rows.
        estimator: its name.
        options: those given.

    Raises:
        UsageError: an option belongs to other rows or to another estimator, or is out of range.
    """
    wanted = {
        "window": (rows in _WINDOWED, f"--rows {', '.join(_WINDOWED)}"),
        "overlap": (rows in _OVERLAPPING, f"--rows {' and '.join(_OVERLAPPING)}"),
        "period": (estimator == "gls", "--estimator gls and --rows friction"),
        **dict.fromkeys(
            ("prior", "prior_deviation", "prior_weight"), (estimator == "ridge", "--estimator ridge")
        ),
        "start": (estimator in SIMULATING, f"--estimator {' and '.join(SIMULATING)}"),
    }
    notices = [
        Notice(
            code="usage.mixed-options",
            text=f"--{name.replace('_', '-')} belongs to {owner}; leave it out, or choose these",
        )
        for name, (fits, owner) in wanted.items()
        if getattr(options, name) not in (None, ()) and not fits
    ]
    if options.prior_deviation is not None and not 0.0 < options.prior_deviation < math.inf:
        text = f"prior deviation {options.prior_deviation:g}: must be a positive number"
        notices.append(Notice(code="usage.prior", text=text))
    if options.prior_weight is not None and not 0.0 <= options.prior_weight < math.inf:
        text = f"prior weight {options.prior_weight:g}: must be 0 or a positive number"
        notices.append(Notice(code="usage.prior", text=text))
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} is one of torques; leave --rows {rows} out"
        notices.append(Notice(code="usage.mixed-options", text=text))
    if notices:
        raise UsageError(*notices)


def build_estimator_options(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    estimator: str,
    options: RigidOptions,
    *,
    prior: Estimate | None = None,
) -> EstimatorOptions:
    """Return what the estimator needs.

    Args:
        robot: as it is identified.
        library: its functions.
        recordings: the logs.
        estimator: its name.
        options: those given.
        prior: of the same model, None for the values of the robot file.

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
