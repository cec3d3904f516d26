"""Limits that depend on the state of the whole robot: torque, torsion, and where its links may be.

Input: a robot, its limits, a workspace, a torsion limit. Output: `StateLimits`: for one sample's states
values v (m,) with v <= 1 (and v >= -1 where both signs count), and their exact derivatives, as functions of
CasADi.

    torque    v = (tau(q, dq, ddq) + friction) / (share limit), of an elastic joint with the rotor's IA ddq
    torsion   v = tau_link / (k share limit), k what is left of the stiffness when all stops slip
    sphere    out: v = 2 - |p - c|^2 / (r + size)^2;  in: v = |p - c|^2 / (r - size)^2
    plane     v = 1 - (normal . p - offset - size) / (1 m)

Supported: robots whose file states all values (torque, torsion), all robots (space).
Not supported: what the torsion adds to the speed of a rotor; it is small where the joint is stiff.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import ParameterCard
from symid.errors import Notice, RobotError
from symid.excitation.limits import MotionLimits
from symid.excitation.observation import bind_function, smooth_friction
from symid.excitation.workspace import Region, Workspace
from symid.robot.description import Robot

__all__ = ["LoadOptions", "StateLimits", "StateValues", "build_state_limits"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadOptions:
    """What is limited besides the motion of each joint.

    Args:
        workspace: where links may be.
        torsion: rad or m that an elastic joint may give; None for any.
        stiffness: (n,) N m/rad or N/m in place of the robot file's; None for those.
    """

    workspace: Workspace = field(default_factory=Workspace)
    torsion: float | None = None
    stiffness: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLimits:
    """Values of one sample and what they are.

    Args:
        names: of each value. kinds: "torque", "torsion", or of space "out", "in", "plane".
        limits: N m, rad or m that a value of one stands for, `share` of the limit included; of spheres the
            radius that the point itself keeps to, of planes one metre.
        both: whether -1 is a limit as well.
        values: states (3n) -> (m). slopes: states -> (m 3n), row after row. None where m = 0.
        notices: what could not be limited.
    """

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    limits: tuple[float, ...] = ()
    both: tuple[bool, ...] = ()
    values: Any = None
    slopes: Any = None
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    name: str
    kind: str
    limit: float
    both: bool
    expression: Any


def build_state_limits(robot: Robot, limits: MotionLimits, options: LoadOptions | None = None) -> StateLimits:
    """Return the limits of a robot that depend on its whole state.

    Raises:
        RobotError: a torsion limit without the values that it needs.
    """
    import casadi as ca

    options = options or LoadOptions()
    size = robot.freedom
    states = [ca.SX.sym(name, size) for name in ("q", "dq", "ddq")]
    entries, notices = _list_loads(robot, limits, options, states)
    entries += _list_space(robot, options.workspace, states[0])
    if not entries:
        return StateLimits(notices=notices)
    state = ca.vertcat(*states)
    values = ca.densify(ca.vertcat(*(entry.expression for entry in entries)))
    slopes = ca.densify(ca.vec(ca.jacobian(values, state).T))
    return StateLimits(
        names=tuple(entry.name for entry in entries),
        kinds=tuple(entry.kind for entry in entries),
        limits=tuple(entry.limit for entry in entries),
        both=tuple(entry.both for entry in entries),
        values=ca.Function("values", [state], [values]),
        slopes=ca.Function("slopes", [state], [slopes]),
        notices=notices,
    )


def _list_loads(
    robot: Robot, limits: MotionLimits, options: LoadOptions, states: Sequence[Any]
) -> tuple[list[_Entry], tuple[Notice, ...]]:
    """Return limits of torque and torsion, and what is said where values are not known."""
    limited = [float(limit) for limit in limits.torque]
    if not any(map(np.isfinite, limited)) and options.torsion is None:
        return [], ()
    found = _find_torques(robot, states)
    if found is None:
        if options.torsion is not None:
            text = "a limit of the torsion needs all masses, inertias, springs and friction; state them"
            raise RobotError(Notice(code="excitation.no-values", text=text, file=robot.path))
        text = (
            "torque limits are not kept: the robot file does not state all masses and friction; identify "
            "first, and design again with the values"
        )
        return [], (Notice(code="excitation.no-torque", text=text),)
    link, motor = found
    entries = [
        _Entry(
            name=joint.name,
            kind="torque",
            limit=limits.share * limit,
            both=True,
            expression=motor[place] / (limits.share * limit),
        )
        for place, (joint, limit) in enumerate(zip(robot.axes, limited, strict=True))
        if np.isfinite(limit)
    ]
    return entries + _list_torsions(robot, limits, options, link), ()


def _list_torsions(robot: Robot, limits: MotionLimits, options: LoadOptions, link: Any) -> list[_Entry]:  # noqa: ANN401  of casadi
    if options.torsion is None:
        return []
    allowed = limits.share * options.torsion
    stiffness: Sequence[float | None] = options.stiffness or _find_stiffness(robot)
    if len(stiffness) != robot.freedom or not all(value is None or value > 0.0 for value in stiffness):
        text = (
            f"the torsion needs a positive stiffness for each of {robot.freedom} joints, got {len(stiffness)}"
        )
        raise RobotError(Notice(code="excitation.stiffness", text=text, file=robot.path))
    entries = [
        _Entry(
            name=joint.name,
            kind="torsion",
            limit=allowed,
            both=True,
            expression=link[place] / (value * allowed),
        )
        for place, (joint, value) in enumerate(zip(robot.axes, stiffness, strict=True))
        if value is not None
    ]
    if not entries:
        text = "no joint of it is elastic, or its stiffness is not stated; give the stiffness of all joints"
        raise RobotError(Notice(code="excitation.stiffness", text=text, file=robot.path))
    return entries


def _find_stiffness(robot: Robot) -> list[float | None]:
    """Return the stiffness that is left when all stops slip, that of the stops where nothing else is."""
    springs = (joint.elasticity for joint in robot.axes)
    return [None if spring is None else spring.stiffness or spring.initial_stiffness for spring in springs]


def _find_torques(robot: Robot, states: Sequence[Any]) -> tuple[Any, Any] | None:
    """Return torques of the links and of the motors, None where values are not known."""
    import casadi as ca

    from symid.codegen.casadi_functions import build_functions

    smooth = smooth_friction(robot)
    made = build_functions(smooth, names=("inverse_dynamics",))
    card = made.card
    if any(entry.value is None for entry in (*card.beta, *card.friction, *card.rotors)):
        return None

    def list_values(cards: Sequence[ParameterCard]) -> Any:  # noqa: ANN401  of casadi
        return ca.DM([entry.value or 0.0 for entry in cards])

    link = made.functions[0](*states, list_values(card.beta))
    motor = ca.SX(link)
    if card.friction:
        friction = build_functions(smooth, names=("friction",)).functions[0]
        motor = motor + friction(states[1], list_values(card.friction))
    names = [joint.name for joint in robot.axes]
    for entry in card.rotors:
        place = names.index(entry.joint)
        motor[place] += (entry.value or 0.0) * states[2][place]
    return link, motor


def _list_space(robot: Robot, workspace: Workspace, position: Any) -> list[_Entry]:  # noqa: ANN401  of casadi
    import casadi as ca

    from symid.codegen.casadi_functions import build_functions

    if not workspace.regions:
        return []
    kinematics = build_functions(robot, names=("forward_kinematics",)).functions[0]
    turns, origins = kinematics(position)
    entries = []
    for region in workspace.regions:
        for point in region.points:
            turn = ca.reshape(turns[point.joint, :], 3, 3).T
            place = origins[point.joint, :].T + turn @ ca.DM(list(point.place))
            entries.append(
                _Entry(
                    name=f"{region.label}, {robot.joints[point.joint].name}",
                    kind=region.kind,
                    limit=_find_radius(region, point.size),
                    both=False,
                    expression=_find_clearance(region, place, point.size),
                )
            )
    return entries


def _find_clearance(region: Region, place: Any, size: float) -> Any:  # noqa: ANN401  of casadi
    import casadi as ca

    anchor = ca.DM(list(region.anchor))
    if region.kind == "plane":
        return 1.0 - (ca.dot(anchor, place) - region.extent - size)
    squared = ca.sumsqr(place - anchor)
    if region.kind == "in":
        return squared / (region.extent - size) ** 2
    return 2.0 - squared / (region.extent + size) ** 2


def _find_radius(region: Region, size: float) -> float:
    if region.kind == "plane":
        return 1.0
    return region.extent - size if region.kind == "in" else region.extent + size


@final
class StateValues:
    """The values at so many samples, evaluated in place."""

    __slots__ = ("_run_slopes", "_run_values", "_slopes", "_states", "_values", "limits", "samples")

    def __init__(self, limits: StateLimits, samples: int, size: int) -> None:
        """Make the memory that the functions read and write; `size` is the number of joints."""
        count = len(limits.names)
        self.limits, self.samples = limits, samples
        self._states = np.zeros((samples, 3 * size))
        self._values = np.zeros((samples, count))
        self._slopes = np.zeros((samples, count, 3 * size))
        if count:
            self._run_values = bind_function(limits.values.map(samples), (self._states,), self._values)
            self._run_slopes = bind_function(limits.slopes.map(samples), (self._states,), self._slopes)

    def find_values(self, states: FloatArray) -> FloatArray:
        """Return v (N, m) at states (3, N, n): q, dq, ddq."""
        if self.limits.names:
            self._states[...] = np.concatenate(list(states), axis=1)
            self._run_values()
        return self._values.copy()

    def find_slopes(self, states: FloatArray) -> FloatArray:
        """Return dv/dstates as (N, m, 3, n)."""
        if self.limits.names:
            self._states[...] = np.concatenate(list(states), axis=1)
            self._run_slopes()
        return self._slopes.reshape(self.samples, len(self.limits.names), 3, -1).copy()
