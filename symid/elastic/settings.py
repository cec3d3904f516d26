"""Settings of signals that elastic joints have a use for; the others are refused, or told.

Input: a robot, settings of a call. Output: a cut-off, shorter recordings, notices.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from symid.errors import LogError, Notice, UsageError
from symid.robot.log_map import Processing

if TYPE_CHECKING:  # this loads numpy
    from symid.data.recording import Recording
    from symid.robot.description import Robot

__all__ = ["check_settings", "cut_logs", "find_asked_cutoff", "list_unused_settings"]

_PREFIX = "processing."
_CUTOFF = "filter_cutoff"
_ENDS = ("drop_first", "drop_last")
_USED = {"elastic": (_CUTOFF, *_ENDS), "stiffness": _ENDS}
_WHY = {
    "elastic": "elastic joints are identified at the full rate of the log, with filters of their own",
    "stiffness": "a stiffness is found at the full rate of the log, with a filter of its own",
}
_OPTIONS = {_CUTOFF: "--cutoff", "decimation.factor": "--decimate"}
_OTHERS = ("filter_order", "filter_torque", "standstill", "noise_freedom", "decimation")


def check_settings(settings: Sequence[tuple[str, str]], kind: str) -> None:
    """Refuse settings of a call that have no meaning for `kind`, "elastic" or "stiffness".

    Raises:
        UsageError: there is such a setting.
    """
    names = [key.removeprefix(_PREFIX) for key, _ in settings if key.startswith(_PREFIX)]
    useless = [name for name in dict.fromkeys(names) if name not in _USED[kind]]
    if useless:
        shown = [
            f"{_PREFIX}{name}" + (f" ({_OPTIONS[name]})" if name in _OPTIONS else "") for name in useless
        ]
        text = (
            f"{', '.join(shown)} cannot be used here: {_WHY[kind]}; "
            f"allowed are {', '.join(_PREFIX + name for name in _USED[kind])}; "
            f"leave {'them' if useless[1:] else 'it'} out"
        )
        raise UsageError(Notice(code="usage.elastic-processing", text=text))


def find_asked_cutoff(robot: "Robot", settings: Sequence[tuple[str, str]]) -> float | None:
    """Return the cut-off in Hz that robot file or call state: 0 for no filter, None to choose one."""
    stated = robot.processing.filter_cutoff
    asked = any(key == _PREFIX + _CUTOFF for key, _ in settings)
    return 0.0 if stated is None and asked else stated


def cut_logs(recordings: Sequence["Recording"], processing: Processing) -> tuple["Recording", ...]:
    """Return the recordings without the samples that the settings cut off at either end.

    Raises:
        LogError: with every log of which nothing would be left.
    """
    from symid.data.cuts import cut_ends

    cut: list[Recording] = []
    notices: list[Notice] = []
    for recording in recordings:
        try:
            cut.append(cut_ends(recording, processing.drop_first, processing.drop_last))
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(cut)


def list_unused_settings(robot: "Robot", kind: str) -> tuple[Notice, ...]:
    """Return a notice on the settings of the robot file that `kind`, as above, has no use for."""
    standard = replace(Processing(), automatic=robot.processing.automatic)
    names = (*_OTHERS, *(name for name in (_CUTOFF,) if name not in _USED[kind]))
    unused = [name for name in names if getattr(robot.processing, name) != getattr(standard, name)]
    if not unused:
        return ()
    text = f"[processing] {', '.join(unused)}: not used here: {_WHY[kind]}; used are {', '.join(_USED[kind])}"
    return (Notice(code="identify.unused-processing", text=text, file=robot.path),)
