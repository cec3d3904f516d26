"""Column headings: which column is which quantity of which joint, and in which unit.

RawLog, joints, names and units that the user gives -> columns of each quantity, LogQuantity, findings.

    "waist angle [deg]", "waist_angle_deg", "WaistAngle (deg)" -> position of the joint waist, in deg

One word names the quantity, or else the unit does; words such as "actual" are ignored; the rest is the name
of a joint, a number, or nothing.

Supported: the words of the tables below; one column for each joint, by name or by numbers in order, or one
array; units that differ from joint to joint; currents by torque constants and gears.
Not supported: columns without a unit, which is never guessed; a joint with no column of a quantity, or two.
"""

import re
from collections.abc import Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace

from symid.logs.columns import Findings, describe_missing_column, join_names, look_up_unit
from symid.logs.files import RawLog
from symid.notation import UNITS, get_unit_factor, suggest_units
from symid.robot import QUANTITIES, Joint, JointKind, LogMap, LogQuantity, Robot, compute_current_factor

_QUANTITY_WORDS = {
    "time": ("t", "time", "timestamp", "stamp", "clock"),
    "position": ("q", "pos", "position", "angle"),
    "velocity": ("dq", "qd", "qdot", "vel", "velocity", "speed"),
    "torque": ("tau", "torque", "trq", "effort", "force", "current", "cur", "curr", "i"),
}
_QUANTITIES = {word: quantity for quantity, words in _QUANTITY_WORDS.items() for word in words}
_CURRENTS = frozenset({"current", "cur", "curr", "i"})
_FILLER_WORDS = frozenset("joint axis actual act measured meas msr state value".split())  # noqa: SIM905
_NUMBERED = frozenset({"j", "a"})
"""Words before the number of an axis: tau_J_0, A1."""
_INDEX = re.compile(r"\[\d+\]$")
_KUKA_POSITION = ("axis", "act")
"""Words of KUKA's variable $AXIS_ACT, which names no quantity."""
_COMMANDED_WORDS = frozenset(
    "target cmd command commanded desired des ref reference setpoint goal wanted".split()  # noqa: SIM905
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
    """The name of a column, and what it means.

    Args:
        quantity: "time", "position", "velocity", "torque", or "" if unknown.
        words: the rest of the name; that of a joint, a number, or nothing.
        commanded: whether it is not measured; size: number of columns of an array.
        indexed: whether it is an element of an array, such as q[0]: its number counts, and names no joint.
    """

    column: str
    quantity: str
    words: tuple[str, ...] = ()
    unit: str | None = None
    commanded: bool = False
    size: int = 1
    indexed: bool = False

    @property
    def number(self) -> int | None:
        """Return the number that is the rest of the name."""
        known = bool(self.words) and self.words[-1].isdecimal() and set(self.words[:-1]) <= _NUMBERED
        return int(self.words[-1]) if known else None

    def names(self, joint: Joint) -> bool:
        """Return whether the rest of the name is the name of `joint`."""
        own = _drop_filler_words(_list_words(joint.name))
        return bool(self.words) and self.words == own and not self.indexed


def read_headings(raw: RawLog, joints: Sequence[Joint]) -> tuple[Heading, ...]:
    """Return the headings of all columns, in the order of the log."""
    own = {word for joint in joints for word in _drop_filler_words(_list_words(joint.name))}
    names = {joint.name for joint in joints}
    return tuple(_read_heading(raw, column, own, names) for column in raw.columns)


def _read_heading(raw: RawLog, column: str, own: set[str], names: set[str]) -> Heading:
    """Return a heading; the words `own` of joints' names have no other meaning."""
    # The unit stands in brackets, else in parentheses, else behind the last underscore.
    name, unit = column, raw.units.get(column)
    match = _PARENTHESES.fullmatch(column)
    if unit is None and match:
        name, unit = match[1], match[2].strip()
    elif unit is None:
        start, sign, end = column.rpartition("_")
        # q_1 is the joint 1, no number without a unit; of a joint A, tau_A is no current in ampere.
        stands = end in UNITS and not end.isdecimal() and end.lower() not in own
        name, unit = (start, end) if sign and start and stands else (column, None)
    # Behind the topic of a ROS message stand a joint and a field, or a field.
    parts = name.split("/")
    words = _list_words("/".join(parts[next((k for k, part in enumerate(parts) if part in names), -1) :]))
    known = {word: _QUANTITIES[word] for word in words if word not in own and word in _QUANTITIES}
    quantities = set(known.values())
    if not quantities and words[:2] == _KUKA_POSITION and not own & set(words[:2]):
        quantities = {"position"}
    # The only quantity that the unit can be of.
    found = look_up_unit(unit or "")
    dimension = found[0] if found else None
    of_unit = next((key for key, possible in QUANTITY_DIMENSIONS.items() if dimension in possible), "")
    quantity = quantities.pop() if len(quantities) == 1 else "" if quantities else of_unit
    # A current is that of a motor by nature; a position or torque of a motor is not that of the joint.
    silent = {"motor"} if _CURRENTS & set(known) or (not known and dimension == "current") else set()
    left = tuple(word for word in words if word not in known and word not in silent)
    array = raw.columns[column]
    return Heading(
        column=column,
        quantity=quantity,
        words=_drop_filler_words(tuple(word for word in left if word not in _COMMANDED_WORDS or word in own)),
        unit=unit,
        commanded=is_commanded(name, own),
        size=array.shape[1] if array.ndim > 1 else 1,
        indexed=bool(_INDEX.search(name)),
    )


def is_commanded(name: str, own: AbstractSet[str] = frozenset()) -> bool:
    """Return whether a name has a word of commands that is not in those of joints, `own`."""
    return bool((_COMMANDED_WORDS - own) & set(_list_words(name)))


def _list_words(name: str) -> tuple[str, ...]:
    return tuple(word.lower() for word in _SPLIT.findall(name))


def _drop_filler_words(words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(str(int(word)) if word.isdecimal() else word for word in words if word not in _FILLER_WORDS)


REQUIRED_QUANTITIES = ("time", "position", "torque")
"""Quantities that a log must have."""


def choose_columns(
    headings: Sequence[Heading], quantity: str, joints: Sequence[Joint], findings: Findings
) -> tuple[str, ...]:
    """Return the columns of a quantity, one a joint or one array; none if ambiguous."""
    size = 1 if quantity == "time" else len(joints)
    own = [entry for entry in headings if entry.quantity == quantity and not entry.commanded]
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
        alone = len(hits) != len(joints) or quantity == "time"
        owners = [quantity] if alone else [f"{quantity} of joint {joint.name!r}" for joint in joints]
        pairs = list(zip(owners, hits, strict=True))
        double = [f"{owner} could be {' or '.join(map(repr, hit))}" for owner, hit in pairs if len(hit) > 1]
        lacking = [owner for owner, hit in pairs if not hit]
        parts = [*double, *([f"no column was recognised as {' or '.join(lacking)}"] if lacking else [])]
        example, order = "NAME", ""
        if quantity != "time":
            example = ",".join(f"NAME_{number}" for number in range(1, len(joints) + 1))
            order = f" (the columns of {join_names(joint.name for joint in joints)})"
        there = join_names(entry.column for entry in headings)
        text = f"{'; '.join(parts)}: give --columns {quantity}={example}{order}; the log has {there}"
        if lacking and len(lacking) < len(owners):
            text += "; if the log leaves out the last joints of a URDF, cut them off by --tip LINK"
        findings.refuse("new.ambiguous-column" if double else "new.unknown-column", text)
    return ()


def _sort_by_joint(
    headings: Sequence[Heading], joints: Sequence[Joint], findings: Findings
) -> list[list[str]]:
    """Return the columns of each joint, by name, else by numbers in order; ambiguous ones for both joints."""
    named = [[entry.column for entry in headings if entry.names(joint)] for joint in joints]
    # The columns of each number, if all numbers from 0 or 1 on are there.
    numbers = sorted({entry.number for entry in headings if entry.number is not None})
    counted = [[entry.column for entry in headings if entry.number == number] for number in numbers]
    if not numbers or numbers[0] > 1 or numbers != list(range(numbers[0], numbers[0] + len(joints))):
        counted = []
    whole = all(len(hit) == 1 for hit in named)
    alone = bool(counted) and all(len(hit) == 1 for hit in counted)
    if whole and alone and sorted(named) == sorted(counted):
        return _merge_columns(named, counted)
    if whole and numbers[:1] == [0]:
        # Columns one number below those of joints' names are theirs; not where a joint's name begins with 0,
        # too, or the columns have no numbers.
        claimed = {entry.column: entry.number for entry in headings if [entry.column] in named}
        below = {column: number - 1 for column, number in claimed.items() if number}
        if len(below) < len(claimed):
            return _merge_columns(named, [[] for _ in named])
        before = [[entry.column for entry in headings if entry.number == below[hit[0]]] for hit in named]
        return _merge_columns(named, before)
    # Numbers may be an order, though some joints have a column by their name: the others have none, and
    # numbers begin with 0, or name the same columns: q7 of `gripper` behind `joint6`.
    alike = all(not mine or mine == other for mine, other in zip(named, counted, strict=alone))
    among = {name for hit in named for name in hit} <= {name for hit in counted for name in hit}
    order = alone and not all(named) and among and (numbers[0] == 0 or alike)
    if any(named) and not order:
        return named
    if alone:
        # The last number in each joint's name, such as 3 of wrist_j3.
        ends = [re.findall(r"\d+", joint.name)[-1:] for joint in joints]
        numbered = [[one.column for one in headings if end and one.number == int(end[0])] for end in ends]
        if numbered != counted and all(len(hit) == 1 for hit in numbered):
            return _merge_columns(numbered, counted)
        describe_order(tuple(zip(numbers, joints, strict=True)), findings)
    return counted or named


def describe_order(pairs: Sequence[tuple[int, Joint]], findings: Findings) -> None:
    """Note which joint each number is taken for."""
    listed = ", ".join(f"{k} is {joint.name!r}" for k, joint in pairs)
    text = f"numbers in column names are taken as the order of joints in the robot file: {listed}"
    # Position, velocity and torque are mostly numbered alike: once is enough.
    if text not in {remark.text for remark in findings.remarks}:
        findings.remark("new.assumed-order", text)


def note_other_numbers(columns: Sequence[str], joints: Sequence[Joint], findings: Findings) -> None:
    """Note the order of numbered columns, one a joint, where joints' names have other numbers than these.

    Nothing is noted if names count from one, or as the columns do, or if all have the same number. Where some
    joints have none, only names such as joint1 count, not wrist_1.
    """
    numbers = [int(match[0]) for match in (re.search(r"\d+(?=\]?$)", name) for name in columns) if match]
    ends = [[int(entry) for entry in re.findall(r"\d+", joint.name)[-1:]] for joint in joints]
    if not all(ends):
        words = [_drop_filler_words(_list_words(joint.name)) for joint in joints]
        ends = [end if set(own[:-1]) <= _NUMBERED else [] for end, own in zip(ends, words, strict=True)]
    alike = [
        all(not end or end[0] == k for end, k in zip(ends, counted, strict=False))
        for counted in (range(1, len(joints) + 1), numbers)
    ]
    stated = [end[0] for end in ends if end]
    same = len(stated) > 1 and len(set(stated)) == 1
    if len(numbers) == len(joints) and not any(alike) and not same:
        describe_order(tuple(zip(numbers, joints, strict=True)), findings)


def _merge_columns(first: Sequence[Sequence[str]], second: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return for each joint the columns of both."""
    return [list(dict.fromkeys((*mine, *other))) for mine, other in zip(first, second, strict=True)]


_EXAMPLES = {"time": "s", "position": "deg", "velocity": "deg/s", "torque": "Nm"}
_LIKE = {"reference_velocity": "velocity", "feedforward": "torque"}
_LINEAR = frozenset({"length", "velocity", "force"})
_ANGULAR = frozenset({"angle", "angular velocity", "torque"})


def build_quantity(
    quantity: str, names: tuple[str, ...], stated: dict[str, str], joints: Sequence[Joint], findings: Findings
) -> LogQuantity | None:
    """Return the quantity of columns; None, and mistakes noted, where units are missing or do not fit."""
    like = quantity if quantity in QUANTITY_DIMENSIONS else _LIKE.get(quantity, "position")
    silent = tuple(name for name in names if name not in stated)
    if silent:
        example = _EXAMPLES[like]
        text = f"{quantity}: no unit is stated for {join_names(silent)}"
        remedy = f"write it into the heading, as in {silent[0]} [{example}], or give --units {quantity}=UNIT"
        findings.refuse("new.no-unit", f"{text}; {remedy}")
        return None
    units = tuple(stated[name] for name in names)
    pairs = list(zip(names, units, strict=True))
    texts, numbers = [], []
    for index, joint in enumerate(joints):
        name, unit = pairs[index if len(pairs) > 1 else 0]
        other = _LINEAR if joint.kind is JointKind.REVOLUTE else _ANGULAR
        possible = tuple(dimension for dimension in QUANTITY_DIMENSIONS[like] if dimension not in other)
        known = ", ".join(entry for entry in UNITS if UNITS[entry][0] in possible)
        found = look_up_unit(unit)
        if found is None:
            near = suggest_units(unit)
            hint = f"did you mean {' or '.join(near)}?" if near else f"known are {known}"
            texts.append(f"{quantity}: {name!r} has the unknown unit {unit!r}; {hint}")
        elif found[0] == "number":
            numbers.append(name)
        elif found[0] not in (*possible, "SI"):
            text = f"{quantity}: {name!r} is in {unit!r}, a unit of {found[0]}"
            texts.append(f"{text}; expected one of {known}")
    remedy = f"give --units {quantity}=UNIT, or --columns {quantity}=NAME,... if it is another column"
    for text in dict.fromkeys(texts):
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    if numbers:
        text = f"{quantity}: the size of one count of {join_names(dict.fromkeys(numbers))} is not known"
        remedy = f"give --units {quantity}=SI, then write factor = [...] behind it in [log] of the robot file"
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    if texts or numbers:
        return None
    alike = len(set(units)) == 1
    if "current" not in {get_unit_factor(unit)[0] for unit in units}:
        if alike:
            return LogQuantity(columns=names, unit=units[0])
        return LogQuantity(columns=names, unit="SI", factor=tuple(get_unit_factor(unit)[1] for unit in units))
    # Currents become torques by torque constants and gears.
    lacking = describe_lacking(joints)
    if not alike:
        text = f"{quantity}: {join_names(names)} are in different units: {', '.join(units)}"
        findings.refuse("new.mixed-units", f"{text}; log all of them in one, or as torques")
    if lacking:
        text = f"{quantity}: {join_names(names)} are motor currents, and {lacking}"
        findings.refuse("new.torque-constant", f"{text}: {ask_constants(joints)}")
    if lacking or not alike:
        return None
    factor = compute_current_factor(joints, coupled=False) or (1.0,)
    return LogQuantity(columns=names, unit=units[0], factor=factor)


def describe_lacking(joints: Sequence[Joint], *, geared: bool = True) -> str:
    """Return what drives lack that makes currents torques of joints, or of motors if not `geared`."""
    drives = [(joint.name, joint.drive) for joint in joints if joint.actuated]
    lacking = {
        "torque constant": [name for name, drive in drives if drive.torque_constant is None],
        "gear": [name for name, drive in drives if geared and not drive.gear_stated],
    }
    return " and ".join(
        f"no {what} is stated of {join_names(names)}" for what, names in lacking.items() if names
    )


def ask_constants(joints: Sequence[Joint]) -> str:
    """Return what to give so that currents become torques."""
    listed = ",".join(f"K{number}" for number in range(1, len(joints) + 1))
    names = join_names(joint.name for joint in joints)
    return (
        f"give --torque-constant {listed} (N m/A at the motor, of {names}), and --gear N,... (motor turns "
        "per joint turn; --gear 1: direct drives), those of them that are not stated"
    )


Names = Mapping[str, tuple[str, ...]]
"""Names of columns, or units, by quantity."""


def propose_quantities(
    raw: RawLog, robot: Robot, columns: Names, units: Names, findings: Findings
) -> tuple[dict[str, LogQuantity], Names]:
    """Return all quantities that the headings or the user name, and the units as stated."""
    headings, known = read_headings(raw, robot.axes), tuple(raw.columns)
    found: dict[str, LogQuantity] = {}
    shown: dict[str, tuple[str, ...]] = {}
    for quantity in dict.fromkeys((*REQUIRED_QUANTITIES, "velocity", *columns)):
        if quantity in columns:
            names, option = columns[quantity], f"--columns {quantity}"
            missing = [name for name in names if name not in raw.columns]
            for name in missing:
                findings.refuse("new.no-column", f"{option}: {describe_missing_column(name, known)}")
            if len(names) not in ({1} if quantity == "time" else {1, robot.freedom}):
                listed = join_names(joint.name for joint in robot.axes)
                size = f"one for each of {listed}, or one array with all of them"
                size = "one" if quantity == "time" else size
                findings.refuse("new.column-count", f"{option}: {len(names)} columns; give {size}")
                names = ()
            names = () if missing else names
        else:
            names = choose_columns(headings, quantity, robot.axes, findings)
        stated = {entry.column: entry.unit for entry in headings if entry.unit is not None}
        given = units.get(quantity, ()) if names else ()
        if len(given) not in {0, 1, len(names)}:
            text = f"--units {quantity}: {len(given)} units for {join_names(names)}"
            findings.refuse("new.unit-count", f"{text}; give one for each column, or one for all")
            names = ()
        elif given:
            stated = dict(zip(names, given * len(names) if len(given) == 1 else given, strict=True))
        joints = robot.axes[:1] if quantity == "time" else robot.axes
        entry = build_quantity(quantity, names, stated, joints, findings) if names else None
        if entry is not None:
            found[quantity] = entry
            each = tuple(stated[name] for name in names)
            shown[quantity] = each[:1] if len(set(each)) == 1 else each
    owners: dict[str, str] = {}
    for quantity, name in ((key, name) for key, entry in found.items() for name in entry.columns):
        if name in owners:
            text = f"column {name!r} would be {owners[name]} and {quantity}; give each column once"
            findings.refuse("new.column-twice", text)
        owners[name] = quantity
    for quantity in units:
        if quantity not in (*found, *REQUIRED_QUANTITIES, *columns):
            text = f"--units {quantity}: the log has no known column of {quantity}; name them"
            text = f"{text} with --columns {quantity}=NAME,..., or leave it out"
            findings.refuse("new.unit-of-nothing", text)
    return found, shown


def list_quantities(log: LogMap) -> dict[str, LogQuantity]:
    """Return the quantities of a map by their names."""
    return {name: entry for name in QUANTITIES if (entry := getattr(log, name)) is not None}


def fill_map(log: LogMap, read: Mapping[str, LogQuantity]) -> LogMap:
    """Return a map with the quantities of `read` in place of its own."""
    return replace(log, **read)  # type: ignore[arg-type]  # the keys are those of quantities
