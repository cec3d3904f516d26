"""A recording: what was measured, in SI units, on the joint side, nothing left out.

Input: arrays from a reader. Output: `Recording`, and `Signals` once filtered and differentiated.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from symid.arrays import FloatArray, freeze
from symid.errors import Notice

__all__ = ["OPTIONAL_CHANNELS", "Recording", "RunSettings", "Signals"]

OPTIONAL_CHANNELS = (
    "velocity",
    "motor_position",
    "link_position",
    "reference",
    "reference_velocity",
    "feedforward",
)
"""Channels of a recording that are None where the log does not have them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """What holds for one run alone, where several logs make one fit.

    Args:
        file: the log; weight: what the squares of its residuals count for.
        drop_first, drop_last: samples that were cut off before anything else.
        payload: the name of what the robot carries, empty for nothing.
        load: (p,) what a payload that is known adds to the base parameters, SI; empty where it is not known.
        offset: rad or m added to the positions, one for all joints or one a joint.
    """

    file: str
    weight: float = 1.0
    drop_first: int = 0
    drop_last: int = 0
    payload: str = ""
    load: tuple[float, ...] = ()
    offset: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """What a log holds.

    Args:
        time: (N,) s, strictly increasing.
        position: (N, n) rad or m, joint side.
        torque: (N, n) N m or N, joint side.
        velocity: (N, n) rad/s or m/s where the log has it.
        motor_position: (N, n) theta, rad or m, joint side, where the log has motor encoders besides
            `position`, which is then that of the links.
        link_position: (N, n) q, rad or m, where the log has link encoders besides `position`, which is then
            that of the motors. At most one of the two is there.
        reference: (N, n) rad or m, what the controller was to follow, where the log has it;
            reference_velocity: (N, n) its velocity; feedforward: (N, n) N m or N, added to its torque.
        source: the file it was read from, or what made it.
        notices: what a reader should know: conversions made, columns not used.
        extras: numeric columns of the log that are none of these, as logged.
        run: what holds for this run alone, where it is one of several; applied already, but for the weight.
    """

    time: FloatArray
    position: FloatArray
    torque: FloatArray
    velocity: FloatArray | None = None
    motor_position: FloatArray | None = None
    link_position: FloatArray | None = None
    reference: FloatArray | None = None
    reference_velocity: FloatArray | None = None
    feedforward: FloatArray | None = None
    source: str = ""
    notices: tuple[Notice, ...] = ()
    extras: Mapping[str, FloatArray] = field(default_factory=dict)
    run: RunSettings | None = None

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "position", "torque"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        for name in OPTIONAL_CHANNELS:
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, freeze(values))
        object.__setattr__(self, "extras", {name: freeze(values) for name, values in self.extras.items()})

    @property
    def period(self) -> float:
        """Return the mean sample period in s: clocks round each time, but not their sum."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals:
    """States and torques at full rate after filter, differentiation and cut ends, before decimation.

    Args:
        time: (N,) s; q, dq, ddq, tau: (N, n) in SI units; period: s.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    period: float

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("time", "q", "dq", "ddq", "tau"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
