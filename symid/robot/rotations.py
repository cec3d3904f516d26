"""Exact rotations as half-angle tangents, as roll, pitch and yaw, and as quaternions, both ways.

Input: exact cosines and sines, exact matrices. Output: the same rotation in another form, without rounding.

Supported: every rotation matrix over the rationals with sqrt(2) and sqrt(3). It always has a quaternion in
that field, not of length one; roll, pitch and yaw only where the cosine of the pitch lies in the field.
"""

import math
from collections.abc import Sequence

from symid.robot.geometry import (
    IDENTITY,
    ONE,
    ZERO,
    Angle,
    Exact,
    Placement,
    compose_placements,
    rotate_x,
    rotate_z,
)
from symid.robot.surds import find_inverse, find_root

__all__ = [
    "Matrix",
    "find_half_tangent",
    "find_quaternion",
    "find_rotation",
    "find_rpy",
    "find_tangent_angle",
    "rotate_rpy",
    "rotate_y",
]

_Row = tuple[Exact, Exact, Exact]
Matrix = tuple[_Row, _Row, _Row]
_TWO = Exact.of(2)


def rotate_y(angle: Angle) -> Placement:
    """Return the frame turned about y by `angle`."""
    c, s = angle.cosine, angle.sine
    rotation = ((c, ZERO, s), (ZERO, ONE, ZERO), (-s, ZERO, c))
    return Placement(rotation=rotation, translation=IDENTITY.translation)


def rotate_rpy(roll: Angle, pitch: Angle, yaw: Angle) -> Placement:
    """Return the frame turned by angles about fixed axes, Rz(yaw) Ry(pitch) Rx(roll), as in URDF."""
    return compose_placements(rotate_z(yaw), compose_placements(rotate_y(pitch), rotate_x(roll)))


def find_tangent_angle(tangent: Exact) -> Angle:
    """Return the angle 2 atan(t): cos = (1 - t^2) / (1 + t^2), sin = 2 t / (1 + t^2)."""
    square = tangent * tangent
    scale = find_inverse(ONE + square)
    cosine, sine = (ONE - square) * scale, _TWO * tangent * scale
    return Angle(cosine=cosine, sine=sine, radians=2 * math.atan(tangent.to_float()))


def find_half_tangent(cosine: Exact, sine: Exact) -> Exact:
    """Return tan(angle / 2) = sin / (1 + cos) of any angle but a half turn.

    Raises:
        ZeroDivisionError: the angle is a half turn.
    """
    return sine * find_inverse(ONE + cosine)


def find_rotation(quaternion: Sequence[Exact]) -> Matrix:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = quaternion
    scale = _TWO * find_inverse(w * w + x * x + y * y + z * z)
    return (
        (ONE - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)),
        (scale * (x * y + w * z), ONE - scale * (x * x + z * z), scale * (y * z - w * x)),
        (scale * (x * z - w * y), scale * (y * z + w * x), ONE - scale * (x * x + y * y)),
    )


def find_quaternion(rotation: Matrix) -> tuple[Exact, ...]:
    """Return a quaternion (w, x, y, z) of the matrix, scaled so that its parts have no denominators.

    The rows of 4 q q', whose entries are linear in those of the matrix, are multiples of q
    (Bar-Itzhack 2000, Journal of Guidance, Control, and Dynamics 23(6)).
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    rows = (
        (ONE + a + e + i, h - f, c - g, d - b),
        (h - f, ONE + a - e - i, b + d, c + g),
        (c - g, b + d, ONE - a + e - i, f + h),
        (d - b, c + g, f + h, ONE - a - e + i),
    )
    largest = max(range(4), key=lambda k: rows[k][k].to_float())
    scale = find_inverse(rows[largest][largest])
    scaled = [entry * scale for entry in rows[largest]]
    below = math.lcm(*(part.denominator for entry in scaled for part in entry.coefficient("")))
    return tuple(entry * Exact.of(below) for entry in scaled)


def find_rpy(rotation: Matrix) -> tuple[Angle, Angle, Angle] | None:
    """Return roll, pitch and yaw of the matrix, None where their cosines and sines are not in the field."""
    sine = -rotation[2][0]
    cosine = find_root(ONE - sine * sine)
    if cosine is None:
        return None
    if cosine:
        scale = find_inverse(cosine)
        roll = _make_angle(rotation[2][2] * scale, rotation[2][1] * scale)
        yaw = _make_angle(rotation[0][0] * scale, rotation[1][0] * scale)
    else:
        # Roll and yaw turn about one axis; the yaw does it all.
        roll, yaw = _make_angle(ONE, ZERO), _make_angle(rotation[1][1], -rotation[0][1])
    angles = (roll, _make_angle(cosine, sine), yaw)
    return angles if rotate_rpy(*angles).rotation == rotation else None


def _make_angle(cosine: Exact, sine: Exact) -> Angle:
    return Angle(cosine=cosine, sine=sine, radians=math.atan2(sine.to_float(), cosine.to_float()))
