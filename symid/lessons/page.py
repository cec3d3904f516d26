"""A lesson as one HTML file, its numbers the reader's; as a document for pdflatex; as a notebook.

Robot -> chapters, the generated functions as JavaScript, geometry and values -> HTML. Formulas are set by
KaTeX, whose script and fonts (MIT, see templates/lesson/katex) stand in the page; MathML is beside them for
screen readers. Nothing is loaded from elsewhere, and the same input gives the same bytes.

The numbers come twice: from the formulas, and from the functions that code generation writes; the page shows
how far they differ.

A notebook has cells with live SymPy objects between the chapters: M, C and g are those of `robot.sympy`, to
differentiate and substitute; cells check what the text states, C against Christoffel symbols and the slope of
the potential as expressions up to three joints, beyond that against the recursion in numbers. It is executed
where nbclient and ipykernel are there; a cell that fails stops it.

Supported: all robots of the lesson. Not supported: readers without JavaScript, who see formulas as LaTeX; in
notebooks what only moves on the page.
"""

import base64
import json
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import compress, count
from pathlib import Path
from typing import Any

import numpy as np

from symid import __version__
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import choose_route, list_robot_specs, list_spring_parameters, write_javascript_function
from symid.dynamics import derive_base_parameters, get_label_unit
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice
from symid.lessons.chapters import (
    WRITTEN_OUT,
    Chapter,
    Item,
    Lesson,
    Words,
    fill_chapter,
    find_tip,
    list_slides,
    load_pairs,
    load_words,
    translate_chapter,
    write_marked,
)
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.exercises import (
    Exercise,
    draw_exercises,
    find_example,
    list_closed,
    list_spellings,
    list_values,
    load_spelling,
    write_sheet,
)
from symid.lessons.matrices import Parameterisation, find_standard_rows
from symid.lessons.textbook import Book, get_book, write_name, write_symbol
from symid.robot import Robot

_SCRIPTS = ("formulas", "lesson", "identification")
_FUNCTIONS = (
    *("mass_matrix", "coriolis_matrix", "gravity", "inverse_dynamics"),
    *("energy", "jacobian", "torque_regressor"),
)
_LETTERS = ("mass", "gravity", "kinetic", "potential", "torque", "coriolis", "coordinates", "angle")
_SPRING_FUNCTIONS = ("hysteresis_step", "hysteresis_inverse_step")
_TICK = '<span class="tick" aria-hidden="true">\N{CHECK MARK}</span>'
_LONG_CELL = 40
_MOST_KINDS = 8
_LEADS = (
    "Letters as in {0}.",
    "The file has no inertial values: numbers are those of stand-in links, rods of 3 kg and less.",
    "The formulas do not depend on them.",
    "Every formula was derived exactly from the robot file and checked by a second derivation.",
)
_POSTURE = "Numbers beside formulas are those at the posture of the sliders."
_LONGEST_LINE = 66
"""Letters of a formula in a line of a notebook, without its commands."""
_SECONDS = 600
_CELLS = "The cells between the chapters compute with the same objects in SymPy: change them."
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
    alone: bool = False,
    logged: LoggedMotion | None = None,
    language: str = "en",
    title: str = "",
    author: str = "",
) -> LessonPage:
    """Return the lesson on `robot` as a page, or as a document for pdflatex; `seed` draws its exercises.

    `title` is by default of the robot; `alone` leaves the derivation out; `logged` is offered among the
    motions whose information the page shows. A RobotError says that a symbolic length has no value.
    """
    lesson, words = build_lesson(robot, book, form, language), load_words(language)
    what = "{0}: exercises" if alone else "{0}: equation of motion"
    lesson = replace(lesson, title=title or words(what).format(robot.name), author=author)
    drawn = draw_exercises(lesson, exercises, np.random.default_rng(seed))
    write = _write_document if tex else _write_page
    text = write(lesson, drawn, logged, words, alone=alone)
    if not drawn:
        return LessonPage(text=text)
    answers = ""
    for number, one in enumerate(drawn, start=1):
        answers += f"{number}. {one.plain}\n   {f'{one.answer} {one.note}'.strip()}\n"
    letter, own = lesson.book.angle, get_book(lesson.book.name).angle
    angle = None if letter == own else letter.removeprefix("\\")
    settings = {"exercises": exercises, "seed": seed, "parameters": form, "notation": lesson.book.name}
    sheet = write_sheet(lesson, drawn, {**settings, "angle": angle, "lang": language})
    return LessonPage(text=text, answers=answers, sheet=sheet)


def _write_leads(lesson: Lesson, words: Words) -> str:
    """Return the sentences below the title: letters, links without values, what was checked."""
    given = (bool(lesson.book.title), lesson.stand_ins, lesson.stand_ins, True)
    return " ".join(words(text).format(lesson.book.title) for text in compress(_LEADS, given))


def _write_exercises(lesson: Lesson, drawn: Sequence[Exercise], page: str) -> Chapter:
    """Return the chapter on exercises; `page` is not empty for one where answers are typed."""
    # How letters with marks are typed, one of each kind: of composite bodies, gravity and momenta.
    robot, book = lesson.robot, lesson.book
    slides, kinds = list_slides(robot), dict[str, str]()
    for name in map(str, lesson.model.algebra.ring.symbols):
        shown = write_symbol(name, book, slides)
        if shown.startswith(("{}^", r"\overline", r"\ell", r"\dot", r"\ddot")):
            kind = re.sub(r"\d", "", name)
            kinds.setdefault(kind, f"${shown}$ `{write_name(name, book, slides)}`")
    letters = ", ".join([*kinds.values()][:_MOST_KINDS]) if page else ""
    example = find_example(lesson)
    chapter = fill_chapter(
        "exercises",
        book,
        page=page and not example,
        shown=page and example,
        short=example.replace("*", " "),
        letters=letters,
        # Braces keep an equation in one line.
        values=", ".join(f"${{{name} = {value}}}$" for name, value in list_values(lesson, drawn)),
    )
    return translate_chapter(chapter, lesson.language)


def _write_page(
    lesson: Lesson, drawn: Sequence[Exercise], logged: LoggedMotion | None, words: Words, *, alone: bool
) -> str:
    robot, book, chapters = lesson.robot, lesson.book, lesson.chapters
    if lesson.beta:
        taken = ", " if logged is None else f", or take the one of `{logged.name}`, "
        motion = fill_chapter("identification", book, taken=taken)
        chapters = (*chapters, translate_chapter(motion, lesson.language))
    if drawn:
        chapters = (*chapters, _write_exercises(lesson, drawn, "page"))
    folder = locate_resource_folder("templates") / "lesson"
    numbers = count(1)
    sections, contents = [], ""
    for place, chapter in enumerate(chapters[-1:] if alone else chapters, start=1):
        body = "\n".join(_write_item(item, numbers, words) for item in chapter.items)
        title = escape(chapter.title)
        heading = f'<h2><span class="count">{place}</span>{title}</h2>'
        sections.append(f'<section id="{chapter.anchor}">{heading}\n{body}\n</section>')
        contents += f'<li><a href="#{chapter.anchor}">{title}</a></li>'
    file = Path(robot.path).name or robot.name
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

    asked = []
    for one in drawn:
        texts = {"prompt": one.prompt, "answer": one.answer, "note": one.note}
        entries = [f'"{key}": {_write_json(text)}' for key, text in texts.items()]
        entries += [f'"formula": (v) => {one.code}'] if one.code else []
        entries += [] if one.number is None else [f'"number": {one.number!r}']
        entries += [f'"joint": {one.joint}, "given": {_write_json(one.given)}'] if one.joint else []
        asked.append(f"{{ {', '.join(entries)} }}")

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
        "TITLE": escape(lesson.title),
        "AUTHOR": f"<p>{escape(lesson.author)}</p>" if lesson.author else "",
        "DESCRIPTION": escape(robot.description),
        "LEAD": escape(" ".join([_write_leads(lesson, words), *([] if alone else [words(_POSTURE)])])),
        "FIRST": chapters[-1 if alone else 0].anchor,
        "CONTENTS": contents,
        "SECTIONS": "\n".join(sections),
        "FOOT": escape(
            words("Written by symid {0} from {1}. SI units throughout.").format(__version__, file)
        ),
        "STYLE": re.sub(r"@font-face\{[^}]*\}", put, style) + read("lesson.css"),
        "KATEX": read("katex/katex.min.js"),
        "FUNCTIONS": f"{functions}return {{ {', '.join(spec.name for spec in specs)} }};",
        "FORMULAS": ",\n".join(f"[{json.dumps(item.name)}, (v) => {item.code}]" for item in lesson.formulas),
        "EXERCISES": ",\n".join(asked),
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
    # Where the frames of standard rows are, in those of the joints.
    standard = find_standard_rows(robot) if book.standard else ()
    rows = [
        [[*(x.to_float(symbols) for x in row), y.to_float(symbols)] for row, y in zip(*places, strict=True)]
        for places in ((far.rotation, far.translation) for _, far in standard)
    ]
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
                "row": rows[index] if rows else None,
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
            "closed": list_closed(lesson),
            "joints": robot.size,
            "turning": [k for k, joint in enumerate(robot.joints, start=1) if not joint.prismatic],
        },
        "words": dict(load_pairs(lesson.language)),
        "springs": [
            {"name": card.name, "value": card.value or 0.0, "unit": card.unit}
            for card in list_spring_parameters(robot)
        ],
        "letters": {name: getattr(book, name) for name in _LETTERS},
        "stops": [len(joint.elasticity.stops) if joint.elasticity else 0 for joint in robot.axes],
        "cubic": [bool(joint.elasticity and joint.elasticity.cubic) for joint in robot.axes],
        "rotors": [joint.drive.rotor_inertia or 0.0 for joint in robot.axes],
    }


# LaTeX.

_TEX_MARKS = str.maketrans(
    {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {mark: rf"\{mark}" for mark in "&%#_{}$"}
    | {"\N{SUPERSCRIPT TWO}": "$^2$", "\N{MINUS SIGN}": "$-$", "\N{MULTIPLICATION SIGN}": r"$\times$"}
)
_TEX_LANGUAGES = {
    "en": "",
    # Umlauts as letters, hyphens where the system has those of the language; quotes are those of the text.
    "de": r"""\usepackage[T1]{fontenc}
\IfFileExists{lmodern.sty}{\usepackage{lmodern}}{}
\IfFileExists{ngerman.ldf}{\usepackage[ngerman,shorthands=off]{babel}}{}
""",
}


def _write_document(
    lesson: Lesson, drawn: Sequence[Exercise], _: LoggedMotion | None, words: Words, *, alone: bool
) -> str:
    """Return the lesson in LaTeX, with a question and room for what is written by hand for each exercise."""
    names = r"\\ ".join(filter(None, (_write_tex(lesson.author), f"symid {__version__}")))
    head = (locate_resource_folder("templates") / "lesson" / "head.tex").read_text(encoding="utf-8")
    head = head.replace("CHECKED", words("Checked")).replace("LANGUAGE", _TEX_LANGUAGES[lesson.language])
    parts = [head, rf"\title{{{_write_tex(lesson.title)}}}\author{{{names}}}"]
    parts += [r"\date{}\maketitle", *map(_write_tex, (lesson.robot.description, _write_leads(lesson, words)))]
    chapters = () if alone else lesson.chapters
    for chapter in (*chapters, *([_write_exercises(lesson, drawn, "")] if drawn else [])):
        parts.append(rf"\section{{{_write_tex(chapter.title)}}}")
        parts += map(_write_tex_item, chapter.items)
    if drawn:
        asked = "\n".join(rf"\item {_write_tex(one.prompt)}\vspace{{25mm}}" for one in drawn)
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


# Notebooks.


def write_lesson_notebook(
    robot: Robot,
    book: Book,
    form: Parameterisation | None,
    folder: Path,
    *,
    language: str = "en",
    title: str = "",
    author: str = "",
) -> tuple[str, bool]:
    """Return the lesson on `robot` as a notebook in JSON, and whether it was executed, in `folder`.

    A GenerationError says that a cell failed.
    """
    lesson, words = build_lesson(robot, book, form, language), load_words(language)
    text = (
        f"# {_mark_text(title) or words('{0}: equation of motion').format(_mark_text(robot.name))}\n\n"
        + f"{_mark_text(author)}\n\n" * bool(author)
        + f"{_mark_text(robot.description)}.\n\n{_write_leads(lesson, words)} {words(_CELLS)}\n\n"
        + words("Written by symid {0}. SI units throughout.").format(__version__)
    )
    kinds, numbers = [("markdown", text)], count(1)
    for number, chapter in enumerate(lesson.chapters, start=1):
        lines = [
            f"## {number} {chapter.title}",
            *(_mark_item(item, numbers, words) for item in chapter.items),
        ]
        kinds.append(("markdown", "\n\n".join(filter(None, lines))))
        kinds += [("code", cell) for cell in _list_code(lesson, chapter.anchor)]
    cells: list[dict[str, Any]] = []
    for k, (kind, text) in enumerate(kinds):
        cells.append({"cell_type": kind, "id": f"cell-{k}", "metadata": {}, "source": text})
        cells[-1] |= {"execution_count": None, "outputs": []} if kind == "code" else {}
    notebook: dict[str, Any] = {
        "nbformat": 4,
        "nbformat_minor": 5,
        "metadata": {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}},
        "cells": cells,
    }
    done = _execute(notebook, folder)
    text = json.dumps(done or notebook, indent=1, sort_keys=True, ensure_ascii=False)
    return f"{text}\n", done is not None


def _execute(notebook: dict[str, Any], folder: Path) -> dict[str, Any] | None:
    """Return the notebook with the outputs of its cells; None where no kernel is there."""
    try:
        import ipykernel  # noqa: F401  the kernel that nbclient starts
        import nbclient
        import nbformat
    except ImportError:
        return None
    made = nbformat.from_dict(notebook)  # type: ignore[no-untyped-call]
    # Times of execution would differ from run to run.
    client = nbclient.NotebookClient(
        made,
        timeout=_SECONDS,
        record_timing=False,
        resources={"metadata": {"path": str(folder)}},
        extra_arguments=["--IPKernelApp.log_level=50"],
    )
    try:
        client.execute()
    except nbclient.exceptions.CellExecutionError as error:
        text = f"a cell of the notebook failed: {error.ename}: {error.evalue}; please report this robot"
        raise GenerationError(Notice(code="lesson.cell", text=text)) from error
    found: dict[str, Any] = json.loads(nbformat.writes(made))  # type: ignore[no-untyped-call]
    return found


def _mark_text(text: str, bar: str = "|") -> str:
    """Return a text in Markdown, its $formulas$ and `code` as they are but for `bar` in place of |."""
    return write_marked(
        text,
        lambda plain: re.sub(r"([*_<>\[\]|])", r"\\\1", plain),
        lambda formula: f"${formula.replace('|', bar)}$",
        lambda code: f"`{code.replace('|', bar)}`",
    )


def _mark_item(item: Item, numbers: Iterator[int], words: Words) -> str:
    match item.kind:
        case "text":
            return _mark_text(item.text)
        case "check":
            return f"> \N{CHECK MARK} **{words('Checked')}**, {_mark_text(item.text)}."
        case "formula" | "matrix":
            return f"$$\n{_break_lines(item.latex)} \\tag{{{next(numbers)}}}\n$$"
        case "table":
            rows = [row[:3] if item.text == "base" else row for row in item.rows]
            marked = [[_mark_text(text, bar=r"\vert ") for text in row] for row in rows]
            head, *body = [f"| {' | '.join(row)} |" for row in marked]
            return "\n".join([head, "|" + "---|" * len(rows[0]), *body])
        case "details":
            inside = "\n\n".join(filter(None, (_mark_item(inner, numbers, words) for inner in item.items)))
            return f"<details><summary>{_mark_text(item.text)}</summary>\n\n{inside}\n\n</details>"
    return ""


def _break_lines(latex: str) -> str:
    """Return an equation whose right side is broken at the sums of its outermost level where it is long."""
    left, equals, right = latex.partition(" = ")
    parts, depth, start = [], 0, 0
    for k, letter in enumerate(right):
        depth += (letter in "{([") - (letter in "})]")
        if depth == 0 and letter in "+-" and right[k - 1 : k + 2] == f" {letter} ":
            parts.append(right[start:k].strip())
            start = k
    parts.append(right[start:].strip())
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]} {part}".strip()
        seen = re.sub(r"\\(?:mathit|mathrm|,|dot|overline)|[{}_^ ]|\\[a-z]+", "", joined)
        lines[-1:] = [lines[-1], part] if lines[-1] and len(seen) > _LONGEST_LINE else [joined]
    if not equals or len(lines) == 1 or r"\begin" in latex or r"\left" in latex:
        return latex
    body = r" \\ &\quad {} ".join(lines)
    return rf"\begin{{aligned}} {left} &= {body} \end{{aligned}}"


def _list_code(lesson: Lesson, anchor: str) -> Iterator[str]:
    """Yield the cells that follow a chapter."""
    folder, robot = locate_resource_folder("templates") / "lesson", lesson.robot
    cells = tomllib.loads((folder / "cells.toml").read_text(encoding="utf-8"))
    long = "" if robot.freedom <= WRITTEN_OUT else "long_"
    match anchor:
        case "frames":
            # A robot that comes with symid has a name, another one the path of its file.
            path = Path(robot.path)
            inside = path.parent.resolve() == locate_resource_folder("robots").resolve()
            name = repr(path.stem if inside else str(path.resolve()))
            yield cells["frames"].format(name)
        case "base":
            yield "robot.base"
        case "mass":
            yield cells[f"{long}mass"]
            if any(joint.form is not None for joint in robot.joints):
                yield cells["formulas"]
            q = [round(0.5 + 0.3 * (-1) ** k * (k + 1) / 2, 2) for k in range(robot.freedom)]
            note = "stand-ins: the file has no values" if lesson.stand_ins else "the values of the robot file"
            numbers = [repr(float(f"{value:.12g}")) for value in lesson.beta]
            lines = [", ".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
            beta = ", ".join(numbers) if len(lines) <= 1 else "\n" + "".join(f"    {x},\n" for x in lines)
            yield f"q = {q}  # a posture: change it\nbeta = [{beta}]  # {note}\n{cells['numbers']}"
        case "coriolis" | "gravity":
            yield cells[f"{long}{anchor}"]
        case "motion":
            yield from (cells["long_coriolis"], cells["long_motion"]) if long else (cells["motion"],)
