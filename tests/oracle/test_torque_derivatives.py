"""Derivatives of the dynamics: of exact polynomials, and Pinocchio's at a thousand states."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from sympy import QQ

from symid.codegen.casadi_functions import build_casadi_function
from symid.codegen.functions import list_robot_specs
from symid.codegen.routes import choose_route
from symid.dynamics import torque_derivatives
from symid.dynamics.algebra import FloatAlgebra, build_state
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import build_exact_algebra, differentiate
from symid.dynamics.newton_euler import compute_tensor_torques
from symid.dynamics.recursion import build_recursion
from symid.errors import UsageError
from symid.notation import INERTIAL
from tests import chains
from tests.float_algebra import build_float_state
from tests.sx_programs import run_program

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

STATES = 1000
# Revolute and prismatic joints, axes that are neither parallel nor at right angles, gravity along no axis.
TILTED = chains.build_chain(
    [(0.0, 0, 0, "q"), (np.pi / 3, 0.3, 0.1, "q"), (np.pi / 2, 0.2, "q", 0.0)],
    gravity=("0.3", "-0.5", "-9.7"),
    name="tilted",
)


ARMS = chains.each_robot(chains.PANDA, chains.UR5, chains.STANFORD)


@chains.each_robot(chains.TWO_LINK, TILTED)
def test_derivatives_are_those_of_the_exact_polynomials(robot):
    algebra = build_exact_algebra(robot)
    rng = np.random.default_rng(2)
    values = {
        (link, name): algebra.ring.ground_new(QQ(int(rng.integers(-9, 10)), 7))
        for link in range(robot.size)
        for name in INERTIAL
    }
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, algebra.generators))
    torques = [algebra.reduce(torque) for torque in compute_tensor_torques(recursion, values)]
    found, slopes = (
        torque_derivatives.compute_torque_derivatives(recursion, values),
        torque_derivatives.compute_mass_derivatives(recursion, values),
    )
    for j in range(robot.size):
        for i, torque in enumerate(torques):
            expected = (
                differentiate(robot, algebra, torque, j),
                torque.diff(algebra.generators[f"dq{j + 1}"]),
                torque.diff(algebra.generators[f"ddq{j + 1}"]),
            )
            for block, exact in zip(found, expected, strict=True):
                assert algebra.reduce(block[i][j] - exact) == 0
            for k, slope in enumerate(slopes):
                mass = torque.diff(algebra.generators[f"ddq{j + 1}"])
                assert algebra.reduce(slope[i][j] - differentiate(robot, algebra, mass, k)) == 0


@pytest.mark.parametrize("meet", [None, lambda link: link, lambda link: min(link, 2)])
@ARMS
def test_derivatives_equal_pinocchio_at_a_thousand_states(robot, meet):
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-3, 3, (3, robot.size, STATES))
    parameters = chains.draw_parameters(rng, robot.size)
    recursion = build_recursion(robot, FloatAlgebra(dict(robot.symbols)), build_float_state(q, dq, ddq))
    values = chains.name_parameters(parameters)
    recursion = replace(recursion, meet=meet)
    found = torque_derivatives.compute_torque_derivatives(recursion, values)
    coriolis = torque_derivatives.compute_coriolis_matrix(recursion, values)
    _, twice_coriolis, load = torque_derivatives.compute_equation_terms(recursion, values)

    def stack(rows):
        return np.array([[np.broadcast_to(entry, STATES) for entry in row] for row in rows])

    by_q, by_dq, by_ddq, coriolis = map(stack, (*found, coriolis))
    (rest,) = stack([load])
    model = chains.build_pinocchio(robot, parameters)
    data = model.createData()
    for k in range(STATES):
        pin.computeRNEADerivatives(model, data, q[:, k], dq[:, k], ddq[:, k])
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        for mine, theirs in ((by_q, data.dtau_dq), (by_dq, data.dtau_dv), (by_ddq, mass)):
            np.testing.assert_allclose(mine[..., k], theirs, rtol=0, atol=1e-9)
        np.testing.assert_allclose(2 * coriolis[..., k], data.dtau_dv, rtol=0, atol=1e-9)
        bias = coriolis[..., k] @ dq[:, k] + rest[:, k]
        np.testing.assert_allclose(
            bias, pin.nonLinearEffects(model, data, q[:, k], dq[:, k]), rtol=0, atol=1e-9
        )
    np.testing.assert_array_equal(stack(twice_coriolis), by_dq)


@chains.each_robot(chains.PANDA, chains.UR5, chains.PUMA560)
def test_derivatives_of_the_forward_dynamics_equal_pinocchio(robot):
    rng = np.random.default_rng(4)
    parameters = chains.draw_parameters(rng, robot.size)
    base = derive_base_parameters(robot)
    beta = chains.compute_beta(base, parameters)
    (spec,) = list_robot_specs(robot, base, ("forward_dynamics_derivatives",))
    program = choose_route(robot, base, spec).program
    model = chains.build_pinocchio(robot, parameters)
    data = model.createData()
    for _ in range(20):
        q, dq, tau = rng.uniform(-2, 2, (3, robot.size))
        found = run_program(program, {"q": q, "dq": dq, "tau": tau, "beta": beta})
        pin.computeABADerivatives(model, data, q, dq, tau)
        expected = (data.ddq, data.ddq_dq, data.ddq_dv, data.Minv)
        for mine, theirs in zip(found, expected, strict=True):
            chains.assert_close(mine.reshape(theirs.shape), theirs, 1e-9)


@ARMS
def test_second_derivatives_are_those_of_casadi_of_the_torques(robot):
    rng = np.random.default_rng(5)
    torques, second = (
        build_casadi_function(robot, name)
        for name in ("inverse_dynamics", "inverse_dynamics_second_derivatives")
    )
    n = robot.size
    symbols = [ca.SX.sym("x", *torques.size_in(k)) for k in range(4)]
    value, (q, dq, ddq, _) = torques(*symbols), symbols

    def derive(first, other):
        slopes = ca.vec(ca.jacobian(value, first).T)
        return ca.jacobian(slopes, other)

    pairs = ((q, q), (q, dq), (dq, dq), (ddq, q))
    expected = ca.Function("second", symbols, [ca.densify(derive(*pair)) for pair in pairs])
    for _ in range(5):
        inputs = [rng.uniform(-2, 2, torques.size1_in(k)) for k in range(4)]
        for mine, other in zip(second.call(inputs), expected.call(inputs), strict=True):
            # A row of the Jacobian is one pair (i, j); entries (j, k) of a port are side by side.
            chains.assert_close(mine.full().reshape(n, n, n), other.full().reshape(n, n, n), 1e-10)


@ARMS
def test_derivatives_of_the_regressor_are_casadis_and_give_those_of_the_torque(robot):
    rng = np.random.default_rng(6)
    regressor, slopes, torques = (
        build_casadi_function(robot, name)
        for name in ("torque_regressor", "torque_regressor_derivatives", "inverse_dynamics_derivatives")
    )
    n, b = regressor.size_out(0)
    symbols = [ca.SX.sym("x", n) for _ in range(3)]
    rows = ca.vec(regressor(*symbols).T)
    expected = ca.Function("slopes", symbols, [ca.densify(ca.jacobian(rows, x)) for x in symbols])
    for _ in range(5):
        state, beta = [rng.uniform(-2, 2, n) for _ in symbols], rng.uniform(-2, 2, b)
        blocks = zip(slopes.call(state), expected.call(state), torques.call([*state, beta]), strict=True)
        for mine, theirs, torque in blocks:
            found = mine.full().reshape(n, b, n)
            size = max(1.0, float(np.abs(found).max()))
            np.testing.assert_allclose(found, theirs.full().reshape(n, b, n), rtol=0, atol=1e-10 * size)
            summed = np.einsum("ijk,j->ik", found, beta)
            np.testing.assert_allclose(summed, torque.full(), rtol=0, atol=1e-9 * size)


def test_what_is_too_large_for_full_matrices_is_said():
    robot = chains.build_chain([(np.pi / 2, 0.1, 0, "q")] * 17, name="long")
    base = derive_base_parameters(robot)
    assert "forward_dynamics_derivatives" not in [spec.name for spec in list_robot_specs(robot, base)]
    with pytest.raises(UsageError, match="16 coordinates at most, the robot has 17"):
        list_robot_specs(robot, base, ("forward_dynamics_derivatives",))
