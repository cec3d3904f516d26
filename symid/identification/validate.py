"""A stored result and logs: validation on one that it was not fitted to, diagnosis by its own.

Robot, fit, log, settings -> `FitValidation`;  robot, estimate -> `Diagnosis`.

Nothing is fitted in a validation; filter and friction are those of the identification, unless the call
states others. For a diagnosis the logs of the fit are read again with its settings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from symid import logs as log_files
from symid.errors import LogError, Notice, UsageError
from symid.excitation import ReferenceMotion, build_motion
from symid.identification import diagnostics, elastic, estimators, rigid as rigids
from symid.identification.friction import FrictionIdentification, set_identified_friction, validate_friction
from symid.identification.identify import Pairs, TaskContext
from symid.identification.judge import POLICY
from symid.identification.regression import fill_loads, list_coupled_rotors
from symid.identification.stored import StoredResult
from symid.robot import Robot
from symid.simulation import build_noisy_options, check_stated_values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitValidation:
    """What a fit of any kind explains of a log, `source`; the robot is as it was identified.

    `tables` are residuals by joint, under captions where there are several; the first is the one that counts.
    """

    robot: Robot
    source: str
    tables: tuple[tuple[str, tuple[estimators.Residual, ...]], ...]
    notices: tuple[Notice, ...]

    @property
    def residual(self) -> tuple[estimators.Residual, ...]:
        """Return the residual of each joint."""
        return self.tables[0][1]

    @property
    def mean_relative_percent(self) -> float:
        """Return the mean over joints of the relative residuals, in percent."""
        return estimators.compute_mean_relative(self.residual)

    def list_missed(self, gate: float | None) -> tuple[Notice, ...]:
        """Return which tables miss a gate in percent; nothing where none does, or there is no gate."""
        notices = []
        for caption, residual in self.tables if gate is not None else ():
            reached = estimators.compute_mean_relative(residual)
            if not reached <= (gate or 0.0):
                place = f"{caption.rstrip('.')}: " if caption else ""
                text = f"{place}mean relative residual {reached:.4f} %, the gate is {gate:g} %"
                notices.append(Notice(code="validate.gate-missed", text=text, file=self.source))
        return tuple(notices)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidValidation(FitValidation):
    """The same of base parameters; `settled` how the log was processed.

    `band`: residual below a frequency at the full rate; None where not asked for.
    """

    validation: estimators.Validation
    settled: estimators.ResolvedProcessing
    band: diagnostics.BandResidual | None = None


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionValidation(FitValidation):
    """The same of laws of friction with the rigid part; `laws` by joint."""

    validation: estimators.Validation
    laws: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingComparison:
    """Closed loops along one trajectory, the first of rigid joints, and the methods of the others."""

    trajectory: ReferenceMotion
    runs: tuple[elastic.TrackingRun, ...]
    methods: Mapping[str, str]
    seed: int | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingTask:
    """A motion to simulate with feed-forward of the estimate; `seed` of a random one, None for another.

    `against` are further estimates to compare with, by where they come from.
    """

    trajectory: ReferenceMotion
    seed: int | None = None
    against: tuple[tuple[str, elastic.ElasticEstimate], ...] = ()


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticValidation(FitValidation):
    """The same of elastic joints, by motors, links and springs, and how links follow with the estimate.

    `alignment` and `tracking` are None where they were not estimated, or not asked for.
    """

    estimate: elastic.ElasticEstimate
    trial: elastic.ElasticTrial
    alignment: log_files.Alignment | None = None
    tracking: TrackingComparison | None = None


AnyValidation = RigidValidation | ElasticValidation | FrictionValidation


def validate_fit(
    robot: Robot,
    fit: StoredResult,
    log: Path | log_files.Recording,
    context: TaskContext,
    *,
    pairs: Pairs = (),
    test: Sequence[log_files.LogPart] = (),
    band: float | None = None,
    tracking: TrackingTask | None = None,
    file: str = "",
) -> AnyValidation:
    """Return what a fit of any kind explains of a log; nothing is fitted.

    A robot that was identified as rigid is validated as rigid. `pairs` are the settings of the call, `test`
    the part of the log that is predicted, empty for all of it. For rigid fits, torques are compared at the
    full rate below `band` in Hz, None for the rows of the fit. For elastic fits, delay and offsets of the
    link encoders are removed first, and a motion may be simulated; the robot file must state the true values
    then.
    """
    if isinstance(fit, elastic.ElasticEstimate):
        return _validate_elastic(
            robot, fit, log, context, pairs=pairs, test=test, tracking=tracking, file=file
        )
    found, notices, wanted = fit, tuple[Notice, ...](), tuple[str, ...]()
    if isinstance(fit, FrictionIdentification):
        # The log map of another robot would only say that its columns do not fit.
        estimators.check_robot(fit, robot.name, file)
        wanted, processing = ("a law of friction",), fit.settings.get("processing")
        if (fit.settings.get("period") or fit.settings.get("periods")) and isinstance(processing, dict):
            # Mean periods have cut ends of their own.
            own = robot.processing
            processing = {**processing, "drop_first": own.drop_first, "drop_last": own.drop_last}
            fit = replace(fit, settings={**fit.settings, "processing": processing})
            text = "friction was fitted to mean periods; this log is not averaged"
            text = f"{text}, so its residual contains noise: compare it with other single logs"
            source = str(log.source if isinstance(log, log_files.Recording) else log)
            notices = (Notice(code="validate.not-folded", text=text, file=source),)
    described = rigids.restore_robot(robot, fit, pairs)
    rigid = elastic.build_rigid_variant(described)
    if isinstance(found, estimators.Estimate):
        found = elastic.build_rigid_estimate(found, described)
    (read,) = log_files.take_parts((log_files.read_one_log(log, described, *wanted),), test, "--test")
    recording = elastic.build_motor_recording(read, described)
    rigid = rigid if isinstance(found, estimators.Estimate) else set_identified_friction(rigid, found)
    library = context.prepare(rigid)
    estimators.check_model(found, library.card, file)
    context.progress(f"validating on {recording.source}")
    notices = (*described.notices, *notices, *library.notices)
    notices += estimators.warn_of_other_bodies(found, rigid, library.card, file)
    if isinstance(found, FrictionIdentification):
        rotors = list_coupled_rotors(described)
        validation = validate_friction(found, library, recording, described.processing, rotors=rotors)
        return FrictionValidation(
            robot=described,
            source=validation.source,
            tables=(("", validation.residual),),
            notices=(*notices, *recording.notices, *validation.notices),
            validation=validation,
            laws={entry.joint: entry.estimate.law for entry in found.joints},
        )
    card, settled = library.card, rigids.resolve_processing(found, described.processing, recording)
    beta = found.assemble([entry.name for entry in card.beta])
    (recording,) = fill_loads(library, [recording], settled.processing, beta)
    validation = rigids.validate_estimate(found, library, recording, described.processing)
    within = None
    if band is not None:
        values = found.assemble([entry.name for entry in (*card.beta, *card.friction)])
        call = values, library, recording, settled.processing
        within = diagnostics.compute_band_residual(*call, band=band)
    return RigidValidation(
        robot=described,
        source=validation.source,
        tables=(("", validation.residual if within is None else within.joints),),
        notices=(*notices, *recording.notices, *validation.notices),
        validation=validation,
        settled=settled,
        band=within,
    )


def _validate_elastic(
    robot: Robot,
    estimate: elastic.ElasticEstimate,
    log: Path | log_files.Recording,
    context: TaskContext,
    *,
    pairs: Pairs,
    test: Sequence[log_files.LogPart],
    tracking: TrackingTask | None,
    file: str,
) -> ElasticValidation:
    elastic.check_settings(pairs, "elastic")
    described = rigids.restore_robot(robot, estimate, pairs)
    read = log_files.take_parts((log_files.read_one_log(log, described, "an elastic robot"),), test, "--test")
    (recording,) = elastic.cut_logs(read, described.processing)
    # A log with one position is refused before minutes go into a library.
    elastic.get_encoder_positions(recording)
    if tracking is not None:
        check_stated_values(described)
    library = context.prepare(described)
    estimators.check_model(estimate, library.card, file)
    cases: dict[str, elastic.ElasticEstimate] = {}
    if tracking is not None:
        for path, other in tracking.against:
            estimators.check_model(other, library.card, path)
        text = "the estimate lacks springs, which a feed-forward of elastic joints needs; identify them too"
        tried = ((file, estimate), *tracking.against)
        lacking = [
            Notice(code="usage.no-springs", text=text, file=path)
            for path, entry in tried
            if not entry.springs or not all(spring.identifiable for spring in entry.springs)
        ]
        if lacking:
            raise UsageError(*lacking)
        cases = {f"Case {k}: {entry.method}": entry for k, (_, entry) in enumerate(tried, start=1)}
    (moved,), alignment, aligned = elastic.prepare_aligned(library, (recording,))
    context.progress(f"validating on {recording.source}")
    cutoff = elastic.get_stated_cutoff(described, pairs)
    trial, warnings = elastic.evaluate_elastic(estimate, library, moved, cutoff=cutoff), list[Notice]()
    if trial.fitted:
        overlap = log_files.measure_overlap(moved, estimate.sources, estimate.settings)
        told = {"what": "estimate", "part": log_files.describe_overlap(overlap, moved)}
        warnings.append(diagnostics.build_warning("validate.fitted-log", file=trial.source, **told))
    warnings += estimators.warn_of_other_bodies(estimate, described, library.card, file)
    reached = {joint.joint: float(abs(joint.torsion).max()) for joint in trial.joints}
    beyond = [
        f"{entry.joint} {reached[entry.joint]:.3g} against {entry.torsion:.3g} {entry.position_unit}"
        for entry in estimate.springs
        if entry.identifiable and reached[entry.joint] - entry.torsion > POLICY.relevance * entry.torsion
    ]
    if beyond:
        text = "torsion is larger than in the logs of the fit, so springs are extrapolated: "
        text += f"{', '.join(beyond)}; identify from logs with as much torsion"
        warnings.append(Notice(code="validate.beyond-torsion", text=text, file=trial.source))
    followed: TrackingComparison | None = None
    if tracking is not None:
        # The closed loops of all cases, simulated with the values of the robot file.
        kinds = f"{len(cases) + 1} kinds of feed-forward"
        context.progress(f"tracking {tracking.trajectory.source} with {kinds}")
        followed = TrackingComparison(
            trajectory=tracking.trajectory,
            runs=elastic.simulate_tracking(
                described,
                library,
                {name: entry.build_fit(library.card) for name, entry in cases.items()},
                tracking.trajectory,
                build_noisy_options(),
                progress=context.progress,
            ),
            methods={name: entry.method for name, entry in cases.items()},
            seed=tracking.seed,
        )
    return ElasticValidation(
        robot=described,
        source=trial.source,
        tables=trial.residuals,
        notices=(*described.notices, *library.notices, *recording.notices, *aligned, *warnings),
        estimate=estimate,
        trial=trial,
        alignment=alignment,
        tracking=followed,
    )


def build_tracking_task(
    robot: Robot, seed: int | None, against: tuple[tuple[str, elastic.ElasticEstimate], ...] = ()
) -> TrackingTask:
    """Return a motion to follow: that made for validation, or a random one of `seed`; see `TrackingTask`."""
    trajectory = build_motion(robot, "tc" if seed is None else "fourier", np.random.default_rng(seed))
    return TrackingTask(trajectory=trajectory, seed=seed, against=against)


def diagnose_fit(robot: Robot, estimate: estimators.Estimate, context: TaskContext) -> rigids.Diagnosis:
    """Return the diagnosis of a fit by its own logs, which are where they were when it was made."""
    digests = estimate.settings.get("log_digests")
    pairs = list(zip(estimate.sources, [*digests] if isinstance(digests, list | tuple) else [], strict=False))
    text = "is not a file that can be read again; save the log, and identify from the file"
    notices = [
        Notice(code="diagnosis.no-file", text=text, file=source)
        for source, digest in pairs
        if not digest or str(digest).startswith(log_files.IN_MEMORY_PREFIX)
    ]
    if notices:
        raise LogError(*notices)
    text = "has changed since the estimate was made; identify again, or restore the file"
    notices = [
        Notice(code="diagnosis.changed-log", text=text, file=source)
        for source, digest in pairs
        if not log_files.is_digest_of_file(str(digest), source)
    ]
    fitted = rigids.restore_robot(robot, estimate)
    tried = elastic.build_rigid_estimate(estimate, fitted)
    library = context.prepare(elastic.build_rigid_variant(fitted))
    read = log_files.read_recorded_runs(estimate.sources, estimate.settings, fitted)
    recordings = [elastic.build_motor_recording(entry, fitted) for entry in read]
    context.progress(f"diagnosing the fit to {len(recordings)} log{'s'[: len(recordings) > 1]}")
    beta = tried.assemble([entry.name for entry in library.card.beta])
    recordings = fill_loads(library, recordings, fitted.processing, beta)
    found = rigids.diagnose_estimate(tried, library, recordings, fitted.processing)
    return replace(found, notices=(*notices, *found.notices))
