"""From a recording to rows: the steps that identification and validation share.

Input: a library, a recording and its processing. Output: `Rows`, with or without their matrix, with notices
of what was left out.

Supported: joints at rest; their rows are left out where dry friction or a brake may hold them.
"""

from dataclasses import replace

import numpy as np

from symid.codegen.library import Library
from symid.data.recording import Recording, Signals
from symid.data.signals import prepare_signals
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.robot.log_map import Processing
from symid.rows.cutoff import choose_filters
from symid.rows.identifiability import JOINT_AT_REST, find_resting_joints, settle_joints
from symid.rows.rows import SCALAR_KINDS, Rows, build_rows, drop_groups, outline_rows, select_rows
from symid.rows.unloading import take_load_off

__all__ = ["prepare_outline", "prepare_rows", "prepare_states"]


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
    return rows if kind in SCALAR_KINDS else _leave_out(rows, library, recording, processing)


def prepare_outline(
    kind: str,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    window: float,
    overlap: float = 0.0,
) -> Rows:
    """Return the equations of one recording without their matrix, see `outline_rows`.

    Arguments and errors as for `prepare_rows`; the processing leaves nothing open.
    """
    signals = prepare_states(library, recording, processing)
    rows = outline_rows(kind, library.card, signals, processing, window=window, overlap=overlap)
    return _leave_out(rows, library, recording, processing)


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
    _check_joints(library, recording)
    resting = find_resting_joints(recording)
    if len(resting) == library.card.size:
        raise IdentifiabilityError(_say_standstill(recording))
    signals = settle_joints(prepare_signals(recording, processing), resting)
    return take_load_off(library, signals, recording)


def _leave_out(rows: Rows, library: Library, recording: Recording, processing: Processing) -> Rows:
    """Leave out rows of slow joints, and of joints at rest that dry friction or a brake may hold."""
    rows = _leave_out_slow(rows, recording, processing.standstill)
    resting = find_resting_joints(recording)
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


def _check_joints(library: Library, recording: Recording) -> None:
    found, expected = recording.position.shape[1], library.card.size
    if found != expected:
        text = f"the log has {found} joints, the robot {library.card.robot!r} has {expected}"
        raise LogError(Notice(code="log.joints", text=text, file=recording.source))


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
