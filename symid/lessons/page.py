"""A lesson as one HTML file, its formulas typeset as it opens, its numbers the reader's; or in LaTeX.

Robot -> chapters, the generated functions as JavaScript, geometry and values -> HTML. Formulas are set by
KaTeX, whose script and fonts (MIT, see templates/lesson/katex) stand in the page; MathML is beside them for
screen readers. Nothing is loaded from elsewhere, and the same input gives the same bytes.

The numbers come twice: from the formulas, and from the functions that code generation writes; the page shows
how far they differ.

Supported: all robots of the lesson. Not supported: readers without JavaScript, who see formulas as LaTeX.
"""

import base64
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np

from symid import __version__
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import choose_route, list_robot_specs, list_spring_parameters, write_javascript_function
from symid.dynamics import derive_base_parameters, get_label_unit
from symid.environment import locate_resource_folder
from symid.lessons.chapters import (
    Chapter,
    Item,
    Lesson,
    find_tip,
    list_items,
    list_slides,
    say,
    show,
    translate_chapter,
    write_marked,
)
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.exercises import Exercise, draw_exercises, list_spellings, load_spelling, write_sheet
from symid.lessons.matrices import Parameterisation
from symid.lessons.textbook import Book, get_book, write_name, write_symbol
from symid.lessons.words import Words, load_pairs, load_words
from symid.robot import Robot

_SCRIPTS = ("formulas", "lesson", "identification")
_FUNCTIONS = (
    *("mass_matrix", "coriolis_matrix", "gravity", "inverse_dynamics"),
    *("energy", "jacobian", "torque_regressor"),
)
_MATRICES = ("mass", "gravity", "kinetic", "potential", "torque", "coriolis")
_SPRING_FUNCTIONS = ("hysteresis_step", "hysteresis_inverse_step")
_TICK = '<span class="tick" aria-hidden="true">\N{CHECK MARK}</span>'
_LONG_CELL = 40
_MOST_KINDS = 8
_STAND_INS = (
    "The file has no inertial values: the numbers on this page are those of stand-in links, rods of 3 kg and "
    "less."
)
_NOT_THE_FORMULAS = "The formulas do not depend on them."
_LEAD = (
    "Every formula was derived exactly from the robot file and checked by a second derivation. Numbers "
    "beside formulas are those at the posture of the sliders."
)
_HOW_TO_TYPE = (
    "Type formulas as the page shows them, as `m2*lc2*g*cos(q1 + q2)`, or shorter, as `m2 lc2 g c12`; LaTeX "
    "and the copied SymPy text are read too. They are compared with the answer at random points."
)


MOTION_RATE = 50.0
"""Hz, of the samples that the page's script takes of a motion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedMotion(FrozenArrays):
    """The motion of a log: `states` (3, N, n), q, dq, ddq of all coordinates at `MOTION_RATE`, SI units."""

    name: str
    states: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LessonPage:
    """A lesson in HTML or LaTeX; its exercises to fill in, `sheet`, and their answers, empty without any."""

    text: str
    answers: str = ""
    sheet: str = ""


def write_lesson(
    robot: Robot,
    book: Book,
    form: Parameterisation | None = None,
    *,
    tex: bool = False,
    exercises: int = 0,
    seed: int = 0,
    logged: LoggedMotion | None = None,
    language: str = "en",
    title: str = "",
    author: str = "",
) -> LessonPage:
    """Return the lesson on `robot` as a page, or as a document for pdflatex; `seed` draws its exercises.

    `title` is by default of the robot; `logged` is offered among the motions whose information the page
    shows. A RobotError says that a symbolic length has no value.
    """
    lesson, words = build_lesson(robot, book, form, language), load_words(language)
    lesson = replace(lesson, title=title, author=author)
    drawn = draw_exercises(lesson, exercises, np.random.default_rng(seed), words)
    text = _write_document(lesson, drawn, words) if tex else _write_page(lesson, drawn, logged, words)
    if not drawn:
        return LessonPage(text=text)
    answers = ""
    for number, one in enumerate(drawn, start=1):
        answers += f"{number}. {one.plain}\n   {f'{one.answer} {one.note}'.strip()}\n"
    letter, own = lesson.book.angle, get_book(lesson.book.name).angle
    angle = None if letter == own else letter.removeprefix("\\")
    settings = {"exercises": exercises, "seed": seed, "parameters": form, "notation": lesson.book.name}
    sheet = write_sheet(robot.name, drawn, {**settings, "angle": angle, "lang": language}, words)
    return LessonPage(text=text, answers=answers, sheet=sheet)


def _write_page(lesson: Lesson, drawn: Sequence[Exercise], logged: LoggedMotion | None, words: Words) -> str:
    robot, book, chapters = lesson.robot, lesson.book, lesson.chapters
    if lesson.beta:
        chapters = (*chapters, translate_chapter(_write_identification(lesson, logged), words))
    if drawn:
        asked = (say(_HOW_TO_TYPE), *_list_marked_letters(lesson), Item("widget", "exercises"))
        chapters = (*chapters, translate_chapter(Chapter("Exercises", "exercises", asked), words))
    folder = locate_resource_folder("templates") / "lesson"
    numbers = iter(range(1, 100_000))
    sections, contents = [], ""
    for place, chapter in enumerate(chapters, start=1):
        body = "\n".join(_write_item(item, numbers, words) for item in chapter.items)
        title = escape(chapter.title)
        heading = f'<h2><span class="count">{place}</span>{title}</h2>'
        sections.append(f'<section id="{chapter.anchor}">{heading}\n{body}\n</section>')
        contents += f'<li><a href="#{chapter.anchor}">{title}</a></li>'
    file = Path(robot.path).name or robot.name
    # Formulas with values as JavaScript, each after those that it needs.
    items = [item for chapter in chapters for item in list_items(chapter.items) if item.name and item.code]
    lead = f"{escape(words('Letters as in {0}.').format(book.title))} " if book.title else ""
    if lesson.stand_ins:
        lead += f"<strong>{escape(words(_STAND_INS))}</strong> {escape(words(_NOT_THE_FORMULAS))} "
    lead += escape(words(_LEAD))
    # The motion of the log: q, dq, ddq of each sample, to 1e-6 of the SI unit.
    log = None
    if logged is not None:
        log = {"name": logged.name, "samples": (np.round(logged.states, 6).transpose(1, 0, 2) + 0.0).tolist()}
    # Generated functions in JavaScript, those of the rigid robot and of its springs.
    base = derive_base_parameters(robot)
    names: tuple[str, ...] = _FUNCTIONS
    if any(joint.elasticity for joint in robot.joints):
        known = {spec.name for spec in list_robot_specs(robot, base)}
        names += tuple(name for name in _SPRING_FUNCTIONS if name in known)
    specs = list_robot_specs(robot, base, names)
    programs = (choose_route(robot, base, spec).program for spec in specs)
    functions = "".join(write_javascript_function(program, exported=False) for program in programs)

    def read(name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    # KaTeX's style with the fonts at hand inside.
    style = read("katex/katex.min.css")

    def put(match: re.Match[str]) -> str:
        found = re.search(r"url\(fonts/([\w-]+\.woff2)\)", match[0])
        file = folder / "katex" / "fonts" / (found[1] if found else "")
        if not file.is_file():
            return ""
        data = base64.b64encode(file.read_bytes()).decode("ascii")
        return re.sub(r"src:[^}]*", f'src:url(data:font/woff2;base64,{data}) format("woff2")', match[0])

    parts = {
        "LANG": lesson.language,
        "TITLE": escape(lesson.title or words("{0}: equation of motion").format(robot.name)),
        "NAME": escape(lesson.title or robot.name.replace("_", " ")),
        "AUTHOR": f"<p>{escape(lesson.author)}</p>" if lesson.author else "",
        "DESCRIPTION": escape(robot.description),
        "LEAD": lead,
        "CONTENTS": contents,
        "SECTIONS": "\n".join(sections),
        "FOOT": escape(
            words("Written by symid {0} from {1}. SI units throughout.").format(__version__, file)
        ),
        "STYLE": re.sub(r"@font-face\{[^}]*\}", put, style) + read("lesson.css"),
        "KATEX": read("katex/katex.min.js"),
        "FUNCTIONS": f"{functions}return {{ {', '.join(spec.name for spec in specs)} }};",
        "FORMULAS": ",\n".join(f"[{json.dumps(item.name)}, (v) => {item.code}]" for item in items),
        "EXERCISES": ",\n".join(map(_write_exercise, drawn)),
        "DATA": _write_json({**_describe(lesson), "log": log}),
        "SCRIPT": "".join(read(f"{name}.js") for name in _SCRIPTS),
    }
    template = re.sub(r"\{\{=(.*?)\}\}", lambda match: escape(words(match[1])), read("lesson.html"))
    # One pass: what is put in may hold such marks itself.
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda match: parts[match[1]], template)


def _write_json(value: object) -> str:
    """Return JSON that may stand in a script."""
    return json.dumps(value, separators=(",", ":"), sort_keys=True).replace("<", "\\u003c")


# HTML of the chapters.


def _write_inline(text: str) -> str:
    return write_marked(
        text,
        escape,
        lambda formula: f'<span class="tex">{escape(formula)}</span>',
        lambda code: f"<code>{escape(code)}</code>",
    )


def _write_item(item: Item, numbers: Iterator[int], words: Words) -> str:
    match item.kind:
        case "text" | "hint":
            return f"<p>{_write_inline(item.text)}</p>"
        case "check":
            checked = f"<strong>{words('Checked')}</strong>, {_write_inline(item.text)}."
            return f'<p class="check">{_TICK} {checked}</p>'
        case "formula" | "matrix":
            number = next(numbers)
            wide = " wide" if item.kind == "matrix" else ""
            value = ""
            if item.name and item.code != "0":
                unit = f' data-unit="{escape(item.unit)}"' if item.unit else ""
                value = f'<span class="value" data-name="{escape(item.name)}"{unit}></span>'
            sympy = f' data-sympy="{escape(item.sympy)}"' if item.sympy else ""
            formula = f'<span class="tex">{escape(item.latex)}</span>'
            return (
                f'<div class="formula{wide}"{sympy}><div class="set">{formula}</div>'
                f'{value}<span class="number">({number})</span></div>'
            )
        case "table":
            head, *rows = item.rows
            kind = ' class="base"' if item.text == "base" else ""

            def cell(text: str) -> str:
                if text.startswith("show:"):
                    _, joint, name = text.split(":")
                    data = f'data-joint="{joint}" data-kind="{name}"'
                    return f'<td><button type="button" class="show" {data}>{words("show")}</button></td>'
                return f"<td>{_write_inline(text)}</td>"

            titles = "".join(f'<th scope="col">{_write_inline(text)}</th>' for text in head)
            lines = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
            table = f"<table{kind}><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
            return (
                f'<div class="scroll" tabindex="0" role="region" aria-label="{words("Table")}">{table}</div>'
            )
        case "details":
            inner = "\n".join(_write_item(part, numbers, words) for part in item.items)
            opened = " open" if item.name == "open" else ""
            return f"<details{opened}><summary>{_write_inline(item.text)}</summary>\n{inner}\n</details>"
        case "widget":
            return f'<div class="widget" data-widget="{item.text}"></div>'
    return ""


# What the page computes with.


def _describe(lesson: Lesson) -> dict[str, object]:
    robot, book = lesson.robot, lesson.book
    symbols, slides = dict(robot.symbols), list_slides(robot)
    return {
        "robot": robot.name,
        "joints": [
            {
                "name": joint.name,
                "parent": joint.parent,
                "prismatic": joint.prismatic,
                "rotation": [[x.to_float(symbols) for x in row] for row in joint.placement.rotation],
                "origin": [x.to_float(symbols) for x in joint.placement.translation],
                "limits": joint.limits.position,
                "master": joint.mimic.master if joint.mimic else index,
                "multiplier": float(joint.mimic.multiplier) if joint.mimic else 1.0,
                "tip": list(find_tip(robot, index)),
                "latex": write_symbol(f"q{index + 1}", book, slides),
            }
            for index, joint in enumerate(robot.joints)
        ],
        "coordinates": list(robot.coordinates),
        "gravity": [value.to_float(symbols) for value in robot.gravity],
        "values": dict(lesson.values),
        "beta": list(lesson.beta),
        "parameters": [
            {
                "latex": write_symbol(entry.name, book, slides),
                "unit": get_label_unit(robot, entry.label).replace("^2", "\N{SUPERSCRIPT TWO}"),
                # That of a drive of several joints is no link.
                "link": entry.label[0] if entry.label[0] < robot.size else -1,
            }
            for entry in lesson.model.base.parameters
        ],
        "reading": {
            **load_spelling(),
            "names": list_spellings(lesson),
            "joints": robot.size,
            "turning": [k for k, joint in enumerate(robot.joints, start=1) if not joint.prismatic],
        },
        "words": dict(load_pairs(lesson.language)),
        "springs": [
            {"name": card.name, "value": card.value or 0.0, "unit": card.unit}
            for card in list_spring_parameters(robot)
        ],
        "letters": {name: getattr(book, name) for name in _MATRICES},
        "stops": [len(joint.elasticity.stops) if joint.elasticity else 0 for joint in robot.axes],
        "cubic": [bool(joint.elasticity and joint.elasticity.cubic) for joint in robot.axes],
        "rotors": [joint.drive.rotor_inertia or 0.0 for joint in robot.axes],
    }


def _write_identification(lesson: Lesson, logged: LoggedMotion | None) -> Chapter:
    """Return the chapter in which a reader moves the robot and sees what the torques identify."""
    tau, q = lesson.book.torque, lesson.book.coordinates
    taken = ", " if logged is None else f", or take the one of `{logged.name}`, "
    items = (
        say(
            rf"Torques are linear in the base parameters: ${tau} = Y({q}, \dot {q}, \ddot {q})\,\beta$. "
            r"With independent noise of standard deviation $\sigma_j$ in each sample of the torque of joint "
            r"$j$, the estimate of least squares has the covariance"
        ),
        show(
            r"\operatorname{cov}\hat\beta = \Bigl(\sum_k Y_k^{\mathsf T}\, W\, Y_k\Bigr)^{-1}, \qquad "
            r"W = \operatorname{diag}(\sigma_1^{-2}, \ldots, \sigma_n^{-2})."
        ),
        say(
            "The sum grows with every sample: the longer and the richer the motion, the smaller the "
            "deviations. What a motion does not move, or moves in one way only, is not identifiable, and "
            f"the sum has no inverse. Design a motion{taken}and play it; $Y$ is that of generated code, at "
            "50 samples a second; friction is known."
        ),
        Item("widget", "identification"),
    )
    return Chapter("What a motion identifies", "identification", items)


def _list_marked_letters(lesson: Lesson) -> Iterator[Item]:
    """Yield how letters with marks are typed, one of each kind: of composite bodies, gravity and momenta."""
    slides, kinds = list_slides(lesson.robot), dict[str, str]()
    for name in map(str, lesson.model.algebra.ring.symbols):
        shown = write_symbol(name, lesson.book, slides)
        if shown.startswith(("{}^", r"\overline", r"\ell", r"\dot", r"\ddot")):
            typed = write_name(name, lesson.book, slides)
            kinds.setdefault(re.sub(r"\d", "", name), f"${shown}$ `{typed}`")
    if kinds:
        listed = ", ".join([*kinds.values()][:_MOST_KINDS])
        yield say(f"Letters with marks: {listed}.")


def _write_exercise(one: Exercise) -> str:
    texts = {"prompt": one.prompt, "answer": one.answer, "note": one.note}
    parts = [f'"{key}": {_write_json(text)}' for key, text in texts.items()]
    if one.code:
        parts.append(f'"formula": (v) => {one.code}')
    if one.number is not None:
        parts.append(f'"number": {one.number!r}')
    return f"{{ {', '.join(parts)} }}"


# LaTeX.

_TEX_MARKS = str.maketrans(
    {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {mark: rf"\{mark}" for mark in "&%#_{}$"}
    | {"\N{SUPERSCRIPT TWO}": "$^2$", "\N{MINUS SIGN}": "-"}
)


def _write_document(lesson: Lesson, drawn: Sequence[Exercise], words: Words) -> str:
    """Return the lesson in LaTeX, with a question and room for what is written by hand for each exercise."""
    title = _write_tex(lesson.title or words("{0}: equation of motion").format(lesson.robot.name))
    names = r"\\ ".join(filter(None, (_write_tex(lesson.author), f"symid {__version__}")))
    head = (locate_resource_folder("templates") / "lesson" / "head.tex").read_text(encoding="utf-8")
    parts = [head.replace("CHECKED", words("Checked")), rf"\title{{{title}}}\author{{{names}}}"]
    parts += [r"\date{}\maketitle", _write_tex(lesson.robot.description)]
    for chapter in lesson.chapters:
        parts.append(rf"\section{{{_write_tex(chapter.title)}}}")
        parts += map(_write_tex_item, chapter.items)
    if drawn:
        asked = "\n".join(rf"\item {_write_tex(one.prompt)}\vspace{{25mm}}" for one in drawn)
        parts.append(rf"\section{{{words('Exercises')}}}")
        parts.append(r"\begin{enumerate}" + f"\n{asked}\n" + r"\end{enumerate}")
    return "\n\n".join([*filter(None, parts), r"\end{document}"]) + "\n"


def _write_tex(text: str) -> str:
    form, code = "${}$".format, lambda code: rf"\texttt{{{code.translate(_TEX_MARKS)}}}"
    return write_marked(text, lambda plain: plain.translate(_TEX_MARKS), form, code)


def _write_tex_item(item: Item) -> str:
    match item.kind:
        case "text":
            return _write_tex(item.text)
        case "check":
            return rf"\checked{{{_write_tex(item.text)}}}"
        case "formula":
            return rf"\formula{{{item.latex}}}"
        case "matrix":
            return rf"\wide{{{item.latex}}}"
        case "details":
            inner = "\n\n".join(filter(None, map(_write_tex_item, item.items)))
            return rf"\subsection*{{{_write_tex(item.text)}}}" + f"\n{inner}"
        case "table":
            # Table; the columns of one that gives reasons have widths of their own.
            rows = [row[:3] if item.text == "base" else row for row in item.rows]
            wide = {2: "p{.35\\linewidth}p{.58\\linewidth}", 3: "lp{.34\\linewidth}p{.46\\linewidth}"}
            given = any(len(text) > _LONG_CELL for row in rows for text in row)
            columns = wide.get(len(rows[0]), "l" * len(rows[0])) if given else "l" * len(rows[0])
            lines = [" & ".join(map(_write_tex, row)) + r" \\" for row in rows]
            body = "\n".join([rf"{lines[0]} \hline\endhead", *lines[1:]])
            return rf"\begin{{longtable}}{{{columns}}}" + f"\n{body}\n" + r"\end{longtable}"
    return ""
