"""The model card of a robot: names, units, groupings, reasons and, where known, values.

Robot, BaseParameters, specs -> ModelCard.

Supported: everything the base parameters support; values only where the robot file states all members.
"""

from collections.abc import Iterator
from fractions import Fraction

from symid.codegen.functions import (
    FollowerCard,
    FunctionSpec,
    JointCard,
    ModelCard,
    ParameterCard,
    find_model_signature,
)
from symid.codegen.springs import list_spring_parameters
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


def _write_fraction(value: Fraction) -> str:
    """Return a number as a decimal where a short one is exact, else as a quotient."""
    text = f"{float(value):g}"
    return text if Fraction(text) == value else str(value)


def _write_joints(robot: Robot) -> Iterator[JointCard]:
    for number, joint in enumerate(robot.joints, start=1):
        if joint.mimic is None:
            yield JointCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                friction=joint.friction.kind.value,
                smoothing=joint.friction.smoothing,
            )


def _write_rotors(robot: Robot) -> Iterator[ParameterCard]:
    for index, joint in enumerate(robot.joints):
        if joint.elasticity is not None and joint.drive.has_rotor:
            yield ParameterCard(
                name=f"IA{index + 1}",
                expression=f"IA{index + 1}",
                unit=find_label_unit(robot, (index, "IA")),
                reason="the rotor turns with the motor, apart from the link",
                joint=joint.name,
                value=joint.drive.rotor_inertia,
            )


def _write_followers(robot: Robot) -> Iterator[FollowerCard]:
    for number, joint in enumerate(robot.joints, start=1):
        if joint.mimic is not None:
            yield FollowerCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                master=robot.joints[joint.mimic.master].name,
                multiplier=_write_fraction(joint.mimic.multiplier),
            )


def build_model_card(robot: Robot, base: BaseParameters, specs: tuple[FunctionSpec, ...]) -> ModelCard:
    """Return what users of the functions must know of the model."""
    values = find_parameter_values(robot, base)
    return ModelCard(
        robot=robot.name,
        signature=find_model_signature(
            robot,
            [(parameter.name, parameter.expression) for parameter in (*base.parameters, *base.friction)],
        ),
        joints=tuple(_write_joints(robot)),
        beta=tuple(
            _write_card(robot, parameter, values.get(parameter.name)) for parameter in base.parameters
        ),
        friction=tuple(
            _write_card(robot, parameter, values.get(parameter.name)) for parameter in base.friction
        ),
        functions=specs,
        vector=base.vector,
        followers=tuple(_write_followers(robot)),
        rotors=tuple(_write_rotors(robot)),
        elasticity=tuple(joint.elasticity for joint in robot.axes) if any(robot.elastic) else (),
        springs=tuple(list_spring_parameters(robot)) if all(robot.elastic) else (),
    )
