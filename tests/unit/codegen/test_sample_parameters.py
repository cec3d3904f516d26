"""Self-tests compute where rounding stays small, and their sums let no error hide."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.codegen.references import (
    WEIGHTS,
    SampleStates,
    build_references,
    choose_parameters,
    estimate_amplification,
    evaluate_casadi,
)
from symid.codegen.source_text import GenerateOptions
from symid.robot.toml_reader import read_robot


def build(project, robot, *names):
    return build_functions(read_robot(project / "robots" / f"{robot}.toml"), names=names or None)


@pytest.mark.parametrize("robot", ["two_link", "ur5", "panda", "quadruped", "scara"])
def test_mass_matrices_are_well_conditioned_at_every_state(project, robot):
    made = build(project, robot, "mass_matrix")
    states = SampleStates(count=100, seed=1, shared={})
    found = choose_parameters(made.card, made.functions, made.programs, states)
    assert len(found) >= 4
    for beta in found[-4:]:
        at = SampleStates(count=100, seed=1, shared={"beta": beta})
        program = made.programs[0]
        (matrices,) = evaluate_casadi(made.functions[0], program, at.compute_all(program)[1], 100)
        assert np.linalg.cond(matrices.reshape(100, made.card.size, -1)).max() < 100
        # Every parameter takes part.
        assert np.count_nonzero(beta) >= 0.95 * len(beta)


def test_forward_dynamics_alone_tells_what_it_amplifies(project):
    made = build(project, "panda", "forward_dynamics")
    (function,), (program,) = made.functions, made.programs
    states = SampleStates(count=100, seed=1, shared={})
    beta = choose_parameters(made.card, made.functions, made.programs, states)[0]
    at = SampleStates(count=100, seed=1, shared={"beta": beta})
    (mass,) = build(project, "panda", "mass_matrix").functions
    spec = build(project, "panda", "mass_matrix").programs[0]
    (matrices,) = evaluate_casadi(mass, spec, at.compute_all(spec)[1], 100)
    condition = np.linalg.cond(matrices.reshape(100, 7, 7)).max()
    found = estimate_amplification(function, program, at.compute_all(program)[1], 100)
    assert found == 2.0 ** max(0, np.ceil(np.log2(condition / 100)))
    (reference,) = build_references(made.card, made.functions, made.programs, GenerateOptions())
    largest = max(abs(value) for row in reference.whole[0] for value in row)
    assert reference.scales[0] >= found * largest


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
