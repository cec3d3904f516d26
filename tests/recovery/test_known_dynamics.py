"""Elastic joints whose dynamics are known, in part or all: from a robot with values, a fit, or by name."""

import re

import numpy as np
import pytest

import symid
from tests.recovery.elastic_runs import identify_by
from tests.recovery.written_out_arm import DYNAMICS, LINKS, TRUTH, build, simulate

FRICTION = ("Fv1", "Fc1", "Fv2", "Fc2")
DRAWING = """
name = "drawing"
convention = "modified"
gravity = [9.81, 0, 0]
[[joint]]
name = "shoulder"
kind = "revolute"
link = {{ mass = 4.0, com = [0.1375, 0, 0], inertia = {{ xx = 0.01, yy = 0.189375, zz = 0.189375 }} }}
{shoulder}
[[joint]]
name = "elbow"
kind = "revolute"
a = 0.3
link = {{ mass = {mass}, com = [0.2, 0, 0], inertia = {{ xx = 0.005, yy = 0.01, zz = 0.01 }} }}
{elbow}
"""
"""The plant's links as a drawing has them: ZZR1 = ZZ1 + l^2 M2 and MXR1 = MX1 + l M2, l = 0.3 m."""


def draw(folder, name="cad", *, rotors=(None, 0.06), mass=1.5):
    """Write the drawing, without friction and springs, with the rotors that are given."""
    drives = (f'drive = {{ rotor_inertia = {rotor}, rotor_inertia_side = "joint" }}' for rotor in rotors)
    given = (drive if rotor else "" for rotor, drive in zip(rotors, drives, strict=True))
    path = folder / f"{name}.toml"
    path.write_text(DRAWING.format(**dict(zip(("shoulder", "elbow"), given, strict=True)), mass=mass))
    return path


@pytest.fixture(scope="module")
def log(mixed):
    return build(mixed, simulate(12.0, 5))


@pytest.mark.parametrize(
    "method", ["automatic", "linear-spring", "two-step", "elimination", "weighted", "nlp"]
)
def test_what_is_known_stays_and_the_rest_is_found(mixed, log, folder, method):
    fit = identify_by(mixed, log, method, known=draw(folder))
    for name, value in LINKS.items():
        assert fit[name].value == pytest.approx(value, abs=1e-12)
        assert fit[name].std == 0.0
    assert fit["IA1"].value == pytest.approx(TRUTH["IA1"], rel=0.02 if method != "linear-spring" else 0.1)
    assert fit["IA1"].std > 0.0
    (notice,) = (entry for entry in fit.notices if entry.code == "elastic.known")
    assert notice.text.startswith("7 dynamic parameters were known and not identified: ZZR1, ")
    if method == "automatic":
        assert fit.verdict.level == "good"
        assert abs(fit["IA1"].value - TRUTH["IA1"]) <= 3.0 * fit["IA1"].std
        assert all(fit[name].value == pytest.approx(TRUTH[name], rel=0.02) for name in FRICTION)


def test_what_is_known_makes_the_rest_surer(mixed, log, folder):
    plain = identify_by(mixed, log, "weighted")
    fit = identify_by(mixed, log, "weighted", known=symid.load(draw(folder)))
    assert fit["IA1"].std < 0.5 * plain["IA1"].std
    again = identify_by(mixed, log, "weighted", known=plain)
    assert all(again[name].value == plain[name].value for name in DYNAMICS)
    saved = plain.save(folder / "plain.json")
    assert identify_by(mixed, log, "weighted", known=saved).values == again.values
    # Columns that are known stand for themselves, whatever the rest of the rows says.
    np.testing.assert_allclose(
        [again[name].value for name in FRICTION], [plain[name].value for name in FRICTION], rtol=1e-6
    )


def test_a_rotor_of_a_data_sheet_is_known_by_its_file_or_name(mixed, log, folder):
    path = draw(folder, "sheet", rotors=(0.2, 0.06))
    fit = identify_by(mixed, log, "weighted", known=path)
    assert (fit["IA1"].value, fit["IA1"].std) == (0.2, 0.0)
    named = identify_by(mixed, log, "weighted", known={"IA1": 0.2})
    assert (named["IA1"].value, named["IA1"].std) == (0.2, 0.0)
    assert named["ZZR1"].std > 0.0
    same = identify_by(mixed, log, "weighted", options=symid.IdentifyOptions(known={"IA1": 0.2}))
    assert same.values == named.values
    assert same.estimate.settings["known"] == {"IA1": 0.2}


def test_an_export_is_known_to_its_own_robot(mixed, log, folder):
    fit = identify_by(mixed, log, "weighted", known={"MX2": 0.3})
    path = fit.export(folder / "out.toml").file
    again = identify_by(mixed, log, "weighted", known=path)
    assert again["IA1"].std == 0.0
    # What was known moves least where bodies must be physical.
    assert symid.load(path).base.values["MX2"] == pytest.approx(0.3, rel=1e-6)


def test_values_that_the_logs_contradict_are_told_and_judged(mixed, log, folder):
    fit = mixed.identify(log, known=draw(folder, "heavy", mass=1.65))
    (notice,) = (entry for entry in fit.notices if entry.code == "elastic.known-contradicted")
    value, deviation = map(float, re.search(r"MX2 (\S+) \+- (\S+) kg m", notice.text).groups())
    assert value == pytest.approx(0.3, abs=3.0 * deviation)
    assert deviation < 1e-3
    assert fit.estimate.evidence.known > 5.0
    assert fit.verdict.level == "usable"
    assert "known parameters contradict the logs (one by 10 %)" in fit.verdict.headline
    # A combination of small errors is told by its farthest.
    right = mixed.identify(log, known=draw(folder))
    assert right.estimate.evidence.known < 1.0
    assert "elastic.known-contradicted" not in {entry.code for entry in right.notices}


def test_what_a_drawing_lacks_is_identified(mixed, log, folder):
    """A drawing has no rotors: what they are a part of stays open."""
    path = draw(folder, "links", rotors=(None, None))
    fit = identify_by(mixed, log, "weighted", known=path)
    assert fit["IA2"].std > 0.0
    assert fit["IA2"].value == pytest.approx(TRUTH["IA2"], rel=0.02)
    assert fit["ZZR1"].std == fit["ZZ2"].std == 0.0


def test_noise_that_is_not_white_is_no_contradiction(mixed, folder):
    time, motor, link, torque = simulate(12.0, 5)
    rng = np.random.default_rng(11)
    drift = np.zeros_like(torque)
    for k, draws in enumerate(rng.normal(size=torque.shape)[1:], start=1):
        drift[k] = 0.97 * drift[k - 1] + draws
    noisy = torque + 0.02 * np.std(torque, axis=0) * drift / np.std(drift, axis=0)
    fit = identify_by(mixed, build(mixed, (time, motor, link, noisy)), "weighted", known=draw(folder))
    assert fit.estimate.evidence.known < 1.0


@pytest.mark.parametrize(
    ("known", "text"),
    [
        ({"ZZR2": 1.0}, r"known 'ZZR2' is no parameter of 'mixed'; did you mean ZZR1"),
        ({"IA1": -0.1}, r"known IA1 -0.1: must not be negative"),
        ({"IA1": float("nan"), "ZZ2": float("inf")}, r"(?s)known IA1 nan: must be a finite.*known ZZ2 inf"),
        ({"IA1": "much"}, r"known IA1 'much': must be a finite number"),
    ],
)
def test_values_that_cannot_be_are_refused(mixed, log, known, text):
    with pytest.raises(symid.UsageError, match=text):
        identify_by(mixed, log, "weighted", known=known)


def test_what_is_no_model_of_this_robot_is_refused(mixed, log, folder):
    with pytest.raises(symid.EstimateError, match="the axis of joint 'elbow' stands elsewhere"):
        mixed.identify(log, known=symid.load("two_link"))
    rigid = symid.load("two_link")
    record = rigid.simulate(duration=5.0, seed=1).log
    fit = rigid.identify(record)
    with pytest.raises(symid.EstimateError, match="expected a fit of elastic joints"):
        mixed.identify(log, known=fit)
    with pytest.raises(symid.EstimateError, match="expected a fit of elastic joints, or a robot"):
        mixed.identify(log, known=fit.save(folder / "rigid.json"))
    text = r"--known cannot be used with 'two_link', identified as rigid"
    with pytest.raises(symid.UsageError, match=text):
        rigid.identify(record, known={"ZZ2": 0.1})
