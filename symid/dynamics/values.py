"""Values of base parameters from the values that the robot file states.

Input: a robot with inertial values, rotor inertias, friction values; its base parameters.
Output: {name: value} for every base parameter all of whose members are known.
"""

from symid.dynamics.base import BaseParameters, Label
from symid.joint.friction import FRICTION_MODELS
from symid.notation import INERTIAL
from symid.robot.description import Robot

__all__ = ["find_parameter_values"]


def _known_values(robot: Robot) -> dict[Label, float]:
    known: dict[Label, float] = {}
    for index, joint in enumerate(robot.joints):
        if joint.inertial is not None:
            known |= {(index, name): value for name, value in zip(INERTIAL, joint.inertial, strict=True)}
        if joint.drive.rotor_inertia is not None:
            known[index, "IA"] = joint.drive.rotor_inertia
        if joint.friction.values is not None:
            names = FRICTION_MODELS[joint.friction.kind].parameters
            known |= {(index, name): value for name, value in zip(names, joint.friction.values, strict=True)}
    return known


def find_parameter_values(robot: Robot, base: BaseParameters) -> dict[str, float]:
    """Return beta = K pi for every base parameter whose members are all known, in SI units."""
    known = _known_values(robot)
    lengths = dict(robot.symbols)
    result: dict[str, float] = {}
    for parameter in (*base.parameters, *base.friction):
        if all(label in known for label, _ in parameter.terms):
            result[parameter.name] = sum(
                float(coefficient.subs(lengths)) * known[label] for label, coefficient in parameter.terms
            )
    return result
