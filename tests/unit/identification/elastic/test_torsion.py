"""Delay and zero of a link encoder whose joint gravity bends always alike, and what is said of it."""

import re

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.elastic.stiffness import (
    StiffnessVerdict,
    estimate_stiffness,
    estimate_torsion_alignment,
    prepare_aligned,
)
from symid.logs.recording import Recording
from symid.robot.toml_reader import read_robot

LIFT = """name = "lift"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "carriage"
kind = "prismatic"

[joint.drive]
rotor_inertia = 0.25
rotor_inertia_side = "joint"

[joint.friction]
model = "coulomb-viscous"

[joint.elasticity]
stiffness = 4000
"""
STIFFNESS, MASS, ROTOR = 4000.0, 2.5, 0.25


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    path = tmp_path_factory.mktemp("lift") / "lift.toml"
    path.write_text(LIFT, encoding="utf-8")
    return prepare_library(read_robot(path))


def raise_and_lower(gravity, *, offset=0.0, delay=0.0, noise=1e-6):
    """Return a carriage on a spring: force m (ddq + g), friction and rotor before the spring."""
    time = np.arange(10_000) * 2e-3
    w, phase = 2.0 * np.pi * np.array([0.3, 0.8, 1.7]), np.array([0.0, 1.0, 2.0])

    def move(at, order):
        sizes = 0.2 / w * w**order
        return (sizes * np.sin(w * at[:, None] + phase + 0.5 * np.pi * order)).sum(axis=1, keepdims=True)

    force = MASS * (move(time, 2) + gravity)
    theta = move(time, 0) + force / STIFFNESS
    speed = move(time, 1) + MASS * move(time, 3) / STIFFNESS
    acceleration = move(time, 2) + MASS * move(time, 4) / STIFFNESS
    rng = np.random.default_rng(1)
    return Recording(
        time=time,
        position=move(time - delay, 0) - offset + noise * rng.normal(size=theta.shape),
        motor_position=theta,
        torque=force + ROTOR * acceleration + 1.5 * np.tanh(speed / 0.01) + speed,
        source="run",
    )


@pytest.mark.parametrize("offset", [0.0, 0.004])
def test_no_zero_is_invented_where_gravity_never_changes(lift, offset):
    recording = raise_and_lower(9.81, offset=offset, delay=0.003)
    found = estimate_torsion_alignment(lift, [recording])
    assert found.unknown.tolist() == [True]
    assert found.delay == pytest.approx(0.003, abs=2e-5)
    (moved,), kept, told = prepare_aligned(lift, [recording])
    assert {notice.code for notice in told} == {"log.aligned", "log.offset-unknown"}
    assert "'carriage'" in told[-1].text
    assert np.isnan(kept.offsets).all()
    gap = moved.motor_position - moved.position
    assert np.mean(gap) == pytest.approx(MASS * 9.81 / STIFFNESS + offset, abs=1e-4)


def test_a_log_in_line_and_its_stiffness_say_that_gravity_never_changes(lift):
    _, _, told = prepare_aligned(lift, [raise_and_lower(9.81, noise=1e-4)])
    assert [notice.code for notice in told] == ["log.in-line", "log.offset-unknown"]
    # No number of an offset stands there: only the delay and its deviation.
    assert len(re.findall(r"[0-9.]+ ms", told[0].text)) == len(re.findall(r"[0-9.]+", told[0].text)) == 2
    found = estimate_stiffness(lift, [raise_and_lower(9.81)])
    (joint,) = found.joints
    assert joint.verdict is StiffnessVerdict.NO_GRAVITY
    assert joint.left > 0.0
    assert "log.offset-unknown" in {notice.code for notice in found.notices}
