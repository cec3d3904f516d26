"""Logs looked at, first as they are and then with the robot's dynamics.

Input: a robot, its logs. Output: `LogsCheck`.

time stamps -> even times -> quantities -> signs, order, delay -> what the motion excites

Supported: logs with uneven time stamps; rigid joints. Of elastic joints the quantities alone are looked at.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from symid.codegen.library import Library
from symid.data.checks import check_recording
from symid.data.logs import gather_recordings
from symid.data.readers import read_raw
from symid.data.recording import Recording
from symid.data.resampling import make_even, resample_log
from symid.data.summary import JointSummary, summarise_joints
from symid.data.timing import Timing, describe_timing, find_timing
from symid.data.writers import write_log
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.logcheck.log_check import LogCheck, check_logs
from symid.logcheck.log_excitation import Excitation
from symid.robot.description import Robot

__all__ = ["CheckedLog", "LogsCheck", "check_robot_logs"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedLog:
    """A log as it is.

    Attributes:
        recording: at even times. timing: how it was sampled before. joints: what every joint does in it.
    """

    recording: Recording
    timing: Timing
    joints: tuple[JointSummary, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogsCheck:
    """What was found in logs.

    Attributes:
        logs: each as it is.
        copy: the file of an evenly sampled copy and what was done for it, where one was asked for.
        dynamics: what the robot's dynamics says of each log that moves; empty for elastic joints.
        excitation: what all logs together say of every parameter; None for elastic joints and logs at rest.
        notices: what is odd, with what to do. errors: why the logs are not enough for a model.
    """

    logs: tuple[CheckedLog, ...] = ()
    copy: tuple[Path, Notice] | None = None
    dynamics: tuple[LogCheck, ...] = ()
    excitation: Excitation | None = None
    notices: tuple[Notice, ...] = ()
    errors: tuple[Notice, ...] = ()


def check_robot_logs(
    robot: Robot,
    logs: Sequence[Path | Recording],
    *,
    prepare: Callable[[], Library],
    progress: Callable[[str], None],
    output: Path | None = None,
) -> LogsCheck:
    """Return what is odd in logs, and which parameters are identifiable from all of them together.

    Args:
        robot: the robot.
        logs: files, files of runs, or what was read before.
        prepare: returns the robot's functions, where they are needed.
        progress: told what begins.
        output: of an evenly sampled copy of the first log, a file.

    Raises:
        LogError: with what is wrong with any of the logs.
        OutputError: the copy cannot be written.
    """
    progress(f"reading {len(logs)} log{'s'[: len(logs) > 1]}")
    found: list[CheckedLog] = []
    notices: list[Notice] = []
    for recording in gather_recordings(logs, robot, uneven=True):
        even = make_even(recording)
        notices += (*recording.notices, *describe_timing(recording.time, recording.source))
        notices += (*even.notices[len(recording.notices) :], *check_recording(even, robot))
        timing, joints = find_timing(recording.time), summarise_joints(even, robot)
        found.append(CheckedLog(recording=even, timing=timing, joints=joints))
    copy = None if output is None else _write_even(logs[0], robot, output)
    if copy is not None:
        notices.append(copy[1])
    checked = LogsCheck(logs=tuple(found), copy=copy, notices=tuple(notices))
    return _add_dynamics(checked, robot, prepare, progress)


def _write_even(log: Path | Recording, robot: Robot, output: Path) -> tuple[Path, Notice]:
    """Write an evenly sampled copy of a log with its own columns, and say what was done."""
    source = log if isinstance(log, Path) else Path(log.source)
    if isinstance(log, Recording) and not os.path.isfile(source):  # noqa: PTH113  any text may stand there
        text = "an evenly sampled copy is made of a log's file, and this log has none; save it first"
        raise UsageError(Notice(code="usage.no-file", text=text, file=log.source))
    copy, notice = resample_log(read_raw(source), robot, str(source))
    return write_log(copy, output), notice


def _add_dynamics(
    checked: LogsCheck, robot: Robot, prepare: Callable[[], Library], progress: Callable[[str], None]
) -> LogsCheck:
    """Return the same with what the robot's dynamics says of the logs."""
    if any(robot.elastic):
        skipped = "joints give: signs, order and excitation are looked at for rigid joints only"
        note = Notice(code="check.elastic", text=f"{skipped}; `symid identify` says what it cannot tell")
        return replace(checked, notices=(*checked.notices, note))
    library = prepare()
    progress("looking at the motion")
    try:
        checks, excitation, notices = check_logs(library, [entry.recording for entry in checked.logs], robot)
    except IdentifiabilityError as error:
        return replace(checked, errors=error.notices)
    said = (notice for check in checks for notice in check.notices)
    return replace(
        checked,
        dynamics=checks,
        excitation=excitation,
        notices=(*checked.notices, *said, *notices, *library.notices),
        errors=(_say_poor(excitation),) if excitation.poor else (),
    )


def _say_poor(excitation: Excitation) -> Notice:
    """Return why the logs are not enough for a model of the robot."""
    if excitation.empty:
        reason = "; ".join(f"{entry.name}: {entry.reason}" for entry in excitation.parameters[:8])
        what = "record one in which every joint accelerates"
        text = f"nothing can be learnt from these logs ({reason}): {what}"
        return Notice(code="check.nothing", text=text)
    count, whole = len(excitation.list_names("refused")), len(excitation.parameters)
    text = (
        f"these logs tell only {whole - count} of {whole} parameters, too few for a model of this robot; the "
        "table says why: record one in which every joint accelerates on its own, or check it together with "
        "further logs; `symid identify --partial` fits what can be told"
    )
    return Notice(code="check.poor", text=text)
