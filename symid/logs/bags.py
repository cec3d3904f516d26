"""ROS 2 bags: messages as columns named by topic, joint and channel, and the topic of a robot's joints.

Path -> RawLog; RawLog, Robot -> the columns of one topic, of the messages that have all its joints.

    sensor_msgs/msg/JointState           TOPIC/JOINT/position, TOPIC/JOINT/velocity, TOPIC/JOINT/effort
    control_msgs/msg/DynamicJointState   TOPIC/JOINT/INTERFACE
    std_msgs/msg/Float64MultiArray       TOPIC/data, an array
    each of them                         TOPIC/time, s: stamps of the headers, or, where these are zero or
                                         there is no header, when messages were recorded

Stamps later than `_EPOCH` are dates, counted from the whole second before the first one, so that none of
their digits are lost.

Supported: .db3 and .mcap, alone or in a folder, with metadata.yaml or without; compression by zstd or lz4; an
order of joints that changes; messages with a part of the joints, joined where their stamps are the same.
Needs rosbags, the extra `ros`. Not supported: ROS 1; other messages, which are named.
"""

import os.path
import re
import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.logs.columns import Findings, join_names
from symid.logs.files import RawLog, build_file_error
from symid.logs.headings import Names, is_commanded
from symid.robot import Robot

STORAGE_SUFFIXES = (".db3", ".mcap")
"""Files of a bag."""
_METADATA = "metadata.yaml"
_JOINT_STATE = "sensor_msgs/msg/JointState"
_DYNAMIC = "control_msgs/msg/DynamicJointState"
_ARRAY = "std_msgs/msg/Float64MultiArray"
# Types that are not among those of ROS itself.
_DEFINITIONS = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values",
    _DYNAMIC: "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values",
}
_EPOCH = 1e6
"""s: larger stamps are dates."""
_NANO = 10**9


def is_bag_folder(path: Path) -> bool:
    """Return whether a folder has a file of a bag, or the metadata of one."""
    return path.is_dir() and any(
        entry.name == _METADATA or entry.suffix in STORAGE_SUFFIXES for entry in path.iterdir()
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Message:
    """A message: stamps in ns, values by joint and channel, or an array; `odd`: it contradicts itself."""

    stamp: int
    received: int
    values: Mapping[tuple[str, str], float]
    joints: tuple[str, ...] = ()
    array: FloatArray | None = None
    odd: bool = False


def read_bag(path: Path) -> RawLog:
    """Return the columns of a bag, or raise a LogError, also if rosbags is not installed."""
    try:
        import apsw
        from rosbags.rosbag2 import Reader, ReaderError, reader as storage
        from rosbags.serde import SerdeError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        text = "ROS 2 bags need rosbags: install it as the extra ros, pip install 'symid[ros]'"
        raise build_file_error(path, text, "log.needs-ros") from error
    damage: type[Exception] = vars(storage)["zstd"].ZstdError
    store = get_typestore(Stores.LATEST)
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    found, types, counts = dict[str, list[_Message]](), dict[str, str](), Counter[str]()
    try:
        with ExitStack() as stack:
            # A file, a folder with metadata, or all files of one without.
            files = [path]
            if path.is_dir() and not (path / _METADATA).exists():
                files = sorted(entry for entry in path.iterdir() if entry.suffix in STORAGE_SUFFIXES)
            readers = [stack.enter_context(Reader(file)) for file in files]
            for reader in sorted(readers, key=lambda reader: reader.start_time):
                types |= {entry.topic: entry.msgtype for entry in reader.connections}
                for entry in reader.connections:
                    counts[entry.topic] += entry.msgcount
                known = [entry for entry in reader.connections if entry.msgtype in _PARSED]
                for entry, received, data in reader.messages(known) if known else ():
                    message = store.deserialize_cdr(data, entry.msgtype)
                    parsed = _parse(message, entry.msgtype, received)
                    found.setdefault(entry.topic, []).append(parsed)
    # The readers raise any of these on a damaged file, according to where the damage lies.
    except (
        *(ReaderError, SerdeError, damage, apsw.Error, struct.error, OSError, ValueError),
        TypeError,
        *(AssertionError, LookupError, EOFError, RuntimeError, MemoryError, OverflowError),
    ) as error:
        if isinstance(error, PermissionError):
            raise
        text = f"this is not a ROS 2 bag that can be read: {str(error) or type(error).__name__}"
        raise build_file_error(path, text) from error
    silent = {
        topic: ", which name no joints"
        for topic, messages in found.items()
        if types[topic] != _ARRAY and not any(entry.joints for entry in messages)
    }
    found = {topic: messages for topic, messages in found.items() if topic not in silent}
    others = tuple(
        f"{topic} ({types[topic]}, {counts[topic]} messages{silent.get(topic, '')})"
        for topic in types
        if topic not in found
    )
    if not found:
        text = f"the bag has no messages of {', '.join(_PARSED)}; it has {', '.join(others) or 'no topics'}"
        raise build_file_error(path, text, "log.no-topic")
    return _build_columns(path, found, types, others)


def _parse(message: Any, kind: str, received: int) -> _Message:  # noqa: ANN401  made by rosbags
    """Return a message of one of `_PARSED`."""
    values: dict[tuple[str, str], float] = {}
    if kind == _ARRAY:
        array = np.array(message.data, dtype=np.float64)
        return _Message(stamp=0, received=received, values=values, array=array)
    names = tuple(map(str, message.name if kind == _JOINT_STATE else message.joint_names))
    odd = twice = len(set(names)) < len(names)
    if kind == _JOINT_STATE:
        for channel in ("position", "velocity", "effort"):
            numbers = getattr(message, channel)
            if len(numbers) == len(names) and not twice:
                values |= {(name, channel): float(x) for name, x in zip(names, numbers, strict=True)}
            odd |= len(numbers) not in (0, len(names))
    else:
        odd |= len(message.interface_values) != len(names)
        for name, entry in () if odd else tuple(zip(names, message.interface_values, strict=True)):
            channels = list(map(str, entry.interface_names))
            if len(set(channels)) == len(entry.values) == len(channels):
                values |= {(name, key): float(x) for key, x in zip(channels, entry.values, strict=True)}
            else:
                odd = True
    seconds, rest = message.header.stamp.sec, message.header.stamp.nanosec
    stamp = int(seconds) * _NANO + int(rest)
    return _Message(stamp=stamp, received=received, values=values, joints=names, odd=odd)


_PARSED = (_JOINT_STATE, _DYNAMIC, _ARRAY)


def _build_columns(
    path: Path, found: Mapping[str, list[_Message]], types: Mapping[str, str], others: tuple[str, ...]
) -> RawLog:
    """Return the columns of all topics, and what was done to each in words."""
    headed = {topic: any(entry.stamp for entry in messages) for topic, messages in found.items()}
    times = {
        topic: [entry.stamp if headed[topic] else entry.received for entry in messages]
        for topic, messages in found.items()
    }
    # Topics may count from elsewhere, as in simulated time; a date that is zero is none.
    dated = {topic for topic, stamps in times.items() if max(stamps) > _EPOCH * _NANO}
    dates = (stamp for topic in dated for stamp in times[topic] if stamp > _EPOCH * _NANO)
    first = min(dates, default=0) // _NANO * _NANO
    columns, notices = dict[str, FloatArray](), list[Notice]()
    for topic, every in found.items():
        origin = first if topic in dated else 0
        messages = [entry for entry, stamp in zip(every, times[topic], strict=True) if stamp or not origin]
        stamps = [stamp for stamp in times[topic] if stamp or not origin]
        joints = tuple(dict.fromkeys(name for entry in messages for name in entry.joints))
        parts = [f"topic {topic} ({types[topic]}): {len(messages)} messages"]
        if len(messages) < len(every):
            parts.append(f"{len(every) - len(messages)} more have a stamp that is zero, and were left out")
        if joints:
            parts.append(f"joints {', '.join(joints)}")
        source = "that of the headers" if headed[topic] else "that of recording"
        if joints and not headed[topic]:
            source += ", because all stamps of the headers are zero"
        parts.append(f"time is {source}" + (f", less {origin // _NANO} s" if origin else ""))
        if joints:
            # Messages in sequence with the same stamp, and with other joints, are one row.
            rows, places, held = list[int](), list[int](), set[str]()
            for k, entry in enumerate(messages):
                same = headed[topic] and k > 0 and stamps[k] == stamps[k - 1]
                if not same or held & set(entry.joints):
                    places.append(k)
                    held = set()
                held |= set(entry.joints)
                rows.append(len(places) - 1)
            keys = dict.fromkeys(key for entry in messages for key in entry.values)
            own = {f"{joint}/{channel}": np.full(len(places), np.nan) for joint, channel in keys}
            for row, entry in zip(rows, messages, strict=True):
                for (joint, channel), value in entry.values.items():
                    own[f"{joint}/{channel}"][row] = value
            listed = dict.fromkeys(entry.joints for entry in messages)
            orders = [order for order in listed if len(set(order)) == len(order)]
            usual = dict.fromkeys(name for order in orders for name in order)
            if any(list(order) != [name for name in usual if name in order] for order in orders):
                parts.append("the order of joints changes between messages, values were assigned by name")
            lacking = sum(set(entry.joints) != set(joints) for entry in messages)
            if lacking:
                parts.append(f"{lacking} messages have a part of the joints only")
            if len(places) < len(messages):
                became = f"{len(messages)} messages became {len(places)} samples"
                parts.append(f"{became}: those with one stamp and other joints are one")
            if odd := sum(entry.odd for entry in messages):
                what = f"{odd} messages have names twice, or not as many values as names"
                parts.append(f"{what}, which were not read")
            stamps = [stamps[place] for place in places]
            steps = np.diff(np.array(stamps)) / _NANO
            onward = steps[steps > 0.0]
            if len(onward):
                median = float(np.median(onward))
                rms = 100.0 * float(np.sqrt(np.mean((onward / median - 1.0) ** 2)))
                size = f"steps of {median:.6g} s, the longest {float(onward.max()):.6g} s"
                parts.append(f"{size}, deviations {rms:.2g} % RMS")
        else:
            sizes = {len(entry.array) for entry in messages if entry.array is not None}
            if len(sizes) != 1 or sizes == {0}:
                others = (*others, f"{topic}/data (arrays of {min(sizes)} to {max(sizes)} numbers)")
                continue
            own = {"data": np.array([entry.array for entry in messages])}
        columns[f"{topic}/time"] = freeze(np.array([(stamp - origin) / _NANO for stamp in stamps]))
        columns |= {f"{topic}/{name}": freeze(values) for name, values in own.items()}
        notices.append(Notice(code="log.topic-read", text="; ".join(parts), file=str(path)))
    siblings = () if path.is_dir() else path.parent.iterdir()
    beside = [entry for entry in siblings if entry.suffix == path.suffix]
    if len(beside) > 1 and (path.parent / _METADATA).exists():
        text = (
            f"this is one of {len(beside)} files of a bag ({_METADATA} is beside them), and the others were "
            f"not read; give the folder {os.path.dirname(path) or '.'} for all of them"  # noqa: PTH120
        )
        notices.append(Notice(code="log.part-of-bag", text=text, file=str(path)))
    return RawLog(columns=columns, others=others, notices=tuple(notices))


_CHANNEL = re.compile(r"(.*)/([^/]+)/(position|velocity|effort)")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W\d_]+")
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}


def pick_topic(raw: RawLog, robot: Robot, findings: Findings) -> tuple[RawLog, dict[str, tuple[str, ...]]]:
    """Return the log, and the columns by quantity of the topic with all joints; none, and why, without one.

    Of a bag, samples without a position or effort of every joint are left out. Tables that a program made of
    a bag have topics too. Topics that are commands by their names must be asked for.
    """
    topics: dict[str, dict[str, set[str]]] = {}
    for match in filter(None, map(_CHANNEL.fullmatch, raw.columns)):
        topics.setdefault(match[1], {}).setdefault(match[2], set()).add(match[3])
    wanted = robot.log.topic
    if wanted is not None and wanted not in topics:
        there = join_names(topics) or "none"
        text = f"there is no topic {wanted!r} with states of joints; the log has {there}"
        findings.refuse("log.topic", text)
        return raw, {}
    named: dict[str, tuple[str, ...]] = {}
    for topic, own in topics.items():
        complete = [name for name, known in own.items() if {"position", "effort"} <= known]
        names = match_joints(complete, [joint.name for joint in robot.axes])
        if names and (topic == wanted or (wanted is None and not is_commanded(topic))):
            named[topic] = names
    own_names = tuple(joint.name for joint in robot.axes)
    exact = [topic for topic, names in named.items() if names == own_names]
    chosen = exact or list(named)
    if len(chosen) != 1:
        # Of a table that is no bag this is a mistake only if several could be meant.
        if chosen:
            text = f"topics {join_names(chosen)} have position and effort of every joint"
            remedy = f'--set log.topic={chosen[0]}, topic = "{chosen[0]}" in [log], or --columns topic='
            findings.refuse("log.topic", f"{text}; choose one: {remedy} of `symid new`")
        elif any(f"{topic}/time" in raw.columns for topic in topics):
            parts = []
            for topic, channels in topics.items():
                if robot.log.topic not in (None, topic):
                    continue
                absent = [name for name in own_names if name not in channels]
                what = [f"lacks {join_names(absent)}"] if absent else []
                for channel in ("position", "effort"):
                    bare = [name for name in own_names if channel not in channels.get(name, {channel})]
                    what += [f"has no {channel} of {join_names(bare)}"] if bare else []
                if not what:
                    what = [f"is a command by its name, log.topic={topic} reads it"]
                parts.append(f"{topic} {' and '.join(what)} (it has {join_names(channels)})")
            text = f"no topic has position and effort of every joint of {robot.name}: {'; '.join(parts)}"
            hint = "cut joints without messages off a URDF by --tip LINK"
            if not any(name in channels for channels in topics.values() for name in own_names):
                hint = "where joints have other names, state the columns of each, in their order: --set "
                hint += (
                    f"log.position.columns={next(iter(topics))}/NAME/position,..., and of velocity and torque"
                )
            findings.refuse("log.topic", f"{text}; {hint}")
        return raw, {}
    (topic,) = chosen
    names = named[topic]
    if names != own_names:
        pairs = ", ".join(f"{mine!r} is {own!r}" for mine, own in zip(names, own_names, strict=True))
        text = f"joints of topic {topic} have other names than those of the robot: {pairs}"
        both = zip(names, own_names, strict=True)
        if all(mine.startswith(own) or own.startswith(mine) for mine, own in both):
            # One more word at the end of all names leaves no choice.
            findings.remark("log.joint-endings", text)
        else:
            findings.remark("log.joint-names", f"{text}; check that it is this robot, whose order was taken")
    fields = {"position": "position", "velocity": "velocity", "torque": "effort"}
    columns = {key: tuple(f"{topic}/{name}/{part}" for name in names) for key, part in fields.items()}
    if any(name not in raw.columns for name in columns["velocity"]):
        del columns["velocity"]
    clock = f"{topic}/time"
    if clock not in raw.columns:
        return raw, columns
    return _keep_complete(raw, topic, columns, findings), {"time": (clock,), **columns}


def match_joints(present: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the names in `present` of joints: the same, or all with another beginning or one ending more.

    Beginnings are whole words, endings more than a number or a letter; left and right are never exchanged.
    None if ambiguous.
    """
    if set(wanted) <= set(present):
        return tuple(wanted)
    found = set()
    # All have an ending more or less, as shoulder_pan_joint and shoulder_pan.
    for name in present:
        for long, short in ((name, wanted[0]), (wanted[0], name)):
            more = long.removeprefix(short)
            if more not in {"", long} and more.strip("_-. ").isalpha() and _has_whole_ending(long, more):
                own = (entry + more if long == name else entry.removesuffix(more) for entry in wanted)
                candidate = tuple(own)
                if len({*candidate} & {*present}) == len(wanted) and not {*candidate} & {*wanted}:
                    found.add(candidate)
    # The beginning that all joints share may be another, as of fer_joint1 and panda_joint1.
    for start in sorted(set.intersection(*map(_list_starts, wanted))):
        beginning, endings = wanted[0][:start], [name[start:] for name in wanted]
        if len({name[:start] for name in wanted}) > 1:
            break
        if any(ending.isdecimal() or len(ending) == 1 for ending in endings):
            continue
        for name in present:
            other = name.removesuffix(endings[0])
            candidate = tuple(other + ending for ending in endings)
            whole = all(len(other) in _list_starts(own) for own in candidate)
            mine, its = _list_sides(beginning), _list_sides(other)
            alike = not mine or not its or mine == its
            if name in candidate and set(candidate) <= set(present) and whole and alike:
                found.add(candidate)
    return found.pop() if len(found) == 1 else ()


def _has_whole_ending(name: str, ending: str) -> bool:
    return len(name) - len(ending.lstrip("_-. ")) in _list_starts(name)


def _list_starts(name: str) -> set[int]:
    """Return where the words of a name begin."""
    return {match.start() for match in _WORD.finditer(name)}


def _list_sides(text: str) -> set[str]:
    return {_SIDES[word.lower()] for word in _WORD.findall(text) if word.lower() in _SIDES}


def _keep_complete(raw: RawLog, topic: str, columns: Names, findings: Findings) -> RawLog:
    """Return the log with those samples of a topic that have position and effort of every joint."""
    needed = np.stack([raw.columns[name] for key in ("position", "torque") for name in columns[key]])
    whole = np.all(np.isfinite(needed), axis=0)
    if whole.all():
        return raw
    count = int(np.sum(~whole))
    text = f"{count} of {len(whole)} samples of topic {topic} lack a position or an effort"
    text = f"{text} of the robot's joints"
    if not whole.any():
        hint = "joints that different programs publish must have one stamp to be joined"
        findings.refuse("log.topic", f"{text}; {hint}, and effort must be measured")
        return raw
    findings.remark("log.incomplete-messages", f"{text} and were left out")
    parts = re.compile(rf"{re.escape(topic)}/([^/]+)/[^/]+")
    # The data and time of a topic below this one look like channels of a joint.
    channels = [
        match[0]
        for match in filter(None, map(parts.fullmatch, raw.columns))
        if _CHANNEL.fullmatch(match[0]) or f"{topic}/{match[1]}/time" not in raw.columns
    ]
    own = (f"{topic}/time", *channels)
    return replace(raw, columns={**raw.columns, **{name: raw.columns[name][whole] for name in own}})
