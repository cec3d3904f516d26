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
from symid.arrays import FloatArray
from symid.dynamics import ExactAlgebra, PointAlgebra
from symid.environment import locate_resource_folder
from symid.errors import InputError, Notice
from symid.lessons import textbook
from symid.lessons.chapters import (
    LANGUAGES,
    WRITTEN_OUT,
    Lesson,
    list_slides,
    load_words,
    write_decimals,
)
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import Parameterisation
from symid.robot import Robot

MOST_EXERCISES = 50
"""On one page."""
_MARKS = {"en": ", ", "de": "; "}
"""Between numbers of a language."""
_LONGEST_ANSWER, _SMALL, _PATIENCE = 140, 1e-9, 12
_POSTURES = ((Integer(0), "0", "0"), *((k * pi / 2, rf"{90 * k}^\circ", f"{90 * k}°") for k in (1, -1, 2)))
"""Angles of a joint in rad, and as they are written in LaTeX and as text."""
_FORMULAS = {
    r"M\d+_\d+": "What is the element {0} of the inertia matrix at {1}?",
    r"J\d+_\d+": "What is the element {0} of the Jacobian at {1}?",
    r"h\d+_\d+_\d+": "What is the Christoffel symbol {0} at {1}?",
    r"g\d+_": "What is the gravity term {0} at {1}?",
}
"""Questions for a formula, by the names of what is asked for."""
_WITH = "With the values given, "
_NUMBERS = {
    "rest": (_WITH + "which {what} ({unit}) holds joint {{0}} at rest at {{1}}? To one percent.", "g{0}_"),
    "start": (
        _WITH + "which {what} ({unit}) does joint {{0}} need to start from rest at {{1}} with {{2}}? To one "
        "percent.",
        "M{0}_{1} M{1}_{0} g{0}_",
    ),
    "speed": (
        _WITH + "which {what} ({unit}) does joint {{0}} need at {{1}} with {{2}}, without acceleration or "
        "friction? To one percent.",
        "C{0}_{1} g{0}_",
    ),
    "energy": (_WITH + "what is the kinetic energy (J) at {{1}} with {{2}}? To one percent.", "T_"),
}
"""Questions for a number, and the formulas that it follows from, those of joint {0} and of all joints {1}."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exercise:
    """A question, on the page and as `plain` text, its answer as text, and why.

    Args:
        prompt: of the page, its formulas in LaTeX. plain: the same as text. note: the unit of the answer.
        about: what is asked for. joint: the one whose angle the question gives, and `given` how; else 0.
        code: the answer in JavaScript; or a `number`. needed: letters whose values the number follows from.
    """

    prompt: str
    plain: str
    answer: str
    about: str
    note: str = ""
    joint: int = 0
    given: str = ""
    code: str = ""
    number: float | None = None
    needed: frozenset[str] = frozenset()


def draw_exercises(lesson: Lesson, count: int, rng: np.random.Generator) -> tuple[Exercise, ...]:
    """Return exercises on a lesson, in its language, formulas at right angles and numbers in turn.

    A quantity is asked for again only where there are no others.
    """
    makers = (_ask_formula, _ask_number)
    found, vain = dict[str, Exercise](), 0
    for k in range(50 * count):
        # One kind in vain again and again: the robot has none, or no more of it.
        maker = makers[(len(found) + vain // _PATIENCE) % len(makers)]
        one = maker(lesson, rng, len(found) // len(makers) + vain)
        vain += 1
        known = sum(one.about == other.about for other in found.values()) if one else 0
        if one is not None and known <= k // (10 * count) and one.prompt not in found:
            found[one.prompt], vain = one, 0
        if len(found) == count:
            break
    return tuple(found.values())


def _ask_formula(lesson: Lesson, rng: np.random.Generator, turn: int) -> Exercise | None:
    robot, book, slides = lesson.robot, lesson.book, list_slides(lesson.robot)
    short = [item for item in lesson.formulas if 4 < len(item.sympy) <= _LONGEST_ANSWER]
    kinds = {form: [x for x in short if re.fullmatch(form, x.name)] for form in _FORMULAS}
    if not (asked := [form for form, some in kinds.items() if some]):
        return None
    known = kinds[form := asked[turn % len(asked)]]
    item = known[int(rng.integers(len(known)))]
    names = (*lesson.values, *(f"{rate}q{k + 1}" for k in range(robot.size) for rate in ("", "d", "dd")))
    letters = {name: Symbol(name) for name in names}
    value = sympify(item.sympy, locals=letters)
    turning = [k for k in range(1, robot.size + 1) if k not in slides and value.has(letters[f"q{k}"])]
    if not turning:
        return None
    joint = turning[int(rng.integers(len(turning)))]
    angle, *shown = _POSTURES[int(rng.integers(len(_POSTURES)))]
    # Another formula than that of the page, which depends on the angle.
    found = expand(value.subs(letters[f"q{joint}"], angle))
    if found.is_number or found.has(pi):
        return None
    code = re.sub(r"(\w+)\*\*(\d+)", lambda power: "*".join([power[1]] * int(power[2])), str(found))
    code = re.sub(r"[A-Za-z]\w*", lambda name: f"{'Math' if name[0] in _FUNCTIONS else 'v'}.{name[0]}", code)
    answer = re.sub(r"\w+", lambda name: textbook.write_name(name[0], book, slides), str(found))
    # A Christoffel symbol h1 = c112 is asked for by its indices.
    left, coordinate = item.latex.split(" = ")[-2], textbook.write_symbol(f"q{joint}", book, slides)
    ask = load_words(lesson.language)(_FORMULAS[form]).format
    given = f"{show_plain(coordinate)} = {shown[1]}"
    return Exercise(
        prompt=ask(f"${left}$", f"${coordinate} = {shown[0]}$"),
        plain=ask(show_plain(left), given),
        answer=answer.replace("**", "^"),
        about=item.name,
        joint=joint,
        given=given,
        code=code,
    )


def _ask_number(lesson: Lesson, rng: np.random.Generator, turn: int) -> Exercise | None:
    robot, book, freedom = lesson.robot, lesson.book, lesson.robot.freedom
    kinds = list(_NUMBERS)[: None if freedom <= WRITTEN_OUT else 1]
    kind, place = kinds[turn % len(kinds)], int(rng.integers(freedom))
    q = []
    for joint in robot.axes:
        low, high = joint.limits.position or ((0.1, 0.6) if joint.prismatic else (-1.5, 1.5))
        # Within a quarter turn where the limits allow that.
        low, high = max(low, min(-1.5, high)), min(high, max(1.5, low))
        q.append(round(float(rng.uniform(low, high)), 2 if joint.prismatic else 1))
    rates, still = [round(float(x), 1) for x in rng.uniform(-2.0, 2.0, freedom)], [0.0] * freedom
    values = [q, rates if kind == "speed" else still, still if kind in ("rest", "speed") else rates]
    torques = _compute_torques(lesson, *values)
    number = float(torques[place])
    if kind == "energy":
        # dq' M dq / 2, the momentum M dq as what the accelerations dq add to the torques at rest.
        number = 0.5 * float(np.dot(rates, torques - _compute_torques(lesson, q, still, still)))
    if abs(number) < _SMALL:
        return None
    what, unit = ("force", "N") if robot.axes[place].prismatic else ("torque", "N m")
    sentence, formulas = _NUMBERS[kind]
    unit = "J" if kind == "energy" else unit
    ask = load_words(lesson.language)(sentence.format(what=what, unit=unit)).format
    prompt: list[object] = [robot.coordinates[place] + 1]
    plain = [*prompt]
    dots = {"start": r"\ddot ", "rest": ""}.get(kind, r"\dot ")
    sides = [(book.coordinates, q), (f"{dots}{{{book.coordinates}}}", rates)]
    for letter, numbers in sides[: 1 if kind == "rest" else 2]:
        # Each number is a formula of its own, so that long lines break between them.
        texts = [write_decimals(f"{x:g}", lesson.language) for x in numbers]
        shown = [f"${text.replace(',', '{,}')}$" for text in texts]
        prompt.append(f"${letter}$ = ({_MARKS[lesson.language].join(shown)})")
        plain.append(f"{show_plain(letter)} = ({_MARKS[lesson.language].join(texts)})")
    return Exercise(
        prompt=ask(*prompt),
        plain=ask(*plain),
        answer=write_decimals(f"{number:.5g}", lesson.language),
        about=f"{kind} {'' if kind == 'energy' else place}",
        note=unit,
        number=number,
        needed=_list_needed(lesson, formulas, place),
    )


def _compute_torques(
    lesson: Lesson, q: Sequence[float], dq: Sequence[float], ddq: Sequence[float]
) -> FloatArray:
    """Return the torques (n,) of a motion without friction, springs included, by the recursion in doubles."""
    robot = lesson.robot
    algebra = dynamics.FloatAlgebra(dict(robot.symbols))
    values: dict[str, float] = {}
    for number, angle in enumerate(dynamics.spread_coordinates(robot, algebra, q)[: robot.size], start=1):
        values |= {f"s{number}": math.sin(angle), f"c{number}": math.cos(angle), f"q{number}": angle}
    for joint, rate, acceleration in zip(robot.coordinates, dq, ddq, strict=True):
        values |= {f"dq{joint + 1}": rate, f"ddq{joint + 1}": acceleration}
    recursion = dynamics.build_recursion(robot, algebra, dynamics.build_state(robot, algebra, values))
    parameters = dict(zip(lesson.model.base.keys, lesson.beta, strict=True))
    loads = dynamics.compute_inverse_dynamics(recursion, parameters)
    return np.array(dynamics.fold_vector(robot, algebra, loads))


def _list_needed(lesson: Lesson, formulas: str, place: int) -> frozenset[str]:
    """Return the letters with values that formulas of the lesson come down to, and those of springs."""
    codes = {item.name: item.code for item in lesson.formulas}
    others = range(1, lesson.robot.freedom + 1)
    wanted = {name.format(place + 1, k) for name in formulas.split() for k in others}
    springs = {entry.name for entry in lesson.model.base.parameters if entry.label[1] in ("KS", "KR")}
    needed = {name for name in springs if f"beta_{name}" not in codes}
    while wanted:
        name = wanted.pop()
        if name in codes:
            wanted |= {*re.findall(r"\bv\.(\w+)", codes[name])} - needed
        elif name in lesson.values:
            needed.add(name)
    return frozenset(needed)


def show_plain(latex: str) -> str:
    """Return a letter in LaTeX as a sheet shows it, and as it may be typed."""
    return re.sub(r"(?<!\d)_", "", rewrite_formula(latex)).strip(" ()")


def list_values(lesson: Lesson, exercises: Sequence[Exercise]) -> list[tuple[str, str]]:
    """Return the letters whose values exercises need, in LaTeX, with these values, in SI units."""
    slides, needed = list_slides(lesson.robot), {name for one in exercises for name in one.needed}
    pairs = ((name, value) for name, value in lesson.values.items() if name in needed)
    return [(textbook.write_symbol(name, lesson.book, slides), f"{value:.6g}") for name, value in pairs]


def find_example(lesson: Lesson) -> str:
    """Return a short formula of the lesson as text, with a sine where one has; empty without any."""
    texts = [x.text for x in lesson.formulas if "*" in x.text and not x.name.startswith("J")]
    return min(
        texts, key=lambda text: (not re.search(r"\b[csCS]\d|\bcos|\bsin", text), len(text)), default=""
    )


# The sheet.

_SETTING = re.compile(r"--([a-z-]+) (\S+)")
_ANSWER = re.compile(r"(?:answer|Antwort)\s+(\d+)\s*[=:]\s*(.*)", re.IGNORECASE)
_PROMPT = re.compile(r"(\d+)\.\s+(.*)")
_SHARE, _IN_A_ROW = 0.01, 6
"""Of a torque, to which it is wanted; values in a line of the sheet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerSheet:
    """What a sheet holds: `settings` of its exercises, lines of values; by number `prompts` and `answers`."""

    settings: Mapping[str, str]
    values: tuple[str, ...]
    prompts: Mapping[int, str]
    answers: Mapping[int, str]


def write_sheet(lesson: Lesson, exercises: Sequence[Exercise], settings: Mapping[str, object]) -> str:
    """Return the sheet for students: every question, and a line for its answer."""
    words = load_words(lesson.language)
    drawn = " ".join(f"--{name} {value}" for name, value in settings.items() if value is not None)
    example = find_example(lesson)
    first = "# Exercises on {0}. Type each answer behind its =; it may go on in indented lines."
    lines = [words(first).format(lesson.robot.name)]
    if example:
        formulas = "# Formulas in the letters of the lesson, such as {0}, or {1}."
        lines.append(words(formulas).format(example, example.replace("*", " ")))
    lines.append(words("# Numbers may be formulas too."))
    if rows := _write_values(lesson, exercises):
        lines += [words("# Values in SI units, angles in rad:"), *(f"#   {row}" for row in rows)]
    lines += [
        words("# To mark: symid derive ROBOT --check FILE"),
        words("# Written with: {0}").format(drawn),
    ]
    for number, one in enumerate(exercises, start=1):
        lines += ["", f"{number}. {one.plain}", words("answer {0} =").format(number)]
    return "\n".join(lines) + "\n"


def _write_values(lesson: Lesson, exercises: Sequence[Exercise]) -> list[str]:
    mark, pairs = _MARKS[lesson.language], list_values(lesson, exercises)
    texts = [f"{show_plain(name)} = {write_decimals(x, lesson.language)}" for name, x in pairs]
    return [mark.join(texts[k : k + _IN_A_ROW]) for k in range(0, len(texts), _IN_A_ROW)]


def read_sheet(text: str, file: str) -> AnswerSheet:
    """Return what stands in a sheet; an InputError names all mistakes, such as a number with two answers."""
    settings, prompts, answers = dict[str, str](), dict[int, str](), dict[int, str]()
    notices, last, values = list[Notice](), 0, list[str]()
    for place, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#") and "--exercises" in line:
            settings = dict(_SETTING.findall(line))
        elif line.startswith("#   "):
            values.append(line.removeprefix("#").strip())
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
    return AnswerSheet(settings=settings, values=tuple(values), prompts=prompts, answers=answers)


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
    book = textbook.get_book(settings["notation"], angle=angle)
    lesson = build_lesson(robot, book, cast("Parameterisation | None", form), settings["lang"])
    rng = np.random.default_rng(int(settings["seed"]))
    count = min(int(settings["exercises"]), MOST_EXERCISES)
    drawn = draw_exercises(lesson, count, rng)
    asked = {number: one.plain for number, one in enumerate(drawn, start=1)}
    same = sheet.values in ((), tuple(_write_values(lesson, drawn)))
    if asked != dict(sheet.prompts) or not same:
        what = "questions" if same else "values"
        text = f"its {what} are not those of {robot.name} with these settings; give the robot that the "
        text += "sheet was written for, or write it again with this version"
        raise InputError(Notice(code="lesson.other-exercises", text=text, file=file))
    language = lang or settings["lang"]
    comparison, words, found = build_comparison(lesson), load_words(language), []
    for number, one in enumerate(drawn, start=1):
        typed, right, mark, note = sheet.answers.get(number, ""), False, "", ""
        # The unit that the answer shows behind it may be typed too.
        unit = r"\s*".join(one.note.split())
        given = re.sub(rf"\s*(?:{unit}|\({unit}\))\s*$", "", typed) if unit else typed
        try:
            if not typed:
                mark = "empty"
            elif one.number is not None:
                value = evaluate_number(read_answer(given, comparison.names), lesson.values)
                right = abs(value - one.number) <= _SHARE * max(_SHARE, abs(one.number))
                note = write_decimals(f"{value:.5g}", language)
                note += ", to one percent" if right else " is more than one percent off"
            else:
                right, note = comparison.compare(given, one.code)
                if not right and one.joint in list_joints(read_answer(given, comparison.names), robot.size):
                    note += f"; put in {one.given}"
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
    for item in lesson.formulas:
        left = rewrite_formula(item.latex.partition(" = ")[0]).strip() or item.name
        # C12 is a cosine where the book writes it so, elsewhere an element of the matrix.
        pairs += [(x, item.name) for x in (left, item.name) if x[:1] not in (book.sine, book.cosine)]
    found: dict[str, str] = {}
    for typed, name in (*pairs, *((typed.replace("_", ""), name) for typed, name in pairs)):
        found.setdefault(typed, name)
    return found


@dataclass(frozen=True, slots=True)
class Expression:
    """A node: a "number" or "letter" by its text, a function by its name, or an operation on its parts.

    The text of a letter is its name in code; `typed` is what was written.
    """

    kind: str
    text: str = ""
    parts: "tuple[Expression, ...]" = ()
    typed: str = ""


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
            return Expression("letter", self.names.get(first) or self.names.get(plain) or first, typed=first)
        _refuse(f'"{first}" was not expected')


def evaluate_number(node: Expression, values: Mapping[str, float]) -> float:
    """Return a formula as a number, letters from `values`; an InputError says why there is none."""
    if node.kind == "letter":
        if node.text in values:
            return values[node.text]
        if re.fullmatch(r"d{0,2}q\d+", node.text) or re.match(load_spelling()["wave"], node.text, re.ASCII):
            _refuse(f'put in the numbers of the question for "{node.typed}"')
        _refuse(f'"{node.typed}" has no value in this lesson')
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
                angle = read_wave(name, self.size)
                if not angle:
                    _refuse(f'"{node.typed}" is no letter of this lesson')
                return self._expand_wave(name[0].lower(), angle), one
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


def read_wave(name: str, size: int) -> list[tuple[int, int]]:
    """Return the joints of a sine or cosine such as c12, each with its sign; nothing of another letter.

    Of a robot of less than ten joints each digit is a joint, else c_10_11 has numbers; n is a minus.
    """
    match = re.match(load_spelling()["wave"], name, re.ASCII)
    joints = re.findall(r"(n?)(\d)" if size < _ONE_DIGIT else r"(n?)(\d+)", match[2] if match else "")
    return [(int(joint), -1 if sign else 1) for sign, joint in joints]


def list_joints(node: Expression, size: int) -> set[int]:
    """Return the numbers of the joints whose coordinates, sines or cosines a formula has."""
    found = set[int]()
    for letter in _list_letters(node):
        match = re.fullmatch(r"q(\d+)", letter.text)
        found |= {int(match[1])} if match else {joint for joint, _ in read_wave(letter.text, size)}
    return found


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
    """Where formulas are compared: exact points, and up to three joints a ring; `names` by what is typed.

    An answer has no letter of `closed`, the names that formulas of the lesson have for short, such as h1.
    """

    points: tuple[_Field, ...]
    ring: _Field | None
    names: Mapping[str, str]
    closed: frozenset[str]

    def compare(self, typed: str, answer: str) -> tuple[bool, str]:
        """Return whether a typed formula equals the answer, and how that was found.

        The answer may be JavaScript of the page; an InputError says that the typed formula cannot be read.
        """
        left, right = read_answer(typed, self.names), read_formula(_JAVASCRIPT.sub("", answer))
        for letter in _list_letters(left):
            if letter.text in self.closed:
                _refuse(f'write out what "{letter.typed}" stands for')
        for field in self.points:
            if not _is_equal(field, left, right):
                return False, "not equal to the answer"
        if self.ring is None:
            return True, f"equal at {len(self.points)} exact points"
        return _is_equal(self.ring, left, right), "equal as polynomials"


def _list_letters(node: Expression) -> Iterator[Expression]:
    if node.kind == "letter":
        yield node
    for part in node.parts:
        yield from _list_letters(part)


def _is_equal(field: _Field, left: Expression, right: Expression) -> bool:
    (a, b), (c, d) = field.evaluate(left), field.evaluate(right)
    return bool(field.algebra.mul(a, d) == field.algebra.mul(c, b))


def list_closed(lesson: Lesson) -> list[str]:
    """Return the names of formulas that others are not written in: elements of matrices, h1, energies."""
    own = {*map(str, lesson.model.algebra.ring.symbols)}
    return sorted({x.name for x in lesson.formulas if not x.name.startswith("beta_")} - own)


def build_comparison(lesson: Lesson) -> FormulaComparison:
    """Return what formulas typed for a lesson are compared in."""
    robot, model = lesson.robot, lesson.model
    formulas = {x.name: read_formula(_JAVASCRIPT.sub("", x.code)) for x in lesson.formulas}
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
    closed = frozenset(list_closed(lesson))
    return FormulaComparison(points=tuple(points), ring=whole, names=spellings, closed=closed)
