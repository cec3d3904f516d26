"""What the estimators of friction may be told, one frozen record each.

Input: numbers. Output: `FrictionOptions`.

Supported: bounds of shape values, effort, tolerances.
Not supported: weights of single samples.
"""

import math
from dataclasses import dataclass, field

from symid.errors import Notice, UsageError

__all__ = [
    "AnnealingOptions",
    "EvolutionOptions",
    "FrictionNlpOptions",
    "FrictionOptions",
    "GeneticOptions",
    "RootFindingOptions",
    "VariableProjectionOptions",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class VariableProjectionOptions:
    """Of variable projection.

    Args:
        grid: values tried of the shape, spaced by equal factors, with one, two and three unknowns:
            so many of each unknown.
        starts: of the least values on the grid that are not neighbours, so many are followed.
        solves: linear problems at most, of all kinds together.
        tolerance: relative step in the shape at which the search ends.
    """

    grid: tuple[tuple[int, ...], ...] = ((24,), (8, 6), (5, 4, 3))
    starts: int = 3
    solves: int = 150
    tolerance: float = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class RootFindingOptions:
    """Of root finding: values of the shape scanned for changes of sign, relative tolerance of a root."""

    points: int = 80
    tolerance: float = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionNlpOptions:
    """Of the constrained problem: starts, Ipopt's tolerance on the scaled problem, iterations a start."""

    starts: int = 6
    tolerance: float = 1e-9
    iterations: int = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneticOptions:
    """Of the genetic algorithm.

    On 200 draws of protocol S1 (500 samples, four unknowns) it ended within 1e-6 of the optimum each time,
    after 4200 evaluations, 65 generations and 20 ms on average. A population of 60, roulette selection,
    crossover of pairs and Gaussian mutation of single genes (18060 evaluations) stop up to three times above
    it: their steps do not follow the narrow valley in which Coulomb and viscous friction trade off.

    Args:
        population: candidates per unknown.
        width: of the crossover, in deviations of the population; below 0.8 it converges too soon.
        generations: at most.
        tolerance: (worst - best) / best of the population at which the search ends.
    """

    population: int = 16
    width: float = 0.95
    generations: int = 400
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnealingOptions:
    """Of the hybrid of genetic algorithm and simulated annealing.

    On 200 draws of protocol S1 it ended within 1e-6 of the optimum each time, after 53 generations (the
    genetic algorithm takes 65), 5200 evaluations and 26 ms on average; cooling by 0.95 takes half as many
    generations again, for the temperature then stays above the differences that matter.

    Args:
        population: candidates per unknown.
        width: of the crossover; step: of the neighbours, both in deviations of the population.
        cooling: factor of the temperature from one generation to the next.
        generations: at most.
        tolerance: (worst - best) / best of the population at which the search ends.
    """

    population: int = 12
    width: float = 0.95
    step: float = 0.8
    cooling: float = 0.6
    generations: int = 400
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class EvolutionOptions:
    """Of SciPy's differential evolution.

    With its default strategy, best1bin with recombination 0.7, 4 of 40 draws of protocol S1 ended at more
    than three times the optimum; with these, none did, after 4700 evaluations on average.

    Args:
        population: candidates per unknown.
        strategy, recombination: SciPy's.
        generations: at most.
        tolerance: deviation over mean of the objectives at which the search ends.
    """

    population: int = 15
    strategy: str = "randtobest1bin"
    recombination: float = 0.9
    generations: int = 1000
    tolerance: float = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionOptions:
    """All of them, and what they share.

    Args:
        bounds: (name, (least, greatest)) of shape values; equal where a value is fixed. Without an entry
            the law's own bounds hold, and for velocities those that the samples can tell.
        reach: bounded searches try linear parameters up to the one whose column alone would reach so many
            times the largest torque.
        seed: of a stochastic search that is given no generator.
    """

    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    reach: float = 3.0
    seed: int = 0
    variable_projection: VariableProjectionOptions = field(default_factory=VariableProjectionOptions)
    root_finding: RootFindingOptions = field(default_factory=RootFindingOptions)
    nlp: FrictionNlpOptions = field(default_factory=FrictionNlpOptions)
    genetic: GeneticOptions = field(default_factory=GeneticOptions)
    annealing: AnnealingOptions = field(default_factory=AnnealingOptions)
    evolution: EvolutionOptions = field(default_factory=EvolutionOptions)

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            UsageError: with all that is wrong.
        """
        mistakes = [
            f"bounds of {name} ({low:g}, {high:g}): must be finite, the least first"
            for name, (low, high) in self.bounds
            if not -math.inf < low <= high < math.inf
        ]
        if not 0.0 < self.reach < math.inf:
            mistakes.append(f"reach {self.reach:g}: must be a positive number")
        for part, name, least in _COUNTS:
            value = getattr(getattr(self, part), name)
            if value < least:
                mistakes.append(f"{part}.{name} {value}: must be {least} or more")
        for part in _PARTS:
            value = getattr(self, part).tolerance
            if not 0.0 < value < 1.0:
                mistakes.append(f"{part}.tolerance {value:g}: must lie between 0 and 1")
        if not 0.0 < self.annealing.cooling < 1.0:
            mistakes.append(f"annealing.cooling {self.annealing.cooling:g}: must lie between 0 and 1")
        for part, name in (("genetic", "width"), ("annealing", "width"), ("annealing", "step")):
            value = getattr(getattr(self, part), name)
            if not 0.0 < value < math.inf:
                mistakes.append(f"{part}.{name} {value:g}: must be a positive number")
        if any(count < 2 for counts in self.variable_projection.grid for count in counts):
            mistakes.append("variable_projection.grid: must be two or more of each unknown")
        if mistakes:
            raise UsageError(*(Notice(code="usage.friction-option", text=text) for text in mistakes))


_PARTS = ("variable_projection", "root_finding", "nlp", "genetic", "annealing", "evolution")
_COUNTS = (
    ("variable_projection", "starts", 1),
    ("variable_projection", "solves", 1),
    ("root_finding", "points", 3),
    ("nlp", "starts", 1),
    ("nlp", "iterations", 1),
    ("genetic", "population", 4),
    ("genetic", "generations", 1),
    ("annealing", "population", 4),
    ("annealing", "generations", 1),
    ("evolution", "population", 2),
    ("evolution", "generations", 1),
)
