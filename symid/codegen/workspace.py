"""What all routes to one function start from: a table of values, the inputs, the robot in its state.

Input: a robot, its base parameters, an entry of the catalogue. Output: `Workspace`.

A coordinate that is not an input of the function is zero: gravity is inverse dynamics at rest.

Supported: rigid robots, symbolic lengths with a value; without one where the workspace is exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from symid.algebra.exact import find_symbols
from symid.algebra.scalar import spread_coordinates
from symid.codegen.constants import Constants
from symid.codegen.functions import FunctionSpec
from symid.codegen.value_algebra import ValueAlgebra, build_value_state
from symid.codegen.values import ValueTable
from symid.dynamics.kinematics import Recursion, build_recursion
from symid.dynamics.leaves import hold_leaves
from symid.dynamics.origins import find_shifts, shift_origins, shift_parameters
from symid.dynamics.turns import remove_turns
from symid.errors import Notice, RobotError
from symid.parameters.base import BaseParameters, Label
from symid.robot.description import Robot

__all__ = ["Build", "Elements", "Workspace", "build_workspace", "check_symbols"]

Elements = tuple[int, ...]
"""The references of one output port in row-major order."""
Build = Callable[["Workspace"], tuple[Elements, ...]]
"""A route: what it makes of a workspace are the elements of all output ports."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Workspace:
    """Inputs as references, one a coordinate or parameter, and the recursion over them.

    `inputs` holds every vector a route may ask for, zeros where the function has no such input;
    `parameters` the base parameters as sparse link parameters.
    """

    base: BaseParameters
    table: ValueTable
    algebra: ValueAlgebra
    inputs: Mapping[str, tuple[int, ...]]
    recursion: Recursion[int]
    parameters: Mapping[Label, int]
    built: dict[Build, tuple[Elements, ...]] = field(default_factory=dict)

    def recall(self, build: Build) -> tuple[Elements, ...]:
        """Return what `build` makes in this workspace; it is made once."""
        if build not in self.built:
            self.built[build] = build(self)
        return self.built[build]

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self.recursion.robot

    @property
    def zeros(self) -> tuple[int, ...]:
        """Return one zero per joint."""
        return (self.recursion.algebra.zero,) * self.robot.size

    def spread(self, values: Sequence[int]) -> tuple[int, ...]:
        """Return the values of the joints from those of the coordinates."""
        return spread_coordinates(self.robot, self.recursion.algebra, values)[: self.robot.size]

    def move(self, velocity: tuple[int, ...]) -> "Workspace":
        """Return the same workspace at other velocities of the coordinates."""
        state = replace(self.recursion.state, velocity=self.spread(velocity))
        recursion = build_recursion(self.robot, self.recursion.algebra, state)
        return replace(self, inputs={**self.inputs, "dq": velocity}, recursion=recursion, built={})

    def shift(self) -> "Workspace":
        """Return the same workspace with link origins moved along their joints' axes."""
        shifts = find_shifts(self.robot)
        algebra = self.recursion.algebra
        recursion = build_recursion(shift_origins(self.robot, shifts), algebra, self.recursion.state)
        parameters = shift_parameters(algebra, self.parameters, shifts)
        return replace(self, recursion=recursion, parameters=parameters, built={})

    def hold(self) -> "Workspace":
        """Return the same workspace with the last links in axes that do not turn with them."""
        recursion, parameters = hold_leaves(self.recursion, self.parameters)
        return replace(self, recursion=recursion, parameters=parameters, built={})


def check_symbols(robot: Robot) -> None:
    """Check that all symbolic lengths have a value.

    Raises:
        RobotError: one has none.
    """
    missing = [name for name in find_symbols(robot) if name not in dict(robot.symbols)]
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
) -> Workspace:
    """Return a new workspace for the function `spec`.

    `turns` are constant turns of joints (see `turns`) that are added to the joints' angles; the others are
    part of the placements. `constants` are values of vectors that are no inputs of the function. `exact`
    keeps numbers and symbolic lengths as they are, see `ValueAlgebra.numbers`.
    """
    turns = turns or {}
    table = ValueTable()
    zero = table.constant(0.0)
    moving = ("q", "dq", "ddq", "dqr", "ddqr", "tau")
    sizes = {**dict.fromkeys(moving, robot.freedom), base.vector: base.count, "f": len(base.friction)}
    inputs = {name: (zero,) * size for name, size in sizes.items()}
    for number, port in enumerate(spec.inputs):
        inputs[port.name] = tuple(table.input(number, element) for element in range(port.size))
    for name, values in (constants or {}).items():
        inputs[name] = tuple(map(table.constant, values))
    algebra = ValueAlgebra(table, dict(robot.symbols), {} if exact else None)
    state = build_value_state(robot, algebra, (inputs["q"], inputs["dq"], inputs["ddq"]), turns)
    return Workspace(
        base=base,
        table=table,
        algebra=algebra,
        inputs=inputs,
        recursion=build_recursion(remove_turns(robot, turns), algebra, state),
        parameters=dict(zip(base.keys, inputs[base.vector], strict=True)),
    )
