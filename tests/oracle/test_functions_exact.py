"""The CasADi functions equal the exact expressions at rational points."""

import numpy as np
from hypothesis import given, settings
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
from tests.chains import (
    PANDA,
    PUMA560,
    RIGHT_ANGLES,
    STANFORD,
    TWO_LINK,
    assert_close,
    draw_rational_state,
    each_robot,
    trees,
)

NAMES = (*(f"{name}_regressor" for name in ("energy", "momentum", "lagrange", "torque")), "inverse_dynamics")


def assert_all_close(found, expected):
    expected = np.asarray(expected, dtype=float)
    assert_close(np.array(found).reshape(expected.shape), expected)


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
    assert_all_close(kinetic, [float(evaluate(energy.kinetic[key], values)) for key in keys])
    assert_all_close(potential, [float(evaluate(energy.potential[key], values)) for key in keys])
    algebra = PointAlgebra(choose_domain(robot), values)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, values))

    def stack(columns):
        return np.array([[float(entry) for entry in columns[key]] for key in keys]).T

    assert_all_close(functions["momentum_regressor"](q, dq), stack(compute_momentum_columns(recursion, keys)))
    assert_all_close(functions["lagrange_regressor"](q, dq), stack(compute_lagrange_columns(recursion, keys)))
    torque = stack(evaluate_torque_columns(energy, keys, values))
    assert_all_close(functions["torque_regressor"](q, dq, ddq), torque)
    beta = np.array([float(QQ(k + 1, 7)) for k in range(len(keys))])
    assert_all_close(functions["inverse_dynamics"](q, dq, ddq, beta), torque @ beta)


@each_robot(TWO_LINK, PUMA560, PANDA, STANFORD)
def test_functions_equal_the_exact_polynomials(robot):
    check(robot, 3, 4)


@settings(max_examples=20, deadline=None)
@given(robot=trees(most=3, rotors=True, angles=RIGHT_ANGLES))
def test_functions_equal_the_exact_polynomials_on_random_trees(robot):
    check(robot, 5)
