"""What a fit is worth, its figures, and its page with the logs that it was tried on.

Estimate -> `FitVerdict`, drawings for a notebook; robot, estimate, held-out logs -> page, notices.

Supported: estimates of rigid and elastic robots, results of friction (whose laws were tried when chosen).
"""

import math
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification import FrictionValidation, TaskContext, diagnose_fit, validate_fit
from symid.identification.elastic import (
    ElasticEstimate,
    ElasticTrial,
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
from symid.logs import LogPart, Recording, check_recording, read_recordings, take_parts
from symid.report.blocks import Drawing
from symid.report.elastic_page import build_elastic_page, draw_branches
from symid.report.figures import Mark, build_mark_figure
from symid.report.identification_page import (
    build_friction_figure,
    build_friction_page,
    build_identification_page,
)
from symid.report.pages import Page, describe_origin, format_percent, write_page
from symid.report.verdict import (
    AnyEstimate,
    FitVerdict,
    judge_elastic,
    judge_friction,
    judge_identification,
)
from symid.robot import Robot, list_robots, name_for_commands

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
        file: where; robot: its name; verdict: the page's headline.
        sources: the logs tried; processing: how each was processed, where that was chosen; lines: in words.
        diagnosis: of the fit by its own logs, None where not asked for.
        notices: what a reader should know.
    """

    file: Path
    robot: str
    verdict: FitVerdict
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
    test: Sequence[LogPart] = (),
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
        test: parts of these logs, one for all or one for each; empty for all of them.
        diagnose: whether the logs of the fit are read again.
        file: of the estimate, for messages.

    Raises:
        UsageError: there are settings or parts and no logs, or the kind of fit has no such logs, setting or
            diagnosis.
        EstimateError: the estimate is of another model.
        LogError: a log does not fit the robot.
        OutputError: the page cannot be written.
    """
    if pairs and not logs:
        text = "settings apply to the logs of a validation, and none was given; give a log or leave them out"
        raise UsageError(Notice(code="usage.no-validation", text=text))
    if test and not logs:
        text = f"--test {test[0].text}: is a part of the logs of a validation, and none was given; give a log"
        raise UsageError(Notice(code="usage.no-validation", text=text))
    if diagnose and not isinstance(estimate, Estimate):
        text = "--diagnose needs an estimate of base parameters; leave it out"
        raise UsageError(Notice(code="usage.no-diagnosis", text=text, file=file))
    if isinstance(estimate, Estimate):
        return _write_rigid_page(path, estimate, known, logs, pairs, test=test, diagnose=diagnose, file=file)
    if isinstance(estimate, ElasticEstimate):
        return _write_elastic_page(path, estimate, known, logs, pairs, test=test, file=file)
    return _write_friction_page(path, estimate, known, logs, pairs, test=test, file=file)


def _write(path: Path, page: Page, **found: Any) -> WrittenPage:  # noqa: ANN401  fields of the record
    return WrittenPage(file=write_page(path, page), robot=page.robot, verdict=page.verdict, **found)


def _suggest_step(
    estimate: AnyEstimate,
    verdict: FitVerdict,
    tried: Sequence[Validation | ElasticTrial],
    known: tuple[Robot, TaskContext] | None,
    file: str,
) -> tuple[str, str]:
    """Return the command that an expert would type after this verdict, and what for."""
    named = estimate.robot if estimate.robot in list_robots() else "ROBOT"
    robot = named if known is None else name_for_commands(known[0])
    if verdict.level in {"wrong", "doubtful"}:
        return shlex.join(["symid", "check", robot, *estimate.sources]), "Look for the cause"
    if all(entry.fitted for entry in tried):
        command = shlex.join(["symid", "validate", robot, file or "ESTIMATE"])
        return f"{command} LOG", "Test it on a log of another motion"
    target = f"{estimate.robot}_identified.toml"
    return shlex.join(
        ["symid", "export", robot, file or "ESTIMATE", "-o", target]
    ), "Write a robot file with these values"


def _load_logs(
    robot: Robot, logs: Sequence[Path | Recording], test: Sequence[LogPart], context: TaskContext
) -> tuple[Library, tuple[Recording, ...], tuple[Notice, ...], tuple[str, ...]]:
    """Return a library and recordings, the notices of both, and where a page comes from."""
    recordings = take_parts(read_recordings(logs, robot), test, "--test")
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
    test: Sequence[LogPart],
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
        library, recordings, notices, origin = _load_logs(rigid, logs, test, context)
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
    page = build_identification_page(
        estimate,
        validations,
        notices,
        origin,
        diagnosis=diagnosis,
        next_step=_suggest_step(
            estimate, judge_identification(estimate, validations), validations, known, file
        ),
    )
    settled = [(entry.source, entry.processing) for entry in validations if entry.processing is not None]
    return _write(
        path,
        page,
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
    test: Sequence[LogPart],
    file: str,
) -> WrittenPage:
    check_settings(pairs, "elastic")
    if known is None or not logs:
        step = _suggest_step(estimate, judge_elastic(estimate, ()), (), known, file)
        return _write(path, build_elastic_page(estimate, next_step=step))
    robot, context = known
    described = restore_robot(robot, estimate, pairs)
    library, recordings, notices, origin = _load_logs(described, logs, test, context)
    check_model(estimate, library.card, file)
    context.progress(f"trying the model on {len(recordings)} log{'s'[: len(recordings) > 1]}")
    kept = cut_logs(recordings, described.processing)
    moved, _, aligned = prepare_aligned(library, kept)
    found = (notice for entry in kept for notice in entry.notices if notice.code == "log.cut")
    notices += (*aligned, *(notice for notice in found if notice not in notices))
    cutoff = get_stated_cutoff(described, pairs)
    trials = tuple(evaluate_elastic(estimate, library, entry, cutoff=cutoff) for entry in moved)
    step = _suggest_step(estimate, judge_elastic(estimate, trials), trials, known, file)
    return _write(
        path,
        build_elastic_page(estimate, trials, notices, origin, next_step=step),
        sources=tuple(entry.source for entry in trials),
        notices=notices,
    )


def _write_friction_page(
    path: Path,
    found: FrictionIdentification,
    known: tuple[Robot, TaskContext] | None,
    logs: Sequence[Path | Recording],
    pairs: tuple[tuple[str, str], ...],
    *,
    test: Sequence[LogPart],
    file: str,
) -> WrittenPage:
    if known is None or not logs:
        step = _suggest_step(found, judge_friction(found), (), known, file)
        return _write(path, build_friction_page(found, next_step=step))
    robot, context = known
    recordings = take_parts(read_recordings(logs, restore_robot(robot, found, pairs)), test, "--test")
    tried = [
        validate_fit(robot, found, recording, context, pairs=pairs, file=file) for recording in recordings
    ]
    validations = [entry.validation for entry in tried if isinstance(entry, FrictionValidation)]
    notices = tuple(dict.fromkeys(notice for entry in tried for notice in entry.notices))
    step = _suggest_step(found, judge_friction(found, validations), validations, known, file)
    return _write(
        path,
        build_friction_page(found, validations, notices, next_step=step),
        sources=tuple(entry.source for entry in validations),
        notices=notices,
    )
