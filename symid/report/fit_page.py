"""The page of a fit with the logs that it was tried on: gathers what the pages of each kind show.

Input: a robot, an estimate, held-out logs. Output: a page, and what a reader must know.

Supported: estimates of rigid and elastic robots, results of friction (whose laws were tried when chosen).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from symid.codegen.library import Library
from symid.data.checks import check_recording
from symid.data.logs import gather_recordings
from symid.data.recording import Recording
from symid.elastic.estimate import ElasticEstimate
from symid.elastic.motor_side import build_rigid_estimate, build_rigid_variant
from symid.elastic.settings import check_settings, cut_logs, find_asked_cutoff
from symid.elastic.storage import check_elastic_model
from symid.elastic.torsion import prepare_aligned
from symid.elastic.trial import try_estimate
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate, Validation
from symid.friction.results import FrictionIdentification
from symid.identification.diagnosis import Diagnosis
from symid.identification.fitted_processing import find_overlap, find_usable_window
from symid.identification.fitted_robot import restore_robot
from symid.identification.validate import check_model, validate_estimate
from symid.report.elastic import ElasticExtras, write_elastic_report
from symid.report.friction import write_friction_report
from symid.report.identification import write_report
from symid.report.origin import describe_origin
from symid.robot.description import Robot
from symid.tasks.diagnose import diagnose_fit
from symid.tasks.identify import Workshop

__all__ = ["Known", "Page", "PageRequest", "write_elastic_page", "write_friction_page", "write_rigid_page"]

Known = tuple[Robot, Workshop]
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
class _Scene:
    """A library and recordings, with what a page says of them."""

    library: Library
    recordings: tuple[Recording, ...]
    notices: tuple[Notice, ...]
    origin: tuple[str, ...]


def _set_scene(robot: Robot, logs: Sequence[Path | Recording], workshop: Workshop) -> _Scene:
    recordings = gather_recordings(logs, robot)
    library = workshop.prepare(robot)
    notices = (*robot.notices, *library.notices)
    for recording in recordings:
        notices += (*recording.notices, *check_recording(recording, robot))
    return _Scene(
        library=library,
        recordings=recordings,
        notices=notices,
        origin=describe_origin(robot, library, recordings),
    )


def write_rigid_page(
    path: Path, estimate: Estimate, request: PageRequest, known: Known | None = None
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
    scene: _Scene | None = None
    if known is not None and (request.logs or request.diagnose):
        robot, workshop = known
        described = restore_robot(robot, estimate, request.pairs)
        # What was identified as rigid is tried as rigid, whatever the robot file says of its joints.
        rigid = build_rigid_variant(described)
        tried = build_rigid_estimate(estimate, described)
        scene = _set_scene(rigid, request.logs, workshop)
        check_model(tried, scene.library.card, request.file)
        validations = _validate(tried, scene.library, scene.recordings, rigid, workshop)
        if request.diagnose:
            diagnosis = diagnose_fit(robot, estimate, workshop)
    notices = (*(scene.notices if scene else ()), *(diagnosis.notices if diagnosis else ()))
    origin = scene.origin if scene else ()
    written = write_report(path, estimate, validations, notices, origin, diagnosis=diagnosis)
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
    workshop: Workshop,
) -> tuple[Validation, ...]:
    """Return what the estimate explains of each log, in the rows of the fit: like residuals compare."""
    found = []
    for recording in recordings:
        workshop.progress(f"validating on {recording.source}")
        window, notices = find_usable_window(estimate.settings, recording)
        tried = validate_estimate(
            estimate,
            library,
            recording,
            robot.processing,
            rows=estimate.rows,
            window=window,
            overlap=find_overlap(estimate.settings),
        )
        found.append(replace(tried, notices=(*notices, *tried.notices)))
    return tuple(found)


def write_elastic_page(
    path: Path, estimate: ElasticEstimate, request: PageRequest, known: Known | None = None
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
        scene = _set_scene(described, request.logs, workshop)
        check_elastic_model(estimate, scene.library.card, request.file)
        count = f"{len(scene.recordings)} log{'s'[: len(scene.recordings) > 1]}"
        workshop.progress(f"trying the model on {count}")
        kept = cut_logs(scene.recordings, described.processing)
        moved, _, told = prepare_aligned(scene.library, kept)
        told += tuple(notice for entry in kept for notice in entry.notices if notice.code == "log.cut")
        cutoff = find_asked_cutoff(described, request.pairs)
        trials = tuple(try_estimate(estimate, scene.library, entry, cutoff=cutoff) for entry in moved)
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
