"""Ipopt through CasADi: smooth problems with bounds and constraints, and how a search ended, in words.

    SmoothProblem, start -> minimise -> IpoptRun            functions of NumPy arrays
    GraphProblem, start -> minimise_graph -> IpoptRun       expressions of CasADi

Of the linear solvers only MUMPS runs: the wheel of CasADi has no other one that works.

Supported: exact Hessians of expressions; of functions where bounds are the only constraints; else, and
without a Hessian, Ipopt's own limited-memory approximation. An unknown return status is a failure that
names it.
Not supported: parameters of the problem; second derivatives of constraints that are functions; other solvers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from typing import Any, TypeVar

import numpy as np

from symid.arrays import FloatArray
from symid.environment import require_memory

_Map = Callable[[FloatArray], FloatArray]
_require_once = cache(require_memory)


class Ending(Enum):
    """How a search ended, by any method; the value is the explanation, files hold the name."""

    SOLVED = "solved in one pass, without iterations"
    CONVERGED = "converged"
    ACCEPTABLE = "converged to looser tolerances only"
    STAGNATED = "no more progress"
    STALLED = "not converged: no step made progress"
    LIMIT = "not converged within the limit of iterations, generations or evaluations"
    INFEASIBLE = "the constraints contradict each other"
    DIVERGED = "diverged: the unknowns grew without bound"
    FAILED = "the solver failed"
    SOME_REFUSED = "some parameters are not identifiable from these samples"

    @property
    def usable(self) -> bool:
        """Return whether the numbers may be used."""
        return self not in {Ending.INFEASIBLE, Ending.DIVERGED, Ending.FAILED}

    @property
    def converged(self) -> bool:
        """Return whether the search ended at an optimum."""
        return self in {Ending.CONVERGED, Ending.ACCEPTABLE}


IPOPT_STATUSES: dict[str, tuple[Ending, str]] = {
    "Solve_Succeeded": (Ending.CONVERGED, "converged"),
    "Solved_To_Acceptable_Level": (Ending.ACCEPTABLE, "converged to looser tolerances only"),
    "Feasible_Point_Found": (Ending.FAILED, "a feasible point was found, not an optimum"),
    "Infeasible_Problem_Detected": (Ending.INFEASIBLE, "the constraints contradict each other"),
    "Search_Direction_Becomes_Too_Small": (Ending.STALLED, "steps became too small to matter"),
    "Diverging_Iterates": (Ending.DIVERGED, "the unknowns grew without bound"),
    "User_Requested_Stop": (Ending.STALLED, "the run was stopped from outside"),
    "Maximum_Iterations_Exceeded": (Ending.LIMIT, "the limit of iterations was reached"),
    "Maximum_CpuTime_Exceeded": (Ending.LIMIT, "the limit of processor time was reached"),
    "Maximum_WallTime_Exceeded": (Ending.LIMIT, "the limit of time was reached"),
    "Restoration_Failed": (Ending.STALLED, "no step towards feasible points made progress"),
    "Error_In_Step_Computation": (Ending.FAILED, "no step could be computed: the equations are singular"),
    "Not_Enough_Degrees_Of_Freedom": (Ending.FAILED, "there are fewer unknowns than equality constraints"),
    "Invalid_Problem_Definition": (Ending.FAILED, "the problem is not well formed"),
    "Invalid_Option": (Ending.FAILED, "an option or the linear solver is not available"),
    "Invalid_Number_Detected": (Ending.FAILED, "a function gave no finite number"),
    "Unrecoverable_Exception": (Ending.FAILED, "the solver met an error that it cannot recover from"),
    "NonIpopt_Exception_Thrown": (Ending.FAILED, "an error came from outside the solver"),
    "Insufficient_Memory": (Ending.FAILED, "there is not enough memory"),
    "Internal_Error": (Ending.FAILED, "the solver broke down inside"),
}


def describe_ipopt_status(status: str) -> tuple[Ending, str]:
    """Return the outcome and the reason, in words, for Ipopt's return status."""
    if status not in IPOPT_STATUSES:
        return Ending.FAILED, f"Ipopt ended with the status {status!r}, which is not known"
    outcome, reason = IPOPT_STATUSES[status]
    return outcome, f"{reason} ({status})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Constraints:
    """lower <= g(x) <= upper, with g (m,), its Jacobian (m, n), and where that may differ from zero.

    Bounds (m,) are infinite where there is none.
    """

    value: _Map
    jacobian: _Map
    pattern: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothProblem:
    """Minimise f(x) over x (n,) between bounds.

    Args:
        value: f. gradient: df/dx (n,).
        lower, upper: (n,), infinite where there is none.
        hessian: d2f/dx2 (n, n), symmetric; without it Ipopt approximates it from the gradients.
        constraints: beside the bounds; only without `hessian`.
    """

    value: Callable[[FloatArray], float]
    gradient: _Map
    lower: FloatArray
    upper: FloatArray
    hessian: _Map | None = None
    constraints: Constraints | None = None

    def scale(self, scales: FloatArray) -> "SmoothProblem":
        """Return the same problem in unknowns z = x / scales (n,)."""

        def stretch(function: _Map, factors: FloatArray | float = 1.0) -> _Map:
            return lambda z: function(z * scales) * factors

        hessian, constraints = self.hessian, self.constraints
        if constraints is not None:
            value, jacobian = stretch(constraints.value), stretch(constraints.jacobian, scales)
            constraints = replace(constraints, value=value, jacobian=jacobian)
        return SmoothProblem(
            value=lambda z: self.value(z * scales),
            gradient=stretch(self.gradient, scales),
            lower=self.lower / scales,
            upper=self.upper / scales,
            hessian=None if hessian is None else stretch(hessian, np.outer(scales, scales)),
            constraints=constraints,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraphProblem:
    """Minimise f(x) over x (n,) between bounds, with floor <= g(x) <= ceiling, all expressions of CasADi.

    Args:
        unknowns: x (n, 1), symbols of MX.
        objective: f. constraints: g (m, 1), empty for none.
        lower, upper: (n,), floor, ceiling: (m,), infinite where there is none.
    """

    unknowns: Any
    objective: Any
    constraints: Any
    lower: FloatArray
    upper: FloatArray
    floor: FloatArray
    ceiling: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class IpoptOptions:
    """Tolerance of the scaled problem, limit of iterations, first barrier parameter (None: adaptive)."""

    tolerance: float
    iterations: int
    barrier: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IpoptRun:
    """Where a run ended: x (n,), how, why, Ipopt's own status, iterations."""

    x: FloatArray
    outcome: Ending
    reason: str
    status: str
    iterations: int


T = TypeVar("T")


def keep_last(function: Callable[[FloatArray], T]) -> Callable[[FloatArray], T]:
    """Return `function` of x with its last result kept: Ipopt asks for value and derivatives one by one."""
    kept: dict[bytes, T] = {}

    def evaluate(x: FloatArray) -> T:
        key = x.tobytes()
        if key not in kept:
            result = function(x)
            kept.clear()
            kept[key] = result
        return kept[key]

    return evaluate


def minimise(
    problem: SmoothProblem, start: FloatArray, options: IpoptOptions, scales: FloatArray | None = None
) -> IpoptRun:
    """Return where Ipopt ends; `start` itself, as a failure, where it returns no finite numbers.

    `start` is moved between the bounds where it is outside; `scales` (n,) are units of x per scaled unknown.
    """
    import casadi

    units = np.ones(len(start)) if scales is None else scales
    scaled = problem if scales is None else problem.scale(scales)
    # The functions must live as long as the solver.
    functions = _build_functions(scaled)
    unknowns = casadi.MX.sym("x", len(start))
    expressions = {"x": unknowns} | {
        name: functions[name](unknowns) for name in ("f", "g") if name in functions
    }
    bounds = {}
    if scaled.constraints is not None:
        bounds = {"lbg": scaled.constraints.lower, "ubg": scaled.constraints.upper}
    settings = {name: function for name, function in functions.items() if name not in expressions}
    settings["ipopt"] = _list_settings(options, exact=scaled.hessian is not None)
    return _run(problem, start, units, (expressions, bounds, settings))


def minimise_graph(
    problem: GraphProblem, start: FloatArray, options: IpoptOptions, scales: FloatArray
) -> IpoptRun:
    """Return where Ipopt ends, as `minimise`; constraints are scaled by their slopes at the start."""
    import casadi

    x, unknowns = problem.unknowns, casadi.MX.sym("x", len(start))
    first = np.clip(start, problem.lower, problem.upper)
    jacobian = casadi.Function("jacobian", [x], [casadi.jacobian(problem.constraints, x)])(first)
    lengths = np.linalg.norm(np.array(jacobian, dtype=np.float64) * scales, axis=1)
    lengths = np.where(np.isfinite(lengths) & (lengths > 0.0), lengths, 1.0)
    functions = casadi.Function("functions", [x], [problem.objective, problem.constraints / lengths])
    # Inlined, so that what does not depend on an unknown is not differentiated by it.
    objective, constraints = functions.call([unknowns * casadi.DM(scales)], True, False)
    expressions = {"x": unknowns, "f": objective, "g": constraints}
    bounds = {"lbg": problem.floor / lengths, "ubg": problem.ceiling / lengths}
    return _run(problem, start, scales, (expressions, bounds, {"ipopt": _list_settings(options, exact=True)}))


def _run(
    problem: SmoothProblem | GraphProblem,
    start: FloatArray,
    units: FloatArray,
    parts: tuple[dict[str, Any], dict[str, FloatArray], dict[str, Any]],
) -> IpoptRun:
    """Return where Ipopt ends; `parts` are expressions of x / units, bounds of g, settings."""
    import casadi

    # Its own linear algebra never returns where it finds no memory; libraries and buffers take 157 MB.
    _require_once(200)
    expressions, bounds, settings = parts
    common = {"no_nlp_grad": True, "print_time": False, "error_on_fail": False}
    solver = casadi.nlpsol("problem", "ipopt", expressions, {**common, **settings})
    first = np.clip(start, problem.lower, problem.upper)
    answer = solver(x0=first / units, lbx=problem.lower / units, ubx=problem.upper / units, **bounds)
    statistics = solver.stats()
    status = str(statistics["return_status"])
    outcome, reason = describe_ipopt_status(status)
    x = np.clip(np.array(answer["x"], dtype=np.float64).ravel() * units, problem.lower, problem.upper)
    if not np.all(np.isfinite(x)):
        x, outcome, reason = first, Ending.FAILED, f"{reason}, without finite numbers"
    return IpoptRun(
        x=x, outcome=outcome, reason=reason, status=status, iterations=int(statistics["iter_count"])
    )


def _list_settings(options: IpoptOptions, *, exact: bool) -> dict[str, Any]:
    """Return Ipopt's own options; `exact`: the Hessian is given."""
    settings = {
        "print_level": 0,
        "sb": "yes",
        "linear_solver": "mumps",
        "nlp_scaling_method": "none",
        "bound_relax_factor": 0.0,
        "tol": options.tolerance,
        "max_iter": options.iterations,
        "mu_strategy": "adaptive",
    }
    if not exact:
        settings["hessian_approximation"] = "limited-memory"
    if options.barrier is not None:
        settings |= {"mu_strategy": "monotone", "mu_init": options.barrier}
    return settings


def _build_functions(problem: SmoothProblem) -> dict[str, Any]:
    """Return f, g and the derivatives that `nlpsol` takes as options."""
    import casadi

    size, constraints, hessian = len(problem.lower), problem.constraints, problem.hessian
    build, dense = _load_callback_class(), casadi.Sparsity.dense
    # Beside x functions take parameters, of which there are none; derivatives come after the values.
    x, one, none = dense(size, 1), dense(1, 1), dense(0, 0)

    def compute_gradient(z: FloatArray) -> list[Any]:
        return [problem.value(z), casadi.DM(problem.gradient(z))]

    functions = {
        "f": build("value", (x,), (one,), lambda z: [problem.value(z)]),
        "grad_f": build("gradient", (x, none), (one, x), compute_gradient),
    }
    if hessian is not None:
        upper = casadi.Sparsity.upper(size)
        # CasADi stores columns one after the other.
        columns, rows = np.tril_indices(size)

        def compute_hessian(z: FloatArray, factor: float) -> list[Any]:
            return [casadi.DM(upper, factor * hessian(z)[rows, columns])]

        # Of the factor of f and of those of constraints.
        functions["hess_lag"] = build("hessian", (x, none, one, none), (upper,), compute_hessian)
    if constraints is not None:
        columns, rows = np.nonzero(constraints.pattern.T)
        many = dense(len(constraints.lower), 1)
        pattern = casadi.Sparsity.triplet(len(constraints.lower), size, rows.tolist(), columns.tolist())

        def compute_jacobian(z: FloatArray) -> list[Any]:
            entries = constraints.jacobian(z)[rows, columns]
            return [casadi.DM(constraints.value(z)), casadi.DM(pattern, entries)]

        functions["g"] = build("constraints", (x,), (many,), lambda z: [casadi.DM(constraints.value(z))])
        functions["jac_g"] = build("jacobian", (x, none), (many, pattern), compute_jacobian)
    return functions


_Sparsity = Any
_Slots = tuple[_Sparsity, ...]
"""CasADi's sparsity of every argument, or of every result."""


@cache
def _load_callback_class() -> Callable[[str, _Slots, _Slots, Callable[..., list[Any]]], Any]:
    """Return a class of functions that CasADi calls with x (n,), and the factor of f where there is one."""
    import casadi

    class NumpyFunction(casadi.Callback):
        """A function with arguments and results of known sparsity."""

        def __init__(
            self, name: str, takes: _Slots, gives: _Slots, evaluate: Callable[..., list[Any]]
        ) -> None:
            casadi.Callback.__init__(self)
            self.takes, self.gives, self.evaluate = takes, gives, evaluate
            self.construct(name, {})

        def get_n_in(self) -> int:
            return len(self.takes)

        def get_n_out(self) -> int:
            return len(self.gives)

        def get_sparsity_in(self, place: int) -> _Sparsity:
            return self.takes[place]

        def get_sparsity_out(self, place: int) -> _Sparsity:
            return self.gives[place]

        def eval(self, arguments: Sequence[Any]) -> list[Any]:
            x = np.array(arguments[0], dtype=np.float64).ravel()
            return self.evaluate(x, *map(float, arguments[2:3]))

    return NumpyFunction
