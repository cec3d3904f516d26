"""Torques by recursion: the forms that code is printed from.

Input: a robot, an algebra, a state, parameters per link. Output: joint torques.

Parameters are given as {(link, name): value}; a parameter that is not listed is zero and
costs nothing. With base parameters, the value of beta stands at its representative and all
grouped parameters are left out: the torques are the same.

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side, springs.
"""

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Vector, add, cross, multiply, scale
from symid.dynamics.composite import Body, Parameters, gather_body
from symid.dynamics.drives import add_drive_torques
from symid.dynamics.kinematics import Recursion, lower_vector
from symid.dynamics.wrenches import (
    Acceleration,
    Wrench,
    add_wrenches,
    lift_wrench,
    project_on_axis,
)
from symid.robot.description import Robot

__all__ = [
    "carry_down",
    "find_accelerations",
    "find_inverse_dynamics",
]


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


def _link_wrench(
    algebra: Algebra[T],
    body: Body[T],
    angular: Vector[T],
    acceleration: Acceleration[T],
) -> Wrench[T]:
    """Return the wrench that moves a link.

    f = M a + dw x MS + w x (w x MS);  n = I dw + w x (I w) + MS x a   (Newton and Euler).
    """
    tensor, moments, mass = body
    swing = cross(algebra, angular, cross(algebra, angular, moments))
    force = add(
        algebra, scale(algebra, mass, acceleration.linear), cross(algebra, acceleration.angular, moments)
    )
    spin = cross(algebra, angular, multiply(algebra, tensor, angular))
    moment = add(algebra, multiply(algebra, tensor, acceleration.angular), spin)
    return Wrench(
        force=add(algebra, force, swing),
        moment=add(algebra, moment, cross(algebra, moments, acceleration.linear)),
    )


def carry_down(recursion: Recursion[T], wrenches: list[Wrench[T]]) -> list[T]:
    """Return what every joint carries of the wrenches of its link and all links beyond it."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    carried = list(wrenches)
    torques = [algebra.zero] * robot.size
    for joint in reversed(range(robot.size)):
        torques[joint] = project_on_axis(frames[joint], carried[joint])
        parent = robot.joints[joint].parent
        if parent >= 0:
            lifted = lift_wrench(algebra, frames[joint], carried[joint])
            carried[parent] = add_wrenches(algebra, carried[parent], lifted)
    return torques


def find_inverse_dynamics(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[T, ...]:
    """Return the joint torques without friction (Luh, Walker and Paul 1980)."""
    algebra, motions = recursion.algebra, recursion.motions
    wrenches = [
        _link_wrench(algebra, gather_body(algebra, parameters, link), motions[link].angular, acceleration)
        for link, acceleration in enumerate(find_accelerations(recursion))
    ]
    torques = carry_down(recursion, wrenches)
    return add_drive_torques(recursion, torques, parameters, recursion.state.acceleration)
