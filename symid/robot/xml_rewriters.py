"""A URDF or an MJCF model with other values: all else stays, byte by byte.

Text of a file, the robot that was read from it with other values -> the text with numbers changed, and with
elements and attributes that it lacked. What hangs on a moving link by joints that do not move in the robot
was identified together with it: fixed links, and links that were cut off, in their zero position. The change
of the whole is spread over all of them by one affine map of their mass points, x -> A x, x = (r, 1):

    sum A P_i A' = P,  A = U V^-1,  P = U U',  sum P_i = V V',  U and V upper triangular

with pseudo-inertias P_i of the old links, seen from one frame: each stays a body that can exist. Where
the old ones are points or lie in a plane, all goes to the moving link.

Supported: files that are read as a whole or cut; values that did not change stay as they are written. In
URDFs any inertial frames, damping and dry friction (the mean of both directions), rotor inertias of
transmissions. In MJCF inertias in `fullinertia`, or in `diaginertia` with `quat`, else a new <inertial>;
damping, frictionloss, armature, stiffness, springref, those of fixed tendons too.
Not supported: rotors without a transmission; values that stand in included files; a mass between two joints
of one body; other friction, which `list_urdf_omissions` and `list_mjcf_omissions` name.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint_models import NO_FRICTION
from symid.robot import geometry, inertia, urdf_parts, urdf_xml
from symid.robot.description import Coupling, Joint, JointKind, Robot, SourceFile, Spring
from symid.robot.inertia import build_pseudo_inertias, is_same_body, move_parameters, split_body, to_tensor
from symid.robot.mjcf_reader import ORIENTATIONS, assemble_model, read_model, read_rotation
from symid.robot.simulator_writers import (
    MUJOCO_ORDER,
    get_plain_friction,
    list_drive_omissions,
    write_decimal,
    write_decimals,
    write_inertial,
)
from symid.robot.toml_values import BASE, sort_notices
from symid.robot.urdf_reader import assemble_robot, read_urdf

# Of old bodies, in units of their largest entries: flatter ones cannot be mapped.
_FLAT = 1e-9
# Of the largest entry of a tensor, and in m: what is left by rounding where the file has zero.
_ROUNDING = 1e-14
# Of a number: what is left of a change where it was only written with other digits.
_SAME = 1e-12
_NOTHING = '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>'


@dataclass(frozen=True, slots=True, kw_only=True)
class RewrittenFile:
    """The new text; links whose values were identified as a sum, by the moving link that carries them."""

    text: str
    shared: Mapping[str, tuple[str, ...]]


def rewrite_urdf(text: str, robot: Robot) -> RewrittenFile:
    """Return the URDF `text`, which `robot` was read from as `made_from` says, with the robot's own values.

    Values of a link hold for it and all that it carries, what was cut off included, as identified ones do. A
    RobotError if the text is no URDF, or the robot was made from none.
    """
    made = _get_source(robot, "URDF", "robot.not-made")
    document = urdf_xml.parse_document(text, robot.path)
    reading, complete = read_urdf(document, made.snap)
    before = assemble_robot(reading, complete, made.base, made.tip)
    names = _match_names(robot, reading)
    edits: list[urdf_xml.Edit] = []
    shared: dict[str, tuple[str, ...]] = {}
    for joint, old in zip(robot.joints, before.joints, strict=True):
        entry = reading.joints[names[joint.name]]
        if joint.inertial is not None and not is_same_body(joint.inertial, old.inertial):
            changed = _spread_change(reading, names, joint, made.tip)
            for link, own in changed:
                edits += _edit_urdf_inertial(document, link.part.element, own)
            carried = tuple(link.name for link, _ in changed if link.name != entry.child)
            shared |= {entry.child: carried} if carried else {}
        if joint.friction != old.friction:
            dynamics, friction = entry.part.element.find("dynamics"), get_plain_friction(joint.friction)
            if joint.friction.law == NO_FRICTION and dynamics is not None:
                friction = (0.0, 0.0)
            if friction is not None:
                values = dict(zip(("damping", "friction"), map(write_decimal, friction), strict=True))
                edits += _set(document, entry.part.element, dynamics, "dynamics", values)
    # On the motor's side, by the reduction that stands in the file.
    rotors = {
        names[joint.name]: joint.drive.rotor_inertia / old.drive.gear**2
        for joint, old in zip(robot.joints, before.joints, strict=True)
        if joint.drive.rotor_inertia not in (None, old.drive.rotor_inertia)
    }
    for transmission in document.root.find_all("transmission"):
        ends, actuators = (list(transmission.find_all(tag)) for tag in ("joint", "actuator"))
        if len(ends) != 1 or len(actuators) != 1:
            continue
        inertia = rotors.get(ends[0].attributes.get("name", ""))
        if inertia is None:
            continue
        value, stated = write_decimal(inertia), list(actuators[0].find_all(*urdf_parts.ROTORS))
        for rotor in stated:
            if "value" in rotor.attributes:
                edits += urdf_xml.set_values(document, rotor, {"value": value})
            else:
                edits.append((*document.locate_inside(rotor), value))
        if not stated and inertia:
            line = f"<motorInertia>{value}</motorInertia>"
            edits.append(urdf_xml.insert_element(document, actuators[0], [line]))
    return RewrittenFile(text=urdf_xml.apply_edits(document, edits), shared=shared)


def _get_source(robot: Robot, what: str, code: str) -> SourceFile:
    if robot.made_from is None:
        text = f"robot {robot.name!r} was made from no {what}; write a new one (-o FILE)"
        raise RobotError(Notice(code=code, text=text, file=robot.path))
    return robot.made_from


def _match_names(robot: Robot, reading: urdf_parts.TreeReading) -> dict[str, str]:
    """Return the names that joints have in the file; the reader gives another one to a joint `base`."""
    return {joint.name: joint.name if joint.name in reading.joints else BASE for joint in robot.joints}


def _spread_change(
    reading: urdf_parts.TreeReading, names: Mapping[str, str], changed: Joint, tip: str | None
) -> list[tuple[urdf_parts.TreeLink, tuple[float, ...]]]:
    """Return the joint's own link and those that it carries, which are at rest, with their new values."""
    moving, first = set(names.values()), reading.links[reading.joints[names[changed.name]].child]
    # Each link, and where its frame (4, 4) stands in that of the first one.
    members = [(first, np.eye(4))]
    for link, pose in members:
        for joint in reading.joints.values():
            if joint.parent == link.name and joint.name not in moving:
                shift = geometry.IDENTITY
                if joint.moves:
                    # Where it stands when its masters are at rest, too; a ring of them stands at zero.
                    offset = -joint.zero
                    if joint.name in reading.steps:
                        *_, end = reading.steps[joint.name].follow(reading.steps)
                        offset += geometry.ZERO if end.master in reading.steps else end.offset
                    prismatic = joint.type == "prismatic"
                    shift = geometry.place_joint(offset, prismatic=prismatic, snap=geometry.ROUNDED)
                placed = geometry.compose_placements(
                    joint.origin, joint.turn, shift, geometry.invert_placement(joint.turn)
                )
                members.append((reading.links[joint.child], pose @ inertia.to_matrix(placed)))
    frame = inertia.to_matrix(changed.frame)
    for link, pose in members[1:]:
        # The frame of the last joint is that of the tip, where this is fixed to its link.
        if link.name == tip:
            frame = frame @ np.linalg.inv(pose)
    rotation = frame[:3, :3].T
    values = move_parameters(changed.inertial or (0.0,) * 10, rotation, -rotation @ frame[:3, 3])
    heavy = [(link, pose) for link, pose in members if link.inertial is not None and any(link.inertial)]
    if all(link is first for link, _ in heavy):
        return [(first, values)]
    seen = [move_parameters(link.inertial or (), pose[:3, :3], pose[:3, 3]) for link, pose in heavy]
    old = build_pseudo_inertias(np.array(seen))
    roots = [_factorise(part) for part in (build_pseudo_inertias(np.array([values]))[0], old.sum(axis=0))]
    if roots[0] is None or roots[1] is None:
        # All goes to the moving link.
        return [(first, values), *((link, (0.0,) * 10) for link, _ in heavy if link is not first)]
    affine = np.linalg.solve(roots[1].T, roots[0].T).T
    found = []
    for (link, pose), body in zip(heavy, old, strict=True):
        matrix, turn = affine @ body @ affine.T, pose[:3, :3].T
        tensor = np.trace(matrix[:3, :3]) * np.eye(3) - matrix[:3, :3]
        parameters = (*tensor[np.triu_indices(3)].tolist(), *matrix[3].tolist())
        found.append((link, move_parameters(parameters, turn, -turn @ pose[:3, 3])))
    return found


def _factorise(matrix: FloatArray) -> FloatArray | None:
    """Return the upper triangular U (4, 4) with U U' equal to a symmetric matrix; None where it is flat."""
    sizes = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not np.all(sizes > 0.0):
        return None
    scaled = matrix / np.outer(sizes, sizes)
    if float(np.linalg.eigvalsh(scaled)[0]) < _FLAT:
        return None
    lower = np.linalg.cholesky(scaled[::-1, ::-1])
    return np.asarray(sizes[:, None] * lower[::-1, ::-1])


def _edit_urdf_inertial(
    document: urdf_xml.XmlDocument, link: urdf_xml.XmlElement, values: Sequence[float]
) -> Iterator[urdf_xml.Edit]:
    """Yield the edits that give ten parameters, in the link's frame, to a link."""
    inertial = link.find("inertial")
    if inertial is None:
        yield urdf_xml.insert_element(document, link, write_inertial(values))
        return
    mass, com, central = split_body(values)
    origin, weight, tensor = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    if origin is not None and "rpy" in origin.attributes:
        # The file's own axes stay.
        rotation = urdf_parts.build_rpy_matrix([float(part) for part in origin.attributes["rpy"].split()])
        central = move_parameters((*central, 0.0, 0.0, 0.0, 0.0), rotation.T, np.zeros(3))[:6]
    least = _ROUNDING * max(map(abs, central))
    central = tuple(value if abs(value) > least else 0.0 for value in central)
    com = [value if abs(value) > _ROUNDING else 0.0 for value in com]
    entries = dict(zip(urdf_xml.TENSOR, map(write_decimal, central), strict=True))
    if mass:
        yield from _set(document, inertial, origin, "origin", {"xyz": write_decimals(com)})
    yield from _set(document, inertial, weight, "mass", {"value": write_decimal(mass)})
    yield from _set(document, inertial, tensor, "inertia", entries)


def _set(
    document: urdf_xml.XmlDocument,
    owner: urdf_xml.XmlElement,
    found: urdf_xml.XmlElement | None,
    tag: str,
    values: Mapping[str, str],
) -> Iterator[urdf_xml.Edit]:
    """Yield the edits of an element's attributes, or of the whole element where `owner` lacks it."""
    if found is not None:

        def read(texts: Mapping[str, str]) -> dict[str, list[float]]:
            return {name: list(map(float, text.split())) for name, text in texts.items() if name in values}

        old, new = read(found.attributes), read(values)
        changed = {name: text for name, text in values.items() if old.get(name) != new[name]}
        yield from urdf_xml.set_values(document, found, changed)
    else:
        listed = " ".join(f'{name}="{text}"' for name, text in values.items())
        yield urdf_xml.insert_element(document, owner, [f"<{tag} {listed}/>"])


def rewrite_mjcf(text: str, robot: Robot) -> RewrittenFile:
    """Return the MJCF `text`, which `robot` was read from as `made_from` says, with the robot's own values.

    Where the file has inertias come from geoms alone, they come from <inertial> now. A RobotError if the
    text is no MJCF, or the values have no place in it.
    """
    code = "robot.mjcf-unsupported"
    made = _get_source(robot, "model", code)
    reading = read_model(urdf_xml.parse_document(text, robot.path), made.snap)
    for name, entry in reading.joints.items():
        if entry.moves and entry.spring is None:
            # A spring that does nothing shows where the joint's own coordinate is zero.
            reading.joints[name] = replace(entry, spring=Spring(stiffness=0.0, rest=0.0))
    before = assemble_model(reading, made.base, made.tip)
    new_drives, old_drives = (
        {(drive.name, tuple(sorted(drive.terms))): drive for drive in one.couplings}
        for one in (robot, before)
    )
    if new_drives.keys() != old_drives.keys():
        listed = ("; ".join(list_drive_omissions(one)) or "none" for one in (robot, before))
        text = "the coupled drives are other ones than in the model: {}; in the model: {}; ".format(*listed)
        text += "give them the names and joints of the model's tendons, or write a new model (-o FILE)"
        raise RobotError(Notice(code=code, text=text, file=robot.path))
    names = _match_names(robot, reading)
    edits: list[urdf_xml.Edit] = []
    shared: dict[str, tuple[str, ...]] = {}
    bodies: set[str] = set()
    pairs = list(zip(robot.joints, before.joints, strict=True))
    inertias = [(new.inertial, old.inertial) for new, old in pairs]
    changes = [new is not None and not is_same_body(new, old) for new, old in inertias]
    geoms_alone = reading.settings.inference == "true" and any(changes)
    for (joint, old), changed in zip(pairs, changes, strict=True):
        entry = reading.joints[names[joint.name]]
        values = _list_values(reading, joint, entry, old)
        edits += _edit_attributes(reading.parts["joint", entry.name], values)
        if joint.inertial is None or not (geoms_alone or changed):
            continue
        if reading.links[entry.child].between:
            if any(joint.inertial):
                text = "the link between it and the next joint of its body got a mass, which has no place"
                text += " in this file; write a new one (-o FILE)"
                entry.part.refuse("robot.mjcf-massless", text)
            continue
        spread = _spread_change(reading, names, joint, made.tip)
        for link, own in spread:
            edits += _edit_mjcf_inertial(reading.parts["body", link.name], own)
        bodies |= {link.name for link, _ in spread}
        carried = tuple(link.name for link, _ in spread if link.name != entry.child)
        shared |= {entry.child: carried} if carried else {}
    for key, drive in new_drives.items():
        values = _list_mechanics(drive, old_drives[key])
        edits += _edit_attributes(reading.parts["tendon", drive.name], values)
    # The new <inertial> is to hold where the file has inertias come from geoms alone.
    for element in reading.document.root.find_all("compiler") if geoms_alone else ():
        if element.attributes.get("inertiafromgeom") == "true":
            edits += _write_attributes(reading.enter(element, "compiler"), {"inertiafromgeom": "auto"})
    written = urdf_xml.apply_edits(reading.document, edits)
    if geoms_alone and not reading.errors:
        links = read_model(urdf_xml.parse_document(written, robot.path), reading.snap).links
        for name, link in reading.links.items():
            if name not in bodies and not is_same_body(links[name].inertial, link.inertial):
                text = 'its <inertial>, which inertiafromgeom="true" leaves unused, would hold in the new '
                link.part.refuse(code, f"{text}file; remove this <inertial>")
    if reading.errors:
        raise RobotError(*sort_notices(reading.errors))
    return RewrittenFile(text=written, shared=shared)


def _list_mechanics(new: Joint | Coupling, old: Joint | Coupling) -> dict[str, float]:
    """Return what joints and tendons have in common, where it is known; friction only where it is new."""
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


def _list_values(
    reading: urdf_parts.TreeReading, joint: Joint, tree: urdf_parts.TreeJoint, old: Joint
) -> dict[str, float]:
    """Return the values of a joint's attributes."""
    values, spring = _list_mechanics(joint, old), joint.spring or Spring(stiffness=0.0)
    if spring.stiffness is None or old.spring is None or tree.spring is None:
        return values
    values["stiffness"] = spring.stiffness
    if spring.stiffness:
        # A follower's spring rests elsewhere in its own coordinate.
        new, before = spring.rest or 0.0, old.spring.rest or 0.0
        rest = (tree.spring.rest or 0.0) + (0.0 if _is_same(new, before) else new - before)
        in_degrees = reading.settings.degrees and joint.kind is JointKind.REVOLUTE
        values["springref"] = math.degrees(rest) if in_degrees else rest
    return values


def _check_file(own: urdf_parts.XmlPart) -> bool:
    """Refuse to change what stands in an included file."""
    inside = own.element.file == own.reading.document.file
    if not inside:
        text = "its values stand in an included file, which is not written; put the model into one file"
        own.refuse("robot.mjcf-include", text)
    return inside


def _edit_mjcf_inertial(body: urdf_parts.XmlPart, values: Sequence[float]) -> Iterator[urdf_xml.Edit]:
    """Yield the edits of <inertial>: in its own attributes where they can hold the values, else a new one."""
    old, document = body.element.find("inertial"), body.reading.document
    own = body if old is None else body.enter(old)
    if not _check_file(own):
        return
    mass, com, central = split_body(values)
    numbers = {"pos": write_decimals(com), "mass": write_decimal(mass)}
    names = set(old.attributes) if old is not None else set[str]()
    turned = [name for name in ORIENTATIONS if name in names]
    tensor = write_decimals([central[k] for k in MUJOCO_ORDER])
    off_diagonal, least = max(abs(central[k]) for k in (1, 2, 4)), _ROUNDING * max(map(abs, central))
    stated: dict[str, str] = {}
    if "fullinertia" in names:
        stated = {"fullinertia": tensor}
    elif "diaginertia" in names and turned == ["quat"]:
        moments, quaternion = _find_axes(central, np.array(geometry.to_floats(read_rotation(own))))
        stated = {"diaginertia": write_decimals(moments), "quat": write_decimals(quaternion)}
    elif "diaginertia" in names and not turned and off_diagonal <= least:
        stated = {"diaginertia": write_decimals([central[k] for k in (0, 3, 5)])}
    place = " ".join(f'{name}="{value}"' for name, value in numbers.items())
    line = f'<inertial {place} fullinertia="{tensor}"/>' if mass else _NOTHING
    if stated:
        yield from _write_attributes(own, {**numbers, **stated})
    elif old is None:
        yield urdf_xml.insert_element(document, body.element, [line])
    else:
        # What stands inside, as comments, stays.
        inside, _ = document.locate_inside(old)
        closed = document.source[inside - 2 : inside] == b"/>"
        yield old.offset, inside, line if closed else f"{line[:-2]}>"


def _find_axes(central: Sequence[float], near: FloatArray) -> tuple[list[float], list[float]]:
    """Return principal moments of a tensor (6,), and a quaternion of the axes most like `near` (3, 3)."""
    moments, axes = np.linalg.eigh(to_tensor(central))
    likeness = np.abs(near.T @ axes)
    order = max(itertools.permutations(range(3)), key=lambda p: sum(likeness[k, p[k]] for k in range(3)))
    axes = axes[:, list(order)]
    axes *= np.where(np.sum(near * axes, axis=0) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1.0
    rows: list[geometry.ExactVector] = [
        (geometry.Exact.of(float(x)), geometry.Exact.of(float(y)), geometry.Exact.of(float(z)))
        for x, y, z in axes
    ]
    return [float(moments[k]) for k in order], geometry.compute_unit_quaternion((rows[0], rows[1], rows[2]))


def _edit_attributes(own: urdf_parts.XmlPart, values: Mapping[str, float]) -> Iterator[urdf_xml.Edit]:
    """Yield the edits that give an element these values, where it and its class do not state them already."""
    new = {name: value for name, value in values.items() if not _is_same(own.read_linear(name), value)}
    if new:
        yield from _write_attributes(own, {name: write_decimal(value) for name, value in new.items()})


def _write_attributes(own: urdf_parts.XmlPart, values: Mapping[str, str]) -> Iterator[urdf_xml.Edit]:
    if _check_file(own):
        yield from urdf_xml.set_values(own.reading.document, own.element, values)
