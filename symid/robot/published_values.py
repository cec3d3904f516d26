"""A table of parameters and their values, as others publish them.

A text file with a line of column names and one line a parameter

    parameter,ols,ols_std_percent,wls,wls_std_percent
    Izz1 + 1.0*Ia1,1.247,0.98,1.242,1.1

-> `PublishedTable`, or one `EstimateError` with all that is wrong, each with its line.

Supported: comma, semicolon or tab between columns; comments from # at the start of a line; cells in double
quotes; deviations in the unit of the value or in percent of it; columns chosen by name, or guessed where
there is no other; lines without a value are passed over and listed. The minus of typography counts as a
minus.
Not supported: a decimal comma, a percent sign behind each number, cells of several lines.
"""

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from symid.errors import EstimateError, Notice, RobotError, UsageError
from symid.robot.toml_values import read_text_file

N = TypeVar("N")

_SEPARATORS = (",", ";", "\t")
_NAMES = ("name", "parameter", "base_parameter", "group", "grouping", "expression")
_VALUES = ("value", "estimate", "estimated", "identified")
_DEVIATIONS = ("std", "stdev", "stddev", "sd", "sigma", "deviation", "error")
_PERCENT = ("percent", "pct", "%")
_RELATIVE = ("rel", "relative")

_LARGEST = 1e100
_NUMBER_LIKE = re.compile(r"[+-]?[\d.,]*\d[\d.,]*([eE][+-]?\d+)?\s*%?")
"""What somebody took for a number, whether it can be read or not."""

_Cells = tuple[int, list[str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumns:
    """Which columns to read: their names, None where they are to be guessed.

    `percent`: whether deviations are in percent of the value; None: by the name of their column.
    """

    name: str | None = None
    value: str | None = None
    deviation: str | None = None
    percent: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow(Generic[N]):
    """A line of the table: the name as it stands there and as it was read, value and deviation."""

    line: int
    text: str
    name: N
    value: float
    deviation: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedTable(Generic[N]):
    """The rows, the columns they were read from (`columns`, none left open), and lines without a value."""

    path: str
    columns: TableColumns
    rows: tuple[TableRow[N], ...]
    empty: tuple[tuple[int, str], ...]


def read_value_table(path: Path, columns: TableColumns, read_name: Callable[[str], N]) -> PublishedTable[N]:
    """Return the table at `path`.

    Args:
        path: a text file, see above.
        columns: the columns to read.
        read_name: what a name means; its UsageError is told with the name's line.

    Raises:
        UsageError: a column is not there, or several could be meant.
        EstimateError: with a notice for each mistake in the file.
    """
    file = str(path)
    try:
        lines = _split_lines(file, read_text_file(path, noun="table"))
    except RobotError as error:
        raise EstimateError(*(replace(entry, code="table.unreadable") for entry in error.notices)) from error
    if not lines:
        text = "empty; the first line names the columns, as in: parameter,value,std"
        raise EstimateError(Notice(code="table.header", text=text, file=file, line=1))
    heading = [cell.strip() for cell in lines[0][1]]
    _check_heading(file, lines[0][0], heading)
    if len(lines) == 1:
        raise EstimateError(_build_no_rows_notice(file, lines[0][0]))
    chosen = _choose_columns(file, heading, lines[1:], columns)
    notices: list[Notice] = []
    rows: list[TableRow[N]] = []
    empty: list[tuple[int, str]] = []
    for number, cells in lines[1:]:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(heading):
            text = f"{len(cells)} cells, the first line names {len(heading)} columns"
            notices.append(Notice(code="table.line-length", text=text, file=file, line=number))
            continue
        row, wrong = _read_row(number, dict(zip(heading, cells, strict=True)), chosen, read_name)
        notices += [replace(notice, file=file, line=number) for notice in wrong]
        if isinstance(row, TableRow):
            rows.append(row)
        else:
            empty.append((number, row))
    notices += _list_repeated_names(file, rows)
    if not notices and not rows:
        notices.append(_build_no_rows_notice(file, lines[0][0]))
    if notices:
        raise EstimateError(*sorted(notices, key=lambda notice: notice.line))
    return PublishedTable(path=file, columns=chosen, rows=tuple(rows), empty=tuple(empty))


def _build_no_rows_notice(file: str, line: int) -> Notice:
    text = "no line has a value; write one line a parameter below the line of column names"
    return Notice(code="table.no-rows", text=text, file=file, line=line)


def _split_lines(file: str, text: str) -> list[_Cells]:
    """Return number and cells of every line that holds more than a comment.

    Raises:
        EstimateError: a line is no line of a table.
    """
    kept = [
        (number, line)
        for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    separator = max(_SEPARATORS, key=kept[0][1].count) if kept else ","
    lines = []
    for number, line in kept:
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error as error:
            text = f"this is no line of a table: {error}"
            raise EstimateError(Notice(code="table.unreadable", text=text, file=file, line=number)) from error
        lines.append((number, cells))
    return lines


def _check_heading(file: str, line: int, heading: Sequence[str]) -> None:
    """Refuse a first line that does not tell columns apart.

    Raises:
        EstimateError: it holds numbers, or a name twice.
    """
    if any(_to_number(cell) is not None for cell in heading):
        text = "the first line holds a number; it must name the columns, as in: parameter,value,std"
        raise EstimateError(Notice(code="table.header", text=text, file=file, line=line))
    twice = [name for name in dict.fromkeys(heading) if heading.count(name) > 1]
    if twice:
        text = f"there is more than one column {', '.join(map(repr, twice))}; column names must differ"
        raise EstimateError(Notice(code="table.header", text=text, file=file, line=line))


def _choose_columns(
    file: str, heading: Sequence[str], lines: Sequence[_Cells], columns: TableColumns
) -> TableColumns:
    """Return the columns to read, with those that were left open guessed.

    Raises:
        UsageError: one is not there, or there is no one to guess.
    """
    numeric = [
        name
        for place, name in enumerate(heading)
        if any(place < len(cells) and _looks_like_number(cells[place]) for _, cells in lines)
    ]
    names = [name for name in heading if _normalise_name(name) in _NAMES] or [
        name for name in heading if name not in numeric
    ]
    name = _choose_column(file, "--name", columns.name, heading, names)
    spreads = [entry for entry in numeric if entry != name and _is_deviation(entry)]
    values = [entry for entry in numeric if entry not in (name, *spreads, columns.deviation)]
    value = _choose_column(
        file,
        "--value",
        columns.value,
        heading,
        [v for v in values if _normalise_name(v) in _VALUES] or values,
    )
    beside = [entry for entry in spreads if _normalise_name(entry).startswith(_normalise_name(value))]
    # A deviation that belongs to another column of values says nothing of this one.
    free = [
        entry
        for entry in spreads
        if not any(_normalise_name(entry).startswith(_normalise_name(v)) for v in values)
    ]
    likely = [entry for entry in (beside or free) if entry != value]
    deviation = columns.deviation
    if deviation is not None or likely:
        deviation = _choose_column(file, "--deviation", deviation, heading, likely)
    percent = columns.percent
    if deviation is not None and percent is None:
        percent = _is_percent(file, deviation)
    return TableColumns(name=name, value=value, deviation=deviation, percent=bool(percent))


def _choose_column(
    file: str, option: str, given: str | None, heading: Sequence[str], likely: Sequence[str]
) -> str:
    if given is not None:
        if given in heading:
            return given
        text = f"{option} {given}: there is no such column; the table has {', '.join(heading)}"
        raise UsageError(Notice(code="usage.table-column", text=text, file=file))
    if len(likely) == 1:
        return likely[0]
    which = f"could be any of {', '.join(likely)}" if likely else f"is none of {', '.join(heading)}"
    text = f"the column for {option} {which}; name it by {option} COLUMN"
    raise UsageError(Notice(code="usage.table-column", text=text, file=file))


def _normalise_name(name: str) -> str:
    return name.strip().lower().replace(" ", "_").replace("-", "_")


def _split_name(name: str) -> list[str]:
    return _normalise_name(name).replace("[", "_").replace("(", "_").split("_")


def _is_percent(file: str, name: str) -> bool:
    """Return whether a column of deviations is in percent, by its name.

    Raises:
        UsageError: it is relative, to one or to a hundred.
    """
    if any(mark in _normalise_name(name) for mark in _PERCENT):
        return True
    if any(part in _RELATIVE for part in _split_name(name)):
        text = f"column {name!r} is relative, and does not say of what; give --deviation-unit"
        raise UsageError(Notice(code="usage.table-column", text=text, file=file))
    return False


def _is_deviation(name: str) -> bool:
    folded = _normalise_name(name).replace("[", "_").replace("(", "_")
    return any(part in _DEVIATIONS for part in folded.split("_")) or any(mark in folded for mark in _PERCENT)


def _looks_like_number(text: str) -> bool:
    """Return whether a cell is a number, or was meant as one: a column of such cells is not passed over."""
    return _to_number(text) is not None or _NUMBER_LIKE.fullmatch(_normalise_minus(text).strip()) is not None


def _normalise_minus(text: str) -> str:
    return text.replace("\N{MINUS SIGN}", "-")


def _to_number(text: str) -> float | None:
    # Python reads 1_000 as a number, no other program does.
    try:
        number = float(_normalise_minus(text)) if "_" not in text else math.nan
    except ValueError:
        return None
    return number if abs(number) <= _LARGEST else None


def _read_row(
    line: int, cells: dict[str, str], columns: TableColumns, read_name: Callable[[str], N]
) -> tuple[TableRow[N] | str, list[Notice]]:
    """Return the row, or its name where it has no value; and what is wrong with it, without its file."""
    text = cells[str(columns.name)].strip()
    notices: list[Notice] = []
    name = None
    try:
        name = read_name(text)
    except UsageError as error:
        notices += error.notices
    raw = cells[str(columns.value)].strip()
    value = _read_number(str(columns.value), raw, notices) if raw else None
    shown = cells[columns.deviation].strip() if columns.deviation is not None else ""
    deviation = _read_number(str(columns.deviation), shown, notices) if raw and shown else None
    if deviation is not None and deviation < 0.0:
        notices.append(_build_cell_notice(str(columns.deviation), shown, "is negative"))
    if name is None or value is None:
        return text, notices
    if deviation is not None and columns.percent:
        # A part of zero is zero, and says nothing of what a rounded value may be.
        deviation = deviation * abs(value) / 100.0 if value else None
    return TableRow(line=line, text=text, name=name, value=value, deviation=deviation), notices


def _read_number(column: str, text: str, notices: list[Notice]) -> float | None:
    number = _to_number(text)
    if number is None:
        what = "is not a number up to 1e100 (a decimal point is wanted"
        sign = ", and percent stands in the name of the column" if "%" in text else ""
        notices.append(_build_cell_notice(column, text, f"{what}{sign})"))
    return number


def _build_cell_notice(column: str, text: str, what: str) -> Notice:
    return Notice(code="table.not-a-number", text=f"column {column!r}: {text!r} {what}")


def _list_repeated_names(file: str, rows: Sequence[TableRow[N]]) -> list[Notice]:
    seen: dict[str, int] = {}
    notices = []
    for row in rows:
        key = "".join(row.text.split())
        if key in seen:
            text = f"{row.text!r} stands in line {seen[key]} already"
            notices.append(Notice(code="table.repeated", text=text, file=file, line=row.line))
        seen.setdefault(key, row.line)
    return notices
