"""`symid base ROBOT`: the minimal parameters of a robot, exactly, with the reason for each."""

import click

from symid.api.base import BaseForm
from symid.cli.inputs import NamedRobot
from symid.cli.options import MODEL, Verb, friction_option, option, robot_argument, verb
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("base", cls=Verb)
@robot_argument()
@friction_option
@option(
    "--of",
    "form",
    type=click.Choice(("torque", "energy", "momentum", "gravity")),
    default="torque",
    show_default=True,
    group=MODEL,
    help="What is looked at: all torques, the energies, the momentum, or torques at rest.",
)
@verb
def command(console: Console, *, robot: NamedRobot, friction: str | None, form: BaseForm) -> Answer:
    """Show the base parameters: all that a robot's motions and torques identify.

    For each its name, what it groups, and why; then those that were eliminated. With --of only
    what the energies, the momentum or a static test identify.
    """
    model = robot.load(console, friction=friction)
    console.progress(f"finding the base parameters of {model.name}")
    return make_answer(model.find_base(form))
