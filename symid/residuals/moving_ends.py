"""Logs that begin or end in motion: what the position's filter makes of it, and how much to cut off.

Input: processing as used, recordings. Output: a notice for every log whose ends count and should not.

A filter that runs forward and backward continues the position beyond the ends of the log. Where a joint moves
there, its acceleration is not what the continuation supposes, and about two periods of the cut-off are wrong.

Supported: joints that move at an end, by their mean speed over one period of the cut-off.
Not supported: accelerations at an end at rest, which are wrong by less.
"""

import math
from collections.abc import Sequence

import numpy as np

from symid.data.recording import Recording
from symid.errors import Notice
from symid.robot.log_map import Processing

__all__ = ["warn_of_moving_ends"]

_PERIODS = 2.0
"""Of the cut-off that are wrong at an end."""
_MOVING = 0.05
"""Of the top speed, beyond which a joint moves."""


def warn_of_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return which logs begin or end in motion with nothing cut off there.

    Args:
        processing: as used, its cut-off in Hz and the samples cut at either end.
        recordings: of the fit.
    """
    if processing.filter_cutoff is None:
        return ()
    found = (_look(processing, recording) for recording in recordings)
    return tuple(notice for notice in found if notice is not None)


def _look(processing: Processing, recording: Recording) -> Notice | None:
    spoilt = math.ceil(_PERIODS / (processing.filter_cutoff or 1.0) / recording.period)
    span = max(1, round(spoilt / _PERIODS))
    speed = np.abs(recording.position[span:] - recording.position[:-span])
    if len(speed) == 0:
        return None
    moving = speed[[0, -1]] > _MOVING * speed.max(axis=0)
    ends = (
        ("begins", "drop_first", processing.drop_first, moving[0]),
        ("ends", "drop_last", processing.drop_last, moving[1]),
    )
    bad = [(verb, name) for verb, name, cut, moves in ends if cut < spoilt and np.any(moves)]
    if not bad:
        return None
    settings = " ".join(f"--set processing.{name}={spoilt}" for _, name in bad)
    text = (
        f"the log {' and '.join(verb for verb, _ in bad)} in motion, and the filter at "
        f"{processing.filter_cutoff:g} Hz does not know what was before or after: accelerations there are "
        f"wrong and spoil the fit; leave {spoilt} samples out, with {settings}"
    )
    return Notice(code="identify.moving-ends", text=text, file=recording.source)
