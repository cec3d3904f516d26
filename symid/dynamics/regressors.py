"""Regressors of energy, momentum, dL/dq, torque and Slotine-Li control, by the recursion; in doubles too.

Motion of a link -> its energy per standard parameter, T = hT pi and V = hV pi, in the order of
`notation.INERTIAL`. Recursion, the parameters wanted as (link, name) -> a column over the joints for each.

Gautier and Khalil 1988, with V_j the velocity of the frame's origin, g_j the gravity vector in the link's
frame, and u_j = -g' P_j:
    hT = (w1^2/2, w1 w2, w1 w3, w2^2/2, w2 w3, w3^2/2,
          w3 V2 - w2 V3, w1 V3 - w3 V1, w2 V1 - w1 V2, V'V/2)
    hV = (0, 0, 0, 0, 0, 0, -g1, -g2, -g3, u)

Where the recursion names no meeting, wrenches go down to every joint (column recursion); where it names the
link itself, all screws come up to it (axis projection). Tests prove the columns to be those of `lagrange`.

Supported: the ten standard parameters of each link, rotor inertias and springs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.dynamics import bodies
from symid.dynamics.algebra import Algebra, FloatAlgebra, Label, RobotState, T, spread_coordinates
from symid.dynamics.newton_euler import Reference, compute_acceleration_tensors, compute_link_wrench
from symid.dynamics.recursion import (
    LinkMotion,
    Recursion,
    Rows,
    Screw,
    Wrench,
    build_axis_screws,
    build_recursion,
    compute_screw_rates,
    fold_vector,
    project_wrench,
    transform_screws,
)
from symid.robot import ONE, ZERO, Robot

Columns = dict[Label, Sequence[T]]
WEIGHED = ("MX", "MY", "MZ", "M")
"""The parameters of a link that have a weight, in their order."""


def compute_energy_regressor(algebra: Algebra[T], motion: LinkMotion[T]) -> Rows[T]:
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


def compute_body_energy(algebra: Algebra[T], body: bodies.Body[T], motion: LinkMotion[T]) -> tuple[T, T]:
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


def _compute_columns(
    recursion: Recursion[T],
    keys: Sequence[Label],
    link_wrench: Callable[[int, bodies.Body[T]], Wrench[T]],
    drive: tuple[Sequence[T], int],
) -> Columns[T]:
    """Return the columns of `keys`: wrenches projected on the axes; `drive` for `compute_drive_column`."""
    wrenches = {
        (link, name): link_wrench(link, bodies.build_unit_body(recursion.algebra, name))
        for link, name in keys
        if name not in bodies.DRIVE_PARAMETERS
    }
    screws = transform_screws(recursion, build_axis_screws(recursion))
    return {
        key: project_wrench(recursion, key[0], wrenches[key], screws)
        if key in wrenches
        else bodies.compute_drive_column(recursion, key, *drive)
        for key in keys
    }


def compute_torque_columns(
    recursion: Recursion[T], keys: Sequence[Label], reference: Reference[T] | None = None
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
        lambda link, body: compute_link_wrench(recursion.algebra, body, spins[link]),
        (accelerations, 1),
    )


def compute_momentum_columns(recursion: Recursion[T], keys: Sequence[Label]) -> Columns[T]:
    """Return the momentum regressor's columns: dT/ddq = Yp(q, dq) pi."""
    return _compute_columns(
        recursion,
        keys,
        lambda link, body: bodies.compute_momentum(recursion.algebra, body, recursion.motions[link]),
        (recursion.state.velocity, 0),
    )


def compute_lagrange_columns(recursion: Recursion[T], keys: Sequence[Label]) -> Columns[T]:
    """Return the columns of dL/dq = dT/dq - dV/dq.

    dT/dq_k is the momentum beyond joint k times v_k x z_k, the change of the link's velocity by
    its joint's coordinate; -dV/dq_k the weight beyond joint k projected on its axis.
    """
    algebra, motions = recursion.algebra, recursion.motions
    falling = [Screw(angular=(algebra.zero,) * 3, linear=motion.gravity) for motion in motions]
    links = [key for key in keys if key[1] not in bodies.DRIVE_PARAMETERS]
    units = {key: bodies.build_unit_body(algebra, key[1]) for key in links}
    momenta, weights = (
        {key: bodies.compute_momentum(algebra, body, moving[key[0]]) for key, body in units.items()}
        for moving in (motions, falling)
    )
    turned = transform_screws(recursion, compute_screw_rates(recursion))
    axes = transform_screws(recursion, build_axis_screws(recursion))
    kinetic, potential = (
        {key: project_wrench(recursion, key[0], wrench, screws) for key, wrench in wrenches.items()}
        for wrenches, screws in ((momenta, turned), (weights, axes))
    )
    columns = {key: list(map(algebra.add, entries, potential[key])) for key, entries in kinetic.items()}
    return {key: columns.get(key) or bodies.compute_drive_column(recursion, key, None, -1) for key in keys}


def evaluate_torque_regressor(
    robot: Robot, keys: Sequence[Label], q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> FloatArray:
    """Return torques (N, n, keys) in N m or N per unit of each of `keys`, in the file's parameters.

    q (N, n) in rad or m, dq and ddq (N, n) or (n,), in the order of the coordinates.
    """
    algebra = FloatAlgebra(dict(robot.symbols))
    position, velocity, acceleration = (
        spread_coordinates(robot, algebra, list(rows.T))[: robot.size] for rows in (q, dq, ddq)
    )
    sine, cosine = (tuple(map(wave, position)) for wave in (np.sin, np.cos))
    state = RobotState(sine, cosine, position, velocity, acceleration)
    recursion = replace(build_recursion(robot, algebra, state), meet=lambda link: link)
    result = np.empty((*q.shape, len(keys)))
    for place, column in enumerate(compute_torque_columns(recursion, keys).values()):
        for coordinate, entry in enumerate(fold_vector(robot, algebra, column)):
            result[:, coordinate, place] = entry
    return result


def evaluate_weight_columns(robot: Robot, q: FloatArray) -> FloatArray:
    """Return what holds the robot at rest at q (N, n) in rad or m: (3, N, n, 4 links), in N m or N.

    Per 1 m/s^2 of gravity along x, y and z of the base and per unit of each link's `WEIGHED` parameters;
    springs apart. Gravity g makes sum_k g_k W_k pi.
    """
    keys = [(link, name) for link in range(robot.size) for name in WEIGHED]
    axes, still = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)), np.zeros(robot.freedom)
    robots = (replace(robot, gravity=axis) for axis in axes)
    return np.stack([evaluate_torque_regressor(turned, keys, q, still, still) for turned in robots])
