"""A check of logs from Python: files and logs that were read, poor logs, even copies."""

import numpy as np
import pytest

import symid
from tests.recovery.closed_form import TWO_LINK_TRUTH, find_friction, find_two_link_torque


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
