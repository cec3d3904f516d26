"""What drives a joint and what gives at it: the `drive`, `spring`, `elasticity` and `[[coupling]]` tables.

Tables of a robot file -> `Drive`, `Spring`, `Elasticity`, `Coupling`.

Supported: rotor inertias on either side of the gear; elastic joints with stiffness, damping, a cubic part,
stops, knees on both sides or written for one and mirrored, catalogue values of harmonic drives; stiffnesses
and rotor inertias that are "unknown", to be identified.
Not supported: springs at a joint that are not linear; thresholds and knees that are unknown; a cubic part
together with knees.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from symid.errors import RobotError
from symid.robot.description import Coupling, Drive, JointKind, Spring
from symid.robot.elasticity import Elasticity, Knee, Stop, compute_catalogue_knees
from symid.robot.exact_values import read_fraction
from symid.robot.toml_friction import read_friction
from symid.robot.toml_values import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    read_choice,
    read_flag,
    read_number,
    read_table,
    read_text,
    refuse_unknown_keys,
    suggest_names,
)

UNKNOWN = "unknown"
"""What stands in place of a number that is to be identified."""

_UNITS = {
    "stiffness": ("N*m/rad", "N/m"),
    "rest": ("rad", "m"),
    "damping": ("N*m*s/rad", "N*s/m"),
    "cubic": ("N*m/rad^3", "N/m^3"),
    "threshold": ("rad", "m"),
    "torque": ("N*m", "N"),
}
"""Units of what springs have, at a joint that turns and at one that slides."""


def read_drive(section: Section) -> Drive:
    """Return the `drive` table of a joint."""
    drive = read_table(section, "drive", ("gear", "rotor_inertia", "rotor_inertia_side", "torque_constant"))
    if drive is None:
        return Drive()
    # The joint's own label is enough: the keys of a drive stand nowhere else.
    drive = drive.inside(drive.values, section.label)
    gear = read_number(drive, "gear", "")
    if gear == 0:
        text = "must not be 0; it is the number of motor turns per turn of the joint"
        drive.refuse("robot.out-of-range", "gear", text)
    constant = read_number(drive, "torque_constant", "N*m/A")
    ratio = float(gear or 1)
    return Drive(
        gear=ratio,
        has_rotor="rotor_inertia" in drive.values,
        rotor_inertia=_read_rotor_inertia(drive, ratio),
        torque_constant=None if constant is None else float(constant),
    )


def _read_rotor_inertia(drive: Section, gear: float) -> float | None:
    """Return the rotor inertia on the joint side, None where it is unknown."""
    side = read_choice(drive, "rotor_inertia_side", ("motor", "joint"))
    if "rotor_inertia" not in drive.values:
        if side:
            text = f'stands alone; write rotor_inertia = 1e-5 (kg*m^2) or "{UNKNOWN}", or leave it out'
            drive.refuse_key("robot.rotor-side", "rotor_inertia_side", text)
        return None
    if drive.values["rotor_inertia"] == UNKNOWN:
        return None
    value = read_number(drive, "rotor_inertia", "kg*m^2", NOT_NEGATIVE)
    if "rotor_inertia_side" not in drive.values:
        text = 'needs its side: write rotor_inertia_side = "motor" or rotor_inertia_side = "joint"'
        drive.refuse_key("robot.rotor-side", "rotor_inertia", text)
    if value is None:
        return None
    return float(value) * (gear**2 if side == "motor" else 1.0)


def read_spring(section: Section, *, prismatic: bool) -> Spring | None:
    """Return the `spring` table of a joint: tau = stiffness (q - rest)."""
    table = read_table(section, "spring", ("stiffness", "rest"))
    if table is None:
        return None
    for key, example in (("stiffness", "120"), ("rest", "0")):
        if key not in table.values:
            unit = _UNITS[key][prismatic]
            text = f'missing; write {key} = {example} ({unit}) or {key} = "{UNKNOWN}"'
            table.refuse_key("robot.missing-key", key, text)
    stiffness = read_known(table, "stiffness", _UNITS["stiffness"][prismatic], ANY)
    rest = read_known(table, "rest", _UNITS["rest"][prismatic], ANY)
    if stiffness is not None and stiffness < 0:
        text = f"{stiffness:g} pushes the joint away from rest; a spring's stiffness is positive"
        table.warn("robot.negative-stiffness", "stiffness", text)
    return Spring(stiffness=stiffness, rest=rest)


def read_known(table: Section, key: str, unit: str, allowed: Range) -> float | None:
    """Return the number at `key`; None where it is unknown or wrong."""
    if table.values.get(key) == UNKNOWN:
        return None
    value = read_number(table, key, unit, allowed)
    return None if value is None else float(value)


def read_table_array(root: Section, key: str, noun: str) -> list[Section]:
    """Return the tables of `[[key]]`, each with a label for messages; what is none is reported."""
    tables: Any = root.values.get(key)
    if tables is None:
        return []
    if not isinstance(tables, list):
        root.refuse("robot.wrong-type", key, f"expected [[{key}]] in two brackets, got {root.show(key)}")
        return []
    sections = []
    for index, table in enumerate(tables):
        if not isinstance(table, Mapping):
            # The other tables are read all the same, so that their mistakes are told too.
            text = f"expected [[{key}]] in two brackets, got {root.show(key, index)} as {noun} {index + 1}"
            root.refuse("robot.wrong-type", key, text, index)
            continue
        name = table.get("name")
        label = f"{noun} '{name}'" if isinstance(name, str) else f"{noun} {index + 1}"
        sections.append(root.inside(table, label, key, index))
    return sections


def read_couplings(
    root: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[Coupling, ...]:
    """Return the drives of the file that turn with several joints.

    Args:
        root: the whole file.
        names: of the file's joints; the indices in `terms` count these.
        kinds: of the same joints, None for a fixed one.
    """
    couplings: list[Coupling] = []
    for section in read_table_array(root, "coupling", "coupling"):
        refuse_unknown_keys(section, ("name", "terms", "rotor_inertia", "friction"))
        name = _read_name(section, [entry.name for entry in couplings])
        terms = _read_terms(section, names, kinds)
        prismatic = bool(terms) and all(kinds[index] is JointKind.PRISMATIC for index, _ in terms)
        unit = "kg" if prismatic else "kg*m^2"
        couplings.append(
            Coupling(
                name=name,
                terms=terms,
                has_rotor="rotor_inertia" in section.values,
                rotor_inertia=read_known(section, "rotor_inertia", unit, NOT_NEGATIVE),
                friction=read_friction(section, prismatic=prismatic),
            )
        )
    return tuple(couplings)


def _read_name(section: Section, taken: Sequence[str]) -> str:
    """Return the coupling's name, which ends the names of its parameters."""
    if "name" not in section.values:
        text = 'missing; write name = "m6": it ends the names of the parameters, as in IAm6'
        section.refuse_key("robot.missing-key", "name", text)
    name = read_text(section, "name")
    if name is None:
        return ""
    if not name.isidentifier() or not name.isascii():
        text = f"{section.show('name')} cannot end the name of a parameter; use letters, digits and _"
        section.refuse("robot.bad-name", "name", f"{text}, a letter first")
    elif name in taken:
        text = f"the name is taken by coupling {taken.index(name) + 1}; each coupling needs its own"
        section.refuse("robot.duplicate-coupling", "name", text)
    return name


def _read_terms(
    section: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[tuple[int, Fraction], ...]:
    if "terms" not in section.values:
        text = "missing; write terms = { joint5 = 1, joint6 = 1 }: speed = sum of factor * dq"
        section.refuse_key("robot.missing-key", "terms", text)
    table = read_table(section, "terms")
    if table is None:
        return ()
    if not table.values:
        text = "empty; write terms = { joint5 = 1, joint6 = 1 }, joints and factors"
        section.refuse("robot.missing-key", "terms", text)
    terms = []
    for name in table.values:
        factor = read_fraction(table, name, "leave the joint out: the drive does not turn with it")
        if name not in names:
            hint = suggest_names(name, names) or f"allowed are {', '.join(names)}"
            table.refuse_key("robot.unknown-joint", name, f"there is no such joint; {hint}")
        elif kinds[names.index(name)] is None:
            text = "the joint is fixed and drives nothing; name one that moves"
            table.refuse_key("robot.follows-fixed", name, text)
        elif factor is not None:
            terms.append((names.index(name), factor))
    return tuple(sorted(terms))


_ELASTICITY_KEYS = ("stiffness", "damping", "cubic", "stops", "knees", "symmetric", "catalogue")
_CATALOGUE = ("K1", "K2", "K3", "T1", "T2")


def read_elasticity(section: Section, *, prismatic: bool) -> Elasticity | None:
    """Return the `elasticity` table of a joint; a notice says what it means for functions of the robot."""
    table = read_table(section, "elasticity", _ELASTICITY_KEYS)
    if table is None:
        return None
    text = "functions of q speak of the link; friction and rotor are those of the motor, which moves apart"
    section.warn("robot.elastic-joint", "elasticity", text)
    before = len(table.report.errors)
    damping = read_number(table, "damping", _UNITS["damping"][prismatic], NOT_NEGATIVE)
    cubic = read_number(table, "cubic", _UNITS["cubic"][prismatic], NOT_NEGATIVE)
    stops = _read_stops(table, prismatic=prismatic)
    if "catalogue" in table.values:
        stiffness, knees = _read_catalogue(table, prismatic=prismatic)
    else:
        unit = _UNITS["stiffness"][prismatic]
        if "stiffness" not in table.values:
            text = f'missing; write stiffness = 1e4 ({unit}) or stiffness = "{UNKNOWN}"'
            table.refuse_key("robot.missing-key", "stiffness", text)
        stiffness = read_known(table, "stiffness", unit, POSITIVE)
        knees = _read_knees(table, prismatic=prismatic)
    if cubic and "knees" in table.values:
        text = "cannot stand beside knees: both make the joint harder; describe it by one of them"
        table.refuse_key("robot.elasticity-mixed", "cubic", text)
    if len(table.report.errors) > before:
        return None
    try:
        return Elasticity(
            stiffness=stiffness,
            damping=float(damping or 0),
            cubic=float(cubic or 0),
            stops=stops,
            knees=knees,
        )
    except RobotError as error:
        for notice in error.notices:
            table.refuse(notice.code, "knees", notice.text)
        return None


def _read_catalogue(table: Section, *, prismatic: bool) -> tuple[float | None, tuple[Knee, ...]]:
    """Return the stiffness K1 and the knees that a maker's table stands for."""
    for key in ("stiffness", "knees", "symmetric", "cubic"):
        if key in table.values:
            text = "cannot stand beside catalogue, which says stiffness and knees; leave one of them out"
            table.refuse_key("robot.elasticity-mixed", key, text)
    inner = read_table(table, "catalogue", _CATALOGUE)
    if inner is None:
        return None, ()
    values = {}
    for key in _CATALOGUE:
        unit = _UNITS["stiffness" if key[0] == "K" else "torque"][prismatic]
        number = read_number(inner, key, unit, POSITIVE)
        if key not in inner.values:
            text = (
                f"missing; catalogue = {{ {', '.join(f'{name} = ..' for name in _CATALOGUE)} }} has all five"
            )
            inner.refuse_key("robot.missing-key", key, text)
        elif number is not None:
            values[key] = float(number)
    if len(values) < len(_CATALOGUE):
        return None, ()
    if not values["T1"] < values["T2"]:
        text = f"must be greater than T1 = {values['T1']:g}, where the second slope begins"
        inner.refuse("robot.out-of-range", "T2", text)
        return None, ()
    slopes = (values["K1"], values["K2"], values["K3"])
    return values["K1"], compute_catalogue_knees(slopes, (values["T1"], values["T2"]))


def _list_entries(table: Section, key: str, example: str) -> list[Section]:
    """Return the tables of the array at `key`; what is none is reported."""
    entries: Any = table.values.get(key)
    if entries is None:
        return []
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        text = f"expected a list of tables, as in {key} = [{{ {example} }}], got {table.show(key)}"
        table.refuse("robot.wrong-type", key, text)
        return []
    return [
        table.inside(entry, f"{table.label}: {key} {index + 1}", key, index)
        for index, entry in enumerate(entries)
    ]


def _read_required(entry: Section, key: str, unit: str, allowed: Range) -> float | None:
    """Return the number at `key`; one that is missing is reported."""
    if key not in entry.values:
        text = f"missing; write {key} = a number" + (f" in {unit}" if unit else "")
        entry.refuse_key("robot.missing-key", key, text)
    number = read_number(entry, key, unit, allowed)
    return None if number is None else float(number)


def _read_stops(table: Section, *, prismatic: bool) -> tuple[Stop, ...]:
    unit = _UNITS["stiffness"][prismatic]
    stops: list[Stop] = []
    for entry in _list_entries(table, "stops", "threshold = 0.002, stiffness = 120"):
        refuse_unknown_keys(entry, ("threshold", "stiffness"))
        threshold = _read_required(entry, "threshold", _UNITS["threshold"][prismatic], POSITIVE)
        stiffness: float | None = None
        if entry.values.get("stiffness") != UNKNOWN:
            stiffness = _read_required(entry, "stiffness", unit, NOT_NEGATIVE)
        if threshold is not None:
            before = stops[-1].threshold if stops else 0.0
            if not threshold > before:
                _refuse_order(entry, before)
            stops.append(Stop(threshold=threshold, stiffness=stiffness))
    return tuple(stops)


def _read_knees(table: Section, *, prismatic: bool) -> tuple[Knee, ...]:
    symmetric = read_flag(table, "symmetric") or False
    knees: list[Knee] = []
    for entry in _list_entries(table, "knees", "threshold = 3.0, slope = 0.5"):
        refuse_unknown_keys(entry, ("threshold", "slope"))
        allowed = POSITIVE if symmetric else ANY
        threshold = _read_required(entry, "threshold", _UNITS["torque"][prismatic], allowed)
        slope = _read_required(entry, "slope", "", ANY)
        if threshold == 0:
            text = "must not be 0: the outer function has slope 1 there; change stiffness instead"
            entry.refuse("robot.out-of-range", "threshold", text)
        elif threshold is not None and slope is not None:
            if knees and not threshold > knees[-1].threshold:
                _refuse_order(entry, knees[-1].threshold)
            knees.append(Knee(threshold=threshold, slope=slope))
    if symmetric and "knees" not in table.values:
        table.refuse_key(
            "robot.elasticity-mixed", "symmetric", "stands alone; it mirrors knees, and there are none"
        )
    below = (
        [Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(knees)] if symmetric else []
    )
    return (*below, *knees)


def _refuse_order(entry: Section, before: float) -> None:
    text = f"must be greater than {before:g} before it: thresholds increase, each once"
    entry.refuse("robot.out-of-range", "threshold", text)
