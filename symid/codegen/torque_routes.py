"""Routes to joint torques and to the Coriolis matrix.

Input: a workspace; velocity, acceleration or both may be zero. Output: elements of the output ports.

Supported: everything the recursion supports.
"""

from dataclasses import replace

from symid.codegen.meetings import meet_in_link
from symid.codegen.outputs import lay_vector, line_up
from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.newton_euler import find_inverse_dynamics
from symid.dynamics.regressors import find_torque_columns
from symid.dynamics.tensor_forms import find_tensor_torques
from symid.robot.geometry import ZERO

__all__ = [
    "build_coriolis_matrix",
    "build_torques_by_regressor",
    "build_torques_by_tensors",
    "build_torques_by_vectors",
]


def build_torques_by_tensors(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torques by recursion with acceleration tensors."""
    return (lay_vector(workspace, find_tensor_torques(workspace.recursion, workspace.parameters)),)


def build_torques_by_vectors(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torques by recursion with vectors."""
    return (lay_vector(workspace, find_inverse_dynamics(workspace.recursion, workspace.parameters)),)


def build_torques_by_regressor(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the torque regressor times the base parameters."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    columns = find_torque_columns(recursion, workspace.base.keys, meet=meet_in_link(workspace.robot))
    torques = list(workspace.zeros)
    for key, parameter in workspace.parameters.items():
        entries = zip(torques, columns[key], strict=True)
        torques = [algebra.add(torque, algebra.mul(entry, parameter)) for torque, entry in entries]
    return (lay_vector(workspace, torques),)


def build_coriolis_matrix(workspace: Workspace) -> tuple[Elements, ...]:
    """Return C column by column: the torques for dqr = e_k, ddqr = 0, without gravity and springs."""
    recursion, algebra = workspace.recursion, workspace.recursion.algebra
    weightless = replace(recursion, robot=replace(workspace.robot, gravity=(ZERO, ZERO, ZERO)))
    parameters = {key: value for key, value in workspace.parameters.items() if key[1] not in ("KS", "KR")}
    coordinates = range(workspace.robot.freedom)
    columns = []
    for k in coordinates:
        unit = workspace.spread([algebra.one if j == k else algebra.zero for j in coordinates])
        torques = find_tensor_torques(weightless, parameters, (unit, workspace.zeros))
        columns.append(lay_vector(workspace, torques))
    return (line_up(workspace, columns),)
