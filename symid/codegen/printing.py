"""Programs as text: C for one sample and for a block of samples side by side (SIMD), NumPy, JavaScript.

In C an output is written as soon as its value is there, so that few values wait on the stack. Sines and
cosines of all angles are computed together, first. The time and memory of compilers grow faster than a
function's length: a very long one is printed as parts that hand values on in an array. In NumPy names are
used again as soon as their value is no longer needed, so that a batch holds few arrays.

Supported: double and float C99; NumPy over whole batches; NaN passes through every helper.
Not supported: blocks of samples for programs with other than sums, products, quotients, sines and cosines.
"""

import heapq
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain

import numpy as np

from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.programs import Instruction, Op, Program

_INFIX = {Op.ADD: "+", Op.SUB: "-", Op.MUL: "*", Op.DIV: "/"}
_HELPER_OPS = (Op.SIGN, Op.LESS, Op.LESS_EQUAL, Op.MAXIMUM, Op.MINIMUM)
# NumPy's own let a NaN through.
_NUMPY_OPS = (Op.MAXIMUM, Op.MINIMUM)
# JavaScript's own let a NaN through too.
_JAVASCRIPT_NAMES = {Op.POWER: "pow", Op.MAXIMUM: "max", Op.MINIMUM: "min"}
_JAVASCRIPT_HELPERS = (Op.LESS, Op.LESS_EQUAL)
_NameOp = Callable[[Op], str]
_REGISTER = re.compile(r"t(\d+) = ")
# Arguments and value. Comparisons with NaN are false: each helper lets a NaN through by its last branch.
_C_HELPERS = {
    "sign": ("x", "x > {zero} ? {one} : (x < {zero} ? -{one} : x)"),
    "less": ("a b", "a < b ? {one} : (a >= b ? {zero} : a + b)"),
    "less_equal": ("a b", "a <= b ? {one} : (a > b ? {zero} : a + b)"),
    "maximum": ("a b", "a > b ? a : (a <= b ? b : a + b)"),
    "minimum": ("a b", "a < b ? a : (a >= b ? b : a + b)"),
}
_TRIGONOMETRY = (Op.SIN, Op.COS)
_SIMD_OPS = frozenset({Op.INPUT, Op.CONSTANT, *_INFIX, *_TRIGONOMETRY})
# Where they are not those of the operation.
_C_NAMES = {Op.POWER: "pow", Op.ABS: "fabs"}
_PLAIN_NAMES = {Op.POWER: "math.pow", Op.ABS: "abs"}
_WITHOUT_STATEMENT = (Op.CONSTANT, Op.INPUT)
_GROUP_SIZE = 8
"""A multiple of every SIMD width."""
_SPARSE = 0.8
"""Part of an output's groups with a number that is not zero below which a batch clears all of it first."""
_LONGEST_BODY, _PART_LENGTH = 8000, 1000
"""Statements of a function that is printed as one, and of a part of one that is not."""
_STREAMED_SIZES = range(64, 1025)
"""Numbers of an output that may go past the caches: fewer are few bytes, more have no room on a stack."""
_NAME = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionBody:
    """Statements of a C function, definitions of its helpers, `parts` called (declaration, statements)."""

    statements: tuple[str, ...]
    helpers: tuple[str, ...] = ()
    parts: tuple[tuple[str, tuple[str, ...]], ...] = ()


def write_literal(value: float, precision: str = "double") -> str:
    """Return a C or Python literal that reads back as exactly `value` (nearest float for "float")."""
    if precision == "float":
        text = np.format_float_scientific(np.float32(value), unique=True, trim="0")
        short = repr(float(text))
        return f"{short}f" if np.float32(short) == np.float32(value) else f"{text}f"
    return repr(float(value))


def _write_instruction(one: Instruction, read: Callable[[int], str], call: _NameOp) -> str:
    """Return the value of an instruction as text; `read` names operands, `call` functions."""
    if one.op in _INFIX:
        left, right = map(read, one.args)
        return f"{left} {_INFIX[one.op]} {right}"
    return f"{call(one.op)}({', '.join(map(read, one.args))})"


def print_python(program: Program, *, plain: bool = False) -> list[str]:
    """Return statements of NumPy, elements on the last axes; `plain`: of numbers and lists, with `math`."""

    def call(op: Op) -> str:
        if plain:
            return f"_{op.value}" if op in _HELPER_OPS else _PLAIN_NAMES.get(op, f"math.{op.value}")
        return f"_{op.value}" if op in _HELPER_OPS and op not in _NUMPY_OPS else f"np.{op.value}"

    def index(port: Port, element: int) -> str:
        if plain:
            return str(element)
        return ", ".join(["...", *map(str, np.unravel_index(element, port.shape))])

    return _print_registers(program, call, index)


def print_javascript(program: Program) -> list[str]:
    """Return JavaScript of one sample: flat arrays, row by row, outputs zero before; registers come first."""

    def call(op: Op) -> str:
        return f"_{op.value}" if op in _JAVASCRIPT_HELPERS else f"Math.{_JAVASCRIPT_NAMES.get(op, op.value)}"

    lines = _print_registers(program, call, lambda _, element: str(element))
    used = {int(match[1]) for line in lines if (match := _REGISTER.match(line))}
    declared = [f"let {', '.join(f't{k}' for k in sorted(used))};"] if used else []
    return [*declared, *(f"{line};" for line in lines)]


def _print_registers(program: Program, call: _NameOp, index: Callable[[Port, int], str]) -> list[str]:
    """Return statements in the operators that Python and JavaScript share; names are used again."""
    last = {k: number for number, one in enumerate(program.instructions, start=1) for k in one.operands}
    last |= {abs(ref): len(program.instructions) + 1 for refs in program.outputs for ref in refs}
    names = [""]
    statements = []
    free: list[int] = []
    registers: dict[int, int] = {}
    count = 0

    def read(ref: int) -> str:
        return names[ref] if ref > 0 else f"-{names[-ref]}"

    for number, instruction in enumerate(program.instructions, start=1):
        if instruction.op is Op.CONSTANT:
            names.append(write_literal(instruction.constant))
            continue
        if instruction.op is Op.INPUT:
            source, element = instruction.args
            port = program.spec.inputs[source]
            text = f"{port.name}[{index(port, element)}]"
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
            f"{port.name}[{index(port, i)}] = {read(ref)}"
            for i, ref in enumerate(refs)
            if names[abs(ref)] != "0.0"
        ]
    return statements


def group_angles(program: Program) -> tuple[dict[int, int], list[int]]:
    """Return the angles whose sines and cosines are computed together, and the instructions they come from.

    An angle is a place by its reference; it comes from inputs without a sine or cosine on the way.
    """
    found: list[bool] = [False]
    sources: list[frozenset[int]] = [frozenset()]
    places: dict[int, int] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        operands = instruction.operands
        source = instruction.op in _WITHOUT_STATEMENT
        plain = source or (instruction.op in _INFIX and all(found[k] for k in operands))
        found.append(plain)
        sources.append(frozenset({number}.union(*(sources[k] for k in operands))) if plain else frozenset())
        if instruction.op in _TRIGONOMETRY and found[operands[0]]:
            places.setdefault(instruction.args[0], len(places))

    def compute_rank(ref: int) -> tuple[int, ...]:
        # Inputs in their order can be loaded together.
        instruction = program.instructions[abs(ref) - 1]
        return (0, *instruction.args, ref) if instruction.op is Op.INPUT else (1, abs(ref), ref)

    places = {ref: place for place, ref in enumerate(sorted(places, key=compute_rank))}
    return places, sorted(set().union(*(sources[abs(ref)] for ref in places)))


def _measure(lines: Sequence[str]) -> int:
    """Return how long compilers take for lines, in statements; eight elements are stored as one."""
    return len(lines) + _GROUP_SIZE * sum("store_eight" in line for line in lines)


@dataclass(slots=True)
class _CPrinter:
    """Statements of one function; values are of type `kind`, `call` names functions and helpers."""

    program: Program
    kind: str
    angles: Mapping[int, int]
    before: Sequence[int]
    write_constant: Callable[[float], str]
    write_input: Callable[[int, int], str]
    call: _NameOp
    names: dict[int, str] = field(default_factory=dict)
    due: dict[int, list[tuple[Sequence[int], Callable[..., str]]]] = field(default_factory=dict)

    def read(self, ref: int) -> str:
        return self.names[ref] if ref > 0 else f"-{self.names[-ref]}"

    def promise(self, refs: Sequence[int], write: Callable[..., str]) -> None:
        """Have the text of `write`, called with those of `refs`, follow as soon as these have a value."""
        instructions = self.program.instructions
        waited = [abs(ref) for ref in refs if instructions[abs(ref) - 1].op not in _WITHOUT_STATEMENT]
        self.due.setdefault(max(waited, default=len(instructions)), []).append((refs, write))

    def print(self) -> Iterator[str]:
        """Yield all statements."""
        yield from self._print_beginning()
        for number in range(1, len(self.program.instructions) + 1):
            yield from self._print_step(number)

    def _print_beginning(self) -> Iterator[str]:
        """Yield what comes first, and name constants and inputs."""
        for number, instruction in enumerate(self.program.instructions, start=1):
            if instruction.op is Op.CONSTANT:
                self.names[number] = self.write_constant(instruction.constant)
            elif instruction.op is Op.INPUT:
                self.names[number] = self.write_input(*instruction.args)
        for number in self.before:
            yield from self._print_instruction(number)
        if not self.angles:
            return
        texts = [self.read(ref) for ref in self.angles]
        if self.kind == "lanes":
            size = room = str(len(texts))
            listed = ", ".join(texts)
        else:
            size, room = f"COUNT({len(texts)})", f"ROOM({len(texts)})"
            texts += [self.write_constant(0.0)] * (-len(texts) % _GROUP_SIZE)
            groups = (texts[k : k + _GROUP_SIZE] for k in range(0, len(texts), _GROUP_SIZE))
            listed = ", ".join(f"EIGHT({', '.join(group)})" for group in groups)
        yield f"const lanes angles[{room}] = {{{listed}}};"
        yield from (f"lanes {name}[{room}];" for name in ("sines", "cosines"))
        yield f"find_sines({size}, angles, sines, cosines);"

    def _print_step(self, number: int) -> Iterator[str]:
        """Yield an instruction, if it was not printed before, and the outputs that have their value then."""
        if number not in self.names:
            yield from self._print_instruction(number)
        yield from (write(*map(self.read, refs)) for refs, write in self.due.get(number, ()))

    def print_parts(self) -> tuple[int, list[list[str]]]:
        """Return the statements in parts, and how many values these hand on in the array `kept`."""
        last = {k: number for number, one in enumerate(self.program.instructions, 1) for k in one.operands}
        for number, entries in self.due.items():
            for ref in chain(*(refs for refs, _ in entries)):
                last[abs(ref)] = max(number, last.get(abs(ref), 0))
        parts = [list(self._print_beginning())]
        for number, one in enumerate(self.program.instructions, start=1):
            # The arrays of sines and cosines are known to the first part alone.
            if one.op in _TRIGONOMETRY and one.args[0] in self.angles:
                parts[0] += self._print_instruction(number)
        slots: dict[int, int] = {}
        free: list[int] = []
        size, new, length = 0, [k for k in self.names if self.names[k] == f"t{k}"], _measure(parts[0])
        for number in range(1, len(self.program.instructions) + 1):
            new += [] if number in self.names else [number]
            step = list(self._print_step(number))
            parts[-1] += step
            length += _measure(step)
            if length < _PART_LENGTH or number == len(self.program.instructions):
                continue
            for k in [k for k in slots if last[k] <= number]:
                heapq.heappush(free, slots.pop(k))
            for k in new:
                if last.get(k, 0) > number:
                    size += not free
                    slots[k] = heapq.heappop(free) if free else size - 1
                    parts[-1].append(f"kept[{slots[k]}] = t{k};")
                    self.names[k] = f"kept[{slots[k]}]"
            new, length = [], 0
            parts.append([])
        return size, parts

    def _print_instruction(self, number: int) -> Iterator[str]:
        instruction = self.program.instructions[number - 1]
        if instruction.op in _WITHOUT_STATEMENT:
            return
        place = self.angles.get(instruction.args[0])
        if instruction.op not in _TRIGONOMETRY or place is None:
            text = _write_instruction(instruction, self.read, self.call)
        else:
            name = "sines" if instruction.op is Op.SIN else "cosines"
            text = f"{name}[{place}]" if self.kind == "lanes" else f"AT({name}, {place})"
        self.names[number] = f"t{number}"
        yield f"const {self.kind} t{number} = {text};"


def print_c(program: Program, precision: str, *, together: bool = False) -> FunctionBody:
    """Return a C function's body over arrays named as ports; `together`: sines at once, by `find_sines`."""
    spec, suffix = program.spec, "f" if precision == "float" else ""
    angles, before = group_angles(program) if together else ({}, [])
    printer = _CPrinter(
        program,
        precision,
        angles,
        before,
        lambda value: write_literal(value, precision),
        lambda port, element: f"{spec.inputs[port].name}[{element}]",
        lambda op: op.value if op in _HELPER_OPS else _C_NAMES.get(op, op.value) + suffix,
    )
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        for element, ref in enumerate(refs):
            printer.promise([ref], f"{port.name}[{element}] = {{}};".format)
    helpers = []
    for name in sorted({one.op.value for one in program.instructions} & _C_HELPERS.keys()):
        names, value = _C_HELPERS[name]
        arguments = ", ".join(f"{precision} {argument}" for argument in names.split())
        value = value.format(zero=f"0.0{suffix}", one=f"1.0{suffix}")
        helpers.append(f"static {precision} {name}({arguments})\n{{\n    return {value};\n}}")
    if not is_long(program):
        return FunctionBody(statements=tuple(printer.print()), helpers=tuple(helpers))
    ports = {
        port.name: (f"{'const ' * (place < len(spec.inputs))}{precision} {port.name}[restrict {port.size}]")
        for place, port in enumerate((*spec.inputs, *spec.outputs))
    }
    return replace(_join_parts(printer, "part", ports, {}), helpers=tuple(helpers))


def is_long(program: Program) -> bool:
    """Return whether a program is printed in parts."""
    return len(program.instructions) + sum(map(len, program.outputs)) > _LONGEST_BODY


def _join_parts(
    printer: _CPrinter, name: str, ports: Mapping[str, str], loads: Mapping[str, str]
) -> FunctionBody:
    """Return calls and parts: each has those of `ports` and `loads`, by their names, that it reads."""
    size, printed = printer.print_parts()
    ports = {**ports, "kept": f"{printer.kind} kept[restrict {max(size, 1)}]"}
    calls, parts = [f"{printer.kind} kept[{max(size, 1)}];"], []
    for place, lines in enumerate(printed, start=1):
        statements = tuple(_place_loads(loads, lines))
        named = set(_NAME.findall(" ".join(statements)))
        given = [port for port in ports if port in named]
        parts.append((f"PART void {name}_{place}({', '.join(ports[port] for port in given)})", statements))
        calls.append(f"{name}_{place}({', '.join(given)});")
    return FunctionBody(statements=tuple(calls), parts=tuple(parts))


def _place_loads(loads: Mapping[str, str], statements: Iterable[str]) -> Iterator[str]:
    """Yield `statements`, each with the loads, by the names that they give, that it is the first to use."""
    # Loads that all come first would wait on the stack: compilers keep the order.
    waiting = dict(loads)
    for statement in statements:
        for name in _NAME.findall(statement):
            if name in waiting:
                yield waiting.pop(name)
        yield statement


def list_streamed(spec: FunctionSpec) -> tuple[Port, ...]:
    """Return the outputs of which a large batch is written past the caches, block by block."""
    return tuple(port for port in spec.outputs if port.size in _STREAMED_SIZES)


def print_simd(program: Program, precision: str) -> FunctionBody:
    """Return the body of a loop over blocks of samples, the first of which is number `k`; empty if none.

    A streamed output Y stands at `Y_to`, which is Y + size k or a block of its own.
    """
    angles, before = group_angles(program)
    sides = {instruction.op for instruction in program.instructions}
    trigonometry = [i for i in program.instructions if i.op in _TRIGONOMETRY]
    if not sides <= _SIMD_OPS or any(i.args[0] not in angles for i in trigonometry):
        return FunctionBody(statements=())
    inputs, outputs = program.spec.inputs, program.spec.outputs
    streamed = list_streamed(program.spec)

    def write_input(number: int, element: int) -> str:
        port = inputs[number]
        return f"ALL({port.name}[{element}])" if port.shared else f"{port.name}{element}"

    def write_constant(value: float) -> str:
        return f"ALL({write_literal(value, precision)})"

    def write_place(port: Port, element: int) -> str:
        first = f"{port.name}_to" if port in streamed else f"{port.name} + {port.size} * k"
        return first + (f" + {element}" if element else "")

    def write_store(port: Port, first: int, *texts: str) -> str:
        if len(texts) == _GROUP_SIZE:
            listed = ", ".join(texts)
            return f"store_eight({write_place(port, first)}, {port.size}, (const lanes[]){{{listed}}});"
        places = (write_place(port, first + k) for k in range(len(texts)))
        return " ".join(f"store_one({at}, {port.size}, {x});" for at, x in zip(places, texts, strict=True))

    printer = _CPrinter(program, "lanes", angles, before, write_constant, write_input, lambda op: op.value)
    zeros = {k for k, one in enumerate(program.instructions, 1) if one.op is Op.CONSTANT and not one.constant}
    cleared = []
    for port, refs in zip(outputs, program.outputs, strict=True):
        firsts = range(0, port.size, _GROUP_SIZE)
        filled = [k for k in firsts if not zeros.issuperset(map(abs, refs[k : k + _GROUP_SIZE]))]
        is_sparse = len(filled) < _SPARSE * len(firsts)
        if is_sparse:
            cleared.append(f"memset({write_place(port, 0)}, 0, {port.size} * sizeof(lanes));")
        for first in filled if is_sparse else firsts:
            printer.promise(refs[first : first + _GROUP_SIZE], partial(write_store, port, first))
    read = (instruction.args for instruction in program.instructions if instruction.op is Op.INPUT)
    used = sorted({(number, element) for number, element in read if not inputs[number].shared})
    loads = {
        f"{port.name}{element}": f"const lanes {port.name}{element} = "
        f"GATHER({write_place(port, element)}, {port.size});"
        for port, element in ((inputs[number], element) for number, element in used)
    }
    if not is_long(program):
        return FunctionBody(statements=(*cleared, *_place_loads(loads, printer.print())))
    ports = {"k": "size_t k"}
    for place, port in enumerate((*inputs, *outputs)):
        kind = f"{'const ' * (place < len(inputs))}{precision}"
        size = f"{port.name}[restrict {port.size}]" if port.shared else f"*restrict {port.name}"
        ports[port.name] = f"{kind} {size}"
    for port in streamed:
        ports[f"{port.name}_to"] = f"{precision} *restrict {port.name}_to"
        del ports[port.name]
    body = _join_parts(printer, "batch_part", ports, loads)
    return replace(body, statements=(*cleared, *body.statements))


def write_table_lines(values: Sequence[float], kind: str) -> list[str]:
    """Return an initialiser's lines, a zero if empty; `kind`: double, float, int32_t (nearest whole)."""
    whole = kind == "int32_t"
    texts = [str(round(value)) if whole else write_literal(value, kind) for value in values or [0.0]]
    count = 16 if whole else 5
    return [", ".join(texts[k : k + count]) + "," for k in range(0, len(texts), count)]
