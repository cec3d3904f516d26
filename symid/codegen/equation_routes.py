"""Routes to forward dynamics, to the Coriolis matrix, and to derivatives of the equations of motion.

A route is a builder: workspace -> elements of all output ports, see `routes`. M ddq = tau - c takes
operations that grow with the third power of the joints, by articulated bodies with their number. With
M = dtau/dddq, and the other derivatives of tau(q, dq, ddq) at the acceleration that the torque gives,

    dddq/dtau = M^-1,   dddq/dq = -M^-1 dtau/dq,   dddq/ddq = -M^-1 dtau/ddq.

The derivative by velocities is twice the Coriolis matrix C, so that the bias torque costs no recursion of its
own: C dq + rest. M^-1 = L^-1 D^-1 L^-T shares the factors of M = L' D L with the acceleration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

from symid.codegen.programs import ExpressionTable, differentiate_along
from symid.codegen.workspace import Elements, RouteBuilder, RouteWorkspace
from symid.dynamics import (
    ProjectionFrame,
    compute_coriolis_matrix,
    compute_equation_terms,
    compute_forward_dynamics,
    compute_mass_derivatives,
    compute_torque_derivatives,
    fold_matrix,
    fold_vector,
)
from symid.robot import Robot

Matrix = Sequence[Sequence[int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Factors:
    """M = L' D L of a table's values: the rows of L below its diagonal of ones, and 1/D.

    Joints are eliminated from the last one to the first: what is zero in M, for joints of which neither
    carries the other, stays zero in L (Featherstone, Int. J. Robot. Res. 24 (2005) 487-500). Each pivot is
    inverted once: n more products, but a quotient takes as long as ten of them.
    """

    table: ExpressionTable
    lower: Matrix
    inverses: Sequence[int]

    def solve(self, right: Sequence[int]) -> list[int]:
        """Return x of M x = r."""
        lower, solution, joints = self.lower, list(right), range(len(right))
        for i in reversed(joints):
            carried = [(lower[k][i], solution[k]) for k in joints[i + 1 :]]
            solution[i] = _remove(self.table, solution[i], carried)
        for i in joints:
            scaled = self.table.mul(solution[i], self.inverses[i])
            solution[i] = _remove(self.table, scaled, [(lower[i][k], solution[k]) for k in range(i)])
        return solution

    def invert(self) -> list[list[int]]:
        """Return M^-1 = X D^-1 X', X the inverse of L: both triangles are the same values."""
        table, n, one = self.table, len(self.inverses), self.table.constant(1.0)
        unit: list[list[int]] = [[] for _ in range(n)]
        for i in range(n):
            for j in range(i):
                products = [(self.lower[i][k], unit[k][j]) for k in range(j + 1, i)]
                unit[i].append(_remove(table, -self.lower[i][j], products))
            unit[i].append(one)
        result = [[0] * n for _ in range(n)]
        for i in range(n):
            scaled = [table.mul(x, factor) for x, factor in zip(unit[i], self.inverses, strict=False)]
            for j in range(i + 1):
                products = [(-unit[j][k], scaled[k]) for k in range(j)]
                result[i][j] = result[j][i] = _remove(table, scaled[j], products)
        return result


def _remove(table: ExpressionTable, start: int, products: Sequence[tuple[int, int]]) -> int:
    """Return `start` less the products."""
    for left, right in products:
        start = table.add(start, -table.mul(left, right))
    return start


def _factorise(table: ExpressionTable, matrix: Matrix) -> _Factors:
    """Return the factors of a matrix that is symmetric and positive definite, written out."""
    n, one = len(matrix), table.constant(1.0)
    lower = [[0] * n for _ in range(n)]
    scaled = [[0] * n for _ in range(n)]
    inverses = [0] * n
    for i in reversed(range(n)):
        behind = range(i + 1, n)
        pivot = _remove(table, matrix[i][i], [(lower[k][i], scaled[k][i]) for k in behind])
        inverses[i] = table.div(one, pivot)
        for j in range(i):
            scaled[i][j] = _remove(table, matrix[i][j], [(lower[k][i], scaled[k][j]) for k in behind])
            lower[i][j] = table.mul(scaled[i][j], inverses[i])
    return _Factors(table=table, lower=lower, inverses=inverses)


def build_forward_dynamics_route(mass: RouteBuilder, torques: RouteBuilder) -> RouteBuilder:
    """Return the route that solves M ddq = tau - c for a matrix and a bias torque from two other routes."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table, n = workspace.table, workspace.robot.freedom
        (entries,), (bias,) = workspace.recall(mass), workspace.recall(torques)
        rest = [table.add(tau, -c) for tau, c in zip(workspace.inputs["tau"], bias, strict=True)]
        factors = _factorise(table, [entries[n * row : n * (row + 1)] for row in range(n)])
        return (tuple(factors.solve(rest)),)

    return build


def build_articulated_route(workspace: RouteWorkspace) -> tuple[Elements, ...]:
    """Build the accelerations by articulated bodies: without a matrix, the route of robots of many joints."""
    table, tau = workspace.table, workspace.spread(workspace.inputs["tau"])
    one = table.constant(1.0)
    return (
        compute_forward_dynamics(
            workspace.recursion, workspace.parameters, tau, lambda value: table.div(one, value)
        ),
    )


def build_differentiated_route(torques: RouteBuilder, mass: RouteBuilder) -> RouteBuilder:
    """Return the route that differentiates the torques of one route and takes the matrix of another."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table = workspace.table
        (values,) = workspace.recall(torques)
        one = table.constant(1.0)
        blocks = []
        for name in ("q", "dq"):
            directions = [{ref: one} for ref in workspace.inputs[name]]
            columns = differentiate_along(table, values, directions)
            blocks.append(workspace.flatten_columns(columns))
        return (*blocks, *workspace.recall(mass))

    return build


def _flatten(workspace: RouteWorkspace, matrix: Matrix) -> Elements:
    """Return a matrix of the joints as that of the coordinates, row by row."""
    return tuple(chain(*fold_matrix(workspace.robot, workspace.algebra, matrix)))


def build_derivatives_route(place: Callable[[Robot], ProjectionFrame] | None) -> RouteBuilder:
    """Return the route to dtau/dq, dtau/ddq and M by composite bodies, whose wrenches stop at `place`."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        meet = place(workspace.robot) if place else None
        found = compute_torque_derivatives(workspace.recursion, workspace.parameters, meet=meet)
        blocks = (found.by_position, found.by_velocity, found.by_acceleration)
        return tuple(_flatten(workspace, block) for block in blocks)

    return build


def build_mass_derivatives_route(place: Callable[[Robot], ProjectionFrame] | None) -> RouteBuilder:
    """Return the route to dM/dq by composite bodies, whose wrenches stop at `place`."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        robot, algebra = workspace.robot, workspace.algebra
        meet = place(robot) if place else None
        slopes = compute_mass_derivatives(workspace.recursion, workspace.parameters, meet=meet)
        matrices = [_flatten(workspace, matrix) for matrix in slopes]
        return (tuple(chain(*(fold_vector(robot, algebra, part) for part in zip(*matrices, strict=True)))),)

    return build


def build_second_derivatives_route(place: Callable[[Robot], ProjectionFrame] | None) -> RouteBuilder:
    """Return the route to the second derivatives of tau, and dM/dq, that differentiates the first ones.

    By two velocities they are sums of c_ijk, of dM/dq. Of d^2 tau/dq^2 half is computed.
    """
    first, third = build_derivatives_route(place), build_mass_derivatives_route(place)

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table, n = workspace.table, workspace.robot.freedom
        by_q, by_dq, _ = workspace.recall(first)
        (mass,) = workspace.recall(third)
        directions = [{ref: table.constant(1.0)} for ref in workspace.inputs["q"]]
        twice = differentiate_along(table, by_q, directions)
        mixed = differentiate_along(table, by_dq, directions)
        indices = list(product(range(n), repeat=3))

        def read(i: int, j: int, k: int) -> int:
            return mass[n * (n * i + j) + k]

        def add_symbols(i: int, j: int, k: int) -> int:
            return table.add(table.add(read(i, j, k), read(i, k, j)), -read(j, k, i))

        return (
            tuple(twice[max(j, k)][n * i + min(j, k)] for i, j, k in indices),
            tuple(mixed[j][n * i + k] for i, j, k in indices),
            tuple(add_symbols(i, max(j, k), min(j, k)) for i, j, k in indices),
            mass,
        )

    return build


def build_differentiated_mass_route(mass: RouteBuilder) -> RouteBuilder:
    """Return the route that differentiates the mass matrix of another route."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table = workspace.table
        (values,) = workspace.recall(mass)
        directions = [{ref: table.constant(1.0)} for ref in workspace.inputs["q"]]
        return (workspace.flatten_columns(differentiate_along(table, values, directions)),)

    return build


def build_regressor_derivatives_route(regressor: RouteBuilder) -> RouteBuilder:
    """Return the route that differentiates the torque regressor of another route by q, dq and ddq."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        table = workspace.table
        (values,) = workspace.recall(regressor)
        one = table.constant(1.0)
        blocks = (
            differentiate_along(table, values, [{ref: one} for ref in workspace.inputs[name]])
            for name in ("q", "dq", "ddq")
        )
        return tuple(map(workspace.flatten_columns, blocks))

    return build


def build_coriolis_route(place: Callable[[Robot], ProjectionFrame] | None) -> RouteBuilder:
    """Return the route to the Coriolis matrix by composite bodies, whose wrenches stop at `place`."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        meet = place(workspace.robot) if place else None
        matrix = compute_coriolis_matrix(workspace.recursion, workspace.parameters, meet=meet)
        return (_flatten(workspace, matrix),)

    return build


def build_forward_derivatives_route(place: Callable[[Robot], ProjectionFrame] | None) -> RouteBuilder:
    """Return the route to ddq and its derivatives by q, dq and tau (see above)."""

    def build(workspace: RouteWorkspace) -> tuple[Elements, ...]:
        robot, table, algebra, inputs = workspace.robot, workspace.table, workspace.algebra, workspace.inputs
        meet = place(robot) if place else None
        terms = compute_equation_terms(workspace.recursion, workspace.parameters, meet=meet)
        mass, coriolis = (fold_matrix(robot, algebra, part) for part in (terms.mass, terms.twice_coriolis))
        factors, halves = _factorise(table, mass), list(map(algebra.half, inputs["dq"]))
        rest = zip(inputs["tau"], fold_vector(robot, algebra, terms.rest), coriolis, strict=True)
        forces = [
            _remove(table, table.add(tau, -load), list(zip(row, halves, strict=True)))
            for tau, load, row in rest
        ]
        ddq = factors.solve(forces)
        state = replace(workspace.recursion.state, acceleration=workspace.spread(ddq))
        moving = replace(workspace.recursion, state=state)
        slopes = fold_matrix(
            robot,
            algebra,
            compute_torque_derivatives(moving, workspace.parameters, meet=meet).by_position,
        )
        inverse = factors.invert()
        products = [
            [
                [_remove(table, table.constant(0.0), list(zip(row, column, strict=True))) for row in inverse]
                for column in zip(*block, strict=True)
            ]
            for block in (slopes, coriolis)
        ]
        blocks = (workspace.flatten_columns(columns) for columns in products)
        return (tuple(ddq), *blocks, tuple(chain(*inverse)))

    return build
