"""Routes to the mass matrix, forward dynamics and the derivatives of inverse dynamics.

Input: a workspace, and a route to the mass matrix or to torques where one builds on another.
Output: elements of the output ports.

Supported: everything the recursion supports.
"""

from collections.abc import Sequence

from symid.codegen.differentiation import find_rates_along
from symid.codegen.meetings import meet_at_depth
from symid.codegen.outputs import lay_coordinates, lay_matrix, line_up
from symid.codegen.workspace import Build, Elements, Workspace
from symid.dynamics.composite import find_mass_matrix

__all__ = [
    "build_derivatives",
    "build_forward_dynamics",
    "build_mass_matrix",
    "build_mass_matrix_at",
    "differentiate_torques",
]


def build_mass_matrix(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the mass matrix from composite bodies, their momenta carried down to every joint."""
    return (lay_matrix(workspace, find_mass_matrix(workspace.recursion, workspace.parameters)),)


def build_mass_matrix_at(depth: int) -> Build:
    """Return the route by composite bodies whose momenta stop `depth` links above the first one."""

    def build(workspace: Workspace) -> tuple[Elements, ...]:
        meet = meet_at_depth(workspace.robot, depth)
        matrix = find_mass_matrix(workspace.recursion, workspace.parameters, meet=meet)
        return (lay_matrix(workspace, matrix),)

    return build


def _solve(workspace: Workspace, matrix: Sequence[Sequence[int]], right: Sequence[int]) -> list[int]:
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


def build_forward_dynamics(mass: Build, torques: Build) -> Build:
    """Return the route that solves M ddq = tau - c for a matrix and a bias torque from two other routes."""

    def build(workspace: Workspace) -> tuple[Elements, ...]:
        table, n = workspace.table, workspace.robot.freedom
        (entries,), (bias,) = workspace.recall(mass), workspace.recall(torques)
        rest = [table.add(tau, -c) for tau, c in zip(workspace.inputs["tau"], bias, strict=True)]
        matrix = [entries[n * row : n * (row + 1)] for row in range(n)]
        return (lay_coordinates(workspace, _solve(workspace, matrix, rest)),)

    return build


def differentiate_torques(torques: Build) -> Build:
    """Return the route to dtau/dq and dtau/ddq that differentiates the torques of another route."""

    def build(workspace: Workspace) -> tuple[Elements, ...]:
        table = workspace.table
        (values,) = workspace.recall(torques)
        one = table.constant(1.0)
        blocks = []
        for name in ("q", "dq"):
            directions = [{ref: one} for ref in workspace.inputs[name]]
            columns = find_rates_along(table, values, directions)
            blocks.append(line_up(workspace, columns))
        return tuple(blocks)

    return build


def build_derivatives(mass: Build, blocks: Build) -> Build:
    """Return the route that joins dtau/dq and dtau/ddq of one route and the mass matrix of another."""
    return lambda workspace: (*workspace.recall(blocks), *workspace.recall(mass))
