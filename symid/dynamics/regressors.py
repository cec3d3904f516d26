"""Regressors by column recursion: momentum, dL/dq, torque, Slotine-Li.

Input: a robot, an algebra, a state, the parameters wanted as (link, name). Output: for each
of them a column of n entries.

A wrench per unit parameter is carried from its link down to the base; at every joint on the
way it is projected on the joint's axis (or, for dL/dq, on the axis's change of motion).

Supported: the ten standard parameters of each link and IA, the reflected rotor inertia.
"""

from collections.abc import Callable, Sequence

from symid.algebra.scalar import Algebra, State, T
from symid.algebra.vectors import Vector, cross, dot
from symid.dynamics.kinematics import Frame, Motion, find_motions
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
from symid.robot.description import Robot

__all__ = ["Columns", "Key", "find_lagrange_columns", "find_momentum_columns", "find_slotine_li_columns", "find_torque_columns"]

Key = tuple[int, str]
Columns = dict[Key, Sequence[T]]


def _collect(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    keys: Sequence[Key],
    link_wrench: Callable[[int, str], Wrench[T]],
    rotor: Sequence[T],
) -> Columns[T]:
    """Return the columns of `keys`: wrenches projected on the axes; `rotor` per unit of IA."""
    wrenches = {(link, name): link_wrench(link, name) for link, name in keys if name != "IA"}
    columns = project_columns(
        robot, algebra, frames, wrenches, lambda joint, wrench: project_on_axis(frames[joint], wrench)
    )
    for joint, name in keys:
        if name == "IA":
            columns[joint, name] = [rotor[k] if k == joint else algebra.zero for k in range(robot.size)]
    return {key: columns[key] for key in keys}


def find_torque_columns(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    motions: tuple[Motion[T], ...],
    state: State[T],
    keys: Sequence[Key],
) -> Columns[T]:
    """Return the torque regressor's columns: tau = Y(q, dq, ddq) pi."""
    accelerations = find_accelerations(robot, algebra, frames, motions, state)
    return _collect(
        robot,
        algebra,
        frames,
        keys,
        lambda link, name: find_inertial_wrench(algebra, name, motions[link].angular, accelerations[link]),
        state.acceleration,
    )


def find_slotine_li_columns(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    motions: tuple[Motion[T], ...],
    state: State[T],
    reference: tuple[tuple[T, ...], tuple[T, ...]],
    keys: Sequence[Key],
) -> Columns[T]:
    """Return the columns of M ddqr + C dqr + g (Slotine and Li 1987).

    Args:
        robot, algebra, frames, motions, state, keys: as for the torque regressor.
        reference: dqr and ddqr.
    """
    velocity, acceleration = reference
    references = find_motions(robot, algebra, frames, velocity)
    rates = find_reference_rates(robot, algebra, frames, state, references, acceleration)
    return _collect(
        robot,
        algebra,
        frames,
        keys,
        lambda link, name: find_slotine_li_wrench(algebra, name, motions[link], references[link], rates[link]),
        acceleration,
    )


def find_momentum_columns(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    motions: tuple[Motion[T], ...],
    state: State[T],
    keys: Sequence[Key],
) -> Columns[T]:
    """Return the momentum regressor's columns: dT/ddq = Yp(q, dq) pi."""
    return _collect(
        robot, algebra, frames, keys, lambda link, name: find_momentum(algebra, name, motions[link]), state.velocity
    )


def find_lagrange_columns(
    robot: Robot,
    algebra: Algebra[T],
    frames: tuple[Frame[T], ...],
    motions: tuple[Motion[T], ...],
    keys: Sequence[Key],
) -> Columns[T]:
    """Return the columns of dL/dq = dT/dq - dV/dq.

    dT/dq_k is the momentum beyond joint k times v_k x z_k, the change of the link's velocity by
    its joint's coordinate; -dV/dq_k the weight beyond joint k projected on its axis.
    """
    zero = algebra.zero
    axis: Vector[T] = (zero, zero, algebra.one)

    def project(joint: int, wrench: Wrench[T]) -> T:
        turned = cross(algebra, motions[joint].angular, axis)
        if not frames[joint].revolute:
            return dot(algebra, wrench.force, turned)
        moved = cross(algebra, motions[joint].linear, axis)
        return algebra.add(dot(algebra, wrench.moment, turned), dot(algebra, wrench.force, moved))

    links = [key for key in keys if key[1] != "IA"]
    momenta = {(link, name): find_momentum(algebra, name, motions[link]) for link, name in links}
    weights = {(link, name): find_gravity_wrench(algebra, name, motions[link]) for link, name in links}
    kinetic = project_columns(robot, algebra, frames, momenta, project)
    potential = project_columns(
        robot, algebra, frames, weights, lambda joint, wrench: project_on_axis(frames[joint], wrench)
    )
    columns: Columns[T] = {}
    for key in keys:
        if key[1] == "IA":
            columns[key] = [zero] * robot.size
        else:
            columns[key] = [algebra.add(a, b) for a, b in zip(kinetic[key], potential[key], strict=True)]
    return columns
