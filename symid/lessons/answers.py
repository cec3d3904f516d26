"""Formulas that students type: read by a small parser, compared exactly with what was derived.

Text -> `Expression` -> exact value in the algebra of the lesson; two formulas -> whether they are equal.

    sum      product (("+" | "-") product)*
    product  signed (("*" | "/") signed | power)*          m2 lc2 g is a product
    signed   ("+" | "-") signed | power
    power    atom ("^" signed)?
    atom     number | letter | (sin | cos | sqrt) atom | "(" sum ")"

c12 stands for cos(q1 + q2). An answer is a quotient of two polynomials. What is wrong differs from the answer
at an exact rational point; what is called right is the same polynomial, s^2 + c^2 = 1 used, or, beyond three
joints, the same at further exact points. Nothing is rounded, nothing evaluated by Python.

Supported: all that the page of a lesson reads, with sines of whole multiples of joint angles.
Not supported: sines of numbers or lengths, powers that are not whole.
"""

import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import repeat
from typing import Any, NoReturn, TypeAlias, cast

import numpy as np
from sympy import Rational
from sympy.polys.polyerrors import CoercionFailed
from sympy.polys.rings import PolyRing

from symid.dynamics import ExactAlgebra, PointAlgebra, write_label
from symid.errors import InputError, Notice
from symid.lessons.chapters import WRITTEN_OUT, Lesson, list_items

_TOKEN = re.compile(r"\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+|[A-Za-z_]\w*|\S)")
_WAVE = re.compile(r"([scSC])(\d+)")
_JAVASCRIPT = re.compile(r"\bv\.|\bMath\.")
_FUNCTIONS = ("sin", "cos", "sqrt")
_LONGEST = 1200
_DEEPEST = 60
_HIGHEST = 20
_LARGEST_EXPONENT = 99
_NO_ROOT = "sqrt takes a number whose root stands in the formulas of this robot"
_POINTS = (1, 2, 3)
"""Seeds of exact points."""
_ONE_DIGIT = 10


def _refuse(text: str) -> NoReturn:
    raise InputError(Notice(code="lesson.formula", text=text))


@dataclass(frozen=True, slots=True)
class Expression:
    """A node: a "number" or "letter" by its text, a function by its name, or an operation on its parts."""

    kind: str
    text: str = ""
    parts: "tuple[Expression, ...]" = ()


def read_formula(text: str) -> Expression:
    """Return a typed formula as a tree.

    Raises:
        InputError: it cannot be read; the message says where.
    """
    plain = text.replace("\N{MINUS SIGN}", "-").replace("**", "^")
    reader = _Reader(_TOKEN.findall(plain))
    whole = reader.read_sum()
    if reader.tokens:
        _refuse(f'"{reader.tokens[0]}" was not expected')
    return whole


def read_answer(typed: str) -> Expression:
    """Return a formula that a student typed as a tree; a long one is refused.

    Raises:
        InputError: it cannot be read.
    """
    if len(typed) > _LONGEST:
        _refuse(f"the formula is longer than {_LONGEST} letters")
    return read_formula(typed)


class _Reader:
    """The grammar above, one method a rule; `tokens` are those that are left."""

    def __init__(self, tokens: list[str]) -> None:
        self.tokens = tokens
        self.depth = 0

    def _take(self, *wanted: str) -> str:
        """Return the next token where it is one of those wanted, else nothing."""
        return self.tokens.pop(0) if self.tokens and self.tokens[0] in wanted else ""

    def read_sum(self) -> Expression:
        left = self._read_product()
        while sign := self._take("+", "-"):
            left = Expression(sign, parts=(left, self._read_product()))
        return left

    def _read_product(self) -> Expression:
        left = self._read_signed()
        while self.tokens:
            if sign := self._take("*", "/"):
                left = Expression(sign, parts=(left, self._read_signed()))
            elif re.match(r"[\w.(]", self.tokens[0]):
                left = Expression("*", parts=(left, self._read_power()))
            else:
                break
        return left

    def _read_signed(self) -> Expression:
        self.depth += 1
        if self.depth > _DEEPEST:
            _refuse(f"brackets and signs are nested more than {_DEEPEST} deep")
        sign = self._take("+", "-")
        inner = self._read_signed() if sign else self._read_power()
        self.depth -= 1
        return Expression("-", parts=(Expression("number", "0"), inner)) if sign == "-" else inner

    def _read_power(self) -> Expression:
        base = self._read_atom()
        return Expression("^", parts=(base, self._read_signed())) if self._take("^") else base

    def _read_atom(self) -> Expression:
        if not self.tokens:
            _refuse("the formula is not finished")
        first = self.tokens.pop(0)
        if first == "(":
            inner = self.read_sum()
            if not self._take(")"):
                found = f' in place of "{self.tokens[0]}"' if self.tokens else " at the end"
                _refuse(f'expected ")"{found}')
            return inner
        if re.match(r"[\d.]", first) and first != ".":
            exponent = re.search(r"[eE][-+]?(\d+)$", first)
            if exponent and int(exponent[1]) > _LARGEST_EXPONENT:
                _refuse(f'the number "{first}" is too large or too small')
            return Expression("number", first)
        if first in _FUNCTIONS:
            if self.tokens and self.tokens[0] in _FUNCTIONS:
                _refuse(f"write the argument of {first} in brackets")
            return Expression(first, parts=(self._read_atom(),))
        if re.match(r"[A-Za-z_]", first):
            return Expression("letter", first)
        _refuse(f'"{first}" was not expected')


def evaluate_number(node: Expression, values: Mapping[str, float]) -> float:
    """Return a formula as a number, letters from `values`.

    Raises:
        InputError: a letter has no value, or there is no such number.
    """
    if node.kind == "letter":
        if node.text not in values:
            _refuse(f'"{node.text}" has no value in this lesson')
        return values[node.text]
    parts = [evaluate_number(part, values) for part in node.parts]
    try:
        return float(node.text if node.kind == "number" else _OPERATIONS[node.kind](*parts))
    except (ArithmeticError, ValueError):
        _refuse("the formula has no finite value")


_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": math.pow,
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
}


Ratio: TypeAlias = tuple[Any, Any]
"""Numerator and denominator, elements of an algebra."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    """Where formulas have exact values: an algebra, its `letters`, and `formulas` of the lesson by name."""

    algebra: ExactAlgebra | PointAlgebra
    letters: Mapping[str, Any]
    formulas: Mapping[str, Expression]
    size: int

    def evaluate(self, node: Expression) -> Ratio:
        """Return the value of a formula."""
        mul, one = self.algebra.mul, self.algebra.one
        if node.kind in _FUNCTIONS:
            return self._call(node), one
        match node.kind:
            case "number":
                value, domain = Fraction(node.text), self._get_domain()
                number = domain.convert(value.numerator) / domain.convert(value.denominator)
                return one * number, one
            case "letter":
                name = node.text
                if name in self.letters:
                    return self.letters[name], one
                if match := _WAVE.fullmatch(name):
                    joints = list(match[2]) if self.size < _ONE_DIGIT else [match[2]]
                    wave = self._expand_wave(match[1].lower(), [(int(joint), 1) for joint in joints])
                    return wave, one
                if name in self.formulas:
                    return self.evaluate(self.formulas[name])
                _refuse(f'"{name}" is no letter of this lesson')
            case "^":
                (a, b), power = self.evaluate(node.parts[0]), read_rational(node.parts[1])
                if power is None or power.denominator > 1 or abs(power) > _HIGHEST:
                    _refuse(f"a power is a whole number up to {_HIGHEST}; use sqrt for roots")
                a, b = (b, a) if power < 0 else (a, b)
                if not b:
                    _refuse("the formula divides by zero")
                factors = repeat((a, b), abs(int(power)))
                return reduce(lambda x, y: (mul(x[0], y[0]), mul(x[1], y[1])), factors, (one, one))
        (a, b), (c, d) = map(self.evaluate, node.parts)
        match node.kind:
            case "*":
                return mul(a, c), mul(b, d)
            case "/":
                if not c:
                    _refuse("the formula divides by zero")
                return mul(a, d), mul(b, c)
        left, right = mul(a, d), mul(c, b)
        return (left + right if node.kind == "+" else left - right), mul(b, d)

    def _get_domain(self) -> Any:  # noqa: ANN401  a domain of SymPy
        return self.algebra.domain if isinstance(self.algebra, PointAlgebra) else self.algebra.ring.domain

    def _call(self, node: Expression) -> Any:  # noqa: ANN401  an element of the algebra
        (inner,) = node.parts
        if node.kind != "sqrt":
            angle = self._read_angle(inner)
            return self._expand_wave(node.kind[0], list(angle.items()))
        value = read_rational(inner)
        if value is None or value < 0:
            _refuse(_NO_ROOT)
        try:
            root = Rational(value.numerator, value.denominator) ** Rational(1, 2)
            return self.algebra.one * self._get_domain().from_sympy(root)
        except CoercionFailed:
            _refuse(_NO_ROOT)

    def _read_angle(self, node: Expression) -> dict[int, int]:
        """Return a sum of joint angles by number and multiple."""
        match node.kind:
            case "letter" if re.fullmatch(r"q[1-9]\d*", node.text) and f"s{node.text[1:]}" in self.letters:
                return {int(node.text[1:]): 1}
            case "+" | "-":
                left, right = map(self._read_angle, node.parts)
                sign = 1 if node.kind == "+" else -1
                return {k: left.get(k, 0) + sign * right.get(k, 0) for k in sorted({*left, *right})}
            case "*":
                for factor, other in (node.parts, node.parts[::-1]):
                    number = read_rational(factor)
                    if number is not None and number.denominator == 1 and abs(number) <= _HIGHEST:
                        return {k: int(number) * n for k, n in self._read_angle(other).items()}
        if read_rational(node) == 0:
            return {}
        _refuse("sin and cos take a sum of joint angles, as q1 + q2")

    def _expand_wave(self, kind: str, angle: list[tuple[int, int]]) -> Any:  # noqa: ANN401  as above
        """Return sine or cosine of a sum of angles by the addition theorems."""
        algebra = self.algebra
        sine, cosine = algebra.zero, algebra.one
        for number, times in angle:
            if f"s{number}" not in self.letters:
                _refuse(f"joint {number} has no angle")
            s, c = self.letters[f"s{number}"], self.letters[f"c{number}"]
            s = s if times > 0 else algebra.neg(s)
            for _ in range(abs(times)):
                sine, cosine = (
                    algebra.mul(sine, c) + algebra.mul(cosine, s),
                    algebra.mul(cosine, c) - algebra.mul(sine, s),
                )
        return sine if kind == "s" else cosine


def read_rational(node: Expression) -> Fraction | None:
    """Return an expression of numbers as a fraction; None where it has letters, roots or powers."""
    if node.kind == "number":
        return Fraction(node.text)
    parts = [read_rational(part) for part in node.parts]
    if node.kind not in ("+", "-", "*", "/") or None in parts or (node.kind == "/" and not parts[1]):
        return None
    return cast("Fraction", _OPERATIONS[node.kind](*parts))


@dataclass(frozen=True, slots=True, kw_only=True)
class FormulaComparison:
    """Exact points of a lesson, and up to three joints its ring, in which formulas are compared."""

    points: tuple[_Field, ...]
    ring: _Field | None

    def compare(self, typed: str, answer: str) -> tuple[bool, str]:
        """Return whether a typed formula equals the answer, and how that was found.

        Args:
            typed: by a student.
            answer: as text, also as JavaScript of the page.

        Raises:
            InputError: the typed formula cannot be read.
        """
        left, right = read_answer(typed), read_formula(_JAVASCRIPT.sub("", answer))
        letters = set(_list_letters(left))
        for name, formula in self.points[0].formulas.items():
            if name in letters and formula == right:
                _refuse(f'"{name}" is what is asked for')
        for field in self.points:
            if not _is_equal(field, left, right):
                return False, "not equal to the answer"
        if self.ring is None:
            return True, f"equal at {len(self.points)} exact points"
        return _is_equal(self.ring, left, right), "equal as polynomials"


def _list_letters(node: Expression) -> Iterator[str]:
    if node.kind == "letter":
        yield node.text
    for part in node.parts:
        yield from _list_letters(part)


def _is_equal(field: _Field, left: Expression, right: Expression) -> bool:
    (a, b), (c, d) = field.evaluate(left), field.evaluate(right)
    return bool(field.algebra.mul(a, d) == field.algebra.mul(c, b))


def build_comparison(lesson: Lesson) -> FormulaComparison:
    """Return what formulas typed for a lesson are compared in."""
    robot, model = lesson.robot, lesson.model
    items = list_items([item for chapter in lesson.chapters for item in chapter.items])
    formulas = {
        item.name: read_formula(_JAVASCRIPT.sub("", item.code)) for item in items if item.name and item.code
    }
    own = list(map(str, model.algebra.ring.symbols))
    rates = [f"{head}q{number}" for number in range(1, robot.size + 1) for head in ("", "d", "dd")]
    standard = [write_label(robot, label) for label in model.base.labels]
    names = [*dict.fromkeys((*rates, *lesson.values, *standard))]
    further = [name for name in names if name not in own]
    domain, shift = model.algebra.ring.domain, len(further)
    ring = PolyRing([*further, *own], domain)
    algebra = ExactAlgebra(ring, tuple((s + shift, c + shift) for s, c in model.algebra.sines))
    # Letters of the ring that the page has as formulas, such as composite bodies, are these formulas.
    known = {name: value for name, value in algebra.generators.items() if name not in formulas}

    def build(algebra: ExactAlgebra | PointAlgebra, letters: Mapping[str, Any]) -> _Field:
        return _Field(algebra=algebra, letters=letters, formulas=formulas, size=robot.size)

    def convert(value: Fraction) -> Any:  # noqa: ANN401  an element of the domain
        return domain.convert(value.numerator) / domain.convert(value.denominator)

    points = []
    for seed in _POINTS:
        # Exact numbers for all letters, with s^2 + c^2 = 1.
        rng = np.random.default_rng(seed)
        draws = [
            Fraction(int(rng.integers(1, 400)), int(rng.integers(200, 400))) for _ in range(2 * len(known))
        ]
        point = {name: convert(value) for name, value in zip(known, draws, strict=False)}
        for name, t in zip(known, draws[len(known) :], strict=True):
            if name[0] == "s" and name[1:].isdigit():
                point[name] = convert(2 * t / (1 + t * t))
                point[f"c{name[1:]}"] = convert((1 - t * t) / (1 + t * t))
        points.append(build(PointAlgebra(domain, {}), point))
    short = robot.freedom <= WRITTEN_OUT
    return FormulaComparison(points=tuple(points), ring=build(algebra, known) if short else None)
