"""From base values back to bodies: a physically consistent standard set that has given base values.

Input: a robot, its base parameters, values of them, a prior. Output: `StandardSet`, ten standard parameters
a link of bodies that exist, and values of the drives.

Of all sets with K pi = beta the one nearest to the prior is taken, by the coordinate-free distance

    sum over links of w (tr(P P0^-1) - log det(P P0^-1) - 4)      (Lee, Wensing and Park 2020),

P the pseudo-inertia; rotor inertias IA > 0 count as x - log x - 1, x = IA / IA0, what may have either sign
(springs, friction) as x^2 / 2, x the change in units of its size. The problem is convex; `consistency_solver`
has the method, `consistency_prior` the prior where none is given.

Where no set of bodies has the base values, the set that minimises the distance plus sum (r / s)^2 / 2 is
returned, r the residual of a base value and s its standard deviation. Where none is given, s is a hundredth
of the row's size in the prior, or of what the values come to in that measure, where they are larger. The
result says so and names the base parameters that contradict each other or all bodies.

Supported: base values that are known in part: the others are then free; friction within a group of weights.
Not supported: bounds on friction and springs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import Notice, SolverError
from symid.notation import INERTIAL
from symid.parameters.base import BaseParameters, Label
from symid.parameters.consistency_equations import Scales, build_problem, find_scales
from symid.parameters.consistency_inputs import (
    Grouping,
    build_grouping,
    read_deviations,
    read_values,
    read_weights,
)
from symid.parameters.consistency_prior import find_parameters
from symid.parameters.consistency_problem import Problem, Solution
from symid.parameters.consistency_solver import find_nearest
from symid.robot.description import Robot

__all__ = ["StandardOutcome", "StandardSet", "find_standard_set"]

# The standard deviation that a base value is taken to have where none is given, in units of its row's size.
_DEVIATION = 0.01
_BLAMED = 0.05


class StandardOutcome(Enum):
    """How the search for a consistent set ended; the value says it in words."""

    CONSISTENT = "the bodies have the base values exactly"
    NEAREST = "no bodies have these base values; these come nearest to them and to the prior"


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardSet:
    """A physically consistent set of standard parameters.

    Args:
        pi: (n, 10) standard parameters of the links.
        drives: values of all other parameters that occur in the groups.
        distance: to the prior, without unit.
        names: the base parameters that had values; residual: (m,) K pi - beta of them, in their SI units.
        eigenvalue: the smallest one of the pseudo-inertias, SI.
        stationarity: the largest relative error in the conditions of optimality (Karush, Kuhn and Tucker).
        iterations: steps of the solver.
        outcome: how it ended.
        blamed: base parameters that contradict each other, or all bodies, the worst first.
        reason: the same in a sentence; empty where the set is consistent.
    """

    pi: FloatArray
    drives: tuple[tuple[Label, float], ...]
    distance: float
    names: tuple[str, ...]
    residual: FloatArray
    eigenvalue: float
    stationarity: float
    iterations: int
    outcome: StandardOutcome
    blamed: tuple[str, ...]
    reason: str


def _is_one_sided(problem: Problem, row: int) -> bool:
    """Return whether equation `row` has a positive left-hand side for all bodies."""
    lowest = float(np.linalg.eigvalsh(problem.blocks[row]).min())
    return lowest > -1e-12 and not np.any(problem.free[row]) and bool(np.all(problem.positive[row] >= 0))


def _blame(
    grouping: Grouping, target: FloatArray, problem: Problem, solution: Solution
) -> tuple[tuple[str, ...], str]:
    """Return which base values cannot be, and why.

    The multipliers nu make sum nu_i (K pi)_i >= 0 for all bodies (but for rounding), and sum nu_i beta_i < 0.
    """
    names = [parameter.name for parameter in grouping.parameters]
    alone = [row for row in range(len(names)) if problem.target[row] <= 0 and _is_one_sided(problem, row)]
    shares = np.abs(solution.multipliers)
    order = [int(row) for row in np.argsort(-shares, kind="stable") if shares[row] >= _BLAMED * shares.max()]
    blamed = alone + [row for row in order if row not in alone]
    if alone:
        listed = ", ".join(f"{names[row]} = {target[row]:.6g}" for row in alone)
        reason = f"{listed}: positive for all bodies ({grouping.parameters[alone[0]].expression})"
    else:
        listed = ", ".join(f"{names[row]} = {target[row]:.6g}" for row in order)
        reason = f"no bodies have these values at the same time: {listed}"
    links = sorted(
        {index for row in blamed for (index, name), _ in grouping.parameters[row].terms if name in INERTIAL}
    )
    text = f"{reason}; links that take part: {', '.join(str(index + 1) for index in links)}"
    return tuple(names[row] for row in blamed), text


def _measure_distance(problem: Problem, solution: Solution) -> float:
    """Return the distance from the prior."""
    w_block, w_positive, w_free = problem.split(problem.weights)
    logs = np.linalg.slogdet(solution.blocks)[1]
    traces = np.trace(solution.blocks, axis1=1, axis2=2)
    positive = solution.positive
    return float(
        w_block @ (traces - logs - 4)
        + w_positive @ (positive - np.log(positive) - 1)
        + 0.5 * w_free @ solution.free**2
    )


def _find_slack(problem: Problem, norms: FloatArray, deviations: FloatArray | None) -> FloatArray:
    """Return the squares of the rows' standard deviations."""
    if deviations is not None:
        return np.asarray((deviations / norms) ** 2)
    return np.full(len(norms), _DEVIATION**2 * max(1.0, float(np.mean(problem.target**2))))


def _build_set(
    grouping: Grouping,
    target: FloatArray,
    scales: Scales,
    problem: Problem,
    solution: Solution,
) -> StandardSet:
    """Return the solution in the units of the parameters."""
    bodies = scales.roots @ solution.blocks @ scales.roots.transpose(0, 2, 1)
    pi = find_parameters(bodies)
    drives = {
        label: unit * float(x)
        for (label, unit), x in zip(scales.positive.items(), solution.positive, strict=True)
    }
    for (label, (start, size)), x in zip(scales.free.items(), solution.free, strict=True):
        drives[label] = start + size * float(x)
    full = {(link, name): pi[link, k] for link in range(len(pi)) for k, name in enumerate(INERTIAL)} | drives
    vector = np.array([full.get(label, 0.0) for label in grouping.labels])
    return StandardSet(
        pi=freeze(pi),
        drives=tuple((label, drives[label]) for label in grouping.labels if label in drives),
        distance=_measure_distance(problem, solution),
        names=tuple(parameter.name for parameter in grouping.parameters),
        residual=freeze(grouping.matrix @ vector - target),
        eigenvalue=float(np.linalg.eigvalsh(bodies).min()),
        stationarity=solution.stationarity,
        iterations=solution.iterations,
        outcome=StandardOutcome.CONSISTENT,
        blamed=(),
        reason="",
    )


def find_standard_set(
    robot: Robot,
    base: BaseParameters,
    values: Mapping[str, float] | Sequence[float] | FloatArray,
    *,
    prior: FloatArray | None = None,
    weights: FloatArray | None = None,
    deviations: Mapping[str, float] | None = None,
) -> StandardSet:
    """Return the physically consistent standard parameters nearest to a prior that have the base values.

    Args:
        robot: the robot.
        base: its base parameters.
        values: base values by name, some or all of them, friction too; or beta (b,), or beta and f (b + p,).
        prior: (n, 10) standard parameters of bodies that exist; see `consistency_prior` for the default.
        weights: (n,) positive weights of the links in the distance; one by default.
        deviations: standard deviations of the base values, by name: they weigh the rows where no bodies
            have the base values; by default each row counts in units of its size.

    Raises:
        UsageError: a value, the prior, a weight or a deviation cannot be used.
        RobotError: a symbolic length has no value.
        SolverError: the numbers span too many orders of magnitude.
    """
    known = read_values(base, values)
    grouping = build_grouping(robot, base, tuple(known))
    target = np.array(list(known.values()))
    shares = read_deviations(known, deviations)
    scales = find_scales(robot, grouping, target, prior)
    # Numbers beyond all bounds end in an error of their own, not in warnings.
    with np.errstate(all="ignore"):
        problem, norms = build_problem(robot, grouping, target, scales, read_weights(robot, weights))
        solution = find_nearest(problem)
        if solution is not None:
            return _build_set(grouping, target, scales, problem, solution)
        problem = replace(problem, slack=_find_slack(problem, norms, shares))
        solution = find_nearest(problem)
    if solution is None:
        text = "no consistent set was found: the values and the prior lie too many orders of magnitude apart"
        raise SolverError(Notice(code="solver.standard-set", text=text))
    blamed, reason = _blame(grouping, target, problem, solution)
    found = _build_set(grouping, target, scales, problem, solution)
    return replace(found, outcome=StandardOutcome.NEAREST, blamed=blamed, reason=reason)
