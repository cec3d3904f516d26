"""From recordings to what brakes a joint: its torque, less what moves and holds its links.

Input: the robot's functions, recordings, processing. Output: `JointLogs`, filtered states; `FrictionSamples`
of one joint at a time.

    tau = Y_j(q, dq, ddq) beta + friction of others + tau_f(dq)

The rigid part is fitted with friction: the columns of Y_j that these motions tell apart, or J ddq + a sin q
+ b cos q where they say the same. Or it is subtracted, with base parameters that are already known.

Supported: motions of one joint and of several; recordings at several poses; drives that turn with several
joints, whose friction is fitted along.
Not supported: elastic joints; other joints' friction that is not linear in its parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import JointCard
from symid.codegen.library import Library
from symid.data.recording import Recording, Signals
from symid.data.signals import prepare_signals, settle_processing
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.friction.reduction import build_reduction, find_rows, select_friction_rows
from symid.friction.rigid_part import (
    RigidColumns,
    find_load,
    find_other_columns,
    find_rigid_columns,
    reduce_columns,
    warn_of_many,
)
from symid.friction.samples import FrictionSamples
from symid.robot.log_map import Processing
from symid.rows.identifiability import find_resting_joints, settle_joints

__all__ = ["ExtractedJoint", "JointLogs", "extract_joint", "prepare_joint_logs"]

_CARRIED = 0.05
"""Peak speed relative to that of the fastest joint below which others move a joint, not its motor."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointLogs:
    """Recordings as filtered states, with which joints rest in each.

    Args:
        signals: one a recording.
        resting: joints that do not move; their velocities are exactly zero.
        carried: joints that move only as others shake them: they stick and slip.
        sources: where the recordings come from.
        processing: as used.
    """

    signals: tuple[Signals, ...]
    resting: tuple[tuple[int, ...], ...]
    carried: tuple[tuple[int, ...], ...]
    sources: tuple[str, ...]
    processing: Processing

    def find_moving(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move a joint."""
        return tuple(
            k
            for k, (resting, carried) in enumerate(zip(self.resting, self.carried, strict=True))
            if joint not in (*resting, *carried)
        )

    def find_alone(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move this joint and no other."""
        return tuple(
            k
            for k in self.find_moving(joint)
            if len((*self.resting[k], *self.carried[k])) == self.signals[k].q.shape[1] - 1
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExtractedJoint:
    """What friction of one joint is fitted to, and what a reader should know of it.

    Args:
        samples: for the estimators.
        rigid: how the rigid part was treated, in a sentence.
        notices: rows left out.
    """

    samples: FrictionSamples
    rigid: str
    notices: tuple[Notice, ...]


def prepare_joint_logs(
    library: Library, recordings: Sequence[Recording], processing: Processing
) -> JointLogs:
    """Return the recordings filtered and differentiated, joints at rest exactly so.

    Raises:
        LogError: a recording has another number of joints than the robot, or cannot be filtered.
        IdentifiabilityError: no joint moves in any of them.
    """
    _check_joints(library, recordings)
    processing = settle_processing(processing, recordings[0].period)
    resting = tuple(map(find_resting_joints, recordings))
    if all(len(still) == library.card.size for still in resting):
        text = (
            "no joint moves beyond the noise of its encoder in any of these logs: friction shows where a "
            "joint turns both ways, slowly and fast; record that"
        )
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text))
    signals = tuple(
        settle_joints(prepare_signals(recording, processing), still)
        for recording, still in zip(recordings, resting, strict=True)
    )
    return JointLogs(
        signals=signals,
        resting=resting,
        carried=tuple(_find_carried(library, entry) for entry in signals),
        sources=tuple(recording.source for recording in recordings),
        processing=processing,
    )


def _check_joints(library: Library, recordings: Sequence[Recording]) -> None:
    expected = library.card.size
    wrong = [entry for entry in recordings if entry.position.shape[1] != expected]
    if wrong:
        text = "the log has {} joints, the robot {!r} has {}"
        raise LogError(
            *(
                Notice(
                    code="log.joints",
                    text=text.format(entry.position.shape[1], library.card.robot, expected),
                    file=entry.source,
                )
                for entry in wrong
            )
        )


def _find_carried(library: Library, signals: Signals) -> tuple[int, ...]:
    """Return the joints that move at a small part of the speed of others of their kind."""
    peaks = np.max(np.abs(signals.dq), axis=0)
    kinds = np.array([joint.kind == "prismatic" for joint in library.card.joints])
    return tuple(
        joint
        for joint, peak in enumerate(peaks)
        if 0.0 < peak < _CARRIED * float(np.max(peaks[kinds == kinds[joint]]))
    )


def extract_joint(
    library: Library,
    logs: JointLogs,
    joint: int,
    *,
    runs: Sequence[int] | None = None,
    beta: FloatArray | None = None,
) -> ExtractedJoint:
    """Return what friction of a joint is fitted to.

    Args:
        library: `torque_regressor`, and `friction_regressor` where drives turn with several joints.
        logs: of `prepare_joint_logs`.
        joint: its number among those with a coordinate, from 0.
        runs: which recordings, those that move the joint by default.
        beta: (p,) base parameters that are known, in the order of the card; None to fit them.

    Raises:
        IdentifiabilityError: no recording moves the joint, or no row is left.
    """
    card = library.card.joints[joint]
    chosen = _choose_runs(logs, card, joint, runs)
    parts = [logs.signals[k] for k in chosen]
    angle, acceleration, velocity, torque = (
        np.concatenate([getattr(part, name)[:, joint] for part in parts])
        for name in ("q", "ddq", "dq", "tau")
    )
    rigid = find_rigid_columns(library, parts, joint)
    others = find_other_columns(library, parts, joint)
    if beta is not None:
        load: FloatArray | None = rigid.columns @ beta
        torque = torque - load
        sentence = "the rigid part was subtracted, with the base parameters given"
        fitted = others
    else:
        rigid, sentence = reduce_columns(rigid, angle, acceleration, card)
        load = find_load(rigid.columns, velocity, torque)
        fitted = RigidColumns(
            columns=np.hstack([rigid.columns, others.columns]),
            names=rigid.names + others.names,
            units=rigid.units + others.units,
        )
    samples = FrictionSamples(
        joint=card.name,
        time=np.concatenate([part.time for part in parts]),
        velocity=velocity,
        torque=torque,
        extra=fitted.columns,
        extra_names=fitted.names,
        extra_units=fitted.units,
        load=load,
        position=angle,
        run=np.repeat([float(k) for k in chosen], [len(part.time) for part in parts]),
        reduce=build_reduction([len(part.time) for part in parts], logs.processing.decimation),
        prismatic=card.kind == "prismatic",
    )
    samples, notices = _leave_out_slow(samples, logs.processing.standstill)
    if beta is None:
        notices += warn_of_many(card.name, len(rigid.names))
    return ExtractedJoint(samples=samples, rigid=sentence, notices=notices)


def _choose_runs(logs: JointLogs, card: JointCard, joint: int, runs: Sequence[int] | None) -> tuple[int, ...]:
    """Return which recordings are used.

    Raises:
        IdentifiabilityError: none.
    """
    chosen = logs.find_moving(joint) if runs is None else tuple(runs)
    if not chosen:
        carried = any(joint in entry for entry in logs.carried)
        text = f"joint {card.name!r} moves in none of these logs: nothing shows its friction"
        if carried:
            text = (
                f"joint {card.name!r} is only shaken by the motion of others, at less than "
                f"{100 * _CARRIED:g} % of their speed: there it sticks and slips, and no law of the speed "
                "shows; move it by itself"
            )
        raise IdentifiabilityError(Notice(code="friction.at-rest", text=text))
    return chosen


def _leave_out_slow(
    samples: FrictionSamples, standstill: float
) -> tuple[FrictionSamples, tuple[Notice, ...]]:
    """Leave out rows slower than `standstill` in rad/s or m/s, and say how many."""
    rows = find_rows(samples)
    slow = np.abs(rows.velocity) < standstill
    if not slow.any():
        return samples, ()
    if slow.all():
        text = (
            f"joint {samples.joint!r}: every row is slower than processing.standstill = {standstill:g}; "
            "--set processing.standstill=0 keeps them"
        )
        raise IdentifiabilityError(Notice(code="friction.all-slow", text=text))
    text = (
        f"joint {samples.joint!r}: {int(slow.sum())} of {len(slow)} rows slower than {standstill:g} "
        f"{'m/s' if samples.prismatic else 'rad/s'} were left out, as processing.standstill asks: friction "
        "below is extrapolated; --set processing.standstill=0 keeps them, for logs in which no joint sticks"
    )
    notices = (Notice(code="identify.slow-rows", text=text),)
    kept = ~slow
    return replace(select_friction_rows(samples, kept)), notices
