"""The tables of a joint that moves: `drive`, `friction`, `limits`, `spring`; `[[coupling]]`.

Supported: rotor inertias on either side of the gear; every friction law of the catalogue, with all values
or none where they are unknown, and a speed over which dry friction changes its sign; laws with a state,
whose bristles or elements must be known; stiffnesses and rotor inertias that are "unknown", to be
identified. Springs between motor and link are read by `toml_elasticity`.
Not supported: springs at a joint that are not linear; unknown shape values.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from symid.errors import UsageError
from symid.joint_models import (
    FRICTION_LAWS,
    NO_FRICTION,
    REFERENCE_TEMPERATURE,
    STATE_LAWS,
    FrictionLaw,
    FrictionValues,
    compute_friction_torque,
    fix_exponent,
    free_exponent,
    get_friction_law,
    get_law,
    has_sign,
    name_shape,
    name_values,
)
from symid.notation import adapt_unit
from symid.robot.description import Coupling, Drive, Joint, JointKind, Limits, Spring
from symid.robot.exact_values import read_fraction
from symid.robot.toml_elasticity import UNKNOWN, read_elasticity
from symid.robot.toml_values import NOT_NEGATIVE, POSITIVE, Range, Section, explain_wide_limits, suggest_names

_EXPONENT = Range(low=0, high=10, open_low=True)
FRICTION_PARTS = tuple(dict.fromkeys(entry.name for law in FRICTION_LAWS.values() for entry in law.linear))
"""Names of the linear values of all laws."""
_SHAPES = tuple(dict.fromkeys(entry.name for law in FRICTION_LAWS.values() for entry in law.shape))
_MEMORIES = tuple(dict.fromkeys(entry.name for law in STATE_LAWS.values() for entry in law.memory))
_CONSTANT = ("offset", "Fp")
_LARGEST_GAP = 1e-6
"""By which the shares of elements may differ from one in sum."""
_DEFAULT_GAMMA = 2.0
# The speeds at which curves are evaluated: a hundred a decade.
_SLOWEST, _FASTEST, _SPEED_COUNT = 1e-9, 1e6, 1500


def _read_friction(section: Section, fastest: float = math.inf, *, shared: bool = False) -> FrictionValues:
    """Return the friction of a joint's or drive's table, up to the speed `fastest`; none without one.

    `shared`: of a drive of several joints, or a joint that follows another one.
    """
    table = section.read_table("friction")
    if table is None:
        return FrictionValues()
    table.require("model", 'write model = "coulomb-viscous"')
    model = table.read_text("model")
    law = None
    if model is not None and model != NO_FRICTION:
        try:
            law = get_law(model)
        except UsageError as error:
            table.refuse("robot.friction-model", "model", error.notices[0].text)
    # An exponent may be stated beside the model, and then is part of the law's name.
    free = None if law is None else free_exponent(law)
    gamma = None if free is None else table.read_float("gamma", "", _EXPONENT)
    if free is not None and gamma is not None and gamma != _DEFAULT_GAMMA:
        law = get_law(fix_exponent(free, gamma))
    smoothing = table.read_float("smoothing", "rad/s", POSITIVE)
    entries = [entry for one in FRICTION_LAWS.values() for entry in one.linear] if law is None else law.linear
    units = {entry.name: entry.unit.replace(" ", "*") for entry in reversed(entries)}
    names = tuple(dict.fromkeys(entry.name for entry in entries))
    given = {name: table.read_float(name, units[name]) for name in names}
    if law is None:
        if model == NO_FRICTION:
            _check_keys(table, NO_FRICTION, (), (), has_step=False)
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
    _check_keys(table, law.name, names, known, has_step=has_sign(law) and not law.memory)
    if shared and (law.inputs != ("velocity",) or law.memory):
        what = "bristles" if law.memory else " and the ".join(law.inputs[1:])
        text = (
            f'"{law.name}" depends on the {what} of one joint, and this friction '
            "acts on several; choose a model of the velocity alone"
        )
        table.refuse("robot.friction-model", "model", text)
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


def _read_bristles(table: Section, law: FrictionLaw) -> tuple[float, ...]:
    """Return the values of a law's state in its order, one list after another; empty where one is missing."""
    lists = []
    for entry in law.memory:
        unit = "" if entry.unit == "1" else entry.unit.replace(" ", "*")
        in_unit = adapt_unit(unit, prismatic=table.prismatic)
        allowed = NOT_NEGATIVE if entry.lower_is_allowed else POSITIVE
        given, what = table.get(entry.name), f" in {in_unit}" if in_unit else ""
        if not law.elements:
            table.require(entry.name, f"the model's state needs it as a number{what}")
            value = table.read_float(entry.name, unit, allowed)
            lists.append([] if value is None else [value])
        elif isinstance(given, list) and given:
            read = (table.read_float(entry.name, unit, allowed, k) for k in range(len(given)))
            found = [value for value in read if value is not None]
            lists.append(found if len(found) == len(given) else [])
        else:
            table.require(entry.name, f"the model's state needs a list of numbers{what}, one an element")
            if given is not None:
                text = f"expected a list of numbers{what}, one an element, got {table.show(entry.name)}"
                table.refuse("robot.wrong-type", entry.name, text)
            lists.append([])
    if law.elements and all(lists):
        stiffness, share = lists
        if len(stiffness) != len(share):
            text = f"{len(share)} numbers for the {len(stiffness)} of stiffness; write one of each an element"
            table.refuse("robot.friction-elements", "share", text)
        elif abs(math.fsum(share) - 1.0) > _LARGEST_GAP:
            text = f"the shares of all elements must have the sum 1, got {math.fsum(share):.7g}"
            table.refuse("robot.friction-elements", "share", text)
    return tuple(value for values in lists for value in values) if all(lists) else ()


def _check_keys(
    table: Section, law: str, wanted: Sequence[str], shape: Sequence[str], *, has_step: bool
) -> None:
    """Refuse values that the model does not have, and a part of its values in place of all."""
    code = "robot.friction-values"
    if not has_step and "smoothing" in table.values:
        nothing = "friction" if law == NO_FRICTION else "step at standstill"
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
        text = (
            f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are unknown"
        )
        table.refuse_key(code, next(name for name in wanted if name in table.values), text)


def _warn_of_driving_friction(table: Section, friction: FrictionValues, fastest: float) -> None:
    """Warn of a curve that drives the joint although no coefficient on its own does.

    It does where its least braking torques up to a speed, one way and the other, have a negative sum. Load
    and waves of the position are left out.
    """
    law, named = get_friction_law(friction), name_values(friction)
    if law is None or not named or not law.own:
        return
    if any(entry.lower == 0.0 and named[entry.name] < 0.0 for entry in law.linear):
        return
    speeds = np.geomspace(_SLOWEST, max(min(fastest, _FASTEST), _SLOWEST), _SPEED_COUNT + 1)
    values = [0.0 if name in _CONSTANT else value for name, value in named.items()]
    zero = np.zeros_like(speeds)
    inputs = {"load": zero, "position": zero, "temperature": zero + REFERENCE_TEMPERATURE}
    with np.errstate(over="ignore"):
        sides = [
            side * compute_friction_torque(law, inputs | {"velocity": side * speeds}, values, friction.shape)
            for side in (1.0, -1.0)
        ]
    pushing = np.flatnonzero(sum(map(np.minimum.accumulate, sides)) < 0.0)
    if not len(pushing):
        return
    speed, unit = float(speeds[pushing[0]]), adapt_unit("rad/s", prismatic=table.prismatic)
    start = f"from about {speed:.2g} {unit} on" if speed > _SLOWEST else "as motion begins"
    negative = (name for name, value in named.items() if value < 0.0 and name not in _CONSTANT)
    key = next(negative, next(iter(named)))
    hint = "simulation refuses that"
    if "g2" in name_shape(friction):
        key, hint = "Fm", "Fc or Fv must outweigh Fm, or g2 be at least g3"
    text = f"{named[key]:g} drives the joint {start} instead of braking it; {hint}"
    table.warn("robot.negative-friction", key, text)


_STIFFNESS = "N*m/rad"
MOVING_KEYS = ("drive", "friction", "spring", "elasticity", "limits")


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
            text = f"{stiffness:g} pushes the joint away from rest; a spring's stiffness is positive"
            table.warn("robot.negative-stiffness", "stiffness", text)
    elasticity = read_elasticity(section)
    return replace(joint, drive=drive, friction=friction, limits=limits, spring=spring, elasticity=elasticity)


def read_couplings(
    root: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[Coupling, ...]:
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
