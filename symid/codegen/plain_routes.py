"""Functions to which there is one route: poses, Jacobian, friction.

Input: a workspace. Output: elements of the output ports.

Supported: everything the recursion and the friction models support.
"""

from symid.codegen.outputs import lay_vector
from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.kinematics import find_jacobian, find_poses
from symid.joint.friction import FRICTION_MODELS

__all__ = ["build_forward_kinematics", "build_friction", "build_friction_matrix", "build_jacobian"]


def build_forward_kinematics(workspace: Workspace) -> tuple[Elements, ...]:
    """Return rotations and origins of all links."""
    poses = find_poses(workspace.recursion)
    rotations = tuple(entry for pose in poses for row in pose.rotation for entry in row)
    return rotations, tuple(entry for pose in poses for entry in pose.origin)


def build_jacobian(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the Jacobian of the last link."""
    rows = find_jacobian(workspace.recursion)
    return (tuple(entry for row in rows for entry in lay_vector(workspace, row)),)


def _find_columns(workspace: Workspace) -> list[list[int]]:
    """Return the friction regressor by columns: those of the representatives, each in its joint's row."""
    algebra = workspace.algebra
    columns = []
    for parameter in workspace.base.friction:
        joint, name = parameter.label
        model = FRICTION_MODELS[workspace.robot.joints[joint].friction.kind]
        entries = model.columns(algebra, workspace.inputs["dq"][joint])
        column = list(workspace.zeros)
        column[joint] = entries[model.parameters.index(name)]
        columns.append(column)
    return columns


def build_friction_matrix(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the friction regressor."""
    laid = [lay_vector(workspace, column) for column in _find_columns(workspace)]
    return (tuple(column[joint] for joint in range(workspace.robot.size) for column in laid),)


def build_friction(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the friction torques."""
    algebra = workspace.algebra
    torques = list(workspace.zeros)
    for parameter, column in zip(workspace.inputs["f"], _find_columns(workspace), strict=True):
        entries = zip(torques, column, strict=True)
        torques = [algebra.add(torque, algebra.mul(entry, parameter)) for torque, entry in entries]
    return (lay_vector(workspace, torques),)
