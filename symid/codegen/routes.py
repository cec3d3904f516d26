"""All routes to the functions of the catalogue, and the choice of the cheapest one.

A route is a builder: workspace -> elements of all output ports. Lagrange's routes differentiate energies:
p = dT/ddq and tau = dp/dt - dL/dq. Motor torques of an elastic robot follow from the motion of the links
(Spong 1987), with the inverse of the spring:

    tau_J = inverse dynamics,  phi = H^-1[tau_J],  theta = q + phi,  tau_m = IA ddtheta + F(dtheta) + tau_J

Rates of phi are c times those of tau_J, c the slope of phi against tau_J in the direction of motion, which is
constant between kinks. Rates of tau_J come from differentiating the recursion twice in time.

Supported: everything the recursion and the friction models support; stops, knees, friction of the motors.
Not supported: damping, cubic springs and coupled drives in the inverse of a spring.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from symid import dynamics, joint_models
from symid.codegen import equation_routes, programs
from symid.codegen.equation_routes import Elements, Outputs, RouteBuilder, RouteWorkspace
from symid.codegen.functions import FRICTION_INPUTS, Constants, FunctionSpec, list_bristles, list_robot_specs
from symid.dynamics import frame_choice, newton_euler, regressors, torque_derivatives
from symid.notation import INERTIAL
from symid.robot import ZERO, Exact, Robot

Routes = Mapping[str, RouteBuilder]
SpringTerms = joint_models.SpringTerms[int]
# From twelve joints on routes with these words cost 1.1 to 5 times the cheapest, in chains and in trees.
_MOST_TRIED = 16
_COSTLY = ("differentiation", "times parameters", "column recursion", "vector recursion", "unit rates")


def _emit_forward_kinematics(workspace: RouteWorkspace) -> Outputs:
    poses, join = dynamics.compute_link_poses(workspace.recursion), itertools.chain.from_iterable
    rotations = join(join(pose.rotation for pose in poses))
    return tuple(rotations), tuple(join(pose.origin for pose in poses))


def _list_friction_columns(workspace: RouteWorkspace) -> list[list[int]]:
    """Return the friction regressor by columns; friction acts on the coordinates that turn its drive."""
    robot, algebra, given = workspace.robot, workspace.algebra, {"velocity": "dq", **FRICTION_INPUTS}
    # What friction depends on, by its name in laws, of every joint and coupled drive.
    spread = {
        name: tuple(dynamics.spread_coordinates(robot, algebra, workspace.inputs[port]))
        for name, port in given.items()
        if port in workspace.inputs
    }
    columns = []
    for parameter in workspace.base.friction:
        index, name = parameter.label
        friction = dynamics.get_friction(robot, index)
        inputs = {input_name: values[index] for input_name, values in spread.items()}
        entry = dynamics.compute_friction_columns(friction, algebra, inputs)[
            joint_models.list_value_names(friction).index(name)
        ]
        column = [algebra.zero] * robot.freedom
        for position, factor in robot.transmission[index]:
            column[position] = algebra.mul(algebra.constant(Exact.of(factor)), entry)
        columns.append(column)
    return columns


def _combine_columns(
    workspace: RouteWorkspace, columns: Sequence[Sequence[int]], parameters: Sequence[int], rows: int
) -> list[int]:
    """Return the sum of columns times parameters."""
    algebra = workspace.algebra
    total = [algebra.zero] * rows
    for parameter, column in zip(parameters, columns, strict=True):
        entries = zip(total, column, strict=True)
        total = [algebra.add(value, algebra.mul(entry, parameter)) for value, entry in entries]
    return total


def _emit_friction(workspace: RouteWorkspace) -> Outputs:
    columns, parameters = _list_friction_columns(workspace), workspace.inputs["f"]
    return (tuple(_combine_columns(workspace, columns, parameters, workspace.robot.freedom)),)


def _emit_friction_step(workspace: RouteWorkspace) -> tuple[Elements, Elements]:
    """Return friction and deflections after a step: of joints without bristles it is that of the columns."""
    robot, algebra = workspace.robot, workspace.algebra
    parameters, remembering = workspace.inputs["f"], dict(list_bristles(robot))
    labels = [parameter.label for parameter in workspace.base.friction]
    zero, columns = [algebra.zero] * robot.freedom, _list_friction_columns(workspace)
    plain = [zero if at in remembering else row for (at, _), row in zip(labels, columns, strict=True)]
    torques = _combine_columns(workspace, plain, parameters, robot.freedom)
    rates = (workspace.inputs[name] for name in ("dq", "way"))
    velocity, ways = (dynamics.spread_coordinates(robot, algebra, values) for values in rates)
    states, after = iter(workspace.inputs["z"]), list[int]()
    for index, count in remembering.items():
        friction = robot.joints[index].friction
        # A parameter that is grouped with others, such as an offset with a weight, is none of f.
        values = dict.fromkeys(joint_models.list_value_names(friction), algebra.zero)
        pairs = zip(labels, parameters, strict=True)
        values |= {name: value for (owner, name), value in pairs if owner == index}
        known = joint_models.list_memory_values(joint_models.get_law(friction.law), friction)
        values |= {name: algebra.scale(value, algebra.one) for name, value in known.items()}
        before = tuple(itertools.islice(states, count))
        torque, moved = joint_models.advance_memory(algebra, values, velocity[index], ways[index], before)
        after += moved
        ((position, _),) = robot.transmission[index]
        torques[position] = algebra.add(torques[position], torque)
    return tuple(torques), tuple(after)


def _emit_energy_regressor(workspace: RouteWorkspace) -> tuple[Elements, Elements]:
    algebra = workspace.algebra
    rows = [regressors.compute_energy_regressor(algebra, motion) for motion in workspace.recursion.motions]
    pairs = []
    for link, name in workspace.base.keys:
        if name in dynamics.DRIVE_PARAMETERS:
            pairs.append(dynamics.compute_drive_energy(workspace.recursion, (link, name)))
        else:
            place = INERTIAL.index(name)
            pairs.append((rows[link][0][place], rows[link][1][place]))
    return tuple(pair[0] for pair in pairs), tuple(pair[1] for pair in pairs)


def _multiply_parameters(workspace: RouteWorkspace, row: Sequence[int]) -> Elements:
    pairs, algebra = zip(row, workspace.parameters.values(), strict=True), workspace.algebra
    return (algebra.sum_values(algebra.mul(entry, parameter) for entry, parameter in pairs),)


def _emit_energy(workspace: RouteWorkspace) -> tuple[Elements, Elements]:
    kinetic, potential = _emit_energy_regressor(workspace)
    return _multiply_parameters(workspace, kinetic), _multiply_parameters(workspace, potential)


def _emit_energy_of_bodies(workspace: RouteWorkspace) -> Outputs:
    """Return the energies as sums over links and drives."""
    recursion, algebra = workspace.recursion, workspace.algebra
    parameters = workspace.parameters
    bodies = [dynamics.gather_body(algebra, parameters, link) for link in range(workspace.robot.size)]
    pairs = zip(bodies, recursion.motions, strict=True)
    parts = [dynamics.compute_body_energy(algebra, *pair) for pair in pairs]
    for key, value in parameters.items():
        if key[1] in dynamics.DRIVE_PARAMETERS:
            kinetic, potential = dynamics.compute_drive_energy(recursion, key)
            parts.append((algebra.mul(value, kinetic), algebra.mul(value, potential)))
    return tuple((algebra.sum_values([part[place] for part in parts]),) for place in (0, 1))


def _derive_torque(workspace: RouteWorkspace, kinetic: int, potential: int) -> list[int]:
    table, inputs = workspace.algebra, workspace.inputs
    momenta = programs.differentiate_backward(table, kinetic, inputs["dq"])
    slopes = programs.differentiate_backward(table, table.add(kinetic, -potential), inputs["q"])
    moving = (*zip(inputs["q"], inputs["dq"], strict=True), *zip(inputs["dq"], inputs["ddq"], strict=True))
    (rates,) = programs.differentiate_along(table, momenta, [dict(moving)])
    return list(map(table.sub, rates, slopes))


def _emit_derived_mass_matrix(workspace: RouteWorkspace) -> Outputs:
    """Return the mass matrix as dp/ddq."""
    # The velocities are inputs of the momentum only: p is linear in them, its derivatives are free of them.
    table = workspace.algebra
    rates = tuple(table.input(-1, joint) for joint in range(workspace.robot.freedom))
    state = replace(workspace.recursion.state, velocity=workspace.spread(rates))
    moving = replace(workspace, recursion=dynamics.build_recursion(workspace.robot, table, state), built={})
    (kinetic,) = _multiply_parameters(moving, _emit_energy_regressor(moving)[0])
    momenta = programs.differentiate_backward(table, kinetic, rates)
    columns = programs.differentiate_along(table, momenta, [{rate: table.one} for rate in rates])
    return (workspace.flatten_columns(columns),)


def _emit_torques_by_regressor(workspace: RouteWorkspace) -> Outputs:
    parameters = workspace.parameters
    found = dynamics.compute_torque_columns(workspace.meet(lambda link: link).recursion, workspace.base.keys)
    columns, values = [found[key] for key in parameters], tuple(parameters.values())
    torques = _combine_columns(workspace, columns, values, workspace.robot.size)
    return (workspace.flatten_vector(torques),)


def _emit_coriolis_matrix(workspace: RouteWorkspace) -> Outputs:
    """Return C column by column: the torques for dqr = e_k, ddqr = 0, without gravity and springs."""
    algebra = workspace.algebra
    weightless = replace(workspace.recursion, robot=replace(workspace.robot, gravity=(ZERO, ZERO, ZERO)))
    parameters = {key: value for key, value in workspace.parameters.items() if key[1] not in ("KS", "KR")}
    coordinates, zeros = range(workspace.robot.freedom), (algebra.zero,) * workspace.robot.size
    columns = []
    for k in coordinates:
        unit = workspace.spread([algebra.one if j == k else algebra.zero for j in coordinates])
        torques = newton_euler.compute_tensor_torques(weightless, parameters, (unit, zeros))
        columns.append(workspace.flatten_vector(torques))
    return (workspace.flatten_columns(columns),)


def _stop_before_leaves(workspace: RouteWorkspace) -> RouteWorkspace:
    """Return the meeting in a link's own frame, for a link that carries no other in its parent's."""
    # Into a last frame, the screws of all joints would be turned for one link only.
    before = [joint.parent for joint in workspace.robot.joints]
    return workspace.meet(lambda link: link if link in before or before[link] < 0 else before[link])


def _stop_above(depth: int, workspace: RouteWorkspace) -> RouteWorkspace:
    """Return the meeting in the link `depth` links above the first one of its chain, or the link itself."""

    def locate(link: int) -> int:
        path = [link]
        while (parent := workspace.robot.joints[path[0]].parent) >= 0:
            path.insert(0, parent)
        return path[min(depth, len(path) - 1)]

    return workspace.meet(locate)


_SHIFTED, _HELD, _THIRD = "shifted origins", "last links held", "meeting in the third link"
_CHANGES: Mapping[str, Callable[[RouteWorkspace], RouteWorkspace]] = {
    "axis projection": lambda workspace: workspace.meet(lambda link: link),
    "last links one joint down": _stop_before_leaves,
    "meeting in the second link": partial(_stop_above, 1),
    _THIRD: partial(_stop_above, 2),
    "meeting in the fourth link": partial(_stop_above, 3),
    _SHIFTED: RouteWorkspace.shift,
    _HELD: RouteWorkspace.hold,
}
"""What a route may do before it builds, by the words that its name has for it."""


def _list_variants(*names: tuple[str, ...], build: RouteBuilder) -> Routes:
    """Return routes that build the same after what the words of their names say, one after the other."""

    def build_changed(workspace: RouteWorkspace, words: tuple[str, ...]) -> Outputs:
        for word in words:
            workspace = _CHANGES[word](workspace) if word in _CHANGES else workspace
        return build(workspace)

    return {
        ", ".join(words): partial(build_changed, words=words) if {*words} & _CHANGES.keys() else build
        for words in names
    }


def _list_four(name: str, build: RouteBuilder) -> Routes:
    """Return a route, also with link origins along their axes, with last links in fixed axes, or both."""
    return _list_variants((name,), (name, _SHIFTED), (name, _HELD), (name, _SHIFTED, _HELD), build=build)


def _list_regressor_routes(
    compute: Callable[..., regressors.Columns[int]],
    derive: Callable[[RouteWorkspace, int, int], list[int]] | None = None,
    also: tuple[str, ...] = (),
) -> Routes:
    """Return the routes to a regressor: by recursion, and with `derive` from the energies."""
    # `also` names the inputs that `compute` takes besides the state.

    def build(workspace: RouteWorkspace) -> Outputs:
        given = tuple(workspace.spread(workspace.inputs[name]) for name in also)
        keys = workspace.base.keys
        columns = compute(workspace.recursion, keys, *((given,) if given else ()))
        return (workspace.flatten_columns([workspace.flatten_vector(columns[key]) for key in keys]),)

    def build_derived(workspace: RouteWorkspace) -> Outputs:
        pairs = zip(*_emit_energy_regressor(workspace), strict=True)
        columns = [derive(workspace, t, v) for t, v in pairs] if derive else []
        return (workspace.flatten_columns(columns),)

    axes = "axis projection"
    names = (("column recursion",), (axes,), (axes, "last links one joint down"))
    routes = _list_variants(*names, build=build)
    return {**routes, "differentiation of the energy": build_derived} if derive else routes


def _emit_mass_matrix(workspace: RouteWorkspace) -> Outputs:
    """Return the mass matrix by composite bodies."""
    matrix = dynamics.compute_mass_matrix(workspace.recursion, workspace.parameters)
    return (workspace.flatten_matrix(matrix),)


def _list_springs(workspace: RouteWorkspace, memory: str) -> list[tuple[SpringTerms, Elements]]:
    """Return the springs of all coordinates, from h, each with its plays, which input `memory` holds."""
    rest, plays = iter(workspace.inputs["h"]), iter(workspace.inputs.get(memory, ()))
    springs = []
    for elasticity in (joint.elasticity for joint in workspace.robot.axes if joint.elasticity):
        stiffness = next(rest)
        cubic = next(rest) if elasticity.cubic else None
        stops = [(next(rest), next(rest)) for _ in elasticity.stops]
        knees = [(next(rest), next(rest)) for _ in elasticity.knees]
        turned = tuple((threshold, slope) for slope, threshold in knees)
        count = sum(knee.threshold < 0 for knee in elasticity.knees)
        spring = joint_models.SpringTerms(
            stiffness=stiffness,
            cubic=cubic,
            stops=tuple((threshold, weight) for weight, threshold in stops),
            above=turned[count:],
            below=turned[:count][::-1],
        )
        springs.append((spring, tuple(itertools.islice(plays, len(stops)))))
    return springs


def _emit_hysteresis(workspace: RouteWorkspace, given: str, memory: str) -> Outputs:
    """Return torques from torsions phi and plays P, or back from torques tau_J and plays Q; and the plays."""
    algebra, steps = workspace.algebra, []
    for (spring, plays), value in zip(_list_springs(workspace, memory), workspace.inputs[given], strict=True):
        if given == "phi":
            steps.append(joint_models.advance_spring(algebra, spring, value, plays))
        else:
            inverse = joint_models.invert_spring(algebra, spring)
            steps.append(joint_models.advance_inverse_spring(algebra, inverse, value, plays))
    after = tuple(itertools.chain(*(play for _, play in steps)))
    return (tuple(found for found, _ in steps), *((after,) if after else ()))


def _emit_feed_forward(workspace: RouteWorkspace, torques: RouteBuilder) -> Outputs:
    """Return the torques of the motors, with those of the links from another route."""
    algebra, inputs = workspace.algebra, workspace.inputs
    seeds: dict[int, int] = {}
    for name, rate_name in itertools.pairwise(("q", "dq", "ddq", "dddq", "ddddq")):
        seeds |= dict(zip(inputs[name], inputs[rate_name], strict=True))
    (values,) = workspace.recall(torques)
    (rates,) = programs.differentiate_along(algebra, values, [seeds])
    (seconds,) = programs.differentiate_along(algebra, rates, [seeds])
    turned, turning, bending, after = list[int](), list[int](), list[int](), list[int]()
    springs = zip(_list_springs(workspace, "Q"), values, rates, seconds, strict=True)
    for (spring, memory), torque, rate, second in springs:
        # Torsion, its two rates and the plays after the step, from a torque and its two rates.
        inverse = joint_models.invert_spring(algebra, spring)
        plays, above, below = inverse
        value, moved = joint_models.advance_inverse_spring(algebra, inverse, torque, memory)
        before, outer = joint_models.compute_outer_function(algebra, torque, above, below), algebra.one
        beyond = [(slope, algebra.apply(programs.Op.LESS, threshold, torque)) for threshold, slope in above]
        beyond += [(slope, algebra.apply(programs.Op.LESS, torque, threshold)) for threshold, slope in below]
        for slope, active in beyond:
            outer = algebra.add(outer, algebra.mul(slope, active))
        total = plays.weights[0]
        signs = ((algebra.zero, rate), (rate, algebra.zero))
        rising, falling = (algebra.apply(programs.Op.LESS, *pair) for pair in signs)
        for weight, threshold, play in zip(plays.weights[1:], plays.thresholds, memory, strict=True):
            # A play at its edge moves with the torque only while that goes on beyond the edge.
            up = algebra.apply(programs.Op.LESS_EQUAL, play, algebra.sub(before, threshold))
            down = algebra.apply(programs.Op.LESS_EQUAL, algebra.add(before, threshold), play)
            moves = algebra.add(algebra.mul(up, rising), algebra.mul(down, falling))
            total = algebra.add(total, algebra.mul(weight, moves))
        compliance = algebra.mul(total, outer)
        turned.append(value)
        turning.append(algebra.mul(compliance, rate))
        bending.append(algebra.mul(compliance, second))
        after += moved
    theta = tuple(map(algebra.add, inputs["q"], turned))
    dtheta = tuple(map(algebra.add, inputs["dq"], turning))
    motion = {"dq": dtheta, "q": theta, "load": tuple(values)}
    (friction,) = _emit_friction(replace(workspace, inputs={**inputs, **motion}, built={}))
    motors = []
    for k, bent in enumerate(bending):
        inertial = algebra.mul(inputs["IA"][k], algebra.add(inputs["ddq"][k], bent))
        motors.append(algebra.add(algebra.add(inertial, friction[k]), values[k]))
    return (tuple(motors), theta, dtheta, *((tuple(after),) if after else ()))


_BODIES = "composite bodies"
_MASS_ROUTES: Routes = _list_variants(
    (_BODIES,),
    (_BODIES, "meeting in the second link"),
    (_BODIES, _THIRD),
    (_BODIES, _SHIFTED),
    build=_emit_mass_matrix,
)
_RECURSION_ROUTES: Routes = {
    "vector recursion": lambda w: (
        w.flatten_vector(dynamics.compute_inverse_dynamics(w.recursion, w.parameters)),
    ),
    **_list_four(
        "tensor recursion",
        lambda w: (w.flatten_vector(newton_euler.compute_tensor_torques(w.recursion, w.parameters)),),
    ),
}
_TORQUE_ROUTES: Routes = {
    **_RECURSION_ROUTES,
    "regressor times parameters": _emit_torques_by_regressor,
    "differentiation of the energy": lambda w: (
        tuple(_derive_torque(w, *itertools.chain(*_emit_energy(w)))),
    ),
}


def _differentiate(route: RouteBuilder, *by: str, rest: RouteBuilder | None = None) -> RouteBuilder:
    """Return the builder of the derivatives of what a route makes by the inputs `by`, then of `rest`."""

    def build(workspace: RouteWorkspace) -> Outputs:
        (values,) = workspace.recall(route)
        blocks = [workspace.differentiate(values, name) for name in by]
        return (*map(workspace.flatten_columns, blocks), *(workspace.recall(rest) if rest else ()))

    return build


def _list_composite_routes(build: RouteBuilder) -> Routes:
    """Return the routes whose wrenches of composite bodies go down to every joint, or stop before."""
    # Last links are held in all of them: their composite bodies are carried without a turn.
    starts = ((_BODIES,), (_BODIES, _THIRD), (_BODIES, "meeting in the fourth link"))
    endings = ((_HELD,), (_SHIFTED, _HELD))
    names = [(*start, *ending) for start, ending in itertools.product(starts, endings)]
    return _list_variants(*names, build=build)


def _pair_routes(build: Callable[..., Outputs]) -> Routes:
    """Return the routes of what takes a mass matrix and torques."""
    return {
        f"{mass}; {torques}": partial(build, mass=_MASS_ROUTES[mass], torques=route)
        for mass in _MASS_ROUTES
        for torques, route in _RECURSION_ROUTES.items()
    }


_ARTICULATED, _SUM = "articulated bodies", "sum over bodies"
_FORWARD_ROUTES: Routes = {
    **_pair_routes(equation_routes.build_forward_dynamics),
    **_list_four(_ARTICULATED, equation_routes.build_articulated),
}
_TORQUE_REGRESSOR_ROUTES = _list_regressor_routes(dynamics.compute_torque_columns, _derive_torque)
ROUTES: Mapping[str, Routes] = {
    "forward_kinematics": {"chain of frames": _emit_forward_kinematics},
    "jacobian": {
        "axes in the base frame": lambda w: (
            tuple(itertools.chain(*map(w.flatten_vector, dynamics.compute_jacobian(w.recursion)))),
        )
    },
    "mass_matrix": {**_MASS_ROUTES, "differentiation of the energy": _emit_derived_mass_matrix},
    "coriolis_matrix": {
        **_list_composite_routes(
            lambda w: (
                w.flatten_matrix(torque_derivatives.compute_coriolis_matrix(w.recursion, w.parameters)),
            )
        ),
        **_list_four("torques of unit rates", _emit_coriolis_matrix),
    },
    "gravity": _TORQUE_ROUTES,
    "bias": _TORQUE_ROUTES,
    "inverse_dynamics": _TORQUE_ROUTES,
    "forward_dynamics": _FORWARD_ROUTES,
    "partial_inverse_dynamics": _pair_routes(equation_routes.build_partial_inverse),
    "partial_forward_dynamics": _FORWARD_ROUTES,
    "inverse_dynamics_derivatives": {
        **_list_composite_routes(equation_routes.build_derivatives),
        **{
            f"differentiation of the {name}": _differentiate(
                _RECURSION_ROUTES[name], "q", "dq", rest=_emit_mass_matrix
            )
            for name in ("tensor recursion", "tensor recursion, last links held")
        },
    },
    "forward_dynamics_derivatives": _list_composite_routes(equation_routes.build_forward_derivatives),
    "mass_matrix_derivatives": {
        **_list_composite_routes(equation_routes.build_mass_derivatives),
        "differentiation of composite bodies": _differentiate(_emit_mass_matrix, "q"),
    },
    "inverse_dynamics_second_derivatives": _list_composite_routes(equation_routes.build_second_derivatives),
    "energy": {
        "regressor times parameters": _emit_energy,
        **_list_variants((_SUM,), (_SUM, _SHIFTED), (_SUM, _HELD), build=_emit_energy_of_bodies),
    },
    "energy_regressor": {"recursion": _emit_energy_regressor},
    "momentum_regressor": _list_regressor_routes(
        regressors.compute_momentum_columns,
        lambda w, t, _: programs.differentiate_backward(w.algebra, t, w.inputs["dq"]),
    ),
    "lagrange_regressor": _list_regressor_routes(
        regressors.compute_lagrange_columns,
        lambda w, t, v: programs.differentiate_backward(w.algebra, w.algebra.add(t, -v), w.inputs["q"]),
    ),
    "torque_regressor": _TORQUE_REGRESSOR_ROUTES,
    "torque_regressor_derivatives": {
        f"{name}, differentiated": _differentiate(route, "q", "dq", "ddq")
        for name, route in _TORQUE_REGRESSOR_ROUTES.items()
    },
    "slotine_li_regressor": _list_regressor_routes(dynamics.compute_torque_columns, also=("dqr", "ddqr")),
    "friction": {"regressor times parameters": _emit_friction},
    "friction_regressor": {
        "columns of the joint models": lambda w: (w.flatten_columns(_list_friction_columns(w)),)
    },
    "friction_step": {"bristles and columns": _emit_friction_step},
    "hysteresis_step": {"plays": partial(_emit_hysteresis, given="phi", memory="P")},
    "hysteresis_inverse_step": {"plays of the inverse": partial(_emit_hysteresis, given="tau_J", memory="Q")},
    "elastic_inverse_dynamics": {
        name: partial(_emit_feed_forward, torques=build) for name, build in _RECURSION_ROUTES.items()
    },
}
"""Per function of the catalogue its routes by name; of routes that cost the same the first is taken."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteCount:
    """The operations of one route to a function, and whether it is the one that is emitted."""

    function: str
    route: str
    operations: programs.Operations
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteChoice:
    """The program of the route with the fewest operations, and the counts of all routes to its function."""

    program: programs.Program
    counts: tuple[RouteCount, ...]


def list_routes(robot: Robot, function: str) -> Routes:
    """Return the routes to a function for this robot, by their names."""
    routes = ROUTES[function]
    if robot.freedom == robot.size and not robot.couplings:
        return routes
    # Joints that share a coordinate or a drive are not free one by one.
    return {name: build for name, build in routes.items() if not name.startswith(_ARTICULATED)}


def choose_route(
    robot: Robot, base: dynamics.BaseParameters, spec: FunctionSpec, constants: Constants | None = None
) -> RouteChoice:
    """Return the route to `spec` with the fewest products and sums, and the counts of all its routes.

    Constant turns about joint axes are part of the placements or of the joints' angles, whichever costs less.
    """
    turns = frame_choice.list_constant_rotations(robot)
    choices = []
    for turned in (None, turns) if turns else (None,):
        workspace = equation_routes.build_workspace(robot, base, spec, turned, constants)
        table = workspace.algebra
        routes = list_routes(robot, spec.name)
        if robot.freedom > _MOST_TRIED:
            # Only those with a chance, for each takes seconds.
            costly = {name for name in routes if any(word in name for word in _COSTLY)}
            routes = {name: routes[name] for name in routes if name not in costly} or routes
        built, counts = dict[str, Outputs](), dict[str, programs.Operations]()
        for name, build in routes.items():
            built[name] = workspace.build_outputs(spec, build)
            counts[name] = table.count(itertools.chain(*built[name]))
        costs = {name: count.mul + count.add for name, count in counts.items()}
        chosen = min(costs, key=costs.__getitem__)
        rows = (
            RouteCount(function=spec.name, route=name, operations=count, chosen=name == chosen)
            for name, count in counts.items()
        )
        whole = table.build_program(spec, built[chosen])
        # Their matrices share most values: 2 to 5 % of the time.
        order = programs.order_by_growth(whole) if spec.name.endswith("derivatives") else None
        choices.append(RouteChoice(program=programs.build_depth_first(whole, order), counts=tuple(rows)))
    old, new = (programs.count_operations(choice.program) for choice in (choices[0], choices[-1]))
    cheaper = new.mul + new.add < old.mul + old.add and new.trig <= old.trig
    return choices[-1] if cheaper else choices[0]


def count_route_operations(robot: Robot) -> tuple[RouteCount, ...]:
    """Return the operations of every route to every function of the catalogue.

    Raises:
        RobotError: a symbolic length has no value.
    """
    equation_routes.check_symbols(robot)
    base = dynamics.derive_base_parameters(robot)
    specs = list_robot_specs(robot, base)
    return tuple(count for spec in specs for count in choose_route(robot, base, spec).counts)
