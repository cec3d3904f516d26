"""Drafts: a `[log]` map for a log, and a robot file to be completed by hand, from a URDF, DH rows or a robot.

Robot, path of a log, columns and units by quantity -> LogMapDraft. DraftOrder -> Draft.

    preset of a known program, else: headings -> columns of each joint -> units -> LogMap

No `[processing]` is written: what it would say is chosen from each log.

Supported: what `headings` reads, names and units of the user in place of it, the presets.
Not supported: columns of motors, of second encoders and of controllers, unless the user names them.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path

from symid.dynamics import choose_reading
from symid.errors import LogError, Notice, RobotError, UsageError
from symid.joint_models import NO_FRICTION
from symid.logs.checks import check_recording
from symid.logs.columns import Findings, join_names
from symid.logs.files import RawLog
from symid.logs.headings import (
    REQUIRED_QUANTITIES,
    ask_constants,
    build_quantity,
    check_columns,
    choose_columns,
    read_headings,
)
from symid.logs.reader import apply_preset, read_raw, read_recording
from symid.logs.sampling import resample_if_uneven
from symid.notation import UNITS, get_unit_factor
from symid.robot import (
    DEFAULT_GRAVITY,
    Completion,
    LogMap,
    LogQuantity,
    Robot,
    complete_robot,
    is_urdf,
    locate_robot_file,
    parse_robot,
    read_dh_table,
    read_robot,
    read_urdf,
    suggest_names,
    to_decimal,
    write_robot,
)

QUANTITIES = tuple(entry.name for entry in fields(LogMap) if entry.name not in {"transmission", "preset"})
"""Quantities that columns can be named for."""

_PRESETS = ("ur-rtde", "franka", "ros")

NamesByQuantity = Mapping[str, str | Sequence[str]]
"""Names of columns, or units, of each quantity: a list, or a text with commas."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMapDraft:
    """The robot with the table of its log.

    Args:
        robot: with `[log]`.
        file: the log.
        read: the columns of the table, by quantity.
        units: those of the columns as stated, by quantity; one where all are alike.
        unused: the other columns of the log.
        assumed: notices on what was assumed.
        warnings: what is suspicious in the log, read so.
    """

    robot: Robot
    file: Path
    read: Mapping[str, LogQuantity]
    units: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...]
    assumed: tuple[Notice, ...]
    warnings: tuple[Notice, ...]


def draft_log_map(robot: Robot, log: Path, columns: NamesByQuantity, units: NamesByQuantity) -> LogMapDraft:
    """Return the robot with a `[log]` table for a log.

    `columns` and `units`, one a column or one for all, replace what the headings say of a quantity. A
    UsageError names unknown quantities, a LogError those without columns for every joint, ambiguous ones,
    missing units.
    """
    named, of_units = _split_names("--columns", columns), _split_names("--units", units)
    raw = read_raw(log)
    findings = Findings(file=str(log))
    table = None if named or of_units else _match_preset(raw, robot, findings)
    if table is not None:
        read = _list_quantities(table)
        stated: dict[str, tuple[str, ...]] = {name: (entry.unit,) for name, entry in read.items()}
        table = LogMap(preset=table.preset)
    else:
        read, stated = _propose_quantities(raw, robot, named, of_units, findings)
        table = replace(LogMap(), **read)  # type: ignore[arg-type]  # the keys are those of quantities
    if findings.mistakes:
        raise LogError(*(replace(entry, line=raw.line) for entry in findings.mistakes))
    _note_sides(robot, read, findings)
    remarks = [replace(entry, line=raw.line) for entry in findings.remarks]
    used = {name for entry in read.values() for name in entry.columns}
    unused = tuple(name for name in (*raw.columns, *raw.others) if name not in used)
    if unused:
        # The heading of a column that nobody filled in is empty.
        names = ", ".join(name or "''" for name in unused)
        text = f"columns that are not used: {names}; --columns QUANTITY=NAME,... names others"
        remarks.append(Notice(code="new.unused-columns", text=text, file=str(log)))
    robot = replace(robot, log=table)
    recording = resample_if_uneven(read_recording(log, robot, uneven=True, raw=raw))
    return LogMapDraft(
        robot=robot,
        file=log,
        read=read,
        units=stated,
        unused=unused,
        assumed=(*remarks, *_note_missing_friction(robot)),
        warnings=check_recording(recording, robot),
    )


def _list_quantities(log: LogMap) -> dict[str, LogQuantity]:
    entries = {name: getattr(log, name) for name in QUANTITIES}
    return {name: entry for name, entry in entries.items() if entry is not None}


def _match_preset(raw: RawLog, robot: Robot, findings: Findings) -> LogMap | None:
    """Return the columns of the program that wrote the log, None where it is not known."""
    own = _match_symid_columns(raw, robot)
    if own is not None:
        return own
    for preset in _PRESETS:
        tried = Findings(file=findings.file)
        log = apply_preset(raw, replace(robot, log=LogMap(preset=preset)), tried).log
        read = _list_quantities(log)
        mistakes = [entry for entry in tried.mistakes if entry.code != "log.no-torque-constant"]
        # A heading with a unit of its own was written by somebody else.
        stated = any(name in raw.units for entry in read.values() for name in entry.columns)
        if mistakes or stated or not set(REQUIRED_QUANTITIES) <= set(read):
            continue
        for entry in tried.mistakes:
            findings.refuse("new.torque-constant", f"{entry.text}: {ask_constants(robot.axes)}")
        units = ", ".join(f"{name} in {read[name].unit}" for name in REQUIRED_QUANTITIES)
        text = f"the columns are those of {preset}, and its units are assumed: {units}"
        findings.remark("new.preset", f"{text} (SI: rad or m, N m or N)")
        return log
    return None


def _match_symid_columns(raw: RawLog, robot: Robot) -> LogMap | None:
    """Return the columns that symid itself writes, with their units; None where they are not there."""
    names: dict[str, tuple[str, ...]] = {"time": ("t",), "position": ("q",), "torque": ("tau",)}
    if robot.freedom == 1 or not {"q", "tau"} <= set(raw.columns):
        numbers = range(1, robot.freedom + 1)
        names |= {key: tuple(f"{names[key][0]}{k}" for k in numbers) for key in ("position", "torque")}
    columns = [name for entry in names.values() for name in entry]
    units = [raw.units.get(name, "") for name in columns if name in raw.columns]
    plain = all(unit in UNITS and UNITS[unit][1] == 1.0 and UNITS[unit][0] != "current" for unit in units)
    if len(units) < len(columns) or not plain:
        return None
    # Names of joints may end in other numbers than their order gives; then the order is ambiguous.
    headings = read_headings(raw, robot.axes)
    if choose_columns(headings, "position", robot.axes, Findings(file="")) != names["position"]:
        return None
    read = {key: LogQuantity(columns=entry, unit=raw.units[entry[0]]) for key, entry in names.items()}
    return LogMap(preset="symid", time=read["time"], position=read["position"], torque=read["torque"])


def _propose_quantities(
    raw: RawLog,
    robot: Robot,
    columns: Mapping[str, tuple[str, ...]],
    units: Mapping[str, tuple[str, ...]],
    findings: Findings,
) -> tuple[dict[str, LogQuantity], dict[str, tuple[str, ...]]]:
    """Return all quantities that the headings or the user name, and the units as stated."""
    headings = read_headings(raw, robot.axes)
    found: dict[str, LogQuantity] = {}
    shown: dict[str, tuple[str, ...]] = {}
    for quantity in dict.fromkeys((*REQUIRED_QUANTITIES, "velocity", *columns)):
        if quantity in columns:
            names = check_columns(tuple(raw.columns), quantity, columns[quantity], robot.axes, findings)
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


def _note_sides(robot: Robot, read: Mapping[str, LogQuantity], findings: Findings) -> None:
    """Note what is assumed of gears and sides."""
    current = get_unit_factor(read["torque"].unit)[0] == "current"
    plain = tuple(joint.name for joint in robot.axes if joint.drive.gear == 1)
    if current and plain:
        text = f"currents: gear ratio 1 (direct drive) is assumed for {join_names(plain)}"
        findings.remark("new.assumed-gear", f"{text}; give --gear RATIO,... where there are gears")
    if len(plain) < robot.freedom:
        what = "positions" if current else "positions and torques"
        text = f"{what} are assumed to be on the joint side of the gears"
        findings.remark("new.assumed-side", f'{text}; write side = "motor" in [log] if they are the motors\'')


def _split_names(option: str, given: NamesByQuantity) -> dict[str, tuple[str, ...]]:
    """Return what an option says of each quantity, or raise a UsageError."""
    found: dict[str, tuple[str, ...]] = {}
    mistakes = []
    for quantity, names in given.items():
        parts = names.split(",") if isinstance(names, str) else names
        found[quantity] = tuple(part.strip() for part in parts)
        if quantity not in QUANTITIES:
            hint = suggest_names(quantity, QUANTITIES) or f"known are {', '.join(QUANTITIES)}"
            mistake = f"there is no quantity {quantity!r}; {hint}"
        elif not all(found[quantity]) or not found[quantity]:
            example = "deg" if option == "--units" else "NAME,NAME"
            mistake = f"expected QUANTITY=..., such as {option} position={example}"
        else:
            continue
        mistakes.append(f"{option} {quantity}={','.join(parts)}: {mistake}")
    if mistakes:
        raise UsageError(*(Notice(code="usage.quantity", text=text) for text in mistakes))
    return found


def _note_missing_friction(robot: Robot) -> tuple[Notice, ...]:
    """Return notices on joints without friction or rotors, with which no log fits."""
    texts = {}
    plain = [joint.name for joint in robot.axes if joint.friction.law == NO_FRICTION]
    if plain:
        texts["new.no-friction"] = (
            f"no friction is stated for {', '.join(plain)}, but real joints have some: give --friction "
            "coulomb-viscous-offset, or write it into the file"
        )
    still = [joint.name for joint in robot.axes if joint.drive.gear != 1 and not joint.drive.has_rotor]
    if still:
        texts["new.no-rotor"] = (
            f"no rotor is stated for {', '.join(still)}, but its inertia matters behind a gear: give "
            "--rotors, or write it into the file"
        )
    return tuple(Notice(code=code, text=text) for code, text in texts.items())


Numbers = str | float | Sequence[float]
"""One number for each joint or one for all, or a text with commas, which is exact."""

_COMMENT = """Made by symid from {source}.
Values in comments are not known yet: fill in those that apply, and remove the others."""
_ASSUMED = "Assumed from the log, please check:"
_WIDTH = 105
_EXAMPLES = {"--gear": "100,100,50", "--torque-constant": "0.12,0.12,0.05"}


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftOrder:
    """The arguments of `symid.new_robot`; `name` is a robot, `constant` a torque constant in N m/A."""

    urdf: Path | None
    base: str | None
    tip: str | None
    table: Path | None
    convention: str | None
    gravity: Numbers | None
    name: str | None
    log: Path | None
    columns: NamesByQuantity
    units: NamesByQuantity
    friction: str | None
    rotors: bool
    gear: Numbers | None
    constant: Numbers | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """A robot file that is not written yet.

    Args:
        robot: that it describes; source: the file that it comes from.
        text: of the file, TOML.
        log: the table of the log; None without one.
        notices: assumptions and warnings.
    """

    robot: Robot
    source: Path
    text: str
    log: LogMapDraft | None
    notices: tuple[Notice, ...]


def draft_robot(order: DraftOrder) -> Draft:
    """Return the text of a robot file, with what is not known in comments.

    Raises:
        UsageError: options that do not fit together, a number or a quantity that cannot be read.
        RobotError, LogError: the source or the log is wrong.
    """
    _check_order(order)
    if order.name is not None:
        return _copy(order, locate_robot_file(order.name))
    if order.urdf is not None:
        return _build(order, choose_reading(partial(read_urdf, order.urdf, base=order.base, tip=order.tip)))
    table, convention = order.table or Path(), order.convention or ""
    if order.gravity is None:
        text = "gravity is assumed as 0, 0, -9.81 m/s^2 in the base frame; give --gravity or correct the file"
        robot = read_dh_table(table, convention, DEFAULT_GRAVITY)
        return _build(order, robot, Notice(code="new.gravity", text=text))
    texts, numbers = _read_numbers(order.gravity)
    if len(numbers) != 3:
        expected = "expected three numbers in m/s^2 of a sensible size"
        text = f"--gravity {','.join(texts)}: {expected}, such as --gravity 0,0,-9.81"
        raise UsageError(Notice(code="usage.gravity", text=text))
    x, y, z = (text.strip() for text in texts)
    return _build(order, read_dh_table(table, convention, (x, y, z)))


def _check_order(order: DraftOrder) -> None:
    """Refuse an order without one source, or with options of another one."""
    texts = []
    if sum(entry is not None for entry in (order.urdf, order.table, order.name)) != 1:
        texts.append("give one source: --from-urdf FILE, --from-dh FILE or --from ROBOT")
    owned = (
        ("--from-urdf", order.urdf, {"--base": order.base, "--tip": order.tip}),
        ("--from-dh", order.table, {"--convention": order.convention, "--gravity": order.gravity}),
        ("--log LOG", order.log, {"--columns": order.columns, "--units": order.units}),
    )
    for owner, given, options in owned:
        texts += [f"{option} belongs to {owner}" for option in _list_given(options) if given is None]
    if order.table is not None and order.convention is None:
        texts.append("--from-dh needs --convention modified or --convention standard; it is never guessed")
    if texts:
        raise UsageError(*(Notice(code="usage.call", text=text) for text in texts))


def _list_given(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return the options that have a value; a flag that is not given is False, a table empty."""
    return tuple(
        option
        for option, value in options.items()
        if not (value is None or value is False or (isinstance(value, Mapping) and not value))
    )


def _copy(order: DraftOrder, found: Path) -> Draft:
    """Return the file of another robot as it is; a URDF is converted, and takes options."""
    if is_urdf(found):
        return _build(order, choose_reading(partial(read_urdf, found)))
    options = {
        "--log": order.log,
        "--friction": order.friction,
        "--rotors": order.rotors,
        "--gear": order.gear,
        "--torque-constant": order.constant,
    }
    added = _list_given(options)
    if added:
        text = f"{', '.join(added)}: a robot file is copied as it is; leave this out, and complete it by hand"
        raise UsageError(Notice(code="usage.copied", text=text, file=str(found)))
    robot = read_robot(found)
    text = found.read_text(encoding="utf-8-sig")
    return Draft(robot=robot, source=found, text=text, log=None, notices=robot.notices)


def _build(order: DraftOrder, robot: Robot, *notices: Notice) -> Draft:
    """Return the robot with what is added."""
    completion = Completion(
        friction=order.friction,
        rotors=order.rotors,
        gears=_split_numbers("--gear", order.gear),
        constants=_split_numbers("--torque-constant", order.constant),
    )
    robot = complete_robot(robot, completion)
    part = draft_log_map(robot, order.log, order.columns, order.units) if order.log else None
    robot = part.robot if part else robot
    assumed, warnings = (part.assumed, part.warnings) if part else ((), ())
    return Draft(
        robot=robot,
        source=Path(robot.path),
        text=_write(robot, assumed),
        log=part,
        notices=(*robot.notices, *notices, *assumed, *warnings),
    )


def _write(robot: Robot, assumed: Sequence[Notice]) -> str:
    """Return the text of the new file, which can be read, with what was assumed as its first comment."""
    comment = _COMMENT.format(source=Path(robot.path).name)
    lines: list[str] = []
    for notice in assumed:
        lines += textwrap.wrap(notice.text, _WIDTH, initial_indent="* ", subsequent_indent="  ")
    if lines:
        comment = "\n".join((comment, "", _ASSUMED, *lines))
    text = write_robot(robot, comment=comment, hints=True)
    try:
        parse_robot(text)
    except RobotError as error:
        texts = [f"cannot be written as a robot file: {notice.text}" for notice in error.notices]
        notices = (Notice(code="new.unwritable", text=text, file=robot.path) for text in texts)
        raise RobotError(*notices) from error
    return text


def _read_numbers(given: Numbers) -> tuple[list[str], list[float]]:
    """Return numbers as texts and as read; none are read where one is not a number of a robot file."""
    plain: Numbers = given.tolist() if hasattr(given, "tolist") else given
    if isinstance(plain, str | int | float):
        texts = str(plain).split(",")
    else:
        texts = [str(float(entry)) for entry in plain]
    try:
        numbers = [to_decimal(Decimal(text.strip())) for text in texts]
    except InvalidOperation:
        return texts, []
    return texts, [] if None in numbers else [float(number) for number in numbers if number is not None]


def _split_numbers(option: str, given: Numbers | None) -> tuple[float, ...]:
    """Return the numbers of an option, none of them zero; empty where it is not given."""
    if given is None:
        return ()
    texts, numbers = _read_numbers(given)
    if not numbers or not all(numbers):
        expected = "expected numbers other than 0 with commas between, one for each joint"
        message = f"{option} {','.join(texts)}: {expected}, such as {option} {_EXAMPLES[option]}"
        raise UsageError(Notice(code="usage.numbers", text=message))
    return tuple(numbers)
