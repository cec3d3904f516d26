"""Arguments of the API that must be of a range or one of a list, checked before anything is done.

Input: their names and values. Output: nothing, or an error that says what was allowed.
"""

import math
from collections.abc import Sequence

from symid.codegen.options import BACKENDS
from symid.elastic.options import METHODS
from symid.errors import Notice, UsageError

__all__ = ["BACKENDS", "METHODS", "check_choice", "check_count", "check_positive"]


def check_count(name: str, value: int | None, least: int = 0) -> None:
    """Refuse what is no whole number of at least `least`; None, which stands for the default, passes.

    Raises:
        UsageError: it is none.
    """
    if value is None:
        return
    whole = not isinstance(value, bool) and hasattr(value, "__index__")
    if not whole or value < least:
        text = f"{name}={value!r}: expected a whole number of {least} or more"
        raise UsageError(Notice(code="usage.range", text=text))


def check_positive(name: str, value: float | None, *, zero: bool = False) -> None:
    """Refuse what is no positive finite number, or, if `zero`, not zero either; None passes.

    Raises:
        UsageError: it is none.
    """
    if value is None:
        return
    number = hasattr(value, "__float__") and not isinstance(value, bool)
    if not number or not (value >= 0.0 if zero else value > 0.0) or not math.isfinite(value):
        text = f"{name}={value!r}: expected a finite number {'of 0 or more' if zero else 'above 0'}"
        raise UsageError(Notice(code="usage.range", text=text))


def check_choice(name: str, value: str, allowed: Sequence[str]) -> None:
    """Refuse what is not one of `allowed`.

    Raises:
        UsageError: it is none.
    """
    if value not in allowed:
        text = f"{name}={value!r}: expected one of {', '.join(map(repr, allowed))}"
        raise UsageError(Notice(code="usage.range", text=text))
