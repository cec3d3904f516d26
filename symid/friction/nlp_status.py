"""What Ipopt says at its end as an outcome of ours: every return status, none taken for success by default.

Supported: the statuses of Ipopt 3.14.
Not supported: other solvers; an unknown status is a failure that names it.
"""

from symid.friction.estimate import FrictionOutcome

__all__ = ["IPOPT_OUTCOMES", "find_ipopt_outcome"]

IPOPT_OUTCOMES: dict[str, FrictionOutcome] = {
    "Solve_Succeeded": FrictionOutcome.CONVERGED,
    "Solved_To_Acceptable_Level": FrictionOutcome.ACCEPTABLE,
    "Feasible_Point_Found": FrictionOutcome.FAILED,
    "Infeasible_Problem_Detected": FrictionOutcome.INFEASIBLE,
    "Search_Direction_Becomes_Too_Small": FrictionOutcome.STALLED,
    "Diverging_Iterates": FrictionOutcome.DIVERGED,
    "User_Requested_Stop": FrictionOutcome.STALLED,
    "Maximum_Iterations_Exceeded": FrictionOutcome.LIMIT,
    "Maximum_CpuTime_Exceeded": FrictionOutcome.LIMIT,
    "Maximum_WallTime_Exceeded": FrictionOutcome.LIMIT,
    "Restoration_Failed": FrictionOutcome.STALLED,
    "Error_In_Step_Computation": FrictionOutcome.FAILED,
    "Not_Enough_Degrees_Of_Freedom": FrictionOutcome.FAILED,
    "Invalid_Problem_Definition": FrictionOutcome.FAILED,
    "Invalid_Option": FrictionOutcome.FAILED,
    "Invalid_Number_Detected": FrictionOutcome.FAILED,
    "Unrecoverable_Exception": FrictionOutcome.FAILED,
    "NonIpopt_Exception_Thrown": FrictionOutcome.FAILED,
    "Insufficient_Memory": FrictionOutcome.FAILED,
    "Internal_Error": FrictionOutcome.FAILED,
}


def find_ipopt_outcome(status: str) -> tuple[FrictionOutcome, str]:
    """Return the outcome and how the search ended, in words, for Ipopt's return status."""
    if status not in IPOPT_OUTCOMES:
        return FrictionOutcome.FAILED, f"Ipopt ended with the status {status!r}, which is not known"
    outcome = IPOPT_OUTCOMES[status]
    return outcome, f"Ipopt ended with {status}: {outcome.value}"
