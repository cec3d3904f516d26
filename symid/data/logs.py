"""Logs of one call: all read before anything is done, each once, all mistakes at once.

Input: paths of logs, or of files that list runs. Output: recordings.
"""

from collections.abc import Sequence
from pathlib import Path

from symid.data.recording import Recording
from symid.data.runs import check_one_payload, describe_runs, list_files, read_log_runs, refuse_loads
from symid.errors import LogError, Notice, UsageError
from symid.formats.settings import describe_settings
from symid.provenance import find_file_digest
from symid.robot.description import Robot

__all__ = [
    "check_distinct",
    "describe_logs",
    "find_digests",
    "gather_fit_recordings",
    "gather_recordings",
    "read_logs",
    "read_one_log",
]


def read_logs(paths: Sequence[Path], robot: Robot, *, uneven: bool = False) -> tuple[Recording, ...]:
    """Return the recordings, those of all runs where a file lists them; all logs are read first.

    Args:
        paths: of logs, or of files of runs.
        robot: its `[log]` map says which column is what.
        uneven: whether uneven time stamps are left as they are.

    Raises:
        LogError: with what is wrong with any of them.
    """
    return gather_recordings(paths, robot, uneven=uneven)


def read_one_log(path: Path, robot: Robot, alone: str = "") -> Recording:
    """Return the one recording at `path`, of which a file of runs may list no more.

    Args:
        path: of a log, or of a file of runs.
        robot: its `[log]` map says which column is what.
        alone: what cannot take a known payload into account, for the message; "" where it can be.

    Raises:
        UsageError: the file lists several runs.
        LogError: with what is wrong with the log.
    """
    recordings = read_logs((path,), robot)
    if len(recordings) > 1:
        text = f"lists {len(recordings)} runs, and one log is tried at a time: name one of them"
        raise UsageError(Notice(code="usage.one-log", text=text, file=str(path)))
    if alone:
        refuse_loads(recordings, alone)
    return recordings[0]


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse a log that is given twice: it would count double, and its noise as less than it is.

    Raises:
        UsageError: two paths lead to one file, or to files of the same content.
    """
    seen: dict[object, Path] = {}
    for path in paths:
        marks = (path.resolve(), find_file_digest(str(path)) or path.resolve())
        for mark in marks:
            if mark in seen:
                text = f"the same log as {seen[mark]}; give each log once"
                raise UsageError(Notice(code="usage.same-log", text=text, file=str(path)))
        seen |= dict.fromkeys(marks, path)


def find_digests(recordings: Sequence[Recording]) -> list[str]:
    """Return the digests of the files behind recordings, empty for one that is no file."""
    return [find_file_digest(recording.source) for recording in recordings]


def describe_logs(robot: Robot, recordings: Sequence[Recording]) -> dict[str, object]:
    """Return for the echo in a result what was read: the log map, the files' digests, the runs' settings."""
    return {
        "log": describe_settings(robot)["log"],
        "log_digests": find_digests(recordings),
        **describe_runs(recordings),
    }


def gather_recordings(
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
    found: list[Recording] = []
    notices: list[Notice] = []
    for entry in logs:
        try:
            found += read_log_runs(entry, robot, uneven=uneven) if isinstance(entry, Path) else (entry,)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(found)


def gather_fit_recordings(logs: Sequence[Path | Recording], robot: Robot) -> tuple[Recording, ...]:
    """Return the recordings for one fit: each log once, and no two payloads; see `gather_recordings`.

    Raises:
        UsageError: a log is given twice, or none is given.
        LogError: with what is wrong with any of them.
    """
    if not logs:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    files = [entry for entry in logs if isinstance(entry, Path)]
    others = [Path(entry.source) for entry in logs if isinstance(entry, Recording) and entry.run is None]
    named = [path for path in others if path.is_file()]
    check_distinct([*(file for path in files for file in list_files((path,), robot)), *named])
    recordings = gather_recordings(logs, robot)
    check_one_payload(recordings)
    return recordings
