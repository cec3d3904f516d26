"""Numbers, angles and frames as a robot file writes them, so that they are read back exactly.

Input: exact numbers, angles, placements; plain values. Output: texts of TOML values.

Supported: everything that the readers of lengths, angles and frames accept. A frame is a row where it is one,
else an origin with roll, pitch and yaw, else an origin with a quaternion.
"""

import json
import math
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction

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
    rotate_z,
    translate,
)
from symid.robot.rotations import find_half_tangent, find_quaternion, find_rpy

__all__ = [
    "add_comment",
    "write_angle",
    "write_exact",
    "write_fraction",
    "write_key",
    "write_known",
    "write_modified_row",
    "write_number",
    "write_origin",
    "write_standard_row",
    "write_value",
]

_TWELFTHS = tuple((k, find_angle(k * math.pi / 12)) for k in range(-11, 13))
_MOST_PLACES = 40
_COMMENT_COLUMN = 35
# Outside of this a number is a slip for the reader; a fraction in quotes is not.
_SMALLEST = Fraction(1, 10**30)
_LARGEST_WHOLE = 1e15


def write_number(value: float) -> str:
    """Return a number that is read back as the same float."""
    return str(int(value)) if value == int(value) and abs(value) < _LARGEST_WHOLE else repr(float(value))


def write_known(value: float | None) -> str:
    """Return a number, or the text that stands for one to be identified."""
    return '"unknown"' if value is None else write_number(value)


def add_comment(line: str, comment: str) -> str:
    """Return a line with a comment behind it, comments under each other where they can be."""
    return f"{line:<{_COMMENT_COLUMN}}# {comment}" if len(line) < _COMMENT_COLUMN else f"{line}  # {comment}"


def write_fraction(value: Fraction) -> str:
    """Return a rational number: a decimal where it ends soon, else a text such as "1/3"."""
    size = abs(value)
    if 10**_MOST_PLACES % value.denominator == 0 and (not size or _SMALLEST < size < 1 / _SMALLEST):
        places = next(k for k in range(_MOST_PLACES + 1) if 10**k % value.denominator == 0)
        whole = abs(value.numerator) * 10**places // value.denominator
        digits = f"{whole:0{places + 1}d}"
        point = len(digits) - places
        text = f"{digits[:point]}.{digits[point:]}" if places else digits
        return f"-{text}" if value < 0 else text
    return f'"{value}"'


def write_exact(value: Exact) -> str:
    """Return a number or form, such as 0.5, "L1" or "1/2*sqrt(3)"."""
    return write_fraction(value.coefficient("")[0]) if value.is_rational else f'"{value}"'


def write_angle(angle: Angle) -> str:
    """Return an angle that is read back with the same cosine and sine."""
    for k, twelfth in _TWELFTHS:
        if (angle.cosine, angle.sine) == (twelfth.cosine, twelfth.sine):
            return _write_twelfths(Fraction(k, 12))
    radians = math.atan2(angle.sine.to_float(), angle.cosine.to_float())
    found = find_angle(radians)
    if (found.cosine, found.sine) == (angle.cosine, angle.sine):
        return repr(radians)
    return f'"2*atan({find_half_tangent(angle.cosine, angle.sine)})"'


def _write_twelfths(part: Fraction) -> str:
    """Return a fraction of pi."""
    if not part:
        return "0"
    times = {1: "", -1: "-"}.get(part.numerator, f"{part.numerator}*")
    return f'"{times}pi"' if part.denominator == 1 else f'"{times}pi/{part.denominator}"'


def write_value(value: object) -> str:
    """Return a plain value: text, flag, number, list or table."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case int():
            return str(value)
        case float() | Decimal():
            return write_number(float(value))
        case Mapping():
            inner = ", ".join(f"{write_key(key)} = {write_value(entry)}" for key, entry in value.items())
            return f"{{ {inner} }}"
        case list() | tuple():
            return f"[{', '.join(write_value(entry) for entry in value)}]"
    message = f"no TOML for {type(value).__name__}"
    raise TypeError(message)


def write_key(key: str) -> str:
    """Return a key, in quotes where it needs them."""
    bare = key and all(letter.isascii() and (letter.isalnum() or letter in "_-") for letter in key)
    return key if bare else write_value(key)


def _keep(entries: Mapping[str, str]) -> dict[str, str]:
    return {key: text for key, text in entries.items() if text != "0"}


def write_modified_row(placement: Placement) -> dict[str, str] | None:
    """Return alpha, a, d, theta of a frame, those that are zero left out; None where it is no such row.

    The rotation is Rx(alpha) Rz(theta), the translation (a, -sin(alpha) d, cos(alpha) d).
    """
    r, t = placement.rotation, placement.translation
    alpha = _make_angle(r[2][2], -r[1][2])
    theta = _make_angle(r[0][0], -r[0][1])
    d = alpha.cosine * t[2] - alpha.sine * t[1]
    if place_modified_dh(alpha, t[0], d, theta) != placement:
        return None
    texts = {"alpha": write_angle(alpha), "a": write_exact(t[0]), "d": write_exact(d)}
    return _keep(texts | {"theta": write_angle(theta)})


def write_standard_row(near: Placement, frame: Placement) -> dict[str, str] | None:
    """Return alpha, a, d, theta of a joint's frame and its link's; None where they are no such row.

    Args:
        near: the joint's frame seen from the link before, Rz(theta) Tz(d).
        frame: the link's frame seen from the joint's, Tx(a) Rx(alpha).
    """
    theta = _make_angle(near.rotation[0][0], near.rotation[1][0])
    alpha = _make_angle(frame.rotation[1][1], frame.rotation[2][1])
    d, a = near.translation[2], frame.translation[0]
    turned = compose_placements(translate(ZERO, ZERO, d), rotate_z(theta))
    far = compose_placements(translate(a, ZERO, ZERO), rotate_x(alpha))
    if (turned, far) != (near, frame):
        return None
    texts = {"alpha": write_angle(alpha), "a": write_exact(a), "d": write_exact(d)}
    return _keep(texts | {"theta": write_angle(theta)})


def write_origin(placement: Placement) -> str:
    """Return the table of a frame: xyz, and rpy or quaternion where it is turned."""
    parts = []
    if any(placement.translation):
        parts.append(f"xyz = [{', '.join(write_exact(entry) for entry in placement.translation)}]")
    if placement.rotation != IDENTITY.rotation:
        angles = find_rpy(placement.rotation)
        if angles is not None:
            parts.append(f"rpy = [{', '.join(write_angle(angle) for angle in angles)}]")
        else:
            entries = find_quaternion(placement.rotation)
            parts.append(f"quaternion = [{', '.join(write_exact(entry) for entry in entries)}]")
    return f"{{ {', '.join(parts)} }}" if parts else "{}"


def _make_angle(cosine: Exact, sine: Exact) -> Angle:
    return Angle(cosine=cosine, sine=sine, radians=math.atan2(sine.to_float(), cosine.to_float()))
