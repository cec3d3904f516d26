"""Constants that a robot file may write as an expression, read as floats.

Input: a value such as 0.5, "-pi/2", "1/3", "90 deg" or "32*sqrt(2)". Output: a float in SI units.

Supported: sums of products of decimals, fractions, roots of 2, 3 and 6, and pi; degrees.
Not supported: symbols: a constant of a log is a number.
"""

import math
import re

from symid.formats.forms import parse_form
from symid.formats.section import Section, find_element, to_decimal

__all__ = ["read_constant"]

_DEGREES = re.compile(r"\s*(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg\s*")


def read_constant(section: Section, key: str, expected: str, *inner: int) -> float | None:
    """Return the number at `key`, or at its element `inner`; None where it is absent or wrong.

    Args:
        section: the table.
        key: the name of the value.
        expected: in words what is wanted there, for the message.
        inner: indices of an element, where the value is a list.
    """
    value = find_element(section, key, *inner)
    if value is None:
        return None
    found = _find_number(value)
    if found is None:
        examples = 'such as 0.5, "-pi/2" or "90 deg"'
        text = f"expected {expected}, {examples}; got {section.show(key, *inner)}"
        section.refuse("robot.wrong-type", key, text, *inner)
    return found


def _find_number(value: object) -> float | None:
    number = to_decimal(value)
    if number is not None:
        return float(number)
    if not isinstance(value, str):
        return None
    if match := _DEGREES.fullmatch(value):
        return math.radians(float(match["degrees"]))
    form = parse_form(value)
    if form is None or any(name != "pi" for name in form.symbols):
        return None
    return form.to_float({"pi": math.pi})
