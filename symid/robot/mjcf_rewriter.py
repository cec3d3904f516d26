"""An MJCF model with other values: all else stays, byte by byte.

Text of a model, the robot that was read from it with other values -> the text with numbers changed, and with
elements and attributes that it lacked. What a body carries by joints that do not move in the robot shares the
change as links of URDFs do (`urdf_rewriter`). Values that did not change stay as they are written.

Supported: models that are read as a whole or cut; inertias in `fullinertia`, or in `diaginertia` with `quat`,
else a new <inertial>; damping, frictionloss, armature, stiffness, springref, those of fixed tendons too.
Not supported: values that stand in included files; a mass between two joints of one body; friction beyond
damping and dry friction, which `list_rewritten_mjcf_omissions` names.
"""

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint_models import NO_FRICTION
from symid.robot.description import Coupling, Joint, JointKind, Robot, Spring
from symid.robot.geometry import Exact, ExactVector, compute_quaternion, to_floats
from symid.robot.inertia import is_same_body, split_body
from symid.robot.mjcf_parts import ORIENTATIONS, MjcfPart, Model, read_rotation
from symid.robot.mjcf_reader import assemble_model, read_model
from symid.robot.toml_values import sort_notices
from symid.robot.urdf_parts import TreeJoint, XmlPart
from symid.robot.urdf_rewriter import RewrittenFile, distribute, gather_members, match_names, move_to_link
from symid.robot.urdf_xml import Edit, XmlElement, apply_edits, insert_element, parse_document, set_values
from symid.robot.xml_writers import (
    get_plain_friction,
    list_drive_omissions,
    list_elastic_omissions,
    list_friction_omissions,
    write_decimal,
    write_decimals,
)

# The order of MuJoCo: xx yy zz xy xz yz.
_ORDER = (0, 3, 5, 1, 2, 4)
_ROUNDED = 1e-14
# Of a number: what is left of a change where it was only written with other digits.
_SAME = 1e-12
_NOTHING = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


def rewrite_mjcf(text: str, robot: Robot) -> RewrittenFile:
    """Return the MJCF `text`, which `robot` was read from, with its inertias, friction, rotors, springs.

    `robot.made_from` says how it was read. Where the file has inertias come from geoms alone, they come from
    <inertial> now.

    Raises:
        RobotError: the text is no MJCF, or the values have no place in it.
    """
    if (made := robot.made_from) is None:
        _refuse(robot, f"robot {robot.name!r} was made from no model; write a new one (-o FILE)")
    model = read_model(parse_document(text, robot.path), made.snap)
    reading = model.reading
    for name, entry in reading.joints.items():
        if entry.moves and entry.spring is None:
            # A spring that does nothing shows where the joint's own coordinate is zero.
            reading.joints[name] = replace(entry, spring=Spring(stiffness=0.0, rest=0.0))
    before = assemble_model(model, made.base, made.tip)
    drives = _match_couplings(robot, before)
    below: dict[str, list[TreeJoint]] = {}
    for entry in reading.joints.values():
        below.setdefault(entry.parent, []).append(entry)
    names = match_names(robot, reading)
    edits: list[Edit] = []
    shared: dict[str, tuple[str, ...]] = {}
    bodies: set[str] = set()
    pairs = list(zip(robot.joints, before.joints, strict=True))
    changes = [
        new.inertial is not None and not is_same_body(new.inertial, old.inertial) for new, old in pairs
    ]
    geoms_alone = model.settings.inference == "true" and any(changes)
    for (joint, old), changed in zip(pairs, changes, strict=True):
        entry = reading.joints[names[joint.name]]
        edits += _edit_attributes(model.parts["joint", entry.name], _list_values(model, joint, entry, old))
        if joint.inertial is None or not (geoms_alone or changed):
            continue
        members = gather_members(reading, below, entry.child, set(names.values()))
        if members[0].link.between:
            _check_between(joint, entry)
            continue
        spread = distribute(move_to_link(joint, made.tip, members), members)
        for member, own in spread:
            edits += _edit_inertial(model.parts["body", member.link.name], own)
        bodies |= {member.link.name for member, _ in spread}
        carried = [member.link.name for member, _ in spread if member is not members[0]]
        shared |= {entry.child: tuple(carried)} if carried else {}
    for coupling, drive in drives:
        edits += _edit_attributes(model.parts["tendon", coupling.name], _list_mechanics(coupling, drive))
    edits += _edit_compiler(model) if geoms_alone else ()
    written = apply_edits(reading.document, edits)
    if geoms_alone and not reading.errors:
        _check_unused(model, written, bodies)
    if reading.errors:
        raise RobotError(*sort_notices(reading.errors))
    return RewrittenFile(text=written, shared=shared)


def list_rewritten_mjcf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what `rewrite_mjcf` leaves out, which no comment of the file says."""
    for joint in robot.joints:
        yield from list_friction_omissions(f"joint {joint.name}", joint.friction)
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"joint {joint.name}: a spring of unknown stiffness"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        yield from list_friction_omissions(f"coupled drive {coupling.name}", coupling.friction)


def _refuse(robot: Robot, text: str) -> NoReturn:
    raise RobotError(Notice(code="robot.mjcf-unsupported", text=text, file=robot.path))


def _match_couplings(robot: Robot, before: Robot) -> list[tuple[Coupling, Coupling]]:
    """Return the robot's coupled drives, each with that of the file."""
    own, file = (
        {(entry.name, tuple(sorted(entry.terms))): entry for entry in one.couplings}
        for one in (robot, before)
    )
    if own.keys() != file.keys():
        listed = ("; ".join(list_drive_omissions(one)) or "none" for one in (robot, before))
        text = "the coupled drives are other ones than in the model: {}; in the model: {}; "
        hint = "give them the names and joints of the model's tendons, or write a new model (-o FILE)"
        _refuse(robot, text.format(*listed) + hint)
    return [(entry, file[key]) for key, entry in own.items()]


def _check_between(joint: Joint, tree: TreeJoint) -> None:
    """Refuse a link with mass between two joints of a body."""
    if any(joint.inertial or ()):
        text = (
            "the link between it and the next joint of its body got a mass, which has no place in this file"
        )
        tree.part.refuse("robot.mjcf-massless", f"{text}; write a new one (-o FILE)")


def _check_unused(model: Model, written: str, changed: Collection[str]) -> None:
    """Refuse a new text in which other bodies than those that `changed` have other inertias."""
    reading = model.reading
    links = read_model(parse_document(written, reading.document.file), reading.snap).reading.links
    for name, link in reading.links.items():
        if name not in changed and not is_same_body(links[name].inertial, link.inertial):
            text = 'its <inertial>, which inertiafromgeom="true" leaves unused, would hold in the new file'
            link.part.refuse("robot.mjcf-unsupported", f"{text}; remove this <inertial>")


def _list_mechanics(new: Joint | Coupling, old: Joint | Coupling) -> dict[str, float]:
    """Return the values of attributes that joints and tendons have in common, those that are known.

    What a robot has not, as friction of the law none, is zero; friction that is that of `old` is left out.
    """
    rotor = new.drive if isinstance(new, Joint) else new
    known = not rotor.has_rotor or rotor.rotor_inertia is not None
    values = {"armature": rotor.rotor_inertia or 0.0} if known else {}
    plain = (0.0, 0.0) if new.friction.law == NO_FRICTION else get_plain_friction(new.friction)
    numbers = [one.friction.values or () for one in (new, old)]
    same = new.friction.law == old.friction.law and all(map(_is_same, *numbers))
    return values if plain is None or same else {**values, "damping": plain[0], "frictionloss": plain[1]}


def _is_same(new: float, old: float) -> bool:
    """Return whether numbers differ by no more than rounding."""
    return math.isclose(new, old, rel_tol=_SAME)


def _list_values(model: Model, joint: Joint, tree: TreeJoint, old: Joint) -> dict[str, float]:
    """Return the values of a joint's attributes."""
    values, spring = _list_mechanics(joint, old), joint.spring or Spring(stiffness=0.0)
    if spring.stiffness is None or old.spring is None or tree.spring is None:
        return values
    values["stiffness"] = spring.stiffness
    if spring.stiffness:
        # A follower's spring rests elsewhere in its own coordinate.
        new, before = spring.rest or 0.0, old.spring.rest or 0.0
        rest = (tree.spring.rest or 0.0) + (0.0 if _is_same(new, before) else new - before)
        in_degrees = model.settings.degrees and joint.kind is JointKind.REVOLUTE
        values["springref"] = math.degrees(rest) if in_degrees else rest
    return values


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
        if element.attributes.get("inertiafromgeom") == "true":
            yield from _write_attributes(own, {"inertiafromgeom": "auto"})


def _edit_inertial(body: MjcfPart, values: Sequence[float]) -> Iterator[Edit]:
    """Yield the edits of <inertial>: in its own attributes where they can hold the values, else a new one."""
    old = body.part.element.find("inertial")
    if not _check_file(body if old is None else _enter(body, old)):
        return
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
        document = body.model.reading.document
        if old is None:
            yield insert_element(document, body.part.element, [line])
        else:
            # What stands inside, as comments, stays.
            inside, _ = document.locate_inside(old)
            closed = document.source[inside - 2 : inside] == b"/>"
            yield old.offset, inside, line if closed else f"{line[:-2]}>"


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
    new = {name: value for name, value in values.items() if not _is_same(own.read_linear(name), value)}
    if new:
        yield from _write_attributes(own, {name: write_decimal(value) for name, value in new.items()})


def _write_attributes(own: MjcfPart, values: Mapping[str, str]) -> Iterator[Edit]:
    if _check_file(own):
        yield from set_values(own.model.reading.document, own.part.element, values)
