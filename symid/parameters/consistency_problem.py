"""The nearest positive definite matrices under linear equations: the problem and its solution.

Input: rows of linear equations over blocks (symmetric 4 x 4), positive and free numbers, all scaled so that
the point to stay near is one (the unit matrix, 1, 0). Output: `Problem`, `Solution`.

    minimise  f = sum w (tr Q - log det Q - 4) + sum w (u - log u - 1) + sum w v^2 / 2
    subject to  tr X_i Q + a_i u + c_i v = b_i,

or, where slack_i > 0, with (what equation i lacks)^2 / (2 slack_i) added to f instead. f is convex, so the
optimum is where, with one multiplier nu_i an equation (Boyd and Vandenberghe 2004, Convex Optimization, 5.5),

    Q^-1 = 1 + S / w,  S = sum nu_i X_i,    1 / u = 1 + a nu / w,    v = -c nu / w,
    and what equation i lacks is -slack_i nu_i.

Supported: a few hundred equations, dense.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray

__all__ = ["Problem", "Solution", "flatten", "unflatten"]

_UPPER = np.triu_indices(4)
_FACTORS = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Equations and weights.

    Args:
        blocks: (m, n, 4, 4) symmetric X_i; positive: (m, p) a_i; free: (m, f) c_i.
        target: (m,) b; slack: (m,) all positive, or all zero where the equations must hold.
        weights: (n + p + f,) w of the blocks, the positive and the free numbers.
    """

    blocks: FloatArray
    positive: FloatArray
    free: FloatArray
    target: FloatArray
    slack: FloatArray
    weights: FloatArray

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parts of an array (n + p + f,) that belong to blocks, positive and free numbers."""
        first = self.blocks.shape[1]
        second = first + self.positive.shape[1]
        return values[:first], values[first:second], values[second:]

    def gather(self, multipliers: FloatArray) -> FloatArray:
        """Return S (n, 4, 4), the blocks times their multipliers."""
        total: FloatArray = np.einsum("i,injk->njk", multipliers, self.blocks)
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The optimum: `blocks` Q, `positive` u, `free` v, `multipliers` nu, number of steps.

    `stationarity` is the largest relative error in the conditions of optimality.
    """

    blocks: FloatArray
    positive: FloatArray
    free: FloatArray
    multipliers: FloatArray
    stationarity: float
    iterations: int


def flatten(matrices: FloatArray) -> FloatArray:
    """Return symmetric matrices (..., 4, 4) as vectors (..., 10) with the same scalar product."""
    flat: FloatArray = matrices[..., _UPPER[0], _UPPER[1]] * _FACTORS
    return flat


def unflatten(vectors: FloatArray) -> FloatArray:
    """Return symmetric matrices (n, 4, 4) from vectors (n, 10); see `flatten`."""
    matrices = np.zeros((len(vectors), 4, 4))
    matrices[:, _UPPER[0], _UPPER[1]] = vectors / _FACTORS
    return matrices + np.triu(matrices, 1).transpose(0, 2, 1)
