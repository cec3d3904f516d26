"""All routes to the functions of the catalogue, and the choice among them.

Input: a robot. Output: `Choice`: per function the program of the route with the fewest operations, and the
counts of all.

Supported: everything the dynamics supports.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from symid.codegen.catalogue import find_robot_specs
from symid.codegen.constants import Constants
from symid.codegen.elastic_routes import (
    build_feed_forward,
    build_hysteresis_inverse_step,
    build_hysteresis_step,
)
from symid.codegen.energy_routes import (
    build_energy,
    build_energy_of_bodies,
    build_energy_rows,
    derive_lagrange_columns,
    derive_mass_matrix,
    derive_momentum_columns,
    derive_torque_columns,
    derive_torques,
)
from symid.codegen.functions import FunctionSpec
from symid.codegen.instructions import Operations, Program, count_operations
from symid.codegen.matrix_routes import (
    build_derivatives,
    build_forward_dynamics,
    build_mass_matrix,
    build_mass_matrix_at,
    differentiate_torques,
)
from symid.codegen.meetings import meet_before_leaves, meet_in_link
from symid.codegen.plain_routes import (
    build_forward_kinematics,
    build_friction,
    build_friction_matrix,
    build_jacobian,
)
from symid.codegen.regressor_routes import (
    Place,
    build_lagrange_columns,
    build_momentum_columns,
    build_slotine_li_columns,
    build_torque_columns,
)
from symid.codegen.scheduling import build_depth_first
from symid.codegen.torque_routes import (
    build_coriolis_matrix,
    build_torques_by_regressor,
    build_torques_by_tensors,
    build_torques_by_vectors,
)
from symid.codegen.workspace import Build, Workspace, build_workspace, check_symbols
from symid.dynamics.turns import find_turns
from symid.parameters.base import BaseParameters, find_base_parameters
from symid.robot.description import Robot

__all__ = ["ROUTES", "Choice", "RouteCount", "choose_route", "find_route_counts"]

Routes = Mapping[str, Build]


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteCount:
    """The operations of one route to a function, and whether it is the one that is emitted."""

    function: str
    route: str
    operations: Operations
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The program of the route with the fewest operations, and the counts of all routes to its function."""

    program: Program
    counts: tuple[RouteCount, ...]


_PLACES: Mapping[str, Place | None] = {
    "column recursion": None,
    "axis projection": meet_in_link,
    "axis projection, last links one joint down": meet_before_leaves,
}


def _shift(build: Build) -> Build:
    """Return the route with link origins moved along their joints' axes."""
    return lambda workspace: build(workspace.shift())


def _hold(build: Build) -> Build:
    """Return the route with the last links in axes that do not turn with them."""
    return lambda workspace: build(workspace.hold())


_MASS: Routes = {
    "composite bodies": build_mass_matrix,
    "composite bodies, meeting in the second link": build_mass_matrix_at(1),
    "composite bodies, meeting in the third link": build_mass_matrix_at(2),
    "composite bodies, shifted origins": _shift(build_mass_matrix),
}
_RECURSIONS: Routes = {
    "vector recursion": build_torques_by_vectors,
    "tensor recursion": build_torques_by_tensors,
    "tensor recursion, shifted origins": _shift(build_torques_by_tensors),
    "tensor recursion, last links held": _hold(build_torques_by_tensors),
    "tensor recursion, shifted origins, last links held": _shift(_hold(build_torques_by_tensors)),
}
_TORQUE: Routes = {
    **_RECURSIONS,
    "regressor times parameters": build_torques_by_regressor,
    "differentiation of the energy": derive_torques,
}


def _meet(find: Callable[[Place | None], Build], derived: Build | None = None) -> Routes:
    routes = {name: find(place) for name, place in _PLACES.items()}
    return routes if derived is None else {**routes, "differentiation of the energy": derived}


def _combine(build: Callable[[Build, Build], Build], parts: Routes) -> Routes:
    """Return the routes that take a mass matrix and `parts` from other routes."""
    return {f"{mass}; {part}": build(_MASS[mass], parts[part]) for mass in _MASS for part in parts}


_SLOPES: Routes = {name: differentiate_torques(build) for name, build in _RECURSIONS.items()}
ROUTES: Mapping[str, Routes] = {
    "forward_kinematics": {"chain of frames": build_forward_kinematics},
    "jacobian": {"axes in the base frame": build_jacobian},
    "mass_matrix": {**_MASS, "differentiation of the energy": derive_mass_matrix},
    "coriolis_matrix": {
        "torques of unit rates": build_coriolis_matrix,
        "torques of unit rates, shifted origins": _shift(build_coriolis_matrix),
        "torques of unit rates, last links held": _hold(build_coriolis_matrix),
        "torques of unit rates, shifted origins, last links held": _shift(_hold(build_coriolis_matrix)),
    },
    "gravity": _TORQUE,
    "bias": _TORQUE,
    "inverse_dynamics": _TORQUE,
    "forward_dynamics": _combine(build_forward_dynamics, _RECURSIONS),
    "inverse_dynamics_derivatives": _combine(build_derivatives, _SLOPES),
    "energy": {
        "regressor times parameters": build_energy,
        "sum over bodies": build_energy_of_bodies,
        "sum over bodies, shifted origins": _shift(build_energy_of_bodies),
        "sum over bodies, last links held": _hold(build_energy_of_bodies),
    },
    "energy_regressor": {"recursion": build_energy_rows},
    "momentum_regressor": _meet(build_momentum_columns, derive_momentum_columns),
    "lagrange_regressor": _meet(build_lagrange_columns, derive_lagrange_columns),
    "torque_regressor": _meet(build_torque_columns, derive_torque_columns),
    "slotine_li_regressor": _meet(build_slotine_li_columns),
    "friction": {"regressor times parameters": build_friction},
    "friction_regressor": {"columns of the joint models": build_friction_matrix},
    "hysteresis_step": {"plays": build_hysteresis_step},
    "hysteresis_inverse_step": {"plays of the inverse": build_hysteresis_inverse_step},
    "elastic_inverse_dynamics": {name: build_feed_forward(build) for name, build in _RECURSIONS.items()},
}
"""Per function of the catalogue its routes by name; of routes that cost the same the first is taken."""


def _choose(workspace: Workspace, spec: FunctionSpec) -> Choice:
    """Return the cheapest route of one workspace."""
    table = workspace.table
    built = {name: workspace.recall(build) for name, build in ROUTES[spec.name].items()}
    counts = {name: table.count(ref for port in ports for ref in port) for name, ports in built.items()}
    chosen = min(counts, key=lambda name: counts[name].mul + counts[name].add)
    instructions, outputs = table.collect(built[chosen])
    return Choice(
        program=build_depth_first(Program(spec=spec, instructions=instructions, outputs=outputs)),
        counts=tuple(
            RouteCount(function=spec.name, route=name, operations=count, chosen=name == chosen)
            for name, count in counts.items()
        ),
    )


def _is_cheaper(other: Choice, choice: Choice) -> bool:
    new, old = count_operations(other.program), count_operations(choice.program)
    return new.mul + new.add < old.mul + old.add and new.trig <= old.trig


def choose_route(
    robot: Robot, base: BaseParameters, spec: FunctionSpec, constants: Constants | None = None
) -> Choice:
    """Return the route to `spec` with the fewest products and sums, and the counts of all its routes.

    Constant turns about joint axes are part of the placements or of the joints' angles, whichever costs less.
    """
    choice = _choose(build_workspace(robot, base, spec, constants=constants), spec)
    turns = find_turns(robot)
    if turns:
        other = _choose(build_workspace(robot, base, spec, turns, constants), spec)
        choice = other if _is_cheaper(other, choice) else choice
    return choice


def find_route_counts(robot: Robot) -> tuple[RouteCount, ...]:
    """Return the operations of every route to every function of the catalogue.

    Raises:
        RobotError: a symbolic length has no value.
    """
    check_symbols(robot)
    base = find_base_parameters(robot)
    specs = find_robot_specs(robot, base)
    return tuple(count for spec in specs for count in choose_route(robot, base, spec).counts)
