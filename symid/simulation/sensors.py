"""What sensors make of the truth: encoder steps, torque noise.

Input: true positions and torques. Output: what a controller and a log see.

Supported: encoders on the joint side, white Gaussian torque noise.
Not supported: delays, offsets, coloured noise.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, UsageError
from symid.robot.description import JointKind, Robot

__all__ = ["SensorOptions", "Sensors", "add_torque_noise", "build_sensors", "quantise"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """How good the sensors are.

    `counts_per_turn` of the encoder per turn of the joint (per metre, if prismatic), None for a perfect one;
    `torque_noise` standard deviation in N m or N, one for all joints or one for each.
    """

    counts_per_turn: float | None = 2.0**20
    torque_noise: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensors:
    """Sensors of one robot: encoder `step` (n,) rad or m, 0 for a perfect one; `noise` (n,) N m or N."""

    step: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("step", "noise"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_sensors(robot: Robot, options: SensorOptions) -> Sensors:
    """Return the robot's sensors.

    Raises:
        UsageError: the numbers are not positive, or do not belong to this robot.
    """
    counts, noise = options.counts_per_turn, options.torque_noise
    if counts is not None and not 0.0 < counts < math.inf:
        text = f"counts per turn must be positive and finite, got {counts:g}"
        raise UsageError(Notice(code="usage.sensor-counts", text=text))
    if len(noise) not in {1, robot.freedom} or not all(0.0 <= value < math.inf for value in noise):
        text = (
            f"torque noise: one number for all or {robot.freedom} numbers, "
            f"none negative, all finite; got {noise}"
        )
        raise UsageError(Notice(code="usage.sensor-noise", text=text))
    turn = np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])
    return Sensors(
        step=np.zeros(robot.freedom) if counts is None else turn / counts,
        noise=np.broadcast_to(np.array(noise, dtype=np.float64), (robot.freedom,)),
    )


def quantise(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return `values` (..., n) rounded to whole encoder steps (n,); a step of 0 rounds nothing."""
    safe = np.where(step > 0.0, step, 1.0)
    rounded: FloatArray = np.where(step > 0.0, np.round(values / safe) * safe, values)
    return rounded


def add_torque_noise(torque: FloatArray, sensors: Sensors, rng: np.random.Generator) -> FloatArray:
    """Return `torque` (N, n) with white noise of the sensors' standard deviation."""
    return torque + rng.normal(size=torque.shape) * sensors.noise
