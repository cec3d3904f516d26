"""Deviations where the residual keeps a pattern: closed forms, white noise, degrees of freedom."""

import numpy as np
import pytest
from scipy.signal import lfilter

from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.poses import (
    compute_robust_deviations,
    estimate_pattern_covariance,
    warn_of_friction_pattern,
)
from symid.joint_models.friction_catalogue import get_law

LAW = get_law("coulomb-viscous-offset")
TRUTH = (1.8, 1.1, 0.2)


def build_samples(noise, runs=1):
    time = np.arange(len(noise)) / 100.0
    velocity = 0.4 * np.sin(2.0 * np.pi * time / 2.0)
    torque = np.column_stack([np.sign(velocity), velocity, np.ones(len(time))]) @ TRUTH + noise
    run = np.arange(len(time)) * runs // len(time)
    return FrictionSamples(
        joint="j", time=time, velocity=velocity, torque=torque, extra=np.empty((len(time), 0)), run=run
    )


def remember(factor, count, seed=0):
    white = np.random.default_rng(seed).normal(size=count + 1000)
    return lfilter([np.sqrt(1.0 - factor**2)], [1.0, -factor], white)[1000:]


@pytest.mark.parametrize("runs", [1, 4])
def test_the_mean_of_noise_with_a_memory_is_as_unsure_as_its_closed_form(runs):
    samples = build_samples(0.1 * remember(0.9, 20000), runs)
    estimate = fit_friction(samples, LAW)
    deviation, freedom = compute_robust_deviations(samples, LAW, estimate)["offset"]
    # The variance of the mean of n such numbers is sigma^2 / n (1 + a) / (1 - a), a = 0.9.
    assert deviation == pytest.approx(0.1 / np.sqrt(20000) * np.sqrt(19.0), rel=0.15)
    # Where blocks scatter most, they are what the deviation rests on.
    assert 20 * runs - 1 <= freedom < 1.3 * 20000 / 19.0
    memory = estimate_pattern_covariance(samples, LAW, estimate).memory
    assert np.sqrt(memory[2, 2]) == pytest.approx(0.1 / np.sqrt(20000) * np.sqrt(19.0), rel=0.1)
    (notice,) = warn_of_friction_pattern(samples, LAW, estimate)
    assert notice.code == "friction.pattern"
    assert "offset" in notice.text


def test_scatter_over_many_draws_is_the_deviation_stated():
    found, stated = [], []
    for seed in range(60):
        samples = build_samples(0.1 * remember(0.97, 2000, seed))
        estimate = fit_friction(samples, LAW)
        found.append([entry.value for entry in estimate.parameters])
        stated.append([std for std, _ in compute_robust_deviations(samples, LAW, estimate).values()])
    ratio = np.sqrt(np.mean(np.square(stated), axis=0)) / np.std(found, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.6))


def test_white_noise_keeps_the_stated_deviations():
    samples = build_samples(0.1 * remember(0.0, 2000))
    estimate = fit_friction(samples, LAW)
    stated = {entry.name: entry.std for entry in estimate.parameters}
    for name, (deviation, freedom) in compute_robust_deviations(samples, LAW, estimate).items():
        assert 1.0 <= deviation / stated[name] < 1.5
        assert 10.0 < freedom < 2000.0
    assert warn_of_friction_pattern(samples, LAW, estimate) == ()
    # A fit to the last bit has no pattern either.
    exact = build_samples(np.zeros(2000))
    assert warn_of_friction_pattern(exact, LAW, fit_friction(exact, LAW)) == ()


def test_few_rows_have_white_noise_and_one_block_each():
    samples = build_samples(0.1 * remember(0.0, 22))
    covariance = estimate_pattern_covariance(samples, LAW, fit_friction(samples, LAW))
    assert covariance.freedom == covariance.block_freedom == 19.0
    assert np.allclose(covariance.memory, covariance.white)
