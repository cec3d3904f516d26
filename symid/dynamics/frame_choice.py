"""Link frames chosen for fewer operations, where all torques stay the same; and what rounding angles costs.

Robot, or recursion and parameters -> the same, written otherwise. Two readings of a URDF, with angles rounded
to quarter turns and as written -> the one to take, and the price of rounding.

Constant rotations: Rx(alpha) Rz(theta) before the joint's own Rz(q) becomes Rx(alpha) Rz(q + theta). Origins
move along the joint's axis, next to the parent's origin, or beyond the first joint of an arm. A link that
carries no other is described in the axes its frame has at q = 0.

Supported: trees; revolute joints, those that follow another included; prismatic joints stay as they are.
Not supported: constant rotations by quarter turns, and placements whose x axis is no common normal.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from symid.arrays import FloatArray
from symid.dynamics.algebra import Algebra, T
from symid.dynamics.bodies import Parameters, gather_body, list_entries, transform_body
from symid.dynamics.recursion import Recursion, compute_motions, lift_placement
from symid.dynamics.regressors import evaluate_torque_regressor
from symid.errors import Notice
from symid.notation import INERTIAL
from symid.robot import DEFAULT_SNAP, IDENTITY, ONE, ZERO, Exact, Joint, JointKind, Robot

_ROUNDING_CODES = frozenset({"robot.angle-snapped", "robot.axis-snapped"})
_ROUNDED_TURN = "robot.angle-rounded"
# 4.71 is so far from 3 pi/2: the most that is taken for a rounded angle, in rad.
_COARSE_SNAP = 2.5e-3
# Of a coefficient of a group, in parts of the largest one of the group: what rounding may change.
_STABLE = 0.01
_STATES = 40
_SEED = 20240
# Between what an angle of 1e-5 rad adds to a column of length one, and its square.
_SMALLEST_SINGULAR = 1e-9


def list_constant_rotations(robot: Robot) -> dict[int, float]:
    """Return the angle (rad) of every joint's constant turn, where it is no multiple of pi/2."""
    turns = {}
    for index, joint in enumerate(robot.joints):
        c, minus_s, across = joint.placement.rotation[0]
        if joint.kind is JointKind.REVOLUTE and c and minus_s and not across:
            turns[index] = math.atan2(-minus_s.to_float(), c.to_float())
    return turns


def remove_constant_rotations(robot: Robot, links: Collection[int]) -> Robot:
    """Return the robot without the constant turns of `links`; their joints' angles start there."""
    joints = list(robot.joints)
    for link in links:
        placement = joints[link].placement
        # The z axis of Rx(alpha) Rz(theta) is (0, -sin(alpha), cos(alpha)).
        _, minus_s, c = (row[2] for row in placement.rotation)
        rotation = ((ONE, ZERO, ZERO), (ZERO, c, minus_s), (ZERO, -minus_s, c))
        joints[link] = replace(joints[link], placement=replace(placement, rotation=rotation))
    return replace(robot, joints=tuple(joints))


def _move_origin(joint: Joint, step: Exact) -> Joint:
    """Return the joint with its origin moved by `step` along its axis."""
    placement = joint.placement
    lengths = zip(placement.rotation, placement.translation, strict=True)
    x, y, z = (length + row[2] * step for row, length in lengths)
    return replace(joint, placement=replace(placement, translation=(x, y, z)))


def choose_origin_shifts(robot: Robot) -> dict[int, Exact]:
    """Return by how much which origins are moved back along their joint's axis, in m."""
    parents = {joint.parent for joint in robot.joints}
    shifts: dict[int, Exact] = {}
    for link, joint in enumerate(robot.joints):
        # Distance of the link's origin from its parent's along the joint's axis.
        placement, axial = joint.placement, ZERO
        for row, length in zip(placement.rotation, placement.translation, strict=True):
            axial = axial + row[2] * length
        if joint.parent < 0 or joint.kind is not JointKind.REVOLUTE or not axial:
            continue
        # Of a link that carries others, only where all origins of its branch before it coincide.
        before, level = joint.parent, not any(_move_origin(joint, -axial).placement.translation)
        while level and (earlier := robot.joints[before]).parent >= 0:
            level = earlier.kind is JointKind.REVOLUTE and not any(earlier.placement.translation)
            before = earlier.parent
        if level or link not in parents:
            shifts[link] = axial
    return shifts


def shift_origins(robot: Robot, shifts: Mapping[int, Exact]) -> Robot:
    """Return the robot whose link origins are moved back along their joint's axis by `shifts`."""
    joints = []
    for link, joint in enumerate(robot.joints):
        moved = _move_origin(joint, -shifts[link]) if link in shifts else joint
        if joint.parent in shifts:
            x, y, z = moved.placement.translation
            placement = replace(moved.placement, translation=(x, y, z + shifts[joint.parent]))
            moved = replace(moved, placement=placement)
        joints.append(moved)
    return replace(robot, joints=tuple(joints))


def shift_parameters(algebra: Algebra[T], old: Parameters[T], shifts: Mapping[int, Exact]) -> Parameters[T]:
    """Return the parameters about the origins that `shifts` moves back (Huygens and Steiner).

    XX + 2 d MZ + d^2 M, YY likewise;  XZ - d MX, YZ - d MY;  MZ + d M.
    """
    moved = dict(old)
    plus, mul = algebra.add, algebra.mul
    for link, step in shifts.items():
        d = algebra.constant(step)
        mx, my, mz, mass = (old.get((link, name), algebra.zero) for name in ("MX", "MY", "MZ", "M"))
        bend = mul(d, plus(plus(mz, mz), mul(d, mass)))
        added = {"XX": bend, "YY": bend, "XZ": algebra.neg(mul(d, mx)), "YZ": algebra.neg(mul(d, my))}
        for name, value in {**added, "MZ": mul(d, mass)}.items():
            moved[link, name] = plus(old.get((link, name), algebra.zero), value)
    return moved


def fix_last_link_axes(recursion: Recursion[T], old: Parameters[T]) -> tuple[Recursion[T], Parameters[T]]:
    """Return the recursion and the parameters with the axes of last links held; links on the base stay."""
    robot, algebra = recursion.robot, recursion.algebra
    parents = {joint.parent for joint in robot.joints}
    frames, turned = list(recursion.frames), dict(old)
    axes, origin = lift_placement(IDENTITY, algebra)
    for link, (joint, frame) in enumerate(zip(robot.joints, recursion.frames, strict=True)):
        if link not in parents and joint.parent >= 0 and frame.turn is not None:
            frames[link] = replace(frame, turn=None)
            # As its parent sees it that stands in the same place, at q = 0.
            place = replace(frame, fixed=axes, origin=origin)
            body = transform_body(algebra, place, gather_body(algebra, old, link))
            turned |= {(link, name): entry for name, entry in zip(INERTIAL, list_entries(body), strict=True)}
    held = tuple(frames)
    motions = compute_motions(robot, algebra, held, recursion.state.velocity)
    return replace(recursion, frames=held, motions=motions), turned


def choose_reading(read: Callable[..., Robot]) -> Robot:
    """Return a robot with its angles as they are meant: near multiples of pi/2 these, else as written.

    `read` takes the largest angle (rad) that is rounded as `snap`, or nothing for the usual one. Angles that
    are further off, but are written with so few digits that they may be rounded, become multiples of pi/2
    only where the base set hangs on these digits: where a coefficient of a group changes by more than 1 %. A
    note says what was assumed, and what it changes.
    """
    usual = read()
    codes = {notice.code for notice in usual.notices}
    coarse = _ROUNDED_TURN in codes
    if not usual.joints or not (coarse or _ROUNDING_CODES & codes):
        return usual
    rounded, written = (read(snap=_COARSE_SNAP), usual) if coarse else (usual, read(snap=0.0))
    # The same draws anywhere, for the groups, and within the limits, for the torques: q, dq, ddq.
    motions = []
    for bounded in (False, True):
        rng, whole = np.random.default_rng(_SEED), (-math.pi, math.pi)
        ranges = [(axis.limits.position if bounded else None) or whole for axis in written.axes]
        low, high = np.array(ranges).T[..., None]
        q = low + (high - low) * rng.uniform(size=(written.freedom, _STATES))
        motions.append((q, *(rng.uniform(-size, size, q.shape) for size in (2.0, 5.0))))
    keys = [(link, name) for link in range(written.size) for name in INERTIAL]
    groups, torques = [], []
    for robot in (written, rounded):
        turned = ([part.T for part in motion] for motion in motions)
        free, limited = (evaluate_torque_regressor(robot, keys, *rows) for rows in turned)
        groups.append(_group_columns(free.reshape(-1, len(keys))))
        values = np.array([joint.inertial or (0.0,) * len(INERTIAL) for joint in robot.joints])
        torques.append(limited @ values.ravel())
    counts = [np.count_nonzero(rows.any(axis=1)) for rows in groups]
    sizes = np.maximum(np.abs(groups[1]).max(axis=1, initial=1.0), 1.0)
    stable = bool(np.all(np.abs(groups[0] - groups[1]).max(axis=1, initial=0.0) <= _STABLE * sizes))
    if coarse and stable:
        return usual
    largest = np.abs(torques[0]).max(axis=0)
    differences = np.abs(torques[0] - torques[1]).max(axis=0)
    change = float(np.max(differences[largest > 0.0] / largest[largest > 0.0], initial=0.0))
    price = f"torques by at most {change:.1e} of each joint's largest" if change else "no torque"
    remedy = f"--snap {DEFAULT_SNAP:g}" if coarse else "--snap 0"
    code, text = "robot.rounding-price", f"rounding the angles changes {price}, and not the number of base "
    text += f"parameters ({counts[1]}); {remedy} takes the angles as written"
    if not stable:
        hung = f"{counts[0]} base parameters in place of {counts[1]}"
        hung = hung if counts[0] != counts[1] else f"some of the {counts[1]} base parameters"
        code, text = "robot.rounding-assumed", "angles near multiples of pi/2 were taken as these multiples: "
        text += f"as written, {hung} would hinge on the last digits of the file. This changes {price}; if "
        text += f"the angles are meant as written, use {remedy}"
    return replace(rounded, notices=(*rounded.notices, Notice(code=code, text=text, file=rounded.path)))


def _group_columns(matrix: FloatArray) -> FloatArray:
    """Return the groups of columns of a regressor: row j has what column j stands for, zeros if another does.

    Columns are taken in their order; one that those before it make up, to 1e-9 of its length, joins them.
    """
    lengths = np.linalg.norm(matrix, axis=0)
    size, seen = len(lengths), lengths > _SMALLEST_SINGULAR * lengths.max(initial=0.0)
    basis, kept = np.zeros((len(matrix), 0)), list[int]()
    for k in np.flatnonzero(seen):
        rest = matrix[:, k] / lengths[k]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        if (left := np.linalg.norm(rest)) > _SMALLEST_SINGULAR:
            basis, kept = np.column_stack([basis, rest / left]), [*kept, int(k)]
    groups = np.zeros((size, size))
    if kept:
        groups[kept] = np.linalg.lstsq(matrix[:, kept] / lengths[kept], matrix, rcond=None)[0]
        groups[kept] /= lengths[kept, None]
    return groups
