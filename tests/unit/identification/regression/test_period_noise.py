"""Noise from what differs between periods: its covariance comes back, wrong periods are refused."""

import numpy as np
import pytest

from symid.errors import UsageError
from symid.identification.estimators.least_squares import estimate_period_noise
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.refusals import raises

COVARIANCE = np.array([[0.04, 0.018], [0.018, 0.01]])
PLAIN = Processing()


def build(period=2.0, count=10, step=1e-3, seed=0):
    time = step * np.arange(round(count * period / step) + 1)
    angle = 2.0 * np.pi * time / period
    motion = np.column_stack([3.0 * np.sin(angle), np.cos(2.0 * angle) + 0.5 * np.sin(3.0 * angle)])
    noise = np.random.default_rng(seed).normal(size=(len(time), 2)) @ np.linalg.cholesky(COVARIANCE).T
    return Recording(time=time, position=motion, torque=motion + noise, source="made")


def test_the_covariance_comes_back():
    found = estimate_period_noise([build(), build(seed=1)], PLAIN, [2.0])
    np.testing.assert_allclose(found, COVARIANCE, rtol=0.05)
    # Each log may have its own period, and periods be no whole number of samples.
    logs = [build(), build(period=1.7321, seed=1)]
    found = estimate_period_noise(logs, PLAIN, [2.0, 1.7321])
    # Interpolation between samples averages noise: at most a half of its variance is lost.
    assert np.all(np.diag(found) < 1.05 * np.diag(COVARIANCE))
    assert np.all(np.diag(found) > 0.6 * np.diag(COVARIANCE))


@pytest.mark.parametrize(
    ("periods", "message"),
    [([15.0], "15 s fit into the"), ([2.0, 2.0], "2 periods for 1 logs"), ([1.31], "does not repeat")],
)
def test_what_tells_no_noise_is_refused(periods, message):
    with raises(UsageError, "usage.period", match=message):
        estimate_period_noise([build()], PLAIN, periods)
