"""Every way to compute a function of the catalogue, as a builder: workspace -> elements of the output ports.

Kinematics and friction; energies and what follows from them by differentiation, p = dT/ddq and
tau = dp/dt - dL/dq (Lagrange); torques, regressors and mass matrix by recursion; forward dynamics and
derivatives of inverse dynamics from a mass matrix and torques of other routes; springs with hysteresis.

The torque of the motors of an elastic robot follows from the motion of the links (Spong 1987), with the
spring turned round:

    tau_J = inverse dynamics,  phi = H^-1[tau_J],  theta = q + phi,  tau_m = IA ddtheta + F(dtheta) + tau_J

Rates of phi are c times those of tau_J, c the slope of phi against tau_J in the direction in which it
goes; it is constant between kinks. Rates of tau_J come from differentiating the recursion twice in time.

Supported: everything the recursion and the friction models support; stops, knees, friction of the motors.
Not supported: damping, cubic springs and coupled drives in the inverse of a spring; the catalogue has no
such function for these robots.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from symid.codegen.catalogue import build_spring_terms
from symid.codegen.programs import (
    Op,
    ValueAlgebra,
    differentiate_along,
    differentiate_backward,
    differentiate_forward,
)
from symid.codegen.workspace import (
    Elements,
    RouteBuilder,
    RouteWorkspace,
    flatten_columns,
    flatten_coordinate_columns,
    flatten_matrix,
    flatten_vector,
    project_at_depth,
    project_in_link,
)
from symid.dynamics import (
    DRIVE_PARAMETERS,
    Columns,
    ProjectionFrame,
    compute_body_energy,
    compute_drive_energy,
    compute_energy_regressor,
    compute_inverse_dynamics,
    compute_jacobian,
    compute_lagrange_columns,
    compute_link_poses,
    compute_mass_matrix,
    compute_momentum_columns,
    compute_slotine_li_columns,
    compute_tensor_torques,
    compute_torque_columns,
    gather_body,
    spread_coordinates,
    sum_values,
)
from symid.joint_models import (
    FRICTION_MODELS,
    SpringTerms,
    advance_inverse_spring,
    advance_spring,
    compute_friction_columns,
    compute_outer_function,
    get_friction,
    invert_spring,
)
from symid.notation import INERTIAL
from symid.robot import ZERO, Elasticity, Exact, Robot


def emit_forward_kinematics(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return rotations and origins of all links."""
    poses = compute_link_poses(workspace.recursion)
    rotations = tuple(entry for pose in poses for row in pose.rotation for entry in row)
    return rotations, tuple(entry for pose in poses for entry in pose.origin)


def emit_jacobian(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the Jacobian of the last link."""
    rows = compute_jacobian(workspace.recursion)
    return (tuple(entry for row in rows for entry in flatten_vector(workspace, row)),)


def _list_friction_columns(workspace: RouteWorkspace) -> list[list[int]]:
    """Return the friction regressor by columns, each felt where its drive turns."""
    robot = workspace.robot
    algebra = workspace.algebra
    speeds = spread_coordinates(robot, algebra, workspace.inputs["dq"])
    columns = []
    for parameter in workspace.base.friction:
        index, name = parameter.label
        friction = get_friction(robot, index)
        columns_of_model = compute_friction_columns(friction, algebra, speeds[index])
        entry = columns_of_model[FRICTION_MODELS[friction.kind].parameters.index(name)]
        column = [algebra.zero] * robot.freedom
        for position, factor in robot.transmission[index]:
            column[position] = algebra.mul(algebra.constant(Exact.of(factor)), entry)
        columns.append(column)
    return columns


def emit_friction_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the friction regressor."""
    return (flatten_coordinate_columns(workspace, _list_friction_columns(workspace)),)


def emit_friction(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the friction torques."""
    algebra = workspace.recursion.algebra
    torques = [algebra.zero] * workspace.robot.freedom
    for parameter, column in zip(workspace.inputs["f"], _list_friction_columns(workspace), strict=True):
        entries = zip(torques, column, strict=True)
        torques = [algebra.add(torque, algebra.mul(entry, parameter)) for torque, entry in entries]
    return (tuple(torques),)


def _list_energy_rows(workspace: RouteWorkspace) -> tuple[Elements, Elements]:
    """Return kinetic and potential energy per base parameter."""
    algebra = workspace.recursion.algebra
    kinetic, potential = [], []
    rows = [compute_energy_regressor(algebra, motion) for motion in workspace.recursion.motions]
    for link, name in workspace.base.keys:
        if name in DRIVE_PARAMETERS:
            drive = compute_drive_energy(workspace.recursion, (link, name))
            kinetic.append(drive[0])
            potential.append(drive[1])
        else:
            kinetic.append(rows[link].kinetic[INERTIAL.index(name)])
            potential.append(rows[link].potential[INERTIAL.index(name)])
    return tuple(kinetic), tuple(potential)


def _multiply_parameters(workspace: RouteWorkspace, row: Sequence[int]) -> int:
    """Return a row times the base parameters."""
    algebra = workspace.recursion.algebra
    result = algebra.zero
    for value, parameter in zip(row, workspace.parameters.values(), strict=True):
        result = algebra.add(result, algebra.mul(value, parameter))
    return result


def emit_energy_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the energy regressors."""
    return _list_energy_rows(workspace)


def emit_energy(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the energies as regressors times parameters."""
    kinetic, potential = _list_energy_rows(workspace)
    return (_multiply_parameters(workspace, kinetic),), (_multiply_parameters(workspace, potential),)


def emit_energy_of_bodies(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the energies as sums over links and drives."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    parts = [
        compute_body_energy(algebra, gather_body(algebra, workspace.parameters, link), motion)
        for link, motion in enumerate(recursion.motions)
    ]
    for key, value in workspace.parameters.items():
        if key[1] in DRIVE_PARAMETERS:
            kinetic, potential = compute_drive_energy(recursion, key)
            parts.append((algebra.mul(value, kinetic), algebra.mul(value, potential)))
    return (sum_values(algebra, [part[0] for part in parts]),), (
        sum_values(algebra, [part[1] for part in parts]),
    )


def _derive_torque(workspace: RouteWorkspace, kinetic: int, potential: int) -> list[int]:
    table, inputs = workspace.table, workspace.inputs
    momenta = differentiate_backward(table, kinetic, inputs["dq"])
    slopes = differentiate_backward(table, table.add(kinetic, -potential), inputs["q"])
    moving = (*zip(inputs["q"], inputs["dq"], strict=True), *zip(inputs["dq"], inputs["ddq"], strict=True))
    rates = differentiate_forward(table, momenta, dict(moving))
    return [table.add(rate, -slope) for rate, slope in zip(rates, slopes, strict=True)]


def emit_derived_torques(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the joint torques."""
    (kinetic,), (potential,) = emit_energy(workspace)
    return (tuple(_derive_torque(workspace, kinetic, potential)),)


def emit_derived_mass_matrix(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the mass matrix as dp/ddq.

    The velocities are inputs of the momentum only: p is linear in them, its derivatives are free of them.
    """
    table = workspace.table
    rates = tuple(table.input(-1, joint) for joint in range(workspace.robot.freedom))
    moving = workspace.move(rates)
    kinetic = _multiply_parameters(moving, _list_energy_rows(moving)[0])
    momenta = differentiate_backward(table, kinetic, rates)
    one = table.constant(1.0)
    columns = differentiate_along(table, momenta, [{rate: one} for rate in rates])
    return (flatten_coordinate_columns(workspace, columns),)


def emit_derived_momentum_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the momentum regressor."""
    table, rates = workspace.table, workspace.inputs["dq"]
    kinetic, _ = _list_energy_rows(workspace)
    columns = [differentiate_backward(table, value, rates) for value in kinetic]
    return (flatten_coordinate_columns(workspace, columns),)


def emit_derived_lagrange_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the regressor of dL/dq."""
    table, position = workspace.table, workspace.inputs["q"]
    pairs = zip(*_list_energy_rows(workspace), strict=True)
    columns = [differentiate_backward(table, table.add(t, -v), position) for t, v in pairs]
    return (flatten_coordinate_columns(workspace, columns),)


def emit_derived_torque_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torque regressor."""
    pairs = zip(*_list_energy_rows(workspace), strict=True)
    columns = [_derive_torque(workspace, t, v) for t, v in pairs]
    return (flatten_coordinate_columns(workspace, columns),)


def emit_torques_by_tensors(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torques by recursion with acceleration tensors."""
    return (flatten_vector(workspace, compute_tensor_torques(workspace.recursion, workspace.parameters)),)


def emit_torques_by_vectors(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torques by recursion with vectors."""
    return (flatten_vector(workspace, compute_inverse_dynamics(workspace.recursion, workspace.parameters)),)


def emit_torques_by_regressor(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torque regressor times the base parameters."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    columns = compute_torque_columns(recursion, workspace.base.keys, meet=project_in_link(workspace.robot))
    torques = list(workspace.zeros)
    for key, parameter in workspace.parameters.items():
        entries = zip(torques, columns[key], strict=True)
        torques = [algebra.add(torque, algebra.mul(entry, parameter)) for torque, entry in entries]
    return (flatten_vector(workspace, torques),)


def emit_coriolis_matrix(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return C column by column: the torques for dqr = e_k, ddqr = 0, without gravity and springs."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    weightless = replace(recursion, robot=replace(workspace.robot, gravity=(ZERO, ZERO, ZERO)))
    parameters = {key: value for key, value in workspace.parameters.items() if key[1] not in ("KS", "KR")}
    coordinates = range(workspace.robot.freedom)
    columns = []
    for k in coordinates:
        unit = workspace.spread([algebra.one if j == k else algebra.zero for j in coordinates])
        torques = compute_tensor_torques(weightless, parameters, (unit, workspace.zeros))
        columns.append(flatten_vector(workspace, torques))
    return (flatten_coordinate_columns(workspace, columns),)


ProjectionPlace = Callable[[Robot], ProjectionFrame]


def _compute_slotine_li(workspace: RouteWorkspace, meet: ProjectionFrame | None) -> Columns[int]:
    inputs = workspace.inputs
    reference = (workspace.spread(inputs["dqr"]), workspace.spread(inputs["ddqr"]))
    return compute_slotine_li_columns(workspace.recursion, reference, workspace.base.keys, meet=meet)


_REGRESSORS: Mapping[str, Callable[[RouteWorkspace, ProjectionFrame | None], Columns[int]]] = {
    "momentum_regressor": lambda w, meet: compute_momentum_columns(w.recursion, w.base.keys, meet=meet),
    "lagrange_regressor": lambda w, meet: compute_lagrange_columns(w.recursion, w.base.keys, meet=meet),
    "torque_regressor": lambda w, meet: compute_torque_columns(w.recursion, w.base.keys, meet=meet),
    "slotine_li_regressor": _compute_slotine_li,
}


def build_regressor_route(name: str, place: ProjectionPlace | None) -> RouteBuilder:
    """Return the route to a regressor whose wrenches meet at `place`, or that carries all columns down."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        meet = place(workspace.robot) if place else None
        return (flatten_columns(workspace, _REGRESSORS[name](workspace, meet)),)

    return build


def emit_mass_matrix(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the mass matrix from composite bodies, their momenta carried down to every joint."""
    return (flatten_matrix(workspace, compute_mass_matrix(workspace.recursion, workspace.parameters)),)


def build_mass_matrix_route(depth: int) -> RouteBuilder:
    """Return the route by composite bodies whose momenta stop `depth` links above the first one."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        meet = project_at_depth(workspace.robot, depth)
        matrix = compute_mass_matrix(workspace.recursion, workspace.parameters, meet=meet)
        return (flatten_matrix(workspace, matrix),)

    return build


def _solve_ldlt(
    workspace: RouteWorkspace, matrix: Sequence[Sequence[int]], right: Sequence[int]
) -> list[int]:
    """Return x of M x = r by an LDL' factorisation written out.

    Each pivot is inverted once: n more products, but a quotient takes as long as ten of them.
    """
    table, n = workspace.table, len(right)
    one = table.constant(1.0)

    def remove(start: int, products: Sequence[tuple[int, int]]) -> int:
        for left, factor in products:
            start = table.add(start, -table.mul(left, factor))
        return start

    lower = [[0] * n for _ in range(n)]
    scaled = [[0] * n for _ in range(n)]
    inverses: list[int] = []
    for i in range(n):
        for j in range(i):
            scaled[i][j] = remove(matrix[i][j], [(lower[j][k], scaled[i][k]) for k in range(j)])
            lower[i][j] = table.mul(scaled[i][j], inverses[j])
        pivot = remove(matrix[i][i], [(lower[i][k], scaled[i][k]) for k in range(i)])
        inverses.append(table.div(one, pivot))
    solution: list[int] = []
    for i in range(n):
        solution.append(remove(right[i], [(lower[i][k], solution[k]) for k in range(i)]))
    for i in reversed(range(n)):
        solution[i] = table.mul(solution[i], inverses[i])
        solution[i] = remove(solution[i], [(lower[k][i], solution[k]) for k in range(i + 1, n)])
    return solution


def build_forward_dynamics_route(mass: RouteBuilder, torques: RouteBuilder) -> RouteBuilder:
    """Return the route that solves M ddq = tau - c for a matrix and a bias torque from two other routes."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table, n = workspace.table, workspace.robot.freedom
        (entries,), (bias,) = workspace.recall(mass), workspace.recall(torques)
        rest = [table.add(tau, -c) for tau, c in zip(workspace.inputs["tau"], bias, strict=True)]
        matrix = [entries[n * row : n * (row + 1)] for row in range(n)]
        return (tuple(_solve_ldlt(workspace, matrix, rest)),)

    return build


def build_torque_derivatives_route(torques: RouteBuilder) -> RouteBuilder:
    """Return the route to dtau/dq and dtau/ddq that differentiates the torques of another route."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table = workspace.table
        (values,) = workspace.recall(torques)
        one = table.constant(1.0)
        blocks = []
        for name in ("q", "dq"):
            directions = [{ref: one} for ref in workspace.inputs[name]]
            columns = differentiate_along(table, values, directions)
            blocks.append(flatten_coordinate_columns(workspace, columns))
        return tuple(blocks)

    return build


def build_derivatives_route(mass: RouteBuilder, blocks: RouteBuilder) -> RouteBuilder:
    """Return the route that joins dtau/dq and dtau/ddq of one route and the mass matrix of another."""
    return lambda workspace: (*workspace.recall(blocks), *workspace.recall(mass))


def _list_spring_terms(workspace: RouteWorkspace) -> list[SpringTerms[int]]:
    """Return the springs of all coordinates."""
    found: list[Elasticity] = [joint.elasticity for joint in workspace.robot.axes if joint.elasticity]
    return build_spring_terms(found, workspace.inputs["h"])


def _split_plays(springs: Sequence[SpringTerms[int]], plays: Sequence[int]) -> list[Sequence[int]]:
    """Return the plays of each coordinate."""
    starts = [0]
    for spring in springs:
        starts.append(starts[-1] + len(spring.stops))
    return [plays[start:end] for start, end in itertools.pairwise(starts)]


def _append_plays(*ports: Sequence[int], plays: Sequence[Sequence[int]]) -> tuple[Elements, ...]:
    """Return values per coordinate and, where there are stops, the plays after the step."""
    after = tuple(itertools.chain(*plays))
    vectors = tuple(map(tuple, ports))
    return (*vectors, after) if after else vectors


def emit_hysteresis_step(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torques after a step of the torsions, and the plays."""
    springs = _list_spring_terms(workspace)
    memories = _split_plays(springs, workspace.inputs.get("P", ()))
    parts = zip(springs, workspace.inputs["phi"], memories, strict=True)
    steps = [advance_spring(workspace.algebra, spring, phi, memory) for spring, phi, memory in parts]
    return _append_plays([torque for torque, _ in steps], plays=[after for _, after in steps])


def emit_hysteresis_inverse_step(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Return the torsions after a step of the torques, and the plays of the inverse."""
    springs, algebra = _list_spring_terms(workspace), workspace.algebra
    memories = _split_plays(springs, workspace.inputs.get("Q", ()))
    parts = zip(springs, workspace.inputs["tau_J"], memories, strict=True)
    steps = [
        advance_inverse_spring(algebra, invert_spring(algebra, spring), torque, memory)
        for spring, torque, memory in parts
    ]
    return _append_plays([torsion for torsion, _ in steps], plays=[after for _, after in steps])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Torsion:
    """A torsion with its rates, and the plays of the inverse after the step."""

    value: int
    rate: int
    second: int
    plays: tuple[int, ...]


def _invert_torque(
    algebra: ValueAlgebra, spring: SpringTerms[int], torques: tuple[int, int, int], memory: Sequence[int]
) -> _Torsion:
    """Return the torsion of a spring whose torque and its two rates are known."""
    table, zero = algebra.table, algebra.zero
    torque, rate, second = torques
    inverse = invert_spring(algebra, spring)
    plays, above, below = inverse
    value, after = advance_inverse_spring(algebra, inverse, torque, memory)
    before, outer = compute_outer_function(algebra, torque, above, below), algebra.one
    beyond = [(slope, table.apply(Op.LESS, threshold, torque)) for threshold, slope in above]
    beyond += [(slope, table.apply(Op.LESS, torque, threshold)) for threshold, slope in below]
    for slope, active in beyond:
        outer = algebra.add(outer, algebra.mul(slope, active))
    total = plays.weights[0]
    rising, falling = table.apply(Op.LESS, zero, rate), table.apply(Op.LESS, rate, zero)
    for weight, threshold, play in zip(plays.weights[1:], plays.thresholds, memory, strict=True):
        # A play at its edge moves with the torque only while that goes on beyond the edge.
        up = table.apply(Op.LESS_EQUAL, play, algebra.sub(before, threshold))
        down = table.apply(Op.LESS_EQUAL, algebra.add(before, threshold), play)
        moves = algebra.add(algebra.mul(up, rising), algebra.mul(down, falling))
        total = algebra.add(total, algebra.mul(weight, moves))
    compliance = algebra.mul(total, outer)
    return _Torsion(
        value=value, rate=algebra.mul(compliance, rate), second=algebra.mul(compliance, second), plays=after
    )


def _derive_torque_rates(workspace: RouteWorkspace, torques: RouteBuilder) -> list[tuple[int, int, int]]:
    """Return the joint torques and their first two derivatives by time."""
    inputs, table = workspace.inputs, workspace.table
    names = ("q", "dq", "ddq", "dddq", "ddddq")
    seeds: dict[int, int] = {}
    for name, rate in itertools.pairwise(names):
        seeds |= dict(zip(inputs[name], inputs[rate], strict=True))
    (values,) = workspace.recall(torques)
    rates = differentiate_forward(table, values, seeds)
    return list(zip(values, rates, differentiate_forward(table, rates, seeds), strict=True))


def build_feed_forward_route(torques: RouteBuilder) -> RouteBuilder:
    """Return the route to the torques of the motors that takes those of the links from another route."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        algebra, inputs = workspace.algebra, workspace.inputs
        springs = _list_spring_terms(workspace)
        rates = _derive_torque_rates(workspace, torques)
        parts = zip(springs, rates, _split_plays(springs, inputs.get("Q", ())), strict=True)
        torsions = [_invert_torque(algebra, spring, torque, memory) for spring, torque, memory in parts]
        theta = [algebra.add(q, torsion.value) for q, torsion in zip(inputs["q"], torsions, strict=True)]
        dtheta = [algebra.add(dq, torsion.rate) for dq, torsion in zip(inputs["dq"], torsions, strict=True)]
        moved = replace(workspace, inputs={**inputs, "dq": tuple(dtheta)}, built={})
        (friction,) = emit_friction(moved)
        motors = []
        for k, torsion in enumerate(torsions):
            acceleration = algebra.add(inputs["ddq"][k], torsion.second)
            inertial = algebra.mul(inputs["IA"][k], acceleration)
            motors.append(algebra.add(algebra.add(inertial, friction[k]), rates[k][0]))
        return _append_plays(motors, theta, dtheta, plays=[torsion.plays for torsion in torsions])

    return build
