"""Rows at standstill that leave more than others are named, with the speed below which to leave them out."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_recording, build_two_link
from tests.unit.identification.regression.test_identifiability import FILTERED

PERIOD = 1e-3
PAUSES = 3.0


def move(time):
    """Return positions, velocities, accelerations that come to a stop every three seconds."""
    turn = 2.0 * np.pi / PAUSES
    phase, speed = time - np.sin(turn * time) / turn, 1.0 - np.cos(turn * time)
    change = turn * np.sin(turn * time)
    rate, size = np.array([2.1, 3.7]), np.array([0.9, 1.1])
    angle = rate * phase[:, None] + np.array([0.3, 1.0])
    q, slope = size * np.sin(angle), size * rate * np.cos(angle)
    return (
        q,
        slope * speed[:, None],
        slope * change[:, None] - rate**2 * q * speed[:, None] ** 2,
    )


def stop_and_go(stuck, seed=1):
    """Return a log in which joint 2 holds up to `stuck` N m more than it should wherever it is slow."""
    time = PERIOD * np.arange(15001)
    q, dq, ddq = move(time)
    library = build_two_link()
    (rigid,) = library.evaluate("torque_regressor", q, dq, ddq)
    (rubbing,) = library.evaluate("friction_regressor", dq)
    torque = np.concatenate([rigid, rubbing], axis=2) @ TWO_LINK_TRUTH
    torque += np.random.default_rng(seed).normal(size=q.shape) * 0.05
    top = np.quantile(np.abs(dq[:, 1]), 0.99)
    torque[:, 1] += stuck * np.exp(-((dq[:, 1] / (0.01 * top)) ** 2))
    return Recording(time=time, position=q, torque=torque, source="stop.npz")


def find(estimate):
    return [notice.text for notice in estimate.notices if notice.code == "identify.sticking"]


def test_a_joint_that_sticks_is_named_and_the_advice_helps():
    library, log = build_two_link(), stop_and_go(3.0)
    (text,) = find(identify_parameters(library, [log], FILTERED))
    assert "joint2 (" in text
    speed = float(text.split("processing.standstill=")[1].split(" ")[0])
    top = np.quantile(np.abs(np.gradient(log.position[:, 1], log.period)), 0.99)
    assert speed <= 0.021 * top
    advised = identify_parameters(library, [log], replace(FILTERED, standstill=speed))
    assert find(advised) == []
    before = identify_parameters(library, [log], FILTERED)
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    errors = [np.abs(estimate.assemble(names) - TWO_LINK_TRUTH).max() for estimate in (before, advised)]
    assert errors[1] < 0.5 * errors[0]


def test_a_robot_that_never_stops_and_one_that_does_not_stick_say_nothing():
    moving = build_recording(build_two_link(), TWO_LINK_TRUTH, samples=8001, noise=(0.05, 0.05))
    assert find(identify_parameters(build_two_link(), [moving], FILTERED)) == []
    assert find(identify_parameters(build_two_link(), [stop_and_go(0.0)], FILTERED)) == []


@pytest.mark.parametrize("rows", ["momentum", "filtered"])
def test_other_rows_too(rows):
    assert find(identify_parameters(build_two_link(), [stop_and_go(3.0)], FILTERED, rows=rows, window=0.01))


def test_scalar_rows_have_no_joints():
    assert find(identify_parameters(build_two_link(), [stop_and_go(3.0)], FILTERED, rows="energy")) == []
