"""Verdicts: their levels, what is printed and stored of them, and what a held-out log is judged by."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import symid
from symid.identification import RigidValidation, write_fit
from symid.identification.estimators import Residual, Validation
from symid.identification.judge import POLICY
from symid.report import verdict as verdicts
from symid.report.blocks import Table
from symid.serialization import describe_record
from tests.estimates import build_estimate

VERDICT = verdicts.FitVerdict(
    level="wrong", headline="It is off.", details=("a", "b"), cause="A sign.", remedy="Turn it."
)


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link").description


@pytest.fixture(scope="module")
def estimate(robot):
    return build_estimate(robot)


def set_residual(record, *percents):
    residual = tuple(
        replace(entry, relative_percent=percent)
        for entry, percent in zip(record.residual, percents, strict=True)
    )
    return replace(record, residual=residual)


def make_trial(robot, percent, *, std=0.1, fitted=False, rows="torque", band=None):
    shared = {"norm": 10.0 * std, "relative_percent": percent, "std": std, "samples": 100, "unit": "N m"}
    residual = tuple(Residual(joint=joint.name, **shared) for joint in robot.joints)
    told = {"source": "<held out>", "rows": rows, "residual": residual, "fitted": fitted, "scoring": 0.0}
    validation = Validation(robot=robot.name, signature="", series=(), samples=200, **told)
    return RigidValidation(
        robot=robot,
        source="<held out>",
        tables=(("", residual),),
        notices=(),
        validation=validation,
        settled=None,
        band=band,
    )


def test_verdicts_and_tables_are_printed_on_lines_of_their_own():
    assert verdicts.show_verdict(VERDICT) == "verdict: wrong - It is off.\ncause: A sign.\nremedy: Turn it."
    assert verdicts.show_verdict(replace(VERDICT, cause="", remedy="")) == "verdict: wrong - It is off."
    assert list(describe_record(VERDICT)) == ["level", "headline", "cause", "remedy", "details"]
    group = " + ".join(f"ZZ{k}" for k in range(1, 30))
    table = Table(("group", "value"), [(group, 1.5), ("M1", 2.0)], fold=40)
    lines = str(table).splitlines()
    assert max(map(len, lines)) < 60
    assert " ".join(line[:40].strip() for line in lines[2:-1]) == group.replace("\n", " ")
    assert lines[2].endswith("1.5")
    assert lines[-1].split() == ["M1", "2"]
    assert group in table.write_html()
    assert group in str(replace(table, fold=0))


@pytest.mark.parametrize(
    ("level", "code"),
    [("wrong", "identify.wrong"), ("doubtful", "identify.doubtful"), ("usable", None), ("good", None)],
)
def test_wrong_and_doubtful_have_a_notice(level, code):
    notices = verdicts.list_verdict_notices(replace(VERDICT, level=level), "fit.json")
    assert [entry.code for entry in notices] == ([] if code is None else [code])
    tried = verdicts.list_verdict_notices(replace(VERDICT, level=level), "log.csv", tried=True)
    assert [entry.code for entry in tried] == ([] if code is None else [code.replace("identify", "validate")])
    assert all(entry.file == "fit.json" and not entry.is_note for entry in notices)


def test_a_fit_that_leaves_most_of_the_torque_is_wrong(estimate):
    limit = POLICY.lost
    verdict = verdicts.judge_identification(set_residual(estimate, limit + 1.0, limit + 1.0), ())
    assert verdict.level == "wrong"
    assert f"{limit + 1.0:.3g} %" in verdict.headline
    assert not verdict.cause
    assert "symid check" in verdict.remedy
    below = verdicts.judge_identification(set_residual(estimate, limit - 1.0, limit - 1.0), ())
    assert below.level != "wrong"
    assert (below.cause, below.remedy) == ("", "")
    assert verdicts.judge_identification(set_residual(estimate, 5.0, math.inf), ()).level != "wrong"
    assert verdicts.judge_identification(set_residual(estimate, math.inf, math.inf), ()).level == "wrong"


@pytest.mark.parametrize(
    ("percent", "level"), [(5.0, "good"), (20.0, "usable"), (50.0, "doubtful"), (90.0, "wrong")]
)
def test_a_held_out_log_is_judged_by_the_same_limits(robot, estimate, percent, level):
    verdict = verdicts.judge_trial(make_trial(robot, percent), estimate)
    assert verdict.level == level
    assert f"{percent:g} %" in verdict.headline
    assert verdicts.judge_trial(make_trial(robot, percent)).level == level
    trial = make_trial(robot, percent)
    both = verdicts.judge_identification(estimate, (trial.validation,))
    assert verdicts.LEVELS.index(both.level) <= verdicts.LEVELS.index(level)
    assert (both.level == "wrong") == (level == "wrong")


def test_a_residual_larger_than_that_of_the_fit_counts_and_a_log_of_the_fit_not(robot, estimate):
    # Of little that is left, twice as much is good, and more does not make the log doubtful.
    for percent, std, level in (
        (5.0, 0.15, "good"),
        (5.0, 0.3, "usable"),
        (11.0, 0.15, "usable"),
        (11.0, 0.3, "doubtful"),
    ):
        assert verdicts.judge_trial(make_trial(robot, percent, std=std), estimate).level == level
    # Residuals of other rows, or of a band, cannot be compared with those of the fit.
    for other in ({"rows": "momentum"}, {"band": SimpleNamespace(band=20.0)}):
        assert verdicts.judge_trial(make_trial(robot, 5.0, std=0.3, **other), estimate).level == "good"
    verdict = verdicts.judge_trial(make_trial(robot, 1.0, fitted=True), estimate)
    assert verdict.level == "usable"
    assert "no test" in verdict.headline


def store(estimate, path):
    verdict = describe_record(verdicts.judge_identification(estimate, ()))
    return write_fit(estimate, path, verdict=verdict)


def test_a_fit_shows_its_verdict_first_and_a_wrong_one_with_its_error(estimate, tmp_path):
    good = symid.load_fit(store(estimate, tmp_path / "good.json"))
    assert good.accepted
    assert str(good).startswith("verdict: usable - ")
    bad = symid.load_fit(store(set_residual(estimate, 99.0, 98.0), tmp_path / "bad.json"))
    assert str(bad).splitlines()[-1].startswith("error: ")
    for text in ('"symid fail"', bad.verdict.headline):
        assert text in bad._repr_html_()
    assert [entry.code for entry in bad.report(tmp_path / "page.html").errors] == ["identify.wrong"]


def test_the_stored_verdict_is_read_over_and_a_doubtful_one_warns(estimate, tmp_path):
    fit = symid.load_fit(store(estimate, tmp_path / "fit.json"))
    assert fit.estimate == estimate
    text = fit.save(tmp_path / "again.json").read_text(encoding="utf-8")
    assert text == (tmp_path / "fit.json").read_text(encoding="utf-8")
    high = tuple(replace(entry, truth=9.0) for entry in estimate.parameters)
    high = replace(estimate, parameters=high, simulated=True)
    fit = symid.load_fit(store(high, tmp_path / "fit.json"))
    assert (fit.verdict.level, fit.notices[0].code) == ("doubtful", "identify.doubtful")
    assert fit.accepted
    assert np.isfinite(fit.covariance).all()


def test_a_value_near_zero_is_uncertain_only_where_its_deviation_matters(estimate):
    first, *_ = estimate.parameters
    entry = replace(first, truth=None, unit="kg m")
    values = (
        ("MX1", 2.0, 0.01),
        ("MY1", 0.01, 0.01),
        ("MZ1", 0.01, 1.0),
        ("MY2", 0.01, 0.01),
        ("MX3", 1.0, 0.4),
    )
    parameters = tuple(replace(entry, name=name, value=value, std=std) for name, value, std in values)
    details = verdicts.judge_identification(replace(estimate, parameters=parameters), ()).details
    # MY1 is small beside MX1; of the second link nothing is known, and MX3 is known badly.
    assert "Uncertain by more than 30 %: MZ1, MY2, MX3." in details
    assert "Near zero, within 3 standard deviations: MY1." in details
