"""One interface for all estimators: the same report, the same refusals of what cannot be fitted."""

from dataclasses import replace

import numpy as np
import pytest

from symid import ipopt
from symid.errors import IdentifiabilityError, SolverError, UsageError
from symid.identification.friction.estimators import ESTIMATORS, STOCHASTIC, fit_friction
from symid.identification.friction.problem import (
    EvolutionOptions,
    FrictionNlpOptions,
    FrictionOptions,
    GeneticOptions,
    RootFindingOptions,
    VariableProjectionOptions,
    build_problem,
)
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import FRICTION_LAWS, get_law
from symid.joint_models.friction_law import compute_columns
from tests.frictions import build_cosines, draw_s1, draw_s2, draw_samples
from tests.refusals import raises

PHASE = 2.0 * np.pi * (np.arange(2000) + 0.5) / 1000


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_every_estimator_gives_the_same_report(estimator):
    samples, law = draw_s1()
    estimate = fit_friction(samples, law, estimator=estimator, generator=np.random.default_rng(2))
    best = fit_friction(samples, law)
    assert estimate.estimator == estimator
    assert best.objective <= estimate.objective * (1.0 + 1e-6)
    assert estimate.objective <= best.objective * (1.0 + 1e-5)
    assert [entry.name for entry in estimate.parameters] == ["fC", "fS", "vs", "fV"]
    for entry, other in zip(estimate.parameters, best.parameters, strict=True):
        assert abs(entry.value - other.value) < 0.1 * other.std
        assert entry.std == pytest.approx(other.std, rel=0.01)
    assert estimate.evaluations > 0
    assert (estimate.solves == 0) == (estimator in STOCHASTIC)
    assert estimate.history[-1] == pytest.approx(estimate.objective, rel=1e-6)
    assert estimate.sigma == pytest.approx(np.sqrt(251.0 / 500), rel=0.1)


@pytest.mark.parametrize("name", sorted(FRICTION_LAWS))
def test_every_law_can_be_fitted(name):
    law = FRICTION_LAWS[name]
    velocity = build_cosines(0.1, 1.0)
    given = {"load": 3.0 + 2.0 * np.cos(3.0 * PHASE), "position": np.cos(PHASE)}
    if "temperature" in law.inputs:
        given["temperature"] = 35.0 + 20.0 * np.cos(0.31 * PHASE)
    physical = [entry.start or 5.0 + place for place, entry in enumerate(law.physical)]
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


def test_an_unknown_estimator_is_refused_and_a_seed_stands_for_a_generator():
    samples, law = draw_s1()
    for name, words in (("genetics", r"mean genetic\?"), ("zzz", r"'zzz' .*varpro, root-finding")):
        with raises(UsageError, "usage.friction-estimator", match=words):
            fit_friction(samples, law, estimator=name)
    options = FrictionOptions(seed=3)
    first, second = (fit_friction(samples, law, estimator="genetic", options=options) for _ in range(2))
    assert first == second


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
            reach=0.0,
            variable_projection=VariableProjectionOptions(starts=0, solves=0, grid=((1,), (2, 2), (2, 2, 2))),
            root_finding=RootFindingOptions(points=2),
            nlp=FrictionNlpOptions(starts=0, iterations=0),
            genetic=GeneticOptions(population=1, width=0.0, generations=0),
            annealing=GeneticOptions(cooling=1.0, step=-1.0, tolerance=2.0),
            evolution=EvolutionOptions(population=1, generations=0),
        )
    notices = refused.value.notices
    assert {notice.code for notice in notices} == {"usage.friction-option"}
    words = ("bounds of vs", "reach", "starts", "solves", "grid", "points", "nlp.iterations", "genetic.width")
    for word in (*words, "cooling", "annealing.step", "annealing.tolerance", "evolution.population"):
        assert any(word in notice.text for notice in notices), word
    assert FrictionOptions().variable_projection.solves == 150
