"""The result of an identification of friction, joint by joint, and its export to robot files.

Fits, choices, tests -> FrictionIdentification; JointFriction -> FrictionValues, or why there are none.

Robot files name friction relative to its Coulomb level, as the columns of the laws do: Fe = fS - fC, offset
= fP where friction has no zone about standstill. Laws whose columns are those of a model of robot files can
be exported, without refused values.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, final

from symid.codegen import ModelCard
from symid.identification.estimators import FitRecord, Residual
from symid.identification.friction.estimate import FrictionEstimate
from symid.identification.friction.poses import PoseTest
from symid.identification.friction.samples import VelocityMap
from symid.identification.friction.selection import LawSelection
from symid.joint_models import get_law
from symid.robot import (
    FRICTION_PARAMETERS,
    FRICTION_SHAPES,
    CurvedFriction,
    FrictionKind,
    FrictionValues,
    Robot,
    ShapeKey,
    override_robot,
)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class JointFriction:
    """Friction of one joint.

    Args:
        estimate: the law's parameters and their uncertainty.
        formula: of the law, in words; smoothing: v0 of its sign in rad/s or m/s, 0 for the sign.
        unit: of the torque; rigid: how the rigid part of the torque was treated.
        residual: of the logs it was fitted to.
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


_EXPONENT = r"(?:-(?P<gamma>exponent|[\d.e-]+))?"
_NAMES, _NAMES_H3 = {"Fs": "Fe", "Fv2": "Fvq", "Fv3": "Fvc"}, {"Fs": "Fe", "Fp": "offset"}


class _Family(NamedTuple):
    """Laws of a model: a pattern of their names, the model, that with an offset, other names."""

    pattern: str
    kind: FrictionKind | CurvedFriction
    with_offset: FrictionKind | CurvedFriction | None = None
    names: Mapping[str, str] = _NAMES
    gamma: str = "2"
    has_sign: bool = True


_FAMILIES = (
    _Family(r"coulomb(?:-viscous)?", FrictionKind.VISCOUS_COULOMB, FrictionKind.VISCOUS_COULOMB_OFFSET),
    _Family(r"coulomb-viscous-offset", FrictionKind.VISCOUS_COULOMB_OFFSET),
    _Family(r"asymmetric", FrictionKind.ASYMMETRIC),
    _Family(r"tustin", CurvedFriction.STRIBECK, CurvedFriction.STRIBECK_OFFSET, gamma="1"),
    _Family(rf"stribeck{_EXPONENT}", CurvedFriction.STRIBECK, CurvedFriction.STRIBECK_OFFSET),
    _Family(rf"improved-stribeck-h3{_EXPONENT}", CurvedFriction.STRIBECK_OFFSET, names=_NAMES_H3),
    _Family(rf"improved-stribeck{_EXPONENT}", CurvedFriction.IMPROVED_STRIBECK, has_sign=False),
    _Family(rf"asymmetric-stribeck{_EXPONENT}", CurvedFriction.ASYMMETRIC_STRIBECK),
    _Family(r"cubic|polynomial-(?:2|3|2,3|3,2)", CurvedFriction.CUBIC),
    _Family(rf"stribeck{_EXPONENT}\+cubic", CurvedFriction.STRIBECK_CUBIC),
    _Family(r"power-law", CurvedFriction.POWER_LAW),
    _Family(r"makkar", CurvedFriction.MAKKAR, has_sign=False),
)


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
    found = _get_family(law.name)
    if found is None:
        further, plain = [name for name in law.inputs if name != "velocity"], law.name.removesuffix("+offset")
        text = f"robot files have no model of the law {law.name!r}"
        if further:
            text += f": it reads the {' and the '.join(further)} besides the velocity"
        elif _get_family(plain) is not None:
            text += f"; they have {plain!r}, without an offset"
        raise ValueError(text)
    family, kind, gamma = found
    linear = zip(law.linear, estimate.linear, strict=True)
    values = {family.names.get(entry.name, entry.name): value for entry, value in linear}
    shape = {entry.name: value for entry, value in zip(law.shape, estimate.shape, strict=True)}
    if "gamma" not in shape and gamma != "exponent":
        shape["gamma"] = float(gamma)
    keys: Sequence[ShapeKey] = FRICTION_SHAPES.get(kind, ())
    wrong = [
        f"{key.name} = {shape[key.name]:g}, and robot files allow {key.allowed}"
        for key in keys
        if shape[key.name] not in key.allowed
    ]
    if wrong:
        raise ValueError("; ".join(wrong))
    return FrictionValues(
        kind=kind,
        values=tuple(values.get(name, 0.0) for name in FRICTION_PARAMETERS[kind]),
        # Robot files refuse a smoothing where there is no sign.
        smoothing=joint.smoothing if family.has_sign else 0.0,
        shape=tuple(shape[key.name] for key in keys),
    )


def _get_family(name: str) -> tuple[_Family, FrictionKind | CurvedFriction, str] | None:
    """Return the family of a law, the model, and the exponent that the law's name fixes."""
    plain = name.removesuffix("+offset")
    for family in _FAMILIES:
        match = re.fullmatch(family.pattern, plain)
        if match is None:
            continue
        kind = family.kind if plain == name else family.with_offset
        gamma = match.groupdict().get("gamma") or family.gamma
        return None if kind is None else (family, kind, gamma)
    return None


def set_identified_friction(robot: Robot, found: FrictionIdentification) -> Robot:
    """Return the robot with the friction model that the identification gave to all joints, if any."""
    kinds = found.settings.get("friction")
    asked = set(kinds) if isinstance(kinds, Sequence) else set()
    own = {joint.friction.kind.value for joint in robot.axes}
    if len(asked) != 1 or asked == own or not asked <= {kind.value for kind in FrictionKind}:
        return robot
    return override_robot(robot, (), asked.pop())
