"""Settings of a robot file: the `[log]`, `[processing]` and `[controller]` tables, both ways.

Tables of a robot file, or of settings put over it -> `LogMap`, `Processing`, `Controller`, and back. The
tables of `[settings.NAME]` are of the same form: a call that names the set has them in place of the file's.

The transmission matrix of a log is square, and invertible by a margin that the digits of a log can pass.

Supported: one column per joint, or one array for all joints; units of the closed table; motor currents by
their torque constants; an offset of zero for each joint; a controller gain for each joint, or one for all.
Not supported: a unit for each joint (give a factor for each joint instead); transmissions and gains that
depend on the position.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields, replace
from functools import partial
from typing import Any

from symid.notation import adapt_unit, get_unit_factor, suggest_units
from symid.robot.description import (
    QUANTITIES,
    Controller,
    Joint,
    JointKind,
    LogMap,
    LogQuantity,
    NamedSettings,
    Processing,
    Robot,
)
from symid.robot.exact_values import read_constant
from symid.robot.toml_values import ANY, NOT_NEGATIVE, POSITIVE, Range, Section, to_decimal

Joints = Sequence[Joint]
TransmissionMatrix = tuple[tuple[float, ...], ...]
_SINGULAR = 1e15
"""From this condition on, nothing but rounding keeps a matrix from being singular."""
_LARGEST_CONDITION = 1e6
_NONE, _LOG = "none", "log"
_ORDER = Range(low=1, high=16)
_GAIN_UNITS = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "offset": "N*m"}
SETTING_TABLES = ("log", "processing", "controller")
"""The tables of settings; a named set has one or more of them."""
_SET_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def compute_condition(rows: TransmissionMatrix) -> float | None:
    """Return |T| |T^-1| (row sums) of the matrix, rows and then columns scaled to one; None if singular."""
    import numpy as np

    matrix = np.array(rows, dtype=np.float64)
    for axis in (1, 0):
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        if not largest.all():
            return None
        matrix = matrix / largest
    condition = float(np.linalg.cond(matrix, np.inf))
    return condition if condition < _SINGULAR else None


def _read_transmission(table: Section, joints: Joints) -> TransmissionMatrix | None:
    """Return the rows of the matrix at `transmission` of the table; None where it is absent or wrong."""
    value, size = table.get("transmission"), len(joints)
    if value is None:
        return None
    lengths = [len(row) if isinstance(row, list) else -1 for row in value] if isinstance(value, list) else []
    if lengths != [size] * size:
        listed = ", ".join("no list" if length < 0 else str(length) for length in lengths)
        got = f"{len(lengths)} rows ({listed})" if isinstance(value, list) else "no list of lists"
        text = f"expected {size} rows of {size} numbers, a row for each motor and a column for each joint"
        table.refuse("robot.transmission-shape", "transmission", f"{text}; got {got}")
        return None
    found = [
        [read_constant(table, "transmission", "a number", row, column) for column in range(size)]
        for row in range(size)
    ]
    rows = tuple(tuple(entry for entry in row if entry is not None) for row in found)
    if any(len(row) < size for row in rows):
        return None
    condition = compute_condition(rows)
    if condition is None or condition > _LARGEST_CONDITION:
        text = "the matrix has no inverse: two motors turn alike, or no motor moves a joint; correct it"
        if condition is not None:
            text = f"the matrix is nearly singular (condition {condition:.2g} after scaling its rows and "
            text += "columns): two motors turn almost alike, and the joints cannot be separated; correct it"
        table.refuse("robot.transmission-singular", "transmission", text)
        return None
    for index, joint in enumerate(joints):
        gear, entry = joint.drive.gear, rows[index][index]
        if gear not in (1.0, entry):
            text = f"motor {index + 1} turns {entry:g} times per turn of joint {joint.name!r}, but its drive "
            text += f"has gear = {gear:g}; the matrix is used for logs; correct one of them"
            table.warn("robot.transmission-gear", "transmission", text, index, index)
    return rows


JOINT_DIMENSIONS = {
    "position": {JointKind.REVOLUTE: "angle", JointKind.PRISMATIC: "length"},
    "velocity": {JointKind.REVOLUTE: "angular velocity", JointKind.PRISMATIC: "velocity"},
    "acceleration": {JointKind.REVOLUTE: "angular acceleration", JointKind.PRISMATIC: "acceleration"},
    "torque": {JointKind.REVOLUTE: "torque", JointKind.PRISMATIC: "force"},
    "temperature": dict.fromkeys(JointKind, "temperature"),
}
"""The dimension of each quantity of a log, by the kind of its joint."""
# What a factor may turn into the quantity: encoder counts, sensor voltages, motor angles of a spindle.
_CONVERTIBLE = {
    "position": ("angle", "length", "voltage", "number"),
    "velocity": ("angular velocity", "velocity", "voltage", "number"),
    "acceleration": ("angular acceleration", "acceleration", "voltage", "number"),
    "torque": ("torque", "force", "voltage", "current", "number"),
    "temperature": ("temperature", "voltage", "number"),
}
_SI_UNITS = dict(zip(_CONVERTIBLE, ("rad", "rad/s", "rad/s^2", "N m", "degC"), strict=True))
for _name, _alike in (
    ("motor_position", "position"),
    ("link_position", "position"),
    ("reference", "position"),
    ("reference_velocity", "velocity"),
    ("feedforward", "torque"),
    ("load", "torque"),
):
    JOINT_DIMENSIONS[_name], _CONVERTIBLE[_name] = JOINT_DIMENSIONS[_alike], _CONVERTIBLE[_alike]


def _read_quantity(table: Section, name: str, joints: Joints, *, coupled: bool) -> LogQuantity | None:
    """Return the quantity `name` of the log; `coupled`: it has a transmission matrix, not gear ratios."""
    dimensions = JOINT_DIMENSIONS[name]
    is_position = dimensions is JOINT_DIMENSIONS["position"]
    allowed = ("columns", "unit", "factor", "side", *(("offset",) if is_position else ()))
    section = table.read_table(name, allowed)
    if section is None:
        return None
    size = len(joints)
    driven = sum(joint.actuated for joint in joints)
    counts = (1, size, *([driven] if dimensions is JOINT_DIMENSIONS["torque"] else []))
    columns: tuple[str, ...] = ()
    remedy = 'write columns = ["q1", "q2"], one for each joint, or columns = ["q"], an array'
    if section.require("columns", remedy):
        value: Any = section.values["columns"]
        names = [value] if isinstance(value, str) else value
        if not isinstance(names, list) or not all(isinstance(entry, str) for entry in names):
            text = f"expected a list of texts, got {section.show('columns')}"
            section.refuse("robot.wrong-type", "columns", text)
            names = []
        elif len(names) not in counts:
            text = f"{len(names)} columns for {size} joints; give one for each joint, or one array for all"
            section.refuse("robot.column-count", "columns", f"{text} of them")
        columns = tuple(names)
    # The SI unit, for messages; "SI" where joints differ.
    alike = next(key for key in _SI_UNITS if JOINT_DIMENSIONS[key] is dimensions)
    units = {adapt_unit(_SI_UNITS[alike], prismatic=joint.prismatic) for joint in joints}
    natural = units.pop() if len(units) == 1 else "SI"
    unit = _read_unit(section, natural)

    def read_factor(*inner: int) -> float | None:
        number = to_decimal(section.get("factor", *inner))
        if not number:
            text = f"expected a number other than 0, got {section.show('factor', *inner)}"
            section.refuse("robot.wrong-type", "factor", text, *inner)
        return float(number) if number else None

    factor = _read_each(section, "factor", size, "factors", read_factor)
    side = section.read_choice("side", ("joint", "motor")) or "joint"
    dimension = get_unit_factor(unit)[0] if unit else ""
    # A transmission may turn angles of motors into lengths: its entries have units of their own.
    free = coupled and side == "motor" and dimension in ("SI", *dimensions.values())
    wanted = {dimensions[joint.kind] for joint in joints}
    is_current, has_factor = dimension == "current", "factor" in section.values
    if unit and joints and not free and dimension not in ("SI", *(wanted if len(wanted) == 1 else ())):
        if dimension not in _CONVERTIBLE[name]:
            text = f"expected a unit of {' or '.join(sorted(wanted))}, got {section.show('unit')}"
            section.refuse("robot.wrong-unit", "unit", text)
        elif not has_factor:
            # Made of torque constants for a motor current.
            factor = compute_current_factor(joints, coupled=coupled) if is_current else None
            if factor is None:
                text = f"{section.show('unit')} needs a factor that turns it into {natural}, "
                text += "such as factor = 1.5"
                text += ", or give every joint a drive with torque_constant and gear" if is_current else ""
                section.refuse("robot.missing-factor", "unit", text)
    unstated = [joint.name for joint in joints if joint.actuated and not joint.drive.gear_stated]
    if is_current and unstated and factor and not coupled and not (has_factor and side == "joint"):
        text = f"{section.show('unit')}: currents become torques of joints by gears, and no gear is stated "
        text += f"of {', '.join(unstated)}; write gear = N in [joint.drive] (gear = 1: direct drive)"
        section.refuse("robot.missing-gear", "unit", text)
    if is_current and not has_factor:
        # Torque constants and gear ratios bring a current to the joint side, constants alone to the motor's.
        side = "motor" if coupled else "joint"
    factor, offset = factor or (1.0,), read_offset(section, size) or (0.0,)
    return LogQuantity(columns=columns, unit=unit or natural, factor=factor, side=side, offset=offset)


def _read_unit(section: Section, natural: str) -> str | None:
    """Return the unit that the table states; `natural` is the one to write, for messages."""
    section.require("unit", f'units are never guessed: write unit = "{natural}"')
    unit = section.read_text("unit")
    if unit is None:
        return None
    try:
        get_unit_factor(unit)
    except KeyError:
        near = suggest_units(unit)
        hint = f"did you mean {' or '.join(near)}?" if near else f'write the unit as in unit = "{natural}"'
        section.refuse("robot.unknown-unit", "unit", f"there is no unit {section.show('unit')}; {hint}")
        return None
    return unit


def _read_each(
    section: Section, key: str, size: int, noun: str, read: Callable[..., float | None]
) -> tuple[float, ...] | None:
    """Return what `read` gives for each index at `key`, one or all; None where one is wrong."""
    value: Any = section.get(key)
    if value is None:
        return None
    places = [(index,) for index in range(len(value))] if isinstance(value, list) else [()]
    if len(places) not in (1, size):
        text = f"{len(places)} {noun} for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", key, text)
        return None
    numbers = tuple(number for place in places if (number := read(*place)) is not None)
    return numbers if len(numbers) == len(places) else None


def read_offset(section: Section, size: int) -> tuple[float, ...] | None:
    """Return the numbers (rad or m) at `offset`, one a joint or one for all; None where one is wrong."""
    read = partial(read_constant, section, "offset", "rad or m")
    return _read_each(section, "offset", size, "offsets", read)


def compute_current_factor(joints: Joints, *, coupled: bool) -> tuple[float, ...] | None:
    """Return the torque for each ampere (n,), of the joints, or of the motors where a matrix couples them.

    None where a torque constant is unknown.
    """
    factor = tuple(
        (1.0 if coupled else joint.drive.gear) * (joint.drive.torque_constant or 0.0)
        if joint.actuated
        else 1.0
        for joint in joints
    )
    return factor if all(factor) else None


def read_processing(root: Section) -> Processing:
    """Return the `[processing]` table, the defaults where it says nothing."""
    table = root.read_table("processing", [entry.name for entry in fields(Processing)])
    if table is None:
        return Processing(automatic=True)
    # The speed of all joints, or of each.
    speeds: float | tuple[float, ...] | None
    if isinstance(table.get("standstill"), list):
        speeds = table.read_floats("standstill", "rad/s or m/s", NOT_NEGATIVE)
    else:
        speeds = table.read_float("standstill", "rad/s or m/s", NOT_NEGATIVE, word=_NONE)
    found: dict[str, Any] = {
        "filter_order": table.read_integer("filter_order", _ORDER),
        "filter_cutoff": table.read_float("filter_cutoff", "Hz", POSITIVE, word=_NONE),
        "filter_torque": table.read_flag("filter_torque"),
        "drop_first": table.read_integer("drop_first", NOT_NEGATIVE),
        "drop_last": table.read_integer("drop_last", NOT_NEGATIVE),
        "standstill": speeds,
        "instrument_cutoff": table.read_float("instrument_cutoff", "Hz", POSITIVE, word=_NONE),
        "states": table.read_choice("states", ("position", "velocity", "acceleration")),
        "differences": table.read_choice("differences", ("central", "fourth-order")),
        "automatic": table.read_flag("automatic"),
        "noise_freedom": table.read_choice("noise_freedom", ("band", "parameters", "one")),
    }
    usual = Processing().decimation
    inner = table.read_table("decimation", [entry.name for entry in fields(usual)])
    steps: dict[str, Any] = {}
    if inner is not None:
        steps["factor"] = inner.read_integer("factor", Range(low=1, high=1000))
        steps["order"] = inner.read_integer("order", _ORDER)
        steps["ripple_db"] = inner.read_float("ripple_db", "", Range(low=0, high=3, open_low=True))
        steps["band"] = inner.read_float("band", "", Range(low=0, high=1, open_low=True))
    found, steps = ({key: x for key, x in each.items() if x is not None} for each in (found, steps))
    return Processing(**found, decimation=replace(usual, **steps))


def read_log(root: Section, joints: Joints) -> LogMap:
    """Return the `[log]` table for a robot with these joints; those that follow another have no column."""
    joints = [joint for joint in joints if joint.mimic is None]
    table = root.read_table("log", [entry.name for entry in fields(LogMap)])
    if table is None:
        return LogMap()
    if "motor_position" in table.values and "link_position" in table.values:
        text = "both motor_position and link_position: position is one of the two already; give the columns "
        text += "of the links as position and those of the motors as motor_position, or those of the motors "
        text += "as position and those of the links as link_position"
        table.refuse_key("robot.two-encoders", "link_position", text)
    time = None
    if section := table.read_table("time", ("column", "unit")):
        section.require("column", 'write column = "t"')
        column, unit = section.read_text("column"), _read_unit(section, "s")
        if unit and get_unit_factor(unit)[0] not in ("time", "SI"):
            text = f"expected a unit of time (s, ms, us), got {section.show('unit')}"
            section.refuse("robot.wrong-unit", "unit", text)
        time = LogQuantity(columns=(column or "t",), unit=unit or "s")
    coupled = "transmission" in table.values
    return LogMap(
        time=time,
        **{name: _read_quantity(table, name, joints, coupled=coupled) for name in QUANTITIES[1:]},
        transmission=_read_transmission(table, joints),
        preset=table.read_choice("preset", ("symid", "ros", "ur-rtde", "franka")),
        topic=table.read_text("topic"),
        sample_rate=table.read_float("sample_rate", "Hz", POSITIVE),
    )


def list_processing(processing: Processing) -> dict[str, Any]:
    """Return the settings as a table that `read_processing` reads back."""
    table = {key: _NONE if entry is None else entry for key, entry in asdict(processing).items()}
    stated = processing.standstill
    return {**table, "standstill": list(stated)} if isinstance(stated, tuple) else table


def list_log(log: LogMap) -> dict[str, Any]:
    """Return the map as a table that `read_log` reads back."""
    words = {"preset": log.preset, "topic": log.topic, "sample_rate": log.sample_rate}
    table: dict[str, Any] = {key: entry for key, entry in words.items() if entry is not None}
    if log.transmission is not None:
        table["transmission"] = [list(row) for row in log.transmission]
    for name in QUANTITIES:
        quantity: LogQuantity | None = getattr(log, name)
        if quantity is None:
            continue
        listed = {key: list(x) if isinstance(x, tuple) else x for key, x in asdict(quantity).items()}
        if not any(quantity.offset):
            del listed["offset"]
        is_time = name == "time"
        table[name] = {"column": quantity.columns[0], "unit": quantity.unit} if is_time else listed
    return table


def describe_settings(robot: Robot) -> dict[str, object]:
    """Return the log map and the processing as they are used, in plain types, for the echo in a result."""
    return {"log": list_log(robot.log), "processing": list_processing(robot.processing)}


def read_settings(root: Section, joints: Joints) -> tuple[LogMap, Processing, Controller | None]:
    """Return the tables of settings of a file for a robot with these joints."""
    log, processing = read_log(root, joints), read_processing(root)
    joints = [joint for joint in joints if joint.mimic is None]
    table = root.read_table("controller", [entry.name for entry in fields(Controller)])
    if table is None:
        return log, processing, None
    for key in ("stiffness", "damping"):
        table.require(key, f"write {key} = [...], one number for each joint, on the joint side")
    known = table.values.get("offset", _LOG) != _LOG
    controller = Controller(
        stiffness=_read_gains(table, "stiffness", joints, NOT_NEGATIVE),
        damping=_read_gains(table, "damping", joints, NOT_NEGATIVE),
        velocity=table.read_choice("velocity", ("error", "measured")) or "error",
        velocity_source=table.read_choice("velocity_source", ("difference", "sensor")) or "difference",
        velocity_filter=table.read_float("velocity_filter", "Hz", POSITIVE, word=_NONE),
        offset=_read_gains(table, "offset", joints, ANY, _LOG) if known else None,
        torque=table.read_choice("torque", ("command", "average")) or "command",
    )
    return log, processing, controller


def read_named_settings(root: Section, joints: Joints) -> tuple[NamedSettings, ...]:
    """Return the sets of settings in `[settings.NAME]` for a robot with these joints."""
    table = root.read_table("settings")
    if table is None:
        return ()
    found = []
    for name in table.values:
        if name in SETTING_TABLES or not _SET_NAME.fullmatch(name):
            text = "cannot name a set; use letters, digits, _ and -, a letter first"
            if name in SETTING_TABLES:
                text = f"{text}: write [settings.NAME.{name}], such as [settings.published.{name}]"
            table.refuse_key("robot.bad-name", name, text)
            continue
        section = table.read_table(name, SETTING_TABLES)
        if section is not None and not section.values:
            text = f"an empty set changes nothing; add a table, such as [settings.{name}.processing]"
            table.refuse_key("robot.missing-key", name, text)
        if section is None:
            continue
        log, processing, controller = read_settings(section, joints)
        tables: dict[str, Any] = {"log": log, "processing": processing, "controller": controller}
        stated = {key: entry for key, entry in tables.items() if key in section.values}
        found.append(NamedSettings(name=name, **stated))
    return tuple(found)


def list_controller(controller: Controller) -> dict[str, Any]:
    """Return the controller as a table that `read_settings` reads back."""
    table = asdict(controller)
    table |= {key: list(entry) for key, entry in table.items() if isinstance(entry, tuple)}
    table["velocity_filter"] = controller.velocity_filter or _NONE
    return table if controller.offset is not None else table | {"offset": _LOG}


def _read_gains(
    table: Section, key: str, joints: Joints, allowed: Range, word: str = ""
) -> tuple[float, ...]:
    """Return a number for each joint, zeros where they are wrong."""
    # Where no joint could be read, numbers are checked all the same.
    kinds = [joint.prismatic for joint in joints] or [False]
    units = [adapt_unit(_GAIN_UNITS[key], prismatic=prismatic) for prismatic in kinds]

    def read(*inner: int) -> float | None:
        return table.read_float(key, units[inner[0] if inner else 0], allowed, *inner, word=word)

    numbers = _read_each(table, key, len(joints), "numbers", read)
    if numbers is not None and len(numbers) < len(joints) and len(set(units)) > 1:
        text = "one number for joints that turn and joints that slide; give one for each joint"
        table.refuse("robot.column-count", key, text)
    numbers = numbers or (0.0,)
    return numbers if len(numbers) == len(joints) else numbers * len(joints)
