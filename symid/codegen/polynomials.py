"""Values of a straight-line program as polynomials in its inputs, in sines and cosines.

Input: a program over exact numbers. Output: a polynomial in normal form for every short value, with
s^2 = 1 - c^2 and the squares of roots replaced, and the letters that its generators stand for.

Supported: sums, products, sines and cosines. Not supported: other operations, long values; they have none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from sympy import QQ, Expr
from sympy.polys.rings import PolyElement, PolyRing

from symid.codegen.instructions import Instruction, Op, Program
from symid.codegen.value_algebra import NUMBERS
from symid.robot.geometry import Exact

__all__ = [
    "SOURCES",
    "Letters",
    "Source",
    "Terms",
    "count_each",
    "find_algebraic",
    "find_letters",
    "find_polynomials",
    "raise_powers",
]

Terms = dict[tuple[int, ...], Any]
"""Coefficients of a polynomial, rational numbers of SymPy, by the powers of its letters."""
Square = tuple[int, tuple[tuple[Mapping[int, int], int], ...]]
"""A generator, and its square as powers of others and an integer."""

# A polynomial is short with so many terms; none is sought where the program's own operations, written out,
# are more than so many, or where so many products would be made at once.
_SHORT = 80
_SMALL = 400
_MOST_PRODUCTS = 1000
SOURCES = frozenset({Op.INPUT, Op.CONSTANT})
_TRIGONOMETRIC = frozenset({Op.SIN, Op.COS})
_ALGEBRAIC = frozenset({Op.ADD, Op.SUB, Op.MUL, *SOURCES, *_TRIGONOMETRIC})


def count_each(instructions: Sequence[Instruction]) -> list[int]:
    """Return the operations of every value when written out; of the reference 0, none."""
    sizes = [0]
    for instruction in instructions:
        own = () if instruction.op in SOURCES else instruction.args
        sizes.append(0 if instruction.op in SOURCES else 1 + sum(sizes[abs(ref)] for ref in own))
    return sizes


def find_algebraic(instructions: Sequence[Instruction]) -> list[bool]:
    """Return whether a value is made of sums, products, sines and cosines alone, however long."""
    found = [True]
    for instruction in instructions:
        own = () if instruction.op in SOURCES else instruction.args
        found.append(instruction.op in _ALGEBRAIC and all(found[abs(ref)] for ref in own))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A program over exact numbers, and what its inputs are called.

    Args:
        program: its constants are exact as doubles; other numbers are elements of the port `NUMBERS`.
        numbers: those numbers.
        inputs: per input port the expressions of its elements.
    """

    program: Program
    numbers: tuple[Exact, ...]
    inputs: tuple[tuple[Expr, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Letters:
    """The generators of a program's polynomials: parameters, sines and cosines in pairs, then the others.

    `places` has the generator of every element that is read, `turns` that of the sine of every angle, whose
    cosine follows it. Symbolic lengths have theirs in `lengths`; sqrt(2) and sqrt(3) are the last two.
    """

    ring: PolyRing
    parameters: int
    places: Mapping[tuple[int, ...], int]
    turns: Mapping[int, int]
    lengths: Mapping[str, int]

    @property
    def squares(self) -> list[Square]:
        """Return the generators whose square is known: s^2 = 1 - c^2, and those of roots."""
        last = len(self.ring.gens) - 1
        circles: list[Square] = [(sine, (({}, 1), ({sine + 1: 2}, -1))) for sine in self.turns.values()]
        return [*circles, (last - 1, (({}, 2),)), (last, (({}, 3),))]

    def convert(self, number: Exact) -> PolyElement:
        """Return an exact number or linear form of symbolic lengths."""
        two, three = self.ring.gens[-2:]
        total = self.ring.zero
        for name, surd in number.terms:
            basis = (self.ring.one, two, three, two * three)
            parts = (QQ(c.numerator, c.denominator) * root for c, root in zip(surd, basis, strict=True))
            value = sum(parts, self.ring.zero)
            total += value * self.ring.gens[self.lengths[name]] if name else value
        return total


def find_letters(source: Source) -> Letters:
    """Return the generators of a program, as many as it needs."""
    instructions, inputs = source.program.instructions, source.program.spec.inputs
    read = [i.args for i in instructions if i.op is Op.INPUT and i.args[0] >= 0]
    parameters = [key for key in read if inputs[key[0]].shared]
    others = [key for key in read if not inputs[key[0]].shared]
    angles = sorted({abs(i.args[0]) for i in instructions if i.op in _TRIGONOMETRIC})
    lengths = sorted({name for number in source.numbers for name in number.symbols})
    start = len(parameters)
    behind = start + 2 * len(angles)
    places = {key: place for place, key in enumerate(parameters)}
    places |= {key: place for place, key in enumerate(others, start=behind)}
    last = behind + len(others)
    return Letters(
        parameters=start,
        ring=PolyRing([f"x{place}" for place in range(last + len(lengths) + 2)], QQ),
        places=places,
        turns={ref: start + 2 * place for place, ref in enumerate(angles)},
        lengths={name: place for place, name in enumerate(lengths, start=last)},
    )


def raise_powers(monomial: tuple[int, ...], changes: Mapping[int, int]) -> tuple[int, ...]:
    """Return the monomial with the powers of some letters changed."""
    return tuple(power + changes.get(place, 0) for place, power in enumerate(monomial))


def _reduce(value: PolyElement, squares: Sequence[Square]) -> PolyElement:
    """Return `value` with every known square of a generator replaced."""
    terms: Terms = dict(value)
    for place, square in squares:
        waiting = [monomial for monomial in terms if monomial[place] > 1]
        while waiting:
            monomial = waiting.pop()
            coefficient = terms.pop(monomial, None)
            if coefficient is None:
                continue
            for powers, factor in square:
                key = raise_powers(monomial, {**powers, place: -2})
                terms[key] = terms.get(key, 0) + factor * coefficient
                if key[place] > 1:
                    waiting.append(key)
    return value.ring.from_dict(terms)


def _find_wanted(program: Program, sizes: Sequence[int]) -> frozenset[int]:
    """Return the values whose polynomials are of use, in writing or on the way to others.

    Written are outputs, and what meets a quotient, an absolute value and the like on its way there.
    """
    algebraic = find_algebraic(program.instructions)
    wanted = {abs(ref) for port in program.outputs for ref in port}
    for number in range(len(program.instructions), 0, -1):
        instruction = program.instructions[number - 1]
        if instruction.op in SOURCES:
            wanted.add(number)
        elif not algebraic[number] or instruction.op in _TRIGONOMETRIC or number in wanted:
            if sizes[number] <= _SMALL or not algebraic[number]:
                wanted.update(map(abs, instruction.args))
            else:
                wanted.discard(number)
    return frozenset(wanted)


def find_polynomials(source: Source, letters: Letters) -> list[PolyElement | None]:
    """Return the polynomial of every value by its reference; None where it is long, or none at all."""
    ring, squares = letters.ring, letters.squares
    wanted = _find_wanted(source.program, count_each(source.program.instructions))
    values: list[PolyElement | None] = [ring.zero]

    def read(instruction: Instruction) -> PolyElement:
        if instruction.op is Op.CONSTANT:
            constant = Fraction(instruction.constant)
            return ring.ground_new(QQ(constant.numerator, constant.denominator))
        if instruction.args[0] == NUMBERS:
            return letters.convert(source.numbers[instruction.args[1]])
        return ring.gens[letters.places[instruction.args]]

    def compute(number: int, instruction: Instruction) -> PolyElement | None:
        op, args = instruction.op, instruction.args
        if number not in wanted:
            return None
        if op in SOURCES:
            return read(instruction)
        found = [values[abs(ref)] for ref in args]
        known = [
            value if ref > 0 else -value for ref, value in zip(args, found, strict=True) if value is not None
        ]
        if len(known) < len(args) or op not in _ALGEBRAIC:
            return None
        if op in _TRIGONOMETRIC:
            return ring.gens[letters.turns[args[0]] + (op is Op.COS)]
        left, right = known
        if op is not Op.MUL:
            result = left + right if op is Op.ADD else left - right
        elif len(left) * len(right) > _MOST_PRODUCTS:
            return None
        else:
            result = _reduce(left * right, squares)
        return result if len(result) <= _SHORT else None

    for number, instruction in enumerate(source.program.instructions, start=1):
        values.append(compute(number, instruction))
    return values
