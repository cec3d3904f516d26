"""Libraries: only what was built from the folder's sources, and only calls that make sense."""

import subprocess

import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.library import load_library
from symid.codegen.options import GenerateOptions
from symid.codegen.python_module import generate_python_module
from symid.codegen.writer import write_sources
from symid.errors import GenerationError, UsageError
from symid.formats.toml import read_robot

NAMES = ("gravity", "mass_matrix")


@pytest.fixture(scope="module")
def made(project):
    robots = project / "robots"
    return {name: build_functions(read_robot(robots / f"{name}.toml"), names=NAMES) for name in ("two_link",)}


@pytest.fixture
def build(c_compiler):
    def run(folder, *targets):
        subprocess.run(
            ["make", "-s", f"CC={c_compiler}", *targets], cwd=folder, check=True, capture_output=True
        )

    return run


@pytest.fixture
def folder(made, tmp_path, build):
    write_sources(generate_c_library(made["two_link"]), tmp_path / "c")
    build(tmp_path / "c", "shared")
    return tmp_path / "c"


@pytest.fixture(params=["c", "python"])
def library(request, made, tmp_path):
    if request.param == "c":
        return load_library(request.getfixturevalue("folder"))
    write_sources(generate_python_module(made["two_link"]), tmp_path / "p")
    return load_library(tmp_path / "p")


def test_a_library_built_before_the_sources_is_refused_until_it_is_built_again(made, folder, build):
    load_library(folder)
    write_sources(generate_c_library(made["two_link"], GenerateOptions(precision="float")), folder)
    with pytest.raises(UsageError, match="run `make clean shared`") as caught:
        load_library(folder)
    assert caught.value.notices[0].code == "usage.stale-library"
    build(folder, "clean", "shared")
    beta = np.ones(len(made["two_link"].card.beta))
    found = load_library(folder).evaluate("mass_matrix", np.zeros((1, 2)), beta)[0]
    assert np.isfinite(found).all()


def test_a_library_of_other_functions_is_refused(project, folder):
    robot = read_robot(project / "robots" / "two_link.toml")
    write_sources(generate_c_library(build_functions(robot, names=(*NAMES, "bias"))), folder)
    with pytest.raises(UsageError, match="built from other sources"):
        load_library(folder)


def test_a_library_that_lacks_a_function_is_refused(folder, monkeypatch):
    library = load_library(folder)
    monkeypatch.setattr(library, "_prefix", "symid_other")
    for call in (library.bind, library.evaluate):
        with pytest.raises(UsageError, match="run `make clean shared`"):
            call("gravity", *([] if call == library.bind else [np.ones(2), np.ones(len(library.card.beta))]))


def test_byte_code_beside_a_module_is_not_run(made, tmp_path):
    write_sources(generate_python_module(made["two_link"]), tmp_path / "p")
    load_library(tmp_path / "p")
    assert not (tmp_path / "p" / "__pycache__").exists()


Q = np.ones(2)
# What stands for q and beta; None is the right vector of parameters.
WRONG = {
    "count": (Q,),
    "size": (Q[:1], None),
    "scalar": (0.5, None),
    "batch": (np.ones((3, 2)), None),
    "ragged": ([[1.0], [2.0, 3.0]], None),
    "text": (["1", "2"], None),
    "complex": (Q + 1j, None),
    "objects": ([None, 1.0], None),
    "parameters": (Q, Q),
}


def find_wrong(library, wrong):
    beta = np.ones(len(library.card.beta))
    return [beta if value is None else value for value in WRONG[wrong]]


@pytest.mark.parametrize("wrong", sorted(WRONG))
def test_a_bound_function_refuses_what_is_not_one_sample(library, wrong):
    bound = library.bind("gravity")
    values = find_wrong(library, wrong)
    with pytest.raises(UsageError) as caught:
        bound(*values)
    assert caught.value.notices[0].code == "usage.shape"


@pytest.mark.parametrize("wrong", sorted(set(WRONG) - {"batch"}))
def test_evaluate_refuses_what_is_no_array_of_real_numbers(library, wrong):
    values = find_wrong(library, wrong)
    with pytest.raises(UsageError) as caught:
        library.evaluate("gravity", *values)
    assert caught.value.notices[0].code == "usage.shape"


def test_a_bound_function_takes_lists_and_whole_numbers(library):
    bound, beta = library.bind("gravity"), np.ones(len(library.card.beta))
    wanted = library.evaluate("gravity", np.array([1.0, 2.0]), beta)[0]
    np.testing.assert_array_equal(bound([1, 2], list(beta))[0], wanted)
    np.testing.assert_array_equal(bound(np.array([1, 2]), beta)[0], wanted)
    strided = np.array([[1.0, 0.0], [2.0, 0.0]])[:, 0]
    np.testing.assert_array_equal(bound(strided, beta)[0], wanted)


def test_the_status_of_a_bound_function_is_looked_at(folder, monkeypatch):
    library = load_library(folder)
    monkeypatch.setattr(type(library), "_find_symbol", lambda *_: lambda *_: 1)
    with pytest.raises(GenerationError, match="returned the error code 1") as caught:
        library.bind("gravity")(np.ones(2), np.ones(len(library.card.beta)))
    assert caught.value.notices[0].code == "codegen.call-failed"
