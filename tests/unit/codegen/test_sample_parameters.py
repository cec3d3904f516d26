"""Self-tests compute where rounding stays small and some angles are large; their sums let no error hide."""

from dataclasses import replace
from decimal import Decimal

import casadi as ca
import numpy as np
import pytest

from symid.codegen.c_library import write_simd_header
from symid.codegen.casadi_functions import build_functions
from symid.codegen.programs import Op
from symid.codegen.references import (
    ANGLE_LIMITS,
    PER_UNIT,
    TOLERANCES,
    WEIGHTS,
    SampleStates,
    bound_rounding,
    build_references,
    choose_parameters,
    compute_exact_outputs,
    evaluate_casadi,
    find_ease,
    list_angle_inputs,
)
from symid.options import GenerateOptions
from tests.builds import build_shipped
from tests.chains import build_chain
from tests.sx_programs import make_toy


def build_own_references(made):
    return build_references(made.card, made.functions, made.programs, GenerateOptions())


@pytest.mark.parametrize("robot", ["two_link", "ur5", "panda", "quadruped", "scara"])
def test_mass_matrices_are_well_conditioned_at_every_state(robot):
    made = build_shipped(robot, "mass_matrix")
    states = SampleStates(count=100, seed=1, shared={})
    found = list(choose_parameters(made.card, made.functions, made.programs, states))
    assert len(found) >= 4
    for beta in found[-4:]:
        at = SampleStates(count=100, seed=1, shared={"beta": beta})
        program = made.programs[0]
        (matrices,) = evaluate_casadi(made.functions[0], program, at.compute_all(program)[1], 100)
        assert np.linalg.cond(matrices.reshape(100, made.card.size, -1)).max() < 100
        # Every parameter takes part.
        assert np.count_nonzero(beta) >= 0.95 * len(beta)


RIGHT = 1.5708
"""A right angle as files write it: what is left of it makes beta large, and they cancel."""


@pytest.fixture(scope="module")
def crooked():
    rows = [(angle, 0.05, 0.2, "q") for angle in (0.0, RIGHT, -RIGHT, RIGHT)]
    return build_functions(build_chain(rows), names=("mass_matrix", "inverse_dynamics", "forward_dynamics"))


@pytest.mark.parametrize("robot", ["panda", "puma560_elastic", "crooked"])
def test_errors_of_rounding_stay_within_their_bound(crooked, robot):
    """Against the program in 50 digits, at beta of all sizes."""
    made = crooked if robot == "crooked" else build_shipped(robot, "mass_matrix", "bias", "energy")
    drawn = SampleStates(count=20, seed=3, shared={})
    for program in made.programs:
        inputs = drawn.compute_all(program)[1]
        exact = compute_exact_outputs(program, [np.vectorize(Decimal, [object])(x) for x in inputs], 20)
        for (values, errors), truth in zip(bound_rounding(program, inputs, "double"), exact, strict=True):
            assert np.isfinite(errors).all()
            assert (np.abs(values.T - truth.astype(float)) <= errors.T).all(), program.spec.name
            # With beta of any kind, mass matrices are singular somewhere.
            singular = program.spec.name == "forward_dynamics"
            assert singular or errors.max() < 1e-13 * max(1.0, np.abs(values).max())


def test_beta_of_a_crooked_robot_are_such_that_rounding_is_small(crooked):
    references = build_own_references(crooked)
    for program, reference in zip(crooked.programs, references, strict=True):
        inputs = [np.array(rows if len(rows) > 1 else rows[0]) for rows in reference.inputs]
        assert np.abs(inputs[-1]).max() < 1e3
        assert find_ease(program, inputs, "double") == (1.0,)


def test_a_wrong_sign_is_noticed_wherever_it_stands(crooked):
    """Each sum as a difference, and each difference as a sum: what a self-test compares changes."""
    references = build_own_references(crooked)
    tolerance, turned = float(TOLERANCES["double"]), {Op.ADD: Op.SUB, Op.SUB: Op.ADD}
    missed = tried = 0
    for program, reference in zip(crooked.programs, references, strict=True):
        inputs = [np.array(rows if len(rows) > 1 else rows[0]) for rows in reference.inputs]
        for k, one in enumerate(program.instructions):
            if one.op not in turned:
                continue
            wrong = list(program.instructions)
            wrong[k] = replace(one, op=turned[one.op])
            ((values, _),) = bound_rounding(replace(program, instructions=tuple(wrong)), inputs, "double")
            errors = [np.abs(values.T[:2] - np.array(reference.whole[0])).max()]
            for place, (modulus, step) in enumerate(WEIGHTS):
                weights = modulus + step * np.arange(len(values)) % modulus
                sums = np.array(reference.sums[0])[:, place]
                errors.append(np.abs(weights @ values - sums).max() / modulus)
            missed += max(errors) / reference.scales[0] <= tolerance
            tried += 1
    assert tried > 300
    assert missed <= 0.02 * tried


def make_program(name, build):
    return make_toy(build, name, q=2, dq=2)[1]


TURNS = make_program("turns", lambda q, dq: ca.vertcat(ca.sin(q[0]) * dq[0], -ca.cos(-q[0]) - ca.sin(q[1])))


def test_limits_are_those_of_the_generated_code():
    for precision, limit in ANGLE_LIMITS.items():
        assert f"(x) <= {limit!r}{'f' * (precision == 'float')})" in write_simd_header("X", precision)


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
