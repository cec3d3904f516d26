"""Genetic algorithm, annealing hybrid, differential evolution: optimum, counts, the same bits again."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.friction.problem import (
    EvolutionOptions,
    FrictionOptions,
    GeneticOptions,
    build_problem,
)
from symid.identification.friction.searches import (
    search_by_evolution,
    search_by_population,
    search_by_projection,
)
from symid.ipopt import Ending
from tests.frictions import draw_s1, draw_s2

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
