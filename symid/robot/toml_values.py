"""Typed values out of a TOML text, each with its place, and a notice for each mistake.

A path -> the text of a file (UTF-8). A text -> `Section`, a table whose methods return values of a type,
decimals exactly, None where a value is absent or wrong, and collect what is wrong. `Places` has the line and
column (from one) and the raw text of every key path: names and, within arrays, indices, ("joint", 0, "a").

Supported: all of TOML 1.0; texts, choices, flags, integers, decimals, lists of decimals, tables.
Not supported: places in texts that are not TOML; the scanner validates nothing.
"""

import difflib
import io
import math
import re
import tomllib
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal, DecimalException
from pathlib import Path
from typing import Any, TypeVar

from symid.environment import read_file
from symid.errors import Notice, RobotError
from symid.notation import adapt_unit, get_unit_factor

LARGEST_FILE = 64 * 10**6
"""Bytes of a text that describes a robot; the largest URDFs with their meshes inside have a tenth."""
_DEEP = re.compile(r"(?:\[[^\]\n]{0,9}){40}|(?:\{[^}\n]{0,9}){40}|(?:\w\s*\.\s*){40}")
_ENDLESS = re.compile(r"[\d_]{1000,}|[eE][-+]?\d{10,}")
KeyPath = tuple[str | int, ...]
T = TypeVar("T")

_BLANK = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r'[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|\'[^\']*\'')
# A string of several lines may end in up to two quotes of its own.
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"""(?:"{0,2})|\'\'\'.*?\'\'\'(?:\'{0,2})|"(?:[^"\\]|\\.)*"|\'[^\']*\'', re.DOTALL
)
_BARE_VALUE = re.compile(r"[^,\]}#\n]+")
_SYNTAX_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
BASE = "base"
"""What the first joint of a robot file is fixed to; no joint has this name."""

_LONGEST_SHOWN = 40
# Beyond this many decimal places a number is a slip, and exact arithmetic with it would not end.
_LARGEST_EXPONENT = 30
_MOST_DIGITS = 1000
_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(\S.*?)\s*")


def read_text_file(path: Path, noun: str = "file", *, keep_ends: bool = False) -> str:
    """Return the text of the file at `path`, which messages call `noun`; a RobotError if it has none.

    `keep_ends`: ends of lines, and a byte order mark, stay as they are.
    """
    try:
        content = read_file(path, LARGEST_FILE)
        if keep_ends:
            return content.decode()
        return io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig").read()
    except (OSError, UnicodeDecodeError) as error:
        text = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        if isinstance(error, UnicodeDecodeError):
            text = f"not UTF-8 text (byte {error.start}); save the {noun} as UTF-8"
        raise RobotError(Notice(code="robot.unreadable", text=text, file=str(path))) from error


def sort_notices(notices: Iterable[Notice]) -> tuple[Notice, ...]:
    """Return notices in the order of their places."""
    return tuple(sorted(notices, key=lambda notice: (notice.line, notice.column)))


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file, and the text at it."""

    file: str
    line: int
    column: int
    text: str = ""

    def notice(self, code: str, text: str) -> Notice:
        """Return a notice on what is here."""
        return Notice(code=code, text=text, file=self.file, line=self.line, column=self.column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """The places of keys and values by key path; `whole` is the place of the text itself."""

    keys: Mapping[KeyPath, Place] = field(default_factory=dict)
    values: Mapping[KeyPath, Place] = field(default_factory=dict)
    whole: Place = Place("", 0, 0)

    def locate_value(self, path: KeyPath) -> Place:
        """Return the place of the value at `path`, or else of the nearest table around it."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path, self.whole)


class Scanner:
    """A cursor in valid TOML whose lines end in a line feed alone, and the places found so far."""

    def __init__(self, text: str, file: str = "") -> None:
        self.text = text
        self.file = file
        self.position = 0
        self.keys: dict[KeyPath, Place] = {}
        self.values: dict[KeyPath, Place] = {}
        self._line_ends = [match.start() for match in re.finditer(r"\n", text)]
        self._tables: dict[KeyPath, int] = {}

    def scan_document(self) -> Places:
        """Return the places of all keys and values."""
        path: KeyPath = ()
        self._skip(_BLANK)
        while self.position < len(self.text):
            start = self.position
            brackets = 2 if self.text.startswith("[[", start) else 1
            if self.text[start] != "[":
                self._scan_pair(path)
            else:
                # The keys below `[a.b]` or `[[a.b]]` belong to its path.
                self.position += brackets
                names = self._scan_key()
                self.position += brackets
                path = ()
                for number, (name, place) in enumerate(names, start=1):
                    path = self._enter(path, name, place)
                    if number == len(names) and brackets == 2:
                        self._tables[path] = self._tables.get(path, 0) + 1
                    if path in self._tables:
                        path = (*path, self._tables[path] - 1)
                self.keys[path] = names[-1][1]
                # A header says more on a table than a sub-table's header before it.
                self.values[path] = self._place(start)
            self._skip(_BLANK)
        return Places(keys=self.keys, values=self.values, whole=Place(self.file, 1, 1))

    def _enter(self, path: KeyPath, name: str, place: Place) -> KeyPath:
        path = (*path, name)
        self.keys.setdefault(path, place)
        self.values.setdefault(path, place)
        return path

    def _scan_pair(self, path: KeyPath) -> None:
        names = self._scan_key()
        self.position += 1
        for name, place in names:
            path = self._enter(path, name, place)
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
            names.append((name, self._place(start)))
            self._skip(_SPACE)
            if self.text[self.position] != ".":
                return names
            self.position += 1

    def _scan_value(self, path: KeyPath) -> None:
        start = self.position
        match self.text[start]:
            case "[" | "{":
                self._scan_entries(path, self.text[start])
            case '"' | "'":
                self._skip(_STRING)
            case _:
                self._skip(_BARE_VALUE)
                self.position = start + len(self.text[start : self.position].rstrip())
        self.values[path] = self._place(start)

    def _scan_entries(self, path: KeyPath, bracket: str) -> None:
        """Pass an array, or an inline table."""
        index = 0
        self.position += 1
        self._skip(_BLANK)
        while self.text[self.position] not in "]}":
            if bracket == "[":
                self._scan_value((*path, index))
            else:
                self._scan_pair(path)
            index += 1
            self._skip(_BLANK)
            if self.text[self.position] == ",":
                self.position += 1
                self._skip(_BLANK)
        self.position += 1

    def _skip(self, pattern: re.Pattern[str]) -> None:
        if match := pattern.match(self.text, self.position):
            self.position = match.end()

    def _place(self, start: int) -> Place:
        """Return the place from `start` to the cursor."""
        line = bisect_left(self._line_ends, start)
        before = self._line_ends[line - 1] if line else -1
        return Place(self.file, line + 1, start - before, self.text[start : self.position])


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A table that is being read: its place in the file, and its name in messages.

    `prismatic`: it belongs to a joint that slides; `symbols` are the file's, `used` the unit of each that was
    used. `used`, `errors` and `warnings` are shared by all tables of a file.
    """

    values: Mapping[str, Any]
    places: Places
    path: KeyPath = ()
    label: str = ""
    prismatic: bool = False
    symbols: Mapping[str, float] = field(default_factory=dict)
    used: dict[str, str] = field(default_factory=dict)
    errors: list[Notice] = field(default_factory=list)
    warnings: list[Notice] = field(default_factory=list)

    def inside(self, values: Mapping[str, Any], label: str, *path: str | int) -> "Section":
        """Return a table that stands at `path` of this one."""
        return replace(self, values=values, path=(*self.path, *path), label=label)

    def refuse(self, code: str, key: str, text: str, *inner: int) -> None:
        """Add an error at the value of `key`, or at its element `inner`."""
        self.errors.append(self._notice(code, key, text, *inner))

    def warn(self, code: str, key: str, text: str, *inner: int) -> None:
        """Add a warning at the value of `key`, or at its element `inner`."""
        self.warnings.append(self._notice(code, key, text, *inner))

    def refuse_key(self, code: str, key: str, text: str) -> None:
        """Add an error at the name of `key`; at the nearest table around it, if the key is missing."""
        place = self.places.keys.get((*self.path, key)) or self.places.locate_value(self.path)
        self.errors.append(self._notice(code, key, text, place=place))

    def _notice(self, code: str, key: str, text: str, *inner: int, place: Place | None = None) -> Notice:
        place = place or self.places.locate_value((*self.path, key, *inner))
        return place.notice(code, f"{self.label}: {key}: {text}" if self.label else f"{key}: {text}")

    def refuse_joint(self, code: str, key: str, known: Iterable[str]) -> None:
        """Add an error at `key`, whose text is the name of none of the `known` joints."""
        hint = suggest_names(self.values[key], known, otherwise="allowed are")
        self.refuse(code, key, f'there is no joint "{self.values[key]}"; {hint}')

    def finish(self) -> tuple[Notice, ...]:
        """Return all warnings in the order of their places, or raise a RobotError with all mistakes."""
        if self.errors:
            raise RobotError(*sort_notices(self.errors))
        return sort_notices(self.warnings)

    def require(self, key: str, remedy: str) -> bool:
        """Return whether there is something at `key`; add an error where there is nothing."""
        if key not in self.values:
            self.refuse_key("robot.missing-key", key, f"missing; {remedy}")
        return key in self.values

    def refuse_unknown_keys(self, allowed: Iterable[str]) -> None:
        """Add an error for each key that is not allowed in this table."""
        names = tuple(allowed)
        for key in self.values:
            if key not in names:
                hint = f"{suggest_names(key, names, likeness=0.6)} allowed are {', '.join(names)}".strip()
                self.refuse_key("robot.unknown-key", key, f"no such key here; {hint}")

    def show(self, key: str, *inner: int) -> str:
        """Return the value as the file writes it, shortened."""
        place = self.places.values.get((*self.path, key, *inner))
        return show(place.text if place else str(self.values.get(key)))

    def get(self, key: str, *inner: int) -> Any:  # noqa: ANN401  (whatever TOML has)
        """Return the value at `key`, or its element `inner`, as it was read; None where there is none."""
        value = self.values.get(key)
        for index in inner:
            value = value[index] if isinstance(value, list) and index < len(value) else None
        return value

    def _refuse_type(self, key: str, expected: str, *inner: int, hint: str = "") -> None:
        text = f"expected {expected}, got {self.show(key, *inner)}{hint}"
        self.refuse("robot.wrong-type", key, text, *inner)

    def _read(self, key: str, kind: type[T], expected: str) -> T | None:
        value = self.get(key)
        if value is None or (isinstance(value, kind) and (kind is bool or not isinstance(value, bool))):
            return value
        self._refuse_type(key, expected)
        return None

    def read_text(self, key: str) -> str | None:
        """Return the text at `key`."""
        return self._read(key, str, 'a text in "quotes"')

    def read_flag(self, key: str) -> bool | None:
        """Return the truth value at `key`."""
        return self._read(key, bool, "true or false")

    def read_choice(self, key: str, allowed: Iterable[str]) -> str | None:
        """Return the text at `key`, one of `allowed`."""
        names, value = tuple(allowed), self.get(key)
        if value is None or (isinstance(value, str) and value in names):
            return value
        choices = ", ".join(f'"{name}"' for name in names)
        hint = suggest_names(value, names, before="; ") if isinstance(value, str) else ""
        self.refuse("robot.bad-choice", key, f"expected one of {choices}, got {self.show(key)}{hint}")
        return None

    def read_integer(self, key: str, allowed: Range) -> int | None:
        """Return the integer at `key`."""
        value = self._read(key, int, "a whole number")
        if value is None or value in allowed:
            return value
        self.refuse("robot.out-of-range", key, f"must be {allowed}, got {value}")
        return None

    def read_number(
        self, key: str, unit: str, allowed: Range = ANY, *inner: int, word: str = ""
    ) -> Decimal | None:
        """Return the number at `key`, or its element `inner`, exactly as it is written.

        `unit` is that of a joint that turns. `word` may stand in the number's place, and counts as absent.
        """
        value, unit = self.get(key, *inner), adapt_unit(unit, prismatic=self.prismatic)
        if value is None or (word and value == word):
            return None
        number = to_decimal(value)
        if number is None:
            expected = f"a number in {unit}" if unit else "a number"
            expected += f' or "{word}"' if word else ""
            self._refuse_type(key, expected, *inner, hint=explain_number(value, unit))
        elif number not in allowed:
            text = f"must be {allowed} {unit}".rstrip() + f", got {self.show(key, *inner)}"
            self.refuse("robot.out-of-range", key, text, *inner)
            return None
        return number

    def read_float(
        self, key: str, unit: str, allowed: Range = ANY, *inner: int, word: str = ""
    ) -> float | None:
        """Return the same as `read_number` in floating point."""
        number = self.read_number(key, unit, allowed, *inner, word=word)
        return None if number is None else float(number)

    def has_list(self, key: str, count: int, what: str) -> bool:
        """Return whether there is a list of `count` entries at `key`; another value is reported."""
        value = self.get(key)
        if value is None or (isinstance(value, list) and len(value) == count):
            return value is not None
        got = f"a list of {len(value)}" if isinstance(value, list) else self.show(key)
        self.refuse("robot.wrong-type", key, f"expected a list of {count} {what}, got {got}")
        return False

    def read_numbers(self, key: str, unit: str, count: int) -> tuple[Decimal, ...] | None:
        """Return the list of `count` numbers at `key`."""
        if not self.has_list(key, count, f"numbers in {adapt_unit(unit, prismatic=self.prismatic)}"):
            return None
        found = [self.read_number(key, unit, ANY, index) for index in range(count)]
        numbers = tuple(number for number in found if number is not None)
        return numbers if len(numbers) == count else None

    def read_floats(
        self, key: str, unit: str, allowed: Range = ANY, *, each: str = ""
    ) -> tuple[float, ...] | None:
        """Return the list of numbers at `key`; it must not be empty where `each` says what a number is of."""
        given = self.get(key)
        if isinstance(given, list) and (given or not each):
            found = (self.read_float(key, unit, allowed, index) for index in range(len(given)))
            numbers = tuple(number for number in found if number is not None)
            return numbers if len(numbers) == len(given) else None
        if given is not None:
            shown = adapt_unit(unit, prismatic=self.prismatic)
            what = f"a list of numbers{f' in {shown}' if unit else ''}{each}"
            self.refuse("robot.wrong-type", key, f"expected {what}, got {self.show(key)}")
        return None

    def read_table_array(self, key: str) -> "list[Section]":
        """Return the tables of `[[key]]`, each with a label for messages; what is none is reported."""
        tables = self.get(key)
        expected = f"expected [[{key}]] in two brackets, got"
        if tables is not None and not isinstance(tables, list):
            self.refuse("robot.wrong-type", key, f"{expected} {self.show(key)}")
            return []
        sections = []
        for index, table in enumerate(tables or ()):
            if not isinstance(table, Mapping):
                # The other tables are read all the same, so that their mistakes are reported too.
                text = f"{expected} {self.show(key, index)} as {key} {index + 1}"
                self.refuse("robot.wrong-type", key, text, index)
                continue
            name = table.get("name")
            label = f"{key} '{name}'" if isinstance(name, str) else f"{key} {index + 1}"
            sections.append(self.inside(table, label, key, index))
        return sections

    def read_table(self, key: str, allowed: Iterable[str] = ()) -> "Section | None":
        """Return the table at `key`, its keys checked against `allowed` where any are given."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, Mapping):
            self._refuse_type(key, "a table")
            return None
        inner = self.inside(value, f"{self.label}: {key}" if self.label else key, key)
        if names := tuple(allowed):
            inner.refuse_unknown_keys(names)
        return inner


def parse_toml(text: str, file: str, code: str = "robot.syntax") -> Section:
    """Return the whole table that `text`, called `file`, writes; a RobotError of this code if none."""
    text = text.replace("\r\n", "\n")
    try:
        values = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        match = _SYNTAX_PLACE.search(str(error))
        line, column = text.count("\n") + 1, len(text) - text.rfind("\n")
        if match and match[1]:
            line, column = int(match[1]), int(match[2])
        reason = _SYNTAX_PLACE.sub("", str(error))
        words = f"not valid TOML: {reason[:1].lower()}{reason[1:]}"
        bare = re.match(r"[A-Za-z]\w*", text.split("\n")[line - 1][column - 1 :])
        if bare and "Invalid value" in reason:
            words += f'; write a text or the name of a length in quotes: "{bare[0]}"'
        notice = Notice(code=code, text=words, file=file, line=line, column=column)
        raise RobotError(notice) from error
    except (ValueError, RecursionError, DecimalException) as error:
        raise _explain_excess(text, file, code, deep=isinstance(error, RecursionError)) from error
    try:
        return Section(values=values, places=Scanner(text, file).scan_document())
    except RecursionError as error:
        raise _explain_excess(text, file, code, deep=True) from error


def _explain_excess(text: str, file: str, code: str, *, deep: bool) -> RobotError:
    """Return the error of a text that Python cannot hold: nested too deeply, or with an endless number."""
    pattern, words = (_DEEP, "nested too deeply") if deep else (_ENDLESS, "a number has too many digits")
    match = pattern.search(text)
    start = match.start() if match else 0
    line, column = text.count("\n", 0, start) + 1, start - text.rfind("\n", 0, start)
    return RobotError(Notice(code=code, text=f"{words} to be read", file=file, line=line, column=column))


def show(text: str) -> str:
    """Return `text` on one line, shortened in the middle of a message."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_SHOWN else line[: _LONGEST_SHOWN - 3] + "..."


def suggest_names(
    name: str, allowed: Iterable[str], *, likeness: float = 0.5, before: str = "", otherwise: str = ""
) -> str:
    """Return a question with the names most like `name`; blanks around a name are pointed out.

    `likeness` is the least, from 0 to 1; `before` goes before the question. Where no name is like it, all
    known names follow `otherwise`; the answer is empty without that.
    """
    names = list(allowed)
    twin = next((other for other in names if other.strip() == name.strip()), None)
    if twin is not None and twin != name:
        longer, where = (name, "here") if name != name.strip() else (twin, "there")
        side = "at the end" if longer != longer.rstrip() else "at the start"
        return f'{before}did you mean "{twin}"? there is a blank {side} of the name {where}'
    near = difflib.get_close_matches(name.lower(), [known.lower() for known in names], n=2, cutoff=likeness)
    if found := [known for known in names if known.lower() in near]:
        return f"{before}did you mean {' or '.join(found)}?"
    return f"{otherwise} {', '.join(names)}" if otherwise else ""


def to_decimal(value: object) -> Decimal | None:
    """Return `value` as a decimal, or None if it is no finite number of a sensible size."""
    if isinstance(value, bool) or not isinstance(value, int | float | Decimal):
        return None
    number = Decimal(repr(value)) if isinstance(value, float) else Decimal(value)
    if not number.is_finite() or (number and abs(number.adjusted()) > _LARGEST_EXPONENT):
        return None
    if len(number.as_tuple().digits) > _MOST_DIGITS:
        return None
    return number


def explain_number(value: object, unit: str) -> str:
    """Return in words what keeps `value` from being a number in `unit`, or nothing."""
    match = _NUMBER_WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    if not match:
        is_number = isinstance(value, int | float | Decimal)
        return " (not a finite number of a sensible size and length)" if is_number else ""
    try:
        dimension = get_unit_factor(unit)[0]
        found = get_unit_factor(match[1])[0]
    except KeyError:
        return " (write the number alone)"
    if found != dimension:
        return f" ({match[1]} is not a unit of {dimension})"
    return f" (write the number alone, in {unit})"


def explain_wide_limits(low: float, high: float) -> str:
    """Return in words what is odd about the limits (rad) of a joint that turns, or nothing.

    Limits in degrees lie between 40 and 1000; beyond, a number stands for no limit.
    """
    widest = max(abs(low), abs(high))
    if not 40 < widest < 1000:
        return ""
    return f"{widest:g} rad are {widest / math.tau:.1f} turns; write limits in rad, not in degrees"
