"""The joints of a robot file: placement, parent, kind, limits, link values, and which joint follows which.

The `[[joint]]` and `[[coupling]]` tables -> `Joint` and `Coupling` records in the order of the file,
without its fixed joints.

Supported: chains and trees, a joint's parent stands before it in the file; fixed joints, whose links are
joined to those that carry them (a notice says so). `mimic`: q = multiplier * q of the master + offset,
chains of followers resolved, multipliers that are fractions, masters that stand later in the file. `link`:
mass, centre of mass and inertia, or the standard parameters; symbols in place of numbers; any frame on the
link. Standard parameters that no body has (from a converted file, or identified) are kept, with a warning;
mass, centre of mass and inertia are typed by hand, where such values are a slip, and refused.
Not supported: rings of followers, followers of fixed joints; negative masses, symbols among standard
parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from symid.notation import INERTIAL
from symid.robot.description import Coupling, Joint, JointKind, Limits, Mimic, SymbolicInertia
from symid.robot.exact_values import (
    DH_KEYS,
    ZERO_ANGLE,
    Symbols,
    build_row_frames,
    read_angle,
    read_dh_row,
    read_fraction,
    read_length,
    read_linear_form,
    read_origin,
)
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Angle,
    Exact,
    Placement,
    build_exact_angle,
    compose_placements,
    rotate_z,
    translate,
)
from symid.robot.inertia import (
    compute_standard_parameters,
    explain_impossible_inertia,
    lump_fixed_joints,
    move_by_placement,
)
from symid.robot.toml_drives import read_couplings, read_drive, read_elasticity, read_spring, read_table_array
from symid.robot.toml_friction import read_friction
from symid.robot.toml_values import (
    ANY,
    BASE,
    NOT_NEGATIVE,
    POSITIVE,
    Section,
    explain_wide_limits,
    has_list,
    read_choice,
    read_number,
    read_numbers,
    read_table,
    read_text,
    refuse_unknown_keys,
    suggest_names,
)

_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_STANDARD_UNITS = ("kg*m^2",) * 6 + ("kg*m",) * 3 + ("kg",)


def read_body(
    section: Section, name: str, frame: Placement, symbols: Symbols, others: tuple[str, ...] = ()
) -> tuple[tuple[float, ...] | None, SymbolicInertia | None]:
    """Return the ten parameters of a body and their form in symbols; None where the file states none.

    Args:
        section: the table around that of the body, as of a joint.
        name: of the body's table, as "link".
        frame: the frame that the file's values refer to, seen from the link's frame.
        symbols: those of the file.
        others: keys that the table may have besides.
    """
    link = read_table(section, name, ("mass", "com", "inertia", "standard", *others))
    if link is None:
        return None, None
    errors = len(section.report.errors)
    key = "standard" if "standard" in link.values else "inertia"
    form = _read_symbolic_inertia(link, symbols) if key == "inertia" else None
    found = None
    if key == "standard":
        found = _read_standard(link)
    elif form is not None:
        com, inertia = (
            [entry.to_float(symbols.values) for entry in part] for part in (form.com, form.inertia)
        )
        found = compute_standard_parameters(form.mass.to_float(symbols.values), com, inertia)
    if found is None or len(section.report.errors) > errors:
        return None, None
    if not _check_possible(link, key, found):
        return None, None
    if form is not None and not any(form.inertia):
        text = "inertia is taken as zero: a point mass; write inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }"
        section.warn("robot.point-mass", name, f"{text} (kg*m^2) if the link has one")
    symbolic = form and any(entry.symbols for entry in (form.mass, *form.com, *form.inertia))
    return move_by_placement(found, frame, symbols.values), form if symbolic else None


def _check_possible(link: Section, key: str, parameters: tuple[float, ...]) -> bool:
    """Return whether the values may stay; what no body has is a warning among standard parameters."""
    if not parameters[9]:
        if any(parameters):
            text = "no mass (M = 0), but other values: no body has them, and they are kept"
            link.warn("robot.inertia-without-mass", key, text)
        return True
    impossible = explain_impossible_inertia(parameters)
    if impossible and key == "standard":
        text = f"no body has these values, and they are kept: {impossible}"
        link.warn("robot.impossible-inertia", key, text)
    elif impossible:
        text = f"no body has this inertia: {impossible}; check the values and the point they refer to"
        link.refuse("robot.impossible-inertia", key, f"{text}, or write them as standard, which is kept")
        return False
    return True


def _read_symbolic_inertia(link: Section, symbols: Symbols) -> SymbolicInertia | None:
    mass = read_linear_form(link, "mass", symbols, "kg", allowed=POSITIVE)
    com: list[Exact] = [ZERO] * 3
    if has_list(link, "com", 3, "numbers in m"):
        com = [read_linear_form(link, "com", symbols, "m", index) or ZERO for index in range(3)]
    tensor = read_table(link, "inertia", _TENSOR)
    inertia = [ZERO] * 6
    if tensor is not None:
        for index, key in enumerate(_TENSOR):
            allowed = NOT_NEGATIVE if key[0] == key[1] else ANY
            inertia[index] = read_linear_form(tensor, key, symbols, "kg*m^2", allowed=allowed) or ZERO
    if link.values and "mass" not in link.values:
        text = "missing; com and inertia mean nothing without it: write mass = 1.5 (kg), or leave them out"
        link.refuse_key("robot.missing-key", "mass", text)
    if mass is None:
        return None
    x, y, z = com
    xx, xy, xz, yy, yz, zz = inertia
    return SymbolicInertia(mass=mass, com=(x, y, z), inertia=(xx, xy, xz, yy, yz, zz))


def _read_standard(link: Section) -> tuple[float, ...] | None:
    for key in ("mass", "com", "inertia"):
        if key in link.values:
            text = "stands next to standard, which says the same; keep one of the two"
            link.refuse_key("robot.two-forms", key, text)
    table = read_table(link, "standard", INERTIAL)
    if table is None:
        return None
    if "M" not in table.values:
        table.refuse_key("robot.missing-key", "M", "missing; write M = 1.5 (the mass in kg)")
        return None
    numbers = []
    for key, unit in zip(INERTIAL, _STANDARD_UNITS, strict=True):
        number = read_number(table, key, unit, NOT_NEGATIVE if key == "M" else ANY)
        numbers.append(float(number or 0))
    return tuple(numbers)


@dataclass(frozen=True, slots=True, kw_only=True)
class _MimicStep:
    """One step of a chain: the joint followed, and the motion; the offset as an angle or a length."""

    master: int
    multiplier: Fraction
    turn: Angle = ZERO_ANGLE
    shift: Exact = ZERO


def read_mimics(
    sections: Sequence[Section], names: Sequence[str], kinds: Sequence[JointKind | None], symbols: Symbols
) -> dict[int, tuple[Mimic, Placement]]:
    """Return what the followers among the joints follow, by their index, and the offset of their motion.

    Args:
        sections: tables of the joints.
        names: of the joints.
        kinds: of the joints, None for a fixed one.
        symbols: those of the file.
    """
    links: dict[int, _MimicStep] = {}
    for index, section in enumerate(sections):
        if "mimic" in section.values:
            link = _read_mimic_step(section, index, names, kinds, symbols)
            if link is not None:
                links[index] = link
    followers = {}
    for index in links:
        resolved = _resolve_chain(links, kinds, index, symbols.values)
        if isinstance(resolved, list):
            # A ring is said once, at its first joint; chains that end in one need no word of their own.
            if index == min(resolved):
                path = " follows ".join(names[each] for each in (*resolved, index))
                text = f"{path}: nobody leads; one of them must move by itself"
                sections[index].refuse("robot.mimic-ring", "mimic", text)
        elif resolved is not None:
            followers[index] = resolved
    return followers


def _read_mimic_step(
    section: Section, index: int, names: Sequence[str], kinds: Sequence[JointKind | None], symbols: Symbols
) -> _MimicStep | None:
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
    turn = read_angle(table, "offset") if revolute else ZERO_ANGLE
    shift = ZERO if revolute else read_length(table, "offset", symbols)
    if "joint" not in table.values:
        table.refuse_key("robot.missing-key", "joint", 'missing; write joint = "joint1", the joint to follow')
    name = read_text(table, "joint")
    if name is None:
        return None
    if name not in names:
        hint = suggest_names(name, names) or f"allowed are {', '.join(names)}"
        table.refuse("robot.unknown-joint", "joint", f'there is no joint "{name}"; {hint}')
        return None
    master = names.index(name)
    if kinds[master] is None:
        text = f'"{name}" is fixed; make this joint fixed too, or follow one that moves'
        table.refuse("robot.follows-fixed", "joint", text)
        return None
    return _MimicStep(master=master, multiplier=multiplier or Fraction(1), turn=turn, shift=shift)


def _resolve_chain(
    links: Mapping[int, _MimicStep],
    kinds: Sequence[JointKind | None],
    index: int,
    symbols: Mapping[str, float],
) -> tuple[Mimic, Placement] | list[int] | None:
    """Return the follower of a chain's end; the ring it is part of; None where the chain ends in a ring."""
    link = links[index]
    revolute = kinds[index] is JointKind.REVOLUTE
    master, multiplier = link.master, link.multiplier
    offset = Exact.of(link.turn.radians) if revolute else link.shift
    path = [index]
    while master in links:
        if master in path:
            return path if master == index else None
        path.append(master)
        before = links[master]
        # q = m1 (m2 q' + o2) + o1; each offset is in the unit of its own joint.
        turns = kinds[master] is JointKind.REVOLUTE
        offset += Exact.of(multiplier) * (Exact.of(before.turn.radians) if turns else before.shift)
        multiplier *= before.multiplier
        master = before.master
    if not revolute:
        placement = translate(ZERO, ZERO, offset)
    elif len(path) == 1:
        placement = rotate_z(link.turn)
    else:
        placement = rotate_z(build_exact_angle(offset.to_float(symbols), snap=0.0))
    return Mimic(master=master, multiplier=multiplier), placement


_JOINT_KEYS = (
    "name",
    "kind",
    "parent",
    *DH_KEYS,
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


def read_joints(
    root: Section, convention: str, symbols: Symbols
) -> tuple[tuple[Joint, ...], tuple[Coupling, ...]]:
    """Return the joints of the file, and the drives that turn with several of them.

    Args:
        root: the whole file.
        convention: "modified", "standard" or "origin".
        symbols: those of the file.
    """
    sections = _list_sections(root)
    names = _read_names(sections)
    kinds = [_read_kind(section) for section in sections]
    followers = read_mimics(sections, names, kinds, symbols)
    joints: list[Joint] = []
    for index, section in enumerate(sections):
        refuse_unknown_keys(section, _JOINT_KEYS)
        parent = _read_parent(section, index, names)
        near, frame = _read_frames(section, convention, symbols)
        if parent >= 0:
            near = compose_placements(joints[parent].frame, near)
        mimic, offset = followers.get(index, (None, IDENTITY))
        if mimic is not None:
            near = compose_placements(near, offset)
        joint = _read_joint(section, kinds[index], frame, symbols)
        joints.append(replace(joint, name=names[index], parent=parent, placement=near, mimic=mimic))
    couplings = read_couplings(root, names, kinds)
    fixed = [index for index, kind in enumerate(kinds) if kind is None]
    if not fixed or root.report.errors:
        return tuple(joints), couplings
    return _lump(sections, joints, couplings, fixed, symbols)


def _read_joint(section: Section, kind: JointKind | None, frame: Placement, symbols: Symbols) -> Joint:
    """Return what a joint's table says of the joint itself and its link."""
    parameters, form = read_body(section, "link", frame, symbols)
    joint = Joint(
        name="",
        kind=kind or JointKind.REVOLUTE,
        parent=-1,
        placement=IDENTITY,
        frame=frame,
        inertial=parameters,
        form=form,
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
    row = [key for key in DH_KEYS if key in section.values]
    if convention == "origin" or general:
        for key in row:
            where = 'in convention = "origin"' if convention == "origin" else f"next to {general[0]}"
            text = f"cannot stand {where}; say where the joint is by a row or by origin, not by both"
            section.refuse_key("robot.mixed-placement", key, text)
        return read_origin(section, "origin", symbols), read_origin(section, "frame", symbols)
    return build_row_frames(read_dh_row(section, symbols), convention)


def _lump(
    sections: Sequence[Section],
    joints: Sequence[Joint],
    couplings: Sequence[Coupling],
    fixed: Sequence[int],
    symbols: Symbols,
) -> tuple[tuple[Joint, ...], tuple[Coupling, ...]]:
    """Return the moving joints, with the links of the fixed ones joined to those that carry them."""
    if len(fixed) == len(joints):
        text = "every joint is fixed, and a robot moves; give one of them another kind"
        sections[0].refuse("robot.fixed-joint", "kind", text)
        return tuple(joints), tuple(couplings)
    lumped = lump_fixed_joints(joints, fixed, symbols.values)
    for index, frame in zip(fixed, lumped.frames, strict=True):
        where = (
            f"the link of joint '{lumped.joints[frame.carrier].name}'" if frame.carrier >= 0 else "the base"
        )
        mass = "" if frame.has_mass else ", which gets no heavier: the file gives no mass"
        sections[index].warn("robot.lumped", "kind", f"fixed; its link belongs to {where}{mass}")
    moved = {old: new for old, new in enumerate(lumped.indices) if new is not None}
    return lumped.joints, tuple(
        replace(entry, terms=tuple((moved[index], factor) for index, factor in entry.terms))
        for entry in couplings
    )


def _list_sections(root: Section) -> list[Section]:
    if "joint" not in root.values:
        text = 'missing; write [[joint]] and kind = "revolute" for each joint'
        root.refuse_key("robot.missing-key", "joint", text)
    if root.values.get("joint") == []:
        text = 'empty, and a robot needs a joint; write [[joint]] and kind = "revolute" for each'
        root.refuse("robot.missing-key", "joint", text)
    return read_table_array(root, "joint", "joint")


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
        hint = suggest_names(parent, known) or f"allowed are {', '.join(known)}"
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
