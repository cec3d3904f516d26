"""A robot as a URDF, for every library that reads one.

Input: a robot, and standard parameters in place of the file's values where they are given. Output: the text.

The base is the link `base`; each joint moves the link `<joint>_link`, whose frame is the link frame used
here: the axis is z. Numbers have all digits of a double. Inertia is about the centre of mass; a link of
unknown values has no <inertial>. Limits that are unknown stand as 0: a URDF must state them, and symid reads
0 as unknown.

Supported: placements, inertial values, limits, damping and friction, followers, gears and rotor inertia.
Not supported, and said in a comment: symbols (their values are written), other gravity than (0, 0, -9.81),
friction with an offset or a direction, springs, elastic joints, drives coupled to several joints.
"""

import math
import re
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from symid.robot.axis_frames import to_floats
from symid.robot.description import FrictionKind, Joint, JointKind, Robot
from symid.robot.elasticity import Elasticity
from symid.robot.geometry import Placement
from symid.robot.inertia import move_parameters

__all__ = ["write_urdf"]

_GRAVITY = (0.0, 0.0, -9.81)
_BASE = "base"
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def write_urdf(robot: Robot, parameters: Sequence[Sequence[float]] | None = None) -> str:
    """Return the URDF of `robot`.

    Args:
        robot: the robot.
        parameters: (n, 10) XX XY XZ YY YZ ZZ MX MY MZ M of each joint's link about its frame's origin, in
            place of `Joint.inertial`.
    """
    values = [joint.inertial for joint in robot.joints] if parameters is None else list(parameters)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={_quote(robot.name)}>"]
    lines += [f"  <!-- {_comment(text)} -->" for text in _list_omissions(robot)]
    lines.append(f'  <link name="{_BASE}"/>')
    for joint, inertial in zip(robot.joints, values, strict=True):
        lines += _write_link(joint, inertial)
        lines += _write_joint(robot, joint)
    for joint in robot.joints:
        lines += _write_transmission(joint)
    return "\n".join((*lines, "</robot>", ""))


def _quote(name: str) -> str:
    return quoteattr(re.sub(r"[\x00-\x1f\ufffe\uffff]", " ", name))


def _comment(text: str) -> str:
    return escape(re.sub(r"[\x00-\x1f\ufffe\uffff]", " ", text)).replace("--", "- -")


def _number(value: float) -> str:
    return repr(float(value) + 0.0)


def _numbers(values: Sequence[float]) -> str:
    return " ".join(_number(value) for value in values)


def _link(name: str) -> str:
    return _quote(f"{name}_link")


def _list_omissions(robot: Robot) -> Iterator[str]:
    """Return what a URDF has no words for."""
    gravity = tuple(value.to_float(dict(robot.symbols)) for value in robot.gravity)
    if gravity != _GRAVITY:
        yield f"gravity of the model: {_numbers(gravity)} m/s^2 in the frame of the link {_BASE}"
    for name, value in robot.symbols:
        yield f"{name} = {_number(value)} m"
    for joint in robot.joints:
        if joint.friction.kind not in {FrictionKind.NONE, FrictionKind.VISCOUS_COULOMB}:
            values = f", values {_numbers(joint.friction.values)}" if joint.friction.values else ""
            shape = f", shape {_numbers(joint.friction.shape)}" if joint.friction.shape else ""
            yield f"joint {joint.name}: friction model {joint.friction.kind.value}{values}{shape}"
        if joint.friction.smoothing:
            yield f"joint {joint.name}: dry friction changes its sign over {joint.friction.smoothing}"
        if joint.spring is not None:
            yield f"joint {joint.name}: a spring, {joint.spring.stiffness} at rest at {joint.spring.rest}"
        if joint.elasticity is not None:
            yield f"joint {joint.name}: elastic, {_describe(joint.elasticity)}"
    for coupling in robot.couplings:
        names = ", ".join(f"{float(factor):g} {robot.joints[index].name}" for index, factor in coupling.terms)
        yield f"a drive coupled to several joints, {coupling.name}: {names}"


def _describe(elasticity: Elasticity) -> str:
    parts = [str(elasticity.stiffness)]
    parts += [f"damping {elasticity.damping}"] if elasticity.damping else []
    parts += [f"cubic {elasticity.cubic}"] if elasticity.cubic else []
    parts += [f"stop of {stop.stiffness} to {stop.threshold}" for stop in elasticity.stops]
    parts += [f"knee of {knee.slope} at {knee.threshold}" for knee in elasticity.knees]
    return ", ".join(parts)


def _find_rpy(placement: Placement) -> tuple[float, float, float]:
    """Return roll, pitch, yaw with Rot(z, yaw) Rot(y, pitch) Rot(x, roll) = R; roll 0 where it is free."""
    r = to_floats(placement)
    across = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], across)
    if not across:
        return (0.0, pitch, math.atan2(-r[0][1], r[1][1]))
    return (math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0]))


def _write_link(joint: Joint, inertial: Sequence[float] | None) -> Iterator[str]:
    if inertial is None:
        yield f"  <link name={_link(joint.name)}/>"
        return
    mass = float(inertial[9])
    com = [float(value) / mass for value in inertial[6:9]] if mass else [0.0, 0.0, 0.0]
    central = move_parameters(inertial, np.eye(3), -np.array(com))[:6]
    tensor = " ".join(f'{key}="{_number(value)}"' for key, value in zip(_TENSOR, central, strict=True))
    yield f"  <link name={_link(joint.name)}>"
    yield "    <inertial>"
    yield f'      <origin xyz="{_numbers(com)}" rpy="0 0 0"/>'
    yield f'      <mass value="{_number(mass)}"/>'
    yield f"      <inertia {tensor}/>"
    yield "    </inertial>"
    yield "  </link>"


def _write_joint(robot: Robot, joint: Joint) -> Iterator[str]:
    symbols = dict(robot.symbols)
    parent = _link(robot.joints[joint.parent].name) if joint.parent >= 0 else f'"{_BASE}"'
    xyz = [value.to_float(symbols) for value in joint.placement.translation]
    yield f'  <joint name={_quote(joint.name)} type="{_find_type(joint)}">'
    yield f'    <origin xyz="{_numbers(xyz)}" rpy="{_numbers(_find_rpy(joint.placement))}"/>'
    yield f"    <parent link={parent}/>"
    yield f"    <child link={_link(joint.name)}/>"
    yield '    <axis xyz="0 0 1"/>'
    low, high = joint.limits.position or (0.0, 0.0)
    ends = "" if _find_type(joint) == "continuous" else f'lower="{_number(low)}" upper="{_number(high)}" '
    effort, velocity = joint.limits.torque or 0.0, joint.limits.velocity or 0.0
    yield f'    <limit {ends}effort="{_number(effort)}" velocity="{_number(velocity)}"/>'
    if joint.friction.kind is FrictionKind.VISCOUS_COULOMB and joint.friction.values:
        damping, friction = joint.friction.values
        yield f'    <dynamics damping="{_number(damping)}" friction="{_number(friction)}"/>'
    if joint.mimic is not None:
        master = _quote(robot.joints[joint.mimic.master].name)
        factor = _number(float(joint.mimic.multiplier))
        yield f'    <mimic joint={master} multiplier="{factor}" offset="0.0"/>'
    yield "  </joint>"


def _find_type(joint: Joint) -> str:
    if joint.kind is JointKind.REVOLUTE and joint.limits.position is None:
        return "continuous"
    return joint.kind.value


def _write_transmission(joint: Joint) -> Iterator[str]:
    drive = joint.drive
    if drive.gear == 1.0 and not drive.has_rotor:
        return
    yield f"  <transmission name={_quote(f'{joint.name}_transmission')}>"
    yield "    <type>transmission_interface/SimpleTransmission</type>"
    yield f"    <joint name={_quote(joint.name)}/>"
    yield f"    <actuator name={_quote(f'{joint.name}_motor')}>"
    yield f"      <mechanicalReduction>{_number(drive.gear)}</mechanicalReduction>"
    if drive.rotor_inertia is not None:
        # On the motor side, as URDFs have it.
        yield f"      <motorInertia>{_number(drive.rotor_inertia / drive.gear**2)}</motorInertia>"
    yield "    </actuator>"
    yield "  </transmission>"
