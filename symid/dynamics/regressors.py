"""Regressors of energy, momentum, dL/dq, torque and Slotine-Li control, in any algebra.

Motion of a link -> its energy per standard parameter, T = hT pi and V = hV pi, in the order of
`notation.INERTIAL`. Recursion, the parameters wanted as (link, name) -> a column over the joints for each.

Gautier and Khalil 1988, with V_j the velocity of the frame's origin, g_j the gravity vector in the link's
frame, and u_j = -g' P_j:
    hT = (w1^2/2, w1 w2, w1 w3, w2^2/2, w2 w3, w3^2/2,
          w3 V2 - w2 V3, w1 V3 - w3 V1, w2 V1 - w1 V2, V'V/2)
    hV = (0, 0, 0, 0, 0, 0, -g1, -g2, -g3, u)

With `meet` None wrenches go down to every joint (column recursion); where it names the link itself, all
screws come up to it (axis projection).

Supported: the ten standard parameters of each link, rotor inertias and springs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from symid.dynamics.algebra import Algebra, Label, T
from symid.dynamics.bodies import DRIVE_PARAMETERS, Body, compute_drive_column
from symid.dynamics.newton_euler import Reference, compute_acceleration_tensors, compute_tensor_wrench
from symid.dynamics.recursion import (
    LinkMotion,
    ProjectionFrame,
    Recursion,
    Wrench,
    build_axis_screws,
    compute_momentum,
    compute_screw_rates,
    project_columns,
    transform_screws,
)


def compute_energy_regressor(
    algebra: Algebra[T], motion: LinkMotion[T]
) -> tuple[tuple[T, ...], tuple[T, ...]]:
    """Return kinetic and potential energy of a link per parameter, ten each (see the module's equation)."""
    w1, w2, w3 = motion.angular
    v1, v2, v3 = motion.linear
    mul, minus, half, neg = algebra.mul, algebra.sub, algebra.half, algebra.neg
    kinetic = (
        half(mul(w1, w1)),
        mul(w1, w2),
        mul(w1, w3),
        half(mul(w2, w2)),
        mul(w2, w3),
        half(mul(w3, w3)),
        minus(mul(w3, v2), mul(w2, v3)),
        minus(mul(w1, v3), mul(w3, v1)),
        minus(mul(w2, v1), mul(w1, v2)),
        half(algebra.dot(motion.linear, motion.linear)),
    )
    return kinetic, (*(algebra.zero,) * 6, *map(neg, motion.gravity), motion.height)


def compute_body_energy(algebra: Algebra[T], body: Body[T], motion: LinkMotion[T]) -> tuple[T, T]:
    """Return kinetic and potential energy of a link (see the module's equation, its terms put together).

    T = w'(I w / 2 + MS x V) + M V'V / 2;  V = -g'MS + M u.
    """
    tensor, moments, mass = body
    arm = algebra.cross(moments, motion.linear)
    share = algebra.half(algebra.mul(mass, algebra.dot(motion.linear, motion.linear)))
    for i in range(3):
        terms = [algebra.half(algebra.mul(tensor[i][i], motion.angular[i]))]
        terms += [algebra.mul(tensor[i][j], motion.angular[j]) for j in range(i + 1, 3)]
        inner = algebra.sum_values([*terms, arm[i]])
        share = algebra.add(share, algebra.mul(motion.angular[i], inner))
    weight = algebra.sub(algebra.mul(mass, motion.height), algebra.dot(motion.gravity, moments))
    return share, weight


Columns = dict[Label, Sequence[T]]


def _compute_columns(
    recursion: Recursion[T],
    keys: Sequence[Label],
    link_wrench: Callable[[int, str], Wrench[T]],
    drive: tuple[Sequence[T], int],
    meet: ProjectionFrame | None,
) -> Columns[T]:
    """Return the columns of `keys`: wrenches projected on the axes; `drive` for `compute_drive_column`."""
    wrenches = {(link, name): link_wrench(link, name) for link, name in keys if name not in DRIVE_PARAMETERS}
    screws = transform_screws(recursion, build_axis_screws(recursion))
    columns = project_columns(recursion, wrenches, screws, meet)
    columns |= {
        key: compute_drive_column(recursion, key, *drive) for key in keys if key[1] in DRIVE_PARAMETERS
    }
    return {key: columns[key] for key in keys}


def compute_torque_columns(
    recursion: Recursion[T],
    keys: Sequence[Label],
    reference: Reference[T] | None = None,
    *,
    meet: ProjectionFrame | None = None,
) -> Columns[T]:
    """Return the torque regressor's columns: tau = Y(q, dq, ddq) pi.

    With `reference`, dqr and ddqr in rad/s and rad/s^2, those of M ddqr + C dqr + g (Slotine and Li 1987);
    see `newton_euler` for the factor C.
    """
    spins = compute_acceleration_tensors(recursion, reference)
    accelerations = reference[1] if reference else recursion.state.acceleration
    return _compute_columns(
        recursion,
        keys,
        lambda link, name: compute_tensor_wrench(recursion.algebra, name, spins[link]),
        (accelerations, 1),
        meet,
    )


def compute_momentum_columns(
    recursion: Recursion[T], keys: Sequence[Label], *, meet: ProjectionFrame | None = None
) -> Columns[T]:
    """Return the momentum regressor's columns: dT/ddq = Yp(q, dq) pi."""
    return _compute_columns(
        recursion,
        keys,
        lambda link, name: compute_momentum(recursion.algebra, name, recursion.motions[link]),
        (recursion.state.velocity, 0),
        meet,
    )


def compute_lagrange_columns(
    recursion: Recursion[T], keys: Sequence[Label], *, meet: ProjectionFrame | None = None
) -> Columns[T]:
    """Return the columns of dL/dq = dT/dq - dV/dq.

    dT/dq_k is the momentum beyond joint k times v_k x z_k, the change of the link's velocity by
    its joint's coordinate; -dV/dq_k the weight beyond joint k projected on its axis.
    """
    algebra, motions = recursion.algebra, recursion.motions
    links = [key for key in keys if key[1] not in DRIVE_PARAMETERS]
    momenta = {(link, name): compute_momentum(algebra, name, motions[link]) for link, name in links}
    none = (algebra.zero,) * 3
    falling = [replace(motion, angular=none, linear=motion.gravity) for motion in motions]
    weights = {(link, name): compute_momentum(algebra, name, falling[link]) for link, name in links}
    turned = transform_screws(recursion, compute_screw_rates(recursion))
    axes = transform_screws(recursion, build_axis_screws(recursion))
    kinetic = project_columns(recursion, momenta, turned, meet)
    potential = project_columns(recursion, weights, axes, meet)
    columns = {key: list(map(algebra.add, entries, potential[key])) for key, entries in kinetic.items()}
    return {key: columns.get(key) or compute_drive_column(recursion, key, None, -1) for key in keys}
