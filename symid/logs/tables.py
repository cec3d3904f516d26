"""Tables of text as programs write them: where the table is, how its numbers and units are written.

Path -> text -> separator and decimal mark -> rows of numbers -> heading, units above them -> RawLog.

    Sensor: arm 3                      a preamble: lines that are no part of the table
    Zeit;q1;tau1                       the heading: the line above the numbers that has no numbers
    s;°;Nm                             units in a row of their own, or in brackets in the heading
    0,000;1,25;0,5                     semicolon, tab, comma or spaces; a decimal point or comma

Separator and decimal mark are those by which most cells are numbers. All that was found so, and is not plain
(comma, point, heading first), is in a note.

Supported: UTF-8, UTF-16, Windows-1252 (Latin-1); gzip; comments (# % //), also a heading in the last one
above the numbers; columns of words, passed over; dates of ISO 8601, as seconds; an empty cell, which is NaN.
Not supported: tables without a heading, commas both between columns and in numbers, thousands separators.
"""

import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.environment import read_file
from symid.errors import LogError, Notice
from symid.logs.columns import look_up_unit
from symid.logs.files import LARGEST_ARRAY, RawLog, build_file_error, check_width, split_heading

_MOST_LISTED, _FEWEST = 5, 20
_LOOKED_AT, _LOOKED_AT_LETTERS = 1000, 10**6
"""Lines of a file by which the table is found, more than any preamble has, and their letters."""
_UNPACKED, _RATIO = 50_000_000, 20
"""Bytes that any text may unpack to, and times its size that it may: numbers pack to a third."""
_COMMENT = re.compile(r"#(?!N/A|NV)|//|%(?!time\b)")
"""Beginning of a comment; `rostopic echo -p` begins its heading with %time, spreadsheets write #N/A."""
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_QUOTES = ("[", "(", "/", "'", '"')
_SPACES = re.compile(r"\s+(?![\[(])(?![^\[(]*[\])])")
"""Between columns: not before a unit in brackets, or within one."""
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_DATE = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:[.,]\d{1,9})?) ?(Z|[+-]\d\d:?\d\d)?")
_NO_UNIT = frozenset(("", "-", "none", "n/a"))
_MISSING = frozenset(("na", "n/a", "#n/a", "#nv", "null", "none"))
"""Words that spreadsheets and data frames write for a number that is missing."""
_LABEL, _UNIT_LABELS = "name", frozenset(("unit", "units", "y_unit_label"))
"""First cells of rows above the numbers, where a program labels them: names of columns, units."""
_MARKED = re.compile(r"\s*(?:Unit|Type|Interp|BlockPath|PortIndex): ?(.*)")
"""Cells of the rows that Simulink's Data Inspector writes below the heading."""
_REMARK = "comment"
"""Last name of a heading, whose column may be left out in rows (LabVIEW)."""


class _Line(NamedTuple):
    """A line that is not empty: its number in the file, counted from one, and its text."""

    number: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """How a table is written: separator (a space: any white space), decimal mark, number of columns."""

    separator: str = ","
    decimal: str = "."
    columns: int = 0

    def split(self, lines: Sequence[_Line]) -> list[list[str]]:
        """Return the cells of lines."""
        if self.separator == " ":
            return [[cell.strip('"') for cell in _SPACES.split(line.text.strip())] for line in lines]
        texts = (line.text for line in lines)
        return list(csv.reader(texts, delimiter=self.separator, skipinitialspace=True))

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number; Python and numpy read 1_000 as one, no other program does."""
        try:
            float(self.write_plain(cell))
        except ValueError:
            return False
        return "_" not in cell

    def is_value(self, cell: str) -> bool:
        """Return whether a cell is a number or a date."""
        return self.is_number(cell) or _DATE.fullmatch(cell.strip()) is not None

    def write_plain(self, cell: str) -> str:
        """Return a number with a decimal point, and nan for an empty cell."""
        cell = cell.strip()
        if self.decimal == "," and _COMMA.fullmatch(cell):
            cell = cell.replace(",", ".")
        return cell or "nan"


_LAYOUTS = tuple(
    _Layout(separator=separator, decimal=decimal)
    for separator in (",", ";", "\t", " ")
    for decimal in (".", ",")[: 1 if separator == "," else 2]
)
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}


def read_csv(path: Path) -> RawLog:
    """Return the columns of a text file, or raise a LogError with all bad lines and cells."""
    said: list[str] = []
    text = _decode(path, said)
    numbered = (_Line(number, one) for number, one in enumerate(re.split("\r\n|\r|\n", text), 1))
    every = [entry for entry in numbered if entry.text.strip(" \t;,")]
    filled = [entry for entry in every if not _COMMENT.match(entry.text)]
    if not filled:
        raise build_file_error(path, "the file has no line with column names")
    looked, letters = list[_Line](), 0
    for entry in filled[:_LOOKED_AT]:
        check_width(path, max(map(entry.text.count, ",;\t ")))
        letters += len(entry.text)
        if letters > _LOOKED_AT_LETTERS and len(looked) > _FEWEST:
            break
        looked.append(entry)
    try:
        layout = _choose_layout(looked)
        rows = layout.split(filled)
    except csv.Error as error:
        raise build_file_error(path, f"this is not a table that can be read: {error}") from error
    commas = [cell.strip() for row in rows[:_LOOKED_AT] for cell in row if _COMMA.fullmatch(cell.strip())]
    if layout.decimal == "," and all(map(_THOUSANDS.fullmatch, commas)):
        text = f"numbers such as {commas[0]} may have a decimal comma or thousands apart; write decimal "
        text += "points"
        raise build_file_error(path, text, "log.separator")
    place, units_place, start = _find_heading(rows, layout)
    if place < 0 and (heading := _find_comment_heading(every, filled[start], layout)) is not None:
        # As numpy.savetxt writes it.
        cells, line = layout.split([heading])[0], heading.number
        said.append(f"the comment in line {line} is taken as the heading")
    else:
        cells, line = rows[max(place, 0)], filled[max(place, 0)].number
    start = max(start, 1) if place < 0 and not said else start
    found = [split_heading(cell) for cell in cells]
    data = [(filled[at].number, rows[at]) for at in range(start, len(rows)) if rows[at] != cells]
    if (again := len(rows) - start - len(data)) > 0:
        said.append(f"the heading stands in the table again ({again} times), and was skipped")
    width = Counter(len(row) for _, row in data).most_common(1)[0][0] if data else len(found)
    if len(found) == width + 1 and found[-1][0].lower() in ("", _REMARK):
        found.pop()
    elif len(found) == width - 1 and not any(row[-1].strip() for _, row in data):
        # A separator behind the last column.
        data = [(number, row[:-1]) for number, row in data]
    names = [name for name, _ in found]
    _check_heading(path, layout, names, line, data)
    units = {name: unit for name, unit in found if unit is not None}
    if units_place >= 0:
        own = dict(zip(names, map(_clean_unit, rows[units_place]), strict=False))
        units |= {name: unit for name, unit in own.items() if unit.lower() not in _NO_UNIT | _UNIT_LABELS}
        said.append(f"units are those in line {filled[units_place].number}")
    plain = layout.separator == "," or (layout.separator, layout.decimal) in ((";", "."), ("\t", "."))
    if not plain:
        mark = "decimal commas" if layout.decimal == "," else "decimal points"
        said.insert(0, f"the table has {_NAMES[layout.separator]} between columns, and {mark}")
    if place > 0 and (above := place - (0 <= units_place < place)) > 0:
        said.append(f"{above} lines above the heading, line {line}, were skipped")
    columns, texts, dates = _read_columns(path, names, data, layout, said)
    units = {name: "s" if name in dates else unit for name, unit in units.items() if name not in texts}
    units |= dict.fromkeys(dates, "s")
    notices = tuple(Notice(code="log.layout", text=text, file=str(path)) for text in said)
    return RawLog(columns=columns, units=units, others=texts, line=line, notices=notices)


def _decode(path: Path, said: list[str]) -> str:
    """Return the text of a file, unpacked; what is not stated in it is said."""
    try:
        content = read_file(path, LARGEST_ARRAY)
        if content[:2] == b"\x1f\x8b":
            most = max(_UNPACKED, _RATIO * len(content))
            with gzip.open(path) as stream:
                content = stream.read(most + 1)
            if len(content) > most:
                text = f"the text unpacks to more than {most / 1e6:.3g} MB; unpack it, or cut the log"
                raise build_file_error(path, text, "log.too-large")
    except (OSError, EOFError, zlib.error, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise build_file_error(path, f"this is not a text file that can be read: {reason}") from error
    encoding, head = "utf-8-sig", content[:_LOOKED_AT]
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif 4 * max(head[::2].count(0), head[1::2].count(0)) > len(head):
        # Every other byte of Latin letters is zero.
        encoding = "utf-16-be" if head[:1] == b"\0" else "utf-16-le"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        try:
            text = content.decode("cp1252")
        except UnicodeDecodeError:
            raise build_file_error(path, f"this is not a text file that can be read: {error}") from error
        said.append("the text is no UTF-8, and was read as Windows-1252 (Latin-1)")
    if found := _BINARY.search(text[: 1000 * _LOOKED_AT]):
        reason = f"the character {found[0]!r} does not occur in text"
        raise build_file_error(path, f"this is not a text file that can be read: {reason}")
    return text


def _choose_layout(lines: Sequence[_Line]) -> _Layout:
    """Return the layout by which most cells of lines with as many cells are numbers, and fewest are words."""
    found: list[tuple[int, _Layout]] = []
    for layout in _LAYOUTS:
        scores, points = Counter[int](), Counter[int]()
        for row in layout.split(lines):
            numbers = sum(map(layout.is_number, filter(None, row)))
            scores[len(row)] += 2 * numbers - sum(bool(cell.strip()) for cell in row) if numbers else 0
            points[len(row)] += sum("," in cell and _COMMA.fullmatch(cell) is not None for cell in row)
        columns, score = max(scores.items(), key=lambda entry: entry[1])
        # A comma is none where no number has it.
        if layout.decimal == "." or points[columns]:
            found.append(
                (score, _Layout(separator=layout.separator, decimal=layout.decimal, columns=columns))
            )
    score, best = max(found, key=lambda entry: entry[0])
    if score > 0:
        return best
    separator = max(",;\t", key=lines[0].text.count)
    return _Layout(separator=separator, columns=len(_Layout(separator=separator).split(lines[:1])[0]))


def _find_heading(rows: list[list[str]], layout: _Layout) -> tuple[int, int, int]:
    """Return the places of the heading, of a row of units, and of the first numbers; -1 for none."""
    looked = rows[:_LOOKED_AT]
    own = [row for row in looked if len(row) == layout.columns]
    counts = [
        sum(not row[k].strip() or layout.is_value(row[k]) for row in own) for k in range(layout.columns)
    ]
    numeric = [k for k, count in enumerate(counts) if 2 * count > len(own)] or [*range(layout.columns)]

    def find_values(row: list[str]) -> list[bool]:
        return (
            [layout.is_value(row[k]) for k in numeric if row[k].strip()] if len(row) == layout.columns else []
        )

    def is_data(row: list[str]) -> bool:
        return all(found := find_values(row)) and bool(found)

    first = next((at for at, row in enumerate(looked) if is_data(row)), 0)
    if first == 0:
        return (-1, -1, 0) if is_data(looked[0]) else (0, -1, 1)
    above = [at for at in range(first) if len(rows[at]) == layout.columns]
    labelled = [at for at in above if rows[at][0].strip().lower() == _LABEL]
    units = [at for at in above if rows[at][0].strip().lower() in _UNIT_LABELS]
    if labelled:
        return labelled[-1], units[-1] if units else -1, first
    at = first - 1
    # Above the first good numbers may stand bad ones.
    while at > 0 and any(find_values(rows[at])):
        at -= 1
    start = at + 1
    marked = -1
    while at > 0 and all(map(_MARKED.fullmatch, (cells := [*filter(None, rows[at])]))):
        marked = at if any(cell.startswith("Unit") for cell in cells) else marked
        at -= 1
    if marked >= 0:
        return at, marked, start
    if at > 0 and len(rows[at]) == len(rows[at - 1]) and _are_units(rows[at]):
        return at - 1, at, start
    return at, units[-1] if units else -1, start


def _clean_unit(cell: str) -> str:
    marked = _MARKED.fullmatch(cell)
    return (marked[1] if marked else cell).strip().strip("[]()").strip()


def _are_units(row: Sequence[str]) -> bool:
    """Return whether most cells of a row that have something are units."""
    stated = [unit for unit in map(_clean_unit, row) if unit.lower() not in _NO_UNIT]
    return 2 * sum(look_up_unit(unit) is not None for unit in stated) > len(stated)


def _find_comment_heading(every: Sequence[_Line], first: _Line, layout: _Layout) -> _Line | None:
    """Return the last comment above the first numbers without its sign, if it names every column."""
    above = [line for line in every if line.number < first.number]
    if not above:
        return None
    line = _Line(above[-1].number, above[-1].text.lstrip("#%/ "))
    cells = layout.split([line])[0]
    names_all = len(cells) == layout.columns and not any(map(layout.is_number, cells))
    return line if names_all else None


def _check_heading(
    path: Path, layout: _Layout, names: list[str], line: int, data: Sequence[tuple[int, list[str]]]
) -> None:
    """Refuse a heading that does not name the columns, each by a name of its own, or with equal cells."""
    places: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        places.setdefault(name, []).append(k)
    widths = {len(row) for _, row in data}
    whole = widths == {len(names)}
    twice = [
        repr(name)
        for name, own in sorted(places.items())
        if len(own) > 1 and not (whole and all(len({row[k] for k in own}) == 1 for _, row in data))
    ]
    if all(map(layout.is_number, names)):
        code = "log.no-heading"
        text = "the first line has numbers; it must name the columns, as in: t [s],q1 [rad],tau1 [N m]"
    elif layout.separator == "," and len(names) > 1 and widths == {2 * len(names)}:
        code = "log.separator"
        text = "commas stand between columns and in numbers; write the table again with semicolons or tabs"
    elif twice:
        code = "log.duplicate-column"
        text = f"more than one column is named {', '.join(twice)}; give each its own name"
    else:
        return
    raise LogError(Notice(code=code, text=text, file=str(path), line=line))


_Problems = list[tuple[int, str, str]]
"""Line, code and text of what is wrong."""
_Cells = Sequence[tuple[int, str]]
"""Line and cell of each sample of a column."""


def _read_columns(
    path: Path,
    names: list[str],
    data: Sequence[tuple[int, list[str]]],
    layout: _Layout,
    said: list[str],
) -> tuple[dict[str, FloatArray], tuple[str, ...], tuple[str, ...]]:
    """Return the columns of numbers by name, the names of those of words, and of those that were dates."""
    problems: _Problems = [
        (number, "log.line-length", f"{len(cells)} cells, the heading names {len(names)} columns")
        for number, cells in data
        if len(cells) != len(names)
    ]
    columns: dict[str, FloatArray] = {}
    words, dates = list[str](), list[str]()
    if not problems:
        looked = [[cell.strip() for cell in row] for _, row in data[:_FEWEST]]
        for k, name in enumerate(names):
            shown = [row[k] for row in looked if row[k]]
            wordy = all(cell[:1].isalpha() or ":" in cell for cell in shown)
            wordy = wordy and not any(map(layout.is_number, shown))
            if shown and all(map(_DATE.fullmatch, shown)):
                dates.append(name)
            elif shown and (wordy or all(cell[:1] in _QUOTES for cell in shown)):
                words.append(name)
        # Columns of words are left out, unless that is every one.
        words = words if len(words) < len(names) else []
        for k, name in enumerate(names):
            if name not in words and name not in columns:
                cells = [(number, row[k]) for number, row in data]
                if name in dates:
                    columns[name] = _read_dates(name, cells, problems)
                else:
                    columns[name] = _read_numbers(name, cells, layout, problems)
    if len(columns) < len(names) - len(words):
        said.append("of columns with one name and equal cells one was read")
    if dates:
        text = f"dates of {', '.join(map(repr, dates))} became s from the whole second of the first one"
        said.append(text)
    more = len(problems) - _MOST_LISTED
    problems = sorted(problems)[:_MOST_LISTED]
    if more > 0:
        problems.append((0, "log.more", f"{more} more lines or cells like these"))
    if problems:
        raise LogError(
            *(Notice(code=code, text=text, file=str(path), line=at) for at, code, text in problems)
        )
    return columns, tuple(words), tuple(dates)


def _read_numbers(name: str, cells: _Cells, layout: _Layout, problems: _Problems) -> FloatArray:
    """Return the numbers of a column (N,), NaN for missing ones; what is none is added to the problems."""
    texts = [cell for _, cell in cells]
    for _ in range(2):
        if not any("_" in cell for cell in texts):
            with suppress(ValueError):
                return np.array(list(map(layout.write_plain, texts)), dtype=np.float64)
        texts = ["" if cell.strip().lower() in _MISSING else cell for cell in texts]
    mark = "comma" if layout.decimal == "," else "point"
    lines = (line for line, _ in cells)
    wrong = [own for own in zip(lines, texts, strict=True) if own[1].strip() and not layout.is_number(own[1])]
    problems += (
        (line, "log.not-a-number", f"column {name!r}: {cell!r} is not a number (use a decimal {mark})")
        for line, cell in wrong
    )
    return np.zeros(0)


def _read_dates(name: str, cells: _Cells, problems: _Problems) -> FloatArray:
    """Return the dates of a column in s from the whole second of the first (N,); empty cells are NaN."""
    stamps = np.full(len(cells), "NaT", dtype="datetime64[ns]")
    for place, (line, cell) in enumerate(cells):
        found = _DATE.fullmatch(cell.strip())
        if found is None:
            if cell.strip():
                problems.append(
                    (line, "log.not-a-number", f"column {name!r}: {cell!r} is no date as those above")
                )
            continue
        try:
            stamps[place] = np.datetime64(f"{found[1]}T{found[2].replace(',', '.')}")
        except ValueError:
            problems.append((line, "log.not-a-number", f"column {name!r}: there is no date {cell!r}"))
        if (zone := found[3]) and zone != "Z":
            minutes = 60 * int(zone[1:3]) + int(zone[-2:])
            stamps[place] -= np.timedelta64(minutes if zone[0] == "+" else -minutes, "m")
    known = stamps[~np.isnat(stamps)]
    first = known.min() if len(known) else np.datetime64(0, "ns")
    steps = (stamps - first.astype("datetime64[s]")).astype(np.int64)
    return np.where(np.isnat(stamps), np.nan, steps * 1e-9)
