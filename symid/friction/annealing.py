"""A genetic algorithm whose candidates are annealed, on the shared objective, our own reference design.

FrictionProblem, generator -> FrictionSearch.

    crossover and survival as in `genetic`, then each candidate x gets a neighbour x' and moves there
    if dJ < 0 or u < exp(-dJ / T),    T_0 = J_max - J_min of the first generation,    T_g+1 = cooling T_g

Metropolis et al., J. Chem. Phys. 21 (1953) 1087; Kirkpatrick, Gelatt, Vecchi, Science 220 (1983) 671-680.
The best candidate never moves uphill. A generation costs two evaluations a candidate; fewer generations are
needed.

Supported: every law; the same generator state gives the same result.
Not supported: a proof of having found the optimum.
"""

import numpy as np

from symid.friction.genome import (
    Genome,
    close_search,
    find_children,
    find_spread,
    find_survivors,
    find_winners,
)
from symid.friction.options import AnnealingOptions
from symid.friction.problem import FrictionProblem
from symid.friction.search import FrictionSearch

__all__ = ["search_by_annealing"]


def search_by_annealing(
    problem: FrictionProblem, options: AnnealingOptions, generator: np.random.Generator
) -> FrictionSearch:
    """Return the best candidate of the last generation.

    Args:
        problem: of one joint.
        options: population, widths of crossover and neighbours, cooling, stop rule.
        generator: of all random numbers.
    """
    genome = Genome(problem)
    genes = generator.random((options.population * genome.size, genome.size))
    objectives = genome.find_objectives(genes)
    history = [float(np.min(objectives))]
    temperature = float(np.max(objectives)) - history[0]
    settled = False
    while not settled and len(history) <= options.generations:
        parents = genes[find_winners(objectives, generator)]
        children = find_children(genes, parents, options.width, generator)
        genes, objectives = find_survivors(genes, objectives, children, genome.find_objectives(children))
        neighbours = find_children(genes, genes, options.step, generator)
        reached = genome.find_objectives(neighbours)
        rise = reached - objectives
        chance = np.exp(-np.maximum(rise, 0.0) / max(temperature, 1e-300))
        accepted = generator.random(len(genes)) < chance
        # Survivors stand in order: the first is the best.
        accepted[0] = rise[0] < 0.0
        genes = np.where(accepted[:, None], neighbours, genes)
        objectives = np.where(accepted, reached, objectives)
        temperature *= options.cooling
        history.append(float(np.min(objectives)))
        settled = find_spread(objectives) <= options.tolerance
    settings = (("population", len(genes)), ("width", options.width), ("cooling", options.cooling))
    return close_search(
        genome,
        genes,
        objectives,
        history=history,
        tolerance=options.tolerance,
        settings=settings,
        settled=settled,
    )
