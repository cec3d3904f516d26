"""Lessons as pages: one file, no request, the same bytes, braces in balance, parts of every kind of robot."""

import html
import json
import re

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.lessons import get_book
from symid.lessons.chapters import build_values, list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import build_model
from symid.lessons.page import write_lesson as write_parts
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot


def write_lesson_page(*arguments, **options):
    return write_parts(*arguments, **options).text


def list_formulas(page):
    return [html.unescape(text) for text in re.findall(r'<span class="tex">(.*?)</span>', page)]


@pytest.fixture(scope="module")
def page():
    return write_lesson_page(load_robot("two_link_elastic"), get_book("symid"))


def test_a_page_is_one_file_in_balance_that_loads_nothing(page):
    assert len(page.encode()) < 2_000_000
    assert not re.findall(r"(?:src|href)\s*=\s*[\"']?(?:https?:)?//", page)
    assert "url(fonts" not in page
    assert page.count("url(data:font/woff2") == 11
    assert "@import" not in page
    assert not re.search(r"\{\{[A-Z]+\}\}", page)
    assert write_lesson_page(load_robot("two_link_elastic"), get_book("symid")) == page
    formulas = list_formulas(page)
    assert len(formulas) > 80
    for formula in formulas:
        bare = formula.replace(r"\{", "").replace(r"\}", "")
        assert bare.count("{") == bare.count("}"), formula


def test_an_elastic_robot_has_both_sides_springs_and_two_steps(page):
    titles = "|".join(re.findall(r'<span class="count">\d+</span>(.*?)</h2>', page))
    told = "Motor and link|Springs that remember|Energy of the springs, and their inverse|The two-step method"
    assert titles.endswith(f"{told}|What a motion identifies")
    for name in ("hysteresis_step", "mass_matrix"):
        assert f"function {name}(" in page


@pytest.mark.parametrize(
    ("book", "left", "angle"),
    [
        (get_book("symid"), "g", "c_{12}"),
        (get_book("craig"), "G", "c_{12}"),
        (get_book("khalil"), "Q", "C_{12}"),
        (get_book("symid", angle="theta", long=True), "g", r"\cos(\theta_{1} + \theta_{2})"),
    ],
)
def test_books_have_their_letters(book, left, angle):
    formulas = list_formulas(write_lesson_page(load_robot("two_link_symbols"), book))
    assert rf"{left}_{{2}} = m_{{2}} \, l_{{\mathrm{{c}}2}} \, g \, {angle}" in formulas


def test_masses_as_wanted():
    formulas = list_formulas(write_lesson_page(load_robot("two_link"), get_book("siciliano")))
    assert any(text.startswith("B_{22} = I_{2,zz} + m_{2}") for text in formulas)
    robot = load_robot("scara")
    _, beta, made = build_values(robot, build_model(robot, "base"))
    assert made
    assert len(beta) == 8
    assert "stand-in links" in write_lesson_page(robot, get_book("symid"))


def test_texts_of_the_file_are_escaped_in_pages_and_documents():
    robot = (
        'name = "a_b"\ndescription = "%s"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
        '[[joint]]\nname = "%s"\nkind = "revolute"\nalpha = "pi/2"\n'
    )
    text = write_lesson_page(parse_robot(robot % ("<script>x</script>", "{{STYLE}}")), get_book("symid"))
    assert "<script>x" not in text
    assert "{{STYLE}}" in text
    plain = write_lesson_page(load_robot("two_link"), get_book("symid"))
    assert text.count("KaTeX_Main") == plain.count("KaTeX_Main")
    text = write_lesson_page(parse_robot(robot % ("100 % & #1 {x}", "a^b")), get_book("symid"), tex=True)
    assert r"100 \% \& \#1 \{x\}" in text
    assert r"a\textasciicircum{}b" in text
    assert r"\title{a\_b: equation of motion}" in text
    assert text.endswith("\\end{document}\n")


def test_the_front_doors_write_pages(tmp_path, capsys):
    lesson = symid.load("two_link").write_lesson(tmp_path / "lesson.html", notation="khalil")
    assert (lesson.path.stat().st_size, lesson.to_dict()["notation"]) == (lesson.size, "khalil")
    with pytest.raises(symid.OutputError, match=r"\.html"):
        symid.load("two_link").write_lesson(tmp_path / "lesson.pdf")
    path = symid.load("two_link").derivation().html(tmp_path / "lesson.html")
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert run(["derive", "ppr", "--html", str(tmp_path / "ppr.html"), "-q"]) == 0
    assert "opens in any browser" in capsys.readouterr().out
    assert (tmp_path / "ppr.html").exists()


def test_options_of_a_page_need_a_page_and_one_file(capsys, tmp_path):
    """The notice is usage.lesson-option."""
    assert run(["derive", "two_link", "--notation", "craig"]) == 2
    assert "--notation: only for a page; add --html FILE" in capsys.readouterr().err
    # The notice is usage.lesson-files.
    assert run(["derive", "two_link", "--html", "a.html", "--tex", "a.tex"]) == 2
    assert "--html and --tex: one at a time" in capsys.readouterr().err
    for kind, log, code, told in (
        ("tex", "log.npz", 2, "usage.lesson-option"),
        ("html", "no.npz", 3, "no.npz"),
    ):
        target = str(tmp_path / f"a.{kind}")
        assert run(["derive", "two_link", f"--{kind}", target, "--log", log, "--json"]) == code
        assert told in json.loads(capsys.readouterr().out)["errors"][0].values()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["html", "tex", "ipynb"])
def test_title_and_author_stand_at_the_head(tmp_path, kind, monkeypatch):
    monkeypatch.setattr("symid.lessons.page._execute", lambda *_: None)
    target = tmp_path / f"a.{kind}"
    options = ["--title", "Lecture 2: arms & gears", "--author", "A. Lee <lee>", "-q"]
    assert run(["derive", "two_link", f"--{kind}", str(target), *options]) == 0
    text = html.unescape(target.read_text(encoding="utf-8").replace("\\", ""))
    assert text.count("Lecture 2: arms & gears") == (2 if kind == "html" else 1)
    assert text.index("Lecture 2") < text.index("A. Lee <lee>") < text.index("Vertical planar arm")
    plain = symid.load("two_link").write_lesson(target, title="", author="").path.read_text(encoding="utf-8")
    assert "A. Lee" not in plain
    assert run(["derive", "two_link", "--author", "A. Lee", "-q"]) == 2


def list_right_sides(robot):
    items = list_items(
        [x for chapter in build_lesson(robot, get_book("symid")).chapters for x in chapter.items]
    )
    return [text for item in items for text in (item.text, *sum(item.rows, ())) if text]


def test_exercises_have_answers_that_hold(tmp_path):
    robot = load_robot("two_link")
    first = write_parts(robot, get_book("symid"), exercises=8, seed=4)
    assert first == write_parts(robot, get_book("symid"), exercises=8, seed=4)
    assert first.answers != write_parts(robot, get_book("symid"), exercises=8, seed=5).answers
    prompts = [line for line in first.answers.splitlines() if line[0].isdigit()]
    assert len(prompts) == len(set(prompts)) == 8
    assert {line.split(". ")[1].split()[0] for line in prompts} == {"What", "With"}
    # What is asked for does not stand on the page.
    assert not set(re.findall(r"^   (.*)$", first.answers, re.MULTILINE)) & set(list_right_sides(robot))
    assert write_parts(robot, get_book("symid")).answers == ""
    robot = symid.load("two_link")
    answers = write_parts(robot.description, get_book("symid"), exercises=12, seed=1).answers
    library = robot.compile()
    found = re.findall(r"holds joint (\d) at rest at q = \((.*?)\)\?.*\n   (\S+) N m", answers)
    assert found
    for joint, posture, value in found:
        gravity = library.gravity([float(x) for x in posture.split(",")], library.beta)
        assert float(value) == pytest.approx(gravity[int(joint) - 1], rel=1e-4)
    lesson = symid.load("scara").write_lesson(tmp_path / "scara.html", exercises=4, seed=2)
    assert lesson.answers == tmp_path / "scara.answers.txt"
    assert len(lesson.answers.read_text(encoding="utf-8").splitlines()) == 8


def test_the_motion_of_a_log_stands_in_the_page(tmp_path):
    """Against the motion in closed form; the second joint rests, up to the noise of its encoder."""
    robot, time = symid.load("two_link"), np.arange(8001) / 1e3
    wave = 0.5 * np.sin(2.0 * np.pi * 0.4 * time)
    rest = 0.3 + 1e-5 * np.random.default_rng(1).normal(size=time.size)
    q = np.column_stack([wave, rest])
    log = symid.build_log(robot, time=time, q=q, tau=np.cos(q) + 0.1 * q)
    page = robot.write_lesson(tmp_path / "lesson.html", log=log).path.read_text(encoding="utf-8")
    found = json.loads(re.search(r'"log":(\{.*?\]\]\]\})', page)[1])
    samples = np.array(found["samples"])
    # A tenth of a second is cut off at both ends, as for an identification.
    assert samples.shape == (391, 3, 2)
    at, rate = 0.1 + np.arange(391) / 50.0, 2.0 * np.pi * 0.4
    turn = np.column_stack([np.sin(rate * at), rate * np.cos(rate * at), -(rate**2) * np.sin(rate * at)])
    assert samples[:, :, 0] == pytest.approx(0.5 * turn, abs=2e-3)
    assert samples[:, 0, 1] == pytest.approx(0.3, abs=1e-5)
    assert not samples[:, 1:, 1].any()
    assert '"log":null' in write_lesson_page(robot.description, get_book("symid"))


@pytest.mark.parametrize("name", ["quadruped", "puma560", "scara", "ur5"])
def test_rows_of_the_table_have_one_sign(name):
    """An angle or offset beside a coordinate is added or subtracted."""
    for notation in ("symid", "siciliano"):
        rows = build_lesson(load_robot(name), get_book(notation)).chapters[0].items
        cells = [text for item in rows for row in item.rows for text in row]
        assert len(cells) > 20
        assert not [text for text in cells if "+ -" in text or "- -" in text]
    assert any(" - " in text for text in cells) == (name == "quadruped")
