"""Cosine motions: their states, whole periods, the same motion of a robot."""

import math

import numpy as np
import pytest

from symid.errors import UsageError
from symid.excitation.trajectories import (
    build_cosine,
    build_cosine_trajectory,
    build_peak_cosine,
    join_motions,
)


def test_states_are_those_of_a_cosine():
    motion = build_cosine(amplitude=0.3, omega=2.0, centre=0.5, periods=3.0, rate=200.0)
    assert len(motion.time) == round(3.0 * math.pi * 200.0)
    assert motion.period == pytest.approx(math.pi)
    assert motion.position[0] == pytest.approx(0.8)
    # The equation of a harmonic oscillator, and its energy.
    assert np.allclose(motion.acceleration, -4.0 * (motion.position - 0.5), atol=1e-13)
    assert np.allclose(motion.velocity**2 + 4.0 * (motion.position - 0.5) ** 2, 0.36, atol=1e-13)
    slope = np.gradient(motion.position, motion.time, edge_order=2)
    assert np.allclose(slope[1:-1], motion.velocity[1:-1], atol=1e-4)


def test_a_whole_period_sums_to_zero():
    motion = build_cosine(amplitude=0.3, omega=2.0 * math.pi, periods=2.0, rate=100.0)
    assert len(motion.time) == 200
    assert abs(motion.velocity.sum()) < 1e-11
    assert abs(motion.position.sum()) < 1e-11


def test_a_peak_and_a_count_of_samples_are_met():
    motion = build_peak_cosine(peak=0.1, amplitude=0.2, periods=5.0, samples=1000)
    assert len(motion.time) == 1000
    assert np.abs(motion.velocity).max() == pytest.approx(0.1, rel=1e-4)


def test_motions_are_joined_in_their_order():
    slow = build_peak_cosine(peak=0.1, amplitude=0.2, samples=100)
    fast = build_peak_cosine(peak=1.0, amplitude=0.2, samples=50)
    both = join_motions([slow, fast])
    assert len(both.time) == 150
    assert np.all(np.diff(both.time) > 0.0)
    assert np.array_equal(both.velocity, np.concatenate([slow.velocity, fast.velocity]))
    assert join_motions([slow]) is slow
    with pytest.raises(UsageError, match="at least one"):
        join_motions([])


def test_the_trajectory_is_the_cosine_after_its_ramp():
    path = build_cosine_trajectory(joint=1, amplitude=0.4, omega=3.0, pose=[0.2, -0.3, 0.7], periods=2.0)
    times = np.linspace(path.ramp, path.duration, 200)
    q, dq, ddq = path.evaluate(times)
    assert np.allclose(q[:, 1], -0.3 + 0.4 * np.cos(3.0 * times))
    assert np.allclose(dq[:, 1], -1.2 * np.sin(3.0 * times))
    assert np.allclose(ddq[:, 1], -3.6 * np.cos(3.0 * times))
    assert np.array_equal(q[:, [0, 2]], np.broadcast_to([0.2, 0.7], (200, 2)))
    start = path.evaluate(np.array([0.0]))
    assert start[0][0].tolist() == [0.2, -0.3, 0.7]
    assert not start[1].any()


@pytest.mark.parametrize(
    "values",
    [
        {"amplitude": 0.0, "omega": 1.0},
        {"amplitude": 1.0, "omega": -1.0},
        {"amplitude": 1.0, "omega": math.inf},
        {"amplitude": 1.0, "omega": 1.0, "rate": 0.0},
        {"amplitude": 1.0, "omega": 1.0, "periods": math.nan},
        {"amplitude": 1.0, "omega": 1.0, "periods": 1e-9},
    ],
)
def test_impossible_cosines_are_refused(values):
    with pytest.raises(UsageError) as caught:
        build_cosine(**values)
    assert caught.value.notices[0].code == "usage.cosine"


def test_a_joint_that_is_not_there_is_refused():
    with pytest.raises(UsageError, match="no joint 3") as caught:
        build_cosine_trajectory(joint=2, amplitude=1.0, omega=1.0, pose=[0.0, 0.0])
    assert caught.value.notices[0].code == "usage.unknown-joint"
