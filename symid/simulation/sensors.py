"""Sensors: true positions, motor torques, a random generator -> what a controller and a log read.

Supported: encoder steps and zero offsets on the joint side; white Gaussian torque noise, absolute or relative
to a joint's RMS; a constant delay between motor and link encoders (linear between true samples).
Not supported: coloured noise, eccentric encoders, delays that vary.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.robot import JointKind, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptions:
    """The sensors of a rigid robot.

    Args:
        counts_per_turn: of the encoder, per turn of the joint (per metre, if prismatic); None for a perfect
            one.
        torque_noise: standard deviation in N m or N, one for all joints or one for each.
    """

    counts_per_turn: float | None = 2.0**20
    torque_noise: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticSensors:
    """The sensors of an elastic robot; a tuple holds one number for all joints or one for each.

    Args:
        motor_counts, link_counts: per turn of the joint (per metre, if prismatic); None for perfect encoders.
        motor_offset, link_offset: reading at position zero, rad or m.
        delay: s; a link reading at t shows the link as it was at t - delay. Negative: motor readings are
            late.
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


def check_sensors(sensors: SensorOptions | ElasticSensors, size: int) -> None:
    """Refuse numbers out of range, or not as many as the `size` joints."""
    mistakes = []
    for name, value in asdict(sensors).items():
        if "counts" in name and value is not None and not 0.0 < value < math.inf:
            mistakes.append(("counts", f"{name}: must be positive and finite, got {value:g}"))
        if name == "delay" and not math.isfinite(value):
            mistakes.append(("delay", f"delay: must be finite, got {value:g} s"))
        kind = name.rpartition("_")[2]
        if kind in {"offset", "noise"}:
            low, rule = (-math.inf, "finite") if kind == "offset" else (0.0, "finite and not negative")
            if len(value) not in {1, size} or not all(math.isfinite(one) and one >= low for one in value):
                expected = f"expected one number for all joints or {size} numbers, {rule}"
                mistakes.append((kind, f"{name}: {expected}; got {value}"))
    if mistakes:
        raise UsageError(*(Notice(code=f"usage.sensor-{kind}", text=text) for kind, text in mistakes))


def get_encoder_turns(robot: Robot) -> FloatArray:
    """Return how far (n,) an encoder with one count turns: 2 pi rad, or 1 m of a prismatic joint."""
    return np.array([1.0 if joint.kind is JointKind.PRISMATIC else 2.0 * np.pi for joint in robot.axes])


def quantise(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return `values` (..., n) rounded to whole encoder steps (n,); a step of 0 rounds nothing."""
    safe = np.where(step > 0.0, step, 1.0)
    rounded: FloatArray = np.where(step > 0.0, np.round(values / safe) * safe, values)
    return rounded


def add_torque_noise(
    torque: FloatArray, sensors: SensorOptions | ElasticSensors, rng: np.random.Generator
) -> FloatArray:
    """Return `torque` (N, n) with white noise; absolute and relative noise are independent sources."""
    deviation = np.array(sensors.torque_noise)
    if isinstance(sensors, ElasticSensors):
        rms = np.sqrt((torque**2).mean(axis=0))
        deviation = np.hypot(deviation, np.array(sensors.relative_noise) * rms)
    noisy: FloatArray = torque + deviation * rng.normal(size=torque.shape)
    return noisy
