"""A robot from its TOML file, or from a table of Denavit-Hartenberg rows.

A path or a text -> `Robot`, or one `RobotError` with all mistakes and their places. A table is a text file
with a header such as `joint,kind,alpha_deg,a,d,theta` and one row a joint.

Supported: TOML 1.0 in UTF-8, lines ending as on any system; chains and trees, a joint's parent stands before
it; fixed joints, whose links are joined to those that carry them, with a notice; chains of followers; links
by mass, centre of mass and inertia, or by standard parameters, symbols in place of numbers. Standard
parameters that no body has (from a converted file, or identified) are kept, with a warning; mass, com and
inertia are typed by hand, and such values refused.
Not supported: files that include others; a convention, a joint's kind, gravity or units that are not written;
rings of followers, followers of fixed joints; negative masses, symbols among standard parameters.

Supported in tables: commas, semicolons, tabs; comments from # to the end of a line; angles in rad, texts such
as pi/2, or in degrees under `alpha_deg`; lengths in m, or in mm under `a_mm`; `q` for a joint's variable,
also with a constant as in `q - pi/2`. A joint without kind is revolute where q stands under theta, prismatic
under d. A cell may stand in double quotes, as spreadsheets write them; a quote inside is doubled.
Lines such as d1 = 0.4 give letters their values, in SI units.
Not supported there: trees, letters in mm, decimal commas, cells of several lines.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

from symid.errors import RobotError
from symid.notation import INERTIAL
from symid.robot.description import (
    DEFAULT_GRAVITY,
    UNKNOWN,
    Coupling,
    FixedBody,
    Joint,
    JointKind,
    Mimic,
    MimicStep,
    Robot,
    SourceFile,
    SymbolicInertia,
    free_mounting,
)
from symid.robot.exact_values import (
    DH_KEYS,
    parse_linear_form,
    read_fraction,
    read_frames,
    read_linear_form,
    read_position,
    read_vector,
)
from symid.robot.geometry import IDENTITY, ROUNDED, ZERO, Exact, Placement, compose_placements, place_joint
from symid.robot.inertia import (
    TENSOR,
    compute_standard_parameters,
    explain_impossible_inertia,
    has_mass,
    lump_fixed_joints,
    move_by_placement,
)
from symid.robot.plausibility import PlacedBody, find_implausible
from symid.robot.toml_joints import FRICTION_PARTS, MOVING_KEYS, complete_joint, read_couplings
from symid.robot.toml_settings import read_named_settings, read_settings
from symid.robot.toml_values import (
    ANY,
    BASE,
    NOT_NEGATIVE,
    POSITIVE,
    KeyPath,
    Place,
    Places,
    Section,
    parse_toml,
    read_text_file,
    suggest_names,
    to_decimal,
)

_ROBOT_KEYS = (
    *("name", "description", "source", "convention", "gravity", "zeros", "symbols"),
    *("made_from", "joint", "coupling", "log", "processing", "controller", "settings"),
)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Letters of coordinates, functions and parameters would read as something else in a formula.
_LETTERS = (*INERTIAL, *("IA", "KS", "KR"), *(name for name in FRICTION_PARTS if not name[-1].isdigit()))
_RESERVED = re.compile(rf"(?:pi|tau|theta|sqrt|atan|[sc]\d+|d{{0,2}}q\d*|(?:{'|'.join(_LETTERS)})R?\d+)")
# Of the largest entry: programs print the two halves of a matrix with some rounding.
_ASYMMETRY = 1e-6
_STANDARD_UNITS = ("kg*m^2",) * 6 + ("kg*m",) * 3 + ("kg",)
_JOINT_KEYS = ("name", "kind", "parent", *DH_KEYS, "origin", "frame", "mimic", "link", *MOVING_KEYS)
_KINDS = {
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "fixed": None,
}
_ANGLES: tuple[tuple[str, str | None], ...] = (("", None), ("_rad", None), ("_deg", "deg"))
_LENGTHS: tuple[tuple[str, Decimal | None], ...] = (("", None), ("_m", None), ("_mm", Decimal("0.001")))
# Key of a robot file and unit of each column.
_COLUMNS: dict[str, tuple[str, Decimal | str | None]] = {
    "joint": ("name", None),
    "name": ("name", None),
    "kind": ("kind", None),
    **{f"{key}{end}": (key, unit) for key in ("alpha", "theta") for end, unit in _ANGLES},
    **{f"{key}{end}": (key, unit) for key in ("a", "d") for end, unit in _LENGTHS},
}
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_HEADER = "joint,kind,alpha,a,d,theta"
_VARIABLE = re.compile(r"q\d*\s*(?P<rest>[-+].*)?")
_LETTER = re.compile(r"([A-Za-z_]\w*)\s*=\s*([^=]*?)[\s,;]*")
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_IMPLIED = {"theta": "revolute", "d": "prismatic"}


def read_robot(path: Path) -> Robot:
    """Return the robot that the file at `path` describes, or raise a RobotError with all mistakes in it."""
    return parse_robot(read_text_file(path), str(path))


def parse_robot(text: str, file: str = "robot.toml") -> Robot:
    """Return the robot that `text` describes; a RobotError has all mistakes, in the text called `file`."""
    return build_robot(parse_toml(text, file), file)


def build_robot(root: Section, file: str) -> Robot:
    """Return the robot that the values of a whole file describe, or raise a RobotError with all mistakes."""
    root.refuse_unknown_keys(_ROBOT_KEYS)
    if "convention" not in root.values:
        text = 'missing, and never guessed; write convention = "modified" (alpha and a belong to the link '
        text += 'before: Craig, Khalil), convention = "standard" (to the joint\'s own link: classic DH) or '
        text += 'convention = "origin" (frames as in URDF)'
        root.refuse_key("robot.missing-key", "convention", text)
    convention = root.read_choice("convention", ("modified", "standard", "origin")) or "modified"
    if (table := root.read_table("symbols")) is not None:
        values: dict[str, float] = {}
        for symbol in table.values:
            if not _NAME.fullmatch(symbol) or _RESERVED.fullmatch(symbol):
                text = "cannot name a symbol; use letters, digits and _, and no name of a coordinate or"
                table.refuse_key("robot.bad-name", symbol, f"{text} parameter")
            values[symbol] = table.read_float(symbol, "") or 0.0
        root = replace(root, symbols=values)
    joints, couplings, fixed = read_joints(root, convention)
    root.require("gravity", "write gravity = [0, 0, -9.81], the vector in the base frame in m/s^2")
    unknown = root.get("gravity") == UNKNOWN
    gravity = DEFAULT_GRAVITY if unknown else read_vector(root, "gravity", "m/s^2")
    zeros = root.get("zeros")
    known = [joint.name for joint in joints if joint.mimic is None]
    zeros = known if zeros == UNKNOWN else zeros
    if zeros is not None and not (isinstance(zeros, list) and zeros and all(name in known for name in zeros)):
        text = f'expected "{UNKNOWN}" or a list of joints ({", ".join(known)}), got {root.show("zeros")}'
        root.refuse("robot.zeros", "zeros", f"{text}; a zero that is known is an offset of [log.position]")
    log, processing, controller = read_settings(root, joints)
    settings = read_named_settings(root, joints)
    made_from = None
    if (
        table := root.read_table("made_from", ("file", "sha256", "base", "tip", "snap", "xacro"))
    ) is not None:
        given = [table.require(key, f'write {key} = "..."') for key in ("file", "sha256")]
        origin, digest, base, tip = (table.read_text(key) for key in ("file", "sha256", "base", "tip"))
        snap = table.read_float("snap", "rad", NOT_NEGATIVE) or 0.0
        if all(given) and origin is not None and digest is not None:
            # Named as seen from the folder of the robot file.
            path = str(Path(file).parent / origin)
            inner = table.read_table("xacro")
            xacro = () if inner is None else tuple((key, inner.read_text(key) or "") for key in inner.values)
            made_from = SourceFile(file=path, sha256=digest, base=base, tip=tip, snap=snap, xacro=xacro)
    name = root.read_text("name")
    if name is not None and not _NAME.fullmatch(name):
        text = f"{root.show('name')} cannot name functions; use letters, digits and _, a letter first"
        root.refuse("robot.bad-name", "name", text)
    description, source = (root.read_text(key) or "" for key in ("description", "source"))
    symbols = root.inside(root.symbols, "symbols", "symbols")
    taken = {f"{letter}{coupling.name}": coupling.name for coupling in couplings for letter in _LETTERS}
    for symbol in root.symbols:
        if symbol in taken and not _RESERVED.fullmatch(symbol):
            text = f"cannot name a symbol: it reads as a parameter of the coupling {taken[symbol]}"
            symbols.refuse_key("robot.bad-name", symbol, text)
        elif symbol not in root.used:
            symbols.warn("robot.unused-symbol", symbol, "has no effect, as nothing uses it; check its name")
    notices = root.finish()
    robot = Robot(
        name=name or re.sub(r"\W|^(?=\d)", "_", Path(file).stem),
        description=description,
        source=source,
        convention=convention,
        gravity=gravity,
        symbols=tuple(sorted(root.symbols.items())),
        joints=joints,
        couplings=couplings,
        log=log,
        processing=processing,
        controller=controller,
        settings=settings,
        path=file,
        notices=notices,
        made_from=made_from,
        fixed=fixed,
    )
    found = free_mounting(robot, gravity=unknown, zeros=zeros or ())
    place = root.places.locate_value(("gravity",))
    # What is said of the key has its place.
    told = (
        note if note.line else replace(note, line=place.line, column=place.column) for note in found.notices
    )
    return replace(found, notices=tuple(told))


def read_body(
    section: Section, name: str, frame: Placement, others: tuple[str, ...] = ()
) -> tuple[tuple[float, ...] | None, SymbolicInertia | None]:
    """Return the ten parameters of a body and their form in symbols; None where the file states none.

    Args:
        section: the table around that of the body, as of a joint.
        name: of the body's table, as "link".
        frame: the frame that the file's values refer to, seen from the link's frame.
        others: keys that the table may have besides.
    """
    link = section.read_table(name, ("mass", "com", "inertia", "standard", *others))
    if link is None:
        return None, None
    errors, symbols = len(link.errors), link.symbols
    key: str = "inertia"
    found: tuple[float, ...] | None = None
    form: SymbolicInertia | None = None
    if "standard" in link.values:
        key = "standard"
        for other in ("mass", "com", "inertia"):
            if other in link.values:
                text = "cannot be combined with standard, which means the same; keep one of the two"
                link.refuse_key("robot.two-forms", other, text)
        table = link.read_table("standard", INERTIAL)
        if table is not None and table.require("M", "write M = 1.5 (the mass in kg)"):
            found = tuple(
                table.read_float(entry, unit, NOT_NEGATIVE if entry == "M" else ANY) or 0.0
                for entry, unit in zip(INERTIAL, _STANDARD_UNITS, strict=True)
            )
    else:
        mass = read_linear_form(link, "mass", "kg", allowed=POSITIVE)
        place = read_vector(link, "com", "m")
        inertia = dict.fromkeys(TENSOR, ZERO)
        if isinstance(link.values.get("inertia"), list):
            inertia |= _read_tensor(link)
        elif tensor := link.read_table("inertia", TENSOR):
            for entry in TENSOR:
                allowed = NOT_NEGATIVE if entry[0] == entry[1] else ANY
                inertia[entry] = read_linear_form(tensor, entry, "kg*m^2", allowed=allowed) or ZERO
        if link.values:
            remedy = "com and inertia mean nothing without it: write mass = 1.5 (kg), or leave them out"
            link.require("mass", remedy)
        if mass is not None:
            xx, xy, xz, yy, yz, zz = inertia.values()
            form = SymbolicInertia(mass=mass, com=place, inertia=(xx, xy, xz, yy, yz, zz))
            com, central = ([part.to_float(symbols) for part in parts] for parts in (form.com, form.inertia))
            found = compute_standard_parameters(mass.to_float(symbols), com, central)
    if found is None or len(link.errors) > errors:
        return None, None
    impossible = explain_impossible_inertia(found) if found[9] else ""
    if impossible and key == "inertia":
        text = f"no physical body has this inertia: {impossible}; check the values and their reference point"
        link.refuse("robot.impossible-inertia", key, f"{text}, or write them as standard, which is kept")
        return None, None
    if impossible:
        text = f"no physical body has these values, and simulation may fail; check them: {impossible}"
        link.warn("robot.impossible-inertia", key, text)
    elif not found[9] and any(found):
        text = "no mass (M = 0), but other values, as no physical body has: simulation may fail; state M"
        link.warn("robot.inertia-without-mass", key, text)
    if form is not None and not any(form.inertia):
        text = "inertia is taken as zero: a point mass; write inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }"
        section.warn("robot.point-mass", name, f"{text} (kg*m^2) if the link has one")
    symbolic = form and any(entry.symbols for entry in (form.mass, *form.com, *form.inertia))
    return move_by_placement(found, frame, symbols), form if symbolic else None


def _read_tensor(link: Section) -> dict[str, Exact]:
    """Return the entries of an inertia written as three rows, symmetric but for rounding."""
    rows = link.values["inertia"]
    if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
        text = "expected { xx, xy, xz, yy, yz, zz } or three rows of three numbers in kg*m^2, got "
        link.refuse("robot.wrong-type", "inertia", text + link.show("inertia"))
        return {}
    read = partial(read_linear_form, link, "inertia", "kg*m^2")
    entries = [
        [read(i, j, allowed=NOT_NEGATIVE if i == j else ANY) or ZERO for j in range(3)] for i in range(3)
    ]
    found: dict[str, Exact] = {}
    largest = max(abs(entry.to_float(link.symbols)) for row in entries for entry in row)
    for name, (i, j) in zip(TENSOR, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), strict=True):
        one, two = entries[i][j], entries[j][i]
        if abs((one - two).to_float(link.symbols)) > _ASYMMETRY * largest:
            first, second = (entry.to_float(link.symbols) for entry in (one, two))
            text = f"the matrix must be symmetric; its entries ({i + 1}, {j + 1}) and ({j + 1}, {i + 1}) "
            text += f"are {first:g} and {second:g}"
            link.refuse("robot.asymmetric-inertia", "inertia", text, i, j)
        found[name] = one if one == two else (one + two) * Exact.of("0.5")
    return found


def _read_mimics(
    sections: Sequence[Section], names: Sequence[str], kinds: Sequence[JointKind | None]
) -> dict[int, tuple[Mimic, Placement]]:
    """Return what the followers among the joints follow, by their index, and the offset of their motion."""
    steps: dict[str, MimicStep] = {}
    offsets: dict[str, Placement] = {}
    for section, name, kind in zip(sections, names, kinds, strict=True):
        if "mimic" in section.values and kind is None:
            text = "a fixed joint follows nothing; leave this out"
            section.refuse_key("robot.follows-fixed", "mimic", text)
            continue
        table = section.read_table("mimic", ("joint", "multiplier", "offset"))
        if table is None:
            continue
        multiplier = read_fraction(table, "multiplier", "leave it out, or write a fixed joint") or Fraction(1)
        offset, placement = read_position(table, "offset")
        table.require("joint", 'write joint = "joint1", the joint to follow')
        followed = table.read_text("joint")
        if followed is not None and followed not in names:
            table.refuse_joint("robot.unknown-joint", "joint", names)
        elif followed is not None and kinds[names.index(followed)] is None:
            text = f'"{followed}" is fixed; make this joint fixed too, or follow one that moves'
            table.refuse("robot.follows-fixed", "joint", text)
        elif followed is not None:
            steps[name] = MimicStep(master=followed, multiplier=multiplier, offset=offset)
            offsets[name] = placement
    followers = {}
    for name, step in steps.items():
        index, path = names.index(name), [name]
        for end in step.follow(steps):
            master = str(end.master)
            if master in path:
                # A ring is reported once, at its first joint; chains that end in one need no message.
                if master == name and index == min(map(names.index, path)):
                    text = f"{' follows '.join((*path, name))}: a ring; one of them must move by itself"
                    sections[index].refuse("robot.mimic-ring", "mimic", text)
                break
            path.append(master)
        else:
            section, frame = sections[index], offsets[name]
            if len(path) > 2:
                frame = place_joint(end.offset, section.symbols, prismatic=section.prismatic, snap=ROUNDED)
            followers[index] = Mimic(master=names.index(path[-1]), multiplier=end.multiplier), frame
    return followers


def _warn_implausible(root: Section, sections: Sequence[Section], joints: Sequence[Joint]) -> None:
    """Warn of masses and inertias that do not fit the robot's size."""
    links = {}
    for joint in joints:
        steps = (value.to_float(root.symbols) for value in joint.placement.translation)
        slide = max(map(abs, joint.limits.position or (0.0,))) if joint.prismatic else 0.0
        parent = joints[joint.parent].name if joint.parent >= 0 else BASE
        links[joint.name] = PlacedBody(parent, math.hypot(*steps), slide, joint.inertial)
    places = {joint.name: section for joint, section in zip(joints, sections, strict=True)}
    for name, text in find_implausible(links):
        if name:
            places[name].warn("robot.implausible-body", "link", text)
        else:
            root.warn("robot.implausible-body", "joint", text)


def read_joints(
    root: Section, convention: str
) -> tuple[tuple[Joint, ...], tuple[Coupling, ...], tuple[FixedBody, ...]]:
    """Return the joints of the file, the drives that turn with several of them, bodies on fixed joints."""
    remedy = 'write [[joint]] and kind = "revolute" for each joint'
    root.require("joint", remedy)
    if root.get("joint") == []:
        root.refuse("robot.missing-key", "joint", f"empty, and a robot needs a joint; {remedy}")
    sections, kinds, names = [], [], list[str]()
    for table in root.read_table_array("joint"):
        table.require("kind", 'write kind = "revolute" or kind = "prismatic"')
        found = table.read_choice("kind", _KINDS)
        kinds.append(_KINDS[found] if found else JointKind.REVOLUTE)
        sections.append(replace(table, prismatic=kinds[-1] is JointKind.PRISMATIC))
    for number, section in enumerate(sections, start=1):
        name = section.read_text("name")
        if name in names:
            text = f"the name is taken by joint {names.index(name) + 1}; each joint needs its own"
            section.refuse("robot.duplicate-joint", "name", text)
        elif name is not None and (name == BASE or not name.strip()):
            text = f'{section.show("name")} cannot name a joint: "{BASE}" is what the first joint is fixed to'
            section.refuse("robot.bad-name", "name", text)
        names.append(name or f"joint{number}")
    followers = _read_mimics(sections, names, kinds)
    joints: list[Joint] = []
    for index, section in enumerate(sections):
        section.refuse_unknown_keys(_JOINT_KEYS)
        # The joint before it by default, -1 for the base.
        parent, stated, known = index - 1, section.read_text("parent"), (BASE, *names[:index])
        if stated in known:
            parent = known.index(stated) - 1
        elif stated in names:
            text = f'"{stated}" does not stand before this joint; a parent comes before its children'
            section.refuse("robot.unknown-parent", "parent", text)
        elif stated is not None:
            section.refuse_joint("robot.unknown-parent", "parent", known)
        near, frame = read_frames(section, convention)
        mimic, offset = followers.get(index, (None, IDENTITY))
        inertial, form = read_body(section, "link", frame)
        joint = Joint(
            name=names[index],
            kind=kinds[index] or JointKind.REVOLUTE,
            parent=parent,
            placement=compose_placements(joints[parent].frame if parent >= 0 else IDENTITY, near, offset),
            inertial=inertial,
            mimic=mimic,
            frame=frame,
            form=form,
        )
        joints.append(complete_joint(section, joint, fixed=kinds[index] is None))
    _warn_implausible(root, sections, joints)
    couplings = read_couplings(root, names, kinds)
    fixed = [index for index, kind in enumerate(kinds) if kind is None]
    if fixed and len(fixed) == len(joints) and not root.errors:
        text = "every joint is fixed, and a robot moves; give one of them another kind"
        sections[0].refuse("robot.fixed-joint", "kind", text)
    if not fixed or root.errors:
        return tuple(joints), couplings, ()
    lumped = lump_fixed_joints(joints, fixed, root.symbols)
    unused = {body.name for body in lumped.bodies if body.own is None}
    for index, fixture in zip(fixed, lumped.frames, strict=True):
        carrier = fixture.joint
        where = f"the link of joint '{lumped.joints[carrier].name}'" if carrier >= 0 else "the base"
        if fixture.name in unused:
            text = f"these values count nowhere: {where}, which carries them, has none; state those too, or "
            text += "write this joint into a robot file with identified values"
            sections[index].warn("robot.unused-body", "link", text)
            continue
        mass = "" if has_mass(joints[index]) else ", which gets no heavier: the file gives no mass"
        sections[index].warn("robot.lumped", "kind", f"fixed; its link belongs to {where}{mass}")
    moved = {old: new for old, new in enumerate(lumped.indices) if new is not None}
    terms = (tuple((moved[index], factor) for index, factor in entry.terms) for entry in couplings)
    turned = tuple(replace(entry, terms=own) for entry, own in zip(couplings, terms, strict=True))
    return lumped.joints, turned, lumped.bodies


def read_dh_table(path: Path, convention: str, gravity: tuple[str, str, str] = ("0", "0", "-9.81")) -> Robot:
    """Return the robot whose rows, "modified" or "standard", the text file at `path` holds.

    `gravity` is in the base frame in m/s^2, as decimals. A RobotError has all mistakes in the file.
    """
    return parse_dh_table(read_text_file(path), convention, gravity, str(path))


def parse_dh_table(
    text: str, convention: str, gravity: tuple[str, str, str] = ("0", "0", "-9.81"), file: str = "table.csv"
) -> Robot:
    """Return the robot whose rows `text`, called `file`, holds; see `read_dh_table`."""
    places: dict[KeyPath, Place] = {}
    start = Place(file, 1, 1)
    joints: list[dict[str, Any]] = []
    letters: dict[str, Any] = {}
    values: dict[str, Any] = {"convention": convention, "joint": joints}
    values |= {"gravity": [Decimal(value) for value in gravity]} | (
        {"symbols": letters} if "=" in text else {}
    )
    root = Section(values=values, places=Places(keys=places, values=places, whole=start))
    # The cells of every line that holds more than a comment, each with its text and place.
    lines, separator = list[list[Place]](), ""
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        # What stands in quotes is masked, so that separators and # in it are none.
        masked = _QUOTED.sub(lambda match: "x" * len(match[0]), line).partition("#")[0]
        if not masked.strip():
            continue
        if match := _LETTER.fullmatch(masked.strip()):
            letters[match[1]] = Decimal(match[2]) if _DECIMAL.fullmatch(match[2]) else match[2]
            places["symbols", match[1]] = Place(file, number, 1, match[0])
            continue
        separator = separator or max((",", ";", "\t"), key=masked.count)
        cells, column = list[Place](), 0
        for part in masked.split(separator):
            found = line[column : column + len(part)]
            lead = len(found) - len(found.lstrip())
            cells.append(Place(file, number, column + lead + 1, found.strip()))
            column += len(part) + len(separator)
        lines.append(cells)
    code = "robot.table-header"
    if not lines:
        raise RobotError(start.notice(code, f"empty; the first line names the columns: {_HEADER}"))
    cells = lines[0]
    names = [_unquote(cell).lower() for cell in cells]
    keys = [_COLUMNS.get(name, ("", None))[0] for name in names]
    if not any(keys):
        text = f"no header; the first line names the columns: {_HEADER} (alpha_deg is in degrees, a_mm in mm)"
        raise RobotError(cells[0].notice(code, text))
    for index, (name, key, cell) in enumerate(zip(names, keys, cells, strict=True)):
        if not key:
            hint = f"{suggest_names(name, _COLUMNS)} allowed are {', '.join(_COLUMNS)}".strip()
            root.errors.append(cell.notice(code, f'there is no column "{_unquote(cell)}"; {hint}'))
        elif key in keys[:index]:
            text = f'"{_unquote(cell)}" repeats a column before; keep one of the two'
            root.errors.append(cell.notice(code, text))
    if missing := [key for key in DH_KEYS if key not in keys]:
        text = f"the columns {', '.join(missing)} are missing; the first line names all: alpha,a,d,theta"
        root.errors.append(cells[0].notice(code, text))
    for cells in lines[1:]:
        places["joint", len(joints)] = cells[0]
        joints.append(_read_row(root, names, cells, len(joints), places))
    if not joints:
        root.errors.append(start.notice("robot.missing-key", "no rows below the header; write one a joint"))
    if not joints or any(error.code == code for error in root.errors):
        root.finish()
    return build_robot(root, file)


def _unquote(cell: Place) -> str:
    return cell.text[1:-1].replace('""', '"').strip() if _QUOTED.fullmatch(cell.text) else cell.text


def _read_row(
    root: Section, header: list[str], cells: list[Place], index: int, places: dict[KeyPath, Place]
) -> dict[str, Any]:
    """Return a row as the table of a joint; the places of its cells go to `places`."""
    joint: dict[str, Any] = {}
    if len(cells) != len(header):
        text = f"{len(cells)} cells under {len(header)} columns; write 0 where there is nothing"
        root.errors.append(cells[0].notice("robot.table-row", text))
    variables: list[tuple[str, Place]] = []
    for name, cell in zip(header, cells, strict=False):
        key, unit = _COLUMNS.get(name, ("", None))
        text = _unquote(cell)
        if not key or not text:
            continue
        places["joint", index, key] = cell
        if key in ("name", "kind"):
            joint[key] = f"joint{text}" if key == "name" and text.isdigit() else text
            continue
        if match := _VARIABLE.fullmatch(text):
            variables.append((key, cell))
            text = re.sub(r"^\+\s*", "", match["rest"] or "0").replace("- ", "-")
        # As a robot file would write it: a decimal, or a text such as "pi/2".
        value: Decimal | str = text
        if _DECIMAL.fullmatch(text) and (number := to_decimal(Decimal(text))) is not None:
            value = f"{number:f} deg" if unit == "deg" else number
            value = number * unit if isinstance(unit, Decimal) else value
        form = parse_linear_form(value) if isinstance(value, str) and key in ("a", "d") else ZERO
        stated = root.get("symbols") or {}
        if form is not None and (form.is_number or (unit is None and set(form.symbols) <= {*stated})):
            joint[key] = value
        else:
            comma = "; decimals have a point, not a comma" if "," in cell.text else ""
            words = f'{key}: expected a number, got "{_unquote(cell)}"{comma}; a letter needs a value in '
            words += "a line of its own below the rows, such as d1 = 0.4 (m), and a column without mm"
            root.errors.append(cell.notice("robot.bad-length", words))
    # The kind that the variable implies, or what does not agree.
    text, place = "", cells[0]
    if len(variables) > 1:
        place = variables[1][1]
        text = "q occurs twice in this row; a joint has one variable, under theta or under d"
    elif not variables and "kind" not in joint:
        text = "neither q nor kind: write q under theta (revolute) or d (prismatic), or fill in kind"
    elif variables:
        key, place = variables[0]
        kind = joint.setdefault("kind", _IMPLIED.get(key, "revolute"))
        alike = "revolute" if kind == "continuous" else kind
        if key not in _IMPLIED:
            text = f"q under {key}; a joint turns under theta or slides under d"
        elif alike in ("fixed", "revolute", "prismatic") and alike != _IMPLIED[key]:
            text = f'q under {key} is a {_IMPLIED[key]} joint, but kind is "{kind}"; correct one of them'
    joint.setdefault("kind", "revolute")
    if text:
        root.errors.append(place.notice("robot.table-row", text))
    return joint
