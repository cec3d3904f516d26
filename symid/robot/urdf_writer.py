"""A robot as a URDF, new or with the robot's own file kept; and the XML texts that URDF and MJCF share.

`write_urdf`: a robot -> the text. The base is the link `base`; each joint moves the link `<joint>_link`,
whose frame is the link frame used here: the axis is z. Numbers have all digits of a double. Inertia is
about the centre of mass; a link of unknown values has no <inertial>. Limits that are unknown stand as 0: a
URDF must state them, and symid reads 0 as unknown.

`rewrite_urdf`: the text of a URDF and the robot read from it, with new values -> the text with new
inertias, friction and rotors. Names, frames, shapes, comments and the order of everything stay, letter by
letter. Links fixed to a moving one were read as parts of it: its values hold for all of them together, and
theirs are taken out. Inertia is written about the centre of mass, along the axes of the link's own frame.

Supported: placements, inertial values, limits, damping and friction that are alike in both directions (the
mean of a model that tells directions apart), followers, gears and rotor inertia. Rewriting: whole robots,
read without a link to start from or to end at.
Not supported, and said in a comment: symbols (their values are written), other gravity than (0, 0, -9.81),
other friction, springs, elastic joints, drives coupled to several joints. Rotor inertia stands in
<transmission>, which simulators pass over; a comment has it on the joint's side.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from symid.robot.description import Coupling, FrictionKind, FrictionValues, Joint, JointKind, Robot
from symid.robot.elasticity import Elasticity
from symid.robot.geometry import Placement, to_floats
from symid.robot.inertia import move_by_placement, split_body
from symid.robot.toml_friction import FRICTION_PARAMETERS, FRICTION_SHAPES, name_values
from symid.robot.toml_values import BASE
from symid.robot.urdf_parts import ROTORS
from symid.robot.urdf_xml import XmlElement, parse_document

_UNFIT = re.compile(r"[\x00-\x1f\ufffe\uffff]")
# Parameters that make up the plain part, one name or one for each direction.
_DAMPING, _DRY = ("Fv", "Fvp", "Fvn"), ("Fc", "Fcp", "Fcn")
_PLAIN = frozenset({FrictionKind.NONE, FrictionKind.VISCOUS_COULOMB})


@dataclass(frozen=True, slots=True, kw_only=True)
class ViscousCoulomb:
    """Friction damping dq + dry sign(dq): N m s/rad and N m, or N s/m and N."""

    damping: float
    dry: float


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


def get_viscous_coulomb(friction: FrictionValues) -> ViscousCoulomb | None:
    """Return the part of a friction model that is damping and dry friction; None where nothing is known.

    Of a model that tells directions apart it is their mean.
    """
    if friction.kind is FrictionKind.NONE or friction.values is None:
        return None
    named = name_values(friction)
    damping, dry = ([named[name] for name in names if name in named] or [0.0] for names in (_DAMPING, _DRY))
    return ViscousCoulomb(damping=sum(damping) / len(damping), dry=sum(dry) / len(dry))


def list_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    """Yield what of a friction model is more than damping and dry friction, with all its values."""
    if friction.kind is not FrictionKind.NONE and friction.values is None:
        yield f"{owner}: friction of unknown size ({friction.kind.value})"
    elif friction.kind not in _PLAIN:
        names = [", ".join(FRICTION_PARAMETERS[friction.kind])]
        text = (
            f"{owner}: friction model {friction.kind.value}, values {write_decimals(friction.values or ())}"
        )
        if friction.shape:
            text += f", shape {write_decimals(friction.shape)}"
            names.append(", ".join(key.name for key in FRICTION_SHAPES[friction.kind]))
        text += f" ({'; '.join(names)})"
        yield f"{text}; only its damping and dry friction, alike in both directions, are written"
    if friction.smoothing:
        yield f"{owner}: dry friction changes its sign over {friction.smoothing}"


def list_elastic_omissions(joint: Joint) -> Iterator[str]:
    """Yield the spring between motor and link of an elastic joint."""
    if joint.elasticity is not None:
        yield f"joint {joint.name}: elastic, {_describe_elasticity(joint.elasticity)}; it is written as rigid"


def _describe_elasticity(elasticity: Elasticity) -> str:
    parts = [str(elasticity.stiffness)]
    parts += [f"damping {elasticity.damping}"] if elasticity.damping else []
    parts += [f"cubic {elasticity.cubic}"] if elasticity.cubic else []
    parts += [f"stop of {stop.stiffness} to {stop.threshold}" for stop in elasticity.stops]
    parts += [f"knee of {knee.slope} at {knee.threshold}" for knee in elasticity.knees]
    return ", ".join(parts)


def describe_coupling(robot: Robot, coupling: Coupling) -> str:
    """Return which joints a drive turns with, and what it holds."""
    names = ", ".join(f"{float(factor):g} {robot.joints[index].name}" for index, factor in coupling.terms)
    text = f"a drive coupled to several joints, {coupling.name}: {names}"
    if coupling.rotor_inertia is not None:
        text += f", rotor inertia {coupling.rotor_inertia}"
    if coupling.friction.values:
        values = write_decimals(coupling.friction.values)
        text += f", friction {values} ({', '.join(FRICTION_PARAMETERS[coupling.friction.kind])})"
    return text


_GRAVITY = (0.0, 0.0, -9.81)
_BASE = "base"
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def write_urdf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the URDF of `robot`.

    Args:
        robot: the robot.
        comments: texts for the head of the file.
    """
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={write_quoted(robot.name)}>"]
    symbols = [f"{name} = {write_decimal(value)} m" for name, value in robot.symbols]
    lines += write_comments([*comments, *symbols, *list_urdf_omissions(robot)])
    lines.append(f'  <link name="{_BASE}"/>')
    for joint in robot.joints:
        lines += _write_link(joint)
        lines += _write_joint(robot, joint)
    for joint in robot.joints:
        lines += _write_transmission(joint)
    return "\n".join((*lines, "</robot>", ""))


def list_urdf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what a URDF has no words for, or simulators no eye for; the file has it in comments."""
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


def _compute_rpy(placement: Placement) -> tuple[float, float, float]:
    """Return roll, pitch, yaw with Rot(z, yaw) Rot(y, pitch) Rot(x, roll) = R; roll 0 where it is free."""
    r = to_floats(placement)
    across = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], across)
    if not across:
        return (0.0, pitch, math.atan2(-r[0][1], r[1][1]))
    return (math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0]))


def write_inertial(parameters: Sequence[float]) -> list[str]:
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


def _write_link(joint: Joint) -> Iterator[str]:
    if joint.inertial is None:
        yield f"  <link name={_link(joint.name)}/>"
        return
    yield f"  <link name={_link(joint.name)}>"
    yield from (f"    {line}" for line in write_inertial(joint.inertial))
    yield "  </link>"


def _write_joint(robot: Robot, joint: Joint) -> Iterator[str]:
    symbols = dict(robot.symbols)
    parent = _link(robot.joints[joint.parent].name) if joint.parent >= 0 else f'"{_BASE}"'
    xyz = [value.to_float(symbols) for value in joint.placement.translation]
    yield f'  <joint name={write_quoted(joint.name)} type="{_choose_joint_type(joint)}">'
    yield f'    <origin xyz="{write_decimals(xyz)}" rpy="{write_decimals(_compute_rpy(joint.placement))}"/>'
    yield f"    <parent link={parent}/>"
    yield f"    <child link={_link(joint.name)}/>"
    yield '    <axis xyz="0 0 1"/>'
    low, high = joint.limits.position or (0.0, 0.0)
    ends = (
        ""
        if _choose_joint_type(joint) == "continuous"
        else f'lower="{write_decimal(low)}" upper="{write_decimal(high)}" '
    )
    effort, velocity = joint.limits.torque or 0.0, joint.limits.velocity or 0.0
    yield f'    <limit {ends}effort="{write_decimal(effort)}" velocity="{write_decimal(velocity)}"/>'
    friction = get_viscous_coulomb(joint.friction)
    if friction is not None:
        damping, dry = write_decimal(friction.damping), write_decimal(friction.dry)
        yield f'    <dynamics damping="{damping}" friction="{dry}"/>'
    if joint.mimic is not None:
        master = write_quoted(robot.joints[joint.mimic.master].name)
        factor = write_decimal(float(joint.mimic.multiplier))
        yield f'    <mimic joint={master} multiplier="{factor}" offset="0.0"/>'
    yield "  </joint>"


def _choose_joint_type(joint: Joint) -> str:
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


# What can stand between tags and hold what looks like one.
_ASIDE = re.compile(rb"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|(</)", re.DOTALL)
_QUOTED = re.compile(rb"[^>\"']|\"[^\"]*\"|'[^']*'")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edit:
    """Bytes from `start` to `end` of the file, and what comes in their place."""

    start: int
    end: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _UrdfFile:
    """The file, and its joints as symid knows them, by the name of the joint and of the link they move."""

    source: bytes
    root: XmlElement
    joints: Mapping[str, Joint]
    links: Mapping[str, Joint]
    lumped: frozenset[str]


def rewrite_urdf(text: str, robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the URDF `text` with the values of `robot`.

    Args:
        text: the file that the robot was read from.
        robot: the same robot, links with values.
        comments: texts for the head of the file.

    Raises:
        RobotError: the text is no XML.
    """
    file = _parse_file(text, robot)
    edits = [*_edit_links(file), *_edit_joints(file), *_edit_rotors(file)]
    head = "".join(f"\n{line}" for line in write_comments([*comments, *list_urdf_omissions(robot)]))
    start = _locate_tag_end(file.source, file.root.offset)
    edits.append(_Edit(start=start, end=start, text=head))
    result = file.source
    for edit in sorted(edits, key=lambda entry: entry.start, reverse=True):
        result = result[: edit.start] + edit.text.encode() + result[edit.end :]
    return result.decode(errors="surrogatepass")


def _parse_file(text: str, robot: Robot) -> _UrdfFile:
    document = parse_document(text, robot.path)
    elements = list(document.root.find_all("joint"))
    names = [element.attributes.get("name", "") for element in elements]
    joints = {joint.name: joint for joint in robot.joints}
    # The reader gives another name to a joint that is called as the base of robot files is.
    strangers = [joint for joint in robot.joints if joint.name not in names]
    if strangers and BASE in names:
        joints[BASE] = strangers[0]
    parents: dict[str, tuple[str, str]] = {}
    for element, name in zip(elements, names, strict=True):
        parents[_get_end_link(element, "child")] = (name, _get_end_link(element, "parent"))
    links = {link: joints[name] for link, (name, _) in parents.items() if name in joints}
    lumped = frozenset(link for link in parents if link not in links and _is_carried(link, parents, links))
    return _UrdfFile(source=document.source, root=document.root, joints=joints, links=links, lumped=lumped)


def _get_end_link(joint: XmlElement, tag: str) -> str:
    end = joint.find(tag)
    return end.attributes.get("link", "") if end is not None else ""


def _is_carried(link: str, parents: Mapping[str, tuple[str, str]], links: Mapping[str, Joint]) -> bool:
    """Return whether a link that does not move by itself hangs on one that does."""
    while link in parents:
        if link in links:
            return True
        link = parents[link][1]
    return False


def _edit_links(file: _UrdfFile) -> Iterator[_Edit]:
    for link in file.root.find_all("link"):
        name = link.attributes.get("name", "")
        old = link.find("inertial")
        joint = file.links.get(name)
        if joint is not None and joint.inertial is not None:
            # In the frame that the file gives to the link.
            values = move_by_placement(joint.inertial, joint.frame, inverse=True)
            yield from _replace(file.source, link, old, write_inertial(values))
        elif name in file.lumped and old is not None:
            yield _remove(file.source, old)


def _edit_joints(file: _UrdfFile) -> Iterator[_Edit]:
    for element in file.root.find_all("joint"):
        joint = file.joints.get(element.attributes.get("name", ""))
        friction = get_viscous_coulomb(joint.friction) if joint is not None else None
        if friction is not None:
            damping, dry = write_decimal(friction.damping), write_decimal(friction.dry)
            lines = [f'<dynamics damping="{damping}" friction="{dry}"/>']
            yield from _replace(file.source, element, element.find("dynamics"), lines)


def _edit_rotors(file: _UrdfFile) -> Iterator[_Edit]:
    for transmission in file.root.find_all("transmission"):
        end, actuator = transmission.find("joint"), transmission.find("actuator")
        joint = file.joints.get(end.attributes.get("name", "")) if end is not None else None
        if joint is None or actuator is None or joint.drive.rotor_inertia is None:
            continue
        value = write_decimal(joint.drive.rotor_inertia / joint.drive.gear**2)
        for rotor in actuator.find_all(*ROTORS):
            lines = [f"<{rotor.tag}>{value}</{rotor.tag}>"]
            yield from _replace(file.source, actuator, rotor, lines)


def _replace(
    source: bytes, owner: XmlElement, old: XmlElement | None, lines: Sequence[str]
) -> Iterator[_Edit]:
    """Yield what puts `lines` in the place of `old`, or in front of all else in `owner`."""
    if old is not None:
        indent = _read_indent(source, old)
        text = f"\n{indent}".join(lines)
        yield _Edit(start=old.offset, end=_locate_element_end(source, old), text=text)
        return
    outer = _read_indent(source, owner)
    text = "".join(f"\n{outer}  {line}" for line in lines)
    start = _locate_tag_end(source, owner.offset)
    if source[start - 2 : start] != b"/>":
        yield _Edit(start=start, end=start, text=text)
    else:
        yield _Edit(start=start - 2, end=start, text=f">{text}\n{outer}</{owner.tag}>")


def _remove(source: bytes, element: XmlElement) -> _Edit:
    """Return what takes an element out, with the line that it leaves empty."""
    start, end = element.offset, _locate_element_end(source, element)
    line = source.rfind(b"\n", 0, start)
    rest = source.find(b"\n", end)
    alone = line >= 0 and rest >= 0 and not (source[line:start] + source[end:rest]).strip()
    return _Edit(start=line if alone else start, end=rest if alone else end, text="")


def _read_indent(source: bytes, element: XmlElement) -> str:
    """Return the blanks that stand before an element in its line."""
    before = source[source.rfind(b"\n", 0, element.offset) + 1 : element.offset]
    return before.decode() if not before.strip() else "    "


def _locate_tag_end(source: bytes, offset: int) -> int:
    """Return where the tag ends that begins at `offset`; values of attributes may hold what ends one."""
    while match := _QUOTED.match(source, offset):
        offset = match.end()
    return offset + 1


def _locate_element_end(source: bytes, element: XmlElement) -> int:
    """Return where an element ends, with all that is in it."""
    end = _locate_tag_end(source, element.offset)
    if source[end - 2 : end] == b"/>":
        return end
    for child in element.children:
        end = _locate_element_end(source, child)
    while (match := _ASIDE.search(source, end)) and not match[1]:
        end = match.end()
    return _locate_tag_end(source, match.start()) if match else len(source)
