"""Derivatives of the joint torques, and the Coriolis matrix, from composite bodies.

Recursion, parameters {(link, name): value} -> matrices with a row and a column a joint. A parameter that is
not listed is zero and costs nothing. A composite body is a link with all links beyond it; about the origin of
a frame at rest that coincides with the link's frame it has

    P = sum of m v,   D = sum of m v r',   K = tr(D) E - D,   B u = (u x P, K u),

B the Christoffel factor of a velocity whose angular part is u. With S the axis of a joint, R = dS/dt and
T = d^2S/dt^2 its rates in space, gravity as an acceleration of the base, and W the wrench that a composite
body needs, for a joint j on the way from the base to joint i:

    dtau_i/dddq_j = S_i' I_i S_j
    dtau_i/ddq_j = 2 S_i' (B_i S_j + I_i R_j)        dtau_j/ddq_i = 2 S_j' (B_i S_i + I_i R_i)
    dtau_i/dq_j = S_i' (2 B_i R_j + I_i T_j)         dtau_j/dq_i = S_j' (2 B_i R_i + I_i T_i + S_i x* W_i)

dM/dq: a turn of joint k turns its composite body, which changes M_ij of joints i, j before it by that change,
and the momentum I_i S_i of joints beyond it, which changes M_ij of joints j before it.

Carpentier and Mansard 2018; Singh, Russell and Wensing 2022. B' S_i has no force: as a couple it passes
joints by rotations alone. dtau/ddq is 2 C, C the Christoffel factor.

Supported: trees of revolute and prismatic joints, rotor inertias reflected to the joint side, springs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple

from symid.dynamics.algebra import Algebra, Matrix, T, Vector, transpose
from symid.dynamics.bodies import (
    Body,
    Parameters,
    add_bodies,
    add_drive_inertias,
    add_drive_torques,
    add_matrices,
    compute_momentum,
    gather_body,
    rotate_matrix,
    transform_body,
    turn_matrix,
)
from symid.dynamics.newton_euler import (
    accumulate_wrenches,
    compute_acceleration_tensors,
    compute_link_wrenches,
)
from symid.dynamics.recursion import (
    LinkMotion,
    Recursion,
    Rows,
    Screw,
    Screws,
    Wrench,
    add_wrenches,
    build_axis_screws,
    compute_screw_rates,
    project_wrench,
    rotate_to_parent,
    transform_screws,
    transform_wrench,
)


class _Composite(NamedTuple, Generic[T]):
    """A composite body in its link's frame: inertia, and `factor` times K and P (see above)."""

    body: Body[T]
    turning: Matrix[T]
    momentum: Vector[T]


def _shift_turning(algebra: Algebra[T], turning: Matrix[T], momentum: Vector[T], arm: Vector[T]) -> Matrix[T]:
    """Return K + (P.r) E - P r': K of points that are moved by the arm r."""
    shares = [[algebra.mul(p, r) for r in arm] for p in momentum]
    rows = [list(map(algebra.sub, *pair)) for pair in zip(turning, shares, strict=True)]
    for k in range(3):
        first, second = (k + 1) % 3, (k + 2) % 3
        # Without P_k r_k, which the trace gives back.
        rows[k][k] = algebra.sum_values([turning[k][k], shares[first][first], shares[second][second]])
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows
    return (xx, xy, xz), (yx, yy, yz), (zx, zy, zz)


def _build_composite(
    algebra: Algebra[T], body: Body[T], motion: LinkMotion[T], *, double: bool
) -> _Composite[T]:
    """Return a link alone: K = -[w x] Sigma + (v.m) E - v m', P = w x m + M v, twice if `double`."""
    # Sigma = sum of m r r' = tr(I)/2 E - I, m the first moments.
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body[0]
    mul, plus, minus, neg, (wx, wy, wz) = algebra.mul, algebra.add, algebra.sub, algebra.neg, motion.angular
    sums = [minus(plus(yy, zz), xx), minus(plus(xx, zz), yy), minus(plus(xx, yy), zz)]
    w, v = motion.angular, motion.linear
    if double:
        w, v = algebra.add_vectors(w, w), algebra.add_vectors(v, v)
    else:
        sums = list(map(algebra.half, sums))
    (ux, uy, uz), (sx, sy, sz) = w, sums
    a, b, c = mul(ux, yz), mul(uy, xz), mul(uz, xy)
    spin = (
        (minus(b, c), plus(mul(uy, yz), mul(wz, sy)), neg(plus(mul(wy, sz), mul(uz, yz)))),
        (neg(plus(mul(wz, sx), mul(ux, xz))), minus(c, a), plus(mul(uz, xz), mul(wx, sz))),
        (plus(mul(ux, xy), mul(wy, sx)), neg(plus(mul(wx, sy), mul(uy, xy))), minus(a, b)),
    )
    momentum = algebra.add_vectors(algebra.scale_vector(body[2], v), algebra.cross(w, body[1]))
    return _Composite(body=body, turning=_shift_turning(algebra, spin, v, body[1]), momentum=momentum)


def _turn_momentum(algebra: Algebra[T], part: _Composite[T], screw: Screw[T]) -> Wrench[T]:
    """Return B S, times the factor of `part`."""
    moment = algebra.apply_matrix(part.turning, screw.angular)
    return Wrench(force=algebra.cross(screw.angular, part.momentum), moment=moment)


def _build_couple(algebra: Algebra[T], part: _Composite[T], screw: Screw[T]) -> Wrench[T]:
    """Return B' S, times the factor of `part`: a moment alone."""
    moment = algebra.apply_matrix(transpose(part.turning), screw.angular)
    moment = algebra.add_vectors(moment, algebra.cross(part.momentum, screw.linear))
    return Wrench(force=(algebra.zero,) * 3, moment=moment)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sweep(Generic[T]):
    """The composite bodies of a state, their axes, and rates R, or 2 R where their factor is two."""

    recursion: Recursion[T]
    composites: Sequence[_Composite[T]]
    axes: Sequence[Screw[T]]
    rates: Sequence[Screw[T]]

    def fill(
        self, lower: Callable[[int], Sequence[tuple[Wrench[T], Screws[T]]]], upper: Callable[[int], Wrench[T]]
    ) -> list[list[T]]:
        """Return the entries (i, j), sums of wrenches of i on screws of j, and (j, i), on the axes."""
        robot, algebra = self.recursion.robot, self.recursion.algebra
        axes = transform_screws(self.recursion, self.axes)
        rows = [[algebra.zero] * robot.size for _ in range(robot.size)]
        for joint in range(robot.size):
            parts = [project_wrench(self.recursion, joint, *pair) for pair in lower(joint)]
            across, other = project_wrench(self.recursion, joint, upper(joint), axes), joint
            while other >= 0:
                # Of the joint itself both are the same: the one written last takes fewer operations.
                rows[other][joint] = across[other]
                rows[joint][other] = algebra.sum_values([part[other] for part in parts])
                other = robot.joints[other].parent
        return rows

    def compute_mass_matrix(self, parameters: Parameters[T]) -> Rows[T]:
        axes = transform_screws(self.recursion, self.axes)
        momenta = self._list_momenta(self.axes)
        rows = self.fill(lambda i: [(momenta[i], axes)], momenta.__getitem__)
        add_drive_inertias(self.recursion, rows, parameters)
        return tuple(map(tuple, rows))

    def compute_coriolis_matrix(self) -> Rows[T]:
        """Return C, times the factor of the composites."""
        algebra, axes = self.recursion.algebra, transform_screws(self.recursion, self.axes)
        rates = transform_screws(self.recursion, self.rates)
        momenta, pushes = self._list_momenta(self.axes), self._list_momenta(self.rates)
        pairs = list(zip(self.composites, self.axes, strict=True))
        couples = [_build_couple(algebra, *pair) for pair in pairs]
        turns = [_turn_momentum(algebra, *pair) for pair in pairs]
        rows = self.fill(
            lambda i: [(couples[i], axes), (momenta[i], rates)],
            lambda i: add_wrenches(algebra, turns[i], pushes[i]),
        )
        return tuple(map(tuple, rows))

    def _list_momenta(self, screws: Sequence[Screw[T]]) -> list[Wrench[T]]:
        algebra, pairs = self.recursion.algebra, zip(self.composites, screws, strict=True)
        return [compute_momentum(algebra, part.body, screw) for part, screw in pairs]


def _move_body(algebra: Algebra[T], body: Body[T], screw: Screw[T]) -> Body[T]:
    """Return the change of a body that moves by a screw, about a frame that is at rest."""
    # z x m + M u, [z x] I - I [z x] + 2 (u.m) E - u m' - m u' for the screw (z, u).
    tensor, moments, mass = body
    z, u = screw.angular, screw.linear
    # The columns of [z x] I; I [z x] is its transpose with the other sign.
    columns = [algebra.cross(z, row) for row in tensor]
    shift = algebra.dot(u, moments)
    entries = [[algebra.add(columns[j][i], columns[i][j]) for j in range(3)] for i in range(3)]
    for i in range(3):
        entries[i][i] = algebra.sum_values([entries[i][i], shift, shift])
        for j in range(3):
            share = algebra.add(algebra.mul(u[i], moments[j]), algebra.mul(moments[i], u[j]))
            entries[i][j] = algebra.sub(entries[i][j], share)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = entries
    moved = algebra.add_vectors(algebra.cross(z, moments), algebra.scale_vector(mass, u))
    return ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)), moved, algebra.zero


def _turn_wrench(algebra: Algebra[T], screw: Screw[T], wrench: Wrench[T]) -> Wrench[T]:
    """Return the change of a wrench that moves by a screw, S x* W."""
    moment = algebra.cross(screw.angular, wrench.moment)
    return Wrench(
        force=algebra.cross(screw.angular, wrench.force),
        moment=algebra.add_vectors(moment, algebra.cross(screw.linear, wrench.force)),
    )


def compute_mass_derivatives(recursion: Recursion[T], parameters: Parameters[T]) -> tuple[Rows[T], ...]:
    """Return dM_ij/dq_k, kg m^2/rad, a matrix for every joint k (see above)."""
    robot, algebra, frames = recursion.robot, recursion.algebra, recursion.frames
    # Composite bodies.
    bodies = [gather_body(algebra, parameters, link) for link in range(robot.size)]
    for link in reversed(range(robot.size)):
        parent = robot.joints[link].parent
        if parent >= 0:
            moved = transform_body(algebra, frames[link], bodies[link], turn_matrix)
            bodies[parent] = add_bodies(algebra, bodies[parent], moved)
    axes = build_axis_screws(recursion)
    screws = transform_screws(recursion, axes)
    found = [[[algebra.zero] * robot.size for _ in range(robot.size)] for _ in range(robot.size)]

    def fill(turned: int, row: int, start: int, wrench: Wrench[T]) -> None:
        """Write dM of `row` and all joints from `start` on down to the base by the turn of a joint."""
        entries = project_wrench(recursion, start, wrench, screws)
        column = start if start != turned else robot.joints[start].parent
        while column >= 0:
            found[turned][row][column] = found[turned][column][row] = entries[column]
            column = robot.joints[column].parent

    for joint in range(robot.size):
        wrench, turned = compute_momentum(algebra, bodies[joint], axes[joint]), joint
        while robot.joints[turned].parent >= 0:
            fill(turned, joint, turned, _turn_wrench(algebra, axes[turned], wrench))
            wrench = transform_wrench(algebra, frames[turned], wrench)
            turned = robot.joints[turned].parent
        change, before = _move_body(algebra, bodies[joint], axes[joint]), joint
        while robot.joints[before].parent >= 0:
            change = transform_body(algebra, frames[before], change, turn_matrix)
            before = robot.joints[before].parent
            fill(joint, before, before, compute_momentum(algebra, change, axes[before]))
    return tuple(tuple(map(tuple, matrix)) for matrix in found)


def _build_sweep(recursion: Recursion[T], parameters: Parameters[T], *, double: bool) -> _Sweep[T]:
    robot, algebra, rates = recursion.robot, recursion.algebra, compute_screw_rates(recursion)
    if double:
        add = algebra.add_vectors
        rates = tuple(Screw(angular=add(r.angular, r.angular), linear=add(r.linear, r.linear)) for r in rates)
    found = [
        _build_composite(algebra, gather_body(algebra, parameters, link), motion, double=double)
        for link, motion in enumerate(recursion.motions)
    ]
    for link in reversed(range(robot.size)):
        parent, frame, part = robot.joints[link].parent, recursion.frames[link], found[link]
        if parent >= 0:
            # About the parent's origin, in its axes, it is part of the parent's.
            turning, left = rotate_matrix(algebra, frame, part.turning), found[parent]
            momentum = rotate_to_parent(algebra, frame, part.momentum)
            moved = transform_body(algebra, frame, part.body, turn_matrix)
            turning = _shift_turning(algebra, turning, momentum, frame.origin)
            found[parent] = _Composite(
                add_bodies(algebra, left.body, moved),
                add_matrices(algebra, left.turning, turning),
                algebra.add_vectors(left.momentum, momentum),
            )
    return _Sweep(recursion=recursion, composites=found, axes=build_axis_screws(recursion), rates=rates)


def compute_coriolis_matrix(recursion: Recursion[T], parameters: Parameters[T]) -> Rows[T]:
    """Return C with C_ij = sum of c_ijk dq_k, c the Christoffel symbols, in kg m^2/s."""
    return _build_sweep(recursion, parameters, double=False).compute_coriolis_matrix()


def compute_equation_terms(
    recursion: Recursion[T], parameters: Parameters[T]
) -> tuple[Rows[T], Rows[T], tuple[T, ...]]:
    """Return M, 2 C and the torques at rest, of gravity and springs, of tau = M ddq + C dq + rest.

    Of a joint gravity g takes -S' I (0, g): the momentum of its composite body times -g.
    """
    robot, algebra = recursion.robot, recursion.algebra
    sweep = _build_sweep(recursion, parameters, double=True)
    weights = []
    for part, screw, motion in zip(sweep.composites, sweep.axes, recursion.motions, strict=True):
        force = compute_momentum(algebra, part.body, screw).force
        weights.append(algebra.neg(algebra.dot(force, motion.gravity)))
    still = (algebra.zero,) * robot.size
    mass, twice_coriolis = sweep.compute_mass_matrix(parameters), sweep.compute_coriolis_matrix()
    return mass, twice_coriolis, add_drive_torques(recursion, weights, parameters, still)


def compute_torque_derivatives(
    recursion: Recursion[T], parameters: Parameters[T]
) -> tuple[Rows[T], Rows[T], Rows[T]]:
    """Return the derivatives of the joint torques without friction by q, dq and ddq (see above).

    In N m/rad, N m s/rad and kg m^2, a row and a column a joint.
    """
    algebra = recursion.algebra
    sweep = _build_sweep(recursion, parameters, double=True)
    spins = compute_acceleration_tensors(recursion)
    wrenches = accumulate_wrenches(recursion, compute_link_wrenches(recursion, parameters, spins))
    single = compute_screw_rates(recursion)
    # T of every joint, (U z, a x z + 2 v x (w x z)), or (0, U z) if prismatic.
    second = []
    for spin, axis, rate, motion in zip(spins, sweep.axes, sweep.rates, recursion.motions, strict=True):
        swing, turned = algebra.cross(motion.linear, rate.angular), algebra.cross(spin.linear, axis.angular)
        linear = algebra.add_vectors(algebra.apply_matrix(spin.tensor, axis.linear), turned, swing)
        second.append(Screw(angular=algebra.apply_matrix(spin.tensor, axis.angular), linear=linear))
    rates, seconds = transform_screws(recursion, single), transform_screws(recursion, second)

    def compute_lower(joint: int) -> list[tuple[Wrench[T], Screws[T]]]:
        part, axis = sweep.composites[joint], sweep.axes[joint]
        couple, push = _build_couple(algebra, part, axis), compute_momentum(algebra, part.body, axis)
        return [(couple, rates), (push, seconds)]

    def compute_upper(joint: int) -> Wrench[T]:
        part, axis, load = sweep.composites[joint], sweep.axes[joint], wrenches[joint]
        turned = _turn_wrench(algebra, axis, load)
        pushed = compute_momentum(algebra, part.body, second[joint])
        return add_wrenches(algebra, _turn_momentum(algebra, part, single[joint]), pushed, turned)

    rows = sweep.fill(compute_lower, compute_upper)
    for key, value in parameters.items():
        if key[1] == "KS":
            rows[key[0]][key[0]] = algebra.add(rows[key[0]][key[0]], value)
    return tuple(map(tuple, rows)), sweep.compute_coriolis_matrix(), sweep.compute_mass_matrix(parameters)
