"""What a fit of a friction law says: parameters and how sure they are, the objective, the way it was found.

Input: a fit. Output: `FrictionEstimate`, which is written to and read from JSON without loss
(`symid.friction.results`).

    J = |R tau - R [Phi(v; shape), X] c|^2,    c = (linear, extra),    sigma^2 = J / (M - p - s - k)

Supported: one joint, one law.
Not supported: time spent, which is measured elsewhere, so that equal fits are equal files.
"""

from dataclasses import dataclass
from enum import Enum

from symid.errors import Notice
from symid.estimators.estimate import ParameterEstimate

__all__ = ["FrictionEstimate", "FrictionOutcome"]


class FrictionOutcome(Enum):
    """How a fit ended; the value is the explanation."""

    CONVERGED = "all tolerances are met"
    ACCEPTABLE = "only the looser tolerances are met"
    STAGNATED = "the search ended because it made no more progress"
    LIMIT = "a limit of iterations, generations or evaluations was reached"
    STALLED = "no step made progress before the tolerances were met"
    INFEASIBLE = "the bounds contradict each other"
    DIVERGED = "the unknowns grew without bound"
    FAILED = "the search broke down"
    SOME_REFUSED = "the fit is complete, but some parameters cannot be learnt from these samples"

    @property
    def usable(self) -> bool:
        """Return whether the numbers may be used."""
        return self not in {FrictionOutcome.INFEASIBLE, FrictionOutcome.DIVERGED, FrictionOutcome.FAILED}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionEstimate:
    """The result of a fit.

    Args:
        joint: its name.
        law: name of the law.
        estimator: how it was fitted; `settings` its options, and what the search tells of itself.
        parameters: as papers print them, in the order of the law's `physical`, without those refused;
            `reason` of an entry says that it stands at a bound.
        extra: what multiplies the columns beside friction, without those refused.
        refused: parameters that these samples cannot tell, with the reason.
        linear: (p,) of the law; shape: (s,) its nonlinear unknowns; other: (k,) of all columns beside
            friction. They predict torques of motions like those fitted; the entry of a refused parameter
            means nothing by itself.
        covariance: of (linear, shape, other), row by row; directions that cannot be told have none.
        objective: J, (N m)^2 or N^2.
        sigma: standard deviation of the residual, N m or N.
        samples: M, rows of the fit.
        evaluations: how often J was found; solves: linear problems solved; iterations: or generations.
        outcome: how it ended; `ended` the stop rule in words.
        aicc, bic: information criteria; condition: of the column-scaled Jacobian.
        history: the least objective after each iteration or generation.
        notices: what a reader should know.
    """

    joint: str
    law: str
    estimator: str
    parameters: tuple[ParameterEstimate, ...]
    extra: tuple[ParameterEstimate, ...]
    refused: tuple[tuple[str, str], ...]
    linear: tuple[float, ...]
    shape: tuple[float, ...]
    other: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    objective: float
    sigma: float
    samples: int
    evaluations: int
    solves: int
    iterations: int
    outcome: FrictionOutcome
    ended: str
    aicc: float
    bic: float
    condition: float
    history: tuple[float, ...] = ()
    settings: tuple[tuple[str, float | int | str], ...] = ()
    notices: tuple[Notice, ...] = ()

    def get_value(self, name: str) -> float | None:
        """Return the value of a parameter of the law or beside it; None where it was refused."""
        values = {entry.name: entry.value for entry in (*self.parameters, *self.extra)}
        return values.get(name)

    def get_std(self, name: str) -> float | None:
        """Return the standard deviation of a parameter; None where it was refused."""
        values = {entry.name: entry.std for entry in (*self.parameters, *self.extra)}
        return values.get(name)
