"""Screws of joints and wrenches of links: how forces per parameter reach the joints.

Recursion -> `Screw`, the velocity of a link per unit of a joint's rate, or the change of that velocity per
unit of the joint's coordinate. Motion of a link -> `Wrench` per unit of one parameter, and its projection
on the joint axes: columns of torque-like regressors. A screw goes from its joint up the tree, a wrench from
its link down; in a common frame their product is the torque of the joint.

Supported: trees of revolute and prismatic joints.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic

from symid.dynamics.algebra import Algebra, T, Vector
from symid.dynamics.recursion import LinkFrame, LinkMotion, Recursion, rotate_to_link, rotate_to_parent
from symid.notation import INERTIAL


@dataclass(frozen=True, slots=True, kw_only=True)
class Screw(Generic[T]):
    """Angular part and linear part (of the frame's origin), in the axes of one frame."""

    angular: Vector[T]
    linear: Vector[T]


Screws = Callable[[int, int], Screw[T]]
"""The screw of a joint in the frame of a link beyond it: (joint, link) -> Screw."""


def build_axis_screws(recursion: Recursion[T]) -> tuple[Screw[T], ...]:
    """Return the axis of every joint in its own link's frame: (z, 0), or (0, z) if prismatic."""
    zero = recursion.algebra.zero
    none, axis = (zero, zero, zero), (zero, zero, recursion.algebra.one)
    return tuple(
        Screw(angular=axis, linear=none) if frame.revolute else Screw(angular=none, linear=axis)
        for frame in recursion.frames
    )


def compute_screw_rates(recursion: Recursion[T]) -> tuple[Screw[T], ...]:
    """Return the change of every link's velocity by its joint's coordinate, v x z.

    (w x z, v x z), or (0, w x z) if prismatic.
    """
    algebra = recursion.algebra
    zero = algebra.zero
    none, axis = (zero, zero, zero), (zero, zero, algebra.one)
    result = []
    for frame, motion in zip(recursion.frames, recursion.motions, strict=True):
        turned = algebra.cross(motion.angular, axis)
        if frame.revolute:
            result.append(Screw(angular=turned, linear=algebra.cross(motion.linear, axis)))
        else:
            result.append(Screw(angular=none, linear=turned))
    return tuple(result)


def transform_screws(recursion: Recursion[T], own: tuple[Screw[T], ...]) -> Screws[T]:
    """Return the screws `own`, one a joint, in the frames of the links beyond.

    z_j = R' z_p;  v_j = R' (v_p + z_p x r).
    """
    algebra, robot = recursion.algebra, recursion.robot
    found: dict[tuple[int, int], Screw[T]] = {(joint, joint): screw for joint, screw in enumerate(own)}

    def find(joint: int, link: int) -> Screw[T]:
        if (joint, link) not in found:
            frame, before = recursion.frames[link], find(joint, robot.joints[link].parent)
            moved = algebra.add_vectors(before.linear, algebra.cross(before.angular, frame.origin))
            found[joint, link] = Screw(
                angular=rotate_to_link(algebra, frame, before.angular),
                linear=rotate_to_link(algebra, frame, moved),
            )
        return found[joint, link]

    return find


ProjectionFrame = Callable[[int], int]
"""In whose frame the wrenches of a link meet the screws: that of it or of a link before it; -1 for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrench(Generic[T]):
    """A force (N) and a moment (N m) about the link frame's origin; or momenta (kg m/s, kg m^2/s)."""

    force: Vector[T]
    moment: Vector[T]


def build_unit_vector(algebra: Algebra[T], axis: int) -> Vector[T]:
    """Return x, y or z for 0, 1 or 2."""
    zero, one = algebra.zero, algebra.one
    return (one if axis == 0 else zero, one if axis == 1 else zero, one if axis == 2 else zero)


_TENSOR = {"XX": (0, 0), "XY": (0, 1), "XZ": (0, 2), "YY": (1, 1), "YZ": (1, 2), "ZZ": (2, 2)}


def compute_momentum(algebra: Algebra[T], name: str, motion: LinkMotion[T]) -> Wrench[T]:
    """Return linear momentum and moment of momentum per unit of one parameter.

    p = M v + w x MS;  L = I w + MS x v.  With w = 0 and v = g they are the weight.
    """
    zero = (algebra.zero,) * 3
    if name in _TENSOR:
        i, j = _TENSOR[name]
        moment = [algebra.zero] * 3
        moment[i] = motion.angular[j]
        moment[j] = motion.angular[i]
        return Wrench(force=zero, moment=(moment[0], moment[1], moment[2]))
    if name == "M":
        return Wrench(force=motion.linear, moment=zero)
    axis = build_unit_vector(algebra, INERTIAL.index(name) - INERTIAL.index("MX"))
    return Wrench(force=algebra.cross(motion.angular, axis), moment=algebra.cross(axis, motion.linear))


def transform_wrench(algebra: Algebra[T], frame: LinkFrame[T], wrench: Wrench[T]) -> Wrench[T]:
    """Return a wrench about the link's origin in the parent's axes, about the parent's origin."""
    force = rotate_to_parent(algebra, frame, wrench.force)
    moment = rotate_to_parent(algebra, frame, wrench.moment)
    return Wrench(force=force, moment=algebra.add_vectors(moment, algebra.cross(frame.origin, force)))


def project_wrench(
    recursion: Recursion[T], link: int, wrench: Wrench[T], screws: Screws[T], stop: int
) -> list[T]:
    """Return the power of a wrench in the frame of `link` on the screw of every joint; 0 beyond its chain.

    The wrench goes down, joint by joint, until it reaches the frame of the link `stop` (-1: to the
    base); the screws of the joints below come up to that frame.
    """
    robot, algebra = recursion.robot, recursion.algebra
    entries = [algebra.zero] * robot.size
    frame = joint = link
    while joint >= 0:
        if frame not in (joint, stop):
            wrench, frame = transform_wrench(algebra, recursion.frames[frame], wrench), joint
        screw = screws(joint, frame)
        turning = algebra.dot(screw.angular, wrench.moment)
        entries[joint] = algebra.add(turning, algebra.dot(screw.linear, wrench.force))
        joint = robot.joints[joint].parent
    return entries


def project_columns(
    recursion: Recursion[T],
    columns: Mapping[tuple[int, str], Wrench[T]],
    screws: Screws[T],
    meet: ProjectionFrame | None = None,
) -> dict[tuple[int, str], Sequence[T]]:
    """Return, for each (link, parameter), the n joint entries of its wrench; `meet` None is the base."""
    return {
        (link, name): project_wrench(recursion, link, wrench, screws, meet(link) if meet else -1)
        for (link, name), wrench in columns.items()
    }
