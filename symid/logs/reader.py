"""From a log file to a recording.

Path, Robot (its `[log]` map says which column is what) -> Recording.

    file -> raw columns (by suffix) -> names -> quantities in SI units -> checked -> Recording

Names are those of the map; without one those that symid writes, else those of a preset, else headings.

Supported: the suffixes of `READERS`, folders of a bag; presets, the names of columns of rostopic, bagpy,
PlotJuggler and bags ("ros"), ur_rtde, libfranka and symid, with joints in the order of the robot file; those
of PlotJuggler and bags by name.
Not supported: numbered columns of JointState messages whose order of joints changes within a log.
"""

import re
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import LogError, Notice, shorten_names
from symid.logs import headings
from symid.logs.bags import STORAGE_SUFFIXES, is_bag_folder, pick_topic, read_bag
from symid.logs.columns import (
    Findings,
    choose_default_names,
    extract_quantity,
    extract_time,
    get_matrix,
    has_default_columns,
    join_names,
)
from symid.logs.files import (
    DEFAULT_NAMES,
    SIMULATED,
    RawLog,
    build_file_error,
    read_hdf5,
    read_mat,
    read_npz,
    read_parquet,
)
from symid.logs.headings import REQUIRED_QUANTITIES, Names, is_commanded
from symid.logs.recording import OPTIONAL_CHANNELS, Recording
from symid.logs.signals import choose_processing, compute_least_samples, describe_too_short, describe_uneven
from symid.logs.tables import read_csv
from symid.notation import UNITS, get_unit_factor
from symid.robot import Joint, LogMap, LogQuantity, Processing, Robot, compute_current_factor

_TIMES = {
    "ros": {"%time": "ns", "Time": "s", "__time": "s", "time": "s"},
    "ur-rtde": {"timestamp": "s"},
    "franka": {"time": "ms", "duration": "ms"},
}
"""Names and units of the time of each program."""
_LAYOUTS: dict[str, dict[str, tuple[str, ...]]] = {
    "ros": {
        quantity: (
            *(f"field.{name}{{k}}", f"{name}_{{k}}", f"*/{name}[{{k}}]"),
            *(f"{name}.{{joint}}", f"{{joint}}_{name}"),
        )
        for quantity, name in (("position", "position"), ("velocity", "velocity"), ("torque", "effort"))
    },
    "ur-rtde": {
        "position": ("actual_q_{k}",),
        "velocity": ("actual_qd_{k}",),
        "torque": ("actual_current_{k}",),
    },
    "franka": {
        "position": ("state.q[{k}]", "q[{k}]", "q_{k}"),
        "velocity": ("state.dq[{k}]", "dq[{k}]", "dq_{k}"),
        "torque": ("state.tau_J[{k}]", "tau_J[{k}]", "tau_J_{k}"),
    },
}
"""Names of its other columns: `{k}` counts from 0, `{joint}` is the joint's name, * any topic."""
_MILLISECONDS = 0.5
"""Steps of a time in ms are longer, those of one in s shorter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognised:
    """What the names of columns say.

    Args:
        raw: the log; of a bag without the samples that lack a joint.
        table: the columns of every quantity; short: a map that says the same.
        units: of the columns by quantity, as stated; one where all are alike.
    """

    raw: RawLog
    table: LogMap
    short: LogMap
    units: Names


def assign_columns(raw: RawLog, robot: Robot, findings: Findings) -> tuple[RawLog, Robot]:
    """Return the log, and the robot with columns in its `[log]` map: of its preset, or else by their names.

    Of a bag, samples that lack a joint are left out. A LogError says which columns are not recognised.
    """
    if replace(robot.log, topic=None, sample_rate=None) != LogMap():
        return apply_preset(raw, robot, findings)
    if has_default_columns(raw, REQUIRED_QUANTITIES):
        # What symid writes is in the order of the joints, whatever they are called.
        headings.note_other_numbers(choose_default_names(raw, "position"), robot.axes, findings)
        return raw, robot
    tried = Findings(file=findings.file)
    found = recognise_columns(raw, robot, {}, {}, tried)
    if found is not None:
        findings.remarks += (replace(entry, line=raw.line) for entry in tried.remarks)
        return found.raw, replace(robot, log=found.table)
    codes = {entry.code for entry in tried.mistakes}
    own = any(has_default_columns(raw, (name,)) for name in ("position", "torque", *_ENCODERS))
    # What symid's own names lack is said by those who read them.
    if own and not codes & {"new.ambiguous-column", "log.topic"}:
        return raw, robot
    if "log.topic" not in codes:
        text = "the robot has no [log] table, and its columns are not all known by their names: `symid new "
        text += "--log` writes one, with the options that are named here; or use "
        text += "--set log.QUANTITY.columns=NAME,NAME --set log.QUANTITY.unit=UNIT"
        tried.refuse("log.no-map", text)
    raise LogError(*(replace(entry, line=raw.line) for entry in tried.mistakes))


def recognise_columns(
    raw: RawLog, robot: Robot, columns: Names, units: Names, findings: Findings
) -> Recognised | None:
    """Return what the names of columns say; None, and mistakes noted, if they do not say enough.

    `columns` and `units` by quantity are those of the user, which come first.
    """
    found = None if columns else _match_preset(raw, robot, units, findings)
    if found is None and not findings.mistakes:
        read, stated = headings.propose_quantities(raw, robot, columns, units, findings)
        table = headings.fill_map(LogMap(topic=robot.log.topic), read)
        found = Recognised(raw=raw, table=table, short=table, units=stated)
    if found is None or findings.mistakes:
        return None
    torque = found.table.torque
    # What is assumed of gears and sides.
    current = torque is not None and get_unit_factor(torque.unit)[0] == "current"
    plain = tuple(joint.name for joint in robot.axes if joint.drive.gear == 1)
    if len(plain) < robot.freedom:
        what = "positions" if current else "positions and torques"
        text = f"{what} are assumed to be on the joint side of the gears"
        findings.remark("new.assumed-side", f'{text}; write side = "motor" in [log] if they are the motors\'')
    return found


def _match_preset(raw: RawLog, robot: Robot, units: Names, findings: Findings) -> Recognised | None:
    """Return the columns of the program that wrote the log, None where it is not known."""
    own = None if units else _match_symid_columns(raw, robot)
    if own is not None:
        units = _list_units(headings.list_quantities(own))
        return Recognised(raw=raw, table=own, short=LogMap(preset="symid"), units=units)
    # Messages of ROS have SI units but for efforts; the programs of others state theirs.
    for preset in ("ros",) if units else _LAYOUTS:
        tried = Findings(file=findings.file)
        short = LogMap(preset=preset, topic=robot.log.topic)
        found, known = apply_preset(raw, replace(robot, log=short), tried)
        read = headings.list_quantities(known.log)
        findings.mistakes += [entry for entry in tried.mistakes if entry.code == "log.topic"]
        mistakes = [entry for entry in tried.mistakes if entry.code != "log.no-torque-constant"]
        # A heading with a unit of its own was written by somebody else.
        stated = any(name in raw.units for entry in read.values() for name in entry.columns)
        if mistakes or stated or not set(REQUIRED_QUANTITIES) <= set(read):
            continue
        if preset == "franka":
            # Times of a robot in s are closer to each other than those in ms.
            time = raw.columns[read["time"].columns[0]]
            if len(time) > 1 and not np.median(np.diff(time)) > _MILLISECONDS:
                continue
        for entry in tried.mistakes:
            findings.refuse("new.torque-constant", f"{entry.text}: {headings.ask_constants(robot.axes)}")
        findings.remarks += tried.remarks
        shown = _list_units(read)
        if units:
            names = {name: entry.columns for name, entry in read.items()}
            read, shown = headings.propose_quantities(found, robot, names, {**shown, **units}, findings)
            short = headings.fill_map(short, {name: entry for name, entry in read.items() if name in units})
        listed = ", ".join(f"{name} in {shown[name][0]}" for name in REQUIRED_QUANTITIES if name in shown)
        text = f"the columns are those of {preset}, and its units are assumed: {listed}"
        text = f"{text} (SI: rad or m, N m or N)"
        if preset == "ros" and "torque" not in units:
            text += "; a message does not state the unit of effort, and some drivers give currents"
        findings.remark("new.preset", text)
        positions = read["position"].columns
        named = [entry for entry in _LAYOUTS[preset]["position"] if "{joint}" in entry]
        by_name = [_list_names(entry, robot.axes) for entry in named]
        if preset != "ros":
            headings.note_other_numbers(positions, robot.axes, findings)
        elif positions not in by_name and re.search(r"\d\]?$", positions[0]) and found is raw:
            headings.describe_order(tuple(enumerate(robot.axes)), findings)
        return Recognised(raw=found, table=headings.fill_map(known.log, read), short=short, units=shown)
    return None


def _list_units(read: Mapping[str, LogQuantity]) -> Names:
    return {name: (entry.unit,) for name, entry in read.items()}


def _match_symid_columns(raw: RawLog, robot: Robot) -> LogMap | None:
    """Return the columns that symid itself writes, with their units; None where they are not there."""
    names: dict[str, tuple[str, ...]] = {"time": ("t",), "position": ("q",), "torque": ("tau",)}
    if robot.freedom == 1 or not {"q", "tau"} <= set(raw.columns):
        numbers = range(1, robot.freedom + 1)
        names |= {key: tuple(f"{names[key][0]}{k}" for k in numbers) for key in ("position", "torque")}
    columns = [name for entry in names.values() for name in entry]
    units = [raw.units.get(name, "") for name in columns if name in raw.columns]
    plain = all(unit in UNITS and UNITS[unit][1] == 1.0 and UNITS[unit][0] != "current" for unit in units)
    if len(units) < len(columns) or not plain:
        return None
    # Names of joints may end in other numbers than their order gives; then the order is ambiguous.
    listed = headings.read_headings(raw, robot.axes)
    if headings.choose_columns(listed, "position", robot.axes, Findings(file="")) != names["position"]:
        return None
    read = {key: LogQuantity(columns=entry, unit=raw.units[entry[0]]) for key, entry in names.items()}
    return LogMap(preset="symid", time=read["time"], position=read["position"], torque=read["torque"])


def apply_preset(raw: RawLog, robot: Robot, findings: Findings) -> tuple[RawLog, Robot]:
    """Return the log, and the robot with the columns of its preset in the `[log]` map.

    Of a bag, samples that lack a joint are left out.
    """
    log, preset = robot.log, robot.log.preset or ""
    if preset not in _LAYOUTS:
        return raw, robot
    raw, columns = pick_topic(raw, robot, findings) if preset == "ros" else (raw, {})
    if preset == "ros" and "log.topic" in {entry.code for entry in findings.mistakes}:
        return raw, robot
    time = next((name for name in _TIMES[preset] if name in raw.columns), None)
    if log.time is None and "time" in columns:
        log = replace(log, time=LogQuantity(columns=columns["time"], unit="s"))
    elif log.time is None and time is not None:
        log = replace(log, time=LogQuantity(columns=(time,), unit=_TIMES[preset][time]))
    found: dict[str, Any] = {}
    left = [name for name in _LAYOUTS[preset] if getattr(log, name) is None]
    columns = columns or _match_layout(raw, preset, left, robot.axes, findings)
    for name in left:
        names, patterns = columns.get(name), _LAYOUTS[preset][name]
        if names is None and name == "velocity":
            continue
        if names is None:
            wanted = " or ".join(", ".join(_list_names(entry, robot.axes)[:2]) for entry in patterns)
            text = f"{name}: preset {preset!r} needs {wanted} ... of every joint, which the log lacks"
            findings.refuse("log.preset", f"{text}; name the columns in [log.{name}]")
        elif name == "torque" and preset == "ur-rtde":
            coupled = robot.log.transmission is not None
            if lacking := headings.describe_lacking(robot.axes, geared=not coupled):
                text = f"torque: {names[0]!r} ... are motor currents, and {lacking}"
                remedy = "add torque_constant (N m/A) and gear to [joint.drive] (gear = 1: direct drive)"
                findings.refuse("log.no-torque-constant", f"{text}; {remedy}")
            factor = compute_current_factor(robot.axes, coupled=coupled)
            side = "motor" if coupled else "joint"
            found[name] = LogQuantity(columns=names, unit="A", factor=factor or (1.0,), side=side)
        else:
            found[name] = LogQuantity(columns=names, unit="SI")
    return raw, replace(robot, log=replace(log, **found))


def _list_names(pattern: str, joints: Sequence[Joint]) -> tuple[str, ...]:
    return tuple(pattern.format(k=index, joint=joint.name) for index, joint in enumerate(joints))


def _match_layout(
    raw: RawLog, preset: str, quantities: Sequence[str], joints: Sequence[Joint], findings: Findings
) -> dict[str, tuple[str, ...]]:
    """Return the columns of `quantities`, by names of one kind and one topic, but those of commands."""
    topics = [name.rpartition("/")[0] for name in raw.columns if "/" in name and not is_commanded(name)]
    found: list[tuple[str, dict[str, tuple[str, ...]], dict[str, str]]] = []
    for index in range(len(_LAYOUTS[preset]["position"])):
        patterns = {name: _LAYOUTS[preset][name][index] for name in quantities}
        anywhere = any(pattern.startswith("*") for pattern in patterns.values())
        for topic in dict.fromkeys(topics) if anywhere else ("",):
            start = topic.replace("{", "{{").replace("}", "}}")
            own = {name: start + pattern.removeprefix("*") for name, pattern in patterns.items()}
            names = {name: _list_names(pattern, joints) for name, pattern in own.items()}
            # Of an array that is longer than the robot, one column more is there.
            more = {name: own[name].format(k=len(joints), joint="") for name in own if "{k}" in own[name]}
            there = {key: each for key, each in names.items() if set(each) <= set(raw.columns)}
            found.append((topic, there, more))
    needed = {*quantities} & {*REQUIRED_QUANTITIES} or {*quantities}
    counts = [len({*own} & needed) for _, own, _ in found]
    if not any(counts):
        return {}
    best = [entry for entry, count in zip(found, counts, strict=True) if count == max(counts)]
    topic, columns, more = best[0]
    rivals = [other for other, *_ in best if other]
    if topic and len(rivals) > 1:
        text = f"preset {preset!r}: {join_names(rivals)} have such columns; name those of the robot in [log]"
        findings.refuse("log.preset", text)
    for name in columns:
        if more.get(name) in raw.columns:
            text = f"{name}: {more[name]!r} is one column more than the robot has joints"
            findings.refuse("log.preset", f"{text}; name those of its joints in [log.{name}]")
    return columns


READERS: dict[str, Callable[[Path], RawLog]] = {
    ".mat": read_mat,
    ".npz": read_npz,
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".lvm"), read_csv),
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".parquet": read_parquet,
    **dict.fromkeys(STORAGE_SUFFIXES, read_bag),
}
"""Readers by suffix."""
_PACKED = ".gz"
_EXPORTS = {
    ".bag": "convert a bag of ROS 1 by `rosbags-convert --src LOG.bag --dst FOLDER`",
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "save the sheet as .csv"),
    ".tdms": "export it from LabVIEW or DIAdem as text, .lvm or .csv",
    **dict.fromkeys((".mf4", ".mdf", ".dat.gz"), "export it as .csv, .mat or .parquet"),
    ".svdx": "export it from TwinCAT Scope as .csv",
    ".idf": "export it from ControlDesk as .csv or .mat",
    **dict.fromkeys((".pkl", ".feather"), "write it by pandas as .csv or .parquet"),
}
"""What to do with files of other programs."""

_ENCODERS = ("motor_position", "link_position")
_GAPLESS = ("position", "torque", *_ENCODERS, "load", "temperature")

_LARGEST, _SMALLEST = 1e100, 1e-100
"""Largest value of a sensor, squares of larger ones overflow; least of the largest, squares vanish."""
_MISSING = 0.1
"""Part of the samples that may lack a value: more are no gaps, but a log with a hole in a channel."""


def prepare_columns(raw: RawLog, robot: Robot, findings: Findings) -> tuple[RawLog, Robot]:
    """Return the whole samples of a log, with times by its rate, and the robot with columns in its map."""
    raw, robot = assign_columns(_add_times(raw, robot, findings), robot, findings)
    found = [getattr(robot.log, name) for name in _GAPLESS]
    listed = [
        entry.columns if entry else choose_default_names(raw, name)
        for name, entry in zip(("time", *_GAPLESS), (robot.log.time, *found), strict=True)
    ]
    names = [name for own in listed for name in own if name in raw.columns]
    (clock, *_) = listed[0]
    count = len(np.atleast_1d(raw.columns[clock])) if clock in raw.columns else 0
    parts = {name: raw.columns[name] for name in names if len(np.atleast_1d(raw.columns[name])) == count}
    # The least of numbers is none if one of them is.
    lacked = {name: part for name, part in parts.items() if part.size and np.isnan(part.min())}
    holes = {name: np.isnan(part).reshape(count, -1).any(axis=1) for name, part in lacked.items()}
    lacking = np.any([*holes.values(), np.zeros(count, dtype=np.bool_)], axis=0)
    # Values that are wrong otherwise are no gaps, nor are columns of which most is missing.
    if not holes or np.mean(lacking) > _MISSING:
        return raw, robot
    if any(np.any(np.abs(part) > _LARGEST) for part in parts.values()):
        return raw, robot
    where = ", ".join(f"{name!r} ({int(mask.sum())})" for name, mask in holes.items())
    text = f"{int(lacking.sum())} of {count} samples lack a value, the first is sample "
    text += f"{int(np.argmax(lacking))} (counted from 0): {where}; they were left out, and are gaps in time"
    findings.remark("log.missing", text)
    whole = {
        name: part[~lacking] if np.ndim(part) and len(part) == count else part
        for name, part in raw.columns.items()
    }
    return replace(raw, columns=whole), robot


def _add_times(raw: RawLog, robot: Robot, findings: Findings) -> RawLog:
    """Return the log with a column of times by the sample rate of the map, in place of its own."""
    rate = robot.log.sample_rate
    if rate is None or not raw.columns:
        return raw
    own = [name for name in raw.columns if name in (*DEFAULT_NAMES["time"], "%time", "Time", "__time")]
    lengths = Counter(len(np.atleast_1d(part)) for part in raw.columns.values())
    count = lengths.most_common(1)[0][0]
    text = f"times are those of {count} samples at {rate:g} Hz, as set"
    if own:
        text += f"; {join_names(own)} of the log {'is' if len(own) == 1 else 'are'} not used"
    findings.remark("log.sample-rate", text)
    named = {f"logged_{name}" if name in own else name: part for name, part in raw.columns.items()}
    units = {f"logged_{name}" if name in own else name: unit for name, unit in raw.units.items()}
    times = freeze(np.arange(count) / rate)
    return replace(raw, columns={_SAMPLE_TIMES: times, **named}, units={**units, _SAMPLE_TIMES: "s"})


_SAMPLE_TIMES = "t"


@np.errstate(all="ignore")
def read_recording(path: Path, robot: Robot, *, uneven: bool = False, raw: RawLog | None = None) -> Recording:
    """Return the recording in a log, or raise a LogError with all mistakes.

    What NumPy finds odd in columns that are no numbers is reported. `robot`: its `[log]` map says which
    column is what; `uneven`: whether times may be uneven, repeat or run
    backwards; `raw`: the columns of the file, where they were read before.
    """
    raw = raw or read_raw(path)
    findings = Findings(file=str(path))
    findings.remarks += raw.notices
    raw, robot = prepare_columns(raw, robot, findings)
    time, used = extract_time(raw, robot, findings)
    samples = None if time is None else len(time)
    values: dict[str, FloatArray | None] = {}
    columns: dict[str, tuple[str, ...]] = {}
    for name in ("position", "torque", *OPTIONAL_CHANNELS):
        values[name], columns[name] = extract_quantity(raw, robot, name, samples, findings)
    # Holes in a velocity or an acceleration are accepted, states then come from the position; so are those
    # of a controller's channels.
    needed = dict.fromkeys((*used, *(column for name in _GAPLESS for column in columns[name])))
    for name in (entry for entry in needed if entry in raw.columns):
        part = np.atleast_1d(raw.columns[name])
        # Without a copy of what is right.
        if not (part.min(initial=0.0) >= -_LARGEST and part.max(initial=0.0) <= _LARGEST):
            bad = np.argwhere(~(np.abs(part) <= _LARGEST))
            first = int(bad[0, 0])
            place = f"sample {first}" + (f", column {int(bad[0, 1])}" if bad.shape[1] > 1 else "")
            text = f"{name!r} has {len(bad)} values that are not finite numbers (NaN, infinite, beyond "
            text += f"{_LARGEST:g}), the first at {place} (counted from 0); cut or repair the log there"
            findings.refuse("log.not-finite", text)
    for name in _GAPLESS:
        read = values[name]
        columnwise = () if read is None else read.T
        sizes = np.array([max(one.max(initial=0.0), -one.min(initial=0.0)) for one in columnwise])
        if (small := sizes[(sizes > 0.0) & (sizes < _SMALLEST)]).size:
            text = f"{name}: all values of a joint are {small[0]:.3g} or less, which no sensor measures"
            findings.refuse("log.too-small", f"{text}; state the unit or a factor in [log.{name}]")
    motor, link = (columns[name] for name in _ENCODERS)
    if values["position"] is None and bool(motor) != bool(link):
        text = f"the log has motor positions ({', '.join(motor)}) but no link positions; name these columns "
        text += "in [log.position] to identify what the motor side alone shows"
        if link:
            text = f"the log has link positions ({', '.join(link)}) but no motor positions, on which "
            text += "friction and rotors of elastic joints depend; add them, or, where joints are rigid, "
            text += "name these columns in [log.position]"
        findings.refuse("log.one-side", text)
    if motor and link:
        text = f"the log has motor positions ({', '.join(motor)}) and link positions ({', '.join(link)}) "
        text += f"besides its positions ({', '.join(columns['position'])}); name the link columns in "
        text += "[log.position] and the motor columns in [log.motor_position], or the motor columns in "
        text += "[log.position] and the link columns in [log.link_position], and rename the third"
        findings.refuse("log.two-encoders", text)
    for name in _ENCODERS:
        if columns[name] and columns[name] == columns["position"]:
            shown = ", ".join(columns[name])
            text = f"{name} and position are the same columns ({shown}), torsion is unknown"
            remedy = "leave it out"
            if name == "link_position":
                remedy = "name the motor columns in [log.position]; where joints are rigid, leave it out"
            findings.refuse("log.same-encoder", f"{text}; {remedy}")
    if time is not None and not uneven:
        _check_time(time, robot.processing, findings)
    if findings.mistakes or time is None or values["position"] is None or values["torque"] is None:
        raise LogError(*findings.mistakes)
    known = {*used, SIMULATED, *(name for names in columns.values() for name in names)}
    unused = tuple(name for name in raw.columns if name not in known)
    left_out = ", ".join((*unused, *raw.others))
    parts = [f"columns that were not used: {left_out}"] if left_out else []
    parts += (
        f"{name} was read; it is used where it predicts better than the filtered position (columns "
        f"{', '.join(columns[name])})"
        for name in ("velocity", "acceleration")
        if columns[name]
    )
    if parts:
        findings.remark("log.unused-columns", "; ".join(parts))
    channels: dict[str, Any] = values
    # What turned the torques of coupled motors into those of joints.
    matrix = get_matrix(robot, robot.log.torque)
    return Recording(
        time=time,
        **channels,
        source=str(path),
        notices=tuple(findings.remarks),
        extras={name: raw.columns[name] for name in unused},
        transmission=None if matrix is None else np.array(matrix),
        simulated=raw.units.get(SIMULATED, ""),
    )


def read_raw(path: Path) -> RawLog:
    """Return the columns of the log at `path` as they stand in it, or raise a LogError.

    What a library warns of while it reads a file is a notice.
    """
    try:
        folder, exists, plain = is_bag_folder(path), path.exists(), path.is_file()
    except OSError as error:
        text = f"cannot be read: {error.strerror}"
        if isinstance(error, PermissionError):
            text = "the folder may not be read (no permission)"
        raise build_file_error(path, text, "log.unreadable") from error
    suffix = "".join(path.suffixes[-2:] if path.suffix.lower() == _PACKED else [path.suffix])
    reader = read_bag if folder else READERS.get(suffix.lower().removesuffix(_PACKED))
    if reader is None or (suffix.lower().endswith(_PACKED) and reader is not read_csv):
        found = repr(suffix) if suffix else "no suffix"
        text = f"a log must be one of {', '.join(READERS)}, or the folder of a ROS 2 bag, got {found}"
        if remedy := _EXPORTS.get(suffix.lower()):
            text = f"{text}; {remedy}"
        raise build_file_error(path, text, "log.unknown-suffix")
    if not exists:
        raise build_file_error(path, "there is no such file", "log.no-such-file")
    if not folder and not plain:
        kind = "a folder" if path.is_dir() else "a device"
        raise build_file_error(path, f"this is {kind}, not a log", "log.unreadable")
    with warnings.catch_warnings(record=True) as said:
        for category in (UserWarning, RuntimeWarning, SyntaxWarning):
            warnings.simplefilter("always", category)
        try:
            raw = reader(path)
        except PermissionError as error:
            text = "the file may not be read (no permission)"
            raise build_file_error(path, text, "log.unreadable") from error
    words = dict.fromkeys(" ".join(str(entry.message).split()) for entry in said)
    if not words:
        return raw
    text = f"the library that reads this file doubts it: {shorten_names(words, 3)}; save the file anew, and "
    text += "compare its columns"
    return replace(raw, notices=(*raw.notices, Notice(code="log.doubted-file", text=text, file=str(path))))


def _check_time(time: FloatArray, processing: Processing, findings: Findings) -> None:
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        at = int(back[0])
        text = f"time must increase: sample {at + 1} (counted from 0) is at {time[at + 1]:.9g} s, the one "
        text += f"before at {time[at]:.9g} s"
        findings.refuse("log.time-order", f"{text}; {len(back)} such steps" if len(back) > 1 else text)
    elif len(steps) and np.all(np.isfinite(steps)):
        uneven = describe_uneven(time, file=findings.file)
        if uneven is not None:
            findings.mistakes.append(uneven)
    span = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if span > 0.0 and np.isfinite(span):
        processing = choose_processing(processing, span / (len(time) - 1))
    if len(time) < compute_least_samples(processing):
        findings.mistakes.append(describe_too_short(len(time), processing, file=findings.file))
