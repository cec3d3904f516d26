"""Searches between bounds: the optimum, counts, the same bits again; derivatives of the constrained one."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.friction.problem import (
    EvolutionOptions,
    FrictionNlpOptions,
    FrictionOptions,
    GeneticOptions,
    build_problem,
)
from symid.identification.friction.searches import (
    build_nlp,
    search_by_evolution,
    search_by_nlp,
    search_by_population,
    search_by_projection,
)
from symid.ipopt import Ending
from symid.joint_models.friction_catalogue import get_law
from tests.frictions import build_cosines, draw_s1, draw_s2, draw_samples

OPTIONS = FrictionOptions()
SEARCHES = {
    "genetic": (search_by_population, GeneticOptions()),
    "annealing": (search_by_population, OPTIONS.annealing),
    "evolution": (search_by_evolution, EvolutionOptions()),
}
each_search = pytest.mark.parametrize("name", sorted(SEARCHES))


@each_search
@pytest.mark.parametrize("draw", [draw_s1, draw_s2])
def test_the_optimum_is_found(name, draw):
    problem = build_problem(*draw(), OPTIONS)
    find, options = SEARCHES[name]
    search = find(problem, options, np.random.default_rng(5))
    best = search_by_projection(problem, OPTIONS.variable_projection)
    assert best.objective <= search.objective * (1.0 + 1e-9)
    assert search.objective <= best.objective * (1.0 + 1e-5)
    assert search.outcome is Ending.STAGNATED
    found = problem.compute_objectives(np.array([search.linear]), np.array([search.shape]))
    assert search.objective == pytest.approx(float(found[0]), rel=1e-12)
    # Too few generations are told.
    end = find(problem, replace(options, generations=3), np.random.default_rng(0))
    assert end.outcome is Ending.LIMIT
    assert "3 generations" in end.ended


@each_search
def test_the_history_falls_the_counts_agree_and_the_same_generator_gives_the_same_bits(name):
    problem = build_problem(*draw_s1(), OPTIONS)
    find, options = SEARCHES[name]
    search, again = (find(problem, options, np.random.default_rng(1)) for _ in range(2))
    assert (search.linear, search.history) == (again.linear, again.history)
    assert np.all(np.diff(search.history) <= 0.0)
    assert search.history[-1] == pytest.approx(search.objective)
    population = dict(search.settings)["population"]
    rounds = {"genetic": 1, "annealing": 2, "evolution": 1}[name]
    assert search.evaluations == population * (1 + rounds * search.iterations)
    assert search.solves == 0


NLP = FrictionNlpOptions()


def thin(columns):
    return 0.5 * (columns[:-1:2] + columns[1::2])


def build(name, physical):
    law = get_law(name)
    velocity = np.concatenate([build_cosines(0.1, 1.0, count=100), [0.0, 0.0]])
    extra = np.column_stack([np.cos(np.arange(len(velocity))), np.ones(len(velocity))])
    samples = draw_samples(
        law, physical, velocity, noise=0.3, extra=extra, extra_names=("a", "b"), reduce=thin
    )
    return build_problem(samples, law, OPTIONS)


@pytest.mark.parametrize(
    ("name", "physical"),
    [
        ("stribeck-exponent", (11.0, 20.0, 0.03, 1.7, 24.0)),
        # The samples hold rest, where a low exponent has derivatives without bound.
        ("stribeck-exponent", (11.0, 20.0, 0.03, 0.6, 24.0)),
        ("improved-stribeck-exponent", (11.6, 23.2, 0.0277, 1.7, 27.9, 0.47, 0.0101)),
        ("power-law", (5.0, 6.0, 0.6)),
        ("makkar", (4.0, 100.0, 15.0, 10.0, 300.0, 8.0)),
    ],
)
def test_derivatives_are_exact(name, physical):
    problem = build(name, physical)
    smooth, _ = build_nlp(problem, 7.0, *np.zeros((2, 0)))
    x = np.array(physical) * (1.0 + 0.01 * np.arange(len(physical)))
    linear, shape = problem.law.from_physical(list(x))
    objective = float(problem.compute_objectives(np.array([linear]), np.array([shape]))[0])
    assert smooth.value(x) == pytest.approx(objective / 7.0, rel=1e-12)
    gradient, hessian = smooth.gradient(x), smooth.hessian(x)
    for place in range(len(x)):
        step = 1e-6 * x[place] * np.eye(len(x))[place]
        rise, turn = (
            (function(x + step) - function(x - step)) / (2e-6 * x[place])
            for function in (smooth.value, smooth.gradient)
        )
        assert gradient[place] == pytest.approx(rise, rel=1e-5, abs=1e-6)
        np.testing.assert_allclose(hessian[place], turn, rtol=1e-4, atol=1e-6 * np.abs(hessian).max())


@pytest.mark.parametrize("draw", [draw_s1, draw_s2])
def test_the_optimum_is_that_of_variable_projection(draw):
    problem = build_problem(*draw(), OPTIONS)
    search = search_by_nlp(problem, NLP)
    best = search_by_projection(problem, OPTIONS.variable_projection)
    assert search.objective == pytest.approx(best.objective, rel=1e-6)
    assert search.outcome is Ending.CONVERGED
    assert dict(search.settings)["agreeing"] >= 1
    # The limit of iterations is told.
    search = search_by_nlp(problem, replace(NLP, starts=1, iterations=1))
    assert search.outcome is Ending.LIMIT
    assert "Maximum_Iterations_Exceeded" in search.ended


def test_static_friction_is_not_forced_above_coulomb_friction():
    law = get_law("stribeck")
    samples = draw_samples(law, (11.0, 8.0, 0.03, 20.0), build_cosines(0.1, 1.0), noise=0.1)
    search = search_by_nlp(build_problem(samples, law, OPTIONS), NLP)
    np.testing.assert_allclose(law.to_physical(search.linear, search.shape)[:2], (11.0, 8.0), atol=0.2)
