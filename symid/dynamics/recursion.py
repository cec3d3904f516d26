"""Frames, motions, screws and wrenches of all links by one recursion over the tree, in any algebra.

Robot, algebra, state -> `Recursion`: frames and motions of all links, each motion in its link's own frame.
Rotations go in two steps, the constant part of the placement and the joint's own, so that the zeros and ones
of the constant part cost nothing. Joints that follow another one act on its coordinate: with the joint
speeds dq_joint = G dq, torques, momenta and dL/dq fold as G' tau, matrices as G' M G, Jacobians as J G.

How forces per parameter reach the joints: a `Screw` is the velocity of a link per unit of a joint's rate, or
the change of that velocity per unit of the joint's coordinate; a `Wrench` belongs to a unit of one parameter
of a link. A screw goes from its joint up the tree, a wrench from its link down; in a common frame their
product is the torque of the joint.

Supported: trees of revolute and prismatic joints on a fixed base.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

from symid.dynamics.algebra import Algebra, Matrix, RobotState, T, Vector, transpose
from symid.robot import Exact, JointKind, Placement, Robot

Rows = tuple[tuple[T, ...], ...]
ProjectionFrame = Callable[[int], int]
"""In whose frame the wrenches of a link meet the screws: that of it or of a link before it; -1 for none."""


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
    """A robot in a state: what every form of its dynamics starts from.

    `meet`: where wrenches on their way down meet the screws of the joints; None: at every joint.
    """

    robot: Robot
    algebra: Algebra[T]
    state: RobotState[T]
    frames: tuple[LinkFrame[T], ...]
    motions: tuple[LinkMotion[T], ...]
    meet: ProjectionFrame | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePose(Generic[T]):
    """A link frame in the base frame: columns of `rotation` are its axes, `origin` in m."""

    rotation: Matrix[T]
    origin: Vector[T]


def lift_placement(placement: Placement, algebra: Algebra[T]) -> tuple[Matrix[T], Vector[T]]:
    """Return rotation and translation of a placement in the carrier."""
    lifted: list[Vector[T]] = []
    for row in (*placement.rotation, placement.translation):
        x, y, z = map(algebra.constant, row)
        lifted.append((x, y, z))
    first, second, third, origin = lifted
    return (first, second, third), origin


def build_frames(robot: Robot, algebra: Algebra[T], state: RobotState[T]) -> tuple[LinkFrame[T], ...]:
    """Return every link frame relative to its parent's."""
    frames = []
    for index, joint in enumerate(robot.joints):
        fixed, (x, y, z) = lift_placement(joint.placement, algebra)
        revolute = joint.kind is JointKind.REVOLUTE
        if not revolute:
            along = (algebra.mul(row[2], state.position[index]) for row in fixed)
            x, y, z = map(algebra.add, (x, y, z), along)
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
        moved = transform_screw(algebra, frame, Screw(angular=parent.angular, linear=parent.linear))
        angular, linear, own = moved.angular, moved.linear, (zero, zero, dq)
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
        turn, start = lift_placement(joint.frame, algebra)
        origin = algebra.add_vectors(pose.origin, algebra.apply_matrix(pose.rotation, start))
        result.append(FramePose(rotation=algebra.multiply_matrices(pose.rotation, turn), origin=origin))
    return tuple(result)


def compute_jacobian(recursion: Recursion[T]) -> Rows[T]:
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
            x, y, z = map(algebra.sub, tip, pose.origin)
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
            share = algebra.mul(algebra.constant(Exact.of(factor)), value)
            result[position] = algebra.add(result[position], share)
    return tuple(result)


def fold_matrix(robot: Robot, algebra: Algebra[T], matrix: Sequence[Sequence[T]]) -> Rows[T]:
    """Return G' M G of a matrix with a row and a column a joint."""
    half = [fold_vector(robot, algebra, row) for row in matrix]
    columns = [fold_vector(robot, algebra, column) for column in zip(*half, strict=True)]
    return tuple(zip(*columns, strict=True))


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
    """Return v x z, the change of velocities by the coordinate: (w x z, v x z), for slides (0, w x z)."""
    cross, result = recursion.algebra.cross, []
    for axis, motion in zip(build_axis_screws(recursion), recursion.motions, strict=True):
        turned, moved = cross(motion.linear, axis.angular), cross(motion.angular, axis.linear)
        linear = recursion.algebra.add_vectors(turned, moved)
        result.append(Screw(angular=cross(motion.angular, axis.angular), linear=linear))
    return tuple(result)


def transform_screw(algebra: Algebra[T], frame: LinkFrame[T], screw: Screw[T]) -> Screw[T]:
    """Return a screw about the parent's origin in the link's axes, about the link's origin."""
    moved = algebra.add_vectors(screw.linear, algebra.cross(screw.angular, frame.origin))
    angular = rotate_to_link(algebra, frame, screw.angular)
    return Screw(angular=angular, linear=rotate_to_link(algebra, frame, moved))


def transform_screws(recursion: Recursion[T], own: Sequence[Screw[T]]) -> Screws[T]:
    """Return screws, one a joint, in the frames of links beyond: z_j = R' z_p;  v_j = R' (v_p + z_p x r)."""
    algebra, robot = recursion.algebra, recursion.robot
    found: dict[tuple[int, int], Screw[T]] = {(joint, joint): screw for joint, screw in enumerate(own)}

    def find(joint: int, link: int) -> Screw[T]:
        missing = [link]
        while (joint, missing[-1]) not in found:
            missing.append(robot.joints[missing[-1]].parent)
        screw = found[joint, missing.pop()]
        for place in reversed(missing):
            screw = found[joint, place] = transform_screw(algebra, recursion.frames[place], screw)
        return screw

    return find


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrench(Generic[T]):
    """A force (N) and a moment (N m) about the link frame's origin; or momenta (kg m/s, kg m^2/s)."""

    force: Vector[T]
    moment: Vector[T]


def add_wrenches(algebra: Algebra[T], first: Wrench[T], *others: Wrench[T]) -> Wrench[T]:
    """Return the sum, from left to right."""
    force = algebra.add_vectors(first.force, *(wrench.force for wrench in others))
    return Wrench(force=force, moment=algebra.add_vectors(first.moment, *(one.moment for one in others)))


def transform_wrench(algebra: Algebra[T], frame: LinkFrame[T], wrench: Wrench[T]) -> Wrench[T]:
    """Return a wrench about the link's origin in the parent's axes, about the parent's origin."""
    force = rotate_to_parent(algebra, frame, wrench.force)
    moment = rotate_to_parent(algebra, frame, wrench.moment)
    return Wrench(force=force, moment=algebra.add_vectors(moment, algebra.cross(frame.origin, force)))


def project_wrench(recursion: Recursion[T], link: int, wrench: Wrench[T], screws: Screws[T]) -> list[T]:
    """Return the power of a wrench in the frame of `link` on the screw of every joint; 0 beyond its chain.

    The wrench goes down, joint by joint, until it reaches the frame where it meets the screws; those of the
    joints below come up to that frame.
    """
    robot, algebra = recursion.robot, recursion.algebra
    stop = recursion.meet(link) if recursion.meet else -1
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
