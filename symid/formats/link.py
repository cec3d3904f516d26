"""The `link` table of a robot file: mass, centre of mass and inertia, or the standard parameters.

Input: the values of a robot file. Output: XX XY XZ YY YZ ZZ MX MY MZ M about the origin of the link's
frame, and the form of a link whose values are symbols.

Supported: both forms of a robot file, symbols in place of numbers, any frame on the link. Standard parameters
that no body has (from a converted file, or identified) are kept, with a warning; mass, centre of mass and
inertia are typed by hand, where such values are a slip, and refused.
Not supported: negative masses, symbols among the standard parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symid.formats.forms import Symbols, read_form
from symid.formats.section import ANY, NOT_NEGATIVE, POSITIVE, Section, read_number, read_table
from symid.notation import INERTIAL
from symid.robot.description import LinkForm
from symid.robot.geometry import ZERO, Exact, Placement
from symid.robot.inertia import find_impossibility, find_standard_parameters, move_parameters

__all__ = ["Body", "read_body", "read_inertial"]

_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_UNITS = ("kg*m^2",) * 6 + ("kg*m",) * 3 + ("kg",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """What a `link` table says: the ten parameters about the link frame of this house, and their form."""

    parameters: tuple[float, ...] | None = None
    form: LinkForm | None = None


def read_inertial(section: Section, frame: Placement, symbols: Symbols) -> Body:
    """Return what a joint's `link` table says; neither parameters nor form where it states none.

    Args:
        section: the joint's table.
        frame: the frame that the file's values refer to, seen from the link's frame.
        symbols: those of the file.
    """
    return read_body(section, "link", frame, symbols)


def read_body(
    section: Section, name: str, frame: Placement, symbols: Symbols, others: tuple[str, ...] = ()
) -> Body:
    """Return what the table `name` says of a body, which may have keys besides; see `read_inertial`."""
    link = read_table(section, name, ("mass", "com", "inertia", "standard", *others))
    if link is None:
        return Body()
    errors = len(section.report.errors)
    key = "standard" if "standard" in link.values else "inertia"
    form = None
    if key == "standard":
        found = _read_standard(link)
    else:
        form = _read_form(link, symbols)
        found = _find_values(form, symbols.values) if form else None
    if found is None or len(section.report.errors) > errors:
        return Body()
    if not _check_possible(link, key, found):
        return Body()
    if form is not None and not any(form.inertia):
        text = "inertia is taken as zero: a point mass; write inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }"
        section.warn("robot.point-mass", name, f"{text} (kg*m^2) if the link has one")
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    translation = np.array([entry.to_float(symbols.values) for entry in frame.translation])
    return Body(
        parameters=move_parameters(found, rotation, translation),
        form=form if form and _has_symbols(form) else None,
    )


def _check_possible(link: Section, key: str, parameters: tuple[float, ...]) -> bool:
    """Return whether the values may stay; what no body has is a warning among standard parameters."""
    if not parameters[9]:
        if any(parameters):
            text = "no mass (M = 0), but other values: no body has them, and they are kept"
            link.warn("robot.inertia-without-mass", key, text)
        return True
    impossible = find_impossibility(parameters)
    if impossible and key == "standard":
        text = f"no body has these values, and they are kept: {impossible}"
        link.warn("robot.impossible-inertia", key, text)
    elif impossible:
        text = f"no body has this inertia: {impossible}; check the values and the point they refer to"
        link.refuse("robot.impossible-inertia", key, f"{text}, or write them as standard, which is kept")
        return False
    return True


def _has_symbols(form: LinkForm) -> bool:
    return any(entry.symbols for entry in (form.mass, *form.com, *form.inertia))


def _find_values(form: LinkForm, values: Mapping[str, float]) -> tuple[float, ...]:
    com = [entry.to_float(values) for entry in form.com]
    inertia = [entry.to_float(values) for entry in form.inertia]
    return find_standard_parameters(form.mass.to_float(values), com, inertia)


def _read_form(link: Section, symbols: Symbols) -> LinkForm | None:
    mass = read_form(link, "mass", symbols, "kg", allowed=POSITIVE)
    com: list[Exact] = [ZERO] * 3
    listed = link.values.get("com")
    if listed is not None and not (isinstance(listed, list) and len(listed) == 3):
        found = f"a list of {len(listed)}" if isinstance(listed, list) else link.show("com")
        link.refuse("robot.wrong-type", "com", f"expected a list of 3 numbers in m, got {found}")
    elif listed is not None:
        com = [read_form(link, "com", symbols, "m", index) or ZERO for index in range(3)]
    tensor = read_table(link, "inertia", _TENSOR)
    inertia = [ZERO] * 6
    if tensor is not None:
        for index, key in enumerate(_TENSOR):
            allowed = NOT_NEGATIVE if key[0] == key[1] else ANY
            inertia[index] = read_form(tensor, key, symbols, "kg*m^2", allowed=allowed) or ZERO
    if link.values and "mass" not in link.values:
        text = "missing; com and inertia mean nothing without it: write mass = 1.5 (kg), or leave them out"
        link.refuse_key("robot.missing-key", "mass", text)
    if mass is None:
        return None
    x, y, z = com
    xx, xy, xz, yy, yz, zz = inertia
    return LinkForm(mass=mass, com=(x, y, z), inertia=(xx, xy, xz, yy, yz, zz))


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
    for key, unit in zip(INERTIAL, _UNITS, strict=True):
        number = read_number(table, key, unit, NOT_NEGATIVE if key == "M" else ANY)
        numbers.append(float(number or 0))
    return tuple(numbers)
