"""One run of Ipopt on the hysteresis-plus-friction problem, and what proves its result.

NlpCost, start -> NlpRun.

Unknowns are scaled by the lengths of their columns at the start, x = d z, so that the Gauss-Newton Hessian
begins with ones on its diagonal. All constraints are bounds, so that

    kkt = max_i |z_i - min(u_i, max(l_i, z_i - df/dz_i))|

is zero at a point that satisfies the Karush-Kuhn-Tucker conditions, and nowhere else. It is computed from our
own gradient, whatever the solver says; a few Newton steps with active bounds end every run.

Supported: exact and Gauss-Newton Hessians.
Not supported: constraints other than bounds.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.elastic.fit import ElasticOutcome
from symid.elastic.nlp_cost import CostState, NlpCost
from symid.elastic.nlp_options import NlpOptions
from symid.elastic.nlp_status import LINEAR_SOLVER, find_outcome
from symid.estimators.ipopt_functions import build_ipopt_functions

__all__ = ["ActiveBound", "Certificate", "NlpRun", "find_certificate", "find_scales", "optimise_nlp"]

_AT_BOUND = 1e-9
"""Distance in scaled unknowns below which a bound that the gradient pushes against is active."""
_NEAR_BOUND = 1e-3
"""Distance in scaled unknowns within which Newton steps try an unknown on its bound."""
_NEWTON_STEPS = 8
_BLIND = 1e-14
"""Scaled gradient and curvature below which an unknown has no effect."""
_KKT = 1e-6
"""The most that our own residual may be for a result to count as converged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveBound:
    """An unknown at a bound: name, "lower" or "upper", its value, and the multiplier in scaled unknowns."""

    name: str
    side: str
    value: float
    multiplier: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """What proves an optimum, computed without the solver.

    Args:
        kkt: scaled residual of the optimality conditions.
        violation: largest distance outside a bound, scaled.
        active: bounds that hold unknowns.
        undetermined: unknowns without any effect at this point, or none apart from k0.
        condition: condition number of the scaled Hessian of all other unknowns that no bound holds.
        curvature: its least eigenvalue; positive at a strict local minimum.
    """

    kkt: float
    violation: float
    active: tuple[ActiveBound, ...]
    undetermined: tuple[str, ...]
    condition: float
    curvature: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NlpRun:
    """One run.

    Args:
        x: (x,) unknowns in SI units; objective: f; start: f at the start.
        outcome, reason: how it ended; iterations: of Ipopt; status: Ipopt's own.
    """

    x: FloatArray
    objective: float
    start: float
    outcome: ElasticOutcome
    reason: str
    status: str
    linear_solver: str
    iterations: int
    certificate: Certificate

    def __post_init__(self) -> None:
        """Copy the array and make it read-only."""
        object.__setattr__(self, "x", freeze(self.x))

    @property
    def converged(self) -> bool:
        """Return whether the run ended at an optimum."""
        return self.outcome in {ElasticOutcome.CONVERGED, ElasticOutcome.ACCEPTABLE}


class _Evaluator:
    """The cost at scaled unknowns; the last point is kept, as the solver asks for it several times."""

    def __init__(self, cost: NlpCost, scales: FloatArray, hessian: str) -> None:
        self.cost, self.scales, self.exact = cost, scales, hessian == "exact"
        self.key = b""
        self.kept: CostState | None = None

    def find_state(self, z: FloatArray) -> tuple[FloatArray, CostState]:
        x = z * self.scales
        if self.kept is None or self.key != x.tobytes():
            self.kept, self.key = self.cost.find_state(x), x.tobytes()
        return x, self.kept

    def find_value(self, z: FloatArray) -> float:
        return self.cost.find_value(self.find_state(z)[1])

    def find_gradient(self, z: FloatArray) -> FloatArray:
        return self.cost.find_gradient(self.find_state(z)[1]) * self.scales

    def find_hessian(self, z: FloatArray) -> FloatArray:
        x, state = self.find_state(z)
        hessian = self.cost.find_hessian(state, x) if self.exact else self.cost.find_gauss_newton(state)
        return hessian * self.scales * self.scales[:, None]


def find_scales(cost: NlpCost, x: FloatArray) -> FloatArray:
    """Return d (x,), SI units per scaled unknown: one over the length of each column at x."""
    diagonal = np.diag(cost.find_gauss_newton(cost.find_state(x)))
    # A column that is empty at the start has no length yet: its unknown keeps its own size.
    own = np.maximum(np.abs(x), 1e-3)
    return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), own)


def optimise_nlp(cost: NlpCost, start: FloatArray, scales: FloatArray, options: NlpOptions) -> NlpRun:
    """Return the optimum next to `start` (x,), with its certificate.

    Args:
        cost: of the problem.
        start: unknowns, SI; moved between the bounds where it is outside.
        scales: SI units per scaled unknown.
        options: Hessian, tolerance, limit of iterations.
    """
    layout = cost.layout
    begin = np.clip(start, layout.lower, layout.upper) / scales
    evaluator = _Evaluator(cost, scales, options.hessian)
    first = evaluator.find_value(begin)
    z, status, iterations, solver = _run_ipopt(evaluator, begin, options)
    outcome, reason = find_outcome(status, solver)
    if not np.all(np.isfinite(z)):
        z, outcome, reason = begin, ElasticOutcome.FAILED, f"the solver returned no finite numbers ({status})"
    x = _polish(evaluator, z, layout.lower / scales, layout.upper / scales) * scales
    x = np.clip(x, layout.lower, layout.upper)
    certificate = find_certificate(cost, x, scales)
    if outcome is ElasticOutcome.CONVERGED and certificate.kkt > _KKT:
        outcome = ElasticOutcome.STALLED
        reason = (
            f"Ipopt reports success, but the residual of the optimality conditions is {certificate.kkt:.1e}"
        )
    return NlpRun(
        x=x,
        objective=cost.find_value(cost.find_state(x)),
        start=first,
        outcome=outcome,
        reason=reason,
        status=status,
        linear_solver=solver,
        iterations=iterations,
        certificate=certificate,
    )


def find_certificate(cost: NlpCost, x: FloatArray, scales: FloatArray) -> Certificate:
    """Return the proof of optimality at x (x,), from our own derivatives."""
    layout = cost.layout
    state = cost.find_state(x)
    slope = cost.find_gradient(state) * scales
    z, low, high = x / scales, layout.lower / scales, layout.upper / scales
    kkt = _find_kkt(z, slope, low, high)
    violation = float(np.max(np.maximum(np.maximum(low - z, z - high), 0.0)))
    at_low = (z - low <= _AT_BOUND) & (slope > 0.0) & (low < high)
    at_high = (high - z <= _AT_BOUND) & (slope < 0.0) & (low < high)
    active = tuple(
        ActiveBound(
            name=layout.names[place],
            side="lower" if at_low[place] else "upper",
            value=float(x[place]),
            multiplier=float(abs(slope[place])),
        )
        for place in np.flatnonzero(at_low | at_high)
    )
    hessian = cost.find_hessian(state, x) * scales * scales[:, None]
    blind = (np.diag(hessian) <= _BLIND) & (np.abs(slope) <= _BLIND)
    free = ~(at_low | at_high | blind | (low == high))
    values = np.linalg.eigvalsh(hessian[np.ix_(free, free)])
    return Certificate(
        kkt=kkt,
        violation=violation,
        active=active,
        undetermined=tuple(layout.names[place] for place in np.flatnonzero(blind | (low == high))),
        condition=float(values[-1] / values[0]) if values[0] > 0.0 else np.inf,
        curvature=float(values[0]),
    )


def _polish(evaluator: _Evaluator, z: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return z (x,) after Newton steps in the unknowns that no bound holds; the others go onto their bounds.

    An interior-point method stays off the bounds by its barrier over the multiplier. A step is kept while our
    own residual falls.
    """
    best = np.clip(z, low, high)
    slope = evaluator.find_gradient(best)
    residual = _find_kkt(best, slope, low, high)
    for _ in range(_NEWTON_STEPS):
        near = np.minimum(np.abs(slope), _NEAR_BOUND)
        at_low, at_high = (best - low < near) & (slope > 0.0), (high - best < near) & (slope < 0.0)
        trial = np.where(at_low, low, np.where(at_high, high, best))
        free = np.flatnonzero(~(at_low | at_high))
        hessian = evaluator.find_hessian(best)[np.ix_(free, free)]
        away = evaluator.find_gradient(trial)
        trial[free] -= np.linalg.lstsq(hessian, away[free], rcond=1e-12)[0]
        trial = np.clip(trial, low, high)
        slope = evaluator.find_gradient(trial)
        reached = _find_kkt(trial, slope, low, high)
        if not reached < residual:
            break
        best, residual = trial, reached
    return best


def _find_kkt(z: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> float:
    return float(np.max(np.abs(z - np.clip(z - slope, low, high))))


def _run_ipopt(
    evaluator: _Evaluator, begin: FloatArray, options: NlpOptions
) -> tuple[FloatArray, str, int, str]:
    """Return scaled unknowns, Ipopt's status, its iterations, and the linear solver that its log names."""
    import casadi

    layout = evaluator.cost.layout
    functions = build_ipopt_functions(
        layout.size, evaluator.find_value, evaluator.find_gradient, evaluator.find_hessian
    )
    unknowns = casadi.MX.sym("x", layout.size)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "ipopt.txt"
        settings = {
            "grad_f": functions.gradient,
            "hess_lag": functions.hessian,
            "no_nlp_grad": True,
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "output_file": str(log),
                "file_print_level": 5,
                "linear_solver": LINEAR_SOLVER,
                "nlp_scaling_method": "none",
                "bound_relax_factor": 0.0,
                "tol": options.tolerance,
                "max_iter": options.iterations,
                "mu_strategy": "adaptive",
            },
        }
        problem = {"x": unknowns, "f": functions.value(unknowns)}
        solver = casadi.nlpsol("hysteresis", "ipopt", problem, settings)
        scales = evaluator.scales
        answer = solver(x0=begin, lbx=layout.lower / scales, ubx=layout.upper / scales)
        statistics = solver.stats()
        text = log.read_text() if log.is_file() else ""
    solution = np.asarray(answer["x"], dtype=np.float64).ravel()
    return (
        solution,
        str(statistics["return_status"]),
        int(statistics["iter_count"]),
        _read_linear_solver(text),
    )


def _read_linear_solver(log: str) -> str:
    """Return the first word behind "linear solver" in Ipopt's log, in lower case; "" where there is none."""
    _, found, rest = log.partition("running with linear solver ")
    return rest.split()[0].lower().rstrip(".") if found else ""
