"""The physically consistent fit: parameters of bodies that exist.

Robot -> Bodies: beta = K pi in numbers. Rows, what can be identified from them, Bodies -> RegressionFit.

    consistent   min |W (A K pi - y)|^2 / (2 s^2) + g sum_i D(P_i, P0_i)
    P_i = L_i Q_i L_i' > 0,   L_i L_i' = P0_i,   IA = u IA0 > 0;   Fv, Fc >= 0

with the weights W of wls, and the distance D = tr Q - log det Q - 4 (for rotors u - log u - 1), which counts
as half an observation, g = 1/2: it hardly changes identifiable parameters and fixes the others. Without it a
moment of inertia that the rows want at zero is only approached, by a mass that grows without end. In Q and u
the problem is convex; `gap` bounds the distance of Newton's method to the least cost. s is of what bodies
leave of the rows; a warning says where that is surely more than without bounds (chi-squared), and matters.

Supported: every rank of the rows; links, rotors of joints and couplings, friction; lengths with a value.
Not supported: elastic joints; standard deviations of its own: those of wls are given.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from symid import dynamics
from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.errors import Notice, SolverError, UsageError
from symid.identification import regression
from symid.identification.estimators.least_squares import RegressionFit, estimate_group_weights, fit_weighted
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import Identifiability, Rows
from symid.joint_models import is_braking
from symid.notation import INERTIAL
from symid.robot import Robot, build_pseudo_inertias


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bodies(FrozenArrays):
    """beta = K pi in numbers, of the base parameters `names` (p,), friction among them.

    `links` (p, n, 10) are coefficients of the links' standard parameters, `positive` (p, a) of rotor
    inertias, which must be positive, `bounded` (p, b) of viscous and dry friction, which must not be
    negative, `free` (p, c) of offsets, springs and the like. `stated` (n, 10) are bodies of the robot file,
    or round ones in their place; the distance to them decides what the log leaves open. `unit` whether the
    file states none, and their mass is one each.
    """

    names: tuple[str, ...]
    links: FloatArray
    positive: FloatArray
    bounded: FloatArray
    free: FloatArray
    stated: FloatArray
    unit: bool


def build_bodies(robot: Robot) -> Bodies:
    """Return the bodies behind the base parameters; raise RobotError where a symbolic length has no value."""
    base = dynamics.derive_base_parameters(robot)
    names = tuple(entry.name for entry in (*base.parameters, *base.friction))
    grouping = dynamics.build_grouping(robot, base, names)
    column = {label: index for index, label in enumerate(grouping.labels)}
    used = [label for label in grouping.labels if grouping.matrix[:, column[label]].any()]
    places = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    rotors = [label for label in used if label[1] == "IA"]
    bounded = [label for label in used if is_braking(label[1])]
    others = [label for label in used if label[1] not in (*INERTIAL, "IA") and label not in bounded]

    places_of = [[column[label] for label in labels] for labels in (rotors, bounded, others)]
    positive, bound, free = (grouping.matrix[:, own].reshape(len(names), len(own)) for own in places_of)
    return Bodies(
        names=names,
        links=grouping.matrix[:, places],
        positive=positive,
        bounded=bound,
        free=free,
        stated=dynamics.build_prior(robot, grouping.matrix[:, np.ravel(places)], np.zeros(len(names))),
        unit=all(joint.inertial is None for joint in robot.joints),
    )


class ConsistentCost(NamedTuple):
    """The cost in blocks Q, rotors u, friction and other observable parameters, over their deviations.

    `roots` (n, 4, 4) are L, `rotors` (a,) IA0, `loose` (p, b + c) effects of a unit of friction and the rest.
    """

    problem: dynamics.BodyProblem
    roots: FloatArray
    rotors: FloatArray
    loose: FloatArray


def build_cost(triangle: FloatArray, centre: FloatArray, bodies: Bodies, weight: float) -> ConsistentCost:
    """Return the cost, arguments as of `solve_consistent`; `weight` is that of the distance.

    Bodies of unknown mass get the one that suits the parameters without bounds.
    """
    mass = 1.0
    if bodies.unit:
        # The mass with which bodies of unit mass are nearest to the parameters.
        unit = np.einsum("pnk,nk->p", bodies.links, bodies.stated)
        sizes = np.einsum("pnk,nk->p", np.abs(bodies.links), np.abs(bodies.stated))
        kept = sizes > 0.0
        share, wanted = (unit[kept] / sizes[kept]), centre[kept] / sizes[kept]
        mass = float(share @ wanted) / max(float(share @ share), np.finfo(float).tiny)
        mass = mass if mass > 0.0 else max(float(np.abs(wanted).max(initial=0.0)), numerics.RANK)
    expected = build_pseudo_inertias(bodies.stated * mass)
    roots = np.asarray(np.linalg.cholesky(expected), dtype=np.float64)
    forms = np.einsum("pnk,kab->pnab", bodies.links, dynamics.PSEUDO_INERTIA_FORMS)
    forms = roots.transpose(0, 2, 1) @ forms @ roots
    matrix = triangle[:, :-1]
    # Expected is half of the parameter that a rotor is part of.
    sizes = np.where(bodies.positive > 0.0, np.abs(centre)[:, None], 0.0).max(axis=0, initial=0.0)
    rotors = np.maximum(0.5 * sizes, numerics.RANK)
    loose = np.hstack([bodies.bounded, bodies.free])
    lengths = np.linalg.norm(matrix @ loose, axis=0)
    # Without any effect on the rows a parameter stays at zero.
    observable = lengths > 0.0
    loose, lengths = loose[:, observable], lengths[observable]
    middle = np.linalg.lstsq(loose, centre, rcond=None)[0] * lengths if loose.size else np.zeros(0)
    dissipating = int(np.count_nonzero(observable[: bodies.bounded.shape[1]]))
    middle[:dissipating] = np.maximum(middle[:dissipating], 0.0)
    # What no parameters explain is left out: the cost begins at zero, and the last digits count.
    sizes = np.linalg.norm(matrix, axis=0)
    left, singular, _ = np.linalg.svd(matrix / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False)
    basis = left[:, singular > numerics.EXACT * singular.max(initial=0.0)]
    explained = basis @ (basis.T @ (triangle[:, -1] - matrix @ centre))
    problem = dynamics.BodyProblem(
        blocks=np.tensordot(matrix, forms, axes=1),
        positive=matrix @ (bodies.positive * rotors),
        others=matrix @ (loose / lengths),
        target=matrix @ centre + explained,
        shares=np.ones(len(roots) + len(rotors)),
        weight=weight,
        middle=middle,
        # Half the squared difference of friction and offsets to the fit without bounds, in their deviations:
        # no effect where the rows determine them, and a unique answer where they do not.
        loose=numerics.RIDGE,
        bounded=dissipating,
    )
    return ConsistentCost(problem, roots, rotors, loose / lengths)


_WEIGHT = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ConsistentSolution:
    """Bodies that fit best.

    `values` (p,) base parameters and friction; `pi` (n, 10) standard parameters of the links; `eigenvalue`
    the smallest one of the pseudo-inertias, SI; `nearest` the unknowns of the cost; `weight` of the distance,
    g times the square of the noise that bodies leave.
    """

    values: FloatArray
    pi: FloatArray
    eigenvalue: float
    nearest: dynamics.NearestBodies
    weight: float


def fit_consistent(
    rows: Rows, identifiability: Identifiability, freedom: str = "band", *, bodies: Bodies | None = None
) -> RegressionFit:
    """Return the fit of bodies that exist, as `fit_ols`; raise UsageError where no bodies are given."""
    if bodies is None:
        text = "the estimator consistent needs the bodies of the robot: give them in the options"
        raise UsageError(Notice(code="usage.no-bodies", text=text))
    weights = estimate_group_weights(rows, identifiability, freedom)
    free = fit_weighted(rows, identifiability, weights, freedom)
    _, independent = regression.count_freedom(freedom, free.spent, rows.independent)
    weighted = free.residuals * free.weights
    square = float(weighted @ weighted)
    spare = independent * (len(weighted) - float(free.spent.sum()))
    variance = max(square, 1e-18 * len(weighted)) / spare
    triangle = regression.stack_condensed(regression.condense_rows(rows), weights) / np.sqrt(variance)
    found = solve_consistent(triangle, free.values, bodies)
    residuals = rows.values - rows.matrix @ found.values
    growth = float(np.sum((residuals * free.weights) ** 2)) / max(square, numerics.TINY) - 1.0
    # Of normal errors the bounds cost chi-squared of all parameters at most.
    chance = scipy.special.chdtrc(identifiability.basis.shape[1], growth * square / variance)
    price = 100.0 * (float(np.sqrt(1.0 + growth)) - 1.0)
    notices: tuple[Notice, ...] = ()
    if chance < POLICY.alarm and growth > POLICY.relevance:
        text = f"the residual is {price:.3g} % larger than that of weighted least squares: no physically "
        text += "consistent bodies fit the log; check signs, units and the order of joints (`symid check`), "
        text += "or add the missing term to the model"
        notices = (Notice(code="identify.price", text=text),)
    return replace(
        free,
        values=found.values,
        residuals=residuals,
        report={
            "price_percent": price,
            "eigenvalue": found.eigenvalue,
            "weight": found.weight,
            "steps": found.nearest.iterations,
            "gap": found.nearest.gap,
            "gradient": found.nearest.gradient,
            "standard_parameters": found.pi.tolist(),
        },
        notices=notices,
    )


def solve_consistent(triangle: FloatArray, centre: FloatArray, bodies: Bodies) -> ConsistentSolution:
    """Return the bodies that minimise |F [x; -1]|^2 / 2 and the distance to those expected, or a SolverError.

    F (k, p + 1) is `triangle`, of the weighted rows over the standard deviation of their noise; `centre` (p,)
    are the parameters without bounds, for the size of the bodies to start from.
    """
    cost = build_cost(triangle, centre, bodies, _WEIGHT)
    square = float(np.sum((triangle @ np.append(centre, -1.0)) ** 2))
    # The weight is in units of the noise that the bodies leave. A greater weight leaves more, and more noise
    # makes the weight greater: from that of a perfect fit it grows until it converges, at the least weight
    # that agrees with itself; rows far from the bodies expected may have a second one, at which bodies hardly
    # follow them. Where the way to the first is too long, it falls, from that of the bodies expected.
    problem, square = cost.problem, max(square, float(len(centre)))
    found = dynamics.optimise_bodies(problem)
    steps = found.iterations
    known, start = problem.weight, found
    if not np.isfinite(found.gap):
        known, start = np.inf, dynamics.build_expected_bodies(problem)
    for _ in range(numerics.ROUNDS):
        errors = dynamics.compute_errors(problem, start)
        wanted = _WEIGHT * (1.0 + float(errors @ errors) / square)
        if abs(wanted - known) <= numerics.CONVERGED * min(known, wanted):
            break
        problem = replace(problem, weight=wanted)
        # Where it more than doubles, the way from the bodies expected is shorter.
        warm = wanted < 2.0 * known < np.inf
        near = (start, known) if warm else ()
        found = start = dynamics.optimise_bodies(problem, *near)
        steps, known = steps + found.iterations, wanted
        if not np.isfinite(found.gap):
            break
    found = replace(found, iterations=steps)
    if not found.gap <= numerics.CONVERGED * (dynamics.compute_cost(problem, found) + problem.weight):
        text = f"no optimum among consistent bodies: Newton's method did not converge in {found.iterations} "
        text += "steps; identify with wls, and export that"
        raise SolverError(Notice(code="solver.consistent", text=text))
    lower = cost.roots @ found.factors
    inertias = np.asarray(lower @ lower.transpose(0, 2, 1))
    eigenvalue = float(np.linalg.eigvalsh(inertias).min())
    if not eigenvalue > 0.0:
        text = "the best bodies are singular to working precision: no bodies fit the log, or it excites them "
        text += "too little; identify with wls, and look at the parameters it refuses"
        raise SolverError(Notice(code="solver.singular-bodies", text=text))
    pi = dynamics.compute_standard_parameters(inertias)
    values = np.einsum("pnk,nk->p", bodies.links, pi) + cost.loose @ found.others
    values = freeze(values + bodies.positive @ (cost.rotors * found.positive))
    return ConsistentSolution(values, freeze(pi), eigenvalue, found, problem.weight)
