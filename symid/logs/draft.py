"""Drafts: a `[log]` map for a log, and a robot file to be completed: from URDF, MJCF, DH rows or a robot.

Robot, path of a log, columns and units by quantity -> LogMapDraft. Options, files -> Draft.

    preset of a known program, else: headings -> columns of each joint -> units -> LogMap

No `[processing]` is written: what it would say is chosen from each log.

Supported: what `headings` reads, names and units of the user in place of it, the presets.
Not supported: columns of motors, of second encoders and of controllers, unless the user names them.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path

from symid import robot as robots
from symid.dynamics import choose_reading
from symid.errors import LogError, Notice, RobotError, UsageError
from symid.joint_models import NO_FRICTION
from symid.logs.checks import check_recording
from symid.logs.columns import Findings
from symid.logs.faults import repair_recording
from symid.logs.headings import list_quantities
from symid.logs.reader import read_raw, read_recording, recognise_columns
from symid.options import DraftOptions, Numbers

_TOPIC = "topic"
"""Named in place of columns, it has all of them."""

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

    robot: robots.Robot
    file: Path
    read: Mapping[str, robots.LogQuantity]
    units: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...]
    assumed: tuple[Notice, ...]
    warnings: tuple[Notice, ...]


def draft_log_map(
    robot: robots.Robot, log: Path, columns: NamesByQuantity, units: NamesByQuantity
) -> LogMapDraft:
    """Return the robot with a `[log]` table for a log.

    `columns` and `units`, one a column or one for all, replace what the headings say of a quantity; "topic"
    in `columns` chooses the topic of a bag. A UsageError names unknown quantities, a LogError those without
    columns for every joint, ambiguous ones, missing units.
    """
    topic = columns.get(_TOPIC) or None
    topic = topic if topic is None or isinstance(topic, str) else ",".join(topic)
    columns = {name: entry for name, entry in columns.items() if name != _TOPIC}
    named, of_units = _split_names("--columns", columns), _split_names("--units", units)
    robot = replace(robot, log=robots.LogMap(topic=topic))
    raw = read_raw(log)
    findings = Findings(file=str(log))
    found = recognise_columns(raw, robot, named, of_units, findings)
    if found is None:
        raise LogError(*(replace(entry, line=raw.line) for entry in findings.mistakes))
    table = list_quantities(found.table)
    read = {name: table[name] for name in found.units}
    remarks = [*raw.notices, *(replace(entry, line=raw.line) for entry in findings.remarks)]
    robot = replace(robot, log=found.short)
    recording = repair_recording(read_recording(log, robot, uneven=True, raw=raw), robot.axes)
    # Channels with names of their own, such as velocities dq, are read without an entry in the map.
    unused = (*recording.extras, *raw.others)
    if unused:
        # The heading of a column that nobody filled in is empty.
        names = ", ".join(name or "''" for name in unused)
        text = f"columns that are not used: {names}; --columns QUANTITY=NAME,... names others"
        remarks.append(Notice(code="new.unused-columns", text=text, file=str(log)))
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
    return LogMapDraft(
        robot=robot,
        file=log,
        read=read,
        units=found.units,
        unused=unused,
        assumed=(*remarks, *(Notice(code=code, text=text) for code, text in texts.items())),
        warnings=check_recording(recording, robot),
    )


def _split_names(option: str, given: NamesByQuantity) -> dict[str, tuple[str, ...]]:
    """Return what an option says of each quantity, or raise a UsageError."""
    found: dict[str, tuple[str, ...]] = {}
    mistakes = []
    for quantity, names in given.items():
        parts = names.split(",") if isinstance(names, str) else names
        found[quantity] = tuple(part.strip() for part in parts)
        if quantity not in robots.QUANTITIES:
            hint = robots.suggest_names(quantity, robots.QUANTITIES)
            hint = hint or f"known are {', '.join(robots.QUANTITIES)}"
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


_COMMENT = """Made by symid from {source}.
Values in comments are not known yet: fill in those that apply, and remove the others."""
_ASSUMED = "Assumed from the log, please check:"
_WIDTH = 105
_EXAMPLES = {"--gear": "100,100,50", "--torque-constant": "0.12,0.12,0.05"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """A robot file that is not written yet.

    Args:
        robot: that it describes; source: the file that it comes from.
        text: of the file, TOML.
        log: the table of the log; None without one.
        notices: assumptions and warnings.
    """

    robot: robots.Robot
    source: Path
    text: str
    log: LogMapDraft | None
    notices: tuple[Notice, ...]


def draft_robot(
    options: DraftOptions,
    *,
    urdf: Path | None,
    table: Path | None,
    name: str | None,
    log: Path | None,
    columns: NamesByQuantity,
    units: NamesByQuantity,
    friction: str | None,
) -> Draft:
    """Return the text of a robot file, with what is not known in comments; see `symid.new_robot`.

    A UsageError tells of options that do not fit, a RobotError or LogError of mistakes in a file.
    """
    texts = []
    if sum(entry is not None for entry in (urdf, table, name)) != 1:
        texts.append("give one source: --from-urdf FILE (or --from-mjcf), --from-dh FILE or --from ROBOT")
    owned = (
        ("--from-urdf", urdf, {"--base": options.base, "--tip": options.tip}),
        ("--from-dh", table, {"--convention": options.convention}),
        ("--log LOG", log, {"--columns": columns, "--units": units}),
    )
    for owner, given, own in owned:
        texts += [f"{option} belongs to {owner}" for option in _list_given(own) if given is None]
    if table is not None and options.convention is None:
        texts.append("--from-dh needs --convention modified or --convention standard; it is never guessed")
    if texts:
        raise UsageError(*(Notice(code="usage.call", text=text) for text in texts))
    notices: list[Notice] = []
    if name is not None and robots.is_xml(found := robots.locate_robot_file(name)):
        robot = choose_reading(partial(robots.read_xml_robot, found))
    elif name is not None:
        more = {"--log": log, "--friction": friction, "--rotors": options.rotors, "--gear": options.gear}
        more["--gravity"] = options.gravity
        if added := _list_given({**more, "--torque-constant": options.torque_constant}):
            listed = ", ".join(added)
            text = f"{listed}: a robot file is copied as it is; leave this out, and complete it by hand"
            raise UsageError(Notice(code="usage.copied", text=text, file=str(found)))
        robot = robots.read_robot(found)
        text = found.read_text(encoding="utf-8-sig")
        return Draft(robot=robot, source=found, text=text, log=None, notices=robot.notices)
    elif urdf is not None:
        robot = choose_reading(partial(robots.read_xml_robot, urdf, base=options.base, tip=options.tip))
    else:
        if options.gravity is None:
            text = "gravity is assumed as 0, 0, -9.81 m/s^2 in the base frame; give --gravity or correct the"
            notices.append(Notice(code="new.gravity", text=f"{text} file"))
        robot = robots.read_dh_table(table or Path(), options.convention or "")
    robot = robots.state_mounting(robot, options.gravity)
    stated: list[tuple[float, ...]] = []
    for option, value in (("--gear", options.gear), ("--torque-constant", options.torque_constant)):
        if value is None:
            stated.append(())
            continue
        texts, numbers = _read_numbers(value)
        if not numbers or not all(numbers):
            expected = "expected numbers other than 0 with commas between, one for each joint"
            text = f"{option} {','.join(texts)}: {expected}, such as {option} {_EXAMPLES[option]}"
            raise UsageError(Notice(code="usage.numbers", text=text))
        stated.append(tuple(numbers))
    robot = robots.complete_robot(robot, friction, *stated, rotors=options.rotors)
    part = draft_log_map(robot, log, columns, units) if log else None
    robot = part.robot if part else robot
    assumed, warnings = (part.assumed, part.warnings) if part else ((), ())
    comment = _COMMENT.format(source=Path(robot.path).name)
    lines: list[str] = []
    for notice in assumed:
        lines += textwrap.wrap(notice.text, _WIDTH, initial_indent="* ", subsequent_indent="  ")
    if lines:
        comment = "\n".join((comment, "", _ASSUMED, *lines))
    written = robots.write_robot(robot, comment=comment, hints=True)
    try:
        robots.parse_robot(written)
    except RobotError as error:
        texts = [f"cannot be written as a robot file: {notice.text}" for notice in error.notices]
        wrong = (Notice(code="new.unwritable", text=written, file=robot.path) for written in texts)
        raise RobotError(*wrong) from error
    return Draft(
        robot=robot,
        source=Path(robot.path),
        text=written,
        log=part,
        notices=(*robot.notices, *notices, *assumed, *warnings),
    )


def _list_given(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return the options that have a value; a flag that is not given is False, a table empty."""
    return tuple(
        option
        for option, value in options.items()
        if not (value is None or value is False or (isinstance(value, Mapping) and not value))
    )


def _read_numbers(given: Numbers) -> tuple[list[str], list[float]]:
    """Return numbers as texts and as read; none are read where one is not a number of a robot file."""
    plain: Numbers = given.tolist() if hasattr(given, "tolist") else given
    if isinstance(plain, str | int | float):
        texts = str(plain).split(",")
    else:
        texts = [str(float(entry)) for entry in plain]
    try:
        numbers = [robots.to_decimal(Decimal(text.strip())) for text in texts]
    except InvalidOperation:
        return texts, []
    return texts, [] if None in numbers else [float(number) for number in numbers if number is not None]
