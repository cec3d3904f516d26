"""Covariance and Cramer-Rao bound: printed values of the protocols, textbook cases, dependent columns."""

import numpy as np
import pytest
from scipy.signal import lfilter

from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import (
    FrictionSamples,
    compute_cramer_rao,
    compute_criteria,
    compute_sensitivities,
    compute_uncertainty,
)
from symid.identification.friction.poses import (
    compute_robust_deviations,
    estimate_pattern_covariance,
    warn_of_friction_pattern,
)
from symid.joint_models.friction_catalogue import get_law
from tests.frictions import NOISE_S2, TABLE_1, TABLE_3, build_cosines, draw_s1, draw_s2, draw_samples


@pytest.mark.parametrize(
    ("count", "peak", "printed"),
    [
        (500, 0.1, (0.46, 0.12, 0.0010, 5.0)),
        (500, 0.5, (0.094, 0.223, 0.0012, 0.254)),
        (1000, 0.3, (0.057, 0.087, 0.0005, 0.249)),
    ],
)
def test_the_bound_of_protocol_s1_is_the_printed_one(count, peak, printed):
    samples, law = draw_s1(count=count, peak=peak)
    bound = compute_cramer_rao(samples, law, TABLE_1, float(np.sqrt(251.0 / count)))
    np.testing.assert_allclose(bound, printed, rtol=0.1)


@pytest.mark.parametrize(
    ("joint", "printed"),
    [
        (1, (0.039, 0.21, 0.0004, 0.069, 0.022, 0.0001)),
        (2, (0.17, 1.68, 0.0005, 0.32, 0.11, 0.0001)),
        (3, (0.07, 1.22, 0.0007, 0.13, 0.045, 0.0001)),
    ],
)
def test_the_bound_of_protocol_s2_is_the_printed_one(joint, printed):
    samples, law = draw_s2(joint)
    bound = compute_cramer_rao(samples, law, TABLE_3[joint], NOISE_S2[joint])
    # Printed with one or two digits.
    np.testing.assert_allclose(bound[[0, 1, 3, 4]], np.array(printed)[[0, 1, 3, 4]], rtol=0.05)
    np.testing.assert_allclose(bound[[2, 5]], np.array(printed)[[2, 5]], atol=6e-5)


def test_a_linear_law_has_the_textbook_covariance():
    law = get_law("coulomb-viscous")
    samples = draw_samples(law, (10.0, 20.0), build_cosines(0.5), noise=1.0)
    design = compute_sensitivities(samples, law, (20.0, 10.0), ())
    told = compute_uncertainty(design, law, 4.0, ())
    np.testing.assert_allclose(told.covariance, 4.0 * np.linalg.inv(design.T @ design), rtol=1e-10)
    assert told.rank == 2


def test_the_bound_is_that_of_derivatives_by_hand():
    # tau = [fC + (fS - fC) e] sign v + fV v, e = exp(-(v / vs)^2).
    samples, law = draw_s1()
    coulomb, static, speed, _ = TABLE_1
    v, fall = samples.velocity, np.exp(-((samples.velocity / speed) ** 2))
    rise = (static - coulomb) * fall * 2.0 * v**2 / speed**3 * np.sign(v)
    design = np.column_stack([(1.0 - fall) * np.sign(v), fall * np.sign(v), rise, v])
    bound = 0.7 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    np.testing.assert_allclose(compute_cramer_rao(samples, law, TABLE_1, 0.7), bound, rtol=1e-7)


def test_a_known_shape_value_makes_the_others_surer():
    samples, law = draw_s1()
    design = compute_sensitivities(samples, law, *law.from_physical(TABLE_1))
    free, known = (compute_uncertainty(design, law, 1.0, [fixed]).physical for fixed in (False, True))
    assert known[2] == 0.0
    assert np.all(known[[0, 1, 3]] < free[[0, 1, 3]])


def test_information_criteria_are_those_of_the_books():
    # M = 10, J = 5, three unknowns and the variance: k = 4.
    aicc, bic = compute_criteria(5.0, 10, 3)
    assert aicc == pytest.approx(10 * np.log(0.5) + 8 + 40 / 5)
    assert bic == pytest.approx(10 * np.log(0.5) + 4 * np.log(10))
    assert compute_criteria(5.0, 5, 3)[0] == np.inf
    assert compute_criteria(0.0, 10, 3, floor=1e-10) == compute_criteria(1e-10, 10, 3)


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
