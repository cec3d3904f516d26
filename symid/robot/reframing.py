"""Link frames in a form that depends on the robot alone, not on who drew its frames.

Input: joints in a tree. Output: the same joints, their frames turned about and shifted along their own axes.
Neither changes the robot, its coordinates or their signs; both change how many operations its functions need
and which combinations of parameters are called what.

The form is that of modified Denavit and Hartenberg (Khalil and Kleinfinger 1986), Rot(x, alpha) Trans(x, a)
Rot(z, theta) Trans(z, d): the x axis of a link stands along the common normal of its own joint axis and that
of the first joint after it. What the form leaves open is chosen so that theta and d are zero at q = 0.

Supported: trees of revolute and prismatic joints, symbolic lengths. A normal whose direction is no number of
the field of sqrt(2) and sqrt(3) is met to the digits of a double (`settling`); parallel axes with such a
distance between them, written in decimals, keep the frame, and its exact numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot

import numpy as np

from symid.robot.axis_frames import invert_placement, to_floats
from symid.robot.description import Joint
from symid.robot.geometry import IDENTITY, ONE, ZERO, Exact, Placement, Row, compose_placements, find_angle
from symid.robot.inertia import move_parameters
from symid.robot.settling import SMALLEST_LENGTH, SMALLEST_SNAP, is_long, settle_placement
from symid.robot.surds import find_inverse, find_root

__all__ = ["Reframed", "reframe_joints"]

_Direction = tuple[Exact, Exact]
_KEPT: _Direction = (ONE, ZERO)
_WRITTEN = 10**12


@dataclass(frozen=True, slots=True, kw_only=True)
class Reframed:
    """Joints with other link frames, and for each how far its axes were moved to get exact numbers (rad)."""

    joints: tuple[Joint, ...]
    moved_by: tuple[float, ...]


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
    moves: list[Placement] = []
    found, moved_by = [], []
    for index, joint in enumerate(joints):
        before = IDENTITY if joint.parent < 0 else moves[joint.parent]
        placement = joint.placement
        if before != IDENTITY:
            placement = compose_placements(invert_placement(before), placement)
        choice = _choose(children[index].placement, values, tolerance) if index in children else _Choice()
        move = _find_move(placement, choice, tolerance)
        moves.append(move)
        settled = settle_placement(compose_placements(placement, move), values, snap=snap)
        back = invert_placement(move)
        found.append(
            replace(
                joint,
                placement=settled.placement,
                frame=settle_placement(compose_placements(back, joint.frame), values, snap=snap).placement,
                inertial=joint.inertial and _move_inertial(joint.inertial, back, values),
            )
        )
        moved_by.append(settled.moved_by)
    return Reframed(joints=tuple(found), moved_by=tuple(moved_by))


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
        # Lengths that somebody wrote stay exact; those that a program rotated are rounded anyway.
        written = not ux and not uy and not any(is_long(value, _WRITTEN) for value in (px, py))
        return _Choice(direction=_find_direction(px, py) or (_KEPT if written else _aim(px, py, symbols)))
    direction = _find_direction(-uy, ux) or _aim(-uy, ux, symbols)
    along = (px * ux + py * uy) * find_inverse(ux * ux + uy * uy)
    return _Choice(direction=direction, shift=pz - uz * along)


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
        x, y, z = (u * t for u, t in zip(columns[2], placement.translation, strict=True))
        shift = -(x + y + z)
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
