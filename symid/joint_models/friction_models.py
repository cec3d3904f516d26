"""Joint friction as robot files name it: models, parameters, columns, and what motion shows of them.

Velocity of a joint in any carrier of friction laws -> one column per parameter; the friction torque is
their sum, positive against positive velocity.
Robot -> rows of friction parameters that motion tells apart, for the base parameters: away from standstill
a column that is piecewise linear in the speed w is a sum of w, |w|, sign(w) and one; these four functions
are independent, and four speeds give their coefficients. A curved column is a function of its own,
independent of them and of those with another shape; a cube of several speeds is a sum of products.

Supported: viscous and Coulomb, with offset, asymmetric; curved models, whose shape values are constants of
the robot; sign(0) = 0, or tanh(v / v0) in place of the sign; joints, joints that follow others, couplings.
Not supported: friction that depends on load or position, or has a state.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
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
from symid.joint_models.friction_columns import compute_asymmetric_columns, compute_coulomb_viscous_columns
from symid.joint_models.friction_law import LawColumns
from symid.robot import (
    FRICTION_PARAMETERS,
    FRICTION_SHAPES,
    CurvedFriction,
    FrictionKind,
    FrictionValues,
    Robot,
)

V = TypeVar("V")
_FALL = "Fe exp(-|dq/vs|^gamma)"
Kind = FrictionKind | CurvedFriction


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionModel:
    """A friction model of robot files.

    Args:
        kind: its name, which says parameters and shape values too.
        build: from the exponent gamma, where the model has one, the columns of its law.
        own: parameters whose columns are no sum of v, |v|, sign(v) and one.
    """

    kind: Kind
    build: Callable[[float], LawColumns]  # type: ignore[type-arg]
    formula: str
    own: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of its parameters (see `notation`), one a column."""
        return FRICTION_PARAMETERS[self.kind]

    @property
    def shape(self) -> tuple[str, ...]:
        """Return the names of the constants of the robot, gamma last where the model has one."""
        return tuple(key.name for key in FRICTION_SHAPES.get(self.kind, ()))

    def find_columns(self, carrier: Carrier[V], velocity: V, shape: tuple[float, ...] = ()) -> tuple[V, ...]:
        """Return one column per parameter at `velocity`, for the values of `shape`."""
        named = dict(zip(self.shape, shape, strict=True))
        exponent = named.pop("gamma", 2.0)
        values = [carrier.scale(value, carrier.one) for value in named.values()]
        return self.build(exponent)(carrier, {"velocity": velocity}, values)


def compute_friction_columns(friction: FrictionValues, algebra: Carrier[V], velocity: V) -> tuple[V, ...]:
    """Return one column per parameter of a joint's friction model, at `velocity` (rad/s or m/s)."""
    carrier = smooth(algebra, friction.smoothing) if friction.smoothing > 0.0 else algebra
    return FRICTION_MODELS[friction.kind].find_columns(carrier, velocity, friction.shape)


def _compute_no_columns(_carrier: Carrier[V], _inputs: Mapping[str, V], _shape: object) -> tuple[V, ...]:
    return ()


_ROWS: tuple[tuple[Kind, Callable[[float], LawColumns], str, tuple[str, ...]], ...] = (  # type: ignore[type-arg]
    (FrictionKind.NONE, lambda _gamma: _compute_no_columns, "0", ()),
    (FrictionKind.VISCOUS_COULOMB, lambda _gamma: compute_coulomb_viscous_columns, "Fv dq + Fc sign(dq)", ()),
    (
        FrictionKind.VISCOUS_COULOMB_OFFSET,
        lambda _gamma: FRICTION_LAWS["coulomb-viscous-offset"].columns,
        "Fv dq + Fc sign(dq) + offset",
        (),
    ),
    (
        FrictionKind.ASYMMETRIC,
        lambda _gamma: compute_asymmetric_columns,
        "Fvp dq + Fcp for dq > 0, Fvn dq - Fcn for dq < 0",
        (),
    ),
    (
        CurvedFriction.STRIBECK,
        lambda gamma: build_stribeck(exponent=gamma).columns,
        f"Fv dq + [Fc + {_FALL}] sign(dq)",
        ("Fe",),
    ),
    (
        CurvedFriction.STRIBECK_OFFSET,
        lambda gamma: with_offset(build_stribeck(exponent=gamma)).columns,
        f"Fv dq + [Fc + {_FALL}] sign(dq) + offset",
        ("Fe",),
    ),
    (
        CurvedFriction.IMPROVED_STRIBECK,
        lambda gamma: build_improved(exponent=gamma).columns,
        "Fv dq + [Fc + Fe exp(-(max(|dq|, dq0)/vs)^gamma)] clip(dq/dq0, -1, 1) + Fp",
        ("Fc", "Fe"),
    ),
    (
        CurvedFriction.ASYMMETRIC_STRIBECK,
        lambda gamma: build_asymmetric_stribeck(exponent=gamma).columns,
        f"Fvp dq + Fcp for dq > 0, Fvn dq - Fcn for dq < 0, + {_FALL} sign(dq)",
        ("Fe",),
    ),
    (
        CurvedFriction.CUBIC,
        lambda _gamma: FRICTION_LAWS["cubic"].columns,
        "Fv dq + Fc sign(dq) + Fvq |dq| dq + Fvc dq^3",
        ("Fvq", "Fvc"),
    ),
    (
        CurvedFriction.STRIBECK_CUBIC,
        lambda gamma: build_stribeck(exponent=gamma, orders=(2, 3)).columns,
        f"Fv dq + [Fc + {_FALL}] sign(dq) + Fvq |dq| dq + Fvc dq^3",
        ("Fe", "Fvq", "Fvc"),
    ),
    (
        CurvedFriction.POWER_LAW,
        lambda _gamma: FRICTION_LAWS["power-law"].columns,
        "[Fc + Fd |dq|^delta] sign(dq)",
        ("Fd",),
    ),
    (
        CurvedFriction.MAKKAR,
        lambda _gamma: FRICTION_LAWS["makkar"].columns,
        "Fm [tanh(g2 dq) - tanh(g3 dq)] + Fc tanh(g5 dq) + Fv dq",
        ("Fm", "Fc"),
    ),
)

FRICTION_MODELS: dict[Kind, FrictionModel] = {
    kind: FrictionModel(kind=kind, build=build, formula=formula, own=own)
    for kind, build, formula, own in _ROWS
}


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
Parts = tuple[Fraction, Fraction, Fraction, Fraction]

_NOTHING: Parts = (Fraction(0), Fraction(0), Fraction(0), Fraction(0))
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
    model = FRICTION_MODELS[kind]
    at = {w: model.find_columns(_EXACT, Fraction(w)) for w in (-2, -1, 1, 2)}
    result = {}
    for k, name in enumerate(model.parameters):
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
        return _NOTHING
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
    direction, scale = _normalise_speed(transmission)
    function, times = _describe_curve(friction, name, scale)
    return [((*function, direction), times)]


def compute_constant_torques(robot: Robot) -> dict[Label, Fraction]:
    """Return the constant torque at their own drive per unit of the friction parameters that make one."""
    parts = {label: _get_linear_parts(robot, label)[3] for label in list_friction_parameters(robot)}
    return {label: value for label, value in parts.items() if value}


def _normalise_speed(
    row: Sequence[tuple[int, Fraction]],
) -> tuple[tuple[tuple[int, Fraction], ...], Fraction]:
    """Return the direction of a speed with its first factor one, and that factor."""
    first = row[0][1]
    return tuple((position, factor / first) for position, factor in row), first


def build_friction_rows(robot: Robot) -> list[dict[Label, Fraction]]:
    """Return what every function of the speeds, the constant one apart, shows at every coordinate."""
    rows: dict[tuple[object, ...], dict[Label, Fraction]] = {}
    for label in list_friction_parameters(robot):
        transmission, friction = robot.transmission[label[0]], get_friction(robot, label[0])
        linear, size, sign, _ = _get_linear_parts(robot, label)
        direction, scale = _normalise_speed(transmission) if transmission else ((), Fraction(1))
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
