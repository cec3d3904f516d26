"""What Ipopt says at its end, in our words: every return status, none taken for success by default.

Ipopt's return status and linear solver -> ElasticOutcome and a reason.

Supported: the statuses of Ipopt 3.14.
Not supported: other solvers; an unknown status is a failure that names it.
"""

from symid.elastic.fit import ElasticOutcome

__all__ = ["IPOPT_STATUSES", "LINEAR_SOLVER", "find_outcome"]

LINEAR_SOLVER = "mumps"
"""The one that the wheel of CasADi carries and that works; others end at once or crash."""

IPOPT_STATUSES: dict[str, tuple[ElasticOutcome, str]] = {
    "Solve_Succeeded": (ElasticOutcome.CONVERGED, "all tolerances are met"),
    "Solved_To_Acceptable_Level": (ElasticOutcome.ACCEPTABLE, "only the looser tolerances are met"),
    "Feasible_Point_Found": (ElasticOutcome.FAILED, "a feasible point was found, not an optimum"),
    "Infeasible_Problem_Detected": (ElasticOutcome.INFEASIBLE, "the constraints contradict each other"),
    "Search_Direction_Becomes_Too_Small": (ElasticOutcome.STALLED, "steps became too small to matter"),
    "Diverging_Iterates": (ElasticOutcome.DIVERGED, "the unknowns grew without bound"),
    "User_Requested_Stop": (ElasticOutcome.STALLED, "the run was stopped from outside"),
    "Maximum_Iterations_Exceeded": (ElasticOutcome.LIMIT, "the limit of iterations was reached"),
    "Maximum_CpuTime_Exceeded": (ElasticOutcome.LIMIT, "the limit of processor time was reached"),
    "Maximum_WallTime_Exceeded": (ElasticOutcome.LIMIT, "the limit of time was reached"),
    "Restoration_Failed": (ElasticOutcome.STALLED, "no step towards feasible points made progress"),
    "Error_In_Step_Computation": (
        ElasticOutcome.FAILED,
        "no step could be computed: the equations are singular",
    ),
    "Not_Enough_Degrees_Of_Freedom": (
        ElasticOutcome.FAILED,
        "there are fewer unknowns than equality constraints",
    ),
    "Invalid_Problem_Definition": (ElasticOutcome.FAILED, "the problem is not well formed"),
    "Invalid_Option": (ElasticOutcome.FAILED, "an option or the linear solver is not available"),
    "Invalid_Number_Detected": (ElasticOutcome.FAILED, "a function gave no finite number"),
    "Unrecoverable_Exception": (ElasticOutcome.FAILED, "the solver met an error that it cannot recover from"),
    "NonIpopt_Exception_Thrown": (ElasticOutcome.FAILED, "an error came from outside the solver"),
    "Insufficient_Memory": (ElasticOutcome.FAILED, "there is not enough memory"),
    "Internal_Error": (ElasticOutcome.FAILED, "the solver broke down inside"),
}


def find_outcome(status: str, linear_solver: str) -> tuple[ElasticOutcome, str]:
    """Return the outcome and the reason in words.

    Args:
        status: Ipopt's return status.
        linear_solver: the one that ran, by Ipopt's own log; empty where none ran.
    """
    if status not in IPOPT_STATUSES:
        return ElasticOutcome.FAILED, f"Ipopt ended with the status {status!r}, which is not known"
    outcome, reason = IPOPT_STATUSES[status]
    if outcome.usable and linear_solver != LINEAR_SOLVER:
        text = f"the linear solver that ran is {linear_solver or 'not known'}, not {LINEAR_SOLVER}"
        return ElasticOutcome.FAILED, text
    return outcome, f"{reason} ({status})"
