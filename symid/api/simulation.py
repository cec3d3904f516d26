"""A simulated experiment: a log whose truth is known.

Input: a robot whose file states masses and friction, a trajectory, sensors. Output: `Simulation`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, final

from symid.api.excitation import ExcitedTrajectory
from symid.api.log import Log
from symid.api.result import Result
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.api.robot import RobotModel
    from symid.arrays import FloatArray
    from symid.data.recording import Recording
    from symid.excitation.motion import SampledMotion
    from symid.excitation.trajectories import Trajectory
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.simulation.simulated_log import StatedSensors

__all__ = ["Simulation", "simulate_experiment"]


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
        from symid.data.writers import write_recording

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
    sensors: "StatedSensors",
    *,
    duration: float | None,
    joint: int,
    scale: float,
    seed: int,
) -> Simulation:
    """Return what the sensors see along a trajectory; see `RobotModel.simulate`."""
    import numpy as np

    from symid.excitation.named import build_motion
    from symid.simulation.simulated_log import check_sensors, simulate_log
    from symid.simulation.stated_values import check_values

    robot = model.description
    check_sensors(robot, sensors)
    # Before minutes go into the derivation.
    check_values(robot)
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
