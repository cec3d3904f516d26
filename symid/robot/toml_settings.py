"""Settings of a robot file: the `[log]`, `[processing]` and `[controller]` tables, both ways.

How logs are read and processed, and which controller the joints have. Tables of a robot file, or of a file
with settings put over it -> `LogMap`, `Processing`, `Controller`; and
back to plain tables, so that settings can be overridden and checked anew.

The transmission matrix T of a log, for motors that move more than one joint, is square and invertible by a
margin that the digits of a log can pass (condition with rows and columns scaled to one):

    angles of the motors = T (angles of the joints),   torques of the joints = T' (torques of the motors)

Supported: one column per joint, or one array for all joints; units of the closed table; motor currents by
their torque constants; an offset of zero for each joint; a controller gain for each joint, or one for all.
Not supported: a unit for each joint (give a factor for each joint instead); transmissions and gains that
depend on the position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from decimal import Decimal
from typing import Any

from symid.notation import get_unit_factor, suggest_units
from symid.robot.description import (
    Controller,
    Decimation,
    Joint,
    JointKind,
    LogMap,
    LogQuantity,
    Processing,
    Robot,
)
from symid.robot.exact_values import read_constant
from symid.robot.toml_values import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Range,
    Section,
    explain_number,
    get_element,
    read_choice,
    read_flag,
    read_integer,
    read_number,
    read_table,
    read_text,
    to_decimal,
)

TransmissionMatrix = tuple[tuple[float, ...], ...]


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


_SINGULAR = 1e15
"""From this condition on, nothing but rounding keeps a matrix from being singular."""
_LARGEST_CONDITION = 1e6


def read_transmission(table: Section, joints: Sequence[Joint]) -> TransmissionMatrix | None:
    """Return the rows of the matrix at `transmission` of the table; None where it is absent or wrong."""
    value = table.values.get("transmission")
    if value is None:
        return None
    size = len(joints)
    good = isinstance(value, list) and len(value) == size
    if not good or not all(isinstance(row, list) and len(row) == size for row in value):
        text = f"expected {size} rows of {size} numbers, a row for each motor and a column for each joint"
        table.refuse("robot.transmission-shape", "transmission", f"{text}; got {_describe_shape(value)}")
        return None
    found = [
        [read_constant(table, "transmission", "a number", row, column) for column in range(size)]
        for row in range(size)
    ]
    rows = tuple(tuple(entry for entry in row if entry is not None) for row in found)
    if any(len(row) < size for row in rows):
        return None
    if not _check_rank(table, rows):
        return None
    _compare_gears(table, rows, joints)
    return rows


def _describe_shape(value: object) -> str:
    if not isinstance(value, list):
        return "no list of lists"
    lengths = [str(len(row)) if isinstance(row, list) else "no list" for row in value]
    return f"{len(value)} rows ({', '.join(lengths)})"


def _check_rank(table: Section, rows: TransmissionMatrix) -> bool:
    condition = compute_condition(rows)
    if condition is None:
        text = "the matrix has no inverse: two motors turn alike, or a joint is moved by none; correct it"
    elif condition > _LARGEST_CONDITION:
        text = (
            f"the matrix is nearly singular (condition {condition:.2g} after scaling its rows and columns): "
            "two motors turn almost alike, and the joints cannot be told apart; correct it"
        )
    else:
        return True
    table.refuse("robot.transmission-singular", "transmission", text)
    return False


def _compare_gears(table: Section, rows: TransmissionMatrix, joints: Sequence[Joint]) -> None:
    """Warn where a drive states another gear ratio than the matrix has for its motor."""
    for index, joint in enumerate(joints):
        gear, entry = joint.drive.gear, rows[index][index]
        if gear not in (1.0, entry):
            text = (
                f"motor {index + 1} turns {entry:g} times per turn of joint {joint.name!r}, its drive says "
                f"gear = {gear:g}; logs follow the matrix; correct one of them"
            )
            table.warn("robot.transmission-gear", "transmission", text, index, index)


_POSITIONS = ("position", "motor_position", "link_position", "reference")

JOINT_DIMENSIONS = {
    "position": {JointKind.REVOLUTE: "angle", JointKind.PRISMATIC: "length"},
    "velocity": {JointKind.REVOLUTE: "angular velocity", JointKind.PRISMATIC: "velocity"},
    "torque": {JointKind.REVOLUTE: "torque", JointKind.PRISMATIC: "force"},
}
# Quantities that are read like another one.
_READ_LIKE = {
    "motor_position": "position",
    "link_position": "position",
    "reference": "position",
    "reference_velocity": "velocity",
    "feedforward": "torque",
}
JOINT_DIMENSIONS |= {name: JOINT_DIMENSIONS[other] for name, other in _READ_LIKE.items()}
"""The dimension of each quantity of a log, by the kind of its joint."""

# What a factor may turn into the quantity: encoder counts, sensor voltages, motor angles of a spindle.
_CONVERTIBLE = {
    "position": ("angle", "length", "voltage", "number"),
    "velocity": ("angular velocity", "velocity", "voltage", "number"),
    "torque": ("torque", "force", "voltage", "current", "number"),
}
_CONVERTIBLE |= {name: _CONVERTIBLE[other] for name, other in _READ_LIKE.items()}
_TURNED = {name: ("SI", *kinds.values()) for name, kinds in JOINT_DIMENSIONS.items()}


def read_quantity(
    table: Section, name: str, joints: Sequence[Joint], *, coupled: bool = False
) -> LogQuantity | None:
    """Return the quantity `name` of the `[log]` table; None where it is absent.

    Args:
        table: the `[log]` table.
        name: "position", "velocity", "torque", "motor_position", "link_position", "reference",
            "reference_velocity" or "feedforward".
        joints: those that have a coordinate of their own.
        coupled: whether the log has a transmission matrix, in place of gear ratios.
    """
    allowed = ("columns", "unit", "factor", "side", *(("offset",) if name in _POSITIONS else ()))
    section = read_table(table, name, allowed)
    if section is None:
        return None
    columns = _read_columns(section, len(joints))
    natural = _get_natural_unit(name, joints)
    unit = read_unit(section, natural)
    factor = _read_factor(section, len(joints))
    side = read_choice(section, "side", ("joint", "motor")) or "joint"
    # A transmission may turn angles of motors into lengths: its entries have units of their own.
    if unit and not (coupled and side == "motor" and get_unit_factor(unit)[0] in _TURNED[name]):
        factor = _check_unit(section, name, unit, factor, joints, coupled=coupled)
    if unit and get_unit_factor(unit)[0] == "current" and "factor" not in section.values:
        # Torque constants and gear ratios bring a current to the joint side, constants alone to the motor's.
        side = "motor" if coupled else "joint"
    return LogQuantity(
        columns=columns,
        unit=unit or natural,
        factor=factor or (1.0,),
        side=side,
        offset=read_offset(section, len(joints)) or (0.0,),
    )


def _get_natural_unit(name: str, joints: Sequence[Joint]) -> str:
    """Return the SI unit of a quantity, for messages; "SI" where joints differ."""
    units = {
        "angle": "rad",
        "length": "m",
        "angular velocity": "rad/s",
        "velocity": "m/s",
        "torque": "N m",
        "force": "N",
    }
    found = {units[JOINT_DIMENSIONS[name][joint.kind]] for joint in joints}
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


def read_unit(section: Section, natural: str) -> str | None:
    """Return the unit that the table states; `natural` is the one to write, for messages."""
    if "unit" not in section.values:
        section.refuse_key(
            "robot.missing-key", "unit", f'missing; units are never guessed: write unit = "{natural}"'
        )
    unit = read_text(section, "unit")
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


def _list_for_joints(section: Section, key: str, size: int, noun: str) -> list[Any] | None:
    """Return the entries at `key`, one for each joint or one for all; None without any, or with too many."""
    value: Any = section.values.get(key)
    if value is None:
        return None
    listed = value if isinstance(value, list) else [value]
    if len(listed) not in (1, size):
        text = f"{len(listed)} {noun} for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", key, text)
        return None
    return listed


def _read_factor(section: Section, size: int) -> tuple[float, ...] | None:
    numbers = [to_decimal(entry) for entry in _list_for_joints(section, "factor", size, "factors") or ()]
    if not all(numbers):
        found = section.show("factor")
        section.refuse("robot.wrong-type", "factor", f"expected numbers other than 0, got {found}")
        return None
    return tuple(float(number) for number in numbers if number is not None)


def read_offset(section: Section, size: int) -> tuple[float, ...] | None:
    """Return the numbers (rad or m) at `offset`, one a joint or one for all; None where one is wrong."""
    listed = _list_for_joints(section, "offset", size, "offsets") or ()
    several = isinstance(section.values.get("offset"), list)
    found = [
        read_constant(section, "offset", "rad or m", *([index] if several else ()))
        for index in range(len(listed))
    ]
    good = tuple(number for number in found if number is not None)
    return good if len(good) == len(found) else None


def compute_current_factor(joints: Sequence[Joint], *, coupled: bool) -> tuple[float, ...] | None:
    """Return the torque for each ampere (n,), of the joints, or of the motors where a matrix couples them.

    None where a torque constant is unknown.
    """
    factor = tuple(
        (1.0 if coupled else joint.drive.gear) * (joint.drive.torque_constant or 0.0) for joint in joints
    )
    return factor if all(factor) else None


def _check_unit(
    section: Section,
    name: str,
    unit: str,
    factor: tuple[float, ...] | None,
    joints: Sequence[Joint],
    *,
    coupled: bool,
) -> tuple[float, ...] | None:
    """Return the factor that goes with the unit, made of torque constants for a motor current."""
    dimension = get_unit_factor(unit)[0]
    natural = {JOINT_DIMENSIONS[name][joint.kind] for joint in joints}
    if dimension == "SI" or natural == {dimension} or not joints:
        return factor
    if dimension not in _CONVERTIBLE[name]:
        wanted = " or ".join(sorted(natural))
        section.refuse("robot.wrong-unit", "unit", f"expected a unit of {wanted}, got {section.show('unit')}")
        return factor
    if "factor" in section.values:
        return factor
    torques = compute_current_factor(joints, coupled=coupled) if dimension == "current" else None
    if torques is not None:
        return torques
    target = _get_natural_unit(name, joints)
    text = f"{section.show('unit')} needs a factor that turns it into {target}, such as factor = 1.5"
    if dimension == "current":
        text += ", or give every joint a drive with torque_constant"
    section.refuse("robot.missing-factor", "unit", text)
    return factor


_FREEDOMS = ("band", "parameters", "one")
_QUANTITIES = tuple(entry.name for entry in fields(LogMap) if entry.name not in ("transmission", "preset"))
_TRANSMISSION = "transmission"
_PRESETS = ("symid", "ros", "ur-rtde", "franka")
_NO_FILTER = "none"
_HIGHEST_ORDER = Range(low=1, high=16)
_LARGEST_RIPPLE = 3.0
_LARGEST_FACTOR = 1000


def read_processing(root: Section) -> Processing:
    """Return the `[processing]` table, the defaults where it says nothing."""
    table = read_table(root, "processing", [entry.name for entry in fields(Processing)])
    if table is None:
        return Processing(automatic=True)
    standard = Processing()
    cutoff = None
    if table.values.get("filter_cutoff") != _NO_FILTER:
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
    if unit and get_unit_factor(unit)[0] not in ("time", "SI"):
        section.refuse(
            "robot.wrong-unit", "unit", f"expected a unit of time (s, ms, us), got {section.show('unit')}"
        )
    return LogQuantity(columns=(column or "t",), unit=unit or "s")


def list_processing(processing: Processing) -> dict[str, Any]:
    """Return the settings as a table that `read_processing` reads back."""
    table = _build_table(processing)
    return table | {"filter_cutoff": table["filter_cutoff"] or _NO_FILTER}


def _build_table(record: Processing | Decimation | Controller) -> dict[str, Any]:
    return {entry.name: _exactly(getattr(record, entry.name)) for entry in fields(record)}


def _exactly(value: Any) -> Any:  # noqa: ANN401  (what a setting may be)
    """Return a setting as the reader has it: numbers as decimals, records as tables."""
    if isinstance(value, float):
        return Decimal(repr(value))
    if isinstance(value, tuple):
        return [_exactly(entry) for entry in value]
    return _build_table(value) if isinstance(value, Decimation) else value


def list_log(log: LogMap) -> dict[str, Any]:
    """Return the map as a table that `read_log` reads back."""
    table: dict[str, Any] = {} if log.preset is None else {"preset": log.preset}
    if log.transmission is not None:
        table[_TRANSMISSION] = _exactly(log.transmission)
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
            "factor": _exactly(quantity.factor),
            "side": quantity.side,
        }
        if any(quantity.offset):
            table[name]["offset"] = _exactly(quantity.offset)
    return table


def describe_settings(robot: Robot) -> dict[str, object]:
    """Return the log map and the processing as they are used, in plain types, for the echo in a result."""
    return {"log": _simplify(list_log(robot.log)), "processing": _simplify(list_processing(robot.processing))}


def _simplify(value: Any) -> Any:  # noqa: ANN401  (a setting as the reader has it)
    """Return `value` with the reader's decimal numbers as floats."""
    if isinstance(value, Mapping):
        return {key: _simplify(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_simplify(entry) for entry in value]
    return float(value) if isinstance(value, Decimal) else value


_CONTROLLER_CHOICES = {
    "velocity": ("error", "measured"),
    "velocity_source": ("difference", "sensor"),
    "torque": ("command", "average"),
}
_NONE, _LOG = "none", "log"
_CONTROLLER_UNITS = {
    "stiffness": {JointKind.REVOLUTE: "N*m/rad", JointKind.PRISMATIC: "N/m"},
    "damping": {JointKind.REVOLUTE: "N*m*s/rad", JointKind.PRISMATIC: "N*s/m"},
    "offset": {JointKind.REVOLUTE: "N*m", JointKind.PRISMATIC: "N"},
}


def read_controller(root: Section, joints: Sequence[Joint]) -> Controller | None:
    """Return the `[controller]` table for a robot with these joints; None where there is none."""
    joints = [joint for joint in joints if joint.mimic is None]
    table = read_table(root, "controller", [entry.name for entry in fields(Controller)])
    if table is None:
        return None
    for key in ("stiffness", "damping"):
        if key not in table.values:
            text = f"missing; write {key} = [...], one number for each joint, on the joint side"
            table.refuse_key("robot.missing-key", key, text)
    chosen = {key: read_choice(table, key, allowed) for key, allowed in _CONTROLLER_CHOICES.items()}
    cutoff = None
    if table.values.get("velocity_filter") != _NONE:
        cutoff = read_number(table, "velocity_filter", "Hz", POSITIVE)
    known = table.values.get("offset", _LOG) != _LOG
    return Controller(
        stiffness=_read_each(table, "stiffness", joints, NOT_NEGATIVE),
        damping=_read_each(table, "damping", joints, NOT_NEGATIVE),
        velocity=chosen["velocity"] or "error",
        velocity_source=chosen["velocity_source"] or "difference",
        velocity_filter=None if cutoff is None else float(cutoff),
        offset=_read_each(table, "offset", joints, ANY) if known else None,
        torque=chosen["torque"] or "command",
    )


def list_controller(controller: Controller) -> dict[str, Any]:
    """Return the controller as a table that `read_controller` reads back."""
    table = _build_table(controller)
    return table | {
        "velocity_filter": table["velocity_filter"] or _NONE,
        "offset": _LOG if controller.offset is None else table["offset"],
    }


def _read_each(table: Section, key: str, joints: Sequence[Joint], allowed: Range) -> tuple[float, ...]:
    """Return a number for each joint, zeros where they are wrong."""
    listed = _list_for_joints(table, key, len(joints), "numbers")
    if listed is None:
        return (0.0,) * len(joints)
    units = [_CONTROLLER_UNITS[key][joint.kind] for joint in joints]
    if len(listed) < len(joints) and len(set(units)) > 1:
        text = "one number for joints that turn and joints that slide; give one for each joint"
        table.refuse("robot.column-count", key, text)
    numbers = [_read_one(table, key, index, allowed, unit) for index, unit in enumerate(units[: len(listed)])]
    return tuple(numbers) if len(numbers) == len(joints) else tuple(numbers) * len(joints)


def _read_one(table: Section, key: str, index: int, allowed: Range, unit: str) -> float:
    """Return the number at `index` of the list at `key`, or the one that stands for all joints."""
    inner = (index,) if isinstance(table.values[key], list) else ()
    value = get_element(table, key, *inner)
    number = to_decimal(value)
    if number is None:
        extra = f' or "{_LOG}"' if key == "offset" else ""
        got = f"got {table.show(key, *inner)}{explain_number(value, unit)}"
        text = f"expected a number in {unit}{extra}, {got}"
        table.refuse("robot.wrong-type", key, text, *inner)
    elif number not in allowed:
        text = f"must be {allowed} {unit}, got {table.show(key, *inner)}"
        table.refuse("robot.out-of-range", key, text, *inner)
    return 0.0 if number is None else float(number)
