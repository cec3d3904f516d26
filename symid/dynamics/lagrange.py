"""The Lagrangian forms, derived from the energy: momentum, dL/dq and torque, exactly.

Input: a robot. Output: `ExactEnergy`, polynomials of kinetic and potential energy per standard parameter,
and what follows from them by differentiation alone:

    p = dT/ddq,    tau = dp/dt - dT/dq + dV/dq    (Lagrange).

This is the slow, sure way. Code comes from the recursion; tests prove both to be the same.

Supported: everything the exact algebra supports. The torque regressor of a chain of seven joints has
many terms: `evaluate_torque_columns` gives it at exact rational points instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sympy.polys.rings import PolyElement

from symid.algebra.exact import ExactAlgebra, build_exact_algebra, build_exact_state, differentiate
from symid.dynamics.energy import find_energy_rows
from symid.dynamics.kinematics import build_recursion
from symid.dynamics.regressors import Columns, Key
from symid.notation import INERTIAL
from symid.robot.description import JointKind, Robot

__all__ = [
    "ExactEnergy",
    "derive_energy",
    "derive_lagrange_columns",
    "derive_momentum_columns",
    "derive_torque_columns",
    "evaluate_torque_columns",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactEnergy:
    """Kinetic and potential energy per unit of each standard parameter, as polynomials."""

    robot: Robot
    algebra: ExactAlgebra
    kinetic: Mapping[Key, PolyElement]
    potential: Mapping[Key, PolyElement]

    @property
    def keys(self) -> tuple[Key, ...]:
        """Return the parameters in canonical order."""
        return tuple(self.kinetic)


def derive_energy(robot: Robot) -> ExactEnergy:
    """Return the exact energy regressors of all standard parameters (Gautier and Khalil 1988)."""
    algebra = build_exact_algebra(robot)
    state = build_exact_state(robot, algebra)
    motions = build_recursion(robot, algebra, state).motions
    kinetic: dict[Key, PolyElement] = {}
    potential: dict[Key, PolyElement] = {}
    for link, (joint, motion) in enumerate(zip(robot.joints, motions, strict=True)):
        rows = find_energy_rows(algebra, motion)
        for index, name in enumerate(INERTIAL):
            kinetic[link, name] = rows.kinetic[index]
            potential[link, name] = rows.potential[index]
        if joint.drive.has_rotor:
            kinetic[link, "IA"] = algebra.half(state.velocity[link] ** 2)
            potential[link, "IA"] = algebra.zero
    return ExactEnergy(robot=robot, algebra=algebra, kinetic=kinetic, potential=potential)


def derive_momentum_columns(energy: ExactEnergy, keys: Sequence[Key]) -> Columns[PolyElement]:
    """Return p = dT/ddq per unit of each parameter."""
    rates = [energy.algebra.generator(f"dq{k + 1}") for k in range(energy.robot.size)]
    return {key: [energy.kinetic[key].diff(rate) for rate in rates] for key in keys}


def derive_lagrange_columns(energy: ExactEnergy, keys: Sequence[Key]) -> Columns[PolyElement]:
    """Return dL/dq = dT/dq - dV/dq per unit of each parameter."""
    joints = range(energy.robot.size)
    return {
        key: [
            differentiate(energy.robot, energy.algebra, energy.kinetic[key] - energy.potential[key], k)
            for k in joints
        ]
        for key in keys
    }


def derive_torque_columns(energy: ExactEnergy, keys: Sequence[Key]) -> Columns[PolyElement]:
    """Return tau = dp/dt - dL/dq per unit of each parameter."""
    algebra, robot = energy.algebra, energy.robot
    momenta = derive_momentum_columns(energy, keys)
    forces = derive_lagrange_columns(energy, keys)
    rates = [algebra.generator(f"dq{k + 1}") for k in range(robot.size)]
    accelerations = [algebra.generator(f"ddq{k + 1}") for k in range(robot.size)]

    def time_derivative(value: PolyElement) -> PolyElement:
        result = algebra.zero
        for j in range(robot.size):
            result += (
                differentiate(robot, algebra, value, j) * rates[j] + value.diff(rates[j]) * accelerations[j]
            )
        return algebra.reduce(result)

    return {
        key: [time_derivative(p) - force for p, force in zip(momenta[key], forces[key], strict=True)]
        for key in keys
    }


def _gradient(polynomial: PolyElement, point: Sequence[Any]) -> dict[int, Any]:
    """Return all first derivatives by generators at a point, in one pass over the terms."""
    result: dict[int, Any] = {}
    for monomial, coefficient in polynomial.items():
        for index, exponent in enumerate(monomial):
            if exponent:
                value = coefficient * exponent * point[index] ** (exponent - 1)
                for other, power in enumerate(monomial):
                    if power and other != index:
                        value *= point[other] ** power
                result[index] = result.get(index, 0) + value
    return result


def _generator_rates(
    energy: ExactEnergy, values: Mapping[str, Any]
) -> tuple[list[Any], list[Any], list[list[tuple[int, Any]]]]:
    """Return the point, the time derivative of each generator, and d(generator)/dq_k as sparse columns."""
    names = [str(symbol) for symbol in energy.algebra.ring.symbols]
    point = [values[name] for name in names]
    rates = [0 * point[0]] * len(names)
    by_joint: list[list[tuple[int, Any]]] = []
    for k, joint in enumerate(energy.robot.joints):
        number = str(k + 1)
        rates[names.index("dq" + number)] = values["ddq" + number]
        if joint.kind is JointKind.PRISMATIC:
            column = [(names.index("q" + number), values["dq" + number] ** 0)]
        else:
            column = [
                (names.index("s" + number), values["c" + number]),
                (names.index("c" + number), -values["s" + number]),
            ]
        for index, slope in column:
            rates[index] = slope * values["dq" + number]
        by_joint.append(column)
    return point, rates, by_joint


def evaluate_torque_columns(
    energy: ExactEnergy, keys: Sequence[Key], values: Mapping[str, Any]
) -> Columns[Any]:
    """Return tau = dp/dt - dL/dq per unit of each parameter at one exact point.

    Args:
        energy: the exact energy.
        keys: the parameters wanted.
        values: a number of the ring's field for each generator; s^2 + c^2 = 1 must hold.
    """
    point, rates, by_joint = _generator_rates(energy, values)
    momenta = derive_momentum_columns(energy, keys)
    result: Columns[Any] = {}
    for key in keys:
        slope = _gradient(energy.kinetic[key] - energy.potential[key], point)
        entries = []
        for k, column in enumerate(by_joint):
            change = _gradient(momenta[key][k], point)
            entry = sum((part * rates[index] for index, part in change.items()), 0 * point[0])
            entries.append(entry - sum(slope[index] * factor for index, factor in column if index in slope))
        result[key] = entries
    return result
