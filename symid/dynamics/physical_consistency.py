"""From base values back to bodies that can exist: a physically consistent set, and the robot with it.

Robot, its base parameters, values of them, a prior -> `StandardSet`, ten standard parameters a link of
bodies that exist, and values of the drives; `IdentifiedRobot`, the robot with masses, rotors, springs and
friction that have these values.

Of all sets with K pi = beta the one nearest to the prior is taken, by the coordinate-free distance

    sum over links of w (tr(P P0^-1) - log det(P P0^-1) - 4)      (Lee, Wensing and Park 2020),

P the pseudo-inertia; rotor inertias IA > 0 count as x - log x - 1, x = IA / IA0, what may have either sign
(springs, friction) as x^2 / 2, x the change in units of its size. With the prior P0 = L L^T and P = L Q L^T
a row k of K reads tr(X Q), X = L^T (sum k_i V_i) L, and the distance to the prior is that of Q to one: the
convex problem that `nearest_bodies` solves. Rotor inertias are scaled by their prior: what the robot file
says, else a tenth of the inertia of their link about the joint. Springs and friction count from what the
file says, else from 0, in units of their size. `pseudo_inertia` has the prior of links where none is given.

Where no set of bodies has the base values, the set that minimises the distance plus sum (r / s)^2 / 2 is
returned, r the residual of a base value and s its standard deviation. Where none is given, s is a hundredth
of the row's size in the prior, or of what the values come to in that measure, where they are larger. The
result says so and names the base parameters that contradict each other or all bodies.

Logs show base parameters only: an identified robot has, of all bodies with these values, those nearest to
the file's own, or to a prior where the file has none. What was not identified keeps the file's value.

Supported: base values by name or in order, all or some (the others are then free), friction within a group
of weights; links, rotors, springs, couplings; elastic joints, given by their own records.
Not supported: bounds on friction and springs; links whose values are symbols: numbers take their place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.dynamics.algebra import Label
from symid.dynamics.base_parameters import BaseParameters, Grouping, build_grouping, list_known_values
from symid.dynamics.nearest_bodies import (
    BodyProblem,
    NearestBodies,
    compute_distance,
    optimise_bodies,
    solve_body_equations,
)
from symid.dynamics.pseudo_inertia import (
    PSEUDO_INERTIA_FORMS,
    build_prior,
    build_pseudo_inertias,
    compute_standard_parameters,
)
from symid.errors import Notice, SolverError, UsageError
from symid.joint_models import FRICTION_MODELS, get_friction
from symid.notation import INERTIAL
from symid.robot import (
    Coupling,
    Elasticity,
    FrictionValues,
    Joint,
    JointKind,
    Robot,
    Spring,
    explain_impossible_inertia,
)


def read_values(
    base: BaseParameters, values: Mapping[str, float] | Sequence[float] | FloatArray
) -> dict[str, float]:
    """Return the base values by name, in the order of the base set."""
    known = [parameter.name for parameter in (*base.parameters, *base.friction)]
    if not isinstance(values, Mapping):
        names = known if len(values) == len(known) else known[: base.count]
        if len(values) != len(names):
            text = f"{len(values)} base values given; there are {base.count} base parameters"
            raise UsageError(Notice(code="usage.base-values", text=f"{text}, {len(known)} with friction"))
        values = dict(zip(names, values, strict=True))
    unknown = [name for name in values if name not in known]
    if unknown:
        text = f"there is no base parameter called {', '.join(unknown)}; there are {', '.join(known)}"
        raise UsageError(Notice(code="usage.base-values", text=text))
    result = {name: float(values[name]) for name in known if name in values}
    bad = [name for name, value in result.items() if not np.isfinite(value)]
    if bad or not result:
        what = f"{', '.join(bad)} must be a finite number" if bad else "no base value is given"
        raise UsageError(Notice(code="usage.base-values", text=what))
    return result


def read_prior(robot: Robot, prior: FloatArray) -> FloatArray:
    """Return the pseudo-inertias of a given prior; bodies that do not exist are refused."""
    shape = np.shape(prior)
    if shape != (robot.size, len(INERTIAL)) or not np.all(np.isfinite(prior)):
        text = f"the prior must be ({robot.size}, {len(INERTIAL)}) finite numbers, and has the shape {shape}"
        raise UsageError(Notice(code="usage.prior", text=text))
    bodies = build_pseudo_inertias(prior)
    smallest = np.linalg.eigvalsh(bodies)[:, 0]
    refused = [joint.name for joint, value in zip(robot.joints, smallest, strict=True) if value <= 0]
    if refused:
        text = (
            f"the prior of the links of {', '.join(refused)} is no body: its pseudo-inertia must be positive"
        )
        raise UsageError(Notice(code="usage.prior", text=f"{text} definite; leave the prior out, or mend it"))
    return bodies


def read_weights(robot: Robot, weights: FloatArray | None) -> FloatArray:
    """Return the weights of the links."""
    if weights is None:
        return np.ones(robot.size)
    given = np.asarray(weights, dtype=np.float64)
    if given.shape != (robot.size,) or not np.all(np.isfinite(given)) or np.any(given <= 0):
        text = f"the weights must be {robot.size} positive numbers, one a link"
        raise UsageError(Notice(code="usage.consistency-weights", text=text))
    return given


def read_deviations(known: Mapping[str, float], deviations: Mapping[str, float] | None) -> FloatArray | None:
    """Return the standard deviations of the rows."""
    if deviations is None:
        return None
    given = np.array([deviations.get(name, np.nan) for name in known], dtype=np.float64)
    if not np.all(np.isfinite(given)) or np.any(given <= 0):
        text = "the deviations must be positive numbers, one for each base value given"
        raise UsageError(Notice(code="usage.consistency-weights", text=text))
    return given


_ROTOR_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """The prior: factors of the pseudo-inertias, values of the positive and of the free parameters."""

    roots: FloatArray
    positive: Mapping[Label, float]
    free: Mapping[Label, tuple[float, float]]


def build_scales(robot: Robot, grouping: Grouping, target: FloatArray, prior: FloatArray | None) -> Scales:
    """Return the prior of everything; an unknown rotor has a tenth of the inertia of its link."""
    links = [index for index, (_, name) in enumerate(grouping.labels) if name in INERTIAL]
    bodies = (
        build_pseudo_inertias(build_prior(robot, grouping.matrix[:, links], target))
        if prior is None
        else read_prior(robot, prior)
    )
    parameters = compute_standard_parameters(bodies)
    stated = list_known_values(robot)
    positive: dict[Label, float] = {}
    free: dict[Label, tuple[float, float]] = {}
    for column, label in enumerate(grouping.labels):
        coefficients = grouping.matrix[:, column]
        index, name = label
        if name in INERTIAL or not np.any(coefficients):
            continue
        known = stated.get(label)
        if name == "IA":
            joint = index if index < robot.size else robot.couplings[index - robot.size].terms[0][0]
            own = "ZZ" if robot.joints[joint].kind is JointKind.REVOLUTE else "M"
            usual = _ROTOR_SHARE * float(parameters[joint, INERTIAL.index(own)])
            positive[label] = known if known is not None and known > 0 else usual
        else:
            rows = np.flatnonzero(coefficients)
            size = float(np.abs(target[rows] / coefficients[rows]).max())
            free[label] = (known or 0.0, abs(known or 0.0) or size or 1.0)
    return Scales(
        roots=np.asarray(np.linalg.cholesky(bodies), dtype=np.float64),
        positive=positive,
        free=free,
    )


def build_problem(
    robot: Robot, grouping: Grouping, target: FloatArray, scales: Scales, weights: FloatArray | None
) -> tuple[BodyProblem, FloatArray]:
    """Return the problem with its rows scaled to one, and the sizes of the rows."""
    column = {label: index for index, label in enumerate(grouping.labels)}
    links = [[column[index, name] for name in INERTIAL] for index in range(robot.size)]
    forms = np.einsum("mnk,kab->mnab", grouping.matrix[:, links], PSEUDO_INERTIA_FORMS)
    blocks = scales.roots.transpose(0, 2, 1) @ forms @ scales.roots
    units = np.array(list(scales.positive.values()))
    positive = grouping.matrix[:, [column[label] for label in scales.positive]] * units
    starts = np.array([start for start, _ in scales.free.values()])
    sizes = np.array([size for _, size in scales.free.values()])
    chosen = grouping.matrix[:, [column[label] for label in scales.free]]
    free, rest = chosen * sizes, target - chosen @ starts
    norms = np.sqrt((blocks**2).sum(axis=(1, 2, 3)) + (positive**2).sum(axis=1) + (free**2).sum(axis=1))
    return BodyProblem(
        blocks=blocks / norms[:, None, None, None],
        positive=positive / norms[:, None],
        others=free / norms[:, None],
        target=rest / norms,
        shares=np.append(np.ones(robot.size) if weights is None else weights, np.ones(len(units))),
        weight=1.0,
        middle=np.zeros(len(sizes)),
        loose=1.0,
    ), norms


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


def _is_one_sided(problem: BodyProblem, row: int) -> bool:
    """Return whether equation `row` has a positive left-hand side for all bodies."""
    lowest = float(np.linalg.eigvalsh(problem.blocks[row]).min())
    return lowest > -1e-12 and not np.any(problem.others[row]) and bool(np.all(problem.positive[row] >= 0))


def _blame(
    grouping: Grouping, target: FloatArray, problem: BodyProblem, shares: FloatArray
) -> tuple[tuple[str, ...], str]:
    """Return which base values cannot be, and why; `shares` are the sizes of the multipliers nu.

    They make sum nu_i (K pi)_i >= 0 for all bodies (but for rounding), and sum nu_i beta_i < 0.
    """
    names = [parameter.name for parameter in grouping.parameters]
    alone = [row for row in range(len(names)) if problem.target[row] <= 0 and _is_one_sided(problem, row)]
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


def _compute_sizes(problem: BodyProblem, norms: FloatArray, deviations: FloatArray | None) -> FloatArray:
    """Return the rows' standard deviations."""
    if deviations is not None:
        return deviations / norms
    return np.full(len(norms), _DEVIATION * np.sqrt(max(1.0, float(np.mean(problem.target**2)))))


def _weigh_rows(problem: BodyProblem, sizes: FloatArray) -> BodyProblem:
    """Return the problem with its rows over their standard deviations."""
    return replace(
        problem,
        blocks=problem.blocks / sizes[:, None, None, None],
        positive=problem.positive / sizes[:, None],
        others=problem.others / sizes[:, None],
        target=problem.target / sizes,
    )


def _build_set(
    grouping: Grouping,
    target: FloatArray,
    scales: Scales,
    problem: BodyProblem,
    solution: NearestBodies,
) -> StandardSet:
    """Return the solution in the units of the parameters."""
    bodies = scales.roots @ solution.blocks @ scales.roots.transpose(0, 2, 1)
    pi = compute_standard_parameters(bodies)
    drives = {
        label: unit * float(x)
        for (label, unit), x in zip(scales.positive.items(), solution.positive, strict=True)
    }
    for (label, (start, size)), x in zip(scales.free.items(), solution.others, strict=True):
        drives[label] = start + size * float(x)
    full = {(link, name): pi[link, k] for link in range(len(pi)) for k, name in enumerate(INERTIAL)} | drives
    vector = np.array([full.get(label, 0.0) for label in grouping.labels])
    return StandardSet(
        pi=freeze(pi),
        drives=tuple((label, drives[label]) for label in grouping.labels if label in drives),
        distance=compute_distance(problem, solution) + 0.5 * float(solution.others @ solution.others),
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
        prior: (n, 10) standard parameters of bodies that exist; see `build_prior` for the default.
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
    scales = build_scales(robot, grouping, target, prior)
    # Numbers beyond all bounds end in an error of their own, not in warnings.
    with np.errstate(all="ignore"):
        problem, norms = build_problem(robot, grouping, target, scales, read_weights(robot, weights))
        exact = solve_body_equations(problem)
        if exact is not None:
            return _build_set(grouping, target, scales, problem, exact)
        sizes = _compute_sizes(problem, norms, shares)
        nearest = optimise_bodies(_weigh_rows(problem, sizes))
    if not np.isfinite(nearest.gap):
        text = "no consistent set was found: the values and the prior lie too many orders of magnitude apart"
        raise SolverError(Notice(code="solver.standard-set", text=text))
    blamed, reason = _blame(grouping, target, problem, np.abs(nearest.multipliers / sizes))
    found = _build_set(grouping, target, scales, problem, nearest)
    return replace(found, outcome=StandardOutcome.NEAREST, blamed=blamed, reason=reason)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedRobot:
    """A robot with identified values, and the bodies that were found for them."""

    robot: Robot
    standard: StandardSet


def build_identified_robot(
    robot: Robot,
    base: BaseParameters,
    values: Mapping[str, float],
    *,
    deviations: Mapping[str, float] | None = None,
    rotors: Mapping[str, float] | None = None,
    elasticity: Sequence[Elasticity] = (),
) -> IdentifiedRobot:
    """Return `robot` with the values of an identification.

    Args:
        robot: the robot.
        base: its base parameters.
        values: of base and friction parameters by name, SI; some or all of them.
        deviations: standard deviations of the same.
        rotors: rotor inertias of elastic joints by name (IA1), kg m^2 or kg.
        elasticity: one record a coordinate, none for a robot without elastic joints.

    Raises:
        UsageError, RobotError, SolverError: see `compute_standard_set`.
    """
    standard = compute_standard_set(
        robot, base, values, prior=_get_stated_bodies(robot), deviations=deviations
    )
    known: dict[Label, float] = dict(standard.drives)
    for parameter in base.friction:
        if len(parameter.terms) == 1 and parameter.name in values:
            known[parameter.label] = values[parameter.name]
    springs = dict(zip(robot.coordinates, elasticity, strict=True)) if elasticity else {}
    joints = []
    for index, joint in enumerate(robot.joints):
        changed = _change_joint(robot, index, joint, known)
        rotor = (rotors or {}).get(f"IA{index + 1}")
        if rotor is not None:
            changed = replace(changed, drive=replace(changed.drive, has_rotor=True, rotor_inertia=rotor))
        if index in springs:
            changed = replace(changed, elasticity=springs[index])
        joints.append(replace(changed, inertial=tuple(map(float, standard.pi[index])), form=None))
    couplings = tuple(
        _change_coupling(robot, robot.size + number, coupling, known)
        for number, coupling in enumerate(robot.couplings)
    )
    return IdentifiedRobot(robot=replace(robot, joints=tuple(joints), couplings=couplings), standard=standard)


def _get_stated_bodies(robot: Robot) -> FloatArray | None:
    """Return the file's own bodies (n, 10), None where it does not state them all, or none can exist."""
    rows = [joint.inertial for joint in robot.joints]
    if any(row is None or explain_impossible_inertia(row) for row in rows):
        return None
    return np.array(rows, dtype=np.float64)


def _change_friction(robot: Robot, index: int, known: Mapping[Label, float]) -> FrictionValues:
    friction = get_friction(robot, index)
    names = FRICTION_MODELS[friction.kind].parameters
    old = friction.values or (None,) * len(names)
    found = [known.get((index, name), value) for name, value in zip(names, old, strict=True)]
    numbers = tuple(value for value in found if value is not None)
    return replace(friction, values=numbers if numbers and len(numbers) == len(names) else None)


def _change_joint(robot: Robot, index: int, joint: Joint, known: Mapping[Label, float]) -> Joint:
    drive, spring = joint.drive, joint.spring
    if (index, "IA") in known:
        drive = replace(drive, rotor_inertia=known[index, "IA"])
    if spring is not None and (index, "KS") in known and known[index, "KS"]:
        stiffness = known[index, "KS"]
        spring = Spring(stiffness=stiffness, rest=-known.get((index, "KR"), 0.0) / stiffness)
    return replace(joint, drive=drive, spring=spring, friction=_change_friction(robot, index, known))


def _change_coupling(robot: Robot, index: int, coupling: Coupling, known: Mapping[Label, float]) -> Coupling:
    rotor = known.get((index, "IA"), coupling.rotor_inertia)
    return replace(coupling, rotor_inertia=rotor, friction=_change_friction(robot, index, known))
