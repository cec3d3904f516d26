"""Many independent tasks in worker processes, with results in the order of the tasks.

Input: a function that can be pickled, its tasks. Output: its results.

Each task carries its own seed, and every worker has one thread for its linear algebra, even where it is the
only one: results are the same to the last bit for any number of processes and of cores.

Supported: any number of processes on this machine; an error of a task, or an interruption, ends all.
Not supported: tasks that depend on each other; a script that calls this while it is imported.
"""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from symid.errors import Notice, SolverError, UsageError
from symid.threads import THREAD_VARIABLES, ask_for_one_thread

__all__ = ["find_jobs", "run_tasks"]

A = TypeVar("A")
B = TypeVar("B")


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
        SolverError: something outside ended a worker.
    """
    count = min(find_jobs(jobs), len(tasks))
    results: list[B] = []
    if not tasks:
        return ()
    # A process that is forked from one with threads may hang; a fresh one costs half a second.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(max_workers=count, mp_context=context, initializer=_end_quietly) as pool:
        try:
            # A worker may load NumPy before it comes to any line of ours, with the caller's own script: the
            # threads must be in the environment that it is born with. All start here.
            with _one_thread():
                waiting = [pool.submit(function, task) for task in tasks]
            for future in waiting:
                results.append(future.result())
                if progress is not None:
                    progress(len(results), len(tasks))
        except BaseException as error:
            # The pool would wait for what runs.
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise SolverError(_say_lost(len(results), len(tasks))) from error
            raise
    return tuple(results)


def _say_lost(done: int, whole: int) -> Notice:
    text = (
        f"a worker process was ended from outside after {done} of {whole} tasks, as a system does that runs "
        "out of memory: try again with fewer jobs"
    )
    return Notice(code="solver.worker-lost", text=text)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Ask for one thread in processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    ask_for_one_thread()
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _end_quietly() -> None:
    """Let Ctrl-C, which the terminal sends to all processes, end a worker without a traceback of its own."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
