"""Values baked into code: the same numbers come out as from functions that are given them."""

import re

import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.programs import count_operations
from symid.codegen.source_folder import write_sources
from symid.dynamics import derive_base_parameters
from symid.errors import UsageError
from symid.options import GenerateOptions
from symid.robot import load_robot
from tests.builds import build_shipped, make, run
from tests.sx_programs import run_program


def find_values(card):
    vectors = {card.vector: card.beta, "IA": card.rotors, "f": card.friction, "h": card.springs}
    return {name: np.array([entry.value for entry in entries]) for name, entries in vectors.items()}


@pytest.mark.parametrize("name", ["two_link", "two_link_elastic"])
@pytest.mark.parametrize("standard", [False, True])
def test_constant_functions_equal_those_with_arguments(name, standard):
    given = build_shipped(name, standard=standard)
    baked = build_shipped(name, standard=standard, constant=True)
    rng = np.random.default_rng(3)
    known = find_values(given.card)
    for free, fixed in zip(given.programs, baked.programs, strict=True):
        left = {port.name for port in free.spec.inputs} - {port.name for port in fixed.spec.inputs}
        assert left == {port.name for port in free.spec.inputs if port.shared} - {"h"}
        inputs = {port.name: rng.uniform(-1, 1, port.size) for port in fixed.spec.inputs}
        inputs |= {name: values for name, values in known.items() if name == "h"}
        expected = run_program(free, {**inputs, **known})
        for found, value in zip(run_program(fixed, inputs), expected, strict=True):
            np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-12)
        before, after = count_operations(free), count_operations(fixed)
        assert after.mul + after.add <= before.mul + before.add


def test_values_that_are_unknown_are_all_named():
    robot = load_robot("puma560")
    with pytest.raises(UsageError) as caught:
        build_functions(robot, constant=True)
    assert [notice.code for notice in caught.value.notices] == ["usage.unknown-constants"]
    names = re.findall(r"\b[A-Z]+\d\b", str(caught.value))
    assert names == [entry.name for entry in derive_base_parameters(robot).parameters]


@pytest.mark.parametrize("name", ["two_link", "two_link_elastic"])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_example_runs_without_parameters(tmp_path, c_compiler, name, precision):
    functions = build_shipped(name, constant=True)
    sources = generate_c_library(functions, GenerateOptions(precision=precision))
    assert f"const {precision} beta[" not in dict(sources.files)[f"symid_{name}.h"]
    write_sources(sources, tmp_path)
    make(tmp_path, c_compiler, "all", flags="-O1 -Werror")
    for program, said in (("selftest", "0 of "), ("control_loop", "largest tracking error")):
        assert said in run(tmp_path, f"./{program}").stdout
