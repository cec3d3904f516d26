"""An MJCF model with other values: all else stays, byte by byte.

Text of a model, the robot that was read from it with other values -> the text with numbers changed, and with
elements and attributes that it lacked. What a body carries by joints that do not move in the robot shares the
change as links of URDFs do (`urdf_rewriter`). Values that did not change stay as they are written.

Supported: models that are read as a whole or cut; inertias in `fullinertia`, or in `diaginertia` with `quat`,
else a new <inertial>; damping, frictionloss, armature, stiffness, springref, those of fixed tendons too.
Not supported: values that stand in included files; a mass between two joints of one body.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symid.arrays import FloatArray
from symid.errors import RobotError
from symid.robot.description import Coupling, Joint, JointKind, Robot, SourceFile
from symid.robot.geometry import Exact, ExactVector, compute_quaternion, to_floats
from symid.robot.inertia import split_body
from symid.robot.mjcf_parts import ORIENTATIONS, MjcfPart, Model, read_rotation
from symid.robot.mjcf_reader import build_mjcf_robot, read_model
from symid.robot.toml_values import sort_notices
from symid.robot.urdf_parts import TreeJoint, XmlPart
from symid.robot.urdf_rewriter import RewrittenFile, distribute, gather_members, match_names, move_to_link
from symid.robot.urdf_xml import Edit, XmlElement, apply_edits, insert_element, parse_document, set_values
from symid.robot.xml_writers import get_plain_friction, write_decimal, write_decimals

# The order of MuJoCo: xx yy zz xy xz yz.
_ORDER = (0, 3, 5, 1, 2, 4)
_ROUNDED = 1e-14
_NOTHING = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


def rewrite_mjcf(text: str, robot: Robot) -> RewrittenFile:
    """Return the MJCF `text`, which `robot` was read from, with its inertias, friction, rotors, springs.

    `robot.made_from` says how it was read. Where the file has inertias come from geoms alone, they come from
    <inertial> now.

    Raises:
        RobotError: the text is no MJCF, or the values have no place in it.
    """
    made = robot.made_from or SourceFile(file=robot.path, sha256="")
    before = build_mjcf_robot(parse_document(text, robot.path), made.base, made.tip, made.snap)
    model = read_model(parse_document(text, robot.path), made.snap)
    reading = model.reading
    below: dict[str, list[TreeJoint]] = {}
    for entry in reading.joints.values():
        below.setdefault(entry.parent, []).append(entry)
    names = match_names(robot, reading)
    edits: list[Edit] = []
    shared: dict[str, tuple[str, ...]] = {}
    pairs = list(zip(robot.joints, before.joints, strict=True))
    geoms_alone = model.settings.inference == "true" and any(
        new.inertial != old.inertial for new, old in pairs
    )
    for joint, old in pairs:
        entry = reading.joints[names[joint.name]]
        if joint.inertial is not None and (geoms_alone or joint.inertial != old.inertial):
            members = gather_members(reading, below, entry.child, set(names.values()))
            if members[0].link.between:
                _check_between(joint, entry)
                continue
            changed = distribute(move_to_link(joint, made.tip, members), members)
            for member, own in changed:
                edits += _edit_inertial(model.parts["body", member.link.name], own)
            carried = [member.link.name for member, _ in changed if member is not members[0]]
            shared |= {entry.child: tuple(carried)} if carried else {}
        values = _list_values(model, joint, entry, old)
        edits += _edit_attributes(model.parts["joint", entry.name], values)
    for coupling in robot.couplings:
        edits += _edit_attributes(model.parts["tendon", coupling.name], _list_mechanics(coupling))
    edits += _edit_compiler(model) if geoms_alone else ()
    if reading.errors:
        raise RobotError(*sort_notices(reading.errors))
    return RewrittenFile(text=apply_edits(reading.document, edits), shared=shared)


def _check_between(joint: Joint, tree: TreeJoint) -> None:
    """Refuse a link with mass between two joints of a body."""
    if any(joint.inertial or ()):
        text = (
            "the link between it and the next joint of its body got a mass, which has no place in this file"
        )
        tree.part.refuse("robot.mjcf-massless", f"{text}; write a new one (-o FILE)")


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
        if element.attributes.get("inertiafromgeom") == "true":
            yield from _write_attributes(own, {"inertiafromgeom": "auto"})


def _edit_inertial(body: MjcfPart, values: Sequence[float]) -> Iterator[Edit]:
    """Yield the edits of <inertial>: in its own attributes where they can hold the values, else a new one."""
    old = body.part.element.find("inertial")
    if not _check_file(body):
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
            inside, end = document.locate_inside(old)
            yield old.offset, inside if inside == end else end + len(b"</inertial>"), line


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
    if new:
        yield from _write_attributes(own, {name: write_decimal(value) for name, value in new.items()})


def _write_attributes(own: MjcfPart, values: Mapping[str, str]) -> Iterator[Edit]:
    if _check_file(own):
        yield from set_values(own.model.reading.document, own.part.element, values)
