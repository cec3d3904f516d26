"""The links, joints and transmissions of a URDF, one by one, with a notice for each mistake.

`TreeReading`, `TreeLink`, `TreeJoint` and `XmlPart` serve MJCF models, too: their bodies are read as links.

`<link>` -> `TreeLink` with XX XY XZ YY YZ ZZ MX MY MZ M about the link frame's origin; `<joint>` ->
`TreeJoint` in the order of the file; `<transmission>` -> `Drive` by the joint's name, the motor-side rotor
inertia multiplied by the square of the reduction. `urdf_reader` connects them.

Supported: decimals with or without exponent, below 1e-30 taken as zero; any inertial frame; inertias that no
body can have are kept, with a warning; one actuator on one joint, the reduction at the actuator, at the
joint or at the transmission itself.
Not supported: negative masses; nan, hexadecimal numbers, inf (except in limits, where it means no limit);
transmissions between several joints and actuators, which are listed as not used.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal, DecimalException
from fractions import Fraction

import numpy as np

from symid.arrays import FloatArray
from symid.errors import Notice, shorten_names
from symid.joint_models import FrictionValues
from symid.robot import geometry
from symid.robot.description import Coupling, Drive, Limits, MimicStep, Spring
from symid.robot.inertia import compute_standard_parameters, explain_impossible_inertia, move_parameters
from symid.robot.plausibility import explain_correction
from symid.robot.toml_values import Place, explain_wide_limits, show, sort_notices, suggest_names, to_decimal
from symid.robot.urdf_xml import TENSOR, XmlDocument, XmlElement

MJCF_UNUSED = "robot.mjcf-unused"
"""The code of notes on what an MJCF model has beyond the dynamics; all kinds are listed."""

INFERENCE = ("true", "false", "auto")
"""Whether something holds: auto where it follows from what else is stated."""

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints with one coordinate."""

_VISUAL = ("visual", "collision", "material", "gazebo")
_UNSEEN = "not used, and not needed for the dynamics: {}"
_SHOWN_LINES, _SHOWN_WORDS = 3, 6
_LONGEST_NUMBER = 100
_SMALLEST = Decimal("1e-30")
_DECIMAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_COUNTS = {2: "two", 3: "three", 4: "four", 6: "six"}
Terms = tuple[tuple[str, Fraction], ...]
Triple = tuple[Decimal, Decimal, Decimal]
NULL: Triple = (Decimal(0), Decimal(0), Decimal(0))
_TYPES = (*MOVING, "fixed", "floating", "planar")
_JOINT_TAGS = ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic")
_DUST = Decimal("1e-9")
# Doubles show their rounding in about this many parts of a metre.
_LENGTH_PARTS = Fraction(10**15)
_ROUNDED = 1e-9
_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "drake:gear_ratio")
ROTORS = ("motorInertia", "motor_inertia", "rotorInertia", "rotor_inertia", "drake:rotor_inertia")
"""Elements of an actuator that hold its rotor's inertia, on the motor's side."""

# How a controller talks to the joint is no mechanics.
_SILENT = ("hardwareInterface", "role")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSettings:
    """What <compiler> says: unit and sequence of angles, where inertias come from, when ranges hold."""

    degrees: bool = True
    sequence: str = "xyz"
    inference: str = "auto"
    groups: tuple[int, int] = (0, 5)
    autolimits: bool = True
    balance: bool = False

    def to_radians(self, value: Decimal) -> float:
        """Return an angle of the file in rad."""
        return math.radians(value) if self.degrees else float(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeReading:
    """A file that is being read: its links and joints by name, mistakes, and what is not used.

    `steps` are followers by name, `couplings` drives that turn with several joints, named as their terms.
    `blamed` has the element of each mistake.
    `grouped` has the names and places of warnings that are given once for many, by (code, text). Of an MJCF
    model `classes` has the elements where a class states attributes, by class, kind of element and attribute;
    `parts` bodies, joints and tendons by kind and name.
    """

    document: XmlDocument
    snap: float
    settings: ModelSettings = field(default_factory=ModelSettings)
    classes: dict[str, dict[str, dict[str, XmlElement]]] = field(default_factory=dict)
    parts: dict[tuple[str, str], "XmlPart"] = field(default_factory=dict)
    links: dict[str, "TreeLink"] = field(default_factory=dict)
    joints: dict[str, "TreeJoint"] = field(default_factory=dict)
    steps: dict[str, MimicStep] = field(default_factory=dict)
    couplings: list[tuple[Coupling, "XmlPart", Terms]] = field(default_factory=list)
    errors: list[Notice] = field(default_factory=list)
    blamed: dict[Notice, XmlElement] = field(default_factory=dict)
    warnings: list[Notice] = field(default_factory=list)
    grouped: dict[tuple[str, str], list[tuple[str, Place]]] = field(default_factory=dict)

    def enter(self, element: XmlElement, owner: str, kind: str = "", childclass: str = "") -> "XmlPart":
        """Return an element with what its class states for its `kind`; `childclass` is that around it."""
        name = element.attributes.get("class") or childclass or "main"
        defaults = self.classes.get(name, {}).get(kind, {})
        part = XmlPart(reading=self, owner=owner, element=element, defaults=defaults)
        if kind and name not in self.classes and name != "main":
            hint = suggest_names(name, self.classes, before="; ")
            part.refuse("robot.unknown-name", f'there is no default class "{show(name)}"{hint}', "class")
        return part

    def refuse(self, code: str, text: str, element: XmlElement | None = None, attribute: str = "") -> None:
        """Add an error at an element (default: the root) or at the value of one of its attributes."""
        place = self.document.locate_place(element or self.document.root, attribute)
        notice = place.notice(code, text)
        self.errors.append(notice)
        self.blamed[notice] = element or self.document.root

    def warn(self, code: str, text: str, element: XmlElement | None = None, attribute: str = "") -> None:
        """Add a warning, likewise."""
        place = self.document.locate_place(element or self.document.root, attribute)
        self.warnings.append(place.notice(code, text))

    def group(self, code: str, text: str, name: str, element: XmlElement, attribute: str = "") -> None:
        """Add `name` to a warning that is given once for all; its {} stands for the names."""
        place = self.document.locate_place(element, attribute)
        self.grouped.setdefault((code, text), []).append((name, place))

    def skip(self, kind: str, element: XmlElement, attribute: str = "") -> None:
        """Record something in the file that symid does not use."""
        self.group("robot.urdf-unused", f"not used: {kind} {{}}", "", element, attribute)

    def skip_others(self, element: XmlElement, tags: Iterable[str], attributes: Iterable[str]) -> None:
        """Record all inside `element` that has none of these names, and the text between its tags."""
        known = tuple(tags)
        for child in element.children:
            if child.tag in _VISUAL:
                self.group("robot.urdf-unused", _UNSEEN, f"<{child.tag}>", child)
            elif child.tag not in known:
                self.skip(f"<{child.tag}> in <{element.tag}>", child)
        if element.text:
            self.skip(f'the text "{show(element.text)}" in <{element.tag}>', element)
        known = tuple(attributes)
        for name in element.attributes:
            if name not in known:
                self.skip(f'attribute {name}="..." of <{element.tag}>', element, name)

    def list_warnings(self) -> tuple[Notice, ...]:
        """Return all warnings in the order of their places, those on unused things included."""
        notices = list(self.warnings)
        for (code, text), found in self.grouped.items():
            counts = Counter(name for name, _ in found)
            names = (name if count == 1 else f"{name} ({count})" for name, count in counts.items())
            words = shorten_names(names, _SHOWN_WORDS if code != MJCF_UNUSED else len(counts))
            if "" in counts:
                lines = [str(line) for line in dict.fromkeys(place.line for _, place in found)]
                often = "once" if len(found) == 1 else f"{len(found)} times"
                more = ", ..." if len(lines) > _SHOWN_LINES else ""
                listed = ", ".join(lines[:_SHOWN_LINES])
                words = f"({often}, line{'s'[: len(lines) > 1]} {listed}{more})"
            before, _, after = text.rpartition("{}")
            own = self.document.file
            first = min((at for _, at in found), key=lambda at: (at.file != own, at.line, at.column))
            notices.append(first.notice(code, f"{before}{words}{after}"))
        return sort_notices(notices)


@dataclass(frozen=True, slots=True, kw_only=True)
class XmlPart:
    """An element and its owner, such as "joint 'a'", which begins every message.

    `defaults` are the elements of its class that state what it does not, by attribute.
    """

    reading: TreeReading
    owner: str
    element: XmlElement
    defaults: Mapping[str, XmlElement] = field(default_factory=dict)

    @property
    def line(self) -> int:
        """Return the line in which the element stands."""
        return self.reading.document.locate_place(self.element).line

    def refuse(self, code: str, text: str, attribute: str = "") -> None:
        """Add an error at the element or at the value of one of its attributes."""
        self.reading.refuse(code, f"{self.owner}: {text}", self.at(attribute), attribute)

    def warn(self, code: str, text: str, attribute: str = "") -> None:
        """Add a warning, likewise."""
        self.reading.warn(code, f"{self.owner}: {text}", self.at(attribute), attribute)

    def group(self, code: str, text: str, detail: str = "", attribute: str = "") -> None:
        """Add the owner's name, with a detail, to a warning that is given once for all."""
        name = self.owner.partition(" ")[2]
        shown = f"{name} ({detail})" if detail else name
        self.reading.group(code, text, shown, self.at(attribute), attribute)

    def at(self, attribute: str) -> XmlElement:
        """Return the element that states an attribute: this one, or that of its class."""
        own = attribute in self.element.attributes
        return self.element if own else self.defaults.get(attribute, self.element)

    def has(self, attribute: str) -> bool:
        """Return whether the element or its class states an attribute."""
        return attribute in self.at(attribute).attributes

    def refuse_taken(self, tag: str, kind: str, other: "XmlPart") -> None:
        """Add an error where the `tag` of another one has the name already; `kind` ends the code."""
        text = f"the name is taken by the {tag} of line {other.line}; each needs its own"
        self.refuse(f"robot.duplicate-{kind}", text, "name")

    def enter(self, element: XmlElement) -> "XmlPart":
        """Return an element inside, of the same owner."""
        return XmlPart(reading=self.reading, owner=self.owner, element=element)

    def get(self, tag: str, *attributes: str, inner: Sequence[str] = ()) -> "XmlPart | None":
        """Return the element of this name; a second one is a mistake, other content than stated is unused."""
        found = [self.enter(element) for element in self.element.find_all(tag)]
        for other in found[1:]:
            other.refuse("robot.two-forms", f"a second <{tag}>; keep one of them")
        if found and (attributes or inner):
            self.reading.skip_others(found[0].element, inner, attributes)
        return found[0] if found else None

    def refuse_text(self, example: str) -> None:
        """Add an error where numbers stand between the tags, and not in attributes."""
        element = self.element
        if element.text and not {"xyz", "rpy"} & set(element.attributes):
            words = f'<{element.tag}> has text, "{show(element.text)}", and no xyz'
            text = f"{words}; numbers stand in attributes: write <{element.tag} {example}/>"
            self.refuse("robot.stray-text", text)

    def read_decimal(self, attribute: str, *, endless: bool = False) -> Decimal | None:
        """Return the number at an attribute (the element's text for ""); None where it is absent or wrong.

        `endless`: "inf" is allowed, with either sign.
        """
        text = self.at(attribute).attributes.get(attribute) if attribute else self.element.text
        if text is None:
            return None
        if endless and text.strip().lstrip("+-").lower() in {"inf", "infinity"}:
            return Decimal("inf")
        number = _parse_decimal(text.strip())
        if number is None:
            self._refuse_number(attribute, "a finite number", text)
        return number

    def read_vector(self, attribute: str) -> Triple | None:
        """Return the three numbers at an attribute; None where it is absent or wrong."""
        match self.read_numbers(attribute, 3):
            case (x, y, z):
                return (x, y, z)
        return None

    def read_numbers(self, attribute: str, least: int, most: int | None = None) -> tuple[Decimal, ...]:
        """Return `least` to `most` (by default `least`) numbers at an attribute; none if absent or wrong."""
        text = self.at(attribute).attributes.get(attribute)
        if text is None:
            return ()
        numbers = [_parse_decimal(part) for part in text.split()]
        if least <= len(numbers) <= (most or least) and None not in numbers:
            return tuple(number for number in numbers if number is not None)
        count = f"{_COUNTS.get(least, least)}{f' to {most}' if most else ''}"
        self._refuse_number(attribute, f"{count} finite numbers with spaces between them", text)
        return ()

    def _refuse_number(self, attribute: str, expected: str, text: str) -> None:
        hint = "; decimals are written with a point" if "," in text else ""
        hint = "; this is xacro: let the name end in .xacro" if "${" in text or "$(" in text else hint
        name = f"{self.at(attribute).tag} {attribute}".strip()
        self.refuse("robot.bad-number", f'{name}: expected {expected}, got "{show(text)}"{hint}', attribute)

    def read_float(self, attribute: str, default: float | None = None) -> float | None:
        """Return an attribute's number in floating point."""
        value = self.read_decimal(attribute)
        return default if value is None else float(value)

    def read_positive(self, attribute: str) -> float:
        """Return a number that is not negative, zero where there is none."""
        value = self.read_float(attribute) or 0.0
        if value < 0:
            self.refuse("robot.out-of-range", f"{attribute}: must be at least 0, got {value:g}", attribute)
        return max(value, 0.0)

    def read_linear(self, attribute: str) -> float:
        """Return a coefficient, zero where there is none."""
        value, *curved = self.read_numbers(attribute, 1, 3) or (0,)
        if any(curved):
            text = f"{attribute}: a polynomial is not supported; write one number"
            self.refuse("robot.mjcf-unsupported", text, attribute)
        return 0.0 if any(curved) else float(value)

    def read_word(self, attribute: str, default: str = "") -> str:
        """Return an attribute's text."""
        return self.at(attribute).attributes.get(attribute, default).strip()

    def read_choice(self, attribute: str, allowed: Sequence[str], default: str) -> str:
        """Return one of the words that an attribute allows."""
        value = self.read_word(attribute, default)
        if value in allowed:
            return value
        hint = suggest_names(value, allowed, before="; ")
        text = f'{attribute}: expected one of {", ".join(allowed)}, got "{show(value)}"{hint}'
        self.refuse("robot.unknown-name", text, attribute)
        return default

    def read_range(self, attribute: str, limited: str = "") -> tuple[float, float] | None:
        """Return two numbers, the first of them smaller; None where there are none, or `limited` forbids."""
        stated = self.read_choice(limited, INFERENCE, "auto") if limited else "true"
        if stated == "false" or (stated == "auto" and not self.reading.settings.autolimits):
            return None
        match self.read_numbers(attribute, 2):
            case (low, high) if low < high:
                return float(low), float(high)
            case (low, high) if low > high:
                text = f"{attribute}: the first number, {low}, must not exceed the second, {high}"
                self.refuse("robot.bad-limits", text, attribute)
        return None

    def read_name(self, attribute: str, known: Iterable[str] | None = None) -> str | None:
        """Return the name at an attribute, one of `known` where given; None where it is wrong."""
        kind = self.element.tag if attribute == "name" else attribute
        name = self.element.attributes.get(attribute, "")
        if not name.strip():
            self.refuse("robot.missing-key", f'<{self.element.tag}> needs a name: write {attribute}="..."')
            return None
        names = [name] if known is None else list(known)
        if name in names:
            return name
        hint = suggest_names(name, names, before="; ")
        self.refuse("robot.unknown-name", f'there is no {kind} "{show(name)}" in this file{hint}', attribute)
        return None


def _parse_decimal(text: str) -> Decimal | None:
    if len(text) > _LONGEST_NUMBER or not _DECIMAL.fullmatch(text):
        return None
    try:
        number = Decimal(text)
        return to_decimal(number) if abs(number) >= _SMALLEST else Decimal(0)
    except DecimalException:  # an exponent beyond all bounds
        return None


def _list_parts(
    reading: TreeReading, tag: str, known: Mapping[str, "TreeLink | TreeJoint"]
) -> Iterator[tuple[str, XmlPart]]:
    """Yield the name of each link or joint and the part, but those without a name of their own."""
    for element in reading.document.root.find_all(tag):
        name = reading.enter(element, f"a {tag}").read_name("name")
        part = reading.enter(element, f"{tag} '{name}'")
        if name is not None and name in known:
            part.refuse_taken(tag, tag, known[name].part)
        elif name is not None:
            yield name, part


def _read_pose(owner: XmlPart) -> tuple[XmlPart, Triple, Triple] | None:
    """Return <origin> with xyz and rpy; values that look like millimetres or degrees get a warning."""
    origin = owner.get("origin", "xyz", "rpy")
    if origin is None:
        return None
    origin.refuse_text('xyz="0 0 0.1" rpy="0 0 0"')
    xyz, rpy = (origin.read_vector(key) or NULL for key in ("xyz", "rpy"))
    if (far := max(map(abs, xyz))) > 10:
        origin.warn("robot.long-length", f"origin xyz: {far} m is too long; write lengths in m", "xyz")
    if (wide := max(map(abs, rpy))) > 12:
        turns = float(wide) / math.tau
        text = f"origin rpy: {wide} is about {turns:.1f} turns; write angles in rad"
        origin.warn("robot.large-angle", text, "rpy")
    return origin, xyz, rpy


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeLink:
    """A link, its ten parameters where stated; `between`: without mass, between joints of one MJCF body."""

    name: str
    part: XmlPart
    inertial: tuple[float, ...] | None
    between: bool = False

    @property
    def mass(self) -> float:
        """Return the mass in kg, zero where the file states none."""
        return self.inertial[9] if self.inertial else 0.0


def build_rpy_matrix(rpy: Sequence[float]) -> FloatArray:
    """Return Rot(z, yaw) Rot(y, pitch) Rot(x, roll) (3, 3) of angles (3,) in rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _read_inertial(link: XmlPart) -> tuple[float, ...] | None:
    inertial = link.get("inertial", inner=("origin", "mass", "inertia"))
    if inertial is None:
        return None
    part = inertial.get("mass", "value")
    number = None if part is None else part.read_decimal("value")
    if part is None or "value" not in part.element.attributes:
        text = '<inertial> has no mass; write <mass value="1.5"/> (kg), or leave it out'
        (part or inertial).refuse("robot.missing-key", text)
    elif number is not None and number < 0:
        part.refuse("robot.out-of-range", f"mass: must be at least 0 kg, got {number}", "value")
    tensor, central, place = inertial.get("inertia", *TENSOR), [0.0] * 6, inertial.element.find("inertia")
    before = len(link.reading.errors)
    if tensor is None:
        inertial.group("robot.point-mass", "links {}: <inertial> without <inertia>: point masses; add it")
    else:
        if missing := [key for key in TENSOR if key not in tensor.element.attributes]:
            tensor.warn("robot.incomplete-inertia", f"inertia: {', '.join(missing)} missing, so zero; add it")
        central = [float(tensor.read_decimal(key) or 0) for key in TENSOR]
    is_wrong = number is None or number < 0 or len(link.reading.errors) > before
    rotation, com = np.eye(3), [0.0] * 3
    if pose := _read_pose(inertial):
        com = [float(value) for value in pose[1]]
        rotation = build_rpy_matrix([float(value) for value in pose[2]])
    if is_wrong:
        return None
    return build_body(inertial.enter(place or inertial.element), float(number or 0), com, central, rotation)


def build_body(
    part: XmlPart, mass: float, com: Sequence[float], central: Sequence[float], rotation: FloatArray
) -> tuple[float, ...]:
    """Return the ten parameters of a body in its link's frame; warn if no body has such ones.

    `part` states them: mass (kg), centre of mass (3,) in m, and xx xy xz yy yz zz about it (6,), kg m^2, in
    axes of their own, `rotation` (3, 3) in the link's frame.
    """
    turned = move_parameters((*central, 0.0, 0.0, 0.0, mass), rotation, np.zeros(3))
    found = compute_standard_parameters(mass, com, turned[:6])
    if mass and (impossible := explain_impossible_inertia(found)):
        likely = explain_correction(mass, com, central)
        text = f"no physical body has this inertia, and simulation may fail; check it: {impossible}{likely}"
        part.warn("robot.impossible-inertia", text)
    elif not mass and any(found):
        text = "links {}: inertia without mass, which no physical body has; state the mass"
        part.group("robot.inertia-without-mass", text)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeJoint:
    """A joint of the file: `origin` places the child's frame in the parent's, `turn` takes z to the axis.

    At `origin` its coordinate is `zero` (rad or m), which a URDF does not state. A `spring` rests at a
    position of this coordinate.
    """

    name: str
    type: str
    parent: str
    child: str
    part: XmlPart
    origin: geometry.Placement = geometry.IDENTITY
    turn: geometry.Placement = geometry.IDENTITY
    friction: FrictionValues = field(default_factory=FrictionValues)
    limits: Limits = field(default_factory=Limits)
    drive: Drive = field(default_factory=Drive)
    zero: geometry.Exact = geometry.ZERO
    spring: Spring | None = None

    @property
    def moves(self) -> bool:
        """Return whether the type has a coordinate."""
        return self.type in MOVING


def read_parts(document: XmlDocument, snap: float) -> TreeReading:
    """Return the links and joints of a URDF; joints without two links are reported and left out.

    Rotations within `snap` (rad) of multiples of pi/2 are taken as these.
    """
    reading, root = TreeReading(document=document, snap=snap), document.root
    namespaces = (name for name in root.attributes if name.startswith("xmlns"))
    reading.skip_others(root, ("link", "joint", "transmission", "loop_joint"), ("name", *namespaces))
    for name, part in _list_parts(reading, "link", reading.links):
        reading.skip_others(part.element, ("inertial",), ("name",))
        reading.links[name] = TreeLink(name=name, part=part, inertial=_read_inertial(part))
    for name, part in _list_parts(reading, "joint", reading.joints):
        if joint := _read_joint(name, part):
            reading.joints[name] = joint
    _read_drives(reading)
    # Followers as the file writes them.
    for joint in reading.joints.values():
        mimic = joint.part.get("mimic")
        if mimic is None:
            continue
        if not joint.moves:
            reading.skip(f"<mimic> of a {joint.type} joint", mimic.element)
            continue
        reading.skip_others(mimic.element, (), ("joint", "multiplier", "offset"))
        master = mimic.read_name("joint", reading.joints)
        multiplier, offset = mimic.read_decimal("multiplier"), mimic.read_decimal("offset")
        if master is not None:
            factor, shift = Fraction(1 if multiplier is None else multiplier), Fraction(offset or 0)
            step = MimicStep(master=master, multiplier=factor, offset=geometry.Exact.surd(shift))
            reading.steps[joint.name] = step
    return reading


def _read_joint(name: str, part: XmlPart) -> TreeJoint | None:
    reading, element = part.reading, part.element
    type_ = element.attributes.get("type", "")
    if type_ not in _TYPES:
        got = f'got "{show(type_)}"{suggest_names(type_, _TYPES, before="; ")}' if type_ else "got none"
        part.refuse("robot.joint-type", f"type: expected one of {', '.join(_TYPES)}, {got}", "type")
        type_ = "fixed"
    reading.skip_others(element, _JOINT_TAGS, ("name", "type"))
    ends = []
    for tag in ("parent", "child"):
        end = part.get(tag, "link")
        if end is None:
            part.refuse("robot.missing-key", f'missing <{tag} link="..."/>')
        ends.append(None if end is None else end.read_name("link", reading.links))
    origin = geometry.IDENTITY
    if (pose := _read_pose(part)) is not None:
        place, xyz, rpy = pose
        roll, pitch, yaw = (geometry.build_exact_angle(float(value), snap=reading.snap) for value in rpy)
        if moved := max(abs(angle.snapped_by) for angle in (roll, pitch, yaw)):
            text = "origin rpy was moved to a multiple of pi/2, keep it by --snap 0, of joints (by rad) {}"
            place.group("robot.angle-snapped", text, f"{moved:.1e}", "rpy")
        exact = zip(rpy, (roll, pitch, yaw), strict=True)
        if any(geometry.is_rounded_turn(value) and not angle.snapped_by for value, angle in exact):
            text = "origin rpy holds rounded multiples of pi/2 that are taken as written, of joints {}"
            place.group("robot.angle-rounded", text, attribute="rpy")
        text = "lengths below 1e-9 m in origin xyz were taken as zero, of joints {}"
        lengths = build_lengths(place, xyz, "xyz", text)
        origin = replace(geometry.rotate_rpy(roll, pitch, yaw), translation=lengths)
    turn, friction, limits = geometry.IDENTITY, FrictionValues(), Limits()
    if type_ in MOVING:
        found, axis = part.get("axis", "xyz"), (Decimal(1), Decimal(0), Decimal(0))
        place = found or part
        if found is None or (not found.element.text and "xyz" not in found.element.attributes):
            place.group("robot.default-axis", "no <axis> with xyz, so it is x (1 0 0), of joints {}")
        if found is not None:
            found.refuse_text('xyz="0 0 1"')
            axis = found.read_vector("xyz") or axis
        length = math.hypot(*map(float, axis))
        if any(axis) and abs(length - 1.0) > 1e-5:
            place.warn("robot.axis-length", f"axis xyz: its length {length:.6g} was set to 1", "xyz")
        turn = build_axis(place, axis, "xyz", "axis xyz")
        if dynamics := part.get("dynamics", "damping", "friction"):
            values = [dynamics.read_decimal(key) for key in ("damping", "friction")]
            for key, value in zip(("damping", "friction"), values, strict=True):
                if value is not None and value < 0:
                    text = f"dynamics {key}: {value} drives the joint instead of braking it; correct the sign"
                    dynamics.warn("robot.negative-friction", text, key)
            friction = build_friction(float(values[0] or 0), float(values[1] or 0))
        limits = _read_limits(part, type_)
    else:
        for unused in element.find_all("axis", "limit", "dynamics"):
            reading.skip(f"<{unused.tag}> of a {type_} joint", unused)
    parent, child = ends
    if parent is None or child is None:
        return None
    joint = TreeJoint(name=name, type=type_, parent=parent, child=child, part=part, origin=origin)
    return replace(joint, turn=turn, friction=friction, limits=limits)


def build_lengths(part: XmlPart, xyz: Triple, attribute: str, dust: str) -> geometry.ExactVector:
    """Return the lengths (m) at an attribute; `dust` is the warning where a program left a tiny one."""
    lengths, snap = [], part.reading.snap
    for value in xyz:
        # Floating-point programs leave dust in files.
        if value and abs(value) < _DUST and snap:
            part.group("robot.length-snapped", dust, attribute=attribute)
            lengths.append(geometry.ZERO)
            continue
        exact = Fraction(value)
        lengths.append(geometry.Exact.surd(round(exact * _LENGTH_PARTS) / _LENGTH_PARTS if snap else exact))
    x, y, z = lengths
    return (x, y, z)


def build_axis(part: XmlPart, axis: Sequence[Decimal | Fraction], key: str, name: str) -> geometry.Placement:
    """Return what takes z to an axis at the attribute `key`, which messages call `name`."""
    if not any(axis):
        part.refuse("robot.zero-axis", f"{name}: the axis 0 0 0 has no direction", key)
        return geometry.IDENTITY
    x, y, z = (Fraction(value) for value in axis)
    turn, moved = geometry.build_axis_frame((x, y, z), snap=part.reading.snap)
    if moved > _ROUNDED:
        text = f"{name} was moved to a coordinate axis or plane, keep it by --snap 0, at (by rad) {{}}"
        part.group("robot.axis-snapped", text, f"{moved:.1e}", key)
    return turn


def build_friction(damping: float, dry: float) -> FrictionValues:
    """Return friction of damping (N m s/rad or N s/m) and dry friction (N m or N); none if both are zero."""
    if not damping and not dry:
        return FrictionValues()
    return FrictionValues(law="coulomb-viscous", values=(damping, dry))


def _read_limits(joint: XmlPart, type_: str) -> Limits:
    """Return the limits; that of the position is None where it is no range, or one of its ends infinite."""
    keys = ("lower", "upper", "velocity", "effort")
    part = joint.get("limit", *keys)
    if part is None:
        return Limits()
    lower, upper, *others = (part.read_decimal(key, endless=True) for key in keys)
    largest: list[float | None] = []
    for key, value in zip(keys[2:], others, strict=True):
        if value is not None and value < 0:
            text = f"limit {key} negative, so that none is kept; write it positive, of joints {{}}"
            part.group("robot.bad-limits", text, attribute=key)
        largest.append(float(value) if value and 0 < value < math.inf else None)
    limits = Limits(velocity=largest[0], torque=largest[1])
    ends = (lower, upper)
    if type_ == "continuous" and ends != (None, None):
        part.reading.skip("lower and upper in <limit> of a continuous joint", part.element)
    if type_ == "continuous" or ends == (None, None):
        return limits
    if endless := [key for key, end in zip(keys, ends, strict=False) if end and end.is_infinite()]:
        text = "a position limit is infinite, so none is used, of joints {}"
        part.group("robot.endless-limits", text, attribute=endless[0])
        return limits
    # An absent limit of the two is zero.
    low, high = (float(end or 0) for end in ends)
    if low >= high:
        if low or high:
            text = f"limit: lower {low:g} is not less than upper {high:g}, so that none is kept; correct them"
            part.warn("robot.bad-limits", text, "lower")
        return limits
    if type_ == "revolute" and (doubt := explain_wide_limits(low, high)):
        part.warn("robot.large-angle", f"limit: {doubt}", "lower")
    return replace(limits, position=(low, high))


def _read_drives(reading: TreeReading) -> None:
    """Add the drives to the joints."""
    lines: dict[str, int] = {}
    for element in reading.document.root.find_all("transmission"):
        joints, actuators = (list(element.find_all(tag)) for tag in ("joint", "actuator"))
        if len(joints) != 1 or len(actuators) != 1:
            reading.skip("<transmission> that is not one actuator on one joint", element)
            continue
        part = reading.enter(element, f"transmission '{element.attributes.get('name', '')}'")
        for inner, known in (
            (element, ("type", "joint", "actuator", *_REDUCTIONS)),
            (joints[0], _REDUCTIONS),
            (actuators[0], (*_REDUCTIONS, *ROTORS)),
        ):
            reading.skip_others(inner, (*known, *_SILENT), ("name", "type"))
        name = part.enter(joints[0]).read_name("name")
        if name is not None and (name not in reading.joints or not reading.joints[name].moves):
            reading.skip("<transmission> of a joint that is fixed, or not in the file", element)
            continue
        before = len(reading.errors)
        places = (actuators[0], joints[0], element)
        reductions = [part.enter(child) for place in places for child in place.find_all(*_REDUCTIONS)]
        rotors = [part.enter(child) for child in actuators[0].find_all(*ROTORS)]
        reduction = _read_one(reductions, "mechanical reductions")
        inertia = _read_one(rotors, "rotor inertias")
        if reduction == 0:
            text = "mechanicalReduction: must not be 0; it is the number of motor turns per joint turn"
            reductions[0].refuse("robot.out-of-range", text)
        if inertia is not None and inertia < 0:
            text = f"{rotors[0].element.tag}: must be at least 0 kg*m^2, got {inertia}"
            rotors[0].refuse("robot.out-of-range", text)
        if name is None or len(reading.errors) > before:
            continue
        if name in lines:
            text = f"joint '{name}' already has the transmission of line {lines[name]}; keep one of them"
            part.refuse("robot.two-forms", text)
            continue
        gear = 1.0 if reduction is None else float(reduction)
        rotor = None if inertia is None else float(inertia) * gear**2
        drive = Drive(gear=gear, has_rotor=bool(rotors), rotor_inertia=rotor, direct=reduction == 1)
        reading.joints[name], lines[name] = replace(reading.joints[name], drive=drive), part.line


def _read_one(parts: Sequence[XmlPart], what: str) -> Decimal | None:
    """Return the number that all of the elements state, None without any; two that differ are wrong."""
    # Between the tags, or as the attribute `value`.
    values = [part.read_decimal("value" if "value" in part.element.attributes else "") for part in parts]
    for part, value in zip(parts[1:], values[1:], strict=True):
        if None not in (value, values[0]) and value != values[0]:
            part.refuse("robot.two-forms", f"two {what} that differ, {values[0]} and {value}; keep one")
            return None
    return values[0] if values else None
