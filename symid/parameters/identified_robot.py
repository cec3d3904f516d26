"""A robot whose values are those that were identified, in bodies that exist.

Input: a robot, its base parameters, identified values by name. Output: the robot with masses, rotors, springs
and friction that have these values, and the `StandardSet` they come from.

Logs show base parameters only; of all bodies that have them, those nearest to the file's own are taken, or to
a prior where the file has none (`consistency`). What was not identified keeps the file's value.

Supported: links, rotors, springs, couplings and friction; elastic joints, given by their own records.
Not supported: links whose values are symbols keep no symbols; numbers take their place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.joint.friction import FRICTION_MODELS, find_friction
from symid.parameters.base import BaseParameters, Label
from symid.parameters.consistency import StandardSet, find_standard_set
from symid.robot.description import Coupling, FrictionValues, Joint, Robot, Spring
from symid.robot.elasticity import Elasticity
from symid.robot.inertia import find_impossibility

__all__ = ["IdentifiedRobot", "build_identified_robot"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedRobot:
    """A robot with identified values, and the bodies that were found for them."""

    robot: Robot
    standard: StandardSet


def build_identified_robot(
    robot: Robot,
    base: BaseParameters,
    values: Mapping[str, float],
    *,
    deviations: Mapping[str, float] | None = None,
    rotors: Mapping[str, float] | None = None,
    elasticity: Sequence[Elasticity] = (),
) -> IdentifiedRobot:
    """Return `robot` with the values of an identification.

    Args:
        robot: the robot.
        base: its base parameters.
        values: of base and friction parameters by name, SI; some or all of them.
        deviations: standard deviations of the same.
        rotors: rotor inertias of elastic joints by name (IA1), kg m^2 or kg.
        elasticity: one record a coordinate, none for a robot without elastic joints.

    Raises:
        UsageError, RobotError, SolverError: see `find_standard_set`.
    """
    standard = find_standard_set(robot, base, values, prior=_find_prior(robot), deviations=deviations)
    known: dict[Label, float] = dict(standard.drives)
    for parameter in base.friction:
        if len(parameter.terms) == 1 and parameter.name in values:
            known[parameter.label] = values[parameter.name]
    springs = dict(zip(robot.coordinates, elasticity, strict=True)) if elasticity else {}
    joints = []
    for index, joint in enumerate(robot.joints):
        changed = _change_joint(robot, index, joint, known)
        rotor = (rotors or {}).get(f"IA{index + 1}")
        if rotor is not None:
            changed = replace(changed, drive=replace(changed.drive, has_rotor=True, rotor_inertia=rotor))
        if index in springs:
            changed = replace(changed, elasticity=springs[index])
        joints.append(replace(changed, inertial=tuple(map(float, standard.pi[index])), form=None))
    couplings = tuple(
        _change_coupling(robot, robot.size + number, coupling, known)
        for number, coupling in enumerate(robot.couplings)
    )
    return IdentifiedRobot(robot=replace(robot, joints=tuple(joints), couplings=couplings), standard=standard)


def _find_prior(robot: Robot) -> FloatArray | None:
    """Return the file's own bodies (n, 10), None where it does not state them all, or none can exist."""
    rows = [joint.inertial for joint in robot.joints]
    if any(row is None or find_impossibility(row) for row in rows):
        return None
    return np.array(rows, dtype=np.float64)


def _change_friction(robot: Robot, index: int, known: Mapping[Label, float]) -> FrictionValues:
    friction = find_friction(robot, index)
    names = FRICTION_MODELS[friction.kind].parameters
    old = friction.values or (None,) * len(names)
    found = [known.get((index, name), value) for name, value in zip(names, old, strict=True)]
    numbers = tuple(value for value in found if value is not None)
    return replace(friction, values=numbers if numbers and len(numbers) == len(names) else None)


def _change_joint(robot: Robot, index: int, joint: Joint, known: Mapping[Label, float]) -> Joint:
    drive, spring = joint.drive, joint.spring
    if (index, "IA") in known:
        drive = replace(drive, rotor_inertia=known[index, "IA"])
    if spring is not None and (index, "KS") in known and known[index, "KS"]:
        stiffness = known[index, "KS"]
        spring = Spring(stiffness=stiffness, rest=-known.get((index, "KR"), 0.0) / stiffness)
    return replace(joint, drive=drive, spring=spring, friction=_change_friction(robot, index, known))


def _change_coupling(robot: Robot, index: int, coupling: Coupling, known: Mapping[Label, float]) -> Coupling:
    rotor = known.get((index, "IA"), coupling.rotor_inertia)
    return replace(coupling, rotor_inertia=rotor, friction=_change_friction(robot, index, known))
