"""What the motions of a robot show of the parameters of a block: rows over the parameters of its links.

Input: a block's transport and what is visible at the link before it. Output: rows over the standard
parameters of its links, its rotors and springs, and constant torques; a change of parameters that they all
send to zero is invisible.

With everything beyond a link put together into the link, the energy of the outermost blocks is

    E = sum over links l of  h_p(x) A_l(q) pi_l  +  dq' p_l(q, v_p)  +  dq' M_l(q) dq / 2,

where x is the state of the rest, v_p and h_p velocity and energy regressor of the link before the block,
A_l the change of parameters from link l to it, p_l and M_l the momenta of link l along the coordinates, all
linear in pi_l. Parameters are invisible if and only if the terms that depend on q or dq vanish for every
state, and what is left, h_p(x) A_l0 pi_l with the constant part A_l0, is made up for by the link before. So
each block has a small set of rows that act on the parameters of its links and all beyond them, carried to it
by the constant parts; the base parameters are all these rows together. This is the recursion over attainable
velocities and gravity directions of Wensing, Niemeyer and Slotine (2017), written for the energy and for
blocks of joints; every block is looked at once, exactly, in the field of the geometry.

Supported: trees; joints that follow others; rotors of joints and couplings; springs; constant torques.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sympy import QQ

from symid.algebra.elimination import Echelon, Row
from symid.notation import INERTIAL
from symid.parameters.blocks import Block
from symid.parameters.harmonics import Function, find_power
from symid.parameters.transport import Transport, apply
from symid.robot.description import Robot

__all__ = ["Visible", "find_columns", "find_visible", "find_visible_rows"]

Label = tuple[int, str]
_TEN = len(INERTIAL)
_SIX = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Visible:
    """What the motions up to a link show of parameters fixed to it.

    `steady` is the row of the constant function (a weight that never turns away), `varying` the span of
    all others, `velocities` the span of attainable (w, v); all in the link's frame.
    """

    steady: Row
    varying: tuple[Row, ...]
    velocities: tuple[Row, ...]


def find_columns(block: Block, robot: Robot, constants: Sequence[Label]) -> dict[Label, int]:
    """Return the column of each parameter of the block: links, rotors, springs, then constant torques."""
    labels = [(link, name) for link in block.joints for name in INERTIAL]
    drives = (*block.joints, *(robot.size + k for k in block.couplings))
    labels += [(index, "IA") for index in drives]
    labels += [(index, name) for index in block.joints for name in ("KS", "KR")]
    labels += [label for label in constants if label[0] in drives]
    return {label: column for column, label in enumerate(labels)}


def _add(target: dict[Function, Row], function: Function, row: Mapping[int, Any]) -> None:
    total = target.setdefault(function, {})
    for column, value in row.items():
        total[column] = total.get(column, 0) + value


def _find_own_rows(transport: Transport) -> list[dict[Function, Row]]:
    """Return the momentum along each coordinate that the coordinates' own velocities make."""
    return [
        {function: dict(matrix[_SIX]) for function, matrix in momenta.items() if matrix[_SIX]}
        for momenta in transport.momenta
    ]


def _find_crossed_rows(parent: Visible, transport: Transport) -> list[dict[Function, Row]]:
    """Return the momentum along each coordinate for each attainable velocity of the link before."""
    return [
        {function: row for function, matrix in momenta.items() if (row := apply(velocity, matrix[:_SIX]))}
        for momenta in transport.momenta
        for velocity in parent.velocities
    ]


def _carry(row: Row, transport: Transport) -> dict[Function, Row]:
    """Return h_p A_l for one row of h_p, all links of the block together, by functions."""
    result: dict[Function, Row] = {}
    for link, split in enumerate(transport.parameters):
        for function, matrix in split.items():
            moved = apply(row, matrix)
            _add(result, function, {_TEN * link + column: value for column, value in moved.items()})
    return result


def _find_drive_rows(
    robot: Robot,
    block: Block,
    transport: Transport,
    columns: Mapping[Label, int],
    constants: Mapping[Label, Any],
) -> tuple[dict[Function, Row], list[dict[Function, Row]]]:
    """Return what springs and constant torques add to the weight, rotors to the momenta."""
    convert = transport.basis.field.convert
    inside = {position: k for k, position in enumerate(block.coordinates)}
    weight: dict[Function, Row] = {}
    momenta: list[dict[Function, Row]] = [{} for _ in block.coordinates]
    for index in (*block.joints, *(robot.size + k for k in block.couplings)):
        shares = [
            (inside[position], convert(QQ(factor.numerator, factor.denominator)))
            for position, factor in robot.transmission[index]
        ]
        for c, left in shares:
            for k, right in shares:
                parts, rates = find_power(transport.basis)
                turning = tuple(int(position == k) for position in range(len(rates)))
                _add(momenta[c], (parts, turning), {columns[index, "IA"]: left * right})
            line, square = (find_power(transport.basis, c, e) for e in (1, 2))
            if index < robot.size:
                _add(weight, line, {columns[index, "KR"]: left})
                _add(weight, square, {columns[index, "KS"]: left * left})
            for label, torque in constants.items():
                if label[0] == index:
                    _add(weight, line, {columns[label]: left * convert(torque)})
    return weight, momenta


def _merge(*families: Mapping[Function, Row]) -> dict[Function, Row]:
    result: dict[Function, Row] = {}
    for family in families:
        for function, row in family.items():
            _add(result, function, row)
    return result


def find_visible_rows(
    robot: Robot,
    block: Block,
    parent: Visible,
    transport: Transport,
    *,
    constants: Mapping[Label, Any],
    form: str = "torque",
) -> Echelon:
    """Return the rows of a block over the parameters of `find_columns`.

    Args:
        robot: the robot.
        block: the block.
        parent: what is visible at the link before it.
        transport: across the block.
        constants: friction parameters that make a constant torque, with that torque.
        form: "torque", "gravity" without the rows of motion, "momentum" without those of weight.
    """
    columns = find_columns(block, robot, tuple(constants))
    springs, rotors = _find_drive_rows(robot, block, transport, columns, constants)
    motion: list[dict[Function, Row]] = []
    if form != "gravity":
        # The terms in dq^2 have the fewest entries: they come first and keep the rest short.
        motion += [_merge(a, b) for a, b in zip(_find_own_rows(transport), rotors, strict=True)]
        motion += _find_crossed_rows(parent, transport)
    weight = {} if form == "momentum" else _merge(_carry(parent.steady, transport), springs)
    echelon = Echelon()
    for family in motion:
        for function in sorted(family):
            echelon.insert(family[function])
    # What does not change with the block's coordinates, the link before makes as well.
    for family in (*(_carry(row, transport) for row in parent.varying), weight):
        for function in sorted(family):
            if function != transport.one:
                echelon.insert(family[function])
    return echelon


def find_visible(parent: Visible, transport: Transport, link: int, form: str = "torque") -> Visible:
    """Return what is visible at a link of the block (numbered within it), given what is before the block."""
    velocities, varying = Echelon(), Echelon()
    for matrix in transport.rates[link].values():
        velocities.insert(matrix[0])
    for row in parent.velocities:
        for matrix in transport.velocities[link].values():
            velocities.insert(apply(row, matrix))
    families = (
        (*_find_own_rows(transport), *_find_crossed_rows(parent, transport)) if form != "gravity" else ()
    )
    for family in families if form != "gravity" else ():
        for function in sorted(family):
            varying.insert(_restrict(family[function], link))
    parameters = transport.parameters[link]
    for row in parent.varying:
        for matrix in parameters.values():
            varying.insert(apply(row, matrix))
    for function, matrix in parameters.items():
        if function != transport.one:
            varying.insert(apply(parent.steady, matrix))
    steady = apply(parent.steady, parameters[transport.one]) if transport.one in parameters else {}
    return Visible(steady=steady, varying=varying.rows, velocities=velocities.rows)


def _restrict(row: Row, link: int) -> Row:
    """Return the entries of a block's row that belong to one of its links."""
    start = _TEN * link
    return {column - start: value for column, value in row.items() if start <= column < start + _TEN}
