"""A look at a log with the robot's dynamics: what identification should not find out late.

Input: a library, even recordings, the robot. Output: `LogCheck` of each, `Excitation` of all.

Supported: rigid joints.
Not supported: elastic joints, whose torsion is no part of the rigid model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.errors import IdentifiabilityError, LogError, Notice
from symid.logcheck.log_delay import TorqueDelay, describe_delay, find_torque_delay
from symid.logcheck.log_excitation import Excitation, describe_excitation, find_excitation
from symid.logcheck.log_fit import LogFit, prepare_log_fit
from symid.logcheck.log_order import Exchange, describe_exchanges, find_exchanges
from symid.logcheck.log_signs import JointSigns, describe_signs, describe_sizes, find_signs
from symid.robot.description import Robot

__all__ = ["LogCheck", "check_logs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCheck:
    """What dynamics says of one log: signs of moving joints, exchanged columns, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    exchanges: tuple[Exchange, ...]
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


def check_logs(
    library: Library, recordings: Sequence[Recording], robot: Robot
) -> tuple[tuple[LogCheck, ...], Excitation, tuple[Notice, ...]]:
    """Return the check of each log that moves, what all of them excite, and notices on the whole.

    Raises:
        IdentifiabilityError: no log has a joint that moves.
    """
    fits: list[LogFit] = []
    reasons: list[Notice] = []
    for recording in recordings:
        try:
            fits.append(prepare_log_fit(library, recording, robot.processing))
        except (IdentifiabilityError, LogError) as error:
            reasons += error.notices
    if not fits:
        raise IdentifiabilityError(*reasons)
    checks = tuple(_check(fit, library, robot) for fit in fits)
    excitation = find_excitation(fits, [joint.name for joint in robot.axes])
    return checks, excitation, (*reasons, *describe_excitation(excitation))


def _check(fit: LogFit, library: Library, robot: Robot) -> LogCheck:
    file = fit.recording.source
    signs = find_signs(fit, library, robot)
    notices = describe_signs(signs, robot, file)
    exchanges: tuple[Exchange, ...] = ()
    delay: TorqueDelay | None = None
    if not notices:
        # With a wrong sign neither order nor delay means anything.
        exchanges = find_exchanges(fit, library)
        notices = (*describe_exchanges(exchanges, robot, file), *describe_sizes(signs, robot, file))
    if not notices:
        delay = find_torque_delay(fit)
        notices = describe_delay(delay, file)
    return LogCheck(source=file, signs=signs, exchanges=exchanges, delay=delay, notices=notices)
