"""The order of instructions: what a program computes stays, fewer values are alive."""

import re

import numpy as np
import pytest

from symid.codegen.functions import list_robot_specs
from symid.codegen.printing import print_python
from symid.codegen.programs import ExpressionTable, Op, build_depth_first, count_operations
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import PUMA560, STANFORD, build_route_programs, run_program
from tests.sx_programs import make_spec


def count_registers(program):
    found = (re.match(r"t(\d+) =", text) for text in print_python(program))
    return max(int(match[1]) for match in found if match)


@pytest.mark.parametrize("robot", [PUMA560, STANFORD], ids=lambda r: r.name)
def test_the_same_values_with_fewer_alive(robot):
    base = derive_base_parameters(robot)
    rng = np.random.default_rng(1)
    before, after = 0, 0
    for spec in list_robot_specs(robot, base):
        inputs = {port.name: rng.uniform(-1, 1, port.shape) for port in spec.inputs}
        for program in build_route_programs(robot, base, spec).values():
            ordered = build_depth_first(program)
            assert count_operations(ordered) == count_operations(program)
            assert build_depth_first(ordered) == ordered
            for mine, theirs in zip(run_program(ordered, inputs), run_program(program, inputs), strict=True):
                np.testing.assert_array_equal(mine, theirs)
            # Products of full matrices need all entries of both, in any order.
            if spec.name != "forward_dynamics_derivatives":
                before, after = before + count_registers(program), after + count_registers(ordered)
    assert after < 0.8 * before


def test_the_larger_operand_comes_first():
    table = ExpressionTable()
    a, b, c = (table.input(0, k) for k in range(3))
    small = table.apply(Op.SIN, c)
    large = table.mul(table.add(a, b), table.apply(Op.COS, b))
    outputs = [table.mul(small, large), table.mul(c, c)]
    ordered = build_depth_first(table.build_program(make_spec({"x": 3}, {"y": 2}), [outputs]))
    found = [instruction.op for instruction in ordered.instructions if instruction.op is not Op.INPUT]
    assert found == [Op.ADD, Op.COS, Op.MUL, Op.SIN, Op.MUL, Op.MUL]
