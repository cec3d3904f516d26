"""`symid export ROBOT [ESTIMATE] -o FILE`: identified values, or a robot file's own, for other programs."""

from pathlib import Path

import click

from symid.api.export import Precision, export_fit
from symid.cli.inputs import NamedRobot, check_output
from symid.cli.options import OUTPUT, Verb, force_option, option, output_option, robot_argument, verb
from symid.cli.output import Answer, Console, make_answer

__all__ = ["command"]


@click.command("export", cls=Verb)
@robot_argument()
@click.argument("estimate", required=False, type=click.Path(path_type=Path))
@output_option("File to write: .toml, .urdf, .xml or .mjcf (MuJoCo), .h (C), .json.", required=True)
@option(
    "--precision",
    type=click.Choice(("double", "float")),
    default="double",
    show_default=True,
    group=OUTPUT,
    help="Type of the numbers in a C header: that of the generated library.",
)
@force_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    estimate: Path | None,
    output: Path,
    precision: Precision,
    force: bool,
) -> Answer:
    """Write ROBOT with the values in ESTIMATE, in the format that the name of FILE ends in.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to
    those of the robot file are taken, and only bodies that can exist. Springs are written as found.
    A result of --rows friction gives its laws to the joints, where robot files have a model of them.
    Without ESTIMATE the robot file's own values are written.
    """
    model = robot.load(console)
    check_output(output, force=force, inputs=(model.path, *([estimate] if estimate else [])))
    if estimate is None:
        return make_answer(model.export(output, precision=precision))
    found = export_fit(model.description, estimate, output, precision=precision, progress=console.progress)
    return make_answer(found)
