"""A URDF with other values: all else stays, byte by byte.

Text of a URDF, the robot that was read from it with other values -> the text with numbers changed, and with
elements and attributes that it lacked. What hangs on a moving link by joints that do not move in the robot
was identified together with it: fixed links, and links that were cut off, in their zero position. The change
of the whole is spread over all of them by one affine map of their mass points, x -> A x, x = (r, 1):

    sum A P_i A' = P,  A = U V^-1,  P = U U',  sum P_i = V V',  U and V upper triangular

with pseudo-inertias P_i of the old links, seen from one frame: each stays a body that can exist. Where
the old ones are points or lie in a plane, all goes to the moving link.

Supported: URDFs that are read as a whole or cut, any inertial frames, damping and dry friction (the mean of
both directions), rotor inertias of transmissions. Values that did not change stay as they are written.
Not supported: rotors without a transmission, other friction; `list_urdf_omissions` names them.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, RobotError
from symid.joint_models import NO_FRICTION
from symid.robot.description import Joint, Robot
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    Placement,
    compose_placements,
    invert_placement,
    place_joint,
    to_floats,
)
from symid.robot.inertia import build_pseudo_inertias, is_same_body, move_parameters, split_body
from symid.robot.toml_values import BASE
from symid.robot.urdf_parts import ROTORS, TreeJoint, TreeLink, TreeReading, build_rpy_matrix, read_parts
from symid.robot.urdf_reader import parse_urdf, read_mimics
from symid.robot.urdf_xml import (
    Edit,
    XmlDocument,
    XmlElement,
    apply_edits,
    insert_element,
    parse_document,
    set_values,
)
from symid.robot.xml_writers import TENSOR, get_plain_friction, write_decimal, write_decimals, write_inertial

# Of old bodies, in units of their largest entries: flatter ones cannot be mapped.
_FLAT = 1e-9
# Of the largest entry of a tensor, and in m: what is left by rounding where the file has zero.
_ROUNDING = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True)
class RewrittenFile:
    """The new text; links whose values were identified as a sum, by the moving link that carries them."""

    text: str
    shared: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """A link that moves with another one, and where its frame (4, 4) stands in that one's."""

    link: TreeLink
    pose: FloatArray

    def look(self, parameters: Sequence[float], *, inverse: bool = False) -> tuple[float, ...]:
        """Return ten parameters, given in the link's frame, seen from the other frame; or `inverse`."""
        rotation, shift = self.pose[:3, :3], self.pose[:3, 3]
        if inverse:
            rotation, shift = rotation.T, -rotation.T @ shift
        return move_parameters(parameters, rotation, shift)


def rewrite_urdf(text: str, robot: Robot) -> RewrittenFile:
    """Return the URDF `text`, which `robot` was read from, with the robot's inertias, friction and rotors.

    `robot.made_from` says how it was read. Values of a link hold for it and all that it carries, what was
    cut off included, as identified ones do.

    Raises:
        RobotError: the text is no URDF, or the robot was made from none.
    """
    if (made := robot.made_from) is None:
        text = f"robot {robot.name!r} was made from no URDF; write a new one (-o FILE)"
        raise RobotError(Notice(code="robot.not-made", text=text, file=robot.path))
    before = parse_urdf(text, robot.path, base=made.base, tip=made.tip, snap=made.snap)
    document = parse_document(text, robot.path)
    reading = read_parts(document, made.snap)
    read_mimics(reading)
    below: dict[str, list[TreeJoint]] = {}
    for entry in reading.joints.values():
        below.setdefault(entry.parent, []).append(entry)
    names = match_names(robot, reading)
    edits: list[Edit] = []
    shared: dict[str, tuple[str, ...]] = {}
    for joint, old in zip(robot.joints, before.joints, strict=True):
        entry = reading.joints[names[joint.name]]
        if joint.inertial is not None and not is_same_body(joint.inertial, old.inertial):
            members = gather_members(reading, below, entry.child, set(names.values()))
            changed = distribute(move_to_link(joint, made.tip, members), members)
            for member, own in changed:
                edits += _edit_inertial(document, member.link.part.element, own)
            carried = [member.link.name for member, _ in changed if member is not members[0]]
            shared |= {entry.child: tuple(carried)} if carried else {}
        if joint.friction != old.friction:
            edits += _edit_dynamics(document, entry.part.element, joint)
    # On the motor's side, by the reduction that stands in the file.
    rotors = {
        names[joint.name]: joint.drive.rotor_inertia / old.drive.gear**2
        for joint, old in zip(robot.joints, before.joints, strict=True)
        if joint.drive.rotor_inertia not in (None, old.drive.rotor_inertia)
    }
    for transmission in document.root.find_all("transmission"):
        edits += _edit_rotor(document, transmission, rotors)
    return RewrittenFile(text=apply_edits(document, edits), shared=shared)


def match_names(robot: Robot, reading: TreeReading) -> dict[str, str]:
    """Return the names that joints have in the file; the reader gives another one to a joint `base`."""
    return {joint.name: joint.name if joint.name in reading.joints else BASE for joint in robot.joints}


def gather_members(
    reading: TreeReading, below: Mapping[str, Sequence[TreeJoint]], first: str, moving: Collection[str]
) -> list[Member]:
    """Return the link `first` and all that it carries by joints that are not `moving`, which stand at zero.

    Joints that follow no moving one stand at their offset.
    """
    members = [Member(link=reading.links[first], pose=np.eye(4))]
    for member in members:
        for joint in below.get(member.link.name, ()):
            if joint.name not in moving:
                offset = _compute_offset(reading, joint.name) - joint.zero
                prismatic = joint.type == "prismatic"
                shift = place_joint(offset, prismatic=prismatic, snap=0.0) if joint.moves else IDENTITY
                placed = compose_placements(joint.origin, joint.turn, shift, invert_placement(joint.turn))
                members.append(Member(link=reading.links[joint.child], pose=member.pose @ _to_pose(placed)))
    return members


def _compute_offset(reading: TreeReading, name: str) -> Exact:
    """Return where a joint stands whose masters stand still, too; a ring of them stands at zero."""
    total, factor, seen = ZERO, Exact.of(1), set[str]()
    while name in reading.steps and name not in seen:
        seen.add(name)
        step = reading.steps[name]
        total += factor * step.offset
        factor *= Exact.surd(step.multiplier)
        name = step.master or ""
    return ZERO if name in seen else total


def _to_pose(placement: Placement) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = to_floats(placement)
    pose[:3, 3] = [entry.to_float() for entry in placement.translation]
    return pose


def move_to_link(joint: Joint, tip: str | None, members: Sequence[Member]) -> tuple[float, ...]:
    """Return the values of a joint's link in the frame that the file gives to the link."""
    frame = _to_pose(joint.frame)
    for member in members[1:]:
        # The frame of the last joint is that of the tip, where this is fixed to its link.
        if member.link.name == tip:
            frame = frame @ np.linalg.inv(member.pose)
    rotation = frame[:3, :3].T
    return move_parameters(joint.inertial or (0.0,) * 10, rotation, -rotation @ frame[:3, 3])


def distribute(values: Sequence[float], members: Sequence[Member]) -> list[tuple[Member, tuple[float, ...]]]:
    """Return the links that change, the first one included or alone, and their values in their own frames."""
    first = members[0]
    heavy = [member for member in members if member.link.inertial is not None and any(member.link.inertial)]
    if heavy in ([], [first]):
        return [(first, tuple(values))]
    old = build_pseudo_inertias(np.array([member.look(member.link.inertial or ()) for member in heavy]))
    roots = [_factorise(part) for part in (build_pseudo_inertias(np.array([values]))[0], old.sum(axis=0))]
    if roots[0] is None or roots[1] is None:
        # All goes to the moving link.
        return [(first, tuple(values)), *((member, (0.0,) * 10) for member in heavy if member is not first)]
    moved = np.linalg.solve(roots[1].T, roots[0].T).T
    new = [_read_body(moved @ body @ moved.T) for body in old]
    return [(member, member.look(own, inverse=True)) for member, own in zip(heavy, new, strict=True)]


def _read_body(matrix: FloatArray) -> tuple[float, ...]:
    """Return the ten parameters of a pseudo-inertia (4, 4)."""
    tensor = np.trace(matrix[:3, :3]) * np.eye(3) - matrix[:3, :3]
    return (*tensor[np.triu_indices(3)].tolist(), *matrix[3].tolist())


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


def _edit_inertial(document: XmlDocument, link: XmlElement, values: Sequence[float]) -> Iterator[Edit]:
    """Yield the edits that give ten parameters, in the link's frame, to a link."""
    inertial = link.find("inertial")
    if inertial is None:
        yield insert_element(document, link, write_inertial(values))
        return
    mass, com, central = split_body(values)
    origin, weight, tensor = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    if origin is not None and "rpy" in origin.attributes:
        # The file's own axes stay.
        rotation = build_rpy_matrix([float(part) for part in origin.attributes["rpy"].split()])
        central = move_parameters((*central, 0.0, 0.0, 0.0, 0.0), rotation.T, np.zeros(3))[:6]
    least = _ROUNDING * max(map(abs, central))
    central = tuple(value if abs(value) > least else 0.0 for value in central)
    com = [value if abs(value) > _ROUNDING else 0.0 for value in com]
    entries = dict(zip(TENSOR, map(write_decimal, central), strict=True))
    if mass:
        yield from _set(document, inertial, origin, "origin", {"xyz": write_decimals(com)})
    yield from _set(document, inertial, weight, "mass", {"value": write_decimal(mass)})
    yield from _set(document, inertial, tensor, "inertia", entries)


def _set(
    document: XmlDocument, owner: XmlElement, found: XmlElement | None, tag: str, values: Mapping[str, str]
) -> Iterator[Edit]:
    """Yield the edits of an element's attributes, or of the whole element where `owner` lacks it."""
    if found is not None:
        old = {
            name: list(map(float, text.split())) for name, text in found.attributes.items() if name in values
        }
        new = {name: list(map(float, text.split())) for name, text in values.items()}
        changed = {name: text for name, text in values.items() if old.get(name) != new[name]}
        yield from set_values(document, found, changed)
    else:
        listed = " ".join(f'{name}="{text}"' for name, text in values.items())
        yield insert_element(document, owner, [f"<{tag} {listed}/>"])


def _edit_dynamics(document: XmlDocument, element: XmlElement, joint: Joint) -> Iterator[Edit]:
    friction = get_plain_friction(joint.friction)
    if joint.friction.law == NO_FRICTION and element.find("dynamics") is not None:
        friction = (0.0, 0.0)
    if friction is not None:
        values = dict(zip(("damping", "friction"), map(write_decimal, friction), strict=True))
        yield from _set(document, element, element.find("dynamics"), "dynamics", values)


def _edit_rotor(
    document: XmlDocument, transmission: XmlElement, inertias: Mapping[str, float]
) -> Iterator[Edit]:
    """Yield the edits of the rotor of a transmission between one joint and one actuator."""
    ends, actuators = (list(transmission.find_all(tag)) for tag in ("joint", "actuator"))
    if len(ends) != 1 or len(actuators) != 1:
        return
    inertia, actuator = inertias.get(ends[0].attributes.get("name", "")), actuators[0]
    if inertia is None:
        return
    value = write_decimal(inertia)
    rotors = list(actuator.find_all(*ROTORS))
    for rotor in rotors:
        if "value" in rotor.attributes:
            yield from set_values(document, rotor, {"value": value})
        else:
            yield (*document.locate_inside(rotor), value)
    if not rotors and inertia:
        yield insert_element(document, actuator, [f"<motorInertia>{value}</motorInertia>"])
