"""What a robot carries: mass, centre of mass and inertia from base values with and without it.

Robot, its base parameters, base values of the loaded and of the empty robot with their covariances ->
`Payload`: a body that can exist, the uncertainty of its quantities, what cannot be identified, and which
parameters changed for another reason. A body on a link adds delta to the ten parameters of that link:

    beta_loaded - beta_empty = K_link delta + noise,   noise of covariance C_loaded + C_empty,

solved by generalised least squares. Friction may change with the load: it takes part through its covariance
alone. Standard deviations are those of least squares, times the root of chi^2 over its degrees of freedom
where that is larger than one. Where no body has the values of least squares, the one that minimises chi^2 / 2
plus the distance to a ball of water of the same mass and place is taken (`nearest_bodies`).

Supported: any link of a tree; a known mass, as one more row; base values known in part; frames of the file.
Not supported: bodies on several links, bodies that move on their link, a mass of zero.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle, freeze
from symid.dynamics import nearest_bodies
from symid.dynamics.base_parameters import BaseParameters, build_grouping
from symid.errors import EstimateError, IdentifiabilityError, Notice, UsageError
from symid.notation import INERTIAL
from symid.robot import Robot, build_pseudo_inertias, move_parameters

PAYLOAD_QUANTITIES = ("mass", "cx", "cy", "cz", "Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz")
"""Mass (kg), centre of mass (m), inertia about it (kg m^2)."""
_UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)
_PAIRS = tuple(zip(*np.triu_indices(3), strict=True))
_DENSITY = 1000.0
_TINY = 1e-40
# A size for lengths, so that numbers of different units can be compared; no result depends on it.
_LENGTH = 0.1
_RANK = 1e-9
_IDENTIFIABLE = 1e-6
_WEIGHED = 1e-6
_CHANGED = 4.0
# A mass is significant from this many standard deviations on.
_SIGNIFICANT = 3.0


def compute_ball(mass: float) -> tuple[float, float]:
    """Return radius (m) and moment of inertia (kg m^2) of a ball of water of a mass (kg)."""
    radius = (3.0 * abs(mass) / (4.0 * math.pi * _DENSITY)) ** (1.0 / 3.0)
    return radius, 0.4 * abs(mass) * radius**2


def compute_quantities(parameters: NDArray[Any]) -> NDArray[Any]:
    """Return `PAYLOAD_QUANTITIES` of standard parameters (10,): c = s / m, J = I - (s.s 1 - s s') / m."""
    tensor, s, mass = parameters[:6], parameters[6:9], parameters[9]
    shift = [(float(i == j) * (s @ s) - s[i] * s[j]) / mass for i, j in _PAIRS]
    return np.array([mass, *(s / mass), *(tensor - np.array(shift))])


def compute_quantity_derivatives(parameters: FloatArray) -> FloatArray:
    """Return (10, 10) derivatives by complex steps (Squire and Trapp, SIAM Review 40 (1998) 110-112)."""
    moved = parameters + 1j * _TINY * np.eye(10)
    return np.array([compute_quantities(point).imag for point in moved]).T / _TINY


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseValues(FrozenArrays):
    """Values (p,) of base and friction parameters by name, SI, and their covariance (p, p)."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray


def build_base_values(
    names: Sequence[str],
    values: Sequence[float],
    deviations: Sequence[float],
    covariance: Sequence[Sequence[float]] = (),
) -> BaseValues:
    """Return values (p,) of an estimate; without a covariance (p, p) its deviations count as independent."""
    known = np.array(covariance, dtype=np.float64) if len(covariance) else np.diag(np.square(deviations))
    return BaseValues(names=tuple(names), values=np.array(values, dtype=np.float64), covariance=known)


def _compare(
    names: Sequence[str], loaded: BaseValues, empty: BaseValues
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return values before and after (m,), and the covariance of their difference (m, m)."""
    after, before = ([given.names.index(name) for name in names] for given in (loaded, empty))
    covariance = loaded.covariance[np.ix_(after, after)] + empty.covariance[np.ix_(before, before)]
    return empty.values[before], loaded.values[after], covariance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PayloadSystem:
    """Equations of unit variance for the ten parameters of the body, in the frame of the file.

    `rows` (m, 10) and `free` (10, k), what is not identifiable, are in units of `sizes` (10,); `lacking`:
    whether more is identifiable with all base parameters of the robot. A given mass is the last row.
    """

    names: tuple[str, ...]
    rows: FloatArray
    target: FloatArray
    sizes: FloatArray
    free: FloatArray
    lacking: bool


def _build_system(
    robot: Robot,
    base: BaseParameters,
    loaded: BaseValues,
    empty: BaseValues,
    *,
    link: int,
    mass: float | None,
) -> PayloadSystem:
    """Return the equations of the payload on a link."""
    wanted = [entry.name for entry in base.parameters]
    names = tuple(name for name in wanted if name in loaded.names and name in empty.names)
    if not names:
        text = "the two estimates share no base parameter; identify both with the same robot file"
        raise EstimateError(Notice(code="payload.nothing-shared", text=text))
    # From the file's frame of the link to the link frame.
    frame, symbols = robot.joints[link].frame, dict(robot.symbols)
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    change = np.array([move_parameters(unit, rotation, origin) for unit in np.eye(10).tolist()]).T
    sizes = np.array([_LENGTH**2] * 6 + [_LENGTH] * 3 + [1.0])
    grouping = build_grouping(robot, base, tuple(wanted))
    columns = grouping.matrix[:, [grouping.labels.index((link, name)) for name in INERTIAL]]
    every = columns @ change * sizes
    rows = columns[[wanted.index(name) for name in names]] @ change * sizes
    before, after, covariance = _compare(names, loaded, empty)
    white = _whiten(covariance)
    matrix, target = white @ rows, white @ (after - before)
    if mass is not None:
        weighed = np.eye(10)[9:]
        every, rows = np.vstack([every, weighed]), np.vstack([rows, weighed])
        matrix = np.vstack([matrix, weighed / (_WEIGHED * mass)])
        target = np.append(target, 1.0 / _WEIGHED)
    free = _compute_null_space(rows)
    lacking = free.shape[1] > _compute_null_space(every).shape[1]
    return PayloadSystem(names=names, rows=matrix, target=target, sizes=sizes, free=free, lacking=lacking)


def _whiten(covariance: FloatArray) -> FloatArray:
    """Return W with W C W' = 1, or raise an EstimateError where a standard deviation is missing."""
    white = nearest_bodies.compute_whitening(covariance, len(covariance) * np.finfo(float).eps)
    if white is None:
        text = "an estimate has no standard deviations; identify it with an estimator that computes them"
        raise EstimateError(Notice(code="payload.no-deviations", text=text))
    return white


def _compute_null_space(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis (10, k) of the null space of the rows."""
    _, values, right = np.linalg.svd(np.vstack([rows, np.zeros((10, 10))]), full_matrices=False)
    return right[values <= _RANK * max(float(values[0]), 1e-300)].T


def _is_identifiable(system: PayloadSystem, rates: FloatArray) -> bool:
    """Return whether a quantity with these derivatives (10,) changes with nothing that is free."""
    scaled = rates * system.sizes
    return float(np.linalg.norm(scaled @ system.free)) <= _IDENTIFIABLE * float(np.linalg.norm(scaled))


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A parameter that changed: from, to, and by how many standard deviations."""

    name: str
    before: float
    after: float
    deviations: float


def _list_changes(
    names: Sequence[str], loaded: BaseValues, empty: BaseValues, left: FloatArray | None = None
) -> tuple[ParameterChange, ...]:
    """Return the parameters that changed significantly, the largest change first."""
    # `left` (m,) are residuals of the payload: what it does not explain of the change counts then.
    before, after, covariance = _compare(names, loaded, empty)
    change: FloatArray = after - before
    if left is not None:
        # Back in units of the parameters.
        change = np.asarray(np.linalg.solve(_whiten(covariance), left[: len(names)]), np.float64)
    deviations = np.sqrt(np.diag(covariance))
    known = np.isfinite(deviations) & (deviations > 0)
    shares = np.where(known, change / np.where(known, deviations, 1.0), 0.0)
    rows = zip(names, before.tolist(), after.tolist(), shares.tolist(), strict=True)
    changes = [
        ParameterChange(name=name, before=low, after=high, deviations=share)
        for name, low, high, share in rows
        if abs(share) > _CHANGED
    ]
    return tuple(sorted(changes, key=lambda change: -abs(change.deviations)))


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
        standard: (10,) of a body that exists and has the identifiable quantities; the others are guesses.
        chi2: of least squares, over `freedom` degrees; deviations are multiplied by `scale`.
        moved: how far the body is from least squares, in standard deviations; 0 where that is a body.
        unexplained: base parameters that changed although no payload changes them so, the worst first.
        friction: friction parameters that changed significantly.
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
        return self.chi2 > self.freedom + _SIGNIFICANT * float(np.sqrt(2.0 * self.freedom))


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

    `joint`: whose link carries it, the last one by default; `mass` in kg, where a balance measured it.

    Raises:
        UsageError: there is no such joint, or the mass is no positive number.
        EstimateError: the values share no base parameter, or have no deviations.
        IdentifiabilityError: the mass is not identifiable or not significant, or no body explains the change.
        RobotError: a symbolic length has no value.
    """
    names = [entry.name for entry in robot.joints]
    if joint is not None and joint not in names:
        text = f"unknown joint {joint!r}; the joints are {', '.join(names)}"
        raise UsageError(Notice(code="usage.payload-joint", text=text))
    link = robot.size - 1 if joint is None else names.index(joint)
    if mass is not None and not 0 < mass < np.inf:
        text = f"the mass must be a positive number of kg, got {mass}"
        raise UsageError(Notice(code="usage.payload-mass", text=text))
    system = _build_system(robot, base, loaded, empty, link=link, mass=mass)
    # Least squares of smallest norm (10,), and its covariance (10, 10) where identifiable.
    _, values, right = np.linalg.svd(system.rows, full_matrices=False)
    rank = 10 - system.free.shape[1]
    factor = system.sizes[:, None] * right[:rank].T / values[:rank]
    cut = float(values[rank - 1] / values[0] / 2)
    found = np.linalg.lstsq(system.rows, system.target, rcond=cut)[0] * system.sizes
    covariance = factor @ factor.T
    left = system.target - system.rows @ (found / system.sizes)
    freedom = len(left) - rank
    chi2 = float(left @ left)
    scale = float(np.sqrt(max(1.0, chi2 / freedom))) if freedom else 1.0
    covariance = covariance * scale**2
    weight, spread = float(found[9]), float(np.sqrt(covariance[9, 9]))
    if not _is_identifiable(system, np.eye(10)[9]):
        text = f"the mass on the link of joint {names[link]!r} is not identifiable on its own, nor is its "
        text += "centre: state the mass by --mass"
        text += ", or identify more base parameters" if system.lacking else ""
        raise IdentifiabilityError(Notice(code="payload.mass-not-identifiable", text=text))
    if not weight > _SIGNIFICANT * spread:
        text = f"no significant payload: its mass is {weight:.4g} kg with a standard deviation of "
        text += f"{spread:.2g} kg. Check which log is the loaded one, move more joints against gravity, "
        text += "or record longer"
        raise IdentifiabilityError(Notice(code="payload.none", text=text))
    body, moved = _choose_body(system, found, scale)
    friction = [p.name for p in base.friction if p.name in loaded.names and p.name in empty.names]
    return Payload(
        joint=names[link],
        quantities=_list_quantities(system, body, covariance),
        standard=freeze(body),
        chi2=chi2,
        freedom=freedom,
        scale=scale,
        moved=moved,
        unexplained=_list_changes(system.names, loaded, empty, left),
        friction=_list_changes(friction, loaded, empty),
    )


def _choose_body(system: PayloadSystem, found: FloatArray, scale: float) -> tuple[FloatArray, float]:
    """Return a body near least squares, and how far it is away (standard deviations)."""
    bodies = build_pseudo_inertias(found[None, :])
    if not system.free.shape[1] and float(np.linalg.eigvalsh(bodies[0])[0]) > 0:
        return found, 0.0
    # A ball of water of the mass, its centre where that is identifiable.
    mass, identifiable = float(found[9]), _list_identifiable(system, found)
    radius, _ = compute_ball(mass)
    extended = np.append(np.where(identifiable[1:4], found[6:9] / mass, 0.0), 1.0)
    ball = np.outer(extended, extended) + radius**2 / 5 * np.diag([1.0, 1.0, 1.0, 0.0])
    root = np.asarray(np.linalg.cholesky(mass * ball), dtype=np.float64)
    _, _, right = np.linalg.svd(system.rows)
    known = right[: 10 - system.free.shape[1]] / system.sizes
    with np.errstate(all="ignore"):
        solution = nearest_bodies.solve_body_equations(_build_body_problem(root, known, known @ found))
        if solution is None:
            # Ten rows are equivalent to all.
            triangle = compute_triangle(np.column_stack([system.rows, system.target]))[:10]
            rows, target = triangle[:, :10] / (system.sizes * scale), triangle[:, 10] / scale
            solution = nearest_bodies.optimise_bodies(_build_body_problem(root, rows, target))
    if not np.isfinite(solution.gap):
        text = "no body explains the change of the base values; check that both logs are of the same robot"
        raise IdentifiabilityError(Notice(code="payload.no-body", text=text))
    body = nearest_bodies.compute_standard_parameters(root @ solution.blocks @ root.T)[0]
    moved = float(np.linalg.norm(system.rows @ ((body - found) / system.sizes))) / scale
    return body, moved


def _build_body_problem(root: FloatArray, rows: FloatArray, target: FloatArray) -> nearest_bodies.BodyProblem:
    """Return the problem of the body nearest to root root' under rows (m, 10) of unit variance."""
    blocks = root.T @ np.einsum("mk,kab->mab", rows, nearest_bodies.PSEUDO_INERTIA_FORMS) @ root
    none = np.zeros((len(target), 0))
    return nearest_bodies.BodyProblem(
        blocks=blocks[:, None],
        positive=none,
        others=none,
        target=target,
        shares=np.ones(1),
        middle=np.zeros(0),
    )


def _list_identifiable(system: PayloadSystem, body: FloatArray) -> list[bool]:
    """Return whether quantities are the same for all bodies that the equations leave free."""
    # One point is not enough: the inertia about the centre does not change with a centre that is at zero.
    free = system.free.T * system.sizes
    points = [body, body + free.sum(axis=0), *(body + change for change in free)]
    rates = [compute_quantity_derivatives(point) for point in points]
    places = range(len(PAYLOAD_QUANTITIES))
    return [all(_is_identifiable(system, entry[place]) for entry in rates) for place in places]


def _list_quantities(
    system: PayloadSystem, body: FloatArray, covariance: FloatArray
) -> tuple[PayloadQuantity, ...]:
    values, rates = compute_quantities(body), compute_quantity_derivatives(body)
    identifiable = _list_identifiable(system, body)
    radius, moment = compute_ball(values[0])
    largest = max(moment, float(values[[4, 7, 9]].max()))
    found = []
    for index, (name, unit) in enumerate(zip(PAYLOAD_QUANTITIES, _UNITS, strict=True)):
        std = float(np.sqrt(rates[index] @ covariance @ rates[index]))
        reason = ""
        if not identifiable[index]:
            reason = "not identifiable, or only together with other parameters"
            if system.lacking:
                reason += "; base parameters that it needs are missing in one of the estimates"
        elif 1 <= index <= 3 and std > radius:
            reason = f"its standard deviation, {std:.2g} m, exceeds the usual size of a body of that mass"
        elif index > 3 and std > largest:
            reason = f"its standard deviation, {std:.2g} kg m^2, exceeds the inertia itself; "
            reason += "move the joints near the payload faster"
        value, deviation = (None, None) if reason else (float(values[index]), std)
        found.append(PayloadQuantity(name=name, unit=unit, value=value, std=deviation, reason=reason))
    return tuple(found)
