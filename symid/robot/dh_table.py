"""A robot from a table of Denavit-Hartenberg rows.

A text file with a header such as `joint,kind,alpha_deg,a,d,theta` and one row a joint -> `Robot`, or one
`RobotError` with all mistakes and their places.

Supported: commas, semicolons, tabs; comments from # to the end of a line; angles in rad, texts such as
pi/2, or in degrees under `alpha_deg`; lengths in m, or in mm under `a_mm`; `q` for a joint's variable, also
with a constant as in `q - pi/2`. A joint without kind is revolute where q stands under theta, prismatic
under d. A cell may stand in double quotes, as spreadsheets write them; a quote inside is doubled.
Not supported: trees, symbols, decimal commas, cells of several lines.
"""

import re
from decimal import Decimal
from pathlib import Path
from typing import Any

from symid.errors import RobotError
from symid.robot.description import Robot
from symid.robot.exact_values import parse_linear_form
from symid.robot.geometry import ZERO
from symid.robot.toml_reader import build_robot
from symid.robot.toml_values import KeyPath, Place, Places, Section, read_text_file, suggest_names, to_decimal

_ANGLES: tuple[tuple[str, str | None], ...] = (("", None), ("_rad", None), ("_deg", "deg"))
_LENGTHS: tuple[tuple[str, Decimal | None], ...] = (("", None), ("_m", None), ("_mm", Decimal("0.001")))
# Key of a robot file and unit of each column.
_COLUMNS: dict[str, tuple[str, Decimal | str | None]] = {
    "joint": ("name", None),
    "name": ("name", None),
    "kind": ("kind", None),
    **{f"{key}{end}": (key, unit) for key in ("alpha", "theta") for end, unit in _ANGLES},
    **{f"{key}{end}": (key, unit) for key in ("a", "d") for end, unit in _LENGTHS},
}
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_HEADER = "joint,kind,alpha,a,d,theta"
_VARIABLE = re.compile(r"q\d*\s*(?P<rest>[-+].*)?")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_KINDS = {"theta": "revolute", "d": "prismatic"}


def read_dh_table(path: Path, convention: str, gravity: tuple[str, str, str] = ("0", "0", "-9.81")) -> Robot:
    """Return the robot whose rows, "modified" or "standard", the text file at `path` holds.

    `gravity` is that in the base frame in m/s^2, as decimals.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    return parse_dh_table(read_text_file(path), convention, gravity, str(path))


def parse_dh_table(
    text: str, convention: str, gravity: tuple[str, str, str] = ("0", "0", "-9.81"), file: str = "table.csv"
) -> Robot:
    """Return the robot whose rows `text` holds; messages call the text `file`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    places: dict[KeyPath, Place] = {}
    start = Place(file, 1, 1)
    joints: list[dict[str, Any]] = []
    values = {"convention": convention, "gravity": [Decimal(value) for value in gravity], "joint": joints}
    root = Section(values=values, places=Places(keys=places, values=places, whole=start))
    lines = _split_cells(text, file)
    if not lines:
        text = f"empty; the first line names the columns: {_HEADER}"
        raise RobotError(start.notice("robot.table-header", text))
    header = _read_header(root, lines[0])
    for cells in lines[1:]:
        places["joint", len(joints)] = cells[0]
        joints.append(_read_row(root, header, cells, len(joints), places))
    if not joints:
        root.errors.append(start.notice("robot.missing-key", "no rows below the header; write one a joint"))
    if not joints or any(error.code == "robot.table-header" for error in root.errors):
        root.finish()
    return build_robot(root, file)


def _split_cells(text: str, file: str) -> list[list[Place]]:
    """Return the cells of every line that holds more than a comment, each with its text and place."""
    lines = []
    separator = ""
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        # What stands in quotes is masked, so that separators and # in it are none.
        masked = _QUOTED.sub(lambda match: "x" * len(match[0]), line)
        masked = masked.partition("#")[0]
        if not masked.strip():
            continue
        separator = separator or max((",", ";", "\t"), key=masked.count)
        cells, column = [], 0
        for part in masked.split(separator):
            found = line[column : column + len(part)]
            lead = len(found) - len(found.lstrip())
            cells.append(Place(file, number, column + lead + 1, found.strip()))
            column += len(part) + len(separator)
        lines.append(cells)
    return lines


def _unquote(cell: Place) -> str:
    return cell.text[1:-1].replace('""', '"').strip() if _QUOTED.fullmatch(cell.text) else cell.text


def _read_header(root: Section, cells: list[Place]) -> list[str]:
    """Return the names of the columns; a line without any known name is refused at once."""
    names = [_unquote(cell).lower() for cell in cells]
    keys = [_COLUMNS.get(name, ("", None))[0] for name in names]
    code = "robot.table-header"
    if not any(keys):
        text = f"no header; the first line names the columns: {_HEADER} (alpha_deg is in degrees, a_mm in mm)"
        raise RobotError(cells[0].notice(code, text))
    for index, (name, key, cell) in enumerate(zip(names, keys, cells, strict=True)):
        if not key:
            hint = f"{suggest_names(name, _COLUMNS)} allowed are {', '.join(_COLUMNS)}".strip()
            root.errors.append(cell.notice(code, f'there is no column "{_unquote(cell)}"; {hint}'))
        elif key in keys[:index]:
            text = f'"{_unquote(cell)}" repeats a column before; keep one of the two'
            root.errors.append(cell.notice(code, text))
    missing = [key for key in ("alpha", "a", "d", "theta") if key not in keys]
    if missing:
        text = f"the columns {', '.join(missing)} are missing; the first line names all: alpha,a,d,theta"
        root.errors.append(cells[0].notice(code, text))
    return names


def _read_row(
    root: Section, header: list[str], cells: list[Place], index: int, places: dict[KeyPath, Place]
) -> dict[str, Any]:
    """Return a row as the table of a joint; the places of its cells go to `places`."""
    joint: dict[str, Any] = {}
    if len(cells) != len(header):
        text = f"{len(cells)} cells under {len(header)} columns; write 0 where there is nothing"
        root.errors.append(cells[0].notice("robot.table-row", text))
    variables: list[tuple[str, Place]] = []
    for name, cell in zip(header, cells, strict=False):
        key, unit = _COLUMNS.get(name, ("", None))
        text = _unquote(cell)
        if not key or not text:
            continue
        places["joint", index, key] = cell
        if key in ("name", "kind"):
            joint[key] = f"joint{text}" if key == "name" and text.isdigit() else text
            continue
        if match := _VARIABLE.fullmatch(text):
            variables.append((key, cell))
            text = re.sub(r"^\+\s*", "", match["rest"] or "0").replace("- ", "-")
        # As a robot file would write it: a decimal, or a text such as "pi/2".
        value: Decimal | str = text
        if _NUMBER.fullmatch(text) and (number := to_decimal(Decimal(text))) is not None:
            value = f"{number:f} deg" if unit == "deg" else number
            value = number * unit if isinstance(unit, Decimal) else value
        form = parse_linear_form(value) if isinstance(value, str) and key in ("a", "d") else ZERO
        if form is not None and form.is_number:
            joint[key] = value
        else:
            comma = "; decimals have a point, not a comma" if "," in cell.text else ""
            words = f'{key}: expected a number, got "{_unquote(cell)}"{comma}; symbols need a robot file, as '
            words += "symid new FILE --from two_link_symbols copies one"
            root.errors.append(cell.notice("robot.bad-length", words))
    _check_variable(root, joint, variables, cells[0])
    return joint


def _check_variable(
    root: Section, joint: dict[str, Any], variables: list[tuple[str, Place]], place: Place
) -> None:
    """Give the joint the kind that its variable implies, or report what does not agree."""
    text = ""
    if len(variables) > 1:
        place = variables[1][1]
        text = "q occurs twice in this row; a joint has one variable, under theta or under d"
    elif not variables and "kind" not in joint:
        text = "neither q nor kind: write q under theta (revolute) or d (prismatic), or fill in kind"
    elif variables:
        key, place = variables[0]
        kind = joint.setdefault("kind", _KINDS.get(key, "revolute"))
        alike = "revolute" if kind == "continuous" else kind
        if key not in _KINDS:
            text = f"q under {key}; a joint turns under theta or slides under d"
        elif alike in ("fixed", "revolute", "prismatic") and alike != _KINDS[key]:
            text = f'q under {key} is a {_KINDS[key]} joint, but kind is "{kind}"; correct one of them'
    joint.setdefault("kind", "revolute")
    if text:
        root.errors.append(place.notice("robot.table-row", text))
