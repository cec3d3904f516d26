"""What a joint does at a row: in motion, at reversal, at rest; and the residual of each."""

import numpy as np
import pytest

from symid.identification.estimators import MotionResidual, find_phases

PERIOD = 0.002
RUN = np.zeros(5000, dtype=np.intp)


def move(time):
    """Return velocities that rise, stand still from 4 s to 6 s, and swing."""
    return np.where((time > 4.0) & (time < 6.0), 0.0, np.sin(2.0 * np.pi * 0.5 * time))


def test_a_joint_moves_turns_round_and_rests():
    time = np.arange(5000) * PERIOD
    velocity = move(time)
    phases = find_phases(time, velocity, RUN)
    inside = (time > 4.1) & (time < 5.9)
    assert (phases[inside] == 2).all()
    assert (phases[np.abs(velocity) > 0.05] == 0).all()
    turning = (np.abs(velocity) < 0.045) & ~((time > 3.9) & (time < 6.1))
    assert turning.any()
    assert (phases[turning] == 1).all()
    # A joint that never moves rests.
    assert (find_phases(np.arange(300) * PERIOD, np.zeros(300), RUN[:300]) == 2).all()
    assert len(find_phases(np.zeros(0), np.zeros(0), RUN[:0])) == 0


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_noise_of_velocities_is_no_motion(noise):
    time = np.arange(5000) * PERIOD
    positions = np.cumsum(move(time)) * PERIOD
    rng = np.random.default_rng(1)
    noisy = np.gradient(positions + noise * PERIOD * rng.normal(size=5000), PERIOD)
    phases = find_phases(time, noisy, RUN)
    assert (phases[(time > 4.2) & (time < 5.8)] == 2).mean() > 0.95
    # Slow stretches of noise are no rest.
    assert not np.any(phases[(time < 3.9) | (time > 6.1)] == 2)


def test_logs_are_looked_at_one_by_one():
    time = np.arange(2500) * PERIOD
    joined = np.concatenate([move(time), move(time)[::-1]])
    run = np.repeat([0, 1], 2500)
    phases = find_phases(np.concatenate([time, time]), joined, run)
    for number, velocity in enumerate((move(time), move(time)[::-1])):
        top = 1.0 / np.quantile(np.abs(joined), 0.99)
        alone = find_phases(time, velocity * top, RUN[:2500])
        assert np.mean(phases[run == number] == alone) > 0.99


def test_residuals_of_phases_add_up():
    rng = np.random.default_rng(2)
    errors, phases = rng.normal(size=500), np.repeat([0, 0, 1, 0, 1], 100)
    found = MotionResidual.measure("a", "N m", errors, phases, 7)
    assert found.rows == (300, 200, 0)
    assert found.rms[2] is None
    squares = sum(rms**2 * rows for rms, rows in zip(found.rms[:2], found.rows[:2], strict=True))
    assert squares == pytest.approx(np.sum(errors**2))
    assert found.whole**2 * 500 == pytest.approx(squares)
    assert found.left_out == 7
