"""A URDF with other values: the robot's own file as it is, but for inertias, friction and rotors.

Input: the text of a URDF, the robot that was read from it, with new values. Output: the text with them.

Names, frames, shapes, comments and the order of everything stay as they are, letter by letter. Links that
are fixed to a moving one were read as parts of it: its values hold for all of them together, and theirs are
taken out.

Supported: whole robots, as `read_urdf` reads them without a link to start from or to end at. Inertia is
written about the centre of mass, along the axes of the link's own frame.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.formats.section import BASE
from symid.formats.simulator_texts import find_plain_friction, write_comments, write_decimal
from symid.formats.urdf_drives import ROTORS
from symid.formats.urdf_elements import Element, parse_document
from symid.formats.urdf_writer import list_urdf_omissions, write_inertial
from symid.robot.description import Joint, Robot
from symid.robot.inertia import move_parameters

__all__ = ["rewrite_urdf"]

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
class _File:
    """The file, and its joints as symid knows them, by the name of the joint and of the link they move."""

    source: bytes
    root: Element
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
    file = _read_file(text, robot)
    edits = [*_edit_links(file), *_edit_joints(file), *_edit_rotors(file)]
    head = "".join(f"\n{line}" for line in write_comments([*comments, *list_urdf_omissions(robot)]))
    start = _find_tag_end(file.source, file.root.offset)
    edits.append(_Edit(start=start, end=start, text=head))
    result = file.source
    for edit in sorted(edits, key=lambda entry: entry.start, reverse=True):
        result = result[: edit.start] + edit.text.encode() + result[edit.end :]
    return result.decode(errors="surrogatepass")


def _read_file(text: str, robot: Robot) -> _File:
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
        parents[_find_end(element, "child")] = (name, _find_end(element, "parent"))
    links = {link: joints[name] for link, (name, _) in parents.items() if name in joints}
    lumped = frozenset(link for link in parents if link not in links and _is_carried(link, parents, links))
    return _File(source=document.source, root=document.root, joints=joints, links=links, lumped=lumped)


def _find_end(joint: Element, tag: str) -> str:
    end = joint.find(tag)
    return end.attributes.get("link", "") if end is not None else ""


def _is_carried(link: str, parents: Mapping[str, tuple[str, str]], links: Mapping[str, Joint]) -> bool:
    """Return whether a link that does not move by itself hangs on one that does."""
    while link in parents:
        if link in links:
            return True
        link = parents[link][1]
    return False


def _edit_links(file: _File) -> Iterator[_Edit]:
    for link in file.root.find_all("link"):
        name = link.attributes.get("name", "")
        old = link.find("inertial")
        joint = file.links.get(name)
        if joint is not None and joint.inertial is not None:
            yield from _replace(file.source, link, old, _write_values(joint))
        elif name in file.lumped and old is not None:
            yield _remove(file.source, old)


def _write_values(joint: Joint) -> list[str]:
    """Return the lines of <inertial> in the frame that the file gives to the link."""
    rotation = np.array([[entry.to_float() for entry in row] for row in joint.frame.rotation])
    origin = np.array([entry.to_float() for entry in joint.frame.translation])
    return write_inertial(move_parameters(joint.inertial or (), rotation.T, -rotation.T @ origin))


def _edit_joints(file: _File) -> Iterator[_Edit]:
    for element in file.root.find_all("joint"):
        joint = file.joints.get(element.attributes.get("name", ""))
        friction = find_plain_friction(joint.friction) if joint is not None else None
        if friction is not None:
            damping, dry = write_decimal(friction.damping), write_decimal(friction.dry)
            lines = [f'<dynamics damping="{damping}" friction="{dry}"/>']
            yield from _replace(file.source, element, element.find("dynamics"), lines)


def _edit_rotors(file: _File) -> Iterator[_Edit]:
    for transmission in file.root.find_all("transmission"):
        end, actuator = transmission.find("joint"), transmission.find("actuator")
        joint = file.joints.get(end.attributes.get("name", "")) if end is not None else None
        if joint is None or actuator is None or joint.drive.rotor_inertia is None:
            continue
        value = write_decimal(joint.drive.rotor_inertia / joint.drive.gear**2)
        for rotor in actuator.find_all(*ROTORS):
            lines = [f"<{rotor.tag}>{value}</{rotor.tag}>"]
            yield from _replace(file.source, actuator, rotor, lines)


def _replace(source: bytes, owner: Element, old: Element | None, lines: Sequence[str]) -> Iterator[_Edit]:
    """Yield what puts `lines` in the place of `old`, or in front of all else in `owner`."""
    if old is not None:
        indent = _find_indent(source, old)
        text = f"\n{indent}".join(lines)
        yield _Edit(start=old.offset, end=_find_element_end(source, old), text=text)
        return
    outer = _find_indent(source, owner)
    text = "".join(f"\n{outer}  {line}" for line in lines)
    start = _find_tag_end(source, owner.offset)
    if source[start - 2 : start] != b"/>":
        yield _Edit(start=start, end=start, text=text)
    else:
        yield _Edit(start=start - 2, end=start, text=f">{text}\n{outer}</{owner.tag}>")


def _remove(source: bytes, element: Element) -> _Edit:
    """Return what takes an element out, with the line that it leaves empty."""
    start, end = element.offset, _find_element_end(source, element)
    line = source.rfind(b"\n", 0, start)
    rest = source.find(b"\n", end)
    alone = line >= 0 and rest >= 0 and not (source[line:start] + source[end:rest]).strip()
    return _Edit(start=line if alone else start, end=rest if alone else end, text="")


def _find_indent(source: bytes, element: Element) -> str:
    """Return the blanks that stand before an element in its line."""
    before = source[source.rfind(b"\n", 0, element.offset) + 1 : element.offset]
    return before.decode() if not before.strip() else "    "


def _find_tag_end(source: bytes, offset: int) -> int:
    """Return where the tag ends that begins at `offset`; values of attributes may hold what ends one."""
    while match := _QUOTED.match(source, offset):
        offset = match.end()
    return offset + 1


def _find_element_end(source: bytes, element: Element) -> int:
    """Return where an element ends, with all that is in it."""
    end = _find_tag_end(source, element.offset)
    if source[end - 2 : end] == b"/>":
        return end
    for child in element.children:
        end = _find_element_end(source, child)
    while (match := _ASIDE.search(source, end)) and not match[1]:
        end = match.end()
    return _find_tag_end(source, match.start()) if match else len(source)
