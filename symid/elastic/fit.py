"""What one method found: dynamics, friction and the hysteresis of every joint.

Input: numbers of a solver. Output: `ElasticFit`, shared by all methods.

Supported: methods that give no hysteresis; methods without iterations.
Not supported: uncertainties; they belong to the estimate.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice
from symid.robot.elasticity import Elasticity

__all__ = ["ElasticFit", "ElasticOutcome", "HistoryEntry"]


class ElasticOutcome(Enum):
    """How a method ended; the value is the explanation."""

    SOLVED = "solved in one pass, without iterations"
    CONVERGED = "parameters and residuals no longer changed"
    ACCEPTABLE = "the solver met its looser tolerances only"
    STALLED = "no step lowered the merit any more; the best iterate was kept"
    LIMIT = "the limit of iterations was reached; the best iterate was kept"
    INFEASIBLE = "no parameters satisfy the constraints"
    DIVERGED = "the iterates ran away"
    FAILED = "the solver broke down"

    @property
    def usable(self) -> bool:
        """Return whether the parameters may be used."""
        return self in {
            ElasticOutcome.SOLVED,
            ElasticOutcome.CONVERGED,
            ElasticOutcome.ACCEPTABLE,
            ElasticOutcome.STALLED,
            ElasticOutcome.LIMIT,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryEntry:
    """One iteration: merit, the step's relative size, its damping, and the residual norms.

    `norms` are those of the energy rows in J, then of the torque rows joint by joint in N m.
    """

    merit: float
    change: float
    damping: float = 1.0
    norms: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticFit:
    """Parameters of one method, in SI units.

    Args:
        method: its name.
        beta: (p,) base parameters of the links; rotor: (n,) rotor inertias on the joint side.
        friction: (pf,) in the order of the model card.
        elasticity: one a joint; empty if the method gives none.
        history: of the iterations, the start first.
        covariance: (p + n + pf, p + n + pf) of `chi`, empty where the method has none.
    """

    method: str
    beta: FloatArray
    rotor: FloatArray
    friction: FloatArray
    elasticity: tuple[Elasticity, ...] = ()
    history: tuple[HistoryEntry, ...] = ()
    outcome: ElasticOutcome = ElasticOutcome.SOLVED
    covariance: FloatArray | None = None
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("beta", "rotor", "friction"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", freeze(self.covariance))

    @property
    def chi(self) -> FloatArray:
        """Return [beta; rotor; friction], all dynamic parameters."""
        return np.concatenate([self.beta, self.rotor, self.friction])
