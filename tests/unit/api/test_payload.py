"""Payloads from fits in memory and from logs that were read, against the body that was added."""

import json

import numpy as np
import pytest

import symid
from tests.estimates import add_payload, build_estimate

BODY = MASS, CENTRE, INERTIA = 1.5, (0.03, -0.02, 0.09), (0.004, 0.0003, -0.0002, 0.005, 0.0001, 0.003)


def test_two_fits_in_memory_give_the_payload(robot, tmp_path):
    loaded, empty = build_estimate(add_payload(robot.description, *BODY)), build_estimate(robot.description)
    found = robot.payload(loaded, empty)
    assert (found.joint, found.mass) == ("elbow", pytest.approx(MASS))
    # A planar arm shows neither where a body is along its axes nor its inertia about the others.
    np.testing.assert_allclose(found.com, [CENTRE[0], CENTRE[1], np.nan], atol=1e-9)
    inertia = np.full((3, 3), np.nan)
    inertia[2, 2] = INERTIA[5]
    np.testing.assert_allclose(found.inertia, inertia, atol=1e-9)
    assert found["Jzz"].std > 0
    assert found["cz"].value is None
    assert found["cz"].reason
    assert [notice.code for notice in found.notices] == ["payload.refused"]
    path = found.save(tmp_path / "payload.json")
    stored, said = json.loads(path.read_text()), json.loads(json.dumps(found.to_dict()))
    assert {key: stored[key] for key in said} == said
    assert symid.load_payload(path).to_dict() == found.to_dict()
    assert repr(found) == "<PayloadResult two_link: 1.5 kg on the link of joint 'elbow'>"


def test_a_known_mass_is_taken(robot):
    loaded, empty = build_estimate(add_payload(robot.description, *BODY)), build_estimate(robot.description)
    found = robot.payload(loaded, empty, mass=MASS, joint="elbow")
    assert found.mass == pytest.approx(MASS, rel=1e-14)
    assert found["cx"].std < robot.payload(loaded, empty)["cx"].std
