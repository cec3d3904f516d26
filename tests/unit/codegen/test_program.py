"""Programs read from CasADi, against CasADi's own evaluation."""

import casadi as ca

from symid.codegen.functions import ModelCard
from symid.codegen.printing import print_c
from symid.codegen.programs import ExpressionTable, Op, Operations, ValueAlgebra, count_operations
from symid.codegen.references import build_references
from symid.codegen.source_text import GenerateOptions
from symid.errors import GenerationError
from tests.refusals import raises
from tests.sx_programs import make_spec, make_toy


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


def test_zero_and_one_never_reach_the_code():
    table = ExpressionTable()
    x = table.input(0, 0)
    one, zero, two = (table.constant(value) for value in (1.0, 0.0, 2.0))
    assert table.mul(one, x) == x
    assert table.mul(table.constant(-1.0), x) == -x
    assert table.add(x, zero) == x
    assert table.mul(zero, x) == zero
    assert table.add(x, -x) == zero
    assert table.mul(two, x) == table.add(x, x)
    assert table.div(x, one) == x
    assert table.div(x, two) == table.mul(x, table.constant(0.5))


def test_matrices_are_read_by_rows():
    _, program = make_toy(lambda x: ca.reshape(x, 2, 3), x=6, shape=(2, 3))
    elements = [program.instructions[ref - 1].args[1] for ref in program.outputs[0]]
    assert elements == [0, 2, 4, 1, 3, 5]


def test_a_program_that_disagrees_with_casadi_is_refused():
    program = build(lambda x: [x[0] * x[1], x[1], x[2]])
    x = ca.SX.sym("x", 3)
    other = ca.Function("f", [x], [ca.vertcat(x[0] * x[1], x[1], -x[2])], ["x"], ["y"])
    card = ModelCard(robot="r", signature="", joints=(), beta=(), friction=(), functions=(program.spec,))
    with raises(GenerationError, "codegen.disagrees", match=r"'f'.*'y'"):
        build_references(card, [other], [program], GenerateOptions())


def test_what_was_added_is_taken_away_again():
    table = ExpressionTable()
    x, y = table.input(0, 0), table.input(0, 1)
    total, difference = table.add(x, y), table.add(x, -y)
    assert table.add(total, -y) == x
    assert table.add(-total, x) == -y
    assert table.add(difference, y) == x
    assert table.add(y, difference) == x
    assert table.add(-difference, -y) == -x
    assert table.add(total, y) not in (x, y, total)


def test_constant_factors_are_put_together():
    table = ExpressionTable()
    x = table.input(0, 0)
    half, three = table.constant(0.5), table.constant(3.0)
    assert table.add(table.mul(half, x), table.mul(half, x)) == x
    assert table.mul(three, table.mul(half, -x)) == -table.mul(table.constant(1.5), x)
    assert table.mul(three, table.add(x, x)) == table.mul(table.constant(6.0), x)
    assert table.div(table.constant(0.0), x) == table.constant(0.0)


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
    algebra = ValueAlgebra(table)
    assert table.constant(-0.0) == algebra.neg(zero) == algebra.neg(table.mul(-x, zero)) == zero
    program = table.build_program(make_spec({"x": 1}, {"y": 3}), [[zero, -zero, -x]])
    (first, second, third), (number,) = (
        program.outputs[0],
        [k for k, instruction in enumerate(program.instructions, start=1) if instruction.op is Op.CONSTANT],
    )
    assert (first, second, third < 0) == (number, number, True)
    assert print_c(program, "double").statements == ("y[0] = 0.0;", "y[1] = 0.0;", "y[2] = -x[0];")
