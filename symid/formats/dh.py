"""Denavit-Hartenberg rows and the exact placements they stand for.

Input: rows (alpha, a, d, theta) as a robot file writes them. Output: the joint's frame, whose z axis is the
joint's axis, seen from the link before it at q = 0; and the frame that the convention gives to the link.

Supported: modified rows, Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d), with alpha and a of the
link before; standard rows, Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha), converted without rounding.
Not supported: the extra parameters of Khalil and Kleinfinger for trees whose branches need them.
"""

import math
import re
from dataclasses import dataclass

from symid.formats.forms import Symbols, parse_form, read_form
from symid.formats.section import Section, find_element, to_decimal
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
from symid.robot.rotations import find_tangent_angle

__all__ = ["NO_TURN", "ROW_KEYS", "Row", "find_row_frames", "read_angle", "read_length", "read_row"]

_FRACTION_OF_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<times>\d+(?:\.\d+)?)\s*\*?\s*)?pi\s*(?:/\s*(?P<by>\d+(?:\.\d+)?))?"
)
_DEGREES = re.compile(r"(?P<degrees>[-+]?\d+(?:\.\d+)?)\s*deg")
_TANGENT = re.compile(r"2\s*\*?\s*atan\((?P<tangent>.+)\)")
NO_TURN = find_angle(0.0)
ROW_KEYS = ("alpha", "a", "d", "theta")
_LARGEST_ANGLE = 12.0
_LARGEST_LENGTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A row of a Denavit-Hartenberg table; the joint's coordinate is added to `theta` or `d`."""

    alpha: Angle = NO_TURN
    a: Exact = ZERO
    d: Exact = ZERO
    theta: Angle = NO_TURN


def find_row_frames(row: Row, convention: str) -> tuple[Placement, Placement]:
    """Return the joint's frame at q = 0 seen from the link before it, and the link's seen from the joint's.

    Args:
        row: the joint's row.
        convention: "modified" or "standard". A modified row ends in the joint's frame, which is the
            link's; a standard row goes on to the far end of the link, Trans(x, a) Rot(x, alpha).
    """
    if convention == "modified":
        return place_modified_dh(row.alpha, row.a, row.d, row.theta), IDENTITY
    near = place_modified_dh(NO_TURN, ZERO, row.d, row.theta)
    return near, compose_placements(translate(row.a, ZERO, ZERO), rotate_x(row.alpha))


def read_row(section: Section, symbols: Symbols) -> Row:
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


def _find_exact_angle(value: object) -> Angle | None:
    """Return the angle of a text such as "2*atan(1/3)", whose cosine and sine are those of the text."""
    match = _TANGENT.fullmatch(value.strip()) if isinstance(value, str) else None
    tangent = parse_form(match["tangent"]) if match else None
    return find_tangent_angle(tangent) if tangent is not None and tangent.is_number else None


def read_angle(section: Section, key: str, *inner: int) -> Angle:
    """Return the angle at `key`, or at its element `inner`; zero where there is none.

    A number within 1e-5 rad of a multiple of pi/2 is taken as that multiple, and a warning says so.
    """
    value = find_element(section, key, *inner)
    if value is None:
        return NO_TURN
    if (exact := _find_exact_angle(value)) is not None:
        return exact
    radians = _find_radians(value)
    shown = section.show(key, *inner)
    if radians is None:
        allowed = 'a number in rad, "pi/2", "-3*pi/4" or "90 deg"'
        section.refuse("robot.bad-angle", key, f"expected an angle, {allowed}; got {shown}", *inner)
        return NO_TURN
    if abs(radians) > _LARGEST_ANGLE and not isinstance(value, str):
        text = f'{shown} rad is about {radians / math.tau:.1f} turns; degrees are written "90 deg"'
        section.warn("robot.large-angle", key, text, *inner)
    angle = find_angle(radians)
    if angle.snapped_by:
        quarters = round(angle.radians / (math.pi / 2))
        exact_text = {0: "0", 1: "pi/2", -1: "-pi/2", 2: "pi", -2: "-pi"}.get(quarters, f"{quarters}*pi/2")
        text = f'{shown} was moved by {angle.snapped_by:.2e} rad; write it as "{exact_text}"'
        section.warn("robot.angle-snapped", key, text, *inner)
    return angle


def read_length(section: Section, key: str, symbols: Symbols, *inner: int) -> Exact:
    """Return the length at `key` in m, or at its element `inner`: a number or a form; zero by default."""
    length = read_form(section, key, symbols, "m", *inner, code="robot.bad-length")
    if length is None:
        return ZERO
    number = to_decimal(find_element(section, key, *inner))
    if number is not None and abs(number) > _LARGEST_LENGTH:
        text = f"{section.show(key, *inner)} m is long; lengths are in m"
        section.warn("robot.long-length", key, text, *inner)
    return length
