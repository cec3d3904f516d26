"""Programs as C: one statement an instruction, for one sample and for a block of samples side by side.

Input: `Program`. Output: statements and the names of the helpers they need.

An output is written as soon as its value is there: held back to the end, values would wait on the stack.
Sines and cosines of all angles are found together, first (see `lanes`).

Supported: double and float C99.
Not supported: blocks of samples for programs with other than sums, products, quotients, sines and cosines.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from symid.codegen.functions import Port
from symid.codegen.instructions import Instruction, Op, Program
from symid.codegen.printing import INFIX, Body, find_helpers, find_literal, write_instruction

__all__ = ["Angles", "find_angles", "print_c", "print_lanes"]

_TRIGONOMETRY = (Op.SIN, Op.COS)
_SIDE_BY_SIDE = frozenset({Op.INPUT, Op.CONSTANT, *INFIX, *_TRIGONOMETRY})
_FUNCTIONS = {
    Op.SIN: "sin",
    Op.COS: "cos",
    Op.TAN: "tan",
    Op.SQRT: "sqrt",
    Op.EXP: "exp",
    Op.TANH: "tanh",
    Op.POWER: "pow",
    Op.ABS: "fabs",
}
_PLAIN = (Op.CONSTANT, Op.INPUT)
"""What needs no statement."""
_GROUP = 8
"""Numbers that lanes of any width hold without rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Angles:
    """Angles whose sines and cosines are found together.

    `places` maps the reference of an angle to its place; `before` numbers the instructions they come from.
    """

    places: dict[int, int]
    before: tuple[int, ...]


def find_angles(program: Program) -> Angles:
    """Return the angles of a program that come from its inputs without a sine or cosine on the way."""
    found: list[bool] = [False]
    sources: list[frozenset[int]] = [frozenset()]
    places: dict[int, int] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        operands = () if instruction.op is Op.INPUT else tuple(map(abs, instruction.args))
        plain = instruction.op in _PLAIN or (instruction.op in INFIX and all(found[k] for k in operands))
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
    return Angles(places=places, before=tuple(before))


class _Printer:
    """Statements of one function: values of type `kind`, constants and inputs as its two functions say."""

    def __init__(
        self,
        program: Program,
        kind: str,
        angles: Angles,
        write_constant: Callable[[float], str],
        write_input: Callable[[int, int], str],
    ) -> None:
        self.program, self.kind, self.angles = program, kind, angles
        self.write_constant, self.write_input = write_constant, write_input
        self.call: Callable[[Op], str] = lambda op: op.value
        self.names = [""] * (len(program.instructions) + 1)
        self.due: dict[int, list[Callable[[], str]]] = {}

    def read(self, ref: int) -> str:
        return self.names[ref] if ref > 0 else f"-{self.names[-ref]}"

    def find_ready(self, refs: Iterable[int]) -> int:
        """Return the number of the last statement that values wait for; the last one if for none."""
        numbers = [abs(ref) for ref in refs if self.program.instructions[abs(ref) - 1].op not in _PLAIN]
        return max(numbers, default=len(self.program.instructions))

    def promise(self, refs: Sequence[int], write: Callable[[], str]) -> None:
        """Have the text of `write` follow as soon as all `refs` have a value."""
        self.due.setdefault(self.find_ready(refs), []).append(write)

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
            for write in self.due.get(number, ()):
                yield write()

    def _print_instruction(self, number: int) -> Iterator[str]:
        instruction = self.program.instructions[number - 1]
        if instruction.op not in _PLAIN:
            self.names[number] = f"t{number}"
            yield f"const {self.kind} t{number} = {self._write_value(instruction)};"

    def _write_value(self, instruction: Instruction) -> str:
        place = self.angles.places.get(instruction.args[0])
        if instruction.op not in _TRIGONOMETRY or place is None:
            return write_instruction(instruction, self.read, self.call)
        name = "sines" if instruction.op is Op.SIN else "cosines"
        return f"{name}[{place}]" if self.kind == "lanes" else f"AT({name}, {place})"

    def _print_angles(self) -> Iterator[str]:
        texts = [self.read(ref) for ref in self.angles.places]
        if self.kind == "lanes":
            size = room = str(len(texts))
            listed = ", ".join(texts)
        else:
            size, room = f"COUNT({len(texts)})", f"ROOM({len(texts)})"
            texts += [self.write_constant(0.0)] * (-len(texts) % _GROUP)
            groups = (texts[k : k + _GROUP] for k in range(0, len(texts), _GROUP))
            listed = ", ".join(f"EIGHT({', '.join(group)})" for group in groups)
        yield f"const lanes angles[{room}] = {{{listed}}};"
        yield f"lanes sines[{room}];"
        yield f"lanes cosines[{room}];"
        yield f"find_sines({size}, angles, sines, cosines);"


def print_c(program: Program, precision: str, *, together: bool = False) -> Body:
    """Return the body of a C function; inputs and outputs are arrays with the ports' names.

    Args:
        program: what the function computes.
        precision: "double" or "float".
        together: whether sines and cosines are found together, with `find_sines` of the lanes' header.
    """
    spec, suffix = program.spec, "f" if precision == "float" else ""
    printer = _Printer(
        program,
        precision,
        find_angles(program) if together else Angles(places={}, before=()),
        lambda value: find_literal(value, precision),
        lambda port, element: f"{spec.inputs[port].name}[{element}]",
    )
    printer.call = lambda op: _FUNCTIONS[op] + suffix if op in _FUNCTIONS else op.value
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        for element, ref in enumerate(refs):
            printer.promise([ref], partial(_write_element, printer, f"{port.name}[{element}]", ref))
    return Body(statements=tuple(printer.print()), helpers=find_helpers(program))


def _write_element(printer: _Printer, target: str, ref: int) -> str:
    return f"{target} = {printer.read(ref)};"


def print_lanes(program: Program, precision: str) -> tuple[str, ...]:
    """Return the body of a loop over blocks of samples, the first of which is number `k`, or nothing."""
    angles = find_angles(program)
    sides = {instruction.op for instruction in program.instructions}
    trigonometry = [i for i in program.instructions if i.op in _TRIGONOMETRY]
    if not sides <= _SIDE_BY_SIDE or any(i.args[0] not in angles.places for i in trigonometry):
        return ()
    inputs, outputs = program.spec.inputs, program.spec.outputs

    def write_input(number: int, element: int) -> str:
        port = inputs[number]
        return f"ALL({port.name}[{element}])" if port.shared else f"{port.name}{element}"

    def write_constant(value: float) -> str:
        return f"ALL({find_literal(value, precision)})"

    printer = _Printer(program, "lanes", angles, write_constant, write_input)
    for port, refs in zip(outputs, program.outputs, strict=True):
        for first in range(0, port.size, _GROUP):
            group = refs[first : first + _GROUP]
            write = partial(_write_store, printer, port, first, group)
            printer.promise(group, write)
    read = (instruction.args for instruction in program.instructions if instruction.op is Op.INPUT)
    used = sorted({(number, element) for number, element in read if not inputs[number].shared})
    return (*(_write_load(inputs[number], element) for number, element in used), *printer.print())


def _write_load(port: Port, element: int) -> str:
    start = f"{port.name} + {port.size} * k" + (f" + {element}" if element else "")
    return f"const lanes {port.name}{element} = GATHER({start}, {port.size});"


def _write_store(printer: _Printer, port: Port, first: int, refs: tuple[int, ...]) -> str:
    texts = [printer.read(ref) for ref in refs]
    size = port.size

    def find_target(element: int) -> str:
        return f"{port.name} + {size} * k" + (f" + {element}" if element else "")

    if len(texts) == _GROUP:
        return f"store_eight({find_target(first)}, {size}, (const lanes[]){{{', '.join(texts)}}});"
    stores = (f"store_one({find_target(first + k)}, {size}, {text});" for k, text in enumerate(texts))
    return " ".join(stores)
