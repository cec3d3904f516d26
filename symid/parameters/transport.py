"""How parameters, velocities and momenta of a block's links look from the link before the block.

Input: a block of joints. Output: matrices over a field, one for each function of the block's coordinates and
their velocities; the functions are independent, so that a sum of them vanishes for all states only if every
matrix does.

Supported: blocks of any size, revolute and prismatic joints, exact and symbolic placements.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.algebra.elimination import Row
from symid.algebra.exact import (
    ExactAlgebra,
    build_exact_algebra,
    build_exact_state,
    find_domain,
    find_symbols,
)
from symid.dynamics.composite import lift_body
from symid.dynamics.folding import fold_vector
from symid.dynamics.kinematics import Motion, Recursion, build_frames, find_motions
from symid.dynamics.regressors import find_momentum_columns
from symid.notation import INERTIAL
from symid.parameters.blocks import Block
from symid.parameters.harmonics import Basis, Function, build_basis, find_power, split_polynomial
from symid.robot.description import Joint, Robot

__all__ = ["Linear", "Transport", "apply", "build_block_robot", "find_field", "find_transport"]

Linear = tuple[Row, ...]
"""A matrix as sparse rows."""
Split = Mapping[Function, Linear]
_SIX = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport:
    """The change from the links of a block to the link before it, split by functions of the coordinates.

    Links are numbered within the block. `parameters[link][f]` takes the ten standard parameters of the link
    to those of the link before (10, 10); `velocities[link][f]` has what each unit velocity (w, v) of the link
    before becomes at the link (6, 6), in rows; `rates[link][f]` is the link's velocity by those of the
    coordinates, one row, f holds the velocity. `momenta[c][f]` has seven rows over the parameters of all
    links: the momentum along coordinate c for the six unit velocities of the link before, and for the
    velocities of the coordinates themselves. `one` is the constant function.
    """

    parameters: tuple[Split, ...]
    velocities: tuple[Split, ...]
    rates: tuple[Split, ...]
    momenta: tuple[Split, ...]
    basis: Basis

    @property
    def one(self) -> Function:
        """Return the constant function."""
        return find_power(self.basis)


def find_field(robot: Robot) -> Domain:
    """Return the field of the robot's geometry: rationals, roots, rational functions of lengths."""
    domain = find_domain(robot)
    names = find_symbols(robot)
    return domain.frac_field(*names) if names else domain


def build_block_robot(robot: Robot, block: Block) -> Robot:
    """Return the joints of a block as a robot of their own, fixed to what is before them."""
    inside = {index: position for position, index in enumerate(block.joints)}

    def move(joint: Joint) -> Joint:
        mimic = joint.mimic and replace(joint.mimic, master=inside[joint.mimic.master])
        return Joint(
            name=joint.name,
            kind=joint.kind,
            parent=inside.get(joint.parent, -1),
            placement=joint.placement,
            mimic=mimic,
        )

    joints = tuple(move(robot.joints[index]) for index in block.joints)
    return Robot(name=robot.name, joints=joints, gravity=robot.gravity)


def _split(basis: Basis, table: Sequence[Sequence[PolyElement]]) -> Split:
    """Return one matrix per function from a matrix of polynomials."""
    parts: dict[Function, list[Row]] = {}
    for row, entries in enumerate(table):
        for column, polynomial in enumerate(entries):
            for function, value in split_polynomial(basis, polynomial).items():
                matrix = parts.setdefault(function, [{} for _ in table])
                matrix[row][column] = value
    return {function: tuple(parts[function]) for function in sorted(parts)}


def _lift_parameters(
    single: Robot, algebra: ExactAlgebra, recursion: Recursion[PolyElement], link: int
) -> Iterator[tuple[PolyElement, ...]]:
    """Return, for each unit parameter of a link, the ten parameters seen from before the block."""
    for unit in range(len(INERTIAL)):
        p = [algebra.one if k == unit else algebra.zero for k in range(len(INERTIAL))]
        tensor = ((p[0], p[1], p[2]), (p[1], p[3], p[4]), (p[2], p[4], p[5]))
        body, joint = (tensor, (p[6], p[7], p[8]), p[9]), link
        while joint >= 0:
            body = lift_body(algebra, recursion.frames[joint], body)
            joint = single.joints[joint].parent
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body[0]
        yield (xx, xy, xz, yy, yz, zz, *body[1], body[2])


def _move_base(
    recursion: Recursion[PolyElement], unit: int
) -> tuple[Recursion[PolyElement], tuple[Motion[PolyElement], ...]]:
    """Return the block in motion with the link before it: unit velocity `unit` of (w, v), joints at rest."""
    algebra = recursion.algebra
    zero = algebra.zero
    e = [algebra.one if k == unit else zero for k in range(_SIX)]
    base = Motion(
        angular=(e[0], e[1], e[2]), linear=(e[3], e[4], e[5]), gravity=(zero, zero, zero), height=zero
    )
    rest = (zero,) * recursion.robot.size
    motions = find_motions(recursion.robot, algebra, recursion.frames, rest, base)
    return replace(recursion, motions=motions), motions


def find_transport(robot: Robot, block: Block, field: Domain) -> Transport:
    """Return the transport across the joints of `block` over `field`."""
    single = build_block_robot(robot, block)
    algebra = build_exact_algebra(single, find_domain(robot))
    state = build_exact_state(single, algebra)
    frames = build_frames(single, algebra, state)
    still = Motion(
        angular=(algebra.zero,) * 3,
        linear=(algebra.zero,) * 3,
        gravity=(algebra.zero,) * 3,
        height=algebra.zero,
    )
    motions = find_motions(single, algebra, frames, state.velocity, still)
    turning = Recursion(robot=single, algebra=algebra, state=state, frames=frames, motions=motions)
    carried = [_move_base(turning, unit) for unit in range(_SIX)]
    basis = build_basis(single, algebra, field)
    links = range(single.size)
    keys = [(link, name) for link in links for name in INERTIAL]

    def find_momenta(recursion: Recursion[PolyElement]) -> list[tuple[PolyElement, ...]]:
        columns = find_momentum_columns(recursion, keys)
        folded = [fold_vector(single, algebra, columns[key]) for key in keys]
        return list(zip(*folded, strict=True))

    momenta = [*(find_momenta(recursion) for recursion, _ in carried), find_momenta(turning)]
    velocities = [
        [(*motions[link].angular, *motions[link].linear) for _, motions in carried] for link in links
    ]
    return Transport(
        parameters=tuple(
            _split(basis, _transpose(list(_lift_parameters(single, algebra, turning, link))))
            for link in links
        ),
        velocities=tuple(_split(basis, velocities[link]) for link in links),
        rates=tuple(
            _split(basis, [(*turning.motions[link].angular, *turning.motions[link].linear)]) for link in links
        ),
        momenta=tuple(
            _split(basis, [row[coordinate] for row in momenta]) for coordinate in range(single.freedom)
        ),
        basis=basis,
    )


def _transpose(table: Sequence[Sequence[PolyElement]]) -> list[tuple[PolyElement, ...]]:
    return list(zip(*table, strict=True))


def apply(row: Row, matrix: Linear) -> Row:
    """Return the sparse row times the sparse matrix."""
    result: dict[int, Any] = {}
    for index, factor in row.items():
        for column, value in matrix[index].items():
            result[column] = result.get(column, 0) + factor * value
    return {column: value for column, value in result.items() if value}
