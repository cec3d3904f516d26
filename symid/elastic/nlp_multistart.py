"""Many random starts of one problem: do they all end at the same optimum?

NlpFit, generator -> MultiStart.

Two ends are the same optimum where their objectives differ by at most 1e-6 of the least one. Every start is
accounted for: at the best optimum, at another one, or not converged with the reason.

Supported: any number of starts, one after the other.
Not supported: proof that no better optimum exists.
"""

from dataclasses import dataclass

import numpy as np

from symid.elastic.nlp import NlpFit
from symid.elastic.nlp_options import NlpOptions
from symid.elastic.nlp_solver import NlpRun, optimise_nlp
from symid.elastic.nlp_starts import find_random_start

__all__ = ["MultiStart", "optimise_from_many"]

_SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MultiStart:
    """Runs from random starts, `runs`, besides the one of the fit, `reference`."""

    reference: NlpRun
    runs: tuple[NlpRun, ...]

    @property
    def best(self) -> NlpRun:
        """Return the converged run of least objective; the reference where none converged."""
        ends = [run for run in (self.reference, *self.runs) if run.converged]
        return min(ends, key=lambda run: run.objective, default=self.reference)

    @property
    def agreeing(self) -> tuple[NlpRun, ...]:
        """Return the runs that converged to the best optimum."""
        return tuple(run for run in self.runs if run.converged and self._is_best(run))

    @property
    def others(self) -> tuple[NlpRun, ...]:
        """Return the runs that converged to another optimum."""
        return tuple(run for run in self.runs if run.converged and not self._is_best(run))

    @property
    def failed(self) -> tuple[NlpRun, ...]:
        """Return the runs that did not converge; each has its reason."""
        return tuple(run for run in self.runs if not run.converged)

    def _is_best(self, run: NlpRun) -> bool:
        least = self.best.objective
        return abs(run.objective - least) <= _SAME * abs(least)


def optimise_from_many(
    fit: NlpFit, count: int, generator: np.random.Generator, options: NlpOptions | None = None
) -> MultiStart:
    """Return the ends of `count` random feasible starts of the problem of `fit`.

    Args:
        fit: its last round's cost is minimised again.
        count: of starts.
        generator: of the starts.
        options: of the solver; None for the defaults.
    """
    options = options or NlpOptions()
    runs = []
    for _ in range(count):
        start = find_random_start(fit.cost.layout, fit.run.x, generator)
        runs.append(optimise_nlp(fit.cost, start, fit.scales, options))
    return MultiStart(reference=fit.run, runs=tuple(runs))
