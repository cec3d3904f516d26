"""Jobs to results: in this process, in worker processes, or on a Dask cluster.

`FleetJob` -> `FleetRow`. Whatever a job does, it ends as a row with its reason: a refusal of symid, a crash,
a limit of time or memory. One job at a time is in a worker process, which is replaced when it fails; Dask's
workers have such a process for each of their threads.

Rows have no times: the same inputs give the same bytes. What a job took is its `Cost`.

Supported: Linux and other POSIX systems; addresses (s3://...) where fsspec is installed.
Not supported: limits of time and memory for jobs in this process itself.
"""

import contextlib
import ctypes
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from symid import Fit, RobotModel, load
from symid.environment import KEEP_MEMORY, THREAD_VARIABLES, make_scratch_folder
from symid.errors import InputError, Notice, SolverError, SymidError, UsageError
from symid.fleet.jobs import FleetJob, is_remote, open_address
from symid.options import SimulateOptions, list_flags
from symid.serialization import Finite

Status = Literal["done", "refused", "failed", "crashed", "time-out", "memory"]
"""How a job ended: with a fit, an error of symid, a bug, a killed worker, or at a limit."""
Task = tuple[str, FleetJob]
"""A job behind its key."""
_PATIENCE = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetValue:
    """One number of a fit with its standard deviation: a parameter, or the residual of a joint.

    Attributes:
        name: of the parameter, or of the joint.
        value: SI units; of a residual its standard deviation.
        std: its standard deviation; infinite for residuals, which state none.
        unit: of both.
        residual: whether it is the residual of a joint.

    Example:
        >>> import symid
        >>> symid.fleet.FleetValue(name="ZZ1", value=1.2, std=0.1, unit="kg m^2").residual
        False
    """

    name: str
    value: Finite
    std: float
    unit: str
    residual: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetRow:
    """What became of a job.

    Attributes:
        key: the hash of the job's inputs.
        job: the job.
        status: "done", "refused", "failed", "crashed", "time-out" or "memory".
        reason: why there is no fit; empty if there is one.
        verdict: level of the fit's verdict.
        warnings: codes of the fit's warnings.
        values: parameters and residuals.

    Example:
        >>> import symid
        >>> job = symid.fleet.FleetJob(robot="two_link")
        >>> symid.fleet.FleetRow(key="0", job=job, status="time-out", reason="longer than 60 s").values
        ()
    """

    key: str
    job: FleetJob
    status: Status
    reason: str = ""
    verdict: str = ""
    warnings: tuple[str, ...] = ()
    values: tuple[FleetValue, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What a job took: wall and processor time in s, the largest memory of its process in MB."""

    seconds: float = 0.0
    processor: float = 0.0
    memory: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetLimits:
    """Of one job: `seconds`, and `megabytes` of data in its worker process; None for no limit."""

    seconds: float | None = None
    megabytes: int | None = None


Ended = tuple[FleetRow, Cost]


def run_job(task: Task) -> Ended:
    """Return the row of a job, run in this process; whatever goes wrong is the row's reason."""
    key, job = task
    start, used = time.monotonic(), time.process_time()
    try:
        with make_scratch_folder() as folder:
            fit = _identify(job, folder)
            values = [FleetValue(name=v.name, value=v.value, std=v.std, unit=v.unit) for v in fit.parameters]
            other: Any = {"std": float("inf"), "residual": True}
            values += [FleetValue(name=e.joint, value=e.std, unit=e.unit, **other) for e in fit.residual]
            codes = tuple(sorted({notice.code for notice in fit.notices if not notice.is_note}))
            told: Any = {"verdict": fit.verdict.level, "warnings": codes, "values": tuple(values)}
            row = FleetRow(key=key, job=job, status="done", **told)
    except SymidError as error:
        row = FleetRow(key=key, job=job, status="refused", reason=str(error))
    except MemoryError:
        row = FleetRow(key=key, job=job, status="memory", reason="the memory that a job may use ran out")
    except Exception as error:  # noqa: BLE001  one job must not end the others
        reason = f"a bug in symid, not in your files: {type(error).__name__}: {error}"
        row = FleetRow(key=key, job=job, status="failed", reason=reason)
    # Linux counts in kB, macOS in bytes.
    unit = 1e-6 if sys.platform == "darwin" else 1e-3
    peak = unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    spent = Cost(seconds=time.monotonic() - start, processor=time.process_time() - used, memory=peak)
    return row, spent


def _identify(job: FleetJob, folder: Path) -> Fit:
    robot, stamp = _fetch(job.robot, folder), None
    with contextlib.suppress(OSError):
        found = Path(robot).stat()
        stamp = found.st_mtime_ns, found.st_size
    model = _load_model(robot, stamp)
    logs: Any = [_fetch(log, folder) for log in job.logs]
    if not logs:
        # `read_study` checks the names.
        fields, given = list_flags(SimulateOptions), dict(job.simulate)
        trajectory: Any = given.pop("trajectory", "fourier")
        values: dict[str, Any] = {fields[name]: value for name, value in given.items()}
        options = SimulateOptions(**values, seed=job.seed or 0)
        logs = model.simulate(trajectory, options=options).log
    common: Any = {"estimator": job.estimator, "settings": job.settings or None}
    if job.rows == "friction":
        return model.identify_friction(logs, model=job.friction, **common)
    return model.identify(logs, rows=job.rows, friction=job.friction, **common)


@lru_cache(maxsize=16)
def _load_model(robot: str, stamp: object) -> RobotModel:  # noqa: ARG001  a file that changed is another key
    return load(robot)


def _fetch(name: str, folder: Path) -> str:
    """Return a local path of a file: that of a copy in `folder`, if the name is an address."""
    if not is_remote(name):
        return name
    system, path = open_address(name)
    # Two nights may have the same file name.
    copy = folder / str(len(list(folder.iterdir()))) / PurePosixPath(path).name
    copy.parent.mkdir()
    try:
        system.get(path, str(copy), recursive=system.isdir(path))
    except Exception as error:
        raise InputError(Notice(code="fleet.address", text=f"cannot be read: {error}", file=name)) from error
    return str(copy)


def serve() -> None:
    """Run jobs of this process's own: they come through the channel that its argument names, rows go back.

    The process ends when the channel is closed, or when the one that started it has died.
    """
    channel: Connection[Any, Any] = Connection(int(sys.argv[1]))
    limit = channel.recv()
    if limit:
        resource.setrlimit(resource.RLIMIT_DATA, (limit * 10**6, resource.RLIM_INFINITY))
    # As Ctrl-C: a job that is asked to end ends its compilers, and removes its scratch.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    threading.Thread(target=_follow, args=(os.getppid(),), daemon=True).start()
    channel.send("ready")
    with contextlib.suppress(EOFError):
        while True:
            channel.send(run_job(channel.recv()))
            if limit:
                # What this job leaves free must not count against the next one's limit; glibc keeps it.
                with contextlib.suppress(AttributeError):
                    ctypes.CDLL(None).malloc_trim(0)


def _follow(parent: int) -> None:
    """End this process when its parent has died: a job that hangs would outlive it."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os.kill(os.getpid(), signal.SIGKILL)


_SERVE = f"from {__name__} import serve; {serve.__name__}()"


class JobProcess:
    """A worker process that runs one job at a time, and is replaced when it dies or has to be ended."""

    def __init__(self, limits: FleetLimits) -> None:
        self.limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: Connection[Any, Any]

    def run(self, task: Task) -> Ended:
        """Return the row of a job.

        Raises:
            SolverError: no process can be started.
        """
        row = FleetRow(key=task[0], job=task[1], status="crashed")
        start = time.monotonic()
        try:
            if self._process is None:
                self._start()
            start = time.monotonic()
            ended: Ended | None = self._ask(task, self.limits.seconds)
        except TimeoutError:
            self.interrupt()
            self.end()
            reason = f"not ended after {self.limits.seconds:g} s"
            return replace(row, status="time-out", reason=reason), Cost(seconds=time.monotonic() - start)
        if ended is None:
            reason = f"the worker process {self.end()}"
            return replace(row, reason=reason), Cost(seconds=time.monotonic() - start)
        if ended[0].status == "memory":
            # What is left of the memory may not do for the next job.
            self.end()
        return ended

    def _start(self) -> None:
        self._channel, other = Pipe()
        # A session of its own: Ctrl-C in the terminal is answered by the process that keeps the rows.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SERVE, str(other.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | dict.fromkeys(THREAD_VARIABLES, "1") | KEEP_MEMORY,
            pass_fds=(other.fileno(),),
            start_new_session=True,
        )
        other.close()
        if self._ask(self.limits.megabytes, None) != "ready":
            text = f"a worker process could not be started: it {self.end()}"
            raise SolverError(Notice(code="fleet.no-worker", text=text))

    def _ask(self, message: object, seconds: float | None) -> Any:  # noqa: ANN401  what the process returns
        """Return the answer of the process; None if it has died.

        Raises:
            TimeoutError: the answer takes longer than it may.
        """
        with contextlib.suppress(EOFError, ConnectionError):
            self._channel.send(message)
            if not self._channel.poll(seconds):
                raise TimeoutError
            return self._channel.recv()
        return None

    def interrupt(self) -> None:
        """Ask the process to end, and to end what it has started; the job that runs is a crash."""
        with contextlib.suppress(OSError):
            if self._process is not None:
                self._process.terminate()

    def end(self) -> str:
        """End the process with all that it has started, and return how it ended, in words."""
        process = self._process
        if process is None:
            return "has not been started"
        self._channel.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            # One that ends is given the time to say how.
            process.wait(_PATIENCE)
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        code, self._process = process.wait(), None
        if code == -signal.SIGKILL:
            return "was killed; memory may have run out"
        return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"


def run_processes(tasks: Iterable[Task], workers: int, limits: FleetLimits) -> Iterator[Ended]:
    """Yield the rows of jobs as they end in `workers` worker processes; a job is taken when one is free."""
    here, started = threading.local(), list[JobProcess]()

    def run(task: Task) -> Ended:
        if not hasattr(here, "process"):
            here.process = JobProcess(limits)
            started.append(here.process)
        found: Ended = here.process.run(task)
        return found

    executor = ThreadPoolExecutor(workers)
    try:
        for _, future in _run_window(executor, run, tasks, lambda: workers + 1):
            yield future.result()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in started:
            process.interrupt()
        executor.shutdown()
        for process in started:
            process.end()


def _run_window(
    executor: Executor, function: Callable[..., Ended], tasks: Iterable[Task], width: Callable[[], int]
) -> "Iterator[tuple[Task, Future[Ended]]]":
    """Yield futures as they end; no more than `width` jobs wait or run, however long the list is."""
    waiting: dict[Future[Ended], Task] = {}
    for task in tasks:
        waiting[executor.submit(function, task)] = task
        while len(waiting) >= width():
            yield from ((waiting.pop(future), future) for future in wait(waiting, None, FIRST_COMPLETED).done)
    while waiting:
        yield from ((waiting.pop(future), future) for future in wait(waiting, None, FIRST_COMPLETED).done)


def run_dask(
    tasks: Iterable[Task], address: str, workers: int, limits: FleetLimits, progress: Callable[[str], None]
) -> Iterator[Ended]:
    """Yield the rows of jobs as they end on a Dask cluster; "local" starts one with `workers` workers.

    A job whose worker is lost is given to another; one that loses three is a row.

    Raises:
        UsageError: Dask is not installed, or nothing answers at the address.
        SolverError: the scheduler is lost.
    """
    try:
        distributed: Any = import_module("distributed")
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        text = "Dask is not installed: pip install 'symid[cluster]'"
        raise UsageError(Notice(code="usage.no-dask", text=text)) from error
    with contextlib.ExitStack() as stack:
        try:
            chosen = address
            if address == "local":
                cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1)
                chosen = stack.enter_context(cluster)
            client = stack.enter_context(distributed.Client(chosen, set_as_default=False))
        except (OSError, ValueError) as error:
            text = f"no Dask scheduler answers at {address}: {error}"
            raise UsageError(Notice(code="usage.cluster", text=text)) from error
        progress(f"Dask's dashboard: {client.dashboard_link}")
        executor = client.get_executor(pure=False)
        run = _RunOnDask(limits)
        try:
            for task, future in _run_window(
                executor, run, tasks, lambda: 2 * sum(client.nthreads().values()) + 1
            ):
                try:
                    yield future.result()
                except KilledWorker as error:
                    reason = f"its Dask workers were lost: {error.last_worker.address}"
                    yield FleetRow(key=task[0], job=task[1], status="crashed", reason=reason), Cost()
        except (CancelledError, OSError) as error:
            text = "the Dask scheduler is lost; start it and the fleet again, what is done is kept"
            raise SolverError(Notice(code="solver.scheduler-lost", text=text)) from error
        finally:
            executor.shutdown(wait=False)


@dataclass(frozen=True, slots=True)
class _RunOnDask:
    """Runs a job in the worker process of a thread of a Dask worker."""

    limits: FleetLimits

    def __call__(self, task: Task) -> Ended:
        from distributed import get_worker

        here = vars(get_worker()).setdefault("symid_processes", threading.local())
        if getattr(here, "limits", None) != self.limits:
            if hasattr(here, "process"):
                here.process.end()
            here.limits, here.process = self.limits, JobProcess(self.limits)
        found: Ended = here.process.run(task)
        return found
