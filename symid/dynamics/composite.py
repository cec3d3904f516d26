"""Bodies and the mass matrix: links put together from the tip to the base.

Input: a recursion, parameters per link. Output: inertia tensor, first moments and mass of a link as
its parent sees them; the joint-space mass matrix.

Parameters are given as {(link, name): value}; one that is not listed is zero and costs nothing.
"""

from collections.abc import Mapping

from symid.algebra.scalar import Algebra, T
from symid.algebra.vectors import Matrix, Vector, add, dot, multiply_matrices, scale, transpose
from symid.dynamics.drives import add_drive_inertia
from symid.dynamics.kinematics import Frame, Recursion, find_turn, lift_vector
from symid.dynamics.wrenches import Wrench, lift_wrench, project_on_axis

__all__ = ["Body", "Parameters", "find_mass_matrix", "gather_body", "lift_body"]

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


def _rotate_tensor(algebra: Algebra[T], frame: Frame[T], tensor: Matrix[T]) -> Matrix[T]:
    """Return R I R', turned first by the joint's angle, then by the constant rotation."""
    half = tensor
    if frame.turn is not None:
        turn = find_turn(algebra, frame.turn)
        half = multiply_matrices(algebra, multiply_matrices(algebra, turn, tensor), transpose(turn))
    return multiply_matrices(algebra, multiply_matrices(algebra, frame.fixed, half), transpose(frame.fixed))


def lift_body(algebra: Algebra[T], frame: Frame[T], body: Body[T]) -> Body[T]:
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


def _add_bodies(algebra: Algebra[T], left: Body[T], right: Body[T]) -> Body[T]:
    first, second, third = (add(algebra, a, b) for a, b in zip(left[0], right[0], strict=True))
    return (first, second, third), add(algebra, left[1], right[1]), algebra.add(left[2], right[2])


def find_mass_matrix(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix, rotor inertias included (composite bodies, Walker and Orin 1982)."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    zero = algebra.zero
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
        matrix[joint][joint] = project_on_axis(frames[joint], wrench)
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
    return add_drive_inertia(recursion, matrix, parameters)
