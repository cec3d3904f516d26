"""A robot from its TOML file.

Input: a path. Output: `Robot`, or one `RobotError` with all that is wrong, each with its place.

Supported: TOML 1.0 in UTF-8, lines ending as on any system; `assembly` has the keys.
Not supported: files that include others.
"""

import re
import tomllib
from decimal import Decimal
from pathlib import Path

from symid.errors import Notice, RobotError
from symid.formats.assembly import build_robot
from symid.formats.positions import find_places
from symid.formats.section import Report, Section
from symid.formats.text_file import read_text_file
from symid.robot.description import Robot

__all__ = ["parse_robot", "read_robot"]

_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_robot(path: Path) -> Robot:
    """Return the robot that the file at `path` describes.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    return parse_robot(read_text_file(path), str(path))


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
    return build_robot(Section(values=values, path=(), report=report), file)


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
