"""The joints of a URDF, one by one.

Input: the `<joint>` elements. Output: `UrdfJoint` records in the order of the file.

Supported: origin, axis, limits, damping and friction of every type of joint; how joints hang together is for
`urdf_tree`, who follows whom for `urdf_mimics`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction

from symid.formats.section import explain_wide_limits, find_nearest, show
from symid.formats.urdf_elements import Element
from symid.formats.urdf_links import UrdfLink, warn_of_origin
from symid.formats.urdf_values import (
    Reading,
    find_only,
    is_endless,
    read_decimal,
    read_name,
    read_vector,
    refuse_text,
)
from symid.robot.axis_frames import find_axis_frame
from symid.robot.description import FrictionKind, FrictionValues, Limits
from symid.robot.geometry import IDENTITY, ZERO, Angle, Exact, Placement, find_angle
from symid.robot.rotations import rotate_rpy

__all__ = ["MOVING", "UrdfJoint", "read_joint_elements"]

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints with one coordinate."""

_TYPES = (*MOVING, "fixed", "floating", "planar")
_KNOWN = ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic")
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
    element: Element
    origin: Placement = IDENTITY
    turn: Placement = IDENTITY
    friction: FrictionValues = field(default_factory=FrictionValues)
    limits: Limits = field(default_factory=Limits)

    @property
    def moves(self) -> bool:
        """Return whether the type has a coordinate."""
        return self.type in MOVING


def read_joint_elements(
    reading: Reading, links: Mapping[str, UrdfLink], snap: float
) -> tuple[UrdfJoint, ...]:
    """Return the joints of the file; those without two links are reported and left out."""
    found: dict[str, UrdfJoint] = {}
    for element in reading.document.root.find_all("joint"):
        name = read_name(reading, "a joint", element, "name")
        if name is None:
            continue
        if name in found:
            line = reading.document.find_place(found[name].element).line
            text = f"joint '{name}': the name is taken by the joint of line {line}; each needs its own"
            reading.refuse("robot.duplicate-joint", text, element, "name")
            continue
        joint = _read_joint(reading, name, element, links, snap)
        if joint is not None:
            found[name] = joint
    return tuple(found.values())


def _read_joint(
    reading: Reading, name: str, element: Element, links: Mapping[str, UrdfLink], snap: float
) -> UrdfJoint | None:
    owner = f"joint '{name}'"
    type_ = _read_type(reading, owner, element)
    reading.skip_others(element, _KNOWN, ("name", "type"))
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


def _read_type(reading: Reading, owner: str, element: Element) -> str:
    found = element.attributes.get("type", "")
    if found not in _TYPES:
        said = f'got "{show(found)}"' if found else "and it has none"
        hint = find_nearest(found, _TYPES) if found else ""
        text = f"{owner}: its type must be one of {', '.join(_TYPES)}, {said}"
        reading.refuse("robot.joint-type", f"{text}; {hint}" if hint else text, element, "type")
        return "fixed"
    return found


def _read_end(
    reading: Reading, owner: str, joint: Element, tag: str, links: Mapping[str, UrdfLink]
) -> str | None:
    element = find_only(reading, owner, joint, tag)
    if element is None:
        reading.refuse("robot.missing-key", f'{owner}: missing <{tag} link="..."/>', joint)
        return None
    reading.skip_others(element, (), ("link",))
    return read_name(reading, owner, element, "link", links)


def _read_origin(reading: Reading, owner: str, joint: Element, snap: float) -> Placement:
    element = find_only(reading, owner, joint, "origin")
    if element is None:
        return IDENTITY
    reading.skip_others(element, (), ("xyz", "rpy"))
    refuse_text(reading, owner, element, 'xyz="0 0 0.1" rpy="0 0 0"')
    zero = (Decimal(0),) * 3
    xyz = read_vector(reading, owner, element, "xyz") or zero
    rpy = read_vector(reading, owner, element, "rpy") or zero
    warn_of_origin(reading, owner, element, xyz, rpy)
    angles = [find_angle(float(value), snap=snap) for value in rpy]
    _say_snapped(reading, owner, element, angles)
    roll, pitch, yaw = angles
    x, y, z = (_round_length(reading, owner, element, value, snap) for value in xyz)
    return Placement(rotation=rotate_rpy(roll, pitch, yaw).rotation, translation=(x, y, z))


def _say_snapped(reading: Reading, owner: str, element: Element, angles: list[Angle]) -> None:
    name = owner.removeprefix("joint ")
    moved = max((abs(angle.snapped_by) for angle in angles), default=0.0)
    if moved:
        text = "origin rpy was moved to the nearest multiple of pi/2, of joints (by rad) {}"
        reading.remark("robot.angle-snapped", text, f"{name} ({moved:.1e})", element, "rpy")


def _round_length(reading: Reading, owner: str, element: Element, value: Decimal, snap: float) -> Exact:
    """Return a length without the dust that floating-point programs leave in files."""
    if value and abs(value) < _DUST and snap:
        text = "lengths below 1e-9 m in origin xyz were taken as zero, of joints {}"
        reading.remark("robot.length-snapped", text, owner.removeprefix("joint "), element, "xyz")
        return ZERO
    exact = Fraction(value)
    return Exact.surd(round(exact * _PARTS) / _PARTS if snap else exact)


def _read_axis(reading: Reading, owner: str, joint: Element, snap: float) -> Placement:
    element = find_only(reading, owner, joint, "axis")
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
    turned = find_axis_frame((x, y, z), snap=snap)
    if turned.moved_by > _ROUNDED:
        where = "to the nearest coordinate axis or plane"
        text = f"{owner}: axis xyz: was moved by {turned.moved_by:.2e} rad {where}"
        reading.warn("robot.axis-snapped", text, element or joint, "xyz")
    length = float(x * x + y * y + z * z) ** 0.5
    if abs(length - 1.0) > 1e-5:
        text = f"{owner}: axis xyz: its length is {length:.6g}; it was made 1"
        reading.warn("robot.axis-length", text, element or joint, "xyz")
    return turned.placement


def _read_dynamics(reading: Reading, owner: str, joint: Element) -> FrictionValues:
    element = find_only(reading, owner, joint, "dynamics")
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


def _read_limits(reading: Reading, name: str, joint: Element, type_: str) -> Limits:
    owner = f"joint '{name}'"
    element = find_only(reading, owner, joint, "limit")
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
        position=_find_range(reading, name, element, type_, (low, high)),
        velocity=float(velocity) if velocity and velocity > 0 else None,
        torque=float(effort) if effort and effort > 0 else None,
    )


def _find_range(
    reading: Reading, name: str, element: Element, type_: str, ends: tuple[Decimal | None, Decimal | None]
) -> tuple[float, float] | None:
    """Return the limits of the position, None where they are no range or one of them is endless."""
    endless = [key for key in ("lower", "upper") if is_endless(element, key)]
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
