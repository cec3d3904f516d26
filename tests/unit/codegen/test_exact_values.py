"""Reference values have their fifty digits, and exist for values of any robot file."""

import sys
from dataclasses import replace
from decimal import Decimal

import casadi as ca
import mpmath
import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import Functions
from symid.codegen.functions import JointCard
from symid.codegen.python_targets import generate_python_module
from symid.codegen.references import compute_exact_outputs
from symid.errors import GenerationError
from tests.builds import build_shipped, make, run, spoil, write_c, write_python
from tests.sx_programs import make_toy, run_with_mpmath


def make_exact(values):
    return np.vectorize(Decimal, otypes=[object])(values)


def compare(program, inputs, states):
    exact = compute_exact_outputs(program, [make_exact(values) for values in inputs], states)
    with mpmath.workdps(80):
        for k in range(states):
            wanted = run_with_mpmath(program, [v if v.ndim == 1 else v[k] for v in inputs])
            for port, row in zip(exact, wanted, strict=True):
                scale = max([abs(value) for value in row] + [mpmath.mpf(10) ** -20])
                for mine, value in zip(port[k], row, strict=True):
                    assert abs(mpmath.mpf(str(mine)) - value) <= mpmath.mpf(10) ** -46 * scale


@pytest.mark.parametrize("name", ["mass_matrix", "forward_dynamics", "torque_regressor", "friction"])
def test_functions_of_a_robot(name):
    (program,) = build_shipped("two_link", name).programs
    rng = np.random.default_rng(2)
    inputs = [
        rng.uniform(0.5, 2.0, port.size) if port.shared else rng.uniform(-2.0, 2.0, (4, port.size))
        for port in program.spec.inputs
    ]
    compare(program, inputs, 4)


def use_every_operation(x):
    return ca.vertcat(
        x[0] + x[1] * x[2],
        x[0] / (3 + x[1]),
        ca.sin(x[0]) - ca.cos(x[1]),
        *(ca.exp(x[2]), ca.tanh(x[0]), ca.sign(x[1]), ca.fabs(x[1])),
        *(x[0] < x[1], x[0] <= x[1], ca.fmax(x[0], x[1]), ca.fmin(x[0], x[2])),
    )


def test_every_operation():
    values = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3))
    values[0] = (0.0, 0.0, 1.0)
    compare(make_toy(use_every_operation, x=3)[1], [values], 20)


@pytest.fixture(scope="module")
def made():
    return build_shipped("two_link")


def give(made, values):
    beta = tuple(replace(entry, value=value) for entry, value in zip(made.card.beta, values, strict=True))
    return dict(generate_python_module(replace(made, card=replace(made.card, beta=beta))).files)


@pytest.mark.parametrize("value", [0.0, float("nan")])
def test_values_without_inertia_are_not_used(made, value):
    assert give(made, [value] * 6) == give(made, [None] * 6)


def test_known_values_are_used_where_they_are_fit(made):
    values = [1.5, 0.25, 0.125, 0.75, 0.0625, 0.03125]
    assert repr(values) in give(made, values)["symid_two_link.py"]


def build_toy(made, build):
    function, program = make_toy(build, "toy", x=2)
    joint = JointCard(number=1, name="a", kind="revolute", friction="none")
    empty = {"joints": (joint,), "beta": (), "friction": ()}
    card = replace(made.card, robot="toy", functions=(program.spec,), **empty)
    return Functions(card=card, programs=(program,), functions=(function,))


@pytest.mark.parametrize("build", [lambda x: x / (x - x), lambda x: ca.exp(x / 0)])
def test_a_function_without_a_value_is_said(made, build):
    with pytest.raises(GenerationError) as caught:
        generate_c_library(build_toy(made, build))
    assert caught.value.notices[0].code in {"codegen.no-reference", "codegen.disagrees"}


def test_self_tests_notice_wrong_small_numbers(made, tmp_path, c_compiler):
    toy = build_toy(made, lambda x: 1e-9 * x)
    paths = (
        write_c(toy, tmp_path / "c") / "symid_toy_toy.c",
        write_python(toy, tmp_path / "p") / "symid_toy.py",
    )

    def list_codes():
        c = make(tmp_path / "c", c_compiler, "check", check=False)
        python = run(tmp_path / "p", sys.executable, "symid_toy.py", check=False)
        return [done.returncode != 0 for done in (c, python)]

    assert list_codes() == [False, False]
    for path in paths:
        spoil(path, "1e-09 *", "1.001e-09 *")
    assert list_codes() == [True, True]


def test_exact_code_passes_where_rounding_alone_exceeds_the_tolerance(made, tmp_path, c_compiler):
    """The cosine of a large angle: no value of x is better than another."""
    write_c(build_toy(made, lambda x: ca.cos(1e6 + ca.sin(x))), tmp_path)
    make(tmp_path, c_compiler, "check")
    path = tmp_path / "symid_toy_toy.c"
    text = path.read_text()
    spoilt = text.replace(" + 1000000.0", " - 1000000.0").replace("1000000.0 + t", "1000000.0 - t")
    assert spoilt != text
    path.write_text(spoilt)
    assert make(tmp_path, c_compiler, "check", check=False).returncode != 0
