"""The field's words in messages, templates and pages: what is not written, and the word in its place."""

import ast
import re

import pytest

from tests.pages import DOCS

PROJECT = DOCS.parent
WORDS = {
    r"left unexplained|unexplained (by|in)\b": "residual",
    r"\b(torque|momentum|energy|power|filtered) rows\b": "equations",
    r"\b(slow|fast|faster|measured|neighbouring) rows\b": "samples",
    r"\d rows (slower|of the log|were left out)|\bone row in\b": "samples",
    r"\bstands? still\b": "is at standstill, rests",
    r"\bfriction (that )?wanders\b": "drifts",
    r"\bfits are worth\b": "validation",
    r"\bnot told\b|\bcannot be told\b|\btold (apart|from)\b|\bcannot tell\b": "not identifiable, separated",
    r"\bforetell?s?\b|\bforetold\b": "predict, predicted",
    r"\bheld out in turn\b": "cross-validation",
    r"\bbodies that exist\b": "physically consistent bodies",
    r"\bfitted along\b": "fitted jointly",
    r"\btaken off\b": "subtracted, removed",
    r"\b(surely|surest)\b": "significantly, most significant",
    r"\banother size\b": "differ in scale",
    r"\bon the mean of the joints\b": "mean over joints",
    r"\bno motion shows\b": "not identifiable from these motions",
    r"\bmissed beyond chance\b": "differ significantly",
    r"\bpassed over\b": "skipped",
    r"\bhang on\b": "depend on, be fixed to",
    r"\baccusations?\b|\baccused\b": "false alarm, warned of",
    r": undone,|\bundoing\b": "corrected",
    r"\bsay the same\b|\bcannot be said\b": "agree, inconclusive",
}
"""What is not written, as a pattern, and what is."""
ALLOWED = ("fitted along", "slow rows")
"""Strings that stored files have, and no reader sees."""


def list_strings(path):
    """Return the strings of a module with their lines: docstrings are read by maintainers alone."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.lineno, node.value


def find_dialect(text):
    """Return what a text says in other words than the field does, and the word to use."""
    flat = re.sub(r"\s+", " ", text)
    return [
        f"{found.group()!r}: write {word}"
        for pattern, word in WORDS.items()
        if (found := re.search(pattern, flat))
    ]


def test_messages_use_the_words_of_the_field():
    found = [
        f"{path.relative_to(PROJECT)}:{line}: {text}"
        for path in sorted((PROJECT / "symid").rglob("*.py"))
        for line, said in list_strings(path)
        if said not in ALLOWED
        for text in find_dialect(said)
    ]
    assert found == []


@pytest.mark.parametrize("folder", ["docs", "templates", "README.md"])
def test_pages_and_templates_use_the_words_of_the_field(folder):
    place, kinds = PROJECT / folder, {".md", ".jinja", ".js", ".html"}
    paths = [place] if place.is_file() else [path for path in place.rglob("*") if path.suffix in kinds]
    found = [
        f"{path.relative_to(PROJECT)}:{number}: {text}"
        for path in sorted(paths)
        if "katex" not in path.name and "_build" not in path.parts
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        for text in find_dialect(line)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("5 % of the torque is left unexplained", "residual"),
        ("20 torque rows", "equations"),
        ("it cannot be\n told apart", "not identifiable"),
    ],
)
def test_what_is_forbidden_is_found(text, word):
    assert any(word in found for found in find_dialect(text))
    assert find_dialect("the residual of 20 samples; --rows friction; the rows of a table") == []
