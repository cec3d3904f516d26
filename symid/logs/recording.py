"""Recording: what a log holds, in SI units, on the joint side; and parts of it.

Arrays from a reader -> Recording; Recording, numbers of samples -> a shorter Recording with a notice.

Supported: position, torque and time; where the log has them velocity, a second encoder, the controller's
reference and feed-forward; other numeric columns as logged.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, freeze, freeze_fields
from symid.errors import LogError, Notice
from symid.serialization import compute_signature

CONTROL_CHANNELS = ("reference", "reference_velocity", "feedforward")
"""Channels of the controller, which are optional even where the robot file names their columns."""
OPTIONAL_CHANNELS = (
    *("velocity", "acceleration", "motor_position", "link_position", "load", "temperature"),
    *CONTROL_CHANNELS,
)
"""Channels that are None where the log does not have them, unless the robot file names their columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """Settings of one of several runs of a fit.

    Args:
        file: the log; weight: of the squares of its residuals.
        drop_first, drop_last: samples that were cut off before anything else.
        train: the part of the log that is used, as `read_part` takes it, empty for all of it.
        payload: its name, empty for none.
        load: (p,) what a known payload adds to the base parameters, SI; empty where it is not known.
        offset: rad or m added to the positions, one for all joints or one a joint.
    """

    file: str
    weight: float = 1.0
    drop_first: int = 0
    drop_last: int = 0
    train: str = ""
    payload: str = ""
    load: tuple[float, ...] = ()
    offset: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogExtent:
    """The whole log behind a recording.

    Args:
        start, end: s, time of its first sample, and of its last one with a sample period added.
        digest: of its samples, where it is no file and has been cut; else empty.
    """

    start: float
    end: float
    digest: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """What a log holds.

    Args:
        time: (N,) s, strictly increasing.
        position: (N, n) rad or m, joint side.
        torque: (N, n) N m or N, joint side.
        velocity: (N, n) rad/s or m/s where the log has it; acceleration: (N, n) rad/s^2 or m/s^2, likewise.
        motor_position: (N, n) theta, rad or m, joint side, of a second encoder; `position` is then that of
            the links.
        link_position: (N, n) q, rad or m, of a second encoder; `position` is then that of the motors. At most
            one of the two is there.
        load: (N, n) N m or N that the gears carry, of joint torque sensors where `torque` is that of the
            motors; temperature: (N, n) degC.
        reference: (N, n) rad or m, of the controller; reference_velocity: (N, n); feedforward: (N, n) N m or
            N.
        stamps: (N,) s, where it was resampled: when the samples were taken that would stand at `time` if all
            samples of the log were taken to be at even times; None where it was not.
        source: the file it was read from, or what made it.
        notices: conversions made, columns not used.
        extras: other numeric columns of the log, as logged.
        run: settings of one of several runs; applied already, but for the weight.
        whole: the log from which it was cut, None where it is the whole log.
        transmission: (n, n) angles of the motors over those of the joints, where torques were logged at
            motors that move more than one joint.
    """

    time: FloatArray
    position: FloatArray
    torque: FloatArray
    velocity: FloatArray | None = None
    acceleration: FloatArray | None = None
    motor_position: FloatArray | None = None
    link_position: FloatArray | None = None
    load: FloatArray | None = None
    temperature: FloatArray | None = None
    reference: FloatArray | None = None
    reference_velocity: FloatArray | None = None
    feedforward: FloatArray | None = None
    stamps: FloatArray | None = None
    source: str = ""
    notices: tuple[Notice, ...] = ()
    extras: Mapping[str, FloatArray] = field(default_factory=dict)
    run: RunSettings | None = None
    whole: LogExtent | None = None
    transmission: FloatArray | None = None

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        freeze_fields(self)
        object.__setattr__(self, "extras", {name: freeze(values) for name, values in self.extras.items()})

    @property
    def period(self) -> float:
        """Return the mean sample period in s, in which the rounding of single times cancels."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def extent(self) -> LogExtent:
        """Return when the whole log begins and ends."""
        start, last = float(self.time[0]), float(self.time[-1])
        return self.whole or LogExtent(start=start, end=last + self.period)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals(FrozenArrays):
    """States and torques at full rate after filter, differentiation and cut ends, before decimation.

    Args:
        time: (N,) s; q, dq, ddq, tau: (N, n) in SI units; period: s.
        load: (N, n) N m or N that the gears carry; temperature: (N, n) degC; None where they are not known.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    period: float
    load: FloatArray | None = None
    temperature: FloatArray | None = None

    def pick_states(
        self, places: slice | NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
        """Return q, dq, ddq, load and temperature at some samples, None for those that are not known."""
        load, warmth = (None if part is None else part[places] for part in (self.load, self.temperature))
        return self.q[places], self.dq[places], self.ddq[places], load, warmth


STATES = ("position", "velocity", "acceleration")
"""What a log may have of the states, the others are differences."""


def has_states(recording: Recording, name: str) -> bool:
    """Return whether the log has the channel of `STATES`, and that it has and a velocity have no holes."""
    used = [getattr(recording, name)]
    if name == "acceleration" and recording.velocity is not None:
        used.append(recording.velocity)
    return all(values is not None and bool(np.all(np.isfinite(values))) for values in used)


FEWEST = 3
"""Samples that central differences need."""


def cut_ends(recording: Recording, first: int, last: int) -> Recording:
    """Return the recording without its first and last samples; a LogError if less than three are left."""
    if not first and not last:
        return recording
    count = len(recording.time)
    left = count - first - last
    if left < FEWEST:
        text = (
            f"cutting off the first {first} and the last {last} of {count} samples leaves {max(left, 0)}, at "
            f"least {FEWEST} are needed; cut off less"
        )
        raise LogError(Notice(code="log.too-short", text=text, file=recording.source))
    text = f"the first {first} and the last {last} of {count} samples were cut off, as set"
    return add_notice(cut_recording(recording, slice(first, count - last)), "log.cut", text)


def add_notice(recording: Recording, code: str, text: str) -> Recording:
    """Return the recording with one more notice, on its source."""
    notice = Notice(code=code, text=text, file=recording.source)
    return replace(recording, notices=(*recording.notices, notice))


def cut_recording(recording: Recording, kept: slice) -> Recording:
    """Return the samples `kept` of every channel."""
    whole = recording.whole
    if whole is None:
        # A file is known by its own digest.
        in_memory = not os.path.isfile(recording.source)  # noqa: PTH113  (a source may be any text)
        digest = compute_signature(recording.torque) if in_memory else ""
        whole = replace(recording.extent, digest=digest)
    count = len(recording.time)
    extras = {
        name: values[kept] if len(values) == count else values for name, values in recording.extras.items()
    }
    return replace(change_channels(recording, lambda values: values[kept]), extras=extras, whole=whole)


def change_channels(recording: Recording, change: Callable[[FloatArray], FloatArray]) -> Recording:
    """Return the recording with `change` made to its times and all its channels."""
    changed: dict[str, Any] = {}
    for name in ("time", "stamps", "position", "torque", *OPTIONAL_CHANNELS):
        values = getattr(recording, name)
        if values is not None:
            changed[name] = change(values)
    return replace(recording, **changed)
