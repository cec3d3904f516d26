"""Bodies and drives: link parameters gathered into bodies, rotors and springs, and the mass matrix.

Recursion, parameters {(index, name): value} -> inertia tensor, first moments and mass of a link as its
parent sees them; energy and torque columns of rotors and springs; the joint-space mass matrix. A parameter
that is not listed is zero and costs nothing.

    T = IA w^2 / 2,  w the speed of the joint, or of the coupling, sum of factor * dq over its joints;
    V = KS q^2 / 2 + KR q,  the spring KS (q - rest) with KR = -KS rest.

Supported: rotor inertias of joints and couplings, springs of joints.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import product

from symid.dynamics.algebra import Algebra, Label, Matrix, T, Vector
from symid.dynamics.recursion import (
    LinkFrame,
    ProjectionFrame,
    Recursion,
    Wrench,
    build_axis_screws,
    project_wrench,
    rotate_to_parent,
    transform_screws,
)
from symid.robot import Exact, Robot

DRIVE_PARAMETERS = ("IA", "KS", "KR")
"""Parameters of drives and springs, in their order within a joint."""


def list_drive_parameters(robot: Robot) -> tuple[Label, ...]:
    """Return the drive parameters of the robot: those of the joints, then of the couplings.

    The rotor of an elastic joint moves with the motor, not with the link: its inertia is not among them.
    """
    keys: list[Label] = []
    for index, joint in enumerate(robot.joints):
        keys += [(index, "IA")] if joint.drive.has_rotor and joint.elasticity is None else []
        keys += [(index, "KS"), (index, "KR")] if joint.spring else []
    keys += [(robot.size + k, "IA") for k, entry in enumerate(robot.couplings) if entry.has_rotor]
    return tuple(keys)


def _list_shares(robot: Robot, index: int) -> tuple[tuple[int, Exact], ...]:
    """Return the joints that a drive turns with, and its factors."""
    if index < robot.size:
        return ((index, Exact.of(1)),)
    return tuple((joint, Exact.of(factor)) for joint, factor in robot.couplings[index - robot.size].terms)


def _compute_drive_speed(robot: Robot, algebra: Algebra[T], index: int, rates: Sequence[T]) -> T:
    total = algebra.zero
    for joint, factor in _list_shares(robot, index):
        total = algebra.add(total, algebra.mul(algebra.constant(factor), rates[joint]))
    return total


def compute_drive_energy(recursion: Recursion[T], key: Label) -> tuple[T, T]:
    """Return kinetic and potential energy per unit of a drive parameter."""
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    index, name = key
    if name == "IA":
        rate = _compute_drive_speed(robot, algebra, index, state.velocity)
        return algebra.half(algebra.mul(rate, rate)), algebra.zero
    position = state.position[index]
    if name == "KS":
        return algebra.zero, algebra.half(algebra.mul(position, position))
    return algebra.zero, position


def compute_drive_column(
    recursion: Recursion[T], key: Label, rates: Sequence[T] | None, springs: int
) -> Sequence[T]:
    """Return the entries of a drive parameter, IA, KS or KR, at every joint.

    `rates` of the joints are accelerations for torques, velocities for momenta, None without rotors;
    `springs` is the sign of spring torques: 1 in torques, -1 in dL/dq, 0 in momenta.
    """
    robot, algebra = recursion.robot, recursion.algebra
    index, name = key
    entries = [algebra.zero] * robot.size
    if name == "IA" and rates is not None:
        rate = _compute_drive_speed(robot, algebra, index, rates)
        for joint, factor in _list_shares(robot, index):
            entries[joint] = algebra.add(entries[joint], algebra.mul(algebra.constant(factor), rate))
    elif name != "IA" and springs:
        value = recursion.state.position[index] if name == "KS" else algebra.one
        entries[index] = value if springs > 0 else algebra.neg(value)
    return entries


def add_drive_torques(
    recursion: Recursion[T], torques: Sequence[T], parameters: Mapping[Label, T], rates: Sequence[T]
) -> tuple[T, ...]:
    """Return the torques of the joints with those of rotors, for accelerations `rates`, and springs."""
    algebra = recursion.algebra
    result = list(torques)
    for key in list_drive_parameters(recursion.robot):
        if key in parameters:
            column = compute_drive_column(recursion, key, rates, 1)
            for joint, entry in enumerate(column):
                result[joint] = algebra.add(result[joint], algebra.mul(parameters[key], entry))
    return tuple(result)


def add_drive_inertias(recursion: Recursion[T], matrix: list[list[T]], parameters: Mapping[Label, T]) -> None:
    """Add the inertias of rotors to the mass matrix of the joints, in place."""
    robot, algebra = recursion.robot, recursion.algebra
    for key in list_drive_parameters(robot):
        if key[1] == "IA" and key in parameters:
            shares = _list_shares(robot, key[0])
            for (i, first), (j, second) in product(shares, shares):
                share = algebra.mul(algebra.constant(first * second), parameters[key])
                matrix[i][j] = algebra.add(matrix[i][j], share)


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


def rotate_tensor_about_z(algebra: Algebra[T], turn: tuple[T, T], tensor: Matrix[T]) -> Matrix[T]:
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


TensorTurn = Callable[[Algebra[T], tuple[T, T], Matrix[T]], Matrix[T]]
"""How a symmetric tensor turns about z by an angle given as (cos, sin)."""


def transform_body(
    algebra: Algebra[T],
    frame: LinkFrame[T],
    body: Body[T],
    rotate: TensorTurn[T] = rotate_tensor_about_z,
) -> Body[T]:
    """Return inertia tensor, first moments and mass about the parent's origin, in its axes.

    I_p = R I R' + 2 (t.m) E - t m' - m t' + M (t.t E - t t'),  m = R MS,  t the link's origin.
    """
    tensor, moments, mass = body
    plus, mul = algebra.add, algebra.mul
    m = rotate_to_parent(algebra, frame, moments)
    t = frame.origin
    if frame.turn is not None:
        tensor = rotate(algebra, frame.turn, tensor)
    half = algebra.multiply_matrices(frame.fixed, tensor)
    turned = {(i, j): algebra.dot(half[i], frame.fixed[j]) for i in range(3) for j in range(i, 3)}
    # With u = m + M t / 2 the shift is 2 (t.u) E - t u' - u t'; doubled constants cost nothing.
    u = algebra.add_vectors(m, algebra.scale_vector(algebra.half(mass), t))
    doubled = [mul(plus(part, part), other) for part, other in zip(t, u, strict=True)]
    entries = {}
    for i in range(3):
        entries[i, i] = plus(turned[i, i], plus(doubled[(i + 1) % 3], doubled[(i + 2) % 3]))
        for j in range(i + 1, 3):
            shift = plus(mul(t[i], u[j]), mul(u[i], t[j]))
            entries[i, j] = algebra.sub(turned[i, j], shift)
    xy, xz, yz = entries[0, 1], entries[0, 2], entries[1, 2]
    moved = ((entries[0, 0], xy, xz), (xy, entries[1, 1], yz), (xz, yz, entries[2, 2]))
    return moved, algebra.add_vectors(m, algebra.scale_vector(mass, t)), mass


def compute_mass_matrix(
    recursion: Recursion[T], parameters: Parameters[T], *, meet: ProjectionFrame | None = None
) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix, rotor inertias included (composite bodies, Walker and Orin 1982).

    `meet`: where the momentum of a composite body, per unit rate of its joint, meets the screws below.
    """
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    zero = algebra.zero
    screws = transform_screws(recursion, build_axis_screws(recursion))
    matrix = [[zero] * robot.size for _ in range(robot.size)]
    bodies = [gather_body(algebra, parameters, link) for link in range(robot.size)]
    for joint in reversed(range(robot.size)):
        tensor, (mx, my, _), mass = bodies[joint]
        if frames[joint].revolute:
            column = (tensor[0][2], tensor[1][2], tensor[2][2])
            wrench = Wrench(force=(algebra.neg(my), mx, zero), moment=column)
        else:
            wrench = Wrench(force=(zero, zero, mass), moment=(my, algebra.neg(mx), zero))
        entries = project_wrench(recursion, joint, wrench, screws, meet(joint) if meet else -1)
        for other in range(joint + 1):
            matrix[joint][other] = matrix[other][joint] = entries[other]
        parent = robot.joints[joint].parent
        if parent >= 0:
            left, right = bodies[parent], transform_body(algebra, frames[joint], bodies[joint])
            x, y, z = (algebra.add_vectors(a, b) for a, b in zip(left[0], right[0], strict=True))
            moments = algebra.add_vectors(left[1], right[1])
            bodies[parent] = ((x, y, z), moments, algebra.add(left[2], right[2]))
    add_drive_inertias(recursion, matrix, parameters)
    return tuple(tuple(row) for row in matrix)
