"""The generated functions of whole arms against Pinocchio."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import (
    PANDA,
    PUMA560,
    STANFORD,
    TWO_LINK,
    assert_close,
    build_pinocchio,
    compute_beta,
    draw_parameters,
    each_robot,
)

pin = pytest.importorskip("pinocchio", reason="wants the package pin")


@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_functions_equal_pinocchio(robot):
    rng = np.random.default_rng(11)
    (q, dq, ddq), parameters = rng.uniform(-3, 3, (3, robot.size)), draw_parameters(rng, robot.size)
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
