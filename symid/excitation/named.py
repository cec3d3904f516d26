"""A trajectory by its name or from its file, as an experiment follows it.

Input: a robot, a name ("fourier", "ta", "tb", "tc"), the path of a file, or a motion. Output: `Motion`.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from symid.errors import Notice, UsageError
from symid.excitation.motion import Motion, SampledMotion, build_part, build_scaled_samples
from symid.excitation.trajectories import (
    FourierOptions,
    Trajectory,
    build_random_fourier,
    build_scaled,
    build_ta,
    build_tb,
    build_tc,
)
from symid.excitation.trajectory_file import read_trajectory
from symid.robot.description import Robot

__all__ = ["TRAJECTORIES", "build_motion", "build_trajectory"]

TRAJECTORIES = ("fourier", "ta", "tb", "tc")
_TA_JOINTS = 2


def build_motion(
    robot: Robot,
    given: str | Trajectory | SampledMotion,
    rng: np.random.Generator,
    *,
    duration: float | None = None,
    joint: int = 1,
    scale: float = 1.0,
) -> Motion:
    """Return the trajectory of a name, or that of a file or of samples, up to `duration` s.

    Args:
        robot: that moves.
        given: one of `TRAJECTORIES`, the path of a file, or a motion.
        rng: of the random series.
        duration: s; None for that of the trajectory.
        joint: that "tb" moves, counted from one.
        scale: of the amplitudes.

    Raises:
        UsageError: there is no such trajectory, it is for another number of joints, or shorter; or the
            duration is no positive time.
        LogError: the file is wrong.
    """
    if duration is not None and not 0.0 < duration < math.inf:
        text = f"duration {duration:g} s: must be a positive time"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    if isinstance(given, str) and given in TRAJECTORIES:
        return build_trajectory(robot, given, rng, duration=duration, joint=joint, scale=scale)
    if isinstance(given, Trajectory):
        scaled = build_scaled(given, scale)
        return scaled if duration is None else replace(scaled, duration=duration)
    motion = build_scaled_samples(
        given if isinstance(given, SampledMotion) else _read_motion(Path(given), robot), scale
    )
    if duration is None:
        return motion
    if duration > motion.duration:
        text = f"--duration {duration:g} s: the trajectory ends after {motion.duration:g} s"
        file = given if isinstance(given, str) else ""
        raise UsageError(Notice(code="usage.trajectory", text=text, file=file))
    return build_part(motion, duration)


def _read_motion(path: Path, robot: Robot) -> SampledMotion:
    if not path.is_file():
        known = ", ".join(TRAJECTORIES)
        text = f"--trajectory {path}: neither one of {known} nor a file; symid excite writes one"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return read_trajectory(path, robot)


def build_trajectory(
    robot: Robot,
    name: str,
    rng: np.random.Generator,
    *,
    duration: float | None = None,
    joint: int = 1,
    scale: float = 1.0,
) -> Trajectory:
    """Return the trajectory called `name`, "fourier", "ta", "tb" or "tc", its amplitudes times `scale`.

    Raises:
        UsageError: "ta" is for another number of joints, or "tb" for a joint that is not there.
    """
    return build_scaled(_build_unscaled(robot, name, rng, duration=duration, joint=joint), scale)


def _build_unscaled(
    robot: Robot, name: str, rng: np.random.Generator, *, duration: float | None, joint: int
) -> Trajectory:
    if name == "fourier":
        options = FourierOptions() if duration is None else FourierOptions(duration=duration)
        return build_random_fourier(robot, rng, options)
    length = {} if duration is None else {"duration": duration}
    if name == "tb":
        return build_tb(joint - 1, size=robot.freedom, **length)
    if name == "tc":
        return build_tc(size=robot.freedom, **length)
    if robot.freedom != _TA_JOINTS:
        text = f"trajectory ta moves {_TA_JOINTS} joints, {robot.name} has {robot.freedom}; use fourier"
        raise UsageError(Notice(code="usage.trajectory", text=text))
    return build_ta(**length)
