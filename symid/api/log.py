"""A log of the API: all measurements in SI units on the joint side; and its check.

File and robot (its map assigns the columns), or arrays -> `Log`; robot, logs -> `RobotCheck`, before
identification.

Supported: csv, npz, mat, hdf5, parquet, ROS 2 bags (db3, mcap, folders), files (.toml) of several runs.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol, final, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from symid import identification, logs as log_files, report, robot as robots
from symid.api.result import DrawnResult, PagedResult
from symid.arrays import FloatArray
from symid.errors import LogError, Notice, UsageError
from symid.identification import IdentifyOptions, LawOptions, rigid
from symid.options import ABOVE, check_value
from symid.serialization import describe_record

Settings = str | Mapping[str, object]
"""Settings in place of the robot file's: the name of a set in the file, or values by dotted key.

The set "published" is `"published"`, a value is `{"processing.filter_cutoff": 50}`; both together are
`{"settings": "published", "processing.filter_cutoff": 50}`, in which the value wins. See docs/robot_file.md.
"""


def list_pairs(
    settings: Settings | None, options: IdentifyOptions | LawOptions | None = None
) -> tuple[tuple[str, str], ...]:
    """Return pairs of key and text from settings, and from options that are settings by another name.

    Args:
        settings: a set's name, or values by dotted key; a list may be given as one.
        options: whose cutoff, decimate, drop_first and drop_last are settings where they are given.
    """
    keyed = {"settings": settings} if isinstance(settings, str) else settings or {}
    pairs = [*keyed.items()]
    if options is not None:
        names = ("cutoff", "decimate", "drop_first", "drop_last")
        keys = ("filter_cutoff", "decimation.factor", "drop_first", "drop_last")
        named = zip(keys, (getattr(options, name) for name in names), strict=True)
        pairs += [(f"processing.{key}", value) for key, value in named if value is not None]
    return tuple((key.strip(), _write_value(value)) for key, value in pairs)


def _write_value(value: object) -> str:
    """Return a value as a robot file has it."""
    # A number or an array of NumPy.
    value = value.tolist() if hasattr(value, "tolist") else value
    match value:
        case None:
            return "none"
        case bool():
            return "true" if value else "false"
        case list() | tuple():
            return ", ".join(map(_write_value, value))
    return str(value).strip()


class Measurements(DrawnResult):
    """What was measured of a robot, in SI units on the joint side."""

    recording: "log_files.Recording"
    robot: "robots.Robot"

    def _draw(self) -> "tuple[report.Drawing, ...]":
        return report.drawings.draw_log(self.recording, self.robot)

    @property
    def time(self) -> FloatArray:
        """Return the time stamps in s: (N,)."""
        return self.recording.time

    @property
    def q(self) -> FloatArray:
        """Return the joint positions in rad or m: (N, n); beside motor positions those of the links."""
        return self.recording.position

    @property
    def tau(self) -> FloatArray:
        """Return the joint torques in N m, or forces in N: (N, n); of elastic joints those of the motors."""
        return self.recording.torque

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the log to `path`, .npz or .csv, in SI units, and return the path; a file is overwritten.

        Raises:
            OutputError: the suffix is another one, or the file cannot be written.
        """
        return log_files.write_recording(self.recording, Path(fspath(path)), self.robot)


@final
class Log(Measurements):
    """A log as it was read.

    Attributes:
        recording: time, positions, torques and other measurements, SI units.
        robot: its `[log]` map assigned the columns.

    Example:
        >>> import symid
        >>> log = symid.load("two_link").simulate(duration=2.0, seed=1).log
        >>> len(log), log.q.shape, round(log.period, 6)
        (2001, (2001, 2), 0.001)
    """

    @property
    def source(self) -> str:
        """Return the file, or the name of another source."""
        return self.recording.source

    @property
    def dq(self) -> FloatArray | None:
        """Return the joint velocities in rad/s or m/s: (N, n); None if the log has none."""
        return self.recording.velocity

    @property
    def ddq(self) -> FloatArray | None:
        """Return the joint accelerations in rad/s^2 or m/s^2: (N, n); None if the log has none."""
        return self.recording.acceleration

    @property
    def period(self) -> float:
        """Return the mean sample period in s."""
        return self.recording.period

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return warnings and notes: conversions, unused columns, suspicious samples."""
        return (*self.recording.notices, *log_files.check_recording(self.recording, self.robot))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.recording.time)

    def cut(self, part: "Part") -> "Log":
        """Return a part of the log, with its time stamps.

        Args:
            part: START:END as text, in seconds from the first sample, such as "2.5:30", or in per cent, such
                as "0:60%" or "60%:"; or two numbers in seconds, None for an open end. A sample at a bound is
                of the part that begins there.

        Raises:
            UsageError: it is no part, or the log was cut before.
            LogError: the part is not in the log, or has too few samples.

        Example:
            >>> import symid
            >>> log = symid.load("two_link").simulate(duration=2.0, seed=1).log
            >>> len(log.cut("0:60%")), len(log.cut((1.5, None)))
            (1201, 501)
        """
        parts = log_files.read_parts(part, "part")
        (recording,) = log_files.take_parts((self.recording,), parts, "part", keep=True)
        return replace(self, recording=recording)

    def summarise(self) -> str:
        """Return source, samples and period."""
        return f"{self.source}: {len(self)} samples at {1.0 / self.period:.6g} Hz, {self.q.shape[1]} joints"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the table of joints: range, speed, torque."""
        summary = log_files.summarise_joints(self.recording, self.robot)
        return (self.summarise(), report.texts.show_joints(self.source, summary))

    def _describe(self) -> dict[str, object]:
        summary = log_files.summarise_joints(self.recording, self.robot)
        return _describe_log(self.recording, log_files.measure_timing(self.time), summary)


def _describe_log(
    recording: "log_files.Recording",
    timing: "log_files.LogTiming",
    joints: "tuple[log_files.JointSummary, ...]",
) -> dict[str, object]:
    """Return what the log itself says, without the robot's dynamics."""
    return {
        "file": recording.source,
        "samples": timing.samples,
        "duration": timing.duration,
        "period": recording.period,
        "has_velocity": recording.velocity is not None,
        "second_encoder": log_files.get_second_encoder_side(recording),
        "timing": {**describe_record(timing), "even": timing.even},
        "joints": [describe_record(joint) for joint in joints],
    }


@runtime_checkable
class Logged(Protocol):
    """An object with a log, such as a simulation."""

    @property
    def log(self) -> Log:
        """Return the log."""
        ...


LogLike = str | PathLike[str] | Log | Logged
"""A file, a log, or an object with one."""
Logs = LogLike | Sequence[LogLike]
"""One log or several."""
Part = str | tuple[float | None, float | None]
"""A part of a log, such as "0:60%", or (0.0, 12.5) in s from its first sample, None for an open end."""
Parts = Part | Sequence[Part]
"""A part of all logs, or a list with one for each."""


def list_logs(logs: Logs, pairs: Sequence[tuple[str, str]] = ()) -> "tuple[Path | log_files.Recording, ...]":
    """Return logs as paths and recordings.

    Args:
        logs: one or several.
        pairs: settings of the call, keys and values.

    Raises:
        UsageError: a setting changes how to read a log that is already read.
    """
    entries = _list_files_and_logs(logs)
    read = [entry for entry in entries if isinstance(entry, Log)]
    late = [key for key, _ in pairs if key.startswith("log.")]
    # A set of settings that reads any of the logs otherwise than it was read.
    named = [(log.robot.log, entry) for log in read for entry in log.robot.settings]
    changed = {entry.name for own, entry in named if entry.log not in (None, own)}
    late += [f"settings {name!r}" for key, name in pairs if key == "settings" and name in changed]
    if late and read:
        text = f"{', '.join(late)}: the log is already read; read it again with a robot that has this setting"
        raise UsageError(Notice(code="usage.read-before", text=text))
    return tuple(entry.recording if isinstance(entry, Log) else entry for entry in entries)


def _list_files_and_logs(logs: Logs) -> tuple[Path | Log, ...]:
    given = (logs,) if isinstance(logs, str | PathLike | Log | Logged) else tuple(logs)
    found = (entry.log if isinstance(entry, Logged) else entry for entry in given)
    return tuple(entry if isinstance(entry, Log) else Path(fspath(entry)) for entry in found)


def cut_samples(
    part: Part | None, name: str, x: FloatArray, y: FloatArray, t: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return a part of input, output and time; a UsageError where it states times that are not known."""
    if part is None or x.shape != y.shape:
        return x, y, t
    (given,) = log_files.read_parts(part, name)
    ends = [
        (value, mark == log_files.PERCENT)
        for value, mark in zip((given.start, given.end), given.units, strict=True)
    ]
    if t is None and any(0.0 < value < math.inf and not share for value, share in ends):
        text = f"{name} {given.text!r}: without the time of the samples state per cent, such as 0:60%"
        raise UsageError(Notice(code="usage.log-part", text=text))
    since = np.arange(float(len(x))) if t is None else t - t[0]
    low, high = (value * since[-1] / 100.0 if share and value < math.inf else value for value, share in ends)
    kept = (since >= low) & ((since < high) | (high >= since[-1]))
    return x[kept], y[kept], None if t is None else t[kept]


def pair_parts(
    train: Sequence[Part], test: Sequence[Part], logs: Sequence[Path]
) -> tuple[list[str] | None, tuple[tuple[Path, str], ...]]:
    """Return the parts of logs to fit, and every log with its part to predict; a unit is that of both.

    Args:
        train: one for all logs, one for each, or none.
        test: likewise.
        logs: files.

    Raises:
        UsageError: they overlap, are not one for each log, or logs are tested that were fitted as a whole.
    """
    text = ""
    listing = [str(log) for log in logs if log.suffix.lower() == ".toml"]
    if test and not train:
        text = "--test needs --train, or it would predict what was fitted; state both, such as 0:60% and 60%:"
    elif test and listing:
        text = f"--test takes logs, and {listing[0]} lists runs; predict its logs with `symid validate`"
    elif len(test) not in {0, 1, len(logs)}:
        many = f"{len(logs)} log{'s'[: len(logs) > 1]}"
        text = f"{len(test)} times --test for {many}: give it once, or once for each in order"
    if text:
        raise UsageError(Notice(code="usage.log-part", text=text))
    given = *log_files.read_parts(train, "--train"), *log_files.read_parts(test, "--test")
    unit = log_files.join_units(given)
    fitted, tried = log_files.read_parts(train, "--train", unit), log_files.read_parts(test, "--test", unit)
    log_files.refuse_shared(fitted, tried)
    each = [part.text for part in tried] * (len(logs) if len(tried) == 1 else 1)
    return [part.text for part in fitted] or None, tuple(zip(logs, each, strict=bool(test)))


def adopt_log_map(robot: "robots.Robot", logs: Logs) -> "robots.Robot":
    """Return the robot with the `[log]` map of its logs, which is stored with a fit.

    Raises:
        UsageError: the logs were read with different maps.
    """
    entries = _list_files_and_logs(logs)
    read = [entry.robot.log for entry in entries if isinstance(entry, Log)]
    maps = [*read, *([robot.log] if len(read) < len(entries) else [])]
    if any(other != maps[0] for other in maps):
        text = "the logs were read with different [log] maps; read all of them with this robot"
        raise UsageError(Notice(code="usage.read-before", text=text))
    return replace(robot, log=maps[0]) if maps else robot


def take_one_log(log: LogLike, pairs: Sequence[tuple[str, str]] = ()) -> "Path | log_files.Recording":
    """Return one log as a path or recording; see `list_logs`.

    Raises:
        UsageError: the number of logs is not one.
    """
    found = list_logs(log, pairs)
    if len(found) != 1:
        text = f"expected one log, got {len(found)}; make one call for each"
        raise UsageError(Notice(code="usage.one-log", text=text))
    return found[0]


def read_logs(
    path: str | PathLike[str],
    robot: "identification.Described",
    *,
    uneven: bool = False,
    sample_rate: float | None = None,
) -> tuple[Log, ...]:
    """Return the logs of a file: one, several where time starts again, or all runs listed in a `.toml`.

    Args:
        path: a log, or a file with `[[run]]` tables.
        robot: its `[log]` map assigns the columns.
        sample_rate: of a log without times, Hz; it stands for that of the map.
        uneven: keep uneven time stamps and other faults; otherwise they are repaired, and notices say how.

    Raises:
        LogError: a log cannot be used; the message lists all mistakes.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> [len(log) for log in symid.read_logs(robot.simulate(duration=1.0).save("run.npz"), robot)]
        [1001]
    """
    check_value("sample_rate", sample_rate, ABOVE)
    described = robot.description
    if sample_rate is not None:
        described = replace(described, log=replace(described.log, sample_rate=sample_rate))
    recordings = log_files.read_recordings((Path(fspath(path)),), described, uneven=uneven)
    return tuple(Log(recording=recording, robot=described) for recording in recordings)


def read_log(
    path: str | PathLike[str],
    robot: "identification.Described",
    *,
    uneven: bool = False,
    sample_rate: float | None = None,
) -> Log:
    """Return the log in a file, converted to SI units on the joint side.

    Args:
        path: csv, npz, mat, hdf5, parquet, or a ROS 2 bag (db3, mcap, a folder).
        robot: its `[log]` map says which column is what, in which unit, and on which side of the gear;
            without one columns are recognised by their names.
        sample_rate: of a log without times, Hz; it stands for that of the map.
        uneven: keep uneven time stamps and other faults; otherwise they are repaired, and notices say how.

    Raises:
        LogError: the log cannot be used (all mistakes are listed), or the file has several.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> log = robot.simulate(seed=1, duration=2.0).log
        >>> log.q.shape[1]
        2
    """
    found = read_logs(path, robot, uneven=uneven, sample_rate=sample_rate)
    if len(found) > 1:
        text = f"has {len(found)} runs; symid.read_logs returns them all"
        raise LogError(Notice(code="log.runs", text=text, file=fspath(path)))
    return found[0]


def take_samples(values: ArrayLike, time: ArrayLike | None) -> tuple[FloatArray, FloatArray | None]:
    """Return samples and times, where there are any, as arrays of float64."""
    stamps = None if time is None else np.asarray(time, dtype=np.float64)
    return np.asarray(values, dtype=np.float64), stamps


def build_log(
    robot: "identification.Described",
    *,
    time: ArrayLike,
    q: ArrayLike,
    tau: ArrayLike,
    dq: ArrayLike | None = None,
    ddq: ArrayLike | None = None,
    theta: ArrayLike | None = None,
    load: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    source: str = "arrays",
) -> Log:
    """Return a log from arrays in SI units on the joint side.

    Args:
        robot: its number of joints.
        time: (N,) s, strictly increasing.
        q: (N, n) rad or m; positions of the links if `theta` is given.
        tau: (N, n) N m or N.
        dq: (N, n) rad/s or m/s, if measured.
        ddq: (N, n) rad/s^2 or m/s^2, if measured.
        theta: (N, n) rad or m, motor positions on the joint side, for elastic robots.
        load: (N, n) N m or N of joint-torque sensors behind the gears; `tau` is then that of the motors.
        temperature: (N, n) degC.
        source: name of the log in messages.

    Raises:
        LogError: shapes do not fit, a value is not finite, or time does not increase.

    Example:
        >>> import numpy as np, symid
        >>> robot = symid.load("two_link")
        >>> time = np.linspace(0.0, 1.0, 101)
        >>> log = symid.build_log(robot, time=time, q=np.zeros((101, 2)), tau=np.zeros((101, 2)))
        >>> len(log)
        101
    """
    arrays = {"q": q, "tau": tau, "dq": dq, "ddq": ddq, "theta": theta}
    arrays |= {"load": load, "temperature": temperature}
    names = ("position", "torque", "velocity", "acceleration", "motor_position", "load", "temperature")
    try:
        given = {name: np.asarray(value, dtype=float) for name, value in arrays.items() if value is not None}
        stamps = np.asarray(time, dtype=float)
    except (TypeError, ValueError) as error:
        text = f"expected arrays of real numbers: {error}"
        raise LogError(Notice(code="log.arrays", text=text, file=source)) from error
    shape, items = (*stamps.shape[:1], len(robot.description.axes)), given.items()
    wrong = [f"{name} has the shape {x.shape}, expected {shape}" for name, x in items if x.shape != shape]
    wrong += [f"{name} holds values that are not finite" for name, x in items if not np.isfinite(x).all()]
    if stamps.ndim != 1 or len(stamps) < 2 or not np.all(np.diff(stamps) > 0.0) or np.isinf(stamps).any():
        wrong.append("time must be a list of two or more stamps in s that increase")
    if wrong:
        raise LogError(*(Notice(code="log.arrays", text=text, file=source) for text in wrong))
    columns: dict[str, Any] = dict(zip(names, map(given.get, arrays), strict=True))
    recording = log_files.Recording(time=stamps, source=source, **columns)
    return Log(recording=recording, robot=robot.description)


@final
class RobotCheck(DrawnResult, PagedResult):
    """Summary of a robot file, and which parameters are identifiable from logs; `errors` if too few are.

    Attributes:
        robot: the robot.
        product: the full result for the logs.

    Example:
        >>> import symid
        >>> robot = symid.load("two_link")
        >>> found = robot.check(robot.simulate(duration=4.0, seed=1).log)
        >>> found.accepted, found.excitation.rank
        (True, 12)
    """

    robot: "robots.Robot"
    product: "rigid.LogsCheck"

    @property
    def logs(self) -> "tuple[rigid.CheckedLog, ...]":
        """Return for every log its evenly sampled recording, its sampling, and the range of its joints."""
        return self.product.logs

    @property
    def sources(self) -> tuple[str, ...]:
        """Return the names of the logs."""
        return tuple(entry.recording.source for entry in self.logs)

    @property
    def dynamics(self) -> "tuple[rigid.LogCheck, ...]":
        """Return signs, exchanged joints and torque delay of every log; for rigid robots."""
        return self.product.dynamics

    @property
    def excitation(self) -> "rigid.LogExcitation | None":
        """Return identifiability of every parameter, singular values, rank, condition; for rigid robots."""
        return self.product.excitation

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return why the logs do not suffice for a model of the robot."""
        return self.product.errors

    def _build_page(self) -> "report.Page":
        return report.result_pages.build_check_page(self.robot, self.product)

    def _draw(self) -> "tuple[report.Drawing, ...]":
        return report.result_pages.draw_check(self.robot, self.product)

    def summarise(self) -> str:
        """Return the robot and the number of logs."""
        robot, count = report.texts.summarise_robot(self.robot), len(self.logs)
        return f"{robot}: {count} log{'s'[: count != 1]}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the robot, the joints of every log, and the identifiability of the parameters."""
        return report.texts.show_robot_check(self.robot, self.product)

    def brief(self) -> "tuple[report.Block, ...]":
        """Return the same for a first screen: of the parameters those that are not identifiable."""
        return report.texts.show_robot_check(self.robot, self.product, brief=True)

    def _describe(self) -> dict[str, object]:
        joints = self.robot.joints
        found: dict[str, object] = {
            "robot": self.robot.name,
            "file": self.robot.path,
            "convention": self.robot.convention,
            "joints": [{"name": e.name, "kind": e.kind.value, "friction": e.friction.law} for e in joints],
            "logs": [_describe_log(log.recording, log.timing, log.joints) for log in self.logs],
        }
        if self.product.copy is not None:
            file, notice = self.product.copy
            found["resampled"] = {"file": str(file), "text": notice.text}
        if self.excitation is not None:
            names = [joint.name for joint in self.robot.axes]
            found["dynamics"] = [
                {
                    "file": check.source,
                    "signs": [{**describe_record(one), "joint": names[one.joint]} for one in check.signs],
                    "causes": [describe_record(cause) for cause in check.causes],
                    "torque_delay": check.delay
                    and {**describe_record(check.delay), "late": check.delay.late},
                }
                for check in self.dynamics
            ]
            found["excitation"] = describe_record(self.excitation)
        return found
