"""Exercises on a lesson, drawn from the robot, and the sheet that students fill in and have marked.

Lesson, seed -> `Exercise`s: formulas at a right angle of a joint, torques at rest; none stands on the page;
`Exercise`s -> a sheet in plain text, and back; answers typed behind "=" -> `MarkedAnswer`s.

    answer 1 = m2*l1*lc2*cos(q2)

The sheet says with which settings it was drawn, so that it is marked without further options.

A typed formula, rewritten by the rules of `templates/lesson/spelling.toml` -> `Expression` -> exact value in
the algebra of the lesson, compared with what was derived. The page's script reads by the same rules, the same
table of names and this grammar; tests hold both against each other.

    sum      product (("+" | "-") product)*
    product  signed (("*" | "/") signed | power)*          m2 lc2 g is a product
    signed   ("+" | "-") signed | power
    power    atom ("^" signed)?
    atom     number | letter | (sin | cos | sqrt) ("^" number)? atom | "(" sum ")"

c12 stands for cos(q1 + q2); letters are those that the page shows, or those of code. An answer is a quotient
of two polynomials. What is wrong differs from the answer at an exact rational point; what is called right is
the same polynomial, s^2 + c^2 = 1 used, or, beyond three joints, the same at further exact points. Nothing is
rounded, nothing evaluated by Python.

Supported: all robots of the lesson, all that its page reads, sines of whole multiples of joint angles.
Not supported: sheets whose questions were changed; sines of numbers or lengths, powers that are not whole.
"""

import math
import operator
import re
import tomllib
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, reduce
from itertools import repeat
from typing import Any, NoReturn, TypeAlias, cast

import numpy as np
from sympy import QQ, Integer, Rational, Symbol, expand, pi, sympify
from sympy.polys.polyerrors import CoercionFailed
from sympy.polys.rings import PolyRing

from symid import dynamics
from symid.dynamics import ExactAlgebra, PointAlgebra
from symid.environment import locate_resource_folder
from symid.errors import InputError, Notice
from symid.lessons import textbook
from symid.lessons.chapters import LANGUAGES, WRITTEN_OUT, Lesson, Words, list_items, list_slides, load_words
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import Parameterisation
from symid.robot import Robot

MOST_EXERCISES = 50
"""On one page."""
_LONGEST_ANSWER, _SMALL_TORQUE = 140, 1e-9
_POSTURES = ((Integer(0), "0"), (pi / 2, "90 deg"), (-pi / 2, "-90 deg"), (pi, "180 deg"))
"""Angles of a joint in rad, and as they are written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exercise:
    """A question, on the page and as `plain` text, its answer as text, and why.

    Args:
        prompt: of the page, its formulas in LaTeX. plain: the same as text. note: the unit of the answer.
        code: the answer in JavaScript; or a `number`.
    """

    prompt: str
    plain: str
    answer: str
    note: str = ""
    code: str = ""
    number: float | None = None


def draw_exercises(
    lesson: Lesson, count: int, rng: np.random.Generator, words: Words = str
) -> tuple[Exercise, ...]:
    """Return exercises on a lesson, in its language: formulas at right angles, torques at rest."""
    makers = (_ask_formula, _ask_torque)
    found: dict[str, Exercise] = {}
    for k in range(50 * count):
        one = makers[k % len(makers)](lesson, rng, words)
        if one is not None:
            found.setdefault(one.prompt, one)
        if len(found) == count:
            break
    return tuple(found.values())


def _ask_formula(lesson: Lesson, rng: np.random.Generator, words: Words) -> Exercise | None:
    robot, book, slides = lesson.robot, lesson.book, list_slides(lesson.robot)
    items = [item for chapter in lesson.chapters for item in list_items(chapter.items)]
    known = [x for x in items if x.code and x.name[:1] in set("Mgh") and 4 < len(x.sympy) <= _LONGEST_ANSWER]
    if not known:
        return None
    item = known[int(rng.integers(len(known)))]
    names = (*lesson.values, *(f"{rate}q{k + 1}" for k in range(robot.size) for rate in ("", "d", "dd")))
    letters = {name: Symbol(name) for name in names}
    value = sympify(item.sympy, locals=letters)
    turning = [k for k in range(1, robot.size + 1) if k not in slides and value.has(letters[f"q{k}"])]
    if not turning:
        return None
    joint = turning[int(rng.integers(len(turning)))]
    angle, shown = _POSTURES[int(rng.integers(len(_POSTURES)))]
    # Another formula than that of the page, which depends on the angle.
    found = expand(value.subs(letters[f"q{joint}"], angle))
    if found.is_number or found.has(pi):
        return None
    text = re.sub(r"(\w+)\*\*(\d+)", lambda power: "*".join([power[1]] * int(power[2])), str(found))
    code = re.sub(r"[A-Za-z]\w*", lambda name: f"{'Math' if name[0] in _FUNCTIONS else 'v'}.{name[0]}", text)
    answer = re.sub(r"\w+", lambda name: textbook.write_name(name[0], book, slides), text)
    left, coordinate = item.latex.partition(" = ")[0], textbook.write_symbol(f"q{joint}", book, slides)
    ask = words("What is {0} at {1} = {2}?").format
    plain = ask(*(rewrite_formula(part).replace("_", "").strip() for part in (left, coordinate)), shown)
    return Exercise(prompt=ask(f"${left}$", f"${coordinate}$", shown), plain=plain, answer=answer, code=code)


def _ask_torque(lesson: Lesson, rng: np.random.Generator, words: Words) -> Exercise | None:
    robot = lesson.robot
    q = [round(float(x), 1) for x in rng.uniform(-1.5, 1.5, robot.freedom)]
    # Torques at rest, springs included, by the Newton-Euler recursion in doubles.
    algebra = dynamics.FloatAlgebra(dict(robot.symbols))
    values: dict[str, float] = {}
    for number, angle in enumerate(dynamics.spread_coordinates(robot, algebra, q)[: robot.size], start=1):
        values |= {f"s{number}": math.sin(angle), f"c{number}": math.cos(angle), f"q{number}": angle}
    recursion = dynamics.build_recursion(robot, algebra, dynamics.build_state(robot, algebra, values))
    keys = dynamics.derive_base_parameters(robot).keys
    loads = dynamics.compute_inverse_dynamics(recursion, dict(zip(keys, lesson.beta, strict=True)))
    torques = dynamics.fold_vector(robot, algebra, loads)
    joint = int(rng.integers(robot.freedom))
    if abs(torques[joint]) < _SMALL_TORQUE:
        return None
    slides = robot.axes[joint].prismatic
    what, unit = ("force", "N") if slides else ("torque", "N m")
    ask = words(
        f"With the values of this page, which {what} ({unit}) holds joint {{0}} at rest at {{1}} = ({{2}})? "
        "To one percent."
    ).format
    place, q_text = robot.coordinates[joint] + 1, ", ".join(f"{x:g}" for x in q)
    letter = lesson.book.coordinates
    return Exercise(
        prompt=ask(place, f"${letter}$", q_text),
        plain=ask(place, rewrite_formula(letter).strip(), q_text),
        answer=f"{torques[joint]:.5g}",
        note=unit,
        number=torques[joint],
    )


# The sheet.

_SETTING = re.compile(r"--([a-z-]+) (\S+)")
_ANSWER = re.compile(r"(?:answer|Antwort)\s+(\d+)\s*[=:]\s*(.*)", re.IGNORECASE)
_PROMPT = re.compile(r"(\d+)\.\s+(.*)")
_SHARE = 0.01
"""Of a torque, to which it is wanted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerSheet:
    """What a sheet holds: `settings` of its exercises; by number the `prompts` and typed `answers`."""

    settings: Mapping[str, str]
    prompts: Mapping[int, str]
    answers: Mapping[int, str]


def write_sheet(
    robot: str, exercises: Sequence[Exercise], settings: Mapping[str, object], words: Words = str
) -> str:
    """Return the sheet for students: every question, and a line for its answer."""
    drawn = " ".join(f"--{name} {value}" for name, value in settings.items() if value is not None)
    lines = [
        words("# Exercises on {0}. Type each answer behind its =; it may go on in indented lines.").format(
            robot
        ),
        words("# Formulas in the letters of the lesson: m2*lc2*g*cos(q1 + q2), or shorter m2 lc2 g c12."),
        words("# Numbers may be formulas too."),
        words("# To mark: symid derive ROBOT --check FILE"),
        words("# Written with: {0}").format(drawn),
    ]
    for number, one in enumerate(exercises, start=1):
        lines += ["", f"{number}. {one.plain}", words("answer {0} =").format(number)]
    return "\n".join(lines) + "\n"


def read_sheet(text: str, file: str) -> AnswerSheet:
    """Return what stands in a sheet; an InputError names all mistakes, such as a number with two answers."""
    settings, prompts, answers = dict[str, str](), dict[int, str](), dict[int, str]()
    notices, last = list[Notice](), 0
    for place, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#") and "--exercises" in line:
            settings = dict(_SETTING.findall(line))
        elif match := _PROMPT.match(line):
            prompts[int(match[1])], last = match[2].strip(), 0
        elif match := _ANSWER.match(line.strip()):
            last = int(match[1])
            if last in answers:
                again = f"answer {last} stands here a second time; leave one"
                notices.append(Notice(code="lesson.twice", text=again, file=file, line=place))
            answers[last] = match[2].strip()
        elif last and line[:1].isspace() and line.strip():
            answers[last] = f"{answers[last]} {line.strip()}".strip()
    if not settings:
        what = "no line with the settings of the exercises (# Written with: --exercises ...); take the sheet "
        what += "that symid derive ROBOT --html FILE --exercises N wrote"
        notices.append(Notice(code="lesson.no-sheet", text=what, file=file))
    if notices:
        raise InputError(*notices)
    return AnswerSheet(settings=settings, prompts=prompts, answers=answers)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkedAnswer:
    """An answer with its mark: "right", "wrong", "unreadable" or "empty"; `note` says what was found."""

    number: int
    prompt: str
    typed: str
    mark: str
    note: str = ""


def mark_sheet(robot: Robot, sheet: AnswerSheet, file: str, lang: str = "") -> tuple[MarkedAnswer, ...]:
    """Return the marks of a sheet for `robot`, drawn again; notes in its language or `lang`.

    An InputError says that its settings cannot be read, or that its questions are others.
    """
    settings = {"notation": "symid", "seed": "0", "lang": "en", **sheet.settings}
    form, angle = settings.get("parameters"), settings.get("angle")
    known = form in (None, "base", "symbols", "bodies") and angle in (None, "q", "theta")
    known = known and settings["notation"] in textbook.load_books() and settings["lang"] in LANGUAGES
    if not (known and settings["seed"].isdigit() and settings.get("exercises", "").isdigit()):
        text = "its line with settings was changed: it has exercises, seed, notation, parameters, angle, lang"
        raise InputError(Notice(code="lesson.settings", text=text, file=file))
    lesson = build_lesson(
        robot, textbook.get_book(settings["notation"], angle=angle), cast("Parameterisation | None", form)
    )
    rng = np.random.default_rng(int(settings["seed"]))
    count = min(int(settings["exercises"]), MOST_EXERCISES)
    drawn = draw_exercises(lesson, count, rng, load_words(settings["lang"]))
    asked = {number: one.plain for number, one in enumerate(drawn, start=1)}
    if asked != dict(sheet.prompts):
        text = f"its questions are not those of {robot.name} with these settings; give the robot that the "
        text += "sheet was written for, or write it again with this version"
        raise InputError(Notice(code="lesson.other-exercises", text=text, file=file))
    comparison, words = build_comparison(lesson), load_words(lang or settings["lang"])
    found = []
    for number, one in enumerate(drawn, start=1):
        typed, right, mark, note = sheet.answers.get(number, ""), False, "", ""
        # The unit that the answer shows behind it may be typed too.
        given = typed if one.number is None else re.sub(r"\s*N\s*m?\s*$", "", typed)
        try:
            if not typed:
                mark = "empty"
            elif one.number is not None:
                value = evaluate_number(read_answer(given, comparison.names), lesson.values)
                right = abs(value - one.number) <= _SHARE * max(_SHARE, abs(one.number))
                note = f"{value:.5g}, to one percent"
            else:
                right, note = comparison.compare(given, one.code)
        except InputError as error:
            mark, note = "unreadable", str(error)
        mark = mark or ("right" if right else "wrong")
        found.append(MarkedAnswer(number=number, prompt=one.plain, typed=typed, mark=mark, note=words(note)))
    return tuple(found)


# Typed formulas.

_JAVASCRIPT = re.compile(r"\bv\.|\bMath\.")
_FUNCTIONS = ("sin", "cos", "sqrt")
_NO_ROOT = "sqrt takes a number whose root stands in the formulas of this robot"
_POINTS = (1, 2, 3)
"""Seeds of exact points."""
_ONE_DIGIT = 10


def _refuse(text: str) -> NoReturn:
    raise InputError(Notice(code="lesson.formula", text=text))


@cache
def load_spelling() -> Mapping[str, Any]:
    """Return the rules by which a typed formula is rewritten, its tokens and its limits."""
    path = locate_resource_folder("templates") / "lesson" / "spelling.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def rewrite_formula(text: str) -> str:
    """Return a formula in LaTeX, or with signs of Unicode, in the letters of the grammar."""

    def apply(rules: Sequence[Sequence[str]], text: str) -> str:
        for pattern, form in rules:
            # The groups of a match stand in place of $1, $2.
            put, before = re.sub(r"\$(\d)", r"\\g<\1>", form.replace("\\", r"\\")), None
            while text != before:
                before, text = text, re.sub(pattern, put, text, flags=re.ASCII)
        return text

    rules = load_spelling()
    return apply(rules["rules"], unicodedata.normalize("NFKD", apply(rules["powers"], text)))


def list_spellings(lesson: Lesson) -> dict[str, str]:
    """Return the names in code of all letters and formulas, by what a reader of the lesson may type.

    What the page shows goes before the names of code; an underscore may be left out.
    """
    robot, book, slides = lesson.robot, lesson.book, list_slides(lesson.robot)
    rates = [f"{head}q{number}" for number in range(1, robot.size + 1) for head in ("", "d", "dd")]
    own = [x for x in map(str, lesson.model.algebra.ring.symbols) if not re.fullmatch(r"[sc]\d+", x)]
    letters = [*dict.fromkeys((*rates, *lesson.values, *own))]
    pairs = [(textbook.write_name(name, book, slides), name) for name in letters]
    pairs += [(rewrite_formula(textbook.write_symbol(name, book, slides)).strip(), name) for name in letters]
    pairs += [(name, name) for name in letters]
    items = list_items([item for chapter in lesson.chapters for item in chapter.items])
    for item in (item for item in items if item.name and item.code):
        left = rewrite_formula(item.latex.partition(" = ")[0]).strip()
        # C12 is a cosine where the book writes it so, elsewhere an element of the matrix.
        pairs += [(x, item.name) for x in (left, item.name) if x[:1] not in (book.sine, book.cosine)]
    found: dict[str, str] = {}
    for typed, name in (*pairs, *((typed.replace("_", ""), name) for typed, name in pairs)):
        found.setdefault(typed, name)
    return found


@dataclass(frozen=True, slots=True)
class Expression:
    """A node: a "number" or "letter" by its text, a function by its name, or an operation on its parts."""

    kind: str
    text: str = ""
    parts: "tuple[Expression, ...]" = ()


def read_formula(text: str, names: Mapping[str, str] | None = None) -> Expression:
    """Return a formula as a tree; an InputError says where it cannot be read."""
    reader = _Reader(re.findall(load_spelling()["token"], text.replace("**", "^"), re.ASCII), names)
    whole = reader.read_sum()
    if reader.tokens:
        _refuse(f'"{reader.tokens[0]}" was not expected')
    return whole


def read_answer(typed: str, names: Mapping[str, str] | None = None) -> Expression:
    """Return what a student typed as a tree, its letters by `names`; an InputError for a long one too."""
    longest = load_spelling()["longest"]
    if len(typed) > longest:
        _refuse(f"the formula is longer than {longest} letters")
    return read_formula(rewrite_formula(typed), names)


class _Reader:
    """The grammar above, one method a rule; `tokens` are those that are left."""

    def __init__(self, tokens: list[str], names: Mapping[str, str] | None) -> None:
        self.tokens = tokens
        self.names = names or {}
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
            elif re.match(r"[\w.(]", self.tokens[0], re.ASCII):
                left = Expression("*", parts=(left, self._read_power()))
            else:
                break
        return left

    def _read_signed(self) -> Expression:
        self.depth += 1
        if self.depth > (deepest := load_spelling()["deepest"]):
            _refuse(f"brackets and signs are nested more than {deepest} deep")
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
        if re.match(r"\d|\.\d", first, re.ASCII):
            exponent = re.search(r"[eE][-+]?(\d+)$", first)
            if exponent and int(exponent[1]) > load_spelling()["exponent"]:
                _refuse(f'the number "{first}" is too large or too small')
            return Expression("number", first)
        if first in _FUNCTIONS:
            power = self._read_atom() if self._take("^") else None
            if self.tokens and self.tokens[0] in _FUNCTIONS:
                _refuse(f"write the argument of {first} in brackets")
            value = Expression(first, parts=(self._read_atom(),))
            return value if power is None else Expression("^", parts=(value, power))
        if re.match(r"[A-Za-z]", first):
            plain = first.replace("_", "")
            return Expression("letter", self.names.get(first) or self.names.get(plain) or first)
        _refuse(f'"{first}" was not expected')


def evaluate_number(node: Expression, values: Mapping[str, float]) -> float:
    """Return a formula as a number, letters from `values`; an InputError says why there is none."""
    if node.kind == "letter":
        if node.text not in values:
            _refuse(f'"{node.text}" has no value in this lesson')
        return values[node.text]
    parts = [evaluate_number(part, values) for part in node.parts]
    try:
        return float(node.text if node.kind == "number" else _OPERATIONS[node.kind](*parts))
    except (ArithmeticError, ValueError):
        _refuse("the formula has no finite value")


_ARITHMETIC = (operator.add, operator.sub, operator.mul, operator.truediv, math.pow)
_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    **dict(zip("+-*/^", _ARITHMETIC, strict=True)),
    **{name: getattr(math, name) for name in _FUNCTIONS},
}


Ratio: TypeAlias = tuple[Any, Any]
"""Numerator and denominator, elements of an algebra."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    """Where formulas have exact values: an algebra, its `letters`, and `formulas` of the lesson by name."""

    algebra: ExactAlgebra | PointAlgebra
    domain: Any
    letters: Mapping[str, Any]
    formulas: Mapping[str, Expression]
    size: int

    def evaluate(self, node: Expression) -> Ratio:
        mul, one = self.algebra.mul, self.algebra.one
        match node.kind:
            case "sin" | "cos":
                return self._expand_wave(node.kind[0], list(self._read_angle(node.parts[0]).items())), one
            case "sqrt":
                value = read_rational(node.parts[0])
                if value is None or value < 0:
                    _refuse(_NO_ROOT)
                try:
                    root = Rational(value.numerator, value.denominator) ** Rational(1, 2)
                    return one * self.domain.from_sympy(root), one
                except CoercionFailed:
                    _refuse(_NO_ROOT)
            case "number":
                number = Fraction(node.text)
                return one * self.domain.convert(QQ(number.numerator, number.denominator)), one
            case "letter":
                name = node.text
                if name in self.letters:
                    return self.letters[name], one
                if name in self.formulas:
                    return self.evaluate(self.formulas[name])
                match = re.match(load_spelling()["wave"], name, re.ASCII)
                if match is None:
                    _refuse(f'"{name}" is no letter of this lesson')
                # c12 of a robot with less than ten joints has digits, c_10_11 numbers; n is a minus.
                joints = re.findall(r"(n?)(\d)" if self.size < _ONE_DIGIT else r"(n?)(\d+)", match[2])
                angle = [(int(joint), -1 if sign else 1) for sign, joint in joints]
                return self._expand_wave(match[1].lower(), angle), one
            case "^":
                (a, b), power = self.evaluate(node.parts[0]), read_rational(node.parts[1])
                highest = load_spelling()["highest"]
                if power is None or power.denominator > 1 or abs(power) > highest:
                    _refuse(f"a power is a whole number up to {highest}; use sqrt for roots")
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
                    highest = load_spelling()["highest"]
                    if number is not None and number.denominator == 1 and abs(number) <= highest:
                        return {k: int(number) * n for k, n in self._read_angle(other).items()}
        if read_rational(node) == 0:
            return {}
        _refuse("sin and cos take a sum of joint angles, as q1 + q2")

    def _expand_wave(self, kind: str, angle: list[tuple[int, int]]) -> Any:  # noqa: ANN401  as above
        """Return sine or cosine of a sum of angles by the addition theorems."""
        for number, _ in angle:
            if f"s{number}" not in self.letters:
                _refuse(f"joint {number} has no angle")
        waves = ((self.letters[f"s{k}"], self.letters[f"c{k}"], times) for k, times in angle)
        return textbook.add_angles(self.algebra, waves)[kind == "c"]


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
    """Where formulas are compared: exact points, and up to three joints a ring; `names` by what is typed."""

    points: tuple[_Field, ...]
    ring: _Field | None
    names: Mapping[str, str]

    def compare(self, typed: str, answer: str) -> tuple[bool, str]:
        """Return whether a typed formula equals the answer, and how that was found.

        The answer may be JavaScript of the page; an InputError says that the typed formula cannot be read.
        """
        left, right = read_answer(typed, self.names), read_formula(_JAVASCRIPT.sub("", answer))
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
    known = ((item.name, item.code) for item in items if item.name and item.code)
    formulas = {name: read_formula(_JAVASCRIPT.sub("", code)) for name, code in known}
    own = list(map(str, model.algebra.ring.symbols))
    spellings = list_spellings(lesson)
    further = [name for name in dict.fromkeys(spellings.values()) if name not in {*own, *formulas}]
    domain, shift = model.algebra.ring.domain, len(further)
    ring = PolyRing([*further, *own], domain)
    algebra = ExactAlgebra(ring, tuple((s + shift, c + shift) for s, c in model.algebra.sines))
    # Letters of the ring that the page has as formulas, such as composite bodies, are these formulas.
    letters = {name: value for name, value in algebra.generators.items() if name not in formulas}

    def build(algebra: ExactAlgebra | PointAlgebra, letters: Mapping[str, Any]) -> _Field:
        return _Field(algebra=algebra, domain=domain, letters=letters, formulas=formulas, size=robot.size)

    points = []
    for seed in _POINTS:
        # Exact numbers for all letters, with s^2 + c^2 = 1.
        rng = np.random.default_rng(seed)
        point: dict[str, Fraction] = {}
        for name in letters:
            t = Fraction(int(rng.integers(1, 400)), int(rng.integers(200, 400)))
            if name[0] == "s" and name[1:].isdigit():
                point |= {name: 2 * t / (1 + t * t), f"c{name[1:]}": (1 - t * t) / (1 + t * t)}
            point.setdefault(name, t)
        numbers = {name: domain.convert(QQ(x.numerator, x.denominator)) for name, x in point.items()}
        points.append(build(PointAlgebra(domain, {}), numbers))
    short = robot.freedom <= WRITTEN_OUT
    whole = build(algebra, letters) if short else None
    return FormulaComparison(points=tuple(points), ring=whole, names=spellings)
