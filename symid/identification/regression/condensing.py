"""Logs as sums of products, by block of time, joint, speed and band: of these all choices are computed.

Library, recordings, Processing, bands -> `CondensedLogs` -> fits, what fits without a stretch leave of it,
and what every block changes, by algebra alone: as fast for an hour as for ten seconds.

    level k      rows of [Y | Yf] and torque within the band b_k: both through the same linear low-pass
    smooth k     the columns along positions that pass a low-pass at b_k: instruments
    sums         Z'[Y y] of each block, joint and class of speed; Z smooth, or the rows (least squares)
    weights      w_j = (m_j - r_j) / |e_j|^2,  m_j = 2 b T_j,  r_j = tr(A^-1 w_j S_j) the leverage of joint j
    x_(-f)       parameters without fold f, a sixth of the logs
    changes      c_b = -(A^-1 s_b + (A - A_b)^-1 s_b) / 2,  s_b = Z_b'W (y_b - Y_b x)

The weights are those of restricted maximum likelihood (Patterson and Thompson 1971, Biometrika 58): a joint
with as many parameters of its own as rows gets no weight from a residual that is zero for that reason. The
sum of c_b c_b' is the covariance of x for residuals that are correlated within blocks, without the bias of
few blocks to first order (the mean of the infinitesimal and the delete-one jackknife; Bell and McCaffrey
2002, Survey Methodology 28).

Supported: several logs; known payloads; joints at rest; logs of any length (of long ones six pieces of twenty
seconds at even distances).
Not supported: logs of different sample rates; rows of windows; weights of recordings.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from symid import logs as log_files
from symid.arrays import FloatArray, FrozenArrays, find_runs
from symid.codegen import Library
from symid.identification.judge import POLICY, numerics
from symid.identification.regression.equations import evaluate_columns
from symid.identification.regression.identifiability import list_resting_joints
from symid.identification.regression.preparation import (
    count_spoilt,
    measure_bands,
    measure_moving_ends,
    prepare_states,
)
from symid.robot import Processing

ROW_RATE = 200.0
"""Hz, the highest rate of rows."""
SHARES = (0.0, 0.1)
"""Classes of speed, in parts of the top speed."""
SCORING = 2
"""The level of the scoring band: there are two lower ones, an octave apart."""
_PIECE = 20.0
"""s, of a long log at a time."""
_RATE, _TAPS, _HELD = 2.5, 2.0, 0.4
"""Times the cut-off of the positions: rate at which columns are evaluated. Periods of the band on either
side of a filter's middle. Widest band, in cycles a row, that rows hold."""
ENDS, PART = 0.5, 0.05
"""s, and part of a log, that do not count at either end, where filters extrapolate."""


def measure_scoring_band(recordings: Sequence[log_files.Recording]) -> float:
    """Return twice the band in Hz that holds 99 % of the velocities' power, the median of joints and logs.

    The power is the integral of (2 pi f)^2 (density - floor) over frequencies at which the density of the
    position is ten times its floor (the median of the upper half of all frequencies) or more, up to the first
    two octaves without any above the strongest. Where velocities were logged, their band counts if it is
    lower: it has no noise of stamps in it.
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
    """Return the band (n,) in Hz that holds 99 % of f^power density of each column, NaN for none."""
    length = min(len(values), max(64, round(4.0 * rate)))
    frequency, density = log_files.estimate_density(values, rate, length)
    floor = np.median(density[frequency > 0.25 * rate], axis=0)
    found = np.full(values.shape[1], np.nan)
    for k in range(values.shape[1]):
        there = density[:, k] > 10.0 * floor[k]
        peak = 1 + np.argmax(np.where(there, density[:, k], 0.0)[1:])
        places = np.flatnonzero(there & (frequency >= frequency[peak]))
        # The upper end is where the next two octaves are empty, above the strongest motion.
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


def measure_repetition(recording: log_files.Recording, band: float) -> float:
    """Return the period in s of a motion in a `band` in Hz that repeats, 0 where it does not, twice at least.

    The least lag at which positions differ by less than matters: |q(t + P) - q(t)| in root mean squares over
    that of lags at which they are unrelated.
    """
    # So fine that half a step differs by less than matters, too.
    step = max(1, math.floor(1.0 / (100.0 * band * recording.period)))
    position = recording.position[::step] - recording.position.mean(axis=0)
    count = len(position)
    moved = 2.0 * float(np.sum(np.mean(position**2, axis=0)))
    if count < 8 or not moved:
        return 0.0
    # A power of two: other lengths may take several times as long.
    size = 1 << (2 * count - 1).bit_length()
    power = sum(np.abs(np.fft.rfft(values, n=size)) ** 2 for values in position.T)
    products = np.fft.irfft(power, n=size)[:count]
    squares = np.concatenate([[0.0], np.cumsum(np.sum(position**2, axis=1))])
    lags = np.arange(count // 2 + 1)
    # Sums over the overlap of both.
    both = squares[count - lags] + squares[-1] - squares[lags] - 2.0 * products[lags]
    apart = both / (count - lags) / moved
    far = np.flatnonzero(apart > 0.5)
    if not len(far):
        return 0.0
    near = np.flatnonzero(apart[far[0] :] < POLICY.relevance**2)
    return float((far[0] + near[0]) * step * recording.period) if len(near) else 0.0


def mask_rest(speed: FloatArray, top: float, length: int) -> NDArray[np.bool_]:
    """Return where a joint rests (N,): slower than 2 % of the `top` speed for `length` samples or more.

    Dry friction holds any torque there, and a law of friction has nothing to say.
    """
    slow = np.abs(speed) <= POLICY.relevance * top
    for first, last in find_runs(slow):
        if last - first < length:
            slow[first:last] = False
    return slow


def mask_trembling(recordings: Sequence[log_files.Recording], units: Sequence[str]) -> NDArray[np.bool_]:
    """Return the joints (n,) that turn by less than matters, beside others that move far more.

    What holds such a joint may be a brake or a lock, so that it rests.
    """
    highest = np.max([entry.position.max(axis=0) for entry in recordings], axis=0)
    spread = highest - np.min([entry.position.min(axis=0) for entry in recordings], axis=0)
    turning = np.array([unit == "rad" for unit in units])
    widest = spread[turning].max(initial=0.0)
    return np.asarray(turning & (spread < POLICY.relevance * min(1.0, float(widest))))


def balance_cutoff(recordings: Sequence[log_files.Recording]) -> float:
    """Return the cut-off in Hz at which noise and blur of the velocities are equal, the mean of joints.

    Columns of friction bend where the velocity turns, and want a sharp velocity; noise in the accelerations
    is taken out with that of the torque, as their columns are linear in it.
    """
    found = []
    for recording in recordings:
        smooth = Processing(filter_cutoff=min(10.0, 0.4 / recording.period), filter_order=2)
        turning = np.sqrt(log_files.SignalParts(recording, smooth).measure_accelerations())
        for band, rate in zip(measure_bands(recording), turning.tolist(), strict=False):
            if band.clean > 0.0:
                power = rate * np.sqrt(3.0) / ((2.0 * np.pi) ** 2 * max(band.floor, 1e-300))
                found.append(power**0.4)
    return float(np.median(found)) if found else 0.0


Source = Callable[[slice], FloatArray]
"""From some samples to their values (k, c)."""


def _filter_bands(
    source: Source, count: int, bands: Sequence[float], step: int, kept: Sequence[NDArray[np.intp]]
) -> list[FloatArray]:
    """Return `count` samples of a source within each band (rising, cycles a sample) at `kept` of its rows.

    Rows are one sample in `step`. A band an octave or more below one that rows hold is taken from these rows:
    its gain is the product of both, at no frequency more than 0.005 from that of its own filter.
    """
    found: list[FloatArray] = []
    base, held = np.empty((0, 0)), 0.0
    for band, places in zip(bands[::-1], kept[::-1], strict=True):
        if 2.0 * band <= held * (1.0 + numerics.CONVERGED):
            found.append(_filter_rows(base.__getitem__, len(base), band * step, places))
        elif band * step <= _HELD:
            base, held = _filter_rows(source, count, band, np.arange(0, count, step)), band
            found.append(base[places])
        else:
            found.append(_filter_rows(source, count, band, places * step))
    return found[::-1]


def _filter_rows(source: Source, count: int, band: float, places: NDArray[np.intp]) -> FloatArray:
    """Return `count` samples of a source, low-passed at `band` cycles each, at `places` of even distances."""
    half = round(_TAPS / band)
    plain = band >= 0.45 or not half
    half = 0 if plain else min(half, count - 1)
    # A windowed sinc with gain one at zero.
    taps = np.sinc(2.0 * band * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    taps /= np.sum(taps)
    first, step = int(places[0]), int(places[1] - places[0]) if len(places) > 1 else 1
    # The weights of some neighbouring places are one matrix, twice as wide as those of one.
    together = 1 + min(len(places) - 1, max(1, 2 * half // step))
    weights = np.zeros((together, len(taps) + step * (together - 1)))
    for place, row in enumerate(weights):
        row[step * place : step * place + len(taps)] = taps
    rows = np.empty((0, 0))
    # So many places that their samples are a block.
    most = together * max(1, numerics.BLOCK // (step * together))
    for start in range(0, len(places), most):
        begin = first + step * start
        size = min(most, len(places) - start)
        low, high = begin - half, begin + step * (size - 1) + half + 1
        values = source(slice(max(low, 0), min(high, count)))
        rows = rows if start else np.zeros((len(places), values.shape[1]))
        live = log_files.list_live(values)
        ends = max(-low, 0), max(high - count, 0)
        padded = np.pad(values[:, live], (ends, (0, 0)), mode="reflect", reflect_type="odd")
        for place in range(0, size, together):
            own = min(together, size - place)
            part = padded[step * place : step * (place + own - 1) + len(taps)]
            rows[start + place : start + place + own, live] = weights[:own, : len(part)] @ part
    return rows


def pick_pieces(recordings: Sequence[log_files.Recording]) -> list[tuple[int, log_files.Recording]]:
    """Return each log with its number, of long ones six pieces of twenty seconds at even distances."""
    pieces = []
    for run, recording in enumerate(recordings):
        # Of stamps in milliseconds that pass as seconds, more than twenty seconds.
        rate = max(1.0 / recording.period, 0.25 * ROW_RATE)
        count, most = len(recording.time), round(_PIECE * rate)
        if count <= POLICY.folds * most:
            pieces.append((run, recording))
            continue
        starts = np.linspace(0, count - most, POLICY.folds).astype(int).tolist()
        pieces += [(run, log_files.cut_recording(recording, slice(start, start + most))) for start in starts]
    return pieces


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockFit(FrozenArrays):
    """A fit: parameters (p,), those without each fold (f, p), what blocks change (b, p); weights (n,)."""

    values: FloatArray
    folds: FloatArray
    changes: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThinMotion:
    """Samples of all logs within the scoring band, one after the other, four times its rate.

    q, dq, ddq, tau (t, n); `kept` (t, n) whether a joint's row counts; `block` (t,) number of its block;
    `run` (t,) of its log; `period` s, between samples of a log.
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    kept: NDArray[np.bool_]
    block: NDArray[np.intp]
    run: NDArray[np.intp]
    period: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Piece:
    """Rows of a piece of a log: of each level live columns (t, l) and torques (t, n), one in `strides` of T.

    `acts` (n, p) columns that are live; `slow`: states (T, n) of each level, of which instruments are made;
    `states` (3, T, n) and `tau` (T, n) of the scoring band; `wrong` (T, n) rows in which bad samples are
    noticed; `out` (n,) joints left out.
    """

    run: int
    matrices: tuple[FloatArray, ...]
    torques: tuple[FloatArray, ...]
    acts: NDArray[np.bool_]
    slow: tuple[log_files.States, ...]
    strides: tuple[int, ...]
    states: FloatArray
    tau: FloatArray
    wrong: NDArray[np.bool_]
    out: NDArray[np.bool_]
    resting: NDArray[np.bool_]

    def pick(self, matrix: FloatArray, joint: int, live: NDArray[np.intp]) -> FloatArray:
        """Return columns of a joint (t, k) of all live ones (t, l)."""
        found, places = np.zeros((len(matrix), len(live))), np.cumsum(self.acts).reshape(self.acts.shape) - 1
        own = self.acts[joint, live]
        found[:, own] = matrix[:, places[joint, live[own]]]
        return found

    @property
    def columns(self) -> FloatArray:
        """Return the columns (t, n, p) within the scoring band."""
        matrix = self.matrices[SCORING]
        found = np.zeros((len(matrix), self.acts.size))
        found[:, self.acts.ravel()] = matrix
        return found.reshape(len(matrix), *self.acts.shape)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandSums:
    """Sums of products of rows: of each joint, its live columns and the torque last.

    `products` (b, c, l, l) are of Z'[Y y] of each joint, from a class of speed c upwards; `squares` of [Y
    y]'[Y y], the same where there are no instruments. `counts` (n, b, c) rows, `worth` of a row, as an
    independent one; `live` of each joint the places of its columns among `width` parameters.
    """

    products: tuple[FloatArray, ...]
    squares: tuple[FloatArray, ...]
    counts: FloatArray
    worth: float
    live: tuple[NDArray[np.intp], ...]
    width: int

    def join(self, tables: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
        """Return the weighted sum (..., p + 1, p + 1) of the tables (..., l, l) of all joints."""
        found = np.zeros((*tables[0].shape[:-2], self.width + 1, self.width + 1))
        for table, live, weight in zip(tables, self.live, weights, strict=True):
            columns = np.append(live, self.width)
            found[..., columns[:, None], columns] += weight * table
        return found

    def join_squares(
        self, classes: Sequence[int], weights: FloatArray, blocks: slice | NDArray[np.bool_] = slice(None)
    ) -> FloatArray:
        """Return the weighted sum (p + 1, p + 1) of the squares of blocks, from classes (n,) of speed on."""
        pairs = zip(self.squares, classes, strict=True)
        return self.join([table[blocks, share].sum(axis=0) for table, share in pairs], weights)


def add_products(into: FloatArray, left: FloatArray, right: FloatArray, cell: NDArray[np.intp]) -> FloatArray:
    """Add left'right of the rows of each cell (t,) to `into` (cells, l, l), and return their counts."""
    order = np.argsort(cell, kind="stable")
    bounds = np.searchsorted(cell[order], np.arange(len(into) + 1))
    for place, (low, high) in enumerate(pairwise(bounds.tolist())):
        if high > low:
            chosen = order[low:high]
            into[place] += left[chosen].T @ right[chosen]
    return np.diff(bounds)


def sum_motion(columns: FloatArray, motion: ThinMotion, blocks: int) -> BandSums:
    """Return the sums of rows with `columns` (t, n, p) along a motion and its torques."""
    products, live = [], []
    counts = np.zeros((columns.shape[1], blocks, 1))
    for joint in range(columns.shape[1]):
        places = np.flatnonzero(columns[:, joint].any(axis=0))
        kept = np.flatnonzero(motion.kept[:, joint])
        rows = np.column_stack([columns[kept, joint][:, places], motion.tau[kept, joint]])
        table = np.zeros((blocks, rows.shape[1], rows.shape[1]))
        counts[joint, :, 0] = add_products(table, rows, rows, motion.block[kept])
        products.append(table[:, None])
        live.append(places)
    return BandSums(
        products=tuple(products),
        squares=tuple(products),
        counts=counts,
        worth=2.0 / _KEPT,
        live=tuple(live),
        width=columns.shape[2],
    )


def fit_sums(
    sums: BandSums,
    classes: Sequence[int],
    fold: NDArray[np.intp],
    chosen: NDArray[np.bool_] | None = None,
    weights: FloatArray | None = None,
) -> BlockFit:
    """Return the fit to rows of each joint from a class (n,) of speed on; of some blocks (b,) if `chosen`.

    `fold` (b,) is the number of each block's fold; `weights` (n,) are found if None.
    """
    kept = np.ones(len(fold), dtype=np.bool_) if chosen is None else chosen
    pairs = list(enumerate(classes))
    parts = [sums.products[joint][:, share] * kept[:, None, None] for joint, share in pairs]
    wholes = [part.sum(axis=0) for part in parts]
    if weights is None:
        own = [np.tensordot(kept, sums.squares[joint][:, share], 1) for joint, share in pairs]
        rows = sums.worth * (sums.counts[np.arange(len(own)), :, classes] @ kept)
        size = np.array([table[-1, -1] for table in own])
        weights = np.divide(rows, size, out=np.zeros_like(rows), where=size > 0.0)
        for _ in range(numerics.ROUNDS):
            whole = sums.join(wholes, weights)
            scaled, scales = scale_products(whole[:-1, :-1])
            inverse = np.linalg.inv(scaled) * scales[:, None] * scales
            values, before = inverse @ whole[:-1, -1], weights.copy()
            for joint, live in enumerate(sums.live):
                error = np.append(values[live], -1.0)
                left = max(float(error @ own[joint] @ error), numerics.EXACT * float(size.max()))
                leverage = np.sum(inverse[np.ix_(live, live)] * wholes[joint][:-1, :-1].T)
                spare = max(rows[joint] - weights[joint] * float(leverage), numerics.EXACT * rows[joint])
                weights[joint] = spare / left if left > 0.0 else 0.0
            if np.all(np.abs(weights - before) <= _CONVERGED * weights):
                break
    whole, tables = sums.join(wholes, weights), sums.join(parts, weights)
    values = solve_products(whole)
    folds = [whole - tables[fold == place].sum(axis=0) for place in range(int(fold.max()) + 1)]
    scores = tables[:, :-1, -1] - tables[:, :-1, :-1] @ values
    # What a block changes, once without it in the matrix, once with it.
    pair = np.stack([whole - tables, np.broadcast_to(whole, tables.shape)])
    pair[..., :-1, -1] = scores
    return BlockFit(
        values=values,
        folds=solve_products(np.stack(folds)),
        changes=-0.5 * solve_products(pair).sum(axis=0),
        weights=weights,
    )


def measure_left(sums: BandSums, values: FloatArray) -> FloatArray:
    """Return squares (n, b, c) that values of each block (b, p) leave of rows from a class of speed on."""
    found = []
    for live, table in zip(sums.live, sums.squares, strict=True):
        errors = np.column_stack([values[:, live], np.full(len(values), -1.0)])
        found.append((errors[:, None, None] @ (table @ errors[:, None, :, None]))[..., 0, 0])
    return np.asarray(np.maximum(np.stack(found), 0.0))


class CondensedLogs:
    """Rows of several logs within several bands, and their sums.

    Attributes:
        bands: Hz, rising, at place `SCORING` the scoring band.
        limits: (n, c) speeds in rad/s or m/s from which classes of speed begin, the first is zero.
        torque: (n,) squares within the scoring band, 0 where a joint rests or has no torque.
        log: (b,) number of the log of every block; fold: (b,) of its fold.
        scores: sums of the band below the scoring band, and of that one, where losses are measured.
        repeats: s, the period of a motion that repeats, 0 for one that does not.
    """

    def __init__(
        self,
        library: Library,
        recordings: Sequence[log_files.Recording],
        processing: Processing,
        bands: Sequence[float],
        cutoff: float | None,
    ) -> None:
        """Build the rows of all bands, and cut them into blocks."""
        self.bands, self._width, self._library = tuple(bands), len(library.card.fitted), library
        self.period = recordings[0].period * max(1, round(1.0 / (recordings[0].period * ROW_RATE)))
        self.repeats = measure_repetition(recordings[0], bands[SCORING]) if len(recordings) == 1 else 0.0
        self._pieces = [
            _build_piece(library, run, recording, processing, bands, cutoff)
            for run, recording in pick_pieces(recordings)
        ]
        joints, speeds = library.card.joints, [np.abs(piece.states[1]) for piece in self._pieces]
        if "standstill" in processing.left_open:
            fast: FloatArray = np.max([np.quantile(speed, 0.99, axis=0) for speed in speeds], axis=0)
            self.limits = fast[:, None] * SHARES
        else:
            stated = list(map(processing.get_standstill, range(len(joints))))
            self.limits = np.column_stack([np.zeros(len(stated)), stated])
        top = np.max([speed.max(axis=0) for speed in speeds], axis=0)
        top[mask_trembling(recordings, [joint.position_unit for joint in joints])] = np.inf
        length = max(2, round(1.0 / (self.bands[SCORING] * self.period)))
        # (T, n) rows at rest of joints with friction, and wrong ones: they count for nothing.
        self._rest = [piece.wrong.copy() for piece in self._pieces]
        for speed, rest in zip(speeds, self._rest, strict=True):
            for k, joint in enumerate(joints):
                if joint.friction != "none":
                    rest[:, k] |= mask_rest(speed[:, k], float(top[k]), length)
        acts = np.any([piece.acts for piece in self._pieces], axis=0)
        self._live = tuple(map(np.flatnonzero, acts))
        log, fold, self._blocks = list[int](), list[int](), list[NDArray[np.intp]]()
        runs = [piece.run for piece in self._pieces]
        each = max(2, math.ceil(POLICY.folds / (runs[-1] + 1)))
        for piece in self._pieces:
            # Parts of two periods of the scoring band or more; equal phases of a motion that repeats are
            # in one.
            stretches = 1 if runs.count(piece.run) > 1 else each
            time = np.arange(len(piece.tau)) * self.period
            span = time[-1] + self.period
            if self.repeats and stretches > 1:
                span = min(span, self.repeats)
            parts = int(np.clip(span / stretches * self.bands[SCORING] / POLICY.periods, 1, POLICY.parts))
            count, first = stretches * parts, fold[-1] + 1 if fold else 0
            place = (time % span if stretches > 1 else time) / span * count
            self._blocks.append(len(log) + np.minimum(place.astype(np.intp), count - 1))
            log += [piece.run] * count
            fold += [first + place // parts for place in range(count)]
        self.log, self.fold = np.array(log), np.array(fold)
        self._squares: dict[int, tuple[tuple[FloatArray, ...], FloatArray]] = {}
        self.scores = [self.sum_products([level], level)[0] for level in (SCORING - 1, SCORING)]
        self.torque = np.array([entry[:, 0, -1, -1].sum() for entry in self.scores[1].squares])
        self.torque[np.all([piece.resting for piece in self._pieces], axis=0)] = 0.0

    @property
    def motion(self) -> ThinMotion:
        """Return the thinned motion."""
        stride, parts = self._pieces[0].strides[SCORING], []
        for piece, block, rest in zip(self._pieces, self._blocks, self._rest, strict=True):
            states = (*piece.states[:, ::stride], piece.tau[::stride])
            kept = (np.abs(states[1]) >= self.limits[:, -1]) & ~piece.out & ~rest[::stride]
            parts.append((*states, kept, block[::stride], np.full(len(kept), piece.run)))
        whole = map(np.concatenate, zip(*parts, strict=True))
        names = ("q", "dq", "ddq", "tau", "kept", "block", "run")
        return ThinMotion(**dict(zip(names, whole, strict=True)), period=self.period * stride)

    @property
    def columns(self) -> FloatArray:
        """Return the columns (t, n, p) along the thinned motion, which pass the same low-pass as torques."""
        return np.concatenate([piece.columns for piece in self._pieces])

    def sum_products(self, levels: Sequence[int], smooth: int) -> list[BandSums]:
        """Return the sums of rows of each level, with instruments of a lower one, or of least squares."""
        lefts: list[FloatArray] = []
        if any(level != smooth for level in levels):
            for piece in self._pieces:
                columns = evaluate_columns(self._library, *piece.slow[smooth])
                lefts.append(columns.reshape(len(columns), -1)[:, piece.acts.ravel()])
        found = []
        for level in levels:
            if level not in self._squares:
                self._squares[level] = self._cross(level)
            squares, counts = self._squares[level]
            stride = self._pieces[0].strides[level]
            sums = BandSums(
                products=squares if smooth == level else self._cross(level, lefts)[0],
                squares=squares,
                counts=counts,
                worth=min(1.0, 2.0 * self.bands[level] * self.period * stride),
                live=self._live,
                width=self._width,
            )
            found.append(sums)
        return found

    def release(self) -> None:
        """Forget all rows but those of the scoring band, so that no other sums can be made."""
        self._squares = {}
        for place, piece in enumerate(self._pieces):
            kept = (part if k == SCORING else np.empty(0) for k, part in enumerate(piece.matrices))
            self._pieces[place] = replace(piece, matrices=tuple(kept), slow=())

    def _cross(
        self, level: int, lefts: Sequence[FloatArray] = ()
    ) -> tuple[tuple[FloatArray, ...], FloatArray]:
        """Return the products (b, c, l, l) of a level's rows with live columns (T, l) of each piece; counts.

        Without columns the rows stand on both sides.
        """
        blocks, classes = len(self.log), self.limits.shape[1]
        products: list[FloatArray] = []
        counts = np.zeros((len(self._live), blocks, classes))
        for joint, live in enumerate(self._live):
            table = np.zeros((blocks * classes, len(live) + 1, len(live) + 1))
            for place, piece in enumerate(self._pieces):
                if piece.out[joint]:
                    continue
                stride, torque = piece.strides[level], piece.torques[level][:, joint]
                right = np.column_stack([piece.pick(piece.matrices[level], joint, live), torque])
                speed = np.abs(piece.states[1][::stride, joint])
                kind = np.searchsorted(self.limits[joint], speed, side="right") - 1
                cell = self._blocks[place][::stride] * classes + kind
                cell[self._rest[place][::stride, joint]] = -1
                left = piece.pick(lefts[place][::stride], joint, live) if lefts else right
                into = table[:, : left.shape[1]]
                counts[joint] += add_products(into, left, right, cell).reshape(blocks, classes)
            # From a speed upwards.
            whole = table.reshape(blocks, classes, *table.shape[1:])[:, ::-1]
            products.append(np.cumsum(whole, axis=1)[:, ::-1])
        return tuple(products), np.cumsum(counts[..., ::-1], axis=2)[..., ::-1]

    def measure_losses(self, fit: BlockFit, share: int = 0) -> FloatArray:
        """Return squares (b, n) that folds leave of what they leave out, relative to the torque, both bands.

        Rows count from the class of speed `share` on.
        """
        found = np.zeros((len(self.log), len(self._live)))
        for sums in self.scores:
            sizes = np.array([table[:, share, -1, -1].sum() for table in sums.squares])
            left = measure_left(sums, fit.folds[self.fold])[:, :, share]
            moving = self.torque > 0.0
            found[:, moving] += (left[moving] / np.where(sizes > 0.0, sizes, np.inf)[moving, None]).T
        return found

    def list_proportions(self) -> list[tuple[int, int]]:
        """Return the pairs of moving joints whose velocities are in proportion throughout."""
        speed = self.motion.dq
        speed = speed - speed.mean(axis=0)
        lengths = np.linalg.norm(speed, axis=0)
        turning = np.flatnonzero((self.torque > 0.0) & (lengths > 0.0)).tolist()
        # Apart by less than rounding of the positions.
        return [
            (j, k)
            for j, k in combinations(turning, 2)
            if 1.0 - abs(float(speed[:, j] @ speed[:, k]) / (lengths[j] * lengths[k])) < numerics.CONVERGED
        ]

    def list_grams(self) -> FloatArray:
        """Return the products (n, p, p) of each joint's columns within the scoring band, of all rows."""
        found = np.zeros((len(self._live), self._width, self._width))
        for gram, live, table in zip(found, self._live, self.scores[1].squares, strict=True):
            gram[np.ix_(live, live)] = table[:, 0, :-1, :-1].sum(axis=0)
        return found


_CONVERGED = 1e-3
"""Relative change of weights at which they are settled."""
_KEPT = 4.0
"""Times the band: rate of the rows that are kept."""


def _build_piece(  # noqa: PLR0917 - a log and how its rows are made
    library: Library,
    run: int,
    recording: log_files.Recording,
    processing: Processing,
    bands: Sequence[float],
    cutoff: float | None,
) -> _Piece:
    rate, settings = 1.0 / recording.period, replace(processing, automatic=False)
    # Where filters extrapolate: of the positions at any end, of the scoring band where joints move there.
    spoilt = count_spoilt(cutoff, recording.period)
    drop = max(spoilt, settings.drop_first), max(spoilt, settings.drop_last)
    settings = replace(settings, drop_first=drop[0], drop_last=drop[1])
    ends = measure_moving_ends(replace(settings, filter_cutoff=bands[SCORING]), [recording])
    samples, step = len(recording.time) - sum(drop), max(1, round(rate / ROW_RATE))
    first, last = (round(min(count, PART * samples) / step) * step for count in ends)
    places = np.arange(first, samples - last, step)
    signals = prepare_states(library, recording, replace(settings, filter_cutoff=cutoff))
    most = max(1.0, rate / (_RATE * cutoff)) if cutoff else 1.0
    thin = max(k for k in range(1, step + 1) if step % k == 0 and k <= most)

    def evaluate(part: slice) -> FloatArray:
        states = signals.pick_states(slice(part.start * thin, part.stop * thin, thin))
        return evaluate_columns(library, *states).reshape(part.stop - part.start, -1)

    edges = np.array(bands) / rate
    strides = [max(1, math.floor(1.0 / (_KEPT * band * (step / rate)))) for band in bands]
    kept = [places[::stride] // step for stride in strides]
    count = -(-samples // thin)
    matrices = _filter_bands(evaluate, count, (edges * thin).tolist(), step // thin, kept)
    torques = _filter_bands(
        signals.tau.__getitem__, samples, edges.tolist(), step, [places // step] * len(bands)
    )
    acts = np.any([table.any(axis=0) for table in matrices], axis=0)
    slow, states = [], np.empty(0)
    for level, band in enumerate(bands):
        smooth = prepare_states(library, recording, replace(settings, filter_cutoff=min(band, 0.4 * rate)))
        slow.append(smooth.pick_states(places))
        if level == SCORING:
            states = np.stack(slow[-1][:3])
    wrong = np.zeros(torques[SCORING].shape, dtype=np.bool_)
    if recording.bad is not None:
        # Within the scoring band, which decides.
        touched = log_files.mask_filtered(recording.bad, 0.5 / (bands[SCORING] * recording.period))
        wrong = touched[drop[0] :][places]
    resting = np.isin(np.arange(library.card.size), list_resting_joints(recording))
    friction = np.array([joint.friction != "none" for joint in library.card.joints])
    return _Piece(
        run=run,
        matrices=tuple(table[:, acts] for table in matrices),
        torques=tuple(values[::stride].copy() for values, stride in zip(torques, strides, strict=True)),
        acts=acts.reshape(library.card.size, -1),
        slow=tuple(slow),
        strides=tuple(strides),
        states=states,
        tau=torques[SCORING],
        wrong=wrong,
        out=resting & friction,
        resting=resting,
    )


def scale_products(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return D M D of products (..., p, p) with ones on its diagonal and a tiny ridge, and D (..., p)."""
    lengths = np.sqrt(np.abs(np.diagonal(matrix, axis1=-2, axis2=-1)))
    alive = lengths > 1e-9 * lengths.max(axis=-1, keepdims=True, initial=np.finfo(float).tiny)
    scales = np.where(alive, 1.0 / np.where(alive, lengths, 1.0), 0.0)
    ridge = numerics.RIDGE * np.eye(scales.shape[-1])
    return matrix * scales[..., :, None] * scales[..., None, :] + ridge, scales


def solve_products(whole: FloatArray) -> FloatArray:
    """Return x (..., p) of A x = a, [A a] the first rows of `whole` (..., p + 1, p + 1)."""
    scaled, scales = scale_products(whole[..., :-1, :-1])
    return np.asarray(np.linalg.solve(scaled, (whole[..., :-1, -1] * scales)[..., None])[..., 0] * scales)
