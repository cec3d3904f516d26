"""Exact frames from the direction of an axis, and rotations that are nearly quarter turns.

Input: directions as rational numbers, placements. Output: rotations whose entries are exact, so that they are
orthogonal to the last digit, and how far they stand from what was written.

Supported: any direction but zero. What the field of sqrt(2) and sqrt(3) holds is met exactly; others through
angles with rational cosines and sines, some 1e-16 rad from what was written.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from symid.robot.geometry import (
    IDENTITY,
    Angle,
    Exact,
    Placement,
    compose_placements,
    find_angle,
    rotate_x,
    rotate_z,
)
from symid.robot.rotations import rotate_y
from symid.robot.surds import find_inverse, find_root

__all__ = [
    "Turned",
    "find_axis_frame",
    "find_quarter_turns",
    "invert_placement",
    "to_floats",
]

_Direction = tuple[Fraction, Fraction, Fraction]
_SMALLEST_SNAP = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """A rotation, and by how much it differs from what was written (rad)."""

    placement: Placement
    moved_by: float


def invert_placement(placement: Placement) -> Placement:
    """Return the outer frame seen from the inner one: R' and -R' p."""
    columns = list(zip(*placement.rotation, strict=True))
    r0, r1, r2 = ((column[0], column[1], column[2]) for column in columns)
    rotation = (r0, r1, r2)
    back = Placement(rotation=rotation, translation=IDENTITY.translation)
    x, y, z = (-value for value in placement.translation)
    origin = Placement(rotation=IDENTITY.rotation, translation=(x, y, z))
    return compose_placements(back, origin)


def to_floats(placement: Placement) -> tuple[tuple[float, ...], ...]:
    """Return the rotation in floating point, row by row."""
    return tuple(tuple(entry.to_float() for entry in row) for row in placement.rotation)


def find_axis_frame(axis: _Direction, *, snap: float = 1e-5) -> Turned:
    """Return a rotation that takes z to the direction of `axis`.

    Args:
        axis: three numbers, not all zero; their length does not matter.
        snap: an axis within this angle (rad) of a coordinate axis is taken as that axis.
    """
    x, y, z = axis
    size = max(abs(x), abs(y), abs(z))
    x, y, z = x / size, y / size, z / size
    if straight := _find_straight(x, y, z, snap):
        return straight
    flat = find_root(Exact.surd(x * x + y * y))
    length = find_root(Exact.surd(x * x + y * y + z * z))
    if flat and length:
        pitch = _divide(Exact.surd(z), flat, length)
        yaw = _divide(Exact.surd(x), Exact.surd(y), flat)
    else:
        pitch = find_angle(math.atan2(math.hypot(x, y), z), snap=snap)
        yaw = find_angle(math.atan2(y, x), snap=snap)
    placement = compose_placements(rotate_z(yaw), rotate_y(pitch))
    return Turned(placement=placement, moved_by=_find_distance(placement, (float(x), float(y), float(z))))


def _divide(cosine: Exact, sine: Exact, by: Exact) -> Angle:
    inverse = find_inverse(by)
    c, s = cosine * inverse, sine * inverse
    return Angle(cosine=c, sine=s, radians=math.atan2(s.to_float(), c.to_float()))


def _find_straight(x: Fraction, y: Fraction, z: Fraction, snap: float) -> Turned | None:
    """Return the rotation for an axis that stands near a coordinate axis."""
    values = (x, y, z)
    index = max(range(3), key=lambda k: abs(values[k]))
    others = math.hypot(*(float(value) for k, value in enumerate(values) if k != index))
    moved = math.atan2(others, abs(float(values[index])))
    if moved > max(snap, _SMALLEST_SNAP):
        return None
    quarters = 1 if values[index] > 0 else -1
    angle = find_angle((0 if quarters > 0 else math.pi) if index == 2 else quarters * math.pi / 2)
    # z goes to y by a quarter turn back about x.
    turned = (rotate_y(angle), rotate_x(_negate(angle)), rotate_x(angle))[index]
    return Turned(placement=turned, moved_by=moved)


def _negate(angle: Angle) -> Angle:
    return Angle(cosine=angle.cosine, sine=-angle.sine, radians=-angle.radians)


def _find_distance(placement: Placement, axis: Sequence[float]) -> float:
    """Return the angle between `axis` and where the rotation takes z (rad)."""
    u = [row[2].to_float() for row in placement.rotation]
    cross = [u[(k + 1) % 3] * axis[(k + 2) % 3] - u[(k + 2) % 3] * axis[(k + 1) % 3] for k in range(3)]
    return math.atan2(math.hypot(*cross), sum(a * b for a, b in zip(u, axis, strict=True)))


def find_quarter_turns(placement: Placement, *, snap: float = 1e-5) -> Turned | None:
    """Return the rotation with entries 0, 1 and -1 that `placement` stands near, None where there is none.

    What was written in several steps can come to a quarter turn that none of the steps shows.
    """
    rows = to_floats(placement)
    rounded = [[round(value) for value in row] for row in rows]
    moved = max(abs(a - b) for a, b in zip(itertools.chain(*rows), itertools.chain(*rounded), strict=True))
    if moved > max(snap, _SMALLEST_SNAP):
        return None
    r0, r1, r2 = ((Exact.of(row[0]), Exact.of(row[1]), Exact.of(row[2])) for row in rounded)
    rotation = (r0, r1, r2)
    if rotation == placement.rotation:
        return None
    return Turned(placement=Placement(rotation=rotation, translation=placement.translation), moved_by=moved)
