"""CasADi functions written from programs: they compute the same, and of known robots read back alike."""

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_sx_function
from symid.codegen.functions import list_robot_specs
from symid.codegen.programs import ExpressionTable, Op, count_operations
from symid.codegen.routes import choose_route
from symid.dynamics.base_parameters import derive_base_parameters
from tests.chains import PANDA, PUMA560, STANFORD, TWO_LINK, build_chain, run_program
from tests.sx_programs import make_spec, read_sx_program

DRIVEN = build_chain(
    [(0.0, 0, 0, "q"), (np.pi / 6, 0.3, 0.1, "q"), (np.pi / 2, 0.1, "q", 0.0)],
    rotors=True,
    friction="asymmetric",
    name="driven",
)


def build(inputs, outputs, write):
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
    function = build(
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
        kinds = (Op.SIN, Op.COS, Op.TAN, Op.EXP, Op.TANH, Op.ABS, Op.SIGN, Op.IS_ZERO)
        single = [table.apply(op, x) for op in kinds]
        root = table.apply(Op.SQRT, table.apply(Op.ABS, x))
        double = [table.apply(op, -x, y) for op in (Op.LESS, Op.LESS_EQUAL)]
        chosen = table.apply(Op.SELECT, table.apply(Op.LESS, x, y), -x)
        return [[*single, root, *double, chosen, table.div(x, table.add(x, table.constant(9.0)))]]

    found = np.array(build({"x": 1}, {"y": 13}, write)(value)).ravel()
    x = value
    plain = [f(x) for f in (np.sin, np.cos, np.tan, np.exp, np.tanh, abs, np.sign)] + [x == 0, abs(x) ** 0.5]
    tests = [-x < 0.2, -x <= 0.2, -x if x < 0.2 else 0.0, x / (x + 9.0)]
    np.testing.assert_allclose(found, np.array([*plain, *tests], dtype=float), rtol=1e-14, atol=1e-300)


def test_a_function_without_inputs_or_outputs_can_be_written():
    function = build({"f": 0}, {"y": (2, 0), "z": 2}, lambda t: ([], [t.constant(0.0), t.constant(-3.0)]))
    empty, constants = function(np.zeros((0, 1)))
    assert empty.shape == (2, 0)
    np.testing.assert_array_equal(np.array(constants).ravel(), [0.0, -3.0])
