"""The two steps on one cost: energy rows alone, thresholds fixed, no bounds. A means to test convergence.

ElasticProblem -> joint least squares, its alternation, and the alternation's rate.

    min |y - Yd chi - Ae k|^2     in one shot, or over k and chi in turn

In turn it is block coordinate descent: the cost never rises, the limit is the joint solution, and the error
falls by rho = cos^2 of the smallest principal angle between the column spaces of Yd and Ae (von Neumann).

Supported: springs and stops without knees.
Not supported: knees, which are not linear; noise: energy rows tell stiffnesses badly, so that `iteration`
fits them to torques.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.elastic.fit import ElasticFit, ElasticOutcome, HistoryEntry
from symid.elastic.problem import ElasticProblem, build_fit
from symid.elastic.windows import find_window_columns
from symid.robot.elasticity import Elasticity, Stop

__all__ = ["EnergyCost", "build_energy_cost", "find_rate", "fit_alternation", "fit_joint_energy"]

_LONGEST = 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EnergyCost:
    """|supplied - design chi - work k|^2: (m,) J, (m, p + n + pf), (m, sum (m_i + 1))."""

    supplied: FloatArray
    design: FloatArray
    work: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("supplied", "design", "work"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def build_energy_cost(problem: ElasticProblem) -> EnergyCost:
    """Return the energy rows with the work of springs and stops per unit stiffness."""
    parts = [
        find_window_columns(problem.thresholds, signals, rows)
        for signals, rows in zip(problem.signals, problem.energy, strict=True)
    ]
    return EnergyCost(supplied=problem.supplied, design=problem.design, work=np.vstack(parts))


def find_rate(cost: EnergyCost) -> float:
    """Return the factor by which the error falls: the square of the largest singular value of Qd' Qe."""
    cosines = np.linalg.svd(_find_base(cost.design).T @ _find_base(cost.work), compute_uv=False)
    return float(min(cosines[0], 1.0) ** 2)


def fit_joint_energy(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics and stiffnesses that minimise the energy cost together."""
    cost = build_energy_cost(problem)
    solution = _solve(np.hstack([cost.design, cost.work]), cost.supplied)
    count = cost.design.shape[1]
    springs = _build_springs(problem, solution[count:])
    return build_fit(problem, "joint-energy", solution[:count], springs)


def fit_alternation(problem: ElasticProblem, *, iterations: int = _LONGEST) -> ElasticFit:
    """Return the same by alternating between stiffnesses and dynamics, from no springs at all.

    The history's `change` is the relative step of chi, its `merit` the cost in J^2.
    """
    cost = build_energy_cost(problem)
    chi = _solve(cost.design, cost.supplied)
    stiffness = np.zeros(cost.work.shape[1])
    lengths = np.maximum(np.linalg.norm(cost.design, axis=0), 1e-300)
    history: list[HistoryEntry] = []
    outcome = ElasticOutcome.LIMIT
    for _ in range(iterations):
        stiffness = _solve(cost.work, cost.supplied - cost.design @ chi)
        moved = _solve(cost.design, cost.supplied - cost.work @ stiffness)
        change = float(np.linalg.norm((moved - chi) * lengths) / np.linalg.norm(moved * lengths))
        chi = moved
        error = cost.supplied - cost.design @ chi - cost.work @ stiffness
        norm = float(np.linalg.norm(error))
        history.append(HistoryEntry(merit=norm**2, change=change, norms=(norm,)))
        if change <= problem.options.tolerance:
            outcome = ElasticOutcome.CONVERGED
            break
    springs = _build_springs(problem, stiffness)
    return build_fit(problem, "same-cost", chi, springs, history=tuple(history), outcome=outcome)


def _find_base(matrix: FloatArray) -> FloatArray:
    """Return orthonormal columns (m, r) that span those of `matrix`."""
    lengths = np.linalg.norm(matrix, axis=0)
    left, singular, _ = np.linalg.svd(matrix[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    base: FloatArray = left[:, singular > 1e-9 * singular[0]]
    return base


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(matrix, axis=0)
    scales = np.where(lengths > 0.0, lengths, 1.0)
    solution: FloatArray = np.linalg.lstsq(matrix / scales, right, rcond=1e-9)[0] / scales
    return solution


def _build_springs(problem: ElasticProblem, stiffness: FloatArray) -> tuple[Elasticity, ...]:
    springs, at = [], 0
    for grid in problem.thresholds:
        own = stiffness[at : at + len(grid) + 1]
        stops = tuple(
            Stop(threshold=float(radius), stiffness=float(value))
            for radius, value in zip(grid, own[1:], strict=True)
        )
        springs.append(Elasticity(stiffness=float(own[0]), stops=stops))
        at += len(own)
    return tuple(springs)
