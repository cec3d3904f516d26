"""How uncertain the dynamics of the one-shot problem are, with those of the springs counted in.

NlpCost, optimum -> covariance of chi.

    H^-1 (sum_b g_b g_b') H^-1,  H = sum J'J / sigma^2,  g_b = sum over rows of block b of J'r / sigma^2

b runs over stretches of time; rows of all kinds within one share the same noise (Liang and Zeger 1986).

Supported: unknowns at bounds and unknowns without effect: they count as known.
Not supported: positions of stops and knees; they count as known too.
"""

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.elastic.nlp_cost import NlpCost

__all__ = ["find_nlp_covariance"]

_STRETCHES = 100
_NEAR = 1e-6


def find_nlp_covariance(cost: NlpCost, x: FloatArray) -> FloatArray:
    """Return the covariance (p + n + pf, p + n + pf) of the dynamic parameters at the optimum `x`."""
    state = cost.find_state(x)
    curvature = cost.rows * cost.find_gauss_newton(state)
    lengths = np.sqrt(np.diag(curvature))
    free = np.flatnonzero(_find_free(cost, x, lengths))
    scores = np.zeros((len(cost.recordings), _STRETCHES, len(x)))
    entries = iter(zip(state.residuals, state.places, state.jacobians, cost.sigmas, strict=True))
    for number, part in enumerate(cost.recordings):
        for _ in part.blocks:
            residual, places, jacobian, sigma = next(entries)
            count = len(residual)
            stretch = (np.arange(count) * _STRETCHES) // max(count, 1)
            share = np.zeros((_STRETCHES, len(places)))
            np.add.at(share, stretch, jacobian * (residual / sigma**2)[:, None])
            scores[number][:, places] += share
    scaled = curvature[np.ix_(free, free)] / np.outer(lengths[free], lengths[free])
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
    spread = (scores.reshape(-1, len(x))[:, free] / lengths[free]) @ inverse / lengths[free]
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(free, free)] = spread.T @ spread
    dynamics = cost.layout.dynamics
    return covariance[dynamics, dynamics]


def _find_free(cost: NlpCost, x: FloatArray, lengths: FloatArray) -> NDArray[np.bool_]:
    """Return which unknowns (x,) have an effect and stand at no bound."""
    layout = cost.layout
    reach = np.maximum(np.abs(x), 1e-12)
    inside: NDArray[np.bool_] = (x - layout.lower > _NEAR * reach) & (layout.upper - x > _NEAR * reach)
    return inside & (lengths > 0.0)
