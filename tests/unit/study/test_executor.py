"""Tasks give the same results in one process and in two, in their order, with one thread each."""

import math
import multiprocessing
import os
import time

import pytest

from symid.environment import THREAD_VARIABLES
from symid.errors import SolverError, UsageError
from symid.study.monte_carlo import run_tasks
from tests.refusals import raises


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order_alone_and_in_batches(jobs):
    said = []
    tasks = tuple(range(7))
    found = run_tasks(
        math.factorial, tasks, jobs=jobs, progress=lambda done, whole: said.append((done, whole))
    )
    assert found == tuple(math.factorial(task) for task in tasks)
    assert said == [(done, 7) for done in range(1, 8)]
    found = run_tasks(math.factorial, range(7), jobs=jobs, batch=3, progress=lambda *pair: said.append(pair))
    assert found == tuple(map(math.factorial, range(7)))
    assert said == [(3, 7), (6, 7), (7, 7)]
    with pytest.raises(ValueError, match="factorial"):
        run_tasks(math.factorial, (1, -1), jobs=jobs)
    with raises(SolverError, "solver.worker-lost", match="0 of 3 tasks"):
        run_tasks(os._exit, (3, 3, 3), jobs=jobs)


def test_no_tasks_give_no_results_and_the_number_of_processes_is_checked():
    assert run_tasks(math.factorial, ()) == ()
    with raises(UsageError, "usage.jobs"):
        run_tasks(math.factorial, (), jobs=0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_worker_is_born_with_one_thread(monkeypatch, jobs):
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    before = dict(os.environ)
    assert run_tasks(os.getenv, THREAD_VARIABLES, jobs=jobs) == ("1",) * len(THREAD_VARIABLES)
    assert dict(os.environ) == before


def test_an_interruption_ends_the_workers():
    def interrupt(done, whole):
        raise KeyboardInterrupt

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run_tasks(time.sleep, (0.0, 300.0, 300.0), jobs=2, progress=interrupt)
    assert time.monotonic() - begin < 60.0
    assert not multiprocessing.active_children()
