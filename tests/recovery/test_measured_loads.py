"""Friction from motor torques and measured loads: right although the model of the links is wrong."""

from dataclasses import replace

import numpy as np
import pytest

import symid
from symid.api.log import Log
from symid.errors import LogError
from symid.identification.friction.extraction import extract_joint, fold_recording, prepare_joint_logs
from symid.identification.friction.identify import check_inputs
from symid.identification.regression import list_coupled_rotors
from symid.identification.rigid.friction_choice import choose_laws
from symid.joint_models import get_law
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery.flexible_arm import FRICTION, ROBOT, ROTORS, find_friction, record

SLOW = {"processing.standstill": 0.01}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "two_link.toml"
    path.write_text(ROBOT)
    return symid.load(path)


@pytest.fixture(scope="module")
def recordings():
    return [record(seed, duration=40.0) for seed in (0, 1)]


@pytest.fixture(scope="module")
def logs(robot, recordings):
    return [Log(recording=one, robot=robot.description) for one in recordings]


@pytest.fixture(scope="module")
def fit(robot, logs):
    return robot.identify_friction(logs[0], settings=SLOW)


def wrap(robot, recording):
    return Log(recording=recording, robot=robot.description)


def codes(fit):
    return {notice.code for notice in fit.notices}


def test_friction_is_right_although_the_links_carry_what_no_model_has(robot, logs, fit):
    shoulder, elbow = fit.joints["shoulder"], fit.joints["elbow"]
    assert "stribeck" in shoulder.estimate.law
    assert elbow.estimate.law == "load-dependent+offset"
    viscous, dry, more, slow = FRICTION["first"]
    truth = {"fV": viscous, "fC": dry, "fS": dry + more, "vs": slow, "IA": ROTORS[0]}
    for name, value in truth.items():
        assert shoulder.estimate.get_value(name) == pytest.approx(value, rel=0.04), name
    viscous, dry, part = FRICTION["second"]
    for name, value in {"fV": viscous, "fC": dry, "fL": part, "IA": ROTORS[1]}.items():
        assert elbow.estimate.get_value(name) == pytest.approx(value, rel=0.04), name
    assert "measured load was subtracted" in shoulder.rigid
    assert "factor on the load would be" in shoulder.rigid
    assert "friction.load-gain" not in codes(fit)
    # Without the sensors the payload goes into friction.
    bare = wrap(robot, replace(logs[0].recording, load=None))
    blind = robot.identify_friction(bare, model="load-dependent+offset", settings=SLOW).joints["elbow"]
    assert abs(blind.estimate.get_value("fC") / dry - 1.0) > 0.2


def test_another_log_is_foretold_by_its_own_loads(robot, logs, fit, tmp_path):
    path = fit.save(tmp_path / "friction.json")
    again = symid.load_fit(path, robot)
    assert [one.estimate for one in again.joints.values()] == [one.estimate for one in fit.joints.values()]
    found = again.validate(logs[1])
    assert found.verdict.level in {"good", "usable"}
    bare = wrap(robot, replace(logs[1].recording, load=None))
    with pytest.raises(LogError, match=r"\[log\.load\]") as caught:
        again.validate(bare)
    assert caught.value.notices[0].code == "validate.friction-load"
    dead = logs[1].recording.load * [1.0, 0.0]
    with pytest.raises(LogError, match="has a constant one for elbow") as caught:
        again.validate(wrap(robot, replace(logs[1].recording, load=dead)))
    assert caught.value.notices[0].code == "validate.friction-load"


def test_an_export_names_each_law_once(fit, tmp_path):
    said = str(fit.export(tmp_path / "arm.toml")).splitlines()
    for joint in ("shoulder", "elbow"):
        assert f"{joint}: {fit.joints[joint].estimate.law}" in said


def test_a_sensor_with_another_gain_is_named(robot):
    weak = wrap(robot, record(0, duration=40.0, gain=1.06, friction=plain))
    fit = robot.identify_friction(weak, model="coulomb-viscous", settings=SLOW)
    texts = [notice.text for notice in fit.notices if notice.code == "friction.load-gain"]
    assert len(texts) == 2
    assert texts[0].startswith("joint 'shoulder': 1.06 +- ")


def test_an_offset_of_a_sensor_is_an_offset_of_friction(robot):
    shifted = wrap(robot, record(0, duration=40.0, offset=-0.8))
    fit = robot.identify_friction(shifted, model="load-dependent+offset", settings=SLOW)
    elbow = fit.joints["elbow"].estimate
    assert elbow.get_value("offset") == pytest.approx(0.8, abs=0.02)
    assert elbow.get_value("fC") == pytest.approx(FRICTION["second"][1], rel=0.2)


def test_given_base_parameters_go_before_measured_loads(robot, logs):
    known = robot.identify(logs[0])
    fit = robot.identify_friction(logs[0], model="coulomb-viscous", known=known)
    assert "base parameters given" in fit.joints["elbow"].rigid
    assert "friction.load-unused" in codes(fit)


def test_a_channel_that_never_changes_is_no_sensor(robot, recordings):
    load = recordings[0].load.copy()
    load[:, 0] = 0.0
    fit = robot.identify_friction(
        wrap(robot, replace(recordings[0], load=load)), model="load-dependent+offset", settings=SLOW
    )
    assert "measured load" not in fit.joints["shoulder"].rigid
    assert "measured load" in fit.joints["elbow"].rigid
    assert fit.joints["elbow"].estimate.get_value("fL") == pytest.approx(FRICTION["second"][2], rel=0.04)


def test_periods_of_loads_are_averaged_too():
    time = np.arange(4000) * 2e-3
    angle = 0.4 * np.sin(np.pi * time)[:, None]
    load = 5.0 * np.sin(np.pi * time + 0.2)[:, None]
    warm = np.full_like(angle, 30.0)
    recording = Recording(time=time, position=angle, torque=load, load=load, temperature=warm)
    folded = fold_recording(recording, 2.0)
    assert folded.load.shape == folded.position.shape == folded.temperature.shape
    assert np.abs(folded.load - folded.torque).max() < 1e-12


COUPLED = (
    ROBOT
    + """
[[coupling]]
name = "m3"
terms = { shoulder = 1, elbow = 1 }
rotor_inertia = "unknown"
friction = { model = "coulomb-viscous" }
"""
)


def test_the_rotor_of_a_coupled_drive_is_fitted_along(tmp_path, recordings):
    path = tmp_path / "coupled.toml"
    path.write_text(COUPLED)
    robot = symid.load(path)
    recording = recordings[0]
    q = recording.position
    dq = np.gradient(q, recording.time, axis=0)
    turn = dq.sum(axis=1)
    shared = 0.3 * np.gradient(turn, recording.time) + 0.5 * np.sign(turn) + 0.2 * turn
    recording = replace(recording, torque=recording.torque + shared[:, None])
    fit = robot.identify_friction(wrap(robot, recording), model="load-dependent+offset", settings=SLOW)
    elbow = fit.joints["elbow"].estimate
    assert elbow.get_value("IAm3") == pytest.approx(0.3, rel=0.1)
    assert elbow.get_value("IA") == pytest.approx(ROTORS[1], rel=0.1)
    assert elbow.get_value("fL") == pytest.approx(FRICTION["second"][2], rel=0.1)
    found = fit.validate(wrap(robot, recording))
    assert found.verdict.level in {"good", "usable", "doubtful"}


def test_a_coupled_drive_stands_beside_laws_of_the_whole_robot(tmp_path, recordings):
    path = tmp_path / "coupled.toml"
    path.write_text(COUPLED)
    coupled = symid.load(path)
    recording = recordings[0]
    turn = np.gradient(recording.position, recording.time, axis=0).sum(axis=1)
    shared = 0.3 * np.gradient(turn, recording.time) + 0.5 * np.sign(turn) + 0.2 * turn
    recording = replace(recording, torque=recording.torque + shared[:, None])
    rotors = list_coupled_rotors(coupled.description)
    found = choose_laws(
        coupled.library, [recording], Processing(drop_first=50, drop_last=50), gears=(1, 1), rotors=rotors
    )
    assert [law.friction.law for law in found.joints] == ["stribeck", "load-dependent"]
    np.testing.assert_allclose(found.joints[1].friction.values, FRICTION["second"], rtol=0.1)
    fit = coupled.identify(wrap(coupled, recording), friction="auto")
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    assert "identify.measured-load" in codes(fit)


def plain(dq, _load):
    return np.array([1.5, 0.7]) * dq + np.array([1.8, 0.4]) * np.sign(dq)


def test_friction_needs_no_reversed_inertia(robot):
    wrong = record(2, duration=40.0, friction=plain)
    ddq = np.gradient(np.gradient(wrong.position, wrong.time, axis=0), wrong.time, axis=0)
    wrong = replace(wrong, load=wrong.load + 3.0 * ROTORS * ddq)
    fit = robot.identify_friction(wrap(robot, wrong), model="coulomb-viscous", settings=SLOW)
    assert "friction.negative-inertia" in codes(fit)


def test_a_temperature_must_be_in_the_log_for_a_law_of_it(robot, recordings):
    warm = np.linspace(20.0, 60.0, len(recordings[0].time))[:, None] * np.ones(2)
    extra = -0.01 * (warm - 40.0) * np.sign(np.gradient(recordings[0].position, axis=0))
    recording = replace(recordings[0], temperature=warm, torque=recordings[0].torque + extra)
    fit = robot.identify_friction(wrap(robot, recording), model="temperature", settings=SLOW)
    elbow = {entry.name: entry.value for entry in fit.joints["elbow"].estimate.parameters}
    assert elbow["fCT"] == pytest.approx(-0.01, rel=0.1)
    with pytest.raises(symid.IdentifiabilityError, match=r"\[log\.temperature\]"):
        robot.identify_friction(wrap(robot, recordings[0]), model="temperature", settings=SLOW)
    samples = extract_joint(prepare_joint_logs(robot.library, recordings, Processing()), 0).samples
    with pytest.raises(symid.IdentifiabilityError) as caught:
        check_inputs(samples, get_law("temperature"))
    assert caught.value.notices[0].code == "friction.no-temperature"


def test_friction_of_this_arm_dissipates():
    dq = np.array([[0.3, -0.2], [-0.1, 0.4]])
    assert np.all(find_friction(dq, np.ones((2, 2))) * dq > 0.0)


def identify_all(robot, recordings, **options):
    return robot.identify([wrap(robot, one) for one in recordings], friction="auto", **options)


def test_laws_of_the_whole_robot_are_chosen_on_the_motor_side(robot, recordings):
    fit = identify_all(robot, recordings[:1])
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    texts = [notice.text for notice in fit.notices if notice.code == "identify.measured-load"]
    assert len(texts) == 1
    assert texts[0].startswith("joints 'shoulder', 'elbow': friction laws were chosen")
    assert "the motor's torque less the load" in fit.estimate.laws[0].selection.verdict
    assert codes(fit).isdisjoint({"friction.load-gain", "identify.load-friction"})
    # The payload on its spring hides the laws from a model of the links.
    blind = identify_all(robot, [replace(recordings[0], load=None)])
    assert [law.law for law in blind.estimate.laws] != ["stribeck", "load-dependent"]
    assert "identify.measured-load" not in codes(blind)


def test_values_of_the_motor_side_are_those_of_the_arm(robot, recordings):
    found = choose_laws(robot.library, recordings, Processing(drop_first=50, drop_last=50), gears=(1.0, 1.0))
    first, second = (law.friction for law in found.joints)
    viscous, dry, more, slow = FRICTION["first"]
    assert (first.law, second.law) == ("stribeck", "load-dependent")
    np.testing.assert_allclose((*first.values, *first.shape), (viscous, dry, more, slow), rtol=0.05)
    np.testing.assert_allclose(second.values, FRICTION["second"], rtol=0.05)


def test_a_gain_and_an_offset_of_sensors_are_named_where_laws_are_chosen(robot):
    weak = identify_all(robot, [record(0, duration=40.0, gain=1.06, friction=plain)])
    texts = [notice.text for notice in weak.notices if notice.code == "friction.load-gain"]
    assert [text[:31] for text in texts] == [
        "joint 'shoulder': 1.06 +- 0.000",
        "joint 'elbow': 1.06 +- 0.0003 t",
    ]
    shifted = identify_all(robot, [record(0, duration=40.0, offset=-0.8)])
    assert [law.law for law in shifted.estimate.laws] == ["stribeck+offset", "load-dependent+offset"]
    assert codes(shifted).isdisjoint({"friction.load-gain", "identify.load-friction"})


def test_drag_on_the_links_is_no_friction_of_the_motors(robot, recordings):
    recording = recordings[0]
    drag = 1.5 * np.gradient(recording.position, recording.time, axis=0)
    fit = identify_all(
        robot, [replace(recording, torque=recording.torque + drag, load=recording.load + drag)]
    )
    texts = [notice.text for notice in fit.notices if notice.code == "identify.load-friction"]
    assert texts
    assert all("--rows friction" in text for text in texts)


def test_a_law_needs_what_it_reads(robot, recordings):
    with pytest.raises(
        symid.IdentifiabilityError, match=r"reads the temperature.*\[log\.temperature\]"
    ) as caught:
        robot.identify(
            wrap(robot, recordings[0]), friction=dict.fromkeys(("shoulder", "elbow"), "temperature")
        )
    assert {notice.code for notice in caught.value.notices} == {"identify.friction-input"}
    assert len(caught.value.notices) == 2


def test_a_joint_without_a_sensor_gets_a_load_from_the_model(robot, recordings):
    load = recordings[0].load.copy()
    load[:, 1] = 0.0
    fit = identify_all(robot, [replace(recordings[0], load=load)])
    texts = [notice.text for notice in fit.notices if notice.code == "identify.measured-load"]
    assert texts[0].startswith("joint 'shoulder': friction laws")
    shoulder, elbow = fit.estimate.laws
    assert shoulder.law == "stribeck"
    blind = identify_all(robot, [replace(recordings[0], load=None)])
    assert elbow.law == blind.estimate.laws[1].law
    assert fit["Fl2"].value == pytest.approx(blind["Fl2"].value, rel=0.3)
