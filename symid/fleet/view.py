"""A fleet: its jobs are run, and its rows say which robots changed, in which parameter, since when.

A row goes to FOLDER/results/KEY.json at once, where KEY is the hash of the job's inputs; a job whose row is
there is not run again, so that a fleet that was killed goes on where it was. FOLDER/costs.csv has times.

Jobs -> `Fleet`: rows, tables, a page, Parquet. For every robot and parameter the nights x_1 .. x_n, with
stated deviations s_1 .. s_n, are cut before each night k; with weights 1 / s^2,

    z_k = (mean after - mean before) / sqrt(1 / W_after + 1 / W_before),     z = max |z_k|,
    p = 1 - (1 - 2 Phi(-z))^(n - 1)                                        (Sidak 1967: at most this)

and all robots and parameters are judged together by Benjamini and Hochberg (1995) or by Holm (1979). Where
the median robot varies more from night to night than its deviations state, all deviations of that parameter
are enlarged to what it shows. Residuals state none: the fleet's is taken.

Supported: nights of any number, gaps, robots of several kinds. Not supported: a change of more than half of
the robots, which is taken for scatter; nights looked at one by one with the level kept for all of them.
"""

import contextlib
import csv
import errno
import fcntl
import io
import json
import math
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from os import PathLike, fspath
from pathlib import Path
from typing import Literal, NamedTuple, final

import numpy as np
from scipy.special import chdtri, ndtr

from symid.api import PagedResult
from symid.arrays import FloatArray
from symid.environment import describe_duration, read_file, write_file
from symid.errors import InputError, Notice, OutputError, UsageError
from symid.fleet.jobs import FleetJob, compute_key, digest_robot, read_study
from symid.fleet.running import Ended, FleetLimits, FleetRow, Task, run_dask, run_job, run_processes
from symid.report import Block, Drawing, FitVerdict, Line, Page, Table, build_line_figure
from symid.serialization import read_record, write_json

Progress = Callable[[str], None]
Control = Literal["benjamini-hochberg", "holm"]
_FEWEST_ROBOTS = 20
"""Series of one quantity from which on their scatter is compared with the stated deviations."""
_MOST_SHOWN = 40
_MOST_DRAWN = 12
_LEVELS = "Good: no robot changed and every job has a fit; wrong: no job has one; doubtful: all else."
_ENLARGED = 1.2
_COLUMNS = (
    *("key", "name", "night", "robot", "logs", "rows", "estimator", "friction", "seed", "status", "reason"),
    *("verdict", "kind", "parameter", "value", "std", "unit"),
)
_FORMAT = "symid fleet"
_SECONDS_BETWEEN = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotChange:
    """A change of one parameter, or of the residual of one joint, of one robot.

    Attributes:
        name: of the robot.
        quantity: name of the parameter, or of the joint.
        residual: whether it is a residual; its values are logarithms then.
        since: the first night after the change.
        before: mean of the nights before, weighted by their deviations.
        after: the same of the nights after.
        std: standard deviation of the difference.
        unit: of the values.
        p: probability of a change as large by chance.
        adjusted: the same, with all other robots and parameters accounted for.
        values: of all nights.
        nights: their names.

    Example:
        >>> import symid
        >>> symid.fleet.run([], "nights").changes()
        ()
    """

    name: str
    quantity: str
    residual: bool
    since: str
    before: float
    after: float
    std: float
    unit: str
    p: float
    adjusted: float
    values: tuple[float, ...]
    nights: tuple[str, ...]

    @property
    def sigma(self) -> float:
        """Return the difference in standard deviations."""
        return (self.after - self.before) / self.std


class _SeriesKey(NamedTuple):
    """One quantity of one robot, of fits of one kind."""

    name: str
    quantity: str
    residual: bool
    unit: str
    kind: tuple[str | None, ...]


@dataclass(frozen=True, slots=True)
class _Series:
    """A quantity over its nights: values and deviations (n,)."""

    of: _SeriesKey
    nights: tuple[str, ...]
    values: FloatArray
    stds: FloatArray


def _collect_series(rows: Iterable[FleetRow]) -> list[_Series]:
    found: dict[_SeriesKey, list[tuple[str, float, float]]] = defaultdict(list)
    for row in rows:
        kind: tuple[str | None, ...] = (row.job.robot, row.job.rows, row.job.estimator, row.job.friction)
        for entry in row.values:
            # A residual is a scale: its logarithm has the same scatter for quiet and loud joints.
            value = entry.value if not entry.residual else math.log(max(entry.value, 1e-300))
            if entry.residual or 0.0 < entry.std < math.inf:
                point = (row.job.night, value, 1.0 if entry.residual else entry.std)
                unit = "" if entry.residual else entry.unit
                found[_SeriesKey(row.job.name, entry.name, entry.residual, unit, kind)].append(point)
    series = []
    for key, points in found.items():
        nights, values, stds = zip(*sorted(points), strict=True)
        if nights[0] != nights[-1]:
            series.append(_Series(key, nights, np.array(values), np.array(stds)))
    return series


def compute_scatter(series: Sequence[_Series]) -> dict[tuple[object, ...], float]:
    """Return for every quantity by which factor its deviations are enlarged, from the median robot.

    A residual, whose deviations are one, gets its deviation; none where there are too few robots.
    """
    ratios: dict[tuple[object, ...], list[float]] = defaultdict(list)
    for entry in series:
        weights = entry.stds**-2
        mean = float(weights @ entry.values / weights.sum())
        square = float(weights @ (entry.values - mean) ** 2)
        ratio = square / float(chdtri(len(weights) - 1, 0.5))
        ratios[entry.of.kind, entry.of.quantity, entry.of.residual].append(ratio)
    factors = {}
    for key, found in ratios.items():
        known = math.sqrt(float(np.median(found))) if len(found) >= _FEWEST_ROBOTS else math.nan
        factors[key] = known if key[2] else max(1.0, known if known == known else 1.0)  # noqa: PLR0124  nan
    return factors


def adjust_probabilities(p: FloatArray, control: Control) -> FloatArray:
    """Return p (m,), adjusted for m comparisons: reject where it is at most the level.

    Sources: Benjamini and Hochberg (1995), section 3; Holm (1979).
    """
    count, order = len(p), np.argsort(p, kind="stable")
    ordered, ranks = p[order], np.arange(1, count + 1)
    if control == "holm":
        found = np.maximum.accumulate(ordered * (count - ranks + 1))
    else:
        found = np.minimum.accumulate((ordered * count / ranks)[::-1])[::-1]
    adjusted = np.empty(count)
    adjusted[order] = np.minimum(found, 1.0)
    return adjusted


def find_changes(
    rows: Iterable[FleetRow], *, level: float = 0.05, control: Control = "benjamini-hochberg"
) -> tuple[RobotChange, ...]:
    """Return the changes that are no chance, the surest first; see the top of this file."""
    series = _collect_series(rows)
    factors = compute_scatter(series)
    tested = list[RobotChange]()
    for entry in series:
        factor = factors[entry.of.kind, entry.of.quantity, entry.of.residual]
        if not factor > 0.0:
            continue
        # The largest change of a series, wherever it is, with its probability by chance.
        weights = (factor * entry.stds) ** -2
        before, above = np.cumsum(weights)[:-1], np.cumsum(weights * entry.values)[:-1]
        after, rest = weights.sum() - before, weights @ entry.values - above
        std = np.sqrt(1.0 / before + 1.0 / after)
        z = np.abs(rest / after - above / before) / std
        # Several fits of one night are not cut apart.
        cuts = np.array([one != other for one, other in zip(entry.nights, entry.nights[1:], strict=False)])
        place = int(np.argmax(np.where(cuts, z, -1.0)))
        single = 2.0 * float(ndtr(-z[place]))
        of = entry.of._asdict()
        del of["kind"]
        change = RobotChange(
            **of,
            since=entry.nights[place + 1],
            before=float(above[place] / before[place]),
            after=float(rest[place] / after[place]),
            std=float(std[place]),
            p=-math.expm1(int(cuts.sum()) * math.log1p(-min(single, 1.0 - 1e-16))),
            adjusted=1.0,
            values=tuple(entry.values.tolist()),
            nights=entry.nights,
        )
        tested.append(change)
    if not tested:
        return ()
    pairs = zip(tested, adjust_probabilities(np.array([one.p for one in tested]), control), strict=True)
    found = [replace(one, adjusted=float(q)) for one, q in pairs if q <= level]
    return tuple(sorted(found, key=lambda one: (one.p, -abs(one.sigma), one.name, one.quantity)))


@final
class Fleet(PagedResult):
    """The rows of a fleet, in the order of its jobs.

    Attributes:
        folder: where its results are kept.
        rows: one for each job.
        level: of the test for changes: the share of false alarms among the alarms.
        control: how many comparisons are accounted for: "benjamini-hochberg" or "holm".

    Example:
        >>> import symid
        >>> jobs = [symid.fleet.FleetJob(robot="two_link", simulate={"duration": 2.0}, seed=1)]
        >>> symid.fleet.run(jobs, "nights", executor="serial")
        <Fleet 1 job: 1 done>
    """

    folder: Path
    rows: tuple[FleetRow, ...]
    level: float = 0.05
    control: Control = "benjamini-hochberg"

    @cached_property
    def counts(self) -> Mapping[str, int]:
        """Return how many jobs ended in which way."""
        return dict(sorted(Counter(row.status for row in self.rows).items()))

    @cached_property
    def _changes(self) -> tuple[RobotChange, ...]:
        return find_changes(self.rows, level=self.level, control=self.control)

    def changes(self) -> tuple[RobotChange, ...]:
        """Return which robots changed, in which parameter or residual, since when; the surest first."""
        return self._changes

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return a warning that counts the refused jobs."""
        return self._count("fleet.refused", ("refused",), "refused, without new values")

    @property
    def errors(self) -> tuple[Notice, ...]:
        """Return an error that counts the jobs that crashed, failed, or came to a limit."""
        lost = ("failed", "crashed", "time-out", "memory")
        return self._count("fleet.lost", lost, "without a fit (crash, limit or bug); --again runs them again")

    def _count(self, code: str, kinds: Sequence[str], words: str) -> tuple[Notice, ...]:
        count = sum(self.counts.get(kind, 0) for kind in kinds)
        text = f"{count} of {len(self.rows)} jobs {words}; see the table of reasons"
        return (Notice(code=code, text=text, file=str(self.folder)),) if count else ()

    def summarise(self) -> str:
        """Return how the jobs ended."""
        ended = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"{len(self.rows)} job{'s'[: len(self.rows) != 1]}: {ended or 'nothing to do'}"

    def blocks(self) -> tuple[Block, ...]:
        """Return how the jobs ended, why some have no fit, and what changed."""
        return (self.summarise(), *self._show_reasons(), *self._show_changes(), *self._show_scatter())

    def _show_reasons(self) -> tuple[Table, ...]:
        reasons: dict[tuple[str, str], list[FleetRow]] = defaultdict(list)
        for row in self.rows:
            if row.status != "done":
                reasons[row.status, row.reason.split("\n")[0]].append(row)
        found = sorted(reasons.items(), key=lambda entry: (-len(entry[1]), entry[0]))[:_MOST_SHOWN]
        shown = [
            (status, len(rows), f"{rows[0].job.name} {rows[0].job.night}".strip(), reason)
            for (status, reason), rows in found
        ]
        title = "Jobs without a fit, by reason"
        return (Table(("ended", "jobs", "such as", "reason"), shown, (0, 2, 3), title),) if shown else ()

    def _show_changes(self) -> tuple[Block, ...]:
        found = self.changes()
        if not found:
            nights = {row.job.night for row in self.rows if row.status == "done"}
            return ("No robot changed.",) if len(nights) > 1 else ()
        holm, many = self.control == "holm", len(found) > _MOST_SHOWN
        kind = "Any false alarm is as rare as" if holm else "Of these, false alarms are at most"
        rows = []
        for entry in found[:_MOST_SHOWN]:
            sizes = (entry.before, entry.after, entry.sigma, entry.adjusted)
            numbers = map(format, sizes, (".5g", ".5g", "+.1f", ".1g"))
            rows.append((entry.name, _name_quantity(entry), entry.since, *numbers, entry.unit))
        header = ("robot", "what", "since", "before", "after", "sigma", "adjusted p", "unit")
        title = f"Robots that changed: {len({entry.name for entry in found})}"
        note = f"{kind} {100.0 * self.level:g} % ({self.control}). A residual is the logarithm of its RMS "
        note += "value." + f" The {_MOST_SHOWN} most significant of {len(found)} are shown." * many
        return (Table(header, rows, (0, 1, 2), title, note),)

    def _show_scatter(self) -> tuple[str, ...]:
        factors = compute_scatter(_collect_series(self.rows))
        found = [(key[1], value) for key, value in factors.items() if not key[2] and value > _ENLARGED]
        if not found:
            return ()
        names = ", ".join(f"{name} ({value:.2g} times)" for name, value in found[:_MOST_SHOWN])
        return (f"Nights differ by more than the stated deviations, which were enlarged, in: {names}.",)

    def _describe(self) -> dict[str, object]:
        return {"folder": self.folder, "counts": self.counts, "changes": self.changes()}

    def save(self, path: str | PathLike[str]) -> Path:
        """Write a row for each value of each job to `path`, .parquet or .csv, and return the path.

        Raises:
            UsageError: another suffix, or pyarrow is not installed.
            OutputError: the file cannot be written.
        """
        file = Path(fspath(path))
        if file.suffix.lower() == ".csv":
            stream = io.StringIO(newline="")
            writer = csv.DictWriter(stream, _COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._list_values())
            return write_file(file, stream.getvalue())
        if file.suffix.lower() != ".parquet":
            text = f"{file}: the rows of a fleet are written as .parquet or .csv"
            raise UsageError(Notice(code="usage.suffix", text=text))
        try:
            import pyarrow as pa
            from pyarrow.parquet import write_table
        except ImportError as error:
            text = f"{file}: Parquet needs pyarrow: pip install 'symid[parquet]'; or name a .csv"
            raise UsageError(Notice(code="usage.no-pyarrow", text=text)) from error
        kinds = {"seed": pa.int64(), "value": pa.float64(), "std": pa.float64()}
        schema = pa.schema([(name, kinds.get(name, pa.string())) for name in _COLUMNS])
        table = pa.Table.from_pylist(list(self._list_values()), schema)
        return write_file(file, lambda stream: write_table(table, stream))

    def _list_values(self) -> Iterator[dict[str, object]]:
        for row in self.rows:
            job = row.job
            head = {name: getattr(job, name) for name in ("name", "night", "robot", "rows", "estimator")}
            head |= {"friction": job.friction, "seed": job.seed, "logs": ";".join(job.logs), "key": row.key}
            head |= {"status": row.status, "reason": row.reason, "verdict": row.verdict}
            for entry in row.values:
                kind = "residual" if entry.residual else "parameter"
                named = {"kind": kind, "parameter": entry.name, "unit": entry.unit, "value": entry.value}
                yield head | named | {"std": entry.std if entry.std < math.inf else None}
            if not row.values:
                yield head

    def _build_page(self) -> Page:
        found, lost = self.changes(), len(self.rows) - self.counts.get("done", 0)
        robots = len({row.job.name for row in self.rows})
        changed = len({entry.name for entry in found})
        level = "wrong" if lost == len(self.rows) else "doubtful" if lost or found else "good"
        headline = f"{changed} of {robots} robots changed; {lost} of {len(self.rows)} jobs have no fit."
        counts = {"jobs": len(self.rows), "without a fit": lost, "robots changed": changed}
        return Page(
            robot=self.folder.name,
            subject=f"fleet of {robots} robots",
            verdict=FitVerdict(level=level, headline=headline, details=(_LEVELS,)),
            numbers=[(str(count), name) for name, count in counts.items()],
            blocks=("== What changed ==", *self._show_changes(), *self.figures()),
            more=("== Jobs ==", self.summarise(), *self._show_reasons(), *self._show_scatter()),
            settings=(("level", f"{self.level:g}"), ("control", self.control)),
        )

    def figures(self) -> tuple[Drawing, ...]:
        """Return the surest changes over the nights."""
        found = []
        for entry in self.changes()[:_MOST_DRAWN]:
            nights = np.arange(1.0, len(entry.nights) + 1.0)
            cut, what = entry.nights.index(entry.since), _name_quantity(entry)
            sides = ((nights[:cut], entry.before), (nights[cut:], entry.after))
            drawing = build_line_figure(
                f"{entry.name}: {what} changed by {entry.sigma:+.1f} sigma since {entry.since}.",
                ("night", f"{what} ({'logarithm' if entry.residual else entry.unit})"),
                [
                    Line("nights", "measured", nights, np.array(entry.values), markers=True, joined=False),
                    *(Line("mean before and after", "predicted", x, np.full(len(x), y)) for x, y in sides),
                ],
                whole=True,
            )
            found.append(drawing)
        return tuple(found)


def _name_quantity(entry: RobotChange) -> str:
    return f"residual of {entry.quantity}" if entry.residual else entry.quantity


def run(
    study: str | PathLike[str] | Sequence[FleetJob],
    folder: str | PathLike[str],
    *,
    executor: Literal["serial", "processes", "dask"] = "processes",
    workers: int | None = None,
    cluster: str = "local",
    seconds: float | None = None,
    megabytes: int | None = None,
    again: bool = False,
    level: float = 0.05,
    control: Control = "benjamini-hochberg",
    progress: Progress = lambda text: None,  # noqa: ARG005
) -> Fleet:
    """Run all jobs of a study whose results are not in `folder` yet, and return all results.

    Args:
        study: a study file, or jobs.
        folder: for results, costs and the list of jobs; made if it does not exist.
        executor: "serial" (in this process), "processes" or "dask".
        workers: number of processes, or of workers of a local cluster; one for each core by default.
        cluster: address of Dask's scheduler; "local" starts one.
        seconds: that a job may take; for processes and Dask.
        megabytes: of memory that a job's process may use for data; for processes and Dask.
        again: run jobs again that crashed, failed, or came to a limit.
        level: of the test for changes.
        control: of many comparisons, "benjamini-hochberg" or "holm".
        progress: called with how many jobs are done, and with the time that is left.

    Raises:
        InputError: the study is wrong.
        UsageError: options that do not go together, or a package that is not installed.
        OutputError: the folder cannot be written, or another fleet runs in it.
        SolverError: the scheduler is lost; what is done is kept.

    Example:
        >>> import symid
        >>> jobs = [symid.fleet.FleetJob(robot="two_link", logs=("monday.csv",))]
        >>> symid.fleet.run(jobs, "nights", executor="serial").rows[0].status
        'refused'
    """
    jobs = read_study(Path(fspath(study))) if isinstance(study, str | PathLike) else tuple(study)
    limits = FleetLimits(seconds=seconds, megabytes=megabytes)
    if executor == "serial" and limits != FleetLimits():
        text = "limits of time and memory need worker processes: executor 'processes' or 'dask'"
        raise UsageError(Notice(code="usage.serial-limits", text=text))
    count = workers or (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    place = Path(fspath(folder))
    with _own_folder(place):
        keys, found = list[str](), 0

        def list_missing() -> Iterator[Task]:
            """Yield the jobs that have no row yet, each once; note the keys of all."""
            nonlocal found
            there = {path.stem for path in (place / "results").glob("*.json")}
            digest, met = lru_cache(maxsize=None)(digest_robot), set[str]()
            for job in jobs:
                key = compute_key(job, digest)
                keys.append(key)
                file = place / "results" / f"{key}.json"
                row = _read_row(file) if key in there and key not in met else None
                wanted = row is None or (again and row.status not in {"done", "refused"})
                if wanted and key not in met:
                    yield key, job
                else:
                    found += 1
                met.add(key)

        tasks = list_missing()
        ended: Iterator[Ended]
        if executor == "serial":
            ended = map(run_job, tasks)
        elif executor == "dask":
            ended = run_dask(tasks, cluster, count, limits, progress)
        else:
            ended = run_processes(tasks, count, limits)
        # Rows and costs are written as they come; how far it is, and how long it takes, is reported.
        count = len(jobs)
        start, told, lost = time.monotonic(), -math.inf, 0
        with contextlib.ExitStack() as stack:
            # Workers are ended with the generator, whatever happens here.
            stack.callback(getattr(ended, "close", lambda: None))
            stream = stack.enter_context((place / "costs.csv").open("a", encoding="utf-8"))
            for done, (row, cost) in enumerate(ended, start=1):
                file = place / "results" / f"{row.key}.json"
                write_file(file, write_json(row) + "\n", what="a result", clear=False)
                spent = f"{cost.seconds:.3f},{cost.processor:.3f},{cost.memory:.0f}"
                stream.write(f"{row.key},{row.status},{spent}\n")
                stream.flush()
                lost += row.status != "done"
                now, left = time.monotonic(), count - found - done
                if now - told >= _SECONDS_BETWEEN or not left:
                    told = now
                    rest = f", about {describe_duration((now - start) / done * left)} left" if left else ""
                    without = f", {lost} without a fit" if lost else ""
                    progress(f"{found + done} of {count} jobs{without}{rest}")
        listed = {"format": _FORMAT, "version": 1, "jobs": keys}
        write_file(place / "fleet.json", write_json(listed) + "\n")
    return load(place, level=level, control=control)


def load(
    folder: str | PathLike[str], *, level: float = 0.05, control: Control = "benjamini-hochberg"
) -> Fleet:
    """Return the results of a fleet that has run.

    Args:
        folder: that `run` wrote.
        level: of the test for changes.
        control: of many comparisons, "benjamini-hochberg" or "holm".

    Raises:
        InputError: the fleet has not come to its end, or a file is damaged.

    Example:
        >>> import symid
        >>> _ = symid.fleet.run([], "nights")
        >>> symid.fleet.load("nights")
        <Fleet 0 jobs: nothing to do>
    """
    place = Path(fspath(folder))
    try:
        listed = json.loads(read_file(place / "fleet.json", 10**9))
        keys = [str(key) for key in listed["jobs"] if listed["format"] == _FORMAT]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        text = "no list of jobs of a fleet that came to its end; run it again, what is done is kept"
        raise InputError(Notice(code="fleet.not-ended", text=text, file=str(place / "fleet.json"))) from error
    rows = []
    for file in (place / "results" / f"{key}.json" for key in keys):
        row = _read_row(file)
        if row is None:
            text = "damaged or missing; run the fleet again, which makes it anew"
            raise InputError(Notice(code="fleet.damaged", text=text, file=str(file)))
        rows.append(row)
    return Fleet(folder=place, rows=tuple(rows), level=level, control=control)


@contextlib.contextmanager
def _own_folder(folder: Path) -> Iterator[None]:
    """Keep the folder from other fleets, and clear what was half written when one was killed."""
    try:
        (folder / "results").mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except (OSError, ValueError) as error:
        text = f"cannot be made: {getattr(error, 'strerror', None) or error}; name a folder of yours"
        raise OutputError(Notice(code="output.folder", text=text, file=str(folder))) from error
    try:
        # The system's lock on the folder itself: a process that dies leaves nothing.
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            # Some file systems have no such locks.
            if error.errno in {errno.EWOULDBLOCK, errno.EACCES}:
                text = "another fleet runs in this folder; wait for it, or name another folder"
                raise OutputError(Notice(code="output.fleet-runs", text=text, file=str(folder))) from error
        for scrap in (*folder.glob(".*.json.*"), *(folder / "results").glob(".*.json.*")):
            scrap.unlink(missing_ok=True)
        yield
    finally:
        os.close(handle)


def _read_row(file: Path) -> FleetRow | None:
    """Return the row in a file that has its key as name; None if it is not there, or damaged."""
    try:
        row = read_record(FleetRow, json.loads(read_file(file, 10**8)))
    except (OSError, ValueError, InputError, RecursionError):
        return None
    return row if row.key == file.stem else None
