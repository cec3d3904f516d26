"""From the arguments of a verb to the products that stages take.

Input: texts of the command line. Output: `Robot`, `Library`, `Recording`, `Estimate`.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.output import Console
from symid.errors import EstimateError, Notice, OutputError, RobotError, UsageError

if TYPE_CHECKING:  # these load numpy, which a usage error must not wait for
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.elastic.estimate import ElasticEstimate
    from symid.estimators.estimate import Estimate
    from symid.friction.results import FrictionIdentification
    from symid.robot.description import Robot

__all__ = [
    "check_distinct",
    "check_output",
    "describe_logs",
    "describe_origin",
    "describe_settings",
    "load_robot",
    "load_robot_library",
    "load_robot_of_estimate",
    "read_fit_logs",
    "read_logs",
    "read_one_log",
    "show_path",
]


def load_robot(
    name: str,
    settings: Sequence[tuple[str, str]] = (),
    friction: str | None = None,
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float | None = None,
) -> "Robot":
    """Return the robot of a name or path, with settings of the command line in place of the file's.

    Args:
        name: a name, or the path of a TOML or URDF file.
        settings: keys and values.
        friction: the friction model of all joints.
        base: the link of a URDF to start from.
        tip: the link of a URDF to end at.
        snap: angle in rad within which rotations of a URDF become multiples of pi/2.

    Raises:
        UsageError: there is no such robot, or a setting cannot be made here.
        RobotError: the file is wrong.
    """
    from symid.formats.locate import find_robot_file, is_urdf

    path = find_robot_file(name)
    if is_urdf(path):
        from symid.formats.urdf import SNAP, read_urdf

        robot = read_urdf(path, base=base, tip=tip, snap=SNAP if snap is None else snap)
    else:
        _refuse_cut(path, base=base, tip=tip, snap=snap)
        from symid.formats.toml import read_robot

        robot = read_robot(path)
    return _override(robot, settings, friction) if settings or friction else robot


def _refuse_cut(path: Path, **options: object) -> None:
    for option, value in options.items():
        if value is not None:
            what = "rounded" if option == "snap" else "cut at its links"
            remedy = "write the angles exactly" if option == "snap" else "leave the joints out of the file"
            text = f"--{option} {value}: only a URDF is {what}; leave the option out, or {remedy}"
            raise UsageError(Notice(code="usage.no-urdf", text=text, file=str(path)))


def _override(robot: "Robot", settings: Sequence[tuple[str, str]], friction: str | None) -> "Robot":
    """Return `robot` with other settings; what is wrong with one is wrong with the call, not the file."""
    from symid.formats.overrides import override_robot

    try:
        return override_robot(robot, settings, friction)
    except RobotError as error:
        raise UsageError(*error.notices) from error


def load_robot_library(robot: "Robot", console: Console) -> "Library":
    """Return the robot's compiled functions, from the cache or made now."""
    from symid.codegen.cache import prepare_library

    return prepare_library(robot, progress=console.progress)


def read_logs(paths: Sequence[Path], robot: "Robot") -> tuple["Recording", ...]:
    """Return the recordings, those of all runs where a file lists them; all logs are read first.

    Raises:
        LogError: with what is wrong with any of them.
    """
    from symid.data.runs import read_log_runs
    from symid.errors import LogError

    recordings: list[Recording] = []
    notices: list[Notice] = []
    for path in paths:
        try:
            recordings += read_log_runs(path, robot)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(recordings)


def read_one_log(path: Path, robot: "Robot", alone: str = "") -> "Recording":
    """Return the one recording at `path`, of which a file of runs may list no more.

    Args:
        path: of a log, or of a file of runs.
        robot: its `[log]` map says which column is what.
        alone: what cannot take a known payload into account, for the message; "" where it can be.

    Raises:
        UsageError: the file lists several runs.
        LogError: with what is wrong with the log.
    """
    from symid.data.runs import refuse_loads

    recordings = read_logs((path,), robot)
    if len(recordings) > 1:
        text = f"lists {len(recordings)} runs, and one log is tried at a time: name one of them"
        raise UsageError(Notice(code="usage.one-log", text=text, file=str(path)))
    if alone:
        refuse_loads(recordings, alone)
    return recordings[0]


def read_fit_logs(paths: Sequence[Path], robot: "Robot") -> tuple["Recording", ...]:
    """Return the recordings for one fit: each log once, and no two payloads.

    Raises:
        UsageError: a log is given twice.
        LogError: with what is wrong with any of them.
    """
    from symid.data.runs import check_one_payload, list_files

    check_distinct([file for path in paths for file in list_files((path,), robot)])
    recordings = read_logs(paths, robot)
    check_one_payload(recordings)
    return recordings


def describe_logs(robot: "Robot", recordings: Sequence["Recording"]) -> dict[str, object]:
    """Return for the echo in a result what was read: the log map, the files' digests, the runs' settings."""
    from symid.data.runs import describe_runs
    from symid.identification.validate import find_digest

    return {
        "log": describe_settings(robot)["log"],
        "log_digests": [find_digest(recording.source) for recording in recordings],
        **describe_runs(recordings),
    }


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse a log that is given twice: it would count double, and its noise as less than it is.

    Raises:
        UsageError: two paths lead to one file, or to files of the same content.
    """
    from symid.identification.validate import find_digest

    seen: dict[object, Path] = {}
    for path in paths:
        for mark in {path.resolve(), find_digest(str(path)) or path.resolve()}:
            if mark in seen:
                text = f"the same log as {seen[mark]}; give each log once"
                raise UsageError(Notice(code="usage.same-log", text=text, file=str(path)))
        seen |= {path.resolve(): path, find_digest(str(path)) or path.resolve(): path}


def load_robot_of_estimate(
    name: str,
    estimate: "Estimate | ElasticEstimate | FrictionIdentification",
    settings: Sequence[tuple[str, str]],
) -> "Robot":
    """Return the robot as it was when identified: with the estimate's friction, log map and processing.

    Settings of the command line come last, and win. Where the estimate's differ from the robot file's,
    a notice of the robot says so. What the fit chose from its logs is left open again: it holds for logs with
    the sample period of the fit (`settle_as_fitted`).

    Raises:
        UsageError, RobotError: see `load_robot`.
        EstimateError: what the estimate says of its log or processing cannot be read.
    """
    # That of elastic joints and that of friction do not say friction models; their signatures do.
    kinds: set[str] = set(getattr(estimate, "friction", ()))
    # Joints with different models have them from the file: the command line sets one for all.
    described = load_robot(name, friction=kinds.pop() if len(kinds) == 1 else None)
    robot = _restore_settings(described, estimate.settings)
    notices = _compare_settings(described, robot, {key for key, _ in settings})
    robot = replace(robot, notices=(*robot.notices, *notices))
    return _override_fitted(robot, estimate.settings, settings) if settings else robot


def _override_fitted(
    robot: "Robot", fitted: Mapping[str, object], settings: Sequence[tuple[str, str]]
) -> "Robot":
    """Return the robot of an estimate with settings of the command line.

    No filter and no decimation, where they are set, are no gaps to fill: then all is as in the fit.
    """
    changed = _override(robot, settings, None)
    processing = changed.processing
    empty = {
        "processing.filter_cutoff": processing.filter_cutoff is None,
        "processing.decimation.factor": processing.decimation.factor == 1,
    }
    if not processing.automatic or not any(empty.get(key, False) for key, _ in settings):
        return changed
    return _override(_restore_settings(robot, {**fitted, "chosen": []}), settings, None)


def _restore_settings(robot: "Robot", settings: Mapping[str, object]) -> "Robot":
    """Return `robot` with the log map and the processing of an estimate, checked like those of a file."""
    from symid.formats.positions import Place, Places
    from symid.formats.section import Report, Section
    from symid.formats.settings import read_log, read_processing

    if not isinstance(settings.get("processing"), Mapping):
        text = "its settings have no usable 'processing'; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))
    values = {key: _make_exact(settings[key]) for key in ("log", "processing") if key in settings}
    values["processing"] = _leave_open(values["processing"], settings.get("chosen", ()))
    report = Report(Places(keys={}, values={}, whole=Place("", 0, 0)))
    root = Section(values=values, path=(), report=report)
    log = read_log(root, robot.joints) if "log" in values else robot.log
    restored = replace(robot, log=log, processing=read_processing(root))
    if report.errors:
        texts = (f"its settings cannot be used: {notice.text}; identify again" for notice in report.errors)
        raise EstimateError(*(Notice(code="estimate.settings", text=text) for text in texts))
    return restored


def _leave_open(processing: object, chosen: object) -> object:
    """Return the processing without what the fit chose from its logs."""
    if not isinstance(processing, Mapping) or not isinstance(chosen, Sequence) or not chosen:
        return processing
    table = {**processing, "automatic": True}
    if "filter_cutoff" in chosen:
        table["filter_cutoff"] = "none"
    if "decimation.factor" in chosen and isinstance(table.get("decimation"), Mapping):
        table["decimation"] = {**table["decimation"], "factor": 1}
    return table


def _make_exact(value: object) -> object:
    """Return `value` as a robot file would give it: numbers as decimals, "none" for null."""
    match value:
        case None:
            return "none"
        case float():
            return Decimal(repr(value))
        case Mapping():
            return {str(key): _make_exact(entry) for key, entry in value.items()}
        case list():
            return [_make_exact(entry) for entry in value]
    return value


def _compare_settings(described: "Robot", restored: "Robot", overridden: set[str]) -> tuple[Notice, ...]:
    """Return what the estimate and the robot file say differently, but for what is set by hand anyway."""
    of_file, of_estimate = _flatten(describe_settings(described)), _flatten(describe_settings(restored))
    notices = []
    for key in sorted({*of_file, *of_estimate} - overridden):
        mine, other = of_estimate.get(key, "nothing"), of_file.get(key, "nothing")
        if mine != other:
            text = f"{key}: the estimate has {mine}, the robot file {other}; the estimate was followed"
            notices.append(Notice(code="estimate.settings-differ", text=text))
    return tuple(notices)


def _flatten(value: object, prefix: str = "") -> dict[str, object]:
    if not isinstance(value, Mapping):
        return {prefix: value}
    parts = (_flatten(entry, f"{prefix}.{key}" if prefix else str(key)) for key, entry in value.items())
    return {key: entry for part in parts for key, entry in part.items()}


def describe_settings(robot: "Robot") -> dict[str, object]:
    """Return the log map and the processing as they are used, for the echo in a result."""
    from symid.formats.settings import list_log, list_processing

    return {"log": _simplify(list_log(robot.log)), "processing": _simplify(list_processing(robot.processing))}


def _simplify(value: object) -> object:
    """Return `value` with the reader's decimal numbers as floats."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case Mapping():
            return {str(key): _simplify(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_simplify(entry) for entry in value]
    return float(str(value))


def check_output(path: Path | None, *, force: bool, inputs: Sequence[Path | str] = ()) -> None:
    """Refuse to write over a file, before the work is done and not after.

    Raises:
        OutputError: the file exists and --force is not given, it is one of `inputs` (--force or not),
            or its folder does not exist.
    """
    if path is None:
        return
    if path.resolve() in {Path(entry).resolve() for entry in inputs} or any(
        _is_same_file(path, entry) for entry in inputs
    ):
        text = "is an input of this call and would be destroyed; give another name"
        raise OutputError(Notice(code="output.is-input", text=text, file=str(path)))
    if os.path.lexists(path) and not force:
        text = "exists already; give another name, or --force to write over it"
        raise OutputError(Notice(code="output.exists", text=text, file=str(path)))
    if not os.path.isdir(path.parent):  # noqa: PTH112  Path.is_dir fails on names that are too long
        text = f"the folder {path.parent} does not exist; make it first"
        raise OutputError(Notice(code="output.no-folder", text=text, file=str(path)))


def _is_same_file(path: Path, other: Path | str) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False


def describe_origin(robot: "Robot", library: "Library", recordings: Sequence["Recording"]) -> tuple[str, ...]:
    """Return in short texts what a report was made from; the same input gives the same texts."""
    texts = [f"robot {robot.name} of {robot.path}"]
    if robot.source:
        texts.append(f"its source: {robot.source}")
    texts.append(f"functions run as {library.backend}")
    texts += [
        f"{entry.source}: {entry.time[-1] - entry.time[0]:.6g} s at {1.0 / entry.period:.6g} Hz"
        for entry in recordings
    ]
    return tuple(texts)


def show_path(path: Path) -> str:
    """Return the path as people type it: relative, where it is below the working folder."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
