"""`symid derive ROBOT`: the derivation of a robot's dynamics, step by step."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import verb
from symid.cli.output import Answer, Console

if TYPE_CHECKING:  # this loads SymPy
    from symid.dynamics.lesson import Step

__all__ = ["command"]


@click.command("derive")
@click.argument("robot")
@click.option("--latex", is_flag=True, help="Formulas in LaTeX.")
@verb
def command(console: Console, *, robot: str, latex: bool) -> Answer:
    """Show how the dynamics come about, from the frames to the torques.

    Each step is a sentence, its formulas, and what was checked.
    """
    described = load_robot(robot)
    console.progress(f"deriving the dynamics of {described.name}")
    from symid.dynamics.lesson import derive_lesson

    steps = derive_lesson(described)
    text = "\n\n".join(_show_step(number, step, latex=latex) for number, step in enumerate(steps, start=1))
    result = {"robot": described.name, "steps": [asdict(step) for step in steps]}
    return Answer(text=text, result=result, warnings=described.notices)


def _show_step(number: int, step: "Step", *, latex: bool) -> str:
    lines = [f"{number}. {step.title}", "", f"   {step.sentence}"]
    lines += [f"     {entry.left} = {entry.latex if latex else entry.text}" for entry in step.formulas]
    if step.check:
        lines += ["", f"   Checked: {step.check}"]
    return "\n".join(lines)
