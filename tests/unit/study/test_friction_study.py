"""The study as a whole, and what it says of its own claims."""

import math
from dataclasses import replace

import pytest

from symid.errors import UsageError
from symid.report.study_text import list_tables
from symid.study import friction_protocols as friction_study
from symid.study.friction_protocols import (
    EstimatorComparison,
    EstimatorRun,
    MeanGain,
    list_checks,
    study_friction,
)
from tests.refusals import raises

GAIN = MeanGain(role="prediction", mean=15.0, deviation=1.0, rms=7.0, held_out=14.0, paper=16.3, miss=-1.3)


@pytest.fixture(scope="module")
def contest():
    run = EstimatorRun(estimator="varpro", objective=1.0, excess=0.0, solves=20, seconds=0.1)
    return EstimatorComparison(title="a contest", law="stribeck", samples=100, names=("fC",), runs=(run,))


@pytest.fixture(scope="module")
def study(contest):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(friction_study, "compare_estimators", lambda *_, **__: contest)
        # In this process; another test compares two others with it.
        patch.setattr(friction_study, "run_tasks", lambda run, tasks, **_: tuple(map(run, tasks)))
        return study_friction(range(3, 5))


def test_all_parts_are_there_and_few_draws_are_not_judged(study):
    assert study.seeds == (3, 4)
    assert [entry.sweep.peak for entry in study.agreement] == [0.5, 0.1, 0.3]
    assert [entry.joint for entry in study.recovery] == ["1", "2", "3"]
    assert [entry.joint for entry in study.second] == [f"RV-2SQ {k}" for k in (1, 2, 3, 4)]
    assert [entry.joint for entry in study.gains] == ["1", "2", "3"]
    assert {entry.draws for entry in (*study.recovery, *study.gains, *study.agreement)} == {2}
    assert check_of(study.checks, "S2, joint 1: bias").met is None
    assert check_of(study.checks, "S3, joint 1: improved against Coulomb").met is None
    assert check_of(study.checks, "RV-2SQ 2").met is None
    with raises(UsageError, "usage.friction-draws"):
        study_friction(range(1))


def test_times_stand_in_the_tables_where_they_were_measured(study, contest):
    def list_heads(contest):
        return [table.header[-1] for table in list_tables(replace(study, contests=(contest,)))]

    (run,) = contest.runs
    without = list_heads(replace(contest, runs=(replace(run, seconds=math.nan),)))
    found = [pair for pair in zip(list_heads(contest), without, strict=True) if pair[0] != pair[1]]
    assert len(found) == 1
    assert found[0][0].startswith("ms")
    assert found[0][1] == "iterations"


def test_the_number_of_processes_changes_nothing(study, contest, monkeypatch):
    monkeypatch.setattr(friction_study, "compare_estimators", lambda *_, **__: contest)
    told = []
    again = study_friction(range(3, 5), jobs=2, progress=lambda done, whole: told.append((done, whole)))
    assert again == study
    assert told == sorted(set(told))
    assert told[-1][0] == told[-1][1] == told[0][1]


def check_of(checks, start):
    (check,) = [check for check in checks if check.name.startswith(start)]
    return check


_PARTS = ("agreement", "recovery", "gains", "second", "contests", "races")


def find(study, **parts):
    values = {name: getattr(study, name) for name in _PARTS}
    return list_checks(**{**values, **parts})


@pytest.mark.parametrize(("ratio", "bias", "met"), [(1.1, 0.1, True), (1.25, 0.3, False), (0.7, -0.3, False)])
def test_spreads_are_judged_with_many_draws(study, ratio, bias, met):
    first, *others = (replace(entry, ratio=1.0, bias=0.0) for entry in study.recovery[0].parameters)
    parameters = (replace(first, ratio=ratio, bias=bias), *others)
    checks = find(study, recovery=[replace(study.recovery[0], draws=1000, parameters=parameters)])
    for what in ("standard deviations", "bias"):
        assert check_of(checks, f"S2, joint 1: {what}").met is met


@pytest.mark.parametrize(("miss", "met"), [(0.9, True), (-1.1, False)])
def test_gains_are_judged_against_the_paper(study, miss, met):
    gain = replace(study.gains[0], draws=100, viscous=replace(study.gains[0].viscous, miss=miss))
    checks = find(study, gains=[gain])
    assert check_of(checks, "S3, joint 1: improved against Coulomb").met is met
    assert check_of(checks, "S3, joint 1: improved against original").met is None


def test_what_misses_is_named(study, contest):
    first = study.agreement[0]
    rows = tuple(replace(row, excess=0.01, agreed=1) for row in first.rows)
    checks = find(study, agreement=[replace(first, rows=rows)])
    assert check_of(checks, "S1, peak 0.5 rad/s: varpro, root-finding, nlp agree").met is False
    genetic = check_of(checks, "S1, peak 0.5 rad/s: genetic")
    assert (genetic.met, genetic.found) == (False, "1 of 2 draws, worst 1 %")
    for change in ({"excess": 1e-5}, {"solves": 151}):
        beaten = replace(contest, runs=(replace(contest.runs[0], **change),))
        assert check_of(find(study, contests=[beaten]), "a contest").met is False
    assert check_of(find(study, contests=[contest]), "a contest").met is True
    told = [(entry, entry.name != "vs") for entry in study.second[1].parameters]
    lost = tuple(replace(e, identifiable=known, inside=100 * known, mean=e.truth) for e, known in told)
    check = check_of(find(study, second=[replace(study.second[1], draws=100, parameters=lost)]), "RV-2SQ 2")
    assert check.met is True
    assert check.found.endswith(" 50 %: vs")
    assert GAIN.describe_miss() == "1.3 points below the paper"
    near = replace(GAIN, miss=0.5)
    assert near.describe_miss() == "0.5 points above the paper, within the deviation of a draw"
