"""Differential evolution of SciPy on the shared objective: a search that is not ours, to compare with.

FrictionProblem, generator -> FrictionSearch.

Storn and Price, J. Global Optim. 11 (1997) 341-359; all candidates of a generation are found at once.

Supported: every law.
Not supported: a local search at the end, which would hide how far the method itself came.
"""

import numpy as np

from symid.arrays import FloatArray
from symid.friction.estimate import FrictionOutcome
from symid.friction.genome import Genome
from symid.friction.options import EvolutionOptions
from symid.friction.problem import FrictionProblem
from symid.friction.search import FrictionSearch

__all__ = ["search_by_evolution"]


def search_by_evolution(
    problem: FrictionProblem, options: EvolutionOptions, generator: np.random.Generator
) -> FrictionSearch:
    """Return what differential evolution finds.

    Args:
        problem: of one joint.
        options: candidates per unknown, generations, spread at the end.
        generator: of all random numbers.
    """
    from scipy.optimize import differential_evolution

    genome = Genome(problem)
    history: list[float] = []

    def find_objectives(genes: FloatArray) -> FloatArray:
        objectives = genome.find_objectives(np.atleast_2d(genes.T))
        least = float(np.min(objectives))
        history.append(min(history[-1], least) if history else least)
        return objectives

    answer = differential_evolution(
        find_objectives,
        [(0.0, 1.0)] * genome.size,
        maxiter=options.generations,
        popsize=options.population,
        tol=options.tolerance,
        seed=generator,
        strategy=options.strategy,
        recombination=options.recombination,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    linear, shape = genome.express(answer.x[None, :])
    settled = bool(answer.success)
    return FrictionSearch(
        linear=linear[0],
        shape=shape[0],
        objective=float(answer.fun),
        evaluations=genome.evaluations,
        solves=0,
        iterations=int(answer.nit),
        history=tuple(history),
        outcome=FrictionOutcome.STAGNATED if settled else FrictionOutcome.LIMIT,
        ended=(
            f"the candidates' objectives differ by less than {options.tolerance:g} of their mean"
            if settled
            else f"{options.generations} generations passed"
        ),
        settings=(("population", options.population * genome.size), ("strategy", options.strategy)),
    )
