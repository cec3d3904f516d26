"""What the motions of a robot show of the parameters of one link: the rows of its joint.

Input: a joint's transport and what is visible at its parent. Output: rows over the ten standard parameters,
the rotor inertia and the offset of the joint; a parameter change that they all send to zero is invisible.

The energy of the outermost link i is E_i = h_p(x) A(q_i) pi_i + dq_i z'I(pi_i) X(q_i) v_p
+ dq_i^2 z'I(pi_i) z / 2, where x is the state of the rest, v_p the parent's velocity, A and X the change
of parameters and velocities across the joint. Parameters are invisible if and only if the terms that
depend on q_i or dq_i vanish for all states, and what is left, h_p(x) A_0 pi_i, is made up for by the
parent. So each joint has a small set of rows Q_i that act on the parameters of its link and all beyond it,
carried to it by the constant parts A_0; the base parameters are all these rows together. This is the
recursion over attainable velocities and gravity directions of Wensing, Niemeyer and Slotine (2017), written
for the energy; it is linear in the number of links and exact in the field of the geometry.

Supported: trees; rotor inertias; offsets that coincide with a weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from symid.algebra.elimination import Echelon, Row
from symid.dynamics.transport import Transport, apply
from symid.notation import INERTIAL
from symid.robot.description import JointKind

__all__ = ["OFFSET", "ROTOR", "Visible", "find_visible", "find_visible_rows"]

ROTOR, OFFSET = 10, 11
"""Columns of IA and of a constant force, behind the ten standard parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Visible:
    """What the motions up to a link show of parameters fixed to it.

    `steady` is the row of the constant function (a weight that never turns away), `varying` the span of
    all others, `velocities` the span of attainable (w, v); all in the link's frame.
    """

    steady: Row
    varying: tuple[Row, ...]
    velocities: tuple[Row, ...]


_MOMENTUM = {
    # (w, v) -> coefficients over INERTIAL of the momentum along z: L_z and p_z.
    "revolute": ({0: {2: 1}, 1: {4: 1}, 2: {5: 1}, 3: {7: -1}, 4: {6: 1}}),
    "prismatic": ({0: {7: 1}, 1: {6: -1}, 5: {9: 1}}),
}


def _momentum_row(kind: JointKind, velocity: Row) -> Row:
    """Return the momentum along the joint's axis, per parameter, of a link that moves with `velocity`."""
    result: Row = {}
    for index, value in velocity.items():
        for column, sign in _MOMENTUM[kind.value].get(index, {}).items():
            result[column] = result.get(column, 0) + sign * value
    return result


def find_visible_rows(
    kind: JointKind,
    parent: Visible,
    transport: Transport,
    one: Any,  # noqa: ANN401  an element of a SymPy field has no type of its own
    *,
    rotor: bool,
) -> Echelon:
    """Return the rows Q_i over (ten parameters, IA, offset)."""
    echelon = Echelon()
    own = {INERTIAL.index("ZZ" if kind is JointKind.REVOLUTE else "M"): one}
    echelon.insert({**own, ROTOR: one} if rotor else own)
    for row in parent.velocities:
        for matrix in transport.velocities:
            moved = apply(row, _transpose(matrix))
            echelon.insert(_momentum_row(kind, moved))
    for number, matrix in enumerate(transport.parameters[1:], start=1):
        for row in parent.varying:
            echelon.insert(apply(row, matrix))
        weight = apply(parent.steady, matrix)
        # A weight that grows in proportion to q is felt as a constant force, as an offset is.
        if number == 1 and kind is JointKind.PRISMATIC:
            echelon.insert({**weight, OFFSET: one})
        else:
            echelon.insert(weight)
    if kind is JointKind.REVOLUTE:
        echelon.insert({OFFSET: one})
    return echelon


def _transpose(matrix: Sequence[Row]) -> tuple[Row, ...]:
    columns: list[Row] = [{} for _ in matrix]
    for index, row in enumerate(matrix):
        for column, value in row.items():
            columns[column][index] = value
    return tuple(columns)


def find_visible(kind: JointKind, parent: Visible, transport: Transport, one: Any) -> Visible:  # noqa: ANN401  field element
    """Return what is visible at a link, given its parent and its joint."""
    velocities = Echelon()
    velocities.insert({2 if kind is JointKind.REVOLUTE else 5: one})
    for row in parent.velocities:
        for matrix in transport.velocities:
            velocities.insert(apply(row, _transpose(matrix)))
    varying = Echelon()
    for row in find_visible_rows(kind, parent, transport, one, rotor=False).rows:
        varying.insert({column: value for column, value in row.items() if column < len(INERTIAL)})
    for row in parent.varying:
        varying.insert(apply(row, transport.parameters[0]))
    return Visible(
        steady=apply(parent.steady, transport.parameters[0]), varying=varying.rows, velocities=velocities.rows
    )
