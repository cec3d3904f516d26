"""Values baked into code: the same numbers come out as from functions that are given them."""

import re
import subprocess

import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.compiler import locate_compiler
from symid.codegen.programs import count_operations
from symid.codegen.source_folder import write_sources
from symid.dynamics import derive_base_parameters
from symid.environment import locate_resource_folder
from symid.errors import UsageError
from symid.options import GenerateOptions
from symid.robot.toml_reader import read_robot
from tests.chains import run_program

ROBOTS = locate_resource_folder("robots")
COMPILER = locate_compiler()


def find_values(card):
    vectors = {card.vector: card.beta, "IA": card.rotors, "f": card.friction, "h": card.springs}
    return {name: np.array([entry.value for entry in entries]) for name, entries in vectors.items()}


@pytest.mark.parametrize("name", ["two_link", "two_link_elastic"])
@pytest.mark.parametrize("standard", [False, True])
def test_constant_functions_equal_those_with_arguments(name, standard):
    robot = read_robot(ROBOTS / f"{name}.toml")
    given = build_functions(robot, standard=standard)
    baked = build_functions(robot, standard=standard, constant=True)
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
    robot = read_robot(ROBOTS / "puma560.toml")
    with pytest.raises(UsageError) as caught:
        build_functions(robot, constant=True)
    assert [notice.code for notice in caught.value.notices] == ["usage.unknown-constants"]
    names = re.findall(r"\b[A-Z]+\d\b", str(caught.value))
    assert names == [entry.name for entry in derive_base_parameters(robot).parameters]


@pytest.mark.skipif(COMPILER is None, reason="wants a C compiler: install gcc")
@pytest.mark.parametrize("name", ["two_link", "two_link_elastic"])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_example_runs_without_parameters(tmp_path, name, precision):
    functions = build_functions(read_robot(ROBOTS / f"{name}.toml"), constant=True)
    sources = generate_c_library(functions, GenerateOptions(precision=precision))
    assert f"const {precision} beta[" not in dict(sources.files)[f"symid_{name}.h"]
    write_sources(sources, tmp_path / "code")
    make = ("make", "all", f"CC={COMPILER.path}", "CFLAGS=-O1 -Werror")
    subprocess.run(make, cwd=tmp_path / "code", check=True, capture_output=True)
    for program in ("selftest", "control_loop"):
        done = subprocess.run(
            (f"./{program}",), cwd=tmp_path / "code", check=True, capture_output=True, text=True
        )
        assert ("0 of " if program == "selftest" else "largest tracking error") in done.stdout
