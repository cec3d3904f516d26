"""Forces and moments per standard parameter, and their way down the tree to the joints.

Input: motions and accelerations of a link in its own frame. Output: `Wrench` columns, one a
parameter, and their projection on the joint axes: columns of torque-like regressors.

Everything a link contributes is linear in its parameters: momentum, inertial wrench, weight.
Each is written once, for one parameter; the regressors differ only in which of them is
carried to the base, and on what it is projected.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Vector, add, cross, dot
from symid.dynamics.kinematics import Frame, Motion, Recursion, lift_vector
from symid.dynamics.screws import Screw, Screws
from symid.notation import INERTIAL

__all__ = [
    "Acceleration",
    "Meeting",
    "Wrench",
    "add_wrenches",
    "find_gravity_wrench",
    "find_momentum",
    "lift_wrench",
    "pair",
    "project_columns",
    "project_on_axis",
    "project_wrench",
]


Meeting = Callable[[int], int]
"""In whose frame the wrenches of a link meet the screws: that of it or of a link before it; -1 for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrench(Generic[T]):
    """A force (N) and a moment (N m) about the link frame's origin; or momenta (kg m/s, kg m^2/s)."""

    force: Vector[T]
    moment: Vector[T]


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceleration(Generic[T]):
    """The acceleration of a link in its own frame, of its origin, gravity subtracted: rad/s^2, m/s^2."""

    angular: Vector[T]
    linear: Vector[T]


def _unit(algebra: Algebra[T], axis: int) -> Vector[T]:
    zero, one = algebra.zero, algebra.one
    return (one if axis == 0 else zero, one if axis == 1 else zero, one if axis == 2 else zero)


_TENSOR = {"XX": (0, 0), "XY": (0, 1), "XZ": (0, 2), "YY": (1, 1), "YZ": (1, 2), "ZZ": (2, 2)}


def _apply_tensor(algebra: Algebra[T], name: str, vector: Vector[T]) -> Vector[T]:
    """Return the unit inertia tensor of the entry `name`, times `vector`."""
    i, j = _TENSOR[name]
    result = [algebra.zero] * 3
    result[i] = vector[j]
    result[j] = vector[i]
    return (result[0], result[1], result[2])


def find_momentum(algebra: Algebra[T], name: str, motion: Motion[T]) -> Wrench[T]:
    """Return linear momentum and moment of momentum per unit of one parameter.

    p = M v + w x MS;  L = I w + MS x v.
    """
    zero = (algebra.zero,) * 3
    if name in _TENSOR:
        return Wrench(force=zero, moment=_apply_tensor(algebra, name, motion.angular))
    if name == "M":
        return Wrench(force=motion.linear, moment=zero)
    axis = _unit(algebra, INERTIAL.index(name) - INERTIAL.index("MX"))
    return Wrench(force=cross(algebra, motion.angular, axis), moment=cross(algebra, axis, motion.linear))


def find_gravity_wrench(algebra: Algebra[T], name: str, motion: Motion[T]) -> Wrench[T]:
    """Return the weight per unit of one parameter: f = M g, n = MS x g."""
    zero = (algebra.zero,) * 3
    if name in _TENSOR:
        return Wrench(force=zero, moment=zero)
    if name == "M":
        return Wrench(force=motion.gravity, moment=zero)
    axis = _unit(algebra, INERTIAL.index(name) - INERTIAL.index("MX"))
    return Wrench(force=zero, moment=cross(algebra, axis, motion.gravity))


def lift_wrench(algebra: Algebra[T], frame: Frame[T], wrench: Wrench[T]) -> Wrench[T]:
    """Return a wrench about the link's origin in the parent's axes, about the parent's origin."""
    force = lift_vector(algebra, frame, wrench.force)
    moment = lift_vector(algebra, frame, wrench.moment)
    return Wrench(force=force, moment=add(algebra, moment, cross(algebra, frame.origin, force)))


def add_wrenches(algebra: Algebra[T], left: Wrench[T], right: Wrench[T]) -> Wrench[T]:
    """Return left + right."""
    return Wrench(force=add(algebra, left.force, right.force), moment=add(algebra, left.moment, right.moment))


def project_on_axis(frame: Frame[T], wrench: Wrench[T]) -> T:
    """Return what the joint must carry: the moment about z, or the force along z if prismatic."""
    return wrench.moment[2] if frame.revolute else wrench.force[2]


def pair(algebra: Algebra[T], screw: Screw[T], wrench: Wrench[T]) -> T:
    """Return the power of a wrench on a screw, both in the axes and about the origin of one frame."""
    turning = dot(algebra, screw.angular, wrench.moment)
    return algebra.add(turning, dot(algebra, screw.linear, wrench.force))


def project_wrench(
    recursion: Recursion[T], link: int, wrench: Wrench[T], screws: Screws[T], stop: int
) -> list[T]:
    """Return what every joint feels of a wrench in the frame of `link`.

    The wrench goes down, joint by joint, until it reaches the frame of the link `stop` (-1: to the
    base); the screws of the joints below come up to that frame. Joints that do not carry the link
    get zero.
    """
    robot, algebra = recursion.robot, recursion.algebra
    entries = [algebra.zero] * robot.size
    frame = joint = link
    while joint >= 0:
        if frame not in (joint, stop):
            wrench, frame = lift_wrench(algebra, recursion.frames[frame], wrench), joint
        entries[joint] = pair(algebra, screws(joint, frame), wrench)
        joint = robot.joints[joint].parent
    return entries


def project_columns(
    recursion: Recursion[T],
    columns: Mapping[tuple[int, str], Wrench[T]],
    screws: Screws[T],
    meet: Meeting | None = None,
) -> dict[tuple[int, str], Sequence[T]]:
    """Return, for each (link, parameter), the n joint entries of its wrench; `meet` None is the base."""
    return {
        (link, name): project_wrench(recursion, link, wrench, screws, meet(link) if meet else -1)
        for (link, name), wrench in columns.items()
    }
