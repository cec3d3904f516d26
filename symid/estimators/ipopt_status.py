"""What Ipopt says at its end, in our words: every return status, none taken for success by default.

Ipopt's return status -> the name of an outcome and a reason; rooms look the name up in outcomes of their own.

Supported: the statuses of Ipopt 3.14.
Not supported: other solvers; an unknown status is a failure that names it.
"""

__all__ = ["IPOPT_STATUSES", "find_ipopt_ending"]

IPOPT_STATUSES: dict[str, tuple[str, str]] = {
    "Solve_Succeeded": ("CONVERGED", "all tolerances are met"),
    "Solved_To_Acceptable_Level": ("ACCEPTABLE", "only the looser tolerances are met"),
    "Feasible_Point_Found": ("FAILED", "a feasible point was found, not an optimum"),
    "Infeasible_Problem_Detected": ("INFEASIBLE", "the constraints contradict each other"),
    "Search_Direction_Becomes_Too_Small": ("STALLED", "steps became too small to matter"),
    "Diverging_Iterates": ("DIVERGED", "the unknowns grew without bound"),
    "User_Requested_Stop": ("STALLED", "the run was stopped from outside"),
    "Maximum_Iterations_Exceeded": ("LIMIT", "the limit of iterations was reached"),
    "Maximum_CpuTime_Exceeded": ("LIMIT", "the limit of processor time was reached"),
    "Maximum_WallTime_Exceeded": ("LIMIT", "the limit of time was reached"),
    "Restoration_Failed": ("STALLED", "no step towards feasible points made progress"),
    "Error_In_Step_Computation": ("FAILED", "no step could be computed: the equations are singular"),
    "Not_Enough_Degrees_Of_Freedom": ("FAILED", "there are fewer unknowns than equality constraints"),
    "Invalid_Problem_Definition": ("FAILED", "the problem is not well formed"),
    "Invalid_Option": ("FAILED", "an option or the linear solver is not available"),
    "Invalid_Number_Detected": ("FAILED", "a function gave no finite number"),
    "Unrecoverable_Exception": ("FAILED", "the solver met an error that it cannot recover from"),
    "NonIpopt_Exception_Thrown": ("FAILED", "an error came from outside the solver"),
    "Insufficient_Memory": ("FAILED", "there is not enough memory"),
    "Internal_Error": ("FAILED", "the solver broke down inside"),
}


def find_ipopt_ending(status: str) -> tuple[str, str]:
    """Return the name of the outcome and the reason, in words, for Ipopt's return status."""
    if status not in IPOPT_STATUSES:
        return "FAILED", f"Ipopt ended with the status {status!r}, which is not known"
    outcome, reason = IPOPT_STATUSES[status]
    return outcome, f"{reason} ({status})"
