"""What a robot carries: a table for people, an object for programs, what speaks against it.

Input: a robot, `Payload`. Output: blocks, dictionaries, notices.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.errors import Notice
from symid.notation import INERTIAL
from symid.report.blocks import Block, format_table
from symid.robot.description import Robot

if TYPE_CHECKING:  # these load SymPy
    from symid.parameters.payload import Payload
    from symid.parameters.payload_changes import Change

__all__ = ["describe_payload", "show_payload", "warn_payload"]

_FAR = 3.0


def describe_payload(robot: Robot, found: "Payload") -> dict[str, object]:
    """Return the payload as `symid payload --json` gives it."""
    by_name = {entry.name: entry for entry in found.quantities}
    return {
        "robot": robot.name,
        "joint": found.joint,
        "mass": by_name["mass"].value,
        "com": [by_name[name].value for name in ("cx", "cy", "cz")],
        "inertia": {name[1:]: entry.value for name, entry in by_name.items() if name.startswith("J")},
        "quantities": [asdict(entry) for entry in found.quantities],
        "standard": dict(zip(INERTIAL, found.standard.tolist(), strict=True)),
        "chi2": found.chi2,
        "freedom": found.freedom,
        "scale": found.scale,
        "moved": found.moved,
        "unexplained": [asdict(entry) for entry in found.unexplained],
        "friction": [asdict(entry) for entry in found.friction],
    }


def show_payload(robot: Robot, found: "Payload") -> tuple[Block, ...]:
    """Return the table of what is told, and what is refused, with the reasons."""
    head = (
        f"{robot.name}: what the link of joint {found.joint!r} carries\n"
        "in the frame that the robot file gives to the link; inertia about the centre of mass"
    )
    table = format_table(
        ("quantity", "value", "std", "unit"),
        [
            [entry.name, entry.value, entry.std, entry.unit]
            for entry in found.quantities
            if entry.value is not None
        ],
        left=(0, 3),
    )
    blocks: list[Block] = [head, table]
    refused = [entry for entry in found.quantities if entry.value is None]
    if refused:
        blocks.append("\n".join(f"refused: {entry.name}: {entry.reason}" for entry in refused))
    if found.scale > 1.0:
        blocks.append(f"deviations are {found.scale:.3g} times those of the estimates: chi^2 is too large")
    return tuple(blocks)


def _list(changes: Sequence["Change"]) -> str:
    return ", ".join(
        f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
        for entry in changes
    )


def warn_payload(found: "Payload") -> tuple[Notice, ...]:
    """Return what speaks against the result."""
    notices = []
    refused = [entry.name for entry in found.quantities if entry.value is None]
    if refused:
        text = f"not told: {', '.join(refused)}; do not take what a controller asks for from a guess"
        notices.append(Notice(code="payload.refused", text=text))
    if found.unexplained and found.doubtful:
        text = (
            f"base parameters changed as no payload changes them: {_list(found.unexplained)}; something "
            "else changed between the logs, or friction and filters bias one of them: use the same motions"
        )
        notices.append(Notice(code="payload.unexplained", text=text))
    if found.friction:
        text = f"friction changed: {_list(found.friction)}; gears brake more under load and less when warm"
        notices.append(Notice(code="payload.friction-changed", text=text))
    if found.moved > _FAR:
        text = (
            f"the nearest body that can exist is {found.moved:.2g} standard deviations away from the change "
            "of the base parameters: something else changed between the logs"
        )
        notices.append(Notice(code="payload.inconsistent", text=text))
    return tuple(notices)
