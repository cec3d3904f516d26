"""How a one-shot fit ended: Ipopt's return status, and which linear solver it ran.

Ipopt's return status and linear solver -> ElasticOutcome and a reason.

Supported: the statuses of `symid.estimators.ipopt_status`.
Not supported: other solvers; an unknown status is a failure that names it.
"""

from symid.elastic.fit import ElasticOutcome
from symid.estimators.ipopt_status import find_ipopt_ending

__all__ = ["LINEAR_SOLVER", "find_outcome"]

LINEAR_SOLVER = "mumps"
"""The one that the wheel of CasADi carries and that works; others end at once or crash."""


def find_outcome(status: str, linear_solver: str) -> tuple[ElasticOutcome, str]:
    """Return the outcome and the reason in words.

    Args:
        status: Ipopt's return status.
        linear_solver: the one that ran, by Ipopt's own log; empty where none ran.
    """
    name, reason = find_ipopt_ending(status)
    outcome = ElasticOutcome[name]
    if outcome.usable and linear_solver != LINEAR_SOLVER:
        text = f"the linear solver that ran is {linear_solver or 'not known'}, not {LINEAR_SOLVER}"
        return ElasticOutcome.FAILED, text
    return outcome, reason
