"""A robot as a TOML file that people read and complete.

A robot, from any reader -> the text of a file; read back it gives the same placements exactly, and the same
values up to the rounding of a change of frame. `[log]` and `[processing]` leave out what says nothing. On
request each joint gets, as comments to be filled in, the tables that it does not have (valid without their
"# ", with made-up numbers).

Supported: everything a robot file can say. A joint is placed by a row of the convention where it has one,
else by its origin. Links with values that no body has are written as standard parameters, which readers
keep with a warning. Catalogue values of an elastic joint come out as the stiffness and knees that they
stand for.
Not supported: negative masses; the link's values are left out, and a comment says so.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from symid.notation import INERTIAL, get_unit_factor
from symid.robot.description import (
    Coupling,
    Drive,
    FrictionKind,
    FrictionValues,
    Joint,
    JointKind,
    Limits,
    LogMap,
    LogQuantity,
    Processing,
    Robot,
)
from symid.robot.elasticity import Elasticity, Knee
from symid.robot.exact_values import (
    add_comment,
    write_exact,
    write_fraction,
    write_key,
    write_known,
    write_modified_row,
    write_number,
    write_origin,
    write_standard_row,
    write_value,
)
from symid.robot.geometry import IDENTITY, Placement, compose_placements, invert_placement, to_floats
from symid.robot.inertia import explain_impossible_inertia, move_by_placement, move_parameters, split_body
from symid.robot.toml_friction import name_shape, name_values
from symid.robot.toml_settings import compute_current_factor, list_controller, list_log, list_processing


def _write_elasticity(elasticity: Elasticity, *, prismatic: bool) -> Iterator[str]:
    """Yield the lines of the table."""
    length, torque = ("m", "N") if prismatic else ("rad", "N m")
    yield from ("", "[joint.elasticity]")
    yield add_comment(f"stiffness = {write_known(elasticity.stiffness)}", f"{torque}/{length}")
    if elasticity.damping:
        yield add_comment(f"damping = {write_number(elasticity.damping)}", f"{torque} s/{length}")
    if elasticity.cubic:
        yield add_comment(f"cubic = {write_number(elasticity.cubic)}", f"{torque}/{length}^3")
    if elasticity.stops:
        yield add_comment("stops = [", f"threshold in {length}, stiffness in {torque}/{length}")
        for stop in elasticity.stops:
            threshold = write_number(stop.threshold)
            yield f"  {{ threshold = {threshold}, stiffness = {write_known(stop.stiffness)} }},"
        yield "]"
    if elasticity.knees:
        yield from _write_knees(elasticity.knees, torque)


def _write_knees(knees: tuple[Knee, ...], torque: str) -> Iterator[str]:
    mirrored = tuple(Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(knees))
    if mirrored == knees:
        yield add_comment("symmetric = true", "each knee stands for one below zero too")
        knees = tuple(knee for knee in knees if knee.threshold > 0)
    yield add_comment("knees = [", f"threshold in {torque}, slope added to one")
    for knee in knees:
        yield f"  {{ threshold = {write_number(knee.threshold)}, slope = {write_number(knee.slope)} }},"
    yield "]"


_COLUMN = 37
_Hints = tuple[tuple[str, str], ...]
_LINK_HINTS: _Hints = (
    ("mass = 1.5", "kg"),
    ("com = [0, 0, 0.1]", "m, in the link's frame"),
    ("inertia = {{ xx = 0.01, yy = 0.01, zz = 0.01 }}", "kg m^2, about the centre of mass"),
)
_FRICTION_HINTS: _Hints = (
    ('model = "viscous_coulomb_offset"', "with all of these values, or none: unknown"),
    ("Fv = 1.0", "{torque} s/{unit}"),
    ("Fc = 2.0", "{torque}"),
    ("offset = 0.0", "{torque}"),
)
_ELASTICITY_HINTS: _Hints = (
    ('stiffness = "unknown"', "{torque}/{unit}, of the gear between motor and link"),
    ("damping = 0.0", "{torque} s/{unit}"),
    ("stops = []", "{{ threshold = {unit}, stiffness = {torque}/{unit} }}: springs that slip"),
    ("knees = []", "{{ threshold = {torque}, slope = 0.5 }}: where the joint gets harder"),
)


def _list_drive_hints(drive: Drive) -> _Hints:
    """Return what the drive does not say, and what it would mean."""
    hints: _Hints = ()
    if drive.gear == 1:
        hints += (("gear = 100", "motor turns per turn of the joint (motor rad per m of a slide)"),)
    if not drive.has_rotor and drive.rotor_inertia is None:
        hints += (
            ("rotor_inertia = 1e-5", 'kg m^2, or "unknown": it is identified'),
            ('rotor_inertia_side = "motor"', 'or "joint"'),
        )
    if drive.torque_constant is None:
        hints += (("torque_constant = 0.1", "N m/A, for logs of motor currents"),)
    return hints


def _list_limit_hints(limits: Limits) -> _Hints:
    """Return the limits that are not stated, and their units."""
    hints = (
        (limits.position, "position = [-1, 1]", "{unit}"),
        (limits.velocity, "velocity = 2", "{unit}/s"),
        (limits.acceleration, "acceleration = 10", "{unit}/s^2, kept by symid excite"),
        (limits.jerk, "jerk = 100", "{unit}/s^3, likewise"),
        (limits.torque, "torque = 50", "{torque}"),
    )
    return tuple((text, meaning) for value, text, meaning in hints if value is None)


def _write_hints(joint: Joint, hints: _Hints, table: str = "") -> Iterator[str]:
    """Yield hints as comments; those of a whole table below its name."""
    unit, torque = ("m", "N") if joint.kind is JointKind.PRISMATIC else ("rad", "N m")
    if table:
        yield from ("", f"# [joint.{table}]")
    for text, meaning in hints:
        line = f"# {text.format()}"
        gap = "  " if len(line) >= _COLUMN else ""
        yield f"{line:<{_COLUMN}}{gap}# {meaning.format(unit=unit, torque=torque)}"


def _list_table_hints(joint: Joint) -> Iterator[str]:
    """Yield the tables that `joint` does not have, each line a comment with its unit and an example."""
    for table, lacks, hints in (
        ("link", joint.inertial is None, _LINK_HINTS),
        ("drive", joint.drive == Drive(), _list_drive_hints(joint.drive)),
        ("friction", joint.friction.kind is FrictionKind.NONE, _FRICTION_HINTS),
        ("elasticity", joint.elasticity is None, _ELASTICITY_HINTS),
        ("limits", joint.limits == Limits(), _list_limit_hints(joint.limits)),
    ):
        if lacks:
            yield from _write_hints(joint, hints, table)


_MEANING = {
    "filter_cutoff": "Hz",
    "automatic": "cut-off and decimation that are not stated follow from the log",
    "drop_first": "samples, after differentiation",
    "drop_last": "likewise",
    "standstill": "rad/s or m/s: slower rows of a joint are left out",
}


def _write_settings(robot: Robot) -> Iterator[str]:
    """Yield the lines of the tables of settings; none of a table that says nothing."""
    if robot.log != LogMap():
        yield from ("", "[log]")
        for key, entry in list_log(robot.log).items():
            yield f"{key} = {write_value(_shorten(robot, key, entry))}"
    if robot.processing != Processing(automatic=True):
        yield from ("", "[processing]")
        standard = list_processing(Processing())
        settings = list_processing(robot.processing)
        kept = {key: entry for key, entry in settings.items() if entry != standard[key]}
        # A table without a key would not be there, and all would be automatic.
        for key, entry in (kept or {"automatic": False}).items():
            line = f"{key} = {write_value(entry)}"
            yield add_comment(line, _MEANING[key]) if key in _MEANING else line
    if robot.controller is not None:
        gains = list_controller(robot.controller).items()
        yield from ("", "[controller]", *(f"{key} = {write_value(entry)}" for key, entry in gains))


def _shorten(robot: Robot, key: str, entry: Any) -> Any:  # noqa: ANN401  whatever TOML has
    """Return a quantity without the factor and side that it has anyway."""
    if not isinstance(entry, dict) or "factor" not in entry:
        return entry
    quantity: LogQuantity = getattr(robot.log, key)
    usual = {"side": quantity.side == "joint", "factor": set(quantity.factor) == {1.0}}
    if _is_converted(robot, quantity):
        usual = {"side": True, "factor": True}
    return {name: value for name, value in entry.items() if not usual.get(name)}


def _is_converted(robot: Robot, quantity: LogQuantity) -> bool:
    """Return whether the factor is what torque constants and gears make of a current, and will again."""
    coupled = robot.log.transmission is not None
    return (
        get_unit_factor(quantity.unit)[0] == "current"
        and quantity.factor == compute_current_factor(robot.axes, coupled=coupled)
        and quantity.side == ("motor" if coupled else "joint")
    )


_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_DIGITS = 14
_DUST = 1e-30


def write_robot(robot: Robot, *, comment: str = "", hints: bool = False) -> str:
    """Return the text of the robot's file.

    Args:
        robot: the robot.
        comment: lines for the head of the file.
        hints: whether each joint gets, in comments, the tables that it does not have, to be filled in.
    """
    # Joint frames seen from the link frames that the file gives to their parents.
    frames = [robot.joints[joint.parent].frame if joint.parent >= 0 else IDENTITY for joint in robot.joints]
    near = [
        joint.placement if frame == IDENTITY else compose_placements(invert_placement(frame), joint.placement)
        for joint, frame in zip(robot.joints, frames, strict=True)
    ]
    convention, placed = _choose_rows(robot, near)
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [
        f"name = {write_value(_choose_name(robot.name))}",
        *(
            f"{key} = {write_value(text)}"
            for key, text in (("description", robot.description), ("source", robot.source))
            if text
        ),
        f'convention = "{convention}"',
        add_comment(
            f"gravity = [{', '.join(write_exact(entry) for entry in robot.gravity)}]", "m/s^2, base frame"
        ),
    ]
    if robot.symbols:
        lines += ["", "[symbols]", *(f"{name} = {write_number(value)}" for name, value in robot.symbols)]
    for index, joint in enumerate(robot.joints):
        lines += ["", *_write_joint(robot, index, placed[index], first=index == 0, hints=hints)]
        if hints:
            lines += _list_table_hints(joint)
    for coupling in robot.couplings:
        lines += ["", *_write_coupling(robot, coupling)]
    lines += _write_settings(robot)
    return "\n".join(lines) + "\n"


def _choose_name(name: str) -> str:
    """Return a name that can name generated functions."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return plain if plain[:1].isalpha() else f"robot_{plain}"


def _choose_rows(robot: Robot, near: Sequence[Placement]) -> tuple[str, list[dict[str, str]]]:
    """Return the convention in which the robot is written, and what places each joint."""
    pairs = [(placement, joint.frame) for placement, joint in zip(near, robot.joints, strict=True)]
    if robot.convention == "standard":
        rows = [write_standard_row(placement, frame) for placement, frame in pairs]
        convention = "standard"
    else:
        rows = [write_modified_row(placement) if frame == IDENTITY else None for placement, frame in pairs]
        convention = "modified" if robot.convention == "modified" or None not in rows else "origin"
    placed = []
    for pair, row in zip(pairs, rows, strict=True):
        if row is not None and convention != "origin":
            placed.append(row)
            continue
        # An empty origin says that this joint has no row.
        named = zip(("origin", "frame"), pair, strict=True)
        placed.append(
            {key: write_origin(value) for key, value in named if key == "origin" or value != IDENTITY}
        )
    return convention, placed


_PLACING = {
    "alpha": "rad",
    "a": "m",
    "d": "m",
    "theta": "rad",
    "origin": "the joint's frame (z: its axis) seen from the link before; m, rad",
    "frame": "the link's frame seen from the joint's",
}


def _write_joint(
    robot: Robot, index: int, placed: dict[str, str], *, first: bool, hints: bool
) -> Iterator[str]:
    joint = robot.joints[index]
    yield "[[joint]]"
    yield f"name = {write_value(joint.name)}"
    yield f'kind = "{joint.kind.value}"'
    if joint.parent != index - 1:
        parent = robot.joints[joint.parent].name if joint.parent >= 0 else "base"
        yield f"parent = {write_value(parent)}"
    for key, text in placed.items():
        yield add_comment(f"{key} = {text}", _PLACING[key]) if first else f"{key} = {text}"
    if joint.mimic:
        yield from ("", "[joint.mimic]", f"joint = {write_value(robot.joints[joint.mimic.master].name)}")
        yield f"multiplier = {write_fraction(joint.mimic.multiplier)}"
    prismatic = joint.kind is JointKind.PRISMATIC
    yield from _write_link(joint, dict(robot.symbols))
    yield from _write_drive(joint.drive)
    if hints and joint.drive != Drive():
        yield from _write_hints(joint, _list_drive_hints(joint.drive))
    yield from _write_friction("joint", joint.friction)
    yield from _write_springs(joint, prismatic=prismatic)
    yield from _write_limits(joint, prismatic=prismatic)
    if hints and joint.limits != Limits():
        yield from _write_hints(joint, _list_limit_hints(joint.limits))


def _write_link(joint: Joint, symbols: Mapping[str, float]) -> Iterator[str]:
    """Yield mass, centre of mass and inertia about it, in the frame that the file gives to the link."""
    if joint.form is not None:
        form = joint.form
        inertia = {key: write_exact(value) for key, value in zip(_TENSOR, form.inertia, strict=True) if value}
        yield from ("", "[joint.link]", f"mass = {write_exact(form.mass)}")
        yield f"com = [{', '.join(write_exact(value) for value in form.com)}]"
        if inertia:
            yield f"inertia = {{ {', '.join(f'{key} = {text}' for key, text in inertia.items())} }}"
    elif joint.inertial is not None:
        mass = joint.inertial[9]
        if mass < 0:
            yield from ("", "# the link's values are left out: its mass is negative")
        elif not mass or explain_impossible_inertia(joint.inertial):
            yield from _write_standard(joint.inertial, joint.frame, symbols)
        else:
            yield from _write_body(joint.inertial, joint.frame, symbols)


def _write_standard(
    parameters: Sequence[float], frame: Placement, symbols: Mapping[str, float]
) -> Iterator[str]:
    """Yield the ten parameters about the origin of the frame that the file gives to the link."""
    moved = move_by_placement(parameters, frame, symbols, inverse=True)
    scales = ((moved[:6], parameters[:6]), (moved[6:9], parameters[6:9]))
    values = [entry for new, old in scales for entry in _round(new, max(abs(part) for part in (*new, *old)))]
    named = [(key, entry) for key, entry in zip(INERTIAL, (*values, moved[9]), strict=True)]
    listed = ", ".join(f"{key} = {write_number(entry)}" for key, entry in named if entry or key == "M")
    why = "no body has these values" if any(parameters) else "no mass"
    yield from (
        "",
        "[joint.link]",
        f"standard = {{ {listed} }}  # {why}; kg m^2, kg m, kg, about the frame's origin",
    )


def _write_body(parameters: Sequence[float], frame: Placement, symbols: Mapping[str, float]) -> Iterator[str]:
    mass, com, central = split_body(parameters)
    rotation = np.array(to_floats(frame))
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    turned = move_parameters((*central, 0.0, 0.0, 0.0, 0.0), rotation.T, np.zeros(3))[:6]
    inertia = _round(turned, max(abs(entry) for entry in parameters[:6]))
    place = _round(rotation.T @ (np.array(com) - origin), max(map(abs, com)))
    yield from ("", "[joint.link]", add_comment(f"mass = {write_number(mass)}", "kg"))
    yield add_comment(
        f"com = [{', '.join(write_number(entry) for entry in place)}]", "m, in the link's frame"
    )
    pairs = [(key, entry) for key, entry in zip(_TENSOR, inertia, strict=True) if entry]
    if pairs:
        listed = ", ".join(f"{key} = {write_number(entry)}" for key, entry in pairs)
        yield f"inertia = {{ {listed} }}  # kg m^2, about the centre of mass"


def _round(values: Iterable[float], scale: float) -> list[float]:
    """Return `values` without the rounding of sums of the size `scale`, which hides their short decimals."""
    places = _DIGITS - math.floor(math.log10(scale)) if scale else _DIGITS
    rounded = (round(float(value), places) for value in values)
    return [value if abs(value) > _DUST else 0.0 for value in rounded]


def _write_drive(drive: Drive) -> Iterator[str]:
    if drive == Drive():
        return
    yield from ("", "[joint.drive]")
    if drive.gear != 1:
        yield f"gear = {write_number(drive.gear)}"
    if drive.has_rotor and drive.rotor_inertia is None:
        yield f"rotor_inertia = {write_known(None)}"
    elif drive.rotor_inertia is not None:
        yield from (f"rotor_inertia = {write_number(drive.rotor_inertia)}", 'rotor_inertia_side = "joint"')
    if drive.torque_constant is not None:
        yield add_comment(f"torque_constant = {write_number(drive.torque_constant)}", "N m/A")


def _write_friction(owner: str, friction: FrictionValues) -> Iterator[str]:
    if friction.kind is FrictionKind.NONE:
        return
    yield from ("", f"[{owner}.friction]", f'model = "{friction.kind.value}"')
    for name, value in (name_values(friction) | name_shape(friction)).items():
        yield f"{name} = {write_number(value)}"
    if friction.smoothing:
        yield f"smoothing = {write_number(friction.smoothing)}"


def _write_springs(joint: Joint, *, prismatic: bool) -> Iterator[str]:
    unit = "N/m" if prismatic else "N m/rad"
    if joint.spring is not None:
        yield from (
            "",
            "[joint.spring]",
            add_comment(f"stiffness = {write_known(joint.spring.stiffness)}", unit),
        )
        yield add_comment(f"rest = {write_known(joint.spring.rest)}", "m" if prismatic else "rad")
    if joint.elasticity is not None:
        yield from _write_elasticity(joint.elasticity, prismatic=prismatic)


def _write_limits(joint: Joint, *, prismatic: bool) -> Iterator[str]:
    limits = joint.limits
    unit = "m" if prismatic else "rad"
    lines = []
    if limits.position is not None:
        low, high = (write_number(value) for value in limits.position)
        lines.append(add_comment(f"position = [{low}, {high}]", unit))
    units = {"velocity": f"{unit}/s", "acceleration": f"{unit}/s^2", "jerk": f"{unit}/s^3"}
    for key, of_key in {**units, "torque": "N" if prismatic else "N m"}.items():
        value = getattr(limits, key)
        if value is not None:
            lines.append(add_comment(f"{key} = {write_number(value)}", of_key))
    if lines:
        yield from ("", "[joint.limits]", *lines)


def _write_coupling(robot: Robot, coupling: Coupling) -> Iterator[str]:
    terms = (
        f"{write_key(robot.joints[index].name)} = {write_fraction(factor)}"
        for index, factor in coupling.terms
    )
    yield from ("[[coupling]]", f"name = {write_value(coupling.name)}", f"terms = {{ {', '.join(terms)} }}")
    if coupling.has_rotor:
        yield f"rotor_inertia = {write_known(coupling.rotor_inertia)}"
    yield from _write_friction("coupling", coupling.friction)
