"""From a recording to regression equations: filters, states, payload torque, rows left out; long logs.

Recording, Processing -> FilterChoice -> Signals -> Rows.
Library, recordings, processing -> LongRows -> Condensed, of logs that are too long for memory: the matrix is
condensed as it is made, and never kept.

What the processing leaves open is chosen from the logs:

    band     b = min(what the rule of the sample rate keeps, clean bands of joints that move), 5 Hz at least
    rows     one sample in r = 0.8 (rate / 2) / b, so that decimation passes what lies below b
    cut-off  min(5 b, 0.4 rate): high enough that it damps nothing that the rows keep
    windows  of momentum rows as long as rows are apart, so that they keep the same band

The clean band of a joint ends where the noise of its encoder, differentiated twice, has a fiftieth of the
power of its acceleration (`POLICY.relevance`): so much biases parameters towards zero. The noise floor is the
median of the power spectral density of the position (Welch) over the upper half of all frequencies, and

    noise   floor (2 pi)^4 b^5 / 5,     motion   integral to b of (density - floor) (2 pi f)^4 df

Long logs are passed twice, part by part: for values and velocities of all equations, which say what counts,
and for the triangles of [A y] of segments, from which all else is computed. Segments are stretches of time of
one joint in one run; they begin wherever a block of `compute_block_deviations` or a run begins. Equations
that are slow have a triangle of each joint, for what the fit leaves of them.

Supported: several recordings (the best of them counts for each joint); encoders with white noise,
quantisation included; known payloads, whose torque Y dbeta is subtracted; joints at rest, whose rows are
left out where dry friction or a brake may hold them; long logs of torque and momentum rows.
Not supported: a filter for each joint (columns of all joints share one equation); positions that were
filtered before they were logged, whose noise is underestimated; payloads of simulated robots; long logs of
power and energy rows, whose covariance needs every row.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symid import logs
from symid.arrays import FloatArray, measure_top
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.identification.judge import POLICY, Agreement, agree_in_value, compute_changes, numerics
from symid.identification.regression import equations
from symid.identification.regression.identifiability import (
    JOINT_AT_REST,
    Condensed,
    extend_triangle,
    hold_resting_joints,
    list_resting_joints,
)
from symid.logs import Recording, SignalParts, Signals
from symid.robot import Processing, Robot


class JointBand(NamedTuple):
    """Noise of an encoder: its density `floor` in rad or m over root Hz.

    Up to `clean` Hz it is less than `POLICY.relevance` of the acceleration's power.
    """

    floor: float
    clean: float


_BANDS: WeakKeyDictionary[Recording, tuple[JointBand, ...]] = WeakKeyDictionary()


def measure_bands(recording: Recording) -> tuple[JointBand, ...]:
    """Return noise and clean band of every joint of a recording; the same one is measured once."""
    if recording in _BANDS:
        return _BANDS[recording]
    rate = 1.0 / recording.period
    length = min(len(recording.time), max(64, round(2.0 * rate)))
    frequency, density = logs.estimate_density(recording.position, rate, length)
    frequency, steep = frequency[1:], (2.0 * np.pi * frequency[1:]) ** 4
    bands = []
    for column in density[1:].T:
        floor = float(np.median(column[frequency > 0.25 * rate]))
        motion = np.cumsum(np.maximum(column - floor, 0.0) * steep)
        below = np.flatnonzero(np.cumsum(floor * steep) <= POLICY.relevance * motion)
        clean = float(frequency[below[-1]]) if len(below) else 0.0
        bands.append(JointBand(float(np.sqrt(floor)), clean))
    return _BANDS.setdefault(recording, tuple(bands))


class FilterChoice(NamedTuple):
    """What was chosen, and why."""

    processing: Processing
    notices: tuple[Notice, ...] = ()


def choose_filters(processing: Processing, recordings: Sequence[Recording]) -> FilterChoice:
    """Return the processing with cut-off and decimation chosen, where it is `automatic`."""
    usual = logs.choose_processing(processing, recordings[0].period)
    if usual == processing:
        return FilterChoice(processing=processing)
    periods = [entry.period for entry in recordings]
    # Clocks drift.
    if max(periods) - min(periods) > POLICY.relevance * min(periods):
        listed = ", ".join(f"{one.source or 'a log'} every {1e3 * one.period:.4g} ms" for one in recordings)
        text = f"the logs have different sample periods ({listed}), so no common cut-off and decimation can "
        text += "be chosen: state filter_cutoff and decimation under [processing], or resample the logs to "
        text += "one rate"
        raise LogError(Notice(code="identify.mixed-periods", text=text))
    rate = 1.0 / recordings[0].period
    clean = [0.0] * recordings[0].position.shape[1]
    for recording in recordings:
        resting = list_resting_joints(recording)
        for joint, entry in enumerate(measure_bands(recording)[: len(clean)]):
            if joint not in resting:
                clean[joint] = max(clean[joint], entry.clean)
    factor, whole = usual.decimation.factor, 0.5 * usual.decimation.band * rate
    # Robots move up to 5 Hz: these are always kept.
    band = max(5.0, min([whole / factor, *(limit for limit in clean if limit > 0.0)]))
    if processing.decimation.factor == 1:
        factor = max(factor, math.floor(whole / band))
    chosen = logs.choose_processing(processing, recordings[0].period, rate / factor)
    noisy = factor > usual.decimation.factor
    bands = ", ".join(f"{limit:.3g}" if limit else "-" for limit in clean)
    text = f"filter chosen from the logs: positions pass a low-pass at {chosen.filter_cutoff:g} Hz, and one "
    text += f"sample in {factor} is kept (band up to {whole / factor:.3g} Hz, limited by the "
    text += f"{'noise' if noisy else 'rate'}; noise is below {100.0 * POLICY.relevance:g} % of the "
    text += f"accelerations up to {bands} Hz, joint by joint). To set them, state filter_cutoff and "
    text += "decimation under [processing]"
    return FilterChoice(chosen, (Notice(code="identify.automatic", text=text),))


def count_spoilt(cutoff: float | None, period: float) -> int:
    """Return how many samples, `period` s apart, a low-pass at `cutoff` Hz extrapolates at an end."""
    return math.ceil(POLICY.periods / cutoff / period) if cutoff else 0


def measure_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> tuple[int, int]:
    """Return how many samples are wrong at start and end of the logs, 0 where all of them rest there.

    A filter extrapolates there, for as many periods of its cut-off as depend on each other. The speed at an
    end is the mean over one period.
    """
    cutoff, found = processing.filter_cutoff, [0, 0]
    for recording in recordings if cutoff is not None else ():
        spoilt = count_spoilt(cutoff, recording.period)
        span = max(1, round(spoilt / POLICY.periods))
        if span < len(recording.time):
            values, top = recording.position, measure_top(recording.position, span)
            ends = np.abs(values[[span, -1]] - values[[0, -1 - span]])
            moving = np.any(ends > POLICY.relevance * top, axis=1)
            found = [max(one, spoilt if moves else 0) for one, moves in zip(found, moving, strict=True)]
    return found[0], found[1]


def choose_window(kind: str, processing: Processing, period: float, *, chosen: bool = False) -> float:
    """Return the length in s of the windows of rows of a kind, by default.

    `processing` has its decimation settled, `chosen` from the logs or not; `period` of the samples in s.
    """
    factor = processing.decimation.factor
    # Longer windows would damp what torque rows keep: heavy and light joints of a fast motion differ there.
    return max(factor, 2) * period if kind == "momentum" and (chosen or factor > 1) else equations.WINDOW


def fill_loads(
    library: Library, recordings: Sequence[Recording], processing: Processing, beta: FloatArray
) -> list[Recording]:
    """Return recordings with the loads that base parameters (p,) give, where friction reads some.

    Loads of known payloads are added; loads that were measured stay, and have them. Friction rises with
    |load|, which noise of the accelerations would lift where the load changes its sign: loads are those of
    the clean bands of positions.
    """
    measured = list_measured_joints(recordings)
    if "load" not in library.card.friction_inputs or all(measured):
        return list(recordings)
    found = []
    for recording in recordings:
        payload = get_payload(library, recording)
        clean = [band.clean for band in measure_bands(recording) if band.clean > 0.0]
        cutoff = processing.filter_cutoff or POLICY.row_band / recording.period
        cutoff = min(cutoff, float(np.median(clean))) if clean else cutoff
        whole = replace(processing, filter_cutoff=cutoff, drop_first=0, drop_last=0, automatic=False)
        resting = list_resting_joints(recording)
        signals = hold_resting_joints(logs.prepare_signals(replace(recording, load=None), whole), resting)
        whole_beta = beta if payload is None else beta + payload
        (load,) = library.evaluate("inverse_dynamics", signals.q, signals.dq, signals.ddq, whole_beta)
        found.append(replace(recording, load=fill_load(recording.load, load, measured)))
    return found


def fill_load(load: FloatArray | None, computed: FloatArray, measured: Sequence[bool]) -> FloatArray:
    """Return loads (N, n): those of joints (n,) that are `measured`, else computed ones."""
    return computed if load is None else np.where(np.array(measured), load, computed)


def list_measured_joints(recordings: Sequence[Recording]) -> tuple[bool, ...]:
    """Return (n,) for which joints all recordings have a measured load; a constant channel is none."""
    if not recordings:
        return ()
    loads = [recording.load for recording in recordings if recording.load is not None]
    if len(loads) < len(recordings):
        return (False,) * int(recordings[0].position.shape[1])
    moved: list[bool] = np.any([np.ptp(load, axis=0) > 0.0 for load in loads], axis=0).tolist()
    return tuple(moved)


def subtract_loads(recording: Recording, measured: Sequence[bool]) -> Recording:
    """Return a recording with torques less loads at the joints (n,) that are `measured`.

    What is left there is friction and the inertia of rotors: links and payloads are in the load.
    """
    if recording.load is None or not any(measured):
        return recording
    torque = np.where(np.array(measured), recording.torque - recording.load, recording.torque)
    return replace(recording, torque=torque)


class Rotor(NamedTuple):
    """A rotor that turns with several joints: name of its inertia, turns (n,) a turn of each joint."""

    name: str
    turns: tuple[float, ...]


def list_coupled_rotors(robot: Robot) -> tuple[Rotor, ...]:
    """Return the rotors of drives that turn with several joints."""
    count, rows = len(robot.axes), robot.transmission[len(robot.joints) :]
    found = []
    for drive, terms in zip(robot.couplings, rows, strict=True):
        turns = [0.0] * count
        for place, factor in terms:
            turns[place] += float(factor)
        found.append(Rotor(f"IA{drive.name}", tuple(turns)))
    return tuple(found)


def compute_rotor_columns(ddq: FloatArray, rotors: Sequence[Rotor]) -> FloatArray:
    """Return torques (N, n, n + m) at ddq (N, n), per inertia of own and then of coupled rotors."""
    count = ddq.shape[1]
    turns = np.vstack([np.eye(count), *(np.array(rotor.turns) for rotor in rotors)])
    return np.asarray((ddq @ turns.T)[:, None, :] * turns.T[None])


class LoadGain(NamedTuple):
    """The factor on a measured load that explains a motor's torque best, its deviation, whether it is one."""

    value: float
    deviation: float
    verdict: Agreement


def measure_load_gain(grams: FloatArray) -> LoadGain | None:
    """Return the gain of a load sensor; None where friction and rotor could take the part of the load.

    `grams` (S, k, k) are sums of products of [columns of friction and rotor, load, torque less load] in S
    stretches; the deviation is that over stretches left out (jackknife), which needs no white noise.
    """
    whole = grams.sum(axis=0)
    lengths = np.sqrt(np.maximum(np.diag(whole), numerics.TINY))
    scaled = grams / lengths / lengths[:, None]

    def solve(total: FloatArray) -> float:
        columns, load = total[:-2, :-2], total[:-2, -2]
        beside = np.linalg.lstsq(columns, np.column_stack([load, total[:-2, -1]]), rcond=numerics.RANK)[0]
        left = total[-2, -2] - load @ beside[:, 0]
        if left <= numerics.RANK * total[-2, -2]:
            return np.nan
        return float((total[-2, -1] - load @ beside[:, 1]) / left * lengths[-1] / lengths[-2])

    total = scaled.sum(axis=0)
    value = solve(total)
    parts = np.array([solve(total - part) for part in scaled if part[-2, -2] > 0.0])
    if len(parts) < 2 or not np.all(np.isfinite([value, *parts])):
        return None
    changes = compute_changes(parts)
    return LoadGain(1.0 + value, float(np.linalg.norm(changes)), agree_in_value(value, changes, 1.0).verdict)


def warn_of_load_gain(gain: LoadGain | None) -> tuple[Notice, ...]:
    """Return a warning where a measured load fits the torque of the motor with another factor."""
    if gain is None or gain.verdict is not Agreement.DIFFERENT:
        return ()
    text = f"{gain.value:.4g} +- {gain.deviation:.2g} times the measured load explains the torque of the "
    text += "motor best, where 1 is expected; friction absorbs the difference. Check the factors of "
    text += "[log.load] and [log.torque], torque constants and gear ratios, and whether friction depends on "
    text += "the load"
    return (Notice(code="friction.load-gain", text=text),)


def compute_payload_torque(library: Library, signals: Signals, recording: Recording) -> FloatArray | None:
    """Return the torque (N, n) of a known payload in N m or N; else as `get_payload`."""
    load = get_payload(library, recording)
    # A payload has no friction.
    return None if load is None else equations.evaluate_torques(library, signals, load)


def get_payload(library: Library, recording: Recording) -> FloatArray | None:
    """Return what a known payload adds to beta (p,); None without, LogError if it is of another model."""
    if recording.run is None or not recording.run.load:
        return None
    load = np.array(recording.run.load)
    if len(load) != len(library.card.beta):
        text = f"the payload is given for {len(load)} base parameters, the model has "
        text += f"{len(library.card.beta)}: read the run with the robot that is identified"
        raise LogError(Notice(code="log.payload-model", text=text, file=recording.source))
    return load


def prepare_rows(
    kind: str,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    every: bool = False,
    **windows: float,
) -> equations.Rows:
    """Return the equations of one recording: filter, differentiate, settle resting joints, build.

    What the processing leaves open is chosen from this recording; with `every` the rows of slow joints and of
    joints at rest stay. Other arguments are those of `build_rows`.
    """
    processing = choose_filters(processing, [recording]).processing if processing.automatic else processing
    signals = prepare_states(library, recording, processing)
    rows = equations.build_rows(kind, library, signals, processing, **windows)
    return rows if every else leave_out_rows(rows, library, recording, processing)


def prepare_states(library: Library, recording: Recording, processing: Processing) -> Signals:
    """Return filtered states of one recording, joints at rest exactly so, and torques without known payloads.

    `processing` leaves nothing open. A LogError tells that the recording has another number of joints than
    the robot, an IdentifiabilityError that no joint moves.
    """
    resting = _check_motion(library, recording)
    return _settle_states(library, recording, resting, logs.prepare_signals(recording, processing))


def _check_motion(library: Library, recording: Recording) -> tuple[int, ...]:
    """Return the joints at rest, or raise the errors of `prepare_states`."""
    check_joints(library, (recording,))
    resting = list_resting_joints(recording)
    if len(resting) == library.card.size:
        text = "no joint moves in this log beyond the noise of its encoder: record a log in which every "
        text += "joint accelerates and turns both ways"
        notice = Notice(code="identify.standstill", text=text, file=recording.source)
        raise IdentifiabilityError(notice)
    return resting


def _settle_states(
    library: Library,
    recording: Recording,
    resting: tuple[int, ...],
    signals: Signals,
    places: Sequence[float] | None = None,
) -> Signals:
    """Return the signals with joints at rest, at `places` in rad or m, and torques without known payloads."""
    signals = hold_resting_joints(signals, resting, places)
    load = compute_payload_torque(library, signals, recording)
    return signals if load is None else replace(signals, tau=signals.tau - load)


STATES = 60
"""Of the logs' motion, in which models are compared."""


def outline_motion(
    library: Library, recordings: Sequence[Recording], processing: Processing
) -> tuple[tuple[float, ...], ...]:
    """Return states q, dq, ddq (`STATES`, 3 n) evenly spread over the recordings, with six digits."""
    used = choose_filters(processing, recordings).processing
    signals = [follow_states(library, entry, used) for entry in recordings]
    ends, rows = np.cumsum([0, *(len(entry.time) for entry in signals)]), list[tuple[float, ...]]()
    for place in np.linspace(0, ends[-1] - 1, min(STATES, int(ends[-1]))).round().astype(int):
        run = int(np.searchsorted(ends, place, side="right")) - 1
        here = int(place - ends[run])
        q, dq, ddq, *_ = signals[run].cut(slice(here, here + 1)).pick_states(slice(None))
        rows.append(tuple(float(f"{value:.6g}") for value in np.hstack([q, dq, ddq])[0]))
    return tuple(rows)


def mask_fast(
    rows: equations.Rows, speed: FloatArray, processing: Processing, file: str = "", *, margin: float = 0.0
) -> tuple[NDArray[np.bool_], tuple[Notice, ...]]:
    """Return the rows (m,) whose joint is not slow, and a notice for each joint that loses some.

    `speed` (m,) in rad/s or m/s is what is compared with the standstill speeds; rows within `margin` s of a
    slow one count as slow, unless they are most of the joint's.
    """
    if rows.kind in equations.SCALAR_KINDS or not processing.standstill:
        return np.ones(len(speed), dtype=np.bool_), ()
    limits = np.array(list(map(processing.get_standstill, range(len(rows.group_names)))))
    slow = np.abs(speed) < limits[rows.group]
    beside = ""
    if margin:
        beside, fast = ", or beside such samples,", ~slow
        # The margin of a joint is halved until half of its fast rows stay.
        for group in np.unique(rows.group):
            own = rows.group == group
            parts = [np.flatnonzero(own & (rows.run == run)) for run in np.unique(rows.run[own])]
            least, reach = 0.5 * np.sum(fast[own]), margin
            while True:
                for part in parts:
                    steps = np.diff(rows.time[part])
                    places = round(reach / float(np.median(steps))) if len(steps) else 0
                    slow[part] = logs.spread_bad(~fast[part, None], places)[:, 0]
                if np.sum(~slow[own]) >= least:
                    break
                reach *= 0.5
    lost, whole = np.bincount(rows.group[slow]), np.bincount(rows.group)
    return ~slow, _describe_slow(rows.group_names, lost, whole, limits, beside, file)


def _describe_slow(  # noqa: PLR0917 - parts of a sentence
    names: Sequence[str],
    lost: NDArray[np.intp],
    whole: NDArray[np.intp],
    limits: FloatArray,
    beside: str = "",
    file: str = "",
) -> tuple[Notice, ...]:
    texts = (
        f"joint {names[group]!r}: {lost[group]} of {whole[group]} samples slower than "
        f"processing.standstill = {limits[group]:g}{beside} were left out of the fit"
        for group in np.flatnonzero(lost).tolist()
    )
    return tuple(Notice(code="identify.slow-rows", text=text, file=file) for text in texts)


def _describe_rest(name: str) -> Notice:
    text = f"joint {name!r} does not move in this log: dry friction or a brake may hold any torque, so its "
    text += "samples were left out"
    return Notice(code=JOINT_AT_REST, text=text)


def leave_out_rows(
    rows: equations.Rows, library: Library, recording: Recording, processing: Processing
) -> equations.Rows:
    """Leave out rows of slow joints, and of joints at rest that dry friction or a brake may hold."""
    file = recording.source
    told = (replace(one, file=file) if one.code == equations.BAD_ROWS else one for one in rows.notices)
    rows = replace(rows, notices=tuple(told)) if rows.notices else rows
    if rows.kind in equations.SCALAR_KINDS:
        return rows
    fast, slow = mask_fast(rows, rows.velocity, processing, file)
    joints = library.card.joints
    held = [joint for joint in list_resting_joints(recording) if joints[joint].friction != "none"]
    if fast.all() and not held:
        return rows
    notices = (replace(_describe_rest(joints[joint].name), file=file) for joint in held)
    kept = equations.select_rows(rows, fast & ~np.isin(rows.group, held))
    return replace(kept, notices=(*rows.notices, *slow, *notices))


def check_joints(library: Library, recordings: Sequence[Recording]) -> None:
    """Raise LogError for recordings of another number of joints than the robot has."""
    card = library.card
    notices = []
    for recording in recordings:
        if (joints := recording.position.shape[1]) != card.size:
            text = f"the log has {joints} joints, robot {card.robot!r} has {card.size}"
            notices.append(Notice(code="log.joints", text=text, file=recording.source))
    if notices:
        raise LogError(*notices)


LONG_KINDS = ("torque", "momentum")
BLOCKS = POLICY.folds * POLICY.parts
"""Blocks of consecutive equations of a joint: within one, residuals may depend on each other."""


def follow_states(library: Library, recording: Recording, processing: Processing) -> SignalParts:
    """Return the states and torques of `prepare_states` part by part; errors are the same."""
    resting = _check_motion(library, recording)
    return SignalParts(recording, processing, resting, partial(_settle_states, library, recording, resting))


class RowBuilder(NamedTuple):
    """How recordings become equations; `window` in s and `overlap` are of momentum rows."""

    kind: str
    library: Library
    processing: Processing
    window: float
    overlap: float

    def prepare(self, recording: Recording) -> equations.Rows:
        """Return the equations of a recording, see `prepare_rows`."""
        return prepare_rows(
            self.kind, self.library, recording, self.processing, window=self.window, overlap=self.overlap
        )

    def follow(self, recording: Recording) -> SignalParts:
        """Return the states of a recording."""
        return follow_states(self.library, recording, self.processing)

    def outline(
        self, recording: Recording, states: SignalParts
    ) -> tuple[equations.EquationPart, NDArray[np.bool_], tuple[Notice, ...]]:
        """Return the equations of a recording without a matrix, and which (M, n) are good and not at rest."""
        card, pieces = self.library.card, equations.count_pieces(self.overlap)
        part = equations.outline_part(self.kind, states, self.processing, self.window, pieces)
        bad = np.zeros(part.values.shape, dtype=np.bool_) if part.bad is None else part.bad
        pairs = zip(card.joints, bad.T, strict=True)
        told = [equations.warn_of_bad(joint.name, own) for joint, own in pairs if own.any()]
        held = [joint for joint in states.resting if card.joints[joint].friction != "none"]
        told += [_describe_rest(card.joints[joint].name) for joint in held]
        every = ~bad
        every[:, held] = False
        return part, every, tuple(replace(one, file=recording.source) for one in told)

    def list_speeds(self, recordings: Sequence[Recording]) -> FloatArray:
        """Return the velocities (m,) of all equations of recordings, slow ones too, group by group."""
        parts = [self.outline(entry, self.follow(entry)) for entry in recordings]
        joints = range(self.library.card.size)
        return np.concatenate([part.velocity[every[:, k], k] for k in joints for part, every, _ in parts])

    def cut(self, states: SignalParts) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the matrix (k, n, p) of a recording's equations by stretches of time, and their places."""
        pieces = equations.count_pieces(self.overlap)
        return equations.cut_matrix(
            self.kind, self.library, states, self.processing, window=self.window, pieces=pieces
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LongRows:
    """Equations of which only triangles are kept: `rows` are none, but say what they are.

    `triangles` (s, p + 1, p + 1) are of [A y] of segments, not weighed; `group`, `block` and `weight` (s,) of
    each its joint, its place among `BLOCKS` of the joint, and the weight of its recording; `counts` (g,)
    equations. `slow` are the equations that were left out because they are slow, not weighed.
    """

    rows: equations.Rows
    triangles: FloatArray
    group: NDArray[np.intp]
    block: NDArray[np.intp]
    weight: FloatArray
    counts: NDArray[np.intp]
    slow: Condensed

    def condense(self, *, weighed: bool = True) -> Condensed:
        """Return the condensed equations of all runs."""
        groups, independent = range(len(self.counts)), self.rows.independent
        factors = np.array([self._join(self.group == group, weighed=weighed) for group in groups])
        return Condensed(factors=factors, counts=self.counts, independent=independent)

    def sketch(self) -> equations.Rows:
        """Return p + 1 equations for each of `BLOCKS` of time of every joint, with the block's squares.

        A'A and A'y of every block are those of its equations, so `compute_block_deviations` gives the same.
        """
        pairs = [(group, block) for group in np.unique(self.group) for block in range(BLOCKS)]
        parts = [self._join((self.group == group) & (self.block == block)) for group, block in pairs]
        table, size = np.vstack(parts), self.triangles.shape[1]
        count = len(table)
        return replace(
            self.rows,
            matrix=table[:, :-1],
            values=table[:, -1],
            group=np.repeat([group for group, _ in pairs], size),
            time=np.zeros(count),
            velocity=np.zeros(count),
            run=np.zeros(count, dtype=np.intp),
            weight=np.ones(count),
        )

    def _join(self, inside: NDArray[np.bool_], *, weighed: bool = True) -> FloatArray:
        size = self.triangles.shape[1]
        roots = np.sqrt(self.weight[inside]) if weighed else np.ones(int(inside.sum()))
        stacked = (self.triangles[inside] * roots[:, None, None]).reshape(-1, size)
        return _add_rows(np.zeros((size, size)), stacked)


def condense_recordings(
    maker: RowBuilder, recordings: Sequence[Recording], weights: Sequence[float] | None
) -> LongRows | None:
    """Return the condensed equations of recordings; None where a joint has too few of them for blocks."""
    states = list(map(maker.follow, recordings))
    parts, every, notices = zip(*map(maker.outline, recordings, states), strict=True)
    card, size = maker.library.card, len(maker.library.card.fitted) + 1
    joints = range(card.size)
    limits = np.array(list(map(maker.processing.get_standstill, joints)))
    kept = [own & (np.abs(part.velocity) >= limits) for own, part in zip(every, parts, strict=True)]
    # Rows of each joint in each run; where its segments begin, which are of one block and one run.
    sizes = np.array([own.sum(axis=0) for own in kept])
    counts, whole = sizes.sum(axis=0), np.sum([own.sum(axis=0) for own in every], axis=0)
    if np.any((counts > 0) & (counts < BLOCKS)):
        return None
    blocks = [np.cumsum([0, *(len(part) for part in np.array_split(np.empty(n), BLOCKS))]) for n in counts]
    runs = np.vstack([np.zeros_like(counts), np.cumsum(sizes, axis=0)]).T
    begins = [np.unique(np.concatenate(pair)) for pair in zip(blocks, runs, strict=True)]
    triangles = [np.zeros((len(begin) - 1, size, size)) for begin in begins]
    slow, passed = np.zeros((card.size, size, size)), np.zeros_like(counts)
    for state, part, some, used in zip(states, parts, every, kept, strict=True):
        for stretch, matrix in maker.cut(state):
            for joint in joints:
                table = np.column_stack([matrix[:, joint], part.values[stretch, joint]])
                fast = used[stretch, joint]
                slow[joint] = _add_rows(slow[joint], table[some[stretch, joint] & ~fast])
                table, first = table[fast], passed[joint]
                passed[joint] += len(table)
                owner = _find_owners(begins[joint], np.arange(first, passed[joint]))
                for place in np.unique(owner):
                    triangles[joint][place] = _add_rows(triangles[joint][place], table[owner == place])
    starts = [begin[:-1] for begin in begins]
    run = np.concatenate(list(map(_find_owners, runs, starts)))
    told = dict.fromkeys(notice for own in notices for notice in own)
    lost = _describe_slow([joint.name for joint in card.joints], whole - counts, whole, limits)
    shares = sizes.sum(axis=1) / max(int(counts.sum()), 1)
    independent = float(shares @ [part.independent for part in parts])
    none = np.empty((0, card.size))
    empty = equations.EquationPart(np.empty((0, card.size, size - 1)), none, np.empty(0), none, independent)
    return LongRows(
        rows=replace(equations.assemble_rows(maker.kind, card, empty), notices=(*told, *lost)),
        triangles=np.concatenate(triangles),
        group=np.repeat(joints, list(map(len, starts))),
        block=np.concatenate(list(map(_find_owners, blocks, starts))),
        weight=np.asarray(weights or np.ones(len(states)), dtype=np.float64)[run],
        counts=counts,
        slow=Condensed(factors=slow, counts=whole - counts, independent=independent),
    )


def _find_owners(begins: NDArray[np.intp], places: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return which part each place (k,) is in, of parts that begin somewhere."""
    return np.searchsorted(begins, places, side="right") - 1


def _add_rows(triangle: FloatArray, table: FloatArray) -> FloatArray:
    blocks = (table[at : at + numerics.BLOCK] for at in range(0, len(table), numerics.BLOCK))
    return extend_triangle(triangle, blocks) if len(table) else triangle
