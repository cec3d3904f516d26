"""What friction parameters are made of: multiples of w, |w|, sign(w) and one.

Input: a friction model. Output: these four coefficients for each parameter, and rows of parameters that
motion shows apart from each other.

Away from standstill every column that is piecewise linear in the speed w is such a sum; the four functions
are independent, and four speeds tell them. A curved column is a function of its own, independent of them and
of those that have another shape; a cube of several speeds is a sum of products.

Supported: joints, joints that follow others, couplings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product
from math import prod
from typing import cast

from symid.joint.friction import FRICTION_MODELS, find_friction, list_friction_parameters
from symid.joint.friction_law import FrictionCarrier
from symid.robot.description import CurvedFriction, FrictionKind, FrictionValues, Robot

__all__ = ["find_constant_torques", "find_friction_rows"]

Label = tuple[int, str]
Function = tuple[object, ...]
Parts = tuple[Fraction, Fraction, Fraction, Fraction]

_NOTHING: Parts = (Fraction(0), Fraction(0), Fraction(0), Fraction(0))
_ALONE = {
    "Fv": FrictionKind.VISCOUS_COULOMB,
    "Fc": FrictionKind.VISCOUS_COULOMB,
    "Fp": FrictionKind.VISCOUS_COULOMB_OFFSET,
    "offset": FrictionKind.VISCOUS_COULOMB_OFFSET,
}


@dataclass(frozen=True, slots=True)
class _Numbers:
    """Rational numbers as the carrier of a friction model."""

    @property
    def one(self) -> Fraction:
        return Fraction(1)

    def add(self, left: Fraction, right: Fraction) -> Fraction:
        return left + right

    def sub(self, left: Fraction, right: Fraction) -> Fraction:
        return left - right

    def scale(self, factor: float, value: Fraction) -> Fraction:
        return Fraction(factor) * value

    def sign(self, value: Fraction) -> Fraction:
        return Fraction((value > 0) - (value < 0))

    def absolute(self, value: Fraction) -> Fraction:
        return abs(value)


@cache
def _find_linear_parts(kind: FrictionKind) -> dict[str, Parts]:
    """Return, for each parameter, the multiples of w, |w|, sign(w) and one in its column."""
    model = FRICTION_MODELS[kind]
    carrier = cast("FrictionCarrier[Fraction]", _Numbers())
    at = {w: model.find_columns(carrier, Fraction(w)) for w in (-2, -1, 1, 2)}
    result = {}
    for k, name in enumerate(model.parameters):
        odd = [(at[w][k] - at[-w][k]) / 2 for w in (1, 2)]
        even = [(at[w][k] + at[-w][k]) / 2 for w in (1, 2)]
        linear, size = odd[1] - odd[0], even[1] - even[0]
        result[name] = (linear, size, odd[0] - linear, even[0] - size)
    return result


def _parts_of(robot: Robot, label: Label) -> Parts:
    kind = find_friction(robot, label[0]).kind
    if isinstance(kind, FrictionKind):
        return _find_linear_parts(kind)[label[1]]
    if label[1] in FRICTION_MODELS[kind].own:
        return _NOTHING
    alone = _find_linear_parts(_ALONE.get(label[1], FrictionKind.ASYMMETRIC))
    return alone["offset" if label[1] == "Fp" else label[1]]


def _find_curve(friction: FrictionValues, name: str, scale: Fraction) -> tuple[Function, Fraction]:
    """Return which odd function of w a column at the speed scale w is, and how many times.

    Values that are speeds shrink with the scale, so that equal functions have equal names.
    """
    size, sign = abs(scale), Fraction(1 if scale > 0 else -1)
    shape = dict(zip(FRICTION_MODELS[friction.kind].shape, map(Fraction, friction.shape), strict=True))
    smoothing = Fraction(friction.smoothing) / size
    if name == "Fvq":
        return ("square",), scale * size
    if name == "Fd":
        # Without smoothing the power is the same function at any scale.
        share = Fraction(float(size) ** float(shape["delta"])) if not smoothing else Fraction(1)
        return ("power", shape["delta"], smoothing, size if smoothing else 1), sign * share
    if friction.kind is CurvedFriction.MAKKAR:
        names = ("g2", "g3") if name == "Fm" else ("g5",)
        return (name, *(shape[key] * size for key in names)), sign
    if friction.kind is CurvedFriction.IMPROVED_STRIBECK:
        edge = shape["dq0"] / size
        return ("clip", edge) if name == "Fc" else ("zone", shape["vs"] / size, edge, shape["gamma"]), sign
    return ("fall", shape["vs"] / size, shape["gamma"], smoothing), sign


def _list_curved_shares(
    friction: FrictionValues, name: str, transmission: Sequence[tuple[int, Fraction]]
) -> list[tuple[Function, Fraction]]:
    """Return the functions of the speeds that a curved column consists of; a cube is expanded."""
    if name not in FRICTION_MODELS[friction.kind].own:
        return []
    if name == "Fvc":
        terms = product(transmission, repeat=3)
        return [
            (
                ("cube", tuple(sorted(position for position, _ in term))),
                Fraction(prod(factor for _, factor in term)),
            )
            for term in terms
        ]
    direction, scale = _normalise(transmission)
    function, times = _find_curve(friction, name, scale)
    return [((*function, direction), times)]


def find_constant_torques(robot: Robot) -> dict[Label, Fraction]:
    """Return the constant torque at their own drive per unit of the friction parameters that make one."""
    parts = {label: _parts_of(robot, label)[3] for label in list_friction_parameters(robot)}
    return {label: value for label, value in parts.items() if value}


def _normalise(row: Sequence[tuple[int, Fraction]]) -> tuple[tuple[tuple[int, Fraction], ...], Fraction]:
    """Return the direction of a speed with its first factor one, and that factor."""
    first = row[0][1]
    return tuple((position, factor / first) for position, factor in row), first


def find_friction_rows(robot: Robot) -> list[dict[Label, Fraction]]:
    """Return what every function of the speeds, the constant one apart, shows at every coordinate."""
    rows: dict[tuple[object, ...], dict[Label, Fraction]] = {}
    for label in list_friction_parameters(robot):
        transmission, friction = robot.transmission[label[0]], find_friction(robot, label[0])
        linear, size, sign, _ = _parts_of(robot, label)
        direction, scale = _normalise(transmission) if transmission else ((), Fraction(1))
        for position, factor in transmission:
            shares: list[tuple[tuple[object, ...], Fraction]] = [
                ((position, "size", direction), size * abs(scale)),
                ((position, "sign", direction), sign * (1 if scale > 0 else -1)),
            ]
            shares += [((position, "speed", other), linear * share) for other, share in transmission]
            shares += [
                ((position, *function), times)
                for function, times in _list_curved_shares(friction, label[1], transmission)
            ]
            for function, share in shares:
                if share:
                    row = rows.setdefault(function, {})
                    row[label] = row.get(label, Fraction(0)) + factor * share
    return list(rows.values())
