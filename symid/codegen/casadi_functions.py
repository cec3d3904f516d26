"""The catalogue as programs and CasADi SX functions, and the way between programs and SX functions.

Robot -> BaseParameters -> card;  Robot -> routes -> the program with the fewest operations -> SX function.
Result: `Functions`, with inputs and outputs named, ordered and shaped as the specs say; a port of shape
(n, k, m) is a matrix of n rows and k m columns.

An SX operation costs the same Python time for one number as for many: instructions that do not need one
another are written together, as one operation on columns. The other way, an SX function of known ports
becomes a program; CasADi numbers the elements of a matrix by columns, symid by rows.

Supported: rigid robots, symbolic lengths with a value; all operations of `Op`.
Not supported: symbolic lengths without a value (RobotError); reading MX functions, calls, and powers other
than squares, which are refused by name.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from symid.codegen.catalogue import list_robot_specs
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.codegen.model_card import build_model_card, drop_constants, get_constants
from symid.codegen.programs import ExpressionTable, Instruction, Op, Program
from symid.codegen.routes import choose_route
from symid.codegen.workspace import check_symbols
from symid.dynamics import build_standard_parameters, derive_base_parameters
from symid.errors import GenerationError, Notice, UsageError
from symid.robot import Robot

_SX_RULES: Mapping[Op, Callable[..., ca.SX]] = {
    Op.ADD: lambda a, b: a + b,
    Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b,
    Op.DIV: lambda a, b: a / b,
    Op.SIN: ca.sin,
    Op.COS: ca.cos,
    Op.TAN: ca.tan,
    Op.SQRT: ca.sqrt,
    Op.EXP: ca.exp,
    Op.TANH: ca.tanh,
    Op.POWER: ca.power,
    Op.ABS: ca.fabs,
    Op.SIGN: ca.sign,
    Op.LESS: lambda a, b: a < b,
    Op.LESS_EQUAL: lambda a, b: a <= b,
    Op.IS_ZERO: ca.logic_not,
    Op.SELECT: lambda a, b: ca.if_else(a, b, ca.SX(0)),
    Op.MAXIMUM: ca.fmax,
    Op.MINIMUM: ca.fmin,
}


def get_matrix_shape(port: Port) -> tuple[int, int]:
    """Return the rows and columns of the matrix that stands for a port."""
    rows = port.shape[0] if port.shape else 1
    return rows, port.size // rows if rows else 1


def _group_instructions(program: Program) -> list[tuple[Op, list[int]]]:
    """Return the instructions' numbers in groups of one operation; a group needs only earlier ones."""
    levels = [0]
    groups: dict[tuple[int, str], list[int]] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        source = instruction.op in (Op.INPUT, Op.CONSTANT)
        level = 0 if source else 1 + max(levels[abs(ref)] for ref in instruction.args)
        levels.append(level)
        if not source:
            groups.setdefault((level, instruction.op.value), []).append(number)
    ordered = sorted(groups.items(), key=lambda item: item[0][0])
    return [(program.instructions[numbers[0] - 1].op, numbers) for _, numbers in ordered]


class _ValuePool:
    """A column of all values so far, and where each reference stands in it."""

    def __init__(self, size: int) -> None:
        self.column = ca.SX.zeros(size)
        self.places: dict[int, int] = {}

    def append(self, numbers: Sequence[int], values: ca.SX) -> None:
        start = len(self.places)
        self.places.update((number, start + k) for k, number in enumerate(numbers))
        self.column[start : start + len(numbers)] = values

    def read(self, refs: Sequence[int]) -> ca.SX:
        # A pool of one value would give a row.
        values = ca.vec(self.column[[self.places[abs(ref)] for ref in refs]])
        if any(ref < 0 for ref in refs):
            values = values * ca.DM([1.0 if ref > 0 else -1.0 for ref in refs])
        return values


def _start_pool(program: Program, inputs: Sequence[ca.SX]) -> _ValuePool:
    """Return the pool with the inputs and constants that the program reads."""
    pool = _ValuePool(len(program.instructions))
    rows = [ca.vec(value.T) for value in inputs]
    kinds: Mapping[Op, list[tuple[int, Instruction]]] = {Op.INPUT: [], Op.CONSTANT: []}
    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op in kinds:
            kinds[instruction.op].append((number, instruction))
    starts = [0]
    for value in rows:
        starts.append(starts[-1] + value.numel())
    if kinds[Op.INPUT]:
        numbers, found = zip(*kinds[Op.INPUT], strict=True)
        elements = [starts[instruction.args[0]] + instruction.args[1] for instruction in found]
        pool.append(numbers, ca.vertcat(*rows)[elements])
    if kinds[Op.CONSTANT]:
        numbers, found = zip(*kinds[Op.CONSTANT], strict=True)
        pool.append(numbers, ca.SX(ca.DM([instruction.constant for instruction in found])))
    return pool


def build_sx_function(program: Program) -> ca.Function:
    """Return the SX function of `program`; a port of shape (n, k, m) is a matrix of n rows, k m columns."""
    spec = program.spec
    inputs = [ca.SX.sym(port.name, *get_matrix_shape(port)) for port in spec.inputs]
    pool = _start_pool(program, inputs)
    for op, numbers in _group_instructions(program):
        instructions = [program.instructions[number - 1] for number in numbers]
        columns = zip(*(instruction.args for instruction in instructions), strict=True)
        pool.append(numbers, _SX_RULES[op](*(pool.read(refs) for refs in columns)))
    outputs = []
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        rows, columns_out = get_matrix_shape(port)
        values = pool.read(refs) if refs else ca.SX(0, 1)
        outputs.append(ca.densify(ca.reshape(values, columns_out, rows).T))
    names = ([port.name for port in spec.inputs], [port.name for port in spec.outputs])
    return ca.Function(spec.name, inputs, outputs, *names)


_OPCODE_NAMES: dict[int, str] = {
    getattr(ca, name): name for name in sorted(dir(ca)) if name.startswith("OP_")
}

_OPCODE_FUNCTIONS: dict[int, Op] = {
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

OpcodeRule = Callable[[ExpressionTable, list[int]], int]

_OPCODE_RULES: dict[int, OpcodeRule] = {
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


def _build_program_error(spec: FunctionSpec, code: str, text: str) -> GenerationError:
    return GenerationError(Notice(code=code, text=f"function {spec.name!r}: {text}"))


def _check_shape(spec: FunctionSpec, port: Port, sparsity: ca.Sparsity) -> None:
    rows, columns = sparsity.shape
    if rows * columns != port.size or (port.shape and rows != port.shape[0]):
        text = f"port {port.name!r} has {rows} x {columns} elements, its shape says {port.shape}"
        raise _build_program_error(spec, "codegen.wrong-shape", text)


def _check_ports(function: ca.Function, spec: FunctionSpec) -> None:
    if not function.is_a("SXFunction"):
        text = f"is a {function.class_name()}; only SX functions have scalar instructions"
        raise _build_program_error(spec, "codegen.not-scalar", text)
    found = (tuple(function.name_in()), tuple(function.name_out()))
    wanted = (tuple(port.name for port in spec.inputs), tuple(port.name for port in spec.outputs))
    if found != wanted:
        raise _build_program_error(
            spec, "codegen.wrong-ports", f"its ports are {found}, the catalogue says {wanted}"
        )
    for i, port in enumerate(spec.inputs):
        _check_shape(spec, port, function.sparsity_in(i))
    for i, port in enumerate(spec.outputs):
        _check_shape(spec, port, function.sparsity_out(i))


def _list_row_major(sparsity: ca.Sparsity) -> list[int]:
    """Return the row-major element of each nonzero."""
    columns = sparsity.size2()
    return [r * columns + c for r, c in zip(sparsity.row(), sparsity.get_col(), strict=True)]


class _SxReader:
    """Walks the instructions of one function; `work` maps CasADi's work vector to references."""

    def __init__(self, function: ca.Function, spec: FunctionSpec) -> None:
        self.function = function
        self.spec = spec
        self.table = ExpressionTable()
        self.work: dict[int, int] = {}
        self.inputs = [_list_row_major(function.sparsity_in(i)) for i in range(function.n_in())]
        self.elements = [_list_row_major(function.sparsity_out(i)) for i in range(function.n_out())]
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
        elif code in _OPCODE_RULES:
            self.work[target[0]] = _OPCODE_RULES[code](self.table, [self.work[i] for i in source])
        elif code in _OPCODE_FUNCTIONS:
            self.work[target[0]] = self.table.apply(_OPCODE_FUNCTIONS[code], *(self.work[i] for i in source))
        else:
            text = (
                f"operation {_OPCODE_NAMES.get(code, code)} has no rule; write it with supported operations"
            )
            raise _build_program_error(self.spec, "codegen.unknown-operation", text)

    def _fill_outputs(self) -> Iterator[list[int]]:
        for port, refs in zip(self.spec.outputs, self.outputs, strict=True):
            # What CasADi leaves out of a sparse output is zero.
            yield [refs[i] if i in refs else self.table.constant(0.0) for i in range(port.size)]


def read_sx_program(function: ca.Function, spec: FunctionSpec) -> Program:
    """Return the instructions of `function`, simplified, in the order in which CasADi has them.

    Args:
        function: an SX function with the ports of `spec`; a port of shape (n,) is a column, one of
            shape (n, m) a matrix, one of shape (n, k, m) a matrix with n rows of k m elements.
        spec: its entry in the catalogue.

    Raises:
        GenerationError: the ports differ from the catalogue's, or an operation is not supported.
    """
    _check_ports(function, spec)
    return _SxReader(function, spec).read()


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """A model card, and in its order the chosen programs and the SX functions built from them.

    Code is printed from the programs; what CasADi makes of them on the way is for its users. `constant` says
    whether the values of the robot file are part of the functions.
    """

    card: ModelCard
    programs: tuple[Program, ...]
    functions: tuple[ca.Function, ...]
    constant: bool = False


def build_functions(
    robot: Robot, *, names: tuple[str, ...] | None = None, standard: bool = False, constant: bool = False
) -> Functions:
    """Return the functions of the catalogue, or those called `names`, in the catalogue's order.

    Args:
        robot: the robot.
        names: of the functions wanted, None for all.
        standard: whether functions take the standard parameters pi in place of beta.
        constant: whether functions hold the values of the robot file, and take no parameters.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: a name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    check_symbols(robot)
    base = build_standard_parameters(robot) if standard else derive_base_parameters(robot)
    catalogue = list_robot_specs(robot, base)
    known = [spec.name for spec in catalogue]
    for name in names or ():
        if name not in known:
            text = f"function '{name}' is not in the catalogue; there are {', '.join(known)}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))
    specs = tuple(spec for spec in catalogue if names is None or spec.name in names)
    card = build_model_card(robot, base, specs)
    constants = get_constants(card) if constant else {}
    specs = tuple(drop_constants(spec, constants) for spec in specs)
    programs = tuple(choose_route(robot, base, spec, constants).program for spec in specs)
    return Functions(
        card=replace(card, functions=specs),
        programs=programs,
        functions=tuple(map(build_sx_function, programs)),
        constant=constant,
    )


def build_casadi_function(
    robot: Robot, name: str, *, standard: bool = False, constant: bool = False
) -> ca.Function:
    """Return one function of the catalogue over SX, with derivatives of any order.

    Vectors are columns: `map`, and matrices of samples side by side, work as CasADi has them. The rotation
    matrices of the forward kinematics, of shape (n, 3, 3), stand row by row in n x 9. SI units, angles in
    rad. Where friction or a spring changes its slope at once, derivatives are those of one side; friction
    with a speed to a power below one has none at rest.

    Args:
        robot: the robot.
        name: of the function.
        standard: whether it takes the standard parameters pi in place of beta.
        constant: whether it holds the values of the robot file, and takes no parameters.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: the name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    return build_functions(robot, names=(name,), standard=standard, constant=constant).functions[0]
