"""Logs of the API: files, runs, arrays."""

import numpy as np
import pytest

import symid
from tests.refusals import raises


@pytest.fixture(scope="module")
def log(robot):
    return robot.simulate(seed=3, duration=2.0).log


def test_a_log_says_what_it_holds(log):
    assert log.q.shape == log.tau.shape == (len(log), 2)
    assert log.period == pytest.approx(1e-3)
    assert repr(log).startswith("<Log ")
    assert "shoulder" in str(log)
    assert log.to_dict()["samples"] == len(log)
    assert "<table>" in log._repr_html_()


def test_all_that_is_wrong_with_arrays_is_said_at_once(robot):
    time = np.array([0.0, 0.1, 0.1])
    with raises(symid.LogError, *["log.arrays"] * 3) as caught:
        symid.build_log(robot, time=time, q=np.zeros((3, 3)), tau=np.full((3, 2), np.inf))
    assert "(3, 3), expected (3, 2)" in str(caught.value)


def test_a_file_of_runs_is_several_logs(robot, tmp_path):
    for seed in (1, 2):
        robot.simulate(seed=seed, duration=2.0).save(tmp_path / f"{seed}.npz")
    runs = tmp_path / "runs.toml"
    runs.write_text('[[run]]\nfile = "1.npz"\n[[run]]\nfile = "2.npz"\nweight = 2\n')
    first, second = symid.read_logs(runs, robot)
    assert second.recording.run.weight == 2.0
    assert not np.array_equal(first.q, second.q)
    with raises(symid.LogError, "log.runs"):
        symid.read_log(runs, robot)


def test_an_experiment_stands_for_its_log(robot):
    run = robot.simulate(seed=3, duration=4.0)
    assert robot.identify(run).values == robot.identify([run.log]).values
    assert robot.identify(run).validate(run).residual == robot.identify(run).validate(run.log).residual
