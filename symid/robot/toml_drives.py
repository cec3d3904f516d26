"""The tables of a joint that moves: `drive`, `friction`, `limits`, `spring`, `elasticity`; `[[coupling]]`.

Supported: rotor inertias on either side of the gear; the models of `FrictionKind` and `CurvedFriction`, with
all values or none where they are unknown, and a speed over which dry friction changes its sign; elastic
joints with stiffness, damping, a cubic part, stops, knees on both sides or written for one and mirrored,
catalogue values of harmonic drives; stiffnesses and rotor inertias that are "unknown", to be identified.
Not supported: springs at a joint that are not linear; unknown shape values, thresholds and knees; a cubic
part together with knees.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.errors import RobotError
from symid.notation import adapt_unit, get_unit
from symid.robot.description import (
    Coupling,
    CurvedFriction,
    Drive,
    FrictionKind,
    FrictionValues,
    Joint,
    JointKind,
    Limits,
    Spring,
)
from symid.robot.elasticity import Elasticity, Knee, Stop, compute_catalogue_knees
from symid.robot.exact_values import read_fraction
from symid.robot.toml_values import NOT_NEGATIVE, POSITIVE, Range, Section, explain_wide_limits, suggest_names

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
    """A shape value: its key, its unit at a joint that turns, its range, its default where it has one."""

    name: str
    unit: str
    allowed: Range = POSITIVE
    default: float | None = None


_EXPONENT = Range(low=0, high=10, open_low=True)
_VS, _EDGE = ShapeKey(name="vs", unit="rad/s"), ShapeKey(name="dq0", unit="rad/s")
_GAMMA = ShapeKey(name="gamma", unit="", allowed=_EXPONENT, default=2.0)

FRICTION_SHAPES: dict[Kind, tuple[ShapeKey, ...]] = {
    CurvedFriction.STRIBECK: (_VS, _GAMMA),
    CurvedFriction.STRIBECK_OFFSET: (_VS, _GAMMA),
    CurvedFriction.IMPROVED_STRIBECK: (_VS, _EDGE, _GAMMA),
    CurvedFriction.ASYMMETRIC_STRIBECK: (_VS, _GAMMA),
    CurvedFriction.STRIBECK_CUBIC: (_VS, _GAMMA),
    CurvedFriction.POWER_LAW: (ShapeKey(name="delta", unit="", allowed=_EXPONENT),),
    CurvedFriction.MAKKAR: tuple(ShapeKey(name=name, unit="s/rad") for name in ("g2", "g3", "g5")),
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
# The speeds at which curves are evaluated: a hundred a decade.
_SLOWEST, _FASTEST, _SPEED_COUNT = 1e-9, 1e6, 1500


def _read_friction(section: Section, fastest: float = math.inf) -> FrictionValues:
    """Return the friction of a joint's or coupling's table, up to the speed `fastest`; none without one."""
    names = sorted({name for group in FRICTION_PARAMETERS.values() for name in group})
    shapes = {key.name: key for keys in FRICTION_SHAPES.values() for key in keys}
    table = section.read_table("friction", ("model", *names, *shapes, "smoothing"))
    if table is None:
        return FrictionValues()
    table.require("model", 'write model = "viscous_coulomb"')
    kinds = {kind.value: kind for kind in FRICTION_PARAMETERS}
    model = table.read_choice("model", kinds)
    smoothing = table.read_float("smoothing", "rad/s", POSITIVE)
    kind = kinds[model] if model else None
    wanted = names if kind is None else FRICTION_PARAMETERS[kind]
    keys = tuple(shapes.values()) if kind is None else FRICTION_SHAPES.get(kind, ())
    given = {name: table.read_float(name, get_unit(name).replace(" ", "*")) for name in wanted}
    shape = {key.name: table.read_float(key.name, key.unit, key.allowed) for key in keys}
    if kind is None:
        return FrictionValues()
    _check_keys(table, kind, (*names, *shapes), keys)
    for name, value in given.items():
        if name not in _SIGNED and value is not None and value < 0:
            text = f"{table.show(name)} drives the joint instead of braking it; write a positive coefficient"
            table.warn("robot.negative-friction", name, text)
    values = tuple(value for value in given.values() if value is not None)
    filled = [key.default if (value := shape[key.name]) is None else value for key in keys]
    found = FrictionValues(
        kind=kind,
        values=values if values and len(values) == len(wanted) else None,
        smoothing=smoothing or 0.0,
        shape=tuple(value for value in filled if value is not None) if None not in filled else (),
    )
    _warn_of_driving_friction(table, found, fastest)
    return found


def _check_keys(table: Section, kind: Kind, names: tuple[str, ...], keys: tuple[ShapeKey, ...]) -> None:
    """Refuse values that the model does not have, and a part of its values in place of all."""
    wanted, shape = FRICTION_PARAMETERS[kind], tuple(key.name for key in keys)
    code = "robot.friction-values"
    if kind in _WITHOUT_STEP and "smoothing" in table.values:
        text = f'has nothing to smooth: the model "{kind.value}" has no {_WITHOUT_STEP[kind]}; leave it out'
        table.refuse_key(code, "smoothing", text)
    for name in names:
        if name in table.values and name not in (*wanted, *shape):
            listed = f"its values are {', '.join(wanted)}" if wanted else "it has no values"
            listed += f", its shape values {', '.join(shape)}" if shape else ""
            table.refuse_key(code, name, f'not a value of the model "{kind.value}"; {listed}')
    missing = [name for name in wanted if name not in table.values]
    if missing and len(missing) < len(wanted):
        text = (
            f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are unknown"
        )
        table.refuse_key(code, next(name for name in wanted if name in table.values), text)
    for key in keys:
        if key.default is None:
            unit = adapt_unit(key.unit, prismatic=table.prismatic)
            in_unit = f" in {unit}" if unit else ""
            table.require(key.name, f'the model "{kind.value}" needs it as a number{in_unit}')


def _warn_of_driving_friction(table: Section, friction: FrictionValues, fastest: float) -> None:
    """Warn of a curve that drives the joint although no coefficient on its own does.

    It does where its least braking torques up to a speed, one way and the other, have a negative sum.
    """
    named, shape = name_values(friction), name_shape(friction)
    known = named and len(shape) == len(FRICTION_SHAPES.get(friction.kind, ()))
    if not known or not isinstance(friction.kind, CurvedFriction):
        return
    named |= shape
    if any(value < 0.0 for name, value in named.items() if name not in _SIGNED):
        return
    speeds = np.geomspace(_SLOWEST, max(min(fastest, _FASTEST), _SLOWEST), _SPEED_COUNT + 1)
    least = sum(np.minimum.accumulate(_compute_brake(friction, named, side, speeds)) for side in ("p", "n"))
    pushing = np.flatnonzero(least < 0.0)
    if not len(pushing):
        return
    speed, unit = float(speeds[pushing[0]]), adapt_unit("rad/s", prismatic=table.prismatic)
    start = f"from about {speed:.2g} {unit} on" if speed > _SLOWEST else "as motion begins"
    key = next((name for name in _SIGNED[2:] if named.get(name, 0.0) < 0.0), "Fc")
    hint = "simulation refuses that"
    if friction.kind is CurvedFriction.MAKKAR:
        key, hint = "Fm", "Fc or Fv must outweigh Fm, or g2 be at least g3"
    text = f"{named[key]:g} drives the joint {start} instead of braking it; {hint}"
    table.warn("robot.negative-friction", key, text)


def _compute_brake(
    friction: FrictionValues, named: Mapping[str, float], side: str, v: FloatArray
) -> FloatArray:
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


UNKNOWN = "unknown"
"""The text in place of a number that is to be identified."""

_STIFFNESS = "N*m/rad"
MOVING_KEYS = ("drive", "friction", "spring", "elasticity", "limits")


def complete_joint(section: Section, joint: Joint, *, fixed: bool) -> Joint:
    """Return the joint with what its table says of its motion, which a `fixed` joint does not have."""
    if not fixed:
        limits = _read_limits(section)
        return replace(
            joint,
            drive=_read_drive(section),
            friction=_read_friction(section, limits.velocity or math.inf),
            limits=limits,
            spring=_read_spring(section),
            elasticity=_read_elasticity(section),
        )
    for key in MOVING_KEYS:
        if key in section.values:
            text = "a fixed joint has none; leave it out, or choose a kind that moves"
            section.refuse_key("robot.fixed-joint", key, text)
    return joint


def _read_limits(section: Section) -> Limits:
    rates = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "N*m"}
    table = section.read_table("limits", ("position", *rates))
    if table is None:
        return Limits()
    found = table.read_numbers("position", "rad", 2)
    position = None if found is None else (float(found[0]), float(found[1]))
    if found and found[0] >= found[1]:
        text = f"the lower limit {found[0]} must be less than the upper limit {found[1]}"
        table.refuse("robot.out-of-range", "position", text)
    elif position and not table.prismatic and (doubt := explain_wide_limits(*position)):
        table.warn("robot.large-angle", "position", doubt)
    if section.get("kind") == "continuous" and "position" in table.values:
        text = 'a continuous joint has none; leave them out, or write kind = "revolute"'
        table.refuse_key("robot.continuous-limits", "position", text)
    others = {key: table.read_float(key, unit, POSITIVE) for key, unit in rates.items()}
    return Limits(position=position, **others)


def _read_drive(section: Section) -> Drive:
    """Return the `drive` table of a joint; motors turn, whatever the joint does."""
    drive = section.read_table("drive", ("gear", "rotor_inertia", "rotor_inertia_side", "torque_constant"))
    if drive is None:
        return Drive()
    # The joint's own label is enough: the keys of a drive stand nowhere else.
    drive = replace(drive, label=section.label, prismatic=False)
    gear = drive.read_float("gear", "")
    if gear == 0:
        text = "must not be 0; it is the number of motor turns per joint turn"
        drive.refuse("robot.out-of-range", "gear", text)
    side = drive.read_choice("rotor_inertia_side", ("motor", "joint"))
    has_rotor = "rotor_inertia" in drive.values
    inertia = drive.read_float("rotor_inertia", "kg*m^2", NOT_NEGATIVE, word=UNKNOWN)
    if side and not has_rotor:
        text = f'no rotor_inertia; write rotor_inertia = 1e-5 (kg*m^2) or "{UNKNOWN}", or leave this out'
        drive.refuse_key("robot.rotor-side", "rotor_inertia_side", text)
    known = has_rotor and drive.values["rotor_inertia"] != UNKNOWN
    if known and "rotor_inertia_side" not in drive.values:
        text = 'needs its side: write rotor_inertia_side = "motor" or rotor_inertia_side = "joint"'
        drive.refuse_key("robot.rotor-side", "rotor_inertia", text)
    ratio = gear or 1.0
    return Drive(
        gear=ratio,
        has_rotor=has_rotor,
        rotor_inertia=None if inertia is None else inertia * (ratio**2 if side == "motor" else 1.0),
        torque_constant=drive.read_float("torque_constant", "N*m/A"),
    )


def _read_spring(section: Section) -> Spring | None:
    """Return the `spring` table of a joint: tau = stiffness (q - rest)."""
    table = section.read_table("spring", ("stiffness", "rest"))
    if table is None:
        return None
    for key, example, unit in (("stiffness", "120", _STIFFNESS), ("rest", "0", "rad")):
        shown = adapt_unit(unit, prismatic=table.prismatic)
        table.require(key, f'write {key} = {example} ({shown}) or {key} = "{UNKNOWN}"')
    stiffness = table.read_float("stiffness", _STIFFNESS, word=UNKNOWN)
    rest = table.read_float("rest", "rad", word=UNKNOWN)
    if stiffness is not None and stiffness < 0:
        text = f"{stiffness:g} pushes the joint away from rest; a spring's stiffness is positive"
        table.warn("robot.negative-stiffness", "stiffness", text)
    return Spring(stiffness=stiffness, rest=rest)


def read_couplings(
    root: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[Coupling, ...]:
    """Return the drives that turn with several of the joints `names`; the kind of a fixed one is None."""
    couplings: list[Coupling] = []
    for section in root.read_table_array("coupling"):
        section.refuse_unknown_keys(("name", "terms", "rotor_inertia", "friction"))
        section.require("name", 'write name = "m6": it ends the names of the parameters, as in IAm6')
        name, taken = section.read_text("name"), [entry.name for entry in couplings]
        if name is not None and not (name.isidentifier() and name.isascii()):
            text = f"{section.show('name')} cannot end the name of a parameter; use letters, digits and _"
            section.refuse("robot.bad-name", "name", f"{text}, a letter first")
        elif name in taken:
            text = f"the name is taken by coupling {taken.index(name) + 1}; each coupling needs its own"
            section.refuse("robot.duplicate-coupling", "name", text)
        terms = _read_terms(section, names, kinds)
        prismatic = bool(terms) and all(kinds[index] is JointKind.PRISMATIC for index, _ in terms)
        unit = "kg" if prismatic else "kg*m^2"
        couplings.append(
            Coupling(
                name=name or "",
                terms=terms,
                has_rotor="rotor_inertia" in section.values,
                rotor_inertia=section.read_float("rotor_inertia", unit, NOT_NEGATIVE, word=UNKNOWN),
                friction=_read_friction(replace(section, prismatic=prismatic)),
            )
        )
    return tuple(couplings)


def _read_terms(
    section: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[tuple[int, Fraction], ...]:
    example = "write terms = { joint5 = 1, joint6 = 1 }"
    section.require("terms", f"{example}: speed = sum of factor * dq")
    table = section.read_table("terms")
    if table is None:
        return ()
    if not table.values:
        section.refuse("robot.missing-key", "terms", f"empty; {example}, joints and factors")
    terms = []
    for name in table.values:
        factor = read_fraction(table, name, "leave the joint out: the drive does not turn with it")
        if name not in names:
            hint = suggest_names(name, names, otherwise="allowed are")
            table.refuse_key("robot.unknown-joint", name, f"there is no such joint; {hint}")
        elif kinds[names.index(name)] is None:
            text = "the joint is fixed and drives nothing; name one that moves"
            table.refuse_key("robot.follows-fixed", name, text)
        elif factor is not None:
            terms.append((names.index(name), factor))
    return tuple(sorted(terms))


_ELASTICITY_KEYS = ("stiffness", "damping", "cubic", "stops", "knees", "symmetric", "catalogue")
_CATALOGUE = ("K1", "K2", "K3", "T1", "T2")


def _read_elasticity(section: Section) -> Elasticity | None:
    """Return the `elasticity` table of a joint; a notice explains which side q is."""
    table = section.read_table("elasticity", _ELASTICITY_KEYS)
    if table is None:
        return None
    text = "q is the link position; friction and rotor inertia are on the motor side"
    section.warn("robot.elastic-joint", "elasticity", text)
    before = len(table.errors)
    damping = table.read_float("damping", "N*m*s/rad", NOT_NEGATIVE)
    cubic = table.read_float("cubic", "N*m/rad^3", NOT_NEGATIVE)
    numbers = (
        ("threshold", "0.002", "rad", POSITIVE, ""),
        ("stiffness", "120", _STIFFNESS, NOT_NEGATIVE, UNKNOWN),
    )
    stops = tuple(Stop(threshold=at, stiffness=k) for at, k in _read_entries(table, "stops", *numbers))
    if "catalogue" in table.values:
        stiffness, knees = _read_catalogue(table)
    else:
        unit = adapt_unit(_STIFFNESS, prismatic=table.prismatic)
        table.require("stiffness", f'write stiffness = 1e4 ({unit}) or stiffness = "{UNKNOWN}"')
        stiffness = table.read_float("stiffness", _STIFFNESS, POSITIVE, word=UNKNOWN)
        knees = _read_knees(table)
    if cubic and "knees" in table.values:
        text = "cannot be combined with knees: both harden the spring; use one of them"
        table.refuse_key("robot.elasticity-mixed", "cubic", text)
    if len(table.errors) > before:
        return None
    try:
        return Elasticity(
            stiffness=stiffness, damping=damping or 0.0, cubic=cubic or 0.0, stops=stops, knees=knees
        )
    except RobotError as error:
        for notice in error.notices:
            table.refuse(notice.code, "knees", notice.text)
        return None


def _read_catalogue(table: Section) -> tuple[float | None, tuple[Knee, ...]]:
    """Return the stiffness K1 and the knees that a maker's table stands for."""
    for key in ("stiffness", "knees", "symmetric", "cubic"):
        if key in table.values:
            text = "cannot be combined with catalogue, which gives stiffness and knees; leave one of them out"
            table.refuse_key("robot.elasticity-mixed", key, text)
    inner = table.read_table("catalogue", _CATALOGUE)
    if inner is None:
        return None, ()
    values = {}
    remedy = f"catalogue = {{ {', '.join(f'{name} = ..' for name in _CATALOGUE)} }} has all five"
    for key in _CATALOGUE:
        inner.require(key, remedy)
        number = inner.read_float(key, _STIFFNESS if key[0] == "K" else "N*m", POSITIVE)
        if number is not None:
            values[key] = number
    if len(values) < len(_CATALOGUE):
        return None, ()
    if not values["T1"] < values["T2"]:
        text = f"must be greater than T1 = {values['T1']:g}, where the second slope begins"
        inner.refuse("robot.out-of-range", "T2", text)
        return None, ()
    slopes = (values["K1"], values["K2"], values["K3"])
    return values["K1"], compute_catalogue_knees(slopes, (values["T1"], values["T2"]))


_Number = tuple[str, str, str, Range, str]
"""Key, example, unit and range of a number, and the word that may stand in its place."""


def _read_entries(table: Section, key: str, *numbers: _Number) -> list[tuple[float, float | None]]:
    """Return threshold and other number of each table in the array at `key`; mistakes are reported."""
    entries: Any = table.values.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        example = ", ".join(f"{name} = {number}" for name, number, *_ in numbers)
        text = f"expected a list of tables, as in {key} = [{{ {example} }}], got {table.show(key)}"
        table.refuse("robot.wrong-type", key, text)
        return []
    found: list[tuple[float, float | None]] = []
    for index, values in enumerate(entries):
        entry = table.inside(values, f"{table.label}: {key} {index + 1}", key, index)
        entry.refuse_unknown_keys(name for name, *_ in numbers)
        for name, _, unit, *_ in numbers:
            shown = adapt_unit(unit, prismatic=entry.prismatic)
            entry.require(name, f"write {name} = a number" + (f" in {shown}" if unit else ""))
        threshold, value = (
            entry.read_float(name, unit, allowed, word=word) for name, _, unit, allowed, word in numbers
        )
        if threshold == 0:
            text = "must not be 0: the outer function has slope 1 there; change stiffness instead"
            entry.refuse("robot.out-of-range", "threshold", text)
        elif threshold is not None and (value is not None or key == "stops"):
            if found and not threshold > found[-1][0]:
                text = f"must be greater than {found[-1][0]:g} before it: thresholds increase, each once"
                entry.refuse("robot.out-of-range", "threshold", text)
            found.append((threshold, value))
    return found


def _read_knees(table: Section) -> tuple[Knee, ...]:
    symmetric = table.read_flag("symmetric") or False
    allowed = POSITIVE if symmetric else Range()
    numbers = (("threshold", "3.0", "N*m", allowed, ""), ("slope", "0.5", "", Range(), ""))
    found = [Knee(threshold=at, slope=slope or 0.0) for at, slope in _read_entries(table, "knees", *numbers)]
    if symmetric and "knees" not in table.values:
        text = "it mirrors knees, and there are none; write knees or leave it out"
        table.refuse_key("robot.elasticity-mixed", "symmetric", text)
    mirrored = [Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(found)]
    return (*mirrored, *found) if symmetric else tuple(found)
