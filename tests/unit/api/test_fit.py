"""Fits of the API: the same numbers as the command line, from files and from memory."""

import dataclasses
import json

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.errors import merge_notices, sort_notices
from tests.calls import ask, do, list_codes
from tests.refusals import raises


@pytest.fixture(scope="module")
def logs(robot, tmp_path_factory):
    """Return the files of two logs of other motions."""
    folder = tmp_path_factory.mktemp("logs")
    return tuple(robot.simulate(seed=seed, duration=8.0).save(folder / f"{seed}.npz") for seed in (1, 2))


@pytest.fixture(scope="module")
def fit(robot, logs):
    return robot.identify(logs[0], estimator="wls", cutoff=50.0)


def test_a_fit_is_what_identify_prints_and_gives(capsys, fit, logs):
    arguments = ("identify", "two_link", logs[0], "--estimator", "wls", "--cutoff", "50")
    answer = do(*arguments)
    result = {name: value for name, value in answer["result"].items() if name != "file"}
    assert result == json.loads(json.dumps(fit.to_dict()))
    assert [entry["text"] for entry in answer["warnings"]] == [
        entry.text for entry in sort_notices(fit.notices)
    ]
    assert run([*map(str, arguments), "-q", "-v"]) == 0
    assert capsys.readouterr().out == f"{fit.to_text()}\n"
    assert str(fit).startswith(fit.to_text())
    assert all(f"{entry.text}" in str(fit) for entry in merge_notices(fit.notices, fit.sources))


def test_parameters_are_found_by_name(fit, robot):
    truth = robot.base.values
    assert set(fit) == {*robot.base, *robot.base.friction}
    assert all(abs(fit[name].value - truth[name]) < 5.0 * fit[name].std for name in robot.base)
    assert fit.covariance.shape == (len(fit), len(fit))
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx([fit[name].std for name in fit])
    with raises(symid.UsageError, "usage.unknown-parameter") as caught:
        fit["ZZ22"]
    assert "ZZ2" in str(caught.value)


def test_a_fit_cannot_be_changed(fit):
    with pytest.raises(dataclasses.FrozenInstanceError):
        fit.estimate = None
    with pytest.raises(ValueError, match="read-only"):
        fit.covariance[0, 0] = 1.0
    fit.settings["processing"]["filter_cutoff"] = 1e9
    assert fit.settings["processing"]["filter_cutoff"] == 50.0


def test_files_logs_and_arrays_give_the_same_fit(robot, logs, fit):
    log = symid.read_log(logs[0], robot)
    read = robot.identify(log, estimator="wls", cutoff=50.0)
    made = symid.build_log(robot, time=log.time, q=log.q, tau=log.tau)
    built = robot.identify([made], estimator="wls", cutoff=50.0)
    assert read.values == fit.values
    assert built.values == fit.values


def test_no_log_is_refused(robot):
    with raises(symid.UsageError, "usage.no-log"):
        robot.identify([])


def test_a_saved_fit_is_read_back_whole(fit, tmp_path, robot, logs):
    path = fit.save(tmp_path / "fit.json")
    read = symid.load_fit(path)
    assert read.values == fit.values
    assert read.estimate == fit.estimate
    assert read.robot.name == robot.name
    first, second = fit.validate(logs[1]), read.validate(logs[1])
    assert first.mean_relative_percent == second.mean_relative_percent


def test_a_validation_is_what_the_verb_says(fit, logs, tmp_path):
    path = fit.save(tmp_path / "fit.json")
    found = fit.validate(logs[1], gate=1e-3, band=20.0)
    code, answer = ask("validate", "two_link", path, logs[1], "--gate", "1e-3", "--band", "20")
    assert code == 1
    assert not found.accepted
    assert answer["result"] == json.loads(json.dumps(found.to_dict()))
    assert list_codes(answer, "errors") == ["validate.gate-missed"]
    assert found.errors[0].text == answer["errors"][0]["text"]


def test_the_residual_of_a_validation_is_measured_less_predicted(fit, logs):
    found = fit.validate(logs[1])
    for series, residual in zip(found.product.validation.series, found.residual, strict=True):
        left = np.linalg.norm(series.measured - series.predicted)
        assert residual.norm == pytest.approx(left, rel=1e-9)
        assert residual.relative_percent == pytest.approx(
            100.0 * left / np.linalg.norm(series.measured), rel=1e-9
        )


def test_figures_show_themselves_and_are_written(fit, logs, tmp_path):
    figures = fit.validate(logs[1]).plot()
    assert len(figures) == 2
    svg = figures.save(tmp_path / "torques.svg").read_text(encoding="utf-8")
    assert svg.startswith("<svg")
    assert svg.count("<polyline") == 4
    assert "<svg" in figures._repr_html_()
    assert figures.save(tmp_path / "torques.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(symid.UsageError, match=r"\.svg or \.html"):
        figures.save(tmp_path / "torques.png")


class Axes:
    """What is asked of axes of matplotlib."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        if name.startswith("_") or name == "flat":
            raise AttributeError(name)
        return lambda *args, **options: self.calls.append((name, args, options))


def test_figures_are_drawn_into_axes_of_ones_own(fit, logs):
    axes = [Axes(), Axes(), Axes()]
    found = fit.validate(logs[1])
    assert len(found.plot(ax=axes)) == 2
    for ax, series in zip(axes, found.product.validation.series, strict=False):
        (x, measured), (same, predicted) = (args for name, args, _ in ax.calls if name == "plot")
        # From where the log begins.
        np.testing.assert_array_equal([x, same], [series.time - series.time[0]] * 2)
        np.testing.assert_array_equal([measured, predicted], [series.measured, series.predicted])
        assert ("set_xlabel", ("time (s)",), {}) in ax.calls
        assert ("set_ylabel", (f"torque ({series.unit})",), {}) in ax.calls
    assert axes[2].calls == []
    one = Axes()
    fit.plot(ax=one)
    (values,) = (args for name, args, _ in one.calls if name == "plot")
    sizes = [abs(entry.value) / entry.std for entry in fit.parameters]
    assert sorted(values[0]) == pytest.approx(sorted(sizes))
    for other in (1, [], "ax", [one, 1]):
        with raises(symid.UsageError, "usage.axes", match=r"expected axes of matplotlib"):
            fit.plot(ax=other)


def test_matplotlib_draws_them(fit, logs):
    pyplot = pytest.importorskip("matplotlib.figure", reason="the extra plot is not installed")
    figure = pyplot.Figure()
    axes = figure.subplots(2, 1)
    fit.validate(logs[1]).plot(ax=axes)
    assert [len(ax.lines) for ax in axes] == [2, 2]
    assert [text.get_text() for text in axes[0].get_legend().get_texts()] == ["measured", "predicted"]


def test_what_to_install_is_said(fit, monkeypatch):
    monkeypatch.setattr("symid.report.drawings.find_spec", lambda _: None)
    with pytest.raises(symid.UsageError, match=r"pip install 'symid\[plot\]'"):
        fit.plot(ax=1)


def test_a_notebook_sees_tables_and_notices(fit):
    page = fit._repr_html_()
    assert page.count("<table>") == 3
    assert "ZZR1" in page
    assert "slow/%" in page
    assert repr(fit) == f"<RigidFit {fit.summarise()}>"


def test_a_prior_may_be_a_fit_or_its_file(fit, robot, logs, tmp_path):
    path = fit.save(tmp_path / "fit.json")
    whole = symid.IdentifyOptions(estimator="ridge", prior_weight=1.0)
    first = robot.identify(logs[1], options=dataclasses.replace(whole, prior=fit))
    second = robot.identify(logs[1], options=dataclasses.replace(whole, prior=path))
    assert first.values == second.values
    assert first.values != robot.identify(logs[1], options=whole).values


def test_friction_with_a_known_rigid_part(fit, robot, logs):
    laws = robot.identify_friction(logs[0], model="coulomb-viscous-offset", known=fit)
    assert set(laws.joints) == {"shoulder", "elbow"}
    assert laws.joints["elbow"].estimate.parameters[0].value == pytest.approx(fit["Fc2"].value, rel=0.02)
    assert laws.validate(logs[1]).mean_relative_percent < 3.0
    with raises(symid.EstimateError, "estimate.kind"):
        robot.identify_friction(logs[0], known=laws)


def test_a_report_of_a_fit_in_memory(fit, logs, tmp_path):
    page = fit.report(tmp_path / "report.html", validation=logs[1], diagnose=True)
    text = page.file.read_text(encoding="utf-8")
    assert str(logs[1]) in text
    assert page.diagnosis is not None
    assert len(text) > 1.5 * len(fit.report(tmp_path / "short.html").file.read_text(encoding="utf-8"))


def test_a_robot_that_is_not_known_by_name_is_asked_for(fit, tmp_path, logs):
    other = dataclasses.replace(fit.estimate, robot="nobody")
    path = dataclasses.replace(fit, estimate=other).save(tmp_path / "fit.json")
    with pytest.raises(symid.UsageError, match="--robot"):
        symid.load_fit(path).validate(logs[1])


def test_another_log_of_the_same_name_is_no_log_of_the_fit(robot):
    first, second = (robot.simulate(seed=seed, duration=4.0).log for seed in (1, 2))
    assert first.source == second.source
    fit = robot.identify(first)
    assert "validate.fitted-log" in {note.code for note in fit.validate(first).notices}
    assert "validate.fitted-log" not in {note.code for note in fit.validate(second).notices}


def test_vectors_of_a_fit_go_into_functions(fit, robot):
    lib = robot.compile()
    q, dq, ddq = np.array([0.2, -0.4]), np.array([0.5, 0.3]), np.array([1.0, -2.0])
    torque = lib.inverse_dynamics(q, dq, ddq, fit.beta)
    assert torque == pytest.approx(lib.inverse_dynamics(q, dq, ddq, lib.beta), rel=0.02)
    ours = np.array(robot.casadi("inverse_dynamics")(q, dq, ddq, fit.beta)).ravel()
    assert ours == pytest.approx(torque, rel=1e-12)
    assert fit.f == pytest.approx(lib.f, rel=0.05)


def test_vectors_that_functions_would_misread_are_refused(robot):
    """A motor-side fit has rotors in its groups: its ZZR1 is another parameter of the same name."""
    arm = symid.load("two_link_elastic")
    log = arm.simulate("ta", scale=10, duration=6.0, seed=1).log
    theta = log.recording.motor_position
    rigid = arm.identify(symid.build_log(arm, time=log.time, q=theta, tau=log.tau, source="motor side"))
    rotor = arm.description.joints[0].drive.rotor_inertia
    assert rigid["ZZR1"].truth == pytest.approx(arm.base.values["ZZR1"] + rotor, rel=1e-12)
    still = robot.simulate(seed=1, duration=4.0).log
    held = symid.build_log(robot, time=still.time, q=still.q * [1.0, 0.0], tau=still.tau)
    partial = robot.identify(held, partial=True)
    assert partial.refused
    for fit in (rigid, partial):
        with raises(symid.UsageError, "usage.no-vector"):
            _ = fit.beta
