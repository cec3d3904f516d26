"""From recordings to the friction torque of one joint: the measured torque without the rigid part.

    tau = Y_j(q, dq, ddq) beta + friction of others + tau_f(dq)
    tau - load = IA ddq + friction of others + tau_f(dq, load)         where the load was measured

The rigid part is fitted with friction, the independent columns of Y_j on these motions, or J ddq + a sin q
+ b cos q where they span the same; or it is subtracted, with known base parameters. Periods of a cosine
motion can be averaged first: the noise falls by sqrt(K), and filters see a signal without ends.

What the processing leaves open is chosen from the logs. A bend of a law turns noise of the velocity into a
bias: positions of every joint pass a low-pass at the end of its clean band (`measure_bands`), at the rule's
cut-off at most. Ends of logs in motion are left out, two periods of the lowest cut-off.

Supported: one moving joint or several; several poses; drives that turn with several joints.
Not supported: elastic joints; other joints' friction that is not linear in its parameters; an unknown
period; motions that drift (positions that differ by more than a tenth of their range are refused).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ParameterCard
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.identification import regression
from symid.identification.friction.joint_fit import FrictionSamples, build_reduction
from symid.identification.judge import POLICY, numerics
from symid.logs import Recording, Signals, choose_processing, mask_decimated, mask_states, prepare_signals
from symid.robot import Processing


def fold_recording(recording: Recording, period: float, *, margin: int) -> Recording:
    """Return the mean over all whole periods (s), with `margin` samples of it repeated on either side.

    Raises LogError for less than two periods, a period of few samples, or a wrong period.
    """
    samples = round(period / recording.period)
    # The last sample stands for the step behind it.
    periods = int((len(recording.time) * recording.period + 1e-9 * period) // period)
    # Rows reach up to a part of the sample rate, the period as well.
    least = round(1.0 / POLICY.row_band)
    if samples < least or periods < 2:
        text = f"a period of {period:g} s has {samples} samples and fits {periods} times into the log; "
        text += f"averaging needs at least {least} samples and 2 periods"
        raise LogError(Notice(code="log.period", text=text, file=recording.source))
    # Torques jump: between samples they follow straight lines, positions cubic splines.
    time, wanted = recording.time, samples * periods
    exact = periods * period / (time[1] - time[0])

    def cut(values: FloatArray, *, degree: int) -> FloatArray:
        found = values[:wanted]
        if abs(exact - wanted) >= 1e-3 or wanted > len(values):
            at = time[0] + np.arange(wanted) * period / samples
            # Rounding may put the last place a hair behind the last sample.
            spline = scipy.interpolate.make_interp_spline(time, values, k=degree, axis=0)
            found = spline(np.minimum(at, time[-1]))
        return found.reshape(periods, samples, -1)

    position, places = cut(recording.position, degree=3), np.arange(-margin, samples + margin)
    names = ("torque", "load", "temperature")
    known = {name: values for name in names if (values := getattr(recording, name)) is not None}
    bad = None if recording.bad is None else np.any(cut(recording.bad.astype(float), degree=1), axis=0)
    text = f"{periods} periods of {period:g} s were averaged (--period)"
    notices = [Notice(code="log.folded", text=text, file=recording.source)]
    spread = np.ptp(position.mean(axis=0), axis=0)
    apart = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2, axis=(0, 1)))
    moving = spread > 0.0
    worst = float(np.max(apart[moving] / spread[moving], initial=0.0))
    # A joint that rests has no range that its noise could be compared with.
    most = 100.0 * float(np.max(apart)) / max(float(np.max(spread)), numerics.TINY)
    if worst > POLICY.relevance and most > 100.0 * POLICY.relevance:
        text = f"positions differ by {100.0 * worst:.3g} % of their range between periods: the period is "
        text += "wrong, or the motion drifts. Correct --period (one for each log where they differ), or "
        text += "leave it out"
        notices.append(Notice(code="log.not-periodic", text=text, file=recording.source))
        # What rests has no period, and the mean of periods that differ is no motion: the joint that moves
        # most decides.
        if most > POLICY.good:
            raise LogError(notices[-1])
    columns = {name: cut(values, degree=1).mean(axis=0)[places % samples] for name, values in known.items()}
    return replace(
        recording,
        time=recording.time[0] + np.arange(len(places)) * period / samples,
        position=position.mean(axis=0)[places % samples],
        bad=None if bad is None else bad[places % samples],
        velocity=None,
        acceleration=None,
        motor_position=None,
        link_position=None,
        extras={},
        notices=(*recording.notices, *notices),
        **columns,
    )


Inputs = tuple[FloatArray, ...]


class Column(NamedTuple):
    """A column (N,) of a joint's torque, with the name and unit of what multiplies it."""

    name: str
    values: FloatArray
    unit: str


def _condense(columns: Sequence[FloatArray]) -> FloatArray:
    """Return the triangle (p, p) of columns (N,), which has their lengths and angles."""
    starts = range(0, len(columns[0]), numerics.BLOCK)
    blocks = (np.column_stack([one[start : start + numerics.BLOCK] for one in columns]) for start in starts)
    return regression.extend_triangle(np.zeros((0, len(columns))), blocks)


def _keep_independent(columns: list[Column]) -> list[Column]:
    kept = list_independent(_condense([one.values for one in columns])) if columns else []
    return [columns[k] for k in kept]


def list_independent(columns: FloatArray) -> list[int]:
    """Return which columns of (N, p) are linearly independent of those before them."""
    lengths = np.linalg.norm(columns, axis=0)
    basis, kept = np.empty((len(columns), 0)), []
    least = numerics.RANK * max(float(lengths.max(initial=0.0)), numerics.TINY)
    for k in np.flatnonzero(lengths > least).tolist():
        rest = columns[:, k] / lengths[k]
        for _ in range(2):  # twice, against rounding
            rest = rest - basis @ (basis.T @ rest)
        if (size := float(np.linalg.norm(rest))) > numerics.CONVERGED:
            basis = np.column_stack([basis, rest / size])
            kept.append(k)
    return kept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointLogs:
    """Recordings as filtered states: `resting` joints have no velocity, others shake `carried` ones.

    `cutoffs` are those that noise set, in Hz, joint by joint of every recording; empty where none did.
    Torques of joints that are `measured` are those of motors less the load behind the gears; `rotors` are
    those of coupled drives.
    """

    library: Library
    signals: tuple[Signals, ...]
    resting: tuple[tuple[int, ...], ...]
    carried: tuple[tuple[int, ...], ...]
    sources: tuple[str, ...]
    processing: Processing
    cutoffs: tuple[tuple[float, ...], ...] = ()
    measured: tuple[bool, ...] = ()
    rotors: tuple[regression.Rotor, ...] = ()

    def list_moving(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move a joint."""
        held = enumerate(zip(self.resting, self.carried, strict=True))
        return tuple(k for k, (resting, carried) in held if joint not in (*resting, *carried))

    def list_alone(self, joint: int) -> tuple[int, ...]:
        """Return which recordings move this joint and no other."""
        others = self.signals[0].q.shape[1] - 1
        moving = self.list_moving(joint)
        return tuple(k for k in moving if len((*self.resting[k], *self.carried[k])) == others)

    def gather(self, name: str, joint: int, runs: Sequence[int]) -> FloatArray:
        """Return "q", "dq", "ddq" or "tau" of a joint in some recordings: (N,)."""
        return np.concatenate([getattr(self.signals[k], name)[:, joint] for k in runs])

    def gather_known(self, name: str, joint: int, runs: Sequence[int]) -> FloatArray | None:
        """Return "load" or "temperature" of a joint likewise; None where a recording lacks it."""
        if any(getattr(self.signals[k], name) is None for k in runs):
            return None
        return self.gather(name, joint, runs)

    def mask_bad(self, joint: int, runs: Sequence[int]) -> NDArray[np.bool_]:
        """Return the decimated rows (M,) of a joint in which wrong samples of recordings are noticed."""
        parts = (self.signals[k] for k in runs)
        masks = (np.zeros(one.q.shape, dtype=np.bool_) if one.bad is None else one.bad for one in parts)
        return np.concatenate([mask_decimated(bad, self.processing.decimation)[:, joint] for bad in masks])

    def is_measured(self, joint: int) -> bool:
        """Return whether the load of a joint was measured and is not part of its torque here."""
        return bool(self.measured) and self.measured[joint]

    def list_rigid_columns(self, joint: int, runs: Sequence[int]) -> list[Column]:
        """Return the joint's row of the torque regressor."""
        states = [(part.q, part.dq, part.ddq) for part in (self.signals[k] for k in runs)]
        return self._evaluate_columns("torque_regressor", self.library.card.beta, states, joint)

    def list_friction_columns(self, joint: int, runs: Sequence[int]) -> list[Column]:
        """Return the columns of the friction of all joints that acts on this one."""
        card, states = self.library.card, []
        if not (cards := card.friction):
            return []
        for part in (self.signals[k] for k in runs):
            given = {"q": part.q, "load": part.load, "temperature": part.temperature}
            if all(entry.joint in {one.name for one in card.joints} for entry in cards):
                # Joints' own friction is that of the laws to be found: what it reads may be unknown.
                given = {name: part.dq * 0.0 if one is None else one for name, one in given.items()}
            states.append(card.gather_friction_inputs(part.dq, **given))
        return self._evaluate_columns("friction_regressor", cards, states, joint)

    def _evaluate_columns(
        self, function: str, cards: Sequence[ParameterCard], states: Sequence[Inputs], joint: int
    ) -> list[Column]:
        """Return the joint's columns of a regressor, by pieces that stay in the cache."""
        rows = []
        for run in states:
            for start in range(0, len(run[0]), numerics.BLOCK):
                piece = (values[start : start + numerics.BLOCK] for values in run)
                # A copy: one row in n is kept.
                rows.append(self.library.evaluate(function, *piece)[0][:, joint].copy())
        columns = np.vstack(rows).T
        return [Column(entry.name, values, entry.unit) for entry, values in zip(cards, columns, strict=True)]

    def list_physical_columns(self, joint: int, runs: Sequence[int]) -> list[Column]:
        """Return inertia and weight of a joint that moves alone."""
        angle, acceleration = (self.gather(name, joint, runs) for name in ("q", "ddq"))
        if self.library.card.joints[joint].kind == "prismatic":
            return [Column("J", acceleration, "kg")]
        weight = [Column("a", np.sin(angle), "N m"), Column("b", np.cos(angle), "N m")]
        return [Column("J", acceleration, "kg m^2"), *weight]

    def list_rotor_columns(self, joint: int, runs: Sequence[int]) -> list[Column]:
        """Return the inertia of a joint's own rotor, and of the coupled rotors that turn with it."""
        ddq = np.concatenate([self.signals[k].ddq for k in runs])
        rows = regression.compute_rotor_columns(ddq, self.rotors)[:, joint]
        unit = "kg" if self.library.card.joints[joint].kind == "prismatic" else "kg m^2"
        coupled = [(k, one) for k, one in enumerate(self.rotors, start=ddq.shape[1]) if one.turns[joint]]
        own = Column(ROTOR, rows[:, joint], unit)
        return [own, *(Column(one.name, rows[:, k], unit) for k, one in coupled)]

    def build_samples(self, joint: int, runs: Sequence[int], columns: Sequence[Column]) -> FrictionSamples:
        """Return a joint's samples in some recordings: the whole torque, and columns beside friction."""
        velocity, torque, position = (self.gather(name, joint, runs) for name in ("dq", "tau", "q"))
        card, times = self.library.card.joints[joint], [self.signals[k].time for k in runs]
        lengths = list(map(len, times))
        return FrictionSamples(
            joint=card.name,
            time=np.concatenate(times),
            velocity=velocity,
            torque=torque,
            extra=np.column_stack([np.empty((len(velocity), 0)), *(column.values for column in columns)]),
            extra_names=tuple(column.name for column in columns),
            extra_units=tuple(column.unit for column in columns),
            load=self.gather_known("load", joint, runs) if self.is_measured(joint) else None,
            position=position,
            temperature=self.gather_known("temperature", joint, runs),
            run=np.repeat(runs, lengths),
            reduce=build_reduction(lengths, self.processing.decimation),
            prismatic=card.kind == "prismatic",
        )


ROTOR = "IA"
"""Name of the inertia of a joint's own rotor, on the side of the joint."""
PHYSICAL = {"J": "J ddq", "a": "a sin q", "b": "b cos q"}
SLOW = "identify.slow-rows"


class ExtractedJoint(NamedTuple):
    """Samples of one joint, how the rigid part was treated (a sentence), and notices of rows left out.

    `samples` are the rows `kept` (m,) of `whole`, which has the slow ones too, and those that are `bad` (m,).
    """

    samples: FrictionSamples
    whole: FrictionSamples
    kept: NDArray[np.bool_]
    bad: NDArray[np.bool_]
    rigid: str
    notices: tuple[Notice, ...]

    @property
    def all_rows(self) -> FrictionSamples:
        """Return the samples with slow rows."""
        return self.whole.select_rows(~self.bad) if self.bad.any() else self.whole


def describe_cutoffs(logs: JointLogs) -> tuple[Notice, ...]:
    """Return a notice on the cut-offs that noise set, log by log."""
    joints, found = [card.name for card in logs.library.card.joints], []
    for source, cutoffs, resting in zip(logs.sources, logs.cutoffs, logs.resting, strict=False):
        listed = ", ".join(f"{joints[k]} {cut:g}" for k, cut in enumerate(cutoffs) if k not in resting)
        text = f"positions pass a low-pass where their noise takes over (Hz): {listed}; more noise of the "
        text += "velocity would bend the laws. To set one for all, state filter_cutoff under [processing]"
        found.append(Notice(code="identify.automatic", text=text, file=source))
    return tuple(found)


def _prepare_at_cutoffs(recording: Recording, processing: Processing, cutoffs: FloatArray) -> Signals:
    """Return the states of a recording, each joint's behind its own cut-off (n,) in Hz."""
    lowest = replace(processing, filter_cutoff=float(np.min(cutoffs)))
    # Of a short log not much is left out.
    most = len(recording.time) // 20
    first, last = (min(spoilt, most) for spoilt in regression.measure_moving_ends(lowest, [recording]))
    first, last = max(first, processing.drop_first), max(last, processing.drop_last)
    cut = replace(processing, drop_first=first, drop_last=last)
    found = {one: prepare_signals(recording, replace(cut, filter_cutoff=float(one))) for one in cutoffs}

    def gather(name: str) -> FloatArray:
        return np.column_stack([getattr(found[one], name)[:, k] for k, one in enumerate(cutoffs)])

    states = found[cutoffs[0]]
    return replace(states, q=gather("q"), dq=gather("dq"), ddq=gather("ddq"), tau=gather("tau"))


def prepare_joint_logs(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    measured: Sequence[bool] = (),
    rotors: Sequence[regression.Rotor] = (),
) -> JointLogs:
    """Return the recordings filtered and differentiated; what `processing` leaves open is chosen.

    Torques of joints `measured` (n,) are taken less their loads, and `rotors` of coupled drives then stand
    beside friction. Raises LogError for another robot, IdentifiabilityError where no joint moves.
    """
    regression.check_joints(library, recordings)
    recordings = [regression.subtract_loads(recording, measured) for recording in recordings]
    is_open = processing.automatic and processing.filter_cutoff is None
    processing = choose_processing(processing, recordings[0].period)
    recordings = [replace(one, bad=mask_states(one, processing)) for one in recordings]
    resting = tuple(map(regression.list_resting_joints, recordings))
    if all(len(still) == library.card.size for still in resting):
        text = "no joint moves beyond the noise of its encoder in any of these logs: record joints that turn "
        text += "both ways, slowly and fast"
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text))
    cutoffs = list[FloatArray]()
    if is_open:
        # Where noise takes over, beyond the band of the motion, at most that of the rule.
        rule, least = processing.filter_cutoff or 0.0, regression.measure_scoring_band(recordings)
        for one, still in zip(recordings, resting, strict=True):
            wanted = [min(max(band.clean, least), rule) for band in regression.measure_bands(one)]
            found = (rule if k in still else float(f"{cut:.3g}") for k, cut in enumerate(wanted))
            cutoffs.append(np.array(list(found)))
        states = list(map(_prepare_at_cutoffs, recordings, [processing] * len(recordings), cutoffs))
        if any(np.any(entry < rule) for entry in cutoffs):
            # Noise decides, and that of another log may be another one.
            processing = replace(processing, filter_cutoff=None, automatic=True)
    else:
        states = [prepare_signals(one, processing) for one in recordings]
    signals = tuple(map(regression.hold_resting_joints, states, resting))
    kinds = np.array([joint.kind == "prismatic" for joint in library.card.joints])
    carried = []
    for peaks in (np.max(np.abs(entry.dq), axis=0) for entry in signals):
        # Relative to the fastest joint of the same kind.
        fastest = np.array([np.max(peaks[kinds == kind]) for kind in kinds])
        moved = (peaks > 0.0) & (peaks < POLICY.relevance * fastest)
        carried.append(tuple(np.flatnonzero(moved).tolist()))
    return JointLogs(
        library=library,
        signals=signals,
        resting=resting,
        carried=tuple(carried),
        sources=tuple(recording.source for recording in recordings),
        processing=processing,
        cutoffs=tuple(tuple(entry.tolist()) for entry in cutoffs) if processing.automatic else (),
        measured=tuple(measured),
        rotors=tuple(rotors),
    )


def extract_joint(
    logs: JointLogs, joint: int, *, runs: Sequence[int] | None = None, beta: FloatArray | None = None
) -> ExtractedJoint:
    """Return a joint's samples in `runs`, by default the recordings that move it, as `identify_friction`."""
    card = logs.library.card.joints[joint]
    chosen = logs.list_moving(joint) if runs is None else tuple(runs)
    if not chosen:
        text = f"joint {card.name!r} moves in none of these logs: its friction is not identifiable"
        if any(joint in entry for entry in logs.carried):
            text = f"joint {card.name!r} is only shaken by other joints, below {100 * POLICY.relevance:g} % "
            text += "of their speed, and sticks and slips: move it by itself"
        raise IdentifiabilityError(Notice(code="friction.at-rest", text=text))
    samples, sentence, count = _treat_rigid(logs, joint, chosen, beta)
    standstill, notices = logs.processing.get_standstill(joint), list[Notice]()
    kept = ~(np.abs(samples.rows.velocity) < standstill)
    if not kept.any():
        text = f"joint {samples.joint!r}: every sample is slower than processing.standstill = "
        text += f"{standstill:g}; keep them with --set processing.standstill=0"
        raise IdentifiabilityError(Notice(code="friction.all-slow", text=text))
    if not kept.all():
        text = f"joint {samples.joint!r}: {int((~kept).sum())} of {len(kept)} samples slower than "
        text += f"{standstill:g} {'m/s' if samples.prismatic else 'rad/s'} were left out "
        text += "(processing.standstill), below which friction is extrapolated. If no joint sticks, keep "
        text += "them with --set processing.standstill=0"
        notices.append(Notice(code=SLOW, text=text))
    if count > 6:
        text = f"joint {card.name!r}: {count} columns of the rigid part were fitted jointly, which can bias "
        text += "friction. Move one joint at a time, or give the base parameters of all joints with --known"
        notices.append(Notice(code="friction.many-columns", text=text))
    bad = logs.mask_bad(joint, chosen)
    if bad.any():
        kept &= ~bad
        notices.append(regression.warn_of_bad(samples.joint, bad))
    left = samples if kept.all() else samples.select_rows(kept)
    return ExtractedJoint(
        samples=left, whole=samples, kept=kept, bad=bad, rigid=sentence, notices=tuple(notices)
    )


def _treat_rigid(
    logs: JointLogs, joint: int, runs: Sequence[int], beta: FloatArray | None
) -> tuple[FrictionSamples, str, int]:
    """Return a joint's samples, how the rigid part was treated, and how many of its columns are fitted."""
    card = logs.library.card
    own = {entry.name for entry in card.friction if entry.joint == card.joints[joint].name}
    others = [column for column in logs.list_friction_columns(joint, runs) if column.name not in own]
    fitted = _keep_independent(others)
    if logs.is_measured(joint):
        rotors = _keep_independent(logs.list_rotor_columns(joint, runs))
        samples = logs.build_samples(joint, runs, [*rotors, *fitted])
        along = f"; {' and '.join(one.name for one in rotors)} of the rotor was fitted jointly"
        return samples, f"the measured load was subtracted{along if rotors else ''}", 0
    rigid = logs.list_rigid_columns(joint, runs)
    if beta is not None:
        samples = logs.build_samples(joint, runs, fitted)
        known = np.column_stack([column.values for column in rigid]) @ beta
        samples = replace(samples, torque=samples.torque - known, load=known)
        return samples, "the rigid part was subtracted, with the base parameters given", 0
    # Independent columns: J ddq, a sin q, b cos q, of a joint that moves alone, where they span the same.
    every, count = [*rigid, *logs.list_physical_columns(joint, runs)], len(rigid)
    triangle = _condense([one.values for one in every])
    chosen = list_independent(triangle[:, :count])
    sentence = "no rigid part acts on this joint in these motions"
    if chosen:
        sentence = f"a rigid part of {len(chosen)} columns was fitted jointly; each stands for a group that "
        sentence += "these motions do not separate"
    ranks = {k: len(list_independent(triangle[:, [*chosen, k]])) for k in range(count, len(every))}
    among = [k for k, rank in ranks.items() if rank == len(chosen)]
    physical = [among[k] for k in list_independent(triangle[:, among])]
    if chosen and len(physical) == len(chosen):
        chosen = physical
        sentence = f"the rigid part {' + '.join(PHYSICAL[every[k].name] for k in chosen)} was fitted jointly"
    rigid = [every[k] for k in chosen]
    samples = logs.build_samples(joint, runs, [*rigid, *fitted])
    if not (size := len(rigid)):
        return replace(samples, load=None), sentence, 0
    # The torque of the links, by a fit with plain friction; none where it is too small.
    velocity, torque, load = samples.velocity, samples.torque, None
    plain = [velocity, np.sign(velocity), np.ones(len(velocity)), torque]
    triangle = _condense([*samples.extra[:, :size].T, *plain])
    columns, target, rounding = triangle[:, :-1], triangle[:, -1], float(np.finfo(float).eps) * len(torque)
    solution = np.linalg.lstsq(columns, target, rcond=rounding)[0]
    alone = np.linalg.lstsq(columns[:, size:], target, rcond=rounding)[0]
    left, without = target - columns @ solution, target - columns[:, size:] @ alone
    if float(np.sum(left**2)) <= 0.5 * float(np.sum(without**2)):
        load = np.asarray(samples.extra[:, :size] @ solution[:size])
    return replace(samples, load=load), sentence, size
