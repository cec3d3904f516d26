"""Reference values have their fifty digits: the same programs in mpmath's arithmetic with eighty."""

from decimal import Decimal

import casadi as ca
import mpmath
import numpy as np
import pytest

from symid.codegen.references import compute_exact_outputs
from symid.errors import GenerationError
from tests.builds import build_shipped
from tests.refusals import raises
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
        *(ca.tan(x[2]), ca.sqrt(ca.fabs(x[1])), ca.exp(x[2]), ca.tanh(x[0]), ca.sign(x[1])),
        *(x[0] < x[1], x[0] <= x[1], ca.if_else(x[0] < x[1], x[2], -x[2])),
        *(ca.fmax(x[0], x[1]), ca.fmin(x[0], x[2])),
    )


def test_every_operation():
    values = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3))
    values[0] = (0.0, 0.0, 1.0)
    compare(make_toy(use_every_operation, x=3)[1], [values], 20)


@pytest.mark.parametrize("build", [lambda x: 1 / (x * x - 0.25), lambda x: ca.sqrt(-1 - x * x)])
def test_what_has_no_value_is_refused(build):
    with raises(GenerationError, "codegen.no-reference"):
        compute_exact_outputs(make_toy(build, x=1)[1], [make_exact(np.array([[0.5]]))], 1)
