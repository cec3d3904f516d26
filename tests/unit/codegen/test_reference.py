"""Reference values where the robot file's own values leave none, and self-tests of small numbers."""

import subprocess
import sys
from dataclasses import replace

import casadi as ca
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import Functions, build_functions
from symid.codegen.functions import FunctionSpec, JointCard, Port
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import write_sources
from symid.errors import GenerationError
from symid.robot.toml_reader import read_robot
from tests.sx_programs import read_sx_program


@pytest.fixture(scope="module")
def made(project):
    return build_functions(read_robot(project / "robots" / "two_link.toml"))


def give(made, value):
    beta = tuple(replace(parameter, value=value) for parameter in made.card.beta)
    return replace(made, card=replace(made.card, beta=beta))


@pytest.mark.parametrize("value", [0.0, float("nan")])
def test_values_without_inertia_are_not_used(made, value):
    files = dict(generate_python_module(give(made, value)).files)
    assert files == dict(generate_python_module(give(made, None)).files)


def test_known_values_are_used_where_they_are_fit(made):
    values = (1.5, 0.25, 0.125, 0.75, 0.0625, 0.03125)
    card = replace(
        made.card,
        beta=tuple(
            replace(parameter, value=value) for parameter, value in zip(made.card.beta, values, strict=True)
        ),
    )
    files = dict(generate_python_module(replace(made, card=card)).files)
    assert repr(list(values)) in files["symid_two_link.py"]


def make_toy(made, build):
    x = ca.SX.sym("x", 2)
    spec = FunctionSpec(
        name="toy",
        inputs=(Port(name="x", shape=(2,), unit="1", meaning="x"),),
        outputs=(Port(name="y", shape=(2,), unit="1", meaning="y"),),
        meaning="a toy",
    )
    joint = JointCard(number=1, name="a", kind="revolute", friction="none")
    card = replace(made.card, robot="toy", joints=(joint,), beta=(), friction=(), functions=(spec,))
    function = ca.Function("toy", [x], [build(x)], ["x"], ["y"])
    return Functions(card=card, programs=(read_sx_program(function, spec),), functions=(function,))


@pytest.mark.parametrize(
    "build", [lambda x: x / (x - x), lambda x: ca.sqrt(-1 - x * x), lambda x: ca.exp(x / 0)]
)
def test_a_function_without_a_value_is_said(made, build):
    with pytest.raises(GenerationError) as caught:
        generate_c_library(make_toy(made, build))
    assert caught.value.notices[0].code in {"codegen.no-reference", "codegen.disagrees"}


def test_self_tests_notice_wrong_small_numbers(made, tmp_path, c_compiler):
    toy = make_toy(made, lambda x: 1e-9 * x)
    write_sources(generate_c_library(toy), tmp_path / "c")
    write_sources(generate_python_module(toy), tmp_path / "p")
    runs = {
        "c": ["make", "-s", f"CC={c_compiler}", "check"],
        "p": [sys.executable, "symid_toy.py"],
    }
    for folder, source in (("c", "symid_toy_toy.c"), ("p", "symid_toy.py")):
        for factor, good in (("1e-09", True), ("1.001e-09", False)):
            path = tmp_path / folder / source
            text = path.read_text()
            assert "1e-09 *" in text
            path.write_text(text.replace("1e-09 *", f"{factor} *"))
            done = subprocess.run(runs[folder], cwd=tmp_path / folder, capture_output=True, check=False)
            assert (done.returncode == 0) is good, (folder, done.stdout)


def test_exact_code_passes_where_rounding_alone_exceeds_the_tolerance(made, tmp_path, c_compiler):
    """The cosine of a large angle: no value of x is better than another."""
    toy = make_toy(made, lambda x: ca.cos(1e6 + ca.sin(x)))
    write_sources(generate_c_library(toy), tmp_path)
    run = ["make", "-s", f"CC={c_compiler}", "check"]
    assert subprocess.run(run, cwd=tmp_path, capture_output=True, check=False).returncode == 0
    path = tmp_path / "symid_toy_toy.c"
    text = path.read_text()
    spoilt = text.replace(" + 1000000.0", " - 1000000.0").replace("1000000.0 + t", "1000000.0 - t")
    assert spoilt != text
    path.write_text(spoilt)
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode != 0
