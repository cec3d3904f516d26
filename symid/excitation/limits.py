"""Limits of a motion: position, velocity, acceleration, jerk, torque, torsion and workspace.

Robot, fallbacks for limits that its file does not state, a workspace file (docs/excite.md) -> MotionLimits;
StateLimits: CasADi functions of one sample's states. Values v <= 1 (and v >= -1 where both signs count):

    torque    v = (tau(q, dq, ddq) + friction) / (share limit), of an elastic joint with the rotor's IA ddq
    torsion   v = tau_link / (k share limit), k what is left of the stiffness when all stops slip
    sphere    out: v = 2 - |p - c|^2 / (r + size)^2;  in: v = |p - c|^2 / (r - size)^2
    plane     v = 1 - (normal . p - offset - size) / (1 m)

Supported: robots whose file states all values (torque, torsion), all robots (motion, workspace).
Not supported: the part of the torsion in the speed of a rotor; contact between links, moving obstacles.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from symid import codegen, robot as robots
from symid.arrays import FloatArray, FrozenArrays
from symid.errors import Notice, RobotError
from symid.joint_models import NO_FRICTION, FrictionValues, get_friction_law, name_values
from symid.options import ExciteOptions

Shape = tuple[int, ...]
_SMOOTHING = 0.02
"""Width of the sign change of friction for the optimiser, relative to the velocity limit."""
_SLOW = 0.02
"""The same for joints without a velocity limit, rad/s or m/s."""
_LENGTH = "a number in m is needed"
_COMMON = ("links", "point", "size")
_KEYS = {"sphere": ("keep", "centre", "radius", *_COMMON), "plane": ("normal", "offset", *_COMMON)}
"""Of the tables of a workspace file."""


def smooth_friction(robot: robots.Robot) -> robots.Robot:
    """Return the robot with friction that has a slope everywhere."""

    def smooth(friction: FrictionValues, velocity: float | None) -> FrictionValues:
        law = get_friction_law(friction)
        if law is not None and {"load", "temperature"} & set(law.inputs):
            # Neither is known before the robot moves; what the motion must show of them is less.
            named = name_values(friction)
            values = tuple(named.get(name, 0.0) for name in ("Fv", "Fc", "offset")) if named else None
            plain = "coulomb-viscous-offset"
            friction = FrictionValues(law=plain, values=values, smoothing=friction.smoothing)
        if friction.law == NO_FRICTION or friction.smoothing > 0.0:
            return friction
        return replace(friction, smoothing=_SLOW if velocity is None else _SMOOTHING * velocity)

    joints = tuple(
        replace(joint, friction=smooth(joint.friction, joint.limits.velocity)) for joint in robot.joints
    )
    couplings = tuple(replace(entry, friction=smooth(entry.friction, None)) for entry in robot.couplings)
    return replace(robot, joints=joints, couplings=couplings)


@final
class InPlaceFunction:
    """A CasADi function at N samples that reads and writes its own memory."""

    def __init__(self, function: Any, samples: int, inputs: tuple[Shape, ...], output: Shape) -> None:  # noqa: ANN401  of casadi
        """Allocate arrays of these shapes for each sample."""
        self._inputs = [np.zeros((samples, *shape)) for shape in inputs]
        self._output = np.zeros((samples, *output))
        # The buffer must live as long as its call.
        self._buffer, self._call = function.map(samples).buffer()
        for place, memory in enumerate(self._inputs):
            self._buffer.set_arg(place, memory.data)
        self._buffer.set_res(0, self._output.data)

    def __call__(self, *values: FloatArray) -> FloatArray:
        """Return the output, which the next call overwrites."""
        for memory, value in zip(self._inputs, values, strict=True):
            memory[...] = value
        self._call()
        return self._output


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceRegion:
    """One demand on balls of radius `size` (m) about `place` (m) in the frames of some links.

    Args:
        kind: "out" or "in" of a sphere, or "plane".
        anchor: centre of the sphere in m, or unit normal of the plane.
        extent: radius of the sphere, or offset of the plane, m.
        joints: indices of those whose links are kept there.
        label: how messages call it.
    """

    kind: str
    anchor: tuple[float, ...]
    extent: float
    joints: tuple[int, ...]
    place: tuple[float, ...]
    size: float
    label: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionLimits(FrozenArrays):
    """Limits of all joints, in full; a motion uses `share` of them.

    Args:
        centre: (n,) rad or m, middle of the positions.
        bounds: (4, n) of the distance from it, of velocity, acceleration and jerk: rad or m, /s, /s^2, /s^3;
            infinite for none.
        torque: (n,) N m or N; infinite for none.
        assumed: what the robot file does not state, in words.
    """

    centre: FloatArray
    bounds: FloatArray
    torque: FloatArray
    share: float
    assumed: tuple[str, ...] = ()

    @property
    def half(self) -> FloatArray:
        """Return half the range of the positions, (n,) rad or m."""
        return np.asarray(self.bounds[0])


def get_motion_limits(robot: robots.Robot, options: ExciteOptions) -> MotionLimits:
    """Return the limits of the robot's joints; those that its file does not state are the options'."""
    assumed: list[str] = []
    centre, half = np.zeros(robot.freedom), np.full(robot.freedom, options.sweep)
    for place, joint in enumerate(robot.axes):
        if joint.limits.position is None:
            assumed.append(f"position +-{options.sweep:g} of {joint.name}")
            continue
        low, high = joint.limits.position
        centre[place], half[place] = 0.5 * (low + high), 0.5 * (high - low)
        if joint.kind is robots.JointKind.REVOLUTE and half[place] > math.pi:
            # A cable-bound axis may turn several times; an experiment need not.
            assumed.append(f"position +-pi about the middle of {joint.name}")
            half[place] = math.pi

    def get(name: str, fallback: float | None, unit: str) -> FloatArray:
        values = [getattr(joint.limits, name) for joint in robot.axes]
        lacking = [joint.name for joint, value in zip(robot.axes, values, strict=True) if value is None]
        if lacking and fallback is not None:
            assumed.append(f"{name} {fallback:g} {unit} of {', '.join(lacking)}")
        other = math.inf if fallback is None else fallback
        return np.array([other if value is None else value for value in values])

    velocity = get("velocity", options.velocity, "/s")
    acceleration = get("acceleration", options.acceleration, "/s^2")
    bounds = np.array([half, velocity, acceleration, get("jerk", options.jerk, "/s^3")])
    torque, share = get("torque", None, ""), options.share
    return MotionLimits(centre=centre, bounds=bounds, torque=torque, share=share, assumed=tuple(assumed))


def compute_coefficient_scales(limits: MotionLimits, harmonics: int, period: float) -> FloatArray:
    """Return the size (n, 2h + 1) in rad or m that centre, sines and cosines of a series may have."""
    speed = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    bounds = limits.share * limits.bounds[:, :, None] / speed ** np.arange(4)[:, None, None]
    waves = bounds.min(axis=0)
    return np.hstack([limits.share * limits.half[:, None], waves, waves])


def read_workspace(path: Path, robot: robots.Robot) -> tuple[WorkspaceRegion, ...]:
    """Return the demands of a file, or raise a RobotError with all mistakes."""
    root = robots.parse_toml(robots.read_text_file(path), str(path), "excitation.workspace")
    root.refuse_unknown_keys(tuple(_KEYS))
    regions: list[WorkspaceRegion] = []
    for kind, keys in _KEYS.items():
        for section in root.read_table_array(kind):
            section.refuse_unknown_keys(keys)
            region = _read_region(section, kind, robot)
            regions += [region] if region else []
    if root.errors:
        raise RobotError(*robots.sort_notices(root.errors))
    if not regions:
        text = "has no [[sphere]] and no [[plane]]; write one, or leave the option out"
        raise RobotError(Notice(code="excitation.workspace", text=text, file=str(path)))
    return tuple(regions)


def _read_region(section: robots.Section, kind: str, robot: robots.Robot) -> WorkspaceRegion | None:
    names = [joint.name for joint in robot.joints]
    wanted: object = section.values.get("links", names[-1:])
    if not isinstance(wanted, list) or not wanted or any(name not in names for name in wanted):
        text = f"expected a list of joint names, got {section.show('links')}; allowed are {', '.join(names)}"
        section.refuse("robot.bad-choice", "links", text)
        wanted = []
    place = _read_vector(section, "point") if "point" in section.values else (0.0, 0.0, 0.0)
    size = section.read_float("size", "m", robots.NOT_NEGATIVE) or 0.0
    if kind == "plane":
        anchor = _read_vector(section, "normal")
        extent = section.read_float("offset", "m") if section.require("offset", _LENGTH) else None
        length = math.hypot(*anchor) if anchor else 1.0
        if not length:
            section.refuse("robot.out-of-range", "normal", "a normal of length zero has no direction")
        elif anchor:
            anchor = tuple(value / length for value in anchor)
    else:
        kind = section.read_choice("keep", ("out", "in")) or "out"
        anchor, given = _read_vector(section, "centre"), section.require("radius", _LENGTH)
        extent = section.read_float("radius", "m", robots.POSITIVE) if given else None
        if kind == "in" and extent is not None and size >= extent:
            text = f"a ball of this size does not fit within {extent:g} m"
            section.refuse("robot.out-of-range", "size", text)
    if anchor is None or extent is None or place is None:
        return None
    return WorkspaceRegion(
        kind=kind,
        anchor=anchor,
        extent=extent,
        joints=tuple(map(names.index, dict.fromkeys(wanted))),
        place=place,
        size=size,
        label=section.label,
    )


def _read_vector(section: robots.Section, key: str) -> tuple[float, ...] | None:
    found = section.read_numbers(key, "m", 3) if section.require(key, "three numbers are needed") else None
    return tuple(map(float, found)) if found else None


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLimit:
    """One value v of a sample.

    Args:
        name: of joint or place. kind: "torque", "torsion", or of the workspace "out", "in", "plane".
        limit: N m, rad or m that v = 1 stands for, share included; of spheres the radius that the point
            itself keeps to, of planes one metre.
        expression: v, in CasADi.
    """

    name: str
    kind: str
    limit: float
    expression: Any

    @property
    def both(self) -> bool:
        """Return whether -1 is a limit as well."""
        return self.kind in {"torque", "torsion"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLimits:
    """All m values of a sample, and their functions.

    Args:
        entries: what they are.
        values: states (3n) -> (m). slopes: states -> (m 3n), row after row.
        notices: limits that are not kept.
    """

    entries: tuple[StateLimit, ...]
    values: Any
    slopes: Any
    notices: tuple[Notice, ...]


def build_state_limits(robot: robots.Robot, limits: MotionLimits, options: ExciteOptions) -> StateLimits:
    """Return the limits that depend on the whole state, or raise a RobotError if values are missing.

    The workspace is read from its file; a RobotError has all its mistakes.
    """
    import casadi as ca

    states = [ca.SX.sym(name, robot.freedom) for name in ("q", "dq", "ddq")]
    entries, notices = _list_loads(robot, limits, options, states)
    if options.workspace is not None:
        regions = read_workspace(Path(options.workspace), robot)
        (kinematics,) = codegen.build_functions(robot, names=("forward_kinematics",)).functions
        turns, origins = kinematics(states[0])
        for region, joint in [(entry, joint) for entry in regions for joint in entry.joints]:
            anchor = ca.DM(list(region.anchor))
            turn = ca.reshape(turns[joint, :], 3, 3).T
            place = origins[joint, :].T + turn @ ca.DM(list(region.place))
            if region.kind == "plane":
                limit = 1.0
                expression = 1.0 - (ca.dot(anchor, place) - region.extent - region.size)
            else:
                limit = region.extent + (region.size if region.kind == "out" else -region.size)
                squared = ca.sumsqr(place - anchor) / limit**2
                expression = 2.0 - squared if region.kind == "out" else squared
            name = f"{region.label}, {robot.joints[joint].name}"
            entries.append(StateLimit(name=name, kind=region.kind, limit=limit, expression=expression))
    state = ca.vertcat(*states)
    values = ca.densify(ca.vertcat(ca.SX(0, 1), *(entry.expression for entry in entries)))
    slopes = ca.densify(ca.vec(ca.jacobian(values, state).T))
    return StateLimits(
        entries=tuple(entries),
        values=ca.Function("values", [state], [values]),
        slopes=ca.Function("slopes", [state], [slopes]),
        notices=notices,
    )


def _list_loads(
    robot: robots.Robot, limits: MotionLimits, options: ExciteOptions, states: Sequence[Any]
) -> tuple[list[StateLimit], tuple[Notice, ...]]:
    """Return limits of torque and torsion, and a notice where they cannot be kept."""
    if not np.any(np.isfinite(limits.torque)) and options.torsion is None:
        return [], ()
    import casadi as ca

    smooth = smooth_friction(robot)
    made = codegen.build_functions(smooth, names=("inverse_dynamics",))
    card = made.card
    if any(entry.value is None for entry in (*card.beta, *card.friction, *card.rotors)):
        if options.torsion is not None:
            text = "a limit of the torsion needs all masses, inertias, springs and friction; state them"
            raise RobotError(Notice(code="excitation.no-values", text=text, file=robot.path))
        text = "torque limits are not kept: the robot file does not state all masses and friction; identify "
        text += "first, and design again with the values"
        return [], (Notice(code="excitation.no-torque", text=text),)
    link = made.functions[0](*states, ca.DM([entry.value or 0.0 for entry in card.beta]))
    motor = ca.SX(link)
    if card.friction:
        friction = codegen.build_functions(smooth, names=("friction",)).functions[0]
        # Only positions are read here besides velocities: see `smooth_friction`.
        values = ca.DM([entry.value or 0.0 for entry in card.friction])
        motor = motor + friction(states[1], *states[: len(card.friction_inputs)], values)
    names = [joint.name for joint in robot.axes]
    for entry in card.rotors:
        place = names.index(entry.joint)
        motor[place] += (entry.value or 0.0) * states[2][place]
    # By joint: what the limit is of, and the factor from it to the largest torque.
    loads = [("torque", motor, limits.share * limits.torque, np.ones(robot.freedom))]
    if options.torsion is not None:
        allowed = np.full(robot.freedom, limits.share * options.torsion)
        # With all stops slipping, else that of the stops; infinite of rigid joints.
        stiffness: Sequence[float | None] = options.stiffness or [
            None if spring is None else spring.stiffness or spring.initial_stiffness
            for spring in (joint.elasticity for joint in robot.axes)
        ]
        text = ""
        if len(stiffness) != robot.freedom or not all(value is None or value > 0.0 for value in stiffness):
            text = f"expected a positive stiffness for each of {robot.freedom} joints, got {list(stiffness)}"
        elif not any(stiffness):
            text = "no joint is elastic, or its stiffness is not stated; give the stiffness of all joints"
        if text:
            raise RobotError(Notice(code="excitation.stiffness", text=text, file=robot.path))
        slack = np.array([math.inf if value is None else value for value in stiffness])
        loads.append(("torsion", link, allowed, slack))
    entries = [
        StateLimit(name=joint.name, kind=kind, limit=limit, expression=torque[place] / (factor * limit))
        for kind, torque, bounds, rates in loads
        for place, (joint, limit, factor) in enumerate(
            zip(robot.axes, bounds.tolist(), rates.tolist(), strict=True)
        )
        if math.isfinite(factor * limit)
    ]
    return entries, ()


@final
class StateValues:
    """The values at a fixed number of samples, evaluated in place."""

    def __init__(self, limits: StateLimits, samples: int, size: int) -> None:
        """Allocate the memory of the functions; `size` is the number of joints."""
        self.both = np.array([entry.both for entry in limits.entries], dtype=bool)
        state, count = (3 * size,), len(limits.entries)
        self._values = InPlaceFunction(limits.values, samples, (state,), (count,))
        self._slopes = InPlaceFunction(limits.slopes, samples, (state,), (count, 3, size))

    def compute_values(self, states: FloatArray) -> FloatArray:
        """Return v (N, m) at states (3, N, n): q, dq, ddq."""
        return self._values(np.concatenate(states, axis=1)).copy()

    def compute_use(self, states: FloatArray) -> FloatArray:
        """Return v (N, m), its size where both signs are limited; one is the limit."""
        values = self.compute_values(states)
        return np.where(self.both, np.abs(values), values)

    def compute_slopes(self, states: FloatArray) -> FloatArray:
        """Return dv/dstates as (N, m, 3, n)."""
        return self._slopes(np.concatenate(states, axis=1)).copy()
