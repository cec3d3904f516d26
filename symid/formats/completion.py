"""What neither a URDF nor a table of rows says of a robot, put beside it.

Input: a robot, values of a call. Output: the robot with friction, rotors, gears, torque constants.

Supported: one model of friction for all joints, its values unknown; rotors of unknown inertia; a gear and a
torque constant for each joint that follows no other.
Not supported: values that contradict the source; correct the source.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from symid.errors import Notice, UsageError
from symid.formats.overrides import override_robot
from symid.robot.description import Drive, Robot

__all__ = ["Completion", "complete_robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """What is added to a robot.

    Args:
        friction: the name of a model for all joints, None to leave them.
        rotors: whether every drive gets a rotor of unknown inertia, where none is stated.
        gears: motor turns per joint turn, one for each joint or one for all; none to leave them.
        constants: N m/A on the motor's side, likewise.
    """

    friction: str | None = None
    rotors: bool = False
    gears: tuple[float, ...] = ()
    constants: tuple[float, ...] = ()


def complete_robot(robot: Robot, added: Completion) -> Robot:
    """Return `robot` with what is added.

    Raises:
        UsageError: numbers for more or fewer joints than there are, or a gear that the source contradicts.
    """
    texts = list(_find_mistakes(robot, added))
    if texts:
        raise UsageError(*(Notice(code="usage.completion", text=text) for text in texts))
    drives = {
        joint.name: _complete_drive(joint.drive, added, index) for index, joint in enumerate(robot.axes)
    }
    joints = tuple(replace(joint, drive=drives.get(joint.name, joint.drive)) for joint in robot.joints)
    completed = replace(robot, joints=joints)
    return override_robot(completed, (), added.friction) if added.friction else completed


def _find_mistakes(robot: Robot, added: Completion) -> Iterator[str]:
    names = ", ".join(joint.name for joint in robot.axes)
    given: Mapping[str, tuple[float, ...]] = {"--gear": added.gears, "--torque-constant": added.constants}
    for option, values in given.items():
        if len(values) not in (0, 1, robot.freedom):
            text = f"{option}: {len(values)} numbers for {robot.freedom} joints ({names})"
            yield f"{text}; give one for each, with commas between, or one for all"
    for index, joint in enumerate(robot.axes):
        gear = _pick(added.gears, index)
        if gear is not None and joint.drive.gear not in (1.0, gear):
            text = (
                f"--gear: joint {joint.name!r} has the gear {joint.drive.gear:g} in its source, not {gear:g}"
            )
            yield f"{text}; leave the option out, or correct the source"
        elif gear not in (None, joint.drive.gear) and joint.drive.rotor_inertia is not None:
            text = f"--gear: joint {joint.name!r} has a rotor inertia in its source, but no gear"
            yield f"{text}; state the gear in the source"


def _pick(values: tuple[float, ...], index: int) -> float | None:
    """Return the value of a joint, None where there is none or too few."""
    if len(values) == 1:
        return values[0]
    return values[index] if index < len(values) else None


def _complete_drive(drive: Drive, added: Completion, index: int) -> Drive:
    gear, constant = _pick(added.gears, index), _pick(added.constants, index)
    return replace(
        drive,
        gear=drive.gear if gear is None else gear,
        torque_constant=drive.torque_constant if constant is None else constant,
        has_rotor=drive.has_rotor or added.rotors,
    )
