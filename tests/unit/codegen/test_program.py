"""Programs, read from CasADi or written and differentiated, against CasADi's own evaluation."""

import casadi as ca
import numpy as np
import pytest

from symid.codegen.casadi_functions import build_sx_function
from symid.codegen.functions import ModelCard, list_robot_specs
from symid.codegen.printing import print_c
from symid.codegen.programs import (
    ExpressionTable,
    Op,
    Operations,
    count_operations,
    differentiate_along,
    differentiate_backward,
)
from symid.codegen.references import build_references
from symid.codegen.routes import choose_route
from symid.dynamics.base_parameters import derive_base_parameters
from symid.errors import GenerationError
from symid.options import GenerateOptions
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, build_chain
from tests.refusals import raises
from tests.sx_programs import make_spec, make_toy, read_sx_program, run_program


def build(expression, *, size=3):
    return make_toy(lambda x: ca.vertcat(*expression(x)), x=size)[1]


def ops(program):
    return [instruction.op for instruction in program.instructions if instruction.op is not Op.INPUT]


def test_counts_follow_the_rule():
    program = build(lambda x: [x[0] ** 2 + x[1] / x[2], x[0] + x[0], -x[1], ca.sin(x[0]), ca.cos(x[0])])
    assert count_operations(program) == Operations(mul=2, add=2, trig=2)


def test_negation_costs_nothing_and_is_pushed_through():
    program = build(lambda x: [-(x[0] * -x[1]), ca.sin(-x[0]), ca.cos(-x[0]), -x[0] - x[1]])
    assert ops(program) == [Op.MUL, Op.SIN, Op.COS, Op.ADD]
    assert [ref > 0 for ref in program.outputs[0]] == [True, False, True, False]


def test_equal_expressions_are_computed_once():
    program = build(lambda x: [x[0] * x[1], x[1] * x[0], x[0] - x[1], x[1] - x[0]])
    assert ops(program) == [Op.MUL, Op.SUB]
    a, b, c, d = program.outputs[0]
    assert (a, c) == (b, -d)


def test_what_no_output_needs_is_left_out():
    table = ExpressionTable()
    x = table.input(0, 0)
    table.apply(Op.SIN, x)
    program = table.build_program(make_spec({}, {"y": 1}), [[-table.apply(Op.COS, x)]])
    assert [instruction.op for instruction in program.instructions] == [Op.INPUT, Op.COS]
    assert program.outputs == ((-2,),)


def test_a_program_that_disagrees_with_casadi_is_refused():
    program = build(lambda x: [x[0] * x[1], x[1], x[2]])
    x = ca.SX.sym("x", 3)
    other = ca.Function("f", [x], [ca.vertcat(x[0] * x[1], x[1], -x[2])], ["x"], ["y"])
    card = ModelCard(robot="r", signature="", joints=(), beta=(), friction=(), functions=(program.spec,))
    with raises(GenerationError, "codegen.disagrees", match=r"'f'.*'y'"):
        build_references(card, [other], [program], GenerateOptions())


def test_what_costs_nothing_is_not_computed():
    """Zero and one, constant factors put together, what was added taken away again."""
    table = ExpressionTable()
    x, y = table.input(0, 0), table.input(0, 1)
    zero, half, one, two, three = map(table.constant, (0.0, 0.5, 1.0, 2.0, 3.0))
    add, mul, total, difference = table.add, table.mul, table.add(x, y), table.add(x, -y)
    rows = [
        (mul(one, x), x),
        (mul(table.constant(-1.0), x), -x),
        (add(x, zero), x),
        (mul(zero, x), zero),
        (add(x, -x), zero),
        (mul(two, x), add(x, x)),
        (table.div(x, one), x),
        (table.div(x, two), mul(x, half)),
        (table.div(zero, x), zero),
        (add(total, -y), x),
        (add(-total, x), -y),
        (add(difference, y), x),
        (add(y, difference), x),
        (add(-difference, -y), -x),
        (add(mul(half, x), mul(half, x)), x),
        (mul(three, mul(half, -x)), -mul(table.constant(1.5), x)),
        (mul(three, add(x, x)), mul(table.constant(6.0), x)),
    ]
    assert [found for found, _ in rows] == [wanted for _, wanted in rows]
    assert add(total, y) not in (x, y, total)


def test_counting_equals_collecting():
    table = ExpressionTable()
    x, y = table.input(0, 0), table.input(0, 1)
    outputs = [table.mul(table.apply(Op.SIN, x), y), table.add(x, table.div(y, x))]
    table.mul(y, y)
    assert table.count(outputs) == Operations(mul=2, add=1, trig=1)
    program = table.build_program(make_spec({}, {"y": 2}), [outputs])
    assert [op for _, op, _ in table.walk(outputs)] == [entry.op for entry in program.instructions]


def test_there_is_one_zero():
    table = ExpressionTable()
    x, zero = table.input(0, 0), table.constant(0.0)
    assert table.constant(-0.0) == table.neg(zero) == table.neg(table.mul(-x, zero)) == zero
    program = table.build_program(make_spec({"x": 1}, {"y": 3}), [[zero, -zero, -x]])
    (first, second, third), (number,) = (
        program.outputs[0],
        [k for k, instruction in enumerate(program.instructions, start=1) if instruction.op is Op.CONSTANT],
    )
    assert (first, second, third < 0) == (number, number, True)
    assert print_c(program, "double").statements == ("y[0] = 0.0;", "y[1] = 0.0;", "y[2] = -x[0];")


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


def evaluate_at_point(table, refs):
    function = build_sx_function(table.build_program(make_spec({"x": 3}, {"y": len(refs)}), [refs]))
    return np.array(function(POINT)).ravel()


def test_gradient_equals_casadi(table):
    inputs, value = write(table)
    for sign in (1, -1):
        found = evaluate_at_point(table, differentiate_backward(table, sign * value, inputs))
        np.testing.assert_allclose(found, sign * reference(), rtol=1e-13)


def test_rates_equal_the_gradient_in_a_direction(table):
    inputs, value = write(table)
    direction = [table.constant(0.5), table.constant(-2.0), inputs[0]]
    (rate,) = evaluate_at_point(
        table, differentiate_along(table, [value], [dict(zip(inputs, direction, strict=True))])[0]
    )
    assert rate == pytest.approx(reference() @ [0.5, -2.0, POINT[0]], rel=1e-13)


def test_constants_do_not_move(table):
    x, zero, one = table.input(0, 0), table.constant(0.0), table.constant(1.0)
    assert differentiate_backward(table, zero, [zero, x]) == [zero, zero]
    assert differentiate_along(table, [table.mul(x, x), zero], [{zero: one, one: one}]) == [[zero, zero]]


def test_an_operation_without_a_derivative_is_refused(table):
    x = table.input(0, 0)
    bent = table.apply(Op.TANH, x)
    with pytest.raises(TypeError, match="no derivative of tanh"):
        differentiate_backward(table, bent, [x])
    with pytest.raises(TypeError, match="no derivative of tanh"):
        differentiate_along(table, [bent], [{x: table.constant(1.0)}])


DRIVEN = build_chain(
    [(0.0, 0, 0, "q"), (np.pi / 6, 0.3, 0.1, "q"), (np.pi / 2, 0.1, "q", 0.0)],
    rotors=True,
    friction="asymmetric",
    name="driven",
)


def build_function(inputs, outputs, write):
    """Return CasADi's function of `write`, which gives the outputs' references from a table."""
    table = ExpressionTable()
    return build_sx_function(table.build_program(make_spec(inputs, outputs), write(table)))


@pytest.mark.parametrize("robot", [TWO_LINK, PUMA560, PANDA, STANFORD, DRIVEN], ids=lambda r: r.name)
def test_what_casadi_holds_is_the_program(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(1)
    for spec in list_robot_specs(robot, base):
        program = choose_route(robot, base, spec).program
        function = build_sx_function(program)
        held, wanted = count_operations(read_sx_program(function, spec)), count_operations(program)
        # CasADi makes quotients again of products with the inverse of a pivot, one product less a pivot.
        pivots = robot.freedom if spec.name == "forward_dynamics" else 0
        assert (held.mul + pivots, held.add, held.trig) == (wanted.mul, wanted.add, wanted.trig), spec.name
        inputs = {port.name: rng.uniform(-1, 1, port.shape) for port in spec.inputs}
        results = function.call([inputs[port.name] for port in spec.inputs])
        for found, expected in zip(results, run_program(program, inputs), strict=True):
            scale = max(1.0, np.abs(expected).max(initial=0.0))
            shaped = np.array(found).reshape(expected.shape)
            np.testing.assert_allclose(shaped, expected, rtol=0, atol=1e-10 * scale)


def test_matrices_go_in_and_out_by_rows():
    function = build_function(
        {"a": (2, 3), "b": 2},
        {"y": (3, 2), "z": (2, 3, 1)},
        lambda table: (
            [table.mul(table.input(0, k), table.input(1, k % 2)) for k in range(6)],
            [-table.input(0, k) for k in range(6)],
        ),
    )
    a, b = np.arange(1.0, 7.0).reshape(2, 3), np.array([10.0, 100.0])
    y, z = function(a, b)
    np.testing.assert_array_equal(np.array(y), (a.ravel() * np.tile(b, 3)).reshape(3, 2))
    np.testing.assert_array_equal(np.array(z), -a)


@pytest.mark.parametrize("value", [-1.5, 0.0, 0.25])
def test_every_operation_has_a_rule(value):
    def write(table):
        x, y = table.input(0, 0), table.constant(0.2)
        single = [table.apply(op, x) for op in (Op.SIN, Op.COS, Op.EXP, Op.TANH, Op.ABS, Op.SIGN)]
        double = [table.apply(op, -x, y) for op in (Op.LESS, Op.LESS_EQUAL, Op.MAXIMUM, Op.MINIMUM)]
        return [[*single, *double, table.div(x, table.add(x, table.constant(9.0)))]]

    found = np.array(build_function({"x": 1}, {"y": 11}, write)(value)).ravel()
    x = value
    plain = [f(x) for f in (np.sin, np.cos, np.exp, np.tanh, abs, np.sign)]
    tests = [-x < 0.2, -x <= 0.2, max(-x, 0.2), min(-x, 0.2), x / (x + 9.0)]
    np.testing.assert_allclose(found, np.array([*plain, *tests], dtype=float), rtol=1e-14, atol=1e-300)


def test_a_function_without_inputs_or_outputs_can_be_written():
    function = build_function(
        {"f": 0}, {"y": (2, 0), "z": 2}, lambda t: ([], [t.constant(0.0), t.constant(-3.0)])
    )
    empty, constants = function(np.zeros((0, 1)))
    assert empty.shape == (2, 0)
    np.testing.assert_array_equal(np.array(constants).ravel(), [0.0, -3.0])
