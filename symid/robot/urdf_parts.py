"""The links, joints and transmissions of a URDF, one by one.

`<link>` -> `UrdfLink` with XX XY XZ YY YZ ZZ MX MY MZ M about the link frame's origin; `<joint>` ->
`UrdfJoint` in the order of the file; `<transmission>` -> `Drive` by the joint's name, the motor-side rotor
inertia multiplied by the square of the reduction. How joints hang together and which follow which is for
`urdf_reader`.

Supported: inertial frames turned and shifted in any way; values that no body has are kept, with a warning;
origin, axis, limits, damping and friction of every type of joint; one actuator on one joint, the reduction
at the actuator, at the joint or at the transmission itself.
Not supported: negative masses; transmissions between several joints and actuators, which are listed as not
used.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction

import numpy as np

from symid.arrays import FloatArray
from symid.robot.description import Drive, FrictionKind, FrictionValues, Limits
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    Placement,
    build_axis_frame,
    build_exact_angle,
    rotate_rpy,
)
from symid.robot.inertia import compute_standard_parameters, explain_impossible_inertia, move_parameters
from symid.robot.toml_values import explain_wide_limits, show, suggest_names
from symid.robot.urdf_xml import (
    UrdfReading,
    XmlElement,
    get_single,
    is_infinite,
    read_decimal,
    read_name,
    read_vector,
    refuse_text,
)

_INERTIA_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LARGEST_ANGLE = 12
_LARGEST_LENGTH = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfLink:
    """A link: its name, its element, the ten parameters in its own frame where the file states any."""

    name: str
    element: XmlElement
    inertial: tuple[float, ...] | None

    @property
    def mass(self) -> float:
        """Return the mass in kg, zero where the file states none."""
        return self.inertial[9] if self.inertial else 0.0


def read_links(reading: UrdfReading) -> dict[str, UrdfLink]:
    """Return the links by name, in the order of the file."""
    links: dict[str, UrdfLink] = {}
    for element in reading.document.root.find_all("link"):
        name = _read_new_name(reading, element, links)
        if name is None:
            continue
        reading.skip_others(element, ("inertial",), ("name",))
        links[name] = UrdfLink(name=name, element=element, inertial=_read_inertial(reading, name, element))
    return links


def _read_new_name(
    reading: UrdfReading, element: XmlElement, known: "Mapping[str, UrdfLink | UrdfJoint]"
) -> str | None:
    """Return the name of a link or joint; None where there is none, or it is taken."""
    tag = element.tag
    name = read_name(reading, f"a {tag}", element, "name")
    if name is not None and name in known:
        line = reading.document.find_place(known[name].element).line
        text = f"{tag} '{name}': the name is taken by the {tag} of line {line}; each needs its own"
        reading.refuse(f"robot.duplicate-{tag}", text, element, "name")
        return None
    return name


_Triple = tuple[Decimal, Decimal, Decimal]


def _read_pose(
    reading: UrdfReading, owner: str, element: XmlElement
) -> tuple[XmlElement, _Triple, _Triple] | None:
    """Return <origin> with xyz and rpy; those that look like millimetres and degrees get a warning."""
    origin = get_single(reading, owner, element, "origin")
    if origin is None:
        return None
    reading.skip_others(origin, (), ("xyz", "rpy"))
    refuse_text(reading, owner, origin, 'xyz="0 0 0.1" rpy="0 0 0"')
    zero = (Decimal(0),) * 3
    xyz, rpy = (read_vector(reading, owner, origin, key) or zero for key in ("xyz", "rpy"))
    if any(abs(value) > _LARGEST_LENGTH for value in xyz):
        far = max(abs(value) for value in xyz)
        text = f"{owner}: origin xyz: {far} m is long; lengths are in m"
        reading.warn("robot.long-length", text, origin, "xyz")
    if any(abs(value) > _LARGEST_ANGLE for value in rpy):
        wide = max(abs(value) for value in rpy)
        turns = float(wide) / math.tau
        text = f"{owner}: origin rpy: {wide} is about {turns:.1f} turns; angles are in rad"
        reading.warn("robot.large-angle", text, origin, "rpy")
    return origin, xyz, rpy


def _read_inertial(reading: UrdfReading, name: str, link: XmlElement) -> tuple[float, ...] | None:
    owner = f"link '{name}'"
    inertial = get_single(reading, owner, link, "inertial")
    if inertial is None:
        return None
    reading.skip_others(inertial, ("origin", "mass", "inertia"), ())
    mass = _read_mass(reading, owner, inertial)
    central = _read_tensor(reading, owner, inertial)
    rotation, com = np.eye(3), (Decimal(0),) * 3
    pose = _read_pose(reading, owner, inertial)
    if pose is not None:
        com = pose[1]
        rotation = _compute_rpy_matrix([float(value) for value in pose[2]])
    if mass is None or central is None:
        return None
    turned = move_parameters((*central, 0.0, 0.0, 0.0, mass), rotation, np.zeros(3))
    found = compute_standard_parameters(mass, [float(value) for value in com], turned[:6])
    _warn_of_impossible_inertia(reading, owner, inertial, found)
    return found


def _compute_rpy_matrix(rpy: Sequence[float]) -> FloatArray:
    """Return Rot(z, yaw) Rot(y, pitch) Rot(x, roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _read_mass(reading: UrdfReading, owner: str, inertial: XmlElement) -> float | None:
    element = get_single(reading, owner, inertial, "mass")
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


def _read_tensor(reading: UrdfReading, owner: str, inertial: XmlElement) -> list[float] | None:
    element = get_single(reading, owner, inertial, "inertia")
    if element is None:
        text = "links {}: <inertial> without <inertia>; taken as point masses"
        reading.remark("robot.point-mass", text, owner.removeprefix("link "), inertial)
        return [0.0] * 6
    reading.skip_others(element, (), _INERTIA_KEYS)
    missing = [key for key in _INERTIA_KEYS if key not in element.attributes]
    if missing:
        text = f"{owner}: inertia: {', '.join(missing)} missing; taken as zero"
        reading.warn("robot.incomplete-inertia", text, element)
    errors = len(reading.report.errors)
    entries = [float(read_decimal(reading, owner, element, key) or 0) for key in _INERTIA_KEYS]
    return entries if len(reading.report.errors) == errors else None


def _warn_of_impossible_inertia(
    reading: UrdfReading, owner: str, inertial: XmlElement, parameters: Sequence[float]
) -> None:
    if parameters[9] == 0:
        if any(parameters):
            text = "links {}: inertia without mass; no body has it, and the values are kept"
            reading.remark("robot.inertia-without-mass", text, owner.removeprefix("link "), inertial)
        return
    if impossible := explain_impossible_inertia(parameters):
        text = f"{owner}: no body has this inertia, and the values are kept: {impossible}"
        reading.warn("robot.impossible-inertia", text, inertial.find("inertia") or inertial)


MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints with one coordinate."""

_TYPES = (*MOVING, "fixed", "floating", "planar")
_JOINT_TAGS = ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic")
_DUST = Decimal("1e-9")
# Doubles show their rounding in about this many parts of a metre.
_PARTS = Fraction(10**15)
_ROUNDED = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfJoint:
    """A joint of the file: `origin` places the child's frame in the parent's, `turn` takes z to the axis."""

    name: str
    type: str
    parent: str
    child: str
    element: XmlElement
    origin: Placement = IDENTITY
    turn: Placement = IDENTITY
    friction: FrictionValues = field(default_factory=FrictionValues)
    limits: Limits = field(default_factory=Limits)

    @property
    def moves(self) -> bool:
        """Return whether the type has a coordinate."""
        return self.type in MOVING


def read_joint_elements(
    reading: UrdfReading, links: Mapping[str, UrdfLink], snap: float
) -> tuple[UrdfJoint, ...]:
    """Return the joints of the file; those without two links are reported and left out."""
    found: dict[str, UrdfJoint] = {}
    for element in reading.document.root.find_all("joint"):
        name = _read_new_name(reading, element, found)
        joint = _read_joint(reading, name, element, links, snap) if name is not None else None
        if name is not None and joint is not None:
            found[name] = joint
    return tuple(found.values())


def _read_joint(
    reading: UrdfReading, name: str, element: XmlElement, links: Mapping[str, UrdfLink], snap: float
) -> UrdfJoint | None:
    owner = f"joint '{name}'"
    type_ = _read_type(reading, owner, element)
    reading.skip_others(element, _JOINT_TAGS, ("name", "type"))
    parent = _read_end(reading, owner, element, "parent", links)
    child = _read_end(reading, owner, element, "child", links)
    origin = _read_origin(reading, owner, element, snap)
    moves = type_ in MOVING
    if not moves:
        for unused in element.find_all("axis", "limit", "dynamics"):
            reading.skip(f"<{unused.tag}> of a {type_} joint", unused)
    turn = _read_axis(reading, owner, element, snap) if moves else IDENTITY
    friction = _read_dynamics(reading, owner, element) if moves else FrictionValues()
    limits = _read_limits(reading, name, element, type_) if moves else Limits()
    if parent is None or child is None:
        return None
    return UrdfJoint(
        name=name,
        type=type_,
        parent=parent,
        child=child,
        element=element,
        origin=origin,
        turn=turn,
        friction=friction,
        limits=limits,
    )


def _read_type(reading: UrdfReading, owner: str, element: XmlElement) -> str:
    found = element.attributes.get("type", "")
    if found not in _TYPES:
        said = f'got "{show(found)}"' if found else "and it has none"
        hint = suggest_names(found, _TYPES) if found else ""
        text = f"{owner}: its type must be one of {', '.join(_TYPES)}, {said}"
        reading.refuse("robot.joint-type", f"{text}; {hint}" if hint else text, element, "type")
        return "fixed"
    return found


def _read_end(
    reading: UrdfReading, owner: str, joint: XmlElement, tag: str, links: Mapping[str, UrdfLink]
) -> str | None:
    element = get_single(reading, owner, joint, tag)
    if element is None:
        reading.refuse("robot.missing-key", f'{owner}: missing <{tag} link="..."/>', joint)
        return None
    reading.skip_others(element, (), ("link",))
    return read_name(reading, owner, element, "link", links)


def _read_origin(reading: UrdfReading, owner: str, joint: XmlElement, snap: float) -> Placement:
    pose = _read_pose(reading, owner, joint)
    if pose is None:
        return IDENTITY
    element, xyz, rpy = pose
    angles = [build_exact_angle(float(value), snap=snap) for value in rpy]
    moved = max(abs(angle.snapped_by) for angle in angles)
    if moved:
        name = owner.removeprefix("joint ")
        text = "origin rpy was moved to the nearest multiple of pi/2, of joints (by rad) {}"
        reading.remark("robot.angle-snapped", text, f"{name} ({moved:.1e})", element, "rpy")
    roll, pitch, yaw = angles
    x, y, z = (_round_length(reading, owner, element, value, snap) for value in xyz)
    return Placement(rotation=rotate_rpy(roll, pitch, yaw).rotation, translation=(x, y, z))


def _round_length(
    reading: UrdfReading, owner: str, element: XmlElement, value: Decimal, snap: float
) -> Exact:
    """Return a length without the dust that floating-point programs leave in files."""
    if value and abs(value) < _DUST and snap:
        text = "lengths below 1e-9 m in origin xyz were taken as zero, of joints {}"
        reading.remark("robot.length-snapped", text, owner.removeprefix("joint "), element, "xyz")
        return ZERO
    exact = Fraction(value)
    return Exact.surd(round(exact * _PARTS) / _PARTS if snap else exact)


def _read_axis(reading: UrdfReading, owner: str, joint: XmlElement, snap: float) -> Placement:
    element = get_single(reading, owner, joint, "axis")
    axis = (Decimal(1), Decimal(0), Decimal(0))
    if element is None or (not element.text and "xyz" not in element.attributes):
        name, text = owner.removeprefix("joint "), "no <axis> with xyz, so it is x (1 0 0), of joints {}"
        reading.remark("robot.default-axis", text, name, element or joint)
    if element is not None:
        reading.skip_others(element, (), ("xyz",))
        refuse_text(reading, owner, element, 'xyz="0 0 1"')
        axis = read_vector(reading, owner, element, "xyz") or axis
    if not any(axis):
        text = f"{owner}: axis xyz: the axis 0 0 0 has no direction"
        reading.refuse("robot.zero-axis", text, element or joint, "xyz")
        return IDENTITY
    x, y, z = (Fraction(value) for value in axis)
    turned = build_axis_frame((x, y, z), snap=snap)
    if turned.moved_by > _ROUNDED:
        where = "to the nearest coordinate axis or plane"
        text = f"{owner}: axis xyz: was moved by {turned.moved_by:.2e} rad {where}"
        reading.warn("robot.axis-snapped", text, element or joint, "xyz")
    length = float(x * x + y * y + z * z) ** 0.5
    if abs(length - 1.0) > 1e-5:
        text = f"{owner}: axis xyz: its length is {length:.6g}; it was made 1"
        reading.warn("robot.axis-length", text, element or joint, "xyz")
    return turned.placement


def _read_dynamics(reading: UrdfReading, owner: str, joint: XmlElement) -> FrictionValues:
    element = get_single(reading, owner, joint, "dynamics")
    if element is None:
        return FrictionValues()
    reading.skip_others(element, (), ("damping", "friction"))
    values = []
    for key in ("damping", "friction"):
        value = read_decimal(reading, owner, element, key)
        if value is not None and value < 0:
            text = f"{owner}: dynamics {key}: {value} drives the joint instead of braking it"
            reading.warn("robot.negative-friction", text, element, key)
        values.append(float(value or 0))
    if not any(values):
        return FrictionValues()
    return FrictionValues(kind=FrictionKind.VISCOUS_COULOMB, values=(values[0], values[1]))


def _read_limits(reading: UrdfReading, name: str, joint: XmlElement, type_: str) -> Limits:
    owner = f"joint '{name}'"
    element = get_single(reading, owner, joint, "limit")
    if element is None:
        return Limits()
    reading.skip_others(element, (), ("lower", "upper", "velocity", "effort"))
    low, high, velocity, effort = (
        read_decimal(reading, owner, element, key, endless=True)
        for key in ("lower", "upper", "velocity", "effort")
    )
    for key, value in (("velocity", velocity), ("effort", effort)):
        if value is not None and value < 0:
            text = f"limit {key} negative, taken as unknown, of joints {{}}"
            reading.remark("robot.bad-limits", text, f"'{name}'", element, key)
    return Limits(
        position=_choose_position_limits(reading, name, element, type_, (low, high)),
        velocity=float(velocity) if velocity and velocity > 0 else None,
        torque=float(effort) if effort and effort > 0 else None,
    )


def _choose_position_limits(
    reading: UrdfReading,
    name: str,
    element: XmlElement,
    type_: str,
    ends: tuple[Decimal | None, Decimal | None],
) -> tuple[float, float] | None:
    """Return the limits of the position, None where they are no range or one of them is endless."""
    endless = [key for key in ("lower", "upper") if is_infinite(element, key)]
    if type_ == "continuous":
        if endless or ends != (None, None):
            reading.skip("lower and upper in <limit> of a continuous joint", element)
        return None
    if endless:
        text = "a position limit is infinite, so none is used, of joints {}"
        reading.remark("robot.endless-limits", text, f"'{name}'", element, endless[0])
        return None
    if ends == (None, None):
        return None
    # An absent limit of the two is zero.
    low, high = (float(end or 0) for end in ends)
    if low >= high:
        if low or high:
            text = f"joint '{name}': limit: lower {low:g} is not less than upper {high:g}; not used"
            reading.warn("robot.bad-limits", text, element, "lower")
        return None
    if type_ == "revolute" and (doubt := explain_wide_limits(low, high)):
        reading.warn("robot.large-angle", f"joint '{name}': limit: {doubt}", element, "lower")
    return (low, high)


_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "drake:gear_ratio")
ROTORS = ("motorInertia", "motor_inertia", "rotorInertia", "rotor_inertia", "drake:rotor_inertia")
"""Elements of an actuator that hold its rotor's inertia, on the motor's side."""

_TRANSMISSION_TAGS = ("type", "joint", "actuator", *_REDUCTIONS)
# What says how a controller talks to the joint, and nothing about the mechanics.
_SILENT = ("hardwareInterface", "role")


def read_drives(reading: UrdfReading, joints: Mapping[str, UrdfJoint]) -> dict[str, Drive]:
    """Return the drives by the name of their joint.

    Args:
        reading: where mistakes go.
        joints: the joints of the file by name.
    """
    drives: dict[str, Drive] = {}
    seen: dict[str, XmlElement] = {}
    for element in reading.document.root.find_all("transmission"):
        ends = [element.find(tag) for tag in ("joint", "actuator")]
        joint, actuator = ends
        alone = all(len(list(element.find_all(tag))) == 1 for tag in ("joint", "actuator"))
        if joint is None or actuator is None or not alone:
            reading.skip("<transmission> that is not one actuator on one joint", element)
            continue
        owner = f"transmission '{element.attributes.get('name', '')}'"
        for part, known in (
            (element, _TRANSMISSION_TAGS),
            (joint, _REDUCTIONS),
            (actuator, (*_REDUCTIONS, *ROTORS)),
        ):
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


def _read_drive(
    reading: UrdfReading, owner: str, parts: tuple[XmlElement, XmlElement, XmlElement]
) -> Drive | None:
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


def _read_one(reading: UrdfReading, owner: str, elements: Sequence[XmlElement], what: str) -> Decimal | None:
    """Return the number that all of the elements state, None without any; two that differ are wrong."""
    # Between the tags, or as the attribute `value`.
    values = [
        read_decimal(reading, owner, element, "value" if "value" in element.attributes else "")
        for element in elements
    ]
    for element, value in zip(elements[1:], values[1:], strict=True):
        if None not in (value, values[0]) and value != values[0]:
            text = f"{owner}: two {what} that differ, {values[0]} and {value}; keep one"
            reading.refuse("robot.two-forms", text, element)
            return None
    return values[0] if values else None
