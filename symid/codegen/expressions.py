"""From a straight-line program over exact numbers to SymPy expressions.

Short polynomials in the inputs, sines and cosines are written in normal form: s^2 = 1 - c^2 and the squares
of roots are replaced, terms are collected by parameters, then by sines and cosines, and sums of angles are
found in products. Longer values are the program's own operations, nested.

Supported: all operations of `Op`; polynomials of sums, products, sines and cosines.
Not supported: a closed form of nested values; nothing is expanded.
"""

import itertools
import math
import operator
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import sympy
from sympy import QQ, Add, Expr, Integer, Mul, Rational, Symbol
from sympy.polys.rings import PolyElement, PolyRing

from symid.codegen.programs import ARITHMETIC, NUMBERS, Instruction, Op, Program
from symid.robot import Exact

Terms = dict[tuple[int, ...], Any]
"""Coefficients of a polynomial, rational numbers of SymPy, by the powers of its letters."""
_Angles = tuple[tuple[int, Expr], ...]
"""The place of the sine of every angle among the letters, whose cosine follows it, and the angle."""
PortValues = tuple[tuple[Expr, ...], ...]
"""The expressions of all elements, port by port."""
KnownSquare = tuple[int, tuple[tuple[Mapping[int, int], int], ...]]
"""A generator, and its square as powers of others and an integer."""

# A polynomial is short with so many terms; none is computed where the program's own operations, written out,
# are more than so many, or where so many products would be made at once.
_MOST_TERMS = 80
_MOST_OPERATIONS = 400
_MOST_PRODUCTS = 1000
SOURCE_OPS = frozenset({Op.INPUT, Op.CONSTANT})
_TRIGONOMETRIC = frozenset({Op.SIN, Op.COS})
_ALGEBRAIC = frozenset({Op.ADD, Op.SUB, Op.MUL, *SOURCE_OPS, *_TRIGONOMETRIC})
# Few terms are written as a polynomial in any case, more of them if they take so many operations each.
_FEW = 20
_PER_TERM = 6
# The largest ratio of two numbers that a common factor may leave.
_LARGE = 4


_SYMPY_RULES: Mapping[Op, Callable[..., Expr]] = {
    **ARITHMETIC,
    **{op: getattr(sympy, op.value) for op in (Op.SIN, Op.COS, Op.EXP, Op.TANH, Op.SIGN)},
    Op.POWER: operator.pow,
    Op.ABS: sympy.Abs,
    Op.LESS: lambda a, b: sympy.Piecewise((1, sympy.Lt(a, b)), (0, True)),
    Op.LESS_EQUAL: lambda a, b: sympy.Piecewise((1, sympy.Le(a, b)), (0, True)),
    # SymPy would compare long expressions with one another to find out which is greater.
    Op.MAXIMUM: lambda a, b: sympy.Max(a, b, evaluate=False),
    Op.MINIMUM: lambda a, b: sympy.Min(a, b, evaluate=False),
}


def count_expanded_values(instructions: Sequence[Instruction]) -> list[int]:
    """Return the operations of every value when written out, by its number."""
    sizes = [0]
    for instruction in instructions:
        source = instruction.op in SOURCE_OPS
        sizes.append(0 if source else 1 + sum(sizes[number] for number in instruction.operands))
    return sizes


def mark_algebraic(instructions: Sequence[Instruction]) -> list[bool]:
    """Return whether a value is made of sums, products, sines and cosines alone, however long."""
    found = [True]
    for instruction in instructions:
        found.append(instruction.op in _ALGEBRAIC and all(found[number] for number in instruction.operands))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactProgram:
    """A program over exact numbers, and per input port the expressions of its elements.

    Its constants are exact as doubles; other `numbers` are elements of the port `NUMBERS`.
    """

    program: Program
    numbers: tuple[Exact, ...]
    inputs: PortValues


def _raise_powers(monomial: tuple[int, ...], changes: Mapping[int, int]) -> tuple[int, ...]:
    return tuple(power + changes.get(place, 0) for place, power in enumerate(monomial))


def _replace_squares(value: PolyElement, squares: Sequence[KnownSquare]) -> PolyElement:
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
                key = _raise_powers(monomial, {**powers, place: -2})
                terms[key] = terms.get(key, 0) + factor * coefficient
                if key[place] > 1:
                    waiting.append(key)
    return value.ring.from_dict(terms)


def count_expanded_operations(program: Program) -> int:
    """Return the operations of all outputs together when no two of them share a value."""
    sizes = count_expanded_values(program.instructions)
    return sum(sizes[abs(ref)] for port in program.outputs for ref in port)


def _complete_squares(terms: Terms, turns: Iterable[int]) -> Terms:
    """Return the terms with s^2 in place of 1 - c^2."""
    for sine in turns:
        cosine = sine + 1
        for monomial, coefficient in tuple(terms.items()):
            square = (*monomial[:cosine], monomial[cosine] + 2, *monomial[cosine + 1 :])
            if not monomial[sine] and not monomial[cosine] and terms.get(square) == -coefficient:
                other = (*monomial[:sine], 2, *monomial[cosine:])
                terms = {key: value for key, value in terms.items() if key not in (monomial, square)}
                terms[other] = coefficient
    return terms


def _join_angle_pair(terms: Terms, pair: tuple[int, int], sign: int, end: int) -> Terms | None:
    """Return the terms with the sine and cosine of a sum of angles (sign 1), or difference, at `end`.

    sin(a + b) = sin a cos b + cos a sin b, cos(a + b) = cos a cos b - sin a sin b; None where the terms have
    no such sum.
    """
    sine_a, sine_b = pair
    cosine_a, cosine_b = sine_a + 1, sine_b + 1
    left = dict(terms)
    joined: Terms = {}
    for first, second, new in (
        ((sine_a, cosine_b), {cosine_a: sign, sine_b: sign}, end),
        ((cosine_a, cosine_b), {sine_a: 1, sine_b: 1}, end + 1),
    ):
        wanted = -sign if new > end else sign
        for monomial, coefficient in terms.items():
            if min(monomial[place] for place in first) < 1 or monomial not in left:
                continue
            bare = _raise_powers(monomial, dict.fromkeys(first, -1))
            partner = _raise_powers(bare, dict.fromkeys(second, 1))
            if left.get(partner) == wanted * coefficient:
                del left[monomial], left[partner]
                key = (*bare[:end], int(new == end), int(new > end), *bare[end:])
                joined[key] = joined.get(key, 0) + coefficient
    if not joined:
        return None
    spread = {(*monomial[:end], 0, 0, *monomial[end:]): value for monomial, value in left.items()}
    return {**spread, **joined}


def _join_angles(
    terms: Terms, letters: tuple[Expr, ...], end: int, angles: _Angles
) -> tuple[Terms, tuple[Expr, ...], int, _Angles]:
    """Return the terms with sines and cosines of sums of angles, where they are hidden in products.

    Beside them all letters, the end of the sines and cosines among them, and all angles.
    """
    waiting = deque(itertools.combinations(angles, 2))
    while waiting:
        first, second = waiting.popleft()
        for sign in (1, -1):
            found = _join_angle_pair(terms, (first[0], second[0]), sign, end)
            if found is None:
                continue
            angle = first[1] + sign * second[1]
            waiting.extend([((end, angle), other) for other in angles if other not in (first, second)])
            letters = (*letters[:end], sympy.sin(angle), sympy.cos(angle), *letters[end:])
            terms, angles, end = found, (*angles, (end, angle)), end + 2
    return terms, letters, end, angles


def _collect_factors(terms: Terms, letters: Sequence[Expr], bounds: Sequence[int]) -> list[Expr]:
    """Return factors of the sum, collected by the letters before the first bound, then the second one."""
    # The powers and the number that all terms share.
    powers = tuple(map(min, zip(*terms, strict=True)))
    numbers = [Fraction(int(value.numerator), int(value.denominator)) for value in terms.values()]
    divisor, multiple = (number.numerator for number in numbers), (number.denominator for number in numbers)
    factor = Fraction(math.gcd(*divisor), math.lcm(*multiple))
    factor = -factor if all(number < 0 for number in numbers) else factor
    # (100 q + 79) / 250 reads worse than 2/5 q + 79/250.
    if any(abs(number / factor) > _LARGE for number in numbers):
        factor = Fraction(1)
    rest = {
        tuple(map(operator.sub, monomial, powers)): value / QQ(factor.numerator, factor.denominator)
        for monomial, value in terms.items()
    }
    outer = _list_powers(letters, powers)
    if len(rest) == 1:
        (last,) = rest.values()
        return [_to_rational(last) * _to_rational(factor), *outer]
    end = bounds[0] if bounds else len(letters)
    groups: dict[tuple[int, ...], Terms] = {}
    for monomial, value in rest.items():
        inner = (*([0] * end), *monomial[end:])
        groups.setdefault(monomial[:end], {})[inner] = value
    summands = [
        Mul(*_list_powers(letters, head), *_collect_factors(part, letters, bounds[1:]))
        for head, part in groups.items()
    ]
    return [_to_rational(factor), *outer, Add(*summands)]


def _list_powers(letters: Sequence[Expr], powers: Sequence[int]) -> list[Expr]:
    return [letter**power for letter, power in zip(letters, powers, strict=False) if power]


def _to_rational(value: Any) -> Rational:  # noqa: ANN401  a Fraction or a number of a SymPy domain
    return Rational(int(value.numerator), int(value.denominator))


class _PolynomialWriter:
    """The short polynomials of one program, by reference, and their expressions.

    Generators of their ring are parameters, sines and cosines in pairs, other inputs, symbolic lengths,
    sqrt(2) and sqrt(3). `places` has that of every element that is read, `turns` that of the sine of every
    angle, whose cosine follows it, `lengths` those of symbolic lengths; `bounds` are the ends of parameters
    and of cosines.
    """

    def __init__(self, source: ExactProgram) -> None:
        self.source, instructions = source, source.program.instructions
        inputs = source.program.spec.inputs
        read = [i.args for i in instructions if i.op is Op.INPUT and i.args[0] >= 0]
        parameters = [key for key in read if inputs[key[0]].shared]
        others = [key for key in read if not inputs[key[0]].shared]
        refs = sorted({abs(i.args[0]) for i in instructions if i.op in _TRIGONOMETRIC})
        names = sorted({name for number in source.numbers for name in number.symbols})
        start = len(parameters)
        self.bounds = (start, start + 2 * len(refs))
        self.places = {key: place for place, key in enumerate(parameters)}
        self.places |= {key: place for place, key in enumerate(others, start=self.bounds[1])}
        self.turns = {ref: start + 2 * place for place, ref in enumerate(refs)}
        last = self.bounds[1] + len(others)
        self.lengths = {name: place for place, name in enumerate(names, start=last)}
        self.ring = PolyRing([f"x{place}" for place in range(last + len(names) + 2)], QQ)
        self.sizes = count_expanded_values(instructions)
        self.polynomials = self._build_polynomials()
        letters: list[Expr] = [Integer(1)] * len(self.ring.gens)
        letters[-2:] = sympy.sqrt(2), sympy.sqrt(3)
        for key, place in self.places.items():
            letters[place] = source.inputs[key[0]][key[1]]
        for name, place in self.lengths.items():
            letters[place] = Symbol(name)
        self.letters, self.angles = tuple(letters), _Angles()
        angles = tuple((place, self.write(ref)) for ref, place in self.turns.items())
        for place, angle in angles:
            letters[place : place + 2] = sympy.sin(angle), sympy.cos(angle)
        self.letters, self.angles = tuple(letters), angles

    def _convert(self, number: Exact) -> PolyElement:
        """Return an exact number or linear form of symbolic lengths."""
        two, three = self.ring.gens[-2:]
        total = self.ring.zero
        for name, surd in number.terms:
            basis = (self.ring.one, two, three, two * three)
            parts = (QQ(c.numerator, c.denominator) * root for c, root in zip(surd, basis, strict=True))
            value = sum(parts, self.ring.zero)
            total += value * self.ring.gens[self.lengths[name]] if name else value
        return total

    def _build_polynomials(self) -> list[PolyElement | None]:
        """Return the polynomial of every value by its reference; None where it is long, or none at all."""
        ring, program = self.ring, self.source.program
        instructions, algebraic = program.instructions, mark_algebraic(program.instructions)
        # s^2 = 1 - c^2, and the squares of roots.
        squares: list[KnownSquare] = [(k, (({}, 1), ({k + 1: 2}, -1))) for k in self.turns.values()]
        squares += [(len(ring.gens) - 2, (({}, 2),)), (len(ring.gens) - 1, (({}, 3),))]
        # The values whose polynomials are written, see `write_values`, or lead to others.
        wanted = {abs(ref) for port in program.outputs for ref in port}
        for number, one in zip(range(len(instructions), 0, -1), reversed(instructions), strict=True):
            if one.op in SOURCE_OPS:
                wanted.add(number)
            elif not algebraic[number] or one.op in _TRIGONOMETRIC or number in wanted:
                if self.sizes[number] <= _MOST_OPERATIONS or not algebraic[number]:
                    wanted.update(one.operands)
                else:
                    wanted.discard(number)
        values: list[PolyElement | None] = [ring.zero]

        def compute(number: int, op: Op, args: tuple[int, ...], constant: float) -> PolyElement | None:
            if number not in wanted:
                return None
            if op is Op.CONSTANT:
                exact = Fraction(constant)
                return ring.ground_new(QQ(exact.numerator, exact.denominator))
            if op is Op.INPUT:
                if args[0] == NUMBERS:
                    return self._convert(self.source.numbers[args[1]])
                return ring.gens[self.places[args]]
            pairs = [(ref, values[abs(ref)]) for ref in args]
            known = [value if ref > 0 else -value for ref, value in pairs if value is not None]
            if len(known) < len(args) or op not in _ALGEBRAIC:
                return None
            if op in _TRIGONOMETRIC:
                return ring.gens[self.turns[args[0]] + (op is Op.COS)]
            left, right = known
            if op is not Op.MUL:
                result = left + right if op is Op.ADD else left - right
            elif len(left) * len(right) > _MOST_PRODUCTS:
                return None
            else:
                result = _replace_squares(left * right, squares)
            return result if len(result) <= _MOST_TERMS else None

        for number, one in enumerate(instructions, start=1):
            values.append(compute(number, one.op, one.args, one.constant))
        return values

    def has(self, ref: int) -> bool:
        """Return whether the value is a polynomial that is not longer than the operations that make it."""
        value = self.polynomials[ref]
        return value is not None and (len(value) <= _FEW or _PER_TERM * len(value) <= self.sizes[ref])

    def write(self, ref: int) -> Expr:
        """Return the polynomial of a value that has one, collected."""
        value = self.polynomials[abs(ref)]
        if not value:
            return Integer(0)
        terms = dict((value if ref > 0 else -value).terms())
        terms, letters, end, angles = _join_angles(terms, self.letters, self.bounds[1], self.angles)
        terms = _complete_squares(terms, [place for place, _ in angles])
        return Mul(*_collect_factors(terms, letters, (self.bounds[0], end)))


def write_values(source: ExactProgram) -> PortValues:
    """Return the expressions of all outputs, by port.

    Polynomials are outputs, and operands of a quotient, an absolute value and the like on the way there.
    """
    writer, instructions = _PolynomialWriter(source), source.program.instructions
    algebraic = mark_algebraic(instructions)
    roots = dict.fromkeys(abs(ref) for port in source.program.outputs for ref in port)
    inner: dict[int, None] = {}
    # The values that are needed, in falling order, and whether they are written as polynomials.
    needed: dict[int, bool] = {}
    for number in range(len(instructions), 0, -1):
        if number in roots or number in inner:
            instruction = instructions[number - 1]
            needed[number] = instruction.op in SOURCE_OPS or (number in roots and writer.has(number))
            if not needed[number]:
                chosen = inner if algebraic[number] else roots
                chosen.update(dict.fromkeys(instruction.operands))
    values: dict[int, Expr] = {}

    def read(ref: int) -> Expr:
        if ref not in values:
            values[ref] = writer.write(ref) if needed[abs(ref)] else -values[-ref]
        return values[ref]

    for number, written in reversed(needed.items()):
        if not written:
            instruction = instructions[number - 1]
            values[number] = _SYMPY_RULES[instruction.op](*map(read, instruction.args))
    return tuple(tuple(map(read, port)) for port in source.program.outputs)


def share_values(source: ExactProgram) -> tuple[tuple[tuple[Symbol, Expr], ...], PortValues]:
    """Return the program with a symbol for every value that is used more than once, as `sympy.cse` does."""
    instructions, outputs = source.program.instructions, source.program.outputs
    uses = Counter(number for instruction in instructions for number in instruction.operands)
    uses.update(abs(ref) for port in outputs for ref in port)
    writer = _PolynomialWriter(source)
    taken = {letter for letter in writer.letters if letter.is_Symbol}
    names = sympy.numbered_symbols("x", exclude=taken)
    steps: list[tuple[Symbol, Expr]] = []
    values: list[Expr] = [Integer(0)]

    def read(ref: int) -> Expr:
        return values[ref] if ref > 0 else -values[-ref]

    for number, instruction in enumerate(instructions, start=1):
        if instruction.op in SOURCE_OPS:
            values.append(writer.write(number))
            continue
        value = _SYMPY_RULES[instruction.op](*map(read, instruction.args))
        if uses[number] > 1 and not value.is_Atom:
            steps.append((next(names), value))
            value = steps[-1][0]
        values.append(value)
    return tuple(steps), tuple(tuple(map(read, port)) for port in outputs)
