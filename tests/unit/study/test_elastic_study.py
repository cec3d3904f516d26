"""The study of elastic robots: times only where asked for, all else the same for any number of processes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.excitation import build_ta
from symid.report.study_text import _show_dataset
from symid.robot.toml_reader import read_robot
from symid.simulation import simulate_elastic
from symid.study import elastic_methods as elastic_study
from tests.refusals import raises

ERRORS = {"parameter_error": 1.5, "hysteresis_error": 2.0, "excited_error": 2.5}
RUN = elastic_study.MethodRun(method="weighted", outcome="solved", iterations=7, seconds=0.5, **ERRORS)


@pytest.mark.parametrize(
    ("timed", "seconds", "end"), [(True, 0.6, ["0.60", "solved"]), (False, math.nan, ["2.5", "solved"])]
)
def test_times_stand_in_the_table_where_they_are_asked_for_only(timed, seconds, end):
    runs = [(RUN,), (replace(RUN, seconds=0.7, iterations=9),), (replace(RUN, seconds=0.6),)]
    (cell,) = elastic_study._summarise(runs, timed=timed)
    assert (cell.seconds, cell.iterations) == (pytest.approx(seconds, nan_ok=True), 9)
    told = {"dataset": "TA", "condition": elastic_study.SensorCondition.CLEAN, "seeds": 3, "cells": (cell,)}
    table = _show_dataset(elastic_study.DatasetStudy(**told, bound=math.nan, spring_bound=math.nan))
    assert str(table).split()[-2:] == end
    assert ("s" in table.header) is timed


def test_bounds_of_noisy_logs_are_lower_where_the_form_of_the_springs_is_known(robots_folder):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    library, options = prepare_library(robot), elastic_study.SensorCondition.NOISY.build_options()
    run = simulate_elastic(robot, library, build_ta(duration=4.0), options, np.random.default_rng(1))
    truth = elastic_study.get_true_parameters(library.card)
    scene = elastic_study.ElasticScene(library=library, truth=truth, runs={"TA": run})
    without, springs = once = elastic_study._compute_bounds(scene, ("TA",))
    assert 0.0 < springs < without
    twice = elastic_study._compute_bounds(scene, ("TA", "TA"))
    np.testing.assert_allclose(np.array(once) / twice, math.sqrt(2.0), rtol=1e-3)


@pytest.fixture(scope="module")
def puma(robots_folder):
    robot = read_robot(robots_folder / "puma560_elastic.toml")
    return robot, prepare_library(robot)


def test_clean_and_noisy_logs_give_the_torque_of_another_motion(puma):
    found = elastic_study.study_many_joints(*puma, elastic_study.SensorCondition.CLEAN, 3, duration=3.0)
    assert found.parameters == 36 + 6 + 12
    for entry in found.methods:
        assert max(entry.residual) < 0.5
        assert max(entry.floor) < 1e-3
    assert [notice.code for notice in found.notices] == ["identify.energy-rank"]
    found = elastic_study.study_many_joints(*puma, elastic_study.SensorCondition.NOISY, 3, duration=6.5)
    (elimination,) = (np.array(entry.residual) / np.array(entry.floor) for entry in found.methods)
    # It weighs all joints alike, so that noise of the strong ones reaches the wrist.
    assert np.all(elimination < 2.5)


def test_the_truth_must_be_stated_and_the_plane_arm_have_two_joints(robots_folder, puma):
    unknown = prepare_library(read_robot(robots_folder / "emps.toml"), backend="python")
    with raises(UsageError, "usage.study-robot", match="'emps'"):
        elastic_study.get_true_parameters(unknown.card)
    with raises(UsageError, "usage.study-robot", match="2 joints"):
        elastic_study.simulate_runs(*puma, elastic_study.SensorCondition.CLEAN)
