"""Momentum and Lagrangian regressors give the torque: d/dt (Yp beta) - YL beta against Pinocchio's rnea."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import (
    PANDA,
    PUMA560,
    STANFORD,
    TWO_LINK,
    build_pinocchio,
    compute_beta,
    draw_parameters,
    each_robot,
)
from tests.sx_programs import run_program

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

_STEP = 1e-5


@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_the_rate_of_the_momentum_less_the_lagrangian_force_is_the_torque(robot):
    """The rate is a central difference along q + s dq + s^2 ddq / 2, of second order in the step."""
    rng = np.random.default_rng(20)
    q, dq, ddq = rng.uniform(-2.0, 2.0, (3, robot.size))
    parameters = draw_parameters(rng, robot.size)
    beta = compute_beta(derive_base_parameters(robot), parameters)
    functions = build_functions(robot, names=("momentum_regressor", "lagrange_regressor"))
    programs = dict(zip(("momentum_regressor", "lagrange_regressor"), functions.programs, strict=True))

    def momentum(s):
        at = {"q": q + s * dq + 0.5 * s**2 * ddq, "dq": dq + s * ddq}
        return run_program(programs["momentum_regressor"], at)[0].reshape(robot.size, -1) @ beta

    rate = (momentum(_STEP) - momentum(-_STEP)) / (2.0 * _STEP)
    force = run_program(programs["lagrange_regressor"], {"q": q, "dq": dq})[0].reshape(robot.size, -1) @ beta
    model = build_pinocchio(robot, parameters)
    torque = pin.rnea(model, model.createData(), q, dq, ddq)
    np.testing.assert_allclose(rate - force, torque, rtol=0, atol=1e-6 * np.abs(torque).max())
