"""The observable subspace of a robot's parameters: exact rows, block by block.

Robot -> rows {label: coefficient}; a change of parameters that they all send to zero changes no torque, and
every other one does. A block is a joint, or joints that move together (followers, coupled drives) and those
between. With everything beyond a link put together into the link, the energy of the outermost blocks is

    E = sum over links l of  h_p(x) A_l(q) pi_l  +  dq' p_l(q, v_p)  +  dq' M_l(q) dq / 2,

h_p and v_p of the link before the block, A_l from link l to it. The terms in q and dq give each block a small
set of rows over its links and all beyond; the constant part h_p A_l0 pi_l belongs to the link before
(Wensing, Niemeyer and Slotine 2017, here for the energy and for blocks of joints).

Supported: trees; followers; rotors of joints and couplings; springs; friction, torques of positions too; the
torque, or the part of it that comes from gravity alone, or the momentum alone.
Not supported: symbolic lengths next to angles of 30 or 45 degrees where three joints share a coordinate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

from sympy import QQ
from sympy.polys.domains.domain import Domain
from sympy.polys.rings import PolyElement

from symid.dynamics import exact_algebra
from symid.dynamics.algebra import Label, build_state
from symid.dynamics.bodies import build_unit_body, list_entries, transform_body
from symid.dynamics.exact_algebra import BasisFunction, Number, Row, TrigonometricBasis, build_power_function
from symid.dynamics.friction_effects import PositionTorque, build_friction_rows, compute_position_torques
from symid.dynamics.recursion import LinkMotion, Recursion, build_frames, compute_motions, fold_vector
from symid.dynamics.regressors import compute_momentum_columns
from symid.errors import Notice, RobotError
from symid.notation import INERTIAL
from symid.robot import Joint, Robot

SparseMatrix = tuple[Row, ...]
Split = Mapping[BasisFunction, SparseMatrix]
_SIX = 6
_TEN = len(INERTIAL)
_OWN: Row = {_SIX: 1}
"""The velocities of the block's coordinates, in place of one of the link before."""
Family = dict[BasisFunction, Row]
"""Rows by the function of the coordinates that they belong to."""
Carried = Mapping[int, Sequence[tuple[int, SparseMatrix]]]
"""Per link, the links of the blocks on it, and the constant part of what they become there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Joints (indices, ascending), the link before all of them (-1 is the base), and their coordinates.

    `coordinates` are positions among the coordinates of the robot, `couplings` indices of its couplings.
    """

    base: int
    joints: tuple[int, ...]
    coordinates: tuple[int, ...]
    couplings: tuple[int, ...]


def split_into_blocks(robot: Robot) -> tuple[Block, ...]:
    """Return the blocks of the robot; the block of a link comes before those it carries."""
    paths: list[list[int]] = []
    for index, joint in enumerate(robot.joints):
        paths.append([*(paths[joint.parent] if joint.parent >= 0 else ()), index])
    # Joints that belong together, single ones first.
    ties = [
        frozenset((index,) if joint.mimic is None else (index, joint.mimic.master))
        for index, joint in enumerate(robot.joints)
    ]
    ties += [frozenset(index for index, _ in coupling.terms) for coupling in robot.couplings]
    groups, merged = ties, list[frozenset[int]]()
    while len(merged) != len(groups):
        groups, merged = merged or ties, []
        for joints in groups:
            # The smallest connected piece of the tree; the link before, which carries all, is none of it.
            ways = [paths[joint] for joint in joints]
            shared = next((k for k, level in enumerate(zip(*ways, strict=False)) if len({*level}) > 1), None)
            start = min(map(len, ways)) - 1 if shared is None else shared
            whole = frozenset(joint for way in ways for joint in way[start:])
            touching = [other for other in merged if other & whole]
            merged = [*(other for other in merged if not other & whole), whole.union(*touching)]
    blocks = []
    for group in sorted(map(sorted, merged)):
        base, coordinates = robot.joints[group[0]].parent, {robot.transmission[k][0][0] for k in group}
        turned = [{index for index, _ in coupling.terms} & set(group) for coupling in robot.couplings]
        couplings = tuple(k for k, joints in enumerate(turned) if joints)
        places = tuple(sorted(coordinates))
        blocks.append(Block(base=base, joints=tuple(group), coordinates=places, couplings=couplings))
    return tuple(blocks)


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport:
    """The change from the links of a block to the link before it, split by functions f of the coordinates.

    Args:
        parameters: per link of the block, (10, 10) from its parameters to those of the link before.
        velocities: per link, (6, 6) its velocity per unit velocity (w, v) of the link before, in rows.
        rates: per link, its velocity by those of the coordinates, one row.
        momenta: per coordinate, seven rows over the parameters of all links: the momentum for the six unit
            velocities of the link before, and for the velocities of the coordinates themselves.
        basis: the functions.
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
    domain = exact_algebra.choose_domain(robot)
    names = exact_algebra.list_symbols(robot)
    return domain.frac_field(*names) if names else domain


def build_block_robot(robot: Robot, block: Block) -> Robot:
    """Return the joints of a block as a robot of their own, fixed to what is before them, without names."""
    inside = {index: position for position, index in enumerate(block.joints)}
    joints = tuple(
        Joint(
            name=str(inside[index]),
            kind=joint.kind,
            parent=inside.get(joint.parent, -1),
            placement=joint.placement,
            mimic=joint.mimic and replace(joint.mimic, master=inside[joint.mimic.master]),
        )
        for index, joint in ((index, robot.joints[index]) for index in block.joints)
    )
    return Robot(name="", joints=joints)


def _split(basis: TrigonometricBasis, table: Sequence[Sequence[PolyElement]]) -> Split:
    """Return one matrix per function from a matrix of polynomials."""
    parts: dict[BasisFunction, list[Row]] = {}
    for row, entries in enumerate(table):
        for column, polynomial in enumerate(entries):
            for function, value in exact_algebra.split_polynomial(basis, polynomial).items():
                parts.setdefault(function, [{} for _ in table])[row][column] = value
    return {function: tuple(parts[function]) for function in sorted(parts)}


@lru_cache(maxsize=256)
def derive_transport(single: Robot, domain: Domain, field: Domain) -> Transport:
    """Return the transport across the joints of a block, `single`; its numbers are of `domain` in `field`.

    Robots of one kind are derived again and again, in several forms: what is the same is kept.
    """
    algebra = exact_algebra.build_exact_algebra(single, domain)
    state = build_state(single, algebra, algebra.generators)
    frames = build_frames(single, algebra, state)
    none = (algebra.zero,) * 3

    def move(unit: int | None) -> Recursion[PolyElement]:
        """Return the block moved by a unit velocity (w, v) of the link before it; None: by its joints."""
        e = [algebra.one if k == unit else algebra.zero for k in range(_SIX)]
        angular, linear = (e[0], e[1], e[2]), (e[3], e[4], e[5])
        base = LinkMotion(angular=angular, linear=linear, gravity=none, height=algebra.zero)
        rates = state.velocity if unit is None else (algebra.zero,) * single.size
        motions = compute_motions(single, algebra, frames, rates, base)
        return Recursion(robot=single, algebra=algebra, state=state, frames=frames, motions=motions)

    turning = move(None)
    carried = [move(unit) for unit in range(_SIX)]
    basis = exact_algebra.build_basis(single, algebra, field)
    links = range(single.size)
    keys = [(link, name) for link in links for name in INERTIAL]
    momenta = []
    for recursion in (*carried, turning):
        columns = compute_momentum_columns(recursion, keys)
        folded = [fold_vector(single, algebra, columns[key]) for key in keys]
        momenta.append(list(zip(*folded, strict=True)))

    def lift(link: int, name: str) -> tuple[PolyElement, ...]:
        """Return the ten parameters about the link before the block for a unit parameter of a link."""
        body = build_unit_body(algebra, name)
        while link >= 0:
            body = transform_body(algebra, frames[link], body)
            link = single.joints[link].parent
        return list_entries(body)

    def list_velocities(link: int, *moved: Recursion[PolyElement]) -> list[tuple[PolyElement, ...]]:
        motions = [recursion.motions[link] for recursion in moved]
        return [(*motion.angular, *motion.linear) for motion in motions]

    parameters = [zip(*(lift(link, name) for name in INERTIAL), strict=True) for link in links]
    return Transport(
        parameters=tuple(_split(basis, list(table)) for table in parameters),
        velocities=tuple(_split(basis, list_velocities(link, *carried)) for link in links),
        rates=tuple(_split(basis, list_velocities(link, turning)) for link in links),
        momenta=tuple(_split(basis, [row[k] for row in momenta]) for k in range(single.freedom)),
        basis=basis,
    )


def multiply_row(row: Row, matrix: SparseMatrix) -> Row:
    """Return the sparse row times the sparse matrix."""
    result: Row = {}
    for index, factor in row.items():
        for column, value in matrix[index].items():
            result[column] = result.get(column, 0) + factor * value
    return {column: value for column, value in result.items() if value}


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservableRows:
    """What the motions up to a link show of parameters fixed to it.

    `steady` is the row of the constant function (a weight that never turns away), `varying` the span of
    all others, `velocities` the span of attainable (w, v); all in the link's frame.
    """

    steady: Row
    varying: tuple[Row, ...]
    velocities: tuple[Row, ...]


def number_columns(block: Block, robot: Robot, friction: Sequence[Label]) -> dict[Label, int]:
    """Return the column of each parameter of the block: links, rotors, springs, then friction's torques."""
    labels = [(link, name) for link in block.joints for name in INERTIAL]
    drives = (*block.joints, *(robot.size + k for k in block.couplings))
    labels += [(index, "IA") for index in drives]
    labels += [(index, name) for index in block.joints for name in ("KS", "KR")]
    labels += [label for label in friction if label[0] in drives]
    return {label: column for column, label in enumerate(labels)}


def _add_row(target: Family, function: BasisFunction, row: Mapping[int, Number]) -> None:
    total = target.setdefault(function, {})
    for column, value in row.items():
        total[column] = total[column] + value if column in total else value


def _carry(row: Row, transport: Transport) -> Family:
    """Return h_p A_l for one row of h_p, all links of the block together, by functions."""
    result: Family = {}
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
    torques: Mapping[Label, PositionTorque],
) -> tuple[Family, list[Family]]:
    """Return what springs and torques of positions add to the weight, rotors to the momenta."""
    basis, weight = transport.basis, dict[BasisFunction, Row]()

    def convert(value: Fraction) -> Number:
        return basis.field.convert(QQ(value.numerator, value.denominator))

    momenta: list[Family] = [{} for _ in block.coordinates]
    for index in (*block.joints, *(robot.size + k for k in block.couplings)):
        shares = [(block.coordinates.index(k), factor) for k, factor in robot.transmission[index]]
        for c, left in shares:
            for k, right in shares:
                parts, rates = build_power_function(basis)
                turning = tuple(int(position == k) for position in range(len(rates)))
                _add_row(momenta[c], (parts, turning), {columns[index, "IA"]: convert(left) * convert(right)})
            line, square = (build_power_function(basis, c, e) for e in (1, 2))
            if index < robot.size:
                _add_row(weight, line, {columns[index, "KR"]: convert(left)})
                _add_row(weight, square, {columns[index, "KS"]: convert(left) * convert(left)})
        for label, torque in torques.items():
            w = torque.frequency
            if label[0] == index and not w:
                for c, factor in shares:
                    row = {columns[label]: convert(factor * torque.factor)}
                    _add_row(weight, build_power_function(basis, c, 1), row)
            elif label[0] == index:
                # The integral of cos w u is sin(w u) / w, that of sin w u is -cos(w u) / w.
                angles = [(c, w * factor) for c, factor in shares]
                scale = convert(torque.factor / (-w if torque.sine else w))
                waves = exact_algebra.build_wave_functions(basis, angles, sine=not torque.sine)
                for function, size in waves.items():
                    _add_row(weight, function, {columns[label]: scale * size})
    return weight, momenta


def _merge_families(*families: Mapping[BasisFunction, Row]) -> Family:
    result: Family = {}
    for family in families:
        for function, row in family.items():
            _add_row(result, function, row)
    return result


def derive_block(
    robot: Robot,
    block: Block,
    parent: ObservableRows,
    transport: Transport,
    *,
    torques: Mapping[Label, PositionTorque],
    form: str,
) -> tuple[tuple[Row, ...], list[ObservableRows]]:
    """Return the rows of a block over the parameters of `number_columns`, and what is visible at its links.

    `torques` are those of friction. The form "gravity" has no rows of motion, "momentum" none of weight.
    """
    columns = number_columns(block, robot, tuple(torques))
    springs, rotors = _build_drive_rows(robot, block, transport, columns, torques)
    # The momentum along each coordinate for each velocity, its own and those of the link before.
    own, carried = (
        [
            {function: row for function, matrix in momenta.items() if (row := multiply_row(velocity, matrix))}
            for momenta in (() if form == "gravity" else transport.momenta)
            for velocity in velocities
        ]
        for velocities in ([_OWN], parent.velocities)
    )
    weight = {} if form == "momentum" else _merge_families(_carry(parent.steady, transport), springs)
    turning = [_merge_families(*pair) for pair in zip(own, rotors, strict=False)]
    rows = [row for family in (*turning, *carried) for row in family.values()]
    # What does not change with the block's coordinates, the link before makes as well.
    for family in (*(_carry(row, transport) for row in parent.varying), weight):
        rows += [row for function, row in family.items() if function != transport.one]
    visible = []
    for link, parameters in enumerate(transport.parameters):
        velocities = [matrix[0] for matrix in transport.rates[link].values()]
        matrices = tuple(transport.velocities[link].values())
        velocities += [multiply_row(row, matrix) for row in parent.velocities for matrix in matrices]
        start = _TEN * link
        varying = [
            {k - start: value for k, value in row.items() if start <= k < start + _TEN}
            for family in (*own, *carried)
            for row in family.values()
        ]
        for function, matrix in parameters.items():
            varying += [multiply_row(row, matrix) for row in parent.varying]
            if function != transport.one:
                varying.append(multiply_row(parent.steady, matrix))
        steady = parameters.get(transport.one)
        visible.append(
            ObservableRows(
                steady={} if steady is None else multiply_row(parent.steady, steady),
                varying=exact_algebra.reduce_rows(varying),
                velocities=exact_algebra.reduce_rows(velocities),
            )
        )
    return exact_algebra.reduce_rows(rows), visible


def _expand_row(carried: Carried, labels: Sequence[Label], row: Row) -> dict[Label, Number]:
    """Return a row of a block over all parameters: its links with all beyond them, and its drives."""
    result: dict[Label, Number] = {}
    parts: dict[int, Row] = {}
    for column, value in row.items():
        index, name = labels[column]
        if name in INERTIAL:
            parts.setdefault(index, {})[INERTIAL.index(name)] = value
        else:
            result[index, name] = value
    pending = list(parts.items())
    while pending:
        link, part = pending.pop()
        result |= {(link, INERTIAL[column]): value for column, value in part.items()}
        moved = ((child, multiply_row(part, matrix)) for child, matrix in carried.get(link, ()))
        pending += [(child, own) for child, own in moved if own]
    return result


def derive_observable_subspace(
    robot: Robot, form: str
) -> tuple[Domain, tuple[dict[Label, Number], ...], tuple[ObservableRows, ...]]:
    """Return the field, the rows of all blocks over all parameters, and what is visible at each link.

    The form "torque" or "energy" takes all, "gravity" torques at rest, "momentum" dT/ddq. A RobotError where
    symbols, roots and followers together make exact arithmetic too slow.
    """
    field = build_field(robot)
    # What would not end: rational functions over roots, in a coordinate that three joints share.
    for position in range(robot.freedom if field.is_FractionField and field.field.domain.is_Algebraic else 0):
        rows_of = zip(robot.joints, robot.transmission, strict=False)
        sharing = [joint.name for joint, row in rows_of if row[0][0] == position]
        if len(sharing) > 2:
            lengths = ", ".join(exact_algebra.list_symbols(robot))
            text = f"symbolic lengths ({lengths}), angles of 30 or 45 degrees and a coordinate that moves "
            text += f"joints {', '.join(sharing)}: exact base parameters take too long. "
            text += "Write the lengths as numbers"
            raise RobotError(Notice(code="robot.too-symbolic", text=text, file=robot.path))
    blocks = split_into_blocks(robot)
    domain = exact_algebra.choose_domain(robot)
    transports = [derive_transport(build_block_robot(robot, block), domain, field) for block in blocks]
    carried: dict[int, list[tuple[int, SparseMatrix]]] = {}
    for block, transport in zip(blocks, transports, strict=True):
        for link, split in zip(block.joints, transport.parameters, strict=True):
            if transport.one in split:
                carried.setdefault(block.base, []).append((link, split[transport.one]))
    # The potential of the base's own parameters is -g' MS.
    gravity = [exact_algebra.convert_number(value, domain, field) for value in robot.gravity]
    weight = {INERTIAL.index("MX") + axis: -value for axis, value in enumerate(gravity) if value}
    root = ObservableRows(steady={} if form == "momentum" else weight, varying=(), velocities=())
    torques = compute_position_torques(robot)
    visible: dict[int, ObservableRows] = {-1: root}
    rows: list[dict[Label, Number]] = []
    for block, transport in zip(blocks, transports, strict=True):
        parent = visible[block.base]
        labels = tuple(number_columns(block, robot, tuple(torques)))
        found, shown = derive_block(robot, block, parent, transport, torques=torques, form=form)
        rows += [_expand_row(carried, labels, row) for row in found]
        visible |= dict(zip(block.joints, shown, strict=True))
    for row in build_friction_rows(robot):
        rows.append({label: field.convert(QQ(v.numerator, v.denominator)) for label, v in row.items()})
    return field, tuple(rows), tuple(visible[link] for link in range(robot.size))
