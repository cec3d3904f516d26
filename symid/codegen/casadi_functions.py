"""The catalogue as CasADi functions over SX, in base parameters.

Input: a robot. Output: `Functions`: the model card and one SX function per entry of the catalogue, with
inputs and outputs named, ordered and shaped as its spec says; one of shape (n, 3, 3) is an n x 9 matrix.

Robot -> BaseParameters -> card;  Robot -> recursion over SX -> functions.

Supported: rigid robots, symbolic lengths with a value.
Not supported: symbolic lengths without a value (RobotError).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from symid.algebra.code import CodeAlgebra, build_code_state
from symid.algebra.exact import find_symbols
from symid.algebra.scalar import spread_coordinates
from symid.codegen.catalogue import find_specs
from symid.codegen.functions import ModelCard
from symid.codegen.model_card import build_model_card
from symid.dynamics.base import BaseParameters, Label, find_base_parameters
from symid.dynamics.composite import find_mass_matrix
from symid.dynamics.drives import DRIVE, find_drive_energy
from symid.dynamics.energy import find_energy_rows
from symid.dynamics.folding import fold_matrix, fold_rows, fold_vector
from symid.dynamics.kinematics import Recursion, build_recursion, find_jacobian, find_link_poses
from symid.dynamics.newton_euler import find_inverse_dynamics, find_slotine_li_torques
from symid.dynamics.regressors import (
    Columns,
    find_lagrange_columns,
    find_momentum_columns,
    find_slotine_li_columns,
    find_torque_columns,
)
from symid.errors import Notice, RobotError, UsageError
from symid.joint.friction import FRICTION_MODELS, find_friction
from symid.notation import INERTIAL
from symid.robot.description import Robot
from symid.robot.geometry import ZERO

__all__ = ["Functions", "build_functions"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """A model card and its SX functions, in the card's order."""

    card: ModelCard
    functions: tuple[ca.Function, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Build:
    """What all builders share: symbols, recursion results, base parameters as sparse link parameters."""

    base: BaseParameters
    symbols: Mapping[str, ca.SX]
    recursion: Recursion[ca.SX]
    parameters: Mapping[Label, ca.SX]

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self.recursion.robot

    @property
    def zeros(self) -> tuple[ca.SX, ...]:
        """Return one zero per joint."""
        return (self.recursion.algebra.zero,) * self.robot.size

    def fold(self, values: Sequence[ca.SX]) -> ca.SX:
        """Return a column with an entry a coordinate from values with one a joint."""
        return _column(fold_vector(self.robot, self.recursion.algebra, values))

    def spread(self, values: Sequence[ca.SX]) -> tuple[ca.SX, ...]:
        """Return the values of the joints from those of the coordinates."""
        return spread_coordinates(self.robot, self.recursion.algebra, values)[: self.robot.size]


def _start(robot: Robot, base: BaseParameters) -> _Build:
    n = robot.freedom
    names = ("q", "dq", "ddq", "dqr", "ddqr", "tau")
    symbols = {name: ca.SX.sym(name, n) for name in names}
    symbols["beta"] = ca.SX.sym("beta", base.count)
    symbols["f"] = ca.SX.sym("f", len(base.friction))
    algebra = CodeAlgebra(dict(robot.symbols))
    state = build_code_state(robot, algebra, symbols["q"], symbols["dq"], symbols["ddq"])
    return _Build(
        base=base,
        symbols=symbols,
        recursion=build_recursion(robot, algebra, state),
        parameters={key: symbols["beta"][k] for k, key in enumerate(base.keys)},
    )


def _column(values: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX.zeros(0, 1)


def _matrix(rows: Sequence[Sequence[ca.SX]]) -> ca.SX:
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _from_columns(build: _Build, columns: Columns[ca.SX]) -> ca.SX:
    if not columns:
        return ca.SX.zeros(build.robot.freedom, 0)
    return ca.horzcat(*(build.fold(columns[key]) for key in build.base.keys))


def _inverse_dynamics(build: _Build, *, moving: bool, accelerating: bool) -> ca.SX:
    recursion = build.recursion
    if not (moving and accelerating):
        still = replace(
            recursion.state,
            velocity=recursion.state.velocity if moving else build.zeros,
            acceleration=recursion.state.acceleration if accelerating else build.zeros,
        )
        recursion = build_recursion(recursion.robot, recursion.algebra, still)
    return build.fold(find_inverse_dynamics(recursion, build.parameters))


def _forward_kinematics(build: _Build) -> tuple[ca.SX, ...]:
    poses = find_link_poses(build.recursion)
    rotations = _matrix([[entry for row in pose.rotation for entry in row] for pose in poses])
    return rotations, _matrix([pose.origin for pose in poses])


def _jacobian(build: _Build) -> tuple[ca.SX, ...]:
    return (_matrix(fold_rows(build.robot, build.recursion.algebra, find_jacobian(build.recursion))),)


def _mass_matrix(build: _Build) -> tuple[ca.SX, ...]:
    matrix = find_mass_matrix(build.recursion, build.parameters)
    return (_matrix(fold_matrix(build.robot, build.recursion.algebra, matrix)),)


def _coriolis_matrix(build: _Build) -> tuple[ca.SX, ...]:
    """Return C column by column: the Slotine-Li torque for dqr = e_k, ddqr = 0, less gravity."""
    n, algebra = build.robot.freedom, build.recursion.algebra
    weightless = replace(build.recursion, robot=replace(build.robot, gravity=(ZERO, ZERO, ZERO)))
    columns = []
    for k in range(n):
        unit = build.spread([algebra.one if j == k else algebra.zero for j in range(n)])
        columns.append(build.fold(find_slotine_li_torques(weightless, (unit, build.zeros), build.parameters)))
    return (ca.horzcat(*columns),)


def _forward_dynamics(build: _Build) -> tuple[ca.SX, ...]:
    """Return ddq from M ddq = tau - c by an LDL' factorisation written out."""
    matrix = _mass_matrix(build)[0]
    rest = build.symbols["tau"] - _inverse_dynamics(build, moving=True, accelerating=False)
    n = build.robot.freedom
    lower = [[ca.SX(0)] * n for _ in range(n)]
    pivots: list[ca.SX] = []
    for i in range(n):
        for j in range(i):
            inner = sum((lower[i][k] * lower[j][k] * pivots[k] for k in range(j)), ca.SX(0))
            lower[i][j] = (matrix[i, j] - inner) / pivots[j]
        pivots.append(matrix[i, i] - sum((lower[i][k] ** 2 * pivots[k] for k in range(i)), ca.SX(0)))
    solution: list[ca.SX] = []
    for i in range(n):
        solution.append(rest[i] - sum((lower[i][k] * solution[k] for k in range(i)), ca.SX(0)))
    for i in reversed(range(n)):
        above = sum((lower[k][i] * solution[k] for k in range(i + 1, n)), ca.SX(0))
        solution[i] = solution[i] / pivots[i] - above
    return (_column(solution),)


def _derivatives(build: _Build) -> tuple[ca.SX, ...]:
    torque = _inverse_dynamics(build, moving=True, accelerating=True)
    by_position = ca.densify(ca.jacobian(torque, build.symbols["q"]))
    by_velocity = ca.densify(ca.jacobian(torque, build.symbols["dq"]))
    return by_position, by_velocity, _mass_matrix(build)[0]


def _energy_rows(build: _Build) -> tuple[ca.SX, ca.SX]:
    kinetic: list[ca.SX] = []
    potential: list[ca.SX] = []
    rows = [find_energy_rows(build.recursion.algebra, motion) for motion in build.recursion.motions]
    for link, name in build.base.keys:
        if name in DRIVE:
            drive = find_drive_energy(build.recursion, (link, name))
            kinetic.append(drive[0])
            potential.append(drive[1])
        else:
            kinetic.append(rows[link].kinetic[INERTIAL.index(name)])
            potential.append(rows[link].potential[INERTIAL.index(name)])
    return _column(kinetic), _column(potential)


def _energy(build: _Build) -> tuple[ca.SX, ...]:
    kinetic, potential = _energy_rows(build)
    return ca.dot(kinetic, build.symbols["beta"]), ca.dot(potential, build.symbols["beta"])


def _momentum(build: _Build) -> tuple[ca.SX, ...]:
    columns = find_momentum_columns(build.recursion, build.base.keys)
    return (_from_columns(build, columns),)


def _lagrange(build: _Build) -> tuple[ca.SX, ...]:
    columns = find_lagrange_columns(build.recursion, build.base.keys)
    return (_from_columns(build, columns),)


def _torque(build: _Build) -> tuple[ca.SX, ...]:
    columns = find_torque_columns(build.recursion, build.base.keys)
    return (_from_columns(build, columns),)


def _slotine_li(build: _Build) -> tuple[ca.SX, ...]:
    coordinates = range(build.robot.freedom)
    reference = (
        build.spread([build.symbols["dqr"][k] for k in coordinates]),
        build.spread([build.symbols["ddqr"][k] for k in coordinates]),
    )
    columns = find_slotine_li_columns(build.recursion, reference, build.base.keys)
    return (_from_columns(build, columns),)


def _friction_matrix(build: _Build) -> ca.SX:
    """Return the friction regressor: columns of the representatives, felt where their drive turns."""
    robot, algebra = build.robot, CodeAlgebra()
    velocities = [build.symbols["dq"][k] for k in range(robot.freedom)]
    speeds = spread_coordinates(robot, algebra, velocities)
    matrix = ca.SX.zeros(robot.freedom, len(build.base.friction))
    for k, parameter in enumerate(build.base.friction):
        index, name = parameter.label
        model = FRICTION_MODELS[find_friction(robot, index).kind]
        entry = model.columns(algebra, speeds[index])[model.parameters.index(name)]
        for position, factor in robot.transmission[index]:
            matrix[position, k] = float(factor) * entry
    return ca.densify(matrix)


def _friction(build: _Build) -> tuple[ca.SX, ...]:
    return (_friction_matrix(build) @ build.symbols["f"],)


_BUILDERS: Mapping[str, Callable[[_Build], tuple[ca.SX, ...]]] = {
    "forward_kinematics": _forward_kinematics,
    "jacobian": _jacobian,
    "mass_matrix": _mass_matrix,
    "coriolis_matrix": _coriolis_matrix,
    "gravity": lambda build: (_inverse_dynamics(build, moving=False, accelerating=False),),
    "bias": lambda build: (_inverse_dynamics(build, moving=True, accelerating=False),),
    "inverse_dynamics": lambda build: (_inverse_dynamics(build, moving=True, accelerating=True),),
    "forward_dynamics": _forward_dynamics,
    "inverse_dynamics_derivatives": _derivatives,
    "energy": _energy,
    "energy_regressor": _energy_rows,
    "momentum_regressor": _momentum,
    "lagrange_regressor": _lagrange,
    "torque_regressor": _torque,
    "slotine_li_regressor": _slotine_li,
    "friction": _friction,
    "friction_regressor": lambda build: (_friction_matrix(build),),
}


def _check_symbols(robot: Robot) -> None:
    missing = [name for name in find_symbols(robot) if name not in dict(robot.symbols)]
    if missing:
        text = (
            f"code needs a value for the symbolic length {', '.join(missing)}: add it under [symbols], in m"
        )
        raise RobotError(Notice(code="robot.symbol-without-value", text=text, file=robot.path))


def build_functions(robot: Robot, *, names: tuple[str, ...] | None = None) -> Functions:
    """Return the functions of the catalogue, or those called `names`, in the catalogue's order.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: a name is not in the catalogue.
    """
    _check_symbols(robot)
    base = find_base_parameters(robot)
    catalogue = find_specs(robot.freedom, base.count, len(base.friction))
    known = [spec.name for spec in catalogue]
    for name in names or ():
        if name not in known:
            text = f"function '{name}' is not in the catalogue; there are {', '.join(known)}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))
    specs = tuple(spec for spec in catalogue if names is None or spec.name in names)
    build = _start(robot, base)
    functions = []
    for spec in specs:
        outputs = [ca.densify(output) for output in _BUILDERS[spec.name](build)]
        inputs = [build.symbols[port.name] for port in spec.inputs]
        functions.append(
            ca.Function(
                spec.name, inputs, outputs, [p.name for p in spec.inputs], [p.name for p in spec.outputs]
            )
        )
    return Functions(card=build_model_card(robot, base, specs), functions=tuple(functions))
