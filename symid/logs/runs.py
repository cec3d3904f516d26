"""Logs of one call: several runs as one set, each log read once, all mistakes at once.

Paths of logs or of `.toml` files that list runs, or recordings -> recordings with their RunSettings.

    [[run]]
    file = "monday.npz"            # weight, drop_first, drop_last, train, payload, offset: see RunSettings
    payload = { name = "disc", joint = "elbow", mass = 1.2, com = [0, 0, 0.05], inertia = { xx = 0.01 } }

A known payload is given in the frame of `[joint.link]`; its torques, of beta_loaded = beta + K_link pi, leave
the equations.

Supported: a file may come twice with other samples; payloads on any link; a name alone for unknown ones.
Not supported: other columns or units for single runs; a payload of bodies on several links.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import zip_longest
from pathlib import Path
from typing import TypeVar

import numpy as np

from symid import robot as robots
from symid.arrays import FloatArray
from symid.errors import InputError, LogError, Notice, RobotError, UsageError
from symid.logs.faults import repair_recording
from symid.logs.reader import read_recording
from symid.logs.recording import (
    Recording,
    RunSettings,
    add_notice,
    cut_ends,
    cut_recording,
    join_units,
    read_part,
    take_part,
)
from symid.notation import INERTIAL
from symid.serialization import compute_file_digest, compute_signature, read_record, write_plain

T = TypeVar("T")


def read_payload(section: robots.Section, robot: robots.Robot) -> tuple[str, tuple[float, ...]]:
    """Return a payload's name, and what it adds to beta (p,): nothing where it is not known."""
    value = section.values.get("payload")
    if not isinstance(value, dict):
        return section.read_text("payload") or "", ()
    names = [joint.name for joint in robot.joints]
    inner = section.inside(value, "payload", "payload")
    joint = inner.read_text("joint") or names[-1]
    name = inner.read_text("name") or "payload"
    if joint not in names:
        text = f"there is no joint {joint!r}; allowed are {', '.join(names)}"
        inner.refuse("runs.unknown-joint", "joint", text)
        return name, ()
    link = names.index(joint)
    section = replace(section, symbols=dict(robot.symbols))
    parameters, _ = robots.read_body(section, "payload", robot.joints[link].frame, ("name", "joint"))
    if parameters is None:
        return name, ()
    from symid.dynamics import build_grouping, derive_base_parameters

    grouping = build_grouping(robot, derive_base_parameters(robot))
    columns = [grouping.labels.index((link, key)) for key in INERTIAL]
    return name, tuple(map(float, grouping.matrix[:, columns] @ np.array(parameters)))


def _read_all(logs: Iterable[T], read: Callable[[T], Iterable[Recording]]) -> tuple[Recording, ...]:
    """Return the recordings that `read` gives for each of `logs`, or raise all their mistakes at once."""
    recordings: list[Recording] = []
    notices: list[Notice] = []
    for log in logs:
        try:
            recordings += read(log)
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(recordings)


_SUFFIX = ".toml"
_KEYS = ("file", "weight", "drop_first", "drop_last", "train", "payload", "offset")


def read_log_runs(
    path: Path, robot: robots.Robot, *, uneven: bool = False, control: bool = True
) -> tuple[Recording, ...]:
    """Return the recording of a log, or those of all runs of a `.toml`, or raise all mistakes."""
    if path.suffix.lower() != _SUFFIX:
        return _read_repaired(path, robot, uneven=uneven, control=control)
    runs, warnings = _parse_runs(path, robot)

    def read(run: RunSettings) -> list[Recording]:
        parts = _read_repaired(Path(run.file), robot, uneven=uneven, control=control)
        return [_apply_settings(part, run) for part in parts]

    first, *others = _read_all(runs, read)
    return (replace(first, notices=(*warnings, *first.notices)), *others)


_UNEVEN = frozenset(("log.gap", "log.jitter"))
_AGAIN, _EPISODE, _NAMED = 0.1, 16, 3
"""Part of a recording's length from its start to which a clock that starts again goes back; its samples; and
how many such samples a note names."""


def _read_repaired(
    path: Path, robot: robots.Robot, *, uneven: bool = False, control: bool = True
) -> tuple[Recording, ...]:
    """Return the recordings in a log, as they are if `uneven`, else without faults, and notices say so."""
    try:
        parts = [read_recording(path, robot, uneven=uneven, control=control)]
    except LogError as error:
        codes = {notice.code for notice in error.notices}
        if not codes <= _UNEVEN | {"log.time-order"}:
            raise
        parts = [read_recording(path, robot, uneven=True, control=control)]
        if "log.time-order" in codes and len(_find_episodes(parts[0].time)) == 1:
            raise
    ends = _find_episodes(parts[0].time)
    if len(ends) > 1:
        again = ", ".join(map(str, ends[:-1][:_NAMED])) + ", ..." * (len(ends) > _NAMED + 1)
        text = f"time starts again at sample {again} (counted from 0): the file was read as {len(ends)} logs"
        whole = add_notice(parts[0], "log.episodes", text)
        parts = []
        for start, end in zip((0, *ends), ends, strict=False):
            # What was said of the file is said once.
            told = () if start else whole.notices
            cut = cut_recording(whole, slice(start, end))
            parts.append(replace(cut, whole=None, place=start, notices=told))
    return tuple(parts) if uneven else tuple(repair_recording(part, robot.axes) for part in parts)


def _find_episodes(time: FloatArray) -> list[int]:
    """Return the samples behind the end of each episode: at the next one, time (N,) is where it began."""
    ends, start = list[int](), 0
    for place in (np.flatnonzero(np.diff(time) < 0.0) + 1).tolist():
        again = time[place] - time[start] <= _AGAIN * (time[place - 1] - time[start])
        if again and min(place - start, len(time) - place) >= _EPISODE:
            ends.append(place)
            start = place
    return [*ends, len(time)]


def list_log_files(path: Path, robot: robots.Robot) -> tuple[Path, ...]:
    """Return the log `path`, in place of a `.toml` the different logs of its runs."""
    if path.suffix.lower() != _SUFFIX:
        return (path,)
    return tuple(dict.fromkeys(Path(run.file) for run in _parse_runs(path, robot)[0]))


def _parse_runs(path: Path, robot: robots.Robot) -> tuple[tuple[RunSettings, ...], tuple[Notice, ...]]:
    """Return the runs that a file lists, and warnings; mistakes are raised with their places."""
    try:
        root = robots.parse_toml(robots.read_text_file(path), str(path), "robot.syntax")
    except RobotError as error:
        raise LogError(*map(_rename, error.notices)) from error
    root.refuse_unknown_keys(("run",))
    tables = root.get("run")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        root.refuse_key("runs.no-run", "run", 'missing; write [[run]] and file = "log.npz" below it')
        tables = []
    runs = []
    for index, table in enumerate(tables):
        section = root.inside(table, f"run {index + 1}", "run", index)
        section.refuse_unknown_keys(_KEYS)
        section.require("file", 'write file = "log.npz"')
        weight = section.read_float("weight", "", robots.POSITIVE)
        payload, load = read_payload(section, robot)
        train = section.read_text("train")
        try:
            train = "" if train is None else read_part(train, "train").text
        except UsageError as error:
            section.refuse("runs.log-part", "train", error.notices[0].text.removeprefix("train "))
        run = RunSettings(
            file=str(path.parent / (section.read_text("file") or "")),
            weight=1.0 if weight is None else weight,
            drop_first=section.read_integer("drop_first", robots.NOT_NEGATIVE) or 0,
            drop_last=section.read_integer("drop_last", robots.NOT_NEGATIVE) or 0,
            train=train or "",
            payload=payload,
            load=load,
            offset=robots.read_offset(section, robot.freedom) or (0.0,),
        )
        runs.append(run)
    if root.errors:
        raise LogError(*map(_rename, robots.sort_notices(root.errors)))
    return tuple(runs), tuple(map(_rename, robots.sort_notices(root.warnings)))


def _rename(notice: Notice) -> Notice:
    """Return the notice with a code of runs: the file is no robot file."""
    return replace(notice, code=notice.code.replace("robot.", "runs.", 1))


def _apply_settings(recording: Recording, run: RunSettings) -> Recording:
    """Return the recording with the settings of the run applied, and a notice for each."""
    cut = cut_ends(recording, run.drop_first, run.drop_last)
    if run.train:
        cut = take_part(cut, read_part(run.train, "train"), "train")
    if run.load:
        text = f"the torque of the known payload {run.payload!r} is subtracted from the measured one"
        cut = add_notice(cut, "log.payload", text)
    if any(run.offset):
        added = ", ".join(f"{value:.10g}" for value in run.offset)
        text = f"{added} was added to the positions, as set for the run"
        offset = np.array(run.offset)
        reference = None if cut.reference is None else cut.reference + offset
        cut = add_notice(cut, "log.offset", text)
        cut = replace(cut, position=cut.position + offset, reference=reference)
    return replace(cut, run=run)


def get_run_weights(recordings: Sequence[Recording]) -> tuple[float, ...] | None:
    """Return the weights of the recordings' squared residuals; None where all are equal."""
    weights = tuple(1.0 if recording.run is None else recording.run.weight for recording in recordings)
    return None if len(set(weights)) == 1 else weights


def read_recorded_runs(
    sources: Sequence[str], settings: Mapping[str, object], robot: robots.Robot
) -> tuple[Recording, ...]:
    """Return the recordings of a result, read again with the settings of their runs, or raise all LogErrors.

    `sources`: the files, one a run, in the order of the fit; `settings`: with the entries of `describe_runs`.
    """
    stored, digests = settings.get("runs"), settings.get("log_digests")

    def read(log: tuple[str, RunSettings | None, object]) -> list[Recording]:
        file, run, digest = log
        parts = _read_repaired(Path(file), robot)
        recording = next((part for part in parts if str(digest).endswith(f"@{part.place}")), parts[0])
        return [recording if run is None else _apply_settings(recording, run)]

    entries = [{}] * len(sources) if stored is None else write_plain(stored)
    found: list[RunSettings | None] = []
    try:
        listed = entries if isinstance(entries, list) else []
        found = [read_record(RunSettings, entry) if entry else None for entry in listed]
        stated = [run for run in found if run is not None]
        good = all(min(run.drop_first, run.drop_last) >= 0 for run in stated)
        good &= all(len(run.offset) in {1, robot.freedom} for run in stated)
        _ = [read_part(run.train, "train") for run in stated if run.train]
    except (InputError, UsageError):
        good = False
    if len(found) != len(sources) or not good:
        text = f"the settings of the runs cannot be used: expected one table for each of {len(sources)} "
        text += f"logs, with {', '.join(_KEYS)}, got {stored!r}; identify again"
        raise LogError(Notice(code="runs.settings", text=text))
    known = digests if isinstance(digests, list | tuple) else ()
    return _read_all(zip_longest(sources, found, known[: len(sources)]), read)


def check_one_payload(recordings: Sequence[Recording]) -> None:
    """Refuse runs with different unknown payloads for one set of parameters."""
    runs = [recording.run for recording in recordings]
    names = sorted({"" if run is None or run.load else run.payload for run in runs})
    if len(names) > 1:
        listed = ", ".join(repr(name) if name else "none" for name in names)
        text = f"the runs have different payloads ({listed}), and base parameters depend on the payload; "
        text += "state mass, com and inertia of the known ones, or identify with each payload alone and use "
        text += "`symid payload`"
        raise LogError(Notice(code="log.payloads-differ", text=text))


def refuse_known_payloads(recordings: Sequence[Recording], what: str) -> None:
    """Refuse known payloads, by a LogError, for a method, named by `what`, that does not support them."""
    text = f"the run has a known payload, which {what} does not support; leave the run out, or use torque "
    text += "equations of a rigid robot"
    loaded = [entry.source for entry in recordings if entry.run is not None and entry.run.load]
    if loaded:
        raise LogError(*(Notice(code="log.known-payload", text=text, file=source) for source in loaded))


IN_MEMORY_PREFIX = "samples:"
"""Prefix of the digest of a log that is no file."""


def read_one_log(log: Path | Recording, robot: robots.Robot, alone: str = "") -> Recording:
    """Return the recording of one log, or of a file of one run; a UsageError if it lists several.

    `alone` names a method that does not support known payloads; LogErrors name all mistakes of the log.
    """
    recordings = read_recordings((log,), robot)
    if len(recordings) > 1:
        text = f"has {len(recordings)} logs, expected one: give a file of one, or one of symid.read_logs"
        raise UsageError(Notice(code="usage.one-log", text=text, file=str(log)))
    if alone:
        refuse_known_payloads(recordings, alone)
    return recordings[0]


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse a log that is given twice, by a UsageError: its noise would be underestimated."""
    known: dict[object, Path] = {}
    for path in paths if len(paths) > 1 else ():
        marks = (path.resolve(), compute_file_digest(str(path)) or path.resolve())
        for mark in marks:
            if mark in known:
                text = f"the same log as {known[mark]}; give each log once"
                raise UsageError(Notice(code="usage.same-log", text=text, file=str(path)))
        known |= dict.fromkeys(marks, path)


def compute_log_digests(recordings: Sequence[Recording]) -> list[str]:
    """Return the digests of the files of recordings; of torques, with a prefix, where there is no file.

    Parts of one log have the digest of the whole; of a further log in a file it is followed by `@` and the
    place of its first sample.
    """
    return [
        f"{compute_file_digest(entry.source) or _sign_samples(entry)}{f'@{entry.place}' * bool(entry.place)}"
        for entry in recordings
    ]


def _sign_samples(recording: Recording) -> str:
    return f"{IN_MEMORY_PREFIX}{recording.extent.digest or compute_signature(recording.torque)}"


def is_digest_of_file(digest: str, file: str) -> bool:
    """Return whether the digest of a log says what the file holds now."""
    return digest.partition("@")[0] == compute_file_digest(file)


def describe_runs(recordings: Sequence[Recording]) -> dict[str, object]:
    """Return for the echo in a result the digests of its logs, and which parts and runs they are, if any.

    Entries of "parts" are the first and the last time stamp in s; null is the whole log.
    """
    parts = [
        None if entry.whole is None else {"start": float(entry.time[0]), "end": float(entry.time[-1])}
        for entry in recordings
    ]
    runs = [{} if entry.run is None else asdict(entry.run) for entry in recordings]
    told = {"parts": parts if any(parts) else None, "runs": runs if any(runs) else None}
    found = {name: value for name, value in told.items() if value is not None}
    return {"log_digests": compute_log_digests(recordings), **found}


def is_log_of_fit(recording: Recording, sources: Sequence[str], settings: Mapping[str, object]) -> bool:
    """Return whether a recording is one of the logs of a fit, by its content or by its file.

    `sources` and `settings`, with the "log_digests" of `compute_log_digests`, are those of the fit.
    """
    if not recording.source:
        return False
    stored = settings.get("log_digests")
    known = [str(digest) for digest in stored if digest] if isinstance(stored, list | tuple) else []
    own = compute_log_digests((recording,))[0]
    if any(digest.partition("@")[0] == own.partition("@")[0] for digest in known):
        # Another log of the same file is none of them.
        return own in known
    # Logs that are no files may have the same name.
    named = Path(recording.source).resolve() in {Path(source).resolve() for source in sources}
    return named and (not known or os.path.isfile(recording.source))  # noqa: PTH113


Ends = tuple[int | None, int | None]
"""Samples that the processing cuts off at the start and at the end of a recording; None for none."""


def measure_overlap(
    recording: Recording,
    sources: Sequence[str],
    settings: Mapping[str, object],
    *,
    cut: Ends = (0, 0),
    fitted_cut: Ends = (0, 0),
) -> float:
    """Return how many seconds of a recording a fit was made from, 0 where it is none of its logs.

    `sources` and `settings` are those of the fit; `cut` and `fitted_cut` the samples that were cut off after
    reading, here and in the fit.
    """
    if not is_log_of_fit(recording, sources, settings):
        return 0.0
    period, extent = recording.period, recording.extent
    digest = compute_log_digests((recording,))[0]
    known, parts = (settings.get(name) for name in ("log_digests", "parts"))
    listed, stated = ([*part] if isinstance(part, list | tuple) else [] for part in (known, parts))
    whole = (extent.start, extent.end - period)
    # The first and the last time stamp of each part, of the whole log where the file of a fit has none.
    used: list[tuple[float, float]] = []
    for entry, part in zip_longest(listed, stated):
        ends = [part.get(name) for name in ("start", "end")] if isinstance(part, Mapping) else []
        stamps = [float(value) for value in ends if isinstance(value, int | float)]
        if entry == digest:
            used.append((stamps[0], stamps[1]) if len(stamps) == 2 else whole)
    before, after = ((entry or 0) * period for entry in fitted_cut)
    first, last = (float(stamp) for stamp in recording.time[[cut[0] or 0, -1 - (cut[1] or 0)]])
    overlap, reached = 0.0, first
    # From left to right, so that nothing counts twice.
    for start, end in sorted(used or [whole]):
        begin, stop = max(start + before, reached), min(end - after, last)
        # Neighbours share no sample.
        if stop - begin > -0.5 * period:
            overlap += stop - begin + period
            reached = stop + period
    return overlap


def describe_overlap(overlap: float, recording: Recording, cut: Ends = (0, 0)) -> str:
    """Return which part of a recording a fit was made from, in words."""
    length = (len(recording.time) - (cut[0] or 0) - (cut[1] or 0)) * recording.period
    return f"{min(overlap, length):.4g} of the {length:.4g} s predicted here"


def get_train_unit(settings: Mapping[str, object]) -> str:
    """Return the unit that the parts of a fit's logs state; empty for none, see `join_units`."""
    runs = settings.get("runs")
    entries = runs if isinstance(runs, list | tuple) else []
    texts = [run.get("train") for run in entries if isinstance(run, Mapping)]
    try:
        return join_units([read_part(text, "train") for text in texts if isinstance(text, str) and text])
    except UsageError:
        return ""


def describe_logs(robot: robots.Robot, recordings: Sequence[Recording]) -> dict[str, object]:
    """Return for the echo in a result the log map, the files' digests, the runs' settings."""
    return {"log": robots.describe_settings(robot)["log"], **describe_runs(recordings)}


def read_recordings(
    logs: Sequence[Path | Recording], robot: robots.Robot, *, uneven: bool = False, control: bool = True
) -> tuple[Recording, ...]:
    """Return the recordings of logs (files, files of runs, recordings), or a LogError with all mistakes.

    `robot`: its `[log]` map says which column is what; `uneven`: whether logs stay as they are, with uneven
    time stamps and other faults; `control`: whether recordings of files keep the controller's channels.
    """

    def read(log: Path | Recording) -> tuple[Recording, ...]:
        if isinstance(log, Path):
            return read_log_runs(log, robot, uneven=uneven, control=control)
        joints = log.position.shape[1]
        if joints != robot.freedom:
            text = f"has {joints} joints, the robot {robot.name!r} {robot.freedom}; read it with this robot"
            raise LogError(Notice(code="log.joints", text=text, file=log.source))
        return (log if uneven else repair_recording(log, robot.axes),)

    return _read_all(logs, read)


def read_fit_recordings(
    logs: Sequence[Path | Recording], robot: robots.Robot, *, control: bool = True
) -> tuple[Recording, ...]:
    """Return the recordings for one fit; see `read_recordings`.

    A UsageError refuses a log that is given twice, or none, a LogError different payloads.
    """
    if not logs:
        raise UsageError(Notice(code="usage.no-log", text="no log was given; name at least one"))
    files = [entry for entry in logs if isinstance(entry, Path)]
    read = (entry for entry in logs if isinstance(entry, Recording))
    # Further logs of one file are known by their samples.
    others = [Path(entry.source) for entry in read if entry.run is None and not entry.place]
    # The source of a recording may be any text, which Path.is_file may refuse.
    named = [path for path in others if os.path.isfile(path)]  # noqa: PTH113
    check_distinct([*(file for path in files for file in list_log_files(path, robot)), *named])
    recordings = read_recordings(logs, robot, control=control)
    check_distinct_samples(recordings)
    check_one_payload(recordings)
    return recordings


_SAME = 1e-3
"""Times the rms of a torque: two logs that differ by less have the same samples, rounded or moved in time."""


def check_distinct_samples(recordings: Sequence[Recording]) -> None:
    """Refuse two recordings with the same positions and torques, by a UsageError: noise would count twice."""
    for entry, other in ((entry, other) for k, entry in enumerate(recordings) for other in recordings[:k]):
        pairs = (entry.torque, other.torque), (entry.position, other.position)
        if entry is other or all(_is_same(*pair) for pair in pairs):
            text = f"the same samples as {other.source}; give each log once"
            raise UsageError(Notice(code="usage.same-log", text=text, file=entry.source))


def _is_same(values: FloatArray, others: FloatArray) -> bool:
    """Return whether two channels (N, n) are the same up to rounding."""
    if values.shape != others.shape:
        return False
    size = float(np.sqrt(np.mean((values - values.mean(axis=0)) ** 2)))
    return float(np.sqrt(np.mean((values - others) ** 2))) <= _SAME * size
