"""A joint that sticks: deviations hold for it, leaving slow rows out helps."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, find_friction, find_rigid
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES

AUTOMATIC = Processing(automatic=True)
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
    bend = slope * change[:, None] - rate**2 * q * speed[:, None] ** 2
    return q, slope * speed[:, None], bend


def stop_and_go(stuck, seed=1):
    """Return a log in which joint 2 holds up to `stuck` N m more than it should wherever it is slow."""
    time = PERIOD * np.arange(15001)
    q, dq, ddq = move(time)
    columns = [find_rigid(LIBRARY, q, dq, ddq), find_friction(dq)[0]]
    torque = np.concatenate(columns, axis=2) @ TWO_LINK_TRUTH
    torque += np.random.default_rng(seed).normal(size=q.shape) * 0.05
    top = np.quantile(np.abs(dq[:, 1]), 0.99)
    torque[:, 1] += stuck * np.exp(-((dq[:, 1] / (0.01 * top)) ** 2))
    return Recording(time=time, position=q, torque=torque, source="stop.npz")


def identify(log, **settings):
    return identify_parameters(LIBRARY, [log], replace(AUTOMATIC, **settings))


def list_errors(estimate):
    """Return how far each value is from the true one, and that in stated deviations."""
    away = np.abs(estimate.assemble(NAMES) - TWO_LINK_TRUTH)
    deviations = {entry.name: entry.std for entry in estimate.parameters}
    return away, away / [deviations[name] for name in NAMES]


@pytest.mark.parametrize("stuck", [0.3, 1.0, 3.0])
def test_deviations_hold_for_what_sticks_and_slow_rows_left_out_help(stuck):
    log = stop_and_go(stuck)
    top = np.quantile(np.abs(np.gradient(log.position[:, 1], log.period)), 0.99)
    before, after = identify(log, standstill=0.0), identify(log, standstill=0.02 * float(top))
    (away, scores), (less, _) = list_errors(before), list_errors(after)
    assert np.sqrt(np.mean(scores**2)) < 1.5
    assert scores.max() < 4.0
    assert less.max() < 0.5 * away.max()
