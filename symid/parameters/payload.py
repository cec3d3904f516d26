"""What a robot carries: mass, centre of mass and inertia from base values with and without it.

Input: a robot, its base parameters, base values of a loaded and of the empty robot with their covariances.
Output: `Payload`: a body that can exist, how surely each of its quantities is known, what cannot be told.

A body that is fixed to a link adds to the ten standard parameters of that link, so that

    beta_loaded - beta_empty = K_link delta + noise,   noise of covariance C_loaded + C_empty,

which is solved by generalised least squares. That is as good as one fit to all logs together, since base
parameters that the body does not touch must not change. Friction may, because gears brake more under load: it
takes part through its covariance alone, and its changes are listed.

Where no body has the values of least squares, the one that minimises chi^2 / 2 plus the distance to a ball of
water of the same mass and place is taken (`consistency_problem`); `moved` says how many standard deviations
that is away. Deviations are those of least squares, times the root of chi^2 over its degrees of freedom where
that is larger than one.

Supported: any link of a tree; a mass known from a balance; base values that are known in part.
Not supported: bodies on several links, bodies that move on their link.
"""

from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.parameters.base import BaseParameters
from symid.parameters.consistency_prior import FORMS, build_pseudo_inertias, find_parameters
from symid.parameters.consistency_problem import Problem, Solution
from symid.parameters.consistency_solver import find_nearest
from symid.parameters.payload_body import QUANTITIES, find_ball, find_quantities, find_quantity_rates
from symid.parameters.payload_changes import Change, list_friction_changes, list_unexplained
from symid.parameters.payload_equations import BaseValues, System, build_system, is_told, solve_system
from symid.robot.description import Robot

__all__ = ["Payload", "PayloadQuantity", "find_payload"]

# A mass counts as there from this many standard deviations on.
_SURE = 3.0
_UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadQuantity:
    """One of `QUANTITIES`: its value and standard deviation, or None and the reason why it is not told."""

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
    unexplained: tuple[Change, ...]
    friction: tuple[Change, ...]

    @property
    def doubtful(self) -> bool:
        """Return whether chi^2 is larger than noise makes it, by three of its standard deviations."""
        return self.chi2 > self.freedom + _SURE * float(np.sqrt(2.0 * self.freedom))


def find_payload(
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
    link = _find_link(robot, joint)
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
    _check_seen(robot, system, found, covariance, link)
    body, moved = _find_body(system, found, scale)
    return Payload(
        joint=robot.joints[link].name,
        quantities=_list_quantities(system, body, covariance),
        standard=freeze(body),
        chi2=chi2,
        freedom=freedom,
        scale=scale,
        moved=moved,
        unexplained=list_unexplained(system, left, loaded, empty),
        friction=list_friction_changes(base, loaded, empty),
    )


def _find_link(robot: Robot, joint: str | None) -> int:
    names = [entry.name for entry in robot.joints]
    if joint is None:
        return robot.size - 1
    if joint not in names:
        text = f"there is no joint {joint!r}; there are {', '.join(names)}"
        raise UsageError(Notice(code="usage.payload-joint", text=text))
    return names.index(joint)


def _check_seen(robot: Robot, system: System, found: FloatArray, covariance: FloatArray, link: int) -> None:
    """Refuse a change that may be noise alone, or none of what a payload has.

    Raises:
        IdentifiabilityError: it is.
    """
    told = is_told(system, np.eye(10)[9])
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


def _find_body(system: System, found: FloatArray, scale: float) -> tuple[FloatArray, float]:
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
    solution = _find_nearest(root, told, told @ found, 0.0)
    if solution is None:
        # Ten rows say the same of it as all.
        whole = np.column_stack([system.rows, system.target])
        triangle = np.asarray(np.linalg.qr(whole)[1], dtype=np.float64)[:10]
        solution = _find_nearest(root, triangle[:, :10] / system.sizes, triangle[:, 10], scale**2)
    if solution is None:
        text = "no body is near the change of the base values; check that both logs are of the same robot"
        raise IdentifiabilityError(Notice(code="payload.no-body", text=text))
    body = find_parameters(root @ solution.blocks @ root.T)[0]
    moved = float(np.linalg.norm(system.rows @ ((body - found) / system.sizes))) / scale
    return body, moved


def _find_nearest(root: FloatArray, rows: FloatArray, target: FloatArray, variance: float) -> Solution | None:
    """Return the body nearest to root root' that fulfils equations, exactly or within their variance."""
    count = len(target)
    norms = np.linalg.norm(rows, axis=1)
    forms = np.einsum("mk,kab->mab", rows / norms[:, None], FORMS)
    blocks = root.T @ forms @ root
    sizes = np.sqrt((blocks**2).sum(axis=(1, 2)))
    problem = Problem(
        blocks=(blocks / sizes[:, None, None])[:, None],
        positive=np.zeros((count, 0)),
        free=np.zeros((count, 0)),
        target=target / norms / sizes,
        slack=variance / (norms * sizes) ** 2,
        weights=np.ones(1),
    )
    with np.errstate(all="ignore"):
        return find_nearest(problem)


def _build_ball(system: System, found: FloatArray) -> FloatArray:
    """Return the pseudo-inertia (4, 4) of a ball of water of the mass, its centre where it is told."""
    mass = float(found[9])
    radius, _ = find_ball(mass)
    told = _find_told(system, found)
    centre = [found[6 + axis] / mass if told[1 + axis] else 0.0 for axis in range(3)]
    extended = np.array([*centre, 1.0])
    ball: FloatArray = np.outer(extended, extended) + radius**2 / 5 * np.diag([1.0, 1.0, 1.0, 0.0])
    return mass * ball


def _find_told(system: System, body: FloatArray) -> list[bool]:
    """Return whether quantities are the same for all bodies that the equations leave free.

    One point is not enough: the inertia about the centre does not change with a centre that is at zero.
    """
    free = system.free.T * system.sizes
    points = [body, body + free.sum(axis=0), *(body + change for change in free)]
    rates = [find_quantity_rates(point) for point in points]
    return [all(is_told(system, entry[index]) for entry in rates) for index in range(len(QUANTITIES))]


def _list_quantities(system: System, body: FloatArray, covariance: FloatArray) -> tuple[PayloadQuantity, ...]:
    values, rates = find_quantities(body), find_quantity_rates(body)
    told = _find_told(system, body)
    radius, moment = find_ball(values[0])
    largest = max(moment, float(values[[4, 7, 9]].max()))
    found = []
    for index, name in enumerate(QUANTITIES):
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
