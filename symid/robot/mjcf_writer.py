"""A robot as an MJCF model, the format of MuJoCo.

A robot -> the text. Each joint
moves the body `<joint>_link`, whose frame is the link frame used here: the axis is z. Numbers have all
digits of a double; angles are in rad. Inertia is about the centre of mass. Friction becomes `damping` and
`frictionloss`, a rotor `armature` (on the joint's side), a spring `stiffness` and `springref`; a drive that
is coupled to several joints is a fixed tendon with the same attributes; followers are held by equality
constraints. Each joint with a coordinate has a motor, `<joint>_motor`, whose control is a torque on the
motor's side: the gear stands in the file.

Supported: placements, inertial values, gravity, limits of position and torque, friction that is alike in
both directions, rotors, couplings, springs, followers.
Not supported, and said in a comment: other friction, dry friction that pushes, elastic joints. Left out:
limits of velocity. There are no shapes. MuJoCo wants a mass of every link that moves.
"""

import math
from collections.abc import Iterator, Sequence

from symid.robot.description import FrictionValues, Joint, JointKind, Robot
from symid.robot.geometry import compute_quaternion
from symid.robot.inertia import split_body
from symid.robot.urdf_writer import (
    ViscousCoulomb,
    get_viscous_coulomb,
    list_elastic_omissions,
    list_friction_omissions,
    write_comments,
    write_decimal,
    write_decimals,
    write_quoted,
)

_TYPES = {JointKind.REVOLUTE: "hinge", JointKind.PRISMATIC: "slide"}
# The order of MuJoCo: xx yy zz xy xz yz.
_ORDER = (0, 3, 5, 1, 2, 4)


def write_mjcf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the MJCF model of `robot`.

    Args:
        robot: the robot.
        comments: texts for the head of the file.
    """
    symbols = dict(robot.symbols)
    gravity = write_decimals([value.to_float(symbols) for value in robot.gravity])
    lengths = [f"{name} = {write_decimal(value)} m" for name, value in robot.symbols]
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<mujoco model={write_quoted(robot.name)}>",
        *write_comments([*comments, *lengths, *list_mjcf_omissions(robot)]),
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{gravity}"/>',
        "  <worldbody>",
        *_write_bodies(robot),
        "  </worldbody>",
        *_write_couplings(robot),
        *_write_followers(robot),
        *_write_motors(robot),
        "</mujoco>",
        "",
    ]
    return "\n".join(lines)


def list_mjcf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what an MJCF model has no words for; the file has it in comments."""
    for joint in robot.joints:
        owner = f"joint {joint.name}"
        yield from _list_friction_omissions(owner, joint.friction)
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        yield from _list_friction_omissions(f"coupled drive {coupling.name}", coupling.friction)


def _list_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    yield from list_friction_omissions(owner, friction)
    plain = get_viscous_coulomb(friction)
    if plain is not None and plain.dry < 0:
        yield f"{owner}: dry friction {write_decimal(plain.dry)}, which drives instead of braking"


def _write_bodies(robot: Robot) -> Iterator[str]:
    """Yield the bodies, each with all that hangs on it."""
    children: dict[int, list[int]] = {}
    for index, joint in enumerate(robot.joints):
        children.setdefault(joint.parent, []).append(index)
    # Chains can be longer than calls can be nested, so open bodies wait in a list; -1 closes one.
    waiting = [(index, "    ") for index in reversed(children.get(-1, []))]
    while waiting:
        index, space = waiting.pop()
        if index < 0:
            yield f"{space}</body>"
            continue
        joint = robot.joints[index]
        yield f"{space}<body {_write_place(robot, joint)}>"
        yield from (f"{space}  {line}" for line in _write_contents(joint))
        waiting.append((-1, space))
        waiting += [(child, f"{space}  ") for child in reversed(children.get(index, []))]


def _write_place(robot: Robot, joint: Joint) -> str:
    symbols = dict(robot.symbols)
    position = write_decimals([value.to_float(symbols) for value in joint.placement.translation])
    entries = [entry.to_float() for entry in compute_quaternion(joint.placement.rotation)]
    length = math.hypot(*entries)
    turned = write_decimals([entry / length for entry in entries])
    return f'name={write_quoted(f"{joint.name}_link")} pos="{position}" quat="{turned}"'


def _write_contents(joint: Joint) -> Iterator[str]:
    if joint.inertial is not None and joint.inertial[9]:
        mass, com, central = split_body(joint.inertial)
        tensor = write_decimals([central[k] for k in _ORDER])
        yield (f'<inertial pos="{write_decimals(com)}" mass="{write_decimal(mass)}" fullinertia="{tensor}"/>')
    yield f"<joint {' '.join(_list_attributes(joint))}/>"


def _list_attributes(joint: Joint) -> Iterator[str]:
    yield f'name={write_quoted(joint.name)} type="{_TYPES[joint.kind]}" axis="0 0 1"'
    if joint.limits.position is not None:
        yield f'range="{write_decimals(joint.limits.position)}"'
    if joint.limits.torque is not None:
        yield f'actuatorfrcrange="{write_decimals((-joint.limits.torque, joint.limits.torque))}"'
    yield from _list_drive(joint.drive.rotor_inertia, get_viscous_coulomb(joint.friction))
    if joint.spring is not None and joint.spring.stiffness is not None:
        yield f'stiffness="{write_decimal(joint.spring.stiffness)}"'
        yield f'springref="{write_decimal(joint.spring.rest or 0.0)}"'


def _list_drive(rotor: float | None, friction: ViscousCoulomb | None) -> Iterator[str]:
    """Yield the attributes that joints and tendons have in common."""
    if rotor:
        yield f'armature="{write_decimal(rotor)}"'
    if friction is not None:
        yield f'damping="{write_decimal(friction.damping)}"'
        if friction.dry > 0:
            yield f'frictionloss="{write_decimal(friction.dry)}"'


def _write_couplings(robot: Robot) -> Iterator[str]:
    if not robot.couplings:
        return
    yield "  <tendon>"
    for coupling in robot.couplings:
        attributes = _list_drive(coupling.rotor_inertia, get_viscous_coulomb(coupling.friction))
        yield f"    <fixed {' '.join((f'name={write_quoted(coupling.name)}', *attributes))}>"
        for index, factor in coupling.terms:
            name = write_quoted(robot.joints[index].name)
            yield f'      <joint joint={name} coef="{write_decimal(float(factor))}"/>'
        yield "    </fixed>"
    yield "  </tendon>"


def _write_followers(robot: Robot) -> Iterator[str]:
    followers = [(joint, joint.mimic) for joint in robot.joints if joint.mimic is not None]
    if not followers:
        return
    yield "  <equality>"
    for joint, mimic in followers:
        pair = f"joint1={write_quoted(joint.name)} joint2={write_quoted(robot.joints[mimic.master].name)}"
        yield f'    <joint {pair} polycoef="0 {write_decimal(float(mimic.multiplier))} 0 0 0"/>'
    yield "  </equality>"


def _write_motors(robot: Robot) -> Iterator[str]:
    yield "  <actuator>"
    for joint in robot.axes:
        names = f"name={write_quoted(f'{joint.name}_motor')} joint={write_quoted(joint.name)}"
        yield f'    <motor {names} gear="{write_decimal(joint.drive.gear)}"/>'
    yield "  </actuator>"
