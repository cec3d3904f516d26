"""A robot as USD text (.usda) with the schemas of UsdPhysics and PhysX, for Isaac Sim.

Each joint moves the prim `<joint>_link`, whose frame is the link frame used here: the axis is z. All links
stand side by side below the robot, at their places with all joints at zero; the base is fixed to the world.
Masses, frames and limits are UsdPhysics (OpenUSD 25.5 and 26.11, physicsSchema). A rotor is
`physxJointAxis:<axis>:armature` on the joint's side, and, for older PhysX, `physxJoint:armature`.

Friction is `physxJointAxis:<axis>:` staticFrictionEffort and dynamicFrictionEffort (N m, N) and
viscousFrictionCoefficient, which for turning joints is per degree, as PhysX multiplies it by 180 / pi (Omni
Physics "Physx Joint Schema", ovphysx 0.7.0 "PhysxJointAxisAPI"); PhysX has them from 5.6 on. Before, a joint
had a coefficient without a unit (`physxJoint:jointFriction`), times the load of the joint, which no friction
in N m is; it is not written. Angles of limits, springs and velocities are in degrees. Followers have
`PhysxMimicJointAPI`: q + gearing q_reference + offset = 0 (createMimicJoint of PhysX 5.6); PhysX enforces it
between turning joints with limits (NVIDIA SimReady requirements DJ.004 and DJ.007, 2026).

Supported: placements, bodies, limits, gravity, damping, dry and static friction (the mean of both
directions), rotors, springs as drives, followers that turn. Numbers have all digits; programs read most of
them as single precision. Not supported, and written as comments: symbols (their values are written), other
friction, elastic joints, gears, coupled drives, other followers, torque limits of joints with a spring.
"""

import math
import re
from collections.abc import Iterator, Sequence

import numpy as np

from symid.joint_models import name_values
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import IDENTITY, Placement, compose_placements, compute_quaternion
from symid.robot.inertia import split_body
from symid.robot.toml_values import BASE
from symid.robot.xml_writers import (
    get_plain_friction,
    list_drive_omissions,
    list_elastic_omissions,
    list_friction_omissions,
)


def write_usd(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the USD text of `robot`, with comments at its head."""
    names = _choose_names(robot)
    symbols = dict(robot.symbols)
    gravity = [value.to_float(symbols) for value in robot.gravity]
    size = math.hypot(*gravity)
    root = names[-1]
    head = [
        *comments,
        *(f"{name} = {value!r} m" for name, value in robot.symbols),
        *list_usd_omissions(robot),
    ]
    lines = [
        "#usda 1.0",
        *(f"# {re.sub(r'[^ -~]', ' ', text)}" for text in head),
        f'(\n    defaultPrim = "{root}"',
        '    kilogramsPerUnit = 1\n    metersPerUnit = 1\n    upAxis = "Z"\n)',
        'def PhysicsScene "physicsScene"\n{',
        f"    vector3f physics:gravityDirection = {_write([g / (size or 1.0) for g in gravity])}",
        f"    float physics:gravityMagnitude = {_write(size)}\n}}",
        f'def Xform "{root}" (\n    prepend apiSchemas = ["PhysicsArticulationRootAPI"]\n)\n{{',
    ]
    # The base is fixed, so that its body counts nowhere; without one, programs would make one up.
    lines += _write_body(BASE, IDENTITY, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), symbols)
    places: list[Placement] = []
    for joint in robot.joints:
        before = places[joint.parent] if joint.parent >= 0 else IDENTITY
        places.append(compose_placements(before, joint.placement))
    for name, joint, place in zip(names, robot.joints, places, strict=False):
        lines += _write_body(f"{name}_link", place, joint.inertial, symbols)
    lines.append(f'    def PhysicsFixedJoint "{BASE}_joint"\n    {{')
    lines.append(f"        rel physics:body1 = </{root}/{BASE}>\n    }}")
    for name, joint in zip(names, robot.joints, strict=False):
        bodies = (f"{names[joint.parent]}_link" if joint.parent >= 0 else BASE, f"{name}_link")
        follow = joint.mimic if joint.mimic and _is_held(robot, joint) else None
        # q + gearing times that of the reference joint is zero.
        mimic = (
            ()
            if follow is None
            else (
                f"float physxMimicJoint:rotZ:gearing = {_write(-float(follow.multiplier))}",
                "float physxMimicJoint:rotZ:offset = 0.0",
                f"rel physxMimicJoint:rotZ:referenceJoint = </{root}/{names[follow.master]}>",
            )
        )
        lines += _write_joint(name, joint, [f"</{root}/{body}>" for body in bodies], symbols, mimic)
    return "\n".join((*lines, "}", ""))


def list_usd_omissions(robot: Robot) -> Iterator[str]:
    """Yield what a USD cannot hold, or PhysX does not read; the file has it in comments."""
    for name, joint in zip(_choose_names(robot), robot.joints, strict=False):
        owner = f"joint {joint.name}"
        if name != joint.name:
            text = "since names of USD have letters, digits and _ only, and no two prims the same"
            yield f"{owner}: is called {name}, {text}"
        yield from list_friction_omissions(owner, joint.friction)
        if joint.drive.gear != 1.0:
            yield f"{owner}: gear {joint.drive.gear}; torques are those on the joint's side"
        if joint.mimic is not None and not _is_held(robot, joint):
            master = robot.joints[joint.mimic.master].name
            text = (
                f"{owner}: follows {float(joint.mimic.multiplier):g} times joint {master}, and moves freely"
            )
            yield f"{text}; PhysX holds only turning joints that follow turning ones, both with limits"
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        elif joint.spring is not None and joint.limits.torque is not None:
            yield f"{owner}: a torque limit of {joint.limits.torque}, which would limit the spring as well"
        if joint.inertial is not None and not min(_list_moments(joint.inertial)):
            yield f"{owner}: its link has no mass or no inertia; programs put values of their own there"
        yield from list_elastic_omissions(joint)
    frictions = [(joint.name, get_plain_friction(joint.friction)) for joint in robot.joints]
    if braked := [name for name, plain in frictions if plain is not None and max(plain) > 0]:
        yield f"friction of {', '.join(braked)}: read by PhysX 5.6 or later only, and by no other program"
    yield from list_drive_omissions(robot)


def _is_held(robot: Robot, joint: Joint) -> bool:
    """Return whether PhysX holds a follower: both joints turn, and have limits."""
    pair = (joint, robot.joints[joint.mimic.master if joint.mimic else 0])
    return all(one.kind is JointKind.REVOLUTE and one.limits.position is not None for one in pair)


def _choose_names(robot: Robot) -> list[str]:
    """Return names of prims for the joints, and last that of the robot; `<joint>_link` is free as well."""
    names, taken = list[str](), {BASE, f"{BASE}_joint", "physicsScene"}
    for text in (*(joint.name for joint in robot.joints), robot.name):
        name = re.sub(r"[^A-Za-z0-9_]", "_", text)
        name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
        while not taken.isdisjoint((name, f"{name}_link")):
            name += "_"
        names.append(name)
        taken |= {name, f"{name}_link"}
    return names


def _write(values: float | Sequence[float]) -> str:
    """Return a number, or several in parentheses, with all digits."""
    if isinstance(values, int | float):
        return repr(float(values) + 0.0)
    return f"({', '.join(repr(float(value) + 0.0) for value in values)})"


def _write_quaternion(place: Placement) -> str:
    """Return w, x, y, z."""
    entries = [entry.to_float() for entry in compute_quaternion(place.rotation)]
    return _write([entry / math.hypot(*entries) for entry in entries])


def _list_moments(parameters: Sequence[float]) -> list[float]:
    """Return mass and principal moments of a body."""
    return [float(parameters[9]), *_split_moments(parameters)[0]]


def _split_moments(parameters: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return the principal moments about the centre of mass, and their axes as w, x, y, z."""
    xx, xy, xz, yy, yz, zz = split_body(parameters)[2]
    if not (xy or xz or yz):
        return [xx, yy, zz], [1.0, 0.0, 0.0, 0.0]
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    # The eigenvector of K at its largest eigenvalue is the quaternion (Bar-Itzhack, JGCD 23 (2000) 1085).
    (a, b, c), (d, e, f), (g, h, i) = axes
    K = [[a - e - i, d + b, g + c, h - f], [0, e - a - i, h + f, c - g], [0, 0, i - a - e, d - b]]
    K.append([0, 0, 0, a + e + i])
    x, y, z, w = np.linalg.eigh(np.array(K), UPLO="U")[1][:, 3].tolist()
    return moments.tolist(), [w, x, y, z] if w >= 0 else [-w, -x, -y, -z]


def _write_body(
    name: str, place: Placement, parameters: Sequence[float] | None, symbols: dict[str, float]
) -> Iterator[str]:
    """Yield a rigid body at its place in the frame of the base."""
    apis = '"PhysicsRigidBodyAPI"' + (', "PhysicsMassAPI"' if parameters is not None else "")
    yield f'    def Xform "{name}" (\n        prepend apiSchemas = [{apis}]\n    )\n    {{'
    yield f"        double3 xformOp:translate = {_write([p.to_float(symbols) for p in place.translation])}"
    yield f"        quatd xformOp:orient = {_write_quaternion(place)}"
    yield '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
    if parameters is not None:
        mass, com, _ = split_body(parameters)
        moments, axes = _split_moments(parameters)
        yield f"        float physics:mass = {_write(mass)}"
        yield f"        point3f physics:centerOfMass = {_write(com)}"
        yield f"        float3 physics:diagonalInertia = {_write(moments)}"
        yield f"        quatf physics:principalAxes = {_write(axes)}"
    yield "    }"


def _write_joint(
    name: str, joint: Joint, bodies: Sequence[str], symbols: dict[str, float], mimic: Sequence[str]
) -> Iterator[str]:
    turns = joint.kind is JointKind.REVOLUTE
    axis = "angular" if turns else "linear"
    degrees = 180.0 / math.pi if turns else 1.0
    drive = list(_list_drive(joint, f"drive:{axis}:physics", degrees))
    apis = ["PhysxJointAPI", f"PhysxJointAxisAPI:{axis}"] + [f"PhysicsDriveAPI:{axis}"] * bool(drive)
    apis += ["PhysxMimicJointAPI:rotZ"] * bool(mimic)
    listed = ", ".join(f'"{api}"' for api in apis)
    kind = "PhysicsRevoluteJoint" if turns else "PhysicsPrismaticJoint"
    yield f'    def {kind} "{name}" (\n        prepend apiSchemas = [{listed}]\n    )\n    {{'
    yield f"        rel physics:body0 = {bodies[0]}\n        rel physics:body1 = {bodies[1]}"
    start = [value.to_float(symbols) for value in joint.placement.translation]
    yield f"        point3f physics:localPos0 = {_write(start)}"
    yield f"        quatf physics:localRot0 = {_write_quaternion(joint.placement)}"
    yield "        point3f physics:localPos1 = (0.0, 0.0, 0.0)"
    yield "        quatf physics:localRot1 = (1.0, 0.0, 0.0, 0.0)"
    yield '        uniform token physics:axis = "Z"'
    if joint.limits.position is not None:
        for end, value in zip(("lower", "upper"), joint.limits.position, strict=True):
            yield f"        float physics:{end}Limit = {_write(value * degrees)}"
    yield from (f"        {line}" for line in (*drive, *mimic))
    for key, value in _list_axis_values(joint, degrees):
        yield f"        float physxJointAxis:{axis}:{key} = {_write(value)}"
    if joint.drive.rotor_inertia:
        yield f"        float physxJoint:armature = {_write(joint.drive.rotor_inertia)}"
    yield "    }"


def _list_drive(joint: Joint, prefix: str, degrees: float) -> Iterator[str]:
    """Yield the attributes of a drive: a spring, or a limit of the torque."""
    if joint.spring is not None and joint.spring.stiffness is not None:
        yield f'uniform token {prefix}:type = "force"'
        yield f"float {prefix}:stiffness = {_write(joint.spring.stiffness / degrees)}"
        yield f"float {prefix}:targetPosition = {_write((joint.spring.rest or 0.0) * degrees)}"
    elif joint.limits.torque is not None:
        yield f'uniform token {prefix}:type = "force"'
        yield f"float {prefix}:maxForce = {_write(joint.limits.torque)}"


def _list_axis_values(joint: Joint, degrees: float) -> Iterator[tuple[str, float]]:
    """Yield rotor, largest velocity and friction."""
    if joint.drive.rotor_inertia:
        yield "armature", joint.drive.rotor_inertia
    if joint.limits.velocity is not None:
        yield "maxJointVelocity", joint.limits.velocity * degrees
    if (plain := get_plain_friction(joint.friction)) is None:
        return
    named = name_values(joint.friction)
    extra = [named[key] for key in ("Fe", "Fep", "Fen") if key in named]
    damping, dry = plain
    if dry:
        yield "staticFrictionEffort", dry + max(sum(extra) / max(len(extra), 1), 0.0)
        yield "dynamicFrictionEffort", dry
    if damping:
        yield "viscousFrictionCoefficient", damping / degrees
