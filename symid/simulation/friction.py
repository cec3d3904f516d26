"""Joint friction as a plant sees it: a straight line per direction of motion, a band at standstill.

Input: the model card and its friction values. Output: `FrictionLines`.

    dq > 0: tau_f = viscous_p dq + level_p;  dq < 0: tau_f = viscous_n dq + level_n
    dq = 0: any tau_f within [level_n, level_p] that holds the joint

Supported: none, viscous and Coulomb, with offset, asymmetric.
Not supported: Stribeck, pre-sliding.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.functions import ModelCard, ParameterCard
from symid.errors import Notice, UsageError
from symid.joint.friction import FRICTION_MODELS
from symid.robot.description import FrictionKind

__all__ = ["FrictionLines", "find_friction_lines", "find_values"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionLines:
    """The lines of all joints; rows: [standstill, positive, negative], so that mode -1 is the last.

    Args:
        viscous: (3, n) N m s/rad or N s/m. level: (3, n) N m or N; the first row of both is zero.
    """

    viscous: FloatArray
    level: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("viscous", "level"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def find_values(parameters: tuple[ParameterCard, ...], robot: str) -> FloatArray:
    """Return the values of parameters, (p,).

    Raises:
        UsageError: the robot file does not state all of them.
    """
    unknown = [parameter.name for parameter in parameters if parameter.value is None]
    if unknown:
        text = (
            f"robot {robot!r} cannot be simulated: its file states no value for {', '.join(unknown)}; "
            "give mass, centre of mass, inertia and friction of every link"
        )
        raise UsageError(Notice(code="usage.unknown-values", text=text))
    return np.array([parameter.value for parameter in parameters], dtype=np.float64)


def find_friction_lines(card: ModelCard) -> FrictionLines:
    """Return the friction lines of the card's joints.

    Raises:
        UsageError: values are missing, or friction would push: level_p < level_n, or a negative slope;
            friction acts on several joints at once, or its offset is grouped with a weight.
    """
    wanted = [
        name for joint in card.joints for name in FRICTION_MODELS[FrictionKind(joint.friction)].parameters
    ]
    found = [parameter.name for parameter in card.friction]
    if len(found) != len(wanted) or not all(map(str.startswith, found, wanted)):
        text = (
            f"robot {card.robot!r} has friction that is not of one joint alone: of a coupled drive, of a "
            "joint that follows another, or an offset grouped with a weight; simulation cannot make such "
            "joints stick: leave that friction out of the robot file"
        )
        raise UsageError(Notice(code="usage.shared-friction", text=text))
    values = find_values(card.friction, card.robot)
    viscous, level = np.zeros((3, card.size)), np.zeros((3, card.size))
    start = 0
    for index, joint in enumerate(card.joints):
        kind = FrictionKind(joint.friction)
        own = values[start : start + len(FRICTION_MODELS[kind].parameters)]
        start += len(own)
        if kind is FrictionKind.ASYMMETRIC:
            viscous[1:, index], level[1:, index] = (own[0], own[2]), (own[1], -own[3])
        elif kind is not FrictionKind.NONE:
            offset = own[2] if len(own) > 2 else 0.0
            viscous[1:, index], level[1:, index] = own[0], (own[1] + offset, offset - own[1])
        if level[1, index] < level[2, index] or np.any(viscous[:, index] < 0.0):
            text = f"joint {joint.name!r}: friction must oppose motion; its values must not be negative"
            raise UsageError(Notice(code="usage.negative-friction", text=text))
    return FrictionLines(viscous=viscous, level=level)
