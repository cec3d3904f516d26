"""How logs are read and processed: the `[log]` and `[processing]` tables, in both directions.

Input: the tables of a robot file, or of a file with settings put over it. Output: `LogMap` and
`Processing`; and back to plain tables, so that settings can be overridden and checked anew.

Supported: quantities as `log_quantities` reads them, a transmission matrix.
"""

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from symid.formats.log_quantities import read_quantity, read_unit
from symid.formats.section import (
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    read_choice,
    read_flag,
    read_integer,
    read_number,
    read_table,
    read_text,
)
from symid.formats.transmission import read_transmission
from symid.robot.description import Joint, Robot
from symid.robot.log_map import Decimation, LogMap, LogQuantity, Processing
from symid.units import find_unit_factor

__all__ = ["describe_settings", "list_log", "list_processing", "read_log", "read_processing"]

_PROCESSING = (
    "filter_order",
    "filter_cutoff",
    "filter_torque",
    "drop_first",
    "drop_last",
    "standstill",
    "noise_freedom",
    "automatic",
    "decimation",
)
_FREEDOMS = ("band", "parameters", "one")
_QUANTITIES = (
    "time",
    "position",
    "velocity",
    "torque",
    "motor_position",
    "link_position",
    "reference",
    "reference_velocity",
    "feedforward",
)
_TRANSMISSION = "transmission"
_PRESETS = ("symid", "ros", "ur-rtde", "franka")
_NONE = "none"
_HIGHEST_ORDER = Range(low=1, high=16)
_LARGEST_RIPPLE = 3.0
_LARGEST_FACTOR = 1000


def read_processing(root: Section) -> Processing:
    """Return the `[processing]` table, the defaults where it says nothing."""
    table = read_table(root, "processing", _PROCESSING)
    if table is None:
        return Processing(automatic=True)
    standard = Processing()
    cutoff = None
    if table.values.get("filter_cutoff") != _NONE:
        cutoff = read_number(table, "filter_cutoff", "Hz", POSITIVE)
    return Processing(
        filter_order=read_integer(table, "filter_order", _HIGHEST_ORDER) or standard.filter_order,
        filter_cutoff=None if cutoff is None else float(cutoff),
        filter_torque=bool(read_flag(table, "filter_torque")),
        drop_first=read_integer(table, "drop_first", NOT_NEGATIVE) or 0,
        drop_last=read_integer(table, "drop_last", NOT_NEGATIVE) or 0,
        standstill=float(read_number(table, "standstill", "rad/s or m/s", NOT_NEGATIVE) or 0),
        automatic=bool(read_flag(table, "automatic")),
        noise_freedom=read_choice(table, "noise_freedom", _FREEDOMS) or standard.noise_freedom,
        decimation=_read_decimation(table),
    )


def _read_decimation(table: Section) -> Decimation:
    inner = read_table(table, "decimation", ("factor", "order", "ripple_db", "band"))
    standard = Decimation()
    if inner is None:
        return standard
    ripple = read_number(inner, "ripple_db", "", Range(low=0, high=_LARGEST_RIPPLE, open_low=True))
    band = read_number(inner, "band", "", Range(low=0, high=1, open_low=True))
    return Decimation(
        factor=read_integer(inner, "factor", Range(low=1, high=_LARGEST_FACTOR)) or standard.factor,
        order=read_integer(inner, "order", _HIGHEST_ORDER) or standard.order,
        ripple_db=float(ripple or standard.ripple_db),
        band=float(band or standard.band),
    )


def read_log(root: Section, joints: Sequence[Joint]) -> LogMap:
    """Return the `[log]` table for a robot with these joints; those that follow another have no column."""
    joints = [joint for joint in joints if joint.mimic is None]
    table = read_table(root, "log", (*_QUANTITIES, _TRANSMISSION, "preset"))
    if table is None:
        return LogMap()
    _refuse_both(table)
    coupled = _TRANSMISSION in table.values
    return LogMap(
        time=_read_time(table),
        **{name: read_quantity(table, name, joints, coupled=coupled) for name in _QUANTITIES[1:]},
        transmission=read_transmission(table, joints),
        preset=read_choice(table, "preset", _PRESETS),
    )


def _refuse_both(table: Section) -> None:
    if "motor_position" in table.values and "link_position" in table.values:
        text = (
            "both motor_position and link_position: position is one of the two already; give the columns of "
            "the links as position and those of the motors as motor_position, or those of the motors as "
            "position and those of the links as link_position"
        )
        table.refuse_key("robot.two-encoders", "link_position", text)


def _read_time(table: Section) -> LogQuantity | None:
    section = read_table(table, "time", ("column", "unit"))
    if section is None:
        return None
    if "column" not in section.values:
        section.refuse_key("robot.missing-key", "column", 'missing; write column = "t"')
    column = read_text(section, "column")
    unit = read_unit(section, "s")
    if unit and find_unit_factor(unit)[0] not in ("time", "SI"):
        section.refuse(
            "robot.wrong-unit", "unit", f"expected a unit of time (s, ms, us), got {section.show('unit')}"
        )
    return LogQuantity(columns=(column or "t",), unit=unit or "s")


def list_processing(processing: Processing) -> dict[str, Any]:
    """Return the settings as a table that `read_processing` reads back."""
    decimation = processing.decimation
    return {
        "filter_order": processing.filter_order,
        "filter_cutoff": _NONE if processing.filter_cutoff is None else _exactly(processing.filter_cutoff),
        "filter_torque": processing.filter_torque,
        "drop_first": processing.drop_first,
        "drop_last": processing.drop_last,
        "standstill": _exactly(processing.standstill),
        "noise_freedom": processing.noise_freedom,
        "automatic": processing.automatic,
        "decimation": {
            "factor": decimation.factor,
            "order": decimation.order,
            "ripple_db": _exactly(decimation.ripple_db),
            "band": _exactly(decimation.band),
        },
    }


def list_log(log: LogMap) -> dict[str, Any]:
    """Return the map as a table that `read_log` reads back."""
    table: dict[str, Any] = {} if log.preset is None else {"preset": log.preset}
    if log.transmission is not None:
        table[_TRANSMISSION] = [[_exactly(entry) for entry in row] for row in log.transmission]
    for name in _QUANTITIES:
        quantity: LogQuantity | None = getattr(log, name)
        if quantity is None:
            continue
        if name == "time":
            table[name] = {"column": quantity.columns[0], "unit": quantity.unit}
            continue
        table[name] = {
            "columns": list(quantity.columns),
            "unit": quantity.unit,
            "factor": [_exactly(number) for number in quantity.factor],
            "side": quantity.side,
        }
        if any(quantity.offset):
            table[name]["offset"] = [_exactly(number) for number in quantity.offset]
    return table


def describe_settings(robot: Robot) -> dict[str, object]:
    """Return the log map and the processing as they are used, in plain types, for the echo in a result."""
    return {"log": _simplify(list_log(robot.log)), "processing": _simplify(list_processing(robot.processing))}


def _simplify(value: object) -> object:
    """Return `value` with the reader's decimal numbers as floats."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case Mapping():
            return {str(key): _simplify(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_simplify(entry) for entry in value]
    return float(str(value))


def _exactly(number: float) -> Decimal:
    return Decimal(repr(number))
