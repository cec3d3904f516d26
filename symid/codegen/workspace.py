"""What all routes to a function start from, and how their results become the elements of its output ports.

A coordinate that is not an input of the function is zero: gravity is inverse dynamics at rest. The shares of
joints that follow another are added at its coordinate.

Supported: rigid robots, trees, symbolic lengths with a value; without one where the workspace is exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

from symid.codegen.catalogue import Constants
from symid.codegen.functions import FunctionSpec
from symid.codegen.programs import ExpressionTable, Op, ValueAlgebra
from symid.dynamics import (
    BaseParameters,
    Label,
    Recursion,
    RobotState,
    build_recursion,
    choose_origin_shifts,
    fix_last_link_axes,
    fold_vector,
    list_symbols,
    remove_constant_rotations,
    shift_origins,
    shift_parameters,
    spread_coordinates,
)
from symid.errors import Notice, RobotError
from symid.robot import Robot

Elements = tuple[int, ...]
"""The references of one output port in row-major order."""
RouteBuilder = Callable[["RouteWorkspace"], tuple[Elements, ...]]
"""A route: what it makes of a workspace are the elements of all output ports."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteWorkspace:
    """References to every vector a route may ask for, zeros where the function has no such input.

    `parameters` holds the base parameters as sparse link parameters.
    """

    base: BaseParameters
    table: ExpressionTable
    algebra: ValueAlgebra
    inputs: Mapping[str, tuple[int, ...]]
    recursion: Recursion[int]
    parameters: Mapping[Label, int]
    built: dict[RouteBuilder, tuple[Elements, ...]] = field(default_factory=dict)

    def recall(self, build: RouteBuilder) -> tuple[Elements, ...]:
        """Return what `build` makes in this workspace; it is made once."""
        if build not in self.built:
            self.built[build] = build(self)
        return self.built[build]

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self.recursion.robot

    def spread(self, values: Sequence[int]) -> tuple[int, ...]:
        """Return the values of the joints from those of the coordinates."""
        return spread_coordinates(self.robot, self.algebra, values)[: self.robot.size]

    def move(self, velocity: tuple[int, ...]) -> "RouteWorkspace":
        """Return the same workspace at other velocities of the coordinates."""
        state = replace(self.recursion.state, velocity=self.spread(velocity))
        recursion = build_recursion(self.robot, self.recursion.algebra, state)
        return replace(self, inputs={**self.inputs, "dq": velocity}, recursion=recursion, built={})

    def shift(self) -> "RouteWorkspace":
        """Return the same workspace with link origins moved along their joints' axes."""
        shifts = choose_origin_shifts(self.robot)
        algebra = self.recursion.algebra
        recursion = build_recursion(shift_origins(self.robot, shifts), algebra, self.recursion.state)
        parameters = shift_parameters(algebra, self.parameters, shifts)
        return replace(self, recursion=recursion, parameters=parameters, built={})

    def hold(self) -> "RouteWorkspace":
        """Return the same workspace with the last links in axes that do not turn with them."""
        recursion, parameters = fix_last_link_axes(self.recursion, self.parameters)
        return replace(self, recursion=recursion, parameters=parameters, built={})

    def flatten_vector(self, values: Sequence[int]) -> Elements:
        """Return a value per joint as a port of shape (n,)."""
        return fold_vector(self.robot, self.recursion.algebra, values)

    def flatten_columns(self, columns: Sequence[Sequence[int]]) -> Elements:
        """Return columns with an entry a coordinate as a port of shape (n, columns)."""
        return tuple(chain(*zip(*columns, strict=True)))


def check_symbols(robot: Robot) -> None:
    """Raise RobotError where a symbolic length has no value."""
    missing = [name for name in list_symbols(robot) if name not in dict(robot.symbols)]
    if missing:
        text = (
            f"code needs a value for the symbolic length {', '.join(missing)}: add it under [symbols], in m"
        )
        raise RobotError(Notice(code="robot.symbol-without-value", text=text, file=robot.path))


def build_workspace(
    robot: Robot,
    base: BaseParameters,
    spec: FunctionSpec,
    turns: Mapping[int, float] | None = None,
    constants: Constants | None = None,
    *,
    exact: bool = False,
) -> RouteWorkspace:
    """Return a new workspace for the function `spec`.

    `turns` are constant turns of joints (`list_constant_rotations`), in rad, that are added to the joints'
    angles; the others are part of the placements. `constants` are values of vectors that are no inputs of the
    function. `exact` keeps numbers and symbolic lengths as they are, see `ValueAlgebra.numbers`.
    """
    turns = turns or {}
    table = ExpressionTable()
    zero = table.constant(0.0)
    moving = ("q", "dq", "ddq", "dqr", "ddqr", "tau")
    sizes = {**dict.fromkeys(moving, robot.freedom), base.vector: base.count, "f": len(base.friction)}
    inputs = {name: (zero,) * size for name, size in sizes.items()}
    for number, port in enumerate(spec.inputs):
        inputs[port.name] = tuple(table.input(number, element) for element in range(port.size))
    for name, values in (constants or {}).items():
        inputs[name] = tuple(map(table.constant, values))
    algebra = ValueAlgebra(table, dict(robot.symbols), {} if exact else None)
    position, velocity, acceleration = (
        spread_coordinates(robot, algebra, inputs[name])[: robot.size] for name in ("q", "dq", "ddq")
    )
    angles = [table.add(angle, table.constant(turns.get(joint, 0.0))) for joint, angle in enumerate(position)]
    state = RobotState(
        sine=tuple(table.apply(Op.SIN, angle) for angle in angles),
        cosine=tuple(table.apply(Op.COS, angle) for angle in angles),
        position=position,
        velocity=velocity,
        acceleration=acceleration,
    )
    return RouteWorkspace(
        base=base,
        table=table,
        algebra=algebra,
        inputs=inputs,
        recursion=build_recursion(remove_constant_rotations(robot, turns), algebra, state),
        parameters=dict(zip(base.keys, inputs[base.vector], strict=True)),
    )
