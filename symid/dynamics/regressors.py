"""Regressors of energy, momentum, dL/dq, torque and Slotine-Li control, by the recursion and by Lagrange.

Motion of a link -> its energy per standard parameter, T = hT pi and V = hV pi, in the order of
`notation.INERTIAL`. Recursion, the parameters wanted as (link, name) -> a column over the joints for each.

Gautier and Khalil 1988, with V_j the velocity of the frame's origin, g_j the gravity vector in the link's
frame, and u_j = -g' P_j:
    hT = (w1^2/2, w1 w2, w1 w3, w2^2/2, w2 w3, w3^2/2,
          w3 V2 - w2 V3, w1 V3 - w3 V1, w2 V1 - w1 V2, V'V/2)
    hV = (0, 0, 0, 0, 0, 0, -g1, -g2, -g3, u)

Where the recursion names no meeting, wrenches go down to every joint (column recursion); where it names the
link itself, all screws come up to it (axis projection).

Code comes from the recursion, in any algebra. The Lagrangian forms come from the energy alone, exactly, by
differentiation; tests prove both to be the same. Robot -> `ExactEnergy`, polynomials of kinetic and
potential energy per standard parameter, and
    p = dT/ddq,    tau = dp/dt - dT/dq + dV/dq    (Lagrange).

Supported: the ten standard parameters of each link, rotor inertias and springs; Lagrangian forms of all that
the exact algebra supports, for long chains torques at exact rational points.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sympy.polys.rings import PolyElement

from symid.dynamics import bodies
from symid.dynamics.algebra import Algebra, Label, T, build_state
from symid.dynamics.exact_algebra import ExactAlgebra, Number, build_exact_algebra, differentiate
from symid.dynamics.newton_euler import Reference, compute_acceleration_tensors, compute_link_wrench
from symid.dynamics.recursion import (
    LinkMotion,
    Recursion,
    Screw,
    Wrench,
    build_axis_screws,
    build_recursion,
    compute_screw_rates,
    project_wrench,
    transform_screws,
)
from symid.notation import INERTIAL
from symid.robot import JointKind, Robot


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


Columns = dict[Label, Sequence[T]]


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
    columns: Columns[T] = {
        key: project_wrench(recursion, key[0], wrench, screws) for key, wrench in wrenches.items()
    }
    columns |= {
        key: bodies.compute_drive_column(recursion, key, *drive)
        for key in keys
        if key[1] in bodies.DRIVE_PARAMETERS
    }
    return {key: columns[key] for key in keys}


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
    momenta, weights = (
        {
            key: bodies.compute_momentum(algebra, bodies.build_unit_body(algebra, key[1]), moving[key[0]])
            for key in links
        }
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
    state = build_state(robot, algebra, algebra.generators)
    recursion = build_recursion(robot, algebra, state)
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
    forms = {key: energy.kinetic[key] - energy.potential[key] for key in keys}
    return {
        key: [differentiate(robot, algebra, form, k) for k in robot.coordinates]
        for key, form in forms.items()
    }


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


def _compute_gradient(polynomial: PolyElement, point: Sequence[Number]) -> dict[int, Number]:
    """Return all first derivatives by generators at a point, in one pass over the terms."""
    result: dict[int, Number] = {}
    for monomial, coefficient in polynomial.items():
        for index, exponent in enumerate(monomial):
            if exponent:
                value = coefficient * exponent * point[index] ** (exponent - 1)
                for other, power in enumerate(monomial):
                    if power and other != index:
                        value *= point[other] ** power
                result[index] = result.get(index, 0) + value
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
        slope = _compute_gradient(energy.kinetic[key] - energy.potential[key], point)
        entries = []
        for k, column in enumerate(by_coordinate):
            change = _compute_gradient(momenta[key][k], point)
            entry = sum((part * rates[index] for index, part in change.items()), 0 * point[0])
            pull = (slope[index] * factor for index, factor in column if index in slope)
            entries.append(entry - sum(pull, 0 * point[0]))
        result[key] = entries
    return result
