"""A robot as a TOML file that people read and complete.

A robot, from any reader -> the text of a file; read back it gives the same placements exactly, and the same
values up to the rounding of a change of frame. On request each joint gets, as comments to be filled in, the
tables that it does not have (valid without their "# ", with made-up numbers).

Supported: everything a robot file can hold. A joint is placed by a row of the convention where it has one,
else by its origin. Links with values that no body has are written as standard parameters, which readers
keep with a warning. Catalogue values of an elastic joint are written as stiffness and knees.
Not supported: negative masses; the link's values are left out, with a comment.
"""

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from symid import joint_models
from symid.notation import GRAVITY_SYMBOLS, INERTIAL, adapt_unit, get_unit_factor
from symid.robot.description import (
    UNKNOWN,
    Drive,
    Joint,
    Limits,
    LogMap,
    NamedSettings,
    Processing,
    Robot,
    SourceFile,
)
from symid.robot.exact_values import (
    add_comment,
    write_exact,
    write_fraction,
    write_key,
    write_known,
    write_list,
    write_modified_row,
    write_number,
    write_origin,
    write_standard_row,
    write_value,
)
from symid.robot.geometry import IDENTITY, compose_placements, invert_placement, to_floats
from symid.robot.inertia import (
    TENSOR,
    explain_impossible_inertia,
    move_by_placement,
    move_parameters,
    split_body,
)
from symid.robot.toml_joints import list_branch_entries
from symid.robot.toml_settings import compute_current_factor, list_controller, list_log, list_processing
from symid.robot.toml_values import BASE

_DIGITS = 14
_DUST = 1e-30
_SOURCE = re.compile(r"^(\[made_from\]\n)file = .*$", re.MULTILINE)
_PLACING = {
    "alpha": "rad",
    "a": "m",
    "d": "m",
    "theta": "rad",
    "origin": "the joint's frame (z: its axis) seen from the link before; m, rad",
    "frame": "the link's frame seen from the joint's",
}
_MEANING = {
    "filter_cutoff": "Hz",
    "automatic": "what is not stated is chosen from the log",
    "drop_first": "samples, after differentiation",
    "drop_last": "likewise",
    "standstill": "rad/s or m/s: slower samples of a joint are left out",
    "instrument_cutoff": "Hz",
    "states": "position, velocity or acceleration: up to which columns of the log are used",
}


def write_robot(robot: Robot, *, comment: str = "", hints: bool = False, folder: Path | None = None) -> str:
    """Return the text of the robot's file, `comment` at its head.

    With `hints` each joint gets, in comments, the tables that it does not have, to be filled in. The file
    that the robot was made from is named as seen from `folder`; as it was called, if None.
    """
    pairs = []
    for joint in robot.joints:
        # The joint's frame seen from the frame that the file gives to the link before it.
        outer = robot.joints[joint.parent].frame if joint.parent >= 0 else IDENTITY
        pairs.append((compose_placements(invert_placement(outer), joint.placement), joint.frame))
    if robot.convention == "standard":
        rows, convention = [write_standard_row(near, frame) for near, frame in pairs], "standard"
    else:
        rows = [write_modified_row(near) if frame == IDENTITY else None for near, frame in pairs]
        convention = "modified" if robot.convention == "modified" or None not in rows else "origin"
    # What places each joint; an empty origin says that this joint has no row.
    placed = []
    for (near, frame), row in zip(pairs, rows, strict=True):
        general = {"origin": write_origin(near), "frame": write_origin(frame)}
        if frame == IDENTITY:
            del general["frame"]
        placed.append(general if row is None or convention == "origin" else row)
    # A name that can name generated functions.
    name = re.sub(r"[^A-Za-z0-9_]", "_", robot.name)
    texts = {
        "name": name if name[:1].isalpha() else f"robot_{name}",
        "description": robot.description,
        "source": robot.source,
        "convention": convention,
    }
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [f"{key} = {write_value(text)}" for key, text in texts.items() if text]
    # Gravity that a fit has found is a number like any other.
    symbols, vector = robot.symbols, write_list(robot.gravity)
    if any(str(value) in GRAVITY_SYMBOLS for value in robot.gravity):
        symbols = tuple(entry for entry in symbols if entry[0] not in GRAVITY_SYMBOLS)
        found = [write_number(value.to_float(dict(robot.symbols))) for value in robot.gravity]
        vector = write_value(UNKNOWN) if robot.free_gravity else f"[{', '.join(found)}]"
    lines.append(add_comment(f"gravity = {vector}", "m/s^2, base frame"))
    if robot.free_zeros:
        lines.append(f"zeros = [{', '.join(map(write_value, robot.free_zeros))}]")
    if symbols:
        lines += ["", "[symbols]", *(f"{name} = {write_number(value)}" for name, value in symbols)]
    if robot.made_from is not None:
        lines += ["", "[made_from]", *_list_source(robot.made_from, folder)]
    for index, joint in enumerate(robot.joints):
        lines += ["", *_write_joint(robot, index, placed[index], hints=hints)]
        for table in _HINTS if hints else ():
            lines += _write_hints(joint, table, whole=True)
    for coupling in robot.couplings:
        factors = [(robot.joints[index].name, factor) for index, factor in coupling.terms]
        terms = ", ".join(f"{write_key(owner)} = {write_fraction(factor)}" for owner, factor in factors)
        lines += ["", "[[coupling]]", f"name = {write_value(coupling.name)}", f"terms = {{ {terms} }}"]
        lines += [f"rotor_inertia = {write_known(coupling.rotor_inertia)}"] if coupling.has_rotor else []
        lines += _write_friction("coupling", coupling.friction)
    lines += _write_settings(robot)
    return "\n".join(lines) + "\n"


def move_source(text: str, robot: Robot, folder: Path) -> str:
    """Return the text of a robot file with the file that it was made from named as seen from `folder`."""
    if robot.made_from is None:
        return text
    line = next(_list_source(robot.made_from, folder))
    return _SOURCE.sub(lambda match: match[1] + line, text, count=1)


def _list_source(made: SourceFile, folder: Path | None) -> Iterator[str]:
    """Yield the lines of the table on the file that the robot was made from."""
    file = made.file
    if folder is not None and Path(folder).anchor == Path(file).anchor:
        file = os.path.relpath(file, folder)
    yield f"file = {write_value(Path(file).as_posix())}"
    yield f'sha256 = "{made.sha256}"'
    links = {"base": made.base, "tip": made.tip}
    yield from (f"{key} = {write_value(link)}" for key, link in links.items() if link)
    yield f"snap = {write_number(made.snap)}"
    if made.xacro:
        pairs = (f"{write_key(name)} = {write_value(value)}" for name, value in made.xacro)
        yield f"xacro = {{ {', '.join(pairs)} }}"


def _write_joint(robot: Robot, index: int, placed: dict[str, str], *, hints: bool) -> Iterator[str]:
    joint = robot.joints[index]
    yield "[[joint]]"
    yield f"name = {write_value(joint.name)}"
    yield f'kind = "{joint.kind.value}"'
    if joint.parent != index - 1:
        yield f"parent = {write_value(robot.joints[joint.parent].name if joint.parent >= 0 else BASE)}"
    if not joint.actuated:
        yield add_comment("actuated = false", "no motor")
    for key, text in placed.items():
        yield f"{key} = {text}" if index else add_comment(f"{key} = {text}", _PLACING[key])
    if joint.mimic:
        yield from ("", "[joint.mimic]", f"joint = {write_value(robot.joints[joint.mimic.master].name)}")
        yield f"multiplier = {write_fraction(joint.mimic.multiplier)}"
    prismatic = joint.prismatic
    yield from _write_link(joint, dict(robot.symbols))
    drive = joint.drive
    yield from ("", "[joint.drive]") if drive != Drive() else ()
    if drive.gear_stated:
        yield f"gear = {write_number(drive.gear)}"
    if drive.has_rotor or drive.rotor_inertia is not None:
        yield f"rotor_inertia = {write_known(drive.rotor_inertia)}"
    if drive.rotor_inertia is not None:
        yield 'rotor_inertia_side = "joint"'
    if drive.torque_constant is not None:
        yield add_comment(f"torque_constant = {write_number(drive.torque_constant)}", "N m/A")
    if hints:
        yield from _write_hints(joint, "drive", whole=False)
    yield from _write_friction("joint", joint.friction)
    if joint.spring is not None:
        stiffness, rest = write_known(joint.spring.stiffness), write_known(joint.spring.rest)
        yield from ("", "[joint.spring]")
        yield from _write_values(prismatic, ("stiffness", stiffness, "N m/rad"), ("rest", rest, "rad"))
    if joint.elasticity is not None:
        yield from _write_elasticity(joint.elasticity, prismatic=prismatic)
    if joint.limits != Limits():
        yield from ("", "[joint.limits]")
    for key, _, meaning in _HINTS["limits"]:
        if (value := getattr(joint.limits, key)) is not None:
            unit = adapt_unit(meaning.partition(",")[0], prismatic=prismatic)
            yield add_comment(f"{key} = {write_value(value)}", unit)
    if hints:
        yield from _write_hints(joint, "limits", whole=False)


def _write_values(prismatic: bool, *entries: tuple[str, str, str]) -> Iterator[str]:  # noqa: FBT001
    """Yield lines of keys, values and units as comments; none where the value is empty."""
    for key, text, unit in entries:
        if text:
            yield add_comment(f"{key} = {text}", adapt_unit(unit, prismatic=prismatic))


def _write_link(joint: Joint, symbols: Mapping[str, float]) -> Iterator[str]:
    """Yield a link's values in its frame of the file; those that no body has as ten parameters."""
    form, parameters = joint.form, joint.inertial
    if form is not None:
        inertia = {key: write_exact(value) for key, value in zip(TENSOR, form.inertia, strict=True) if value}
        yield from ("", "[joint.link]", f"mass = {write_exact(form.mass)}", f"com = {write_list(form.com)}")
        if inertia:
            yield f"inertia = {{ {', '.join(f'{key} = {text}' for key, text in inertia.items())} }}"
    elif parameters is not None and parameters[9] < 0:
        yield from ("", "# the link's values are left out: its mass is negative")
    elif parameters is not None and (not parameters[9] or explain_impossible_inertia(parameters)):
        moved = move_by_placement(parameters, joint.frame, symbols, inverse=True)
        scales = ((moved[:6], parameters[:6]), (moved[6:9], parameters[6:9]))
        values = [x for new, old in scales for x in _round(new, max(abs(part) for part in (*new, *old)))]
        named = zip(INERTIAL, (*values, moved[9]), strict=True)
        listed = ", ".join(f"{key} = {write_number(entry)}" for key, entry in named if entry or key == "M")
        why = "no physical body has these values" if any(parameters) else "no mass"
        yield from ("", "[joint.link]")
        yield f"standard = {{ {listed} }}  # {why}; kg m^2, kg m, kg, about the frame's origin"
    elif parameters is not None:
        mass, com, central = split_body(parameters)
        rotation = np.array(to_floats(joint.frame))
        origin = np.array([entry.to_float(symbols) for entry in joint.frame.translation])
        turned = move_parameters((*central, 0.0, 0.0, 0.0, 0.0), rotation.T, np.zeros(3))[:6]
        entries = _round(turned, max(abs(entry) for entry in parameters[:6]))
        place = _round(rotation.T @ (np.array(com) - origin), max(map(abs, com)))
        yield from ("", "[joint.link]", add_comment(f"mass = {write_number(mass)}", "kg"))
        yield add_comment(f"com = [{', '.join(map(write_number, place))}]", "m, in the link's frame")
        named = zip(TENSOR, entries, strict=True)
        if listed := ", ".join(f"{key} = {write_number(entry)}" for key, entry in named if entry):
            yield f"inertia = {{ {listed} }}  # kg m^2, about the centre of mass"


def _round(values: Iterable[float], scale: float) -> list[float]:
    """Return `values` without the rounding of sums of the size `scale`, which hides their short decimals."""
    places = _DIGITS - math.floor(math.log10(scale)) if scale else _DIGITS
    rounded = (round(float(value), places) for value in values)
    return [value if abs(value) > _DUST else 0.0 for value in rounded]


def _write_friction(owner: str, friction: joint_models.FrictionValues) -> Iterator[str]:
    law = joint_models.get_friction_law(friction)
    if law is None:
        return
    yield from ("", f"[{owner}.friction]", f'model = "{friction.law}"')
    for name, value in (joint_models.name_values(friction) | joint_models.name_shape(friction)).items():
        yield f"{name} = {write_number(value)}"
    for name, numbers in joint_models.name_bristles(law, friction.bristles).items():
        texts = [write_number(value) for value in numbers]
        if texts:
            yield f"{name} = [{', '.join(texts)}]" if law.elements else f"{name} = {texts[0]}"
    if friction.smoothing:
        yield f"smoothing = {write_number(friction.smoothing)}"


def _write_elasticity(
    elasticity: joint_models.Elasticity, factors: tuple[float, float] = (1.0, 1.0), *, prismatic: bool
) -> Iterator[str]:
    """Yield the table of a spring, whose numbers times `factors`, of input and output, are in SI units."""

    def write(value: float | None, unit: str) -> str:
        above, _, below = unit.partition(",")[0].partition("/")
        power = ("rad" in above) - (int(below.partition("^")[2] or 1) if "rad" in below else 0)
        scale = factors[0] ** power * factors[1] ** ("N m" in above)
        return write_known(None if value is None else value * scale)

    units = {"damping": "N m s/rad", "cubic": "N m/rad^3", "backlash": "rad, half the gap", "offset": "N m"}
    small = ((key, getattr(elasticity, key), unit) for key, unit in units.items())
    yield from ("", "[joint.elasticity]")
    yield from _write_values(
        prismatic,
        ("stiffness", write(elasticity.stiffness, "N m/rad"), "N m/rad"),
        *((key, write(value, unit) if value else "", unit) for key, value, unit in small),
        ("stops", "[" if elasticity.stops else "", "threshold in rad, stiffness in N m/rad"),
    )
    for stop in elasticity.stops:
        threshold, stiffness = write(stop.threshold, "rad"), write(stop.stiffness, "N m/rad")
        yield f"  {{ threshold = {threshold}, stiffness = {stiffness} }},"
    if elasticity.stops:
        yield "]"
    knees = elasticity.knees
    if knees and tuple(replace(knee, threshold=-knee.threshold) for knee in knees[::-1]) == knees:
        yield add_comment("symmetric = true", "each knee stands for one below zero too")
        knees = tuple(knee for knee in knees if knee.threshold > 0)
    if knees:
        yield from _write_values(prismatic, ("knees", "[", "threshold in N m, slope added to one"))
        for knee in knees:
            yield f"  {{ threshold = {write(knee.threshold, 'N m')}, slope = {write_number(knee.slope)} }},"
        yield "]"
    for branch in elasticity.branches:
        model, entries = list_branch_entries(branch)
        if len(elasticity.branches) > 1:
            yield from ("", "[[joint.elasticity.branch]]")
        yield f'model = "{model}"'
        for key, (value, unit) in entries.items():
            many = ", ".join(write(one, unit) for one in (value if isinstance(value, tuple) else (value,)))
            text = f"[{many}]" if isinstance(value, tuple) else many
            yield from _write_values(prismatic, (key, text, unit))


_HEADER = re.compile(r"\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?")


def place_elasticity(
    text: str, robot: Robot, name: str, elasticity: joint_models.Elasticity, factors: tuple[float, float]
) -> str:
    """Return the text of a robot's file with another spring at the joint `name`, all else as it was.

    `factors` turn input and output of the element into rad or m, and N m or N. Nothing is changed where the
    file does not have the joint as a table of its own.
    """
    lines, joint = text.splitlines(), next(one for one in robot.joints if one.name == name)
    heads = [(k, found[1]) for k, line in enumerate(lines) if (found := _HEADER.fullmatch(line))]
    edges = [k for k, head in heads if not head.startswith("joint.")] + [len(lines)]
    own = re.compile(rf"\s*name\s*=\s*(['\"]){re.escape(name)}\1\s*(#.*)?")
    blocks = [(low, high) for low, high in pairwise(edges) if any(map(own.fullmatch, lines[low:high]))]
    blocks = [(low, high) for low, high in blocks if re.fullmatch(r"\s*\[\[\s*joint\s*\]\].*", lines[low])]
    if len(blocks) != 1:
        return text
    (low, high), kept, dropped, inside = blocks[0], list[str](), list[str](), False
    for line in lines[low:high]:
        if found := _HEADER.fullmatch(line):
            inside = found[1] == "joint.elasticity" or found[1].startswith("joint.elasticity.")
        elif re.match(r"\s*elasticity\s*[.=]", line):
            continue
        if not inside or not line.strip() or line.lstrip().startswith("#"):
            dropped += [line] if inside else []
            kept += [] if inside else [*dropped, line]
            dropped = dropped if inside else []
        else:
            dropped = []
    kept += dropped
    # Comments before the next table belong to it.
    end = max(k for k, line in enumerate(kept, start=1) if line.strip() and not line.lstrip().startswith("#"))
    written = _write_elasticity(elasticity, factors, prismatic=joint.prismatic)
    return "\n".join([*lines[:low], *kept[:end], *written, *kept[end:], *lines[high:]]) + "\n"


_HINT_COLUMN = 37
# What a joint's tables can hold: the record's field, an example, its meaning with the unit where it turns.
_HINTS = {
    "link": (
        ("", "mass = 1.5", "kg"),
        ("", "com = [0, 0, 0.1]", "m, in the link's frame"),
        ("", "inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }", "kg m^2, about the centre of mass"),
    ),
    "drive": (
        ("gear_stated", "gear = 100", "motor turns per turn of the joint (motor rad per m of a slide)"),
        ("has_rotor", "rotor_inertia = 1e-5", 'kg m^2, or "unknown": it is identified'),
        ("has_rotor", 'rotor_inertia_side = "motor"', 'or "joint"'),
        ("torque_constant", "torque_constant = 0.1", "N m/A, for logs of motor currents"),
    ),
    "friction": (
        ("", 'model = "coulomb-viscous-offset"', "with all of these values, or none: unknown"),
        ("", "Fv = 1.0", "N m s/rad"),
        ("", "Fc = 2.0", "N m"),
        ("", "offset = 0.0", "N m"),
    ),
    "elasticity": (
        ("", 'stiffness = "unknown"', "N m/rad, of the gear between motor and link"),
        ("", "damping = 0.0", "N m s/rad"),
        ("", "stops = []", "{ threshold = rad, stiffness = N m/rad }: springs that slip"),
        ("", "knees = []", "{ threshold = N m, slope = 0.5 }: where the joint gets harder"),
    ),
    "limits": (
        ("position", "position = [-1, 1]", "rad"),
        ("velocity", "velocity = 2", "rad/s"),
        ("acceleration", "acceleration = 10", "rad/s^2, kept by symid excite"),
        ("jerk", "jerk = 100", "rad/s^3, likewise"),
        ("torque", "torque = 50", "N m"),
    ),
}


def _write_hints(joint: Joint, table: str, *, whole: bool) -> Iterator[str]:
    """Yield as comments what `joint` does not state of a table, or the `whole` table where it has none."""
    record: Any = joint.inertial if table == "link" else getattr(joint, table)
    if (record in (None, Drive(), Limits(), joint_models.FrictionValues())) is not whole:
        return
    if whole:
        yield from ("", f"# [joint.{table}]")
    # Motors turn, whatever the joint does.
    prismatic = joint.prismatic and table != "drive"
    for key, text, meaning in _HINTS[table]:
        if whole or getattr(record, key) == getattr(type(record)(), key):
            line = f"# {text}"
            gap = "  " if len(line) >= _HINT_COLUMN else ""
            yield f"{line:<{_HINT_COLUMN}}{gap}# {adapt_unit(meaning, prismatic=prismatic)}"


def _write_settings(robot: Robot) -> Iterator[str]:
    """Yield the tables of settings, the robot's own and each named set, with what is not usual in them."""
    log = robot.log if robot.log != LogMap() else None
    processing = robot.processing if robot.processing != Processing(automatic=True) else None
    own = NamedSettings(name="", log=log, processing=processing, controller=robot.controller)
    for named in (own, *robot.settings):
        prefix = f"settings.{named.name}." if named.name else ""
        if named.log is not None:
            yield from ("", f"[{prefix}log]")
            for key, entry in list_log(named.log).items():
                yield f"{key} = {write_value(_shorten(robot, named.log, key, entry))}"
        if named.processing is not None:
            yield from ("", f"[{prefix}processing]")
            standard, settings = list_processing(Processing()), list_processing(named.processing)
            kept = {key: entry for key, entry in settings.items() if entry != standard[key]}
            # A table without a key would not be there, and all would be automatic.
            for key, entry in (kept or {"automatic": False}).items():
                line = f"{key} = {write_value(entry)}"
                yield add_comment(line, _MEANING[key]) if key in _MEANING else line
        if named.controller is not None:
            gains = list_controller(named.controller).items()
            lines = (f"{key} = {write_value(entry)}" for key, entry in gains)
            yield from ("", f"[{prefix}controller]", *lines)


def _shorten(robot: Robot, log: LogMap, key: str, entry: Any) -> Any:  # noqa: ANN401  whatever TOML has
    """Return a quantity of a log without the factor and side that it has anyway."""
    if not isinstance(entry, dict) or "factor" not in entry:
        return entry
    quantity: Any = getattr(log, key)
    usual = {"side": quantity.side == "joint", "factor": set(quantity.factor) == {1.0}}
    coupled = log.transmission is not None
    # What torque constants and gears make of a current they will make again.
    if (
        get_unit_factor(quantity.unit)[0] == "current"
        and quantity.factor == compute_current_factor(robot.axes, coupled=coupled)
        and quantity.side == ("motor" if coupled else "joint")
    ):
        usual = {"side": True, "factor": True}
    return {name: value for name, value in entry.items() if not usual.get(name)}
