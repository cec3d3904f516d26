"""An identified law of friction as robot files have it: the model, its values, its shape.

Input: `JointFriction`. Output: `FrictionValues`, or the reason why a robot file cannot say it.

Robot files name what friction has beyond its Coulomb level, as the columns of the laws do:

    Fe = fS - fC,    offset = fP where friction has no zone about standstill

Supported: all laws whose columns are those of a model of robot files, parameters that are zero among them.
Not supported: laws of load or position; an offset beside a model that has none; values that were refused.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES, ShapeKey
from symid.formats.overrides import override_robot
from symid.friction.results import FrictionIdentification, JointFriction
from symid.joint.friction_law import FrictionLaw
from symid.joint.friction_laws import get_law
from symid.robot.description import CurvedFriction, FrictionKind, FrictionValues, Robot

__all__ = ["build_robot_friction", "find_obstacle", "set_identified_friction"]

_EXPONENT = r"(?:-(?P<gamma>exponent|[\d.e-]+))?"
_NAMES = {"Fs": "Fe", "Fv2": "Fvq", "Fv3": "Fvc"}
_WITHOUT_ZONE = {"Fs": "Fe", "Fp": "offset"}
_TUSTIN = "1"
_GAUSSIAN = "2"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Family:
    """Laws that a model can say: a pattern of their names, the model, that with an offset, other names."""

    pattern: str
    kind: FrictionKind | CurvedFriction
    with_offset: FrictionKind | CurvedFriction | None = None
    names: Mapping[str, str]
    gamma: str = _GAUSSIAN
    has_sign: bool = True


_FAMILIES = (
    _Family(
        pattern=r"coulomb(?:-viscous)?",
        kind=FrictionKind.VISCOUS_COULOMB,
        with_offset=FrictionKind.VISCOUS_COULOMB_OFFSET,
        names={},
    ),
    _Family(pattern=r"coulomb-viscous-offset", kind=FrictionKind.VISCOUS_COULOMB_OFFSET, names={}),
    _Family(pattern=r"asymmetric", kind=FrictionKind.ASYMMETRIC, names={}),
    _Family(
        pattern=r"tustin",
        kind=CurvedFriction.STRIBECK,
        with_offset=CurvedFriction.STRIBECK_OFFSET,
        names=_NAMES,
        gamma=_TUSTIN,
    ),
    _Family(
        pattern=rf"stribeck{_EXPONENT}",
        kind=CurvedFriction.STRIBECK,
        with_offset=CurvedFriction.STRIBECK_OFFSET,
        names=_NAMES,
    ),
    _Family(
        pattern=rf"improved-stribeck-h3{_EXPONENT}",
        kind=CurvedFriction.STRIBECK_OFFSET,
        names=_WITHOUT_ZONE,
    ),
    _Family(
        pattern=rf"improved-stribeck{_EXPONENT}",
        kind=CurvedFriction.IMPROVED_STRIBECK,
        names=_NAMES,
        has_sign=False,
    ),
    _Family(
        pattern=rf"asymmetric-stribeck{_EXPONENT}", kind=CurvedFriction.ASYMMETRIC_STRIBECK, names=_NAMES
    ),
    _Family(pattern=r"cubic|polynomial-(?:2|3|2,3|3,2)", kind=CurvedFriction.CUBIC, names=_NAMES),
    _Family(pattern=rf"stribeck{_EXPONENT}\+cubic", kind=CurvedFriction.STRIBECK_CUBIC, names=_NAMES),
    _Family(pattern=r"power-law", kind=CurvedFriction.POWER_LAW, names={}),
    _Family(pattern=r"makkar", kind=CurvedFriction.MAKKAR, names={}, has_sign=False),
)


def find_obstacle(joint: JointFriction) -> str:
    """Return why no robot file can have the joint's friction as it was identified; empty where one can."""
    estimate = joint.estimate
    law = get_law(estimate.law, smoothing=joint.smoothing)
    physical = {entry.name for entry in law.physical}
    refused = [(name, reason) for name, reason in estimate.refused if name in physical]
    if refused:
        return "; ".join(f"{name} was refused: {reason}" for name, reason in refused)
    found = _find_family(law.name)
    if found is None:
        return f"robot files have no model of the law {law.name!r}{_explain(law)}"
    _, kind, gamma = found
    shape = _name_shape(law, estimate.shape, gamma)
    wrong = [
        f"{key.name} = {shape[key.name]:g}, and robot files take what is {key.allowed}"
        for key in FRICTION_SHAPES.get(kind, ())
        if shape[key.name] not in key.allowed
    ]
    return "; ".join(wrong)


def build_robot_friction(joint: JointFriction) -> FrictionValues:
    """Return the friction of a robot file whose torque is that of the identified law.

    Raises:
        ValueError: there is none; see `find_obstacle`.
    """
    law = get_law(joint.estimate.law, smoothing=joint.smoothing)
    found = _find_family(law.name)
    if found is None or find_obstacle(joint):
        raise ValueError(find_obstacle(joint))
    family, kind, gamma = found
    values = {
        family.names.get(entry.name, entry.name): value
        for entry, value in zip(law.linear, joint.estimate.linear, strict=True)
    }
    shape = _name_shape(law, joint.estimate.shape, gamma)
    keys: Sequence[ShapeKey] = FRICTION_SHAPES.get(kind, ())
    return FrictionValues(
        kind=kind,
        values=tuple(values.get(name, 0.0) for name in FRICTION_PARAMETERS[kind]),
        # Without a sign there is nothing to smooth, and robot files refuse it.
        smoothing=joint.smoothing if family.has_sign else 0.0,
        shape=tuple(shape[key.name] for key in keys),
    )


def _find_family(name: str) -> tuple[_Family, FrictionKind | CurvedFriction, str] | None:
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


def _name_shape(law: FrictionLaw, values: Sequence[float], gamma: str) -> dict[str, float]:
    shape = {entry.name: value for entry, value in zip(law.shape, values, strict=True)}
    return shape if "gamma" in shape or gamma == "exponent" else {**shape, "gamma": float(gamma)}


def _explain(law: FrictionLaw) -> str:
    further = [name for name in law.inputs if name != "velocity"]
    if further:
        return f": it reads the {' and the '.join(further)} besides the velocity"
    plain = law.name.removesuffix("+offset")
    if plain != law.name and _find_family(plain) is not None:
        return f"; they have {plain!r}, without an offset"
    return ""


def set_identified_friction(robot: Robot, found: FrictionIdentification) -> Robot:
    """Return the robot with the friction model that the identification gave to all joints, if it did."""
    kinds = found.settings.get("friction")
    asked = set(kinds) if isinstance(kinds, Sequence) else set()
    own = {joint.friction.kind.value for joint in robot.axes}
    if len(asked) != 1 or asked == own or not asked <= {kind.value for kind in FrictionKind}:
        return robot
    return override_robot(robot, (), asked.pop())
