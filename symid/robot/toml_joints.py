"""The tables of a joint that moves: `drive`, `friction`, `limits`, `spring`, `elasticity`; `[[coupling]]`.

`elasticity` is the spring between motor and link, with its hysteresis: its `model` adds one branch of its
kind to the spring with its stops and knees, by keys beside it; tables `[[joint.elasticity.branch]]` add any
number.

Supported: rotor inertias on either side of the gear; every friction law of the catalogue, with all values or
none where they are unknown, and a speed over which dry friction changes its sign; laws with a state, whose
bristles or elements must be known; stiffness, damping, a cubic part, stops, knees on both sides or written
for one and mirrored, catalogue values of harmonic drives, backlash, every branch of `joint_models`;
stiffnesses and rotor inertias that are "unknown", to be identified.
Not supported: springs at a joint that are not linear; unknown shape values, thresholds, knees and numbers of
branches; a cubic part together with knees.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from symid import joint_models
from symid.errors import Notice, RobotError, UsageError
from symid.joint_models import FrictionValues
from symid.notation import adapt_unit
from symid.robot.description import Coupling, Drive, Joint, JointKind, Limits, Spring
from symid.robot.exact_values import read_fraction
from symid.robot.toml_values import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    explain_wide_limits,
    suggest_names,
)

UNKNOWN = "unknown"
"""Stands in place of a number that is to be identified."""
_STIFFNESS = "N*m/rad"

Names = Sequence[str]
Values = Mapping[str, Any]
Written = dict[str, tuple[float | tuple[float, ...], str]]
_CATALOGUE = ("K1", "K2", "K3", "T1", "T2")
_Number = tuple[str, str, str, Range, str]
"""Key, example, unit and range of a number, and the word that may stand in its place."""
MOVING_KEYS = ("actuated", "drive", "friction", "spring", "elasticity", "limits")
_NAMES = {
    "bouc_wen": "bouc-wen",
    "attracted": "attracted-maxwell-slip",
    "slip": "nonlinear-stops",
    "relays": "krasnoselskii-pokrovskii",
}
"""The model of a branch's kind."""
_OWN = (
    *("stiffness", "damping", "cubic", "stops", "knees", "symmetric", "catalogue"),
    *("backlash", "offset", "model", "branch"),
)
_EXPONENT = Range(low=0, high=10, open_low=True)
_LAWS = tuple(joint_models.FRICTION_LAWS.values())
FRICTION_PARTS = tuple(dict.fromkeys(entry.name for law in _LAWS for entry in law.linear))
"""Names of the linear values of all laws."""
_SHAPES = tuple(dict.fromkeys(entry.name for law in _LAWS for entry in law.shape))
_STATE_LAWS = joint_models.STATE_LAWS.values()
_MEMORIES = tuple(dict.fromkeys(entry.name for law in _STATE_LAWS for entry in law.memory))
_CONSTANT = ("offset", "Fp")
_LARGEST_GAP = 1e-6
"""By which the shares of elements may differ from one in sum."""
_DEFAULT_GAMMA = 2.0
# The speeds at which curves are evaluated: a hundred a decade.
_SLOWEST, _FASTEST, _SPEED_COUNT = 1e-9, 1e6, 1500


@dataclass(frozen=True, slots=True)
class _Key:
    """A key of a branch: its unit where the joint turns, range, default (None: required), whether a list."""

    name: str
    unit: str = ""
    allowed: Range = ANY
    default: float | tuple[float, ...] | None = None
    many: bool = False


_LEVEL = _Key("Fc", "N*m", POSITIVE)
_SPEED = _Key("vs", "rad/s", POSITIVE, 1.0)
_FALL = (_Key("Fe", "N*m", default=0.0), _SPEED, _Key("gamma", "", POSITIVE, 2.0))
_BENDING = _Key("sigma0", _STIFFNESS, POSITIVE)
_DAMPING = _Key("sigma1", "N*m*s/rad", NOT_NEGATIVE, 0.0)
_VISCOUS = _Key("Fv", "N*m*s/rad", NOT_NEGATIVE, 0.0)
_STIFFNESSES = _Key("stiffnesses", _STIFFNESS, POSITIVE, many=True)
_SHARES = _Key("shares", "", POSITIVE, many=True)


def _build_bristles(values: Values) -> joint_models.Branch:
    """Return bristles; of what is zero the law is without."""
    named = dict(values)
    stiffnesses, shares = named.pop("stiffnesses", ()), named.pop("shares", ())
    if len(stiffnesses) != len(shares):
        text = f"{len(stiffnesses)} stiffnesses need as many shares, got {len(shares)}"
        raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
    named |= {f"stiffness{k}": value for k, value in enumerate(stiffnesses, start=1)}
    named |= {f"share{k}": value for k, value in enumerate(shares, start=1)}
    if not named.get("Fe"):
        named = {name: value for name, value in named.items() if name not in ("Fe", "vs", "gamma")}
    named = {name: value for name, value in named.items() if value or name not in ("sigma1", "Fv")}
    if shares:
        law = "generalised-maxwell-slip" if "Fe" in named else "maxwell-slip"
    else:
        law = "lugre" if "Fe" in named or "sigma1" in named else "dahl"
    return joint_models.BristleBranch(law=law, values=tuple(named.items()))


def _build_slip_springs(values: Values) -> tuple[joint_models.Stop, ...]:
    """Return the stops that springs behind dry friction are."""
    pairs = list(zip(values["stiffnesses"], values["forces"], strict=False))
    if not len(pairs) == len(values["stiffnesses"]) == len(values["forces"]):
        text = f"{len(values['stiffnesses'])} stiffnesses need as many forces, got {len(values['forces'])}"
        raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
    return joint_models.convert_maxwell_elements(
        [joint_models.MaxwellElement(stiffness=k, force=force) for k, force in pairs]
    )


_Build = Callable[[Values], joint_models.Branch | tuple[joint_models.Stop, ...]]
# The keys of each kind of branch, and how their values make it.
_MODELS: Mapping[str, tuple[tuple[_Key, ...], _Build]] = {
    "bouc-wen": (
        (
            _Key("level", "N*m"),
            _Key("length", "rad", POSITIVE),
            _Key("sharpness", "", Range(low=1), 1.0),
            _Key("loop", "", Range(low=0.5), 0.5),
            _Key("skew", "", Range(low=-1, high=1), 0.0),
            _Key("lean", default=0.0),
        ),
        lambda values: joint_models.BoucWen(**values),
    ),
    "dahl": ((_LEVEL, _BENDING, _VISCOUS), _build_bristles),
    "lugre": ((_LEVEL, *_FALL, _BENDING, _DAMPING, _VISCOUS), _build_bristles),
    "maxwell-slip": ((_STIFFNESSES, _Key("forces", "N*m", POSITIVE, many=True)), _build_slip_springs),
    "generalised-maxwell-slip": ((_LEVEL, *_FALL, _STIFFNESSES, _SHARES, _VISCOUS), _build_bristles),
    "attracted-maxwell-slip": (
        (
            _Key("thresholds", "rad", POSITIVE, many=True),
            _STIFFNESSES,
            _Key("excess", default=0.0),
            replace(_SPEED, name="speed"),
            _Key("attraction", "1/s", POSITIVE),
        ),
        lambda values: joint_models.AttractedSlip(**values),
    ),
    "nonlinear-stops": (
        (
            _Key("deflections", "rad", many=True),
            _Key("forces", "N*m", many=True),
            _Key("falls", "s/rad", NOT_NEGATIVE, (0.0, 0.0), many=True),
        ),
        lambda values: joint_models.SlipSpring(**values),
    ),
    "krasnoselskii-pokrovskii": (
        (
            _Key("low", "rad"),
            _Key("step", "rad", POSITIVE),
            _Key("ramps", "N*m", many=True),
            _Key("weights", "N*m", many=True),
        ),
        lambda values: joint_models.Relays(**values),
    ),
    "relaxation": (
        (_Key("relaxing", _STIFFNESS, POSITIVE), _Key("time", "s", POSITIVE)),
        lambda values: joint_models.Relaxation(stiffness=values["relaxing"], time=values["time"]),
    ),
}
_PLAIN = ("prandtl-ishlinskii", "modified-prandtl-ishlinskii")
"""Names of the spring with stops and knees alone."""


def list_branch_entries(branch: joint_models.Branch) -> tuple[str, Written]:
    """Return the `model` of a branch, and value and unit (of a joint that turns) of each of its keys."""
    given: dict[str, Any]
    match branch:
        case joint_models.BristleBranch():
            given = dict(branch.values)
            elements = [k for k in range(1, branch.count + 1) if f"share{k}" in given]
            given |= {"stiffnesses": tuple(given[f"stiffness{k}"] for k in elements)}
            given |= {"shares": tuple(given[f"share{k}"] for k in elements)}
            model = "generalised-maxwell-slip" if elements else branch.law
        case joint_models.Relaxation():
            model, given = "relaxation", {"relaxing": branch.stiffness, "time": branch.time}
        case _:
            model = _NAMES[branch.kind]
            given = {key.name: getattr(branch, key.name) for key in _MODELS[model][0]}
    return model, {
        key.name: (given[key.name], key.unit.replace("*", " "))
        for key in _MODELS[model][0]
        # A default that has a unit is another number in other units.
        if key.name in given and (given[key.name] != key.default or (key.unit and key.default))
    }


def _read_model(table: Section, *, needed: bool) -> str | None:
    """Return the model of a table, with a hyphen where it has an underscore."""
    if needed:
        table.require("model", f"write one of {', '.join(_MODELS)}")
    given = table.values.get("model")
    if isinstance(given, str) and given.replace("_", "-") in (*_PLAIN, *_MODELS):
        return given.replace("_", "-")
    return table.read_choice("model", _MODELS if needed else (*_PLAIN, *_MODELS))


def _read_branch(table: Section, model: str) -> joint_models.Branch | tuple[joint_models.Stop, ...] | None:
    """Return what the keys of a model state; mistakes are reported."""
    before = len(table.errors)
    values: dict[str, Any] = {}
    for key in _MODELS[model][0]:
        unit = adapt_unit(key.unit, prismatic=table.prismatic)
        kind = "a list of " if key.many else ""
        what = ("numbers" if key.many else "a number") + (f" in {unit}" if unit else "")
        if key.default is None:
            table.require(key.name, f'model "{model}" needs it: {kind}{what}')
        if key.name not in table.values:
            values[key.name] = key.default
        else:
            read = table.read_floats if key.many else table.read_float
            values[key.name] = read(key.name, key.unit, key.allowed)
    if values.get("Fe") and "vs" not in table.values:
        unit = adapt_unit("rad/s", prismatic=table.prismatic)
        table.require("vs", f"where Fe is not 0, the model needs it as a number in {unit}")
    if len(table.errors) > before:
        return None
    try:
        return _MODELS[model][1](values)
    except RobotError as error:
        for notice in error.notices:
            table.refuse(notice.code, "model", notice.text)
        return None


def read_elasticity(section: Section) -> joint_models.Elasticity | None:
    """Return the `elasticity` table of a joint; a notice explains which side q is."""
    table = section.read_table("elasticity")
    if table is None:
        return None
    text = "q is the link position; friction and rotor inertia are on the motor side"
    section.warn("robot.elastic-joint", "elasticity", text)
    before = len(table.errors)
    damping = table.read_float("damping", "N*m*s/rad", NOT_NEGATIVE)
    cubic = table.read_float("cubic", "N*m/rad^3", NOT_NEGATIVE)
    backlash = table.read_float("backlash", "rad", NOT_NEGATIVE)
    offset = table.read_float("offset", "N*m")
    threshold = ("threshold", "0.002", "rad", POSITIVE, "")
    other = ("stiffness", "120", _STIFFNESS, NOT_NEGATIVE, UNKNOWN)
    entries = _read_entries(table, "stops", threshold, other)
    stops = [joint_models.Stop(threshold=at, stiffness=k) for at, k in entries]
    # The branches of the model beside the spring and of `branch` tables; stops are among them.
    model = _read_model(table, needed=False)
    found: list[joint_models.Branch | tuple[joint_models.Stop, ...] | None] = []
    known = [key.name for key in _MODELS[model][0]] if model is not None and model in _MODELS else []
    if model is not None or "model" not in table.values:
        table.refuse_unknown_keys((*_OWN, *known))
    if model is not None and model in _MODELS:
        found.append(_read_branch(table, model))
    for inner in table.read_table_array("branch"):
        if own := _read_model(inner, needed=True):
            inner.refuse_unknown_keys(("model", *(key.name for key in _MODELS[own][0])))
            found.append(_read_branch(inner, own))
    branches = tuple(entry for entry in found if entry is not None and not isinstance(entry, tuple))
    more = [stop for entry in found if isinstance(entry, tuple) for stop in entry]
    for stop in more:
        # Two of one threshold would be one.
        if any(stop.threshold == other.threshold for other in stops):
            text = f"an element slips at {stop.threshold:g}, as one of the stops does; write them as one"
            table.refuse_key("robot.elasticity-mixed", "stops", text)
    if "catalogue" in table.values:
        stiffness, knees = _read_catalogue(table)
    else:
        unit = adapt_unit(_STIFFNESS, prismatic=table.prismatic)
        table.require("stiffness", f'write stiffness = 1e4 ({unit}) or stiffness = "{UNKNOWN}"')
        stiffness = table.read_float("stiffness", _STIFFNESS, POSITIVE, word=UNKNOWN)
        symmetric = table.read_flag("symmetric") or False
        threshold = ("threshold", "3.0", "N*m", POSITIVE if symmetric else ANY, "")
        entries = _read_entries(table, "knees", threshold, ("slope", "0.5", "", ANY, ""))
        knees = tuple(joint_models.Knee(threshold=at, slope=slope or 0.0) for at, slope in entries)
        if symmetric and "knees" not in table.values:
            text = "it mirrors knees, and there are none; write knees or leave it out"
            table.refuse_key("robot.elasticity-mixed", "symmetric", text)
        if symmetric:
            knees = (*(replace(knee, threshold=-knee.threshold) for knee in reversed(knees)), *knees)
    if cubic and "knees" in table.values:
        text = "cannot be combined with knees: both harden the spring; use one of them"
        table.refuse_key("robot.elasticity-mixed", "cubic", text)
    if len(table.errors) > before:
        return None
    try:
        return joint_models.Elasticity(
            stiffness=stiffness,
            damping=damping or 0.0,
            cubic=cubic or 0.0,
            stops=tuple(sorted((*stops, *more), key=lambda stop: stop.threshold)),
            knees=knees,
            branches=branches,
            backlash=backlash or 0.0,
            offset=offset or 0.0,
        )
    except RobotError as error:
        for notice in error.notices:
            table.refuse(notice.code, "knees", notice.text)
        return None


def _read_catalogue(table: Section) -> tuple[float | None, tuple[joint_models.Knee, ...]]:
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
    return values["K1"], joint_models.compute_catalogue_knees(slopes, (values["T1"], values["T2"]))


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


def _read_friction(section: Section, fastest: float = math.inf, *, shared: bool = False) -> FrictionValues:
    """Return the friction of a table up to the speed `fastest`; `shared`: it acts on several joints."""
    table = section.read_table("friction")
    if table is None:
        return FrictionValues()
    table.require("model", 'write model = "coulomb-viscous"')
    model = table.read_text("model")
    law = None
    if model is not None and model != joint_models.NO_FRICTION:
        try:
            law = joint_models.get_law(model)
        except UsageError as error:
            table.refuse("robot.friction-model", "model", error.notices[0].text)
    # An exponent may be stated beside the model, and then is part of the law's name.
    free = None if law is None else joint_models.free_exponent(law)
    gamma = None if free is None else table.read_float("gamma", "", _EXPONENT)
    if free is not None and gamma is not None and gamma != _DEFAULT_GAMMA:
        law = joint_models.get_law(joint_models.fix_exponent(free, gamma))
    smoothing = table.read_float("smoothing", "rad/s", POSITIVE)
    entries = [entry for one in (_LAWS if law is None else (law,)) for entry in one.linear]
    units = {entry.name: entry.unit.replace(" ", "*") for entry in reversed(entries)}
    names = tuple(dict.fromkeys(entry.name for entry in entries))
    given = {name: table.read_float(name, units[name]) for name in names}
    if law is None:
        if model == joint_models.NO_FRICTION:
            _check_keys(table, joint_models.NO_FRICTION, (), (), has_step=False)
        else:
            table.refuse_unknown_keys(("model", *FRICTION_PARTS, *_SHAPES, *_MEMORIES, "smoothing"))
        return FrictionValues()
    keys = tuple(entry.name for entry in law.shape)
    stated = keys if free is None else (*keys, "gamma")
    shape: list[float] = []
    value: float | None
    for entry in law.shape:
        allowed = _EXPONENT if entry.unit == "1" else NOT_NEGATIVE if entry.lower_is_allowed else POSITIVE
        unit, value = "" if entry.unit == "1" else entry.unit, _DEFAULT_GAMMA
        if entry.name != "gamma" or entry.name in table.values:
            value = table.read_float(entry.name, unit, allowed)
            in_unit = f" in {adapt_unit(unit, prismatic=table.prismatic)}" if unit else ""
            table.require(entry.name, f"the model needs it as a number{in_unit}")
        shape += [] if value is None else [value]
    bristles = _read_bristles(table, law)
    known = tuple(dict.fromkeys((*stated, *(entry.name for entry in law.memory))))
    _check_keys(table, law.name, names, known, has_step=joint_models.has_sign(law) and not law.memory)
    if shared and (law.inputs != ("velocity",) or law.memory):
        what = "bristles" if law.memory else " and the ".join(law.inputs[1:])
        text = f'"{law.name}" depends on the {what} of one joint, and this friction acts on several; '
        table.refuse("robot.friction-model", "model", f"{text}choose a model of the velocity alone")
    for entry in law.linear:
        value = given[entry.name]
        if entry.lower == 0.0 and value is not None and value < 0:
            text = f"{table.show(entry.name)} drives the joint instead of braking it; write a positive"
            table.warn("robot.negative-friction", entry.name, f"{text} coefficient")
    values = tuple(value for value in given.values() if value is not None)
    found = FrictionValues(
        law=law.name,
        values=values if values and len(values) == len(names) else None,
        smoothing=smoothing or 0.0,
        shape=tuple(shape) if len(shape) == len(keys) else (),
        bristles=bristles,
    )
    if len(shape) == len(keys):
        _warn_of_driving_friction(table, found, fastest)
    return found


def _read_bristles(table: Section, law: joint_models.FrictionLaw) -> tuple[float, ...]:
    """Return the values of a law's state in its order, one list after another; empty where one is missing."""
    lists: list[tuple[float, ...]] = []
    for entry in law.memory:
        unit = "" if entry.unit == "1" else entry.unit.replace(" ", "*")
        allowed = NOT_NEGATIVE if entry.lower_is_allowed else POSITIVE
        what = f" in {adapt_unit(unit, prismatic=table.prismatic)}" if unit else ""
        if law.elements:
            table.require(entry.name, f"the model's state needs a list of numbers{what}, one an element")
            lists.append(table.read_floats(entry.name, unit, allowed, each=", one an element") or ())
        else:
            table.require(entry.name, f"the model's state needs it as a number{what}")
            value = table.read_float(entry.name, unit, allowed)
            lists.append(() if value is None else (value,))
    if law.elements and all(lists):
        stiffness, share = lists
        if len(stiffness) != len(share):
            text = f"{len(share)} numbers for the {len(stiffness)} of stiffness; write one of each an element"
            table.refuse("robot.friction-elements", "share", text)
        elif abs(math.fsum(share) - 1.0) > _LARGEST_GAP:
            text = f"the shares of all elements must have the sum 1, got {math.fsum(share):.7g}"
            table.refuse("robot.friction-elements", "share", text)
    return tuple(value for values in lists for value in values) if all(lists) else ()


def _check_keys(table: Section, law: str, wanted: Names, shape: Names, *, has_step: bool) -> None:
    """Refuse values that the model does not have, and a part of its values in place of all."""
    code = "robot.friction-values"
    if not has_step and "smoothing" in table.values:
        nothing = "friction" if law == joint_models.NO_FRICTION else "step at standstill"
        text = f'has nothing to smooth: the model "{law}" has no {nothing}; leave it out'
        table.refuse_key(code, "smoothing", text)
    known = ("model", *wanted, *shape, "smoothing")
    for name in table.values:
        if name in (*FRICTION_PARTS, *_SHAPES, *_MEMORIES) and name not in known:
            listed = f"its values are {', '.join(wanted)}" if wanted else "it has no values"
            listed += f", its shape values {', '.join(shape)}" if shape else ""
            table.refuse_key(code, name, f'not a value of the model "{law}"; {listed}')
    table.refuse_unknown_keys(dict.fromkeys((*known, *FRICTION_PARTS, *_SHAPES, *_MEMORIES)))
    missing = [name for name in wanted if name not in table.values]
    if missing and len(missing) < len(wanted):
        text = f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are"
        table.refuse_key(code, next(name for name in wanted if name in table.values), f"{text} unknown")


def _warn_of_driving_friction(table: Section, friction: FrictionValues, fastest: float) -> None:
    """Warn of a curve whose least braking torques up to a speed have a negative sum over both directions."""
    law, named = joint_models.get_friction_law(friction), joint_models.name_values(friction)
    if law is None or not named or not law.own:
        return
    if any(entry.lower == 0.0 and named[entry.name] < 0.0 for entry in law.linear):
        return
    speeds = np.geomspace(_SLOWEST, max(min(fastest, _FASTEST), _SLOWEST), _SPEED_COUNT + 1)
    values = [0.0 if name in _CONSTANT else value for name, value in named.items()]
    zero = np.zeros_like(speeds)
    inputs = {"load": zero, "position": zero, "temperature": zero + joint_models.REFERENCE_TEMPERATURE}
    with np.errstate(over="ignore"):
        moves = [(side, {**inputs, "velocity": side * speeds}) for side in (1.0, -1.0)]
        compute = joint_models.compute_friction_torque
        sides = [side * compute(law, motion, values, friction.shape) for side, motion in moves]
    pushing = np.flatnonzero(sum(map(np.minimum.accumulate, sides)) < 0.0)
    if not len(pushing):
        return
    speed, unit = float(speeds[pushing[0]]), adapt_unit("rad/s", prismatic=table.prismatic)
    start = f"from about {speed:.2g} {unit} on" if speed > _SLOWEST else "as motion begins"
    negative = (name for name, value in named.items() if value < 0.0 and name not in _CONSTANT)
    key = next(negative, next(iter(named)))
    hint = "simulation refuses that; correct the sign"
    if "g2" in joint_models.name_shape(friction):
        key, hint = "Fm", "let Fc or Fv outweigh Fm, or g2 be at least g3"
    text = f"{named[key]:g} drives the joint {start} instead of braking it; {hint}"
    table.warn("robot.negative-friction", key, text)


def complete_joint(section: Section, joint: Joint, *, fixed: bool) -> Joint:
    """Return the joint with what its table says of its motion, which a `fixed` joint does not have."""
    if fixed:
        for key in MOVING_KEYS:
            if key in section.values:
                text = "a fixed joint has none; leave it out, or choose a kind that moves"
                section.refuse_key("robot.fixed-joint", key, text)
        return joint
    limits, drive, spring = Limits(), Drive(), None
    rates = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "N*m"}
    if table := section.read_table("limits", ("position", *rates)):
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
        limits = Limits(position=position, **others)
    keys = ("gear", "rotor_inertia", "rotor_inertia_side", "torque_constant")
    if table := section.read_table("drive", keys):
        # Motors turn, whatever the joint does. Its label is enough: these keys stand nowhere else.
        table = replace(table, label=section.label, prismatic=False)
        gear = table.read_float("gear", "")
        if gear == 0:
            text = "must not be 0; it is the number of motor turns per joint turn"
            table.refuse("robot.out-of-range", "gear", text)
        side = table.read_choice("rotor_inertia_side", ("motor", "joint"))
        has_rotor = "rotor_inertia" in table.values
        inertia = table.read_float("rotor_inertia", "kg*m^2", NOT_NEGATIVE, word=UNKNOWN)
        if side and not has_rotor:
            text = f'no rotor_inertia; write rotor_inertia = 1e-5 (kg*m^2) or "{UNKNOWN}", or leave this out'
            table.refuse_key("robot.rotor-side", "rotor_inertia_side", text)
        known = has_rotor and table.values["rotor_inertia"] != UNKNOWN
        if known and "rotor_inertia_side" not in table.values:
            text = 'needs its side: write rotor_inertia_side = "motor" or rotor_inertia_side = "joint"'
            table.refuse_key("robot.rotor-side", "rotor_inertia", text)
        ratio = gear or 1.0
        drive = Drive(
            gear=ratio,
            has_rotor=has_rotor,
            rotor_inertia=None if inertia is None else inertia * (ratio**2 if side == "motor" else 1.0),
            torque_constant=table.read_float("torque_constant", "N*m/A"),
            direct=gear == 1.0,
        )
    fastest, shared = limits.velocity or math.inf, "mimic" in section.values
    friction = _read_friction(section, fastest, shared=shared)
    # tau = stiffness (q - rest)
    if table := section.read_table("spring", ("stiffness", "rest")):
        for key, example, unit in (("stiffness", "120", _STIFFNESS), ("rest", "0", "rad")):
            shown = adapt_unit(unit, prismatic=table.prismatic)
            table.require(key, f'write {key} = {example} ({shown}) or {key} = "{UNKNOWN}"')
        stiffness = table.read_float("stiffness", _STIFFNESS, word=UNKNOWN)
        spring = Spring(stiffness=stiffness, rest=table.read_float("rest", "rad", word=UNKNOWN))
        if stiffness is not None and stiffness < 0:
            text = f"{stiffness:g} pushes the joint away from rest; write a positive stiffness"
            table.warn("robot.negative-stiffness", "stiffness", text)
    elasticity, actuated = read_elasticity(section), section.read_flag("actuated") is not False
    if not actuated and (shared or elasticity is not None):
        what = "follows another one" if shared else "is elastic, and a motor is at one end of its spring"
        text = f"the joint {what}; leave this out"
        section.refuse_key("robot.not-actuated", "actuated", text)
        actuated = True
    moves = replace(joint, drive=drive, friction=friction, limits=limits, spring=spring)
    return replace(moves, elasticity=elasticity, actuated=actuated)


def read_couplings(root: Section, names: Names, kinds: Sequence[JointKind | None]) -> tuple[Coupling, ...]:
    """Return the drives that turn with several of the joints `names`; the kind of a fixed one is None."""
    couplings: list[Coupling] = []
    example = "write terms = { joint5 = 1, joint6 = 1 }"
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
        section.require("terms", f"{example}: speed = sum of factor * dq")
        terms: list[tuple[int, Fraction]] = []
        if table := section.read_table("terms"):
            if not table.values:
                section.refuse("robot.missing-key", "terms", f"empty; {example}, joints and factors")
            for joint in table.values:
                factor = read_fraction(table, joint, "leave the joint out: the drive does not turn with it")
                if joint not in names:
                    hint = suggest_names(joint, names, otherwise="allowed are")
                    table.refuse_key("robot.unknown-joint", joint, f"there is no such joint; {hint}")
                elif kinds[names.index(joint)] is None:
                    text = "the joint is fixed and drives nothing; name one that moves"
                    table.refuse_key("robot.follows-fixed", joint, text)
                elif factor is not None:
                    terms.append((names.index(joint), factor))
        prismatic = bool(terms) and all(kinds[index] is JointKind.PRISMATIC for index, _ in terms)
        unit = "kg" if prismatic else "kg*m^2"
        couplings.append(
            Coupling(
                name=name or "",
                terms=tuple(sorted(terms)),
                has_rotor="rotor_inertia" in section.values,
                rotor_inertia=section.read_float("rotor_inertia", unit, NOT_NEGATIVE, word=UNKNOWN),
                friction=_read_friction(replace(section, prismatic=prismatic), shared=True),
            )
        )
    return tuple(couplings)
