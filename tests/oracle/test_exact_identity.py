"""The Lagrangian forms, derived from the energy, equal the recursion; all of it in exact arithmetic."""

import random

import pytest
from hypothesis import given, settings
from sympy import QQ

from symid.algebra.exact import build_exact_state
from symid.algebra.scalar import State
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
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, build_chain, cut, trees


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


def draw_rational_point(robot, seed):
    """Return exact values of all generators with s^2 + c^2 = 1."""
    rng = random.Random(seed)  # noqa: S311  test data
    values = {}
    for number in range(1, robot.size + 1):
        t = QQ(rng.randint(-99, 99), 50)
        values |= {f"s{number}": 2 * t / (1 + t * t), f"c{number}": (1 - t * t) / (1 + t * t)}
        values |= {f"q{number}": QQ(rng.randint(-9, 9), 7), f"dq{number}": QQ(rng.randint(-99, 99), 13)}
        values[f"ddq{number}"] = QQ(rng.randint(-99, 99), 17)
    return values


class Rationals:
    """The recursion's algebra over rational numbers."""

    zero, one = QQ(0), QQ(1)

    def constant(self, value):
        one, *roots = value.coefficient("")
        assert not any(roots)
        return QQ(one.numerator, one.denominator)

    def add(self, left, right):
        return left + right

    def sub(self, left, right):
        return left - right

    def mul(self, left, right):
        return left * right

    def neg(self, value):
        return -value

    def half(self, value):
        return value / 2


@pytest.mark.parametrize("robot", [PUMA560, PANDA, STANFORD], ids=lambda r: r.name)
@pytest.mark.parametrize("seed", [1, 2])
def test_lagrange_equals_newton_euler_at_rational_points(robot, seed):
    values = draw_rational_point(robot, seed)
    energy = derive_energy(robot)
    from_energy = evaluate_torque_columns(energy, energy.keys, values)

    def take(prefix):
        return tuple(values[f"{prefix}{number}"] for number in range(1, robot.size + 1))

    algebra = Rationals()
    state = State(
        sine=take("s"), cosine=take("c"), position=take("q"), velocity=take("dq"), acceleration=take("ddq")
    )
    by_recursion = find_torque_columns(build_recursion(robot, algebra, state), energy.keys)
    assert from_energy == {key: list(column) for key, column in by_recursion.items()}
    assert any(entry for column in from_energy.values() for entry in column)
