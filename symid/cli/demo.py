"""`symid demo`: the main job on a two-link arm with elastic joints, from the robot file to the report."""

from pathlib import Path

import click

import symid
from symid.cli.options import (
    METHOD,
    Verb,
    backend_option,
    force_folder_option,
    option,
    output_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("demo", cls=Verb)
@backend_option
@option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    group=METHOD,
    help="Random seed.",
)
@output_option("Folder for code, logs, estimate and report.  [default: demo]", folder=True)
@force_folder_option
@verb
def command(console: Console, *, backend: str, seed: int, output: Path | None, force: bool) -> Answer:
    """Simulate an arm with elastic joints, identify dynamics and hysteresis, validate, report.

    Exit code 1 when a parameter is more than 2 % or the hysteresis more than 3 % off the truth, or
    when the links follow no better with the identified model than with a rigid one.
    """
    folder = output or Path("demo")
    return make_answer(symid.demo(folder, seed=seed, backend=backend, force=force, progress=console.progress))
