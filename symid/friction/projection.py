"""The linear part of a friction law at one shape, by least squares, and what J does as the shape changes.

FrictionProblem, shape -> Projection.

    J(s) = |P(s) y|^2,   P = 1 - Phi Phi^+        (what multiplies the columns is Phi^+ y)
    dr/ds ~ -P dPhi/ds c                            (Kaufman's Jacobian; its gradient of J is exact)

Supported: dependent columns (least norm), columns that have all but vanished.
Not supported: bounds of linear parameters (`nlp`).
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.friction.problem import FrictionProblem

__all__ = ["Projection", "Projector"]

_DEPENDENT = 1e-11
_VANISHED = 1e-9
_BESIDE = 1e-10
"""Step in a coordinate to the side of a kink."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """The linear problem at one shape: J, residual (M,), linear (p,), basis of the columns (M, r)."""

    z: FloatArray
    shape: FloatArray
    objective: float
    residual: FloatArray
    linear: FloatArray
    basis: FloatArray


class Projector:
    """Solves linear problems and counts them."""

    def __init__(self, problem: FrictionProblem, limit: int) -> None:
        """Keep the problem; `limit` is the most that may be solved."""
        self.problem, self.limit, self.solves, self.evaluations = problem, limit, 0, 0
        self.reserve = 0

    @property
    def exhausted(self) -> bool:
        """Return whether less is left, beside what is kept in reserve, than a step with its trial takes."""
        return self.solves + 2 + self.reserve > self.limit

    def project(self, z: FloatArray) -> Projection:
        """Return the least-squares solution at coordinates z (s,), of least norm in scaled columns."""
        self.solves += 1
        self.evaluations += 1
        shape = self.problem.decode(z)
        columns = self.problem.find_columns(shape)
        lengths = np.linalg.norm(columns, axis=0)
        # A column that has all but vanished would get a parameter beyond all numbers.
        gone = lengths <= _VANISHED * max(float(np.max(lengths)), 1e-300)
        columns = np.where(gone, 0.0, columns)
        lengths[gone] = 1.0
        orthonormal, upper = np.linalg.qr(columns / lengths)
        left, singular, right = np.linalg.svd(upper)
        rank = int(np.sum(singular > _DEPENDENT * max(float(singular[0]), 1e-300)))
        basis = orthonormal @ left[:, :rank]
        parts = basis.T @ self.problem.target
        residual = self.problem.target - basis @ parts
        return Projection(
            z=self.problem.encode(shape),
            shape=shape,
            objective=float(residual @ residual),
            residual=residual,
            linear=(right[:rank].T @ (parts / singular[:rank])) / lengths,
            basis=basis,
        )

    def find_jacobian(self, state: Projection) -> FloatArray:
        """Return Kaufman's Jacobian by the coordinates z: (M, s)."""
        rates = self.problem.find_rates(state.shape, state.linear)
        rates = rates * np.where(self.problem.is_logarithmic > 0.0, state.shape, 1.0)
        jacobian: FloatArray = state.basis @ (state.basis.T @ rates) - rates
        return jacobian

    def find_side_gain(self, state: Projection, place: int, side: float) -> float:
        """Return how much less J would be at the least of its parabola on one side of a shape value.

        A kink of J has two slopes; `side` is 1.0 or -1.0. Zero where J does not fall to that side, or where
        the search ends there.
        """
        z = np.array(state.z)
        z[place] += side * _BESIDE
        ends = self.problem.encode(self.problem.low)[place], self.problem.encode(self.problem.high)[place]
        if not ends[0] <= z[place] <= ends[1]:
            return 0.0
        shape = self.problem.decode(z)
        rate = self.problem.find_rates(shape, state.linear)[:, place]
        rate = rate * (shape[place] if self.problem.is_logarithmic[place] else 1.0)
        rate = rate - state.basis @ (state.basis.T @ rate)
        fall, curved = 2.0 * side * float(rate @ state.residual), float(rate @ rate)
        return fall**2 / (4.0 * curved) if fall > 0.0 and curved > 0.0 else 0.0
