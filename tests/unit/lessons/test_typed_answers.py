"""Answers typed as a lesson shows them are right, with another sign or index wrong: on sheet and page."""

import json
import re
import shutil
import subprocess
from dataclasses import asdict
from functools import cache
from pathlib import Path

import pytest

import symid
from symid.environment import locate_resource_folder
from symid.errors import InputError
from symid.lessons import get_book
from symid.lessons.chapters import list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.exercises import (
    build_comparison,
    evaluate_number,
    list_closed,
    list_spellings,
    load_spelling,
    read_answer,
    rewrite_formula,
)
from symid.lessons.textbook import load_books, write_symbol
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot

LINKS = ("two_link", "two_link_symbols", "two_link_elastic", "ppr")
LONG = ("scara", "puma560", "panda", "quadruped")
# A slide with an offset beside it, lengths of the file with names of books, axes against each other.
RRP = """
name = "rrp"
convention = "standard"
gravity = [0, -9.81, 0]
[symbols]
a1 = 0.4
[[joint]]
kind = "revolute"
a = "a1"
[[joint]]
kind = "revolute"
alpha = "pi"
a = 0.3
[[joint]]
kind = "prismatic"
alpha = "pi/2"
d = 0.2
[[joint]]
kind = "revolute"
"""


@cache
def build(name, notation, language="en", **letters):
    robot = parse_robot(RRP) if name == "rrp" else load_robot(name)
    return build_lesson(robot, get_book(notation, **letters), language=language)


def list_formulas(lesson):
    items = list_items([item for chapter in lesson.chapters for item in chapter.items])
    return [item for item in items if item.name and item.code and item.sympy not in ("", "0")]


def show_unicode(latex):
    """Return a formula with the signs that a reader copies from the page."""
    text = latex.replace(r"\vartheta", "\N{GREEK THETA SYMBOL}").replace(
        r"\theta", "\N{GREEK SMALL LETTER THETA}"
    )
    text = re.sub(r"\\mathit\{(\w+)\}", r"\1", text).replace(r"\mathrm ", "")
    text = re.sub(r"\\d(d?)ot \{(.)\}", lambda m: m[2] + ("\u0308" if m[1] else "\u0307"), text)
    below = str.maketrans("0123456789", "".join(chr(0x2080 + k) for k in range(10)))
    text = re.sub(r"_\{(\d+)\}", lambda match: match[1].translate(below), text)
    return (
        text.replace("^{2}", "\N{SUPERSCRIPT TWO}")
        .replace("-", "\N{MINUS SIGN}")
        .replace(r" \, ", " \N{DOT OPERATOR} ")
    )


def list_wrong(text, letters):
    """Yield a formula with one sign changed, and with one index changed."""
    signs = [match.start() for match in re.finditer(r"(?<=[\w)] )[+-](?= )", text)]
    yield f"-({text})" if not signs else text[: signs[0]] + "-+"[text[signs[0]] == "-"] + text[signs[0] + 1 :]
    for match in re.finditer(r"\b([a-zA-Z]+?)(\d)\b", text):
        for other in "123456789":
            changed = match[1] + other
            if other != match[2] and changed in letters:
                yield text[: match.start()] + changed + text[match.end() :]
                return


def mark(lessons, texts=()):
    """Return what the script of the page finds for cases of lessons, and its trees of texts."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("wants node")
    script = locate_resource_folder("templates") / "lesson" / "formulas.js"
    call = [node, str(Path(__file__).with_name("formulas.mjs")), str(script)]
    given = json.dumps({"lessons": lessons, "texts": texts})
    done = subprocess.run(call, input=given, capture_output=True, text=True, check=True, timeout=300)
    return json.loads(done.stdout)


def describe(lesson):
    robot = lesson.robot
    turning = [k for k, joint in enumerate(robot.joints, start=1) if not joint.prismatic]
    reading = {**load_spelling(), "names": list_spellings(lesson), "joints": robot.size, "turning": turning}
    reading["closed"] = list_closed(lesson)
    formulas = [[item.name, item.code] for item in list_formulas(lesson)]
    letters = [*dict.fromkeys(reading["names"].values())]
    return {"reading": reading, "letters": letters, "formulas": formulas}


VARIANTS = [{"language": "de"}, {"angle": "theta"}, {"angle": "q", "long": True}]


@pytest.mark.parametrize("notation", load_books())
@pytest.mark.parametrize("name", [*LINKS, "rrp", *LONG])
def test_answers_typed_as_shown_are_right_and_near_ones_wrong(name, notation):
    described = []
    for letters in VARIANTS if name in (*LINKS, "rrp") else VARIANTS[:1]:
        lesson = build(name, notation, **letters)
        comparison, cases, count = build_comparison(lesson), [], 0
        known = {*comparison.names, *(f"{x}{k}" for k in range(1, lesson.robot.size + 1) for x in "sc")}
        step = 1 if name in LINKS else 5
        for item in list_formulas(lesson)[::step]:
            right = item.latex.rpartition(" = ")[2]
            for typed in (item.text, right, show_unicode(right), item.sympy):
                if len(typed) <= load_spelling()["longest"]:
                    assert comparison.compare(typed, item.code)[0], (item.name, typed)
                    cases.append((typed, item.code, True))
            for typed in list_wrong(item.text, known):
                if len(typed) <= load_spelling()["longest"]:
                    try:
                        equal, _ = comparison.compare(typed, item.code)
                    except InputError:
                        # The displacement of a prismatic joint has no sine.
                        continue
                    assert not equal, (item.name, typed)
                    cases.append((typed, item.code, False))
                    count += 1
        assert count
        described.append({**describe(lesson), "cases": cases})
    for found, lesson in zip(mark(described)["marks"], described, strict=True):
        assert found == [right for *_, right in lesson["cases"]]


@pytest.mark.parametrize("notation", load_books())
@pytest.mark.parametrize("name", [*LINKS, "rrp", *LONG])
def test_every_letter_that_is_shown_has_one_meaning(name, notation):
    lesson = build(name, notation)
    names, slides = (
        list_spellings(lesson),
        {k for k, x in enumerate(lesson.robot.joints, start=1) if x.prismatic},
    )
    letters = {
        *lesson.values,
        *(f"{dot}q{k}" for k in range(1, lesson.robot.size + 1) for dot in ("", "d", "dd")),
    }
    letters |= {str(x) for x in lesson.model.algebra.ring.symbols if not re.fullmatch(r"[sc]\d+", str(x))}
    shown = {letter: write_symbol(letter, lesson.book, frozenset(slides)) for letter in letters}
    assert len({*shown.values()}) == len(letters)
    for letter, latex in shown.items():
        for typed in (latex, latex.replace(r"\vartheta", r"\theta"), show_unicode(latex)):
            assert read_answer(typed, names).text == letter, typed


TEXTS = [
    "c_{12}^{2} + s_1 \\, s_{2}",
    r"\tfrac{1}{2} \, m_{2} \, (l_{\mathrm{c}2})^{2}",
    r"\tfrac12 m2 \cdot \cos^2(\theta_1 + \vartheta_2)",
    r"\frac{m_1 + m_2}{2 g}",
    r"\sqrt{2} \, \left(\dot{q}_1 - \dot q_{2}\right)",
    "\N{VULGAR FRACTION ONE HALF} m\N{SUBSCRIPT TWO} q\N{COMBINING DOT ABOVE}1\N{SUPERSCRIPT TWO}",
    "[m2 + {m1}] g",
    "3,85 m1",
    r"0{,}5 \, m_{1} + 12{,}25",
    "c_{1-2} + c_{10,-11} + c_{10,11}",
    r"\mathit{ZZ}_{1}^{\mathrm R} + ZZ_1^R + {}^{2}p^{(3)}_{x} + {}^{3}g_{x} + \overline{\mathit{XX}}_{3}",
    r"I_{2,zz} + \ell_{1x}",
    "cos theta1 + sin q_2 sqrt 2",
    "m2(", ")", "2 ^", "m2 # g", "1e100", "sin sin q1", "((((" * 20, "+" * 2000, "\\foo{x}", "$m_2$", "",
    "q1 -- q2", "2^-1", "(((1)))", "a b c", ".5 5. 5.5e-3", "x_1_2 x__",
]  # fmt: skip


def test_python_and_the_page_read_the_same_trees():
    """What one refuses the other refuses, with the same words."""
    names = list_spellings(build("two_link", "siciliano"))
    reading = {**load_spelling(), "names": names, "joints": 2, "turning": [1, 2], "closed": []}
    trees = mark([], [[text, reading] for text in TEXTS])["trees"]
    read = 0
    for text, tree in zip(TEXTS, trees, strict=True):
        if "error" in tree:
            with pytest.raises(symid.InputError, match=re.escape(tree["error"])):
                read_answer(text, names)
            continue
        assert json.loads(json.dumps(asdict(read_answer(text, names)))) == tree, text
        read += 1
    assert read > 18


@pytest.mark.parametrize(
    ("typed", "plain"),
    [
        (r"\vartheta_1", "theta_1"),
        ("\N{GREEK THETA SYMBOL}1", "theta1"),
        (r"\ddot {\theta}_{3}", "ddtheta_3"),
        (r"ZZ_{2}^{\mathrm R}", "ZZ2R"),
        (r"\mathit{ZZ}_{\mathrm R2}", "ZZ_R2"),
        ("3,5", "3.5"),
        ("-0{,}35", "-0.35"),
    ],
)
def test_signs_become_letters(typed, plain):
    assert rewrite_formula(typed).strip() == plain


@pytest.mark.parametrize("notation", ["siciliano", "craig"])
@pytest.mark.parametrize("name", ["two_link", "ppr", "scara", "panda", "emps", "rrp"])
def test_books_with_masses_have_them_for_every_robot(name, notation):
    """Base parameters in masses, centres and rotors have the values that generated functions get."""
    lesson = build(name, notation)
    items = [item for item in list_formulas(lesson) if item.name.startswith("beta_")]
    known = {item.name.removeprefix("beta_") for item in items}
    assert known == {entry.name for entry in lesson.model.base.parameters}
    for item in items:
        value = evaluate_number(read_answer(item.sympy), lesson.values)
        assert value == pytest.approx(lesson.values[item.name.removeprefix("beta_")], rel=1e-9, abs=1e-12)
        assert re.search(r"\b(m|I)\d", item.sympy) or item.sympy.startswith(("IA", "K")), item.sympy
    for item in list_formulas(build(name, "khalil")):
        assert not item.name.startswith("beta_")


def test_symbols_of_the_file_keep_their_letters():
    """Formulas of the lesson have other names and letters than symbols that are called h, T or V."""
    robot = load_robot("two_link_symbols")
    text = (locate_resource_folder("robots") / "two_link_symbols.toml").read_text(encoding="utf-8")
    for old, new in (("L1", "h"), ("lc1", "T"), ("lc2", "V")):
        text = re.sub(rf"\b{old}\b", new, text)
    lesson, plain = (build_lesson(one, get_book("symid")) for one in (parse_robot(text), robot))
    names = [item.name for item in lesson.formulas]
    assert len({*names}) == len(names)
    assert not {*names} & {*lesson.values}
    assert [item.latex for item in lesson.formulas if "c_{112}" in item.latex] == [
        r"b = c_{112} = -m_{2} \, V \, h \, s_{2}"
    ]
    comparison = build_comparison(lesson)
    pairs = [pair for pair in zip(lesson.formulas, plain.formulas, strict=True) if pair[1].text]
    assert len(pairs) > 10
    for mine, other in pairs:
        renamed = re.sub(r"\bL1\b", "h", other.text).replace("lc1", "T").replace("lc2", "V")
        assert comparison.compare(renamed, mine.code)[0]
