"""Several logs as one set: a small TOML file that says what holds for each run alone.

Input: the path of a log, or of a `.toml` with `[[run]]` tables. Output: recordings with their `RunSettings`.

    [[run]]
    file = "monday.npz"            # beside this file, or a whole path
    weight = 2                     # what the squares of its residuals count for; 1
    drop_first = 500               # samples cut off before anything else; 0
    drop_last = 0
    payload = "gripper"            # the name of what the robot carries; none
    offset = [0, "0.2 deg"]        # rad or m, one number or one a joint, added to the positions

Supported: as many runs as wanted, of one file each; a file may come twice with other samples.
Not supported: other columns or units for single runs: they have the `[log]` of the robot file in common.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import asdict, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from symid.data.cuts import cut_ends
from symid.data.payloads import read_payload
from symid.data.readers import read_recording
from symid.data.recording import Recording, RunSettings
from symid.data.table import refuse_file
from symid.errors import LogError, Notice, RobotError
from symid.formats.constants import read_constant
from symid.formats.positions import find_places
from symid.formats.section import (
    NOT_NEGATIVE,
    POSITIVE,
    Report,
    Section,
    read_integer,
    read_number,
    read_text,
    refuse_unknown_keys,
)
from symid.formats.text_file import read_text_file
from symid.robot.description import Robot

__all__ = [
    "check_one_payload",
    "describe_runs",
    "find_weights",
    "list_files",
    "read_log_runs",
    "read_recorded_runs",
    "read_runs",
    "refuse_loads",
]

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
    recordings: list[Recording] = []
    notices: list[Notice] = []
    runs, warnings = _parse_runs(path, robot)
    for run in runs:
        try:
            recordings.append(_apply(read_recording(Path(run.file), robot, uneven=uneven), run))
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    first, *others = recordings
    return (replace(first, notices=(*warnings, *first.notices)), *others)


def list_files(paths: Sequence[Path], robot: Robot) -> tuple[Path, ...]:
    """Return the log files behind `paths`, those of runs in place of their `.toml`.

    Raises:
        LogError: a file of runs is wrong.
    """
    found: list[Path] = []
    for path in paths:
        if path.suffix.lower() == _SUFFIX:
            found += [Path(run.file) for run in read_runs(path, robot)]
        else:
            found.append(path)
    return tuple(dict.fromkeys(found))


def read_runs(path: Path, robot: Robot) -> tuple[RunSettings, ...]:
    """Return the runs that the file at `path` lists.

    Raises:
        LogError: with a notice for each mistake, at its place.
    """
    return _parse_runs(path, robot)[0]


def _parse_runs(path: Path, robot: Robot) -> tuple[tuple[RunSettings, ...], tuple[Notice, ...]]:
    """Return the runs of a file, and what is odd in it."""
    try:
        text = read_text_file(path).replace("\r\n", "\n")
        values = tomllib.loads(text, parse_float=Decimal)
    except RobotError as error:
        raise LogError(*map(_rename, error.notices)) from error
    except tomllib.TOMLDecodeError as error:
        raise refuse_file(str(path), f"not valid TOML: {error}", "runs.syntax") from error
    report = Report(find_places(text, str(path)))
    root = Section(values=values, path=(), report=report)
    refuse_unknown_keys(root, ("run",))
    tables: Any = values.get("run")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        root.refuse_key("runs.no-run", "run", 'there is none; write [[run]] and file = "log.npz" below it')
        tables = []
    runs = tuple(
        _read_run(
            Section(values=table, path=("run", index), report=report, label=f"run {index + 1}"), path, robot
        )
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
    payload = read_payload(section, robot)
    return RunSettings(
        file=str(path.parent / (file or "")),
        weight=1.0 if weight is None else float(weight),
        drop_first=read_integer(section, "drop_first", NOT_NEGATIVE) or 0,
        drop_last=read_integer(section, "drop_last", NOT_NEGATIVE) or 0,
        payload=payload.name,
        load=payload.load,
        offset=_read_offset(section, robot.freedom),
    )


def _read_offset(section: Section, size: int) -> tuple[float, ...]:
    value: Any = section.values.get("offset")
    if not isinstance(value, list):
        return (read_constant(section, "offset", "rad or m") or 0.0,)
    if len(value) not in (1, size):
        text = f"{len(value)} offsets for {size} joints; give one for each joint, or one for all"
        section.refuse("robot.column-count", "offset", text)
        return (0.0,)
    return tuple(read_constant(section, "offset", "rad or m", index) or 0.0 for index in range(len(value)))


def _apply(recording: Recording, run: RunSettings) -> Recording:
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


def find_weights(recordings: Sequence[Recording]) -> tuple[float, ...] | None:
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
    runs = _restore_runs(sources, told, robot.freedom)
    recordings: list[Recording] = []
    notices: list[Notice] = []
    for source, run in zip(sources, runs, strict=True):
        try:
            recording = read_recording(Path(source), robot)
            recordings.append(recording if run is None else _apply(recording, run))
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(recordings)


def _restore_runs(sources: Sequence[str], told: object, size: int) -> list[RunSettings | None]:
    if told is None:
        return [None] * len(sources)
    entries: list[Any] = list(told) if isinstance(told, list | tuple) else []
    found = [_restore_run(entry, size) if entry else None for entry in entries]
    if len(entries) != len(sources) or any(
        entry and not run for entry, run in zip(entries, found, strict=True)
    ):
        text = (
            f"the settings of the runs cannot be used: expected one table for each of {len(sources)} logs, "
            f"with {', '.join(_KEYS)}, got {told!r}; identify again"
        )
        raise LogError(Notice(code="runs.settings", text=text))
    return found


def _restore_run(entry: object, size: int) -> RunSettings | None:
    """Return the settings of a run as `describe_runs` told them, None where that is not what `entry` is."""
    if not isinstance(entry, dict) or set(entry) - {"load"} != set(_KEYS):
        return None
    offset, load = entry["offset"], entry.get("load", [])
    usable = (
        all(isinstance(entry[key], str) for key in ("file", "payload"))
        and all(type(entry[key]) is int and entry[key] >= 0 for key in ("drop_first", "drop_last"))
        and isinstance(offset, list | tuple)
        and len(offset) in (1, size)
        and isinstance(load, list | tuple)
        and all(type(value) in (int, float) for value in (entry["weight"], *offset, *load))
    )
    if not usable:
        return None
    return RunSettings(**{**entry, "offset": tuple(map(float, offset)), "load": tuple(map(float, load))})


def check_one_payload(recordings: Sequence[Recording]) -> None:
    """Refuse runs with different payloads for a fit of one set of parameters, but for those that are known.

    Raises:
        LogError: there is more than one payload.
    """
    names = sorted({_name_payload(recording.run) for recording in recordings})
    if len(names) > 1:
        listed = ", ".join(repr(name) if name else "none" for name in names)
        text = (
            f"the runs carry different payloads ({listed}), and base parameters hold for one of them: "
            "state mass, com and inertia of those that are known, or identify the parameters with each "
            "payload alone, and give the estimates to `symid payload`"
        )
        raise LogError(Notice(code="log.payloads-differ", text=text))


def _name_payload(run: RunSettings | None) -> str:
    return "" if run is None or run.load else run.payload


def refuse_loads(recordings: Sequence[Recording], what: str) -> None:
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
