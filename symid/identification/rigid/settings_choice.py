"""Band, instruments and standstill speed chosen from the logs, by prediction of held-out stretches.

Library, recordings, Processing -> `SettingsChoice`: the processing, and what every candidate predicted.

    scoring band B    twice the band that holds 99 % of the velocities' power, from the positions' spectra
    candidates        rows within bands B 2^k; least squares, or instruments: the same rows along positions
                      that pass a low-pass at a lower band; rows below a part of the top speed left out
    held out          |y - A x|^2 of every stretch, x from the others, within B/2 and B, of joint and band
                      relative to |y|^2; every row counts, slow ones too
    movement          rms over parameters of |x - x'| over the deviation of x', the largest over all x' of
                      less band

A candidate stands still where its movement is below 1.5: noise alone moves an estimate by less than the
deviation of the one with less data (Hausman 1978, Econometrica 46), noise in the regressor by more. Of all
that stand still and whose held-out loss is within half a standard error, or five percent, of the best, the
one with the widest rows is taken; where none stands still, the best of all, and the estimate is doubtful.

Columns and torques pass the same linear-phase filter (a windowed ideal low-pass), so that a model that is
linear in its parameters stays true. Deviations are of the jackknife over the stretches.

Supported: several logs, then whole logs are held out as well, unless one moves what the others do not; known
payloads; joints at rest.
Not supported: a band for each joint; rows of windows; logs of different sample rates.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.identification import diagnostics
from symid.identification.estimators import Candidate, SettingsChoice
from symid.identification.regression import evaluate_columns, list_resting_joints, prepare_states
from symid.logs import STATES, Recording, cut_recording, has_states, mask_filtered
from symid.robot import Processing

ROW_RATE = 200.0
"""Hz of the rows that are compared."""
SHARES = (0.0, 0.02, 0.05, 0.1)
"""Of the top speed, below which rows may be left out."""
_MOST_BAND = 80.0
_OCTAVES = 2
"""Below the scoring band, down to which instruments go; one less may be chosen."""
_STATES = 5.0
"""Times the band: cut-off of the positions, which damps nothing within the band."""
_RATE = 20.0
"""Times the band: rate at which columns are evaluated."""
_TAPS = 2.0
"""Periods of the band on either side of the filter's middle."""
_TOGETHER = 64
"""Places at even distances that are filtered by one product of matrices."""
_TOP = 0.99
_WIDER = 2
"""Octaves by which rows are wider than their instruments at most: more adds noise only."""
_ALIKE = 1.05
"""Times the best residual: others up to here are as good in practice."""
_SMALL = 0.02
"""Of a value: a movement that does no harm."""
_MARGIN = 0.5
"""Standard errors of the held-out loss within which the widest band is taken."""
_ROUNDS = 3
_PIECE = 20.0
"""s, of a long log at a time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Level:
    """Rows of one log: matrix, `smooth` along smooth states (T, n, p + 1), torque last; velocity (T, n)."""

    matrix: FloatArray
    smooth: FloatArray
    velocity: FloatArray


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
        if count <= diagnostics.STRETCHES * most:
            pieces.append((run, recording))
            continue
        starts = np.linspace(0, count - most, diagnostics.STRETCHES).astype(int).tolist()
        pieces += [(run, cut_recording(recording, slice(start, start + most))) for start in starts]
    return pieces


class _Study:
    """Sums of all levels of all logs, and fits to them."""

    def __init__(
        self,
        library: Library,
        pieces: Sequence[tuple[int, Recording]],
        processing: Processing,
        bands: Sequence[float],
    ) -> None:
        """Build the rows of all bands, and sum their products by stretch and speed."""
        self.bands, self.processing = tuple(bands), processing
        self.pairs = [(k, z) for k in range(len(bands)) for z in range(k + 1)]
        friction = np.array([joint.friction != "none" for joint in library.card.joints])
        self.dry = bool(friction.any())
        runs, tops, levels, wrong = [], [], [], []
        count = diagnostics.count_stretches(len(pieces))
        for run, recording in pieces:
            samples = len(recording.time) - (processing.drop_first or 0) - (processing.drop_last or 0)
            step = max(1, round(1.0 / (recording.period * ROW_RATE)))
            # Where filters extrapolate.
            ends = round(min(diagnostics.ENDS / recording.period, diagnostics.PART * samples) / step) * step
            places = np.arange(ends, samples - ends, step)
            levels.append([self._build_level(library, recording, band, places) for band in bands])
            tops.append(np.quantile(np.abs(levels[-1][_OCTAVES].velocity), _TOP, axis=0))
            runs += [run] * count
            bad = (
                np.zeros(recording.position.shape, dtype=np.bool_) if recording.bad is None else recording.bad
            )
            # Within the scoring band, which decides.
            touched = mask_filtered(bad, 0.5 / (bands[_OCTAVES] * recording.period))
            wrong.append(touched[processing.drop_first or 0 :][places])
        self.top: FloatArray = np.max(tops, axis=0)
        self.runs = np.array(runs)
        self.count = len(runs)
        joints, width = levels[0][0].matrix.shape[1:]
        shape = (self.count, len(SHARES), joints, width, width)
        self.sums = {pair: np.zeros(shape) for pair in self.pairs}
        for place, ((_, recording), own, bad) in enumerate(zip(pieces, levels, wrong, strict=True)):
            out = np.isin(np.arange(library.card.size), list_resting_joints(recording)) & friction
            speed = np.abs(own[_OCTAVES].velocity) / np.where(self.top > 0.0, self.top, 1.0)
            kind = np.searchsorted(SHARES, speed, side="right") - 1
            kind[:, out], kind[bad] = -1, -1
            self._sum_stretches(own, kind, range(place * count, (place + 1) * count))
        # From a speed upwards.
        for sums in self.sums.values():
            for share in range(len(SHARES) - 1, 0, -1):
                sums[:, share - 1] += sums[:, share]
        squares = self.sums[_OCTAVES, _OCTAVES][:, 0]
        logs = np.stack([squares[self.runs == run].sum(axis=0) for run in range(runs[-1] + 1)])
        torque = logs[:, :, -1, -1].sum(axis=0)
        self.logwise = diagnostics.determine_each_other(logs, 1.0 / np.where(torque > 0.0, torque, 1.0))

    def _build_level(
        self, library: Library, recording: Recording, band: float, places: NDArray[np.intp]
    ) -> _Level:
        """Return the rows of a log at samples `places` (T,) that are at even distances."""
        rate, step = 1.0 / recording.period, int(places[1] - places[0])
        signals, slow = (
            prepare_states(
                library,
                recording,
                replace(self.processing, filter_cutoff=min(cutoff, 0.4 * rate), automatic=False),
            )
            for cutoff in (_STATES * band, band)
        )
        fast = max(_RATE * band, ROW_RATE)
        thin = max(k for k in range(1, step + 1) if step % k == 0 and k <= max(1.0, rate / fast))
        columns = evaluate_columns(library, *signals.pick_states(slice(None, None, thin)))
        count, joints, width = columns.shape
        matrix = _filter_rows(columns.reshape(count, -1), band * recording.period * thin, places // thin)
        smooth = evaluate_columns(library, *slow.pick_states(places))
        torque = _filter_rows(signals.tau, band * recording.period, places)[:, :, None]
        return _Level(
            matrix=np.concatenate([matrix.reshape(-1, joints, width), torque], axis=2),
            smooth=np.concatenate([smooth, torque], axis=2),
            velocity=slow.dq[places],
        )

    def _sum_stretches(self, levels: Sequence[_Level], kind: NDArray[np.intp], places: range) -> None:
        """Write the sums of a log to `places`, its stretches; `kind` (T, n): class of speed, -1 for none."""
        samples, joints, _ = levels[0].matrix.shape
        edges = pairwise(np.linspace(0, samples, len(places) + 1).astype(int).tolist())
        stretches = list(zip(places, edges, strict=True))
        for joint in range(joints):
            # A joint's torque depends on what it carries alone: most of its columns are zeros.
            tables = [part[:, joint] for level in levels for part in (level.matrix, level.smooth)]
            live = np.flatnonzero(np.any([table.any(axis=0) for table in tables], axis=0))
            block, tables = np.ix_(live, live), [table[:, live] for table in tables]
            for (place, (low, high)), share in product(stretches, range(len(SHARES))):
                chosen = low + np.flatnonzero(kind[low:high, joint] == share)
                if not len(chosen):
                    continue
                rows = [table[chosen] for table in tables]
                for k, z in self.pairs:
                    left = rows[2 * k] if k == z else rows[2 * z + 1]
                    self.sums[k, z][place, share, joint][block] = left.T @ rows[2 * k]

    def fit(self, pair: tuple[int, int], share: int) -> tuple[FloatArray, FloatArray]:
        """Return the parameters of all stretches (p,), and those without each stretch and each log (h, p)."""
        sums = self.sums[pair][:, share]
        squares = self.sums[pair[0], pair[0]][:, share]
        whole, counted = sums.sum(axis=0), squares.sum(axis=0)
        torque = counted[:, -1, -1]
        # A joint without torque, or at rest in all logs, has no rows that count.
        size = np.where(torque > 0.0, torque, 1.0)
        weights = 1.0 / size
        values = diagnostics.solve_sums(whole, weights)
        for _ in range(_ROUNDS):
            left = np.einsum("k,jkl,l->j", np.append(values, -1.0), counted, np.append(values, -1.0))
            weights = 1.0 / np.maximum(left, 1e-12 * size)
            values = diagnostics.solve_sums(whole, weights)
        folds = whole - sums
        if self.logwise:
            logs = [sums[self.runs != run].sum(axis=0) for run in range(self.runs[-1] + 1)]
            folds = np.concatenate([folds, np.stack(logs)])
        return values, diagnostics.solve_sums(folds, weights)

    def measure(self, folds: FloatArray) -> FloatArray:
        """Return the loss (folds, bands, n) of every fold on what it leaves out, relative to the torque."""
        stretches = len(self.runs)
        found = []
        for level in (_OCTAVES - 1, _OCTAVES):
            squares = self.sums[level, level][:, 0]
            whole = squares[:, :, -1, -1].sum(axis=0)
            rows = []
            for fold, values in enumerate(folds):
                held = [fold] if fold < stretches else np.flatnonzero(self.runs == fold - stretches)
                errors = np.append(values, -1.0)
                left = np.einsum("k,bjkl,l->j", errors, squares[held], errors)
                rows.append(np.maximum(left, 0.0) / np.where(whole > 0.0, whole, np.inf))
            found.append(rows)
        return np.swapaxes(np.array(found), 0, 1)

    def choose(self, tried: Sequence[tuple[int, int, int]], shares: range) -> tuple[list[Candidate], int]:
        """Return the candidates (rows k, instruments z, share), and the place of the one to take."""
        last = len(self.bands) - 1
        fits = {(k, z, share): self.fit((k, z), share) for k, z in self.pairs for share in shares}
        candidates, losses = [], []
        for k, z, share in tried:
            values, folds = fits[k, z, share]
            movement = 0.0
            for y in range(z):
                # Rms of the change from an estimate of less band, over the deviations of that one.
                lower, others = fits[(k, y, share) if k > z else (y, y, share)]
                variances = diagnostics.compute_jackknife(others[: self.count])
                deviations = np.sqrt(variances + (_SMALL * lower) ** 2)
                alive = deviations > 0.0
                if alive.any():
                    change = (values - lower)[alive] / deviations[alive]
                    movement = max(movement, float(np.sqrt(np.mean(change**2))))
            loss = self.measure(folds)
            held = (loss if len(loss) == self.count else loss[self.count :]).sum(axis=0)
            losses.append(loss.mean(axis=(1, 2)))
            candidates.append(
                Candidate(
                    states=self.processing.states,
                    band=self.bands[k],
                    instruments=self.bands[z] if z < k else 0.0,
                    standstill=SHARES[share],
                    held_out=tuple((100.0 * np.sqrt(held).mean(axis=1)).tolist()),
                    behind=math.inf,
                    movement=movement,
                )
            )
        costs = [last - k + 0.25 * (k - z) + 0.5 * share for k, z, share in tried]
        still = np.array([entry.still for entry in candidates])
        pool = np.flatnonzero(still) if still.any() else np.arange(len(candidates))
        table = np.array(losses)[pool]
        totals = table.sum(axis=1)
        behind = diagnostics.measure_behind(table, int(np.argmin(totals)))
        close = np.flatnonzero((behind <= _MARGIN) | (totals <= _ALIKE**2 * totals.min()))
        taken = min(close.tolist(), key=lambda place: (costs[pool[place]], totals[place]))
        for place, far in zip(pool.tolist(), behind.tolist(), strict=True):
            candidates[place] = replace(candidates[place], behind=far)
        return candidates, int(pool[taken])


def choose_settings(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    band: float | None = None,
    widest: float | None = None,
    instruments: tuple[bool, ...] = (False, True),
    moving: bool = False,
) -> SettingsChoice:
    """Return the band, instruments and standstill that predict held-out stretches and stand still.

    Args:
        library: the robot's functions.
        recordings: at least one, sampled alike.
        processing: order of the filter, cut ends, and a standstill speed, where they are stated.
        band: Hz, of the rows, where it is stated.
        widest: Hz, where a stated cut-off damps more.
        instruments: whether candidates have instruments: some, all of them, or none.
        moving: whether all candidates leave out slow rows.

    Raises:
        LogError: a recording does not fit the robot.
        IdentifiabilityError: no joint moves in a recording.
    """
    pieces = pick_pieces(recordings)
    scoring = diagnostics.measure_scoring_band(recordings)
    most = band or min(_MOST_BAND, 0.4 * min(1.0 / recordings[0].period, ROW_RATE), widest or math.inf)
    scoring = min(scoring, most if band else 0.5 * most)
    above = max(0, math.floor(math.log2(most / scoring) + 1e-9))
    bands = [scoring * 2.0**k for k in range(-_OCTAVES, above + 1)]
    if band:
        bands = [*(entry for entry in bands if entry < 0.8 * band), band]
    shares = range(int(moving), len(SHARES)) if processing.standstill is None else range(1)
    last = len(bands) - 1
    best: tuple[Candidate, int, tuple[float, ...]] | None = None
    candidates: list[Candidate] = []
    # Up to which columns of all logs states may be used, the stated one alone where there is one.
    usable = [processing.states]
    if processing.states == "position":
        alike = len({recording.velocity is None for recording in recordings}) == 1
        everywhere = (name for name in STATES if all(has_states(recording, name) for recording in recordings))
        usable = [name for name in everywhere if alike or name == "position"]
    for states in usable:
        study = _Study(library, pieces, replace(processing, standstill=None, states=states), bands)
        tried = [
            (k, z, share)
            for k, z in study.pairs
            for share in shares
            # The lowest level has nothing below it to compare with. Along smooth velocities a noisy one has
            # the wrong sign on average near zero, and instruments make dry friction too large.
            if z > 0 and (z < k) in instruments and (k == last if band else k - z <= _WIDER)
            if z == k or share > 0 or len(shares) == 1 or not study.dry
        ]
        found, taken = study.choose(tried, shares)
        other = found[taken]
        if best is None or (
            _ALIKE * np.mean(other.held_out) < np.mean(best[0].held_out) and other.still >= best[0].still
        ):
            best = other, len(candidates) + taken, tuple(study.top.tolist())
        candidates += found
    _, place, top = best or (None, 0, ())
    return SettingsChoice(scoring=scoring, candidates=tuple(candidates), taken=place, top=top)
