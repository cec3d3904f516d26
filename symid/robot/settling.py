"""Placements with short exact numbers, close to placements with long ones.

Input: a placement whose exact numbers came together in many steps. Output: a placement with short numbers,
some 1e-15 away; quarter turns, right angles and zeros that rounding hid are found again.

Supported: rotations of the modified Denavit-Hartenberg form Rot(x, alpha) Rot(z, theta) become two exact
angles; any other rotation with long numbers becomes a rational quaternion. Short numbers stay as they are.
"""

from collections.abc import Mapping
from fractions import Fraction
from itertools import chain
from math import atan2

from symid.robot.axis_frames import Turned, find_quarter_turns, to_floats
from symid.robot.geometry import (
    ZERO,
    Exact,
    Placement,
    Row,
    compose_placements,
    find_angle,
    rotate_x,
    rotate_z,
)
from symid.robot.rotations import Matrix, find_rotation

__all__ = ["SMALLEST_LENGTH", "SMALLEST_SNAP", "is_long", "settle_placement"]

SMALLEST_SNAP = 1e-9
"""Angles below this are the rounding of what was written (rad)."""

SMALLEST_LENGTH = 1e-9
"""Lengths below this are the rounding of what was written (m)."""

# One angle with a rational cosine has a denominator of 16 digits, two of them 32.
_LONGEST_TURN = 10**36
_LONGEST_LENGTH = 10**12
# A sum with square roots is no longer than this; beyond it came from decimals, and is one.
_LONGEST_SURD = 10**8
_LENGTH_PARTS = 10**12
_QUATERNION_PARTS = 10**16


def settle_placement(
    placement: Placement, symbols: Mapping[str, float] | None = None, *, snap: float = 1e-5
) -> Turned:
    """Return the placement in short numbers, and how far its axes were moved (rad).

    Args:
        placement: the placement, its rotation orthogonal.
        symbols: values of symbolic lengths, m.
        snap: rotations within this angle (rad) of quarter turns become these; zero turns that off.
    """
    rotation = _settle_rotation(placement, snap)
    before, after = to_floats(placement), to_floats(rotation)
    moved = max(abs(a - b) for a, b in zip(chain(*before), chain(*after), strict=True))
    x, y, z = _settle_translation(placement, rotation.rotation, symbols or {})
    return Turned(placement=Placement(rotation=rotation.rotation, translation=(x, y, z)), moved_by=moved)


def is_long(value: Exact, longest: int) -> bool:
    """Return whether a number has a denominator above `longest`."""
    return any(part.denominator > longest for _, surd in value.terms for part in surd)


def _settle_rotation(placement: Placement, snap: float) -> Placement:
    if straight := find_quarter_turns(placement, snap=snap):
        return straight.placement
    long = any(is_long(entry, _LONGEST_TURN) for row in placement.rotation for entry in row)
    across = placement.rotation[0][2]
    if not across and not long:
        return placement
    r = to_floats(placement)
    if abs(r[0][2]) <= max(snap, SMALLEST_SNAP):
        alpha = find_angle(atan2(-r[1][2], r[2][2]), snap=snap)
        theta = find_angle(atan2(-r[0][1], r[0][0]), snap=snap)
        return compose_placements(rotate_x(alpha), rotate_z(theta))
    if long:
        return Placement(rotation=_approximate(r), translation=placement.translation)
    return placement


def _approximate(r: tuple[tuple[float, ...], ...]) -> Matrix:
    """Return the rotation of a rational quaternion near `r` (Shepperd 1978, the largest part first)."""
    trace = r[0][0] + r[1][1] + r[2][2]
    squares = [trace, r[0][0], r[1][1], r[2][2]]
    largest = max(range(4), key=lambda k: squares[k])
    if largest == 0:
        parts = [1 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        parts = [r[k][j] - r[j][k], 0.0, 0.0, 0.0]
        parts[1 + i] = 1 + r[i][i] - r[j][j] - r[k][k]
        parts[1 + j] = r[j][i] + r[i][j]
        parts[1 + k] = r[k][i] + r[i][k]
    scale = max(abs(part) for part in parts)
    return find_rotation([Exact.of(round(part / scale * _QUATERNION_PARTS)) for part in parts])


def _settle_translation(placement: Placement, rotation: Matrix, symbols: Mapping[str, float]) -> Row:
    """Return the translation in short numbers: a and d, where it has the modified form."""
    origin = placement.translation
    if not any(is_long(value, _LONGEST_LENGTH if value.is_rational else _LONGEST_SURD) for value in origin):
        return _drop_dust(origin)
    if not all(value.is_number for value in origin):
        return origin
    t = [value.to_float(symbols) for value in origin]
    u = [row[2] for row in rotation]
    d = sum(a.to_float() * b for a, b in zip(u, t, strict=True))
    rest = [b - a.to_float() * d for a, b in zip(u, t, strict=True)]
    if not u[0] and max(abs(value) for value in rest[1:]) <= SMALLEST_LENGTH:
        offset = _round(d)
        return (_round(rest[0]), u[1] * offset, u[2] * offset)
    return (_round(t[0]), _round(t[1]), _round(t[2]))


def _drop_dust(origin: Row) -> Row:
    x, y, z = (
        ZERO if value.is_number and abs(value.to_float()) < SMALLEST_LENGTH else value for value in origin
    )
    return (x, y, z)


def _round(value: float) -> Exact:
    if abs(value) < SMALLEST_LENGTH:
        return ZERO
    return Exact.surd(Fraction(round(Fraction(value) * _LENGTH_PARTS), _LENGTH_PARTS))
