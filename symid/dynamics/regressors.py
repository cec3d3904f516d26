"""Regressors by column recursion: momentum, dL/dq, torque, Slotine-Li.

Input: a robot, an algebra, a state, the parameters wanted as (link, name). Output: for each
of them a column of n entries.

A wrench per unit parameter is carried from its link down to the base; at every joint on the
way it is projected on the joint's axis (or, for dL/dq, on the axis's change of motion).

Supported: the ten standard parameters of each link, rotor inertias and springs.
"""

from collections.abc import Callable, Sequence

from symid.algebra.scalar import T
from symid.algebra.vectors import Vector, cross, dot
from symid.dynamics.drives import DRIVE, find_drive_column
from symid.dynamics.kinematics import Recursion, find_motions
from symid.dynamics.newton_euler import find_accelerations, find_reference_rates
from symid.dynamics.wrenches import (
    Wrench,
    find_gravity_wrench,
    find_inertial_wrench,
    find_momentum,
    find_slotine_li_wrench,
    project_columns,
    project_on_axis,
)

__all__ = [
    "Columns",
    "Key",
    "find_lagrange_columns",
    "find_momentum_columns",
    "find_slotine_li_columns",
    "find_torque_columns",
]

Key = tuple[int, str]
Columns = dict[Key, Sequence[T]]


def _collect(
    recursion: Recursion[T],
    keys: Sequence[Key],
    link_wrench: Callable[[int, str], Wrench[T]],
    drive: tuple[Sequence[T], int],
) -> Columns[T]:
    """Return the columns of `keys`: wrenches projected on the axes; `drive` goes to `find_drive_column`."""
    frames = recursion.frames
    wrenches = {(link, name): link_wrench(link, name) for link, name in keys if name not in DRIVE}
    columns = project_columns(
        recursion, wrenches, lambda joint, wrench: project_on_axis(frames[joint], wrench)
    )
    columns |= {key: find_drive_column(recursion, key, *drive) for key in keys if key[1] in DRIVE}
    return {key: columns[key] for key in keys}


def find_torque_columns(recursion: Recursion[T], keys: Sequence[Key]) -> Columns[T]:
    """Return the torque regressor's columns: tau = Y(q, dq, ddq) pi."""
    algebra, motions = recursion.algebra, recursion.motions
    accelerations = find_accelerations(recursion)
    return _collect(
        recursion,
        keys,
        lambda link, name: find_inertial_wrench(algebra, name, motions[link].angular, accelerations[link]),
        (recursion.state.acceleration, 1),
    )


def find_slotine_li_columns(
    recursion: Recursion[T], reference: tuple[tuple[T, ...], tuple[T, ...]], keys: Sequence[Key]
) -> Columns[T]:
    """Return the columns of M ddqr + C dqr + g (Slotine and Li 1987).

    Args:
        recursion: the robot in its state (q, dq).
        reference: dqr and ddqr, rad/s and rad/s^2.
        keys: the parameters wanted.
    """
    velocity, acceleration = reference
    algebra, motions = recursion.algebra, recursion.motions
    references = find_motions(recursion.robot, algebra, recursion.frames, velocity)
    rates = find_reference_rates(recursion, references, acceleration)
    return _collect(
        recursion,
        keys,
        lambda link, name: find_slotine_li_wrench(
            algebra, name, motions[link], references[link], rates[link]
        ),
        (acceleration, 1),
    )


def find_momentum_columns(recursion: Recursion[T], keys: Sequence[Key]) -> Columns[T]:
    """Return the momentum regressor's columns: dT/ddq = Yp(q, dq) pi."""
    return _collect(
        recursion,
        keys,
        lambda link, name: find_momentum(recursion.algebra, name, recursion.motions[link]),
        (recursion.state.velocity, 0),
    )


def find_lagrange_columns(recursion: Recursion[T], keys: Sequence[Key]) -> Columns[T]:
    """Return the columns of dL/dq = dT/dq - dV/dq.

    dT/dq_k is the momentum beyond joint k times v_k x z_k, the change of the link's velocity by
    its joint's coordinate; -dV/dq_k the weight beyond joint k projected on its axis.
    """
    algebra, frames, motions = recursion.algebra, recursion.frames, recursion.motions
    zero = algebra.zero
    axis: Vector[T] = (zero, zero, algebra.one)

    def project(joint: int, wrench: Wrench[T]) -> T:
        turned = cross(algebra, motions[joint].angular, axis)
        if not frames[joint].revolute:
            return dot(algebra, wrench.force, turned)
        moved = cross(algebra, motions[joint].linear, axis)
        return algebra.add(dot(algebra, wrench.moment, turned), dot(algebra, wrench.force, moved))

    links = [key for key in keys if key[1] not in DRIVE]
    momenta = {(link, name): find_momentum(algebra, name, motions[link]) for link, name in links}
    weights = {(link, name): find_gravity_wrench(algebra, name, motions[link]) for link, name in links}
    kinetic = project_columns(recursion, momenta, project)
    potential = project_columns(
        recursion, weights, lambda joint, wrench: project_on_axis(frames[joint], wrench)
    )
    columns: Columns[T] = {}
    for key in keys:
        if key[1] in DRIVE:
            columns[key] = find_drive_column(recursion, key, None, -1)
        else:
            columns[key] = [algebra.add(a, b) for a, b in zip(kinetic[key], potential[key], strict=True)]
    return columns
