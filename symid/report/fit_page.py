"""What a fit is worth, its figures, and its page with the logs that it was tried on.

Estimate -> `FitVerdict`, drawings for a notebook; robot, estimate, held-out logs -> page, notices.

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
    check_settings,
    cut_logs,
    evaluate_elastic,
    get_stated_cutoff,
    prepare_aligned,
)
from symid.identification.estimators import Estimate, Validation, check_model
from symid.identification.friction import FrictionIdentification
from symid.identification.rigid import (
    Diagnosis,
    get_fit_overlap,
    get_usable_window,
    restore_robot,
    validate_estimate,
)
from symid.logs import Recording, check_recording, read_recordings
from symid.report.blocks import Drawing
from symid.report.elastic_page import build_elastic_page, draw_branches
from symid.report.figures import Mark, build_mark_figure
from symid.report.friction_page import build_friction_figure, build_friction_page
from symid.report.identification_page import build_identification_page
from symid.report.pages import describe_origin, format_percent, write_page
from symid.report.verdict import FitVerdict, judge_elastic, judge_friction, judge_identification
from symid.robot import Robot

AnyEstimate = Estimate | ElasticEstimate | FrictionIdentification

_MOST_PARAMETERS = 12
"""Parameters in the figure of the least certain ones."""


def judge_fit(estimate: AnyEstimate) -> FitVerdict:
    """Return what a fit is worth, judged by its own logs alone."""
    match estimate:
        case Estimate():
            return judge_identification(estimate, ())
        case ElasticEstimate():
            return judge_elastic(estimate, ())
        case FrictionIdentification():
            return judge_friction(estimate)


def draw_fit(estimate: AnyEstimate) -> tuple[Drawing, ...]:
    """Return the least certain parameters; of elastic joints the springs, of friction its curves."""
    match estimate:
        case ElasticEstimate():
            return tuple(draw_branches(entry) for entry in estimate.springs if entry.told)
        case FrictionIdentification():
            return tuple(map(build_friction_figure, estimate.joints))
    known = [entry for entry in estimate.parameters if 0.0 < entry.relative_std_percent < math.inf]
    least = sorted(known, key=lambda entry: -entry.relative_std_percent)[:_MOST_PARAMETERS]
    marks = [
        Mark(entry.name, entry.relative_std_percent, format_percent(entry.relative_std_percent))
        for entry in least
    ]
    caption = f"{estimate.robot}: least certain parameters, standard deviation in percent of the value."
    return (build_mark_figure(caption, "relative standard deviation (%)", marks),) if marks else ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WrittenPage:
    """A page that was written.

    Args:
        file: where; robot: its name.
        sources: the logs tried; processing: how each was processed, where that was chosen; lines: in words.
        diagnosis: of the fit by its own logs, None where not asked for.
        notices: what a reader should know.
    """

    file: Path
    robot: str
    sources: tuple[str, ...] = ()
    processing: tuple[dict[str, object], ...] | None = None
    lines: tuple[str, ...] = ()
    diagnosis: Diagnosis | None = None
    notices: tuple[Notice, ...] = ()


def write_fit_page(
    path: Path,
    estimate: AnyEstimate,
    known: tuple[Robot, TaskContext] | None = None,
    *,
    logs: Sequence[Path | Recording] = (),
    pairs: tuple[tuple[str, str], ...] = (),
    diagnose: bool = False,
    file: str = "",
) -> WrittenPage:
    """Write the page of a fit of any kind.

    Args:
        path: to write to.
        estimate: to report.
        known: the robot as read, and what long work with it needs; None without logs and diagnosis.
        logs: held out, files or what was read from them.
        pairs: settings of the call, keys and values.
        diagnose: whether the logs of the fit are read again.
        file: of the estimate, for messages.

    Raises:
        UsageError: there are settings and no logs, or the kind of fit has no such logs, setting or diagnosis.
        EstimateError: the estimate is of another model.
        LogError: a log does not fit the robot.
        OutputError: the page cannot be written.
    """
    if pairs and not logs:
        text = "settings apply to the logs of a validation, and none was given; give a log or leave them out"
        raise UsageError(Notice(code="usage.no-validation", text=text))
    if diagnose and not isinstance(estimate, Estimate):
        text = "--diagnose needs an estimate of base parameters; leave it out"
        raise UsageError(Notice(code="usage.no-diagnosis", text=text, file=file))
    if isinstance(estimate, Estimate):
        return _write_rigid_page(path, estimate, known, logs, pairs, diagnose=diagnose, file=file)
    if isinstance(estimate, ElasticEstimate):
        return _write_elastic_page(path, estimate, known, logs, pairs, file=file)
    if logs:
        text = (
            "--validation cannot be used with friction: laws are tested on held-out blocks when they are "
            "chosen (`symid identify --rows friction --model auto`); leave it out"
        )
        raise UsageError(Notice(code="usage.friction-validation", text=text))
    return WrittenPage(file=write_page(path, build_friction_page(estimate)), robot=estimate.robot)


def _load_logs(
    robot: Robot, logs: Sequence[Path | Recording], context: TaskContext
) -> tuple[Library, tuple[Recording, ...], tuple[Notice, ...], tuple[str, ...]]:
    """Return a library and recordings, the notices of both, and where a page comes from."""
    recordings = read_recordings(logs, robot)
    library = context.prepare(robot)
    notices = (*robot.notices, *library.notices)
    for recording in recordings:
        notices += (*recording.notices, *check_recording(recording, robot))
    return library, recordings, notices, describe_origin(robot, library, recordings)


def _write_rigid_page(
    path: Path,
    estimate: Estimate,
    known: tuple[Robot, TaskContext] | None,
    logs: Sequence[Path | Recording],
    pairs: tuple[tuple[str, str], ...],
    *,
    diagnose: bool,
    file: str,
) -> WrittenPage:
    validations: list[Validation] = []
    diagnosis: Diagnosis | None = None
    notices: tuple[Notice, ...] = ()
    origin: tuple[str, ...] = ()
    if known is not None and (logs or diagnose):
        robot, context = known
        described = restore_robot(robot, estimate, pairs)
        # What was identified as rigid is tried as rigid, whatever the robot file says of its joints.
        rigid = build_rigid_variant(described)
        tried = build_rigid_estimate(estimate, described)
        library, recordings, notices, origin = _load_logs(rigid, logs, context)
        check_model(tried, library.card, file)
        for recording in recordings:
            context.progress(f"validating on {recording.source}")
            # In the rows of the fit: residuals of one kind can be compared.
            window, longer = get_usable_window(tried.settings, recording)
            overlap = get_fit_overlap(tried.settings)
            found = validate_estimate(
                tried, library, recording, rigid.processing, rows=tried.rows, window=window, overlap=overlap
            )
            validations.append(replace(found, notices=(*longer, *found.notices)))
        if diagnose:
            diagnosis = diagnose_fit(robot, estimate, context)
            notices += diagnosis.notices
    notices += tuple(notice for entry in validations for notice in entry.notices)
    page = build_identification_page(estimate, validations, notices, origin, diagnosis=diagnosis)
    settled = [(entry.source, entry.processing) for entry in validations if entry.processing is not None]
    return WrittenPage(
        file=write_page(path, page),
        robot=estimate.robot,
        sources=tuple(entry.source for entry in validations),
        processing=tuple({**asdict(entry.processing), "origin": dict(entry.origin)} for _, entry in settled),
        lines=tuple(f"{source}: {entry.describe()}" for source, entry in settled),
        diagnosis=diagnosis,
        notices=notices,
    )


def _write_elastic_page(
    path: Path,
    estimate: ElasticEstimate,
    known: tuple[Robot, TaskContext] | None,
    logs: Sequence[Path | Recording],
    pairs: tuple[tuple[str, str], ...],
    *,
    file: str,
) -> WrittenPage:
    check_settings(pairs, "elastic")
    if known is None or not logs:
        return WrittenPage(file=write_page(path, build_elastic_page(estimate)), robot=estimate.robot)
    robot, context = known
    described = restore_robot(robot, estimate, pairs)
    library, recordings, notices, origin = _load_logs(described, logs, context)
    check_model(estimate, library.card, file)
    context.progress(f"trying the model on {len(recordings)} log{'s'[: len(recordings) > 1]}")
    kept = cut_logs(recordings, described.processing)
    moved, _, aligned = prepare_aligned(library, kept)
    notices += (*aligned, *(notice for entry in kept for notice in entry.notices if notice.code == "log.cut"))
    cutoff = get_stated_cutoff(described, pairs)
    trials = tuple(evaluate_elastic(estimate, library, entry, cutoff=cutoff) for entry in moved)
    return WrittenPage(
        file=write_page(path, build_elastic_page(estimate, trials, notices, origin)),
        robot=estimate.robot,
        sources=tuple(entry.source for entry in trials),
        notices=notices,
    )
