"""Regressors: momentum, dL/dq, torque, Slotine-Li.

Input: a robot, an algebra, a state, the parameters wanted as (link, name). Output: for each
of them a column of n entries.

A wrench per unit parameter is carried from its link down the tree, the joints' screws up; the entry of a
joint is their product. With `meet` None the wrench goes down to every joint (column recursion); where it
names the link itself, all screws come up to it (axis projection).

Supported: the ten standard parameters of each link, rotor inertias and springs.
"""

from collections.abc import Callable, Sequence

from symid.algebra.scalar import T
from symid.dynamics.drives import DRIVE, find_drive_column
from symid.dynamics.kinematics import Recursion
from symid.dynamics.screws import carry_screws, find_axis_screws, find_turned_screws
from symid.dynamics.spins import Reference, find_spins
from symid.dynamics.tensor_forms import find_spin_wrench
from symid.dynamics.wrenches import (
    Meeting,
    Wrench,
    find_gravity_wrench,
    find_momentum,
    project_columns,
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
    meet: Meeting | None,
) -> Columns[T]:
    """Return the columns of `keys`: wrenches projected on the axes; `drive` goes to `find_drive_column`."""
    wrenches = {(link, name): link_wrench(link, name) for link, name in keys if name not in DRIVE}
    screws = carry_screws(recursion, find_axis_screws(recursion))
    columns = project_columns(recursion, wrenches, screws, meet)
    columns |= {key: find_drive_column(recursion, key, *drive) for key in keys if key[1] in DRIVE}
    return {key: columns[key] for key in keys}


def find_torque_columns(
    recursion: Recursion[T], keys: Sequence[Key], *, meet: Meeting | None = None
) -> Columns[T]:
    """Return the torque regressor's columns: tau = Y(q, dq, ddq) pi."""
    return _find_spin_columns(recursion, None, keys, meet)


def find_slotine_li_columns(
    recursion: Recursion[T], reference: Reference[T], keys: Sequence[Key], *, meet: Meeting | None = None
) -> Columns[T]:
    """Return the columns of M ddqr + C dqr + g (Slotine and Li 1987); see `spins` for the factor C.

    Args:
        recursion: the robot in its state (q, dq).
        reference: dqr and ddqr, rad/s and rad/s^2.
        keys: the parameters wanted.
        meet: where columns and screws meet.
    """
    return _find_spin_columns(recursion, reference, keys, meet)


def _find_spin_columns(
    recursion: Recursion[T], reference: Reference[T] | None, keys: Sequence[Key], meet: Meeting | None
) -> Columns[T]:
    spins = find_spins(recursion, reference)
    accelerations = reference[1] if reference else recursion.state.acceleration
    return _collect(
        recursion,
        keys,
        lambda link, name: find_spin_wrench(recursion.algebra, name, spins[link]),
        (accelerations, 1),
        meet,
    )


def find_momentum_columns(
    recursion: Recursion[T], keys: Sequence[Key], *, meet: Meeting | None = None
) -> Columns[T]:
    """Return the momentum regressor's columns: dT/ddq = Yp(q, dq) pi."""
    return _collect(
        recursion,
        keys,
        lambda link, name: find_momentum(recursion.algebra, name, recursion.motions[link]),
        (recursion.state.velocity, 0),
        meet,
    )


def find_lagrange_columns(
    recursion: Recursion[T], keys: Sequence[Key], *, meet: Meeting | None = None
) -> Columns[T]:
    """Return the columns of dL/dq = dT/dq - dV/dq.

    dT/dq_k is the momentum beyond joint k times v_k x z_k, the change of the link's velocity by
    its joint's coordinate; -dV/dq_k the weight beyond joint k projected on its axis.
    """
    algebra, motions = recursion.algebra, recursion.motions
    links = [key for key in keys if key[1] not in DRIVE]
    momenta = {(link, name): find_momentum(algebra, name, motions[link]) for link, name in links}
    weights = {(link, name): find_gravity_wrench(algebra, name, motions[link]) for link, name in links}
    turned = carry_screws(recursion, find_turned_screws(recursion))
    axes = carry_screws(recursion, find_axis_screws(recursion))
    kinetic = project_columns(recursion, momenta, turned, meet)
    potential = project_columns(recursion, weights, axes, meet)
    columns: Columns[T] = {}
    for key in keys:
        if key[1] in DRIVE:
            columns[key] = find_drive_column(recursion, key, None, -1)
        else:
            columns[key] = [algebra.add(a, b) for a, b in zip(kinetic[key], potential[key], strict=True)]
    return columns
