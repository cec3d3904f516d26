"""CasADi's SX functions as programs: what CasADi has made of expressions, instruction by instruction."""

import operator

import casadi as ca
import mpmath
import numpy as np

from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.programs import ExpressionTable, Op

_FUNCTIONS = {
    ca.OP_SIN: Op.SIN,
    ca.OP_COS: Op.COS,
    ca.OP_EXP: Op.EXP,
    ca.OP_TANH: Op.TANH,
    ca.OP_FABS: Op.ABS,
    ca.OP_SIGN: Op.SIGN,
    ca.OP_LT: Op.LESS,
    ca.OP_LE: Op.LESS_EQUAL,
    ca.OP_FMAX: Op.MAXIMUM,
    ca.OP_FMIN: Op.MINIMUM,
}
_RULES = {
    ca.OP_ASSIGN: lambda _, a: a[0],
    ca.OP_ADD: lambda table, a: table.add(a[0], a[1]),
    ca.OP_SUB: lambda table, a: table.add(a[0], -a[1]),
    ca.OP_MUL: lambda table, a: table.mul(a[0], a[1]),
    ca.OP_DIV: lambda table, a: table.div(a[0], a[1]),
    ca.OP_NEG: lambda _, a: -a[0],
    ca.OP_TWICE: lambda table, a: table.add(a[0], a[0]),
    ca.OP_SQ: lambda table, a: table.mul(a[0], a[0]),
    ca.OP_INV: lambda table, a: table.div(table.constant(1.0), a[0]),
    **{code: lambda table, a, op=op: table.apply(op, *a) for code, op in _FUNCTIONS.items()},
}


def list_row_major(sparsity):
    """Return the row-major element of each nonzero: CasADi counts by columns."""
    columns = sparsity.size2()
    return [r * columns + c for r, c in zip(sparsity.row(), sparsity.get_col(), strict=True)]


def read_sx_program(function, spec):
    """Return the instructions of `function`, simplified, in the order in which CasADi has them."""
    assert function.is_a("SXFunction")
    assert function.name_in() == [port.name for port in spec.inputs]
    assert function.name_out() == [port.name for port in spec.outputs]
    table, work = ExpressionTable(), {}
    inputs = [list_row_major(function.sparsity_in(i)) for i in range(function.n_in())]
    elements = [list_row_major(function.sparsity_out(i)) for i in range(function.n_out())]
    # What CasADi leaves out of a sparse output is zero.
    outputs = [[table.constant(0.0)] * port.size for port in spec.outputs]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            work[target[0]] = table.constant(function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            work[target[0]] = table.input(source[0], inputs[source[0]][source[1]])
        elif code == ca.OP_OUTPUT:
            outputs[target[0]][elements[target[0]][target[1]]] = work[source[0]]
        else:
            work[target[0]] = _RULES[code](table, [work[i] for i in source])
    return table.build_program(spec, outputs)


def make_spec(inputs, outputs, name="f"):
    """Return the spec of a function from the shapes of its ports by name; a number is a vector's size."""

    def list_ports(shapes):
        pairs = ((key, shape if isinstance(shape, tuple) else (shape,)) for key, shape in shapes.items())
        return tuple(Port(name=key, shape=shape, unit="1", meaning="number") for key, shape in pairs)

    return FunctionSpec(name=name, inputs=list_ports(inputs), outputs=list_ports(outputs), meaning="test")


def make_toy(build, name="f", *, shape=None, **sizes):
    """Return CasADi's function of vectors of the sizes, with one output y, and its program."""
    symbols = [ca.SX.sym(key, size) for key, size in sizes.items()]
    value = ca.densify(build(*symbols))
    function = ca.Function(name, symbols, [value], list(sizes), ["y"])
    return function, read_sx_program(function, make_spec(sizes, {"y": shape or value.numel()}, name))


def interpret(program, inputs, rules, number):
    """Return the outputs by port, lists of `number`s, from the elements of each input."""
    values = [number(0)]

    def read(ref):
        return values[ref] if ref > 0 else -values[-ref]

    for instruction in program.instructions:
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            values.append(number(inputs[port][element]))
        elif instruction.op is Op.CONSTANT:
            values.append(number(instruction.constant))
        else:
            values.append(number(rules[instruction.op](*map(read, instruction.args))))
    return [[read(ref) for ref in refs] for refs in program.outputs]


_PLAIN = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.ABS: abs,
    Op.LESS: operator.lt,
    Op.LESS_EQUAL: operator.le,
    Op.MAXIMUM: max,
    Op.MINIMUM: min,
}


def list_rules(module):
    """Return what operations are in numbers of NumPy or mpmath."""
    return _PLAIN | {op: getattr(module, op.value) for op in (Op.SIN, Op.COS, Op.EXP, Op.TANH, Op.SIGN)}


def run_with_mpmath(program, inputs):
    """Return the outputs at one state, numbers of mpmath, from the elements of each input."""
    return interpret(program, inputs, list_rules(mpmath), mpmath.mpf)


def run_program(program, inputs):
    """Return the outputs of a program as arrays of the ports' shapes, computed in double precision."""
    given = [np.ravel(inputs[port.name]) for port in program.spec.inputs]
    found = interpret(program, given, list_rules(np), float)
    ports = zip(program.spec.outputs, found, strict=True)
    return [np.array(values, dtype=float).reshape(port.shape) for port, values in ports]
