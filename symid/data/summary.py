"""A log in numbers: what every joint does in it.

Input: an even recording, the robot. Output: `JointSummary` of each joint.
"""

from dataclasses import dataclass

import numpy as np

from symid.data.recording import Recording
from symid.data.steps import find_step
from symid.robot.description import JointKind, Robot

__all__ = ["JointSummary", "summarise_joints"]

_SPAN = 0.1
"""Seconds over which a speed is taken, so that the steps of an encoder are no motion."""
_STILL = 1e-3
_PEAK = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSummary:
    """What a joint does in a log, in the unit of its position and SI torque.

    Args:
        low, high: range of the position; speed: its largest, over a tenth of a second.
        step: of the encoder, 0 where the log shows none.
        standstill: share of the time at less than a thousandth of the sweep, or of the top speed, per second.
        torque: root mean square; peak: largest size; saturated: share of the samples at the peak.
    """

    name: str
    unit: str
    low: float
    high: float
    speed: float
    step: float
    standstill: float
    torque: float
    peak: float
    saturated: float


def summarise_joints(recording: Recording, robot: Robot) -> tuple[JointSummary, ...]:
    """Return what every joint does in the recording."""
    found = []
    span = max(1, min(round(_SPAN / recording.period), len(recording.time) - 1))
    for index, joint in enumerate(robot.axes):
        position, torque = recording.position[:, index], recording.torque[:, index]
        speed = np.abs(position[span:] - position[:-span]) / (span * recording.period)
        top, sweep = float(speed.max()), float(np.ptp(position))
        peak = float(np.max(np.abs(torque)))
        found.append(
            JointSummary(
                name=joint.name,
                unit="m" if joint.kind is JointKind.PRISMATIC else "rad",
                low=float(position.min()),
                high=float(position.max()),
                speed=top,
                step=find_step(position),
                standstill=float(np.mean(speed <= _STILL * max(sweep, top))),
                torque=float(np.sqrt(np.mean(torque**2))),
                peak=peak,
                saturated=float(np.mean(np.abs(torque) >= peak * (1.0 - _PEAK))) if peak else 0.0,
            )
        )
    return tuple(found)
