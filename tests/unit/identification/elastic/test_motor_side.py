"""Elastic robots seen from the motor side alone: what is identified, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.elastic.routing import (
    build_motor_recording,
    build_rigid_variant,
    has_both_encoders,
    list_unidentifiable,
)
from symid.logs.recording import Recording
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot


@pytest.fixture(scope="module")
def arm():
    return read_robot(locate_robot_file("two_link_elastic"))


TIME = np.arange(10_000) * 1e-3


def make_recording(**more):
    q = np.sin(np.array([2.0, 3.0]) * TIME[:, None])
    return Recording(time=TIME, position=q, torque=np.ones_like(q), source="run", **more)


def test_what_is_not_seen_is_refused_with_its_reason(arm):
    unseen = dict(list_unidentifiable(arm))
    first, second = ([f"stiffness{k}", f"hysteresis{k}", f"IA{k} apart from the link"] for k in (1, 2))
    assert list(unseen) == first + second
    assert len({unseen[name] for name in first if unseen[name]}) == 3
    rigid = build_rigid_variant(arm)
    assert list_unidentifiable(rigid) == ()
    # Rotors are among the base parameters.
    names = {card.name: card.expression for card in prepare_library(rigid).card.beta}
    assert "IA1" in names["ZZR1"]
    mixed = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], elasticity=None)))
    assert [name for name, _ in list_unidentifiable(mixed)] == first


def test_elastic_joints_take_the_position_of_their_motors(arm):
    q = make_recording().position
    recording = make_recording(motor_position=q + 0.01)
    # One encoder is told from two.
    assert has_both_encoders([recording])
    assert not has_both_encoders([make_recording()])
    assert not has_both_encoders([recording, make_recording()])
    whole = build_motor_recording(recording, arm)
    np.testing.assert_array_equal(whole.position, q + 0.01)
    assert whole.motor_position is None
    assert whole.notices[-1].code == "log.motor-position"
    mixed = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], elasticity=None)))
    part = build_motor_recording(recording, mixed)
    np.testing.assert_array_equal(part.position, q + np.array([0.01, 0.0]))
    rigid = build_rigid_variant(arm)
    assert build_motor_recording(recording, rigid) is recording
    # A channel that never moves is no encoder.
    dead = np.column_stack([np.zeros(len(q)), q[:, 1] + 0.01])
    kept = build_motor_recording(make_recording(motor_position=dead), arm)
    np.testing.assert_array_equal(kept.position, q + np.array([0.0, 0.01]))
