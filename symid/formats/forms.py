"""Exact numbers and symbols as a robot file writes them.

Input: a value of a robot file: a decimal, or a text such as "-L1", "1/3", "1/2*sqrt(3)*L1 + 0.1".
Output: `Exact`, a linear form over the file's symbols; what is wrong goes to the section's report.

Supported: sums of products of decimals, fractions, sqrt(2), sqrt(3), sqrt(6) and at most one symbol each.
A symbol is a length, a mass, an inertia or an acceleration, whichever it is used as first.
Not supported: products of symbols, brackets.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from symid.formats.section import ANY, Range, Section, explain_number, find_element, find_nearest, to_decimal
from symid.robot.geometry import ZERO, Exact

__all__ = ["Symbols", "parse_form", "read_form", "read_fraction"]

_FACTOR = r"(?:\d+(?:\.\d+)?(?:[eE][-+]?\d{1,2})?|sqrt\(\s*[236]\s*\)|[A-Za-z][A-Za-z0-9_]*)"
_TERM = re.compile(rf"\s*(?P<sign>[-+]?)\s*(?P<first>{_FACTOR})(?P<others>(?:\s*[*/]\s*{_FACTOR})*)\s*")
_NEXT = re.compile(rf"\s*(?P<operator>[*/])\s*(?P<factor>{_FACTOR})")
_FRACTION = re.compile(r"\s*[-+]?\d{1,18}(?:\.\d{1,18})?(?:\s*/\s*\d{1,18})?\s*")
_LONGEST = 2000
_ROOTS = {
    2: Exact.surd(Fraction(0), 1),
    3: Exact.surd(Fraction(0), 0, 1),
    6: Exact.surd(Fraction(0), 0, 0, 1),
}
_EXAMPLES = {"m": "L1", "kg": "m1", "kg*m^2": "I1", "m/s^2": "-g"}
_NOUNS = {"m": "a length", "kg": "a mass", "kg*m^2": "an inertia", "m/s^2": "an acceleration"}
_TYPICAL = {"m": "0.5", "kg": "2.5", "kg*m^2": "0.01", "m/s^2": "9.81"}


@dataclass(frozen=True, slots=True)
class Symbols:
    """The symbols of a file, and what each turned out to be while the file is read."""

    values: Mapping[str, float]
    units: dict[str, str] = field(default_factory=dict)


def parse_form(text: str) -> Exact | None:
    """Return the linear form that `text` writes, or None if it writes none."""
    if len(text) > _LONGEST or not text.strip():
        return None
    total, position = ZERO, 0
    while position < len(text):
        match = _TERM.match(text, position)
        if not match or (position and not match["sign"]):
            return None
        term = _multiply(match["first"], match["others"])
        if term is None:
            return None
        total += -term if match["sign"] == "-" else term
        position = match.end()
    return total


def _multiply(first: str, others: str) -> Exact | None:
    product = _find_factor(first)
    for operator, factor in _NEXT.findall(others):
        other = _find_factor(factor)
        if operator == "/":
            if not other or not other.is_number:
                return None
            # A factor is a rational number or a root; 1 / sqrt(n) is sqrt(n) / n.
            square = (other * other).coefficient("")[0]
            other = other * Exact.surd(1 / square)
        if not (product.is_number or other.is_number):
            return None
        product = product * other
    return product


def _find_factor(text: str) -> Exact:
    if text.startswith("sqrt("):
        return _ROOTS[int(text[5:-1])]
    return Exact.of(text) if text[0].isdigit() else Exact.symbol(text)


def read_form(
    section: Section,
    key: str,
    symbols: Symbols,
    unit: str,
    *inner: int,
    allowed: Range = ANY,
    code: str = "robot.wrong-type",
) -> Exact | None:
    """Return the number or form at `key`, or at its element `inner`; None where it is absent or wrong.

    Args:
        section: the table.
        key: the name of the value.
        symbols: those of the file; the first use of a symbol says what it is.
        unit: "m", "kg", "kg*m^2" or "m/s^2".
        inner: the index of an element, where the value is a list.
        allowed: what the number may be, with the symbols' values put in.
        code: of the notice that tells a value which is neither number nor form.
    """
    value = find_element(section, key, *inner)
    if value is None:
        return None
    number = to_decimal(value)
    form = Exact.of(str(number)) if number is not None else None
    if form is None and isinstance(value, str):
        form = parse_form(value)
    if form is None:
        got = f"{section.show(key, *inner)}{explain_number(value, unit)}"
        expected = f'expected a number in {unit} or a symbol such as "{_EXAMPLES[unit]}"'
        section.refuse(code, key, f"{expected}, got {got}", *inner)
        return None
    if not _check_symbols(section, key, form, symbols, unit, *inner):
        return None
    if (size := form.to_float(symbols.values)) not in allowed:
        shown = section.show(key, *inner) + ("" if form.is_number else f", which is {size:g}")
        section.refuse("robot.out-of-range", key, f"must be {allowed} {unit}, got {shown}", *inner)
        return None
    return form


def _check_symbols(section: Section, key: str, form: Exact, symbols: Symbols, unit: str, *inner: int) -> bool:
    good = True
    for name in form.symbols:
        if name not in symbols.values:
            hint = find_nearest(name, symbols.values)
            hint = hint or f"write {name} = {_TYPICAL[unit]} (its value in {unit}) there"
            text = f"the symbol {name} has no value in [symbols]; {hint}"
            section.refuse("robot.unknown-symbol", key, text, *inner)
            good = False
        elif symbols.units.setdefault(name, unit) != unit:
            before = symbols.units[name]
            text = f"{name} was {_NOUNS[before]} ({before}) before, and is {_NOUNS[unit]} ({unit}) here"
            section.refuse("robot.symbol-unit", key, f"{text}; give each quantity its own symbol", *inner)
            good = False
    return good


def read_fraction(section: Section, key: str, instead_of_zero: str) -> Fraction | None:
    """Return the number at `key` exactly, a decimal or a text such as "1/3".

    Args:
        section: the table.
        key: the name of the value.
        instead_of_zero: what to do where it is 0, which it must not be.
    """
    value = section.values.get(key)
    if value is None:
        return None
    number = to_decimal(value)
    found = None if number is None else Fraction(number)
    if isinstance(value, str) and _FRACTION.fullmatch(value):
        above, _, below = value.partition("/")
        divisor = Fraction(below.strip() or 1)
        found = Fraction(above.strip()) / divisor if divisor else None
    if found is None:
        section.refuse(
            "robot.wrong-type", key, f'expected a number or a fraction "1/3", got {section.show(key)}'
        )
    elif not found:
        section.refuse("robot.out-of-range", key, f"must not be 0; {instead_of_zero}")
        return None
    return found
