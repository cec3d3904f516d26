"""A genetic algorithm on the shared objective, our own reference design.

FrictionProblem, generator -> FrictionSearch.

    tournament of two -> crossover of all parents -> the best of parents and children survive

The crossover mixes the deviations of the whole population, so that children spread as their parents do and
follow a narrow valley in any direction; it takes the place of pairwise crossover and of mutation. Zhang, Hu
and Zou (2021) do not say how theirs works; this is not theirs.

Supported: every law; the same generator state gives the same result.
Not supported: a proof of having found the optimum (`variable_projection` needs a hundredth of the
evaluations).
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
from symid.friction.options import GeneticOptions
from symid.friction.problem import FrictionProblem
from symid.friction.search import FrictionSearch

__all__ = ["search_by_genes"]


def search_by_genes(
    problem: FrictionProblem, options: GeneticOptions, generator: np.random.Generator
) -> FrictionSearch:
    """Return the best candidate of the last generation.

    Args:
        problem: of one joint.
        options: population, width of the crossover, stop rule.
        generator: of all random numbers.
    """
    genome = Genome(problem)
    genes = generator.random((options.population * genome.size, genome.size))
    objectives = genome.find_objectives(genes)
    history = [float(np.min(objectives))]
    settled = False
    while not settled and len(history) <= options.generations:
        parents = genes[find_winners(objectives, generator)]
        children = find_children(genes, parents, options.width, generator)
        reached = genome.find_objectives(children)
        genes, objectives = find_survivors(genes, objectives, children, reached)
        history.append(float(objectives[0]))
        settled = find_spread(objectives) <= options.tolerance
    settings = (("population", len(genes)), ("width", options.width))
    return close_search(
        genome,
        genes,
        objectives,
        history=history,
        tolerance=options.tolerance,
        settings=settings,
        settled=settled,
    )
