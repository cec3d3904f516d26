"""Monte Carlo runs: independent tasks in worker processes, and statistics over their results.

Tasks -> results in the order of the tasks; one number a run -> `Spread`, `PairedDifference`.

Each task carries its own seed, and every worker has one thread for its linear algebra, even where it is the
only one: results are the same to the last bit for any number of processes and of cores.

Supported: functions that can be pickled; an error of a task, or an interruption, ends all. Runs without a
result (nan) count as worse than all others.
Not supported: tasks that depend on each other; a script that calls this while it is imported.
"""

import math
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.special import stdtrit

from symid.arrays import FloatArray
from symid.environment import THREAD_VARIABLES, limit_to_one_thread
from symid.errors import Notice, SolverError, UsageError

A = TypeVar("A")
B = TypeVar("B")


def run_tasks(
    function: Callable[[A], B],
    tasks: Sequence[A],
    *,
    jobs: int | None = None,
    batch: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[B, ...]:
    """Return function(task) of every task, in the order of `tasks`.

    Args:
        function: of a module, so that other processes find it.
        tasks: arguments, each can be pickled.
        jobs: processes; None for one for each core that this process may use.
        batch: how many tasks a process gets at once.
        progress: called with how many tasks are done, of how many.

    Raises:
        UsageError: jobs is not positive.
        SolverError: something outside ended a worker.
    """
    if jobs is None:
        jobs = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if jobs < 1:
        raise UsageError(Notice(code="usage.jobs", text=f"jobs must be 1 or more, got {jobs}"))
    results: list[B] = []
    if not tasks:
        return ()
    # A process that is forked from one with threads may hang; a fresh one costs half a second.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    # Ctrl-C, which the terminal sends to all processes, ends a worker without a traceback of its own.
    quiet = (signal.SIGINT, signal.SIG_DFL)
    with ProcessPoolExecutor(min(jobs, math.ceil(len(tasks) / batch)), context, signal.signal, quiet) as pool:
        try:
            # A worker may load NumPy before it comes to any line of ours, with the caller's own script: the
            # threads must be in the environment that it is born with. All start here.
            before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
            try:
                limit_to_one_thread()
                found = pool.map(function, tasks, chunksize=batch)
            finally:
                for name, value in before.items():
                    os.environ.pop(name, None)
                    os.environ |= {} if value is None else {name: value}
            for result in found:
                results.append(result)
                if progress is not None and (len(results) % batch == 0 or len(results) == len(tasks)):
                    progress(len(results), len(tasks))
        except BaseException as error:
            # The pool would wait for what runs.
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                text = f"a worker process was killed after {len(results)} of {len(tasks)} tasks; memory may "
                text += "have run out: try again with fewer jobs"
                raise SolverError(Notice(code="solver.worker-lost", text=text)) from error
            raise
    return tuple(results)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Median and 90th percentile of `runs` runs, `failed` of them without a result."""

    median: float
    percentile90: float
    runs: int
    failed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference:
    """The mean of differences between two figures of the same runs, with its 95 % interval (Student)."""

    mean: float
    low: float
    high: float
    runs: int

    @property
    def verdict(self) -> str:
        """Return what the interval says: below, above or not different from zero."""
        if self.high < 0.0:
            return "lower"
        return "higher" if self.low > 0.0 else "no difference"


def count_words(words: Iterable[str]) -> tuple[tuple[str, int], ...]:
    """Return how often each word stands there, empty ones left out, in the order of the alphabet."""
    return tuple(sorted(Counter(filter(None, words)).items()))


def compute_spread(values: Sequence[float] | FloatArray) -> Spread:
    """Return median and 90th percentile of `values` (runs,); nan counts as infinite.

    They are interpolated linearly, infinite where one of their neighbours is.
    """
    array = np.asarray(values, dtype=np.float64)
    lost = np.isnan(array)
    ordered = np.sort(np.where(lost, math.inf, array))
    found = []
    for share in (0.5, 0.9):
        part, place = math.modf(share * (len(ordered) - 1))
        low, high = ordered[int(place)], ordered[int(place) + (part > 0.0)]
        found.append(float(low if not part or low == high else (1.0 - part) * low + part * high))
    return Spread(median=found[0], percentile90=found[1], runs=len(array), failed=int(lost.sum()))


def compute_paired_difference(first: FloatArray, second: FloatArray) -> PairedDifference:
    """Return the mean of first - second (runs,) each, with Student's 95 % interval."""
    difference = np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64)
    runs = len(difference)
    mean = float(difference.mean())
    if runs < 2:
        return PairedDifference(mean=mean, low=-math.inf, high=math.inf, runs=runs)
    half = float(stdtrit(runs - 1, 0.975) * difference.std(ddof=1) / math.sqrt(runs))
    return PairedDifference(mean=mean, low=mean - half, high=mean + half, runs=runs)
