"""A robot as an MJCF model, the format of MuJoCo, new or with the robot's own file kept.

Each joint of a new model moves the body `<joint>_link`, whose frame is the link frame used here: the axis is
z. A rotor is `armature` (on the joint's side), a coupled drive a fixed tendon, followers are held by equality
constraints, and each joint with a coordinate has a motor: its control is a torque on the motor's side.

Supported: placements, inertial values, gravity, limits, damping and dry friction (the mean of both
directions), followers, gears, rotors, springs, couplings. Rewriting: models read as a whole.
Not supported, and written in a comment: symbols (their values are written), other friction, elastic joints,
dry friction that pushes. Left out: limits of velocity. MuJoCo needs masses.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.errors import RobotError
from symid.joint_models import FrictionValues
from symid.robot.description import Coupling, Joint, JointKind, Robot
from symid.robot.geometry import Exact, ExactVector, compute_quaternion, to_floats
from symid.robot.inertia import move_by_placement, split_body
from symid.robot.mjcf_parts import ORIENTATIONS, MjcfPart, Model, read_rotation
from symid.robot.mjcf_reader import WORLD, build_mjcf_robot, read_model
from symid.robot.toml_values import BASE, sort_notices
from symid.robot.urdf_parts import TreeJoint, XmlPart
from symid.robot.urdf_reader import DEFAULT_SNAP
from symid.robot.urdf_xml import XmlElement, parse_document
from symid.robot.xml_writers import (
    Edit,
    apply_edits,
    get_plain_friction,
    list_elastic_omissions,
    list_friction_omissions,
    locate_tag_end,
    replace_element,
    write_decimal,
    write_decimals,
    write_head,
    write_quoted,
)

_TYPES = {JointKind.REVOLUTE: "hinge", JointKind.PRISMATIC: "slide"}
# The order of MuJoCo: xx yy zz xy xz yz.
_ORDER = (0, 3, 5, 1, 2, 4)


def write_mjcf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the MJCF model of `robot`, with comments at its head."""
    symbols = dict(robot.symbols)
    gravity = write_decimals([value.to_float(symbols) for value in robot.gravity])
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<mujoco model={write_quoted(robot.name)}>",
        *write_head(robot, comments, list_mjcf_omissions(robot)),
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{gravity}"/>',
    ]
    names = [write_quoted(joint.name) for joint in robot.joints]
    tendons, followers, motors = [], [], []
    for coupling in robot.couplings:
        attributes = (f"name={write_quoted(coupling.name)}", *_list_drive(coupling))
        tendons.append(f"    <fixed {' '.join(attributes)}>")
        for index, factor in coupling.terms:
            tendons.append(f'      <joint joint={names[index]} coef="{write_decimal(float(factor))}"/>')
        tendons.append("    </fixed>")
    for name, joint in zip(names, robot.joints, strict=True):
        if joint.mimic is None:
            motor, gear = write_quoted(f"{joint.name}_motor"), write_decimal(joint.drive.gear)
            motors.append(f'    <motor name={motor} joint={name} gear="{gear}"/>')
        else:
            pair = f"joint1={name} joint2={names[joint.mimic.master]}"
            multiple = write_decimal(float(joint.mimic.multiplier))
            followers.append(f'    <joint {pair} polycoef="0 {multiple} 0 0 0"/>')
    bodies = list(_write_bodies(robot))
    sections = {"worldbody": bodies, "tendon": tendons, "equality": followers, "actuator": motors}
    for tag, inner in sections.items():
        lines += [f"  <{tag}>", *inner, f"  </{tag}>"] if inner else []
    return "\n".join((*lines, "</mujoco>", ""))


def list_mjcf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what an MJCF model cannot hold; the file has it in comments."""
    for joint in robot.joints:
        owner = f"joint {joint.name}"
        yield from _list_mjcf_friction_omissions(owner, joint.friction)
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        yield from _list_mjcf_friction_omissions(f"coupled drive {coupling.name}", coupling.friction)


def _list_mjcf_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    yield from list_friction_omissions(owner, friction)
    plain = get_plain_friction(friction)
    if plain is not None and plain[1] < 0:
        yield f"{owner}: dry friction {write_decimal(plain[1])}, which drives instead of braking"


def _write_bodies(robot: Robot) -> Iterator[str]:
    """Yield the bodies, each with all that hangs on it."""
    symbols = dict(robot.symbols)
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
        position = write_decimals([value.to_float(symbols) for value in joint.placement.translation])
        entries = [entry.to_float() for entry in compute_quaternion(joint.placement.rotation)]
        turned = write_decimals([entry / math.hypot(*entries) for entry in entries])
        yield f'{space}<body name={write_quoted(f"{joint.name}_link")} pos="{position}" quat="{turned}">'
        if joint.inertial is not None and joint.inertial[9]:
            mass, com, central = split_body(joint.inertial)
            place = f'pos="{write_decimals(com)}" mass="{write_decimal(mass)}"'
            tensor = write_decimals([central[k] for k in _ORDER])
            yield f'{space}  <inertial {place} fullinertia="{tensor}"/>'
        attributes = [f'name={write_quoted(joint.name)} type="{_TYPES[joint.kind]}" axis="0 0 1"']
        if joint.limits.position is not None:
            attributes.append(f'range="{write_decimals(joint.limits.position)}"')
        if (torque := joint.limits.torque) is not None:
            attributes.append(f'actuatorfrcrange="{write_decimals((-torque, torque))}"')
        attributes += _list_drive(joint)
        if joint.spring is not None and joint.spring.stiffness is not None:
            attributes.append(f'stiffness="{write_decimal(joint.spring.stiffness)}"')
            attributes.append(f'springref="{write_decimal(joint.spring.rest or 0.0)}"')
        yield f"{space}  <joint {' '.join(attributes)}/>"
        waiting.append((-1, space))
        waiting += [(child, f"{space}  ") for child in reversed(children.get(index, []))]


def _list_drive(owner: Joint | Coupling) -> Iterator[str]:
    """Yield the attributes that joints and tendons have in common."""
    if rotor := (owner.drive if isinstance(owner, Joint) else owner).rotor_inertia:
        yield f'armature="{write_decimal(rotor)}"'
    if plain := get_plain_friction(owner.friction):
        yield f'damping="{write_decimal(plain[0])}"'
        if plain[1] > 0:
            yield f'frictionloss="{write_decimal(plain[1])}"'


_ROUNDED = 1e-14
_NOTHING = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


def rewrite_mjcf(text: str, robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the MJCF `text`, which `robot` was read from, with its inertias, friction, rotors, springs.

    All else stays, letter by letter; `comments` go to the head. The values of a moving body hold for it and
    the bodies that are part of it together; theirs become zero. Where the file has inertias come from geoms
    alone, they come from <inertial> now.

    Raises:
        RobotError: the text is no MJCF, or the values have no place in it: an included file holds what would
            change, or a link between two joints of one body got a mass.
    """
    document = parse_document(text, robot.path)
    before = {joint.name: joint for joint in build_mjcf_robot(document, None, None, DEFAULT_SNAP).joints}
    document = parse_document(text, robot.path)
    model = read_model(document)
    reading = model.reading
    joints = {joint.name: joint for joint in robot.joints}
    # The reader gives another name to a joint that is called as the base of robot files is.
    strangers = [joint for joint in robot.joints if joint.name not in reading.joints]
    if strangers and BASE in reading.joints:
        joints[BASE] = strangers[0]
        before[BASE] = before.get(strangers[0].name, strangers[0])
    edits = list(_edit_bodies(model, joints))
    edits += _edit_compiler(model) if edits else ()
    for name in reading.joints:
        if name in joints:
            values = _list_values(model, joints[name], reading.joints[name], before.get(name))
            edits += _edit_attributes(model.parts["joint", name], values)
    for coupling in robot.couplings:
        edits += _edit_attributes(model.parts["tendon", coupling.name], _list_mechanics(coupling))
    if reading.errors:
        raise RobotError(*sort_notices(reading.errors))
    return apply_edits(document, edits, [*comments, *list_mjcf_omissions(robot)])


def _list_mechanics(owner: Joint | Coupling) -> dict[str, float]:
    """Return the values of the attributes that joints and tendons have in common, those that are known."""
    rotor = (owner.drive if isinstance(owner, Joint) else owner).rotor_inertia
    values = {} if rotor is None else {"armature": rotor}
    if plain := get_plain_friction(owner.friction):
        values |= {"damping": plain[0], "frictionloss": max(plain[1], 0.0)}
    return values


def _list_values(model: Model, joint: Joint, tree: TreeJoint, before: Joint | None) -> dict[str, float]:
    """Return the values of a joint's attributes."""
    values, spring, old = _list_mechanics(joint), joint.spring, before.spring if before else None
    if spring is None or spring.stiffness is None or old is None or tree.spring is None:
        return values
    # A follower's spring rests elsewhere in its own coordinate.
    rest = (tree.spring.rest or 0.0) + (spring.rest or 0.0) - (old.rest or 0.0)
    in_degrees = model.settings.degrees and joint.kind is JointKind.REVOLUTE
    return values | {"stiffness": spring.stiffness, "springref": math.degrees(rest) if in_degrees else rest}


def _check_file(own: MjcfPart) -> bool:
    """Refuse to change what stands in an included file."""
    inside = own.part.element.file == own.model.reading.document.file
    if not inside:
        text = "its values stand in an included file, which is not written; put the model into one file"
        own.part.refuse("robot.mjcf-include", text)
    return inside


def _edit_compiler(model: Model) -> Iterator[Edit]:
    """Yield what lets the new <inertial> hold where the file has inertias come from geoms alone."""
    for element in model.reading.document.root.find_all("compiler"):
        part = XmlPart(reading=model.reading, owner="compiler", element=element)
        own = MjcfPart(model=model, part=part)
        if element.attributes.get("inertiafromgeom") == "true" and _check_file(own):
            yield from _write_attributes(own, {"inertiafromgeom": "auto"})


def _edit_bodies(model: Model, joints: Mapping[str, Joint]) -> Iterator[Edit]:
    """Yield the edits of inertias: those of moving bodies, and zero for bodies that are parts of them."""
    reading = model.reading
    above = {tree.child: tree for tree in reading.joints.values()}
    # Whether a body hangs on one that a joint moves; parents stand before children.
    carried = {WORLD: False}
    for name, link in reading.links.items():
        if name == WORLD:
            continue
        tree = above[name]
        joint = joints.get(tree.name)
        carried[name] = joint is not None or carried[tree.parent]
        if link.between:
            if joint is not None and joint.inertial is not None and any(joint.inertial):
                text = "the link between it and the next joint of its body got a mass, which has no place "
                text += "in this file; export a robot file (-o new.toml), and from that a new model"
                tree.part.refuse("robot.mjcf-massless", text)
            continue
        body = model.parts["body", name]
        old = body.part.element.find("inertial")
        if joint is not None and joint.inertial is not None:
            # In the frame that the file gives to the body.
            values = move_by_placement(joint.inertial, joint.frame, inverse=True)
            ignored = old is not None and model.settings.inference == "true"
            if (ignored or not _is_same(values, link.inertial)) and _check_file(body):
                yield from _edit_inertial(body, old, values)
        elif joint is None and carried[name] and link.mass and _check_file(body):
            yield replace_element(reading.document, body.part.element, old, [_NOTHING])


def _is_same(values: Sequence[float], stated: Sequence[float] | None) -> bool:
    """Return whether values differ by the rounding of a change of frames and back."""
    if stated is None:
        return False
    return max(abs(a - b) for a, b in zip(values, stated, strict=True)) <= _ROUNDED * max(map(abs, stated))


def _edit_inertial(body: MjcfPart, old: XmlElement | None, values: Sequence[float]) -> Iterator[Edit]:
    """Yield the edits of <inertial>: in its own attributes where they can hold the values, else a new one."""
    mass, com, central = split_body(values)
    numbers = {"pos": write_decimals(com), "mass": write_decimal(mass)}
    names = set(old.attributes) if old is not None else set[str]()
    turned = [name for name in ORIENTATIONS if name in names]
    tensor = write_decimals([central[k] for k in _ORDER])
    if old is not None and "fullinertia" in names:
        yield from _write_attributes(_enter(body, old), {**numbers, "fullinertia": tensor})
    elif old is not None and "diaginertia" in names and turned == ["quat"]:
        moments, quaternion = _find_axes(central, np.array(to_floats(read_rotation(_enter(body, old)))))
        more = {"diaginertia": write_decimals(moments), "quat": write_decimals(quaternion)}
        yield from _write_attributes(_enter(body, old), {**numbers, **more})
    elif old is not None and "diaginertia" in names and not turned and _is_diagonal(central):
        moments = [central[k] for k in (0, 3, 5)]
        yield from _write_attributes(_enter(body, old), {**numbers, "diaginertia": write_decimals(moments)})
    else:
        place = " ".join(f'{name}="{value}"' for name, value in numbers.items())
        line = f'<inertial {place} fullinertia="{tensor}"/>' if mass else _NOTHING
        yield replace_element(body.model.reading.document, body.part.element, old, [line])


def _is_diagonal(central: Sequence[float]) -> bool:
    """Return whether an inertia (6,) xx xy xz yy yz zz has no more than rounding beside its diagonal."""
    return max(abs(central[k]) for k in (1, 2, 4)) <= _ROUNDED * max(map(abs, central))


def _enter(body: MjcfPart, element: XmlElement) -> MjcfPart:
    return MjcfPart(model=body.model, part=body.part.enter(element))


def _find_axes(central: Sequence[float], near: FloatArray) -> tuple[list[float], list[float]]:
    """Return principal moments and a quaternion of the principal axes that are most like those of `near`.

    Args:
        central: (6,) xx xy xz yy yz zz about the centre of mass, kg m^2.
        near: (3, 3) rotation.
    """
    xx, xy, xz, yy, yz, zz = central
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    likeness = np.abs(near.T @ axes)
    order = max(itertools.permutations(range(3)), key=lambda p: sum(likeness[k, p[k]] for k in range(3)))
    axes = axes[:, list(order)]
    axes *= np.where(np.sum(near * axes, axis=0) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1.0
    rows: list[ExactVector] = [
        (Exact.of(float(x)), Exact.of(float(y)), Exact.of(float(z))) for x, y, z in axes
    ]
    entries = [entry.to_float() for entry in compute_quaternion((rows[0], rows[1], rows[2]))]
    return [float(moments[k]) for k in order], [entry / math.hypot(*entries) for entry in entries]


def _edit_attributes(own: MjcfPart, values: Mapping[str, float]) -> Iterator[Edit]:
    """Yield the edits that give an element these values, where it and its class do not state them already."""
    new = {name: value for name, value in values.items() if (own.read_number(name) or 0.0) != value}
    if new and _check_file(own):
        yield from _write_attributes(own, {name: write_decimal(value) for name, value in new.items()})


def _write_attributes(own: MjcfPart, values: Mapping[str, str]) -> Iterator[Edit]:
    """Yield the edits that put texts into the attributes of an element, new ones behind all others."""
    document, element = own.model.reading.document, own.part.element
    added = ""
    for name, value in values.items():
        if match := document.match_attribute(element, name):
            yield match.start(2) + 1, match.end(2) - 1, value
        else:
            added += f' {name}="{value}"'
    end = locate_tag_end(document.source, element.offset) - 1
    tag = document.source[element.offset : end].rstrip(b"/").rstrip()
    if added:
        yield element.offset + len(tag), element.offset + len(tag), added
