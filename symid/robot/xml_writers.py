"""A robot as a URDF, new or with the robot's own file kept; what all writers of XML share.

Each joint moves the link `<joint>_link`, whose frame is the link frame used here: the axis is z. The base is
the link `base`, a link of unknown values has no <inertial>, an unknown limit is 0.

Supported: placements, inertial values, limits, damping and dry friction (the mean of both directions),
followers, gears and rotors. Rewriting: URDFs read as a whole.
Not supported, and written in a comment: symbols (their values are written), other friction, elastic joints,
gravity other than (0, 0, -9.81), springs, coupled drives, and rotor inertia, which simulators do not read.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from xml.sax.saxutils import escape, quoteattr

from symid.joint_models import (
    NO_FRICTION,
    FrictionValues,
    get_friction_law,
    list_shape_names,
    list_value_names,
    name_bristles,
    name_values,
)
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import Placement, to_floats
from symid.robot.inertia import move_by_placement, split_body
from symid.robot.toml_values import BASE
from symid.robot.urdf_parts import ROTORS
from symid.robot.urdf_xml import XmlDocument, XmlElement, parse_document

_UNFIT = re.compile(r"[\x00-\x1f\ufffe\uffff]")
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def write_quoted(name: str) -> str:
    """Return a name as the value of an attribute, in quotes."""
    return quoteattr(_UNFIT.sub(" ", name))


def write_comments(texts: Sequence[str]) -> list[str]:
    """Return comments, one a text."""
    return [f"  <!-- {escape(_UNFIT.sub(' ', text)).replace('--', '- -')} -->" for text in texts]


def write_decimal(value: float) -> str:
    """Return a number with all digits of a double."""
    return repr(float(value) + 0.0)


def write_decimals(values: Sequence[float]) -> str:
    """Return numbers with blanks between them."""
    return " ".join(write_decimal(value) for value in values)


def write_head(robot: Robot, comments: Sequence[str], omissions: Iterator[str]) -> list[str]:
    """Return comments for the head of a file: those given, values of symbols, and what is left out."""
    symbols = (f"{name} = {write_decimal(value)} m" for name, value in robot.symbols)
    return write_comments([*comments, *symbols, *omissions])


def get_plain_friction(friction: FrictionValues) -> tuple[float, float] | None:
    """Return damping (N m s/rad or N s/m) and dry friction (N m or N) of a model; None where unknown or none.

    Of a model that tells directions apart it is their mean.
    """
    if friction.law == NO_FRICTION or friction.values is None:
        return None
    named = name_values(friction)
    groups = (("Fv", "Fvp", "Fvn"), ("Fc", "Fcp", "Fcn"))
    damping, dry = ([named[name] for name in names if name in named] or [0.0] for names in groups)
    return sum(damping) / len(damping), sum(dry) / len(dry)


def list_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    """Yield what a friction model has beyond damping and dry friction, with all its values."""
    if friction.law != NO_FRICTION and friction.values is None:
        yield f"{owner}: friction of unknown size ({friction.law})"
    elif friction.law not in (NO_FRICTION, "coulomb", "coulomb-viscous"):
        names = [", ".join(list_value_names(friction))]
        values = write_decimals(friction.values or ())
        text = f"{owner}: friction model {friction.law}, values {values}"
        if friction.shape:
            text += f", shape {write_decimals(friction.shape)}"
            names.append(", ".join(list_shape_names(friction)))
        law = get_friction_law(friction)
        if law is not None and law.memory:
            text += f", state {write_decimals(friction.bristles)}"
            names.append(", ".join(name_bristles(law, friction.bristles)))
        text += f" ({'; '.join(names)})"
        yield f"{text}; only its damping and dry friction, alike in both directions, are written"
    if friction.smoothing:
        yield f"{owner}: dry friction changes its sign over {friction.smoothing}"


def list_elastic_omissions(joint: Joint) -> Iterator[str]:
    """Yield the spring between motor and link of an elastic joint."""
    if spring := joint.elasticity:
        parts = [str(spring.stiffness)]
        parts += [f"damping {spring.damping}"] if spring.damping else []
        parts += [f"cubic {spring.cubic}"] if spring.cubic else []
        parts += [f"stop of {stop.stiffness} to {stop.threshold}" for stop in spring.stops]
        parts += [f"knee of {knee.slope} at {knee.threshold}" for knee in spring.knees]
        yield f"joint {joint.name}: elastic, {', '.join(parts)}; it is written as rigid"


def write_urdf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the URDF of `robot`, with comments at its head."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={write_quoted(robot.name)}>"]
    lines += [*write_head(robot, comments, list_urdf_omissions(robot)), f'  <link name="{BASE}"/>']
    for joint in robot.joints:
        lines += _write_joint(robot, joint)
    for joint in robot.joints:
        drive = joint.drive
        if drive.gear == 1.0 and not drive.has_rotor:
            continue
        lines += [
            f"  <transmission name={write_quoted(f'{joint.name}_transmission')}>",
            "    <type>transmission_interface/SimpleTransmission</type>",
            f"    <joint name={write_quoted(joint.name)}/>",
            f"    <actuator name={write_quoted(f'{joint.name}_motor')}>",
            f"      <mechanicalReduction>{write_decimal(drive.gear)}</mechanicalReduction>",
        ]
        if drive.rotor_inertia is not None:
            # On the motor side, as URDFs have it.
            inertia = write_decimal(drive.rotor_inertia / drive.gear**2)
            lines.append(f"      <motorInertia>{inertia}</motorInertia>")
        lines += ["    </actuator>", "  </transmission>"]
    return "\n".join((*lines, "</robot>", ""))


def list_urdf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what a URDF cannot hold, or simulators do not read; the file has it in comments."""
    gravity = tuple(value.to_float(dict(robot.symbols)) for value in robot.gravity)
    if gravity != (0.0, 0.0, -9.81):
        yield f"gravity of the model: {write_decimals(gravity)} m/s^2 in the frame of the link {BASE}"
    for joint in robot.joints:
        yield from list_friction_omissions(f"joint {joint.name}", joint.friction)
        if joint.drive.rotor_inertia:
            text = f"joint {joint.name}: rotor inertia {joint.drive.rotor_inertia} on the joint's side"
            yield f"{text}, which simulators call armature; they do not read <motorInertia>"
        if joint.spring is not None:
            yield f"joint {joint.name}: a spring, {joint.spring.stiffness} at rest at {joint.spring.rest}"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        terms = [f"{float(factor):g} {robot.joints[index].name}" for index, factor in coupling.terms]
        text = f"a drive coupled to several joints, {coupling.name}: {', '.join(terms)}"
        if coupling.rotor_inertia is not None:
            text += f", rotor inertia {coupling.rotor_inertia}"
        if coupling.friction.values:
            values = write_decimals(coupling.friction.values)
            text += f", friction {values} ({', '.join(list_value_names(coupling.friction))})"
        yield text


def _compute_rpy(placement: Placement) -> tuple[float, float, float]:
    """Return roll, pitch, yaw with Rot(z, yaw) Rot(y, pitch) Rot(x, roll) = R; roll 0 where it is free."""
    r = to_floats(placement)
    across = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], across)
    if not across:
        return (0.0, pitch, math.atan2(-r[0][1], r[1][1]))
    return (math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0]))


def _write_inertial(parameters: Sequence[float]) -> list[str]:
    """Return the lines of <inertial> for ten standard parameters in the frame of the link."""
    mass, com, central = split_body(parameters)
    tensor = " ".join(f'{key}="{write_decimal(value)}"' for key, value in zip(_TENSOR, central, strict=True))
    return [
        "<inertial>",
        f'  <origin xyz="{write_decimals(com)}" rpy="0 0 0"/>',
        f'  <mass value="{write_decimal(mass)}"/>',
        f"  <inertia {tensor}/>",
        "</inertial>",
    ]


def _write_dynamics(joint: Joint) -> list[str]:
    friction = get_plain_friction(joint.friction)
    if friction is None:
        return []
    damping, dry = map(write_decimal, friction)
    return [f'<dynamics damping="{damping}" friction="{dry}"/>']


def _write_joint(robot: Robot, joint: Joint) -> Iterator[str]:
    symbols = dict(robot.symbols)
    link = write_quoted(f"{joint.name}_link")
    parent = write_quoted(f"{robot.joints[joint.parent].name}_link" if joint.parent >= 0 else BASE)
    xyz = [value.to_float(symbols) for value in joint.placement.translation]
    inertial = () if joint.inertial is None else _write_inertial(joint.inertial)
    yield f"  <link name={link}{'' if inertial else '/'}>"
    yield from (f"    {line}" for line in inertial)
    yield from ("  </link>",) if inertial else ()
    endless = joint.kind is JointKind.REVOLUTE and joint.limits.position is None
    low, high = map(write_decimal, joint.limits.position or (0.0, 0.0))
    ends = "" if endless else f'lower="{low}" upper="{high}" '
    effort, velocity = map(write_decimal, (joint.limits.torque or 0.0, joint.limits.velocity or 0.0))
    yield f'  <joint name={write_quoted(joint.name)} type="{"continuous" if endless else joint.kind.value}">'
    yield f'    <origin xyz="{write_decimals(xyz)}" rpy="{write_decimals(_compute_rpy(joint.placement))}"/>'
    yield f"    <parent link={parent}/>"
    yield f"    <child link={link}/>"
    yield '    <axis xyz="0 0 1"/>'
    yield f'    <limit {ends}effort="{effort}" velocity="{velocity}"/>'
    yield from (f"    {line}" for line in _write_dynamics(joint))
    if joint.mimic is not None:
        master = write_quoted(robot.joints[joint.mimic.master].name)
        factor = write_decimal(float(joint.mimic.multiplier))
        yield f'    <mimic joint={master} multiplier="{factor}" offset="0.0"/>'
    yield "  </joint>"


_QUOTED = re.compile(rb"[^>\"']|\"[^\"]*\"|'[^']*'")


Edit = tuple[int, int, str]
"""The first byte that is replaced, the byte behind the last one, and what comes in their place."""


def rewrite_urdf(text: str, robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the URDF `text`, which `robot` was read from, with the robot's inertias, friction and rotors.

    All else stays, letter by letter; `comments` go to the head. The values of a moving link hold for it and
    the links fixed to it together; theirs are taken out.

    Raises:
        RobotError: the text is no XML.
    """
    document = parse_document(text, robot.path)
    return apply_edits(document, _list_edits(document, robot), [*comments, *list_urdf_omissions(robot)])


def apply_edits(document: XmlDocument, edits: Iterable[Edit], comments: Sequence[str]) -> str:
    """Return the text of a document with edits, which do not overlap, and comments at its head."""
    result = document.source
    head = "".join(f"\n{line}" for line in write_comments(comments))
    start = locate_tag_end(result, document.root.offset)
    edits = [*edits, (start, start, head)]
    for begin, end, inserted in sorted(edits, key=lambda edit: edit[0], reverse=True):
        result = result[:begin] + inserted.encode() + result[end:]
    return result.decode(errors="surrogatepass")


def _list_edits(document: XmlDocument, robot: Robot) -> Iterator[Edit]:
    """Yield the edits of links, joints and transmissions."""
    root = document.root
    elements = {element.attributes.get("name", ""): element for element in root.find_all("joint")}
    joints = {joint.name: joint for joint in robot.joints}
    # The reader gives another name to a joint that is called as the base of robot files is.
    strangers = [joint for joint in robot.joints if joint.name not in elements]
    if strangers and BASE in elements:
        joints[BASE] = strangers[0]
    # The joint that moves each link, and the link before it.
    ends = ((name, _get_link(joint, "child"), _get_link(joint, "parent")) for name, joint in elements.items())
    parents = {child: (name, parent) for name, child, parent in ends}
    for link in root.find_all("link"):
        name = link.attributes.get("name", "")
        old = link.find("inertial")
        joint = joints.get(parents[name][0]) if name in parents else None
        if joint is not None and joint.inertial is not None:
            # In the frame that the file gives to the link.
            values = move_by_placement(joint.inertial, joint.frame, inverse=True)
            yield replace_element(document, link, old, _write_inertial(values))
        elif joint is None and old is not None and _is_carried(name, parents, joints):
            yield remove_element(document, old)
    for name, element in elements.items():
        if name in joints and (lines := _write_dynamics(joints[name])):
            yield replace_element(document, element, element.find("dynamics"), lines)
    for transmission in root.find_all("transmission"):
        end, actuator = transmission.find("joint"), transmission.find("actuator")
        joint = joints.get(end.attributes.get("name", "")) if end is not None else None
        if joint is not None and actuator is not None and joint.drive.rotor_inertia is not None:
            value = write_decimal(joint.drive.rotor_inertia / joint.drive.gear**2)
            for rotor in actuator.find_all(*ROTORS):
                yield replace_element(document, actuator, rotor, [f"<{rotor.tag}>{value}</{rotor.tag}>"])


def _get_link(joint: XmlElement, tag: str) -> str:
    end = joint.find(tag)
    return end.attributes.get("link", "") if end is not None else ""


def _is_carried(link: str, parents: Mapping[str, tuple[str, str]], joints: Mapping[str, Joint]) -> bool:
    """Return whether a link hangs on one that a joint moves."""
    while link in parents:
        name, link = parents[link]
        if name in joints:
            return True
    return False


def replace_element(
    document: XmlDocument, owner: XmlElement, old: XmlElement | None, lines: Sequence[str]
) -> Edit:
    """Return what puts `lines` in the place of `old`, or in front of all else in `owner`."""
    source = document.source
    if old is not None:
        text = f"\n{_read_indent(source, old)}".join(lines)
        return old.offset, _locate_element_end(document, old), text
    outer = _read_indent(source, owner)
    step = "\t" if outer.endswith("\t") else "  "
    text = "".join(f"\n{outer}{step}{line}" for line in lines)
    start = locate_tag_end(source, owner.offset)
    if source[start - 2 : start] != b"/>":
        return start, start, text
    return start - 2, start, f">{text}\n{outer}</{owner.tag}>"


def remove_element(document: XmlDocument, element: XmlElement) -> Edit:
    """Return what takes an element out, with the line that it leaves empty."""
    source, start, end = document.source, element.offset, _locate_element_end(document, element)
    line = source.rfind(b"\n", 0, start)
    rest = source.find(b"\n", end)
    alone = line >= 0 and rest >= 0 and not (source[line:start] + source[end:rest]).strip()
    return (line, rest, "") if alone else (start, end, "")


def _read_indent(source: bytes, element: XmlElement) -> str:
    """Return the blanks that stand before an element in its line."""
    before = source[source.rfind(b"\n", 0, element.offset) + 1 : element.offset]
    return before.decode() if not before.strip() else "    "


def locate_tag_end(source: bytes, offset: int) -> int:
    """Return where the tag ends that begins at `offset`; values of attributes may hold what ends one."""
    while match := _QUOTED.match(source, offset):
        offset = match.end()
    return offset + 1


def _locate_element_end(document: XmlDocument, element: XmlElement) -> int:
    """Return where an element ends, with all that is in it."""
    end = locate_tag_end(document.source, element.offset)
    is_empty = document.source[end - 2 : end] == b"/>"
    return end if is_empty else locate_tag_end(document.source, document.ends[element.offset])
