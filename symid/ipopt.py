"""Ipopt through CasADi: functions of NumPy as it calls them, and its return statuses in words.

Value, gradient, Hessian of the unknowns -> what `casadi.nlpsol` takes for f, "grad_f" and "hess_lag".
Ipopt's return status -> the name of an outcome and a reason; no status counts as success by default.

Supported: problems whose only constraints are bounds; the statuses of Ipopt 3.14.
Not supported: parameters of the problem; other solvers. An unknown status is a failure that names it.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from symid.arrays import FloatArray
from symid.callbacks import build_callback


class IpoptFunctions(NamedTuple):
    """Functions of CasADi; they must live as long as the solver that calls them."""

    value: Any
    gradient: Any
    hessian: Any


def build_ipopt_functions(
    size: int,
    value: Callable[[FloatArray], float],
    gradient: Callable[[FloatArray], FloatArray],
    hessian: Callable[[FloatArray], FloatArray],
) -> IpoptFunctions:
    """Return the functions of CasADi.

    Args:
        size: number n of unknowns.
        value: f of unknowns (n,).
        gradient: (n,).
        hessian: (n, n), symmetric.
    """
    import casadi

    dense = casadi.Sparsity.dense
    upper = casadi.Sparsity.upper(size)
    inner = np.triu_indices(size)
    # CasADi stores columns one after the other.
    order = np.lexsort((inner[0], inner[1]))
    rows, columns = inner[0][order], inner[1][order]

    def read(unknowns: object) -> FloatArray:
        return np.array(unknowns, dtype=np.float64).ravel()

    def find_value(arguments: Sequence[Any]) -> list[Any]:
        return [value(read(arguments[0]))]

    def find_slope(arguments: Sequence[Any]) -> list[Any]:
        x = read(arguments[0])
        return [value(x), casadi.DM(gradient(x))]

    def find_bend(arguments: Sequence[Any]) -> list[Any]:
        full = float(arguments[2]) * hessian(read(arguments[0]))
        return [casadi.DM(upper, full[rows, columns])]

    unknowns, scalar, none = dense(size, 1), dense(1, 1), dense(0, 0)
    return IpoptFunctions(
        value=build_callback("value", (("x", unknowns),), (("f", scalar),), find_value),
        gradient=build_callback(
            "gradient", (("x", unknowns), ("p", none)), (("f", scalar), ("grad_f_x", unknowns)), find_slope
        ),
        hessian=build_callback(
            "hessian",
            (("x", unknowns), ("p", none), ("lam_f", scalar), ("lam_g", none)),
            (("triu_hess_gamma_x_x", upper),),
            find_bend,
        ),
    )


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


def describe_ipopt_status(status: str) -> tuple[str, str]:
    """Return the name of the outcome and the reason, in words, for Ipopt's return status."""
    if status not in IPOPT_STATUSES:
        return "FAILED", f"Ipopt ended with the status {status!r}, which is not known"
    outcome, reason = IPOPT_STATUSES[status]
    return outcome, f"{reason} ({status})"
