"""`symid.hysteresis`: a fit from arrays and from files, what it prints, and what it refuses."""

import json

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.errors import LogError, RobotError, UsageError
from symid.notation import HYSTERESIS_MODELS
from tests.hysteresis_truths import make_dahl, make_input, make_stops, measure


@pytest.fixture(scope="module")
def recording():
    t, x = make_input(1, count=1500)
    return t, *measure(t, x, make_stops, 2)


@pytest.fixture(scope="module")
def fit(recording):
    t, x, y = recording
    return symid.hysteresis.fit(x, y, t, model="maxwell_slip")


def test_a_fit_prints_its_verdict_first(fit):
    lines = str(fit).splitlines()
    assert lines[0].startswith("verdict: good - maxwell-slip with ")
    assert "No motion gets work" in str(fit) or "no motion gets work" in str(fit)
    assert repr(fit).startswith("<ElementFit maxwell-slip: ")
    plain = json.loads(json.dumps(fit.to_dict()))
    assert plain["model"] == "maxwell-slip"
    assert plain["candidates"][0]["held_out"] == fit.record.held_out


def test_a_parameter_that_is_not_there(fit):
    with pytest.raises(KeyError, match="is no parameter"):
        fit["nothing"]


def test_the_inverse_of_the_fit_returns_the_input(recording):
    t, x, y = recording
    found = symid.hysteresis.fit(x, y, t, model="prandtl-ishlinskii", passive=True)
    output = found.predict(x[:200], t[:200])
    np.testing.assert_allclose(found.invert(output, t[:200]), x[:200], atol=1e-9)


def test_another_amplitude_is_an_extrapolation(fit):
    t, x = make_input(4, 1.5, 1200)
    tried = fit.validate(*measure(t, x, make_stops, 3), t)
    assert tried.trial.beyond > 0.05
    assert "extrapolates" in "\n".join(tried.verdict.details)
    assert tried.trial.error < 10.0
    assert repr(tried).startswith("<ElementValidation maxwell-slip: ")


def test_without_time_no_model_depends_on_the_speed(recording):
    _, x, y = recording
    found = symid.hysteresis.fit(x, y, model="nonlinear-stops")
    assert not any("speed" in entry.form for entry in found.record.candidates)
    assert "No time was given" in "\n".join(found.verdict.details)


def test_a_fit_that_needs_time_asks_for_it(recording):
    t, x, y = recording
    found = symid.hysteresis.fit(x, y, t, model="lugre")
    with pytest.raises(UsageError, match="give the time") as caught:
        found.predict(x)
    assert caught.value.notices[0].code == "usage.hysteresis-time"
    with pytest.raises(RobotError, match="falls with the speed"):
        found.invert(y, t)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda x, y, t: (x[:9], y[:9], t[:9]), "9 samples; at least 50"),
        (lambda x, y, t: (x, y[:-1], t), "columns of one length"),
        (lambda x, y, t: (np.where(t == t[4], np.nan, x), y, t), "input: sample 5 is not a finite number"),
        (lambda x, y, t: (x, 0.0 * y, t), "output: all samples are 0"),
        (lambda x, y, t: (x, y, t[::-1]), "time: sample 2 is not later"),
    ],
)
def test_what_is_no_recording_is_refused(recording, change, text):
    t, x, y = recording
    x, y, t = change(x, y, t)
    with pytest.raises(UsageError, match=text) as caught:
        symid.hysteresis.fit(x, y, t)
    assert caught.value.notices[0].code == "usage.hysteresis-recording"


def test_an_unknown_model_lists_all(recording):
    t, x, y = recording
    with pytest.raises(UsageError, match="Known: auto, prandtl-ishlinskii") as caught:
        symid.hysteresis.fit(x, y, t, model="preisach")
    assert caught.value.notices[0].code == "usage.unknown-hysteresis"
    assert HYSTERESIS_MODELS[0] in str(caught.value)


def test_a_loop_that_gives_work_has_no_passive_lugre(recording):
    t, x, _ = recording
    with pytest.raises(UsageError, match="no passive") as caught:
        symid.hysteresis.fit(x, -make_dahl(t, x) + 3.0 * np.gradient(x, t), t, model="lugre", passive=True)
    assert caught.value.notices[0].code == "usage.no-hysteresis"


@pytest.fixture(scope="module")
def file(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("element") / "spring.csv"
    np.savetxt(path, np.column_stack(recording), delimiter=",", header="t,phi,tau", comments="")
    return path


def test_columns_are_read_by_name(file, tmp_path):
    columns = symid.hysteresis.read_columns(file, x="phi", y="tau", t="t")
    archive = tmp_path / "spring.npz"
    np.savez(archive, data=np.column_stack(columns))
    again = symid.hysteresis.read_columns(archive, x="data[0]", y="data[1]")
    np.testing.assert_array_equal(again.x, columns.x)
    assert again.t is None
    with pytest.raises(LogError, match=r"no column 'phj'; did you mean phi") as caught:
        symid.hysteresis.read_columns(file, x="phj", y="nonsense", t="t")
    assert [notice.code for notice in caught.value.notices] == ["log.no-column"] * 2


def test_the_verb_prints_what_the_fit_says(file, capsys):
    options = ["--input", "phi", "--output", "tau", "--time", "t", "--model", "maxwell-slip"]
    assert run(["hysteresis", str(file), *options, "--validate", str(file)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("verdict: good - maxwell-slip")
    assert text.count("verdict: ") == 2
    assert run(["hysteresis", str(file), *options, "--passive", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"]
    assert answer["result"]["passive"]
