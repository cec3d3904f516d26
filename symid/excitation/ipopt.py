"""One run of Ipopt on a smooth problem whose functions are ours.

Input: value, gradient, constraints and their Jacobian as functions of NumPy; a start. Output: `Ending`.

    minimise f(x)  subject to  lower <= g(x) <= upper

First derivatives are exact; the second ones are Ipopt's own limited-memory approximation.

Supported: Jacobians of a fixed pattern. Not supported: bounds on unknowns (state them as constraints).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symid.arrays import FloatArray
from symid.callbacks import build_callback

__all__ = ["Ending", "IpoptOptions", "SmoothProblem", "run_ipopt"]

_LINEAR_SOLVER = "mumps"
"""The one that the wheel of CasADi carries and that works; others end at once or crash."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IpoptOptions:
    """How long and how exactly: iterations, tolerance, first barrier parameter, pairs kept of the Hessian."""

    iterations: int = 200
    tolerance: float = 1e-4
    barrier: float = 1e-2
    memory: int = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothProblem:
    """Functions of the unknowns (n,).

    Args:
        value: f. gradient: (n,). constraints: g (m,). jacobian: (m, n), zero outside `pattern`.
        pattern: (m, n), true where the Jacobian may differ from zero.
        lower, upper: (m,), infinite for none.
    """

    value: Callable[[FloatArray], float]
    gradient: Callable[[FloatArray], FloatArray]
    constraints: Callable[[FloatArray], FloatArray]
    jacobian: Callable[[FloatArray], FloatArray]
    pattern: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ending:
    """Where a run ended: unknowns (n,), Ipopt's own return status, iterations."""

    unknowns: FloatArray
    status: str
    iterations: int

    @property
    def converged(self) -> bool:
        """Return whether the tolerances are met."""
        return self.status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"}


def run_ipopt(problem: SmoothProblem, start: FloatArray, options: IpoptOptions | None = None) -> Ending:
    """Return where Ipopt ends from `start` (n,)."""
    import casadi

    options = options or IpoptOptions()
    size = len(start)
    unknowns = casadi.MX.sym("x", size)
    value, constraints, gradient, jacobian = _build_functions(problem, size)
    settings = {
        "grad_f": gradient,
        "jac_g": jacobian,
        "no_nlp_grad": True,
        "print_time": False,
        "error_on_fail": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "linear_solver": _LINEAR_SOLVER,
            "hessian_approximation": "limited-memory",
            "limited_memory_max_history": options.memory,
            "nlp_scaling_method": "none",
            "bound_relax_factor": 0.0,
            "tol": options.tolerance,
            "max_iter": options.iterations,
            "mu_strategy": "monotone",
            "mu_init": options.barrier,
        },
    }
    expressions = {"x": unknowns, "f": value(unknowns), "g": constraints(unknowns)}
    solver = casadi.nlpsol("excitation", "ipopt", expressions, settings)
    answer = solver(x0=start, lbg=problem.lower, ubg=problem.upper)
    statistics = solver.stats()
    return Ending(
        unknowns=np.asarray(answer["x"], dtype=np.float64).ravel(),
        status=str(statistics["return_status"]),
        iterations=int(statistics["iter_count"]),
    )


def _build_functions(problem: SmoothProblem, size: int) -> tuple[Any, Any, Any, Any]:
    """Return f, g, grad_f and jac_g as CasADi wants them; they must live as long as the solver."""
    import casadi

    dense = casadi.Sparsity.dense
    # CasADi stores columns one after the other.
    columns, rows = np.nonzero(problem.pattern.T)
    count = len(problem.lower)
    pattern = casadi.Sparsity.triplet(count, size, rows.tolist(), columns.tolist())
    x, one, none, many = dense(size, 1), dense(1, 1), dense(0, 0), dense(count, 1)

    def read(argument: Any) -> FloatArray:  # noqa: ANN401  of casadi
        return np.array(argument, dtype=np.float64).ravel()

    def find_jacobian(arguments: Sequence[Any]) -> list[Any]:
        unknowns = read(arguments[0])
        entries = problem.jacobian(unknowns)[rows, columns]
        return [casadi.DM(problem.constraints(unknowns)), casadi.DM(pattern, entries)]

    def find_gradient(arguments: Sequence[Any]) -> list[Any]:
        unknowns = read(arguments[0])
        return [problem.value(unknowns), casadi.DM(problem.gradient(unknowns))]

    return (
        build_callback("value", (("x", x),), (("f", one),), lambda a: [problem.value(read(a[0]))]),
        build_callback(
            "constraints", (("x", x),), (("g", many),), lambda a: [casadi.DM(problem.constraints(read(a[0])))]
        ),
        build_callback("gradient", (("x", x), ("p", none)), (("f", one), ("grad_f_x", x)), find_gradient),
        build_callback(
            "jacobian", (("x", x), ("p", none)), (("g", many), ("jac_g_x", pattern)), find_jacobian
        ),
    )
