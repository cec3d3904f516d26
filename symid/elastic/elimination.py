"""Dynamics without the springs: motor and link equations added, so that the joint torque cancels.

ElasticProblem -> ElasticFit.

    [Y_link | Y_motor] chi = F[tau],  n equations a sample, linear, whatever the springs are

The hysteresis is fitted afterwards on the joint torque that these dynamics leave. This is the reference with
which the two-step method must agree; it asks for both encoders.

Supported: ordinary least squares.
Not supported: weights; `band` has them.
"""

from collections.abc import Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.elastic.consistency import solve_consistent
from symid.elastic.fit import ElasticFit
from symid.elastic.hysteresis import fit_springs
from symid.elastic.problem import ElasticProblem, build_fit
from symid.elastic.spring_weights import build_elasticity

__all__ = ["find_elimination_rows", "fit_elimination"]


def fit_elimination(problem: ElasticProblem) -> ElasticFit:
    """Return dynamics by elimination of the joint torque, and the springs that it then shows."""
    beta, _, _ = problem.sizes
    chi = solve_consistent(problem.library.card, *find_elimination_rows(problem))
    springs = fit_springs(problem, problem.torque - problem.motor @ chi[beta:])
    return build_fit(problem, "elimination", chi, tuple(map(build_elasticity, springs)))


def find_elimination_rows(
    problem: ElasticProblem, recordings: Sequence[int] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return design (m, p + n + pf) and torque (m,) of the given recordings, of all by default."""
    numbers = range(len(problem.filtered)) if recordings is None else recordings
    rows = [problem.filtered[number] for number in numbers]
    design = np.concatenate([part.elimination for part in rows])
    torque = np.concatenate([part.torque for part in rows])
    return design.reshape(-1, design.shape[2]), torque.reshape(-1)
