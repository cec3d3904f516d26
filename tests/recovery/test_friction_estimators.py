"""Protocols S1 and S2 and a second truth: estimates within the Cramer-Rao bound, estimators that agree."""

import numpy as np
import pytest

from symid.identification.friction.estimators import fit_friction
from symid.joint_models.friction_catalogue import build_stribeck, get_law
from symid.study.friction_protocols import ESTIMATORS, RACERS, compute_cramer_rao
from tests import frictions
from tests.frictions import NOISE_S2, RV_2SQ, TABLE_1, TABLE_3, build_cosines, draw_s1, draw_s2, draw_samples

DRAWS = 20


@pytest.mark.parametrize(("count", "peak"), [(500, 0.1), (500, 0.5), (1000, 0.3)])
def test_s1_deterministic_estimators_agree_and_stay_within_the_bound(count, peak):
    samples, law = draw_s1(4, count=count, peak=peak)
    fits = [frictions.fit_by(samples, law, name) for name in ESTIMATORS if name not in RACERS]
    bound = compute_cramer_rao(samples, law, TABLE_1, float(np.sqrt(251.0 / count)))
    least = min(fit.objective for fit in fits)
    for fit in fits:
        assert fit.objective == pytest.approx(least, rel=1e-6)
        values = np.array(law.to_physical(fit.linear, fit.shape))
        assert np.all(np.abs(values - TABLE_1) < 3.0 * bound)
    # J / sigma^2 is chi-square distributed with N - 4 degrees of freedom.
    freedom = count - 4
    assert least == pytest.approx(251.0 * freedom / count, rel=4.0 * np.sqrt(2.0 / freedom))


@pytest.mark.parametrize("estimator", ["nlp", *RACERS])
def test_searches_end_at_the_optimum_from_every_seed_and_in_both_directions(estimator):
    for seed, (samples, law) in enumerate([*map(draw_s1, range(DRAWS)), draw_s2()]):
        best = fit_friction(samples, law).objective
        fit = frictions.fit_by(samples, law, estimator, seed)
        # The bar is 0.4 %, what the paper's own rows differ by; these do far better.
        assert best * (1.0 - 1e-9) <= fit.objective <= best * (1.0 + 1e-5)


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_s2_scatter_is_that_of_the_bound(joint):
    truth = np.array(TABLE_3[joint])
    values, solves = [], []
    for seed in range(DRAWS):
        samples, law = draw_s2(joint, seed)
        fit = fit_friction(samples, law)
        assert fit.refused == ()
        values.append([entry.value for entry in fit.parameters])
        solves.append(fit.solves)
    bound = compute_cramer_rao(samples, law, TABLE_3[joint], NOISE_S2[joint])
    errors = (np.array(values) - truth) / bound
    assert max(solves) <= 150
    # Of 20 draws a mean has a deviation of 0.22, a standard deviation one of 0.16.
    assert np.all(np.abs(errors.mean(axis=0)) < 0.8)
    assert np.all((errors.std(axis=0, ddof=1) > 0.5) & (errors.std(axis=0, ddof=1) < 1.6))


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
def test_rv_2sq_is_recovered_or_said_to_be_hidden(joint):
    *physical, exponent = RV_2SQ[joint]
    law = build_stribeck(exponent=exponent)
    velocity = build_cosines(3.0 * physical[2], 1.0)
    noise = 0.02 * physical[0]
    drawn = [draw_samples(law, tuple(physical), velocity, noise=noise, seed=seed) for seed in range(5)]
    bound = compute_cramer_rao(drawn[0], law, physical, noise)
    for samples in drawn:
        fit = fit_friction(samples, law)
        for entry, true, std in zip(law.physical, physical, bound, strict=True):
            value = fit.get_value(entry.name)
            if value is None:
                assert std > 0.25 * true
            else:
                assert abs(value - true) < 3.5 * std


def test_negative_static_friction_beyond_coulomb_is_found_without_force():
    law = get_law("stribeck")
    samples = draw_samples(law, (20.0, 16.5, 0.0288, 203.0), build_cosines(0.08, 0.3), noise=1.0)
    fit = fit_friction(samples, law)
    assert fit.get_value("fS") < fit.get_value("fC")
    assert "friction.static-below-coulomb" in {notice.code for notice in fit.notices}
