"""What all routes start from; routes to forward dynamics and derivatives of the equations of motion.

A route is a builder: workspace -> elements of all output ports, see `routes`. A coordinate that is not an
input of the function is zero: gravity is inverse dynamics at rest. The shares of joints that follow another
are added at its coordinate.

M ddq = tau - c takes operations that grow with the third power of the joints, by articulated bodies with
their number. With M = dtau/dddq, and the other derivatives of tau(q, dq, ddq) at the acceleration that the
torque gives,

    dddq/dtau = M^-1,   dddq/dq = -M^-1 dtau/dq,   dddq/ddq = -M^-1 dtau/ddq.

The derivative by velocities is twice the Coriolis matrix C, so that the bias torque costs no recursion of its
own: C dq + rest. M^-1 = L^-1 D^-1 L^-T shares the factors of M = L' D L with the acceleration.

Supported: rigid robots, trees, symbolic lengths with a value; without one where the workspace is exact.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, product

import numpy as np

from symid import dynamics
from symid.codegen.functions import Constants, FunctionSpec, find_parameter_axis
from symid.codegen.programs import ExpressionTable, differentiate_along
from symid.dynamics import frame_choice, newton_euler, torque_derivatives
from symid.errors import Notice, RobotError
from symid.robot import Robot

Elements = tuple[int, ...]
"""The references of one output port in row-major order."""
Outputs = tuple[Elements, ...]
RouteBuilder = Callable[["RouteWorkspace"], Outputs]
"""A route: what it makes of a workspace are the elements of all output ports."""
Matrix = Sequence[Sequence[int]]
_LONGEST = 1e7
"""In m: of inertias of 1 kg m^2 beside its square, doubles keep two digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteWorkspace:
    """What a route may ask for: zeros for inputs that the function lacks, beta as sparse link parameters."""

    base: dynamics.BaseParameters
    algebra: ExpressionTable
    inputs: Mapping[str, tuple[int, ...]]
    recursion: dynamics.Recursion[int]
    parameters: Mapping[dynamics.Label, int]
    built: dict[RouteBuilder, Outputs] = field(default_factory=dict)

    def recall(self, build: RouteBuilder) -> Outputs:
        """Return what `build` makes in this workspace; it is made once."""
        if build not in self.built:
            self.built[build] = build(self)
        return self.built[build]

    def build_outputs(self, spec: FunctionSpec, build: RouteBuilder) -> Outputs:
        """Return what `build` makes, its columns a parameter of the file's frames where pi has them."""
        outputs, algebra, keys = self.recall(build), self.algebra, self.base.keys
        axes = [find_parameter_axis(port.name) for port in spec.outputs]
        if self.base.vector != "pi" or axes == [None] * len(axes):
            return outputs
        units = [dynamics.move_from_stated_frames(self.robot, algebra, {key: algebra.one}) for key in keys]
        found = []
        for port, axis, refs in zip(spec.outputs, axes, outputs, strict=True):
            if axis is None:
                found.append(refs)
                continue
            slices = np.moveaxis(np.array(refs, dtype=object).reshape(port.shape), axis, 0)
            columns = dict(zip(keys, slices.reshape(len(keys), -1).tolist(), strict=True))
            rows = [
                [
                    algebra.sum_values(algebra.mul(unit[key], columns[key][k]) for key in unit)
                    for k in range(len(columns[keys[0]]))
                ]
                for unit in units
            ]
            whole = np.moveaxis(np.array(rows, dtype=object).reshape(slices.shape), 0, axis)
            found.append(tuple(whole.ravel().tolist()))
        return tuple(found)

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self.recursion.robot

    def spread(self, values: Sequence[int]) -> tuple[int, ...]:
        """Return the values of the joints from those of the coordinates."""
        return dynamics.spread_coordinates(self.robot, self.algebra, values)[: self.robot.size]

    def shift(self) -> "RouteWorkspace":
        """Return the same workspace with link origins moved along their joints' axes."""
        shifts = frame_choice.choose_origin_shifts(self.robot)
        robot = frame_choice.shift_origins(self.robot, shifts)
        moved = dynamics.build_recursion(robot, self.algebra, self.recursion.state)
        parameters = frame_choice.shift_parameters(self.algebra, self.parameters, shifts)
        recursion = replace(moved, meet=self.recursion.meet)
        return replace(self, recursion=recursion, parameters=parameters, built={})

    def hold(self) -> "RouteWorkspace":
        """Return the same workspace with the last links in axes that do not turn with them."""
        recursion, parameters = frame_choice.fix_last_link_axes(self.recursion, self.parameters)
        return replace(self, recursion=recursion, parameters=parameters, built={})

    def meet(self, meet: dynamics.ProjectionFrame) -> "RouteWorkspace":
        """Return the same workspace, its wrenches on their way down to the joints stopped earlier."""
        return replace(self, recursion=replace(self.recursion, meet=meet), built={})

    def flatten_vector(self, values: Sequence[int]) -> Elements:
        """Return a value per joint as a port of shape (n,)."""
        return dynamics.fold_vector(self.robot, self.algebra, values)

    def flatten_matrix(self, matrix: Matrix) -> Elements:
        """Return a matrix of the joints as that of the coordinates, row by row."""
        return tuple(chain(*dynamics.fold_matrix(self.robot, self.algebra, matrix)))

    def differentiate(self, values: Sequence[int], name: str) -> list[list[int]]:
        """Return the derivatives of values by each element of input `name`."""
        directions = [{ref: self.algebra.one} for ref in self.inputs[name]]
        return differentiate_along(self.algebra, values, directions)

    def flatten_columns(self, columns: Sequence[Sequence[int]]) -> Elements:
        """Return columns with an entry a coordinate as a port of shape (n, columns)."""
        return tuple(chain(*zip(*columns, strict=True)))


def check_symbols(robot: Robot) -> None:
    """Raise RobotError where a symbolic length has no value, or a length is beyond what doubles resolve."""
    values = dict(robot.symbols)
    missing = ", ".join(name for name in dynamics.list_symbols(robot) if name not in values)
    for joint in () if missing else robot.joints:
        longest = max(abs(length.to_float(values)) for length in joint.placement.translation)
        if longest > _LONGEST:
            text = f"joint {joint.name!r}: a length of {longest:.3g} m; torques over more than "
            text += f"{_LONGEST:g} m cannot be computed in doubles. Lengths are in m: correct the file"
            raise RobotError(Notice(code="robot.beyond-doubles", text=text, file=robot.path))
    if missing:
        text = f"code needs a value for the symbolic length {missing}: add it under [symbols], in m"
        raise RobotError(Notice(code="robot.symbol-without-value", text=text, file=robot.path))


def build_workspace(
    robot: Robot,
    base: dynamics.BaseParameters,
    spec: FunctionSpec,
    turns: Mapping[int, float] | None = None,
    constants: Constants | None = None,
    *,
    exact: bool = False,
) -> RouteWorkspace:
    """Return a new workspace for the function `spec`.

    `turns` are constant turns of joints (`list_constant_rotations`), in rad, that are added to the joints'
    angles; the others are part of the placements. `constants` are values of vectors that are no inputs of the
    function. `exact` keeps numbers and symbolic lengths as they are, see `ExpressionTable`.
    """
    turns, table = turns or {}, ExpressionTable(dict(robot.symbols), exact=exact)
    moving = ("q", "dq", "ddq", "dqr", "ddqr", "tau")
    sizes = {**dict.fromkeys(moving, robot.freedom), base.vector: base.count, "f": len(base.friction)}
    inputs = {name: (table.zero,) * size for name, size in sizes.items()}
    for number, port in enumerate(spec.inputs):
        inputs[port.name] = tuple(table.input(number, element) for element in range(port.size))
    for name, values in (constants or {}).items():
        inputs[name] = tuple(map(table.constant, values))
    for name in ("ddq", "tau"):
        # What is given of driven and of passive joints, and zero for the others.
        pairs = ((robot.driven, inputs.get(f"{name}_a")), (robot.passive, inputs.get(f"{name}_p")))
        given = {
            place: ref for places, refs in pairs if refs for place, ref in zip(places, refs, strict=True)
        }
        if given:
            inputs[name] = tuple(given.get(place, table.zero) for place in range(robot.freedom))
    moves = (inputs[name] for name in ("q", "dq", "ddq"))
    motion = [dynamics.spread_coordinates(robot, table, values)[: robot.size] for values in moves]
    constant = [table.constant(turns.get(joint, 0.0)) for joint in range(robot.size)]
    angles = list(map(table.add, motion[0], constant))
    sine, cosine = (tuple(map(wave, angles)) for wave in (table.sin, table.cos))
    state = dynamics.RobotState(sine, cosine, *motion)
    turned = frame_choice.remove_constant_rotations(robot, turns)
    parameters: Mapping[dynamics.Label, int] = dict(zip(base.keys, inputs[base.vector], strict=True))
    if base.vector == "pi":
        parameters = dynamics.move_from_stated_frames(robot, table, parameters)
    return RouteWorkspace(
        base=base,
        algebra=table,
        inputs=inputs,
        recursion=dynamics.build_recursion(turned, table, state),
        parameters=parameters,
    )


def _remove(table: ExpressionTable, start: int, products: Iterable[tuple[int, int]]) -> int:
    """Return `start` less the products."""
    for left, right in products:
        start = table.add(start, -table.mul(left, right))
    return start


class _Factors:
    """M = L' D L of a table's values, symmetric and positive definite: rows of L below its ones, and 1/D.

    Joints are eliminated from the last one to the first: what is zero in M, for joints of which neither
    carries the other, stays zero in L (Featherstone, Int. J. Robot. Res. 24 (2005) 487-500). Each pivot is
    inverted once: n more products, but a quotient takes as long as ten of them.
    """

    def __init__(self, table: ExpressionTable, matrix: Matrix) -> None:
        n, self.table = len(matrix), table
        scaled, self.lower = ([[0] * n for _ in range(n)] for _ in range(2))
        self.inverses = [0] * n
        for i in reversed(range(n)):
            behind = [(self.lower[k], scaled[k]) for k in range(i + 1, n)]
            pivot = _remove(table, matrix[i][i], [(low[i], row[i]) for low, row in behind])
            self.inverses[i] = table.div(table.one, pivot)
            for j in range(i):
                scaled[i][j] = _remove(table, matrix[i][j], [(low[i], row[j]) for low, row in behind])
                self.lower[i][j] = table.mul(scaled[i][j], self.inverses[i])

    def solve(self, right: Sequence[int]) -> list[int]:
        """Return x of M x = r."""
        lower, solution, joints = self.lower, list(right), range(len(right))
        for i in reversed(joints):
            carried = [(lower[k][i], solution[k]) for k in joints[i + 1 :]]
            solution[i] = _remove(self.table, solution[i], carried)
        for i in joints:
            scaled = self.table.mul(solution[i], self.inverses[i])
            solution[i] = _remove(self.table, scaled, zip(lower[i], solution[:i], strict=False))
        return solution

    def invert(self) -> list[list[int]]:
        """Return M^-1 = X D^-1 X', X the inverse of L: both triangles are the same values."""
        table, n = self.table, len(self.inverses)
        unit: list[list[int]] = [[] for _ in range(n)]
        for i in range(n):
            for j in range(i):
                products = [(self.lower[i][k], unit[k][j]) for k in range(j + 1, i)]
                unit[i].append(_remove(table, -self.lower[i][j], products))
            unit[i].append(table.one)
        result = [[0] * n for _ in range(n)]
        for i in range(n):
            scaled = list(map(table.mul, unit[i], self.inverses))
            for j in range(i + 1):
                products = [(-unit[j][k], scaled[k]) for k in range(j)]
                result[i][j] = result[j][i] = _remove(table, scaled[j], products)
        return result


def build_forward_dynamics(workspace: RouteWorkspace, mass: RouteBuilder, torques: RouteBuilder) -> Outputs:
    """Solve M ddq = tau - c for a matrix and a bias torque from two other routes."""
    table, n = workspace.algebra, workspace.robot.freedom
    (entries,), (bias,) = workspace.recall(mass), workspace.recall(torques)
    rest = list(map(table.sub, workspace.inputs["tau"], bias))
    factors = _Factors(table, [entries[n * row : n * (row + 1)] for row in range(n)])
    return (tuple(factors.solve(rest)),)


def build_partial_inverse(workspace: RouteWorkspace, mass: RouteBuilder, torques: RouteBuilder) -> Outputs:
    """Solve M_pp ddq_p = tau_p - r_p, tau_a = r_a + M_ap ddq_p, r the torques at ddq_p = 0 (Spong 1994)."""
    table, robot = workspace.algebra, workspace.robot
    n, driven, passive = robot.freedom, robot.driven, robot.passive
    (entries,), (rest,) = workspace.recall(mass), workspace.recall(torques)
    factors = _Factors(table, [[entries[n * i + j] for j in passive] for i in passive])
    found = factors.solve([table.sub(workspace.inputs["tau"][i], rest[i]) for i in passive])
    moved = [[(entries[n * i + j], x) for j, x in zip(passive, found, strict=True)] for i in driven]
    return tuple(-_remove(table, -rest[i], row) for i, row in zip(driven, moved, strict=True)), tuple(found)


def build_articulated(workspace: RouteWorkspace) -> Outputs:
    """Build the accelerations by articulated bodies: without a matrix, the route of robots of many joints."""
    table, tau = workspace.algebra, workspace.spread(workspace.inputs["tau"])
    invert = partial(table.div, table.one)
    return (newton_euler.compute_forward_dynamics(workspace.recursion, workspace.parameters, tau, invert),)


def build_derivatives(workspace: RouteWorkspace) -> Outputs:
    """Build dtau/dq, dtau/ddq and M by composite bodies."""
    found = torque_derivatives.compute_torque_derivatives(workspace.recursion, workspace.parameters)
    return tuple(map(workspace.flatten_matrix, found))


def build_mass_derivatives(workspace: RouteWorkspace) -> Outputs:
    """Build dM/dq by composite bodies."""
    slopes = torque_derivatives.compute_mass_derivatives(workspace.recursion, workspace.parameters)
    entries = zip(*map(workspace.flatten_matrix, slopes), strict=True)
    return (tuple(chain(*map(workspace.flatten_vector, entries))),)


def build_second_derivatives(workspace: RouteWorkspace) -> Outputs:
    """Build the second derivatives of tau (half by q, q; c_ijk by dq, dq), and dM/dq, from the first ones."""
    table, n = workspace.algebra, workspace.robot.freedom
    by_q, by_dq, _ = build_derivatives(workspace)
    (mass,) = build_mass_derivatives(workspace)
    twice, mixed = (workspace.differentiate(values, "q") for values in (by_q, by_dq))
    indices = [(i, j, k, max(j, k), min(j, k)) for i, j, k in product(range(n), repeat=3)]
    symbols = []
    for i, _, _, j, k in indices:
        first, second, third = (mass[n * (n * a + b) + c] for a, b, c in ((i, j, k), (i, k, j), (j, k, i)))
        symbols.append(table.add(table.add(first, second), -third))
    by_both = tuple(twice[high][n * i + low] for i, _, _, high, low in indices)
    return by_both, tuple(mixed[j][n * i + k] for i, j, k, _, _ in indices), tuple(symbols), mass


def build_forward_derivatives(workspace: RouteWorkspace) -> Outputs:
    """Build ddq and its derivatives by q, dq and tau (see above)."""
    robot, table, inputs = workspace.robot, workspace.algebra, workspace.inputs
    *terms, load = torque_derivatives.compute_equation_terms(workspace.recursion, workspace.parameters)
    mass, coriolis = (dynamics.fold_matrix(robot, table, part) for part in terms)
    factors, halves = _Factors(table, mass), list(map(table.half, inputs["dq"]))
    rest = zip(inputs["tau"], workspace.flatten_vector(load), coriolis, strict=True)
    forces = [_remove(table, table.add(tau, -load), zip(row, halves, strict=True)) for tau, load, row in rest]
    ddq = factors.solve(forces)
    state = replace(workspace.recursion.state, acceleration=workspace.spread(ddq))
    moving = replace(workspace.recursion, state=state)
    by_position, _, _ = torque_derivatives.compute_torque_derivatives(moving, workspace.parameters)
    slopes, inverse = dynamics.fold_matrix(robot, table, by_position), factors.invert()
    products = [
        [
            [_remove(table, table.zero, zip(row, column, strict=True)) for row in inverse]
            for column in zip(*block, strict=True)
        ]
        for block in (slopes, coriolis)
    ]
    return (tuple(ddq), *map(workspace.flatten_columns, products), tuple(chain(*inverse)))
