"""Frames, velocities, poses and Jacobian of all links by one recursion over the tree, in any algebra.

Robot, algebra, state -> `Recursion`: frames and motions of all links, each motion in its link's own frame.
Rotations go in two steps, the constant part of the placement and the joint's own, so that the zeros and ones
of the constant part cost nothing. Joints that follow another one act on its coordinate: with the joint
speeds dq_joint = G dq, torques, momenta and dL/dq fold as G' tau, matrices as G' M G, Jacobians as J G.

Supported: trees of revolute and prismatic joints on a fixed base.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic

from symid.dynamics.algebra import Algebra, Matrix, RobotState, T, Vector, transpose
from symid.robot import Exact, JointKind, Placement, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkFrame(Generic[T]):
    """A link frame relative to its parent's: constant rotation, then the joint's turn (cos, sin); origin."""

    fixed: Matrix[T]
    turn: tuple[T, T] | None
    origin: Vector[T]
    revolute: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkMotion(Generic[T]):
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
    state: RobotState[T]
    frames: tuple[LinkFrame[T], ...]
    motions: tuple[LinkMotion[T], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePose(Generic[T]):
    """A link frame in the base frame: columns of `rotation` are its axes, `origin` in m."""

    rotation: Matrix[T]
    origin: Vector[T]


def _lift_placement(placement: Placement, algebra: Algebra[T]) -> tuple[Matrix[T], Vector[T]]:
    """Return rotation and translation of a placement in the carrier."""

    def lift(row: Sequence[Exact]) -> Vector[T]:
        x, y, z = (algebra.constant(value) for value in row)
        return x, y, z

    first, second, third = (lift(row) for row in placement.rotation)
    return (first, second, third), lift(placement.translation)


def build_frames(robot: Robot, algebra: Algebra[T], state: RobotState[T]) -> tuple[LinkFrame[T], ...]:
    """Return every link frame relative to its parent's."""
    frames = []
    for index, joint in enumerate(robot.joints):
        fixed, (x, y, z) = _lift_placement(joint.placement, algebra)
        revolute = joint.kind is JointKind.REVOLUTE
        if not revolute:
            along = (algebra.mul(row[2], state.position[index]) for row in fixed)
            x, y, z = (algebra.add(start, step) for start, step in zip((x, y, z), along, strict=True))
        turn = (state.cosine[index], state.sine[index]) if revolute else None
        frames.append(LinkFrame(fixed=fixed, turn=turn, origin=(x, y, z), revolute=revolute))
    return tuple(frames)


def rotate_to_link(algebra: Algebra[T], frame: LinkFrame[T], vector: Vector[T]) -> Vector[T]:
    """Return a vector given in the parent's axes in the link's axes."""
    x, y, z = algebra.apply_matrix(transpose(frame.fixed), vector)
    if frame.turn is None:
        return (x, y, z)
    c, s = frame.turn
    mul = algebra.mul
    return (algebra.add(mul(c, x), mul(s, y)), algebra.sub(mul(c, y), mul(s, x)), z)


def rotate_to_parent(algebra: Algebra[T], frame: LinkFrame[T], vector: Vector[T]) -> Vector[T]:
    """Return a vector given in the link's axes in the parent's axes."""
    x, y, z = vector
    if frame.turn is not None:
        c, s = frame.turn
        mul = algebra.mul
        x, y = algebra.sub(mul(c, x), mul(s, y)), algebra.add(mul(s, x), mul(c, y))
    return algebra.apply_matrix(frame.fixed, (x, y, z))


def compute_motions(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[LinkFrame[T], ...],
    velocity: tuple[T, ...],
    base: LinkMotion[T] | None = None,
) -> tuple[LinkMotion[T], ...]:
    """Return the motion of every link; the base is at rest under the robot's gravity unless `base` is given.

    w_j = R' w_p + z dq_j;  v_j = R' (v_p + w_p x r) (+ z dq_j if prismatic);  R from link to parent.
    Luh, Walker and Paul 1980, without accelerations; height by -g' r, summed along the chain.
    """
    zero = algebra.zero
    none, (x, y, z) = (zero, zero, zero), (algebra.constant(value) for value in robot.gravity)
    root = base or LinkMotion(angular=none, linear=none, gravity=(x, y, z), height=zero)
    motions: list[LinkMotion[T]] = []
    for joint, frame, dq in zip(robot.joints, frames, velocity, strict=True):
        parent = motions[joint.parent] if joint.parent >= 0 else root
        carried = algebra.add_vectors(parent.linear, algebra.cross(parent.angular, frame.origin))
        angular = rotate_to_link(algebra, frame, parent.angular)
        linear = rotate_to_link(algebra, frame, carried)
        own = (zero, zero, dq)
        angular = algebra.add_vectors(angular, own) if frame.revolute else angular
        linear = linear if frame.revolute else algebra.add_vectors(linear, own)
        gravity = rotate_to_link(algebra, frame, parent.gravity)
        height = algebra.sub(parent.height, algebra.dot(parent.gravity, frame.origin))
        motions.append(LinkMotion(angular=angular, linear=linear, gravity=gravity, height=height))
    return tuple(motions)


def build_recursion(robot: Robot, algebra: Algebra[T], state: RobotState[T]) -> Recursion[T]:
    """Return frames and motions of all links in one state."""
    frames = build_frames(robot, algebra, state)
    motions = compute_motions(robot, algebra, frames, state.velocity)
    return Recursion(robot=robot, algebra=algebra, state=state, frames=frames, motions=motions)


def compute_poses(recursion: Recursion[T]) -> tuple[FramePose[T], ...]:
    """Return every link frame in the base frame."""
    algebra = recursion.algebra
    poses: list[FramePose[T]] = []
    for joint, frame in zip(recursion.robot.joints, recursion.frames, strict=True):
        rotation = frame.fixed
        if frame.turn is not None:
            (c, s), zero = frame.turn, algebra.zero
            turn = ((c, algebra.neg(s), zero), (s, c, zero), (zero, zero, algebra.one))
            rotation = algebra.multiply_matrices(rotation, turn)
        if joint.parent < 0:
            poses.append(FramePose(rotation=rotation, origin=frame.origin))
            continue
        parent = poses[joint.parent]
        rotation = algebra.multiply_matrices(parent.rotation, rotation)
        step = algebra.apply_matrix(parent.rotation, frame.origin)
        poses.append(FramePose(rotation=rotation, origin=algebra.add_vectors(parent.origin, step)))
    return tuple(poses)


def compute_link_poses(recursion: Recursion[T]) -> tuple[FramePose[T], ...]:
    """Return the frame that the robot file gives to every link (`Joint.frame`) in the base frame."""
    algebra = recursion.algebra
    result = []
    for joint, pose in zip(recursion.robot.joints, compute_poses(recursion), strict=True):
        turn, start = _lift_placement(joint.frame, algebra)
        origin = algebra.add_vectors(pose.origin, algebra.apply_matrix(pose.rotation, start))
        result.append(FramePose(rotation=algebra.multiply_matrices(pose.rotation, turn), origin=origin))
    return tuple(result)


def compute_jacobian(recursion: Recursion[T]) -> tuple[tuple[T, ...], ...]:
    """Return the geometric Jacobian (6, joints) of the file's last link frame, base axes, linear rows first.

    Column of joint j on the path to the last link: (z_j x (p_n - p_j), z_j), or (z_j, 0) if prismatic.
    """
    robot, algebra, poses = recursion.robot, recursion.algebra, compute_poses(recursion)
    zero = algebra.zero
    columns: list[tuple[T, ...]] = [(zero,) * 6] * robot.size
    tip = compute_link_poses(recursion)[-1].origin
    index = robot.size - 1
    while index >= 0:
        pose = poses[index]
        axis: Vector[T] = (pose.rotation[0][2], pose.rotation[1][2], pose.rotation[2][2])
        if robot.joints[index].kind is JointKind.REVOLUTE:
            x, y, z = (algebra.sub(a, b) for a, b in zip(tip, pose.origin, strict=True))
            columns[index] = (*algebra.cross(axis, (x, y, z)), *axis)
        else:
            columns[index] = (*axis, zero, zero, zero)
        index = robot.joints[index].parent
    return tuple(zip(*columns, strict=True))


def fold_vector(robot: Robot, algebra: Algebra[T], values: Sequence[T]) -> tuple[T, ...]:
    """Return the value of every coordinate: the sum over its joints of multiplier * value."""
    result = [algebra.zero] * robot.freedom
    for value, row in zip(values, robot.transmission, strict=False):  # couplings have no entry here
        for position, factor in row:
            share = value if factor == Fraction(1) else algebra.mul(algebra.constant(Exact.of(factor)), value)
            result[position] = algebra.add(result[position], share)
    return tuple(result)


def fold_matrix(
    robot: Robot, algebra: Algebra[T], matrix: Sequence[Sequence[T]]
) -> tuple[tuple[T, ...], ...]:
    """Return G' M G of a matrix with a row and a column a joint."""
    half = [fold_vector(robot, algebra, row) for row in matrix]
    columns = [fold_vector(robot, algebra, column) for column in zip(*half, strict=True)]
    return tuple(zip(*columns, strict=True))
