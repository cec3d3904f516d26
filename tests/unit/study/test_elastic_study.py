"""The study of elastic robots: times only where asked for, all else the same for any number of processes."""

import math
from dataclasses import replace

import pytest

from symid.report.study_text import _show_dataset
from symid.robot.toml_reader import read_robot
from symid.study import elastic_methods as elastic_study
from symid.study.elastic_methods import DATASETS, DatasetStudy, MethodRun, SensorCondition, study_elastic

RUN = MethodRun(
    method="weighted",
    parameter_error=1.5,
    hysteresis_error=2.0,
    excited_error=2.5,
    outcome="solved",
    iterations=7,
    seconds=0.5,
)


@pytest.mark.parametrize(
    ("timed", "seconds", "head", "end"),
    [
        (True, 0.6, ["s", "outcome"], ["0.60", "solved"]),
        (False, math.nan, ["range", "outcome"], ["2.5", "solved"]),
    ],
)
def test_times_stand_in_the_table_where_they_are_asked_for_only(timed, seconds, head, end):
    runs = [(RUN,), (replace(RUN, seconds=0.7, iterations=9),), (replace(RUN, seconds=0.6),)]
    (cell,) = elastic_study._summarise(runs, timed=timed)
    assert (cell.seconds, cell.iterations) == (pytest.approx(seconds, nan_ok=True), 9)
    bounds = {"bound": math.nan, "spring_bound": math.nan}
    study = DatasetStudy(dataset="TA", condition=SensorCondition.CLEAN, seeds=3, cells=(cell,), **bounds)
    _, heading, _, row = str(_show_dataset(study)).splitlines()
    assert (heading.split()[-2:], row.split()[-2:]) == (head, end)


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(robots_folder):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    one, two = (
        study_elastic(robot, [0], datasets={"TB": DATASETS["TB"]}, methods=("linear-spring",), jobs=jobs)
        for jobs in (1, 2)
    )
    # Numbers that are not there are nan, which is not itself; their text is.
    assert repr(one) == repr(two)
