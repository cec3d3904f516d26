"""The jobs of a fleet: which logs of which robot are identified, and how.

A study file, or a table, a folder or a pattern of logs -> `FleetJob`, each with the hash of its inputs.

The keys of a study file stand in docs/fleet.md; several rows, estimators or laws make a job each.

Seeds are spawned (`SeedSequence.spawn`) from that of the study and the other inputs of the job, so that they
do not depend on the order of the jobs, on other jobs or on workers.

Supported: tables in CSV and Parquet; local files, and whatever fsspec reads, by its address (s3://...).
Not supported: a table and a pattern at once.
"""

import csv
import glob
import itertools
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from symid import __version__, load
from symid.errors import InputError, Notice, SymidError, UsageError
from symid.options import SimulateOptions, list_flags
from symid.robot import NOT_NEGATIVE, POSITIVE, Section, locate_robot_file, parse_toml, read_text_file
from symid.serialization import compute_file_digest, compute_signature

if TYPE_CHECKING:
    import fsspec

SUFFIXES = (".csv", ".npz", ".mat", ".h5", ".hdf5", ".parquet", ".mcap", ".db3")
"""Of logs in a folder."""
_WORDS = ("rows", "estimator", "friction")
_KEYS = ("robot", "logs", "table", *_WORDS, "repeats", "seed", "settings", "simulate")
_COLUMNS = ("robot", "logs", "name", "night", *_WORDS, "seed")
_MOST_PROBLEMS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetJob:
    """One identification: which robot, which logs, how.

    Attributes:
        robot: name, file or address of the robot's description.
        logs: files or addresses; none where the log is simulated.
        name: of the robot in the fleet, such as its serial number.
        night: when the logs were recorded, in the order of text: a date or a number of fixed length.
        rows: how measurements become equations, as for `RobotModel.identify`, or "friction".
        estimator: how equations become parameters.
        friction: the friction law.
        seed: of all random numbers of the job; None where there are none.
        settings: in place of those of the robot file, by dotted key.
        simulate: trajectory and options of `symid simulate` by their names, where there are no logs.

    Example:
        >>> import symid
        >>> symid.fleet.FleetJob(robot="panda", logs=("monday.npz",), name="arm 7").night
        ''
    """

    robot: str
    logs: tuple[str, ...] = ()
    name: str = ""
    night: str = ""
    rows: str | None = None
    estimator: str | None = None
    friction: str | None = None
    seed: int | None = None
    settings: Mapping[str, object] = field(default_factory=dict)
    simulate: Mapping[str, object] = field(default_factory=dict)


def read_study(path: Path) -> tuple[FleetJob, ...]:
    r"""Return the jobs of the study file `path`; paths in it are relative to its folder.

    Raises:
        InputError: with all mistakes of the file or of its table, or because there are no jobs.
        UsageError: an address needs a package that is not installed.

    Example:
        >>> import symid
        >>> from pathlib import Path
        >>> text = 'robot = "two_link"\nrepeats = 3\n[simulate]\nduration = 2.0\n'
        >>> _ = Path("study.toml").write_text(text)
        >>> len(symid.fleet.read_study(Path("study.toml")))
        3
    """
    root = parse_toml(read_text_file(path), str(path), "fleet.syntax")
    root.refuse_unknown_keys(_KEYS)
    robot, logs, table = (root.read_text(key) for key in ("robot", "logs", "table"))
    # One text or a list of them; (None,) where there are none.
    words = list[Sequence[str | None]]()
    for key in _WORDS:
        value = root.get(key)
        words.append(value if isinstance(value, list) else [value])
        if not words[-1] or not all(isinstance(word, str) for word in words[-1] if value is not None):
            root.refuse("fleet.words", key, f"expected a text or a list of texts, got {root.show(key)}")
    repeats, seed = root.read_integer("repeats", POSITIVE) or 1, root.read_integer("seed", NOT_NEGATIVE) or 0
    settings = _read_plain(root, "settings")
    allowed = [name for name in ("trajectory", *list_flags(SimulateOptions)) if name != "seed"]
    simulate = _read_plain(root, "simulate", allowed)
    sources = [key for key in ("logs", "table", "simulate") if key in root.values]
    if len(sources) != 1:
        root.refuse_key("fleet.source", (sources or ["logs"])[-1], "give one of logs, table and [simulate]")
    if table is None:
        root.require("robot", 'write robot = "NAME", or a table with a column robot')
    root.finish()
    folder = str(path.parent)
    known = None if robot is None else _join_robot(folder, robot)
    if table is not None:
        jobs = _read_table(_join(folder, table), known)
    elif logs is not None:
        found = list_logs(_join(folder, logs))
        jobs = tuple(_name_job(FleetJob(robot=known or "", logs=(log,))) for log in found)
    else:
        jobs = (_name_job(FleetJob(robot=known or "", simulate=simulate)),)
    return spawn_jobs([replace(job, settings=settings) for job in jobs], words, repeats=repeats, seed=seed)


def _read_plain(section: Section, key: str, allowed: Iterable[str] = ()) -> dict[str, object]:
    table = section.read_table(key, allowed)

    def make_plain(value: object) -> object:
        match value:
            case Decimal():
                return float(value)
            case list():
                return list(map(make_plain, value))
            case None | bool() | int() | str():
                return value
        return str(value)

    return {} if table is None else {name: make_plain(value) for name, value in table.values.items()}


def is_remote(name: str) -> bool:
    """Return whether a name is an address, such as s3://bucket/log.parquet."""
    return "://" in name


def open_address(name: str) -> "tuple[fsspec.AbstractFileSystem, str]":
    """Return the file system of an address, and the path in it.

    Raises:
        UsageError: fsspec, or the package of its protocol, is not installed.
        InputError: there is no such file system, or no access to it.
    """
    try:
        from fsspec.core import url_to_fs

        system, path = url_to_fs(name)
    except ImportError as error:
        text = f"{name}: {error}; addresses need fsspec: pip install 'symid[cluster]'"
        raise UsageError(Notice(code="usage.no-fsspec", text=text)) from error
    except Exception as error:
        text = f"cannot be opened: {error}"
        raise InputError(Notice(code="fleet.address", text=text, file=name)) from error
    return system, path


def _join(folder: str, name: str) -> str:
    """Return a path relative to the working folder; an address stays as it is."""
    return name if is_remote(name) else str(Path(folder) / name)


def _join_robot(folder: str, robot: str) -> str:
    """Return the robot's file beside the study, if there is one, else its name."""
    beside = Path(folder) / robot
    return str(beside) if not is_remote(robot) and Path(robot).suffix and beside.is_file() else robot


def _name_job(job: FleetJob) -> FleetJob:
    """Return a job with the name and the night that its first log has: ROBOT/NIGHT.suffix."""
    if not job.logs:
        return replace(job, name=job.name or PurePosixPath(job.robot).stem)
    first = PurePosixPath(job.logs[0])
    return replace(job, name=job.name or first.parent.name, night=job.night or first.stem)


def list_logs(name: str) -> tuple[str, ...]:
    """Return the logs in a folder and below it, or those that a pattern matches, in the order of names.

    Raises:
        InputError: there are none, or an address cannot be read.
    """
    pattern = any(mark in name for mark in "*?[")
    if is_remote(name):
        system, path = open_address(name)
        try:
            found = system.glob(path) if pattern else system.find(path)
        except Exception as error:
            text = f"cannot be read: {error}"
            raise InputError(Notice(code="fleet.address", text=text, file=name)) from error
        found = [system.unstrip_protocol(entry) for entry in found]
    elif pattern:
        found = glob.glob(name, recursive=True)  # noqa: PTH207  the pattern may be absolute
    else:
        found = [str(entry) for entry in Path(name).rglob("*") if entry.is_file()]
    logs = [entry for entry in found if pattern or PurePosixPath(entry).suffix.lower() in SUFFIXES]
    if not logs:
        text = f"no logs found; expected files such as ROBOT/NIGHT.parquet ({', '.join(SUFFIXES)})"
        raise InputError(Notice(code="fleet.no-logs", text=text, file=name))
    return tuple(sorted(logs))


def _read_table(name: str, robot: str | None) -> tuple[FleetJob, ...]:
    """Return the jobs of a table; several logs of one job stand apart by semicolons."""
    path, problems, jobs = Path(name), [], []
    for line, row in _read_rows(path):
        given = {key: str(value).strip() for key, value in row.items() if value is not None and value != ""}
        unknown = [key for key in given if key not in _COLUMNS]
        named = _join_robot(str(path.parent), given["robot"]) if "robot" in given else robot
        logs = tuple(_join(str(path.parent), log.strip()) for log in given.get("logs", "").split(";") if log)
        seed = given.get("seed", "")
        for wrong, text in (
            (unknown, f"no such column: {', '.join(unknown)}; there are {', '.join(_COLUMNS)}"),
            (named is None, "no robot; give a column robot, or write robot in the study file"),
            (not logs, "no logs; give the column logs, several with semicolons between them"),
            (seed and not seed.isdecimal(), f"seed: expected a whole number of 0 or more, got {seed!r:.40}"),
        ):
            if wrong:
                problems.append(Notice(code="fleet.table", text=text, file=name, line=line))
        if not problems:
            rest: dict[str, Any] = {key: given[key] for key in ("name", "night", *_WORDS) if key in given}
            number = int(seed) if seed else None
            jobs.append(_name_job(FleetJob(robot=named or "", logs=logs, seed=number, **rest)))
    if not jobs and not problems:
        problems.append(Notice(code="fleet.table", text="the table has no rows", file=name))
    if problems:
        raise InputError(*problems[:_MOST_PROBLEMS])
    return tuple(jobs)


def _read_rows(path: Path) -> Iterator[tuple[int, Mapping[str, Any]]]:
    if path.suffix.lower() == ".parquet":
        try:
            from pyarrow import ArrowException
            from pyarrow.parquet import read_table
        except ImportError as error:
            text = "a table in Parquet needs pyarrow: pip install 'symid[parquet]'"
            raise UsageError(Notice(code="usage.no-pyarrow", text=text, file=str(path))) from error
        try:
            rows = read_table(path).to_pylist()
        except (OSError, ArrowException) as error:
            text = f"cannot be read as Parquet: {error}"
            raise InputError(Notice(code="fleet.table", text=text, file=str(path))) from error
        yield from enumerate(rows, start=1)
        return
    reader = csv.DictReader(read_text_file(path, "table").splitlines(), restkey="(more cells than columns)")
    try:
        yield from ((reader.line_num, row) for row in reader)
    except csv.Error as error:
        notice = Notice(code="fleet.table", text=f"no CSV: {error}", file=str(path), line=reader.line_num)
        raise InputError(notice) from error


def spawn_jobs(
    jobs: Sequence[FleetJob],
    words: Sequence[Sequence[str | None]] = ((None,), (None,), (None,)),
    *,
    repeats: int = 1,
    seed: int = 0,
) -> tuple[FleetJob, ...]:
    """Return the jobs with every choice of rows, estimator and friction, `repeats` times with other seeds.

    What a job states itself stays. A job gets seeds if there are several repeats, or if its log is simulated.
    """
    found = []
    for job in jobs:
        for choice in itertools.product(*words):
            stated: dict[str, Any] = {
                key: getattr(job, key) or word for key, word in zip(_WORDS, choice, strict=True)
            }
            made = replace(job, **stated)
            if made.seed is not None or (repeats == 1 and not made.simulate):
                found.append(made)
                continue
            digest = compute_signature(made)
            root = np.random.SeedSequence(seed, spawn_key=(int(digest[:15], 16),))
            # 63 bits: a column of a table holds them.
            seeds = (int(child.generate_state(1, np.uint64)[0]) >> 1 for child in root.spawn(repeats))
            found += [replace(made, seed=number) for number in seeds]
    return tuple(found)


def compute_key(job: FleetJob, digest: Callable[[str], str]) -> str:
    """Return the hash of a job and of the content of its robot and logs, 32 hexadecimal digits.

    Files that a robot or a file of runs names count too; what is in an address counts by what its file
    system calls its version. `digest` is `digest_robot`, which may remember what it has read.
    """
    digests = [_digest_log(log) for log in job.logs]
    return compute_signature("symid fleet 1", __version__, job, digest(job.robot), digests)[:32]


def _digest_log(name: str) -> str:
    if is_remote(name):
        system, path = open_address(name)
        try:
            return str(system.ukey(path))
        except Exception:  # noqa: BLE001  each file system has errors of its own; the job will say so
            return ""
    if name.lower().endswith(".toml"):
        try:
            runs = tomllib.loads(Path(name).read_text(encoding="utf-8"))["run"]
            files = [str(Path(name).parent / run["file"]) for run in runs]
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            # The job will say what is wrong.
            files = []
        return compute_signature(*map(compute_file_digest, (name, *files)))
    return compute_file_digest(name)


def digest_robot(name: str) -> str:
    """Return the digest of a robot: of a TOML file itself, of others what was read, with included files."""
    if is_remote(name):
        return _digest_log(name)
    try:
        path = locate_robot_file(name)
        if path.suffix.lower() == ".toml":
            return compute_file_digest(str(path))
        return compute_signature(replace(load(name).description, made_from=None))
    except SymidError as error:
        return compute_signature(str(error), compute_file_digest(name))
