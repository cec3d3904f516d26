"""Link origins moved along their own joint axes, where that saves operations.

Input: a robot. Output: the same robot with other origins, and the parameters about them.

The origin of a link may stand anywhere on its joint's axis. A link that carries no other is best
described about the point next to its parent's origin. The first offset of an arm is best moved beyond
the joint it belongs to: then no force of the links before it is ever needed.

Supported: trees; revolute joints are moved, prismatic ones stay.
"""

from collections.abc import Mapping
from dataclasses import replace

from symid.algebra.scalar import Algebra, T
from symid.dynamics.composite import Parameters
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import ZERO, Exact

__all__ = ["find_shifts", "shift_origins", "shift_parameters"]


def _find_axial(joint: Joint) -> Exact:
    """Return how far the link's origin stands from its parent's along the joint's axis."""
    placement, total = joint.placement, ZERO
    for row, length in zip(placement.rotation, placement.translation, strict=True):
        total = total + row[2] * length
    return total


def _move(joint: Joint, step: Exact) -> Joint:
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


def find_shifts(robot: Robot) -> dict[int, Exact]:
    """Return by how much which origins are moved back along their joint's axis, in m."""
    parents = {joint.parent for joint in robot.joints}
    shifts: dict[int, Exact] = {}
    for link, joint in enumerate(robot.joints):
        axial = _find_axial(joint)
        if joint.parent < 0 or joint.kind is not JointKind.REVOLUTE or not axial:
            continue
        bare = not any(_move(joint, -axial).placement.translation)
        if link not in parents or (bare and _is_level(robot, joint.parent)):
            shifts[link] = axial
    return shifts


def shift_origins(robot: Robot, shifts: Mapping[int, Exact]) -> Robot:
    """Return the robot whose link origins are moved back along their joint's axis by `shifts`."""
    joints = []
    for link, joint in enumerate(robot.joints):
        moved = _move(joint, -shifts[link]) if link in shifts else joint
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
