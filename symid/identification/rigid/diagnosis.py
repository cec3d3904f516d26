"""Diagnosis of a fit on its own logs: rank, correlations, essential parameters, bootstrap, drift, structure.

Estimate, the library of its model, the recordings of the fit -> `Diagnosis`.

The equations are those of the fit: its processing, windows, weights of runs, rule for the noise. Where the
estimator needs nothing else, the fit is repeated and compared with the estimate.

The price of decimation: fits to the rows that decimation keeps, and to every sample, predict held-out fifths
of the time, and the residuals of both on the decimated rows are compared.

Supported: estimates from torque and momentum rows, whatever the estimator; logs of any number and length.
Not supported: energy and power rows, which mix the joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification.diagnostics import (
    Bootstrap,
    Drift,
    Ellipse,
    Essential,
    JointProfiles,
    ResidualFinding,
    analyse_structure,
    build_warning,
    compute_bootstrap,
    compute_ellipse,
    compute_mean_weights,
    compute_profiles,
    list_correlated,
    measure_drift,
    select_essential,
)
from symid.identification.estimators import (
    Estimate,
    RegressionFit,
    check_model,
    estimate_group_weights,
    fit_weighted,
)
from symid.identification.regression import (
    Identifiability,
    LongRows,
    RankRule,
    RowBuilder,
    Rows,
    compute_spectrum,
    condense_recordings,
    count_freedom,
)
from symid.identification.rigid.fit import LARGEST, compute_long_covariance, fit_in_memory, is_long
from symid.identification.rigid.plan import FILTERED_INSTRUMENTAL, FitPlan
from symid.identification.rigid.validation import (
    get_fit_overlap,
    get_fit_window,
    get_run_weights,
    resolve_processing,
)
from symid.logs import Recording
from symid.robot import Decimation, Processing
from symid.serialization import HIDDEN, name_key

_FOLDS = 5
_RANK = 1e-10
"""Singular value relative to the largest below which the other folds do not identify a direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """The price of a choice: `what` in words, `percent` more of `of`."""

    what: str
    of: str
    percent: float


def measure_decimation_price(
    builder: RowBuilder,
    recordings: Sequence[Recording],
    identifiability: Identifiability,
    groups: FloatArray,
    weights: Sequence[float] | None = None,
) -> tuple[Price, ...]:
    """Return the prices of decimation against every sample; none without it, or with too few rows.

    `groups` are the weights (g,) of the joints, `weights` those of each recording's squared residuals.
    """
    if builder.kind != "torque" or builder.processing.decimation.factor == 1:
        return ()
    every = builder._replace(processing=replace(builder.processing, decimation=Decimation()))
    some, full = (condense_recordings(entry, recordings, weights) for entry in (builder, every))
    if some is None or full is None:
        return ()
    freedom = builder.processing.noise_freedom
    ours, theirs = (
        np.sqrt(np.maximum(np.diag(compute_long_covariance(entry, groups, freedom)), 0.0))
        for entry in (some, full)
    )
    both = (ours > 0.0) & (theirs > 0.0)
    if not both.any():
        return ()
    judged, number = _weigh(some, identifiability, groups)
    others, place = _weigh(full, identifiability, groups)
    left = np.zeros(2)
    for fold in range(_FOLDS):
        held = judged[number == fold]
        for index, table in enumerate((judged[number != fold], others[place != fold])):
            values = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=_RANK)[0]
            left[index] += float(np.sum((held[:, -1] - held[:, :-1] @ values) ** 2))
    held_out = 100.0 * (float(np.sqrt(left[0] / left[1])) - 1.0) if left[1] else 0.0
    what = f"decimation by {builder.processing.decimation.factor}"
    wider = 100.0 * (float(np.median(ours[both] / theirs[both])) - 1.0)
    return (
        Price(what=what, of="held-out residual", percent=held_out),
        Price(what=what, of="median stated standard deviation (for white noise)", percent=wider),
    )


def _weigh(
    long: LongRows, identifiability: Identifiability, groups: FloatArray
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return weighted rows [A B, y] with the squares of all equations, and the fifth of time of each."""
    sketch, fold = long.sketch(), np.zeros(0, dtype=np.intp)
    for group in np.unique(sketch.group):
        count = int(np.sum(sketch.group == group))
        fold = np.concatenate([fold, np.arange(count) * _FOLDS // count])
    table = (
        np.column_stack([sketch.matrix @ identifiability.basis, sketch.values])
        * groups[sketch.group][:, None]
    )
    return table, fold


_KINDS = ("torque", "momentum")
_FREE = 1e-6
"""Percent below which a price is rounding."""
_ALONE = ("ols", "wls", "huber", "sequential", FILTERED_INSTRUMENTAL)
"""Estimators that need nothing but rows."""
_CHANGED = 1e-6
"""Deviations by which a fit made again may differ from the estimate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagnosis:
    """All that follows from a fit and its logs beyond the parameters.

    Args:
        singular: of the weighted matrix with columns of length one, in falling order, and its `rank`.
        correlated: (name, name, correlation), the closest first; `ellipse` of the first pair.
        essential, bootstrap, drift: see there.
        structure: functions that explain the residual of each joint; profiles: the residual against states.
        prices: of the estimator against plain least squares of the same weights, and of decimation.
        refit: largest difference, in stated deviations, between the estimate and the fit made again; None
            where the estimator needs more than the logs.
        notices: what a reader should know.
    """

    singular: tuple[float, ...] = field(metadata=name_key("singular_values"))
    rank: int
    correlated: tuple[tuple[str, str, float], ...]
    ellipse: Ellipse | None = field(metadata=HIDDEN)
    essential: Essential
    bootstrap: Bootstrap
    drift: Drift
    structure: tuple[ResidualFinding, ...]
    profiles: tuple[JointProfiles, ...] = field(metadata=HIDDEN)
    prices: tuple[Price, ...]
    refit: float | None = None
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)


def diagnose_estimate(
    estimate: Estimate,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    seed: int = 0,
) -> Diagnosis:
    """Return the diagnosis of `estimate` on the recordings that it was fitted to, as their runs are set.

    What `processing` leaves open is taken from the estimate; `seed` is that of the bootstrap's draws.

    Raises:
        EstimateError: the estimate belongs to another model, or its settings cannot be read.
        UsageError: its rows mix the joints.
    """
    check_model(estimate, library.card)
    if estimate.rows not in _KINDS:
        text = f"{estimate.rows} rows mix the joints, which a diagnosis treats one by one; use torque rows"
        raise UsageError(Notice(code="usage.mixed-rows", text=text))
    settled = resolve_processing(estimate, processing, recordings[0])
    processing, weights = settled.processing, get_run_weights(estimate.settings, len(recordings))
    window, overlap = get_fit_window(estimate.settings), get_fit_overlap(estimate.settings)
    builder = RowBuilder(estimate.rows, library, processing, window, overlap)
    alone = estimate.estimator in _ALONE
    # The choice says by which speed a row is slow, but not to fits of logs that are too long for memory.
    long = is_long(builder, recordings, estimate.estimator, LARGEST)
    plan = FitPlan(
        processing=processing,
        estimator=estimate.estimator if alone else "wls",
        choice=None if long else estimate.choice,
    )
    fitted = fit_in_memory(builder, recordings, plan, rule=RankRule(), weights=weights).fitted
    rows, identifiability = fitted.rows, fitted.identifiability
    fit = _rebuild_fit(estimate, rows, identifiability, processing.noise_freedom)
    covariance = np.array(estimate.covariance)
    names = tuple(entry.name for entry in estimate.parameters)
    values = estimate.assemble(rows.names)
    correlated, ellipse = list_correlated(covariance, names), None
    if correlated:
        pair = [names.index(name) for name in correlated[0][:2]]
        chosen = [estimate.parameters[k].value for k in pair]
        ellipse = compute_ellipse(chosen, covariance[np.ix_(pair, pair)])
    refit = _measure_refit(estimate, rows.names, fitted.fit.values) if alone else None
    changed = refit is not None and refit > _CHANGED
    warnings = (build_warning("diagnosis.other-values", refit=refit),) if changed else ()
    return Diagnosis(
        singular=tuple(map(float, compute_spectrum(rows.matrix * fit.weights[:, None]).singular)),
        rank=int(identifiability.basis.shape[1]),
        correlated=correlated,
        ellipse=ellipse,
        essential=select_essential(rows, fit, identifiability, freedom=processing.noise_freedom),
        bootstrap=compute_bootstrap(rows, fit, identifiability, np.random.default_rng(seed)),
        drift=measure_drift(rows, fit, processing.noise_freedom),
        structure=analyse_structure(values, library, recordings, processing, weights=weights),
        profiles=compute_profiles(values, library, recordings, processing),
        prices=(
            *_price_estimator(estimate, rows, fit, identifiability),
            *measure_decimation_price(
                builder, recordings, identifiability, compute_mean_weights(rows, fit), weights
            ),
        ),
        refit=refit,
        notices=(*settled.notices, *warnings),
    )


def _rebuild_fit(
    estimate: Estimate, rows: Rows, identifiability: Identifiability, freedom: str = "band"
) -> RegressionFit:
    """Return the fit behind `estimate`: its values and deviations, residuals and weights on its own rows.

    Weights are ones for `ols`, and inverse to the scatter of each joint for any other estimator.
    """
    values = estimate.assemble(rows.names)
    known = {entry.name: place for place, entry in enumerate(estimate.parameters)}
    covariance = np.zeros((len(rows.names), len(rows.names)))
    places = [(k, known[name]) for k, name in enumerate(rows.names) if name in known]
    if places:
        ours, theirs = (list(index) for index in zip(*places, strict=True))
        covariance[np.ix_(ours, ours)] = np.array(estimate.covariance)[np.ix_(theirs, theirs)]
    groups = np.ones(len(rows.group_names))
    if estimate.estimator != "ols":
        groups = estimate_group_weights(rows, identifiability, freedom)
    return RegressionFit(
        values=values,
        covariance=covariance,
        residuals=rows.values - rows.matrix @ values,
        spent=count_freedom(freedom, int(identifiability.basis.shape[1]), rows.independent)[0],
        condition=estimate.condition,
        weights=groups[rows.group] * np.sqrt(rows.weight),
    )


def _measure_refit(estimate: Estimate, names: Sequence[str], values: FloatArray) -> float:
    """Return the largest difference between the estimate and the same fit made again, in its deviations."""
    again = dict(zip(names, values, strict=True))
    away = [
        abs(float(again[entry.name]) - entry.value) / max(entry.std, np.finfo(float).eps * abs(entry.value))
        for entry in estimate.parameters
        if entry.std or entry.value
    ]
    return max(away, default=0.0)


def _price_estimator(
    estimate: Estimate, rows: Rows, fit: RegressionFit, identifiability: Identifiability
) -> tuple[Price, ...]:
    """Return by how much the residual is larger than that of plain least squares of the same weights."""
    least = fit_weighted(rows, identifiability, compute_mean_weights(rows, fit))
    own, best = (float(np.linalg.norm(entry.residuals * fit.weights)) for entry in (fit, least))
    percent = 100.0 * (own / best - 1.0) if best else 0.0
    if percent < _FREE:
        return ()
    what = f"estimator {estimate.estimator} instead of least squares"
    return (Price(what=what, of="residual", percent=percent),)
