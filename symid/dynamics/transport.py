"""How parameters, velocities and weights of a link look from its parent, as functions of one joint.

Input: a joint. Output: matrices over a field, one for each function 1, c, s, c^2, s c (or 1, q, q^2)
of the joint's coordinate; the functions are independent, so that a sum of them vanishes for all
coordinates only if every matrix does.

Supported: revolute and prismatic joints, exact and symbolic placements.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.algebra.elimination import Row
from symid.algebra.exact import (
    ExactAlgebra,
    build_exact_algebra,
    build_exact_state,
    find_domain,
    find_generators,
    find_symbols,
)
from symid.algebra.vectors import add, cross
from symid.dynamics.composite import lift_body
from symid.dynamics.kinematics import build_frames, lower_vector
from symid.notation import INERTIAL
from symid.robot.description import Joint, Robot

__all__ = ["Transport", "apply", "find_field", "find_transport"]

Linear = tuple[Row, ...]
"""A matrix as sparse rows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport:
    """The change from a link to its parent, split by functions of the joint's coordinate.

    `parameters[k]` takes the ten standard parameters of the link to those of the parent (10, 10);
    `velocities[k]` takes a velocity (w, v) of the parent to the link (6, 6). Index 0 belongs to
    the function 1.
    """

    parameters: tuple[Linear, ...]
    velocities: tuple[Linear, ...]


def find_field(robot: Robot) -> Domain:
    """Return the field of the robot's geometry: rationals, roots, rational functions of lengths."""
    domain = find_domain(robot)
    names = find_symbols(robot)
    return domain.frac_field(*names) if names else domain


def _split(
    algebra: ExactAlgebra, field: Domain, columns: Sequence[Sequence[PolyElement]]
) -> tuple[Linear, ...]:
    """Return one matrix per function of the coordinate from columns of polynomials."""
    ring = algebra.ring
    names = [str(symbol) for symbol in ring.symbols]
    coordinates = [k for k, name in enumerate(names) if name in ("s1", "c1", "q1")]
    symbols = [k for k in range(len(names)) if k not in coordinates]
    generators = find_generators(field)
    parts: dict[tuple[int, ...], list[Row]] = {tuple(0 for _ in coordinates): [{} for _ in columns[0]]}
    for column, entries in enumerate(columns):
        for row, polynomial in enumerate(entries):
            for monomial, coefficient in polynomial.items():
                key = tuple(monomial[k] for k in coordinates)
                value = field.convert_from(coefficient, ring.domain)
                for k in symbols:
                    if monomial[k]:
                        value *= generators[names[k]] ** monomial[k]
                matrix = parts.setdefault(key, [{} for _ in columns[0]])
                matrix[row][column] = matrix[row].get(column, field.zero) + value
    first = tuple(0 for _ in coordinates)
    ordered = [parts.pop(first)] + [parts[key] for key in sorted(parts)]
    return tuple(tuple(matrix) for matrix in ordered)


def find_transport(robot: Robot, joint: Joint, field: Domain) -> Transport:
    """Return the transport across `joint` over `field`."""
    single = Robot(
        name=robot.name,
        joints=(Joint(name=joint.name, kind=joint.kind, parent=-1, placement=joint.placement),),
        gravity=robot.gravity,
    )
    algebra = build_exact_algebra(single, find_domain(robot))
    frame = build_frames(single, algebra, build_exact_state(single, algebra))[0]
    zero, one = algebra.zero, algebra.one
    parameters = []
    for unit in range(len(INERTIAL)):
        p = [one if k == unit else zero for k in range(len(INERTIAL))]
        body = (((p[0], p[1], p[2]), (p[1], p[3], p[4]), (p[2], p[4], p[5])), (p[6], p[7], p[8]), p[9])
        tensor, moments, mass = lift_body(algebra, frame, body)
        entries = (tensor[0][0], tensor[0][1], tensor[0][2], tensor[1][1], tensor[1][2], tensor[2][2])
        parameters.append((*entries, *moments, mass))
    velocities = []
    for unit in range(6):
        e = [one if k == unit else zero for k in range(6)]
        angular, linear = (e[0], e[1], e[2]), (e[3], e[4], e[5])
        carried = add(algebra, linear, cross(algebra, angular, frame.origin))
        velocities.append((*lower_vector(algebra, frame, angular), *lower_vector(algebra, frame, carried)))
    return Transport(
        parameters=_split(algebra, field, parameters), velocities=_split(algebra, field, velocities)
    )


def apply(row: Row, matrix: Linear) -> Row:
    """Return the sparse row times the sparse matrix."""
    result: dict[int, Any] = {}
    for index, factor in row.items():
        for column, value in matrix[index].items():
            result[column] = result.get(column, 0) + factor * value
    return {column: value for column, value in result.items() if value}
