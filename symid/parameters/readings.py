"""Groups of others that may hold a term which they do not name.

Input: base parameters, groups of others. Output: `OpenReading`, one a term that could be there; whether it
is, values say.

A drive of speed w = sum of c_i dq_i brakes joint i by c_i P w, with P its viscous friction, or its inertia
with accelerations in place of speeds. Joint i itself has P_i dq_i. Of c_i P w the part c_i^2 P dq_i has the
column of P_i: who gives P the other part alone has P_i + c_i^2 P where P_i is written, and the same torques.

Supported: inertia and viscous friction of couplings, for which the algebra above speaks; besides, single
parameters of the same kind with factor one or minus one, for which nothing but values can speak.
Not supported: what is no line over the speed, as Coulomb friction of a coupling; its column cannot be split.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sympy import Expr, Integer, Rational

from symid.dynamics.labels import Label
from symid.parameters.base import BaseParameters
from symid.robot.description import Robot

__all__ = ["OpenReading", "find_coupled_readings", "find_kindred_readings"]

_LINEAR = ("IA", "Fv")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenReading:
    """A term that a group may hold without naming it: `factor` times our parameter number `column`.

    Args:
        group: number of the group. name: that of our parameter.
        coupling: the drive whose parameter it is, where the algebra speaks for it; else empty.
    """

    group: int
    column: int
    name: str
    factor: Expr
    coupling: str = ""


def find_coupled_readings(
    robot: Robot, base: BaseParameters, rows: Sequence[Sequence[Expr]]
) -> tuple[OpenReading, ...]:
    """Return the readings that coupled drives leave open: a group names the drive, the joint's own does not.

    Factor in a group: what it holds of P_i times c_i^2, summed over the joints of the coupling.

    Args:
        robot: its drives.
        base: our parameters.
        rows: what each group holds of ours.
    """
    ours = (*base.parameters, *base.friction)
    columns = _list_columns(base)
    readings = []
    for number, coupling in enumerate(robot.couplings):
        for kind in _LINEAR:
            drive = (robot.size + number, kind)
            # A parameter that shows only together with others has no column of its own.
            if drive not in columns or not any(row[columns[drive][0]] for row in rows):
                continue
            column, name = columns[drive]
            squares = {
                (joint, kind): Rational(c.numerator, c.denominator) ** 2 for joint, c in coupling.terms
            }
            shares = [
                sum((squares[label] * value for label, value in entry.terms if label in squares), Integer(0))
                for entry in ours
            ]
            for place, row in enumerate(rows):
                factor = sum((a * b for a, b in zip(row, shares, strict=True) if a and b), Integer(0))
                if factor and not row[column]:
                    readings.append(
                        OpenReading(
                            group=place, column=column, name=name, factor=factor, coupling=coupling.name
                        )
                    )
    return tuple(readings)


def find_kindred_readings(
    base: BaseParameters, rows: Sequence[Sequence[Expr]], numbers: Sequence[int]
) -> tuple[OpenReading, ...]:
    """Return every parameter of the same kind, added and taken away, for some groups.

    Args:
        base: our parameters.
        rows: what each group holds of ours.
        numbers: the groups to look at.
    """
    ours = (*base.parameters, *base.friction)
    columns = _list_columns(base)
    kinds = {
        number: {entry.label[1] for entry, share in zip(ours, rows[number], strict=True) if share}
        for number in numbers
    }
    return tuple(
        OpenReading(group=number, column=column, name=name, factor=Integer(sign))
        for number in numbers
        for label, (column, name) in columns.items()
        if label[1] in kinds[number] and not rows[number][column]
        for sign in (1, -1)
    )


def _list_columns(base: BaseParameters) -> dict[Label, tuple[int, str]]:
    """Return number and name of every parameter of ours that stands for itself alone."""
    ours = (*base.parameters, *base.friction)
    return {entry.label: (k, entry.name) for k, entry in enumerate(ours) if len(entry.terms) == 1}
