"""How uncertain the dynamics of the one-shot problem are, with those of the springs counted in.

NlpCost, optimum, slopes of the residuals by places of stops and knees -> covariance of chi.

    H^-1 (sum_b g_b g_b') H^-1,  H = sum J'J / sigma^2,  g_b = sum over rows of block b of J'r / sigma^2

b runs over stretches of time; rows of all kinds within one share the same noise (Liang and Zeger 1986). The
places of stops and knees are no unknowns of the problem, but came from the same data: they count as unknown.

Supported: unknowns at bounds and unknowns without effect: they count as known.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.elastic.nlp_cost import NlpCost

__all__ = ["find_nlp_covariance"]

_STRETCHES = 100
_NEAR = 1e-6


def find_nlp_covariance(
    cost: NlpCost, x: FloatArray, places: Sequence[Sequence[FloatArray]] = ()
) -> FloatArray:
    """Return the covariance (p + n + pf, p + n + pf) of the dynamic parameters at the optimum `x`.

    Args:
        cost: the problem.
        x: its unknowns.
        places: for each stop or knee, the derivative of every block's residuals by its place (M_b,).
    """
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
    lengths = np.sqrt(np.diag(curvature))
    free = np.flatnonzero(_find_free(cost, x, lengths))
    scaled = curvature[np.ix_(free, free)] / np.outer(lengths[free], lengths[free])
    inverse = np.linalg.pinv(scaled, rcond=1e-10, hermitian=True)
    spread = (np.vstack(scores)[:, free] / lengths[free]) @ inverse / lengths[free]
    covariance = np.zeros((size, size))
    covariance[np.ix_(free, free)] = spread.T @ spread
    dynamics = cost.layout.dynamics
    return covariance[dynamics, dynamics]


def _find_free(cost: NlpCost, x: FloatArray, lengths: FloatArray) -> NDArray[np.bool_]:
    """Return which unknowns, places of stops and knees behind them, have an effect and stand at no bound."""
    layout = cost.layout
    reach = np.maximum(np.abs(x), 1e-12)
    inside: NDArray[np.bool_] = (x - layout.lower > _NEAR * reach) & (layout.upper - x > _NEAR * reach)
    places = np.ones(len(lengths) - len(x), dtype=bool)
    return np.concatenate([inside, places]) & (lengths > 0.0)
