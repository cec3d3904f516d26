"""Gears and rotors out of the `<transmission>` elements of a URDF.

Input: the transmissions. Output: a `Drive` by joint name.

Supported: one actuator on one joint, the reduction at the actuator, at the joint or at the transmission
itself; rotor inertia at the actuator, on the motor side. It is multiplied by the square of the reduction.
Not supported: transmissions between several joints and actuators; they are listed as not used.
"""

from collections.abc import Mapping, Sequence
from decimal import Decimal

from symid.formats.urdf_elements import Element
from symid.formats.urdf_joints import UrdfJoint
from symid.formats.urdf_values import Reading, read_decimal, read_name
from symid.robot.description import Drive

__all__ = ["ROTORS", "read_drives"]

_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "drake:gear_ratio")
ROTORS = ("motorInertia", "motor_inertia", "rotorInertia", "rotor_inertia", "drake:rotor_inertia")
"""Elements of an actuator that hold its rotor's inertia, on the motor's side."""

_KNOWN = ("type", "joint", "actuator", *_REDUCTIONS)
# What says how a controller talks to the joint, and nothing about the mechanics.
_SILENT = ("hardwareInterface", "role")


def read_drives(reading: Reading, joints: Mapping[str, UrdfJoint]) -> dict[str, Drive]:
    """Return the drives by the name of their joint.

    Args:
        reading: where mistakes go.
        joints: the joints of the file by name.
    """
    drives: dict[str, Drive] = {}
    seen: dict[str, Element] = {}
    for element in reading.document.root.find_all("transmission"):
        ends = [element.find(tag) for tag in ("joint", "actuator")]
        joint, actuator = ends
        alone = all(len(list(element.find_all(tag))) == 1 for tag in ("joint", "actuator"))
        if joint is None or actuator is None or not alone:
            reading.skip("<transmission> that is not one actuator on one joint", element)
            continue
        owner = f"transmission '{element.attributes.get('name', '')}'"
        for part, known in ((element, _KNOWN), (joint, _REDUCTIONS), (actuator, (*_REDUCTIONS, *ROTORS))):
            reading.skip_others(part, (*known, *_SILENT), ("name", "type"))
        name = read_name(reading, owner, joint, "name")
        if name is not None and (name not in joints or not joints[name].moves):
            reading.skip("<transmission> of a joint that is fixed, or not in the file", element)
            continue
        drive = _read_drive(reading, owner, (actuator, joint, element))
        if name is None or drive is None:
            continue
        if name in seen:
            line = reading.document.find_place(seen[name]).line
            text = f"{owner}: joint '{name}' has the transmission of line {line} already; keep one of them"
            reading.refuse("robot.two-forms", text, element)
            continue
        seen[name] = element
        drives[name] = drive
    return drives


def _read_drive(reading: Reading, owner: str, parts: tuple[Element, Element, Element]) -> Drive | None:
    errors = len(reading.report.errors)
    reductions = [child for part in parts for child in part.find_all(*_REDUCTIONS)]
    rotors = list(parts[0].find_all(*ROTORS))
    reduction = _read_one(reading, owner, reductions, "mechanical reductions")
    inertia = _read_one(reading, owner, rotors, "rotor inertias")
    if reduction == 0:
        text = f"{owner}: mechanicalReduction: must not be 0; it is the motor's turns per turn of the joint"
        reading.refuse("robot.out-of-range", text, reductions[0])
    if inertia is not None and inertia < 0:
        text = f"{owner}: {rotors[0].tag}: must be at least 0 kg*m^2, got {inertia}"
        reading.refuse("robot.out-of-range", text, rotors[0])
    if len(reading.report.errors) > errors:
        return None
    gear = 1.0 if reduction is None else float(reduction)
    return Drive(
        gear=gear,
        has_rotor=bool(rotors),
        rotor_inertia=None if inertia is None else float(inertia) * gear**2,
    )


def _read_one(reading: Reading, owner: str, elements: Sequence[Element], what: str) -> Decimal | None:
    """Return the number that all of the elements state, None without any; two that differ are wrong."""
    values = [_read_number(reading, owner, element) for element in elements]
    for element, value in zip(elements[1:], values[1:], strict=True):
        if None not in (value, values[0]) and value != values[0]:
            text = f"{owner}: two {what} that differ, {values[0]} and {value}; keep one"
            reading.refuse("robot.two-forms", text, element)
            return None
    return values[0] if values else None


def _read_number(reading: Reading, owner: str, element: Element) -> Decimal | None:
    """Return the number between the tags, or that of the attribute `value`."""
    return read_decimal(reading, owner, element, "value" if "value" in element.attributes else "")
