"""Diagnosis: all that a fit and its logs say beyond the parameters.

Estimate, the library of its model, the recordings of the fit -> `Diagnosis`.

    singular values, correlations, essential parameters, block bootstrap, drift between logs, structure of the
    residual, prices of what was asked of the estimator and of decimation

The equations are those of the fit: its processing, windows, weights of runs, rule for the noise. Where the
estimator needs nothing else, the fit is repeated and compared with the estimate.

The price of decimation: the logs are fitted to the rows that decimation keeps, and to every sample. Stated
deviations of both suppose white noise; which fit is better, held-out data say: each fifth of the time is
predicted by fits to the others, and what both leave of its decimated rows is compared.

Supported: estimates from torque and momentum rows, whatever the estimator; logs of any number and length.
Not supported: energy and power rows, which mix the joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    fit_rows,
    fit_weighted,
)
from symid.identification.regression import (
    Identifiability,
    LongRows,
    RowBuilder,
    Rows,
    analyse_identifiability,
    compute_spectrum,
    condense_recordings,
    count_freedom,
    stack_rows,
)
from symid.identification.rigid.fit import compute_long_covariance
from symid.identification.rigid.validation import (
    get_fit_overlap,
    get_fit_window,
    get_run_weights,
    resolve_processing,
)
from symid.logs import Recording
from symid.robot import Decimation, Processing

_FOLDS = 5
_SEEN = 1e-10
"""Singular value relative to the largest below which the other folds do not tell a direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """What something costs: `what` in words, `percent` more of `of`."""

    what: str
    of: str
    percent: float


def measure_decimation_price(
    maker: RowBuilder,
    recordings: Sequence[Recording],
    seen: Identifiability,
    groups: FloatArray,
    weights: Sequence[float] | None = None,
) -> tuple[Price, ...]:
    """Return the prices of decimation against every sample; none without it, or with too few rows to tell.

    Args:
        maker: of torque rows; its processing says how they are decimated.
        recordings: of the fit.
        seen: what they can tell.
        groups: weights (g,) of the joints.
        weights: what the squares of each recording's residuals count for; one if None.
    """
    if maker.kind != "torque" or maker.processing.decimation.factor == 1:
        return ()
    every = maker._replace(processing=replace(maker.processing, decimation=Decimation()))
    some, full = (condense_recordings(entry, recordings, weights) for entry in (maker, every))
    if some is None or full is None:
        return ()
    freedom = maker.processing.noise_freedom
    ours, theirs = (
        np.sqrt(np.maximum(np.diag(compute_long_covariance(entry, groups, freedom)), 0.0))
        for entry in (some, full)
    )
    both = (ours > 0.0) & (theirs > 0.0)
    if not both.any():
        return ()
    what = f"one row in {maker.processing.decimation.factor} against every sample"
    held_out = _compare_held_out(some, full, seen, groups)
    wider = 100.0 * (float(np.median(ours[both] / theirs[both])) - 1.0)
    return (
        Price(what=what, of="residual of held-out stretches of time", percent=held_out),
        Price(what=what, of="stated deviations, median, which suppose white noise", percent=wider),
    )


def _compare_held_out(some: LongRows, full: LongRows, seen: Identifiability, groups: FloatArray) -> float:
    """Return by how much more the fit to some of the rows leaves of held-out ones of them, in percent."""
    judged, number = _weigh(some, seen, groups)
    others, place = _weigh(full, seen, groups)
    left = np.zeros(2)
    for fold in range(_FOLDS):
        held = judged[number == fold]
        for index, table in enumerate((judged[number != fold], others[place != fold])):
            values = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=_SEEN)[0]
            left[index] += float(np.sum((held[:, -1] - held[:, :-1] @ values) ** 2))
    return 100.0 * (float(np.sqrt(left[0] / left[1])) - 1.0) if left[1] else 0.0


def _weigh(long: LongRows, seen: Identifiability, groups: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return weighted rows [A B, y] with the squares of all equations, and the fifth of time of each."""
    sketch, fold = long.sketch(), np.zeros(0, dtype=np.intp)
    for group in np.unique(sketch.group):
        count = int(np.sum(sketch.group == group))
        fold = np.concatenate([fold, np.arange(count) * _FOLDS // count])
    table = np.column_stack([sketch.matrix @ seen.basis, sketch.values]) * groups[sketch.group][:, None]
    return table, fold


_KINDS = ("torque", "momentum")
_PRICELESS = 1e-6
"""Percent below which a price is rounding."""
_ALONE = ("ols", "wls", "huber", "sequential")
"""Estimators that need nothing but rows."""
_CHANGED = 1e-6
"""Deviations by which a fit made again may differ from the estimate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagnosis:
    """What a fit and its logs tell beyond the parameters.

    Args:
        singular: of the weighted matrix with columns of length one, in falling order; the rows see `rank`.
        correlated: (name, name, correlation), the closest first; `ellipse` of the first pair.
        essential, bootstrap, drift: see there.
        structure: what explains the residual of each joint; profiles: what it is drawn against.
        prices: of the estimator against plain least squares of the same weights, and of decimation.
        refit: largest difference, in stated deviations, between the estimate and the fit made again; None
            where the estimator needs more than the logs.
        notices: what a reader should know.
    """

    singular: tuple[float, ...]
    rank: int
    correlated: tuple[tuple[str, str, float], ...]
    ellipse: Ellipse | None
    essential: Essential
    bootstrap: Bootstrap
    drift: Drift
    structure: tuple[ResidualFinding, ...]
    profiles: tuple[JointProfiles, ...]
    prices: tuple[Price, ...]
    refit: float | None = None
    notices: tuple[Notice, ...] = ()


def diagnose_estimate(
    estimate: Estimate,
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    seed: int = 0,
) -> Diagnosis:
    """Return what the recordings tell of `estimate`, which was fitted to them.

    Args:
        estimate: the result of an identification.
        library: the functions of the same model.
        recordings: those of the fit, in its order, with the settings of their runs applied.
        processing: that of the fit; what it leaves open is taken from the estimate.
        seed: of the bootstrap's draws.

    Raises:
        EstimateError: the estimate belongs to another model, or its settings cannot be read.
        UsageError: its rows mix the joints.
    """
    check_model(estimate, library.card)
    if estimate.rows not in _KINDS:
        text = f"a diagnosis looks at joints one by one, and {estimate.rows} rows mix them; use torque rows"
        raise UsageError(Notice(code="usage.mixed-rows", text=text))
    settled = resolve_processing(estimate, processing, recordings[0])
    processing, weights = settled.processing, get_run_weights(estimate.settings, len(recordings))
    window, overlap = get_fit_window(estimate.settings), get_fit_overlap(estimate.settings)
    maker = RowBuilder(estimate.rows, library, processing, window, overlap)
    rows = stack_rows([maker.prepare(entry) for entry in recordings], weights)
    seen = analyse_identifiability(rows)
    fit = rebuild_fit(estimate, rows, seen, processing.noise_freedom)
    covariance = np.array(estimate.covariance)
    names = tuple(entry.name for entry in estimate.parameters)
    values = estimate.assemble(rows.names)
    correlated = list_correlated(covariance, names)
    refit = _measure_refit(estimate, rows, seen, processing.noise_freedom)
    return Diagnosis(
        singular=tuple(map(float, compute_spectrum(rows.matrix * fit.weights[:, None]).singular)),
        rank=int(seen.basis.shape[1]),
        correlated=correlated,
        ellipse=_compute_first_ellipse(estimate, covariance, correlated),
        essential=select_essential(rows, fit, seen, freedom=processing.noise_freedom),
        bootstrap=compute_bootstrap(rows, fit, seen, np.random.default_rng(seed)),
        drift=measure_drift(rows, fit, processing.noise_freedom),
        structure=analyse_structure(values, library, recordings, processing, weights=weights),
        profiles=compute_profiles(values, library, recordings, processing),
        prices=(
            *_price_estimator(estimate, rows, fit, seen),
            *measure_decimation_price(maker, recordings, seen, compute_mean_weights(rows, fit), weights),
        ),
        refit=refit,
        notices=(*settled.notices, *_warn_of_refit(refit)),
    )


def rebuild_fit(
    estimate: Estimate, rows: Rows, seen: Identifiability, freedom: str = "band"
) -> RegressionFit:
    """Return the fit behind `estimate`: its values and deviations, residuals and weights on its own rows.

    Weights are those of ordinary least squares for `ols`, and inverse to the scatter of each joint for any
    other estimator.

    Args:
        estimate: the result.
        rows: the equations of the fit.
        seen: what they can tell.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
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
        groups = estimate_group_weights(rows, seen, freedom)
    return RegressionFit(
        values=values,
        covariance=covariance,
        residuals=rows.values - rows.matrix @ values,
        spent=count_freedom(freedom, int(seen.basis.shape[1]), rows.independent)[0],
        condition=estimate.condition,
        weights=groups[rows.group] * np.sqrt(rows.weight),
    )


def _measure_refit(estimate: Estimate, rows: Rows, seen: Identifiability, freedom: str) -> float | None:
    """Return the largest difference between the estimate and the same fit made again, in its deviations."""
    if estimate.estimator not in _ALONE:
        return None
    again = dict(zip(rows.names, fit_rows(estimate.estimator, rows, seen, freedom).values, strict=True))
    away = [
        abs(float(again[entry.name]) - entry.value) / max(entry.std, np.finfo(float).eps * abs(entry.value))
        for entry in estimate.parameters
        if entry.std or entry.value
    ]
    return max(away, default=0.0)


def _warn_of_refit(refit: float | None) -> tuple[Notice, ...]:
    if refit is None or refit <= _CHANGED:
        return ()
    text = (
        f"the logs of the fit, read again, give values that are up to {refit:.3g} standard deviations from "
        "the estimate's: a log has changed since, or the estimate was made with other options or by another "
        "version; identify again"
    )
    return (Notice(code="diagnosis.other-values", text=text),)


def _compute_first_ellipse(
    estimate: Estimate, covariance: FloatArray, correlated: tuple[tuple[str, str, float], ...]
) -> Ellipse | None:
    if not correlated:
        return None
    known = {entry.name: place for place, entry in enumerate(estimate.parameters)}
    pair = [known[name] for name in correlated[0][:2]]
    return compute_ellipse([estimate.parameters[k].value for k in pair], covariance[np.ix_(pair, pair)])


def _price_estimator(
    estimate: Estimate, rows: Rows, fit: RegressionFit, seen: Identifiability
) -> tuple[Price, ...]:
    """Return by how much plain least squares of the same weights would leave less."""
    least = fit_weighted(rows, seen, compute_mean_weights(rows, fit))
    own, best = (float(np.linalg.norm(entry.residuals * fit.weights)) for entry in (fit, least))
    percent = 100.0 * (own / best - 1.0) if best else 0.0
    if percent < _PRICELESS:
        return ()
    what = f"estimator {estimate.estimator} against least squares"
    return (Price(what=what, of="residual", percent=percent),)
