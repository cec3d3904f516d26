"""`symid export ROBOT ESTIMATE -o FILE`: identified values as a robot file."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import check_output, load_robot_of_estimate, show_path
from symid.cli.options import force_option, output_option, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.identification.estimate import Estimate
    from symid.parameters.base import BaseParameters
    from symid.parameters.identified_robot import IdentifiedRobot
    from symid.robot.description import Robot

__all__ = ["command"]


@click.command("export")
@click.argument("robot")
@click.argument("estimate", type=click.Path(path_type=Path))
@output_option("Robot file to write, .toml.", required=True)
@force_option
@verb
def command(console: Console, *, robot: str, estimate: Path, output: Path, force: bool) -> Answer:
    """Write ROBOT with the values in ESTIMATE as a robot file, for generate and simulate.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to
    those of the robot file are taken, and only bodies that can exist.
    """
    if output.suffix.lower() != ".toml":
        text = f"{output}: a robot file is TOML; give a name that ends in .toml"
        raise UsageError(Notice(code="usage.suffix", text=text))
    from symid.identification.storage import read_estimate, write_file

    found = read_estimate(estimate)
    described = load_robot_of_estimate(robot, found, ())
    check_output(output, force=force, inputs=(described.path, estimate))
    console.progress(f"looking for bodies with the identified values of {described.name}")
    from symid.formats.writer import write_robot
    from symid.parameters.base import find_base_parameters

    base = find_base_parameters(described)
    identified = _build(described, base, found, estimate)
    comment = f"{described.name} with values identified from {', '.join(map(_find_name, found.sources))}."
    write_file(output, write_robot(identified.robot, comment=comment))
    standard = identified.standard
    warnings = (*described.notices, *_warn(identified, estimate), *_name_missing(found, base, estimate))
    result = {
        "file": output,
        "robot": described.name,
        "outcome": standard.outcome.name.lower(),
        "largest_change": max(map(abs, standard.residual.tolist()), default=0.0),
        "blamed": standard.blamed,
    }
    text = f"robot file: {show_path(output)}\n{standard.outcome.value}"
    return Answer(text=text, result=result, warnings=warnings)


def _find_name(source: str) -> str:
    return Path(source).name


def _build(robot: "Robot", base: "BaseParameters", found: "Estimate", path: Path) -> "IdentifiedRobot":
    """Return the robot with the estimate's values.

    Raises:
        EstimateError: the estimate is of another model.
    """
    from symid.codegen.model_card import build_model_card
    from symid.identification.validate import check_model
    from symid.parameters.identified_robot import build_identified_robot

    check_model(found, build_model_card(robot, base, ()), str(path))
    return build_identified_robot(
        robot,
        base,
        {entry.name: entry.value for entry in found.parameters},
        deviations={entry.name: entry.std for entry in found.parameters if entry.std > 0.0},
    )


def _warn(identified: "IdentifiedRobot", path: Path) -> tuple[Notice, ...]:
    reason = identified.standard.reason
    if not reason:
        return ()
    text = f"no bodies have the identified values exactly, the nearest were written: {reason}"
    return (Notice(code="export.inconsistent", text=text, file=str(path)),)


def _name_missing(found: "Estimate", base: "BaseParameters", path: Path) -> tuple[Notice, ...]:
    known = {entry.name for entry in found.parameters}
    names = [entry.name for entry in (*base.parameters, *base.friction) if entry.name not in known]
    if not names:
        return ()
    text = f"not identified, so the robot file's own values or the nearest bodies stand: {', '.join(names)}"
    return (Notice(code="export.not-identified", text=text, file=str(path)),)
