"""The generated functions of whole arms against Pinocchio."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.algebra import FloatAlgebra
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import compute_energy_regressor
from tests import chains
from tests.float_algebra import build_float_state

pin = pytest.importorskip("pinocchio", reason="wants the package pin")


@chains.each_robot(chains.TWO_LINK, chains.PUMA560, chains.PANDA, chains.STANFORD)
def test_functions_equal_pinocchio(robot):
    rng = np.random.default_rng(11)
    (q, dq, ddq), parameters = rng.uniform(-3, 3, (3, robot.size)), chains.draw_parameters(rng, robot.size)
    beta = chains.compute_beta(derive_base_parameters(robot), parameters)
    functions = {function.name(): function for function in build_functions(robot).functions}

    def call(name, *arguments):
        result = functions[name](*arguments)
        return np.array(result).squeeze() if not isinstance(result, tuple) else [np.array(r) for r in result]

    model = chains.build_pinocchio(robot, parameters)
    data = model.createData()
    mass = pin.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    torque = pin.rnea(model, data, q, dq, ddq)
    gravity = pin.computeGeneralizedGravity(model, data, q)
    bias = pin.nonLinearEffects(model, data, q, dq)
    chains.assert_close(call("inverse_dynamics", q, dq, ddq, beta), torque)
    chains.assert_close(call("torque_regressor", q, dq, ddq) @ beta, torque)
    chains.assert_close(call("slotine_li_regressor", q, dq, dq, ddq) @ beta, torque)
    chains.assert_close(call("mass_matrix", q, beta), mass)
    chains.assert_close(call("gravity", q, beta), gravity)
    chains.assert_close(call("bias", q, dq, beta), bias)
    chains.assert_close(call("coriolis_matrix", q, dq, beta) @ dq, bias - gravity)
    chains.assert_close(call("forward_dynamics", q, dq, torque, beta), ddq, 1e-9)
    kinetic = pin.computeKineticEnergy(model, data, q, dq)
    chains.assert_close(call("energy", q, dq, beta)[0].item(), kinetic)
    chains.assert_close(call("momentum_regressor", q, dq) @ beta, mass @ dq)
    recursion = build_recursion(robot, FloatAlgebra(dict(robot.symbols)), build_float_state(q, dq, ddq))
    rows = [compute_energy_regressor(recursion.algebra, motion) for motion in recursion.motions]
    moving, resting = np.array(rows, dtype=float).swapaxes(0, 1).reshape(2, -1)
    chains.assert_close(
        moving, chains.order_regressor(pin.computeKineticEnergyRegressor(model, data, q, dq)).ravel()
    )
    chains.assert_close(
        resting, chains.order_regressor(pin.computePotentialEnergyRegressor(model, data, q)).ravel()
    )
    by_q, by_dq, by_ddq = call("inverse_dynamics_derivatives", q, dq, ddq, beta)
    pin.computeRNEADerivatives(model, data, q, dq, ddq)
    chains.assert_close(by_q, data.dtau_dq, 1e-11)
    chains.assert_close(by_dq, data.dtau_dv, 1e-11)
    chains.assert_close(by_ddq, mass)
    rotations, origins = call("forward_kinematics", q)
    pin.forwardKinematics(model, data, q)
    for link in range(robot.size):
        chains.assert_close(rotations[link].reshape(3, 3), data.oMi[link + 1].rotation)
        chains.assert_close(origins[link], data.oMi[link + 1].translation)
    pin.computeJointJacobians(model, data, q)
    jacobian = pin.getJointJacobian(model, data, robot.size, pin.LOCAL_WORLD_ALIGNED)
    chains.assert_close(call("jacobian", q), jacobian)
