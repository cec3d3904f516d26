"""Joints that follow another one: the `mimic` tables of a robot file.

Input: the tables of all joints. Output: for each follower its first master and the motion that belongs to
it, q = multiplier * q of the master + offset, chains resolved.

Supported: followers of followers; multipliers that are fractions; masters that stand later in the file.
Not supported: rings, followers of fixed joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from symid.formats.dh import NO_TURN, read_angle, read_length
from symid.formats.forms import Symbols, read_fraction
from symid.formats.section import Section, find_nearest, read_table, read_text
from symid.robot.description import JointKind, Mimic
from symid.robot.geometry import ZERO, Angle, Exact, Placement, find_angle, rotate_z, translate

__all__ = ["Follower", "read_followers"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Follower:
    """What a joint follows, and the placement of its joint frame behind the offset of its motion."""

    mimic: Mimic
    offset: Placement


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    """One step of a chain: the joint followed, and the motion; the offset as an angle or a length."""

    master: int
    multiplier: Fraction
    turn: Angle = NO_TURN
    shift: Exact = ZERO


def read_followers(
    sections: Sequence[Section], names: Sequence[str], kinds: Sequence[JointKind | None], symbols: Symbols
) -> dict[int, Follower]:
    """Return the followers among the joints of a file by their index.

    Args:
        sections: tables of the joints.
        names: of the joints.
        kinds: of the joints, None for a fixed one.
        symbols: those of the file.
    """
    links: dict[int, _Link] = {}
    for index, section in enumerate(sections):
        if "mimic" in section.values:
            link = _read_link(section, index, names, kinds, symbols)
            if link is not None:
                links[index] = link
    _refuse_rings(sections, names, links)
    followers = {}
    for index in links:
        if not any(index in ring for ring in _find_rings(links)):
            resolved = _resolve(links, kinds, index, symbols.values)
            if resolved is not None:
                followers[index] = resolved
    return followers


def _read_link(
    section: Section, index: int, names: Sequence[str], kinds: Sequence[JointKind | None], symbols: Symbols
) -> _Link | None:
    if kinds[index] is None:
        section.refuse_key("robot.follows-fixed", "mimic", "a fixed joint follows nothing; leave this out")
        return None
    table = read_table(section, "mimic", ("joint", "multiplier", "offset"))
    if table is None:
        return None
    multiplier = read_fraction(table, "multiplier", "leave it out, or write a fixed joint")
    if "multiplier" not in table.values:
        multiplier = Fraction(1)
    revolute = kinds[index] is JointKind.REVOLUTE
    turn = read_angle(table, "offset") if revolute else NO_TURN
    shift = ZERO if revolute else read_length(table, "offset", symbols)
    if "joint" not in table.values:
        table.refuse_key("robot.missing-key", "joint", 'missing; write joint = "joint1", the joint to follow')
    name = read_text(table, "joint")
    if name is None:
        return None
    if name not in names:
        hint = find_nearest(name, names) or f"allowed are {', '.join(names)}"
        table.refuse("robot.unknown-joint", "joint", f'there is no joint "{name}"; {hint}')
        return None
    master = names.index(name)
    if kinds[master] is None:
        text = f'"{name}" is fixed; make this joint fixed too, or follow one that moves'
        table.refuse("robot.follows-fixed", "joint", text)
        return None
    return _Link(master=master, multiplier=multiplier or Fraction(1), turn=turn, shift=shift)


def _find_rings(links: Mapping[int, _Link]) -> list[tuple[int, ...]]:
    """Return each ring of followers once, from its first joint on."""
    rings = []
    for start in links:
        path = [start]
        while (joint := links[path[-1]].master) in links and joint not in path:
            path.append(joint)
        if joint == start and start == min(path):
            rings.append(tuple(path))
    return rings


def _refuse_rings(sections: Sequence[Section], names: Sequence[str], links: Mapping[int, _Link]) -> None:
    for ring in _find_rings(links):
        path = " follows ".join(names[index] for index in (*ring, ring[0]))
        text = f"{path}: nobody leads; one of them must move by itself"
        section = sections[ring[0]]
        section.refuse("robot.mimic-ring", "mimic", text)


def _resolve(
    links: Mapping[int, _Link],
    kinds: Sequence[JointKind | None],
    index: int,
    symbols: Mapping[str, float],
) -> Follower | None:
    """Return the follower of a chain's first joint; None where the chain ends in a ring."""
    link = links[index]
    revolute = kinds[index] is JointKind.REVOLUTE
    master, multiplier = link.master, link.multiplier
    offset = Exact.of(link.turn.radians) if revolute else link.shift
    seen = {index}
    while master in links:
        if master in seen:
            return None
        seen.add(master)
        before = links[master]
        # q = m1 (m2 q' + o2) + o1; each offset is in the unit of its own joint.
        turns = kinds[master] is JointKind.REVOLUTE
        offset += Exact.of(multiplier) * (Exact.of(before.turn.radians) if turns else before.shift)
        multiplier *= before.multiplier
        master = before.master
    if not revolute:
        placement = translate(ZERO, ZERO, offset)
    elif len(seen) == 1:
        placement = rotate_z(link.turn)
    else:
        placement = rotate_z(find_angle(offset.to_float(symbols), snap=0.0))
    return Follower(mimic=Mimic(master=master, multiplier=multiplier), offset=placement)
