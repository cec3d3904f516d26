"""`symid export ROBOT ESTIMATE -o FILE`: identified values as a robot file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.friction_result import export_friction
from symid.cli.inputs import check_output, load_robot, load_robot_of_estimate, show_path
from symid.cli.options import force_option, output_option, verb
from symid.cli.output import Answer, Console
from symid.errors import EstimateError, Notice, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.elastic.estimate import ElasticEstimate
    from symid.identification.estimate import ParameterEstimate
    from symid.parameters.base import BaseParameters
    from symid.parameters.identified_robot import IdentifiedRobot
    from symid.robot.description import Robot
    from symid.robot.elasticity import Elasticity

__all__ = ["Identified", "command", "find_identified", "write_identified"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identified:
    """What an estimate says of a robot: identified values, rotors of elastic joints, springs one a joint.

    `robot` is the robot as it was identified, `base` its base parameters; `missing` names what has no value.
    """

    robot: "Robot"
    base: "BaseParameters"
    sources: tuple[str, ...]
    values: tuple["ParameterEstimate", ...]
    rotors: Mapping[str, float] = field(default_factory=dict)
    springs: tuple["Elasticity", ...] = ()
    missing: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()


@click.command("export")
@click.argument("robot")
@click.argument("estimate", type=click.Path(path_type=Path))
@output_option("Robot file to write, .toml.", required=True)
@force_option
@verb
def command(console: Console, *, robot: str, estimate: Path, output: Path, force: bool) -> Answer:
    """Write ROBOT with the values in ESTIMATE as a robot file, for generate and simulate.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to
    those of the robot file are taken, and only bodies that can exist. Springs are written as found.
    A result of --rows friction gives its laws to the joints, where robot files have a model of them.
    """
    if output.suffix.lower() != ".toml":
        text = f"{output}: a robot file is TOML; give a name that ends in .toml"
        raise UsageError(Notice(code="usage.suffix", text=text))
    from symid.friction.results import is_friction_result

    if is_friction_result(estimate):
        check_output(output, force=force, inputs=(load_robot(robot).path, estimate))
        return export_friction(console, robot, estimate, output)
    found = find_identified(robot, estimate)
    described = found.robot
    check_output(output, force=force, inputs=(described.path, estimate))
    console.progress(f"looking for bodies with the identified values of {described.name}")
    identified = write_identified(found, estimate, output)
    standard = identified.standard
    warnings = (
        *described.notices,
        *found.notices,
        *_warn(identified, found, estimate),
        *_name_missing(found, estimate),
    )
    result = {
        "file": output,
        "robot": described.name,
        "elastic": any(identified.robot.elastic),
        "outcome": standard.outcome.name.lower(),
        "largest_change": max(map(abs, standard.residual.tolist()), default=0.0),
        "blamed": standard.blamed,
        "not_identified": found.missing,
    }
    text = f"robot file: {show_path(output)}\n{standard.outcome.value}"
    return Answer(text=text, result=result, warnings=warnings)


def find_identified(name: str, path: Path) -> Identified:
    """Return what the estimate at `path`, rigid or elastic, says of the robot called `name`.

    Raises:
        EstimateError: the file cannot be read, or is of another model.
    """
    from symid.elastic.storage import is_elastic_estimate

    return _read_elastic(name, path) if is_elastic_estimate(path) else _read_rigid(name, path)


def write_identified(found: Identified, path: Path, output: Path) -> "IdentifiedRobot":
    """Write the robot file `output` with the values found in the estimate at `path`, and return the robot.

    Raises:
        EstimateError: its values are none that a robot file can have.
        OutputError: the file cannot be written.
    """
    from symid.identification.storage import write_file

    identified = _build(found)
    write_file(output, _write(identified.robot, found, path))
    return identified


def _read_rigid(name: str, path: Path) -> Identified:
    """Return what an estimate of a rigid model says; of an elastic robot that is its rigid variant.

    Raises:
        EstimateError: the estimate is of another model.
    """
    from symid.codegen.model_card import build_model_card
    from symid.elastic.motor_side import build_rigid_estimate, build_rigid_variant
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model
    from symid.parameters.base import find_base_parameters

    read = read_estimate(path)
    described = load_robot_of_estimate(name, read, ())
    found = build_rigid_estimate(read, described)
    robot = build_rigid_variant(described)
    base = find_base_parameters(robot)
    check_model(found, build_model_card(robot, base, ()), str(path))
    notices: tuple[Notice, ...] = ()
    if any(described.elastic):
        text = (
            "the joints were identified as rigid, and the file has them so: rotors turn with their links, "
            "and the springs of the robot file are left out, because with them these values are not true"
        )
        notices = (Notice(code="export.rigid-variant", text=text, file=str(path)),)
    return Identified(
        robot=robot,
        base=base,
        sources=found.sources,
        values=found.parameters,
        missing=_find_missing(base, found.parameters),
        notices=notices,
    )


def _read_elastic(name: str, path: Path) -> Identified:
    """Return what an estimate of elastic joints says; what it refuses has no value.

    Raises:
        EstimateError: the estimate is of another model.
    """
    from symid.codegen.model_card import build_model_card
    from symid.elastic.storage import read_elastic_estimate
    from symid.parameters.base import find_base_parameters
    from symid.robot.elasticity import Elasticity

    robot = load_robot_of_estimate(name, read_elastic_estimate(path), ())
    base = find_base_parameters(robot)
    found = read_elastic_estimate(path, build_model_card(robot, base, ()))
    refused = {entry for entry, _ in found.refused}
    known = [entry for entry in found.parameters if entry.name not in refused]
    names = {entry.name for entry in (*base.parameters, *base.friction)}
    values = tuple(entry for entry in known if entry.name in names)
    rotors = tuple(entry.name for entry in found.parameters if entry.name not in names)
    own = [robot.joints[index].elasticity for index in robot.coordinates]
    springs = (
        tuple(
            entry.elasticity if entry.told else stated or Elasticity()
            for entry, stated in zip(found.springs, own, strict=True)
        )
        if found.springs
        else ()
    )
    lacking = [entry.joint for entry in found.springs if not entry.told]
    if not found.springs:
        lacking = [entry.joint for entry in found.residual]
    return Identified(
        robot=robot,
        base=base,
        sources=found.sources,
        values=values,
        rotors={entry.name: entry.value for entry in known if entry.name not in names},
        springs=springs,
        missing=(
            *_find_missing(base, values),
            *(entry for entry in rotors if entry in refused),
            *(f"the spring of {joint!r}" for joint in lacking),
        ),
        notices=_name_refused(found, path),
    )


def _name_refused(found: "ElasticEstimate", path: Path) -> tuple[Notice, ...]:
    """Return why springs are refused: the robot file's own are written, known or not."""
    return tuple(
        Notice(
            code="export.spring",
            text=f"the spring that was found for {entry.joint!r} is not written: {entry.reason}",
            file=str(path),
        )
        for entry in found.springs
        if not entry.told
    )


def _find_missing(base: "BaseParameters", values: Sequence["ParameterEstimate"]) -> tuple[str, ...]:
    known = {entry.name for entry in values}
    return tuple(entry.name for entry in (*base.parameters, *base.friction) if entry.name not in known)


def _build(found: Identified) -> "IdentifiedRobot":
    """Return the robot with the estimate's values."""
    from symid.parameters.identified_robot import build_identified_robot

    # Some methods give no deviations; those of some values alone would not tell how to weigh the others.
    deviations = {entry.name: entry.std for entry in found.values if 0.0 < entry.std < math.inf}
    return build_identified_robot(
        found.robot,
        found.base,
        {entry.name: entry.value for entry in found.values},
        deviations=deviations if len(deviations) == len(found.values) else None,
        rotors=found.rotors,
        elasticity=found.springs,
    )


def _write(robot: "Robot", found: Identified, path: Path) -> str:
    """Return the text of the robot file, which can be read.

    Raises:
        EstimateError: its values are none that a robot file can have.
    """
    from symid.formats.toml import parse_robot
    from symid.formats.writer import write_robot

    names = ", ".join(Path(source).name for source in found.sources)
    before = f"; before: {robot.source}" if robot.source else ""
    text = write_robot(
        replace(robot, source=f"Values identified from {names}{before}"),
        comment=f"{robot.name} with values identified from {names}.",
    )
    try:
        parse_robot(text)
    except RobotError as error:
        reasons = "; ".join(notice.text for notice in error.notices)
        said = f"no robot file can have these values: {reasons}; identify from logs that tell more"
        raise EstimateError(Notice(code="export.impossible", text=said, file=str(path))) from error
    return text


def _warn(identified: "IdentifiedRobot", found: Identified, path: Path) -> tuple[Notice, ...]:
    standard = identified.standard
    reason = standard.reason
    known = {entry.name: entry.std for entry in found.values if 0.0 < entry.std < math.inf}
    if not reason:
        return ()
    # Of values without a deviation nothing can be said.
    moved = [
        abs(change) / known[name]
        for name, change in zip(standard.names, standard.residual.tolist(), strict=True)
        if name in known
    ]
    far = f", at most {max(moved):.2g} standard deviations away" if moved else ""
    text = f"no bodies have the identified values exactly, the nearest were written{far}: {reason}"
    return (Notice(code="export.inconsistent", text=text, file=str(path)),)


def _name_missing(found: Identified, path: Path) -> tuple[Notice, ...]:
    if not found.missing:
        return ()
    names = ", ".join(found.missing)
    text = f"not identified, so the robot file's own values or the nearest bodies stand: {names}"
    return (Notice(code="export.not-identified", text=text, file=str(path)),)
