"""Self-tests compute where rounding stays small, and their sums let no error hide."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.codegen.programs import Op
from symid.codegen.references import (
    TOLERANCES,
    WEIGHTS,
    SampleStates,
    bound_rounding,
    build_references,
    choose_parameters,
    compute_exact_outputs,
    evaluate_casadi,
    find_ease,
)
from symid.options import GenerateOptions
from symid.robot.toml_reader import read_robot
from tests.chains import build_chain


def build(project, robot, *names):
    return build_functions(read_robot(project / "robots" / f"{robot}.toml"), names=names or None)


@pytest.mark.parametrize("robot", ["two_link", "ur5", "panda", "quadruped", "scara"])
def test_mass_matrices_are_well_conditioned_at_every_state(project, robot):
    made = build(project, robot, "mass_matrix")
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
def test_errors_of_rounding_stay_within_their_bound(project, crooked, robot):
    """Against the program in 50 digits, at beta of all sizes."""
    made = crooked if robot == "crooked" else build(project, robot, "mass_matrix", "bias", "energy")
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
    references = build_references(crooked.card, crooked.functions, crooked.programs, GenerateOptions())
    for program, reference in zip(crooked.programs, references, strict=True):
        inputs = [np.array(rows if len(rows) > 1 else rows[0]) for rows in reference.inputs]
        assert np.abs(inputs[-1]).max() < 1e3
        assert find_ease(program, inputs, "double") == (1.0,)


def test_a_wrong_sign_is_noticed_wherever_it_stands(crooked):
    """Each sum as a difference, and each difference as a sum: what a self-test compares changes."""
    references = build_references(crooked.card, crooked.functions, crooked.programs, GenerateOptions())
    tolerance, turned = float(TOLERANCES["double"]), {Op.ADD: Op.SUB, Op.SUB: Op.ADD}
    missed = tried = 0
    for program, reference in zip(crooked.programs, references, strict=True):
        inputs = [np.array(rows if len(rows) > 1 else rows[0]) for rows in reference.inputs]
        for k, one in enumerate(program.instructions):
            if one.op not in turned:
                continue
            wrong = (
                *program.instructions[:k],
                replace(one, op=turned[one.op]),
                *program.instructions[k + 1 :],
            )
            ((values, _),) = bound_rounding(replace(program, instructions=wrong), inputs, "double")
            errors = [np.abs(values.T[:2] - np.array(reference.whole[0])).max()]
            for place, (modulus, step) in enumerate(WEIGHTS):
                weights = modulus + step * np.arange(len(values)) % modulus
                sums = np.array(reference.sums[0])[:, place]
                errors.append(np.abs(weights @ values - sums).max() / modulus)
            missed += max(errors) / reference.scales[0] <= tolerance
            tried += 1
    assert tried > 300
    assert missed <= 0.02 * tried


def test_no_two_elements_weigh_the_same():
    count = 97 * 101
    places = np.arange(count)
    weights = np.stack([m + s * places % m for m, s in WEIGHTS], axis=1)
    assert len({tuple(row) for row in weights.tolist()}) == count
    for column, (modulus, _) in zip(weights.T, WEIGHTS, strict=True):
        assert column.min() >= modulus
        assert column.max() < 2 * modulus


def test_functions_share_their_states(project):
    made = build(project, "two_link")
    references = build_references(made.card, made.functions, made.programs, GenerateOptions())
    seen = {}
    for program, reference in zip(made.programs, references, strict=True):
        for port, rows in zip(program.spec.inputs, reference.inputs, strict=True):
            assert len(rows) == (1 if port.shared else 100)
            assert seen.setdefault((port.name, port.size), rows) == rows
        for port, whole, sums in zip(program.spec.outputs, reference.whole, reference.sums, strict=True):
            assert (len(whole), len(sums)) == (2, 100)
            elements = np.array(whole)
            for k, (m, s) in enumerate(WEIGHTS):
                weights = m + s * np.arange(port.size) % m
                np.testing.assert_allclose(elements @ weights, np.array(sums)[:2, k], rtol=0, atol=1e-9)


def test_a_function_alone_has_the_states_that_it_has_among_others(project):
    made, alone = build(project, "two_link"), build(project, "two_link", "bias")
    k = [program.spec.name for program in made.programs].index("bias")
    one = build_references(alone.card, alone.functions, alone.programs, GenerateOptions())[0]
    many = build_references(made.card, made.functions, made.programs, GenerateOptions())[k]
    assert one.inputs[:2] == many.inputs[:2]
