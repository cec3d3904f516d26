"""Link frames chosen for fewer operations; all torques stay the same.

Robot, or recursion and parameters -> the same, written otherwise.

Constant rotations: Rx(alpha) Rz(theta) before the joint's own Rz(q) becomes Rx(alpha) Rz(q + theta). Origins
move along the joint's axis, next to the parent's origin, or beyond the first joint of an arm. A link that
carries no other is described in the axes its frame has at q = 0.

Supported: trees; revolute joints, those that follow another included; prismatic joints stay as they are.
Not supported: constant rotations by quarter turns, and placements whose x axis is no common normal.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from symid.dynamics.algebra import Algebra, T
from symid.dynamics.bodies import Parameters, gather_body, rotate_tensor_about_z
from symid.dynamics.recursion import Recursion, compute_motions
from symid.robot import ONE, ZERO, Exact, Joint, JointKind, Robot


def list_constant_rotations(robot: Robot) -> dict[int, float]:
    """Return the angle (rad) of every joint's constant turn, where it is no multiple of pi/2."""
    turns = {}
    for index, joint in enumerate(robot.joints):
        c, minus_s, across = joint.placement.rotation[0]
        if joint.kind is JointKind.REVOLUTE and c and minus_s and not across:
            turns[index] = math.atan2(-minus_s.to_float(), c.to_float())
    return turns


def remove_constant_rotations(robot: Robot, links: Collection[int]) -> Robot:
    """Return the robot without the constant turns of `links`; their joints' angles start there."""
    joints = list(robot.joints)
    for link in links:
        placement = joints[link].placement
        # The z axis of Rx(alpha) Rz(theta) is (0, -sin(alpha), cos(alpha)).
        _, minus_s, c = (row[2] for row in placement.rotation)
        rotation = ((ONE, ZERO, ZERO), (ZERO, c, minus_s), (ZERO, -minus_s, c))
        joints[link] = replace(joints[link], placement=replace(placement, rotation=rotation))
    return replace(robot, joints=tuple(joints))


def _move_origin(joint: Joint, step: Exact) -> Joint:
    """Return the joint with its origin moved by `step` along its axis."""
    placement = joint.placement
    lengths = zip(placement.rotation, placement.translation, strict=True)
    x, y, z = (length + row[2] * step for row, length in lengths)
    return replace(joint, placement=replace(placement, translation=(x, y, z)))


def _is_level(robot: Robot, link: int) -> bool:
    """Return whether all origins from the first link of the branch up to `link` coincide."""
    while robot.joints[link].parent >= 0:
        joint = robot.joints[link]
        if joint.kind is not JointKind.REVOLUTE or any(joint.placement.translation):
            return False
        link = joint.parent
    return True


def choose_origin_shifts(robot: Robot) -> dict[int, Exact]:
    """Return by how much which origins are moved back along their joint's axis, in m."""
    parents = {joint.parent for joint in robot.joints}
    shifts: dict[int, Exact] = {}
    for link, joint in enumerate(robot.joints):
        # Distance of the link's origin from its parent's along the joint's axis.
        placement, axial = joint.placement, ZERO
        for row, length in zip(placement.rotation, placement.translation, strict=True):
            axial = axial + row[2] * length
        if joint.parent < 0 or joint.kind is not JointKind.REVOLUTE or not axial:
            continue
        bare = not any(_move_origin(joint, -axial).placement.translation)
        if link not in parents or (bare and _is_level(robot, joint.parent)):
            shifts[link] = axial
    return shifts


def shift_origins(robot: Robot, shifts: Mapping[int, Exact]) -> Robot:
    """Return the robot whose link origins are moved back along their joint's axis by `shifts`."""
    joints = []
    for link, joint in enumerate(robot.joints):
        moved = _move_origin(joint, -shifts[link]) if link in shifts else joint
        if joint.parent in shifts:
            x, y, z = moved.placement.translation
            placement = replace(moved.placement, translation=(x, y, z + shifts[joint.parent]))
            moved = replace(moved, placement=placement)
        joints.append(moved)
    return replace(robot, joints=tuple(joints))


def shift_parameters(
    algebra: Algebra[T], parameters: Parameters[T], shifts: Mapping[int, Exact]
) -> Parameters[T]:
    """Return the parameters about the origins that `shifts` moves back (Huygens and Steiner).

    XX + 2 d MZ + d^2 M, YY likewise;  XZ - d MX, YZ - d MY;  MZ + d M.
    """
    moved = dict(parameters)
    plus, mul = algebra.add, algebra.mul
    for link, step in shifts.items():
        d = algebra.constant(step)
        mx, my, mz, mass = (parameters.get((link, name), algebra.zero) for name in ("MX", "MY", "MZ", "M"))
        bend = mul(d, plus(plus(mz, mz), mul(d, mass)))
        added = {"XX": bend, "YY": bend, "XZ": algebra.neg(mul(d, mx)), "YZ": algebra.neg(mul(d, my))}
        for name, value in {**added, "MZ": mul(d, mass)}.items():
            moved[link, name] = plus(parameters.get((link, name), algebra.zero), value)
    return moved


def fix_last_link_axes(
    recursion: Recursion[T], parameters: Parameters[T]
) -> tuple[Recursion[T], Parameters[T]]:
    """Return the recursion and the parameters with the axes of last links held; links on the base stay."""
    robot, algebra = recursion.robot, recursion.algebra
    parents = {joint.parent for joint in robot.joints}
    frames, turned = list(recursion.frames), dict(parameters)
    for link, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        if link not in parents and joint.parent >= 0 and frame.turn is not None:
            frames[link] = replace(frame, turn=None)
            tensor, (x, y, _), _ = gather_body(algebra, parameters, link)
            (xx, xy, xz), (_, yy, yz), _ = rotate_tensor_about_z(algebra, frame.turn, tensor)
            c, s = frame.turn
            values = {"XX": xx, "XY": xy, "XZ": xz, "YY": yy, "YZ": yz}
            values["MX"] = algebra.sub(algebra.mul(c, x), algebra.mul(s, y))
            values["MY"] = algebra.add(algebra.mul(s, x), algebra.mul(c, y))
            turned |= {(link, name): value for name, value in values.items()}
    held = tuple(frames)
    motions = compute_motions(robot, algebra, held, recursion.state.velocity)
    return replace(recursion, frames=held, motions=motions), turned
