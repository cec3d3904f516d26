"""The result of an identification of friction, joint by joint, and its export to robot files.

Fits, choices, tests -> FrictionIdentification; JointFriction -> FrictionValues, or why there are none.

Robot files name friction relative to its Coulomb level, as the columns of the laws do: Fe = fS - fC. All laws
can be exported, without refused values.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from symid.codegen import ModelCard
from symid.identification.estimators import FitRecord, LawSelection, MotionResidual, Residual
from symid.identification.friction.estimate import FrictionEstimate
from symid.identification.friction.poses import PoseTest
from symid.identification.friction.samples import VelocityMap
from symid.joint_models import NO_FRICTION, FrictionValues, get_law, has_sign, rename_law
from symid.robot import Robot, override_robot


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class JointFriction:
    """Friction of one joint.

    Args:
        estimate: the law's parameters and their uncertainty.
        formula: of the law, in words; smoothing: v0 of its sign in rad/s or m/s, 0 for the sign.
        unit: of the torque; rigid: how the rigid part of the torque was treated.
        residual: of the logs it was fitted to; motion: the same in motion, at reversal and at rest, with the
            rows that were left out as slow.
        selection: how the law was chosen; None where it was named.
        poses: whether friction depends on the pose; None where one pose was recorded.
        velocity_map: friction torque against velocity, as measured.
        sources: the logs in which the joint moves.
    """

    estimate: FrictionEstimate
    formula: str
    smoothing: float
    unit: str
    velocity_unit: str
    rigid: str
    residual: Residual
    selection: LawSelection | None
    poses: PoseTest | None
    velocity_map: VelocityMap
    sources: tuple[str, ...]
    motion: MotionResidual | None = None

    @property
    def joint(self) -> str:
        """Return the joint's name."""
        return self.estimate.joint

    def __repr__(self) -> str:
        """Return joint, law and parameters in one line."""
        values = ", ".join(map(str, self.estimate.parameters))
        return f"<JointFriction {self.joint}: {self.estimate.law}; {values}>"


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionIdentification(FitRecord):
    """Friction of the joints that move, `refused` the others; `model` is the law asked for, or "auto"."""

    kind: ClassVar[str] = "friction"
    model: str
    estimator: str
    joints: tuple[JointFriction, ...]

    def list_mistakes(self) -> list[str]:
        """Return arrays of a record that do not fit a law or each other; raise UsageError for no law."""
        mistakes = [text for joint in self.joints for text in _list_mistakes(joint)]
        return mistakes if self.joints else ["joints is empty"]

    def list_strangers(self, card: ModelCard) -> list[str]:
        """Return joints that are not those of the model, or given twice."""
        known, given = [joint.name for joint in card.joints], [entry.joint for entry in self.joints]
        wrong = [name for name in dict.fromkeys(given) if name not in known or given.count(name) > 1]
        names = ", ".join(map(repr, wrong))
        return [f"{names} must be joints of robot {card.robot!r}, each once"] if wrong else []


def _list_mistakes(joint: JointFriction) -> list[str]:
    estimate, curve = joint.estimate, joint.velocity_map
    law = get_law(estimate.law, smoothing=joint.smoothing)
    size = len(law.linear) + len(law.shape) + len(estimate.other)
    lengths = [
        ("estimate.linear", len(estimate.linear), len(law.linear)),
        ("estimate.shape", len(estimate.shape), len(law.shape)),
        ("estimate.covariance", len(estimate.covariance), size),
        *((f"estimate.covariance, row {k}", len(row), size) for k, row in enumerate(estimate.covariance)),
        *(
            (f"velocity_map.{name}", len(getattr(curve, name)), len(curve.velocity))
            for name in ("torque", "spread", "count")
        ),
        ("velocity_map.cloud_torque", len(curve.cloud_torque), len(curve.cloud_velocity)),
    ]
    if joint.poses is not None:
        many = len(joint.poses.poses)
        for entry in joint.poses.parameters:
            for name, values in (("values", entry.values), ("stds", entry.stds), ("freedom", entry.freedom)):
                absent = name == "freedom" and not values
                lengths.append((f"poses, {name} of {entry.name}", many if absent else len(values), many))
    mistakes = [
        f"joint {joint.joint!r}: {name} has {length} entries, not {wanted}"
        for name, length, wanted in lengths
        if length != wanted
    ]
    if not len(curve.cloud_velocity):
        mistakes.append(f"joint {joint.joint!r}: velocity_map.cloud_velocity is empty")
    numbers = (*estimate.linear, *estimate.shape, *curve.cloud_velocity, *curve.cloud_torque)
    if not all(map(math.isfinite, numbers)):
        mistakes.append(f"joint {joint.joint!r}: values of the law or of measured rows are not numbers")
    chosen = joint.selection and joint.selection.chosen
    if joint.selection and chosen not in {trial.law for trial in joint.selection.trials}:
        mistakes.append(f"joint {joint.joint!r}: selection.chosen {chosen!r} is not one of the laws tried")
    return mistakes


def describe_obstacle(joint: JointFriction) -> str:
    """Return why no robot file can have the identified friction of a joint; empty where one can."""
    try:
        build_robot_friction(joint)
    except ValueError as error:
        return str(error)
    return ""


def build_robot_friction(joint: JointFriction) -> FrictionValues:
    """Return the friction of a robot file with the identified law; raise ValueError why there is none."""
    estimate = joint.estimate
    law = get_law(estimate.law, smoothing=joint.smoothing)
    physical = {entry.name for entry in law.physical}
    wrong = [f"{name} was refused: {reason}" for name, reason in estimate.refused if name in physical]
    if wrong:
        raise ValueError("; ".join(wrong))
    return FrictionValues(
        law=law.name,
        values=estimate.linear,
        shape=estimate.shape,
        # Robot files refuse a smoothing where there is no sign.
        smoothing=joint.smoothing if has_sign(get_law(law.name)) else 0.0,
    )


def set_identified_friction(robot: Robot, found: FrictionIdentification) -> Robot:
    """Return the robot with the friction model that the identification gave to all joints, if any."""
    kinds = found.settings.get("friction")
    asked = {rename_law(kind) for kind in kinds} if isinstance(kinds, Sequence) else set()
    own = {joint.friction.law for joint in robot.axes}
    law = asked.pop() if len(asked) == 1 else NO_FRICTION
    if law == NO_FRICTION or own == {law} or get_law(law).shape:
        return robot
    return override_robot(robot, (), law)
