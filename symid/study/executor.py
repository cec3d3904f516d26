"""Many independent tasks, in this process or in several, with results in the order of the tasks.

Input: a function that can be pickled, its tasks. Output: its results.

Each task carries its own seed, so that the results are the same for any number of processes.

Supported: any number of processes on this machine; an error of a task ends all.
Not supported: tasks that depend on each other.
"""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from symid.errors import Notice, UsageError

__all__ = ["find_jobs", "run_tasks"]

A = TypeVar("A")
B = TypeVar("B")

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def find_jobs(jobs: int | None) -> int:
    """Return the number of processes: as asked for, or one a core that this process may use.

    Raises:
        UsageError: it is not positive.
    """
    if jobs is None:
        return max(
            1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        )
    if jobs < 1:
        text = f"jobs must be 1 or more, got {jobs}"
        raise UsageError(Notice(code="usage.jobs", text=text))
    return jobs


def run_tasks(
    function: Callable[[A], B],
    tasks: Sequence[A],
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[B, ...]:
    """Return function(task) of every task, in the order of `tasks`.

    Args:
        function: of a module, so that other processes find it.
        tasks: arguments, each can be pickled.
        jobs: processes; None for one a core.
        progress: told how many tasks are done, of how many.

    Raises:
        UsageError: jobs is not positive.
    """
    count = min(find_jobs(jobs), max(1, len(tasks)))
    results: list[B] = []
    if count == 1:
        for task in tasks:
            results.append(function(task))
            _tell(progress, len(results), len(tasks))
        return tuple(results)
    # A process that is forked from one with threads may hang; a fresh one costs half a second.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=count, mp_context=context, initializer=_use_one_thread) as pool:
        for result in pool.map(function, tasks):
            results.append(result)
            _tell(progress, len(results), len(tasks))
    return tuple(results)


def _tell(progress: Callable[[int, int], None] | None, done: int, whole: int) -> None:
    if progress is not None:
        progress(done, whole)


def _use_one_thread() -> None:
    """Keep the linear algebra of a worker to one thread: the workers share the cores already."""
    os.environ |= dict.fromkeys(_THREADS, "1")
