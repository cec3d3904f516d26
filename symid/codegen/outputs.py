"""How results become the elements of output ports, row by row.

Input: what the dynamics gives per joint, per pair of joints, or per joint and parameter; or what a route has
per coordinate already. Output: `Elements`, the references of one port in row-major order.

Every result passes here, so that the shares of joints that follow another are added at its coordinate.
"""

from collections.abc import Mapping, Sequence

from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.folding import fold_matrix, fold_vector
from symid.parameters.base import Label

__all__ = ["lay_columns", "lay_coordinates", "lay_matrix", "lay_rows", "lay_vector", "line_up"]


def _check_size(values: Sequence[object], size: int) -> None:
    if len(values) != size:
        message = f"expected {size} values, got {len(values)}"
        raise ValueError(message)


def lay_vector(workspace: Workspace, values: Sequence[int]) -> Elements:
    """Return a value per joint as a port of shape (n,)."""
    _check_size(values, workspace.robot.size)
    return fold_vector(workspace.robot, workspace.recursion.algebra, values)


def lay_coordinates(workspace: Workspace, values: Sequence[int]) -> Elements:
    """Return a value per coordinate as a port of shape (n,)."""
    _check_size(values, workspace.robot.freedom)
    return tuple(values)


def lay_matrix(workspace: Workspace, rows: Sequence[Sequence[int]]) -> Elements:
    """Return a matrix of joints by joints as a port of shape (n, n)."""
    _check_size(rows, workspace.robot.size)
    return lay_rows(workspace, fold_matrix(workspace.robot, workspace.recursion.algebra, rows))


def lay_rows(workspace: Workspace, rows: Sequence[Sequence[int]]) -> Elements:
    """Return a matrix of coordinates by coordinates as a port of shape (n, n)."""
    return tuple(entry for row in rows for entry in lay_coordinates(workspace, row))


def lay_columns(workspace: Workspace, columns: Mapping[Label, Sequence[int]]) -> Elements:
    """Return a column of joints per base parameter as a port of shape (n, b)."""
    return line_up(workspace, [lay_vector(workspace, columns[key]) for key in workspace.base.keys])


def line_up(workspace: Workspace, columns: Sequence[Sequence[int]]) -> Elements:
    """Return columns with an entry a coordinate as a port of shape (n, columns)."""
    return tuple(column[k] for k in range(workspace.robot.freedom) for column in columns)
