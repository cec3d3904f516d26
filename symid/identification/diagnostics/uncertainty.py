"""How sure identified parameters are: correlation, block bootstrap, essential parameters, drift of logs.

Covariance -> correlated pairs, `Ellipse`;  rows, their fit -> `Bootstrap`, `Essential`, `Drift`.

Bootstrap: each log is cut into blocks of time, all joints of a block together. As many blocks as there are,
drawn with replacement, make a new log, and its fit another set of parameters (Kuensch 1989). Their scatter
is the standard deviation, whatever pattern the residual keeps within a block.

Essential parameters: backward elimination. The parameter whose removal costs least, measured by its own
noise, goes first, until the next one stands out of the noise. Removing parameter k raises the sum of
weighted squares by x_k^2 / c_kk, c the inverse of F'F, F the weighted matrix of those kept. The idea is
that of Pham and Gautier (1991), who drop by the relative deviation. The noise is that of blocks of
consecutive rows, so that a patterned residual does not make every parameter essential.

Drift: each log is fitted alone. A parameter that differs between them beyond what the noise of blocks
allows has changed between the logs, or makes up for what the model misses. The mean residual of each joint
in each log, with its deviation, shows where torque is missing that no parameter makes up for.

Supported: any number of logs; weights of the fit; directions that the log does not determine stay as they
are; drift of parameters that at least two of the logs identify alone.
Not supported: more than two correlated parameters at once (singular values show these); patterns longer
than a block; grouping parameters anew, constraints; changes within a log.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import IdentifiabilityError, Notice
from symid.identification.diagnostics.fit_warnings import compute_block_deviations
from symid.identification.estimators import RegressionFit, fit_weighted
from symid.identification.regression import (
    SCALAR_KINDS,
    Identifiability,
    Rows,
    analyse_identifiability,
    count_freedom,
    select_rows,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipse:
    """Where a pair of values lies with probability `level`, if the noise is normal.

    `centre` is the pair, `axes` the longer and the shorter half axis, `angle` (rad) of the longer one
    from the first parameter's axis.
    """

    centre: tuple[float, float]
    axes: tuple[float, float]
    angle: float
    level: float

    def trace(self, points: int = 181) -> FloatArray:
        """Return the closed outline: (points, 2)."""
        turn = np.linspace(0.0, 2.0 * np.pi, points)
        c, s = np.cos(self.angle), np.sin(self.angle)
        local = np.column_stack([self.axes[0] * np.cos(turn), self.axes[1] * np.sin(turn)])
        outline: FloatArray = np.asarray(self.centre) + local @ np.array([[c, s], [-s, c]])
        return outline


def compute_correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation coefficients (k, k); 0 with a parameter that has no deviation."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inverse = np.where(deviation > 0.0, 1.0 / np.where(deviation > 0.0, deviation, 1.0), 0.0)
    matrix: FloatArray = np.clip(covariance * inverse[:, None] * inverse, -1.0, 1.0)
    return matrix


def list_correlated(
    covariance: FloatArray, names: Sequence[str], least: float = 0.9
) -> tuple[tuple[str, str, float], ...]:
    """Return (name, name, correlation) of pairs beyond `least` in size, the closest first."""
    matrix = compute_correlations(covariance)
    first, second = np.triu_indices(len(names), 1)
    size = np.abs(matrix[first, second])
    order = np.argsort(-size, kind="stable")
    return tuple(
        (names[first[k]], names[second[k]], float(matrix[first[k], second[k]]))
        for k in order
        if size[k] >= least
    )


def compute_ellipse(values: Sequence[float], covariance: FloatArray, level: float = 0.95) -> Ellipse:
    """Return the ellipse of confidence of two parameters.

    (x - v)' C^-1 (x - v) = -2 ln(1 - level), the quantile of chi-squared with two degrees of freedom.

    Args:
        values: v, two numbers.
        covariance: C (2, 2).
        level: probability, between 0 and 1.
    """
    spread, directions = np.linalg.eigh(covariance)
    radius = np.sqrt(-2.0 * np.log1p(-level))
    lengths = radius * np.sqrt(np.maximum(spread, 0.0))
    longer = directions[:, 1]
    return Ellipse(
        centre=(float(values[0]), float(values[1])),
        axes=(float(lengths[1]), float(lengths[0])),
        angle=float(np.arctan2(longer[1], longer[0])),
        level=level,
    )


BOOTSTRAP_BLOCKS = 40
REPLICATES = 200
_SEEN = 1e-10
"""Singular value relative to the largest below which a drawn log does not tell a direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bootstrap(FrozenArrays):
    """What parameters scatter when blocks of the logs are drawn anew.

    Args:
        names: of the parameters with a value of their own.
        deviations: (k,) standard deviations; low, high: (k,) ends of the middle 95 %.
        blocks: of time; replicates: logs drawn.
    """

    names: tuple[str, ...]
    deviations: FloatArray
    low: FloatArray
    high: FloatArray
    blocks: int
    replicates: int


def cut_blocks(rows: Rows, blocks: int) -> tuple[np.ndarray[tuple[int], np.dtype[np.intp]], int]:
    """Return the number of the block of each row (m,), and how many blocks there are.

    Blocks are stretches of time of equal length within a log; longer logs have more of them.
    """
    spans = [(float(rows.time[part].min()), float(rows.time[part].max())) for part in _list_runs(rows)]
    whole = sum(high - low for low, high in spans) or 1.0
    number = np.zeros(len(rows.values), dtype=np.intp)
    count = 0
    for part, (low, high) in zip(_list_runs(rows), spans, strict=True):
        pieces = max(1, round(blocks * (high - low) / whole))
        place = (rows.time[part] - low) / ((high - low) or 1.0) * pieces
        number[part] = count + np.minimum(place.astype(np.intp), pieces - 1)
        count += pieces
    return number, count


def _list_runs(rows: Rows) -> list[np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    return [rows.run == run for run in np.unique(rows.run)]


def compute_bootstrap(
    rows: Rows,
    fit: RegressionFit,
    seen: Identifiability,
    generator: np.random.Generator,
    *,
    blocks: int = BOOTSTRAP_BLOCKS,
    replicates: int = REPLICATES,
) -> Bootstrap:
    """Return the scatter of the parameters over logs drawn from blocks of the logs.

    Args:
        rows: the equations of the fit.
        fit: its result.
        seen: what the rows can tell.
        generator: of random numbers.
        blocks: of time, in all logs together.
        replicates: logs to draw.
    """
    number, count = cut_blocks(rows, blocks)
    stacked = np.column_stack([rows.matrix @ seen.basis, rows.values]) * fit.weights[:, None]
    factors = [np.linalg.qr(stacked[number == block], mode="r") for block in range(count)]
    drawn = np.empty((replicates, len(rows.names)))
    for index in range(replicates):
        times = np.bincount(generator.integers(count, size=count), minlength=count)
        parts = [np.sqrt(times[block]) * factors[block] for block in np.flatnonzero(times)]
        triangle: FloatArray = np.asarray(np.linalg.qr(np.vstack(parts), mode="r"))
        drawn[index] = seen.basis @ np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=_SEEN)[0]
    kept = drawn[:, seen.learnable]
    low, high = np.percentile(kept, [2.5, 97.5], axis=0)
    return Bootstrap(
        names=tuple(np.array(rows.names)[seen.learnable].tolist()),
        deviations=kept.std(axis=0, ddof=1),
        low=low,
        high=high,
        blocks=count,
        replicates=replicates,
    )


NOISE_LEVEL = 2.0
"""Deviations from zero below which a parameter is noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A parameter left out: how many deviations it lay from zero then, and the residual's growth so far."""

    name: str
    ratio: float
    price_percent: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Essential(FrozenArrays):
    """A model without what the log does not need.

    Args:
        kept: names of the parameters left.
        dropped: the others, in the order they went.
        values: (p,) of all parameters after the last fit, zero where dropped.
        price_percent: by how much the norm of the weighted residual grew.
    """

    kept: tuple[str, ...]
    dropped: tuple[Dropped, ...]
    values: FloatArray
    price_percent: float


def select_essential(
    rows: Rows,
    fit: RegressionFit,
    seen: Identifiability,
    *,
    level: float = NOISE_LEVEL,
    freedom: str = "band",
) -> Essential:
    """Return the model that is left when parameters below `level` deviations are dropped one by one.

    Args:
        rows: the equations of the fit.
        fit: its result; the rows keep its weights.
        seen: what the rows can tell; only parameters with a value of their own are dropped.
        level: in deviations.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
    """
    candidates = np.flatnonzero(seen.learnable)
    others = seen.basis[~seen.learnable]
    # Directions that only refused parameters share: they stay, whatever they cost.
    _, singular, right = (
        np.linalg.svd(others, full_matrices=False) if len(others) else (0, np.zeros(0), others)
    )
    rest = others @ right[singular > 1e-9 * max(singular.max(initial=0.0), 1e-300)].T
    mixing = np.zeros((rows.matrix.shape[1], len(candidates) + rest.shape[1]))
    mixing[candidates, np.arange(len(candidates))] = 1.0
    mixing[np.ix_(~seen.learnable, np.arange(len(candidates), mixing.shape[1]))] = rest
    weighted = (rows.matrix * fit.weights[:, None]) @ mixing
    factor: FloatArray = np.asarray(
        np.linalg.qr(np.column_stack([weighted, rows.values * fit.weights]), mode="r")
    )
    inflation = _compute_inflation(rows, fit, seen)[candidates]
    used, independent = count_freedom(freedom, mixing.shape[1], rows.independent)
    left = max(independent * len(rows.values) - used, 1.0)
    kept, dropped, inner, price = _eliminate(factor, inflation, left, level)
    return Essential(
        kept=tuple(rows.names[candidates[k]] for k in kept if k < len(candidates)),
        dropped=tuple(
            Dropped(name=rows.names[candidates[k]], ratio=ratio, price_percent=paid)
            for k, ratio, paid in dropped
        ),
        values=mixing @ inner,
        price_percent=price,
    )


def _compute_inflation(rows: Rows, fit: RegressionFit, seen: Identifiability) -> FloatArray:
    """Return how many times larger than stated the deviations (p,) are, at least one."""
    stated = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    blocks = compute_block_deviations(rows, fit, seen)
    ratio: FloatArray = np.where(stated > 0.0, blocks / np.where(stated > 0.0, stated, 1.0), 1.0)
    return np.maximum(ratio, 1.0)


def _eliminate(
    factor: FloatArray, inflation: FloatArray, freedom: float, level: float
) -> tuple[list[int], list[tuple[int, float, float]], FloatArray, float]:
    """Return columns kept, (column, deviations, price) of those dropped, values of all, the whole price."""
    matrix, target = factor[:, :-1], factor[:, -1]
    kept = list(range(matrix.shape[1]))
    values, inverse, square = _solve_columns(matrix, target, kept)
    first = max(square, 1e-300)
    dropped: list[tuple[int, float, float]] = []
    while True:
        free = [place for place, column in enumerate(kept) if column < len(inflation)]
        if not free:
            break
        spread = np.sqrt(first / freedom * inverse[free]) * inflation[[kept[place] for place in free]]
        ratios = np.abs(values[free]) / np.maximum(spread, 1e-300)
        least = int(np.argmin(ratios))
        if ratios[least] >= level:
            break
        column = kept.pop(free[least])
        values, inverse, square = _solve_columns(matrix, target, kept)
        dropped.append((column, float(ratios[least]), _compute_growth(square, first)))
    inner = np.zeros(matrix.shape[1])
    inner[kept] = values
    return kept, dropped, inner, _compute_growth(square, first)


def _compute_growth(square: float, first: float) -> float:
    return 100.0 * (float(np.sqrt(max(square, first) / first)) - 1.0)


def _solve_columns(
    matrix: FloatArray, target: FloatArray, kept: list[int]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the least-squares values of some columns, the diagonal of (F'F)^-1, and the sum of squares."""
    if not kept:
        return np.zeros(0), np.zeros(0), float(target @ target)
    part = matrix[:, kept]
    lengths = np.linalg.norm(part, axis=0)
    scales = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    left, singular, right = np.linalg.svd(part * scales, full_matrices=False)
    values = scales * (right.T @ ((left.T @ target) / singular))
    inverse = scales**2 * np.sum((right.T / singular) ** 2, axis=1)
    error = target - part @ values
    return values, inverse, float(error @ error)


_CHANCE = 0.01
"""Probability, over all parameters, that chance alone makes one of them drift."""
_BLOCKS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterDrift:
    """A parameter as each log tells it alone: values, deviations, and the chance of so much scatter."""

    name: str
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """What differs between logs.

    Args:
        runs: numbers of the logs that were compared, from zero.
        changed: parameters that differ beyond chance, the least likely first.
        compared: how many parameters at least two logs tell alone.
        residual: (log, joint, mean residual, its deviation) of the fit to all logs.
    """

    runs: tuple[int, ...]
    changed: tuple[ParameterDrift, ...]
    compared: int
    residual: tuple[tuple[int, str, float, float], ...]


class SingleLogFit(NamedTuple):
    """What one log tells alone: parameters and deviations (p,), and which of them it tells."""

    values: FloatArray
    deviations: FloatArray
    seen: Identifiability


SingleLogFitter = Callable[[int, FloatArray], SingleLogFit | None]
"""From the number of a log and the weights of joints (g,) to what it tells alone, or None."""


def measure_drift(
    rows: Rows, fit: RegressionFit, freedom: str = "band", fit_log: SingleLogFitter | None = None
) -> Drift:
    """Return what the logs behind `rows` tell differently; nothing where there is only one.

    Args:
        rows: the equations of the fit.
        fit: its result.
        freedom: how the variance of the noise is estimated, see `Processing.noise_freedom`.
        fit_log: fits one log alone, where `rows` have no matrix.
    """
    runs = tuple(int(run) for run in np.unique(rows.run))
    residual = tuple(entry for run in runs for entry in _compute_means(rows, fit, run))
    if len(runs) < 2:
        return Drift(runs=runs, changed=(), compared=0, residual=residual)
    weights = compute_mean_weights(rows, fit)
    fit_log = fit_log or partial(_fit_alone, rows, freedom)
    alone = {run: found for run in runs if (found := fit_log(run, weights)) is not None}
    changes = []
    for index, name in enumerate(rows.names):
        told = [found for found in alone.values() if found.seen.learnable[index]]
        if len(told) < 2:
            continue
        values = np.array([found.values[index] for found in told])
        deviations = np.array([found.deviations[index] for found in told])
        changes.append(
            ParameterDrift(
                name=name,
                values=tuple(map(float, values)),
                deviations=tuple(map(float, deviations)),
                chance=_compute_chance(values, deviations),
            )
        )
    limit = _CHANCE / max(len(changes), 1)
    changed = sorted((entry for entry in changes if entry.chance < limit), key=lambda entry: entry.chance)
    return Drift(runs=tuple(alone), changed=tuple(changed), compared=len(changes), residual=residual)


def compute_mean_weights(rows: Rows, fit: RegressionFit) -> FloatArray:
    """Return what the fit multiplied residuals of each group by (g,), without the weights of the logs.

    Args:
        rows: the equations of the fit.
        fit: its result; where weights differ within a group their mean counts.
    """
    own = fit.weights / np.sqrt(rows.weight)
    return np.array(
        [
            float(own[rows.group == group].mean()) if np.any(rows.group == group) else 1.0
            for group in range(len(rows.group_names))
        ]
    )


def _fit_alone(rows: Rows, freedom: str, run: int, weights: FloatArray) -> SingleLogFit | None:
    part = select_rows(rows, rows.run == run)
    part = replace(part, weight=np.ones(len(part.values)))
    try:
        seen = analyse_identifiability(part)
    except IdentifiabilityError:
        return None
    found = fit_weighted(part, seen, weights, freedom)
    stated = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    return SingleLogFit(found.values, np.maximum(stated, compute_block_deviations(part, found, seen)), seen)


def _compute_chance(values: FloatArray, deviations: FloatArray) -> float:
    """Return the probability that equal values scatter as much: chi-squared with k - 1 degrees of freedom.

    The deviations rest on some tens of blocks, whence the F distribution in place of chi-squared.
    """
    from scipy.special import fdtrc

    safe = np.maximum(deviations, 1e-300)
    weights = 1.0 / safe**2
    mean = float(np.sum(weights * values) / np.sum(weights))
    freedom = len(values) - 1
    square = float(np.sum(((values - mean) / safe) ** 2))
    return float(fdtrc(freedom, _BLOCKS - 1, square / freedom))


def _compute_means(rows: Rows, fit: RegressionFit, run: int) -> list[tuple[int, str, float, float]]:
    found = []
    for group, name in enumerate(rows.group_names):
        members = np.flatnonzero((rows.group == group) & (rows.run == run))
        if len(members) < 2 * _BLOCKS:
            continue
        means = np.array([fit.residuals[block].mean() for block in np.array_split(members, _BLOCKS)])
        found.append((run, name, float(means.mean()), float(means.std(ddof=1) / np.sqrt(_BLOCKS))))
    return found


def warn_of_drift(
    rows: Rows,
    fit: RegressionFit,
    names: Sequence[str],
    freedom: str = "band",
    *,
    fit_log: SingleLogFitter | None = None,
) -> tuple[Notice, ...]:
    """Return a notice where the logs behind `rows` differ; `names` are theirs, by their number.

    Further arguments as for `measure_drift`.
    """
    if len(names) < 2 or rows.kind in SCALAR_KINDS:
        return ()
    drift = measure_drift(rows, fit, freedom, fit_log)
    if not drift.changed:
        return ()
    shown = ", ".join(entry.name for entry in drift.changed[:8])
    more = f" and {len(drift.changed) - 8} more" if len(drift.changed) > 8 else ""
    logs = ", ".join(names[run] for run in drift.runs)
    text = (
        f"{logs} tell {shown}{more} differently, beyond what their noise allows: the robot changed between "
        "them (temperature, payload, zero of the torque), or the model misses a term that acts differently "
        "in each; fit them apart and compare, or give each its own offsets"
    )
    return (Notice(code="identify.drift", text=text),)
