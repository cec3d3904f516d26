"""`symid validate ROBOT ESTIMATE LOG`: what an estimate explains of a log it was not fitted to."""

from pathlib import Path

import click

from symid.cli.inputs import load_robot_library, load_robot_of_estimate, read_logs
from symid.cli.options import FiniteRange, set_option, split_settings, verb
from symid.cli.output import Answer, Console
from symid.cli.tables import describe_validation, show_residual
from symid.errors import Notice

__all__ = ["command"]

_MISSED = 1


@click.command("validate")
@click.argument("robot")
@click.argument("estimate", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--gate",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="PERCENT",
    help="Largest acceptable mean of the joints' relative residuals.",
)
@set_option
@verb
def command(
    console: Console, *, robot: str, estimate: Path, log: Path, gate: float | None, settings: tuple[str, ...]
) -> Answer:
    """Predict the torques of LOG with the parameters in ESTIMATE; nothing is fitted.

    Filter and friction are those of the identification. Exit code 1 when the gate is missed.
    """
    pairs = split_settings(settings)
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model, validate_estimate

    found = read_estimate(estimate)
    described = load_robot_of_estimate(robot, found, pairs)
    (recording,) = read_logs((log,), described)
    library = load_robot_library(described, console)
    check_model(found, library.card, str(estimate))
    console.progress(f"validating on {recording.source}")
    validation = validate_estimate(found, library, recording, described.processing)
    reached = validation.mean_relative_percent
    missed = gate is not None and not reached <= gate
    errors = []
    if missed:
        text = f"mean relative residual {reached:.4f} %, the gate is {gate:g} %"
        errors.append(Notice(code="validate.gate-missed", text=text, file=recording.source))
    text = "\n\n".join(
        (
            f"{described.name} on {recording.source}: mean relative residual {reached:.4f} %",
            show_residual(validation.residual),
        )
    )
    return Answer(
        text=text,
        result={**describe_validation(validation), "gate": gate, "accepted": not missed},
        warnings=(*described.notices, *library.notices, *recording.notices, *validation.notices),
        errors=tuple(errors),
        exit_code=_MISSED if missed else 0,
    )
