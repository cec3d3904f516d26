"""From a straight-line program to SymPy expressions.

Input: a program and the expressions of its inputs. Output: expressions of its outputs, and the program itself
as named intermediate results.

What is a short polynomial in the inputs, sines and cosines is written as such, collected by parameters, then
by sines and cosines; s^2 + c^2 = 1 has been used. Longer values are the program's own operations, nested.

Supported: all operations of `Op`. Not supported: a closed form of nested values; nothing is expanded.
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

from symid.codegen.instructions import Op, Program
from symid.codegen.polynomials import (
    SOURCES,
    Source,
    Terms,
    count_each,
    find_algebraic,
    find_letters,
    find_polynomials,
    raise_powers,
)

__all__ = ["count_written_out", "share_values", "write_values"]

# Few terms are written as a polynomial in any case, more of them if they take so many operations each.
_FEW = 20
_PER_TERM = 6
# The largest ratio of two numbers that a common factor may leave.
_LARGE = 4


def _select(chosen: Expr, value: Expr) -> Expr:
    return sympy.Piecewise((value, sympy.Ne(chosen, 0)), (0, True))


def _find_truth(condition: Expr) -> Expr:
    return sympy.Piecewise((1, condition), (0, True))


_RULES: Mapping[Op, Callable[..., Expr]] = {
    Op.ADD: lambda a, b: a + b,
    Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b,
    Op.DIV: lambda a, b: a / b,
    Op.SIN: sympy.sin,
    Op.COS: sympy.cos,
    Op.TAN: sympy.tan,
    Op.SQRT: sympy.sqrt,
    Op.EXP: sympy.exp,
    Op.TANH: sympy.tanh,
    Op.POWER: lambda a, b: a**b,
    Op.ABS: sympy.Abs,
    Op.SIGN: sympy.sign,
    Op.LESS: lambda a, b: _find_truth(sympy.Lt(a, b)),
    Op.LESS_EQUAL: lambda a, b: _find_truth(sympy.Le(a, b)),
    Op.IS_ZERO: lambda a: _find_truth(sympy.Eq(a, 0)),
    Op.SELECT: _select,
    # SymPy would compare long expressions with one another to find out which is greater.
    Op.MAXIMUM: lambda a, b: sympy.Max(a, b, evaluate=False),
    Op.MINIMUM: lambda a, b: sympy.Min(a, b, evaluate=False),
}


def count_written_out(program: Program) -> int:
    """Return the operations of all outputs together when no two of them share a value."""
    sizes = count_each(program.instructions)
    return sum(sizes[abs(ref)] for port in program.outputs for ref in port)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Text:
    """What polynomials are written with.

    Args:
        letters: the expression of every generator.
        bounds: where sines and cosines begin and end.
        angles: per angle the place of its sine, whose cosine follows, and the angle.
    """

    letters: tuple[Expr, ...]
    bounds: tuple[int, int]
    angles: tuple[tuple[int, Expr], ...]

    def insert(self, angle: Expr) -> "_Text":
        """Return the same with the sine and the cosine of one more angle behind the others."""
        start, end = self.bounds
        new = (sympy.sin(angle), sympy.cos(angle))
        return _Text(
            letters=(*self.letters[:end], *new, *self.letters[end:]),
            bounds=(start, end + 2),
            angles=(*self.angles, (end, angle)),
        )


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


def _take_out(terms: Terms) -> tuple[tuple[int, ...], Fraction, Terms]:
    """Return the powers and the number that all terms share, and what is left of the terms."""
    powers = tuple(map(min, zip(*terms, strict=True)))
    numbers = [Fraction(int(value.numerator), int(value.denominator)) for value in terms.values()]
    factor = Fraction(
        math.gcd(*(number.numerator for number in numbers)),
        math.lcm(*(number.denominator for number in numbers)),
    )
    factor = -factor if all(number < 0 for number in numbers) else factor
    # (100 q + 79) / 250 reads worse than 2/5 q + 79/250.
    if any(abs(number / factor) > _LARGE for number in numbers):
        factor = Fraction(1)
    rest = {
        tuple(map(operator.sub, monomial, powers)): value / QQ(factor.numerator, factor.denominator)
        for monomial, value in terms.items()
    }
    return powers, factor, rest


def _join(terms: Terms, pair: tuple[int, int], sign: int, end: int) -> Terms | None:
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
            bare = raise_powers(monomial, dict.fromkeys(first, -1))
            partner = raise_powers(bare, dict.fromkeys(second, 1))
            if left.get(partner) == wanted * coefficient:
                del left[monomial], left[partner]
                key = (*bare[:end], int(new == end), int(new > end), *bare[end:])
                joined[key] = joined.get(key, 0) + coefficient
    if not joined:
        return None
    spread = {(*monomial[:end], 0, 0, *monomial[end:]): value for monomial, value in left.items()}
    return {**spread, **joined}


def _join_angles(terms: Terms, text: _Text) -> tuple[Terms, _Text]:
    """Return the terms with sines and cosines of sums of angles, where they are hidden in products."""
    waiting = deque(itertools.combinations(text.angles, 2))
    while waiting:
        first, second = waiting.popleft()
        for sign in (1, -1):
            end = text.bounds[1]
            found = _join(terms, (first[0], second[0]), sign, end)
            if found is None:
                continue
            angle = first[1] + sign * second[1]
            terms, text = found, text.insert(angle)
            waiting.extend(
                ((end, angle), other) for other in text.angles[:-1] if other not in (first, second)
            )
    return terms, text


def _gather(terms: Terms, letters: Sequence[Expr], bounds: Sequence[int]) -> list[Expr]:
    """Return factors of the sum, collected by the letters before the first bound, then the second one."""
    powers, factor, rest = _take_out(terms)
    outer = _multiply(letters, powers)
    if len(rest) == 1:
        (last,) = rest.values()
        return [_to_rational(last) * _to_rational(factor), *outer]
    end = bounds[0] if bounds else len(letters)
    groups: dict[tuple[int, ...], Terms] = {}
    for monomial, value in rest.items():
        inner = (*([0] * end), *monomial[end:])
        groups.setdefault(monomial[:end], {})[inner] = value
    summands = [
        Mul(*_multiply(letters, head), *_gather(part, letters, bounds[1:])) for head, part in groups.items()
    ]
    return [_to_rational(factor), *outer, Add(*summands)]


def _multiply(letters: Sequence[Expr], powers: Sequence[int]) -> list[Expr]:
    return [letter**power for letter, power in zip(letters, powers, strict=False) if power]


def _to_rational(value: Any) -> Rational:  # noqa: ANN401  a Fraction or a number of a SymPy domain
    return Rational(int(value.numerator), int(value.denominator))


class _Writer:
    """Expressions of the short polynomials of one program."""

    def __init__(self, source: Source) -> None:
        self.letters = find_letters(source)
        self.sizes = count_each(source.program.instructions)
        self.polynomials = find_polynomials(source, self.letters)
        letters: list[Expr] = [Integer(1)] * len(self.letters.ring.gens)
        letters[-2:] = sympy.sqrt(2), sympy.sqrt(3)
        for key, place in self.letters.places.items():
            letters[place] = source.inputs[key[0]][key[1]]
        for name, place in self.letters.lengths.items():
            letters[place] = Symbol(name)
        bounds = (self.letters.parameters, self.letters.parameters + 2 * len(self.letters.turns))
        self.text = _Text(letters=tuple(letters), bounds=bounds, angles=())
        angles = tuple((place, self.write(ref)) for ref, place in self.letters.turns.items())
        for place, angle in angles:
            letters[place : place + 2] = sympy.sin(angle), sympy.cos(angle)
        self.text = _Text(letters=tuple(letters), bounds=bounds, angles=angles)

    def has(self, ref: int) -> bool:
        """Return whether the value is a polynomial that is not longer than the operations that make it."""
        value = self.polynomials[ref]
        return value is not None and (len(value) <= _FEW or _PER_TERM * len(value) <= self.sizes[ref])

    def write(self, ref: int) -> Expr:
        """Return the polynomial of a value that has one, collected."""
        value = self.polynomials[abs(ref)]
        if not value:
            return Integer(0)
        terms, text = _join_angles(dict((value if ref > 0 else -value).terms()), self.text)
        terms = _complete_squares(terms, [place for place, _ in text.angles])
        return Mul(*_gather(terms, text.letters, text.bounds))


def _find_needed(source: Source, writer: _Writer) -> dict[int, bool]:
    """Return the values that are needed, in falling order, and which are written as polynomials.

    These are outputs, and what meets a quotient, an absolute value and the like on its way there.
    """
    instructions = source.program.instructions
    algebraic = find_algebraic(instructions)
    roots = dict.fromkeys(abs(ref) for port in source.program.outputs for ref in port)
    inner: dict[int, None] = {}
    found: dict[int, bool] = {}
    for number in range(len(instructions), 0, -1):
        if number not in roots and number not in inner:
            continue
        instruction = instructions[number - 1]
        source_itself = instruction.op in SOURCES
        found[number] = source_itself or (number in roots and writer.has(number))
        if not found[number]:
            chosen = inner if algebraic[number] else roots
            chosen.update(dict.fromkeys(map(abs, instruction.args)))
    return found


def write_values(source: Source) -> tuple[tuple[Expr, ...], ...]:
    """Return the expressions of all outputs, by port."""
    writer = _Writer(source)
    needed = _find_needed(source, writer)
    values: dict[int, Expr] = {}

    def read(ref: int) -> Expr:
        if ref not in values:
            values[ref] = writer.write(ref) if needed[abs(ref)] else -values[-ref]
        return values[ref]

    for number, written in reversed(needed.items()):
        if not written:
            instruction = source.program.instructions[number - 1]
            values[number] = _RULES[instruction.op](*map(read, instruction.args))
    return tuple(tuple(map(read, port)) for port in source.program.outputs)


def share_values(source: Source) -> tuple[tuple[tuple[Symbol, Expr], ...], tuple[tuple[Expr, ...], ...]]:
    """Return the program with a symbol for every value that is used more than once, as `sympy.cse` does."""
    instructions, outputs = source.program.instructions, source.program.outputs
    uses = Counter(abs(ref) for i in instructions if i.op not in SOURCES for ref in i.args)
    uses.update(abs(ref) for port in outputs for ref in port)
    writer = _Writer(source)
    taken = {letter for letter in writer.text.letters if letter.is_Symbol}
    names = sympy.numbered_symbols("x", exclude=taken)
    steps: list[tuple[Symbol, Expr]] = []
    values: list[Expr] = [Integer(0)]

    def read(ref: int) -> Expr:
        return values[ref] if ref > 0 else -values[-ref]

    for number, instruction in enumerate(instructions, start=1):
        if instruction.op in SOURCES:
            values.append(writer.write(number))
            continue
        value = _RULES[instruction.op](*map(read, instruction.args))
        if uses[number] > 1 and not value.is_Atom:
            steps.append((next(names), value))
            value = steps[-1][0]
        values.append(value)
    return tuple(steps), tuple(tuple(map(read, port)) for port in outputs)
