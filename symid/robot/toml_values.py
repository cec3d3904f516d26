"""Typed values out of a TOML text, each with its place, and a notice for each mistake.

A path -> the text of a file (UTF-8). A text that `tomllib` accepts -> `Places`, a place (line and column
from one, raw text) for every key path; a path is made of names and, within arrays, indices: ("joint", 0,
"alpha"). A table as `tomllib` gives it, with decimals kept as decimals -> values of the type asked for,
None where a value is absent or wrong; what is wrong goes to the `InputReport`.

Supported: all of TOML 1.0: tables, arrays of tables and their sub-tables, dotted and quoted keys, inline
tables, arrays over several lines, every kind of string, comments; texts, choices, flags, integers,
decimals, lists of decimals, tables.
Not supported: places in texts that are not TOML; the scanner validates nothing.
"""

import difflib
import math
import re
import tomllib
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from symid.errors import Notice, RobotError
from symid.notation import get_unit_factor


def read_text_file(path: Path, noun: str = "file") -> str:
    """Return the text of the file at `path`, which messages call `noun`.

    Raises:
        RobotError: it cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        text = f"cannot be read: {error.strerror or 'it cannot be read'}"
        raise RobotError(Notice(code="robot.unreadable", text=text, file=str(path))) from error
    except UnicodeDecodeError as error:
        text = f"not UTF-8 text (byte {error.start}); save the {noun} as UTF-8"
        raise RobotError(Notice(code="robot.unreadable", text=text, file=str(path))) from error


KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r'[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|\'[^\']*\'')
# A string of several lines may end in up to two quotes of its own.
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"""(?:"{0,2})|\'\'\'.*?\'\'\'(?:\'{0,2})|"(?:[^"\\]|\\.)*"|\'[^\']*\'', re.DOTALL
)
_BARE_VALUE = re.compile(r"[^,\]}#\n]+")


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file, and the text that stands there."""

    file: str
    line: int
    column: int
    text: str = ""

    def notice(self, code: str, text: str) -> Notice:
        """Return a notice on what stands here."""
        return Notice(code=code, text=text, file=self.file, line=self.line, column=self.column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """The places of keys and values by key path; `whole` is the place of the text itself."""

    keys: Mapping[KeyPath, Place]
    values: Mapping[KeyPath, Place]
    whole: Place

    def find_key(self, path: KeyPath) -> Place:
        """Return where the key at `path` stands, or else the nearest table around it."""
        return self.keys[path] if path in self.keys else self.find_value(path[:-1])

    def find_value(self, path: KeyPath) -> Place:
        """Return where the value at `path` stands, or else the nearest table around it."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path, self.whole)


def locate_values(text: str, file: str = "") -> Places:
    """Return the places of all keys and values in the TOML `text`.

    Args:
        text: valid TOML whose lines end in a line feed alone.
        file: the name that the places carry.
    """
    scanner = _Scanner(text, file)
    scanner.scan_document()
    return Places(keys=scanner.keys, values=scanner.values, whole=Place(file, 1, 1))


class _Scanner:
    """A cursor in the text, and the places found so far."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.position = 0
        self.keys: dict[KeyPath, Place] = {}
        self.values: dict[KeyPath, Place] = {}
        self._line_ends = [match.start() for match in re.finditer(r"\n", text)]
        self._tables: dict[KeyPath, int] = {}

    def scan_document(self) -> None:
        prefix: KeyPath = ()
        self._skip(_BLANK)
        while self.position < len(self.text):
            if self.text[self.position] == "[":
                prefix = self._scan_header()
            else:
                self._scan_pair(prefix)
            self._skip(_BLANK)

    def _scan_header(self) -> KeyPath:
        """Return the path that the keys below `[a.b]` or `[[a.b]]` belong to."""
        start = self.position
        brackets = 2 if self.text.startswith("[[", start) else 1
        self.position += brackets
        names = self._scan_key()
        self.position += brackets
        path: KeyPath = ()
        for number, (name, place) in enumerate(names, start=1):
            path = (*path, name)
            self.keys.setdefault(path, place)
            self.values.setdefault(path, place)
            if number == len(names) and brackets == 2:
                self._tables[path] = self._tables.get(path, 0) + 1
            if path in self._tables:
                path = (*path, self._tables[path] - 1)
        self.keys[path] = names[-1][1]
        # A header says more on a table than a sub-table's header before it.
        self.values[path] = self._place(start, self.position)
        return path

    def _scan_pair(self, prefix: KeyPath) -> None:
        names = self._scan_key()
        self.position += 1
        path = prefix
        for name, place in names:
            path = (*path, name)
            self.keys.setdefault(path, place)
            self.values.setdefault(path, place)
        self._skip(_SPACE)
        self._scan_value(path)

    def _scan_key(self) -> list[tuple[str, Place]]:
        """Return the parts of a dotted key, with the cursor behind it and its white space."""
        names = []
        while True:
            self._skip(_SPACE)
            start = self.position
            self._skip(_KEY)
            raw = self.text[start : self.position]
            name = tomllib.loads(f"key = {raw}")["key"] if raw[0] in "\"'" else raw
            names.append((name, self._place(start, self.position)))
            self._skip(_SPACE)
            if self.text[self.position] != ".":
                return names
            self.position += 1

    def _scan_value(self, path: KeyPath) -> None:
        start = self.position
        match self.text[start]:
            case "[":
                self._scan_array(path)
            case "{":
                self._scan_inline_table(path)
            case '"' | "'":
                self._skip(_STRING)
            case _:
                self._skip(_BARE_VALUE)
                self.position = start + len(self.text[start : self.position].rstrip())
        self.values[path] = self._place(start, self.position)

    def _scan_array(self, path: KeyPath) -> None:
        index = 0
        self.position += 1
        self._skip(_BLANK)
        while self.text[self.position] != "]":
            self._scan_value((*path, index))
            index += 1
            self._skip(_BLANK)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANK)
        self.position += 1

    def _scan_inline_table(self, path: KeyPath) -> None:
        self.position += 1
        self._skip(_BLANK)
        while self.text[self.position] != "}":
            self._scan_pair(path)
            self._skip(_BLANK)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANK)
        self.position += 1

    def _skip(self, pattern: re.Pattern[str]) -> None:
        match = pattern.match(self.text, self.position)
        if match:
            self.position = match.end()

    def _place(self, start: int, end: int) -> Place:
        line = bisect_left(self._line_ends, start)
        before = self._line_ends[line - 1] if line else -1
        return Place(self.file, line + 1, start - before, self.text[start:end])


BASE = "base"
"""What the first joint of a robot file is fixed to; no joint has this name."""

_LONGEST_SHOWN = 40
# Beyond this many decimal places a number is a slip, and exact arithmetic with it would not end.
_LARGEST_EXPONENT = 30
# Limits in degrees lie between these; beyond, a number stands for no limit.
_WIDE, _WIDEST = 40, 1000
_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(\S.*?)\s*")


@dataclass(frozen=True, slots=True)
class InputReport:
    """What is wrong with a file, gathered while it is read, and what is only worth saying."""

    places: Places
    errors: list[Notice] = field(default_factory=list)
    warnings: list[Notice] = field(default_factory=list)

    def notices(self) -> tuple[Notice, ...]:
        """Return the errors in the order of their places."""
        return tuple(sorted(self.errors, key=_get_order))

    def remarks(self) -> tuple[Notice, ...]:
        """Return the warnings in the order of their places."""
        return tuple(sorted(self.warnings, key=_get_order))


def _get_order(notice: Notice) -> tuple[int, int]:
    return (notice.line, notice.column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A table that is being read: where it stands in the file, and how messages call it."""

    values: Mapping[str, Any]
    path: KeyPath
    report: InputReport
    label: str = ""

    def refuse(self, code: str, key: str, text: str, *inner: int) -> None:
        """Add an error at the value of `key`, or at its element `inner`."""
        place = self.report.places.find_value((*self.path, key, *inner))
        self.report.errors.append(self._notice(code, place, key, text))

    def warn(self, code: str, key: str, text: str, *inner: int) -> None:
        """Add a warning at the value of `key`, or at its element `inner`."""
        place = self.report.places.find_value((*self.path, key, *inner))
        self.report.warnings.append(self._notice(code, place, key, text))

    def refuse_key(self, code: str, key: str, text: str) -> None:
        """Add an error at the name of `key`; at the table, if the key is missing."""
        place = self.report.places.find_key((*self.path, key))
        self.report.errors.append(self._notice(code, place, key, text))

    def inside(self, values: Mapping[str, Any], label: str, *path: str | int) -> "Section":
        """Return a table that stands at `path` of this one."""
        return Section(values=values, path=(*self.path, *path), report=self.report, label=label)

    def show(self, key: str, *inner: int) -> str:
        """Return the value as the file writes it, shortened."""
        place = self.report.places.values.get((*self.path, key, *inner))
        value: Any = self.values.get(key)
        return show(place.text if place else str(value))

    def _notice(self, code: str, place: Place, key: str, text: str) -> Notice:
        return place.notice(code, f"{self.label}: {key}: {text}" if self.label else f"{key}: {text}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """What a number may be: from `low` to `high`, both allowed unless `open_low`."""

    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False

    def __contains__(self, value: Decimal | float) -> bool:
        """Return whether `value` lies in the range."""
        return (value > self.low if self.open_low else value >= self.low) and value <= self.high

    def __str__(self) -> str:
        """Return the range in words."""
        words = []
        if self.low > -math.inf:
            words.append(f"greater than {self.low:g}" if self.open_low else f"at least {self.low:g}")
        if self.high < math.inf:
            words.append(f"at most {self.high:g}")
        return " and ".join(words)


ANY = Range()
POSITIVE = Range(low=0, open_low=True)
NOT_NEGATIVE = Range(low=0)


def show(text: str) -> str:
    """Return `text` on one line, shortened in the middle of a message."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_SHOWN else line[: _LONGEST_SHOWN - 3] + "..."


def suggest_names(name: str, allowed: Iterable[str], *, likeness: float = 0.5) -> str:
    """Return a question with the names most like `name`, or nothing; blanks around a name are pointed out."""
    names = list(allowed)
    if blank := _explain_blanks(name, names):
        return blank
    near = difflib.get_close_matches(name.lower(), [known.lower() for known in names], n=2, cutoff=likeness)
    found = [known for known in names if known.lower() in near]
    return f"did you mean {' or '.join(found)}?" if found else ""


def _explain_blanks(name: str, known: Iterable[str]) -> str:
    """Return in words that a name is one of `known` but for the blanks around it, or nothing."""
    near = next((other for other in known if other.strip() == name.strip()), None)
    if near is None or near == name:
        return ""
    longer, where = (name, "here") if name != name.strip() else (near, "there")
    side = "at the end" if longer != longer.rstrip() else "at the start"
    return f'did you mean "{near}"? there is a blank {side} of the name {where}'


def get_element(section: Section, key: str, *inner: int) -> object:
    """Return the value at `key`, or its element `inner`, as it was read; None where there is none."""
    value: Any = section.values.get(key)
    for index in inner:
        value = value[index] if isinstance(value, list) and index < len(value) else None
    return value


def refuse_unknown_keys(section: Section, allowed: Iterable[str]) -> None:
    """Add an error for each key that is not allowed in this table."""
    names = tuple(allowed)
    for key in section.values:
        if key not in names:
            hint = f"{suggest_names(key, names, likeness=0.6)} allowed are {', '.join(names)}".strip()
            section.refuse_key("robot.unknown-key", key, f"no such key here; {hint}")


def read_text(section: Section, key: str) -> str | None:
    """Return the text at `key`."""
    value = section.values.get(key)
    if value is not None and not isinstance(value, str):
        section.refuse("robot.wrong-type", key, f'expected a text in "quotes", got {section.show(key)}')
        return None
    return value


def read_choice(section: Section, key: str, allowed: Iterable[str]) -> str | None:
    """Return the text at `key`, one of `allowed`."""
    names = tuple(allowed)
    value = section.values.get(key)
    if value is None or value in names:
        return value
    choices = ", ".join(f'"{name}"' for name in names)
    hint = suggest_names(value, names) if isinstance(value, str) else ""
    found = f"expected one of {choices}, got {section.show(key)}"
    section.refuse("robot.bad-choice", key, f"{found}; {hint}" if hint else found)
    return None


def read_flag(section: Section, key: str) -> bool | None:
    """Return the truth value at `key`."""
    value = section.values.get(key)
    if value is not None and not isinstance(value, bool):
        section.refuse("robot.wrong-type", key, f"expected true or false, got {section.show(key)}")
        return None
    return value


def read_integer(section: Section, key: str, allowed: Range) -> int | None:
    """Return the integer at `key`."""
    value = section.values.get(key)
    if value is None:
        return None
    if not isinstance(value, int) or isinstance(value, bool):
        section.refuse("robot.wrong-type", key, f"expected a whole number, got {section.show(key)}")
        return None
    if value not in allowed:
        section.refuse("robot.out-of-range", key, f"must be {allowed}, got {value}")
        return None
    return value


def to_decimal(value: object) -> Decimal | None:
    """Return `value` as a decimal, or None if it is no finite number of a sensible size."""
    if isinstance(value, bool) or not isinstance(value, int | Decimal):
        return None
    number = Decimal(value)
    if not number.is_finite() or (number and abs(number.adjusted()) > _LARGEST_EXPONENT):
        return None
    return number


def explain_number(value: object, unit: str) -> str:
    """Return in words what keeps `value` from being a number in `unit`, or nothing."""
    match = _NUMBER_WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    if not match:
        return " (not a finite number of a sensible size)" if isinstance(value, int | Decimal) else ""
    try:
        dimension = get_unit_factor(unit)[0]
        found = get_unit_factor(match[1])[0]
    except KeyError:
        return " (write the number alone)"
    if found != dimension:
        return f" ({match[1]} is not a unit of {dimension})"
    return f" (write the number alone, in {unit})"


def explain_wide_limits(low: float, high: float) -> str:
    """Return in words what is odd about the limits (rad) of a joint that turns, or nothing."""
    widest = max(abs(low), abs(high))
    if not _WIDE < widest < _WIDEST:
        return ""
    return f"{widest:g} rad are {widest / math.tau:.1f} turns; are these degrees? limits are in rad"


def read_number(section: Section, key: str, unit: str, allowed: Range = ANY) -> Decimal | None:
    """Return the number at `key`, exactly as it is written."""
    value = section.values.get(key)
    if value is None:
        return None
    number = to_decimal(value)
    if number is None:
        expected = f"expected a number in {unit}" if unit else "expected a number"
        got = f"got {section.show(key)}{explain_number(value, unit)}"
        section.refuse("robot.wrong-type", key, f"{expected}, {got}")
    elif number not in allowed:
        section.refuse(
            "robot.out-of-range", key, f"must be {allowed} {unit}".rstrip() + f", got {section.show(key)}"
        )
        return None
    return number


def has_list(section: Section, key: str, count: int, what: str) -> bool:
    """Return whether there is a list of `count` entries at `key`; another value is reported."""
    value = section.values.get(key)
    if value is None or (isinstance(value, list) and len(value) == count):
        return value is not None
    got = f"a list of {len(value)}" if isinstance(value, list) else section.show(key)
    section.refuse("robot.wrong-type", key, f"expected a list of {count} {what}, got {got}")
    return False


def read_numbers(section: Section, key: str, unit: str, count: int) -> tuple[Decimal, ...] | None:
    """Return the list of `count` numbers at `key`."""
    if not has_list(section, key, count, f"numbers in {unit}"):
        return None
    numbers = []
    for index, element in enumerate(section.values[key]):
        number = to_decimal(element)
        if number is None:
            got = f"got {section.show(key, index)}{explain_number(element, unit)}"
            section.refuse("robot.wrong-type", key, f"expected a number in {unit}, {got}", index)
        else:
            numbers.append(number)
    return tuple(numbers) if len(numbers) == count else None


def read_table(section: Section, key: str, allowed: Iterable[str] = ()) -> Section | None:
    """Return the table at `key`, its keys checked against `allowed` where any are given."""
    value = section.values.get(key)
    if value is None:
        return None
    if not isinstance(value, Mapping):
        section.refuse("robot.wrong-type", key, f"expected a table, got {section.show(key)}")
        return None
    label = f"{section.label}: {key}" if section.label else key
    inner = section.inside(value, label, key)
    names = tuple(allowed)
    if names:
        refuse_unknown_keys(inner, names)
    return inner
