"""Column headings: which column is which quantity of which joint, and in which unit.

RawLog, the joints that have a coordinate, names and units that the user gives -> columns of each
quantity, LogQuantity; mistakes and assumptions go into the findings.

    "waist angle [deg]", "waist_angle_deg", "WaistAngle (deg)" -> position of the joint waist, in deg

Words are what stands between signs, digits and a change to capitals; case does not matter. One word names
the quantity, or else the unit does; words such as "actual" say nothing; what is left must be the name of
a joint, a number, or nothing.

Supported: the words of the tables below; one column for each joint, by its name or by numbers in order;
one array with all joints; every unit of the closed table that the quantity can have; units that differ
from joint to joint; currents by torque constants and gears.
Not supported: other words, which name no quantity; columns without a unit, for none is guessed; a
quantity that one joint has no column of, or two: that is a mistake, never a choice.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from symid.logs.columns import Findings, describe_missing_column, join_names
from symid.logs.files import RawLog
from symid.notation import UNITS, get_unit_factor, suggest_units
from symid.robot import Joint, JointKind, LogQuantity, compute_current_factor

_QUANTITY_WORDS = {
    "time": ("t", "time", "timestamp", "stamp", "clock"),
    "position": ("q", "pos", "position", "angle"),
    "velocity": ("dq", "qdot", "vel", "velocity", "speed"),
    "torque": ("tau", "torque", "trq", "effort", "force", "current", "cur", "curr", "i"),
}
_CURRENTS = frozenset({"current", "cur", "curr", "i"})
_FILLER_WORDS = frozenset({"joint", "axis", "actual", "act", "measured", "meas", "value"})
_COMMANDED_WORDS = frozenset(
    {
        "target",
        "cmd",
        "command",
        "commanded",
        "desired",
        "des",
        "ref",
        "reference",
        "setpoint",
        "goal",
        "wanted",
    }
)
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_]+")
_PARENTHESES = re.compile(r"(.*\S)\s*\(([^()]+)\)")

QUANTITY_DIMENSIONS = {
    "time": ("time",),
    "position": ("angle", "length"),
    "velocity": ("angular velocity", "velocity"),
    "torque": ("torque", "force", "current"),
}
"""Dimensions of the units that columns of a quantity may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """What a column is called, and what that says.

    Args:
        column: its name in the log.
        quantity: "time", "position", "velocity", "torque", or "" where nothing says it.
        words: what is left of the name; that of a joint, a number, or nothing.
        unit: as stated, None where it is not.
        wanted: whether it holds what was asked for, not what was measured.
        size: number of columns, where it is an array.
    """

    column: str
    quantity: str
    words: tuple[str, ...] = ()
    unit: str | None = None
    wanted: bool = False
    size: int = 1

    @property
    def number(self) -> int | None:
        """Return the number that is left of the name, if nothing else is."""
        return int(self.words[0]) if len(self.words) == 1 and self.words[0].isdecimal() else None

    def names(self, joint: Joint) -> bool:
        """Return whether what is left of the name is the name of `joint`."""
        return bool(self.words) and self.words == _drop_filler_words(_list_words(joint.name))


def read_headings(raw: RawLog, joints: Sequence[Joint]) -> tuple[Heading, ...]:
    """Return what the headings of all columns say, in the order of the log."""
    own = {word for joint in joints for word in _drop_filler_words(_list_words(joint.name))}
    return tuple(_read_heading(raw, column, own) for column in raw.columns)


def _read_heading(raw: RawLog, column: str, own: set[str]) -> Heading:
    """Return what a heading says; words of joints' names are theirs, whatever else they could mean."""
    name, unit = _split_unit(column, raw.units.get(column), own)
    words = _list_words(name)
    said = [word for word in words if word not in own and _get_quantity(word)]
    quantities = {_get_quantity(word) for word in said}
    of_unit = _get_quantity_of_unit(unit)
    quantity = quantities.pop() if len(quantities) == 1 else "" if quantities else of_unit
    # A current is that of a motor by nature; a position or torque of a motor is not that of the joint.
    silent = {"motor"} if _CURRENTS & set(said) or (not said and _is_current(unit)) else set()
    left = tuple(word for word in words if word not in said and word not in silent)
    array = raw.columns[column]
    return Heading(
        column=column,
        quantity=quantity,
        words=_drop_filler_words(tuple(word for word in left if word not in _COMMANDED_WORDS or word in own)),
        unit=unit,
        wanted=bool((_COMMANDED_WORDS - own) & set(left)),
        size=array.shape[1] if array.ndim > 1 else 1,
    )


def _split_unit(column: str, stated: str | None, own: set[str]) -> tuple[str, str | None]:
    """Return name and unit: in brackets, else in parentheses, else behind the last underscore.

    Of a joint A, tau_A is the torque, and no current in ampere.
    """
    if stated is not None:
        return column, stated
    match = _PARENTHESES.fullmatch(column)
    if match:
        return match[1], match[2].strip()
    name, sign, unit = column.rpartition("_")
    # q_1 is the joint 1, no number without a unit.
    stands = unit in UNITS and not unit.isdecimal() and unit.lower() not in own
    return (name, unit) if sign and name and stands else (column, None)


def _list_words(name: str) -> tuple[str, ...]:
    return tuple(word.lower() for word in _SPLIT.findall(name))


def _drop_filler_words(words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(str(int(word)) if word.isdecimal() else word for word in words if word not in _FILLER_WORDS)


def _get_quantity(word: str) -> str:
    return next((quantity for quantity, words in _QUANTITY_WORDS.items() if word in words), "")


def _get_quantity_of_unit(unit: str | None) -> str:
    """Return the only quantity that a unit can be of."""
    try:
        dimension = get_unit_factor(unit or "")[0]
    except KeyError:
        return ""
    return next((quantity for quantity, known in QUANTITY_DIMENSIONS.items() if dimension in known), "")


def _is_current(unit: str | None) -> bool:
    return unit in UNITS and UNITS[unit or ""][0] == "current"


REQUIRED_QUANTITIES = ("time", "position", "torque")
"""Quantities that a log must have."""


def choose_columns(
    headings: Sequence[Heading], quantity: str, joints: Sequence[Joint], findings: Findings
) -> tuple[str, ...]:
    """Return the columns of a quantity, one for each joint or one array; none where that is not certain.

    Args:
        headings: those of all columns.
        quantity: what is looked for.
        joints: those that have a coordinate of their own.
        findings: take a mistake where a log needs the quantity.
    """
    size = 1 if quantity == "time" else len(joints)
    own = [entry for entry in headings if entry.quantity == quantity and not entry.wanted]
    plain = [entry.column for entry in own if not entry.words and entry.size == size]
    single = [entry for entry in own if entry.size == 1]
    if quantity == "time" or len(plain) == 1:
        hits = [plain]
    elif size == 1:
        hits = [[*plain, *(hit for entry in _sort_by_joint(single, joints, findings) for hit in entry)]]
    else:
        hits = _sort_by_joint(single, joints, findings)
    if all(len(hit) == 1 for hit in hits):
        return tuple(hit[0] for hit in hits)
    if quantity in REQUIRED_QUANTITIES:
        _refuse_columns(headings, quantity, joints, hits, findings)
    return ()


def _sort_by_joint(
    headings: Sequence[Heading], joints: Sequence[Joint], findings: Findings
) -> list[list[str]]:
    """Return for each joint the columns that are its own: by its name, else by numbers in order.

    A column that is one joint's by its name and another's by its number stands at both: nobody can tell.
    """
    named = [[entry.column for entry in headings if entry.names(joint)] for joint in joints]
    counted = _count_columns(headings, len(joints))
    if any(named):
        if all(len(hit) == 1 for hit in (*named, *counted)) and sorted(named) == sorted(counted):
            return _merge_columns(named, counted)
        return named
    if counted and all(len(hit) == 1 for hit in counted):
        numbered = _match_numbers(headings, joints)
        if numbered != counted and all(len(hit) == 1 for hit in numbered):
            return _merge_columns(numbered, counted)
        first = min(entry.number for entry in headings if entry.number is not None)
        pairs = ", ".join(f"{first + index} is {joint.name!r}" for index, joint in enumerate(joints))
        text = f"numbers in the names of columns count the joints in the order of the robot file: {pairs}"
        # Position, velocity and torque are mostly numbered alike: once is enough.
        if text not in {remark.text for remark in findings.remarks}:
            findings.remark("new.assumed-order", text)
    return counted or named


def _merge_columns(first: Sequence[Sequence[str]], second: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return for each joint the columns of both."""
    return [list(dict.fromkeys((*mine, *other))) for mine, other in zip(first, second, strict=True)]


def _match_numbers(headings: Sequence[Heading], joints: Sequence[Joint]) -> list[list[str]]:
    """Return the columns of the last number in each joint's name, such as 3 of wrist_j3; none without one."""
    found = [re.findall(r"\d+", joint.name)[-1:] for joint in joints]
    return [
        [entry.column for entry in headings if number and entry.number == int(number[0])] for number in found
    ]


def _count_columns(headings: Sequence[Heading], size: int) -> list[list[str]]:
    """Return the columns of each number, if all numbers from 0 or 1 on are there; else none."""
    numbers = sorted({entry.number for entry in headings if entry.number is not None})
    first = numbers[0] if numbers else 0
    if first > 1 or numbers != list(range(first, first + size)):
        return []
    return [[entry.column for entry in headings if entry.number == first + index] for index in range(size)]


def check_columns(
    known: Sequence[str], quantity: str, names: tuple[str, ...], joints: Sequence[Joint], findings: Findings
) -> tuple[str, ...]:
    """Return the names that the user gave; none, and mistakes noted, where the log has no such columns.

    Args:
        known: names of all columns.
        quantity: what the names are given for.
        names: one for each joint, or one for all.
        joints: those that have a coordinate of their own.
        findings: take the mistakes.
    """
    missing = [name for name in names if name not in known]
    for name in missing:
        findings.refuse("new.no-column", f"--columns {quantity}: {describe_missing_column(name, known)}")
    if len(names) not in ({1} if quantity == "time" else {1, len(joints)}):
        size = (
            "one"
            if quantity == "time"
            else f"one for each of {_list_joints(joints)}, or one array with all of them"
        )
        findings.refuse("new.column-count", f"--columns {quantity}: {len(names)} columns; give {size}")
        return ()
    return () if missing else names


def _list_joints(joints: Sequence[Joint]) -> str:
    return join_names(tuple(joint.name for joint in joints))


def _refuse_columns(
    headings: Sequence[Heading],
    quantity: str,
    joints: Sequence[Joint],
    hits: Sequence[Sequence[str]],
    findings: Findings,
) -> None:
    """Say which joints have no column of a quantity, or more than one, and what to write."""
    alone = len(hits) != len(joints) or quantity == "time"
    owners = [quantity] if alone else [f"{quantity} of joint {joint.name!r}" for joint in joints]
    pairs = list(zip(owners, hits, strict=True))
    double = [f"{owner} could be {' or '.join(map(repr, hit))}" for owner, hit in pairs if len(hit) > 1]
    lacking = [owner for owner, hit in pairs if not hit]
    parts = [*double, *([f"no column was recognised as {' or '.join(lacking)}"] if lacking else [])]
    example = (
        "NAME" if quantity == "time" else ",".join(f"NAME_{number}" for number in range(1, len(joints) + 1))
    )
    order = "" if quantity == "time" else f" (the columns of {_list_joints(joints)})"
    there = join_names(tuple(entry.column for entry in headings))
    text = f"{'; '.join(parts)}: give --columns {quantity}={example}{order}; the log has {there}"
    if lacking and len(lacking) < len(owners):
        text += "; joints at the end of a URDF that the log leaves out are cut by --tip LINK"
    findings.refuse("new.ambiguous-column" if double else "new.unknown-column", text)


_EXAMPLES = {"time": "s", "position": "deg", "velocity": "deg/s", "torque": "Nm"}
_LIKE = {"reference_velocity": "velocity", "feedforward": "torque"}
_LINEAR = frozenset({"length", "velocity", "force"})
_ANGULAR = frozenset({"angle", "angular velocity", "torque"})


def build_quantity(
    quantity: str,
    names: tuple[str, ...],
    stated: Mapping[str, str],
    joints: Sequence[Joint],
    findings: Findings,
) -> LogQuantity | None:
    """Return the quantity of columns; None, and mistakes noted, where units are missing or do not fit.

    Args:
        quantity: which one.
        names: its columns, one for each joint or one for all.
        stated: units by name of column.
        joints: those that have a coordinate of their own.
        findings: take the mistakes.
    """
    like = quantity if quantity in QUANTITY_DIMENSIONS else _LIKE.get(quantity, "position")
    silent = tuple(name for name in names if name not in stated)
    if silent:
        example = _EXAMPLES[like]
        text = f"{quantity}: no unit is stated for {join_names(silent)}, and none is guessed"
        remedy = (
            f"write it into the heading, as in {silent[0]} [{example}], or give --units {quantity}={example}"
        )
        findings.refuse("new.no-unit", f"{text}: {remedy}, whichever it is")
        return None
    units = tuple(stated[name] for name in names)
    if not _check_units(quantity, like, list(zip(names, units, strict=True)), joints, findings):
        return None
    dimensions = {get_unit_factor(unit)[0] for unit in units}
    if "current" in dimensions:
        return _build_current_quantity(quantity, names, units, joints, findings)
    if len(set(units)) == 1:
        return LogQuantity(columns=names, unit=units[0])
    return LogQuantity(columns=names, unit="SI", factor=tuple(get_unit_factor(unit)[1] for unit in units))


def _list_possible(like: str, kind: JointKind) -> tuple[str, ...]:
    """Return the dimensions that a quantity of such a joint can be logged in."""
    other = _LINEAR if kind is JointKind.REVOLUTE else _ANGULAR
    return tuple(dimension for dimension in QUANTITY_DIMENSIONS[like] if dimension not in other)


def _check_units(
    quantity: str, like: str, pairs: Sequence[tuple[str, str]], joints: Sequence[Joint], findings: Findings
) -> bool:
    """Return whether all units are in the table, and of a dimension that the quantity can have."""
    texts, numbers = [], []
    for index, joint in enumerate(joints):
        name, unit = pairs[index if len(pairs) > 1 else 0]
        possible = _list_possible(like, joint.kind)
        known = ", ".join(entry for entry in UNITS if UNITS[entry][0] in possible)
        try:
            dimension = get_unit_factor(unit)[0]
        except KeyError:
            near = suggest_units(unit)
            hint = f"did you mean {' or '.join(near)}?" if near else f"known are {known}"
            texts.append(f"{quantity}: {name!r} is in {unit!r}, which is no unit; {hint}")
            continue
        if dimension == "number":
            numbers.append(name)
        elif dimension not in (*possible, "SI"):
            texts.append(
                f"{quantity}: {name!r} is in {unit!r}, a unit of {dimension}; expected one of {known}"
            )
    remedy = f"give --units {quantity}=UNIT, or --columns {quantity}=NAME,... if it is another column"
    for text in dict.fromkeys(texts):
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    if numbers:
        named = tuple(dict.fromkeys(numbers))
        text = (
            f"{quantity}: {join_names(named)}: of what they are parts, or how much one count is, is not known"
        )
        remedy = f"give --units {quantity}=SI, then write factor = [...] behind it in [log] of the robot file"
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    return not texts and not numbers


def _build_current_quantity(
    quantity: str, names: tuple[str, ...], units: tuple[str, ...], joints: Sequence[Joint], findings: Findings
) -> LogQuantity | None:
    """Return currents with the factors that torque constants and gears make of them."""
    lacking = tuple(joint.name for joint in joints if joint.drive.torque_constant is None)
    if len(set(units)) > 1:
        text = f"{quantity}: {join_names(names)} are in different units: {', '.join(units)}"
        findings.refuse("new.mixed-units", f"{text}; log all of them in one, or as torques")
    if lacking:
        text = f"{quantity}: {join_names(names)} are motor currents, and no torque constant is known of"
        findings.refuse("new.torque-constant", f"{text} {join_names(lacking)}: {ask_constants(joints)}")
    if lacking or len(set(units)) > 1:
        return None
    factor = compute_current_factor(joints, coupled=False) or (1.0,)
    return LogQuantity(columns=names, unit=units[0], factor=factor)


def ask_constants(joints: Sequence[Joint]) -> str:
    """Return what to give so that currents become torques."""
    listed = ",".join(f"K{number}" for number in range(1, len(joints) + 1))
    names = join_names(tuple(joint.name for joint in joints))
    return (
        f"give --torque-constant {listed} (N m/A at the motor, of {names}), and --gear where there are gears "
        "that the file does not state"
    )
