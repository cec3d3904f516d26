"""Answers to exercises: right in any form, wrong by however little, or unreadable with the reason."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import sympy

import symid
from symid.cli.main import run
from symid.lessons import get_book
from symid.lessons.chapters import list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.exercises import (
    build_comparison,
    draw_exercises,
    evaluate_number,
    list_joints,
    list_spellings,
    read_formula,
    write_sheet,
)
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
        ("g1_ + 0", 'write out what "g1_" stands for'),
        ("h s1", 'write out what "h" stands for'),
        ("M_11 g", 'write out what "M_11" stands for'),
        ("V", 'write out what "V" stands for'),
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
        short = answer if whole else re.sub(r"(?<=\d) (N m|N|J)$", "", answer)
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
    asked = re.findall(r"^\d+\. (.*)$", written.sheet.read_text("utf-8"), re.MULTILINE)
    assert "g1 at q2 = 180" in asked[0]
    assert "c112 at q2 = 90" in asked[2]
    known = "g c1 (L1\N{SUPERSCRIPT TWO} m2/L1 +\n   m1 lc1 - lc2 m2)"
    wrong = {1: known, 2: "", 3: "h + m2", 4: "2.0446", 5: "m2 lc2 g c12", 6: "4.8 (Nm)", 7: "", 8: "h(("}
    path = fill(written, wrong)
    entries = robot.check_answers(path).answers
    marks = ["right", "empty", "unreadable", "wrong", "wrong", "right", "empty", "unreadable"]
    assert [entry.mark for entry in entries] == marks
    assert [entries[k].note for k in (2, 3, 4, 5)] == [
        'write out what "h" stands for',
        "2.0446 is more than one percent off",
        "not equal to the answer; put in q2 = 180\N{DEGREE SIGN}",
        "4.8, to one percent",
    ]
    assert run(["derive", "two_link_symbols", "--check", str(path), "-q"]) == 1
    printed = capsys.readouterr()
    assert "2 of 8 right" in printed.out
    assert "g c1 (L1\N{SUPERSCRIPT TWO} m2/L1 + m1 lc1 - lc2 m2)" in printed.out
    assert "not answered" in printed.out
    assert "the formula is not finished" in printed.out
    assert "4 of 8 answers are not right; 2 of 8 not answered" in printed.err
    for answer, note in (("4 g cos(q2)", '"q2"'), ("m2 g lc2 c12", '"c12"')):
        (entry,) = [x for x in robot.check_answers(fill(written, {2: answer})).answers if x.mark != "right"]
        assert (entry.mark, entry.note) == ("unreadable", f"put in the numbers of the question for {note}")
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
        (text.replace("g = 9.81", "g = 9.8").encode(), "its values are not those of two_link_symbols"),
        (b"\xff\xfe\x00", "no text in UTF-8"),
    ):
        path.write_bytes(changed)
        with pytest.raises(symid.InputError, match=message):
            robot.check_answers(path)


def test_messages_name_what_was_typed():
    """In the notation of Siciliano the third joint of the arm is d3, and 2 q1 has two joints."""
    comparison = build_comparison(build_lesson(load_robot("ppr"), get_book("siciliano")))
    with pytest.raises(symid.InputError, match='numbers of the question for "d1"'):
        evaluate_number(read_formula("3 d1", comparison.names), {})
    with pytest.raises(symid.InputError, match='"q1x" is no letter'):
        comparison.compare("q1x", "m2")
    with pytest.raises(symid.InputError, match='what "B11" stands for'):
        comparison.compare("B11", "m2")
    tree = read_formula("c12 + sin(2 q3) + m4")
    assert list_joints(tree, 4) == {1, 2, 3}


@pytest.mark.parametrize(
    "name", ["two_link_symbols", "two_link", "ppr", "two_link_elastic", "emps", "puma560"]
)
def test_numbers_follow_from_the_values_of_the_sheet_alone(name):
    """The formulas of the lesson, with the values on the sheet, give the number that the recursion gave."""
    robot = load_robot(name)
    lesson = build_lesson(robot, get_book("symid"))
    items = list_items([item for chapter in lesson.chapters for item in chapter.items])
    codes = {item.name: item.code for item in items if item.name and item.code}
    drawn = draw_exercises(lesson, 10, np.random.default_rng(5))
    sheet = write_sheet(lesson, drawn, {"exercises": 10})
    spelled = list_spellings(lesson)
    values = {
        spelled[name]: float(value)
        for line in re.findall(r"^#   (.*)$", sheet, re.MULTILINE)
        for name, value in (pair.split(" = ") for pair in line.split(", "))
    }
    size, kinds = robot.size, set()
    for one in drawn:
        if one.number is None:
            continue
        point = {
            "Math": math,
            **dict.fromkeys((f"{x}q{k + 1}" for k in range(size) for x in ("d", "dd")), 0.0),
        }
        for rate, numbers in re.findall(r"(d{0,2})q = \((.*?)\)", one.plain):
            point |= {f"{rate}q{k}": float(x) for k, x in enumerate(numbers.split(", "), start=1)}

        def take(name, point=point):
            if name in codes and name not in values and name not in point:
                return compute(codes[name], point)
            return {**values, **point}[name]

        def compute(code, point):
            text = re.sub(r"v\.(\w+)", lambda match: f"take({match[1]!r})", code)
            return eval(text.replace("Math", "math"), {"take": take, "math": math})  # noqa: S307  our own

        kind, _, place = one.about.partition(" ")
        i, others = int(place or 0) + 1, range(1, size + 1)
        if kind == "energy":
            found = take("T_")
        else:
            found = take(f"g{i}_")
            found += sum(
                take(f"M{min(i, k)}_{max(i, k)}") * point[f"ddq{k}"] for k in others if kind == "start"
            )
            found += sum(take(f"C{i}_{k}") * point[f"dq{k}"] for k in others if kind == "speed")
        assert found == pytest.approx(one.number, rel=1e-4, abs=1e-5), one.plain
        kinds.add(kind)
    assert kinds == (
        {"rest"}
        if name == "puma560"
        else {"start", "energy"}
        if name == "emps"
        else {"rest", "start", "speed", "energy"}
    )


@pytest.mark.parametrize("name", ["two_link_symbols", "two_link", "rrp_twisted"])
def test_exercises_ask_for_different_things(name):
    drawn = draw_exercises(build(name), 8, np.random.default_rng(1))
    assert len({one.about for one in drawn}) == 8
    assert [one.number is None for one in drawn].count(True) == 4
    kinds = [re.sub(r"[\d_]+", "", one.about) for one in drawn if one.number is None]
    assert len({*kinds}) >= 3


def test_files_that_exist_stay_without_force(tmp_path, capsys):
    """The notices are output.exists and, of typed answers, output.answers."""
    page, sheet = tmp_path / "a.html", tmp_path / "a.exercises.txt"

    def derive(*options):
        return run(["derive", "two_link", *map(str, options), "-q"])

    assert derive("--html", page, "--exercises", 3, "--seed", 1) == 0
    kept = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert derive("--html", page) == 3
    assert "a.html: exists already; give another name, or --force" in capsys.readouterr().err
    # The document of the same name has the same sheet, or is refused.
    assert derive("--tex", tmp_path / "a.tex", "--exercises", 3, "--seed", 2) == 3
    assert "a.exercises.txt: exists already, with other exercises" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == kept
    assert derive("--tex", tmp_path / "a.tex", "--exercises", 3, "--seed", 1) == 0
    assert sheet.read_bytes() == kept[sheet]
    assert derive("--tex", tmp_path / "a.tex", "--exercises", 3, "--seed", 2, "--force") == 0
    assert "--seed 2" in sheet.read_text("utf-8")
    robot = symid.load("two_link")
    with pytest.raises(symid.OutputError, match="other exercises"):
        robot.write_lesson(page, exercises=3, seed=1)
    assert robot.write_lesson(page, exercises=3, seed=1, force=True).sheet == sheet
    sheet.write_text(sheet.read_text("utf-8").replace("answer 1 =", "answer 1 = 2"), encoding="utf-8")
    assert derive("--html", page, "--exercises", 3, "--force") == 3
    assert "answers that were typed" in capsys.readouterr().err
    assert derive("--html", page, "--log", page, "--force") == 3
    assert "is an input of this call" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["html", "tex"])
def test_exercises_alone(tmp_path, kind, capsys):
    target = tmp_path / f"a.{kind}"
    given = ["derive", "two_link", f"--{kind}", str(target), "-q"]
    assert run([*given, "--only-exercises"]) == 2
    assert "say how many exercises" in capsys.readouterr().err
    assert run([*given, "--only-exercises", "--exercises", "4"]) == 0
    text = target.read_text("utf-8")
    heads = re.findall(r"<h2>.*?</h2>|\\section\{.*?\}", text)
    assert len(heads) == 1
    assert "Exercises" in heads[0]
    assert "two_link: exercises" in text.replace("\\", "")
    whole = symid.load("two_link").write_lesson(tmp_path / "b.html", exercises=4)
    assert whole.sheet.read_bytes() == (tmp_path / "a.exercises.txt").read_bytes()


def test_postures_are_within_the_limits():
    """Those of a joint that never comes near its zero too."""
    robot = load_robot("two_link")
    first = replace(robot.joints[0], limits=replace(robot.joints[0].limits, position=(1.7, 2.9)))
    second = replace(robot.joints[1], limits=replace(robot.joints[1].limits, position=(-2.9, -0.5)))
    lesson = build_lesson(replace(robot, joints=(first, second)), get_book("symid"))
    drawn = draw_exercises(lesson, 12, np.random.default_rng(2))
    postures = [re.search(r" q = \((.*?), (.*?)\)", one.plain) for one in drawn if one.number is not None]
    assert len(postures) >= 5
    for q1, q2 in ((float(x) for x in found.groups()) for found in postures):
        assert 1.7 <= q1 <= 2.9
        assert -2.9 <= q2 <= -0.5
