"""The Lagrangian forms, derived from the energy, equal the recursion; all of it in exact arithmetic.

The Lagrangian forms have an entry a coordinate, the recursion one a joint, which is folded. Followers have
sines and cosines of their own in the ring: what holds without their relation holds with it.
"""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from symid.codegen.casadi_functions import build_functions
from symid.dynamics import lagrange, regressors
from symid.dynamics.algebra import build_state
from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.exact_algebra import PointAlgebra, choose_domain
from symid.dynamics.recursion import build_recursion, fold_vector
from symid.robot.description import Coupling, Mimic, Spring
from tests import chains


def fold_columns(robot, algebra, columns):
    """Return columns with an entry a coordinate instead of one a joint."""
    return {key: list(fold_vector(robot, algebra, column)) for key, column in columns.items()}


def assert_identical(robot):
    """All four regressors as polynomials in normal form: equal functions are equal objects."""
    energy = lagrange.derive_energy(robot)
    algebra, keys = energy.algebra, tuple(energy.kinetic)
    state = build_state(robot, algebra, algebra.generators)
    recursion = build_recursion(robot, algebra, state)
    torque = lagrange.derive_torque_columns(energy, keys)
    assert torque == fold_columns(robot, algebra, regressors.compute_torque_columns(recursion, keys))
    reference = (state.velocity, state.acceleration)
    assert torque == fold_columns(
        robot, algebra, regressors.compute_torque_columns(recursion, keys, reference)
    )
    momentum = fold_columns(robot, algebra, regressors.compute_momentum_columns(recursion, keys))
    assert lagrange.derive_momentum_columns(energy, keys) == momentum
    forces = fold_columns(robot, algebra, regressors.compute_lagrange_columns(recursion, keys))
    assert lagrange.derive_lagrange_columns(energy, keys) == forces


@chains.each_robot(
    chains.TWO_LINK,
    chains.cut(chains.PUMA560, 4),
    chains.cut(chains.PANDA, 4),
    chains.cut(chains.STANFORD, 4),
)
def test_lagrange_equals_newton_euler_as_polynomials(robot):
    assert_identical(robot)


def assert_identical_at_a_point(robot, seed):
    """Return the columns, which are equal, at rational sines, cosines, lengths and rates."""
    values, _ = chains.draw_rational_state(robot, seed)
    energy = lagrange.derive_energy(robot)
    domain = energy.algebra.ring.domain
    values = {name: domain.convert(value) for name, value in values.items()}
    algebra = PointAlgebra(domain, values)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, values))
    columns = lagrange.evaluate_torque_columns(energy, tuple(energy.kinetic), values)
    by_recursion = regressors.compute_torque_columns(recursion, tuple(energy.kinetic))
    assert columns == fold_columns(robot, algebra, by_recursion)
    return columns


@settings(max_examples=20, deadline=None)
@given(robot=chains.trees(most=3, rotors=True, angles=chains.RIGHT_ANGLES))
@example(chains.PUMA560)
@example(chains.PANDA)
@example(chains.STANFORD)
def test_functions_equal_the_exact_polynomials(robot):
    values, (q, dq, ddq) = chains.draw_rational_state(robot, 5)
    energy, keys = lagrange.derive_energy(robot), derive_base_parameters(robot).keys
    torque = lagrange.evaluate_torque_columns(energy, keys, values)
    points = [values[str(symbol)] for symbol in energy.algebra.ring.symbols]
    rows = [[float(part[key](*points)) for key in keys] for part in (energy.kinetic, energy.potential)]
    algebra = PointAlgebra(choose_domain(robot), values)
    recursion = build_recursion(robot, algebra, build_state(robot, algebra, values))
    names = [f"{name}_regressor" for name in ("torque", "momentum", "lagrange", "energy")]
    call = {function.name(): function for function in build_functions(robot, names=names).functions}
    for found, columns in (
        (call["torque_regressor"](q, dq, ddq), torque),
        (call["momentum_regressor"](q, dq), regressors.compute_momentum_columns(recursion, keys)),
        (call["lagrange_regressor"](q, dq), regressors.compute_lagrange_columns(recursion, keys)),
    ):
        expected = np.array([[float(entry) for entry in columns[key]] for key in keys]).T
        chains.assert_close(np.array(found).reshape(expected.shape), expected)
    for found, expected in zip(call["energy_regressor"](q, dq), rows, strict=True):
        chains.assert_close(np.array(found).ravel(), np.array(expected))


@chains.each_robot(chains.PUMA560, chains.PANDA, chains.STANFORD)
@pytest.mark.parametrize("seed", [1, 2])
def test_lagrange_equals_newton_euler_at_rational_points(robot, seed):
    columns = assert_identical_at_a_point(robot, seed)
    assert any(entry for column in columns.values() for entry in column)


EVERYTHING = {"rotors": True, "followers": True, "couplings": True, "springs": True}


@settings(max_examples=25, deadline=None)
@given(robot=chains.trees(most=3, **EVERYTHING))
def test_identity_with_followers_couplings_and_springs(robot):
    assert_identical(robot)


@settings(max_examples=15, deadline=None)
@given(
    robot=chains.trees(
        most=3, angles=chains.RATIONAL_ANGLES, lengths=chains.RATIONAL_LENGTHS, symbols=True, **EVERYTHING
    )
)
def test_identity_with_everything_in_rational_and_symbolic_geometry(robot):
    assert_identical(robot)


@settings(max_examples=15, deadline=None)
@given(robot=chains.trees(most=4, **EVERYTHING), seed=st.integers(0, 99))
def test_identity_at_rational_points_with_followers_couplings_and_springs(robot, seed):
    assert_identical_at_a_point(robot, seed)


def test_a_spring_of_a_follower_acts_on_its_master():
    """V = KS (-2 q)^2 / 2 + KR (-2 q): torque 4 KS q - 2 KR, with the follower's own q in the ring."""
    arm = chains.build_chain([(0.0, 0, 0, "q"), (chains.PI / 2, 0.3, 0, "q")], gravity=("0", "0", "0"))
    follower = dataclasses.replace(
        arm.joints[1], mimic=Mimic(master=0, multiplier=Fraction(-2)), spring=Spring()
    )
    robot = dataclasses.replace(arm, joints=(arm.joints[0], follower))
    energy = lagrange.derive_energy(robot)
    torque = lagrange.derive_torque_columns(energy, [(1, "KS"), (1, "KR")])
    assert torque[1, "KS"] == [-2 * energy.algebra.generators["q2"]]
    assert torque[1, "KR"] == [-2 * energy.algebra.one]
    assert_identical(robot)


def test_a_coupled_rotor_turns_with_the_sum_of_its_joints():
    """T = IA (2 dq1 - dq2)^2 / 2: torques 2 IA (2 ddq1 - ddq2) and -IA (2 ddq1 - ddq2)."""
    coupling = Coupling(name="m", terms=((0, Fraction(2)), (1, Fraction(-1))), has_rotor=True)
    robot = dataclasses.replace(chains.TWO_LINK, couplings=(coupling,))
    energy = lagrange.derive_energy(robot)
    torque = lagrange.derive_torque_columns(energy, [(2, "IA")])[2, "IA"]
    first, second = (energy.algebra.generators[name] for name in ("ddq1", "ddq2"))
    assert torque == [2 * (2 * first - second), -(2 * first - second)]
    assert_identical(robot)
