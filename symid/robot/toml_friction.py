"""The friction models of robot files: their parameters, shape values and units, and the `friction` table.

The table of a joint or coupling -> `FrictionValues`.

Supported: the models of `FrictionKind` and `CurvedFriction`; all values of a model, or none where they are
unknown; shape values, which must be known; a speed over which dry friction changes its sign. Friction that
drives the joint at a speed that it may have gets a warning.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.robot.description import CurvedFriction, FrictionKind, FrictionValues
from symid.robot.toml_values import POSITIVE, Range, Section, read_choice, read_number, read_table, to_decimal

Kind = FrictionKind | CurvedFriction

FRICTION_PARAMETERS: dict[Kind, tuple[str, ...]] = {
    FrictionKind.NONE: (),
    FrictionKind.VISCOUS_COULOMB: ("Fv", "Fc"),
    FrictionKind.VISCOUS_COULOMB_OFFSET: ("Fv", "Fc", "offset"),
    FrictionKind.ASYMMETRIC: ("Fvp", "Fcp", "Fvn", "Fcn"),
    CurvedFriction.STRIBECK: ("Fv", "Fc", "Fe"),
    CurvedFriction.STRIBECK_OFFSET: ("Fv", "Fc", "Fe", "offset"),
    CurvedFriction.IMPROVED_STRIBECK: ("Fv", "Fc", "Fe", "Fp"),
    CurvedFriction.ASYMMETRIC_STRIBECK: ("Fvp", "Fcp", "Fvn", "Fcn", "Fe"),
    CurvedFriction.CUBIC: ("Fv", "Fc", "Fvq", "Fvc"),
    CurvedFriction.STRIBECK_CUBIC: ("Fv", "Fc", "Fe", "Fvq", "Fvc"),
    CurvedFriction.POWER_LAW: ("Fc", "Fd"),
    CurvedFriction.MAKKAR: ("Fm", "Fc", "Fv"),
}
"""The parameters of each friction model, in the order of its values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeKey:
    """A shape value: its key, what kind of number it is, its range, the value where the file is silent."""

    name: str
    unit: str
    unit_prismatic: str
    allowed: Range = POSITIVE
    default: float | None = None


_VS = ShapeKey(name="vs", unit="rad/s", unit_prismatic="m/s")
_EDGE = ShapeKey(name="dq0", unit="rad/s", unit_prismatic="m/s")
_GAMMA = ShapeKey(
    name="gamma", unit="", unit_prismatic="", allowed=Range(low=0, high=10, open_low=True), default=2.0
)
_DELTA = ShapeKey(name="delta", unit="", unit_prismatic="", allowed=Range(low=0, high=10, open_low=True))
_SLOPES = tuple(ShapeKey(name=name, unit="s/rad", unit_prismatic="s/m") for name in ("g2", "g3", "g5"))

FRICTION_SHAPES: dict[Kind, tuple[ShapeKey, ...]] = {
    CurvedFriction.STRIBECK: (_VS, _GAMMA),
    CurvedFriction.STRIBECK_OFFSET: (_VS, _GAMMA),
    CurvedFriction.IMPROVED_STRIBECK: (_VS, _EDGE, _GAMMA),
    CurvedFriction.ASYMMETRIC_STRIBECK: (_VS, _GAMMA),
    CurvedFriction.STRIBECK_CUBIC: (_VS, _GAMMA),
    CurvedFriction.POWER_LAW: (_DELTA,),
    CurvedFriction.MAKKAR: _SLOPES,
}
"""The shape values of each curved model that has any, in their order."""


def name_values(friction: FrictionValues) -> dict[str, float]:
    """Return the values of a friction model by name; none where they are unknown."""
    if not friction.values:
        return {}
    return dict(zip(FRICTION_PARAMETERS[friction.kind], friction.values, strict=True))


def name_shape(friction: FrictionValues) -> dict[str, float]:
    """Return the shape values of a friction model by name; none where they are unknown."""
    keys = FRICTION_SHAPES.get(friction.kind, ())
    return {key.name: value for key, value in zip(keys, friction.shape, strict=False)}


_WITHOUT_STEP: dict[Kind, str] = {
    FrictionKind.NONE: "dry friction",
    CurvedFriction.IMPROVED_STRIBECK: "step at standstill",
    CurvedFriction.MAKKAR: "step at standstill",
}
# Of either sign; what is negative here need not push.
_SIGNED = ("offset", "Fp", "Fe", "Fvq", "Fvc")
_SLOWEST, _FASTEST, _SPEED_COUNT = 1e-9, 1e6, 1500
"""The speeds at which curves are looked at: a hundred a decade."""


def read_friction(section: Section, *, prismatic: bool) -> FrictionValues:
    """Return the friction of a joint's or coupling's table; none where it states none."""
    names = sorted({name for group in FRICTION_PARAMETERS.values() for name in group})
    shapes = {key.name: key for keys in FRICTION_SHAPES.values() for key in keys}
    table = read_table(section, "friction", ("model", *names, *shapes, "smoothing"))
    if table is None:
        return FrictionValues()
    if "model" not in table.values:
        table.refuse_key("robot.missing-key", "model", 'missing; write model = "viscous_coulomb"')
    kinds = {kind.value: kind for kind in FRICTION_PARAMETERS}
    model = read_choice(table, "model", kinds)
    smoothing = read_number(table, "smoothing", "m/s" if prismatic else "rad/s", POSITIVE)
    if model is None:
        for name in names:
            read_number(table, name, get_friction_unit(name, prismatic=prismatic))
        for key in shapes.values():
            _read_shape_value(table, key, prismatic=prismatic)
        return FrictionValues()
    kind = kinds[model]
    if kind in _WITHOUT_STEP and "smoothing" in table.values:
        text = f'has nothing to smooth: the model "{model}" has no {_WITHOUT_STEP[kind]}; leave it out'
        table.refuse_key("robot.friction-values", "smoothing", text)
    _check_names(table, kind, names)
    found = FrictionValues(
        kind=kind,
        values=_read_values(table, kind, prismatic=prismatic),
        smoothing=float(smoothing or 0),
        shape=_read_shape(table, kind, shapes, prismatic=prismatic),
    )
    limits = section.values.get("limits")
    limit = to_decimal(limits.get("velocity")) if isinstance(limits, dict) else None
    fastest = float(limit) if limit is not None and limit > 0 else math.inf
    _warn_of_driving_friction(table, found, fastest, prismatic=prismatic)
    return found


def _warn_of_driving_friction(
    table: Section, friction: FrictionValues, fastest: float, *, prismatic: bool
) -> None:
    """Remark on a curve that drives the joint although no coefficient on its own does."""
    named, shape = name_values(friction), name_shape(friction)
    known = named and len(shape) == len(FRICTION_SHAPES.get(friction.kind, ()))
    if not known or not isinstance(friction.kind, CurvedFriction):
        return
    named |= shape
    if any(value < 0.0 for name, value in named.items() if name not in _SIGNED):
        return
    speed = _locate_driving_speed(friction, named, fastest)
    if speed is None:
        return
    unit = "m/s" if prismatic else "rad/s"
    start = f"from about {speed:.2g} {unit} on" if speed > _SLOWEST else "as motion begins"
    key = next((name for name in _SIGNED[2:] if named.get(name, 0.0) < 0.0), "Fc")
    hint = "simulation refuses that"
    if friction.kind is CurvedFriction.MAKKAR:
        key, hint = "Fm", "Fc or Fv must outweigh Fm, or g2 be at least g3"
    text = f"{named[key]:g} drives the joint {start} instead of braking it; {hint}"
    table.warn("robot.negative-friction", key, text)


def _locate_driving_speed(friction: FrictionValues, named: dict[str, float], fastest: float) -> float | None:
    """Return the least speed from which friction pushes, constant torques apart; None if it never does.

    Where what it brakes with one way and the other, the least up to a speed, are together negative.
    """
    speeds = np.geomspace(_SLOWEST, max(min(fastest, _FASTEST), _SLOWEST), _SPEED_COUNT + 1)
    least = sum(np.minimum.accumulate(_compute_brake(friction, named, side, speeds)) for side in ("p", "n"))
    pushing = np.flatnonzero(least < 0.0)
    return float(speeds[pushing[0]]) if len(pushing) else None


def _compute_brake(friction: FrictionValues, named: dict[str, float], side: str, v: FloatArray) -> FloatArray:
    """Return what a curve brakes with at speeds v (N,) in the direction "p" or "n", offset and bias apart."""
    names = ("Fv", "Fc", "Fe", "Fd", "Fvq", "Fvc", "Fm")
    fv, fc, fe, fd, fvq, fvc, fm = (named.get(key, named.get(f"{key}{side}", 0.0)) for key in names)
    if friction.kind is CurvedFriction.MAKKAR:
        bump = np.tanh(named["g2"] * v) - np.tanh(named["g3"] * v)
        return fm * bump + fc * np.tanh(named["g5"] * v) + fv * v
    vs, edge, width = named.get("vs", 1.0), named.get("dq0", 0.0), friction.smoothing
    sign = np.tanh(v / width) if width else np.minimum(1.0, v / edge) if edge else 1.0
    # Beyond ten decades nothing is left of the fall.
    fall = np.exp(-(np.minimum(np.maximum(v, edge) / vs, 1e10) ** named.get("gamma", 2.0)))
    dry = fc + fe * fall + fd * v ** named.get("delta", 1.0)
    return dry * sign + fv * v + fvq * v * v + fvc * v**3


def _read_values(table: Section, kind: Kind, *, prismatic: bool) -> tuple[float, ...] | None:
    wanted = FRICTION_PARAMETERS[kind]
    given = [read_number(table, name, get_friction_unit(name, prismatic=prismatic)) for name in wanted]
    for name, value in zip(wanted, given, strict=True):
        if name not in _SIGNED and value is not None and value < 0:
            text = f"{value} drives the joint instead of braking it; friction coefficients are positive"
            table.warn("robot.negative-friction", name, text)
    values = tuple(float(value) for value in given if value is not None)
    return values if values and len(values) == len(wanted) else None


def _read_shape_value(table: Section, key: ShapeKey, *, prismatic: bool) -> float | None:
    value = read_number(table, key.name, key.unit_prismatic if prismatic else key.unit, key.allowed)
    return None if value is None else float(value)


def _read_shape(
    table: Section, kind: Kind, shapes: dict[str, ShapeKey], *, prismatic: bool
) -> tuple[float, ...]:
    """Return the shape values, all of them or none."""
    wanted = FRICTION_SHAPES.get(kind, ())
    for name in shapes:
        if name in table.values and name not in {key.name for key in wanted}:
            allowed = ", ".join(key.name for key in wanted) or "none"
            text = f'not a shape value of the model "{kind.value}"; its shape values: {allowed}'
            table.refuse_key("robot.friction-values", name, text)
    found = []
    for key in wanted:
        if key.name not in table.values and key.default is None:
            unit = key.unit_prismatic if prismatic else key.unit
            text = f'missing; the model "{kind.value}" needs it as a number{f" in {unit}" if unit else ""}'
            table.refuse_key("robot.missing-key", key.name, text)
        value = _read_shape_value(table, key, prismatic=prismatic)
        found.append(key.default if value is None else value)
    return tuple(value for value in found if value is not None) if None not in found else ()


def _check_names(table: Section, kind: Kind, names: list[str]) -> None:
    wanted = FRICTION_PARAMETERS[kind]
    for name in names:
        if name in table.values and name not in wanted:
            allowed = f"its values are {', '.join(wanted)}" if wanted else "it has no values"
            text = f'not a value of the model "{kind.value}"; {allowed}'
            table.refuse_key("robot.friction-values", name, text)
    missing = [name for name in wanted if name not in table.values]
    if missing and len(missing) < len(wanted):
        text = (
            f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are unknown"
        )
        table.refuse_key("robot.friction-values", next(name for name in wanted if name in table.values), text)


def get_friction_unit(name: str, *, prismatic: bool) -> str:
    """Return the unit of a friction parameter as robot files write it."""
    power = {"Fvq": 2, "Fvc": 3}.get(name, 1 if name.startswith("Fv") else 0)
    force = "N" if prismatic else "N*m"
    if not power:
        return force
    speed = "m" if prismatic else "rad"
    return f"{force}*s/{speed}" if power == 1 else f"{force}*s^{power}/{speed}^{power}"
