"""The numbers behind an elastic robot: what a simulated truth, or an estimate to be tried, consists of.

Input: a robot and its library's card. Output: `ElasticValues`; for the plant, `PlantRobot`.

Supported: robots all of whose coordinates belong to elastic joints, rotors included.
Not supported: robots that are elastic in part; joints without a rotor inertia; dry friction that jumps.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.plant_orders import PlantRobot
from symid.errors import Notice, UsageError
from symid.robot.description import Robot
from symid.robot.elasticity import Elasticity

__all__ = ["ElasticValues", "build_plant_robot", "find_elastic_values"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticValues:
    """Values of all parameters of an elastic robot, in the order of its card.

    Args:
        beta: (p,) of the links. rotor: (n,) kg m^2 or kg. friction: (pf,), motor side.
        elasticity: n springs, all numbers known.
    """

    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[Elasticity, ...]

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("beta", "rotor", "friction"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_elastic_values(robot: Robot, card: ModelCard) -> ElasticValues:
    """Return the values that the robot file states.

    Raises:
        UsageError: the robot cannot be simulated as an elastic one; all reasons at once.
    """
    if not card.elastic:
        raise UsageError(_describe_rigid(robot))
    notices = [*_find_gaps(robot, card), *_find_sharp_friction(robot, card)]
    if notices:
        raise UsageError(*notices)
    rotors = {rotor.joint: rotor.value for rotor in card.rotors}
    return ElasticValues(
        beta=_list_values(card.beta),
        rotor=np.array([rotors[joint.name] for joint in robot.axes], dtype=np.float64),
        friction=_list_values(card.friction),
        elasticity=tuple(spring for spring in card.elasticity if spring is not None),
    )


def _list_values(parameters: tuple[ParameterCard, ...]) -> FloatArray:
    return np.array([parameter.value for parameter in parameters], dtype=np.float64)


def _describe_rigid(robot: Robot) -> Notice:
    names = [joint.name for joint, gives in zip(robot.axes, robot.elastic, strict=True) if not gives]
    text = (
        f"robot {robot.name!r} is not elastic in every joint ({', '.join(names)} do not give); elastic "
        "simulation wants an [joint.elasticity] table for all joints or for none"
    )
    return Notice(code="usage.not-elastic", text=text)


def _list_gaps(robot: Robot, card: ModelCard) -> Iterator[str]:
    """Yield what the robot file does not state."""
    for parameter in (*card.beta, *card.rotors, *card.friction):
        if parameter.value is None:
            yield parameter.name
    rotors = {rotor.joint for rotor in card.rotors}
    for joint, spring in zip(robot.axes, card.elasticity, strict=True):
        if joint.name not in rotors:
            yield f"rotor_inertia of {joint.name!r}"
        if spring is not None and spring.initial_stiffness is None:
            yield f"stiffness of {joint.name!r} and of its stops"


def _find_gaps(robot: Robot, card: ModelCard) -> Iterator[Notice]:
    unknown = list(_list_gaps(robot, card))
    if unknown:
        text = (
            f"robot {robot.name!r} cannot be simulated: its file states no value for {', '.join(unknown)}; "
            "give mass, centre of mass and inertia of every link, rotor inertia, friction and elasticity "
            "of every joint"
        )
        yield Notice(code="usage.unknown-values", text=text)
    rotors = {rotor.joint: rotor.value for rotor in card.rotors}
    light = [name for name, value in rotors.items() if value is not None and not value > 0.0]
    soft = [
        name for name, spring in _pair(robot, card) if spring.stiffness is not None and spring.stiffness <= 0
    ]
    for names, what in ((light, "rotor_inertia"), (soft, "stiffness")):
        if names:
            text = f"robot {robot.name!r}: the {what} of {', '.join(names)} must be positive to be simulated"
            yield Notice(code="usage.not-positive", text=text)


def _pair(robot: Robot, card: ModelCard) -> Iterator[tuple[str, Elasticity]]:
    for joint, spring in zip(robot.axes, card.elasticity, strict=True):
        if spring is not None:
            yield joint.name, spring


def _find_sharp_friction(robot: Robot, card: ModelCard) -> Iterator[Notice]:
    """Yield a notice if dry friction jumps: a motor that sticks is not among the plant's modes."""
    smooth = {joint.name for joint in robot.joints if joint.friction.smoothing > 0.0}
    smooth |= {coupling.name for coupling in robot.couplings if coupling.friction.smoothing > 0.0}
    names = [entry.name for entry in card.friction if entry.name.startswith("Fc") and entry.value]
    sharp = [entry.name for entry in card.friction if entry.name in names and entry.joint not in smooth]
    if sharp:
        text = (
            f"robot {robot.name!r}: the dry friction {', '.join(sharp)} changes its sign at once, which the "
            "elastic plant cannot hold at rest; give [joint.friction] a `smoothing` speed, such as 0.01 rad/s"
        )
        yield Notice(code="usage.sharp-friction", text=text)


def build_plant_robot(values: ElasticValues) -> PlantRobot:
    """Return the numbers as tables; stops and knees that a joint lacks have a weight and slope of zero."""
    springs = values.elasticity
    stops = max(len(spring.stops) for spring in springs)
    knees = max(len(spring.knees) for spring in springs)
    shape = (len(springs), stops)
    radius, weight = np.ones(shape), np.zeros(shape)
    knee, slope = np.ones((len(springs), knees)), np.zeros((len(springs), knees))
    for row, spring in enumerate(springs):
        for column, stop in enumerate(spring.stops):
            radius[row, column], weight[row, column] = stop.threshold, stop.stiffness or 0.0
        for column, bend in enumerate(spring.knees):
            knee[row, column], slope[row, column] = bend.threshold, bend.slope
    return PlantRobot(
        beta=values.beta,
        friction=values.friction,
        rotor=values.rotor,
        stiffness=np.array([spring.stiffness or 0.0 for spring in springs]),
        cubic=np.array([spring.cubic for spring in springs]),
        damping=np.array([spring.damping for spring in springs]),
        radius=radius,
        weight=weight,
        knee=knee,
        slope=slope,
    )
