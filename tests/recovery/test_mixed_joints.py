"""An arm with an elastic and a rigid joint, written out; a link's encoder that is not centred."""

import numpy as np
import pytest

import symid
from symid.errors import UsageError
from symid.joint_models import run_element
from tests.recovery.elastic_runs import identify_by
from tests.recovery.written_out_arm import TRUTH, build, compute_spring_torque, simulate

TOLD = ("ZZR1", "MXR1", "ZZ2", "MX2", "IA1", "IA2")


@pytest.fixture(scope="module")
def motion():
    return simulate(20.0, 5)


@pytest.fixture(scope="module")
def log(mixed, motion):
    return build(mixed, motion)


@pytest.fixture(scope="module")
def fit(mixed, log):
    return mixed.identify(log)


def test_the_plant_keeps_its_energy_balance_when_its_step_is_halved(motion):
    """The integrator is exact where it matters: half the step moves nothing by an encoder's count."""
    time, motor, link, _ = simulate(1.0, 5, steps=16)
    np.testing.assert_allclose(motor, motion[1][: len(time)], atol=2e-5)
    np.testing.assert_allclose(link, motion[2][: len(time)], atol=2e-5)


def test_dynamics_and_the_one_spring_are_found(fit, mixed, motion):
    assert [entry.name for entry in fit.estimate.parameters] == [*TRUTH]
    for entry in fit.estimate.parameters:
        away = abs(entry.value - TRUTH[entry.name])
        assert away <= 3.0 * entry.std, entry
        if entry.name in TOLD:
            assert away <= 0.02 * abs(TRUTH[entry.name]), entry
    (spring,) = fit.springs
    assert (spring.joint, spring.identifiable) == ("shoulder", True)
    assert not fit.estimate.refused or {name for name, _ in fit.estimate.refused} <= {"MY1", "MY2"}
    assert fit.verdict.level == "good"
    time, motor, link, _ = motion
    phi, true = compute_spring_torque(motor, link)
    left = run_element(spring.elasticity, phi, time).output - true
    assert np.sqrt(np.mean(left**2) / np.mean(true**2)) < 0.02
    with pytest.raises(UsageError, match="expected one of 'automatic', 'two-step', 'nlp'"):
        mixed.identify(build(mixed, motion), method="independent")


@pytest.mark.parametrize("method", ["linear-spring", "two-step", "elimination", "weighted", "nlp"])
def test_every_method_takes_rigid_joints(mixed, log, method):
    found = identify_by(mixed, log, method)
    worst = max(abs(found[name].value / TRUTH[name] - 1.0) for name in TOLD)
    assert worst < {"linear-spring": 0.15, "two-step": 0.15}.get(method, 0.03)
    assert [spring.joint for spring in found.springs] == ["shoulder"]


def test_a_rigid_joint_with_two_encoders_has_one_position(mixed, motion, log):
    time, motor, link, torque = motion
    apart = motor + np.array([0.0, 3e-3])
    found = identify_by(mixed, build(mixed, (time, apart, link, torque)), "weighted")
    plain = identify_by(mixed, log, "weighted")
    assert found.values == plain.values
    (notice,) = (entry for entry in found.notices if entry.code == "log.rigid-joint")
    assert "0.003 rad in the mean" in notice.text
    # A channel without an encoder is not used, and its zeros are no news.
    dead = link * np.array([1.0, 0.0])
    other = identify_by(mixed, build(mixed, (time, motor, dead, torque)), "weighted")
    assert other.values == plain.values
    for entry in (plain, other):
        codes = {notice.code for notice in entry.notices}
        assert not codes & {"log.rigid-joint", "log.constant-position", "log.no-second-encoder"}


def test_a_coupled_drive_of_rigid_joints_is_no_obstacle(load_text):
    """Two rigid joints turn a drive together, a third joint is elastic: no parameter lacks a load."""
    joint = """[[joint]]
name = "{0}"
kind = "revolute"
a = 0.3
link = {{ mass = 2.0, com = [0.15, 0, 0], inertia = {{ xx = 0.01, yy = 0.05, zz = 0.05 }} }}
drive = {{ rotor_inertia = 0.1, rotor_inertia_side = "joint" }}
friction = {{ model = "coulomb-viscous", Fv = 0.4, Fc = 0.5, smoothing = 0.01 }}
"""
    text = 'name = "wrist"\nconvention = "modified"\ngravity = [9.81, 0, 0]\n'
    text += "".join(joint.format(name) for name in "abc")
    text += "[joint.elasticity]\nstiffness = 600\n"
    text += '[[coupling]]\nname = "m"\nterms = { a = 1, b = -1 }\nrotor_inertia = 0.05\n'
    robot = load_text(text, "wrist")
    rng, time = np.random.default_rng(3), np.arange(8000) * 1e-3
    w = 2.0 * np.pi * rng.uniform(0.2, 1.2, (3, 4))
    angle = w * time[:, None, None] + rng.uniform(0.0, 6.0, (3, 4))
    q, dq = 0.3 * np.sin(angle).sum(axis=2), 0.3 * (w * np.cos(angle)).sum(axis=2)
    ddq = -0.3 * (w**2 * np.sin(angle)).sum(axis=2)
    library = robot.library
    beta = np.array([entry.value for entry in library.card.beta])
    (torque,) = library.evaluate("inverse_dynamics", q, dq, ddq, beta)
    theta = q + torque / 600.0 * np.array([0.0, 0.0, 1.0])
    dtheta = np.gradient(theta, 1e-3, axis=0)
    torque = torque + np.array([0.0, 0.0, 0.1]) * np.gradient(dtheta, 1e-3, axis=0)
    log = symid.build_log(robot, time=time, q=q, theta=theta, tau=torque)
    fit = identify_by(robot, log, "weighted")
    assert fit["IA3"].value == pytest.approx(0.1, rel=0.05)
    # A drive that turns with the elastic joint is described by no method for springs.
    other = load_text(text.replace("{ a = 1, b = -1 }", "{ b = 1, c = -1 }"), "bound")
    with pytest.raises(UsageError, match="turn with elastic joints"):
        other.identify(log, method="nlp")
    texts = "".join(notice.text for notice in other.identify(log).notices)
    assert "coupled drives turn with elastic joints" in texts


def test_it_is_saved_validated_reported_and_exported(fit, mixed, motion, tmp_path):
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), mixed)
    assert again.values == fit.values
    trial = again.validate(build(mixed, simulate(6.0, 9)))
    assert [joint.joint for joint in trial.product.trial.joints] == ["shoulder"]
    assert [entry.joint for entry in trial.product.trial.residuals[0][1]] == ["shoulder", "elbow"]
    assert trial.verdict.level == "good"
    fit.report(tmp_path / "fit.html")
    exported = symid.load(fit.export(tmp_path / "found.toml").file)
    assert [joint.elasticity is None for joint in exported.description.joints] == [False, True]
    for name, value in exported.base.values.items():
        assert value == pytest.approx(fit.values[name], rel=1e-6, abs=1e-6)
    # Closed loops are simulated with springs in all joints.
    found = identify_by(exported, build(exported, motion), "weighted")
    with pytest.raises(UsageError, match="are elbow"):
        found.track(build(exported, motion))


OFF = 1.2e-3
"""Rad: the encoder reads q + OFF sin q, a twentieth of the torsion's range."""


@pytest.fixture(scope="module")
def eccentric(mixed, motion):
    time, motor, link, torque = motion
    wrong = link.copy()
    wrong[:, 0] += OFF * np.sin(link[:, 0])
    return mixed.identify(build(mixed, (time, motor, wrong, torque)))


def find_eccentricity(estimate):
    return [effect for effect in estimate.effects if effect.kind == "link-eccentricity"]


def test_an_eccentric_encoder_is_found_and_taken_off(eccentric, motion):
    (effect,) = find_eccentricity(eccentric.estimate)
    assert effect.joint == 0
    assert effect.values[1] == pytest.approx(OFF, rel=0.05)
    off = np.abs(np.subtract(effect.values, (0.0, OFF)))
    assert np.all(off < 4.0 * np.array(effect.deviations))
    for entry in eccentric.estimate.parameters:
        assert abs(entry.value - TRUTH[entry.name]) <= 4.0 * entry.std, entry
    assert eccentric.verdict.level == "good"
    (row,) = (entry for entry in eccentric.to_dict()["effects"] if entry["kind"] == "link-eccentricity")
    assert (row["joint"], row["unit"], row["order"]) == ("shoulder", "rad", 1.0)
    # The spring is that of the true torsion.
    time, motor, link, _ = motion
    phi, true = compute_spring_torque(motor, link)
    left = run_element(eccentric.springs[0].elasticity, phi, time).output - true
    assert np.std(left) < 0.02 * np.sqrt(np.mean(true**2))


@pytest.mark.parametrize("zero", [0.0, 0.3])
def test_no_eccentricity_is_found_where_there_is_none(mixed, motion, zero):
    """Gravity of a link that is turned, its zero not known, is a wave of one turn, too."""
    time, motor, link, torque = motion
    turned = link + np.array([zero, 0.0])
    assert not find_eccentricity(
        identify_by(mixed, build(mixed, (time, motor, turned, torque)), "weighted").estimate
    )
