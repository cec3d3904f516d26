"""Exact regressors by Lagrange, from the energy alone: they prove what the recursion gives.

Robot -> `ExactEnergy`, polynomials of kinetic and potential energy per standard parameter, and by
differentiation

    p = dT/ddq,    tau = dp/dt - dT/dq + dV/dq    (Lagrange).

Supported: all that the exact algebra supports, rotor inertias and springs too; for long chains torques at
exact rational points.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, starmap

from sympy.polys.rings import PolyElement

from symid.dynamics import bodies
from symid.dynamics.algebra import Label, build_state
from symid.dynamics.exact_algebra import ExactAlgebra, Number, build_exact_algebra, differentiate
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import Columns, compute_energy_regressor
from symid.notation import INERTIAL
from symid.robot import JointKind, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactEnergy:
    """Kinetic and potential energy per unit of each standard parameter, as polynomials."""

    robot: Robot
    algebra: ExactAlgebra
    kinetic: Mapping[Label, PolyElement]
    potential: Mapping[Label, PolyElement]


def derive_energy(robot: Robot) -> ExactEnergy:
    """Return the exact energy regressors of all standard parameters (Gautier and Khalil 1988)."""
    algebra = build_exact_algebra(robot)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, algebra.generators))
    kinetic: dict[Label, PolyElement] = {}
    potential: dict[Label, PolyElement] = {}
    for link, motion in enumerate(recursion.motions):
        for name, moving, resting in zip(INERTIAL, *compute_energy_regressor(algebra, motion), strict=True):
            kinetic[link, name], potential[link, name] = moving, resting
    for key in bodies.list_drive_parameters(robot):
        kinetic[key], potential[key] = bodies.compute_drive_energy(recursion, key)
    return ExactEnergy(robot=robot, algebra=algebra, kinetic=kinetic, potential=potential)


def derive_momentum_columns(energy: ExactEnergy, keys: Sequence[Label]) -> Columns[PolyElement]:
    """Return p = dT/ddq per unit of each parameter."""
    rates = [energy.algebra.generators[f"dq{k + 1}"] for k in energy.robot.coordinates]
    return {key: [energy.kinetic[key].diff(rate) for rate in rates] for key in keys}


def derive_lagrange_columns(energy: ExactEnergy, keys: Sequence[Label]) -> Columns[PolyElement]:
    """Return dL/dq = dT/dq - dV/dq per unit of each parameter."""
    robot, algebra = energy.robot, energy.algebra
    forms = ((key, energy.kinetic[key] - energy.potential[key]) for key in keys)
    places = robot.coordinates
    return {key: [differentiate(robot, algebra, form, k) for k in places] for key, form in forms}


def derive_torque_columns(energy: ExactEnergy, keys: Sequence[Label]) -> Columns[PolyElement]:
    """Return tau = dp/dt - dL/dq per unit of each parameter."""
    algebra, robot = energy.algebra, energy.robot
    momenta = derive_momentum_columns(energy, keys)
    forces = derive_lagrange_columns(energy, keys)
    rates = {k: algebra.generators[f"dq{k + 1}"] for k in robot.coordinates}
    accelerations = {k: algebra.generators[f"ddq{k + 1}"] for k in robot.coordinates}

    def time_derivative(value: PolyElement) -> PolyElement:
        parts = [differentiate(robot, algebra, value, j) * rates[j] for j in robot.coordinates]
        parts += [value.diff(rates[j]) * accelerations[j] for j in robot.coordinates]
        return algebra.reduce(sum(parts, algebra.zero))

    return {
        key: [time_derivative(p) - force for p, force in zip(momenta[key], forces[key], strict=True)]
        for key in keys
    }


def _compute_gradient(polynomial: PolyElement, power: Callable[[int, int], Number]) -> dict[int, Number]:
    """Return all first derivatives by generators at a point, by the `power` of each, term by term."""
    result: dict[int, Number] = {}
    for monomial, after in polynomial.items():
        factors = [(index, exponent) for index, exponent in enumerate(monomial) if exponent]
        before = list(accumulate(starmap(power, factors), operator.mul, initial=power(0, 0)))
        for (index, exponent), left in zip(reversed(factors), reversed(before[:-1]), strict=True):
            value = left * after * (exponent * power(index, exponent - 1))
            result[index] = result.get(index, 0) + value
            after *= power(index, exponent)  # noqa: PLW2901
    return result


def evaluate_torque_columns(
    energy: ExactEnergy, keys: Sequence[Label], values: Mapping[str, Number]
) -> Columns[Number]:
    """Return tau = dp/dt - dL/dq per unit of each parameter at one exact point.

    `values` has a number of the ring's field for each generator; s^2 + c^2 = 1 must hold.
    """
    # Point, the time derivative of each generator, and d(generator)/dq as sparse columns.
    names = [str(symbol) for symbol in energy.algebra.ring.symbols]
    point = [values[name] for name in names]
    power = cache(lambda index, exponent: point[index] ** exponent)
    rates = [0 * point[0]] * len(names)
    robot, convert = energy.robot, energy.algebra.ring.domain.convert
    by_coordinate: list[list[tuple[int, Number]]] = [[] for _ in robot.coordinates]
    for k, joint in enumerate(robot.joints):
        number = str(k + 1)
        ((position, multiplier),) = robot.transmission[k]
        factor = convert(multiplier.numerator) / convert(multiplier.denominator)
        slopes = {"q" + number: factor} if "q" + number in names else {}
        if joint.kind is JointKind.REVOLUTE:
            slopes["s" + number] = factor * values["c" + number]
            slopes["c" + number] = -factor * values["s" + number]
        by_coordinate[position] += [(names.index(name), slope) for name, slope in slopes.items()]
    for k, column in zip(robot.coordinates, by_coordinate, strict=True):
        rates[names.index(f"dq{k + 1}")] = values[f"ddq{k + 1}"]
        for index, slope in column:
            rates[index] = slope * values[f"dq{k + 1}"]
    momenta = derive_momentum_columns(energy, keys)
    result: Columns[Number] = {}
    for key in keys:
        slope = _compute_gradient(energy.kinetic[key] - energy.potential[key], power)
        entries = []
        for k, column in enumerate(by_coordinate):
            change = _compute_gradient(momenta[key][k], power)
            entry = sum((part * rates[index] for index, part in change.items()), 0 * point[0])
            pull = (slope[index] * factor for index, factor in column if index in slope)
            entries.append(entry - sum(pull, 0 * point[0]))
        result[key] = entries
    return result
