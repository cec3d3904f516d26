"""All linear estimators under their names; those that are robust, have a prior, or go joint by joint.

Rows, what can be identified from them, options -> RegressionFit.

    ridge       min sum_j |A_j x - y_j|^2 / sigma_j^2 + w sum_k ((x_k - x0_k) / d_k)^2
    huber       min sum rho(e_i / s_i),  rho(u) = u^2 / 2 for |u| <= k, else k |u| - k^2 / 2,  k = 1.345
    sequential  joint after joint, from the last to the first

Ridge: sigma_j as for wls; x0 and d are a prior, from the values of a model card (CAD data of the robot
file) or from an estimate. It is the most probable x where noise and prior are normal and the deviations of
the prior are d / sqrt(w); the covariance is (A' S^-1 A + w D^-2)^-1. By default w is chosen by cross
validation over contiguous blocks of each run.

Huber (1964), by iterated weights min(1, k / |u|); s_i is 1.4826 times the median of |e| of the joint. With
normal noise it is 95 % efficient. The covariance is V (F'F)^-1, F the rows over s_i, with (Huber 1981,
7.6), psi(u) = u min(1, k / |u|),

    V = K^2 [sum psi^2 / (b m - p)] / (mean psi')^2,    K = 1 + p (1 - mean psi') / (m mean psi')

Sequential: the torque of a joint depends on the links that it carries and on no others, so the rows of the
last joint give its own parameters alone, with these known those of the joint before give theirs, and so on
to the base. What the rows of a joint determine well (singular value, columns scaled to length one, above a
thousandth of the largest) is found once and kept; the rest waits for the joints before. With B_j the map
from the rows of joint j to x,

    e <- (1 - B_j A_j) e + B_j noise_j,      C <- (1 - B_j A_j) C (1 - B_j A_j)' + s_j^2 B_j B_j'

Supported: any estimator with any kind of rows, what does not go together is refused; priors of some
parameters; outliers in the torque, contacts that last a small part of the log; serial arms and trees.
Not supported: priors with correlations; wrong states (leverage); least variance of `sequential`: it is a
check on wls, and a method for arms whose joints were recorded one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import ModelCard
from symid.errors import Notice, UsageError
from symid.identification.estimators.consistent import Bodies, fit_consistent
from symid.identification.estimators.estimate import Estimate
from symid.identification.estimators.least_squares import (
    RegressionFit,
    estimate_group_weights,
    fit_gls,
    fit_ols,
    fit_wls,
)
from symid.identification.regression import (
    SCALAR_KINDS,
    Identifiability,
    Rows,
    compute_square_sums,
    condense_rows,
    condense_weighted,
    count_freedom,
    extend_triangle,
    solve_condensed,
    stack_condensed,
)

_SMALL = 0.1
"""Part of the root mean square of the values in one unit that counts as the size of a smaller one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Values and standard deviations of named parameters in SI units; `source` says whence, in words."""

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

    Raises:
        UsageError: the robot file states none.
    """
    stated = [entry for entry in (*card.beta, *card.friction) if entry.value is not None]
    if not stated:
        text = (
            f"the robot file of {card.robot!r} states no values to stay near to: give inertial parameters "
            "there, or an estimate as --prior FILE"
        )
        raise UsageError(Notice(code="usage.no-prior", text=text))
    values = np.array([float(entry.value or 0.0) for entry in stated])
    units = np.array([entry.unit for entry in stated])
    usual = np.array([np.sqrt(np.mean(values[units == unit] ** 2)) for unit in units])
    sizes = np.maximum(np.abs(values), _SMALL * usual)
    # Where all values of a unit are zero nothing tells a size: nothing is known of these.
    deviations = np.where(sizes > 0.0, fraction * sizes, np.inf)
    return Prior(
        names=tuple(entry.name for entry in stated),
        values=tuple(values.tolist()),
        deviations=tuple(deviations.tolist()),
        source=f"robot file, each known to {100.0 * fraction:g} %",
    )


def build_prior_of_estimate(estimate: Estimate, factor: float = 1.0) -> Prior:
    """Return the values of an estimate, known to `factor` times their standard deviations."""
    return Prior(
        names=tuple(entry.name for entry in estimate.parameters),
        values=tuple(entry.value for entry in estimate.parameters),
        deviations=tuple(factor * entry.std for entry in estimate.parameters),
        source=f"estimate of {', '.join(estimate.sources)}, its deviations times {factor:g}",
    )


PRIOR_WEIGHTS = tuple(float(10.0 ** (0.5 * k)) for k in range(-12, 13))
"""Weights of the prior that are tried, and none at all."""
_BLOCKS = 5


def fit_ridge(
    rows: Rows,
    seen: Identifiability,
    freedom: str = "band",
    *,
    prior: Prior,
    weight: float | None = None,
) -> RegressionFit:
    """Return the fit near a prior.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        prior: what was known before.
        weight: of the prior, not negative; None to choose it by cross validation.
    """
    first = fit_ols(rows, seen, freedom)
    _, independent = count_freedom(freedom, first.spent, rows.independent)
    # Rows behind a filter count for as many as they are worth, next to the prior.
    inverse_scatter = estimate_group_weights(rows, seen, freedom) * np.sqrt(independent)
    centre, deviations = prior.arrange(rows.names)
    known = np.isfinite(deviations)
    # The prior as rows: (x - x0) / d for the parameters that have a finite deviation, [D | D x0].
    pull = np.column_stack([np.eye(len(centre)), centre])[known] / deviations[known, None]
    scores: dict[float, float] = {}
    if weight is None:
        scores = _score_weights(rows, pull, inverse_scatter)
        weight = min(scores, key=lambda entry: scores[entry])
    whole = float(np.sum((rows.values * inverse_scatter[rows.group]) ** 2 * rows.weight))
    triangle = stack_condensed(condense_rows(rows), inverse_scatter)
    values, root = _solve_ridge(triangle, pull, weight)
    residuals = rows.values - rows.matrix @ values
    weights = inverse_scatter[rows.group] * np.sqrt(rows.weight)
    return RegressionFit(
        values=values,
        covariance=root @ root.T,
        residuals=residuals,
        spent=first.spent,
        condition=first.condition,
        weights=weights,
        report={
            "prior": prior.source,
            "prior_weight": weight,
            "prior_weight_chosen": bool(scores),
            # What is left of the weighted torque of the held-out blocks, for each weight.
            "foretold_percent": [
                (entry, 100.0 * float(np.sqrt(score / whole))) for entry, score in scores.items()
            ],
        },
    )


def _solve_ridge(triangle: FloatArray, pull: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
    """Return x (p,) and the root (p, p) of (A'A + w D^2)^+; directions that nothing tells stay at zero."""
    whole = extend_triangle(np.zeros((0, triangle.shape[1])), [np.vstack([triangle, np.sqrt(weight) * pull])])
    matrix, target = whole[:, :-1], whole[:, -1]
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    left, singular, right = np.linalg.svd(matrix * scales, full_matrices=False)
    told = singular > 1e-9 * singular[0]
    root = scales[:, None] * (right[told].T / singular[told])
    return root @ (left[:, told].T @ target), root


def _score_weights(rows: Rows, pull: FloatArray, inverse_scatter: FloatArray) -> dict[float, float]:
    """Return the weighted squares of blocks foretold by the others, for every weight."""
    block = _cut_runs(rows)
    parts = [condense_weighted(rows, rows.weight * (block == k)) for k in range(_BLOCKS)]
    triangles = [stack_condensed(part, inverse_scatter) for part in parts]
    size = triangles[0].shape[1]
    scores = dict.fromkeys((0.0, *PRIOR_WEIGHTS), 0.0)
    for k, held_out in enumerate(parts):
        others = np.vstack([triangle for j, triangle in enumerate(triangles) if j != k])
        train = extend_triangle(np.zeros((0, size)), [others])
        for weight in scores:
            values, _ = _solve_ridge(train, pull, weight)
            scores[weight] += float(compute_square_sums(held_out, values) @ inverse_scatter**2)
    return scores


def _cut_runs(rows: Rows) -> NDArray[np.intp]:
    """Return in which of the blocks a row is: equal spans of time of its run, in order."""
    block = np.zeros(len(rows.values), dtype=np.intp)
    for run in np.unique(rows.run):
        members = rows.run == run
        time = rows.time[members]
        first, span = float(time.min()), float(np.ptp(time)) or 1.0
        block[members] = np.minimum((_BLOCKS * (time - first) / span).astype(np.intp), _BLOCKS - 1)
    return block


_BEND = 1.345
_NORMAL = 1.4826
_LIMIT = 100
_FOLLOWED = 10
"""Iterations in which the scatter follows the residuals; held afterwards, the sum of losses only falls."""
_SETTLED = 1e-6
"""Change of the parameters, in standard deviations, below which the iteration ends."""


def fit_huber(rows: Rows, seen: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the robust fit; arguments as for `fit_ols`."""
    first = fit_ols(rows, seen, freedom)
    values, residuals, spent = first.values, first.residuals, first.spent
    scale, change, steps = _estimate_scale(rows, residuals), np.inf, 0
    while steps < _LIMIT and change > _SETTLED:
        scale = _estimate_scale(rows, residuals) if steps < _FOLLOWED else scale
        weight = _compute_huber_weights(residuals, scale[rows.group]) * rows.weight
        found = solve_condensed(condense_weighted(rows, weight), seen.basis, 1.0 / scale)
        size = np.sqrt(np.maximum(np.sum(found.root**2, axis=1), np.finfo(float).tiny))
        change = float(np.abs((found.values - values) / size).max())
        values, steps = found.values, steps + 1
        residuals = rows.values - rows.matrix @ values
    plain = solve_condensed(condense_rows(rows), seen.basis, 1.0 / scale)
    ratios = residuals / scale[rows.group]
    return RegressionFit(
        values=values,
        covariance=_compute_huber_variance(rows, ratios, spent, freedom) * (plain.root @ plain.root.T),
        residuals=residuals,
        spent=spent,
        condition=plain.condition,
        weights=np.sqrt(_compute_huber_weights(ratios, np.ones(len(ratios))) * rows.weight)
        / scale[rows.group],
        notices=() if change <= _SETTLED else (_say_unsettled(change),),
        report={"outliers_percent": 100.0 * float(np.mean(np.abs(ratios) > _BEND)), "iterations": steps},
    )


def _estimate_scale(rows: Rows, residuals: FloatArray) -> FloatArray:
    """Return the scatter (g,) of each group that outliers do not move; never quite zero."""
    floor = 1e-9 * float(np.linalg.norm(rows.values)) / np.sqrt(len(rows.values))
    scale = np.full(len(rows.group_names), floor)
    for index in np.unique(rows.group):
        middle = float(np.median(np.abs(residuals[rows.group == index])))
        scale[index] = max(_NORMAL * middle, floor)
    return scale


def _compute_huber_weights(residuals: FloatArray, scale: FloatArray) -> FloatArray:
    weights: FloatArray = _BEND / np.maximum(np.abs(residuals) / scale, _BEND)
    return weights


def _compute_huber_variance(rows: Rows, ratios: FloatArray, spent: int, freedom: str) -> float:
    count = len(ratios)
    _, independent = count_freedom(freedom, spent, rows.independent)
    psi = np.clip(ratios, -_BEND, _BEND)
    inner = float(np.mean(np.abs(ratios) <= _BEND))
    stretch = 1.0 + spent * (1.0 - inner) / (independent * count * inner)
    return stretch**2 * float(psi**2 @ rows.weight) / (independent * count - spent) / inner**2


def _say_unsettled(change: float) -> Notice:
    text = (
        f"the robust fit still moved by {change:.2g} standard deviations after {_LIMIT} iterations: a joint "
        "whose residual jumps between two levels is no joint with outliers; look at the residual plots"
    )
    return Notice(code="identify.huber-unsettled", text=text)


_WELL_DETERMINED = 1e-3


def fit_sequential(rows: Rows, seen: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the fit joint by joint; arguments as for `fit_ols`.

    Raises:
        UsageError: the rows have one equation for all joints.
    """
    if rows.kind in SCALAR_KINDS:
        text = f"{rows.kind} rows add up all joints: joint by joint takes torque, momentum or filtered rows"
        raise UsageError(Notice(code="usage.sequential-rows", text=text))
    condensed, together = condense_rows(rows), fit_wls(rows, seen, freedom)
    _, independent = count_freedom(freedom, together.spent, condensed.independent)
    state = _KnownParameters(
        np.zeros(len(rows.names)), np.zeros((len(rows.names), len(rows.names))), seen.basis
    )
    order: list[dict[str, object]] = []
    for joint in range(len(rows.group_names) - 1, -1, -1):
        if not condensed.counts[joint]:
            continue
        before = state.unknown.shape[1]
        state = _add_rows(
            state, condensed.factors[joint], independent * int(condensed.counts[joint]), _WELL_DETERMINED
        )
        order.append({"joint": rows.group_names[joint], "directions": before - state.unknown.shape[1]})
    if state.unknown.shape[1]:
        # What no joint tells well on its own.
        whole = stack_condensed(condensed, estimate_group_weights(rows, seen, freedom))
        order.append({"joint": "all together", "directions": state.unknown.shape[1]})
        state = _add_rows(state, whole, independent * len(rows.values), 0.0)
    return RegressionFit(
        values=state.values,
        covariance=state.covariance,
        residuals=rows.values - rows.matrix @ state.values,
        spent=together.spent,
        condition=together.condition,
        weights=together.weights,
        report={"order": order},
    )


class _KnownParameters(NamedTuple):
    """What is known so far: x (p,), its covariance (p, p), and the directions (p, k) still open."""

    values: FloatArray
    covariance: FloatArray
    unknown: FloatArray


def _add_rows(state: _KnownParameters, triangle: FloatArray, count: float, least: float) -> _KnownParameters:
    """Return the state after what a triangle [A y] of `count` independent rows tells well."""
    matrix, target = triangle[:, :-1], triangle[:, -1]
    left, singular, right = np.linalg.svd(matrix @ state.unknown)
    told = np.zeros(state.unknown.shape[1], dtype=bool)
    told[: len(singular)] = singular > least * singular[0]
    size = int(told.sum())
    step = state.unknown @ (right[told].T / singular[:size]) @ left[:, :size].T
    values = state.values + step @ (target - matrix @ state.values)
    square = float(np.sum((target - matrix @ values) ** 2))
    through = np.eye(len(values)) - step @ matrix
    covariance = through @ state.covariance @ through.T + square / (count - size) * (step @ step.T)
    return _KnownParameters(values, covariance, state.unknown @ right[~told].T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EstimatorOptions:
    """What estimators need besides rows; each reads its own.

    `prior` and `prior_weight` (None to choose it) are those of ridge; `bodies` of consistent; `noise` (g, g)
    the covariance of the noise between joints for gls, None to estimate it.
    """

    prior: Prior | None = None
    prior_weight: float | None = None
    bodies: Bodies | None = None
    noise: FloatArray | None = None


ESTIMATORS = ("ols", "wls", "gls", "huber", "ridge", "consistent", "sequential")


def fit_rows(
    estimator: str,
    rows: Rows,
    seen: Identifiability,
    freedom: str = "band",
    options: EstimatorOptions | None = None,
) -> RegressionFit:
    """Return the fit of the estimator called `estimator`, one of `ESTIMATORS`.

    Raises:
        UsageError: it does not fit the rows, or lacks an option.
        SolverError: it found no optimum.
    """
    options = options or EstimatorOptions()
    match estimator:
        case "wls":
            return fit_wls(rows, seen, freedom)
        case "gls":
            return fit_gls(rows, seen, freedom, options.noise)
        case "huber":
            return fit_huber(rows, seen, freedom)
        case "sequential":
            return fit_sequential(rows, seen, freedom)
        case "ridge":
            if options.prior is None:
                text = (
                    "the estimator ridge stays near a prior: name one, the robot file's values or an estimate"
                )
                raise UsageError(Notice(code="usage.no-prior", text=text))
            return fit_ridge(rows, seen, freedom, prior=options.prior, weight=options.prior_weight)
        case "consistent":
            if options.bodies is None:
                text = "the estimator consistent needs the bodies of the robot: give them in the options"
                raise UsageError(Notice(code="usage.no-bodies", text=text))
            return fit_consistent(rows, seen, freedom, bodies=options.bodies)
    return fit_ols(rows, seen, freedom)
