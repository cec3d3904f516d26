"""A robot file with the friction that was identified by itself.

Input: a robot, a result of friction. Output: a robot file, and `FileExport`.

Supported: laws of which robot files have a model. Friction of other joints stays as the robot file has it.
"""

from dataclasses import replace
from pathlib import Path

from symid.codegen.model_card import build_model_card
from symid.elastic.motor_side import build_rigid_variant
from symid.errors import EstimateError, Notice, RobotError
from symid.formats.toml import parse_robot
from symid.formats.writer import write_robot
from symid.friction.results import FrictionIdentification
from symid.friction.robot_friction import build_robot_friction, find_obstacle, set_identified_friction
from symid.friction.validation import check_friction_model
from symid.identification.storage import write_file
from symid.parameters.base import find_base_parameters
from symid.robot.description import FrictionValues, Robot
from symid.tasks.export import FileExport, WrittenFriction, check_format

__all__ = ["write_friction"]


def write_friction(robot: Robot, found: FrictionIdentification, source: Path, path: Path) -> FileExport:
    """Write the robot file with the friction that was identified.

    Friction that no robot file can have stays as the robot file has it, and a notice says why.

    Args:
        robot: as its file says.
        found: its friction.
        source: where the result is from, for messages.
        path: of the robot file, whose name ends in .toml.

    Raises:
        UsageError: it is no robot file.
        EstimateError: the friction is of another model, or none that a robot file can have.
        OutputError: the file cannot be written.
    """
    check_format(path, friction=True)
    _check_model(found, robot, source)
    written, kept = _find_written(found, robot)
    changed = replace(
        robot,
        joints=tuple(
            replace(joint, friction=written.get(joint.name, joint.friction)) for joint in robot.joints
        ),
        source=_name_source(found, robot),
    )
    text, read = _write_readable(changed, found, source)
    write_file(path, text)
    laws = {entry.joint: entry.estimate.law for entry in found.joints}
    return FileExport(
        file=path,
        robot=changed,
        outcome="friction",
        friction=WrittenFriction(laws=laws, values=written, kept=kept),
        notices=(
            *(replace(notice, file=str(path)) for notice in read.notices),
            *(
                Notice(
                    code="export.friction-kept",
                    text=f"joint {joint!r} keeps the friction of the robot file: {reason}",
                    file=str(source),
                )
                for joint, reason in kept.items()
            ),
            *_warn_of_springs(robot, source),
        ),
    )


def _check_model(found: FrictionIdentification, robot: Robot, source: Path) -> None:
    """Check that friction was identified with this robot.

    Raises:
        EstimateError: with another one.
    """
    variant = set_identified_friction(build_rigid_variant(robot), found)
    check_friction_model(found, build_model_card(variant, find_base_parameters(variant), ()), str(source))


def _find_written(
    found: FrictionIdentification, robot: Robot
) -> tuple[dict[str, FrictionValues], dict[str, str]]:
    """Return what can be written, by joint, and for every other joint why its friction stays."""
    written, kept = {}, dict(found.refused)
    for entry in found.joints:
        reason = find_obstacle(entry)
        if reason:
            kept[entry.joint] = reason
        else:
            written[entry.joint] = build_robot_friction(entry)
    order = [joint.name for joint in robot.axes]
    return written, {name: kept[name] for name in order if name in kept}


def _name_source(found: FrictionIdentification, robot: Robot) -> str:
    before = f"; before: {robot.source}" if robot.source else ""
    return f"Friction identified from {_list_logs(found)}{before}"


def _list_logs(found: FrictionIdentification) -> str:
    return ", ".join(Path(source).name for source in found.sources)


def _write_readable(robot: Robot, found: FrictionIdentification, source: Path) -> tuple[str, Robot]:
    """Return the text of the robot file, and the robot that it is read as.

    Raises:
        EstimateError: its values are none that a robot file can have.
    """
    text = write_robot(robot, comment=f"{robot.name} with friction identified from {_list_logs(found)}.")
    try:
        return text, parse_robot(text)
    except RobotError as error:
        reasons = "; ".join(notice.text for notice in error.notices)
        said = f"no robot file can have these values: {reasons}; identify from logs that tell more"
        raise EstimateError(Notice(code="export.impossible", text=said, file=str(source))) from error


def _warn_of_springs(robot: Robot, source: Path) -> tuple[Notice, ...]:
    if not any(robot.elastic):
        return ()
    text = (
        "friction was identified with rigid joints, so that what springs lose is counted in it; the file has "
        "the springs besides, and counts that twice where they lose energy"
    )
    return (Notice(code="export.friction-springs", text=text, file=str(source)),)
