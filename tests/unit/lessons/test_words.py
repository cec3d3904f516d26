"""Lessons in German: every fixed sentence is in the table, and a sheet is marked in its language."""

import json
import re

import pytest

import symid
from symid.cli.main import run
from symid.environment import locate_resource_folder
from symid.lessons import get_book
from symid.lessons.chapters import list_items, load_pairs, load_words
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.page import write_lesson
from symid.robot import load_robot

ENGLISH = re.compile(
    r"\b(the|of|and|with|is|are|that|by|its|from|to|for|which|this|turns|link|joint|torque|as|only|answer)\b",
    re.IGNORECASE,
)
TITLES = re.compile(
    r"Robotics - Modelling, Planning and Control|Craig: [^(]*|Modeling, Identification and Control of Robots"
)


def list_texts(robot, book):
    lesson = build_lesson(robot, book, language="de")
    names = {joint.name for joint in robot.joints}
    for chapter in lesson.chapters:
        yield chapter.title
        for item in list_items(chapter.items):
            yield from (text for row in item.rows for text in row if text not in names)
            if item.kind in ("text", "hint", "check", "details"):
                yield item.text
            yield from re.findall(r"\\text\{([^{}]*)\}", item.latex)


ROBOTS = "two_link two_link_symbols two_link_elastic ppr scara rrp_twisted emps quadruped two_arms"


@pytest.mark.parametrize("name", ROBOTS.split())
def test_no_sentence_of_a_chapter_stays_in_english(name):
    for book in (get_book("symid"), get_book("siciliano")) if name != "quadruped" else (get_book("craig"),):
        for text in list_texts(load_robot(name), book):
            bare = re.sub(r"\$[^$]*\$|`[^`]*`|show:\S+", "", text)
            assert not ENGLISH.search(bare), text


def test_texts_of_the_script_are_in_the_table():
    folder = locate_resource_folder("templates") / "lesson"
    source = "".join((folder / f"{name}.js").read_text(encoding="utf-8") for name in ("formulas", "lesson"))
    source += (folder / "identification.js").read_text(encoding="utf-8")
    said = [
        "".join(pair) for pair in re.findall(r"""\b(?:tr|stop|translate)\((?:"([^"]*)"|'([^']*)')""", source)
    ]
    said += [text for text in re.findall(r'"([A-Za-z][^"\\]* [^"\\]*)"', source) if ENGLISH.search(text)]
    assert len(said) > 60
    words = load_words("de")
    for text in said:
        assert words(text) != text, text


@pytest.mark.parametrize("notation", ["siciliano", "khalil"])
def test_a_page_has_its_language(notation):
    robot = load_robot("ppr")
    page = write_lesson(robot, get_book(notation), exercises=8, seed=3, language="de")
    assert '<html lang="de">' in page.text
    body = page.text.split("<body>")[1].split("<script>")[0]
    shown = re.sub(r'<span class="tex">.*?</span>|<code>.*?</code>|<[^>]*>', " ", body)
    shown = TITLES.sub("", shown).replace(robot.description, "")
    assert not ENGLISH.search(shown), ENGLISH.search(shown)
    for text in (page.sheet, page.answers):
        assert not ENGLISH.search(re.sub(r"symid derive|--\S+", "", text)), text
    assert '<html lang="en">' in write_lesson(robot, get_book(notation)).text


def test_forms_hold_what_differs_and_lists_are_read_part_by_part():
    words = load_words("de")
    assert words("joint 3") == "Gelenk 3"
    reason = (
        "YY2, YY3: XX + YY does not change as the joint turns, only XX - YY does; M3: mass on the axis of a "
        "revolute joint moves with the link before"
    )
    assert not ENGLISH.search(words(reason)), words(reason)
    assert words("something else") == "something else"
    assert load_words("en")(reason) == reason
    for english, german in load_pairs("de").items():
        assert set(re.findall(r"\{\d\}", english)) == set(re.findall(r"\{\d\}", german)), english
        assert english.count("`") == german.count("`"), english


def test_a_german_sheet_is_marked(tmp_path, capsys):
    path = tmp_path / "lektion.html"
    options = ["--notation", "siciliano", "--exercises", "6", "--seed", "2", "--lang", "de", "-q"]
    assert run(["derive", "two_link", "--html", str(path), *options]) == 0
    sheet, answers = (path.with_suffix(f".{kind}.txt") for kind in ("exercises", "answers"))
    text = sheet.read_text(encoding="utf-8")
    given = re.findall(r"^   (.*)$", answers.read_text(encoding="utf-8"), re.MULTILINE)
    assert "--lang de" in text
    for number, answer in enumerate(given, start=1):
        assert "." not in answer
        short = answer.removesuffix(" N m").removesuffix(" J")
        text = text.replace(f"Antwort {number} =", f"Antwort {number} = {short}")
    sheet.write_text(text, encoding="utf-8")
    capsys.readouterr()
    assert run(["derive", "two_link", "--check", str(sheet)]) == 0
    told = capsys.readouterr().out
    assert "6 von 6 richtig" in told
    assert "als Polynome gleich" in told
    robot = symid.load("two_link")
    assert "equal as polynomials" in str(robot.check_answers(sheet, lang="en"))
    english = robot.write_lesson(tmp_path / "lesson.html", exercises=4, seed=2).sheet
    typed = english.read_text(encoding="utf-8").replace("answer 1 =", "answer 1 = a2 +")
    english.write_text(typed.replace("answer 2 =", "answer 2 = 0"), encoding="utf-8")
    assert run(["derive", "two_link", "--check", str(english), "--lang", "de", "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert [entry["mark"] for entry in answer["result"]["answers"]][:2] == ["unreadable", "wrong"]
    assert answer["result"]["answers"][0]["note"] == "die Formel ist nicht zu Ende"
    assert answer["errors"][0]["text"] == "2 von 4 Antworten sind nicht richtig; 2 von 4 nicht beantwortet"
    assert "nicht lesbar" in str(robot.check_answers(english, lang="de"))


def test_a_document_has_exercises_in_its_language(tmp_path):
    robot = symid.load("ppr")
    lesson = robot.write_lesson(tmp_path / "lektion.tex", exercises=4, seed=3, lang="de")
    text = lesson.path.read_text(encoding="utf-8")
    assert r"\section{Aufgaben}" in text
    assert text.count(r"\item ") == 4
    assert "Welche Kraft (N)" in text
    assert r"\textbf{Geprüft}, #1" in text
    assert lesson.sheet.read_text(encoding="utf-8").count("Antwort") == 5
    assert lesson.answers.exists()
    english = robot.write_lesson(tmp_path / "lesson.tex").path.read_text(encoding="utf-8")
    assert r"\begin{enumerate}" not in english
    with pytest.raises(symid.UsageError, match="part of a page"):
        robot.write_lesson(tmp_path / "lesson.ipynb", exercises=4)


def test_german_documents_have_german_letters_marks_and_numbers(tmp_path):
    """Formulas as the English ones but for their decimal marks; T1 and babel at the head; no drawing told."""
    robot = symid.load("rrp_twisted")
    given = {"notation": "siciliano", "exercises": 6, "seed": 3}
    german, english = (
        robot.write_lesson(tmp_path / f"{lang}.tex", lang=lang, **given) for lang in ("de", "en")
    )
    text, other = (lesson.path.read_text(encoding="utf-8") for lesson in (german, english))
    assert text.index("[T1]{fontenc}") < text.index("[ngerman,shorthands=off]{babel}")
    assert "babel" not in other
    shown, plain = (re.findall(r"\\(?:formula|wide)\{(.*)\}\n", page) for page in (text, other))
    assert len(shown) > 20
    assert [x.replace("{,}", ".").replace(r";\; ", ", ") for x in shown] == [
        re.sub(r"\\text\{[^{}]*\}", "", x) for x in plain
    ]
    for page, word in ((text, "Zeichnung"), (other, "draw")):
        assert word not in page.replace("drawn", "")
    # Where bodies are made up, document, sheet and page have the same values.
    assert "Ersatzgliedern" in text
    assert "stand-in links" in other
    (values,) = re.findall(r"Winkel in rad: (.*)\.\n", text)
    pairs = dict(re.findall(r"\$\{(\S+) = ([^$]*)\}\$", values))
    sheet = german.sheet.read_text(encoding="utf-8")
    listed = [x for line in re.findall(r"^#   (.*)$", sheet, re.MULTILINE) for x in line.split("; ")]
    assert [x.partition(" = ")[2] for x in listed] == [x.replace("{,}", ",") for x in pairs.values()]
    assert len(listed) == len(values.split("; ")) >= 3
    assert r"\theta" not in text.replace(r"\vartheta", "")


@pytest.mark.parametrize(
    ("language", "one", "more"), [("de", "Null ist ", "Null sind "), ("en", "This is zero: ", "These")]
)
def test_one_element_is_zero_and_many_are(language, one, more):
    numbers = set()
    for name in ("ppr", "scara"):
        lesson = build_lesson(load_robot(name), get_book("siciliano"), language=language)
        texts = [item.text for chapter in lesson.chapters for item in chapter.items if item.kind == "text"]
        for text in texts:
            if text.startswith((one, more)):
                assert text.startswith(one if text.count("$") == 2 else more)
                numbers.add(text.count("$") == 2)
    assert numbers == {True, False}


def test_values_of_letters_stand_in_the_lesson():
    """Those of the file, with the decimal mark of the language."""
    for language, mark in (("en", "."), ("de", ",")):
        lesson = build_lesson(load_robot("two_link_symbols"), get_book("symid"), language=language)
        rows = dict(row for item in lesson.chapters[0].items for row in item.rows if len(row) == 2)
        assert rows["$g$"] == f"9{mark}81"
        assert rows["$L_{1}$"] == f"0{mark}5"
        assert len(rows) == 1 + len(lesson.robot.symbols)
