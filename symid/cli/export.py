"""`symid export ROBOT [ESTIMATE] -o FILE`: identified values, or a robot file's own, for other programs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.exported import KINDS, Export, list_omissions, write_export
from symid.cli.friction_result import export_friction
from symid.cli.identified import Identified, build_robot, find_identified, list_warnings
from symid.cli.inputs import check_output, load_robot, show_path
from symid.cli.options import force_option, output_option, verb
from symid.cli.output import Answer, Console
from symid.errors import EstimateError, Notice, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.parameters.base import BaseParameters
    from symid.parameters.identified_robot import IdentifiedRobot
    from symid.robot.description import Robot

__all__ = ["command", "find_identified", "write_identified"]

_SHOWN = 3


@click.command("export")
@click.argument("robot")
@click.argument("estimate", required=False, type=click.Path(path_type=Path))
@output_option("File to write: .toml, .urdf, .xml or .mjcf (MuJoCo), .h (C), .json.", required=True)
@click.option(
    "--precision",
    type=click.Choice(("double", "float")),
    default="double",
    show_default=True,
    help="Type of the numbers in a C header: that of the generated library.",
)
@force_option
@verb
def command(
    console: Console, *, robot: str, estimate: Path | None, output: Path, precision: str, force: bool
) -> Answer:
    """Write ROBOT with the values in ESTIMATE, in the format that the name of FILE ends in.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to
    those of the robot file are taken, and only bodies that can exist. Springs are written as found.
    A result of --rows friction gives its laws to the joints, where robot files have a model of them.
    Without ESTIMATE the robot file's own values are written.
    """
    suffix = output.suffix.lower()
    if suffix not in KINDS:
        text = f"{output}: the format is unknown; give a name that ends in {', '.join(KINDS)}"
        raise UsageError(Notice(code="usage.suffix", text=text))
    if precision != "double" and suffix != ".h":
        text = f"--precision {precision}: only a C header has a precision; leave the option out"
        raise UsageError(Notice(code="usage.export-precision", text=text))
    if estimate is None:
        return _export_stated(console, robot, output, precision=precision, force=force)
    from symid.friction.results import is_friction_result

    if is_friction_result(estimate):
        _check_friction_suffix(output, robot, estimate)
        check_output(output, force=force, inputs=(load_robot(robot).path, estimate))
        return export_friction(console, robot, estimate, output)
    found = find_identified(robot, estimate)
    check_output(output, force=force, inputs=(found.robot.path, estimate))
    return _export_identified(console, found, estimate, output, precision=precision)


def write_identified(found: Identified, path: Path, output: Path) -> "IdentifiedRobot":
    """Write the robot file `output` with the values found in the estimate at `path`, and return the robot.

    Raises:
        EstimateError: its values are none that a robot file can have.
        OutputError: the file cannot be written.
    """
    from symid.identification.storage import write_file

    identified = build_robot(found)
    write_file(output, _write_readable(_describe(identified, found), ".toml", path))
    return identified


def _export_identified(
    console: Console, found: Identified, path: Path, output: Path, *, precision: str
) -> Answer:
    """Write what the estimate at `path` says, and return the answer."""
    from symid.identification.storage import write_file

    suffix = output.suffix.lower()
    console.progress(f"looking for bodies with the identified values of {found.robot.name}")
    identified = build_robot(found)
    exported = replace(_describe(identified, found), precision=precision)
    write_file(output, _write_readable(exported, suffix, path))
    standard = identified.standard
    left_out = list_omissions(exported.robot, suffix)
    result = {
        "file": output,
        "format": KINDS[suffix],
        "robot": found.robot.name,
        "elastic": any(identified.robot.elastic),
        "outcome": exported.outcome,
        "largest_change": max(map(abs, standard.residual.tolist()), default=0.0),
        "blamed": standard.blamed,
        "not_identified": found.missing,
        "left_out": left_out,
    }
    return Answer(
        text=f"{KINDS[suffix]}: {show_path(output)}\n{standard.outcome.value}",
        result=result,
        warnings=(*list_warnings(identified, found, path), *_warn_of_omissions(left_out, output)),
    )


def _describe(identified: "IdentifiedRobot", found: Identified) -> Export:
    sources = tuple(Path(source).name for source in found.sources)
    before = f"; before: {identified.robot.source}" if identified.robot.source else ""
    source = f"Values identified from {', '.join(sources)}{before}"
    return Export(
        robot=replace(identified.robot, source=source),
        base=found.base,
        outcome=identified.standard.outcome.name.lower(),
        sources=sources,
        found=found.values,
    )


def _export_stated(console: Console, name: str, output: Path, *, precision: str, force: bool) -> Answer:
    """Write the values of the robot file called `name`.

    Raises:
        RobotError: it does not state them all.
    """
    from symid.identification.storage import write_file
    from symid.parameters.base import find_base_parameters

    suffix = output.suffix.lower()
    robot = load_robot(name)
    check_output(output, force=force, inputs=(robot.path,))
    console.progress(f"writing {robot.name}")
    base = find_base_parameters(robot)
    if suffix != ".toml":
        _check_values(robot, base)
    exported = Export(robot=robot, base=base, outcome="stated", precision=precision)
    write_file(output, write_export(exported, suffix))
    left_out = list_omissions(robot, suffix)
    result = {
        "file": output,
        "format": KINDS[suffix],
        "robot": robot.name,
        "elastic": any(robot.elastic),
        "outcome": exported.outcome,
        "left_out": left_out,
    }
    return Answer(
        text=f"{KINDS[suffix]}: {show_path(output)}",
        result=result,
        warnings=(*robot.notices, *_warn_of_omissions(left_out, output)),
    )


def _check_values(robot: "Robot", base: "BaseParameters") -> None:
    """Refuse a robot whose file does not say what its links are.

    Raises:
        RobotError: a link or a symbolic length has no value.
    """
    from symid.parameters.consistency_inputs import build_grouping

    build_grouping(robot, base)
    missing = [joint.name for joint in robot.joints if joint.inertial is None]
    if missing:
        text = (
            f"the links of {', '.join(missing)} have no values; give them in the robot file, or identify "
            "them and give the estimate to `symid export`"
        )
        raise RobotError(Notice(code="export.no-values", text=text, file=robot.path))


def _check_friction_suffix(output: Path, robot: str, estimate: Path) -> None:
    if output.suffix.lower() != ".toml":
        text = (
            f"{output}: friction goes into a robot file first: `symid export {robot} {estimate} "
            f"-o new.toml`, then `symid export new.toml -o {output}`"
        )
        raise UsageError(Notice(code="usage.suffix", text=text))


def _write_readable(exported: Export, suffix: str, path: Path) -> str:
    """Return the text of the file, which can be read where symid reads such files.

    Raises:
        EstimateError: its values are none that such a file can have.
    """
    from symid.formats.toml import parse_robot
    from symid.formats.urdf import parse_urdf

    text = write_export(exported, suffix)
    try:
        if suffix == ".toml":
            parse_robot(text)
        elif suffix == ".urdf":
            parse_urdf(text)
    except RobotError as error:
        reasons = "; ".join(notice.text for notice in error.notices)
        said = f"no {KINDS[suffix]} can have these values: {reasons}; identify from logs that tell more"
        raise EstimateError(Notice(code="export.impossible", text=said, file=str(path))) from error
    return text


def _warn_of_omissions(left_out: Sequence[str], output: Path) -> tuple[Notice, ...]:
    if not left_out:
        return ()
    more = f"; and {len(left_out) - _SHOWN} more" if len(left_out) > _SHOWN else ""
    text = f"the format has no words for this, which stands in comments: {'; '.join(left_out[:_SHOWN])}{more}"
    return (Notice(code="export.left-out", text=text, file=str(output)),)
