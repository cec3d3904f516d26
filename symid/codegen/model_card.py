"""The model card of a robot: names, units, groupings, reasons and known values; values baked into code.

Robot, BaseParameters, specs -> `ModelCard`.
ModelCard -> values of its parameters, functions without them.

Supported: everything the base parameters support; values only where the robot file states all members.
Base or standard parameters, rotor inertias of elastic joints and friction may be baked in.
Not supported: springs as constants; functions of hysteresis take h, so that a spring may be changed.
"""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

from symid.codegen.catalogue import list_spring_parameters
from symid.codegen.functions import (
    FollowerCard,
    FunctionSpec,
    JointCard,
    ModelCard,
    ParameterCard,
    compute_model_signature,
)
from symid.dynamics import BaseParameter, BaseParameters, compute_parameter_values, get_label_unit, get_owner
from symid.errors import Notice, UsageError
from symid.robot import Robot


def _build_parameter_card(robot: Robot, parameter: BaseParameter, value: float | None) -> ParameterCard:
    return ParameterCard(
        name=parameter.name,
        expression=parameter.expression,
        unit=get_label_unit(robot, parameter.label),
        reason=parameter.reason,
        joint=get_owner(robot, parameter.label),
        value=value,
    )


def _write_fraction(value: Fraction) -> str:
    """Return a number as a decimal where a short one is exact, else as a quotient."""
    text = f"{float(value):g}"
    return text if Fraction(text) == value else str(value)


def build_model_card(robot: Robot, base: BaseParameters, specs: tuple[FunctionSpec, ...]) -> ModelCard:
    """Return what users of the functions must know of the model."""
    values = compute_parameter_values(robot, base)
    numbered = list(enumerate(robot.joints, start=1))
    return ModelCard(
        robot=robot.name,
        signature=compute_model_signature(
            robot,
            [(parameter.name, parameter.expression) for parameter in (*base.parameters, *base.friction)],
        ),
        joints=tuple(
            JointCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                friction=joint.friction.kind.value,
                smoothing=joint.friction.smoothing,
            )
            for number, joint in numbered
            if joint.mimic is None
        ),
        beta=tuple(
            _build_parameter_card(robot, parameter, values.get(parameter.name))
            for parameter in base.parameters
        ),
        friction=tuple(
            _build_parameter_card(robot, parameter, values.get(parameter.name)) for parameter in base.friction
        ),
        functions=specs,
        vector=base.vector,
        followers=tuple(
            FollowerCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                master=robot.joints[joint.mimic.master].name,
                multiplier=_write_fraction(joint.mimic.multiplier),
            )
            for number, joint in numbered
            if joint.mimic is not None
        ),
        rotors=tuple(
            ParameterCard(
                name=f"IA{number}",
                expression=f"IA{number}",
                unit=get_label_unit(robot, (number - 1, "IA")),
                reason="the rotor turns with the motor, apart from the link",
                joint=joint.name,
                value=joint.drive.rotor_inertia,
            )
            for number, joint in numbered
            if joint.elasticity is not None and joint.drive.has_rotor
        ),
        elasticity=tuple(joint.elasticity for joint in robot.axes) if any(robot.elastic) else (),
        springs=tuple(list_spring_parameters(robot)) if all(robot.elastic) else (),
    )


Constants = Mapping[str, tuple[float, ...]]
"""Values of whole input ports by their name."""


def get_constants(card: ModelCard) -> Constants:
    """Return the values of all parameters that may be baked in.

    Raises:
        UsageError: the robot file does not state all of them.
    """
    vectors: dict[str, tuple[ParameterCard, ...]] = {
        card.vector: card.beta,
        "IA": card.rotors,
        "f": card.friction,
    }
    missing = [entry.name for entries in vectors.values() for entry in entries if entry.value is None]
    if missing:
        text = (
            f"constants: the robot file states no value of {', '.join(missing)}; add the values, or write "
            "what was identified into a robot file with `symid export`"
        )
        raise UsageError(Notice(code="usage.unknown-constants", text=text))
    return {
        name: tuple(entry.value for entry in entries if entry.value is not None)
        for name, entries in vectors.items()
    }


def drop_constants(spec: FunctionSpec, constants: Constants) -> FunctionSpec:
    """Return the function without the inputs that are constants."""
    return replace(spec, inputs=tuple(port for port in spec.inputs if port.name not in constants))
