"""Logs of one call: all read before anything is done, each once, all mistakes at once.

Input: paths of logs or of files that list runs, or recordings. Output: recordings.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from symid.data.recording import Recording
from symid.data.runs import check_one_payload, describe_runs, list_files, read_log_runs, refuse_loads
from symid.errors import LogError, Notice, UsageError
from symid.formats.settings import describe_settings
from symid.provenance import find_file_digest, find_signature
from symid.robot.description import Robot

__all__ = [
    "IN_MEMORY",
    "check_distinct",
    "check_distinct_samples",
    "describe_logs",
    "find_digests",
    "gather_fit_recordings",
    "gather_recordings",
    "is_fitted",
    "read_one_log",
]

IN_MEMORY = "samples:"
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
    recordings = gather_recordings((log,), robot)
    if len(recordings) > 1:
        text = f"lists {len(recordings)} runs, and one log is tried at a time: name one of them"
        raise UsageError(Notice(code="usage.one-log", text=text, file=str(log)))
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
    """Return the digests of the files behind recordings; of torques, marked so, where there is none."""
    return [
        find_file_digest(entry.source) or f"{IN_MEMORY}{find_signature(entry.torque)}" for entry in recordings
    ]


def is_fitted(recording: Recording, sources: Sequence[str], settings: Mapping[str, object]) -> bool:
    """Return whether a recording is one of the logs of a fit, by its content or by its file.

    Args:
        recording: the log.
        sources: of the fit.
        settings: of the fit; their "log_digests" are those of `find_digests`.
    """
    if not recording.source:
        return False
    stored = settings.get("log_digests")
    known = [str(digest) for digest in stored if digest] if isinstance(stored, list | tuple) else []
    if find_digests((recording,))[0] in known:
        return True
    # Logs that were made in memory may have the same name; only their content tells.
    named = Path(recording.source).resolve() in {Path(source).resolve() for source in sources}
    return named and (not known or os.path.isfile(recording.source))  # noqa: PTH113


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
            if isinstance(entry, Path):
                found += read_log_runs(entry, robot, uneven=uneven)
            else:
                _check_joints(entry, robot)
                found.append(entry)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(found)


def _check_joints(recording: Recording, robot: Robot) -> None:
    """Refuse what was read for a robot with another number of joints."""
    joints = recording.position.shape[1]
    if joints != robot.freedom:
        text = f"has {joints} joints, the robot {robot.name!r} has {robot.freedom}; read it with this robot"
        raise LogError(Notice(code="log.joints", text=text, file=recording.source))


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
    # Of what was made in memory the source may be any text, of which Path.is_file makes an error.
    named = [path for path in others if os.path.isfile(path)]  # noqa: PTH113
    check_distinct([*(file for path in files for file in list_files((path,), robot)), *named])
    recordings = gather_recordings(logs, robot)
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
