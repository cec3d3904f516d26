"""The page on elastic joints: its scripts print what it shows."""

import os
from pathlib import Path

import pytest

from tests.transcripts import compare, list_scripts, run_python

PAGE = Path(__file__).resolve().parents[2] / "docs" / "elastic.md"


@pytest.mark.parametrize("number", [0, 1])
def test_scripts_print_what_the_page_shows(number, tmp_path, c_compiler):
    assert c_compiler
    script, said = list_scripts(PAGE.read_text(encoding="utf-8"))[number]
    code, found = run_python(["-c", script], tmp_path, Path(os.environ["XDG_CACHE_HOME"]))
    assert code == 0, found
    assert not compare(said, found), found
