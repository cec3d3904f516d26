"""Diagnosis: all that a fit and its logs tell beyond the parameters.

Input: an estimate, the library of its model, the recordings that it was fitted to. Output: `Diagnosis`.

    singular values, correlations, essential parameters, block bootstrap, drift between logs, structure of the
    residual, prices of what was asked of the estimator and of decimation

Supported: estimates from torque and momentum rows, whatever the estimator.
Not supported: energy and power rows, which mix the joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.data.signals import settle_processing
from symid.errors import Notice, UsageError
from symid.identification.bootstrap import Bootstrap, find_bootstrap
from symid.identification.correlation import Ellipse, find_ellipse, list_correlated
from symid.identification.drift import Drift, find_drift
from symid.identification.essential import Essential, find_essential
from symid.identification.estimate import Estimate
from symid.identification.identifiability import Identifiability, find_identifiability, find_spectrum
from symid.identification.preparation import prepare_rows
from symid.identification.regression import Fit, find_group_weights, fit_weighted
from symid.identification.rows import WINDOW, Rows, stack_rows
from symid.identification.structure import Finding, JointProfiles, find_profiles, find_structure
from symid.identification.validate import check_model, find_window
from symid.robot.log_map import Decimation, Processing

__all__ = ["Diagnosis", "Price", "diagnose_estimate", "rebuild_fit"]

_KINDS = ("torque", "momentum")
_PRICELESS = 1e-6
"""Percent below which a price is rounding."""


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
        recordings: those of the fit, in its order.
        processing: that of the fit.
        seed: of the bootstrap's draws.

    Raises:
        EstimateError: the estimate belongs to another model.
        UsageError: its rows mix the joints.
    """
    check_model(estimate, library.card)
    if estimate.rows not in _KINDS:
        text = f"a diagnosis looks at joints one by one, and {estimate.rows} rows mix them; use torque rows"
        raise UsageError(Notice(code="usage.mixed-rows", text=text))
    processing = settle_processing(processing, recordings[0].period)
    window = find_window(estimate.settings)
    rows = stack_rows(
        [prepare_rows(estimate.rows, library, entry, processing, window=window) for entry in recordings]
    )
    seen = find_identifiability(rows)
    fit = rebuild_fit(estimate, rows, seen)
    covariance = np.array(estimate.covariance)
    names = tuple(entry.name for entry in estimate.parameters)
    values = estimate.assemble(rows.names)
    correlated = list_correlated(covariance, names)
    return Diagnosis(
        singular=tuple(map(float, find_spectrum(rows.matrix * fit.weights[:, None]).singular)),
        rank=int(seen.basis.shape[1]),
        correlated=correlated,
        ellipse=_find_first_ellipse(estimate, covariance, correlated),
        essential=find_essential(rows, fit, seen),
        bootstrap=find_bootstrap(rows, fit, seen, np.random.default_rng(seed)),
        drift=find_drift(rows, fit),
        structure=find_structure(values, library, recordings, processing),
        profiles=find_profiles(values, library, recordings, processing),
        prices=(
            *_price_estimator(estimate, rows, fit, seen),
            *_price_decimation(rows, fit, library, recordings, processing),
        ),
    )


def rebuild_fit(estimate: Estimate, rows: Rows, seen: Identifiability) -> Fit:
    """Return the fit behind `estimate`: its values and deviations, residuals and weights on its own rows.

    Weights are those of ordinary least squares for `ols`, and inverse to the scatter of each joint for any
    other estimator.
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
        groups = find_group_weights(rows, seen)
    return Fit(
        values=values,
        covariance=covariance,
        residuals=rows.values - rows.matrix @ values,
        spent=int(seen.basis.shape[1]),
        condition=estimate.condition,
        weights=groups[rows.group] * np.sqrt(rows.weight),
    )


def _find_first_ellipse(
    estimate: Estimate, covariance: FloatArray, correlated: tuple[tuple[str, str, float], ...]
) -> Ellipse | None:
    if not correlated:
        return None
    known = {entry.name: place for place, entry in enumerate(estimate.parameters)}
    pair = [known[name] for name in correlated[0][:2]]
    return find_ellipse([estimate.parameters[k].value for k in pair], covariance[np.ix_(pair, pair)])


def _find_weights(rows: Rows, fit: Fit) -> FloatArray:
    """Return the mean weight of each group's rows (g,)."""
    return np.array(
        [
            float(fit.weights[rows.group == group].mean()) if np.any(rows.group == group) else 1.0
            for group in range(len(rows.group_names))
        ]
    )


def _price_estimator(estimate: Estimate, rows: Rows, fit: Fit, seen: Identifiability) -> tuple[Price, ...]:
    """Return by how much plain least squares of the same weights would leave less."""
    least = fit_weighted(rows, seen, _find_weights(rows, fit))
    own, best = (float(np.linalg.norm(entry.residuals * fit.weights)) for entry in (fit, least))
    percent = 100.0 * (own / best - 1.0) if best else 0.0
    if percent < _PRICELESS:
        return ()
    what = f"estimator {estimate.estimator} against least squares"
    return (Price(what=what, of="residual", percent=percent),)


def _price_decimation(
    rows: Rows, fit: Fit, library: Library, recordings: Sequence[Recording], processing: Processing
) -> tuple[Price, ...]:
    """Return by how much stated deviations are larger than those of a fit to every sample."""
    factor = processing.decimation.factor
    if rows.kind != "torque" or factor == 1:
        return ()
    every = replace(processing, decimation=Decimation())
    full = stack_rows([prepare_rows("torque", library, entry, every, window=WINDOW) for entry in recordings])
    other = fit_weighted(full, find_identifiability(full), _find_weights(rows, fit))
    ours, theirs = (np.sqrt(np.maximum(np.diag(entry.covariance), 0.0)) for entry in (fit, other))
    both = (ours > 0.0) & (theirs > 0.0)
    if not both.any():
        return ()
    percent = 100.0 * (float(np.median(ours[both] / theirs[both])) - 1.0)
    what = f"one row in {factor} against every sample"
    return (Price(what=what, of="deviations, median", percent=percent),)
