"""A lesson as a notebook: the chapters as text and formulas, between them cells with live SymPy objects.

Robot, book -> chapters -> cells -> nbformat 4 in JSON, executed where nbclient and ipykernel are there.

M, C and g are those of `robot.sympy`, so that a reader differentiates, substitutes and compares; cells
check what the text states: C against Christoffel symbols and the potential's slope as expressions up to three
joints, beyond that against the recursion in numbers. A cell that fails stops the notebook.

Supported: all robots of the lesson. Not supported: what only moves on the page.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from symid import __version__
from symid.environment import locate_resource_folder
from symid.errors import GenerationError, Notice
from symid.lessons.chapters import WRITTEN_OUT, Item, Lesson, write_marked
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import Parameterisation
from symid.lessons.textbook import Book
from symid.lessons.words import Words, load_words
from symid.robot import Robot

_LONGEST_LINE = 66
"""Letters of a formula in a line, without its commands."""
_SECONDS = 600
_LEAD = "Every formula was derived exactly from the robot file and checked by a second derivation."
_CELLS = "The cells between the chapters compute with the same objects in SymPy: change them."


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
    made = (
        "The file has no inertial values: numbers are those of stand-in links of 3 kg and less.",
        "The formulas do not depend on them.",
    )
    letters = f" {words('Letters as in {0}.').format(book.title)}" if book.title else ""
    text = (
        f"# {_write_text(title) or words('{0}: equation of motion').format(_write_text(robot.name))}\n\n"
        + f"{_write_text(author)}\n\n" * bool(author)
        + f"{_write_text(robot.description)}.\n\n{words(_LEAD)}{letters} {words(_CELLS)}\n\n"
        + (f"**{words(made[0])}** {words(made[1])}\n\n" if lesson.stand_ins else "")
        + words("Written by symid {0}. SI units throughout.").format(__version__)
    )
    kinds, place = [("markdown", text)], 1
    for number, chapter in enumerate(lesson.chapters, start=1):
        # Formulas are numbered from `place`, through all chapters.
        lines = [f"## {number} {chapter.title}"]
        for item in chapter.items:
            text, place = _write_item(item, place, words)
            lines.append(text)
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


# Text.


def _write_text(text: str, bar: str = "|") -> str:
    """Return a text in Markdown, its $formulas$ and `code` as they are but for `bar` in place of |."""
    return write_marked(
        text,
        lambda plain: re.sub(r"([*_<>\[\]|])", r"\\\1", plain),
        lambda formula: f"${formula.replace('|', bar)}$",
        lambda code: f"`{code.replace('|', bar)}`",
    )


def _write_item(item: Item, place: int, words: Words) -> tuple[str, int]:
    match item.kind:
        case "text":
            return _write_text(item.text), place
        case "check":
            return f"> \N{CHECK MARK} **{words('Checked')}**, {_write_text(item.text)}.", place
        case "formula" | "matrix":
            return f"$$\n{_break_lines(item.latex)} \\tag{{{place}}}\n$$", place + 1
        case "table":
            rows = [row[:3] if item.text == "base" else row for row in item.rows]
            marked = [[_write_text(text, bar=r"\vert ") for text in row] for row in rows]
            head, *body = [f"| {' | '.join(row)} |" for row in marked]
            return "\n".join([head, "|" + "---|" * len(rows[0]), *body]), place
        case "details":
            parts = []
            for inner in item.items:
                text, place = _write_item(inner, place, words)
                parts.append(text)
            inside = "\n\n".join(filter(None, parts))
            return f"<details><summary>{_write_text(item.text)}</summary>\n\n{inside}\n\n</details>", place
    return "", place


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


# Cells.


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
