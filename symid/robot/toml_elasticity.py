"""The table `[joint.elasticity]`: the spring between motor and link, with its hysteresis.

Table -> Elasticity; branch -> the keys that state it. `model` adds one branch of its kind to the spring with
its stops and knees, by keys beside it; tables `[[joint.elasticity.branch]]` add any number.

Supported: stiffness, damping, a cubic part, stops, knees on both sides or written for one and mirrored,
catalogue values of harmonic drives, backlash, every branch of `joint_models`; stiffnesses that are "unknown",
to be identified.
Not supported: unknown thresholds, knees and numbers of branches; a cubic part together with knees.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from symid.errors import Notice, RobotError
from symid.joint_models import (
    AttractedSlip,
    BoucWen,
    Branch,
    BristleBranch,
    Elasticity,
    Knee,
    MaxwellElement,
    Relaxation,
    Relays,
    SlipSpring,
    Stop,
    compute_catalogue_knees,
    convert_maxwell_elements,
)
from symid.notation import adapt_unit
from symid.robot.toml_values import ANY, NOT_NEGATIVE, POSITIVE, Range, Section

UNKNOWN = "unknown"
"""Stands in place of a number that is to be identified."""
_STIFFNESS = "N*m/rad"

Values = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Key:
    """A key of a branch: its unit where the joint turns, range, default (None: required), whether a list."""

    name: str
    unit: str = ""
    allowed: Range = ANY
    default: float | tuple[float, ...] | None = None
    many: bool = False


_LEVEL = _Key(name="Fc", unit="N*m", allowed=POSITIVE)
_SPEED = _Key(name="vs", unit="rad/s", allowed=POSITIVE, default=1.0)
_FALL = (
    _Key(name="Fe", unit="N*m", default=0.0),
    _SPEED,
    _Key(name="gamma", allowed=POSITIVE, default=2.0),
)
_BENDING = _Key(name="sigma0", unit=_STIFFNESS, allowed=POSITIVE)
_VISCOUS = _Key(name="Fv", unit="N*m*s/rad", allowed=NOT_NEGATIVE, default=0.0)
_STIFFNESSES = _Key(name="stiffnesses", unit=_STIFFNESS, allowed=POSITIVE, many=True)


def _build_bristles(values: Values) -> Branch:
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
    return BristleBranch(law=law, values=tuple(named.items()))


def _build_slip_springs(values: Values) -> tuple[Stop, ...]:
    """Return the stops that springs behind dry friction are."""
    pairs = list(zip(values["stiffnesses"], values["forces"], strict=False))
    if not len(pairs) == len(values["stiffnesses"]) == len(values["forces"]):
        text = f"{len(values['stiffnesses'])} stiffnesses need as many forces, got {len(values['forces'])}"
        raise RobotError(Notice(code="robot.invalid-elasticity", text=text))
    return convert_maxwell_elements([MaxwellElement(stiffness=k, force=force) for k, force in pairs])


_Build = Callable[[Values], Branch | tuple[Stop, ...]]
# The keys of each kind of branch, and how their values make it.
_MODELS: Mapping[str, tuple[tuple[_Key, ...], _Build]] = {
    "bouc-wen": (
        (
            _Key(name="level", unit="N*m"),
            _Key(name="length", unit="rad", allowed=POSITIVE),
            _Key(name="sharpness", allowed=Range(low=1), default=1.0),
            _Key(name="loop", allowed=Range(low=0.5), default=0.5),
            _Key(name="skew", allowed=Range(low=-1, high=1), default=0.0),
            _Key(name="lean", default=0.0),
        ),
        lambda values: BoucWen(**values),
    ),
    "dahl": ((_LEVEL, _BENDING, _VISCOUS), _build_bristles),
    "lugre": (
        (
            _LEVEL,
            *_FALL,
            _BENDING,
            _Key(name="sigma1", unit="N*m*s/rad", allowed=NOT_NEGATIVE, default=0.0),
            _VISCOUS,
        ),
        _build_bristles,
    ),
    "maxwell-slip": (
        (_STIFFNESSES, _Key(name="forces", unit="N*m", allowed=POSITIVE, many=True)),
        _build_slip_springs,
    ),
    "generalised-maxwell-slip": (
        (
            _LEVEL,
            *_FALL,
            _STIFFNESSES,
            _Key(name="shares", allowed=POSITIVE, many=True),
            _VISCOUS,
        ),
        _build_bristles,
    ),
    "attracted-maxwell-slip": (
        (
            _Key(name="thresholds", unit="rad", allowed=POSITIVE, many=True),
            _STIFFNESSES,
            _Key(name="excess", default=0.0),
            replace(_SPEED, name="speed"),
            _Key(name="attraction", unit="1/s", allowed=POSITIVE),
        ),
        lambda values: AttractedSlip(**values),
    ),
    "nonlinear-stops": (
        (
            _Key(name="deflections", unit="rad", many=True),
            _Key(name="forces", unit="N*m", many=True),
            _Key(name="falls", unit="s/rad", allowed=NOT_NEGATIVE, default=(0.0, 0.0), many=True),
        ),
        lambda values: SlipSpring(**values),
    ),
    "krasnoselskii-pokrovskii": (
        (
            _Key(name="low", unit="rad"),
            _Key(name="step", unit="rad", allowed=POSITIVE),
            _Key(name="ramps", unit="N*m", many=True),
            _Key(name="weights", unit="N*m", many=True),
        ),
        lambda values: Relays(**values),
    ),
    "relaxation": (
        (
            _Key(name="relaxing", unit=_STIFFNESS, allowed=POSITIVE),
            _Key(name="time", unit="s", allowed=POSITIVE),
        ),
        lambda values: Relaxation(stiffness=values["relaxing"], time=values["time"]),
    ),
}
_PLAIN = ("prandtl-ishlinskii", "modified-prandtl-ishlinskii")
"""Names of the spring with stops and knees alone."""


def list_branch_entries(branch: Branch) -> tuple[str, dict[str, tuple[float | tuple[float, ...], str]]]:
    """Return the `model` of a branch, and value and unit (of a joint that turns) of each of its keys."""
    given: dict[str, Any]
    match branch:
        case BristleBranch():
            given = dict(branch.values)
            elements = [k for k in range(1, branch.count + 1) if f"share{k}" in given]
            given |= {"stiffnesses": tuple(given[f"stiffness{k}"] for k in elements)}
            given |= {"shares": tuple(given[f"share{k}"] for k in elements)}
            model = "generalised-maxwell-slip" if elements else branch.law
        case Relaxation():
            model, given = "relaxation", {"relaxing": branch.stiffness, "time": branch.time}
        case _:
            model = _NAMES[branch.kind]
            given = {key.name: getattr(branch, key.name) for key in _MODELS[model][0]}
    return model, {
        key.name: (given[key.name], key.unit.replace("*", " "))
        for key in _MODELS[model][0]
        if key.name in given and given[key.name] != key.default
    }


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


def _read_model(table: Section, *, needed: bool) -> str | None:
    """Return the model of a table, with a hyphen where it has an underscore."""
    if needed:
        table.require("model", f"write one of {', '.join(_MODELS)}")
    given = table.values.get("model")
    if isinstance(given, str) and given.replace("_", "-") in (*_PLAIN, *_MODELS):
        return given.replace("_", "-")
    return table.read_choice("model", _MODELS if needed else (*_PLAIN, *_MODELS))


def _read_branch(table: Section, model: str) -> Branch | tuple[Stop, ...] | None:
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
        elif not key.many:
            values[key.name] = table.read_float(key.name, key.unit, key.allowed)
        elif isinstance(given := table.get(key.name), list):
            read = [table.read_float(key.name, key.unit, key.allowed, k) for k in range(len(given))]
            values[key.name] = tuple(read)
        else:
            text = f"expected a list of {what}, got {table.show(key.name)}"
            table.refuse("robot.wrong-type", key.name, text)
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


_CATALOGUE = ("K1", "K2", "K3", "T1", "T2")


def read_elasticity(section: Section) -> Elasticity | None:
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
    stops = [Stop(threshold=at, stiffness=k) for at, k in entries]
    # The branches of the model beside the spring and of `branch` tables; stops are among them.
    model = _read_model(table, needed=False)
    found: list[Branch | tuple[Stop, ...] | None] = []
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
        knees = tuple(Knee(threshold=at, slope=slope or 0.0) for at, slope in entries)
        if symmetric and "knees" not in table.values:
            text = "it mirrors knees, and there are none; write knees or leave it out"
            table.refuse_key("robot.elasticity-mixed", "symmetric", text)
        if symmetric:
            knees = (*(Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(knees)), *knees)
    if cubic and "knees" in table.values:
        text = "cannot be combined with knees: both harden the spring; use one of them"
        table.refuse_key("robot.elasticity-mixed", "cubic", text)
    if len(table.errors) > before:
        return None
    try:
        return Elasticity(
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
