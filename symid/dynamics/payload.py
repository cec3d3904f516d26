"""What a robot carries: mass, centre of mass and inertia from base values with and without it.

Robot, its base parameters, base values of the loaded and of the empty robot with their covariances ->
`Payload`: a body that can exist, how surely each of its quantities is known, what cannot be identified, and
which parameters changed for another reason.

A body that is fixed to a link adds to the ten standard parameters of that link, so that

    beta_loaded - beta_empty = K_link delta + noise,   noise of covariance C_loaded + C_empty,

which is solved by generalised least squares. That is as good as one fit to all logs together, since base
parameters that the body does not touch must not change. Friction may, because gears brake more under load:
it takes part through its covariance alone, and its changes are listed.

Where no body has the values of least squares, the one that minimises chi^2 / 2 plus the distance to a ball
of water of the same mass and place is taken (`nearest_bodies`); `moved` says how many standard deviations
that is away. Deviations are those of least squares, times the root of chi^2 over its degrees of freedom
where that is larger than one. Mass, centre and inertia come from the standard parameters about the frame's
origin by

    c = s / m,   J = I - (s.s 1 - s s') / m,   s = m c the first moments.

Supported: any link of a tree; a mass known from a balance, as one more row; base values that are known in
part; frames of the file.
Not supported: bodies on several links, bodies that move on their link, a mass of zero.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.dynamics.base_parameters import BaseParameters, build_grouping
from symid.dynamics.nearest_bodies import BodyProblem, optimise_bodies, solve_body_equations
from symid.dynamics.pseudo_inertia import (
    PSEUDO_INERTIA_FORMS,
    build_pseudo_inertias,
    compute_standard_parameters,
)
from symid.errors import EstimateError, IdentifiabilityError, Notice, UsageError
from symid.notation import INERTIAL
from symid.robot import Robot, move_parameters

PAYLOAD_QUANTITIES = ("mass", "cx", "cy", "cz", "Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz")
"""Mass (kg), centre of mass (m), inertia about it (kg m^2)."""

_PAIRS = tuple(zip(*np.triu_indices(3), strict=True))
_DENSITY = 1000.0


def compute_ball(mass: float) -> tuple[float, float]:
    """Return radius (m) and moment of inertia (kg m^2) of a ball of water of a mass (kg)."""
    radius = (3.0 * abs(mass) / (4.0 * math.pi * _DENSITY)) ** (1.0 / 3.0)
    return radius, 0.4 * abs(mass) * radius**2


def compute_quantities(parameters: FloatArray) -> FloatArray:
    """Return the ten `PAYLOAD_QUANTITIES` of standard parameters (10,)."""
    tensor, s, mass = parameters[:6], parameters[6:9], parameters[9]
    shift = [(float(i == j) * (s @ s) - s[i] * s[j]) / mass for i, j in _PAIRS]
    return np.array([mass, *(s / mass), *(tensor - np.array(shift))], dtype=np.float64)


def compute_quantity_derivatives(parameters: FloatArray) -> FloatArray:
    """Return the derivatives (10, 10) of `PAYLOAD_QUANTITIES` with respect to standard parameters."""
    s, mass = parameters[6:9], float(parameters[9])
    rates = np.zeros((10, 10))
    rates[0, 9] = 1.0
    for axis in range(3):
        rates[1 + axis, 6 + axis] = 1.0 / mass
        rates[1 + axis, 9] = -s[axis] / mass**2
    for row, (i, j) in enumerate(_PAIRS):
        same = float(i == j)
        rates[4 + row, row] = 1.0
        for axis in range(3):
            change = 2.0 * s[axis] * same - s[j] * float(i == axis) - s[i] * float(j == axis)
            rates[4 + row, 6 + axis] = -change / mass
        rates[4 + row, 9] = ((s @ s) * same - s[i] * s[j]) / mass**2
    return rates


# A size for lengths, so that numbers of different units can be compared; no result depends on it.
_LENGTH = 0.1
_RANK = 1e-9
_SEEN = 1e-6
_WEIGHED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseValues(FrozenArrays):
    """Values (p,) of base and friction parameters by name, SI, and their covariance (p, p)."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PayloadSystem:
    """Equations of unit variance for the ten parameters of the body, in the frame of the file.

    Args:
        names: the base parameters, and "mass" where a balance told it.
        rows: (m, 10) in units of `sizes` (10,); target: (m,).
        free: (10, k) what nothing shows, in the same units.
        lacking: whether the robot could show more of it than the values given do.
    """

    names: tuple[str, ...]
    rows: FloatArray
    target: FloatArray
    sizes: FloatArray
    free: FloatArray
    lacking: bool


def build_base_values(
    names: Sequence[str],
    values: Sequence[float],
    deviations: Sequence[float],
    covariance: Sequence[Sequence[float]] = (),
) -> BaseValues:
    """Return values of an estimate; without a covariance its deviations count as independent.

    Args:
        names: p names.
        values: (p,) SI.
        deviations: (p,) standard deviations.
        covariance: (p, p), or nothing.
    """
    known = np.array(covariance, dtype=np.float64) if len(covariance) else np.diag(np.square(deviations))
    return BaseValues(names=tuple(names), values=np.array(values, dtype=np.float64), covariance=known)


def select_values(given: BaseValues, names: Sequence[str]) -> BaseValues:
    """Return the values of some parameters."""
    places = [given.names.index(name) for name in names]
    return BaseValues(
        names=tuple(names), values=given.values[places], covariance=given.covariance[np.ix_(places, places)]
    )


def build_system(
    robot: Robot,
    base: BaseParameters,
    loaded: BaseValues,
    empty: BaseValues,
    *,
    link: int,
    mass: float | None,
) -> PayloadSystem:
    """Return the equations of the payload.

    Args:
        robot: the robot.
        base: its base parameters.
        loaded: base values with the payload.
        empty: base values without it.
        link: index of the joint whose link carries it.
        mass: kg, where it is known.

    Raises:
        EstimateError: the values share no base parameter, or have no deviations.
        RobotError: a symbolic length has no value.
    """
    wanted = [entry.name for entry in base.parameters]
    names = tuple(name for name in wanted if name in loaded.names and name in empty.names)
    if not names:
        text = "the two estimates share no base parameter, so nothing can be said of a payload"
        raise EstimateError(Notice(code="payload.nothing-shared", text=text))
    frame = _build_frame_change(robot, link)
    sizes = np.array([_LENGTH**2] * 6 + [_LENGTH] * 3 + [1.0])
    every = _select_columns(robot, base, wanted, link) @ frame * sizes
    rows = _select_columns(robot, base, names, link) @ frame * sizes
    after, before = select_values(loaded, names), select_values(empty, names)
    change = after.values - before.values
    white = compute_whitening(after.covariance + before.covariance)
    matrix, target = white @ rows, white @ change
    if mass is not None:
        weighed = np.zeros((1, 10))
        weighed[0, 9] = 1.0
        every, rows = np.vstack([every, weighed]), np.vstack([rows, weighed])
        matrix = np.vstack([matrix, weighed / (_WEIGHED * mass)])
        target = np.append(target, 1.0 / _WEIGHED)
        names = (*names, "mass")
    free = _compute_null_space(rows)
    return PayloadSystem(
        names=names,
        rows=matrix,
        target=target,
        sizes=sizes,
        free=free,
        lacking=free.shape[1] > _compute_null_space(every).shape[1],
    )


def _select_columns(robot: Robot, base: BaseParameters, names: Sequence[str], link: int) -> FloatArray:
    """Return the columns (m, 10) of K that belong to the parameters of a link."""
    grouping = build_grouping(robot, base, tuple(names))
    return grouping.matrix[:, [grouping.labels.index((link, name)) for name in INERTIAL]]


def _build_frame_change(robot: Robot, link: int) -> FloatArray:
    """Return (10, 10) that takes parameters in the file's frame of a link to those in its link frame."""
    frame, symbols = robot.joints[link].frame, dict(robot.symbols)
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    return np.array([move_parameters(unit, rotation, origin) for unit in np.eye(10).tolist()]).T


def compute_whitening(covariance: FloatArray) -> FloatArray:
    """Return W with W C W' = 1.

    Raises:
        EstimateError: a deviation is missing.
    """
    deviations = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(covariance)) or not np.all(deviations > 0):
        text = (
            "an estimate has no standard deviations, which say what a change means; identify by a method "
            "that gives them"
        )
        raise EstimateError(Notice(code="payload.no-deviations", text=text))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    # Rounding can make the smallest of them zero.
    kept = np.maximum(values, len(values) * np.finfo(float).eps * values[-1])
    white: FloatArray = (vectors / np.sqrt(kept)).T / deviations
    return white


def _compute_null_space(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis (10, k) of what the rows do not show."""
    _, values, right = np.linalg.svd(np.vstack([rows, np.zeros((10, 10))]), full_matrices=False)
    return right[values <= _RANK * max(float(values[0]), 1e-300)].T


def solve_system(system: PayloadSystem) -> tuple[FloatArray, FloatArray]:
    """Return the least squares of smallest norm (10,), and its covariance where it is told (10, 10)."""
    _, values, right = np.linalg.svd(system.rows, full_matrices=False)
    rank = 10 - system.free.shape[1]
    factor = system.sizes[:, None] * right[:rank].T / values[:rank]
    found = np.linalg.lstsq(system.rows, system.target, rcond=float(values[rank - 1] / values[0] / 2))[0]
    return found * system.sizes, factor @ factor.T


def is_quantity_identifiable(system: PayloadSystem, rates: FloatArray) -> bool:
    """Return whether a quantity with these derivatives (10,) changes with nothing that is free."""
    scaled = rates * system.sizes
    return float(np.linalg.norm(scaled @ system.free)) <= _SEEN * float(np.linalg.norm(scaled))


_CHANGED = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A parameter that changed: from, to, and by how many standard deviations."""

    name: str
    before: float
    after: float
    deviations: float


def _list_changes(loaded: BaseValues, empty: BaseValues, shares: FloatArray) -> tuple[ParameterChange, ...]:
    rows: Sequence[tuple[str, float, float, float]] = list(
        zip(loaded.names, empty.values.tolist(), loaded.values.tolist(), shares.tolist(), strict=True)
    )
    changes = [
        ParameterChange(name=name, before=before, after=after, deviations=share)
        for name, before, after, share in rows
        if abs(share) > _CHANGED
    ]
    return tuple(sorted(changes, key=lambda change: -abs(change.deviations)))


def list_unexplained_changes(
    system: PayloadSystem, left: FloatArray, loaded: BaseValues, empty: BaseValues
) -> tuple[ParameterChange, ...]:
    """Return base parameters whose change the payload does not explain; `left` (m,) are its rows."""
    names = [name for name in system.names if name in loaded.names]
    after, before = select_values(loaded, names), select_values(empty, names)
    covariance = after.covariance + before.covariance
    # What is left, back in units of the parameters, over their own deviations.
    remaining = np.linalg.solve(compute_whitening(covariance), left[: len(names)])
    return _list_changes(after, before, remaining / np.sqrt(np.diag(covariance)))


def list_friction_changes(
    base: BaseParameters, loaded: BaseValues, empty: BaseValues
) -> tuple[ParameterChange, ...]:
    """Return friction parameters that changed."""
    names = [
        entry.name for entry in base.friction if entry.name in loaded.names and entry.name in empty.names
    ]
    after, before = select_values(loaded, names), select_values(empty, names)
    deviations = np.sqrt(np.diag(after.covariance) + np.diag(before.covariance))
    sure = np.isfinite(deviations) & (deviations > 0)
    shares = np.where(sure, (after.values - before.values) / np.where(sure, deviations, 1.0), 0.0)
    return _list_changes(after, before, shares)


# A mass counts as there from this many standard deviations on.
_SURE = 3.0
_UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadQuantity:
    """One of `PAYLOAD_QUANTITIES`: its value and standard deviation, or None and the reason."""

    name: str
    unit: str
    value: float | None
    std: float | None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Payload:
    """What is carried, in the frame that the robot file gives to the link.

    Args:
        joint: of the link that carries it.
        quantities: mass, centre of mass, inertia about it.
        standard: (10,) of a body that exists and has the quantities that are told; the others are guesses.
        chi2: of least squares, over `freedom` degrees; deviations are multiplied by `scale`.
        moved: how far the body is from least squares, in standard deviations; 0 where that is a body.
        unexplained: base parameters that changed although no payload changes them so, the worst first.
        friction: friction parameters that changed beyond their noise.
    """

    joint: str
    quantities: tuple[PayloadQuantity, ...]
    standard: FloatArray
    chi2: float
    freedom: int
    scale: float
    moved: float
    unexplained: tuple[ParameterChange, ...]
    friction: tuple[ParameterChange, ...]

    @property
    def doubtful(self) -> bool:
        """Return whether chi^2 is larger than noise makes it, by three of its standard deviations."""
        return self.chi2 > self.freedom + _SURE * float(np.sqrt(2.0 * self.freedom))


def estimate_payload(
    robot: Robot,
    base: BaseParameters,
    loaded: BaseValues,
    empty: BaseValues,
    *,
    joint: str | None = None,
    mass: float | None = None,
) -> Payload:
    """Return what the loaded robot carries and the empty one does not.

    Args:
        robot: the robot.
        base: its base parameters.
        loaded: base values with the payload.
        empty: base values without it, of the same model.
        joint: whose link carries it; the last one by default.
        mass: kg, where a balance told it.

    Raises:
        UsageError: there is no such joint, or the mass is none.
        EstimateError: the values share no base parameter, or have no deviations.
        IdentifiabilityError: no payload can be told from none.
        RobotError: a symbolic length has no value.
    """
    link = _locate_link(robot, joint)
    if mass is not None and not 0 < mass < np.inf:
        text = f"the mass must be a positive number of kg, got {mass}"
        raise UsageError(Notice(code="usage.payload-mass", text=text))
    system = build_system(robot, base, loaded, empty, link=link, mass=mass)
    found, covariance = solve_system(system)
    left = system.target - system.rows @ (found / system.sizes)
    freedom = len(left) - (10 - system.free.shape[1])
    chi2 = float(left @ left)
    scale = float(np.sqrt(max(1.0, chi2 / freedom))) if freedom else 1.0
    covariance = covariance * scale**2
    _check_identifiable(robot, system, found, covariance, link)
    body, moved = _choose_body(system, found, scale)
    return Payload(
        joint=robot.joints[link].name,
        quantities=_list_quantities(system, body, covariance),
        standard=freeze(body),
        chi2=chi2,
        freedom=freedom,
        scale=scale,
        moved=moved,
        unexplained=list_unexplained_changes(system, left, loaded, empty),
        friction=list_friction_changes(base, loaded, empty),
    )


def _locate_link(robot: Robot, joint: str | None) -> int:
    names = [entry.name for entry in robot.joints]
    if joint is None:
        return robot.size - 1
    if joint not in names:
        text = f"there is no joint {joint!r}; there are {', '.join(names)}"
        raise UsageError(Notice(code="usage.payload-joint", text=text))
    return names.index(joint)


def _check_identifiable(
    robot: Robot, system: PayloadSystem, found: FloatArray, covariance: FloatArray, link: int
) -> None:
    """Refuse a change that may be noise alone, or none of what a payload has.

    Raises:
        IdentifiabilityError: it is.
    """
    told = is_quantity_identifiable(system, np.eye(10)[9])
    deviation = float(np.sqrt(covariance[9, 9]))
    if told and found[9] > _SURE * deviation:
        return
    if not told:
        text = (
            f"a mass at the link of joint {robot.joints[link].name!r} shows only together with other "
            "parameters, so neither it nor the centre of mass can be told; give the mass by --mass"
        )
        if system.lacking:
            text += ", or identify from logs that tell more base parameters"
        raise IdentifiabilityError(Notice(code="payload.mass-unseen", text=text))
    text = (
        f"no payload can be told: the mass comes to {found[9]:.4g} kg with a standard deviation of "
        f"{deviation:.2g} kg; check which log is the loaded one, move more joints against gravity, or "
        "record longer"
    )
    raise IdentifiabilityError(Notice(code="payload.none", text=text))


def _choose_body(system: PayloadSystem, found: FloatArray, scale: float) -> tuple[FloatArray, float]:
    """Return a body near least squares, and how far it is away (standard deviations).

    Raises:
        IdentifiabilityError: none is near.
    """
    bodies = build_pseudo_inertias(found[None, :])
    if not system.free.shape[1] and float(np.linalg.eigvalsh(bodies[0])[0]) > 0:
        return found, 0.0
    root = np.asarray(np.linalg.cholesky(_build_ball(system, found)), dtype=np.float64)
    _, _, right = np.linalg.svd(system.rows)
    told = right[: 10 - system.free.shape[1]] / system.sizes
    with np.errstate(all="ignore"):
        solution = solve_body_equations(_build_body_problem(root, told, told @ found))
        if solution is None:
            # Ten rows say the same of it as all.
            whole = np.column_stack([system.rows, system.target])
            triangle = np.asarray(np.linalg.qr(whole)[1], dtype=np.float64)[:10]
            rows, target = triangle[:, :10] / (system.sizes * scale), triangle[:, 10] / scale
            solution = optimise_bodies(_build_body_problem(root, rows, target))
    if not np.isfinite(solution.gap):
        text = "no body is near the change of the base values; check that both logs are of the same robot"
        raise IdentifiabilityError(Notice(code="payload.no-body", text=text))
    body = compute_standard_parameters(root @ solution.blocks @ root.T)[0]
    moved = float(np.linalg.norm(system.rows @ ((body - found) / system.sizes))) / scale
    return body, moved


def _build_body_problem(root: FloatArray, rows: FloatArray, target: FloatArray) -> BodyProblem:
    """Return the problem of the body nearest to root root' under rows (m, 10) of unit variance."""
    blocks = root.T @ np.einsum("mk,kab->mab", rows, PSEUDO_INERTIA_FORMS) @ root
    return BodyProblem(
        blocks=blocks[:, None],
        positive=np.zeros((len(target), 0)),
        others=np.zeros((len(target), 0)),
        target=target,
        shares=np.ones(1),
        weight=1.0,
        middle=np.zeros(0),
        loose=1.0,
    )


def _build_ball(system: PayloadSystem, found: FloatArray) -> FloatArray:
    """Return the pseudo-inertia (4, 4) of a ball of water of the mass, its centre where it is told."""
    mass = float(found[9])
    radius, _ = compute_ball(mass)
    told = _list_identifiable(system, found)
    centre = [found[6 + axis] / mass if told[1 + axis] else 0.0 for axis in range(3)]
    extended = np.array([*centre, 1.0])
    ball: FloatArray = np.outer(extended, extended) + radius**2 / 5 * np.diag([1.0, 1.0, 1.0, 0.0])
    return mass * ball


def _list_identifiable(system: PayloadSystem, body: FloatArray) -> list[bool]:
    """Return whether quantities are the same for all bodies that the equations leave free.

    One point is not enough: the inertia about the centre does not change with a centre that is at zero.
    """
    free = system.free.T * system.sizes
    points = [body, body + free.sum(axis=0), *(body + change for change in free)]
    rates = [compute_quantity_derivatives(point) for point in points]
    return [
        all(is_quantity_identifiable(system, entry[index]) for entry in rates)
        for index in range(len(PAYLOAD_QUANTITIES))
    ]


def _list_quantities(
    system: PayloadSystem, body: FloatArray, covariance: FloatArray
) -> tuple[PayloadQuantity, ...]:
    values, rates = compute_quantities(body), compute_quantity_derivatives(body)
    told = _list_identifiable(system, body)
    radius, moment = compute_ball(values[0])
    largest = max(moment, float(values[[4, 7, 9]].max()))
    found = []
    for index, name in enumerate(PAYLOAD_QUANTITIES):
        std = float(np.sqrt(rates[index] @ covariance @ rates[index]))
        reason = ""
        if not told[index]:
            reason = "the robot cannot show it, or only together with other parameters"
            if system.lacking:
                reason += "; base parameters that could tell it are not in both estimates"
        elif 1 <= index <= 3 and std > radius:
            reason = f"its standard deviation, {std:.2g} m, is larger than a body of that mass usually is"
        elif index > 3 and std > largest:
            reason = (
                f"its standard deviation, {std:.2g} kg m^2, is larger than the inertia itself; faster "
                "motions of the joints near the payload would tell it"
            )
        value = None if reason else float(values[index])
        deviation = None if reason else std
        found.append(
            PayloadQuantity(name=name, unit=_UNITS[index], value=value, std=deviation, reason=reason)
        )
    return tuple(found)
