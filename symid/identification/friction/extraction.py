"""From recordings to the friction torque of one joint: the torque without what moves and holds its links.

    tau = Y_j(q, dq, ddq) beta + friction of others + tau_f(dq)

The rigid part is fitted with friction: the columns of Y_j that these motions tell apart, or J ddq + a sin
q + b cos q where that is the same. Or it is subtracted, with base parameters that are known. Periods of a
cosine motion can be averaged first: the mean of K periods has noise smaller by sqrt(K), and filters see a
signal without ends.

Supported: one moving joint or several; recordings at several poses; drives that turn with several joints,
whose friction is fitted along; any period of several samples (positions between samples by cubic splines,
torques, which jump, by straight lines).
Not supported: elastic joints; other joints' friction that is not linear in its parameters; finding the
period; motions that drift (positions that differ by more than a tenth of their range are refused).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen import JointCard, Library
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.identification.friction.samples import (
    FrictionSamples,
    build_friction_rows,
    build_reduction,
    select_friction_rows,
)
from symid.identification.regression import check_joints, hold_resting_joints, list_resting_joints
from symid.logs import Recording, Signals, choose_processing, prepare_signals
from symid.robot import Processing

_LEAST_SAMPLES = 20
_WHOLE = 1e-3
"""A period this near to a whole number of samples, over the whole log, is one."""
_DRIFT = 0.02
"""Scatter of the positions between periods, relative to their range, that is worth a warning."""
_WRONG = 0.1
"""The same where periods have nothing in common: their mean is no motion."""


def fold_recording(recording: Recording, period: float, *, margin: int | None = None) -> Recording:
    """Return the mean over all whole periods, with a margin of itself on either side.

    Args:
        recording: sampled evenly.
        period: of the motion in s.
        margin: samples by which the mean period is continued on either side; None for a whole period.

    Raises:
        LogError: less than two periods, a period of less than twenty samples, one that is not the motion's.
    """
    step = recording.period
    samples = round(period / step)
    # The last sample stands for the step behind it.
    periods = int((len(recording.time) * step + 1e-9 * period) // period)
    if samples < _LEAST_SAMPLES or periods < 2:
        text = (
            f"a period of {period:g} s is {samples} samples and fits {periods} times into the log; folding "
            f"needs {_LEAST_SAMPLES} samples and 2 periods at least"
        )
        raise LogError(Notice(code="log.period", text=text, file=recording.source))
    position, torque = (
        _cut_periods(values, recording.time, period, (periods, samples), degree=degree)
        for values, degree in ((recording.position, 3), (recording.torque, 1))
    )
    margin = samples if margin is None else margin
    places = np.arange(-margin, samples + margin)
    text = f"{periods} periods of {period:g} s were averaged, as --period asks"
    notices = (
        Notice(code="log.folded", text=text, file=recording.source),
        *_warn_of_drift(position, recording),
    )
    return replace(
        recording,
        time=recording.time[0] + np.arange(len(places)) * period / samples,
        position=position.mean(axis=0)[places % samples],
        torque=torque.mean(axis=0)[places % samples],
        velocity=None,
        motor_position=None,
        link_position=None,
        extras={},
        notices=(*recording.notices, *notices),
    )


def _cut_periods(
    values: FloatArray, time: FloatArray, period: float, sizes: tuple[int, int], *, degree: int
) -> FloatArray:
    """Return `values` (N, n) as (periods, samples, n), between samples by splines of this degree."""
    periods, samples = sizes
    wanted = samples * periods
    exact = periods * period / (time[1] - time[0])
    if abs(exact - wanted) < _WHOLE and wanted <= len(values):
        return values[:wanted].reshape(periods, samples, -1)
    from scipy.interpolate import make_interp_spline

    at = time[0] + np.arange(wanted) * period / samples
    spline = make_interp_spline(time, values, k=degree, axis=0)
    # Rounding may put the last place a hair behind the last sample.
    found: FloatArray = spline(np.minimum(at, time[-1]))
    return found.reshape(periods, samples, -1)


def _warn_of_drift(position: FloatArray, recording: Recording) -> tuple[Notice, ...]:
    """Return a notice where periods are not alike.

    Raises:
        LogError: they have nothing in common.
    """
    spread = np.ptp(position.mean(axis=0), axis=0)
    apart = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2, axis=(0, 1)))
    moving = spread > 0.0
    worst = float(np.max(apart[moving] / spread[moving], initial=0.0))
    # A joint that rests has no range that its noise could be compared with.
    if worst <= _DRIFT or float(np.max(apart)) <= _DRIFT * float(np.max(spread)):
        return ()
    text = (
        f"the positions of the periods differ by {100.0 * worst:.3g} % of their range: the period is not "
        "the motion's, or the motion drifts; give the right --period, one for each log where they differ, or "
        "none"
    )
    notice = Notice(code="log.not-periodic", text=text, file=recording.source)
    # What rests has no period: the joint that moves most tells.
    if float(np.max(apart)) > _WRONG * float(np.max(spread)):
        raise LogError(notice)
    return (notice,)


_DEPENDENT = 1e-6
"""What is left of a column beyond those before it, relative to its length, below which it is dependent."""
_ZERO = 1e-10
"""Length of a column relative to the longest below which it counts as zero."""
_MANY = 6
"""Columns of a rigid part fitted along beyond which they take more of friction than is good."""
_LOADED = 0.5
"""Part of the squared torque beside friction that a rigid part leaves at most where it counts as a load."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidColumns:
    """Columns (N, k) with the names and units of what multiplies them."""

    columns: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def build(cls, columns: FloatArray, entries: Iterable[tuple[str, str]]) -> "RigidColumns":
        """Return columns (N, k) with a name and a unit of each."""
        names, units = zip(*entries, strict=True) if columns.shape[1] else ((), ())
        return cls(columns=columns, names=names, units=units)

    def keep_independent(self) -> "RigidColumns":
        """Return the columns that are no combination of those before them."""
        index = list_independent(self.columns)
        return RigidColumns.build(self.columns[:, index], ((self.names[k], self.units[k]) for k in index))


def build_rigid_columns(library: Library, parts: Sequence[Signals], joint: int) -> RigidColumns:
    """Return the joint's row of the torque regressor."""
    rows = [library.evaluate("torque_regressor", part.q, part.dq, part.ddq)[0][:, joint] for part in parts]
    return RigidColumns.build(np.vstack(rows), ((entry.name, entry.unit) for entry in library.card.beta))


def _build_other_columns(library: Library, parts: Sequence[Signals], joint: int) -> RigidColumns:
    """Return columns of friction that is not the joint's own and acts on it nevertheless."""
    own, cards = library.card.joints[joint].name, library.card.friction
    index = [k for k, entry in enumerate(cards) if entry.joint != own]
    if not index:
        return RigidColumns.build(np.empty((sum(len(part.time) for part in parts), 0)), ())
    rows = np.vstack([library.evaluate("friction_regressor", part.dq)[0][:, joint] for part in parts])
    return RigidColumns.build(
        rows[:, index], ((cards[k].name, cards[k].unit) for k in index)
    ).keep_independent()


def _reduce_columns(
    rigid: RigidColumns, angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> tuple[RigidColumns, str]:
    """Return the columns that these motions tell apart, and a sentence on them."""
    physical = _name_physical(rigid.columns, angle, acceleration, card)
    chosen = (physical or rigid).keep_independent()
    if not chosen.names:
        return chosen, "no rigid part acts on this joint in these motions"
    if physical is not None:
        terms = {"J": "J ddq", "a": "a sin q", "b": "b cos q"}
        return chosen, f"the rigid part {' + '.join(terms[name] for name in chosen.names)} was fitted along"
    return chosen, (
        f"a rigid part of {len(chosen.names)} columns was fitted along; each stands for those that these "
        "motions do not tell apart from it"
    )


def list_independent(columns: FloatArray, limit: float = _DEPENDENT) -> list[int]:
    """Return which columns of (N, p) are no combination of those before them, in their order.

    Args:
        columns: any unit.
        limit: what must be left of a column beyond those before it, relative to its length.
    """
    lengths = np.linalg.norm(columns, axis=0)
    basis: list[FloatArray] = []
    kept = []
    # What rounding leaves of a column of zeros is no column.
    least = _ZERO * max(float(lengths.max(initial=0.0)), float(np.finfo(float).tiny))
    for k, length in enumerate(lengths):
        if length <= least:
            continue
        rest = columns[:, k] / length
        for _ in range(2):  # once more takes out what rounding left
            for direction in basis:
                rest = rest - direction * (direction @ rest)
        size = float(np.linalg.norm(rest))
        if size > limit:
            basis.append(rest / size)
            kept.append(k)
    return kept


def _name_physical(
    rigid: FloatArray, angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> RigidColumns | None:
    """Return J ddq, a sin q, b cos q where they span what the regressor's columns span, else None."""
    turning = card.kind != "prismatic"
    candidates = [("J", acceleration, "kg m^2" if turning else "kg")]
    if turning:
        candidates += [("a", np.sin(angle), "N m"), ("b", np.cos(angle), "N m")]
    independent = list_independent(rigid)
    base = rigid[:, independent]
    inside = [
        entry
        for entry in candidates
        if len(list_independent(np.column_stack([base, entry[1]]))) == len(independent)
    ]
    columns = np.column_stack([np.empty((len(angle), 0)), *(entry[1] for entry in inside)])
    if len(list_independent(columns)) != len(independent):
        return None
    return RigidColumns.build(columns, ((name, unit) for name, _, unit in inside))


def _estimate_load(rigid: FloatArray, velocity: FloatArray, torque: FloatArray) -> FloatArray | None:
    """Return the torque of the links (N,), by a fit with plain Coulomb, viscous and constant friction.

    None where it explains too little of the torque to be known: noise would pass for a load.
    """
    if not rigid.shape[1]:
        return None
    friction = np.column_stack([velocity, np.sign(velocity), np.ones(len(velocity))])
    columns = np.hstack([rigid, friction])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    alone = np.linalg.lstsq(friction, torque, rcond=None)[0]
    left, without = torque - columns @ solution, torque - friction @ alone
    if float(np.sum(left**2)) > _LOADED * float(np.sum(without**2)):
        return None
    return freeze(rigid @ solution[: rigid.shape[1]])


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
    check_joints(library, recordings)
    processing = choose_processing(processing, recordings[0].period)
    resting = tuple(map(list_resting_joints, recordings))
    if all(len(still) == library.card.size for still in resting):
        text = (
            "no joint moves beyond the noise of its encoder in any of these logs: friction shows where a "
            "joint turns both ways, slowly and fast; record that"
        )
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text))
    signals = tuple(
        hold_resting_joints(prepare_signals(recording, processing), still)
        for recording, still in zip(recordings, resting, strict=True)
    )
    return JointLogs(
        signals=signals,
        resting=resting,
        carried=tuple(_list_carried(library, entry) for entry in signals),
        sources=tuple(recording.source for recording in recordings),
        processing=processing,
    )


def _list_carried(library: Library, signals: Signals) -> tuple[int, ...]:
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
    chosen = logs.find_moving(joint) if runs is None else tuple(runs)
    if not chosen:
        text = f"joint {card.name!r} moves in none of these logs: nothing shows its friction"
        if any(joint in entry for entry in logs.carried):
            text = (
                f"joint {card.name!r} is only shaken by the motion of others, at less than "
                f"{100 * _CARRIED:g} % of their speed: there it sticks and slips, and no law of the speed "
                "shows; move it by itself"
            )
        raise IdentifiabilityError(Notice(code="friction.at-rest", text=text))
    parts = [logs.signals[k] for k in chosen]
    angle, acceleration, velocity, torque = (
        np.concatenate([getattr(part, name)[:, joint] for part in parts])
        for name in ("q", "ddq", "dq", "tau")
    )
    rigid = build_rigid_columns(library, parts, joint)
    others = _build_other_columns(library, parts, joint)
    if beta is not None:
        load: FloatArray | None = rigid.columns @ beta
        torque = torque - load
        sentence = "the rigid part was subtracted, with the base parameters given"
        fitted = others
    else:
        rigid, sentence = _reduce_columns(rigid, angle, acceleration, card)
        load = _estimate_load(rigid.columns, velocity, torque)
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
    if beta is None and len(rigid.names) > _MANY:
        text = (
            f"joint {card.name!r}: {len(rigid.names)} columns of a rigid part were fitted along, which can "
            "pass for friction; move one joint at a time, or identify the base parameters of all joints "
            "first and give them with --known"
        )
        notices += (Notice(code="friction.many-columns", text=text),)
    return ExtractedJoint(samples=samples, rigid=sentence, notices=notices)


def _leave_out_slow(
    samples: FrictionSamples, standstill: float
) -> tuple[FrictionSamples, tuple[Notice, ...]]:
    """Leave out rows slower than `standstill` in rad/s or m/s, and say how many."""
    rows = build_friction_rows(samples)
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
