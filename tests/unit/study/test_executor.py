"""Tasks give the same results in one process and in two, in their order."""

import math

import pytest

from symid.errors import UsageError
from symid.study.executor import find_jobs, run_tasks


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_tasks(jobs):
    said = []
    tasks = tuple(range(7))
    found = run_tasks(
        math.factorial, tasks, jobs=jobs, progress=lambda done, whole: said.append((done, whole))
    )
    assert found == tuple(math.factorial(task) for task in tasks)
    assert said == [(done, 7) for done in range(1, 8)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_a_task_is_not_lost(jobs):
    with pytest.raises(ValueError, match="factorial"):
        run_tasks(math.factorial, (1, -1), jobs=jobs)


def test_no_tasks_give_no_results():
    assert run_tasks(math.factorial, ()) == ()


def test_the_number_of_processes_is_checked():
    assert find_jobs(None) >= 1
    with pytest.raises(UsageError) as caught:
        find_jobs(0)
    assert caught.value.notices[0].code == "usage.jobs"
