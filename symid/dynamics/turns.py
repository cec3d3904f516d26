"""Constant turns about joint axes, moved from placements into the joints' angles.

Input: a robot. Output: the angle of the constant turn of every joint that has one, and the robot without.

A placement Rx(alpha) Rz(theta) is followed by the joint's own turn Rz(q): together they are
Rx(alpha) Rz(q + theta). Written so, the constant turn costs one sum in place of a rotation of every
vector that passes the joint.

Supported: revolute joints, those that follow another included. Quarter turns stay: they cost nothing.
Not supported: placements whose x axis is no common normal; they stay as they are.
"""

import math
from collections.abc import Collection
from dataclasses import replace

from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import ONE, ZERO

__all__ = ["find_turns", "remove_turns"]


def find_turns(robot: Robot) -> dict[int, float]:
    """Return the angle (rad) of every joint's constant turn, where it is no multiple of pi/2."""
    turns = {}
    for index, joint in enumerate(robot.joints):
        c, minus_s, across = joint.placement.rotation[0]
        if joint.kind is JointKind.REVOLUTE and c and minus_s and not across:
            turns[index] = math.atan2(-minus_s.to_float(), c.to_float())
    return turns


def _straighten(joint: Joint) -> Joint:
    """Return the joint with Rx(alpha) in place of Rx(alpha) Rz(theta), whose z axis is (0, -sin, cos)."""
    _, minus_s, c = (row[2] for row in joint.placement.rotation)
    rotation = ((ONE, ZERO, ZERO), (ZERO, c, minus_s), (ZERO, -minus_s, c))
    return replace(joint, placement=replace(joint.placement, rotation=rotation))


def remove_turns(robot: Robot, links: Collection[int]) -> Robot:
    """Return the robot without the constant turns of `links`; their joints' angles start there."""
    joints = tuple(
        _straighten(joint) if index in links else joint for index, joint in enumerate(robot.joints)
    )
    return replace(robot, joints=joints)
