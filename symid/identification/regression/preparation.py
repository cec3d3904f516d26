"""From a recording to regression equations: filters, states, payload torque, rows left out.

Recording, Processing -> FilterChoice -> Signals -> Rows.

What the processing leaves open is chosen from the logs:

    band     b = min(what the rule of the sample rate keeps, clean bands of joints that move), 5 Hz at least
    rows     one sample in r = 0.8 (rate / 2) / b, so that decimation passes what lies below b
    cut-off  min(5 b, 0.4 rate): high enough that it damps nothing that the rows keep
    windows  of momentum rows as long as rows are apart, so that they keep the same band

The clean band of a joint ends where the noise of its encoder, differentiated twice, has a hundredth of the
power of its acceleration: such noise enters the columns, not the torque, and moves parameters towards zero.
Noise and motion are told apart in the power spectral density of the position (Welch's method, Hann windows
of at least 2 s, half overlapped, trends removed): the noise floor is the median of the density over the
upper half of all frequencies, and

    noise   floor (2 pi)^4 b^5 / 5,     motion   integral to b of (density - floor) (2 pi f)^4 df

The torque of a known payload, Y(q, dq, ddq) dbeta, is subtracted from the measured one, so that the
equations are those of the robot alone.

Supported: several recordings (the best of them counts for each joint); what is stated stays; encoders with
white noise, quantisation included; joints at rest, whose rows are left out where dry friction or a brake
may hold them.
Not supported: a filter of its own for each joint (columns of all joints share one equation); positions that
were filtered before they were logged, whose noise is underestimated; payloads of simulated robots.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.identification.regression.equations import (
    SCALAR_KINDS,
    WINDOW,
    Rows,
    build_rows,
    drop_groups,
    evaluate_torques,
    select_rows,
)
from symid.identification.regression.identifiability import (
    JOINT_AT_REST,
    hold_resting_joints,
    list_resting_joints,
)
from symid.logs import Recording, Signals, choose_processing, prepare_signals
from symid.robot import Processing

NOISE_SHARE = 0.01
"""Part of the acceleration's power that noise may be."""
_SPAN = 2.0
_LEAST_SAMPLES = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class JointBand:
    """What a position holds.

    Args:
        floor: one-sided density of the noise, rad or m over the root of Hz.
        clean: Hz, up to which noise is less than `NOISE_SHARE` of the acceleration's power.
        noise: rad or m, standard deviation of such a noise over all frequencies.
    """

    floor: float
    clean: float
    noise: float


def measure_bands(recording: Recording) -> tuple[JointBand, ...]:
    """Return noise and clean band of every joint of a recording."""
    from scipy.signal import welch

    rate = 1.0 / recording.period
    length = min(len(recording.time), max(_LEAST_SAMPLES, round(_SPAN * rate)))
    frequency, density = welch(recording.position, fs=rate, nperseg=length, detrend="linear", axis=0)
    return tuple(_measure_band(frequency[1:], column[1:], rate) for column in density.T)


def _measure_band(frequency: FloatArray, density: FloatArray, rate: float) -> JointBand:
    floor = float(np.median(density[frequency > 0.25 * rate]))
    steep = (2.0 * np.pi * frequency) ** 4
    motion = np.cumsum(np.maximum(density - floor, 0.0) * steep)
    clean = np.flatnonzero(np.cumsum(floor * steep) <= NOISE_SHARE * motion)
    return JointBand(
        floor=float(np.sqrt(floor)),
        clean=float(frequency[clean[-1]]) if len(clean) else 0.0,
        noise=float(np.sqrt(floor * rate / 2.0)),
    )


_LEAST_BAND = 5.0
"""Hz that are always kept: robots move there."""
_RATIO = 5.0
_HIGHEST = 0.4
SAME_PERIOD = 0.01
"""Sample periods that differ by less, relative to one another, are the same: clocks drift."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterChoice:
    """What was chosen, and why; `clean` bands (n,) in Hz of the joints, 0 of those that do not move."""

    processing: Processing
    clean: tuple[float, ...] = ()
    notices: tuple[Notice, ...] = ()


def choose_filters(processing: Processing, recordings: Sequence[Recording]) -> FilterChoice:
    """Return the processing with cut-off and decimation chosen, where they are left open.

    Args:
        processing: as stated; returned as it is unless `automatic`.
        recordings: at least one; sampled alike.

    Raises:
        LogError: there is something to choose, and they are not sampled alike.
    """
    usual = choose_processing(processing, recordings[0].period)
    if usual == processing:
        return FilterChoice(processing=processing)
    _check_periods(recordings)
    rate = 1.0 / recordings[0].period
    clean = _measure_clean_bands(recordings)
    moving = [band for band in clean if band > 0.0]
    decimation = usual.decimation
    kept = 0.5 * decimation.band * rate / decimation.factor
    band = max(_LEAST_BAND, min([kept, *moving]))
    if processing.decimation.factor == 1:
        factor = max(decimation.factor, math.floor(0.5 * decimation.band * rate / band))
        decimation = replace(decimation, factor=factor)
        kept = 0.5 * decimation.band * rate / factor
    cutoff = processing.filter_cutoff or float(f"{min(_RATIO * kept, _HIGHEST * rate):.3g}")
    chosen = replace(usual, filter_cutoff=cutoff, decimation=decimation)
    return FilterChoice(
        processing=chosen, clean=clean, notices=(_explain_choice(chosen, clean, kept, usual),)
    )


def _check_periods(recordings: Sequence[Recording]) -> None:
    periods = [entry.period for entry in recordings]
    if max(periods) <= (1.0 + SAME_PERIOD) * min(periods):
        return
    listed = ", ".join(f"{entry.source or 'a log'} every {1e3 * entry.period:.4g} ms" for entry in recordings)
    text = (
        f"the logs are not sampled alike ({listed}), and no cut-off and decimation can be chosen that suit "
        "all: state filter_cutoff and decimation under [processing], or bring the logs to one rate"
    )
    raise LogError(Notice(code="identify.mixed-periods", text=text))


def choose_window(kind: str, processing: Processing, period: float) -> float:
    """Return the length in s of the windows of rows, where none is asked for.

    Args:
        kind: of rows.
        processing: with its decimation chosen.
        period: of the samples in s.
    """
    factor = processing.decimation.factor
    # Longer windows would damp what torque rows keep: heavy and light joints of a fast motion differ there.
    return factor * period if kind == "momentum" and factor > 1 else WINDOW


def _measure_clean_bands(recordings: Sequence[Recording]) -> tuple[float, ...]:
    size = recordings[0].position.shape[1]
    clean = [0.0] * size
    for recording in recordings:
        resting = list_resting_joints(recording)
        for joint, band in enumerate(measure_bands(recording)):
            if joint not in resting and joint < size:
                clean[joint] = max(clean[joint], band.clean)
    return tuple(clean)


def _explain_choice(chosen: Processing, clean: Sequence[float], kept: float, usual: Processing) -> Notice:
    told = ", ".join(f"{band:.3g}" if band else "-" for band in clean)
    noise = chosen.decimation.factor > usual.decimation.factor
    text = (
        "the robot file leaves the processing open: positions pass a "
        f"low-pass at {chosen.filter_cutoff:g} Hz, and one row in {chosen.decimation.factor} is kept, which "
        f"holds what lies below {kept:.3g} Hz; {'the noise' if noise else 'the rate'} decides: noise of the "
        f"positions is below {100.0 * NOISE_SHARE:g} % of the accelerations up to {told} Hz, joint by joint; "
        "state filter_cutoff and decimation under [processing] to choose yourself"
    )
    return Notice(code="identify.automatic", text=text)


def subtract_payload_torque(library: Library, signals: Signals, recording: Recording) -> Signals:
    """Return the signals without the torque (N, n) of a known payload; as they are where there is none.

    Raises:
        LogError: the payload was stated for another model.
    """
    load = compute_payload_torque(library, signals, recording)
    return signals if load is None else replace(signals, tau=signals.tau - load)


def compute_payload_torque(library: Library, signals: Signals, recording: Recording) -> FloatArray | None:
    """Return the torque (N, n) of a known payload in N m or N; see `subtract_payload_torque`."""
    if recording.run is None or not recording.run.load:
        return None
    load = np.array(recording.run.load)
    if len(load) != len(library.card.beta):
        text = (
            f"the payload changes {len(load)} base parameters, the model has {len(library.card.beta)}: read "
            "the run with the robot that is identified"
        )
        raise LogError(Notice(code="log.payload-model", text=text, file=recording.source))
    # A payload has no friction.
    return evaluate_torques(library, signals, np.append(load, np.zeros(len(library.card.friction))))


def prepare_rows(
    kind: str,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    window: float,
    overlap: float = 0.0,
) -> Rows:
    """Return the equations of one recording: filter, differentiate, settle resting joints, build.

    Args:
        kind: of rows.
        library: the functions of the robot.
        recording: the log.
        processing: what it leaves open is chosen from this recording.
        window: length of windows in s.
        overlap: part of a window that the next one shares.

    Raises:
        LogError: the recording has another number of joints than the robot.
        IdentifiabilityError: no joint moves.
        UsageError: there is no such kind of rows, or the windows do not fit.
    """
    processing = choose_filters(processing, [recording]).processing if processing.automatic else processing
    signals = prepare_states(library, recording, processing)
    rows = build_rows(kind, library, signals, processing, window=window, overlap=overlap)
    return rows if kind in SCALAR_KINDS else leave_out_rows(rows, library, recording, processing)


def prepare_states(library: Library, recording: Recording, processing: Processing) -> Signals:
    """Return filtered states of one recording, joints at rest exactly so, and torques without known payloads.

    Args:
        library: the functions of the robot.
        recording: the log.
        processing: it leaves nothing open.

    Raises:
        LogError: the recording has another number of joints than the robot.
        IdentifiabilityError: no joint moves.
    """
    check_joints(library, (recording,))
    resting = list_resting_joints(recording)
    if len(resting) == library.card.size:
        raise IdentifiabilityError(_say_standstill(recording))
    signals = hold_resting_joints(prepare_signals(recording, processing), resting)
    return subtract_payload_torque(library, signals, recording)


def leave_out_rows(rows: Rows, library: Library, recording: Recording, processing: Processing) -> Rows:
    """Leave out rows of slow joints, and of joints at rest that dry friction or a brake may hold."""
    rows = _leave_out_slow(rows, recording, processing.standstill)
    resting = list_resting_joints(recording)
    joints = library.card.joints
    held = tuple(joint for joint in resting if joints[joint].friction != "none")
    notices = tuple(_say_resting(joints[joint].name, recording) for joint in held)
    return replace(drop_groups(rows, held), notices=rows.notices + notices) if held else rows


def _leave_out_slow(rows: Rows, recording: Recording, standstill: float) -> Rows:
    """Leave out the rows of joints slower than `standstill` (rad/s or m/s), and say how many."""
    slow = np.abs(rows.velocity) < standstill
    if not slow.any():
        return rows
    notices = tuple(
        _say_slow(
            name,
            recording,
            standstill,
            int(slow[rows.group == index].sum()),
            int((rows.group == index).sum()),
        )
        for index, name in enumerate(rows.group_names)
        if slow[rows.group == index].any()
    )
    return replace(select_rows(rows, ~slow), notices=rows.notices + notices)


def _say_slow(joint: str, recording: Recording, standstill: float, left_out: int, whole: int) -> Notice:
    text = (
        f"joint {joint!r}: {left_out} of {whole} rows slower than {standstill:g} were left out, "
        "as processing.standstill asks"
    )
    return Notice(code="identify.slow-rows", text=text, file=recording.source)


def check_joints(library: Library, recordings: Sequence[Recording]) -> None:
    """Refuse recordings of another number of joints than the robot has.

    Raises:
        LogError: with all of them.
    """
    expected, wrong = library.card.size, []
    for recording in recordings:
        found = recording.position.shape[1]
        if found != expected:
            text = f"the log has {found} joints, the robot {library.card.robot!r} has {expected}"
            wrong.append(Notice(code="log.joints", text=text, file=recording.source))
    if wrong:
        raise LogError(*wrong)


def _say_standstill(recording: Recording) -> Notice:
    text = (
        "no joint moves in this log beyond the noise of its encoder: nothing can be learnt from a "
        "log at standstill; record one in which every joint accelerates and turns both ways"
    )
    return Notice(code="identify.standstill", text=text, file=recording.source)


def _say_resting(joint: str, recording: Recording) -> Notice:
    text = (
        f"joint {joint!r} does not move in this log: dry friction or a brake may hold any torque, "
        "so its rows were left out"
    )
    return Notice(code=JOINT_AT_REST, text=text, file=recording.source)
