"""Examples of pages in Python: the blocks of a section run, one after the other, and hold what they say."""

import re
import shutil

import numpy as np
import pytest

from tests.pages import DOCS

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TITLE = re.compile(r"<title>(.*?)</title>")


def run_section(page, first="", last=""):
    """Run the blocks between two headings, or all, in one namespace, and return its names."""
    text, names = (DOCS / page).read_text(encoding="utf-8"), {}
    for block in BLOCK.findall(text[text.index(first) : text.index(last) if last else None]):
        exec(compile(block, page, "exec"), names)  # noqa: S102  the page's own example
    return names


def test_a_spring_on_its_own():
    names = run_section("elastic.md", "## A spring on its own", "## How it is checked")
    np.testing.assert_allclose(names["back"], names["torsion"], atol=1e-15)
    assert np.diff(names["lost"]).min() >= -1e-14
    # Elements that hold 0.9 and 1.2 N m slip at these torsions.
    assert [stop.threshold for stop in names["same"].stops] == pytest.approx([1e-3, 3e-3])


def test_friction_with_a_memory(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run_section("friction_dynamic.md", "# Friction with a memory", "## In C")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == str(names["equations"].steady)
    assert lines[1].startswith(r"\dot z = ")
    assert lines[2] == "True"
    assert np.abs(names["torque"]).max() < 15.0 + 60.0 * 0.02 + 100.0 * 0.02


def test_every_picture_of_the_gallery_is_drawn_by_the_lines_above_it(tmp_path, monkeypatch):
    shutil.copytree(DOCS / "own_robot", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    blocks, pictures = BLOCK.findall(page), re.findall(r"\{image\} gallery/(\w+\.svg)", page)
    assert len(blocks) == len(pictures) == len(set(pictures)) >= 5
    for block, picture in zip(blocks, pictures, strict=True):
        exec(compile(block, "gallery.md", "exec"), {})  # noqa: S102  the page's own example
        drawn, shown = ((folder / picture).read_text() for folder in (tmp_path, DOCS / "gallery"))
        assert TITLE.findall(drawn) == TITLE.findall(shown)
        assert len(drawn) == pytest.approx(len(shown), rel=0.02)
