"""`symid identify ROBOT LOG...`: parameters with their uncertainty, from logs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import (
    check_distinct,
    check_output,
    describe_settings,
    load_robot,
    load_robot_library,
    read_logs,
    show_path,
)
from symid.cli.options import (
    force_option,
    friction_option,
    output_option,
    processing_options,
    rows_options,
    set_option,
    split_settings,
    verb,
)
from symid.cli.output import Answer, Console
from symid.cli.tables import describe_estimate, show_parameters, show_residual
from symid.errors import Notice

if TYPE_CHECKING:  # this loads numpy
    from symid.identification.estimate import Estimate

__all__ = ["command"]


@click.command("identify")
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@rows_options
@friction_option
@processing_options
@set_option
@output_option("Write the estimate as JSON, for `validate` and `report`.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    logs: tuple[Path, ...],
    rows: str,
    estimator: str,
    friction: str | None,
    cutoff: float | None,
    decimate: int | None,
    drop_first: int | None,
    drop_last: int | None,
    settings: tuple[str, ...],
    output: Path | None,
    force: bool,
) -> Answer:
    """Identify a robot's base parameters and friction from one log or several.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that the logs cannot tell are refused by name, with the reason.
    """
    pairs = split_settings(
        settings,
        filter_cutoff=cutoff,
        decimation__factor=decimate,
        drop_first=drop_first,
        drop_last=drop_last,
    )
    described = load_robot(robot, pairs, friction)
    check_output(output, force=force, inputs=(described.path, *logs))
    check_distinct(logs)
    recordings = read_logs(logs, described)
    library = load_robot_library(described, console)
    console.progress(f"identifying {described.name} from {len(recordings)} log{'s'[: len(recordings) > 1]}")
    from symid.data.checks import check_recording
    from symid.identification.identify import identify_parameters
    from symid.identification.storage import write_estimate
    from symid.identification.validate import find_digest

    estimate = identify_parameters(
        library,
        recordings,
        described.processing,
        rows=rows,
        estimator=estimator,
        echo={
            "log": describe_settings(described)["log"],
            "log_digests": [find_digest(str(path)) for path in logs],
        },
    )
    warnings: tuple[Notice, ...] = (*described.notices, *library.notices)
    for recording in recordings:
        warnings += (*recording.notices, *check_recording(recording, described))
    warnings += estimate.notices
    text = _write_summary(estimate)
    if output is not None:
        text.append(f"estimate: {show_path(write_estimate(estimate, output))}")
    result = {**describe_estimate(estimate), "file": output, "backend": library.backend}
    return Answer(text="\n\n".join(text), result=result, warnings=warnings)


def _write_summary(estimate: "Estimate") -> list[str]:
    """Return the parts of the answer: a headline, the tables, what was refused."""
    headline = (
        f"{estimate.robot}: {estimate.rows} rows, {estimate.estimator}, {estimate.samples} equations, "
        f"condition {estimate.condition:.3g}: {estimate.outcome.value}"
    )
    text = [headline, show_parameters(estimate), show_residual(estimate.residual)]
    if estimate.refused:
        text.append("\n".join(f"refused: {name}: {reason}" for name, reason in estimate.refused))
    return text
