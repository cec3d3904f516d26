"""Joint screws: what a joint does to the links beyond it, seen from any of their frames.

Input: a recursion. Output: `Screw`, the velocity of a link per unit of a joint's rate, or the change of
its velocity per unit of a joint's coordinate.

A screw is carried from its joint up the tree, a wrench from its link down; where both stand in the same
frame, their product is what the joint feels.

Supported: trees of revolute and prismatic joints.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import T
from symid.algebra.vectors import Vector, add, cross
from symid.dynamics.kinematics import Recursion, lower_vector

__all__ = ["Screw", "Screws", "carry_screws", "find_axis_screws", "find_turned_screws"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Screw(Generic[T]):
    """Angular part and linear part (of the frame's origin), in the axes of one frame."""

    angular: Vector[T]
    linear: Vector[T]


Screws = Callable[[int, int], Screw[T]]
"""The screw of a joint in the frame of a link beyond it: (joint, link) -> Screw."""


def find_axis_screws(recursion: Recursion[T]) -> tuple[Screw[T], ...]:
    """Return the axis of every joint in its own link's frame: (z, 0), or (0, z) if prismatic."""
    zero = recursion.algebra.zero
    none, axis = (zero, zero, zero), (zero, zero, recursion.algebra.one)
    return tuple(
        Screw(angular=axis, linear=none) if frame.revolute else Screw(angular=none, linear=axis)
        for frame in recursion.frames
    )


def find_turned_screws(recursion: Recursion[T]) -> tuple[Screw[T], ...]:
    """Return the change of every link's velocity by its joint's coordinate, v x z.

    (w x z, v x z), or (0, w x z) if prismatic.
    """
    algebra = recursion.algebra
    zero = algebra.zero
    none, axis = (zero, zero, zero), (zero, zero, algebra.one)
    result = []
    for frame, motion in zip(recursion.frames, recursion.motions, strict=True):
        turned = cross(algebra, motion.angular, axis)
        if frame.revolute:
            result.append(Screw(angular=turned, linear=cross(algebra, motion.linear, axis)))
        else:
            result.append(Screw(angular=none, linear=turned))
    return tuple(result)


def carry_screws(recursion: Recursion[T], own: tuple[Screw[T], ...]) -> Screws[T]:
    """Return the screws `own`, one a joint, as seen from the links beyond.

    z_j = R' z_p;  v_j = R' (v_p + z_p x r).
    """
    algebra, robot = recursion.algebra, recursion.robot
    found: dict[tuple[int, int], Screw[T]] = {(joint, joint): screw for joint, screw in enumerate(own)}

    def find(joint: int, link: int) -> Screw[T]:
        if (joint, link) not in found:
            frame, before = recursion.frames[link], find(joint, robot.joints[link].parent)
            moved = add(algebra, before.linear, cross(algebra, before.angular, frame.origin))
            found[joint, link] = Screw(
                angular=lower_vector(algebra, frame, before.angular),
                linear=lower_vector(algebra, frame, moved),
            )
        return found[joint, link]

    return find
