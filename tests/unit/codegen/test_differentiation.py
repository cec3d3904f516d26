"""Derivatives written into a table, against CasADi's."""

import casadi as ca
import numpy as np
import pytest

from symid.codegen.casadi_functions import build_sx_function
from symid.codegen.programs import ExpressionTable, Op, differentiate_along, differentiate_backward
from tests.sx_programs import make_spec

POINT = np.array([0.7, -1.3, 2.1])


@pytest.fixture
def table():
    return ExpressionTable()


def write(table):
    """Return the inputs and a value that uses every supported operation, with shared parts and signs."""
    x, y, z = (table.input(0, k) for k in range(3))
    product = table.mul(x, -y)
    wave = table.apply(Op.SIN, table.add(product, z))
    other = table.apply(Op.COS, table.add(x, -z))
    return (x, y, z), table.add(table.div(wave, other), table.mul(product, -table.mul(product, wave)))


def reference():
    x = ca.SX.sym("x", 3)
    p = -x[0] * x[1]
    wave = ca.sin(p + x[2])
    value = wave / ca.cos(x[0] - x[2]) - p * p * wave
    return np.array(ca.Function("f", [x], [ca.gradient(value, x)])(POINT)).ravel()


def evaluate(table, refs):
    function = build_sx_function(table.build_program(make_spec({"x": 3}, {"y": len(refs)}), [refs]))
    return np.array(function(POINT)).ravel()


def test_gradient_equals_casadi(table):
    inputs, value = write(table)
    for sign in (1, -1):
        found = evaluate(table, differentiate_backward(table, sign * value, inputs))
        np.testing.assert_allclose(found, sign * reference(), rtol=1e-13)


def test_rates_equal_the_gradient_in_a_direction(table):
    inputs, value = write(table)
    direction = [table.constant(0.5), table.constant(-2.0), inputs[0]]
    (rate,) = evaluate(
        table, differentiate_along(table, [value], [dict(zip(inputs, direction, strict=True))])[0]
    )
    assert rate == pytest.approx(reference() @ [0.5, -2.0, POINT[0]], rel=1e-13)


def test_constants_do_not_move(table):
    x, zero, one = table.input(0, 0), table.constant(0.0), table.constant(1.0)
    assert differentiate_backward(table, zero, [zero, x]) == [zero, zero]
    assert differentiate_along(table, [table.mul(x, x), zero], [{zero: one, one: one}]) == [[zero, zero]]


def test_an_operation_without_a_derivative_is_refused(table):
    x = table.input(0, 0)
    root = table.apply(Op.SQRT, x)
    with pytest.raises(TypeError, match="no derivative of sqrt"):
        differentiate_backward(table, root, [x])
    with pytest.raises(TypeError, match="no derivative of sqrt"):
        differentiate_along(table, [root], [{x: table.constant(1.0)}])
