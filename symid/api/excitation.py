"""An exciting trajectory: one on which the parameters of a robot can be identified best.

Input: a robot, what to search for. Output: `ExcitedTrajectory`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.api.robot import RobotModel
    from symid.arrays import FloatArray
    from symid.excitation.margins import Margin
    from symid.excitation.optimise import Excitation, ExcitationOptions
    from symid.excitation.trajectories import Trajectory
    from symid.excitation.workspace import Workspace
    from symid.report.blocks import Block
    from symid.robot.description import Robot

__all__ = [
    "ExcitationCriterion",
    "ExcitedTrajectory",
    "find_workspace",
    "list_numbers",
    "search_trajectory",
]

ExcitationCriterion = Literal["condition", "d-optimal"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExcitedTrajectory(Result):
    """A finite Fourier series of every joint, within all limits at all times.

    Attributes:
        robot: that it moves.
        product: the trajectory, its figures, what the search found from every start.
        seed: of the random series that the search started from.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> found = robot.excite(harmonics=2, period=2.0, candidates=20, starts=1)
        >>> found.coefficients.shape
        (2, 5)
        >>> robot.simulate(found.save("motion.csv", rate=100)).duration
        2.0
    """

    robot: "Robot"
    product: "Excitation"
    seed: int

    @property
    def trajectory(self) -> "Trajectory":
        """Return the motion; `evaluate(times)` gives q, dq, ddq, each (N, n), rad or m, /s, /s^2."""
        return self.product.trajectory

    @property
    def coefficients(self) -> "FloatArray":
        """Return the series (n, 2h + 1), rad or m: centre, h sines, h cosines of every joint."""
        return self.product.coefficients

    @property
    def condition(self) -> float:
        """Return the condition number of the torque regressor, its columns scaled to length one."""
        return self.product.condition

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the regressor's columns."""
        return self.product.parameters

    @property
    def margins(self) -> "tuple[Margin, ...]":
        """Return every limit with the part of it that is used, and clearances in m."""
        return self.product.margins

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what was assumed, such as limits that the robot file does not state."""
        return (*self.robot.notices, *self.product.notices)

    def save(self, path: str | PathLike[str], *, rate: float = 1000.0, periods: int = 1) -> Path:
        """Write t, q, dq, ddq as a .csv that `RobotModel.simulate` follows; return its path.

        Args:
            path: of the file; one that exists is overwritten.
            rate: samples a second, Hz.
            periods: how often the file runs through the trajectory.

        Raises:
            OutputError: the file is no .csv, or cannot be written.
        """
        from symid.excitation.trajectory_file import write_trajectory
        from symid.report.excitation_text import list_remarks

        remarks = list_remarks(self.robot, self.product, self.seed)
        file = Path(path)
        write_trajectory(self.trajectory, file, self.robot, rate=rate, periods=periods, remarks=remarks)
        return file

    def count_samples(self, *, rate: float = 1000.0, periods: int = 1) -> int:
        """Return how many samples `save` writes with this `rate` in Hz and these `periods`."""
        return round(self.trajectory.duration * rate) * periods + 1

    def summarise(self) -> str:
        """Return the robot, the series and its condition number."""
        return f"{self.robot.name}: {self.trajectory.source}; condition number {self.condition:.4g}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return its figures next to those of random series, and the part of each limit that it uses."""
        from symid.report.excitation_text import show_excitation

        return show_excitation(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return coefficients, figures, limits and starts in plain types."""
        from symid.report.excitation_text import describe_excitation

        return describe_excitation(self.robot, self.product, self.seed)


def search_trajectory(model: "RobotModel", options: "ExcitationOptions", seed: int) -> ExcitedTrajectory:
    """Return the best trajectory found; see `RobotModel.excite`."""
    import numpy as np

    from symid.excitation.optimise import optimise_excitation

    robot = model.description
    found = optimise_excitation(robot, options, rng=np.random.default_rng(seed), progress=model.progress)
    return ExcitedTrajectory(robot=robot, product=found, seed=seed)


def find_workspace(model: "RobotModel", path: str | PathLike[str] | None) -> "Workspace":
    """Return the spheres and planes of a file, none without one.

    Raises:
        InputError: the file is wrong.
    """
    from symid.excitation.workspace import Workspace, read_workspace

    return Workspace() if path is None else read_workspace(Path(path), model.description)


def list_numbers(values: Sequence[float] | None) -> tuple[float, ...] | None:
    """Return numbers of any sequence, or None where none are given."""
    return None if values is None else tuple(map(float, values))
