"""The links of a URDF and their inertial values.

Input: the `<link>` elements. Output: `UrdfLink` records by name, with XX XY XZ YY YZ ZZ MX MY MZ M about the
link frame's origin.

Supported: inertial frames turned and shifted in any way; values that no body has are kept, and said.
Not supported: negative masses.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from symid.arrays import FloatArray
from symid.formats.urdf_elements import Element
from symid.formats.urdf_values import Reading, find_only, read_decimal, read_name, read_vector, refuse_text
from symid.robot.inertia import find_impossibility, find_standard_parameters, move_parameters

__all__ = ["UrdfLink", "read_links", "warn_of_origin"]

_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LARGEST_ANGLE = 12
_LARGEST_LENGTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfLink:
    """A link: its name, its element, the ten parameters in its own frame where the file states any."""

    name: str
    element: Element
    inertial: tuple[float, ...] | None

    @property
    def mass(self) -> float:
        """Return the mass in kg, zero where the file states none."""
        return self.inertial[9] if self.inertial else 0.0


def read_links(reading: Reading) -> dict[str, UrdfLink]:
    """Return the links by name, in the order of the file."""
    links: dict[str, UrdfLink] = {}
    for element in reading.document.root.find_all("link"):
        name = read_name(reading, "a link", element, "name")
        if name is None:
            continue
        if name in links:
            line = reading.document.find_place(links[name].element).line
            text = f"link '{name}': the name is taken by the link of line {line}; each needs its own"
            reading.refuse("robot.duplicate-link", text, element, "name")
            continue
        reading.skip_others(element, ("inertial",), ("name",))
        links[name] = UrdfLink(name=name, element=element, inertial=_read_inertial(reading, name, element))
    return links


def warn_of_origin(
    reading: Reading, owner: str, origin: Element, xyz: Sequence[Decimal], rpy: Sequence[Decimal]
) -> None:
    """Warn of lengths and angles that look like millimetres and degrees."""
    if any(abs(value) > _LARGEST_LENGTH for value in xyz):
        far = max(abs(value) for value in xyz)
        text = f"{owner}: origin xyz: {far} m is long; lengths are in m"
        reading.warn("robot.long-length", text, origin, "xyz")
    if any(abs(value) > _LARGEST_ANGLE for value in rpy):
        wide = max(abs(value) for value in rpy)
        turns = float(wide) / math.tau
        text = f"{owner}: origin rpy: {wide} is about {turns:.1f} turns; angles are in rad"
        reading.warn("robot.large-angle", text, origin, "rpy")


def _read_inertial(reading: Reading, name: str, link: Element) -> tuple[float, ...] | None:
    owner = f"link '{name}'"
    inertial = find_only(reading, owner, link, "inertial")
    if inertial is None:
        return None
    reading.skip_others(inertial, ("origin", "mass", "inertia"), ())
    mass = _read_mass(reading, owner, inertial)
    central = _read_tensor(reading, owner, inertial)
    rotation, com = np.eye(3), (Decimal(0),) * 3
    origin = find_only(reading, owner, inertial, "origin")
    if origin is not None:
        reading.skip_others(origin, (), ("xyz", "rpy"))
        refuse_text(reading, owner, origin, 'xyz="0 0 0.1" rpy="0 0 0"')
        com = read_vector(reading, owner, origin, "xyz") or com
        rpy = read_vector(reading, owner, origin, "rpy") or (Decimal(0),) * 3
        warn_of_origin(reading, owner, origin, com, rpy)
        rotation = _turn([float(value) for value in rpy])
    if mass is None or central is None:
        return None
    turned = move_parameters((*central, 0.0, 0.0, 0.0, mass), rotation, np.zeros(3))
    found = find_standard_parameters(mass, [float(value) for value in com], turned[:6])
    _warn_of_impossible(reading, owner, inertial, found)
    return found


def _turn(rpy: Sequence[float]) -> FloatArray:
    """Return Rot(z, yaw) Rot(y, pitch) Rot(x, roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _read_mass(reading: Reading, owner: str, inertial: Element) -> float | None:
    element = find_only(reading, owner, inertial, "mass")
    if element is None or "value" not in element.attributes:
        text = f'{owner}: <inertial> has no mass; write <mass value="1.5"/> (kg), or leave it out'
        reading.refuse("robot.missing-key", text, element or inertial)
        return None
    reading.skip_others(element, (), ("value",))
    mass = read_decimal(reading, owner, element, "value")
    if mass is not None and mass < 0:
        text = f"{owner}: mass: must be at least 0 kg, got {mass}"
        reading.refuse("robot.out-of-range", text, element, "value")
        return None
    return None if mass is None else float(mass)


def _read_tensor(reading: Reading, owner: str, inertial: Element) -> list[float] | None:
    element = find_only(reading, owner, inertial, "inertia")
    if element is None:
        text = "links {}: <inertial> without <inertia>; taken as point masses"
        reading.remark("robot.point-mass", text, owner.removeprefix("link "), inertial)
        return [0.0] * 6
    reading.skip_others(element, (), _TENSOR)
    missing = [key for key in _TENSOR if key not in element.attributes]
    if missing:
        text = f"{owner}: inertia: {', '.join(missing)} missing; taken as zero"
        reading.warn("robot.incomplete-inertia", text, element)
    errors = len(reading.report.errors)
    entries = [float(read_decimal(reading, owner, element, key) or 0) for key in _TENSOR]
    return entries if len(reading.report.errors) == errors else None


def _warn_of_impossible(reading: Reading, owner: str, inertial: Element, parameters: Sequence[float]) -> None:
    if parameters[9] == 0:
        if any(parameters):
            text = "links {}: inertia without mass; no body has it, and the values are kept"
            reading.remark("robot.inertia-without-mass", text, owner.removeprefix("link "), inertial)
        return
    if impossible := find_impossibility(parameters):
        text = f"{owner}: no body has this inertia, and the values are kept: {impossible}"
        reading.warn("robot.impossible-inertia", text, inertial.find("inertia") or inertial)
