"""From a straight-line program to a CasADi SX function.

Input: a program. Output: an SX function with the ports of its spec.

An SX operation costs the same Python time for one number as for many: instructions that do not need one
another are written together, as one operation on columns.

Supported: all operations of `Op`.
"""

from collections.abc import Callable, Mapping, Sequence

import casadi as ca

from symid.codegen.functions import Port
from symid.codegen.instructions import Instruction, Op, Program

__all__ = ["build_function", "find_extents"]

_RULES: Mapping[Op, Callable[..., ca.SX]] = {
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


def find_extents(port: Port) -> tuple[int, int]:
    """Return the rows and columns of the matrix that stands for a port."""
    rows = port.shape[0] if port.shape else 1
    return rows, port.size // rows if rows else 1


def _group(program: Program) -> list[tuple[Op, list[int]]]:
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


class _Pool:
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


def _start(program: Program, inputs: Sequence[ca.SX]) -> _Pool:
    """Return the pool with the inputs and constants that the program reads."""
    pool = _Pool(len(program.instructions))
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


def build_function(program: Program) -> ca.Function:
    """Return the SX function of `program`; a port of shape (n, k, m) is a matrix of n rows, k m columns."""
    spec = program.spec
    inputs = [ca.SX.sym(port.name, *find_extents(port)) for port in spec.inputs]
    pool = _start(program, inputs)
    for op, numbers in _group(program):
        instructions = [program.instructions[number - 1] for number in numbers]
        columns = zip(*(instruction.args for instruction in instructions), strict=True)
        pool.append(numbers, _RULES[op](*(pool.read(refs) for refs in columns)))
    outputs = []
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        rows, columns_out = find_extents(port)
        values = pool.read(refs) if refs else ca.SX(0, 1)
        outputs.append(ca.densify(ca.reshape(values, columns_out, rows).T))
    names = ([port.name for port in spec.inputs], [port.name for port in spec.outputs])
    return ca.Function(spec.name, inputs, outputs, *names)
