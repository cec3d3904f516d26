"""The rows of the base parameters: what all blocks of a robot show, over all of its parameters.

Input: a robot. Output: rows {label: coefficient}; a change of parameters that they all send to zero changes
no torque, and every other one does. `visibility` holds the argument.

Supported: trees, joints that follow others, coupled drives, springs, friction; the torque, or the part of it
that comes from gravity alone, or the momentum alone.
Not supported: symbolic lengths next to angles of 30 or 45 degrees where three joints share a coordinate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sympy import QQ
from sympy.polys.domains.domain import Domain

from symid.algebra.elimination import Row
from symid.algebra.exact import find_domain, find_number, find_symbols
from symid.dynamics.labels import Label
from symid.errors import Notice, RobotError
from symid.joint.friction_parts import find_constant_torques, find_friction_rows
from symid.notation import INERTIAL
from symid.parameters.blocks import Block, find_blocks
from symid.parameters.transport import Linear, Transport, apply, find_field, find_transport
from symid.parameters.visibility import Visible, find_columns, find_visible, find_visible_rows
from symid.robot.description import Robot

__all__ = ["Shown", "find_shown_rows"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What a robot shows: `rows` over labels, coefficients in `field`; per link what is visible there."""

    field: Domain
    rows: tuple[dict[Label, Any], ...]
    visible: tuple[Visible, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tree:
    """A robot in blocks: the blocks, the transport across each of them.

    `carried` has, per link, the links of the blocks on it, and the constant part of what they become there.
    """

    robot: Robot
    field: Domain
    blocks: tuple[Block, ...]
    transports: tuple[Transport, ...]
    carried: Mapping[int, Sequence[tuple[int, Linear]]]


_MOST_SHARING = 2


def _check_effort(robot: Robot, field: Domain) -> None:
    """Refuse what would not end: rational functions over roots, in a coordinate that three joints share.

    Raises:
        RobotError: naming the joints and the symbols.
    """
    if not field.is_FractionField or not field.field.domain.is_Algebraic:
        return
    masters = [row[0][0] for row in robot.transmission[: robot.size]]
    for position in range(robot.freedom):
        sharing = [joint.name for joint, own in zip(robot.joints, masters, strict=True) if own == position]
        if len(sharing) > _MOST_SHARING:
            text = (
                f"joints {', '.join(sharing)} move with one coordinate, angles are multiples of 30 or 45 "
                f"degrees, and lengths are symbols ({', '.join(find_symbols(robot))}): exact base parameters "
                "of all three together take too long; write the lengths as numbers"
            )
            raise RobotError(Notice(code="robot.too-symbolic", text=text, file=robot.path))


def _build_tree(robot: Robot) -> _Tree:
    field = find_field(robot)
    _check_effort(robot, field)
    blocks = find_blocks(robot)
    transports = tuple(find_transport(robot, block, field) for block in blocks)
    carried: dict[int, list[tuple[int, Linear]]] = {}
    for block, transport in zip(blocks, transports, strict=True):
        for link, split in zip(block.joints, transport.parameters, strict=True):
            if transport.one in split:
                carried.setdefault(block.base, []).append((link, split[transport.one]))
    return _Tree(robot=robot, field=field, blocks=blocks, transports=transports, carried=carried)


def _expand(tree: _Tree, link: int, row: Row) -> dict[Label, Any]:
    """Return a row on the composite of a link as a row on the parameters of all links beyond it."""
    result: dict[Label, Any] = {}
    pending = [(link, row)]
    while pending:
        current, part = pending.pop()
        result |= {(current, INERTIAL[column]): value for column, value in part.items()}
        for child, matrix in tree.carried.get(current, ()):
            if moved := apply(part, matrix):
                pending.append((child, moved))
    return result


def _expand_block(tree: _Tree, block: Block, labels: Sequence[Label], row: Row) -> dict[Label, Any]:
    """Return a row of a block over all parameters: its links with all beyond them, and its drives."""
    result: dict[Label, Any] = {}
    parts: dict[int, Row] = {}
    for column, value in row.items():
        index, name = labels[column]
        if name in INERTIAL:
            parts.setdefault(index, {})[INERTIAL.index(name)] = value
        else:
            result[labels[column]] = value
    for link in block.joints:
        if link in parts:
            result |= _expand(tree, link, parts[link])
    return result


def _find_weight(robot: Robot, field: Domain) -> Row:
    """Return the potential of the base's own parameters, -g' MS, as a row."""
    numbers = [find_number(value, find_domain(robot), field) for value in robot.gravity]
    return {INERTIAL.index("MX") + axis: -value for axis, value in enumerate(numbers) if value}


def find_shown_rows(robot: Robot, form: str) -> Shown:
    """Return the rows of all blocks over all parameters, and what is visible at each link.

    Args:
        robot: the robot.
        form: "torque" or "energy" for all, "gravity" for torques at rest, "momentum" for dT/ddq.

    Raises:
        RobotError: symbols, roots and followers together make exact arithmetic too slow.
    """
    tree = _build_tree(robot)
    field = tree.field
    weight = {} if form == "momentum" else _find_weight(robot, field)
    root = Visible(steady=weight, varying=(), velocities=())
    constants = {
        label: QQ(value.numerator, value.denominator) for label, value in find_constant_torques(robot).items()
    }
    visible: dict[int, Visible] = {-1: root}
    rows: list[dict[Label, Any]] = []
    for block, transport in zip(tree.blocks, tree.transports, strict=True):
        parent = visible[block.base]
        labels = tuple(find_columns(block, robot, tuple(constants)))
        echelon = find_visible_rows(robot, block, parent, transport, constants=constants, form=form)
        rows += [_expand_block(tree, block, labels, row) for row in echelon.rows]
        for position, link in enumerate(block.joints):
            visible[link] = find_visible(parent, transport, position, form)
    for shown in find_friction_rows(robot):
        rows.append({label: field.convert(QQ(v.numerator, v.denominator)) for label, v in shown.items()})
    links = tuple(visible[link] for link in range(robot.size))
    return Shown(field=field, rows=tuple(rows), visible=links)
