"""Link frames chosen for fewer operations: rotation of placements, origins, axes of last links.

Robot, or recursion and parameters -> the same robot written otherwise; all torques stay the same.

Constant rotations: a placement Rx(alpha) Rz(theta) is followed by the joint's own rotation Rz(q); together
they are Rx(alpha) Rz(q + theta). The constant then costs one sum in place of a rotation of every vector
that passes the joint.
Origins: the origin of a link may stand anywhere on its joint's axis. A link that carries no other is best
described about the point next to its parent's origin. The first offset of an arm is best moved beyond the
joint it belongs to: then no force of the links before it is ever needed. Parameters follow by Huygens and
Steiner.
Last links: a link that carries no other is described in the axes its frame has at q = 0, and its parameters
rotate instead. It has the angular velocity of its parent but for its own joint's rate: products of
velocities are shared, and neither velocities, accelerations, forces nor moments are rotated on their way.
In a planar arm, whose acceleration tensors do not change with the axes, this saves most.

Supported: trees; revolute joints, those that follow another included; prismatic joints stay as they are.
Not supported: constant rotations by quarter turns, which cost nothing, and placements whose x axis is no
common normal; they stay as they are.
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


def _remove_rotation(joint: Joint) -> Joint:
    """Return the joint with Rx(alpha) in place of Rx(alpha) Rz(theta), whose z axis is (0, -sin, cos)."""
    _, minus_s, c = (row[2] for row in joint.placement.rotation)
    rotation = ((ONE, ZERO, ZERO), (ZERO, c, minus_s), (ZERO, -minus_s, c))
    return replace(joint, placement=replace(joint.placement, rotation=rotation))


def remove_constant_rotations(robot: Robot, links: Collection[int]) -> Robot:
    """Return the robot without the constant turns of `links`; their joints' angles start there."""
    joints = tuple(
        _remove_rotation(joint) if index in links else joint for index, joint in enumerate(robot.joints)
    )
    return replace(robot, joints=joints)


def _compute_axial_offset(joint: Joint) -> Exact:
    """Return how far the link's origin stands from its parent's along the joint's axis."""
    placement, total = joint.placement, ZERO
    for row, length in zip(placement.rotation, placement.translation, strict=True):
        total = total + row[2] * length
    return total


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
        axial = _compute_axial_offset(joint)
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


def _rotate_parameters(
    algebra: Algebra[T], turn: tuple[T, T], parameters: Parameters[T], link: int
) -> dict[tuple[int, str], T]:
    """Return the parameters of a link in axes turned back by its joint's angle."""
    tensor, (x, y, _), _ = gather_body(algebra, parameters, link)
    (xx, xy, xz), (_, yy, yz), _ = rotate_tensor_about_z(algebra, turn, tensor)
    c, s = turn
    plus, minus, mul = algebra.add, algebra.sub, algebra.mul
    values = {"XX": xx, "XY": xy, "XZ": xz, "YY": yy, "YZ": yz}
    values |= {"MX": minus(mul(c, x), mul(s, y)), "MY": plus(mul(s, x), mul(c, y))}
    return {(link, name): value for name, value in values.items()}


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
            turned |= _rotate_parameters(algebra, frame.turn, parameters, link)
    held = tuple(frames)
    motions = compute_motions(robot, algebra, held, recursion.state.velocity)
    return replace(recursion, frames=held, motions=motions), turned
