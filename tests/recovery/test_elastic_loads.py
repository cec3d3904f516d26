"""Elastic joints whose friction grows with the load: torques of a pendulum on a spring, in closed form.

tau_J = I q'' + g MX sin q,    theta = q + tau_J / K,    tau = J theta'' + tau_J + friction(theta', tau_J)
"""

import numpy as np
import pytest

import symid
from symid.errors import UsageError
from tests.recovery.elastic_runs import identify_by
from tests.refusals import raises

INERTIA, MOMENT, ROTOR, STIFFNESS, GRAVITY = 0.6, 1.4, 0.25, 900.0, 9.81
FRICTION = {"Fv": 0.8, "Fc": 0.5, "Fl": 0.12}
TRUTH = {"ZZ1": INERTIA, "MX1": MOMENT, "MY1": 0.0, "IA1": ROTOR}
TRUTH |= {f"{name}1": value for name, value in FRICTION.items()}
ROBOT = """
name = "pendulum"
convention = "modified"
gravity = [9.81, 0, 0]
[[joint]]
name = "arm"
kind = "revolute"
drive = { rotor_inertia = "unknown" }
elasticity = { stiffness = "unknown" }
friction = { model = "load-dependent" }
"""
RATE, DURATION = 1000.0, 24.0
WAVES = ((0.9, 0.13, 0.3), (0.35, 0.41, 1.1), (0.12, 0.97, 2.0), (0.05, 1.7, 0.4))


def list_derivatives(time, phase):
    """Return q and its first four derivatives (N,), of a sum of sines."""
    found = np.zeros((5, len(time)))
    for size, rate, start in WAVES:
        w = 2.0 * np.pi * rate
        for order in range(5):
            found[order] += size * w**order * np.sin(w * time + start + phase + order * np.pi / 2.0)
    return found


def compute_states(time, phase):
    """Return q, theta, the torques of spring and motor (N,)."""
    q, dq, ddq, jerk, snap = list_derivatives(time, phase)
    pull, sin, cos = MOMENT * GRAVITY, np.sin(q), np.cos(q)
    torque = INERTIA * ddq + pull * sin
    slope, bend = INERTIA * jerk + pull * cos * dq, INERTIA * snap + pull * (cos * ddq - sin * dq**2)
    theta, speed, spin = (a + b / STIFFNESS for a, b in ((q, torque), (dq, slope), (ddq, bend)))
    dry = FRICTION["Fc"] + FRICTION["Fl"] * np.abs(torque)
    return q, theta, torque, ROTOR * spin + torque + FRICTION["Fv"] * speed + dry * np.sign(speed)


def record(phase, noise=0.0, *, load=False):
    """Return the channels of a log: links, motors, torques of motors, and the load if asked for."""
    rng = np.random.default_rng(7)
    time = np.arange(round(DURATION * RATE)) / RATE
    q, theta, torque, _ = compute_states(time, phase)
    # A torque that is held acts until the next sample: its mean is that in the middle.
    tau = compute_states(time + 0.5 / RATE, phase)[3] + noise * rng.normal(size=len(time))
    channels = {"q": q, "theta": theta, "tau": tau} | ({"load": torque} if load else {})
    return {"time": time} | {name: values[:, None] for name, values in channels.items()}


LINEAR = symid.IdentifyOptions(threshold_count=0, knee_count=0)


@pytest.fixture(scope="module")
def robot(load_text):
    return load_text(ROBOT, "pendulum")


@pytest.fixture(scope="module")
def logs(robot):
    """Return a log without and one with the measured load."""
    return [symid.build_log(robot, **record(0.0, noise=0.01, load=load)) for load in (False, True)]


@pytest.mark.parametrize("load", [False, True])
@pytest.mark.parametrize("method", ["automatic", "weighted", "nlp"])
def test_friction_of_the_load_is_found_beside_a_spring(robot, logs, method, load):
    fit = identify_by(robot, logs[load], method, options=LINEAR)
    for name, value in TRUTH.items():
        assert fit[name].value == pytest.approx(value, rel=0.02, abs=0.01), name
    assert fit.estimate.springs[0].elasticity.stiffness == pytest.approx(STIFFNESS, rel=0.01)


def test_another_log_is_predicted_with_its_own_load(robot, logs, tmp_path):
    fit = identify_by(robot, logs[False], "weighted", options=LINEAR)
    again = symid.load_fit(fit.save(tmp_path / "fit.json"), robot)
    for load in (False, True):
        found = again.validate(symid.build_log(robot, **record(0.9, noise=0.01, load=load)))
        (residual,) = found.to_dict()["residual"]
        assert residual["relative_percent"] < 0.4


def test_an_offset_of_the_links_encoder_is_found_in_spite_of_the_load(robot):
    channels = record(0.0, noise=0.01)
    channels["q"] = channels["q"] + 0.004
    fit = identify_by(robot, symid.build_log(robot, **channels), "weighted", options=LINEAR)
    assert abs(fit.alignment.offsets[0, 0]) == pytest.approx(0.004, rel=0.05)
    for name in ("ZZ1", "MX1", "Fl1"):
        assert fit[name].value == pytest.approx(TRUTH[name], rel=0.02), name


def test_the_stiffness_alone_is_that_of_the_spring(robot, logs):
    (entry,) = robot.identify_stiffness(logs[False]).estimate.joints
    assert entry.stiffness == pytest.approx(STIFFNESS, rel=0.05)


def test_laws_of_the_temperature_need_one(load_text):
    warm = load_text(ROBOT.replace("load-dependent", "temperature"), "warm")
    channels = record(0.0, noise=0.01)
    with raises(UsageError, "friction.input", match="depends on the temperature"):
        warm.identify(symid.build_log(warm, **channels), options=LINEAR)
    rise = np.linspace(20.0, 50.0, len(channels["time"]))[:, None]
    log = symid.build_log(warm, **channels, temperature=rise)
    assert "Fct1" in {entry.name for entry in warm.identify(log, options=LINEAR).parameters}
