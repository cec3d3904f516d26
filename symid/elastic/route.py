"""Which way a robot, its logs and the options together ask for: rigid, the motor side alone, or elastic.

Input: a robot, recordings, options that were given. Output: `Route`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from symid.data.recording import Recording
from symid.elastic.motor_side import check_motor_side, has_both_encoders
from symid.errors import LogError, Notice, UsageError
from symid.robot.description import Robot

__all__ = ["Route", "choose_route"]

_NAMES = {"rate": "lambda"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """What is done: "rigid", "motor-side" or "elastic", the last with a method."""

    kind: str
    method: str = ""


def choose_route(
    robot: Robot,
    recordings: Sequence[Recording],
    *,
    method: str | None,
    elastic: Mapping[str, object],
    rigid: Sequence[str],
) -> Route:
    """Return what the robot, its logs and the options together ask for.

    Args:
        robot: as read.
        recordings: the logs.
        method: of elastic joints, or None.
        elastic: the options of elastic joints, None where not given.
        rigid: names of the options of rigid robots that were given.

    Raises:
        UsageError: options of one kind for a robot, method or log of another.
        LogError: some logs have two encoders and some one; the one position is that of the links.
    """
    both = [has_both_encoders((recording,)) for recording in recordings]
    whole = all(robot.elastic)
    if any(both) and not all(both) and any(robot.elastic):
        without = [recording.source for recording, has in zip(recordings, both, strict=True) if not has]
        text = "this log has one position a joint, others have two; give logs of one kind in one call"
        raise LogError(*(Notice(code="log.mixed-encoders", text=text, file=source) for source in without))
    if whole and (all(both) or method is not None):
        if not all(both):
            text = (
                f"--method {method} needs the positions of motors and links, and the log has one a joint: "
                "name the other in [log.motor_position] or [log.link_position], or leave --method out to "
                "identify what the motor side alone can tell"
            )
            raise UsageError(Notice(code="usage.one-encoder", text=text))
        _refuse_mixed(rigid, {}, f"the elastic robot {robot.name!r}")
        return Route(kind="elastic", method=method or "automatic")
    if method is not None:
        kind = "has rigid joints besides elastic ones" if any(robot.elastic) else "has no elastic joints"
        text = f"--method {method}: the robot {robot.name!r} {kind}; leave it out, or use --method stiffness"
        raise UsageError(Notice(code="usage.method", text=text))
    others = {name: value for name, value in elastic.items() if name != "window"}
    _refuse_mixed((), others, f"{robot.name!r}, identified as rigid")
    if any(robot.elastic) and not any(both):
        check_motor_side(robot, recordings)
    return Route(kind="motor-side" if any(robot.elastic) else "rigid")


def _refuse_mixed(rigid: Sequence[str], elastic: Mapping[str, object], what: str) -> None:
    """Refuse options that have no meaning for `what`.

    Raises:
        UsageError: options of rigid robots, or of elastic joints, were given.
    """
    given = [
        *rigid,
        *(f"--{_NAMES.get(name, name)}" for name, value in elastic.items() if value is not None),
    ]
    if given:
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
