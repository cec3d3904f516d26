"""The Lagrangian forms, derived from the energy, equal the recursion; all of it in exact arithmetic."""

import pytest
from hypothesis import given, settings
from sympy import QQ

from symid.algebra.exact import build_exact_state
from symid.algebra.points import PointAlgebra, build_point_state
from symid.dynamics.kinematics import build_recursion
from symid.dynamics.lagrange import (
    derive_energy,
    derive_lagrange_columns,
    derive_momentum_columns,
    derive_torque_columns,
    evaluate_torque_columns,
)
from symid.dynamics.regressors import (
    find_lagrange_columns,
    find_momentum_columns,
    find_slotine_li_columns,
    find_torque_columns,
)
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, build_chain, cut, draw_rational_state, trees


def assert_identical(robot):
    """All four regressors as polynomials in normal form: equal functions are equal objects."""
    energy = derive_energy(robot)
    algebra, keys = energy.algebra, energy.keys
    state = build_exact_state(robot, algebra)
    recursion = build_recursion(robot, algebra, state)
    torque = derive_torque_columns(energy, keys)
    assert torque == {key: list(column) for key, column in find_torque_columns(recursion, keys).items()}
    reference = (state.velocity, state.acceleration)
    assert torque == {
        key: list(column) for key, column in find_slotine_li_columns(recursion, reference, keys).items()
    }
    momentum = {key: list(column) for key, column in find_momentum_columns(recursion, keys).items()}
    assert derive_momentum_columns(energy, keys) == momentum
    lagrange = find_lagrange_columns(recursion, keys)
    assert derive_lagrange_columns(energy, keys) == {key: list(column) for key, column in lagrange.items()}


@pytest.mark.parametrize(
    "robot", [TWO_LINK, cut(PUMA560, 4), cut(PANDA, 4), cut(STANFORD, 4)], ids=lambda r: r.name
)
def test_lagrange_equals_newton_euler_as_polynomials(robot):
    assert_identical(robot)


def test_lagrange_equals_newton_euler_with_symbolic_lengths():
    assert_identical(build_chain([(0.0, 0, "L0", "q"), (0.5, "L1", "D2", "q"), (1.1, "L2", "q", 0.2)]))


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=3, rotors=True))
def test_lagrange_equals_newton_euler_on_random_trees(robot):
    assert_identical(robot)


@pytest.mark.parametrize("robot", [PUMA560, PANDA, STANFORD], ids=lambda r: r.name)
@pytest.mark.parametrize("seed", [1, 2])
def test_lagrange_equals_newton_euler_at_rational_points(robot, seed):
    values, _ = draw_rational_state(robot, seed)
    energy = derive_energy(robot)
    from_energy = evaluate_torque_columns(energy, energy.keys, values)
    state = build_point_state(robot, values)
    by_recursion = find_torque_columns(build_recursion(robot, PointAlgebra(QQ, values), state), energy.keys)
    assert from_energy == {key: list(column) for key, column in by_recursion.items()}
    assert any(entry for column in from_energy.values() for entry in column)
