"""Tasks give the same results in one process and in two; medians, percentiles, paired differences."""

import math
import multiprocessing
import os
import time

import numpy as np
import pytest
from scipy.stats import ttest_rel

from symid.environment import THREAD_VARIABLES
from symid.errors import SolverError, UsageError
from symid.study.monte_carlo import compute_paired_difference, compute_spread, run_tasks
from tests.refusals import raises


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order_alone_and_in_batches(jobs):
    for batch, told in ((1, [1, 2, 3, 4, 5, 6, 7]), (3, [3, 6, 7])):
        said = []
        found = run_tasks(
            math.factorial, range(7), jobs=jobs, batch=batch, progress=lambda *pair, x=said: x.append(pair)
        )
        assert found == tuple(map(math.factorial, range(7)))
        assert said == [(done, 7) for done in told]
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


def test_the_spread_is_that_of_numpy_and_failed_runs_are_the_worst():
    values = np.random.default_rng(3).lognormal(size=37)
    found = compute_spread(values)
    assert found.median == pytest.approx(np.median(values), rel=1e-14)
    assert found.percentile90 == pytest.approx(np.percentile(values, 90), rel=1e-14)
    assert (found.runs, found.failed) == (37, 0)
    found = compute_spread(np.array([1.0, math.nan, 2.0, 3.0, 4.0]))
    assert (found.median, found.failed) == (3.0, 1)
    assert found.percentile90 == math.inf


def test_paired_differences_have_students_interval():
    rng = np.random.default_rng(5)
    first = rng.normal(size=20)
    second = first + 0.3 + 0.1 * rng.normal(size=20)
    found = compute_paired_difference(first, second)
    expected = ttest_rel(first, second).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-10)
    assert found.verdict == "lower"
    assert compute_paired_difference(second, first).verdict == "higher"
    assert compute_paired_difference(first, first + rng.normal(size=20)).verdict == "no difference"
    found = compute_paired_difference(np.array([1.0]), np.array([0.0]))
    assert (found.low, found.high, found.verdict) == (-math.inf, math.inf, "no difference")
