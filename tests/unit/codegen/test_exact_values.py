"""Reference values have their fifty digits: the same programs in mpmath's arithmetic with eighty."""

from decimal import Decimal

import casadi as ca
import mpmath
import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.programs import Op
from symid.codegen.references import compute_exact_outputs
from symid.errors import GenerationError
from symid.robot.toml_reader import read_robot
from tests.refusals import raises
from tests.sx_programs import read_sx_program

RULES = {
    Op.ADD: lambda a, b: a + b,
    Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b,
    Op.DIV: lambda a, b: a / b,
    Op.SIN: mpmath.sin,
    Op.COS: mpmath.cos,
    Op.TAN: mpmath.tan,
    Op.SQRT: mpmath.sqrt,
    Op.EXP: mpmath.exp,
    Op.TANH: mpmath.tanh,
    Op.ABS: abs,
    Op.SIGN: mpmath.sign,
    Op.LESS: lambda a, b: mpmath.mpf(a < b),
    Op.LESS_EQUAL: lambda a, b: mpmath.mpf(a <= b),
    Op.IS_ZERO: lambda a: mpmath.mpf(a == 0),
    Op.SELECT: lambda a, b: b if a else mpmath.mpf(0),
    Op.MAXIMUM: max,
    Op.MINIMUM: min,
}


def compute_with_mpmath(program, inputs):
    """Return the outputs at one state, numbers of mpmath."""
    values = [None]

    def read(ref):
        return values[ref] if ref > 0 else -values[-ref]

    for instruction in program.instructions:
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            values.append(mpmath.mpf(inputs[port][element]))
        elif instruction.op is Op.CONSTANT:
            values.append(mpmath.mpf(instruction.constant))
        else:
            values.append(RULES[instruction.op](*map(read, instruction.args)))
    return [[read(ref) for ref in refs] for refs in program.outputs]


def make_exact(values):
    return np.vectorize(Decimal, otypes=[object])(values)


def compare(program, inputs, states):
    exact = compute_exact_outputs(program, [make_exact(values) for values in inputs], states)
    with mpmath.workdps(80):
        for k in range(states):
            wanted = compute_with_mpmath(program, [v if v.ndim == 1 else v[k] for v in inputs])
            for port, row in zip(exact, wanted, strict=True):
                scale = max([abs(value) for value in row] + [mpmath.mpf(10) ** -20])
                for mine, value in zip(port[k], row, strict=True):
                    assert abs(mpmath.mpf(str(mine)) - value) <= mpmath.mpf(10) ** -46 * scale


def make_program(x, y):
    spec = FunctionSpec(
        name="toy",
        inputs=(Port(name="x", shape=(x.numel(),), unit="1", meaning="x"),),
        outputs=(Port(name="y", shape=(y.numel(),), unit="1", meaning="y"),),
        meaning="a toy",
    )
    return read_sx_program(ca.Function("toy", [x], [y], ["x"], ["y"]), spec)


@pytest.mark.parametrize("name", ["mass_matrix", "forward_dynamics", "torque_regressor", "friction"])
def test_functions_of_a_robot(project, name):
    (program,) = build_functions(read_robot(project / "robots" / "two_link.toml"), names=(name,)).programs
    rng = np.random.default_rng(2)
    inputs = [
        rng.uniform(0.5, 2.0, port.size) if port.shared else rng.uniform(-2.0, 2.0, (4, port.size))
        for port in program.spec.inputs
    ]
    compare(program, inputs, 4)


def test_every_operation():
    x = ca.SX.sym("x", 3)
    y = ca.vertcat(
        x[0] + x[1] * x[2],
        x[0] / (3 + x[1]),
        ca.sin(x[0]) - ca.cos(x[1]),
        ca.tan(x[2]),
        ca.sqrt(ca.fabs(x[1])),
        ca.exp(x[2]),
        ca.tanh(x[0]),
        ca.sign(x[1]),
        x[0] < x[1],
        x[0] <= x[1],
        ca.if_else(x[0] < x[1], x[2], -x[2]),
        ca.fmax(x[0], x[1]),
        ca.fmin(x[0], x[2]),
    )
    values = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3))
    values[0] = (0.0, 0.0, 1.0)
    compare(make_program(x, y), [values], 20)


@pytest.mark.parametrize("build", [lambda x: 1 / (x * x - 0.25), lambda x: ca.sqrt(-1 - x * x)])
def test_what_has_no_value_is_refused(build):
    x = ca.SX.sym("x", 1)
    with raises(GenerationError, "codegen.no-reference"):
        compute_exact_outputs(make_program(x, build(x)), [make_exact(np.array([[0.5]]))], 1)
