"""A check of logs from Python: files and logs that were read, poor logs, even copies."""

import numpy as np
import pytest

import symid
from symid.errors import UsageError
from tests.recovery.closed_form import TWO_LINK_TRUTH, find_friction, find_two_link_torque
from tests.refusals import raises


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link")


@pytest.fixture(scope="module")
def log(robot):
    return robot.simulate(duration=8, seed=1).log


def test_a_robot_file_alone(robot):
    found = robot.check()
    assert found.accepted
    assert str(found) == f"{robot.path}: two_link, 2 joints, modified DH: no mistakes"
    assert repr(found) == "<RobotCheck two_link, 2 joints, modified DH: 0 logs>"


def test_a_log_that_was_read_is_checked_as_its_file(robot, log, tmp_path):
    path = tmp_path / "run.npz"
    np.savez(path, t=log.time, q=log.q, tau=log.tau, dq=log.dq)
    read = symid.read_log(path, robot)
    from_file, from_log = robot.check(path), robot.check(read)
    assert from_file.to_dict() == from_log.to_dict()
    assert str(from_file) == str(from_log)
    assert from_file.accepted
    assert from_file.excitation.rank == 12
    assert len(robot.check(path, read).logs) == 2


def test_a_log_at_rest_is_refused(robot):
    time = np.arange(2000) * 1e-3
    still = symid.build_log(robot, time=time, q=np.ones((2000, 2)), tau=np.ones((2000, 2)))
    found = robot.check(still)
    assert not found.accepted
    assert found.errors[0].code == "identify.standstill"
    assert found.excitation is None
    assert "excitation" not in found.to_dict()


@pytest.mark.parametrize("own", [0.0, 0.02])
def test_joints_that_move_in_proportion_are_named(robot, own):
    """Where the second joint has a small motion of its own, nothing is said."""
    time = 1e-3 * np.arange(6001)
    rates = 2.0 * np.pi * np.array([0.3, 0.7, 1.1])
    first = np.sin(np.outer(time, rates)).sum(axis=1)
    q = np.column_stack([first, 0.3 - 0.5 * first + own * np.sin(5.0 * time)])
    dq = np.gradient(q, 1e-3, axis=0)
    ddq = np.gradient(dq, 1e-3, axis=0)
    rigid, friction = find_two_link_torque(q, dq, ddq)[0], find_friction(dq)[0]
    tau = np.concatenate([rigid, friction], axis=2) @ TWO_LINK_TRUTH
    tau += 0.02 * np.random.default_rng(0).normal(size=tau.shape)
    log = symid.build_log(robot, time=time, q=q, tau=tau)
    codes = {notice.code: notice.text for notice in robot.check(log).notices}
    fit = robot.identify(log)
    fitted = {notice.code: notice.text for notice in fit.notices}
    if own:
        assert "log.in-proportion" not in {*codes, *fitted}
        return
    assert "'shoulder' and 'elbow'" in codes["log.in-proportion"]
    assert fitted["log.in-proportion"] == codes["log.in-proportion"]
    assert fit.verdict.level != "good"
    # No mistake is looked for among columns that cannot be told apart.
    assert "log.swapped-joints" not in codes


def test_an_even_copy_is_written(robot, log, tmp_path):
    rng = np.random.default_rng(4)
    kept = np.sort(rng.choice(len(log), size=len(log) - 50, replace=False))
    np.savez(tmp_path / "uneven.npz", t=log.time[kept], q=log.q[kept], tau=log.tau[kept])
    found = robot.check(tmp_path / "uneven.npz", resample=tmp_path / "even.npz")
    file, notice = found.product.copy
    assert notice.code == "log.resampled"
    assert notice in found.notices
    copy = symid.read_log(file, robot)
    assert np.ptp(np.diff(copy.time)) < 1e-9
    np.testing.assert_allclose(copy.q, log.q[: len(copy)], atol=1e-4)
    with raises(UsageError, "usage.one-log"):
        robot.check(resample=tmp_path / "even.npz")
