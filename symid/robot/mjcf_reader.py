"""A robot from an MJCF model, the format of MuJoCo, or the part of it from a base body to a tip body.

A path -> `Robot`, or one `RobotError` with all mistakes and their places; what symid does not use is listed
in the robot's notices. Bodies become links, several joints of one body a chain of links without mass, a body
without a joint a part of the body that carries it; from there on the model is read as a URDF is
(`urdf_reader.assemble_robot`). A coordinate is the joint's `qpos` of MuJoCo, `ref` included.

Supported: what `mjcf_parts` supports; frames, included files; hinges and slides with range, damping,
frictionloss, armature, stiffness; gears and forces of actuators at joints; followers (<equality><joint>,
linear); fixed tendons with armature, damping or frictionloss, as coupled drives; gravity.
Not supported, and refused: free and ball joints in the chosen part, <connect>, <weld>, equalities of tendons,
curved followers, armature and damping of actuators, <attach>, <replicate>, <composite>, <flexcomp>, plugins
of bodies. Not in the model, and said in a warning: forces of a medium, gravcomp, springs of tendons, spatial
tendons with mechanics, flags that switch forces off.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

from symid.errors import RobotError
from symid.robot.description import MimicStep, Robot
from symid.robot.geometry import IDENTITY, ZERO, Exact, Placement, compose_placements
from symid.robot.mjcf_parts import (
    ORIENTATIONS,
    MjcfPart,
    Model,
    read_body,
    read_classes,
    read_joint,
    read_placement,
    read_settings,
)
from symid.robot.toml_values import read_text_file, show
from symid.robot.urdf_parts import (
    MJCF_UNUSED,
    TreeCoupling,
    TreeJoint,
    TreeLink,
    TreeReading,
    XmlPart,
    build_friction,
)
from symid.robot.urdf_reader import DEFAULT_SNAP, assemble_robot, parse_urdf, read_urdf
from symid.robot.urdf_xml import XmlDocument, XmlElement, parse_document

WORLD = "world"
"""The body that does not move."""

# An included part of a model is one by its tag, too.
_ROOTS = ("mujoco", "mujocoinclude")
_UNUSED = "not used, and not needed for the dynamics: {}"
_LOST = "forces that are not in the model: {}"
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


def read_xml_robot(
    path: Path, *, base: str | None = None, tip: str | None = None, snap: float = DEFAULT_SNAP
) -> Robot:
    """Return the robot that the URDF or MJCF model at `path` describes; its outermost element says which.

    Args:
        path: the file.
        base: the link or body to start from; the file's own root if None.
        tip: the link or body to end at; all branches belong to the robot if None.
        snap: angle in rad within which rotations are moved to multiples of pi/2; zero turns that off.

    Raises:
        RobotError: with a notice for each mistake in the file, in the order of their places.
    """
    document = parse_document(read_text_file(path), str(path))
    if document.root.tag in _ROOTS:
        return assemble_model(read_model(document, snap), base, tip)
    return read_urdf(path, base=base, tip=tip, snap=snap)


def parse_xml_robot(text: str, file: str, *, base: str | None, tip: str | None, snap: float) -> Robot:
    """Return the robot that a text describes; messages call it `file`. See `read_xml_robot`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    document = parse_document(text, file)
    if document.root.tag in _ROOTS:
        return assemble_model(read_model(document, snap), base, tip)
    return parse_urdf(text, file, base=base, tip=tip, snap=snap)


def assemble_model(model: Model, base: str | None, tip: str | None) -> Robot:
    """Return the robot of a model that was read. See `read_xml_robot`.

    Raises:
        RobotError: with a notice for each mistake in the text.
    """
    reading, gravity, weightless = model.reading, (ZERO, ZERO, Exact.of("-9.81")), False
    # A later <option> replaces an earlier one.
    for element in reading.document.root.find_all("option"):
        part = XmlPart(reading=reading, owner="option", element=element)
        if vector := part.read_vector("gravity"):
            x, y, z = (Exact.surd(Fraction(value)) for value in vector)
            gravity = (x, y, z)
        for name in ("density", "viscosity"):
            if part.read_decimal(name):
                _lose(reading, f"option {name}", element, name)
        for flag in element.find_all("flag"):
            off = [name for name, value in flag.attributes.items() if value == "disable"]
            weightless = weightless or "gravity" in off
            for name in off:
                if name in ("passive", "spring", "damper", "frictionloss", "equality", "constraint"):
                    text = "flags disable forces, which the model has where joints state them: {}"
                    reading.group("robot.mjcf-flag", text, name, flag, name)
    # A joint whose name is taken was left out, and its bodies are not connected.
    complete = not any(error.code == "robot.duplicate-joint" for error in reading.errors)
    gravity = (ZERO, ZERO, ZERO) if weightless else gravity
    return assemble_robot(reading, base, tip, complete=complete, gravity=gravity)


def read_model(document: XmlDocument, snap: float = DEFAULT_SNAP) -> Model:
    """Return a model with its bodies as links, and mistakes; included files stand in the place of <include>.

    Raises:
        RobotError: an included file cannot be read.
    """
    reading = TreeReading(document=document, snap=snap)
    _include_files(reading)
    root = document.root
    for child in root.children:
        if child.tag not in _SECTIONS:
            _skip(reading, child)
    compilers = list(root.find_all("compiler"))
    for element in compilers:
        _skip_attributes(reading, element)
    model = Model(reading=reading, settings=read_settings(reading, compilers))
    read_classes(model, list(root.find_all("default")))
    _read_bodies(model)
    _read_equality(model)
    _read_tendons(model)
    _read_actuators(model)
    return model


def _include_files(reading: TreeReading) -> None:
    """Put the elements of included files in the place of <include>, files in the folder of the model.

    Raises:
        RobotError: one cannot be read.
    """
    document = reading.document
    waiting = [document.root]
    while waiting:
        element = waiting.pop()
        while (place := element.find("include")) is not None:
            name = place.attributes.get("file", "")
            path = Path(document.file).parent / name
            if not name or str(path) in (document.file, *document.included):
                text = f'<include file="{show(name)}"/>: a file is included once' if name else "needs a file"
                raise RobotError(document.locate_place(place).notice("robot.mjcf-include", text))
            if not path.is_file():
                text = f'<include file="{show(name)}"/>: there is no {path}, in the folder of the model'
                raise RobotError(document.locate_place(place, "file").notice("robot.mjcf-include", text))
            found = parse_document(read_text_file(path), str(path))
            document.included[str(path)] = found
            index = element.children.index(place)
            element.children[index : index + 1] = found.root.children
        waiting += element.children


def _skip(reading: TreeReading, element: XmlElement, kind: str = "") -> None:
    """Record an element that does not matter."""
    reading.group(MJCF_UNUSED, _UNUSED, kind or f"<{element.tag}>", element)


def _skip_attributes(reading: TreeReading, element: XmlElement) -> None:
    for name in element.attributes:
        if name not in _KNOWN[element.tag]:
            kind = f"{name} of <{element.tag}>"
            reading.group(MJCF_UNUSED, _UNUSED, kind, element, name)


def _lose(reading: TreeReading, kind: str, element: XmlElement, attribute: str = "") -> None:
    """Record a force that the model lacks."""
    reading.group("robot.mjcf-forces", _LOST, kind, element, attribute)


def _list_contents(
    element: XmlElement, childclass: str, frame: Placement, model: Model
) -> Iterator[tuple[XmlElement, str, Placement]]:
    """Yield what stands in a body, frames resolved, with the class and the frame around each."""
    waiting = [(child, childclass, frame) for child in reversed(element.children)]
    while waiting:
        child, outer, around = waiting.pop()
        if child.tag != "frame":
            yield child, outer, around
            continue
        own = MjcfPart(model=model, part=XmlPart(reading=model.reading, owner="a frame", element=child))
        inner = child.attributes.get("childclass", outer)
        placed = compose_placements(around, read_placement(own))
        waiting += [(entry, inner, placed) for entry in reversed(child.children)]


def _read_bodies(model: Model) -> None:
    """Add the links and joints, in the order of the file."""
    reading, root = model.reading, model.reading.document.root
    part = XmlPart(reading=reading, owner="body 'world'", element=root.find("worldbody") or root)
    reading.links[WORLD] = TreeLink(name=WORLD, part=part, inertial=None)
    contents = [
        entry
        for element in root.find_all("worldbody")
        for entry in _list_contents(element, "", IDENTITY, model)
    ]
    _check_contents(model, contents, "the world")
    waiting = [(entry, WORLD, False) for entry in reversed(contents) if entry[0].tag == "body"]
    number = 0
    while waiting:
        (element, childclass, frame), parent, moves = waiting.pop()
        number += 1
        _skip_attributes(reading, element)
        name = element.attributes.get("name") or f"body{number}"
        part = XmlPart(reading=reading, owner=f"body '{name}'", element=element)
        if name in reading.links:
            part.refuse_taken("body", "link", reading.links[name].part)
            name = f"{name} of line {part.line}"
        if part.read_decimal("gravcomp"):
            _lose(reading, "gravcomp", element, "gravcomp")
        own = model.parts["body", name] = MjcfPart(model=model, part=part)
        inner = element.attributes.get("childclass", childclass)
        contents = list(_list_contents(element, inner, IDENTITY, model))
        _check_contents(model, contents, part.owner)
        origin = compose_placements(frame, read_placement(own))
        joints = [entry for entry in contents if entry[0].tag in ("joint", "freejoint")]
        _chain_joints(own, name, parent, origin, joints)
        moves = moves or bool(joints)
        geoms = []
        for geom, around, place in contents:
            if geom.tag == "geom":
                owner = f"{part.owner}: geom '{geom.attributes.get('name', '')}'"
                geoms.append((model.enter(geom, owner, "geom", around), place))
        reading.links[name] = TreeLink(name=name, part=part, inertial=read_body(own, geoms, moves=moves))
        waiting += [(entry, name, moves) for entry in reversed(contents) if entry[0].tag == "body"]


def _check_contents(model: Model, contents: Sequence[tuple[XmlElement, str, Placement]], owner: str) -> None:
    for element, _, _ in contents:
        if element.tag in _REFUSED:
            text = f"<{element.tag}> is not supported; save the model from MuJoCo, which writes what it makes"
            part = XmlPart(reading=model.reading, owner=owner, element=element)
            part.refuse("robot.mjcf-unsupported", text)
        elif element.tag not in _READ or element.tag == "geom":
            _skip(model.reading, element)


def _chain_joints(
    body: MjcfPart,
    name: str,
    parent: str,
    origin: Placement,
    joints: Sequence[tuple[XmlElement, str, Placement]],
) -> None:
    """Add the joints of a body, between links without mass where there are several; a fixed one for none."""
    model, reading = body.model, body.model.reading
    for count, (element, around, frame) in enumerate(joints, start=1):
        joint = element.attributes.get("name") or f"{name}_joint{count if len(joints) > 1 else ''}"
        own = model.enter(element, f"joint '{joint}'", "joint", around)
        if element.tag == "joint":
            _skip_attributes(reading, element)
        if joint in reading.joints:
            own.part.refuse_taken("joint", "joint", reading.joints[joint].part)
            continue
        last = count == len(joints)
        child = name if last else f"{name}:{joint}"
        model.parts["joint", joint] = own
        reading.joints[joint] = read_joint(own, joint, (parent, child), origin, frame)
        if not last:
            reading.links[child] = TreeLink(name=child, part=own.part, inertial=(0.0,) * 10, between=True)
        parent, origin = child, IDENTITY
    if not joints:
        # No joint of the file has such a name: it stands in no message.
        weld = f"weld of body '{name}'"
        reading.joints[weld] = TreeJoint(
            name=weld, type="fixed", parent=parent, child=name, part=body.part, origin=origin
        )


def _list_entries(model: Model, section: str) -> Iterator[XmlElement]:
    """Yield what stands in all sections of a name."""
    for element in model.reading.document.root.find_all(section):
        yield from element.children


def _read_equality(model: Model) -> None:
    """Add the followers."""
    reading = model.reading
    for element in _list_entries(model, "equality"):
        own = model.enter(element, f"equality '{element.attributes.get('name', '')}'", "equality")
        if own.get("active", "true") == "false":
            _skip(reading, element, f"<{element.tag}> that is not active")
            continue
        if element.tag != "joint":
            text = (
                f'<{element.tag}> closes a loop, which is not supported; remove it, or write active="false"'
            )
            own.part.refuse("robot.closed-loop", text)
            continue
        follower = own.part.read_name("joint1", reading.joints)
        master = own.part.read_name("joint2", reading.joints) if own.has("joint2") else None
        numbers = own.part.read_numbers("polycoef", 1, 5)
        shift, factor, *curved = (*numbers, *map(Decimal, (0, 1, 0, 0, 0)[len(numbers) :]))
        if any(curved):
            text = "polycoef: a joint follows another one by c0 + c1 x; leave out the terms of higher order"
            own.part.refuse("robot.mjcf-unsupported", text, "polycoef")
        if follower is None or (master is None and own.has("joint2")):
            continue
        if follower in reading.steps:
            text = f"joint '{follower}' follows another one already; keep one of the constraints"
            own.part.refuse("robot.two-forms", text, "joint1")
            continue
        # joint1 - ref1 = c0 + c1 (joint2 - ref2)
        factor = factor if master else Decimal(0)
        offset = reading.joints[follower].zero + Exact.surd(Fraction(shift))
        if master:
            offset = offset - Exact.of(Fraction(factor)) * reading.joints[master].zero
        reading.steps[follower] = MimicStep(master=master, multiplier=Fraction(factor), offset=offset)


def _read_tendons(model: Model) -> None:
    """Add the drives that turn with several joints."""
    reading = model.reading
    names = [element.attributes.get("name") for element in _list_entries(model, "tendon")]
    for number, element in enumerate(_list_entries(model, "tendon"), start=1):
        name = element.attributes.get("name") or f"tendon{number}"
        own = model.parts["tendon", name] = model.enter(element, f"tendon '{name}'", "tendon")
        rotor = own.read_positive("armature")
        friction = build_friction(own.read_linear("damping"), own.read_positive("frictionloss"))
        if own.read_linear("stiffness"):
            _lose(reading, "stiffness of a tendon", element)
        if element.tag != "fixed":
            if rotor or friction.values:
                _lose(reading, f"<{element.tag}> tendon", element)
            else:
                _skip(reading, element, f"<{element.tag}> tendon")
            continue
        if names.count(name) > 1 or name.isdigit():
            own.part.refuse("robot.duplicate-joint", "each tendon needs a name of its own that is no number")
            continue
        terms = [own.part.enter(child) for child in element.find_all("joint")]
        pairs = [(term.read_name("joint", reading.joints), term.read_decimal("coef")) for term in terms]
        factors = tuple((joint, Fraction(factor)) for joint, factor in pairs if joint and factor)
        if not rotor and not friction.values:
            _skip(reading, element, "<fixed> tendon without mechanics")
            continue
        reading.couplings.append(
            TreeCoupling(
                name=name, part=own.part, terms=factors, rotor_inertia=rotor or None, friction=friction
            )
        )


def _read_actuators(model: Model) -> None:
    """Add gears, and limits of the torque where the joint itself has none."""
    reading = model.reading
    found: dict[str, list[tuple[MjcfPart, float]]] = {}
    for element in _list_entries(model, "actuator"):
        own = model.enter(element, f"actuator '{element.attributes.get('name', '')}'", "actuator")
        key = "joint" if "joint" in element.attributes else "jointinparent"
        for attribute in ("armature", "damping"):
            if own.read_linear(attribute):
                text = f"{attribute} of an actuator is not supported; write it at its joint, times gear^2"
                own.refuse("robot.mjcf-unsupported", text, attribute)
        if key not in element.attributes:
            _skip(reading, element, "actuator that is not at a joint")
            continue
        joint = own.part.read_name(key, reading.joints)
        gears = own.at("gear").read_numbers("gear", 1, 6)
        gear = float(gears[0]) if gears else 1.0
        if joint is None or not reading.joints[joint].moves:
            continue
        if not gear:
            own.refuse("robot.out-of-range", "gear: must not be 0", "gear")
            continue
        found.setdefault(joint, []).append((own, gear))
    for joint, entries in found.items():
        own, gear = entries[0]
        for other, second in entries[1:]:
            if second != gear:
                text = "several actuators with different gears, the first of them is used, of joints {}"
                reading.group("robot.two-gears", text, f"'{joint}'", other.part.element)
        entry = reading.joints[joint]
        limits = entry.limits
        if limits.torque is None and len(entries) == 1:
            # The control of a motor is its force.
            controls = [("ctrllimited", "ctrlrange")] if own.part.element.tag == "motor" else []
            forces = [
                own.read_range(bounds)
                for limited, bounds in (("forcelimited", "forcerange"), *controls)
                if own.is_limited(limited, bounds)
            ]
            sizes = [min(-pair[0], pair[1]) * abs(gear) for pair in forces if pair and pair[0] < 0 < pair[1]]
            limits = replace(limits, torque=min(sizes, default=None))
        reading.joints[joint] = replace(entry, drive=replace(entry.drive, gear=gear), limits=limits)
