"""Programs as text: C for one sample and for a block of samples side by side (SIMD), NumPy for batches.

In C an output is written as soon as its value is there, so that few values wait on the stack. Sines and
cosines of all angles are computed together, first. In NumPy names are used again as soon as their value is
no longer needed, so that a batch holds few arrays.

Supported: double and float C99; NumPy over whole batches; NaN passes through every helper.
Not supported: blocks of samples for programs with other than sums, products, quotients, sines and cosines.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from symid.codegen.functions import Port
from symid.codegen.programs import Instruction, Op, Program

_INFIX = {Op.ADD: "+", Op.SUB: "-", Op.MUL: "*", Op.DIV: "/"}
_HELPER_OPS = (Op.SIGN, Op.LESS, Op.LESS_EQUAL, Op.IS_ZERO, Op.SELECT, Op.MAXIMUM, Op.MINIMUM)
# NumPy's own let a NaN through.
_NUMPY_OPS = (Op.MAXIMUM, Op.MINIMUM)


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionBody:
    """The statements of one function and the names of the helpers that it calls, sorted."""

    statements: tuple[str, ...]
    helpers: tuple[str, ...]


def write_literal(value: float, precision: str = "double") -> str:
    """Return a C or Python literal that reads back as exactly `value` (nearest float for "float")."""
    if precision == "float":
        text = np.format_float_scientific(np.float32(value), unique=True, trim="0")
        short = repr(float(text))
        return f"{short}f" if np.float32(short) == np.float32(value) else f"{text}f"
    return repr(float(value))


def _build_body(program: Program, statements: Iterable[str]) -> FunctionBody:
    used = {instruction.op for instruction in program.instructions}
    helpers = tuple(sorted(op.value for op in _HELPER_OPS if op in used))
    return FunctionBody(statements=tuple(statements), helpers=helpers)


def _write_instruction(
    instruction: Instruction, read: Callable[[int], str], call: Callable[[Op], str]
) -> str:
    """Return the value of an instruction as text; `read` names operands, `call` functions."""
    if instruction.op in _INFIX:
        left, right = map(read, instruction.args)
        return f"{left} {_INFIX[instruction.op]} {right}"
    return f"{call(instruction.op)}({', '.join(map(read, instruction.args))})"


def _write_element_index(port: Port, element: int) -> str:
    places = []
    for extent in reversed(port.shape):
        element, place = divmod(element, extent)
        places.append(str(place))
    return ", ".join(["...", *reversed(places)])


def print_python(program: Program) -> FunctionBody:
    """Return the body of a NumPy function; elements are the last axes, samples the axes before."""
    last = {k: number for number, one in enumerate(program.instructions, start=1) for k in one.operands}
    last |= {abs(ref): len(program.instructions) + 1 for refs in program.outputs for ref in refs}
    names = [""]
    statements = []
    free: list[int] = []
    registers: dict[int, int] = {}
    count = 0

    def read(ref: int) -> str:
        return names[ref] if ref > 0 else f"-{names[-ref]}"

    def call(op: Op) -> str:
        return f"_{op.value}" if op in _HELPER_OPS and op not in _NUMPY_OPS else f"np.{op.value}"

    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is Op.CONSTANT:
            names.append(write_literal(instruction.constant))
            continue
        if instruction.op is Op.INPUT:
            source, element = instruction.args
            port = program.spec.inputs[source]
            text = f"{port.name}[{_write_element_index(port, element)}]"
        else:
            text = _write_instruction(instruction, read, call)
            for number_read in sorted(set(instruction.operands)):
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
            f"{port.name}[{_write_element_index(port, i)}] = {read(ref)}"
            for i, ref in enumerate(refs)
            if names[abs(ref)] != "0.0"
        ]
    return _build_body(program, statements)


_TRIGONOMETRY = (Op.SIN, Op.COS)
_SIMD_OPS = frozenset({Op.INPUT, Op.CONSTANT, *_INFIX, *_TRIGONOMETRY})
_C_FUNCTIONS = {
    Op.SIN: "sin",
    Op.COS: "cos",
    Op.TAN: "tan",
    Op.SQRT: "sqrt",
    Op.EXP: "exp",
    Op.TANH: "tanh",
    Op.POWER: "pow",
    Op.ABS: "fabs",
}
_WITHOUT_STATEMENT = (Op.CONSTANT, Op.INPUT)
_GROUP_SIZE = 8
"""A multiple of every SIMD width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupedAngles:
    """Angles whose sines and cosines are computed together.

    `places` maps the reference of an angle to its place; `before` numbers the instructions they come from.
    """

    places: dict[int, int]
    before: tuple[int, ...]


def group_angles(program: Program) -> GroupedAngles:
    """Return the angles of a program that come from its inputs without a sine or cosine on the way."""
    found: list[bool] = [False]
    sources: list[frozenset[int]] = [frozenset()]
    places: dict[int, int] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        operands = instruction.operands
        plain = instruction.op in _WITHOUT_STATEMENT or (
            instruction.op in _INFIX and all(found[k] for k in operands)
        )
        found.append(plain)
        sources.append(frozenset({number}.union(*(sources[k] for k in operands))) if plain else frozenset())
        if instruction.op in _TRIGONOMETRY and found[operands[0]]:
            places.setdefault(instruction.args[0], len(places))

    def find_rank(ref: int) -> tuple[int, ...]:
        # Inputs in their order can be loaded together.
        instruction = program.instructions[abs(ref) - 1]
        return (0, *instruction.args, ref) if instruction.op is Op.INPUT else (1, abs(ref), ref)

    places = {ref: place for place, ref in enumerate(sorted(places, key=find_rank))}
    before = sorted(set().union(*(sources[abs(ref)] for ref in places)))
    return GroupedAngles(places=places, before=tuple(before))


class _CPrinter:
    """Statements of one function; values are of type `kind`."""

    def __init__(
        self,
        program: Program,
        kind: str,
        angles: GroupedAngles,
        write_constant: Callable[[float], str],
        write_input: Callable[[int, int], str],
    ) -> None:
        self.program, self.kind, self.angles = program, kind, angles
        self.write_constant, self.write_input = write_constant, write_input
        self.call: Callable[[Op], str] = lambda op: op.value
        self.names = [""] * (len(program.instructions) + 1)
        self.due: dict[int, list[tuple[Sequence[int], Callable[..., str]]]] = {}

    def read(self, ref: int) -> str:
        return self.names[ref] if ref > 0 else f"-{self.names[-ref]}"

    def promise(self, refs: Sequence[int], write: Callable[..., str]) -> None:
        """Have the text of `write`, called with those of `refs`, follow as soon as these have a value."""
        instructions = self.program.instructions
        waited = [abs(ref) for ref in refs if instructions[abs(ref) - 1].op not in _WITHOUT_STATEMENT]
        self.due.setdefault(max(waited, default=len(instructions)), []).append((refs, write))

    def print(self) -> Iterator[str]:
        """Yield all statements."""
        for number, instruction in enumerate(self.program.instructions, start=1):
            if instruction.op is Op.CONSTANT:
                self.names[number] = self.write_constant(instruction.constant)
            elif instruction.op is Op.INPUT:
                self.names[number] = self.write_input(*instruction.args)
        before = set(self.angles.before)
        for number in self.angles.before:
            yield from self._print_instruction(number)
        if self.angles.places:
            yield from self._print_angles()
        for number in range(1, len(self.program.instructions) + 1):
            if number not in before:
                yield from self._print_instruction(number)
            yield from (write(*map(self.read, refs)) for refs, write in self.due.get(number, ()))

    def _print_instruction(self, number: int) -> Iterator[str]:
        instruction = self.program.instructions[number - 1]
        if instruction.op in _WITHOUT_STATEMENT:
            return
        place = self.angles.places.get(instruction.args[0])
        if instruction.op not in _TRIGONOMETRY or place is None:
            text = _write_instruction(instruction, self.read, self.call)
        else:
            name = "sines" if instruction.op is Op.SIN else "cosines"
            text = f"{name}[{place}]" if self.kind == "lanes" else f"AT({name}, {place})"
        self.names[number] = f"t{number}"
        yield f"const {self.kind} t{number} = {text};"

    def _print_angles(self) -> Iterator[str]:
        texts = [self.read(ref) for ref in self.angles.places]
        if self.kind == "lanes":
            size = room = str(len(texts))
            listed = ", ".join(texts)
        else:
            size, room = f"COUNT({len(texts)})", f"ROOM({len(texts)})"
            texts += [self.write_constant(0.0)] * (-len(texts) % _GROUP_SIZE)
            groups = (texts[k : k + _GROUP_SIZE] for k in range(0, len(texts), _GROUP_SIZE))
            listed = ", ".join(f"EIGHT({', '.join(group)})" for group in groups)
        yield f"const lanes angles[{room}] = {{{listed}}};"
        yield f"lanes sines[{room}];"
        yield f"lanes cosines[{room}];"
        yield f"find_sines({size}, angles, sines, cosines);"


def print_c(program: Program, precision: str, *, together: bool = False) -> FunctionBody:
    """Return the body of a C function; inputs and outputs are arrays with the ports' names.

    `together`: sines and cosines are computed together, with `find_sines` of the lanes' header.
    """
    spec, suffix = program.spec, "f" if precision == "float" else ""
    printer = _CPrinter(
        program,
        precision,
        group_angles(program) if together else GroupedAngles(places={}, before=()),
        lambda value: write_literal(value, precision),
        lambda port, element: f"{spec.inputs[port].name}[{element}]",
    )
    printer.call = lambda op: _C_FUNCTIONS[op] + suffix if op in _C_FUNCTIONS else op.value
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        for element, ref in enumerate(refs):
            printer.promise([ref], f"{port.name}[{element}] = {{}};".format)
    return _build_body(program, printer.print())


def print_simd(program: Program, precision: str) -> tuple[str, ...]:
    """Return the body of a loop over blocks of samples, the first of which is number `k`, or nothing."""
    angles = group_angles(program)
    sides = {instruction.op for instruction in program.instructions}
    trigonometry = [i for i in program.instructions if i.op in _TRIGONOMETRY]
    if not sides <= _SIMD_OPS or any(i.args[0] not in angles.places for i in trigonometry):
        return ()
    inputs, outputs = program.spec.inputs, program.spec.outputs

    def write_input(number: int, element: int) -> str:
        port = inputs[number]
        return f"ALL({port.name}[{element}])" if port.shared else f"{port.name}{element}"

    def write_constant(value: float) -> str:
        return f"ALL({write_literal(value, precision)})"

    printer = _CPrinter(program, "lanes", angles, write_constant, write_input)
    for port, refs in zip(outputs, program.outputs, strict=True):
        for first in range(0, port.size, _GROUP_SIZE):
            printer.promise(refs[first : first + _GROUP_SIZE], partial(_write_store, port, first))
    read = (instruction.args for instruction in program.instructions if instruction.op is Op.INPUT)
    used = sorted({(number, element) for number, element in read if not inputs[number].shared})
    loads = (
        f"const lanes {port.name}{element} = GATHER({_write_place(port, element)}, {port.size});"
        for port, element in ((inputs[number], element) for number, element in used)
    )
    return (*loads, *printer.print())


def _write_place(port: Port, element: int) -> str:
    return f"{port.name} + {port.size} * k" + (f" + {element}" if element else "")


def _write_store(port: Port, first: int, *texts: str) -> str:
    if len(texts) == _GROUP_SIZE:
        listed = ", ".join(texts)
        return f"store_eight({_write_place(port, first)}, {port.size}, (const lanes[]){{{listed}}});"
    stores = (f"store_one({_write_place(port, first + k)}, {port.size}, {x});" for k, x in enumerate(texts))
    return " ".join(stores)


# Arguments and value. Comparisons with NaN are false: each helper lets a NaN through by its last branch.
_C_HELPERS = {
    "sign": ("x", "x > {zero} ? {one} : (x < {zero} ? -{one} : x)"),
    "less": ("a b", "a < b ? {one} : (a >= b ? {zero} : a + b)"),
    "less_equal": ("a b", "a <= b ? {one} : (a > b ? {zero} : a + b)"),
    "is_zero": ("x", "x > {zero} || x < {zero} ? {zero} : (x == {zero} ? {one} : x)"),
    "maximum": ("a b", "a > b ? a : (a <= b ? b : a + b)"),
    "minimum": ("a b", "a < b ? a : (a >= b ? b : a + b)"),
    "select": ("condition x", "condition > {zero} || condition < {zero} ? x : condition"),
}


def write_c_helper(name: str, real: str) -> str:
    """Return the definition of the helper `name` for numbers of type `real`."""
    suffix = "f" if real == "float" else ""
    names, value = _C_HELPERS[name]
    arguments = ", ".join(f"{real} {argument}" for argument in names.split())
    value = value.format(zero=f"0.0{suffix}", one=f"1.0{suffix}")
    return f"static {real} {name}({arguments})\n{{\n    return {value};\n}}"


def join_lines(texts: Sequence[str], count: int) -> list[str]:
    """Return the lines of an initialiser, `count` texts in each."""
    return [", ".join(texts[k : k + count]) + "," for k in range(0, len(texts), count)]


def write_table_lines(values: Sequence[float], real: str) -> list[str]:
    """Return an initialiser's lines; without values it holds a zero, as an empty one is no C."""
    return join_lines([write_literal(value, real) for value in values] or [write_literal(0.0, real)], 5)
