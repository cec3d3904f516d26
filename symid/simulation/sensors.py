"""Sensors: what encoders and torque sensors make of the truth.

True positions, motor torques, a random generator -> what a controller and a log see.

Supported: encoder steps on the joint side and white Gaussian torque noise, absolute or relative to a
joint's RMS; of elastic robots, with two encoders a joint, zero offsets of either one and a constant delay
between the two channels, with fractional samples (linear between true samples).
Not supported: coloured noise, eccentric encoders, delays that vary.
"""

import math
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, UsageError
from symid.robot import JointKind, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """How good the sensors are.

    `counts_per_turn` of the encoder per turn of the joint (per metre, if prismatic), None for a perfect one;
    `torque_noise` standard deviation in N m or N, one for all joints or one for each.
    """

    counts_per_turn: float | None = 2.0**20
    torque_noise: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensors(FrozenArrays):
    """Sensors of one robot: encoder `step` (n,) rad or m, 0 for a perfect one; `noise` (n,) N m or N."""

    step: FloatArray
    noise: FloatArray


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
    return Sensors(
        step=np.zeros(robot.freedom) if counts is None else get_encoder_turns(robot) / counts,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticSensors:
    """How good the sensors are; a tuple holds one number for all joints or one for each.

    Args:
        motor_counts, link_counts: per turn of the joint (per metre, if prismatic); None for perfect encoders.
        motor_offset, link_offset: reading at position zero, rad or m.
        delay: s, by which link readings are later than motor readings: a sample at t shows the link as it was
            at t - delay. Negative: the motor readings are the late ones.
        torque_noise: standard deviation, N m or N.
        relative_noise: standard deviation as a share of the RMS of that joint's torque in the run.
    """

    motor_counts: float | None = None
    link_counts: float | None = None
    motor_offset: tuple[float, ...] = (0.0,)
    link_offset: tuple[float, ...] = (0.0,)
    delay: float = 0.0
    torque_noise: tuple[float, ...] = (0.0,)
    relative_noise: tuple[float, ...] = (0.0,)


def check_elastic_sensors(sensors: ElasticSensors, size: int) -> None:
    """Refuse sensors that cannot be.

    Raises:
        UsageError: numbers out of range, or not as many as joints.
    """
    mistakes = []
    for name in ("motor_counts", "link_counts"):
        counts: float | None = getattr(sensors, name)
        if counts is not None and not 0.0 < counts < math.inf:
            mistakes.append(("counts", f"{name}: must be positive and finite, got {counts:g}"))
    for name in ("motor_offset", "link_offset", "torque_noise", "relative_noise"):
        values: tuple[float, ...] = getattr(sensors, name)
        kind = "offset" if name.endswith("offset") else "noise"
        low, rule = (-math.inf, "all finite") if kind == "offset" else (0.0, "none negative, all finite")
        if len(values) not in {1, size} or not all(math.isfinite(value) and value >= low for value in values):
            mistakes.append((kind, f"{name}: one number for all or {size} numbers, {rule}; got {values}"))
    if not math.isfinite(sensors.delay):
        mistakes.append(("delay", f"delay: must be finite, got {sensors.delay:g} s"))
    if mistakes:
        raise UsageError(*(Notice(code=f"usage.sensor-{kind}", text=text) for kind, text in mistakes))


def get_encoder_turns(robot: Robot) -> FloatArray:
    """Return how far (n,) an encoder with one count turns: 2 pi rad, or 1 m of a prismatic joint."""
    return np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])


def compute_readings(
    time: FloatArray, position: FloatArray, *, delay: float, offset: tuple[float, ...], step: FloatArray
) -> FloatArray:
    """Return what encoders read: late, shifted, rounded.

    Args:
        time: (N,) s, even.
        position: (N, n) true, rad or m; the robot rested before the first sample.
        delay: s, not negative.
        offset: one for all or n, rad or m.
        step: (n,) of the encoders, 0 for perfect ones.
    """
    late = position
    if delay > 0.0:
        columns = [np.interp(time - delay, time, column) for column in position.T]
        late = np.stack(columns, axis=1)
    return quantise(late + np.array(offset), step)


def add_motor_noise(torque: FloatArray, sensors: ElasticSensors, rng: np.random.Generator) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    rms = np.sqrt((torque**2).mean(axis=0))
    deviation = np.hypot(np.array(sensors.torque_noise), np.array(sensors.relative_noise) * rms)
    noisy: FloatArray = torque + deviation * rng.normal(size=torque.shape)
    return noisy
