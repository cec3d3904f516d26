"""All linear estimators under their names; those that are robust, have a prior, or go joint by joint.

Rows, what can be identified from them, options -> RegressionFit.

    ridge       min sum_j |A_j x - y_j|^2 / sigma_j^2 + w sum_k ((x_k - x0_k) / d_k)^2
    huber       min sum rho(e_i / s_i),  rho(u) = u^2 / 2 for |u| <= k, else k |u| - k^2 / 2,  k = 1.345
    sequential  joint after joint, from the last to the first

Ridge: sigma_j as for wls, x0 and d a prior; the covariance is (A' S^-1 A + w D^-2)^-1. By default w is chosen
by cross validation over contiguous blocks of each run.

Huber (1964), by iterated weights min(1, k / |u|); s_i is 1.4826 times the median of |e| of the joint. The
covariance is V (F'F)^-1, F the rows over s_i (Huber 1981, 7.6), psi(u) = u min(1, k / |u|):

    V = K^2 [sum psi^2 / (b m - p)] / (mean psi')^2,    K = 1 + p (1 - mean psi') / (m mean psi')

Sequential: the torque of a joint depends only on the links that it carries. What its rows determine well
(singular value above a thousandth of the largest) is kept, the rest waits for the joints before. With B_j the
map from the rows of joint j to x,

    e <- (1 - B_j A_j) e + B_j noise_j,      C <- (1 - B_j A_j) C (1 - B_j A_j)' + s_j^2 B_j B_j'

Not supported: priors with correlations; wrong states (leverage); least variance of `sequential`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from symid.arrays import FloatArray
from symid.codegen import ModelCard
from symid.errors import Notice, UsageError
from symid.identification import regression
from symid.identification.estimators import least_squares
from symid.identification.estimators.consistent import fit_consistent
from symid.identification.estimators.estimate import Estimate
from symid.identification.estimators.least_squares import RegressionFit
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import Identifiability, Rows

_SMALL = 0.1
"""Part of the root mean square of the values in one unit that counts as the size of a smaller one."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Values and standard deviations of named parameters in SI units; `source` says where from, in words."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    source: str

    def arrange(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return values and deviations (p,) in the order of `names`; 0 and infinite where unknown."""
        known = {name: pair for name, *pair in zip(self.names, self.values, self.deviations, strict=True)}
        pairs = np.array([known.get(name, [0.0, np.inf]) for name in names], dtype=np.float64)
        return pairs[:, 0], pairs[:, 1]


def build_prior_of_card(card: ModelCard, fraction: float) -> Prior:
    """Return the values that the robot file states, each known to `fraction` of its size.

    The size of a value that is smaller than a tenth of the root mean square of those in its unit is that
    tenth: a first moment that a drawing has at zero is not known exactly.
    """
    stated = [entry for entry in (*card.beta, *card.friction) if entry.value is not None]
    if not stated:
        text = f"the robot file of {card.robot!r} states no values for a prior: give inertial parameters "
        text += "there, or an estimate as --prior FILE"
        raise UsageError(Notice(code="usage.no-prior", text=text))
    values = np.array([float(entry.value or 0.0) for entry in stated])
    units = np.array([entry.unit for entry in stated])
    usual = np.array([np.sqrt(np.mean(values[units == unit] ** 2)) for unit in units])
    sizes = np.maximum(np.abs(values), _SMALL * usual)
    # Where all values of a unit are zero there is no size, and no prior.
    deviations = tuple(np.where(sizes > 0.0, fraction * sizes, np.inf).tolist())
    source = f"robot file, each known to {100.0 * fraction:g} %"
    return Prior(tuple(entry.name for entry in stated), tuple(values.tolist()), deviations, source)


def build_prior_of_estimate(estimate: Estimate, factor: float) -> Prior:
    """Return the values of an estimate, known to `factor` times their standard deviations."""
    known = estimate.parameters
    names, values = tuple(entry.name for entry in known), tuple(entry.value for entry in known)
    source = f"estimate of {', '.join(estimate.sources)}, its standard deviations times {factor:g}"
    return Prior(names, values, tuple(factor * entry.std for entry in known), source)


PRIOR_WEIGHTS = tuple(float(10.0 ** (0.5 * k)) for k in range(-12, 13))
"""Weights of the prior that are tried, besides zero."""


def fit_ridge(
    rows: Rows,
    identifiability: Identifiability,
    freedom: str = "band",
    *,
    prior: Prior | None = None,
    prior_weight: float | None = None,
) -> RegressionFit:
    """Return the fit near a prior, as `fit_ols`; `prior_weight` None is chosen by cross validation."""
    if prior is None:
        text = "the estimator ridge needs a prior: the robot file's values, or an estimate"
        raise UsageError(Notice(code="usage.no-prior", text=text))
    inverse_scatter = least_squares.estimate_group_weights(rows, identifiability, freedom)
    first = least_squares.fit_weighted(rows, identifiability, inverse_scatter, freedom)
    _, independent = regression.count_freedom(freedom, first.spent, rows.independent)
    # Rows behind a filter count for as many as they are worth, next to the prior.
    inverse_scatter = inverse_scatter * np.sqrt(independent)
    centre, deviations = prior.arrange(rows.names)
    known = np.isfinite(deviations)
    # The prior as rows (x - x0) / d, [D | D x0].
    pull = np.column_stack([np.eye(len(centre)), centre])[known] / deviations[known, None]
    scores: dict[float, float] = {}
    weight = prior_weight
    if weight is None:
        # Weighted squared residuals of held-out blocks, equal spans of time of each run.
        block = np.zeros(len(rows.values), dtype=np.intp)
        for run in np.unique(rows.run):
            members = rows.run == run
            time = rows.time[members]
            start, span = float(time.min()), float(np.ptp(time)) or 1.0
            place = (POLICY.folds * (time - start) / span).astype(np.intp)
            block[members] = np.minimum(place, POLICY.folds - 1)
        parts = [regression.condense_weighted(rows, rows.weight * (block == k)) for k in range(POLICY.folds)]
        triangles = [regression.stack_condensed(part, inverse_scatter) for part in parts]
        scores = dict.fromkeys((0.0, *PRIOR_WEIGHTS), 0.0)
        for k, held_out in enumerate(parts):
            others = np.vstack([triangle for j, triangle in enumerate(triangles) if j != k])
            train = regression.extend_triangle(np.zeros((0, others.shape[1])), [others])
            for tried in scores:
                values, _ = _solve_ridge(train, pull, tried)
                scores[tried] += float(regression.compute_square_sums(held_out, values) @ inverse_scatter**2)
        weight = min(scores, key=lambda entry: scores[entry])
    whole = float(np.sum((rows.values * inverse_scatter[rows.group]) ** 2 * rows.weight))
    triangle = regression.stack_condensed(regression.condense_rows(rows), inverse_scatter)
    values, root = _solve_ridge(triangle, pull, weight)
    return replace(
        first,
        values=values,
        covariance=root @ root.T,
        residuals=rows.values - rows.matrix @ values,
        weights=inverse_scatter[rows.group] * np.sqrt(rows.weight),
        report={
            "prior": prior.source,
            "prior_weight": weight,
            "prior_weight_chosen": bool(scores),
            # Residual of the held-out blocks, relative to their weighted torque, for each weight.
            "predicted_percent": [(one, 100.0 * math.sqrt(score / whole)) for one, score in scores.items()],
        },
    )


def _solve_ridge(triangle: FloatArray, pull: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
    """Return x (p,) and the root (p, p) of (A'A + w D^2)^+; unobservable directions stay at zero."""
    rows = np.vstack([triangle, np.sqrt(weight) * pull])
    whole = regression.extend_triangle(np.zeros((0, triangle.shape[1])), [rows])
    matrix, target = whole[:, :-1], whole[:, -1]
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
    left, singular, right = np.linalg.svd(matrix * scales, full_matrices=False)
    kept = singular > numerics.RANK * singular[0]
    root = scales[:, None] * (right[kept].T / singular[kept])
    return root @ (left[:, kept].T @ target), root


_BEND = 1.345


def fit_huber(rows: Rows, identifiability: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the robust fit; arguments as for `fit_ols`."""
    first = least_squares.fit_ols(rows, identifiability, freedom)
    basis, values, residuals = identifiability.basis, first.values, first.residuals
    scale, change, steps = _estimate_scale(rows, residuals), np.inf, 0
    # The scatter follows the residuals; where that does not end, it is held, so that the loss only falls.
    while steps < 2 * numerics.ROUNDS and change > numerics.CONVERGED:
        scale = _estimate_scale(rows, residuals) if steps < numerics.ROUNDS else scale
        weight = _BEND / np.maximum(np.abs(residuals) / scale[rows.group], _BEND) * rows.weight
        found = regression.solve_condensed(regression.condense_weighted(rows, weight), basis, 1.0 / scale)
        size = np.sqrt(np.maximum(np.sum(found.root**2, axis=1), np.finfo(float).tiny))
        change = float(np.abs((found.values - values) / size).max())
        values, steps = found.values, steps + 1
        residuals = rows.values - rows.matrix @ values
    plain = regression.solve_condensed(regression.condense_rows(rows), basis, 1.0 / scale)
    ratios, count = residuals / scale[rows.group], len(residuals)
    taken, independent = regression.count_freedom(freedom, plain.leverage, rows.independent)
    spent = float(taken.sum())
    inner = float(np.mean(np.abs(ratios) <= _BEND))
    stretch = 1.0 + spent * (1.0 - inner) / (count * inner)
    square = float(np.clip(ratios, -_BEND, _BEND) ** 2 @ rows.weight)
    variance = stretch**2 * square / (independent * (count - spent)) / inner**2
    text = f"the robust fit did not converge: after {steps} iterations it still changes by {change:.2g} "
    text += "standard deviations; a residual with two levels is not one with outliers, look at the residual "
    text += "plots"
    return replace(
        first,
        values=values,
        covariance=variance * (plain.root @ plain.root.T),
        residuals=residuals,
        spent=taken,
        condition=plain.condition,
        weights=np.sqrt(_BEND / np.maximum(np.abs(ratios), _BEND) * rows.weight) / scale[rows.group],
        notices=(Notice(code="identify.huber-not-converged", text=text),)
        if change > numerics.CONVERGED
        else (),
        report={"outliers_percent": 100.0 * float(np.mean(np.abs(ratios) > _BEND)), "iterations": steps},
    )


def _estimate_scale(rows: Rows, residuals: FloatArray) -> FloatArray:
    """Return the scatter (g,) of each group, insensitive to outliers; never quite zero."""
    floor = numerics.RANK * float(np.linalg.norm(rows.values)) / np.sqrt(len(rows.values))
    scale = np.full(len(rows.group_names), floor)
    for index in np.unique(rows.group):
        middle = float(np.median(np.abs(residuals[rows.group == index])))
        # Of normal errors half are within the quantile of three quarters.
        scale[index] = max(middle / float(scipy.special.ndtri(0.75)), floor)
    return scale


_WELL_DETERMINED = 1e-3


def fit_sequential(rows: Rows, identifiability: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the fit joint by joint, as `fit_ols`; raise UsageError for rows that sum over the joints."""
    if rows.kind in regression.SCALAR_KINDS:
        text = f"{rows.kind} equations sum over the joints"
        text += "; for joint by joint use torque, momentum or filtered ones"
        raise UsageError(Notice(code="usage.sequential-rows", text=text))
    condensed = regression.condense_rows(rows)
    together = least_squares.fit_wls(rows, identifiability, freedom)
    _, independent = regression.count_freedom(freedom, together.spent, condensed.independent)
    count = len(rows.names)
    # Joint by joint its triangle, how many independent rows it has, and what counts as well determined.
    stages = [
        (rows.group_names[joint], condensed.factors[joint], int(condensed.counts[joint]), _WELL_DETERMINED)
        for joint in range(len(rows.group_names) - 1, -1, -1)
        if condensed.counts[joint]
    ]
    # What no joint determines well on its own.
    weights = least_squares.estimate_group_weights(rows, identifiability, freedom)
    stages.append(("all together", regression.stack_condensed(condensed, weights), len(rows.values), 0.0))
    # x and its covariance so far, and the directions (p, k) that are still open.
    values, covariance, unknown = np.zeros(count), np.zeros((count, count)), identifiability.basis
    order: list[dict[str, object]] = []
    for name, triangle, number, least in stages:
        if not unknown.shape[1]:
            break
        matrix, target = triangle[:, :-1], triangle[:, -1]
        left, singular, right = np.linalg.svd(matrix @ unknown)
        determined = np.zeros(unknown.shape[1], dtype=bool)
        determined[: len(singular)] = singular > least * singular[0]
        size = int(determined.sum())
        step = unknown @ (right[determined].T / singular[:size]) @ left[:, :size].T
        values = values + step @ (target - matrix @ values)
        square = float(np.sum((target - matrix @ values) ** 2))
        through = np.eye(count) - step @ matrix
        variance = square / (independent * number - size)
        covariance = through @ covariance @ through.T + variance * (step @ step.T)
        unknown = unknown @ right[~determined].T
        order.append({"joint": name, "directions": size})
    residuals, report = rows.values - rows.matrix @ values, {"order": order}
    return replace(together, values=values, covariance=covariance, residuals=residuals, report=report)


ESTIMATORS: Mapping[str, Callable[..., RegressionFit]] = {
    "ols": least_squares.fit_ols,
    "wls": least_squares.fit_wls,
    "gls": least_squares.fit_gls,
    "huber": fit_huber,
    "ridge": fit_ridge,
    "consistent": fit_consistent,
    "sequential": fit_sequential,
}
"""All take rows, what can be identified from them and `freedom`; gls `noise`, ridge `prior` and
`prior_weight`, consistent `bodies` as well."""
