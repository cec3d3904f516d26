"""States of self-tests: a few far out, where a function takes nothing but sines and cosines of an angle."""

import casadi as ca
import numpy as np
import pytest

from symid.codegen.c_library import write_simd_header
from symid.codegen.references import ANGLE_LIMITS, PER_UNIT, SampleStates, list_angle_inputs
from tests.builds import build_shipped
from tests.sx_programs import make_toy


def make_program(name, build):
    return make_toy(build, name, q=2, dq=2)[1]


TURNS = make_program("turns", lambda q, dq: ca.vertcat(ca.sin(q[0]) * dq[0], -ca.cos(-q[0]) - ca.sin(q[1])))
SPRING = make_program("spring", lambda q, dq: ca.vertcat(ca.sin(q[0]), 3 * q[1] + dq[0]))
SUM = make_program("sum", lambda q, dq: ca.vertcat(ca.sin(q[0] + q[1]), dq[1]))
GIVEN = make_program("given", lambda q, _: ca.vertcat(-q[0], ca.sin(q[0])))
NO_ANGLES = make_program("none", lambda _, dq: ca.vertcat(dq[0], dq[1]))


def test_limits_are_those_of_the_generated_code():
    for precision, limit in ANGLE_LIMITS.items():
        assert f"(x) <= {limit!r}{'f' * (precision == 'float')})" in write_simd_header("X", precision)


@pytest.mark.parametrize(
    ("programs", "angles"),
    [
        ((TURNS,), {("q", 2, 0), ("q", 2, 1)}),
        ((SPRING,), {("q", 2, 0)}),
        ((SUM,), set()),
        ((GIVEN,), set()),
        ((NO_ANGLES,), set()),
        ((NO_ANGLES, SPRING, TURNS, SUM), {("q", 2, 0), ("q", 2, 1)}),
    ],
)
def test_angles_are_what_a_function_takes_sines_of_alone(programs, angles):
    assert list_angle_inputs(programs) == angles


@pytest.mark.parametrize("precision", ["double", "float"])
def test_a_few_states_lie_far_out_and_are_exact_in_the_precision(precision):
    limit, dtype = ANGLE_LIMITS[precision], np.float32 if precision == "float" else np.float64
    states = SampleStates(count=100, seed=1, shared={}, angles=list_angle_inputs([TURNS]), limit=limit)
    q, dq = states.compute_all(TURNS)[1]
    far = np.abs(q) > 3.0
    assert (far.all(axis=1) == far.any(axis=1)).all()
    rows = np.flatnonzero(far.any(axis=1))
    assert len(rows) == 7
    assert len(set(rows % 8)) == 7  # in as many lanes of a vector
    size = np.sort(np.abs(q[rows]), axis=0)
    assert ((size[:3] > 46) & (size[:3] < 54)).all()
    assert ((size[3:5] > 0.88 * limit) & (size[3:5] < 0.92 * limit)).all()
    assert (size[5:] > 1.05 * limit).all()
    assert np.abs(dq).max() <= 2.0
    assert (q[rows].astype(dtype) == q[rows]).all()
    whole = np.rint(q * PER_UNIT)
    assert np.abs(whole).max() < 2**31
    np.testing.assert_array_equal(whole[rows] / PER_UNIT, q[rows])


def test_a_function_that_uses_an_angle_otherwise_has_it_near_in_a_table_of_its_own():
    angles = list_angle_inputs([TURNS, SPRING, NO_ANGLES])
    states = SampleStates(count=100, seed=1, shared={}, angles=angles)
    assert np.abs(states.compute_all(TURNS)[1][0]).max() > 1e6
    assert np.abs(states.compute_all(SPRING)[1][0]).max() <= 3.0
    assert states.compute_all(TURNS)[0] == ("q_2", "dq_2")
    assert states.compute_all(SPRING)[0] == ("q_2_near", "dq_2")
    near = np.abs(states.compute_all(TURNS)[1][0]).max(axis=1) <= 3.0
    np.testing.assert_array_equal(
        states.compute_all(SPRING)[1][0][near], states.compute_all(TURNS)[1][0][near]
    )


def test_few_states_are_all_near():
    states = SampleStates(count=20, seed=1, shared={}, angles=list_angle_inputs([TURNS]))
    assert np.abs(states.compute_all(TURNS)[1][0]).max() <= 3.0


@pytest.mark.parametrize("name", ["two_link", "two_link_elastic", "scara"])
def test_angles_of_robots_go_far_out_and_lengths_do_not(name):
    functions = build_shipped(name, "gravity", "mass_matrix")
    revolute = {k for k, joint in enumerate(functions.card.joints) if joint.kind == "revolute"}
    found = list_angle_inputs(functions.programs)
    assert found
    assert {k for _, _, k in found} <= revolute
