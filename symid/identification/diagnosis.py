"""Diagnosis: all that a fit and its logs tell beyond the parameters.

Input: an estimate, the library of its model, the recordings that it was fitted to. Output: `Diagnosis`.

    singular values, correlations, essential parameters, block bootstrap, drift between logs, structure of the
    residual, prices of what was asked of the estimator and of decimation

The equations are those of the fit: its processing, its windows, its weights of runs, its rule for the noise.
Where the estimator needs nothing else, the fit is made again, and compared with the estimate.

Supported: estimates from torque and momentum rows, whatever the estimator.
Not supported: energy and power rows, which mix the joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate
from symid.estimators.estimators import fit_rows
from symid.estimators.regression import Fit, find_group_weights, fit_weighted
from symid.identification.decimation_price import DecimationPrice, find_decimation_price
from symid.identification.fitted_processing import (
    find_overlap,
    find_run_weights,
    find_window,
    settle_as_fitted,
)
from symid.identification.validate import check_model
from symid.residuals.bootstrap import Bootstrap, find_bootstrap
from symid.residuals.correlation import Ellipse, find_ellipse, list_correlated
from symid.residuals.drift import Drift, find_drift, find_mean_weights
from symid.residuals.essential import Essential, find_essential
from symid.residuals.structure import Finding, JointProfiles, find_profiles, find_structure
from symid.robot.log_map import Processing
from symid.rows.identifiability import Identifiability, find_identifiability, find_spectrum
from symid.rows.long_rows import RowMaker
from symid.rows.rows import Rows, stack_rows

__all__ = ["Diagnosis", "Price", "diagnose_estimate", "rebuild_fit"]

_KINDS = ("torque", "momentum")
_PRICELESS = 1e-6
"""Percent below which a price is rounding."""
_ALONE = ("ols", "wls", "huber", "sequential")
"""Estimators that need nothing but rows."""
_CHANGED = 1e-6
"""Deviations by which a fit made again may differ from the estimate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """What something costs: `what` in words, `percent` more of `of`."""

    what: str
    of: str
    percent: float


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
    structure: tuple[Finding, ...]
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
    settled = settle_as_fitted(estimate, processing, recordings[0])
    processing, weights = settled.processing, find_run_weights(estimate.settings, len(recordings))
    window, overlap = find_window(estimate.settings), find_overlap(estimate.settings)
    maker = RowMaker(estimate.rows, library, processing, window, overlap)
    rows = stack_rows([maker.prepare(entry) for entry in recordings], weights)
    seen = find_identifiability(rows)
    fit = rebuild_fit(estimate, rows, seen, processing.noise_freedom)
    covariance = np.array(estimate.covariance)
    names = tuple(entry.name for entry in estimate.parameters)
    values = estimate.assemble(rows.names)
    correlated = list_correlated(covariance, names)
    price = find_decimation_price(maker, recordings, seen, find_mean_weights(rows, fit), weights)
    refit = _find_refit(estimate, rows, seen, processing.noise_freedom)
    return Diagnosis(
        singular=tuple(map(float, find_spectrum(rows.matrix * fit.weights[:, None]).singular)),
        rank=int(seen.basis.shape[1]),
        correlated=correlated,
        ellipse=_find_first_ellipse(estimate, covariance, correlated),
        essential=find_essential(rows, fit, seen, freedom=processing.noise_freedom),
        bootstrap=find_bootstrap(rows, fit, seen, np.random.default_rng(seed)),
        drift=find_drift(rows, fit, processing.noise_freedom),
        structure=find_structure(values, library, recordings, processing, weights=weights),
        profiles=find_profiles(values, library, recordings, processing),
        prices=(
            *_price_estimator(estimate, rows, fit, seen),
            *_price_decimation(price, processing.decimation.factor),
        ),
        refit=refit,
        notices=(*settled.notices, *_warn_of_refit(refit)),
    )


def rebuild_fit(estimate: Estimate, rows: Rows, seen: Identifiability, freedom: str = "band") -> Fit:
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
        groups = find_group_weights(rows, seen, freedom)
    return Fit(
        values=values,
        covariance=covariance,
        residuals=rows.values - rows.matrix @ values,
        spent=1 if freedom == "one" else int(seen.basis.shape[1]),
        condition=estimate.condition,
        weights=groups[rows.group] * np.sqrt(rows.weight),
    )


def _find_refit(estimate: Estimate, rows: Rows, seen: Identifiability, freedom: str) -> float | None:
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


def _find_first_ellipse(
    estimate: Estimate, covariance: FloatArray, correlated: tuple[tuple[str, str, float], ...]
) -> Ellipse | None:
    if not correlated:
        return None
    known = {entry.name: place for place, entry in enumerate(estimate.parameters)}
    pair = [known[name] for name in correlated[0][:2]]
    return find_ellipse([estimate.parameters[k].value for k in pair], covariance[np.ix_(pair, pair)])


def _price_estimator(estimate: Estimate, rows: Rows, fit: Fit, seen: Identifiability) -> tuple[Price, ...]:
    """Return by how much plain least squares of the same weights would leave less."""
    least = fit_weighted(rows, seen, find_mean_weights(rows, fit))
    own, best = (float(np.linalg.norm(entry.residuals * fit.weights)) for entry in (fit, least))
    percent = 100.0 * (own / best - 1.0) if best else 0.0
    if percent < _PRICELESS:
        return ()
    what = f"estimator {estimate.estimator} against least squares"
    return (Price(what=what, of="residual", percent=percent),)


def _price_decimation(found: DecimationPrice | None, factor: int) -> tuple[Price, ...]:
    if found is None:
        return ()
    what = f"one row in {factor} against every sample"
    return (
        Price(what=what, of="residual of held-out stretches of time", percent=found.held_out),
        Price(what=what, of="stated deviations, median, which suppose white noise", percent=found.deviations),
    )
