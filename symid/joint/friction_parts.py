"""What friction parameters are made of: multiples of w, |w|, sign(w) and one.

Input: a friction model. Output: these four coefficients for each parameter, and rows of parameters that
motion shows apart from each other.

Away from standstill every model that is linear in its parameters and piecewise linear in the speed w is such
a sum; the four functions are independent, and four speeds tell them.

Supported: joints, joints that follow others, couplings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from symid.joint.friction import FRICTION_MODELS, find_friction, list_friction_parameters
from symid.robot.description import FrictionKind, Robot

__all__ = ["find_constant_torques", "find_friction_rows"]

Label = tuple[int, str]
Parts = tuple[Fraction, Fraction, Fraction, Fraction]


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

    def half(self, value: Fraction) -> Fraction:
        return value / 2

    def sign(self, value: Fraction) -> Fraction:
        return Fraction((value > 0) - (value < 0))

    def absolute(self, value: Fraction) -> Fraction:
        return abs(value)


def _find_parts(kind: FrictionKind) -> dict[str, Parts]:
    """Return, for each parameter, the multiples of w, |w|, sign(w) and one in its column."""
    model = FRICTION_MODELS[kind]
    at = {w: model.columns(_Numbers(), Fraction(w)) for w in (-2, -1, 1, 2)}
    result = {}
    for k, name in enumerate(model.parameters):
        odd = [(at[w][k] - at[-w][k]) / 2 for w in (1, 2)]
        even = [(at[w][k] + at[-w][k]) / 2 for w in (1, 2)]
        linear, size = odd[1] - odd[0], even[1] - even[0]
        result[name] = (linear, size, odd[0] - linear, even[0] - size)
    return result


def _parts_of(robot: Robot, label: Label) -> Parts:
    return _find_parts(find_friction(robot, label[0]).kind)[label[1]]


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
        transmission = robot.transmission[label[0]]
        linear, size, sign, _ = _parts_of(robot, label)
        direction, scale = _normalise(transmission) if transmission else ((), Fraction(1))
        for position, factor in transmission:
            shares: list[tuple[tuple[object, ...], Fraction]] = [
                ((position, "size", direction), size * abs(scale)),
                ((position, "sign", direction), sign * (1 if scale > 0 else -1)),
            ]
            shares += [((position, "speed", other), linear * share) for other, share in transmission]
            for function, share in shares:
                if share:
                    row = rows.setdefault(function, {})
                    row[label] = row.get(label, Fraction(0)) + factor * share
    return list(rows.values())
