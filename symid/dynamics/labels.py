"""Labels of parameters: how they are written, what they belong to, in which unit they are.

Input: a robot, a label (index, name); indices of couplings follow those of the joints.
Output: texts. A parameter of joint 2 ends in 2, one of a coupling in the coupling's name.

Supported: link, drive, spring and friction parameters.
"""

from symid.notation import find_unit
from symid.robot.description import JointKind, Robot

__all__ = ["Label", "find_label_unit", "find_owner", "is_prismatic", "write_label"]

Label = tuple[int, str]
"""A standard parameter: index of its joint or coupling, name."""


def find_owner(robot: Robot, label: Label) -> str:
    """Return the name of the joint or coupling that a parameter belongs to."""
    index = label[0]
    return robot.joints[index].name if index < robot.size else robot.couplings[index - robot.size].name


def write_label(robot: Robot, label: Label, *, grouped: bool = False) -> str:
    """Return the parameter as text, for example ZZ2, ZZR2 for the head of a group, IAm6."""
    index, name = label
    end = str(index + 1) if index < robot.size else robot.couplings[index - robot.size].name
    return f"{name}{'R' if grouped else ''}{end}"


def find_label_unit(robot: Robot, label: Label) -> str:
    """Return the SI unit of a parameter."""
    return find_unit(label[1], prismatic=is_prismatic(robot, label[0]))


def is_prismatic(robot: Robot, index: int) -> bool:
    """Return whether a joint slides, or a coupling turns with slides alone."""
    if index < robot.size:
        return robot.joints[index].kind is JointKind.PRISMATIC
    terms = robot.couplings[index - robot.size].terms
    return all(robot.joints[joint].kind is JointKind.PRISMATIC for joint, _ in terms)
