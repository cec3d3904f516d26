"""What drives and springs add to the energy and the torques of the joints.

Input: a recursion, a parameter IA, KS or KR of a joint or coupling. Output: its energy, and its column
over the joints, one entry each.

    T = IA w^2 / 2,  w the speed of the joint, or of the coupling, sum of factor * dq over its joints;
    V = KS q^2 / 2 + KR q,  the spring KS (q - rest) with KR = -KS rest.

Supported: rotor inertias of joints and couplings, springs of joints.
"""

from collections.abc import Mapping, Sequence

from symid.algebra.scalar import Algebra, T
from symid.dynamics.kinematics import Recursion
from symid.robot.description import Robot
from symid.robot.geometry import Exact

__all__ = [
    "DRIVE",
    "add_drive_inertia",
    "add_drive_torques",
    "find_drive_column",
    "find_drive_energy",
    "list_drive_parameters",
]

DRIVE = ("IA", "KS", "KR")
"""Parameters of drives and springs, in their order within a joint."""

Key = tuple[int, str]


def list_drive_parameters(robot: Robot) -> tuple[Key, ...]:
    """Return the drive parameters of the robot: those of the joints, then of the couplings.

    The rotor of an elastic joint moves with the motor, not with the link: its inertia is not among them.
    """
    keys: list[Key] = []
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


def _find_rate(robot: Robot, algebra: Algebra[T], index: int, rates: Sequence[T]) -> T:
    total = algebra.zero
    for joint, factor in _list_shares(robot, index):
        total = algebra.add(total, algebra.mul(algebra.constant(factor), rates[joint]))
    return total


def find_drive_energy(recursion: Recursion[T], key: Key) -> tuple[T, T]:
    """Return kinetic and potential energy per unit of a drive parameter."""
    robot, algebra, state = recursion.robot, recursion.algebra, recursion.state
    index, name = key
    if name == "IA":
        rate = _find_rate(robot, algebra, index, state.velocity)
        return algebra.half(algebra.mul(rate, rate)), algebra.zero
    position = state.position[index]
    if name == "KS":
        return algebra.zero, algebra.half(algebra.mul(position, position))
    return algebra.zero, position


def find_drive_column(
    recursion: Recursion[T], key: Key, rates: Sequence[T] | None, springs: int
) -> Sequence[T]:
    """Return the entries of a drive parameter at every joint.

    Args:
        recursion: the robot in its state.
        key: IA, KS or KR of a joint or coupling.
        rates: what a rotor inertia is multiplied with at every joint: accelerations for torques,
            velocities for momenta; None where rotors do not show.
        springs: the sign with which spring torques count: 1 in torques, -1 in dL/dq, 0 in momenta.
    """
    robot, algebra = recursion.robot, recursion.algebra
    index, name = key
    entries = [algebra.zero] * robot.size
    if name == "IA" and rates is not None:
        rate = _find_rate(robot, algebra, index, rates)
        for joint, factor in _list_shares(robot, index):
            entries[joint] = algebra.add(entries[joint], algebra.mul(algebra.constant(factor), rate))
    elif name != "IA" and springs:
        value = recursion.state.position[index] if name == "KS" else algebra.one
        entries[index] = value if springs > 0 else algebra.neg(value)
    return entries


def add_drive_torques(
    recursion: Recursion[T], torques: Sequence[T], parameters: Mapping[Key, T], rates: Sequence[T]
) -> tuple[T, ...]:
    """Return the torques of the joints with those of rotors, for accelerations `rates`, and springs."""
    algebra = recursion.algebra
    result = list(torques)
    for key in list_drive_parameters(recursion.robot):
        if key in parameters:
            column = find_drive_column(recursion, key, rates, 1)
            for joint, entry in enumerate(column):
                result[joint] = algebra.add(result[joint], algebra.mul(parameters[key], entry))
    return tuple(result)


def add_drive_inertia(
    recursion: Recursion[T], matrix: Sequence[Sequence[T]], parameters: Mapping[Key, T]
) -> tuple[tuple[T, ...], ...]:
    """Return the mass matrix of the joints with that of the rotors."""
    robot, algebra = recursion.robot, recursion.algebra
    result = [list(row) for row in matrix]
    for key in list_drive_parameters(robot):
        if key[1] != "IA" or key not in parameters:
            continue
        shares = _list_shares(robot, key[0])
        for i, left in shares:
            for j, right in shares:
                share = algebra.mul(algebra.constant(left * right), parameters[key])
                result[i][j] = algebra.add(result[i][j], share)
    return tuple(tuple(row) for row in result)
