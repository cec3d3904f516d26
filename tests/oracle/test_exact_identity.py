"""The Lagrangian forms, derived from the energy, equal the recursion; all of it in exact arithmetic.

The Lagrangian forms have an entry a coordinate, the recursion one a joint, which is folded. Followers have
sines and cosines of their own in the ring: what holds without their relation holds with it.
"""

import dataclasses
from fractions import Fraction

import pytest
from hypothesis import given, settings, strategies as st

from symid.dynamics.algebra import build_state
from symid.dynamics.exact_algebra import PointAlgebra
from symid.dynamics.recursion import build_recursion, fold_vector
from symid.dynamics.regressors import (
    compute_lagrange_columns,
    compute_momentum_columns,
    compute_torque_columns,
    derive_energy,
    derive_lagrange_columns,
    derive_momentum_columns,
    derive_torque_columns,
    evaluate_torque_columns,
)
from symid.robot.description import Coupling, Mimic, Spring
from tests.chains import (
    PANDA,
    PI,
    PUMA560,
    RATIONAL_ANGLES,
    RATIONAL_LENGTHS,
    STANFORD,
    TWO_LINK,
    build_chain,
    cut,
    draw_rational_state,
    each_robot,
    trees,
)


def fold_columns(robot, algebra, columns):
    """Return columns with an entry a coordinate instead of one a joint."""
    return {key: list(fold_vector(robot, algebra, column)) for key, column in columns.items()}


def assert_identical(robot):
    """All four regressors as polynomials in normal form: equal functions are equal objects."""
    energy = derive_energy(robot)
    algebra, keys = energy.algebra, tuple(energy.kinetic)
    state = build_state(robot, algebra, algebra.generators)
    recursion = build_recursion(robot, algebra, state)
    torque = derive_torque_columns(energy, keys)
    assert torque == fold_columns(robot, algebra, compute_torque_columns(recursion, keys))
    reference = (state.velocity, state.acceleration)
    assert torque == fold_columns(robot, algebra, compute_torque_columns(recursion, keys, reference))
    momentum = fold_columns(robot, algebra, compute_momentum_columns(recursion, keys))
    assert derive_momentum_columns(energy, keys) == momentum
    lagrange = fold_columns(robot, algebra, compute_lagrange_columns(recursion, keys))
    assert derive_lagrange_columns(energy, keys) == lagrange


@each_robot(TWO_LINK, cut(PUMA560, 4), cut(PANDA, 4), cut(STANFORD, 4))
def test_lagrange_equals_newton_euler_as_polynomials(robot):
    assert_identical(robot)


def assert_identical_at_a_point(robot, seed):
    """Return the columns, which are equal, at rational sines, cosines, lengths and rates."""
    values, _ = draw_rational_state(robot, seed)
    energy = derive_energy(robot)
    domain = energy.algebra.ring.domain
    values = {name: domain.convert(value) for name, value in values.items()}
    algebra = PointAlgebra(domain, values)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, values))
    columns = evaluate_torque_columns(energy, tuple(energy.kinetic), values)
    by_recursion = compute_torque_columns(recursion, tuple(energy.kinetic))
    assert columns == fold_columns(robot, algebra, by_recursion)
    return columns


@each_robot(PUMA560, PANDA, STANFORD)
@pytest.mark.parametrize("seed", [1, 2])
def test_lagrange_equals_newton_euler_at_rational_points(robot, seed):
    columns = assert_identical_at_a_point(robot, seed)
    assert any(entry for column in columns.values() for entry in column)


EVERYTHING = {"rotors": True, "followers": True, "couplings": True, "springs": True}


@settings(max_examples=25, deadline=None)
@given(robot=trees(most=3, **EVERYTHING))
def test_identity_with_followers_couplings_and_springs(robot):
    assert_identical(robot)


@settings(max_examples=15, deadline=None)
@given(robot=trees(most=3, angles=RATIONAL_ANGLES, lengths=RATIONAL_LENGTHS, symbols=True, **EVERYTHING))
def test_identity_with_everything_in_rational_and_symbolic_geometry(robot):
    assert_identical(robot)


@settings(max_examples=15, deadline=None)
@given(robot=trees(most=4, **EVERYTHING), seed=st.integers(0, 99))
def test_identity_at_rational_points_with_followers_couplings_and_springs(robot, seed):
    assert_identical_at_a_point(robot, seed)


def test_a_spring_of_a_follower_acts_on_its_master():
    """V = KS (-2 q)^2 / 2 + KR (-2 q): torque 4 KS q - 2 KR, with the follower's own q in the ring."""
    arm = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0.3, 0, "q")], gravity=("0", "0", "0"))
    follower = dataclasses.replace(
        arm.joints[1], mimic=Mimic(master=0, multiplier=Fraction(-2)), spring=Spring()
    )
    robot = dataclasses.replace(arm, joints=(arm.joints[0], follower))
    energy = derive_energy(robot)
    torque = derive_torque_columns(energy, [(1, "KS"), (1, "KR")])
    assert torque[1, "KS"] == [-2 * energy.algebra.generators["q2"]]
    assert torque[1, "KR"] == [-2 * energy.algebra.one]
    assert_identical(robot)


def test_a_coupled_rotor_turns_with_the_sum_of_its_joints():
    """T = IA (2 dq1 - dq2)^2 / 2: torques 2 IA (2 ddq1 - ddq2) and -IA (2 ddq1 - ddq2)."""
    coupling = Coupling(name="m", terms=((0, Fraction(2)), (1, Fraction(-1))), has_rotor=True)
    robot = dataclasses.replace(TWO_LINK, couplings=(coupling,))
    energy = derive_energy(robot)
    torque = derive_torque_columns(energy, [(2, "IA")])[2, "IA"]
    first, second = (energy.algebra.generators[name] for name in ("ddq1", "ddq2"))
    assert torque == [2 * (2 * first - second), -(2 * first - second)]
    assert_identical(robot)
