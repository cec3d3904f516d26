"""Held-out motions of six elastic joints, and what the tracking study chooses from."""

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.robot.toml_reader import read_robot
from symid.study.elastic_methods import SensorCondition, get_true_parameters, simulate_runs, study_many_joints
from tests.refusals import raises


@pytest.fixture(scope="module")
def puma(robots_folder):
    robot = read_robot(robots_folder / "puma560_elastic.toml")
    return robot, prepare_library(robot)


def test_clean_and_noisy_logs_give_the_torque_of_another_motion(puma):
    found = study_many_joints(*puma, SensorCondition.CLEAN, 3, duration=3.0)
    assert found.parameters == 36 + 6 + 12
    for entry in found.methods:
        assert max(entry.residual) < 0.5
        assert max(entry.floor) < 1e-3
    assert [notice.code for notice in found.notices] == ["identify.energy-rank"]
    found = study_many_joints(*puma, SensorCondition.NOISY, 3, duration=6.5)
    elimination, momentum = (np.array(entry.residual) / np.array(entry.floor) for entry in found.methods)
    # Elimination weighs all joints alike, so that noise of the strong ones reaches the wrist.
    assert np.all(elimination < 2.5)
    assert np.all(momentum < 1.3)


def test_the_truth_must_be_stated_and_the_plane_arm_have_two_joints(robots_folder, puma):
    unknown = prepare_library(read_robot(robots_folder / "emps.toml"), backend="python")
    with raises(UsageError, "usage.study-robot", match="'emps'"):
        get_true_parameters(unknown.card)
    with raises(UsageError, "usage.study-robot", match="2 joints"):
        simulate_runs(*puma, SensorCondition.CLEAN)
