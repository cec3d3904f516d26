"""Periods of a cosine motion laid on top of each other: their mean, and how far they scatter.

Input: a recording whose joints repeat themselves, the period. Output: `FoldedRecording`: the mean period,
continued before and after it, for filters to run in.

The mean of K periods has noise smaller by sqrt(K), and every filter sees a signal without ends.

Supported: any period of several samples; one that is no whole number of samples is interpolated, positions by
cubic splines, torques, which jump, by straight lines. Times before the first whole period and after the last
are not used.
Not supported: finding the period; motions that drift. A period at which positions differ by more than a tenth
of their range is refused.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.data.recording import Recording
from symid.errors import LogError, Notice

__all__ = ["FoldedRecording", "fold_recording"]

_LEAST_SAMPLES = 20
_WHOLE = 1e-3
"""A period this near to a whole number of samples, over the whole log, is one."""
_DRIFT = 0.02
"""Scatter of the positions between periods, relative to their range, that is worth a warning."""
_WRONG = 0.1
"""The same where periods have nothing in common: their mean is no motion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoldedRecording:
    """The mean period of a recording, with a margin of itself on either side.

    Args:
        recording: margin, n samples that are meant to be used, margin.
        samples: n, of one period.
        periods: how many were averaged.
        scatter: (joints,) standard deviation of the torque of one period about the mean, N m or N.
    """

    recording: Recording
    samples: int
    periods: int
    scatter: FloatArray

    def __post_init__(self) -> None:
        """Copy the array and make it read-only."""
        object.__setattr__(self, "scatter", freeze(self.scatter))


def fold_recording(recording: Recording, period: float, *, margin: int | None = None) -> FoldedRecording:
    """Return the mean over all whole periods.

    Args:
        recording: sampled evenly.
        period: of the motion in s.
        margin: samples by which the mean period is continued on either side; None for a whole period.

    Raises:
        LogError: less than two periods, a period of less than twenty samples, one that is not the motion's.
    """
    step = recording.period
    samples = round(period / step)
    # The last sample stands for the step behind it.
    periods = int((len(recording.time) * step + 1e-9 * period) // period)
    if samples < _LEAST_SAMPLES or periods < 2:
        text = (
            f"a period of {period:g} s is {samples} samples and fits {periods} times into the log; folding "
            f"needs {_LEAST_SAMPLES} samples and 2 periods at least"
        )
        raise LogError(Notice(code="log.period", text=text, file=recording.source))
    whole = np.stack(
        [
            _cut(values, recording.time, period, (periods, samples), degree=degree)
            for values, degree in ((recording.position, 3), (recording.torque, 1))
        ]
    )
    mean = whole.mean(axis=1)
    margin = samples if margin is None else margin
    places = np.arange(-margin, samples + margin)
    position, torque = (part[places % samples] for part in mean)
    free = periods / (periods - 1)
    scatter = np.sqrt(free * np.mean((whole[1] - mean[1]) ** 2, axis=(0, 1)))
    text = f"{periods} periods of {period:g} s were averaged, as --period asks"
    notices = (Notice(code="log.folded", text=text, file=recording.source), *_warn(whole[0], recording))
    folded = replace(
        recording,
        time=recording.time[0] + np.arange(len(places)) * period / samples,
        position=position,
        torque=torque,
        velocity=None,
        motor_position=None,
        link_position=None,
        extras={},
        notices=(*recording.notices, *notices),
    )
    return FoldedRecording(recording=folded, samples=samples, periods=periods, scatter=scatter)


def _cut(
    values: FloatArray, time: FloatArray, period: float, sizes: tuple[int, int], *, degree: int
) -> FloatArray:
    """Return `values` (N, n) as (periods, samples, n), between samples by splines of this degree."""
    periods, samples = sizes
    wanted = samples * periods
    exact = periods * period / (time[1] - time[0])
    if abs(exact - wanted) < _WHOLE and wanted <= len(values):
        return values[:wanted].reshape(periods, samples, -1)
    from scipy.interpolate import make_interp_spline

    at = time[0] + np.arange(wanted) * period / samples
    spline = make_interp_spline(time, values, k=degree, axis=0)
    # Rounding may put the last place a hair behind the last sample.
    found: FloatArray = spline(np.minimum(at, time[-1]))
    return found.reshape(periods, samples, -1)


def _warn(position: FloatArray, recording: Recording) -> tuple[Notice, ...]:
    """Return a notice where periods are not alike.

    Raises:
        LogError: they have nothing in common.
    """
    spread = np.ptp(position.mean(axis=0), axis=0)
    apart = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2, axis=(0, 1)))
    moving = spread > 0.0
    worst = float(np.max(apart[moving] / spread[moving], initial=0.0))
    # A joint that rests has no range that its noise could be compared with.
    if worst <= _DRIFT or float(np.max(apart)) <= _DRIFT * float(np.max(spread)):
        return ()
    text = (
        f"the positions of the periods differ by {100.0 * worst:.3g} % of their range: the period is not "
        "the motion's, or the motion drifts; give the right --period, one for each log where they differ, or "
        "none"
    )
    notice = Notice(code="log.not-periodic", text=text, file=recording.source)
    # What rests has no period: the joint that moves most tells.
    if float(np.max(apart)) > _WRONG * float(np.max(spread)):
        raise LogError(notice)
    return (notice,)
