"""Elastic robots seen from the motor side alone: what is identified, and what is refused."""

import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import LogError
from symid.identification.elastic.routing import (
    build_motor_recording,
    build_rigid_variant,
    check_motor_side,
    has_both_encoders,
    list_unidentifiable,
    refuse_elasticity,
    warn_of_rotors,
)
from symid.identification.estimators.estimate import Outcome, ParameterEstimate
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from symid.robot.description import LogMap, LogQuantity
from symid.robot.loading import locate_robot_file
from symid.robot.toml_reader import read_robot
from tests.refusals import raises


@pytest.fixture(scope="module")
def arm():
    return read_robot(locate_robot_file("two_link_elastic"))


TIME = np.arange(10_000) * 1e-3
W = 2.0 * np.pi * np.array([[0.3, 0.7], [0.45, 1.1]])
ANGLE = W * TIME[:, None, None] + np.array([[0.0, 1.0], [2.0, 0.5]])


def make_recording(**more):
    q = 0.4 * np.sin(ANGLE).sum(axis=2)
    return Recording(time=TIME, position=q, torque=np.ones_like(q), source="run", **more)


def test_what_is_not_seen_is_refused_with_its_reason(arm):
    unseen = dict(list_unidentifiable(arm))
    first, second = ([f"stiffness{k}", f"hysteresis{k}", f"IA{k} apart from the link"] for k in (1, 2))
    assert list(unseen) == first + second
    assert len({unseen[name] for name in first if unseen[name]}) == 3
    assert list_unidentifiable(build_rigid_variant(arm)) == ()
    mixed = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], elasticity=None)))
    assert [name for name, _ in list_unidentifiable(mixed)] == first


def test_the_rigid_part_is_identified(arm):
    variant = build_rigid_variant(arm)
    library = prepare_library(variant)
    # Rotors are among the base parameters.
    names = {card.name: card.expression for card in library.card.beta}
    assert "IA1" in names["ZZR1"]
    assert not any(variant.elastic)
    recording = make_recording()
    dq, ddq = 0.4 * (W * np.cos(ANGLE)).sum(axis=2), -0.4 * (W**2 * np.sin(ANGLE)).sum(axis=2)
    truth = np.array([card.value for card in library.card.beta])
    (regressor,) = library.evaluate("torque_regressor", recording.position, dq, ddq)
    (friction,) = library.evaluate("friction_regressor", dq)
    values = np.array([card.value for card in library.card.friction])
    measured = replace(recording, torque=regressor @ truth + friction @ values)
    estimate = refuse_elasticity(identify_parameters(library, [measured], variant.processing), arm)
    found = estimate.assemble(tuple(card.name for card in library.card.beta))
    np.testing.assert_allclose(found, truth, atol=2e-3)
    assert estimate.outcome is Outcome.SOME_REFUSED
    assert len(estimate.refused) == 6
    assert estimate.notices[0].code == "elastic.motor-side"


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


@pytest.mark.parametrize(
    ("columns", "both", "refused"),
    [
        ((), False, False),
        (("q",), False, False),
        (("link_position",), False, True),
        (("link_position_1", "link_position_2"), False, True),
        (("a", "b"), True, True),
    ],
)
def test_positions_of_links_are_no_motor_side(arm, columns, both, refused):
    quantity = LogQuantity(columns=columns, unit="rad") if columns else None
    robot = replace(arm, log=LogMap(position=quantity, link_position=quantity if both else None))
    with raises(LogError, "elastic.link-side", match=", ".join(columns)) if refused else nullcontext():
        check_motor_side(robot, [make_recording()])


def test_a_negative_rotor_is_told():
    values = {"IA1": 0.2, "IA2": -0.01, "IA12": -1.0, "MY1": -0.3, "Fv1": -1.0}
    entries = [ParameterEstimate(name=name, value=x, std=0.1, unit="kg m^2") for name, x in values.items()]
    (notice,) = warn_of_rotors(entries)
    assert notice.code == "elastic.negative-rotor"
    assert re.findall(r"\b[A-Z]+[a-z]?\d+", notice.text) == ["IA2", "IA12"]
    assert warn_of_rotors(entries[:1]) == ()
