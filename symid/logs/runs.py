"""Logs of one call: several runs as one set, each log read once, all mistakes at once.

Paths of logs or of `.toml` files that list runs, or recordings -> recordings with their RunSettings.

    [[run]]
    file = "monday.npz"            # beside this file, or a whole path
    weight = 2                     # what the squares of its residuals count for; 1
    drop_first = 500               # samples cut off before anything else; 0
    drop_last = 0
    payload = "gripper"            # the name of what the robot carries; none
    offset = [0, "0.2 deg"]        # rad or m, one number or one a joint, added to the positions

A payload that is known is a table in place of a name; its body stands in the frame that the robot file
gives to the link, as in `[joint.link]`, and `joint` is the last one if it is not named:

    payload = { name = "disc", joint = "elbow", mass = 1.2, com = [0, 0, 0.05], inertia = { xx = 0.01 } }

It adds K_link pi to the base parameters, beta_loaded = beta + K_link pi: its torques are known, and leave
the equations.

Supported: as many runs as wanted, of one file each; a file may come twice with other samples; payloads on
any link, as mass, centre and inertia or as standard parameters; a name alone for what is not known.
Not supported: other columns or units for single runs, which have the `[log]` of the robot file in common;
a payload of bodies on several links.
"""

import os
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from symid.errors import InputError, LogError, Notice, RobotError, UsageError
from symid.logs.files import refuse_file
from symid.logs.reader import read_recording
from symid.logs.recording import Recording, RunSettings, cut_ends
from symid.notation import INERTIAL
from symid.robot import (
    NOT_NEGATIVE,
    POSITIVE,
    InputReport,
    Robot,
    Section,
    Symbols,
    describe_settings,
    locate_values,
    read_body,
    read_integer,
    read_number,
    read_offset,
    read_text,
    read_text_file,
    refuse_unknown_keys,
)
from symid.serialization import compute_file_digest, compute_signature, read_record, write_plain

T = TypeVar("T")
_KEY = "payload"


def read_payload(section: Section, robot: Robot) -> tuple[str, tuple[float, ...]]:
    """Return a payload's name, and what it adds to beta (p,): nothing where it is not known.

    Mistakes go to the report of the section.
    """
    value = section.values.get(_KEY)
    if not isinstance(value, dict):
        return read_text(section, _KEY) or "", ()
    names = [joint.name for joint in robot.joints]
    inner = section.inside(value, "payload", _KEY)
    joint = read_text(inner, "joint") or names[-1]
    name = read_text(inner, "name") or _KEY
    if joint not in names:
        inner.refuse(
            "runs.unknown-joint", "joint", f"there is no joint {joint!r}; allowed are {', '.join(names)}"
        )
        return name, ()
    link = names.index(joint)
    symbols = Symbols(values=dict(robot.symbols))
    parameters, _ = read_body(section, _KEY, robot.joints[link].frame, symbols, ("name", "joint"))
    if parameters is None:
        return name, ()
    from symid.dynamics import build_grouping, derive_base_parameters

    grouping = build_grouping(robot, derive_base_parameters(robot))
    columns = [grouping.labels.index((link, key)) for key in INERTIAL]
    return name, tuple(map(float, grouping.matrix[:, columns] @ np.array(parameters)))


def _read_all(logs: Iterable[T], read: Callable[[T], Iterable[Recording]]) -> tuple[Recording, ...]:
    """Return the recordings that `read` gives for each of `logs`.

    Raises:
        LogError: with what is wrong with any of them.
    """
    recordings: list[Recording] = []
    notices: list[Notice] = []
    for log in logs:
        try:
            recordings += read(log)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(recordings)


_SUFFIX = ".toml"
_KEYS = ("file", "weight", "drop_first", "drop_last", "payload", "offset")


def read_log_runs(path: Path, robot: Robot, *, uneven: bool = False) -> tuple[Recording, ...]:
    """Return the recording of a log, or those of all runs of a `.toml`.

    Args:
        path: of a log, or of a file with `[[run]]` tables.
        robot: its `[log]` map says which column is what.
        uneven: as for `read_recording`.

    Raises:
        LogError: with all that is wrong with the file of runs, or with any log.
    """
    if path.suffix.lower() != _SUFFIX:
        return (read_recording(path, robot, uneven=uneven),)
    runs, warnings = _parse_runs(path, robot)
    first, *others = _read_all(
        runs, lambda run: [_apply_settings(read_recording(Path(run.file), robot, uneven=uneven), run)]
    )
    return (replace(first, notices=(*warnings, *first.notices)), *others)


def list_log_files(paths: Sequence[Path], robot: Robot) -> tuple[Path, ...]:
    """Return the log files behind `paths`, those of runs in place of their `.toml`.

    Raises:
        LogError: a file of runs is wrong.
    """
    found: list[Path] = []
    for path in paths:
        if path.suffix.lower() == _SUFFIX:
            found += [Path(run.file) for run in _parse_runs(path, robot)[0]]
        else:
            found.append(path)
    return tuple(dict.fromkeys(found))


def _parse_runs(path: Path, robot: Robot) -> tuple[tuple[RunSettings, ...], tuple[Notice, ...]]:
    """Return the runs that a file lists, and what is odd in it.

    Raises:
        LogError: with a notice for each mistake, at its place.
    """
    try:
        text = read_text_file(path).replace("\r\n", "\n")
        values = tomllib.loads(text, parse_float=Decimal)
    except RobotError as error:
        raise LogError(*map(_rename, error.notices)) from error
    except tomllib.TOMLDecodeError as error:
        raise refuse_file(str(path), f"not valid TOML: {error}", "runs.syntax") from error
    report = InputReport(locate_values(text, str(path)))
    root = Section(values=values, path=(), report=report)
    refuse_unknown_keys(root, ("run",))
    tables: Any = values.get("run")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        root.refuse_key("runs.no-run", "run", 'there is none; write [[run]] and file = "log.npz" below it')
        tables = []
    runs = tuple(
        _read_run(root.inside(table, f"run {index + 1}", "run", index), path, robot)
        for index, table in enumerate(tables)
    )
    if report.errors:
        raise LogError(*map(_rename, report.notices()))
    return runs, tuple(map(_rename, report.remarks()))


def _rename(notice: Notice) -> Notice:
    """Return the notice with a code of its own: the file is no robot file."""
    return replace(notice, code=notice.code.replace("robot.", "runs.", 1))


def _read_run(section: Section, path: Path, robot: Robot) -> RunSettings:
    refuse_unknown_keys(section, _KEYS)
    file = read_text(section, "file")
    if "file" not in section.values:
        section.refuse_key("runs.missing-key", "file", 'missing; write file = "log.npz"')
    weight = read_number(section, "weight", "", POSITIVE)
    payload, load = read_payload(section, robot)
    return RunSettings(
        file=str(path.parent / (file or "")),
        weight=1.0 if weight is None else float(weight),
        drop_first=read_integer(section, "drop_first", NOT_NEGATIVE) or 0,
        drop_last=read_integer(section, "drop_last", NOT_NEGATIVE) or 0,
        payload=payload,
        load=load,
        offset=read_offset(section, robot.freedom) or (0.0,),
    )


def _apply_settings(recording: Recording, run: RunSettings) -> Recording:
    """Return the recording cut and moved as the run says, with notices that say so."""
    cut = cut_ends(recording, run.drop_first, run.drop_last)
    if run.load:
        text = f"the torque of the payload {run.payload!r}, which is known, is taken off the measured one"
        notice = Notice(code="log.payload", text=text, file=recording.source)
        cut = replace(cut, notices=(*cut.notices, notice))
    if any(run.offset):
        added = ", ".join(f"{value:.10g}" for value in run.offset)
        text = f"{added} was added to the positions, as the run asks for"
        notice = Notice(code="log.offset", text=text, file=recording.source)
        offset = np.array(run.offset)
        reference = None if cut.reference is None else cut.reference + offset
        cut = replace(
            cut, position=cut.position + offset, reference=reference, notices=(*cut.notices, notice)
        )
    return replace(cut, run=run)


def get_run_weights(recordings: Sequence[Recording]) -> tuple[float, ...] | None:
    """Return what the squares of each recording's residuals count for; None where all count alike."""
    weights = tuple(1.0 if recording.run is None else recording.run.weight for recording in recordings)
    return None if len(set(weights)) == 1 else weights


def describe_runs(recordings: Sequence[Recording]) -> dict[str, object]:
    """Return the settings of the runs for the echo in a result; nothing where there are none."""
    runs = [recording.run for recording in recordings]
    if not any(runs):
        return {}
    return {"runs": [{} if run is None else asdict(run) for run in runs]}


def read_recorded_runs(sources: Sequence[str], told: object, robot: Robot) -> tuple[Recording, ...]:
    """Return the recordings behind a result, read again with the settings of their runs.

    Args:
        sources: the files, one a run, in the order of the fit.
        told: what `describe_runs` put into the result under "runs"; None where it put nothing.
        robot: its `[log]` map says which column is what.

    Raises:
        LogError: with what is wrong with any log, or with `told`.
    """

    def read(log: tuple[str, RunSettings | None]) -> list[Recording]:
        recording, run = read_recording(Path(log[0]), robot), log[1]
        return [recording if run is None else _apply_settings(recording, run)]

    return _read_all(zip(sources, _restore_runs(sources, told, robot.freedom), strict=True), read)


def _restore_runs(sources: Sequence[str], told: object, size: int) -> list[RunSettings | None]:
    if told is None:
        return [None] * len(sources)
    entries = write_plain(told)
    try:
        found = [
            read_record(RunSettings, entry) if entry else None
            for entry in (entries if isinstance(entries, list) else [])
        ]
    except InputError:
        found = []
    known = [run for run in found if run is not None]
    if len(found) != len(sources) or not all(
        min(run.drop_first, run.drop_last) >= 0 and len(run.offset) in (1, size) for run in known
    ):
        text = (
            f"the settings of the runs cannot be used: expected one table for each of {len(sources)} logs, "
            f"with {', '.join(_KEYS)}, got {told!r}; identify again"
        )
        raise LogError(Notice(code="runs.settings", text=text))
    return found


def check_one_payload(recordings: Sequence[Recording]) -> None:
    """Refuse runs with different payloads for a fit of one set of parameters, but for those that are known.

    Raises:
        LogError: there is more than one payload.
    """
    runs = [recording.run for recording in recordings]
    names = sorted({"" if run is None or run.load else run.payload for run in runs})
    if len(names) > 1:
        listed = ", ".join(repr(name) if name else "none" for name in names)
        text = (
            f"the runs carry different payloads ({listed}), and base parameters hold for one of them: "
            "state mass, com and inertia of those that are known, or identify the parameters with each "
            "payload alone, and give the estimates to `symid payload`"
        )
        raise LogError(Notice(code="log.payloads-differ", text=text))


def refuse_known_payloads(recordings: Sequence[Recording], what: str) -> None:
    """Refuse known payloads where nothing takes them into account.

    Args:
        recordings: the logs.
        what: the name of what does not, for the message.

    Raises:
        LogError: a run carries a known payload.
    """
    text = (
        f"the run carries a payload that is known, and {what} cannot take it into account; leave the run "
        "out, or use torque rows of a rigid robot"
    )
    loaded = [entry.source for entry in recordings if entry.run is not None and entry.run.load]
    if loaded:
        raise LogError(*(Notice(code="log.known-payload", text=text, file=source) for source in loaded))


IN_MEMORY_PREFIX = "samples:"
"""What the digest of a log begins with that was made in memory, and is no file."""


def read_one_log(log: Path | Recording, robot: Robot, alone: str = "") -> Recording:
    """Return the recording of one log, of which a file of runs may list no more.

    Args:
        log: a file, a file of runs, or what was read before.
        robot: its `[log]` map says which column is what.
        alone: what cannot take a known payload into account, for the message; "" where it can be.

    Raises:
        UsageError: the file lists several runs.
        LogError: with what is wrong with the log.
    """
    recordings = read_recordings((log,), robot)
    if len(recordings) > 1:
        text = f"lists {len(recordings)} runs, and one log is tried at a time: name one of them"
        raise UsageError(Notice(code="usage.one-log", text=text, file=str(log)))
    if alone:
        refuse_known_payloads(recordings, alone)
    return recordings[0]


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse a log that is given twice: it would count double, and its noise as less than it is.

    Raises:
        UsageError: two paths lead to one file, or to files of the same content.
    """
    seen: dict[object, Path] = {}
    for path in paths:
        marks = (path.resolve(), compute_file_digest(str(path)) or path.resolve())
        for mark in marks:
            if mark in seen:
                text = f"the same log as {seen[mark]}; give each log once"
                raise UsageError(Notice(code="usage.same-log", text=text, file=str(path)))
        seen |= dict.fromkeys(marks, path)


def compute_log_digests(recordings: Sequence[Recording]) -> list[str]:
    """Return the digests of the files behind recordings; of torques, marked so, where there is none."""
    return [
        compute_file_digest(entry.source) or f"{IN_MEMORY_PREFIX}{compute_signature(entry.torque)}"
        for entry in recordings
    ]


def is_log_of_fit(recording: Recording, sources: Sequence[str], settings: Mapping[str, object]) -> bool:
    """Return whether a recording is one of the logs of a fit, by its content or by its file.

    Args:
        recording: the log.
        sources: of the fit.
        settings: of the fit; their "log_digests" are those of `compute_log_digests`.
    """
    if not recording.source:
        return False
    stored = settings.get("log_digests")
    known = [str(digest) for digest in stored if digest] if isinstance(stored, list | tuple) else []
    if compute_log_digests((recording,))[0] in known:
        return True
    # Logs that were made in memory may have the same name; only their content tells.
    named = Path(recording.source).resolve() in {Path(source).resolve() for source in sources}
    return named and (not known or os.path.isfile(recording.source))  # noqa: PTH113


def describe_logs(robot: Robot, recordings: Sequence[Recording]) -> dict[str, object]:
    """Return for the echo in a result what was read: the log map, the files' digests, the runs' settings."""
    return {
        "log": describe_settings(robot)["log"],
        "log_digests": compute_log_digests(recordings),
        **describe_runs(recordings),
    }


def read_recordings(
    logs: Sequence[Path | Recording], robot: Robot, *, uneven: bool = False
) -> tuple[Recording, ...]:
    """Return the recordings of logs, those that are files read, all mistakes at once, in their order.

    Args:
        logs: files, files of runs, or what was read before.
        robot: its `[log]` map says which column is what.
        uneven: whether uneven time stamps are left as they are.

    Raises:
        LogError: with what is wrong with any of them.
    """

    def read(log: Path | Recording) -> tuple[Recording, ...]:
        if isinstance(log, Path):
            return read_log_runs(log, robot, uneven=uneven)
        joints = log.position.shape[1]
        if joints != robot.freedom:
            text = (
                f"has {joints} joints, the robot {robot.name!r} has {robot.freedom}; read it with this robot"
            )
            raise LogError(Notice(code="log.joints", text=text, file=log.source))
        return (log,)

    return _read_all(logs, read)


def read_fit_recordings(logs: Sequence[Path | Recording], robot: Robot) -> tuple[Recording, ...]:
    """Return the recordings for one fit: each log once, and no two payloads; see `read_recordings`.

    Raises:
        UsageError: a log is given twice, or none is given.
        LogError: with what is wrong with any of them.
    """
    if not logs:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    files = [entry for entry in logs if isinstance(entry, Path)]
    others = [Path(entry.source) for entry in logs if isinstance(entry, Recording) and entry.run is None]
    # Of what was made in memory the source may be any text, of which Path.is_file makes an error.
    named = [path for path in others if os.path.isfile(path)]  # noqa: PTH113
    check_distinct([*(file for path in files for file in list_log_files((path,), robot)), *named])
    recordings = read_recordings(logs, robot)
    if len(files) < len(logs):
        # Of files the digests were compared.
        check_distinct_samples(recordings)
    check_one_payload(recordings)
    return recordings


def check_distinct_samples(recordings: Sequence[Recording]) -> None:
    """Refuse the same samples twice, which no file need tell of; see `check_distinct`.

    Raises:
        UsageError: two recordings have the same times, positions and torques.
    """
    for place, entry in enumerate(recordings):
        for other in recordings[:place]:
            if entry is other or all(
                np.array_equal(mine, its)
                for mine, its in (
                    (entry.torque, other.torque),
                    (entry.position, other.position),
                    (entry.time, other.time),
                )
            ):
                text = f"the same samples as {other.source}; give each log once"
                raise UsageError(Notice(code="usage.same-log", text=text, file=entry.source))
