"""How every link turns and is accelerated, with the acceleration tensor of its turning.

Input: a recursion. Output: `Spin`: for each link w, dw, the acceleration of its origin and the tensor

    U = [dw x] + [w x][w x],

which takes a point of the link to its acceleration about the origin. U carries both the first moments
(f = U MS) and the inertia tensor (n = I dw + w x I w) with the same six products w_i w_j.

The column of U along a joint's axis is the same on both sides of the joint: it is turned from the
parent's, and dw follows from it with one sum an entry. Its axial entry is -(w_x^2 + w_y^2), so that
one square less is needed.

Supported: trees of revolute and prismatic joints.
"""

from dataclasses import dataclass
from typing import Generic

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Matrix, Vector, add, cross, multiply
from symid.dynamics.kinematics import Frame, Recursion, lower_vector
from symid.robot.description import Joint

__all__ = ["Spin", "find_spins", "lift_gravity"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spin(Generic[T]):
    """The motion of a link in its own frame, gravity subtracted from `linear` (rad/s, rad/s^2, m/s^2).

    `products` are w_y w_z, w_x w_z, w_x w_y; `differences` w_y^2 - w_z^2, w_z^2 - w_x^2, w_x^2 - w_y^2.
    """

    angular: Vector[T]
    rate: Vector[T]
    linear: Vector[T]
    tensor: Matrix[T]
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


def _build_spin(
    algebra: Algebra[T],
    angular: Vector[T],
    rate: Vector[T],
    linear: Vector[T],
    column: Vector[T] | None,
) -> Spin[T]:
    plus, minus, mul, neg = algebra.add, algebra.sub, algebra.mul, algebra.neg
    x, y, z = angular
    yz, xz, xy = products = (mul(y, z), mul(x, z), mul(x, y))
    yy, zz = mul(y, y), mul(z, z)
    ahead, along = plus(yy, zz), minus(yy, zz)
    if column is None:
        around = plus(mul(x, x), yy)
        axial = (plus(xz, rate[1]), minus(yz, rate[0]), neg(around))
    else:
        around = neg(column[2])
        axial = column
        rate = (minus(yz, column[1]), minus(column[0], xz), rate[2])
    beside = minus(around, along)
    return Spin(
        angular=angular,
        rate=rate,
        linear=linear,
        tensor=(
            (neg(ahead), minus(xy, rate[2]), axial[0]),
            (plus(xy, rate[2]), neg(beside), axial[1]),
            (minus(xz, rate[1]), plus(yz, rate[0]), axial[2]),
        ),
        products=products,
        differences=(along, minus(ahead, around), minus(beside, ahead)),
    )


def _find_linear(recursion: Recursion[T], joint: int, frame: Frame[T], parent: Spin[T]) -> Vector[T]:
    algebra = recursion.algebra
    swing = multiply(algebra, parent.tensor, frame.origin)
    linear = lower_vector(algebra, frame, add(algebra, parent.linear, swing))
    if frame.revolute:
        return linear
    zero, state = algebra.zero, recursion.state
    angular = recursion.motions[joint].angular
    coupling = cross(algebra, angular, (zero, zero, state.velocity[joint]))
    own: Vector[T] = (zero, zero, state.acceleration[joint])
    return add(algebra, add(algebra, add(algebra, linear, coupling), coupling), own)


def find_spins(recursion: Recursion[T]) -> tuple[Spin[T], ...]:
    """Return the spin of every link.

    U_j z = R' (U_p z_p);  dw_j z = dw_p z_p + ddq;
    a_j = R' (a_p + U_p r) (+ 2 w x z dq + z ddq if prismatic).
    """
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    zero = algebra.zero
    none = (zero, zero, zero)
    base = Spin(
        angular=none,
        rate=none,
        linear=lift_gravity(recursion),
        tensor=(none, none, none),
        products=none,
        differences=none,
    )
    spins: list[Spin[T]] = []
    for index, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        parent = spins[joint.parent] if joint.parent >= 0 else base
        angular = recursion.motions[index].angular
        rate = lower_vector(algebra, frame, parent.rate)
        column = None
        if frame.revolute:
            coupling = cross(algebra, angular, (zero, zero, state.velocity[index]))
            own: Vector[T] = (zero, zero, state.acceleration[index])
            rate = add(algebra, add(algebra, rate, coupling), own)
            if _is_along_axis(joint):
                axis = (frame.fixed[0][2], frame.fixed[1][2], frame.fixed[2][2])
                column = lower_vector(algebra, frame, multiply(algebra, parent.tensor, axis))
        linear = _find_linear(recursion, index, frame, parent)
        spins.append(_build_spin(algebra, angular, rate, linear, column))
    return tuple(spins)
