"""A robot file and logs looked at before anything is identified.

Input: a robot, logs. Output: `RobotCheck`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, final

from symid.api.log import LogLike, list_logs
from symid.api.result import Result
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load NumPy
    from symid.api.robot import RobotModel
    from symid.logcheck.log_check import LogCheck
    from symid.logcheck.log_excitation import Excitation
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.tasks.check import CheckedLog, LogsCheck

__all__ = ["RobotCheck", "check_robot"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotCheck(Result):
    """What a robot file says, and which parameters logs identify; `errors` where that is too little.

    Attributes:
        robot: the robot, whose file has no mistakes.
        product: what was found in the logs.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> found = robot.check(robot.simulate(duration=4.0, seed=1).log)
        >>> found.accepted, found.excitation.rank
        (True, 12)
    """

    robot: "Robot"
    product: "LogsCheck"

    @property
    def logs(self) -> "tuple[CheckedLog, ...]":
        """Return of every log its recording at even times, how it was sampled, and what its joints do."""
        return self.product.logs

    @property
    def dynamics(self) -> "tuple[LogCheck, ...]":
        """Return signs, exchanged joints and the delay of the torque in every log; of rigid robots."""
        return self.product.dynamics

    @property
    def excitation(self) -> "Excitation | None":
        """Return a verdict on every parameter, singular values, rank and condition; of rigid robots."""
        return self.product.excitation

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what is odd in the robot file and in the logs, with what to do."""
        return (*self.robot.notices, *self.product.notices)

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why the logs are not enough for a model of the robot."""
        return self.product.errors

    def summarise(self) -> str:
        """Return the robot, and how many logs were looked at."""
        from symid.report.log_check_text import summarise_robot

        return f"{summarise_robot(self.robot)}: {len(self.logs)} log{'s'[: len(self.logs) != 1]}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return what was read, the joints of every log, and what the logs tell of the parameters."""
        from symid.report.log_check_text import show_robot_check

        return show_robot_check(self.robot, self.product)

    def to_dict(self) -> dict[str, object]:
        """Return joints, logs, and what they tell of every parameter, in plain types."""
        from symid.report.log_check_text import describe_robot_check

        return describe_robot_check(self.robot, self.product)


def check_robot(
    robot: "RobotModel", logs: Sequence[LogLike], *, resample: str | PathLike[str] | None = None
) -> RobotCheck:
    """Return what is found in `logs` of `robot`; see `RobotModel.check`."""
    from symid.tasks.check import LogsCheck, check_robot_logs

    if resample is not None and len(logs) != 1:
        text = f"resample: a copy is made of one log at a time, got {len(logs)}"
        raise UsageError(Notice(code="usage.one-log", text=text))
    if not logs:
        return RobotCheck(robot=robot.description, product=LogsCheck())
    found = check_robot_logs(
        robot.description,
        list_logs(logs),
        prepare=lambda: robot.library,
        progress=robot.progress,
        output=None if resample is None else Path(fspath(resample)),
    )
    return RobotCheck(robot=robot.description, product=found)
