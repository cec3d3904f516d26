"""What a fit is worth, its figures, and its page with the logs that it was tried on.

Estimate -> `FitVerdict`, drawings for a notebook; robot, estimate, held-out logs -> page, and what a reader
must know.

Supported: estimates of rigid and elastic robots, results of friction (whose laws were tried when chosen).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification import TaskContext, diagnose_fit
from symid.identification.elastic import (
    ElasticEstimate,
    build_rigid_estimate,
    build_rigid_variant,
    check_elastic_model,
    check_settings,
    cut_logs,
    evaluate_elastic,
    get_asked_cutoff,
    prepare_aligned,
)
from symid.identification.estimators import Estimate, Validation
from symid.identification.friction import FrictionIdentification
from symid.identification.rigid import (
    Diagnosis,
    check_rigid_model,
    get_fit_overlap,
    get_usable_window,
    restore_robot,
    validate_estimate,
)
from symid.logs import Recording, check_recording, read_recordings
from symid.report.blocks import Drawing
from symid.report.elastic_page import ElasticExtras, build_spring_section, write_elastic_report
from symid.report.figures import Interval, build_interval_figure
from symid.report.friction_page import build_friction_figure, judge_friction, write_friction_report
from symid.report.identification_page import write_identification_report
from symid.report.pages import describe_origin, format_digits
from symid.report.verdict import FitVerdict, judge_elastic, judge_identification
from symid.robot import Robot

_MOST_PARAMETERS = 12
"""Parameters in the figure of the least certain ones."""


def judge_fit(estimate: Estimate | ElasticEstimate | FrictionIdentification) -> FitVerdict:
    """Return what a fit is worth, judged by its own logs alone."""
    match estimate:
        case Estimate():
            return judge_identification(estimate, ())
        case ElasticEstimate():
            return judge_elastic(estimate, ())
        case FrictionIdentification():
            return judge_friction(estimate)


def draw_fit(estimate: Estimate | ElasticEstimate | FrictionIdentification) -> tuple[Drawing, ...]:
    """Return the least certain parameters; of elastic joints the springs, of friction its curves."""
    match estimate:
        case Estimate():
            return _draw_deviations(estimate)
        case ElasticEstimate():
            springs = (build_spring_section(entry) for entry in estimate.springs if entry.told)
            return tuple(Drawing(entry.branches, f"{entry.joint}: torque over torsion") for entry in springs)
        case FrictionIdentification():
            return tuple(
                Drawing(build_friction_figure(entry), f"{entry.joint}: {entry.estimate.law}")
                for entry in estimate.joints
            )


def _draw_deviations(estimate: Estimate) -> tuple[Drawing, ...]:
    known = [entry for entry in estimate.parameters if 0.0 < entry.relative_std_percent < math.inf]
    least = sorted(known, key=lambda entry: -entry.relative_std_percent)[:_MOST_PARAMETERS]
    if not least:
        return ()
    intervals = [
        Interval(
            label=entry.name,
            middle=entry.relative_std_percent,
            text=f"{format_digits(entry.relative_std_percent)} %",
        )
        for entry in least
    ]
    title = f"{estimate.robot}: least certain parameters"
    words = "Standard deviations of the parameters that are known worst, in percent of their values."
    figure = build_interval_figure(title, words, "relative standard deviation (%)", intervals)
    return (Drawing(figure, title),)


KnownRobot = tuple[Robot, TaskContext]
"""A robot as read, and what long work with it needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageRequest:
    """What a page is made of besides the estimate.

    Args:
        logs: held out, files or what was read from them.
        pairs: settings of the call, keys and values.
        diagnose: whether the logs of the fit are read again.
        file: of the estimate, for messages.
    """

    logs: tuple[Path | Recording, ...] = ()
    pairs: tuple[tuple[str, str], ...] = ()
    diagnose: bool = False
    file: str = ""

    def __post_init__(self) -> None:
        """Refuse settings that no log would be read with.

        Raises:
            UsageError: there are settings and no logs.
        """
        if self.pairs and not self.logs:
            text = "settings are for the logs of a validation, and there is none; give one, or leave them out"
            raise UsageError(Notice(code="usage.no-validation", text=text))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Page:
    """A page that was written.

    Args:
        file: where; robot: its name.
        sources: the logs tried; processing: how each was processed, where that was settled.
        diagnosis: what the logs of the fit tell, None where not asked for.
        notices: what a reader should know.
    """

    file: Path
    robot: str
    sources: tuple[str, ...] = ()
    processing: tuple[dict[str, object], ...] | None = None
    lines: tuple[str, ...] = ()
    diagnosis: Diagnosis | None = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LoadedLogs:
    """A library and recordings, with what a page says of them."""

    library: Library
    recordings: tuple[Recording, ...]
    notices: tuple[Notice, ...]
    origin: tuple[str, ...]


def _load_logs(robot: Robot, logs: Sequence[Path | Recording], workshop: TaskContext) -> _LoadedLogs:
    recordings = read_recordings(logs, robot)
    library = workshop.prepare(robot)
    notices = (*robot.notices, *library.notices)
    for recording in recordings:
        notices += (*recording.notices, *check_recording(recording, robot))
    return _LoadedLogs(
        library=library,
        recordings=recordings,
        notices=notices,
        origin=describe_origin(robot, library, recordings),
    )


def write_rigid_page(
    path: Path, estimate: Estimate, request: PageRequest, known: KnownRobot | None = None
) -> Page:
    """Write the page of an estimate of base parameters.

    Args:
        path: to write to.
        estimate: of base parameters.
        request: logs and settings.
        known: the robot; None where neither logs nor a diagnosis ask for it.

    Raises:
        EstimateError: the estimate is of another model.
        LogError: a log does not fit the robot.
        OutputError: the page cannot be written.
    """
    validations: tuple[Validation, ...] = ()
    diagnosis: Diagnosis | None = None
    scene: _LoadedLogs | None = None
    if known is not None and (request.logs or request.diagnose):
        robot, workshop = known
        described = restore_robot(robot, estimate, request.pairs)
        # What was identified as rigid is tried as rigid, whatever the robot file says of its joints.
        rigid = build_rigid_variant(described)
        tried = build_rigid_estimate(estimate, described)
        scene = _load_logs(rigid, request.logs, workshop)
        check_rigid_model(tried, scene.library.card, request.file)
        validations = _validate(tried, scene.library, scene.recordings, rigid, workshop)
        if request.diagnose:
            diagnosis = diagnose_fit(robot, estimate, workshop)
    notices = (*(scene.notices if scene else ()), *(diagnosis.notices if diagnosis else ()))
    origin = scene.origin if scene else ()
    written = write_identification_report(path, estimate, validations, notices, origin, diagnosis=diagnosis)
    settled = [(entry.source, entry.processing) for entry in validations if entry.processing is not None]
    return Page(
        file=written,
        robot=estimate.robot,
        sources=tuple(entry.source for entry in validations),
        processing=tuple({**asdict(entry.processing), "origin": dict(entry.origin)} for _, entry in settled),
        lines=tuple(f"{source}: {entry.tell()}" for source, entry in settled),
        diagnosis=diagnosis,
        notices=(*notices, *(notice for entry in validations for notice in entry.notices)),
    )


def _validate(
    estimate: Estimate,
    library: Library,
    recordings: Sequence[Recording],
    robot: Robot,
    workshop: TaskContext,
) -> tuple[Validation, ...]:
    """Return what the estimate explains of each log, in the rows of the fit: like residuals compare."""
    found = []
    for recording in recordings:
        workshop.progress(f"validating on {recording.source}")
        window, notices = get_usable_window(estimate.settings, recording)
        tried = validate_estimate(
            estimate,
            library,
            recording,
            robot.processing,
            rows=estimate.rows,
            window=window,
            overlap=get_fit_overlap(estimate.settings),
        )
        found.append(replace(tried, notices=(*notices, *tried.notices)))
    return tuple(found)


def write_elastic_page(
    path: Path, estimate: ElasticEstimate, request: PageRequest, known: KnownRobot | None = None
) -> Page:
    """Write the page of an estimate of elastic joints.

    Args:
        path: to write to.
        estimate: of dynamics and springs.
        request: logs and settings.
        known: the robot; None where no logs ask for it.

    Raises:
        UsageError: a setting has no meaning for elastic joints, or a diagnosis is asked for.
        EstimateError: the estimate is of another model.
        LogError: a log lacks an encoder, or does not fit the robot.
        OutputError: the page cannot be written.
    """
    _refuse_diagnosis(request)
    check_settings(request.pairs, "elastic")
    extras = ElasticExtras()
    if request.logs and known is not None:
        robot, workshop = known
        described = restore_robot(robot, estimate, request.pairs)
        scene = _load_logs(described, request.logs, workshop)
        check_elastic_model(estimate, scene.library.card, request.file)
        count = f"{len(scene.recordings)} log{'s'[: len(scene.recordings) > 1]}"
        workshop.progress(f"trying the model on {count}")
        kept = cut_logs(scene.recordings, described.processing)
        moved, _, told = prepare_aligned(scene.library, kept)
        told += tuple(notice for entry in kept for notice in entry.notices if notice.code == "log.cut")
        cutoff = get_asked_cutoff(described, request.pairs)
        trials = tuple(evaluate_elastic(estimate, scene.library, entry, cutoff=cutoff) for entry in moved)
        extras = ElasticExtras(trials=trials, notices=(*scene.notices, *told), origin=scene.origin)
    written = write_elastic_report(path, estimate, extras)
    return Page(
        file=written,
        robot=estimate.robot,
        sources=tuple(entry.source for entry in extras.trials),
        notices=extras.notices,
    )


def write_friction_page(path: Path, found: FrictionIdentification, request: PageRequest) -> Page:
    """Write the page of friction laws, which were tried on torques held back when they were chosen.

    Args:
        path: to write to.
        found: laws and parameters.
        request: without logs.

    Raises:
        UsageError: logs or a diagnosis are asked for.
        OutputError: the page cannot be written.
    """
    _refuse_diagnosis(request)
    if request.logs:
        text = (
            "--validation cannot be used with friction: what tests a law is held back when it is chosen "
            "(`symid identify --rows friction --model auto`); leave it out"
        )
        raise UsageError(Notice(code="usage.friction-validation", text=text))
    return Page(file=write_friction_report(path, found), robot=found.robot)


def _refuse_diagnosis(request: PageRequest) -> None:
    if request.diagnose:
        text = "--diagnose needs an estimate of base parameters; leave it out"
        raise UsageError(Notice(code="usage.no-diagnosis", text=text, file=request.file))
