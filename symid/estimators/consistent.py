"""The physically consistent fit: parameters of bodies that exist.

Input: rows and what they can tell, the bodies behind the parameters. Output: `Fit`.

    consistent   min |W (A K pi - y)|^2 / (2 s^2) + g sum_i D(P_i, P0_i)
    P_i = L_i Q_i L_i' > 0,   L_i L_i' = P0_i,   Q_i = C C', C lower triangular with exp on its diagonal
    IA = u IA0 > 0, u = exp(t);   Fv, Fc >= 0

with the weights W of wls, and the distance of `consistency`, D = tr Q - log det Q - 4 (for rotors u - log u -
1). Every point of these coordinates is a set of bodies with a mass distribution (log-Cholesky: Rucker and
Wensing 2022, IEEE RA-L 7(2)): no constraint remains but the bounds. In Q the problem is convex, and the
coordinates are one to one: there is one optimum of all bodies. `consistent_newton` finds it in Q, and Ipopt,
in these coordinates about what was found, states that it is the optimum.

The distance counts as an observation: a body at a distance of one from the one expected, its mass alone three
times that, say, costs as much as one row that is off by its standard deviation s: g = 1/2. So it hardly moves
what the rows tell, and decides what they leave open. s is of what bodies leave of the rows: where the rows
contradict all bodies, that is more than noise. Without the distance there may be no optimum at all: a moment
of inertia that the rows want at zero is only approached, by a mass m that they do not see, and the cost falls
with 1/m. With it m grows with 1 / sqrt(g).

Supported: every rank of the rows; a start from another set of bodies.
Not supported: deviations of their own: those of wls are given, which the bounds can only make smaller.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, SolverError
from symid.estimators.bodies import Bodies
from symid.estimators.consistent_cost import ConsistentCost, build_cost
from symid.estimators.consistent_newton import BodiesFound, find_bodies
from symid.estimators.ipopt_functions import build_ipopt_functions
from symid.estimators.ipopt_status import find_ipopt_ending
from symid.estimators.regression import Fit, find_group_weights, fit_weighted
from symid.rows.condensation import condense_rows, stack_condensed
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = ["ConsistentSolution", "fit_consistent", "solve_consistent"]

_WEIGHT = 0.5
_LIMIT = 500
_DEAR = 5.0
"""Price in percent beyond which the log is at odds with all bodies."""
# The weight is settled when the noise that it is measured in changes by less than this part.
_SETTLED = 1e-9
_PASSES = 100
# To a weight that is greater by more than this the way is shorter from the bodies expected.
_WARM = 2.0
# What may be left of the cost where Newton's decrement has to vouch for it, as a part of cost and weight.
_CERTAIN = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsistentSolution:
    """Bodies that fit best.

    Args:
        values: (p,) base parameters and friction; pi: (n, 10) standard parameters of the links.
        eigenvalue: the smallest one of the pseudo-inertias, SI.
        unknowns: of the cost, for a later start.
        weight: of the distance, g times the square of the noise that bodies leave.
        gap: the cost is above the least by this at most, after Newton's method; gradient: largest entry of
        the
            last one, unknowns in units of their standard deviations, what a bound holds left out.
        ending: what Ipopt says; steps: of Newton's method; iterations: of Ipopt.
    """

    values: FloatArray
    pi: FloatArray
    eigenvalue: float
    unknowns: FloatArray
    weight: float
    gap: float
    gradient: float
    ending: str
    steps: int
    iterations: int


def fit_consistent(rows: Rows, seen: Identifiability, freedom: str = "band", *, bodies: Bodies) -> Fit:
    """Return the fit of bodies that exist.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        bodies: what links the parameters to bodies.

    Raises:
        SolverError: no optimum was found.
    """
    weights = find_group_weights(rows, seen, freedom)
    free = fit_weighted(rows, seen, weights, freedom)
    independent = rows.independent if freedom == "band" else 1.0
    weighted = free.residuals * free.weights
    square = float(weighted @ weighted)
    variance = max(square, 1e-18 * len(weighted)) / (len(weighted) - free.spent / independent) / independent
    triangle = stack_condensed(condense_rows(rows), weights) / np.sqrt(variance)
    found = solve_consistent(triangle, free.values, bodies)
    residuals = rows.values - rows.matrix @ found.values
    bounded = residuals * free.weights
    price = 100.0 * (float(np.linalg.norm(bounded)) / max(np.sqrt(square), 1e-300) - 1.0)
    return Fit(
        values=found.values,
        covariance=free.covariance,
        residuals=residuals,
        spent=free.spent,
        condition=free.condition,
        weights=free.weights,
        report={
            "price_percent": price,
            "eigenvalue": found.eigenvalue,
            "weight": found.weight,
            "steps": found.steps,
            "gap": found.gap,
            "iterations": found.iterations,
            "ending": found.ending,
            "gradient": found.gradient,
            "standard_parameters": found.pi.tolist(),
        },
        notices=_warn_of_price(price),
    )


def _warn_of_price(price: float) -> tuple[Notice, ...]:
    if price <= _DEAR:
        return ()
    text = (
        f"the bodies that fit best leave {price:.3g} % more than weighted least squares does: the log is at "
        "odds with all bodies that exist; look for wrong signs, units or exchanged joints (`symid check`), "
        "or for a term that the model misses"
    )
    return (Notice(code="identify.price", text=text),)


def solve_consistent(
    triangle: FloatArray, centre: FloatArray, bodies: Bodies, start: FloatArray | None = None
) -> ConsistentSolution:
    """Return the bodies that minimise |F [x; -1]|^2 / 2 and the distance to those expected.

    Args:
        triangle: F (k, p + 1) of the weighted rows over the standard deviation of their noise.
        centre: (p,) the parameters without bounds, for the size of the bodies to start from.
        bodies: what links parameters to bodies.
        start: unknowns of an earlier solution; None for the bodies expected.

    Raises:
        SolverError: no optimum was found.
    """
    plain = build_cost(triangle, centre, bodies, _WEIGHT)
    square = float(np.sum((triangle @ np.append(centre, -1.0)) ** 2))
    cost, found = _settle_weight(plain, max(square, float(len(centre))), start)
    near = cost.recentre(found.factors, found.rotors)
    unknowns, ending, iterations = _finish(near, found)
    factors, rotors, others = near.split(unknowns)
    eigenvalue = float(np.linalg.eigvalsh(near.find_bodies(unknowns)).min())
    if not eigenvalue > 0.0:
        text = "the bodies that fit best span more orders of magnitude than numbers hold: the log contradicts"
        text = f"{text} all bodies, or hardly tells anything; identify with wls, and look at what it refuses"
        raise SolverError(Notice(code="solver.consistent", text=text))
    return ConsistentSolution(
        values=freeze(near.find_values(unknowns)),
        pi=freeze(near.find_parameters(unknowns)),
        eigenvalue=eigenvalue,
        unknowns=freeze(cost.join(found.factors @ factors, found.rotors * rotors, others)),
        weight=cost.weight,
        gap=found.gap,
        gradient=_find_gradient(near, unknowns),
        ending=ending,
        steps=found.iterations,
        iterations=iterations,
    )


def _settle_weight(
    cost: ConsistentCost, square: float, start: FloatArray | None
) -> tuple[ConsistentCost, BodiesFound]:
    """Return the cost with its weight in units of the noise that its bodies leave, and these bodies.

    A greater weight leaves more, and more noise makes the weight greater: from that of a perfect fit it grows
    until it settles, at the least weight that agrees with itself; rows far from the bodies expected may have
    a second one, at which bodies hardly follow them. Where the way to the first is too long, it falls, from
    that of the bodies expected.
    """
    first = cost.centre if start is None else start
    found = find_bodies(cost, first)
    steps, known = found.iterations, cost.weight
    unknowns = cost.join(found.factors, found.rotors, found.others)
    if not np.isfinite(found.gap):
        unknowns, known = first, np.inf
    for _ in range(_PASSES):
        errors = cost.triangle @ np.append(cost.find_values(unknowns), -1.0)
        wanted = _WEIGHT * (1.0 + float(errors @ errors) / square)
        if abs(wanted - known) <= _SETTLED * min(known, wanted):
            break
        cost = replace(cost, weight=wanted)
        found = (
            find_bodies(cost, unknowns, known)
            if wanted < _WARM * known < np.inf
            else find_bodies(cost, first)
        )
        steps, known = steps + found.iterations, wanted
        unknowns = cost.join(found.factors, found.rotors, found.others)
        if not np.isfinite(found.gap):
            break
    return cost, replace(found, iterations=steps)


def _finish(cost: ConsistentCost, found: BodiesFound) -> tuple[FloatArray, str, int]:
    """Return unknowns of `cost`, about the bodies found, what Ipopt says of them, and its iterations.

    Where Ipopt does not call its point an optimum, or comes to a worse one, the bodies found are the answer
    if Newton's decrement shows that no other bodies could be cheaper by what matters.
    """
    first = np.append(np.zeros(len(cost.centre) - len(found.others)), found.others)
    best = cost.find_value(first)
    reached, status, iterations = _run_ipopt(cost, first)
    outcome, reason = find_ipopt_ending(status)
    margin = _CERTAIN * (best + cost.weight)
    if outcome in {"CONVERGED", "ACCEPTABLE"} and cost.find_value(reached) <= best + margin:
        return reached, reason, iterations
    if found.gap <= margin:
        return first, f"{reason}; by Newton's decrement the bodies it began with are the optimum", iterations
    text = f"no optimum among bodies that exist was found: {reason}; identify with wls, and export that"
    raise SolverError(Notice(code="solver.consistent", text=text))


def _find_units(cost: ConsistentCost, unknowns: FloatArray) -> FloatArray:
    """Return the standard deviation (u,) of each unknown if the others are known."""
    curvature = np.diag(cost.find_hessian(unknowns))
    units: FloatArray = 1.0 / np.sqrt(np.maximum(curvature, np.finfo(float).tiny))
    return units


def _find_gradient(cost: ConsistentCost, unknowns: FloatArray) -> float:
    units = _find_units(cost, unknowns)
    slopes = cost.find_gradient(unknowns) * units
    room = (unknowns - cost.lower) / units
    # Against a bound a slope is held by it.
    return float(np.abs(np.where(slopes > 0.0, np.minimum(slopes, room), slopes)).max())


def _run_ipopt(cost: ConsistentCost, start: FloatArray) -> tuple[FloatArray, str, int]:
    """Return where Ipopt ends, unknowns in units of their standard deviations, its status, its iterations."""
    import casadi

    size, units = len(start), _find_units(cost, start)
    functions = build_ipopt_functions(
        size,
        lambda x: cost.find_value(units * x),
        lambda x: units * cost.find_gradient(units * x),
        lambda x: np.outer(units, units) * cost.find_hessian(units * x),
    )
    unknowns = casadi.MX.sym("x", size)
    options = {
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
            "tol": 1e-6,
            "max_iter": _LIMIT,
            "mu_strategy": "adaptive",
        },
    }
    solver = casadi.nlpsol("consistent", "ipopt", {"x": unknowns, "f": functions.value(unknowns)}, options)
    answer = solver(x0=start / units, lbx=cost.lower, ubx=np.full(size, np.inf))
    state = solver.stats()
    found = units * np.array(answer["x"], dtype=np.float64).ravel()
    status = str(state["return_status"]) if np.all(np.isfinite(found)) else "Invalid_Number_Detected"
    return found, status, int(state["iter_count"])
