"""Torques and regressor columns from acceleration tensors: fewer operations than vector by vector.

Input: spins of the links, parameters or their names. Output: wrenches of links, joint torques.

Per unit of each parameter the inertial wrench of a link is an entry or a column of what `Spin` holds:
    XX: n = (dw_x, w_x w_z, -w_x w_y)       XY: n = (-U_zx, U_zy, w_x^2 - w_y^2)       and so on,
    MX: f = U x, n = x x a.

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side, springs.
"""

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Vector, add, cross, multiply, scale, total
from symid.dynamics.composite import Body, Parameters, gather_body
from symid.dynamics.drives import add_drive_torques
from symid.dynamics.kinematics import Recursion
from symid.dynamics.newton_euler import carry_down
from symid.dynamics.spins import Reference, Spin, find_spins
from symid.dynamics.wrenches import Wrench
from symid.notation import INERTIAL

__all__ = ["find_spin_wrench", "find_tensor_torques"]


def find_spin_wrench(algebra: Algebra[T], name: str, spin: Spin[T]) -> Wrench[T]:
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
    one = algebra.one
    axis = (one if k == 0 else zero, one if k == 1 else zero, one if k == 2 else zero)
    return Wrench(force=(u[0][k], u[1][k], u[2][k]), moment=cross(algebra, axis, spin.linear))


def _find_moment(algebra: Algebra[T], tensor: tuple[tuple[T, T, T], ...], spin: Spin[T]) -> Vector[T]:
    """Return I dw + w x I w, the moments of inertia that meet the same product of w taken together."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    mul, minus, neg = algebra.mul, algebra.sub, algebra.neg
    u, (x, y, z), p, d = spin.tensor, spin.axial, spin.products, spin.differences
    return (
        total(
            algebra,
            [mul(xx, x), neg(mul(xy, u[2][0])), mul(xz, u[1][0]), mul(yz, d[0]), mul(minus(zz, yy), p[0])],
        ),
        total(
            algebra,
            [mul(yy, y), mul(xy, u[2][1]), neg(mul(yz, u[0][1])), mul(xz, d[1]), mul(minus(xx, zz), p[1])],
        ),
        total(
            algebra,
            [mul(zz, z), neg(mul(xz, u[1][2])), mul(yz, u[0][2]), mul(xy, d[2]), mul(minus(yy, xx), p[2])],
        ),
    )


def _find_wrench(algebra: Algebra[T], body: Body[T], spin: Spin[T]) -> Wrench[T]:
    tensor, moments, mass = body
    force = multiply(algebra, spin.tensor, moments)
    moment = _find_moment(algebra, tensor, spin)
    return Wrench(
        force=add(algebra, force, scale(algebra, mass, spin.linear)),
        moment=add(algebra, moment, cross(algebra, moments, spin.linear)),
    )


def find_tensor_torques(
    recursion: Recursion[T], parameters: Parameters[T], reference: Reference[T] | None = None
) -> tuple[T, ...]:
    """Return the joint torques without friction: f = M a + U MS, n = I dw + w x I w + MS x a.

    Args:
        recursion: the robot in its state.
        parameters: values of the parameters.
        reference: dqr and ddqr for M ddqr + C dqr + g (see `spins`); None for the state's own dq and ddq.
    """
    algebra = recursion.algebra
    wrenches = [
        _find_wrench(algebra, gather_body(algebra, parameters, link), spin)
        for link, spin in enumerate(find_spins(recursion, reference))
    ]
    accelerations = reference[1] if reference else recursion.state.acceleration
    return add_drive_torques(recursion, carry_down(recursion, wrenches), parameters, accelerations)
