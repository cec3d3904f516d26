"""How every link turns and is accelerated, with the acceleration tensor of its turning.

Input: a recursion, for control also reference rates. Output: `Spin`: for each link w, dw, the acceleration
of its origin and the tensor

    U = [dw x] + [w x][w x],

which takes a point of the link to its acceleration about the origin. U carries both the first moments
(f = U MS) and the inertia tensor (n = I dw + w x I w) with the same six products w_i w_j.

With reference rates dqr, which make the velocities w_r, v_r, the same tensor of their rate of change at a
point that moves with the link is U = [dw_r x] + [w_r x][w x]. The torques that follow from it are
M ddqr + C dqr with C_ij = sum of c_ijk dq_k, c_ijk the Christoffel symbols of the mass matrix: the product of
a point's mass, its Jacobian and the rate of its Jacobian (Echeandia and Wensing 2021).

The column of U along a joint's axis is the same on both sides of the joint: it is turned from the
parent's, and dw follows from it with one sum an entry. Its axial entry is -(w_x^2 + w_y^2), so that
one square less is needed.

Supported: trees of revolute and prismatic joints.
"""

from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Matrix, Vector, add, cross, multiply
from symid.dynamics.kinematics import Motion, Recursion, find_motions, lower_vector
from symid.robot.description import Joint

__all__ = ["Reference", "Spin", "find_spins", "lift_gravity"]

Reference = tuple[tuple[T, ...], tuple[T, ...]]
"""Reference velocities and accelerations of the joints, dqr and ddqr."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spin(Generic[T]):
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


def lift_gravity(recursion: Recursion[T]) -> Vector[T]:
    """Return the acceleration of the base that stands for gravity, -g."""
    algebra = recursion.algebra
    x, y, z = (algebra.neg(algebra.constant(value)) for value in recursion.robot.gravity)
    return (x, y, z)


def _is_along_axis(joint: Joint) -> bool:
    """Return whether the joint's axis is one of the parent's axes, so that a column of U is known."""
    return sum(bool(row[2]) for row in joint.placement.rotation) == 1


def _find_tensor(
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


def _build_spin(
    algebra: Algebra[T],
    turns: tuple[Vector[T], Vector[T] | None],
    rate: Vector[T],
    linear: Vector[T],
    column: Vector[T] | None,
) -> Spin[T]:
    angular, other = turns
    tensor, rate, differences = _find_tensor(
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
    return Spin(
        rate=rate, linear=linear, tensor=tensor, axial=axial, products=products, differences=differences
    )


def _find_linear(
    recursion: Recursion[T],
    joint: int,
    parent: Spin[T],
    others: tuple[Motion[T], ...],
    reference: Reference[T],
) -> Vector[T]:
    algebra, frame, zero = recursion.algebra, recursion.frames[joint], recursion.algebra.zero
    swing = multiply(algebra, parent.tensor, frame.origin)
    linear = lower_vector(algebra, frame, add(algebra, parent.linear, swing))
    if frame.revolute:
        return linear
    rates, accelerations = reference
    first = cross(algebra, recursion.motions[joint].angular, (zero, zero, rates[joint]))
    second = cross(algebra, others[joint].angular, (zero, zero, recursion.state.velocity[joint]))
    own: Vector[T] = (zero, zero, accelerations[joint])
    return add(algebra, add(algebra, add(algebra, linear, first), second), own)


def _find_rate(recursion: Recursion[T], joint: int, parent: Spin[T], reference: Reference[T]) -> Vector[T]:
    algebra, frame, zero = recursion.algebra, recursion.frames[joint], recursion.algebra.zero
    rate = lower_vector(algebra, frame, parent.rate)
    if not frame.revolute:
        return rate
    rates, accelerations = reference
    coupling = cross(algebra, recursion.motions[joint].angular, (zero, zero, rates[joint]))
    own: Vector[T] = (zero, zero, accelerations[joint])
    return add(algebra, add(algebra, rate, coupling), own)


def _find_column(recursion: Recursion[T], joint: int, parent: Spin[T]) -> Vector[T] | None:
    algebra, frame = recursion.algebra, recursion.frames[joint]
    if not (frame.revolute and _is_along_axis(recursion.robot.joints[joint])):
        return None
    axis = (frame.fixed[0][2], frame.fixed[1][2], frame.fixed[2][2])
    return lower_vector(algebra, frame, multiply(algebra, parent.tensor, axis))


def find_spins(recursion: Recursion[T], reference: Reference[T] | None = None) -> tuple[Spin[T], ...]:
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
        others = find_motions(robot, algebra, recursion.frames, reference[0])
    none = (algebra.zero,) * 3
    base = Spin(
        rate=none,
        linear=lift_gravity(recursion),
        tensor=(none, none, none),
        axial=none,
        products=none,
        differences=none,
    )
    spins: list[Spin[T]] = []
    for index, joint in enumerate(robot.joints):
        parent = spins[joint.parent] if joint.parent >= 0 else base
        spins.append(
            _build_spin(
                algebra,
                (recursion.motions[index].angular, others[index].angular if reference else None),
                _find_rate(recursion, index, parent, chosen),
                _find_linear(recursion, index, parent, others, chosen),
                _find_column(recursion, index, parent),
            )
        )
    return tuple(spins)
