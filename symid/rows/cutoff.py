"""The choice of the position's cut-off and of the decimation, from what the log holds, and why.

Input: processing that leaves them open, recordings. Output: `FilterChoice`.

    band     b = min(what the rule of the sample rate keeps, clean bands of joints that move), 5 Hz at least
    rows     one sample in r = 0.8 (rate / 2) / b, so that decimation lets pass what lies below b
    cut-off  min(5 b, 0.4 rate): high enough that it damps nothing that the rows keep
    windows  of momentum rows as long as rows are apart, so that they keep the same band

The clean band of a joint ends where the noise of its encoder, differentiated twice, is a hundredth of its
acceleration (`spectra`): such noise enters the columns, not the torque, and moves parameters towards zero.
Below it more rows only tell more.

Supported: several recordings; the best of them counts for each joint. What is stated stays.
Not supported: a filter of its own for each joint: columns of all joints share one equation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from symid.data.recording import Recording
from symid.data.signals import settle_processing
from symid.errors import LogError, Notice
from symid.robot.log_map import Processing
from symid.rows.identifiability import find_resting_joints
from symid.rows.rows import WINDOW
from symid.rows.spectra import NOISE_SHARE, find_bands

__all__ = ["SAME_PERIOD", "FilterChoice", "choose_filters", "choose_window"]

_LEAST_BAND = 5.0
"""Hz that are always kept: robots move there."""
_RATIO = 5.0
_HIGHEST = 0.4
SAME_PERIOD = 0.01
"""Sample periods that differ by less, relative to one another, are the same: clocks drift."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterChoice:
    """What was chosen, and why; `clean` bands (n,) in Hz of the joints, 0 of those that do not move."""

    processing: Processing
    clean: tuple[float, ...] = ()
    notices: tuple[Notice, ...] = ()


def choose_filters(processing: Processing, recordings: Sequence[Recording]) -> FilterChoice:
    """Return the processing with cut-off and decimation chosen, where they are left open.

    Args:
        processing: as stated; returned as it is unless `automatic`.
        recordings: at least one; sampled alike.

    Raises:
        LogError: there is something to choose, and they are not sampled alike.
    """
    usual = settle_processing(processing, recordings[0].period)
    if usual == processing:
        return FilterChoice(processing=processing)
    _check_periods(recordings)
    rate = 1.0 / recordings[0].period
    clean = _find_clean(recordings)
    moving = [band for band in clean if band > 0.0]
    decimation = usual.decimation
    kept = 0.5 * decimation.band * rate / decimation.factor
    band = max(_LEAST_BAND, min([kept, *moving]))
    if processing.decimation.factor == 1:
        factor = max(decimation.factor, math.floor(0.5 * decimation.band * rate / band))
        decimation = replace(decimation, factor=factor)
        kept = 0.5 * decimation.band * rate / factor
    cutoff = processing.filter_cutoff or float(f"{min(_RATIO * kept, _HIGHEST * rate):.3g}")
    chosen = replace(usual, filter_cutoff=cutoff, decimation=decimation)
    return FilterChoice(processing=chosen, clean=clean, notices=(_explain(chosen, clean, kept, usual),))


def _check_periods(recordings: Sequence[Recording]) -> None:
    periods = [entry.period for entry in recordings]
    if max(periods) <= (1.0 + SAME_PERIOD) * min(periods):
        return
    listed = ", ".join(f"{entry.source or 'a log'} every {1e3 * entry.period:.4g} ms" for entry in recordings)
    text = (
        f"the logs are not sampled alike ({listed}), and no cut-off and decimation can be chosen that suit "
        "all: state filter_cutoff and decimation under [processing], or bring the logs to one rate"
    )
    raise LogError(Notice(code="identify.mixed-periods", text=text))


def choose_window(kind: str, processing: Processing, period: float) -> float:
    """Return the length in s of the windows of rows, where none is asked for.

    Args:
        kind: of rows.
        processing: with its decimation chosen.
        period: of the samples in s.
    """
    factor = processing.decimation.factor
    # Longer windows would damp what torque rows keep: heavy and light joints of a fast motion differ there.
    return factor * period if kind == "momentum" and factor > 1 else WINDOW


def _find_clean(recordings: Sequence[Recording]) -> tuple[float, ...]:
    size = recordings[0].position.shape[1]
    clean = [0.0] * size
    for recording in recordings:
        resting = find_resting_joints(recording)
        for joint, band in enumerate(find_bands(recording)):
            if joint not in resting and joint < size:
                clean[joint] = max(clean[joint], band.clean)
    return tuple(clean)


def _explain(chosen: Processing, clean: Sequence[float], kept: float, usual: Processing) -> Notice:
    told = ", ".join(f"{band:.3g}" if band else "-" for band in clean)
    noise = chosen.decimation.factor > usual.decimation.factor
    text = (
        "the robot file leaves the processing open: positions pass a "
        f"low-pass at {chosen.filter_cutoff:g} Hz, and one row in {chosen.decimation.factor} is kept, which "
        f"holds what lies below {kept:.3g} Hz; {'the noise' if noise else 'the rate'} decides: noise of the "
        f"positions is below {100.0 * NOISE_SHARE:g} % of the accelerations up to {told} Hz, joint by joint; "
        "state filter_cutoff and decimation under [processing] to choose yourself"
    )
    return Notice(code="identify.automatic", text=text)
