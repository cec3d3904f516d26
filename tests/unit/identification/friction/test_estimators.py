"""One interface for all estimators of friction: the same report and refusals; covariance and its bound."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from symid import ipopt
from symid.errors import IdentifiabilityError, SolverError, UsageError
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.joint_fit import (
    FrictionSamples,
    compute_criteria,
    compute_sensitivities,
    compute_uncertainty,
)
from symid.identification.friction.poses import (
    compute_robust_deviations,
    estimate_pattern_covariance,
    warn_of_friction_pattern,
)
from symid.identification.friction.searches import FrictionOptions, build_problem
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import FRICTION_LAWS, get_law
from symid.joint_models.friction_law import compute_columns
from symid.study.friction_protocols import compute_cramer_rao
from tests.frictions import NOISE_S2, TABLE_1, TABLE_3, build_cosines, draw_s1, draw_s2, draw_samples
from tests.refusals import raises, tell

PHASE = 2.0 * np.pi * (np.arange(2000) + 0.5) / 1000


@pytest.mark.parametrize("name", sorted(FRICTION_LAWS))
def test_every_law_can_be_fitted(name):
    law = FRICTION_LAWS[name]
    velocity = build_cosines(0.1, 1.0)
    given = {"load": 3.0 + 2.0 * np.cos(3.0 * PHASE), "position": np.cos(PHASE)}
    if "temperature" in law.inputs:
        given["temperature"] = 35.0 + 20.0 * np.cos(0.31 * PHASE)
    names = ("vs", "gamma", "delta", "dq0", "g2", "g3", "g5", "TV")
    known = dict(zip(names, (0.05, 2.0, 0.7, 0.01, 100.0, 10.0, 100.0, 20.0), strict=True))
    physical = [known.get(entry.name, 5.0 + place) for place, entry in enumerate(law.physical)]
    if name == "improved-stribeck-h4":
        physical[-1] = 0.01
    samples = draw_samples(law, tuple(physical), velocity, noise=0.1, **given)
    estimate = fit_friction(samples, law)
    assert estimate.solves <= 150
    assert estimate.outcome.usable
    columns = compute_columns(law, samples.inputs, estimate.shape)
    errors = samples.torque - columns @ np.array(estimate.linear)
    assert float(errors @ errors) == pytest.approx(estimate.objective, rel=1e-6)
    assert estimate.sigma < 0.11


def test_columns_beside_friction_and_a_filter_take_part():
    law, physical = get_law("improved-stribeck"), (11.64, 23.19, 0.02767, 27.88, 0.47, 0.01)
    extra = np.column_stack([np.cos(PHASE), np.sin(0.7 * PHASE), np.cos(0.7 * PHASE)])
    given = {"extra_names": ("J", "a", "b"), "extra_units": ("kg m^2", "N m", "N m"), "extra": extra}
    given |= {"reduce": lambda columns: columns[::2] + columns[1::2]}
    samples = draw_samples(law, physical, build_cosines(0.1, 1.0), noise=0.0, **given)
    true = np.array([0.5, 3.0, -2.0])
    samples = replace(samples, torque=samples.torque + extra @ true)
    estimate = fit_friction(samples, law)
    assert estimate.samples == 1000
    np.testing.assert_allclose([entry.value for entry in estimate.extra], true, atol=1e-5)
    np.testing.assert_allclose([entry.value for entry in estimate.parameters], physical, rtol=1e-4)
    assert [entry.unit for entry in estimate.extra] == ["kg m^2", "N m", "N m"]


def test_an_unknown_estimator_is_refused():
    samples, law = draw_s1()
    with raises(UsageError, "usage.friction-estimator", match="'genetic' .*one of varpro, nlp$"):
        fit_friction(samples, law, estimator="genetic")


@pytest.mark.parametrize(
    ("name", "velocity", "code", "error"),
    [
        ("load-dependent", build_cosines(0.5), "friction.input", UsageError),
        ("stribeck", np.zeros(100), "friction.rest", IdentifiabilityError),
        ("stribeck", np.array([0.1, 0.2, -0.3]), "friction.few-rows", IdentifiabilityError),
    ],
)
def test_what_cannot_be_fitted_is_refused(name, velocity, code, error):
    samples = draw_samples(get_law("coulomb"), (1.0,), velocity, noise=0.1)
    with raises(error, code):
        fit_friction(samples, get_law(name))


def test_bounds_are_kept_and_refused_of_a_parameter_that_is_none():
    samples, law = draw_s1()
    estimate = fit_friction(samples, law, options=FrictionOptions(bounds=(("vs", (0.05, 0.1)),)))
    assert estimate.shape == (pytest.approx(0.05),)
    with raises(UsageError, "friction.bounds", match=r"gamma.* vs$"):
        build_problem(samples, law, FrictionOptions(bounds=(("gamma", (1.0, 2.0)),)))


def test_a_solver_that_fails_gives_no_numbers(monkeypatch):
    ended = (Ending.FAILED, "a function gave no finite number (Invalid_Number_Detected)")
    monkeypatch.setattr(ipopt, "describe_ipopt_status", lambda _: ended)
    with raises(SolverError, "friction.solver", match="Invalid_Number"):
        fit_friction(*draw_s2(), estimator="nlp")


def test_all_mistakes_in_options_are_reported_together():
    with pytest.raises(UsageError) as refused:
        FrictionOptions(
            bounds=(("vs", (1.0, 0.1)),),
            **dict.fromkeys(("starts", "solves", "iterations"), 0),
            tolerance=1.0,
        )
    notices = refused.value.notices
    assert {notice.code for notice in notices} == {"usage.friction-option"}
    texts = [notice.text for notice in notices]
    assert len(texts) == 5
    for word in (
        "bounds of vs (1, 0.1)",
        "starts 0: must be positive",
        "tolerance 1: must be between 0 and 1",
    ):
        assert any(text.startswith(word) for text in texts), word
    assert FrictionOptions().solves == 150


STRIBECK = TABLE_3[1][:4]


def fit(name, physical, velocity, *, noise=0.5, seed=0, blur=0.0, **given):
    law = get_law(name)
    samples = draw_samples(law, physical, velocity, noise=noise, seed=seed, **given)
    if blur:
        shaken = velocity + blur * np.random.default_rng(9).standard_normal(len(velocity))
        samples = replace(samples, velocity=shaken)
    return fit_friction(samples, law)


def get_entry(estimate, name):
    return next(entry for entry in estimate.parameters if entry.name == name)


def test_a_good_log_is_not_doubted():
    for draw in (draw_s1, draw_s2):
        estimate = fit_friction(*draw())
        assert estimate.refused == ()
        assert tell(estimate.notices).keys() <= {"friction.one-direction"}
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
    extra = np.column_stack([np.cos(PHASE), velocity])
    estimate = fit("coulomb-viscous", (11.0, 20.0), velocity, extra=extra, extra_names=("J", "b"))
    assert set(dict(estimate.refused)) == {"fV", "b"}
    assert [entry.name for entry in estimate.extra] == ["J"]


def test_few_slow_samples_and_what_lies_at_or_beyond_a_bound_are_told():
    phase = PHASE[:1000]
    fast = np.sign(np.sin(phase)) * (0.2 + 0.8 * np.abs(np.sin(3.0 * phase)))
    velocity = np.concatenate([fast, np.tile([0.01, -0.02], 5)])
    assert "friction.few-slow" in tell(fit("stribeck", STRIBECK, velocity).notices)
    assert "friction.beyond-bound" in tell(fit("coulomb-viscous", (11.0, -2.0), build_cosines(0.5)).notices)
    samples = draw_samples(get_law("stribeck-8"), STRIBECK, build_cosines(0.1, 1.0), noise=0.1)
    estimate = fit_friction(samples, get_law("stribeck-exponent"))
    assert "friction.at-bound" in tell(estimate.notices)
    entry = get_entry(estimate, "gamma")
    assert entry.value == pytest.approx(4.0)
    assert "upper bound" in entry.reason
    # So is a search that was cut short.
    options = FrictionOptions(solves=52)
    estimate = fit_friction(*draw_s2(), options=options)
    assert estimate.outcome is Ending.LIMIT
    assert "friction.outcome" in tell(estimate.notices)


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


@pytest.mark.parametrize("code", ["friction.one-direction", "friction.few-slow"])
def test_the_direction_and_the_slow_ones_are_counted_among_rows(code):
    velocity, law = build_cosines(0.1, 1.0), get_law("stribeck")
    kept = np.flatnonzero(velocity > 0.0 if code == "friction.one-direction" else np.abs(velocity) > 0.048)
    samples = draw_samples(law, STRIBECK, velocity, noise=0.1, reduce=lambda columns: columns[kept])
    options = FrictionOptions(bounds=(("vs", (0.02, 0.0243)),))
    assert code in tell(fit_friction(samples, law, options=options).notices)
    whole = draw_samples(law, STRIBECK, velocity, noise=0.1)
    assert code not in tell(fit_friction(whole, law, options=options).notices)


def test_a_value_that_a_bound_holds_is_told():
    law = get_law("coulomb-viscous")
    samples = draw_samples(law, (11.0, -2.0), build_cosines(0.5), noise=0.1)
    estimate = fit_friction(samples, law, estimator="nlp")
    assert "lower bound, 0:" in get_entry(estimate, "fV").reason
    assert "friction.at-bound" in tell(estimate.notices)
    assert get_entry(estimate, "fC").reason == ""
    law = get_law("stribeck")
    samples = draw_samples(law, (11.0, -3.0, 0.03, 20.0), build_cosines(0.1, 1.0), noise=0.1)
    entry = get_entry(fit_friction(samples, law, estimator="nlp"), "fS")
    assert entry.value == pytest.approx(0.0, abs=1e-6)
    assert "lower bound" in entry.reason
    # Without bounds nothing holds it, and that it lies beyond is told.
    assert "friction.beyond-bound" in tell(fit_friction(samples, law).notices)


@pytest.mark.parametrize(
    ("drawn", "values", "noise", "printed"),
    [
        (draw_s1(count=500, peak=0.1), TABLE_1, np.sqrt(251.0 / 500), (0.46, 0.12, 0.0010, 5.0)),
        (draw_s1(count=500, peak=0.5), TABLE_1, np.sqrt(251.0 / 500), (0.094, 0.223, 0.0012, 0.254)),
        (draw_s1(count=1000, peak=0.3), TABLE_1, np.sqrt(251.0 / 1000), (0.057, 0.087, 0.0005, 0.249)),
        (draw_s2(1), TABLE_3[1], NOISE_S2[1], (0.039, 0.21, 0.0004, 0.069, 0.022, 0.0001)),
        (draw_s2(2), TABLE_3[2], NOISE_S2[2], (0.17, 1.68, 0.0005, 0.32, 0.11, 0.0001)),
        (draw_s2(3), TABLE_3[3], NOISE_S2[3], (0.07, 1.22, 0.0007, 0.13, 0.045, 0.0001)),
    ],
)
def test_the_bound_of_the_protocols_is_the_printed_one(drawn, values, noise, printed):
    """Printed with one to three digits."""
    bound = compute_cramer_rao(*drawn, values, float(noise))
    np.testing.assert_allclose(bound, printed, rtol=0.1 if values is TABLE_1 else 0.05, atol=6e-5)


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


PLAIN_LAW = get_law("coulomb-viscous-offset")
PLAIN = (1.8, 1.1, 0.2)


def build_samples(noise, runs=1):
    time = np.arange(len(noise)) / 100.0
    velocity = 0.4 * np.sin(2.0 * np.pi * time / 2.0)
    torque = np.column_stack([np.sign(velocity), velocity, np.ones(len(time))]) @ PLAIN + noise
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
    estimate = fit_friction(samples, PLAIN_LAW)
    deviation, freedom = compute_robust_deviations(samples, PLAIN_LAW, estimate)[0]["offset"]
    # The variance of the mean of n such numbers is sigma^2 / n (1 + a) / (1 - a), a = 0.9.
    assert deviation == pytest.approx(0.1 / np.sqrt(20000) * np.sqrt(19.0), rel=0.15)
    # Where blocks scatter most, they are what the deviation rests on.
    assert 20 * runs - 1 <= freedom < 1.3 * 20000 / 19.0
    memory = estimate_pattern_covariance(samples, PLAIN_LAW, estimate).memory
    assert np.sqrt(memory[2, 2]) == pytest.approx(0.1 / np.sqrt(20000) * np.sqrt(19.0), rel=0.1)
    (notice,) = warn_of_friction_pattern(samples, PLAIN_LAW, estimate)
    assert notice.code == "friction.pattern"
    assert "offset" in notice.text


def test_scatter_over_many_draws_is_the_deviation_stated():
    found, stated = [], []
    for seed in range(60):
        samples = build_samples(0.1 * remember(0.97, 2000, seed))
        estimate = fit_friction(samples, PLAIN_LAW)
        found.append([entry.value for entry in estimate.parameters])
        stated.append([std for std, _ in compute_robust_deviations(samples, PLAIN_LAW, estimate)[0].values()])
    ratio = np.sqrt(np.mean(np.square(stated), axis=0)) / np.std(found, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.6))


def test_white_noise_keeps_the_stated_deviations():
    samples = build_samples(0.1 * remember(0.0, 2000))
    estimate = fit_friction(samples, PLAIN_LAW)
    stated = {entry.name: entry.std for entry in estimate.parameters}
    for name, (deviation, freedom) in compute_robust_deviations(samples, PLAIN_LAW, estimate)[0].items():
        assert 1.0 <= deviation / stated[name] < 1.5
        assert 10.0 < freedom < 2000.0
    assert warn_of_friction_pattern(samples, PLAIN_LAW, estimate) == ()
    # A fit to the last bit has no pattern either.
    exact = build_samples(np.zeros(2000))
    assert warn_of_friction_pattern(exact, PLAIN_LAW, fit_friction(exact, PLAIN_LAW)) == ()
