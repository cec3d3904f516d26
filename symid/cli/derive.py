"""`symid derive ROBOT`: the derivation of a robot's dynamics, step by step."""

import click

from symid.cli.inputs import NamedRobot
from symid.cli.options import OUTPUT, Verb, option, robot_argument, verb
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("derive", cls=Verb)
@robot_argument()
@option("--latex", is_flag=True, group=OUTPUT, help="Print formulas in LaTeX.")
@verb
def command(console: Console, *, robot: NamedRobot, latex: bool) -> Answer:
    """Show how the dynamics come about, from the frames to the torques, and what code of them costs.

    Each step is a sentence, its formulas, and what was checked. Behind them stand the operations of
    generated functions; --json has those of every route that was counted, not of the chosen ones alone.
    """
    return make_answer(robot.load(console).derivation(latex=latex))
