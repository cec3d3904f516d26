"""Typed values out of a table of a robot file, with a notice for each mistake.

Input: a table as `tomllib` gives it, with decimals kept as decimals. Output: values of the type
asked for, or None where the value is absent or wrong; what is wrong goes to the `Report`.

Supported: texts, choices, flags, integers, decimals, lists of decimals, tables.
"""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from symid.errors import Notice
from symid.formats.positions import KeyPath, Place, Places
from symid.units import find_unit_factor

__all__ = [
    "ANY",
    "BASE",
    "NOT_NEGATIVE",
    "POSITIVE",
    "Range",
    "Report",
    "Section",
    "explain_number",
    "explain_wide_limits",
    "find_element",
    "find_nearest",
    "read_choice",
    "read_flag",
    "read_integer",
    "read_number",
    "read_numbers",
    "read_table",
    "read_text",
    "refuse_unknown_keys",
    "show",
    "to_decimal",
]

BASE = "base"
"""What the first joint of a robot file is fixed to; no joint has this name."""

_LONGEST_SHOWN = 40
# Beyond this many decimal places a number is a slip, and exact arithmetic with it would not end.
_LARGEST_EXPONENT = 30
# Limits in degrees lie between these; beyond, a number stands for no limit.
_WIDE, _WIDEST = 40, 1000
_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(\S.*?)\s*")


@dataclass(frozen=True, slots=True)
class Report:
    """What is wrong with a file, gathered while it is read, and what is only worth saying."""

    places: Places
    errors: list[Notice] = field(default_factory=list)
    warnings: list[Notice] = field(default_factory=list)

    def notices(self) -> tuple[Notice, ...]:
        """Return the errors in the order of their places."""
        return tuple(sorted(self.errors, key=_order))

    def remarks(self) -> tuple[Notice, ...]:
        """Return the warnings in the order of their places."""
        return tuple(sorted(self.warnings, key=_order))


def _order(notice: Notice) -> tuple[int, int]:
    return (notice.line, notice.column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A table that is being read: where it stands in the file, and how messages call it."""

    values: Mapping[str, Any]
    path: KeyPath
    report: Report
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

    def show(self, key: str, *inner: int) -> str:
        """Return the value as the file writes it, shortened."""
        place = self.report.places.values.get((*self.path, key, *inner))
        value: Any = self.values.get(key)
        return show(place.text if place else str(value))

    def _notice(self, code: str, place: Place, key: str, text: str) -> Notice:
        words = f"{self.label}: {key}: {text}" if self.label else f"{key}: {text}"
        return Notice(code=code, text=words, file=place.file, line=place.line, column=place.column)


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


def find_nearest(name: str, allowed: Iterable[str], *, likeness: float = 0.5) -> str:
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


def find_element(section: Section, key: str, *inner: int) -> object:
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
            hint = f"{find_nearest(key, names, likeness=0.6)} allowed are {', '.join(names)}".strip()
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
    hint = find_nearest(value, names) if isinstance(value, str) else ""
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
        dimension = find_unit_factor(unit)[0]
        found = find_unit_factor(match[1])[0]
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


def read_numbers(section: Section, key: str, unit: str, count: int) -> tuple[Decimal, ...] | None:
    """Return the list of `count` numbers at `key`."""
    value = section.values.get(key)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != count:
        found = f"a list of {len(value)}" if isinstance(value, list) else section.show(key)
        section.refuse("robot.wrong-type", key, f"expected a list of {count} numbers in {unit}, got {found}")
        return None
    numbers = []
    for index, element in enumerate(value):
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
    inner = Section(values=value, path=(*section.path, key), report=section.report, label=label)
    names = tuple(allowed)
    if names:
        refuse_unknown_keys(inner, names)
    return inner
