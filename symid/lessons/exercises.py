"""Exercises on a lesson, drawn from the robot, and the sheet that students fill in.

Lesson, seed -> `Exercise`s: gaps in formulas, groups to name, torques at rest, parameters without effect;
`Exercise`s -> a sheet in plain text, and back; answers typed behind "=" -> `MarkedAnswer`s.

    answer 1 = m2*l1*lc2*cos(q2)

The sheet says with which settings it was drawn, so that it is marked without further options.

Supported: all robots of the lesson. Not supported: sheets whose questions were changed.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from symid import dynamics
from symid.errors import InputError, Notice
from symid.lessons.answers import build_comparison, evaluate_number, read_answer
from symid.lessons.chapters import Lesson, list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import Parameterisation
from symid.lessons.textbook import BOOK_NAMES, get_book, write_code, write_sum, write_symbol
from symid.notation import INERTIAL
from symid.robot import Robot

MOST_EXERCISES = 50
"""On one page."""
_LONGEST_ANSWER = 140
_OTHERS = 3
_SMALL_TORQUE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Exercise:
    """A question: its answer as text, and as JavaScript `code`, a `number`, or one of `options`."""

    prompt: str
    answer: str
    code: str = ""
    number: float | None = None
    options: tuple[tuple[str, bool], ...] = ()


def draw_exercises(lesson: Lesson, count: int, rng: np.random.Generator) -> tuple[Exercise, ...]:
    """Return exercises on a lesson: formulas, groups, torques at rest, parameters without effect."""
    makers = (_ask_formula, _ask_group, _ask_torque, _ask_effect)
    found: dict[str, Exercise] = {}
    for k in range(50 * count):
        one = makers[k % len(makers)](lesson, rng)
        if one is not None:
            found.setdefault(one.prompt, one)
        if len(found) == count:
            break
    return tuple(found.values())


def _ask_formula(lesson: Lesson, rng: np.random.Generator) -> Exercise | None:
    items = [item for chapter in lesson.chapters for item in list_items(chapter.items)]
    known = [x for x in items if x.code and x.name[:1] in set("Mgh") and 4 < len(x.sympy) <= _LONGEST_ANSWER]
    if not known:
        return None
    item = known[int(rng.integers(len(known)))]
    left, _, right = item.latex.partition(" = ")
    return Exercise(prompt=f"What is ${left}$?", answer=f"${right}$, as text {item.sympy}", code=item.code)


def _ask_group(lesson: Lesson, rng: np.random.Generator) -> Exercise | None:
    robot, base = lesson.model.robot, lesson.model.base
    groups = [entry for entry in base.parameters if len(entry.terms) > 1]
    if not groups:
        return None
    entry = groups[int(rng.integers(len(groups)))]
    symbol = write_symbol(entry.name, lesson.book)
    ring, terms = lesson.model.algebra.ring, []
    for label, factor in entry.terms:
        share = write_sum(ring.from_expr(factor), lesson.model.sums)
        terms.append((dynamics.write_label(robot, label), write_code(share, "v"), write_code(share)))
    code = " + ".join(f"({share})*v.{name}" for name, share, _ in terms)
    text = " + ".join(name if share == "1" else f"({share})*{name}" for name, _, share in terms)
    prompt = f"Which standard parameters does ${symbol}$ stand for? Write the sum, as XX8 + a9*MX9."
    return Exercise(prompt=prompt, answer=f"{text}: {entry.reason}", code=code)


def _ask_torque(lesson: Lesson, rng: np.random.Generator) -> Exercise | None:
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
    posture = ", ".join(f"{x:g}" for x in q)
    unit = "N" if robot.axes[joint].prismatic else "N m"
    prompt = (
        f"With the values of this page, which torque ({unit}) holds joint {robot.coordinates[joint] + 1} "
        f"at rest at q = ({posture})? To one percent."
    )
    return Exercise(prompt=prompt, answer=f"{torques[joint]:.5g} {unit}", number=torques[joint])


def _ask_effect(lesson: Lesson, rng: np.random.Generator) -> Exercise | None:
    robot, base = lesson.model.robot, lesson.model.base
    gone = [entry for entry in base.eliminated if entry.reason.startswith("no effect")]
    kept = [entry for entry in base.parameters if entry.label[1] in INERTIAL]
    if not gone or len(kept) < _OTHERS:
        return None
    lost = gone[int(rng.integers(len(gone)))]
    others = [kept[int(k)] for k in rng.choice(len(kept), _OTHERS, replace=False)]
    labels = [lost.label, *(entry.label for entry in others)]
    names = [(dynamics.write_label(robot, label), label == lost.label) for label in labels]
    options = tuple((f"${write_symbol(name, lesson.book)}$", right) for name, right in sorted(names))
    prompt = "Which of these parameters can no motion of this robot show"
    prompt += f", and why? ({', '.join(name for name, _ in sorted(names))})"
    return Exercise(prompt=prompt, answer=f"{lost.name}: {lost.reason}", options=options)


# The sheet.

_SETTINGS = "# drawn with: "
_ANSWER = re.compile(r"answer\s+(\d+)\s*[=:]\s*(.*)")
_PROMPT = re.compile(r"(\d+)\.\s+(.*)")
_SHARE = 0.01
"""Of a torque, to which it is wanted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerSheet:
    """What a sheet holds: `settings` of its exercises; by number the `prompts` and typed `answers`."""

    settings: Mapping[str, str]
    prompts: Mapping[int, str]
    answers: Mapping[int, str]


def write_sheet(robot: str, exercises: Sequence[Exercise], settings: Mapping[str, object]) -> str:
    """Return the sheet for students: every question, and a line for its answer."""
    drawn = ", ".join(f"{name} {value}" for name, value in settings.items() if value is not None)
    lines = [
        f"# Exercises on {robot}. Type each answer behind its =; it may go on in indented lines.",
        "# Formulas as m2*lc2*g*cos(q1 + q2), or shorter m2 lc2 g c12; numbers as formulas too; or a name.",
        "# To mark: symid derive ROBOT --check FILE",
        f"{_SETTINGS}{drawn}",
    ]
    for number, one in enumerate(exercises, start=1):
        lines += ["", f"{number}. {one.prompt}", f"answer {number} ="]
    return "\n".join(lines) + "\n"


def read_sheet(text: str, file: str) -> AnswerSheet:
    """Return what stands in a sheet.

    Raises:
        InputError: it does not say how it was drawn, or a number has two answers; all mistakes at once.
    """
    settings, prompts, answers = dict[str, str](), dict[int, str](), dict[int, str]()
    notices, last = list[Notice](), 0
    for place, line in enumerate(text.splitlines(), start=1):
        if line.startswith(_SETTINGS):
            pairs = (part.split(maxsplit=1) for part in line.removeprefix(_SETTINGS).split(","))
            settings = {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2}
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
        what = f'no line "{_SETTINGS.strip()}" with the settings of the exercises; take the sheet that '
        what += "symid derive ROBOT --html FILE --exercises N wrote"
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


def mark_sheet(robot: Robot, sheet: AnswerSheet, file: str) -> tuple[MarkedAnswer, ...]:
    """Return the marks of a sheet that was written for `robot`; its exercises are drawn again.

    Raises:
        InputError: its settings cannot be read, or its questions are others.
    """
    settings = {"notation": "symid", "seed": "0", **sheet.settings}
    form = settings.get("parameters")
    known = form in (None, "base", "symbols", "bodies") and settings["notation"] in BOOK_NAMES
    if not (known and settings["seed"].isdigit() and settings.get("exercises", "").isdigit()):
        text = f'the line "{_SETTINGS.strip()}" was changed: it has exercises, seed, notation and parameters'
        raise InputError(Notice(code="lesson.settings", text=text, file=file))
    lesson = build_lesson(robot, get_book(settings["notation"]), cast("Parameterisation | None", form))
    rng = np.random.default_rng(int(settings["seed"]))
    drawn = draw_exercises(lesson, min(int(settings["exercises"]), MOST_EXERCISES), rng)
    asked = {number: one.prompt for number, one in enumerate(drawn, start=1)}
    if asked != dict(sheet.prompts):
        text = f"its questions are not those of {robot.name} with these settings; give the robot that the "
        text += "sheet was written for, or write it again with this version"
        raise InputError(Notice(code="lesson.other-exercises", text=text, file=file))
    comparison = build_comparison(lesson)
    found = []
    for number, one in enumerate(drawn, start=1):
        typed, right, mark, note = sheet.answers.get(number, ""), False, "", ""
        try:
            if not typed:
                mark = "empty"
            elif one.options:
                name = one.answer.partition(":")[0]
                right = re.sub(r"[\s_{}$]", "", typed) == re.sub(r"[\s_]", "", name)
            elif one.number is not None:
                value = evaluate_number(read_answer(typed), lesson.values)
                right = abs(value - one.number) <= _SHARE * max(_SHARE, abs(one.number))
                note = f"{value:.5g}, to one percent"
            else:
                right, note = comparison.compare(typed, one.code)
        except InputError as error:
            mark, note = "unreadable", str(error)
        mark = mark or ("right" if right else "wrong")
        found.append(MarkedAnswer(number=number, prompt=one.prompt, typed=typed, mark=mark, note=note))
    return tuple(found)
