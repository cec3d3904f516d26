"""A robot from its TOML file.

Input: a path. Output: `Robot`, or one `RobotError` with all that is wrong, each with its place.

Supported: the keys of the commented file in the documentation: general texts, convention, gravity,
`[symbols]`, `[[joint]]` with `link`, `drive`, `friction`, `limits`, and `[log]`, `[processing]`.
Not supported: guesses. A convention, a joint's kind, gravity and units must be written.
"""

import re
import tomllib
from collections.abc import Mapping
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

from symid.errors import Notice, RobotError
from symid.robot.description import Robot
from symid.robot.geometry import ZERO, Exact
from symid.robot.joints import read_joints
from symid.robot.positions import find_places
from symid.robot.section import (
    Report,
    Section,
    read_choice,
    read_number,
    read_numbers,
    read_table,
    read_text,
    refuse_unknown_keys,
)
from symid.robot.settings import read_log, read_processing

__all__ = ["parse_robot", "read_robot"]

_KEYS = (
    "name",
    "description",
    "source",
    "convention",
    "gravity",
    "symbols",
    "joint",
    "log",
    "processing",
)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
# Letters of coordinates and functions would read as something else in a formula.
_RESERVED = re.compile(r"(?:pi|tau|theta|g|[sc]\d+|d{0,2}q\d*)")


def read_robot(path: Path) -> Robot:
    """Return the robot that the file at `path` describes.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = error.strerror or "it cannot be read"
        raise RobotError(
            Notice(code="robot.unreadable", text=f"cannot be read: {reason}", file=str(path))
        ) from error
    except UnicodeDecodeError as error:
        message = f"not UTF-8 text (byte {error.start}); save the file as UTF-8"
        raise RobotError(Notice(code="robot.unreadable", text=message, file=str(path))) from error
    return parse_robot(text, str(path))


def parse_robot(text: str, file: str = "robot.toml") -> Robot:
    """Return the robot that `text` describes; messages call the text `file`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    text = text.replace("\r\n", "\n")
    try:
        values = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise RobotError(_explain_syntax(str(error), text, file)) from error
    report = Report(find_places(text, file))
    root = Section(values=values, path=(), report=report)
    refuse_unknown_keys(root, _KEYS)
    convention = _read_convention(root)
    symbols = _read_symbols(root)
    joints, tip = read_joints(root, convention, symbols)
    build = partial(
        Robot,
        name=_read_name(root, Path(file).stem),
        description=read_text(root, "description") or "",
        source=read_text(root, "source") or "",
        convention=convention,
        gravity=_read_gravity(root),
        symbols=tuple(sorted(symbols.items())),
        joints=joints,
        tip=tip,
        log=read_log(root, joints),
        processing=read_processing(root),
        path=file,
    )
    if report.errors:
        raise RobotError(*report.notices())
    _warn_of_unused_symbols(root, symbols)
    return build(notices=report.remarks())


def _explain_syntax(message: str, text: str, file: str) -> Notice:
    match = _PLACE.search(message)
    if match and match[1]:
        line, column = int(match[1]), int(match[2])
    else:
        line, column = text.count("\n") + 1, len(text) - (text.rfind("\n") + 1) + 1
    reason = _PLACE.sub("", message)
    words = f"not valid TOML: {reason[:1].lower()}{reason[1:]}"
    bare = (
        re.match(r"[A-Za-z]\w*", text.split("\n")[line - 1][column - 1 :])
        if "Invalid value" in reason
        else None
    )
    if bare:
        words += f'; a text or the name of a length stands in quotes: "{bare[0]}"'
    return Notice(code="robot.syntax", text=words, file=file, line=line, column=column)


def _read_name(root: Section, stem: str) -> str:
    name = read_text(root, "name")
    if name is not None and not _NAME.fullmatch(name):
        text = (
            f"{root.show('name')} cannot name generated functions; use letters, digits and _, a letter first"
        )
        root.refuse("robot.bad-name", "name", text)
    return name or re.sub(r"\W|^(?=\d)", "_", stem)


def _read_convention(root: Section) -> str:
    if "convention" not in root.values:
        text = (
            'missing, and never guessed; write convention = "modified" (alpha and a belong to the link '
            'before: Craig, Khalil) or convention = "standard" (to the joint\'s own link: classic DH)'
        )
        root.refuse_key("robot.missing-key", "convention", text)
    return read_choice(root, "convention", ("modified", "standard")) or "modified"


def _read_gravity(root: Section) -> tuple[Exact, Exact, Exact]:
    if "gravity" not in root.values:
        text = "missing; write gravity = [0, 0, -9.81], the vector in the base frame in m/s^2"
        root.refuse_key("robot.missing-key", "gravity", text)
    numbers = read_numbers(root, "gravity", "m/s^2", 3)
    if numbers is None:
        return (ZERO, ZERO, ZERO)
    x, y, z = (Exact.of(str(number)) for number in numbers)
    return (x, y, z)


def _read_symbols(root: Section) -> Mapping[str, float]:
    table = read_table(root, "symbols")
    if table is None:
        return {}
    values = {}
    for name in table.values:
        if not _NAME.fullmatch(name) or _RESERVED.fullmatch(name):
            text = "cannot name a length; use letters, digits and _, and no letter of a coordinate"
            table.refuse_key("robot.bad-name", name, text)
        number = read_number(table, name, "m")
        values[name] = float(number or 0)
    return values


def _warn_of_unused_symbols(root: Section, symbols: Mapping[str, float]) -> None:
    """Add a warning for each symbol that no joint of a well-formed file names."""
    tables: Any = root.values.get("joint", [])
    used = {str(table.get(key)).strip("+- ") for table in tables for key in ("a", "d")}
    section = Section(values=symbols, path=("symbols",), report=root.report, label="symbols")
    for name in symbols:
        if name not in used:
            section.warn("robot.unused-symbol", name, "no joint uses this length")
