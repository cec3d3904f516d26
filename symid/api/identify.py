"""Logs and options to a fit: the settings of the call, the recordings, the right kind of result.

Input: a robot, logs, what is asked for. Output: `RigidFit`, `ElasticFit`, `FrictionFit`, `Stiffness`.
"""

from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, final

from symid.api.fit import ElasticFit, FrictionFit, RigidFit
from symid.api.log import Logs, find_reader, list_logs
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.api.robot import RobotModel
    from symid.data.recording import Recording
    from symid.elastic.stiffness import JointStiffness, StiffnessEstimate
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.tasks.friction import FrictionRequest
    from symid.tasks.identify import IdentifyTask

__all__ = ["Stiffness", "identify_friction_of_logs", "identify_logs", "identify_stiffness_of_logs"]

Pairs = tuple[tuple[str, str], ...]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Stiffness(Result):
    """The stiffness of every joint that the logs tell, with 95 % intervals, and what the encoders say.

    Attributes:
        estimate: all that was found.
        said: what a reader should know.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link_elastic")
        >>> found = robot.identify_stiffness(robot.simulate(duration=6.0, seed=1).log)
        >>> sorted(found.joints)
        ['elbow', 'shoulder']
    """

    estimate: "StiffnessEstimate"
    said: tuple[Notice, ...]

    @property
    def joints(self) -> "dict[str, JointStiffness]":
        """Return what was found of every joint, by its name."""
        return {entry.joint: entry for entry in self.estimate.joints}

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of the robot, its logs and the result."""
        return self.said

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the result to `path` as JSON and return the path.

        Raises:
            OutputError: the file cannot be written.
        """
        from symid.identification.storage import write_file
        from symid.json_text import write_json

        file = Path(fspath(path))
        return write_file(file, write_json({**self.to_dict(), "file": file}))

    def summarise(self) -> str:
        """Return which joints have a stiffness."""
        told = [name for name, entry in self.joints.items() if entry.stiffness is not None]
        return f"{self.estimate.robot}: stiffness of {', '.join(told) or 'no joint'}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return delay, offsets and stiffness."""
        from symid.report.elastic_text import show_stiffness

        return show_stiffness(self.estimate)

    def to_dict(self) -> dict[str, object]:
        """Return delay, offsets and stiffness in plain types."""
        from symid.report.elastic_text import describe_stiffness

        return describe_stiffness(self.estimate)


def _gather(
    robot: "RobotModel", logs: Logs, pairs: Pairs, friction: str | None
) -> "tuple[Robot, tuple[Recording, ...]]":
    """Return the robot with the settings of the call, and the recordings as it reads them."""
    from symid.data.logs import gather_fit_recordings
    from symid.formats.loading import override_settings

    given = list_logs(logs, pairs)
    described = override_settings(find_reader(robot.description, logs), pairs, friction)
    return described, gather_fit_recordings(given, described)


def identify_logs(
    robot: "RobotModel", logs: Logs, task: "IdentifyTask", friction: str | None
) -> RigidFit | ElasticFit:
    """Return the fit of a robot to logs; see `RobotModel.identify`."""
    from symid.elastic.estimate import ElasticEstimate
    from symid.tasks.identify import identify_robot

    described, recordings = _gather(robot, logs, task.pairs, friction)
    found = identify_robot(described, recordings, task, robot.workshop)
    extra = {"backend": found.backend}
    if isinstance(found.estimate, ElasticEstimate):
        return ElasticFit(
            estimate=found.estimate,
            alignment=found.alignment,
            model=robot,
            said=found.notices,
            extra=extra,
        )
    return RigidFit(estimate=found.estimate, model=robot, said=found.notices, extra=extra)


def identify_friction_of_logs(
    robot: "RobotModel", logs: Logs, request: "FrictionRequest", pairs: Pairs
) -> FrictionFit:
    """Return laws of friction; see `RobotModel.identify_friction`."""
    from symid.tasks.friction import identify_robot_friction

    described, recordings = _gather(robot, logs, pairs, request.friction)
    found = identify_robot_friction(described, recordings, request, robot.workshop)
    extra = {"backend": found.backend}
    return FrictionFit(estimate=found.result, model=robot, said=found.notices, extra=extra)


def identify_stiffness_of_logs(
    robot: "RobotModel", logs: Logs, pairs: Pairs, friction: str | None
) -> Stiffness:
    """Return the stiffness of joints; see `RobotModel.identify_stiffness`."""
    from symid.tasks.identify import identify_stiffness

    described, recordings = _gather(robot, logs, pairs, friction)
    found, notices = identify_stiffness(described, recordings, pairs, robot.workshop)
    return Stiffness(estimate=found, said=notices)
