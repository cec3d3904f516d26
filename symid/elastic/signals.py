"""From a recording of both encoders to states, torsion and torque, filtered alike.

Recording, ElasticOptions -> ElasticSignals.

Where velocities from raw differences are exact enough, nothing is filtered and tau[k] is the torque over
[t_k, t_k+1]. Otherwise all signals pass the same zero-phase low-pass, and tau[k] is the mean of the two
torques that meet at t_k: a torque that is held acts half a period later than its sample says.

A joint that rests in a recording is put at its mean position: what differentiation makes of encoder noise at
standstill is no motion, and its sign no direction of dry friction.

Supported: motor and link encoders; a torque held between samples; joints at rest.
Not supported: one encoder only; delays between the channels (align the recording first).
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.data.filters import differentiate, low_pass
from symid.data.recording import Recording
from symid.data.signals import describe_uneven
from symid.elastic.options import ElasticOptions, check_grids
from symid.errors import LogError, Notice
from symid.rows.identifiability import find_resting_joints

__all__ = ["ElasticSignals", "find_cutoff", "find_positions", "find_settled", "prepare_elastic_signals"]

_ORDER = 4
_CUTOFF = 25.0
"""Hz; ten times and more above what arms are moved with for identification."""
_LEAST_RATIO = 10.0
"""Of the sample rate to the cut-off."""
_EXACT = 3e-4
"""Velocities from raw differences with less relative noise are left unfiltered."""
_EDGE = 4.0
"""Periods of the cut-off frequency that the ends of a filtered signal are not trusted for."""
_LATEST = 0.25
"""Part of a recording that may pass at most before rows begin."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticSignals:
    """States and torques at full rate; the end is cut, the beginning is kept for the memory of plays.

    Args:
        time: (N,) s; q, dq, theta, dtheta, tau: (N, n) SI.
        period: s.
        settled: first sample of rows; plays run from sample 0.
        hold: "zero" where tau[k] acts over [t_k, t_k+1], "first" where it is a sampled smooth signal.
        cutoff: of the low-pass in Hz, 0 for none.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    tau: FloatArray
    period: float
    settled: int
    hold: str
    cutoff: float = 0.0

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "q", "dq", "theta", "dtheta", "tau"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @property
    def phi(self) -> FloatArray:
        """Return the torsions theta - q (N, n)."""
        return self.theta - self.q


def prepare_elastic_signals(recording: Recording, options: ElasticOptions) -> ElasticSignals:
    """Return states and torques of `recording`, filtered alike, differentiated, the end cut.

    Raises:
        LogError: the recording lacks one of the encoders, is too short or unevenly sampled.
        UsageError: thresholds or knees are given for another number of joints.
    """
    motor, link = _settle_resting(recording)
    check_grids(options, recording.torque.shape[1])
    uneven = describe_uneven(recording.time, file=recording.source)
    if uneven is not None:
        raise LogError(uneven)
    period = recording.period
    cutoff = find_cutoff(recording) if options.cutoff is None else options.cutoff
    edge = int(np.ceil(_EDGE / (cutoff * period))) if cutoff else 1
    if len(recording.time) <= 4 * edge + 16:
        raise LogError(_say_short(recording, 4 * edge + 17))
    tau = recording.torque
    if cutoff:
        held = np.vstack([tau[:1], (tau[1:] + tau[:-1]) / 2.0])
        motor, link, tau = (
            low_pass(values, period=period, cutoff=cutoff, order=_ORDER) for values in (motor, link, held)
        )
    kept = slice(0, len(recording.time) - edge)
    phi = motor - link
    return ElasticSignals(
        time=recording.time[kept],
        q=link[kept],
        dq=differentiate(link, period)[kept],
        theta=motor[kept],
        dtheta=differentiate(motor, period)[kept],
        tau=tau[kept],
        period=period,
        settled=max(edge, _find_start(phi[kept], period, options)),
        hold="first" if cutoff else "zero",
        cutoff=cutoff,
    )


def find_cutoff(recording: Recording) -> float:
    """Return the cut-off in Hz of the low-pass that the encoders' noise asks for, 0 for none.

    The noise is taken from third differences d, sigma = |d|_rms / sqrt(20); that of a velocity by central
    differences is sigma / (sqrt(2) T).
    """
    worst = 0.0
    for position in find_positions(recording):
        noise = np.sqrt(np.mean(np.diff(position, n=3, axis=0) ** 2, axis=0) / 20.0)
        speed = np.sqrt(np.mean(np.diff(position, axis=0) ** 2, axis=0)) / recording.period
        velocity_noise = noise / (np.sqrt(2.0) * recording.period)
        # A joint at rest has no speed to compare with; the fastest joint gives the scale.
        worst = max(worst, float(np.max(velocity_noise) / max(float(np.max(speed)), 1e-300)))
    if worst < _EXACT:
        return 0.0
    return min(_CUTOFF, 1.0 / (_LEAST_RATIO * recording.period))


def find_settled(phi: FloatArray, threshold: float) -> int:
    """Return the first sample at which the range of `phi` (N,) so far has reached 2 `threshold`, or its end.

    From there on the state of every play up to that radius is known, whatever it was before.
    """
    span = np.maximum.accumulate(phi) - np.minimum.accumulate(phi)
    goal = min(2.0 * threshold, 0.95 * float(span[-1]))
    return int(np.argmax(span >= goal))


def _settle_resting(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return motor and link positions, those of joints at rest on both sides at their means."""
    motor, link = find_positions(recording)
    sides = [replace(recording, position=side, motor_position=None) for side in (motor, link)]
    resting = sorted(set.intersection(*(set(find_resting_joints(side)) for side in sides)))
    if resting:
        motor, link = motor.copy(), link.copy()
        for side in (motor, link):
            side[:, resting] = side[:, resting].mean(axis=0)
    return motor, link


def _find_start(phi: FloatArray, period: float, options: ElasticOptions) -> int:
    """Return the sample at which plays are settled and filters have forgotten their start."""
    count = options.stops
    starts = [int(np.ceil(5.0 / (options.rate * period)))]
    for joint in range(phi.shape[1]):
        if options.thresholds is not None:
            grid = options.thresholds[joint]
            largest = max(grid) if grid else 0.0
        else:
            largest = count / (count + 1.0) * float(np.abs(phi[:, joint]).max())
        starts.append(find_settled(phi[:, joint], largest))
    return min(max(starts), max(starts[0], int(_LATEST * len(phi))))


def find_positions(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return motor and link positions.

    Raises:
        LogError: one of them is missing.
    """
    if recording.motor_position is not None:
        return recording.motor_position, recording.position
    if recording.link_position is not None:
        return recording.position, recording.link_position
    text = (
        "torsion is the difference of motor and link positions, and this log has only one of them: name the "
        "other column in [log.motor_position] or [log.link_position], or identify what the motor side alone "
        "can tell"
    )
    raise LogError(Notice(code="elastic.one-encoder", text=text, file=recording.source))


def _say_short(recording: Recording, least: int) -> Notice:
    text = f"the log has {len(recording.time)} samples; filter and cut ends need {least} at least"
    return Notice(code="log.too-short", text=text, file=recording.source)
