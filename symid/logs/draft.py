"""A robot file to be completed by hand, from a URDF, a table of DH rows, or a robot at hand, and from a log.

`DraftOrder`, where the robot comes from and what is put beside it -> `Draft`.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

from symid.errors import Notice, RobotError, UsageError
from symid.logs.proposal import LogMapDraft, NamesByQuantity, draft_log_map
from symid.robot import (
    DEFAULT_GRAVITY,
    Completion,
    Robot,
    complete_robot,
    is_urdf,
    locate_robot_file,
    parse_robot,
    read_dh_table,
    read_robot,
    read_urdf,
    to_decimal,
    write_robot,
)

Numbers = str | float | Sequence[float]
"""One number for each joint or one for all, or a text with commas, which is exact."""

_COMMENT = """Made by symid from {source}.
What stands in comments is not known yet: fill in what is, and leave out what does not apply."""
_ASSUMED = "Of the log, to be checked by you:"
_WIDTH = 105
_EXAMPLES = {"--gear": "100,100,50", "--torque-constant": "0.12,0.12,0.05"}


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftOrder:
    """Where a robot comes from: one of `urdf`, `table` and `name`, and what is put beside it.

    Args:
        urdf: a file; base, tip: its links to start from and to end at.
        table: a CSV table of rows; convention: "modified" or "standard"; gravity: in its base frame, m/s^2.
        name: a robot at hand, by its name or path.
        log: a log of the robot; columns, units: of its quantities, see `draft_log_map`.
        friction: the friction model of all joints.
        rotors: whether every drive gets a rotor.
        gear: motor turns per joint turn. constant: N m/A at the motor.
    """

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
        log: which column of the log is what; None without one.
        notices: what was taken for granted, and what is odd.
    """

    robot: Robot
    source: Path
    text: str
    log: LogMapDraft | None
    notices: tuple[Notice, ...]


def draft_robot(order: DraftOrder) -> Draft:
    """Return the text of a robot file, with what is not known in comments.

    Raises:
        UsageError: the order does not go together, or a number or a quantity is none.
        RobotError: the source is wrong, or a robot file cannot say what it says.
        LogError: the log cannot be read, or its columns cannot be told.
    """
    _check_order(order)
    if order.name is not None:
        return _copy(order, locate_robot_file(order.name))
    if order.urdf is not None:
        return _build(order, read_urdf(order.urdf, base=order.base, tip=order.tip))
    gravity = DEFAULT_GRAVITY if order.gravity is None else _split_gravity(order.gravity)
    robot = read_dh_table(order.table or Path(), order.convention or "", gravity)
    if order.gravity is not None:
        return _build(order, robot)
    said = "gravity is taken as 0, 0, -9.81 m/s^2 in the base frame; give --gravity or correct the file"
    return _build(order, robot, Notice(code="new.gravity", text=said))


def _check_order(order: DraftOrder) -> None:
    """Refuse an order without one source, or with options of another one.

    Raises:
        UsageError: with all that does not go together.
    """
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
    """Return a robot at hand; a URDF is converted.

    Raises:
        UsageError: something is to be put beside a robot file, which is copied as it is.
    """
    if is_urdf(found):
        return _build(order, read_urdf(found))
    added = _list_given(
        {
            "--log": order.log,
            "--friction": order.friction,
            "--rotors": order.rotors,
            "--gear": order.gear,
            "--torque-constant": order.constant,
        }
    )
    if added:
        told = "a robot file is copied as it is; leave this out, and complete the copy by hand"
        text = f"{', '.join(added)}: {told}"
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
    part = None
    if order.log is not None:
        part = draft_log_map(robot, order.log, order.columns, order.units)
        robot = part.robot
    said = (*robot.notices, *notices)
    if part is not None:
        said += (*part.assumed, *part.doubts)
    text = _write(robot, () if part is None else part.assumed)
    return Draft(robot=robot, source=Path(robot.path), text=text, log=part, notices=said)


def _write(robot: Robot, assumed: Sequence[Notice]) -> str:
    """Return the text of the new file, which has been read back; what was assumed stands at its head.

    Raises:
        RobotError: a robot file cannot say what the source says; the message names the source.
    """
    comment = _COMMENT.format(source=Path(robot.path).name)
    lines = [
        line
        for notice in assumed
        for line in textwrap.wrap(notice.text, _WIDTH, initial_indent="* ", subsequent_indent="  ")
    ]
    if lines:
        comment = "\n".join((comment, "", _ASSUMED, *lines))
    text = write_robot(robot, comment=comment, hints=True)
    try:
        parse_robot(text)
    except RobotError as error:
        texts = (f"cannot be written as a robot file: {notice.text}" for notice in error.notices)
        raise RobotError(
            *(Notice(code="new.unwritable", text=words, file=robot.path) for words in texts)
        ) from error
    return text


def _list_texts(given: Numbers) -> list[str]:
    plain: Numbers = given.tolist() if hasattr(given, "tolist") else given
    match plain:
        case str():
            return plain.split(",")
        case int() | float():
            return [str(plain)]
    return [str(float(entry)) for entry in plain]


def _split_numbers(option: str, given: Numbers | None) -> tuple[float, ...]:
    """Return the numbers of an option; none where it is not given.

    Raises:
        UsageError: one of them is no number of a robot file, or zero.
    """
    if given is None:
        return ()
    texts = _list_texts(given)
    try:
        numbers = [to_decimal(Decimal(text.strip())) for text in texts]
    except InvalidOperation:
        numbers = [None]
    if not all(numbers):
        expected = "expected numbers other than 0 with commas between, one for each joint"
        message = f"{option} {','.join(texts)}: {expected}, such as {option} {_EXAMPLES[option]}"
        raise UsageError(Notice(code="usage.numbers", text=message))
    return tuple(float(number) for number in numbers if number is not None)


def _split_gravity(given: Numbers) -> tuple[str, str, str]:
    """Return the three components of gravity.

    Raises:
        UsageError: they are not three finite numbers of a sensible size.
    """
    texts = _list_texts(given)
    parts = [text.strip() for text in texts]
    try:
        good = len(parts) == 3 and all(to_decimal(Decimal(part)) is not None for part in parts)
    except InvalidOperation:
        good = False
    if not good:
        expected = "expected three numbers in m/s^2 of a sensible size"
        message = f"--gravity {','.join(texts)}: {expected}, such as --gravity 0,0,-9.81"
        raise UsageError(Notice(code="usage.gravity", text=message))
    return (parts[0], parts[1], parts[2])
