"""The CasADi functions equal the exact expressions at rational points."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sympy import QQ

from symid.codegen.casadi_functions import build_functions
from symid.dynamics.algebra import build_state
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import PointAlgebra, choose_domain
from symid.dynamics.recursion import build_recursion
from symid.dynamics.regressors import (
    compute_lagrange_columns,
    compute_momentum_columns,
    derive_energy,
    evaluate_torque_columns,
)
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, draw_rational_state, trees

NAMES = (
    "energy_regressor",
    "momentum_regressor",
    "lagrange_regressor",
    "torque_regressor",
    "inverse_dynamics",
)

RIGHT_ANGLES = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi])


def assert_close(found, expected):
    expected = np.asarray(expected, dtype=float)
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(np.array(found).reshape(expected.shape), expected, rtol=0, atol=1e-12 * scale)


def evaluate(polynomial, values):
    """Return an exact polynomial at an exact point."""
    names = [str(symbol) for symbol in polynomial.ring.symbols]
    return polynomial.evaluate(list(zip(polynomial.ring.gens, [values[name] for name in names], strict=True)))


def check(robot, *seeds):
    """Compare the functions, derived once, at the states of several seeds."""
    energy = derive_energy(robot)
    functions = {function.name(): function for function in build_functions(robot, names=NAMES).functions}
    for seed in seeds:
        check_state(robot, energy, functions, seed)


def check_state(robot, energy, functions, seed):
    values, (q, dq, ddq) = draw_rational_state(robot, seed)
    keys = derive_base_parameters(robot).keys
    kinetic, potential = functions["energy_regressor"](q, dq)
    assert_close(kinetic, [float(evaluate(energy.kinetic[key], values)) for key in keys])
    assert_close(potential, [float(evaluate(energy.potential[key], values)) for key in keys])
    algebra = PointAlgebra(choose_domain(robot), values)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, values))

    def stack(columns):
        return np.array([[float(entry) for entry in columns[key]] for key in keys]).T

    assert_close(functions["momentum_regressor"](q, dq), stack(compute_momentum_columns(recursion, keys)))
    assert_close(functions["lagrange_regressor"](q, dq), stack(compute_lagrange_columns(recursion, keys)))
    torque = stack(evaluate_torque_columns(energy, keys, values))
    assert_close(functions["torque_regressor"](q, dq, ddq), torque)
    beta = np.array([float(QQ(k + 1, 7)) for k in range(len(keys))])
    assert_close(functions["inverse_dynamics"](q, dq, ddq, beta), torque @ beta)


@pytest.mark.parametrize("robot", [TWO_LINK, PUMA560, PANDA, STANFORD], ids=lambda r: r.name)
def test_functions_equal_the_exact_polynomials(robot):
    check(robot, 3, 4)


@settings(max_examples=20, deadline=None)
@given(robot=trees(most=3, rotors=True, angles=RIGHT_ANGLES))
def test_functions_equal_the_exact_polynomials_on_random_trees(robot):
    check(robot, 5)
