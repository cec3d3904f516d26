"""A robot as a TOML file that people read and complete.

Input: a robot, from any reader. Output: the text of a file; read back it gives the same placements exactly,
and the same values up to the rounding of a change of frame.

Supported: everything a robot file can say. A joint is placed by a row of the convention where it has
one, else by its origin.
Links with values that no body has are written as standard parameters, which readers keep with a warning.
Not supported: negative masses; the link's values are left out, and a comment says so.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from symid.formats.controller import list_controller
from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.formats.written_elasticity import write_elasticity
from symid.formats.written_hints import list_drive_hints, list_hints, list_limit_hints
from symid.formats.written_settings import write_settings
from symid.formats.written_values import (
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
from symid.notation import INERTIAL
from symid.robot.axis_frames import invert_placement
from symid.robot.description import Coupling, Drive, FrictionKind, FrictionValues, Joint, JointKind, Robot
from symid.robot.geometry import IDENTITY, Placement, compose_placements
from symid.robot.inertia import find_impossibility, move_parameters

__all__ = ["write_robot"]

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
    near = [_find_near(robot, joint) for joint in robot.joints]
    convention, placed = _choose_rows(robot, near)
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines += [
        f"name = {write_value(_find_name(robot.name))}",
        *(f"{key} = {write_value(text)}" for key, text in _list_texts(robot)),
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
            lines += list_hints(joint)
    for coupling in robot.couplings:
        lines += ["", *_write_coupling(robot, coupling)]
    lines += _write_settings(robot)
    return "\n".join(lines) + "\n"


def _find_name(name: str) -> str:
    """Return a name that can name generated functions."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return plain if plain[:1].isalpha() else f"robot_{plain}"


def _list_texts(robot: Robot) -> Iterator[tuple[str, str]]:
    if robot.description:
        yield "description", robot.description
    if robot.source:
        yield "source", robot.source


def _find_near(robot: Robot, joint: Joint) -> Placement:
    """Return the joint's frame seen from the link frame that the file gives to its parent."""
    if joint.parent < 0 or robot.joints[joint.parent].frame == IDENTITY:
        return joint.placement
    return compose_placements(invert_placement(robot.joints[joint.parent].frame), joint.placement)


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
    if hints:
        yield from list_drive_hints(joint)
    yield from _write_friction("joint", joint.friction)
    yield from _write_springs(joint, prismatic=prismatic)
    yield from _write_limits(joint, prismatic=prismatic)
    if hints:
        yield from list_limit_hints(joint)


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
        elif not mass or find_impossibility(joint.inertial):
            yield from _write_standard(joint.inertial, joint.frame, symbols)
        else:
            yield from _write_body(joint.inertial, joint.frame, symbols)


def _write_standard(
    parameters: Sequence[float], frame: Placement, symbols: Mapping[str, float]
) -> Iterator[str]:
    """Yield the ten parameters about the origin of the frame that the file gives to the link."""
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    moved = move_parameters(parameters, rotation.T, -rotation.T @ origin)
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
    mass = parameters[9]
    com = np.array(parameters[6:9]) / mass
    central = move_parameters(parameters, np.eye(3), -com)[:6]
    rotation = np.array([[entry.to_float() for entry in row] for row in frame.rotation])
    origin = np.array([entry.to_float(symbols) for entry in frame.translation])
    turned = move_parameters((*central, 0.0, 0.0, 0.0, 0.0), rotation.T, np.zeros(3))[:6]
    inertia = _round(turned, max(abs(entry) for entry in parameters[:6]))
    place = _round(rotation.T @ (com - origin), float(np.abs(com).max()))
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
    if friction.values is not None:
        for name, value in zip(FRICTION_PARAMETERS[friction.kind], friction.values, strict=True):
            yield f"{name} = {write_number(value)}"
    for key, value in zip(FRICTION_SHAPES.get(friction.kind, ()), friction.shape, strict=True):
        yield f"{key.name} = {write_number(value)}"
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
        yield from write_elasticity(joint.elasticity, prismatic=prismatic)


def _write_limits(joint: Joint, *, prismatic: bool) -> Iterator[str]:
    limits = joint.limits
    unit = "m" if prismatic else "rad"
    lines = []
    if limits.position is not None:
        low, high = (write_number(value) for value in limits.position)
        lines.append(add_comment(f"position = [{low}, {high}]", unit))
    if limits.velocity is not None:
        lines.append(add_comment(f"velocity = {write_number(limits.velocity)}", f"{unit}/s"))
    if limits.acceleration is not None:
        lines.append(add_comment(f"acceleration = {write_number(limits.acceleration)}", f"{unit}/s^2"))
    if limits.jerk is not None:
        lines.append(add_comment(f"jerk = {write_number(limits.jerk)}", f"{unit}/s^3"))
    if limits.torque is not None:
        lines.append(add_comment(f"torque = {write_number(limits.torque)}", "N" if prismatic else "N m"))
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


def _write_settings(robot: Robot) -> Iterator[str]:
    yield from write_settings(robot)
    if robot.controller is not None:
        gains = list_controller(robot.controller).items()
        yield from ("", "[controller]", *(f"{key} = {write_value(entry)}" for key, entry in gains))
