"""The identified values of a robot beside its model.

Robot, estimate (rigid or elastic, itself or its file) -> `Identified`, and the robot with these values.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from symid.codegen import build_model_card
from symid.dynamics import BaseParameters, IdentifiedRobot, build_identified_robot, derive_base_parameters
from symid.errors import Notice
from symid.identification.elastic import ElasticEstimate, build_rigid_estimate, build_rigid_variant
from symid.identification.estimators import Estimate, ParameterEstimate, check_model
from symid.identification.rigid import restore_robot
from symid.joint_models import Elasticity
from symid.robot import (
    Robot,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identified:
    """Identified values of a robot, rotors of elastic joints, springs one a joint.

    `robot` is the robot as it was identified, `base` its base parameters; `missing` names what has no value;
    `covariance` is that of `values`, empty where the method gives none.
    """

    robot: Robot
    base: BaseParameters
    sources: tuple[str, ...]
    values: tuple[ParameterEstimate, ...]
    rotors: Mapping[str, float] = field(default_factory=dict)
    springs: tuple[Elasticity, ...] = ()
    missing: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()


def build_identified(robot: Robot, estimate: Estimate | ElasticEstimate, source: Path) -> Identified:
    """Return the values of an estimate, rigid or elastic, of a robot as its file states it.

    Friction and settings of the estimate are restored; `source` is where it is from, for messages.

    Raises:
        EstimateError: it is of another model.
    """
    described = restore_robot(robot, estimate)
    if isinstance(estimate, ElasticEstimate):
        return _build_elastic(described, estimate, source)
    found = build_rigid_estimate(estimate, described)
    robot = build_rigid_variant(described)
    base = derive_base_parameters(robot)
    check_model(found, build_model_card(robot, base, ()), str(source))
    text = (
        "the joints were identified as rigid, and are written as rigid: rotors turn with their links, and "
        "the springs of the robot file are left out, because these values do not hold with them"
    )
    notices = (Notice(code="export.rigid-variant", text=text, file=str(source)),)
    # Shape values are part of the robot, as lengths are.
    shape = {name for law in found.laws for name in law.names}
    kept = [k for k, entry in enumerate(found.parameters) if entry.name not in shape]
    covariance = tuple(tuple(found.covariance[k][j] for j in kept) for k in kept) if found.covariance else ()
    values = tuple(found.parameters[k] for k in kept)
    return Identified(
        robot=robot,
        base=base,
        sources=found.sources,
        values=values,
        missing=_list_missing(base, values),
        notices=notices if any(described.elastic) else (),
        covariance=covariance,
    )


def _build_elastic(robot: Robot, found: ElasticEstimate, source: Path) -> Identified:
    """Return the values of an estimate of elastic joints; what it refuses has no value."""
    base = derive_base_parameters(robot)
    check_model(found, build_model_card(robot, base, ()), str(source))
    refused = {entry for entry, _ in found.refused}
    known = [entry for entry in found.parameters if entry.name not in refused]
    names = {entry.name for entry in (*base.parameters, *base.friction)}
    values = tuple(entry for entry in known if entry.name in names)
    rotors = tuple(entry.name for entry in found.parameters if entry.name not in names)
    own = [robot.joints[index].elasticity for index in robot.coordinates]
    springs = (
        tuple(
            entry.elasticity if entry.told else stated or Elasticity()
            for entry, stated in zip(found.springs, own, strict=True)
        )
        if found.springs
        else ()
    )
    lacking = [entry.joint for entry in found.springs if not entry.told]
    if not found.springs:
        lacking = [entry.joint for entry in found.residual]
    places = [k for k, entry in enumerate(found.parameters) if entry in values]
    return Identified(
        robot=robot,
        base=base,
        sources=found.sources,
        values=values,
        rotors={entry.name: entry.value for entry in known if entry.name not in names},
        springs=springs,
        missing=(
            *_list_missing(base, values),
            *(entry for entry in rotors if entry in refused),
            *(f"the spring of {joint!r}" for joint in lacking),
        ),
        # The robot file's own springs are written in place of those that are refused.
        notices=(
            *(
                Notice(
                    code="export.spring",
                    text=f"the identified spring of {entry.joint!r} is not written: {entry.reason}",
                    file=str(source),
                )
                for entry in found.springs
                if not entry.told
            ),
            *_list_effects(found, source),
        ),
        covariance=tuple(tuple(found.covariance[i][j] for j in places) for i in places if found.covariance),
    )


def _list_effects(found: ElasticEstimate, source: Path) -> tuple[Notice, ...]:
    """Return a notice on what was taken off before the fit, for which robots have no place."""
    joints = [entry.joint for entry in found.residual]
    names = [
        effect.kind if effect.joint < 0 else f"{effect.kind} of {joints[effect.joint]!r}"
        for effect in found.effects
    ]
    if not names:
        return ()
    text = (
        f"the robot has no place for what was taken off before the fit: {', '.join(names)}; its torques lack "
        "them"
    )
    return (Notice(code="export.effects", text=text, file=str(source)),)


def _list_missing(base: BaseParameters, values: Sequence[ParameterEstimate]) -> tuple[str, ...]:
    known = {entry.name for entry in values}
    return tuple(entry.name for entry in (*base.parameters, *base.friction) if entry.name not in known)


def build_robot(found: Identified) -> IdentifiedRobot:
    """Return the robot with the estimate's values, in bodies that exist."""
    # Some methods give no deviations; those of some values alone do not say how to weigh the others.
    deviations = {entry.name: entry.std for entry in found.values if 0.0 < entry.std < math.inf}
    return build_identified_robot(
        found.robot,
        found.base,
        {entry.name: entry.value for entry in found.values},
        deviations=deviations if len(deviations) == len(found.values) else None,
        rotors=found.rotors,
        elasticity=found.springs,
    )


def list_warnings(identified: IdentifiedRobot, found: Identified, source: Path) -> tuple[Notice, ...]:
    """Return the notices on the robot built from the estimate of `source`."""
    standard, notices = identified.standard, [*found.robot.notices, *found.notices]
    if standard.reason:
        known = {entry.name: entry.std for entry in found.values if 0.0 < entry.std < math.inf}
        moved = [
            abs(change) / known[name]
            for name, change in zip(standard.names, standard.residual.tolist(), strict=True)
            if name in known
        ]
        far = f", at most {max(moved):.2g} standard deviations away" if moved else ""
        text = (
            f"no physical bodies have exactly the identified values; the nearest were written{far}: "
            f"{standard.reason}"
        )
        notices.append(Notice(code="export.inconsistent", text=text, file=str(source)))
    if found.missing:
        names = ", ".join(found.missing)
        text = f"not identified, taken from the robot file or the nearest bodies: {names}"
        notices.append(Notice(code="export.not-identified", text=text, file=str(source)))
    return tuple(notices)
