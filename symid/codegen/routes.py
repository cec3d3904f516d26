"""All routes to the functions of the catalogue, and the choice among them.

Robot -> `RouteChoice`: per function the program of the route with the fewest operations, and all counts.

Supported: everything the dynamics supports.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from symid.codegen.catalogue import list_robot_specs
from symid.codegen.functions import FunctionSpec
from symid.codegen.model_card import Constants
from symid.codegen.programs import Operations, Program, build_depth_first, count_operations
from symid.codegen.route_builders import (
    ProjectionPlace,
    build_derivatives_route,
    build_feed_forward_route,
    build_forward_dynamics_route,
    build_mass_matrix_route,
    build_regressor_route,
    build_torque_derivatives_route,
    emit_coriolis_matrix,
    emit_derived_lagrange_regressor,
    emit_derived_mass_matrix,
    emit_derived_momentum_regressor,
    emit_derived_torque_regressor,
    emit_derived_torques,
    emit_energy,
    emit_energy_of_bodies,
    emit_energy_regressor,
    emit_forward_kinematics,
    emit_friction,
    emit_friction_regressor,
    emit_hysteresis_inverse_step,
    emit_hysteresis_step,
    emit_jacobian,
    emit_mass_matrix,
    emit_torques_by_regressor,
    emit_torques_by_tensors,
    emit_torques_by_vectors,
)
from symid.codegen.workspace import (
    RouteBuilder,
    RouteWorkspace,
    build_workspace,
    check_symbols,
    project_before_leaves,
    project_in_link,
)
from symid.dynamics import BaseParameters, derive_base_parameters, list_constant_rotations
from symid.robot import Robot

Routes = Mapping[str, RouteBuilder]


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteCount:
    """The operations of one route to a function, and whether it is the one that is emitted."""

    function: str
    route: str
    operations: Operations
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteChoice:
    """The program of the route with the fewest operations, and the counts of all routes to its function."""

    program: Program
    counts: tuple[RouteCount, ...]


_PROJECTION_PLACES: Mapping[str, ProjectionPlace | None] = {
    "column recursion": None,
    "axis projection": project_in_link,
    "axis projection, last links one joint down": project_before_leaves,
}


def _shift_origins(build: RouteBuilder) -> RouteBuilder:
    """Return the route with link origins moved along their joints' axes."""
    return lambda workspace: build(workspace.shift())


def _hold_last_links(build: RouteBuilder) -> RouteBuilder:
    """Return the route with the last links in axes that do not turn with them."""
    return lambda workspace: build(workspace.hold())


_MASS_ROUTES: Routes = {
    "composite bodies": emit_mass_matrix,
    "composite bodies, meeting in the second link": build_mass_matrix_route(1),
    "composite bodies, meeting in the third link": build_mass_matrix_route(2),
    "composite bodies, shifted origins": _shift_origins(emit_mass_matrix),
}
_RECURSION_ROUTES: Routes = {
    "vector recursion": emit_torques_by_vectors,
    "tensor recursion": emit_torques_by_tensors,
    "tensor recursion, shifted origins": _shift_origins(emit_torques_by_tensors),
    "tensor recursion, last links held": _hold_last_links(emit_torques_by_tensors),
    "tensor recursion, shifted origins, last links held": _shift_origins(
        _hold_last_links(emit_torques_by_tensors)
    ),
}
_TORQUE_ROUTES: Routes = {
    **_RECURSION_ROUTES,
    "regressor times parameters": emit_torques_by_regressor,
    "differentiation of the energy": emit_derived_torques,
}


def _list_regressor_routes(name: str, derived: RouteBuilder | None = None) -> Routes:
    routes = {label: build_regressor_route(name, place) for label, place in _PROJECTION_PLACES.items()}
    return routes if derived is None else {**routes, "differentiation of the energy": derived}


def _combine_routes(build: Callable[[RouteBuilder, RouteBuilder], RouteBuilder], parts: Routes) -> Routes:
    """Return the routes that take a mass matrix and `parts` from other routes."""
    return {
        f"{mass}; {part}": build(_MASS_ROUTES[mass], parts[part]) for mass in _MASS_ROUTES for part in parts
    }


_DERIVATIVE_ROUTES: Routes = {
    name: build_torque_derivatives_route(build) for name, build in _RECURSION_ROUTES.items()
}
ROUTES: Mapping[str, Routes] = {
    "forward_kinematics": {"chain of frames": emit_forward_kinematics},
    "jacobian": {"axes in the base frame": emit_jacobian},
    "mass_matrix": {**_MASS_ROUTES, "differentiation of the energy": emit_derived_mass_matrix},
    "coriolis_matrix": {
        "torques of unit rates": emit_coriolis_matrix,
        "torques of unit rates, shifted origins": _shift_origins(emit_coriolis_matrix),
        "torques of unit rates, last links held": _hold_last_links(emit_coriolis_matrix),
        "torques of unit rates, shifted origins, last links held": _shift_origins(
            _hold_last_links(emit_coriolis_matrix)
        ),
    },
    "gravity": _TORQUE_ROUTES,
    "bias": _TORQUE_ROUTES,
    "inverse_dynamics": _TORQUE_ROUTES,
    "forward_dynamics": _combine_routes(build_forward_dynamics_route, _RECURSION_ROUTES),
    "inverse_dynamics_derivatives": _combine_routes(build_derivatives_route, _DERIVATIVE_ROUTES),
    "energy": {
        "regressor times parameters": emit_energy,
        "sum over bodies": emit_energy_of_bodies,
        "sum over bodies, shifted origins": _shift_origins(emit_energy_of_bodies),
        "sum over bodies, last links held": _hold_last_links(emit_energy_of_bodies),
    },
    "energy_regressor": {"recursion": emit_energy_regressor},
    "momentum_regressor": _list_regressor_routes("momentum_regressor", emit_derived_momentum_regressor),
    "lagrange_regressor": _list_regressor_routes("lagrange_regressor", emit_derived_lagrange_regressor),
    "torque_regressor": _list_regressor_routes("torque_regressor", emit_derived_torque_regressor),
    "slotine_li_regressor": _list_regressor_routes("slotine_li_regressor"),
    "friction": {"regressor times parameters": emit_friction},
    "friction_regressor": {"columns of the joint models": emit_friction_regressor},
    "hysteresis_step": {"plays": emit_hysteresis_step},
    "hysteresis_inverse_step": {"plays of the inverse": emit_hysteresis_inverse_step},
    "elastic_inverse_dynamics": {
        name: build_feed_forward_route(build) for name, build in _RECURSION_ROUTES.items()
    },
}
"""Per function of the catalogue its routes by name; of routes that cost the same the first is taken."""


def _choose_in_workspace(workspace: RouteWorkspace, spec: FunctionSpec) -> RouteChoice:
    """Return the cheapest route of one workspace."""
    table = workspace.table
    built = {name: workspace.recall(build) for name, build in ROUTES[spec.name].items()}
    counts = {name: table.count(ref for port in ports for ref in port) for name, ports in built.items()}
    chosen = min(counts, key=lambda name: counts[name].mul + counts[name].add)
    return RouteChoice(
        program=build_depth_first(table.build_program(spec, built[chosen])),
        counts=tuple(
            RouteCount(function=spec.name, route=name, operations=count, chosen=name == chosen)
            for name, count in counts.items()
        ),
    )


def choose_route(
    robot: Robot, base: BaseParameters, spec: FunctionSpec, constants: Constants | None = None
) -> RouteChoice:
    """Return the route to `spec` with the fewest products and sums, and the counts of all its routes.

    Constant turns about joint axes are part of the placements or of the joints' angles, whichever costs less.
    """
    choice = _choose_in_workspace(build_workspace(robot, base, spec, constants=constants), spec)
    turns = list_constant_rotations(robot)
    if turns:
        other = _choose_in_workspace(build_workspace(robot, base, spec, turns, constants), spec)
        new, old = count_operations(other.program), count_operations(choice.program)
        if new.mul + new.add < old.mul + old.add and new.trig <= old.trig:
            return other
    return choice


def count_route_operations(robot: Robot) -> tuple[RouteCount, ...]:
    """Return the operations of every route to every function of the catalogue.

    Raises:
        RobotError: a symbolic length has no value.
    """
    check_symbols(robot)
    base = derive_base_parameters(robot)
    specs = list_robot_specs(robot, base)
    return tuple(count for spec in specs for count in choose_route(robot, base, spec).counts)
