"""Link frames in a form that depends on the robot alone, not on who drew its frames.

Input: joints in a tree. Output: the same joints, their frames turned about and shifted along their own axes.
Neither changes the robot, its coordinates or their signs; both change how many operations its functions need
and which combinations of parameters are called what.

The form is that of modified Denavit and Hartenberg (Khalil and Kleinfinger 1986), Rot(x, alpha) Trans(x, a)
Rot(z, theta) Trans(z, d): the x axis of a link stands along the common normal of its own joint axis and that
of the first joint after it. What the form leaves open is chosen so that theta and d are zero at q = 0.

Supported: trees of revolute and prismatic joints, symbolic lengths. A normal whose direction is no number of
the field of sqrt(2) and sqrt(3) is met to the digits of a double (`settling`); parallel axes with such a
distance between them keep the frame, and its exact numbers, where its two parts have few digits: somebody
chose them. Axes that are nearly parallel have their common normal far away; the origin is then left open.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import atan2, hypot

import numpy as np

from symid.robot.axis_frames import invert_placement, to_floats
from symid.robot.description import Joint
from symid.robot.geometry import IDENTITY, ONE, ZERO, Exact, Placement, Row, compose_placements, find_angle
from symid.robot.inertia import move_parameters
from symid.robot.settling import SMALLEST_LENGTH, SMALLEST_SNAP, settle_placement
from symid.robot.surds import find_inverse, find_root

__all__ = ["Reframed", "reframe_joints"]

_Direction = tuple[Exact, Exact]
_KEPT: _Direction = (ONE, ZERO)
# Digits of a length that somebody chose; programs write six and more.
_CHOSEN_DIGITS = 4
_DECIMALS = 10**30
# A common normal further away than this many times the robot's longest length is that of parallels.
_FARTHEST = 10
# Below this angle (rad) between axes, parameters depend on digits that few files have.
_NEARLY_PARALLEL = 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class Reframed:
    """Joints with other link frames.

    For each joint, `moved_by` is how far its axes or its link's frame of the file were moved to get exact
    numbers (rad); `tilts` is the angle to the axis of its parent (rad) where these are nearly parallel, or 0.
    """

    joints: tuple[Joint, ...]
    moved_by: tuple[float, ...]
    tilts: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choice:
    """What a link's frame is to be: the direction of x in the old frame's plane, and a shift along z.

    None where the robot leaves it open.
    """

    direction: _Direction | None = None
    shift: Exact | None = None


def reframe_joints(
    joints: Sequence[Joint], symbols: Mapping[str, float] | None = None, *, snap: float = 1e-5
) -> Reframed:
    """Return the joints with frames of the modified form.

    Placements, inertial values and `Joint.frame` go along, so that nothing else changes.

    Args:
        joints: parents before children.
        symbols: values of symbolic lengths, m.
        snap: axes within this angle (rad) of being parallel, and turns within it of a multiple of pi/2, are
            taken as such; zero turns that off.
    """
    values = symbols or {}
    tolerance = max(snap, SMALLEST_SNAP)
    children: dict[int, Joint] = {}
    for joint in joints:
        children.setdefault(joint.parent, joint)
    farthest = _FARTHEST * max((_find_length(joint.placement, values) for joint in joints), default=0.0)
    moves: list[Placement] = []
    found, moved_by, tilts = [], [], []
    for index, joint in enumerate(joints):
        before = IDENTITY if joint.parent < 0 else moves[joint.parent]
        placement = joint.placement
        if before != IDENTITY:
            placement = compose_placements(invert_placement(before), placement)
        choice = _choose(children[index].placement, values, tolerance) if index in children else _Choice()
        choice = _limit_shift(placement, choice, farthest, values)
        move = _find_move(placement, choice, tolerance)
        moves.append(move)
        settled = settle_placement(compose_placements(placement, move), values, snap=snap)
        back = invert_placement(move)
        framed = settle_placement(compose_placements(back, joint.frame), values, snap=snap)
        found.append(
            replace(
                joint,
                placement=settled.placement,
                frame=framed.placement,
                inertial=joint.inertial and _move_inertial(joint.inertial, back, values),
            )
        )
        moved_by.append(max(settled.moved_by, framed.moved_by))
        tilts.append(0.0 if joint.parent < 0 else _find_tilt(settled.placement))
    return Reframed(joints=tuple(found), moved_by=tuple(moved_by), tilts=tuple(tilts))


def _find_length(placement: Placement, symbols: Mapping[str, float]) -> float:
    return hypot(*(value.to_float(symbols) for value in placement.translation))


def _find_tilt(placement: Placement) -> float:
    """Return the angle between the z axes (rad) where it is small and not zero, else zero."""
    tilt = hypot(placement.rotation[0][2].to_float(), placement.rotation[1][2].to_float())
    return tilt if SMALLEST_SNAP < tilt < _NEARLY_PARALLEL else 0.0


def _move_inertial(
    inertial: tuple[float, ...], back: Placement, symbols: Mapping[str, float]
) -> tuple[float, ...]:
    if back == IDENTITY:
        return inertial
    translation = np.array([entry.to_float(symbols) for entry in back.translation])
    return move_parameters(inertial, np.array(to_floats(back)), translation)


def _choose(child: Placement, symbols: Mapping[str, float], tolerance: float) -> _Choice:
    """Return the frame that the first joint after a link asks for.

    With the child's axis along u through p, x stands along z x u, and the origin at the foot of the common
    normal: p_z - u_z (p.u - p_z u_z) / (u_x^2 + u_y^2). For parallel axes x stands along p, if there is a
    distance between them, and the origin is free.
    """
    ux, uy, uz = (row[2] for row in child.rotation)
    px, py, pz = child.translation
    if hypot(ux.to_float(), uy.to_float()) <= tolerance:
        if hypot(px.to_float(symbols), py.to_float(symbols)) <= SMALLEST_LENGTH:
            return _Choice()
        # Lengths that somebody chose stay exact; those that a program rotated are rounded anyway.
        chosen = not ux and not uy and _is_chosen(px) and _is_chosen(py)
        return _Choice(direction=_find_direction(px, py) or (_KEPT if chosen else _aim(px, py, symbols)))
    direction = _find_direction(-uy, ux) or _aim(-uy, ux, symbols)
    along = (px * ux + py * uy) * find_inverse(ux * ux + uy * uy)
    return _Choice(direction=direction, shift=pz - uz * along)


def _is_chosen(value: Exact) -> bool:
    """Return whether all numbers in a length are decimals of few digits."""
    return all(_has_few_digits(part) for _, surd in value.terms for part in surd[:1]) and not any(
        part for _, surd in value.terms for part in surd[1:]
    )


def _has_few_digits(value: Fraction) -> bool:
    whole = abs(value) * _DECIMALS
    return whole.denominator == 1 and len(str(whole.numerator).strip("0")) <= _CHOSEN_DIGITS


def _limit_shift(
    placement: Placement, choice: _Choice, farthest: float, symbols: Mapping[str, float]
) -> _Choice:
    """Return the choice with the shift left open where it leads beyond `farthest` (m)."""
    if choice.shift is None:
        return choice
    offset = (choice.shift + _find_offset(placement)).to_float(symbols)
    return choice if abs(offset) <= farthest else replace(choice, shift=None)


def _find_offset(placement: Placement) -> Exact:
    """Return where the origin stands along its own z axis, seen from the parent's origin."""
    x, y, z = (row[2] * t for row, t in zip(placement.rotation, placement.translation, strict=True))
    return x + y + z


def _find_direction(x: Exact, y: Exact) -> _Direction | None:
    """Return the unit vector along (x, y), in either sense; None where it is no number of the field."""
    if not y:
        return (ONE, ZERO)
    if not x:
        return (ZERO, ONE)
    if not (x.is_number and y.is_number):
        return None
    length = find_root(x * x + y * y)
    if length is None:
        return None
    inverse = find_inverse(length)
    return (x * inverse, y * inverse)


def _aim(x: Exact, y: Exact, symbols: Mapping[str, float]) -> _Direction:
    """Return a direction along (x, y) to the digits of a double."""
    angle = find_angle(atan2(y.to_float(symbols), x.to_float(symbols)), snap=0)
    return (angle.cosine, angle.sine)


def _find_move(placement: Placement, choice: _Choice, tolerance: float) -> Placement:
    """Return the new frame seen from the old one.

    Args:
        placement: the old frame seen from the parent's new frame.
        choice: what the next joint asks for.
        tolerance: below this a direction cosine counts as zero.
    """
    columns = [(column[0], column[1], column[2]) for column in zip(*placement.rotation, strict=True)]
    direction = choice.direction or _find_nearest_turn(columns, tolerance)
    lifted = [direction[0] * x + direction[1] * y for x, y in zip(columns[0], columns[1], strict=True)]
    entries = [entry.to_float() for entry in lifted]
    first = next(entry for entry in entries if abs(entry) > tolerance)
    cosine, sine = direction if first > 0 else (-direction[0], -direction[1])
    shift = choice.shift
    if shift is None:
        shift = -_find_offset(placement)
    rotation = ((cosine, -sine, ZERO), (sine, cosine, ZERO), (ZERO, ZERO, ONE))
    return Placement(rotation=rotation, translation=(ZERO, ZERO, shift))


def _find_nearest_turn(columns: Sequence[Row], tolerance: float) -> _Direction:
    """Return the direction of the first of the parent's axes that is normal to the joint's own axis.

    The old x axis, if there is none.
    """
    for axis in range(3):
        if not columns[2][axis]:
            return (columns[0][axis], columns[1][axis])
        if abs(columns[2][axis].to_float()) <= tolerance:
            return _aim(columns[0][axis], columns[1][axis], {})
    return _KEPT
