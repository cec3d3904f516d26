"""Friction from motor torques and measured loads: right although the model of the links is wrong."""

import re
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
from tests.recovery.flexible_arm import FRICTION, ROBOT, ROTORS, find_friction, find_plain_friction, record
from tests.refusals import raises, tell

SLOW = {"processing.standstill": 0.01}
CUT = Processing(drop_first=50, drop_last=50)


@pytest.fixture(scope="module")
def robot(load_text):
    return load_text(ROBOT, "two_link")


def wrap(robot, recording):
    return Log(recording=recording, robot=robot.description)


def identify_all(robot, recordings, **options):
    return robot.identify([wrap(robot, one) for one in recordings], friction="auto", **options)


@pytest.fixture(scope="module")
def recordings():
    return [record(seed, duration=40.0) for seed in (0, 1)]


@pytest.fixture(scope="module")
def logs(robot, recordings):
    return [wrap(robot, one) for one in recordings]


@pytest.fixture(scope="module")
def blind(robot, recordings):
    """Return a fit without the sensors of loads."""
    return identify_all(robot, [replace(recordings[0], load=None)])


@pytest.fixture(scope="module")
def fit(robot, logs):
    return robot.identify_friction(logs[0], settings=SLOW)


def test_friction_is_right_although_the_links_carry_what_no_model_has(robot, logs, fit):
    shoulder, elbow = fit.joints["shoulder"], fit.joints["elbow"]
    assert "stribeck" in shoulder.estimate.law
    assert elbow.estimate.law == "load-dependent+offset"
    viscous, dry, more, slow = FRICTION["first"]
    first = {"fV": viscous, "fC": dry, "fS": dry + more, "vs": slow, "IA": ROTORS[0]}
    viscous, dry, part = FRICTION["second"]
    second = {"fV": viscous, "fC": dry, "fL": part, "IA": ROTORS[1]}
    for joint, truth in ((shoulder, first), (elbow, second)):
        for name, value in truth.items():
            assert joint.estimate.get_value(name) == pytest.approx(value, rel=0.04), name
    assert "measured load was subtracted" in shoulder.rigid
    assert "factor on the load would be" in shoulder.rigid
    assert "friction.load-gain" not in tell(fit.notices)
    dq = np.array([[0.3, -0.2], [-0.1, 0.4]])
    assert np.all(find_friction(dq, np.ones((2, 2))) * dq > 0.0)
    # Without the sensors the payload goes into friction.
    bare = wrap(robot, replace(logs[0].recording, load=None))
    blind = robot.identify_friction(bare, model="load-dependent+offset", settings=SLOW).joints["elbow"]
    assert abs(blind.estimate.get_value("fC") / dry - 1.0) > 0.2


def test_another_log_is_foretold_by_its_own_loads(robot, logs, fit, tmp_path):
    said = str(fit.export(tmp_path / "arm.toml")).splitlines()
    assert {f"{name}: {joint.estimate.law}" for name, joint in fit.joints.items()} <= set(said)
    path = fit.save(tmp_path / "friction.json")
    again = symid.load_fit(path, robot)
    assert [one.estimate for one in again.joints.values()] == [one.estimate for one in fit.joints.values()]
    found = again.validate(logs[1])
    assert found.verdict.level in {"good", "usable"}
    bare = wrap(robot, replace(logs[1].recording, load=None))
    with raises(LogError, "validate.friction-load", match=r"\[log\.load\]"):
        again.validate(bare)
    dead = logs[1].recording.load * [1.0, 0.0]
    with raises(LogError, "validate.friction-load", match="has a constant one for elbow"):
        again.validate(wrap(robot, replace(logs[1].recording, load=dead)))


def test_a_sensor_with_another_gain_is_named(robot):
    weak = record(0, duration=40.0, gain=1.06, friction=find_plain_friction)
    alone = robot.identify_friction(wrap(robot, weak), model="coulomb-viscous", settings=SLOW)
    for fit in (alone, identify_all(robot, [weak])):
        first, second = (notice.text for notice in fit.notices if notice.code == "friction.load-gain")
        assert first.startswith("joint 'shoulder': 1.06 +- ")
        # The laws take a part of the difference; the factor is right within its deviation, a small one.
        value, deviation = re.match(r"joint 'elbow': ([0-9.]+) \+- ([0-9.]+)", second).groups()
        assert abs(float(value) - 1.06) < 3.0 * float(deviation)
        assert float(deviation) < 1e-3 or fit is alone


def test_an_offset_of_a_sensor_is_an_offset_of_friction(robot):
    shifted = record(0, duration=40.0, offset=-0.8)
    fit = robot.identify_friction(wrap(robot, shifted), model="load-dependent+offset", settings=SLOW)
    elbow = fit.joints["elbow"].estimate
    assert elbow.get_value("offset") == pytest.approx(0.8, abs=0.02)
    assert elbow.get_value("fC") == pytest.approx(FRICTION["second"][1], rel=0.2)
    whole = identify_all(robot, [shifted])
    assert [law.law for law in whole.estimate.laws] == ["stribeck+offset", "load-dependent+offset"]
    assert not tell(whole.notices).keys() & {"friction.load-gain", "identify.load-friction"}


def test_given_base_parameters_go_before_measured_loads(robot, logs):
    known = robot.identify(logs[0])
    fit = robot.identify_friction(logs[0], model="coulomb-viscous", known=known)
    assert "base parameters given" in fit.joints["elbow"].rigid
    assert "friction.load-unused" in tell(fit.notices)


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
    folded = fold_recording(recording, 2.0, margin=0)
    assert folded.load.shape == folded.position.shape == folded.temperature.shape
    assert np.abs(folded.load - folded.torque).max() < 1e-12


COUPLED = """
[[coupling]]
name = "m3"
terms = { shoulder = 1, elbow = 1 }
rotor_inertia = "unknown"
friction = { model = "coulomb-viscous" }
"""


@pytest.fixture(scope="module")
def coupled(load_text, recordings):
    """Return the arm with a drive that both joints turn, and a log with its torque."""
    recording = recordings[0]
    turn = np.gradient(recording.position, recording.time, axis=0).sum(axis=1)
    shared = 0.3 * np.gradient(turn, recording.time) + 0.5 * np.sign(turn) + 0.2 * turn
    return load_text(ROBOT + COUPLED, "coupled"), replace(
        recording, torque=recording.torque + shared[:, None]
    )


def test_the_rotor_of_a_coupled_drive_is_fitted_along(coupled):
    robot, recording = coupled
    fit = robot.identify_friction(wrap(robot, recording), model="load-dependent+offset", settings=SLOW)
    elbow = fit.joints["elbow"].estimate
    for name, value in {"IAm3": 0.3, "IA": ROTORS[1], "fL": FRICTION["second"][2]}.items():
        assert elbow.get_value(name) == pytest.approx(value, rel=0.1), name
    assert fit.validate(wrap(robot, recording)).verdict.level in {"good", "usable", "doubtful"}


def test_a_coupled_drive_stands_beside_laws_of_the_whole_robot(coupled):
    robot, recording = coupled
    rotors = list_coupled_rotors(robot.description)
    found = choose_laws(robot.library, [recording], CUT, gears=(1, 1), rotors=rotors)
    assert [law.friction.law for law in found.joints] == ["stribeck", "load-dependent"]
    np.testing.assert_allclose(found.joints[1].friction.values, FRICTION["second"], rtol=0.1)
    fit = robot.identify(wrap(robot, recording), friction="auto")
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    assert "identify.measured-load" in tell(fit.notices)


def test_friction_needs_no_reversed_inertia(robot):
    wrong = record(2, duration=40.0, friction=find_plain_friction)
    ddq = np.gradient(np.gradient(wrong.position, wrong.time, axis=0), wrong.time, axis=0)
    wrong = replace(wrong, load=wrong.load + 3.0 * ROTORS * ddq)
    fit = robot.identify_friction(wrap(robot, wrong), model="coulomb-viscous", settings=SLOW)
    assert "friction.negative-inertia" in tell(fit.notices)


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
    with raises(symid.IdentifiabilityError, "friction.no-temperature"):
        check_inputs(samples, get_law("temperature"))


def test_laws_of_the_whole_robot_are_chosen_on_the_motor_side(robot, recordings, blind):
    fit = identify_all(robot, recordings[:1])
    assert [law.law for law in fit.estimate.laws] == ["stribeck", "load-dependent"]
    texts = [notice.text for notice in fit.notices if notice.code == "identify.measured-load"]
    assert len(texts) == 1
    assert texts[0].startswith("joints 'shoulder', 'elbow': friction laws were chosen")
    assert "the motor's torque less the load" in fit.estimate.laws[0].selection.verdict
    assert not tell(fit.notices).keys() & {"friction.load-gain", "identify.load-friction"}
    # The payload on its spring hides the laws from a model of the links.
    assert [law.law for law in blind.estimate.laws] != ["stribeck", "load-dependent"]
    assert "identify.measured-load" not in tell(blind.notices)


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
    codes, match = ["identify.friction-input"] * 2, r"reads the temperature.*\[log\.temperature\]"
    with raises(symid.IdentifiabilityError, *codes, match=match):
        robot.identify(wrap(robot, recordings[0]), friction="shoulder=temperature,elbow=temperature")


def test_a_joint_without_a_sensor_gets_a_load_from_the_model(robot, recordings, blind):
    load = recordings[0].load.copy()
    load[:, 1] = 0.0
    fit = identify_all(robot, [replace(recordings[0], load=load)])
    texts = [notice.text for notice in fit.notices if notice.code == "identify.measured-load"]
    assert texts[0].startswith("joint 'shoulder': friction laws")
    shoulder, elbow = fit.estimate.laws
    assert shoulder.law == "stribeck"
    assert elbow.law == blind.estimate.laws[1].law
    assert fit["Fl2"].value == pytest.approx(blind["Fl2"].value, rel=0.3)
