"""The physically consistent fit: parameters of bodies that exist.

Rows, what can be identified from them, Bodies -> RegressionFit.

    consistent   min |W (A K pi - y)|^2 / (2 s^2) + g sum_i D(P_i, P0_i)
    P_i = L_i Q_i L_i' > 0,   L_i L_i' = P0_i,   Q_i = C C', C lower triangular with exp on its diagonal
    IA = u IA0 > 0, u = exp(t);   Fv, Fc >= 0

with the weights W of wls, and the distance D = tr Q - log det Q - 4 (for rotors u - log u - 1). Every point
of these coordinates is a set of bodies with a mass distribution (log-Cholesky: Rucker and Wensing 2022,
IEEE RA-L 7(2)): no constraint remains but the bounds. In Q the problem is convex, and the coordinates are
one to one: there is one optimum of all bodies. Newton's method finds it in Q, and Ipopt, in these
coordinates about what was found, confirms it.

The distance counts as an observation: a body at a distance of one from the one expected, its mass alone
three times that, say, costs as much as one row that is off by its standard deviation s: g = 1/2. So it
hardly moves what the rows determine, and decides what they leave open. s is of what bodies leave of the
rows: where the rows contradict all bodies, that is more than noise. Without the distance there may be no
optimum at all: a moment of inertia that the rows want at zero is only approached, by a mass m that they do
not see, and the cost falls with 1/m. With it m grows with 1 / sqrt(g).

Newton's method: in Q the cost is convex, and over its weight self-concordant. With Q = C C' a step C (1 +
E) C' solves

    min |J e + r|^2 + t sum (|E + C' B C - 1|^2 + (e_u + b u - 1)^2) + s sum (e_v - 1)^2,

r the weighted errors, J their slopes along e, u (1 + e_u) and v (1 + e_v): the logarithms become unit
matrices there, and QR of these rows keeps the digits that normal equations lose, near the edge of all
bodies too. The best length along each step is found exactly. The weight t of the distance falls to g from
one at which the bodies expected are next to the optimum, s of -log v, which stands for v >= 0, further, to
nearly nothing; fast where few steps reach the next optimum. Newton's decrement l bounds what is left, with
b numbers v:

    cost - least <= s (-l - log(1 - l)) + s b,   l^2 = e' H e / s

(Nesterov and Nemirovskii 1994, Interior-point polynomial algorithms in convex programming, chapter 2).

Supported: every rank of the rows; a start from another set of bodies.
Not supported: standard deviations of its own: those of wls are given, which the bounds can only make
smaller.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, SolverError
from symid.identification.estimators.consistent_problem import LOOSE, Bodies, ConsistentCost, build_cost
from symid.identification.estimators.least_squares import RegressionFit, estimate_group_weights, fit_weighted
from symid.identification.regression import Identifiability, Rows, condense_rows, stack_condensed
from symid.ipopt import build_ipopt_functions, describe_ipopt_status

_LIMIT = 3000
# Rules of thumb, seen in no result: they only decide how many steps it takes.
_FALL = 0.1
_STEEPEST = 1e-3
_FEW = 3
_MANY = 6
_NEAR = 0.3
_KEPT = 0.95
_STEPS_OF_LENGTH = 60
# The last weight of the logarithms of friction, and what of a step may be left undone, in units of g.
_BOUND = 1e-10
_DONE = 1e-20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OptimalBodies:
    """Where Newton's method ended.

    Args:
        factors: (n, 4, 4) C, lower triangular, Q = C C'; rotors: (a,) u; others: (b + c,) v.
        gap: the cost is above the least by this at most, but for rounding; infinite where it did not arrive.
        iterations: steps.
    """

    factors: FloatArray
    rotors: FloatArray
    others: FloatArray
    gap: float = np.inf
    iterations: int = 0


class _Step(NamedTuple):
    """E (n, 4, 4), e_u (a,), e of the others (b + c,); J e (k,); e' H e."""

    blocks: FloatArray
    rotors: FloatArray
    others: FloatArray
    change: FloatArray
    promise: float


class _Weights(NamedTuple):
    """t of the distance, s of what must not be negative."""

    distance: float
    bound: float


def _compute_errors(cost: ConsistentCost, state: OptimalBodies) -> FloatArray:
    """Return r (k,)."""
    blocks = state.factors @ state.factors.transpose(0, 2, 1)
    values = np.einsum("pnab,nab->p", cost.forms, blocks)
    values = values + cost.positive @ state.rotors + cost.others @ state.others
    errors: FloatArray = cost.triangle @ np.append(values, -1.0)
    return errors


def _compute_step(cost: ConsistentCost, state: OptimalBodies, errors: FloatArray, weights: _Weights) -> _Step:
    """Return Newton's step."""
    from symid.dynamics import flatten_symmetric, unflatten_symmetric

    links, rotors, bounded = len(state.factors), len(state.rotors), cost.bounded
    across = state.factors.transpose(0, 2, 1)
    rows = cost.triangle[:, :-1]
    forms = flatten_symmetric(across @ cost.forms @ state.factors)
    sizes = np.append(state.others[:bounded], np.ones(len(state.others) - bounded))
    effects = np.hstack([forms.reshape(len(forms), -1), cost.positive * state.rotors, cost.others * sizes])
    slopes = rows @ effects
    first, second = 10 * links, 10 * links + rotors
    pull = flatten_symmetric(across @ cost.pulls @ state.factors - np.eye(4))
    held = np.zeros((slopes.shape[1] + bounded, slopes.shape[1]))
    aim = np.zeros(len(held))
    root = np.sqrt(weights.distance)
    held[range(second), range(second)] = root
    aim[:first] = -root * pull.ravel()
    aim[first:second] = -root * (cost.rotor_pulls * state.rotors - 1.0)
    spots = np.arange(second, slopes.shape[1])
    held[spots, spots] = np.sqrt(LOOSE) * sizes
    aim[spots] = -np.sqrt(LOOSE) * (state.others - cost.middle)
    edge = np.arange(bounded)
    held[len(aim) - bounded + edge, second + edge] = np.sqrt(weights.bound)
    aim[len(aim) - bounded :] = np.sqrt(weights.bound)
    whole, right = np.vstack([slopes, held]), np.concatenate([-errors, aim])
    lengths = np.linalg.norm(whole, axis=0)
    factor: FloatArray = np.asarray(np.linalg.qr(np.column_stack([whole / lengths, right]), mode="r"))
    size = len(lengths)
    chosen = np.linalg.solve(factor[:size, :size], factor[:size, size])
    step = chosen / lengths
    return _Step(
        blocks=unflatten_symmetric(step[:first].reshape(links, 10)),
        rotors=step[first:second],
        others=step[second:],
        change=slopes @ step,
        promise=float(factor[:size, size] @ factor[:size, size]),
    )


def _compute_length(
    cost: ConsistentCost, state: OptimalBodies, errors: FloatArray, step: _Step, weights: _Weights
) -> float:
    """Return the length of least cost along a step, where its slope, which only grows, is zero."""
    bounded = cost.bounded
    own = np.linalg.eigvalsh(step.blocks).ravel()
    logs = np.concatenate([own, step.rotors, step.others[:bounded]])
    shares = np.full(len(logs), weights.distance)
    shares[len(logs) - bounded :] = weights.bound
    pulls = state.factors.transpose(0, 2, 1) @ cost.pulls @ state.factors
    linear = weights.distance * float(
        np.einsum("nab,nab->", pulls, step.blocks) + (cost.rotor_pulls * state.rotors) @ step.rotors
    )
    moved = step.others * np.append(state.others[:bounded], np.ones(len(step.others) - bounded))
    linear += float(errors @ step.change) + LOOSE * float((state.others - cost.middle) @ moved)
    square = float(step.change @ step.change) + LOOSE * float(moved @ moved)
    lowest = float(logs.min(initial=0.0))
    low, high = 0.0, -_KEPT / lowest if lowest < 0.0 else 1e3
    length = min(1.0, high)
    for _ in range(_STEPS_OF_LENGTH):
        inner = logs / (1.0 + length * logs)
        slope = linear + length * square - float(shares @ inner)
        low, high = (length, high) if slope < 0.0 else (low, length)
        newton = length - slope / (square + float(shares @ inner**2))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - length) < 1e-3 * length:
            return following
        length = following
    return length


def _advance(cost: ConsistentCost, state: OptimalBodies, step: _Step, length: float) -> OptimalBodies:
    bounded = cost.bounded
    inner = np.linalg.cholesky(np.eye(4) + length * step.blocks)
    held = state.others[:bounded] * (1.0 + length * step.others[:bounded])
    return replace(
        state,
        factors=state.factors @ inner,
        rotors=state.rotors * (1.0 + length * step.rotors),
        others=np.append(held, state.others[bounded:] + length * step.others[bounded:]),
        iterations=state.iterations + 1,
    )


def _centre(
    cost: ConsistentCost, state: OptimalBodies, level: float, limit: int
) -> tuple[OptimalBodies, int]:
    """Return where at most `limit` steps lead at one weight, and their number; more if they do not arrive."""
    weights = _Weights(max(level, cost.weight), level)
    for count in range(limit + 1):
        errors = _compute_errors(cost, state)
        step = _compute_step(cost, state, errors, weights)
        if step.promise < _NEAR**2 * level:
            return state, count
        if not np.isfinite(step.promise):
            break
        state = _advance(cost, state, step, _compute_length(cost, state, errors, step, weights))
    return state, limit + 1


def _polish(cost: ConsistentCost, state: OptimalBodies, level: float) -> OptimalBodies:
    """Return the state after whole steps, until they promise no more or rounding lets them gain no more."""
    weights = _Weights(cost.weight, level)
    last = np.inf
    while True:
        step = _compute_step(cost, state, _compute_errors(cost, state), weights)
        if not _DONE * cost.weight < step.promise < 0.25 * last:
            left = float(np.sqrt(np.fmin(step.promise, last) / level))
            # -l - log(1 - l) <= l^2 / (2 (1 - l)), without the digits that the left-hand side loses.
            return replace(state, gap=level * (0.5 * left**2 / (1.0 - left) + cost.bounded))
        state, last = _advance(cost, state, step, 1.0), step.promise


def _start(cost: ConsistentCost, unknowns: FloatArray) -> OptimalBodies:
    factors, rotors, others = cost.split(unknowns)
    inner = np.maximum(others[: cost.bounded], 1.0)
    return OptimalBodies(factors=factors, rotors=rotors, others=np.append(inner, others[cost.bounded :]))


def optimise_bodies(cost: ConsistentCost, start: FloatArray, known: float | None = None) -> OptimalBodies:
    """Return the bodies of least cost.

    Args:
        cost: what to minimise.
        start: (u,) unknowns of the cost.
        known: the weight of which `start` is the optimum; None where it is any bodies.
    """
    state, fall = _start(cost, start), _FALL
    errors = _compute_errors(cost, state)
    end = _BOUND * cost.weight if cost.bounded else cost.weight
    level = max(cost.weight, float(errors @ errors) if known is None else known)
    # As short a step along the way that whole Newton steps follow it: it always arrives.
    gentle = 1.0 - _NEAR / np.sqrt(4 * len(cost.roots) + len(state.rotors) + cost.bounded)
    state, spent = _centre(cost, state, level, _LIMIT)
    while spent < _LIMIT:
        if level <= end:
            return replace(_polish(cost, state, end), iterations=spent)
        below = max(end, fall * level)
        patience = _MANY if fall < gentle else _LIMIT - spent
        reached, count = _centre(cost, state, below, patience)
        spent += count
        if count > patience:
            fall = min(gentle, float(np.sqrt(fall)))
            continue
        state, level = reached, below
        if count <= _FEW:
            fall = max(_STEEPEST, fall**1.5)
    return replace(state, iterations=spent)


_WEIGHT = 0.5
_IPOPT_LIMIT = 500
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


def fit_consistent(
    rows: Rows, seen: Identifiability, freedom: str = "band", *, bodies: Bodies
) -> RegressionFit:
    """Return the fit of bodies that exist.

    Args:
        rows: the equations.
        seen: what they can tell.
        freedom: see `fit_ols`.
        bodies: what links the parameters to bodies.

    Raises:
        SolverError: no optimum was found.
    """
    weights = estimate_group_weights(rows, seen, freedom)
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
    return RegressionFit(
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
    cost, found = _iterate_weight(plain, max(square, float(len(centre))), start)
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
        gradient=_measure_gradient(near, unknowns),
        ending=ending,
        steps=found.iterations,
        iterations=iterations,
    )


def _iterate_weight(
    cost: ConsistentCost, square: float, start: FloatArray | None
) -> tuple[ConsistentCost, OptimalBodies]:
    """Return the cost with its weight in units of the noise that its bodies leave, and these bodies.

    A greater weight leaves more, and more noise makes the weight greater: from that of a perfect fit it grows
    until it settles, at the least weight that agrees with itself; rows far from the bodies expected may have
    a second one, at which bodies hardly follow them. Where the way to the first is too long, it falls, from
    that of the bodies expected.
    """
    first = cost.centre if start is None else start
    found = optimise_bodies(cost, first)
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
            optimise_bodies(cost, unknowns, known)
            if wanted < _WARM * known < np.inf
            else optimise_bodies(cost, first)
        )
        steps, known = steps + found.iterations, wanted
        unknowns = cost.join(found.factors, found.rotors, found.others)
        if not np.isfinite(found.gap):
            break
    return cost, replace(found, iterations=steps)


def _finish(cost: ConsistentCost, found: OptimalBodies) -> tuple[FloatArray, str, int]:
    """Return unknowns of `cost`, about the bodies found, what Ipopt says of them, and its iterations.

    Where Ipopt does not call its point an optimum, or comes to a worse one, the bodies found are the answer
    if Newton's decrement shows that no other bodies could be cheaper by what matters.
    """
    first = np.append(np.zeros(len(cost.centre) - len(found.others)), found.others)
    best = cost.find_value(first)
    reached, status, iterations = _run_ipopt(cost, first)
    outcome, reason = describe_ipopt_status(status)
    margin = _CERTAIN * (best + cost.weight)
    if outcome in {"CONVERGED", "ACCEPTABLE"} and cost.find_value(reached) <= best + margin:
        return reached, reason, iterations
    if found.gap <= margin:
        return first, f"{reason}; by Newton's decrement the bodies it began with are the optimum", iterations
    text = f"no optimum among bodies that exist was found: {reason}; identify with wls, and export that"
    raise SolverError(Notice(code="solver.consistent", text=text))


def _compute_units(cost: ConsistentCost, unknowns: FloatArray) -> FloatArray:
    """Return the standard deviation (u,) of each unknown if the others are known."""
    curvature = np.diag(cost.find_hessian(unknowns))
    units: FloatArray = 1.0 / np.sqrt(np.maximum(curvature, np.finfo(float).tiny))
    return units


def _measure_gradient(cost: ConsistentCost, unknowns: FloatArray) -> float:
    units = _compute_units(cost, unknowns)
    slopes = cost.find_gradient(unknowns) * units
    room = (unknowns - cost.lower) / units
    # Against a bound a slope is held by it.
    return float(np.abs(np.where(slopes > 0.0, np.minimum(slopes, room), slopes)).max())


def _run_ipopt(cost: ConsistentCost, start: FloatArray) -> tuple[FloatArray, str, int]:
    """Return where Ipopt ends, unknowns in units of their standard deviations, its status, its iterations."""
    import casadi

    size, units = len(start), _compute_units(cost, start)
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
            "max_iter": _IPOPT_LIMIT,
            "mu_strategy": "adaptive",
        },
    }
    solver = casadi.nlpsol("consistent", "ipopt", {"x": unknowns, "f": functions.value(unknowns)}, options)
    answer = solver(x0=start / units, lbx=cost.lower, ubx=np.full(size, np.inf))
    state = solver.stats()
    found = units * np.array(answer["x"], dtype=np.float64).ravel()
    status = str(state["return_status"]) if np.all(np.isfinite(found)) else "Invalid_Number_Detected"
    return found, status, int(state["iter_count"])
