"""A robot from a URDF file, or the part of it from a base link to a tip link.

A path -> `Robot`, or one `RobotError` with all that is wrong, each with its place. What the file says and
symid does not use is listed in the robot's notices. The joints are put in a tree, parents before children;
joints that follow others (`<mimic>`) are resolved to the joint that follows no other; links on fixed joints
become part of the links that carry them; link frames are brought to modified Denavit-Hartenberg form
(`canonical_frames`).

A joint that follows a fixed joint, one before the base, or with the factor 0, stands still at its offset.
One whose master was cut off keeps a coordinate of its own.

Supported: links with inertial values, joints that turn or slide, fixed joints, chains of followers in any
order, limits, damping and friction, simple transmissions; the part of the tree beyond a base link, the
chain up to a tip link.
Not supported: closed loops, several trees, rings of followers, floating and planar joints, xacro.
"""

import functools
import re
from collections.abc import Iterator, Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from symid.errors import Notice, RobotError
from symid.robot.canonical_frames import CanonicalFrames, choose_canonical_frames
from symid.robot.description import Joint, JointKind, Mimic, Processing, Robot
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    Placement,
    build_exact_angle,
    compose_placements,
    invert_placement,
    rotate_z,
    translate,
)
from symid.robot.inertia import Lumped, lump_fixed_joints, move_by_placement
from symid.robot.toml_values import BASE, read_text_file, suggest_names
from symid.robot.urdf_parts import UrdfJoint, UrdfLink, read_drives, read_joint_elements, read_links
from symid.robot.urdf_xml import (
    UrdfReading,
    XmlDocument,
    get_single,
    list_words,
    parse_document,
    read_decimal,
    read_name,
)

_LOOP = "closed loops are not supported; leave one of the joints out, and give its torque as a load"


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfTree:
    """The joints of a robot, parents before children: a joint's children follow it at once.

    `root` is the link at the base, `before` the joints from the file's own root to it, `cut` the links that
    do not belong to the robot.
    """

    root: str
    before: tuple[UrdfJoint, ...]
    joints: tuple[UrdfJoint, ...]
    cut: tuple[str, ...]


def read_tree(
    reading: UrdfReading,
    links: Mapping[str, UrdfLink],
    joints: Sequence[UrdfJoint],
    base: str | None,
    tip: str | None,
) -> UrdfTree | None:
    """Return the tree, or the part of it from `base` to `tip`; None where there is none."""
    # A joint that cannot be read leaves its links apart; that is not worth a second message.
    root_element = reading.document.root
    whole_file = len(joints) == len(list(root_element.find_all("joint")))
    whole_file &= len(links) == len(list(root_element.find_all("link")))
    above = _map_parents(reading, joints)
    root = _locate_root(reading, links, joints, above) if whole_file else None
    known = [_check_name(reading, links, name, option) for name, option in ((base, "base"), (tip, "tip"))]
    if root is None or not all(known):
        return None
    below: dict[str, list[UrdfJoint]] = {}
    for joint in above.values():
        below.setdefault(joint.parent, []).append(joint)
    whole = [joint.child for joint in _walk(root, below)]
    if not _check_reach(reading, joints, {root, *whole}):
        return None
    start = base or root
    chosen = list(_walk(start, below))
    if tip is not None:
        path = _locate_path(above, start, tip)
        if path is None:
            text = f"the link '{tip}' does not hang on the link '{start}'; the base comes first, then the tip"
            reading.refuse("robot.bad-cut", text, links[tip].element)
            return None
        chosen = _keep_chain(chosen, path, start)
    kept = {start, *(joint.child for joint in chosen)}
    cut = tuple(name for name in links if name not in kept)
    tree = UrdfTree(
        root=start, before=tuple(_locate_path(above, root, start) or ()), joints=tuple(chosen), cut=cut
    )
    _check_joint_types(reading, tree)
    _note_cut_links(reading, links, tree)
    return tree


def _check_name(reading: UrdfReading, links: Mapping[str, UrdfLink], name: str | None, option: str) -> bool:
    if name is None or name in links:
        return True
    hint = suggest_names(name, links) or f"the links are {list_words(links, most=12)}"
    text = f"there is no link '{name}' to be the {option}; {hint}"
    reading.refuse("robot.bad-cut", text, reading.document.root)
    return False


def _map_parents(reading: UrdfReading, joints: Sequence[UrdfJoint]) -> dict[str, UrdfJoint]:
    """Return the joint before each link; a second one closes a loop."""
    above: dict[str, UrdfJoint] = {}
    for joint in joints:
        if joint.child in above:
            other = above[joint.child]
            line = reading.document.find_place(other.element).line
            text = (
                f"joint '{joint.name}': its child link '{joint.child}' is the child of joint '{other.name}' "
                f"(line {line}) already; {_LOOP}"
            )
            reading.refuse("robot.closed-loop", text, joint.element)
            continue
        above[joint.child] = joint
    for element in reading.document.root.find_all("loop_joint"):
        name = element.attributes.get("name", "")
        reading.refuse("robot.closed-loop", f"loop_joint '{name}': {_LOOP}", element)
    return above


def _locate_root(
    reading: UrdfReading,
    links: Mapping[str, UrdfLink],
    joints: Sequence[UrdfJoint],
    above: Mapping[str, UrdfJoint],
) -> str | None:
    robot = reading.document.root
    if not joints:
        if not robot.find("joint"):
            prefixed = next((child.tag for child in robot.children if child.tag.endswith(":joint")), "")
            found = f"; <{prefixed}> is another tag: write <joint>" if prefixed else ""
            text = f"no <joint> in the file, and a robot needs one that moves{found}"
            reading.refuse("robot.no-joints", text, robot)
        return None
    roots = [name for name in links if name not in above]
    if not roots:
        text = f"every link is the child of a joint, so no link is the base; {_LOOP}"
        reading.refuse("robot.closed-loop", text, joints[0].element)
        return None
    for name in roots[1:]:
        text = (
            f"link '{name}' is the child of no joint, and neither is '{roots[0]}'; a robot has one base: "
            "join them with a fixed joint, or remove one"
        )
        reading.refuse("robot.several-roots", text, links[name].element)
    return roots[0] if len(roots) == 1 else None


def _walk(start: str, below: Mapping[str, list[UrdfJoint]]) -> Iterator[UrdfJoint]:
    """Return the joints beyond a link, each followed by those beyond it."""
    waiting = list(reversed(below.get(start, [])))
    while waiting:
        joint = waiting.pop()
        yield joint
        waiting += reversed(below.get(joint.child, []))


def _check_reach(reading: UrdfReading, joints: Sequence[UrdfJoint], reached: set[str]) -> bool:
    lost = [joint for joint in joints if joint.child not in reached]
    if lost:
        names = list_words(f"'{joint.name}'" for joint in lost)
        text = f"joint '{lost[0].name}': no way leads here from the base: {names} form a ring; {_LOOP}"
        reading.refuse("robot.closed-loop", text, lost[0].element)
    return not lost


def _locate_path(above: Mapping[str, UrdfJoint], start: str, end: str) -> list[UrdfJoint] | None:
    """Return the joints from link `start` to link `end`, None where it does not hang on it."""
    path: list[UrdfJoint] = []
    while end != start:
        if end not in above:
            return None
        path.append(above[end])
        end = above[end].parent
    return path[::-1]


def _keep_chain(joints: Sequence[UrdfJoint], path: Sequence[UrdfJoint], start: str) -> list[UrdfJoint]:
    """Return the joints of the path, and what is fixed to its links before the last one."""
    names = {joint.name for joint in path}
    links = {start, *(joint.child for joint in path)}
    last = path[-1].child if path else start
    kept = []
    for joint in joints:
        if joint.name in names:
            kept.append(joint)
        elif joint.type == "fixed" and joint.parent in links and joint.parent != last:
            kept.append(joint)
            links.add(joint.child)
    return kept


def _check_joint_types(reading: UrdfReading, tree: UrdfTree) -> None:
    for joint in tree.joints:
        if joint.moves or joint.type == "fixed":
            continue
        what = "a floating base" if joint.type == "floating" else f"a {joint.type} joint"
        text = (
            f"joint '{joint.name}': {what} is not supported; make it fixed, or start behind it with "
            f"--base {joint.child}"
        )
        reading.refuse("robot.joint-type", text, joint.element, "type")
    if tree.joints and not any(joint.moves for joint in tree.joints) and not reading.report.errors:
        text = "every joint is fixed, and a robot needs one that moves"
        reading.refuse("robot.no-joints", text, reading.document.root)
    if not tree.joints and not reading.report.errors:
        text = f"no joint stands beyond the link '{tree.root}', and a robot needs one that moves"
        reading.refuse("robot.no-joints", text, reading.document.root)


def _note_cut_links(reading: UrdfReading, links: Mapping[str, UrdfLink], tree: UrdfTree) -> None:
    if tree.cut:
        mass = sum(links[name].mass for name in tree.cut)
        text = (
            f"outside of what was asked for, and not in the model: the links {list_words(tree.cut, most=12)} "
            f"({mass:.6g} kg in all)"
        )
        reading.warn("robot.cut-off", text, links[tree.cut[0]].element)


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfMimic:
    """q = multiplier * (q of `master`) + offset; the offset alone where there is no master."""

    master: str | None
    multiplier: Fraction
    offset: Fraction


def read_urdf_mimics(
    reading: UrdfReading,
    joints: Sequence[UrdfJoint],
    kept: Sequence[UrdfJoint],
    before: Sequence[UrdfJoint] = (),
) -> dict[str, UrdfMimic]:
    """Return the followers among `kept` and `before` by name, each with a master that follows no other joint.

    Args:
        reading: where mistakes go.
        joints: all joints of the file.
        kept: the joints that belong to the robot.
        before: the joints before its base, which stand still at zero, their followers at their offset.
    """
    by_name = {joint.name: joint for joint in joints}
    direct = {joint.name: step for joint in joints if (step := _read_mimic(reading, joint, by_name))}
    inside, standing = ({joint.name for joint in group} for group in (kept, before))
    found: dict[str, UrdfMimic] = {}
    for joint in (*before, *kept):
        if joint.name in direct:
            follower = _resolve_mimic(reading, joint, direct, by_name, inside=inside, standing=standing)
            if follower is not None:
                found[joint.name] = follower
    return found


def _read_mimic(reading: UrdfReading, joint: UrdfJoint, known: Mapping[str, UrdfJoint]) -> UrdfMimic | None:
    owner = f"joint '{joint.name}'"
    element = get_single(reading, owner, joint.element, "mimic")
    if element is None:
        return None
    if not joint.moves:
        reading.skip(f"<mimic> of a {joint.type} joint", element)
        return None
    reading.skip_others(element, (), ("joint", "multiplier", "offset"))
    master = read_name(reading, owner, element, "joint", known)
    multiplier = read_decimal(reading, owner, element, "multiplier")
    offset = read_decimal(reading, owner, element, "offset")
    if master is None:
        return None
    return UrdfMimic(
        master=master,
        multiplier=Fraction(1 if multiplier is None else multiplier),
        offset=Fraction(offset or 0),
    )


def _resolve_mimic(
    reading: UrdfReading,
    joint: UrdfJoint,
    direct: Mapping[str, UrdfMimic],
    joints: Mapping[str, UrdfJoint],
    *,
    inside: AbstractSet[str],
    standing: AbstractSet[str],
) -> UrdfMimic | None:
    """Return `joint` as a follower of the last joint in its row of masters; see `read_urdf_mimics`."""
    multiplier, offset = Fraction(1), Fraction(0)
    name, path = joint.name, [joint.name]
    element = joint.element.find("mimic") or joint.element
    still, why = name in standing, ""
    while name in direct and not why:
        step = direct[name]
        offset += multiplier * step.offset
        multiplier *= step.multiplier
        name = step.master or ""
        if not multiplier:
            why = "follow with the factor 0"
        elif name in path:
            ring = " -> ".join((*path[path.index(name) :], name))
            text = f"joint '{joint.name}': joints follow each other in a ring: {ring}"
            reading.refuse("robot.mimic-ring", text, element)
            return None
        else:
            still = still or name in standing
            path.append(name)
            if name not in inside and not still:
                text = (
                    "joints {}: the joint that they follow was cut off; they have a coordinate of their own"
                )
                reading.remark("robot.follower-free", text, f"'{joint.name}'", element)
                return None
    if not why and still:
        why = "follow a joint before the base" if joint.name in inside else ""
    elif not why and joints[name].type == "fixed":
        why = "follow a fixed joint"
    if why:
        text = f"joints {{}}: {why}, and stand still at their offset"
        reading.remark("robot.follower-still", text, f"'{joint.name}'", element)
    if why or still:
        return UrdfMimic(master=None, multiplier=Fraction(0), offset=offset)
    return UrdfMimic(master=name, multiplier=multiplier, offset=offset)


DEFAULT_SNAP = 1e-5
"""Angles as near as this to a multiple of pi/2 mean it, in rad."""

_GRAVITY = (ZERO, ZERO, Exact.of("-9.81"))
_NO_MASS = (0.0,) * 10
_ROUNDED = 1e-9
_PARTS = ("link", "joint", "transmission", "loop_joint")


def read_urdf(
    path: Path, *, base: str | None = None, tip: str | None = None, snap: float = DEFAULT_SNAP
) -> Robot:
    """Return the robot that the URDF at `path` describes.

    Args:
        path: the file.
        base: the link to start from; the file's own root if None.
        tip: the link to end at; all branches belong to the robot if None. Where it is fixed to the last
            moving link, its frame becomes that link's `Joint.frame`.
        snap: angle in rad within which rotations are moved to multiples of pi/2; zero turns that off.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    return parse_urdf(read_text_file(path), str(path), base=base, tip=tip, snap=snap)


def parse_urdf(
    text: str,
    file: str = "robot.urdf",
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float = DEFAULT_SNAP,
) -> Robot:
    """Return the robot that `text` describes; messages call the text `file`. See `read_urdf`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    document = parse_document(text, file)
    _check_language(document)
    reading = UrdfReading.of(document)
    namespaces = (name for name in document.root.attributes if name.startswith("xmlns"))
    reading.skip_others(document.root, _PARTS, ("name", *namespaces))
    links = read_links(reading)
    joints = read_joint_elements(reading, links, snap)
    drives = read_drives(reading, {joint.name: joint for joint in joints})
    tree = read_tree(reading, links, joints, base, tip)
    kept, before = (tree.joints, tree.before) if tree else (joints, ())
    followers = read_urdf_mimics(reading, joints, kept, before)
    if tree is None or reading.report.errors:
        raise RobotError(*reading.report.notices())
    whole = _build_joints(reading, links, tree, followers, snap)
    fixed = [
        index
        for index, joint in enumerate(tree.joints)
        if not joint.moves or (joint.name in followers and followers[joint.name].master is None)
    ]
    whole = [replace(joint, drive=drives.get(joint.name, joint.drive)) for joint in whole]
    lumped = lump_fixed_joints(whole, fixed)
    _note_lumped_links(reading, links, tree, lumped)
    if not lumped.joints:
        text = "no joint of the robot moves by itself"
        raise RobotError(Notice(code="robot.no-joints", text=text, file=file, line=1, column=1))
    reframed = choose_canonical_frames(_set_tip_frame(tip, tree, lumped), snap=snap)
    _note_moved_axes(reading, tree, reframed)
    gravity = _compute_gravity(reading, tree, followers, snap)
    return Robot(
        name=_read_name(reading, Path(file).stem),
        joints=_rename_base(reading, tree, reframed.joints),
        gravity=gravity,
        convention="urdf",
        description=f"from the URDF {Path(file).name}, whose link {tree.root} is the base"
        + (f", {tip} the tip" if tip else ""),
        source=document.root.attributes.get("name", ""),
        processing=Processing(automatic=True),
        path=file,
        notices=reading.list_remarks(),
    )


def _check_language(document: XmlDocument) -> None:
    """Refuse what is XML and no URDF."""
    for element in document.root.walk():
        if element.tag.startswith("xacro:"):
            place = document.find_place(element)
            text = (
                f"<{element.tag}>: this is a xacro file, a program that writes a URDF; "
                f"run `xacro {Path(document.file).name} > robot.urdf` and give that file"
            )
            raise RobotError(place.notice("robot.xacro", text))
    root = document.root
    if root.tag != "robot":
        place = document.find_place(root)
        prefix = "; tags with a prefix are not read" if root.tag.endswith(":robot") else ""
        text = f"the outermost element is <{root.tag}>; that of a URDF is <robot>{prefix}"
        raise RobotError(place.notice("robot.no-urdf", text))


def _read_name(reading: UrdfReading, stem: str) -> str:
    """Return a name that functions can be called by."""
    element = reading.document.root
    given = element.attributes.get("name", "").strip()
    name = re.sub(r"[^A-Za-z0-9_]+", "_", given or stem).strip("_")
    if not name or not name[0].isalpha():
        name = f"robot_{name}".rstrip("_")
    if name != given:
        text = f'the robot is called {name}: functions cannot be named by "{given}"'
        reading.warn("robot.renamed", text, element, "name")
    return name


def _build_joints(
    reading: UrdfReading,
    links: Mapping[str, UrdfLink],
    tree: UrdfTree,
    followers: Mapping[str, UrdfMimic],
    snap: float,
) -> list[Joint]:
    """Return all joints of the tree, fixed ones too, with z as their axis."""
    index = {joint.name: number for number, joint in enumerate(tree.joints)}
    carriers = {tree.root: -1} | {joint.child: number for number, joint in enumerate(tree.joints)}
    inertials = _collect_inertials(reading, links, tree)
    # From a link's frame here, whose z is the joint's axis, to that of the file.
    backs = {tree.root: IDENTITY} | {joint.child: invert_placement(joint.turn) for joint in tree.joints}
    found = []
    for joint, inertial in zip(tree.joints, inertials, strict=True):
        back = backs[joint.child]
        follower = followers.get(joint.name)
        mimic = None
        if follower and follower.master is not None:
            mimic = Mimic(master=index[follower.master], multiplier=follower.multiplier)
        built = Joint(
            name=joint.name,
            kind=JointKind.PRISMATIC if joint.type == "prismatic" else JointKind.REVOLUTE,
            parent=carriers[joint.parent],
            placement=_compose_all(
                backs[joint.parent], joint.origin, joint.turn, _place_offset(joint, follower, snap)
            ),
            inertial=inertial and move_by_placement(inertial, back),
            friction=joint.friction,
            limits=joint.limits,
            mimic=mimic,
            frame=back,
        )
        found.append(built)
    return found


def _collect_inertials(
    reading: UrdfReading, links: Mapping[str, UrdfLink], tree: UrdfTree
) -> list[tuple[float, ...] | None]:
    """Return the parameters of the joints' links; without any in the file all are unknown, else zero."""
    inertials = [links[joint.child].inertial for joint in tree.joints]
    if not any(inertials):
        return inertials
    for number, joint in enumerate(tree.joints):
        if inertials[number] is None and joint.moves:
            name, element = f"'{joint.child}'", links[joint.child].element
            reading.remark("robot.massless", "links without <inertial>: {} have no mass", name, element)
            inertials[number] = _NO_MASS
    return inertials


def _compose_all(*placements: Placement) -> Placement:
    return functools.reduce(compose_placements, (each for each in placements if each != IDENTITY), IDENTITY)


def _place_offset(joint: UrdfJoint, follower: UrdfMimic | None, snap: float) -> Placement:
    """Return how far a follower stands from zero when its master is at zero."""
    if follower is None or not follower.offset:
        return IDENTITY
    if joint.type == "prismatic":
        return translate(ZERO, ZERO, Exact.surd(follower.offset))
    return rotate_z(build_exact_angle(float(follower.offset), snap=snap))


def _note_lumped_links(
    reading: UrdfReading, links: Mapping[str, UrdfLink], tree: UrdfTree, lumped: Lumped
) -> None:
    by_name = {joint.name: joint for joint in tree.joints}
    for frame in lumped.frames:
        joint = by_name[frame.name]
        link = links[joint.child]
        if frame.carrier >= 0:
            text = "links on fixed joints became part of the links that carry them: {}"
            reading.remark("robot.lumped", text, link.name, joint.element)
        elif link.mass:
            text = "links fixed to the base: {}; no motion shows their masses"
            reading.remark("robot.fixed-to-base", text, link.name, joint.element)


def _set_tip_frame(tip: str | None, tree: UrdfTree, lumped: Lumped) -> tuple[Joint, ...]:
    """Return the joints, the last link's frame being that of the tip link, where it is fixed to it."""
    ends = {joint.name for joint in tree.joints if joint.child == tip}
    for frame in lumped.frames:
        if frame.name in ends and frame.carrier == len(lumped.joints) - 1:
            return (*lumped.joints[:-1], replace(lumped.joints[-1], frame=frame.placement))
    return lumped.joints


def _note_moved_axes(reading: UrdfReading, tree: UrdfTree, reframed: CanonicalFrames) -> None:
    elements = {joint.name: joint.element for joint in tree.joints}
    for joint, moved, tilt in zip(reframed.joints, reframed.moved_by, reframed.tilts, strict=True):
        name, element = f"'{joint.name}'", elements[joint.name]
        if moved > _ROUNDED:
            text = "axes or link frames were moved to right angles or parallels, of joints (by rad) {}"
            reading.remark("robot.angle-snapped", text, f"{name} ({moved:.1e})", element)
        if tilt:
            text = (
                "axes that are nearly parallel to the one before, of joints (by rad) {}: if they are meant "
                "to be parallel, write rpy and axis so; else expect base parameters that motions hardly show"
            )
            reading.remark("robot.nearly-parallel", text, f"{name} ({tilt:.1e})", element)


def _rename_base(reading: UrdfReading, tree: UrdfTree, joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Return the joints without one called base, which is what robot files call the first joint's parent."""
    names = {joint.name for joint in joints}
    name = f"{BASE}_joint"
    while name in names:
        name += "_"
    for index, joint in enumerate(joints):
        if joint.name == BASE:
            element = next(entry.element for entry in tree.joints if entry.name == BASE)
            text = f"joint '{BASE}' is called '{name}' here: in a robot file '{BASE}' is what stands still"
            reading.warn("robot.renamed", text, element, "name")
            return (*joints[:index], replace(joint, name=name), *joints[index + 1 :])
    return joints


def _compute_gravity(
    reading: UrdfReading, tree: UrdfTree, followers: Mapping[str, UrdfMimic], snap: float
) -> tuple[Exact, Exact, Exact]:
    """Return gravity in the base link's frame: down in the file's root frame.

    Joints before the base stand at zero, followers among them at their offset.
    """
    outer = IDENTITY
    for joint in tree.before:
        outer = compose_placements(outer, joint.origin)
        offset = _place_offset(joint, followers.get(joint.name), snap)
        if offset != IDENTITY:
            outer = _compose_all(outer, joint.turn, offset, invert_placement(joint.turn))
    down = Placement(rotation=IDENTITY.rotation, translation=_GRAVITY)
    turned = Placement(rotation=outer.rotation, translation=IDENTITY.translation)
    gravity = compose_placements(invert_placement(turned), down).translation
    words = list_words(f"{value.to_float():g}" for value in gravity)
    where = f"of link {tree.root}" if not tree.before else f"of link {tree.root}, the joints before it at 0"
    text = f"a URDF states no gravity; it was taken as ({words}) m/s^2 in the frame {where}"
    reading.warn("robot.assumed-gravity", text, reading.document.root)
    return gravity
