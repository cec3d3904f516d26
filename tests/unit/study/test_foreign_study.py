"""The study of foreign truths: one truth on short logs, what is printed of it, what is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import symid
import symid.study
from symid.cli.call import answer_call
from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.report import judge_fit
from symid.report.study_text import show_foreign
from symid.report.verdict import LEVELS
from symid.serialization import describe_record
from symid.study import foreign_truths
from symid.study.foreign_truths import ARMS, ForeignRun, list_true_values, study_foreign, write_arm
from tests.refusals import raises


@pytest.fixture(scope="module")
def study(c_compiler):
    """Return errors on logs that are too short for good results: 2.4 and 6 s."""
    assert c_compiler
    return study_foreign(
        [1], judge_fit, truths=("lugre",), methods=("weighted", "two-step"), share=0.12, jobs=1
    )


def test_every_method_is_scored_against_the_truth(study):
    (entry,) = study.truths
    assert (study.arm, entry.truth, entry.size, entry.seeds) == ("foreign_2r", "lugre", 1.0, 1)
    assert [cell.method for cell in entry.cells] == ["automatic", "weighted", "two-step"]
    for cell in entry.cells:
        assert 0.0 < cell.worst.median < 1000.0
        assert 0.0 < cell.spring.median < 200.0
        assert 0.0 < cell.z_rms <= cell.z_most
        ((level, count),) = cell.verdicts
        assert level in LEVELS
        assert count == 1
    assert len(entry.cells[0].choices) == 1
    best = min(cell.worst.median for cell in entry.cells[1:])
    assert entry.ratio.median == pytest.approx(entry.cells[0].worst.median / best)


def test_a_study_is_printed_and_written(study, monkeypatch, capsys):
    monkeypatch.setattr(symid.study.foreign_truths, "study_foreign", lambda *_, **__: study)
    found = symid.study_foreign(truths=["lugre"], seeds=1)
    assert found.tables == show_foreign(study)
    table, worst, spring = map(str, found.tables)
    assert "lugre" in table
    assert "1 of 1" in table or "0 of 1" in table
    assert worst.splitlines()[1].split() == spring.splitlines()[1].split()
    arguments = ["study", "foreign", "--truths", "lugre", "--sizes", "1,2", "--seeds", "1", "--json", "-q"]
    assert answer_call(arguments) == 0
    result = json.loads(capsys.readouterr().out)["result"]
    assert result == json.loads(json.dumps({**describe_record(study), "seeds": [1]}))
    assert result["truths"][0]["methods"][0]["method"] == "automatic"


def test_what_the_study_cannot_do_is_refused(capsys):
    with raises(UsageError, *["usage.foreign-study"] * 5):
        study_foreign([1], judge_fit, arm="4r", truths=("rust",), sizes=(0.0,), methods=("magic",), share=2.0)
    for arguments in (["--truths", "rust"], ["--sizes", "big"]):
        assert answer_call(["study", "foreign", *arguments, "--json"]) == 2
        (error,) = json.loads(capsys.readouterr().out)["errors"]
        assert error["code"] == "usage.foreign-study"


def test_errors_are_in_units_of_the_largest_of_a_kind():
    values = list_true_values(prepare_library(write_arm(ARMS["2r"], truth=True), backend="python").card)
    assert list(values) == ["ZZR1", "MXR1", "MY1", "ZZ2", "MX2", "MY2", "IA1", "IA2"]
    numbers = [1.16, 3.0, 0.0, 0.35, 0.8, 0.0, 0.8, 0.25]
    scales = [1.16, 3.0, 3.0, 0.35, 0.8, 0.8, 0.8, 0.25]
    assert np.array(list(values.values())) == pytest.approx(np.column_stack([numbers, scales]))


METHODS = ("weighted", "elimination")


def build_runs(*worst, refused=""):
    """Return the automatic choice, which took the first of the methods, and these, by their worst errors."""
    plain = ForeignRun(method="automatic", worst=0.0, spring=1.0, z_rms=1.0, z_most=2.0, verdict="good")
    runs = [replace(plain, chosen="weighted"), *(replace(plain, method=name) for name in METHODS)]
    told = [replace(run, worst=error) for run, error in zip(runs, worst, strict=True)]
    return tuple(replace(run, verdict="refused") if run.method == refused else run for run in told)


def test_methods_that_give_nothing_or_are_lucky_are_not_the_best():
    runs = build_runs(1.0, math.nan, 1.0, refused="weighted")
    entry = foreign_truths._summarise("lugre", 1.0, [runs, runs])
    assert (entry.best, entry.ratio.median, entry.near, entry.near_best) == ("elimination", 1.0, 2, 2)
    assert entry.cells[1].worst.median == math.inf
    assert entry.cells[1].verdicts == (("refused", 2),)
    runs = [build_runs(1.0, 1.0, 0.5), build_runs(1.0, 1.0, 2.0), build_runs(1.1, 1.0, 3.0)]
    entry = foreign_truths._summarise("cubic", 1.0, runs)
    assert (entry.best, entry.near, entry.near_best) == ("weighted", 2, 3)
