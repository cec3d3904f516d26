"""Frames, velocities and gravity of every link by recursion over the tree.

Input: a robot, an algebra, a state. Output: `Recursion`: frames and motions of
all links, each motion in its link's own frame; and the changes of frame (`lift_vector`: link to parent,
`lower_vector`: parent to link).

A change of frame is done in two steps, the constant part of the placement and the joint's
own turn, so that the zeros and ones of the constant part cost nothing.

Supported: trees of revolute and prismatic joints on a fixed base.
"""

from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import Algebra, State, T
from symid.algebra.vectors import Matrix, Vector, add, cross, dot, multiply, multiply_matrices, sub, transpose
from symid.robot.description import Joint, JointKind, Robot

__all__ = [
    "Frame",
    "Motion",
    "Pose",
    "Recursion",
    "build_frames",
    "build_recursion",
    "find_jacobian",
    "find_link_poses",
    "find_motions",
    "find_poses",
    "find_turn",
    "lift_vector",
    "lower_vector",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame(Generic[T]):
    """A link frame seen from its parent's: constant rotation, then the joint's turn (cos, sin); origin."""

    fixed: Matrix[T]
    turn: tuple[T, T] | None
    origin: Vector[T]
    revolute: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion(Generic[T]):
    """The motion of a link in its own frame.

    `angular` rad/s, `linear` m/s (of the frame's origin), `gravity` m/s^2, `height` J/kg: the
    potential of a unit mass at the frame's origin.
    """

    angular: Vector[T]
    linear: Vector[T]
    gravity: Vector[T]
    height: T


@dataclass(frozen=True, slots=True, kw_only=True)
class Recursion(Generic[T]):
    """A robot in a state: what every form of its dynamics starts from."""

    robot: Robot
    algebra: Algebra[T]
    state: State[T]
    frames: tuple[Frame[T], ...]
    motions: tuple[Motion[T], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose(Generic[T]):
    """A link frame in the base frame: columns of `rotation` are its axes, `origin` in m."""

    rotation: Matrix[T]
    origin: Vector[T]


def _build_frame(joint: Joint, index: int, algebra: Algebra[T], state: State[T]) -> Frame[T]:
    rows = [[algebra.constant(value) for value in row] for row in joint.placement.rotation]
    fixed: Matrix[T] = (
        (rows[0][0], rows[0][1], rows[0][2]),
        (rows[1][0], rows[1][1], rows[1][2]),
        (rows[2][0], rows[2][1], rows[2][2]),
    )
    x, y, z = (algebra.constant(value) for value in joint.placement.translation)
    if joint.kind is JointKind.REVOLUTE:
        return Frame(
            fixed=fixed, turn=(state.cosine[index], state.sine[index]), origin=(x, y, z), revolute=True
        )
    along = (algebra.mul(row[2], state.position[index]) for row in fixed)
    x, y, z = (algebra.add(start, step) for start, step in zip((x, y, z), along, strict=True))
    return Frame(fixed=fixed, turn=None, origin=(x, y, z), revolute=False)


def build_frames(robot: Robot, algebra: Algebra[T], state: State[T]) -> tuple[Frame[T], ...]:
    """Return every link frame seen from its parent's."""
    return tuple(_build_frame(joint, index, algebra, state) for index, joint in enumerate(robot.joints))


def lower_vector(algebra: Algebra[T], frame: Frame[T], vector: Vector[T]) -> Vector[T]:
    """Return a vector given in the parent's axes in the link's axes."""
    x, y, z = multiply(algebra, transpose(frame.fixed), vector)
    if frame.turn is None:
        return (x, y, z)
    c, s = frame.turn
    mul = algebra.mul
    return (algebra.add(mul(c, x), mul(s, y)), algebra.sub(mul(c, y), mul(s, x)), z)


def lift_vector(algebra: Algebra[T], frame: Frame[T], vector: Vector[T]) -> Vector[T]:
    """Return a vector given in the link's axes in the parent's axes."""
    x, y, z = vector
    if frame.turn is not None:
        c, s = frame.turn
        mul = algebra.mul
        x, y = algebra.sub(mul(c, x), mul(s, y)), algebra.add(mul(s, x), mul(c, y))
    return multiply(algebra, frame.fixed, (x, y, z))


def find_motions(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    velocity: tuple[T, ...],
    base: Motion[T] | None = None,
) -> tuple[Motion[T], ...]:
    """Return the motion of every link; the base is at rest under the robot's gravity unless `base` is given.

    w_j = R' w_p + z dq_j;  v_j = R' (v_p + w_p x r) (+ z dq_j if prismatic);  R from link to parent.
    Luh, Walker and Paul 1980, without accelerations; height by -g' r, summed along the chain.
    """
    zero = algebra.zero
    gravity = tuple(algebra.constant(value) for value in robot.gravity)
    root = base or Motion(
        angular=(zero, zero, zero),
        linear=(zero, zero, zero),
        gravity=(gravity[0], gravity[1], gravity[2]),
        height=zero,
    )
    motions: list[Motion[T]] = []
    for joint, frame, dq in zip(robot.joints, frames, velocity, strict=True):
        parent = motions[joint.parent] if joint.parent >= 0 else root
        carried = add(algebra, parent.linear, cross(algebra, parent.angular, frame.origin))
        angular = lower_vector(algebra, frame, parent.angular)
        linear = lower_vector(algebra, frame, carried)
        own = (zero, zero, dq)
        motions.append(
            Motion(
                angular=add(algebra, angular, own) if frame.revolute else angular,
                linear=linear if frame.revolute else add(algebra, linear, own),
                gravity=lower_vector(algebra, frame, parent.gravity),
                height=algebra.sub(parent.height, dot(algebra, parent.gravity, frame.origin)),
            )
        )
    return tuple(motions)


def build_recursion(robot: Robot, algebra: Algebra[T], state: State[T]) -> Recursion[T]:
    """Return frames and motions of all links in one state."""
    frames = build_frames(robot, algebra, state)
    motions = find_motions(robot, algebra, frames, state.velocity)
    return Recursion(robot=robot, algebra=algebra, state=state, frames=frames, motions=motions)


def find_turn(algebra: Algebra[T], turn: tuple[T, T]) -> Matrix[T]:
    """Return the rotation about z from (cos, sin)."""
    c, s = turn
    zero, one = algebra.zero, algebra.one
    return ((c, algebra.neg(s), zero), (s, c, zero), (zero, zero, one))


def _rotation(algebra: Algebra[T], frame: Frame[T]) -> Matrix[T]:
    if frame.turn is None:
        return frame.fixed
    return multiply_matrices(algebra, frame.fixed, find_turn(algebra, frame.turn))


def find_poses(recursion: Recursion[T]) -> tuple[Pose[T], ...]:
    """Return every link frame in the base frame."""
    algebra = recursion.algebra
    poses: list[Pose[T]] = []
    for joint, frame in zip(recursion.robot.joints, recursion.frames, strict=True):
        rotation = _rotation(algebra, frame)
        if joint.parent < 0:
            poses.append(Pose(rotation=rotation, origin=frame.origin))
            continue
        parent = poses[joint.parent]
        poses.append(
            Pose(
                rotation=multiply_matrices(algebra, parent.rotation, rotation),
                origin=add(algebra, parent.origin, multiply(algebra, parent.rotation, frame.origin)),
            )
        )
    return tuple(poses)


def find_link_poses(recursion: Recursion[T]) -> tuple[Pose[T], ...]:
    """Return the frame that the robot file gives to every link (`Joint.frame`) in the base frame."""
    algebra = recursion.algebra
    result = []
    for joint, pose in zip(recursion.robot.joints, find_poses(recursion), strict=True):
        rows = [[algebra.constant(value) for value in row] for row in joint.frame.rotation]
        turn: Matrix[T] = (
            (rows[0][0], rows[0][1], rows[0][2]),
            (rows[1][0], rows[1][1], rows[1][2]),
            (rows[2][0], rows[2][1], rows[2][2]),
        )
        x, y, z = (algebra.constant(value) for value in joint.frame.translation)
        origin = add(algebra, pose.origin, multiply(algebra, pose.rotation, (x, y, z)))
        result.append(Pose(rotation=multiply_matrices(algebra, pose.rotation, turn), origin=origin))
    return tuple(result)


def find_jacobian(recursion: Recursion[T]) -> tuple[tuple[T, ...], ...]:
    """Return the geometric Jacobian (6, joints) of the file's last link frame, base axes, linear rows first.

    Column of joint j on the path to the last link: (z_j x (p_n - p_j), z_j), or (z_j, 0) if prismatic.
    """
    robot, algebra, poses = recursion.robot, recursion.algebra, find_poses(recursion)
    zero = algebra.zero
    columns: list[tuple[T, ...]] = [(zero,) * 6] * robot.size
    tip = find_link_poses(recursion)[-1].origin
    index = robot.size - 1
    while index >= 0:
        pose = poses[index]
        axis: Vector[T] = (pose.rotation[0][2], pose.rotation[1][2], pose.rotation[2][2])
        if robot.joints[index].kind is JointKind.REVOLUTE:
            columns[index] = (*cross(algebra, axis, sub(algebra, tip, pose.origin)), *axis)
        else:
            columns[index] = (*axis, zero, zero, zero)
        index = robot.joints[index].parent
    return tuple(zip(*columns, strict=True))
