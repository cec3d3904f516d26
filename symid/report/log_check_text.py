"""What `symid check` says of a robot file and of logs, as tables for people and values for programs.

Input: a robot, logs and what was found in them. Output: entries of the result, parts of the text.
"""

from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.paths import show_path
from symid.report.blocks import Block, Table, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.data.recording import Recording
    from symid.data.summary import JointSummary
    from symid.data.timing import Timing
    from symid.logcheck.log_check import LogCheck
    from symid.logcheck.log_excitation import Excitation
    from symid.robot.description import Robot
    from symid.tasks.check import LogsCheck

__all__ = ["describe_log", "describe_robot_check", "show_joints", "show_robot_check", "summarise_robot"]

_SHOWN = 12
_CONVENTIONS = {"urdf": "URDF", "origin": "frames by origin"}


def summarise_robot(robot: "Robot") -> str:
    """Return name, joints and convention."""
    convention = _CONVENTIONS.get(robot.convention, f"{robot.convention} DH")
    return f"{robot.name}, {robot.size} joint{'s'[: robot.size != 1]}, {convention}"


def show_robot_check(robot: "Robot", checked: "LogsCheck") -> tuple[Block, ...]:
    """Return what was read, the joints of every log, and what the logs tell of the parameters."""
    head = f"{robot.path}: {summarise_robot(robot)}: no mistakes"
    if not checked.logs:
        return (head,)
    keys = ("file", "samples", "duration", "period", "has_velocity", "second_encoder")
    header = ("log", "samples", "duration/s", "period/s", "velocity", "second encoder")
    entries = [describe_log(log.recording, log.timing, log.joints) for log in checked.logs]
    blocks: list[Block] = [format_table(header, [[e[key] for key in keys] for e in entries], (0, 5), head)]
    blocks += [show_joints(e, log.joints) for e, log in zip(entries, checked.logs, strict=True)]
    if checked.copy is not None:
        file, notice = checked.copy
        blocks.append(f"{show_path(file)}: {notice.text}")
    if checked.excitation is not None:
        blocks += _show_excitation(checked.excitation)
    return tuple(blocks)


def describe_robot_check(robot: "Robot", checked: "LogsCheck") -> dict[str, object]:
    """Return what was found as `symid check --json` gives it."""
    found: dict[str, object] = {
        "robot": robot.name,
        "file": robot.path,
        "convention": robot.convention,
        "joints": [
            {"name": joint.name, "kind": joint.kind.value, "friction": joint.friction.kind.value}
            for joint in robot.joints
        ],
        "logs": [describe_log(log.recording, log.timing, log.joints) for log in checked.logs],
    }
    if checked.copy is not None:
        file, notice = checked.copy
        found["resampled"] = {"file": str(file), "text": notice.text}
    if checked.excitation is not None:
        names = [joint.name for joint in robot.axes]
        found["dynamics"] = [
            {"file": check.source, **_describe_dynamics(check, names)} for check in checked.dynamics
        ]
        found["excitation"] = _describe_excitation(checked.excitation)
    return found


def describe_log(
    recording: "Recording", timing: "Timing", joints: "tuple[JointSummary, ...]"
) -> dict[str, object]:
    """Return what the log itself says, without the robot's dynamics."""
    from symid.data.checks import find_second_encoder

    return {
        "file": recording.source,
        "samples": timing.samples,
        "duration": timing.duration,
        "period": recording.period,
        "has_velocity": recording.velocity is not None,
        "second_encoder": find_second_encoder(recording),
        "timing": {**asdict(timing), "even": timing.even},
        "joints": [asdict(joint) for joint in joints],
    }


def _describe_dynamics(check: "LogCheck", names: list[str]) -> dict[str, object]:
    """Return what the robot's dynamics says of a log."""
    return {
        "signs": [
            {**asdict(entry), "joint": names[entry.joint], "wrong": entry.wrong} for entry in check.signs
        ],
        "exchanges": [
            {**asdict(entry), "first": names[entry.first], "second": names[entry.second]}
            for entry in check.exchanges
        ],
        "torque_delay": None if check.delay is None else {**asdict(check.delay), "late": check.delay.late},
    }


def show_joints(entry: dict[str, object], joints: "tuple[JointSummary, ...]") -> Table:
    """Return the table of a log's joints."""
    header = (
        "joint",
        "from",
        "to",
        "top speed",
        "unit",
        "step",
        "still/%",
        "rms torque",
        "peak",
        "at peak/%",
    )
    rows = [
        (
            joint.name,
            joint.low,
            joint.high,
            joint.speed,
            joint.unit,
            joint.step or None,
            100.0 * joint.standstill,
            joint.torque,
            joint.peak,
            100.0 * joint.saturated,
        )
        for joint in joints
    ]
    return format_table(header, rows, left=(0, 4), title=str(entry["file"]))


def _describe_excitation(found: "Excitation") -> dict[str, object]:
    return {
        "parameters": [
            {
                "name": entry.name,
                "verdict": entry.verdict,
                "relative_std_percent": entry.relative_std_percent,
                "reason": entry.reason,
            }
            for entry in found.parameters
        ],
        "singular_values": found.singular,
        "rank": found.rank,
        "condition": found.condition,
    }


def _show_excitation(found: "Excitation") -> tuple[Block, ...]:
    """Return what the logs tell of every parameter, and the singular values with the base rank marked."""
    rows = [
        (entry.name, entry.verdict, entry.relative_std_percent, entry.reason) for entry in found.parameters
    ]
    counts = ", ".join(
        f"{len(found.list_names(verdict))} {verdict}"
        for verdict in ("told", "vague", "not told", "refused")
        if found.list_names(verdict)
    )
    first = max(0, found.rank - _SHOWN // 2)
    shown = [f"{value:.2g}" for value in found.singular[first : first + _SHOWN]]
    shown.insert(found.rank - first, "|")
    listed = f"{'... ' if first else ''}{' '.join(shown)}"
    table = format_table(("parameter", "verdict", "std/%", "why"), rows, left=(0, 1, 3))
    text = (
        f"What the logs tell: {counts}; condition {found.condition:.3g}\n"
        f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: {listed}"
    )
    return (text, table)
