"""Linear least squares: ordinary, weighted by the scatter of each joint, generalised; their covariance.

Rows, or triangles of them, and what can be identified from them -> RegressionFit.

    ols   min |A x - y|^2
    wls   min sum_j |A_j x - y_j|^2 / sigma_j^2,  sigma_j = |e_j| / sqrt(m_j - r_j / b) of its residuals e
    gls   min sum_t e_t' S^-1 e_t,  e_t = A_t x - y_t the residuals of all joints at one time

b is the part of the rows that is independent after decimation, r_j = tr(A_j (A'A)^-1 A_j') of weighted rows
the parameters that joint j determines, p in all: the weights are those of restricted maximum likelihood
(Patterson and Thompson 1971; Harville 1977), which no residual can make large that is small because
parameters follow it. The covariance is s^2 (A'A)^-1, s^2 = |e|^2 / (b m - p) of the weighted rows; for energy
and power rows, whose noise grows with the speed, HC3 (MacKinnon and White 1985). S (g, g) comes from the
residuals of wls, or from P periods of N samples of a motion that repeats (Schoukens and Pintelon 2012):

    S = 1 / ((P - 1) N) sum over p, t of e_p(t) e_p(t)',   e_p = tau_p - mean over p of tau_p

For residuals that are correlated in time and between joints

    x - x_true = L sum_i g_i e_i,     cov x = L [integral of G(f)^H S(f) G(f) df] L'

G is the Fourier transform of the scores g (weighted columns, or instruments), S the spectral density of the
weighted residuals, from cross periodograms through a lag window of Parzen (Priestley 1981, 6.2.3). That of
joint j is divided by 1 - h_j(f), h_j(f) = |Q_j(f)|^2 / N, Q orthonormal columns: what the fit takes of it.

Supported: rank-deficient rows (unobservable directions stay at zero); runs of unequal weight; two or more
whole periods; joints without a row at some times.
Not supported: noise whose size follows the motion, as errors of the model do (a jackknife holds for them);
periodic motions that drift or start (cut these off, drop_first).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle
from symid.errors import Notice, UsageError
from symid.identification import regression
from symid.identification.estimators.estimate import Residual
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import Condensed, Identifiability, Rows
from symid.logs import Recording
from symid.robot import Processing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegressionFit(FrozenArrays):
    """A fit of parameters `values` (p,) to rows, with their `covariance` (p, p).

    Args:
        residuals: (m,) y - A x, in the rows' units, whatever the weights; none of condensed rows.
        spent: (g,) rows that parameters take from each group: they say nothing of its noise.
        condition: of the column-scaled matrix, weighted where the fit is.
        weights: (m,) what the rows were multiplied by, of condensed rows (g,) each group.
        notices: on the fit; report: what the estimator chose or reached; plain numbers, texts and lists.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    spent: FloatArray
    condition: float
    weights: FloatArray
    notices: tuple[Notice, ...] = ()
    report: Mapping[str, object] = field(default_factory=dict)


def iterate_weights(
    condensed: Condensed, solve: Callable[[FloatArray], tuple[Any, ...]], freedom: str
) -> FloatArray:
    """Return the inverse scatter (g,) of every group's residuals in the fit that has these weights.

    `solve` leads from weights (g,) to parameters (p,), leverage (g,) of the groups, and more. In the first
    fit a quiet joint has the errors that the noise of loud ones makes, and its weight is too small.
    """
    counts = condensed.counts
    # A joint that is explained to the last bit must not outweigh all others by 1e16.
    floor = numerics.RANK * np.linalg.norm(condensed.factors[:, :, -1]) / np.sqrt(counts.sum())
    weights = np.ones(len(counts))
    for _ in range(numerics.ROUNDS):
        values, leverage, *_ = solve(weights)
        spent, _ = regression.count_freedom(freedom, leverage, condensed.independent)
        scatter = _compute_scatter(regression.compute_square_sums(condensed, values), counts, spent)
        before, weights = weights, 1.0 / np.maximum(scatter, floor)
        if np.abs(weights / before - 1.0).max() < numerics.CONVERGED:
            break
    return weights


def _compute_scatter(
    squares: FloatArray, counts: FloatArray | NDArray[np.intp], spent: FloatArray | float
) -> FloatArray:
    """Return |e_j| / sqrt(m_j - spent_j), each (g,); of a group without rows to spare it is huge."""
    spare = np.maximum(counts - spent, numerics.EXACT * np.maximum(counts, 1))
    return np.asarray(np.sqrt(squares / spare))


def fit_condensed(
    condensed: Condensed, basis: FloatArray, weights: FloatArray | None = None, freedom: str = "band"
) -> RegressionFit:
    """Return the fit of condensed rows in the observable directions `basis` (p, r), without residuals.

    `weights` (g,) are those of the groups' residuals, None for the inverse of their scatter; `freedom` as in
    `Processing.noise_freedom`.
    """
    solve = partial(regression.solve_condensed, condensed, basis)
    weights = iterate_weights(condensed, solve, freedom) if weights is None else weights
    found = solve(weights)
    spent, independent = regression.count_freedom(freedom, found.leverage, condensed.independent)
    square = float(regression.compute_square_sums(condensed, found.values) @ weights**2)
    variance = square / (independent * float(condensed.counts.sum() - spent.sum()))
    return RegressionFit(
        values=found.values,
        covariance=variance * (found.root @ found.root.T),
        residuals=np.empty(0),
        spent=spent,
        condition=found.condition,
        weights=weights,
    )


def _compute_group_scatter(rows: Rows, residuals: FloatArray, spent: FloatArray | float) -> FloatArray:
    size = len(rows.group_names)
    squares = np.asarray(np.bincount(rows.group, residuals**2, size), dtype=np.float64)
    return _compute_scatter(squares, np.bincount(rows.group, minlength=size), spent)


def compute_residuals(rows: Rows, residuals: FloatArray, spent: FloatArray | float) -> tuple[Residual, ...]:
    """Return norm, relative norm and scatter of residuals (m,) for every group with rows; `spent` (g,)."""
    scatter = _compute_group_scatter(rows, residuals, spent).tolist()
    masks = [rows.group == index for index in range(len(scatter))]
    parts = zip(rows.group_names, rows.group_units, masks, scatter, strict=True)
    return tuple(
        Residual.measure(name, residuals[mask], rows.values[mask], unit, std)
        for name, unit, mask, std in parts
        if mask.any()
    )


def condense_residuals(
    rows: Rows, parts: Sequence[Condensed], *, values: FloatArray, spent: FloatArray | float
) -> tuple[Residual, ...]:
    """Return what parameters (p,) leave of condensed equations, not weighed, as `compute_residuals`.

    `rows` have the names of groups and their units.
    """
    counts = np.sum([part.counts for part in parts], axis=0)
    left = np.sum([regression.compute_square_sums(part, values) for part in parts], axis=0)
    whole = np.sum([regression.compute_square_sums(part, np.zeros_like(values)) for part in parts], axis=0)
    scatter = _compute_scatter(left, counts, spent)
    table = zip(
        rows.group_names, np.sqrt(left), np.sqrt(whole), counts, rows.group_units, scatter, strict=True
    )
    return tuple(
        Residual.build(name, float(norm), float(size), int(count), unit, float(std))
        for name, norm, size, count, unit, std in table
        if count
    )


def fit_ols(rows: Rows, identifiability: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the ordinary least-squares fit; `freedom` as in `Processing.noise_freedom`."""
    return fit_weighted(rows, identifiability, np.ones(len(rows.group_names)), freedom)


def fit_wls(rows: Rows, identifiability: Identifiability, freedom: str = "band") -> RegressionFit:
    """Return the fit with rows weighted by the inverse scatter of their joint; else as `fit_ols`."""
    return fit_weighted(rows, identifiability, None, freedom)


def estimate_group_weights(rows: Rows, identifiability: Identifiability, freedom: str = "band") -> FloatArray:
    """Return the weights (g,) of `fit_wls`, the inverse scatter of every group's residuals."""
    return fit_condensed(regression.condense_rows(rows), identifiability.basis, None, freedom).weights


def fit_weighted(
    rows: Rows, identifiability: Identifiability, weights: FloatArray | None, freedom: str = "band"
) -> RegressionFit:
    """Return the fit of rows in memory; else as `fit_condensed`."""
    basis = identifiability.basis
    fit = fit_condensed(regression.condense_rows(rows), basis, weights, freedom)
    residuals = rows.values - rows.matrix @ fit.values
    fit = replace(fit, residuals=residuals, weights=fit.weights[rows.group] * np.sqrt(rows.weight))
    if rows.kind not in regression.SCALAR_KINDS:
        return fit
    # B (F'F)^-1 F' diag(e_i^2 / (1 - h_i)^2) F (F'F)^-1 B' (HC3), h_i the leverage of row i, F = A B.
    found = measure_influence(rows, basis, fit.weights, residuals)
    spare = np.maximum(1.0 - np.sum(found.frame**2, axis=1), numerics.RANK)
    scores = found.scores * (found.residuals / spare)[:, None]
    _, independent = regression.count_freedom(freedom, fit.spent, rows.independent)
    return replace(fit, covariance=found.left @ (scores.T @ scores) @ found.left.T / independent)


def fit_gls(
    rows: Rows, identifiability: Identifiability, freedom: str = "band", noise: FloatArray | None = None
) -> RegressionFit:
    """Return the fit with rows weighted by the covariance of their noise between joints; else as `fit_ols`.

    `noise` (g, g) is that covariance for one row of every group, up to a factor; None to estimate it.
    """
    first = fit_wls(rows, identifiability, freedom)
    if len(rows.group_names) == 1:
        return replace(first, report={"noise_correlation": 0.0})
    known = estimate_noise_covariance(rows, first) if noise is None else np.asarray(noise, dtype=np.float64)
    found = fit_weighted(whiten_rows(rows, known), identifiability, np.ones(len(rows.group_names)), freedom)
    size = np.sqrt(np.diag(known))
    correlation = known / np.outer(size, size)
    return replace(
        found,
        residuals=rows.values - rows.matrix @ found.values,
        weights=(1.0 / size)[rows.group] * np.sqrt(rows.weight),
        report={"noise_correlation": float(np.abs(correlation - np.eye(len(size))).max())},
    )


def estimate_noise_covariance(rows: Rows, fit: RegressionFit) -> FloatArray:
    """Return the covariance (g, g) of residuals of groups, from times at which both have rows."""
    table = _arrange_by_time(rows)
    scatter = _compute_group_scatter(rows, fit.residuals * np.sqrt(rows.weight), fit.spent)
    scatter = np.maximum(scatter, numerics.RANK * np.linalg.norm(rows.values) / np.sqrt(len(rows.values)))
    scaled = fit.residuals / scatter[rows.group] * np.sqrt(rows.weight)
    errors = np.where(table >= 0, scaled[table], 0.0)
    there = (table >= 0).astype(np.float64)
    correlation = (errors.T @ errors) / np.maximum(there.T @ there, 1.0)
    size = np.sqrt(np.maximum(np.diag(correlation), np.finfo(float).tiny))
    correlation = correlation / np.outer(size, size)
    np.fill_diagonal(correlation, 1.0)
    # Times differ from pair to pair: a matrix that is not positive definite is moved towards its diagonal.
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < numerics.CONVERGED:
        share = (numerics.CONVERGED - least) / (1.0 - least)
        correlation = (1.0 - share) * correlation + share * np.eye(len(size))
    return np.asarray(correlation * np.outer(scatter, scatter))


def whiten_rows(rows: Rows, noise: FloatArray) -> Rows:
    """Return the rows of every time multiplied by L^-1, S = L L' (g, g): their noise is white then."""
    table = _arrange_by_time(rows)
    matrix, values = rows.matrix.copy(), rows.values.copy()
    patterns, kind = np.unique(table >= 0, axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        groups = np.flatnonzero(pattern)
        places = table[kind.ravel() == index][:, groups]
        inverse = np.linalg.inv(np.linalg.cholesky(noise[np.ix_(groups, groups)]))
        values[places] = rows.values[places] @ inverse.T
        # Row by row of L^-1, so that no second copy of all equations is made.
        for k in range(len(groups)):
            parts = (inverse[k, i] * rows.matrix[places[:, i]] for i in range(k + 1) if inverse[k, i])
            matrix[places[:, k]] = sum(parts)
    return replace(rows, matrix=matrix, values=values)


def _arrange_by_time(rows: Rows) -> NDArray[np.intp]:
    """Return the place (T, g) of every group's row at every time of every run, -1 where there is none."""
    instants, place = np.unique(np.stack([rows.run, rows.time]), axis=1, return_inverse=True)
    table = np.full((instants.shape[1], len(rows.group_names)), -1, dtype=np.intp)
    table[place.ravel(), rows.group] = np.arange(len(rows.time))
    return table


def estimate_period_noise(
    recordings: Sequence[Recording], processing: Processing, periods: Sequence[float]
) -> FloatArray:
    """Return the covariance (n, n) of the torque's noise, N m or N each, from what differs between periods.

    `periods` are in s, one for all recordings or one for each; the cut ends of `processing` are left out.
    """
    each = list(periods) * len(recordings) if len(periods) == 1 else list(periods)
    if len(each) != len(recordings):
        text = f"{len(periods)} periods for {len(recordings)} logs: give one for all, or one for each"
        raise UsageError(Notice(code="usage.period", text=text))
    size = recordings[0].torque.shape[1]
    total, freedom = np.zeros((size, size)), 0
    for recording, period in zip(recordings, each, strict=True):
        # The torque of every whole period (P, N, n), on one grid of times.
        kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
        time = recording.time[kept]
        span = float(time[-1] - time[0]) + recording.period if len(time) > 1 else 0.0
        count, samples = int(span / period + numerics.CONVERGED), round(period / recording.period)
        if count < 2 or samples < 2:
            text = f"fewer than two periods of {period:g} s fit into the {span:.3g} s of this log that are "
            text += "kept; record at least two, or correct the period"
            raise UsageError(Notice(code="usage.period", text=text, file=recording.source))
        grid = time[0] + period * (np.arange(count)[:, None] + np.arange(samples) / samples)
        folded = np.stack([np.interp(grid, time, column) for column in recording.torque[kept].T], axis=2)
        errors = (folded - folded.mean(axis=0)).reshape(-1, size)
        total += errors.T @ errors
        freedom += (folded.shape[0] - 1) * folded.shape[1]
    covariance: FloatArray = total / freedom
    torque = np.vstack([recording.torque for recording in recordings])
    percent = 100.0 * np.sqrt(np.diag(covariance)) / np.maximum(torque.std(axis=0), numerics.TINY)
    if np.any(percent > POLICY.lost):
        worst = int(np.argmax(percent))
        text = f"the torque of joint {worst + 1} differs between periods by {float(percent[worst]):.3g} % "
        text += "of its standard deviation: it does not repeat; check the period, or cut off the start"
        raise UsageError(Notice(code="usage.period", text=text, file=recordings[0].source))
    return covariance


_LAG = 0.1
"""Of a log: longest lag of the window, which resolves the spectrum to ten periods a log."""
_MOST_LEVERAGE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Influence:
    """How rows act on an estimate: x - x_true = left @ scores' e for weighted residuals e.

    `left` is (p, r), `scores` (m, r), `frame` (m, r) orthonormal columns that the fit takes from residuals.
    """

    left: FloatArray
    scores: FloatArray
    frame: FloatArray
    residuals: FloatArray


def measure_influence(rows: Rows, basis: FloatArray, weights: FloatArray, residuals: FloatArray) -> Influence:
    """Return how rows act on a least-squares fit in directions `basis` (p, r); weights, residuals (m,)."""
    scores = (rows.matrix @ basis) * weights[:, None]
    # Its square is the inverse of the normal equations.
    _, singular, directions = np.linalg.svd(compute_triangle(scores), full_matrices=False)
    root = np.asarray(directions.T / singular)
    frame, left = scores @ root, basis @ root @ root.T
    return Influence(left=left, scores=scores, frame=frame, residuals=residuals * weights)


def compute_coloured_covariance(rows: Rows, influence: Influence) -> FloatArray:
    """Return the covariance (p, p) of an estimate from torque rows (m of them, at even times)."""
    groups, rank = len(rows.group_names), influence.scores.shape[1]
    total = np.zeros((rank, rank))
    for run in np.unique(rows.run):
        # The rows of a log, their places in time, and the number of places.
        own = np.flatnonzero(rows.run == run)
        time = np.unique(rows.time[own])
        step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        places = np.round((rows.time[own] - time[0]) / step).astype(np.intp)
        count = int(places.max()) + 1
        size = 2 * count
        there = np.zeros((count, groups))
        there[places, rows.group[own]] = 1.0
        leverage, scores = np.zeros((count + 1, groups)), np.zeros((count + 1, groups, rank), dtype=complex)
        errors = np.zeros((count + 1, groups), dtype=complex)
        # Joint by joint, so that no second copy of all equations is made.
        for group in range(groups):
            chosen = rows.group[own] == group
            members, at = own[chosen], places[chosen]

            def transform(values: FloatArray, at: NDArray[np.intp] = at, count: int = count) -> FloatArray:
                table = np.zeros((count, *values.shape[1:]))
                table[at] = values
                return np.asarray(np.fft.rfft(table, n=2 * count, axis=0))

            scores[:, group] = transform(influence.scores[members])
            alike = influence.frame is influence.scores
            frame = scores[:, group] if alike else transform(influence.frame[members])
            leverage[:, group] = np.sum(np.abs(frame) ** 2, axis=1) / max(len(members), 1)
            errors[:, group] = transform(influence.residuals[members])
        present = np.fft.rfft(there, n=size, axis=0)
        errors = errors / np.sqrt(1.0 - np.minimum(leverage, _MOST_LEVERAGE))
        # Normed so that white noise of variance one has one; a lag is divided by the pairs of rows it has.
        longest = max(2, round(_LAG * count))
        distance = np.minimum(np.arange(size), size - np.arange(size))
        lag = distance / longest
        near, far = 1.0 - 6.0 * lag**2 + 6.0 * lag**3, 2.0 * (1.0 - lag) ** 3
        window = np.where(lag <= 0.5, near, np.where(lag <= 1.0, far, 0.0))
        window = window * np.maximum(1.0 - distance / count, 0.0)
        density = np.zeros((len(errors), groups, groups), dtype=complex)
        for j, k in combinations_with_replacement(range(groups), 2):
            pairs = np.fft.irfft(present[:, j] * present[:, k].conj(), n=size)
            covariance = np.fft.irfft(errors[:, j] * errors[:, k].conj(), n=size) / np.maximum(pairs, 1.0)
            wave = np.fft.rfft(covariance * window)
            density[:, j, k] = wave
            density[:, k, j] = wave.conj()
        # Where many rows are missing, a density may come out negative.
        sizes, vectors = np.linalg.eigh(density)
        if not np.all(sizes >= 0.0):
            density = (vectors * np.maximum(sizes, 0.0)[:, None]) @ vectors.conj().swapaxes(1, 2)
        # Every frequency but the first and the last stands for its negative too.
        double = np.full(len(density), 2.0)
        double[[0, -1]] = 1.0
        step = max(1, numerics.BLOCK // groups)
        for part in (slice(start, start + step) for start in range(0, len(density), step)):
            weighted = (density[part] * double[part, None, None]) @ scores[part]
            total += (scores[part].reshape(-1, rank).conj().T @ weighted.reshape(-1, rank)).real / size
    return np.asarray(influence.left @ total @ influence.left.T)
