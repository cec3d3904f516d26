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
    UnitBoxProblem,
    draw_children,
    search_by_evolution,
    search_by_population,
    search_by_projection,
)
from symid.ipopt import Ending
from tests.frictions import draw_s1, draw_s2

OPTIONS = FrictionOptions()
SEARCHES = {
    "genetic": lambda problem, rng: search_by_population(problem, GeneticOptions(), rng),
    "annealing": lambda problem, rng: search_by_population(problem, OPTIONS.annealing, rng),
    "evolution": lambda problem, rng: search_by_evolution(problem, EvolutionOptions(), rng),
}
each_search = pytest.mark.parametrize("name", sorted(SEARCHES))


@each_search
@pytest.mark.parametrize("draw", [draw_s1, draw_s2])
def test_the_optimum_is_found(name, draw):
    problem = build_problem(*draw(), OPTIONS)
    search = SEARCHES[name](problem, np.random.default_rng(5))
    best = search_by_projection(problem, OPTIONS.variable_projection)
    assert best.objective <= search.objective * (1.0 + 1e-9)
    assert search.objective <= best.objective * (1.0 + 1e-5)
    assert search.outcome is Ending.STAGNATED
    found = problem.compute_objectives(np.array([search.linear]), np.array([search.shape]))
    assert search.objective == pytest.approx(float(found[0]), rel=1e-12)


@each_search
def test_the_history_falls_the_counts_agree_and_the_same_generator_gives_the_same_bits(name):
    problem = build_problem(*draw_s1(), OPTIONS)
    search, again = (SEARCHES[name](problem, np.random.default_rng(1)) for _ in range(2))
    assert (search.linear, search.history) == (again.linear, again.history)
    assert np.all(np.diff(search.history) <= 0.0)
    assert search.history[-1] == pytest.approx(search.objective)
    population = dict(search.settings)["population"]
    rounds = {"genetic": 1, "annealing": 2, "evolution": 1}[name]
    assert search.evaluations == population * (1 + rounds * search.iterations)
    assert search.solves == 0


def test_too_few_generations_are_reported():
    problem = build_problem(*draw_s1(), OPTIONS)
    rng = np.random.default_rng(0)
    ends = (
        search_by_population(problem, GeneticOptions(generations=3), rng),
        search_by_population(problem, replace(OPTIONS.annealing, generations=3), rng),
        search_by_evolution(problem, EvolutionOptions(generations=3), rng),
    )
    for end in ends:
        assert end.outcome is Ending.LIMIT
        assert "3 generations" in end.ended


def test_candidates_stay_in_the_box():
    problem = build_problem(*draw_s2(), OPTIONS)
    genome = UnitBoxProblem(problem)
    rng = np.random.default_rng(0)
    genes = rng.random((50, genome.size))
    children = draw_children(genes, genes, 5.0, rng)
    assert np.all((children >= 0.0) & (children <= 1.0))
    linear, shape = genome.express(children)
    assert np.all((linear >= problem.lower) & (linear <= problem.upper))
    assert np.all((shape >= problem.low) & (shape <= problem.high))
    # Children spread as their parents do.
    genes = 0.5 + 0.02 * rng.standard_normal((200, 2)) @ np.array([[1.0, 0.9], [0.0, 0.1]])
    children = draw_children(genes, np.tile(genes.mean(axis=0), (20000, 1)), 1.0, rng)
    np.testing.assert_allclose(np.cov(children.T), np.cov(genes.T), rtol=0.05)


