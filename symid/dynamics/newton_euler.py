"""Joint torques by recursion, with vectors or acceleration tensors: the forms that code is printed from.

And back: joint accelerations from torques, by the recursion over articulated bodies (`bodies`).

Recursion, parameters {(link, name): value}, for control also reference rates -> joint torques without
friction. A parameter that is not listed is zero and costs nothing. With

    U = [dw x] + [w x][w x],   or with reference rates U = [dw_r x] + [w_r x][w x],

f = U MS and n = I dw + w x I w share the products w_i w_j: fewer operations than with vectors. Reference
rates give M ddqr + C dqr with the Christoffel factor C (Echeandia and Wensing 2021).

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side, springs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Generic, NamedTuple

from symid.dynamics.algebra import Algebra, Matrix, T, Vector
from symid.dynamics.bodies import Body, Parameters, add_drive_torques, gather_body, solve_articulated_bodies
from symid.dynamics.recursion import (
    Recursion,
    Screw,
    Wrench,
    add_wrenches,
    compute_motions,
    rotate_to_link,
    transform_wrench,
)

Reference = tuple[tuple[T, ...], tuple[T, ...]]
"""Reference velocities and accelerations of the joints, dqr and ddqr."""


def accumulate_wrenches(recursion: Recursion[T], wrenches: Sequence[Wrench[T]]) -> list[Wrench[T]]:
    """Return what every link carries: its own wrench and those of all links beyond it, in its frame."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    carried = list(wrenches)
    for joint in reversed(range(robot.size)):
        parent = robot.joints[joint].parent
        if parent >= 0:
            lifted = transform_wrench(algebra, frames[joint], carried[joint])
            carried[parent] = add_wrenches(algebra, carried[parent], lifted)
    return carried


def accumulate_torques(recursion: Recursion[T], wrenches: Sequence[Wrench[T]]) -> list[T]:
    """Return what every joint carries of the wrenches of its link and all links beyond it."""
    carried = zip(accumulate_wrenches(recursion, wrenches), recursion.frames, strict=True)
    return [wrench.moment[2] if frame.revolute else wrench.force[2] for wrench, frame in carried]


def compute_inverse_dynamics(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[T, ...]:
    """Return the joint torques without friction (Luh, Walker and Paul 1980), by Newton and Euler.

    dw_j = R' dw_p + w x z dq + z ddq;  a_j = R' (a_p + dw_p x r + w_p x (w_p x r)) (+ 2 w x z dq + z ddq),
    the bracket at prismatic joints only, gravity subtracted;
    f = M a + dw x MS + w x (w x MS);  n = I dw + w x (I w) + MS x a.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    motions, zero = recursion.motions, algebra.zero
    still = Screw(angular=(zero, zero, zero), linear=compute_base_acceleration(recursion))
    result: list[Screw[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        w_parent = motions[joint.parent].angular if joint.parent >= 0 else (zero, zero, zero)
        parent = result[joint.parent] if joint.parent >= 0 else still
        swing = algebra.cross(w_parent, algebra.cross(w_parent, frame.origin))
        turned = algebra.add_vectors(algebra.cross(parent.angular, frame.origin), swing)
        linear = rotate_to_link(algebra, frame, algebra.add_vectors(parent.linear, turned))
        angular = rotate_to_link(algebra, frame, parent.angular)
        axis_rate: Vector[T] = (zero, zero, state.velocity[index])
        own: Vector[T] = (zero, zero, state.acceleration[index])
        coupling = algebra.cross(motions[index].angular, axis_rate)
        if frame.revolute:
            angular = algebra.add_vectors(angular, coupling, own)
        else:
            linear = algebra.add_vectors(linear, coupling, coupling, own)
        result.append(Screw(angular=angular, linear=linear))
    wrenches = []
    for link, (motion, acceleration) in enumerate(zip(motions, result, strict=True)):
        tensor, moments, mass = gather_body(algebra, parameters, link)
        w, dw, a = motion.angular, acceleration.angular, acceleration.linear
        swing = algebra.cross(w, algebra.cross(w, moments))
        force = algebra.add_vectors(algebra.scale_vector(mass, a), algebra.cross(dw, moments), swing)
        spin = algebra.cross(w, algebra.apply_matrix(tensor, w))
        moment = algebra.add_vectors(algebra.apply_matrix(tensor, dw), spin, algebra.cross(moments, a))
        wrenches.append(Wrench(force=force, moment=moment))
    torques = accumulate_torques(recursion, wrenches)
    return add_drive_torques(recursion, torques, parameters, state.acceleration)


class AccelerationTensor(NamedTuple, Generic[T]):
    """The motion of a link in its own frame, gravity subtracted from `linear` (rad/s, rad/s^2, m/s^2).

    `rate` is dw, or dw_r; the off-diagonal entries of `tensor` are `products` plus and minus `axial`, which
    without a reference are w_y w_z, w_x w_z, w_x w_y and dw; `differences` are U_yy - U_zz, U_zz - U_xx,
    U_xx - U_yy.
    """

    rate: Vector[T]
    linear: Vector[T]
    tensor: Matrix[T]
    axial: Vector[T]
    products: Vector[T]
    differences: Vector[T]


def compute_base_acceleration(recursion: Recursion[T]) -> Vector[T]:
    """Return -g: gravity as an acceleration of the base."""
    algebra = recursion.algebra
    x, y, z = (algebra.neg(algebra.constant(value)) for value in recursion.robot.gravity)
    return (x, y, z)


def _build_acceleration_tensor(
    algebra: Algebra[T],
    turns: tuple[Vector[T], Vector[T] | None],
    rate: Vector[T],
    linear: Vector[T],
    column: Vector[T] | None,
) -> AccelerationTensor[T]:
    """Return the motion of a link from w and w_r (None without a reference), and U z where it is known."""
    plus, minus, mul, neg = algebra.add, algebra.sub, algebra.mul, algebra.neg
    (x, y, z), (rx, ry, rz) = turns[0], turns[1] or turns[0]
    xz, yz, yy, zz = mul(x, rz), mul(y, rz), mul(y, ry), mul(z, rz)
    ahead, along = plus(yy, zz), minus(yy, zz)
    if column is None:
        around = plus(mul(x, rx), yy)
        column = (plus(xz, rate[1]), minus(yz, rate[0]), neg(around))
    else:
        around = neg(column[2])
        rate = (minus(yz, column[1]), minus(column[0], xz), rate[2])
    beside = minus(around, along)
    tensor = (
        (neg(ahead), minus(mul(x, ry), rate[2]), column[0]),
        (plus(mul(y, rx), rate[2]), neg(beside), column[1]),
        (minus(mul(z, rx), rate[1]), plus(mul(z, ry), rate[0]), column[2]),
    )
    differences = (along, minus(ahead, around), minus(beside, ahead))
    if turns[1] is None:
        axial, products = rate, (mul(y, z), mul(x, z), mul(x, y))
    else:
        pairs = ((tensor[2][1], tensor[1][2]), (tensor[0][2], tensor[2][0]), (tensor[1][0], tensor[0][1]))
        x, y, z = (algebra.half(minus(low, high)) for low, high in pairs)
        yz, xz, xy = (algebra.half(plus(low, high)) for low, high in pairs)
        axial, products = (x, y, z), (yz, xz, xy)
    return AccelerationTensor(rate, linear, tensor, axial, products, differences)


def compute_acceleration_tensors(
    recursion: Recursion[T], reference: Reference[T] | None = None
) -> tuple[AccelerationTensor[T], ...]:
    """Return the acceleration tensor of every link.

    U_j z = R' (U_p z_p), where that is known;  dw_j z = dw_p z_p + ddq;
    a_j = R' (a_p + U_p r) (+ 2 w x z dq + z ddq if prismatic).
    `reference` replaces dq and ddq in what is differentiated; None for themselves.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    rates, accelerations = reference or (state.velocity, state.acceleration)
    others = compute_motions(robot, algebra, recursion.frames, rates) if reference else recursion.motions
    zero = algebra.zero
    none = (zero, zero, zero)
    start = compute_base_acceleration(recursion)
    base = AccelerationTensor(none, start, (none, none, none), none, none, none)
    spins: list[AccelerationTensor[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        parent = spins[joint.parent] if joint.parent >= 0 else base
        own: Vector[T] = (zero, zero, accelerations[index])
        angular, turning = recursion.motions[index].angular, (zero, zero, rates[index])
        rate = rotate_to_link(algebra, frame, parent.rate)
        if frame.revolute:
            rate = algebra.add_vectors(rate, algebra.cross(angular, turning), own)
        swing = algebra.apply_matrix(parent.tensor, frame.origin)
        linear = rotate_to_link(algebra, frame, algebra.add_vectors(parent.linear, swing))
        column: Vector[T] | None = None
        if not frame.revolute:
            first = algebra.cross(angular, turning)
            second = algebra.cross(others[index].angular, (zero, zero, state.velocity[index]))
            linear = algebra.add_vectors(linear, first, second, own)
        elif sum(bool(row[2]) for row in joint.placement.rotation) == 1:
            # Where the axis is one of the parent's axes, its column of U is known.
            axis = (frame.fixed[0][2], frame.fixed[1][2], frame.fixed[2][2])
            column = rotate_to_link(algebra, frame, algebra.apply_matrix(parent.tensor, axis))
        turns = (angular, others[index].angular if reference else None)
        spins.append(_build_acceleration_tensor(algebra, turns, rate, linear, column))
    return tuple(spins)


def compute_link_wrench(algebra: Algebra[T], body: Body[T], spin: AccelerationTensor[T]) -> Wrench[T]:
    """Return the wrench that moves a body: f = M a + U MS, n = I dw + w x I w + MS x a."""
    mul, minus, neg, total = algebra.mul, algebra.sub, algebra.neg, algebra.sum_values
    tensor, moments, mass = body
    force = algebra.apply_matrix(spin.tensor, moments)
    # I dw + w x I w, with the moments of inertia collected by products of w.
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    u, (x, y, z), p, d = spin.tensor, spin.axial, spin.products, spin.differences
    terms = (mul(xx, x), neg(mul(xy, u[2][0])), mul(xz, u[1][0]), mul(yz, d[0]), mul(minus(zz, yy), p[0]))
    along = total(terms)
    terms = (mul(yy, y), mul(xy, u[2][1]), neg(mul(yz, u[0][1])), mul(xz, d[1]), mul(minus(xx, zz), p[1]))
    across = total(terms)
    terms = (mul(zz, z), neg(mul(xz, u[1][2])), mul(yz, u[0][2]), mul(xy, d[2]), mul(minus(yy, xx), p[2]))
    moment: Vector[T] = (along, across, total(terms))
    return Wrench(
        force=algebra.add_vectors(force, algebra.scale_vector(mass, spin.linear)),
        moment=algebra.add_vectors(moment, algebra.cross(moments, spin.linear)),
    )


def compute_link_wrenches(
    recursion: Recursion[T], parameters: Parameters[T], spins: Sequence[AccelerationTensor[T]]
) -> list[Wrench[T]]:
    """Return the wrench that moves each link."""
    bodies = (gather_body(recursion.algebra, parameters, link) for link in range(recursion.robot.size))
    return [compute_link_wrench(recursion.algebra, *pair) for pair in zip(bodies, spins, strict=True)]


def compute_tensor_torques(
    recursion: Recursion[T], parameters: Parameters[T], reference: Reference[T] | None = None
) -> tuple[T, ...]:
    """Return the joint torques without friction: f = M a + U MS, n = I dw + w x I w + MS x a.

    `reference`: dqr and ddqr for M ddqr + C dqr + g (see above); None for the state's own dq and ddq.
    """
    spins = compute_acceleration_tensors(recursion, reference)
    wrenches = compute_link_wrenches(recursion, parameters, spins)
    accelerations = reference[1] if reference else recursion.state.acceleration
    return add_drive_torques(recursion, accumulate_torques(recursion, wrenches), parameters, accelerations)


def compute_forward_dynamics(
    recursion: Recursion[T], parameters: Parameters[T], torques: Sequence[T], invert: Callable[[T], T]
) -> tuple[T, ...]:
    """Return the accelerations that the torques give to the joints without friction (Featherstone 1983).

    A torque a joint in N m (N), an acceleration a joint in rad/s^2 (m/s^2); operations grow with the
    number of joints. `invert` returns the inverse of a value.
    """
    algebra, still = recursion.algebra, (recursion.algebra.zero,) * recursion.robot.size
    resting = replace(recursion, state=replace(recursion.state, acceleration=still))
    wrenches = compute_link_wrenches(resting, parameters, compute_acceleration_tensors(resting))
    springs = add_drive_torques(resting, still, parameters, still)
    rest = list(map(algebra.sub, torques, springs))
    return solve_articulated_bodies(resting, parameters, rest, wrenches, invert)
