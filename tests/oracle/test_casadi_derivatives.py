"""Derivatives of the CasADi functions: differences, closed forms; the shapes that users meet."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from symid.codegen.casadi_functions import build_casadi_function, build_functions
from symid.codegen.functions import build_spring_vector
from symid.joint_models import FrictionValues
from symid.robot import load_robot
from tests.chains import assert_close, build_chain
from tests.friction_forms import EVERY_LAW, give_shape


def find_jacobian(function, place, inputs, output=0):
    """Return the derivative of an output, by elements column by column, with respect to one input."""
    symbols = [ca.SX.sym(function.name_in(k), *function.size_in(k)) for k in range(function.n_in())]
    value = ca.vec(function.call(symbols)[output])
    derivative = ca.Function("derivative", symbols, [ca.densify(ca.jacobian(value, symbols[place]))])
    return np.array(derivative.call([ca.DM(entry) for entry in inputs])[0])


def find_differences(function, place, inputs, step, output=0):
    """Return the same by central differences of fourth order: [8 (f1 - f-1) - (f2 - f-2)] / 12 h."""

    def evaluate(shift):
        moved = [np.array(entry, dtype=float) for entry in inputs]
        moved[place] = moved[place] + shift
        return np.array(function.call(moved)[output]).ravel(order="F")

    columns = []
    for unit in step * np.eye(len(inputs[place])):
        near, far = evaluate(unit) - evaluate(-unit), evaluate(2 * unit) - evaluate(-2 * unit)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(
    "name", ["forward_dynamics", "inverse_dynamics", "mass_matrix", "energy", "jacobian"]
)
def test_derivatives_equal_differences(name):
    robot = load_robot("two_link")
    (spec,) = build_functions(robot, names=(name,)).card.functions
    rng = np.random.default_rng(4)
    # A mass matrix far from singular: beta of ZZR1 = 3, ZZ2 = 1, the rest small.
    inputs = [rng.uniform(-1, 1, port.shape) for port in spec.inputs]
    function = build_casadi_function(robot, name)
    if "beta" in [port.name for port in spec.inputs]:
        inputs[-1] = np.array([4.0, 0.3, 0.2, 1.0, 0.3, 0.1, 0.2, 0.4][: len(inputs[-1])])
    for place in range(len(inputs)):
        for output in range(len(spec.outputs)):
            found = find_jacobian(function, place, inputs, output)
            assert_close(found, find_differences(function, place, inputs, 1e-3, output), 1e-9)


def test_derivatives_of_the_inverse_dynamics_are_the_function_of_that_name():
    robot = load_robot("panda")
    inverse = build_casadi_function(robot, "inverse_dynamics")
    derivatives = build_casadi_function(robot, "inverse_dynamics_derivatives")
    rng = np.random.default_rng(5)
    inputs = [rng.uniform(-2, 2, inverse.size1_in(k)) for k in range(4)]
    for place, expected in enumerate(derivatives.call(inputs)):
        assert_close(find_jacobian(inverse, place, inputs), np.array(expected), 1e-12)


@pytest.fixture(scope="module")
def arm():
    return load_robot("two_link_elastic")


def compute_slopes(spring, phi, plays):
    """Return d tau_J/d phi and d tau_J/d P of one spring in closed form, away from its corners."""
    pairs = list(zip(spring.stops, plays, strict=True))
    after = [max(phi - stop.threshold, min(phi + stop.threshold, play)) for stop, play in pairs]
    held = [stop.stiffness * (play == moved) for (stop, play), moved in zip(pairs, after, strict=True)]
    v = spring.stiffness * phi
    v += sum(stop.stiffness * (phi - moved) for stop, moved in zip(spring.stops, after, strict=True))
    beyond = [knee for knee in spring.knees if abs(v) > abs(knee.threshold) and v * knee.threshold > 0]
    outer = 1.0 + sum(knee.slope for knee in beyond)
    return outer * (spring.stiffness + sum(held)), [-outer * stiffness for stiffness in held]


def test_slopes_of_the_springs_are_those_of_the_stops_that_hold(arm):
    step = build_casadi_function(arm, "hysteresis_step")
    springs = [joint.elasticity for joint in arm.joints]
    h, rng, seen = build_spring_vector(springs), np.random.default_rng(6), set()
    for _ in range(40):
        phi = rng.uniform(-0.03, 0.03, 2)
        plays = [phi[k] + rng.uniform(-0.012, 0.012, len(s.stops)) for k, s in enumerate(springs)]
        inputs = (phi, np.concatenate(plays), h)
        found, memory = find_jacobian(step, 0, inputs), find_jacobian(step, 1, inputs)
        slopes = [compute_slopes(*entry) for entry in zip(springs, phi, plays, strict=True)]
        assert_close(found, np.diag([slope for slope, _ in slopes]), 1e-12)
        blocks = np.zeros_like(memory)
        blocks[0, : len(plays[0])], blocks[1, len(plays[0]) :] = slopes[0][1], slopes[1][1]
        assert_close(memory, blocks, 1e-12)
        seen |= {round(slope, 6) for slope, _ in slopes}
    # Stops that hold and that slip, torques below the knees and beyond.
    assert len(seen) > 8


def test_the_inverse_step_has_the_inverse_slope(arm):
    step, inverse = (
        build_casadi_function(arm, name) for name in ("hysteresis_step", "hysteresis_inverse_step")
    )
    h = build_spring_vector([joint.elasticity for joint in arm.joints])
    rng, count = np.random.default_rng(7), step.size1_in(1)
    for _ in range(20):
        # From rest no play has moved, in torsion or in torque: both steps begin at the same point.
        torque, rest = rng.uniform(-12, 12, 2), np.zeros(count)
        phi, _ = inverse(torque, rest, h)
        back, _ = step(phi, rest, h)
        assert_close(np.array(back).ravel(), torque, 1e-12)
        slope = find_jacobian(step, 0, (phi, rest, h)) @ find_jacobian(inverse, 0, (torque, rest, h))
        assert_close(slope, np.eye(2), 1e-12)
        found = find_jacobian(inverse, 2, (torque, rest, h))
        assert_close(found, find_differences(inverse, 2, (torque, rest, h), 1e-7), 1e-6)


# Gentle enough that differences over 2e-5 are exact to 1e-8.
SCALE = 3.0
# A power of the speed below one has no slope at rest.
STEEP = ("power-law", "power-law+offset", "stribeck-0.7", "asymmetric-stribeck-0.7")


@pytest.mark.parametrize("smoothing", [0.0, 0.01])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_derivatives_of_friction_exist_at_rest_as_well(name, smoothing):
    robot = build_chain([(0.0, 0, 0, "q")], name="one")
    friction = FrictionValues(law=name, shape=give_shape(name, SCALE), smoothing=smoothing)
    robot = replace(robot, joints=(replace(robot.joints[0], friction=friction),))
    function = build_casadi_function(robot, "friction")
    # Position, load and temperature, where the law reads them.
    others = [[value] for value in (0.3, 7.0, 31.0)[: function.n_in() - 2]]
    f = np.linspace(1.0, 2.0, function.numel_in(function.n_in() - 1))
    for place in range(1 + len(others)):
        assert name in STEEP or np.isfinite(find_jacobian(function, place, ([0.0], *others, f))).all()
        for speed in (-0.4, 0.02, 0.7):
            inputs = ([speed], *others, f)
            found = find_jacobian(function, place, inputs)
            assert_close(found, find_differences(function, place, inputs, 2e-5), 1e-8)


def test_vectors_are_columns_and_matrices_have_their_shape(arm):
    functions = build_functions(arm)
    for function, spec in zip(functions.functions, functions.card.functions, strict=True):
        ports = [(function.size_in(k), port) for k, port in enumerate(spec.inputs)]
        ports += [(function.size_out(k), port) for k, port in enumerate(spec.outputs)]
        for size, port in ports:
            shape = (*port.shape, 1) if len(port.shape) == 1 else port.shape
            assert size == (shape if len(shape) == 2 else (shape[0], shape[1] * shape[2]))
    forward = build_casadi_function(arm, "forward_dynamics")
    columns = forward.map(5)(np.zeros((2, 5)), np.zeros((2, 5)), np.ones((2, 5)), np.tile(np.ones((6, 1)), 5))
    assert columns.shape == (2, 5)
