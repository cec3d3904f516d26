"""What `symid check` says of logs, as tables for people and values for programs.

Input: recordings and what was found in them. Output: entries of the result, parts of the text.
"""

from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.cli.output import format_table

if TYPE_CHECKING:  # these load numpy
    from symid.data.recording import Recording
    from symid.data.summary import JointSummary
    from symid.data.timing import Timing
    from symid.logcheck.log_check import LogCheck
    from symid.logcheck.log_excitation import Excitation

__all__ = ["describe_check", "describe_log", "show_excitation", "show_joints"]

_SHOWN = 12


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


def describe_check(check: "LogCheck", names: list[str]) -> dict[str, object]:
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


def show_joints(entry: dict[str, object], joints: "tuple[JointSummary, ...]") -> str:
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
    return f"{entry['file']}\n{format_table(header, rows, left=(0, 4))}"


def show_excitation(found: "Excitation") -> str:
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
    return (
        f"What the logs tell: {counts}; condition {found.condition:.3g}\n"
        f"singular values of the scaled matrix about its rank {found.rank} of {len(found.singular)}: "
        f"{listed}\n\n{table}"
    )
