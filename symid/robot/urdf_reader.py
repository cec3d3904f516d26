"""A robot from a URDF file, or the part of it from a base link to a tip link.

A path -> `Robot`, or one `RobotError` with all mistakes and their places; what symid does not use is listed
in the robot's notices. Followers (`<mimic>`) follow the last joint of their chain; links on fixed joints
become part of the links that carry them; link frames get the modified form (`canonical_frames`). A joint
that follows a fixed joint, one before the base, or with the factor 0, is at rest at its offset. One whose
master was cut off keeps a coordinate of its own. `assemble_robot` does this for MJCF models, too.

Supported: links with inertial values, joints that turn or slide, fixed joints, limits, damping and friction,
simple transmissions; the part of the tree beyond a base link, the chain up to a tip link.
Not supported: closed loops, several trees, rings of followers, floating and planar joints.
"""

import math
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from symid.errors import RobotError, shorten_names
from symid.robot import description
from symid.robot.canonical_frames import choose_canonical_frames
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    ExactVector,
    Placement,
    compose_placements,
    invert_placement,
    place_joint,
    translate,
)
from symid.robot.inertia import lump_fixed_joints, move_by_placement
from symid.robot.plausibility import PlacedBody, find_implausible
from symid.robot.toml_values import BASE, sort_notices, suggest_names
from symid.robot.urdf_parts import TreeJoint, TreeReading, read_parts
from symid.robot.urdf_xml import XmlDocument

_REMEDIES = {
    "free": "remove it, which fixes the body to the one before it",
    "ball": "write it as three hinges, or remove it",
}
_LOOP = "closed loops are not supported; leave out one of the joints and give its torque as a load"


_Tree = tuple[str, list[TreeJoint], list[TreeJoint]]
"""The base link, the joints before it, and those beyond it, parents before children."""
DEFAULT_SNAP = 1e-5
"""Angles as near as this to a multiple of pi/2 are taken as that multiple, in rad."""

_GRAVITY = Exact.of("-9.81")
_ROUNDED = 1e-9


def _read_tree(reading: TreeReading, base: str | None, tip: str | None, *, complete: bool) -> _Tree | None:
    """Return the tree, or its part from `base` to `tip`; None without one, or where it is not `complete`."""
    links, joints = reading.links, reading.joints
    # A joint that cannot be read leaves its links apart; that is not worth a second message.
    above: dict[str, TreeJoint] = {}
    for joint in joints.values():
        other = above.setdefault(joint.child, joint)
        if other is not joint:
            text = f"its child link '{joint.child}' is already the child of joint '{other.name}'"
            joint.part.refuse("robot.closed-loop", f"{text} (line {other.part.line}); {_LOOP}")
    for element in reading.document.root.find_all("loop_joint"):
        name = element.attributes.get("name", "")
        reading.refuse("robot.closed-loop", f"loop_joint '{name}': {_LOOP}", element)
    end = base or tip
    if end in links and reading.document.root.tag == "robot":
        # What does not carry the chosen part need not be whole.
        root: str | None = end
        for _ in above:
            root = above[root].parent if root in above else root
    else:
        root = _locate_root(reading, above) if complete else None
    wrong = [(name, end) for name, end in ((base, "base"), (tip, "tip")) if name and name not in links]
    for name, end in wrong:
        hint = suggest_names(name, links) or f"the links are {shorten_names(links)}"
        reading.refuse("robot.bad-cut", f"there is no link '{name}' for the {end}; {hint}")
    if root is None or wrong:
        return None
    below: dict[str, list[TreeJoint]] = {}
    for joint in above.values():
        below.setdefault(joint.parent, []).append(joint)
    reached = {root, *(joint.child for joint in _walk(root, below))}
    lost = [joint for joint in joints.values() if joint.child not in reached]
    if lost and not end:
        names = shorten_names(f"'{joint.name}'" for joint in lost)
        lost[0].part.refuse("robot.closed-loop", f"not connected to the base: {names} form a ring; {_LOOP}")
        return None
    start = base or root
    chosen = list(_walk(start, below))
    if tip is not None:
        path = _locate_path(above, start, tip)
        if path is None:
            text = f"the link '{tip}' does not come after the link '{start}'; give the base first"
            reading.refuse("robot.bad-cut", text, links[tip].part.element)
            return None
        # The joints of the path, and what is fixed to its links before the last one.
        on_path, linked = {joint.name for joint in path}, {start, *(joint.child for joint in path)}
        beyond, chosen = chosen, []
        for joint in beyond:
            fixed = joint.type == "fixed" and joint.parent in linked and joint.parent != tip
            if joint.name in on_path or fixed:
                chosen.append(joint)
                linked.add(joint.child)
    before = _locate_path(above, root, start) or []
    for joint in chosen:
        if not joint.moves and joint.type != "fixed":
            what = "a floating base" if joint.type == "floating" else f"a {joint.type} joint"
            remedy = _REMEDIES.get(joint.type, "make it fixed")
            text = f"{what} is not supported; {remedy}, or start after it with --base {joint.child}"
            joint.part.refuse("robot.joint-type", text, "type")
    if not any(joint.moves for joint in chosen) and not reading.errors:
        found = "every joint is fixed" if chosen else f"there is no joint after the link '{start}'"
        reading.refuse("robot.no-joints", f"{found}, and a robot needs one that moves")
    kept = {start, *(joint.child for joint in chosen)}
    _forget_outside(reading, kept, {joint.name for joint in (*before, *chosen)})
    if cut := [link for link in links.values() if link.name not in kept]:
        names, mass = shorten_names(link.name for link in cut), sum(link.mass for link in cut)
        text = f"outside of the chosen part, and not in the model: the links {names} ({mass:.6g} kg in all)"
        reading.warn("robot.cut-off", text, cut[0].part.element)
    return start, before, chosen


def _forget_outside(reading: TreeReading, links: set[str], joints: set[str]) -> None:
    """Drop the mistakes in elements of a URDF that have nothing to do with the chosen links and joints."""
    root, inside = reading.document.root, {"link": links, "joint": joints}
    if root.tag != "robot":
        return
    spans = []
    for element in root.find_all("link", "joint", "transmission", "loop_joint"):
        ends = [end.attributes.get("link", "") for end in element.children if "link" in end.attributes]
        names = {element.attributes.get("name", "")} & inside.get(element.tag, set())
        if element.tag == "transmission":
            names = {joint.attributes.get("name", "") for joint in element.find_all("joint")} & joints
        elif element.tag == "loop_joint":
            names = set() if set(ends) - links else {"closed"}
        elif element.tag == "joint" and not set(ends) - links:
            # A second joint between links that are here is a loop, or a mistake in the name.
            names = {"here"}
        if not names:
            spans.append((element.offset, reading.document.ends[element.offset]))
    outside = {
        notice
        for notice, element in reading.blamed.items()
        if any(begin <= element.offset <= end for begin, end in spans)
    }
    reading.errors[:] = [notice for notice in reading.errors if notice not in outside]


def _locate_root(reading: TreeReading, above: Mapping[str, TreeJoint]) -> str | None:
    robot = reading.document.root
    if not reading.joints:
        if not robot.find("joint"):
            prefixed = next((child.tag for child in robot.children if child.tag.endswith(":joint")), "")
            hint = f"; <{prefixed}> is another tag: write <joint>" if prefixed else ""
            text = f"no <joint> in the file, and a robot needs one that moves{hint}"
            reading.refuse("robot.no-joints", text)
        return None
    roots = [name for name in reading.links if name not in above]
    if not roots:
        first = next(iter(reading.joints.values())).part.element
        text = f"every link is the child of a joint, so there is no base link; {_LOOP}"
        reading.refuse("robot.closed-loop", text, first)
        return None
    for name in roots[1:]:
        text = f"link '{name}' is the child of no joint, and neither is '{roots[0]}'; a robot has one base: "
        text += "join them with a fixed joint, or remove one"
        reading.refuse("robot.several-roots", text, reading.links[name].part.element)
    return roots[0] if len(roots) == 1 else None


def _walk(start: str, below: Mapping[str, list[TreeJoint]]) -> Iterator[TreeJoint]:
    """Return the joints beyond a link, each followed by those beyond it."""
    waiting = list(reversed(below.get(start, [])))
    while waiting:
        joint = waiting.pop()
        yield joint
        waiting += reversed(below.get(joint.child, []))


def _locate_path(above: Mapping[str, TreeJoint], start: str, end: str) -> list[TreeJoint] | None:
    """Return the joints from link `start` to link `end`, None where it does not come after it."""
    path: list[TreeJoint] = []
    while end != start:
        if end not in above:
            return None
        path.append(above[end])
        end = above[end].parent
    return path[::-1]


def _resolve_mimic(
    reading: TreeReading, joint: TreeJoint, inside: set[str], standing: set[str]
) -> description.MimicStep | None:
    """Return `joint` as a follower of the last of its chain; `standing` are the joints before the base."""
    element = joint.part.element.find("mimic") or joint.part.element
    path, why = [joint.name], ""
    still = joint.name in standing
    for step in reading.steps[joint.name].follow(reading.steps):
        master = step.master or ""
        if not step.multiplier:
            why = "follow with the factor 0"
            break
        if master in path:
            ring = " -> ".join((*path[path.index(master) :], master))
            text = f"joint '{joint.name}': joints follow each other in a ring: {ring}"
            reading.refuse("robot.mimic-ring", text, element)
            return None
        path.append(master)
        still = still or master in standing
        if master not in inside and not still:
            text = "joints {}: the joint that they follow was cut off; log them as joints of their own"
            reading.group("robot.follower-free", text, f"'{joint.name}'", element)
            return None
    if not why and still:
        why = "follow a joint before the base" if joint.name in inside else ""
    elif not why and reading.joints[path[-1]].type == "fixed":
        why = "follow a fixed joint"
    if why:
        text = f"joints {{}}: {why}, and rest at their offset"
        reading.group("robot.follower-still", text, f"'{joint.name}'", element)
    return replace(step, master=None) if why or still else step


def read_urdf(document: XmlDocument, snap: float) -> tuple[TreeReading, bool]:
    """Return links and joints, and whether all of them could be read; a RobotError if it is no plain URDF."""
    root = document.root
    for element in root.walk():
        if element.tag.startswith("xacro:"):
            text = f"<{element.tag}>: this is a xacro file, a program that writes a URDF; "
            text += f"run `xacro {Path(document.file).name} > robot.urdf` and give that file"
            raise RobotError(document.locate_place(element).notice("robot.xacro", text))
    if root.tag != "robot":
        prefix = "; tags with a prefix are not read" if root.tag.endswith(":robot") else ""
        text = f"the outermost element is <{root.tag}>; that of a URDF is <robot>{prefix}"
        raise RobotError(document.locate_place(root).notice("robot.no-urdf", text))
    reading = read_parts(document, snap)
    joints, links = (len(list(root.find_all(tag))) for tag in ("joint", "link"))
    return reading, (len(reading.joints), len(reading.links)) == (joints, links)


def assemble_robot(
    reading: TreeReading,
    complete: bool,  # noqa: FBT001  the pair that a reader returns
    base: str | None,
    tip: str | None,
    gravity: ExactVector | None = None,
) -> description.Robot:
    """Return the robot of what was read, or raise a RobotError with all mistakes; see `read_xml_robot`.

    `complete`: no link or joint was left out of the `reading`, so that what is not connected is a mistake.
    `base`, `tip`: first and last link. `gravity` in the root's frame (m/s^2); None as in a URDF.
    """
    tree = _read_tree(reading, base, tip, complete=complete)
    first, before, kept = tree or ("", [], list(reading.joints.values()))
    inside, standing = ({joint.name for joint in group} for group in (kept, before))
    chained = [joint for joint in (*before, *kept) if joint.name in reading.steps]
    resolved = {joint.name: _resolve_mimic(reading, joint, inside, standing) for joint in chained}
    followers = {name: step for name, step in resolved.items() if step is not None}
    if tree is None or reading.errors:
        raise RobotError(*sort_notices(reading.errors))
    document, root = reading.document, reading.document.root
    what, link, attribute = ("URDF", "link", "name") if gravity is None else ("MJCF model", "body", "model")
    _warn_implausible(reading, first, kept)
    joints, links, fixed = _reduce_joints(reading, first, kept, followers, tip)
    # Drives that turn with several joints; joints that are at rest do not move them.
    index = {joint.name: number for number, joint in enumerate(joints)}
    reached = {joint.name for joint in (*before, *kept)}
    couplings = []
    for drive, part, stated in reading.couplings:
        if lost := [f"'{name}'" for name, _ in stated if name not in reached]:
            text = f"turns without joints that were cut off, {shorten_names(lost)}; keep them by --base, "
            text += "--tip"
            part.warn("robot.coupling-cut", text)
        terms = tuple((index[name], factor) for name, factor in stated if name in index and factor)
        couplings += [replace(drive, terms=terms)] if terms else []
    # A name that functions can be called by.
    given, file = root.attributes.get(attribute, "").strip(), Path(document.file)
    name = re.sub(r"[^A-Za-z0-9_]+", "_", given or file.stem).strip("_")
    if not name or not name[0].isalpha():
        name = f"robot_{name}".rstrip("_")
    if name != given:
        text = f'the robot is renamed to {name}: "{given}" cannot name functions'
        reading.warn("robot.renamed", text, root, attribute)
    if BASE in index:
        other = f"{BASE}_joint"
        while other in index:
            other += "_"
        text = f"joint '{BASE}' is renamed to '{other}': in a robot file '{BASE}' is the fixed base"
        reading.warn("robot.renamed", text, reading.joints[BASE].part.element, "name")
        joints = tuple(replace(one, name=other) if one.name == BASE else one for one in joints)
    # Joints before the base stand at zero, followers among them at their offset; gravity is `gravity`, or
    # down, in the file's root frame.
    outer = IDENTITY
    for joint in before:
        offset = _place_offset(joint, followers.get(joint.name), reading.snap)
        outer = compose_placements(outer, joint.origin, joint.turn, offset, invert_placement(joint.turn))
    if gravity is not None:
        back = Placement(rotation=invert_placement(outer).rotation, translation=IDENTITY.translation)
        down = compose_placements(back, translate(*gravity)).translation
    else:
        x, y, z = (_GRAVITY * entry for entry in outer.rotation[2])
        down = (x, y, z)
        words = shorten_names(f"{value.to_float():g}" for value in down)
        where = f"of link {first}{', the joints before it at 0' if before else ''}"
        text = f"a URDF states no gravity; it was taken as ({words}) m/s^2 in the frame {where}"
        reading.warn("robot.assumed-gravity", text)
    # The same for all ends of lines.
    digest = sha256(document.source.removeprefix(BOM_UTF8).replace(b"\r\n", b"\n")).hexdigest()
    made = description.SourceFile(file=document.file, sha256=digest, base=base, tip=tip, snap=reading.snap)
    return description.Robot(
        name=name,
        joints=joints,
        links=links,
        fixed=fixed,
        gravity=down,
        convention="urdf" if gravity is None else "mjcf",
        description=f"from the {what} {file.name}, whose {link} {first} is the base"
        + (f", {tip} the tip" if tip else ""),
        source=root.attributes.get(attribute, ""),
        processing=description.Processing(automatic=True),
        path=document.file,
        notices=reading.list_warnings(),
        couplings=tuple(couplings),
        made_from=made,
    )


def _warn_implausible(reading: TreeReading, first: str, kept: Sequence[TreeJoint]) -> None:
    """Warn of masses and inertias of the chosen links that do not fit the robot's size."""
    links = {first: PlacedBody("", 0.0, 0.0, reading.links[first].inertial)}
    for joint in kept:
        length = math.hypot(*(value.to_float() for value in joint.origin.translation))
        slide = max(map(abs, joint.limits.position or (0.0,))) if joint.type == "prismatic" else 0.0
        links[joint.child] = PlacedBody(joint.parent, length, slide, reading.links[joint.child].inertial)
    for name, text in find_implausible(links):
        if name:
            reading.links[name].part.warn("robot.implausible-body", text)
        else:
            reading.warn("robot.implausible-body", text)


def _place_offset(joint: TreeJoint, follower: description.MimicStep | None, snap: float) -> Placement:
    """Return how far a joint stands from its origin when its coordinate, or that of its master, is zero."""
    offset = (follower.offset if follower else ZERO) - joint.zero
    return place_joint(offset, prismatic=joint.type == "prismatic", snap=snap) if offset else IDENTITY


def _reduce_joints(
    reading: TreeReading,
    first: str,
    kept: Sequence[TreeJoint],
    followers: Mapping[str, description.MimicStep],
    tip: str | None,
) -> tuple[
    tuple[description.Joint, ...], tuple[description.LinkPlace, ...], tuple[description.FixedBody, ...]
]:
    """Return the moving joints with canonical frames, all links that move, and bodies on fixed joints."""
    index = {joint.name: number for number, joint in enumerate(kept)}
    carriers = {first: -1} | {joint.child: number for number, joint in enumerate(kept)}
    # From a link's frame here, whose z is the joint's axis, to that of the file.
    backs = {first: IDENTITY} | {joint.child: invert_placement(joint.turn) for joint in kept}
    stated = [reading.links[joint.child] for joint in kept]
    known = any(link.inertial for link in stated if not link.between)
    built, fixed = [], []
    for number, (joint, link) in enumerate(zip(kept, stated, strict=True)):
        back, follower, inertial = backs[joint.child], followers.get(joint.name), link.inertial
        if not joint.moves or (follower and follower.master is None):
            fixed.append(number)
        if inertial is None and known and joint.moves:
            link.part.group("robot.massless", "links without <inertial>: {} have no weight; add it")
            inertial = (0.0,) * 10
        mimic, spring = None, joint.spring
        if follower and follower.master is not None:
            mimic = description.Mimic(master=index[follower.master], multiplier=follower.multiplier)
        if spring is not None and follower and spring.rest is not None:
            spring = replace(spring, rest=spring.rest - follower.offset.to_float())
        offset = _place_offset(joint, follower, reading.snap)
        built.append(
            description.Joint(
                name=joint.name,
                kind=description.JointKind("prismatic" if joint.type == "prismatic" else "revolute"),
                parent=carriers[joint.parent],
                placement=compose_placements(backs[joint.parent], joint.origin, joint.turn, offset),
                inertial=inertial and move_by_placement(inertial, back),
                drive=joint.drive,
                friction=joint.friction,
                limits=joint.limits,
                mimic=mimic,
                spring=spring,
                frame=back,
            )
        )
    lumped = lump_fixed_joints(built, fixed)
    if not lumped.joints:
        place = reading.document.locate_place(reading.document.root)
        raise RobotError(place.notice("robot.no-joints", "no joint of the robot moves by itself"))
    joints = lumped.joints
    places = [(reading.joints[entry.name].child, k, entry.frame) for k, entry in enumerate(joints)]
    for frame in lumped.frames:
        part, link = reading.joints[frame.name].part, reading.links[reading.joints[frame.name].child]
        if frame.joint >= 0:
            text = "links on fixed joints became part of the links that carry them: {}"
            reading.group("robot.lumped", text, link.name, part.element)
            places.append((link.name, frame.joint, frame.placement))
        elif link.mass:
            text = "links fixed to the base: {}; their masses are not identifiable"
            reading.group("robot.fixed-to-base", text, link.name, part.element)
        if link.name == tip and frame.joint == len(joints) - 1:
            joints = (*joints[:-1], replace(joints[-1], frame=frame.placement))
    reframed = choose_canonical_frames(joints, snap=reading.snap)
    turned = [
        compose_placements(new.frame, invert_placement(old.frame))
        for new, old in zip(reframed.joints, joints, strict=True)
    ]
    links = tuple(
        description.LinkPlace(name=name, joint=k, placement=compose_placements(turned[k], place))
        for name, k, place in places
    )
    for moving, moved, tilt in zip(reframed.joints, reframed.moved_by, reframed.tilts, strict=True):
        part = reading.joints[moving.name].part
        if moved > _ROUNDED:
            text = "frames moved to right angles or parallels, keep them by --snap 0, of joints (by rad) {}"
            part.group("robot.angle-snapped", text, f"{moved:.1e}")
        if tilt:
            text = "axes that are nearly parallel to the one before, of joints (by rad) {}: if they are "
            text += "meant to be parallel, write frames and axes so; else some base parameters are poorly "
            text += "identifiable"
            part.group("robot.nearly-parallel", text, f"{tilt:.1e}")
    turns = {joint.name: turn for joint, turn in zip(joints, turned, strict=True)}

    def turn_body(body: description.FixedBody) -> description.FixedBody:
        inertial, own = (
            values and move_by_placement(values, turns[body.carrier]) for values in (body.inertial, body.own)
        )
        return replace(body, inertial=inertial, own=own)

    return reframed.joints, links, tuple(map(turn_body, lumped.bodies))
