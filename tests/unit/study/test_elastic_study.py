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


def summarise(*, timed):
    runs = [(RUN,), (replace(RUN, seconds=0.7, iterations=9),), (replace(RUN, seconds=0.6),)]
    return elastic_study._summarise(runs, timed=timed)


def write(cells):
    nan = math.nan
    study = DatasetStudy(
        dataset="TA", condition=SensorCondition.CLEAN, seeds=3, bound=nan, spring_bound=nan, cells=cells
    )
    _, heading, _, row = str(_show_dataset(study)).splitlines()
    return heading.split(), row.split()


def test_times_stand_in_the_table_where_they_are_asked_for_only():
    (cell,) = summarise(timed=True)
    assert (cell.seconds, cell.iterations) == (0.6, 9)
    heading, row = write((cell,))
    assert heading[-2:] == ["s", "outcome"]
    assert row[-2:] == ["0.60", "solved"]
    (cell,) = summarise(timed=False)
    assert math.isnan(cell.seconds)
    heading, row = write((cell,))
    assert heading[-2:] == ["range", "outcome"]
    assert row[-2:] == ["2.5", "solved"]


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(robots_folder):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    one, two = (
        study_elastic(robot, [0], datasets={"TB": DATASETS["TB"]}, methods=("linear-spring",), jobs=jobs)
        for jobs in (1, 2)
    )
    # Numbers that are not there are nan, which is not itself; their text is.
    assert repr(one) == repr(two)
