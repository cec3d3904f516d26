"""A robot from an MJCF model, the format of MuJoCo, or the part of it from a base body to a tip body.

A path -> `Robot`, or one `RobotError` with all mistakes and their places; what symid does not use is listed
in the robot's notices. Bodies become links, several joints of one body a chain of links without mass, a body
without a joint a part of the body that carries it; from there on the model is read as a URDF is
(`urdf_reader.assemble_robot`). A coordinate is the joint's `qpos` of MuJoCo, `ref` included.

Supported: angles in degrees (the format's own unit) or rad; quat, axisangle, euler in any sequence, xyaxes,
zaxis; nested classes; frames, included files; inertias of primitive geoms (sphere, capsule, cylinder,
ellipsoid, box) from their mass or density, solid; hinges and slides with range, damping, frictionloss,
armature, stiffness; gears and forces of actuators at joints; followers (<equality>, linear, of joints, or of
fixed tendons that hold one joint to one other); fixed tendons with armature, damping or frictionloss, as
coupled drives; gravity.
Not supported, and refused: free and ball joints in the chosen part, <connect>, <weld>, equalities of more
joints, curved followers, armature and damping of actuators, <attach>, <replicate>, <composite>, <flexcomp>,
plugins of bodies, inertias of meshes, height fields and shells, polynomial springs and dampers,
`springdamper`, corrections of the compiler (balanceinertia, boundmass, boundinertia, settotalmass), where
they change values.
Not in the model, and said in a warning: forces of a medium, gravcomp, springs of tendons, spatial tendons
with mechanics, flags that switch forces off.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from symid.errors import RobotError
from symid.robot import geometry, urdf_parts
from symid.robot.description import Coupling, Drive, Limits, MimicStep, Robot, Spring
from symid.robot.inertia import explain_impossible_inertia, move_parameters
from symid.robot.toml_values import read_text_file, show
from symid.robot.urdf_reader import DEFAULT_SNAP, assemble_robot, read_urdf
from symid.robot.urdf_xml import XmlDocument, XmlElement, parse_document, read_urdf_text

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
"""The attributes that turn a frame; an element has one of them at most."""

ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "pid", "damper", "cylinder", "muscle"),
    *("orientation", "adhesion", "dcmotor", "plugin"),
)
"""The kinds of actuators; they share their defaults."""

_FEEDBACK = ("position", "velocity", "intvelocity", "pid", "damper")
_TORQUE = "actuatorfrcrange"
_UPRIGHT = (Decimal(0), Decimal(0), Decimal(1))
_Body = tuple[float, ...] | None
_COUNTS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
_TURNS = {"x": geometry.rotate_x, "y": geometry.rotate_y, "z": geometry.rotate_z}
_ANGLES = ("radian", "degree")
_ROUNDED = 1e-9
# Rad between a multiple of pi/2 and what was written with three digits, such as 1.57 or 0.707.
_SEEN_AS_ROUNDED = 1e-3
_HINGE, _SLIDE = "hinge", "slide"
_JOINTS = (_HINGE, _SLIDE, "ball", "free")
# xx xy xz yy yz zz, from the order of the format: xx yy zz xy xz yz.
_ORDER = (0, 3, 4, 1, 5, 2)
_SOLIDS = ("sphere", "capsule", "cylinder", "ellipsoid", "box")
_NO_BODIES = ("plane", "hfield")
_GEOMS = (*_NO_BODIES, *_SOLIDS, "mesh", "sdf")
WORLD = "world"
"""The body that does not move."""

# An included part of a model is one by its tag, too.
_ROOTS = ("mujoco", "mujocoinclude")
_UNUSED = "not used, and not needed for the dynamics: {}"
_LOST = "forces that the model and its torques lack; keep them out of logs: {}"
_REFUSED = ("attach", "replicate", "composite", "flexcomp", "plugin")
_READ = ("inertial", "joint", "freejoint", "body", "frame", "geom")
_SECTIONS = ("compiler", "option", "default", "worldbody", "tendon", "equality", "actuator", "include")
_KNOWN = {
    "compiler": (
        *("angle", "eulerseq", "inertiafromgeom", "inertiagrouprange", "autolimits", "balanceinertia"),
        *("boundmass", "boundinertia", "settotalmass", "coordinate"),
    ),
    "body": ("name", "childclass", "pos", "gravcomp", *ORIENTATIONS),
    "joint": (
        *("name", "class", "type", "pos", "axis", "range", "limited", "actuatorfrcrange"),
        *("actuatorfrclimited", "damping", "frictionloss", "armature", "stiffness", "springref", "ref"),
        *("springdamper", "springyield"),
    ),
}


def read_settings(reading: urdf_parts.TreeReading, entries: Sequence[XmlElement]) -> urdf_parts.ModelSettings:
    """Return what all <compiler> elements say together; a later one replaces an earlier one."""
    found = urdf_parts.ModelSettings()
    for element in entries:
        part = reading.enter(element, "compiler")
        unit = part.read_choice("angle", _ANGLES, "degree" if found.degrees else "radian")
        sequence = part.read_word("eulerseq", found.sequence)
        if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
            text = f'eulerseq: expected three of the letters x, y, z, X, Y, Z, got "{show(sequence)}"'
            part.refuse("robot.unknown-name", text, "eulerseq")
            sequence = found.sequence
        groups = part.read_numbers("inertiagrouprange", 2)
        if part.read_word("coordinate", "local") != "local":
            text = "coordinate: MuJoCo no longer reads global coordinates; write local ones"
            part.refuse("robot.mjcf-unsupported", text, "coordinate")
        for attribute in ("boundmass", "boundinertia", "settotalmass"):
            if (part.read_float(attribute) or 0.0) > 0:
                text = f"{attribute}: is not supported; write the values that it gives into the bodies"
                part.refuse("robot.mjcf-unsupported", text, attribute)
        found = urdf_parts.ModelSettings(
            degrees=unit == "degree",
            sequence=sequence,
            inference=part.read_choice("inertiafromgeom", urdf_parts.INFERENCE, found.inference),
            groups=(int(groups[0]), int(groups[1])) if groups else found.groups,
            autolimits=part.read_choice("autolimits", urdf_parts.INFERENCE[:2], str(found.autolimits).lower())
            == "true",
            balance=part.read_choice("balanceinertia", urdf_parts.INFERENCE[:2], str(found.balance).lower())
            == "true",
        )
    return found


def read_classes(reading: urdf_parts.TreeReading, elements: Sequence[XmlElement]) -> None:
    """Add the classes of all <default> elements, each with what it takes over from the one around it."""
    waiting = [(element, "") for element in reversed(elements)]
    while waiting:
        element, above = waiting.pop()
        name = element.attributes.get("class", "" if above else "main")
        if not name or (above and name in reading.classes) or (not above and name != "main"):
            text = f'the outermost class is main; write <default class="{show(name)}"> into it'
            if above:
                text = "its name is taken; each needs its own" if name else "needs a name: write class=..."
            reading.enter(element, f"default class '{name}'").refuse("robot.duplicate-class", text, "class")
            continue
        inherited = reading.classes.get(above or "main", {})
        stated = {kind: dict(entries) for kind, entries in inherited.items()}
        for child in element.children:
            kind = "actuator" if child.tag in ACTUATORS else child.tag
            stated.setdefault(kind, {}).update(dict.fromkeys(child.attributes, child))
        reading.classes[name] = stated
        waiting += [(child, name) for child in reversed(element.children) if child.tag == "default"]


def read_rotation(part: urdf_parts.XmlPart) -> geometry.Placement:
    """Return the turn that an element states, exactly; none where it states none."""
    stated = [name for name in ORIENTATIONS if part.has(name)]
    if len(stated) > 1:
        text = f"{' and '.join(stated)} mean the same; keep one of them"
        part.refuse("robot.two-forms", text, stated[1])
    if not stated:
        return geometry.IDENTITY
    name, settings = stated[0], part.reading.settings
    numbers = part.read_numbers(name, _COUNTS[name])
    match name, numbers:
        case _, ():
            return geometry.IDENTITY
        case "quat", (w, *vector):
            if not any(numbers):
                part.refuse("robot.zero-axis", "quat: must not be zero; no turn is 1 0 0 0", name)
                return geometry.IDENTITY
            axes = [k for k, value in enumerate(vector) if value]
            if len(axes) <= 1:
                k = axes[0] if axes else 0
                return _TURNS["xyz"[k]](_build_angle(part, 2 * math.atan2(vector[k], w), name))
            rotation = geometry.compute_rotation([geometry.Exact.surd(Fraction(value)) for value in numbers])
            return _settle(part, replace(geometry.IDENTITY, rotation=rotation), name)
        case "axisangle", (x, y, z, angle):
            frame = urdf_parts.build_axis(part, (x, y, z), name, name)
            return _turn_about(part, frame, settings.to_radians(angle), name)
        case "zaxis", (x, y, z):
            return _turn_to(part, (x, y, z), name)
        case "xyaxes", _:
            # x goes there, and y into the half plane of the second three numbers.
            a, b, c, d, e, f = map(Fraction, numbers)
            normal = (b * f - c * e, c * d - a * f, a * e - b * d)
            if not any(normal):
                text = "xyaxes: the two axes must have different directions"
                part.refuse("robot.zero-axis", text, name)
                return geometry.IDENTITY
            frame = urdf_parts.build_axis(part, normal, name, name)
            across, along, _ = np.array(geometry.to_floats(frame)).T @ np.array([a, b, c], dtype=np.float64)
            turn = geometry.rotate_z(_build_angle(part, math.atan2(along, across), name))
            return _settle(part, geometry.compose_placements(frame, turn), name)
    turn = geometry.IDENTITY
    for letter, value in zip(settings.sequence, numbers, strict=True):
        step = _TURNS[letter.lower()](_build_angle(part, settings.to_radians(value), name))
        # Small letters turn about axes that turn along, capital ones about those of the parent.
        turn = geometry.compose_placements(*((turn, step) if letter.islower() else (step, turn)))
    return turn


def _build_angle(part: urdf_parts.XmlPart, radians: float, attribute: str) -> geometry.Angle:
    angle = geometry.build_exact_angle(radians, snap=part.reading.snap)
    _tell_snap(part, angle.snapped_by, attribute)
    quarter = round(radians / (math.pi / 2)) * (math.pi / 2)
    if quarter and _ROUNDED < abs(radians - quarter) < _SEEN_AS_ROUNDED and not angle.snapped_by:
        text = f"{attribute} holds rounded multiples of pi/2 that are taken as written, of bodies {{}}"
        part.group("robot.angle-rounded", text, attribute=attribute)
    return angle


def _tell_snap(part: urdf_parts.XmlPart, moved: float, attribute: str) -> None:
    if moved:
        text = f"{attribute} was moved to a multiple of pi/2, keep it by --snap 0, of bodies (by rad) {{}}"
        part.group("robot.angle-snapped", text, f"{abs(moved):.1e}", attribute)


def _turn_about(
    part: urdf_parts.XmlPart, frame: geometry.Placement, radians: float, attribute: str
) -> geometry.Placement:
    """Return the turn about the z axis of a frame."""
    turn = geometry.rotate_z(_build_angle(part, radians, attribute))
    return geometry.compose_placements(frame, turn, geometry.invert_placement(frame))


def _turn_to(part: urdf_parts.XmlPart, axis: urdf_parts.Triple, attribute: str) -> geometry.Placement:
    """Return the least turn that takes z to an axis; about x where any would do."""
    x, y, z = axis
    if not any(axis):
        part.refuse("robot.zero-axis", f"{attribute}: the axis 0 0 0 has no direction", attribute)
        return geometry.IDENTITY
    zero, one = Decimal(0), Decimal(1)
    frame = urdf_parts.build_axis(part, (-y, x, zero) if x or y else (one, zero, zero), attribute, attribute)
    return _turn_about(part, frame, math.atan2(math.hypot(x, y), z), attribute)


def _settle(part: urdf_parts.XmlPart, turn: geometry.Placement, attribute: str) -> geometry.Placement:
    """Return a turn by right angles where it is near one."""
    snap = part.reading.snap
    settled = geometry.snap_to_quarter_turns(turn, snap=snap) if snap else None
    if settled is None:
        return turn
    moved = float(np.abs(np.array(geometry.to_floats(settled)) - geometry.to_floats(turn)).max())
    _tell_snap(part, moved if moved > _ROUNDED else 0.0, attribute)
    return settled


def read_placement(own: urdf_parts.XmlPart) -> geometry.Placement:
    """Return the frame that pos and an orientation state."""
    return replace(read_rotation(own), translation=_read_position(own))


def _read_position(own: urdf_parts.XmlPart) -> geometry.ExactVector:
    text = "lengths below 1e-9 m in pos were taken as zero, of {}"
    return urdf_parts.build_lengths(own, own.read_vector("pos") or urdf_parts.NULL, "pos", text)


def read_joint(
    own: urdf_parts.XmlPart,
    name: str,
    ends: tuple[str, str],
    origin: geometry.Placement,
    frame: geometry.Placement,
) -> urdf_parts.TreeJoint:
    """Return a joint between two links; `frame` is that around it seen from its body, `origin` the body's."""
    kind = "free" if own.element.tag == "freejoint" else own.read_choice("type", _JOINTS, _HINGE)
    joint = urdf_parts.TreeJoint(name=name, type=kind, parent=ends[0], child=ends[1], part=own, origin=origin)
    if kind not in (_HINGE, _SLIDE):
        return joint
    axis = urdf_parts.build_axis(own, own.read_vector("axis") or _UPRIGHT, "axis", "axis")
    unit = math.pi / 180 if own.reading.settings.degrees and kind == _HINGE else 1.0
    position = own.read_range("range", "limited")
    zero = own.read_decimal("ref") or Decimal(0)
    armature, damping = own.read_positive("armature"), own.read_linear("damping")
    if damping < 0:
        text = f"damping: {damping:g} drives the joint instead of braking it; correct the sign"
        own.warn("robot.negative-friction", text, "damping")
    turn = geometry.compose_placements(frame, geometry.translate(*_read_position(own)), axis)
    friction = urdf_parts.build_friction(damping, own.read_positive("frictionloss"))
    # What the actuators may have together.
    torque = None
    if bounds := own.read_range(_TORQUE, "actuatorfrclimited"):
        low, high = bounds
        if low != -high:
            text = f"{_TORQUE} differs by direction, the smaller torque is the limit, of joints {{}}"
            own.group("robot.uneven-limits", text, attribute=_TORQUE)
        torque = min(-low, high) if low < 0 < high else None
    if any(own.read_numbers("springdamper", 2)):
        text = "springdamper: is not supported; write the stiffness and damping that it gives"
        own.refuse("robot.mjcf-unsupported", text, "springdamper")
    spring = None
    if stiffness := own.read_linear("stiffness"):
        if own.read_positive("springyield"):
            text = "springyield: a spring that yields is not supported; leave it out"
            own.refuse("robot.mjcf-unsupported", text, "springyield")
        spring = Spring(stiffness=stiffness, rest=(own.read_float("springref") or 0.0) * unit)
    return replace(
        joint,
        type={_HINGE: "revolute" if position else "continuous", _SLIDE: "prismatic"}[kind],
        turn=turn,
        friction=friction,
        limits=Limits(position=(position[0] * unit, position[1] * unit) if position else None, torque=torque),
        drive=Drive(has_rotor=armature > 0, rotor_inertia=armature or None),
        zero=geometry.Exact.surd(Fraction(zero)) if unit == 1.0 else geometry.Exact.of(float(zero) * unit),
        spring=spring,
    )


def read_body(
    body: urdf_parts.XmlPart, geoms: Sequence[tuple[urdf_parts.XmlPart, geometry.Placement]], *, moves: bool
) -> _Body:
    """Return the ten parameters of a body in its frame, None where nothing states them.

    `geoms` come with the frame around each, seen from the body. A body that does not move needs no inertia.
    """
    inertial = body.get("inertial")
    inference, groups = body.reading.settings.inference, body.reading.settings.groups
    found: _Body = None
    if moves and (inference == "true" or (inference == "auto" and inertial is None)):
        inside = [pair for pair in geoms if groups[0] <= (pair[0].read_float("group") or 0) <= groups[1]]
        entries = [entry for entry in (_compute_geom(geom, frame) for geom, frame in inside) if entry]
        found = tuple(float(value) for value in np.sum(entries, axis=0)) if entries else None
        if inside and inference == "true":
            return found
    if inertial is not None:
        missing = [name for name in ("pos", "mass") if name not in inertial.element.attributes]
        if missing:
            inertial.refuse("robot.missing-key", f"<inertial> needs {' and '.join(missing)}")
        full, principal = inertial.read_numbers("fullinertia", 6), inertial.read_numbers("diaginertia", 3)
        if full and (principal or any(map(inertial.has, ORIENTATIONS))):
            text = "fullinertia stands in the axes of the body; leave out diaginertia and orientations"
            inertial.refuse("robot.two-forms", text, "fullinertia")
        com = [float(value) for value in inertial.read_vector("pos") or urdf_parts.NULL]
        rotation = np.array(geometry.to_floats(read_rotation(inertial)))
        central = [float(full[k]) for k in _ORDER] if full else [0.0] * 6
        if principal:
            central[0], central[3], central[5] = map(float, principal)
        found = urdf_parts.build_body(inertial, inertial.read_positive("mass"), com, central, rotation)
    if found and body.reading.settings.balance and explain_impossible_inertia(found):
        text = "balanceinertia changes the inertia of this body; write the values that it gives into the body"
        body.refuse("robot.mjcf-unsupported", text)
    return found


def _compute_geom(own: urdf_parts.XmlPart, frame: geometry.Placement) -> _Body:
    """Return the ten parameters of a solid in the frame of its body; None where it has no mass."""
    kind = own.read_choice("type", _GEOMS, "sphere")
    mass, density = own.read_float("mass"), own.read_float("density", 1000.0)
    if kind in _NO_BODIES or mass == 0 or (mass is None and not density):
        return None
    shell = own.read_word("shellinertia", "false") == "true"
    if kind not in _SOLIDS or own.has("mesh") or shell:
        what = "a shell" if shell else "a mesh"
        text = f"its inertia would be that of {what}, which is not computed; give the body an <inertial>"
        own.refuse("robot.mjcf-unsupported", f"{text} (MuJoCo writes one, see docs/urdf.md)")
        return None
    ends = own.read_numbers("fromto", 6)
    numbers = [float(value) for value in own.read_numbers("size", 1, 3)]
    size = (numbers + [0.0] * 3)[:3]
    if ends:
        vector = [a - b for a, b in zip(ends[:3], ends[3:], strict=True)]
        half = math.hypot(*map(float, vector)) / 2
        size = [size[0], half, 0.0] if kind in ("capsule", "cylinder") else [size[0], size[0], half]
        middle = [geometry.Exact.surd(Fraction(a + b) / 2) for a, b in zip(ends[:3], ends[3:], strict=True)]
        turn = _turn_to(own, (vector[0], vector[1], vector[2]), "fromto")
        placed = replace(turn, translation=(middle[0], middle[1], middle[2]))
    else:
        placed = read_placement(own)
    count = {"sphere": 1, "capsule": 2, "cylinder": 2}.get(kind, 3)
    if min(size[:count]) <= 0:
        text = f"size: a {kind} needs {count} number{'s'[: count > 1]} above 0, in m"
        own.refuse("robot.out-of-range", text, "size")
        return None
    # Volume (m^3), and principal moments divided by the mass (m^2), of half lengths along z.
    a, b, c = size
    match kind:
        case "box":
            x, y, z = (value**2 / 3 for value in size)
            volume, moments = 8 * a * b * c, (y + z, x + z, x + y)
        case "cylinder":
            across = (3 * a**2 + 4 * b**2) / 12
            volume, moments = 2 * math.pi * a**2 * b, (across, across, a**2 / 2)
        case "capsule":
            # A cylinder between two halves of a sphere whose centres of mass stand 3 r / 8 beyond its ends.
            ends_volume, middle_volume = 4 / 3 * math.pi * a**3, 2 * math.pi * a**2 * b
            volume = ends_volume + middle_volume
            share = ends_volume / volume
            across = (1 - share) * (3 * a**2 + 4 * b**2) / 12 + share * (0.4 * a**2 + b**2 + 0.75 * a * b)
            moments = (across, across, (1 - share) * a**2 / 2 + share * 0.4 * a**2)
        case _:
            x, y, z = (value**2 / 5 for value in ((a, a, a) if kind == "sphere" else size))
            volume = 4 / 3 * math.pi * (a**3 if kind == "sphere" else a * b * c)
            moments = (y + z, x + z, x + y)
    mass = volume * (density or 0.0) if mass is None else mass
    placed = geometry.compose_placements(frame, placed)
    central = [mass * moments[0], 0.0, 0.0, mass * moments[1], 0.0, mass * moments[2], 0.0, 0.0, 0.0, mass]
    origin = np.array([value.to_float() for value in placed.translation])
    return move_parameters(central, np.array(geometry.to_floats(placed)), origin)


def read_xml_robot(
    path: Path,
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float = DEFAULT_SNAP,
    xacro: Mapping[str, str] | None = None,
    outside: bool = False,
) -> Robot:
    """Return the robot that the URDF or MJCF model at `path` describes; its outermost element says which.

    Args:
        path: the file, a URDF, a xacro file that writes one, or a model.
        base: the link or body to start from; the file's own root if None.
        tip: the link or body to end at; all branches belong to the robot if None. Where it is fixed to the
            last moving link, its frame becomes that link's `Joint.frame`.
        snap: angle in rad within which rotations are moved to multiples of pi/2; zero turns that off.
        xacro: arguments of a xacro file, by name; others have their defaults.
        outside: read files that a model includes from other folders than its own.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    source = read_urdf_text(path, arguments=xacro)
    robot = parse_xml_robot(source.text, source.file, base=base, tip=tip, snap=snap, outside=outside)
    given = tuple((xacro or {}).items())
    made = robot.made_from and replace(robot.made_from, file=str(path), xacro=given)
    return replace(robot, path=str(path), notices=(*source.notices, *robot.notices), made_from=made)


def parse_xml_robot(
    text: str,
    file: str = "robot.urdf",
    *,
    base: str | None = None,
    tip: str | None = None,
    snap: float = DEFAULT_SNAP,
    outside: bool = True,
) -> Robot:
    """Return the robot of a text that messages call `file`, or raise all mistakes. See `read_xml_robot`."""
    document = parse_document(text, file)
    if document.root.tag in _ROOTS:
        return assemble_model(read_model(document, snap, outside=outside), base, tip)
    return assemble_robot(*read_urdf(document, snap), base, tip)


def assemble_model(reading: urdf_parts.TreeReading, base: str | None, tip: str | None) -> Robot:
    """Return the robot of a model that was read, or raise a RobotError with all mistakes."""
    gravity, weightless = (geometry.ZERO, geometry.ZERO, geometry.Exact.of("-9.81")), False
    # A later <option> replaces an earlier one.
    for element in reading.document.root.find_all("option"):
        part = reading.enter(element, "option")
        if vector := part.read_vector("gravity"):
            x, y, z = (geometry.Exact.surd(Fraction(value)) for value in vector)
            gravity = (x, y, z)
        for name in ("density", "viscosity"):
            if part.read_decimal(name):
                _lose(reading, f"option {name}", element, name)
        for flag in element.find_all("flag"):
            off = [name for name, value in flag.attributes.items() if value == "disable"]
            weightless = weightless or "gravity" in off
            for name in off:
                if name in ("passive", "spring", "damper", "frictionloss", "equality", "constraint"):
                    text = "flags disable forces that joints state, so the model has them; state none: {}"
                    reading.group("robot.mjcf-flag", text, name, flag, name)
    # A joint whose name is taken was left out, and its bodies are not connected.
    complete = not any(error.code == "robot.duplicate-joint" for error in reading.errors)
    gravity = (geometry.ZERO, geometry.ZERO, geometry.ZERO) if weightless else gravity
    return assemble_robot(reading, complete, base, tip, gravity)


def read_model(
    document: XmlDocument, snap: float = DEFAULT_SNAP, *, outside: bool = True
) -> urdf_parts.TreeReading:
    """Return a model with bodies as links, and mistakes; a RobotError tells of an included file not read."""
    reading = urdf_parts.TreeReading(document=document, snap=snap)
    root = document.root
    waiting = [root]
    while waiting:
        element = waiting.pop()
        while (place := element.find("include")) is not None:
            # Its elements stand in the place of <include>; the file in the folder of the model.
            name = place.attributes.get("file", "")
            path = Path(document.file).parent / name
            if not name or str(path) in (document.file, *document.included):
                text = f'<include file="{show(name)}"/>: a file is included once' if name else "needs a file"
                raise RobotError(document.locate_place(place).notice("robot.mjcf-include", text))
            if not outside and not path.resolve().is_relative_to(Path(document.file).parent.resolve()):
                text = f'<include file="{show(name)}"/>: it is not in the folder of the model; if you trust '
                text += "it, allow it by --include-outside (include_outside=True)"
                raise RobotError(document.locate_place(place, "file").notice("robot.mjcf-include", text))
            if not path.is_file():
                text = f'<include file="{show(name)}"/>: there is no {path}, in the folder of the model'
                raise RobotError(document.locate_place(place, "file").notice("robot.mjcf-include", text))
            found = parse_document(read_text_file(path), str(path))
            document.included[str(path)] = found
            index = element.children.index(place)
            element.children[index : index + 1] = found.root.children
        waiting += element.children
    for child in root.children:
        if child.tag not in _SECTIONS:
            _skip(reading, child)
    compilers = list(root.find_all("compiler"))
    for element in compilers:
        _skip_attributes(reading, element)
    reading = replace(reading, settings=read_settings(reading, compilers))
    read_classes(reading, list(root.find_all("default")))
    _read_bodies(reading)
    _read_equality(reading, _read_tendons(reading))
    _read_actuators(reading)
    return reading


def _skip(reading: urdf_parts.TreeReading, element: XmlElement, kind: str = "") -> None:
    """Record an element that does not matter."""
    reading.group(urdf_parts.MJCF_UNUSED, _UNUSED, kind or f"<{element.tag}>", element)


def _skip_attributes(reading: urdf_parts.TreeReading, element: XmlElement) -> None:
    for name in element.attributes:
        if name not in _KNOWN[element.tag]:
            reading.group(urdf_parts.MJCF_UNUSED, _UNUSED, f"{name} of <{element.tag}>", element, name)


def _lose(reading: urdf_parts.TreeReading, kind: str, element: XmlElement, attribute: str = "") -> None:
    """Record a force that the model lacks."""
    reading.group("robot.mjcf-forces", _LOST, kind, element, attribute)


def _list_contents(
    element: XmlElement, childclass: str, frame: geometry.Placement, reading: urdf_parts.TreeReading
) -> Iterator[tuple[XmlElement, str, geometry.Placement]]:
    """Yield what stands in a body, frames resolved, with the class and the frame around each."""
    waiting = [(child, childclass, frame) for child in reversed(element.children)]
    while waiting:
        child, outer, around = waiting.pop()
        if child.tag != "frame":
            yield child, outer, around
            continue
        inner = child.attributes.get("childclass", outer)
        placed = geometry.compose_placements(around, read_placement(reading.enter(child, "a frame")))
        waiting += [(entry, inner, placed) for entry in reversed(child.children)]


def _read_bodies(reading: urdf_parts.TreeReading) -> None:
    """Add the links and joints, in the order of the file."""
    root = reading.document.root
    part = reading.enter(root.find("worldbody") or root, "body 'world'")
    reading.links[WORLD] = urdf_parts.TreeLink(name=WORLD, part=part, inertial=None)
    contents = [
        entry
        for element in root.find_all("worldbody")
        for entry in _list_contents(element, "", geometry.IDENTITY, reading)
    ]
    _check_contents(reading, contents, "the world")
    waiting = [(entry, WORLD, False) for entry in reversed(contents) if entry[0].tag == "body"]
    number = 0
    while waiting:
        (element, childclass, frame), parent, moves = waiting.pop()
        number += 1
        _skip_attributes(reading, element)
        name = element.attributes.get("name") or f"body{number}"
        part = reading.enter(element, f"body '{name}'")
        if name in reading.links:
            part.refuse_taken("body", "link", reading.links[name].part)
            name = f"{name} of line {part.line}"
        if part.read_decimal("gravcomp"):
            _lose(reading, "gravcomp", element, "gravcomp")
        reading.parts["body", name] = part
        inner = element.attributes.get("childclass", childclass)
        contents = list(_list_contents(element, inner, geometry.IDENTITY, reading))
        _check_contents(reading, contents, part.owner)
        origin = geometry.compose_placements(frame, read_placement(part))
        joints = [entry for entry in contents if entry[0].tag in ("joint", "freejoint")]
        # Between them stand links without mass; a fixed joint stands for none.
        end = parent
        for count, (entry, around, place) in enumerate(joints, start=1):
            joint = entry.attributes.get("name") or f"{name}_joint{count if len(joints) > 1 else ''}"
            moving = reading.enter(entry, f"joint '{joint}'", "joint", around)
            if entry.tag == "joint":
                _skip_attributes(reading, entry)
            if joint in reading.joints:
                moving.refuse_taken("joint", "joint", reading.joints[joint].part)
                continue
            last = count == len(joints)
            child = name if last else f"{name}:{joint}"
            reading.parts["joint", joint] = moving
            reading.joints[joint] = read_joint(moving, joint, (end, child), origin, place)
            if not last:
                link = urdf_parts.TreeLink(name=child, part=moving, inertial=(0.0,) * 10, between=True)
                reading.links[child] = link
            end, origin = child, geometry.IDENTITY
        if not joints:
            # No joint of the file has such a name: it stands in no message.
            weld = f"weld of body '{name}'"
            fixed = urdf_parts.TreeJoint(name=weld, type="fixed", parent=parent, child=name, part=part)
            reading.joints[weld] = replace(fixed, origin=origin)
        moves = moves or bool(joints)
        geoms = []
        for geom, around, place in contents:
            if geom.tag == "geom":
                owner = f"{part.owner}: geom '{geom.attributes.get('name', '')}'"
                geoms.append((reading.enter(geom, owner, "geom", around), place))
        inertial = read_body(part, geoms, moves=moves)
        reading.links[name] = urdf_parts.TreeLink(name=name, part=part, inertial=inertial)
        waiting += [(entry, name, moves) for entry in reversed(contents) if entry[0].tag == "body"]


def _check_contents(
    reading: urdf_parts.TreeReading,
    contents: Sequence[tuple[XmlElement, str, geometry.Placement]],
    owner: str,
) -> None:
    for element, _, _ in contents:
        if element.tag in _REFUSED:
            text = f"<{element.tag}> is not supported; save the model from MuJoCo, which writes what it makes"
            reading.enter(element, owner).refuse("robot.mjcf-unsupported", text)
        elif element.tag not in _READ or element.tag == "geom":
            _skip(reading, element)


def _list_entries(reading: urdf_parts.TreeReading, section: str) -> Iterator[XmlElement]:
    """Yield what stands in all sections of a name."""
    for element in reading.document.root.find_all(section):
        yield from element.children


def _read_equality(reading: urdf_parts.TreeReading, tendons: Mapping[str, Mapping[str, Fraction]]) -> None:
    """Add the followers; `tendons` are the factors of the joints of each fixed tendon."""
    for element in _list_entries(reading, "equality"):
        own = reading.enter(element, f"equality '{element.attributes.get('name', '')}'", "equality")
        if own.read_word("active", "true") == "false":
            _skip(reading, element, f"<{element.tag}> that is not active")
            continue
        if element.tag not in ("joint", "tendon"):
            text = f"<{element.tag}> closes a loop, which is not supported; remove it, or write"
            own.refuse("robot.closed-loop", f'{text} active="false"')
            continue
        numbers = own.read_numbers("polycoef", 1, 5)
        shift, factor, *curved = (*numbers, *map(Decimal, (0, 1, 0, 0, 0)[len(numbers) :]))
        if any(curved):
            text = "polycoef: a joint follows another one by c0 + c1 x; leave out the terms of higher order"
            own.refuse("robot.mjcf-unsupported", text, "polycoef")
        # sum of k (q - ref) = c0, of one joint or tendon less c1 times another one.
        terms: dict[str, Fraction] = {}
        known: Mapping[str, Any] = reading.joints if element.tag == "joint" else tendons
        ends = [(f"{element.tag}1", Fraction(1))]
        ends += [(f"{element.tag}2", -Fraction(factor))] if own.has(f"{element.tag}2") else []
        names = [own.read_name(key, known) for key, _ in ends]
        for name, (_, sign) in zip(names, ends, strict=True):
            parts = {} if name is None else {name: Fraction(1)} if element.tag == "joint" else tendons[name]
            for joint, share in parts.items():
                terms[joint] = terms.get(joint, Fraction(0)) + sign * share
        joints = [joint for joint, share in terms.items() if share]
        free = [joint for joint in joints if joint not in reading.steps]
        if None in names:
            continue
        if not 1 <= len(joints) <= 2:
            text = f"it holds {len(joints)} joints to each other; one joint can follow one other; remove it, "
            text += "or"
            own.refuse("robot.closed-loop", f'{text} write active="false"')
        elif not free or (element.tag == "joint" and joints[0] not in free):
            text = f"joint '{joints[0]}' follows another one already; keep one of the constraints"
            own.refuse("robot.two-forms", text, f"{element.tag}1")
        else:
            follower = free[0]
            master = next((joint for joint in joints if joint != follower), None)
            factor_of_master = -terms[master] / terms[follower] if master else Fraction(0)
            offset = geometry.Exact.surd(Fraction(shift) / terms[follower]) + reading.joints[follower].zero
            if master:
                offset = offset - geometry.Exact.of(factor_of_master) * reading.joints[master].zero
            reading.steps[follower] = MimicStep(master=master, multiplier=factor_of_master, offset=offset)


def _read_tendons(reading: urdf_parts.TreeReading) -> dict[str, dict[str, Fraction]]:
    """Add the drives that turn with several joints; return the factors of all fixed tendons."""
    found: dict[str, dict[str, Fraction]] = {}
    names = [element.attributes.get("name") for element in _list_entries(reading, "tendon")]
    for number, element in enumerate(_list_entries(reading, "tendon"), start=1):
        name = element.attributes.get("name") or f"tendon{number}"
        own = reading.parts["tendon", name] = reading.enter(element, f"tendon '{name}'", "tendon")
        rotor = own.read_positive("armature")
        friction = urdf_parts.build_friction(own.read_linear("damping"), own.read_positive("frictionloss"))
        if own.read_linear("stiffness"):
            _lose(reading, "stiffness of a tendon", element)
        if element.tag != "fixed":
            if rotor or friction.values:
                _lose(reading, f"<{element.tag}> tendon", element)
            else:
                _skip(reading, element, f"<{element.tag}> tendon")
            continue
        if names.count(name) > 1 or name.isdigit():
            own.refuse("robot.duplicate-joint", "each tendon needs a name of its own that is no number")
            continue
        terms = [own.enter(child) for child in element.find_all("joint")]
        pairs = [(term.read_name("joint", reading.joints), term.read_decimal("coef")) for term in terms]
        factors = tuple((joint, Fraction(factor)) for joint, factor in pairs if joint and factor)
        found[name] = dict(factors)
        if not rotor and not friction.values:
            _skip(reading, element, "<fixed> tendon without mechanics")
            continue
        drive = Coupling(name=name, terms=(), has_rotor=rotor > 0, rotor_inertia=rotor or None)
        reading.couplings.append((replace(drive, friction=friction), own, factors))
    return found


def _read_actuators(reading: urdf_parts.TreeReading) -> None:
    """Add gears, and limits of the torque where the joint itself has none."""
    found: dict[str, list[tuple[urdf_parts.XmlPart, float]]] = {}
    direct: set[str] = set()
    for element in _list_entries(reading, "actuator"):
        own = reading.enter(element, f"actuator '{element.attributes.get('name', '')}'", "actuator")
        key = "joint" if "joint" in element.attributes else "jointinparent"
        for attribute in ("armature", "damping"):
            if own.read_linear(attribute):
                text = f"{attribute} of an actuator is not supported; write it at its joint, times gear^2"
                own.refuse("robot.mjcf-unsupported", text, attribute)
        if key not in element.attributes:
            _skip(reading, element, "actuator that is not at a joint")
            continue
        joint = own.read_name(key, reading.joints)
        gears = own.read_numbers("gear", 1, 6)
        gear = float(gears[0]) if gears else 1.0
        if joint is None or not reading.joints[joint].moves:
            continue
        if not gear:
            own.refuse("robot.out-of-range", "gear: must not be 0", "gear")
            continue
        found.setdefault(joint, []).append((own, gear))
        curved = own.read_word("biastype", "none") == "affine" and any(own.read_numbers("biasprm", 1, 10)[1:])
        if own.element.tag in _FEEDBACK or curved:
            gains = [f"{key}={own.read_word(key)}" for key in ("kp", "kv", "biasprm") if own.has(key)]
            text = "actuators that brake or hold joints by feedback, which is no part of the model: their "
            text += "forces are torques of the drives, as in a log, not friction; of joints {}"
            kind = " ".join((f"'{joint}': <{own.element.tag}>", *gains))
            reading.group("robot.mjcf-controller", text, kind, element)
        direct |= {joint} if gears and gear == 1.0 else set()
    for joint, entries in found.items():
        own, gear = entries[0]
        for other, second in entries[1:]:
            if second != gear:
                text = "of actuators with different gears the first scales torques; leave one, of joints {}"
                reading.group("robot.two-gears", text, f"'{joint}'", other.element)
        entry = reading.joints[joint]
        limits = entry.limits
        if limits.torque is None and len(entries) == 1:
            # The control of a motor is its force.
            controls = [("ctrllimited", "ctrlrange")] if own.element.tag == "motor" else []
            forces = [
                own.read_range(bounds, limited)
                for limited, bounds in (("forcelimited", "forcerange"), *controls)
            ]
            sizes = [min(-pair[0], pair[1]) * abs(gear) for pair in forces if pair and pair[0] < 0 < pair[1]]
            limits = replace(limits, torque=min(sizes, default=None))
        drive = replace(entry.drive, gear=gear, direct=gear == 1.0 and joint in direct)
        reading.joints[joint] = replace(entry, drive=drive, limits=limits)
