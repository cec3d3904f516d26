"""The model card of a robot: names, units, groupings, reasons and, where known, values.

Robot, BaseParameters, specs -> ModelCard.

Supported: everything the base parameters support; values only where the robot file states all members.
"""

from symid.codegen.functions import FunctionSpec, JointCard, ModelCard, ParameterCard, find_model_signature
from symid.dynamics.labels import find_label_unit, find_owner
from symid.parameters.base import BaseParameter, BaseParameters
from symid.parameters.values import find_parameter_values
from symid.robot.description import Robot

__all__ = ["build_model_card"]


def _write_card(robot: Robot, parameter: BaseParameter, value: float | None) -> ParameterCard:
    return ParameterCard(
        name=parameter.name,
        expression=parameter.expression,
        unit=find_label_unit(robot, parameter.label),
        reason=parameter.reason,
        joint=find_owner(robot, parameter.label),
        value=value,
    )


def build_model_card(robot: Robot, base: BaseParameters, specs: tuple[FunctionSpec, ...]) -> ModelCard:
    """Return what users of the functions must know of the model."""
    values = find_parameter_values(robot, base)
    joints = tuple(
        JointCard(name=joint.name, kind=joint.kind.value, friction=joint.friction.kind.value)
        for joint in robot.axes
    )
    return ModelCard(
        robot=robot.name,
        signature=find_model_signature(
            robot,
            [(parameter.name, parameter.expression) for parameter in (*base.parameters, *base.friction)],
        ),
        joints=joints,
        beta=tuple(
            _write_card(robot, parameter, values.get(parameter.name)) for parameter in base.parameters
        ),
        friction=tuple(
            _write_card(robot, parameter, values.get(parameter.name)) for parameter in base.friction
        ),
        functions=specs,
        vector=base.vector,
    )
