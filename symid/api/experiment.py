"""Experiments: a trajectory on which the parameters can be identified best, and a simulated log.

Robot, what to search for -> `ExcitedTrajectory`; robot whose file states masses and friction, trajectory,
sensors -> `Simulation`, a log whose truth is known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid.api.log import Log
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.api.robot import RobotModel
    from symid.arrays import FloatArray
    from symid.excitation import (
        ExcitationOptions,
        Margin,
        OptimisedExcitation,
        SampledMotion,
        Trajectory,
        WorkspaceLimits,
    )
    from symid.logs import Recording
    from symid.report import Block
    from symid.robot import Robot
    from symid.simulation import SensorSettings

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
        from symid.excitation import write_trajectory
        from symid.report import list_remarks

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
        from symid.report import show_excitation

        return show_excitation(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return coefficients, figures, limits and starts in plain types."""
        from symid.report import describe_excitation

        return describe_excitation(self.robot, self.product, self.seed)


def search_trajectory(model: "RobotModel", options: "ExcitationOptions", seed: int) -> ExcitedTrajectory:
    """Return the best trajectory found; see `RobotModel.excite`."""
    import numpy as np

    from symid.excitation import optimise_excitation

    robot = model.description
    found = optimise_excitation(robot, options, rng=np.random.default_rng(seed), progress=model.progress)
    return ExcitedTrajectory(robot=robot, product=found, seed=seed)


def load_workspace(model: "RobotModel", path: str | PathLike[str] | None) -> "WorkspaceLimits":
    """Return the spheres and planes of a file, none without one.

    Raises:
        InputError: the file is wrong.
    """
    from symid.excitation import WorkspaceLimits, read_workspace

    return WorkspaceLimits() if path is None else read_workspace(Path(path), model.description)


def list_numbers(values: Sequence[float] | None) -> tuple[float, ...] | None:
    """Return numbers of any sequence, or None where none are given."""
    return None if values is None else tuple(map(float, values))


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Simulation(Result):
    """What the sensors of a simulated robot saw.

    Attributes:
        robot: that moved.
        recording: the log, in SI units.
        trajectory: that it was to follow, in words.
        duration: of the trajectory, s.
        seed: of all random numbers.
        energy_gap: how far work, energy and losses disagree, relative to the work.
        backend: what computed the motion.
        details: noise, controller, largest torsions, in plain types.
        library_notices: what a reader should know of the compiled functions.

    Example:
        >>> import symid
        >>> run = symid.load("two_link").simulate("ta", duration=0.5, seed=1)
        >>> run.tau.shape, run.save("run.npz").name
        ((501, 2), 'run.npz')
    """

    robot: "Robot"
    recording: "Recording"
    trajectory: str
    duration: float
    seed: int
    energy_gap: float
    backend: str
    details: Mapping[str, object]
    library_notices: tuple[Notice, ...] = ()

    @property
    def log(self) -> Log:
        """Return it as a log for `RobotModel.identify` and its kin."""
        return Log(recording=self.recording, robot=self.robot)

    @property
    def time(self) -> "FloatArray":
        """Return the times (N,), s."""
        return self.recording.time

    @property
    def q(self) -> "FloatArray":
        """Return the measured positions (N, n), rad or m; of an elastic robot those of the links."""
        return self.recording.position

    @property
    def tau(self) -> "FloatArray":
        """Return the measured torques (N, n), N m or N; of an elastic robot those of the motors."""
        return self.recording.torque

    @property
    def theta(self) -> "FloatArray | None":
        """Return the motor positions (N, n) on the joint side, rad or m; None of a rigid robot."""
        return self.recording.motor_position

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a reader should know of the robot, its compiled functions and the log."""
        return (*self.robot.notices, *self.library_notices, *self.recording.notices)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the log to `path`, .npz or .csv, in place of an older file; return the path.

        Raises:
            OutputError: the ending is another one, or the file cannot be written.
        """
        from symid.logs import write_recording

        return write_recording(self.recording, Path(path), self.robot)

    def summarise(self) -> str:
        """Return the number of samples, the trajectory, and how well the energy balance closes."""
        return (
            f"{len(self.time)} samples of {self.trajectory}; "
            f"work, energy and losses agree to {self.energy_gap:.1e} of the work"
        )

    def blocks(self) -> "tuple[Block, ...]":
        """Return one line."""
        return (f"{self.robot.name}: {self.summarise()}",)

    def to_dict(self) -> dict[str, object]:
        """Return how the log came about in plain types."""
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


def simulate_experiment(
    model: "RobotModel",
    trajectory: "str | PathLike[str] | ExcitedTrajectory | Trajectory | SampledMotion",
    sensors: "SensorSettings",
    *,
    duration: float | None,
    joint: int,
    scale: float,
    seed: int,
) -> Simulation:
    """Return what the sensors see along a trajectory; see `RobotModel.simulate`."""
    import numpy as np

    from symid.excitation import build_motion
    from symid.simulation import check_sensor_settings, check_stated_values, simulate_log

    robot = model.description
    check_sensor_settings(robot, sensors)
    # Before minutes go into the derivation.
    check_stated_values(robot)
    rng = np.random.default_rng(seed)
    given = trajectory.trajectory if isinstance(trajectory, ExcitedTrajectory) else trajectory
    named = fspath(given) if isinstance(given, PathLike) else given
    motion = build_motion(robot, named, rng, duration=duration, joint=joint, scale=scale)
    library = model.library
    model.progress(f"simulating {motion.duration:g} s of {robot.name}")
    found = simulate_log(robot, library, motion, sensors, rng)
    return Simulation(
        robot=robot,
        recording=found.recording,
        trajectory=motion.source,
        duration=motion.duration,
        seed=seed,
        energy_gap=found.energy_gap,
        backend=found.backend,
        details=found.details,
        library_notices=library.notices,
    )
