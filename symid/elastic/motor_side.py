"""Elastic robots whose logs have one position a joint: what the motor side alone can tell, and what not.

Input: an elastic robot, recordings. Output: the robot without its elasticity; an `Estimate` with reasons.

Without the link's position, q is taken as theta: torsion changes gravity and inertia by its own size only,
10^-2 and less. The rotor then turns with the link, and its inertia is a part of the base parameters again.

Supported: the rigid model with rotors merged, by any rows and estimator.
Not supported: stiffness, hysteresis, and rotor and link inertia apart; each is refused with its reason.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symid.data.recording import Recording
from symid.errors import LogError, Notice
from symid.estimators.estimate import Estimate, Outcome, ParameterEstimate
from symid.robot.description import Robot

__all__ = [
    "build_motor_recording",
    "build_rigid_estimate",
    "build_rigid_variant",
    "check_motor_side",
    "find_unseen",
    "has_both_encoders",
    "refuse_elasticity",
    "warn_of_rotors",
]

_STIFFNESS = (
    "the log has one position a joint, so that its torsion is not seen; free motion shows a spring only at "
    "the second order, and loops of torque over position are those of friction as well: measure the link's "
    "position, lock the link, or load it statically"
)
_HYSTERESIS = "it is a loop of torque over torsion, and the torsion is not seen in this log"
_SPLIT = (
    "torsional motion tells rotor and link apart, and is not seen in this log: where the rigid model lists a "
    "rotor inertia, the torsion that it does not know biases it against the link's, and their sum is what "
    "holds; take the rotor's from the data sheet, or measure the link's position"
)
_LINK_NAME = re.compile(r"link_position_?\d*")
_ROTOR_NAME = re.compile(r"IA\d+")
_MIXED = (
    "the methods for springs and hysteresis need a robot whose joints are all elastic, and this one has "
    "rigid joints besides; --method stiffness looks at its springs"
)


def build_rigid_variant(robot: Robot) -> Robot:
    """Return the robot with all joints rigid: rotors turn with their links."""
    return replace(robot, joints=tuple(replace(joint, elasticity=None) for joint in robot.joints))


def build_rigid_estimate(estimate: Estimate, robot: Robot) -> Estimate:
    """Return an estimate of the rigid variant without its refusals of what only `robot` has."""
    unseen = {name for name, _ in find_unseen(robot)}
    return replace(estimate, refused=tuple(entry for entry in estimate.refused if entry[0] not in unseen))


def build_motor_recording(recording: Recording, robot: Robot) -> Recording:
    """Return a recording as the motor side alone has it, for the rigid variant of an elastic robot.

    Friction and rotors turn with the motors, gravity with the links: the position of the motors is right for
    the former, and wrong by the torsion for the latter. That of the links would be wrong by the speed of the
    torsion wherever friction changes its sign.
    """
    if not any(robot.elastic) or recording.motor_position is None:
        return recording
    # A rigid joint has one position, whichever encoder saw it; a channel that never moves is no encoder.
    taken = np.array(robot.elastic) & (np.ptp(recording.motor_position, axis=0) > 0.0)
    text = (
        "the log has two positions a joint: that of the motor was taken for elastic joints, because friction "
        "and rotors turn with it; gravity is wrong by the torsion"
    )
    return replace(
        recording,
        position=np.where(taken, recording.motor_position, recording.position),
        velocity=None,
        motor_position=None,
        notices=(
            *recording.notices,
            Notice(code="log.motor-position", text=text, file=recording.source),
        ),
    )


def check_motor_side(robot: Robot, recordings: Sequence[Recording]) -> None:
    """Refuse logs whose one position is that of the links by the name of its columns.

    Raises:
        LogError: it is.
    """
    position, link = robot.log.position, robot.log.link_position
    columns = () if position is None else position.columns
    known = () if link is None else link.columns
    if not columns or not all(name in known or _LINK_NAME.fullmatch(name) for name in columns):
        return
    text = (
        f"its one position ({', '.join(columns)}) is that of the links, and the motor side of elastic joints "
        "cannot be identified from it: friction and rotors turn with the motors; name the columns of the "
        "motors in [log.motor_position], or in [log.position] alone"
    )
    raise LogError(*(Notice(code="elastic.link-side", text=text, file=entry.source) for entry in recordings))


def warn_of_rotors(parameters: Sequence[ParameterEstimate]) -> tuple[Notice, ...]:
    """Return a warning where rotor inertias are negative, which no motor has."""
    names = [entry.name for entry in parameters if _ROTOR_NAME.fullmatch(entry.name) and entry.value < 0.0]
    if not names:
        return ()
    text = (
        f"negative rotor inertia, which no motor has: {', '.join(names)}; the position taken for that of the "
        "motors may be that of the links, the sign or factor of the torque may be wrong, or the motions are "
        "too slow to tell rotors from links: check the log's columns, or take the inertia from the data sheet"
    )
    return (Notice(code="elastic.negative-rotor", text=text),)


def has_both_encoders(recordings: Sequence[Recording]) -> bool:
    """Return whether every recording has the positions of motors and of links."""
    return all(
        recording.motor_position is not None or recording.link_position is not None
        for recording in recordings
    )


def find_unseen(robot: Robot, *, both: bool = False) -> tuple[tuple[str, str], ...]:
    """Return name and reason of what is not identified of an elastic robot.

    Args:
        robot: with elastic joints.
        both: whether the logs have both positions, so that only the robot's rigid joints stand in the way.
    """
    refused: list[tuple[str, str]] = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.elasticity is None:
            continue
        reasons = (_MIXED,) * 3 if both else (_STIFFNESS, _HYSTERESIS, _SPLIT)
        refused += [(f"stiffness{number}", reasons[0]), (f"hysteresis{number}", reasons[1])]
        if joint.drive.has_rotor:
            refused.append((f"IA{number} apart from the link", reasons[2]))
    return tuple(refused)


def refuse_elasticity(estimate: Estimate, robot: Robot, *, both: bool = False) -> Estimate:
    """Return the estimate of the rigid variant, what it cannot tell of `robot` refused; see `find_unseen`."""
    unseen = find_unseen(robot, both=both)
    why = (
        "some joints are rigid" if both else "the logs have one position a joint, taken as that of its motor"
    )
    text = (
        f"{why}: the rigid model was identified, with rotor inertias merged into the base parameters; "
        "stiffness and hysteresis are refused"
    )
    return replace(
        estimate,
        refused=(*estimate.refused, *unseen),
        outcome=Outcome.SOME_REFUSED,
        notices=(
            Notice(code="elastic.motor-side", text=text),
            *warn_of_rotors(estimate.parameters),
            *estimate.notices,
        ),
    )
