"""What the torsion of joints may follow: their rigid torques, plays of them, the direction of motion.

Input: a library of robot functions, recordings. Output: `RigidTorque`, columns for `find_alignment`.

    tau = [Y | ddtheta | Yf] x      joint torques, rotors of elastic joints, friction: ordinary least squares
    gravity = Y(q, 0, 0) beta       what stands still pulls; springs at joints are among it
    motion = Y(q, dq, ddq) beta - gravity

Positions are those of the motors: what torsion changes in the regressors is of second order.

Supported: any robot with a library, elastic or rigid; the weights of joints follow their residuals.
Not supported: parameters one by one: only sums that the recordings tell are used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.alignment import Alignment, align, find_alignment, keep_significant, move_link
from symid.data.encoders import Encoders, find_encoders, split_blocks
from symid.data.filters import differentiate, low_pass
from symid.data.recording import Recording
from symid.errors import LogError, Notice
from symid.joint.plays import find_plays

__all__ = [
    "RigidRows",
    "build_rigid_rows",
    "find_reversal_widths",
    "find_rigid_grams",
    "find_torsion_alignment",
    "fit_rigid",
    "list_torsion_columns",
    "prepare_aligned",
    "say_unknown",
]

_CUTOFF = 10.0
_LEAST_RATIO = 10.0
_ORDER = 4
_EDGE = 0.5
_PLAYS = (0.05, 0.1, 0.2, 0.35, 0.55)
"""Radii of plays as parts of the largest torque."""
_REVERSAL = 0.02
"""Of the largest speed: the width of a change of direction."""
_ROUNDS = 3
_RANK = 1e-7
_ROUNDING = 1e-9
"""Of a joint's largest torque."""
_PASSES = 8
_STEADY = 1e-5
"""Rad, m or s: gravity at a zero and a time that are wrong by less is right."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidRows:
    """The rigid robot's equations over one recording, at full rate.

    Args:
        encoders: low-passed positions; period: s.
        speed, acceleration: (N, n) of the motors.
        still, whole: (N, n, p) regressors at rest and in motion, of the base parameters.
        extra: (N, n, r) columns of rotors and friction.
        torque: (N, n) measured, low-passed alike.
        blocks: of about a second, for the jackknife.
    """

    encoders: Encoders
    period: float
    speed: FloatArray
    acceleration: FloatArray
    still: FloatArray
    whole: FloatArray
    extra: FloatArray
    torque: FloatArray
    blocks: tuple[slice, ...]


def build_rigid_rows(
    library: Library, recording: Recording, *, cutoff: float = _CUTOFF, block: float = 1.0
) -> RigidRows:
    """Return the equations of one recording.

    Args:
        library: the robot's functions.
        recording: with both encoders.
        cutoff: of the zero-phase low-pass in Hz, at most a tenth of the sample rate.
        block: length of a block in s.

    Raises:
        LogError: the recording has one encoder only.
    """
    found, period = find_encoders(recording), recording.period
    cutoff = min(cutoff, 1.0 / (_LEAST_RATIO * period))
    theta, q, torque = (
        low_pass(values, period=period, cutoff=cutoff, order=_ORDER)
        for values in (found.theta, found.q, recording.torque)
    )
    speed = differentiate(theta, period)
    acceleration = differentiate(speed, period)
    link = np.where(found.present, q, theta)
    rest = np.zeros_like(link)
    link_speed = differentiate(link, period)
    (still,) = library.evaluate("torque_regressor", link, rest, rest)
    (whole,) = library.evaluate("torque_regressor", link, link_speed, differentiate(link_speed, period))
    extra = [_spread(acceleration)] if library.card.rotors else []
    if library.card.friction:
        # Dry friction changes its sign faster than the low-pass lets pass: friction first, then the filter.
        (friction,) = library.evaluate("friction_regressor", _find_fast_speed(found, recording))
        extra.append(low_pass(friction, period=period, cutoff=cutoff, order=_ORDER))
    empty = np.zeros((*theta.shape, 0))
    return RigidRows(
        encoders=Encoders(theta=theta, q=q, present=found.present),
        period=period,
        speed=speed,
        acceleration=acceleration,
        still=still,
        whole=whole,
        extra=np.concatenate([empty, *extra], axis=2),
        torque=torque,
        blocks=split_blocks(len(theta), period, _EDGE, block),
    )


def _spread(values: FloatArray) -> FloatArray:
    """Return (N, n) as (N, n, n), column j in row j."""
    spread = np.zeros((*values.shape, values.shape[1]))
    joints = np.arange(values.shape[1])
    spread[:, joints, joints] = values
    return spread


def _find_fast_speed(found: Encoders, recording: Recording) -> FloatArray:
    fast = min(4.0 * _CUTOFF, 1.0 / (_LEAST_RATIO * recording.period))
    theta = low_pass(found.theta, period=recording.period, cutoff=fast, order=_ORDER)
    return differentiate(theta, recording.period)


def fit_rigid(grams: FloatArray, weights: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the parameters x (k,) and the joints' residuals (n,), root sums of squares.

    Args:
        grams: (n, k + 1, k + 1) of [A_j | tau_j], summed over blocks.
        weights: (n,) of the joints; by their residuals, iterated, where None.
    """
    rounds = _ROUNDS if weights is None else 1
    weights = np.ones(len(grams)) if weights is None else weights
    for _ in range(rounds):
        whole = np.einsum("j,jkl->kl", weights, grams)
        inner, right = whole[:-1, :-1], whole[:-1, -1]
        lengths = np.sqrt(np.diag(inner))
        scales = np.where(lengths > 0.0, lengths, 1.0)
        values, vectors = np.linalg.eigh(inner / np.outer(scales, scales))
        seen = values > _RANK**2 * max(values[-1], 1e-300)
        part = vectors[:, seen]
        x = (part @ ((part.T @ (right / scales)) / values[seen])) / scales
        left = np.append(x, -1.0)
        squares = np.maximum(np.einsum("k,jkl,l->j", left, grams, left), 0.0)
        squares = np.maximum(squares, 1e-18 * grams[:, -1, -1] + 1e-300)
        if rounds > 1:
            weights = 1.0 / squares
    return x, np.sqrt(squares)


def find_rigid_grams(rows: RigidRows) -> FloatArray:
    """Return the Gram matrices (blocks, n, k + 1, k + 1) of [whole | extra | torque]."""
    design = np.concatenate([rows.whole, rows.extra, rows.torque[:, :, None]], axis=2)
    return np.array(
        [[design[part, j].T @ design[part, j] for j in range(design.shape[1])] for part in rows.blocks]
    )


def find_torsion_alignment(library: Library, recordings: Sequence[Recording]) -> Alignment:
    """Return delay and offsets of the link encoders, the torsion following the robot's own torques.

    Torques depend on where the links are, so that they are found again with the encoders moved, until delay
    and offsets rest.

    Raises:
        LogError: see `find_alignment`.
    """
    moved = tuple(recordings)
    used, delay = np.zeros((len(recordings), library.card.size)), 0.0
    for _ in range(_PASSES):
        columns = list_torsion_columns([build_rigid_rows(library, recording) for recording in moved])
        found = find_alignment(recordings, columns)
        offsets = np.nan_to_num(found.offsets, nan=0.0)
        change = max(float(np.max(np.abs(offsets - used))), abs(found.delay - delay))
        if change < _STEADY:
            break
        used, delay = offsets, found.delay
        moved = tuple(move_link(recording, found, run=run) for run, recording in enumerate(recordings))
    return found


def prepare_aligned(
    library: Library, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], Alignment | None, tuple[Notice, ...]]:
    """Return the recordings with delay and offsets of their link encoders taken out, if there are any.

    What may as well be zero is left alone, and so is a zero that cannot be told; notices say so. Recordings
    that are too short to tell are returned as they are.

    Raises:
        LogError: a recording has one encoder only, no joint has both encoders, or the delay is beyond what is
            searched.
    """
    try:
        found = find_torsion_alignment(library, recordings)
    except LogError as error:
        if {notice.code for notice in error.notices} != {"log.short-alignment"}:
            raise
        told = tuple(replace(notice, text=f"{notice.text}; it was taken as none") for notice in error.notices)
        return tuple(recordings), None, told
    unknown = say_unknown(found, [joint.name for joint in library.card.joints])
    kept = keep_significant(found)
    if kept is None:
        return tuple(recordings), found, (_say_in_line(found), *unknown)
    moved = tuple(align(recording, kept, run=run) for run, recording in enumerate(recordings))
    return moved, kept, (*(recording.notices[-1] for recording in moved), *unknown)


def _say_in_line(found: Alignment) -> Notice:
    text = (
        f"delay between the encoders: {1e3 * found.delay:.3g} ms (standard deviation "
        f"{1e3 * found.delay_std:.2g} ms)"
    )
    if np.all(np.isnan(found.offsets)):
        return Notice(code="log.in-line", text=f"{text}: it may be zero, and nothing was moved")
    text += (
        f", zero offsets up to {np.nanmax(np.abs(found.offsets)):.2g} ({np.nanmax(found.offset_stds):.2g})"
    )
    return Notice(code="log.in-line", text=f"{text}: both may be zero, and nothing was moved")


def say_unknown(alignment: Alignment, joints: Sequence[str]) -> tuple[Notice, ...]:
    """Return a notice on link encoders whose zero cannot be told; `joints` are the names of all."""
    names = [repr(name) for name, unknown in zip(joints, alignment.unknown, strict=True) if unknown]
    if not names:
        return ()
    text = (
        f"joint{'s'[: len(names) > 1]} {', '.join(names)}: the torque of gravity hardly changes in some log, "
        "so that a zero offset of its link encoder looks like its torsion; the offset was left alone: "
        "set the zero with the joint unloaded, or move it to where gravity pulls otherwise"
    )
    return (Notice(code="log.offset-unknown", text=text),)


def list_torsion_columns(runs: Sequence[RigidRows]) -> list[FloatArray]:
    """Return for each recording what the torsion may follow, (N, n, 7), all of one scale.

    Gravity, the torque of motion, plays of their sum, the direction of motion, the acceleration: torques with
    a memory of their turning points are what hysteresis follows, and the rest what a fit of torques errs by.
    """
    grams = np.concatenate([find_rigid_grams(rows) for rows in runs])
    x, _ = fit_rigid(grams.sum(axis=0))
    count = runs[0].whole.shape[2]
    peak = np.max([np.max(np.abs(rows.whole @ x[:count]), axis=0) for rows in runs], axis=0)
    scale = np.where(peak > 0.0, peak, 1.0)
    width = find_reversal_widths(runs)
    return [_list_columns(rows, x[:count], scale, width) for rows in runs]


def find_reversal_widths(runs: Sequence[RigidRows]) -> FloatArray:
    """Return the speeds (n,) in rad/s or m/s over which a change of direction is spread."""
    speeds: FloatArray = np.max([np.max(np.abs(rows.speed), axis=0) for rows in runs], axis=0)
    return _REVERSAL * np.where(speeds > 0.0, speeds, 1.0)


def _list_columns(rows: RigidRows, beta: FloatArray, scale: FloatArray, width: FloatArray) -> FloatArray:
    gravity = rows.still @ beta / scale
    # Rounding at a joint that gravity does not load is no torque, and must not look like a constant one.
    gravity = np.where(np.max(np.abs(gravity), axis=0) > _ROUNDING, gravity, 0.0)
    torque = rows.whole @ beta / scale
    plays = np.stack(
        [find_plays(torque[:, joint], np.array(_PLAYS), None) for joint in range(torque.shape[1])], axis=1
    )
    plain = (gravity, torque - gravity, torque**2, torque**3, np.tanh(rows.speed / width), rows.acceleration)
    return np.concatenate([np.stack(plain, axis=2), plays], axis=2)
