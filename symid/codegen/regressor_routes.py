"""Routes to the regressors: wrenches per unit of a parameter, projected on joint screws.

Input: a workspace. Output: elements of the output ports.

Supported: everything the recursion supports.
"""

from collections.abc import Callable

from symid.codegen.outputs import lay_columns
from symid.codegen.workspace import Build, Elements, Workspace
from symid.dynamics.regressors import (
    Columns,
    find_lagrange_columns,
    find_momentum_columns,
    find_slotine_li_columns,
    find_torque_columns,
)
from symid.dynamics.wrenches import Meeting
from symid.robot.description import Robot

__all__ = [
    "build_lagrange_columns",
    "build_momentum_columns",
    "build_slotine_li_columns",
    "build_torque_columns",
]

Place = Callable[[Robot], Meeting]


def _build(find: Callable[[Workspace, Meeting | None], Columns[int]], place: Place | None) -> Build:
    def build(workspace: Workspace) -> tuple[Elements, ...]:
        meet = place(workspace.robot) if place else None
        return (lay_columns(workspace, find(workspace, meet)),)

    return build


def build_torque_columns(place: Place | None) -> Build:
    """Return the route to the torque regressor that meets at `place`, or carries all columns down."""
    return _build(lambda w, meet: find_torque_columns(w.recursion, w.base.keys, meet=meet), place)


def build_momentum_columns(place: Place | None) -> Build:
    """Return the route to the momentum regressor that meets at `place`, or carries all columns down."""
    return _build(lambda w, meet: find_momentum_columns(w.recursion, w.base.keys, meet=meet), place)


def build_lagrange_columns(place: Place | None) -> Build:
    """Return the route to the regressor of dL/dq that meets at `place`, or carries all columns down."""
    return _build(lambda w, meet: find_lagrange_columns(w.recursion, w.base.keys, meet=meet), place)


def build_slotine_li_columns(place: Place | None) -> Build:
    """Return the route to the Slotine-Li regressor that meets at `place`, or carries all columns down."""

    def find(workspace: Workspace, meet: Meeting | None) -> Columns[int]:
        inputs = workspace.inputs
        reference = (workspace.spread(inputs["dqr"]), workspace.spread(inputs["ddqr"]))
        return find_slotine_li_columns(workspace.recursion, reference, workspace.base.keys, meet=meet)

    return _build(find, place)
