"""The exact forms and the generated functions against Pinocchio."""

import numpy as np
import pytest
from hypothesis import given, settings

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import (
    compute_energy_regressor,
    compute_torque_columns,
    derive_energy,
    evaluate_torque_columns,
)
from symid.notation import INERTIAL
from tests.chains import (
    PANDA,
    PUMA560,
    STANFORD,
    TWO_LINK,
    assert_close,
    build_pinocchio,
    compute_beta,
    draw_parameters,
    draw_rational_state,
    each_robot,
    order_regressor,
    trees,
)
from tests.float_algebra import build_float_state

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

ROBOTS = each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)


def draw_state(robot, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (3, robot.size)), draw_parameters(rng, robot.size)


def list_keys(robot):
    return [(link, name) for link in range(robot.size) for name in INERTIAL]


def stack(columns, keys):
    return np.array([[float(entry) for entry in columns[key]] for key in keys]).T


def find_float_columns(robot, state):
    algebra = FloatAlgebra(dict(robot.symbols))
    carrier = build_float_state(*state)
    recursion = build_recursion(robot, algebra, carrier)
    keys = list_keys(robot)
    return stack(compute_torque_columns(recursion, keys), keys), recursion.motions, algebra


@ROBOTS
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_torque_regressor_from_the_energy_equals_pinocchio(robot, seed):
    values, (q, dq, ddq) = draw_rational_state(robot, seed)
    parameters = draw_parameters(np.random.default_rng(seed), robot.size)
    keys = list_keys(robot)
    ours = stack(evaluate_torque_columns(derive_energy(robot), keys, values), keys)
    model = build_pinocchio(robot, parameters)
    data = model.createData()
    theirs = order_regressor(pin.computeJointTorqueRegressor(model, data, q, dq, ddq))
    assert_close(ours, theirs)
    assert_close(ours @ parameters.ravel(), pin.rnea(model, data, q, dq, ddq))


@settings(max_examples=40, deadline=None)
@given(robot=trees(most=5))
def test_recursion_equals_pinocchio_on_random_trees(robot):
    (q, dq, ddq), parameters = draw_state(robot, 5)
    ours, _, _ = find_float_columns(robot, (q, dq, ddq))
    model = build_pinocchio(robot, parameters)
    theirs = pin.computeJointTorqueRegressor(model, model.createData(), q, dq, ddq)
    # Pinocchio gives a vector for a single joint.
    assert_close(ours, order_regressor(theirs.reshape(robot.size, -1)))


@ROBOTS
def test_energy_regressors_equal_pinocchio(robot):
    (q, dq, ddq), parameters = draw_state(robot, 7)
    _, motions, algebra = find_float_columns(robot, (q, dq, ddq))
    rows = [compute_energy_regressor(algebra, motion) for motion in motions]
    model = build_pinocchio(robot, parameters)
    data = model.createData()
    kinetic = order_regressor(pin.computeKineticEnergyRegressor(model, data, q, dq))
    potential = order_regressor(pin.computePotentialEnergyRegressor(model, data, q))
    assert_close([float(v) for row, _ in rows for v in row], kinetic.ravel())
    assert_close([float(v) for _, row in rows for v in row], potential.ravel())


@ROBOTS
def test_functions_equal_pinocchio(robot):
    (q, dq, ddq), parameters = draw_state(robot, 11)
    beta = compute_beta(derive_base_parameters(robot), parameters)
    functions = {function.name(): function for function in build_functions(robot).functions}

    def call(name, *arguments):
        result = functions[name](*arguments)
        return np.array(result).squeeze() if not isinstance(result, tuple) else [np.array(r) for r in result]

    model = build_pinocchio(robot, parameters)
    data = model.createData()
    mass = pin.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    torque = pin.rnea(model, data, q, dq, ddq)
    gravity = pin.computeGeneralizedGravity(model, data, q)
    bias = pin.nonLinearEffects(model, data, q, dq)
    assert_close(call("inverse_dynamics", q, dq, ddq, beta), torque)
    assert_close(call("torque_regressor", q, dq, ddq) @ beta, torque)
    assert_close(call("slotine_li_regressor", q, dq, dq, ddq) @ beta, torque)
    assert_close(call("mass_matrix", q, beta), mass)
    assert_close(call("gravity", q, beta), gravity)
    assert_close(call("bias", q, dq, beta), bias)
    assert_close(call("coriolis_matrix", q, dq, beta) @ dq, bias - gravity)
    assert_close(call("forward_dynamics", q, dq, torque, beta), ddq, 1e-9)
    kinetic = pin.computeKineticEnergy(model, data, q, dq)
    assert_close(call("energy", q, dq, beta)[0].item(), kinetic)
    assert_close(call("momentum_regressor", q, dq) @ beta, mass @ dq)
    by_q, by_dq, by_ddq = call("inverse_dynamics_derivatives", q, dq, ddq, beta)
    pin.computeRNEADerivatives(model, data, q, dq, ddq)
    assert_close(by_q, data.dtau_dq, 1e-11)
    assert_close(by_dq, data.dtau_dv, 1e-11)
    assert_close(by_ddq, mass)
    rotations, origins = call("forward_kinematics", q)
    pin.forwardKinematics(model, data, q)
    for link in range(robot.size):
        assert_close(rotations[link].reshape(3, 3), data.oMi[link + 1].rotation)
        assert_close(origins[link], data.oMi[link + 1].translation)
    pin.computeJointJacobians(model, data, q)
    jacobian = pin.getJointJacobian(model, data, robot.size, pin.LOCAL_WORLD_ALIGNED)
    assert_close(call("jacobian", q), jacobian)


@ROBOTS
def test_coriolis_matrix_makes_the_skew_form(robot):
    """dM/dt - 2 C is skew-symmetric (central difference of M along dq)."""
    (q, dq, _), parameters = draw_state(robot, 13)
    beta = compute_beta(derive_base_parameters(robot), parameters)
    mass, coriolis = build_functions(robot, names=("mass_matrix", "coriolis_matrix")).functions
    step = 1e-6
    rate = (np.array(mass(q + step * dq, beta)) - np.array(mass(q - step * dq, beta))) / (2 * step)
    skew = rate - 2 * np.array(coriolis(q, dq, beta))
    assert np.abs(skew + skew.T).max() < 1e-7 * max(1.0, np.abs(rate).max())
    assert np.abs(rate).max() > 1e-3


@ROBOTS
def test_lagrange_regressor_is_the_gradient_of_the_lagrangian(robot):
    (q, dq, _), parameters = draw_state(robot, 17)
    beta = compute_beta(derive_base_parameters(robot), parameters)
    energy, lagrange = build_functions(robot, names=("energy", "lagrange_regressor")).functions

    def lagrangian(point):
        kinetic, potential = energy(point, dq, beta)
        return float(kinetic) - float(potential)

    step = 1e-6
    units = np.eye(robot.size) * step
    gradient = np.array([(lagrangian(q + u) - lagrangian(q - u)) / (2 * step) for u in units])
    assert_close(np.array(lagrange(q, dq)) @ beta, gradient, 1e-7)
