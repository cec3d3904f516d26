"""A robot from a URDF file.

Input: a path, and the links to start from and to end at, where only a part is wanted. Output: `Robot`, or one
`RobotError` with all that is wrong, each with its place. What the file says and symid does not use is listed
in the robot's notices.

Supported: links with inertial values, joints that turn or slide, fixed joints (their links become part of the
links that carry them), joints that follow others, limits, damping and friction, simple transmissions. Link
frames are brought to the form of modified Denavit and Hartenberg (`reframing`).
Not supported: closed loops, floating and planar joints, xacro.
"""

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from symid.errors import Notice, RobotError
from symid.formats.section import BASE
from symid.formats.text_file import read_text_file
from symid.formats.urdf_drives import read_drives
from symid.formats.urdf_elements import Document, parse_document
from symid.formats.urdf_joints import UrdfJoint, read_joint_elements
from symid.formats.urdf_links import UrdfLink, read_links
from symid.formats.urdf_mimics import Follower, read_followers
from symid.formats.urdf_tree import UrdfTree, read_tree
from symid.formats.urdf_values import Reading, list_words
from symid.robot.axis_frames import invert_placement, to_floats
from symid.robot.description import Joint, JointKind, Mimic, Robot
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    Placement,
    compose_placements,
    find_angle,
    rotate_z,
    translate,
)
from symid.robot.inertia import move_parameters
from symid.robot.log_map import Processing
from symid.robot.lumping import Lumped, lump_fixed
from symid.robot.reframing import Reframed, reframe_joints

__all__ = ["SNAP", "parse_urdf", "read_urdf"]

SNAP = 1e-5
"""Angles as near as this to a multiple of pi/2 mean it, in rad."""

_GRAVITY = (ZERO, ZERO, Exact.of("-9.81"))
_NOTHING = (0.0,) * 10
_ROUNDED = 1e-9
_PARTS = ("link", "joint", "transmission", "loop_joint")


def read_urdf(path: Path, *, base: str | None = None, tip: str | None = None, snap: float = SNAP) -> Robot:
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
    snap: float = SNAP,
) -> Robot:
    """Return the robot that `text` describes; messages call the text `file`. See `read_urdf`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    document = parse_document(text, file)
    _check_language(document)
    reading = Reading.of(document)
    namespaces = (name for name in document.root.attributes if name.startswith("xmlns"))
    reading.skip_others(document.root, _PARTS, ("name", *namespaces))
    links = read_links(reading)
    joints = read_joint_elements(reading, links, snap)
    drives = read_drives(reading, {joint.name: joint for joint in joints})
    tree = read_tree(reading, links, joints, base, tip)
    kept, before = (tree.joints, tree.before) if tree else (joints, ())
    followers = read_followers(reading, joints, kept, before)
    if tree is None or reading.report.errors:
        raise RobotError(*reading.report.notices())
    whole = _build_joints(reading, links, tree, followers, snap)
    fixed = [
        index
        for index, joint in enumerate(tree.joints)
        if not joint.moves or (joint.name in followers and followers[joint.name].master is None)
    ]
    whole = [replace(joint, drive=drives.get(joint.name, joint.drive)) for joint in whole]
    lumped = lump_fixed(whole, fixed)
    _say_lumped(reading, links, tree, lumped)
    if not lumped.joints:
        text = "no joint of the robot moves by itself"
        raise RobotError(Notice(code="robot.no-joints", text=text, file=file, line=1, column=1))
    reframed = reframe_joints(_end_at(tip, tree, lumped), snap=snap)
    _say_moved(reading, tree, reframed)
    gravity = _find_gravity(reading, tree, followers, snap)
    return Robot(
        name=_read_name(reading, Path(file).stem),
        joints=_rename_base(reading, tree, reframed.joints),
        gravity=gravity,
        convention="urdf",
        description=_describe(Path(file).name, tree, tip),
        source=document.root.attributes.get("name", ""),
        processing=Processing(automatic=True),
        path=file,
        notices=reading.list_remarks(),
    )


def _check_language(document: Document) -> None:
    """Refuse what is XML and no URDF."""
    for element in document.root.walk():
        if element.tag.startswith("xacro:"):
            place = document.find_place(element)
            text = (
                f"<{element.tag}>: this is a xacro file, a program that writes a URDF; "
                f"run `xacro {Path(document.file).name} > robot.urdf` and give that file"
            )
            raise RobotError(
                Notice(
                    code="robot.xacro", text=text, file=document.file, line=place.line, column=place.column
                )
            )
    root = document.root
    if root.tag != "robot":
        place = document.find_place(root)
        prefix = "; tags with a prefix are not read" if root.tag.endswith(":robot") else ""
        text = f"the outermost element is <{root.tag}>; that of a URDF is <robot>{prefix}"
        raise RobotError(
            Notice(code="robot.no-urdf", text=text, file=document.file, line=place.line, column=place.column)
        )


def _read_name(reading: Reading, stem: str) -> str:
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
    reading: Reading,
    links: Mapping[str, UrdfLink],
    tree: UrdfTree,
    followers: Mapping[str, Follower],
    snap: float,
) -> list[Joint]:
    """Return all joints of the tree, fixed ones too, with z as their axis."""
    index = {joint.name: number for number, joint in enumerate(tree.joints)}
    carriers = {tree.root: -1} | {joint.child: number for number, joint in enumerate(tree.joints)}
    inertials = _find_inertials(reading, links, tree)
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
            placement=_chain(
                backs[joint.parent], joint.origin, joint.turn, _place_offset(joint, follower, snap)
            ),
            inertial=inertial and _turn(inertial, back),
            friction=joint.friction,
            limits=joint.limits,
            mimic=mimic,
            frame=back,
        )
        found.append(built)
    return found


def _find_inertials(
    reading: Reading, links: Mapping[str, UrdfLink], tree: UrdfTree
) -> list[tuple[float, ...] | None]:
    """Return the parameters of the joints' links; without any in the file all are unknown, else zero."""
    inertials = [links[joint.child].inertial for joint in tree.joints]
    if not any(inertials):
        return inertials
    for number, joint in enumerate(tree.joints):
        if inertials[number] is None and joint.moves:
            name, element = f"'{joint.child}'", links[joint.child].element
            reading.remark("robot.massless", "links without <inertial>: {} have no mass", name, element)
            inertials[number] = _NOTHING
    return inertials


def _chain(*placements: Placement) -> Placement:
    return functools.reduce(compose_placements, (each for each in placements if each != IDENTITY), IDENTITY)


def _turn(parameters: Sequence[float], frame: Placement) -> tuple[float, ...]:
    if frame == IDENTITY:
        return tuple(parameters)
    return move_parameters(parameters, np.array(to_floats(frame)), np.zeros(3))


def _place_offset(joint: UrdfJoint, follower: Follower | None, snap: float) -> Placement:
    """Return how far a follower stands from zero when its master is at zero."""
    if follower is None or not follower.offset:
        return IDENTITY
    if joint.type == "prismatic":
        return translate(ZERO, ZERO, Exact.surd(follower.offset))
    return rotate_z(find_angle(float(follower.offset), snap=snap))


def _say_lumped(reading: Reading, links: Mapping[str, UrdfLink], tree: UrdfTree, lumped: Lumped) -> None:
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


def _end_at(tip: str | None, tree: UrdfTree, lumped: Lumped) -> tuple[Joint, ...]:
    """Return the joints, the last link's frame being that of the tip link, where it is fixed to it."""
    ends = {joint.name for joint in tree.joints if joint.child == tip}
    for frame in lumped.frames:
        if frame.name in ends and frame.carrier == len(lumped.joints) - 1:
            return (*lumped.joints[:-1], replace(lumped.joints[-1], frame=frame.placement))
    return lumped.joints


def _say_moved(reading: Reading, tree: UrdfTree, reframed: Reframed) -> None:
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


def _rename_base(reading: Reading, tree: UrdfTree, joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
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


def _describe(file: str, tree: UrdfTree, tip: str | None) -> str:
    end = f", {tip} the tip" if tip else ""
    return f"from the URDF {file}, whose link {tree.root} is the base{end}"


def _find_gravity(
    reading: Reading, tree: UrdfTree, followers: Mapping[str, Follower], snap: float
) -> tuple[Exact, Exact, Exact]:
    """Return gravity in the base link's frame: down in the file's root frame.

    Joints before the base stand at zero, followers among them at their offset.
    """
    outer = IDENTITY
    for joint in tree.before:
        outer = compose_placements(outer, joint.origin)
        offset = _place_offset(joint, followers.get(joint.name), snap)
        if offset != IDENTITY:
            outer = _chain(outer, joint.turn, offset, invert_placement(joint.turn))
    down = Placement(rotation=IDENTITY.rotation, translation=_GRAVITY)
    turned = Placement(rotation=outer.rotation, translation=IDENTITY.translation)
    gravity = compose_placements(invert_placement(turned), down).translation
    words = list_words(f"{value.to_float():g}" for value in gravity)
    where = f"of link {tree.root}" if not tree.before else f"of link {tree.root}, the joints before it at 0"
    text = f"a URDF states no gravity; it was taken as ({words}) m/s^2 in the frame {where}"
    reading.warn("robot.assumed-gravity", text, reading.document.root)
    return gravity
