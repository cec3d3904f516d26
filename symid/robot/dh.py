"""Denavit-Hartenberg rows and the exact placements they stand for.

Input: rows (alpha, a, d, theta) as a robot file writes them. Output: frame j seen from its parent, at
q = 0, in the one convention used inside: the joint's axis is the z axis of its own link's frame.

Supported: modified rows, Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d), with alpha and a of the
link before; standard rows, Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha), converted without rounding.
Not supported: the extra parameters of Khalil and Kleinfinger for trees whose branches need them.
"""

import math
import re
from dataclasses import dataclass

from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Angle,
    Exact,
    Placement,
    compose_placements,
    find_angle,
    place_modified_dh,
    rotate_x,
    translate,
)
from symid.robot.section import Section, explain_number, find_nearest, to_decimal

__all__ = ["Row", "find_far_end", "place_row", "read_angle", "read_length", "read_row"]

_FRACTION_OF_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<times>\d+(?:\.\d+)?)\s*\*?\s*)?pi\s*(?:/\s*(?P<by>\d+(?:\.\d+)?))?"
)
_DEGREES = re.compile(r"(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg")
_LENGTH_SYMBOL = re.compile(r"(?P<sign>[-+]?)\s*(?P<name>[A-Za-z][A-Za-z0-9_]*)")
_NO_TURN = find_angle(0.0)
_LARGEST_ANGLE = 12.0
_LARGEST_LENGTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A row of a Denavit-Hartenberg table; the joint's coordinate is added to `theta` or `d`."""

    alpha: Angle = _NO_TURN
    a: Exact = ZERO
    d: Exact = ZERO
    theta: Angle = _NO_TURN


def find_far_end(row: Row, convention: str) -> Placement:
    """Return the frame that `row` ends in, seen from the joint's own frame.

    For standard rows Trans(x, a) Rot(x, alpha); modified rows end in the joint's frame.
    """
    if convention == "modified":
        return IDENTITY
    return compose_placements(translate(row.a, ZERO, ZERO), rotate_x(row.alpha))


def place_row(row: Row, before: Row | None, convention: str) -> Placement:
    """Return the joint's frame at q = 0 seen from the frame of the joint before it.

    Args:
        row: the joint's own row.
        before: the parent's row, None at the base.
        convention: "modified" or "standard". A standard row places its joint by alpha and a of
            the parent's row: what stands before a modified row's z axis stands behind a standard one.
    """
    if convention == "modified":
        return place_modified_dh(row.alpha, row.a, row.d, row.theta)
    outer = before or Row()
    return place_modified_dh(outer.alpha, outer.a, row.d, row.theta)


def read_row(section: Section, symbols: tuple[str, ...]) -> Row:
    """Return the row of a joint's table; what cannot be read is reported and taken as zero."""
    return Row(
        alpha=read_angle(section, "alpha"),
        a=read_length(section, "a", symbols),
        d=read_length(section, "d", symbols),
        theta=read_angle(section, "theta"),
    )


def _find_radians(value: object) -> float | None:
    """Return the angle in rad: a number, a fraction of pi such as "3*pi/4", or "90 deg"."""
    number = to_decimal(value)
    if number is not None:
        return float(number)
    if not isinstance(value, str):
        return None
    if match := _FRACTION_OF_PI.fullmatch(value.strip()):
        by = float(match["by"] or 1)
        size = float(match["times"] or 1) * math.pi / by if by else None
        return -size if size and match["sign"] == "-" else size
    if match := _DEGREES.fullmatch(value.strip()):
        return math.radians(float(match["degrees"]))
    return None


def read_angle(section: Section, key: str) -> Angle:
    """Return the angle at `key`, zero where there is none.

    A number within 1e-5 rad of a multiple of pi/2 is taken as that multiple, and a warning says so.
    """
    value = section.values.get(key)
    if value is None:
        return _NO_TURN
    radians = _find_radians(value)
    if radians is None:
        allowed = 'a number in rad, "pi/2", "-3*pi/4" or "90 deg"'
        section.refuse("robot.bad-angle", key, f"expected an angle, {allowed}; got {section.show(key)}")
        return _NO_TURN
    if abs(radians) > _LARGEST_ANGLE and not isinstance(value, str):
        text = (
            f'{section.show(key)} rad is about {radians / math.tau:.1f} turns; degrees are written "90 deg"'
        )
        section.warn("robot.large-angle", key, text)
    angle = find_angle(radians)
    if angle.snapped_by:
        quarters = round(angle.radians / (math.pi / 2))
        exact = {0: "0", 1: "pi/2", -1: "-pi/2", 2: "pi", -2: "-pi"}.get(quarters, f"{quarters}*pi/2")
        text = f'{section.show(key)} was moved by {angle.snapped_by:.2e} rad; write it as "{exact}"'
        section.warn("robot.angle-snapped", key, text)
    return angle


def read_length(section: Section, key: str, symbols: tuple[str, ...]) -> Exact:
    """Return the length at `key` in m, a decimal or one of `symbols` with a sign; zero by default."""
    value = section.values.get(key)
    if value is None:
        return ZERO
    number = to_decimal(value)
    if number is not None:
        if abs(number) > _LARGEST_LENGTH:
            section.warn("robot.long-length", key, f"{section.show(key)} m is long; lengths are in m")
        return Exact.of(str(number))
    match = _LENGTH_SYMBOL.fullmatch(value.strip()) if isinstance(value, str) else None
    if not match:
        found = f"got {section.show(key)}{explain_number(value, 'm')}"
        section.refuse("robot.bad-length", key, f'expected a number in m or a symbol such as "L1"; {found}')
        return ZERO
    if match["name"] not in symbols:
        hint = find_nearest(match["name"], symbols) or f"write {match['name']} = 0.5 (its value in m) there"
        text = f"the symbol {match['name']} has no value in [symbols]; {hint}"
        section.refuse("robot.unknown-symbol", key, text)
        return ZERO
    length = Exact.symbol(match["name"])
    return -length if match["sign"] == "-" else length
