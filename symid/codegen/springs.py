"""The parameters h of the springs of a robot with elastic joints: their order, names, units, values.

Input: elasticities, a robot. Output: cards, the vector h, the springs of a carrier from its references.

For every coordinate k0, the cubic kc where the robot file states one, k and r of every stop, s and R of every
knee in the order of their thresholds. Names end in the number of the joint: k0_1, k2_1, r2_1, s1_1, R1_1.
Damping is not among them.

Supported: robots all of whose coordinates belong to elastic joints.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard, ParameterCard
from symid.errors import Notice, UsageError
from symid.joint.hysteresis import SpringTerms
from symid.notation import find_unit
from symid.robot.description import FrictionKind, JointKind, Robot
from symid.robot.elasticity import Elasticity

__all__ = [
    "ElasticSizes",
    "build_spring_terms",
    "find_elastic_sizes",
    "find_spring_vector",
    "list_spring_parameters",
]

V = TypeVar("V")

_REASONS = {
    "k0": "stiffness when all stops slip",
    "kc": "hardening with the third power of the torsion",
    "k": "stiffness of a stop",
    "r": "torsion at which the stop slips",
    "s": "slope added beyond the knee",
    "R": "torque at which the knee begins",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticSizes:
    """What the catalogue must know of the elastic joints of a robot.

    Args:
        stops: all stops of the robot: length of P and Q.
        springs: length of h.
        invertible: whether the springs have an inverse: none has a cubic part.
        feed: whether torque of the motors can be found from the motion of the links: every motor has a rotor
            of its own, no spring is damped, nothing is coupled.
    """

    stops: int
    springs: int
    invertible: bool = True
    feed: bool = True


def find_elastic_sizes(robot: Robot) -> ElasticSizes | None:
    """Return the sizes of a robot whose joints are all elastic, None of another."""
    found = [joint.elasticity for joint in robot.axes if joint.elasticity is not None]
    if len(found) < robot.freedom:
        return None
    invertible = not any(spring.cubic for spring in found)
    # What follows is a link without a motor: it must not brake one, nor give.
    alone = not robot.couplings and all(
        joint.elasticity is None and joint.friction.kind is FrictionKind.NONE
        for joint in robot.joints
        if joint.mimic is not None
    )
    driven = all(joint.drive.has_rotor for joint in robot.axes)
    return ElasticSizes(
        stops=sum(len(spring.stops) for spring in found),
        springs=sum(len(_list_entries(spring)) for spring in found),
        invertible=invertible,
        feed=invertible and driven and alone and not any(spring.damping for spring in found),
    )


def _list_entries(elasticity: Elasticity) -> list[tuple[str, int, float | None]]:
    """Return letter, place among its like (0 if there is one only) and value of every entry of a spring."""
    entries: list[tuple[str, int, float | None]] = [("k0", 0, elasticity.stiffness)]
    if elasticity.cubic:
        entries.append(("kc", 0, elasticity.cubic))
    for place, stop in enumerate(elasticity.stops, start=1):
        entries += [("k", place, stop.stiffness), ("r", place, stop.threshold)]
    for place, knee in enumerate(elasticity.knees, start=1):
        entries += [("s", place, knee.slope), ("R", place, knee.threshold)]
    return entries


def list_spring_parameters(robot: Robot) -> Iterator[ParameterCard]:
    """Yield the entries of h with the values of the robot file."""
    for number, joint in enumerate(robot.joints, start=1):
        if joint.elasticity is None or joint.mimic is not None:
            continue
        prismatic = joint.kind is JointKind.PRISMATIC
        for letter, place, value in _list_entries(joint.elasticity):
            name = f"{letter}{place or ''}_{number}"
            yield ParameterCard(
                name=name,
                expression=name,
                unit=find_unit(letter, prismatic=prismatic),
                reason=_REASONS[letter],
                joint=joint.name,
                value=value,
            )


def _find_layout(elasticity: Elasticity) -> tuple[int, int, int, int]:
    """Return what the place of an entry in h means: cubic parts, stops, knees below zero and above."""
    below = sum(knee.threshold < 0 for knee in elasticity.knees)
    return int(bool(elasticity.cubic)), len(elasticity.stops), below, len(elasticity.knees) - below


def _check_layout(elasticities: Sequence[Elasticity], card: ModelCard) -> None:
    for joint, wanted, given in zip(card.joints, card.elasticity, elasticities, strict=True):
        if wanted is None or _find_layout(wanted) != _find_layout(given):
            allowed = "none" if wanted is None else "{} cubic parts, {} stops, {} knees below, {} above"
            text = (
                f"joint {joint.name!r}: the library was made for a spring with "
                f"{allowed.format(*_find_layout(wanted or given))}; this one has "
                f"{'{}, {}, {} and {}'.format(*_find_layout(given))}: generate a library for it"
            )
            raise UsageError(Notice(code="usage.spring-layout", text=text))


def find_spring_vector(elasticities: Sequence[Elasticity], card: ModelCard | None = None) -> FloatArray:
    """Return h of springs whose numbers are all known, one a coordinate.

    Args:
        elasticities: one a coordinate.
        card: of the library that shall take h; None leaves unchecked whether its springs are built alike.

    Raises:
        UsageError: a number is unknown, or the springs have other parts than those of `card`.
    """
    if card is not None:
        _check_layout(elasticities, card)
    entries = [entry for elasticity in elasticities for entry in _list_entries(elasticity)]
    values = [value for _, _, value in entries if value is not None]
    if len(values) < len(entries):
        text = "a stiffness of an elastic joint is unknown; give it, or identify it first"
        raise UsageError(Notice(code="usage.unknown-spring", text=text))
    return np.array(values)


def build_spring_terms(elasticities: Sequence[Elasticity], values: Sequence[V]) -> list[SpringTerms[V]]:
    """Return the springs, one a coordinate, whose numbers are the entries of h."""
    rest = iter(values)
    springs = []
    for elasticity in elasticities:
        stiffness = next(rest)
        cubic = next(rest) if elasticity.cubic else None
        pairs = [(next(rest), next(rest)) for _ in elasticity.stops]
        knees = [(next(rest), next(rest)) for _ in elasticity.knees]
        turned = tuple((threshold, slope) for slope, threshold in knees)
        count = sum(knee.threshold < 0 for knee in elasticity.knees)
        springs.append(
            SpringTerms(
                stiffness=stiffness,
                cubic=cubic,
                stops=tuple((threshold, weight) for weight, threshold in pairs),
                above=turned[count:],
                below=turned[:count][::-1],
            )
        )
    return springs
