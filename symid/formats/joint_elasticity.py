"""What gives between motor and link: the `elasticity` table of a joint.

Input: the joint's table. Output: `Elasticity`.

Supported: stiffness, damping, a cubic part, stops, knees on both sides or written for one and mirrored,
catalogue values of harmonic drives; stiffnesses that are "unknown", to be identified.
Not supported: thresholds and knees that are unknown; a cubic part together with knees.
"""

from collections.abc import Mapping
from typing import Any

from symid.errors import RobotError
from symid.formats.joint_drives import UNKNOWN, find_spring_unit, read_known
from symid.formats.section import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    read_flag,
    read_number,
    read_table,
    refuse_unknown_keys,
)
from symid.robot.catalogue_stiffness import find_catalogue_knees
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = ["find_elasticity_unit", "read_elasticity"]

_KEYS = ("stiffness", "damping", "cubic", "stops", "knees", "symmetric", "catalogue")
_CATALOGUE = ("K1", "K2", "K3", "T1", "T2")
_UNITS = {
    "damping": ("N*m*s/rad", "N*s/m"),
    "cubic": ("N*m/rad^3", "N/m^3"),
    "threshold": ("rad", "m"),
    "torque": ("N*m", "N"),
}


def find_elasticity_unit(key: str, *, prismatic: bool) -> str:
    """Return the unit of an entry as robot files write it; "torque" stands for the threshold of a knee."""
    if key == "stiffness":
        return find_spring_unit(key, prismatic=prismatic)
    return _UNITS[key][prismatic]


def read_elasticity(section: Section, *, prismatic: bool) -> Elasticity | None:
    """Return the `elasticity` table of a joint; a notice says what it means for functions of the robot."""
    table = read_table(section, "elasticity", _KEYS)
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
        stiffness = _read_stiffness(table, prismatic=prismatic)
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


def _read_stiffness(table: Section, *, prismatic: bool) -> float | None:
    unit = find_spring_unit("stiffness", prismatic=prismatic)
    if "stiffness" not in table.values:
        text = f'missing; write stiffness = 1e4 ({unit}) or stiffness = "{UNKNOWN}"'
        table.refuse_key("robot.missing-key", "stiffness", text)
    return read_known(table, "stiffness", unit, POSITIVE)


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
        unit = (
            find_spring_unit("stiffness", prismatic=prismatic)
            if key[0] == "K"
            else "N"
            if prismatic
            else "N*m"
        )
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
    return values["K1"], find_catalogue_knees(slopes, (values["T1"], values["T2"]))


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
        Section(
            values=entry,
            path=(*table.path, key, index),
            report=table.report,
            label=f"{table.label}: {key} {index + 1}",
        )
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
    unit = find_spring_unit("stiffness", prismatic=prismatic)
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
