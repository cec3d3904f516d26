"""How per-joint results become the elements of output ports, row by row.

Input: what the dynamics gives a value per joint, per pair of joints, or per joint and parameter.
Output: `Elements`, the references of one port in row-major order.

Every dynamics function passes here, so that what joints share is put together in one place.
"""

from collections.abc import Mapping, Sequence

from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.base import Label

__all__ = ["lay_columns", "lay_matrix", "lay_vector"]


def lay_vector(workspace: Workspace, values: Sequence[int]) -> Elements:
    """Return a value per joint as a port of shape (n,)."""
    if len(values) != workspace.robot.size:
        message = f"expected one value per joint, {workspace.robot.size}, got {len(values)}"
        raise ValueError(message)
    return tuple(values)


def lay_matrix(workspace: Workspace, rows: Sequence[Sequence[int]]) -> Elements:
    """Return a matrix of joints by joints as a port of shape (n, n)."""
    return tuple(entry for row in rows for entry in lay_vector(workspace, row))


def lay_columns(workspace: Workspace, columns: Mapping[Label, Sequence[int]]) -> Elements:
    """Return a column of joints per base parameter as a port of shape (n, b)."""
    laid = [lay_vector(workspace, columns[key]) for key in workspace.base.keys]
    return tuple(column[joint] for joint in range(workspace.robot.size) for column in laid)
