"""Parts of recordings: what is left when samples at either end are cut off.

Input: `Recording`, numbers of samples. Output: a shorter `Recording`, with a notice that says so.

Supported: every channel of a recording, and those of its other columns that have a value a sample.
Not supported: pieces from the middle.
"""

from dataclasses import replace
from typing import Any

from symid.data.recording import OPTIONAL_CHANNELS, Recording
from symid.errors import LogError, Notice

__all__ = ["cut_ends", "cut_recording"]

_FEWEST = 3
"""Samples that central differences need."""


def cut_ends(recording: Recording, first: int, last: int) -> Recording:
    """Return the recording without its first and last samples; as it is where both numbers are 0.

    Raises:
        LogError: less than three samples would be left.
    """
    if not first and not last:
        return recording
    count = len(recording.time)
    left = count - first - last
    if left < _FEWEST:
        text = (
            f"the log has {count} samples; cutting off the first {first} and the last {last} leaves "
            f"{max(left, 0)}, and {_FEWEST} are needed at least: cut off less"
        )
        raise LogError(Notice(code="log.too-short", text=text, file=recording.source))
    text = f"the first {first} and the last {last} of {count} samples were cut off, as the settings ask for"
    notice = Notice(code="log.cut", text=text, file=recording.source)
    cut = cut_recording(recording, slice(first, count - last))
    return replace(cut, notices=(*cut.notices, notice))


def cut_recording(recording: Recording, kept: slice) -> Recording:
    """Return the samples `kept` of every channel."""
    count = len(recording.time)
    whole: dict[str, Any] = {name: getattr(recording, name) for name in OPTIONAL_CHANNELS}
    channels: dict[str, Any] = {
        name: None if values is None else values[kept] for name, values in whole.items()
    }
    return replace(
        recording,
        time=recording.time[kept],
        position=recording.position[kept],
        torque=recording.torque[kept],
        **channels,
        extras={
            name: values[kept] if len(values) == count else values
            for name, values in recording.extras.items()
        },
    )
