"""Time stamps and encoder steps: what is found in them, and what resampling does."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.checks import estimate_encoder_step
from symid.logs.faults import repair_recording
from symid.logs.recording import Recording
from symid.logs.sampling import describe_timing, measure_timing, plan_resampling
from symid.robot.description import JointKind
from tests.refusals import raises, tell

T = np.arange(1000) * 1e-3


def test_what_time_stamps_are_is_said():
    assert describe_timing(T) == ()
    assert measure_timing(T).even
    assert measure_timing(T).period == pytest.approx(1e-3)
    time = np.delete(T, [100, 101, 500])
    timing = measure_timing(time)
    assert (len(timing.gaps), timing.missing, timing.repeated, timing.backward) == (2, 3, 0, 0)
    assert (
        "2 gaps, 3 samples of 1000 are missing; the first gap is from 0.099 s to 0.102 s"
        in tell(describe_timing(time))["log.gap"]
    )
    time = np.insert(T, 10, T[10])
    time[200:] -= 0.05
    found = tell(describe_timing(time))
    assert "(the first: 11)" in found["log.repeated-times"]
    assert "1 samples have an earlier time" in found["log.time-order"]
    assert measure_timing(np.zeros(5)).period == 0.0
    with raises(LogError, "log.time-order"):
        plan_resampling(np.zeros(50))
    with raises(LogError, "log.gap"):
        plan_resampling(np.array([0.0, 1.0, 2.0, 30.0, 31.0, 32.0]))


def make_recording(time):
    wave = np.sin(7.0 * time)
    return Recording(time=time, position=wave[:, None], torque=np.cos(time)[:, None], velocity=wave[:, None])


def repair(log, make_robot):
    return repair_recording(log, make_robot([JointKind.REVOLUTE] * log.position.shape[1]).axes)


def test_resampling_says_what_it_did(make_robot):
    time = np.delete(np.insert(T, 10, T[10]), [100, 101, *range(700, 760)])
    time = time + 0.2e-3 * np.random.default_rng(1).uniform(size=len(time))
    time[10] = time[11]
    moved = repair(make_recording(time), make_robot)
    lost, notice = moved.notices
    assert lost.code == "log.gap"
    assert notice.code == "log.resampled"
    assert "; 1 with times" in notice.text
    assert "; 1 gaps of up to 10 periods" in notice.text
    assert "beyond longer gaps" in notice.text
    assert np.ptp(np.diff(moved.time)) < 1e-12
    # Monotone cubics: third order where the wave turns, at a thousandth of its period.
    np.testing.assert_allclose(moved.position[:, 0], np.sin(7.0 * moved.time), atol=1e-4)


def test_holes_of_a_velocity_stay_holes(make_robot):
    time = np.cumsum(1e-3 * (1.0 + 0.2 * np.random.default_rng(4).uniform(-1.0, 1.0, 501)))
    position = np.column_stack([np.sin(5.0 * time), np.cos(3.0 * time)])
    velocity = np.column_stack([5.0 * np.cos(5.0 * time), -3.0 * np.sin(3.0 * time)])
    velocity[100, 0] = np.nan
    log = Recording(time=time, position=position, torque=position, velocity=velocity, source="made")
    moved = repair(log, make_robot)
    holes = np.isnan(moved.velocity)
    assert 0 < holes[:, 0].sum() < 12
    assert np.all(np.abs(moved.time[holes[:, 0]] - time[100]) < 6e-3)
    assert not holes[:, 1].any()
    kept = ~np.isnan(moved.velocity[:, 0])
    np.testing.assert_allclose(moved.velocity[kept, 0], 5.0 * np.cos(5.0 * moved.time[kept]), atol=1e-3)


@pytest.mark.parametrize("step", [1e-5, 3e-4, 0.01])
def test_the_step_of_an_encoder(step):
    wave = np.sin(5.0 * T) + 0.1 * T
    assert estimate_encoder_step(np.round(wave / step) * step + 0.123) == pytest.approx(step, rel=1e-6)


def test_no_step():
    assert estimate_encoder_step(np.sin(5.0 * T)) == 0.0
    assert estimate_encoder_step(np.ones(50)) == 0.0
    assert estimate_encoder_step(T + np.random.default_rng(1).normal(size=len(T))) == 0.0
