"""Joint friction as robot files name it: models, parameters, columns, and which of them motion separates.

Robot -> rows of friction parameters, for the base parameters: away from standstill a column that is
piecewise linear in the speed w is a sum of w, |w|, sign(w) and one; these four functions are independent,
and four speeds give their coefficients. A curved column is a function of its own, independent of them and
of those with another shape; a cube of several speeds is a sum of products.

Supported: viscous and Coulomb, with offset, asymmetric; curved models with constant shape values; sign(0)
is 0, or tanh(v / v0) replaces the sign; joints, joints that follow others, couplings.
Not supported: friction that depends on load or position, or has a state.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from itertools import product
from math import prod
from typing import TypeVar

from symid.joint_models.carriers import Carrier, OperatorCarrier, smooth
from symid.joint_models.friction_catalogue import (
    FRICTION_LAWS,
    build_asymmetric_stribeck,
    build_improved,
    build_stribeck,
    with_offset,
)
from symid.joint_models.friction_law import FrictionLaw
from symid.robot import (
    FRICTION_PARAMETERS,
    FRICTION_SHAPES,
    CurvedFriction,
    FrictionKind,
    FrictionValues,
    Robot,
)

V = TypeVar("V")
Kind = FrictionKind | CurvedFriction


@dataclass(frozen=True, slots=True)
class FrictionModel:
    """A friction model of robot files.

    Args:
        kind: its name, the key of its parameters and shape values.
        law: by name, or built from its exponent gamma; empty for no friction.
        own: parameters whose columns are no sum of v, |v|, sign(v) and one.
    """

    kind: Kind
    law: str | Callable[..., FrictionLaw]
    own: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of its parameters (see `notation`), one a column."""
        return FRICTION_PARAMETERS[self.kind]

    @property
    def shape(self) -> tuple[str, ...]:
        """Return the names of the constants of the robot, gamma last where the model has one."""
        return tuple(key.name for key in FRICTION_SHAPES.get(self.kind, ()))


def _build_stribeck_offset(exponent: float) -> FrictionLaw:
    return with_offset(build_stribeck(exponent=exponent))


FRICTION_MODELS: dict[Kind, FrictionModel] = {
    model.kind: model
    for model in (
        FrictionModel(FrictionKind.NONE, ""),
        FrictionModel(FrictionKind.VISCOUS_COULOMB, "coulomb-viscous"),
        FrictionModel(FrictionKind.VISCOUS_COULOMB_OFFSET, "coulomb-viscous-offset"),
        FrictionModel(FrictionKind.ASYMMETRIC, "asymmetric"),
        FrictionModel(CurvedFriction.STRIBECK, build_stribeck, ("Fe",)),
        FrictionModel(CurvedFriction.STRIBECK_OFFSET, _build_stribeck_offset, ("Fe",)),
        FrictionModel(CurvedFriction.IMPROVED_STRIBECK, build_improved, ("Fc", "Fe")),
        FrictionModel(CurvedFriction.ASYMMETRIC_STRIBECK, build_asymmetric_stribeck, ("Fe",)),
        FrictionModel(CurvedFriction.CUBIC, "cubic", ("Fvq", "Fvc")),
        FrictionModel(
            CurvedFriction.STRIBECK_CUBIC, partial(build_stribeck, orders=(2, 3)), ("Fe", "Fvq", "Fvc")
        ),
        FrictionModel(CurvedFriction.POWER_LAW, "power-law", ("Fd",)),
        FrictionModel(CurvedFriction.MAKKAR, "makkar", ("Fm", "Fc")),
    )
}


def compute_friction_columns(friction: FrictionValues, algebra: Carrier[V], velocity: V) -> tuple[V, ...]:
    """Return one column per parameter of a joint's friction model, at `velocity` (rad/s or m/s)."""
    model = FRICTION_MODELS[friction.kind]
    if not model.law:
        return ()
    carrier = smooth(algebra, friction.smoothing) if friction.smoothing > 0.0 else algebra
    named = dict(zip(model.shape, friction.shape, strict=True))
    exponent = named.pop("gamma", 2.0)
    law = FRICTION_LAWS[model.law] if isinstance(model.law, str) else model.law(exponent=exponent)
    values = [carrier.scale(value, carrier.one) for value in named.values()]
    return law.columns(carrier, {"velocity": velocity}, values)


def get_friction(robot: Robot, index: int) -> FrictionValues:
    """Return the friction of a joint, or of a coupling (numbered behind the joints)."""
    return (
        robot.joints[index].friction if index < robot.size else robot.couplings[index - robot.size].friction
    )


def list_friction_parameters(robot: Robot) -> tuple[tuple[int, str], ...]:
    """Return the labels of all friction parameters: joints first, then couplings."""
    indices = range(robot.size + len(robot.couplings))
    return tuple(
        (index, name)
        for index in indices
        for name in FRICTION_MODELS[get_friction(robot, index).kind].parameters
    )


Label = tuple[int, str]
Function = tuple[object, ...]
Speed = Sequence[tuple[int, Fraction]]
Parts = tuple[Fraction, Fraction, Fraction, Fraction]

_ALONE = {
    "Fv": FrictionKind.VISCOUS_COULOMB,
    "Fc": FrictionKind.VISCOUS_COULOMB,
    "Fp": FrictionKind.VISCOUS_COULOMB_OFFSET,
    "offset": FrictionKind.VISCOUS_COULOMB_OFFSET,
}
_EXACT: OperatorCarrier[Fraction] = OperatorCarrier(
    zero=Fraction(0),
    one=Fraction(1),
    scale=lambda factor, value: Fraction(factor) * value,
    sign=lambda value: Fraction((value > 0) - (value < 0)),
)


@cache
def _compute_linear_parts(kind: FrictionKind) -> dict[str, Parts]:
    """Return, for each parameter, the multiples of w, |w|, sign(w) and one in its column."""
    friction = FrictionValues(kind=kind)
    at = {w: compute_friction_columns(friction, _EXACT, Fraction(w)) for w in (-2, -1, 1, 2)}
    result = {}
    for k, name in enumerate(FRICTION_PARAMETERS[kind]):
        odd = [(at[w][k] - at[-w][k]) / 2 for w in (1, 2)]
        even = [(at[w][k] + at[-w][k]) / 2 for w in (1, 2)]
        linear, size = odd[1] - odd[0], even[1] - even[0]
        result[name] = (linear, size, odd[0] - linear, even[0] - size)
    return result


def _get_linear_parts(robot: Robot, label: Label) -> Parts:
    kind = get_friction(robot, label[0]).kind
    if isinstance(kind, FrictionKind):
        return _compute_linear_parts(kind)[label[1]]
    if label[1] in FRICTION_MODELS[kind].own:
        return (Fraction(0),) * 4
    alone = _compute_linear_parts(_ALONE.get(label[1], FrictionKind.ASYMMETRIC))
    return alone["offset" if label[1] == "Fp" else label[1]]


def _describe_curve(friction: FrictionValues, name: str, scale: Fraction) -> tuple[Function, Fraction]:
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
    friction: FrictionValues, name: str, transmission: Speed, direction: Speed, scale: Fraction
) -> list[tuple[Function, Fraction]]:
    """Return the functions of the speeds that a curved column consists of; a cube is expanded."""
    if name not in FRICTION_MODELS[friction.kind].own:
        return []
    if name != "Fvc":
        function, times = _describe_curve(friction, name, scale)
        return [((*function, direction), times)]
    shares: list[tuple[Function, Fraction]] = []
    for term in product(transmission, repeat=3):
        places = tuple(sorted(position for position, _ in term))
        shares.append((("cube", places), Fraction(prod(factor for _, factor in term))))
    return shares


def compute_constant_torques(robot: Robot) -> dict[Label, Fraction]:
    """Return the constant torque at their own drive per unit of the friction parameters that make one."""
    parts = {label: _get_linear_parts(robot, label)[3] for label in list_friction_parameters(robot)}
    return {label: value for label, value in parts.items() if value}


def build_friction_rows(robot: Robot) -> list[dict[Label, Fraction]]:
    """Return what every function of the speeds, the constant one apart, shows at every coordinate."""
    rows: dict[tuple[object, ...], dict[Label, Fraction]] = {}
    for label in list_friction_parameters(robot):
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
