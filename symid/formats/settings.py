"""How logs are read and processed: the `[log]` and `[processing]` tables, in both directions.

Input: the tables of a robot file, or of a file overridden on the command line. Output: `LogMap` and
`Processing`; and back to plain tables, so that settings can be overridden and checked anew.

Supported: one column per joint, one array for all joints; units of the closed table.
Not supported: a unit for each joint (give a factor for each joint instead).
"""

from collections.abc import Sequence
from decimal import Decimal
from typing import Any

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
    to_decimal,
)
from symid.robot.description import Joint, JointKind
from symid.robot.log_map import Decimation, LogMap, LogQuantity, Processing
from symid.units import find_unit_factor, nearest_units

__all__ = ["list_log", "list_processing", "read_log", "read_processing"]

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
_QUANTITIES = ("time", "position", "velocity", "torque", "motor_position", "link_position")
_NATURAL = {
    "position": {JointKind.REVOLUTE: "angle", JointKind.PRISMATIC: "length"},
    "velocity": {JointKind.REVOLUTE: "angular velocity", JointKind.PRISMATIC: "velocity"},
    "torque": {JointKind.REVOLUTE: "torque", JointKind.PRISMATIC: "force"},
}
_NATURAL["motor_position"] = _NATURAL["link_position"] = _NATURAL["position"]
# What a factor may turn into the quantity: encoder counts, sensor voltages, motor angles of a spindle.
_CONVERTIBLE = {
    "position": ("angle", "length", "voltage", "number"),
    "velocity": ("angular velocity", "velocity", "voltage", "number"),
    "torque": ("torque", "force", "voltage", "current", "number"),
}
_CONVERTIBLE["motor_position"] = _CONVERTIBLE["link_position"] = _CONVERTIBLE["position"]
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
    table = read_table(root, "log", _QUANTITIES)
    if table is None:
        return LogMap()
    _refuse_both(table)
    return LogMap(
        time=_read_time(table),
        position=_read_quantity(table, "position", joints),
        velocity=_read_quantity(table, "velocity", joints),
        torque=_read_quantity(table, "torque", joints),
        motor_position=_read_quantity(table, "motor_position", joints),
        link_position=_read_quantity(table, "link_position", joints),
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
    unit = _read_unit(section, "s")
    if unit and find_unit_factor(unit)[0] not in ("time", "SI"):
        section.refuse(
            "robot.wrong-unit", "unit", f"expected a unit of time (s, ms, us), got {section.show('unit')}"
        )
    return LogQuantity(columns=(column or "t",), unit=unit or "s")


def _read_quantity(table: Section, name: str, joints: Sequence[Joint]) -> LogQuantity | None:
    section = read_table(table, name, ("columns", "unit", "factor", "side"))
    if section is None:
        return None
    columns = _read_columns(section, len(joints))
    natural = _find_natural_unit(name, joints)
    unit = _read_unit(section, natural)
    factor = _read_factor(section, len(joints))
    if unit:
        factor = _check_unit(section, name, unit, factor, joints)
    side = read_choice(section, "side", ("joint", "motor")) or "joint"
    if unit and find_unit_factor(unit)[0] == "current" and "factor" not in section.values:
        # The torque constants and gear ratios have brought the current to the joint side.
        side = "joint"
    return LogQuantity(columns=columns, unit=unit or natural, factor=factor or (1.0,), side=side)


def _find_natural_unit(name: str, joints: Sequence[Joint]) -> str:
    """Return the SI unit of a quantity, for messages; "SI" where joints differ."""
    units = {
        "angle": "rad",
        "length": "m",
        "angular velocity": "rad/s",
        "velocity": "m/s",
        "torque": "N m",
        "force": "N",
    }
    found = {units[_NATURAL[name][joint.kind]] for joint in joints}
    return found.pop() if len(found) == 1 else "SI"


def _read_columns(section: Section, size: int) -> tuple[str, ...]:
    value: Any = section.values.get("columns")
    if value is None:
        text = 'missing; write columns = ["q1", "q2"], one for each joint, or columns = ["q"], an array'
        section.refuse_key("robot.missing-key", "columns", text)
        return ()
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        section.refuse(
            "robot.wrong-type", "columns", f"expected a list of texts, got {section.show('columns')}"
        )
        return ()
    if len(names) not in (1, size):
        text = (
            f"{len(names)} columns for {size} joints; give one for each joint, or one array with all of them"
        )
        section.refuse("robot.column-count", "columns", text)
    return tuple(names)


def _read_unit(section: Section, natural: str) -> str | None:
    if "unit" not in section.values:
        section.refuse_key(
            "robot.missing-key", "unit", f'missing; units are never guessed: write unit = "{natural}"'
        )
    unit = read_text(section, "unit")
    if unit is None:
        return None
    try:
        find_unit_factor(unit)
    except KeyError:
        near = nearest_units(unit)
        hint = f"did you mean {' or '.join(near)}?" if near else f'write the unit as in unit = "{natural}"'
        section.refuse("robot.unknown-unit", "unit", f"there is no unit {section.show('unit')}; {hint}")
        return None
    return unit


def _read_factor(section: Section, size: int) -> tuple[float, ...] | None:
    value: Any = section.values.get("factor")
    if value is None:
        return None
    listed = value if isinstance(value, list) else [value]
    if len(listed) not in (1, size):
        text = f"{len(listed)} factors for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", "factor", text)
        return None
    numbers = [to_decimal(element) for element in listed]
    if not all(numbers):
        found = section.show("factor")
        section.refuse("robot.wrong-type", "factor", f"expected numbers other than 0, got {found}")
        return None
    return tuple(float(number) for number in numbers if number is not None)


def _check_unit(
    section: Section, name: str, unit: str, factor: tuple[float, ...] | None, joints: Sequence[Joint]
) -> tuple[float, ...] | None:
    """Return the factor that goes with the unit, made of torque constants for a motor current."""
    dimension = find_unit_factor(unit)[0]
    natural = {_NATURAL[name][joint.kind] for joint in joints}
    if dimension == "SI" or natural == {dimension} or not joints:
        return factor
    if dimension not in _CONVERTIBLE[name]:
        wanted = " or ".join(sorted(natural))
        section.refuse("robot.wrong-unit", "unit", f"expected a unit of {wanted}, got {section.show('unit')}")
        return factor
    if "factor" in section.values:
        return factor
    constants = [joint.drive.torque_constant for joint in joints]
    if dimension == "current" and all(constants):
        return tuple(joint.drive.gear * (joint.drive.torque_constant or 0.0) for joint in joints)
    target = _find_natural_unit(name, joints)
    text = f"{section.show('unit')} needs a factor that turns it into {target}, such as factor = 1.5"
    if dimension == "current":
        text += ", or give every joint a drive with torque_constant"
    section.refuse("robot.missing-factor", "unit", text)
    return factor


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
    table: dict[str, Any] = {}
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
    return table


def _exactly(number: float) -> Decimal:
    return Decimal(repr(number))
