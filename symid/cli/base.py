"""`symid base ROBOT`: the minimal parameters of a robot, exactly, with the reason for each."""

from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import friction_option, verb
from symid.cli.output import Answer, Console, format_table

if TYPE_CHECKING:  # these load SymPy
    from symid.dynamics.base import BaseParameter
    from symid.robot.description import Robot

__all__ = ["command"]


@click.command("base")
@click.argument("robot")
@friction_option
@verb
def command(console: Console, *, robot: str, friction: str | None) -> Answer:
    """Show the base parameters: all that a robot's motions and torques can tell.

    For each its name, what it groups, and why; then those that were eliminated.
    """
    described = load_robot(robot, friction=friction)
    console.progress(f"finding the base parameters of {described.name}")
    from symid.dynamics.base import find_base_parameters
    from symid.dynamics.values import find_parameter_values

    base = find_base_parameters(described)
    values = find_parameter_values(described, base)
    parameters = [_describe(described, entry, values) for entry in base.parameters]
    friction_entries = [_describe(described, entry, values) for entry in base.friction]
    eliminated = [{"name": entry.name, "reason": entry.reason} for entry in base.eliminated]
    header = ("name", "expression", "unit", "value", "reason")
    columns = ("name", "expression", "unit", "value", "reason")
    blocks = [f"{described.name}: {base.count} base parameters"]
    for title, entries in (("", parameters), ("friction parameters", friction_entries)):
        if entries:
            rows = [[entry[column] for column in columns] for entry in entries]
            blocks += [title] if title else []
            blocks.append(format_table(header, rows, left=(0, 1, 2, 4)))
    if eliminated:
        rows = [[entry["name"], entry["reason"]] for entry in eliminated]
        blocks.append("eliminated")
        blocks.append(format_table(("name", "reason"), rows, left=(0, 1)))
    result = {
        "robot": described.name,
        "count": base.count,
        "parameters": parameters,
        "friction": friction_entries,
        "eliminated": eliminated,
    }
    return Answer(text="\n\n".join(blocks), result=result, warnings=described.notices)


def _describe(robot: "Robot", entry: "BaseParameter", values: dict[str, float]) -> dict[str, object]:
    from symid.notation import find_unit
    from symid.robot.description import JointKind

    joint = robot.joints[entry.label[0]]
    return {
        "name": entry.name,
        "expression": entry.expression,
        "reason": entry.reason,
        "unit": find_unit(entry.label[1], prismatic=joint.kind is JointKind.PRISMATIC),
        "joint": joint.name,
        "value": values.get(entry.name),
    }
