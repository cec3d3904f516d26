"""Fits to all but one stretch of the logs: sums of products, their solutions, rows predicted by the others.

Rows, instruments -> `Stretches` -> parameters without each stretch, residuals of held-out rows.

    x_(-s) = (sum over other stretches of Z'W A)^-1 sum of Z'W y

A stretch is a contiguous part of a log; of several logs, whole logs are held out, unless one of them moves
what the others do not. The jackknife of a group of rows is that of Quenouille (1956):

    var x = (S - 1) / S sum_s (x_(-s) - mean)^2

Of candidates, the one of least cost is taken whose loss on held-out blocks is within a margin of the best
(one-standard-error rule of Breiman, Friedman, Olshen and Stone 1984, paired over the blocks):

    z_i = mean_b d_ib / (std_b d_ib / sqrt(blocks)),   d_ib = loss_ib - loss of the best on block b

Supported: least squares and instruments, any rows of single joints.
Not supported: estimators that are not linear in the torque; they are judged by wls of the same rows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.identification.regression import Rows, list_resting_joints
from symid.logs import Recording, estimate_density, low_pass

STRETCHES = 6
"""Of all logs together; two a log at least."""
ENDS, PART = 0.5, 0.05
"""s, and part of a log, that do not count at either end, where filters extrapolate."""
_RIDGE = 1e-11
"""Of the squared length of columns: keeps what the rows do not identify at zero."""
_LEAST_BAND = 2.5
"""Hz: no scoring band is narrower."""
_HELD = 0.99
_ABOVE = 10.0
"""Times the floor: density that counts as motion."""


def measure_scoring_band(recordings: Sequence[Recording]) -> float:
    """Return twice the band in Hz that holds 99 % of the velocities' power, the median of joints and logs.

    The power is the integral of (2 pi f)^2 (density - floor) over frequencies at which the density of the
    position is ten times its floor (the median of the upper half of all frequencies) or more.
    """
    found = []
    for recording in recordings:
        rate = 1.0 / recording.period
        moving = np.setdiff1d(np.arange(recording.position.shape[1]), list_resting_joints(recording))
        length = min(len(recording.time), max(64, round(4.0 * rate)))
        frequency, density = estimate_density(recording.position, rate, length)
        floor = np.median(density[frequency > 0.25 * rate], axis=0)
        power = np.where(density > _ABOVE * floor, density - floor, 0.0) * (frequency**2)[:, None]
        total = power.sum(axis=0)
        ends = [np.argmax(np.cumsum(power[:, k]) >= _HELD * total[k]) for k in moving if total[k] > 0.0]
        if ends:
            found.append(float(np.median(frequency[ends])))
    return max(_LEAST_BAND, 2.0 * float(np.median(found))) if found else _LEAST_BAND


_ORDER = 4
_WIDE = 0.8
"""Of the band of the rows: a band beyond filters nothing."""


def smooth_rows(rows: Rows, values: FloatArray, band: float) -> FloatArray:
    """Return `values` (m, k) of rows low-passed at `band` in Hz, joint by joint, as they are if short."""
    found = values.copy()
    for run in np.unique(rows.run):
        for group in np.unique(rows.group):
            own = np.flatnonzero((rows.run == run) & (rows.group == group))
            if len(own) <= 3 * _ORDER + 1:
                continue
            period = float(np.median(np.diff(rows.time[own])))
            if band < _WIDE * 0.5 / period:
                found[own] = low_pass(values[own], period=period, cutoff=band, order=_ORDER)
    return found


def mask_inner(rows: Rows) -> NDArray[np.bool_]:
    """Return the rows (m,) that are not near an end of their log."""
    inner = np.zeros(len(rows.time), dtype=np.bool_)
    for run in np.unique(rows.run):
        own = rows.run == run
        first, last = float(rows.time[own].min()), float(rows.time[own].max())
        left = min(ENDS, PART * (last - first))
        inner |= own & (rows.time >= first + left) & (rows.time <= last - left)
    return inner


def solve_sums(sums: FloatArray, weights: FloatArray) -> FloatArray:
    """Return x (..., p) of sum_j w_j Z_j'A_j x = sum_j w_j Z_j'y_j; sums (..., n, p + 1, p + 1), y last."""
    width = sums.shape[-1]
    whole = (weights @ sums.reshape(*sums.shape[:-2], width**2)).reshape(*sums.shape[:-3], width, width)
    scaled, scales = _scale(whole[..., :-1, :-1])
    return np.asarray(np.linalg.solve(scaled, (whole[..., :-1, -1] * scales)[..., None])[..., 0] * scales)


def _scale(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return D M D with ones on its diagonal and a tiny ridge, and the diagonal (..., p) of D."""
    lengths = np.sqrt(np.abs(np.diagonal(matrix, axis1=-2, axis2=-1)))
    alive = lengths > 1e-9 * lengths.max(axis=-1, keepdims=True, initial=np.finfo(float).tiny)
    scales = np.where(alive, 1.0 / np.where(alive, lengths, 1.0), 0.0)
    ridge = _RIDGE * np.eye(scales.shape[-1])
    return matrix * scales[..., :, None] * scales[..., None, :] + ridge, scales


_UNKNOWN = 1e5
"""Squares of a log's columns over those of the others, in a direction that these do not determine."""


def determine_each_other(sums: FloatArray, weights: FloatArray) -> bool:
    """Return whether of several logs the others determine all that acts in each; sums (l, n, p + 1, p + 1).

    Squares of a log are compared with those of the others in the direction where they differ most.
    """
    if len(sums) < 2:  # one log has no others
        return False
    parts = np.tensordot(sums, weights, axes=([1], [0]))[:, :-1, :-1]
    whole = parts.sum(axis=0)
    _, scales = _scale(whole)
    for own in parts:
        others = (whole - own) * scales[:, None] * scales + _RIDGE * np.eye(len(scales))
        ratios = np.linalg.eigvals(np.linalg.solve(others, own * scales[:, None] * scales))
        if np.abs(ratios).max() > _UNKNOWN:
            return False
    return True


def compute_jackknife(folds: FloatArray) -> FloatArray:
    """Return the variances (p,) from the parameters (s, p) without each stretch."""
    spread = folds - folds.mean(axis=0)
    variances: FloatArray = (len(folds) - 1) / len(folds) * np.sum(spread**2, axis=0)
    return variances


def count_stretches(logs: int) -> int:
    """Return into how many stretches each of so many logs is cut."""
    return max(2, math.ceil(STRETCHES / logs))


def cut_stretches(rows: Rows) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the stretch (m,) of every row, and the log (s,) of every stretch."""
    runs = np.unique(rows.run)
    each = count_stretches(len(runs))
    stretch = np.zeros(len(rows.values), dtype=np.intp)
    for place, run in enumerate(runs):
        own = rows.run == run
        time = rows.time[own]
        first, span = float(time.min()), float(np.ptp(time)) or 1.0
        stretch[own] = place * each + np.minimum((each * (time - first) / span).astype(np.intp), each - 1)
    return stretch, np.repeat(np.arange(len(runs)), each)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretches:
    """Fits without each stretch.

    Args:
        stretch: (m,) of every row; logs: (s,) log of every stretch, from zero.
        folds: (s, p) parameters without each stretch; logwise: (l, p) without each log, none for one log
            or where the others do not determine all that acts in each.
        kept: (m,) whether a row is fitted; weights: (g,) of the squared residuals of every joint.
        inverses: (s, p, p) of the normal equations without each stretch.
    """

    stretch: NDArray[np.intp]
    logs: NDArray[np.intp]
    folds: FloatArray
    logwise: FloatArray
    kept: NDArray[np.bool_]
    weights: FloatArray
    inverses: FloatArray

    def predict(self, rows: Rows) -> FloatArray:
        """Return what the others predict of each row (m,): of several logs the other logs."""
        found = np.zeros(len(rows.values))
        for stretch, log in enumerate(self.logs.tolist()):
            own = self.stretch == stretch
            found[own] = rows.matrix[own] @ (self.logwise[log] if len(self.logwise) else self.folds[stretch])
        return found


def fit_stretches(
    rows: Rows, instruments: Rows | None, kept: NDArray[np.bool_], weights: FloatArray
) -> Stretches:
    """Return the fits to the `kept` rows (m,) with weights (g,) of the squared residuals of every joint."""
    stretch, logs = cut_stretches(rows)
    groups, width = len(rows.group_names), rows.matrix.shape[1]
    sums = np.zeros((len(logs), groups, width + 1, width + 1))
    left = rows if instruments is None else instruments
    for place, group in product(range(len(logs)), range(groups)):
        own = np.flatnonzero((stretch == place) & (rows.group == group) & kept)
        root = np.sqrt(rows.weight[own])[:, None]
        right = root * np.column_stack([rows.matrix[own], rows.values[own]])
        first = right if left is rows else root * np.column_stack([left.matrix[own], left.values[own]])
        sums[place, group] = first.T @ right
    whole = sums.sum(axis=0)
    folds = solve_sums(whole - sums, weights)
    parts = np.stack([sums[logs == log].sum(axis=0) for log in range(int(logs.max()) + 1)])
    held = parts if determine_each_other(parts, weights) else parts[:0]
    scaled, scales = _scale(np.tensordot(whole - sums, weights, axes=([1], [0]))[:, :-1, :-1])
    return Stretches(
        stretch=stretch,
        logs=logs,
        folds=folds,
        logwise=solve_sums(whole - held, weights),
        kept=kept,
        weights=weights,
        inverses=np.linalg.inv(scaled) * scales[:, :, None] * scales[:, None, :],
    )


def measure_gain(
    stretches: Stretches, rows: Rows, own: NDArray[np.intp], columns: FloatArray
) -> tuple[float, float]:
    """Return what further `columns` (k, c) of a joint, at its rows `own` (k,), gain on its held-out rows.

    The first number is the gain, relative to the squares that are left without the columns; all parameters
    are fitted anew, by least squares. The second is how sure that is: the mean over stretches of the
    logarithm of squares without over squares with them, in standard errors. What helps in every stretch is
    sure, however much the stretches differ in size.
    """
    count = columns.shape[1]
    weight = float(stretches.weights[rows.group[own[0]]])
    matrix, values = rows.matrix[own], rows.values[own]
    fitted, place = stretches.kept[own] * rows.weight[own], stretches.stretch[own]
    sums = []
    for stretch in range(len(stretches.logs)):
        part = place == stretch
        table = np.column_stack([matrix[part], columns[part], values[part]])
        weighed = columns[part] * fitted[part, None]
        sums.append((matrix[part].T @ weighed, weighed.T @ table))
    whole = [sum(entry[k] for entry in sums) for k in (0, 1)]
    before, after = np.zeros(len(sums)), np.zeros(len(sums))
    for stretch, (upper, lower) in enumerate(sums):
        held = place == stretch
        side, bottom = weight * (whole[0] - upper), weight * (whole[1] - lower)
        inverse, base = stretches.inverses[stretch], stretches.folds[stretch]
        cross = bottom[:, : len(base)]
        inner = bottom[:, len(base) : -1] - cross @ inverse @ side
        inner = inner + 1e-9 * np.abs(np.diag(inner)).mean() * np.eye(count)
        added = np.linalg.solve(inner, bottom[:, -1] - cross @ base)
        moved = base - inverse @ (side @ added)
        before[stretch] = np.sum((values[held] - matrix[held] @ base) ** 2)
        after[stretch] = np.sum((values[held] - matrix[held] @ moved - columns[held] @ added) ** 2)
    total = float(before.sum())
    there = before > 0.0
    if there.sum() < 2:
        return 0.0, 0.0
    logs = np.log(before[there] / np.maximum(after[there], np.finfo(float).tiny))
    error = float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    return 1.0 - float(after.sum()) / total, float(logs.mean()) / error if error else 0.0


class HeldOutChoice(NamedTuple):
    """Indices of the best candidate and of the one taken; z (c,) of all candidates, in standard errors."""

    best: int
    taken: int
    behind: FloatArray


def choose_held_out(losses: FloatArray, costs: Sequence[float], margin: float = 1.0) -> HeldOutChoice:
    """Return the candidate of least cost among those within `margin` standard errors of the best.

    `losses` (c, blocks) are those of every candidate on every held-out block, two blocks or more; of equal
    `costs` (c,), such as the number of unknowns, the smaller loss decides.
    """
    totals = losses.sum(axis=1)
    best = int(np.argmin(totals))
    behind = measure_behind(losses, best)
    close = np.flatnonzero(behind <= margin).tolist()
    taken = min(close, key=lambda index: (costs[index], totals[index]))
    return HeldOutChoice(best, taken, behind)


def measure_behind(losses: FloatArray, best: int) -> FloatArray:
    """Return z (c,) of losses (c, blocks) against candidate `best`: 0 where no worse, inf where always."""
    differences = losses - losses[best]
    means = differences.mean(axis=1)
    errors = differences.std(axis=1, ddof=1) / np.sqrt(losses.shape[1])
    behind: FloatArray = np.where(means > 0.0, np.inf, 0.0)
    np.divide(means, errors, out=behind, where=(means > 0.0) & (errors > 0.0))
    return behind
