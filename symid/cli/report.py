"""`symid report ESTIMATE -o report.html`: what was found, on one page."""

from pathlib import Path

import click

from symid.cli.inputs import check_output, load_robot_library, load_robot_of_estimate, read_logs, show_path
from symid.cli.options import force_option, output_option, set_option, split_settings, verb
from symid.cli.output import Answer, Console

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
    check_output(output, force=force)
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model, validate_estimate
    from symid.report.identification import write_report

    found = read_estimate(estimate)
    validations = []
    if logs:
        described = load_robot_of_estimate(robot or found.robot, found, pairs)
        recordings = read_logs(logs, described)
        library = load_robot_library(described, console)
        check_model(found, library.card, str(estimate))
        for recording in recordings:
            console.progress(f"validating on {recording.source}")
            validations.append(validate_estimate(found, library, recording, described.processing))
    path = write_report(output, found, tuple(validations))
    result = {
        "robot": found.robot,
        "file": path,
        "validations": [entry.source for entry in validations],
    }
    warnings = tuple(notice for entry in validations for notice in entry.notices)
    return Answer(text=f"report: {show_path(path)}", result=result, warnings=warnings)
