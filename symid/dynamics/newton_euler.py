"""Joint torques by recursion, with vectors or acceleration tensors: the forms that code is printed from.

Recursion, parameters {(link, name): value}, for control also reference rates -> joint torques without
friction.
A parameter that is not listed is zero and costs nothing. With base parameters the value of beta stands at
its representative and all grouped parameters are left out: the torques are the same.

Acceleration tensors take fewer operations than vectors: for each link w, dw, the acceleration of its origin
and

    U = [dw x] + [w x][w x],

which takes a point of the link to its acceleration about the origin. U carries both the first moments (f =
U MS) and the inertia tensor (n = I dw + w x I w) with the same six products w_i w_j. Per unit of each
parameter the inertial wrench of a link is an entry or a column of it:
    XX: n = (dw_x, w_x w_z, -w_x w_y)       XY: n = (-U_zx, U_zy, w_x^2 - w_y^2)       and so on,
    MX: f = U x, n = x x a.

With reference rates dqr, which make the velocities w_r, v_r, the same tensor of their rate of change at a
point that moves with the link is U = [dw_r x] + [w_r x][w x]. The torques that follow from it are M ddqr +
C dqr with C_ij = sum of c_ijk dq_k, c_ijk the Christoffel symbols of the mass matrix: the product of a
point's mass, its Jacobian and the rate of its Jacobian (Echeandia and Wensing 2021).

The column of U along a joint's axis is the same on both sides of the joint: it is rotated from the
parent's, and dw follows from it with one sum an entry. Its axial entry is -(w_x^2 + w_y^2), so that one
square less is needed.

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side, springs.
"""

from dataclasses import dataclass
from typing import Generic

from symid.dynamics.algebra import (
    Algebra,
    Matrix,
    T,
    Vector,
    add_vectors,
    apply_matrix,
    cross,
    scale_vector,
    sum_values,
)
from symid.dynamics.bodies import Body, Parameters, add_drive_torques, gather_body
from symid.dynamics.recursion import LinkMotion, Recursion, compute_motions, rotate_to_link
from symid.dynamics.wrenches import (
    LinkAcceleration,
    Wrench,
    add_wrenches,
    build_unit_vector,
    project_on_axis,
    transform_wrench,
)
from symid.notation import INERTIAL
from symid.robot import Joint


def compute_accelerations(recursion: Recursion[T]) -> tuple[LinkAcceleration[T], ...]:
    """Return the acceleration of every link, gravity subtracted.

    dw_j = R' dw_p + w x z dq + z ddq;  a_j = R' (a_p + dw_p x r + w_p x (w_p x r)) (+ 2 w x z dq + z ddq),
    the bracket at prismatic joints only. Luh, Walker and Paul 1980.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    motions = recursion.motions
    zero = algebra.zero
    still = LinkAcceleration(angular=(zero, zero, zero), linear=compute_base_acceleration(recursion))
    result: list[LinkAcceleration[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        w_parent = motions[joint.parent].angular if joint.parent >= 0 else (zero, zero, zero)
        parent = result[joint.parent] if joint.parent >= 0 else still
        swing = cross(algebra, w_parent, cross(algebra, w_parent, frame.origin))
        turned = add_vectors(algebra, cross(algebra, parent.angular, frame.origin), swing)
        linear = rotate_to_link(algebra, frame, add_vectors(algebra, parent.linear, turned))
        angular = rotate_to_link(algebra, frame, parent.angular)
        axis_rate: Vector[T] = (zero, zero, state.velocity[index])
        own: Vector[T] = (zero, zero, state.acceleration[index])
        coupling = cross(algebra, motions[index].angular, axis_rate)
        if frame.revolute:
            angular = add_vectors(algebra, add_vectors(algebra, angular, coupling), own)
        else:
            linear = add_vectors(
                algebra, add_vectors(algebra, add_vectors(algebra, linear, coupling), coupling), own
            )
        result.append(LinkAcceleration(angular=angular, linear=linear))
    return tuple(result)


def _compute_link_wrench(
    algebra: Algebra[T],
    body: Body[T],
    angular: Vector[T],
    acceleration: LinkAcceleration[T],
) -> Wrench[T]:
    """Return the wrench that moves a link.

    f = M a + dw x MS + w x (w x MS);  n = I dw + w x (I w) + MS x a   (Newton and Euler).
    """
    tensor, moments, mass = body
    swing = cross(algebra, angular, cross(algebra, angular, moments))
    force = add_vectors(
        algebra,
        scale_vector(algebra, mass, acceleration.linear),
        cross(algebra, acceleration.angular, moments),
    )
    spin = cross(algebra, angular, apply_matrix(algebra, tensor, angular))
    moment = add_vectors(algebra, apply_matrix(algebra, tensor, acceleration.angular), spin)
    return Wrench(
        force=add_vectors(algebra, force, swing),
        moment=add_vectors(algebra, moment, cross(algebra, moments, acceleration.linear)),
    )


def accumulate_torques(recursion: Recursion[T], wrenches: list[Wrench[T]]) -> list[T]:
    """Return what every joint carries of the wrenches of its link and all links beyond it."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    carried = list(wrenches)
    torques = [algebra.zero] * robot.size
    for joint in reversed(range(robot.size)):
        torques[joint] = project_on_axis(frames[joint], carried[joint])
        parent = robot.joints[joint].parent
        if parent >= 0:
            lifted = transform_wrench(algebra, frames[joint], carried[joint])
            carried[parent] = add_wrenches(algebra, carried[parent], lifted)
    return torques


def compute_inverse_dynamics(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[T, ...]:
    """Return the joint torques without friction (Luh, Walker and Paul 1980)."""
    algebra, motions = recursion.algebra, recursion.motions
    wrenches = [
        _compute_link_wrench(
            algebra, gather_body(algebra, parameters, link), motions[link].angular, acceleration
        )
        for link, acceleration in enumerate(compute_accelerations(recursion))
    ]
    torques = accumulate_torques(recursion, wrenches)
    return add_drive_torques(recursion, torques, parameters, recursion.state.acceleration)


Reference = tuple[tuple[T, ...], tuple[T, ...]]
"""Reference velocities and accelerations of the joints, dqr and ddqr."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AccelerationTensor(Generic[T]):
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
    """Return the acceleration of the base that stands for gravity, -g."""
    algebra = recursion.algebra
    x, y, z = (algebra.neg(algebra.constant(value)) for value in recursion.robot.gravity)
    return (x, y, z)


def _is_along_axis(joint: Joint) -> bool:
    """Return whether the joint's axis is one of the parent's axes, so that a column of U is known."""
    return sum(bool(row[2]) for row in joint.placement.rotation) == 1


def _compute_tensor(
    algebra: Algebra[T], angular: Vector[T], other: Vector[T], rate: Vector[T], column: Vector[T] | None
) -> tuple[Matrix[T], Vector[T], Vector[T]]:
    """Return U, the rate and the differences of U's diagonal; `column` is U z where it is known."""
    plus, minus, mul, neg = algebra.add, algebra.sub, algebra.mul, algebra.neg
    (x, y, z), (rx, ry, rz) = angular, other
    xz, yz, yy, zz = mul(x, rz), mul(y, rz), mul(y, ry), mul(z, rz)
    ahead, along = plus(yy, zz), minus(yy, zz)
    if column is None:
        around = plus(mul(x, rx), yy)
        axial = (plus(xz, rate[1]), minus(yz, rate[0]), neg(around))
    else:
        around, axial = neg(column[2]), column
        rate = (minus(yz, column[1]), minus(column[0], xz), rate[2])
    beside = minus(around, along)
    tensor = (
        (neg(ahead), minus(mul(x, ry), rate[2]), axial[0]),
        (plus(mul(y, rx), rate[2]), neg(beside), axial[1]),
        (minus(mul(z, rx), rate[1]), plus(mul(z, ry), rate[0]), axial[2]),
    )
    return tensor, rate, (along, minus(ahead, around), minus(beside, ahead))


def _build_acceleration_tensor(
    algebra: Algebra[T],
    turns: tuple[Vector[T], Vector[T] | None],
    rate: Vector[T],
    linear: Vector[T],
    column: Vector[T] | None,
) -> AccelerationTensor[T]:
    angular, other = turns
    tensor, rate, differences = _compute_tensor(
        algebra, angular, angular if other is None else other, rate, column
    )
    x, y, z = angular
    axial, products = rate, (algebra.mul(y, z), algebra.mul(x, z), algebra.mul(x, y))
    if other is not None:
        pairs = (
            (tensor[2][1], tensor[1][2]),
            (tensor[0][2], tensor[2][0]),
            (tensor[1][0], tensor[0][1]),
        )
        x, y, z = (algebra.half(algebra.sub(low, high)) for low, high in pairs)
        yz, xz, xy = (algebra.half(algebra.add(low, high)) for low, high in pairs)
        axial, products = (x, y, z), (yz, xz, xy)
    return AccelerationTensor(
        rate=rate, linear=linear, tensor=tensor, axial=axial, products=products, differences=differences
    )


def _compute_linear_acceleration(
    recursion: Recursion[T],
    joint: int,
    parent: AccelerationTensor[T],
    others: tuple[LinkMotion[T], ...],
    reference: Reference[T],
) -> Vector[T]:
    algebra, frame, zero = recursion.algebra, recursion.frames[joint], recursion.algebra.zero
    swing = apply_matrix(algebra, parent.tensor, frame.origin)
    linear = rotate_to_link(algebra, frame, add_vectors(algebra, parent.linear, swing))
    if frame.revolute:
        return linear
    rates, accelerations = reference
    first = cross(algebra, recursion.motions[joint].angular, (zero, zero, rates[joint]))
    second = cross(algebra, others[joint].angular, (zero, zero, recursion.state.velocity[joint]))
    own: Vector[T] = (zero, zero, accelerations[joint])
    return add_vectors(algebra, add_vectors(algebra, add_vectors(algebra, linear, first), second), own)


def _compute_angular_acceleration(
    recursion: Recursion[T], joint: int, parent: AccelerationTensor[T], reference: Reference[T]
) -> Vector[T]:
    algebra, frame, zero = recursion.algebra, recursion.frames[joint], recursion.algebra.zero
    rate = rotate_to_link(algebra, frame, parent.rate)
    if not frame.revolute:
        return rate
    rates, accelerations = reference
    coupling = cross(algebra, recursion.motions[joint].angular, (zero, zero, rates[joint]))
    own: Vector[T] = (zero, zero, accelerations[joint])
    return add_vectors(algebra, add_vectors(algebra, rate, coupling), own)


def _compute_axis_column(
    recursion: Recursion[T], joint: int, parent: AccelerationTensor[T]
) -> Vector[T] | None:
    algebra, frame = recursion.algebra, recursion.frames[joint]
    if not (frame.revolute and _is_along_axis(recursion.robot.joints[joint])):
        return None
    axis = (frame.fixed[0][2], frame.fixed[1][2], frame.fixed[2][2])
    return rotate_to_link(algebra, frame, apply_matrix(algebra, parent.tensor, axis))


def compute_acceleration_tensors(
    recursion: Recursion[T], reference: Reference[T] | None = None
) -> tuple[AccelerationTensor[T], ...]:
    """Return the spin of every link.

    U_j z = R' (U_p z_p);  dw_j z = dw_p z_p + ddq;
    a_j = R' (a_p + U_p r) (+ 2 w x z dq + z ddq if prismatic).

    Args:
        recursion: the robot in its state.
        reference: what replaces dq and ddq in what is differentiated; None for themselves.
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    chosen = reference or (state.velocity, state.acceleration)
    others = recursion.motions
    if reference:
        others = compute_motions(robot, algebra, recursion.frames, reference[0])
    none = (algebra.zero,) * 3
    base = AccelerationTensor(
        rate=none,
        linear=compute_base_acceleration(recursion),
        tensor=(none, none, none),
        axial=none,
        products=none,
        differences=none,
    )
    spins: list[AccelerationTensor[T]] = []
    for index, joint in enumerate(robot.joints):
        parent = spins[joint.parent] if joint.parent >= 0 else base
        spins.append(
            _build_acceleration_tensor(
                algebra,
                (recursion.motions[index].angular, others[index].angular if reference else None),
                _compute_angular_acceleration(recursion, index, parent, chosen),
                _compute_linear_acceleration(recursion, index, parent, others, chosen),
                _compute_axis_column(recursion, index, parent),
            )
        )
    return tuple(spins)


def compute_tensor_wrench(algebra: Algebra[T], name: str, spin: AccelerationTensor[T]) -> Wrench[T]:
    """Return the wrench that moves a link, per unit of one parameter."""
    zero, neg = algebra.zero, algebra.neg
    none = (zero, zero, zero)
    if name == "M":
        return Wrench(force=spin.linear, moment=none)
    u = spin.tensor
    (x, y, z), (yz, xz, xy), d = spin.axial, spin.products, spin.differences
    moments: dict[str, Vector[T]] = {
        "XX": (x, xz, neg(xy)),
        "XY": (neg(u[2][0]), u[2][1], d[2]),
        "XZ": (u[1][0], d[1], neg(u[1][2])),
        "YY": (neg(yz), y, xy),
        "YZ": (d[0], neg(u[0][1]), u[0][2]),
        "ZZ": (yz, neg(xz), z),
    }
    if name in moments:
        return Wrench(force=none, moment=moments[name])
    k = INERTIAL.index(name) - INERTIAL.index("MX")
    moment = cross(algebra, build_unit_vector(algebra, k), spin.linear)
    return Wrench(force=(u[0][k], u[1][k], u[2][k]), moment=moment)


def _compute_tensor_moment(
    algebra: Algebra[T], tensor: tuple[tuple[T, T, T], ...], spin: AccelerationTensor[T]
) -> Vector[T]:
    """Return I dw + w x I w, the moments of inertia that meet the same product of w taken together."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    mul, minus, neg = algebra.mul, algebra.sub, algebra.neg
    u, (x, y, z), p, d = spin.tensor, spin.axial, spin.products, spin.differences
    return (
        sum_values(
            algebra,
            [mul(xx, x), neg(mul(xy, u[2][0])), mul(xz, u[1][0]), mul(yz, d[0]), mul(minus(zz, yy), p[0])],
        ),
        sum_values(
            algebra,
            [mul(yy, y), mul(xy, u[2][1]), neg(mul(yz, u[0][1])), mul(xz, d[1]), mul(minus(xx, zz), p[1])],
        ),
        sum_values(
            algebra,
            [mul(zz, z), neg(mul(xz, u[1][2])), mul(yz, u[0][2]), mul(xy, d[2]), mul(minus(yy, xx), p[2])],
        ),
    )


def _compute_body_wrench(algebra: Algebra[T], body: Body[T], spin: AccelerationTensor[T]) -> Wrench[T]:
    tensor, moments, mass = body
    force = apply_matrix(algebra, spin.tensor, moments)
    moment = _compute_tensor_moment(algebra, tensor, spin)
    return Wrench(
        force=add_vectors(algebra, force, scale_vector(algebra, mass, spin.linear)),
        moment=add_vectors(algebra, moment, cross(algebra, moments, spin.linear)),
    )


def compute_tensor_torques(
    recursion: Recursion[T], parameters: Parameters[T], reference: Reference[T] | None = None
) -> tuple[T, ...]:
    """Return the joint torques without friction: f = M a + U MS, n = I dw + w x I w + MS x a.

    Args:
        recursion: the robot in its state.
        parameters: values of the parameters.
        reference: dqr and ddqr for M ddqr + C dqr + g (see above); None for the state's own dq and ddq.
    """
    algebra = recursion.algebra
    wrenches = [
        _compute_body_wrench(algebra, gather_body(algebra, parameters, link), spin)
        for link, spin in enumerate(compute_acceleration_tensors(recursion, reference))
    ]
    accelerations = reference[1] if reference else recursion.state.acceleration
    return add_drive_torques(recursion, accumulate_torques(recursion, wrenches), parameters, accelerations)
