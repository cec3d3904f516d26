"""Bodies and the mass matrix: links put together from the tip to the base.

Input: a recursion, parameters per link. Output: inertia tensor, first moments and mass of a link as
its parent sees them; the joint-space mass matrix.

Parameters are given as {(link, name): value}; one that is not listed is zero and costs nothing.
"""

from collections.abc import Mapping

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Matrix, Vector, add, dot, multiply_matrices, scale
from symid.dynamics.drives import add_drive_inertia
from symid.dynamics.kinematics import Frame, Recursion, lift_vector
from symid.dynamics.screws import carry_screws, find_axis_screws
from symid.dynamics.wrenches import Meeting, Wrench, project_wrench

__all__ = ["Body", "Parameters", "find_mass_matrix", "gather_body", "lift_body", "turn_tensor"]

Parameters = Mapping[tuple[int, str], T]
Body = tuple[Matrix[T], Vector[T], T]
"""Inertia tensor about the link frame's origin (kg m^2), first moments (kg m), mass (kg)."""


def gather_body(algebra: Algebra[T], parameters: Parameters[T], link: int) -> Body[T]:
    """Return inertia tensor, first moments and mass of a link."""

    def take(name: str) -> T:
        return parameters.get((link, name), algebra.zero)

    xy, xz, yz = take("XY"), take("XZ"), take("YZ")
    tensor = ((take("XX"), xy, xz), (xy, take("YY"), yz), (xz, yz, take("ZZ")))
    return tensor, (take("MX"), take("MY"), take("MZ")), take("M")


def turn_tensor(algebra: Algebra[T], turn: tuple[T, T], tensor: Matrix[T]) -> Matrix[T]:
    """Return the tensor turned about z by an angle given as (cos, sin).

    With d = XX - YY, g = s d + c XY, h = s XY and e = s g + c h the plane entries become XX - e, YY + e
    and c g - s h: fewer products than two products of matrices.
    """
    c, s = turn
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor
    plus, minus, mul = algebra.add, algebra.sub, algebra.mul
    g = plus(mul(s, minus(xx, yy)), mul(c, xy))
    h = mul(s, xy)
    e = plus(mul(s, g), mul(c, h))
    xy = minus(mul(c, g), mul(s, h))
    xz, yz = minus(mul(c, xz), mul(s, yz)), plus(mul(s, xz), mul(c, yz))
    return (minus(xx, e), xy, xz), (xy, plus(yy, e), yz), (xz, yz, zz)


def _rotate_tensor(algebra: Algebra[T], frame: Frame[T], tensor: Matrix[T]) -> Matrix[T]:
    """Return R I R', turned first by the joint's angle, then by the constant rotation."""
    turned = tensor if frame.turn is None else turn_tensor(algebra, frame.turn, tensor)
    half = multiply_matrices(algebra, frame.fixed, turned)
    entries = {(i, j): dot(algebra, half[i], frame.fixed[j]) for i in range(3) for j in range(i, 3)}
    return _fill(entries)


def _fill(entries: Mapping[tuple[int, int], T]) -> Matrix[T]:
    """Return the symmetric matrix with these entries on and above the diagonal."""
    xy, xz, yz = entries[0, 1], entries[0, 2], entries[1, 2]
    return (entries[0, 0], xy, xz), (xy, entries[1, 1], yz), (xz, yz, entries[2, 2])


def lift_body(algebra: Algebra[T], frame: Frame[T], body: Body[T]) -> Body[T]:
    """Return inertia tensor, first moments and mass about the parent's origin, in its axes.

    I_p = R I R' + 2 (t.m) E - t m' - m t' + M (t.t E - t t'),  m = R MS,  t the link's origin.
    """
    tensor, moments, mass = body
    plus, mul = algebra.add, algebra.mul
    m = lift_vector(algebra, frame, moments)
    t = frame.origin
    turned = _rotate_tensor(algebra, frame, tensor)
    # With u = m + M t / 2 the shift is 2 (t.u) E - t u' - u t'; doubled constants cost nothing.
    u = add(algebra, m, scale(algebra, algebra.half(mass), t))
    doubled = [mul(plus(part, part), other) for part, other in zip(t, u, strict=True)]
    entries = {}
    for i in range(3):
        entries[i, i] = plus(turned[i][i], plus(doubled[(i + 1) % 3], doubled[(i + 2) % 3]))
        for j in range(i + 1, 3):
            shift = plus(mul(t[i], u[j]), mul(u[i], t[j]))
            entries[i, j] = algebra.sub(turned[i][j], shift)
    return _fill(entries), add(algebra, m, scale(algebra, mass, t)), mass


def _add_bodies(algebra: Algebra[T], left: Body[T], right: Body[T]) -> Body[T]:
    first, second, third = (add(algebra, a, b) for a, b in zip(left[0], right[0], strict=True))
    return (first, second, third), add(algebra, left[1], right[1]), algebra.add(left[2], right[2])


def find_mass_matrix(
    recursion: Recursion[T], parameters: Parameters[T], *, meet: Meeting | None = None
) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix, rotor inertias included (composite bodies, Walker and Orin 1982).

    Args:
        recursion: the robot in its position.
        parameters: values of the parameters.
        meet: where the momentum of a composite body, per unit rate of its joint, meets the screws of
            the joints below.
    """
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    zero = algebra.zero
    screws = carry_screws(recursion, find_axis_screws(recursion))
    matrix = [[zero] * robot.size for _ in range(robot.size)]
    bodies = [gather_body(algebra, parameters, link) for link in range(robot.size)]
    for joint in reversed(range(robot.size)):
        tensor, (mx, my, _), mass = bodies[joint]
        if frames[joint].revolute:
            wrench = Wrench(
                force=(algebra.neg(my), mx, zero), moment=(tensor[0][2], tensor[1][2], tensor[2][2])
            )
        else:
            wrench = Wrench(force=(zero, zero, mass), moment=(my, algebra.neg(mx), zero))
        entries = project_wrench(recursion, joint, wrench, screws, meet(joint) if meet else -1)
        for other in range(joint + 1):
            matrix[joint][other] = matrix[other][joint] = entries[other]
        parent = robot.joints[joint].parent
        if parent >= 0:
            lifted = lift_body(algebra, frames[joint], bodies[joint])
            bodies[parent] = _add_bodies(algebra, bodies[parent], lifted)
    return add_drive_inertia(recursion, matrix, parameters)
