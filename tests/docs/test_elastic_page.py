"""The page on elastic joints: its scripts print what it shows."""

import os
from pathlib import Path

import pytest

from tests.transcripts import compare, list_scripts, run_scripts

PAGE = Path(__file__).resolve().parents[2] / "docs" / "elastic.md"


@pytest.fixture(scope="module")
def printed(tmp_path_factory, c_compiler):
    assert c_compiler
    scratch = tmp_path_factory.mktemp("elastic")
    pairs = []
    for number, (script, _) in enumerate(list_scripts(PAGE.read_text(encoding="utf-8"))):
        path = scratch / f"{number}.py"
        path.write_text(script, encoding="utf-8")
        pairs.append((path, tmp_path_factory.mktemp("work")))
    return run_scripts(pairs, Path(os.environ["XDG_CACHE_HOME"]))


def test_scripts_print_what_the_page_shows(printed):
    shown = list_scripts(PAGE.read_text(encoding="utf-8"))
    assert shown
    for (_, said), found in zip(shown, printed, strict=True):
        assert not compare(said, found), found
