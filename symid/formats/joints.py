"""The joints of a robot file: placements, parents, kinds, limits, and what moves or brakes them.

Input: the `[[joint]]` and `[[coupling]]` tables. Output: `Joint` and `Coupling` records in the order of the
file, without its fixed joints.

Supported: chains and trees; a joint's parent stands before it in the file. Fixed joints are joined to the
links that carry them, and a notice says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from symid.formats.dh import ROW_KEYS, find_row_frames, read_row
from symid.formats.forms import Symbols
from symid.formats.joint_drives import list_tables, read_couplings, read_drive, read_spring
from symid.formats.joint_elasticity import read_elasticity
from symid.formats.joint_friction import read_friction
from symid.formats.joint_mimic import read_followers
from symid.formats.link import read_inertial
from symid.formats.origin import read_origin
from symid.formats.section import (
    BASE,
    POSITIVE,
    Section,
    explain_wide_limits,
    find_nearest,
    read_choice,
    read_number,
    read_numbers,
    read_table,
    read_text,
    refuse_unknown_keys,
)
from symid.robot.description import Coupling, Joint, JointKind, Limits
from symid.robot.geometry import IDENTITY, Placement, compose_placements
from symid.robot.lumping import lump_fixed

__all__ = ["Mechanism", "read_joints"]

_KEYS = (
    "name",
    "kind",
    "parent",
    *ROW_KEYS,
    "origin",
    "frame",
    "mimic",
    "link",
    "drive",
    "friction",
    "spring",
    "elasticity",
    "limits",
)
_MOVING_KEYS = ("mimic", "drive", "friction", "spring", "elasticity", "limits")
_KINDS = {
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "fixed": None,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """What moves: joints, and drives that turn with several of them."""

    joints: tuple[Joint, ...]
    couplings: tuple[Coupling, ...]


def read_joints(root: Section, convention: str, symbols: Symbols) -> Mechanism:
    """Return the joints and couplings of the file.

    Args:
        root: the whole file.
        convention: "modified", "standard" or "origin".
        symbols: those of the file.
    """
    sections = _list_sections(root)
    names = _read_names(sections)
    kinds = [_read_kind(section) for section in sections]
    followers = read_followers(sections, names, kinds, symbols)
    joints: list[Joint] = []
    for index, section in enumerate(sections):
        refuse_unknown_keys(section, _KEYS)
        parent = _read_parent(section, index, names)
        near, frame = _read_frames(section, convention, symbols)
        if parent >= 0:
            near = compose_placements(joints[parent].frame, near)
        if index in followers:
            near = compose_placements(near, followers[index].offset)
        joint = _read_joint(section, kinds[index], frame, symbols)
        mimic = followers[index].mimic if index in followers else None
        joints.append(replace(joint, name=names[index], parent=parent, placement=near, mimic=mimic))
    couplings = read_couplings(root, names, kinds)
    fixed = [index for index, kind in enumerate(kinds) if kind is None]
    if not fixed or root.report.errors:
        return Mechanism(joints=tuple(joints), couplings=couplings)
    return _lump(sections, joints, couplings, fixed, symbols)


def _read_joint(section: Section, kind: JointKind | None, frame: Placement, symbols: Symbols) -> Joint:
    """Return what a joint's table says of the joint itself and its link."""
    body = read_inertial(section, frame, symbols)
    joint = Joint(
        name="",
        kind=kind or JointKind.REVOLUTE,
        parent=-1,
        placement=IDENTITY,
        frame=frame,
        inertial=body.parameters,
        form=body.form,
    )
    if kind is None:
        for key in _MOVING_KEYS:
            if key in section.values and key != "mimic":
                text = "a fixed joint has none; leave it out, or choose a kind that moves"
                section.refuse_key("robot.fixed-joint", key, text)
        return joint
    prismatic = kind is JointKind.PRISMATIC
    return replace(
        joint,
        drive=read_drive(section),
        friction=read_friction(section, prismatic=prismatic),
        limits=_read_limits(section, prismatic=prismatic),
        spring=read_spring(section, prismatic=prismatic),
        elasticity=read_elasticity(section, prismatic=prismatic),
    )


def _read_frames(section: Section, convention: str, symbols: Symbols) -> tuple[Placement, Placement]:
    """Return the joint's frame seen from the link before it, and the link's seen from the joint's."""
    general = [key for key in ("origin", "frame") if key in section.values]
    row = [key for key in ROW_KEYS if key in section.values]
    if convention == "origin" or general:
        for key in row:
            where = 'in convention = "origin"' if convention == "origin" else f"next to {general[0]}"
            text = f"cannot stand {where}; say where the joint is by a row or by origin, not by both"
            section.refuse_key("robot.mixed-placement", key, text)
        return read_origin(section, "origin", symbols), read_origin(section, "frame", symbols)
    return find_row_frames(read_row(section, symbols), convention)


def _lump(
    sections: Sequence[Section],
    joints: Sequence[Joint],
    couplings: Sequence[Coupling],
    fixed: Sequence[int],
    symbols: Symbols,
) -> Mechanism:
    """Return the moving joints, with the links of the fixed ones joined to those that carry them."""
    if len(fixed) == len(joints):
        text = "every joint is fixed, and a robot moves; give one of them another kind"
        sections[0].refuse("robot.fixed-joint", "kind", text)
        return Mechanism(joints=tuple(joints), couplings=tuple(couplings))
    lumped = lump_fixed(joints, fixed, symbols.values)
    for index, frame in zip(fixed, lumped.frames, strict=True):
        where = (
            f"the link of joint '{lumped.joints[frame.carrier].name}'" if frame.carrier >= 0 else "the base"
        )
        mass = "" if frame.has_mass else ", which gets no heavier: the file gives no mass"
        sections[index].warn("robot.lumped", "kind", f"fixed; its link belongs to {where}{mass}")
    moved = {old: new for old, new in enumerate(lumped.indices) if new is not None}
    couplings = [
        replace(entry, terms=tuple((moved[index], factor) for index, factor in entry.terms))
        for entry in couplings
    ]
    return Mechanism(joints=lumped.joints, couplings=tuple(couplings))


def _list_sections(root: Section) -> list[Section]:
    if "joint" not in root.values:
        text = 'missing; write [[joint]] and kind = "revolute" for each joint'
        root.refuse_key("robot.missing-key", "joint", text)
    if root.values.get("joint") == []:
        text = 'empty, and a robot needs a joint; write [[joint]] and kind = "revolute" for each'
        root.refuse("robot.missing-key", "joint", text)
    return list_tables(root, "joint", "joint")


def _read_names(sections: list[Section]) -> list[str]:
    names: list[str] = []
    for number, section in enumerate(sections, start=1):
        name = read_text(section, "name")
        if name in names:
            text = f"the name is taken by joint {names.index(name) + 1}; each joint needs its own"
            section.refuse("robot.duplicate-joint", "name", text)
        elif name is not None and (name == BASE or not name.strip()):
            text = f'{section.show("name")} cannot name a joint: "{BASE}" is what the first joint is fixed to'
            section.refuse("robot.bad-name", "name", text)
        names.append(name or f"joint{number}")
    return names


def _read_parent(section: Section, index: int, names: list[str]) -> int:
    """Return the index of the joint's parent, -1 for the base; the joint before it by default."""
    parent = read_text(section, "parent")
    if parent is None:
        return index - 1
    if parent == BASE:
        return -1
    if parent in names[:index]:
        return names.index(parent)
    if parent in names:
        text = f'"{parent}" does not stand before this joint; a parent comes before its children'
    else:
        known = (BASE, *names[:index])
        hint = find_nearest(parent, known) or f"allowed are {', '.join(known)}"
        text = f'there is no joint "{parent}"; {hint}'
    section.refuse("robot.unknown-parent", "parent", text)
    return index - 1


def _read_kind(section: Section) -> JointKind | None:
    """Return how the joint moves, None for a fixed one."""
    if "kind" not in section.values:
        section.refuse_key(
            "robot.missing-key", "kind", 'missing; write kind = "revolute" or kind = "prismatic"'
        )
    found = read_choice(section, "kind", _KINDS)
    return _KINDS[found] if found else JointKind.REVOLUTE


def _read_limits(section: Section, *, prismatic: bool) -> Limits:
    table = read_table(section, "limits", ("position", "velocity", "acceleration", "jerk", "torque"))
    if table is None:
        return Limits()
    unit = "m" if prismatic else "rad"
    position = read_numbers(table, "position", unit, 2)
    if position and position[0] >= position[1]:
        text = f"the lower limit {position[0]} must be less than the upper limit {position[1]}"
        table.refuse("robot.out-of-range", "position", text)
    elif position and not prismatic:
        doubt = explain_wide_limits(float(position[0]), float(position[1]))
        if doubt:
            table.warn("robot.large-angle", "position", doubt)
    if section.values.get("kind") == "continuous" and "position" in table.values:
        text = 'a continuous joint has none; leave them out, or write kind = "revolute"'
        table.refuse_key("robot.continuous-limits", "position", text)
    units = {"velocity": f"{unit}/s", "acceleration": f"{unit}/s^2", "jerk": f"{unit}/s^3"}
    units["torque"] = "N" if prismatic else "N*m"
    found = {key: read_number(table, key, units[key], POSITIVE) for key in units}
    return Limits(
        position=(float(position[0]), float(position[1])) if position else None,
        **{key: None if value is None else float(value) for key, value in found.items()},
    )
