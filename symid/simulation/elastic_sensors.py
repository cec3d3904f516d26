"""What the sensors of an elastic robot make of the truth: two encoders a joint, and the motor's torque.

Input: true positions of links and motors, motor torques, a random generator. Output: what a log sees.

Supported: encoder steps, zero offsets of either encoder, a constant delay between the two channels with
fractional samples (linear between true samples), white torque noise, absolute or relative to a joint's RMS.
Not supported: coloured noise, eccentric encoders, delays that vary.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.robot.description import JointKind, Robot

__all__ = ["ElasticSensors", "add_motor_noise", "check_sensors", "find_readings", "find_turns"]

_TUPLES = ("motor_offset", "link_offset", "torque_noise", "relative_noise")


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


def _find_mistakes(sensors: ElasticSensors, size: int) -> Iterator[tuple[str, str]]:
    """Yield code and text of everything that no sensor can be."""
    for name in ("motor_counts", "link_counts"):
        counts: float | None = getattr(sensors, name)
        if counts is not None and not 0.0 < counts < math.inf:
            yield "usage.sensor-counts", f"{name}: must be positive and finite, got {counts:g}"
    for name in _TUPLES:
        values: tuple[float, ...] = getattr(sensors, name)
        low = -math.inf if name.endswith("offset") else 0.0
        if len(values) not in {1, size} or not all(math.isfinite(value) and value >= low for value in values):
            kind = "offset" if name.endswith("offset") else "noise"
            rule = "all finite" if kind == "offset" else "none negative, all finite"
            yield (
                f"usage.sensor-{kind}",
                f"{name}: one number for all or {size} numbers, {rule}; got {values}",
            )
    if not math.isfinite(sensors.delay):
        yield "usage.sensor-delay", f"delay: must be finite, got {sensors.delay:g} s"


def check_sensors(sensors: ElasticSensors, size: int) -> None:
    """Refuse sensors that cannot be.

    Raises:
        UsageError: numbers out of range, or not as many as joints.
    """
    notices = [Notice(code=code, text=text) for code, text in _find_mistakes(sensors, size)]
    if notices:
        raise UsageError(*notices)


def find_turns(robot: Robot) -> FloatArray:
    """Return how far (n,) an encoder with one count turns: 2 pi rad, or 1 m of a prismatic joint."""
    return np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])


def find_readings(
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
    shifted: FloatArray = late + np.array(offset)
    if not np.any(step > 0.0):
        return shifted
    safe = np.where(step > 0.0, step, 1.0)
    readings: FloatArray = np.where(step > 0.0, np.round(shifted / safe) * safe, shifted)
    return readings


def add_motor_noise(torque: FloatArray, sensors: ElasticSensors, rng: np.random.Generator) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    rms = np.sqrt((torque**2).mean(axis=0))
    deviation = np.hypot(np.array(sensors.torque_noise), np.array(sensors.relative_noise) * rms)
    noisy: FloatArray = torque + deviation * rng.normal(size=torque.shape)
    return noisy
