"""`symid generate ROBOT --target c -o FOLDER`: the robot's functions as code that stands alone."""

from pathlib import Path
from typing import Literal

import click

from symid.cli.inputs import NamedRobot
from symid.cli.options import (
    MODEL,
    OUTPUT,
    Verb,
    force_folder_option,
    friction_option,
    option,
    output_option,
    robot_argument,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]


@click.command("generate", cls=Verb)
@robot_argument()
@option(
    "--target",
    type=click.Choice(("c", "python", "casadi")),
    default="c",
    show_default=True,
    group=OUTPUT,
    help="What to write: a C library, a NumPy module, or CasADi functions with their C and a loader.",
)
@option(
    "--precision",
    type=click.Choice(("double", "float")),
    default="double",
    show_default=True,
    group=OUTPUT,
    help="Type of all numbers in C.",
)
@option(
    "--parameters",
    type=click.Choice(("base", "standard")),
    default="base",
    show_default=True,
    group=MODEL,
    help="What functions take: the base parameters beta, or all standard parameters pi.",
)
@option(
    "--constant",
    is_flag=True,
    group=MODEL,
    help="Bake the robot file's values into the functions, which then take none.",
)
@option(
    "--trigonometry",
    type=click.Choice(("own", "library")),
    default="own",
    show_default=True,
    group=OUTPUT,
    help="Sines in C: of all angles at once, in the code itself, or calls of the C library.",
)
@option(
    "--function",
    "names",
    multiple=True,
    metavar="NAME",
    group=OUTPUT,
    help="Write only this function; may be repeated.",
)
@option(
    "--friction-laws",
    is_flag=True,
    group=OUTPUT,
    help="Add all static friction laws to the C library.",
)
@friction_option
@output_option("Folder of the sources.", required=True, folder=True)
@force_folder_option
@verb
def command(
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
