"""From a recording to states and torques: filter, differentiate, cut the ends, decimate.

Input: `Recording`, `Processing`. Output: `Signals` at full rate; matrices of fewer rows.

    Recording -> position filtered -> velocity, acceleration -> ends cut -> Signals

Supported: uniform sampling. Velocities and accelerations come from the filtered position,
so that both pass exactly the filter that the position passed.
Not supported: a logged velocity instead of the differentiated position.
"""

from symid.arrays import FloatArray
from symid.data.filters import decimate, differentiate, find_pad_length, low_pass
from symid.data.recording import Recording, Signals
from symid.errors import LogError, Notice
from symid.robot.description import Decimation, Processing

__all__ = ["decimate_columns", "describe_too_short", "find_least_samples", "prepare_signals"]


def prepare_signals(recording: Recording, processing: Processing) -> Signals:
    """Return states and torques of `recording`, filtered, differentiated and cut.

    Raises:
        LogError: too few samples for these settings, or a cut-off that the sample rate does not carry.
    """
    least = find_least_samples(processing)
    if len(recording.time) < least:
        raise LogError(describe_too_short(len(recording.time), processing, file=recording.source))
    period = recording.period
    q = _smooth(recording.position, period, processing)
    tau = _smooth(recording.torque, period, processing) if processing.filter_torque else recording.torque
    dq = differentiate(q, period)
    ddq = differentiate(dq, period)
    kept = slice(processing.drop_first, len(recording.time) - processing.drop_last)
    return Signals(
        time=recording.time[kept], q=q[kept], dq=dq[kept], ddq=ddq[kept], tau=tau[kept], period=period
    )


def decimate_columns(matrix: FloatArray, decimation: Decimation) -> FloatArray:
    """Return the rows of `matrix` (N, k) that decimation keeps, (M, k), each column low-passed alike.

    A model that is linear in its parameters stays true when its columns and the measurement
    pass the same filter ("parallel decimation", Gautier 1997).

    Raises:
        LogError: too few rows for the filter.
    """
    return decimate(matrix, decimation)


def find_least_samples(processing: Processing) -> int:
    """Return how many samples a log needs for these settings, at least."""
    whole = find_pad_length(processing.filter_order) + 1 if processing.filter_cutoff is not None else 3
    decimation = processing.decimation
    left = find_pad_length(decimation.order) + 1 if decimation.factor > 1 else 3
    return max(whole, left + processing.drop_first + processing.drop_last)


def describe_too_short(samples: int, processing: Processing, file: str = "") -> Notice:
    """Return the notice on a log with fewer samples than `find_least_samples`."""
    return Notice(
        code="log.too-short",
        file=file,
        text=f"the log has {samples} samples; filter, cut ends ({processing.drop_first} first, "
        f"{processing.drop_last} last) and decimation need {find_least_samples(processing)} at least",
    )


def _smooth(values: FloatArray, period: float, processing: Processing) -> FloatArray:
    if processing.filter_cutoff is None:
        return values
    return low_pass(values, period=period, cutoff=processing.filter_cutoff, order=processing.filter_order)
