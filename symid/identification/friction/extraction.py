"""From recordings to the friction torque of one joint: the measured torque without the rigid part.

    tau = Y_j(q, dq, ddq) beta + friction of others + tau_f(dq)

The rigid part is fitted with friction: the independent columns of Y_j on these motions, or J ddq + a sin q
+ b cos q where they span the same. Or it is subtracted, with known base parameters. Periods of a cosine
motion can be averaged first: the noise falls by sqrt(K), and filters see a signal without ends.

Supported: one moving joint or several; recordings at several poses; drives that turn with several joints,
whose friction is fitted along; any period of several samples (positions between samples by cubic splines,
torques, which jump, by straight lines).
Not supported: elastic joints; other joints' friction that is not linear in its parameters; an unknown
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
_DRIFT = 0.02
"""Scatter of the positions between periods, relative to their range, that is worth a warning."""


def fold_recording(recording: Recording, period: float, *, margin: int | None = None) -> Recording:
    """Return the mean over all whole periods (s), with `margin` samples of it repeated on either side.

    The default margin is a whole period. Raises LogError for less than two periods, a period of less than
    twenty samples, or a wrong period.
    """
    step = recording.period
    samples = round(period / step)
    # The last sample stands for the step behind it.
    periods = int((len(recording.time) * step + 1e-9 * period) // period)
    if samples < _LEAST_SAMPLES or periods < 2:
        text = (
            f"a period of {period:g} s has {samples} samples and fits {periods} times into the log; "
            f"averaging needs at least {_LEAST_SAMPLES} samples and 2 periods"
        )
        raise LogError(Notice(code="log.period", text=text, file=recording.source))
    position, torque = (
        _cut_periods(values, recording.time, period, (periods, samples), degree=degree)
        for values, degree in ((recording.position, 3), (recording.torque, 1))
    )
    margin = samples if margin is None else margin
    places = np.arange(-margin, samples + margin)
    text = f"{periods} periods of {period:g} s were averaged (--period)"
    folded = Notice(code="log.folded", text=text, file=recording.source)
    return replace(
        recording,
        time=recording.time[0] + np.arange(len(places)) * period / samples,
        position=position.mean(axis=0)[places % samples],
        torque=torque.mean(axis=0)[places % samples],
        velocity=None,
        motor_position=None,
        link_position=None,
        extras={},
        notices=(*recording.notices, folded, *_warn_of_drift(position, recording)),
    )


def _cut_periods(
    values: FloatArray, time: FloatArray, period: float, sizes: tuple[int, int], *, degree: int
) -> FloatArray:
    periods, samples = sizes
    wanted = samples * periods
    exact = periods * period / (time[1] - time[0])
    if abs(exact - wanted) < 1e-3 and wanted <= len(values):
        return values[:wanted].reshape(periods, samples, -1)
    from scipy.interpolate import make_interp_spline

    at = time[0] + np.arange(wanted) * period / samples
    spline = make_interp_spline(time, values, k=degree, axis=0)
    # Rounding may put the last place a hair behind the last sample.
    found: FloatArray = spline(np.minimum(at, time[-1]))
    return found.reshape(periods, samples, -1)


def _warn_of_drift(position: FloatArray, recording: Recording) -> tuple[Notice, ...]:
    """Return a notice where periods differ; raise LogError where their mean is no motion."""
    spread = np.ptp(position.mean(axis=0), axis=0)
    apart = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2, axis=(0, 1)))
    moving = spread > 0.0
    worst = float(np.max(apart[moving] / spread[moving], initial=0.0))
    # A joint that rests has no range that its noise could be compared with.
    if worst <= _DRIFT or float(np.max(apart)) <= _DRIFT * float(np.max(spread)):
        return ()
    text = (
        f"positions differ by {100.0 * worst:.3g} % of their range between periods: the period is wrong, "
        "or the motion drifts. Correct --period (one for each log where they differ), or leave it out"
    )
    notice = Notice(code="log.not-periodic", text=text, file=recording.source)
    # What rests has no period: the joint that moves most decides.
    if float(np.max(apart)) > 0.1 * float(np.max(spread)):
        raise LogError(notice)
    return (notice,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidColumns:
    """Columns (N, k) with the names and units of what multiplies them."""

    columns: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def build(cls, columns: FloatArray, entries: Iterable[tuple[str, str]]) -> "RigidColumns":
        """Return columns (N, k) with the name and unit of each."""
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
    """Return the columns of other joints' friction that acts on this one."""
    own, cards = library.card.joints[joint].name, library.card.friction
    index = [k for k, entry in enumerate(cards) if entry.joint != own]
    if not index:
        return RigidColumns.build(np.empty((sum(len(part.time) for part in parts), 0)), ())
    rows = np.vstack([library.evaluate("friction_regressor", part.dq)[0][:, joint] for part in parts])
    entries = ((cards[k].name, cards[k].unit) for k in index)
    return RigidColumns.build(rows[:, index], entries).keep_independent()


def _reduce_columns(
    rigid: RigidColumns, angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> tuple[RigidColumns, str]:
    """Return the independent columns (J ddq, a sin q, b cos q where they span the same) and a sentence."""
    independent = rigid.keep_independent()
    size = len(independent.names)
    inside = [
        entry
        for entry in list_physical_columns(angle, acceleration, card)
        if len(list_independent(np.column_stack([independent.columns, entry[1]]))) == size
    ]
    columns = np.column_stack([np.empty((len(angle), 0)), *(column for _, column, _ in inside)])
    if len(list_independent(columns)) == size:
        entries = ((name, unit) for name, _, unit in inside)
        independent = RigidColumns.build(columns, entries).keep_independent()
        sentence = " + ".join(_PHYSICAL[name] for name in independent.names)
        sentence = f"the rigid part {sentence} was fitted along"
    else:
        sentence = (
            f"a rigid part of {size} columns was fitted along; each stands for a group that these motions "
            "do not separate"
        )
    return independent, sentence if size else "no rigid part acts on this joint in these motions"


_PHYSICAL = {"J": "J ddq", "a": "a sin q", "b": "b cos q"}


def list_physical_columns(
    angle: FloatArray, acceleration: FloatArray, card: JointCard
) -> list[tuple[str, FloatArray, str]]:
    """Return (name, column (N,), unit) of inertia and weight of a joint that moves alone."""
    if card.kind == "prismatic":
        return [("J", acceleration, "kg")]
    return [("J", acceleration, "kg m^2"), ("a", np.sin(angle), "N m"), ("b", np.cos(angle), "N m")]


def list_independent(columns: FloatArray) -> list[int]:
    """Return which columns of (N, p) are linearly independent of those before them."""
    lengths = np.linalg.norm(columns, axis=0)
    basis, kept = list[FloatArray](), []
    least = 1e-10 * max(float(lengths.max(initial=0.0)), float(np.finfo(float).tiny))
    for k, length in enumerate(lengths):
        if length <= least:
            continue
        rest = columns[:, k] / length
        for _ in range(2):  # twice, against rounding
            for direction in basis:
                rest = rest - direction * (direction @ rest)
        size = float(np.linalg.norm(rest))
        if size > 1e-6:
            basis.append(rest / size)
            kept.append(k)
    return kept


def _estimate_load(rigid: FloatArray, velocity: FloatArray, torque: FloatArray) -> FloatArray | None:
    """Return the torque (N,) of the links, by a fit with plain friction; None where it is too small."""
    if not rigid.shape[1]:
        return None
    friction = np.column_stack([velocity, np.sign(velocity), np.ones(len(velocity))])
    columns = np.hstack([rigid, friction])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    alone = np.linalg.lstsq(friction, torque, rcond=None)[0]
    left, without = torque - columns @ solution, torque - friction @ alone
    if float(np.sum(left**2)) > 0.5 * float(np.sum(without**2)):
        return None
    return freeze(rigid @ solution[: rigid.shape[1]])


_CARRIED = 0.05
"""Peak speed relative to that of the fastest joint below which a joint is shaken by others."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointLogs:
    """Recordings as filtered states, one entry for each; velocities of `resting` joints are exactly zero.

    `carried` joints move only as others shake them.
    """

    signals: tuple[Signals, ...]
    resting: tuple[tuple[int, ...], ...]
    carried: tuple[tuple[int, ...], ...]
    sources: tuple[str, ...]
    processing: Processing

    def list_moving(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move a joint."""
        held = enumerate(zip(self.resting, self.carried, strict=True))
        return tuple(k for k, (resting, carried) in held if joint not in (*resting, *carried))

    def list_alone(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move this joint and no other."""
        others = self.signals[0].q.shape[1] - 1
        moving = self.list_moving(joint)
        return tuple(k for k in moving if len((*self.resting[k], *self.carried[k])) == others)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExtractedJoint:
    """Samples of one joint, how the rigid part was treated (a sentence), and notices of rows left out."""

    samples: FrictionSamples
    rigid: str
    notices: tuple[Notice, ...]


def prepare_joint_logs(
    library: Library, recordings: Sequence[Recording], processing: Processing
) -> JointLogs:
    """Return the recordings filtered and differentiated.

    Raises LogError where one does not fit the robot, IdentifiabilityError where no joint moves.
    """
    check_joints(library, recordings)
    processing = choose_processing(processing, recordings[0].period)
    resting = tuple(map(list_resting_joints, recordings))
    if all(len(still) == library.card.size for still in resting):
        text = (
            "no joint moves beyond the noise of its encoder in any of these logs: record joints that turn "
            "both ways, slowly and fast"
        )
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text))
    pairs = zip(recordings, resting, strict=True)
    signals = tuple(hold_resting_joints(prepare_signals(one, processing), still) for one, still in pairs)
    kinds = np.array([joint.kind == "prismatic" for joint in library.card.joints])
    carried = []
    for entry in signals:
        peaks = np.max(np.abs(entry.dq), axis=0)
        # Relative to the fastest joint of the same kind.
        fastest = np.array([np.max(peaks[kinds == kind]) for kind in kinds])
        moved = (peaks > 0.0) & (peaks < _CARRIED * fastest)
        carried.append(tuple(np.flatnonzero(moved).tolist()))
    return JointLogs(
        signals=signals,
        resting=resting,
        carried=tuple(carried),
        sources=tuple(recording.source for recording in recordings),
        processing=processing,
    )


def extract_joint(
    library: Library,
    logs: JointLogs,
    joint: int,
    *,
    runs: Sequence[int] | None = None,
    beta: FloatArray | None = None,
) -> ExtractedJoint:
    """Return the samples of a joint (its number) in `runs`, by default the recordings that move it.

    `beta` (p,) are base parameters that are known; None to fit the rigid part.

    Raises:
        IdentifiabilityError: no recording moves the joint, or no row is left.
    """
    card = library.card.joints[joint]
    chosen = logs.list_moving(joint) if runs is None else tuple(runs)
    if not chosen:
        text = f"joint {card.name!r} moves in none of these logs: its friction is not identifiable"
        if any(joint in entry for entry in logs.carried):
            text = (
                f"joint {card.name!r} is only shaken by other joints, below {100 * _CARRIED:g} % of their "
                "speed, and sticks and slips: move it by itself"
            )
        raise IdentifiabilityError(Notice(code="friction.at-rest", text=text))
    parts = [logs.signals[k] for k in chosen]
    rigid, fitted = build_rigid_columns(library, parts, joint), _build_other_columns(library, parts, joint)
    plain = build_joint_samples(library, logs, joint, chosen, fitted)
    if beta is not None:
        load: FloatArray | None = rigid.columns @ beta
        samples = replace(plain, torque=plain.torque - rigid.columns @ beta, load=load)
        sentence = "the rigid part was subtracted, with the base parameters given"
    else:
        acceleration = np.concatenate([part.ddq[:, joint] for part in parts])
        rigid, sentence = _reduce_columns(rigid, np.asarray(plain.position), acceleration, card)
        samples = replace(
            plain,
            extra=np.hstack([rigid.columns, fitted.columns]),
            extra_names=rigid.names + fitted.names,
            extra_units=rigid.units + fitted.units,
            load=_estimate_load(rigid.columns, plain.velocity, plain.torque),
        )
    samples, notices = _leave_out_slow(samples, logs.processing.standstill)
    if beta is None and len(rigid.names) > 6:
        text = (
            f"joint {card.name!r}: {len(rigid.names)} columns of the rigid part were fitted along, which "
            "can bias friction. Move one joint at a time, or give the base parameters of all joints with "
            "--known"
        )
        notices += (Notice(code="friction.many-columns", text=text),)
    return ExtractedJoint(samples=samples, rigid=sentence, notices=notices)


def build_joint_samples(
    library: Library, logs: JointLogs, joint: int, runs: Sequence[int], columns: RigidColumns
) -> FrictionSamples:
    """Return the samples of a joint in some recordings, with columns beside friction and the whole torque."""
    parts, card = [logs.signals[k] for k in runs], library.card.joints[joint]
    velocity, torque, position = (
        np.concatenate([getattr(part, name)[:, joint] for part in parts]) for name in ("dq", "tau", "q")
    )
    return FrictionSamples(
        joint=card.name,
        time=np.concatenate([part.time for part in parts]),
        velocity=velocity,
        torque=torque,
        extra=columns.columns,
        extra_names=columns.names,
        extra_units=columns.units,
        position=position,
        run=np.repeat(runs, [len(part.time) for part in parts]),
        reduce=build_reduction([len(part.time) for part in parts], logs.processing.decimation),
        prismatic=card.kind == "prismatic",
    )


def _leave_out_slow(
    samples: FrictionSamples, standstill: float
) -> tuple[FrictionSamples, tuple[Notice, ...]]:
    rows = build_friction_rows(samples)
    slow = np.abs(rows.velocity) < standstill
    if not slow.any():
        return samples, ()
    if slow.all():
        text = (
            f"joint {samples.joint!r}: every row is slower than processing.standstill = {standstill:g}; "
            "keep them with --set processing.standstill=0"
        )
        raise IdentifiabilityError(Notice(code="friction.all-slow", text=text))
    text = (
        f"joint {samples.joint!r}: {int(slow.sum())} of {len(slow)} rows slower than {standstill:g} "
        f"{'m/s' if samples.prismatic else 'rad/s'} were left out (processing.standstill), below which "
        "friction is extrapolated. If no joint sticks, keep them with --set processing.standstill=0"
    )
    return select_friction_rows(samples, ~slow), (Notice(code="identify.slow-rows", text=text),)
