"""A robot from a table of Denavit-Hartenberg rows.

A text file with a header such as `joint,kind,alpha_deg,a,d,theta` and one row a joint -> `Robot`, or one
`RobotError` with all that is wrong, each with its place.

Supported: commas, semicolons, tabs; comments from # to the end of a line; angles in rad, texts such as
pi/2, or in degrees under `alpha_deg`; lengths in m, or in mm under `a_mm`; `q` for a joint's variable, also
with a constant as in `q - pi/2`. A joint without kind is revolute where q stands under theta, prismatic
under d. A cell may stand in double quotes, as spreadsheets write them; a quote inside is doubled.
Not supported: trees, symbols, decimal commas, cells of several lines.
"""

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from symid.errors import Notice, RobotError
from symid.robot.description import Robot
from symid.robot.exact_values import parse_linear_form
from symid.robot.toml_reader import build_robot
from symid.robot.toml_values import (
    InputReport,
    KeyPath,
    Place,
    Places,
    Section,
    read_text_file,
    suggest_names,
    to_decimal,
)

_COLUMNS = {
    "joint": ("name", None),
    "name": ("name", None),
    "kind": ("kind", None),
    "alpha": ("alpha", None),
    "alpha_rad": ("alpha", None),
    "alpha_deg": ("alpha", "deg"),
    "a": ("a", None),
    "a_m": ("a", None),
    "a_mm": ("a", Decimal("0.001")),
    "d": ("d", None),
    "d_m": ("d", None),
    "d_mm": ("d", Decimal("0.001")),
    "theta": ("theta", None),
    "theta_rad": ("theta", None),
    "theta_deg": ("theta", "deg"),
}
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_SEPARATORS = (",", ";", "\t")
_COLUMN_HINT = "alpha_deg is in degrees, a_mm in mm"
_VARIABLE = re.compile(r"q\d*\s*(?P<rest>[-+].*)?")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_KINDS = {"theta": "revolute", "d": "prismatic"}


@dataclass(frozen=True, slots=True)
class _Cell:
    """A cell of the table and where it stands."""

    text: str
    place: Place


def read_dh_table(path: Path, convention: str, gravity: tuple[str, str, str] = ("0", "0", "-9.81")) -> Robot:
    """Return the robot whose rows the file at `path` holds.

    Args:
        path: a text file, see above.
        convention: "modified" or "standard".
        gravity: in the base frame, m/s^2, as decimals.

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
    errors: list[Notice] = []
    lines = _split_cells(text, file)
    joints: list[dict[str, Any]] = []
    places: dict[KeyPath, Place] = {}
    if not lines:
        text = "empty; the first line names the columns: joint,kind,alpha,a,d,theta"
        raise RobotError(Notice(code="robot.table-header", text=text, file=file, line=1, column=1))
    header = _read_header(lines[0], errors)
    for cells in lines[1:]:
        index = len(joints)
        places["joint", index] = cells[0].place
        joints.append(_read_row(header, cells, index, places, errors))
    values: dict[str, Any] = {
        "convention": convention,
        "gravity": [Decimal(value) for value in gravity],
        "joint": joints,
    }
    start = Place(file, 1, 1)
    report = InputReport(Places(keys=places, values=places, whole=start), errors=errors)
    if not joints:
        report.errors.append(start.notice("robot.missing-key", "no rows below the header; write one a joint"))
    if not joints or any(error.code == "robot.table-header" for error in errors):
        raise RobotError(*report.notices())
    return build_robot(Section(values=values, path=(), report=report), file)


def _split_cells(text: str, file: str) -> list[list[_Cell]]:
    """Return the cells of every line that holds more than a comment."""
    lines = []
    separator = ""
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        # What stands in quotes is masked, so that separators and # in it are none.
        masked = _QUOTED.sub(lambda match: "x" * len(match[0]), line)
        masked = masked.partition("#")[0]
        if not masked.strip():
            continue
        separator = separator or max(_SEPARATORS, key=masked.count)
        cells, column = [], 0
        for part in masked.split(separator):
            found = line[column : column + len(part)]
            lead = len(found) - len(found.lstrip())
            shown = found.strip()
            cells.append(_Cell(_unquote(shown), Place(file, number, column + lead + 1, shown)))
            column += len(part) + len(separator)
        lines.append(cells)
    return lines


def _unquote(cell: str) -> str:
    return cell[1:-1].replace('""', '"').strip() if _QUOTED.fullmatch(cell) else cell


def _read_header(cells: list[_Cell], errors: list[Notice]) -> list[str]:
    """Return the names of the columns.

    Raises:
        RobotError: the line names none, and so is no header.
    """
    names: list[str] = []
    keys: list[str] = []
    if not any(cell.text.lower() in _COLUMNS for cell in cells):
        text = f"no header; the first line names the columns: joint,kind,alpha,a,d,theta ({_COLUMN_HINT})"
        raise RobotError(cells[0].place.notice("robot.table-header", text))
    for cell in cells:
        name = cell.text.lower()
        if name not in _COLUMNS:
            hint = suggest_names(name, _COLUMNS)
            text = f'there is no column "{cell.text}"; {hint + " " if hint else ""}allowed are'
            text = f"{text} {', '.join(_COLUMNS)}"
            errors.append(cell.place.notice("robot.table-header", text))
        elif _COLUMNS[name][0] in keys:
            text = f'"{cell.text}" says the same as a column before; keep one of the two'
            errors.append(cell.place.notice("robot.table-header", text))
        keys.append(_COLUMNS.get(name, ("", None))[0])
        names.append(name)
    missing = [key for key in ("alpha", "a", "d", "theta") if key not in keys]
    if missing:
        text = f"the columns {', '.join(missing)} are missing; the first line names all: alpha,a,d,theta"
        errors.append(cells[0].place.notice("robot.table-header", text))
    return names


def _read_row(
    header: list[str],
    cells: list[_Cell],
    index: int,
    places: dict[KeyPath, Place],
    errors: list[Notice],
) -> dict[str, Any]:
    """Return a row as the table of a joint; where its cells stand goes to `places`."""
    joint: dict[str, Any] = {}
    if len(cells) != len(header):
        text = f"{len(cells)} cells under {len(header)} columns; write 0 where there is nothing"
        errors.append(cells[0].place.notice("robot.table-row", text))
    variables: list[tuple[str, Place]] = []
    for name, cell in zip(header, cells, strict=False):
        key, unit = _COLUMNS.get(name, ("", None))
        if not key or not cell.text:
            continue
        places["joint", index, key] = cell.place
        text = cell.text
        match = _VARIABLE.fullmatch(text) if key not in ("name", "kind") else None
        if match:
            variables.append((key, cell.place))
            text = re.sub(r"^\+\s*", "", match["rest"] or "0").replace("- ", "-")
        if key == "name" and text.isdigit():
            text = f"joint{text}"
        joint[key] = text if key in ("name", "kind") else _convert(text, unit)
        if isinstance(joint[key], str) and key in ("a", "d"):
            _check_length(joint, key, cell, errors)
    _check_variable(joint, variables, cells[0].place, errors)
    return joint


def _check_length(joint: dict[str, Any], key: str, cell: _Cell, errors: list[Notice]) -> None:
    """Tell a length that is no number; a table has no place for the values of symbols."""
    form = parse_linear_form(str(joint[key]))
    if form is None or not form.is_number:
        comma = "; decimals have a point, not a comma" if "," in cell.text else ""
        text = f'{key}: expected a number, got "{cell.text}"{comma}; symbols belong into the robot file'
        errors.append(cell.place.notice("robot.bad-length", text))
        del joint[key]


def _convert(text: str, unit: Decimal | str | None) -> Decimal | str:
    """Return a cell as a robot file would write it: a decimal, or a text such as "pi/2"."""
    number = to_decimal(Decimal(text)) if _NUMBER.fullmatch(text) else None
    if number is None:
        return text
    if unit == "deg":
        return f"{number:f} deg"
    return number * unit if isinstance(unit, Decimal) else number


def _check_variable(
    joint: dict[str, Any], variables: list[tuple[str, Place]], place: Place, errors: list[Notice]
) -> None:
    """Give the joint the kind that its variable says, or tell what does not agree."""
    if len(variables) > 1:
        text = "q stands twice in this row; a joint has one variable, under theta or under d"
        errors.append(variables[1][1].notice("robot.table-row", text))
        joint.setdefault("kind", "revolute")
        return
    if not variables:
        if "kind" not in joint:
            text = "neither q nor kind: write q under theta (revolute) or d (prismatic), or fill in kind"
            errors.append(place.notice("robot.table-row", text))
            joint["kind"] = "revolute"
        return
    key, where = variables[0]
    if key not in _KINDS:
        text = f"q under {key}; a joint turns under theta or slides under d"
        errors.append(where.notice("robot.table-row", text))
        joint.setdefault("kind", "revolute")
        return
    kind = joint.setdefault("kind", _KINDS[key])
    alike = "revolute" if kind == "continuous" else kind
    if alike in ("fixed", "revolute", "prismatic") and alike != _KINDS[key]:
        text = f'q under {key} is a {_KINDS[key]} joint, but kind says "{kind}"; correct one of them'
        errors.append(where.notice("robot.table-row", text))
