"""From a CasADi SX function to a straight-line program.

Input: a function of the catalogue, as CasADi built it. Output: `Program`.

CasADi numbers the elements of a matrix by columns, symid by rows; this is where it turns.

Supported: the operations that rigid dynamics and joint friction are made of.
Not supported: MX functions, calls, powers other than squares; they are refused by name.
"""

from collections.abc import Callable, Iterator

import casadi as ca

from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.instructions import Op, Program
from symid.codegen.values import ValueTable
from symid.errors import GenerationError, Notice

__all__ = ["build_program"]

_NAMES: dict[int, str] = {getattr(ca, name): name for name in sorted(dir(ca)) if name.startswith("OP_")}

_FUNCTIONS: dict[int, Op] = {
    ca.OP_SIN: Op.SIN,
    ca.OP_COS: Op.COS,
    ca.OP_TAN: Op.TAN,
    ca.OP_SQRT: Op.SQRT,
    ca.OP_EXP: Op.EXP,
    ca.OP_TANH: Op.TANH,
    ca.OP_FABS: Op.ABS,
    ca.OP_SIGN: Op.SIGN,
    ca.OP_LT: Op.LESS,
    ca.OP_LE: Op.LESS_EQUAL,
    ca.OP_NOT: Op.IS_ZERO,
    ca.OP_IF_ELSE_ZERO: Op.SELECT,
    ca.OP_FMAX: Op.MAXIMUM,
    ca.OP_FMIN: Op.MINIMUM,
}

Rule = Callable[[ValueTable, list[int]], int]

_ARITHMETIC: dict[int, Rule] = {
    ca.OP_ASSIGN: lambda _, a: a[0],
    ca.OP_ADD: lambda table, a: table.add(a[0], a[1]),
    ca.OP_SUB: lambda table, a: table.add(a[0], -a[1]),
    ca.OP_MUL: lambda table, a: table.mul(a[0], a[1]),
    ca.OP_DIV: lambda table, a: table.div(a[0], a[1]),
    ca.OP_NEG: lambda _, a: -a[0],
    ca.OP_TWICE: lambda table, a: table.add(a[0], a[0]),
    ca.OP_SQ: lambda table, a: table.mul(a[0], a[0]),
    ca.OP_INV: lambda table, a: table.div(table.constant(1.0), a[0]),
}


def _fail(spec: FunctionSpec, code: str, text: str) -> GenerationError:
    return GenerationError(Notice(code=code, text=f"function {spec.name!r}: {text}"))


def _check_shape(spec: FunctionSpec, port: Port, sparsity: ca.Sparsity) -> None:
    rows, columns = sparsity.shape
    if rows * columns != port.size or (port.shape and rows != port.shape[0]):
        text = f"port {port.name!r} has {rows} x {columns} elements, its shape says {port.shape}"
        raise _fail(spec, "codegen.wrong-shape", text)


def _check_ports(function: ca.Function, spec: FunctionSpec) -> None:
    if not function.is_a("SXFunction"):
        text = f"is a {function.class_name()}; only SX functions have scalar instructions"
        raise _fail(spec, "codegen.not-scalar", text)
    found = (tuple(function.name_in()), tuple(function.name_out()))
    wanted = (tuple(port.name for port in spec.inputs), tuple(port.name for port in spec.outputs))
    if found != wanted:
        raise _fail(spec, "codegen.wrong-ports", f"its ports are {found}, the catalogue says {wanted}")
    for i, port in enumerate(spec.inputs):
        _check_shape(spec, port, function.sparsity_in(i))
    for i, port in enumerate(spec.outputs):
        _check_shape(spec, port, function.sparsity_out(i))


def _find_elements(sparsity: ca.Sparsity) -> list[int]:
    """Return the row-major element of each nonzero."""
    columns = sparsity.size2()
    return [r * columns + c for r, c in zip(sparsity.row(), sparsity.get_col(), strict=True)]


class _Reader:
    """Walks the instructions of one function; `work` maps CasADi's work vector to references."""

    def __init__(self, function: ca.Function, spec: FunctionSpec) -> None:
        self.function = function
        self.spec = spec
        self.table = ValueTable()
        self.work: dict[int, int] = {}
        self.inputs = [_find_elements(function.sparsity_in(i)) for i in range(function.n_in())]
        self.elements = [_find_elements(function.sparsity_out(i)) for i in range(function.n_out())]
        self.outputs: list[dict[int, int]] = [{} for _ in spec.outputs]

    def read(self) -> Program:
        for k in range(self.function.n_instructions()):
            self._visit(k, self.function.instruction_id(k))
        instructions, outputs = self.table.collect(self._fill_outputs())
        return Program(spec=self.spec, instructions=instructions, outputs=outputs)

    def _visit(self, k: int, code: int) -> None:
        source = self.function.instruction_input(k)
        target = self.function.instruction_output(k)
        if code == ca.OP_CONST:
            self.work[target[0]] = self.table.constant(self.function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            port, nonzero = source
            self.work[target[0]] = self.table.input(port, self.inputs[port][nonzero])
        elif code == ca.OP_OUTPUT:
            port, nonzero = target
            self.outputs[port][self.elements[port][nonzero]] = self.work[source[0]]
        elif code in _ARITHMETIC:
            self.work[target[0]] = _ARITHMETIC[code](self.table, [self.work[i] for i in source])
        elif code in _FUNCTIONS:
            self.work[target[0]] = self.table.apply(_FUNCTIONS[code], *(self.work[i] for i in source))
        else:
            text = f"operation {_NAMES.get(code, code)} has no rule; write it with supported operations"
            raise _fail(self.spec, "codegen.unknown-operation", text)

    def _fill_outputs(self) -> Iterator[list[int]]:
        for port, refs in zip(self.spec.outputs, self.outputs, strict=True):
            # What CasADi leaves out of a sparse output is zero.
            yield [refs[i] if i in refs else self.table.constant(0.0) for i in range(port.size)]


def build_program(function: ca.Function, spec: FunctionSpec) -> Program:
    """Return the instructions of `function`, simplified, in the order in which CasADi has them.

    Args:
        function: an SX function with the ports of `spec`; a port of shape (n,) is a column, one of
            shape (n, m) a matrix, one of shape (n, k, m) a matrix with n rows of k m elements.
        spec: its entry in the catalogue.

    Raises:
        GenerationError: the ports differ from the catalogue's, or an operation is not supported.
    """
    _check_ports(function, spec)
    return _Reader(function, spec).read()
