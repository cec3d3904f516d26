"""Uncertainty of identified parameters: correlation, block bootstrap, essential parameters, drift of logs.

Covariance -> correlated pairs, `Ellipse`;  rows, their fit -> `Bootstrap`, `Essential`, `Drift`.

Bootstrap: logs are drawn with replacement from blocks of time, all joints together (Kuensch 1989).

Essential parameters: backward elimination. The parameter whose removal costs least in its own noise goes
first, until all are significant (the idea of Pham and Gautier 1991). Removing parameter k raises the sum of
weighted squares by x_k^2 / c_kk, c the inverse of F'F, F the weighted matrix of those kept. The noise is that
of blocks of consecutive rows, so that correlated residuals do not make every parameter essential.

Supported: any number of logs; weights of the fit; directions that are not identifiable stay as they are.
Not supported: more than two correlated parameters at once (singular values show these); correlation longer
than a block; constraints; changes within a log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle
from symid.errors import IdentifiabilityError
from symid.identification import regression
from symid.identification.diagnostics.fit_warnings import compute_block_deviations
from symid.identification.estimators import RegressionFit, fit_weighted
from symid.identification.judge import POLICY, adjust_chances, numerics
from symid.serialization import HIDDEN, name_key


@dataclass(frozen=True, slots=True, kw_only=True)
class Ellipse:
    """Where a pair of values lies with probability `level`, if the noise is normal.

    `axes` are the longer and the shorter half axis, `angle` (rad) that of the longer one.
    """

    centre: tuple[float, float]
    axes: tuple[float, float]
    angle: float
    level: float

    def trace(self) -> FloatArray:
        """Return the closed outline, a point every two degrees: (k, 2)."""
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        c, s = np.cos(self.angle), np.sin(self.angle)
        local = np.column_stack([self.axes[0] * np.cos(turn), self.axes[1] * np.sin(turn)])
        outline: FloatArray = np.asarray(self.centre) + local @ np.array([[c, s], [-s, c]])
        return outline


def list_correlated(covariance: FloatArray, names: Sequence[str]) -> tuple[tuple[str, str, float], ...]:
    """Return (name, name, correlation r) of pairs of which one, if it were known, would fix the other.

    The variance 1 - r^2 of the other falls `POLICY.fall` times then; the closest pair is first.
    """
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    inverse = np.divide(1.0, deviation, out=np.zeros_like(deviation), where=deviation > 0.0)
    first, second = np.triu_indices(len(names), 1)
    found = np.clip(covariance * inverse[:, None] * inverse, -1.0, 1.0)[first, second]
    close = POLICY.fall * (1.0 - found**2) <= 1.0
    order = [k for k in np.argsort(-np.abs(found), kind="stable") if close[k]]
    return tuple((names[first[k]], names[second[k]], float(found[k])) for k in order)


def compute_ellipse(
    values: Sequence[float], covariance: FloatArray, level: float = POLICY.confidence
) -> Ellipse:
    """Return the ellipse of confidence of two values with a covariance C (2, 2).

    (x - v)' C^-1 (x - v) = -2 ln(1 - level), the quantile of chi-squared with two degrees of freedom.
    """
    spread, directions = np.linalg.eigh(covariance)
    lengths = np.sqrt(-2.0 * np.log1p(-level)) * np.sqrt(np.maximum(spread, 0.0))
    longer = directions[:, 1]
    return Ellipse(
        centre=(float(values[0]), float(values[1])),
        axes=(float(lengths[1]), float(lengths[0])),
        angle=float(np.arctan2(longer[1], longer[0])),
        level=level,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bootstrap(FrozenArrays):
    """Scatter of the identifiable parameters over `replicates` logs drawn from blocks of time.

    `deviations` (k,) are standard deviations, `low` and `high` (k,) the ends of the middle
    `POLICY.confidence`.
    """

    names: tuple[str, ...]
    deviations: FloatArray
    low: FloatArray
    high: FloatArray
    blocks: int
    replicates: int


def cut_blocks(rows: regression.Rows, blocks: int) -> tuple[NDArray[np.intp], int]:
    """Return the block of time of each row (m,), and how many there are; longer logs have more of them."""
    runs = [rows.run == run for run in np.unique(rows.run)]
    spans = [(float(rows.time[part].min()), float(rows.time[part].max())) for part in runs]
    whole = sum(high - low for low, high in spans) or 1.0
    number = np.zeros(len(rows.values), dtype=np.intp)
    count = 0
    for part, (low, high) in zip(runs, spans, strict=True):
        pieces = max(1, round(blocks * (high - low) / whole))
        place = (rows.time[part] - low) / ((high - low) or 1.0) * pieces
        number[part] = count + np.minimum(place.astype(np.intp), pieces - 1)
        count += pieces
    return number, count


def compute_bootstrap(
    rows: regression.Rows,
    fit: RegressionFit,
    identifiability: regression.Identifiability,
    generator: np.random.Generator,
    *,
    replicates: int = 200,
) -> Bootstrap:
    """Return the scatter of the parameters over logs drawn from blocks of time of all logs together."""
    basis, identifiable = identifiability.basis, identifiability.identifiable
    number, count = cut_blocks(rows, regression.BLOCKS)
    stacked = np.column_stack([rows.matrix @ basis, rows.values]) * fit.weights[:, None]
    factors = [compute_triangle(stacked[number == block]) for block in range(count)]
    drawn = np.empty((replicates, len(rows.names)))
    for index in range(replicates):
        times = np.bincount(generator.integers(count, size=count), minlength=count)
        parts = [np.sqrt(times[block]) * factors[block] for block in np.flatnonzero(times)]
        triangle = compute_triangle(np.vstack(parts))
        drawn[index] = basis @ np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=numerics.RANK)[0]
    kept, tail = drawn[:, identifiable], 0.5 * (1.0 - POLICY.confidence)
    low, high = np.quantile(kept, [tail, 1.0 - tail], axis=0)
    return Bootstrap(
        names=tuple(np.array(rows.names)[identifiable].tolist()),
        deviations=kept.std(axis=0, ddof=1),
        low=low,
        high=high,
        blocks=count,
        replicates=replicates,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A parameter left out: its ratio to its deviation then, and the residual's growth so far."""

    name: str
    ratio: float = field(metadata=name_key("deviations"))
    price_percent: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Essential(FrozenArrays):
    """A model of the parameters `kept`; the others in the order they were dropped.

    `values` (p,) are those of all parameters after the last fit, zero where dropped; `price_percent` is by
    how much the norm of the weighted residual grew.
    """

    kept: tuple[str, ...]
    dropped: tuple[Dropped, ...]
    values: FloatArray = field(metadata=HIDDEN)
    price_percent: float


def select_essential(
    rows: regression.Rows,
    fit: RegressionFit,
    identifiability: regression.Identifiability,
    *,
    level: float = POLICY.printed,
    freedom: str = "band",
) -> Essential:
    """Return the model that is left when parameters below `level` deviations are dropped one by one.

    Only identifiable parameters are dropped; the rows keep the weights of the fit.
    """
    identifiable = identifiability.identifiable
    candidates = np.flatnonzero(identifiable)
    others = identifiability.basis[~identifiable]
    # Directions that only refused parameters share: they stay, whatever they cost.
    _, singular, right = np.linalg.svd(others, full_matrices=False)
    rest = others @ right[singular > numerics.RANK * max(singular.max(initial=0.0), numerics.TINY)].T
    mixing = np.zeros((rows.matrix.shape[1], len(candidates) + rest.shape[1]))
    mixing[candidates, np.arange(len(candidates))] = 1.0
    mixing[~identifiable, len(candidates) :] = rest
    weighted = (rows.matrix * fit.weights[:, None]) @ mixing
    factor = compute_triangle(np.column_stack([weighted, rows.values * fit.weights]))
    stated = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    blocks = compute_block_deviations(rows, fit, identifiability)
    ratio = np.divide(blocks, stated, out=np.ones_like(stated), where=stated > 0.0)
    inflation = np.maximum(ratio, 1.0)[candidates]
    _, independent = regression.count_freedom(freedom, fit.spent, rows.independent)
    left = max(independent * (len(rows.values) - float(fit.spent.sum())), 1.0)
    names = [rows.names[k] for k in candidates]
    matrix, target = factor[:, :-1], factor[:, -1]
    kept = list(range(matrix.shape[1]))
    values, inverse, square = _solve_columns(matrix, target, kept)
    first = max(square, numerics.TINY)
    dropped: list[Dropped] = []
    while free := [place for place, column in enumerate(kept) if column < len(inflation)]:
        spread = np.sqrt(first / left * inverse[free]) * inflation[[kept[place] for place in free]]
        ratios = np.abs(values[free]) / np.maximum(spread, numerics.TINY)
        least = int(np.argmin(ratios))
        if ratios[least] >= level:
            break
        column = kept.pop(free[least])
        values, inverse, square = _solve_columns(matrix, target, kept)
        paid = 100.0 * (float(np.sqrt(max(square, first) / first)) - 1.0)
        dropped.append(Dropped(name=names[column], ratio=float(ratios[least]), price_percent=paid))
    inner = np.zeros(matrix.shape[1])
    inner[kept] = values
    return Essential(
        kept=tuple(names[k] for k in kept if k < len(names)),
        dropped=tuple(dropped),
        values=mixing @ inner,
        price_percent=100.0 * (float(np.sqrt(max(square, first) / first)) - 1.0),
    )


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


@dataclass(frozen=True, slots=True)
class ParameterDrift:
    """A parameter as each log alone gives it: values, deviations, and the chance of so much scatter."""

    name: str
    values: tuple[float, ...]
    deviations: tuple[float, ...] = field(metadata=name_key("stds"))
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Differences between logs, by their numbers, from zero.

    `changed` are parameters that differ beyond chance and by a part of themselves that matters, the least
    likely first, of those `compared`, which at least two logs identify alone.
    """

    runs: tuple[int, ...] = field(metadata=HIDDEN)
    changed: tuple[ParameterDrift, ...]
    compared: int


def measure_drift(rows: regression.Rows, fit: RegressionFit, freedom: str = "band") -> Drift:
    """Return the differences between the logs behind `rows`; none where there is only one."""
    runs = tuple(int(run) for run in np.unique(rows.run))
    if len(runs) < 2:
        return Drift(runs=runs, changed=(), compared=0)
    weights = compute_mean_weights(rows, fit)
    # Parameters and deviations (p,) of each log alone, and which of them are identifiable.
    alone: dict[int, tuple[FloatArray, FloatArray, NDArray[np.bool_]]] = {}
    for run in runs:
        part = regression.select_rows(rows, rows.run == run)
        part = replace(part, weight=np.ones(len(part.values)))
        try:
            identifiability = regression.analyse_identifiability(part)
        except IdentifiabilityError:
            continue
        own = fit_weighted(part, identifiability, weights, freedom)
        stated = np.sqrt(np.maximum(np.diag(own.covariance), 0.0))
        spread = np.maximum(stated, compute_block_deviations(part, own, identifiability))
        alone[run] = own.values, spread, identifiability.identifiable
    changes = []
    for index, name in enumerate(rows.names):
        known = [(values[index], spread[index]) for values, spread, told in alone.values() if told[index]]
        if len(known) < 2:
            continue
        values, deviations = np.array(known).T
        # The probability that equal values scatter as much. The deviations rest on some tens of blocks,
        # whence the F distribution in place of chi-squared.
        safe = np.maximum(deviations, numerics.TINY)
        shares = 1.0 / safe**2
        mean = float(np.sum(shares * values) / np.sum(shares))
        square, count = float(np.sum(((values - mean) / safe) ** 2)), len(values) - 1
        chance = float(scipy.special.fdtrc(count, regression.BLOCKS - 1, square / count))
        changes.append(ParameterDrift(name, tuple(values.tolist()), tuple(deviations.tolist()), chance))
    chances = adjust_chances([entry.chance for entry in changes])
    changed = [
        entry
        for entry, chance in zip(changes, chances, strict=True)
        if chance < POLICY.alarm and np.ptp(entry.values) > POLICY.relevance * abs(np.mean(entry.values))
    ]
    changed.sort(key=lambda entry: entry.chance)
    return Drift(runs=tuple(alone), changed=tuple(changed), compared=len(changes))


def compute_mean_weights(rows: regression.Rows, fit: RegressionFit) -> FloatArray:
    """Return what the fit multiplied residuals of each group by (g,), on average, without weights of logs."""
    own = fit.weights / np.sqrt(rows.weight)
    parts = [own[rows.group == group] for group in range(len(rows.group_names))]
    return np.array([float(part.mean()) if len(part) else 1.0 for part in parts])
