"""Link frames in modified Denavit-Hartenberg form, with short exact numbers.

Joints in a tree -> the same joints, their frames turned about and shifted along their own axes, so that the
frames depend on the robot alone. Neither changes the robot, its coordinates or their signs; both change the
number of operations of its functions and the names of its base parameters.

Supported: trees of revolute and prismatic joints. A normal whose direction is not in the
field of sqrt(2) and sqrt(3) is approximated to the digits of a double; parallel axes with such a distance
between them keep the frame, and its exact numbers, where its two parts have few digits: somebody chose them.
Axes that are nearly parallel have their common normal far away; the origin is then left open.
Not supported: symbolic lengths.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from math import atan2, hypot

from symid.robot import geometry
from symid.robot.description import Joint
from symid.robot.inertia import move_by_placement

# Angles (rad) and lengths (m) below these are the rounding of what was written.
_SMALLEST_SNAP, _SMALLEST_LENGTH = 1e-9, 1e-9
# One angle with a rational cosine has a denominator of 16 digits, two of them 32.
_LONGEST_TURN = 10**36
_LONGEST_LENGTH = 10**12
# A sum with square roots is no longer than this; beyond it came from decimals, and is one.
_LONGEST_SURD = 10**8
_LENGTH_PARTS = 10**12
# Where nothing is to be moved: what doubles leave of zero and of a length, in m.
_LENGTH_DUST, _EXACT_PARTS = 1e-14, 10**16
_QUATERNION_PARTS = 10**16
_Direction = tuple[geometry.Exact, geometry.Exact]
_Freedom = tuple[_Direction | None, geometry.Exact | None]
_KEPT: _Direction = (geometry.ONE, geometry.ZERO)
# Digits of a length that somebody chose; programs write six and more.
_CHOSEN_DIGITS = 4
_DECIMALS = 10**30
# A common normal further away than this many times the robot's longest length is that of parallels.
_FARTHEST = 10
# Below this angle (rad) between axes, parameters depend on digits that few files have.
_NEARLY_PARALLEL = 1e-2


def rationalize_placement(
    placement: geometry.Placement, *, snap: float = 1e-5
) -> tuple[geometry.Placement, float]:
    """Return the placement in short numbers, and how far its axes were moved (rad).

    Long exact numbers, which come together in many steps, become short ones some 1e-15 away, and quarter
    turns, right angles and zeros that rounding hid are restored: rotations of the modified form become two
    exact angles, any other rotation with long numbers a rational quaternion. Short numbers stay as they are.
    Rotations within `snap` (rad) of quarter turns become these; zero turns that off.
    """
    r = geometry.to_floats(placement)
    long = any(has_long_denominator(entry, _LONGEST_TURN) for row in placement.rotation for entry in row)
    rotation = geometry.snap_to_quarter_turns(placement, snap=snap) or placement
    if rotation is placement and (long or placement.rotation[0][2]):
        if abs(r[0][2]) <= geometry.get_tolerance(snap):
            alpha = geometry.build_exact_angle(atan2(-r[1][2], r[2][2]), snap=snap)
            theta = geometry.build_exact_angle(atan2(-r[0][1], r[0][0]), snap=snap)
            rotation = geometry.compose_placements(geometry.rotate_x(alpha), geometry.rotate_z(theta))
        elif long:
            rotation = replace(placement, rotation=_approximate_rotation(r))
    moved = max(abs(a - b) for a, b in zip(chain(*r), chain(*geometry.to_floats(rotation)), strict=True))
    origin = _rationalize_translation(placement.translation, rotation.rotation, exact=not snap)
    return replace(rotation, translation=origin), moved


def has_long_denominator(value: geometry.Exact, longest: int) -> bool:
    """Return whether a number has a denominator above `longest`."""
    return any(part.denominator > longest for _, surd in value.terms for part in surd)


def _approximate_rotation(r: tuple[tuple[float, ...], ...]) -> geometry.ExactMatrix:
    """Return the rotation of a rational quaternion near `r` (Shepperd 1978, the largest part first)."""
    squares = [r[0][0] + r[1][1] + r[2][2], r[0][0], r[1][1], r[2][2]]
    parts = geometry.list_quaternions(r, 1.0)[squares.index(max(squares))]
    scale = max(map(abs, parts))
    whole = [geometry.Exact.of(round(part / scale * _QUATERNION_PARTS)) for part in parts]
    return geometry.compute_rotation(whole)


def _rationalize_translation(
    origin: geometry.ExactVector, rotation: geometry.ExactMatrix, *, exact: bool
) -> geometry.ExactVector:
    """Return the translation in short numbers: a and d, where it has the modified form."""
    smallest = _LENGTH_DUST if exact else _SMALLEST_LENGTH
    longest = (_LONGEST_LENGTH if value.is_rational else _LONGEST_SURD for value in origin)
    if not any(map(has_long_denominator, origin, longest)):
        x, y, z = (geometry.ZERO if abs(value.to_float()) < smallest else value for value in origin)
        return (x, y, z)
    t = [value.to_float() for value in origin]
    u = [row[2] for row in rotation]
    d = sum(a.to_float() * b for a, b in zip(u, t, strict=True))
    rest = [b - a.to_float() * d for a, b in zip(u, t, strict=True)]
    if not u[0] and max(abs(value) for value in rest[1:]) <= smallest:
        offset = _round_length(d, exact=exact)
        return (_round_length(rest[0], exact=exact), u[1] * offset, u[2] * offset)
    x, y, z = (_round_length(value, exact=exact) for value in t)
    return (x, y, z)


def _round_length(value: float, *, exact: bool) -> geometry.Exact:
    if abs(value) < (_LENGTH_DUST if exact else _SMALLEST_LENGTH):
        return geometry.ZERO
    parts = _EXACT_PARTS if exact else _LENGTH_PARTS
    return geometry.Exact.surd(Fraction(round(Fraction(value) * parts), parts))


@dataclass(frozen=True, slots=True, kw_only=True)
class CanonicalFrames:
    """Joints with other link frames.

    For each joint, `moved_by` is how far its axes or its link's frame of the file were moved to get exact
    numbers (rad); `tilts` is the angle to the axis of its parent (rad) where these are nearly parallel, or 0.
    """

    joints: tuple[Joint, ...]
    moved_by: tuple[float, ...]
    tilts: tuple[float, ...]


def choose_canonical_frames(joints: Sequence[Joint], *, snap: float = 1e-5) -> CanonicalFrames:
    """Return the joints with frames of the modified form, and all else expressed in these.

    Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d) (Khalil and Kleinfinger 1986): the x axis of a link
    stands along the common normal of its own joint axis and that of the first joint after it. What the form
    leaves open is chosen so that theta and d are zero at q = 0.

    Parents stand before children. Axes within `snap` (rad) of being parallel, and turns within it of a
    multiple of pi/2, are taken as such; zero turns that off.
    """
    tolerance = geometry.get_tolerance(snap)
    children: dict[int, Joint] = {}
    for joint in joints:
        children.setdefault(joint.parent, joint)
    lengths = [hypot(*(value.to_float() for value in joint.placement.translation)) for joint in joints]
    farthest = _FARTHEST * max(lengths, default=0.0)
    moves: list[geometry.Placement] = []
    found, moved_by, tilts = [], [], []
    for index, joint in enumerate(joints):
        before = geometry.IDENTITY if joint.parent < 0 else moves[joint.parent]
        placement = geometry.compose_placements(geometry.invert_placement(before), joint.placement)
        # Where the origin stands along its own z axis, seen from the parent's origin.
        x, y, z = (row[2] * t for row, t in zip(placement.rotation, placement.translation, strict=True))
        along = x + y + z
        direction, shift = None, None
        if index in children:
            direction, shift = _choose_frame(children[index].placement, tolerance)
        if shift is None or abs((shift + along).to_float()) > farthest:
            shift = -along
        xs, ys, zs = zip(*placement.rotation, strict=True)
        if direction is None:
            # The first of the parent's axes that is normal to the joint's own axis, else the old x axis.
            axis = next((k for k in range(3) if abs(zs[k].to_float()) <= tolerance), None)
            direction = _KEPT if axis is None else (xs[axis], ys[axis])
            if axis is not None and zs[axis]:
                direction = _approximate_direction(xs[axis], ys[axis], tolerance)
        cosine, sine = direction
        lifted = [(cosine * a + sine * b).to_float() for a, b in zip(xs, ys, strict=True)]
        if next(entry for entry in lifted if abs(entry) > tolerance) < 0:
            cosine, sine = -cosine, -sine
        # The new frame seen from the old one.
        turn = geometry.rotate_z(geometry.Angle.of(cosine, sine))
        move = replace(turn, translation=(geometry.ZERO, geometry.ZERO, shift))
        moves.append(move)
        settled, moved = rationalize_placement(geometry.compose_placements(placement, move), snap=snap)
        back = geometry.invert_placement(move)
        frame, turned = rationalize_placement(geometry.compose_placements(back, joint.frame), snap=snap)
        inertial = joint.inertial and move_by_placement(joint.inertial, back)
        found.append(replace(joint, placement=settled, frame=frame, inertial=inertial))
        moved_by.append(max(moved, turned))
        tilt = hypot(*(row[2].to_float() for row in settled.rotation[:2]))
        tilts.append(tilt if joint.parent >= 0 and _SMALLEST_SNAP < tilt < _NEARLY_PARALLEL else 0.0)
    return CanonicalFrames(joints=tuple(found), moved_by=tuple(moved_by), tilts=tuple(tilts))


def _choose_frame(child: geometry.Placement, tolerance: float) -> _Freedom:
    """Return the direction of x in the old frame's plane, and the shift along z; None where they are free.

    With the axis of the first joint after the link along u through p, x stands along z x u, and the origin at
    the foot of the common normal: p_z - u_z (p.u - p_z u_z) / (u_x^2 + u_y^2). For parallel axes x stands
    along p, if there is a distance between them, and the origin is free.
    """
    ux, uy, uz = (row[2] for row in child.rotation)
    px, py, pz = child.translation
    if hypot(ux.to_float(), uy.to_float()) <= tolerance:
        if hypot(px.to_float(), py.to_float()) <= _SMALLEST_LENGTH:
            return None, None
        if direction := _compute_exact_direction(px, py):
            return direction, None
        # Lengths that somebody chose stay exact; those that a program rotated are rounded anyway.
        chosen = not ux and not uy and _is_chosen(px) and _is_chosen(py)
        return _KEPT if chosen else _approximate_direction(px, py, tolerance), None
    direction = _compute_exact_direction(-uy, ux) or _approximate_direction(-uy, ux, tolerance)
    along = (px * ux + py * uy) * geometry.invert_exact(ux * ux + uy * uy)
    return direction, pz - uz * along


def _is_chosen(value: geometry.Exact) -> bool:
    """Return whether all numbers in a length are decimals of few digits."""
    for _, (one, *roots) in value.terms:
        whole = abs(one) * _DECIMALS
        digits = str(whole.numerator).strip("0")
        if any(roots) or whole.denominator != 1 or len(digits) > _CHOSEN_DIGITS:
            return False
    return True


def _compute_exact_direction(x: geometry.Exact, y: geometry.Exact) -> _Direction | None:
    """Return the unit vector along (x, y), in either sense; None where it is not in the field."""
    if not x or not y:
        return (geometry.ZERO, geometry.ONE) if y else (geometry.ONE, geometry.ZERO)
    length = geometry.compute_square_root(x * x + y * y)
    if length is None:
        return None
    inverse = geometry.invert_exact(length)
    return (x * inverse, y * inverse)


def _approximate_direction(x: geometry.Exact, y: geometry.Exact, tolerance: float) -> _Direction:
    """Return a direction along (x, y) to the digits of a double; multiples of pi/12 within the tolerance."""
    snap = geometry.ROUNDED if tolerance >= geometry.ROUNDED else 0.0
    angle = geometry.build_exact_angle(atan2(y.to_float(), x.to_float()), snap=snap)
    return (angle.cosine, angle.sine)
