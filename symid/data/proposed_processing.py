"""What of a log is better left out, proposed from the log.

Input: an even recording, the robot. Output: `Processing` with the rest automatic.

    ends         a tenth of a second, for derivatives there are one-sided, and filters carry that inwards
    standstill   a hundredth of the top speed of the slowest joint that moves, to one digit

Supported: robots without dry friction, which need no standstill.
Not supported: a speed of its own for each joint, which robot files do not have.
"""

from symid.data.recording import Recording
from symid.data.summary import summarise_joints
from symid.robot.description import FrictionKind, Robot
from symid.robot.log_map import Processing

__all__ = ["ENDS", "SLOW", "propose_processing"]

ENDS = 0.1
"""Seconds left out at either end."""

SLOW = 0.01
"""Part of the top speed below which a joint counts as standing still."""

_LARGEST_PART = 0.05


def propose_processing(recording: Recording, robot: Robot) -> Processing:
    """Return what is left out of a log; cut-off and decimation follow from the log.

    Args:
        recording: an even one.
        robot: its friction says whether standstill matters.
    """
    ends = round(min(ENDS / recording.period, _LARGEST_PART * len(recording.time)))
    dry = any(joint.friction.kind is not FrictionKind.NONE for joint in robot.joints)
    speeds = [entry.speed for entry in summarise_joints(recording, robot) if entry.speed > 0.0]
    return Processing(
        automatic=True,
        drop_first=ends,
        drop_last=ends,
        standstill=float(f"{SLOW * min(speeds):.1g}") if dry and speeds else 0.0,
    )
