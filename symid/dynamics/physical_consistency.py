"""From base values back to bodies that can exist: a physically consistent set, and the robot with it.

Robot, its base parameters, values of them, a prior -> `StandardSet`, ten standard parameters a link of
bodies that exist, and values of the drives; `IdentifiedRobot`, the robot with these values. Of all sets with
K pi = beta the one nearest to the prior is taken, by the coordinate-free distance

    sum over links of (tr(P P0^-1) - log det(P P0^-1) - 4)      (Lee, Wensing and Park 2020),

P the pseudo-inertia; rotor inertias IA > 0 count as x - log x - 1, x = IA / IA0, springs and friction as x^2
/ 2, x the change in units of its size. Where no bodies have the base values, r^T C^-1 r / 2 + g distance is
least, r the residuals of the base values and C their covariance: with a small g those nearest in C, which
what C hardly tells leaves to the prior. With P0 = L L^T and P = L Q L^T a row k of K reads tr(X Q), X = L^T
(sum k_i V_i) L: the problem of `nearest_bodies`.

Supported: base values, all or some (the others are then free), friction within a group of weights; links,
rotors, springs, couplings; elastic joints, given by their own records.
Not supported: bounds on friction and springs; links whose values are symbols: numbers take their place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from symid import robot as robots
from symid.arrays import FloatArray, freeze
from symid.dynamics import nearest_bodies
from symid.dynamics.algebra import Label
from symid.dynamics.base_parameters import BaseParameters, Grouping, build_grouping, list_known_values
from symid.dynamics.friction_effects import get_friction
from symid.errors import Notice, SolverError, UsageError
from symid.joint_models import Elasticity, FrictionValues, list_value_names
from symid.notation import INERTIAL

_ROTOR_SHARE = 0.1
# What the distance of an unknown rotor counts for: it takes what its link does not have.
_LOOSE_ROTOR = 0.02
# Default standard deviation of a base value, in units of its row's size.
_DEVIATION = 0.01
# What the distance to the prior counts beside a covariance. Bodies of forty-eight base values come within 0.5
# of the least r^T C^-1 r; with 0.0001 they lie ten times nearer to the edge of all bodies, for 0.1 less.
_PRIOR = 0.01
# Least variance of a direction, in units of the largest: covariances have no more digits.
_LEAST = 1e-13
_BLAMED = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledProblem:
    """The problem with its rows over their `norms` (m,), and the prior that its unknowns are in units of.

    `roots` are factors of pseudo-inertias, `positive` values of parameters that must be positive, `free`
    start and size of the others.
    """

    problem: nearest_bodies.BodyProblem
    norms: FloatArray
    roots: FloatArray
    positive: Mapping[Label, float]
    free: Mapping[Label, tuple[float, float]]


def build_problem(
    robot: robots.Robot,
    grouping: Grouping,
    target: FloatArray,
    prior: FloatArray | None,
    *,
    grouped: bool = True,
) -> ScaledProblem:
    """Return the problem; the prior of an unknown rotor is a tenth of the inertia of its link.

    Without `grouped` rotors that are no base parameters by themselves have no inertia of their own.
    """
    alone = {parameter.label for parameter in grouping.parameters}
    column = {label: index for index, label in enumerate(grouping.labels)}
    links = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    if prior is None:
        prior = nearest_bodies.build_prior(robot, grouping.matrix[:, np.ravel(links)], target)
    bodies = robots.build_pseudo_inertias(prior)
    parameters = nearest_bodies.compute_standard_parameters(bodies)
    stated = list_known_values(robot)
    positive: dict[Label, float] = {}
    shares: list[float] = []
    free: dict[Label, tuple[float, float]] = {}
    for label, place in column.items():
        coefficients, (index, name) = grouping.matrix[:, place], label
        if name in INERTIAL or not np.any(coefficients):
            continue
        known = stated.get(label)
        if name == "IA" and not grouped and label not in alone:
            continue
        if name == "IA":
            joint = index if index < robot.size else robot.couplings[index - robot.size].terms[0][0]
            own = "ZZ" if robot.joints[joint].kind is robots.JointKind.REVOLUTE else "M"
            usual = _ROTOR_SHARE * float(parameters[joint, INERTIAL.index(own)])
            is_stated = known is not None and known > 0
            positive[label] = known if known is not None and is_stated else usual
            shares.append(1.0 if is_stated else _LOOSE_ROTOR)
        else:
            rows = np.flatnonzero(coefficients)
            size = float(np.abs(target[rows] / coefficients[rows]).max())
            free[label] = (known or 0.0, abs(known or 0.0) or size or 1.0)
    roots = np.asarray(np.linalg.cholesky(bodies), dtype=np.float64)
    forms = np.einsum("mnk,kab->mnab", grouping.matrix[:, links], nearest_bodies.PSEUDO_INERTIA_FORMS)
    blocks = roots.transpose(0, 2, 1) @ forms @ roots
    scaled = grouping.matrix[:, [column[label] for label in positive]] * np.array(list(positive.values()))
    starts, sizes = (np.array([pair[k] for pair in free.values()]) for k in (0, 1))
    chosen = grouping.matrix[:, [column[label] for label in free]]
    others, rest = chosen * sizes, target - chosen @ starts
    norms = np.sqrt((blocks**2).sum(axis=(1, 2, 3)) + (scaled**2).sum(axis=1) + (others**2).sum(axis=1))
    problem = nearest_bodies.BodyProblem(
        blocks=blocks / norms[:, None, None, None],
        positive=scaled / norms[:, None],
        others=others / norms[:, None],
        target=rest / norms,
        shares=np.array([1.0] * robot.size + shares),
        middle=np.zeros(len(sizes)),
    )
    return ScaledProblem(problem=problem, norms=norms, roots=roots, positive=positive, free=free)


class StandardOutcome(Enum):
    """How the search for a consistent set ended; the value is its explanation."""

    CONSISTENT = "the bodies have the base values exactly"
    NEAREST = "no bodies have these base values; these are the nearest to them and to the prior"


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardSet:
    """A physically consistent set of standard parameters.

    Args:
        pi: (n, 10) standard parameters of the links.
        drives: values of all other parameters that occur in the groups.
        distance: to the prior, without unit.
        names: the base parameters that had values; residual: (m,) K pi - beta of them, in their SI units.
        eigenvalue: the smallest one of the pseudo-inertias, SI.
        stationarity: Newton's decrement at the end, a relative error of the bodies.
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


def _build_set(
    grouping: Grouping, target: FloatArray, scaled: ScaledProblem, solution: nearest_bodies.NearestBodies
) -> StandardSet:
    """Return the solution in the units of the parameters."""
    bodies = scaled.roots @ solution.blocks @ scaled.roots.transpose(0, 2, 1)
    pi = nearest_bodies.compute_standard_parameters(bodies)
    drives = {
        label: unit * float(x)
        for (label, unit), x in zip(scaled.positive.items(), solution.positive, strict=True)
    }
    for (label, (start, size)), x in zip(scaled.free.items(), solution.others, strict=True):
        drives[label] = start + size * float(x)
    full = {(link, name): pi[link, k] for link in range(len(pi)) for k, name in enumerate(INERTIAL)} | drives
    vector = np.array([full.get(label, 0.0) for label in grouping.labels])
    return StandardSet(
        pi=freeze(pi),
        drives=tuple((label, drives[label]) for label in grouping.labels if label in drives),
        distance=nearest_bodies.compute_distance(scaled.problem, solution)
        + 0.5 * float(solution.others @ solution.others),
        names=tuple(parameter.name for parameter in grouping.parameters),
        residual=freeze(grouping.matrix @ vector - target),
        eigenvalue=float(np.linalg.eigvalsh(bodies).min()),
        stationarity=solution.stationarity,
        iterations=solution.iterations,
        outcome=StandardOutcome.CONSISTENT,
        blamed=(),
        reason="",
    )


def compute_standard_set(
    robot: robots.Robot,
    base: BaseParameters,
    values: Mapping[str, float],
    *,
    prior: FloatArray | None = None,
    covariance: FloatArray | None = None,
    grouped: bool = True,
) -> StandardSet:
    """Return the physically consistent standard parameters nearest to a prior that have the base values.

    `values`: m base values by name, SI, some or all of them, friction too; `covariance` (m, m) of them, in
    their order: where no bodies have the base values, the nearest in it are taken. Without it each value has
    a deviation of its own, a hundredth of the row's size in the prior, or of what the values come to in that
    measure, where they are larger. `prior` (n, 10): standard parameters of bodies that exist; see
    `build_prior` for the default. `grouped`: whether rotors whose inertia is part of a group get one of their
    own; without, links have it, for formats that know no rotors.

    Raises:
        UsageError: a value or the covariance cannot be used.
        RobotError: a symbolic length has no value.
        SolverError: the numbers span too many orders of magnitude.
    """
    every = [parameter.name for parameter in (*base.parameters, *base.friction)]
    unknown = [name for name in values if name not in every]
    known = {name: float(values[name]) for name in every if name in values}
    bad = [name for name, value in known.items() if not np.isfinite(value)]
    text = "" if known else "no base value is given"
    if unknown:
        text = f"unknown base parameters {', '.join(unknown)}; the robot has {', '.join(every)}"
    elif bad:
        text = f"base values must be finite numbers: {', '.join(bad)}"
    if text:
        raise UsageError(Notice(code="usage.base-values", text=text))
    whitening = None
    if covariance is not None:
        places, given = [list(values).index(name) for name in known], np.asarray(covariance, dtype=np.float64)
        if given.shape == (len(known), len(known)):
            whitening = nearest_bodies.compute_whitening(given[np.ix_(places, places)], _LEAST)
        if whitening is None:
            text = "the covariance must have finite numbers, a row and a positive variance for each base "
            text += "value"
            raise UsageError(Notice(code="usage.consistency-weights", text=text))
    grouping = build_grouping(robot, base, tuple(known))
    target = np.array(list(known.values()))
    # Numbers beyond all bounds end in an error of their own, not in warnings.
    with np.errstate(all="ignore"):
        scaled = build_problem(robot, grouping, target, prior, grouped=grouped)
        problem = scaled.problem
        exact = nearest_bodies.solve_body_equations(problem)
        if exact is not None:
            return _build_set(grouping, target, scaled, exact)
        size = _DEVIATION * np.sqrt(max(1.0, float(np.mean(problem.target**2))))
        weights = np.eye(len(target)) / size if whitening is None else whitening * scaled.norms
        weighed = replace(
            problem,
            blocks=np.tensordot(weights, problem.blocks, 1),
            positive=weights @ problem.positive,
            others=weights @ problem.others,
            target=weights @ problem.target,
        )
        nearest = nearest_bodies.optimise_bodies(weighed)
        if whitening is not None and np.isfinite(nearest.gap):
            # The prior counts for more where values lie further from all bodies than their covariance says.
            errors = nearest_bodies.compute_errors(weighed, nearest)
            loose = min(1.0, _PRIOR * max(1.0, float(np.mean(errors**2))))
            lighter = replace(weighed, weight=loose, loose=loose)
            nearest = nearest_bodies.optimise_bodies(lighter, nearest, 1.0)
    if not np.isfinite(nearest.gap):
        text = "no consistent set was found: the values and the prior lie too many orders of magnitude apart"
        raise SolverError(Notice(code="solver.standard-set", text=text))
    # Which base values cannot be: the multipliers make sum nu_i (K pi)_i >= 0 for all bodies (but for
    # rounding), and sum nu_i beta_i < 0.
    shares = np.abs(weights.T @ nearest.multipliers)
    names = [parameter.name for parameter in grouping.parameters]
    # Rows whose left-hand side is positive for all bodies, and whose value is not.
    alone = [
        row
        for row in range(len(names))
        if problem.target[row] <= 0
        and float(np.linalg.eigvalsh(problem.blocks[row]).min()) > -1e-12
        and not np.any(problem.others[row])
        and np.all(problem.positive[row] >= 0)
    ]
    order = [int(row) for row in np.argsort(-shares, kind="stable") if shares[row] >= _BLAMED * shares.max()]
    blamed = alone + [row for row in order if row not in alone]
    listed = ", ".join(f"{names[row]} = {target[row]:.6g}" for row in alone or order)
    if alone:
        reason = f"{listed}: positive for all bodies ({grouping.parameters[alone[0]].expression})"
    else:
        reason = f"no bodies have these values at the same time: {listed}"
    labels = [label for row in blamed for label, _ in grouping.parameters[row].terms]
    links = sorted({index for index, name in labels if name in INERTIAL})
    return replace(
        _build_set(grouping, target, scaled, nearest),
        outcome=StandardOutcome.NEAREST,
        blamed=tuple(names[row] for row in blamed),
        reason=f"{reason}; links: {', '.join(str(index + 1) for index in links)}",
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedRobot:
    """A robot with identified values, and its bodies."""

    robot: robots.Robot
    standard: StandardSet


def build_identified_robot(
    robot: robots.Robot,
    base: BaseParameters,
    values: Mapping[str, float],
    *,
    covariance: FloatArray | None = None,
    rotors: Mapping[str, float] | None = None,
    elasticity: Sequence[Elasticity | None] = (),
    grouped: bool = True,
) -> IdentifiedRobot:
    """Return `robot` with the values of an identification.

    `rotors`: rotor inertias of elastic joints by name (IA1), kg m^2 or kg; `elasticity`: one record a
    coordinate, None for a rigid joint, or none at all; the rest and the errors as in `compute_standard_set`.
    """
    # The prior is the file's own bodies, where it states them all and they can exist.
    rows = [joint.inertial for joint in robot.joints]
    prior = None
    if not any(row is None or robots.explain_impossible_inertia(row) for row in rows):
        stated = np.array(rows, dtype=np.float64)
        prior = stated if np.linalg.eigvalsh(robots.build_pseudo_inertias(stated)).min() > 0 else None
    if not grouped:
        # Bodies that have the inertia of their rotors, about the joint's axis alone, or their mass.
        first = compute_standard_set(robot, base, values, prior=prior, covariance=covariance)
        prior = np.array(first.pi)
        for (index, name), value in first.drives:
            if name == "IA" and index < robot.size:
                revolute = robot.joints[index].kind is robots.JointKind.REVOLUTE
                own = [0.5, 0, 0, 0.5, 0, 1.0, 0, 0, 0, 0] if revolute else [0.0] * 9 + [1.0]
                prior[index] += value * np.array(own)
    standard = compute_standard_set(robot, base, values, prior=prior, covariance=covariance, grouped=grouped)
    known: dict[Label, float] = dict(standard.drives)
    if not grouped:
        known |= {label: 0.0 for label in base.labels if label[1] == "IA" and label not in known}
    for parameter in base.friction:
        # Where bodies move, friction moves with them, as their covariance tells.
        exact = standard.outcome is StandardOutcome.CONSISTENT
        if exact and len(parameter.terms) == 1 and parameter.name in values:
            known[parameter.label] = values[parameter.name]
    springs = dict(zip(robot.coordinates, elasticity, strict=True)) if elasticity else {}
    joints = []
    for index, joint in enumerate(robot.joints):
        drive, spring, rotor = joint.drive, joint.spring, (rotors or {}).get(f"IA{index + 1}")
        if (index, "IA") in known:
            drive = replace(drive, rotor_inertia=known[index, "IA"])
        if rotor is not None:
            drive = replace(drive, has_rotor=True, rotor_inertia=rotor)
        stiffness = known.get((index, "KS"), 0.0)
        if spring is not None and stiffness:
            spring = robots.Spring(stiffness=stiffness, rest=-known.get((index, "KR"), 0.0) / stiffness)
        changed = replace(
            joint,
            drive=drive,
            spring=spring,
            friction=_change_friction(robot, index, known),
            elasticity=springs.get(index, joint.elasticity),
            inertial=tuple(map(float, standard.pi[index])),
            form=None,
        )
        joints.append(changed)
    couplings = tuple(
        replace(
            coupling,
            rotor_inertia=known.get((index, "IA"), coupling.rotor_inertia),
            friction=_change_friction(robot, index, known),
        )
        for index, coupling in enumerate(robot.couplings, start=robot.size)
    )
    return IdentifiedRobot(robot=replace(robot, joints=tuple(joints), couplings=couplings), standard=standard)


def _change_friction(robot: robots.Robot, index: int, known: Mapping[Label, float]) -> FrictionValues:
    friction = get_friction(robot, index)
    names = list_value_names(friction)
    old = friction.values or (None,) * len(names)
    found = [known.get((index, name), value) for name, value in zip(names, old, strict=True)]
    numbers = tuple(value for value in found if value is not None)
    return replace(friction, values=numbers if numbers and len(numbers) == len(names) else None)
