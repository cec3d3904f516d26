"""Answers to exercises: right in any form, wrong by however little, or unreadable with the reason."""

import re

import pytest
import sympy

import symid
from symid.cli.main import run
from symid.lessons import get_book
from symid.lessons.chapters import list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.exercises import build_comparison, evaluate_number, read_formula
from symid.robot import load_robot


def build(name):
    return build_lesson(load_robot(name), get_book("symid"))


@pytest.fixture(scope="module")
def arm():
    return build("two_link_symbols")


@pytest.fixture(scope="module")
def comparison(arm):
    return build_comparison(arm)


def list_formulas(lesson):
    items = list_items([item for chapter in lesson.chapters for item in chapter.items])
    return [item for item in items if item.name and item.code and item.sympy not in ("", "0")]


G1 = "m2*lc2*g*cos(q1 + q2) + g*cos(q1)*(m1*lc1 + m2*L1)"


@pytest.mark.parametrize(
    "typed",
    [
        G1,
        "m2 lc2 g c12 + g c1 (m1 lc1 + m2 L1)",
        "g (m1 lc1 + m2 L1) cos q1 + m2 lc2 g (c1 c2 - s1 s2)",
        "m2*lc2*g*(cos(q1)*cos(q2) \N{MINUS SIGN} sin(q1)*sin(q2)) + g*C1*(m1*lc1 + m2*L1)",
        "(s1**2 + c1^2)*(m2 lc2 g c12 + g c1 (m1 lc1 + m2 L1))",
        "m2 g (lc2 c12 + L1 c1) + 2 m1 g lc1 c1 / 2",
        "g/(1/(m2 lc2 c12 + c1 (m1 lc1 + m2 L1)))",
        "m2 lc2 g cos(q2 - -q1) + .5 g c1 (m1 lc1 + m2 L1) 2e0",
    ],
)
def test_any_form_of_the_right_formula_is_right(comparison, typed):
    assert comparison.compare(typed, G1) == (True, "equal as polynomials")


def test_a_wrong_formula_is_wrong_by_however_little(comparison):
    near = (f"{G1} + 1e-30*g", "m2 lc2 g c12", f"-({G1})", G1.replace("cos(q1)", "cos(q2)"))
    for typed in (*near, "0", "g", "1e-30", "1+" * 599 + "1"):
        assert comparison.compare(typed, G1) == (False, "not equal to the answer")


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("m2*(lc2", 'expected ")" at the end'),
        ("m2*(lc2 5)) + 1", '")" was not expected'),
        ("m2 +", "the formula is not finished"),
        ("m3 g", '"m3" is no letter of this lesson'),
        ("m2 # g", '"#" was not expected'),
        ("__import__('os')", '"_" was not expected'),
        ("m2/(c1^2 + s1^2 - 1)", "divides by zero"),
        ("(q1 - q1)^-1", "divides by zero"),
        ("sin(m2)", "sum of joint angles"),
        ("cos(0.3)", "sum of joint angles"),
        ("s3", "joint 3 has no angle"),
        ("9^9^9", "whole number up to 20"),
        ("m2^q1", "whole number up to 20"),
        ("1e999999999", "too large"),
        ("g1_ + 0", '"g1_" is what is asked for'),
        ("sin " * 290 + "q1", "argument of sin in brackets"),
        ("sqrt(m2)", "sqrt takes a number"),
        ("(" * 100 + "m2" + ")" * 100, "nested more than 60 deep"),
        ("m2 + " * 2000 + "m2", "longer than 1200"),
        ("\N{GREEK SMALL LETTER THETA} + 1", '"theta" is no letter'),
    ],
)
def test_what_cannot_be_read_says_why(comparison, typed, message):
    """The notice is lesson.formula."""
    with pytest.raises(symid.InputError, match=re.escape(message)):
        comparison.compare(typed, G1)


@pytest.mark.parametrize("name", ["two_link_symbols", "two_link", "ppr"])
def test_formulas_that_sympy_writes_otherwise_are_right(name):
    lesson = build(name)
    comparison = build_comparison(lesson)
    names = {*lesson.values, *(f"{head}q{k}" for k in range(1, 5) for head in ("", "d", "dd"))}
    known = {name: sympy.Symbol(name) for name in names}
    for item in list_formulas(lesson):
        value = sympy.sympify(item.sympy, locals=known)
        for other in (sympy.expand(value, trig=True), sympy.factor(value), value.rewrite(sympy.cos)):
            if not other.has(sympy.pi):
                assert comparison.compare(str(other), item.code)[0], (item.sympy, other)
        moved = sympy.expand(value.subs(known["q2"], known["q2"] + 2 * known["q1"]), trig=True)
        same = sympy.expand(sympy.expand(value, trig=True) - moved) == 0
        assert comparison.compare(str(moved), item.code)[0] == same


def test_long_robots_are_compared_at_exact_points_with_their_composites():
    lesson = build("puma560")
    comparison = build_comparison(lesson)
    assert comparison.ring is None
    for item in list_formulas(lesson)[::5]:
        assert comparison.compare(item.sympy, item.code) == (True, "equal at 3 exact points")
        assert not comparison.compare(f"{item.sympy} + q1/1000000", item.code)[0]


def test_numbers_are_formulas_too():
    values = {"m2": 2.0, "g": 9.81}
    assert evaluate_number(read_formula("m2 g cos(0.5)^2/sqrt(4)"), values) == pytest.approx(
        9.81 * float(sympy.cos(0.5)) ** 2
    )
    for text, message in (("1/0", "no finite value"), ("sqrt(-1)", "no finite"), ("m3", "has no value")):
        with pytest.raises(symid.InputError, match=message):
            evaluate_number(read_formula(text), values)


@pytest.fixture
def lesson(tmp_path):
    robot = symid.load("two_link_symbols")
    return robot, robot.write_lesson(tmp_path / "lesson.html", exercises=8, seed=3)


def fill(lesson, change=None, *, whole=False):
    """Type the answers of the file of answers into the sheet, `whole` with what stands behind them."""
    answers = re.findall(r"^   (.*)$", lesson.answers.read_text(encoding="utf-8"), re.MULTILINE)
    text = lesson.sheet.read_text(encoding="utf-8")
    for number, answer in enumerate(answers, start=1):
        short = answer if whole else answer.removesuffix(" N m")
        text = text.replace(f"answer {number} =", f"answer {number} = {(change or {}).get(number, short)}")
    path = lesson.sheet.with_name("ann.txt")
    path.write_text(text, encoding="utf-8")
    return path


def test_sheets_are_right_with_the_answers_which_are_never_written_over(lesson):
    robot, written = lesson
    for whole in (False, True):
        marked = robot.check_answers(fill(written, whole=whole))
        assert marked.accepted
        assert marked.to_dict()["right"] == 8
    # The notice is output.answers.
    written.sheet.write_text(fill(written).read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(symid.OutputError, match="answers that were typed"):
        robot.write_lesson(written.path, exercises=8, seed=3)


def test_marks_are_told_apart(lesson, capsys):
    """The notice is lesson.not-right."""
    robot, written = lesson
    known = "I1 + I2 + L1^2 m2 +\n   m1 lc1 lc1 + m2 lc2 lc2"
    wrong = {1: "m2 lc2 g c12", 2: "", 4: "3.85", 5: known, 6: "17", 8: "h(("}
    path = fill(written, wrong)
    marks = [entry.mark for entry in robot.check_answers(path).answers]
    assert marks == ["wrong", "empty", "right", "wrong", "right", "wrong", "right", "unreadable"]
    assert run(["derive", "two_link_symbols", "--check", str(path), "-q"]) == 1
    printed = capsys.readouterr()
    assert "3 of 8 right" in printed.out
    assert "the formula is not finished" in printed.out
    assert "5 of 8 answers are not right" in printed.err
    assert run(["derive", "two_link", "--check", "a.txt", "--seed", "3"]) == 2
    assert "--seed: the sheet says how it was drawn" in capsys.readouterr().err


def test_a_sheet_of_another_robot_or_without_settings_is_refused(lesson):
    """The notices are lesson.other-exercises, .no-sheet, .settings, lesson.twice, lesson.unreadable.

    In full: lesson.no-sheet, lesson.settings.
    """
    robot, written = lesson
    with pytest.raises(symid.InputError, match="not those of two_link with"):
        symid.load("two_link").check_answers(written.sheet)
    path, text = written.sheet.with_name("b.txt"), written.sheet.read_text(encoding="utf-8")
    for changed, message in (
        (b"answer 1 = 0\nanswer 1 = 1\n", "second time"),
        (b"answer 1 = 0\n", "no line"),
        (text.replace("exercises 8", "exercises many").encode(), "was changed"),
        (text.replace("notation symid", "notation none").encode(), "was changed"),
        (text.replace("lang en", "lang xx").encode(), "was changed"),
        (b"\xff\xfe\x00", "no text in UTF-8"),
    ):
        path.write_bytes(changed)
        with pytest.raises(symid.InputError, match=message):
            robot.check_answers(path)
