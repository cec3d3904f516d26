"""Functions to which there is one route: poses, Jacobian, friction.

Input: a workspace. Output: elements of the output ports.

Supported: everything the recursion and the friction models support.
"""

from symid.algebra.scalar import spread_coordinates
from symid.codegen.outputs import lay_coordinates, lay_vector, line_up
from symid.codegen.workspace import Elements, Workspace
from symid.dynamics.kinematics import find_jacobian, find_link_poses
from symid.joint.friction import FRICTION_MODELS, find_friction, find_friction_columns
from symid.robot.geometry import Exact

__all__ = ["build_forward_kinematics", "build_friction", "build_friction_matrix", "build_jacobian"]


def build_forward_kinematics(workspace: Workspace) -> tuple[Elements, ...]:
    """Return rotations and origins of all links."""
    poses = find_link_poses(workspace.recursion)
    rotations = tuple(entry for pose in poses for row in pose.rotation for entry in row)
    return rotations, tuple(entry for pose in poses for entry in pose.origin)


def build_jacobian(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the Jacobian of the last link."""
    rows = find_jacobian(workspace.recursion)
    return (tuple(entry for row in rows for entry in lay_vector(workspace, row)),)


def _find_columns(workspace: Workspace) -> list[list[int]]:
    """Return the friction regressor by columns, each felt where its drive turns."""
    robot = workspace.robot
    algebra = workspace.algebra
    speeds = spread_coordinates(robot, algebra, workspace.inputs["dq"])
    columns = []
    for parameter in workspace.base.friction:
        index, name = parameter.label
        friction = find_friction(robot, index)
        columns_of_model = find_friction_columns(friction, algebra, speeds[index])
        entry = columns_of_model[FRICTION_MODELS[friction.kind].parameters.index(name)]
        column = [algebra.zero] * robot.freedom
        for position, factor in robot.transmission[index]:
            column[position] = algebra.mul(algebra.constant(Exact.of(factor)), entry)
        columns.append(column)
    return columns


def build_friction_matrix(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the friction regressor."""
    return (line_up(workspace, _find_columns(workspace)),)


def build_friction(workspace: Workspace) -> tuple[Elements, ...]:
    """Return the friction torques."""
    algebra = workspace.recursion.algebra
    torques = [algebra.zero] * workspace.robot.freedom
    for parameter, column in zip(workspace.inputs["f"], _find_columns(workspace), strict=True):
        entries = zip(torques, column, strict=True)
        torques = [algebra.add(torque, algebra.mul(entry, parameter)) for torque, entry in entries]
    return (lay_coordinates(workspace, torques),)
