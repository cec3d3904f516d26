"""`symid check ROBOT [LOG...]`: is the robot file right, and what the logs can tell of the robot."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.checked_logs import describe_check, describe_log, show_excitation, show_joints
from symid.cli.inputs import check_output, load_robot, load_robot_library, show_path
from symid.cli.options import (
    cut_options,
    force_option,
    friction_option,
    set_option,
    split_settings,
    verb,
)
from symid.cli.output import Answer, Console, format_table
from symid.errors import IdentifiabilityError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.data.recording import Recording
    from symid.logcheck.log_excitation import Excitation
    from symid.robot.description import Robot

__all__ = ["command"]

_CONVENTIONS = {"urdf": "URDF", "origin": "frames by origin"}


@click.command("check")
@click.argument("robot")
@click.argument("logs", nargs=-1, metavar="[LOG]...", type=click.Path(path_type=Path))
@friction_option
@cut_options
@set_option
@click.option(
    "--resample",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write an evenly sampled copy of the log (.npz or .csv), with its columns, and say what was done.",
)
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    logs: tuple[Path, ...],
    friction: str | None,
    base_link: str | None,
    tip_link: str | None,
    snap: float | None,
    settings: tuple[str, ...],
    resample: Path | None,
    force: bool,
) -> Answer:
    """Check a robot file, and what logs can tell of the robot.

    All that is wrong is said at once, each with its file, line and column: exit code 3. What is odd in a
    log is a warning that says what to do: time stamps, units, signs, exchanged joints, delays, motion that
    excites too little. Exit code 4 where the logs tell less than three quarters of the parameters.
    """
    if resample is not None and len(logs) != 1:
        text = f"--resample {resample}: takes one log at a time, got {len(logs)}"
        raise UsageError(Notice(code="usage.one-log", text=text))
    described = load_robot(robot, split_settings(settings), friction, base=base_link, tip=tip_link, snap=snap)
    check_output(resample, force=force, inputs=(described.path, *logs))
    convention = _CONVENTIONS.get(described.convention, f"{described.convention} DH")
    joints = f"{described.size} joint{'s'[: described.size != 1]}"
    head = f"{described.path}: {described.name}, {joints}, {convention}: no mistakes"
    result: dict[str, object] = {
        "robot": described.name,
        "file": described.path,
        "convention": described.convention,
        "joints": [
            {"name": joint.name, "kind": joint.kind.value, "friction": joint.friction.kind.value}
            for joint in described.joints
        ],
        "logs": [],
    }
    if not logs:
        return Answer(text=head, result=result, warnings=described.notices)
    return _answer_logs(console, described, logs, resample, head=head, result=result)


def _answer_logs(
    console: Console,
    robot: "Robot",
    logs: tuple[Path, ...],
    resample: Path | None,
    *,
    head: str,
    result: dict[str, object],
) -> Answer:
    from symid.data.checks import check_recording
    from symid.data.resampling import make_even
    from symid.data.summary import summarise_joints
    from symid.data.timing import describe_timing, find_timing

    console.progress(f"reading {len(logs)} log{'s'[: len(logs) > 1]}")
    warnings = robot.notices
    even: list[Recording] = []
    entries, tables = [], []
    for recording in _read_logs(logs, robot):
        warnings += (*recording.notices, *describe_timing(recording.time, recording.source))
        even.append(make_even(recording))
        added = even[-1].notices[len(recording.notices) :]
        warnings += (*added, *check_recording(even[-1], robot))
        summary = summarise_joints(even[-1], robot)
        entries.append(describe_log(even[-1], find_timing(recording.time), summary))
        tables.append(show_joints(entries[-1], summary))
    result["logs"] = entries
    keys = ("file", "samples", "duration", "period", "has_velocity", "second_encoder")
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    listed = format_table(header, [[entry[key] for key in keys] for entry in entries], left=(0, 5))
    text = [f"{head}\n{listed}", *tables]
    if resample is not None:
        notice, written = _write_copy(logs[0], robot, resample)
        warnings += (notice,)
        result["resampled"] = {"file": written, "text": notice.text}
        text.append(f"{show_path(resample)}: {notice.text}")
    return _answer_dynamics(console, robot, even, text=text, result=result, warnings=warnings)


def _read_logs(logs: tuple[Path, ...], robot: "Robot") -> "list[Recording]":
    """Return the recordings, their times as they are; what is wrong with any log is said at once."""
    from symid.data.runs import read_log_runs
    from symid.errors import LogError

    recordings: list[Recording] = []
    notices: list[Notice] = []
    for path in logs:
        try:
            recordings += read_log_runs(path, robot, uneven=True)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return recordings


def _write_copy(log: Path, robot: "Robot", output: Path) -> tuple[Notice, Path]:
    from symid.data.readers import read_raw
    from symid.data.resampling import resample_log
    from symid.data.writers import write_log

    copy, notice = resample_log(read_raw(log), robot, str(log))
    return notice, write_log(copy, output)


def _answer_dynamics(
    console: Console,
    robot: "Robot",
    recordings: "list[Recording]",
    *,
    text: list[str],
    result: dict[str, object],
    warnings: tuple[Notice, ...],
) -> Answer:
    """Return the answer with what the robot's dynamics says of the logs."""
    if any(robot.elastic):
        skipped = "joints give: signs, order and excitation are looked at for rigid joints only"
        note = Notice(code="check.elastic", text=f"{skipped}; `symid identify` says what it cannot tell")
        return Answer(text="\n\n".join(text), result=result, warnings=(*warnings, note))
    from symid.logcheck.log_check import check_logs

    library = load_robot_library(robot, console)
    console.progress("looking at the motion")
    names = [joint.name for joint in robot.axes]
    try:
        checks, excitation, notices = check_logs(library, recordings, robot)
    except IdentifiabilityError as error:
        return Answer(
            text="\n\n".join(text), result=result, warnings=warnings, errors=error.notices, exit_code=4
        )
    result["dynamics"] = [{"file": check.source, **describe_check(check, names)} for check in checks]
    result["excitation"] = {
        "parameters": [
            {
                "name": entry.name,
                "verdict": entry.verdict,
                "relative_std_percent": entry.relative_std_percent,
                "reason": entry.reason,
            }
            for entry in excitation.parameters
        ],
        "singular_values": excitation.singular,
        "rank": excitation.rank,
        "condition": excitation.condition,
    }
    text.append(show_excitation(excitation))
    warnings += (*(notice for check in checks for notice in check.notices), *notices, *library.notices)
    whole = "\n\n".join(text)
    if not excitation.poor:
        return Answer(text=whole, result=result, warnings=warnings)
    return Answer(text=whole, result=result, warnings=warnings, errors=(_say_poor(excitation),), exit_code=4)


def _say_poor(excitation: "Excitation") -> Notice:
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
