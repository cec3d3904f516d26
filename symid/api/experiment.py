"""Experiments: an optimal trajectory for identification, and a simulated log.

Robot, options -> `ExcitedTrajectory`; robot with masses and friction, trajectory, sensors -> `Simulation`, a
log with known true parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid import report
from symid.api.log import Log, Measurements
from symid.api.result import Figures, Result
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.arrays import FloatArray
    from symid.excitation import Margin, OptimisedExcitation, Trajectory
    from symid.report import Block
    from symid.robot import Robot

ExcitationCriterion = Literal["condition", "d-optimal"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExcitedTrajectory(Result):
    """A finite Fourier series of every joint, within all limits at all times.

    Attributes:
        robot: the robot.
        product: the trajectory, its properties, the result of the search from every start, and notices, such
            as limits that the robot file does not state.
        seed: of the random series at the start of the search.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> found = robot.excite(harmonics=2, period=2.0, candidates=20, starts=1)
        >>> found.coefficients.shape, found.condition < found.product.random_condition
        ((2, 5), True)
        >>> robot.simulate(found.save("motion.csv", rate=100)).duration
        2.0
    """

    robot: "Robot"
    product: "OptimisedExcitation"
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
        """Return the used part of every limit, and clearances in m."""
        return self.product.margins

    def save(self, path: str | PathLike[str], *, rate: float = 1000.0, periods: int = 1) -> Path:
        """Write t, q, dq, ddq as a .csv that `RobotModel.simulate` follows; return its path.

        Args:
            path: an existing file is overwritten.
            rate: samples a second, Hz.
            periods: number of periods of the trajectory.

        Raises:
            OutputError: the suffix is not .csv, or the file cannot be written.
        """
        from symid.excitation import write_trajectory

        remarks = report.list_remarks(self.robot, self.product, self.seed)
        file = Path(path)
        write_trajectory(self.trajectory, file, self.robot, rate=rate, periods=periods, remarks=remarks)
        return file

    def count_samples(self, *, rate: float = 1000.0, periods: int = 1) -> int:
        """Return the number of samples that `save` writes with this `rate` in Hz and these `periods`."""
        return round(self.trajectory.duration * rate) * periods + 1

    def report(self, path: str | PathLike[str]) -> Path:
        """Write a self-contained HTML page to `path`, and return the path.

        Raises:
            OutputError: the page cannot be written.
        """
        return report.write_excitation_page(Path(path), self.robot, self.product)

    def figures(self) -> "tuple[Block, ...]":
        """Return positions and velocities over time, and the used part of each limit."""
        return self.plot().drawings

    def plot(self, ax: object = None) -> Figures:
        """Return these figures; `.save(path)` writes SVG or HTML, `ax` are axes of matplotlib to use."""
        return Figures(drawings=report.draw_excitation(self.product, self.robot)).draw(ax)

    def summarise(self) -> str:
        """Return the robot, the series and its condition number."""
        return f"{self.robot.name}: {self.trajectory.source}; condition number {self.condition:.4g}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return its condition number beside those of random series, and the used part of each limit."""
        return report.show_excitation(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return coefficients, criteria, limits and starts in plain types."""
        return report.describe_excitation(self.robot, self.product, self.seed)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Simulation(Measurements):
    """The measured log of a simulated robot.

    Attributes:
        robot: the robot.
        recording: the log, in SI units.
        trajectory: the reference, in words.
        duration: of the trajectory, s.
        seed: of all random numbers.
        energy_gap: error of the energy balance, relative to the work.
        backend: what computed the motion.
        details: noise, controller, largest torsions, in plain types.
        library_notices: warnings and notes on the compiled functions.

    Example:
        >>> import symid
        >>> run = symid.load("two_link").simulate("ta", duration=0.5, seed=1)
        >>> run.tau.shape, run.save("run.npz").name
        ((501, 2), 'run.npz')
    """

    trajectory: str
    duration: float
    seed: int
    energy_gap: float
    backend: str
    details: Mapping[str, object]
    library_notices: tuple[Notice, ...] = ()

    @property
    def log(self) -> Log:
        """Return the log, for `RobotModel.identify`."""
        return Log(recording=self.recording, robot=self.robot)

    @property
    def theta(self) -> "FloatArray | None":
        """Return the motor positions (N, n) on the joint side, rad or m; None for a rigid robot."""
        return self.recording.motor_position

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes on the robot, its compiled functions and the log."""
        return (*self.robot.notices, *self.library_notices, *self.recording.notices)

    def summarise(self) -> str:
        """Return the number of samples, the trajectory, and the error of the energy balance."""
        return (
            f"{len(self.time)} samples of {self.trajectory}; "
            f"work, energy and losses agree to {self.energy_gap:.1e} of the work"
        )

    def blocks(self) -> "tuple[Block, ...]":
        """Return one line."""
        return (f"{self.robot.name}: {self.summarise()}",)

    def to_dict(self) -> dict[str, object]:
        """Return the settings of the simulation in plain types."""
        return {
            "robot": self.robot.name,
            "trajectory": self.trajectory,
            "samples": len(self.time),
            "period": self.recording.period,
            "duration": self.duration,
            "seed": self.seed,
            "energy_gap": self.energy_gap,
            "backend": self.backend,
            **self.details,
        }
