"""Bodies and drives: link parameters gathered into bodies, rotors and springs, and the mass matrix.

Recursion, parameters {(index, name): value} -> inertia tensor, first moments and mass of a link as its
parent sees them; energy and torque columns of rotors and springs; the joint-space mass matrix, of composite
bodies, and the accelerations that torques give, of articulated bodies. A parameter that is not listed is zero
and costs nothing.

    T = IA w^2 / 2,  w the speed of the joint, or of the coupling, sum of factor * dq over its joints;
    V = KS q^2 / 2 + KR q,  the spring KS (q - rest) with KR = -KS rest.

An articulated body is a link with all links beyond it, whose joints are free. With S the axis of its joint, p
the wrench that it takes while no joint accelerates, and a the acceleration that the joints before it add,

    D = S' I S + IA,  g = I S / D,  u = tau - S' p:  ddq = u / D - g' a,

and the parent's body gains I - g (I S)' and p + g u (Featherstone 1983).

Supported: rotor inertias of joints and couplings, springs of joints.
Not supported: articulated bodies of joints that share a coordinate or a drive.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import product

from symid.dynamics.algebra import Algebra, Label, Matrix, T, Vector, transpose
from symid.dynamics.recursion import (
    LinkFrame,
    LinkMotion,
    Recursion,
    Screw,
    Wrench,
    add_wrenches,
    build_axis_screws,
    lift_placement,
    project_wrench,
    rotate_to_parent,
    transform_screw,
    transform_screws,
    transform_wrench,
)
from symid.notation import INERTIAL
from symid.robot import IDENTITY, Exact, Robot

DRIVE_PARAMETERS = ("IA", "KS", "KR")
"""Parameters of drives and springs, in their order within a joint."""
Parameters = Mapping[tuple[int, str], T]
Body = tuple[Matrix[T], Vector[T], T]
"""Inertia tensor about the link frame's origin (kg m^2), first moments (kg m), mass (kg)."""
_Inertia = tuple[tuple[T, ...], ...]
"""The symmetric matrix (6, 6) that makes moment and force of angular and linear acceleration."""
TensorTurn = Callable[[Algebra[T], tuple[T, T], Matrix[T]], Matrix[T]]
"""How a symmetric tensor turns about z by an angle given as (cos, sin)."""


_Entries = Mapping[tuple[int, int], T]
"""The entries of a symmetric tensor on its diagonal and above it."""


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
    shares = _list_shares(robot, index)
    return algebra.sum_values(algebra.mul(algebra.constant(factor), rates[k]) for k, factor in shares)


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
) -> list[T]:
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
            for joint, entry in enumerate(compute_drive_column(recursion, key, rates, 1)):
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


def gather_body(algebra: Algebra[T], parameters: Parameters[T], link: int) -> Body[T]:
    """Return inertia tensor, first moments and mass of a link."""
    entries = [parameters.get((link, name), algebra.zero) for name in INERTIAL]
    xx, xy, xz, yy, yz, zz, mx, my, mz, mass = entries
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), (mx, my, mz), mass


def move_from_stated_frames(robot: Robot, algebra: Algebra[T], stated: Parameters[T]) -> Parameters[T]:
    """Return link parameters about the link frames from those about the frames of the robot file."""
    moved = dict(stated)
    for link in range(robot.size):
        place = robot.get_stated_frame(link)
        if place == IDENTITY or not any((link, name) in stated for name in INERTIAL):
            continue
        fixed, origin = lift_placement(place, algebra)
        frame = LinkFrame(fixed=fixed, turn=None, origin=origin, revolute=False)
        body = transform_body(algebra, frame, gather_body(algebra, stated, link))
        moved |= {(link, name): entry for name, entry in zip(INERTIAL, list_entries(body), strict=True)}
    return moved


def list_entries(body: Body[T]) -> tuple[T, ...]:
    """Return the ten parameters of a body in their order, see `INERTIAL`."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body[0]
    return (xx, xy, xz, yy, yz, zz, *body[1], body[2])


def build_unit_body(algebra: Algebra[T], name: str) -> Body[T]:
    """Return a body with one parameter alone, which is one."""
    return gather_body(algebra, {(0, name): algebra.one}, 0)


def compute_momentum(algebra: Algebra[T], body: Body[T], motion: Screw[T] | LinkMotion[T]) -> Wrench[T]:
    """Return p = M v + w x MS and L = I w + MS x v; with w = 0 and v = g they are the weight."""
    tensor, moments, mass = body
    force = algebra.scale_vector(mass, motion.linear)
    moment = algebra.apply_matrix(tensor, motion.angular)
    return Wrench(
        force=algebra.add_vectors(force, algebra.cross(motion.angular, moments)),
        moment=algebra.add_vectors(moment, algebra.cross(moments, motion.linear)),
    )


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


def turn_matrix(algebra: Algebra[T], turn: tuple[T, T], matrix: Matrix[T]) -> Matrix[T]:
    """Return the matrix R A R' of a turn R about z by an angle given as (cos, sin).

    With d = xx - yy, t = xy + yx, e = s^2 d + c s t and g = c s d - s^2 t the plane entries become xx - e,
    yy + e, xy + g, yx + g: matrices that turn together share s^2 and c s.
    """
    c, s = turn
    plus, minus, mul = algebra.add, algebra.sub, algebra.mul
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    square, product = mul(s, s), mul(c, s)
    d, t = minus(xx, yy), plus(xy, yx)
    e = plus(mul(square, d), mul(product, t))
    g = minus(mul(product, d), mul(square, t))
    xz, yz = minus(mul(c, xz), mul(s, yz)), plus(mul(s, xz), mul(c, yz))
    zx, zy = minus(mul(c, zx), mul(s, zy)), plus(mul(s, zx), mul(c, zy))
    return (minus(xx, e), plus(xy, g), xz), (plus(yx, g), plus(yy, e), yz), (zx, zy, zz)


def _fill_tensor(entries: _Entries[T]) -> Matrix[T]:
    xy, xz, yz = entries[0, 1], entries[0, 2], entries[1, 2]
    return (entries[0, 0], xy, xz), (xy, entries[1, 1], yz), (xz, yz, entries[2, 2])


def _rotate_tensor(
    algebra: Algebra[T], frame: LinkFrame[T], tensor: Matrix[T], rotate: TensorTurn[T]
) -> dict[tuple[int, int], T]:
    """Return the entries of a symmetric tensor in the parent's axes."""
    if frame.turn is not None:
        tensor = rotate(algebra, frame.turn, tensor)
    half = algebra.multiply_matrices(frame.fixed, tensor)
    return {(i, j): algebra.dot(half[i], frame.fixed[j]) for i in range(3) for j in range(i, 3)}


def rotate_matrix(algebra: Algebra[T], frame: LinkFrame[T], matrix: Matrix[T]) -> Matrix[T]:
    """Return a matrix given in the link's axes in the parent's axes."""
    turned = turn_matrix(algebra, frame.turn, matrix) if frame.turn else matrix
    half = algebra.multiply_matrices(frame.fixed, turned)
    return algebra.multiply_matrices(half, transpose(frame.fixed))


def transform_body(
    algebra: Algebra[T], frame: LinkFrame[T], body: Body[T], rotate: TensorTurn[T] = rotate_tensor_about_z
) -> Body[T]:
    """Return inertia tensor, first moments and mass about the parent's origin, in its axes.

    I_p = R I R' + 2 (t.m) E - t m' - m t' + M (t.t E - t t'),  m = R MS,  t the link's origin.
    """
    tensor, moments, mass = body
    plus, mul = algebra.add, algebra.mul
    m = rotate_to_parent(algebra, frame, moments)
    t = frame.origin
    turned = _rotate_tensor(algebra, frame, tensor, rotate)
    # With u = m + M t / 2 the shift is 2 (t.u) E - t u' - u t'; doubled constants cost nothing.
    u = algebra.add_vectors(m, algebra.scale_vector(algebra.half(mass), t))
    doubled = [mul(plus(part, part), other) for part, other in zip(t, u, strict=True)]
    entries = {}
    for i in range(3):
        entries[i, i] = plus(turned[i, i], plus(doubled[(i + 1) % 3], doubled[(i + 2) % 3]))
        for j in range(i + 1, 3):
            shift = plus(mul(t[i], u[j]), mul(u[i], t[j]))
            entries[i, j] = algebra.sub(turned[i, j], shift)
    return _fill_tensor(entries), algebra.add_vectors(m, algebra.scale_vector(mass, t)), mass


def add_matrices(algebra: Algebra[T], left: Matrix[T], right: Matrix[T]) -> Matrix[T]:
    """Return the sum of two matrices."""
    x, y, z = map(algebra.add_vectors, left, right)
    return x, y, z


def add_bodies(algebra: Algebra[T], left: Body[T], right: Body[T]) -> Body[T]:
    """Return two bodies of one frame as one."""
    tensor = add_matrices(algebra, left[0], right[0])
    return tensor, algebra.add_vectors(left[1], right[1]), algebra.add(left[2], right[2])


def compute_mass_matrix(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix, rotor inertias included (composite bodies, Walker and Orin 1982)."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    axes = build_axis_screws(recursion)
    screws = transform_screws(recursion, axes)
    matrix = [[algebra.zero] * robot.size for _ in range(robot.size)]
    bodies = [gather_body(algebra, parameters, link) for link in range(robot.size)]
    for joint in reversed(range(robot.size)):
        momentum = compute_momentum(algebra, bodies[joint], axes[joint])
        entries = project_wrench(recursion, joint, momentum, screws)
        for other in range(joint + 1):
            matrix[joint][other] = matrix[other][joint] = entries[other]
        parent = robot.joints[joint].parent
        if parent >= 0:
            moved = transform_body(algebra, frames[joint], bodies[joint])
            bodies[parent] = add_bodies(algebra, bodies[parent], moved)
    add_drive_inertias(recursion, matrix, parameters)
    return tuple(tuple(row) for row in matrix)


def _mirror(upper: Sequence[Sequence[T]]) -> _Inertia[T]:
    """Return the symmetric matrix whose rows begin on the diagonal."""
    size = range(len(upper))
    return tuple(tuple(upper[min(i, j)][abs(i - j)] for j in size) for i in size)


def _build_inertia(algebra: Algebra[T], body: Body[T]) -> _Inertia[T]:
    (a, b, c), (x, y, z), mass = body
    zero, neg = algebra.zero, algebra.neg
    turned = ((zero, neg(z), y), (z, zero, neg(x)), (neg(y), x, zero))
    rows = [(*own, *other)[k:] for k, (own, other) in enumerate(zip((a, b, c), turned, strict=True))]
    return _mirror([*rows, (mass, zero, zero), (mass, zero), (mass,)])


def _carry_inertia(algebra: Algebra[T], frame: LinkFrame[T], inertia: _Inertia[T]) -> _Inertia[T]:
    """Return an inertia about the parent's origin, in its axes."""
    # With blocks A of w and moment, B of v and moment, C of v and force, turned, and t the link's origin:
    # C stays,  B + [t x] C,  A + [t x] (B + [t x] C)' + ([t x] B')'.

    def take(row: int, column: int) -> Matrix[T]:
        x, y, z = ((r[column], r[column + 1], r[column + 2]) for r in inertia[row : row + 3])
        return x, y, z

    t, mul, minus = frame.origin, algebra.mul, algebra.sub
    a, c = (_rotate_tensor(algebra, frame, take(k, k), turn_matrix) for k in (0, 3))
    b, pushing = rotate_matrix(algebra, frame, take(0, 3)), _fill_tensor(c)
    x, y, z = (algebra.cross(t, column) for column in pushing)
    moved = list(map(algebra.add_vectors, b, transpose((x, y, z))))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # On the diagonal (t x (b + moved))_i, beside it (t x moved_j)_i + (t x b_i)_j: each part of t once.
        twice = algebra.add_vectors(b[i], moved[i])
        a[i, i] = algebra.add(a[i, i], minus(mul(t[j], twice[k]), mul(t[k], twice[j])))
        shift = mul(t[k], minus(b[i][i], moved[j][j]))
        shift = algebra.add(shift, minus(mul(t[j], moved[j][k]), mul(t[i], b[i][k])))
        pair = (min(i, j), max(i, j))
        a[pair] = algebra.add(a[pair], shift)
    upper = [([a[i, j] for j in range(i, 3)] + list(moved[i])) for i in range(3)]
    return _mirror([*upper, *(pushing[k][k:] for k in range(3))])


def solve_articulated_bodies(
    recursion: Recursion[T],
    parameters: Parameters[T],
    torques: Sequence[T],
    wrenches: Sequence[Wrench[T]],
    invert: Callable[[T], T],
) -> tuple[T, ...]:
    """Return the accelerations of the joints, in rad/s^2 (m/s^2), that torques in N m (N) give (see above).

    `wrenches` are those that the links take in their own frames while no joint accelerates, in N and N m;
    `invert` returns the inverse of a value.
    """
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    zero, drives = algebra.zero, list_drive_parameters(robot)
    inertias = [_build_inertia(algebra, gather_body(algebra, parameters, link)) for link in range(robot.size)]
    bodies = list(zip(inertias, wrenches, strict=True))
    # What every free joint does, u / D and g (see above), from the last one to the first.
    answers: list[tuple[T, list[T]]] = []
    for joint in reversed(range(robot.size)):
        (inertia, wrench), torque, axis = bodies[joint], torques[joint], 2 if frames[joint].revolute else 5
        rotor = parameters.get((joint, "IA"), zero) if (joint, "IA") in drives else zero
        push, loads = inertia[axis], (*wrench.moment, *wrench.force)
        inverse = invert(algebra.add(push[axis], rotor))
        # Along the axis g is 1 - IA / D: without a rotor no difference of equal numbers is left to round.
        rest, excess = algebra.mul(rotor, inverse), algebra.sub(torque, loads[axis])
        answer = [algebra.mul(entry, inverse) for entry in push]
        answer[axis] = algebra.sub(algebra.one, rest)
        left = [algebra.add(load, algebra.mul(g, excess)) for load, g in zip(loads, answer, strict=True)]
        left[axis] = algebra.sub(torque, algebra.mul(rest, excess))
        answers.append((algebra.mul(excess, inverse), answer))
        # What it leaves to its parent.
        kept = [
            [
                algebra.mul(rest, inertia[i][j])
                if axis in {i, j}
                else algebra.sub(inertia[i][j], algebra.mul(push[i], answer[j]))
                for j in range(i, 6)
            ]
            for i in range(6)
        ]
        parent = robot.joints[joint].parent
        if parent >= 0:
            inertia, wrench = bodies[parent]
            moved = _carry_inertia(algebra, frames[joint], _mirror(kept))
            pairs = (zip(*rows, strict=True) for rows in zip(inertia, moved, strict=True))
            total = tuple(tuple(algebra.add(*pair) for pair in row) for row in pairs)
            load = Wrench(moment=(left[0], left[1], left[2]), force=(left[3], left[4], left[5]))
            load = transform_wrench(algebra, frames[joint], load)
            bodies[parent] = total, add_wrenches(algebra, wrench, load)
    motions: list[Screw[T]] = []
    found = []
    none = (zero, zero, zero)
    steps = zip(robot.joints, reversed(answers), frames, build_axis_screws(recursion), strict=True)
    for one, (start, answer), frame, unit in steps:
        before = motions[one.parent] if one.parent >= 0 else Screw(angular=none, linear=none)
        screw = transform_screw(algebra, frame, before)
        shares = map(algebra.mul, answer, (*screw.angular, *screw.linear))
        found.append(algebra.sub(start, algebra.sum_values(shares)))
        angular = algebra.add_vectors(screw.angular, algebra.scale_vector(found[-1], unit.angular))
        linear = algebra.add_vectors(screw.linear, algebra.scale_vector(found[-1], unit.linear))
        motions.append(Screw(angular=angular, linear=linear))
    return tuple(found)
