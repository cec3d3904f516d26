"""`symid report ESTIMATE -o report.html`: what was found, on one page."""

from pathlib import Path

import click

import symid
from symid.cli.inputs import NamedRobot, check_output, split_settings
from symid.cli.options import (
    INPUT,
    METHOD,
    Verb,
    force_option,
    option,
    output_option,
    robot_option,
    set_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]


@click.command("report", cls=Verb)
@click.argument("estimate", type=click.Path(path_type=Path))
@option(
    "--validation",
    "logs",
    multiple=True,
    metavar="LOG",
    type=click.Path(path_type=Path),
    group=INPUT,
    help="Held-out log to predict; may be repeated.",
)
@option(
    "--diagnose",
    is_flag=True,
    group=METHOD,
    help="Read the logs of the fit again: identifiability, essential parameters, bootstrap, drift, and "
    "which term the residual misses.",
)
@robot_option("Robot of the logs.  [default: the name in ESTIMATE]")
@set_option
@output_option("Page to write.", required=True)
@force_option
@verb
def command(
    console: Console,
    *,
    estimate: Path,
    logs: tuple[Path, ...],
    diagnose: bool,
    robot: NamedRobot | None,
    settings: tuple[str, ...],
    output: Path,
    force: bool,
) -> Answer:
    """Write one self-contained HTML page: verdict, parameters, measured and predicted torques.

    For elastic joints also springs, hysteresis loops, and the methods that were compared; for friction
    its curves, and the laws that were compared.
    """
    pairs = split_settings(settings)
    # A diagnosis reads the logs of the fit as the fit did.
    given = [name for name, value in (("--robot", robot and not diagnose), ("--set", settings)) if value]
    if given and not logs:
        text = (
            f"{', '.join(given)} is of the logs that --validation names, and there is none; "
            f"give --validation LOG, or leave {'them' if given[1:] else 'it'} out"
        )
        raise UsageError(Notice(code="usage.no-validation", text=text))
    check_output(output, force=force, inputs=(estimate, *logs))
    fit = symid.load_fit(estimate, None if robot is None else robot.load(console), progress=console.progress)
    if logs or diagnose:
        check_output(output, force=True, inputs=(fit.robot.path,))
    return make_answer(fit.report(output, validation=logs, settings=pairs, diagnose=diagnose))
