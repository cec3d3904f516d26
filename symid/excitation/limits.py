"""Limits of a motion: position, velocity, acceleration, jerk, torque, torsion and workspace.

Robot, fallbacks for limits that its file does not state, a workspace file -> MotionLimits;
StateLimits, functions of CasADi of one sample's states with exact
derivatives.

Values v with v <= 1 (and v >= -1 where both signs count):

    torque    v = (tau(q, dq, ddq) + friction) / (share limit), of an elastic joint with the rotor's IA ddq
    torsion   v = tau_link / (k share limit), k what is left of the stiffness when all stops slip
    sphere    out: v = 2 - |p - c|^2 / (r + size)^2;  in: v = |p - c|^2 / (r - size)^2
    plane     v = 1 - (normal . p - offset - size) / (1 m)

Workspace file (TOML):

    [[sphere]]
    keep = "out"                # or "in"
    centre = [0.5, 0.0, 0.2]    # m, base frame
    radius = 0.3                # m
    links = ["joint7"]          # joints whose link frames carry the point; the last one where left out
    point = [0.0, 0.0, 0.1]     # m, in the link frame; its origin where left out
    size = 0.05                 # m, radius of a ball about the point; 0 where left out

    [[plane]]
    normal = [0.0, 0.0, 1.0]    # of any length
    offset = 0.05               # m: normal . p >= offset along the unit normal
    links = ["joint4", "joint7"]

Supported: robots whose file states all values (torque, torsion), all robots (motion, workspace); any
number of regions, each for any number of links.
Not supported: what the torsion adds to the speed of a rotor, small where the joint is stiff; contact
between links (give balls about their own places), moving obstacles.
"""

import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, final

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import ParameterCard
from symid.errors import Notice, RobotError
from symid.excitation.observation import bind_in_place, smooth_friction
from symid.robot import (
    NOT_NEGATIVE,
    POSITIVE,
    InputReport,
    Joint,
    JointKind,
    Robot,
    Section,
    locate_values,
    read_choice,
    read_number,
    read_numbers,
    read_text_file,
    refuse_unknown_keys,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitOptions:
    """How far the limits are used, and what holds where a robot file states none.

    Args:
        share: of every limit that a motion may use.
        sweep: rad or m either side of zero. speed: rad/s or m/s. acceleration: rad/s^2 or m/s^2.
        jerk: rad/s^3 or m/s^3; None for none.
    """

    share: float = 0.95
    sweep: float = 1.0
    speed: float = 2.0
    acceleration: float = 10.0
    jerk: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionLimits(FrozenArrays):
    """Limits of all joints, in full; a motion uses `share` of them.

    Args:
        centre, half: (n,) rad or m: positions are within centre +- half.
        velocity, acceleration, jerk: (n,) rad or m, /s, /s^2, /s^3; infinite for none.
        torque: (n,) N m or N; infinite for none.
        assumed: what the robot file does not state, in words.
    """

    centre: FloatArray
    half: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    torque: FloatArray
    share: float
    assumed: tuple[str, ...] = ()

    @property
    def bounds(self) -> FloatArray:
        """Return half, velocity, acceleration, jerk as (4, n)."""
        return np.array([self.half, self.velocity, self.acceleration, self.jerk])


def get_motion_limits(robot: Robot, options: LimitOptions | None = None) -> MotionLimits:
    """Return the limits of the robot's joints; those that its file does not state are the options'."""
    options = options or LimitOptions()
    assumed: list[str] = []
    ranges = [_get_position_range(joint, options, assumed) for joint in robot.axes]

    def find(name: str, fallback: float | None, unit: str) -> FloatArray:
        values = [getattr(joint.limits, name) for joint in robot.axes]
        if None in values and fallback is not None:
            which = ", ".join(
                joint.name for joint, value in zip(robot.axes, values, strict=True) if value is None
            )
            assumed.append(f"{name} {fallback:g} {unit} of {which}")
        other = math.inf if fallback is None else fallback
        return np.array([other if value is None else value for value in values])

    return MotionLimits(
        centre=np.array([centre for centre, _ in ranges]),
        half=np.array([half for _, half in ranges]),
        velocity=find("velocity", options.speed, "/s"),
        acceleration=find("acceleration", options.acceleration, "/s^2"),
        jerk=find("jerk", options.jerk, "/s^3"),
        torque=find("torque", None, ""),
        share=options.share,
        assumed=tuple(assumed),
    )


def _get_position_range(joint: Joint, options: LimitOptions, assumed: list[str]) -> tuple[float, float]:
    """Return centre and half of the positions that a joint may take."""
    if joint.limits.position is None:
        assumed.append(f"position +-{options.sweep:g} of {joint.name}")
        return 0.0, options.sweep
    low, high = joint.limits.position
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    if joint.kind is JointKind.REVOLUTE and half > math.pi:
        # A cable-bound axis may turn several times; an experiment need not.
        assumed.append(f"position +-pi about the middle of {joint.name}")
        half = math.pi
    return centre, half


def compute_coefficient_scales(limits: MotionLimits, harmonics: int, period: float) -> FloatArray:
    """Return the size (n, 2h + 1) in rad or m that centre, sines and cosines of a series may have."""
    speed = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    bounds = limits.share * limits.bounds[:, :, None] / speed ** np.arange(4)[:, None, None]
    waves = bounds.min(axis=0)
    return np.hstack([limits.share * limits.half[:, None], waves, waves])


_COMMON = ("links", "point", "size")
_KEYS = {"sphere": ("keep", "centre", "radius", *_COMMON), "plane": ("normal", "offset", *_COMMON)}

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspacePoint:
    """A ball of radius `size` (m) about `place` (m) in the frame of the link of joint `joint` (an index)."""

    joint: int
    place: Vector
    size: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceRegion:
    """One demand on some points.

    Args:
        kind: "out" or "in" of a sphere, or "plane".
        anchor: centre of the sphere in m, or unit normal of the plane.
        extent: radius of the sphere, or offset of the plane, m.
        points: what is kept there.
        label: how messages call it.
    """

    kind: str
    anchor: Vector
    extent: float
    points: tuple[WorkspacePoint, ...]
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceLimits:
    """All demands, and the file that they come from."""

    regions: tuple[WorkspaceRegion, ...] = ()
    file: str = ""


def read_workspace(path: Path, robot: Robot) -> WorkspaceLimits:
    """Return the workspace that the file at `path` describes.

    Raises:
        RobotError: with a notice for each mistake in the file.
    """
    text = read_text_file(path).replace("\r\n", "\n")
    try:
        values = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        notice = Notice(code="excitation.workspace", text=f"not valid TOML: {error}", file=str(path))
        raise RobotError(notice) from error
    report = InputReport(locate_values(text, str(path)))
    root = Section(values=values, path=(), report=report)
    refuse_unknown_keys(root, tuple(_KEYS))
    regions = tuple(
        _read_region(section, kind, robot) for kind in _KEYS for section in _list_tables(root, kind)
    )
    if not regions and not report.errors:
        text = "holds no [[sphere]] and no [[plane]]; write one, or leave the option out"
        raise RobotError(Notice(code="excitation.workspace", text=text, file=str(path)))
    if report.errors:
        raise RobotError(*report.notices())
    return WorkspaceLimits(regions=tuple(region for region in regions if region), file=str(path))


def _list_tables(root: Section, kind: str) -> Iterator[Section]:
    tables = root.values.get(kind, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        root.refuse("robot.wrong-type", kind, f"expected tables; write [[{kind}]] for each")
        return
    for index, table in enumerate(tables):
        section = Section(values=table, path=(kind, index), report=root.report, label=f"{kind} {index + 1}")
        refuse_unknown_keys(section, _KEYS[kind])
        yield section


def _read_region(section: Section, kind: str, robot: Robot) -> WorkspaceRegion | None:
    points = _read_points(section, robot)
    if kind == "plane":
        anchor, extent = _read_vector(section, "normal"), _read_length(section, "offset")
        length = math.hypot(*anchor) if anchor else 1.0
        if not length:
            section.refuse("robot.out-of-range", "normal", "a normal of length zero has no direction")
        if anchor is None or extent is None or not length:
            return None
        x, y, z = (part / length for part in anchor)
        return WorkspaceRegion(
            kind="plane", anchor=(x, y, z), extent=extent, points=points, label=section.label
        )
    keep = read_choice(section, "keep", ("out", "in")) or "out"
    centre, radius = _read_vector(section, "centre"), _read_length(section, "radius", positive=True)
    if centre is None or radius is None:
        return None
    if keep == "in" and any(point.size >= radius for point in points):
        section.refuse("robot.out-of-range", "size", f"a ball of this size does not fit within {radius:g} m")
    return WorkspaceRegion(kind=keep, anchor=centre, extent=radius, points=points, label=section.label)


def _read_points(section: Section, robot: Robot) -> tuple[WorkspacePoint, ...]:
    names = [joint.name for joint in robot.joints]
    wanted: object = section.values.get("links", names[-1:])
    if not isinstance(wanted, list) or not wanted or any(name not in names for name in wanted):
        allowed = ", ".join(names)
        text = f"expected a list of names of joints, got {section.show('links')}; there are {allowed}"
        section.refuse("robot.bad-choice", "links", text)
        return ()
    place = _read_vector(section, "point") if "point" in section.values else (0.0, 0.0, 0.0)
    size = read_number(section, "size", "m", NOT_NEGATIVE)
    if place is None:
        return ()
    return tuple(
        WorkspacePoint(joint=names.index(name), place=place, size=0.0 if size is None else float(size))
        for name in dict.fromkeys(wanted)
    )


def _read_vector(section: Section, key: str) -> Vector | None:
    if key not in section.values:
        section.refuse_key("robot.missing-key", key, "missing; three numbers are needed")
        return None
    found: Sequence[Decimal] | None = read_numbers(section, key, "m", 3)
    return (float(found[0]), float(found[1]), float(found[2])) if found else None


def _read_length(section: Section, key: str, *, positive: bool = False) -> float | None:
    if key not in section.values:
        section.refuse_key("robot.missing-key", key, "missing; a number in m is needed")
        return None
    found = read_number(section, key, "m", POSITIVE) if positive else read_number(section, key, "m")
    return None if found is None else float(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLimitOptions:
    """What is limited besides the motion of each joint.

    Args:
        workspace: where links may be.
        torsion: rad or m that an elastic joint may give; None for any.
        stiffness: (n,) N m/rad or N/m in place of the robot file's; None for those.
    """

    workspace: WorkspaceLimits = field(default_factory=WorkspaceLimits)
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
class _Limit:
    name: str
    kind: str
    limit: float
    both: bool
    expression: Any


def build_state_limits(
    robot: Robot, limits: MotionLimits, options: StateLimitOptions | None = None
) -> StateLimits:
    """Return the limits of a robot that depend on its whole state.

    Raises:
        RobotError: a torsion limit without the values that it needs.
    """
    import casadi as ca

    options = options or StateLimitOptions()
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
    robot: Robot, limits: MotionLimits, options: StateLimitOptions, states: Sequence[Any]
) -> tuple[list[_Limit], tuple[Notice, ...]]:
    """Return limits of torque and torsion, and what is said where values are not known."""
    limited = [float(limit) for limit in limits.torque]
    if not any(map(np.isfinite, limited)) and options.torsion is None:
        return [], ()
    found = _build_torques(robot, states)
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
        _Limit(
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


def _list_torsions(robot: Robot, limits: MotionLimits, options: StateLimitOptions, link: Any) -> list[_Limit]:  # noqa: ANN401  of casadi
    if options.torsion is None:
        return []
    allowed = limits.share * options.torsion
    # What is left when all stops slip, or the stops where nothing else is.
    stiffness: Sequence[float | None] = options.stiffness or [
        None if spring is None else spring.stiffness or spring.initial_stiffness
        for spring in (joint.elasticity for joint in robot.axes)
    ]
    if len(stiffness) != robot.freedom or not all(value is None or value > 0.0 for value in stiffness):
        text = (
            f"the torsion needs a positive stiffness for each of {robot.freedom} joints, got {len(stiffness)}"
        )
        raise RobotError(Notice(code="excitation.stiffness", text=text, file=robot.path))
    entries = [
        _Limit(
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


def _build_torques(robot: Robot, states: Sequence[Any]) -> tuple[Any, Any] | None:
    """Return torques of the links and of the motors, None where values are not known."""
    import casadi as ca

    from symid.codegen import build_functions

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


def _list_space(robot: Robot, workspace: WorkspaceLimits, position: Any) -> list[_Limit]:  # noqa: ANN401  of casadi
    import casadi as ca

    from symid.codegen import build_functions

    if not workspace.regions:
        return []
    kinematics = build_functions(robot, names=("forward_kinematics",)).functions[0]
    turns, origins = kinematics(position)
    entries = []
    for region in workspace.regions:
        for point in region.points:
            turn = ca.reshape(turns[point.joint, :], 3, 3).T
            place = origins[point.joint, :].T + turn @ ca.DM(list(point.place))
            limit, expression = _build_clearance(region, place, point.size)
            name = f"{region.label}, {robot.joints[point.joint].name}"
            entries.append(
                _Limit(name=name, kind=region.kind, limit=limit, both=False, expression=expression)
            )
    return entries


def _build_clearance(region: WorkspaceRegion, place: Any, size: float) -> tuple[float, Any]:  # noqa: ANN401  of casadi
    """Return the length in m that a value of one stands for, and the value."""
    import casadi as ca

    anchor = ca.DM(list(region.anchor))
    if region.kind == "plane":
        return 1.0, 1.0 - (ca.dot(anchor, place) - region.extent - size)
    squared = ca.sumsqr(place - anchor)
    if region.kind == "in":
        return region.extent - size, squared / (region.extent - size) ** 2
    return region.extent + size, 2.0 - squared / (region.extent + size) ** 2


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
            self._run_values = bind_in_place(limits.values.map(samples), (self._states,), self._values)
            self._run_slopes = bind_in_place(limits.slopes.map(samples), (self._states,), self._slopes)

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
