"""`symid.hysteresis`: a fit from arrays and from files, what it prints, and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

import symid
from symid import joint_models
from symid.cli.main import run
from symid.errors import EstimateError, LogError, UsageError
from symid.notation import HYSTERESIS_MODELS, UNITS
from tests.calls import call, say
from tests.elements import ELEMENTS
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
    # That of the certainty of the parameters stands beside them.
    assert text.count("<svg") - 1 == len(fit.plot()) == 7
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
    assert "Inverse: error " in str(tried)


def test_options_that_a_saved_fit_cannot_take(fit, tmp_path, capsys):
    path = str(fit.save(tmp_path / "fit.json"))
    assert run(["hysteresis", path, "--model", "dahl"]) == 2
    assert "this file is a fit" in capsys.readouterr().err
    (tmp_path / "other.csv").write_text("phi,tau\n0.0,0.0\n0.1,2.0\n", encoding="utf-8")
    assert run(["hysteresis", path, "--validate", str(tmp_path / "other.csv")]) == 2
    assert "--input: name its column; the file has phi, tau" in capsys.readouterr().err
    assert run(["hysteresis", str(tmp_path / "other.csv"), "--json"]) == 2
    assert "usage.columns" in capsys.readouterr().out
    assert run(["hysteresis", path, "-o", path]) == 3
    assert "would be overwritten" in capsys.readouterr().err


ARM = """# Comments stay.
name = "arm"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "shoulder"  # the first
kind = "revolute"
[joint.elasticity]
model = "dahl"
stiffness = 10.0
Fc = 1.0
sigma0 = 5.0

# This belongs to the elbow.
[[joint]]
name = "elbow"
kind = "prismatic"
elasticity = { stiffness = 3.0 }
limits = { velocity = 1.0 }

[log]
time = { column = "t", unit = "s" }
"""


@pytest.mark.parametrize("name", sorted(ELEMENTS))
@pytest.mark.parametrize(("joint", "units"), [("shoulder", ("deg", "N cm")), ("elbow", ("mm", "kN"))])
def test_an_element_goes_into_a_robot_file_in_its_units(fit, tmp_path, name, joint, units):
    file = tmp_path / "arm.toml"
    file.write_text(ARM, encoding="utf-8")
    found = replace(fit, record=replace(fit.record, elasticity=ELEMENTS[name], units=units))
    assert found.insert(file, joint) == file
    after = file.read_text(encoding="utf-8")
    kept = [line for line in ARM.splitlines() if line.startswith(("#", "name", "[[", "[log", "time"))]
    assert [line for line in after.splitlines() if line in kept] == kept
    robot = symid.load(file).description
    there = next(one for one in robot.joints if one.name == joint)
    # The same motion in either units.
    t = np.arange(400) / 100.0
    x = 0.4 * np.sin(3.0 * t) + 0.2 * np.sin(7.1 * t)
    scales = [UNITS[unit][1] for unit in units]
    wanted = joint_models.run_element(ELEMENTS[name], x, t).output
    run = joint_models.run_element(there.elasticity, scales[0] * x, t)
    np.testing.assert_allclose(run.output / scales[1], wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("where", "codes", "text"),
    [
        (("elbow", ("mm", "")), ["usage.element-unit"], "the output has no unit"),
        (
            ("shoulder", ("mm", "N")),
            ["usage.element-unit"] * 2,
            "'mm', and joint 'shoulder' needs a unit of angle",
        ),
        (("wrist", ("deg", "N m")), ["usage.element-joint"], "no joint 'wrist'; .*shoulder"),
    ],
)
def test_what_cannot_go_into_a_robot_file_is_refused(fit, tmp_path, where, codes, text):
    joint, units = where
    file = tmp_path / "arm.toml"
    file.write_text(ARM, encoding="utf-8")
    with raises(UsageError, *codes, match=text):
        fit.insert(file, joint, units=units)
    assert file.read_text(encoding="utf-8") == ARM


def test_a_joint_that_is_no_table_of_its_own_is_refused(fit, tmp_path):
    file = tmp_path / "arm.toml"
    text = 'name = "a"\nconvention = "modified"\ngravity = [0, 0, 0]\njoint = [{name="j",kind="revolute"}]\n'
    file.write_text(text, encoding="utf-8")
    with raises(UsageError, "usage.element-joint", match="no table"):
        fit.insert(file, "j", units=("rad", "N m"))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("k0", "N m/mrad"),
        ("kc", "N m/mrad^3"),
        ("D", "N m s/mrad"),
        ("r12", "mrad"),
        ("R1", "N m"),
        ("s1", ""),
        ("slip2_fall_low", "s/mrad"),
        ("relays_c3_1", "N m"),
        ("bouc_wen_skew", ""),
        ("bristles_sigma1", "N m s/mrad"),
        ("bristles_stiffness2", "N m/mrad"),
        ("bristles_vs", "mrad/s"),
        ("attracted_attraction", "1/s"),
        ("relaxation_time", "s"),
    ],
)
def test_values_have_the_units_of_input_and_output(name, unit):
    assert joint_models.write_value_unit(name, ("mrad", "N m")) == unit


def test_parts_are_fitted_and_tested(recording, tmp_path, capsys):
    t, x, y = recording
    model = "prandtl-ishlinskii"
    fit = symid.hysteresis.fit(x, y, t, model=model, train="0:60%")
    assert fit.record.samples == int(np.sum(t - t[0] < 0.6 * (t[-1] - t[0])))
    tried = fit.validate(x, y, t, test="60%:")
    assert fit.record.samples + tried.trial.samples == len(t)
    with raises(UsageError, "usage.log-part", match="state per cent"):
        symid.hysteresis.fit(x, y, train=(0.0, 3.0))
    rows = "\n".join(",".join(map(repr, row)) for row in np.column_stack([t, x, y]).tolist())
    (tmp_path / "damper.csv").write_text(f"t [s],stroke [mm],force [N]\n{rows}\n", encoding="utf-8")
    words = [
        "hysteresis",
        str(tmp_path / "damper.csv"),
        "--input",
        "stroke",
        "--output",
        "force",
        "--time",
        "t",
    ]
    words += ["--model", model, "--page", str(tmp_path / "damper.html")]
    assert run([*words, "--train", "0:60", "--test", "60%:"]) == 0
    printed = capsys.readouterr().out
    assert "N/mm" in printed
    assert f"{tried.trial.samples} samples" in printed
    page = (tmp_path / "damper.html").read_text(encoding="utf-8")
    assert "stroke (mm)" in page
    assert "force (N)" in page
    assert run([*words, "--force", "--train", "0:60%", "--test", "50%:"]) == 2
    assert "overlaps" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "rate"), [("ms", 1e3), ("us", 1e6), ("s", 1.0), ("msec", 1e3), ("min", 1 / 60)]
)
def test_times_of_a_file_are_read_in_seconds(recording, tmp_path, unit, rate):
    t, x, y = recording
    table = [f"time [{unit}];x [rad];y [N m]"]
    rows = zip((t * rate).tolist(), x.tolist(), y.tolist(), strict=True)
    table += [";".join(map(str, row)).replace(".", ",") for row in rows]
    path = tmp_path / "element.csv"
    path.write_text("\n".join(table), encoding="utf-8")
    columns = symid.hysteresis.read_columns(path, x="x", y="y", t="time")
    np.testing.assert_allclose(columns.t, t, rtol=1e-12)
    assert [notice.code for notice in columns.notices] == ["log.layout"]
    path.write_text("\n".join(table).replace(f"[{unit}]", "[rad]"), encoding="utf-8")
    with raises(LogError, "log.time-unit"):
        symid.hysteresis.read_columns(path, x="x", y="y", t="time")
    said = call("hysteresis", path, "--input", "x", "--output", "y", "--model", "dahl")[2]
    assert "semicolons between columns" in said
