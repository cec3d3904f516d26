"""`symid.hysteresis`: a fit from arrays and from files, what it prints, and what it refuses."""

import json

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.errors import EstimateError, LogError, UsageError
from symid.notation import HYSTERESIS_MODELS
from tests.calls import say
from tests.hysteresis_truths import make_dahl, make_input, make_stops, measure
from tests.refusals import raises


@pytest.fixture(scope="module")
def recording():
    t, x = make_input(1, count=1500)
    return t, *measure(t, x, make_stops, 2)


@pytest.fixture(scope="module")
def fit(recording):
    t, x, y = recording
    return symid.hysteresis.fit(x, y, t, model="maxwell_slip")


@pytest.fixture(scope="module")
def passive(recording):
    t, x, y = recording
    return symid.hysteresis.fit(x, y, t, model="prandtl-ishlinskii", passive=True)


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


def test_the_inverse_of_the_fit_returns_the_input(recording, passive):
    t, x, _ = recording
    output = passive.predict(x[:200], t[:200])
    np.testing.assert_allclose(passive.invert(output, t[:200]), x[:200], atol=1e-9)


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
    with raises(UsageError, "usage.hysteresis-time", match="give the time"):
        found.predict(x)
    with raises(UsageError, "usage.no-inverse", match="falls with the speed"):
        found.invert(y, t)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda x, y, t: (x[:9], y[:9], t[:9]), "9 samples; at least 48"),
        (lambda x, y, t: (x, y[:-1], t), "columns of one length"),
        (lambda x, y, t: (np.where(t == t[4], np.nan, x), y, t), "input: sample 5 is not a finite number"),
        (lambda x, y, t: (x, 0.0 * y, t), "output: all samples are 0"),
        (lambda x, y, t: (x, y, t[::-1]), "time: sample 2 is not later"),
    ],
)
def test_what_is_no_recording_is_refused(recording, change, text):
    t, x, y = recording
    x, y, t = change(x, y, t)
    with raises(UsageError, "usage.hysteresis-recording", match=text):
        symid.hysteresis.fit(x, y, t)


def test_a_prediction_begins_with_the_memory_that_is_said(fit):
    x = np.array([0.5, 0.5, 0.4])
    below, above = (fit.predict(x, np.arange(3.0), start=side) for side in ("below", "above"))
    # Stops are at their upper bound where the input has come from below.
    assert below[0] > above[0]
    assert below[1] == pytest.approx(below[0], rel=1e-6)
    with raises(UsageError, "usage.unknown-start", match="Known: zero, fresh, below, above"):
        fit.predict(x, np.arange(3.0), start="middle")


def test_an_unknown_model_lists_all(recording):
    t, x, y = recording
    with raises(UsageError, "usage.unknown-hysteresis", match="Known: auto, prandtl-ishlinskii") as caught:
        symid.hysteresis.fit(x, y, t, model="preisach")
    assert HYSTERESIS_MODELS[0] in str(caught.value)


def test_a_loop_that_gives_work_has_no_passive_lugre(recording):
    t, x, _ = recording
    with raises(UsageError, "usage.no-hysteresis", match="no passive"):
        symid.hysteresis.fit(x, -make_dahl(t, x) + 3.0 * np.gradient(x, t), t, model="lugre", passive=True)


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
    with raises(LogError, *["log.no-column"] * 2, match=r"no column 'phj'; did you mean phi"):
        symid.hysteresis.read_columns(file, x="phj", y="nonsense", t="t")


def test_the_verb_prints_what_the_fit_says(file, capsys):
    options = ["--input", "phi", "--output", "tau", "--time", "t", "--model", "maxwell-slip"]
    text = say("hysteresis", file, *options, "--validate", file)
    assert text.startswith("verdict: good - maxwell-slip")
    assert text.count("verdict: ") == 2
    assert run(["hysteresis", str(file), *options, "--passive", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"]
    assert answer["result"]["passive"]


def test_a_fit_comes_back_from_its_file(fit, tmp_path):
    path = fit.save(tmp_path / "fit.json")
    assert symid.hysteresis.is_saved(path)
    again = symid.hysteresis.load(path)
    assert again.to_dict() == fit.to_dict()
    assert again.element == fit.element
    np.testing.assert_array_equal(again.record.trace.measured, fit.record.trace.measured)
    assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("model", ["bouc-wen", "krasnoselskii-pokrovskii", "nonlinear-stops", "lugre"])
def test_every_branch_comes_back_from_its_file(recording, model, tmp_path):
    t, x, y = recording
    fit = symid.hysteresis.fit(x, y, t, model=model)
    again = symid.hysteresis.load(fit.save(tmp_path / "fit.json"))
    assert again.element == fit.element
    np.testing.assert_array_equal(again.predict(x, t), fit.predict(x, t))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda data: data.pop("span"), "span is missing"),
        (lambda data: data.update(start="nowhere"), "expected one of zero, fresh, below, above"),
        (lambda data: data["elasticity"]["branches"].append({"length": 1.0, "low": 2.0}), "expected a table"),
        (lambda data: data.update(format="another"), "no element written by"),
    ],
)
def test_a_damaged_file_is_refused(fit, tmp_path, change, text):
    path = fit.save(tmp_path / "fit.json")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(EstimateError, match=text):
        symid.hysteresis.load(path)


def test_what_is_no_fit_is_not_saved(tmp_path):
    assert not symid.hysteresis.is_saved(tmp_path / "nothing.json")
    (tmp_path / "list.json").write_text("[1]")
    assert not symid.hysteresis.is_saved(tmp_path / "list.json")


def test_the_page_has_its_figures(fit, tmp_path):
    text = fit.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("<svg") == len(fit.plot()) == 7
    for part in ("Output against input", "Work of a cycle", "Masing", "maxwell-slip"):
        assert part in text
    assert "First-order" not in text


def test_reversal_curves_are_shown_where_the_recording_has_them(passive):
    turns = [1.0, -0.8, 1.0, -0.4, 1.0, 0.0, 1.0, 0.4, 1.0]
    path = np.interp(np.arange(900) / 100.0, range(9), turns)
    other = symid.hysteresis.fit(path, make_stops(path, path), model="dahl")
    assert not any("First-order" in entry.caption for entry in passive.plot().drawings)
    assert sum("First-order" in entry.caption for entry in other.plot().drawings) == 1


def test_cycles_lose_what_closed_loops_enclose():
    from symid.identification.hysteresis import ElementTrace
    from symid.report.result_pages import compute_cycles

    # One slider of threshold r behind a spring k loses 4 k r (X - r) a cycle of half width X.
    k, r, half = 3.0, 0.2, 1.0
    x = half * np.sin(np.linspace(0.0, 8.0 * np.pi, 8001))
    bent, y, before = 0.0, [], 0.0
    for place in x:
        bent, before = float(np.clip(bent + place - before, -r, r)), place
        y.append(k * bent)
    trace = ElementTrace(
        time=np.arange(len(x)) * 1.0, position=x, measured=np.array(y), predicted=0.5 * np.array(y)
    )
    width, measured, predicted = compute_cycles(trace).T
    np.testing.assert_allclose(width, 2.0 * half, rtol=1e-3)
    np.testing.assert_allclose(measured, 4.0 * k * r * (half - r), rtol=1e-3)
    np.testing.assert_allclose(predicted, 0.5 * measured, rtol=1e-9)


def test_an_inverse_that_goes_too_far_is_refused(recording, passive):
    _, x, y = recording
    with raises(UsageError, "usage.inverse-beyond", match="need inputs from"):
        passive.invert(20.0 * y)
    assert np.ptp(passive.invert(20.0 * y, beyond=True)) > np.ptp(x)


def test_a_slope_that_may_be_zero_has_no_inverse():
    t, x = make_input(1, count=1500)
    y = make_stops(t, x) - 0.8 * x
    y += 0.01 * np.std(y) * np.random.default_rng(1).normal(size=len(y))
    found = symid.hysteresis.fit(x, y, t, model="prandtl-ishlinskii", passive=True)
    with pytest.raises(UsageError, match="no inverse"):
        found.invert(y)


def test_a_validation_says_what_the_inverse_misses(recording, passive):
    t, x, y = recording
    tried = passive.validate(x, y, t)
    # Noise of 1 % in the output becomes noise of the input, at slopes near those of the element.
    assert 0.1 < tried.trial.inverse < 3.0
    assert "Inverse: misses the input by" in str(tried)


def test_options_that_a_saved_fit_cannot_take(fit, tmp_path, capsys):
    path = str(fit.save(tmp_path / "fit.json"))
    assert run(["hysteresis", path, "--model", "dahl"]) == 2
    assert "this file is a fit" in capsys.readouterr().err
    assert run(["hysteresis", path, "--validate", "other.csv"]) == 2
    assert "--input and --output: name the columns" in capsys.readouterr().err
    assert run(["hysteresis", "recording.csv", "--json"]) == 2
    assert "usage.columns" in capsys.readouterr().out
    assert run(["hysteresis", path, "-o", path]) == 3
    assert "would be overwritten" in capsys.readouterr().err
