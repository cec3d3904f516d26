"""A robot as a URDF, for every library that reads one.

Input: a robot, and standard parameters in place of the file's values where they are given. Output: the text.

The base is the link `base`; each joint moves the link `<joint>_link`, whose frame is the link frame used
here: the axis is z. Numbers have all digits of a double. Inertia is about the centre of mass; a link of
unknown values has no <inertial>. Limits that are unknown stand as 0: a URDF must state them, and symid reads
0 as unknown.

Supported: placements, inertial values, limits, damping and friction, followers, gears and rotor inertia.
Not supported, and said in a comment: symbols (their values are written), other gravity than (0, 0, -9.81),
friction beyond damping and dry friction, springs, elastic joints, drives coupled to several joints. Rotor
inertia stands in <transmission>, which simulators pass over; a comment has it on the joint's side.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from symid.formats.simulator_texts import (
    describe_coupling,
    find_plain_friction,
    list_elastic_omissions,
    list_friction_omissions,
    write_comments,
    write_decimal,
    write_decimals,
    write_quoted,
)
from symid.robot.axis_frames import to_floats
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import Placement
from symid.robot.inertia import move_parameters

__all__ = ["list_urdf_omissions", "write_inertial", "write_urdf"]

_GRAVITY = (0.0, 0.0, -9.81)
_BASE = "base"
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def write_urdf(
    robot: Robot, parameters: Sequence[Sequence[float]] | None = None, *, comments: Sequence[str] = ()
) -> str:
    """Return the URDF of `robot`.

    Args:
        robot: the robot.
        parameters: (n, 10) XX XY XZ YY YZ ZZ MX MY MZ M of each joint's link about its frame's origin, in
            place of `Joint.inertial`.
        comments: texts for the head of the file.
    """
    values = [joint.inertial for joint in robot.joints] if parameters is None else list(parameters)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={write_quoted(robot.name)}>"]
    symbols = [f"{name} = {write_decimal(value)} m" for name, value in robot.symbols]
    lines += write_comments([*comments, *symbols, *list_urdf_omissions(robot)])
    lines.append(f'  <link name="{_BASE}"/>')
    for joint, inertial in zip(robot.joints, values, strict=True):
        lines += _write_link(joint, inertial)
        lines += _write_joint(robot, joint)
    for joint in robot.joints:
        lines += _write_transmission(joint)
    return "\n".join((*lines, "</robot>", ""))


def list_urdf_omissions(robot: Robot) -> tuple[str, ...]:
    """Return what a URDF has no words for, or simulators no eye for; the file has it in comments."""
    return tuple(_find_omissions(robot))


def _find_omissions(robot: Robot) -> Iterator[str]:
    gravity = tuple(value.to_float(dict(robot.symbols)) for value in robot.gravity)
    if gravity != _GRAVITY:
        yield f"gravity of the model: {write_decimals(gravity)} m/s^2 in the frame of the link {_BASE}"
    for joint in robot.joints:
        yield from list_friction_omissions(f"joint {joint.name}", joint.friction)
        if joint.drive.rotor_inertia:
            text = f"joint {joint.name}: rotor inertia {joint.drive.rotor_inertia} on the joint's side"
            yield f"{text}, which simulators call armature; they do not read <motorInertia>"
        if joint.spring is not None:
            yield f"joint {joint.name}: a spring, {joint.spring.stiffness} at rest at {joint.spring.rest}"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        yield describe_coupling(robot, coupling)


def _link(name: str) -> str:
    return write_quoted(f"{name}_link")


def _find_rpy(placement: Placement) -> tuple[float, float, float]:
    """Return roll, pitch, yaw with Rot(z, yaw) Rot(y, pitch) Rot(x, roll) = R; roll 0 where it is free."""
    r = to_floats(placement)
    across = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], across)
    if not across:
        return (0.0, pitch, math.atan2(-r[0][1], r[1][1]))
    return (math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0]))


def write_inertial(parameters: Sequence[float]) -> list[str]:
    """Return the lines of <inertial> for ten standard parameters in the frame of the link."""
    mass = float(parameters[9])
    com = [float(value) / mass for value in parameters[6:9]] if mass else [0.0, 0.0, 0.0]
    central = move_parameters(parameters, np.eye(3), -np.array(com))[:6]
    tensor = " ".join(f'{key}="{write_decimal(value)}"' for key, value in zip(_TENSOR, central, strict=True))
    return [
        "<inertial>",
        f'  <origin xyz="{write_decimals(com)}" rpy="0 0 0"/>',
        f'  <mass value="{write_decimal(mass)}"/>',
        f"  <inertia {tensor}/>",
        "</inertial>",
    ]


def _write_link(joint: Joint, inertial: Sequence[float] | None) -> Iterator[str]:
    if inertial is None:
        yield f"  <link name={_link(joint.name)}/>"
        return
    yield f"  <link name={_link(joint.name)}>"
    yield from (f"    {line}" for line in write_inertial(inertial))
    yield "  </link>"


def _write_joint(robot: Robot, joint: Joint) -> Iterator[str]:
    symbols = dict(robot.symbols)
    parent = _link(robot.joints[joint.parent].name) if joint.parent >= 0 else f'"{_BASE}"'
    xyz = [value.to_float(symbols) for value in joint.placement.translation]
    yield f'  <joint name={write_quoted(joint.name)} type="{_find_type(joint)}">'
    yield f'    <origin xyz="{write_decimals(xyz)}" rpy="{write_decimals(_find_rpy(joint.placement))}"/>'
    yield f"    <parent link={parent}/>"
    yield f"    <child link={_link(joint.name)}/>"
    yield '    <axis xyz="0 0 1"/>'
    low, high = joint.limits.position or (0.0, 0.0)
    ends = (
        ""
        if _find_type(joint) == "continuous"
        else f'lower="{write_decimal(low)}" upper="{write_decimal(high)}" '
    )
    effort, velocity = joint.limits.torque or 0.0, joint.limits.velocity or 0.0
    yield f'    <limit {ends}effort="{write_decimal(effort)}" velocity="{write_decimal(velocity)}"/>'
    friction = find_plain_friction(joint.friction)
    if friction is not None:
        damping, dry = write_decimal(friction.damping), write_decimal(friction.dry)
        yield f'    <dynamics damping="{damping}" friction="{dry}"/>'
    if joint.mimic is not None:
        master = write_quoted(robot.joints[joint.mimic.master].name)
        factor = write_decimal(float(joint.mimic.multiplier))
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
    yield f"  <transmission name={write_quoted(f'{joint.name}_transmission')}>"
    yield "    <type>transmission_interface/SimpleTransmission</type>"
    yield f"    <joint name={write_quoted(joint.name)}/>"
    yield f"    <actuator name={write_quoted(f'{joint.name}_motor')}>"
    yield f"      <mechanicalReduction>{write_decimal(drive.gear)}</mechanicalReduction>"
    if drive.rotor_inertia is not None:
        # On the motor side, as URDFs have it.
        yield f"      <motorInertia>{write_decimal(drive.rotor_inertia / drive.gear**2)}</motorInertia>"
    yield "    </actuator>"
    yield "  </transmission>"
