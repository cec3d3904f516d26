"""`symid payload ROBOT LOADED... --empty EMPTY`: what the robot carries, from logs or estimates of both."""

from pathlib import Path

import click

from symid.api.payload import PayloadEstimator, PayloadRows
from symid.cli.inputs import NamedRobot, check_output, show_path
from symid.cli.options import (
    INPUT,
    METHOD,
    MODEL,
    FiniteRange,
    Verb,
    force_option,
    option,
    output_option,
    robot_argument,
    verb,
)
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("payload", cls=Verb)
@robot_argument(computes=True)
@click.argument("loaded", nargs=-1, required=True, metavar="LOADED...", type=click.Path(path_type=Path))
@option(
    "--empty",
    multiple=True,
    required=True,
    metavar="EMPTY",
    type=click.Path(path_type=Path),
    group=INPUT,
    help="Estimate or log without the payload; repeat the option for several logs.",
)
@option(
    "--joint",
    metavar="NAME",
    group=MODEL,
    help="Joint whose link carries the payload.  [default: the last joint]",
)
@option(
    "--mass",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="KG",
    group=MODEL,
    help="Known mass, for example from a balance: the rest becomes more certain.",
)
@option(
    "--rows",
    type=click.Choice(("torque", "momentum")),
    default="torque",
    show_default=True,
    group=METHOD,
    help="Equations built from logs: torques, or momentum over windows.",
)
@option(
    "--estimator",
    type=click.Choice(("ols", "wls")),
    default="wls",
    show_default=True,
    group=METHOD,
    help="Least squares for logs: ordinary, or weighted by the noise of each joint.",
)
@output_option("Write the result as JSON.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    loaded: tuple[Path, ...],
    empty: tuple[Path, ...],
    joint: str | None,
    mass: float | None,
    rows: PayloadRows,
    estimator: PayloadEstimator,
    output: Path | None,
    force: bool,
) -> Answer:
    """Find mass, centre of mass and inertia of what ROBOT carries in LOADED and not in EMPTY.

    LOADED and EMPTY are an estimate each, as `identify` writes them, or logs. The inertia is that of a
    body that can exist. What the robot cannot show, or noise hides, is refused by name.
    """
    check_output(output, force=force, inputs=(*loaded, *empty))
    model = robot.load(console)
    check_output(output, force=force, inputs=(model.path,))
    found = model.payload(loaded, empty, joint=joint, mass=mass, rows=rows, estimator=estimator)
    if output is None:
        return make_answer(found, file=None)
    return make_answer(found, f"payload: {show_path(found.save(output))}", file=output)
