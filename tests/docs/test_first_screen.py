"""The first screens run as they stand there; README, pages and help name the same commands and options."""

import ast
import os
import re
import shutil
from pathlib import Path

import pytest
from click import Context, Group

from symid.cli.call import symid
from tests.pages import DOCS
from tests.transcripts import compare, run_step

PROJECT = DOCS.parent
PAGES = [PROJECT / "README.md", *sorted(DOCS.rglob("*.md"))]
FOREIGN = {
    *("--build", "--install", "--libs", "--cflags", "--to", "--no-install-recommends"),
    *("--kill", "--recordings", "--src", "--dst"),
}
"""Options of other programs, and of benchmarks, that pages and messages name."""


def list_options(command, name=""):
    """Yield verbs with the long options of each, those of groups one by one."""
    if isinstance(command, Group):
        for verb in command.list_commands(Context(command)):
            yield from list_options(command.get_command(Context(command), verb), f"{name} {verb}".strip())
    else:
        yield name, {text for one in command.params for text in (*one.opts, *one.secondary_opts)}


OPTIONS = dict(list_options(symid))
KNOWN = {text for texts in OPTIONS.values() for text in texts if text.startswith("--")} | {
    "--help",
    "--version",
}


def find_options(text):
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text))


def read_first(text):
    """Return the commands and the answer of the first two blocks."""
    blocks = re.findall(r"^```\w*\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return re.sub(r" \\\n *", " ", blocks[0]), blocks[1]


@pytest.mark.usefixtures("c_compiler")
def test_three_commands_of_the_index_print_what_it_says(tmp_path):
    folder = tmp_path / "work"
    shutil.copytree(DOCS / "own_robot", folder)
    commands, answer = read_first((DOCS / "index.md").read_text(encoding="utf-8"))
    assert len(commands.splitlines()) == 3
    for command in commands.splitlines():
        code, printed = run_step(command, folder, Path(os.environ["XDG_CACHE_HOME"]))
        assert code == 0, printed
    assert not compare(answer, "\n".join(line for line in printed.splitlines() if line.startswith("verdict")))


def test_the_readme_begins_as_the_index_does():
    readme, index = (
        (place / name).read_text("utf-8") for place, name in ((PROJECT, "README.md"), (DOCS, "index.md"))
    )
    assert read_first(readme) == read_first(index)
    for picture in ("gallery/arm.svg", "gallery/arm_fit.svg"):
        assert all(picture in text for text in (readme, index))
        assert (DOCS / picture).is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(PROJECT)))
def test_options_that_a_page_names_exist(page):
    assert find_options(page.read_text(encoding="utf-8")) - KNOWN - FOREIGN == set()


def test_options_that_messages_and_help_name_exist():
    lost = {
        (str(path.relative_to(PROJECT)), option)
        for path in (PROJECT / "symid").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for option in find_options(node.value) - KNOWN - FOREIGN
    }
    assert lost == set()


def test_every_verb_and_every_option_of_help_is_in_the_pages():
    table = (DOCS / "command_line.md").read_text(encoding="utf-8")
    assert [verb for verb in OPTIONS if not re.search(rf"`(?:study )?{verb.split()[-1]}\b", table)] == []
    named = find_options("\n".join(page.read_text(encoding="utf-8") for page in PAGES))
    assert {option for option in KNOWN if option not in named} == set()
