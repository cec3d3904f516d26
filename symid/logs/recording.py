"""Recording: what a log holds, in SI units, on the joint side; and parts of it, to fit and to test.

Arrays from a reader -> Recording; Recording, numbers of samples -> a shorter Recording with a notice. Text or
seconds -> `LogPart`; recording, part -> the shorter recording.

    0:60%     the first 60 % of the log, as :60%; a unit at one end is that of both: 20:60% is 20 % to 60 %
    60%:      the rest
    2.5:30    seconds, counted from the first sample of the log, as 2.5s:30s; 60: is from 60 s to the end
    5s:60%    each end in its own unit

A sample at a bound is of the part that begins there, so that 0:60% and 60%: share none. Time stamps stay as
they were logged.

Supported: position, torque and time; where the log has them velocity, a second encoder, the controller's
reference and feed-forward; other numeric columns as logged.
"""

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, freeze, freeze_fields
from symid.errors import LogError, Notice, UsageError
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
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
        bad: (N, n) samples of a joint that are wrong and count in no fit, None for none; see `faults`.
        source: the file it was read from, or what made it.
        notices: conversions made, columns not used.
        extras: other numeric columns of the log, as logged.
        run: settings of one of several runs; applied already, but for the weight.
        whole: the log from which it was cut, None where it is the whole log.
        place: of its first sample in the file, where that holds logs one after the other.
        transmission: (n, n) angles of the motors over those of the joints, where torques were logged at
            motors that move more than one joint.
        simulated: signature of the values of the robot it was simulated from, empty for others.
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
    bad: NDArray[np.bool_] | None = None
    source: str = ""
    notices: tuple[Notice, ...] = ()
    extras: Mapping[str, FloatArray] = field(default_factory=dict)
    run: RunSettings | None = None
    whole: LogExtent | None = None
    place: int = 0
    transmission: FloatArray | None = None
    simulated: str = ""

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        freeze_fields(self)
        if self.bad is not None:
            bad = np.array(self.bad, dtype=np.bool_)
            bad.setflags(write=False)
            object.__setattr__(self, "bad", bad)
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


States = tuple[FloatArray, FloatArray, FloatArray, FloatArray | None, FloatArray | None]
"""q, dq, ddq, load and temperature, None for those that are not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals(FrozenArrays):
    """States and torques at full rate after filter, differentiation and cut ends, before decimation.

    Args:
        time: (N,) s; q, dq, ddq, tau: (N, n) in SI units; period: s.
        load: (N, n) N m or N that the gears carry; temperature: (N, n) degC; None where they are not known.
        bad: (N, n) as in `Recording`.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    period: float
    load: FloatArray | None = None
    temperature: FloatArray | None = None
    bad: NDArray[np.bool_] | None = None

    def cut(self, part: slice) -> "Signals":
        """Return a part of the samples."""
        names = ("time", "q", "dq", "ddq", "tau", "load", "temperature", "bad")
        given = {name: getattr(self, name) for name in names}
        own: dict[str, Any] = {name: values[part] for name, values in given.items() if values is not None}
        return replace(self, **own)

    def pick_states(self, places: slice | NDArray[np.intp]) -> States:
        """Return the states at some samples."""
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
        text = f"cutting off the first {first} and the last {last} of {count} samples leaves {max(left, 0)}, "
        text += f"at least {FEWEST} are needed; cut off less"
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
        whole = replace(recording.extent, digest=compute_signature(recording.torque) if in_memory else "")
    extras = dict(recording.extras)
    extras |= {name: part[kept] for name, part in extras.items() if len(part) == len(recording.time)}
    return replace(change_channels(recording, lambda values: values[kept]), extras=extras, whole=whole)


def change_channels(recording: Recording, change: Callable[[FloatArray], FloatArray]) -> Recording:
    """Return the recording with `change` made to its times and all its channels."""
    names = ("time", "position", "torque", *OPTIONAL_CHANNELS)
    given = {name: getattr(recording, name) for name in names}
    changed: dict[str, Any] = {name: change(part) for name, part in given.items() if part is not None}
    if recording.bad is not None:
        # What a bad sample has a part in is bad.
        changed["bad"] = change(recording.bad.astype(np.float64)) != 0.0
    return replace(recording, **changed)


def spread_bad(bad: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return the samples (N, n) that have a bad one among the `reach` samples on either side."""
    counts = np.cumsum(np.pad(bad, ((1 + reach, reach), (0, 0))), axis=0)
    return np.asarray(counts[2 * reach + 1 :] > counts[: len(bad)])


PERCENT, SECONDS, BOTH = "%", "s", "% and s"
"""Units of the ends of a part; the last one where several parts have different ones."""
_Part = str | tuple[float | None, float | None]

_NUMBER = r"(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)?"
_PART = re.compile(rf"\s*{_NUMBER}\s*([%s]?)\s*:\s*{_NUMBER}\s*([%s]?)\s*")
_EXPECTED = "expected START:END in seconds or per cent, such as 0:60%, 60%: or 2.5:30"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPart:
    """A part of a log in time.

    Args:
        start, end: from the first sample of the log; an infinite end is that of the log.
        units: of both, `PERCENT` of the log's duration or `SECONDS`.
        stated: the unit that the text states, empty for none; `BOTH` if its ends have different ones.
        text: as `read_part` takes it again.
    """

    start: float
    end: float
    units: tuple[str, str]
    stated: str
    text: str


def read_part(given: _Part, name: str, unit: str = "") -> LogPart:
    """Return a part of a log as an option or a file states it, by a text or two numbers in s, or UsageError.

    `name` is that of the option; `unit` counts where the text states none, as that of another option; empty
    for seconds.
    """
    if isinstance(given, str):
        text = given
    else:
        # Callers give whatever they like.
        seconds: Any = given
        pair = tuple(seconds) if isinstance(seconds, tuple | list | np.ndarray) else ()
        numbers = [value for value in pair if value is not None and not isinstance(value, bool)]
        good = all(
            isinstance(value, int | float | np.number) and 0.0 <= value < math.inf for value in numbers
        )
        if len(pair) != 2 or not good or any(isinstance(value, bool) for value in pair):
            why = f"{_EXPECTED}, or a pair of seconds (2.5, 30.0), None for an open end"
            raise _refuse(name, repr(given), why)
        text = ":".join("" if value is None else f"{float(value)!r}{SECONDS}" for value in pair)
    found = _PART.fullmatch(text)
    if found is None or (found[2] and not found[1]) or (found[4] and not found[3]):
        raise _refuse(name, text, _EXPECTED)
    start, end = float(found[1] or 0.0), float(found[3] or math.inf)
    written = [mark for mark in (found[2], found[4]) if mark]
    stated = BOTH if len(set(written)) > 1 else written[0] if written else ""
    measured = [value for value in (start, end) if 0.0 < value < math.inf]
    if unit == BOTH and not stated and measured:
        raise _refuse(name, text, "state its unit, % or s, because parts in both units are given")
    fallback = (stated if stated != BOTH else "") or (unit if unit != BOTH else "") or SECONDS
    units = (found[2] or fallback, found[4] or fallback)
    pairs = [(start, units[0]), (end, units[1])]
    if any(mark == PERCENT and 100.0 < value < math.inf for value, mark in pairs):
        raise _refuse(name, text, "a log has 100 %")
    if units[0] == units[1] and not start < end:
        raise _refuse(name, text, "its end must be after its start")
    shown = stated or unit not in {"", BOTH}
    first, last = (mark if shown and value in measured else "" for value, mark in pairs)
    written_again = f"{found[1] or 0}{first}:{found[3] or ''}{last}"
    return LogPart(start=start, end=end, units=units, stated=stated, text=written_again)


def _refuse(name: str, text: str, why: str) -> UsageError:
    return UsageError(Notice(code="usage.log-part", text=f"{name} {text!r}: {why}"))


def read_parts(given: _Part | Sequence[_Part] | None, name: str, unit: str = "") -> tuple[LogPart, ...]:
    """Return one part for all logs, or one for each, or none; see `read_part`."""
    if given is None:
        return ()
    alone = isinstance(given, str) or not any(isinstance(entry, str | tuple | list) for entry in given)
    entries = [given] if alone and len(given) else given
    return tuple(read_part(entry, name, unit) for entry in entries)  # type: ignore[arg-type]  # checked there


def join_units(parts: Sequence[LogPart]) -> str:
    """Return the unit that the parts state: empty for none, `BOTH` for different ones."""
    units = {part.stated for part in parts} - {""}
    return BOTH if len(units) > 1 else "".join(units)


def refuse_shared(train: Sequence[LogPart], test: Sequence[LogPart]) -> None:
    """Refuse, by a UsageError, parts to fit and to test, one or one a log, that overlap or may do so."""
    count = max(len(train), len(test))
    ours, others = (parts * count if len(parts) == 1 else parts for parts in (tuple(train), tuple(test)))
    for mine, other in zip(ours, others, strict=False):
        pairs = ((mine, other), (other, mine))
        if any(one.units[1] == two.units[0] and one.end <= two.start for one, two in pairs):
            continue
        name, why = "--test", f"overlaps with --train {mine.text!r}; test on other samples"
        if len({*mine.units, *other.units}) > 1:
            why = f"may overlap with --train {mine.text!r}; state both in one unit, % or s"
        raise _refuse(name, other.text, why)


def take_part(recording: Recording, part: LogPart, name: str) -> Recording:
    """Return the part of a recording, in time of the whole log, with a notice.

    A UsageError if another part was taken of it before, a LogError if it has too few samples, or none.
    """
    if recording.run is not None and recording.run.train:
        text = f"{name} {part.text!r}: this run has the part {recording.run.train!r} already; state only one"
        raise UsageError(Notice(code="usage.log-part", text=text, file=recording.source))
    extent, period = recording.extent, recording.period
    whole = extent.end - extent.start
    first, last = (
        value * whole / 100.0 if mark == PERCENT and value < math.inf else value
        for value, mark in zip((part.start, part.end), part.units, strict=True)
    )
    given = f"{name} {part.text!r}"
    # The last sample lasts a period, of which only the order of magnitude is certain where stamps are uneven.
    if max(first, last if last < math.inf else 0.0) > whole + period:
        hint = "" if part.stated else "; numbers without a unit are seconds, write % for per cent"
        text = f"{given}: the log lasts {whole:.6g} s; an open end is that of the log{hint}"
        raise LogError(Notice(code="log.part", text=text, file=recording.source))
    since = recording.time - extent.start
    begin, end = (int(np.searchsorted(since, bound - 1e-3 * period)) for bound in (first, last))
    if end - begin < FEWEST:
        text = f"{given}: {max(end - begin, 0)} samples are left of {len(recording.time)} between "
        text += f"{since[0]:.6g} and {since[-1]:.6g} s, at least {FEWEST} are needed; take a longer part"
        raise LogError(Notice(code="log.too-short", text=text, file=recording.source))
    if end - begin == len(since):
        return recording
    text = f"{end - begin} of {len(since)} samples are used, {since[begin]:.6g} to {since[end - 1]:.6g} s "
    text += f"from the start of the log, as set by {given}"
    return add_notice(cut_recording(recording, slice(begin, end)), "log.cut", text)


def take_parts(
    recordings: Sequence[Recording], parts: Sequence[LogPart], name: str, *, keep: bool = False
) -> tuple[Recording, ...]:
    """Return the parts of recordings: one part for all of them, or one for each in order.

    With `keep` they become settings of the runs, with which the logs of a fit are read again. A UsageError if
    there are as many parts as fit neither; a LogError names all parts that are not in the logs.
    """
    if not parts:
        return tuple(recordings)
    if len(parts) not in {1, len(recordings)}:
        logs = f"{len(recordings)} log{'s'[: len(recordings) > 1]}"
        text = f"{len(parts)} times {name} for {logs}: give it once, or once for each log in order"
        raise UsageError(Notice(code="usage.log-part", text=text))
    each = parts if len(parts) > 1 else [parts[0]] * len(recordings)
    found, notices = list[Recording](), list[Notice]()
    for recording, part in zip(recordings, each, strict=True):
        try:
            taken = take_part(recording, part, name)
        except LogError as error:
            notices += error.notices
            continue
        run = taken.run or RunSettings(file=taken.source)
        found.append(replace(taken, run=replace(run, train=part.text)) if keep else taken)
    if notices:
        raise LogError(*notices)
    return tuple(found)
