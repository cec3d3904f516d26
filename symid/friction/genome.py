"""What evolving searches share: candidates as points of a unit box, their objective, their variation.

FrictionProblem -> Genome.

A candidate is (linear, shape), each coordinate between its bounds, positive shape values by their logarithm,
all mapped onto [0, 1]. What multiplies the columns beside friction is eliminated by the problem, not
searched.

Supported: fixed shape values, which are no part of a candidate.
Not supported: the linear part by least squares, which would leave nothing to search (`variable_projection`).
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.friction.estimate import FrictionOutcome
from symid.friction.problem import FrictionProblem
from symid.friction.search import FrictionSearch

__all__ = ["Genome", "close_search", "find_children", "find_spread", "find_survivors", "find_winners"]


class Genome:
    """Candidates of a problem and their objective, counted."""

    def __init__(self, problem: FrictionProblem) -> None:
        """Keep the problem and its box."""
        self.problem, self.evaluations = problem, 0
        self.free = np.flatnonzero(problem.is_free)
        low, high = problem.encode(problem.low), problem.encode(problem.high)
        self.fixed = low
        self.low = np.concatenate([problem.lower, low[self.free]])
        self.high = np.concatenate([problem.upper, high[self.free]])

    @property
    def size(self) -> int:
        """Return d, the number of coordinates."""
        return len(self.low)

    def express(self, genes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return linear (P, p) and shape (P, s) of genes (P, d)."""
        values = self.low + np.clip(genes, 0.0, 1.0) * (self.high - self.low)
        count = len(self.problem.lower)
        z = np.tile(self.fixed, (len(genes), 1))
        z[:, self.free] = values[:, count:]
        return values[:, :count], self.problem.decode(z)

    def find_objectives(self, genes: FloatArray) -> FloatArray:
        """Return J (P,) of genes (P, d)."""
        self.evaluations += len(genes)
        return self.problem.find_objectives(*self.express(genes))


def find_spread(objectives: FloatArray) -> float:
    """Return (worst - best) / best of objectives (P,); zero where all are zero."""
    best, worst = float(np.min(objectives)), float(np.max(objectives))
    return (worst - best) / best if best > 0.0 else float(worst > 0.0)


def find_children(genes: FloatArray, parents: FloatArray, width: float, generator: Generator) -> FloatArray:
    """Return a child of each parent by a crossover of all: (P, d), mirrored at the box's faces.

    child = parent + width / sqrt(P) sum_k w_k (x_k - mean), w_k standard normal: the steps have the
    population's own covariance, so that valleys in any direction are followed.

    Args:
        genes: the population x (P, d).
        parents: (P, d).
        width: of the steps in deviations of the population.
        generator: of the weights.
    """
    count = len(genes)
    weights = generator.standard_normal((len(parents), count)) * (width / np.sqrt(count))
    children = np.abs(parents + weights @ (genes - np.mean(genes, axis=0)))
    mirrored: FloatArray = 1.0 - np.abs(1.0 - np.clip(children, 0.0, 2.0))
    return mirrored


def find_winners(objectives: FloatArray, generator: Generator) -> NDArray[np.int64]:
    """Return the better one of two drawn at random, P times: indices (P,)."""
    first, second = generator.integers(len(objectives), size=(2, len(objectives)))
    winners: NDArray[np.int64] = np.where(objectives[first] <= objectives[second], first, second)
    return winners


def find_survivors(
    genes: FloatArray, objectives: FloatArray, children: FloatArray, reached: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the best P of parents and children, the best first, and their objectives."""
    both, values = np.vstack([genes, children]), np.concatenate([objectives, reached])
    kept = np.argsort(values, kind="stable")[: len(genes)]
    return both[kept], values[kept]


def close_search(
    genome: Genome,
    genes: FloatArray,
    objectives: FloatArray,
    *,
    history: list[float],
    tolerance: float,
    settings: tuple[tuple[str, float | int | str], ...],
    settled: bool,
) -> FrictionSearch:
    """Return the best of a last generation, genes (P, d) and objectives (P,), as the end of a search."""
    best = int(np.argmin(objectives))
    linear, shape = genome.express(genes[best : best + 1])
    generations = len(history) - 1
    return FrictionSearch(
        linear=linear[0],
        shape=shape[0],
        objective=float(objectives[best]),
        evaluations=genome.evaluations,
        solves=0,
        iterations=generations,
        history=tuple(history),
        outcome=FrictionOutcome.STAGNATED if settled else FrictionOutcome.LIMIT,
        ended=(
            f"worst and best candidate differ by less than {tolerance:g} of the objective"
            if settled
            else f"{generations} generations passed"
        ),
        settings=settings,
    )
