"""What `symid new` makes of a robot and its log, in a table for people and as an object for programs.

Input: `Draft`. Output: blocks, dictionaries.
"""

from typing import TYPE_CHECKING

from symid.report.blocks import Block, Table, format_table

if TYPE_CHECKING:  # these load numpy
    from symid.data.log_part import LogPart
    from symid.robot.description import Robot
    from symid.tasks.draft import Draft

__all__ = ["describe_draft", "name_robot", "show_draft"]


def name_robot(robot: "Robot") -> str:
    """Return name and number of joints."""
    plural = "s" if len(robot.joints) != 1 else ""
    return f"{robot.name}, {len(robot.joints)} joint{plural}"


def show_draft(draft: "Draft") -> tuple[Block, ...]:
    """Return the robot, and the columns and units of its log."""
    log = () if draft.log is None else (_show_log(draft.log),)
    return (name_robot(draft.robot), *log)


def _show_log(part: "LogPart") -> Table:
    preset = "" if part.found.log.preset is None else f" (columns of {part.found.log.preset})"
    units = _list_units(part)
    rows = [(name, ", ".join(entry.columns), units[name]) for name, entry in part.found.read.items()]
    header = ("quantity", "columns", "unit")
    return format_table(header, rows, left=(0, 1, 2), title=f"log: {part.file}{preset}")


def _list_units(part: "LogPart") -> dict[str, str]:
    return {name: ", ".join(part.found.units[name]) for name in part.found.read}


def describe_draft(draft: "Draft") -> dict[str, object]:
    """Return robot, joints and log as `symid new --json` gives them."""
    joints = [{"name": joint.name, "kind": joint.kind.value} for joint in draft.robot.joints]
    log = {} if draft.log is None else {"log": _describe_log(draft.log)}
    return {"robot": draft.robot.name, "joints": joints, **log, "notices": len(draft.notices)}


def _describe_log(part: "LogPart") -> dict[str, object]:
    return {
        "file": part.file,
        "preset": part.found.log.preset,
        "columns": {name: list(entry.columns) for name, entry in part.found.read.items()},
        "units": _list_units(part),
        "unused": list(part.found.unused),
        "standstill": part.robot.processing.standstill,
        "dropped": part.robot.processing.drop_first,
    }
