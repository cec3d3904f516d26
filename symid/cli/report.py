"""`symid report ESTIMATE -o report.html`: what was found, on one page."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import (
    check_output,
    describe_origin,
    load_robot_library,
    load_robot_of_estimate,
    read_logs,
    show_path,
)
from symid.cli.options import force_option, output_option, set_option, split_settings, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.identification.estimate import Estimate, Validation
    from symid.robot.description import Robot

__all__ = ["command"]


@click.command("report")
@click.argument("estimate", type=click.Path(path_type=Path))
@click.option(
    "--validation",
    "logs",
    multiple=True,
    metavar="LOG",
    type=click.Path(path_type=Path),
    help="Held-out log to predict; may be repeated.",
)
@click.option("--robot", help="Robot of the logs.  [default: the name in ESTIMATE]")
@set_option
@output_option("Page to write.", required=True)
@force_option
@verb
def command(
    console: Console,
    *,
    estimate: Path,
    logs: tuple[Path, ...],
    robot: str | None,
    settings: tuple[str, ...],
    output: Path,
    force: bool,
) -> Answer:
    """Write one self-contained HTML page: verdict, parameters, measured and predicted torques."""
    pairs = split_settings(settings)
    check_output(output, force=force, inputs=(estimate, *logs))
    from symid.data.checks import check_recording
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model, find_window, validate_estimate
    from symid.report.identification import write_report

    found = read_estimate(estimate)
    validations: list[Validation] = []
    notices: tuple[Notice, ...] = ()
    origin: tuple[str, ...] = ()
    if logs:
        described = _find_robot(robot, found, pairs)
        check_output(output, force=force, inputs=(described.path,))
        notices += described.notices
        recordings = read_logs(logs, described)
        library = load_robot_library(described, console)
        notices += library.notices
        origin = describe_origin(described, library, recordings)
        check_model(found, library.card, str(estimate))
        for recording in recordings:
            console.progress(f"validating on {recording.source}")
            notices += (*recording.notices, *check_recording(recording, described))
            # In the rows of the fit, because only like residuals can be compared.
            validations.append(
                validate_estimate(
                    found,
                    library,
                    recording,
                    described.processing,
                    rows=found.rows,
                    window=find_window(found.settings),
                )
            )
    path = write_report(output, found, tuple(validations), notices, origin)
    result = {
        "robot": found.robot,
        "file": path,
        "validations": [entry.source for entry in validations],
    }
    warnings = (*notices, *(notice for entry in validations for notice in entry.notices))
    return Answer(text=f"report: {show_path(path)}", result=result, warnings=warnings)


def _find_robot(name: str | None, estimate: "Estimate", pairs: tuple[tuple[str, str], ...]) -> "Robot":
    """Return the robot of the logs; where the estimate's name leads nowhere, say how to name a file."""
    try:
        return load_robot_of_estimate(name or estimate.robot, estimate, pairs)
    except UsageError as error:
        first = error.notices[0]
        if first.code != "usage.unknown-robot" or name is not None:
            raise
        text = (
            f"the estimate was made with robot '{estimate.robot}', which is not among the known robots; "
            "name its file with --robot FILE.toml"
        )
        raise UsageError(replace(first, text=text)) from error
