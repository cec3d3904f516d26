"""What `symid export` and `symid validate` do with friction that `identify --rows friction` found.

Input: the robot's name, the file of the result. Output: an answer; the robot file.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.inputs import load_robot, load_robot_library, load_robot_of_estimate, read_one_log, show_path
from symid.cli.output import Answer, Console, format_table
from symid.cli.tables import describe_validation
from symid.cli.validate_elastic import ElasticCall, find_missed_gate
from symid.errors import EstimateError, Notice, RobotError

if TYPE_CHECKING:  # these load numpy
    from symid.estimators.estimate import Validation
    from symid.friction.results import FrictionIdentification
    from symid.robot.description import FrictionValues, Robot

__all__ = ["export_friction", "validate_friction_result"]

_MISSED = 1


def export_friction(console: Console, name: str, path: Path, output: Path) -> Answer:
    """Write the robot called `name` with the friction in `path` to `output`, and return the answer.

    Friction that no robot file can have stays as the robot file has it, and a warning says why.

    Raises:
        EstimateError: the friction is of another model.
        OutputError: the file cannot be written.
    """
    from symid.friction.results import read_friction_result
    from symid.identification.storage import write_file

    found = read_friction_result(path)
    robot = load_robot(name)
    console.progress(f"comparing {robot.name} with the model whose friction was identified")
    _check_model(found, robot, path)
    written, kept = _find_written(found, robot)
    changed = replace(
        robot,
        joints=tuple(
            replace(joint, friction=written.get(joint.name, joint.friction)) for joint in robot.joints
        ),
        source=_name_source(found, robot),
    )
    text, read = _write_readable(changed, found, path)
    write_file(output, text)
    warnings = (
        *(replace(notice, file=str(output)) for notice in read.notices),
        *(
            Notice(
                code="export.friction-kept",
                text=f"joint {joint!r} keeps the friction of the robot file: {reason}",
                file=str(path),
            )
            for joint, reason in kept.items()
        ),
        *_warn_of_springs(robot, path),
    )
    laws = {entry.joint: entry.estimate.law for entry in found.joints}
    lines = [f"{joint}: {laws[joint]} as {values.kind.value}" for joint, values in written.items()]
    result = {
        "file": output,
        "robot": robot.name,
        "written": {joint: {"law": laws[joint], **_describe(values)} for joint, values in written.items()},
        "kept": kept,
    }
    return Answer(
        text="\n".join((f"robot file: {show_path(output)}", *lines)), result=result, warnings=warnings
    )


def validate_friction_result(console: Console, call: ElasticCall) -> Answer:
    """Return what identified friction, with its rigid part, explains of a log that was not fitted.

    Raises:
        EstimateError: the friction is of another model.
        IdentifiabilityError: nothing can be said of any joint.
    """
    from symid.elastic.motor_side import build_motor_recording, build_rigid_variant
    from symid.friction.results import read_friction_result
    from symid.friction.validation import check_friction_model, check_friction_robot, validate_friction

    found = read_friction_result(call.estimate)
    # The log map of another robot would only say that its columns do not fit.
    check_friction_robot(found, load_robot(call.robot).name, str(call.estimate))
    unfolded, notices = _unfold(found, call)
    robot = load_robot_of_estimate(call.robot, unfolded, call.pairs)
    read_log = read_one_log(call.log, robot, "a law of friction")
    recording = build_motor_recording(read_log, robot)
    library = load_robot_library(_set_friction(build_rigid_variant(robot), found), console)
    check_friction_model(found, library.card, str(call.estimate))
    console.progress(f"validating on {recording.source}")
    validation = validate_friction(found, library, recording, robot.processing)
    reached = validation.mean_relative_percent
    errors = find_missed_gate(reached, call.gate, recording.source)
    laws = {entry.joint: entry.estimate.law for entry in found.joints}
    head = f"{robot.name}, friction and rigid part on {recording.source}: "
    text = f"{head}mean relative residual {reached:.4f} %\n\n{_show(validation, laws)}"
    result = {**describe_validation(validation), "laws": laws, "gate": call.gate, "accepted": not errors}
    return Answer(
        text=text,
        result=result,
        warnings=(
            *robot.notices,
            *notices,
            *library.notices,
            *recording.notices,
            *validation.notices,
        ),
        errors=errors,
        exit_code=_MISSED if errors else 0,
    )


def _check_model(found: "FrictionIdentification", robot: "Robot", path: Path) -> None:
    """Check that friction was identified with this robot.

    Raises:
        EstimateError: with another one.
    """
    from symid.codegen.model_card import build_model_card
    from symid.elastic.motor_side import build_rigid_variant
    from symid.friction.validation import check_friction_model
    from symid.parameters.base import find_base_parameters

    variant = _set_friction(build_rigid_variant(robot), found)
    check_friction_model(found, build_model_card(variant, find_base_parameters(variant), ()), str(path))


def _set_friction(robot: "Robot", found: "FrictionIdentification") -> "Robot":
    """Return the robot with the friction model that `identify --friction` gave to all joints, if it did."""
    from symid.formats.overrides import override_robot
    from symid.robot.description import FrictionKind

    kinds = found.settings.get("friction")
    asked = set(kinds) if isinstance(kinds, Sequence) else set()
    own = {joint.friction.kind.value for joint in robot.axes}
    if len(asked) != 1 or asked == own or not asked <= {kind.value for kind in FrictionKind}:
        return robot
    return override_robot(robot, (), asked.pop())


def _find_written(
    found: "FrictionIdentification", robot: "Robot"
) -> tuple[dict[str, "FrictionValues"], dict[str, str]]:
    """Return what can be written, by joint, and for every other joint why its friction stays."""
    from symid.friction.robot_friction import build_robot_friction, find_obstacle

    written, kept = {}, dict(found.refused)
    for entry in found.joints:
        reason = find_obstacle(entry)
        if reason:
            kept[entry.joint] = reason
        else:
            written[entry.joint] = build_robot_friction(entry)
    order = [joint.name for joint in robot.axes]
    return written, {name: kept[name] for name in order if name in kept}


def _describe(values: "FrictionValues") -> dict[str, object]:
    from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES

    names = FRICTION_PARAMETERS[values.kind]
    shapes = [key.name for key in FRICTION_SHAPES.get(values.kind, ())]
    return {
        "model": values.kind.value,
        "values": dict(zip(names, values.values or (), strict=True)),
        "shape": dict(zip(shapes, values.shape, strict=True)),
        "smoothing": values.smoothing,
    }


def _name_source(found: "FrictionIdentification", robot: "Robot") -> str:
    before = f"; before: {robot.source}" if robot.source else ""
    return f"Friction identified from {_list_logs(found)}{before}"


def _list_logs(found: "FrictionIdentification") -> str:
    return ", ".join(Path(source).name for source in found.sources)


def _write_readable(robot: "Robot", found: "FrictionIdentification", path: Path) -> tuple[str, "Robot"]:
    """Return the text of the robot file, and the robot that it is read as.

    Raises:
        EstimateError: its values are none that a robot file can have.
    """
    from symid.formats.toml import parse_robot
    from symid.formats.writer import write_robot

    text = write_robot(robot, comment=f"{robot.name} with friction identified from {_list_logs(found)}.")
    try:
        return text, parse_robot(text)
    except RobotError as error:
        reasons = "; ".join(notice.text for notice in error.notices)
        said = f"no robot file can have these values: {reasons}; identify from logs that tell more"
        raise EstimateError(Notice(code="export.impossible", text=said, file=str(path))) from error


def _warn_of_springs(robot: "Robot", path: Path) -> tuple[Notice, ...]:
    if not any(robot.elastic):
        return ()
    text = (
        "friction was identified with rigid joints, so that what springs lose is counted in it; the file has "
        "the springs besides, and counts that twice where they lose energy"
    )
    return (Notice(code="export.friction-springs", text=text, file=str(path)),)


def _unfold(
    found: "FrictionIdentification", call: ElasticCall
) -> tuple["FrictionIdentification", tuple[Notice, ...]]:
    """Return the result for a log that is taken as it is: mean periods have cut ends of their own."""
    processing = found.settings.get("processing")
    folded = found.settings.get("period") or found.settings.get("periods")
    if not folded or not isinstance(processing, dict):
        return found, ()
    own = load_robot(call.robot).processing
    processing = {**processing, "drop_first": own.drop_first, "drop_last": own.drop_last}
    text = "friction was fitted to mean periods; this log is taken as it is, noise and all"
    return (
        replace(found, settings={**found.settings, "processing": processing}),
        (Notice(code="validate.not-folded", text=text, file=str(call.log)),),
    )


def _show(validation: "Validation", laws: dict[str, str]) -> str:
    rows = [
        [
            entry.joint,
            laws[entry.joint],
            f"{entry.relative_percent:.4f}",
            entry.std,
            entry.unit,
            entry.samples,
        ]
        for entry in validation.residual
    ]
    return format_table(("joint", "law", "relative/%", "RMS", "unit", "rows"), rows, left=(0, 1, 4))
