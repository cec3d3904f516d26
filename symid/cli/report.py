"""`symid report ESTIMATE -o report.html`: what was found, on one page."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from symid.cli.diagnosed import describe_diagnosis, show_diagnosis
from symid.cli.elastic_settings import check_settings, cut_logs, find_asked_cutoff
from symid.cli.inputs import (
    check_output,
    describe_origin,
    load_robot_library,
    load_robot_of_estimate,
    read_logs,
    show_path,
)
from symid.cli.options import force_option, output_option, set_option, split_settings, verb
from symid.cli.output import Answer, Console
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.estimators.estimate import Estimate, Validation
    from symid.identification.diagnosis import Diagnosis
    from symid.robot.description import Robot

__all__ = ["command"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Call:
    """What the command line says."""

    estimate: Path
    logs: tuple[Path, ...]
    robot: str | None
    pairs: tuple[tuple[str, str], ...]
    output: Path
    diagnose: bool = False


class _Logs(NamedTuple):
    """Recordings, and what a page says of them."""

    library: "Library"
    recordings: tuple["Recording", ...]
    notices: tuple[Notice, ...]
    origin: tuple[str, ...]


@click.command("report")
@click.argument("estimate", type=click.Path(path_type=Path))
@click.option(
    "--validation",
    "logs",
    multiple=True,
    metavar="LOG",
    type=click.Path(path_type=Path),
    help="Held-out log to predict; may be repeated.",
)
@click.option(
    "--diagnose",
    is_flag=True,
    help="Read the logs of the fit again: what they can tell, essential parameters, bootstrap, drift, and "
    "which term the residual misses.",
)
@click.option("--robot", help="Robot of the logs.  [default: the name in ESTIMATE]")
@set_option
@output_option("Page to write.", required=True)
@force_option
@verb
def command(
    console: Console,
    *,
    estimate: Path,
    logs: tuple[Path, ...],
    diagnose: bool,
    robot: str | None,
    settings: tuple[str, ...],
    output: Path,
    force: bool,
) -> Answer:
    """Write one self-contained HTML page: verdict, parameters, measured and predicted torques.

    For elastic joints also springs, hysteresis loops, and the methods that were compared; for friction
    its curves, and the laws that were compared.
    """
    pairs = split_settings(settings)
    # A diagnosis reads the logs of the fit as the fit did.
    given = [name for name, value in (("--robot", robot and not diagnose), ("--set", settings)) if value]
    if given and not logs:
        text = (
            f"{', '.join(given)} is of the logs that --validation names, and there is none; "
            f"give --validation LOG, or leave {'them' if given[1:] else 'it'} out"
        )
        raise UsageError(Notice(code="usage.no-validation", text=text))
    check_output(output, force=force, inputs=(estimate, *logs))
    from symid.elastic.storage import is_elastic_estimate
    from symid.friction.results import is_friction_result

    rigid = not is_friction_result(estimate) and not is_elastic_estimate(estimate)
    if diagnose and not rigid:
        text = "--diagnose needs an estimate of base parameters; leave it out"
        raise UsageError(Notice(code="usage.no-diagnosis", text=text, file=str(estimate)))
    if is_friction_result(estimate):
        return _report_friction(estimate, logs, output)
    answer = _report_rigid if rigid else _report_elastic
    call = _Call(estimate=estimate, logs=logs, robot=robot, pairs=pairs, output=output, diagnose=diagnose)
    return answer(console, call)


def _report_friction(estimate: Path, logs: tuple[Path, ...], output: Path) -> Answer:
    """Friction of a robot -> page."""
    from symid.friction.results import read_friction_result
    from symid.report.friction import write_friction_report

    if logs:
        text = (
            "--validation cannot be used with friction: what tests a law is held back when it is chosen "
            "(`symid identify --rows friction --model auto`); leave it out"
        )
        raise UsageError(Notice(code="usage.friction-validation", text=text))
    found = read_friction_result(estimate)
    return _answer(found.robot, write_friction_report(output, found), [], ())


def _report_rigid(console: Console, call: _Call) -> Answer:
    """Estimate of a rigid robot, logs -> page."""
    from symid.elastic.motor_side import build_rigid_variant, find_unseen
    from symid.identification.storage import read_estimate
    from symid.identification.validate import check_model
    from symid.report.identification import write_report

    found = read_estimate(call.estimate)
    validations: tuple[Validation, ...] = ()
    diagnosis: Diagnosis | None = None
    notices: tuple[Notice, ...] = ()
    origin: tuple[str, ...] = ()
    if call.logs or call.diagnose:
        described = _find_robot(
            call, found.robot, lambda name: load_robot_of_estimate(name, found, call.pairs)
        )
        # What was identified as rigid is tried as rigid, whatever the robot file says of its joints.
        robot = build_rigid_variant(described)
        unseen = {name for name, _ in find_unseen(described)}
        tried = replace(found, refused=tuple(entry for entry in found.refused if entry[0] not in unseen))
        library, recordings, notices, origin = _read_logs(console, call, robot)
        check_model(tried, library.card, str(call.estimate))
        validations = _validate_logs(console, tried, library, recordings, robot)
        if call.diagnose:
            fitted = _find_robot(call, found.robot, lambda name: load_robot_of_estimate(name, found, ()))
            diagnosis = _diagnose(console, tried, library, fitted)
            notices = (*notices, *diagnosis.notices)
    path = write_report(call.output, found, validations, notices, origin, diagnosis=diagnosis)
    sources = [entry.source for entry in validations]
    told = (*notices, *(notice for entry in validations for notice in entry.notices))
    answer = _add_processing(_answer(found.robot, path, sources, told), validations)
    if diagnosis is None:
        return answer
    result = {**answer.result, "diagnosis": describe_diagnosis(diagnosis)}
    return replace(answer, text="\n\n".join((answer.text, show_diagnosis(diagnosis))), result=result)


def _add_processing(answer: Answer, validations: Sequence["Validation"]) -> Answer:
    """Return the answer with how each held-out log was processed."""
    told = [(entry.source, entry.processing) for entry in validations if entry.processing is not None]
    lines = [f"{source}: {settled.tell()}" for source, settled in told]
    used = [{**asdict(settled.processing), "origin": dict(settled.origin)} for _, settled in told]
    result = {**answer.result, "processing": used}
    return replace(answer, text="\n".join((answer.text, *lines)), result=result)


def _validate_logs(
    console: Console,
    estimate: "Estimate",
    library: "Library",
    recordings: Sequence["Recording"],
    robot: "Robot",
) -> tuple["Validation", ...]:
    """Return what the estimate explains of each log, in the rows of the fit: like residuals compare."""
    from symid.identification.fitted_processing import find_overlap, find_usable_window
    from symid.identification.validate import validate_estimate

    found = []
    for recording in recordings:
        console.progress(f"validating on {recording.source}")
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


def _diagnose(console: Console, estimate: "Estimate", library: "Library", robot: "Robot") -> "Diagnosis":
    """Return what the logs of the fit tell, read again with the settings of the fit and of each run."""
    from symid.data.runs import read_recorded_runs
    from symid.elastic.motor_side import build_motor_recording
    from symid.identification.diagnosis import diagnose_estimate

    read = read_recorded_runs(estimate.sources, estimate.settings.get("runs"), robot)
    recordings = [build_motor_recording(entry, robot) for entry in read]
    console.progress(f"diagnosing the fit to {len(recordings)} log{'s'[: len(recordings) > 1]}")
    found = diagnose_estimate(estimate, library, recordings, robot.processing)
    return replace(found, notices=(*_list_changed(estimate), *found.notices))


def _list_changed(estimate: "Estimate") -> tuple[Notice, ...]:
    """Return a notice for every log of the fit whose content is another one now."""
    from symid.identification.validate import find_digest

    digests = estimate.settings.get("log_digests")
    known = digests if isinstance(digests, list | tuple) else []
    text = "is not the file that it was when the estimate was made; identify again, or put the old one back"
    return tuple(
        Notice(code="diagnosis.changed-log", text=text, file=source)
        for source, digest in zip(estimate.sources, known, strict=False)
        if find_digest(source) != digest
    )


def _report_elastic(console: Console, call: _Call) -> Answer:
    """Estimate of elastic joints, logs -> page."""
    from symid.elastic.storage import read_elastic_estimate
    from symid.elastic.torsion import prepare_aligned
    from symid.report.elastic import ElasticExtras, write_elastic_report
    from symid.report.elastic_trial import try_estimate

    check_settings(call.pairs, "elastic")
    found = read_elastic_estimate(call.estimate)
    extras = ElasticExtras()
    if call.logs:
        robot = _find_robot(call, found.robot, lambda name: load_robot_of_estimate(name, found, call.pairs))
        library, recordings, notices, origin = _read_logs(console, call, robot)
        found = read_elastic_estimate(call.estimate, library.card)
        console.progress(f"trying the model on {len(recordings)} log{'s'[: len(recordings) > 1]}")
        kept = cut_logs(recordings, robot.processing)
        moved, _, told = prepare_aligned(library, kept)
        told += tuple(notice for entry in kept for notice in entry.notices if notice.code == "log.cut")
        cutoff = find_asked_cutoff(robot, call.pairs)
        trials = tuple(try_estimate(found, library, recording, cutoff=cutoff) for recording in moved)
        extras = ElasticExtras(trials=trials, notices=(*notices, *told), origin=origin)
    path = write_elastic_report(call.output, found, extras)
    return _answer(found.robot, path, [entry.source for entry in extras.trials], extras.notices)


def _read_logs(console: Console, call: _Call, robot: "Robot") -> _Logs:
    """Return library and recordings with what a reader should know of them."""
    from symid.data.checks import check_recording

    check_output(call.output, force=True, inputs=(robot.path,))
    recordings = read_logs(call.logs, robot)
    library = load_robot_library(robot, console)
    notices = (*robot.notices, *library.notices)
    for recording in recordings:
        notices += (*recording.notices, *check_recording(recording, robot))
    return _Logs(library, recordings, notices, describe_origin(robot, library, recordings))


def _answer(robot: str, path: Path, sources: list[str], warnings: tuple[Notice, ...]) -> Answer:
    result = {"robot": robot, "file": path, "validations": sources}
    return Answer(text=f"report: {show_path(path)}", result=result, warnings=warnings)


def _find_robot(call: _Call, named: str, load: Callable[[str], "Robot"]) -> "Robot":
    """Return the robot of the logs; where the estimate's name leads nowhere, say how to name a file."""
    try:
        return load(call.robot or named)
    except UsageError as error:
        first = error.notices[0]
        if first.code != "usage.unknown-robot" or call.robot is not None:
            raise
        text = (
            f"the estimate was made with robot '{named}', which is not among the known robots; "
            "name its file with --robot FILE.toml"
        )
        raise UsageError(replace(first, text=text)) from error
