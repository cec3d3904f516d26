"""A stored result and logs: validation on one that it was not fitted to, diagnosis by its own.

Robot, fit, log, settings -> `FitValidation`;  robot, estimate -> `Diagnosis`.

Nothing is fitted in a validation; filter and friction are those of the identification, unless the call
states others. For a diagnosis the logs of the fit are read again with the settings of the fit and of each
run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from symid.codegen import Library
from symid.errors import LogError, Notice, UsageError
from symid.excitation import Trajectory, build_trajectory
from symid.identification.diagnostics import (
    BandResidual,
    compute_band_residual,
    predict_torques,
    warn_of_fitted_log,
)
from symid.identification.elastic import (
    ElasticEstimate,
    ElasticTrial,
    TrackingRun,
    build_motor_recording,
    build_rigid_estimate,
    build_rigid_variant,
    check_settings,
    cut_logs,
    evaluate_elastic,
    get_asked_cutoff,
    get_encoder_positions,
    prepare_aligned,
    simulate_tracking,
)
from symid.identification.estimators import (
    Estimate,
    Residual,
    ResolvedProcessing,
    Validation,
    check_model,
    check_robot,
    compute_mean_relative,
)
from symid.identification.friction import (
    FrictionIdentification,
    set_identified_friction,
    validate_friction,
)
from symid.identification.identify import TaskContext
from symid.identification.rigid import (
    Diagnosis,
    diagnose_estimate,
    resolve_processing,
    restore_robot,
    validate_estimate,
)
from symid.identification.stored import StoredResult
from symid.logs import IN_MEMORY_PREFIX, Alignment, Recording, read_one_log, read_recorded_runs
from symid.robot import Robot
from symid.serialization import compute_file_digest
from symid.simulation import build_noisy_options, check_stated_values

_BEYOND = 1.05
"""Part of the torsion seen in the fit up to which a spring counts as known."""

_TC_JOINTS, _SEED = 2, 1
"""Joints that the motion for validation has, and the seed of the random one for other robots."""

Pairs = Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitValidation:
    """What a fit explains of a log, whatever its kind.

    Args:
        robot: as it was identified, elastic joints included.
        source: the log.
        tables: what is left, joint by joint, under captions where there are several; the first is the one
            that counts.
        notices: what a reader should know.
    """

    robot: Robot
    source: str
    tables: tuple[tuple[str, tuple[Residual, ...]], ...]
    notices: tuple[Notice, ...]

    @property
    def residual(self) -> tuple[Residual, ...]:
        """Return what is left, joint by joint."""
        return self.tables[0][1]

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return compute_mean_relative(self.residual)

    def find_missed(self, gate: float | None) -> tuple[Notice, ...]:
        """Return which tables miss a gate in percent; nothing where none does, or there is no gate."""
        notices = []
        for caption, residual in self.tables:
            reached = compute_mean_relative(residual)
            if gate is not None and not reached <= gate:
                text = f"mean relative residual {reached:.4f} %, the gate is {gate:g} %"
                told = f"{caption.rstrip('.')}: {text}" if caption else text
                notices.append(Notice(code="validate.gate-missed", text=told, file=self.source))
        return tuple(notices)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidValidation(FitValidation):
    """The same of base parameters.

    Args:
        validation: residuals and series; settled: how the log was processed.
        band: what is left below a frequency at the full rate; None where not asked for.
    """

    validation: Validation
    settled: ResolvedProcessing
    band: BandResidual | None = None


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionValidation(FitValidation):
    """The same of laws of friction with the rigid part; `laws` by joint."""

    validation: Validation
    laws: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingComparison:
    """Closed loops along one trajectory, the first of rigid joints, and the methods of the others."""

    trajectory: Trajectory
    runs: tuple[TrackingRun, ...]
    methods: Mapping[str, str]
    seed: int | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingTask:
    """A motion to simulate with feed-forward of the estimate.

    Args:
        trajectory: which; seed: of a random one, None for another.
        against: further estimates to compare with, by where they come from.
    """

    trajectory: Trajectory
    seed: int | None = None
    against: tuple[tuple[str, ElasticEstimate], ...] = ()


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticValidation(FitValidation):
    """The same of elastic joints, by motors, links and springs, and how links follow with the estimate.

    Args:
        estimate: which; trial: torques by motors, links and springs.
        alignment: delay and offsets of the log's encoders, None where not looked for.
        tracking: None where not asked for.
    """

    estimate: ElasticEstimate
    trial: ElasticTrial
    alignment: Alignment | None = None
    tracking: TrackingComparison | None = None


AnyValidation = RigidValidation | ElasticValidation | FrictionValidation
"""What a fit of any kind explains of a log."""


def validate_fit(
    robot: Robot,
    fit: StoredResult,
    log: Path | Recording,
    workshop: TaskContext,
    *,
    pairs: Pairs = (),
    band: float | None = None,
    tracking: TrackingTask | None = None,
    file: str = "",
) -> AnyValidation:
    """Return what a fit of any kind explains of a log; nothing is fitted.

    A robot that was identified as rigid is tried as rigid. For elastic joints, delay and offsets of the log's
    link encoders are taken out first, as in an identification.

    Args:
        robot: as read.
        fit: of its dynamics, or of its friction.
        log: a file, or what was read from one.
        workshop: library and progress.
        pairs: settings of the call, keys and values.
        band: Hz below which torques are compared at the full rate, None for the rows of the fit; of rigid
            fits.
        tracking: a motion to simulate, None for none; of elastic fits: the robot file must state the true
            values then.
        file: of the fit, for messages.

    Raises:
        UsageError: a setting has no meaning here; an estimate lacks springs, which a feed-forward needs.
        EstimateError: a fit is of another model.
        LogError: the log lacks an encoder, or does not fit the robot.
        IdentifiabilityError: no joint moves in it, or nothing can be said of any.
        RobotError: the robot file lacks values to simulate with.
    """
    match fit:
        case Estimate():
            return _validate_rigid(robot, fit, log, workshop, pairs=pairs, band=band, file=file)
        case ElasticEstimate():
            return _validate_elastic(robot, fit, log, workshop, pairs=pairs, tracking=tracking, file=file)
    return _validate_friction(robot, fit, log, workshop, pairs=pairs, file=file)


def _validate_rigid(
    robot: Robot,
    estimate: Estimate,
    log: Path | Recording,
    workshop: TaskContext,
    *,
    pairs: Pairs,
    band: float | None,
    file: str,
) -> RigidValidation:
    described = restore_robot(robot, estimate, pairs)
    found = build_rigid_estimate(estimate, described)
    recording = build_motor_recording(read_one_log(log, described), described)
    library = workshop.prepare(build_rigid_variant(described))
    check_model(found, library.card, file)
    workshop.progress(f"validating on {recording.source}")
    settled = resolve_processing(found, described.processing, recording)
    validation = validate_estimate(found, library, recording, described.processing)
    within = None
    if band is not None:
        names = [entry.name for entry in (*library.card.beta, *library.card.friction)]
        values = found.assemble(names)
        within = compute_band_residual(
            predict_torques(values, library, recording, settled.processing, band=band)
        )
    return RigidValidation(
        robot=described,
        source=validation.source,
        tables=(("", validation.residual if within is None else within.joints),),
        notices=(*described.notices, *library.notices, *recording.notices, *validation.notices),
        validation=validation,
        settled=settled,
        band=within,
    )


def _validate_elastic(
    robot: Robot,
    estimate: ElasticEstimate,
    log: Path | Recording,
    workshop: TaskContext,
    *,
    pairs: Pairs,
    tracking: TrackingTask | None,
    file: str,
) -> ElasticValidation:
    check_settings(pairs, "elastic")
    described = restore_robot(robot, estimate, pairs)
    (recording,) = cut_logs((read_one_log(log, described, "an elastic robot"),), described.processing)
    # A log with one position is refused before minutes go into a library.
    get_encoder_positions(recording)
    if tracking is not None:
        check_stated_values(described)
    library = workshop.prepare(described)
    check_model(estimate, library.card, file)
    cases = {} if tracking is None else _list_cases(estimate, tracking, library, file)
    (moved,), alignment, told = prepare_aligned(library, (recording,))
    workshop.progress(f"validating on {recording.source}")
    trial = evaluate_elastic(estimate, library, moved, cutoff=get_asked_cutoff(described, pairs))
    doubts = _warn_of_trial(estimate, trial)
    return ElasticValidation(
        robot=described,
        source=trial.source,
        tables=trial.residuals,
        notices=(*described.notices, *library.notices, *recording.notices, *told, *doubts),
        estimate=estimate,
        trial=trial,
        alignment=alignment,
        tracking=None if tracking is None else _track(described, library, tracking, cases, workshop),
    )


def _warn_of_trial(found: ElasticEstimate, trial: ElasticTrial) -> tuple[Notice, ...]:
    """Return what makes the log a poor test: that it is one of the fit, or goes beyond those."""
    notices = []
    if trial.fitted:
        notices.append(warn_of_fitted_log(trial.source))
    reached = {joint.joint: float(abs(joint.torsion).max()) for joint in trial.joints}
    beyond = [
        f"{entry.joint} {reached[entry.joint]:.3g} against {entry.torsion:.3g} {entry.position_unit}"
        for entry in found.springs
        if entry.told and reached[entry.joint] > _BEYOND * entry.torsion
    ]
    if beyond:
        text = (
            f"torsion beyond that of the logs of the fit, where springs are continued as they end: "
            f"{', '.join(beyond)}; identify from logs that reach as far"
        )
        notices.append(Notice(code="validate.beyond-torsion", text=text, file=trial.source))
    return tuple(notices)


def _list_cases(
    found: ElasticEstimate, task: TrackingTask, library: Library, file: str
) -> dict[str, ElasticEstimate]:
    """Return the estimates whose feed-forward is tried, by name.

    Raises:
        EstimateError: another estimate is of another model.
        UsageError: an estimate has no springs, which a feed-forward needs.
    """
    for path, estimate in task.against:
        check_model(estimate, library.card, path)
    cases = dict(enumerate(((file, found), *task.against), start=1))
    lacking = [
        path
        for path, estimate in cases.values()
        if not estimate.springs or not all(spring.told for spring in estimate.springs)
    ]
    if lacking:
        text = (
            "the estimate lacks springs, and a feed-forward of elastic joints needs them all; "
            "identify them too"
        )
        raise UsageError(*(Notice(code="usage.no-springs", text=text, file=path) for path in lacking))
    return {f"Case {number}: {estimate.method}": estimate for number, (_, estimate) in cases.items()}


def build_tracking_task(
    robot: Robot, seed: int | None, against: tuple[tuple[str, ElasticEstimate], ...] = ()
) -> TrackingTask:
    """Return a motion to follow: the one that validation is made for, or a random one.

    Args:
        robot: of two joints where the former is wanted.
        seed: of a random motion; None for the former, and for a random one of seed 1 with other robots.
        against: further estimates to compare with, by where they come from.
    """
    plain = seed is None and robot.freedom == _TC_JOINTS
    chosen = None if plain else _SEED if seed is None else seed
    name = "tc" if plain else "fourier"
    trajectory = build_trajectory(robot, name, np.random.default_rng(chosen or 0))
    return TrackingTask(trajectory=trajectory, seed=chosen, against=against)


def _track(
    robot: Robot,
    library: Library,
    task: TrackingTask,
    cases: Mapping[str, ElasticEstimate],
    workshop: TaskContext,
) -> TrackingComparison:
    """Return the closed loops of all cases, simulated with the values of the robot file."""
    workshop.progress(f"tracking {task.trajectory.source} with {len(cases) + 1} kinds of feed-forward")
    bases = len(library.card.beta)
    runs = simulate_tracking(
        robot,
        library,
        {name: estimate.build_fit(bases) for name, estimate in cases.items()},
        task.trajectory,
        build_noisy_options(),
        progress=workshop.progress,
    )
    methods = {name: estimate.method for name, estimate in cases.items()}
    return TrackingComparison(trajectory=task.trajectory, runs=runs, methods=methods, seed=task.seed)


def _validate_friction(
    robot: Robot,
    found: FrictionIdentification,
    log: Path | Recording,
    workshop: TaskContext,
    *,
    pairs: Pairs,
    file: str,
) -> FrictionValidation:
    # The log map of another robot would only say that its columns do not fit.
    check_robot(found, robot.name, file)
    unfolded, notices = _undo_folding(robot, found, str(log.source if isinstance(log, Recording) else log))
    described = restore_robot(robot, unfolded, pairs)
    recording = build_motor_recording(read_one_log(log, described, "a law of friction"), described)
    library = workshop.prepare(set_identified_friction(build_rigid_variant(described), found))
    check_model(found, library.card, file)
    workshop.progress(f"validating on {recording.source}")
    validation = validate_friction(found, library, recording, described.processing)
    return FrictionValidation(
        robot=described,
        source=validation.source,
        tables=(("", validation.residual),),
        notices=(*described.notices, *notices, *library.notices, *recording.notices, *validation.notices),
        validation=validation,
        laws={entry.joint: entry.estimate.law for entry in found.joints},
    )


def _undo_folding(
    robot: Robot, found: FrictionIdentification, log: str
) -> tuple[FrictionIdentification, tuple[Notice, ...]]:
    """Return the result for a log that is taken as it is: mean periods have cut ends of their own."""
    processing = found.settings.get("processing")
    folded = found.settings.get("period") or found.settings.get("periods")
    if not folded or not isinstance(processing, dict):
        return found, ()
    own = robot.processing
    processing = {**processing, "drop_first": own.drop_first, "drop_last": own.drop_last}
    text = "friction was fitted to mean periods; this log is taken as it is, noise and all"
    return (
        replace(found, settings={**found.settings, "processing": processing}),
        (Notice(code="validate.not-folded", text=text, file=log),),
    )


def diagnose_fit(robot: Robot, estimate: Estimate, workshop: TaskContext) -> Diagnosis:
    """Return the diagnosis of a fit by its own logs, which are where they were when it was made.

    Args:
        robot: as read.
        estimate: of base parameters.
        workshop: library and progress.

    Raises:
        LogError: a log was no file, is not there any more, or does not fit the robot.
        UsageError: its rows mix the joints.
    """
    _check_files(estimate)
    fitted = restore_robot(robot, estimate)
    tried = build_rigid_estimate(estimate, fitted)
    library = workshop.prepare(build_rigid_variant(fitted))
    read = read_recorded_runs(estimate.sources, estimate.settings.get("runs"), fitted)
    recordings = [build_motor_recording(entry, fitted) for entry in read]
    workshop.progress(f"diagnosing the fit to {len(recordings)} log{'s'[: len(recordings) > 1]}")
    found = diagnose_estimate(tried, library, recordings, fitted.processing)
    return replace(found, notices=(*_list_changed(estimate), *found.notices))


def _list_digests(estimate: Estimate) -> list[object]:
    digests = estimate.settings.get("log_digests")
    return [*digests] if isinstance(digests, list | tuple) else []


def _check_files(estimate: Estimate) -> None:
    """Refuse a fit to logs that were made in memory: they cannot be read again.

    Raises:
        LogError: with each of them.
    """
    text = "is no file that could be read again; save the log, and identify from the file"
    notices = [
        Notice(code="diagnosis.no-file", text=text, file=source)
        for source, digest in zip(estimate.sources, _list_digests(estimate), strict=False)
        if not digest or str(digest).startswith(IN_MEMORY_PREFIX)
    ]
    if notices:
        raise LogError(*notices)


def _list_changed(estimate: Estimate) -> tuple[Notice, ...]:
    """Return a notice for every log of the fit whose content is another one now."""
    known = _list_digests(estimate)
    text = "is not the file that it was when the estimate was made; identify again, or put the old one back"
    return tuple(
        Notice(code="diagnosis.changed-log", text=text, file=source)
        for source, digest in zip(estimate.sources, known, strict=False)
        if compute_file_digest(source) != digest
    )
