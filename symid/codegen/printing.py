"""Programs as text: what all languages share, and NumPy; see `printing_c` for C.

Input: `Program`. Output: statements and the names of the helpers they need.

Supported: NumPy over whole batches, with names used again as soon as their value is no longer needed, so
that a batch holds no more arrays than it must.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symid.codegen.functions import Port
from symid.codegen.instructions import Instruction, Op, Program

__all__ = ["INFIX", "Body", "find_helpers", "find_literal", "print_python", "write_instruction"]

INFIX = {Op.ADD: "+", Op.SUB: "-", Op.MUL: "*", Op.DIV: "/"}
_HELPERS = (Op.SIGN, Op.LESS, Op.LESS_EQUAL, Op.IS_ZERO, Op.SELECT, Op.MAXIMUM, Op.MINIMUM)
# NumPy's own let a NaN through.
_IN_NUMPY = (Op.MAXIMUM, Op.MINIMUM)


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """The statements of one function and the names of the helpers that it calls, sorted."""

    statements: tuple[str, ...]
    helpers: tuple[str, ...]


def find_literal(value: float, precision: str = "double") -> str:
    """Return a C or Python literal that reads back as exactly `value` (nearest float for "float")."""
    if precision == "float":
        text = np.format_float_scientific(np.float32(value), unique=True, trim="0")
        short = repr(float(text))
        return f"{short}f" if np.float32(short) == np.float32(value) else f"{text}f"
    return repr(float(value))


def find_helpers(program: Program) -> tuple[str, ...]:
    """Return the names of the helpers that a program calls, sorted."""
    used = {instruction.op for instruction in program.instructions}
    return tuple(sorted(op.value for op in _HELPERS if op in used))


def write_instruction(instruction: Instruction, read: Callable[[int], str], call: Callable[[Op], str]) -> str:
    """Return the value of an instruction as text; `read` names operands, `call` functions."""
    if instruction.op in INFIX:
        left, right = map(read, instruction.args)
        return f"{left} {INFIX[instruction.op]} {right}"
    return f"{call(instruction.op)}({', '.join(map(read, instruction.args))})"


def _index(port: Port, element: int) -> str:
    places = []
    for extent in reversed(port.shape):
        element, place = divmod(element, extent)
        places.append(str(place))
    return ", ".join(["...", *reversed(places)])


def _find_last_uses(program: Program) -> list[int]:
    last = [0] * (len(program.instructions) + 1)
    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is not Op.INPUT:
            for ref in instruction.args:
                last[abs(ref)] = number
    for refs in program.outputs:
        for ref in refs:
            last[abs(ref)] = len(program.instructions) + 1
    return last


def print_python(program: Program) -> Body:
    """Return the body of a NumPy function; elements are the last axes, samples the axes before."""
    last = _find_last_uses(program)
    names = [""]
    statements = []
    free: list[int] = []
    registers: dict[int, int] = {}
    count = 0

    def read(ref: int) -> str:
        return names[ref] if ref > 0 else f"-{names[-ref]}"

    def call(op: Op) -> str:
        return f"_{op.value}" if op in _HELPERS and op not in _IN_NUMPY else f"np.{op.value}"

    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is Op.CONSTANT:
            names.append(find_literal(instruction.constant))
            continue
        if instruction.op is Op.INPUT:
            source, element = instruction.args
            port = program.spec.inputs[source]
            text = f"{port.name}[{_index(port, element)}]"
        else:
            text = write_instruction(instruction, read, call)
            for number_read in sorted({abs(ref) for ref in instruction.args}):
                if last[number_read] == number and number_read in registers:
                    heapq.heappush(free, registers.pop(number_read))
        if not free:
            count += 1
            heapq.heappush(free, count)
        register = heapq.heappop(free)
        registers[number] = register
        names.append(f"t{register}")
        statements.append(f"t{register} = {text}")
    for port, refs in zip(program.spec.outputs, program.outputs, strict=True):
        # Outputs begin as zeros.
        statements += [
            f"{port.name}[{_index(port, i)}] = {read(ref)}"
            for i, ref in enumerate(refs)
            if names[abs(ref)] != "0.0"
        ]
    return Body(statements=tuple(statements), helpers=find_helpers(program))
