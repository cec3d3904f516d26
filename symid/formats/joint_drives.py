"""What drives a joint: gear and rotor, springs, and drives coupled to several joints.

Input: the tables of a robot file. Output: `Drive`, `Spring`, `Coupling`.

Supported: rotor inertias on either side of the gear; values that are "unknown", to be identified.
Not supported: springs that are not linear; `joint_elasticity` reads what gives between motor and link.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from symid.formats.forms import read_fraction
from symid.formats.joint_friction import read_friction
from symid.formats.section import (
    ANY,
    NOT_NEGATIVE,
    Range,
    Section,
    find_nearest,
    read_choice,
    read_number,
    read_table,
    read_text,
    refuse_unknown_keys,
)
from symid.robot.description import Coupling, Drive, JointKind, Spring

__all__ = [
    "UNKNOWN",
    "find_spring_unit",
    "list_tables",
    "read_couplings",
    "read_drive",
    "read_known",
    "read_spring",
]

UNKNOWN = "unknown"
"""What stands in place of a number that is to be identified."""


def read_drive(section: Section) -> Drive:
    """Return the `drive` table of a joint."""
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
            text = f'stands alone; write rotor_inertia = 1e-5 (kg*m^2) or "{UNKNOWN}", or leave it out'
            drive.refuse_key("robot.rotor-side", "rotor_inertia_side", text)
        return None
    if drive.values["rotor_inertia"] == UNKNOWN:
        return None
    value = read_number(drive, "rotor_inertia", "kg*m^2", NOT_NEGATIVE)
    if "rotor_inertia_side" not in drive.values:
        text = 'needs its side: write rotor_inertia_side = "motor" or rotor_inertia_side = "joint"'
        drive.refuse_key("robot.rotor-side", "rotor_inertia", text)
    if value is None:
        return None
    return float(value) * (gear**2 if side == "motor" else 1.0)


def read_spring(section: Section, *, prismatic: bool) -> Spring | None:
    """Return the `spring` table of a joint: tau = stiffness (q - rest)."""
    table = read_table(section, "spring", ("stiffness", "rest"))
    if table is None:
        return None
    for key, example in (("stiffness", "120"), ("rest", "0")):
        if key not in table.values:
            unit = find_spring_unit(key, prismatic=prismatic)
            text = f'missing; write {key} = {example} ({unit}) or {key} = "{UNKNOWN}"'
            table.refuse_key("robot.missing-key", key, text)
    stiffness = read_known(table, "stiffness", find_spring_unit("stiffness", prismatic=prismatic), ANY)
    rest = read_known(table, "rest", find_spring_unit("rest", prismatic=prismatic), ANY)
    if stiffness is not None and stiffness < 0:
        text = f"{stiffness:g} pushes the joint away from rest; a spring's stiffness is positive"
        table.warn("robot.negative-stiffness", "stiffness", text)
    return Spring(stiffness=stiffness, rest=rest)


def find_spring_unit(key: str, *, prismatic: bool) -> str:
    """Return the unit of a spring's stiffness or rest position as robot files write it."""
    if key == "rest":
        return "m" if prismatic else "rad"
    return "N/m" if prismatic else "N*m/rad"


def read_known(table: Section, key: str, unit: str, allowed: Range) -> float | None:
    """Return the number at `key`; None where it is unknown or wrong."""
    if table.values.get(key) == UNKNOWN:
        return None
    value = read_number(table, key, unit, allowed)
    return None if value is None else float(value)


def list_tables(root: Section, key: str, noun: str) -> list[Section]:
    """Return the tables of `[[key]]`, each with a label for messages; what is none is reported."""
    tables: Any = root.values.get(key)
    if tables is None:
        return []
    if not isinstance(tables, list):
        root.refuse("robot.wrong-type", key, f"expected [[{key}]] in two brackets, got {root.show(key)}")
        return []
    sections = []
    for index, table in enumerate(tables):
        if not isinstance(table, Mapping):
            # The other tables are read all the same, so that their mistakes are told too.
            text = f"expected [[{key}]] in two brackets, got {root.show(key, index)} as {noun} {index + 1}"
            root.refuse("robot.wrong-type", key, text, index)
            continue
        name = table.get("name")
        label = f"{noun} '{name}'" if isinstance(name, str) else f"{noun} {index + 1}"
        sections.append(Section(values=table, path=(key, index), report=root.report, label=label))
    return sections


def read_couplings(
    root: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[Coupling, ...]:
    """Return the drives of the file that turn with several joints.

    Args:
        root: the whole file.
        names: of the file's joints; the indices in `terms` count these.
        kinds: of the same joints, None for a fixed one.
    """
    couplings: list[Coupling] = []
    for section in list_tables(root, "coupling", "coupling"):
        refuse_unknown_keys(section, ("name", "terms", "rotor_inertia", "friction"))
        name = _read_name(section, [entry.name for entry in couplings])
        terms = _read_terms(section, names, kinds)
        prismatic = bool(terms) and all(kinds[index] is JointKind.PRISMATIC for index, _ in terms)
        unit = "kg" if prismatic else "kg*m^2"
        couplings.append(
            Coupling(
                name=name,
                terms=terms,
                has_rotor="rotor_inertia" in section.values,
                rotor_inertia=read_known(section, "rotor_inertia", unit, NOT_NEGATIVE),
                friction=read_friction(section, prismatic=prismatic),
            )
        )
    return tuple(couplings)


def _read_name(section: Section, taken: Sequence[str]) -> str:
    """Return the coupling's name, which ends the names of its parameters."""
    if "name" not in section.values:
        text = 'missing; write name = "m6": it ends the names of the parameters, as in IAm6'
        section.refuse_key("robot.missing-key", "name", text)
    name = read_text(section, "name")
    if name is None:
        return ""
    if not name.isidentifier() or not name.isascii():
        text = f"{section.show('name')} cannot end the name of a parameter; use letters, digits and _"
        section.refuse("robot.bad-name", "name", f"{text}, a letter first")
    elif name in taken:
        text = f"the name is taken by coupling {taken.index(name) + 1}; each coupling needs its own"
        section.refuse("robot.duplicate-coupling", "name", text)
    return name


def _read_terms(
    section: Section, names: Sequence[str], kinds: Sequence[JointKind | None]
) -> tuple[tuple[int, Fraction], ...]:
    if "terms" not in section.values:
        text = "missing; write terms = { joint5 = 1, joint6 = 1 }: speed = sum of factor * dq"
        section.refuse_key("robot.missing-key", "terms", text)
    table = read_table(section, "terms")
    if table is None:
        return ()
    if not table.values:
        text = "empty; write terms = { joint5 = 1, joint6 = 1 }, joints and factors"
        section.refuse("robot.missing-key", "terms", text)
    terms = []
    for name in table.values:
        factor = read_fraction(table, name, "leave the joint out: the drive does not turn with it")
        if name not in names:
            hint = find_nearest(name, names) or f"allowed are {', '.join(names)}"
            table.refuse_key("robot.unknown-joint", name, f"there is no such joint; {hint}")
        elif kinds[names.index(name)] is None:
            text = "the joint is fixed and drives nothing; name one that moves"
            table.refuse_key("robot.follows-fixed", name, text)
        elif factor is not None:
            terms.append((names.index(name), factor))
    return tuple(sorted(terms))
