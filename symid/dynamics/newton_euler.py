"""Torques and mass matrix by recursion: the forms that code is printed from.

Input: a robot, an algebra, a state, parameters per link. Output: joint torques, mass matrix.

Parameters are given as {(link, name): value}; a parameter that is not listed is zero and
costs nothing. With base parameters, the value of beta stands at its representative and all
grouped parameters are left out: the torques are the same.

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side.
"""

from collections.abc import Mapping

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Matrix, Vector, add, cross, dot, multiply_matrices, scale, transpose
from symid.dynamics.kinematics import Frame, Motion, Recursion, lift_vector, lower_vector
from symid.dynamics.wrenches import (
    Acceleration,
    Wrench,
    add_wrenches,
    lift_wrench,
    project_on_axis,
)
from symid.robot.description import Robot

__all__ = [
    "Parameters",
    "find_accelerations",
    "find_inverse_dynamics",
    "find_mass_matrix",
    "find_reference_rates",
    "lift_body",
]

Parameters = Mapping[tuple[int, str], T]


def find_accelerations(recursion: Recursion[T]) -> tuple[Acceleration[T], ...]:
    """Return the acceleration of every link, gravity subtracted.

    dw_j = R' dw_p + w x z dq + z ddq;  a_j = R' (a_p + dw_p x r + w_p x (w_p x r)) (+ 2 w x z dq + z ddq),
    the bracket at prismatic joints only. Luh, Walker and Paul 1980.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    motions = recursion.motions
    zero = algebra.zero
    still = Acceleration(angular=(zero, zero, zero), linear=_lifted_gravity(robot, algebra))
    result: list[Acceleration[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        w_parent = motions[joint.parent].angular if joint.parent >= 0 else (zero, zero, zero)
        parent = result[joint.parent] if joint.parent >= 0 else still
        swing = cross(algebra, w_parent, cross(algebra, w_parent, frame.origin))
        turned = add(algebra, cross(algebra, parent.angular, frame.origin), swing)
        linear = lower_vector(algebra, frame, add(algebra, parent.linear, turned))
        angular = lower_vector(algebra, frame, parent.angular)
        axis_rate: Vector[T] = (zero, zero, state.velocity[index])
        own: Vector[T] = (zero, zero, state.acceleration[index])
        coupling = cross(algebra, motions[index].angular, axis_rate)
        if frame.revolute:
            angular = add(algebra, add(algebra, angular, coupling), own)
        else:
            linear = add(algebra, add(algebra, add(algebra, linear, coupling), coupling), own)
        result.append(Acceleration(angular=angular, linear=linear))
    return tuple(result)


def _lifted_gravity(robot: Robot, algebra: Algebra[T]) -> Vector[T]:
    x, y, z = (algebra.neg(algebra.constant(value)) for value in robot.gravity)
    return (x, y, z)


def find_reference_rates(
    recursion: Recursion[T], references: tuple[Motion[T], ...], reference_acceleration: tuple[T, ...]
) -> tuple[Acceleration[T], ...]:
    """Return the derivatives of the components of each link's reference velocity, gravity subtracted.

    A_j = X A_p + (X v_r,p) x (z dq) + z ddqr, in link axes; X v_r,p is v_r,j without its own joint.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    zero = algebra.zero
    still = Acceleration(angular=(zero, zero, zero), linear=_lifted_gravity(robot, algebra))
    result: list[Acceleration[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        parent = result[joint.parent] if joint.parent >= 0 else still
        turned = add(algebra, parent.linear, cross(algebra, parent.angular, frame.origin))
        angular = lower_vector(algebra, frame, parent.angular)
        linear = lower_vector(algebra, frame, turned)
        rate: Vector[T] = (zero, zero, state.velocity[index])
        own: Vector[T] = (zero, zero, reference_acceleration[index])
        reference = references[index]
        if frame.revolute:
            # z x z = 0: the reference's own joint rate may stay in w and v.
            angular = add(algebra, add(algebra, angular, cross(algebra, reference.angular, rate)), own)
            linear = add(algebra, linear, cross(algebra, reference.linear, rate))
        else:
            linear = add(algebra, add(algebra, linear, cross(algebra, reference.angular, rate)), own)
        result.append(Acceleration(angular=angular, linear=linear))
    return tuple(result)


def _gather(algebra: Algebra[T], parameters: Parameters[T], link: int) -> tuple[Matrix[T], Vector[T], T]:
    """Return inertia tensor, first moments and mass of a link."""

    def take(name: str) -> T:
        return parameters.get((link, name), algebra.zero)

    xy, xz, yz = take("XY"), take("XZ"), take("YZ")
    tensor = ((take("XX"), xy, xz), (xy, take("YY"), yz), (xz, yz, take("ZZ")))
    return tensor, (take("MX"), take("MY"), take("MZ")), take("M")


def _apply(algebra: Algebra[T], matrix: Matrix[T], vector: Vector[T]) -> Vector[T]:
    x, y, z = (dot(algebra, row, vector) for row in matrix)
    return (x, y, z)


def _link_wrench(
    algebra: Algebra[T],
    body: tuple[Matrix[T], Vector[T], T],
    angular: Vector[T],
    acceleration: Acceleration[T],
) -> Wrench[T]:
    """Return the wrench that moves a link; see `wrenches.find_inertial_wrench`."""
    tensor, moments, mass = body
    swing = cross(algebra, angular, cross(algebra, angular, moments))
    force = add(
        algebra, scale(algebra, mass, acceleration.linear), cross(algebra, acceleration.angular, moments)
    )
    spin = cross(algebra, angular, _apply(algebra, tensor, angular))
    moment = add(algebra, _apply(algebra, tensor, acceleration.angular), spin)
    return Wrench(
        force=add(algebra, force, swing),
        moment=add(algebra, moment, cross(algebra, moments, acceleration.linear)),
    )


def find_inverse_dynamics(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[T, ...]:
    """Return the joint torques without friction (Luh, Walker and Paul 1980)."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    motions, state = recursion.motions, recursion.state
    accelerations = find_accelerations(recursion)
    wrenches = [
        _link_wrench(algebra, _gather(algebra, parameters, link), motions[link].angular, accelerations[link])
        for link in range(robot.size)
    ]
    torques = [algebra.zero] * robot.size
    for joint in reversed(range(robot.size)):
        rotor = algebra.mul(parameters.get((joint, "IA"), algebra.zero), state.acceleration[joint])
        torques[joint] = algebra.add(project_on_axis(frames[joint], wrenches[joint]), rotor)
        parent = robot.joints[joint].parent
        if parent >= 0:
            lifted = lift_wrench(algebra, frames[joint], wrenches[joint])
            wrenches[parent] = add_wrenches(algebra, wrenches[parent], lifted)
    return tuple(torques)


def _rotate_tensor(algebra: Algebra[T], frame: Frame[T], tensor: Matrix[T]) -> Matrix[T]:
    """Return R I R', turned first by the joint's angle, then by the constant rotation."""
    half = tensor
    if frame.turn is not None:
        c, s = frame.turn
        zero, one = algebra.zero, algebra.one
        turn = ((c, algebra.neg(s), zero), (s, c, zero), (zero, zero, one))
        half = multiply_matrices(algebra, multiply_matrices(algebra, turn, tensor), transpose(turn))
    return multiply_matrices(algebra, multiply_matrices(algebra, frame.fixed, half), transpose(frame.fixed))


def lift_body(
    algebra: Algebra[T], frame: Frame[T], body: tuple[Matrix[T], Vector[T], T]
) -> tuple[Matrix[T], Vector[T], T]:
    """Return inertia tensor, first moments and mass about the parent's origin, in its axes.

    I_p = R I R' + 2 (t.m) E - t m' - m t' + M (t.t E - t t'),  m = R MS,  t the link's origin.
    """
    tensor, moments, mass = body
    m = lift_vector(algebra, frame, moments)
    t = frame.origin
    turned = _rotate_tensor(algebra, frame, tensor)
    # With u = m + M t / 2 the shift is 2 (t.u) E - t u' - u t'.
    u = add(algebra, m, scale(algebra, algebra.half(mass), t))
    trace = dot(algebra, t, u)
    trace = algebra.add(trace, trace)
    rows = []
    for i in range(3):
        row = []
        for j in range(3):
            shift = algebra.add(algebra.mul(t[i], u[j]), algebra.mul(u[i], t[j]))
            value = algebra.sub(turned[i][j], shift)
            row.append(algebra.add(value, trace) if i == j else value)
        rows.append((row[0], row[1], row[2]))
    lifted = add(algebra, m, scale(algebra, mass, t))
    return (rows[0], rows[1], rows[2]), lifted, mass


def _add_bodies(
    algebra: Algebra[T], left: tuple[Matrix[T], Vector[T], T], right: tuple[Matrix[T], Vector[T], T]
) -> tuple[Matrix[T], Vector[T], T]:
    first, second, third = (add(algebra, a, b) for a, b in zip(left[0], right[0], strict=True))
    return (first, second, third), add(algebra, left[1], right[1]), algebra.add(left[2], right[2])


def find_mass_matrix(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix, rotor inertias on its diagonal (composite bodies, Walker and Orin 1982)."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    zero = algebra.zero
    matrix = [[zero] * robot.size for _ in range(robot.size)]
    bodies = [_gather(algebra, parameters, link) for link in range(robot.size)]
    for joint in reversed(range(robot.size)):
        tensor, (mx, my, _), mass = bodies[joint]
        if frames[joint].revolute:
            wrench = Wrench(
                force=(algebra.neg(my), mx, zero), moment=(tensor[0][2], tensor[1][2], tensor[2][2])
            )
        else:
            wrench = Wrench(force=(zero, zero, mass), moment=(my, algebra.neg(mx), zero))
        rotor = parameters.get((joint, "IA"), zero)
        matrix[joint][joint] = algebra.add(project_on_axis(frames[joint], wrench), rotor)
        parent, child = robot.joints[joint].parent, joint
        if parent >= 0:
            bodies[parent] = _add_bodies(
                algebra, bodies[parent], lift_body(algebra, frames[joint], bodies[joint])
            )
        while parent >= 0:
            wrench = lift_wrench(algebra, frames[child], wrench)
            entry = project_on_axis(frames[parent], wrench)
            matrix[joint][parent] = matrix[parent][joint] = entry
            parent, child = robot.joints[parent].parent, parent
    return tuple(tuple(row) for row in matrix)
