"""`symid base ROBOT`: the minimal parameters of a robot, exactly, with the reason for each."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import cut_options, friction_option, verb
from symid.cli.output import Answer, Console

if TYPE_CHECKING:  # these load SymPy
    from symid.parameters.base import BaseParameter
    from symid.robot.description import Robot

__all__ = ["command"]

_WIDTH = 100


@click.command("base")
@click.argument("robot")
@friction_option
@click.option(
    "--of",
    "form",
    type=click.Choice(("torque", "energy", "momentum", "gravity")),
    default="torque",
    show_default=True,
    help="What is looked at: all torques, the energies, the momentum, or torques at rest.",
)
@cut_options
@verb
def command(
    console: Console,
    *,
    robot: str,
    friction: str | None,
    form: str,
    base_link: str | None,
    tip_link: str | None,
    snap: float | None,
) -> Answer:
    """Show the base parameters: all that a robot's motions and torques can tell.

    For each its name, what it groups, and why; then those that were eliminated. With --of only
    what the energies, the momentum or a static test can tell.
    """
    described = load_robot(robot, friction=friction, base=base_link, tip=tip_link, snap=snap)
    console.progress(f"finding the base parameters of {described.name}")
    from symid.dynamics.drives import DRIVE
    from symid.dynamics.labels import write_label
    from symid.notation import INERTIAL
    from symid.parameters.base import find_base_parameters
    from symid.parameters.values import find_parameter_forms, find_parameter_values

    base = find_base_parameters(described, form=form)
    inertial = (*INERTIAL, *DRIVE)
    values = find_parameter_values(described, base)
    forms = find_parameter_forms(described, base)
    parameters = [_describe(described, entry, values, forms) for entry in base.parameters]
    friction_entries = [_describe(described, entry, values, forms) for entry in base.friction]
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
        "of": form,
        # Changes of the parameters that nothing shows, exact coefficients as text.
        "null_space": [
            {write_label(described, label): str(coefficient) for label, coefficient in change}
            for change in base.null_space
        ],
    }
    return Answer(text="\n".join(text), result=result, warnings=described.notices)


def _show(entry: Mapping[str, object]) -> str:
    """Return a parameter in two lines: what it groups, and why."""
    parts = [str(entry["name"])]
    if entry["expression"] != entry["name"]:
        parts.append(str(entry["expression"]))
    if entry["form"] is not None:
        parts.append(str(entry["form"]))
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


def _describe(
    robot: "Robot", entry: "BaseParameter", values: Mapping[str, float], forms: Mapping[str, object]
) -> dict[str, object]:
    from symid.dynamics.labels import find_label_unit, find_owner

    return {
        "name": entry.name,
        "expression": entry.expression,
        "reason": entry.reason,
        "unit": find_label_unit(robot, entry.label),
        "joint": find_owner(robot, entry.label),
        "value": values.get(entry.name),
        "form": str(forms[entry.name]).replace("**", "^") if entry.name in forms else None,
    }
