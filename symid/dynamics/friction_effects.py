"""Friction parameters of a robot: which there are, their columns, and which of them motion separates.

Robot -> rows of friction parameters, for the base parameters: away from standstill a column that is
piecewise linear in the speed w is a sum of w, |w|, sign(w) and one; these four functions are independent,
and four speeds give their coefficients. A curved column, or one that depends on load, position or
temperature, is a function of its own, independent of them and of those with another shape; a cube of
several speeds is a sum of products. Torques that depend on the position alone, constant ones and waves, are
like those of springs, and are left to the weights.

Supported: every static law with constant shape values; sign(0) is 0, or tanh(v / v0) replaces the sign;
joints, joints that follow others, couplings.
Not supported: friction that has a state.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from typing import NamedTuple, TypeVar

from symid import joint_models
from symid.robot import Coupling, Joint, JointKind, Robot

V = TypeVar("V")
_ORDERS = {"Fvq": 2}
_SIDES = {"Fep": 1, "Fen": -1}
Label = tuple[int, str]
Function = tuple[object, ...]
Speed = Sequence[tuple[int, Fraction]]
Parts = tuple[Fraction, Fraction, Fraction, Fraction]

_PLAIN_LAWS = ("coulomb-viscous-offset", "asymmetric")
_EXACT: joint_models.OperatorCarrier[Fraction] = joint_models.OperatorCarrier(
    zero=Fraction(0),
    one=Fraction(1),
    scale=lambda factor, value: Fraction(factor) * value,
    sign=lambda value: Fraction((value > 0) - (value < 0)),
)


def compute_friction_columns(
    friction: joint_models.FrictionValues, carrier: joint_models.Carrier[V], inputs: Mapping[str, V]
) -> tuple[V, ...]:
    """Return one column per linear parameter of a joint's friction, whose shape values are known.

    `inputs`: velocity (rad/s or m/s) and the other inputs of the law.
    """
    law = joint_models.get_friction_law(friction)
    if law is None:
        return ()
    return law.columns(carrier, inputs, [carrier.scale(value, carrier.one) for value in friction.shape])


def get_friction(robot: Robot, index: int) -> joint_models.FrictionValues:
    """Return the friction of a joint, or of a coupling (numbered behind the joints)."""
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    return owners[index].friction


def list_friction_parameters(robot: Robot) -> tuple[tuple[int, str], ...]:
    """Return the labels of all friction parameters: joints first, then couplings."""
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    names = ((k, joint_models.list_value_names(owner.friction)) for k, owner in enumerate(owners))
    return tuple((index, name) for index, found in names for name in found)


@cache
def _compute_linear_parts() -> dict[str, Parts]:
    """Return, for each plain parameter, the multiples of w, |w|, sign(w) and one in its column."""
    result = {}
    for law in map(joint_models.get_law, _PLAIN_LAWS):
        at = {w: law.columns(_EXACT, {"velocity": Fraction(w)}, ()) for w in (-2, -1, 1, 2)}
        for k, entry in enumerate(law.linear):
            odd = [(at[w][k] - at[-w][k]) / 2 for w in (1, 2)]
            even = [(at[w][k] + at[-w][k]) / 2 for w in (1, 2)]
            linear, size = odd[1] - odd[0], even[1] - even[0]
            result[entry.name] = (linear, size, odd[0] - linear, even[0] - size)
    return result


def _get_linear_parts(robot: Robot, label: Label) -> Parts:
    law = joint_models.get_friction_law(get_friction(robot, label[0]))
    if law is None or label[1] in law.own:
        return (Fraction(0),) * 4
    # The constant torque of the improved laws.
    parts = _compute_linear_parts()["offset" if label[1] == "Fp" else label[1]]
    named = joint_models.name_shape(get_friction(robot, label[0]))
    # A curve whose origin is shifted has dq - dq0 in place of dq.
    return (*parts[:3], -Fraction(named["dqs"])) if "dqs" in named and label[1] == "Fv" else parts


def _describe_curve(
    law: joint_models.FrictionLaw, friction: joint_models.FrictionValues, name: str, scale: Fraction
) -> tuple[Function, Fraction]:
    """Return which odd function of w a column at the speed scale w is, and how many times."""
    size, sign = abs(scale), Fraction(1 if scale > 0 else -1)
    # Shape values that are speeds shrink with the scale, so that equal functions have equal values.
    shape: dict[str, object] = {entry.name: "unknown" for entry in law.shape}
    for entry, value in zip(law.shape if friction.shape else (), friction.shape, strict=True):
        shape[entry.name] = Fraction(value) * size ** {"rad/s": -1, "s/rad": 1}.get(entry.unit, 0)
    smoothing = Fraction(friction.smoothing) / size
    for wave in law.waves:
        if wave.name == name:
            even = wave.sine == wave.dry
            speed = smoothing if wave.dry else None
            return ("wave", wave.frequency * size, wave.sine, speed), Fraction(1) if even else sign
    if name in _ORDERS or (name[:2] == "Fv" and name[2:].isdigit()):
        order = _ORDERS.get(name) or int(name[2:])
        return ("power", order), scale * size ** (order - 1)
    if name == "Fd":
        # Without smoothing the power is the same function at any scale.
        known = not smoothing and friction.shape
        share = Fraction(float(size) ** friction.shape[0]) if known else Fraction(1)
        return ("power", shape["delta"], smoothing, 1 if known else size), sign * share
    if "g2" in shape:
        names = ("g2", "g3") if name == "Fm" else ("g5",)
        return (name, *(shape[key] for key in names)), sign
    if "dq0" in shape and name == "Fc":
        return ("clip", shape["dq0"]), sign
    gamma = shape.get("gamma", law.exponent)
    if "dqs" in shape:
        # A step, or a fall, away from standstill.
        start = Fraction(friction.shape[1]) / scale if friction.shape else "unknown"
        return (name, start, *((shape["vs"], gamma) if name == "Fe" else ()), smoothing), sign
    if name == "Fp":
        return ("tent", shape["dq0"]), Fraction(1)
    if "load" in law.inputs or name not in (*_SIDES, "Fe"):
        # Functions of load, position or temperature, and rare ones, are those of their law.
        return (law.name, name, *shape.values(), smoothing, size), sign
    side = _SIDES.get(name, 0) * sign
    return ("fall", side, shape["vs"], gamma or "lorentzian", shape.get("dq0", smoothing)), sign


def _list_curved_shares(
    friction: joint_models.FrictionValues, name: str, transmission: Speed, direction: Speed, scale: Fraction
) -> list[tuple[Function, Fraction]]:
    """Return the functions of the speeds that a curved column consists of; a cube is expanded."""
    law = joint_models.get_friction_law(friction)
    if law is None or name not in law.own:
        return []
    if name != "Fvc":
        function, times = _describe_curve(law, friction, name, scale)
        if function[:2] == ("fall", 0):
            # A fall of both directions is the sum of one a direction.
            return [(("fall", side, *function[2:], direction), times) for side in _SIDES.values()]
        return [((*function, direction), times)]
    shares: list[tuple[Function, Fraction]] = []
    for term in product(transmission, repeat=3):
        places = tuple(sorted(position for position, _ in term))
        shares.append((("cube", places), Fraction(math.prod(factor for _, factor in term))))
    return shares


class PositionTorque(NamedTuple):
    """Torque `factor` cos(w u), sin(w u) where `sine`, at the position u of a drive; a constant for w = 0."""

    factor: Fraction
    frequency: Fraction = Fraction(0)
    sine: bool = False


def compute_position_torques(robot: Robot) -> dict[Label, PositionTorque]:
    """Return the torques at their own drive, a unit of their parameter, that depend on the position alone.

    Waves are among them where they could balance a weight: whole numbers of them a turn of what they move.
    """
    found = {}
    for label in list_friction_parameters(robot):
        if constant := _get_linear_parts(robot, label)[3]:
            found[label] = PositionTorque(constant)
        law = joint_models.get_friction_law(get_friction(robot, label[0]))
        for wave in () if law is None else law.waves:
            if wave.name == label[1] and not wave.dry and _balances_weight(robot, label[0], wave.frequency):
                found[label] = PositionTorque(Fraction(1), wave.frequency, wave.sine)
    return found


def _balances_weight(robot: Robot, index: int, frequency: Fraction) -> bool:
    """Return whether a wave at a drive is one of the functions that weights are made of."""
    for position, factor in robot.transmission[index]:
        others = [
            (joint, row[0][1])
            for joint, row in zip(robot.joints, robot.transmission, strict=False)
            if row[0][0] == position
        ]
        # Of joints on one coordinate, weights have sums and differences of their angles.
        unit = math.lcm(*(multiplier.denominator for _, multiplier in others))
        revolute = any(joint.kind is JointKind.REVOLUTE for joint, _ in others)
        if not revolute or (frequency * factor * unit).denominator != 1:
            return False
    return bool(robot.transmission[index])


def build_friction_rows(robot: Robot) -> list[dict[Label, Fraction]]:
    """Return what every function of the speeds, torques of positions apart, shows at every coordinate."""
    rows: dict[tuple[object, ...], dict[Label, Fraction]] = {}
    waves = {label for label, torque in compute_position_torques(robot).items() if torque.frequency}
    for label in list_friction_parameters(robot):
        if label in waves:
            continue
        transmission, friction = robot.transmission[label[0]], get_friction(robot, label[0])
        linear, size, sign, _ = _get_linear_parts(robot, label)
        # The direction of a speed has one as its first factor.
        scale = transmission[0][1] if transmission else Fraction(1)
        direction = tuple((position, factor / scale) for position, factor in transmission)
        for position, factor in transmission:
            shares: list[tuple[tuple[object, ...], Fraction]] = [
                ((position, "size", direction), size * abs(scale)),
                ((position, "sign", direction), sign * (1 if scale > 0 else -1)),
            ]
            shares += [((position, "speed", other), linear * share) for other, share in transmission]
            shares += [
                ((position, *function), times)
                for function, times in _list_curved_shares(friction, label[1], transmission, direction, scale)
            ]
            for function, share in shares:
                if share:
                    row = rows.setdefault(function, {})
                    row[label] = row.get(label, Fraction(0)) + factor * share
    return list(rows.values())
