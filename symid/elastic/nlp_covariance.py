"""How uncertain the dynamics of the one-shot problem are, with those of the springs counted in.

NlpCost, optimum, slopes of the residuals by places of stops and knees -> covariance of chi.

    H^-1 (sum_b g_b g_b') H^-1,  H = sum J'J / sigma^2,  g_b = sum over rows of block b of J'r / sigma^2

b runs over stretches of time; rows of all kinds within one share the same noise (Liang and Zeger 1986).
Places of stops and knees that the data chose count as unknown: the same cost places them (`nlp_places`).

Supported: unknowns at bounds and unknowns without effect: they count as known.
Not supported: doubt about the number of stops and knees.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.elastic.nlp_cost import NlpCost

__all__ = ["NlpEquations", "find_equations", "find_nlp_covariance"]

_STRETCHES = 100
_NEAR = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpEquations:
    """Normal equations of unknowns x and of places behind them: s = len(x) + places.

    Args:
        curvature: (s, s) sum of J'J / sigma^2.
        scores: (stretches, s) sums of J'r / sigma^2 over stretches of time.
        free: which of them have an effect and stand at no bound.
    """

    curvature: FloatArray
    scores: FloatArray
    free: NDArray[np.intp]

    def find_step(self) -> FloatArray:
        """Return -H^-1 g (s,), zero where nothing is free."""
        inverse, lengths = self._invert()
        step = np.zeros(len(self.curvature))
        step[self.free] = -(inverse @ (self.scores.sum(axis=0)[self.free] / lengths)) / lengths
        return step

    def find_covariance(self) -> FloatArray:
        """Return H^-1 (sum_b g_b g_b') H^-1 (s, s), zero where nothing is free."""
        inverse, lengths = self._invert()
        spread = (self.scores[:, self.free] / lengths) @ inverse / lengths
        covariance = np.zeros_like(self.curvature)
        covariance[np.ix_(self.free, self.free)] = spread.T @ spread
        return covariance

    def _invert(self) -> tuple[FloatArray, FloatArray]:
        """Return the inverse with scaled unknowns, and their scales."""
        lengths = np.sqrt(np.diag(self.curvature))[self.free]
        scaled = self.curvature[np.ix_(self.free, self.free)] / np.outer(lengths, lengths)
        return np.linalg.pinv(scaled, rcond=1e-10, hermitian=True), lengths


def find_nlp_covariance(
    cost: NlpCost, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()
) -> FloatArray:
    """Return the covariance (p + n + pf, p + n + pf) of the dynamic parameters at the optimum `x`.

    Args:
        cost: the problem.
        x: its unknowns.
        places: for each stop or knee, the derivative of every block's residuals by its place (M_b,).
    """
    dynamics = cost.layout.dynamics
    return find_equations(cost, x, places).find_covariance()[dynamics, dynamics]


def find_equations(cost: NlpCost, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()) -> NlpEquations:
    """Return the normal equations at `x`; arguments as those of `find_nlp_covariance`."""
    state = cost.find_state(x)
    size = len(x) + len(places)
    curvature, scores = np.zeros((size, size)), []
    entries = iter(zip(state.residuals, state.places, state.jacobians, cost.sigmas, strict=True))
    number = 0
    for part in cost.recordings:
        score = np.zeros((_STRETCHES, size))
        for _ in part.blocks:
            residual, known, jacobian, sigma = next(entries)
            rows = np.zeros((len(residual), size))
            rows[:, known] = jacobian
            for column, slopes in enumerate(places, start=len(x)):
                rows[:, column] = slopes[number]
            curvature += rows.T @ rows / sigma**2
            stretch = (np.arange(len(residual)) * _STRETCHES) // len(residual)
            np.add.at(score, stretch, rows * (residual / sigma**2)[:, None])
            number += 1
        scores.append(score)
    free = _find_free(cost, x, np.sqrt(np.diag(curvature)))
    return NlpEquations(curvature=curvature, scores=np.vstack(scores), free=np.flatnonzero(free))


def _find_free(cost: NlpCost, x: FloatArray, lengths: FloatArray) -> NDArray[np.bool_]:
    """Return which unknowns, places of stops and knees behind them, have an effect and stand at no bound."""
    layout = cost.layout
    reach = np.maximum(np.abs(x), 1e-12)
    inside: NDArray[np.bool_] = (x - layout.lower > _NEAR * reach) & (layout.upper - x > _NEAR * reach)
    places = np.ones(len(lengths) - len(x), dtype=bool)
    return np.concatenate([inside, places]) & (lengths > 0.0)
