"""Logs as sums of products, by block of time, joint, speed and band: what every choice and verdict is computed from.

Library, recordings, Processing, bands -> `CondensedLogs` -> fits, what fits without a stretch leave of it,
and what every block changes, by algebra alone: as fast for an hour as for ten seconds.

    level k      rows of [Y | Yf] and torque within the band b_k: both through the same linear-phase low-pass
    smooth k     the columns along positions that pass a low-pass at b_k: instruments
    sums         Z'[Y y] of each block, joint and class of speed; Z smooth (instruments) or the rows (least squares)
    weights      w_j = (m_j - r_j) / |e_j|^2,  m_j = 2 b T_j,  r_j = tr(A^-1 w_j S_j) the leverage of joint j
    x_(-f)       parameters without fold f, a sixth of the logs, or a whole log
    changes      c_b = -(A^-1 s_b + (A - A_b)^-1 s_b) / 2,  s_b = Z_b'W (y_b - Y_b x)

The weights are those of restricted maximum likelihood (Patterson and Thompson 1971, Biometrika 58): a joint
with as many parameters of its own as rows gets no weight from a residual that is zero for that reason. The
sum of c_b c_b' is the covariance of x for residuals that are correlated within blocks, without the bias of
few blocks to first order (the mean of the infinitesimal and the delete-one jackknife; Bell and McCaffrey 2002).

Supported: several logs, then whole logs are folds, unless one moves what the others do not; known payloads;
joints at rest; logs of any length (of long ones six pieces of twenty seconds at even distances).
Not supported: logs of different sample rates; rows of windows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library
from symid.identification.judge import POLICY
from symid.identification.regression.equations import evaluate_columns
from symid.identification.regression.identifiability import list_resting_joints
from symid.identification.regression.preparation import measure_bands, prepare_states
from symid.logs import Recording, cut_recording, differentiate, estimate_density, low_pass
from symid.robot import Processing

ROW_RATE = 200.0
"""Hz, the highest rate of rows."""
SHARES = (0.0, 0.02, 0.05, 0.1)
"""Classes of speed, in parts of the top speed."""
SCORING = 2
"""The level of the scoring band: there are two lower ones, an octave apart."""
_RIDGE = 1e-11
"""Of the squared length of columns: keeps what the rows do not identify at zero."""
_PIECE = 20.0
"""s, of a long log at a time."""
_RATE, _TAPS, _TOGETHER = 2.5, 2.0, 64
"""Times the cut-off of the positions: rate at which columns are evaluated. Periods of the band on either side of a
filter's middle; places that are filtered by one product of matrices."""
_ENDS, _PART = 0.5, 0.05
"""s, and part of a log, that do not count at either end, where filters extrapolate."""


def measure_scoring_band(recordings: Sequence[Recording]) -> float:
    """Return twice the band in Hz that holds 99 % of the velocities' power, the median of joints and logs.

    The power is the integral of (2 pi f)^2 (density - floor) over frequencies at which the density of the
    position is ten times its floor (the median of the upper half of all frequencies) or more, up to the first
    two octaves without any. Where velocities were logged, their band counts if it is lower: it has no noise
    of stamps in it.
    """
    found, length = [], 0.0
    for recording in recordings:
        rate, length = 1.0 / recording.period, length + len(recording.time) * recording.period
        moving = np.setdiff1d(np.arange(recording.position.shape[1]), list_resting_joints(recording))
        bands = _measure_bands(recording.position, rate, 2)[moving]
        if recording.velocity is not None and np.all(np.isfinite(recording.velocity)):
            other = _measure_bands(recording.velocity, rate, 0)[moving]
            bands = np.fmin(bands, other)
        found += bands[np.isfinite(bands)].tolist()
    return 2.0 * float(np.median(found)) if found else 1.0 / max(length, 1e-9)


def _measure_bands(values: FloatArray, rate: float, power: int) -> FloatArray:
    """Return the band (n,) in Hz that holds 99 % of f^power density of each column, NaN where there is none."""
    length = min(len(values), max(64, round(4.0 * rate)))
    frequency, density = estimate_density(values, rate, length)
    floor = np.median(density[frequency > 0.25 * rate], axis=0)
    found = np.full(values.shape[1], np.nan)
    for k in range(values.shape[1]):
        there = density[:, k] > 10.0 * floor[k]
        places = np.flatnonzero(there & (frequency > 0.0))
        # The upper end is where the next two octaves are empty.
        last = next(
            (
                a
                for a, b in pairwise([*places.tolist(), len(frequency)])
                if b == len(frequency) or frequency[b] > 4.0 * frequency[a]
            ),
            None,
        )
        share = np.where(there, (density[:, k] - floor[k]) * frequency**power, 0.0)
        if last is not None and share[: last + 1].sum() > 0.0:
            total = np.cumsum(share[: last + 1])
            found[k] = frequency[np.argmax(total >= 0.99 * total[-1])]
    return found


def balance_cutoff(recordings: Sequence[Recording]) -> float:
    """Return the cut-off in Hz at which noise and blur of the velocities are equal, the mean of joints.

    Columns of friction bend where the velocity turns, and want a sharp velocity; noise in the accelerations
    is taken out with that of the torque, as their columns are linear in it.
    """
    found = []
    for recording in recordings:
        smooth = low_pass(
            recording.position, period=recording.period, cutoff=min(10.0, 0.4 / recording.period), order=2
        )
        bend = differentiate(differentiate(smooth, recording.period), recording.period)
        turning = np.sqrt(np.mean(bend**2, axis=0))
        for band, rate in zip(measure_bands(recording), turning.tolist(), strict=False):
            if band.clean > 0.0:
                power = rate * np.sqrt(3.0) / ((2.0 * np.pi) ** 2 * max(band.floor, 1e-300))
                found.append(power**0.4)
    return float(np.median(found)) if found else 0.0


def _filter_rows(values: FloatArray, band: float, places: NDArray[np.intp]) -> FloatArray:
    """Return `values` (N, k), low-passed at `band` cycles a sample, at `places` (T,) of even distances."""
    half = round(_TAPS / band)
    if band >= 0.45 or not half:
        return values[places]
    half = min(half, len(values) - 1)
    # A windowed sinc with gain one at zero.
    taps = np.sinc(2.0 * band * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    taps /= np.sum(taps)
    first, step = int(places[0]), int(places[1] - places[0]) if len(places) > 1 else 1
    # The weights of some neighbouring places are one matrix.
    weights = np.zeros((_TOGETHER, len(taps) + step * (_TOGETHER - 1)))
    for place, row in enumerate(weights):
        row[step * place : step * place + len(taps)] = taps
    # Columns of zeros, of which a regressor has many, stay so.
    live = np.flatnonzero(values.any(axis=0))
    padded = np.pad(values[:, live], ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    parts = []
    for start in range(0, len(places), _TOGETHER):
        count = min(_TOGETHER, len(places) - start)
        begin, width = first + step * start, len(taps) + step * (count - 1)
        parts.append(weights[:count, :width] @ padded[begin : begin + width])
    rows = np.zeros((len(places), values.shape[1]))
    rows[:, live] = np.concatenate(parts)
    return rows


def pick_pieces(recordings: Sequence[Recording]) -> list[tuple[int, Recording]]:
    """Return each log with its number, of long ones six pieces of twenty seconds at even distances."""
    pieces = []
    for run, recording in enumerate(recordings):
        count, most = len(recording.time), round(_PIECE / recording.period)
        if count <= POLICY.folds * most:
            pieces.append((run, recording))
            continue
        starts = np.linspace(0, count - most, POLICY.folds).astype(int).tolist()
        pieces += [(run, cut_recording(recording, slice(start, start + most))) for start in starts]
    return pieces


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockFit(FrozenArrays):
    """A fit: parameters (p,), those without each fold (f, p), what each block changes (b, p); weights (n,)."""

    values: FloatArray
    folds: FloatArray
    changes: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Piece:
    """Rows of a piece of a log: of each level [A y] (t, n, p + 1) at one place in some, [Z y] (T, n, p + 1).

    `strides` of the levels' rows, `speed` (T, n) at the scoring band, `out` (n,) joints that are left out.
    """

    run: int
    matrices: tuple[FloatArray, ...]
    smooths: tuple[FloatArray, ...]
    strides: tuple[int, ...]
    speed: FloatArray
    out: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandSums:
    """Sums of products of a pair of bands: of each joint, its live columns and the torque last.

    Args:
        products: (b, c, l, l) of Z'[Y y] of each joint, from a class of speed c upwards.
        squares: (b, c, l, l) of [Y y]'[Y y], the same where there are no instruments.
        counts: (n, b, c) rows that are worth an independent one.
    """

    products: tuple[FloatArray, ...]
    squares: tuple[FloatArray, ...]
    counts: FloatArray


class CondensedLogs:
    """Rows of several logs within several bands, and their sums.

    Attributes:
        bands: Hz, rising, at place `SCORING` the scoring band.
        top: (n,) top speeds; torque: (n,) squares within the scoring band, 0 where a joint has no rows.
        log: (b,) number of the log of every block; fold: (b,) of its fold.
        logwise: whether folds are whole logs.
        live: of each joint the columns that act on it.
        scores: sums of the scoring band and the one below it, where losses are measured.
    """

    def __init__(
        self,
        library: Library,
        recordings: Sequence[Recording],
        processing: Processing,
        bands: Sequence[float],
        cutoff: float,
    ) -> None:
        """Build the rows of all bands, and cut them into blocks."""
        self.bands, self.width = tuple(bands), len(library.card.fitted)
        self.period = recordings[0].period * max(1, round(1.0 / (recordings[0].period * ROW_RATE)))
        self._pieces = [
            _build_piece(library, run, recording, processing, bands, cutoff)
            for run, recording in pick_pieces(recordings)
        ]
        self.top: FloatArray = np.max(
            [np.quantile(np.abs(entry.speed), 0.99, axis=0) for entry in self._pieces], axis=0
        )
        tables = [table for piece in self._pieces for table in (*piece.matrices, *piece.smooths)]
        acts = np.any([table.any(axis=0) for table in tables], axis=0)
        self.live = [np.flatnonzero(row[:-1]) for row in acts]
        log, fold = [], []
        self._blocks: list[range] = []
        runs = [piece.run for piece in self._pieces]
        each = max(2, math.ceil(POLICY.folds / (runs[-1] + 1)))
        for piece in self._pieces:
            # Parts of two periods of the scoring band or more.
            stretches = 1 if runs.count(piece.run) > 1 else each
            span = len(piece.speed) * self.period / stretches
            parts = int(np.clip(span * self.bands[SCORING] / POLICY.periods, 1, POLICY.parts))
            first = fold[-1] + 1 if fold else 0
            self._blocks.append(range(len(log), len(log) + stretches * parts))
            log += [piece.run] * (stretches * parts)
            fold += [first + place // parts for place in range(stretches * parts)]
        self.log, self.fold = np.array(log), np.array(fold)
        self.scores = [self.sum_products(level, level) for level in (SCORING - 1, SCORING)]
        self.torque = np.array([entry[:, 0, -1, -1].sum() for entry in self.scores[1].squares])
        self.logwise = runs[-1] > 0 and self._determine_each_other()
        if self.logwise:
            self.fold = self.log

    def sum_products(self, level: int, smooth: int) -> BandSums:
        """Return the sums of rows of a level, with instruments of a lower one, or of least squares."""
        alike, blocks, classes = level == smooth, len(self.log), len(SHARES)
        products, squares = [], []
        counts = np.zeros((len(self.live), blocks, classes))
        for joint, live in enumerate(self.live):
            columns = np.append(live, self.width)
            size = (blocks, classes, len(columns), len(columns))
            crossed, own = np.zeros(size), np.zeros(size)
            for piece, places in zip(self._pieces, self._blocks, strict=True):
                if piece.out[joint]:
                    continue
                stride, right = piece.strides[level], piece.matrices[level][:, joint][:, columns]
                left = right if alike else piece.smooths[smooth][::stride, joint][:, columns]
                speed = np.abs(piece.speed[::stride, joint]) / (self.top[joint] or 1.0)
                kind = np.searchsorted(SHARES, speed, side="right") - 1
                worth = min(1.0, 2.0 * self.bands[level] * self.period * stride)
                edges = np.linspace(0, len(right), len(places) + 1).astype(int)
                for block, (low, high) in zip(places, pairwise(edges.tolist()), strict=True):
                    for share in range(classes):
                        chosen = low + np.flatnonzero(kind[low:high] == share)
                        rows = right[chosen]
                        counts[joint, block, share] = worth * len(chosen)
                        crossed[block, share] = left[chosen].T @ rows
                        own[block, share] = crossed[block, share] if alike else rows.T @ rows
            # From a speed upwards.
            crossed, own = (np.cumsum(part[:, ::-1], axis=1)[:, ::-1] for part in (crossed, own))
            products.append(crossed)
            squares.append(own)
        counts = np.cumsum(counts[..., ::-1], axis=2)[..., ::-1]
        return BandSums(products=tuple(products), squares=tuple(squares), counts=counts)

    def fit(self, sums: BandSums, shares: Sequence[int], blocks: NDArray[np.bool_] | None = None) -> BlockFit:
        """Return the fit to rows of each joint (n,) from a class of speed on; of some `blocks` (b,) if given."""
        p, count = self.width, len(self.log)
        chosen = np.ones(count, dtype=np.bool_) if blocks is None else blocks
        parts = [
            table[:, share] * chosen[:, None, None]
            for table, share in zip(sums.products, shares, strict=True)
        ]
        own = [
            np.sum(table[chosen, share], axis=0) for table, share in zip(sums.squares, shares, strict=True)
        ]
        wholes = [part.sum(axis=0) for part in parts]
        rows = np.array([np.sum(sums.counts[joint, chosen, share]) for joint, share in enumerate(shares)])
        size = np.array([table[-1, -1] for table in own])

        def join(tables: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
            """Return the weighted sum (..., p + 1, p + 1) over joints."""
            found = np.zeros((*tables[0].shape[:-2], p + 1, p + 1))
            for table, live, weight in zip(tables, self.live, weights, strict=True):
                columns = np.append(live, p)
                found[..., columns[:, None], columns] += weight * table
            return found

        weights = np.where(size > 0.0, rows / np.where(size > 0.0, size, 1.0), 0.0)
        for _ in range(_ROUNDS):
            whole = join(wholes, weights)
            scaled, scales = scale_products(whole[:-1, :-1])
            inverse = np.linalg.inv(scaled) * scales[:, None] * scales
            values = inverse @ whole[:-1, -1]
            before = weights.copy()
            for joint, live in enumerate(self.live):
                error = np.append(values[live], -1.0)
                left = max(float(error @ own[joint] @ error), _EXACT * size[joint])
                leverage = weights[joint] * float(
                    np.sum(inverse[np.ix_(live, live)] * wholes[joint][:-1, :-1].T)
                )
                spare = max(rows[joint] - leverage, _EXACT * rows[joint])
                weights[joint] = spare / left if left > 0.0 else 0.0
            if np.all(np.abs(weights - before) <= _CONVERGED * weights):
                break
        whole, tables = join(wholes, weights), join(parts, weights)
        values = solve_products(whole)
        folds = solve_products(
            np.stack(
                [whole - tables[self.fold == fold].sum(axis=0) for fold in range(int(self.fold.max()) + 1)]
            )
        )
        scores = tables[:, :-1, -1] - tables[:, :-1, :-1] @ values
        without = whole - tables
        without[:, :-1, -1] = scores
        with_all = np.broadcast_to(whole, tables.shape).copy()
        with_all[:, :-1, -1] = scores
        changes = -0.5 * (solve_products(without) + solve_products(with_all))
        return BlockFit(values=values, folds=folds, changes=changes, weights=weights)

    def measure_losses(self, fit: BlockFit) -> FloatArray:
        """Return squares (b, n) that folds leave of what they leave out, relative to the torque, both bands."""
        found = np.zeros((len(self.log), len(self.live)))
        for sums in self.scores:
            for joint, live in enumerate(self.live):
                table = sums.squares[joint][:, 0]
                errors = np.column_stack([fit.folds[self.fold][:, live], np.full(len(self.log), -1.0)])
                left = np.maximum(np.einsum("bk,bkl,bl->b", errors, table, errors), 0.0)
                whole = table[:, -1, -1].sum()
                found[:, joint] += left / (whole or np.inf)
        return found

    def list_grams(self) -> list[FloatArray]:
        """Return the products (l, l) of each joint's columns within the scoring band, of all rows."""
        return [table[:, 0, :-1, :-1].sum(axis=0) for table in self.scores[1].squares]

    def _determine_each_other(self) -> bool:
        """Return whether of several logs the others determine all that acts in each."""
        width = self.width
        parts = np.zeros((int(self.log.max()) + 1, width, width))
        for live, table, size in zip(self.live, self.scores[1].squares, self.torque, strict=True):
            for log in range(len(parts)):
                own = table[self.log == log, 0, :-1, :-1].sum(axis=0)
                parts[log][np.ix_(live, live)] += own / (size or 1.0)
        whole = parts.sum(axis=0)
        _, scales = scale_products(whole)
        for own in parts:
            others = (whole - own) * scales[:, None] * scales + _RIDGE * np.eye(width)
            ratios = np.linalg.eigvals(np.linalg.solve(others, own * scales[:, None] * scales))
            if np.abs(ratios).max() > _UNKNOWN:
                return False
        return True


_ROUNDS, _CONVERGED, _EXACT = 10, 1e-3, 1e-12
_UNKNOWN = 1e5
"""Squares of a log's columns over those of the others, in a direction that these do not determine."""


def _choose_stride(band: float, period: float) -> int:
    """Return one in how many rows is kept of rows within `band` Hz that are `period` s apart."""
    return max(1, math.floor(1.0 / (_KEPT * band * period)))


_KEPT = 4.0
"""Times the band: rate of the rows that are kept."""


def _build_piece(
    library: Library,
    run: int,
    recording: Recording,
    processing: Processing,
    bands: Sequence[float],
    cutoff: float,
) -> _Piece:
    """Return the rows of a piece of a log within all bands."""
    rate, samples = 1.0 / recording.period, len(recording.time) - processing.drop_first - processing.drop_last
    step = max(1, round(rate / ROW_RATE))
    ends = round(min(_ENDS * rate, _PART * samples) / step) * step
    places = np.arange(ends, samples - ends, step)
    settings = replace(processing, automatic=False)
    signals = prepare_states(library, recording, replace(settings, filter_cutoff=cutoff))
    thin = max(k for k in range(1, step + 1) if step % k == 0 and k <= max(1.0, rate / (_RATE * cutoff)))
    columns = evaluate_columns(library, *signals.pick_states(slice(None, None, thin)))
    count, joints, width = columns.shape
    columns = columns.reshape(count, -1)
    matrices, smooths, strides, speeds = [], [], [], []
    for band in bands:
        slow = prepare_states(library, recording, replace(settings, filter_cutoff=min(band, 0.4 * rate)))
        stride = _choose_stride(band, step / rate)
        matrix = _filter_rows(columns, band / rate * thin, places[::stride] // thin)
        torque = _filter_rows(signals.tau, band / rate, places)[:, :, None]
        smooth = evaluate_columns(library, *slow.pick_states(places))
        matrices.append(np.concatenate([matrix.reshape(-1, joints, width), torque[::stride]], axis=2))
        smooths.append(np.concatenate([smooth, torque], axis=2))
        strides.append(stride)
        speeds.append(slow.dq[places])
    friction = np.array([joint.friction != "none" for joint in library.card.joints])
    resting = np.isin(np.arange(len(friction)), list_resting_joints(recording))
    return _Piece(
        run=run,
        matrices=tuple(matrices),
        smooths=tuple(smooths),
        strides=tuple(strides),
        speed=speeds[min(SCORING, len(speeds) - 1)],
        out=resting & friction,
    )


def scale_products(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return D M D of products (..., p, p) with ones on its diagonal and a tiny ridge, and D (..., p)."""
    lengths = np.sqrt(np.abs(np.diagonal(matrix, axis1=-2, axis2=-1)))
    alive = lengths > 1e-9 * lengths.max(axis=-1, keepdims=True, initial=np.finfo(float).tiny)
    scales = np.where(alive, 1.0 / np.where(alive, lengths, 1.0), 0.0)
    ridge = _RIDGE * np.eye(scales.shape[-1])
    return matrix * scales[..., :, None] * scales[..., None, :] + ridge, scales


def solve_products(whole: FloatArray) -> FloatArray:
    """Return x (..., p) of A x = a, [A a] the first rows of `whole` (..., p + 1, p + 1)."""
    scaled, scales = scale_products(whole[..., :-1, :-1])
    return np.asarray(np.linalg.solve(scaled, (whole[..., :-1, -1] * scales)[..., None])[..., 0] * scales)
