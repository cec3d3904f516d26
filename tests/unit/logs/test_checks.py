"""Remarks on suspicious recordings; none on a good one."""

from dataclasses import replace

import numpy as np
import pytest

from symid.logs.checks import check_recording
from symid.logs.recording import Recording
from symid.robot.description import Limits
from tests.refusals import tell

T = np.arange(4000) * 1e-3
GOOD = Recording(
    time=T,
    position=np.column_stack([np.sin(3 * T), np.cos(2 * T)]),
    torque=np.column_stack([np.sin(3 * T) + 0.1 * np.sin(17 * T), np.cos(5 * T) + T]),
)


@pytest.fixture
def check(make_robot):
    """Return a check of changes of the good recording: {code: text}."""

    def run(limits=None, **changes):
        robot = make_robot()
        if limits:
            robot = replace(robot, joints=(replace(robot.joints[0], limits=limits), robot.joints[1]))
        return tell(check_recording(replace(GOOD, **changes), robot))

    return run


def change(values, where, new):
    changed = values.copy()
    changed[where] = new
    return changed


def test_what_is_suspicious_is_remarked_and_nothing_else(check):
    assert check() == {}
    assert "20 % from 0.001 s" in check(time=change(T, 100, T[100] + 2e-4))["log.jitter"]
    held = np.where(T < 1.0, 0.0, np.where(T > 1.8, 1.0, (T - 1.0) / 0.8))
    found = check(position=np.column_stack([held, GOOD.position[:, 1]]))
    assert "'joint1' is at standstill for 7" in found["log.standstill"]
    assert (
        "'joint2' moves over 114.6 rad" in check(position=np.degrees(GOOD.position))["log.looks-like-degrees"]
    )
    slow = GOOD.position[(np.arange(4000) // 4) * 4]
    assert "75 %" in check(position=slow)["log.repeated-samples"]
    found = check(limits=Limits(position=(-0.5, 0.5), torque=0.6))
    assert "-0.5 .. 0.5" in found["log.beyond-limits"]
    assert "limit 0.6" in found["log.torque-beyond-limit"]


@pytest.mark.parametrize(
    ("limit", "spike", "code"),
    [(1.2, 1.0, None), (0.9, 1.0, "log.torque-peaks"), (1.2, 3.0, "log.torque-peaks")],
)
def test_peaks_above_the_limit_of_a_joint_accuse_no_unit(check, limit, spike, code):
    """A torque of 1.1 at most, above the limit by a fifth, or for a few samples."""
    torque = GOOD.torque.copy()
    torque[515:535, 0] *= spike
    assert [*check(limits=Limits(torque=limit), torque=torque)] == [code] * (code is not None)


def test_constant_channels(check):
    found = check(position=change(GOOD.position, np.s_[:, 1], 0.3))
    assert list(found) == ["log.constant-position"]
    assert "'joint2'" in found["log.constant-position"]
    found = check(torque=change(GOOD.torque, np.s_[:, 0], 0.3))
    assert list(found) == ["log.constant-torque"]
    assert "'joint1' is 0.3" in found["log.constant-torque"]


RATE = np.column_stack([3.0 * np.cos(3 * T), -2.0 * np.sin(2 * T)])


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (-1.0, "is -1 times"),
        (180.0 / np.pi, "looks like degrees per second"),
        (np.pi / 180.0, "the position looks like degrees"),
        (30.0 / np.pi, "revolutions per minute"),
        (1e-3, "thousandths"),
        (3.0, "their units or sides differ"),
    ],
)
def test_a_velocity_in_other_units(check, factor, text):
    found = check(velocity=RATE * [1.0, factor])
    assert text in found["log.velocity-differs"]
    assert "joint 'joint2'" in found["log.velocity-differs"]


def test_the_velocity_of_another_joint_and_one_with_bias_and_noise(check):
    found = check(velocity=RATE[:, ::-1])
    assert list(found) == ["log.velocity-differs"]
    assert "'joint2' is not that of" in found["log.velocity-differs"]
    noise = np.random.default_rng(0).normal(size=RATE.shape)
    assert check(velocity=RATE + 0.05 + 0.2 * noise) == {}
    assert check(velocity=np.where(T[:, None] == 0.5, np.nan, 9.0 * RATE)) == {}
