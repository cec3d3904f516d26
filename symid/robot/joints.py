"""The joints of a robot file: rows, parents, drives, friction, limits.

Input: the `[[joint]]` tables. Output: `Joint` records in the order of the file.

Supported: chains and trees; a joint's parent stands before it in the file.
"""

from collections.abc import Mapping
from typing import Any

from symid.robot.description import Drive, FrictionKind, FrictionValues, Joint, JointKind, Limits
from symid.robot.dh import Row, find_far_end, place_row, read_row
from symid.robot.geometry import IDENTITY, Placement
from symid.robot.inertia import read_inertial
from symid.robot.section import (
    NOT_NEGATIVE,
    POSITIVE,
    Section,
    find_nearest,
    read_choice,
    read_number,
    read_numbers,
    read_table,
    read_text,
    refuse_unknown_keys,
)

__all__ = ["FRICTION_PARAMETERS", "read_joints"]

FRICTION_PARAMETERS: dict[FrictionKind, tuple[str, ...]] = {
    FrictionKind.NONE: (),
    FrictionKind.VISCOUS_COULOMB: ("Fv", "Fc"),
    FrictionKind.VISCOUS_COULOMB_OFFSET: ("Fv", "Fc", "offset"),
    FrictionKind.ASYMMETRIC: ("Fvp", "Fcp", "Fvn", "Fcn"),
}
"""The parameters of each friction model, in the order of its values."""

_JOINT_KEYS = ("name", "kind", "parent", "alpha", "a", "d", "theta", "link", "drive", "friction", "limits")
_BASE = "base"
_UNKNOWN = "unknown"


def read_joints(
    root: Section, convention: str, symbols: Mapping[str, float]
) -> tuple[tuple[Joint, ...], Placement]:
    """Return the joints of the file, and the frame at the last link's end seen from its own.

    Args:
        root: the whole file.
        convention: "modified" or "standard".
        symbols: values of symbolic lengths, m.
    """
    sections = _list_sections(root)
    names = _read_names(sections)
    rows = [read_row(section, tuple(symbols)) for section in sections]
    joints = []
    for index, section in enumerate(sections):
        refuse_unknown_keys(section, _JOINT_KEYS)
        parent = _read_parent(section, index, names)
        before = rows[parent] if parent >= 0 else None
        frame = find_far_end(rows[index], convention)
        kind = _read_kind(section)
        prismatic = kind is JointKind.PRISMATIC
        joint = Joint(
            name=names[index],
            kind=kind,
            parent=parent,
            placement=place_row(rows[index], before, convention),
            inertial=_read_inertial(section, frame, symbols),
            drive=_read_drive(section),
            friction=_read_friction(section, prismatic=prismatic),
            limits=_read_limits(section, prismatic=prismatic),
        )
        joints.append(joint)
    return tuple(joints), _find_tip(rows, convention)


def _find_tip(rows: list[Row], convention: str) -> Placement:
    return find_far_end(rows[-1], convention) if rows else IDENTITY


def _list_sections(root: Section) -> list[Section]:
    tables: Any = root.values.get("joint")
    if tables is None:
        root.refuse_key(
            "robot.missing-key", "joint", 'missing; write [[joint]] and kind = "revolute" for each joint'
        )
        return []
    if not isinstance(tables, list):
        root.refuse(
            "robot.wrong-type", "joint", f"expected [[joint]] in two brackets, got {root.show('joint')}"
        )
        return []
    if not tables:
        text = 'empty, and a robot needs a joint; write [[joint]] and kind = "revolute" for each'
        root.refuse("robot.missing-key", "joint", text)
    sections = []
    for index, table in enumerate(tables):
        if not isinstance(table, Mapping):
            # The other joints are read all the same, so that their mistakes are told too.
            text = f"expected [[joint]] in two brackets, got {root.show('joint', index)} as joint {index + 1}"
            root.refuse("robot.wrong-type", "joint", text, index)
            continue
        name = table.get("name")
        label = f"joint '{name}'" if isinstance(name, str) else f"joint {index + 1}"
        sections.append(Section(values=table, path=("joint", index), report=root.report, label=label))
    return sections


def _read_names(sections: list[Section]) -> list[str]:
    names: list[str] = []
    for number, section in enumerate(sections, start=1):
        name = read_text(section, "name")
        if name in names:
            text = f"the name is taken by joint {names.index(name) + 1}; each joint needs its own"
            section.refuse("robot.duplicate-joint", "name", text)
        elif name is not None and (name == _BASE or not name.strip()):
            text = (
                f'{section.show("name")} cannot name a joint: "{_BASE}" is what the first joint is fixed to'
            )
            section.refuse("robot.bad-name", "name", text)
        names.append(name or f"joint{number}")
    return names


def _read_parent(section: Section, index: int, names: list[str]) -> int:
    """Return the index of the joint's parent, -1 for the base; the joint before it by default."""
    parent = read_text(section, "parent")
    if parent is None:
        return index - 1
    if parent == _BASE:
        return -1
    if parent in names[:index]:
        return names.index(parent)
    if parent in names:
        text = f'"{parent}" does not stand before this joint; a parent comes before its children'
    else:
        known = (_BASE, *names[:index])
        hint = find_nearest(parent, known) or f"allowed are {', '.join(known)}"
        text = f'there is no joint "{parent}"; {hint}'
    section.refuse("robot.unknown-parent", "parent", text)
    return index - 1


def _read_kind(section: Section) -> JointKind:
    kinds = [kind.value for kind in JointKind]
    if "kind" not in section.values:
        section.refuse_key(
            "robot.missing-key", "kind", 'missing; write kind = "revolute" or kind = "prismatic"'
        )
    found = read_choice(section, "kind", kinds)
    return JointKind(found) if found else JointKind.REVOLUTE


def _read_inertial(
    section: Section, frame: Placement, symbols: Mapping[str, float]
) -> tuple[float, ...] | None:
    """Return the ten parameters of the joint's link; a point mass is said."""
    found = read_inertial(section, frame, symbols)
    link: Any = section.values.get("link")
    if found is None or "standard" in link:
        return found
    if not any(link.get("inertia", {}).values()):
        text = "inertia is taken as zero: a point mass; write inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }"
        section.warn("robot.point-mass", "link", f"{text} (kg*m^2) if the link has one")
    return found


def _read_drive(section: Section) -> Drive:
    drive = read_table(section, "drive", ("gear", "rotor_inertia", "rotor_inertia_side", "torque_constant"))
    if drive is None:
        return Drive()
    # The joint's own label is enough: the keys of a drive stand nowhere else.
    drive = Section(values=drive.values, path=drive.path, report=drive.report, label=section.label)
    gear = read_number(drive, "gear", "")
    if gear == 0:
        text = "must not be 0; it is the number of motor turns per turn of the joint"
        drive.refuse("robot.out-of-range", "gear", text)
    constant = read_number(drive, "torque_constant", "N*m/A")
    ratio = float(gear or 1)
    return Drive(
        gear=ratio,
        has_rotor="rotor_inertia" in drive.values,
        rotor_inertia=_read_rotor_inertia(drive, ratio),
        torque_constant=None if constant is None else float(constant),
    )


def _read_rotor_inertia(drive: Section, gear: float) -> float | None:
    """Return the rotor inertia on the joint side, None where it is unknown."""
    side = read_choice(drive, "rotor_inertia_side", ("motor", "joint"))
    if "rotor_inertia" not in drive.values:
        if side:
            text = f'stands alone; write rotor_inertia = 1e-5 (kg*m^2) or "{_UNKNOWN}", or leave it out'
            drive.refuse_key("robot.rotor-side", "rotor_inertia_side", text)
        return None
    if drive.values["rotor_inertia"] == _UNKNOWN:
        return None
    value = read_number(drive, "rotor_inertia", "kg*m^2", NOT_NEGATIVE)
    if "rotor_inertia_side" not in drive.values:
        text = 'needs its side: write rotor_inertia_side = "motor" or rotor_inertia_side = "joint"'
        drive.refuse_key("robot.rotor-side", "rotor_inertia", text)
    if value is None:
        return None
    return float(value) * (gear**2 if side == "motor" else 1.0)


def _read_friction(section: Section, *, prismatic: bool) -> FrictionValues:
    names = sorted({name for group in FRICTION_PARAMETERS.values() for name in group})
    table = read_table(section, "friction", ("model", *names))
    if table is None:
        return FrictionValues()
    if "model" not in table.values:
        table.refuse_key("robot.missing-key", "model", 'missing; write model = "viscous_coulomb"')
    model = read_choice(table, "model", [kind.value for kind in FrictionKind])
    if model is None:
        for name in names:
            read_number(table, name, _find_friction_unit(name, prismatic=prismatic))
        return FrictionValues()
    kind = FrictionKind(model)
    _check_friction_names(table, kind, names)
    wanted = FRICTION_PARAMETERS[kind]
    given = [read_number(table, name, _find_friction_unit(name, prismatic=prismatic)) for name in wanted]
    for name, value in zip(wanted, given, strict=True):
        if name != "offset" and value is not None and value < 0:
            text = f"{value} drives the joint instead of braking it; friction coefficients are positive"
            table.warn("robot.negative-friction", name, text)
    values = tuple(float(value) for value in given if value is not None)
    return FrictionValues(kind=kind, values=values if values and len(values) == len(wanted) else None)


def _check_friction_names(table: Section, kind: FrictionKind, names: list[str]) -> None:
    wanted = FRICTION_PARAMETERS[kind]
    for name in names:
        if name in table.values and name not in wanted:
            allowed = f"its values are {', '.join(wanted)}" if wanted else "it has no values"
            text = f'not a value of the model "{kind.value}"; {allowed}'
            table.refuse_key("robot.friction-values", name, text)
    missing = [name for name in wanted if name not in table.values]
    if missing and len(missing) < len(wanted):
        text = (
            f"without {', '.join(missing)}; give all of {', '.join(wanted)}, or none where they are unknown"
        )
        table.refuse_key("robot.friction-values", next(name for name in wanted if name in table.values), text)


def _find_friction_unit(name: str, *, prismatic: bool) -> str:
    if name.startswith("Fv"):
        return "N*s/m" if prismatic else "N*m*s/rad"
    return "N" if prismatic else "N*m"


def _read_limits(section: Section, *, prismatic: bool) -> Limits:
    table = read_table(section, "limits", ("position", "velocity", "torque"))
    if table is None:
        return Limits()
    unit = "m" if prismatic else "rad"
    position = read_numbers(table, "position", unit, 2)
    if position and position[0] >= position[1]:
        text = f"the lower limit {position[0]} must be less than the upper limit {position[1]}"
        table.refuse("robot.out-of-range", "position", text)
    velocity = read_number(table, "velocity", f"{unit}/s", POSITIVE)
    torque = read_number(table, "torque", "N" if prismatic else "N*m", POSITIVE)
    return Limits(
        position=(float(position[0]), float(position[1])) if position else None,
        velocity=None if velocity is None else float(velocity),
        torque=None if torque is None else float(torque),
    )
