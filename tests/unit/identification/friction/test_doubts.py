"""What samples cannot tell gets a sentence and no number; what looks odd is said."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.problem import FrictionOptions, VariableProjectionOptions
from symid.identification.friction.selection import select_law
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import get_law
from tests.frictions import TABLE_3, build_cosines, draw_s1, draw_s2, draw_samples

STRIBECK = TABLE_3[1][:4]
PHASE = 2.0 * np.pi * (np.arange(1000) + 0.5) / 1000


def fit(name, physical, velocity, *, noise=0.5, seed=0, blur=0.0, **given):
    law = get_law(name)
    samples = draw_samples(law, physical, velocity, noise=noise, seed=seed, **given)
    if blur:
        shaken = velocity + blur * np.random.default_rng(9).standard_normal(len(velocity))
        samples = replace(samples, velocity=shaken)
    return fit_friction(samples, law)


def find_codes(estimate):
    return {notice.code for notice in estimate.notices}


def get_entry(estimate, name):
    return next(entry for entry in estimate.parameters if entry.name == name)


def test_a_good_log_is_not_doubted():
    for draw in (draw_s1, draw_s2):
        estimate = fit_friction(*draw())
        assert estimate.refused == ()
        assert find_codes(estimate) <= {"friction.one-direction"}
        assert estimate.outcome is Ending.CONVERGED


@pytest.mark.parametrize("blur", [0.0, 0.002])
@pytest.mark.parametrize("both", [False, True])
def test_at_one_speed_coulomb_and_viscous_friction_are_refused(both, blur):
    velocity = np.full(500, 0.2)
    if both:
        velocity[250:] = -0.2
    estimate = fit("coulomb-viscous", (11.0, 20.0), velocity, blur=blur)
    assert estimate.parameters == ()
    assert all("0.2 rad/s" in reason for _, reason in estimate.refused)
    assert estimate.outcome is Ending.SOME_REFUSED
    # Coulomb friction alone can be told.
    alone = fit("coulomb", (11.0,), np.full(500, 0.2))
    assert alone.get_value("fC") == pytest.approx(11.0, abs=0.1)


@pytest.mark.parametrize("name", ["stribeck", "stribeck-exponent", "tustin", "lorentzian"])
def test_a_bump_that_is_not_there_is_refused(name):
    law = get_law(name)
    samples = draw_samples(get_law("coulomb-viscous"), (11.0, 20.0), build_cosines(0.1, 1.0), noise=0.5)
    refused = dict(fit_friction(samples, law).refused)
    assert {"fS", "vs"} <= set(refused)


def test_a_zone_that_is_not_there_is_refused():
    samples = draw_samples(get_law("stribeck"), (11.0, 20.0, 0.05, 20.0), build_cosines(0.1, 1.0), noise=0.5)
    estimate = fit_friction(samples, get_law("improved-stribeck"))
    refused = dict(estimate.refused)
    assert "zone" in refused["dq0"]
    assert estimate.get_value("vs") == pytest.approx(0.05, abs=0.003)
    # What exists inside of it only is refused with it; in the reading H1 it acts at all speeds.
    assert "fP" not in refused
    refused = dict(fit_friction(samples, get_law("improved-stribeck-h2")).refused)
    assert {"dq0", "fP"} <= refused.keys()
    assert "zone" in refused["fP"]


def test_a_column_beside_friction_that_depends_on_it_is_refused():
    velocity = build_cosines(0.1, 1.0)
    extra = np.column_stack([np.cos(np.tile(PHASE, 2)), velocity])
    estimate = fit("coulomb-viscous", (11.0, 20.0), velocity, extra=extra, extra_names=("J", "b"))
    assert set(dict(estimate.refused)) == {"fV", "b"}
    assert [entry.name for entry in estimate.extra] == ["J"]


def test_few_slow_samples_and_what_lies_at_or_beyond_a_bound_are_told():
    fast = np.sign(np.sin(PHASE)) * (0.2 + 0.8 * np.abs(np.sin(3.0 * PHASE)))
    velocity = np.concatenate([fast, np.tile([0.01, -0.02], 5)])
    assert "friction.few-slow" in find_codes(fit("stribeck", STRIBECK, velocity))
    assert "friction.beyond-bound" in find_codes(fit("coulomb-viscous", (11.0, -2.0), build_cosines(0.5)))
    samples = draw_samples(get_law("stribeck-8"), STRIBECK, build_cosines(0.1, 1.0), noise=0.1)
    estimate = fit_friction(samples, get_law("stribeck-exponent"))
    assert "friction.at-bound" in find_codes(estimate)
    entry = get_entry(estimate, "gamma")
    assert entry.value == pytest.approx(4.0)
    assert "upper bound" in entry.reason
    # So is a search that was cut short.
    options = FrictionOptions(variable_projection=VariableProjectionOptions(solves=52))
    estimate = fit_friction(*draw_s2(), options=options)
    assert estimate.outcome is Ending.LIMIT
    assert "friction.outcome" in find_codes(estimate)


@pytest.mark.parametrize("name", ["stribeck+offset", "stribeck-exponent+offset", "asymmetric-stribeck"])
def test_samples_that_are_not_fitted_show_nothing(name):
    # All speeds, of which the slow rows are left out behind R.
    velocity = build_cosines(0.15, 1.0)
    kept = np.flatnonzero(np.abs(velocity) > 0.1)
    physical, options = (11.0, 40.0, 0.04, 20.0, 0.5), {"noise": 0.05, "reduce": lambda rows: rows[kept]}
    samples = draw_samples(get_law("stribeck+offset"), physical, velocity, **options)
    estimate = fit_friction(samples, get_law(name))
    refused = dict(estimate.refused)
    bump = {"fS", "fE", "vs", "gamma"}
    assert {entry.name for entry in get_law(name).physical if entry.name in bump} <= refused.keys()
    assert "0.1 rad/s" in refused["vs"]
    assert estimate.outcome is Ending.SOME_REFUSED
    # A law that rests on them is not chosen.
    if name.endswith("offset"):
        assert select_law(samples, ("coulomb-viscous-offset", name))[0].chosen == "coulomb-viscous-offset"


@pytest.mark.parametrize("code", ["friction.one-direction", "friction.few-slow"])
def test_the_direction_and_the_slow_ones_are_counted_among_rows(code):
    velocity, law = build_cosines(0.1, 1.0), get_law("stribeck")
    kept = np.flatnonzero(velocity > 0.0 if code == "friction.one-direction" else np.abs(velocity) > 0.048)
    samples = draw_samples(law, STRIBECK, velocity, noise=0.1, reduce=lambda columns: columns[kept])
    options = FrictionOptions(bounds=(("vs", (0.02, 0.0243)),))
    assert code in find_codes(fit_friction(samples, law, options=options))
    whole = draw_samples(law, STRIBECK, velocity, noise=0.1)
    assert code not in find_codes(fit_friction(whole, law, options=options))


@pytest.mark.parametrize("estimator", ["nlp", "genetic", "annealing", "differential-evolution"])
def test_a_value_that_a_bound_holds_is_told(estimator):
    law = get_law("coulomb-viscous")
    samples = draw_samples(law, (11.0, -2.0), build_cosines(0.5), noise=0.1)
    estimate = fit_friction(samples, law, estimator=estimator)
    assert "lower bound, 0:" in get_entry(estimate, "fV").reason
    assert "friction.at-bound" in find_codes(estimate)
    assert get_entry(estimate, "fC").reason == ""


def test_static_friction_at_its_bound_is_told_and_not_taken_for_unsure():
    law = get_law("stribeck")
    samples = draw_samples(law, (11.0, -3.0, 0.03, 20.0), build_cosines(0.1, 1.0), noise=0.1)
    estimate = fit_friction(samples, law, estimator="nlp")
    assert "fS" not in dict(estimate.refused)
    entry = get_entry(estimate, "fS")
    assert entry.value == pytest.approx(0.0, abs=1e-6)
    assert "lower bound" in entry.reason
    # Without bounds nothing holds it, and that it lies beyond is told.
    assert "friction.beyond-bound" in find_codes(fit_friction(samples, law))
