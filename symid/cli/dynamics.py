"""The verbs on a robot's dynamics: `symid derive`, `symid base`, `symid generate`.

derive ROBOT: the derivation of the dynamics, step by step.
base ROBOT: the minimal parameters, exactly, with the reason for each.
generate ROBOT --target c -o FOLDER: the robot's functions as code that stands alone.
"""

from pathlib import Path
from typing import Literal

import click

from symid.api import BaseForm
from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import (
    MODEL,
    OUTPUT,
    NamedRobot,
    Verb,
    force_folder_option,
    friction_option,
    option,
    output_option,
    robot_argument,
    verb,
)
from symid.errors import Notice, UsageError


@click.command("derive", cls=Verb)
@robot_argument()
@option("--latex", OUTPUT, "Print formulas in LaTeX.", is_flag=True)
@verb
def derive_command(console: Console, *, robot: NamedRobot, latex: bool) -> Answer:
    """Show how the dynamics come about, from the frames to the torques, and what code of them costs.

    Each step is a sentence, its formulas, and what was checked. Behind them stand the operations of
    generated functions; --json has those of every route that was counted, not of the chosen ones alone.
    """
    return make_answer(robot.load(console).derivation(latex=latex))


@click.command("base", cls=Verb)
@robot_argument()
@friction_option
@option(
    "--of form",
    MODEL,
    "What is looked at: all torques, the energies, the momentum, or torques at rest.",
    type=click.Choice(("torque", "energy", "momentum", "gravity")),
    default="torque",
)
@verb
def base_command(console: Console, *, robot: NamedRobot, friction: str | None, form: BaseForm) -> Answer:
    """Show the base parameters: all that a robot's motions and torques identify.

    For each its name, what it groups, and why; then those that were eliminated. With --of only
    what the energies, the momentum or a static test identify.
    """
    model = robot.load(console, friction=friction)
    console.progress(f"finding the base parameters of {model.name}")
    return make_answer(model.find_base(form))


@click.command("generate", cls=Verb)
@robot_argument()
@option(
    "--target",
    OUTPUT,
    "What to write: a C library, a NumPy module, or CasADi functions with their C and a loader.",
    type=click.Choice(("c", "python", "casadi")),
    default="c",
)
@option(
    "--precision",
    OUTPUT,
    "Type of all numbers in C.",
    type=click.Choice(("double", "float")),
    default="double",
)
@option(
    "--parameters",
    MODEL,
    "What functions take: the base parameters beta, or all standard parameters pi.",
    type=click.Choice(("base", "standard")),
    default="base",
)
@option(
    "--constant",
    MODEL,
    "Bake the robot file's values into the functions, which then take none.",
    is_flag=True,
)
@option(
    "--trigonometry",
    OUTPUT,
    "Sines in C: of all angles at once, in the code itself, or calls of the C library.",
    type=click.Choice(("own", "library")),
    default="own",
)
@option(
    "--function names", OUTPUT, "Write only this function; may be repeated.", multiple=True, metavar="NAME"
)
@option("--friction-laws", OUTPUT, "Add all static friction laws to the C library.", is_flag=True)
@friction_option
@output_option("Folder of the sources.", required=True, folder=True)
@force_folder_option
@verb
def generate_command(
    console: Console,
    *,
    robot: NamedRobot,
    target: Literal["c", "python", "casadi"],
    precision: Literal["double", "float"],
    parameters: Literal["base", "standard"],
    constant: bool,
    trigonometry: Literal["own", "library"],
    names: tuple[str, ...],
    friction_laws: bool,
    friction: str | None,
    output: Path,
    force: bool,
) -> Answer:
    """Write the robot's functions as a C library, as a Python module, or for CasADi.

    The folder needs no symid. Its self-test is run where a compiler is; those of Python and of CasADi are
    run always. Where neither the robot nor anything else has changed since the last time, nothing is done.
    """
    if friction_laws and target != "c":
        text = f"--friction-laws: these are written in C; leave out --target {target}"
        raise UsageError(Notice(code="usage.friction-laws", text=text))
    return make_answer(
        robot.load(console, friction=friction).write(
            target,
            output,
            functions=names or None,
            precision=precision,
            parameters=parameters,
            constant=constant,
            trigonometry=trigonometry,
            friction_laws=friction_laws,
            force=force,
        )
    )
