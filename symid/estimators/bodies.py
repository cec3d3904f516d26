"""What links base parameters to bodies: the grouping matrix, and what each parameter may be.

Input: a robot. Output: `Bodies`, in numbers, so that fits need neither the robot nor SymPy.

Supported: links, rotors of joints and couplings, friction; symbolic lengths with a value.
Not supported: elastic joints (their rotors are no base parameters).
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.notation import INERTIAL
from symid.robot.description import Robot

__all__ = ["Bodies", "build_bodies"]

_DISSIPATING = ("Fv", "Fc")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bodies:
    """beta = K pi in numbers.

    Args:
        names: (p,) base parameters, friction among them.
        links: (p, n, 10) coefficients of the links' standard parameters.
        positive: (p, a) coefficients of what must be positive: rotor inertias; `positive_names` (a,).
        bounded: (p, b) coefficients of what must not be negative: viscous and dry friction.
        free: (p, c) coefficients of offsets, springs and the like.
        stated: (n, 10) bodies of the robot file, or round ones in their place: the distance to them decides
            where the log does not. `unit` whether the file states none, and their mass is one each.
    """

    names: tuple[str, ...]
    links: FloatArray
    positive: FloatArray
    bounded: FloatArray
    free: FloatArray
    stated: FloatArray
    unit: bool
    positive_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("links", "positive", "bounded", "free", "stated"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_bodies(robot: Robot) -> Bodies:
    """Return the bodies behind the base parameters of `robot`.

    Raises:
        RobotError: a symbolic length has no value.
    """
    from symid.dynamics.labels import write_label
    from symid.parameters.base import find_base_parameters
    from symid.parameters.consistency_inputs import build_grouping
    from symid.parameters.consistency_prior import build_prior

    base = find_base_parameters(robot)
    names = tuple(entry.name for entry in (*base.parameters, *base.friction))
    grouping = build_grouping(robot, base, names)
    column = {label: index for index, label in enumerate(grouping.labels)}
    used = [label for label in grouping.labels if grouping.matrix[:, column[label]].any()]
    places = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    rotors = [label for label in used if label[1] == "IA"]
    bounded = [label for label in used if label[1].startswith(_DISSIPATING)]
    others = [label for label in used if label[1] not in (*INERTIAL, "IA") and label not in bounded]
    inertial = [column[index, name] for index in range(robot.size) for name in INERTIAL]

    def take(labels: list[tuple[int, str]]) -> FloatArray:
        return grouping.matrix[:, [column[label] for label in labels]].reshape(len(names), len(labels))

    return Bodies(
        names=names,
        links=grouping.matrix[:, places],
        positive=take(rotors),
        bounded=take(bounded),
        free=take(others),
        stated=build_prior(robot, grouping.matrix[:, inertial], np.zeros(len(names))),
        unit=all(joint.inertial is None for joint in robot.joints),
        positive_names=tuple(write_label(robot, label) for label in rotors),
    )
