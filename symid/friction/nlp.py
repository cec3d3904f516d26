"""The constrained problem of a friction law, solved by Ipopt through CasADi with exact derivatives.

FrictionProblem -> FrictionSearch.

    min_x J(x)   subject to   lower <= x <= upper

over the physical parameters x, so that fS >= 0 and fC >= 0 hold as they are printed. Starts spread evenly
over the shape's box (Roberts' generalised golden ratio), with linear parameters by least squares; the best of
them are followed.

Supported: physical bounds, every static law, any linear operator behind the rows.
Not supported: optima in a kink of the objective to full precision (`variable_projection` sets them there).
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.estimators.ipopt_functions import build_ipopt_functions
from symid.estimators.ipopt_status import find_ipopt_ending
from symid.friction.estimate import FrictionOutcome
from symid.friction.nlp_cost import NlpCost
from symid.friction.options import FrictionNlpOptions
from symid.friction.problem import FrictionProblem
from symid.friction.projection import Projector
from symid.friction.search import FrictionSearch

__all__ = ["search_by_nlp"]

_TRIED = 8
"""Starts looked at for each that is followed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """One start's end: physical parameters (n,), J, how it ended, iterations of Ipopt."""

    x: FloatArray
    objective: float
    outcome: FrictionOutcome
    ended: str
    iterations: int


def search_by_nlp(problem: FrictionProblem, options: FrictionNlpOptions) -> FrictionSearch:
    """Return the least of the optima that the starts lead to.

    Args:
        problem: of one joint.
        options: starts, tolerance, limit of iterations.
    """
    law, projector = problem.law, Projector(problem, np.iinfo(np.int64).max)
    low, high = _find_bounds(problem)
    states = sorted(
        (projector.project(z) for z in _list_starts(problem, _TRIED * options.starts)),
        key=lambda state: state.objective,
    )
    cost = NlpCost(problem, max(states[0].objective, 1e-20 * float(problem.target @ problem.target), 1e-300))
    history, runs = [states[0].objective], []
    for state in states[: options.starts]:
        start = np.array(law.to_physical(list(state.linear), list(state.shape)))
        runs.append(_run_ipopt(cost, np.clip(start, low, high), low, high, options))
        history.append(min(history[-1], runs[-1].objective) if runs[-1].outcome.usable else history[-1])
    usable = [run for run in runs if run.outcome.usable]
    best = min(usable or runs, key=lambda run: run.objective)
    iterations = sum(run.iterations for run in runs)
    linear, shape = law.from_physical([float(value) for value in best.x])
    same = sum(run.objective <= best.objective * (1.0 + 1e-6) for run in usable)
    return FrictionSearch(
        linear=np.array(linear),
        shape=np.array(shape),
        objective=best.objective,
        evaluations=cost.evaluations + projector.evaluations,
        solves=projector.solves + iterations,
        iterations=iterations,
        history=tuple(history),
        outcome=best.outcome,
        ended=f"{best.ended}; {same} of {len(runs)} starts end at this optimum",
        settings=(("starts", len(runs)), ("agreeing", same)),
    )


def _find_bounds(problem: FrictionProblem) -> tuple[FloatArray, FloatArray]:
    """Return bounds (n,) of the physical parameters; those of the shape are the search's."""
    law = problem.law
    box = {
        entry.name: (float(low), float(high))
        for entry, low, high in zip(law.shape, problem.low, problem.high, strict=True)
    }
    pairs = [box.get(entry.name, (entry.lower, entry.upper)) for entry in law.physical]
    return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])


def _list_starts(problem: FrictionProblem, count: int) -> list[FloatArray]:
    """Return coordinates of shapes that fill the box evenly, (s,) each; one where nothing is free."""
    low, high = problem.encode(problem.low), problem.encode(problem.high)
    free = int(np.sum(problem.is_free))
    if not free:
        return [low]
    # The root of g^(d+1) = g + 1, found by its own iteration.
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (free + 1))
    steps = ratio ** -np.arange(1.0, free + 1.0)
    starts = []
    for number in range(1, count + 1):
        z = np.array(low)
        place = problem.is_free > 0.0
        z[place] += np.mod(0.5 + number * steps, 1.0) * (high - low)[place]
        starts.append(z)
    return starts


def _run_ipopt(
    cost: NlpCost, start: FloatArray, low: FloatArray, high: FloatArray, options: FrictionNlpOptions
) -> _Run:
    """Return the end of one start (n,)."""
    import casadi

    # One unit of a scaled unknown changes the objective by about one.
    bend = np.abs(np.diag(cost.find_hessian(start)))
    scales = np.where(bend > 0.0, 1.0 / np.sqrt(np.where(bend > 0.0, bend, 1.0)), 1.0)
    functions = build_ipopt_functions(
        cost.size,
        lambda z: cost.find_value(z * scales),
        lambda z: cost.find_gradient(z * scales) * scales,
        lambda z: cost.find_hessian(z * scales) * np.outer(scales, scales),
    )
    unknowns = casadi.MX.sym("x", cost.size)
    settings = {
        "grad_f": functions.gradient,
        "hess_lag": functions.hessian,
        "no_nlp_grad": True,
        "print_time": False,
        "error_on_fail": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "linear_solver": "mumps",
            "nlp_scaling_method": "none",
            "bound_relax_factor": 0.0,
            "tol": options.tolerance,
            "max_iter": options.iterations,
            "mu_strategy": "adaptive",
        },
    }
    solver = casadi.nlpsol("friction", "ipopt", {"x": unknowns, "f": functions.value(unknowns)}, settings)
    answer = solver(x0=start / scales, lbx=low / scales, ubx=high / scales)
    statistics = solver.stats()
    name, reason = find_ipopt_ending(str(statistics["return_status"]))
    outcome, ended = FrictionOutcome[name], f"Ipopt ended: {reason}"
    x = np.clip(np.array(answer["x"], dtype=np.float64).ravel() * scales, low, high)
    if not np.all(np.isfinite(x)):
        x, outcome, ended = start, FrictionOutcome.FAILED, f"{ended}, without finite numbers"
    return _Run(
        x=x,
        objective=cost.find_value(x) * cost.scale,
        outcome=outcome,
        ended=ended,
        iterations=int(statistics["iter_count"]),
    )
