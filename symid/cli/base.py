"""`symid base ROBOT`: the minimal parameters of a robot, exactly, with the reason for each."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import friction_option, verb
from symid.cli.output import Answer, Console

if TYPE_CHECKING:  # these load SymPy
    from symid.dynamics.base import BaseParameter
    from symid.robot.description import Robot

__all__ = ["command"]

_WIDTH = 100


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
    from symid.notation import INERTIAL

    base = find_base_parameters(described)
    inertial = (*INERTIAL, "IA")
    values = find_parameter_values(described, base)
    parameters = [_describe(described, entry, values) for entry in base.parameters]
    friction_entries = [_describe(described, entry, values) for entry in base.friction]
    eliminated = [{"name": entry.name, "reason": entry.reason} for entry in base.eliminated]
    whole = base.count + sum(entry.label[1] in inertial for entry in base.eliminated)
    text = [f"{described.name}: {base.count} base parameter{'s' if base.count != 1 else ''} of {whole}"]
    text += [_show(entry) for entry in parameters]
    if friction_entries:
        text += ["", "friction parameters", *(_show(entry) for entry in friction_entries)]
    if eliminated:
        text += ["", "eliminated", *_gather(eliminated)]
    result = {
        "robot": described.name,
        "count": base.count,
        "parameters": parameters,
        "friction": friction_entries,
        "eliminated": eliminated,
    }
    return Answer(text="\n".join(text), result=result, warnings=described.notices)


def _show(entry: Mapping[str, object]) -> str:
    """Return a parameter in two lines: what it groups, and why."""
    parts = [str(entry["name"])]
    if entry["expression"] != entry["name"]:
        parts.append(str(entry["expression"]))
    if entry["value"] is not None:
        parts.append(f"{entry['value']:.6g}")
    return f"\n{' = '.join(parts)}  [{entry['unit']}]\n{_wrap(str(entry['reason']))}"


def _gather(eliminated: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the eliminated parameters, those with one reason together, in their order."""
    names: dict[str, list[str]] = {}
    for entry in eliminated:
        names.setdefault(entry["reason"], []).append(entry["name"])
    return [f"\n{', '.join(group)}\n{_wrap(reason)}" for reason, group in names.items()]


def _wrap(text: str) -> str:
    return textwrap.fill(text, width=_WIDTH, initial_indent="    ", subsequent_indent="    ")


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
