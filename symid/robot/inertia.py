"""Mass, centre of mass and inertia of a link, and its ten standard parameters.

Input: the values of a robot file. Output: XX XY XZ YY YZ ZZ MX MY MZ M about the origin of the link's
frame, where XY, XZ, YZ are entries of the inertia tensor (XY = - integral of x y dm).

Supported: both forms of a robot file, symbols in place of numbers, any frame on the link, the test whether a
mass distribution exists.
Not supported: masses that are not positive, symbols among the standard parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.notation import INERTIAL
from symid.robot.description import LinkForm
from symid.robot.forms import Symbols, read_form
from symid.robot.geometry import ZERO, Exact, Placement
from symid.robot.section import ANY, NOT_NEGATIVE, POSITIVE, Section, read_number, read_table

__all__ = ["Body", "find_impossibility", "find_standard_parameters", "move_parameters", "read_inertial"]

_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_UNITS = ("kg*m^2",) * 6 + ("kg*m",) * 3 + ("kg",)
# A flat or thin link sits on the edge of what is possible; rounding of its decimals may cross it.
_TOLERANCE = 1e-6


def _to_tensor(entries: Sequence[float]) -> FloatArray:
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.float64)


def move_parameters(
    parameters: Sequence[float], rotation: FloatArray, translation: FloatArray
) -> tuple[float, ...]:
    """Return the ten parameters seen from another frame (theorem of Huygens and Steiner).

    I' = R I R^T + 2 (p.s) 1 - p s^T - s p^T + M (p.p 1 - p p^T),  s = R l,  l' = s + M p.

    Args:
        parameters: (10,) about the old frame's origin, in its axes.
        rotation: (3, 3) R, the old frame's axes in the new frame.
        translation: (3,) p, the old frame's origin in the new frame, m.
    """
    mass = float(parameters[9])
    p = np.asarray(translation, dtype=np.float64)
    s = rotation @ np.asarray(parameters[6:9], dtype=np.float64)
    tensor = rotation @ _to_tensor(parameters[:6]) @ rotation.T
    tensor = tensor + 2 * (p @ s) * np.eye(3) - np.outer(p, s) - np.outer(s, p)
    tensor = tensor + mass * ((p @ p) * np.eye(3) - np.outer(p, p))
    moments = s + mass * p
    entries = (*tensor[np.triu_indices(3)], *moments, mass)
    return tuple(float(entry) + 0.0 for entry in entries)


def find_standard_parameters(
    mass: float, com: Sequence[float], inertia: Sequence[float]
) -> tuple[float, ...]:
    """Return the ten parameters of a link with the given centre of mass.

    Args:
        mass: kg.
        com: (3,) centre of mass in the link's frame, m.
        inertia: (6,) xx xy xz yy yz zz about the centre of mass, along the frame's axes, kg m^2.
    """
    central = (*inertia, 0.0, 0.0, 0.0, mass)
    return move_parameters(central, np.eye(3), np.asarray(com, dtype=np.float64))


def find_impossibility(parameters: Sequence[float]) -> str:
    """Return what keeps the ten parameters from belonging to a body of positive mass, or nothing.

    The principal moments J about the centre of mass must be positive, or zero, and none may exceed the
    sum of the others; equivalently the second moments are a positive semi-definite matrix
    (Wensing, Kim and Slotine 2018, IEEE Robotics and Automation Letters 3(1)).
    """
    mass = parameters[9]
    com = np.asarray(parameters[6:9], dtype=np.float64) / mass
    about_com = move_parameters(parameters, np.eye(3), -com)
    moments = np.linalg.eigvalsh(_to_tensor(about_com[:6]))
    allowed = _TOLERANCE * max(float(np.abs(parameters[:6]).max()), 1e-300)
    low, middle, high = (float(moment) for moment in moments)
    listed = f"{low:.6g}, {middle:.6g} and {high:.6g} kg*m^2"
    if low < -allowed:
        return f"the principal moments about the centre of mass are {listed}, and none can be negative"
    if high > low + middle + allowed:
        text = "and none can exceed the sum of the others"
        return f"the principal moments about the centre of mass are {listed}, {text}"
    return ""


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
    link = read_table(section, "link", ("mass", "com", "inertia", "standard"))
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
    if impossible := find_impossibility(found):
        text = f"no body has this inertia: {impossible}; check the values and the point they refer to"
        link.refuse("robot.impossible-inertia", key, text)
        return Body()
    if form is not None and not any(form.inertia):
        text = "inertia is taken as zero: a point mass; write inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }"
        section.warn("robot.point-mass", "link", f"{text} (kg*m^2) if the link has one")
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    translation = np.array([entry.to_float(symbols.values) for entry in frame.translation])
    return Body(
        parameters=move_parameters(found, rotation, translation),
        form=form if form and _has_symbols(form) else None,
    )


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
        number = read_number(table, key, unit, POSITIVE if key == "M" else ANY)
        numbers.append(float(number or 0))
    return tuple(numbers) if numbers[9] > 0 else None
