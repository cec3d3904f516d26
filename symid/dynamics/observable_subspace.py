"""What the motions of a robot show of its parameters: exact rows, block by block.

Robot -> rows {label: coefficient}; a change of parameters that they all send to zero changes no torque, and
every other one does.

A joint on its own is a block. A joint that follows another one, and all joints between the two, are one
block; so are the joints that a coupled drive turns with. What a block shows of parameters does not depend
on how the blocks before and behind it move. With everything beyond a link put together into the link, the
energy of the outermost blocks is

    E = sum over links l of  h_p(x) A_l(q) pi_l  +  dq' p_l(q, v_p)  +  dq' M_l(q) dq / 2,

where x is the state of the rest, v_p and h_p velocity and energy regressor of the link before the block,
A_l the change of parameters from link l to it, p_l and M_l the momenta of link l along the coordinates, all
linear in pi_l. Parameters are invisible if and only if the terms that depend on q or dq vanish for every
state, and what is left, h_p(x) A_l0 pi_l with the constant part A_l0, is made up for by the link before. So
each block has a small set of rows that act on the parameters of its links and all beyond them, carried to
it by the constant parts; the base parameters are all these rows together. This is the recursion over
attainable velocities and gravity directions of Wensing, Niemeyer and Slotine (2017), written for the energy
and for blocks of joints; every block is looked at once, exactly, in the field of the geometry.

Supported: trees; joints that follow others; rotors of joints and couplings; springs; friction and its
constant torques; the torque, or the part of it that comes from gravity alone, or the momentum alone.
Not supported: symbolic lengths next to angles of 30 or 45 degrees where three joints share a coordinate.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sympy import QQ
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.dynamics.algebra import Label, build_state
from symid.dynamics.bodies import transform_body
from symid.dynamics.exact_algebra import (
    Echelon,
    ExactAlgebra,
    Row,
    build_exact_algebra,
    choose_domain,
    convert_number,
    list_symbols,
)
from symid.dynamics.recursion import LinkMotion, Recursion, build_frames, compute_motions, fold_vector
from symid.dynamics.regressors import compute_momentum_columns
from symid.dynamics.trigonometric_basis import (
    BasisFunction,
    TrigonometricBasis,
    build_basis,
    build_power_function,
    split_polynomial,
)
from symid.errors import Notice, RobotError
from symid.joint_models import build_friction_rows, compute_constant_torques
from symid.notation import INERTIAL
from symid.robot import Joint, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Joints (indices, ascending), the link before all of them (-1 is the base), and their coordinates.

    `coordinates` are positions among the coordinates of the robot, `couplings` indices of its couplings.
    """

    base: int
    joints: tuple[int, ...]
    coordinates: tuple[int, ...]
    couplings: tuple[int, ...]


def _list_path(robot: Robot, joint: int) -> list[int]:
    """Return the joints from the base to `joint`, itself included."""
    path = []
    while joint >= 0:
        path.append(joint)
        joint = robot.joints[joint].parent
    return path[::-1]


def _list_connected_joints(robot: Robot, joints: frozenset[int]) -> frozenset[int]:
    """Return the joints of the smallest connected piece of the tree that holds `joints`."""
    paths = [_list_path(robot, joint) for joint in sorted(joints)]
    shortest = min(len(path) for path in paths)
    shared = 0
    # The link before the block carries all of them, and is none of them.
    while shared < shortest - 1 and all(path[shared] == paths[0][shared] for path in paths):
        shared += 1
    return frozenset(joint for path in paths for joint in path[shared:])


def _list_ties(robot: Robot) -> Iterator[frozenset[int]]:
    """Return the sets of joints that belong together, single ones first."""
    for index, joint in enumerate(robot.joints):
        yield frozenset((index,) if joint.mimic is None else (index, joint.mimic.master))
    for coupling in robot.couplings:
        yield frozenset(index for index, _ in coupling.terms)


def _merge_groups(robot: Robot, groups: list[frozenset[int]]) -> list[frozenset[int]]:
    merged: list[frozenset[int]] = []
    for group in groups:
        whole = _list_connected_joints(robot, group)
        apart = [other for other in merged if not other & whole]
        for other in merged:
            whole = whole | other if other & whole else whole
        merged = [*apart, whole]
    return merged


def split_into_blocks(robot: Robot) -> tuple[Block, ...]:
    """Return the blocks of the robot; the block of a link stands before those that hang on it."""
    groups = _merge_groups(robot, list(_list_ties(robot)))
    while len(again := _merge_groups(robot, groups)) < len(groups):
        groups = again
    transmission = robot.transmission
    blocks = []
    for group in sorted(map(sorted, again)):
        coordinates = {position for index in group for position, _ in transmission[index]}
        couplings = [
            k for k, coupling in enumerate(robot.couplings) if {i for i, _ in coupling.terms} & set(group)
        ]
        blocks.append(
            Block(
                base=robot.joints[group[0]].parent,
                joints=tuple(group),
                coordinates=tuple(sorted(coordinates)),
                couplings=tuple(couplings),
            )
        )
    return tuple(blocks)


SparseMatrix = tuple[Row, ...]
"""A matrix as sparse rows."""
Split = Mapping[BasisFunction, SparseMatrix]
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
    basis: TrigonometricBasis

    @property
    def one(self) -> BasisFunction:
        """Return the constant function."""
        return build_power_function(self.basis)


def build_field(robot: Robot) -> Domain:
    """Return the field of the robot's geometry: rationals, roots, rational functions of lengths."""
    domain = choose_domain(robot)
    names = list_symbols(robot)
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


def _split(basis: TrigonometricBasis, table: Sequence[Sequence[PolyElement]]) -> Split:
    """Return one matrix per function from a matrix of polynomials."""
    parts: dict[BasisFunction, list[Row]] = {}
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
            body = transform_body(algebra, recursion.frames[joint], body)
            joint = single.joints[joint].parent
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body[0]
        yield (xx, xy, xz, yy, yz, zz, *body[1], body[2])


def _move_base(
    recursion: Recursion[PolyElement], unit: int
) -> tuple[Recursion[PolyElement], tuple[LinkMotion[PolyElement], ...]]:
    """Return the block in motion with the link before it: unit velocity `unit` of (w, v), joints at rest."""
    algebra = recursion.algebra
    zero = algebra.zero
    e = [algebra.one if k == unit else zero for k in range(_SIX)]
    base = LinkMotion(
        angular=(e[0], e[1], e[2]), linear=(e[3], e[4], e[5]), gravity=(zero, zero, zero), height=zero
    )
    rest = (zero,) * recursion.robot.size
    motions = compute_motions(recursion.robot, algebra, recursion.frames, rest, base)
    return replace(recursion, motions=motions), motions


def derive_transport(robot: Robot, block: Block, field: Domain) -> Transport:
    """Return the transport across the joints of `block` over `field`."""
    single = build_block_robot(robot, block)
    algebra = build_exact_algebra(single, choose_domain(robot))
    state = build_state(single, algebra, algebra.generators)
    frames = build_frames(single, algebra, state)
    still = LinkMotion(
        angular=(algebra.zero,) * 3,
        linear=(algebra.zero,) * 3,
        gravity=(algebra.zero,) * 3,
        height=algebra.zero,
    )
    motions = compute_motions(single, algebra, frames, state.velocity, still)
    turning = Recursion(robot=single, algebra=algebra, state=state, frames=frames, motions=motions)
    carried = [_move_base(turning, unit) for unit in range(_SIX)]
    basis = build_basis(single, algebra, field)
    links = range(single.size)
    keys = [(link, name) for link in links for name in INERTIAL]

    def find_momenta(recursion: Recursion[PolyElement]) -> list[tuple[PolyElement, ...]]:
        columns = compute_momentum_columns(recursion, keys)
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


def multiply_row(row: Row, matrix: SparseMatrix) -> Row:
    """Return the sparse row times the sparse matrix."""
    result: dict[int, Any] = {}
    for index, factor in row.items():
        for column, value in matrix[index].items():
            result[column] = result.get(column, 0) + factor * value
    return {column: value for column, value in result.items() if value}


_TEN = len(INERTIAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservableRows:
    """What the motions up to a link show of parameters fixed to it.

    `steady` is the row of the constant function (a weight that never turns away), `varying` the span of
    all others, `velocities` the span of attainable (w, v); all in the link's frame.
    """

    steady: Row
    varying: tuple[Row, ...]
    velocities: tuple[Row, ...]


def number_columns(block: Block, robot: Robot, constants: Sequence[Label]) -> dict[Label, int]:
    """Return the column of each parameter of the block: links, rotors, springs, then constant torques."""
    labels = [(link, name) for link in block.joints for name in INERTIAL]
    drives = (*block.joints, *(robot.size + k for k in block.couplings))
    labels += [(index, "IA") for index in drives]
    labels += [(index, name) for index in block.joints for name in ("KS", "KR")]
    labels += [label for label in constants if label[0] in drives]
    return {label: column for column, label in enumerate(labels)}


def _add_row(target: dict[BasisFunction, Row], function: BasisFunction, row: Mapping[int, Any]) -> None:
    total = target.setdefault(function, {})
    for column, value in row.items():
        total[column] = total.get(column, 0) + value


def _list_own_momenta(transport: Transport) -> list[dict[BasisFunction, Row]]:
    """Return the momentum along each coordinate that the coordinates' own velocities make."""
    return [
        {function: dict(matrix[_SIX]) for function, matrix in momenta.items() if matrix[_SIX]}
        for momenta in transport.momenta
    ]


def _list_crossed_momenta(parent: ObservableRows, transport: Transport) -> list[dict[BasisFunction, Row]]:
    """Return the momentum along each coordinate for each attainable velocity of the link before."""
    return [
        {
            function: row
            for function, matrix in momenta.items()
            if (row := multiply_row(velocity, matrix[:_SIX]))
        }
        for momenta in transport.momenta
        for velocity in parent.velocities
    ]


def _carry(row: Row, transport: Transport) -> dict[BasisFunction, Row]:
    """Return h_p A_l for one row of h_p, all links of the block together, by functions."""
    result: dict[BasisFunction, Row] = {}
    for link, split in enumerate(transport.parameters):
        for function, matrix in split.items():
            moved = multiply_row(row, matrix)
            _add_row(result, function, {_TEN * link + column: value for column, value in moved.items()})
    return result


def _build_drive_rows(
    robot: Robot,
    block: Block,
    transport: Transport,
    columns: Mapping[Label, int],
    constants: Mapping[Label, Any],
) -> tuple[dict[BasisFunction, Row], list[dict[BasisFunction, Row]]]:
    """Return what springs and constant torques add to the weight, rotors to the momenta."""
    convert = transport.basis.field.convert
    inside = {position: k for k, position in enumerate(block.coordinates)}
    weight: dict[BasisFunction, Row] = {}
    momenta: list[dict[BasisFunction, Row]] = [{} for _ in block.coordinates]
    for index in (*block.joints, *(robot.size + k for k in block.couplings)):
        shares = [
            (inside[position], convert(QQ(factor.numerator, factor.denominator)))
            for position, factor in robot.transmission[index]
        ]
        for c, left in shares:
            for k, right in shares:
                parts, rates = build_power_function(transport.basis)
                turning = tuple(int(position == k) for position in range(len(rates)))
                _add_row(momenta[c], (parts, turning), {columns[index, "IA"]: left * right})
            line, square = (build_power_function(transport.basis, c, e) for e in (1, 2))
            if index < robot.size:
                _add_row(weight, line, {columns[index, "KR"]: left})
                _add_row(weight, square, {columns[index, "KS"]: left * left})
            for label, torque in constants.items():
                if label[0] == index:
                    _add_row(weight, line, {columns[label]: left * convert(torque)})
    return weight, momenta


def _merge_families(*families: Mapping[BasisFunction, Row]) -> dict[BasisFunction, Row]:
    result: dict[BasisFunction, Row] = {}
    for family in families:
        for function, row in family.items():
            _add_row(result, function, row)
    return result


def derive_block_rows(
    robot: Robot,
    block: Block,
    parent: ObservableRows,
    transport: Transport,
    *,
    constants: Mapping[Label, Any],
    form: str = "torque",
) -> Echelon:
    """Return the rows of a block over the parameters of `number_columns`.

    Args:
        robot: the robot.
        block: the block.
        parent: what is visible at the link before it.
        transport: across the block.
        constants: friction parameters that make a constant torque, with that torque.
        form: "torque", "gravity" without the rows of motion, "momentum" without those of weight.
    """
    columns = number_columns(block, robot, tuple(constants))
    springs, rotors = _build_drive_rows(robot, block, transport, columns, constants)
    motion: list[dict[BasisFunction, Row]] = []
    if form != "gravity":
        # The terms in dq^2 have the fewest entries: they come first and keep the rest short.
        motion += [_merge_families(a, b) for a, b in zip(_list_own_momenta(transport), rotors, strict=True)]
        motion += _list_crossed_momenta(parent, transport)
    weight = {} if form == "momentum" else _merge_families(_carry(parent.steady, transport), springs)
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


def derive_link_rows(
    parent: ObservableRows, transport: Transport, link: int, form: str = "torque"
) -> ObservableRows:
    """Return what is visible at a link of the block (numbered within it), given what is before the block."""
    velocities, varying = Echelon(), Echelon()
    for matrix in transport.rates[link].values():
        velocities.insert(matrix[0])
    for row in parent.velocities:
        for matrix in transport.velocities[link].values():
            velocities.insert(multiply_row(row, matrix))
    if form != "gravity":
        for family in (*_list_own_momenta(transport), *_list_crossed_momenta(parent, transport)):
            for function in sorted(family):
                varying.insert(_restrict(family[function], link))
    parameters = transport.parameters[link]
    for row in parent.varying:
        for matrix in parameters.values():
            varying.insert(multiply_row(row, matrix))
    for function, matrix in parameters.items():
        if function != transport.one:
            varying.insert(multiply_row(parent.steady, matrix))
    steady = multiply_row(parent.steady, parameters[transport.one]) if transport.one in parameters else {}
    return ObservableRows(steady=steady, varying=varying.rows, velocities=velocities.rows)


def _restrict(row: Row, link: int) -> Row:
    """Return the entries of a block's row that belong to one of its links."""
    start = _TEN * link
    return {column - start: value for column, value in row.items() if start <= column < start + _TEN}


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservableSubspace:
    """What a robot shows: `rows` over labels, coefficients in `field`; per link what is visible there."""

    field: Domain
    rows: tuple[dict[Label, Any], ...]
    visible: tuple[ObservableRows, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tree:
    """A robot in blocks: the blocks, the transport across each of them.

    `carried` has, per link, the links of the blocks on it, and the constant part of what they become there.
    """

    robot: Robot
    field: Domain
    blocks: tuple[Block, ...]
    transports: tuple[Transport, ...]
    carried: Mapping[int, Sequence[tuple[int, SparseMatrix]]]


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
                f"degrees, and lengths are symbols ({', '.join(list_symbols(robot))}): exact base parameters "
                "of all three together take too long; write the lengths as numbers"
            )
            raise RobotError(Notice(code="robot.too-symbolic", text=text, file=robot.path))


def _build_tree(robot: Robot) -> _Tree:
    field = build_field(robot)
    _check_effort(robot, field)
    blocks = split_into_blocks(robot)
    transports = tuple(derive_transport(robot, block, field) for block in blocks)
    carried: dict[int, list[tuple[int, SparseMatrix]]] = {}
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
            if moved := multiply_row(part, matrix):
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


def _build_gravity_row(robot: Robot, field: Domain) -> Row:
    """Return the potential of the base's own parameters, -g' MS, as a row."""
    numbers = [convert_number(value, choose_domain(robot), field) for value in robot.gravity]
    return {INERTIAL.index("MX") + axis: -value for axis, value in enumerate(numbers) if value}


def derive_observable_subspace(robot: Robot, form: str) -> ObservableSubspace:
    """Return the rows of all blocks over all parameters, and what is visible at each link.

    Args:
        robot: the robot.
        form: "torque" or "energy" for all, "gravity" for torques at rest, "momentum" for dT/ddq.

    Raises:
        RobotError: symbols, roots and followers together make exact arithmetic too slow.
    """
    tree = _build_tree(robot)
    field = tree.field
    weight = {} if form == "momentum" else _build_gravity_row(robot, field)
    root = ObservableRows(steady=weight, varying=(), velocities=())
    constants = {
        label: QQ(value.numerator, value.denominator)
        for label, value in compute_constant_torques(robot).items()
    }
    visible: dict[int, ObservableRows] = {-1: root}
    rows: list[dict[Label, Any]] = []
    for block, transport in zip(tree.blocks, tree.transports, strict=True):
        parent = visible[block.base]
        labels = tuple(number_columns(block, robot, tuple(constants)))
        echelon = derive_block_rows(robot, block, parent, transport, constants=constants, form=form)
        rows += [_expand_block(tree, block, labels, row) for row in echelon.rows]
        for position, link in enumerate(block.joints):
            visible[link] = derive_link_rows(parent, transport, position, form)
    for shown in build_friction_rows(robot):
        rows.append({label: field.convert(QQ(v.numerator, v.denominator)) for label, v in shown.items()})
    links = tuple(visible[link] for link in range(robot.size))
    return ObservableSubspace(field=field, rows=tuple(rows), visible=links)
