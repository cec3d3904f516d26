"""What the logs of a fit tell beyond its parameters: read again with the settings of the fit and of each run.

Input: a robot, an estimate. Output: `Diagnosis`.
"""

from dataclasses import replace

from symid.data.logs import IN_MEMORY
from symid.data.runs import read_recorded_runs
from symid.elastic.motor_side import build_motor_recording, build_rigid_estimate, build_rigid_variant
from symid.errors import LogError, Notice
from symid.estimators.estimate import Estimate
from symid.identification.diagnosis import Diagnosis, diagnose_estimate
from symid.identification.fitted_robot import restore_robot
from symid.provenance import find_file_digest
from symid.robot.description import Robot
from symid.tasks.identify import Workshop

__all__ = ["diagnose_fit"]


def diagnose_fit(robot: Robot, estimate: Estimate, workshop: Workshop) -> Diagnosis:
    """Return the diagnosis of a fit by its own logs, which are where they were when it was made.

    Args:
        robot: as read.
        estimate: of base parameters.
        workshop: library and progress.

    Raises:
        LogError: a log was no file, is not there any more, or does not fit the robot.
        UsageError: its rows mix the joints.
    """
    _check_files(estimate)
    fitted = restore_robot(robot, estimate)
    tried = build_rigid_estimate(estimate, fitted)
    library = workshop.prepare(build_rigid_variant(fitted))
    read = read_recorded_runs(estimate.sources, estimate.settings.get("runs"), fitted)
    recordings = [build_motor_recording(entry, fitted) for entry in read]
    workshop.progress(f"diagnosing the fit to {len(recordings)} log{'s'[: len(recordings) > 1]}")
    found = diagnose_estimate(tried, library, recordings, fitted.processing)
    return replace(found, notices=(*_list_changed(estimate), *found.notices))


def _list_digests(estimate: Estimate) -> list[object]:
    digests = estimate.settings.get("log_digests")
    return [*digests] if isinstance(digests, list | tuple) else []


def _check_files(estimate: Estimate) -> None:
    """Refuse a fit to logs that were made in memory: they cannot be read again.

    Raises:
        LogError: with each of them.
    """
    text = "is no file that could be read again; save the log, and identify from the file"
    notices = [
        Notice(code="diagnosis.no-file", text=text, file=source)
        for source, digest in zip(estimate.sources, _list_digests(estimate), strict=False)
        if not digest or str(digest).startswith(IN_MEMORY)
    ]
    if notices:
        raise LogError(*notices)


def _list_changed(estimate: Estimate) -> tuple[Notice, ...]:
    """Return a notice for every log of the fit whose content is another one now."""
    known = _list_digests(estimate)
    text = "is not the file that it was when the estimate was made; identify again, or put the old one back"
    return tuple(
        Notice(code="diagnosis.changed-log", text=text, file=source)
        for source, digest in zip(estimate.sources, known, strict=False)
        if find_file_digest(source) != digest
    )
