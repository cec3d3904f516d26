"""The physically consistent fit: parameters of bodies that exist.

Input: rows and what they can tell, the bodies behind the parameters. Output: `Fit`.

    consistent   min |W (A K pi - y)|^2 / (2 s^2) + g sum_i D(P_i, P0_i)
    P_i = L_i Q_i L_i' > 0,   L_i L_i' = P0_i,   Q_i = C C', C lower triangular with exp on its diagonal
    IA = u IA0 > 0, u = exp(t);   Fv, Fc >= 0

with the weights W and the variance s^2 of wls, and the distance of `consistency`, D = tr Q - log det Q - 4
(for rotors u - log u - 1). Every point of these coordinates is a set of bodies with a mass distribution
(log-Cholesky: Rucker and Wensing 2022, IEEE RA-L 7(2)): no constraint remains but the bounds. In Q the
problem is convex, and the coordinates are one to one: what Ipopt finds is the optimum of all bodies.

The weight g is small: it moves a parameter by a small part of its standard deviation, chooses
among the sets of bodies that the torque does not tell apart, and keeps Q away from the edge.

Supported: every rank of the rows; a start from another set of bodies.
Not supported: deviations of their own: those of wls are given, which the bounds can only make smaller.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, SolverError
from symid.identification.bodies import Bodies
from symid.identification.condensation import condense_rows, stack_condensed
from symid.identification.consistent_cost import ConsistentCost, build_cost
from symid.identification.identifiability import Identifiability
from symid.identification.ipopt_functions import build_ipopt_functions
from symid.identification.ipopt_status import find_ipopt_ending
from symid.identification.regression import Fit, find_group_weights, fit_weighted
from symid.identification.rows import Rows

__all__ = ["ConsistentSolution", "fit_consistent", "solve_consistent"]

_WEIGHT = 1e-3
_LIMIT = 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsistentSolution:
    """Bodies that fit best.

    Args:
        values: (p,) base parameters and friction; pi: (n, 10) standard parameters of the links.
        eigenvalue: the smallest one of the pseudo-inertias, SI.
        unknowns: of the cost, for a later start; iterations: of Ipopt.
    """

    values: FloatArray
    pi: FloatArray
    eigenvalue: float
    unknowns: FloatArray
    iterations: int


def fit_consistent(rows: Rows, seen: Identifiability, freedom: str = "band", *, bodies: Bodies) -> Fit:
    """Return the fit of bodies that exist.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        bodies: what links the parameters to bodies.

    Raises:
        SolverError: Ipopt found no optimum.
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
            "iterations": found.iterations,
            "standard_parameters": found.pi.tolist(),
        },
    )


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
        SolverError: Ipopt found no optimum.
    """
    cost = build_cost(triangle, centre, bodies, _WEIGHT)
    unknowns, iterations = _run_ipopt(cost, cost.start if start is None else start)
    blocks = cost.find_bodies(unknowns)
    return ConsistentSolution(
        values=freeze(cost.find_values(unknowns)),
        pi=freeze(cost.find_parameters(unknowns)),
        eigenvalue=float(np.linalg.eigvalsh(blocks).min()),
        unknowns=freeze(unknowns),
        iterations=iterations,
    )


def _run_ipopt(cost: ConsistentCost, start: FloatArray) -> tuple[FloatArray, int]:
    import casadi

    size = len(start)
    functions = build_ipopt_functions(size, cost.find_value, cost.find_gradient, cost.find_hessian)
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
    answer = solver(x0=start, lbx=cost.lower, ubx=np.full(size, np.inf))
    state = solver.stats()
    outcome, reason = find_ipopt_ending(str(state["return_status"]))
    found = np.array(answer["x"], dtype=np.float64).ravel()
    if outcome not in {"CONVERGED", "ACCEPTABLE"} or not np.all(np.isfinite(found)):
        text = f"no optimum among bodies that exist was found: {reason}; identify with wls, and export that"
        raise SolverError(Notice(code="solver.consistent", text=text))
    return found, int(state["iter_count"])
